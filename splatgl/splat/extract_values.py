"""Extraction of values and gradients, which are classified after reconstruction.

A point's value is a mean of the coefficients around it. A voxel is kept if the interval of the samples within the
kernel's reach contains a value of non-zero opacity and, where only steep places have one, gradients around it are as
steep; the others only contribute to transparent points, which only blends of one value show.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import islice, pairwise, product
from typing import Any, NamedTuple

import numpy as np

from splatgl.data.volume import Places, Volume
from splatgl.geometry.grid import Grid, dilate
from splatgl.geometry.mask_field import MaskField
from splatgl.splat.kernels import Kernel
from splatgl.splat.prefilter import PREFILTERED, STEP_HALO, coefficients, extreme_filter, margin_of, prefilter
from splatgl.splat.splats import GrowingRecords, Splats, assemble, in_parts, join_records, record_type
from splatgl.transfer.preintegration import ValueClassifier, clear_isolated

# integer types up to this many bytes take their record values from a table
TABLE_BYTES = 2
# records filled, and about as many samples tabulated, at a time: their temporaries stay in the cache
RECORDS, TABULATED = 1 << 14, 1 << 15
# planes of a slab that make its halo cheap
THICK = 32
# planes around a slab that differences read
GRADIENT_HALO = 2

# reach of the kernels for values, in whole voxels
KERNEL_REACH = 2
# voxels from one to the furthest that adds to a gradient with it
STEEP_REACH = 2 * KERNEL_REACH
# share of the range of the samples around a place by which its value may exceed them: of uniform noise by 0.13
OVERSHOOT = 0.15
# voxels from samples beside places of values that a maximum may show: those that these places depend on; and those
# around, which have no higher coefficients than the samples beside them, so that no mean of a part of them is higher
NEAR_LARGEST = 1 + KERNEL_REACH
AROUND_LARGEST = NEAR_LARGEST + KERNEL_REACH
# coefficients on either side on which one of a gradient depends
TAPS = 5
# share of the largest record value by which rounding may change a gradient, per voxel
ROUNDED = 1e-6

# maps record values [N] to the values of missing neighbours, and whether the former are opaque
Around = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]
# (low, high) of a box of voxels, z, y, x
Box = tuple[Places, Places]
# bool [d, h, w]: which voxels of a box are left out
IsHidden = Callable[[Places, Places], np.ndarray]
Progress = Callable[[Iterator[Any], int], Iterator[Any]]


def extract_post(
    volume: Volume,
    post: ValueClassifier,
    kernel: Kernel,
    voxels: int,
    progress: Progress | None = None,
    hidden: IsHidden | None = None,
) -> Splats:
    """Splats of value and gradient, in row order, of all finite voxels that `post` wants.

    voxels: about how many to read at a time; records do not depend on it. hidden: of a box; these voxels are left out.
    """
    gathered = GrowingRecords(record_type(volume.shape, post=True))
    layers = boxes(volume.shape, voxels)
    count = sum(map(len, layers))
    all_boxes = (box for layer in layers for box in layer)
    remaining = progress(all_boxes, count) if progress else all_boxes
    gaps: list[np.ndarray] = [np.zeros((0, 3), np.int64)]
    for layer in layers:
        parts = [box_records(volume, post, kernel, box, gaps, hidden) for box in islice(remaining, len(layer))]
        records = parts[0]
        if len(parts) > 1:
            # boxes are in row order; merge their planes
            records = join_records(parts)
            records = np.take(records, np.argsort(records["position"][:, 2], kind="stable"))
        gathered.add(records)
    return post_splats(volume, post, gathered.records, np.concatenate(gaps))


def boxes(shape: tuple[int, int, int], voxels: int) -> list[list[Box]]:
    """Boxes of whole rows and about `voxels` voxels that cover a volume, in layers along z.

    Whole planes if THICK of them fit; else as many planes as rows, which minimizes the halo.
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
    box: Box,
    gaps: list[np.ndarray] | None = None,
    hidden: IsHidden | None = None,
) -> np.ndarray:
    """Records, in row order, of the voxels low ≤ (z, y, x) < high of a box that `post` wants, but hidden ones. Boxes
    known to hold none are not read. Appends to `gaps` the places [N, 3] (x, y, z) of missing voxels within reach of
    their kernels.
    """
    nothing = np.zeros(0, record_type(volume.shape, post=True))
    halo = max(halo_of(kernel), AROUND_LARGEST * post.largest)
    if not post.faced:
        halo = max(halo, margin_of(kernel) + TAPS + STEEP_REACH * bool(post.steepness.any()))
    mask = MaskField.of(volume)
    near = None if mask is None else mask.near(*box)
    if hidden is not None:
        near = ~hidden(*box) if near is None else near & ~hidden(*box)
    if near is not None:
        if not near.any():
            return nothing
        if gaps is None or volume.samples.dtype.kind != "f":
            near, box = _without_margins(near, box)
    low, high = box
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


