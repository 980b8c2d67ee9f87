"""The window's logic without a window: moves, bindings, pacing, refinement, coarse volumes, saved scenes."""

from __future__ import annotations

import threading
import time
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import cast

import numpy as np
import pytest

import splatgl as sg
from splatgl.annotations.text import Overlay, Text, draw_overlay, plain
from splatgl.cli.main import main
from splatgl.data.volume import halve_volume
from splatgl.gl.screen import Screen
from splatgl.planning.culling import eye_is_outside, visible_shell
from splatgl.scene.scene_file import SceneFile
from splatgl.scene.view import ViewOptions
from splatgl.splat.settings import BLENDS, Settings
from splatgl.transfer.statistics import statistics
from splatgl.viewer import hud, transfer_editor
from splatgl.viewer.adaptive_quality import FULL, LADDER, STRIDES, InputTiming, PreviewLevel, PreviewPace, Refiner
from splatgl.viewer.commands import COMMANDS
from splatgl.viewer.document import Document
from splatgl.viewer.files import Watch, watched_files
from splatgl.viewer.frame_renderer import MOMENTS, SHARE, TINT, FrameRenderer, plane_section, share_beyond, tint_splats
from splatgl.viewer.input import from_character, from_key, keymap, list_bindings, load_bindings, normalize_key, rebind
from splatgl.viewer.jobs import JobKind, Jobs
from splatgl.viewer.layer_splats import LayerSplats
from splatgl.viewer.measure_tool import find_matter
from splatgl.viewer.reference_view import resize_bilinear
from splatgl.viewer.saving import free_path, render_scene, save_picture, save_scene, scene_of
from splatgl.viewer.state import History, LayerStyle, State, scale_opacity
from splatgl.viewer.trackball import Mouse, Pose, zoom_by_wheel
from tests.helpers.blobs import LONGEST, SIZE, blob
from tests.helpers.commands import acted

pytestmark = pytest.mark.usefixtures("shared_programs")


@pytest.fixture
def scene(tmp_path: Path) -> SceneFile:
    np.save(tmp_path / "blob.npy", blob().samples)
    return SceneFile(str(tmp_path / "blob.npy"), transfer={"points": ((4.0, 0.0), (30.0, 0.6)), "colormap": "hot"})


@pytest.fixture
def pose() -> Pose:
    camera = sg.Camera.look_at((1.0, -30.0, 4.0), (2.0, 3.0, 1.0), (0, 0, 1), 40.0, SIZE)
    return Pose(camera, np.array([2.0, 3.0, 1.0]), 40.0, 10.0)


def seen(pose: Pose, point: np.ndarray) -> np.ndarray:
    """Where a world point is in the picture, pixels."""
    x, y, z = pose.camera.eye_from_points(point)
    pitch = pose.camera.pixel_pitch(z)
    return np.array([x / pitch, y / pitch]) + np.array(pose.camera.size) / 2


# --- camera moves -------------------------------------------------------------------------------------------------


def test_a_rotation_keeps_the_pivot_where_it_is(pose: Pose) -> None:
    turned = pose.rotated((60.0, 40.0), (83.0, 21.0))
    assert np.allclose(seen(turned, pose.pivot), seen(pose, pose.pivot), atol=1e-9)
    assert np.allclose(turned.camera.eye_from_world @ turned.camera.eye_from_world.T, np.eye(3), atol=1e-12)
    assert np.linalg.norm(turned.camera.eye - pose.camera.eye) > 1.0


def test_what_faces_the_eye_follows_the_cursor(pose: Pose) -> None:
    """Dragged to the right, the front goes to the right; downwards, down."""
    front = pose.pivot - pose.camera.forward
    right, down = pose.rotated((60, 40), (70, 40)), pose.rotated((60, 40), (60, 50))
    to_right, to_down = seen(right, front) - seen(pose, front), seen(down, front) - seen(pose, front)
    assert to_right[0] > 0.5 and abs(to_right[1]) < 0.5
    assert to_down[1] > 0.5 and abs(to_down[0]) < 0.5


def test_a_rotation_goes_back_the_way_it_came(pose: Pose) -> None:
    there = pose.rotated((20.0, 11.0), (90.0, 70.0)).rotated((90.0, 70.0), (20.0, 11.0))
    assert np.allclose(there.camera.eye_from_world, pose.camera.eye_from_world, atol=1e-12)
    assert np.allclose(there.camera.eye, pose.camera.eye, atol=1e-9)


def test_ten_thousand_moves_stay_rotations(pose: Pose) -> None:
    for number in range(10_000):
        pose = pose.rotated((60.0, 40.0), (61.0 + number % 3, 41.5))
    axes = pose.camera.eye_from_world
    assert np.allclose(axes @ axes.T, np.eye(3), atol=1e-13) and np.linalg.det(axes) > 0


def test_a_roll_turns_the_picture(pose: Pose) -> None:
    """A quarter turn from right to bottom takes what was right of the pivot below it."""
    rolled = pose.rolled((100.0, 40.0), (60.0, 75.0))
    beside = pose.pivot + pose.camera.right
    offset = seen(pose, beside) - seen(pose, pose.pivot)
    assert np.allclose(seen(rolled, beside) - seen(rolled, pose.pivot), (-offset[1], offset[0]), atol=1e-6)
    assert np.allclose(rolled.camera.forward, pose.camera.forward, atol=1e-12)


@pytest.mark.parametrize("orthographic", [False, True])
def test_a_pan_follows_the_cursor(pose: Pose, orthographic: bool) -> None:
    pose = pose.switched() if orthographic else pose
    moved = pose.panned((50.0, 30.0), (64.0, 21.0))
    assert np.allclose(seen(moved, pose.pivot) - seen(pose, pose.pivot), (14.0, -9.0), atol=1e-9)


@pytest.mark.parametrize("orthographic", [False, True])
def test_a_zoom_keeps_what_is_under_the_cursor(pose: Pose, orthographic: bool) -> None:
    pose = pose.switched() if orthographic else pose
    place = (95.0, 17.0)
    across = (np.array(place) - np.array(SIZE) / 2) * pose.pitch
    under = np.array([*across, pose.depth]) @ pose.camera.eye_from_world + pose.camera.eye
    nearer = zoom_by_wheel(pose, place, 3.0)
    assert np.allclose(seen(nearer, under), place, atol=1e-9)
    assert nearer.pitch == pytest.approx(pose.pitch * 0.85**3)


def test_a_zoom_ends_somewhere(pose: Pose) -> None:
    for _ in range(2000):
        pose = pose.zoomed((60.0, 40.0), 0.5)
    assert np.isfinite(pose.camera.eye).all() and pose.depth > 0
    for _ in range(2000):
        pose = pose.zoomed((60.0, 40.0), 2.0)
    assert np.isfinite(pose.camera.eye).all()


def test_orthographic_and_back(pose: Pose) -> None:
    flat = pose.switched()
    assert not flat.camera.perspective and flat.pitch == pytest.approx(pose.pitch)
    assert np.allclose(seen(flat, pose.pivot), seen(pose, pose.pivot), atol=1e-9)
    back = flat.switched()
    assert np.allclose(back.camera.eye, pose.camera.eye, atol=1e-9) and back.camera.extent == pytest.approx(
        pose.camera.extent
    )


