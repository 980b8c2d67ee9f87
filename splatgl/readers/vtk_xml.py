"""VTK XML images: .vti, .vtr, .pvti and .pvtr.

Samples belong to points or to cells, which are one fewer along each axis and half a step further. A point's index
counts from index 0, not from the extent's lower end, and Direction is listed row by row. Rectilinear grids with uneven
steps are resampled.

Format: "VTK XML file formats", docs.vtk.org.
"""

from __future__ import annotations

import base64
import io
import lzma
import math
import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import XML, Element, TreeBuilder, XMLParser

import numpy as np

from splatgl.data.volume import Volume
from splatgl.errors import expected, import_extra
from splatgl.fileio import byte_count, require_memory
from splatgl.readers.common import (
    MAX_BYTES,
    Shape,
    decoder_errors,
    find_data_file,
    grid_shape,
    map_array,
    read_text,
    require_bytes,
    require_plausible,
)
from splatgl.readers.options import LoadOptions
from splatgl.readers.vtk_legacy import PointArray, Selection, count_cells, select_arrays

# world-from-index [3, 3], and the position of index (0, 0, 0)
Grid = tuple[np.ndarray, np.ndarray]


def read(path: Path, options: LoadOptions) -> Volume:
    """The volume of a .vti or .vtr file; `array` names an array, the first vectors go to `Volume.vectors`."""
    file = parse_vtk(path, ("ImageData", "RectilinearGrid"))
    pieces, coordinates = read_pieces(file)
    if file.kind == "RectilinearGrid":
        return _rectilinear(pieces, coordinates, options)
    return _volume(pieces, image_grid(file), options)


def read_parallel(path: Path, options: LoadOptions) -> Volume:
    """The volume of a .pvti or .pvtr file, whose pieces are files in its folder; options as in `read`."""
    parent = parse_vtk(path, ("PImageData", "PRectilinearGrid"))
    names = [node.get("Source", "") for node in parent.root.findall(f"{parent.kind}/Piece")]
    if not names or len(set(names)) < len(names):
        raise expected("Piece", "one file per piece", f"{len(names)} in {len(set(names))} files")
    files = [parse_vtk(find_data_file(path, name, options.anywhere), (parent.kind[1:],)) for name in names]
    parts = [read_pieces(file) for file in files]
    pieces = [piece for piece_list, _ in parts for piece in piece_list]
    if parent.kind == "PRectilinearGrid":
        return _rectilinear(pieces, [coordinates for _, axes in parts for coordinates in axes], options)
    grids = [image_grid(file) for file in files]
    if any(not np.allclose(grid[0], grids[0][0]) or not np.allclose(grid[1], grids[0][1]) for grid in grids):
        raise expected("pieces", "one spacing, origin and direction", "several", "merge them with ParaView")
    return _volume(pieces, grids[0], options)


def read_pieces(file: VtkXml) -> tuple[list[Piece], list[list[PointArray]]]:
    """The pieces of a file that are not empty, and the coordinates along x, y, z of rectilinear ones."""
    owner = file.root.find(file.kind)
    nodes = file.root.findall(f"{file.kind}/Piece")
    if owner is None or not nodes:
        raise expected("Piece", "one or more", "none")
    # lowest and highest index of points along x, y, z
    texts = [(node, "Extent") if node.get("Extent") else (owner, "WholeExtent") for node in nodes]
    extents = [[int(number) for number in parse_numbers(element, name, "", 6)] for element, name in texts]
    filled = [n for n, extent in enumerate(extents) if all(extent[a + 1] >= extent[a] for a in (0, 2, 4))] or [0]
    pieces = [_read_piece(file, nodes[n], extents[n]) for n in filled]
    axes = [_read_coordinates(file, nodes[n], piece) for n, piece in zip(filled, pieces, strict=True)]
    return pieces, axes if file.kind == "RectilinearGrid" else []


def _read_piece(file: VtkXml, node: Element, extent: list[int]) -> Piece:
    low = (extent[0], extent[2], extent[4])
    shape = grid_shape([extent[axis + 1] - extent[axis] + 1 for axis in (0, 2, 4)], "Extent")
    owners = ((node.find("PointData"), shape), (node.find("CellData"), count_cells(shape)))
    return Piece(low, shape, *([] if owner is None else read_arrays(file, owner, counts) for owner, counts in owners))


