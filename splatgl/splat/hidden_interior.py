"""Hidden interiors of opaque objects: voxels that are practically invisible from outside the volume's box.

The volume is divided into cells of SIDE³ voxels. Three lower bounds follow from each other.

1. Extinction. The values in a cell are means over the voxels within the reach of the kernels around it: one cell, as
   many more as a pixel is wider than a voxel; all voxels further away have 10⁻⁵ of the weight, in any direction of the
   rays. The extinction in a cell is therefore at least the transfer function's minimum over the interval of the samples
   there, widened by SLACK for means that exceed the samples beside a peak. Missing and masked voxels, and those beyond
   the ends, count as transparent.
2. Optical depth. Let a ray come from outside along (1, a, b) with 0 ≤ a, b ≤ 1, in cells. One cell further back along
   x, a point of cell (i, j, k) lies in cell (i − 1, j or j − 1, k or k − 1); between the two the ray passes only these
   eight cells, over at least the thickness of a cell. So the optical depth before any point of a cell is at least

       D(i, j, k) = min of the four D(i − 1, ·, ·) + thickness · min of the eight extinctions,

   with D = 0 outside. Exchanged axes and signs give 24 cones that cover all directions; the least of their D is the
   bound for every eye outside. Rays are straight: a cavity behind matter is hidden although a bent channel leads to
   it, and a tunnel shows what lies along it.
3. Light. If no cell within reach of a cell has D < −log LIGHT, all points whose values depend on its voxels send less
   than LIGHT to an eye outside. Without these voxels no ray changes before it has lost all light but LIGHT, and what
   lies behind, colours and opacities up to 1, changes its pixel by less than LIGHT.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from splatgl.data.volume import Places, Volume
from splatgl.geometry.grid import Grid
from splatgl.splat.extract_values import tabulate
from splatgl.splat.kernels import FREE, kernel
from splatgl.transfer.preintegration import CELLS, ValueClassifier

# voxels along a cell, which kernels of values reach where no pixel is wider than a voxel
SIDE = 2
# largest change of a pixel: 1/13 of the least tolerance of a picture without the interior, which is one level of 8 bits
# where sRGB is steepest
TOLERANCE = 1 / 255
LIGHT = TOLERANCE / 13
# intervals of the transfer function's range: codes 2 …; 0 is missing, 1 below the range, the last one above it
BINS = 250
# share of an interval by which values may exceed it, and codes at least
SLACK, LEAST_SLACK = 1 / 8, 1
# least number of voxels of a hidden interior that is left out, and voxels coded at a time
LEAST, PART = 2**18, 2**21
# optical depths are stored in shares of −log LIGHT, rounded down; this one stands for all of it and more
FULL = 255
# steps between the samples that show whether an interior may be large enough
PROBE = 4


@dataclass(frozen=True, eq=False)
class HiddenInterior:
    """Cells of hidden voxels. cells bool [Z, Y, X]: of SIDE³ voxels each, the first at the volume's first voxel."""

    cells: np.ndarray

    @classmethod
    def of(cls, volume: Volume, post: ValueClassifier, unit: float, reach: int = 1) -> HiddenInterior | None:
        """The hidden interior of a volume in memory; None if there is none, or a small one, and for vectors, as
        voxels may move along these. unit: reference length of opacities, world units. reach: cells that kernels reach.
        """
        unsuitable = not isinstance(volume.samples, np.ndarray) or volume.vectors is not None
        if volume.count < LEAST or unsuitable or not _is_bounded(post):
            return None
        extinction = least_extinctions(post)
        probe = _codes(post, volume.samples[::PROBE, ::PROBE, ::PROBE])
        if not _is_worth_it((extinction > 0)[probe], PROBE):
            return None
        low, high = (least_around(ends, reach) for ends in _ends(volume, post))
        interval = (low.astype(np.uint16) << 8) + (FULL - high)
        if not _is_worth_it(_depth_table(np.where(extinction > 0, np.inf, 0.0))[interval] > 0, SIDE):
            return None
        grid = Grid.of(volume)
        thickness = SIDE / np.linalg.norm(np.linalg.inv(grid.world_from_index), axis=1)
        tables = [_depth_table(extinction * (width / unit)) for width in thickness]
        depth = depths_from_outside([np.take(table, interval) for table in tables])
        hidden = cls((least_around(depth, reach) == FULL)[1:-1, 1:-1, 1:-1])
        return hidden if hidden.count >= LEAST else None

    @property
    def count(self) -> int:
        """Number of voxels in the cells."""
        return int(self.cells.sum()) * SIDE**3

    def inside(self, low: Places, high: Places) -> np.ndarray:
        """bool: whether voxels low ≤ (z, y, x) < high are hidden."""
        z, y, x = (np.arange(a, b) // SIDE for a, b in zip(low, high, strict=True))
        return np.asarray(self.cells[np.ix_(z, y, x)])


def _is_worth_it(dense: np.ndarray, side: int) -> bool:
    """Whether cubes of `side` voxels lie two deep inside dense ones, bool [Z, Y, X], in at least LEAST voxels."""
    return int(least_around(least_around(dense)).sum()) * side**3 >= LEAST


def _is_bounded(post: ValueClassifier) -> bool:
    """Whether the range of the samples bounds the extinction around them."""
    free = post.kernel == FREE or kernel(post.kernel).radius > SIDE
    return not (free or post.every or post.lean or post.transfer.needs_gradients)


def least_extinctions(post: ValueClassifier) -> np.ndarray:
    """float64 [256]: the least extinction per reference length of values of a code; 0 of missing ones."""
    table, unit = post.table
    mean = np.diff(table[:, 3].astype(np.int64)) * unit
    before, behind = post.integral.outside[:, 3]
    least = np.zeros(256)
    # with the cells on either side, for rounding
    padded = np.concatenate([[before], mean, [behind]])
    ends = np.arange(BINS + 1) * CELLS // BINS
    least[2 : BINS + 2] = [padded[a : b + 3].min() for a, b in pairwise(ends)]
    least[1], least[BINS + 2] = before, behind
    return least


def _codes(post: ValueClassifier, samples: np.ndarray) -> np.ndarray:
    """uint8 [...]: codes of samples."""
    scale, offset = (part * BINS / CELLS for part in post.scale)

    def code(samples: np.ndarray) -> np.ndarray:
        place = np.floor(post.relative(samples) * np.float32(scale) + np.float32(offset))
        return np.where(np.isnan(place), 0, np.clip(place, -1, BINS) + 2).astype(np.uint8)

    return tabulate(samples, code)


def _depth_table(depths: np.ndarray) -> np.ndarray:
    """uint8 [65536]: stored optical depths of intervals, by 256 · the lowest code + the highest. depths: of codes."""
    stored = np.minimum(np.floor(depths / -np.log(LIGHT) * FULL), FULL).astype(np.uint8)
    low, high = np.meshgrid(np.arange(256), np.arange(256), indexing="ij")
    wider = np.maximum(np.ceil(SLACK * (high - low)), LEAST_SLACK).astype(int)
    first, last = np.clip(low - wider, 1, BINS + 2), np.clip(high + wider, 1, BINS + 2)
    # minima from each code on: row by row
    minima = np.zeros((256, 256), np.uint8)
    for code in range(1, BINS + 3):
        minima[code, code : BINS + 3] = np.minimum.accumulate(stored[code : BINS + 3])
    return np.where((low > 0) & (low <= high), minima[first, last], 0).astype(np.uint8).ravel()


def _ends(volume: Volume, post: ValueClassifier) -> tuple[np.ndarray, np.ndarray]:
    """uint8 [Z, Y, X], twice: the lowest code in each cell, FULL less the highest; 0 in a layer around all cells."""
    depth, height, width = volume.shape
    count = [-(-size // SIDE) for size in volume.shape]
    low, high = (np.zeros([size + 2 for size in count], np.uint8) for _ in range(2))
    planes = max(PART // (height * width) // SIDE, 1) * SIDE
    for first in range(0, depth, planes):
        last = min(first + planes, depth)
        code = _codes(post, volume.samples[first:last])
        if volume.masks:
            code = np.where(volume.kept((first, 0, 0), (last, height, width)), code, np.uint8(0))
        code = np.pad(code, [(0, -size % SIDE) for size in code.shape])
        inner = (slice(1 + first // SIDE, 1 + -(-last // SIDE)), slice(1, -1), slice(1, -1))
        low[inner] = _least_of_cells(code)
        high[inner] = _least_of_cells(FULL - code)
    return low, high


def _least_of_cells(a: np.ndarray) -> np.ndarray:
    """The minimum in each cell of a [2 · Z, 2 · Y, 2 · X]."""
    for axis in range(3):
        a = np.moveaxis(a, axis, 0)
        a = np.moveaxis(np.minimum(a[::SIDE], a[1::SIDE]), 0, axis)
    return a


def least_around(a: np.ndarray, reach: int = 1) -> np.ndarray:
    """The minimum over each element and all within `reach` along each axis; 0 within reach of the ends."""
    covered = 0
    while covered < reach:
        step = min(covered + 1, reach - covered)
        for axis in range(3):
            least, along = np.zeros_like(a), np.moveaxis(a, axis, 0)
            middle = np.moveaxis(least, axis, 0)[step:-step]
            np.minimum(np.minimum(along[: -2 * step], along[2 * step :]), along[step:-step], out=middle)
            a = least
        covered += step
    return a


def depths_from_outside(depths: list[np.ndarray]) -> np.ndarray:
    """uint8 [Z, Y, X]: lower bounds of the optical depth between the outside and any point of each cell. depths: of
    cells' thickness along x, y and z; 0 in the outermost cells.
    """
    least = np.full(depths[0].shape, FULL, np.uint8)
    for axis, across in enumerate(reversed(depths)):
        for signs in np.ndindex(2, 2, 2):
            turned = tuple(slice(None, None, 1 - 2 * sign) for sign in signs)
            eight = np.moveaxis(across[turned], axis, 0)
            for along in range(3):
                eight = _with_previous(eight, along)
            _pass_planes(eight, np.moveaxis(least[turned], axis, 0))
    return least


def _with_previous(a: np.ndarray, axis: int) -> np.ndarray:
    """The minimum of each element and the one before it along an axis; 0 at the first."""
    least, along = np.zeros(a.shape, np.uint8), np.moveaxis(a, axis, 0)
    np.minimum(along[1:], along[:-1], out=np.moveaxis(least, axis, 0)[1:])
    return least


def _pass_planes(eight: np.ndarray, least: np.ndarray) -> None:
    """Lowers `least` to the depths of one cone, plane after plane along the first axis."""
    before, pairs, room = np.zeros_like(eight[0]), np.zeros_like(eight[0]), FULL - eight
    for step, most, known in zip(eight, room, least, strict=True):
        np.minimum(before[1:], before[:-1], out=pairs[1:])
        np.minimum(pairs[:, 1:], pairs[:, :-1], out=before[:, 1:])
        before[:, 0] = 0
        # sums end at FULL
        np.minimum(before, most, out=before)
        before += step
        np.minimum(known, before, out=known)
