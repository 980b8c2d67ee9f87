"""Stress cases of optics: range of opacity, piles of splats, and fog."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product

import numpy as np

from splatgl.data.volume import Volume
from splatgl.splat.camera import Camera
from splatgl.splat.kernels import kernel
from splatgl.splat.splats import Splats
from splatgl.splat.transfer import OPAQUE
from splatgl.studies.stress.case import Bench, Case, Check, alpha, check, dots, middle, parallel, peak, transfer, voxels

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
class View:
    """A box of fog and an eye. opacity: per mean spacing."""

    spacing: np.ndarray
    camera: Camera
    opacity: float
    inside: bool

    def splats(self) -> Splats:
        """Splats of the box, all voxels with this opacity."""
        volume = Volume(np.ones(SHAPE[::-1], np.uint8), tuple(self.spacing))
        return voxels(volume, transfer(((0.0, 0.0), (1.0, self.opacity))))


def views(seed: int = SEED) -> list[View]:
    """Random directions, distances and spacings; every fifth eye is inside, at least two voxels from a face."""
    rng = np.random.default_rng(seed)
    found: list[View] = []
    while len(found) < VIEWS:
        view = _view(rng, len(found) % 5 == 0)
        # at least one ray must satisfy the conditions
        if paths(view)[1].any():
            found.append(view)
    return found


def _view(rng: np.random.Generator, inside: bool) -> View:
    # aspect ratios up to 1:3, at any scale
    spacing = np.exp(rng.uniform(-0.55, 0.55, 3)) * 10.0 ** rng.uniform(-3, 3)
    box = spacing * SHAPE
    middle = spacing * (np.array(SHAPE) - 1) / 2
    direction = rng.normal(size=3)
    direction /= np.linalg.norm(direction)
    target = middle + rng.uniform(-0.2, 0.2, 3) * box
    # a strip of an image of 200 to 800 rows: the depth at which a voxel is a pixel wide
    z_k = rng.uniform(150.0, 600.0)
    fov = float(np.degrees(2 * np.arctan(SIZE[1] / 2 / z_k)))
    if inside:
        eye = spacing * rng.uniform(2.0, np.array(SHAPE) - 3.0)
    else:
        # up to several voxels a pixel
        far = z_k * spacing.max() * rng.uniform(0.3, 2.0)
        eye = middle - direction * (np.linalg.norm(box) / 2 + far)
    up = rng.normal(size=3)
    camera = Camera.look_at(eye, eye + direction if inside else target, up, fov, SIZE)
    return View(spacing, camera, float(rng.uniform(0.02, 0.08)), inside)


def paths(view: View, reach: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """(σL [H, W], clear [H, W]): each ray's optical depth, and whether it stays clear of the edges. reach: of the box
    larger by so many voxels, times max(1, m).
    """
    camera, spacing = view.camera, view.spacing
    across, down = np.meshgrid(*camera.slopes())
    rays = np.stack([across, down, np.ones_like(across)], axis=-1) @ camera.eye_from_world / spacing
    eye = camera.eye / spacing
    pitch = camera.extent / camera.size[1] / spacing.min()
    farthest = camera.eye_from_points(spacing * np.array(list(product(*((0, size) for size in SHAPE)))))[:, 2].max()
    grown = reach * max(1.0, pitch * farthest)
    low, high = np.full(3, -0.5) - grown, np.array(SHAPE) - 0.5 + grown
    with np.errstate(divide="ignore", invalid="ignore"):
        ends = np.stack([(low - eye) / rays, (high - eye) / rays])
    near, far = ends.min(axis=0).max(axis=-1), ends.max(axis=0).min(axis=-1)
    near = np.maximum(near, 0.0)
    hit = far > near
    near, far = np.where(hit, near, 0.0), np.where(hit, far, 0.0)
    length = (far - near) * np.linalg.norm(rays * spacing, axis=-1)
    voxels = (far - near) * np.linalg.norm(rays, axis=-1)
    mean = float(np.prod(spacing) ** (1 / 3))
    depth = -np.log1p(-view.opacity) / mean * length
    clear = hit & (voxels >= SHORTEST)
    for start, along in _edges(low, high):
        away, at = _apart(eye, rays, start, along)
        clear &= away >= CLEAR * np.maximum(1.0, pitch * at)
    return depth, clear


def _edges(low: np.ndarray, high: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """The box's twelve edges: start and vector to the end."""
    for axis in range(3):
        for corner in product((False, True), repeat=2):
            start = low.copy()
            start[[n for n in range(3) if n != axis]] = np.where(corner, np.delete(high, axis), np.delete(low, axis))
            yield start, np.eye(3)[axis] * (high - low)