def _read_coordinates(file: VtkXml, node: Element, piece: Piece) -> list[PointArray]:
    """The coordinates of a rectilinear piece along x, y, z."""
    owner = node.find("Coordinates")
    nodes = [] if owner is None else owner.findall("DataArray")
    if file.kind != "RectilinearGrid":
        return []
    if owner is None or len(nodes) != 3:
        raise expected("Coordinates", "three arrays", len(nodes))
    return [read_array(file, array, (1, 1, count)) for array, count in zip(nodes, piece.shape[::-1], strict=True)]


def image_grid(file: VtkXml) -> Grid:
    """The grid of image data."""
    image = file.root.find(file.kind)
    assert image is not None
    direction = np.array(parse_numbers(image, "Direction", "1 0 0 0 1 0 0 0 1", 9)).reshape(3, 3)
    return direction * parse_numbers(image, "Spacing", "1 1 1", 3), np.array(parse_numbers(image, "Origin", "0 0 0", 3))


def _rectilinear(pieces: list[Piece], coordinates: list[list[PointArray]], options: LoadOptions) -> Volume:
    """The volume of a rectilinear grid. coordinates: of each piece along x, y, z."""
    every = []
    for axis, name in enumerate("xyz"):
        first = min(piece.low[axis] for piece in pieces)
        count = max(piece.low[axis] + piece.shape[2 - axis] for piece in pieces) - first
        parts = [axes[axis].read().ravel() for axes in coordinates]
        if count > sum(part.size for part in parts):
            raise expected("pieces", "a whole grid", f"gaps along {name}")
        places = np.full(count, np.nan)
        for piece, part in zip(pieces, parts, strict=True):
            places[piece.low[axis] - first :][: part.size] = part
        every.append(places)
    return _select(pieces, options)[0].rectilinear(every, even=options.spacing is not None)


def _select(pieces: list[Piece], options: LoadOptions) -> tuple[Selection, Index]:
    """The selected arrays of pieces, and the index of the first point."""
    points, low = join_pieces(pieces, cells=False)
    cells, _ = join_pieces(pieces, cells=True)
    return select_arrays(points, cells, options), low


def _volume(pieces: list[Piece], grid: Grid, options: LoadOptions) -> Volume:
    matrix, origin = grid
    choice, low = _select(pieces, options)
    counts = np.max([np.add(piece.low, piece.shape[::-1]) for piece in pieces], axis=0) - low
    return choice.volume(matrix, origin + matrix @ low, counts[::-1], "Direction and Spacing")


Shape4 = tuple[int, int, int, int]


@dataclass(frozen=True)
class Coding:
    """Coding of a file's arrays: the dtype of the headers' counts, and the compressor of blocks or ""."""

    header: np.dtype
    compressor: str