def test_a_turn_is_about_up_and_counter_clockwise_from_above(pose: Pose) -> None:
    up = np.array([0.0, 0.0, 1.0])
    turned = pose.spun(90.0, up)
    # the object's quarter turn one way is the eye's the other way
    before, after = pose.camera.eye - pose.pivot, turned.camera.eye - pose.pivot
    assert np.allclose(after, (before[1], -before[0], before[2]), atol=1e-9)


def test_a_view_survives_the_scene_file(pose: Pose, scene: SceneFile, tmp_path: Path) -> None:
    for shown in (pose, pose.switched(), pose.rotated((10, 10), (90, 60))):
        text = replace(scene, view=shown.view()).to_toml(tmp_path)
        (tmp_path / "s.toml").write_text(text)
        view = SceneFile.from_toml(tmp_path / "s.toml").view
        assert view == shown.view()
        camera = view.camera(blob(), blob())
        assert np.allclose(camera.eye_from_world, shown.camera.eye_from_world, atol=1e-12)
        assert camera.extent == pytest.approx(shown.camera.extent) and camera.size == shown.camera.size


# --- the mouse ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("button", "held", "kind"),
    [
        ("left", (), "rotate"),
        ("left", ("shift",), "pan"),
        ("left", ("ctrl",), "roll"),
        ("middle", (), "pan"),
        ("right", (), "zoom"),
    ],
)
def test_buttons(pose: Pose, button: str, held: tuple[str, ...], kind: str) -> None:
    mouse = Mouse().press(button, held, (30.0, 30.0), pose, 1.0)
    assert mouse.drag is not None and mouse.drag.kind == kind
    # a second button does not take over
    assert mouse.press("middle", (), (1.0, 1.0), pose, 1.1) is mouse
    assert mouse.release().drag is None


def test_a_drag_depends_on_its_ends_alone(pose: Pose) -> None:
    drag = Mouse().press("left", (), (30.0, 30.0), pose, 0.0).drag
    assert drag is not None
    drag.to((90.0, 2.0))
    assert np.array_equal(drag.to((50.0, 44.0)).camera.eye, pose.rotated((30.0, 30.0), (50.0, 44.0)).camera.eye)


def test_double_clicks(pose: Pose) -> None:
    mouse = Mouse().press("left", (), (30.0, 30.0), pose, 1.0).release()
    assert mouse.doubles("left", (31.0, 30.0), 1.2)
    assert not mouse.doubles("left", (31.0, 30.0), 1.5)
    assert not mouse.doubles("left", (60.0, 30.0), 1.2)
    assert not mouse.doubles("right", (30.0, 30.0), 1.2)


# --- bindings -----------------------------------------------------------------------------------------------------


def test_the_table_is_whole() -> None:
    assert len({command.id for command in COMMANDS}) == len(COMMANDS)
    assert len(keymap(COMMANDS)) == sum(len(command.keys) for command in COMMANDS)
    for command in COMMANDS:
        assert all(normalize_key(command.id, key) == key for key in command.keys)


def test_list_bindings(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as end:
        main(["view", "--list-bindings"])
    assert end.value.code == 0
    assert capsys.readouterr().out.strip() == list_bindings(COMMANDS).strip()


def test_remapping(tmp_path: Path) -> None:
    (tmp_path / "keys.toml").write_text('[bindings]\nturn = ["t", "Ctrl+Space"]\nquit = "ctrl+h"\n')
    keys = {key: command.id for key, command in keymap(load_bindings(tmp_path / "keys.toml")).items()}
    assert keys["t"] == keys["ctrl+space"] == "turn" and keys["ctrl+h"] == "quit"
    assert "space" not in keys and "q" not in keys and keys["r"] == "reset"


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"turn": "b"}, "key b: expected one action, got turn and blend"),
        ({"spin": "x"}, "bindings: expected actions open, add-layer"),
        ({"turn": "hyper+x"}, "bindings: turn: expected a key, got 'hyper"),
        ({"turn": "xy"}, "bindings: turn: expected a key"),
        ({"turn": 3}, "bindings: turn: expected a key or a list of keys, got 3"),
    ],
)
def test_bad_bindings(changes: dict[str, object], message: str) -> None:
    with pytest.raises(sg.InputError, match="^" + message.replace("+", r"\+")):
        rebind(changes)


def test_keys_as_glfw_tells_them() -> None:
    assert from_key(256, None, 0) == "escape" and from_key(290, None, 0) == "f1"
    assert from_key(ord("Q"), "a", 0) == "a"  # a French keyboard
    assert from_key(ord("1"), "&", 2) == "ctrl+1" and from_key(321, "1", 0) == "1"
    assert from_key(ord("S"), "s", 1) == "shift+s"
    # signs come as characters, whatever keys make them
    assert from_key(ord("/"), "/", 1) is None and from_character("?") == "?" and from_character("a") is None


# --- pacing and refinement ----------------------------------------------------------------------------------------


SCENE_COUNTS = [1_000_000, 140_000, 18_000, 3000]


def paced(cost: list[float], frames: int = 60, rest: float = 0.0, start: float | None = None) -> list[int]:
    """Levels of a moving picture when each level takes so long, and all else `rest`."""
    pace = PreviewPace.of(SCENE_COUNTS, 300_000, 0.033).drawn(0, start or cost[0], rest).started()
    levels = []
    for _ in range(frames):
        levels.append(pace.level)
        pace = pace.drawn(pace.level, cost[pace.level], rest)
    return levels


def test_a_fast_scene_is_never_made_coarse() -> None:
    assert set(paced([0.02] * len(LADDER))) == {0}


def test_a_slow_scene_settles_on_a_level_that_keeps_the_target() -> None:
    levels = paced([0.9, 0.5, 0.3, 0.2, 0.09, 0.08, 0.024, 0.016, 0.01, 0.008, 0.005, 0.004, 0.003])
    assert levels[-1] == 6
    # within a third of a second
    assert len(set(levels[12:])) == 1


def test_what_gains_nothing_is_not_given_up() -> None:
    """Levels that cost alike, or frames that take long for another reason, keep every pixel and voxel."""
    assert paced([0.06] * len(LADDER), 200)[-1] == 0
    assert paced([0.007, *[0.005] * 12], 200, rest=0.06)[-1] == 0
    # every second voxel gains, fewer pixels don't
    assert paced([0.3, 0.2, 0.15, 0.14, 0.13, 0.12, *[0.079] * 7], 200)[-1] == 6


def test_poor_rates_take_any_gain() -> None:
    """What takes longer than a tenth of a second gives up pixels for a little; what takes less, for a third."""
    slow = [1.5, 0.9, 0.7, 0.6, 0.5, 0.4, 0.155, 0.145, 0.125, *[0.1] * 4]
    assert paced(slow, 200)[-1] == 8
    assert paced([cost / 2 for cost in slow], 200)[-1] < 8


