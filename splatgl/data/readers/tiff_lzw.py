"""A look at LZW-compressed strips of TIFF files before they are decoded: damaged ones make the decoder crash.

A code of a strip refers to one that came before it. The decoder of imagecodecs follows those that do not into memory
that was never written.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np

from splatgl.data.errors import expected

_LZW = 5
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
    """Makes tifffile's pages check LZW-compressed strips before they decode them."""
    for page in pages:
        if page is None or page.keyframe.compression != _LZW:
            continue
        frame = page.keyframe
        if not isinstance(frame.decode, _Checked):
            frame.decode = _Checked(frame.decode, frame.fillorder == 2)


class _Checked:
    """A page's decoder that raises InputError for damaged strips."""

    def __init__(self, decode: Callable[..., Any], reversed_bits: bool) -> None:
        self.decode, self.reversed_bits = decode, reversed_bits

    def __call__(self, data: bytes | None, index: int, **given: Any) -> Any:
        if data is not None:
            check_lzw(data, self.reversed_bits)
        return self.decode(data, index, **given)


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