@dataclass(frozen=True)
class ByteSource:
    """Coded bytes of `inline` text, or of the file if that is None, from `start` on; raw or base64."""

    path: Path
    inline: bytes | None
    start: int
    raw: bool

    def at(self, offset: int) -> ByteSource:
        """The source `offset` stored bytes further on."""
        if offset < 0:
            raise expected("offset", "zero or more bytes", offset)
        return replace(self, start=self.start + offset)

    def stored(self, count: int) -> int:
        """Stored bytes that code `count` bytes: base64 turns three into four characters."""
        return count if self.raw else 4 * -(-count // 3)

    def read(self, stored: int) -> bytes:
        """The first `stored` bytes, not decoded. Raises InputError for fewer bytes."""
        size = self.path.stat().st_size if self.inline is None else len(self.inline)
        require_bytes(stored, size - self.start)
        if self.inline is not None:
            return self.inline[self.start : self.start + stored]
        with self.path.open("rb") as file:
            file.seek(self.start)
            return file.read(stored)

    def take(self, count: int) -> bytes:
        """The first `count` bytes, decoded. Raises InputError for fewer bytes."""
        data = self.read(self.stored(count))
        if self.raw:
            return data
        with decoder_errors("base64 data"):
            decoded = base64.b64decode(data, validate=True)
        require_bytes(count, len(decoded), "base64 data")
        return decoded[:count]


def parse_ascii(text: str, dtype: np.dtype, shape: Shape4) -> np.ndarray:
    """The numbers of a text [shape]. Raises InputError if there are more or fewer."""
    data = text.encode("ascii", "replace")
    return read_text(io.BytesIO(data), dtype, shape, len(data))


def decode(source: ByteSource, coding: Coding, dtype: np.dtype, shape: Shape4) -> np.ndarray:
    """The array [shape] in `source`; uncompressed raw bytes of a file are mapped."""
    needed, width = byte_count(shape, dtype), coding.header.itemsize
    if coding.compressor:
        return _inflate_blocks(source, coding, needed).view(dtype).reshape(shape)
    # 1. the header is the number of bytes that follow
    _check_size(needed, int(np.frombuffer(source.take(width), coding.header)[0]))
    if source.raw:
        return map_array(source.path, source.start + width, dtype, shape)
    # 2. base64: header and data are one run of characters, or two if the header was padded
    stored = source.stored(width)
    padded = source.read(stored).endswith(b"=")
    data = source.at(stored).take(needed) if padded else source.take(width + needed)[width:]
    return np.frombuffer(data, dtype).reshape(shape)


def _inflate_blocks(source: ByteSource, coding: Coding, needed: int) -> np.ndarray:
    """Inflates blocks; header: number of blocks, bytes of each, of the last, compressed bytes of each."""
    # 1. the header; its first number states its length
    width = coding.header.itemsize
    blocks = int(np.frombuffer(source.take(width), coding.header)[0])
    header = [int(count) for count in np.frombuffer(source.take((3 + blocks) * width), coding.header)]
    full, last, packed = header[1], header[2], header[3:]
    sizes = [full] * blocks
    if blocks and last:
        sizes[-1] = last
    _check_size(needed, sum(sizes))
    require_plausible(needed, sum(packed), bounded=coding.compressor != "vtkLZMADataCompressor")
    require_memory(needed, sum(packed))
    # 2. the blocks, one behind the other
    data = source.at(source.stored((3 + blocks) * width)).take(sum(packed))
    out, start = bytearray(), 0
    for size, stored in zip(sizes, packed, strict=True):
        with decoder_errors("compressed data"):
            block = COMPRESSORS[coding.compressor](data[start : start + stored], size + 1)
        if len(block) != size:
            raise expected("inflated block", f"{size} bytes", "more" if len(block) > size else len(block))
        out += block
        start += stored
    return np.frombuffer(out, np.uint8)


def _lz4(data: bytes, most: int) -> bytes:
    imagecodecs = import_extra("imagecodecs", "LZ4 data", "imagecodecs", "readers")
    return bytes(imagecodecs.lz4_decode(data, out=most))


# decompressors by VTK's names: (data of a block, most bytes) → at most so many bytes
COMPRESSORS: dict[str, Callable[[bytes, int], bytes]] = {
    "vtkZLibDataCompressor": lambda data, most: zlib.decompressobj().decompress(data, most),
    "vtkLZ4DataCompressor": _lz4,
    "vtkLZMADataCompressor": lambda data, most: lzma.LZMADecompressor(memlimit=MAX_BYTES).decompress(data, most),
}


def _check_size(needed: int, stated: int) -> None:
    if needed != stated:
        raise expected("data", f"{needed} bytes, as the extent says", f"{stated} by its header")


Index = tuple[int, int, int]


@dataclass(frozen=True)
class Piece:
    """Part of a grid: index (x, y, z) of its first point, points along z, y, x, arrays of points and cells."""

    low: Index
    shape: Shape
    points: list[PointArray]
    cells: list[PointArray]


def join_pieces(pieces: Sequence[Piece], cells: bool) -> tuple[list[PointArray], Index]:
    """The arrays of the points or cells of all pieces, and the index of the first point.

    Where pieces overlap, the later piece counts. Reading an array raises InputError if pieces leave gaps.
    """
    first: Index = tuple(min(piece.low[axis] for piece in pieces) for axis in range(3))  # type: ignore[assignment]
    groups = [piece.cells if cells else piece.points for piece in pieces]
    if len(pieces) == 1:
        return groups[0], first
    descriptions = [[(array.name, array.components, array.dtype) for array in group] for group in groups]
    if any(array != descriptions[0] for array in descriptions):
        raise expected("pieces", "the same arrays in all pieces", "different arrays", "save the grid again")
    last = np.max([np.add(piece.low, piece.shape[::-1]) for piece in pieces], axis=0)
    d, h, w = (last - first)[::-1].tolist()
    shape = (d, h, w)
    counts = count_cells(shape) if cells else shape
    lows = [tuple(at - begin for at, begin in zip(piece.low, first, strict=True))[::-1] for piece in pieces]
    joined = [replace(parts[0], read=partial(_join_arrays, parts, lows, counts)) for parts in zip(*groups, strict=True)]
    return joined, first


def _join_arrays(parts: Sequence[PointArray], lows: Sequence[tuple[int, ...]], shape: Shape) -> np.ndarray:
    """Joins the pieces' arrays to one array [D, H, W, components]."""
    # every piece is checked against its file before the whole is allocated
    arrays = [part.read() for part in parts]
    if np.prod(shape, dtype=np.float64) > sum(array.size / array.shape[3] for array in arrays):
        raise expected("pieces", "a whole grid", "gaps between them")
    joined = np.empty((*shape, parts[0].components), parts[0].dtype)
    filled = np.zeros(shape, bool)
    for array, low in zip(arrays, lows, strict=True):
        box = tuple(slice(at, at + size) for at, size in zip(low, array.shape[:3], strict=True))
        joined[box], filled[box] = array, True
    if not filled.all():
        raise expected("pieces", "a whole grid", "gaps between them")
    return joined


_TYPES = {
    f"{name}{8 * size}": f"{code}{size}"
    for name, code, sizes in (("Int", "i", (1, 2, 4, 8)), ("UInt", "u", (1, 2, 4, 8)), ("Float", "f", (4, 8)))
    for size in sizes
}

_APPENDED = b"<AppendedData"


@dataclass(frozen=True)
class VtkXml:
    """A file's XML part, its appended data if any, and the coding of its arrays."""

    path: Path
    root: Element
    appended: ByteSource | None
    coding: Coding

    @property
    def kind(self) -> str:
        """The type of the data set, such as ImageData."""
        return self.root.get("type") or self.root.tag


def parse_vtk(path: Path, kinds: tuple[str, ...]) -> VtkXml:
    """Parses the XML part of a file; appended data need not be XML. Raises InputError for a type not in `kinds`."""
    data = np.memmap(path, np.uint8, mode="r")
    text = data[: _find_word(data, _APPENDED)].tobytes()
    appended = None
    if len(text) < len(data):
        tag_end = len(text) + _find_word(data[len(text) :], b">")
        first = tag_end + _find_word(data[tag_end:], b"_") + 1
        raw = b'"raw"' in data[len(text) : tag_end].tobytes()
        appended = ByteSource(path, None, first, raw)
        text += b"</VTKFile>"
    root = parse_xml(text, "VTK XML")
    if root.tag != "VTKFile" or root.get("type") not in kinds:
        raise expected("type", f"a VTKFile of {' or '.join(kinds)}", root.get("type") or root.tag)
    return VtkXml(path, root, appended, _read_coding(root))


def _find_word(data: np.ndarray, word: bytes) -> int:
    """Offset of `word` in the bytes, or their number without it; reads only up to it."""
    step = 1 << 20
    for start in range(0, len(data), step):
        place = data[start : start + step + len(word)].tobytes().find(word)
        if place >= 0:
            return start + place
    return len(data)


def _read_coding(root: Element) -> Coding:
    order = {"LittleEndian": "<", "BigEndian": ">"}.get(root.get("byte_order", "LittleEndian"))
    header = {"UInt32": "u4", "UInt64": "u8"}.get(root.get("header_type", "UInt32"))
    compressor = root.get("compressor", "")
    if order is None or header is None:
        got = f"{root.get('byte_order')}, {root.get('header_type')}"
        raise expected("byte_order and header_type", "Little/BigEndian, UInt32/64", got)
    if compressor not in ("", *COMPRESSORS):
        raise expected("compressor", "zlib, LZ4, LZMA or none", compressor, "save it with zlib")
    return Coding(np.dtype(order + header), compressor)


def read_arrays(file: VtkXml, owner: Element, shape: Shape) -> list[PointArray]:
    """The arrays [D, H, W, components] below an element, which are read later."""
    active = owner.get("Scalars")
    arrays = [read_array(file, node, shape) for node in owner.findall("DataArray")]
    return [replace(array, active=array.name == active) for array in arrays]


def read_array(file: VtkXml, node: Element, shape: Shape) -> PointArray:
    """The array [D, H, W, components] of an element DataArray, which is read later."""
    name, type_name, kind = node.get("Name", "unnamed"), node.get("type", "none"), node.get("format", "none")
    components = int(parse_numbers(node, "NumberOfComponents", "1", 1)[0])
    is_bits = type_name == "Bit"
    if (type_name not in _TYPES and not is_bits) or components < 1:
        raise expected(f"DataArray {name}", "a number type and components", f"{type_name}, {components}")
    dtype = np.dtype("u1" if is_bits else _TYPES[type_name]).newbyteorder(file.coding.header.byteorder)
    full = (*shape, components)
    # bits are packed, but for numbers in text
    stored = (1, 1, 1, -(-math.prod(full) // 8)) if is_bits and kind != "ascii" else full
    if kind == "ascii":
        read: Callable[[], np.ndarray] = partial(parse_ascii, node.text or "", dtype, full)
    elif kind == "binary":
        inline = "".join((node.text or "").split()).encode("ascii", "replace")
        read = partial(decode, ByteSource(file.path, inline, 0, False), file.coding, dtype, stored)
    elif kind == "appended" and file.appended is not None:
        source = file.appended.at(int(parse_numbers(node, "offset", "0", 1)[0]))
        read = partial(decode, source, file.coding, dtype, stored)
    else:
        raise expected(f"DataArray {name}", "format ascii, binary or appended (with data)", kind)
    if is_bits:
        read, dtype = partial(_read_bits, read, full), np.dtype(bool)
    return PointArray(name, components, components == 3 and dtype.kind == "f", read, dtype)


def _read_bits(read: Callable[[], np.ndarray], shape: Shape4) -> np.ndarray:
    """An array of bits [shape], of numbers in text or of packed bytes, whose highest bit is the first."""
    stored = read()
    if stored.shape == tuple(shape):
        return stored.astype(bool)
    return np.unpackbits(stored.ravel(), count=math.prod(shape)).view(bool).reshape(shape)


def parse_numbers(element: Element, name: str, default: str, count: int) -> list[float]:
    """The numbers of an attribute. Raises InputError unless there are `count` finite ones."""
    text = element.get(name, default)
    try:
        numbers = [float(word) for word in text.split()]
    except ValueError:
        numbers = []
    if len(numbers) != count or not np.isfinite(numbers).all():
        raise expected(name, f"{count} numbers", repr(text))
    return numbers


# deepest nesting of elements; image files need six
MAX_DEPTH = 64


def parse_xml(text: str | bytes, title: str) -> Element:
    """The root element of `text`. Raises InputError for damaged XML, for a DOCTYPE, and beyond MAX_DEPTH."""
    with decoder_errors(title):
        return XML(text, XMLParser(target=_LimitedBuilder()))


class _LimitedBuilder(TreeBuilder):
    """Builder of elements that raises InputError for a DOCTYPE, and beyond MAX_DEPTH."""

    depth = 0

    def start(self, tag: Any, attrs: dict[Any, str], /) -> Element:
        self.depth += 1
        if self.depth > MAX_DEPTH:
            raise expected("XML", f"at most {MAX_DEPTH} levels of elements", "more", "the file is damaged")
        return super().start(tag, attrs)

    def end(self, tag: str, /) -> Element:
        self.depth -= 1
        return super().end(tag)

    def doctype(self, *_declaration: object) -> None:
        raise expected("XML", "no document type", "a DOCTYPE", "remove it")