def test_motion_has_a_floor() -> None:
    """At least an eighth of the pixels, and every second voxel; less where nothing moves."""
    slow = [2.0, 1.0, 0.8, 0.6, 0.5, 0.4, 0.3, 0.15, 0.1, 0.09, 0.08, 0.05, 0.02]
    assert LADDER[max(paced(slow, 200))] == PreviewLevel(0.35, 2)
    stuck = [20.0, 9.0, 8.0, 7.0, 6.0, 5.0, 4.5, 4.0, 3.0, 2.0, 1.0, 0.5, 0.1]
    assert LADDER[paced(stuck, 200)[-1]].stride == 8


def test_a_busy_machine_gives_up_pixels_not_voxels() -> None:
    """However long other processes make a frame take: every second voxel is drawn, and coarser ones where they are not
    to blame.
    """
    for alone, stride in ((0.12, 2), (0.6, 8)):
        pace, drawn = PreviewPace.of(SCENE_COUNTS, 300_000, 0.033).drawn(0, 3.0).started(), list[PreviewLevel]()
        for _ in range(60):
            drawn.append(LADDER[pace.level])
            share = 5.0 / len(LADDER) * (len(LADDER) - pace.level)
            pace = pace.drawn(pace.level, share, 0.0, alone)
        assert drawn[-1] == (PreviewLevel(0.25, 2) if stride == 2 else LADDER[-1])
        assert max(level.stride for level in drawn) == stride


def test_a_hiccup_leaves_the_floor_where_it_is() -> None:
    """One frame that waits for something else makes no picture coarse; below the floor is for those that are stuck."""
    floor = LADDER.index(PreviewLevel(0.35, 2))
    pace = PreviewPace.of(SCENE_COUNTS, 300_000, 0.033).drawn(0, 3.0).started()
    for seconds in (0.11, 0.11, 0.11, 0.7, 0.11, 0.11):
        pace = pace.drawn(pace.level, seconds)
        assert pace.level <= floor
    for _ in range(16):
        pace = pace.drawn(pace.level, 0.6 if pace.level <= floor else 0.09)
    assert pace.level > floor
    # the machine has become quicker
    for _ in range(12):
        pace = pace.drawn(pace.level, 0.12 if pace.level <= floor else 0.02)
    assert pace.level == floor


def test_who_had_to_come_back_waits() -> None:
    """A finer level that looks cheap beforehand, and never is, is tried ever more seldom."""
    pace = PreviewPace.of([10_000] * len(STRIDES), 100_000)
    pace, climbs = replace(pace, level=4), []
    for number in range(400):
        if pace.level < 4:
            climbs.append(number)
            pace = pace.drawn(pace.level, 0.09)
        else:
            # as if the finer one had become cheap in the meantime
            pace = replace(pace.drawn(4, 0.01), costs=(*[0.02] * 4, *[0.01] * (len(LADDER) - 4)))
    apart = np.diff(climbs)[np.diff(climbs) > 1]
    assert len(climbs) < 20 and (np.diff(apart) > 0).all()


@pytest.mark.parametrize("near", [0.034, 0.040, 0.024, 0.0329])
def test_nothing_flickers_near_the_target(near: float) -> None:
    """A level that takes about the target stays, and two neighbours never take turns."""
    levels = paced([near * share for share in (8, 5, 3, 1.5, 1, 0.6, 0.3, 0.2, 0.1, *[0.1] * 4)], 400)
    assert sum(a != b for a, b in pairwise(levels)) <= 4


def test_a_scene_that_becomes_cheap_gets_finer() -> None:
    pace = PreviewPace.of([80_000, 20_000, 5000, 1000], 300_000).drawn(0, 1.0).started()
    coarse = pace.level
    pace = pace.drawn(coarse, 0.03)
    for _ in range(200):
        pace = pace.drawn(pace.level, 1e-4)
    assert coarse > 0 and pace.level == 0


def test_a_first_picture_that_compiles_is_forgiven() -> None:
    """One long frame of a level, and one of the full picture, keep nothing coarse."""
    pace = PreviewPace.of([10_000] * len(STRIDES), 100_000)
    costs = [work * 1e-7 for work in pace.work]
    pace = pace.drawn(0, 3.0).started()
    assert pace.level > 0
    for number in range(60):
        pace = pace.drawn(pace.level, 1.0 if number == 0 else costs[pace.level])
    assert pace.level == 0


def test_levels_obey_what_is_asked() -> None:
    asked = sg.Settings(antialias="supersample", blend="mip")
    assert FULL.settings(asked) is asked
    lenient = sg.Settings(antialias="paper", tolerance=8 / 255)
    for level in LADDER[1:]:
        assert level.settings(asked) == lenient.replace(blend="mip")
        assert level.settings(sg.Settings(antialias="supersample")) == lenient
        assert level.settings(sg.Settings(steps=4, tolerance=0.1)) == lenient.replace(steps=4, tolerance=0.1)
    assert PreviewLevel(0.71, 2).size((641, 3)) == (455, 2)


def test_accuracy_is_given_up_before_pixels_and_voxels() -> None:
    """A third of the time keeps the target: all pixels and voxels are drawn."""
    costs = [0.09, 0.03, 0.025, 0.02, 0.015, *[0.01] * 7]
    assert set(paced(costs)[12:]) == {1}
    assert str(LADDER[1]) == "all pixels and voxels" and LADDER[1].size(SIZE) == SIZE and LADDER[1].stride == 1


def stepped(refiner: Refiner, wanted: str, now: InputTiming, full: bool) -> int | None:
    return refiner.step((wanted,), now, lambda level: ((wanted,), full))


def test_refinement() -> None:
    """Coarse while input comes, nothing until REST, then in full once, and not again."""
    refiner = Refiner([4_000_000, 400_000, 50_000, 8000], 640 * 480, 0.033)
    first = refiner.level(("a",), InputTiming(0.0))
    assert first
    assert stepped(refiner, "a", InputTiming(0.0), False) == first
    assert refiner.level(("a",), InputTiming(0.02)) is None
    assert 0 < (refiner.seconds_until_due(("a",), InputTiming(0.02)) or 0) < 0.15
    assert refiner.level(("a",), InputTiming(0.15)) == 0
    # a button held down puts off what would take long; turning puts it off for good
    assert refiner.level(("a",), InputTiming(0.15, held=True)) is None
    assert refiner.level(("a",), InputTiming(9.0, turning=True)) is None
    assert stepped(refiner, "a", InputTiming(0.15), True) == 0
    assert (
        refiner.level(("a",), InputTiming(1.0)) is None and refiner.seconds_until_due(("a",), InputTiming(1.0)) is None
    )
    # also where the machine is so busy that the view rests before anything is drawn
    late = refiner.level(("b",), InputTiming(0.3))
    assert late
    assert stepped(refiner, "b", InputTiming(0.3), False) == late
    assert refiner.level(("b",), InputTiming(0.3)) == 0


