"""`Case`, `Check` and `Bench`: one stress case and its small scenes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from splatgl import reference
from splatgl.data.volume import Volume
from splatgl.reference.renderer import Renderer
from splatgl.splat.camera import Camera, Vector
from splatgl.splat.extract import extract
from splatgl.splat.kernels import kernel
from splatgl.splat.settings import Settings
from splatgl.splat.splats import Splats
from splatgl.splat.transfer import Transfer

# tolerance for comparison with closed forms: nothing is omitted for speed
FINEST = 1e-6
# closed forms are of splats one by one, or of values on one ray through each pixel
PLAIN = {"compositing": "splats", "antialias": "paper"}

# splats of a volume and a transfer function, classified before
voxels = partial(extract, classification="pre")


class Bench:
    """Renders and counts. All images are float64 [H, W, 4], linear, premultiplied, row 0 at the top.

    pictures: number of images drawn by `draw`; bad_pixels: number of their non-finite values.
    """

    def __init__(self, renderer: Renderer) -> None:
        self.renderer = renderer
        self.pictures = 0
        self.bad_pixels = 0

    def draw(self, splats: Splats, camera: Camera, **settings: Any) -> np.ndarray:
        """Renders by OpenGL, to FINEST unless a tolerance is given: the result under test."""
        asked = Settings(**{**PLAIN, "tolerance": FINEST, **settings})
        pixels = self.renderer.render(splats, camera, asked).pixels.astype(np.float64)
        self.pictures += 1
        self.bad_pixels += int((~np.isfinite(pixels)).sum())
        return pixels

    def paper(self, splats: Splats, camera: Camera, **settings: Any) -> np.ndarray:
        """Renders by OpenGL as in 1998: hybrid quads, 8-bit table and target, opacity attenuation."""
        return self.renderer.render(splats, camera, Settings.paper(**settings)).pixels.astype(np.float64)

    def truth(self, splats: Splats, camera: Camera, **settings: Any) -> np.ndarray:
        """Renders exact integrals in float64 [M98 Table 1 row 1]."""
        return reference.render(splats, camera, Settings(**{**PLAIN, **settings})).pixels


# relative errors of values below this fraction of the largest are relative to that fraction
SMALLEST = 1e-300


@dataclass(frozen=True)
class Check:
    """A comparison: exact and measured value where the error is largest, that error, and its bound.

    relative: whether errors are relative to the exact value, or absolute (linear light; in X-rays Σ τ).
    bound: finite, as an infinite one promises nothing and is never kept.
    paper: result of the paper's own form, at its largest error; None: not available.
    """

    what: str
    right: float
    found: float
    error: float
    bound: float
    relative: bool
    paper: float | None
    paper_error: float | None

    @property
    def ok(self) -> bool:
        """Whether the error is within the bound, and that finite; NaN never is."""
        return bool(self.error <= self.bound < np.inf)

    @property
    def share(self) -> float:
        """Error over bound; infinite if a bound of 0 is violated."""
        if self.ok:
            return self.error / self.bound if self.bound > 0 else 0.0
        return self.error / self.bound if 0 < self.bound < np.inf and np.isfinite(self.error) else float("inf")


@dataclass(frozen=True)
class Case:
    """name: its identifier. stresses: the extreme property. how: scene, view and settings. right: source of the result.

    run renders it and returns its checks.
    """

    name: str
    stresses: str
    how: str
    right: str
    run: Callable[[Bench], list[Check]]


@dataclass(frozen=True)
class Result:
    """Result of a case. bad_pixels: NaN or infinite values over all its images."""

    case: Case
    checks: tuple[Check, ...]
    pictures: int
    bad_pixels: int
    seconds: float

    @property
    def ok(self) -> bool:
        """Whether every check is within its bound and every pixel is finite."""
        return self.bad_pixels == 0 and all(check.ok for check in self.checks)

    @property
    def worst(self) -> Check:
        """The check nearest to its bound, or farthest over it."""
        return max(self.checks, key=lambda check: check.share)


def check(
    what: str,
    found: ArrayLike,
    right: ArrayLike,
    bound: float,
    paper: ArrayLike | None = None,
    relative: bool = False,
) -> Check:
    """The largest error of values of any shape against the exact values, which broadcast to that shape."""
    answer = np.asarray(right, dtype=np.float64)
    worst = _worst(found, answer, relative)
    papers = _worst(paper, answer, relative) if paper is not None else (None, None, None)
    return Check(what, worst[0], worst[1], worst[2], bound, relative, papers[1], papers[2])


def raised(error: Exception) -> Check:
    """A failed check for a case that raised an error."""
    text = f"{type(error).__name__}: {error}".splitlines()[0]
    return Check(text, float("nan"), float("nan"), float("inf"), 0.0, False, None, None)


def _worst(found: ArrayLike, right: np.ndarray, relative: bool) -> tuple[float, float, float]:
    """(right, found, error) where the error is largest; NaN counts as infinite."""
    values, answer = np.broadcast_arrays(np.asarray(found, dtype=np.float64), right)
    with np.errstate(invalid="ignore", over="ignore"):
        error = np.abs(values - answer)
        if relative:
            error = error / np.maximum(np.abs(answer), SMALLEST)
    error = np.where(np.isnan(error), np.inf, error)
    # of equal errors, take the largest exact value: the background is uninformative
    place = np.unravel_index(int(np.where(error == error.max(), np.abs(answer), -1.0).argmax()), error.shape)
    return float(answer[place]), float(values[place]), float(error[place])


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
