"""Aliasing in numbers: finer pictures with the pixels' own antialiasing, spectra, what lies beyond z_k; flicker."""

from __future__ import annotations

import numpy as np
import pytest
from paper.aliasing import (
    Reach,
    aliasing_energy,
    differing_before,
    finer,
    flicker,
    mean_square,
    noise_ratio,
    popping,
    share_beyond,
    strip,
)

import splatgl as sg
from splatgl.animation.camera_track import turning
from splatgl.scene.view import ViewOptions
from tests.helpers.splatting import SPLATS

XRAY = SPLATS.replace(blend="xray")
OFF = XRAY.replace(antialias="off")
draw = sg.reference.render


@pytest.fixture
def sheet(rng: np.random.Generator) -> sg.Splats:
    """Noise on a sheet that recedes, 10 below the eye, from before z_k to well beyond it."""
    x, z = (c.ravel() for c in np.meshgrid(np.arange(-40.0, 41), np.arange(6.0, 130)))
    points = np.stack([x, 4 + 0 * x, z], axis=1)
    return sg.Splats.from_points(points, np.repeat(rng.random((len(x), 1)), 3, axis=1), np.full(len(x), 3.0))


@pytest.fixture
def camera() -> sg.Camera:
    """z_k = 28; the sheet's far end is in the middle."""
    return sg.Camera.look_at((0, -6, 0), (0, 4, 70), (0, -1, 0), 2 * np.degrees(np.arctan(16 / 28)), (32, 32))


@pytest.mark.parametrize("parallel", [False, True])
def test_without_antialiasing_finer_is_the_larger_picture(parallel: bool, rng: np.random.Generator) -> None:
    points = sg.Splats.from_points(rng.uniform((-4, -4, 40), (4, 4, 50), (60, 3)), rng.random((60, 3)), np.ones(60))
    camera = sg.Camera.look_at((0.2, 0.1, 0), (0.3, 0, 9), (0, -1, 0), 10, (9, 8))
    camera = camera.parallel(points) if parallel else camera
    large = draw(points, camera.resized((36, 32)), OFF).pixels
    assert np.abs(finer(draw, points, camera, OFF) - large).max() < 3e-3 * large.max()
    # and what is drawn is not what lies at the pixels' centres
    assert np.abs(np.repeat(np.repeat(draw(points, camera, OFF).pixels, 4, 0), 4, 1) - large).max() > 0.1


def test_finer_has_the_pixels_own_antialiasing() -> None:
    """One voxel four times as far as z_k: the finer picture shows a disc of radius 4 R/… as wide as R pixels."""
    point = sg.Splats.from_points(np.array([[0, 0, 40.0]]), np.ones((1, 3)), np.ones(1))
    camera = sg.Camera.look_at((0, 0, 0), (0, 0, 1), (0, -1, 0), 2 * np.degrees(np.arctan(0.6)), (12, 12))
    assert camera.z_k(1.0) == pytest.approx(10)
    fine = finer(draw, point, camera, XRAY)[..., 3]
    across = np.flatnonzero(fine.any(axis=0))
    assert len(across) / 4 == pytest.approx(2 * 1.556, abs=0.3)
    # energy: the mean of the finer samples is the footprint's integral, 1 voxel² in pixels of 4
    assert fine.sum() / 16 == pytest.approx(1 / 16, rel=0.01)


@pytest.mark.parametrize(("cycles", "share"), [(0.3, 0.0), (0.45, 0.0), (0.6, 0.5), (1.3, 0.5)])
def test_energy_is_what_is_faster_than_half_a_cycle(cycles: float, share: float) -> None:
    x = np.arange(40 * 4) / 4
    wave = np.sin(2 * np.pi * cycles * x)[None, :, None] * np.ones((120, 1, 4)) * 0.7 + 5
    reach = Reach(np.where(np.hypot(*np.mgrid[-15:15, -20:20]) < 13, 9.0, 1.0), 3.0)
    window = reach.window()
    assert window.shape == (120, 160) and window.max() > 0.9
    assert aliasing_energy(wave, window) == pytest.approx(share * 0.49, abs=0.003)
    assert aliasing_energy(wave.swapaxes(0, 1), window.T) == pytest.approx(share * 0.49, abs=0.003)


@pytest.mark.long
def test_antialiasing_takes_aliasing_away(renderer: sg.Renderer, rng: np.random.Generator) -> None:
    """Noise on a slanted wall, 2.5 times as far as z_k."""
    x, y = (c.ravel() for c in np.meshgrid(np.arange(-50.0, 51), np.arange(-50.0, 51)))
    points = np.stack([x, y, np.rint(100 + y / 3)], axis=1)
    wall = sg.Splats.from_points(points, np.repeat(rng.random((len(x), 1)), 3, axis=1), np.full(len(x), 3.0))
    camera = sg.Camera.look_at((0, 0, 0), (0, 0, 1), (0, -1, 0), 2 * np.degrees(np.arctan(24 / 40)), (48, 48))
    draw = renderer.render
    reach = Reach.of(draw, wall, camera)
    window = reach.window()
    off, on = (aliasing_energy(finer(draw, wall, camera, s), window) for s in (OFF, XRAY))
    assert off > 8 * on > 0 and window.mean() > 0.1
    right = draw(wall, camera, XRAY.replace(antialias="supersample"))
    errors = [mean_square(draw(wall, camera, s), right, reach.beyond) for s in (OFF, XRAY)]
    assert errors[0] > 2 * errors[1] > 0