def _without_margins(near: np.ndarray, box: Box) -> tuple[np.ndarray, Box]:
    """The smallest part of a box that holds all voxels `near`, bool [d, h, w], some of which are; and its ends."""
    rows: np.ndarray = np.asarray(near.any(axis=2))
    lines: tuple[Any, ...] = rows.any(axis=1), rows.any(axis=0), near.any(axis=(0, 1))
    z, y, x = (slice(int(line.argmax()), len(line) - int(line[::-1].argmax())) for line in lines)
    low: Any = tuple(a + side.start for a, side in zip(box[0], (z, y, x), strict=True))
    high: Any = tuple(a + side.stop for a, side in zip(box[0], (z, y, x), strict=True))
    return near[z, y, x], (low, high)


def _meets(post: ValueClassifier, samples: np.ndarray) -> bool:
    """Whether the interval of the samples contains a wanted value."""
    if not samples.size:
        return False
    ends = samples.min(), samples.max()
    if not np.isfinite(ends).all():
        finite = samples[np.isfinite(samples)]
        if not finite.size:
            return False
        ends = finite.min(), finite.max()
    low, high = post.relative(np.array(ends))
    high += OVERSHOOT * (high - low) * post.largest
    return bool(((post.wanted[:, 0] <= high) & (post.wanted[:, 1] >= low)).any())


class Samples(NamedTuple):
    """Part of a volume. u [d, h, w]: record values. first: place (z, y, x) of the first voxel. own: the part without
    its halo.
    """

    u: np.ndarray
    first: Places
    own: tuple[slice, slice, slice]


def _gaps(part: Samples, post: ValueClassifier) -> np.ndarray:
    """Places [N, 3] (x, y, z) of missing voxels within reach of the kernels of voxels that opaque points need."""
    reached = select_needed(part.u, 1, post.wanted)[1] & np.isfinite(part.u)
    for _ in range(KERNEL_REACH):
        reached = dilate(reached)
    places = np.argwhere((reached & ~np.isfinite(part.u))[part.own])
    return np.asarray((places + [a + (axis.start or 0) for a, axis in zip(part.first, part.own, strict=True)])[:, ::-1])


def gaps_of(volume: Volume, post: ValueClassifier, layers: list[list[Box]]) -> np.ndarray:
    """Places [N, 3] (x, y, z) of missing voxels beside those that `post` wants. Only of samples in memory or mapped:
    others would be read twice.
    """
    gaps = [np.zeros((0, 3), np.int64)]
    if isinstance(volume.samples, np.ndarray) and volume.samples.dtype.kind == "f":
        for low, high in (box for layer in layers for box in layer):
            inside = tuple(map(slice, low, high))
            if not np.isfinite(volume.samples[inside]).all():
                samples, first = volume.box(low, high, KERNEL_REACH + 1)
                z, y, x = (slice(a - f, b - f) for a, b, f in zip(low, high, first, strict=True))
                gaps.append(_gaps(Samples(values_of(post, samples), first, (z, y, x)), post))
    return np.concatenate(gaps)


