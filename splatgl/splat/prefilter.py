"""Coefficients whose kernel means pass near the samples, in boxes around the voxels that need them."""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import pairwise, product

import numpy as np

from splatgl.data.volume import Places
from splatgl.splat.kernels import FREE, Kernel
from splatgl.splat.splats import in_parts

# steps of the prefilter, after which means of coefficients are near the samples
PREFILTERED = {"b-spline": 4, FREE: 4}
# shares of the rise of a peak and a pair of samples by which coefficients may exceed the samples around; of a wave all
PEAK, PAIR = np.float32(0.5), np.float32(0.25)
# voxels along a side of the cells of which boxes for the prefilter consist, the share of voxels above which one box
# holds all, and the cost of two halves, relative to the whole, below which it is halved
CELL, DENSE, WORTH = 8, 0.4, 0.85
# planes of a block, its voxels, and its rows at least: with its halo it fits into a cache
PLANES, BLOCK_VOXELS, LEAST_ROWS = 16, 1 << 17, 16
# planes around a slab that a step of the prefilter and its limits read
STEP_HALO, LIMIT_HALO = 1, 3


def margin_of(kernel: Kernel) -> int:
    """Samples around a box on which the coefficients of its voxels depend."""
    steps = PREFILTERED.get(kernel.name, 0)
    return (steps - 1) * STEP_HALO + LIMIT_HALO if steps else 0


def coefficients(u: np.ndarray, kernel: Kernel, wanted: np.ndarray, start: Places) -> tuple[np.ndarray, Places]:
    """Coefficients of samples u [D, H, W] in a box around all `wanted` voxels, bool [d, h, w], of the part of u that
    begins at `start`; defined at these. And the box's first place.
    """
    rows, planes = np.any(wanted, axis=2), np.any(wanted, axis=0)
    lines = (np.flatnonzero(some) for some in (np.any(rows, axis=1), np.any(rows, axis=0), np.any(planes, axis=0)))
    tight = tuple(slice(int(some[0]), int(some[-1]) + 1) for some in lines)
    z, y, x = (side.start + begin for side, begin in zip(tight, start, strict=True))
    margin = margin_of(kernel)
    c, boxes = np.empty([side.stop - side.start for side in tight], np.float32), cover(wanted[tight], (z, y, x), margin)

    def fill(some: slice) -> None:
        for box in boxes[some]:
            outer = tuple(slice(max(side.start - margin, 0), side.stop + margin) for side in box)
            inner, here = (
                tuple(slice(a.start - b, a.stop - b) for a, b in zip(box, beside, strict=True))
                for beside in ([side.start for side in outer], (z, y, x))
            )
            c[here] = prefilter(u[outer], kernel)[inner]

    in_parts(len(boxes), 1, fill)
    return c, (z, y, x)


Sides = tuple[slice, ...]


