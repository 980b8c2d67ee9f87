#!/usr/bin/env python
"""Random structured images, each checked against its error bound and drawn twice: `error_bound.py [--count N]`.

Each seed is one image: planes of voxels at z_k, eyes on planes, on voxels and inside, extreme angles, faint and
opaque matter, every target, blend, kernel and technique, 0 and 1 splats, images one pixel wide, long and sheared
voxels. Prints a line for each image that exceeds its bound or is not reproducible, and then exits with 1.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

import splatgl as sg
from splatgl.errors import InputError

Random = np.random.Generator

# limits that keep the float64 reference within milliseconds
MOST_SPLATS, MOST_PIXELS = 1500, 900


@dataclass(frozen=True)
class Case:
    """A test image, and the names of its components."""

    splats: sg.Splats
    camera: sg.Camera
    settings: sg.Settings
    name: str


@dataclass(frozen=True)
class Found:
    """Result for an image: its error, its bound, and whether a second render is bitwise equal."""

    error: float
    bound: float
    same: bool


# --- splats ---------------------------------------------------------------------------------------------------------


def spacing_of(rng: Random) -> tuple[str, np.ndarray, np.ndarray]:
    """Name, spacing [3] and direction [3, 3] of a grid."""
    name = rng.choice(["cubes", "cubes", "turned", "1:1:3", "1:2:5", "16:1:1", "1:1:16", "sheared"])
    spacing, direction = np.ones(3), np.eye(3)
    if ":" in name:
        spacing = np.array([float(n) for n in name.split(":")])
    elif name == "turned":
        direction = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    elif name == "sheared":
        direction = np.array([[1, 0.4, 0.2], [0, 1, 0.3], [0, 0, 1.4]])
    return str(name), spacing * rng.choice([1.0, 0.01, 30.0]), direction


def shape_of(rng: Random) -> tuple[str, tuple[int, int, int]]:
    """Name and number of samples (x, y, z)."""
    name = str(rng.choice(["block", "block", "wall", "line", "one", "none"], p=[0.3, 0.3, 0.2, 0.1, 0.07, 0.03]))
    n = int(rng.integers(3, 12))
    shapes = {"block": (n, n, n), "wall": (3 * n, 3 * n, 1), "line": (40, 1, 1), "one": (1, 1, 1), "none": (1, 1, 1)}
    return name, tuple(int(i) for i in rng.permutation(shapes[name]))  # type: ignore[return-value]


def opacity_of(rng: Random) -> float:
    return float(rng.choice([1e-7, 1e-4, 0.003, 0.05, 0.4, 0.95, 1.0]))


def splats_of(rng: Random) -> tuple[str, sg.Splats]:
    """Samples of a grid, or scattered points."""
    grid, spacing, direction = spacing_of(rng)
    shape, size = shape_of(rng)
    opacity = opacity_of(rng)
    offset = float(rng.choice([0.0, 0.0, 1e5])) * spacing
    cells = rng.random(size[::-1]) if rng.random() < 0.7 else np.ones(size[::-1])
    if shape == "none":
        cells[:] = 0.0
    if rng.random() < 0.2 and grid not in ("turned", "sheared"):
        points = rng.random((cells.size, 3)) * np.array(size) * spacing
        depth = -np.log1p(-min(opacity, 0.999)) / spacing.mean() * (cells.ravel() > 0.3)
        colors = rng.random((cells.size, 3)) * rng.choice([1.0, 3.0])
        return f"points {grid} {shape} {opacity:g}", sg.Splats.from_points(points, colors, depth, spacing)
    volume = sg.Volume(cells, spacing=tuple(spacing), origin=tuple(offset), direction=direction)
    transfer = sg.Transfer([(0.3, 0.0), (1.0, opacity)], colormap="hot", shading=bool(rng.random() < 0.5))
    return f"{grid} {shape} {opacity:g}", sg.extract(volume, transfer, classification="pre")


# --- cameras --------------------------------------------------------------------------------------------------------


def size_of(rng: Random) -> tuple[int, int]:
    kind = rng.random()
    if kind < 0.12:
        return 1, int(rng.integers(1, 60))
    if kind < 0.24:
        return int(rng.integers(1, 60)), 1
    return int(rng.integers(2, 30)), int(rng.integers(2, 30))


def direction_of(rng: Random, splats: sg.Splats) -> np.ndarray:
    """Along a grid's axis or diagonal, or random; world units."""
    kind = rng.random()
    if kind < 0.5:
        steps = rng.permutation([1, 0, 0]) * rng.choice([-1, 1])
    elif kind < 0.7:
        steps = rng.permutation([1, 1, 0]) * rng.choice([-1, 1], 3)
    else:
        return np.asarray(rng.normal(size=3))
    return np.asarray(splats.grid.world_from_index @ steps)


