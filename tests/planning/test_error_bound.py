"""The error bound of a picture holds, and is not idle."""

from __future__ import annotations

import itertools
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import splatgl as sg
from splatgl.planning.error_bound import BRIGHTER, MOVED, ULP, ErrorBound, _deviation_at, bound
from splatgl.planning.plan import FootprintTable
from splatgl.planning.ray_overlap import cells_of, ray_overlap
from splatgl.planning.resolve import Resolved
from splatgl.reference.rays import Pixels, pair_values
from splatgl.reference.renderer import SplatScene, _scene
from splatgl.splat.kernels import kernel
from tests.fuzz.error_bound import case, measure
from tests.helpers import streaks
from tests.helpers.noise import close_up
from tests.helpers.splatting import SPLATS
from tests.stress import CASES, run_case

SIZE = (64, 48)
# a picture of which nothing more is known
OPAQUE = np.ones((1, 1, 4))
# the reference is slow: stress pictures of more splats or pixels are left to its own answers
MOST_SPLATS, MOST_PIXELS, MOST_PICTURES = 1000, 400, 6
# the cases with pictures that small
SMALL = (
    *("axis-views", "opacity-extremes", "opacity-correction", "depth-range", "xray-range", "lattice-sums"),
    *("wider-than-picture", "picture-sizes", "spacing-1-1000", "thin-shell", "methods"),
)
ALL = slice(None)
PIECES = {
    "tunnel": (slice(0, 16), ALL, ALL),
    "terrain": (ALL, slice(180, 260), slice(180, 260)),
    "nerve": (ALL, slice(180, 260), slice(180, 260)),
    "letter_f": (ALL, ALL, ALL),
}
WAYS = {
    "auto": {},
    "loose": {"tolerance": 0.2},
    "quads": {"technique": "quads"},
    "front to back": {"technique": "quads", "order": "front-to-back"},
    "gaussian": {"kernel": "gaussian"},
    "xray": {"blend": "xray"},
    "mip": {"blend": "mip"},
    "parallel": {},
    "tiles": {"technique": "tiles"},
    "tiles, gaussian": {"technique": "tiles", "kernel": "gaussian"},
    "tiles, xray": {"technique": "tiles", "blend": "xray"},
    "tiles, mip": {"technique": "tiles", "blend": "mip"},
}
# what is coarser than the finest, and knows by how much
COARSER = {
    "ray": {"align": "ray"},
    "grid": {"align": "grid"},
    "hybrid": {"align": "hybrid"},
    "half floats": {"target": "rgba16f"},
    "half floats, xray": {"blend": "xray", "target": "rgba16f"},
    "8 bits": {"target": "rgba8"},
    "8-bit table": {"align": "ray", "footprint": "table", "table_bits": 8},
    "small table": {"table_size": 32},
    "paper": {"align": "hybrid", "table_bits": 8, "attenuation": "opacity", "target": "rgba8"},
    "grid, mip": {"align": "grid", "blend": "mip"},
}
SOME = ("auto", "mip", "xray", "grid", "half floats", "8-bit table")


def scene(name: str) -> tuple[sg.Splats, sg.Camera]:
    """A piece of it, since the reference is slow."""
    volume, piece = getattr(sg.scenes, name)(), PIECES[name]
    color = None if volume.color is None else volume.color[piece]
    volume = replace(volume, samples=volume.samples[piece], color=color)
    splats = sg.extract(volume, sg.default_transfer(volume), classification="pre")
    return splats, sg.Camera.orbit(splats, 20, 30, size=SIZE)


def cloud(spacing: tuple[float, float, float] = (1.0, 1.0, 1.0)) -> sg.Splats:
    """Points anywhere, some of them in one cell."""
    rng = np.random.default_rng(4)
    points = rng.uniform(-6, 6, (200, 3)) * spacing
    return sg.Splats.from_points(points, rng.random((200, 3)), rng.random(200), spacing)


