"""Samples of volumes between voxels: cubic convolution, which passes through the samples; labels by the nearest voxel.

A cubic of four samples along each axis [Keys, IEEE ASSP 29(6), 1981, a = −½] is exact for linear and quadratic fields.
Up to half a voxel beyond the outer samples, they are continued linearly. Missing samples are left out: what lies
nearest to one is missing.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from splatgl.data.volume import Volume
from splatgl.geometry.grid import Grid

# samples around a place that contribute, on each side
REACH = 2
# places at a time, and the most voxels of the box around them
PLACES, VOXELS = 1 << 16, 1 << 24
# distance from a line along an axis, in voxels, that is rounding
STRAIGHT = 1e-9
# a place on the box's face, in voxels beyond it
ON_FACE = 1e-6
# voxels beyond the box to which samples are continued: REACH ends there
BEYOND = 0.499


@dataclass(frozen=True, eq=False)
class Raster:
    """Grid positions (x, y, z) in rows: start [3] of the first, and steps [3] to the next along a row and down."""

    start: np.ndarray
    across: np.ndarray
    down: np.ndarray
    size: tuple[int, int]

    @property
    def places(self) -> np.ndarray:
        """float64 [H · W, 3], row by row."""
        column, row = np.meshgrid(np.arange(self.size[0]), np.arange(self.size[1]))
        flat = self.start + column[..., None] * self.across + row[..., None] * self.down
        return np.asarray(flat.reshape(-1, 3))

    @property
    def axes(self) -> tuple[int, int] | None:
        """The grid axes of rows and columns, if both are parallel to one; else None."""
        a, b = (int(np.abs(step).argmax()) for step in (self.across, self.down))
        rest = np.abs(np.concatenate([np.delete(self.across, a), np.delete(self.down, b)])).max()
        return (a, b) if a != b and rest * max(self.size) < STRAIGHT else None

    @property
    def is_whole(self) -> bool:
        """Whether all are the middles of voxels."""
        steps = np.concatenate([self.across, self.down]) * max(self.size)
        off = np.concatenate(
            [self.start - np.rint(self.start), steps - np.rint(steps / max(self.size)) * max(self.size)]
        )
        return self.axes is not None and bool(np.abs(off).max() < ON_FACE)


def sample_raster(
    volume: Volume, raster: Raster, nearest: bool = False, beyond: float = 0.0
) -> tuple[np.ndarray, np.ndarray]:
    """Values float64 [H, W], or sRGB from 0 to 1 [H, W, 3], and bool [H, W]: where they are known, as
    `sample_places`. Rows along an axis take a few steps for each row and column, and no more voxels than they show
    where these are the nearest, or the places are voxels.
    """
    width, height = raster.size
    axes = raster.axes
    if axes is None:
        values, known = sample_places(volume, raster.places, nearest, beyond)
        return values.reshape(height, width, *values.shape[1:]), known.reshape(height, width)
    # one place along each row, column, and across both
    lines = [raster.start[[axis]] for axis in range(3)]
    lines[axes[0]] = raster.start[axes[0]] + np.arange(width) * raster.across[axes[0]]
    lines[axes[1]] = raster.start[axes[1]] + np.arange(height) * raster.down[axes[1]]
    inside = [_inside(line, size, beyond) for line, size in zip(lines, volume.shape[::-1], strict=True)]
    of_labels = nearest and volume.color is None
    nearest = nearest or raster.is_whole
    kind = volume.samples.dtype if of_labels else np.dtype(np.float64)
    values = np.zeros((height, width, *([3] if volume.color is not None else [])), kind)
    known = np.zeros((height, width), bool)
    if not all(some.any() for some in inside):
        return values, known
    lines = [line[some] for line, some in zip(lines, inside, strict=True)]
    box = PaddedBox.around(volume, [line.min() for line in lines], [line.max() for line in lines], nearest)
    z, y, x = (box.nearest(line, axis) for axis, line in reversed(list(enumerate(lines))))
    seen = box.known[np.ix_(z, y, x)]
    part = box.values[np.ix_(z, y, x)] if nearest else box.values
    for axis, line in enumerate([] if nearest else lines):
        part = _weigh(part, line - box.first[axis], 2 - axis)
    order = [2 - axes[1], 2 - axes[0]]
    order = [*order, 3 - sum(order)]
    part = part.transpose(*order, *range(3, part.ndim))[:, :, 0]
    seen = seen.transpose(order)[:, :, 0]
    column, row = (int(inside[axis].argmax()) for axis in axes)
    shown = np.s_[row : row + len(part), column : column + part.shape[1]]
    values[shown], known[shown] = part, seen
    if nearest and not known.all():
        # NaN
        values[~known] = 0
    return values, known


def sample_places(
    volume: Volume, places: np.ndarray, nearest: bool = False, beyond: float = 0.0
) -> tuple[np.ndarray, np.ndarray]:
    """Values float64 [P], or sRGB from 0 to 1 [P, 3], at grid positions [P, 3] (x, y, z), and bool [P]: whether they
    are known: in the volume's box or up to `beyond` voxels (BEYOND at most) around it, in its masks, and not nearest to
    a missing sample. nearest: of the nearest voxels.
    """
    values = np.zeros((len(places), *([3] if volume.color is not None else [])))
    if nearest and volume.color is None:
        values = np.zeros(len(places), volume.samples.dtype)
    known = np.logical_and.reduce([_inside(places[:, axis], volume.shape[2 - axis], beyond) for axis in range(3)])
    for some in np.array_split(np.flatnonzero(known), -(-int(known.sum()) // PLACES) or 1):
        for part in _parts(volume, places, some):
            values[part], known[part] = _sample_part(volume, places[part], nearest)
    return values, known


def _parts(volume: Volume, places: np.ndarray, some: np.ndarray) -> list[np.ndarray]:
    """The indices [P] in parts, around each of which lie at most VOXELS."""
    if not len(some):
        return []
    sides = np.ptp(places[some], axis=0) + 2 * REACH + 1
    if len(some) == 1 or float(sides.prod()) <= VOXELS:
        return [some]
    first, second = np.array_split(some, 2)
    return [*_parts(volume, places, first), *_parts(volume, places, second)]


@dataclass(frozen=True, eq=False)
class PaddedBox:
    """Voxels with a margin of REACH, continued beyond the volume's ends. values [D, H, W] or [D, H, W, 3]; known bool;
    first [3]: grid position (x, y, z) of the first; last [3]: index of the volume's last voxel.
    """

    values: np.ndarray
    known: np.ndarray
    first: np.ndarray
    last: np.ndarray

    @classmethod
    def around(cls, volume: Volume, low: object, high: object, nearest: bool = False) -> PaddedBox:
        """The box of the voxels that positions from low to high [3] (x, y, z) need. nearest: those alone, as samples
        are; else in float64, missing ones filled.
        """
        last, reach = np.array(volume.shape[::-1]) - 1, 0 if nearest else REACH
        whole = np.rint if nearest else np.floor
        begin, end = (np.clip(whole(np.asarray(at)), 0, last).astype(int) for at in (low, high))
        z, y, x = begin[::-1].tolist()
        d, h, w = (np.minimum(end + (not nearest), last) + 1)[::-1].tolist()
        ends = volume.around((z, y, x), (d, h, w), reach)
        cut = tuple(map(slice, *ends))
        kept = volume.kept(*ends) if volume.masks else True
        if volume.color is not None:
            values = np.asarray(volume.color[cut]) / 255.0
            known = np.ones(values.shape[:3], bool)
        else:
            values = np.asarray(volume.samples[cut])
            known = np.isfinite(values)
            values = values if nearest else _filled(values.astype(np.float64), known)
        margins = [
            (max(reach - (place - first), 0), max(reach - (stop - place_end), 0))
            for place, first, place_end, stop in zip((z, y, x), ends[0], (d, h, w), ends[1], strict=True)
        ]
        first = np.array(ends[0])[::-1] - np.array(margins)[::-1, 0]
        known = known & kept
        if nearest:
            return cls(values, known, first, last)
        values = np.pad(values, [*margins, *[(0, 0)] * (values.ndim - 3)], "reflect", reflect_type="odd")
        return cls(values, np.pad(known, margins, "edge"), first, last)

    def nearest(self, place: np.ndarray, axis: int) -> np.ndarray:
        """Indices [P] in the box of the voxels nearest to positions [P] along an axis."""
        return np.clip(np.rint(place), 0, self.last[axis]).astype(np.intp) - self.first[axis]


def _sample_part(volume: Volume, places: np.ndarray, nearest: bool) -> tuple[np.ndarray, np.ndarray]:
    box = PaddedBox.around(volume, places.min(axis=0), places.max(axis=0), nearest)
    x, y, z = (box.nearest(places[:, axis], axis) for axis in range(3))
    known = box.known[z, y, x]
    if nearest:
        return box.values[z, y, x], known
    cell = np.floor(places).astype(np.intp)
    weights = [keys_weights(places[:, axis] - cell[:, axis]) for axis in range(3)]
    x, y, z = (cell - box.first).T
    flat = box.values.reshape(-1, *box.values.shape[3:])
    _, height, width = box.values.shape[:3]
    # differences: weights sum to 1 but for roundings, and equal samples give just their value
    base = flat[(z * height + y) * width + x]
    total = np.zeros_like(base)
    for k, j in np.ndindex(4, 4):
        row = ((z + k - 1) * height + y + j - 1) * width + x
        inner = sum(_times(weights[0][i], flat[row + i - 1] - base) for i in range(4))
        total += _times(weights[2][k] * weights[1][j], np.asarray(inner))
    return base + total, known


def _times(weight: np.ndarray, values: np.ndarray) -> np.ndarray:
    return values * (weight[:, None] if values.ndim > 1 else weight)


def keys_weights(t: np.ndarray) -> tuple[np.ndarray, ...]:
    """Weights of the samples at −1, 0, 1 and 2 for places t [P] from 0 to 1; their sum is 1."""
    return (((2 - t) * t - 1) * t / 2, (3 * t - 5) * t * t / 2 + 1, ((4 - 3 * t) * t + 1) * t / 2, (t - 1) * t * t / 2)


def _weigh(values: np.ndarray, places: np.ndarray, axis: int) -> np.ndarray:
    """Values interpolated at places [P], in samples, along an axis of the array."""
    cell = np.floor(places).astype(np.intp)
    shape = [-1 if n == axis else 1 for n in range(values.ndim)]
    weights = keys_weights(places - cell)
    # differences, as in `_sample_part`
    base = np.take(values, cell, axis=axis)
    parts = [np.take(values, cell + n, axis=axis) - base for n in (-1, 1, 2)]
    others = (weights[0], *weights[2:])
    return np.asarray(base + sum(part * weight.reshape(shape) for part, weight in zip(parts, others, strict=True)))


def _inside(places: np.ndarray, size: int, beyond: float) -> np.ndarray:
    """bool: whether positions along an axis of `size` voxels lie in the volume's box or up to `beyond` around it."""
    more = 0.5 + ON_FACE + beyond
    return np.asarray((places >= -more) & (places <= size - 1 + more))


def _filled(values: np.ndarray, known: np.ndarray) -> np.ndarray:
    """The values with missing ones within REACH of others replaced by means of those; 0 beyond."""
    if known.all():
        return values
    values = np.where(known, values, 0.0)
    for _ in range(REACH):
        sums, counts = values, known.astype(np.float64)
        for axis in range(3):
            sums, counts = (_sum_three(array, axis) for array in (sums, counts))
        near = (counts > 0) & ~known
        values = np.where(near, sums / np.maximum(counts, 1), values)
        known = known | near
    return values


def _sum_three(values: np.ndarray, axis: int) -> np.ndarray:
    padded = np.pad(values, [(int(n == axis),) * 2 for n in range(values.ndim)]).swapaxes(0, axis)
    return np.asarray((padded[:-2] + padded[1:-1] + padded[2:]).swapaxes(0, axis))


def level_for(volume: Volume, pitch: float) -> Volume:
    """The coarsest level of a volume whose voxels are not wider than `pitch`, world units; else the finest."""
    fine = [level for level in (volume, *volume.coarser) if Grid.of(level).smallest_spacing <= pitch]
    return fine[-1] if fine else volume
