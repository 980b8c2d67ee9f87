"""Downsampled volumes for previews, on the grid of block centres: means over blocks of voxels, of labels the number
that most of a block have.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from splatgl.data.volume import Volume

# axes with fewer samples are not halved
FEWEST = 4


def coarser(volume: Volume, labels: bool = False) -> Volume:
    """The volume of means over 2×2×2 voxels, float32; short axes stay. A block with a non-finite voxel is non-finite.

    labels: whether samples number segments, as a volume's own table says, too: then the numbers that most voxels of
    each block have, of equally many the one of a segment, in their own type. Between two numbers there is none.

    Colours are weighted by the samples' height above the minimum, so that empty voxels do not contribute.
    """
    steps = [2 if count >= FEWEST else 1 for count in volume.shape]
    depth, height, width = (-(-count // step) for count, step in zip(volume.shape, steps, strict=True))
    labels = labels or volume.labels is not None
    samples = np.empty((depth, height, width), volume.samples.dtype if labels else np.float32)
    colors = None if volume.color is None else np.empty((depth, height, width, 3), np.uint8)

    # one layer of blocks at a time: a mapped file is read once and never held entirely
    lowest = _lowest(volume) if volume.color is not None else 0.0
    for z in range(depth):
        planes = np.asarray(volume.samples[z * steps[0] : (z + 1) * steps[0]])
        samples[z] = _most(planes, steps) if labels else _mean(planes.astype(np.float32, copy=False), steps)
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


def _most(planes: np.ndarray, steps: list[int]) -> np.ndarray:
    """[H', W'] numbers that most voxels of blocks of planes [d, H, W] have; the last of an odd count counts twice."""
    odd = [(0, -count % step) for count, step in zip(planes.shape[1:], steps[1:], strict=True)]
    padded = np.pad(planes, [(0, 0), *odd], mode="edge")
    corners = [each[y :: steps[1], x :: steps[2]] for each in padded for y in range(steps[1]) for x in range(steps[2])]
    found, most = corners[0], np.zeros(corners[0].shape, np.int8)
    for corner in corners:
        # of equally many, what is not the background
        votes = 2 * sum((other == corner).astype(np.int8) for other in corners) + (corner != 0)
        found, most = np.where(votes > most, corner, found), np.maximum(votes, most)
    return np.asarray(found)


def _lowest(volume: Volume) -> float:
    return min(float(np.nanmin(slab.samples)) for slab in volume.slabs(8, halo=0))