def cover(wanted: np.ndarray, start: Places, margin: int) -> list[Sides]:
    """Boxes that contain all `wanted` voxels, bool [d, h, w], of which the first lies at `start`, and are small with
    their margins; of whole cells of CELL voxels, but at the ends.
    """
    whole = tuple(slice(a, a + size) for a, size in zip(start, wanted.shape, strict=True))
    if np.count_nonzero(wanted) > DENSE * wanted.size:
        return [whole]
    for axis, side in enumerate(whole):
        along = np.moveaxis(wanted, axis, 0)
        starts = [max(cell - side.start, 0) for cell in range(side.start // CELL * CELL, side.stop, CELL)]
        cells = [np.any(along[a:b], axis=0) for a, b in pairwise([*starts, len(along)])]
        wanted = np.moveaxis(np.stack(cells), 0, axis)
    first = tuple(side.start // CELL for side in whole)
    return [
        tuple(slice(max(a.start, b.start), min(a.stop, b.stop)) for a, b in zip(box, whole, strict=True))
        for box in _halve(wanted, first, margin)
    ]


def _halve(cells: np.ndarray, at: tuple[int, ...], margin: int) -> list[Sides]:
    """Boxes of the occupied ones of `cells`, the first of which lies at `at`."""
    occupied = np.nonzero(cells)
    if not len(occupied[0]):
        return []
    tight = tuple(slice(int(i.min()), int(i.max()) + 1) for i in occupied)
    cells, at = cells[tight], tuple(a + side.start for a, side in zip(at, tight, strict=True))
    box = tuple(slice(a * CELL, (a + size) * CELL) for a, size in zip(at, cells.shape, strict=True))
    axis = int(np.argmax(cells.shape))
    middle = cells.shape[axis] // 2
    if middle == 0 or cells.mean() > DENSE:
        return [box]
    first, second = np.split(cells, [middle], axis=axis)
    beside = tuple(a + middle * (n == axis) for n, a in enumerate(at))
    halves = [*_halve(first, at, margin), *_halve(second, beside, margin)]

    def cost(boxes: list[Sides]) -> int:
        return sum(math.prod(side.stop - side.start + 2 * margin for side in box) for box in boxes)

    return halves if cost(halves) < WORTH * cost([box]) else [box]


def prefilter(u: np.ndarray, kernel: Kernel) -> np.ndarray:
    """Coefficients whose kernel means pass near the samples u [D, H, W]; means leave out NaN and places beyond the
    ends.

    c ← c + u − k∗c/Σk, within `_limits`, so that no mean leaves the range of the samples around it.
    """
    steps = PREFILTERED.get(kernel.name, 0)
    if steps == 0:
        return u
    finite = np.isfinite(u)
    complete = bool(finite.all())
    known = u if complete else np.where(finite, u, np.float32(0))
    weights = np.asarray(kernel.value(np.sqrt(np.arange(4.0))), np.float32)
    weights /= weights @ np.array([1, 6, 12, 8], np.float32)
    if complete:
        mass_of = _inner_mass(u.shape, weights)
    else:
        mass_of = (1 / np.maximum(_smooth(finite.astype(np.float32), weights), 1e-9)).__getitem__
    limits = None if kernel.name == FREE else _limits(u, complete)
    c = known

    def step(some: Sides, mean: np.ndarray) -> None:
        mean *= mass_of(some)
        np.subtract(known[some], mean, out=mean)
        mean += c[some]
        if limits is not None:
            np.clip(mean, limits[0][some], limits[1][some], out=mean)
        if not complete:
            np.copyto(mean, 0, where=~finite[some])

    for _ in range(steps):
        c = _smooth(c, weights, step)
    return c if complete else np.where(finite, c, np.float32(np.nan))


def _inner_mass(shape: tuple[int, ...], weights: np.ndarray) -> Callable[[Sides], np.ndarray]:
    """The reciprocal of the sum of the weights that lie inside the volume, for each voxel of a block (z, y)."""
    mass = 1 / _smooth(np.ones([min(size, 3) for size in shape], np.float32), weights)
    index = [np.minimum(np.arange(size), 1) + (np.arange(size) == size - 1) * (size > 2) for size in shape]

    def of(some: Sides) -> np.ndarray:
        # within the volume, one row stands for all
        sides = (side[: 1 if (side == 1).all() else None] for side in (index[0][some[0]], index[1][some[1]]))
        return np.asarray(mass[np.ix_(*sides, index[2])])

    return of


def _smooth(c: np.ndarray, weights: np.ndarray, then: Callable[[Sides, np.ndarray], None] | None = None) -> np.ndarray:
    """Weighted sum over 3×3×3 neighbours; weights [4] by the number of coordinates that differ; 0 beyond the ends.

    then: changes a finished block (z, y) in place.
    """
    w0, w1, w2, w3 = weights
    total = np.empty_like(c)

    def smooth(outer: Sides, some: Sides, inner: Sides) -> None:
        part = c[outer]
        term, beside = np.empty_like(part), _sum_neighbours(part, 2, np.empty_like(part))
        same, one, two = part * w0, part * w1, part * w2
        same += np.multiply(beside, w1, out=term)
        one += np.multiply(beside, w2, out=term)
        two += np.multiply(beside, w3, out=term)
        same += _sum_neighbours(one, 1, term)
        one += _sum_neighbours(two, 1, term)
        np.add(same[inner], _sum_neighbours(one, 0, term)[inner], out=total[some])
        if then is not None:
            then(some, total[some])

    in_blocks(c.shape, 1, smooth)
    return total


def in_blocks(shape: tuple[int, ...], halo: int, work: Callable[[Sides, Sides, Sides], None]) -> None:
    """Runs `work` in threads on blocks of whole rows of a volume. Its arguments, slices (z, y): a block with the voxels
    within `halo`; the block; the block, within the former.
    """
    rows = max(BLOCK_VOXELS // (PLANES * max(shape[2], 1)), LEAST_ROWS)
    corners = list(product(range(0, shape[0], PLANES), range(0, shape[1], rows)))

    def run(which: slice) -> None:
        for z, y in corners[which]:
            some = slice(z, z + PLANES), slice(y, y + rows)
            outer = tuple(slice(max(side.start - halo, 0), side.stop + halo) for side in some)
            starts = zip(some, outer, strict=True)
            inner = tuple(slice(a.start - b.start, a.stop - b.start) for a, b in starts)
            work(outer, some, inner)

    in_parts(len(corners), 1, run)


def _sum_neighbours(a: np.ndarray, axis: int, total: np.ndarray) -> np.ndarray:
    """Sets `total` to the sum of both neighbours along an axis, 0 beyond the ends, and returns it."""
    a, sums = a.swapaxes(0, axis), total.swapaxes(0, axis)
    np.add(a[:-2], a[2:], out=sums[1:-1])
    if len(a) > 1:
        sums[0], sums[-1] = a[1], a[-2]
    else:
        sums[0] = 0
    return total


def _limits(u: np.ndarray, complete: bool) -> tuple[np.ndarray, np.ndarray]:
    """Least and greatest coefficients [D, H, W]: the range of the 26 neighbours' samples u, widened for a peak, a peak
    between two samples, or a wave along each axis. Not at steps, terraces and sheets of two voxels: coefficients beyond
    the samples would show values there that do not exist.
    """
    low, high = np.empty_like(u), np.empty_like(u)

    def limit(outer: Sides, some: Sides, inner: Sides) -> None:
        part = np.ascontiguousarray(u[outer])
        gone = None if complete else np.isnan(part)
        least, most = part, part
        if gone is not None:
            least, most = (np.where(gone, np.float32(end), part) for end in (np.inf, -np.inf))
        for axis in range(3):
            least, most = extreme_filter(np.minimum, least, axis), extreme_filter(np.maximum, most, axis)
        for axis in range(3):
            # across the axis, limits depend on the next neighbours only
            near = tuple(
                slice(None) if n == axis else slice(max(side.start - 1, 0), side.stop + 1)
                for n, side in enumerate(inner)
            )
            _widen(least[near], most[near], part[near], None if gone is None else gone[near], axis)
        low[some], high[some] = least[inner], most[inner]

    in_blocks(u.shape, LIMIT_HALO, limit)
    return low, high


def _widen(least: np.ndarray, most: np.ndarray, u: np.ndarray, gone: np.ndarray | None, axis: int) -> None:
    """Widens the limits in place for peaks and waves along an axis. gone: missing samples."""
    a, low, high = (array.swapaxes(0, axis) for array in (u, least, most))
    # difference to the next sample, 0 to missing ones, padded by two on each side; in the order of u's memory
    rise = np.zeros([size + 5 * (n == axis) for n, size in enumerate(u.shape)], u.dtype).swapaxes(0, axis)
    np.subtract(a[1:], a[:-1], out=rise[3:-3])
    if gone is not None:
        np.copyto(rise, 0, where=np.isnan(rise))
    bend = rise[1:] - rise[:-1]
    ahead, back = rise[3:-2], np.negative(rise[2:-3])
    pair, outer, change = np.empty_like(bend[2:-1]), np.empty_like(bend[2:-1]), np.empty_like(back)
    for ends, least_of, most_of in ((low, np.minimum, np.maximum), (high, np.maximum, np.minimum)):
        # one sample that is a peak, down or up
        most_of(least_of(ahead, back, out=change), 0, out=change)
        change *= PEAK
        ends -= change
        # two samples that bend alike, less the opposite bend beside them
        least_of(bend[1:-2], bend[2:-1], out=pair)
        pair += least_of(least_of(bend[:-3], bend[3:], out=outer), 0, out=outer)
        most_of(most_of(pair[:-1], pair[1:], out=change), 0, out=change)
        change *= PAIR
        ends -= change
    # a wave bends everywhere, neighbours included
    wave = np.abs(bend[2:-2])
    if gone is not None:
        np.copyto(wave, np.float32(1e30), where=gone.swapaxes(0, axis))
    for along in (0, 0, 1, 2):
        wave = extreme_filter(np.minimum, wave, along)
    low -= wave
    high += wave


def extreme_filter(of: np.ufunc, a: np.ndarray, axis: int) -> np.ndarray:
    """Minimum or maximum over a voxel and its two neighbours along an axis."""
    a = a.swapaxes(0, axis)
    if len(a) < 3:
        return np.repeat(of.reduce(a, axis=0)[None], len(a), axis=0).swapaxes(0, axis)
    result, two = np.empty_like(a), of(a[1:], a[:-1])
    of(two[1:], two[:-1], out=result[1:-1])
    result[0], result[-1] = two[0], two[-1]
    return result.swapaxes(0, axis)
