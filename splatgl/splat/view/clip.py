"""Planes that cut a picture's volumes: what lies on one side of each is left out.

Rays are clipped, so that values classified after reconstruction, and boxes of labels, end exactly at a plane; other
voxels that are classified before are kept or left out whole. A face that a plane cuts is lit by the plane's normal, to
a depth of FACE voxels.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from numbers import Real
from typing import TYPE_CHECKING, Any

import numpy as np

from splatgl.errors import expected
from splatgl.splat.extraction.kept import LatestParts

if TYPE_CHECKING:
    from splatgl.splat.extraction.splats import Grid, Splats

# most planes of a picture: those of a box and ten more
MOST_CLIPS = 16
# normals whose length is 1 but for rounding
UNIT = 1e-14
# voxels along a ray behind a cut that are lit as its face
FACE = 1.0
# a ray that leaves a plane, or a face of a volume's box, by less than GRAZING of its length lies in it if it begins
# within FLUSH voxels of it, and is kept: views along faces are usual, and rounding would decide each ray otherwise
GRAZING, FLUSH = 1e-5, 1e-3
# rounding: a voxel before a plane by less than this share of its distance from the origin counts as on it
ON_PLANE = 1e-12

# n_x, n_y, n_z, d: kept are the points x with n · x ≥ d, world units; n is a unit vector
Plane = tuple[float, float, float, float]
# cache: of the latest planes
_latest = LatestParts()


def planes(given: Any) -> tuple[Plane, ...]:
    """Planes [n_x, n_y, n_z, d] with unit normals. Raises InputError for other numbers, no direction, and too many."""
    rows = list(given) if isinstance(given, Iterable) and not isinstance(given, str) else [None]
    if len(rows) > MOST_CLIPS:
        raise expected("clip", f"at most {MOST_CLIPS} planes", len(rows))
    return tuple(_plane(row) for row in rows)


def _plane(row: Any) -> Plane:
    numbers = list(row) if isinstance(row, Sequence | np.ndarray) and not isinstance(row, str) else []
    fine = len(numbers) == 4 and all(isinstance(n, Real) and np.isfinite(float(n)) for n in numbers)
    length = float(np.linalg.norm(np.array(numbers[:3], np.float64))) if fine else 0.0
    if not (fine and 0 < length < np.inf):
        raise expected("clip", "planes of four finite numbers: a normal n and d, kept where n · x ≥ d", repr(row)[:80])
    # unit vectors stay as they are, bit for bit
    length = 1.0 if abs(length - 1.0) < UNIT else length
    x, y, z, d = (float(n) / length for n in numbers)
    return x, y, z, d


@dataclass(frozen=True, eq=False)
class Clip:
    """Planes over a grid. normal [K, 3]: unit vectors, world axes; kept are the grid positions i with g · i ≥ place, of
    g [K, 3] and place [K].
    """

    normal: np.ndarray
    g: np.ndarray
    place: np.ndarray

    @classmethod
    def of(cls, found: Sequence[Plane], grid: Grid) -> Clip | None:
        """The planes in the indices of a grid; None for none."""
        if not found:
            return None
        rows = np.array(found, np.float64)
        normal = rows[:, :3]
        return cls(normal, normal @ grid.world_from_index, rows[:, 3] - normal @ np.asarray(grid.origin, np.float64))

    def keeps(self, positions: np.ndarray, boxes: bool = False) -> np.ndarray:
        """bool [N]: which grid positions [N, 3] are kept; boxes: or any of the boxes of their voxels."""
        at = positions.astype(np.float64) @ self.g.T
        place = self.place - (0.5 * np.abs(self.g).sum(axis=1) if boxes else 0.0)
        return np.asarray((at >= place - ON_PLANE * (np.abs(at) + np.abs(place))).all(axis=1))

    def meets(self, low: np.ndarray, high: np.ndarray) -> bool:
        """Whether any of a box of grid positions, low to high [3], may be kept."""
        return bool((np.where(self.g > 0, high, low) * self.g).sum(axis=1).__ge__(self.place).all())

    def along(self, start: np.ndarray, direction: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Of rays from `start` along `direction` [3, P], grid indices: the distances [P] between which all planes keep
        them, and the number [P] of the plane behind which they begin.
        """
        size = np.linalg.norm(self.g, axis=1)[:, None]
        speed, apart = self.g @ direction / size, (self.place[:, None] - self.g @ start) / size
        apart = np.where(np.abs(speed) < GRAZING * np.linalg.norm(direction, axis=0), apart - FLUSH, apart)
        with np.errstate(divide="ignore", invalid="ignore"):
            at = apart / speed
        # a ray along a plane is always or never kept
        still = np.where(apart > 0, np.inf, -np.inf)
        enters = np.where(speed > 0, at, np.where(speed == 0, still, -np.inf))
        leaves = np.where(speed < 0, at, np.inf)
        return enters.max(axis=0), leaves.min(axis=0), enters.argmax(axis=0)


def clipped(splats: Splats, found: tuple[Plane, ...], boxes: bool = False) -> Splats:
    """The splats whose centres planes keep, or any of their boxes; of values all, as rays are clipped. Caches the
    latest result.
    """
    clip = Clip.of(found, splats.grid) if len(splats) and splats.post is None else None
    if clip is None:
        return splats
    return _latest.of(splats, (found, boxes), lambda: clip.keeps(splats.positions, boxes))
