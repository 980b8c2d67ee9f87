"""Built-in scenes: the paper's tunnel, terrain and nerve, phantoms with known answers, and analytic fields.

A formula takes world points [3, P] and returns values [P] and gradients [P, 3] per world length.

Deterministic: seeds are fixed. Every scene provides view hints.

```python
image = sg.render(sg.scenes.marschner_lobb(), size=64)
image = sg.render("letter-f", size=64)  # by name
```
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from splatgl.coercion import public
from splatgl.data.scenes.nerve_model import nerve
from splatgl.data.scenes.terrain_model import terrain
from splatgl.data.volume import Hints, Triple, Volume
from splatgl.errors import expected

Formula = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]

# half the side of the cube that is sampled, around the world's origin
HALF = 1.0
# samples along a side
MARSCHNER_LOBB_SIZE, SIZE = 40, 48
# frequency and amplitude of the rings
RINGS, AMPLITUDE = 6.0, 0.25
# centre, radius and weight of each ball
BALLS = (((-0.25, 0.1, 0.0), 0.3, 1.0), ((0.35, -0.2, 0.2), 0.25, 0.8))
# angular frequency and phase along x, y, z
WAVES = ((5.0, 0.0), (4.0, 1.0), (6.0, 0.5))


def marschner_lobb_at(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rings whose frequency is just below what 40 samples a side can represent.

    (1 − sin(πz/2) + α (1 + cos(2πf cos(πr/2)))) / (2 (1 + α)).
    [Marschner & Lobb 1994, An evaluation of reconstruction filters for volume rendering, §5.1]
    """
    x, y, z = points
    r = np.hypot(x, y)
    inner, scale = 2 * np.pi * RINGS * np.cos(np.pi * r / 2), 2 * (1 + AMPLITUDE)
    value = (1 - np.sin(np.pi * z / 2) + AMPLITUDE * (1 + np.cos(inner))) / scale
    radial = AMPLITUDE * np.pi**2 * RINGS * np.sin(inner) * np.sin(np.pi * r / 2) / scale
    away = radial / np.where(r > 0, r, 1.0)
    return value, np.stack([away * x, away * y, -np.pi / 2 * np.cos(np.pi * z / 2) / scale], axis=1)


