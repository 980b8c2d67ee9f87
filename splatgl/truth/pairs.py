"""(Splat, pixel) pairs: the splats that overlap pixels of a window of the image, and their values.

No loop over splats: boxes are unrolled into rows, rows into pixels.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from splatgl.errors import expected
from splatgl.splat.camera import Camera
from splatgl.splat.culling import Window
from splatgl.splat.footprint import ROWS, Quads, Splat, on_quads, table_quad
from splatgl.splat.grid import Grid
from splatgl.splat.line_integral import Integral, row1
from splatgl.splat.view import View
from splatgl.truth.extent import Boxes

# pairs per chunk: temporaries of 2 MB stay in the cache
PAIRS = 1 << 18
# rows with one formula for every grid; the others are for cubic voxels
QUAD_ROWS = {"row4": "ray", "row5": "grid"}


@dataclass(frozen=True, eq=False)
class Values:
    """Pairs by splat, in drawing order. splat int [P], pixel int [P] (row-major in the window), integral [P]."""

    splat: np.ndarray
    pixel: np.ndarray
    integral: Integral


@dataclass(frozen=True, eq=False)
class Row:
    """One row of Table 1 for voxels [3, N]."""

    view: View
    name: str
    voxel: np.ndarray
    quads: Quads | None

    @classmethod
    def of(cls, view: View, name: str, voxel: np.ndarray, grid: Grid) -> Row:
        """InputError for a row that does not exist, or not for this grid."""
        if name not in ROWS:
            raise expected("row", " or ".join(ROWS), repr(name))
        if name in ("row2", "row3") and not grid.cubic:
            raise expected("row", "row1, row4 or row5 for voxels that are not cubes", repr(name))
        # in orthographic projection, all rows are equal
        own = name if view.perspective or name in QUAD_ROWS else "row1"
        return cls(view, own, voxel, table_quad(view, voxel, QUAD_ROWS[own]) if own in QUAD_ROWS else None)

    def coverage(self) -> np.ndarray:
        """[N]: the fraction of each footprint that is filled without antialiasing."""
        return self.quads.coverage if self.quads else self.view.coverage(self.voxel[2])

    def on(self, splat: np.ndarray, ray: np.ndarray) -> Integral:
        """The value of splats [P] on rays [2, P]."""
        if self.quads:
            return on_quads(self.view, self.quads.take(splat), ray)
        voxel = self.voxel[:, splat]
        found = row1(self.view, voxel, ray)
        if self.name != "row1":
            # rows 2 and 3 equal row 1 where nothing is widened
            some = np.flatnonzero(self.view.is_widened(voxel[2]))
            cubes = Splat(self.view.kernel, voxel[:, some].T, ray[:, some].T, 1 / self.view.pitch)
            found.value[some] = ROWS[self.name](cubes)
        return found


class Footprints(Protocol):
    """Splats on rays of a view."""

    @property
    def view(self) -> View:
        """The view."""

    def on(self, splat: np.ndarray, ray: np.ndarray) -> Integral:
        """The value of splats [P] on rays [2, P]."""


def values(row: Footprints, boxes: Boxes, order: np.ndarray, window: Window, camera: Camera) -> Iterator[Values]:
    """Pairs in a window of the image, splats in the given order, in chunks."""
    across, down = ((np.arange(count) + 0.5 - count / 2) * row.view.pitch for count in camera.size)
    top, bottom = np.maximum(boxes.top, window.y), np.minimum(boxes.bottom, window.y + window.height)
    left, right = np.maximum(boxes.left, window.x), np.minimum(boxes.right, window.x + window.width)
    seen = order[((right > left) & (bottom > top))[order]]
    count = (right - left)[seen] * (bottom - top)[seen]
    for chunk in np.split(seen, _cuts(count)):
        lines, line = _unroll(top[chunk], bottom[chunk])
        owner = chunk[lines]
        spans, column = _unroll(left[owner], right[owner])
        splat, line = owner[spans], line[spans]
        found = row.on(splat, np.stack([across[column], down[line]]))
        hit = np.flatnonzero(found.value > 0)
        pixel = (line[hit] - window.y) * window.width + column[hit] - window.x
        yield Values(splat[hit], pixel, Integral(found.value[hit], found.peak[hit]))


def _cuts(count: np.ndarray) -> np.ndarray:
    """Chunk boundaries for splats with `count` pairs each, about PAIRS per chunk."""
    part = np.cumsum(count) // PAIRS
    return np.flatnonzero(np.diff(part)) + 1


def _unroll(start: np.ndarray, stop: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """All members of the ranges start ≤ n < stop in order: the index of the range, and n."""
    length = stop - start
    owner = np.repeat(np.arange(len(length)), length)
    before = np.cumsum(length) - length
    return owner, np.arange(len(owner)) + np.repeat(start - before, length)
