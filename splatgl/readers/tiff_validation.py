"""Checks the structure and the LZW codes of TIFF files before they are decoded.

A code of a strip refers to an earlier code. For damaged codes, the decoder of imagecodecs reads unwritten memory.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO
from xml.etree.ElementTree import Element

import numpy as np

from splatgl.errors import expected
from splatgl.readers.common import convert_words, parse_number
from splatgl.readers.dicom_pixels import check_picture

# most planes of a series: a list of them takes memory, even if they are not in the file
MAX_PLANES = 2**20
# bytes of a tag's value by the number of its type (TIFF 6.0 §2, TIFF technical note 1, BigTIFF)
_TYPE_BYTES = (0, 1, 1, 2, 4, 8, 1, 1, 2, 4, 8, 4, 8, 4, 0, 0, 8, 8, 8)
# least tags of a page (width, height, offsets and bytes of strips), and most
_MIN_TAGS, _MAX_TAGS = 4, 4096
_OME_COUNTS = ("IFD", "NumPlanes", "PlaneCount", "FirstC", "FirstT", "FirstZ", "SizeC", "SizeT", "SizeZ")


def check_chain(path: Path) -> None:
    """Raises InputError for pages that form a cycle, overlap, or share tag values; the decoder reports truncation."""
    size = path.stat().st_size
    with path.open("rb") as file:
        layout = _read_layout(file.read(16))
        if layout is None:
            return
        form, offset = layout
        # 1. page by page: no cycles, and their total size is at most the file's
        visited: set[int] = set()
        used = 0
        while 0 < offset < size:
            if offset in visited:
                raise expected(
                    "pages", "a chain that ends", f"page {len(visited)} leading back to another", "the file is damaged"
                )
            visited.add(offset)
            table, values, offset = form.page(file, offset)
            used += table + values
            # 2. some writers share short tag values between pages
            if used > 2 * size:
                raise expected("tags", f"at most {size} bytes", "more", "the file is damaged")


class _Layout:
    """Layout of a TIFF file: classic with 32-bit offsets, or BigTIFF with 64-bit offsets."""

    def __init__(self, order: str, big: bool) -> None:
        self.count = struct.Struct(order + ("Q" if big else "H"))
        self.tag = struct.Struct(order + ("HHQQ" if big else "HHII"))
        self.offset = struct.Struct(order + ("Q" if big else "I"))

    def page(self, file: BinaryIO, start: int) -> tuple[int, int, int]:
        """(bytes of the page's table, bytes of its tags' values, offset of the next page or 0) at offset `start`."""
        file.seek(start)
        head = file.read(self.count.size)
        if len(head) < self.count.size:
            return 0, 0, 0
        (tags,) = self.count.unpack(head)
        if not _MIN_TAGS <= tags <= _MAX_TAGS:
            raise expected("tags of a page", f"{_MIN_TAGS} to {_MAX_TAGS}", tags, "the file is damaged")
        table = file.read(tags * self.tag.size)
        whole = len(table) // self.tag.size * self.tag.size
        entries = list(self.tag.iter_unpack(table[:whole]))
        values = sum(_TYPE_BYTES[kind] * count for _, kind, count, _ in entries if kind < len(_TYPE_BYTES))
        last = file.read(self.offset.size)
        following = self.offset.unpack(last)[0] if len(last) == self.offset.size else 0
        return len(table), values, following


def _read_layout(head: bytes) -> tuple[_Layout, int] | None:
    """The layout and the offset of the first page by a file's first bytes; None if it is not TIFF."""
    order = {b"II": "<", b"MM": ">"}.get(head[:2])
    if order is None or len(head) < 16:
        return None
    (version,) = struct.unpack_from(order + "H", head, 2)
    if version not in (42, 43):
        return None
    big = version == 43
    return _Layout(order, big), struct.unpack_from(order + ("Q" if big else "I"), head, 8 if big else 4)[0]


def check_ome(root: Element) -> None:
    """Raises InputError if OME's metadata state more than MAX_PLANES planes or steps."""
    for node in root.iter():
        stated = {name: node.attrib[name] for name in _OME_COUNTS if name in node.attrib}
        counts = {name: convert_words([text], int, f"OME-XML {name}")[0] for name, text in stated.items()}
        planes = abs(counts.get("SizeC", 1) * counts.get("SizeT", 1) * counts.get("SizeZ", 1))
        most = max((planes, *map(abs, counts.values())))
        if most > MAX_PLANES:
            raise expected("OME-XML", f"at most {MAX_PLANES} planes", most, "the metadata are damaged")
        if "Start" in node.attrib and "End" in node.attrib:
            # the steps of a modulo annotation
            start, end, step = (parse_number(node.get(name, "1")) for name in ("Start", "End", "Step"))
            if abs(end - start) > MAX_PLANES * abs(step):
                raise expected("OME-XML", f"at most {MAX_PLANES} steps", "more", "the metadata are damaged")


