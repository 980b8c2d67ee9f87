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


def boxes(positions: np.ndarray) -> np.ndarray:
    """Around the centres of every BLOCK of positions [N, 3], grid indices: middle and half sides [blocks, 6]."""
    if not len(positions):
        return np.zeros((0, 6))
    begins = np.arange(0, len(positions), BLOCK)
    low, high = (extreme.reduceat(positions, begins).astype(np.float64) for extreme in (np.minimum, np.maximum))
    return np.concatenate([(low + high) / 2, (high - low) / 2], axis=1)


def shown(around: np.ndarray, splats: Splats, camera: Camera, plan: Plan) -> np.ndarray:
    """Which of the boxes [blocks, 6] hold a centre that may reach into the picture; bool [blocks].

    Those are before the eye, and no further beyond the picture's edges than `plan.pad`, and a pixel for rounding.
    """
    size = np.array(camera.size) * plan.samples
    # slopes, or lengths, from the middle of the picture to the furthest centre
    across, down = (size / 2 + plan.pad + 1) * camera.extent / size[1]
    sides = np.array([[1.0, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]])
    limits = np.array([across, across, down, down])
    if camera.perspective:
        sides[:, 2] -= limits
        sides = np.concatenate([sides, [[0, 0, -1]]])
        limits = np.zeros(5)
    # the planes' normals outwards, and how far out the innermost corner of a box is
    normals = sides @ camera.eye_from_world @ splats.grid.world_from_index
    middle = around[:, :3] - splats.grid.index_from_world(camera.eye)
    return np.asarray((middle @ normals.T - around[:, 3:] @ np.abs(normals).T <= limits).all(axis=1))
