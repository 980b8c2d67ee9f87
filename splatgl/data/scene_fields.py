"""Scenes sampled from formulas: what lies between their voxels is known.

A formula takes world points [3, P] and returns values [P] and gradients [P, 3] per world length.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from splatgl.data.volume import Hints, Volume
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
    return _sampled("marschner-lobb", MARSCHNER_LOBB_SIZE, 1, ((0.4, 0.0), (0.6, 0.6)))


def balls() -> Volume:
    """Two soft balls: float32, 48³ samples."""
    return _sampled("balls", SIZE, 1, ((0.3, 0.0), (0.7, 0.6)))


def sinusoids(ratio: int = 1) -> Volume:
    """A product of sinusoids: float32, 48×48 samples in slices about `ratio` times as far apart as they are.

    Raises InputError for a ratio that leaves less than two slices.
    """
    if not 1 <= ratio <= SIZE // 2:
        raise expected("ratio", f"a number from 1 to {SIZE // 2}", ratio)
    return _sampled("sinusoids" if ratio == 1 else f"sinusoids-{ratio}", SIZE, ratio, ((0.5, 0.0), (0.8, 0.5)))


# formulas by scene
FORMULAS: dict[str, Formula] = {
    "marschner-lobb": marschner_lobb_at,
    "balls": balls_at,
    "sinusoids": sinusoids_at,
    "sinusoids-3": sinusoids_at,
}


def _sampled(name: str, size: int, ratio: int, points: tuple[tuple[float, float], ...]) -> Volume:
    """Samples of the formula on the cube, whose faces hold the outer ones; opacities per spacing along x."""
    formula = FORMULAS[name.removesuffix(f"-{ratio}")]
    z, y, x = np.meshgrid(*(np.linspace(-HALF, HALF, count) for count in (size // ratio, size, size)), indexing="ij")
    samples = formula(np.stack([x.ravel(), y.ravel(), z.ravel()]))[0].reshape(x.shape).astype(np.float32)
    across, along = 2 * HALF / (size - 1), 2 * HALF / (size // ratio - 1)
    hints = Hints(points=points, unit=across, colormap="viridis", shading=True)
    return Volume(samples, (across, across, along), (-HALF,) * 3, name=name, hints=hints)