def lattice(count: int, depth: float, axes: tuple[int, int, int] = (1, 1, 1)) -> sg.Splats:
    """Cells in all of these axes."""
    places = [np.arange(count if axis else 1.0) for axis in axes]
    points = np.stack(np.meshgrid(*places), -1).reshape(-1, 3)
    return sg.Splats.from_points(points, np.ones_like(points) * (1, 0.5, 0.2), np.full(len(points), depth))


SHAPES = {
    "cloud": cloud(),
    "long voxels": cloud((1.0, 2.0, 0.4)),
    "fog": lattice(14, 0.02),
    "block": lattice(10, 2.0),
    "wall": lattice(16, 4.0, (1, 0, 1)),
    "line": lattice(30, 3.0, (0, 1, 0)),
}


def views(splats: sg.Splats) -> dict[str, sg.Camera]:
    """Far, near, inside, along the faces; pixels larger and smaller than voxels."""
    fitted = close_up(splats, 20, 30, (24, 18))
    middle = splats.corners.mean(axis=0)
    away = fitted.eye - middle
    return {
        "fitted": fitted,
        "near": sg.Camera.look_at(middle + 0.55 * away, middle, (0, 0, 1), 50, (60, 44)),
        "far": sg.Camera.look_at(middle + 3 * away, middle, (0, 0, 1), 14, (20, 15)),
        "inside": sg.Camera.look_at(middle + 0.02 * away, middle, (0, 0, 1), 80, (32, 24)),
        "along": sg.Camera.orbit(splats, 0, 0, size=(24, 18)),
        "parallel": fitted.parallel(splats),
        "parallel, coarse": fitted.parallel(splats).resized((8, 6)),
    }


def measured(renderer: sg.Renderer, splats: sg.Splats, camera: sg.Camera, settings: sg.Settings) -> tuple[float, float]:
    """(error, bound) of one picture."""
    image = renderer.render(splats, camera, settings)
    right = sg.reference.render(splats, camera, settings).pixels
    return float(np.abs(image.pixels - right).max()), float(image.info["error_bound"])


@pytest.mark.parametrize("name", [pytest.param(name, marks=pytest.mark.long) for name in PIECES])
def test_scenes_keep_their_bound_and_it_is_near(renderer: sg.Renderer, name: str) -> None:
    """What is coarser says how much so within 20 times, and the finest does in some way."""
    splats, camera = scene(name)
    near = []
    for way, changes in {**WAYS, **COARSER}.items():
        if name != "letter_f" and way not in SOME:
            continue
        view = camera.parallel(splats) if way == "parallel" else camera
        error, limit = measured(renderer, splats, view, SPLATS.replace(**changes))
        print(f"{name} {way}: {error:.3g} of {limit:.3g}")
        assert 0 < error <= limit, way
        if way in COARSER:
            assert limit <= 20 * error
        else:
            near.append(limit <= 20 * max(error, 1e-5))
    assert any(near)


@pytest.mark.long
@pytest.mark.parametrize("name", SHAPES)
def test_views_keep_their_bound(renderer: sg.Renderer, name: str) -> None:
    """From everywhere, and also where a coarser picture is not held against a finer one."""
    splats, ways = SHAPES[name], itertools.cycle(("auto", "xray", "mip", "gaussian", "grid"))
    for view, camera in views(splats).items():
        # two of them each, in turn
        for way in (next(ways), next(ways)):
            settings = SPLATS.replace(**{**WAYS, **COARSER}[way])
            image = renderer.render(splats, camera, settings, verify_bound=False)
            error = np.abs(image.pixels - sg.reference.render(splats, camera, settings).pixels).max()
            assert error <= image.info["error_bound"], (view, way)