def post_splats(volume: Volume, post: ValueClassifier, records: np.ndarray, gaps: np.ndarray | None = None) -> Splats:
    """Splats made of a volume's records. gaps [N, 3]: see `box_records`."""
    grid = Grid.of(volume)
    splats = assemble(records, records["position"], grid, grid.mean_spacing, volume.name).with_classifier(post)
    if gaps is None:
        return replace(splats, mask=MaskField.of(volume))
    mask = MaskField.with_gaps(volume, gaps)
    return replace(splats, mask=mask, missing_samples=0 if mask else len(gaps))


def halo_of(kernel: Kernel) -> int:
    """Samples around a box on which the records of its voxels depend."""
    return max(margin_of(kernel), PREFILTERED.get(kernel.name, 0) * STEP_HALO + max(int(kernel.radius), GRADIENT_HALO))


def post_records(
    volume: Volume, post: ValueClassifier, kernel: Kernel, part: Samples, near: np.ndarray | None = None
) -> np.ndarray:
    """Records, in row order, of the finite voxels that `post` wants in a part without its halo. near: which of these
    affect places that are seen; None: all.
    """
    u, first, inner = part
    spacing, reach = Grid.of(volume).mean_spacing, 1 if post.lean else int(kernel.radius)
    world = np.linalg.inv(volume.world_from_index) * spacing
    slopes = is_steep = None
    if not post.faced:
        slopes = field_slopes(u, kernel, world)
        is_steep = _steep_places(u, slopes, world, post.steepness * spacing)
    # maxima, of which no other picture is made, have no normals
    is_maximum = post.largest and not post.every
    if is_maximum:
        keep, beside = around_largest(u, float(post.wanted[0, 0]))
    else:
        keep, beside = select_needed(u, reach, post.wanted, is_steep)
    wanted = keep[inner] & np.isfinite(u[inner])
    if near is not None:
        wanted &= near
    start = inner[0].start or 0, inner[1].start or 0, inner[2].start or 0
    rows, height = wanted.reshape(-1, wanted.shape[2]), wanted.shape[1]
    ends = np.concatenate([[0], np.cumsum(np.count_nonzero(rows, axis=1))])
    records = np.zeros(int(ends[-1]), record_type(volume.shape, post=True))
    if not len(records):
        return records
    around = post.around if post.faced else None
    values = RecordValues(u, *coefficients(u, kernel, wanted, start), beside, around, slopes, is_maximum)
    # whole rows of voxels, about RECORDS of which are wanted
    firsts = np.searchsorted(ends, np.arange(0, len(records), RECORDS), side="right") - 1
    breaks = [*dict.fromkeys(firsts.tolist()), len(rows)]

    def fill(which: slice) -> None:
        for first_row, last_row in pairwise(breaks[which.start : which.stop + 1]):
            row, x = np.nonzero(rows[first_row:last_row])
            z, y = np.divmod(row + first_row, height)
            places = z + start[0], y + start[1], x + start[2]
            _fill(records[ends[first_row] : ends[last_row]], values, places, first, world)

    in_parts(len(breaks) - 1, 1, fill)
    return records


def _steep_places(
    u: np.ndarray, slopes: np.ndarray, world: np.ndarray, least: np.ndarray
) -> Callable[[int], np.ndarray] | None:
    """Returns a function of an interval's number: bool [d, h, w], voxels near which gradients of `least` [n] per mean
    spacing may be reconstructed, as means of those of the voxels around; None if any gradient will do. slopes: of
    samples u, as of `field_slopes` with `world`.
    """
    if not least.any():
        return None
    rounded = ROUNDED * float(np.nanmax(np.abs(u))) * np.abs(world).sum()

    def near(number: int) -> np.ndarray:
        steep = slopes >= max(least[number] - rounded, 0.0)
        for _ in range(STEEP_REACH if least[number] else 0):
            steep = dilate(steep)
        return steep

    return near


