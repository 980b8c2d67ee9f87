"""Flat stacks of a microscope: seen along z, x to the right and y down, as napari and Fiji show them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from splatgl.data.volume import Volume
from splatgl.splat.presets import is_microscopy

# units of length of microscopes
UNITS = ("um", "µm", "nm", "Å")
# a stack is flat whose depth is less than this share of its width and height
FLAT = 0.5
TOLD = "a flat stack is seen along z, x to the right and y down: --elevation 45 tilts it"


def seen_along_z(volume: Volume, told: bool = True) -> Volume:
    """The volume, a flat stack of a microscope with the view of it: along z, and turning about y. told: with a note."""
    if not is_flat_stack(volume):
        return volume
    hints = replace(volume.hints, azimuth=0.0, elevation=0.0, up=(0.0, -1.0, 0.0))
    return replace(volume, hints=hints, notes=(*volume.notes, *[TOLD] * told))


def is_flat_stack(volume: Volume) -> bool:
    """Whether it is a plane, or much thinner along z than along x and y, and a microscope's by its file, its unit or
    its values.
    """
    hints = volume.hints
    placed = any(x is not None for x in (hints.azimuth, hints.elevation, hints.eye, hints.up, hints.points))
    depth, height, width = ((n - 1) * step for n, step in zip(volume.shape, reversed(volume.spacing), strict=True))
    if placed or volume.frame is not None or volume.color is not None or depth >= FLAT * min(height, width):
        return False
    known = hints.stack or depth == 0 or volume.unit in UNITS
    return np.allclose(volume.direction, np.eye(3)) and (known or is_microscopy(volume))
