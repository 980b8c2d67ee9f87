"""What the settings mean for a picture: the same for the plan and for the float64 truths."""

from __future__ import annotations

import itertools

import pytest

import splatgl as sg
from splatgl.planning.plan import unused_settings
from splatgl.planning.resolve import Resolved, depth_range
from tests.helpers.splatting import SPLATS

# distances of the eye from a ball of 5 voxels, world units: no voxel is smaller than a pixel, and all are
NEAR, FAR = 10.0, 300.0


@pytest.fixture(scope="module")
def splats() -> sg.Splats:
    return sg.extract(sg.scenes.ball(5), sg.Transfer(points=[(0.0, 0.0), (1.0, 0.6)], unit=1.0), classification="pre")


def camera(distance: float) -> sg.Camera:
    return sg.Camera.look_at((0, -distance, 0), (0, 0, 0), (0, 0, 1), 40, (24, 16))


def test_the_plan_says_the_same(splats: sg.Splats) -> None:
    for distance, blend, antialias, attenuation in itertools.product(
        (NEAR, FAR), ("composite", "xray", "mip"), ("paper", "off", "supersample"), ("auto", "opacity")
    ):
        settings = SPLATS.replace(blend=blend, antialias=antialias, attenuation=attenuation)
        found, plan = Resolved.of(splats, camera(distance), settings), sg.plan(splats, camera(distance), settings)
        for name in ("appearance", "samples", "z_k", "depths", "background", "unsure", "kernel"):
            assert getattr(found, name) == getattr(plan.resolved, name)
        assert found.appearance == plan.program.appearance
        assert found.view.antialias == plan.program.seen.antialias
        assert found.view.widened_beyond == plan.view.widened_beyond
        assert set(found.notes) <= set(plan.notes)


def test_only_what_changes_the_picture_is_on(splats: sg.Splats) -> None:
    near, far = (Resolved.of(splats, camera(distance), SPLATS) for distance in (NEAR, FAR))
    assert not near.view.antialias and near.appearance.attenuation == "optical-depth" and "z_k" in near.notes[0]
    assert far.view.antialias and far.appearance.attenuation == "fill" and not far.notes
    # motion blur weakens splats where antialiasing does not
    moving = Resolved.of(splats, camera(NEAR), SPLATS, moving=True)
    assert not moving.view.antialias and moving.appearance.attenuation == "fill"
    # shading is of surfaces
    xray = Resolved.of(splats, camera(NEAR), SPLATS.replace(blend="xray"))
    assert near.appearance.shading and len(near.notes) == 1
    assert not xray.appearance.shading and "xray" in xray.notes[-1]


def test_the_blur_moves_z_k(splats: sg.Splats) -> None:
    pixel = Resolved.of(splats, camera(FAR), SPLATS)
    for blur_width in (0.25, 0.5, 2.0):
        found = Resolved.of(splats, camera(FAR), SPLATS.replace(blur_width=blur_width))
        assert found.z_k == pytest.approx(pixel.z_k / blur_width, rel=1e-12)
        assert found.view.blur == blur_width
        # a narrower low-pass aliases
        assert found.info(splats, camera(FAR))["aliased"] == (blur_width < 1)
        # samples are of one pixel's width
        for antialias in ("auto", "supersample", "off"):
            settings = SPLATS.replace(antialias=antialias)
            same, right = (
                Resolved.of(splats, camera(FAR), s) for s in (settings.replace(blur_width=blur_width), settings)
            )
            assert (same.z_k, same.view.blur) == (right.z_k, 1.0)
    # splats before z_k that a wider low-pass stretches
    assert Resolved.of(splats, camera(NEAR), SPLATS.replace(blur_width=2)).view.antialias
    assert not Resolved.of(splats, camera(NEAR), SPLATS).view.antialias
    # a narrower one leaves them as they are, which is another picture, too
    sharp = SPLATS.replace(blur_width=0.25)
    plans = [sg.plan(splats, camera(distance), sharp) for distance in (NEAR, 2 * NEAR)]
    assert not any(plan.view.antialias for plan in plans)
    near, far = (any("blur_width" in note for note in unused_settings([plan], sharp)) for plan in plans)
    assert near and not far


def test_samples_are_the_fine_cameras_pixels(splats: sg.Splats) -> None:
    found = Resolved.of(splats, camera(FAR), SPLATS.replace(antialias="supersample", samples=3))
    assert found.camera.size == (72, 48)
    assert found.z_k == pytest.approx(3 * camera(FAR).z_k(splats.grid.smallest_spacing))
    assert found.depths == depth_range(splats, camera(FAR))
    assert FAR - 6 < found.depths[0] < FAR < found.depths[1] < FAR + 6
