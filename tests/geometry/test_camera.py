"""Cameras: axes, z_k, orbits that show all, and views that cannot be."""

from __future__ import annotations

import numpy as np
import pytest

import splatgl as sg
from tests.helpers.splatting import SPLATS

BOX = sg.Volume(np.zeros((30, 20, 10)), spacing=(1, 2, 0.5), origin=(5, -7, 100))


def test_axes_are_right_down_forward() -> None:
    camera = sg.Camera.look_at((0, 0, 0), (0, 0, 1), up=(0, -1, 0))
    assert np.abs(camera.eye_from_world - np.eye(3)).max() < 1e-15
    slanted = sg.Camera.look_at((3, 1, 4), (1, 5, -9), up=(0.2, 0.6, 0.5))
    right, down, forward = slanted.eye_from_world
    assert np.cross(forward, [0.2, 0.6, 0.5]) @ right > 0
    assert np.abs(np.cross(right, down) - forward).max() < 1e-14
    assert down @ [0.2, 0.6, 0.5] < 0


def test_z_k() -> None:
    """z_k = s·z_img/p: 443.405 for 512 rows of pixels, however many columns, half-angle 30°."""
    camera = sg.Camera.look_at((0, 0, 0), (0, 0, 1), (0, 1, 0), fov=60, size=(640, 512))
    assert camera.z_k(1.0) == pytest.approx(443.405006737633, abs=1e-11)
    assert camera.pixel_pitch(camera.z_k(2.5)) == pytest.approx(2.5)
    parallel = sg.Camera.orthographic((0, 0, 0), (0, 0, 1), (0, 1, 0), height=100, size=(70, 50))
    assert parallel.pixel_pitch(7.0) == 2
    assert (parallel.z_k(2.5), parallel.z_k(1.5)) == (np.inf, 0)


def test_orbit_convention() -> None:
    front = sg.Camera.orbit(BOX)
    assert front.forward == pytest.approx([0, 1, 0])
    assert front.right == pytest.approx([1, 0, 0])
    # counter-clockwise seen from +z: from −y to +x
    side = sg.Camera.orbit(BOX, azimuth=90)
    assert (side.eye - BOX.center)[0] > 0
    assert side.forward == pytest.approx([-1, 0, 0], abs=1e-12)
    above = sg.Camera.orbit(BOX, elevation=90)
    assert above.forward == pytest.approx([0, 0, -1], abs=1e-12)


@pytest.mark.parametrize("up", [(0, 0, 1), (0, 1, 0), (0, 0, -1), (1, 2, 3)])
def test_orbit_shows_every_corner(up: tuple) -> None:
    for azimuth in range(0, 360, 37):
        for elevation in (-90, -30, 0, 55):
            camera = sg.Camera.orbit(BOX, azimuth, elevation, fov=30, size=(300, 100), up=up)
            eye = camera.eye_from_points(BOX.corners)
            half = np.array([1.5, 0.5]) * camera.extent
            assert (np.abs(eye[:, :2] / eye[:, 2:]) * [1 / 3, 1] <= half[1]).all()
            assert (eye[:, 2] > 0).all()
            assert camera.eye_from_world[1] @ up <= 1e-12


def test_parallel_keeps_the_middle() -> None:
    camera = sg.Camera.orbit(BOX, 20, 30)
    parallel = camera.parallel(BOX)
    depth = camera.eye_from_points(BOX.center)[2]
    assert parallel.pixel_pitch(0.0) == pytest.approx(camera.pixel_pitch(depth))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"target": (1, 2, 3)}, "target: expected a point other than the eye"),
        ({"up": (2, 2, 2)}, "up: expected a direction that is not along the view"),
        ({"up": (0, 0, 0)}, "up: expected a direction"),
        ({"fov": 0}, "fov: expected an angle"),
        ({"fov": 180}, "fov: expected an angle"),
        ({"size": (0, 5)}, "size: expected a width"),
        ({"size": (5, 10**30)}, "size: expected a width"),
        ({"size": (5, np.nan)}, "size: expected a width"),
        ({"eye": (np.nan, 0, 0)}, "eye: expected three finite"),
        ({"eye": (1, 2)}, "eye: expected three finite"),
        ({"eye": (1e200, 0, 0)}, "eye: expected three finite"),
        ({"up": (0, 0, np.inf)}, "up: expected three finite"),
        ({"fov": np.nan}, "fov: expected an angle"),
        ({"fov": 1e-308}, "fov: expected an angle"),
    ],
)
def test_impossible_views(change: dict, message: str) -> None:
    good = {"eye": (1, 2, 3), "target": (2, 3, 4), "up": (0, 0, 1), "fov": 40, "size": (9, 9)}
    with pytest.raises(sg.InputError, match=message):
        sg.Camera.look_at(**{**good, **change})


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("value", [0, -1, np.nan, np.inf, -np.inf, 1e-320, 1e-308, 1e308])
def test_impossible_heights_and_zooms(value: float) -> None:
    """In one line, without a word from numpy, and before the eye is at infinity."""
    for work in (
        lambda: sg.Camera.orthographic((0, 0, 0), (0, 0, 1), (0, 1, 0), height=value),
        lambda: sg.Camera.orbit(BOX).parallel(BOX, value),
    ):
        with pytest.raises(sg.InputError, match=r"^height: expected a positive length"):
            work()
    with pytest.raises(sg.InputError, match=r"^zoom: expected a positive"):
        sg.Camera.orbit(BOX, zoom=value)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("what", ["azimuth", "elevation"])