def balls_at(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Σ w exp(−(r/R)⁴) over BALLS."""
    value, gradient = np.zeros(points.shape[1]), np.zeros(points.T.shape)
    for center, radius, weight in BALLS:
        off = (points.T - center) / radius
        square = (off * off).sum(axis=1)
        part = weight * np.exp(-(square**2))
        value += part
        gradient -= (4 * part * square / radius)[:, None] * off
    return value, gradient


def sinusoids_at(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """½ + ½ Π sin(ωp + φ) over WAVES."""
    frequency, phase = np.array(WAVES).T[..., None]
    sine, cosine = np.sin(frequency * points + phase), frequency * np.cos(frequency * points + phase)
    x, y, z = sine
    gradient = np.stack([cosine[0] * y * z, x * cosine[1] * z, x * y * cosine[2]], axis=1)
    return 0.5 + 0.5 * x * y * z, 0.5 * gradient


def marschner_lobb() -> Volume:
    """The test signal of Marschner & Lobb on their grid: float32, 40³ samples."""
    return _sample_formula("marschner-lobb", MARSCHNER_LOBB_SIZE, 1, ((0.4, 0.0), (0.6, 0.6)))


def balls() -> Volume:
    """Two soft balls: float32, 48³ samples."""
    return _sample_formula("balls", SIZE, 1, ((0.3, 0.0), (0.7, 0.6)))


@public
def sinusoids(ratio: int = 1) -> Volume:
    """A product of sinusoids: float32, 48×48 samples in at least two slices about `ratio` steps apart."""
    if not 1 <= ratio <= SIZE // 2:
        raise expected("ratio", f"a number from 1 to {SIZE // 2}", ratio)
    return _sample_formula("sinusoids" if ratio == 1 else f"sinusoids-{ratio}", SIZE, ratio, ((0.5, 0.0), (0.8, 0.5)))


# formulas by scene
FORMULAS: dict[str, Formula] = {
    "marschner-lobb": marschner_lobb_at,
    "balls": balls_at,
    "sinusoids": sinusoids_at,
    "sinusoids-3": sinusoids_at,
}


def _sample_formula(name: str, size: int, ratio: int, points: tuple[tuple[float, float], ...]) -> Volume:
    """Samples of the formula on the cube, whose faces hold the outer ones; opacities per spacing along x."""
    formula = FORMULAS[name.removesuffix(f"-{ratio}")]
    z, y, x = np.meshgrid(*(np.linspace(-HALF, HALF, count) for count in (size // ratio, size, size)), indexing="ij")
    samples = formula(np.stack([x.ravel(), y.ravel(), z.ravel()]))[0].reshape(x.shape).astype(np.float32)
    across, along = 2 * HALF / (size - 1), 2 * HALF / (size // ratio - 1)
    hints = Hints(points=points, unit=across, colormap="viridis", shading=True)
    return Volume(samples, (across, across, along), (-HALF,) * 3, name=name, hints=hints)


OPAQUE_POINTS = ((0.0, 0.0), (255.0, 0.99))
# sRGB of the letter's parts
PAPER, LETTER_RED, GREEN, BLUE = (240, 230, 200), (230, 40, 40), (50, 200, 60), (60, 90, 240)

# boxes [x0, x1), [y0, y1), [z0, z1) in voxels, and their colours: the axes' bars are 56, 40 and 28 long
# from one corner; the letter stands on z = 14 with its arms along +x, and a stud at low y marks its front
LETTER_SHAPE = (64, 40, 56)
LETTER_PARTS = (
    ((0, 56, 0, 4, 0, 4), LETTER_RED),
    ((0, 4, 0, 40, 0, 4), GREEN),
    ((0, 4, 0, 4, 0, 28), BLUE),
    ((14, 22, 16, 24, 14, 62), PAPER),
    ((22, 46, 16, 24, 54, 62), PAPER),
    ((22, 38, 16, 24, 36, 44), PAPER),
    ((15, 21, 12, 16, 18, 24), LETTER_RED),
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


@public
def constant(shape: Sequence[int] = (32, 32, 32), value: float = 1.0) -> Volume:
    """A constant volume: float32 [D, H, W] of `shape`."""
    return Volume(np.full(tuple(shape), value, np.float32), name="constant")


@public
def single_voxel(size: int = 1) -> Volume:
    """One voxel of value 1 among zeros: float32 [size, size, size], centred at the world's origin."""
    if size < 1 or size % 2 == 0:
        raise expected("size", "an odd number of voxels", size)
    samples = np.zeros((size, size, size), np.float32)
    samples[size // 2, size // 2, size // 2] = 1.0
    corner = -float(size // 2)
    hints = Hints(points=((0.0, 0.0), (1.0, 0.9)), shading=False)
    return Volume(samples, origin=(corner, corner, corner), name="single voxel", hints=hints)


@public
def ball(
    radius: float = 30.0, spacing: Triple = (1.0, 1.0, 1.0), direction: np.ndarray | None = None, smooth: bool = True
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


__all__ = ["SCENES", "ball", "balls", "constant", "letter_f", "marschner_lobb", "nerve", "single_voxel", "sinusoids"]
__all__ += ["terrain", "tunnel"]

# the tube in voxels: the box's sides and length, and a bore that leaves 0.69 million voxels of wall
TUNNEL_SHAPE = (300, 160, 160)
TUNNEL_OUTER, TUNNEL_BORE = 80.0, 75.32
# sRGB of the checks: a black line, at z_k, is seen on both
RED, WHITE = (220, 20, 20), (250, 250, 250)
# distance of the eye from the opening, in voxels
TUNNEL_EYE = 8.0


@public
def tunnel(check: int = 10) -> Volume:
    """A tube of red and white checks along z, 160×160×300 voxels, 0.69 million of them wall.  [M98 §3.5 / Fig. 5]

    samples uint8: 255 in the wall, 0 elsewhere; color: the checks, about `check` voxels long and wide
    (an even number around). The view is down the bore. Raises InputError for checks under a voxel.
    """
    if not 1 <= check <= TUNNEL_SHAPE[0]:
        raise expected("check", f"a size from 1 to {TUNNEL_SHAPE[0]} voxels", check)
    length, height, width = TUNNEL_SHAPE
    x, y = np.arange(width) - (width - 1) / 2, np.arange(height)[:, None] - (height - 1) / 2

    # the wall's cross-section, and its checks around and along
    radius, turn = np.hypot(x, y), np.arctan2(y, x) / (2 * np.pi) + 0.5
    wall = (radius <= TUNNEL_OUTER) & (radius > TUNNEL_BORE)
    around = max(2, 2 * round(np.pi * TUNNEL_BORE / check))
    check_around = np.floor(turn * around).astype(int) % around
    check_along = np.arange(length) // check
    odd = (check_around + check_along[:, None, None]) % 2 == 1

    # repeat the cross-section along z
    samples = np.broadcast_to(wall * np.uint8(255), TUNNEL_SHAPE).copy()
    color = np.where(odd[..., None], np.array(WHITE, np.uint8), np.array(RED, np.uint8)) * wall[..., None]
    middle = ((width - 1) / 2, (height - 1) / 2)
    hints = Hints(
        points=((0.0, 0.0), (255.0, 0.99)),
        shading=False,
        eye=(*middle, -TUNNEL_EYE),
        target=(*middle, length / 2),
        up=(0.0, -1.0, 0.0),
        fov=60.0,
    )
    return Volume(samples, name="tunnel", color=color, hints=hints)


# built-in scenes by command-line name
SCENES: dict[str, Callable[[], Volume]] = {
    "tunnel": tunnel,
    "terrain": terrain,
    "nerve": nerve,
    "letter-f": letter_f,
    "marschner-lobb": marschner_lobb,
    "balls": balls,
    "sinusoids": sinusoids,
    "sinusoids-3": partial(sinusoids, 3),
}