def voxel_of(rng: Random, splats: sg.Splats) -> np.ndarray:
    """The centre of one splat, world units."""
    if not len(splats):
        return np.zeros(3)
    place = splats.positions[rng.integers(len(splats))].astype(np.float64)
    return np.asarray(splats.grid.world_from_index @ place + splats.grid.origin)


def perspective(rng: Random, splats: sg.Splats, eye: np.ndarray, view: np.ndarray, fov: float) -> sg.Camera:
    return sg.Camera.look_at(eye, eye + view, rng.normal(size=3), fov, size_of(rng))


def orbiting(rng: Random, splats: sg.Splats) -> sg.Camera:
    zoom = float(rng.choice([0.05, 0.3, 1.0, 1.0, 3.0]))
    angles = rng.uniform(-180, 180), rng.uniform(-80, 80)
    return sg.Camera.orbit(splats, *angles, fov=float(rng.uniform(5, 90)), size=size_of(rng), zoom=zoom)


def at_z_k(rng: Random, splats: sg.Splats) -> sg.Camera:
    """A plane of voxels exactly at the depth where a voxel is a pixel wide, or where widening begins."""
    view = direction_of(rng, splats)
    view = view / np.linalg.norm(view)
    camera = perspective(rng, splats, np.zeros(3), view, float(rng.uniform(5, 120)))
    widths = np.linalg.svd(camera.eye_from_world[:2] @ splats.grid.world_from_index, compute_uv=False)
    reach = np.linalg.norm(view @ splats.grid.world_from_index)
    depth = float(rng.choice([*(camera.z_k(float(w)) for w in widths), *(3 * r * reach for r in (1.556228, 2.0))]))
    side = view * depth + rng.normal(size=3) * 0.1 * depth
    side += view * (depth - side @ view)
    return sg.Camera(voxel_of(rng, splats) - side, camera.eye_from_world, camera.size, camera.extent)


def on_voxel(rng: Random, splats: sg.Splats) -> sg.Camera:
    return perspective(rng, splats, voxel_of(rng, splats), direction_of(rng, splats), float(rng.uniform(20, 130)))


def inside(rng: Random, splats: sg.Splats) -> sg.Camera:
    low, high = splats.corners.min(axis=0), splats.corners.max(axis=0)
    eye = rng.uniform(low, high)
    return perspective(rng, splats, eye, direction_of(rng, splats), float(rng.uniform(20, 130)))


def oblique(rng: Random, splats: sg.Splats) -> sg.Camera:
    """Extreme angles, from outside."""
    span = float(np.linalg.norm(np.ptp(splats.corners, axis=0)))
    view = direction_of(rng, splats)
    view = view / np.linalg.norm(view)
    eye = splats.corners.mean(axis=0) - view * span * rng.uniform(0.5, 2) + rng.normal(size=3) * 0.3 * span
    return perspective(rng, splats, eye, view, float(rng.uniform(110, 175)))


def parallel(rng: Random, splats: sg.Splats) -> sg.Camera:
    span = float(np.linalg.norm(np.ptp(splats.corners, axis=0)))
    view = direction_of(rng, splats)
    eye = splats.corners.mean(axis=0) - view / np.linalg.norm(view) * span
    height = span * float(rng.uniform(0.2, 2))
    return sg.Camera.orthographic(eye, eye + view, rng.normal(size=3), height, size_of(rng))


def on_plane(rng: Random, splats: sg.Splats) -> sg.Camera:
    """An orthographic view from a voxel's centre: matter behind it is not drawn."""
    span = float(np.linalg.norm(np.ptp(splats.corners, axis=0)))
    eye = voxel_of(rng, splats)
    height = span * float(rng.uniform(0.2, 2))
    return sg.Camera.orthographic(eye, eye + direction_of(rng, splats), rng.normal(size=3), height, size_of(rng))


CAMERAS: dict[str, Callable[[Random, sg.Splats], sg.Camera]] = {
    each.__name__: each for each in (orbiting, at_z_k, on_voxel, inside, oblique, parallel, on_plane)
}

# --- settings -------------------------------------------------------------------------------------------------------


