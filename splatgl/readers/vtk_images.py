"""VTK's images and rectilinear grids, in XML (.vti, .vtr) and in legacy files (.vtk); others are read by VTK itself.

Samples belong to points or to cells, which are one fewer along each axis and half a step further. A point's index
counts from index 0, not from the extent's lower end, Direction is listed row by row, and x runs fastest. Rectilinear
grids with uneven steps are resampled.

Format: "VTK XML file formats" and "VTK File Formats", docs.vtk.org.
"""

from __future__ import annotations

import io
import math
import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import BinaryIO
from urllib.parse import unquote
from xml.etree.ElementTree import Element

import numpy as np

from splatgl.data.times import Times
from splatgl.data.volume import Volume, triple
from splatgl.errors import expected
from splatgl.fileio import byte_count, decode_text, require_memory
from splatgl.readers.channels import ChannelSet
from splatgl.readers.common import (
    Shape,
    convert_words,
    decoder_errors,
    find_data_file,
    grid_shape,
    map_array,
    read_numbers,
    read_text,
    require_bytes,
    require_plausible,
)
from splatgl.readers.options import SURFACE, VTK_DATA, LoadOptions, converter
from splatgl.readers.vtk_files import NUMBERED, PointArray, count_cells, select_arrays, select_entry
from splatgl.readers.vtk_files import read as read_elsewhere
from splatgl.readers.vtk_xml import XML_TYPES, ByteSource, VtkXml, parse_numbers, parse_vtk

_ZLIB = "vtkZLibDataCompressor"


def read(path: Path, options: LoadOptions) -> Volume:
    """The volume of a .vti or .vtr file; `array` names an array, the first vectors go to `Volume.vectors`. VTK reads
    files of several pieces, and those of other compressors.
    """
    file = parse_vtk(path, ("ImageData", "RectilinearGrid"))
    owner, nodes = file.root.find(file.kind), file.root.findall(f"{file.kind}/Piece")
    if owner is None or not nodes:
        raise expected("Piece", "one or more", "none")
    if len(nodes) > 1 or file.compressor not in ("", _ZLIB):
        return read_elsewhere(path, options)
    # 1. lowest and highest index of points along x, y, z
    text = (nodes[0], "Extent") if nodes[0].get("Extent") else (owner, "WholeExtent")
    extent = np.array(parse_numbers(*text, "", 6)).astype(np.int64)
    low, shape = extent[::2], grid_shape((extent[1::2] - extent[::2] + 1).tolist(), "Extent")
    # 2. arrays of points and of cells
    owners = ((nodes[0].find("PointData"), shape), (nodes[0].find("CellData"), count_cells(shape)))
    points, cells = ([] if node is None else _read_arrays(file, node, size) for node, size in owners)
    choice = select_arrays(points, cells, options)
    if file.kind == "RectilinearGrid":
        axes = nodes[0].findall("Coordinates/DataArray")
        if len(axes) != 3:
            raise expected("Coordinates", "three arrays", len(axes))
        places = [_read_array(file, axis, (1, 1, size)).read() for axis, size in zip(axes, shape[::-1], strict=True)]
        return choice.rectilinear([place.ravel() for place in places], even=options.spacing is not None)
    direction = np.array(parse_numbers(owner, "Direction", "1 0 0 0 1 0 0 0 1", 9)).reshape(3, 3)
    matrix = direction * parse_numbers(owner, "Spacing", "1 1 1", 3)
    origin = np.array(parse_numbers(owner, "Origin", "0 0 0", 3)) + matrix @ low
    return choice.volume(matrix, origin, shape, "Direction and Spacing")


# --- arrays in XML ----------------------------------------------------------------------------------------------------


def _read_arrays(file: VtkXml, owner: Element, shape: Shape) -> list[PointArray]:
    """The arrays [D, H, W, components] below an element, which are read later."""
    active = owner.get("Scalars")
    arrays = [_read_array(file, node, shape) for node in owner.findall("DataArray")]
    return [replace(array, active=array.name == active) for array in arrays]


