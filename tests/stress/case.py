"""`Case`, `Check` and `Bench`: one stress case and its small scenes."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from splatgl import reference
from splatgl.data.volume import Volume
from splatgl.geometry.camera import Camera
from splatgl.splat.extract import extract
from splatgl.splat.kernels import kernel
from splatgl.splat.settings import Settings
from splatgl.splat.splats import Splats
from splatgl.transfer.transfer import Transfer

if TYPE_CHECKING:
    from splatgl.gl.renderer import Renderer

# tolerance for comparison with closed forms: nothing is omitted for speed
FINEST = 1e-6
# closed forms are of splats one by one, or of values on one ray through each pixel
PLAIN = {"compositing": "splats", "antialias": "paper"}
# bound of float32 images against the float64 reference: a fortieth of an 8-bit level
PICTURE_BOUND = 1e-4
# bound of the radial table of 1024 entries, 1e−5 of the peak, with float32's roundings
SHAPE_BOUND = 2e-5

# pre-classified splats of a volume and a transfer function
voxels = partial(extract, classification="pre")


@dataclass(frozen=True)
class Check:
    """A comparison: exact and measured value where the error is largest, that error, and its bound.

    relative: whether errors are relative to the exact value, or absolute (linear light; in X-rays Σ τ). bound: finite.
    paper: result of the paper's settings or formula at its largest error, None if not available. The fields are columns
    of the CSV.
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
        """Whether the error is within a finite bound; NaN never is."""
        return bool(self.error <= self.bound < np.inf)

    @property
    def share(self) -> float:
        """Error over bound; infinite if a bound of 0 is violated."""
        if self.ok and self.bound == 0:
            return 0.0
        return self.error / self.bound if 0 < self.bound < np.inf and np.isfinite(self.error) else np.inf


class Bench:
    """Draws images and counts them. All are float64 [H, W, 4], linear, premultiplied, row 0 at the top.

    pictures: number of images drawn by `draw`; bad_pixels: number of their non-finite values.
    """

    def __init__(self, renderer: Renderer) -> None:
        self.renderer = renderer
        self.pictures = 0
        self.bad_pixels = 0

    def draw(self, splats: Splats, camera: Camera, **settings: Any) -> np.ndarray:
        """The result under test: drawn by OpenGL, to FINEST unless a tolerance is given."""
        image = self.renderer.render(splats, camera, Settings(**{**PLAIN, "tolerance": FINEST, **settings}))
        return self.count(image.pixels.astype(np.float64))

    def count(self, pixels: np.ndarray) -> np.ndarray:
        """The pixels, counted as an image under test."""
        self.pictures += 1
        self.bad_pixels += int((~np.isfinite(pixels)).sum())
        return pixels

    def paper(self, splats: Splats, camera: Camera, **settings: Any) -> np.ndarray:
        """The image of 1998: hybrid quads, 8-bit table and target, opacity attenuation; by OpenGL. It mixes display
        values: its error against exact splats that mix these, too, is added to the exact ones in linear light.
        """
        render, chosen, shown = self.renderer.render, Settings.paper(**settings), splats.of_display
        image = render(splats, camera, chosen).pixels.astype(np.float64)
        is_plain = not splats.shaded and np.array_equal(shown.records["color"], splats.records["color"])
        if is_plain or not chosen.mixes_display:
            return image
        exact = Settings(**{**PLAIN, "attenuation": "opacity", "tolerance": FINEST, **settings})
        light, display = (render(each, camera, exact).pixels.astype(np.float64) for each in (splats, shown))
        return image + (light - display)

    def both(self, splats: Splats, camera: Camera, **settings: Any) -> tuple[np.ndarray, np.ndarray]:
        """The image under test, and the paper's."""
        return self.draw(splats, camera, **settings), self.paper(splats, camera, **settings)

    def truth(self, splats: Splats, camera: Camera, **settings: Any) -> np.ndarray:
        """Exact integrals in float64 [M98 Table 1 row 1]."""
        return reference.render(splats, camera, Settings(**{**PLAIN, **settings})).pixels

    def check_reference(self, what: str, splats: Splats, camera: Camera, bound: float = PICTURE_BOUND) -> Check:
        """Compares an image with the float64 reference."""
        drawn, paper = self.both(splats, camera)
        return check(what, drawn, self.truth(splats, camera), bound, paper)


Run = Callable[[Bench], Iterable[Check]]


@dataclass(frozen=True)
class Case:
    """name: its identifier. stresses: the extreme property. how: scene, view and settings. right: source of the result.

    run draws it and returns or yields its checks.
    """

    name: str
    stresses: str
    how: str
    right: str
    run: Run


class Group(list[Case]):
    """Cases in the order of their definition."""

    def case(self, name: str, stresses: str, how: str, right: str) -> Callable[[Run], Run]:
        """Decorator that adds a function as a case."""

        def add(run: Run) -> Run:
            self.append(Case(name, stresses, how, right, run))
            return run

        return add


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
    what: str, drawn: ArrayLike, right: ArrayLike, bound: float, paper: ArrayLike | None = None, relative: bool = False
) -> Check:
    """Check of values of any shape against exact values, which broadcast to that shape, by their largest error."""
    exact = np.asarray(right, dtype=np.float64)
    worst = _worst(drawn, exact, relative)
    paper_worst = _worst(paper, exact, relative) if paper is not None else (None, None, None)
    return Check(what, *worst, bound, relative, *paper_worst[1:])


