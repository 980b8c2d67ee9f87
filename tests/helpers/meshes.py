"""Meshes and volumes with known pictures."""

from __future__ import annotations

import numpy as np

import splatgl as sg
from tests.helpers.noise import GRIDS

PLAIN = sg.Settings(antialias="off", occlusion="off")
RED = (0.9, 0.1, 0.2)


def block(grid: str = "cubes", size: int = 24) -> sg.Volume:
    return sg.Volume(np.ones((size, size, size), np.float32), **GRIDS[grid])


def along_y(size: int = 20) -> sg.Camera:
    middle = np.full(3, 11.5)
    return sg.Camera.orthographic(middle - np.array([0, 60, 0]), middle, (0, 0, 1), height=20, size=(size, size))


def knots(volume: sg.Volume) -> list[sg.Mesh]:
    """Tubes and balls through a volume and beyond it, of which some are opaque."""
    middle, size = volume.center, np.ptp(volume.corners, axis=0)
    turn = np.linspace(0, 4 * np.pi, 60)
    coil = middle + np.stack([np.cos(turn) * 0.3, np.sin(turn) * 0.35, turn / (4 * np.pi) - 0.5], axis=1) * size * 1.2
    balls = middle + np.array([[0.3, 0.1, 0], [-0.1, -0.2, 0.3], [0, 0.5, 0.1]]) * size
    return [
        sg.Mesh.of_lines([coil], 0.05 * size.min(), color="#40a0ff", opacity=0.6),
        sg.Mesh.of_points(balls, 0.13 * size.min(), color=RED),
        sg.Mesh.of_points(balls[:2] + 0.05 * size, 0.2 * size.min(), opacity=0.3),
    ]


def cloud(grid: str) -> sg.Volume:
    cells = np.random.default_rng(2).random((14, 14, 14))
    for axis in (0, 1, 2):
        cells = (np.roll(cells, 1, axis) + 2 * cells + np.roll(cells, -1, axis)) / 4
    return sg.Volume((cells - cells.min()) / np.ptp(cells), **GRIDS[grid])