_LZW, _PICTURES = 5, (7, 33003, 33005, 34712)
_CLEAR, _END = 256, 257

# of the n-th code after a table is cleared: its bits, its first bit, and the first code that is not in the table yet
# (TIFF 6.0 §13: codes become longer one entry early)
_COUNT = 4096
_FREE = 257 + np.arange(_COUNT)
_BITS: np.ndarray = np.searchsorted([511, 1023, 2047], _FREE, side="right") + 9
_STARTS = np.concatenate([[0], np.cumsum(_BITS)])
_FIRST_FREE = np.where(np.arange(_COUNT) == 0, _CLEAR, _FREE + 1)

# codes examined first; least bytes per cleared table: writers clear tables when full, after thousands of codes
_FEW, _BYTES = 256, 64


def check_before_decoding(pages: Iterable[Any]) -> None:
    """Makes tifffile's pages check strips of LZW, JPEG and JPEG 2000 before decoding."""
    for page in pages:
        if page is None or page.keyframe.compression not in (_LZW, *_PICTURES):
            continue
        frame = page.keyframe
        if isinstance(frame.decode, _CheckedDecoder):
            continue
        if frame.compression == _LZW:
            check: Callable[[bytes], None] = partial(check_lzw, reversed_bits=frame.fillorder == 2)
        else:
            check = partial(check_picture, rows=int(frame.chunks[0]), columns=int(frame.chunks[1]))
        frame.decode = _CheckedDecoder(frame.decode, check)


class _CheckedDecoder:
    """A page's decoder that first raises InputError for damaged strips."""

    def __init__(self, decode: Callable[..., Any], check: Callable[[bytes], None]) -> None:
        self.decode, self.check = decode, check

    def __call__(self, data: bytes | None, index: int, **given: Any) -> Any:
        if data is not None:
            self.check(data)
        return self.decode(data, index, **given)


def check_lzw(data: bytes, reversed_bits: bool = False) -> None:
    """Raises InputError for a strip with a code outside its table. reversed_bits: the lowest bit comes first."""
    array = np.frombuffer(data, np.uint8)
    if reversed_bits:
        array = np.packbits(np.unpackbits(array, bitorder="little"))
    bits = 8 * len(array)
    padded = np.concatenate([array, np.zeros(4, np.uint8)]).astype(np.uint32)
    if bits >= 9 and _read_codes(padded, 0, 1)[0] != _CLEAR:
        raise _lzw_error("a strip that does not begin with an empty table")
    place, tables = 0, 0
    while place + 9 <= bits:
        place, following = _check_table(padded, place, bits)
        tables += 1
        if not following:
            return
        if tables > 4 + len(array) // _BYTES:
            raise _lzw_error("tables of a few codes")


def _check_table(padded: np.ndarray, place: int, bits: int) -> tuple[int, bool]:
    """Checks codes from bit `place` until the table is cleared; returns (the next bit, whether more codes follow)."""
    most = int(np.searchsorted(_STARTS, bits - place, side="right")) - 1
    for count in (min(_FEW, most), most):
        codes = _read_codes(padded, place, count)
        ends = np.flatnonzero((codes == _CLEAR) | (codes == _END))
        if len(ends):
            break
    last = int(ends[0]) if len(ends) else count
    # every table has the codes that clear it and that end the strip
    if (codes[:last] >= _FIRST_FREE[:last]).any():
        raise _lzw_error("one that is in no table")
    if not len(ends):
        # a full table must be cleared
        if count == _COUNT and bits - place - _STARTS[count] >= _BITS[-1]:
            raise _lzw_error("a table that is full")
        return bits, False
    return place + int(_STARTS[last + 1]), bool(codes[last] == _CLEAR)


def _read_codes(padded: np.ndarray, place: int, count: int) -> np.ndarray:
    """The first `count` codes of a table that begins at bit `place`. padded: bytes as uint32, and four zeros."""
    starts, long = place + _STARTS[:count], _BITS[:count]
    byte, bit = starts >> 3, starts & 7
    word = padded[byte] << 16 | padded[byte + 1] << 8 | padded[byte + 2]
    codes: np.ndarray = (word >> (24 - bit - long).astype(np.uint32)) & ((1 << long) - 1).astype(np.uint32)
    return codes


def _lzw_error(got: str) -> Exception:
    return expected("LZW codes", "codes that the strip has defined", got, "the file is damaged")
