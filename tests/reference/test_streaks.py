"""Streaks against temporal supersampling: how wrong drawing a moving splat in one pass is."""

from __future__ import annotations

import numpy as np
import pytest

import splatgl as sg
from splatgl.data.image import Image
from splatgl.splat.motion import MOST, Motion, Supersampling, count_moments
from tests.helpers import streaks
from tests.helpers.splatting import SPLATS

XRAY = SPLATS.replace(blend="xray")
SPIN = Motion(spin=(0, 0, 8))


@pytest.fixture(scope="module")
def cloud() -> sg.Splats:
    """Ninety coloured points on a lattice within a ball of radius 5."""
    rng = np.random.default_rng(4)
    lattice = np.stack(np.meshgrid(*[np.arange(-5.0, 6.0)] * 3), -1).reshape(-1, 3)
    ball = lattice[np.linalg.norm(lattice, axis=1) < 5]
    some = ball[rng.choice(len(ball), 90, replace=False)]
    return sg.Splats.from_points(some, rng.random((90, 3)), np.full(90, 0.4))


@pytest.fixture(scope="module")
def camera() -> sg.Camera:
    """z_k lies before half of the cloud."""
    return sg.Camera.look_at((0, -30, 10), (0, 0, 0), (0, 0, 1), 24, (14, 14))


def rmse(image: Image, right: Image) -> float:
    return float(np.sqrt(((image.pixels - right.pixels) ** 2).mean()))


@pytest.fixture(scope="module")
def right(cloud: sg.Splats, camera: sg.Camera) -> Image:
    return Supersampling(sg.reference.render, SPIN, 180, 96)(cloud, camera, XRAY)


def test_exact_blur_is_temporal_supersampling(cloud: sg.Splats, camera: sg.Camera, right: Image) -> None:
    """X-ray, 96 moments: RMSE < 1e−3 is asked for. What stands still in the middle is seven times as wrong."""
    depth = camera.eye_from_points(cloud.corners)[:, 2]
    assert depth.min() < camera.z_k(1.0) < depth.max() and right.pixels.max() > 0.3
    found = rmse(streaks.render(cloud, camera, XRAY, SPIN), right)
    still = rmse(sg.reference.render(cloud, SPIN.view(camera, -0.25), XRAY), right)
    assert found < 1e-4 and 5 * found < still


def test_shorter_streaks_are_nearer(cloud: sg.Splats, camera: sg.Camera, renderer: sg.Renderer) -> None:
    """Twice as many straight pieces of a path that bends are up to four times as near; flow, turn and camera alike."""
    flow = np.random.default_rng(2).normal(size=(90, 3))
    before = sg.Camera.look_at((9, -26, 10), (0.3, 0, 0), (0, 0, 1), 25, (14, 14))
    for motion in (Motion(spin=(0, 0, 60)), Motion(flow=flow * 3, spin=(0, 20, 0)), Motion(camera=before)):
        truth = Supersampling(renderer.render, motion, 180, 64)(cloud, camera, XRAY)
        errors = [
            rmse(Supersampling(renderer.render, motion, 180, n, blurred=True)(cloud, camera, XRAY), truth)
            for n in (1, 2, 4)
        ]
        assert errors[0] == pytest.approx(rmse(renderer.render(cloud, camera, XRAY, motion), truth), rel=0.02)
        assert 2 * errors[1] < errors[0] and 2 * errors[2] < errors[1]


def test_as_many_moments_as_paths_are_long(cloud: sg.Splats, camera: sg.Camera) -> None:
    pixel = float(camera.pixel_pitch(30.0))
    counts = [count_moments(cloud, camera, Motion(velocity=(2 * n * pixel, 0, 0)), 180) for n in (0, 0.1, 3, 12, 1e3)]
    assert counts == [1, 2, 4, 10, MOST]
    # only what is seen counts: most of it is behind the eye, and races
    inside = sg.Camera.look_at((0, 4, 0), (0, 9, 0), (0, 0, 1), 30, (14, 14))
    assert count_moments(cloud, inside, Motion(spin=(0, 0, 90)), 360) <= MOST
    assert count_moments(cloud, sg.Camera.look_at((0, 40, 0), (0, 90, 0), (0, 0, 1), 30, (14, 14)), SPIN, 180) == 1


def test_energy_and_paper_are_further(cloud: sg.Splats, camera: sg.Camera, right: Image) -> None:
    """A footprint cut in half is too wide; the paper's also gains energy, the other does not."""
    found = {shape: streaks.render(cloud, camera, XRAY, SPIN, shape=shape) for shape in ("exact", "energy", "paper")}
    errors = [rmse(found[shape], right) for shape in ("exact", "energy", "paper")]
    assert errors[0] < errors[1] < errors[2]
    assert found["paper"].pixels[..., 3].sum() > 1.02 * right.pixels[..., 3].sum()


