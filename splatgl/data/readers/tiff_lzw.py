"""A look at strips of TIFF files before they are decoded: damaged LZW makes the decoder crash, JPEG may state any size.

A code of a strip refers to one that came before it. The decoder of imagecodecs follows those that do not into memory
that was never written.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import partial
from typing import Any

import numpy as np

from splatgl.data.readers.codestream import MOST_TILES, stream_size
from splatgl.errors import expected

_LZW, _PICTURES = 5, (7, 33003, 33005, 34712)
_CLEAR, _END = 256, 257

# of the n-th code after a table is cleared: its bits, where it starts, and the first code that is not yet in the table
# (TIFF 6.0 §13: codes become longer one entry early)
_COUNT = 4096
_FREE = 257 + np.arange(_COUNT)
_BITS: np.ndarray = np.searchsorted([511, 1023, 2047], _FREE, side="right") + 9
_STARTS = np.concatenate([[0], np.cumsum(_BITS)])
_FIRST_FREE = np.where(np.arange(_COUNT) == 0, _CLEAR, _FREE + 1)

# codes looked at first, and bytes per table that is cleared: writers clear full ones, of thousands of codes
_FEW, _BYTES = 256, 64


def guard(pages: Iterable[Any]) -> None:
    """Makes tifffile's pages check strips of LZW, JPEG and JPEG 2000 before they decode them."""
    for page in pages:
        if page is None or page.keyframe.compression not in (_LZW, *_PICTURES):
            continue
        frame = page.keyframe
        if not isinstance(frame.decode, _Checked):
            frame.decode = _Checked(frame.decode, _check_of(frame))


def _check_of(frame: Any) -> Callable[[bytes], None]:
    if frame.compression == _LZW:
        return partial(check_lzw, reversed_bits=frame.fillorder == 2)
    return partial(check_picture, rows=int(frame.chunks[0]), columns=int(frame.chunks[1]))


class _Checked:
    """A page's decoder that raises InputError for damaged strips."""

    def __init__(self, decode: Callable[..., Any], check: Callable[[bytes], None]) -> None:
        self.decode, self.check = decode, check

    def __call__(self, data: bytes | None, index: int, **given: Any) -> Any:
        if data is not None:
            self.check(data)
        return self.decode(data, index, **given)


def check_picture(data: bytes, rows: int, columns: int) -> None:
    """Raises InputError for a strip or tile that states a larger picture than its place has."""
    size, tiles = stream_size(bytes(data))
    if not size or size[0] > rows or size[1] > columns or tiles > MOST_TILES:
        got = f"{size[1]} × {size[0]} in {tiles} tiles" if size else "none"
        raise expected("picture in a strip", f"{columns} × {rows} pixels at most", got, "the file is damaged")


def check_lzw(data: bytes, reversed_bits: bool = False) -> None:
    """Raises InputError for a strip with a code that is in no table. reversed_bits: the lowest comes first."""
    array = np.frombuffer(data, np.uint8)
    if reversed_bits:
        array = np.packbits(np.unpackbits(array, bitorder="little"))
    bits = 8 * len(array)
    padded = np.concatenate([array, np.zeros(4, np.uint8)]).astype(np.uint32)
    if bits >= 9 and _codes(padded, 0, 1)[0] != _CLEAR:
        raise _damaged("a strip that does not begin with an empty table")
    place, tables = 0, 0
    while place + 9 <= bits:
        place, following = _table(padded, place, bits)
        tables += 1
        if not following:
            return
        if tables > 4 + len(array) // _BYTES:
            raise _damaged("tables of a few codes")


def _table(padded: np.ndarray, place: int, bits: int) -> tuple[int, bool]:
    """Checks the codes from a place on, up to where the table is cleared; (the place behind, whether more follow)."""
    most = int(np.searchsorted(_STARTS, bits - place, side="right")) - 1
    for count in (min(_FEW, most), most):
        codes = _codes(padded, place, count)
        ends = np.flatnonzero((codes == _CLEAR) | (codes == _END))
        if len(ends):
            break
    last = int(ends[0]) if len(ends) else count
    # what clears a table, or ends the strip, is in every table
    if (codes[:last] >= _FIRST_FREE[:last]).any():
        raise _damaged("one that is in no table")
    if not len(ends):
        # a table that is full and not cleared
        if count == _COUNT and bits - place - _STARTS[count] >= _BITS[-1]:
            raise _damaged("a table that is full")
        return bits, False
    return place + int(_STARTS[last + 1]), bool(codes[last] == _CLEAR)


def _codes(padded: np.ndarray, place: int, count: int) -> np.ndarray:
    """The codes of a table that begins at a bit. padded: bytes, uint32, with four more."""
    starts, long = place + _STARTS[:count], _BITS[:count]
    byte, bit = starts >> 3, starts & 7
    word = padded[byte] << 16 | padded[byte + 1] << 8 | padded[byte + 2]
    found: np.ndarray = (word >> (24 - bit - long).astype(np.uint32)) & ((1 << long) - 1).astype(np.uint32)
    return found


def _damaged(got: str) -> Exception:
    return expected("LZW codes", "ones that the strip introduced", got, "the file is damaged")
