"""Labels of noise, and their splats drawn as boxes."""

from __future__ import annotations

import numpy as np

import splatgl as sg
from splatgl.data.volume import Label
from splatgl.splat.splats import Splats
from splatgl.transfer.presets import label_transfer

RED, GREEN, BLUE = "#ff0000", "#00ff00", "#0000ff"
# faint, half and solid
TABLE = (Label(1, "", RED, 0.05), Label(2, "", GREEN, 0.5), Label(3, "", BLUE))

SHEARED = np.array([[1.0, 0.3, 0.0], [0.0, 1.0, 0.2], [0.0, 0.0, 1.0]])
SHEARED = SHEARED / np.linalg.norm(SHEARED, axis=0)
GRIDS = {
    "cubes": ((1.0, 1.0, 1.0), np.eye(3)),
    "3:1": ((1.0, 1.0, 3.0), np.eye(3)),
    "sheared": ((1.0, 2.0, 0.7), SHEARED),
}


def splats_of(volume: sg.Volume) -> Splats:
    return sg.extract(volume, label_transfer(volume))


def noise(rng: np.random.Generator, grid: str, shape: tuple[int, int, int] = (6, 5, 7)) -> sg.Volume:
    spacing, direction = GRIDS[grid]
    samples = rng.integers(0, 4, shape).astype(np.uint8)
    return sg.Volume(samples, spacing, origin=(1.0, -2.0, 0.5), direction=direction, labels=TABLE)
