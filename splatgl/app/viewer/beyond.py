"""Splats beyond z_k: their share, their tint, and the section of the volume's box by the z_k plane.  [M98 §3]"""

from __future__ import annotations

import numpy as np

from splatgl.splat.camera import Camera
from splatgl.splat.splats import Splats, as_points

# linear light: splats beyond z_k are blended towards TINT by SHARE; splats at the plane get the colour PLANE
TINT, PLANE = np.array([0.9, 0.12, 0.02], np.float32), np.array([1.0, 0.85, 0.1], np.float32)
SHARE = 0.55
# thickness of the plane's band in voxels
BAND = 1.0


def depths(splats: Splats, camera: Camera) -> np.ndarray:
    """Depth [N] of every splat, world units, float32."""
    along = camera.forward @ splats.grid.world_from_index
    start = float(camera.forward @ (splats.grid.origin - camera.eye))
    return np.asarray(splats.positions @ along.astype(np.float32) + np.float32(start))


def share_beyond(splats: Splats, camera: Camera, z_k: float) -> float:
    """Fraction of the splats beyond z_k."""
    return float((depths(splats, camera) > z_k).mean()) if len(splats) else 0.0


def tinted(splats: Splats, camera: Camera, z_k: float) -> Splats:
    """Copy of the splats with those beyond z_k tinted and those at z_k in the plane's colour."""
    if not len(splats) or not np.isfinite(z_k):
        return splats
    depth = depths(splats, camera)
    records = as_points(splats.records)
    beyond = depth > z_k
    records["color"][beyond] += SHARE * (TINT - records["color"][beyond])
    records["color"][np.abs(depth - z_k) < BAND / 2 * splats.grid.mean_spacing] = PLANE
    return splats.in_cells(records=records)


def nearer(splats: Splats, camera: Camera, z_k: float) -> Splats:
    """The splats not beyond z_k."""
    return splats.part(depths(splats, camera) <= z_k)


def tinted_light(whole: np.ndarray, near: np.ndarray) -> np.ndarray:
    """A picture float32 [H, W, 4], linear premultiplied, whose light from beyond z_k is tinted; near: without it."""
    beyond = whole - near
    return np.concatenate(
        [whole[..., :3] + SHARE * (TINT * beyond[..., 3:] - beyond[..., :3]), whole[..., 3:]], axis=-1
    )


def crossing(corners: np.ndarray, camera: Camera, z_k: float) -> np.ndarray:
    """Section of a box, corners [8, 3], by the plane at depth z_k: a polygon [N, 2] in pixels; N = 0 if they miss.

    Corners are in the order of `Volume.corners`: bit 0 is x, bit 1 y, bit 2 z.
    """
    eye = camera.eye_from_points(corners)
    edges = [(i, i | 1 << axis) for axis in range(3) for i in range(8) if not i >> axis & 1]
    points = []
    for i, j in edges:
        low, high = eye[i, 2] - z_k, eye[j, 2] - z_k
        if np.isfinite(z_k) and (low < 0) != (high < 0):
            points.append(eye[i] + (eye[j] - eye[i]) * low / (low - high))
    if len(points) < 3:
        return np.zeros((0, 2))
    flat = np.array(points)[:, :2] / camera.pixel_pitch(z_k) + np.array(camera.size) / 2
    # the section is convex: sort its corners by angle about their mean
    from_middle = flat - flat.mean(axis=0)
    return np.asarray(flat[np.argsort(np.arctan2(from_middle[:, 1], from_middle[:, 0]))])