@pytest.mark.few(12)
@pytest.mark.parametrize("few", [10_000, 60, 0], ids=["one by one", "blocks", "planes"])
@pytest.mark.parametrize("name", SHAPES)
def test_no_ray_meets_more_than_is_said(name: str, few: int, monkeypatch: pytest.MonkeyPatch) -> None:
    for name_of in ("FEW", "FEW_POINTS"):
        monkeypatch.setattr(f"splatgl.planning.ray_overlap.{name_of}", few)
    splats = replace(SHAPES[name])
    assert (cells_of(splats).groups is None) == (few == 0)
    for view, camera in views(splats).items():
        chosen = sg.plan(splats, camera, SPLATS.replace(blend="xray"))
        count, depth = met(splats, camera)
        found = ray_overlap(splats, chosen.view)
        assert count <= found.count <= len(splats), view
        assert depth <= found.depth * 1.000001, view
        # of a solid block most rays meet much
        assert name not in ("fog", "block") or view == "inside" or found.depth < 4 * depth, view


def met(splats: sg.Splats, camera: sg.Camera) -> tuple[float, float]:
    """The most splats that a pixel's ray meets, and the most of their depth, as the reference has them."""
    scene = _scene(splats, Resolved.of(splats, camera, SPLATS.replace(blend="xray")), "row1")
    assert isinstance(scene, SplatScene)
    pixels = camera.size[0] * camera.size[1]
    count, depth = np.zeros(pixels), np.zeros(pixels)
    length, share = splats.records["optical_depth"], scene.row.coverage()
    for splat, pixel, _ in pair_values(
        scene.row, scene.boxes, scene.order, Pixels.of(camera.size, np.arange(pixels)), camera
    ):
        count += np.bincount(pixel, minlength=pixels)
        weight = length[splat] * share[splat]
        depth += np.bincount(pixel, weight * (1.0 if splats.grid.cubic else 0.0), minlength=pixels)
    return float(count.max()), float(depth.max())


@pytest.mark.long
def test_single_splats_keep_a_bound_that_is_near(renderer: sg.Renderer) -> None:
    """Anywhere in the picture, before and beyond z_k: what the bound takes a fragment to be off by."""
    rng = np.random.default_rng(3)
    shares: dict[bool, list[float]] = {False: [], True: []}
    for n in range(60):
        away, slant = rng.uniform(20, 80), rng.uniform(0, 45)
        towards = rng.normal(size=3)
        towards /= np.linalg.norm(towards)
        side = np.cross(towards, rng.normal(size=3))
        forward = towards + np.tan(np.radians(slant)) * side / np.linalg.norm(side)
        eye = -towards * away / np.cos(np.radians(slant))
        fov = 2 * slant + 16
        pixels = int(2 * np.tan(np.radians(fov / 2)) * away / rng.uniform(0.8, 1.2))
        camera = sg.Camera.look_at(eye, eye + forward, rng.normal(size=3), fov, (min(pixels, 200),) * 2)
        splats = sg.Splats.from_points([[0.0, 0.0, 0.0]], [[1.0, 1.0, 1.0]], [0.5])
        settings = SPLATS.replace(blend="xray" if n % 2 else "mip", kernel="crawfis-max" if n % 3 else "gaussian")
        error, limit = measured(renderer, splats, camera, settings)
        assert error <= limit
        shares[sg.plan(splats, camera, settings).program.seen.antialias].append(error / limit)
    assert all(len(share) > 10 and max(share) > 0.2 for share in shares.values())


@pytest.mark.parametrize("technique", ["quads", "tiles"])
def test_quads_that_reach_beside_the_eye(renderer: sg.Renderer, technique: str) -> None:
    """Corners near the plane through the eye lie far away on the screen: interpolated, places lost three digits."""
    splats = sg.Splats.from_points([[0.0, 0.0, 0.0]], [[1.0, 1.0, 1.0]], [2.0], spacing=(1, 1, 3))
    for turn in np.linspace(0.0, 0.3, 8):
        eye = np.array([-0.9 - turn, -3.8, -2.3])
        camera = sg.Camera.look_at(eye, eye + np.array([0.285, 0.516 + turn, 0.808]), (0, 0, 1), 173, (21, 5))
        settings = SPLATS.replace(technique=technique, antialias="off", kernel="b-spline")
        error, limit = measured(renderer, splats, camera, settings)
        assert error <= limit < 1e-3
        assert error < 2e-5


