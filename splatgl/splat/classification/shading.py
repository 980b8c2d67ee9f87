"""Shading: a head light at the eye, C = c (0.3 + 0.7 |n·l|)."""

from __future__ import annotations

import numpy as np

from splatgl.splat.extraction.splats import Splats
from splatgl.splat.view.camera import Camera

# ambient and diffuse shares of the colour
AMBIENT, DIFFUSE = 0.3, 0.7


def surface_light(normal: np.ndarray, toward: np.ndarray) -> np.ndarray:
    """[P], no unit: 0.3 + 0.7 |n·l| of normals [P, 3] and unit vectors [P, 3] along rays; 1 without a normal."""
    size = np.linalg.norm(normal, axis=1)
    cosine = np.abs((normal * toward).sum(axis=1)) / np.where(size > 0, size, 1.0)
    return np.where(size > 0, AMBIENT + DIFFUSE * np.minimum(cosine, 1.0), 1.0)


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