def _apart(eye: np.ndarray, rays: np.ndarray, start: np.ndarray, along: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
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


def fog(bench: Bench) -> list[Check]:
    """Checks 1 − exp(−σL) on rays clear of the box's edges; on others that it lies between that of boxes smaller and
    larger by what a kernel reaches.
    """
    found: dict[bool, list[np.ndarray]] = {True: [], False: []}
    right: dict[bool, list[np.ndarray]] = {True: [], False: []}
    paper: dict[bool, list[np.ndarray]] = {True: [], False: []}
    edge_found, edge_right, edge_paper = [], [], []
    radius = kernel("crawfis-max").radius
    for view in views():
        depth, clear = paths(view)
        splats = view.splats()
        drawn, old = (alpha(draw(splats, view.camera)) for draw in (bench.draw, bench.paper))
        answer = -np.expm1(-depth)
        for kept, picture in ((found, drawn), (right, answer), (paper, old)):
            kept[view.inside].append(picture[clear])
        edge_found.append(drawn[~clear])
        ends = (-np.expm1(-paths(view, reach)[0]) for reach in (-radius, radius))
        edge_right.append(np.clip(drawn, *ends)[~clear])
        edge_paper.append(old[~clear])
    checks = []
    for inside in (False, True):
        own, known, eight = (np.concatenate(kept[inside]) for kept in (found, right, paper))
        name = f"{len(own)} rays from {'inside' if inside else 'outside'}"
        checks.append(check(name, own, known, FOG_BOUND, eight, relative=True))
    own, known, eight = (np.concatenate(kept) for kept in (edge_found, edge_right, edge_paper))
    return [*checks, check(f"{len(own)} rays nearer edges", own, known, FOG_BOUND, eight)]


FOG_CASES = (
    Case(
        "constant-fog",
        "fog seen from 50 random directions, distances and spacings, a fifth of them from inside",
        "30×28×32 voxels of 1e−3 to 1e3 units, up to 1:3, pictures of 200 to 800 rows; rays that keep 2 max(1, m) "
        "voxels from the box's edges, eye at least 2 voxels from a face, path at least 4 voxels; nearer the "
        "edges it lies between that of boxes smaller and larger by a kernel's reach",
        "closed form: 1 − exp(−σL)",
        fog,
    ),
)


# float32 sums and products: some roundings of 6e−8
ROUNDING = 1e-6
# transmitted light: two of float32's smallest steps below 1
LIGHT = 2.0**-23
# opacities, including 1; a voxel of 1 is read as the next smaller opacity
OPACITIES = (1e-8, 1e-7, 1e-4, 0.5, 1 - 1e-4, 1 - 1e-7, 1.0)
# (opacity per length 1, thickness): 1 − (1 − a)^s, to 16 digits
CORRECTIONS = (
    (0.5, 0.001, 6.929070095474781e-4),
    (0.999, 0.0625, 0.350618368),
    (1e-8, 0.001, 1.000000005e-11),
)
# optical depths of one ray
DEPTHS = tuple(10.0**n for n in range(-12, 5))


def opacities(bench: Bench) -> list[Check]:
    """Checks OPACITIES of one voxel against 1 − (1 − a)^F(0), and the transmitted light."""
    found, right, paper = [], [], []
    camera = parallel(1.0, (1, 1))
    for opacity in OPACITIES:
        splats = voxels(Volume(np.ones((1, 1, 1), np.uint8)), transfer(((0.0, 0.0), (1.0, opacity)), 1.0))
        found.append(bench.draw(splats, camera)[0, 0, 3])
        paper.append(bench.paper(splats, camera)[0, 0, 3])
        right.append(-np.expm1(np.log1p(-min(opacity, OPAQUE)) * peak()))
    return [
        check("opacity", found, right, ROUNDING, paper, relative=True),
        check("what is left of light", 1 - np.array(found), 1 - np.array(right), LIGHT, 1 - np.array(paper)),
    ]


def corrections(bench: Bench) -> list[Check]:
    """Checks opacities per another length against CORRECTIONS, along with float32's pow and the paper's image."""
    found, right, formula, pixels = [], [], [], []
    for opacity, thickness, known in CORRECTIONS:
        # a voxel that is `thickness` wide, and what its middle holds: 1 − (1 − a)^s with s = thickness · F(0)
        splats = voxels(
            Volume(np.ones((1, 1, 1), np.uint8), (thickness / peak(),) * 3),
            transfer(((0.0, 0.0), (1.0, opacity)), 1.0),
        )
        camera = parallel(thickness / 10, (1, 1), before=-10 * thickness)
        found.append(bench.draw(splats, camera)[0, 0, 3])
        pixels.append(bench.paper(splats, camera)[0, 0, 3])
        right.append(known)
        one = np.float32(1)
        formula.append(one - np.power(one - np.float32(opacity), np.float32(thickness)))
    return [
        check("against 1 − (1 − a)ˢ", found, right, ROUNDING, formula, relative=True),
        check("and in 8 bits", found, right, ROUNDING, pixels, relative=True),
    ]


def depth_range(bench: Bench) -> list[Check]:
    """Checks 'over' of optical depths from 1e−12 to 1e4, side by side and behind one another."""
    tau = np.array(DEPTHS)
    count = len(tau)
    # side by side, five voxels apart: each alone
    row = dots(np.stack([5.0 * np.arange(count), np.zeros(count), np.zeros(count)], axis=1), tau / peak())
    camera = parallel(5.0 / 5, (5 * count, 1), (2.5 * (count - 1), 0.0))
    alone = alpha(bench.draw(row, camera))[0, 2::5]
    paper = alpha(bench.paper(row, camera))[0, 2::5]
    right = -np.expm1(-tau)

    # one behind the other on a ray, the faintest nearest, and reversed
    checks = [check("side by side", alone, right, 2 * ROUNDING, paper, relative=True)]
    colors = np.random.default_rng(7).uniform(0.2, 1.0, (count, 3))
    for name, order in (("faintest first", np.arange(count)), ("densest first", np.arange(count)[::-1])):
        places = np.zeros((count, 3))
        places[order, 2] = 4.0 * np.arange(count)
        splats = dots(places, tau / peak(), colors)
        seen = np.exp(-np.concatenate([[0.0], np.cumsum(tau[order])[:-1]])) * -np.expm1(-tau[order])
        answer = np.append(seen @ colors[order], -np.expm1(-tau.sum()))
        view = parallel(1.0, (1, 1))
        drawn, old = bench.draw(splats, view)[0, 0], bench.paper(splats, view)[0, 0]
        checks.append(check(name, drawn, answer, 2 * ROUNDING, old))
    return checks


def xray_range(bench: Bench) -> list[Check]:
    """Sums with terms over sixteen decades: each term above the sum's last digit must contribute."""
    tau = np.array(DEPTHS)
    splats = dots(np.stack([np.zeros(len(tau)), np.zeros(len(tau)), 4.0 * np.arange(len(tau))], axis=1), tau / peak())
    camera = parallel(1.0, (1, 1))
    found = middle(bench.draw(splats, camera, blend="xray"))
    paper = middle(bench.paper(splats, camera, blend="xray"))
    return [check("Σ τ", found, np.full(4, tau.sum()), ROUNDING, paper, relative=True)]


OPTICS_CASES = (
    Case(
        "opacity-extremes",
        "opacities 1e−8, 1e−7, 0.5, 1 − 1e−7 and 1",
        "one voxel in one pixel; 1 is read as 1 − 2⁻²⁴",
        "closed form: 1 − (1 − a)^F(0)",
        opacities,
    ),
    Case(
        "opacity-correction",
        "opacity stated for another length: 1 − pow(1 − a, s) loses what is below 1e−7",
        "a = 0.5, s = 0.001; a = 0.999, s = 0.0625; a = 1e−8, s = 0.001; the paper's: pow in float32",
        "30-digit arithmetic",
        corrections,
    ),
    Case(
        "depth-range",
        "optical depths from 1e−12 to 1e4 in one ray",
        "17 splats side by side, and behind one another, faintest or densest first, each of its own colour",
        "closed form: Σ Π exp(−τ) (1 − exp(−τ)) c",
        depth_range,
    ),
    Case(
        "xray-range",
        "an X-ray sum of terms from 1e−12 to 1e4",
        "the same 17 splats behind one another",
        "closed form: Σ τ",
        xray_range,
    ),
)


MILLION = 10**6
FAINT = 1e-7
# 1 − (1 − 1e−7)^1e6 to 16 digits
MILLION_FAINT = 0.0951625864882278
# Each 'over' rounds the sum by at most half a unit in its last place. Below 0.125 that is 2⁻²⁸; earlier
# sums are smaller, with half of that on average.
FAINT_BOUND = MILLION * 2.0**-28
# a sum of 0.1 in an X-ray: the same unit
FAINT_SUM_BOUND = MILLION * 2.0**-28
PILE = 10**5
# a fortieth of an 8-bit level; the rounding errors could sum up to 3e−3 if all had the same sign
PILE_BOUND = 1e-4


def million_faint(bench: Bench) -> list[Check]:
    """Checks α of a million splats of opacity 1e−7 in either order, and their X-ray sum."""
    points = np.zeros((MILLION, 3))
    splats = dots(points, -np.log1p(-FAINT) / peak())
    camera = parallel(1.0, (1, 1))
    paper = bench.paper(splats, camera)[0, 0, 3]
    half = bench.draw(splats, camera, target="rgba16f")[0, 0, 3]
    checks = [check("back to front", bench.draw(splats, camera)[0, 0, 3], MILLION_FAINT, FAINT_BOUND, paper)]
    found = bench.draw(splats, camera, order="front-to-back")[0, 0, 3]
    checks.append(check("front to back", found, MILLION_FAINT, FAINT_BOUND, half))
    summed = bench.draw(splats, camera, blend="xray")[0, 0, 3]
    old = bench.paper(splats, camera, blend="xray")[0, 0, 3]
    checks.append(check("X-ray sum", summed, -MILLION * np.log1p(-FAINT), FAINT_SUM_BOUND, old))
    return checks


def pile(bench: Bench) -> list[Check]:
    """Checks 100 000 random splats on one pixel against the float64 reference, and their X-ray sum."""
    rng = np.random.default_rng(5)
    tau = rng.exponential(3.0 / PILE, PILE)
    # some are dense
    tau[rng.integers(0, PILE, 5)] = 0.3
    splats = dots(
        np.stack([np.zeros(PILE), np.zeros(PILE), rng.uniform(0, 200, PILE)], axis=1),
        tau / peak(),
        rng.uniform(0.0, 1.0, (PILE, 3)),
    )
    camera = parallel(1.0, (1, 1))
    right, paper = bench.truth(splats, camera), bench.paper(splats, camera)
    checks = []
    for order in ("back-to-front", "front-to-back"):
        drawn = bench.draw(splats, camera, order=order)
        checks.append(check(order.replace("-", " "), drawn, right, PILE_BOUND, paper))
    depth = tau.sum()
    found = bench.draw(splats, camera, blend="xray")[0, 0, 3]
    checks.append(check("X-ray sum", found, depth, PILE_BOUND * 4, bench.paper(splats, camera, blend="xray")[0, 0, 3]))
    return checks


def hidden(bench: Bench) -> list[Check]:
    """Checks that an opaque red splat hides a million splats behind it, in either order."""
    rng = np.random.default_rng(6)
    places = np.zeros((MILLION + 1, 3))
    places[1:, 2] = rng.uniform(4.0, 500.0, MILLION)
    colors = np.concatenate([[(1.0, 0.0, 0.0)], rng.uniform(0.0, 1.0, (MILLION, 3))])
    # τ = 60: e⁻⁶⁰ is negligible
    splats = dots(places, np.concatenate([[60.0], rng.uniform(0.0, 1e-3, MILLION)]) / peak(), colors)
    camera = parallel(1.0, (1, 1))
    paper = bench.paper(splats, camera)[0, 0]
    right = (1.0, 0.0, 0.0, 1.0)
    checks = []
    for order in ("back-to-front", "front-to-back"):
        drawn = bench.draw(splats, camera, order=order)[0, 0]
        checks.append(check(order.replace("-", " "), drawn, right, 1e-6, paper))
    return checks


PILE_CASES = (
    Case(
        "million-faint",
        "a million splats of opacity 1e−7 on one pixel: float32 'over' rounds each",
        "one pixel; the bound is half a unit in the last place a splat. 8 bits and half float see nothing",
        "30-digit arithmetic: 1 − (1 − 1e−7)^1e6",
        million_faint,
    ),
    Case(
        "pixel-pile",
        "100 000 splats of random depth and colour on one pixel",
        "one pixel, Σ τ = 4.5; the bound is a fortieth of an 8-bit level",
        "float64 reference with compensated sums",
        pile,
    ),
    Case(
        "hidden-million",
        "a million splats behind an opaque one",
        "one pixel; the opaque splat is red",
        "red",
        hidden,
    ),
)
