"""What the window shows over its picture: annotations, distances, the value under the cursor; and camera keys."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import splatgl as sg
from splatgl.annotations.text import label, place_label
from splatgl.cli.main import main
from splatgl.data.color import linear_from_srgb
from splatgl.scene.scene_file import SceneFile
from splatgl.viewer.commands import TURN, angles, name_of
from splatgl.viewer.document import Document
from splatgl.viewer.measure_tool import add_ruler_point, describe_pick, under_cursor
from splatgl.viewer.overlays import RULER, TIP, AnnotationInputs, Legend, crop_sprites, ruler_marks
from splatgl.viewer.saving import draw_marks, save_picture, save_scene
from splatgl.viewer.state import Ruler, State
from splatgl.viewer.trackball import Mouse, Pose, project, up_direction
from tests.helpers.commands import acted

SIZE = (160, 120)
BLACK, USUAL = (0.0, 0.0, 0.0), ("scale", "axes")


@pytest.fixture
def document(tmp_path: Path) -> Document:
    """A block that is opaque from x = 8 on, with values that grow along z."""
    z, _, x = np.indices((16, 16, 16))
    np.save(tmp_path / "block.npy", np.float32(np.where(x >= 8, 100.0 + z, 0.0)))
    return Document.open(SceneFile(str(tmp_path / "block.npy"), transfer={"points": ((40.0, 0.0), (60.0, 0.99))}))


def along_x(document: Document) -> State:
    """Seen along +x, parallel: a pixel is a tenth of a voxel."""
    camera = sg.Camera.orthographic((-50.0, 7.5, 7.5), (7.5, 7.5, 7.5), (0, 0, 1), 12.0, SIZE)
    return replace(State.of(document, SIZE), pose=Pose(camera, document.middle, 40.0, document.reach))


def test_the_value_under_the_cursor(document: Document) -> None:
    state = along_x(document)
    # 3 voxels above the middle, in the ramp from 0 before the block to what it holds there
    found = under_cursor(state, document, (80.5, 29.5))
    assert found is not None
    assert found.value == pytest.approx((found.place[0] - 7) * (100 + found.place[2]), rel=1e-6)
    assert found.place[2] == pytest.approx(10.5, abs=0.06) and 7.0 < found.place[0] < 8.5
    assert describe_pick(found, document)[2].endswith(("10", "11")) and describe_pick(None, document) == (
        "nothing here",
    )
    assert under_cursor(state, document, (-1.0, 3.0)) is None
    # what is cut off is not there
    cut = replace(state, settings=state.settings.but(clip=[(1.0, 0.0, 0.0, 12.0)]))
    deeper = under_cursor(cut, document, (80.5, 29.5))
    assert deeper is not None and deeper.place[0] == pytest.approx(12.0, abs=0.3)


def test_clouds_of_points_have_no_value_there(tmp_path: Path) -> None:
    """Points that are seen aren't called nothing."""
    np.savetxt(tmp_path / "p.txt", np.eye(3), fmt="%g")
    head = "ply\nformat ascii 1.0\nelement vertex 3\n" + "".join(f"property float {axis}\n" for axis in "xyz")
    (tmp_path / "a.ply").write_text(f"{head}end_header\n{(tmp_path / 'p.txt').read_text()}")
    document = Document.open(SceneFile(str(tmp_path / "a.ply")))
    state = State.of(document, SIZE)
    found = under_cursor(state, document, (80, 60))
    assert describe_pick(found, document) == ("points: no value or place here",)
    assert add_ruler_point(state, document, (80, 60)).message == "points: no value or place here to measure from"


def test_a_distance_is_that_of_its_points(document: Document) -> None:
    state = acted(along_x(document), "measure", document)
    for place in ((50.5, 60.5), (110.5, 60.5)):
        state = add_ruler_point(state, document, place)
    # 60 pixels of a tenth of a voxel
    assert state.ruler.length == pytest.approx(6.0, abs=0.01) and "distance 6" in state.message
    strokes, labels = ruler_marks(state.ruler, document, state.pose.camera, 1.0)
    assert np.allclose(sorted([strokes[0].start, strokes[0].stop]), [(50.5, 60.5), (110.5, 60.5)], atol=1e-6)
    assert labels[0].place[0] > 110 and labels[0].pixels[..., :3].max() == 255
    # a third point begins anew; the key ends, then removes it
    assert len(add_ruler_point(state, document, (80.5, 50.5)).ruler.points) == 1
    ended = acted(state, "measure", document)
    assert not ended.ruler.active and ended.ruler.length
    assert acted(ended, "measure", document).ruler == Ruler()


