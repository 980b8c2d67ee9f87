"""Flat stacks of a microscope: seen along z, x to the right and y down, as napari and Fiji show them."""

from __future__ import annotations

import numpy as np

from splatgl.data.volume import Volume
from splatgl.splat.classification.presets import is_microscopy

# units of length of microscopes
UNITS = ("um", "µm", "nm", "Å")
# a stack is flat whose depth is at most this share of its width and height
FLAT = 0.5
# the direction drawn upwards, −y: an orbit's azimuth and elevation of 0 look along +z then
UP = (0.0, -1.0, 0.0)


def is_flat_stack(volume: Volume) -> bool:
    """Whether it is much thinner along z than along x and y, and a microscope's by its unit or its values."""
    hints = volume.hints
    placed = any(x is not None for x in (hints.azimuth, hints.elevation, hints.eye, hints.up, hints.points))
    depth, height, width = (n * step for n, step in zip(volume.shape, reversed(volume.spacing), strict=True))
    if placed or volume.frame is not None or volume.color is not None or depth > FLAT * min(height, width):
        return False
    return np.allclose(volume.direction, np.eye(3)) and (volume.unit in UNITS or is_microscopy(volume))
