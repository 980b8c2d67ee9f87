"""Polygons of OBJ with its materials, of OFF and PLY, checked before they are drawn."""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np

from splatgl.errors import InputError, expected
from splatgl.fileio import decode_text, require_memory
from splatgl.readers.common import find_data_file, require_bytes

# most bytes of a header, and bytes in memory of a number
HEADER, NUMBER_BYTES = 2**16, 16
_TYPES = {
    **{"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4"},
    **{"float": "f4", "double": "f8", "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2"},
    **{"int32": "i4", "uint32": "u4", "float32": "f4", "float64": "f8"},
}


class PlyProperty(NamedTuple):
    """A property of an element: its name, its dtype, and the dtype of the lengths of lists, "" for numbers."""

    name: str
    code: str
    length: str = ""


@dataclass(frozen=True, eq=False)
class PlyElement:
    """columns: the numbers [N] of each property; lists: of each list the numbers of all rows, and the ends [N] of rows
    among them.
    """

    columns: dict[str, np.ndarray]
    lists: dict[str, tuple[np.ndarray, np.ndarray]]


def read_ply(path: Path, last: str = "") -> dict[str, PlyElement]:
    """The elements of a file by name, up to the element `last`. Raises InputError for other files and for cut ones."""
    with path.open("rb") as file:
        text = file.read(HEADER).partition(b"end_header")[0].decode("ascii", "replace")
        file.seek(len(text))
        file.readline()
        form = re.search(r"(?m)^format (ascii|binary_little_endian|binary_big_endian) ", text)
        if not text.startswith("ply") or form is None:
            raise expected("header", "a PLY header with a format", repr(text[:16]))
        order, there = ">" if "big" in form[1] else "<", path.stat().st_size - file.tell()
        is_text = form[1] == "ascii"
        require_memory(there * (NUMBER_BYTES // 2 if is_text else 1), there, "thin it out", "numbers")
        data = file.read()
    cells = np.fromstring(data, np.float64, sep=" ") if is_text else np.frombuffer(data, np.uint8)
    elements: dict[str, PlyElement] = {}
    at = 0
    for stated in re.split(r"(?m)^element[ \t]+", text)[1:]:
        name, count = stated.split()[0], int(stated.split()[1])
        elements[name], at = _read_element(cells, at, count, _properties(name, stated, "" if is_text else order))
        if name == last:
            break
    return elements


def _properties(element: str, stated: str, order: str) -> list[PlyProperty]:
    """The properties of an element. order: of bytes; "" for text."""
    properties = []
    for words in re.findall(r"(?m)^property[ \t]+(.+?)\s*$", stated):
        *kinds, name = words.split()
        is_list = kinds[:1] == ["list"] and len(kinds) == 3
        codes = [_TYPES.get(kind) for kind in (kinds[1:] if is_list else kinds)]
        if None in codes or len(codes) != 1 + is_list:
            raise expected(f"element {element}", "properties of numbers or lists", repr(words)[:80])
        properties.append(PlyProperty(name, *(f"{order}{code}" for code in reversed(codes))))
    if not properties:
        raise expected(f"element {element}", "properties", "none")
    return properties


def _read_element(cells: np.ndarray, at: int, count: int, properties: Sequence[PlyProperty]) -> tuple[PlyElement, int]:
    """An element of `count` rows from cell `at` on, and the cell behind it. cells: bytes, or numbers of text."""
    is_text = cells.dtype == np.float64
    widths = {code: 1 if is_text else np.dtype(code).itemsize for entry in properties for code in entry[1:] if code}
    require_bytes(count * sum(widths[entry.length or entry.code] for entry in properties), len(cells) - at, "numbers")
    if not count:
        empty = np.zeros(0, np.int64)
        lists = {entry.name: (empty, empty) for entry in properties if entry.length}
        return PlyElement({entry.name: empty for entry in properties if not entry.length}, lists), at
    # 1. cells of each property: as far apart as in the first row, where all rows have lists of its lengths
    starts, ends, after = _walk(cells, at, 1, properties, widths)
    size = after - at
    is_even = at + count * size <= len(cells)
    if is_even:
        rows = at + size * np.arange(count)
        starts = [rows + (first[0] - at) for first in starts]
        for entry, first, length in zip(properties, starts, ends, strict=True):
            counts = _take(cells, first - widths[entry.length], entry.length) if entry.length else length
            is_even = is_even and bool((counts == length[0]).all())
        ends = [np.full(count, length[0]) for length in ends]
        after = at + count * size
    # 2. else row by row
    if not is_even:
        starts, ends, after = _walk(cells, at, count, properties, widths)
    # 3. their numbers
    columns, lists = {}, {}
    for entry, first, lengths in zip(properties, starts, ends, strict=True):
        if not entry.length:
            columns[entry.name] = _take(cells, first, entry.code)
            continue
        stops = np.cumsum(lengths)
        within = np.arange(stops[-1]) - np.repeat(stops - lengths, lengths)
        lists[entry.name] = _take(cells, np.repeat(first, lengths) + within * widths[entry.code], entry.code), stops
    return PlyElement(columns, lists), after


def _walk(
    cells: np.ndarray, at: int, count: int, properties: Sequence[PlyProperty], widths: dict[str, int]
) -> tuple[list[np.ndarray], list[np.ndarray], int]:
    """The first cell [count] of each property of rows, its lengths [count], and the cell behind all."""
    starts, lengths = np.zeros((2, len(properties), count), np.int64)
    data = memoryview(cells.data) if cells.dtype == np.uint8 else None
    formats = {code: code[0] + np.dtype(code).char for code in widths} if data is not None else {}
    for row in range(count):
        for n, (_, code, length) in enumerate(properties):
            many = 1
            if length:
                require_bytes(at + widths[length], len(cells), "numbers")
                many = int(cells[at] if data is None else struct.unpack_from(formats[length], data, at)[0])
                at += widths[length]
            starts[n, row], lengths[n, row] = at, many
            at += many * widths[code]
            if many < 0 or at > len(cells):
                raise expected("lists", "as many numbers as they state", many, "the file is cut short or damaged")
    return list(starts), list(lengths), at


def _take(cells: np.ndarray, places: np.ndarray, code: str) -> np.ndarray:
    """The numbers [N] of a dtype whose first cells are at places [N], in native byte order."""
    dtype = np.dtype(code)
    if cells.dtype == np.float64:
        return cells[places].astype(dtype)
    if dtype.itemsize > 1:
        cells = np.lib.stride_tricks.sliding_window_view(cells, dtype.itemsize)
        return np.ascontiguousarray(cells[places]).view(dtype)[:, 0].astype(dtype.newbyteorder("="))
    return cells[places].view(dtype)


# most bytes of a list of materials, and bytes in memory of a byte of text
MOST_MATERIALS, TEXT_BYTES = 2**24, 16
# sRGB of surfaces without a colour among others that have one
DEFAULT = np.array((200, 200, 200), np.uint8)
# names of the lists of a face's corners
CORNERS = ("vertex_indices", "vertex_index")
WHOLE = 255


@dataclass(frozen=True, eq=False)
class Polygons:
    """points [N, 3]; numbers: of the points at all corners, one polygon after another; ends [P]: of polygons among
    them. colors uint8 [N, 3]: sRGB of points; corner_colors uint8: of corners. columns: numbers of points by name.
    lines: numbers of points along each.
    """

    points: np.ndarray
    numbers: np.ndarray
    ends: np.ndarray
    colors: np.ndarray | None = None
    corner_colors: np.ndarray | None = None
    columns: dict[str, np.ndarray] = field(default_factory=dict)
    lines: tuple[np.ndarray, ...] = ()

    def checked(self) -> Polygons:
        """The same. Raises InputError for corners that are no points."""
        some = np.concatenate([self.numbers, *self.lines])
        if len(some) and (some.min() < 0 or some.max() >= len(self.points)):
            this = f"corners among {len(self.points)} vertices"
            raise expected("faces", this, f"{some.min()} to {some.max()}, counted from 0", "the file is damaged")
        return self

    def fans(self) -> tuple[np.ndarray, np.ndarray]:
        """Triangles [M, 3] in numbers of corners, and their polygons [M]."""
        sizes, triangles, owners = np.diff(self.ends, prepend=0), [np.zeros((0, 3), np.int64)], [np.zeros(0, np.int64)]
        for size in np.unique(sizes[sizes > 2]).tolist():
            some = np.flatnonzero(sizes == size)
            corners = (self.ends - sizes)[some][:, None] + np.arange(size)
            first = np.broadcast_to(corners[:, :1], (len(corners), size - 2))
            triangles.append(np.stack([first, corners[:, 1:-1], corners[:, 2:]], axis=2).reshape(-1, 3))
            owners.append(np.repeat(some, size - 2))
        return np.concatenate(triangles), np.concatenate(owners)


def colors_of(columns: Sequence[np.ndarray]) -> np.ndarray:
    """sRGB uint8 [N, 3] of three columns: bytes, 16 bits, or shares up to 1."""
    rgb = np.stack(columns[:3], axis=1)
    if rgb.dtype.kind == "f":
        return np.rint(np.clip(rgb if rgb.max(initial=0.0) > 1 else rgb * WHOLE, 0, WHOLE)).astype(np.uint8)
    return (rgb >> 8 if rgb.dtype.itemsize == 2 else np.clip(rgb, 0, WHOLE)).astype(np.uint8)


def read_ply_polygons(path: Path) -> Polygons:
    """The polygons of a PLY file, with the colours of its vertices, else of its faces."""
    elements = read_ply(path)
    none = PlyElement({}, {})
    vertex, face = (elements.get(name, none) for name in ("vertex", "face"))
    if not {"x", "y", "z"} <= vertex.columns.keys():
        raise expected("vertex", "properties x, y and z", ", ".join(vertex.columns) or "none")
    points = np.stack([vertex.columns[axis] for axis in "xyz"], axis=1).astype(np.float64)
    empty = np.zeros(0, np.int64)
    numbers, ends = next((face.lists[name] for name in CORNERS if name in face.lists), (empty, empty))
    if "tristrips" in elements and not len(ends):
        raise expected("PLY", "faces", "strips", "save it with faces")
    colored = [all(name in element.columns for name in ("red", "green", "blue")) for element in (vertex, face)]
    rgb = [
        colors_of([element.columns[name] for name in ("red", "green", "blue")]) if has else None
        for element, has in zip((vertex, face), colored, strict=True)
    ]
    corner_colors = None if rgb[1] is None or colored[0] else np.repeat(rgb[1], np.diff(ends, prepend=0), axis=0)
    return Polygons(points, numbers.astype(np.int64), ends, rgb[0], corner_colors, vertex.columns).checked()


def _lines_of(path: Path) -> Iterator[list[str]]:
    """The words of each line of a file without comments and blank lines; "\\" joins a line with the next."""
    size = path.stat().st_size
    require_memory(size * TEXT_BYTES, size)
    text = decode_text(path.read_bytes()).replace("\\\r\n", " ").replace("\\\n", " ")
    for line in text.split("\n"):
        if words := (line.partition("#")[0] if "#" in line else line).split():
            yield words


def read_off(path: Path) -> Polygons:
    """The polygons of an OFF file, with the colours of its vertices or faces: whole numbers to 255, or shares of 1."""
    lines = _lines_of(path)
    head = next(lines, [""])
    kind = head.pop(0).upper() if head[0].upper().endswith("OFF") else "OFF"
    if not re.fullmatch("(ST)?C?N?OFF", kind) or "BINARY" in map(str.upper, head):
        raise expected("first line", "OFF, COFF or NOFF in text", repr(kind), "save it as PLY")
    head = head or next(lines, [])
    count, faces = (int(word) for word in head[:2])
    rows = [words for words, _ in zip(lines, range(count + faces), strict=False)]
    if len(rows) < count + faces:
        raise expected("lines", f"{count} vertices and {faces} faces", len(rows), "the file is cut short")
    # behind a place come a normal and a colour, behind corners a colour
    skipped = 6 if "N" in kind.removesuffix("OFF") else 3
    points = np.array([[float(word) for word in words[:3]] for words in rows[:count]], np.float64).reshape(-1, 3)
    corners = [[int(word) for word in words[1 : int(words[0]) + 1]] for words in rows[count:]]
    ends = np.cumsum([len(entry) for entry in corners], dtype=np.int64)
    numbers = np.array([number for entry in corners for number in entry], np.int64)
    at_points = [words[skipped:] for words in rows[:count]] if "C" in kind.removesuffix("OFF") else []
    at_faces = [words[int(words[0]) + 1 :] for words in rows[count:]]
    colors, face_colors = _off_colors(at_points), _off_colors(at_faces)
    sizes = np.diff(ends, prepend=0)
    corner_colors = None if face_colors is None or colors is not None else np.repeat(face_colors, sizes, axis=0)
    return Polygons(points, numbers, ends, colors, corner_colors).checked()


def _off_colors(rows: Sequence[Sequence[str]]) -> np.ndarray | None:
    """sRGB uint8 [N, 3] of words; None without any colour."""
    if not any(len(words) > 2 for words in rows):
        return None
    are_shares = any("." in word for words in rows for word in words[:3])
    values = np.array([words[:3] if len(words) > 2 else [np.nan] * 3 for words in rows], np.float64)
    known = np.isfinite(values).all(axis=1)
    colors = np.tile(DEFAULT, (len(rows), 1))
    colors[known] = np.rint(np.clip(values[known] * (WHOLE if are_shares else 1), 0, WHOLE))
    return colors


@dataclass(frozen=True, eq=False)
class Material:
    """The sRGB colour of a material, and its picture, uint8 [H, W, 3], by which it is multiplied."""

    color: tuple[float, float, float]
    picture: np.ndarray | None = None

    def colors(self, places: np.ndarray) -> np.ndarray:
        """Colours uint8 [N, 3] at places [N, 2] in the picture, from its lower left corner, which repeats."""
        base = np.array(self.color)
        if self.picture is None or not np.isfinite(places).all():
            return np.tile(np.rint(base * WHOLE).astype(np.uint8), (len(places), 1))
        height, width = self.picture.shape[:2]
        column, row = (places % 1 * (width, height)).astype(int).T
        return np.rint(self.picture[height - 1 - row, column] * base).astype(np.uint8)


def read_obj(path: Path) -> Polygons:
    """The polygons and lines of all objects of an OBJ file, in the colours of its vertices, else of its materials."""
    points, places, colors = list[list[float]](), list[list[float]](), list[list[float]]()
    numbers, textured, ends, used, lines = list[int](), list[int](), list[int](), list[int](), list[np.ndarray]()
    materials: dict[str, Material] = {}
    names, current = {"": 0}, 0
    for word, *words in _lines_of(path):
        if word == "v":
            values = list(map(float, words))
            points.append(values[:3])
            colors.append(values[3:6])
        elif word == "vt":
            places.append([*map(float, words[:2]), 0.0][:2])
        elif word in ("f", "l"):
            parts = [entry.split("/") for entry in words]
            named = [_index(entry[0], len(points)) for entry in parts]
            if word == "l":
                lines.append(np.array(named))
                continue
            numbers += named
            if places:
                textured += [_index(entry[1], len(places)) if len(entry) > 1 and entry[1] else -1 for entry in parts]
            else:
                textured += [-1] * len(parts)
            ends.append(len(numbers))
            used.append(current)
        elif word == "usemtl":
            current = names.setdefault(" ".join(words), len(names))
        elif word == "mtllib":
            # one name with blanks, or several names
            for name in (" ".join(words), *words):
                materials |= _read_materials(path, name)
    corners, stops = np.array(numbers, np.int64), np.array(ends, np.int64)
    has_colors = bool(colors) and all(len(words) == 3 for words in colors)
    rgb = colors_of(list(np.array(colors, np.float64).T)) if has_colors else None
    corner_colors = None
    if materials and rgb is None:
        at, owners = np.array(textured), np.repeat(used, np.diff(stops, prepend=0))
        table = np.array([*places, [np.nan] * 2], np.float64)
        if len(at) and at.max() >= len(places):
            raise expected("faces", f"places in pictures among {len(places)}", at.max(), "the file is damaged")
        corner_colors = np.tile(DEFAULT, (len(corners), 1))
        for name, number in names.items():
            some = owners == number
            if name in materials and some.any():
                corner_colors[some] = materials[name].colors(table[at[some]])
    vertices = np.array(points, np.float64).reshape(-1, 3)
    return Polygons(vertices, corners, stops, rgb, corner_colors, lines=tuple(lines)).checked()


def _index(word: str, count: int) -> int:
    """A number from 0 on, out of one from 1 on, or of one below 0 that counts back from the last of `count`."""
    number = int(word)
    if number == 0 or number < -count:
        raise expected("faces", f"numbers from 1 to {count}, or from -1 back", number, "the file is damaged")
    return number - 1 if number > 0 else count + number


def _read_materials(path: Path, name: str) -> dict[str, Material]:
    """The materials of a library beside an OBJ file, by name; none if it is not there."""
    try:
        library = find_data_file(path, name, anywhere=False)
    except InputError:
        return {}
    materials: dict[str, Material] = {}
    color, picture, current = (0.8, 0.8, 0.8), None, ""
    for word, *words in _lines_of(library) if library.stat().st_size <= MOST_MATERIALS else ():
        if word == "newmtl":
            current, color, picture = " ".join(words), (0.8, 0.8, 0.8), None
        elif word == "Kd" and len(words) >= 3:
            red, green, blue = (min(max(float(part), 0.0), 1.0) for part in words[:3])
            color = (red, green, blue)
        elif word == "map_Kd" and words:
            picture = _read_picture(path, words[-1])
        materials[current] = Material(color, picture)
    return materials


def _read_picture(path: Path, name: str) -> np.ndarray | None:
    """A picture uint8 [H, W, 3] beside a file; None without one that can be read."""
    from PIL import Image

    try:
        with Image.open(find_data_file(path, name, anywhere=False)) as picture:
            return np.asarray(picture.convert("RGB"))
    except (InputError, OSError, ValueError, Image.DecompressionBombError):
        return None