@pytest.mark.parametrize("blend", ["composite", "xray"])
def test_a_distance_is_saved(document: Document, blend: str) -> None:
    """Line, dots and length, where the window shows them, as light as there."""
    state = along_x(document)
    # through the middle of pixels, of a tenth of a voxel
    points = tuple((8.0, 7.45 - 3 * side, 7.45) for side in (-1, 1))
    strokes, labels = ruler_marks(Ruler(points), document, state.pose.camera, 1.0)
    picture = sg.Image(np.full((SIZE[1], SIZE[0], 4), 0.1, np.float32), {"blend": blend})
    picture.pixels[0, 0] = 0.25
    found = draw_marks(picture, strokes, labels).pixels
    one = 0.25 if blend == "xray" else 1.0
    marked = np.abs(found - picture.pixels).max(axis=2) > 0
    color = one * linear_from_srgb(np.array(RULER[:3]))
    for x, y in (strokes[0].start, strokes[0].stop, np.mean([strokes[0].start, strokes[0].stop], axis=0)):
        assert np.allclose(found[int(y), int(x), :3], color, atol=0.01), (x, y)
    # a dot is round: what it covers beside its corners
    x, y = (int(each) for each in strokes[1].start)
    reach = int(TIP / 2 + 1)
    assert marked[y - reach : y + reach + 1, x].all() and not marked[y - reach - 1, x - reach - 1]
    left, top, right, bottom = map(int, labels[0].place)
    assert marked[top:bottom, left:right].all() and found[top:bottom, left:right, :3].max() == pytest.approx(one)


def test_labels_stay_in_the_window() -> None:
    assert place_label((10.0, 10.0), (50, 20), (100, 100), 5.0) == (15, 15, 65, 35)
    assert place_label((90.0, 95.0), (50, 20), (100, 100), 5.0) == (35, 70, 85, 90)
    assert label(("a",)) is label(("a",)) and label(("a", "b")).shape[0] > label(("a",)).shape[0]


def scenery(document: Document, state: State, **changes: object) -> AnnotationInputs:
    camera = state.pose.camera
    found = AnnotationInputs(state.annotate, document.volume, state.style.stated, camera, "composite", BLACK)
    return replace(found, **changes)


def test_what_has_not_changed_is_not_drawn_again(document: Document) -> None:
    legend, state = Legend(), along_x(document)
    asked = ("scale", "axes")
    first = legend.sprites(scenery(document, state, names=asked))
    assert legend.sprites(scenery(document, state, names=asked)) is first and len(first) == 2
    # of the picture's size, they are what is not clear of the whole
    left = min(each.place[0] for each in first)
    assert left < 20 and all(each.pixels[..., 3].any() for each in first)
    turned = replace(state, pose=state.pose.spun(20.0, up_direction(document)))
    assert legend.sprites(scenery(document, turned, names=asked)) is not first
    assert legend.sprites(scenery(document, state, names=())) == ()


def test_sprites_are_what_is_not_clear() -> None:
    pixels = np.zeros((100, 120, 4), np.uint8)
    pixels[3:8, 10:14] = pixels[3:5, 20:30] = pixels[80:90, 100:120] = pixels[82, 5] = 255
    again = np.zeros_like(pixels)
    for each in crop_sprites(pixels):
        left, top, right, bottom = map(int, each.place)
        again[top:bottom, left:right] = each.pixels
    assert np.array_equal(again, pixels)
    assert [each.place for each in crop_sprites(pixels)] == [(10, 3, 30, 8), (5, 80, 6, 90), (100, 80, 120, 90)]