def field_slopes(u: np.ndarray, kernel: Kernel, world: np.ndarray) -> np.ndarray:
    """float32 [D, H, W]: magnitudes of gradients at samples u whose kernel means are near those of the field; NaN at
    missing samples. world: turns differences per grid step along x, y, z to world axes. Beyond the ends samples go on
    point-symmetrically; beside missing ones, magnitudes are of differences of samples.
    """
    weights, margin, finite = derivative_weights(kernel).tolist(), margin_of(kernel), np.isfinite(u)
    c = prefilter(np.pad(u, margin + TAPS, mode="reflect", reflect_type="odd"), kernel)
    inner = [slice(margin + TAPS, margin + TAPS + size) for size in u.shape]
    gradient = np.zeros((3, *u.shape), np.float32)
    for axis, along in enumerate(gradient[::-1]):
        for step, weight in enumerate(weights, 1):
            sides = [
                tuple(slice(a.start + n, a.stop + n) if i == axis else a for i, a in enumerate(inner))
                for n in (step, -step)
            ]
            along += np.float32(weight) * (c[sides[0]] - c[sides[1]])
    slopes = np.sqrt(np.square(np.tensordot(world.T.astype(np.float32), gradient, 1)).sum(axis=0))
    if not finite.all():
        beside = ~finite
        for _ in range(max(margin, TAPS)):
            beside = dilate(beside)
        z, y, x = np.nonzero(beside & finite)
        slopes[z, y, x] = np.linalg.norm(gradients(u, x, y, z) @ world, axis=1)
        slopes[~finite] = np.nan
    return slopes


def with_slopes(gradient: np.ndarray, slopes: np.ndarray) -> np.ndarray:
    """Gradients [N, 3] with magnitudes [N]: lighting keeps the directions that are smooth."""
    length = np.linalg.norm(gradient, axis=1)
    return np.asarray(gradient * (slopes / np.where(length > 0, length, 1.0))[:, None])


def derivative_weights(kernel: Kernel) -> np.ndarray:
    """[TAPS]: weights of the differences between the coefficients 1, 2, … steps behind and before one, whose kernel
    sums are the nearest to the derivative of the kernel sum of coefficients, and exact for cubics.
    """
    x = np.linspace(-TAPS, TAPS, 32 * TAPS * 2 + 1) * 1.5
    steps = np.arange(1.0, TAPS + 1)
    terms = np.stack([kernel.value(np.abs(x + n)) - kernel.value(np.abs(x - n)) for n in steps], axis=1)
    exact = np.stack([steps, steps**3])
    system = np.block([[terms.T @ terms, exact.T], [exact, np.zeros((2, 2))]])
    slope = np.gradient(kernel.value(np.abs(x)), x)
    return np.asarray(np.linalg.solve(system, np.concatenate([terms.T @ slope, [0.5, 0.0]]))[:TAPS])


class RecordValues(NamedTuple):
    """u: record values of the samples. c: coefficients, from place `start` on. near: see `select_needed`. around: see
    `gradients`. slopes: as of `field_slopes`, if opacity depends on gradients. is_flat: whether gradients stay 0.
    """

    u: np.ndarray
    c: np.ndarray
    start: Places
    near: np.ndarray
    around: Around | None
    slopes: np.ndarray | None
    is_flat: bool


def _fill(
    filled: np.ndarray, values: RecordValues, places: tuple[np.ndarray, ...], first: Places, world: np.ndarray
) -> None:
    """Fills records of the voxels at `places` (z, y, x) of a part whose first voxel lies at `first`."""
    z, y, x = places
    for axis, place in enumerate((x, y, z)):
        np.add(place, first[2 - axis], out=filled["position"][:, axis], casting="unsafe")
    value = np.take(values.c, _flat(values.c, z, y, x) - _flat(values.c, *values.start))
    # the outermost only contribute beside others: alone they must not be opaque
    outer = np.flatnonzero(~np.take(values.near, _flat(values.near, z, y, x)))
    value[outer] = np.clip(value[outer], *extremes(values.u, x[outer], y[outer], z[outer]))
    filled["value"] = value
    if values.is_flat:
        return
    gradient = (world.T @ gradients(values.u, x, y, z, around=values.around).T).T
    filled["gradient"] = gradient if values.slopes is None else with_slopes(gradient, values.slopes[z, y, x])


