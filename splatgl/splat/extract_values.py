"""Extraction of values and gradients, which are classified after reconstruction.

A point's value is a mean of coefficients around it, and near the samples there. A voxel is kept if the interval of the
samples within the kernel's reach meets a value of non-zero opacity; the others only contribute to transparent points,
which only blends of one value see.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from itertools import islice
from typing import Any, NamedTuple

import numpy as np

from splatgl.data.volume import Places, Volume
from splatgl.splat.grid import Grid
from splatgl.splat.kernels import FREE, Kernel
from splatgl.splat.mask_field import MaskField
from splatgl.splat.preintegration import ValueClassifier, faced
from splatgl.splat.splats import Gathered, Splats, assemble, in_parts, record_type

# steps of the prefilter, after which means of coefficients are near the samples
PREFILTERED = {"b-spline": 4, FREE: 4}
# shares of what a peak, a pair of samples and a wave rise by that coefficients may exceed the samples around by
PEAK, PAIR, WAVE = np.float32(0.5), np.float32(0.25), np.float32(1.0)
# integer types up to this many bytes take their record values from a table
TABLE_BYTES = 2
# voxels smoothed, and records filled, at a time
CHUNK_VOXELS, RECORDS = 1 << 18, 1 << 16
# planes beside which those of a halo take little more
THICK = 32
# planes around a slab that a step of the prefilter reads, that differences read, and that its limits read
STEP_HALO, GRADIENT_HALO, LIMIT_HALO = 1, 2, 3

# voxels within which a kernel after which values are classified reaches others, in whole voxels
KERNEL_REACH = 2

# of record values [N], those of what is missing beside them, and whether they are opaque
Around = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]
# (low, high) of a box of voxels, z, y, x
Box = tuple[Places, Places]
Progress = Callable[[Iterator[Any], int], Iterator[Any]]


def extract_post(
    volume: Volume, post: ValueClassifier, kernel: Kernel, voxels: int, progress: Progress | None = None
) -> Splats:
    """Splats of value and gradient, in row order, of all finite voxels that `post` wants.

    voxels: read at a time, about; records do not depend on it.
    """
    gathered = Gathered(record_type(volume.shape, post=True))
    layers = boxes(volume.shape, voxels)
    count = sum(map(len, layers))
    all_boxes = (box for layer in layers for box in layer)
    told = progress(all_boxes, count) if progress else all_boxes
    gaps: list[np.ndarray] = [np.zeros((0, 3), np.int64)]
    for layer in layers:
        found = [box_records(volume, post, kernel, low, high, gaps) for low, high in islice(told, len(layer))]
        records = np.concatenate(found) if len(found) > 1 else found[0]
        # row by row in each box: planes of all boxes one after another
        order = np.argsort(records["position"][:, 2], kind="stable") if len(found) > 1 else slice(None)
        gathered.add(records[order])
    return post_splats(volume, post, gathered.records, np.concatenate(gaps))


def boxes(shape: tuple[int, int, int], voxels: int) -> list[list[Box]]:
    """Boxes of whole rows, of about so many voxels, that cover a volume: layers of planes of boxes along y.

    Whole planes, if THICK of them are that many; else as many planes as rows, which have the smallest halo.
    """
    depth, height, width = shape
    rows = min(max(round((voxels / width) ** 0.5), 1), height) if voxels < THICK * height * width else height
    planes = min(max(voxels // (rows * width), 1), depth)
    return [
        [((z, y, 0), (min(z + planes, depth), min(y + rows, height), width)) for y in range(0, height, rows)]
        for z in range(0, depth, planes)
    ]


def box_records(
    volume: Volume,
    post: ValueClassifier,
    kernel: Kernel,
    low: Places,
    high: Places,
    gaps: list[np.ndarray] | None = None,
) -> np.ndarray:
    """Records, in row order, of the voxels low ≤ (z, y, x) < high that `post` wants; what is known to hold none is not
    read. gaps: is given the places [N, 3] (x, y, z) of missing ones that kernels of these reach.
    """
    halo, nothing = halo_of(kernel), np.zeros(0, record_type(volume.shape, post=True))
    mask = MaskField.of(volume)
    near = None if mask is None else mask.near(low, high)
    if near is not None and not near.any():
        return nothing
    ends = volume.extent(low, high, halo)
    if ends is not None and not _meets(post, ends):
        return nothing
    samples, first = volume.box(low, high, halo)
    if not _meets(post, samples):
        return nothing
    z, y, x = (slice(a - f, b - f) for a, b, f in zip(low, high, first, strict=True))
    part = Samples(values_of(post, samples), first, (z, y, x))
    if gaps is not None and not np.isfinite(part.u[z, y, x]).all():
        gaps.append(_gaps(part, post))
    return post_records(volume, post, kernel, part, near)


def _meets(post: ValueClassifier, samples: np.ndarray) -> bool:
    """Whether the interval of the samples meets a value that is wanted."""
    finite = samples if samples.dtype.kind in "bui" else samples[np.isfinite(samples)]
    if not finite.size:
        return False
    low, high = post.relative(np.array([finite.min(), finite.max()]))
    return bool(((post.wanted[:, 0] <= high) & (post.wanted[:, 1] >= low)).any())


class Samples(NamedTuple):
    """A part of a volume's samples. u [d, h, w]: record values. first: place (z, y, x) of the first; own: those whose
    records are asked for, within a halo of `halo_of`, as far as the volume goes.
    """

    u: np.ndarray
    first: Places
    own: tuple[slice, slice, slice]


def _gaps(part: Samples, post: ValueClassifier) -> np.ndarray:
    """Places [N, 3] (x, y, z) of missing voxels that kernels reach of those that opaque points need."""
    found = needed(part.u, 1, post.wanted)[1] & np.isfinite(part.u)
    for _ in range(KERNEL_REACH):
        for axis in range(3):
            found = _dilated(found, axis)
    places = np.argwhere((found & ~np.isfinite(part.u))[part.own])
    return np.asarray((places + [a + (each.start or 0) for a, each in zip(part.first, part.own, strict=True)])[:, ::-1])


def gaps_of(volume: Volume, post: ValueClassifier, layers: list[list[Box]]) -> np.ndarray:
    """Places [N, 3] (x, y, z) of missing voxels beside what `post` wants, of samples in memory or mapped; none of
    others, which would be read twice.
    """
    found = [np.zeros((0, 3), np.int64)]
    if isinstance(volume.samples, np.ndarray) and volume.samples.dtype.kind == "f":
        for low, high in (box for layer in layers for box in layer):
            inside = tuple(map(slice, low, high))
            if not np.isfinite(volume.samples[inside]).all():
                samples, first = volume.box(low, high, KERNEL_REACH + 1)
                z, y, x = (slice(a - f, b - f) for a, b, f in zip(low, high, first, strict=True))
                found.append(_gaps(Samples(values_of(post, samples), first, (z, y, x)), post))
    return np.concatenate(found)


def post_splats(volume: Volume, post: ValueClassifier, records: np.ndarray, gaps: np.ndarray | None = None) -> Splats:
    """The splats of records of a volume's voxels. gaps [N, 3]: see `box_records`."""
    grid = Grid(volume.world_from_index, np.asarray(volume.origin))
    found = assemble(records, records["position"], grid, grid.mean_spacing, volume.name).classified_after(post)
    if gaps is None:
        return replace(found, mask=MaskField.of(volume))
    mask = MaskField.with_gaps(volume, gaps)
    return replace(found, mask=mask, unmasked=0 if mask else len(gaps))


