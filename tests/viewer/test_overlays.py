"""What the window shows over its picture: annotations, distances, the value under the cursor; and camera keys."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import splatgl as sg
from splatgl.annotations.canvas import AnnotatedSubject
from splatgl.annotations.text import Overlay, Text, draw_overlay, label, place_label, text_box
from splatgl.annotations.world_lines import measure_text
from splatgl.cli.main import main
from splatgl.data.color import linear_from_srgb
from splatgl.errors import InputError, InputWarning
from splatgl.reference.depth_pick import Picked
from splatgl.scene.scene_file import SceneFile
from splatgl.scene.view import angles
from splatgl.viewer.commands import TURN, Copy, name_of, with_settings
from splatgl.viewer.document import Document
from splatgl.viewer.hud import RULER, TIP, Overlays, crop_sprites, is_light, readout_label, ruler_marks
from splatgl.viewer.jobs import Jobs
from splatgl.viewer.measure_tool import Readout, add_ruler_point, describe_pick, under_cursor
from splatgl.viewer.saving import copy_text, draw_strokes, save_picture, save_scene
from splatgl.viewer.state import EDITS, History, Ruler, State, changed_fields, played
from splatgl.viewer.trackball import Mouse, Pose, project, up_direction
from tests.helpers.commands import acted

pytestmark = pytest.mark.usefixtures("shared_programs")

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
    cut = replace(state, settings=state.settings.replace(clip=[(1.0, 0.0, 0.0, 12.0)]))
    deeper = under_cursor(cut, document, (80.5, 29.5))
    assert deeper is not None and deeper.place[0] == pytest.approx(12.0, abs=0.3)


def test_voxels_of_colours_are_read_with_them(tmp_path: Path) -> None:
    """Positions that round to zero have no sign; outside of the outermost centres, voxels are the outermost."""
    colors = np.zeros((3, 4, 5, 3), np.uint8)
    colors[0, 0, 4] = 10, 20, 30
    np.save(tmp_path / "rgb.npy", colors)
    with pytest.warns(InputWarning):
        document = Document.open(SceneFile(str(tmp_path / "rgb.npy")))
    lines = describe_pick(Picked((4.5, -0.0, -0.2), (4.5, -0.0, -0.2), 20.0, 1.0, "rgb", 0), document)
    assert lines == ("value: 20 of rgb 10, 20, 30", "at 4.5, 0, -0.2", "voxel 4, 0, 0")


def test_the_cursor_is_read_in_a_thread(document: Document) -> None:
    """Once for each pixel; nothing beyond the picture."""
    readout, state = Readout(Jobs(lambda: None)), along_x(document)
    readout.look(state, document, (80.5, 29.5))
    readout.look(state, document, (10.5, 20.5))
    assert readout.jobs.wait(60.0) and readout.collect(document)
    assert readout.lines == describe_pick(under_cursor(state, document, (80.5, 29.5)), document)
    assert readout.lines[0].startswith("value: ") and readout.lines[1].startswith("at 7.")
    readout.look(state, document, (80.9, 29.1))
    assert not readout.jobs.all and not readout.collect(document)
    (shown,) = readout_label(readout.lines, 40, 200.0, 1.0, False)
    assert shown.place[1] > 40 and readout_label(readout.lines, 40, 20.0, 1.0, False) == ()
    readout.look(state, document, None)
    assert readout.lines == readout_label(readout.lines, 40, 200.0, 1.0, False) == ()


def test_clouds_of_points_have_no_value_there(tmp_path: Path) -> None:
    """Points that are seen aren't called nothing."""
    np.savetxt(tmp_path / "p.txt", np.eye(3), fmt="%g")
    head = "ply\nformat ascii 1.0\nelement vertex 3\n" + "".join(f"property float {axis}\n" for axis in "xyz")
    (tmp_path / "a.ply").write_text(f"{head}end_header\n{(tmp_path / 'p.txt').read_text()}")
    document = Document.open(SceneFile(str(tmp_path / "a.ply")))
    state = State.of(document, SIZE)
    found = under_cursor(state, document, (80, 60))
    assert describe_pick(found, document) == ("points: no value or position here",)
    assert add_ruler_point(state, document, (80, 60)).message == "points: no value or position here to measure from"


def measured(state: State, name: str, document: Document, *places: tuple[float, float]) -> State:
    state = acted(state, name, document)
    for place in places:
        state = add_ruler_point(state, document, place)
    return state