def test_strides_refine_as_they_come() -> None:
    """Nothing without splats; then the finest there is, each once, and the full picture at last."""
    refiner = Refiner([10, 10, 10, 10], 100, 0.033)
    assert refiner.level(("a",), InputTiming(0.0, strides=())) is None
    drawn = []
    for strides in ((8,), (4, 8), (4, 8), (2, 4, 8), (1, 2, 4, 8), (1, 2, 4, 8)):
        level = refiner.step(("a",), InputTiming(5.0, strides=strides), lambda level: (("a",), level == 0))
        drawn.append(None if level is None else LADDER[level].stride)
    assert drawn == [8, 4, None, 2, 1, None]
    # in motion no stride is waited for
    assert refiner.level(("b",), InputTiming(0.0, strides=(1, 8))) in (0, len(LADDER) - 1, 8)


def test_a_picture_that_cannot_be_had_is_not_tried_again() -> None:
    refiner = Refiner([10, 10, 10, 10], 100, 0.033)

    def refuse(level: int) -> tuple[tuple[object, ...], bool]:
        raise sg.InputError("none")

    with pytest.raises(sg.InputError, match="none"):
        refiner.step(("a",), InputTiming(5.0), refuse)
    assert (
        refiner.level(("a",), InputTiming(5.0)) is None and refiner.seconds_until_due(("a",), InputTiming(5.0)) is None
    )
    # in full at once, as it is quick
    assert refiner.level(("b",), InputTiming(5.0)) == 0


def test_undo_and_redo(scene: SceneFile) -> None:
    """Every change at rest is one step; what is open and said is none; a new change forgets what was undone."""
    document = Document.open(scene)
    first = State.of(document, (64, 48))
    history = History(first)
    denser = replace(acted(first, "opacity-up", document), help=True)
    turned = acted(denser, "top", document)
    history.note(denser)
    history.note(replace(denser, message="said"))
    back = history.undo(turned)
    assert (
        back.pose.camera.eye == pytest.approx(denser.pose.camera.eye)
        and back.style.extinction == denser.style.extinction
    )
    assert back.help and history.has_unsaved_edits(back)
    back = history.undo(back)
    assert back.style.extinction == 1.0 and not history.has_unsaved_edits(back)
    assert history.undo(back).message == "nothing to undo"
    again = history.redo(back)
    assert again.style.extinction == denser.style.extinction
    history.note(acted(again, "threshold-up", document))
    assert history.redo(again).message == "nothing to redo" or not history.future


# --- what is shown ------------------------------------------------------------------------------------------------


def test_coarser_volumes_stay_where_they_are() -> None:
    """The centre of mass, the sum of the samples times a voxel's size, and the box stay."""
    fine = blob(24)
    coarse = halve_volume(fine)
    assert coarse.shape == (12, 12, 12) and coarse.spacing == (2.0, 2.0, 2.5)
    assert np.allclose(coarse.corners, fine.corners)
    assert coarse.samples.sum() * 8 == pytest.approx(float(fine.samples.sum()), rel=1e-5)
    odd = halve_volume(sg.Volume(np.ones((5, 3, 9), np.uint8)))
    assert odd.shape == (3, 3, 5) and (odd.samples == 1).all() and odd.spacing == (2.0, 1.0, 2.0)


def test_coarse_colours_are_those_of_the_matter() -> None:
    samples = np.zeros((8, 8, 8), np.uint8)
    color = np.zeros((8, 8, 8, 3), np.uint8)
    samples[:, :, 3], color[:, :, 3] = 255, (200, 100, 50)
    coarse = halve_volume(sg.Volume(samples, color=color))
    assert coarse.color is not None
    assert np.abs(coarse.color[:, :, 1].astype(int) - (200, 100, 50)).max() <= 1


def test_coarse_pictures_look_alike(renderer: sg.Renderer, scene: SceneFile) -> None:
    """Opacities are per the finest volume's length: a coarse picture is as bright as the fine one."""
    document = Document.open(scene)
    (layer,) = document.layers
    # a volume this small is drawn as it is
    assert layer.at(2) is layer.at(1)
    volume = blob(48)
    volumes = (volume, halve_volume(volume), halve_volume(halve_volume(volume)), volume)
    layer = replace(layer, volumes=volumes, cache={})
    camera = replace(document, pool={0: layer}).home(SIZE).camera
    fine, coarse = (renderer.render(layer.at(stride), camera).pixels for stride in (1, 2))
    assert coarse.mean() == pytest.approx(fine.mean(), rel=0.1)
    assert np.sqrt(((coarse - fine) ** 2).mean()) < 0.05


def solid(side: int = 20) -> sg.Splats:
    return sg.extract(
        sg.Volume(np.full((side, side, side), 9, np.uint8)),
        sg.Transfer([(1, 0.9)], unit=1.0, colormap="gray"),
        classification="pre",
    )


@pytest.mark.long
def test_hidden_splats_cannot_be_seen(renderer: sg.Renderer) -> None:
    splats = solid()
    skin = visible_shell(splats)
    assert 0.3 * len(splats) < len(skin) < 0.8 * len(splats)
    camera = sg.Camera.orbit(splats, 30, 20, 40, (64, 64), zoom=3.0)
    assert eye_is_outside(skin, camera.eye) and not sg.plan(splats, camera).program.seen.antialias
    apart = np.abs(renderer.render(skin, camera).pixels - renderer.render(splats, camera).pixels)
    assert apart.max() < 1 / 255
    assert not eye_is_outside(splats, np.array([10.0, 10.0, 10.0]))


def test_faint_matter_hides_nothing() -> None:
    fog = sg.extract(
        sg.Volume(np.full((12, 12, 12), 9, np.uint8)), sg.Transfer([(1, 0.3)], unit=1.0), classification="pre"
    )
    assert visible_shell(fog) is fog


def test_a_stand_in_is_compared_as_the_window_shows_it() -> None:
    """Bilinear between the middles of its pixels, whatever its size; its own size is the picture itself."""
    rng = np.random.default_rng(3)
    small = rng.random((3, 5, 4), np.float32)
    assert np.array_equal(resize_bilinear(small, (5, 3), 1), small)
    large = resize_bilinear(small, (10, 6), 1)
    assert large.shape == (6, 10, 4)
    assert np.allclose(large[0, 0], small[0, 0]) and np.allclose(large[-1, -1], small[-1, -1])
    assert np.allclose(
        large[2, 4], 0.75 * (0.25 * small[0, 2] + 0.75 * small[1, 2]) + 0.25 * (0.25 * small[0, 1] + 0.75 * small[1, 1])
    )
    assert np.array_equal(resize_bilinear(small, (10, 6), 2), large[::2, ::2])