def halo_of(kernel: Kernel) -> int:
    """Samples around a box on which the records of its voxels depend."""
    return max(margin_of(kernel), PREFILTERED.get(kernel.name, 0) * STEP_HALO + max(int(kernel.radius), GRADIENT_HALO))


def margin_of(kernel: Kernel) -> int:
    """Samples around a box on which the coefficients of its voxels depend."""
    steps = PREFILTERED.get(kernel.name, 0)
    return (steps - 1) * STEP_HALO + LIMIT_HALO if steps else 0


def post_records(
    volume: Volume,
    post: ValueClassifier,
    kernel: Kernel,
    part: Samples,
    near: np.ndarray | None = None,
) -> np.ndarray:
    """Records, in row order, of the finite voxels that `post` wants among a part's own. near: which of these matter to
    what masks keep; None: all.
    """
    steps = PREFILTERED.get(kernel.name, 0)
    u, first, own = part
    keep, beside = needed(u, 1 if post.lean else int(kernel.radius), post.wanted)
    wanted = keep[own] & np.isfinite(u[own])
    if near is not None:
        wanted &= near
    places = np.nonzero(wanted)
    records = np.zeros(len(places[0]), record_type(volume.shape, post=True))
    if not len(records):
        return records
    margin = margin_of(kernel)
    inside = tuple(place + (part.start or 0) for place, part in zip(places, own, strict=True))
    box = tuple(slice(max(int(i.min()) - margin, 0), int(i.max()) + margin + 1) for i in inside)
    around = post.around if post.faced else None
    values = Values(u, prefiltered(u[box], kernel, steps), beside, tuple(part.start for part in box), around)
    spacing = Grid(volume.world_from_index, np.asarray(volume.origin)).mean_spacing
    world = np.linalg.inv(volume.world_from_index) * spacing
    in_parts(len(records), RECORDS, partial(_fill, records, values, inside, first, world))
    return records


