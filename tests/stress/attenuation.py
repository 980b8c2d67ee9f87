"""Stress cases of attenuation: edges, walls and stiff scenes."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import lru_cache, partial

import numpy as np

from splatgl.geometry.camera import Camera
from splatgl.splat.kernels import kernel
from splatgl.splat.settings import choices
from splatgl.splat.splats import Splats
from tests.stress.case import (
    UP,
    Bench,
    Check,
    Group,
    alpha,
    block,
    check,
    check_rows,
    dots,
    lattice,
    middle,
    optical_depth,
    parallel,
    rays_of,
)

EDGES = Group()
LAYERS, DENSE = 40, 0.99
# voxels a pixel
EDGE_ZOOMS = (1.0, 2.0, 4.0, 8.0, 16.0)
# every named form; auto is one of them
FORMS = tuple(form for form in choices()["attenuation"] if form != "auto")
# pixels on either side of the pixel centred on the edge
REACH = 3
# number of images, each shifted by that fraction of a pixel
SHIFTS = 4
# pixels beyond the edge, at all shifts
PLACES = np.arange((2 * REACH + 1) * SHIFTS) / SHIFTS - REACH
EDGE_BOUND = 1e-4
CROSSING_BOUND = 1e-3
Draw = Callable[[Splats, Camera], np.ndarray]


@dataclass(frozen=True)
class Edge:
    """opacity [N]: at PLACES; the edge is half a voxel outside of the last layer."""

    opacity: np.ndarray

    @property
    def outside(self) -> float:
        """α of the pixel whose centre is one pixel outside, where 0 is right."""
        return float(self.opacity[np.flatnonzero(PLACES == 1.0)[0]])

    @property
    def crossing(self) -> float:
        """Place where α falls below a half, in pixels beyond the edge; 0 is right."""
        inside = int(np.flatnonzero(self.opacity >= 0.5)[-1])
        drop = self.opacity[inside] - self.opacity[inside + 1]
        share = (self.opacity[inside] - 0.5) / drop
        return float(PLACES[inside] + share * (PLACES[inside + 1] - PLACES[inside]))


def draw_edge(m: float, draw: Draw) -> Edge:
    """The edge in images of `draw`, at m voxels a pixel; parallel rays."""
    splats, width, half = edge_scene(m)
    rows = []
    for shift in range(SHIFTS):
        camera = parallel(m, (2 * REACH + 1, 1), (width - 0.5 + shift / SHIFTS * m, float(half)))
        rows.append(alpha(draw(splats, camera))[0])
    return Edge(np.stack(rows, axis=1).ravel())


def sum_edge(m: float, form: str) -> Edge:
    """The edge by the definition of `opacity`, `optical-depth` or the paper's `a F`, in float64, without drawing."""
    _, width, half = edge_scene(m)
    shape = kernel("crawfis-max")
    tau = -np.log1p(-DENSE)
    x = width - 0.5 + PLACES * m
    columns, rows = np.arange(width), np.arange(2 * half + 1) - half
    footprint = shape.footprint(np.hypot((x[:, None, None] - columns[:, None]) / m, rows / m))
    depth = {
        "optical-depth": lambda: tau * footprint / m**2,
        "opacity": lambda: -np.log1p(np.expm1(-tau * footprint) / m**2),
        # the printed form: opacity times footprint times (z_k/z_v)²
        "paper": lambda: -np.log1p(-DENSE * footprint / m**2),
    }[form]()
    return Edge(-np.expm1(-LAYERS * depth.sum(axis=(1, 2))))


@lru_cache(maxsize=2)
def edge_scene(m: float) -> tuple[Splats, int, int]:
    """(block, voxels along x, half its voxels along y): 40 layers, as wide and high as splats reach."""
    reach = int(np.ceil(1.6 * m)) + 1
    width = int(m * (REACH + 1)) + reach
    return block((width, 2 * reach + 1, LAYERS), DENSE), width, reach


