"""Legacy VTK files (.vtk) with structured points or a rectilinear grid, and the selection of arrays for all VTK files.

Format: "VTK File Formats", docs.vtk.org; x runs fastest.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO
from urllib.parse import unquote

import numpy as np

from splatgl.data.affine import Coordinate, make_lattice, volume_on_grid
from splatgl.data.volume import Volume, triple
from splatgl.errors import MissingOption, expected, list_names
from splatgl.fileio import byte_count, decode_text
from splatgl.readers.channels import COLOR_NOTE, VECTOR_NOTE, is_color_rule, is_vector_rule, split_components
from splatgl.readers.common import (
    Shape,
    array_fields,
    convert_words,
    grid_shape,
    map_array,
    read_numbers,
    require_bytes,
)
from splatgl.readers.options import LoadOptions

# VTK's marks of points and cells, which are no values; bits of the first for a hidden point and a hidden cell
MARKS, HIDDEN_POINT, HIDDEN_CELL = ("vtkGhostType", "vtkGhostLevels", "vtkValidPointMask"), 2, 32


@dataclass(frozen=True)
class PointArray:
    """An array of a VTK grid; read() loads it as [D, H, W, components]. active: whether the file names it as the one
    that is drawn.
    """

    name: str
    components: int
    is_vectors: bool
    read: Callable[[], np.ndarray]
    dtype: np.dtype | None = None
    active: bool = False


@dataclass(frozen=True)
class Selection:
    """Selected arrays of a grid: samples [D, H, W] of points or of cells; colours uint8 and vectors float32
    [D, H, W, 3], or None. about: further fields of `Volume`, notes and hints among them.

    Speeds, and arrays that are named as a simulation's, get the hints of a field.
    """

    of_cells: bool
    samples: np.ndarray
    vectors: np.ndarray | None
    color: np.ndarray | None
    about: dict[str, Any]

    def volume(self, matrix: np.ndarray, origin: np.ndarray, shape: Sequence[int], what: str) -> Volume:
        """The volume on a grid of points [shape] (z, y, x), of which the first is at `origin`; the centres of cells are
        half a step farther. matrix: world-from-index; what: the name of the grid in messages.
        """
        middle = np.where(np.array(shape[::-1]) > 1, 0.5, 0.0) * self.of_cells
        arrays = {"vectors": self.vectors, "color": self.color}
        return volume_on_grid(self.samples, matrix, origin + matrix @ middle, what, **arrays, **self.about)

    def rectilinear(self, places: Sequence[np.ndarray], even: bool) -> Volume:
        """The volume on a rectilinear grid, resampled if it is uneven. places: coordinates of points along x, y, z.

        even: whether to take the steps for even.
        """
        centres = [(axis[1:] + axis[:-1]) / 2 if self.of_cells and len(axis) > 1 else axis for axis in places]
        axes = [Coordinate(name, len(axis), axis) for name, axis in zip("zyx", centres[::-1], strict=True)]
        grid = make_lattice(axes, even=even)
        vectors = None if self.vectors is None else np.asarray(grid.resampled(self.vectors))
        return grid.volume(self.samples, "coordinates", vectors=vectors, **self.about)


def select_arrays(points: Sequence[PointArray], cells: Sequence[PointArray], options: LoadOptions) -> Selection:
    """Selects among the arrays of points and of cells: those of cells if there are no others, or if one has that name.

    Without options the active array or the first with one component, else the length of the first vectors, becomes the
    samples, with NaN for hidden points or cells. `array` names another one; "scalars", "vectors" and "speed" also stand
    for the first of their kind. `channel` picks a component. Raises InputError naming the arrays if the choice is not
    clear.
    """
    marks = [[array for array in arrays if array.name == MARKS[0]] for arrays in (points, cells)]
    points, cells = ([array for array in arrays if array.name not in MARKS] for arrays in (points, cells))
    of_points, of_cells = ([array.name for array in arrays] for arrays in (points, cells))
    in_cells = not points or (options.array not in (None, *of_points) and options.array in of_cells)
    arrays = cells if in_cells else points
    if not arrays:
        raise expected("arrays", "point or cell data", "none")
    vectors = next((array for array in arrays if array.is_vectors), None)
    chosen = _select_array(arrays, vectors, options)
    is_field = chosen.is_vectors or is_vector_rule(chosen.dtype, chosen.components)
    if is_field:
        vectors = chosen
    color = None
    field = None if vectors is None else np.asarray(vectors.read(), dtype=np.float32)
    if is_field and options.channel is None and field is not None:
        samples = np.stack([np.linalg.norm(plane, axis=-1) for plane in field])
    elif options.channel is None and chosen.dtype is not None and is_color_rule(chosen.dtype, chosen.components):
        samples, color, _ = split_components(chosen.read(), is_color=True)
    else:
        samples = _component(chosen, options)
    # arrays of points and of cells are listed together
    every = [*arrays, *(points if in_cells else cells)]
    others = [array.name for array in every if array.name != chosen.name]
    notes = (COLOR_NOTE,) * (color is not None) + (VECTOR_NOTE,) * (is_field > chosen.is_vectors)
    if options.array is None and others:
        notes += (f"array {chosen.name} of {len(every)} is rendered; --array picks another: {list_names(others)}",)
    for mark in marks[in_cells]:
        hidden = (mark.read()[..., 0] & (HIDDEN_CELL if in_cells else HIDDEN_POINT)) != 0
        if hidden.any():
            samples = np.where(hidden, np.nan, samples).astype(np.float32)
            notes += (f"{hidden.sum()} {'cells' if in_cells else 'points'} that the file hides are left out",)
    about = {"notes": notes, **array_fields(chosen.name, samples.dtype, "", "mm", chosen.is_vectors)}
    return Selection(in_cells, samples, field, color, about)


def _select_array(arrays: Sequence[PointArray], vectors: PointArray | None, options: LoadOptions) -> PointArray:
    single = [array for array in arrays if array.components == 1]
    scalars = next((array for array in single if array.active), next(iter(single), None))
    if options.array is None:
        return scalars or vectors or arrays[0]
    named = next((array for array in arrays if array.name == options.array), None)
    chosen = named or {"scalars": scalars, "vectors": vectors, "speed": vectors}.get(str(options.array))
    if chosen is None:
        listed = ", ".join(f"{array.name} ({array.components})" for array in arrays)
        raise expected("array", f"one of {listed}", repr(options.array))
    return chosen


def _component(chosen: PointArray, options: LoadOptions) -> np.ndarray:
    count = chosen.components
    number = options.channel_number(count)
    if number is None and count > 1:
        fix = f"pick one with channel=0 … channel={count - 1}"
        error = expected("array", "one number per voxel", f"{count} in {chosen.name!r}", fix)
        raise MissingOption(str(error), "channel", [(f"0 … {count - 1}", f"numbers of each voxel in {chosen.name!r}")])
    return chosen.read()[..., number or 0]


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
_COMPONENTS = {"VECTORS": 3, "NORMALS": 3, "TENSORS": 9, "GLOBAL_IDS": 1, "PEDIGREE_IDS": 1}

Words = list[str]


@dataclass
class _Parser:
    """Parser state: the position in the file, and the grid and arrays read so far."""

    path: Path
    file: BinaryIO
    binary: bool
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
        if count != self.count or not (self.of_points or count):
            return
        shape = self.shape() if self.of_points else count_cells(self.shape())
        if count == math.prod(shape):
            kind = _TYPES.get(type_name.lower())
            dtype = None if kind is None else np.dtype(kind)
            array = PointArray(unquote(name), components, is_vectors, lambda: read().reshape(*shape, components), dtype)
            (self.points if self.of_points else self.cells).append(array)
        elif self.of_points:
            raise expected("DIMENSIONS", "one line before the data", "another line after it")


def read(path: Path, options: LoadOptions) -> Volume:
    """The volume of a legacy VTK file; `array` names an array, the first vectors go to `Volume.vectors`."""
    with path.open("rb") as file:
        parser = _Parser(path, file, _is_binary(file))
        while words := parser.words():
            _section(parser, words)
    choice, grid = select_arrays(parser.points, parser.cells, options), parser.grid
    if parser.coordinates:
        if sorted(parser.coordinates) != list("XYZ"):
            raise expected("RECTILINEAR_GRID", "X_, Y_ and Z_COORDINATES", ", ".join(parser.coordinates))
        places = [np.asarray(parser.coordinates[axis](), np.float64) for axis in "XYZ"]
        return choice.rectilinear(places, even=options.spacing is not None)
    steps = grid.get("SPACING", grid.get("ASPECT_RATIO", ["1", "1", "1"]))
    spacing = triple(convert_words(steps, float, "SPACING"), "SPACING")
    origin = triple(convert_words(grid.get("ORIGIN", ["0", "0", "0"]), float, "ORIGIN"), "ORIGIN")
    return choice.volume(np.diag(spacing), np.array(origin), parser.shape(), "SPACING")


def _is_binary(file: BinaryIO) -> bool:
    first = file.readline(_LINE_LIMIT)
    if not first.lower().startswith(b"# vtk datafile"):
        raise expected("first line", "'# vtk DataFile Version …'", repr(first[:16]), "is this a legacy VTK file?")
    file.readline(_TITLE_LIMIT)
    coding = file.readline(_LINE_LIMIT).strip().upper()
    if coding not in (b"ASCII", b"BINARY"):
        raise expected("third line", "ASCII or BINARY", repr(coding[:16]))
    return coding == b"BINARY"


def _section(parser: _Parser, words: Words) -> None:
    """Parses one keyword and its data."""
    keyword, rest = words[0].upper(), words[1:]
    if keyword == "DATASET":
        if rest[:1] not in (["STRUCTURED_POINTS"], ["RECTILINEAR_GRID"]):
            fix = "resample it to an image first"
            raise expected("DATASET", "STRUCTURED_POINTS or RECTILINEAR_GRID", " ".join(rest), fix)
    elif keyword in ("DIMENSIONS", "SPACING", "ASPECT_RATIO", "ORIGIN"):
        parser.grid[keyword] = rest
    elif keyword in ("X_COORDINATES", "Y_COORDINATES", "Z_COORDINATES"):
        count, along = _whole_numbers(rest[:1], keyword)[0], parser.shape()["ZYX".index(keyword[0])]
        if count != along or len(rest) < 2:
            raise expected(keyword, f"{along} numbers, as DIMENSIONS say, and their type", " ".join(rest))
        parser.coordinates[keyword[0]] = parser.values(count, rest[1])
    elif keyword in ("POINT_DATA", "CELL_DATA"):
        parser.count, parser.of_points = _whole_numbers(rest[:1], keyword)[0], keyword == "POINT_DATA"
        points = math.prod(parser.shape())
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
    elif keyword == "TEXTURE_COORDINATES" and len(rest) >= 3:
        parser.add(rest[0], _whole_numbers(rest[1:2], keyword)[0], rest[2], False, parser.count)
    elif keyword == "COLOR_SCALARS" and len(rest) >= 2:
        parser.add(rest[0], _whole_numbers(rest[1:2], keyword)[0], _COLOR, False, parser.count)
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


def count_cells(points: Shape) -> Shape:
    """The numbers of cells between points; a flat grid has one layer."""
    d, h, w = (max(count - 1, 1) for count in points)
    return d, h, w
