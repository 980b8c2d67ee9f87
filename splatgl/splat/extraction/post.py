"""Extraction for classification after reconstruction: values and gradients of the voxels that opaque points need.

A point's value is a mean of coefficients around it, and near the samples there. A voxel is kept if the interval of the
samples within the kernel's reach meets a value of non-zero opacity; the others only contribute to transparent points,
which only blends of one value see.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from splatgl.data.volume import Slab, Volume
from splatgl.splat.classification.post import PostClassified
from splatgl.splat.extraction.records import SAMPLE
from splatgl.splat.extraction.splats import Grid, Splats, assemble
from splatgl.splat.kernel.kernels import Kernel

# steps of the prefilter, after which means of coefficients are near the samples
PREFILTERED = {"b-spline": 4}
# planes around a slab that a step of the prefilter reads, and that differences read
STEP_HALO, GRADIENT_HALO = 1, 2

Progress = Callable[[Iterator[Slab], int], Iterator[Slab]]


def extract_post(
    volume: Volume, post: PostClassified, kernel: Kernel, planes: int, progress: Progress | None = None
) -> Splats:
    """Splats of value and gradient, in row order, of all finite voxels that `post` wants.

    planes: of a slab; records do not depend on it.
    """
    steps, around = PREFILTERED.get(kernel.name, 0), int(kernel.radius)
    slabs = volume.slabs(planes, halo=steps * STEP_HALO + max(around, GRADIENT_HALO))
    count = -(-volume.shape[0] // planes)
    grid = Grid(volume.world_from_index, np.asarray(volume.origin))
    world = np.linalg.inv(volume.world_from_index) * grid.mean_spacing
    chunks = []
    for slab in progress(slabs, count) if progress else slabs:
        u = post.relative(np.where(np.isfinite(slab.samples), slab.samples, np.nan))
        own = slice(slab.before, slab.before + slab.stop - slab.start)
        keep, c = needed(u, prefiltered(u, kernel, steps), around, post.wanted)
        keep = keep[own] & np.isfinite(u[own])
        z, y, x = np.nonzero(keep)
        records = np.zeros(len(z), SAMPLE)
        records["position"] = np.stack([x, y, z + slab.start], axis=1)
        records["value"] = c[own][keep]
        records["gradient"] = gradients(u, x, y, z + slab.before) @ world
        chunks.append(records)
    records = np.concatenate(chunks)
    cells = records["position"].astype(np.int32)
    return assemble(records, cells, grid, grid.mean_spacing, volume.name).classified_after(post)


def prefiltered(u: np.ndarray, kernel: Kernel, steps: int) -> np.ndarray:
    """Coefficients whose means by the kernel pass near the samples u [D, H, W], NaN left out; edges are replicated.

    c ← c + u − k∗c/Σk.
    """
    if steps == 0:
        return u
    finite = np.isfinite(u)
    filled = u if finite.all() else np.where(finite, u, _around(np.where(finite, u, 0), finite))
    weights = np.asarray(kernel.value(np.sqrt(np.arange(4.0))), np.float32)
    weights /= weights @ np.array([1, 6, 12, 8], np.float32)
    c = filled
    for _ in range(steps):
        c = c + (filled - _smoothed(c, weights))
    return np.where(finite, c, np.float32(np.nan)) if filled is not u else c


def _around(u: np.ndarray, finite: np.ndarray) -> np.ndarray:
    """The mean of the finite neighbours; 0 without any."""
    even = np.full(4, 1 / 27, np.float32)
    share = _smoothed(finite.astype(np.float32), even)
    return _smoothed(u.astype(np.float32), even) / np.where(share > 0, share, 1)


def _smoothed(c: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Sum over 3×3×3 neighbours by `weights` of how many coordinates differ."""
    w0, w1, w2, w3 = weights
    beside = _beside(c, 2)
    same, one, two = w0 * c + w1 * beside, w1 * c + w2 * beside, w2 * c + w3 * beside
    same, one = same + _beside(one, 1), one + _beside(two, 1)
    return np.asarray(same + _beside(one, 0))


def _beside(a: np.ndarray, axis: int) -> np.ndarray:
    """The sum of both neighbours along an axis, edges replicated."""
    a = np.moveaxis(a, axis, 0)
    total = np.empty_like(a)
    total[1:-1] = a[:-2] + a[2:]
    if len(a) > 1:
        total[0], total[-1] = a[0] + a[1], a[-2] + a[-1]
    else:
        total[0] = 2 * a[0]
    return np.moveaxis(total, 0, axis)


def needed(u: np.ndarray, c: np.ndarray, around: int, wanted: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Where the interval of u around a voxel meets one of `wanted` [n, 2], bool; and c, changed for the outermost.

    around 1: over its 26 neighbours; 2: also those two steps along one axis, whose shares of points that the voxel
    reaches matter. Those only contribute beside others: on their own they must not be opaque, so that their
    coefficients are kept within the interval of their 26 neighbours.
    """
    low, high = u, u
    for axis in range(3):
        low, high = _extreme(low, axis, np.fmin), _extreme(high, axis, np.fmax)
    near = _meets(low, high, wanted)
    if around == 1:
        return near, c
    keep = near.copy()
    for axis in range(3):
        keep |= _meets(_extreme(low, axis, np.fmin), _extreme(high, axis, np.fmax), wanted)
    return keep, c if c is u else np.where(near, c, np.clip(c, low, high))


def _meets(low: np.ndarray, high: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    found = np.zeros(low.shape, bool)
    with np.errstate(invalid="ignore"):
        for start, end in wanted:
            found |= (high >= start) & (low <= end)
    return found


def _extreme(a: np.ndarray, axis: int, choose: np.ufunc) -> np.ndarray:
    """The extreme of each and its neighbours along an axis."""
    a = np.moveaxis(a, axis, 0)
    found = a.copy()
    choose(found[1:], a[:-1], out=found[1:])
    choose(found[:-1], a[1:], out=found[:-1])
    return np.moveaxis(found, 0, axis)


def gradients(u: np.ndarray, x: np.ndarray, y: np.ndarray, z: np.ndarray, order: int = 4) -> np.ndarray:
    """[N, 3] per grid step along x, y, z: differences of that order, 4 or 2; central ones where a sample is missing,
    one-sided ones at the edges.
    """
    center = u[z, y, x].astype(np.float64)
    gradient = np.zeros((len(center), 3))
    for axis, index in enumerate((x, y, z)):
        last = u.shape[2 - axis] - 1
        at = {}
        for step in (-2, -1, 1, 2):
            place = [z, y, x]
            place[2 - axis] = np.clip(index + step, 0, last)
            value = u[tuple(place)].astype(np.float64)
            at[step] = np.where((index + step >= 0) & (index + step <= last), value, np.nan)
        finite = {step: np.isfinite(value) for step, value in at.items()}
        low, high = np.where(finite[-1], at[-1], center), np.where(finite[1], at[1], center)
        first = (high - low) / np.maximum(finite[-1].astype(int) + finite[1], 1)
        fourth = (8 * (at[1] - at[-1]) - (at[2] - at[-2])) / 12 if order == 4 else first
        gradient[:, axis] = np.where(np.isfinite(fourth), fourth, first)
    return gradient
