"""Optical depths along parallel rays through a coarse grid, from every cell, towards either end of the rays.

The grid's slices are sheared so that rays are lines along an axis, summed along these, and sheared back: two linear
interpolations, however long a ray is.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from splatgl.splat.cues.coarse import Coarse


@dataclass(frozen=True, eq=False)
class Sweep:
    """Rays along a world direction [3], slice by slice along the axis of which they pass the most cells.

    axis: of arrays [Z, Y, X]. slopes: cells along the two others, per slice. step: world length from slice to slice.
    backwards: whether the direction is towards smaller indices. depth [n, H, W]: integrals until the slices' ends,
    in sheared slices.
    """

    axis: int
    slopes: tuple[float, float]
    step: float
    backwards: bool
    shape: tuple[int, int]
    depth: np.ndarray

    @classmethod
    def of(cls, coarse: Coarse, direction: np.ndarray) -> Sweep:
        """The sums along a unit vector, and against it."""
        along = np.linalg.solve(coarse.cells.world_from_index, direction)[::-1]
        axis = int(np.abs(along).argmax())
        slopes = tuple((np.delete(along, axis) / along[axis]).tolist())
        step = 1 / abs(float(along[axis]))
        slices = np.moveaxis(coarse.extinction, axis, 0)
        n, height, width = slices.shape
        grown = [size + int(np.ceil(abs(s) * (n - 1))) + 1 for size, s in zip((height, width), slopes, strict=True)]
        depth = np.zeros((n + 1, *grown), np.float32)
        for k, plane in enumerate(slices):
            (y, fy), (x, fx) = _places(slopes, k, n)
            into = depth[k + 1, y : y + height + 1, x : x + width + 1]
            for dy, wy in ((0, 1 - fy), (1, fy)):
                for dx, wx in ((0, 1 - fx), (1, fx)):
                    into[dy : dy + height, dx : dx + width] += (wy * wx * step) * plane
        np.cumsum(depth, axis=0, out=depth)
        return cls(axis, slopes, step, float(along[axis]) < 0, (height, width), depth)

    def through(self, begin: float, end: float, against: bool = False) -> np.ndarray:
        """float32 [Z, Y, X]: transmittances from world distances `begin` to `end` beyond cells' centres."""
        n = len(self.depth) - 1
        sign = -1.0 if self.backwards != against else 1.0
        middle = np.arange(n) + 0.5
        near, far = (self._until(middle + sign * length / self.step) for length in (begin, end))
        return self._sheared_back(np.exp(-np.abs(far - near)))

    def _until(self, places: np.ndarray) -> np.ndarray:
        """Integrals until places along the axis, one for each slice."""
        n = len(self.depth) - 1
        inside = np.clip(places, 0.0, n)
        low = np.minimum(inside.astype(int), n - 1)
        part = (inside - low).astype(np.float32)[:, None, None]
        below = self.depth[low]
        return np.asarray(below + part * (self.depth[low + 1] - below))

    def _sheared_back(self, values: np.ndarray) -> np.ndarray:
        n, (height, width) = len(values), self.shape
        found = np.empty((n, height, width), np.float32)
        for k, plane in enumerate(values):
            (y, fy), (x, fx) = _places(self.slopes, k, n)
            part = plane[y : y + height + 1, x : x + width + 1]
            rows = part[:-1] + np.float32(fy) * (part[1:] - part[:-1])
            found[k] = rows[:, :-1] + np.float32(fx) * (rows[:, 1:] - rows[:, :-1])
        return np.moveaxis(found, 0, self.axis)


def _places(slopes: tuple[float, ...], k: int, n: int) -> list[tuple[int, float]]:
    """Where slice k of n lies in the sheared ones along both axes: whole cells, and the rest."""
    found = []
    for slope in slopes:
        place = (n - 1 - k) * slope if slope > 0 else -k * slope
        whole = int(place)
        found.append((whole, place - whole))
    return found
