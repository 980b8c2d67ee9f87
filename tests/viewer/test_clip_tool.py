"""Cuts in the window: the box and planes as values, their handles in the view, and what is saved of them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import splatgl as sg
from splatgl.cli.main import main
from splatgl.geometry.clipping import crop_planes
from splatgl.scene.scene_file import SceneFile
from splatgl.viewer.clip_tool import (
    HandleDrag,
    direction_on_sphere,
    handle_at,
    handles,
    outline,
    plane_middle,
    set_cuts,
)
from splatgl.viewer.commands import add_plane
from splatgl.viewer.document import Document
from splatgl.viewer.measure_tool import find_matter
from splatgl.viewer.saving import save_scene
from splatgl.viewer.state import WHOLE, ClipState, History, State
from splatgl.viewer.trackball import nearest_on_line, pixel_ray, project, project_segment
from tests.helpers.commands import acted

pytestmark = pytest.mark.usefixtures("shared_programs")

SIZE = (120, 80)
ORTHOGRAPHIC = sg.Camera.orthographic((1.0, -30.0, 4.0), (2.0, 3.0, 1.0), (0, 0, 1), 40.0, SIZE)
PERSPECTIVE = sg.Camera.look_at((1.0, -30.0, 4.0), (2.0, 3.0, 1.0), (0, 0, 1), 40.0, SIZE)
CAMERAS = pytest.mark.parametrize("camera", [PERSPECTIVE, ORTHOGRAPHIC], ids=["perspective", "orthographic"])


def sheared() -> sg.Volume:
    """A grid that is neither cubic nor rectangular, in no plain place."""
    direction = np.array([[0.8, -0.6, 0.0], [0.6, 0.8, 0.3], [0.0, 0.0, 0.95]])
    samples = np.linspace(0, 1, 5 * 6 * 8, dtype=np.float32).reshape(5, 6, 8)
    return sg.Volume(samples, spacing=(1.0, 1.5, 2.0), origin=(3.0, -2.0, 1.0), direction=direction)


@pytest.fixture
def document(tmp_path: Path) -> Document:
    z, y, x = np.indices((16, 16, 16)) / 15 - 0.5
    np.save(tmp_path / "ball.npy", np.float32(40 * np.clip(1.4 - 3 * np.sqrt(x * x + y * y + z * z), 0, 1)))
    points = ((4.0, 0.0), (30.0, 0.6))
    return Document.open(SceneFile(str(tmp_path / "ball.npy"), transfer={"points": points, "colormap": "hot"}))


@CAMERAS
def test_a_point_is_seen_on_the_ray_through_its_pixel(camera: sg.Camera) -> None:
    points = np.array([[2.0, 3.0, 1.0], [0.0, 10.0, -4.0], [6.0, -3.0, 2.0]])
    for point, place in zip(points, project(camera, points), strict=True):
        start, direction = pixel_ray(camera, tuple(place))
        assert np.linalg.norm(np.cross(point - start, direction)) < 1e-9
    # the middle of the picture is straight ahead; of the perspective, one up is a pixel's pitch at that depth
    assert np.allclose(project(camera, camera.eye[None] + 7 * camera.forward), [60.0, 40.0])
    up = camera.eye + 7 * camera.forward - camera.pixel_pitch(7.0) * camera.eye_from_world[1]
    assert np.allclose(project(camera, up[None]), [60.0, 39.0])


def test_lines_end_in_front_of_the_eye() -> None:
    eye, forward, right = PERSPECTIVE.eye, PERSPECTIVE.forward, PERSPECTIVE.right
    assert project_segment(PERSPECTIVE, eye - forward, eye - 2 * forward) is None
    found = project_segment(PERSPECTIVE, eye + 5 * forward + right, eye - 5 * forward + right)
    assert found is not None and np.allclose(found[0], project(PERSPECTIVE, (eye + 5 * forward + right)[None])[0])
    # beyond the right edge, on the row of the middle
    assert found[1][0] > 1e4 and found[1][1] == pytest.approx(40.0, abs=1e-3 * found[1][0])


@CAMERAS
def test_the_nearest_of_a_line_is_under_the_cursor(camera: sg.Camera) -> None:
    point, axis = np.array([2.0, 3.0, 1.0]), np.array([0.6, 0.0, 0.8])
    for t in (-3.0, 0.0, 2.5):
        (place,) = project(camera, (point + t * axis)[None])
        assert nearest_on_line(camera, tuple(place), point, axis) == pytest.approx(t)
    assert nearest_on_line(camera, (60.0, 40.0), point, camera.forward) is None


def test_sides_are_those_of_crop() -> None:
    volume = sheared()
    found = ClipState(((0.25, 1.0), (0.0, 0.5), (0.2, 0.8))).clip(volume)
    assert np.allclose(found, crop_planes("2:,:3,1:4", volume))
    back = ClipState.from_planes(found, volume)
    assert not back.planes and np.allclose(back.sides, [(0.25, 1.0), (0.0, 0.5), (0.2, 0.8)])


def test_other_planes_stay_planes() -> None:
    volume = sheared()
    oblique = sg.Settings(clip=[(1.0, 2.0, 0.5, 3.0)]).clip
    cuts = ClipState.from_planes((*oblique, *crop_planes("2:,:,:", volume)), volume)
    assert cuts.planes == oblique and cuts.sides[0][0] == pytest.approx(0.25)
    assert replace(cuts, active=False).clip(volume) == ()


def test_unit_normals_are_kept_bit_for_bit() -> None:
    """However often they are checked, as in a scene that is saved and read again."""
    for row in np.random.default_rng(3).normal(size=(200, 4)):
        once = sg.Settings(clip=[tuple(row)]).clip
        assert sg.Settings(clip=once).clip == once


@CAMERAS
@pytest.mark.parametrize(("axis", "end"), [(0, 0), (1, 1), (2, 0)])
def test_a_side_follows_the_cursor(camera: sg.Camera, axis: int, end: int) -> None:
    """The handle of a face stays under the cursor while it moves along its axis, to whole voxels."""
    volume = sheared()
    (handle,) = [each for each in handles(ClipState(), volume) if (each.number, each.end) == (axis, end)]
    voxels = 2 if end == 0 else -2
    aim = handle.point + voxels * volume.world_from_index[:, axis]
    start, stop = project(camera, np.array([handle.point, aim]))
    assert handle_at(handles(ClipState(), volume), camera, tuple(start + 2.0)) is not None
    cuts = HandleDrag(handle, tuple(start), ClipState()).to(volume, camera, tuple(stop))
    assert cuts.sides[axis][end] == pytest.approx(end + voxels / volume.shape[2 - axis])
    (moved,) = [each for each in handles(cuts, volume) if (each.number, each.end) == (axis, end)]
    assert np.allclose(moved.point, aim)
    # never beyond the other side
    far = HandleDrag(handle, tuple(start), ClipState()).to(volume, camera, tuple(start + 50 * (stop - start)))
    assert far.sides[axis][0] < far.sides[axis][1]


@CAMERAS
def test_a_plane_follows_the_cursor(camera: sg.Camera) -> None:
    volume = sheared()
    normal = np.array([0.6, 0.0, 0.8])
    cuts = ClipState().with_plane(0, (*normal, float(normal @ volume.center)))
    foot = next(each for each in handles(cuts, volume) if each.what == "plane")
    start, stop = project(camera, np.array([foot.point, foot.point + 1.25 * normal]))
    moved = HandleDrag(foot, tuple(start), cuts).to(volume, camera, tuple(stop))
    assert moved.planes[0][:3] == cuts.planes[0][:3]
    assert moved.planes[0][3] - cuts.planes[0][3] == pytest.approx(1.25)
    # end on, upwards is away from the eye: a pixel is as long as it is wide at that depth
    axis = camera.forward
    for _ in range(30):
        # along the ray to its own foot
        away = ClipState().with_plane(0, (*axis, float(axis @ volume.center)))
        foot = next(each for each in handles(away, volume) if each.what == "plane")
        if camera.perspective:
            axis = (foot.point - camera.eye) / np.linalg.norm(foot.point - camera.eye)
    (start,) = project(camera, foot.point[None])
    moved = HandleDrag(foot, tuple(start), away).to(volume, camera, (start[0], start[1] - 10))
    depth = camera.eye_from_points(foot.point)[2]
    assert nearest_on_line(camera, tuple(start), foot.point, foot.axis) is None
    assert moved.planes[0][3] - away.planes[0][3] == pytest.approx(10 * camera.pixel_pitch(depth))


@CAMERAS
def test_an_arrow_points_where_its_tip_is_dragged(camera: sg.Camera) -> None:
    volume = sheared()
    normal = np.array([0.6, -0.64, 0.48])
    cuts = ClipState().with_plane(0, (*normal, float(normal @ volume.center)))
    foot, tip = (next(each for each in handles(cuts, volume) if each.what == what) for what in ("plane", "tilt"))
    wanted = np.array([0.7, -0.7, 0.1]) / np.linalg.norm([0.7, -0.7, 0.1])
    start, stop = project(camera, np.array([tip.point, foot.point + np.linalg.norm(tip.point - foot.point) * wanted]))
    turned = HandleDrag(tip, tuple(start), cuts).to(volume, camera, tuple(stop)).planes[0]
    assert np.allclose(turned[:3], wanted)
    # about its foot
    assert np.array(turned[:3]) @ foot.point == pytest.approx(turned[3])


def test_beside_the_sphere_is_its_rim() -> None:
    found = direction_on_sphere(ORTHOGRAPHIC, (119.0, 40.0), np.array([2.0, 3.0, 1.0]), 1.0, behind=False)
    assert np.allclose(found, ORTHOGRAPHIC.right, atol=0.05) and abs(found @ ORTHOGRAPHIC.forward) < 1e-9


def test_planes_cut_the_box_in_polygons() -> None:
    volume = sg.Volume(np.zeros((4, 4, 4), np.float32))
    square = outline(ClipState(), volume, (0.0, 0.0, 1.0, 1.0))
    assert np.allclose(sorted(map(tuple, square)), [(-0.5, -0.5, 1), (-0.5, 3.5, 1), (3.5, -0.5, 1), (3.5, 3.5, 1)])
    # in order around: no edge is a diagonal
    assert np.allclose(np.linalg.norm(square - np.roll(square, 1, axis=0), axis=1), 4.0)
    unit = np.full(3, 1 / np.sqrt(3))
    assert len(outline(ClipState(), volume, (*unit, float(unit @ [1.5, 1.5, 1.5])))) == 6
    assert len(outline(ClipState(), volume, (0.0, 0.0, 1.0, 9.0))) == 0
    # the handle of one that misses it is where it is nearest to the box's middle
    assert np.allclose(plane_middle(ClipState(planes=((0.0, 0.0, 1.0, 9.0),)), volume, 0), (1.5, 1.5, 9.0))


def test_keys_cut_and_undo(document: Document) -> None:
    state = State.of(document, SIZE)
    history = History(state)
    assert "nothing is cut" in acted(state, "cuts", document).message
    shown = acted(state, "handles", document)
    assert shown.cuts.shown and shown.settings is state.settings
    faced = acted(shown, "plane", document)
    assert faced.cuts.planes == faced.settings.clip
    assert np.allclose(faced.settings.clip[0][:3], state.pose.camera.forward)
    history.note(faced)
    off = acted(faced, "cuts", document)
    assert off.settings.clip == () and off.cuts.planes == faced.cuts.planes and history.has_unsaved_edits(faced)
    history.note(off)
    assert history.undo(off).settings.clip == faced.settings.clip
    assert acted(faced, "uncut", document).settings.clip == ()
    assert acted(faced, "uncut", document).cuts.sides == WHOLE
    # what would leave nothing is told and not done
    nothing = set_cuts(faced, document, faced.cuts.with_plane(0, (0.0, 0.0, 1.0, 99.0)))
    assert nothing.settings is faced.settings and "everything" in nothing.message
    many = faced
    for _ in range(12):
        many = add_plane(many, document, (0, 0, 1))
    assert len(many.settings.clip) == 10 and "remove one" in many.message


def test_a_cut_extracts_nothing(document: Document) -> None:
    state = acted(State.of(document, SIZE), "plane", document)
    assert document.with_styles(state.styles, (), state.settings) is document


def test_what_is_cut_off_is_not_picked(document: Document) -> None:
    state = State.of(document, SIZE)
    middle = (60.0, 40.0)
    whole = find_matter(document.layers[0].at(1), state.pose.camera, middle)
    state = acted(state, "plane", document)
    found = find_matter(document.layers[0].at(1), state.pose.camera, middle, state.settings.clip)
    assert whole is not None and found is not None
    # near the plane through the middle, farther away than the ball's front
    depths = [float(state.pose.camera.eye_from_points(point)[2]) for point in (whole, found)]
    assert depths[1] - depths[0] > 2.0


@pytest.mark.long
@pytest.mark.parametrize("classification", ["post", "pre"])
def test_cuts_are_saved(renderer: sg.Renderer, document: Document, tmp_path: Path, classification: str) -> None:
    """`splatgl render` of the saved scene gives the same picture, bit for bit, also after it was opened again."""
    state = State.of(document, SIZE)
    state = replace(state, settings=state.settings.replace(classification=classification))
    whole = renderer.render(
        document.for_settings(state.settings).layers[0].at(1), state.pose.camera, state.settings
    ).pixels
    state = acted(replace(state, pose=state.pose.rotated((3, 4), (50, 60))), "plane", document)
    state = set_cuts(state, document, state.cuts.with_side(2, 1, 10 / 16))
    document = document.with_styles(state.styles, (), state.settings)
    save_scene(state, document, renderer.render, tmp_path)
    given = ["render", str(tmp_path / "scene-001.toml"), "--backend", renderer.info.backend, "--quiet"]
    assert main([*given, "-o", str(tmp_path / "again.npy")]) == 0
    saved = np.load(tmp_path / "scene-001.npy")
    assert np.array_equal(saved, np.load(tmp_path / "again.npy")) and saved.max() > 0.1
    assert np.abs(saved - whole).max() > 0.1
    again = Document.open(SceneFile.from_toml(tmp_path / "scene-001.toml"))
    opened = State.of(again, SIZE)
    assert opened.settings.clip == state.settings.clip and len(opened.cuts.planes) == 1
    assert opened.cuts.sides[2][1] == pytest.approx(10 / 16)
