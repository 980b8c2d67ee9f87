"""Where in the picture splats are, and how large: what sprites, scissors and reading back need to know."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from splatgl.splat.camera import Camera, check_reach
from splatgl.splat.rows import Splats

# a sprite needs its kernel ahead of the eye: no nearer than this many times the kernel's reach in depth
CLEARANCE = 2.0
# beyond z_k a footprint is R pixels, times √2 for slant and a little for its first-order terms
STRETCHED = 2.0
# rounds that find how far beyond the edge a centre may be: each is a tenth of the last
ROUNDS = 5
# pixels around, for rounding
MARGIN = 2


@dataclass(frozen=True)
class Window:
    """A rectangle of pixels, (x, y) its first."""

    x: int
    y: int
    width: int
    height: int

    @property
    def box(self) -> tuple[int, int, int, int]:
        return self.x, self.y, self.width, self.height


@dataclass(frozen=True)
class Reach:
    """What a picture's splats cover, in pixels.

    window: every pixel that any of them reaches. largest: half the side of the largest that reaches
    in, inf where the eye is within CLEARANCE. pad: how far beyond the edge one may be centred and still reach in.
    typical: half a side at the mean depth, which is in mean spacings.
    """

    window: Window
    largest: float
    pad: int
    typical: float
    mean_depth: float


def reach(splats: Splats, camera: Camera, radius: float, beyond: float = -np.inf) -> Reach:
    """Bounds for splats of a kernel of `radius` voxels, no nearer than `beyond`, in mean spacings of depth.

    InputError where they are too far away for float32.
    """
    width, height = camera.size
    spacing = splats.grid.mean_spacing
    corners = camera.eye_from_points(splats.box_around(0.0)) / spacing
    if len(splats):
        check_reach(corners, camera, spacing)
    steps = camera.eye_from_world @ splats.grid.world_from_index / spacing * radius
    pitch = camera.extent / height
    if not camera.perspective:
        half = max(float(np.linalg.norm(steps[:2], axis=1).max()) * spacing / pitch, STRETCHED * radius)
        window = _window(corners[:, :2] * spacing / pitch, half, camera.size)
        return Reach(window, half, _whole(half), half, float(corners[:, 2].mean()))

    # the deepest reach, and the nearest centre
    deep = float(np.linalg.norm(steps[2]))
    nearest, mean = max(float(corners[:, 2].min()), beyond), float(corners[:, 2].mean())
    middle = max(mean, beyond, deep, 1e-9)
    typical = max(float(np.linalg.norm(steps[0])) / (middle * pitch), radius)
    if nearest <= CLEARANCE * deep:
        return Reach(Window(0, 0, width, height), np.inf, 0, typical, middle)
    edge = camera.extent / 2 * np.array([width / height, 1.0])
    beyond_edge = [_inwards(nearest, slope, step, steps[2]) for slope, step in zip(edge, steps, strict=False)]
    # those centred beyond the edge are the largest
    furthest = edge + beyond_edge
    sides = [_sides(nearest, slope, step, steps[2]) for slope, step in zip(furthest, steps, strict=False)]
    stretched = STRETCHED * radius * (1 + float(np.hypot(*furthest)))
    half = max(max(max(side) for side in sides) / pitch, stretched)
    pad = max(max(beyond_edge) / pitch, stretched)
    if beyond > -np.inf:
        return Reach(Window(0, 0, width, height), half, _whole(pad), typical, middle)
    window = _window(corners[:, :2] / corners[:, 2:] / pitch, half, camera.size)
    return Reach(window, half, _whole(pad), typical, middle)


def _sides(z: float, slope: float, step: np.ndarray, deep: np.ndarray) -> tuple[float, float]:
    """How far, in slopes, an ellipsoid at (slope z, z) reaches inwards and outwards, on either side of the view.

    step, deep: its half axes' components along the picture and along depth. (x − s z)² = |step − s deep|².
    """
    a = z * z - deep @ deep
    found = [
        (
            (slope * z * z - turn * (step @ deep)) / a - slope,
            np.sqrt(max(_discriminant(z, slope, step, deep, turn), 0.0)) / a,
        )
        for turn in (1, -1)
    ]
    return max(root - shift for shift, root in found), max(root + shift for shift, root in found)


def _discriminant(z: float, slope: float, step: np.ndarray, deep: np.ndarray, turn: int) -> float:
    x, mixed = slope * z, turn * (step @ deep)
    return float((x * z - mixed) ** 2 - (z * z - deep @ deep) * (x * x - step @ step))


def _inwards(z: float, edge: float, step: np.ndarray, deep: np.ndarray) -> float:
    """How far beyond the edge, in slopes, the centre may be of one that still reaches it."""
    beyond = 0.0
    for _ in range(ROUNDS):
        beyond = _sides(z, edge + beyond, step, deep)[0]
    return beyond * (1 + 1e-3)


def _whole(pixels: float) -> int:
    return int(np.ceil(pixels))


def _window(places: np.ndarray, half: float, size: tuple[int, int]) -> Window:
    """The pixels within `half` of places [N, 2], given in pixels off the middle of the picture."""
    middle = np.array(size) / 2
    low = np.clip(np.floor(places.min(axis=0) + middle - half) - MARGIN, 0, size)
    high = np.clip(np.ceil(places.max(axis=0) + middle + half) + MARGIN, 0, size)
    (x, y), (right, bottom) = low.astype(int), high.astype(int)
    return Window(int(x), int(y), int(right - x), int(bottom - y))