@pytest.mark.parametrize("shape", ["processor", "card"])
def test_quads_beside_the_eye(shape: str, request: pytest.FixtureRequest) -> None:
    """The eye on a voxel: the depth of its neighbours across the view is 0, at which no place can be divided."""
    splats = SHAPES["block"]
    eye = splats.corners.mean(axis=0).round()
    for forward in ((1.0, 0.0, 0.0), (0.6, 0.8, 0.0)):
        camera = sg.Camera.look_at(eye, eye + np.array(forward), (0, 0, 1), 100, (16, 12))
        settings = SPLATS.replace(technique="quads", blend="xray", antialias="off")
        error, limit = measured(request.getfixturevalue(shape), splats, camera, settings)
        assert error <= limit < 1e-2


def test_a_finer_picture_is_drawn_only_where_it_is_needed(
    renderer: sg.Renderer, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn = []
    draw = type(renderer.passes).draw

    def counted(self: object, *args: object) -> np.ndarray:
        drawn.append(args)
        return draw(self, *args)

    monkeypatch.setattr(type(renderer.passes), "draw", counted)
    splats = SHAPES["block"]
    camera = views(splats)["fitted"]
    for changes, held, count in (
        ({}, True, 1),
        ({"align": "grid"}, True, 2),
        ({"align": "grid"}, False, 1),
        ({"align": "grid", "tolerance": 1.0}, True, 1),
        ({"target": "rgba16f"}, True, 2),
    ):
        drawn.clear()
        renderer.render(splats, camera, SPLATS.replace(**changes), verify_bound=held)
        assert len(drawn) == count, changes


MOVES = {
    "spins": sg.Motion(spin=(0, 2, 20), center=(2.5, 2.5, 2.5)),
    "passes": sg.Motion(velocity=(3.0, 1.0, 0.5)),
    "flows": sg.Motion(flow=0.3 * np.random.default_rng(2).normal(size=(216, 3))),
}


@pytest.mark.few(1)
@pytest.mark.parametrize("move", MOVES)
def test_moving_pictures_keep_their_bound(renderer: sg.Renderer, move: str) -> None:
    """Against float64 streaks; None where those are drawn otherwise."""
    splats, motion = lattice(6, 0.5), MOVES[move]
    near = []
    for view in ("fitted", "near", "far", "parallel"):
        camera = views(splats)[view]
        for changes in (
            {"blend": "xray"},
            {"blend": "xray", "motion": "energy", "kernel": "gaussian"},
            {"motion": "paper", "attenuation": "opacity"},
            {},
        ):
            settings = SPLATS.replace(motion="exact").replace(**changes)
            image = renderer.render(splats, camera, settings, motion)
            assert image.info["motion"] == settings.motion
            right = streaks.render(splats, camera, settings, motion, settings.shutter, settings.motion).pixels
            error = float(np.abs(image.pixels - right).max())
            assert 0 < error <= image.info["error_bound"], (view, changes)
            near.append(image.info["error_bound"] / max(error, 1e-5))
    assert min(near) < 30
    inside = renderer.render(splats, views(splats)["inside"], SPLATS.replace(motion="exact"), motion)
    assert inside.info["error_bound"] is None


def test_streaks_of_long_voxels_have_a_bound_before_z_k_alone(renderer: sg.Renderer) -> None:
    splats, motion = SHAPES["long voxels"], MOVES["passes"]
    for view, known in (("near", True), ("far", False)):
        camera = views(splats)[view].resized((200, 150) if known else (20, 15))
        image = renderer.render(splats, camera, SPLATS.replace(motion="exact"), motion)
        assert (image.info["error_bound"] is not None) is known


def test_pictures_far_wider_than_their_splats(renderer: sg.Renderer) -> None:
    """Tiles round centres as pixels from the picture's corner: a random picture, and a splat as far from it."""
    assert (found := measure(renderer, case(51820))).error <= found.bound
    splat = sg.Splats.from_points([(0.1, 0.0, 0.3)], np.ones((1, 3)), [0.5])
    for width in (3001, 9001):
        camera = sg.Camera.look_at((0.3, -9, 0.2), (0, 0, 0), (0, 0, 1), fov=20, size=(width, 9))
        settings = sg.Settings(technique="tiles", antialias="off")
        drawn = renderer.render(splat, camera, settings, verify_bound=False)
        error = np.abs(drawn.pixels - sg.reference.render(splat, camera, settings).pixels).max()
        assert error <= drawn.info["error_bound"] < 60 * error


def test_faint_pictures_have_faint_bounds(renderer: sg.Renderer) -> None:
    """No part of it is that of an opaque picture, in any target, with any form, near the eye or far."""
    splats = lattice(8, 1e-7)
    for view, camera in views(splats).items():
        for changes in ({}, {"align": "grid"}, {"target": "rgba16f"}, {"target": "rgba8"}, {"compositing": "sheets"}):
            settings = SPLATS.replace(**changes)
            image = renderer.render(splats, camera.resized((9, 7)), settings, verify_bound=False)
            limit, sums = image.info["error_bound"], met(splats, camera.resized((9, 7)))[1]
            assert limit <= 3 * sums, (view, changes)


def test_no_ray_is_brighter_than_is_said() -> None:
    """Rings of footprints hold more light than any ray meets, and less than whole discs as bright as their middle."""
    for name in ("fog", "cloud", "long voxels"):
        splats = SHAPES[name]
        for view, camera in views(splats).items():
            settings = SPLATS.replace(blend="xray")
            chosen = sg.plan(splats, camera.resized((9, 7)), settings)
            brightest = sg.reference.render(splats, camera.resized((9, 7)), settings).pixels[..., 3].max()
            found, peak = ray_overlap(splats, chosen.view), float(chosen.kernel.footprint(np.zeros(())))
            assert brightest <= found.light * peak * BRIGHTER, (name, view)
            assert name != "fog" or view == "inside" or found.light < 0.7 * found.depth, (name, view)


def test_relative_errors_of_sheets_weigh_at_most_half() -> None:
    """Perturbed depths and colours of random sheets change a pixel by at most ρ min(A, C (1 − C) + A/4)."""
    rng, step, nearest = np.random.default_rng(1), 1e-6, 0.0
    for _ in range(2000):
        colors = rng.integers(0, 2, (int(rng.integers(1, 9)), 2)).astype(float)
        depths = rng.choice([0.01, 0.3, 1, 3], colors.shape) * rng.random(colors.shape)
        opacity, color = composite(depths, colors)
        changed = 0.0
        for part in np.ndindex(*depths.shape):
            more = depths.copy()
            more[part] *= 1 + step
            changed += abs(composite(more, colors)[1] - color) / step
        weight = min(opacity, color * (1 - color) + opacity / 4)
        assert changed <= weight + 1e-5
        nearest = max(nearest, changed / weight)
    assert nearest > 0.9


def composite(depths: np.ndarray, colors: np.ndarray) -> tuple[float, float]:
    """Opacity and colour of sheets [K, 2], nearest first, of two splats each."""
    opacities = -np.expm1(-depths.sum(axis=1))
    mixed = (depths * colors).sum(axis=1) / depths.sum(axis=1)
    before = np.cumprod(np.append(1.0, 1 - opacities[:-1]))
    return float(before @ opacities), float(before @ (opacities * mixed))


def test_splats_near_the_eye_do_not_weigh_on_far_ones(renderer: sg.Renderer) -> None:
    """A faint splat beside the eye, in approximate forms and with half lines, leaves the bound of others alone."""
    block = lattice(8, 0.05)
    camera = sg.Camera.look_at((4, 4, -30), (4, 4, 4), (0, 1, 0), 20, (30, 20))
    places = np.concatenate([block.positions + block.grid.origin, [[4.0, 4.0, -29.5]]])
    both = sg.Splats.from_points(places, np.ones_like(places), np.append(np.full(len(block), 0.05), 1e-7))
    for changes in ({"align": "grid"}, {"align": "exact"}):
        limits = [renderer.render(s, camera, SPLATS.replace(**changes)).info["error_bound"] for s in (block, both)]
        assert limits[1] < 1.3 * limits[0] + 1e-6, changes


def test_tables_of_kernels_with_a_rim_are_off_by_no_more_than_they_fall() -> None:
    """The second derivative across the rim of the Gaussian has no bound, the step has."""
    found = _deviation_at(FootprintTable("gaussian", "table", 256, 32), 1e-7, 1e-12)
    assert found.max() < 0.02


def test_only_opaque_pictures_hide_light(renderer: sg.Renderer) -> None:
    """What is behind a terminated tile is weighted by the transmittance that the picture shows."""
    camera = sg.Camera.orthographic((4.5, 4.5, -9), (4.5, 4.5, 0), (0, 1, 0), 4, (30, 20))
    for extinction, hides in ((0.1, False), (8.0, True)):
        splats = lattice(10, extinction)
        chosen = renderer.plan(splats, camera, SPLATS.replace(technique="tiles"))
        found = bound(splats, chosen, renderer.render(splats, camera, SPLATS).pixels)
        assert found is not None and (found.hidden > 0) is hides and found.hidden < chosen.hiding.cutoff


def test_a_picture_is_compared_with_the_same_one_in_finer_form(
    renderer: sg.Renderer, monkeypatch: pytest.MonkeyPatch
) -> None:
    """`auto` composites a coarse target splat by splat, and would a fine one in sheets."""
    splats, settings = lattice(6, 0.5), sg.Settings(target="rgba8", classification="pre")
    camera = views(splats)["fitted"]
    finest = []
    plan = type(renderer).plan
    monkeypatch.setattr(type(renderer), "plan", lambda *some: finest.append(plan(*some)) or finest[-1])
    image = renderer.render(splats, camera, settings)
    assert image.info["sheets"] == 0 and [chosen.resolved.sheets for chosen in finest] == [None]
    assert (
        image.info["error_bound"]
        <= 3 * np.abs(image.pixels - sg.reference.render(splats, camera, settings).pixels).max()
    )


def test_the_bound_follows_what_makes_the_error(renderer: sg.Renderer) -> None:
    """Not one number for all: each part grows with its cause."""
    volume = sg.scenes.letter_f()
    splats = sg.extract(volume, sg.default_transfer(volume), classification="pre")
    camera = sg.Camera.orbit(splats, size=SIZE)

    def parts(**changes: Any) -> ErrorBound:
        found = bound(splats, sg.plan(splats, camera, SPLATS.replace(**changes)), OPAQUE)
        assert found is not None
        return found

    exact, grid, half, coarse = parts(), parts(align="grid"), parts(target="rgba16f"), parts(table_size=32)
    assert grid.footprint > 20 * exact.footprint
    assert coarse.footprint > 1.2 * exact.footprint
    assert half.rounding > 1000 * exact.rounding and half.footprint == exact.footprint
    assert exact.hidden == 0.0
    assert exact.total == exact.footprint + exact.hidden + exact.rounding
    assert "hidden" in str(exact)


@pytest.mark.few(1)
@pytest.mark.parametrize("case", SMALL)
def test_stress_pictures_keep_their_bound(renderer: sg.Renderer, monkeypatch: pytest.MonkeyPatch, case: str) -> None:
    kept = []
    render = sg.Renderer.render

    def checked(
        self: sg.Renderer, splats: sg.Splats, camera: sg.Camera, settings: sg.Settings | None = None, **more: object
    ) -> sg.Image:
        image = render(self, splats, camera, settings, **more)
        if 0 < len(splats) <= MOST_SPLATS and camera.size[0] * camera.size[1] <= MOST_PIXELS:
            right = sg.reference.render(splats, camera, settings).pixels
            kept.append((float(np.abs(image.pixels - right).max()), float(image.info["error_bound"])))
            if len(kept) == MOST_PICTURES:
                raise StopIteration  # which ends the case
        return image

    monkeypatch.setattr(sg.Renderer, "render", checked)
    run_case(CASES[case], renderer)
    assert kept
    for error, limit in kept:
        assert error <= limit


def test_nothing_has_no_error() -> None:
    empty = sg.Splats.from_points(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0))
    camera = sg.Camera.look_at((0, -5, 0), (0, 0, 0), (0, 0, 1))
    assert bound(empty, sg.plan(empty, camera, SPLATS), np.zeros((1, 1, 4))).total == 0.0


