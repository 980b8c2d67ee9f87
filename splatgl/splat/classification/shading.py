"""Shading: a head light at the eye, C = c (0.3 + 0.7 |n·l|)."""

from __future__ import annotations

import numpy as np

from splatgl.splat.extraction.splats import Splats
from splatgl.splat.view.camera import Camera

# ambient and diffuse shares of the colour
AMBIENT, DIFFUSE = 0.3, 0.7


def head_light(splats: Splats, camera: Camera, voxel: np.ndarray) -> np.ndarray:
    """[N], no unit: 0.3 + 0.7 |n·l|, l from the voxels [3, N] (eye axes) towards the eye; 1 where there is no gradient.

    Float64 twin of `head_light` in `shaders/splat_setup.glsl`.
    """
    normal = camera.eye_from_world @ splats.records["normal"].astype(np.float64).T
    towards = voxel if camera.perspective else np.array([[0.0], [0.0], [1.0]])
    lengths = [np.sqrt((each * each).sum(axis=0)) for each in (normal, towards)]
    with np.errstate(divide="ignore", invalid="ignore"):
        cosine = np.abs((normal * towards).sum(axis=0)) / lengths[0] / lengths[1]
        # a voxel at the eye has no direction to it: use the view direction
        cosine = np.where(lengths[1] > 0, cosine, np.abs(normal[2]) / lengths[0])
    return np.where(lengths[0] > 0, AMBIENT + DIFFUSE * np.minimum(cosine, 1.0), 1.0)
