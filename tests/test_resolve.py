"""What the settings mean for a picture: the same for the plan and for the float64 truths."""

from __future__ import annotations

import itertools

import pytest

import splatgl as sg
from splatgl.splat.resolve import Resolved, depth_range

# distances of the eye from a ball of 5 voxels, world units: no voxel is smaller than a pixel, and all are
NEAR, FAR = 10.0, 300.0


@pytest.fixture(scope="module")
def splats() -> sg.Splats:
    return sg.extract(sg.scenes.ball(5), sg.Transfer(points=[(0.0, 0.0), (1.0, 0.6)], unit=1.0))


def camera(distance: float) -> sg.Camera:
    return sg.Camera.look_at((0, -distance, 0), (0, 0, 0), (0, 0, 1), 40, (24, 16))


def test_the_plan_says_the_same(splats: sg.Splats) -> None:
    for distance, blend, antialias, attenuation in itertools.product(
        (NEAR, FAR), ("composite", "xray", "mip"), ("paper", "off", "supersample"), ("auto", "opacity")
    ):
        settings = sg.Settings(blend=blend, antialias=antialias, attenuation=attenuation)
        found, plan = Resolved.of(splats, camera(distance), settings), sg.plan(splats, camera(distance), settings)
        for name in ("samples", "z_k", "nearest", "farthest", "background", "beyond", "unsure", "kernel"):
            assert getattr(found, name) == getattr(plan, name)
        for name in ("blend", "antialias", "attenuation", "shading"):
            assert getattr(found, name) == getattr(plan.program, name)
        assert set(found.antialias_notes + found.shading_notes) <= set(plan.notes)


def test_only_what_changes_the_picture_is_on(splats: sg.Splats) -> None:
    near, far = (Resolved.of(splats, camera(distance), sg.Settings()) for distance in (NEAR, FAR))
    assert not near.antialias and near.attenuation == "optical-depth" and "z_k" in near.antialias_notes[0]
    assert far.antialias and far.attenuation == "fill" and not far.antialias_notes
    # motion blur weakens splats where antialiasing does not
    moving = Resolved.of(splats, camera(NEAR), sg.Settings(), moving=True)
    assert not moving.antialias and moving.attenuation == "fill"
    # shading is of surfaces
    xray = Resolved.of(splats, camera(NEAR), sg.Settings(blend="xray"))
    assert near.shading and not near.shading_notes
    assert not xray.shading and "xray" in xray.shading_notes[0]


def test_samples_are_the_fine_cameras_pixels(splats: sg.Splats) -> None:
    found = Resolved.of(splats, camera(FAR), sg.Settings(antialias="supersample", samples=3))
    assert found.camera.size == (72, 48)
    assert found.z_k == pytest.approx(3 * camera(FAR).z_k(splats.grid.smallest_spacing))
    assert (found.nearest, found.farthest) == depth_range(splats, camera(FAR))
    assert FAR - 6 < found.nearest < FAR < found.farthest < FAR + 6
