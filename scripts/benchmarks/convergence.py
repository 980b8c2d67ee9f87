"""Convergence with table size, voxel size and image size: observed and expected orders."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from itertools import pairwise

import numpy as np

from splatgl import reference
from splatgl.data.scenes import ball
from splatgl.geometry.camera import Camera
from splatgl.gl.renderer import Renderer
from splatgl.reference.field import field_integral, ray_integral
from splatgl.splat.extract import extract
from splatgl.splat.settings import Footprint, Settings
from splatgl.splat.splats import Splats
from splatgl.transfer.transfer import Transfer

# radius of a ball in world units, its distance, and the angle of view
RADIUS, DISTANCE, FOV = 10.0, 40.0, 36.0
# pixels per side, unless varied
SIZE = 96
# opacity at the ball's centre, over a length of 1
OPACITY = 0.3
# points along a ray through the ball, for the analytic integral
POINTS = 401
# rays within this fraction of the radius from the centre: the rim converges with another order
INNER = 0.7

# (varied value, relative RMSE)
Pair = tuple[float, float]


@dataclass(frozen=True)
class Study:
    """A study. unit: of the varied value; expected: order of convergence; floor: limit of convergence.

    pairs: from coarse to fine; the bool says whether to draw all values.
    """

    name: str
    unit: str
    expected: float
    floor: str
    pairs: Callable[[Renderer, bool], Iterator[Pair]]

    def rows(self, renderer: Renderer, full: bool = False) -> list[tuple[float, float, float | None]]:
        """Value, error and order by refinement. full: with all values, however long they take."""
        pairs = list(self.pairs(renderer, full))
        return [(value, error, order) for (value, error), order in zip(pairs, orders(pairs), strict=True)]


def orders(pairs: list[Pair]) -> list[float | None]:
    """log(error ratio)/log(value ratio) between neighbours; None for the first, and where an error is 0."""
    result: list[float | None] = [None]
    for (a, coarse), (b, fine) in pairwise(pairs):
        is_known = coarse > 0 and fine > 0
        sign = 1 if fine < coarse else -1
        result.append(sign * abs(float(np.log(coarse / fine) / np.log(b / a))) if is_known else None)
    return result


def _transfer() -> Transfer:
    """Opacity in proportion to the value, white."""
    values = np.linspace(0, 1, 65).tolist()
    opacities = (-np.expm1(np.log1p(-OPACITY) * np.array(values))).tolist()
    return Transfer(points=list(zip(values, opacities, strict=True)), unit=1.0, shading=False)


def _splats(spacing: float) -> Splats:
    return extract(ball(RADIUS, (spacing,) * 3), _transfer(), classification="pre")


def _camera(size: int) -> Camera:
    # off the axes, so that no lattice plane is a row of pixels
    eye = DISTANCE * np.array([0.48, -0.8, 0.36])
    return Camera.look_at(eye, (0.0, 0.0, 0.0), (0.0, 0.0, 1.0), FOV, (size, size))


def _rmse(drawn: np.ndarray, right: np.ndarray) -> float:
    return float(np.sqrt(((drawn - right) ** 2).mean() / (right**2).mean()))


def tables(kind: Footprint, renderer: Renderer, full: bool) -> Iterator[Pair]:
    """Texels of a footprint table, or entries of a radial one, against the float64 reference, before z_k."""
    splats, camera = _splats(1.0), _camera(SIZE)
    right = reference.render(splats, camera, Settings.like("0.1", antialias="off")).pixels
    settings = Settings.like("0.1", antialias="off", footprint=kind, align="exact", occlusion="off")
    for size in (16, 32, 64, 128, 256, 512, *((1024, 2048) if full else ())):
        yield size, _rmse(renderer.render(splats, camera, settings.replace(table_size=size)).pixels, right)


def voxels(renderer: Renderer, full: bool) -> Iterator[Pair]:
    """Voxels along the ball's radius; X-ray sums against the ball's own line integrals."""
    camera = _camera(SIZE)
    x, y = np.meshgrid(*camera.slopes())
    # distances of the rays from the ball's centre
    closest = DISTANCE * np.sqrt((x * x + y * y) / (1 + x * x + y * y))
    inner = closest < INNER * RADIUS
    right = _depths(closest)[inner]
    for count in (4, 6, 8, 12, 16, *((24, 32, 48, 64) if full else ())):
        settings = Settings.like("0.1", blend="xray", antialias="off")
        drawn = renderer.render(_splats(RADIUS / count), camera, settings).pixels[..., 3]
        yield count, _rmse(drawn[inner].astype(np.float64), right)


def _depths(closest: np.ndarray) -> np.ndarray:
    """Optical depth along rays at that distance: σ ½ (1 + cos(π r/R)), by the trapezoidal rule."""
    sigma = -np.log1p(-OPACITY)
    half = np.sqrt(np.maximum(RADIUS**2 - closest**2, 0.0))
    t = np.linspace(0, 1, POINTS)
    r = np.sqrt(closest[..., None] ** 2 + (half[..., None] * t) ** 2)
    return np.asarray(2 * half * sigma * np.trapezoid(_value(r), t, axis=-1))


def _value(r: np.ndarray) -> np.ndarray:
    """The ball's value at distances r from its centre."""
    return np.asarray(0.5 * (1 + np.cos(np.pi * np.minimum(r / RADIUS, 1.0))))


