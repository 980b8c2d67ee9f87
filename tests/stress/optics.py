"""Stress cases of optics: range of opacity, piles of splats, and fog."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product

import numpy as np

from splatgl.data.volume import Volume
from splatgl.geometry.camera import Camera
from splatgl.splat.kernels import kernel
from splatgl.splat.splats import Splats
from splatgl.transfer.regions import OPAQUE
from tests.stress.case import (
    PICTURE_BOUND,
    Bench,
    Check,
    Group,
    alpha,
    box_ends,
    check,
    check_rows,
    dots,
    middle,
    parallel,
    peak,
    rays_of,
    row_of_dots,
    transfer,
    voxels,
)

FOG = Group()
VIEWS = 50
SEED = 50
FOG_BOUND = 0.011
SHAPE = (30, 28, 32)
SIZE = (96, 6)
# minimum distance of a ray from the box's edges in voxels, times max(1, m): a kernel reaches 1.56 m
CLEAR = 2.0
# minimum path length, voxels
SHORTEST = 4.0


@dataclass(frozen=True)
class FogView:
    """A box of fog and an eye. opacity: per mean spacing."""

    spacing: np.ndarray
    camera: Camera
    opacity: float
    inside: bool

    def splats(self) -> Splats:
        """Splats of the box, all voxels with this opacity."""
        volume = Volume(np.ones(SHAPE[::-1], np.uint8), tuple(self.spacing))
        return voxels(volume, transfer(((0.0, 0.0), (1.0, self.opacity))))


def views(seed: int = SEED) -> list[FogView]:
    """Random directions, distances and spacings; every fifth eye is inside, at least two voxels from a face."""
    rng = np.random.default_rng(seed)
    accepted: list[FogView] = []
    while len(accepted) < VIEWS:
        view = _view(rng, len(accepted) % 5 == 0)
        # at least one ray must satisfy the conditions
        if paths(view)[1].any():
            accepted.append(view)
    return accepted


def _view(rng: np.random.Generator, inside: bool) -> FogView:
    # aspect ratios up to 1:3, at any scale
    spacing = np.exp(rng.uniform(-0.55, 0.55, 3)) * 10.0 ** rng.uniform(-3, 3)
    box = spacing * SHAPE
    center = spacing * (np.array(SHAPE) - 1) / 2
    direction = rng.normal(size=3)
    direction /= np.linalg.norm(direction)
    target = center + rng.uniform(-0.2, 0.2, 3) * box
    # a strip of an image of 200 to 800 rows: the depth at which a voxel is a pixel wide
    z_k = rng.uniform(150.0, 600.0)
    fov = float(np.degrees(2 * np.arctan(SIZE[1] / 2 / z_k)))
    if inside:
        eye = spacing * rng.uniform(2.0, np.array(SHAPE) - 3.0)
    else:
        # up to several voxels a pixel
        far = z_k * spacing.max() * rng.uniform(0.3, 2.0)
        eye = center - direction * (np.linalg.norm(box) / 2 + far)
    up = rng.normal(size=3)
    camera = Camera.look_at(eye, eye + direction if inside else target, up, fov, SIZE)
    return FogView(spacing, camera, float(rng.uniform(0.02, 0.08)), inside)


def paths(view: FogView, reach: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """(σL [H, W], clear [H, W]): each ray's optical depth, and whether it stays clear of the edges.

    reach: the box grows by so many voxels, times max(1, m).
    """
    camera, spacing = view.camera, view.spacing
    rays = rays_of(camera) @ camera.eye_from_world / spacing
    eye = camera.eye / spacing
    pitch = camera.extent / camera.size[1] / spacing.min()
    farthest = camera.eye_from_points(spacing * np.array(list(product(*((0, size) for size in SHAPE)))))[:, 2].max()
    grown = reach * max(1.0, pitch * farthest)
    low, high = np.full(3, -0.5) - grown, np.array(SHAPE) - 0.5 + grown
    near, far = box_ends(eye, rays, low, high)
    length = (far - near) * np.linalg.norm(rays * spacing, axis=-1)
    mean = float(np.prod(spacing) ** (1 / 3))
    depth = -np.log1p(-view.opacity) / mean * length
    clear = (far > near) & ((far - near) * np.linalg.norm(rays, axis=-1) >= SHORTEST)
    for start, along in _edges(low, high):
        away, at = _distance_to_edge(eye, rays, start, along)
        clear &= away >= CLEAR * np.maximum(1.0, pitch * at)
    return depth, clear


def _edges(low: np.ndarray, high: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """The box's twelve edges: start and vector to the end."""
    for axis in range(3):
        for corner in product((False, True), repeat=2):
            start = low.copy()
            start[[n for n in range(3) if n != axis]] = np.where(corner, np.delete(high, axis), np.delete(low, axis))
            yield start, np.eye(3)[axis] * (high - low)


