"""Scenes of the stress cases: dots, sheets and blocks with known sums, and cameras along an axis."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from splatgl.data.volume import Volume
from splatgl.splat.camera import Camera, Vector
from splatgl.splat.kernels import kernel
from splatgl.splat.splats import Splats
from splatgl.splat.transfer import Transfer
from splatgl.truth.stress.bench import voxels

# rows of pixels run along +y, columns along +x, for an eye that looks along +z
UP = (0.0, -1.0, 0.0)
# from fully transparent at 0 to fully opaque at 1
RAMP = ((0.0, 0.0), (1.0, 1.0))


def peak(name: str = "crawfis-max") -> float:
    """F(0), in voxels."""
    return float(kernel(name).footprint(np.zeros(())))


def dots(
    points: ArrayLike,
    extinctions: ArrayLike = 1.0,
    colors: ArrayLike = (1.0, 1.0, 1.0),
    spacing: float | Sequence[float] = 1.0,
) -> Splats:
    """Single splats [N, 3], by default white and of extinction 1."""
    places = np.asarray(points, dtype=np.float64).reshape(-1, 3)
    count = len(places)
    return Splats.from_points(
        places,
        np.broadcast_to(np.asarray(colors, dtype=np.float64), (count, 3)),
        np.broadcast_to(np.asarray(extinctions, dtype=np.float64), (count,)),
        spacing,
    )


def transfer(points: Sequence[Sequence[float]] = RAMP, unit: float | None = None, shading: bool = False) -> Transfer:
    """Opacity over those values, white in light: the colours span gray from the first value to the last."""
    return Transfer(points=points, unit=unit, shading=shading)


@lru_cache(maxsize=8)
def block(shape: tuple[int, int, int], opacity: float, spacing: tuple[float, float, float] = (1.0, 1.0, 1.0)) -> Splats:
    """A constant box of (x, y, z) voxels, white, its first sample at the origin; opacity per mean spacing."""
    samples = np.ones(shape[::-1], np.uint8)
    return voxels(Volume(samples, spacing), transfer(((0.0, 0.0), (1.0, opacity))))


def noise(shape: tuple[int, int, int], opacity: float, seed: int = 1998) -> np.ndarray:
    """Random samples [z, y, x] from 0 to `opacity`, float32."""
    return np.random.default_rng(seed).uniform(0.0, opacity, shape[::-1]).astype(np.float32)


def ahead(eye: Vector = (0.0, 0.0, 0.0), fov: float = 60.0, size: tuple[int, int] = (33, 33)) -> Camera:
    """A perspective eye that looks along +z."""
    return Camera.look_at(eye, np.asarray(eye, np.float64) + np.array([0.0, 0.0, 1.0]), UP, fov, size)


def parallel(
    pitch: float, size: tuple[int, int] = (33, 33), center: tuple[float, float] = (0.0, 0.0), before: float = -10.0
) -> Camera:
    """Orthographic rays along +z, pixels of that size, centred on the axis through `center`, from z = `before`."""
    eye = np.array([*center, before])
    return Camera.orthographic(eye, eye + np.array([0.0, 0.0, 1.0]), UP, pitch * size[1], size)


def middle(pixels: np.ndarray) -> np.ndarray:
    """[4]: the middle pixel of an image with odd sides."""
    return np.asarray(pixels[pixels.shape[0] // 2, pixels.shape[1] // 2])


def alpha(pixels: np.ndarray) -> np.ndarray:
    """[H, W]: opacity; in X-rays Σ τ."""
    return np.asarray(pixels[..., 3])


def optical_depth(opacity: ArrayLike) -> np.ndarray:
    """−ln(1 − α); infinite at 1."""
    with np.errstate(divide="ignore"):
        return np.asarray(-np.log1p(-np.asarray(opacity, dtype=np.float64)))