class Values(NamedTuple):
    """u: of the samples. c: coefficients, from the place `start` on. near: see `needed`; around: `gradients`."""

    u: np.ndarray
    c: np.ndarray
    near: np.ndarray
    start: tuple[int, ...]
    around: Around | None


def _fill(
    records: np.ndarray,
    values: Values,
    places: tuple[np.ndarray, ...],
    first: Places,
    world: np.ndarray,
    part: slice,
) -> None:
    """Fills some records, of the voxels at `places` (z, y, x) of a part whose first voxel lies at `first`."""
    z, y, x = (each[part] for each in places)
    found = records[part]
    found["position"] = np.stack([x + first[2], y + first[1], z + first[0]], axis=1)
    value = values.c[z - values.start[0], y - values.start[1], x - values.start[2]]
    # the outermost only contribute beside others: on their own they must not be opaque
    outer = ~values.near[z, y, x]
    value[outer] = np.clip(value[outer], *extremes(values.u, x[outer], y[outer], z[outer]))
    found["value"] = value
    found["gradient"] = gradients(values.u, x, y, z, around=values.around) @ world


def values_of(post: ValueClassifier, samples: np.ndarray) -> np.ndarray:
    """Record values of samples [...], float32; NaN where a sample is not finite."""
    if samples.dtype.kind in "bui" and samples.dtype.itemsize <= TABLE_BYTES:
        kind = samples.dtype if samples.dtype.kind != "b" else np.dtype(np.uint8)
        # in the order of the samples' bits
        table = post.relative(np.arange(2 ** (8 * kind.itemsize)).astype(kind.newbyteorder("=")))
        return np.take(table, samples.astype(kind.newbyteorder("="), copy=False).view(f"u{kind.itemsize}"))
    return post.relative(samples if samples.dtype.kind in "bui" else np.where(np.isfinite(samples), samples, np.nan))


def prefiltered(u: np.ndarray, kernel: Kernel, steps: int) -> np.ndarray:
    """Coefficients whose means by the kernel pass near the samples u [D, H, W]. What is missing, NaN or beyond the
    ends, is left out of means.

    c ← c + u − k∗c/Σk, within `_limits`, so that no mean leaves the range of the samples around it.
    """
    if steps == 0:
        return u
    finite = np.isfinite(u)
    whole = bool(finite.all())
    given = u if whole else np.where(finite, u, np.float32(0))
    weights = np.asarray(kernel.value(np.sqrt(np.arange(4.0))), np.float32)
    weights /= weights @ np.array([1, 6, 12, 8], np.float32)
    mass = (
        1 / _inside(u.shape, weights) if whole else 1 / np.maximum(_smoothed(finite.astype(np.float32), weights), 1e-9)
    )
    limits = None if kernel.name == FREE else _limits(u, whole)
    c = given

    def step(some: slice, mean: np.ndarray) -> None:
        mean *= mass[some]
        np.subtract(given[some], mean, out=mean)
        mean += c[some]
        if limits is not None:
            np.clip(mean, limits[0][some], limits[1][some], out=mean)
        if not whole:
            np.copyto(mean, 0, where=~finite[some])

    for _ in range(steps):
        c = _smoothed(c, weights, step)
    return c if whole else np.where(finite, c, np.float32(np.nan))


def _inside(shape: tuple[int, ...], weights: np.ndarray) -> np.ndarray:
    """[D, H, W]: the share of each voxel's weights that lies within the ends."""
    ends = _smoothed(np.ones([min(size, 3) for size in shape], np.float32), weights)
    index = [np.minimum(np.arange(size), 1) + (np.arange(size) == size - 1) * (size > 2) for size in shape]
    return np.asarray(ends[np.ix_(*index)])


def _smoothed(
    c: np.ndarray, weights: np.ndarray, then: Callable[[slice, np.ndarray], None] | None = None
) -> np.ndarray:
    """Sum over 3×3×3 neighbours by `weights` of how many coordinates differ, 0 beyond the ends; in chunks of planes,
    side by side. then: changes a chunk in place.
    """
    w0, w1, w2, w3 = weights
    total = np.empty_like(c)

    def smooth(some: slice) -> None:
        first = max(some.start - 1, 0)
        part, own = c[first : some.stop + 1], slice(some.start - first, some.stop - first)
        term, beside = np.empty_like(part), _beside(part, 2, np.empty_like(part))
        same, one, two = part * w0, part * w1, part * w2
        same += np.multiply(beside, w1, out=term)
        one += np.multiply(beside, w2, out=term)
        two += np.multiply(beside, w3, out=term)
        same += _beside(one, 1, term)
        one += _beside(two, 1, term)
        np.add(same[own], _beside(one, 0, term)[own], out=total[some])
        if then is not None:
            then(some, total[some])

    in_parts(len(c), _planes_of(c), smooth)
    return total