def _flat(a: np.ndarray, z: Any, y: Any, x: Any) -> Any:
    """Places in a flattened array [D, H, W], which are found faster than by three indices."""
    return (z * a.shape[1] + y) * a.shape[2] + x


def tabulate(samples: np.ndarray, of: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
    """`of` samples [...], from a table of integers of few bytes; `of` takes NaN where a sample is not finite."""
    bits = samples if samples.dtype.kind != "b" else samples.view(np.uint8)
    is_integer, kind = bits.dtype.kind in "ui", bits.dtype.newbyteorder("=")
    table = None
    if is_integer and kind.itemsize <= TABLE_BYTES:
        # in the order of the samples' bits
        table = of(np.arange(2 ** (8 * kind.itemsize)).astype(kind))

    def part_of(part: np.ndarray) -> np.ndarray:
        if table is None:
            return of(part if is_integer else np.where(np.isfinite(part), part, np.nan))
        return np.take(table, part.astype(kind, copy=False).view(f"u{kind.itemsize}"))

    result = np.empty(bits.shape, part_of(bits[:0]).dtype)

    def fill(planes: slice) -> None:
        result[planes] = part_of(bits[planes])

    in_parts(len(bits), max(TABULATED * len(bits) // max(bits.size, 1), 1), fill)
    return result


def values_of(post: ValueClassifier, samples: np.ndarray) -> np.ndarray:
    """Record values of samples [...], float32; NaN where a sample is not finite."""
    return tabulate(samples, post.relative)


def select_needed(
    u: np.ndarray, around: int, wanted: np.ndarray, places: Callable[[int], np.ndarray] | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """bool, twice: where the interval of u within `around` of a voxel meets one of `wanted` [n, 2]; and where that of
    its 26 neighbours does.

    around: 1: the 26 neighbours; 2: also voxels two steps along one axis. places: of an interval's number, to which
    the former is limited.
    """
    keep, near = np.zeros(u.shape, bool), np.zeros(u.shape, bool)
    for number, (start, end) in enumerate(wanted.astype(np.float64).tolist()):
        above, below = dilate(u >= np.float64(start)), dilate(u <= np.float64(end))
        beside = above & below
        near |= beside
        for axis in range(3) if around > 1 else ():
            beside |= dilate(above, (axis,)) & dilate(below, (axis,))
        keep |= beside if places is None else beside & places(number)
    return keep, near


def around_largest(u: np.ndarray, least: float) -> tuple[np.ndarray, np.ndarray]:
    """bool, twice: the voxels within AROUND_LARGEST of places that may have at least this value, and those within
    NEAR_LARGEST.
    """
    low = high = u
    for axis in range(3):
        low, high = extreme_filter(np.fmin, low, axis), extreme_filter(np.fmax, high, axis)
    # of a voxel and its neighbours
    near = high + np.float32(OVERSHOOT) * (high - low) >= np.float64(least)
    for _ in range(NEAR_LARGEST - 1):
        near = dilate(near)
    keep = near
    for _ in range(AROUND_LARGEST - NEAR_LARGEST):
        keep = dilate(keep)
    return keep, near


def extremes(u: np.ndarray, x: np.ndarray, y: np.ndarray, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The smallest and the largest u [N] among each voxel and its 26 neighbours."""
    low, high = np.full(len(x), np.inf, u.dtype), np.full(len(x), -np.inf, u.dtype)
    flat, strides = u.ravel(), (u.shape[1] * u.shape[2], u.shape[2], 1)
    rows, columns, steps = (
        [np.clip(i + n, 0, size - 1) * stride for n in (-1, 0, 1)]
        for i, size, stride in zip((z, y, x), u.shape, strides, strict=True)
    )
    for row, column, step in product(rows, columns, steps):
        value = np.take(flat, row + column + step)
        np.fmin(low, value, out=low)
        np.fmax(high, value, out=high)
    return low, high


def gradients(
    u: np.ndarray, x: np.ndarray, y: np.ndarray, z: np.ndarray, order: int = 4, around: Around | None = None
) -> np.ndarray:
    """[N, 3] per grid step along x, y, z: differences of order 4 or 2, central where a sample is missing, one-sided at
    the edges. around: maps u [N] to the values of missing neighbours, and to whether u is opaque.
    """
    flat, reach, base = u.ravel(), order // 2, _flat(u, z, y, x)
    # components in rows of memory
    gradient, hard = np.zeros((3, len(base))).T, np.zeros(len(base), bool)
    for axis, (index, stride) in enumerate(((x, 1), (y, u.shape[2]), (z, u.shape[1] * u.shape[2]))):
        steps = (*range(-reach, 0), *range(1, reach + 1))
        at = {step: np.take(flat, base + step * stride, mode="clip") for step in steps}
        gradient[:, axis] = _central_difference(at, order)
        hard |= ~np.isfinite(gradient[:, axis])
        hard |= (index < reach) | (index >= u.shape[2 - axis] - reach)
    some = np.flatnonzero(hard)
    if len(some):
        gradient[some] = _gradients_beside_gaps(u, (x[some], y[some], z[some]), order, around)
    return gradient


def _gradients_beside_gaps(
    u: np.ndarray, places: tuple[np.ndarray, ...], order: int, around: Around | None
) -> np.ndarray:
    """`gradients` of voxels x, y, z whose neighbours may be missing, or beyond the ends."""
    flat, reach, base = u.ravel(), order // 2, _flat(u, *places[::-1])
    center = flat[base].astype(np.float64)
    gradient, gone = np.zeros((3, len(center))).T, np.zeros((2, len(center), 3), bool)
    outside, opaque = around(center) if around else (center, np.zeros(len(center), bool))
    filled = outside != center
    for axis, (index, stride) in enumerate(zip(places, (1, u.shape[2], u.shape[1] * u.shape[2]), strict=True)):
        at = {}
        for step in (*range(-reach, 0), *range(1, reach + 1)):
            moved = np.clip(index + step, 0, u.shape[2 - axis] - 1) - index
            at[step] = np.where(moved == step, np.take(flat, base + moved * stride).astype(np.float64), np.nan)
        gone[:, :, axis] = ~np.isfinite(at[-1]), ~np.isfinite(at[1])
        alone = filled & gone[:, :, axis].all(axis=0)
        for value in at.values():
            np.copyto(value, outside, where=filled & ~np.isfinite(value))
        # both faces of a single plane are alike
        gradient[:, axis] = np.where(alone, center - outside, _difference(at, center, order))
    return clear_isolated(gradient, gone, opaque)


def _central_difference(at: dict[int, np.ndarray], order: int) -> np.ndarray:
    """Differences [N] of order 4 or 2 from values at steps −2 … 2; NaN where a value is."""
    difference = np.subtract(at[1], at[-1], dtype=np.float64)
    if order == 4:
        difference *= 8
        difference -= np.subtract(at[2], at[-2], dtype=np.float64)
    difference /= 12 if order == 4 else 2
    return difference


def _difference(at: dict[int, np.ndarray], center: np.ndarray, order: int) -> np.ndarray:
    """Differences [N] of order 4 or 2; of lower order where values are NaN."""
    below, above = np.isfinite(at[-1]), np.isfinite(at[1])
    low, high = np.where(below, at[-1], center), np.where(above, at[1], center)
    first = (high - low) / np.maximum(below.astype(int) + above, 1)
    fourth = _central_difference(at, 4) if order == 4 else first
    return np.where(np.isfinite(fourth), fourth, first)