def test_tint(renderer: sg.Renderer) -> None:
    splats = solid(16)
    camera = sg.Camera.orbit(splats, 0, 0, 40, SIZE)
    far = sg.Camera.orbit(splats, 0, 0, 40, SIZE, zoom=0.1)
    z_k = float(camera.eye_from_points(splats.corners)[:, 2].mean()) + 0.2
    assert share_beyond(splats, camera, z_k) == pytest.approx(0.5, abs=0.05)
    shown = tint_splats(splats, camera, z_k)
    changed = (shown.colors != splats.colors).any(axis=1)
    depth = camera.eye_from_points(splats.positions.astype(float))[:, 2]
    assert (changed == ((depth > z_k) | (np.abs(depth - z_k) < 0.5))).all()
    # another view tints other splats, in the picture too, whatever was worked out of them before
    _ = splats.records_with_runs, splats.runs
    behind = renderer.render(tint_splats(splats, camera, 0.0), camera).pixels
    plain_picture = renderer.render(splats, camera).pixels
    assert behind[40, 60, 0] > 2 * behind[40, 60, 2] and abs(plain_picture[40, 60, 0] - plain_picture[40, 60, 2]) < 0.01
    assert np.allclose(behind[..., 3], plain_picture[..., 3])
    # beyond z_k the renderer draws by what surrounds a splat
    renderer.render(splats, far)
    small = renderer.render(tint_splats(splats, far, 0.0), far).pixels[40, 60]
    assert small[0] > 2 * small[2] > 0


def test_the_plane_cuts_the_box() -> None:
    volume = sg.Volume(np.zeros((10, 10, 10)))
    camera = sg.Camera.look_at((4.5, -40.0, 4.5), (4.5, 4.5, 4.5), (0, 0, 1), 40.0, SIZE)
    square = plane_section(volume, camera, 44.5)
    pitch = camera.pixel_pitch(44.5)
    assert np.allclose(np.ptp(square, axis=0), 10 / pitch) and len(square) == 4
    assert [len(plane_section(volume, camera, z_k)) for z_k in (10.0, np.inf)] == [0, 0]


@pytest.mark.parametrize("orthographic", [False, True])
def test_picking(pose: Pose, orthographic: bool) -> None:
    points = np.array([[2.0, 3.0, 1.0], [2.0, 9.0, 1.0], [6.0, 3.0, 1.0]])
    splats = sg.Splats.from_points(points, np.ones((3, 3)), np.full(3, 9.0))
    pose = pose.switched() if orthographic else pose
    found = find_matter(splats, pose.camera, tuple(seen(pose, points[0])))
    # the nearer of two in a line
    assert found is not None and np.linalg.norm(found - points[0]) < 1.0
    assert find_matter(splats, pose.camera, (1.0, 1.0)) is None


def test_overlay_says_what_it_should() -> None:
    empty = draw_overlay(Overlay((90, 60)))
    assert empty.shape == (60, 90, 4) and not empty.any()
    text = draw_overlay(Overlay((90, 60), 1.0, (Text(("z_k",)),)))
    assert text[:36, :45].any() and not text[36:].any()
    assert draw_overlay(Overlay((90, 60), 2.0, (Text(("z_k",)),)))[..., 3].sum() > 2 * text[..., 3].sum()
    assert plain("16×16 ≥ τ…") == "16x16 >= tau..."
    assert draw_overlay(Overlay((90, 60), 1.0, (), (((10, 10), (50, 10), (30, 40)),)))[10, 30, 3] == 255


# --- the curve of the panel ---------------------------------------------------------------------------------------


def test_the_scale_of_opacities_there_and_back() -> None:
    for opacity in (0.0, 0.002, 0.01, 0.5, 1.0):
        assert transfer_editor.opacity_from_axis(float(transfer_editor.axis_from_opacity(opacity))) == pytest.approx(
            opacity, abs=1e-12
        )
    # fine near zero: the lowest hundredth has a sixth of the height
    assert (
        transfer_editor.axis_from_opacity(0.01) > 0.16
        and transfer_editor.opacity_from_axis(0.0) == 0.0
        and transfer_editor.opacity_from_axis(1.0) == 1.0
    )


def test_the_drawn_curve_is_the_transfer_function() -> None:
    """Between its nodes too, where the scale bends it, at a step, and beyond its ends."""
    transfer = sg.Transfer(points=[(10, 0.0), (20, 0.4), (20, 0.1), (30, 0.3)])
    values, heights = transfer_editor.line(transfer, 0.0, 50.0)
    assert values[0] == 0.0 and values[-1] == 50.0 and (np.diff(values) > -1e-9).all()
    assert {
        (20.0, float(transfer_editor.axis_from_opacity(0.4))),
        (20.0, float(transfer_editor.axis_from_opacity(0.1))),
    } <= set(zip(values, heights, strict=True))
    apart = np.abs(values - 20.0) > 1e-9
    assert np.allclose(heights[apart], transfer_editor.axis_from_opacity(transfer.opacity(values[apart])), atol=1e-12)
    bent = sg.Transfer(points=[(1, 0.0), (100, 0.4)], scale="log")
    values, heights = transfer_editor.line(bent, 1.0, 100.0)
    assert np.allclose(heights, transfer_editor.axis_from_opacity(0.2 * np.log10(values)), atol=1e-12)


def test_bars_are_counts() -> None:
    stats = statistics(sg.Volume(np.repeat([1.0, 2.0, 3.0], [6, 1, 1]).reshape(2, 2, 2)))
    edges, bars = transfer_editor.histogram(stats, 1.0, 3.0, logarithmic=False)
    assert edges[:4].tolist() == [1.0, 2.0, 3.0, 4.0] or len(edges) == 3
    assert bars[0] == 1.0 and bars[1] == pytest.approx(1 / 6 if len(bars) > 2 else 2 / 6)
    assert transfer_editor.histogram(stats, 1.0, 3.0)[1][1] > bars[1]
    # nothing within the range
    assert not transfer_editor.histogram(stats, 50.0, 60.0)[1].any()


def test_points_of_opacities_and_colours() -> None:
    nodes = ((0.0, 0.0), (10.0, 0.5), (20.0, 1.0))
    assert transfer_editor.move_point(nodes, 1, 15.0, 0.25) == ((0.0, 0.0), (15.0, 0.25), (20.0, 1.0))
    above = transfer_editor.opacity_from_axis(9.0)
    assert transfer_editor.move_point(nodes, 1, 99.0, above) == ((0.0, 0.0), (20.0, 1.0), (20.0, 1.0))
    assert transfer_editor.add_point(nodes, 12.0, 0.1) == (((0.0, 0.0), (10.0, 0.5), (12.0, 0.1), (20.0, 1.0)), 2)
    assert (
        transfer_editor.remove_point(nodes, 0) == nodes[1:] and transfer_editor.remove_point(nodes[:1], 0) == nodes[:1]
    )
    colors = ((0.0, "#000000"), (5.0, "#ff0000"), (9.0, "#ffffff"))
    assert transfer_editor.move_point(colors, 1, 20.0, "#ff0000")[1] == (9.0, "#ff0000")
    assert transfer_editor.move_point(colors, 2, 20.0, "#ffffff")[2] == (20.0, "#ffffff")
    assert transfer_editor.add_point(colors, 7.0, "#00ff00")[0][2] == (7.0, "#00ff00")
    assert transfer_editor.code_of([0.0, 0.5, 1.2]) == "#0080ff"


# --- states -------------------------------------------------------------------------------------------------------


def test_opacity_keys_undo_each_other(scene: SceneFile) -> None:
    document = Document.open(scene)
    state = State.of(document, SIZE)
    more = acted(state, "opacity-up", document)
    assert more.style.transfer.points[1][1] == pytest.approx(1 - 0.4**1.25)
    assert acted(more, "opacity-down", document).styles == state.styles
    assert scale_opacity(1.0, 0.2) == 1.0 and scale_opacity(0.0, 5.0) == 0.0


