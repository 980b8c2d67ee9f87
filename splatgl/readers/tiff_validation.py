"""Checks the structure and the LZW codes of TIFF files before they are decoded.

A code of a strip refers to an earlier code. For damaged codes, the decoder of imagecodecs reads unwritten memory.
"""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np

from splatgl.errors import expected, import_extra
from splatgl.fileio import require_memory
from splatgl.readers.common import MAX_BYTES, convert_words, decoder_errors, parse_number
from splatgl.readers.dicom_frames import check_picture, picture_size
from splatgl.readers.elsewhere import look

# most planes of a series: a list of them takes memory, even if they are not in the file
MAX_PLANES = 2**20
# bytes of a tag's value by the number of its type (TIFF 6.0 §2, TIFF technical note 1, BigTIFF)
_TYPE_BYTES = dict(enumerate((0, 1, 1, 2, 4, 8, 1, 1, 2, 4, 8, 4, 8, 4, 0, 0, 8, 8, 8)))
# least tags of a page (width, height, offsets and bytes of strips), and most
_MIN_TAGS, _MAX_TAGS = 4, 4096
_OME_COUNTS = ("IFD", "NumPlanes", "PlaneCount", "FirstC", "FirstT", "FirstZ", "SizeC", "SizeT", "SizeZ")


