"""Temporal artefacts of a sequence: strips of one column over time, flicker, and popping.  [M98 Fig. 14]"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

import numpy as np

from splatgl.splat.camera import Camera
from splatgl.splat.motion import Draw
from splatgl.splat.ordering import order_for
from splatgl.splat.settings import Settings
from splatgl.splat.splats import Splats

# degrees between the two frames compared for popping
CLOSE = 0.01
# search step for changes of the drawing order over a rotation, degrees, and number of bisections
SEARCH, HALVINGS = 1.0, 14


def strip(draw: Draw, splats: Splats, cameras: Iterable[Camera], settings: Settings) -> np.ndarray:
    """float64 [H/2, frames, 4]: the upper half of each frame's middle column, side by side.

    Only two columns are rendered; they match the middle ones of any wider image.
    """
    columns = []
    for camera in cameras:
        narrow = replace(camera, size=(2, camera.size[1]))
        columns.append(draw(splats, narrow, settings).pixels[: camera.size[1] // 2, 1].astype(np.float64))
    return np.stack(columns, axis=1)


def flicker(shown: np.ndarray) -> float:
    """Variance of the colour differences between consecutive frames; [rows, frames, 4]."""
    return float(np.diff(shown[..., :3], axis=1).var())


@dataclass(frozen=True)
class Pop:
    """angle: rotation in degrees at which the drawing order changes. change: the largest pixel difference between two
    frames 0.01° apart around it; usual: the same, 0.1° before, where the order stays.
    """

    angle: float
    change: float
    usual: float


def popping(
    draw: Draw, splats: Splats, camera: Callable[[float], Camera], settings: Settings, turn: float = 360.0
) -> list[Pop]:
    """All changes of the slicing axis as a camera rotates by that many degrees."""
    found = []
    last = order_for(splats, camera(0.0)).axis
    for step in range(round(turn / SEARCH)):
        low, high = step * SEARCH, (step + 1) * SEARCH
        axis = order_for(splats, camera(high)).axis
        if axis == last:
            continue
        for _ in range(HALVINGS):
            middle = (low + high) / 2
            if order_for(splats, camera(middle)).axis == last:
                low = middle
            else:
                high = middle
        angle = (low + high) / 2
        changes = [_change(draw, splats, camera, settings, at) for at in (angle, angle - 10 * CLOSE)]
        found.append(Pop(angle, *changes))
        last = axis
    return found


def _change(draw: Draw, splats: Splats, camera: Callable[[float], Camera], settings: Settings, at: float) -> float:
    first, second = (draw(splats, camera(at + side * CLOSE / 2), settings).pixels for side in (-1, 1))
    return float(np.abs(second - first).max())