def test_settings_that_a_volume_does_not_allow_are_passed_over(scene: SceneFile) -> None:
    document = Document.open(scene)
    state, met = State.of(document, SIZE), []
    state = replace(state, settings=state.settings.replace(technique="tiles"))
    for _ in range(6):
        state = acted(state, "align", document)
        met.append(state.settings.align)
    # tiles draw no tables
    assert "ray" not in met and "exact" in met and "auto" in met


# --- classified after reconstruction ------------------------------------------------------------------------------

POST, PRE = sg.Settings(classification="post"), sg.Settings(classification="pre")


@pytest.fixture
def document(scene: SceneFile) -> Document:
    return Document.open(replace(scene, settings=POST))


@pytest.fixture
def after(document: Document) -> LayerSplats:
    return document.layers[0]


def test_splats_are_classified_as_the_settings_say(after: LayerSplats) -> None:
    """What takes splats of the other kind gets them; both kinds are kept."""
    assert (
        after.is_post_classified
        and 1 in after.shells
        and after.shell(1) is after.at(1)
        and after.at(1).post is not None
    )
    assert after.counts[0] == len(after.at(1)) and after.at(1).post.kernel == "b-spline"
    assert after.for_settings(POST) is after and after.why_pre_classified(POST, False) is None
    assert after.for_settings(POST.replace(blend="xray")) is after
    assert after.for_settings(POST, moving=True) is after
    streaked = POST.replace(motion="exact")
    before = after.for_settings(streaked, moving=True)
    assert before.at(1).post is None and len(before.at(1)) < len(after.at(1)) and not before.is_post_classified
    assert before.for_settings(streaked, moving=True) is before and before.for_settings(POST) == after
    every = after.for_settings(POST.replace(blend="minip"))
    assert every.at(1).post is not None and len(every.at(1)) == after.volume.samples.size
    largest = after.for_settings(POST.replace(blend="mip")).at(1)
    assert largest.post is not None and largest.post.largest and len(largest) < len(every.at(1))
    assert after.for_settings(PRE) == before and before.why_pre_classified(streaked, True) == "motion exact"
    other = after.for_settings(POST.replace(kernel="crawfis-max"))
    assert other.at(1).post is not None and other.at(1).post.kernel == "crawfis-max"


def test_blends_of_one_value_have_no_threshold(document: Document) -> None:
    """Voxels that are left out would change means and minima without a word."""
    state = State.of(document, SIZE)
    mean = replace(state, settings=POST.replace(blend="mean"))
    told = acted(mean, "threshold-up", document)
    assert told.style.threshold == 0.0 and told.message == "no threshold: this blend takes the values of all voxels"
    assert acted(state, "threshold-up", document).style.threshold > 0
    # nor are they chosen while one is about to be extracted
    pending, met = state.edit(threshold=0.1), set()
    for _ in range(6):
        pending = acted(pending, "blend", document)
        met.add(pending.settings.blend)
    assert met == {"composite", "xray", "mip"}
    # nor are values that were extracted without one taken for it
    every = document.layers[0].for_settings(POST.replace(blend="mean"))
    assert every.at(1).post is not None
    with pytest.raises(sg.InputError, match="only classification pre is possible, because of threshold"):
        every.for_style(LayerStyle(every.transfer, 0.1), POST.replace(blend="mean")).at(1)


def test_edits_of_kept_values_extract_nothing(after: LayerSplats) -> None:
    points = {
        "colours": replace(after.transfer, colormap="viridis"),
        "fewer": replace(after.transfer, points=((8.0, 0.0), (30.0, 0.9))),
    }
    for transfer in points.values():
        edited = after.for_style(LayerStyle(transfer, 0.0), POST)
        assert 1 in edited.shells and edited.at(1).records is after.at(1).records and edited.counts == after.counts
        assert edited.at(1).post is not None and edited.at(1).post.transfer == transfer.on(after.volume)
        again = edited.for_style(LayerStyle(after.transfer, 0.0), POST)
        assert again.at(1).records is after.at(1).records and again.is_current
    assert (
        after.for_style(LayerStyle(points["colours"], 0.0), POST).is_current
        and not after.for_style(LayerStyle(points["fewer"], 0.0), POST).is_current
    )
    more = after.for_style(LayerStyle(replace(after.transfer, points=((3.0, 0.0), (30.0, 0.6))), 0.0), POST)
    assert more.is_post_classified and 1 not in more.shells and len(more.at(1)) > len(after.at(1))
    # what cannot be classified after, in between, leaves the values kept
    faint = after.for_style(LayerStyle(after.transfer, 0.1), POST)
    assert (
        not faint.is_post_classified
        and faint.why_pre_classified(POST, False) == "threshold"
        and faint.at(1).post is None
    )
    assert faint.for_style(LayerStyle(after.transfer, 0.0), POST).at(1).records is after.at(1).records


def test_edits_at_every_stride_keep_their_unit(after: LayerSplats) -> None:
    volume = blob(48)
    coarse = (volume, halve_volume(volume), halve_volume(halve_volume(volume)), volume)
    layer = replace(after, volumes=coarse, cache={})
    assert layer.at(2).unit == layer.at(1).unit
    edited = layer.for_style(LayerStyle(replace(after.transfer, colormap="viridis"), 0.0), POST)
    assert edited.at(2).records is layer.at(2).records and edited.at(2).unit == edited.at(1).unit


@pytest.mark.long
def test_the_window_draws_values_and_what_they_cannot_be(document: Document, renderer: sg.Renderer) -> None:
    painter, state = FrameRenderer(cast(Screen, Kept()), renderer), State.of(document, SIZE)
    for level in (FULL, LADDER[6]):
        frame = painter.draw(state, document, level, False, lambda: False)
        assert frame.info["classification"] == "post" and not any(
            "because of" in line for line in said_of(state, document, frame)
        )
    sheets = replace(state, settings=PRE)
    frame = painter.draw(sheets, document.for_settings(sheets.settings), LADDER[6], False, lambda: False)
    assert frame.info["classification"] == "pre" and frame.info["sheets"] == 2
    for blend in ("xray", "mip"):
        other = replace(state, settings=POST.replace(blend=blend))
        frame = painter.draw(other, document.for_settings(other.settings), FULL, False, lambda: False)
        assert (frame.info["classification"], frame.info["blend"]) == ("post", blend)
    blurred, before = replace(state, blur="exact"), document.for_settings(POST.replace(motion="exact"), moving=True)
    painter.draw(blurred, before, FULL, True, lambda: False)
    blurred = replace(blurred, pose=blurred.pose.spun(5.0, np.array([0.0, 0.0, 1.0])))
    frame = painter.draw(blurred, before, FULL, True, lambda: False)
    assert frame.blurred and any("because of motion exact" in line for line in said_of(blurred, before, frame))