def _planes_of(c: np.ndarray) -> int:
    """Planes of a chunk."""
    return max(1, CHUNK_VOXELS // max(c[0].size, 1))


def _beside(a: np.ndarray, axis: int, total: np.ndarray) -> np.ndarray:
    """`total`, set to the sum of both neighbours along an axis, 0 beyond the ends."""
    a, sums = np.moveaxis(a, axis, 0), np.moveaxis(total, axis, 0)
    np.add(a[:-2], a[2:], out=sums[1:-1])
    if len(a) > 1:
        sums[0], sums[-1] = a[1], a[-2]
    else:
        sums[0] = 0
    return total


def _limits(u: np.ndarray, whole: bool) -> tuple[np.ndarray, np.ndarray]:
    """Least and greatest coefficients [D, H, W]: of the samples u among the 26 neighbours, and beyond them what a peak,
    a peak between two samples, or a wave needs along each axis. At steps, terraces and sheets of two voxels that is 0:
    there, coefficients beyond the samples would show values that are nowhere.
    """
    low, high = np.empty_like(u), np.empty_like(u)

    def limit(some: slice) -> None:
        first = max(some.start - LIMIT_HALO, 0)
        part, own = u[first : some.stop + LIMIT_HALO], slice(some.start - first, some.stop - first)
        gone = None if whole else np.isnan(part)
        least, most = part, part
        if gone is not None:
            least, most = (np.where(gone, np.float32(end), part) for end in (np.inf, -np.inf))
        for axis in range(3):
            least, most = _extreme(np.minimum, least, axis), _extreme(np.maximum, most, axis)
        for axis in range(3):
            _widen(least, most, part, gone, axis)
        low[some], high[some] = least[own], most[own]

    # larger chunks, as each is read with a halo
    in_parts(len(u), 2 * _planes_of(u), limit)
    return low, high


def _widen(least: np.ndarray, most: np.ndarray, u: np.ndarray, gone: np.ndarray | None, axis: int) -> None:
    """Lowers the least and raises the greatest coefficients for what varies along an axis. gone: missing samples."""
    a, low, high = (np.moveaxis(each, axis, 0) for each in (u, least, most))
    # to the next sample, 0 to missing ones, with two before and behind
    rise = np.zeros((len(a) + 5, *a.shape[1:]), u.dtype)
    np.subtract(a[1:], a[:-1], out=rise[3:-3])
    if gone is not None:
        np.copyto(rise, 0, where=np.isnan(rise))
    bend = rise[1:] - rise[:-1]
    for sign, ends, change in ((1, low, np.subtract), (-1, high, np.add)):
        # a sample that is a peak, up or down
        if sign > 0:
            peak = np.minimum(rise[3:-2], np.negative(rise[2:-3]))
            pair = np.minimum(bend[1:-2], bend[2:-1])
            outer = np.minimum(bend[:-3], bend[3:])
            pair += np.minimum(outer, 0, out=outer)
        else:
            peak = np.minimum(rise[2:-3], np.negative(rise[3:-2]))
            pair = np.maximum(bend[1:-2], bend[2:-1])
            outer = np.maximum(bend[:-3], bend[3:])
            pair += np.maximum(outer, 0, out=outer)
            np.negative(pair, out=pair)
        np.maximum(peak, 0, out=peak)
        peak *= PEAK
        change(ends, peak, out=ends)
        # two that bend alike, less what bends otherwise beside them
        both = np.maximum(pair[:-1], pair[1:])
        np.maximum(both, 0, out=both)
        both *= PAIR
        change(ends, both, out=ends)
    # a wave bends everywhere, and its neighbours do
    wave = np.abs(bend[2:-2])
    if gone is not None:
        np.copyto(wave, np.float32(1e30), where=np.moveaxis(gone, axis, 0))
    for each in (0, 0, 1, 2):
        wave = _extreme(np.minimum, wave, each)
    wave *= WAVE
    low -= wave
    high += wave


def _extreme(of: np.ufunc, a: np.ndarray, axis: int) -> np.ndarray:
    """The least or the greatest of each voxel and its neighbours along an axis."""
    a = np.moveaxis(a, axis, 0)
    if len(a) < 3:
        return np.moveaxis(np.repeat(of.reduce(a, axis=0)[None], len(a), axis=0), 0, axis)
    found, two = np.empty_like(a), of(a[1:], a[:-1])
    of(two[1:], two[:-1], out=found[1:-1])
    found[0], found[-1] = two[0], two[-1]
    return np.moveaxis(found, 0, axis)


def needed(u: np.ndarray, around: int, wanted: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Where the interval of u around a voxel meets one of `wanted` [n, 2], bool; and where that of its 26 neighbours
    does.

    around 1: over these; 2: also over those two steps along one axis, whose shares of points that the voxel reaches
    matter.
    """
    keep, near = np.zeros(u.shape, bool), np.zeros(u.shape, bool)
    for start, end in wanted.astype(np.float64).tolist():
        above, below = u >= np.float64(start), u <= np.float64(end)
        for axis in range(3):
            above, below = _dilated(above, axis), _dilated(below, axis)
        near |= above & below
        for axis in range(3) if around > 1 else ():
            keep |= _dilated(above, axis) & _dilated(below, axis)
    return keep | near, near


def _dilated(mask: np.ndarray, axis: int) -> np.ndarray:
    """Where it, or a neighbour along an axis, is True."""
    a = np.moveaxis(mask, axis, 0)
    found = a.copy(order="K")
    found[1:] |= a[:-1]
    found[:-1] |= a[1:]
    return np.moveaxis(found, 0, axis)


def extremes(u: np.ndarray, x: np.ndarray, y: np.ndarray, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The smallest and the largest u [N] among each voxel and its 26 neighbours."""
    low, high = np.full(len(x), np.inf, u.dtype), np.full(len(x), -np.inf, u.dtype)
    for step in np.ndindex(3, 3, 3):
        at = (np.clip(i + n - 1, 0, size - 1) for i, n, size in zip((z, y, x), step, u.shape, strict=True))
        value = u[tuple(at)]
        np.fmin(low, value, out=low)
        np.fmax(high, value, out=high)
    return low, high


def gradients(
    u: np.ndarray,
    x: np.ndarray,
    y: np.ndarray,
    z: np.ndarray,
    order: int = 4,
    around: Around | None = None,
) -> np.ndarray:
    """[N, 3] per grid step along x, y, z: differences of that order, 4 or 2; central ones where a sample is missing,
    one-sided ones at the edges. around: of u [N], what to take for what is missing beside opaque voxels, and which
    these are.
    """
    flat = u.ravel()
    base = (z * u.shape[1] + y) * u.shape[2] + x
    center = flat[base].astype(np.float64)
    gradient, gone = np.zeros((len(center), 3)), np.zeros((2, len(center), 3), bool)
    outside, opaque = around(center) if around else (center, np.zeros(len(center), bool))
    for axis, (index, stride) in enumerate(((x, 1), (y, u.shape[2]), (z, u.shape[1] * u.shape[2]))):
        last = u.shape[2 - axis] - 1
        if order == 4 and len(index) and index.min() >= 2 and index.max() <= last - 2:
            before, below, above, after = (np.take(flat, base + n * stride).astype(np.float64) for n in (-2, -1, 1, 2))
            gradient[:, axis] = (8 * (above - below) - (after - before)) / 12
            if np.isfinite(gradient[:, axis]).all():
                continue
        at = {}
        for step in (-2, -1, 1, 2):
            value = flat[base + (np.clip(index + step, 0, last) - index) * stride].astype(np.float64)
            value[(index + step < 0) | (index + step > last)] = np.nan
            at[step] = value
        gone[:, :, axis] = ~np.isfinite(at[-1]), ~np.isfinite(at[1])
        filled = outside != center
        alone = filled & gone[:, :, axis].all(axis=0)
        for value in at.values():
            np.copyto(value, outside, where=filled & ~np.isfinite(value))
        # of a single plane both faces are the same
        gradient[:, axis] = np.where(alone, center - outside, _difference(at, center, order))
    return faced(gradient, gone, opaque) if gone.any() else gradient


def _difference(at: dict[int, np.ndarray], center: np.ndarray, order: int) -> np.ndarray:
    """Differences [N] of that order of values at steps from centres; central or one-sided ones where some are NaN."""
    below, above = np.isfinite(at[-1]), np.isfinite(at[1])
    low, high = np.where(below, at[-1], center), np.where(above, at[1], center)
    first = (high - low) / np.maximum(below.astype(int) + above, 1)
    fourth = (8 * (at[1] - at[-1]) - (at[2] - at[-2])) / 12 if order == 4 else first
    return np.where(np.isfinite(fourth), fourth, first)