@pytest.mark.long
def test_the_second_order_is_as_large_as_measured(renderer: sg.Renderer) -> None:
    """MOVED against what single splats just beyond z_k are displaced by on their slopes: no less, hardly more."""
    shares = []
    for n in range(80):
        rng = np.random.default_rng(n)
        slope, depth, beyond = np.tan(np.radians(rng.uniform(20, 45))), rng.uniform(14, 60), rng.uniform(1.0, 1.15)
        turn = rng.uniform(0, 2 * np.pi)
        eye = np.array([-slope * np.cos(turn), -slope * np.sin(turn), -1.0]) * depth
        pixels = int(2 * (np.abs(eye[:2]).max() / beyond + 4))
        fov = 2 * np.degrees(np.arctan(pixels * beyond / depth / 2))
        camera = sg.Camera.look_at(eye, eye + np.array([0, 0, 1.0]), (0, -1, 0), fov, (pixels, pixels))
        splats = sg.Splats.from_points([[0.0, 0.0, 0.0]], [[1.0, 1.0, 1.0]], [1.0])
        settings = SPLATS.replace(blend="mip", technique="quads")
        assert sg.plan(splats, camera, settings).program.seen.antialias
        drawn, right = (
            (render(splats, camera, settings).pixels[..., 3] / (1 - np.exp(-1.0))).clip(0, 1)
            for render in (renderer.render, sg.reference.render)
        )
        bound = MOVED[0] + MOVED[1] * slope**2 / (1 + slope**2)
        shares.append(_displaced(drawn, right) * (depth / beyond) ** 2 / bound / kernel("crawfis-max").radius ** 3)
    # nearer to the rim than `_displaced` looks, more is needed
    assert 0.2 < max(shares) <= 1