def test_measures_are_those_of_their_points(document: Document) -> None:
    """One after the other, until the key ends it; undone, and hidden once all are removed."""
    state = measured(along_x(document), "measure", document, (50.5, 60.5), (110.5, 60.5))
    # 60 pixels of a tenth of a voxel
    subject = replace(AnnotatedSubject.of(document.volume), unit="mm")
    assert measure_text(state.measures[0], subject) == "6 mm" and state.message == "distance 6 voxels"
    assert state.ruler.active and not state.ruler.points and state.annotate[-1] == "measures"
    begun = add_ruler_point(state, document, (80.5, 50.5))
    strokes = ruler_marks(begun.ruler, state.pose.camera, 1.0)
    assert len(begun.ruler.points) == 1 and np.allclose(strokes[0].start, (80.5, 50.5), atol=1e-6)
    state = measured(begun, "angle", document, (50.5, 60.5), (80.5, 60.5), (110.5, 90.5))
    assert state.message == "angle 135°" and len(state.measures) == 2
    assert not acted(state, "angle", document).ruler.active
    assert "measures" not in state.with_measures(()).annotate
    history = History(begun)
    history.note(state)
    assert history.undo(state).measures == begun.measures
    assert changed_fields(state, begun) & EDITS


def test_measures_are_saved_with_the_scene_and_drawn(
    document: Document, renderer: sg.Renderer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The saved picture has them, and so has that of the scene file and of the copied one, bit for bit."""
    state = measured(along_x(document), "angle", document, (50.5, 60.5), (80.5, 60.5), (110.5, 90.5))
    state = measured(state, "measure", document, (60.5, 30.5), (110.5, 30.5))
    state = replace(
        state.with_measures((state.measures[0], replace(state.measures[1], name="wall"))), annotate=("measures",)
    )
    monkeypatch.chdir(tmp_path)
    save_picture(state, document, renderer.render, tmp_path)
    copied = tmp_path / "copied.toml"
    copied.write_text(copy_text(Copy.SCENE, state, document))
    assert SceneFile.from_toml(copied).measures == state.measures
    assert State.of(Document.open(SceneFile.from_toml(copied)), SIZE).measures == state.measures
    assert main(["render", str(copied), "-o", "again.png", "--backend", "egl", "--quiet"]) == 0
    shown, again = (sg.Image.load(tmp_path / name) for name in ("picture-001.png", "again.png"))
    assert np.array_equal(shown.pixels, again.pixels) and shown.info["annotated"] == ["measures"]
    assert not shown.info["not_annotated"]
    save_picture(state.with_measures(()), document, renderer.render, tmp_path)
    marked = np.abs(shown.pixels - sg.Image.load(tmp_path / "picture-002.png").pixels).max(axis=2) > 0.1
    # on the lines, and not beside them
    assert all(marked[y, x] for x, y in ((65, 60), (95, 75), (85, 30))) and not marked[110:].any()
    for text in (
        "points = [[0, 0, 0]]",
        "point = 3",
        'points = [[0, 0, "a"], [1, 1, 1]]',
        "points = [[0,0,0],[1,1,1]]\nname = 3",
    ):
        copied.write_text(f'volume = "block.npy"\n[[measure]]\n{text}\n')
        with pytest.raises(InputError, match=r"\[\[measure\]\] 1"):
            SceneFile.from_toml(copied)


def test_a_series_plays_once_or_again(document: Document) -> None:
    state = replace(along_x(document), times=3, time=2, playing=True)
    assert played(state).time == 0 and played(state).playing
    ended = played(replace(state, repeats=False))
    assert ended.time == 2 and not ended.playing and acted(ended, "play", document).time == 0
    assert played(replace(state, time=0, repeats=False)).time == 1


@pytest.mark.parametrize("blend", ["composite", "xray"])
def test_marks_are_saved(document: Document, blend: str) -> None:
    """Line and dots, where the window shows them, as light as there."""
    state = along_x(document)
    # through the middle of pixels, of a tenth of a voxel
    points = tuple((8.0, 7.45 - 3 * side, 7.45) for side in (-1, 1))
    strokes = ruler_marks(Ruler(points), state.pose.camera, 1.0)
    picture = sg.Image(np.full((SIZE[1], SIZE[0], 4), 0.1, np.float32), {"blend": blend})
    picture.pixels[0, 0] = 0.25
    found = draw_strokes(picture, strokes).pixels
    one = 0.25 if blend == "xray" else 1.0
    marked = np.abs(found - picture.pixels).max(axis=2) > 0
    color = one * linear_from_srgb(np.array(RULER[:3]))
    for x, y in (strokes[0].start, strokes[0].stop, np.mean([strokes[0].start, strokes[0].stop], axis=0)):
        assert np.allclose(found[int(y), int(x), :3], color, atol=0.01), (x, y)
    # a dot is round: what it covers beside its corners
    x, y = (int(each) for each in strokes[1].start)
    reach = int(TIP / 2 + 1)
    assert marked[y - reach : y + reach + 1, x].all() and not marked[y - reach - 1, x - reach - 1]


def test_labels_stay_in_the_window() -> None:
    assert place_label((10.0, 10.0), (50, 20), (100, 100), 5.0) == (15, 15, 65, 35)
    assert place_label((90.0, 95.0), (50, 20), (100, 100), 5.0) == (35, 70, 85, 90)
    assert label(("a",)) is label(("a",)) and label(("a", "b")).shape[0] > label(("a",)).shape[0]


def test_texts_suit_the_background(document: Document) -> None:
    """Labels look as the text in the corner does: dark letters on white where the picture is light."""
    text, state = Text(("value: 3",)), State.of(document, SIZE)
    state = replace(state, settings=state.settings.replace(background=None))
    for ground, light in (("black", False), ("white", True), ("checks", False)):
        assert is_light(replace(state, ground=ground)) is light
        left, top, right, bottom = text_box(text, SIZE, 2.0)
        corner = draw_overlay(Overlay(SIZE, 2.0, (text,), light=light))[top:bottom, left:right]
        assert np.array_equal(label(text.lines, 2.0, light), corner)
        letters, paper = corner[corner[..., 3] == 255], corner[0, 0]
        assert (int(letters[..., :3].mean()) < int(paper[:3].mean())) is light
    blue = replace(state, settings=state.settings.replace(background=(0.0, 0.0, 0.2)))
    assert not is_light(replace(blue, ground="white"))


def test_what_has_not_changed_is_not_drawn_again(document: Document) -> None:
    overlays, state = Overlays(), replace(along_x(document), annotate=("scale", "axes"))
    first = overlays.annotations(state, document)
    assert overlays.annotations(replace(state), document) is first and len(first) == 2
    # of the picture's size, they are what is not clear of the whole
    left = min(each.place[0] for each in first)
    assert left < 20 and all(each.pixels[..., 3].any() for each in first)
    turned = replace(state, pose=state.pose.spun(20.0, up_direction(document)))
    assert overlays.annotations(turned, document) is not first
    assert overlays.annotations(replace(state, annotate=()), document) == ()
    # beside the information on the frame, at its corner without it
    time = replace(state, pose=state.pose.resized((320, 240)), annotate=("time=3 h",))
    (beside,), (corner,) = (overlays.annotations(replace(time, hud=hud), document) for hud in ("short", "off"))
    assert min(corner.place[:2]) >= 0 and corner.place[0] < 40 > corner.place[1] and beside.place[0] > 200


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
    camera = sg.Camera.orbit(volume, *angles(view, volume))
    assert np.allclose(-camera.forward, eye, atol=1e-9)
    # ParaView names the direction of the view
    if frame is None:
        name = name_of(view, volume)
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
    # of surfaces, which stand on white; values along rays do not, and sums have none
    for blend, right in (("mip", (0.0, 0.0, 0.0)), ("xray", None), ("composite", (1.0, 1.0, 1.0))):
        state = with_settings(state, document, state.settings.replace(blend=blend))
        assert state.settings.background == right
    state = acted(replace(state, settings=state.settings.replace(background=(0.0, 0.0, 0.2))), "ground", document)
    assert state.message == "on black"
    for _ in range(5):
        state = acted(state, "ground", document)
        seen_grounds.append(state.message)
    assert seen_grounds == ["on white", "on checks", "on grey", "on blue", "on black"]
    # which a saved picture has, too
    assert state.settings.background == (0.0, 0.0, 0.0) and state.ground == "black"
    assert acted(acted(state, "ground", document), "ground", document).settings.background is None
    grey = acted(acted(acted(state, "ground", document), "ground", document), "ground", document)
    assert grey.settings.background == pytest.approx((0.214,) * 3, abs=1e-3)
    lights = []
    for _ in range(4):
        state = acted(state, "light", document)
        lights.append(state.settings.light)
    assert lights == ["matte", "glossy", "flat", "head"]