def test_slow_pictures_blur_no_longer_paths(document: Document, renderer: sg.Renderer) -> None:
    """Of a path however long, few moments; of a slow picture's, the last tenth of a second."""
    painter, state = (
        FrameRenderer(cast(Screen, Kept()), renderer),
        replace(State.of(document, SIZE), blur="moments"),
    )
    turned = replace(state, pose=state.pose.spun(90.0, np.array([0.0, 0.0, 1.0])))

    def moments(seconds: float) -> object:
        painter.draw(state, document, FULL, True, lambda: False)
        painter.begun = time.perf_counter() - seconds
        return painter.draw(turned, document, FULL, True, lambda: False).info["moments"]

    assert moments(0.0) == MOMENTS and moments(20.0) == 2


def said_of(state: State, document: Document, frame: hud.DisplayedFrame) -> tuple[str, ...]:
    return hud.full_lines(state, document, frame, None)


def test_classification_is_a_choice(document: Document, scene: SceneFile) -> None:
    """It is passed over where it cannot be had."""
    default, met = Document.open(scene), []
    state = State.of(default, SIZE)
    for _ in range(3):
        state = acted(state, "classification", default)
        met.append(state.settings.classification)
    assert met == ["post", "pre", "auto"]
    table = replace(state, settings=sg.Settings(footprint="table", classification="pre"))
    assert acted(table, "classification", default).settings.classification == "auto"
    assert acted(State.of(document, SIZE), "compositing", document).settings.compositing == "sheets"


@pytest.mark.long
def test_light_beyond_z_k_is_tinted(document: Document, renderer: sg.Renderer) -> None:
    """All of it far off, none of it near, and in between the part that is beyond."""
    painter, state = FrameRenderer(cast(Screen, Kept()), renderer), State.of(document, SIZE)
    state = replace(state, settings=POST.replace(antialias="paper", background=(0.1, 0.1, 0.4)))
    shares = []
    for notches in (0.0, -5.0, -9.5, -12.0):
        seen_from = replace(state, pose=zoom_by_wheel(state.pose, (60.0, 40.0), notches))
        plain = renderer.render(document.layers[0].at(1), seen_from.pose.camera, sg.Settings(antialias="paper")).pixels
        frame = painter.draw(replace(seen_from, show_zk=True), document, FULL, False, lambda: False)
        changed = np.abs(painter.pixels - plain).max()
        shares.append(frame.beyond())
        assert (changed > 0.05) == (frame.beyond() > 0) and plain[..., 3].max() > 0.1
        if frame.beyond() == 1:
            light = plain[..., :3] + SHARE * (TINT * plain[..., 3:] - plain[..., :3])
            assert np.abs(painter.pixels[..., :3] - light).max() < 1e-6
    assert shares[0] == 0 and shares[-1] == 1 and any(0 < share < 1 for share in shares)


def test_values_are_picked_where_they_are_opaque(document: Document, after: LayerSplats) -> None:
    camera = document.home(SIZE).camera
    for place in ((60.0, 40.0), (64.0, 30.0)):
        found, right = (find_matter(layer.at(1), camera, place) for layer in (after, after.for_settings(PRE)))
        assert found is not None and right is not None and np.abs(found - right).max() < 2.0
    # voxels around opaque ones are kept, but are not there to be picked
    shown = after.for_style(LayerStyle(replace(after.transfer, points=((38.0, 0.0), (39.0, 0.9))), 0.0), POST)
    depth = (shown.at(1).records["position"][shown.at(1).depths > 0] - (11.5, 11.5, 11.5)) / 24
    assert 0 < len(depth) < 0.5 * len(shown.at(1))
    clear = after.for_style(LayerStyle(replace(after.transfer, points=((4.0, 0.0), (30.0, 0.0))), 0.0), POST)
    assert len(clear.at(1)) and find_matter(clear.at(1), camera, (60.0, 40.0)) is None


# --- saved scenes -------------------------------------------------------------------------------------------------


def test_scenes_survive_their_file(tmp_path: Path) -> None:
    (tmp_path / "data").mkdir()
    np.save(tmp_path / "data" / 'a "b"\\c\tä.npy', np.zeros((2, 2, 2)))
    settings = sg.Settings(blend="mip", tolerance=0.01, background=(0.1, 0.2, 1 / 3), z_s=1e-30, align="hybrid")
    settings = settings.replace(antialias="paper", blur_width=2.5)
    scenes = [
        SceneFile("tunnel"),
        SceneFile(str(tmp_path / "data" / 'a "b"\\c\tä.npy'), settings=settings, threshold=1 / 3),
        SceneFile("/elsewhere/x.raw", load={"shape": (3, 4, 5), "dtype": "uint8", "anywhere": True}),
        SceneFile("tunnel", transfer={"points": ((1, 0.25), (2.5, 1.0)), "shading": False, "unit": 1e-9}),
        SceneFile("nerve", view=ViewOptions((3, 4), azimuth=12.5, zoom=2.0, up=(0.0, 1.0, 0.0))),
    ]
    for number, scene in enumerate(scenes):
        path = tmp_path / f"{number}.toml"
        path.write_text(scene.to_toml(tmp_path), encoding="utf-8")
        again = SceneFile.from_toml(path)
        assert (again.volume, again.view, again.settings) == (scene.volume, scene.view, scene.settings)
        assert again.threshold == scene.threshold and set(again.load) == set(scene.load)
        assert {**again.transfer}.keys() == {**scene.transfer}.keys()
    assert 'volume = "data/' in (tmp_path / "1.toml").read_text()
    with pytest.raises(sg.InputError, match="volume: expected text that TOML can hold"):
        SceneFile("bad\udcff.npy").to_toml(tmp_path)


@pytest.mark.few(1)
@pytest.mark.parametrize("blend", ["composite", "xray"])
@pytest.mark.parametrize("orthographic", [False, True])
def test_what_is_saved_is_what_render_makes(
    renderer: sg.Renderer, scene: SceneFile, tmp_path: Path, blend: str, orthographic: bool
) -> None:
    """The PNG, the floats, and what `splatgl render` makes of the saved scene are the same, bit for bit."""
    document = Document.open(replace(scene, settings=sg.Settings(blend=blend)))
    state = State.of(document, SIZE)
    for action in ("opacity-up", "threshold-up", "threshold-up", *(["projection"] if orthographic else [])):
        state = acted(state, action, document)
    state = replace(state, pose=zoom_by_wheel(state.pose.rotated((3, 4), (50, 60)), (20.0, 30.0), 1.5))
    assert save_picture(state, document, renderer.render, tmp_path) == "saved picture-001.png"
    assert save_scene(state, document, renderer.render, tmp_path) == "saved scene-001.npy and scene-001.toml"
    for suffix in ("npy", "png"):
        given = ["render", str(tmp_path / "scene-001.toml"), "--backend", renderer.info.backend, "--quiet"]
        assert main([*given, "-o", str(tmp_path / f"again.{suffix}")]) == 0
    assert np.array_equal(np.load(tmp_path / "scene-001.npy"), np.load(tmp_path / "again.npy"))
    saved, again = (sg.Image.load(tmp_path / name) for name in ("picture-001.png", "again.png"))
    assert np.array_equal(saved.pixels, again.pixels) and saved.pixels.max() > 0.1
    assert {**saved.info, "seconds": 0} == {**again.info, "seconds": 0}