@EDGES.case(
    "thick-edge",
    "the edge of 40 layers of opacity 0.99, at 1 to 16 voxels a pixel",
    "parallel rays; α one pixel outside, and where α falls below a half (pixels beyond the edge), for every form "
    "of attenuation. A form passes where it is drawn as it is defined; --explain states the error of each. The "
    "paper's column: a F/m², in float64",
    "each form's own sum in float64",
)
def _thick_edge(bench: Bench) -> Iterator[Check]:
    paper = [sum_edge(m, "paper") for m in EDGE_ZOOMS]
    for form in FORMS:
        drawn = [draw_edge(m, partial(bench.draw, attenuation=form)) for m in EDGE_ZOOMS]
        if form in ("opacity", "optical-depth"):
            right = [sum_edge(m, form) for m in EDGE_ZOOMS]
        else:
            right = [draw_edge(m, partial(bench.truth, attenuation=form)) for m in EDGE_ZOOMS]
        edges = list(zip(drawn, right, paper, strict=True))
        alphas = [(a.outside, b.outside, c.outside) for a, b, c in edges]
        halves = [(a.crossing, b.crossing, c.crossing) for a, b, c in edges]
        yield check_rows(f"{form}, α outside", alphas, EDGE_BOUND)
        yield check_rows(f"{form}, 50 %", halves, CROSSING_BOUND)


STIFF = Group()
# fog and skin: extinction a voxel, and colour
FOG, SKIN = 0.02, 1e4
GRAY, RED = (0.6, 0.6, 0.6), (0.9, 0.2, 0.1)
FOG_LAYERS, WIDTH = 16, 21
# the kernel's ripple, 0.53 % on the lattice, of 1 − exp(−0.32)
SKIN_BOUND = 0.002
# an opaque skin beyond z_k: an 8-bit level, about the transmittance e^−5.5
SKIN_ZOOM_BOUND = 1.1 / 255
# Crawfis–Max ripple on its lattice when stretched by 1.1, 1.08 %, and 0.1 % for the depth of view
RIPPLE_BOUND = 0.012
SHELL = 0.5
SHELL_THICKNESS = 0.1
# positions of a shell's middle within its voxel
SHELL_PLACES = (0.0, 0.2, 0.45, 0.5)
STIFF_ZOOMS = (0.5, 1.0, 1.1, 2.0, 8.0)
# the floor's rise over its run
SHEET_TILT = 1.2
SHEET_DEPTH = float(-np.log1p(-0.5))


