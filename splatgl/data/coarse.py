"""Downsampled volumes for previews: means over blocks of voxels, on the grid of block centres."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from splatgl.data.volume import Volume

# axes with fewer samples are not halved
FEWEST = 4


def coarser(volume: Volume) -> Volume:
    """The volume of means over 2×2×2 voxels, float32; short axes stay. A block with a non-finite voxel is non-finite.

    Colours are weighted by the samples' height above the minimum, so that empty voxels do not contribute.
    """
    steps = [2 if count >= FEWEST else 1 for count in volume.shape]
    depth, height, width = (-(-count // step) for count, step in zip(volume.shape, steps, strict=True))
    samples = np.empty((depth, height, width), np.float32)
    colors = None if volume.color is None else np.empty((depth, height, width, 3), np.uint8)

    # one layer of blocks at a time: a mapped file is read once and never held entirely
    lowest = _lowest(volume) if volume.color is not None else 0.0
    for z in range(depth):
        planes = np.asarray(volume.samples[z * steps[0] : (z + 1) * steps[0]])
        samples[z] = _mean(planes.astype(np.float32, copy=False), steps)
        if colors is not None and volume.color is not None:
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
        spacing=(float(spacing[0]), float(spacing[1]), float(spacing[2])),
        origin=(float(origin[0]), float(origin[1]), float(origin[2])),
    )


def _mean(planes: np.ndarray, steps: list[int]) -> np.ndarray:
    """[H', W'] means of blocks of planes [d, H, W]; the last of an odd count has double weight."""
    total = planes.sum(axis=0, dtype=np.float32) / len(planes)
    for axis, step in ((0, steps[1]), (1, steps[2])):
        if step == 1:
            continue
        low = total[::2] if axis == 0 else total[:, ::2]
        high = total[1::2] if axis == 0 else total[:, 1::2]
        if high.shape != low.shape:
            high = np.concatenate([high, low[-1:] if axis == 0 else low[:, -1:]], axis=axis)
        total = (low + high) / 2
    return np.asarray(total)


def _lowest(volume: Volume) -> float:
    return min(float(np.nanmin(slab.samples)) for slab in volume.slabs(8, halo=0))
