"""Screen bounds of all splats, and their mean depth."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from splatgl.splat.view.block_culling import STRETCHED
from splatgl.splat.view.ellipse import tangents
from splatgl.splat.view.view import View

# splats within this many kernel reaches of the eye's plane may cover the whole picture
CLEARANCE = 2.0
# iterations for the furthest centre beyond the edge: each step is a tenth of the last
ROUNDS = 5
# pixels around the window, for rounding
MARGIN = 2
# pixels around a splat: rasterisers snap positions to 1/256 of a pixel or finer, and float32 rounds them
PIXEL_MARGIN = 2.0**-5


@dataclass(frozen=True)
class Window:
    """A rectangle of pixels, (x, y) its first."""

    x: int
    y: int
    width: int
    height: int

    @property
    def box(self) -> tuple[int, int, int, int]:
        """(x, y, width, height) in pixels."""
        return self.x, self.y, self.width, self.height


@dataclass(frozen=True)
class ScreenBounds:
    """Screen extent of a picture's splats.

    window: all pixels that they reach. mean_depth: of the centre of their box, in mean spacings.
    """

    window: Window
    mean_depth: float


def screen_bounds(box: np.ndarray, view: View) -> ScreenBounds:
    """The bounds of all splats within a box; the whole picture if the eye is near. box [8, 3]: its corners, grid."""
    corners, size = view.voxels(box), view.size
    steps = view.eye_from_index * view.kernel.radius
    if not view.perspective:
        half = max(float(np.linalg.norm(steps[:2], axis=1).max()) / view.pitch, STRETCHED * view.kernel.radius)
        return ScreenBounds(_window(corners[:2].T / view.pitch, half, size), float(corners[2].mean()))
    # the deepest reach, and the nearest centre
    deep, nearest = float(np.linalg.norm(steps[2])), float(corners[2].min())
    middle = max(float(corners[2].mean()), deep, 1e-9)
    if nearest <= CLEARANCE * deep:
        return ScreenBounds(Window(0, 0, *size), middle)
    # the largest are centred beyond the edge and still reach into the picture
    across = steps[:2]
    furthest = np.array([_furthest(nearest, edge, s, steps[2]) for edge, s in zip(view.edge, across, strict=True)])
    sides = [_sides(nearest, slope, step, steps[2]) for slope, step in zip(furthest, across, strict=True)]
    stretched = STRETCHED * view.kernel.radius * (1 + float(np.hypot(*furthest)))
    half = max(max(max(side) for side in sides) / view.pitch, stretched)
    return ScreenBounds(_window((corners[:2] / corners[2]).T / view.pitch, half, size), middle)


def _sides(z: float, slope: float, step: np.ndarray, deep: np.ndarray) -> tuple[float, float]:
    """Extents, in slopes, of an ellipsoid at (slope z, z), inwards and outwards, on either side of the view.

    step, deep: components of its half axes along the picture and along depth.
    """
    below, above = zip(*(tangents(slope * z, z, step, turn * deep) for turn in (1, -1)), strict=True)
    return float(max(below)), float(max(above))


def _furthest(z: float, edge: float, step: np.ndarray, deep: np.ndarray) -> float:
    """The slope of the furthest centre beyond the edge whose splat still reaches it."""
    beyond = 0.0
    for _ in range(ROUNDS):
        beyond = _sides(z, edge + beyond, step, deep)[0]
    return edge + beyond * (1 + 1e-3)


def _window(places: np.ndarray, half: float, size: tuple[int, int]) -> Window:
    """The pixels within `half` of positions [N, 2], in pixels from the picture's centre."""
    middle = np.array(size) / 2
    low = np.clip(np.floor(places.min(axis=0) + middle - half) - MARGIN, 0, size)
    high = np.clip(np.ceil(places.max(axis=0) + middle + half) + MARGIN, 0, size)
    (x, y), (right, bottom) = low.astype(int), high.astype(int)
    return Window(int(x), int(y), int(right - x), int(bottom - y))