def distance(renderer: Renderer, full: bool) -> Iterator[Pair]:
    """Voxels along the ball's radius, all beyond z_k, against the float64 reference: exact to second order in depth."""
    camera = _camera(6)
    for count in (4, 6, 8, 12, *((16, 24, 32) if full else ())):
        splats, settings = _splats(RADIUS / count), Settings.like("0.1", attenuation="opacity", occlusion="off")
        right = reference.render(splats, camera, settings).pixels
        yield count, _rmse(renderer.render(splats, camera, settings).pixels, right)


def picture(renderer: Renderer, full: bool) -> Iterator[Pair]:
    """Pixels along a side, all splats beyond z_k, against supersampling: the blur of stretched splats."""
    splats = _splats(0.25 if full else 0.4)
    for size in (8, 12, 16, 24, *((32, 48, 64) if full else ())):
        camera, settings = _camera(size), Settings.like("0.1", occlusion="off", attenuation="optical-depth")
        right = renderer.render(splats, camera, settings.replace(antialias="supersample", samples=16)).pixels
        yield size, _rmse(renderer.render(splats, camera, settings).pixels.astype(np.float64), right)


def samples(renderer: Renderer, full: bool) -> Iterator[Pair]:
    """Samples along an axis of a pixel, against many more, voxels smaller than pixels."""
    splats, camera = _splats(0.5), _camera(12)
    most = Settings.like("0.1", antialias="supersample", samples=48, occlusion="off")
    right = renderer.render(splats, camera, most).pixels.astype(np.float64)
    for count in (1, 2, 3, 4, 6, 8, *((12, 16) if full else ())):
        yield count, _rmse(renderer.render(splats, camera, most.replace(samples=count)).pixels, right)


def slabs(renderer: Renderer, full: bool) -> Iterator[Pair]:
    """Slabs a voxel of the ray integral, against many more: the discretization error of the third truth."""
    splats, camera = _splats(1.0), _camera(12)
    right = ray_integral(splats, camera, steps_per_voxel=64).pixels
    for count in (1, 2, 4, *((8, 16) if full else ())):
        yield count, _rmse(ray_integral(splats, camera, steps_per_voxel=count).pixels, right)


def points(renderer: Renderer, full: bool) -> Iterator[Pair]:
    """Points a voxel at which the field is classified, against many more: the fourth truth's discretization error."""
    volume, camera = ball(RADIUS), _camera(12)

    def smooth(places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        r = np.linalg.norm(places + np.asarray(volume.origin)[:, None], axis=0)
        return _value(r), np.zeros(places.T.shape)

    right = field_integral(volume, _transfer(), camera, smooth, steps_per_voxel=64).pixels
    for count in (1, 2, 4, *((8, 16) if full else ())):
        yield count, _rmse(field_integral(volume, _transfer(), camera, smooth, steps_per_voxel=count).pixels, right)


STUDIES = (
    Study("table size", "texels a side", 2, "float32 from 1e−6 on", partial(tables, "table")),
    Study("radial table size", "entries", 2, "float32 from 1e−6 on", partial(tables, "auto")),
    Study("voxel size", "voxels a radius", 2, "the kernels' sum is 1 to 1 %, and averages out along a ray", voxels),
    Study("voxel size beyond z_k", "voxels a radius", 2, "float32's blending of thousands of splats a pixel", distance),
    Study("picture size", "pixels a side", 2, "what one splat can't know of its pixel", picture),
    Study("slabs of the ray integral", "slabs a voxel", 2, "nothing down to 1e−6", slabs),
    Study("points of the field", "points a voxel", 2, "nothing down to 1e−6", points),
    # the end correction takes away the second order; the rims of footprints are not smooth enough for the fourth
    Study("samples a pixel", "samples an axis", 3, "float32 from 1e−6 on", samples),
)


def main() -> int:
    """Prints a table for each study."""
    parser = argparse.ArgumentParser(description=__doc__, allow_abbrev=False)
    parser.add_argument("--full", action="store_true", help="all values, however long they take")
    full = parser.parse_args().full
    with Renderer() as renderer:
        for study in STUDIES:
            print(f"{study.name}: expected order {study.expected:g}; floor: {study.floor}")
            print(f"{study.unit:>16}  relative RMSE   order")
            for value, error, order in study.rows(renderer, full):
                print(f"{value:16.4g}  {error:13.4g}  {'' if order is None else f'{order:6.4g}'}")
            print()
    return 0


if __name__ == "__main__":
    sys.exit(main())
