"""Smooth noise, views of it, and settings for pictures of bricks."""

from __future__ import annotations

import numpy as np

import splatgl as sg
from splatgl.splat.settings import Settings

RAMP = sg.Transfer([(0.45, 0), (0.6, 0.8)], colormap="hot", shading=True)
# no ray ends early
ALL = Settings(occlusion="off")
PICTURES = ("composite", "xray", "mip", "attenuated-mip", "minip", "mean")
VIEWS = ("outside", "inside", "beside", "parallel")


def noise(rng: np.random.Generator, shape: tuple[int, int, int]) -> np.ndarray:
    """Smoothed along each axis."""
    found: np.ndarray = rng.random(shape, np.float32)
    for axis in range(3):
        found = (np.roll(found, 1, axis) + 2 * found + np.roll(found, -1, axis)) / 4
    return found


def cameras(volume: sg.Volume) -> dict[str, sg.Camera]:
    middle, far = volume.center, 3 * float(np.ptp(volume.corners, axis=0).max())
    size = (37, 26)
    return {
        "outside": sg.Camera.orbit(volume, 30, 20, size=size, zoom=0.7),
        "inside": sg.Camera.look_at(middle, middle + np.array([1.0, 0.4, 0.2]), (0, 0, 1), 70, size),
        "beside": sg.Camera.look_at(volume.corners[0] - 0.1, middle, (0, 0, 1), 60, size),
        "parallel": sg.Camera.orthographic(
            eye=middle + np.array([0, -far, far / 2]), target=middle, up=(0, 0, 1), height=far / 3, size=size
        ),
    }
