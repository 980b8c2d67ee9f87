"""Mosaics of Siemens: the slices of a volume side by side in one image, and the private header that describes them.

Tags: (0019,100A) number of slices; (0051,100B) acquisition matrix; (0029,1010) the CSA header of the image.
"""

from __future__ import annotations

import math
import re
import struct
from dataclasses import dataclass
from typing import Any

import numpy as np

COUNT, MATRIX, CSA = 0x0019100A, 0x0051100B, 0x00291010
SIEMENS_TAGS = (COUNT, MATRIX, CSA)
# most slices of a mosaic
MOST_TILES = 1024
# entry of a CSA header: name, multiplicity, type, code, number of items, code
_ENTRY = struct.Struct("<64si4siii")
# first bytes of version 2; version 1, of scanners before 2004, begins with the number of entries
_VERSION_2 = b"SV10"
# third number of an item, last of an entry
_MARKS = (77, 205)
# most entries of version 1
_MOST_ENTRIES = 1000
# how descriptions of version 1 differ: an item's length by its second number, or by the first less the number of items
# of the first entry, where items end at a negative length (SPM); texts padded by up to three bytes, or by one to four
_LAYOUTS = ((1, 3), (0, 3), (1, 4), (0, 4))


@dataclass(frozen=True)
class Mosaic:
    """A mosaic of (rows, columns) in all with `tiles` slices, row by row; 1 of other images. normal: of the slices in
    LPS, from each to the next, or () if the header does not state it.
    """

    size: tuple[int, int]
    tiles: int = 1
    normal: tuple[float, ...] = ()

    @property
    def side(self) -> int:
        """Slices along a side."""
        return math.isqrt(self.tiles - 1) + 1

    @property
    def plane(self) -> tuple[int, int]:
        """(rows, columns) of a slice."""
        return self.size[0] // self.side, self.size[1] // self.side

    def tile(self, number: int) -> tuple[slice, slice]:
        """Rows and columns of a slice."""
        (rows, columns), (down, right) = self.plane, divmod(number, self.side)
        return slice(down * rows, (down + 1) * rows), slice(right * columns, (right + 1) * columns)

    def places(
        self, corner: Any, orientation: Any, spacing: tuple[float, float] | None, step: float | None
    ) -> list[tuple[float, ...] | None]:
        """Positions of the slices, None if anything is unknown. corner: ImagePositionPatient, of an image of the
        mosaic's size around the middle of the first slice. spacing: (x, y) of pixels.
        """
        if corner is None or orientation is None or spacing is None or step is None:
            return [None] * self.tiles
        axes = np.array(orientation).reshape(2, 3)
        normal = np.cross(*axes)
        if self.normal and np.dot(self.normal, normal) < 0:
            normal = -normal
        margins = np.subtract(self.size, self.plane)[::-1] / 2 * spacing
        return [tuple((corner + margins @ axes + n * abs(step) * normal).tolist()) for n in range(self.tiles)]


def find_mosaic(tags: Any, rows: int, columns: int) -> tuple[Mosaic, tuple[str, ...]]:
    """The mosaic of an image, of one tile for other images, and a note on it."""
    value = _value(tags, COUNT)
    stated = int.from_bytes(value[:2], "little") if isinstance(value, bytes) else value
    counts = [stated] if isinstance(stated, int) else csa_numbers(tags, "NumberOfImagesInMosaic")
    matrix = _value(tags, MATRIX)
    size = re.match(r"0*([1-9]\d{0,3})[ps]?\*", matrix.decode("latin-1") if isinstance(matrix, bytes) else str(matrix))
    is_mosaic = "MOSAIC" in map(str, tags.get("ImageType") or ())
    if str(tags.get("NumberOfFrames") or 1) != "1":
        return Mosaic((rows, columns)), ()
    tiles = int(counts[0]) if counts else (rows // int(size[1])) ** 2 if is_mosaic and size else 0
    side = math.isqrt(max(tiles, 1) - 1) + 1
    if not 1 < tiles <= MOST_TILES or rows % side or columns % side or 0 in (rows, columns):
        note = "a mosaic is drawn as it is: the header states no number of slices that fits"
        return Mosaic((rows, columns)), (note,) * is_mosaic
    normal = csa_numbers(tags, "SliceNormalVector")
    normal = normal if len(normal) == 3 else ()
    notes = [f"a mosaic is split into {tiles} slices of {columns // side} × {rows // side}"]
    notes += ["the order of its slices is not stated: along the normal"] * (not normal)
    notes += ["the number of its slices is not stated: the last ones may be empty"] * (not counts)
    return Mosaic((rows, columns), tiles, normal), ("; ".join(notes),)


def _value(tags: Any, tag: int) -> Any:
    """The value of a private tag, None without it."""
    return getattr(tags.get(tag), "value", None)


def csa_numbers(tags: Any, name: str) -> tuple[float, ...]:
    """The numbers, at most three, of an entry of the CSA header, () without them."""
    data = _value(tags, CSA)
    data = data if isinstance(data, bytes) else b""
    if data.startswith(_VERSION_2):
        found = _read_entry(data, data.find(name.encode() + b"\0"), (1, 3), 0)
        many, texts = (0, []) if found is None else found[1:3]
    else:
        many, texts = _read_version_1(data).get(name, (0, []))
    try:
        numbers = tuple(float(text) for text in texts[: min(many, 3)])
    except ValueError:
        return ()
    return numbers if all(map(math.isfinite, numbers)) else ()


def _read_version_1(data: bytes) -> dict[str, tuple[int, list[bytes]]]:
    """Entries by name: how many items count, and all; by the layout in which every entry and item has its mark."""
    if len(data) < 8 + _ENTRY.size:
        return {}
    count, first = int.from_bytes(data[:4], "little"), _ENTRY.unpack_from(data, 8)[4]
    for layout in _LAYOUTS if 0 < count <= _MOST_ENTRIES else ():
        entries, at = dict[str, tuple[int, list[bytes]]](), 8
        while len(entries) < count and (found := _read_entry(data, at, layout, first)):
            name, many, texts, at = found
            entries[name] = many, texts
        if len(entries) == count:
            return entries
    return {}


def _read_entry(data: bytes, at: int, layout: tuple[int, int], first: int) -> tuple[str, int, list[bytes], int] | None:
    """Name, multiplicity and texts of the entry at a byte, and the byte behind it; None if it lacks a mark.

    An item of an entry: four numbers, and its text. layout: of `_LAYOUTS`; first: items of the first entry.
    """
    if at < 0 or len(data) < at + _ENTRY.size:
        return None
    title, many, _, _, count, mark = _ENTRY.unpack_from(data, at)
    at, texts, (word, padding) = at + _ENTRY.size, list[bytes](), layout
    for _ in range(count if mark in _MARKS else 0):
        numbers = struct.unpack_from("<4i", data, at) if len(data) >= at + 16 else (0, 0, 0, 0)
        if numbers[2] not in _MARKS:
            return None
        at, size = at + 16, numbers[word] - (0 if word else first)
        if size < 0:
            break
        texts.append(data[at : at + size].split(b"\0")[0].strip())
        at += size + (-size % 4 if padding == 3 else 4 - size % 4)
    return (title.split(b"\0")[0].decode("latin-1"), many, texts, at) if mark in _MARKS else None
