"""Stiff scenes: a ray meets matter of very different scales. Scenes, views and exact results."""

from __future__ import annotations

import numpy as np

from splatgl.splat.camera import Camera
from splatgl.splat.splats import Splats
from splatgl.truth.stress.bench import Bench
from splatgl.truth.stress.case import Case, Check, check
from splatgl.truth.stress.scenes import UP, alpha, dots, middle, optical_depth, parallel

# fog and skin: extinction a voxel, and colour
FOG, SKIN = 0.02, 1e4
GRAY, RED = (0.6, 0.6, 0.6), (0.9, 0.2, 0.1)
FOG_LAYERS, WIDTH = 16, 21
# the kernel's ripple, 0.53 % on the lattice, of 1 − exp(−0.32)
SKIN_BOUND = 0.002
# an opaque skin beyond z_k: an 8-bit level, about the transmittance e^−5.5
SKIN_ZOOM_BOUND = 1.1 / 255
# Crawfis–Max ripple on its lattice when stretched, and 0.1 % for the depth of view
SHELL_BOUND = 0.012
SHELL = 0.5
SHELL_THICKNESS = 0.1
# positions of a shell's middle within its voxel
SHELL_PLACES = (0.0, 0.2, 0.45, 0.5)
ZOOMS = (0.5, 1.0, 1.1, 2.0, 8.0)
# the floor's rise over its run
SHEET_TILT = 1.2
SHEET_DEPTH = float(-np.log1p(-0.5))