def settings_of(rng: Random) -> sg.Settings:
    def one_of(*values: object) -> object:
        return values[rng.integers(len(values))]

    changes = {
        "blend": one_of("composite", "composite", "xray", "mip"),
        "kernel": one_of("crawfis-max", "crawfis-max", "gaussian"),
        "antialias": one_of("paper", "paper", "paper", "off", "supersample"),
        "samples": 2,
        "target": one_of("rgba32f", "rgba32f", "rgba32f", "rgba16f", "rgba8"),
        "attenuation": one_of("auto", "auto", "opacity", "optical-depth"),
        "align": one_of(*["auto"] * 8, "ray", "grid", "hybrid"),
        "technique": one_of("auto", "auto", "quads", "tiles", "tiles"),
        "background": one_of(None, None, (0.2, 0.4, 0.6)),
        "occlusion": one_of("auto", "off"),
        "order": one_of("auto", "auto", "back-to-front", "front-to-back"),
    }
    if rng.random() > 0.8:
        changes["antialias"] = "auto"
    if rng.random() < 0.3:
        changes["kernel"] = "b-spline"
    if rng.random() < 0.3:
        # what sheets can draw
        changes |= {"compositing": "sheets", "sheets": int(rng.integers(2, 5)), "target": "rgba32f", "order": "auto"}
        changes |= {"align": "auto", "blend": "composite"}
        changes["attenuation"] = one_of("fill", "optical-depth")
    if rng.random() < 0.3:
        changes["blur_width"] = float(rng.choice([0.25, 0.5, 2.0, 4.0]))
    return sg.Settings(**changes)  # type: ignore[arg-type]


def case(seed: int) -> Case:
    """The test image of a seed."""
    rng = np.random.default_rng(seed)
    made, splats = splats_of(rng)
    view = str(rng.choice(list(CAMERAS)))
    camera = CAMERAS[view](rng, splats)
    settings = settings_of(rng)
    names = ("blend", "kernel", "antialias", "blur_width", "target", "align", "technique", "compositing")
    changed = {f: getattr(settings, f) for f in names}
    return Case(splats, camera, settings, f"{made}, {view} {camera.size}, " + " ".join(map(str, changed.values())))


def drawable(renderer: sg.Renderer, chosen: Case) -> sg.Settings:
    """The settings without a technique that the image does not support."""
    for settings in (chosen.settings, chosen.settings.replace(technique="auto"), chosen.settings.replace(align="auto")):
        try:
            renderer.plan(chosen.splats, chosen.camera, settings)
        except InputError:
            continue
        return settings
    return chosen.settings.replace(technique="auto", align="auto")


def measure(renderer: sg.Renderer, chosen: Case, verify_bound: bool = False) -> Found:
    settings = drawable(renderer, chosen)
    first, second = (
        renderer.render(chosen.splats, chosen.camera, settings, verify_bound=verify_bound) for _ in range(2)
    )
    right = sg.reference.render(chosen.splats, chosen.camera, settings).pixels
    error = float(np.abs(first.pixels - right).max(initial=0.0)) if np.isfinite(first.pixels).all() else np.inf
    return Found(error, float(first.info["error_bound"]), bool((first.pixels == second.pixels).all()))


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(allow_abbrev=False, description=__doc__)
    parser.add_argument("--count", type=int, default=1000, help="how many pictures")
    parser.add_argument("--first", type=int, default=0, help="the first seed")
    parser.add_argument("--backend", default="auto")
    chosen = parser.parse_args(arguments)
    kinds: Counter[str] = Counter()
    shares = []
    with sg.Renderer(chosen.backend) as renderer:
        for seed in range(chosen.first, chosen.first + chosen.count):
            picture = case(seed)
            found = measure(renderer, picture)
            shares.append(found.error / max(found.bound, 1e-300))
            if not found.error <= found.bound:
                kinds["over their bound"] += 1
                print(f"seed {seed}: off by {found.error:.3g}, bound {found.bound:.3g}: {picture.name}", flush=True)
            if not found.same:
                kinds["with other bits the second time"] += 1
                print(f"seed {seed}: other bits the second time: {picture.name}", flush=True)
    middle = float(np.median([1 / share for share in shares if share > 0] or [np.inf]))
    print(f"{chosen.count} pictures from seed {chosen.first}: {dict(kinds) or 'none over its bound, same bits twice'}")
    print(f"bounds are {middle:.3g} times the error in the median")
    return 1 if kinds else 0


if __name__ == "__main__":
    sys.exit(main())
