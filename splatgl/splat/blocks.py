"""Runs of splats that stand together in drawing order, and which of them a picture can show."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from splatgl.splat.camera import Camera
from splatgl.splat.rows import Splats

if TYPE_CHECKING:
    from splatgl.splat.plan import Plan

# splats of a block: tile_place.frag's BLOCK
BLOCK = 256


def spheres(positions: np.ndarray) -> np.ndarray:
    """Around the centres of every BLOCK of positions [N, 3], grid indices: middle and radius, float64 [blocks, 4]."""
    if not len(positions):
        return np.zeros((0, 4))
    begins = np.arange(0, len(positions), BLOCK)
    low, high = (extreme.reduceat(positions, begins).astype(np.float64) for extreme in (np.minimum, np.maximum))
    return np.concatenate([(low + high) / 2, np.linalg.norm(high - low, axis=1, keepdims=True) / 2], axis=1)


def shown(around: np.ndarray, splats: Splats, camera: Camera, plan: Plan) -> np.ndarray:
    """Which of the spheres [blocks, 4] hold a centre that may reach into the picture: before the eye, and no further
    beyond its edges than `plan.pad`; bool [blocks].
    """
    spacing = splats.grid.mean_spacing
    steps = camera.eye_from_world @ splats.grid.world_from_index / spacing
    x, y, z = ((around[:, :3] - splats.grid.index_from_world(camera.eye)) @ steps.T).T
    radius = around[:, 3] * np.linalg.norm(steps, ord=2)
    size = np.array(camera.size) * plan.samples
    # slopes, or mean spacings, from the middle to the furthest centre
    half = (size / 2 + plan.pad) * camera.extent / size[1]
    seen = z + radius >= 0
    for across, edge in zip((x, y), half, strict=True):
        if camera.perspective:
            seen &= np.abs(across) <= z * edge + radius * np.hypot(1.0, edge)
        else:
            seen &= np.abs(across) <= edge / spacing + radius
    return np.asarray(seen)
