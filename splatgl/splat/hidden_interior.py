"""Hidden interiors of opaque objects: voxels that are practically invisible from outside the volume's box.

The volume is divided into cells of SIDE³ voxels, or larger ones. Three lower bounds follow from each other.

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
   bound for every eye outside. For one eye, straight beams are passed instead, which add up the least extinction of the
   cells that they meet in each plane: the far side of an object is hidden, too. Rays are straight: a cavity behind
   matter is hidden although a bent channel leads to it, and a tunnel shows what lies along it.
3. Light. If no cell within reach of a cell has D < −log LIGHT, all points whose values depend on its voxels send less
   than LIGHT to an eye outside. Without these voxels no ray changes before it has lost all light but LIGHT, and what
   lies behind, colours and opacities up to 1, changes its pixel by less than LIGHT.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise

import numpy as np

from splatgl.data.volume import Places, Volume
from splatgl.geometry.grid import Grid
from splatgl.splat.extract_values import tabulate
from splatgl.splat.kernels import FREE, kernel
from splatgl.splat.prefilter import extreme_filter
from splatgl.splat.splats import in_parts
from splatgl.transfer.preintegration import CELLS, ValueClassifier

# voxels along a cell, which kernels of values reach where no pixel is wider than a voxel
SIDE = 2
# voxels along a side of the blocks that are left out together where no value is wanted, or seen
BLOCK = 8
# largest change of a pixel: 1/13 of the least tolerance of a picture without the interior, which is one level of 8 bits
# where sRGB is steepest
TOLERANCE = 1 / 255
LIGHT = TOLERANCE / 13
# note on pictures without hidden voxels
LEFT_OUT = f"hidden voxels left out: they add less than {LIGHT:.1g}"
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
# planes of cells that are read together, runs of memory along the last axis; beams beside those of one eye that meet a
# cell, and cells by which they are wider, for rounding
TOGETHER, BESIDE, ROUNDED = 32, 1, 1e-6


@dataclass(frozen=True, eq=False)
class HiddenInterior:
    """Voxels that are left out. cells bool [Z, Y, X]: of `side`³ voxels each, the first at the volume's first voxel,
    that are hidden, or in blocks without a wanted value. count: number of hidden voxels.
    """

    cells: np.ndarray
    side: int = SIDE
    count: int = 0

    @classmethod
    def of(
        cls,
        volume: Volume,
        post: ValueClassifier,
        unit: float,
        reach: int = 1,
        eye: np.ndarray | None = None,
        side: int = SIDE,
    ) -> HiddenInterior | None:
        """The hidden interior of a volume in memory; None if there is none, or a small one, and for vectors, as
        voxels may move along these.

        unit: reference length of opacities, world units. reach: cells of SIDE voxels that kernels reach. eye [4]: the
        only one that looks, homogeneous grid indices (x, y, z, 1), or (x, y, z, 0) towards it; None: every one outside.
        side: voxels along a cell, a multiple of SIDE.
        """
        unsuitable = not isinstance(volume.samples, np.ndarray) or volume.vectors is not None
        if volume.count < LEAST or unsuitable or not _is_bounded(post):
            return None
        extinction, reach = least_extinctions(post), -(-reach * SIDE // side)
        probe = _codes(post, volume.samples[::PROBE, ::PROBE, ::PROBE])
        if not _is_worth_it((extinction > 0)[probe], PROBE):
            return None
        interval, void = _intervals(volume, post, reach, side)
        if eye is None and not _is_worth_it(_depth_table(np.where(extinction > 0, np.inf, 0.0))[interval] > 0, side):
            return None
        thickness = side / np.linalg.norm(np.linalg.inv(Grid.of(volume).world_from_index), axis=1)
        tables = [_depth_table(extinction * (width / unit)) for width in thickness]
        if eye is not None:
            # in cells, of which a layer lies around all
            place = np.append((eye[:3] + 0.5 * eye[3]) / side + eye[3], eye[3])
            depth = depths_before(interval, tables, place)
        else:
            depth = depths_from_outside([np.take(table, interval) for table in tables])
        del interval
        cells = (least_around(depth, reach) == FULL)[1:-1, 1:-1, 1:-1]
        count = int(np.count_nonzero(cells)) * side**3
        if count < LEAST:
            return None
        if not volume.masks:
            cells |= in_voxels(void, max(BLOCK // side, 1), (0, 0, 0), cells.shape)
        return cls(cells, side, count)

    def inside(self, low: Places, high: Places) -> np.ndarray:
        """bool: whether voxels low ≤ (z, y, x) < high are hidden."""
        return in_voxels(self.cells, self.side, low, high)

    def hides(self, low: Places, high: Places) -> bool:
        """Whether all voxels low ≤ (z, y, x) < high are hidden."""
        some = (slice(a // self.side, -(-b // self.side)) for a, b in zip(low, high, strict=True))
        return bool(self.cells[tuple(some)].all())


def in_voxels(cells: np.ndarray, side: int, low: Places, high: Places) -> np.ndarray:
    """The values of cells [Z, Y, X] of side³ voxels at the voxels low ≤ (z, y, x) < high."""
    part = cells[tuple(slice(a // side, -(-b // side)) for a, b in zip(low, high, strict=True))]
    for axis in range(3):
        part = np.repeat(part, side, axis)
    z, y, x = (slice(a % side, a % side + b - a) for a, b in zip(low, high, strict=True))
    return np.asarray(part[z, y, x])


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


def _without_matter(low: np.ndarray, high: np.ndarray, post: ValueClassifier, side: int) -> np.ndarray:
    """bool [Z, Y, X]: blocks of BLOCK³ voxels which, with those around them, have no wanted value. low, high: as of
    `_ends`.
    """
    wanted = np.zeros(257, np.int64)
    scale, offset = (part * BINS / CELLS for part in post.scale)
    for ends in np.floor(post.wanted.astype(np.float32) * np.float32(scale) + np.float32(offset)):
        first, last = np.clip(ends, -1, BINS).astype(int) + 2
        wanted[first + 1 : last + 2] = 1
    before, side = np.cumsum(wanted), max(BLOCK // side, 1)
    ends = []
    for codes in (low, high):
        inner = codes[1:-1, 1:-1, 1:-1]
        inner = np.pad(inner, [(0, -size % side) for size in inner.shape], "edge")
        least = _ends_of_cells(np.minimum, inner, side)
        for axis in range(3):
            least = extreme_filter(np.minimum, least, axis)
        ends.append(least.astype(int))
    return np.asarray(before[FULL - ends[1] + 1] == before[ends[0]])


def _intervals(volume: Volume, post: ValueClassifier, reach: int, side: int) -> tuple[np.ndarray, np.ndarray]:
    """uint16 [Z, Y, X]: intervals of codes within `reach` of each cell: 256 · the lowest code + the highest. A layer
    around all cells, and cells beyond the ends, count as missing. And the blocks of `_without_matter`.
    """
    ends = _ends(volume, post, side)
    void = _without_matter(*ends, post, side)
    low, high = (least_around(end, reach) for end in ends)
    interval = low.astype(np.uint16)
    interval <<= 8
    interval += np.subtract(FULL, high, out=high)
    return interval, void


def _ends(volume: Volume, post: ValueClassifier, side: int) -> tuple[np.ndarray, np.ndarray]:
    """uint8 [Z, Y, X], twice: the lowest code in each cell, FULL less the highest; 0 in a layer around all cells."""
    low, high = (np.zeros([-(-size // side) + 2 for size in volume.shape], np.uint8) for _ in range(2))
    depth, height, width = (size // side * side for size in volume.shape)
    planes = max(PART // max(height * width * side, 1), 1) * side

    def fill(which: slice) -> None:
        samples = volume.samples[which, :height, :width]
        inner = tuple(slice(1, 1 + size // side) for size in (height, width))
        layers = slice(1 + which.start // side, 1 + which.stop // side)
        if samples.dtype.kind in "iu" and not volume.masks:
            # codes rise with samples
            low[layers, *inner] = _codes(post, _ends_of_cells(np.minimum, samples, side))
            high[layers, *inner] = FULL - _codes(post, _ends_of_cells(np.maximum, samples, side))
            return
        code = _codes(post, samples)
        if volume.masks:
            code = np.where(volume.kept((which.start, 0, 0), (which.stop, height, width)), code, np.uint8(0))
        low[layers, *inner] = _ends_of_cells(np.minimum, code, side)
        high[layers, *inner] = FULL - _ends_of_cells(np.maximum, code, side)

    in_parts(depth, planes, fill)
    return low, high


def _ends_of_cells(of: np.ufunc, a: np.ndarray, side: int) -> np.ndarray:
    """The minimum or maximum in each cell of a [side · Z, side · Y, side · X]; side: a power of two."""
    while side > 1:
        for axis in range(3):
            turned = np.moveaxis(a, axis, 0)
            a = np.moveaxis(of(turned[::2], turned[1::2]), 0, axis)
        side //= 2
    return a


def least_around(a: np.ndarray, reach: int = 1) -> np.ndarray:
    """The minimum over each element and all within `reach` along each axis; 0 within reach of the ends."""
    covered = 0
    while covered < reach:
        step = min(covered + 1, reach - covered)
        a, least = np.zeros_like(a), a
        in_parts(max(len(a) - 2 * step, 0), max(PART // max(a[:1].size, 1), 1), partial(_fill_least, a, least, step))
        covered += step
    return a


def _fill_least(filled: np.ndarray, a: np.ndarray, step: int, planes: slice) -> None:
    """Fills planes, counted from `step` on, with minima within `step`; together the three axes stay in the cache."""
    least = a[planes.start : planes.stop + 2 * step]
    for axis in range(3):
        along = np.moveaxis(least, axis, 0)
        three = np.minimum(np.minimum(along[: -2 * step], along[2 * step :]), along[step:-step])
        least = np.moveaxis(three, 0, axis)
    filled[planes.start + step : planes.stop + step, step:-step, step:-step] = least


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


def depths_before(interval: np.ndarray, tables: list[np.ndarray], eye: np.ndarray) -> np.ndarray:
    """uint8 [Z, Y, X]: lower bounds of the optical depth between one eye and any point of each cell. tables: of
    intervals, across cells along x, y and z; 0 for those of the outermost cells. eye [4]: as of `HiddenInterior.of`, in
    cells.

    Beams from the eye, a cell wide in the middle of the volume, pass planes of cells one after another.
    """
    zyx, size = eye[2::-1], np.array(interval.shape)
    # the axis along which the eye lies furthest outside, from where it looks forward to all planes
    outside = np.maximum(-zyx, zyx - size) if eye[3] else np.abs(zyx)
    axis = int(outside.argmax())
    is_behind = bool(zyx[axis] > (size[axis] if eye[3] else 0.0))
    turned, bounds = slice(None, None, -1 if is_behind else 1), np.zeros(interval.shape, np.uint8)
    planes, least = (np.moveaxis(a, axis, 0)[turned] for a in (interval, bounds))
    if is_behind:
        zyx = np.where(np.arange(3) == axis, size * eye[3] - zyx, zyx)
    beams = [Beams.of(zyx[[axis, n]], bool(eye[3]), (len(planes), int(size[n]))) for n in range(3) if n != axis]
    passed = np.zeros([beam.count for beam in beams], np.uint8)
    for first in range(0, len(planes) if outside[axis] > 0 else 0, TOGETHER):
        # copied: cells along the last axis of memory
        depths = np.take(tables[2 - axis], np.ascontiguousarray(planes[first : first + TOGETHER]))
        for n, depth in enumerate(depths, first):
            (rows, from_rows), (columns, from_columns) = (beam.meet(n) for beam in beams)
            least[n] = _least_of(_least_of(passed, from_rows, 0), from_columns, 1)
            step = _least_of(_least_of(depth, rows, 0), columns, 1)
            # sums end at FULL
            np.minimum(passed, FULL - step, out=passed)
            passed += step
    return bounds


# cells, or beams, from the first to the last
Ends = tuple[np.ndarray, np.ndarray]


@dataclass(frozen=True)
class Beams:
    """Beams side by side along an axis of a plane of cells. eye: distance of the first plane, and place along the axis;
    of parallel beams the slope. middle: distance where they are a cell wide, the first begins at `start`. size: planes,
    and cells along the axis.
    """

    eye: tuple[float, float]
    perspective: bool
    size: tuple[int, int]
    middle: float
    start: int
    count: int

    @classmethod
    def of(cls, eye: np.ndarray, perspective: bool, size: tuple[int, int]) -> Beams:
        """Beams that meet all cells. eye [2]: along the axis across the planes and this one, or towards it."""
        across, along = eye.tolist()
        place = (-across, along) if perspective else (0.0, along / across)
        beams = cls(place, perspective, size, size[0] / 2 + place[0], 0, 0)
        ends = [beams._from(cell, plane) for cell in (0, size[1]) for plane in (0, size[0])]
        start = math.floor(min(ends)) - BESIDE
        return replace(beams, start=start, count=math.ceil(max(ends)) + BESIDE - start)

    def _from(self, place: float, plane: int) -> float:
        """The place, at the middle distance, of the ray through a place of a plane."""
        distance, along = self.eye[0] + plane, self.eye[1]
        if self.perspective:
            return along + (place - along) * self.middle / distance
        return place - along * (distance - self.middle)

    def meet(self, plane: int) -> tuple[Ends, Ends]:
        """The cells of a plane that each beam meets, and the beams that meet each cell."""
        edge = np.arange(self.start, self.start + self.count + 1, dtype=np.float64)
        along, distances = self.eye[1], self.eye[0] + plane + np.array([[0.0], [1.0]])
        if self.perspective:
            places = along + (edge - along) * distances / self.middle
        else:
            places = edge + along * (distances - self.middle)
        low, high = places.min(axis=0)[:-1] - ROUNDED, places.max(axis=0)[1:] + ROUNDED
        cells, most = np.arange(self.size[1]), self.size[1] - 1
        # cells beyond the ends are transparent, as the outermost ones
        first, last = (np.clip(np.floor(end), 0, most).astype(np.int64) for end in (low, high))
        return (first, last), (np.searchsorted(high, cells), np.searchsorted(low, cells + 1, side="right") - 1)


def _least_of(a: np.ndarray, ends: Ends, axis: int) -> np.ndarray:
    """The least elements of an array [m, n] along an axis from first to last places."""
    first, last = ends
    least = np.take(a, first, axis)
    for step in range(1, int((last - first).max(initial=0)) + 1):
        np.minimum(least, np.take(a, np.minimum(first + step, last), axis), out=least)
    return least
