"""What the window shows over its picture: annotations, distances, the value under the cursor; and camera keys."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import splatgl as sg
from splatgl.annotations.text import beside, label
from splatgl.cli.main import main
from splatgl.data.color import linear_from_srgb
from splatgl.scene.scene_file import SceneFile
from splatgl.viewer.commands import TURN, acted, angles, name_of
from splatgl.viewer.document import Content
from splatgl.viewer.measure_tool import clicked, told, under_cursor
from splatgl.viewer.overlays import RULER, TIP, Legend, Scenery, cropped, of_ruler
from splatgl.viewer.saving import save_picture, save_scene, with_marks
from splatgl.viewer.state import Ruler, State
from splatgl.viewer.trackball import Mouse, Pose, seen, up_of

SIZE = (160, 120)
BLACK, USUAL = (0.0, 0.0, 0.0), ("scale", "axes")


@pytest.fixture
def content(tmp_path: Path) -> Content:
    """A block that is opaque from x = 8 on, with values that grow along z."""
    z, _, x = np.indices((16, 16, 16))
    np.save(tmp_path / "block.npy", np.float32(np.where(x >= 8, 100.0 + z, 0.0)))
    return Content.open(SceneFile(str(tmp_path / "block.npy"), transfer={"points": ((40.0, 0.0), (60.0, 0.99))}))


def along_x(content: Content) -> State:
    """Seen along +x, parallel: a pixel is a tenth of a voxel."""
    camera = sg.Camera.orthographic((-50.0, 7.5, 7.5), (7.5, 7.5, 7.5), (0, 0, 1), 12.0, SIZE)
    return replace(State.of(content, SIZE), pose=Pose(camera, content.middle, 40.0, content.reach))


def test_the_value_under_the_cursor(content: Content) -> None:
    state = along_x(content)
    # 3 voxels above the middle, in the ramp from 0 before the block to what it holds there
    found = under_cursor(state, content, (80.5, 29.5))
    assert found is not None
    assert found.value == pytest.approx((found.place[0] - 7) * (100 + found.place[2]), rel=1e-6)
    assert found.place[2] == pytest.approx(10.5, abs=0.06) and 7.0 < found.place[0] < 8.5
    assert told(found, content)[2].endswith(("10", "11")) and told(None, content) == ("nothing here",)
    assert under_cursor(state, content, (-1.0, 3.0)) is None
    # what is cut off is not there
    cut = replace(state, settings=state.settings.but(clip=[(1.0, 0.0, 0.0, 12.0)]))
    deeper = under_cursor(cut, content, (80.5, 29.5))
    assert deeper is not None and deeper.place[0] == pytest.approx(12.0, abs=0.3)


def test_a_distance_is_that_of_its_points(content: Content) -> None:
    state = acted(along_x(content), "measure", content)
    for place in ((50.5, 60.5), (110.5, 60.5)):
        state = clicked(state, content, place)
    # 60 pixels of a tenth of a voxel
    assert state.ruler.length == pytest.approx(6.0, abs=0.01) and "distance 6" in state.message
    strokes, labels = of_ruler(state.ruler, content, state.pose.camera, 1.0)
    assert np.allclose(sorted([strokes[0].start, strokes[0].stop]), [(50.5, 60.5), (110.5, 60.5)], atol=1e-6)
    assert labels[0].place[0] > 110 and labels[0].pixels[..., :3].max() == 255
    # a third point begins anew; the key ends, then removes it
    assert len(clicked(state, content, (80.5, 50.5)).ruler.points) == 1
    ended = acted(state, "measure", content)
    assert not ended.ruler.active and ended.ruler.length
    assert acted(ended, "measure", content).ruler == Ruler()


@pytest.mark.parametrize("blend", ["composite", "xray"])
def test_a_distance_is_saved(content: Content, blend: str) -> None:
    """Line, dots and length, where the window shows them, as light as there."""
    state = along_x(content)
    # through the middle of pixels, of a tenth of a voxel
    points = tuple((8.0, 7.45 - 3 * side, 7.45) for side in (-1, 1))
    strokes, labels = of_ruler(Ruler(points), content, state.pose.camera, 1.0)
    picture = sg.Image(np.full((SIZE[1], SIZE[0], 4), 0.1, np.float32), {"blend": blend})
    picture.pixels[0, 0] = 0.25
    found = with_marks(picture, strokes, labels).pixels
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
    assert beside((10.0, 10.0), (50, 20), (100, 100), 5.0) == (15, 15, 65, 35)
    assert beside((90.0, 95.0), (50, 20), (100, 100), 5.0) == (35, 70, 85, 90)
    assert label(("a",)) is label(("a",)) and label(("a", "b")).shape[0] > label(("a",)).shape[0]


def scenery(content: Content, state: State, **changes: object) -> Scenery:
    camera = state.pose.camera
    found = Scenery(state.annotate, content.volume, state.transfer, camera, "composite", BLACK)
    return replace(found, **changes)


def test_what_has_not_changed_is_not_drawn_again(content: Content) -> None:
    legend, state = Legend(), along_x(content)
    asked = ("scale", "axes")
    first = legend.sprites(scenery(content, state, asked=asked))
    assert legend.sprites(scenery(content, state, asked=asked)) is first and len(first) == 2
    # of the picture's size, they are what is not clear of the whole
    left = min(each.place[0] for each in first)
    assert left < 20 and all(each.pixels[..., 3].any() for each in first)
    turned = replace(state, pose=state.pose.spun(20.0, up_of(content)))
    assert legend.sprites(scenery(content, turned, asked=asked)) is not first
    assert legend.sprites(scenery(content, state, asked=())) == ()


def test_sprites_are_what_is_not_clear() -> None:
    pixels = np.zeros((100, 120, 4), np.uint8)
    pixels[3:8, 10:14] = pixels[3:5, 20:30] = pixels[80:90, 100:120] = pixels[82, 5] = 255
    again = np.zeros_like(pixels)
    for each in cropped(pixels):
        left, top, right, bottom = map(int, each.place)
        again[top:bottom, left:right] = each.pixels
    assert np.array_equal(again, pixels)
    assert [each.place for each in cropped(pixels)] == [(10, 3, 30, 8), (5, 80, 6, 90), (100, 80, 120, 90)]


def test_annotations_are_saved(renderer: sg.Renderer, content: Content, tmp_path: Path) -> None:
    """What is seen: the picture and `render` of the saved scene have them, bit for bit, and without them by the key."""
    state = State.of(content, SIZE)
    assert state.annotate == USUAL
    save_picture(state, content, renderer.render, tmp_path)
    save_scene(state, content, renderer.render, tmp_path)
    bare = acted(state, "annotations", content)
    save_picture(bare, content, renderer.render, tmp_path)
    given = ["render", str(tmp_path / "scene-001.toml"), "--backend", renderer.info.backend, "--quiet"]
    for suffix in ("npy", "png"):
        assert main([*given, "-o", str(tmp_path / f"again.{suffix}")]) == 0
    assert np.array_equal(np.load(tmp_path / "scene-001.npy"), np.load(tmp_path / "again.npy"))
    names = ("picture-001", "picture-002", "again")
    one, two, again = (sg.Image.load(tmp_path / f"{name}.png").pixels for name in names)
    assert np.array_equal(one, again) and not np.array_equal(one, two)
    assert "annotate" in (tmp_path / "scene-001.toml").read_text() and not bare.annotate
    opened = State.of(Content.open(SceneFile.from_toml(tmp_path / "scene-001.toml")), SIZE)
    assert opened.annotate == USUAL
    # a window that is too small for them
    small = replace(state, pose=state.pose.resized((80, 60)))
    save_picture(small, content, renderer.render, tmp_path)


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


def test_keys_turn_zoom_and_roll(content: Content) -> None:
    state = State.of(content, SIZE)
    for there, back in (("turn-left", "turn-right"), ("turn-up", "turn-down"), ("zoom-in", "zoom-out")):
        moved = acted(state, there, content)
        assert not np.allclose(moved.pose.camera.eye, state.pose.camera.eye)
        assert np.allclose(acted(moved, back, content).pose.camera.eye, state.pose.camera.eye)
    angle = np.degrees(np.arccos(acted(state, "turn-up", content).pose.camera.forward @ state.pose.camera.forward))
    assert angle == pytest.approx(TURN)
    # the middle stays in the middle
    (place,) = seen(acted(state, "roll-left", content).pose.camera, state.pose.pivot[None])
    assert np.allclose(place, seen(state.pose.camera, state.pose.pivot[None])[0])
    rolled = acted(acted(state, "roll-left", content), "roll-right", content)
    assert np.allclose(rolled.pose.camera.eye_from_world, state.pose.camera.eye_from_world)


def test_a_turntable_keeps_up_upright(content: Content) -> None:
    state = acted(State.of(content, SIZE), "turntable", content)
    up = up_of(content)
    mouse = Mouse().press("left", (), (40.0, 40.0), state.pose, 0.0)
    assert mouse.drag is not None
    drag = replace(mouse.drag, up=up)
    for stop in ((90.0, 40.0), (60.0, 90.0), (40.0, 400.0), (10.0, -400.0)):
        camera = drag.to(stop).camera
        # the picture's rows are level, and up is never down
        assert abs(camera.right @ up) < 1e-9 and camera.eye_from_world[1] @ up < 0
    lowered = drag.to((40.0, 10.0)).camera
    assert lowered.forward @ up > state.pose.camera.forward @ up


def test_grounds_and_lights(content: Content) -> None:
    state, seen_grounds = State.of(content, SIZE), []
    for _ in range(5):
        state = acted(state, "ground", content)
        seen_grounds.append(state.message)
    assert seen_grounds == ["on white", "on checks", "on grey", "on blue", "on black"]
    assert state.settings.background is None and state.ground == "black"
    grey = acted(acted(acted(state, "ground", content), "ground", content), "ground", content)
    assert grey.settings.background == pytest.approx((0.214,) * 3, abs=1e-3)
    lights = []
    for _ in range(4):
        state = acted(state, "light", content)
        lights.append(state.settings.light)
    assert lights == ["matte", "glossy", "flat", "head"]