def skin_and_fog(step: float = 1.0) -> Splats:
    """A skin one unit thick and 16 units of fog behind it, in voxels of `step`: from z = −step/2 on."""
    z = np.arange(round((FOG_LAYERS + 1) / step)) * step
    lateral = np.arange(-(WIDTH // 2), WIDTH // 2 + 1) * step
    grid = np.stack(np.meshgrid(lateral, lateral, z, indexing="ij"), axis=-1).reshape(-1, 3)
    skin = grid[:, 2] < 1.0 - step / 2
    return dots(grid, np.where(skin, SKIN, FOG), np.where(skin[:, None], RED, GRAY), step)


def from_behind() -> np.ndarray:
    """[4]: colour through the fog: (1 − e^−τ) gray + e^−τ red."""
    through = np.exp(-FOG * FOG_LAYERS)
    return np.append((1 - through) * np.array(GRAY) + through * np.array(RED), 1.0)


def skin_cameras(pitch: float = 0.5) -> tuple[Camera, Camera]:
    """Orthographic views from the skin's side and from the fog's, one pixel, off voxel centres."""
    aside = (0.42 * pitch, 0.26 * pitch)
    front = parallel(pitch, (1, 1), aside)
    eye = np.array([*aside, FOG_LAYERS + 10.0])
    return front, Camera.orthographic(eye, eye - np.array([0.0, 0.0, 1.0]), UP, pitch, (1, 1))


def skin_over_fog(bench: Bench) -> list[Check]:
    """Checks the skin from its own side, through the fog, with wide pixels, and at an oblique angle."""
    splats = skin_and_fog()
    front, back = skin_cameras()
    skin = np.array([*RED, 1.0])
    checks = []
    for name, camera, right in (("from the skin", front, skin), ("through the fog", back, from_behind())):
        found, paper = middle(bench.draw(splats, camera)), middle(bench.paper(splats, camera))
        checks.append(check(name, found, right, 1e-6 if camera is front else SKIN_BOUND, paper))
    # pixels wider than voxels: an opaque skin stays opaque
    for m in (2.0, 4.0):
        front, _ = skin_cameras(m)
        found, paper = middle(bench.draw(splats, front)), middle(bench.paper(splats, front))
        checks.append(check(f"{m:g} voxels a pixel", found, skin, SKIN_ZOOM_BOUND, paper))
    # at 20°, in perspective: the path through the fog is longer by the secant
    angle = np.radians(20.0)
    ray = np.array([np.sin(angle), 0.0, -np.cos(angle)])
    target = np.array([0.21, 0.13, 1.0])
    slanted = Camera.look_at(target - 60 * ray, target, UP, 0.5, (1, 1))
    through = np.exp(-FOG * FOG_LAYERS / np.cos(angle))
    right = np.append((1 - through) * np.array(GRAY) + through * np.array(RED), 1.0)
    found, paper = bench.draw(splats, slanted)[0, 0], bench.paper(splats, slanted)[0, 0]
    return [*checks, check("slanted by 20°", found, right, SKIN_BOUND, paper)]


def shell(place: float, width: tuple[int, int], thickness: float = SHELL_THICKNESS, averaged: bool = True) -> Splats:
    """A flat shell across z at `place`, of optical depth SHELL; the voxels' extinction is its average over each,
    or the value at their centres.
    """
    low, high = place - thickness / 2, place + thickness / 2
    z = np.arange(-3, 4)
    share = np.clip(np.minimum(high, z + 0.5) - np.maximum(low, z - 0.5), 0.0, None)
    if not averaged:
        share = ((z >= low) & (z < high)).astype(np.float64)
    x, y = (np.arange(n) - n // 2 for n in width)
    grid = np.stack(np.meshgrid(x, y, z, indexing="ij"), axis=-1).reshape(-1, 3)
    return dots(grid, np.tile(share, width[0] * width[1]) * SHELL / thickness)


def shell_view(m: float, slant: float) -> tuple[Camera, tuple[int, int]]:
    """Parallel rays slanted by that angle, m voxels a pixel; and how many voxels along x and y they need."""
    angle = np.radians(slant)
    back = -np.array([np.sin(angle), 0.0, np.cos(angle)])
    target = np.array([0.31, 0.17, 0.0])
    reach = 2.2 * max(m, 1.0) + 3
    width = 2 * int(reach / np.cos(angle) + 4 * np.tan(angle)) + 1, 2 * int(reach) + 1
    return Camera.orthographic(target + back * 100, target, UP, m, (1, 1)), width


def thin_shell(bench: Bench) -> list[Check]:
    """Checks that a shell keeps its optical depth at any position in its voxel, straight and oblique."""
    checks = []
    for slant in (0.0, 50.0):
        ratios, paper = [], []
        for m in ZOOMS:
            camera, width = shell_view(m, slant)
            right = SHELL / np.cos(np.radians(slant))
            for place in SHELL_PLACES:
                splats = shell(place, width)
                ratios.append(optical_depth(bench.draw(splats, camera)[0, 0, 3]) / right)
                paper.append(optical_depth(bench.paper(splats, camera)[0, 0, 3]) / right)
        checks.append(check("straight" if not slant else f"slanted by {slant:g}°", ratios, 1.0, SHELL_BOUND, paper))
    return checks


def tilted_sheet(rows: int) -> tuple[Splats, Camera, np.ndarray]:
    """(splats, camera, τ·sec θ [rows]): a floor of opacity 0.5 seen from above by one column of pixels, from half to
    twice z_k.
    """
    camera = Camera.look_at((0, 0, 0), (0, 0, 1), UP, 60.0, (1, rows))
    z_k = camera.z_k(1.0)
    slopes = camera.slopes()[1]
    # y = below + z · tilt: the picture's middle row meets it at z_k
    tilt = -SHEET_TILT
    below = -tilt * z_k
    direction = np.array([0.0, tilt, 1.0]) / np.hypot(tilt, 1.0)
    # a square lattice on the plane, from 0.35 to 2.8 z_k in depth
    steps = np.arange(0.35 * z_k * np.hypot(tilt, 1.0), 2.8 * z_k * np.hypot(tilt, 1.0))
    across = np.arange(-8, 9) + 0.27
    grid = np.stack(np.meshgrid(across, steps, indexing="ij"), axis=-1).reshape(-1, 2)
    points = np.stack([grid[:, 0], below + grid[:, 1] * direction[1], grid[:, 1] * direction[2]], axis=1)
    normal = np.array([0.0, -direction[2], direction[1]])
    rays = np.stack([np.zeros(rows), slopes, np.ones(rows)], axis=1)
    secant = np.linalg.norm(rays, axis=1) / np.abs(rays @ normal)
    return dots(points, SHEET_DEPTH), camera, SHEET_DEPTH * secant


def sheet_rows(camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    """(which rows see the floor from 0.55 to 2 z_k, z/z_k of each of them)."""
    slopes = camera.slopes()[1]
    # slope · z = tilt · (z − z_k)
    depth = SHEET_TILT / (slopes + SHEET_TILT)
    chosen = np.flatnonzero((depth > 0.55) & (depth < 2.0))
    return chosen, depth[chosen]


def sheet_across_z_k(bench: Bench) -> list[Check]:
    """Checks a floor's optical depth row by row across z_k, and its steps from row to row."""
    checks = []
    for rows in (65, 257):
        splats, camera, right = tilted_sheet(rows)
        chosen, _ = sheet_rows(camera)
        found, old, paper = (
            optical_depth(alpha(picture)[chosen, 0]) / right[chosen]
            for picture in (
                bench.draw(splats, camera, attenuation="optical-depth"),
                bench.draw(splats, camera, attenuation="opacity"),
                bench.paper(splats, camera),
            )
        )
        checks.append(check(f"{rows} rows", found, 1.0, SHELL_BOUND, paper))
        checks.append(check(f"{rows} rows, its steps", np.diff(found), 0.0, SHELL_BOUND, np.diff(old)))
    return checks


CASES = (
    Case(
        "skin-over-fog",
        "an opaque skin (τ = 1e4) against fog (τ = 0.02 a voxel)",
        "seen from the skin's side, also at 2 and 4 voxels a pixel, through the fog, and slanted; attenuation auto",
        "closed form: the skin's colour; (1 − e^−τ) fog + e^−τ skin",
        skin_over_fog,
    ),
    Case(
        "thin-shell",
        "a shell a tenth of a voxel thick, at the middle and the rim of a voxel",
        "samples averaged over voxels, 0.5 to 8 voxels a pixel, straight on and at 50°; −ln(1−α)/(τ sec θ)",
        "1: the shell's optical depth, wherever it lies",
        thin_shell,
    ),
    Case(
        "sheet-across-z_k",
        "a thin floor that z_k runs through: the model changes there from one voxel to the next",
        "opacity 0.5, from 0.55 to 2 z_k, 65 and 257 rows; −ln(1−α)/(τ sec θ), and its step from row to row",
        "1; 0",
        sheet_across_z_k,
    ),
)