def check_chain(path: Path) -> None:
    """Raises InputError for pages that form a cycle, overlap, or share tag values; the decoder reports truncation."""
    size, visited, used = path.stat().st_size, set[int](), 0
    with path.open("rb") as file:
        head = file.read(16)
        order = {b"II": "<", b"MM": ">"}.get(head[:2])
        if order is None or len(head) < 16:
            return
        # numbers of tags, tags and offsets; those of BigTIFF have 64 bits
        is_big = struct.unpack_from(order + "H", head, 2)[0] == 43
        count, tag, link = (
            struct.Struct(order + code) for code in (("Q", "HHQQ", "Q") if is_big else ("H", "HHII", "I"))
        )
        (offset,) = link.unpack_from(head, 8 if is_big else 4)
        while 0 < offset < size:
            if offset in visited:
                got = f"page {len(visited)} leading back to another"
                raise expected("pages", "a chain that ends", got, "the file is damaged")
            visited.add(offset)
            file.seek(offset)
            (tags,) = count.unpack(file.read(count.size).ljust(count.size, b"\0"))
            if not _MIN_TAGS <= tags <= _MAX_TAGS:
                raise expected("tags of a page", f"{_MIN_TAGS} to {_MAX_TAGS}", tags, "the file is damaged")
            table, last = file.read(tags * tag.size), file.read(link.size)
            entries = tag.iter_unpack(table[: len(table) // tag.size * tag.size])
            used += len(table) + sum(_TYPE_BYTES.get(kind, 0) * number for _, kind, number, _ in entries)
            # some writers share short tag values between pages
            if used > 2 * size:
                raise expected("tags", f"at most {size} bytes", "more", "the file is damaged")
            offset = link.unpack(last)[0] if len(last) == link.size else 0


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


# supported compressions: their decoders limit the bytes of a strip, or check the size of its picture
_NUMBERS = {
    **{"none": (1,), "CCITT": (2, 3, 4), "LZW": (5,), "JPEG": (7, 33007, 34892), "deflate": (8, 32946, 50013)},
    **{"JPEG XR": (22610, 34934), "PackBits": (32773,), "JPEG 2000": (33003, 33004, 33005, 34712), "LERC": (34887,)},
    **{"LZMA": (34925,), "Zstandard": (34926, 50000), "WebP": (34927, 50001), "PNG": (34933,)},
    **{"JPEG XL": (50002, 52546)},
}
CODECS = {number: name for name, numbers in _NUMBERS.items() for number in numbers}


def check_page(page: Any) -> None:
    """Raises InputError for no pixels, packed sample types, codecs without a size bound, and strips too large."""
    frame = page.keyframe
    if not all(frame.shape):
        raise expected("size", "at least one pixel", "×".join(map(str, frame.shape)), "the header is damaged")
    if frame.dtype is None:
        raise expected("samples", "8 to 64 bits each", f"{frame.bitspersample} bits", "convert the file")
    if int(frame.compression) not in CODECS:
        known, name = ", ".join(dict.fromkeys(CODECS.values())), getattr(frame.compression, "name", frame.compression)
        raise expected("compression", f"one of {known}", name, "convert it with: tiffcp -c zip OLD NEW")
    strip = math.prod(frame.chunks) * frame.dtype.itemsize
    if strip > MAX_BYTES:
        raise expected("strips or tiles", f"at most {MAX_BYTES} bytes", strip, "the header is damaged")


def check_strips(pages: Iterable[Any]) -> None:
    """Raises InputError for pages with fewer strips or tiles than their size needs."""
    for page in pages:
        strips, there = math.prod(page.keyframe.chunked), len(page.dataoffsets)
        if strips > there:
            raise expected("strips or tiles", f"{strips} a page", there, "the header is damaged")


# rows and columns of a picture, () if its header tells none; and its tiles
Size = tuple[tuple[int, ...], int]


def _png_size(data: bytes) -> Size:
    """The size in the header of a PNG picture (PNG §11.2.2)."""
    columns, rows = struct.unpack(">2I", data[16:24])
    return ((rows, columns) if data[12:16] == b"IHDR" else ()), 1


def _webp_size(data: bytes) -> Size:
    """The size in the header of a WebP picture (RFC 9649 §2.5 to 2.7)."""
    kind = data[12:16]
    if kind == b"VP8X":
        columns, rows = (int.from_bytes(data[at : at + 3], "little") + 1 for at in (24, 27))
    elif kind == b"VP8L":
        bits = int.from_bytes(data[21:25], "little")
        columns, rows = (bits & 0x3FFF) + 1, (bits >> 14 & 0x3FFF) + 1
    else:
        columns, rows = (number & 0x3FFF for number in struct.unpack("<2H", data[26:30]))
    return ((rows, columns) if data[:4] == b"RIFF" else ()), 1


_XR_TAGS = {*range(0xBC01, 0xBC05), *range(0xBC80, 0xBC84), *range(0xBCC0, 0xBCC6)}


def jpeg_xr_size(data: bytes) -> Size:
    """The size in the header of a JPEG XR picture, whose container is like TIFF's (T.832 annex A)."""
    (start,) = struct.unpack("<I", data[4:8])
    (count,) = struct.unpack("<H", data[start : start + 2])
    entries = struct.iter_unpack("<HHII", data[start + 2 : start + 2 + 12 * min(count, 99)])
    found = {tag: value & 0xFFFF if kind == 3 else value for tag, kind, _, value in entries}
    # the decoder prints a line for each tag that it does not know
    return ((found.get(0xBC81, 0), found.get(0xBC80, 0)) if found.keys() <= _XR_TAGS else ()), 1


def jpeg_xl_size(data: bytes) -> Size:
    """The size in the header of a JPEG XL codestream, bare or in the first box of its container (18181-1 annex D)."""
    place = data.find(b"jxlc") + 4 if data[:4] == b"\0\0\0\x0c" else 0
    if data[place : place + 2] != b"\xff\x0a":
        return (), 1
    bits, used = int.from_bytes(data[place + 2 : place + 18], "little"), 0

    def take(count: int) -> int:
        nonlocal used
        used += count
        return bits >> (used - count) & ((1 << count) - 1)

    small = take(1)

    def length() -> int:
        return 8 * (take(5) + 1) if small else take((9, 13, 18, 30)[take(2)]) + 1

    rows, ratio = length(), take(3)
    above, below = ((0, 1), (1, 1), (12, 10), (4, 3), (3, 2), (16, 9), (5, 4), (2, 1))[ratio]
    return (rows, rows * above // below if ratio else length()), 1


def _lerc_size(data: bytes, packing: int = 0, most: int = 0) -> Size:
    """The size in the header of LERC 2 data. packing: 1 for deflate around it, 2 for Zstandard of `most` bytes."""
    if packing == 1:
        data = zlib.decompressobj().decompress(data, 64)
    elif packing == 2:
        data = import_extra("imagecodecs", "LERC", "imagecodecs", "readers").zstd_decode(data, out=most)[:64]
    version, start = int.from_bytes(data[6:10], "little"), 10
    # from version 3 on a checksum comes first
    rows, columns = struct.unpack_from("<2i", data, start + 4 * (version >= 3))
    return ((rows, columns) if data[:6] == b"Lerc2 " else ()), 1


_LZW, _LERC = 5, 34887
_SIZES: dict[int, Callable[[bytes], Size]] = {
    **dict.fromkeys((7, 33003, 33004, 33005, 33007, 34712, 34892), picture_size),
    **dict.fromkeys((22610, 34934), jpeg_xr_size),
    **dict.fromkeys((34927, 50001), _webp_size),
    **dict.fromkeys((50002, 52546), jpeg_xl_size),
    34933: _png_size,
}
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
    """Makes tifffile's pages check strips of LZW, LERC and pictures before decoding."""
    for page in pages:
        if page is None or page.keyframe.compression not in (_LZW, _LERC, *_SIZES):
            continue
        frame = page.keyframe
        if isinstance(frame.decode, _CheckedDecoder):
            continue
        if frame.compression in _XR:
            path = Path(page.parent.filehandle.path)
            look(_XR_LOOK, path, _XR_SECONDS + path.stat().st_size / _XR_BYTES)
        if frame.compression == _LZW:
            check: Callable[[bytes], None] = partial(check_lzw, reversed_bits=frame.fillorder == 2)
        else:
            size_of = _SIZES.get(int(frame.compression))
            if size_of is None:
                # tag 50674: version, and what is around the data
                packing = (*(frame.tags.valueof(50674) or ()), 0, 0)[1]
                most = 2 * math.prod(frame.chunks) * frame.dtype.itemsize + 2**16
                size_of = partial(_lerc_size, packing=packing, most=most)
            check = partial(_check_size, frame=frame, size_of=size_of)
        frame.decode = _CheckedDecoder(frame.decode, check)


def _check_size(data: bytes, frame: Any, size_of: Callable[[bytes], Size]) -> None:
    """Raises InputError for a strip or tile whose picture is larger than the page states."""
    with decoder_errors("TIFF"):
        size = size_of(bytes(data))
    check_picture(size, int(frame.chunks[0]), int(frame.chunks[1]))


# JPEG XR: its decoder crashes on damaged data, so that a file is decoded elsewhere first, by this function. Most
# seconds, and bytes that are decoded in another one at the slowest: damaged data may loop
_XR, _XR_LOOK, _XR_SECONDS, _XR_BYTES = (22610, 34934), "tiff_validation.decode_pages", 6.0, 2**20


def decode_pages(path: Path) -> None:
    """Decodes all pages of a file."""
    import tifffile

    with decoder_errors("TIFF"), tifffile.TiffFile(path) as tiff:
        for page in tiff.pages:
            require_memory(page.nbytes, path.stat().st_size)
            page.asarray()


class _CheckedDecoder:
    """A page's decoder that first raises InputError for damaged strips."""

    def __init__(self, decode: Callable[..., Any], check: Callable[[bytes], None]) -> None:
        self.decode, self.check = decode, check

    def __call__(self, data: bytes | None, index: int, **options: Any) -> Any:
        if data is not None:
            self.check(data)
        return self.decode(data, index, **options)


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