def check_rows(
    what: str, rows: Iterable[tuple[ArrayLike, ArrayLike, ArrayLike]], bound: float, relative: bool = False
) -> Check:
    """Check of rows (drawn, exact, paper)."""
    drawn, right, paper = zip(*rows, strict=True)
    return check(what, drawn, right, bound, paper, relative)


def exception_check(error: Exception) -> Check:
    """Failed check of a case that raised an error."""
    text = f"{type(error).__name__}: {error}".splitlines()[0]
    return Check(text, float("nan"), float("nan"), float("inf"), 0.0, False, None, None)


# relative errors of values below this fraction of the largest are relative to that fraction
SMALLEST = 1e-300


def _worst(drawn: ArrayLike, right: np.ndarray, relative: bool) -> tuple[float, float, float]:
    """(exact value, drawn value, error) where the error is largest; NaN counts as infinite."""
    values, exact = np.broadcast_arrays(np.asarray(drawn, dtype=np.float64), right)
    with np.errstate(invalid="ignore", over="ignore"):
        error = np.abs(values - exact)
        if relative:
            error = error / np.maximum(np.abs(exact), SMALLEST)
    error = np.where(np.isnan(error), np.inf, error)
    # of equal errors, take the largest exact value: the background is uninformative
    place = np.unravel_index(int(np.where(error == error.max(), np.abs(exact), -1.0).argmax()), error.shape)
    return float(exact[place]), float(values[place]), float(error[place])


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
    color = np.broadcast_to(np.asarray(colors, dtype=np.float64), (len(places), 3))
    extinction = np.broadcast_to(np.asarray(extinctions, dtype=np.float64), (len(places),))
    return Splats.from_points(places, color, extinction, spacing)


def row_of_dots(z: ArrayLike, extinctions: ArrayLike, colors: ArrayLike = (1.0, 1.0, 1.0)) -> Splats:
    """Splats on the z axis."""
    return dots(np.multiply.outer(np.asarray(z), (0.0, 0.0, 1.0)), extinctions, colors)


def lattice(*axes: ArrayLike) -> np.ndarray:
    """[N, D]: all points with these coordinates along the axes, the last axis fastest."""
    return np.stack(np.meshgrid(*map(np.asarray, axes), indexing="ij"), axis=-1).reshape(-1, len(axes))


def transfer(points: Sequence[Sequence[float]] = RAMP, unit: float | None = None, shading: bool = False) -> Transfer:
    """Opacity over those values, white in light: the colours span gray from the first value to the last."""
    return Transfer(points=points, unit=unit, shading=shading)


@lru_cache(maxsize=8)
def block(shape: tuple[int, int, int], opacity: float, spacing: tuple[float, float, float] = (1.0, 1.0, 1.0)) -> Splats:
    """A constant box of (x, y, z) voxels, white, its first sample at the origin; opacity per mean spacing."""
    samples = np.ones(shape[::-1], np.uint8)
    return voxels(Volume(samples, spacing), transfer(((0.0, 0.0), (1.0, opacity))))


def noise(shape: tuple[int, int, int], opacity: float) -> np.ndarray:
    """Random samples [z, y, x] from 0 to `opacity`, float32."""
    return np.random.default_rng(1998).uniform(0.0, opacity, shape[::-1]).astype(np.float32)


def random_splats(shape: tuple[int, int, int]) -> Splats:
    """Splats of random opacities up to 0.3."""
    return voxels(Volume(noise(shape, 0.3)), transfer())


def ahead(fov: float, size: tuple[int, int] = (33, 33)) -> Camera:
    """Perspective camera at the origin that looks along +z."""
    return Camera.look_at((0.0, 0.0, 0.0), (0.0, 0.0, 1.0), UP, fov, size)


def parallel(
    pitch: float, size: tuple[int, int] = (33, 33), center: tuple[float, float] = (0.0, 0.0), before: float = -10.0
) -> Camera:
    """Orthographic rays along +z, pixels of that size, centred on the axis through `center`, from z = `before`."""
    eye = np.array([*center, before])
    return Camera.orthographic(eye, eye + np.array([0.0, 0.0, 1.0]), UP, pitch * size[1], size)


def rays_of(camera: Camera) -> np.ndarray:
    """[H, W, 3]: directions of the pixels' rays in eye axes, of depth 1."""
    across, down = np.meshgrid(*camera.slopes())
    return np.stack([across, down, np.ones_like(across)], axis=-1)


def distance_of(camera: Camera) -> np.ndarray:
    """[H, W]: distance of each pixel's ray from the view's axis at depth 1."""
    return np.asarray(np.hypot(*np.meshgrid(*camera.slopes())))


def box_ends(eye: np.ndarray, rays: np.ndarray, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(near, far) [H, W]: where rays [H, W, 3] from the eye on are in a box, in lengths of the rays; 0, 0 outside."""
    with np.errstate(divide="ignore", invalid="ignore"):
        ends = np.stack([(low - eye) / rays, (high - eye) / rays])
    near, far = np.maximum(ends.min(axis=0).max(axis=-1), 0.0), ends.max(axis=0).min(axis=-1)
    is_hit = far > near
    return np.where(is_hit, near, 0.0), np.where(is_hit, far, 0.0)


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