def _read_array(file: VtkXml, node: Element, shape: Shape) -> PointArray:
    """The array [D, H, W, components] of an element DataArray, which is read later."""
    name, type_name = node.get("Name", "unnamed"), node.get("type", "none")
    components, is_bits = int(parse_numbers(node, "NumberOfComponents", "1", 1)[0]), type_name == "Bit"
    if (type_name not in XML_TYPES and not is_bits) or components < 1:
        raise expected(f"DataArray {name}", "a number type and components", f"{type_name}, {components}")
    dtype = np.dtype("u1" if is_bits else XML_TYPES[type_name]).newbyteorder(file.header.byteorder)
    full, source = (*shape, components), file.source(node)
    if source is None:
        text = (node.text or "").encode("ascii", "replace")
        read: Callable[[], np.ndarray] = partial(_parse_ascii, text, dtype, full)
    else:
        # bits are packed, but for numbers in text
        stored = (-(-math.prod(full) // 8),) if is_bits else full
        read = partial(_decode, source, file, dtype, stored)
    if is_bits:
        read, dtype = partial(_read_bits, read, full), np.dtype(bool)
    return PointArray(name, components, components == 3 and dtype.kind == "f", read, dtype)


def _parse_ascii(text: bytes, dtype: np.dtype, shape: Sequence[int]) -> np.ndarray:
    return read_text(io.BytesIO(text), dtype, shape, len(text))


def _decode(source: ByteSource, file: VtkXml, dtype: np.dtype, shape: Sequence[int]) -> np.ndarray:
    """The array [shape] in `source`; uncompressed raw bytes of a file stay mapped."""
    needed = byte_count(shape, dtype)
    data = _inflate_blocks(source, file.header, needed) if file.compressor else source.block(file.header, needed)
    return data.view(dtype).reshape(shape)


def _inflate_blocks(source: ByteSource, number: np.dtype, needed: int) -> np.ndarray:
    """Inflates blocks; header: number of blocks, bytes of each, of the last, compressed bytes of each."""
    # 1. the header; its first number states its length
    blocks = int(source.take(number.itemsize).view(number)[0])
    length = (3 + blocks) * number.itemsize
    header = [int(count) for count in source.take(length).view(number)]
    full, last, packed = header[1], header[2], header[3:]
    sizes = [full] * blocks
    if blocks and last:
        sizes[-1] = last
    if needed != sum(sizes):
        raise expected("data", f"{needed} bytes, as the extent says", f"{sum(sizes)} by its header")
    require_plausible(needed, sum(packed))
    require_memory(needed, sum(packed))
    # 2. the blocks, one behind the other
    data, out, start = source.at(source.stored(length)).take(sum(packed)).tobytes(), bytearray(), 0
    for size, stored in zip(sizes, packed, strict=True):
        with decoder_errors("compressed data"):
            block = zlib.decompressobj().decompress(data[start : start + stored], size + 1)
        if len(block) != size:
            raise expected("inflated block", f"{size} bytes", "more" if len(block) > size else len(block))
        out += block
        start += stored
    return np.frombuffer(out, np.uint8)


def _read_bits(read: Callable[[], np.ndarray], shape: Sequence[int]) -> np.ndarray:
    """An array of bits [shape], of numbers in text or of packed bytes, whose highest bit is the first."""
    stored = read()
    return (
        stored.astype(bool)
        if stored.ndim > 1
        else np.unpackbits(stored, count=math.prod(shape)).view(bool).reshape(shape)
    )


# --- legacy files -----------------------------------------------------------------------------------------------------

# name for the bytes of COLOR_SCALARS, which are from 0 to 1 in text
_COLOR = "color_scalars"
# big-endian numpy codes; long has eight bytes, as 64-bit Unix writes it, and ids have four, as VTK writes them
_TYPES = {
    **{_COLOR: "u1", "unsigned_char": "u1", "unsigned_short": ">u2", "unsigned_int": ">u4", "unsigned_long": ">u8"},
    **{"char": "i1", "signed_char": "i1", "short": ">i2", "int": ">i4", "long": ">i8"},
    **{"vtktypeint64": ">i8", "vtktypeuint64": ">u8", "vtkidtype": ">i4", "float": ">f4", "double": ">f8"},
}

# longest header line, and longest title, in bytes; a longer one means another kind of file
_LINE_LIMIT, _TITLE_LIMIT = 4096, 2**20
# words before the numbers of cells
_CELLS = ("CELLS", "CELL_TYPES", "VERTICES", "LINES", "POLYGONS", "TRIANGLE_STRIPS")
_COMPONENTS = {"VECTORS": 3, "NORMALS": 3, "TENSORS": 9, "GLOBAL_IDS": 1, "PEDIGREE_IDS": 1}

Words = list[str]


@dataclass
class _Parser:
    """Parser state: the position in the file, and the grid and arrays read so far."""

    path: Path
    file: BinaryIO
    binary: bool
    kind: str = ""
    grid: dict[str, Words] = field(default_factory=dict)
    coordinates: dict[str, Callable[[], np.ndarray]] = field(default_factory=dict)
    count: int = 0
    of_points: bool = False
    points: list[PointArray] = field(default_factory=list)
    cells: list[PointArray] = field(default_factory=list)

    def words(self) -> Words:
        """The words of the next line that is not blank; [] at the end of the file."""
        while line := self.file.readline(_LINE_LIMIT):
            if line.strip():
                return decode_text(line).split()
        return []

    def values(self, count: int, type_name: str) -> Callable[[], np.ndarray]:
        """Skips `count` numbers; returns a function that reads them."""
        is_bits = type_name.lower() == "bit"
        code = "u1" if is_bits else _TYPES.get(type_name.lower())
        if code is None:
            raise expected("type", "a VTK number type such as float", type_name)
        if count < 0:
            # a negative count would loop forever
            raise expected("entries", "zero or more", count, "the header is damaged")
        dtype, start = np.dtype(code), self.file.tell()
        there = self.path.stat().st_size - start
        if not self.binary:
            is_color = type_name == _COLOR
            numbers = read_numbers(self.file, count, np.dtype("f4") if is_color else dtype, there)
            if is_bits:
                return lambda: numbers.astype(bool)
            return lambda: np.rint(np.clip(numbers, 0, 1) * 255).astype(np.uint8) if is_color else numbers
        entries = -(-count // 8) if is_bits else count
        size = byte_count((entries,), dtype)
        require_bytes(size, there)
        self.file.seek(start + size)
        if is_bits:
            # the highest bit of a byte is the first
            return lambda: np.unpackbits(map_array(self.path, start, dtype, (size,)), count=count).view(bool)
        return lambda: map_array(self.path, start, dtype, (count,))

    def skip_texts(self, count: int) -> None:
        """Skips an array of texts: a line each, or in binary files each behind its length."""
        require_bytes(count, self.path.stat().st_size - self.file.tell())
        for _ in range(count):
            if not self.binary:
                self.file.readline()
                continue
            # the first two bits tell the bytes of the length: 8, 4, 2 or 1
            first = self.file.read(1)
            width = 8 >> (first[0] >> 6) if first else 1
            length = int.from_bytes(bytes([first[0] & 63]) + self.file.read(width - 1), "big") if first else 0
            require_bytes(length, self.path.stat().st_size - self.file.tell())
            self.file.seek(length, 1)

    def shape(self) -> Shape:
        return grid_shape(_whole_numbers(self.grid.get("DIMENSIONS", []), "DIMENSIONS"), "DIMENSIONS")

    def add(self, name: str, components: int, type_name: str, is_vectors: bool, count: int) -> None:
        """Skips an array, and adds it if it has one entry per point or per cell."""
        if components < 1 or count < 0:
            raise expected(name, "one or more components and entries", f"{components}, {count}")
        if type_name.lower() == "string":
            self.skip_texts(count * components)
            return
        read = self.values(count * components, type_name)
        if count != self.count or not (self.of_points or count) or "DIMENSIONS" not in self.grid:
            return
        shape = self.shape() if self.of_points else count_cells(self.shape())
        if count == math.prod(shape):
            kind = _TYPES.get(type_name.lower())
            dtype = None if kind is None else np.dtype(kind)
            array = PointArray(unquote(name), components, is_vectors, lambda: read().reshape(*shape, components), dtype)
            (self.points if self.of_points else self.cells).append(array)
        elif self.of_points:
            raise expected("DIMENSIONS", "one line before the data", "another line after it")


def read_legacy(path: Path, options: LoadOptions) -> Volume:
    """The volume of a legacy VTK file; `array` names an array, the first vectors go to `Volume.vectors`. VTK reads
    grids of cells.
    """
    parser = parse_legacy(path)
    grid = parser.grid
    if parser.kind == "POLYDATA":
        raise expected("DATASET", "a grid", parser.kind, SURFACE)
    if parser.kind not in ("STRUCTURED_POINTS", "RECTILINEAR_GRID"):
        return read_elsewhere(path, options)
    choice = select_arrays(parser.points, parser.cells, options)
    if parser.coordinates:
        if sorted(parser.coordinates) != list("XYZ"):
            raise expected("RECTILINEAR_GRID", "X_, Y_ and Z_COORDINATES", ", ".join(parser.coordinates))
        places = [np.asarray(parser.coordinates[axis](), np.float64) for axis in "XYZ"]
        return choice.rectilinear(places, even=options.spacing is not None)
    steps = grid.get("SPACING", grid.get("ASPECT_RATIO", ["1", "1", "1"]))
    spacing = triple(convert_words(steps, float, "SPACING"), "SPACING")
    origin = triple(convert_words(grid.get("ORIGIN", ["0", "0", "0"]), float, "ORIGIN"), "ORIGIN")
    return choice.volume(np.diag(spacing), np.array(origin), parser.shape(), "SPACING")


def parse_legacy(path: Path) -> _Parser:
    """Parses a legacy file of any kind to its end. Raises InputError if it holds less than it states."""
    with path.open("rb") as file:
        first = file.readline(_LINE_LIMIT)
        if not first.lower().startswith(b"# vtk datafile"):
            this = "'# vtk DataFile Version …'"
            raise expected("first line", this, repr(first[:16]), "is this a legacy VTK file?")
        file.readline(_TITLE_LIMIT)
        coding = file.readline(_LINE_LIMIT).strip().upper()
        if coding not in (b"ASCII", b"BINARY"):
            raise expected("third line", "ASCII or BINARY", repr(coding[:16]))
        parser = _Parser(path, file, coding == b"BINARY")
        while words := parser.words():
            _section(parser, words[0].upper(), words[1:])
    return parser


def _section(parser: _Parser, keyword: str, rest: Words) -> None:
    """Parses one keyword and its data."""
    if keyword == "DATASET":
        parser.kind = " ".join(rest).upper()
    elif keyword in ("DIMENSIONS", "SPACING", "ASPECT_RATIO", "ORIGIN"):
        parser.grid[keyword] = rest
    elif keyword in ("X_COORDINATES", "Y_COORDINATES", "Z_COORDINATES"):
        count, along = _whole_numbers(rest[:1], keyword)[0], parser.shape()["ZYX".index(keyword[0])]
        if count != along or len(rest) < 2:
            raise expected(keyword, f"{along} numbers, as DIMENSIONS say, and their type", " ".join(rest))
        parser.coordinates[keyword[0]] = parser.values(count, rest[1])
    elif keyword == "POINTS" and len(rest) > 1:
        parser.values(3 * _whole_numbers(rest[:1], keyword)[0], rest[1])
    elif keyword in _CELLS:
        numbers = _whole_numbers(rest[:2], keyword)
        # since version 5 of two arrays with names and types
        start, parts = parser.file.tell(), [parser.words()]
        if parts[0][:1] == ["OFFSETS"]:
            parser.values(numbers[0], parts[0][-1])
            parser.values(numbers[-1], parser.words()[-1:][0])
        else:
            parser.file.seek(start)
            parser.values(numbers[-1], "int")
    elif keyword in ("POINT_DATA", "CELL_DATA"):
        parser.count, parser.of_points = _whole_numbers(rest[:1], keyword)[0], keyword == "POINT_DATA"
        points = math.prod(parser.shape()) if "DIMENSIONS" in parser.grid else parser.count
        if parser.of_points and parser.count != points:
            raise expected("POINT_DATA", f"{points} points, as DIMENSIONS say", parser.count)
    elif keyword == "METADATA":
        _skip_metadata(parser.file)
    elif keyword == "FIELD":
        _fields(parser, rest)
    elif keyword == "LOOKUP_TABLE":
        parser.values(4 * _whole_numbers(rest[1:2], "LOOKUP_TABLE")[0], "unsigned_char" if parser.binary else "float")
    else:
        _attribute(parser, keyword, rest)


def _attribute(parser: _Parser, keyword: str, rest: Words) -> None:
    if keyword == "SCALARS" and len(rest) >= 2:
        components = _whole_numbers(rest[2:3], "SCALARS")[0] if len(rest) > 2 else 1
        # the line 'LOOKUP_TABLE name', which some writers leave out
        start = parser.file.tell()
        if not parser.file.readline(_LINE_LIMIT).upper().startswith(b"LOOKUP_TABLE"):
            parser.file.seek(start)
        parser.add(rest[0], components, rest[1], False, parser.count)
    elif keyword in _COMPONENTS and len(rest) >= 2:
        parser.add(rest[0], _COMPONENTS[keyword], rest[1], keyword == "VECTORS", parser.count)
    elif keyword in ("TEXTURE_COORDINATES", "COLOR_SCALARS") and len(rest) >= 2:
        parser.add(rest[0], _whole_numbers(rest[1:2], keyword)[0], (rest[2:] or [_COLOR])[0], False, parser.count)
    else:
        raise expected("section", "a VTK keyword such as SCALARS", repr(" ".join([keyword, *rest])[:40]))


def _fields(parser: _Parser, rest: Words) -> None:
    for _ in range(_whole_numbers(rest[1:2], "FIELD")[0]):
        words = parser.words()
        while words[:1] == ["METADATA"]:
            _skip_metadata(parser.file)
            words = parser.words()
        if len(words) != 4:
            raise expected("FIELD", "a line 'name components tuples type'", repr(" ".join(words)[:40]))
        components, count = _whole_numbers(words[1:3], "FIELD")
        is_vectors = components == 3 and words[3] in ("float", "double")
        parser.add(words[0], components, words[3], is_vectors, count)


def _skip_metadata(file: BinaryIO) -> None:
    """Skips a METADATA block, which ends at a blank line."""
    while file.readline(_LINE_LIMIT).strip():
        pass


def _whole_numbers(words: Words, what: str) -> list[int]:
    numbers = convert_words(words, int, what)
    if not numbers:
        raise expected(what, "whole numbers", "none", "the header is incomplete")
    return numbers


# --- time series ------------------------------------------------------------------------------------------------------


def read_series(path: Path, options: LoadOptions) -> Volume:
    """The volume of one time step of a .pvd file. `time`, or else `array`, is the number of the step; an array in it
    follows a slash: 3/density.
    """
    nodes = parse_vtk(path, ("Collection",)).root.findall("Collection/DataSet")
    steps = sorted((parse_numbers(node, "timestep", "0", 1)[0], node.get("file", "")) for node in nodes)
    if not steps or len({time for time, _ in steps}) < len(steps):
        raise expected("DataSet", "one file a time step", "several" if steps else "none", "save the parts as one .pvti")
    by_time = options.time is not None or not NUMBERED.match(str(options.array))
    if by_time:
        name, array = steps[min(options.point, len(steps) - 1)][1], options.array
    else:
        name, array = select_entry([(f"{time:.10g}", name) for time, name in steps], options, "time steps")
    moments = Times.of(time for time, _ in steps) if by_time else None
    times = ChannelSet(times=len(steps) if by_time else 1, moments=moments)
    inner = replace(options, array=array, time=None)
    return times.volume(replace(options, channel=None), lambda _: _read_step(path, name, inner))


def _read_step(path: Path, name: str, options: LoadOptions) -> Volume:
    own = {".vti": read, ".vtr": read, ".vtk": read_legacy}
    suffix = Path(name).suffix.lower()
    known = (*own, *VTK_DATA, ".vtkhdf")
    if suffix not in known:
        raise expected(name, f"a file of {', '.join(known)}", repr(suffix), converter(name))
    return own.get(suffix, read_elsewhere)(find_data_file(path, name, options.anywhere), options)
