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
# first bytes of version 2; version 1 of scanners before 2004 is not read
_VERSION_2 = b"SV10"


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
    """The numbers, at most three, of an entry of the CSA header (version 2), () without them.

    An item of an entry: four lengths, the second is its own, and text padded to four bytes.
    """
    data = _value(tags, CSA)
    data = data if isinstance(data, bytes) and data.startswith(_VERSION_2) else b""
    at = data.find(name.encode() + b"\0")
    if at < 0 or len(data) < at + _ENTRY.size:
        return ()
    _, many, _, _, count, _ = _ENTRY.unpack_from(data, at)
    at, numbers = at + _ENTRY.size, list[float]()
    for _ in range(min(many, count, 3)):
        size = max(int.from_bytes(data[at + 4 : at + 8], "little", signed=True), 0)
        try:
            numbers.append(float(data[at + 16 : at + 16 + size].strip(b"\0 ")))
        except ValueError:
            return ()
        at += 16 + -(-size // 4) * 4
    return tuple(numbers) if all(map(math.isfinite, numbers)) else ()
