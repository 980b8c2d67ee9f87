"""Volumes of fewer voxels: means of 2×2×2, of labels the most frequent numbers, or every so many voxels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from splatgl.data.volume import Volume, triple

# axes with fewer samples are not halved
FEWEST = 4


def halve_volume(volume: Volume, labels: bool = False) -> Volume:
    """The volume of means over 2×2×2 voxels, float32; short axes stay. A block with a non-finite voxel is non-finite.

    labels: whether samples number segments, as a volume with a table always does: then each block gets its most
    frequent number, in its type; of equally frequent ones a segment's. Colours are weighted by the samples' height
    above the minimum, so that empty voxels do not contribute.
    """
    steps = [2 if count >= FEWEST else 1 for count in volume.shape]
    samples = halve_samples(volume.samples, steps, labels or volume.labels is not None)
    colors = None if volume.color is None else np.empty((*samples.shape, 3), np.uint8)
    if colors is not None:
        lowest = min(float(np.nanmin(slab.samples)) for slab in volume.slabs(8, halo=0))
        for z in range(len(colors)):
            planes = np.asarray(volume.samples[z * steps[0] : (z + 1) * steps[0]])
            weight = planes.astype(np.float32) - (lowest - 1e-3)
            shade = volume.color[z * steps[0] : (z + 1) * steps[0]].astype(np.float32)
            total = np.maximum(_mean(weight, steps), 1e-6)
            for channel in range(3):
                colors[z, ..., channel] = np.rint(_mean(shade[..., channel] * weight, steps) / total)

    # centre of the first block, in voxels: between its samples
    middle = (np.array(steps[::-1]) - 1) / 2
    origin = np.asarray(volume.origin) + volume.world_from_index @ middle
    spacing = np.asarray(volume.spacing) * steps[::-1]
    return replace(
        volume,
        samples=samples,
        color=colors,
        vectors=None,
        spacing=triple(spacing, "spacing"),
        origin=triple(origin, "origin"),
        whole=volume.lengths,
    )


def subsample(volume: Volume, step: int) -> Volume:
    """Every `step`-th voxel along each axis, plane by plane: of a mapped file, only these are read."""
    color = volume.color
    planes = [np.asarray(volume.samples[z])[::step, ::step] for z in range(0, volume.shape[0], step)]
    x, y, z = volume.spacing
    return replace(
        volume,
        samples=np.stack(planes),
        color=None if color is None else np.asarray(color[::step, ::step, ::step]),
        vectors=None,
        spacing=(x * step, y * step, z * step),
        whole=volume.lengths,
    )


def halve_samples(samples: Any, steps: Sequence[int], labels: bool) -> np.ndarray:
    """[D', H', W'] means of blocks of samples [D, H, W], float32; of labels the most frequent numbers, in their type.

    steps (z, y, x): voxels of a block, 2 or 1. One layer of blocks is read at a time.
    """
    shape = [-(-count // step) for count, step in zip(samples.shape, steps, strict=True)]
    halved = np.empty(shape, samples.dtype if labels else np.float32)
    for z in range(shape[0]):
        planes = np.asarray(samples[z * steps[0] : (z + 1) * steps[0]])
        halved[z] = _majority(planes, steps) if labels else _mean(planes.astype(np.float32, copy=False), steps)
    return halved


def _mean(planes: np.ndarray, steps: Sequence[int]) -> np.ndarray:
    """[H', W'] means of blocks of planes [d, H, W]; the last of an odd count has double weight."""
    mean = _pad_odd(planes, steps).sum(axis=0, dtype=np.float32) / len(planes)
    mean = mean if steps[1] == 1 else (mean[::2] + mean[1::2]) / 2
    return np.asarray(mean if steps[2] == 1 else (mean[:, ::2] + mean[:, 1::2]) / 2)


def _pad_odd(planes: np.ndarray, steps: Sequence[int]) -> np.ndarray:
    """Planes [d, H, W] with the last row and column of an odd count twice."""
    odd = [(0, -count % step) for count, step in zip(planes.shape[1:], steps[1:], strict=True)]
    return np.pad(planes, [(0, 0), *odd], mode="edge") if any(map(any, odd)) else planes


def _majority(planes: np.ndarray, steps: Sequence[int]) -> np.ndarray:
    """[H', W'] most frequent numbers of blocks of planes [d, H, W]; the last of an odd count counts twice."""
    padded, (_, down, right) = _pad_odd(planes, steps), steps
    corners = [plane[y::down, x::right] for plane in padded for y in range(down) for x in range(right)]
    winner, best = corners[0], np.zeros(corners[0].shape, np.int8)
    for corner in corners:
        # of equally frequent numbers, not the background
        votes = 2 * sum((other == corner).astype(np.int8) for other in corners) + (corner != 0)
        winner, best = np.where(votes > best, corner, winner), np.maximum(votes, best)
    return np.asarray(winner)