@pytest.mark.parametrize("edit", ["nothing", "fewer values", "threshold-up", "blend"])
def test_what_is_saved_of_values_is_what_render_makes(
    renderer: sg.Renderer, document: Document, tmp_path: Path, edit: str
) -> None:
    """Also where the window holds more voxels than the scene needs, and where it shows splats classified before."""
    state = State.of(document, SIZE)
    if edit in ("threshold-up", "blend"):
        state = acted(state, edit, document)
    elif edit == "fewer values":
        state = state.edit(base=replace(state.style.base, points=((12.0, 0.0), (30.0, 0.9))))
    document = document.with_styles(state.styles, (), state.settings)
    save_scene(state, document, renderer.render, tmp_path)
    given = ["render", str(tmp_path / "scene-001.toml"), "--backend", renderer.info.backend, "--quiet"]
    assert main([*given, "-o", str(tmp_path / "again.npy")]) == 0
    assert np.array_equal(np.load(tmp_path / "scene-001.npy"), np.load(tmp_path / "again.npy"))
    kind = "pre" if edit == "threshold-up" else "post"
    assert SceneFile.from_toml(tmp_path / "scene-001.toml").settings.classification == kind


def test_the_saved_picture_is_the_one_on_show(renderer: sg.Renderer, scene: SceneFile, tmp_path: Path) -> None:
    document = Document.open(scene)
    state = replace(State.of(document, SIZE), annotate=())
    shown = renderer.render(document.layers[0].at(1), state.pose.camera, state.settings).pixels
    saved = render_scene(scene_of(state, document), document, renderer.render).pixels
    assert np.abs(shown - saved).max() < 1e-5


def test_nothing_is_overwritten(tmp_path: Path) -> None:
    (tmp_path / "scene-001.npy").touch()
    assert free_path(tmp_path, "scene", ".toml").name == "scene-002.toml"
    assert free_path(tmp_path, "picture", ".png").name == "picture-001.png"


# --- files and threads --------------------------------------------------------------------------------------------


def test_watching(tmp_path: Path) -> None:
    path = tmp_path / "a.npy"
    path.write_bytes(b"1")
    watch = Watch.of([path], 0.0)
    assert watch.look(5.0)[1] is False
    path.write_bytes(b"12")
    watch, changed = watch.look(0.5)
    assert not changed  # not due
    watch, changed = watch.look(1.5)
    assert changed and watch.look(3.0)[1] is False
    # one that is being replaced is waited for
    path.unlink()
    watch, changed = watch.look(9.0)
    assert not changed
    path.write_bytes(b"1234")
    assert watch.look(11.0)[1]


def test_what_is_watched() -> None:
    assert watched_files("a.npy", SceneFile("a.npy")) == ("a.npy",)
    assert watched_files("s.toml", SceneFile("b.npy")) == ("s.toml", "b.npy")
    # a built-in scene is no file, that would be waited for
    assert (
        watched_files("s.toml", SceneFile("tunnel")) == ("s.toml",)
        and watched_files("tunnel", SceneFile("tunnel")) == ()
    )
    # nor is what lies at an address; colours and masks, also of layers, are
    layer = SceneFile("b.npy", load={"color": "c.png"}, mask=("m.nrrd:2,3:outside", "https://host/m.nrrd"))
    assert watched_files("a.npy", SceneFile("a.npy", layers=(layer,))) == ("a.npy", "b.npy", "c.png", "m.nrrd")
    assert watched_files("https://host/a.nrrd", SceneFile("https://host/a.nrrd")) == ()


def test_more_splats_than_can_be_held(monkeypatch: pytest.MonkeyPatch, scene: SceneFile) -> None:
    """A transfer function that keeps everything of something big stays coarse."""
    monkeypatch.setattr("splatgl.viewer.layer_splats.MOST_KEPT", 3000)
    volume = blob(48)
    volumes = (volume, halve_volume(volume), halve_volume(volume), halve_volume(volume))
    layer = replace(Document.open(scene).layers[0], volumes=volumes)
    changed = layer.with_own(replace(layer.own, transfer=sg.Transfer([(-1, 0.5)]), threshold=0.0))
    changed.shell(2)
    assert changed.exceeds_budget
    few = replace(layer.own, transfer=sg.Transfer([(39, 0.0), (40, 0.5)]), threshold=0.0)
    assert not layer.with_own(few).exceeds_budget


def test_values_that_are_kept_serve_no_threshold(scene: SceneFile) -> None:
    """mip keeps values through a threshold; minip, which takes the same, still allows none."""
    document = Document.open(replace(scene, settings=Settings(blend="mip")))
    state = acted(State.of(document, SIZE), "threshold-up", document)
    document = document.with_styles(state.styles, state.mesh_files, state.settings)
    assert state.style.threshold > 0 and not document.layers[0].is_post_classified
    for _ in BLENDS:
        state = acted(state, "blend", document)
        assert not state.settings.needs_values
        document = document.with_styles(state.styles, state.mesh_files, state.settings)
        assert all(len(document.layers[0].at(stride)) for stride in STRIDES)
    # the values are still there for what they are of
    less = replace(state.edit(threshold=0.0), settings=state.settings.replace(blend="mip"))
    assert document.with_styles(less.styles, less.mesh_files, less.settings).layers[0].by_stride


def test_jobs_do_the_newest() -> None:
    started, gate, woken = threading.Event(), threading.Event(), threading.Event()
    jobs = Jobs(woken.set)
    jobs.submit(JobKind.OPEN, "first", lambda: started.set() or (gate.wait(LONGEST) and 1))
    assert started.wait(LONGEST)
    jobs.submit(JobKind.OPEN, "dropped", lambda: 2)
    jobs.submit(JobKind.OPEN, "last", lambda: 1 / 0)
    assert jobs.busy == "last"
    gate.set()
    end = time.monotonic() + LONGEST
    while jobs.busy and time.monotonic() < end:
        # woken before it is done with the job
        time.sleep(0)
    first, last = jobs.collect()
    assert first.value == 1 and isinstance(last.error, ZeroDivisionError) and woken.is_set()
    assert jobs.collect() == []


class Kept:
    """A screen that keeps what it is given."""

    def __init__(self) -> None:
        self.pictures: dict[str, np.ndarray] = {}

    def put(self, name: str, pixels: np.ndarray) -> None:
        self.pictures[name] = pixels


def test_a_frame_tells_the_plan_it_was_drawn_by(scene: SceneFile, renderer: sg.Renderer) -> None:
    document = Document.open(scene)
    kept = Kept()
    painter, state = FrameRenderer(cast(Screen, kept), renderer), State.of(document, SIZE)
    frame = painter.draw(state, document, FULL, False, lambda: False)
    assert kept.pictures["picture"] is painter.pixels
    drawn_by = renderer.plan(document.layers[0].finest, state.pose.camera, state.settings)
    assert frame.info["technique"] == frame.plan.program.technique == drawn_by.program.technique
