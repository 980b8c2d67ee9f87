"""Classified volumes and their halves: opacity and colour of voxels, which keep thin things when they become few.

A voxel of half as many has the mean opacity of the rays through its eight along each axis, as extinction: the mean of
extinctions makes an opaque thread in it as wide as the voxel (RMSE .15 where this has .08), that of values loses it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from splatgl.data.color import srgb_from_linear
from splatgl.data.volume import FEWEST, Places, Volume
from splatgl.splat.extract import extract
from splatgl.splat.grid import Grid
from splatgl.splat.transfer import Transfer

# voxels around a box on which its gradients depend
HALO = 1
# largest opacity of a voxel, of which means are taken
OPAQUE = 1 - 2.0**-24

Classified = tuple[np.ndarray, np.ndarray]


def classified(volume: Volume, transfer: Transfer, low: Places, high: Places) -> Classified:
    """Opacity float32 [d, h, w] per mean spacing, and sRGB uint8 [d, h, w, 3], of the voxels low ≤ (z, y, x) < high."""
    first, last = volume.around(low, high, HALO)
    part = volume.part(first, last)
    inside = tuple(slice(a - f, b - f) for a, b, f in zip(low, high, first, strict=True))
    unit = transfer.unit or Grid(volume.world_from_index, np.asarray(volume.origin)).mean_spacing
    splats = extract(part, replace(transfer, unit=unit), classification="pre")
    opacity, shade = np.zeros(part.shape, np.float32), np.zeros((*part.shape, 3), np.uint8)
    x, y, z = splats.records["position"].T
    opacity[z, y, x] = -np.expm1(-splats.records["optical_depth"].astype(np.float64))
    shade[z, y, x] = np.rint(srgb_from_linear(splats.colors) * 255)
    return opacity[inside], shade[inside]


def steps_of(shape: Places) -> Places:
    """By how much each axis (z, y, x) of a level is halved: short ones stay."""
    z, y, x = (2 if count >= FEWEST else 1 for count in shape)
    return z, y, x


def halved(opacity: np.ndarray, color: np.ndarray, steps: Places, sides: tuple[float, float, float]) -> Classified:
    """A level of half as many voxels along each axis whose step is 2. The last of an odd count is taken twice.

    opacity [d, h, w] is stated per a length; sides (z, y, x): of its voxels, in those lengths.
    """
    odd = [(0, count % step) for count, step in zip(opacity.shape, steps, strict=True)]
    opacity, color = np.pad(opacity, odd, mode="edge"), np.pad(color, [*odd, (0, 0)], mode="edge")
    blocks = [part for count, step in zip(opacity.shape, steps, strict=True) for part in (count // step, step)]
    extinction = -np.log1p(-np.minimum(opacity.reshape(blocks).astype(np.float64), OPAQUE))
    within = (1, 3, 5)
    along = []
    for axis, step, side in zip(within, steps, sides, strict=True):
        through = np.exp(-extinction.sum(axis=axis, keepdims=True) * side).mean(axis=within)
        along.append(-np.log(np.maximum(through, 1 - OPAQUE)) / (step * side))
    weight = extinction[..., None]
    total = (color.reshape(*blocks, 3) * weight).sum(axis=within)
    shade = total / np.maximum(weight.sum(axis=within), 1e-30)
    return (-np.expm1(-np.mean(along, axis=0))).astype(np.float32), np.rint(shade).astype(np.uint8)