def test_flow_and_camera_are_drawn_as_well(cloud: sg.Splats, camera: sg.Camera) -> None:
    flow = np.random.default_rng(2).normal(size=(90, 3))
    before = sg.Camera.look_at((1, -29, 10), (0.3, 0, 0), (0, 0, 1), 25, (14, 14))
    for motion in (Motion(flow=flow), Motion(camera=before)):
        truth = Supersampling(sg.reference.render, motion, 180, 24)(cloud, camera, XRAY)
        assert rmse(streaks.render(cloud, camera, XRAY, motion), truth) < 5e-4
        assert rmse(sg.reference.render(cloud, camera, XRAY), truth) > 3e-3


def test_parallel_views_and_other_grids(camera: sg.Camera) -> None:
    rng = np.random.default_rng(5)
    points = sg.Splats.from_points(rng.uniform(-4, 4, (60, 3)), rng.random((60, 3)), np.ones(60), (1.0, 1.0, 0.4))
    parallel = sg.Camera.orthographic((0, -30, 10), (0, 0, 0), (0, 0, 1), 11.0, (14, 14))
    for view in (camera, parallel):
        truth = Supersampling(sg.reference.render, SPIN, 180, 24)(points, view, XRAY)
        # the voxels turn with the grid, which a streak's one shape has not
        assert rmse(streaks.render(points, view, XRAY, SPIN), truth) < 2e-3 * truth.pixels.max()


def test_no_motion_is_the_reference(cloud: sg.Splats, camera: sg.Camera) -> None:
    for settings in (XRAY, SPLATS, SPLATS.replace(attenuation="opacity", background=(0.1, 0.2, 0.3))):
        still = streaks.render(cloud, camera, settings, Motion())
        assert np.abs(still.pixels - sg.reference.render(cloud, camera, settings).pixels).max() < 1e-12


@pytest.mark.parametrize(("spin", "other"), [(90.0, "optical-depth"), (5.0, "opacity")])
def test_composite_is_near(spin: float, other: str) -> None:
    """An opaque plate: blur before visibility can't be right. `fill` is nearer than depth on long paths, than
    opacity on short ones.
    """
    lattice = np.stack(np.meshgrid(*[np.arange(-5.0, 6.0)] * 3), -1).reshape(-1, 3)
    plate = lattice[(np.abs(lattice[:, 0]) < 0.6) & (np.linalg.norm(lattice, axis=1) < 5)]
    splats = sg.Splats.from_points(plate, np.full((len(plate), 3), 0.7), np.full(len(plate), 4.6))
    camera = sg.Camera.look_at((0, -40, 14), (0, 0, 0), (0, 0, 1), 18, (16, 16))
    motion, settings = Motion(spin=(0, 0, spin)), SPLATS
    truth = Supersampling(sg.reference.render, motion, 180, 24)(splats, camera, settings)
    fill, off = (
        rmse(streaks.render(splats, camera, settings.replace(attenuation=name), motion), truth)
        for name in ("fill", other)
    )
    assert fill < 0.8 * off and fill < 0.06
    if spin > 45:
        assert fill < 0.8 * rmse(sg.reference.render(splats, motion.view(camera, -0.25), settings), truth)


def test_bad_input_is_one_line(cloud: sg.Splats, camera: sg.Camera) -> None:
    for settings, shape in (
        (XRAY, "box"),
        (SPLATS.replace(blend="mip"), "exact"),
        (XRAY.replace(antialias="supersample"), "exact"),
    ):
        with pytest.raises(sg.InputError, match="expected"):
            streaks.render(cloud, camera, settings, SPIN, shape=shape)
    with pytest.raises(sg.InputError, match="count"):
        Supersampling(sg.reference.render, SPIN, count=0)


@pytest.mark.parametrize("along", [(1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (0.9, 0.0, 0.9)])
def test_a_streak_whose_ends_lie_between_pixels_is_there(along: tuple[float, float, float]) -> None:
    """Smaller than a pixel, moving across one's centre: neither end reaches any, the middle does."""
    view = sg.Camera.look_at((0.0, -400.0, 0.0), (0.0, 0.0, 0.0), (0, 0, 1), 40.0, (9, 9))
    move = 0.8 * view.extent * 400 / 9 * np.array(along)
    one = sg.Splats.from_points(move[None] / 2, np.ones((1, 3)), np.ones(1))
    plain = SPLATS.replace(blend="xray", antialias="off")
    streak = streaks.render(one, view, plain, Motion(velocity=move), 360.0).pixels[..., 3]
    right = Supersampling(sg.reference.render, Motion(velocity=move), 360, 200)(one, view, plain).pixels[..., 3]
    assert right[4, 4] > 0.01
    assert np.abs(streak - right).max() < 0.02 * right[4, 4]