def test_impossible_angles(what: str) -> None:
    for value in (np.nan, np.inf, -np.inf, 1e308):
        with pytest.raises(sg.InputError, match=f"^{what}: expected an angle"):
            sg.Camera.orbit(BOX, **{what: value})
    assert np.isfinite(sg.Camera.orbit(BOX, **{what: 1e-320}).eye).all()


@pytest.mark.filterwarnings("error")
def test_views_that_float32_cannot_hold() -> None:
    """Cameras of any splats, but not of these: the picture would be of NaN."""
    splats = sg.Splats.from_points(np.eye(3), np.ones((3, 3)), np.ones(3))
    for camera, message in (
        (sg.Camera.look_at((0, -1e20, 0), (0, 0, 0), (0, 0, 1)), "eye: expected within 1e.15 spacings of the splats"),
        (sg.Camera.orbit(splats).parallel(splats, 1e20), "height: expected"),
        (sg.Camera.orbit(splats).parallel(splats, 1e-50), "height: expected"),
    ):
        with pytest.raises(sg.InputError, match=f"^{message}"):
            sg.plan(splats, camera, SPLATS)
    inside = sg.Camera.look_at((0, 5, 0), (0, 9, 0), (0, 0, 1))
    with pytest.raises(
        sg.InputError, match=r"^height: expected a camera in front of the volume's centre, got one behind it"
    ):
        inside.parallel(splats)
    for zoom in (1e-14, 1e14):
        sg.plan(splats, sg.Camera.orbit(splats, zoom=zoom), SPLATS)


@pytest.mark.parametrize("kind", ["perspective", "horizontal angle", "orthographic"])
def test_cameras_of_vtk_see_the_same_places(kind: str) -> None:
    """Points fall onto the pixels where VTK's own projection has them."""
    pyvista = pytest.importorskip("pyvista", reason="plotters come from pyvista")
    theirs = pyvista.Camera()
    theirs.position, theirs.focal_point, theirs.up = (30.0, -20.0, 25.0), (1.0, 2.0, 3.0), (0.1, 0.2, 1.0)
    theirs.view_angle, theirs.parallel_scale = 35.0, 12.0
    theirs.parallel_projection = kind == "orthographic"
    theirs.SetUseHorizontalViewAngle(kind == "horizontal angle")
    width, height = size = (320, 200)
    matrix = pyvista.array_from_vtkmatrix(theirs.GetCompositeProjectionTransformMatrix(width / height, -1, 1))
    camera = sg.Camera.of(theirs, size)
    points = np.random.default_rng(1).uniform(-8, 8, (50, 3))
    x, y, _, w = matrix @ np.vstack([points.T, np.ones(50)])
    right = np.stack([(x / w + 1) * width / 2, (1 - y / w) * height / 2], axis=1)
    eye = camera.eye_from_points(points)
    across = eye[:, :2] / eye[:, 2:] if camera.perspective else eye[:, :2]
    assert np.abs(across / (camera.extent / height) + np.array(size) / 2 - right).max() < 1e-6


def test_what_has_no_camera_is_refused() -> None:
    with pytest.raises(sg.InputError, match="a camera of VTK or PyVista, or a plotter, got a list"):
        sg.Camera.of([1, 2, 3])


@pytest.mark.parametrize("size", [(64, 64), (90, 40), (30, 70)])
@pytest.mark.parametrize("turn", [(0, 0), (30, 20), (200, -70)])
def test_opposite_margins_are_equal(size: tuple[int, int], turn: tuple[int, int]) -> None:
    """Of a box in perspective; the narrower margins are 2.5 % or more of the picture."""
    volume = sg.Volume(np.ones((9, 30, 14), np.float32), (1.0, 1.3, 2.0), (5.0, 0.0, -40.0))
    splats = sg.extract(volume, sg.Transfer([(0, 0.0), (2, 0.5)]))
    camera = sg.Camera.orbit(volume, *turn, size=size)
    assert camera == sg.Camera.orbit(splats, *turn, size=size) == sg.Camera.orbit(sg.Scene([volume]), *turn, size=size)
    assert camera != sg.Camera.orbit(volume, *turn, size=size, zoom=1.1) and len({camera, camera.resized(size)}) == 1
    x, y, z = camera.eye_from_points(volume.corners).T
    places = np.array([x / z, y / z]) / camera.extent * size[1] / np.array([[size[0]], [size[1]]])
    low, high = places.min(axis=1) + 0.5, 0.5 - places.max(axis=1)
    assert low == pytest.approx(high, abs=1e-9) and 0.02 < low.min() < 0.1
