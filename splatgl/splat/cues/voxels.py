"""Light of voxels that are classified before reconstruction."""

from __future__ import annotations

import numpy as np

from splatgl.splat.classification.shading import surface_light
from splatgl.splat.extraction.splats import Splats
from splatgl.splat.plan.resolve import Resolved
from splatgl.splat.view.camera import Camera


def shone(color: np.ndarray, splats: Splats, camera: Camera, voxel: np.ndarray, resolved: Resolved) -> np.ndarray:
    """Colours [N, 3] of voxels [3, N] (eye axes) by their normals, if they are shaded, and by what reaches them.

    Float64 twin of `shone` in `shaders/splat_setup.glsl`.
    """
    light, cues = resolved.look.light, resolved.cues
    if not resolved.look.shading and cues is None:
        return color
    normal = splats.records["normal"].astype(np.float64) * resolved.look.shading
    towards = voxel.T if camera.perspective else np.broadcast_to([0.0, 0.0, 1.0], normal.shape)
    far = np.linalg.norm(towards, axis=1)
    # a voxel at the eye has no direction to it: use the view direction
    towards = np.where(far[:, None] > 0, towards / np.where(far > 0, far, 1.0)[:, None], [0.0, 0.0, 1.0])
    reached = None
    if cues is not None:
        reached = cues.reached(splats.positions.astype(np.float64), normal, towards @ camera.eye_from_world)
    factor, highlight = surface_light(normal @ camera.eye_from_world.T, towards, light, light.direction, reached)
    return np.asarray(color * factor[:, None] + highlight[:, None])
