"""The numbers of a .vti array: ASCII, base64 or raw, plain or in compressed blocks, behind a header of byte counts."""

from __future__ import annotations

import base64
import io
import lzma
import zlib
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from splatgl.data.readers.files import MAX_BYTES, library, map_array, require_bytes, require_plausible
from splatgl.data.readers.text import read_numbers, require_end
from splatgl.errors import expected, missing_extra
from splatgl.fileio import byte_count, require_memory

Shape4 = tuple[int, int, int, int]


@dataclass(frozen=True)
class Coding:
    """How a file codes its arrays: the dtype of the header's counts, and the compressor of its blocks or ""."""

    header: np.dtype
    compressor: str


@dataclass(frozen=True)
class Source:
    """Coded bytes: `inline` text, or the file itself (None), from `start` on; raw or base64."""

    path: Path
    inline: bytes | None
    start: int
    raw: bool

    def at(self, offset: int) -> Source:
        """The source `offset` stored bytes further on."""
        if offset < 0:
            raise expected("offset", "zero or more bytes", offset)
        return replace(self, start=self.start + offset)

    def stored(self, count: int) -> int:
        """Stored bytes that code `count` bytes: base64 turns three into four characters."""
        return count if self.raw else 4 * -(-count // 3)

    def read(self, stored: int) -> bytes:
        """The first `stored` bytes as they are. Raises InputError if they are not there."""
        size = self.path.stat().st_size if self.inline is None else len(self.inline)
        require_bytes(stored, size - self.start)
        if self.inline is not None:
            return self.inline[self.start : self.start + stored]
        with self.path.open("rb") as file:
            file.seek(self.start)
            return file.read(stored)

    def take(self, count: int) -> bytes:
        """The first `count` bytes, decoded. Raises InputError if they are not there."""
        data = self.read(self.stored(count))
        if self.raw:
            return data
        with library("base64 data"):
            decoded = base64.b64decode(data, validate=True)
        require_bytes(count, len(decoded), "base64 data")
        return decoded[:count]


def parse_ascii(text: str, dtype: np.dtype, shape: Shape4) -> np.ndarray:
    """The numbers of a text [shape]. Raises InputError if there are more or fewer."""
    data, count = text.encode("ascii", "replace"), byte_count(shape, np.dtype("u1"))
    file = io.BytesIO(data)
    numbers = read_numbers(file, count, dtype, len(data))
    require_end(file, count)
    return numbers.reshape(shape)


def decode(source: Source, coding: Coding, dtype: np.dtype, shape: Shape4) -> np.ndarray:
    """The array [shape] behind `source`; raw bytes of a file that are not compressed are mapped."""
    needed, width = byte_count(shape, dtype), coding.header.itemsize
    if coding.compressor:
        return _inflate_blocks(source, coding, needed).view(dtype).reshape(shape)
    # 1. the header is the number of bytes that follow
    _same(needed, int(np.frombuffer(source.take(width), coding.header)[0]))
    if source.raw:
        return map_array(source.path, source.start + width, dtype, shape)
    # 2. base64: header and data are one run of characters, or two if the header was padded
    stored = source.stored(width)
    padded = source.read(stored).endswith(b"=")
    data = source.at(stored).take(needed) if padded else source.take(width + needed)[width:]
    return np.frombuffer(data, dtype).reshape(shape)


def _inflate_blocks(source: Source, coding: Coding, needed: int) -> np.ndarray:
    """Inflates blocks; header: number of blocks, bytes of each, of the last, compressed bytes of each."""
    # 1. the header, whose length is in its first number
    width = coding.header.itemsize
    blocks = int(np.frombuffer(source.take(width), coding.header)[0])
    header = [int(count) for count in np.frombuffer(source.take((3 + blocks) * width), coding.header)]
    full, last, packed = header[1], header[2], header[3:]
    sizes = [full] * blocks
    if blocks and last:
        sizes[-1] = last
    _same(needed, sum(sizes))
    require_plausible(needed, sum(packed), bounded=coding.compressor != "vtkLZMADataCompressor")
    require_memory(needed, sum(packed))
    # 2. the blocks, one behind the other
    data = source.at(source.stored((3 + blocks) * width)).take(sum(packed))
    out, start = bytearray(), 0
    for size, stored in zip(sizes, packed, strict=True):
        with library("compressed data"):
            block = COMPRESSORS[coding.compressor](data[start : start + stored], size + 1)
        if len(block) != size:
            raise expected("inflated block", f"{size} bytes", "more" if len(block) > size else len(block))
        out += block
        start += stored
    return np.frombuffer(out, np.uint8)


def _zlib(data: bytes, most: int) -> bytes:
    return zlib.decompressobj().decompress(data, most)


def _lzma(data: bytes, most: int) -> bytes:
    return lzma.LZMADecompressor(memlimit=MAX_BYTES).decompress(data, most)


def _lz4(data: bytes, most: int) -> bytes:
    try:
        import imagecodecs
    except ImportError:
        raise missing_extra("LZ4 data", "imagecodecs", "readers") from None
    return bytes(imagecodecs.lz4_decode(data, out=most))


COMPRESSORS: dict[str, Callable[[bytes, int], bytes]] = {
    "vtkZLibDataCompressor": _zlib,
    "vtkLZ4DataCompressor": _lz4,
    "vtkLZMADataCompressor": _lzma,
}
"""By VTK's names: (data of one block, most bytes) → at most as many bytes of it."""


def _same(needed: int, stated: int) -> None:
    if needed != stated:
        raise expected("data", f"{needed} bytes, as the extent says", f"{stated} by its own header")