def _displaced(drawn: np.ndarray, right: np.ndarray) -> float:
    """How far, in voxels, shares of the peak are from their places at most, where a gain hardly moves them."""
    shape = kernel("crawfis-max")
    d = np.linspace(0, shape.radius, 20_001)
    share = shape.footprint(d) / shape.footprint(np.zeros(()))
    slope = (right > 1e-3) & (right < 0.2)
    places = [np.interp(-picture[slope], -share, d) for picture in (drawn, right)]
    return float(np.abs(places[0] - places[1]).max())


def test_over_loses_more_than_one_rounding_a_blend() -> None:
    """Opacities for which float32 rounds the same way again and again, chosen one after the other."""
    rng = np.random.default_rng(0)
    drawn, right, count = np.float32(0), 0.0, 16
    for _ in range(count):
        opacity = (rng.random(4000) * 0.5).astype(np.float32)
        kept = (np.float32(1) - opacity).astype(np.float32)
        after = (opacity + (drawn * kept).astype(np.float32)).astype(np.float32)
        exact = opacity.astype(float) + right * (1 - opacity.astype(float))
        lost = (after - exact) * (1.0 if drawn >= right else -1.0)
        worst = int(lost.argmax())
        drawn, right = after[worst], float(exact[worst])
    error = abs(float(drawn) - right)
    column = lattice(count, 0.5, (0, 0, 1))
    camera = sg.Camera.look_at((0, 0, -40), (0, 0, 0), (0, 1, 0), 20, (64, 64))
    said = bound(column, sg.plan(column, camera, SPLATS.replace(technique="quads")), OPAQUE)
    assert said is not None
    assert count * ULP / 4 < error <= said.rounding
