"""Blocks of fog and of solid matter, and lengths of rays in them."""

from __future__ import annotations

import numpy as np

import splatgl as sg
from splatgl.geometry.clipping import Plane
from tests.helpers.noise import GRIDS

OPACITY = 0.02
FOG = sg.Transfer([(0.0, OPACITY)], colormap="gray", unit=1.0)
SOLID = sg.Transfer([(0.2, 0), (0.6, 0.8)], colormap="viridis", shading=True)
PLAIN = sg.Settings(antialias="off", occlusion="off")


def block(grid: str = "cubes", size: int = 20) -> sg.Volume:
    """Homogeneous; its outermost values are those of its cells' faces too."""
    return sg.Volume(np.ones((size, size, size), np.float32), **GRIDS[grid])


def field(grid: str = "cubes", size: int = 16) -> sg.Volume:
    """Smooth noise, from 0 to 1."""
    found = np.random.default_rng(8).random((size, size, size))
    for axis in (0, 1, 2):
        found = (np.roll(found, 1, axis) + 2 * found + np.roll(found, -1, axis)) / 4
    return sg.Volume(((found - found.min()) / np.ptp(found)).astype(np.float32), **GRIDS[grid])


def lengths(volume: sg.Volume, camera: sg.Camera, found: tuple[Plane, ...]) -> np.ndarray:
    """[H, W]: world lengths of the rays of pixels within a volume's box and planes; 0 of those near its edges."""
    across, down = (each.ravel() for each in np.meshgrid(*camera.slopes()))
    here = np.stack([across, down, np.zeros_like(across)], axis=1)
    if camera.perspective:
        start, ray = np.zeros((len(here), 3)), here + np.array([0, 0, 1])
    else:
        start, ray = here, np.zeros_like(here) + np.array([0, 0, 1])
    start, ray = start @ camera.eye_from_world + camera.eye, ray @ camera.eye_from_world
    rows = np.array(found).reshape(-1, 4)
    for n, place in zip(np.linalg.inv(volume.world_from_index), volume.shape[::-1], strict=True):
        own = n @ np.asarray(volume.origin)
        rows = np.concatenate([rows, [[*n, own - 0.5]], [[*-n, -(own + place - 0.5)]]])
    speed, apart = rows[:, :3] @ ray.T, rows[:, 3:] - rows[:, :3] @ start.T
    at = apart / np.where(np.abs(speed) < 1e-12, 1e-12, speed)
    near = np.where(speed > 0, at, -np.inf).max(axis=0).clip(0)
    far = np.where(speed < 0, at, np.inf).min(axis=0)
    length = np.clip(far - near, 0, None) * np.linalg.norm(ray, axis=1)
    return np.asarray(length.reshape(camera.size[::-1]))
