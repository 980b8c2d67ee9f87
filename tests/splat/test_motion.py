"""Paths of splats while the shutter is open: rigid motions, cameras, vector fields."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import splatgl as sg
from splatgl.splat.motion import Motion, RigidTransform, flow_of, rotation, rotation_vector, streaks

DATA = Path(os.environ.get("SPLATGL_DATA", Path(__file__).parents[3] / "shared" / "data"))


@pytest.fixture
def points(rng: np.random.Generator) -> sg.Splats:
    return sg.Splats.from_points(rng.uniform(-5, 5, (40, 3)), np.ones((40, 3)), np.ones(40), spacing=(1.0, 1.5, 0.8))


@pytest.fixture
def camera() -> sg.Camera:
    return sg.Camera.look_at((3, -30, 9), (0, 1, 0), (0, 0, 1), 40, (80, 60))


def world(splats: sg.Splats) -> np.ndarray:
    return splats.positions.astype(float) @ splats.grid.world_from_index.T + splats.grid.origin


def slopes(camera: sg.Camera, points: np.ndarray) -> np.ndarray:
    """[N, 2] in pixels from the middle."""
    eye = camera.eye_from_points(points)
    flat = eye[:, :2] / eye[:, 2:] if camera.perspective else eye[:, :2]
    return flat * camera.size[1] / camera.extent


def test_parts_of_a_rigid_motion(rng: np.random.Generator) -> None:
    for angle in (0.0, 1e-7, 0.3, 3.0, np.pi):
        turn = rng.normal(size=3)
        turn *= angle / np.linalg.norm(turn)
        whole = RigidTransform(rotation(turn), rng.normal(size=3))
        assert np.abs(np.cos(angle) - (np.trace(whole.rotation) - 1) / 2) < 1e-12
        assert np.abs(rotation(rotation_vector(whole.rotation)) - whole.rotation).max() < 1e-7
        third = whole.part(1 / 3)
        again = third.after(third).after(third)
        assert np.abs(again.rotation - whole.rotation).max() < 1e-7
        assert np.abs(again.shift - whole.shift).max() < 1e-6
        x = rng.normal(size=(5, 3))
        assert whole.inverse()(whole(x)) == pytest.approx(x)


def test_a_turning_volume_is_a_camera_that_goes_around_it(points: sg.Splats, camera: sg.Camera) -> None:
    """The view at any time shows the points where the turn has taken them, and the picture is the same."""
    motion = Motion(spin=(0, 0, 30), center=(1, 2, 0), velocity=(0.3, 0, -1))
    for at in (-1.0, -0.25):
        # counter-clockwise seen from +z: x goes to y
        turned = (world(points) - (1, 2, 0)) @ rotation(np.array([0, 0, np.radians(30 * at)])).T + (1, 2, 0)
        moved = turned + at * np.array([0.3, 0, -1])
        assert slopes(motion.view(camera, at), world(points)) == pytest.approx(slopes(camera, moved), abs=1e-9)
    x_axis = rotation(np.array([0, 0, np.pi / 2])) @ (1, 0, 0)
    assert x_axis == pytest.approx((0, 1, 0), abs=1e-12)


def test_a_camera_goes_from_where_it_was(camera: sg.Camera) -> None:
    """In half the time it is half way on the circle, not on its chord; and zooms by equal factors."""
    center = np.array([0.0, 1, 0])
    turn = RigidTransform.about(np.array([0, 0, 0.8]), center)
    before = replace(
        camera,
        eye=turn(camera.eye),
        eye_from_world=camera.eye_from_world @ turn.rotation.T,
        extent=camera.extent * 4,
    )
    motion = Motion(camera=before)
    assert motion.view(camera, 0) is camera
    last, middle = motion.view(camera, -1), motion.view(camera, -0.5)
    assert last.eye == pytest.approx(before.eye) and last.eye_from_world == pytest.approx(before.eye_from_world)
    assert np.linalg.norm(middle.eye - center) == pytest.approx(np.linalg.norm(camera.eye - center))
    assert middle.extent == pytest.approx(camera.extent * 2)


@pytest.mark.parametrize("parallel", [False, True])
def test_streaks_go_from_the_first_place_to_the_last(points: sg.Splats, camera: sg.Camera, parallel: bool) -> None:
    if parallel:
        camera = sg.Camera.orthographic(camera.eye, (0, 1, 0), (0, 0, 1), 20.0, (80, 60))
    flow = np.random.default_rng(1).normal(size=(40, 3))
    motion = Motion(spin=(2, 3, 8), velocity=(1, 0, 0), flow=flow)
    found = streaks(points, camera, motion, 240)
    length = 2 / 3

    # where the points are seen at nine times
    times = np.linspace(-length, 0, 9)
    places = [slopes(motion.view(camera, at), world(points) + at * flow) for at in times]
    spacing = points.grid.mean_spacing
    pitch = camera.extent / camera.size[1]
    scale = 1 / (found.middle[2] * pitch if camera.perspective else np.full(40, pitch / spacing))
    assert pytest.approx(places[-1] - places[0], abs=1e-4) == (found.step * scale).T
    assert found.pixels(spacing) == pytest.approx(np.linalg.norm(places[-1] - places[0], axis=1), rel=1e-4)
    # the middle is the mean of the path; the place at half time is not as near
    weights = np.array([1, 4, 2, 4, 2, 4, 2, 4, 1]) / 24
    mean = sum(w * place for w, place in zip(weights, places, strict=True))
    error = np.abs((found.middle[:2] * scale).T - mean).max()
    assert error < 1e-3 < 0.05 < np.abs(places[4] - mean).max() * 20
    assert error < 0.1 * np.abs(places[4] - mean).max()


def test_what_stands_still_stays_bit_for_bit(points: sg.Splats, camera: sg.Camera) -> None:
    from splatgl.geometry.view import GridView
    from splatgl.splat.kernels import kernel

    right = GridView.of(points.grid, camera, kernel("crawfis-max")).voxels(points.positions)
    for motion, shutter in ((Motion(), 180), (Motion(spin=(0, 0, 9)), 0), (Motion(flow=np.zeros((40, 3))), 360)):
        found = streaks(points, camera, motion, shutter)
        assert not found.step.any() and not found.length.any()
        assert found.camera is camera
        assert found.middle == pytest.approx(right, rel=1e-12)
    assert Motion().still and not Motion(spin=(0, 0, 1)).still


def test_splats_that_cross_the_eyes_plane_are_finite() -> None:
    points = sg.Splats.from_points(np.array([[0, 0, 1.0], [0, 1, 0], [2, 3, -4]]), np.ones((3, 3)), np.ones(3))
    camera = sg.Camera.look_at((0, 0, 0), (0, 0, 1), (0, -1, 0), 90, (8, 8))
    for motion in (Motion(velocity=(0, 0, 3)), Motion(spin=(170, 0, 0)), Motion(velocity=(1e9, 0, 0))):
        found = streaks(points, camera, motion, 360)
        assert np.isfinite(found.step).all() and np.isfinite(found.middle).all()


def test_bad_input_is_one_line(points: sg.Splats, camera: sg.Camera) -> None:
    for make in (
        lambda: Motion(spin=(1, 2)),
        lambda: Motion(velocity=(1, 2, np.nan)),
        lambda: Motion(flow=np.zeros((3, 2))),
        lambda: streaks(points, camera, Motion(flow=np.ones((3, 3))), 180),
        lambda: Motion(flow=np.ones((3, 3))).move(points, -0.5),
    ):
        with pytest.raises(sg.InputError, match="expected"):
            make()


def test_flow_is_the_vector_at_each_splats_cell(rng: np.random.Generator) -> None:
    vectors = rng.normal(size=(4, 5, 6, 3))
    vectors[1, 2, 3] = np.nan
    samples = rng.random((4, 5, 6))
    volume = sg.Volume(samples, spacing=(1, 2, 3), origin=(5, 0, 0), vectors=vectors)
    splats = sg.extract(volume, sg.Transfer(points=[(0.4, 0.0), (0.4, 0.5)]), classification="pre")
    found = flow_of(splats, volume, scale=2.0)
    x, y, z = splats.positions.astype(int).T
    assert found == pytest.approx(2 * np.nan_to_num(vectors)[z, y, x])
    # and moves them: half a frame back
    moved = Motion(flow=found).move(splats, -0.5)
    assert world(moved) == pytest.approx(world(splats) - found / 2, abs=1e-5)
    assert (moved.row_start == splats.row_start).all()
    for other in (sg.Volume(samples), sg.Volume(samples, vectors=vectors)):
        with pytest.raises(sg.InputError):
            flow_of(splats, other)


def test_carotid_flows_along_its_vessels() -> None:
    path = DATA / "carotid_76x49x45_scalar_and_velocity.vtk"
    if not path.is_file():
        pytest.skip(f"no {path.name}: set SPLATGL_DATA")
    volume = sg.load(path)
    splats = sg.extract(volume, sg.Transfer(points=[(150, 0.0), (200, 0.4)]), classification="pre")
    flow = flow_of(splats, volume)
    speed = np.linalg.norm(flow, axis=1)
    # blood moves where the vessels are bright, and not elsewhere
    assert len(splats) > 1000 and speed.max() > 10 and np.median(speed) > 1.0
    found = streaks(splats, sg.Camera.orbit(splats), Motion(flow=flow * 0.1), 180)
    assert 0.1 < np.median(found.length) < 1.5
