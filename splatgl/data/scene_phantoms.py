"""Phantoms with known results: a letter that shows handedness, a constant block, a ball, one voxel."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from splatgl.data.volume import Hints, Triple, Volume
from splatgl.errors import expected

OPAQUE_POINTS = ((0.0, 0.0), (255.0, 0.99))
# sRGB of the letter's parts
PAPER, RED, GREEN, BLUE = (240, 230, 200), (230, 40, 40), (50, 200, 60), (60, 90, 240)

# boxes [x0, x1), [y0, y1), [z0, z1) in voxels, and their colours: the axes' bars are 56, 40 and 28 long
# from one corner; the letter stands on z = 14 with its arms along +x, and a stud at low y marks its front
LETTER_SHAPE = (64, 40, 56)
LETTER_PARTS = (
    ((0, 56, 0, 4, 0, 4), RED),
    ((0, 4, 0, 40, 0, 4), GREEN),
    ((0, 4, 0, 4, 0, 28), BLUE),
    ((14, 22, 16, 24, 14, 62), PAPER),
    ((22, 46, 16, 24, 54, 62), PAPER),
    ((22, 38, 16, 24, 36, 44), PAPER),
    ((15, 21, 12, 16, 18, 24), RED),
)


def letter_f() -> Volume:
    """A letter F with a red x, a green y and a blue z axis of different lengths, which reveals mirroring.

    samples uint8 [64, 40, 56] (z, y, x), 255 in matter; color sRGB. Seen from the front it reads as an F.
    """
    samples = np.zeros(LETTER_SHAPE, np.uint8)
    color = np.zeros((*LETTER_SHAPE, 3), np.uint8)
    for (x0, x1, y0, y1, z0, z1), paint in LETTER_PARTS:
        samples[z0:z1, y0:y1, x0:x1] = 255
        color[z0:z1, y0:y1, x0:x1] = paint
    hints = Hints(points=OPAQUE_POINTS, shading=True, azimuth=25.0, elevation=20.0, fov=40.0)
    return Volume(samples, name="letter-f", color=color, hints=hints)


def constant(shape: Sequence[int] = (32, 32, 32), value: float = 1.0) -> Volume:
    """A constant volume: float32 [D, H, W] of `shape`."""
    return Volume(np.full(tuple(shape), value, np.float32), name="constant")


def single_voxel(size: int = 1) -> Volume:
    """One voxel of value 1 among zeros: float32 [size, size, size], centred at the world's origin."""
    if size < 1 or size % 2 == 0:
        raise expected("size", "an odd number of voxels", size)
    samples = np.zeros((size, size, size), np.float32)
    samples[size // 2, size // 2, size // 2] = 1.0
    corner = -float(size // 2)
    hints = Hints(points=((0.0, 0.0), (1.0, 0.9)), shading=False)
    return Volume(samples, origin=(corner, corner, corner), name="single voxel", hints=hints)


def ball(
    radius: float = 30.0,
    spacing: Triple = (1.0, 1.0, 1.0),
    direction: np.ndarray | None = None,
    smooth: bool = True,
) -> Volume:
    """A ball around the world's origin, on any affine grid with a sample there.

    samples float64: ½ (1 + cos(π r / radius)) within the radius (in world units), or 1 if not smooth; 0 beyond.
    """
    if not radius > 0:
        raise expected("radius", "a positive length", radius)
    axes = np.eye(3) if direction is None else np.asarray(direction, dtype=np.float64)
    # a one-voxel volume validates the grid; then the number of steps along each axis within the ball
    grid = Volume(np.zeros((1, 1, 1)), spacing=spacing, direction=axes)
    matrix = grid.world_from_index
    reach = np.ceil(radius * np.linalg.norm(np.linalg.inv(matrix), axis=1)).astype(int) + 1
    x, y, z = (np.arange(-n, n + 1, dtype=np.float64) for n in reach)

    # |A i| at every index i
    points = matrix[:, 0] * x[:, None] + (matrix[:, 1] * y[:, None, None]) + (matrix[:, 2] * z[:, None, None, None])
    r = np.linalg.norm(points, axis=-1)
    inside = 0.5 * (1.0 + np.cos(np.pi * np.minimum(r / radius, 1.0))) if smooth else np.ones_like(r)
    corner = -(matrix @ reach)
    origin = (corner[0], corner[1], corner[2])
    name = "smooth ball" if smooth else "hard ball"
    hints = Hints(points=((0.0, 0.0), (1.0, 0.5)))
    return Volume(np.where(r <= radius, inside, 0.0), grid.spacing, origin, axes, name=name, hints=hints)