def test_annotations_are_saved(renderer: sg.Renderer, document: Document, tmp_path: Path) -> None:
    """What is seen: the picture and `render` of the saved scene have them, bit for bit, and without them by the key."""
    state = State.of(document, SIZE)
    assert state.annotate == USUAL
    save_picture(state, document, renderer.render, tmp_path)
    save_scene(state, document, renderer.render, tmp_path)
    bare = acted(state, "annotations", document)
    save_picture(bare, document, renderer.render, tmp_path)
    given = ["render", str(tmp_path / "scene-001.toml"), "--backend", renderer.info.backend, "--quiet"]
    for suffix in ("npy", "png"):
        assert main([*given, "-o", str(tmp_path / f"again.{suffix}")]) == 0
    assert np.array_equal(np.load(tmp_path / "scene-001.npy"), np.load(tmp_path / "again.npy"))
    names = ("picture-001", "picture-002", "again")
    one, two, again = (sg.Image.load(tmp_path / f"{name}.png").pixels for name in names)
    assert np.array_equal(one, again) and not np.array_equal(one, two)
    assert "annotate" in (tmp_path / "scene-001.toml").read_text() and not bare.annotate
    opened = State.of(Document.open(SceneFile.from_toml(tmp_path / "scene-001.toml")), SIZE)
    assert opened.annotate == USUAL
    # a window that is too small for them
    small = replace(state, pose=state.pose.resized((80, 60)))
    save_picture(small, document, renderer.render, tmp_path)


@pytest.mark.parametrize(
    ("frame", "view", "eye"),
    [
        (None, "right", (1, 0, 0)),
        (None, "front", (0, -1, 0)),
        ("LPS", "front", (0, -1, 0)),
        ("LPS", "right", (-1, 0, 0)),
        ("LPS", "left", (1, 0, 0)),
        ("RAS", "front", (0, 1, 0)),
        ("RAS", "right", (1, 0, 0)),
        ("RAS", "back", (0, -1, 0)),
        ("RAS", "top", (0, 0, 1)),
    ],
)
def test_standard_views_are_those_of_the_patient(frame: str | None, view: str, eye: tuple[int, ...]) -> None:
    volume = sg.Volume(np.ones((4, 4, 4), np.float32), frame=frame)
    camera = sg.Camera.orbit(volume, *angles(view, frame))
    assert np.allclose(-camera.forward, eye, atol=1e-9)
    # ParaView names the direction of the view
    if frame is None:
        name = name_of(view, None)
        assert camera.forward["XYZ".index(name[-1])] == pytest.approx(1.0 if name[-2] == "+" else -1.0)


def test_keys_turn_zoom_and_roll(document: Document) -> None:
    state = State.of(document, SIZE)
    for there, back in (("turn-left", "turn-right"), ("turn-up", "turn-down"), ("zoom-in", "zoom-out")):
        moved = acted(state, there, document)
        assert not np.allclose(moved.pose.camera.eye, state.pose.camera.eye)
        assert np.allclose(acted(moved, back, document).pose.camera.eye, state.pose.camera.eye)
    angle = np.degrees(np.arccos(acted(state, "turn-up", document).pose.camera.forward @ state.pose.camera.forward))
    assert angle == pytest.approx(TURN)
    # the middle stays in the middle
    (place,) = project(acted(state, "roll-left", document).pose.camera, state.pose.pivot[None])
    assert np.allclose(place, project(state.pose.camera, state.pose.pivot[None])[0])
    rolled = acted(acted(state, "roll-left", document), "roll-right", document)
    assert np.allclose(rolled.pose.camera.eye_from_world, state.pose.camera.eye_from_world)


def test_a_turntable_keeps_up_upright(document: Document) -> None:
    state = acted(State.of(document, SIZE), "turntable", document)
    up = up_direction(document)
    mouse = Mouse().press("left", (), (40.0, 40.0), state.pose, 0.0)
    assert mouse.drag is not None
    drag = replace(mouse.drag, up=up)
    for stop in ((90.0, 40.0), (60.0, 90.0), (40.0, 400.0), (10.0, -400.0)):
        camera = drag.to(stop).camera
        # the picture's rows are level, and up is never down
        assert abs(camera.right @ up) < 1e-9 and camera.eye_from_world[1] @ up < 0
    lowered = drag.to((40.0, 10.0)).camera
    assert lowered.forward @ up > state.pose.camera.forward @ up


def test_grounds_and_lights(document: Document) -> None:
    state, seen_grounds = State.of(document, SIZE), []
    for _ in range(5):
        state = acted(state, "ground", document)
        seen_grounds.append(state.message)
    assert seen_grounds == ["on white", "on checks", "on grey", "on blue", "on black"]
    assert state.settings.background is None and state.ground == "black"
    grey = acted(acted(acted(state, "ground", document), "ground", document), "ground", document)
    assert grey.settings.background == pytest.approx((0.214,) * 3, abs=1e-3)
    lights = []
    for _ in range(4):
        state = acted(state, "light", document)
        lights.append(state.settings.light)
    assert lights == ["matte", "glossy", "flat", "head"]
