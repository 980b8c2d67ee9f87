"""Between the world and the picture: where points are seen, and the ray that goes through a pixel."""

from __future__ import annotations

import numpy as np

from splatgl.splat.camera import Camera

# depth in front of a perspective eye, in heights of what it shows at depth 1, at which lines are cut off
NEAR = 1e-6

Place = tuple[float, float]


def seen(camera: Camera, points: np.ndarray) -> np.ndarray:
    """Pixels [N, 2] of world points [N, 3]; NaN of those that are not in front of a perspective eye."""
    eye = camera.eye_from_points(points)
    depth = np.where(eye[:, 2] > 0, eye[:, 2], np.nan) if camera.perspective else np.ones(len(eye))
    pitch = camera.extent / camera.size[1]
    return np.asarray(eye[:, :2] / (depth * pitch)[:, None] + np.array(camera.size) / 2)


def ray(camera: Camera, place: Place) -> tuple[np.ndarray, np.ndarray]:
    """Start [3] and unit direction [3], world, of the ray through a position in pixels."""
    across = (np.array(place) - np.array(camera.size) / 2) * camera.extent / camera.size[1]
    if camera.perspective:
        direction = np.array([*across, 1.0]) @ camera.eye_from_world
        return camera.eye, np.asarray(direction / np.linalg.norm(direction))
    return camera.eye + across @ camera.eye_from_world[:2], camera.forward


def segment(camera: Camera, start: np.ndarray, stop: np.ndarray) -> tuple[Place, Place] | None:
    """Pixels of a line's ends, of the part of it that is in front of the eye; None if none is."""
    ends = np.array([start, stop], np.float64)
    depth = camera.eye_from_points(ends)[:, 2]
    if camera.perspective:
        least = NEAR * max(float(np.abs(depth).max()), 1e-300)
        if depth.max() <= least:
            return None
        if depth.min() < least:
            behind = int(depth.argmin())
            share = (least - depth[behind]) / (depth[1 - behind] - depth[behind])
            # a hair further, so that rounding leaves it in front
            ends[behind] += (ends[1 - behind] - ends[behind]) * min(1.0, share * (1 + 1e-9) + 1e-12)
    found = seen(camera, ends)
    if not np.isfinite(found).all():
        return None
    return (float(found[0, 0]), float(found[0, 1])), (float(found[1, 0]), float(found[1, 1]))


def nearest_on_line(camera: Camera, place: Place, point: np.ndarray, axis: np.ndarray) -> float | None:
    """The t of the point + t · axis (a unit vector) that is nearest to the ray through a pixel; None where the line is
    seen end on.
    """
    start, direction = ray(camera, place)
    cosine = float(direction @ axis)
    square = 1.0 - cosine * cosine
    if square < 1e-6:
        return None
    apart = start - point
    return float((apart @ axis - cosine * (apart @ direction)) / square)