def skin_and_fog(step: float = 1.0) -> Splats:
    """A skin one unit thick and 16 units of fog behind it, in voxels of `step`: from z = −step/2 on."""
    z = np.arange(round((FOG_LAYERS + 1) / step)) * step
    lateral = np.arange(-(WIDTH // 2), WIDTH // 2 + 1) * step
    grid = lattice(lateral, lateral, z)
    skin = grid[:, 2] < 1.0 - step / 2
    return dots(grid, np.where(skin, SKIN, FOG), np.where(skin[:, None], RED, GRAY), step)


def from_behind(slant: float = 0.0) -> np.ndarray:
    """[4]: colour through the fog, (1 − e^−τ) gray + e^−τ red, on a ray slanted by that angle."""
    through = np.exp(-FOG * FOG_LAYERS / np.cos(slant))
    return np.append((1 - through) * np.array(GRAY) + through * np.array(RED), 1.0)


def skin_cameras(pitch: float = 0.5) -> tuple[Camera, Camera]:
    """Orthographic views from the skin's side and from the fog's, one pixel, off voxel centres."""
    aside = (0.42 * pitch, 0.26 * pitch)
    eye = np.array([*aside, FOG_LAYERS + 10.0])
    back = Camera.orthographic(eye, eye - np.array([0.0, 0.0, 1.0]), UP, pitch, (1, 1))
    return parallel(pitch, (1, 1), aside), back


@STIFF.case(
    "skin-over-fog",
    "an opaque skin (τ = 1e4) against fog (τ = 0.02 a voxel)",
    "seen from the skin's side, also at 2 and 4 voxels a pixel, through the fog, and slanted; attenuation auto",
    "closed form: the skin's colour; (1 − e^−τ) fog + e^−τ skin",
)
def _skin_over_fog(bench: Bench) -> Iterator[Check]:
    splats = skin_and_fog()
    front, back = skin_cameras()
    skin = np.array([*RED, 1.0])
    # at 20°, in perspective: the path through the fog is longer by the secant
    angle = np.radians(20.0)
    target = np.array([0.21, 0.13, 1.0])
    slanted = Camera.look_at(target - 60 * np.array([np.sin(angle), 0.0, -np.cos(angle)]), target, UP, 0.5, (1, 1))
    for name, camera, right, bound in (
        ("from the skin", front, skin, 1e-6),
        ("through the fog", back, from_behind(), SKIN_BOUND),
        # pixels wider than voxels: an opaque skin stays opaque
        *((f"{m:g} voxels a pixel", skin_cameras(m)[0], skin, SKIN_ZOOM_BOUND) for m in (2.0, 4.0)),
        ("slanted by 20°", slanted, from_behind(angle), SKIN_BOUND),
    ):
        drawn, paper = map(middle, bench.both(splats, camera))
        yield check(name, drawn, right, bound, paper)


def shell(place: float, width: tuple[int, int], thickness: float = SHELL_THICKNESS, averaged: bool = True) -> Splats:
    """A flat shell across z at `place`, of optical depth SHELL. averaged: whether the extinction of voxels is its
    average over the voxel, or its value at the centre.
    """
    low, high = place - thickness / 2, place + thickness / 2
    z = np.arange(-3, 4)
    share = np.clip(np.minimum(high, z + 0.5) - np.maximum(low, z - 0.5), 0.0, None)
    if not averaged:
        share = ((z >= low) & (z < high)).astype(np.float64)
    x, y = (np.arange(n) - n // 2 for n in width)
    return dots(lattice(x, y, z), np.tile(share, width[0] * width[1]) * SHELL / thickness)


def shell_view(m: float, slant: float) -> tuple[Camera, tuple[int, int]]:
    """Parallel rays slanted by that angle, m voxels a pixel; and the number of voxels along x and y they need."""
    angle = np.radians(slant)
    back = -np.array([np.sin(angle), 0.0, np.cos(angle)])
    target = np.array([0.31, 0.17, 0.0])
    reach = 2.2 * max(m, 1.0) + 3
    width = 2 * int(reach / np.cos(angle) + 4 * np.tan(angle)) + 1, 2 * int(reach) + 1
    return Camera.orthographic(target + back * 100, target, UP, m, (1, 1)), width


@STIFF.case(
    "thin-shell",
    "a shell a tenth of a voxel thick, at the middle and the rim of a voxel",
    "samples averaged over voxels, 0.5 to 8 voxels a pixel, straight on and at 50°; −ln(1−α)/(τ sec θ)",
    "1: the shell's optical depth, wherever it lies",
)
def _thin_shell(bench: Bench) -> Iterator[Check]:
    for slant in (0.0, 50.0):
        rows = []
        for m in STIFF_ZOOMS:
            camera, width = shell_view(m, slant)
            right = SHELL / np.cos(np.radians(slant))
            for place in SHELL_PLACES:
                images = bench.both(shell(place, width), camera)
                drawn, paper = (optical_depth(pixels[0, 0, 3]) / right for pixels in images)
                rows.append((drawn, 1.0, paper))
        yield check_rows(f"slanted by {slant:g}°" if slant else "straight", rows, RIPPLE_BOUND)


def tilted_sheet(rows: int) -> tuple[Splats, Camera, np.ndarray]:
    """(splats, camera, τ·sec θ [rows]): floor of opacity 0.5, seen from above by a column of pixels, ½ z_k to 2 z_k."""
    camera = Camera.look_at((0, 0, 0), (0, 0, 1), UP, 60.0, (1, rows))
    z_k = camera.z_k(1.0)
    # y = below + z · tilt: the image's middle row meets it at z_k
    tilt = -SHEET_TILT
    below = -tilt * z_k
    direction = np.array([0.0, tilt, 1.0]) / np.hypot(tilt, 1.0)
    # a square lattice on the plane, from 0.35 to 2.8 z_k in depth
    steps = np.arange(0.35 * z_k * np.hypot(tilt, 1.0), 2.8 * z_k * np.hypot(tilt, 1.0))
    grid = lattice(np.arange(-8, 9) + 0.27, steps)
    points = np.stack([grid[:, 0], below + grid[:, 1] * direction[1], grid[:, 1] * direction[2]], axis=1)
    normal = np.array([0.0, -direction[2], direction[1]])
    rays = np.stack([np.zeros(rows), camera.slopes()[1], np.ones(rows)], axis=1)
    secant = np.linalg.norm(rays, axis=1) / np.abs(rays @ normal)
    return dots(points, SHEET_DEPTH), camera, SHEET_DEPTH * secant


def sheet_rows(camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    """(indices of the rows that see the floor from 0.55 to 2 z_k, z/z_k of these)."""
    # slope · z = tilt · (z − z_k)
    depth = SHEET_TILT / (camera.slopes()[1] + SHEET_TILT)
    chosen = np.flatnonzero((depth > 0.55) & (depth < 2.0))
    return chosen, depth[chosen]


@STIFF.case(
    "sheet-across-z_k",
    "a thin floor that z_k runs through: the model changes there from one voxel to the next",
    "opacity 0.5, from 0.55 to 2 z_k, 65 and 257 rows; −ln(1−α)/(τ sec θ), and its step from row to row",
    "1; 0",
)
def _sheet_across_z_k(bench: Bench) -> Iterator[Check]:
    for rows in (65, 257):
        splats, camera, right = tilted_sheet(rows)
        chosen, _ = sheet_rows(camera)
        images = (
            bench.draw(splats, camera, attenuation="optical-depth"),
            bench.draw(splats, camera, attenuation="opacity"),
            bench.paper(splats, camera),
        )
        drawn, weak, paper = (optical_depth(alpha(pixels)[chosen, 0]) / right[chosen] for pixels in images)
        yield check(f"{rows} rows", drawn, 1.0, RIPPLE_BOUND, paper)
        yield check(f"{rows} rows, its steps", np.diff(drawn), 0.0, RIPPLE_BOUND, np.diff(weak))


WALLS = Group()
OPACITIES = (0.1, 0.5, 0.99)
# voxels a pixel at the wall
WALL_ZOOMS = (1.0, 1.1, 2.0, 4.0, 16.0, 64.0)
# of the opacity that the default attenuation draws: no form keeps the optical depth of matter so opaque that more of it
# would only darken what lies beside it
SEEN_BOUND = 1 / 255
# angle between the view and the wall's normal, degrees
SLANT = 50.0
# pixels across an image: z_k = 56 voxels at 60°
PIXELS = 65
# pixels evaluated on either side of the middle one
AROUND = 1


@dataclass(frozen=True)
class Wall:
    """A sheet one voxel thick, and a view whose middle pixels show only the sheet."""

    zoom: float
    perspective: bool
    slant: float

    @property
    def size(self) -> tuple[int, int, int]:
        """Voxels along x, y, z: all splats of R·m that reach the middle pixels, with a margin."""
        reach = self.zoom * (AROUND + 0.5 + 1.7)
        sec = 1 / np.cos(np.radians(self.slant))
        # the far side of an oblique wall is farther away, with wider pixels
        grow = 1.15 if self.slant else 1.05
        return 2 * int(reach * sec * grow**2 + 4) + 1, 2 * int(reach * grow + 4) + 1, 1

    @property
    def target(self) -> np.ndarray:
        """The point [3] that the view's axis meets, world units, off voxel centres."""
        return np.array([self.size[0] // 2 + 0.31, self.size[1] // 2 + 0.17, 0.0])

    def camera(self) -> Camera:
        """The view, `slant` from the wall's normal, `zoom` voxels a pixel at the wall."""
        angle = np.radians(self.slant)
        back = -np.array([np.sin(angle), 0.0, np.cos(angle)])
        if not self.perspective:
            eye = self.target + back * (2 * self.size[0])
            return Camera.orthographic(eye, self.target, UP, self.zoom * PIXELS, (PIXELS, PIXELS))
        z_k = PIXELS / (2 * np.tan(np.radians(30.0)))
        return Camera.look_at(self.target + back * z_k * self.zoom, self.target, UP, 60.0, (PIXELS, PIXELS))

    def secants(self) -> np.ndarray:
        """[3, 3]: 1/cos of each middle pixel's ray to the wall's normal."""
        camera = self.camera()
        rays = _middle_pixels(rays_of(camera))
        if not self.perspective:
            return np.full(rays.shape[:2], 1 / np.cos(np.radians(self.slant)))
        to_wall = rays @ camera.eye_from_world[:, 2]
        return np.asarray(np.linalg.norm(rays, axis=-1) / np.abs(to_wall))


def _wall(opacity: float, bench: Bench) -> Iterator[Check]:
    """Checks a closed wall's optical depth at each zoom, straight and oblique; of `auto`, its opacity."""
    for perspective in (True, False):
        for slant in (0.0, SLANT):
            depths, opacities = [], []
            for m in WALL_ZOOMS:
                view = Wall(m, perspective, slant)
                splats, camera = block(view.size, opacity), view.camera()
                right = -np.log1p(-opacity) * view.secants()
                drawn, weak, auto = (
                    _middle_pixels(alpha(bench.draw(splats, camera, **changes)))
                    for changes in ({"attenuation": "optical-depth"}, {"attenuation": "opacity"}, {})
                )
                depths.append((optical_depth(drawn) / right, 1.0, optical_depth(weak) / right))
                opacities.append((auto, -np.expm1(-right), weak))
            name = ("perspective" if perspective else "parallel") + (f", {SLANT:g}°" if slant else ", straight")
            ratios, _, weak_ratios = zip(*depths, strict=True)
            yield check(name, ratios, 1.0, RIPPLE_BOUND, weak_ratios)
            yield check_rows(f"auto, α, {name}", opacities, SEEN_BOUND)


def printed_form(view: Wall, opacity: float) -> float:
    """α of the middle pixel of a straight wall in parallel rays by the printed form, a F/m²  [M98 Eq. 6]."""
    shape, m = kernel("crawfis-max"), max(view.zoom, 1.0)
    x, y = (np.arange(n) - at for n, at in zip(view.size[:2], view.target[:2], strict=True))
    footprint = shape.footprint(np.hypot(x[:, None], y) / m)
    return float(-np.expm1(np.log1p(-opacity * footprint / m**2).sum()))


def _middle_pixels(pixels: np.ndarray) -> np.ndarray:
    """The middle 3×3 of an image."""
    part = slice(PIXELS // 2 - AROUND, PIXELS // 2 + AROUND + 1)
    return pixels[part, part]


for _opacity in OPACITIES:
    WALLS.case(
        f"wall-{_opacity:g}",
        f"a closed wall one voxel thick of opacity {_opacity:g}, at 1 to 64 voxels a pixel",
        f"perspective and parallel, straight on and at {SLANT:g}°, −ln(1−α)/(τ sec θ) in nine pixels, optical-depth; "
        "the paper's column: opacity attenuation, in float32; α: drawn by the default attenuation",
        "1: every ray has the wall's whole optical depth; α = 1 − exp(−τ sec θ)",
    )(partial(_wall, _opacity))
