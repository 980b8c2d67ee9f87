"""PLY, text and binary in both byte orders: elements of numbers and lists (Turk, "The PLY Polygon File Format")."""

from __future__ import annotations

import re
import struct
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from splatgl.errors import expected
from splatgl.fileio import require_memory
from splatgl.readers.common import require_bytes

# most bytes of a header, and bytes in memory of a number
HEADER, NUMBER_BYTES = 2**16, 16
_TYPES = {
    **{"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4"},
    **{"float": "f4", "double": "f8", "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2"},
    **{"int32": "i4", "uint32": "u4", "float32": "f4", "float64": "f8"},
}


class Property(NamedTuple):
    """A property of an element: its name, its dtype, and the dtype of the lengths of lists, "" for numbers."""

    name: str
    code: str
    length: str = ""


@dataclass(frozen=True, eq=False)
class Element:
    """columns: the numbers [N] of each property; lists: of each list the numbers of all rows, and the ends [N] of rows
    among them.
    """

    columns: dict[str, np.ndarray]
    lists: dict[str, tuple[np.ndarray, np.ndarray]]


def read_ply(path: Path, last: str = "") -> dict[str, Element]:
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
    elements: dict[str, Element] = {}
    at = 0
    for stated in re.split(r"(?m)^element[ \t]+", text)[1:]:
        name, count = stated.split()[0], int(stated.split()[1])
        elements[name], at = _read_element(cells, at, count, _properties(name, stated, "" if is_text else order))
        if name == last:
            break
    return elements


def _properties(element: str, stated: str, order: str) -> list[Property]:
    """The properties of an element. order: of bytes; "" for text."""
    properties = []
    for words in re.findall(r"(?m)^property[ \t]+(.+?)\s*$", stated):
        *kinds, name = words.split()
        is_list = kinds[:1] == ["list"] and len(kinds) == 3
        codes = [_TYPES.get(kind) for kind in (kinds[1:] if is_list else kinds)]
        if None in codes or len(codes) != 1 + is_list:
            raise expected(f"element {element}", "properties of numbers or lists", repr(words)[:80])
        properties.append(Property(name, *(f"{order}{code}" for code in reversed(codes))))
    if not properties:
        raise expected(f"element {element}", "properties", "none")
    return properties


def _read_element(cells: np.ndarray, at: int, count: int, properties: Sequence[Property]) -> tuple[Element, int]:
    """An element of `count` rows from cell `at` on, and the cell behind it. cells: bytes, or numbers of text."""
    is_text = cells.dtype == np.float64
    widths = {code: 1 if is_text else np.dtype(code).itemsize for entry in properties for code in entry[1:] if code}
    require_bytes(count * sum(widths[entry.length or entry.code] for entry in properties), len(cells) - at, "numbers")
    if not count:
        empty = np.zeros(0, np.int64)
        lists = {entry.name: (empty, empty) for entry in properties if entry.length}
        return Element({entry.name: empty for entry in properties if not entry.length}, lists), at
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
    return Element(columns, lists), after


def _walk(
    cells: np.ndarray, at: int, count: int, properties: Sequence[Property], widths: dict[str, int]
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