@pytest.mark.few(1)
@pytest.mark.parametrize("name", ["crawfis-max", "gaussian"])
def test_of_noise_a_kernel_leaves_what_its_spectrum_says(name: str, renderer: sg.Renderer) -> None:
    """Half as far again as z_k: a wall of noise, measured, against the spectrum; at z_k there is nothing to gain."""
    rng = np.random.default_rng(3)
    x, y = (c.ravel() for c in np.meshgrid(np.arange(-60.0, 61), np.arange(-60.0, 61)))
    camera = sg.Camera.look_at((0, 0, 0), (0, 0, 1), (0, -1, 0), 2 * np.degrees(np.arctan(32 / 40)), (64, 64))
    ratios = []
    for depth in (40.1, 60.0):
        places = np.stack([x, y, np.full_like(x, depth)], axis=1) + rng.uniform(-0.5, 0.5, (len(x), 1)) * (1, 1, 0)
        wall = sg.Splats.from_points(places, np.repeat(rng.random((len(x), 1)), 3, axis=1), np.full(len(x), 3.0))
        ratios.append(noise_ratio(wall, camera, name))
    window = np.ones((256, 256))
    off, on = (
        aliasing_energy(finer(renderer.render, wall, camera, s.replace(kernel=name)), window) for s in (OFF, XRAY)
    )
    assert ratios[0] == pytest.approx(1, abs=0.05) and ratios[1] == pytest.approx(11, abs=1)
    assert off / on == pytest.approx(ratios[1], rel=0.15)


def test_reach_knows_what_is_beyond_z_k(sheet: sg.Splats, camera: sg.Camera) -> None:
    reach = Reach.of(draw, sheet, camera)
    assert reach.z_k == pytest.approx(28)
    # where the middle column's rays meet the sheet, at its upper side
    slopes = np.stack([0 * camera.slopes()[1], camera.slopes()[1], np.ones(32)], axis=1)
    rays = slopes @ camera.eye_from_world
    depth = np.where(rays[:, 1] > 0, 9.5 / np.maximum(rays[:, 1], 1e-9), np.inf)
    shown = reach.depth[:, 16] < np.inf
    assert shown.sum() > 12
    right = depth[shown] < 80
    assert reach.depth[shown, 16][right] == pytest.approx(depth[shown][right], rel=0.1)
    assert not (reach.before & reach.beyond).any()
    line = np.flatnonzero(reach.line()[:, 16])
    assert len(line) == 1 and abs(np.abs(depth - 28).argmin() - line[0]) <= 1
    assert reach.line(3).shape == (96, 96) and reach.line(3).any()
    world = sheet.positions.astype(float) + sheet.grid.origin
    beyond = camera.eye_from_points(world)[:, 2] >= 28
    assert share_beyond(sheet, camera) == beyond.mean() and 0.5 < beyond.mean() < 0.9


@pytest.mark.long
def test_nothing_before_z_k_changes(renderer: sg.Renderer, sheet: sg.Splats, camera: sg.Camera) -> None:
    """Bit for bit, on the GPU, in each blend mode; pixels that see some of both are left out."""
    for settings in (XRAY, SPLATS, SPLATS.replace(attenuation="opacity")):
        changed, count = differing_before(renderer.render, sheet, camera, settings.replace(technique="quads"))
        assert changed == 0 and count > 150


def test_only_is_a_part(sheet: sg.Splats, camera: sg.Camera, rng: np.random.Generator) -> None:
    keep = rng.random(len(sheet)) < 0.5
    halves = [draw(sheet.part(k), camera, XRAY).pixels for k in (keep, ~keep)]
    assert halves[0] + halves[1] == pytest.approx(draw(sheet, camera, XRAY).pixels, abs=1e-9)
    assert len(sheet.part(keep)) == keep.sum()


# --- strips of one column over time, flicker and popping --------------------------------------------------------------


SETTINGS = SPLATS.replace(background=(0, 0, 0))


@pytest.fixture(scope="module")
def cube() -> sg.Splats:
    """Dense and of many colours, so that the drawing order shows."""
    rng = np.random.default_rng(8)
    points = np.stack(np.meshgrid(*[np.arange(8.0)] * 3), -1).reshape(-1, 3)
    return sg.Splats.from_points(points, rng.random((512, 3)), np.full(512, 2.0))


def test_a_strip_is_the_middle_column_of_each_frame(renderer: sg.Renderer, cube: sg.Splats) -> None:
    track = turning(ViewOptions(size=(30, 24), elevation=20), sg.Volume(np.zeros((8, 8, 8))), cube, 5.0)
    cameras = [track.camera(n) for n in range(4)]
    found = strip(renderer.render, cube, cameras, SETTINGS)
    assert found.shape == (12, 4, 4) and found[..., :3].max() > 0.2
    for n, camera in enumerate(cameras):
        right = renderer.render(cube, camera, SETTINGS).pixels[:12, 15]
        assert np.abs(found[:, n] - right).max() < 1e-5


def test_flicker_is_the_variance_of_differences(rng: np.random.Generator) -> None:
    still = np.repeat(rng.random((9, 1, 4)), 5, axis=1)
    assert flicker(still) == 0
    noise = rng.normal(size=(200, 200, 4))
    assert flicker(noise) == pytest.approx(2, rel=0.03)


def test_popping_is_where_planes_turn(renderer: sg.Renderer, cube: sg.Splats) -> None:
    track = turning(ViewOptions(size=(40, 40), elevation=15), sg.Volume(np.zeros((8, 8, 8))), cube, 1.0)
    found = popping(renderer.render, cube, track.camera, SETTINGS, turn=100)
    assert [round(pop.angle) for pop in found] == [45] or len(found) == 1
    assert all(1 > pop.change > 3 * pop.usual >= 0 for pop in found)