def _distance_to_edge(
    eye: np.ndarray, rays: np.ndarray, start: np.ndarray, along: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """(distance in voxels [H, W], depth [H, W]) from rays [H, W, 3], which start at the eye, to an edge."""
    unit = rays / np.linalg.norm(rays, axis=-1, keepdims=True)
    # across the ray, the edge is start − eye + s · along
    first, step = (part - (unit @ part)[..., None] * unit for part in (start - eye, along))
    square = (step * step).sum(axis=-1)
    share = np.clip(-(first * step).sum(axis=-1) / np.maximum(square, 1e-12), 0.0, 1.0)
    nearest = start - eye + share[..., None] * along
    ahead = np.maximum((nearest * unit).sum(axis=-1), 0.0)
    away = np.linalg.norm(nearest - ahead[..., None] * unit, axis=-1)
    return away, ahead / np.linalg.norm(rays, axis=-1)


@FOG.case(
    "constant-fog",
    "fog seen from 50 random directions, distances and spacings, a fifth of them from inside",
    "30×28×32 voxels of 1e−3 to 1e3 units, up to 1:3, pictures of 200 to 800 rows; rays that keep 2 max(1, m) "
    "voxels from the box's edges, eye at least 2 voxels from a face, path at least 4 voxels; nearer the "
    "edges the result lies between those of boxes smaller and larger by a kernel's reach",
    "closed form: 1 − exp(−σL)",
)
def _fog(bench: Bench) -> Iterator[Check]:
    """Rays clear of the edges by inside (True, False); those nearer edges under None."""
    rows: dict[bool | None, list[tuple[np.ndarray, np.ndarray, np.ndarray]]] = {False: [], True: [], None: []}
    radius = kernel("crawfis-max").radius
    for view in views():
        depth, clear = paths(view)
        drawn, paper = map(alpha, bench.both(view.splats(), view.camera))
        rows[view.inside].append((drawn[clear], -np.expm1(-depth[clear]), paper[clear]))
        limits = (-np.expm1(-paths(view, reach)[0]) for reach in (-radius, radius))
        rows[None].append((drawn[~clear], np.clip(drawn, *limits)[~clear], paper[~clear]))
    for inside, where in ((False, "from outside"), (True, "from inside"), (None, "nearer edges")):
        drawn, right, paper = map(np.concatenate, zip(*rows[inside], strict=True))
        yield check(f"{len(drawn)} rays {where}", drawn, right, FOG_BOUND, paper, inside is not None)


OPACITY = Group()
# float32 sums and products: some roundings of 6e−8
ROUNDING = 1e-6
# transmitted light: two of float32's smallest steps below 1
LIGHT = 2.0**-23
# opacities, including 1; a voxel of 1 is read as the next smaller opacity
OPACITIES = (1e-8, 1e-7, 1e-4, 0.5, 1 - 1e-4, 1 - 1e-7, 1.0)
# (opacity per length 1, thickness): 1 − (1 − a)^s, to 16 digits
CORRECTIONS = ((0.5, 0.001, 6.929070095474781e-4), (0.999, 0.0625, 0.350618368), (1e-8, 0.001, 1.000000005e-11))
# optical depths of one ray
DEPTHS = tuple(10.0**n for n in range(-12, 5))


def _one_voxel(opacity: float, spacing: float = 1.0) -> Splats:
    """A voxel of that opacity per length 1."""
    volume = Volume(np.ones((1, 1, 1), np.uint8), (spacing,) * 3)
    return voxels(volume, transfer(((0.0, 0.0), (1.0, opacity)), 1.0))


@OPACITY.case(
    "opacity-extremes",
    "opacities 1e−8, 1e−7, 0.5, 1 − 1e−7 and 1",
    "one voxel in one pixel; 1 is read as 1 − 2⁻²⁴",
    "closed form: 1 − (1 − a)^F(0)",
)
def _opacities(bench: Bench) -> list[Check]:
    rows = []
    for opacity in OPACITIES:
        drawn, paper = bench.both(_one_voxel(opacity), parallel(1.0, (1, 1)))
        right = -np.expm1(np.log1p(-min(opacity, OPAQUE)) * peak())
        rows.append((drawn[0, 0, 3], right, paper[0, 0, 3]))
    left = [(1 - drawn, 1 - right, 1 - paper) for drawn, right, paper in rows]
    return [check_rows("opacity", rows, ROUNDING, relative=True), check_rows("what is left of light", left, LIGHT)]


@OPACITY.case(
    "opacity-correction",
    "opacity stated for another length: 1 − pow(1 − a, s) loses what is below 1e−7",
    "a = 0.5, s = 0.001; a = 0.999, s = 0.0625; a = 1e−8, s = 0.001; the paper's: pow in float32",
    "30-digit arithmetic",
)
def _corrections(bench: Bench) -> list[Check]:
    by_formula, in_8_bits = [], []
    for opacity, thickness, right in CORRECTIONS:
        # the opacity at the middle of a voxel of this spacing: 1 − (1 − a)^s with s = thickness · F(0)
        splats = _one_voxel(opacity, thickness / peak())
        drawn, paper = bench.both(splats, parallel(thickness / 10, (1, 1), before=-10 * thickness))
        one = np.float32(1)
        formula = one - np.power(one - np.float32(opacity), np.float32(thickness))
        by_formula.append((drawn[0, 0, 3], right, formula))
        in_8_bits.append((drawn[0, 0, 3], right, paper[0, 0, 3]))
    return [
        check_rows("against 1 − (1 − a)ˢ", by_formula, ROUNDING, relative=True),
        check_rows("and in 8 bits", in_8_bits, ROUNDING, relative=True),
    ]


@OPACITY.case(
    "depth-range",
    "optical depths from 1e−12 to 1e4 in one ray",
    "17 splats side by side, and behind one another, faintest or densest first, each of its own colour",
    "closed form: Σ Π exp(−τ) (1 − exp(−τ)) c",
)
def _depth_range(bench: Bench) -> Iterator[Check]:
    tau = np.array(DEPTHS)
    count = len(tau)
    # side by side, five voxels apart: each alone
    row = dots(np.multiply.outer(5.0 * np.arange(count), (1.0, 0.0, 0.0)), tau / peak())
    images = bench.both(row, parallel(5.0 / 5, (5 * count, 1), (2.5 * (count - 1), 0.0)))
    drawn, paper = (alpha(pixels)[0, 2::5] for pixels in images)
    yield check("side by side", drawn, -np.expm1(-tau), 2 * ROUNDING, paper, relative=True)
    # one behind the other on a ray, the faintest nearest, and reversed
    colors = np.random.default_rng(7).uniform(0.2, 1.0, (count, 3))
    for name, order in (("faintest first", np.arange(count)), ("densest first", np.arange(count)[::-1])):
        z = np.zeros(count)
        z[order] = 4.0 * np.arange(count)
        light = np.exp(-np.concatenate([[0.0], np.cumsum(tau[order])[:-1]])) * -np.expm1(-tau[order])
        right = np.append(light @ colors[order], -np.expm1(-tau.sum()))
        drawn, paper = bench.both(row_of_dots(z, tau / peak(), colors), parallel(1.0, (1, 1)))
        yield check(name, drawn[0, 0], right, 2 * ROUNDING, paper[0, 0])


# each term above the last digit of the sum over sixteen decades must contribute
@OPACITY.case(
    "xray-range", "an X-ray sum of terms from 1e−12 to 1e4", "the same 17 splats behind one another", "closed form: Σ τ"
)
def _xray_range(bench: Bench) -> list[Check]:
    tau = np.array(DEPTHS)
    splats = row_of_dots(4.0 * np.arange(len(tau)), tau / peak())
    drawn, paper = map(middle, bench.both(splats, parallel(1.0, (1, 1)), blend="xray"))
    return [check("Σ τ", drawn, np.full(4, tau.sum()), ROUNDING, paper, relative=True)]


PILES = Group()
MILLION = 10**6
FAINT = 1e-7
# 1 − (1 − 1e−7)^1e6 to 16 digits
MILLION_FAINT = 0.0951625864882278
# Each 'over' rounds the sum by at most half a unit in its last place. Below 0.125 that is 2⁻²⁸; earlier
# sums are smaller, with half of that on average. An X-ray sum of 0.1 has the same unit.
FAINT_BOUND = MILLION * 2.0**-28
PILE = 10**5
ORDERS = ("back-to-front", "front-to-back")


@PILES.case(
    "million-faint",
    "a million splats of opacity 1e−7 on one pixel: float32 'over' rounds each",
    "one pixel; the bound is half a unit in the last place a splat. 8 bits and half float lose them all",
    "30-digit arithmetic: 1 − (1 − 1e−7)^1e6",
)
def _million_faint(bench: Bench) -> list[Check]:
    splats = dots(np.zeros((MILLION, 3)), -np.log1p(-FAINT) / peak())
    camera = parallel(1.0, (1, 1))
    drawn, paper = bench.both(splats, camera)
    half = bench.draw(splats, camera, target="rgba16f")
    front = bench.draw(splats, camera, order="front-to-back")
    xray, xray_paper = bench.both(splats, camera, blend="xray")
    return [
        check("back to front", drawn[0, 0, 3], MILLION_FAINT, FAINT_BOUND, paper[0, 0, 3]),
        check("front to back", front[0, 0, 3], MILLION_FAINT, FAINT_BOUND, half[0, 0, 3]),
        check("X-ray sum", xray[0, 0, 3], -MILLION * np.log1p(-FAINT), FAINT_BOUND, xray_paper[0, 0, 3]),
    ]


# the rounding errors could sum up to 3e−3 if all had the same sign
@PILES.case(
    "pixel-pile",
    "100 000 splats of random depth and colour on one pixel",
    "one pixel, Σ τ = 4.5; the bound is a fortieth of an 8-bit level",
    "float64 reference with compensated sums",
)
def _pile(bench: Bench) -> list[Check]:
    rng = np.random.default_rng(5)
    tau = rng.exponential(3.0 / PILE, PILE)
    # some are dense
    tau[rng.integers(0, PILE, 5)] = 0.3
    splats = row_of_dots(rng.uniform(0, 200, PILE), tau / peak(), rng.uniform(0.0, 1.0, (PILE, 3)))
    camera = parallel(1.0, (1, 1))
    right, paper = bench.truth(splats, camera), bench.paper(splats, camera)
    checks = [
        check(order.replace("-", " "), bench.draw(splats, camera, order=order), right, PICTURE_BOUND, paper)
        for order in ORDERS
    ]
    drawn, paper = bench.both(splats, camera, blend="xray")
    return [*checks, check("X-ray sum", drawn[0, 0, 3], tau.sum(), PICTURE_BOUND * 4, paper[0, 0, 3])]


@PILES.case("hidden-million", "a million splats behind an opaque one", "one pixel; the opaque splat is red", "red")
def _hidden(bench: Bench) -> list[Check]:
    rng = np.random.default_rng(6)
    z = np.append(0.0, rng.uniform(4.0, 500.0, MILLION))
    colors = np.concatenate([[(1.0, 0.0, 0.0)], rng.uniform(0.0, 1.0, (MILLION, 3))])
    # τ = 60: e⁻⁶⁰ is negligible
    splats = row_of_dots(z, np.append(60.0, rng.uniform(0.0, 1e-3, MILLION)) / peak(), colors)
    camera = parallel(1.0, (1, 1))
    paper = bench.paper(splats, camera)[0, 0]
    return [
        check(order.replace("-", " "), bench.draw(splats, camera, order=order)[0, 0], (1.0, 0, 0, 1.0), 1e-6, paper)
        for order in ORDERS
    ]
