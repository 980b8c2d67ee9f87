"""The viewer in a real window, under Xvfb, with real keys, buttons and wheel turns made by xdotool, and real drops."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

import splatgl as sg
from splatgl.cli.main import main
from splatgl.comparison.image_regression import ImageRegression
from splatgl.data.color import linear_from_srgb
from splatgl.planning.bricks import bricks_of, estimate_need
from splatgl.splat.settings import choices
from splatgl.viewer import transfer_editor
from splatgl.viewer.adaptive_quality import PIXELS
from splatgl.viewer.commands import COMMANDS
from tests.helpers.blobs import blob
from tests.helpers.window import (
    DRAG_SOURCE,
    MISSING,
    PATIENCE,
    SIZE,
    Told,
    Window,
    pointed,
    resized,
    shown,
    silent,
    start_display,
)

pytestmark = [
    pytest.mark.usefixtures("shared_programs"),
    pytest.mark.skipif(bool(MISSING), reason=f"needs {' and '.join(MISSING)}: apt-get install xvfb xdotool"),
]


@pytest.fixture(scope="module")
def display() -> Iterator[str]:
    server, name = start_display()
    yield name
    server.terminate()
    server.wait(PATIENCE)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("view")
    np.save(place / "blob.npy", blob().samples)
    np.save(place / "other ä %41.npy", blob(16).samples[:, ::-1])
    (place / "bad.npy").write_bytes(b"\x93NUMPY not quite")
    return place


@pytest.fixture(scope="module")
def shared_window(folder: Path) -> Iterator[Window]:
    window = Window(folder / "blob.npy", folder)
    yield window
    window.end()


@pytest.fixture
def window(shared_window: Window) -> Window:
    """The module's window, as it began."""
    shared_window.ask("reset")
    shared_window.hands("mousemove", 120, 90)
    return shared_window


# --- every key of the table ---------------------------------------------------------------------------------------


def direction(told: Told) -> np.ndarray:
    return np.array(told["axes"])[2]


def looks(x: float, y: float, z: float) -> Callable[[Told, Told], bool]:
    return lambda before, after: np.allclose(direction(after), (x, y, z), atol=1e-6)


def next_choice(name: str) -> Callable[[Told, Told], bool]:
    """The next value that this volume allows, or a word why there is none."""

    def check(before: Told, after: Told) -> bool:
        if len(choices()[name]) < 2:
            return f"{name} is always" in after["message"]
        chosen = choices()[name][1]
        return after["settings"][name] == chosen and after["message"].startswith(f"{name} {chosen}")

    return check


def turned(axes: tuple[int, int], way: int) -> Callable[[Told, Told], bool]:
    """About +z: the angle of the direction in the plane of two axes."""

    def check(before: Told, after: Told) -> bool:
        a, b = (direction(told)[list(axes)] for told in (before, after))
        return way * float(a[0] * b[1] - a[1] * b[0]) > 0.1

    return check


def rolled(before: Told, after: Told) -> float:
    """How far the scene is rolled clockwise: what was to the right is now lower."""
    return float(np.array(after["axes"])[1] @ np.array(before["axes"])[0])


def toggles(name: str) -> Callable[[Told, Told], bool]:
    return lambda before, after: after[name] is (not before[name])


def told_of_dialog(after: Told) -> bool:
    """A dialog is open, or what it takes is said."""
    return after["dialog"] or "pip install" in after["message"]


def files(after: Told, pattern: str) -> bool:
    return "saved" in after["message"] and any(Path(after["source"]).parent.glob(pattern))


CHECKS: dict[str, Callable[[Told, Told], bool]] = {
    "reset": lambda before, after: np.allclose(after["eye"], before["eye"]),
    "isometric": looks(-0.57735, 0.57735, -0.57735),
    "front": looks(0, 1, 0),
    "back": looks(0, -1, 0),
    "right": looks(-1, 0, 0),
    "left": looks(1, 0, 0),
    "top": looks(0, 0, -1),
    "bottom": looks(0, 0, 1),
    "projection": toggles("perspective"),
    "blend": next_choice("blend"),
    "antialias": next_choice("antialias"),
    "align": next_choice("align"),
    "motion": lambda before, after: (before["blur"], after["blur"]) == ("off", "moments"),
    "attenuation": next_choice("attenuation"),
    "compositing": next_choice("compositing"),
    "classification": next_choice("classification"),
    "beyond": toggles("beyond"),
    "compare": lambda before, after: after["compare"] == "split" and after["reference"],
    "opacity-down": lambda before, after: after["points"][-1][1] < before["points"][-1][1],
    "opacity-up": lambda before, after: after["points"][-1][1] > before["points"][-1][1],
    "threshold-down": lambda before, after: after["threshold"] < before["threshold"],
    "threshold-up": lambda before, after: after["threshold"] > before["threshold"],
    "turn": toggles("turning"),
    "screenshot": lambda before, after: files(after, "picture-*.png"),
    "save": lambda before, after: files(after, "scene-*.toml") and files(after, "scene-*.npy"),
    "undo": lambda before, after: "to undo" in after["message"] or "undone" in after["message"],
    "redo": lambda before, after: "to redo" in after["message"],
    "hud": lambda before, after: (before["hud"], after["hud"]) == ("short", "full"),
    "palette": lambda before, after: after["dialog"] or "pip install" in after["message"],
    "close": lambda before, after: before["help"] and not after["help"] and not after["closed"],
    "play": lambda before, after: "one point in time" in after["message"],
    "earlier": lambda before, after: "one point in time" in after["message"],
    "later": lambda before, after: "one point in time" in after["message"],
    "panel": lambda before, after: after["panel"] != before["panel"] or "pip install" in after["message"],
    "ground": lambda before, after: before["settings"]["background"] != after["settings"]["background"],
    "help": toggles("help"),
    "open": lambda before, after: told_of_dialog(after),
    "add-layer": lambda before, after: told_of_dialog(after),
    "save-as": lambda before, after: told_of_dialog(after),
    "turn-left": turned((0, 1), 1),
    "turn-right": turned((0, 1), -1),
    "turn-up": lambda before, after: direction(after)[2] < direction(before)[2] - 0.1,
    "turn-down": lambda before, after: direction(after)[2] > direction(before)[2] + 0.1,
    "zoom-in": lambda before, after: np.subtract(after["eye"], before["eye"]) @ direction(before) > 0.5,
    "zoom-out": lambda before, after: np.subtract(after["eye"], before["eye"]) @ direction(before) < -0.5,
    "roll-left": lambda before, after: rolled(before, after) < -0.1,
    "roll-right": lambda before, after: rolled(before, after) > 0.1,
    "turntable": toggles("turntable"),
    "annotations": lambda before, after: before["annotate"] == ["scale", "axes"] and not after["annotate"],
    "colorbar": lambda before, after: "colorbar" in after["annotate"],
    "legend": lambda before, after: "legend" in after["annotate"],
    "box": lambda before, after: "box" in after["annotate"],
    "probe": toggles("probe"),
    "measure": lambda before, after: after["ruler"]["active"] and "click" in after["message"],
    "slices": lambda before, after: after["slices"]["shown"] and after["size"][0] < before["size"][0],
    "slice-colors": lambda before, after: after["slices"]["colored"] and after["slices"]["shown"],
    "large-slice": lambda before, after: after["slices"]["large"] is not None and after["slices"]["shown"],
    "linked-crosshair": lambda before, after: after["slices"]["linked"] and after["slices"]["shown"],
    "slices-in-space": lambda before, after: after["slices"]["in_space"],
    **{
        f"turn-slices-{way}{axis}": lambda before, after: after["slices"]["turn"] != before["slices"]["turn"]
        for way in ("", "back-")
        for axis in "xyz"
    },
    "straighten-slices": lambda before, after: after["slices"]["turn"] == before["slices"]["turn"],
    "light": lambda before, after: (before["settings"]["light"], after["settings"]["light"]) == ("head", "matte"),
    "fullscreen": lambda before, after: after["fullscreen"] and after["size"] == [640, 480],
    "pin": lambda before, after: after["size"][0] == before["size"][0] // 2,
    "handles": lambda before, after: after["cuts"]["shown"] != before["cuts"]["shown"],
    "cuts": lambda before, after: "nothing is cut" in after["message"],
    "plane": lambda before, after: len(after["settings"]["clip"]) == 1 and after["cuts"]["shown"],
    "uncut": lambda before, after: "nothing is cut" in after["message"],
    "scissors": lambda before, after: "draw a lasso around the part to remove" in after["message"],
    "scissors-keep": lambda before, after: "draw a lasso around the part to keep" in after["message"],
    "focus": lambda before, after: after["focused"] or "pip install" in after["message"],
    "quit": lambda before, after: after["closed"],
}


@pytest.mark.parametrize(
    ("action", "key"), [(command.id, key) for command in COMMANDS for key in command.keys], ids=str
)
@pytest.mark.long
def test_every_key_does_what_the_help_says(window: Window, action: str, key: str) -> None:
    before = window.ask("look")
    if action == "reset":
        assert not np.allclose(window.drag(1, (100, 90), (150, 60))["eye"], before["eye"])
    if action == "threshold-down":
        before = window.key(".")
    if action == "close":
        before = window.key("?")
    if action == "turn":
        window.hands("key", "space")
        after = window.ask("look")
        assert not np.allclose(window.until(lambda told: told["eye"] != after["eye"])["eye"], after["eye"])
    elif action == "compare":
        with resized(window, 60, 45):
            after = window.key(key)
    else:
        after = window.key(key)
    assert CHECKS[action](before, after), (before, after)
    # what it does is another picture, another word, or another file
    if action == "beyond":
        assert any("z_k" in line for line in after["hud lines"])


@pytest.mark.long
def test_escape_leaves_fullscreen(window: Window) -> None:
    assert window.key("f11")["fullscreen"]
    assert not window.key("escape")["fullscreen"]


@pytest.mark.long
def test_motion_blur_is_seen_while_the_view_is_turned(window: Window) -> None:
    """A blurred picture, even one with all pixels and voxels, is replaced by a still at rest."""
    window.key("m")
    window.hands("key", "space")
    turning = [window.ask("look") for _ in range(3)][-1]
    assert turning["blurred"] and not turning["full"]
    assert window.until(lambda told: any("blurred" in line for line in told["hud lines"]))["turning"]
    still = window.key("space")
    assert still["full"] and not still["blurred"]
    # a jump to another view is no motion
    assert not window.key("3")["blurred"]


@pytest.mark.long
def test_the_help_is_shown(window: Window) -> None:
    # the value under the cursor is read in a thread
    window.ask("settle")
    before = window.shot()
    window.key("?")
    assert np.abs(window.shot().astype(int) - before).max() > 100
    window.key("?")
    assert np.abs(window.shot().astype(int) - before).mean() < 0.5


# --- the mouse ----------------------------------------------------------------------------------------------------


@pytest.mark.long
def test_left_turns(window: Window) -> None:
    before = window.ask("look")
    after = window.drag(1, (100, 90), (140, 70))
    assert not np.allclose(after["axes"], before["axes"], atol=0.05)
    apart = [np.linalg.norm(np.subtract(told["eye"], told["pivot"])) for told in (before, after)]
    assert apart[0] == pytest.approx(apart[1]) and after["full"]


@pytest.mark.long
@pytest.mark.parametrize(("button", "held"), [(1, "shift"), (2, "")])
def test_panning(window: Window, button: int, held: str) -> None:
    before = window.ask("look")
    after = window.drag(button, (100, 90), (130, 90), held)
    moved = np.subtract(after["eye"], before["eye"])
    assert np.allclose(after["axes"], before["axes"]) and moved @ np.array(before["axes"])[0] < -0.1
    assert abs(moved @ np.array(before["axes"])[2]) < 1e-9


@pytest.mark.long
def test_ctrl_rolls(window: Window) -> None:
    before = window.ask("look")
    after = window.drag(1, (200, 90), (120, 160), "ctrl")
    assert np.allclose(direction(after), direction(before)) and not np.allclose(after["axes"], before["axes"], atol=0.5)


@pytest.mark.long
def test_the_wheel_zooms_to_the_cursor(window: Window) -> None:
    before = window.ask("look")
    window.hands("mousemove", 180, 50, "click", 4, "click", 4)
    after = window.ask("settle")
    moved = np.array(before["axes"]) @ np.subtract(after["eye"], before["eye"])
    # nearer, and to the right and upwards, where the cursor is
    assert moved[2] > 0 and moved[0] > 0 and moved[1] < 0
    window.hands("click", 5, "click", 5)
    assert np.allclose(window.ask("settle")["eye"], before["eye"])


@pytest.mark.long
def test_a_picture_that_is_being_refined_gives_way(window: Window) -> None:
    before = window.ask("look")
    assert window.ask("nudge")["same"]
    after = window.ask("settle")
    assert after["full"] and np.subtract(after["eye"], before["eye"]) @ direction(before) > 0.5


@pytest.mark.long
def test_right_zooms(window: Window) -> None:
    before = window.ask("look")
    after = window.drag(3, (120, 90), (120, 50))
    assert np.subtract(after["eye"], before["eye"]) @ direction(before) > 0.5


def test_clicks_measure(window: Window) -> None:
    """Two clicks a distance, which the picture shows, as do the next two; ctrl+z takes it back."""
    window.key("e")
    window.hands("mousemove", 112, 90, "click", 1, "mousemove", 128, 90, "click", 1)
    told = window.ask("settle")
    assert [len(each["points"]) for each in told["measures"]] == [2] and told["message"].startswith("distance")
    assert told["ruler"]["active"] and not told["ruler"]["points"] and "measures" in told["annotate"]
    assert not window.key("ctrl+z")["measures"]


@pytest.mark.long
def test_double_click_sets_the_pivot(window: Window) -> None:
    before = window.ask("double", within=PATIENCE)
    window.hands("mousemove", 120, 90, "click", 1, "click", 1)
    after = window.ask("settle")
    assert after["message"] == "turns about this point" and np.allclose(after["eye"], before["eye"])
    # on the ball's front, not in its middle
    assert np.subtract(after["pivot"], before["pivot"]) @ direction(before) < -2
    window.hands("mousemove", 3, 3, "click", 1, "click", 1)
    assert window.ask("settle")["message"] == "nothing here to turn about"


# --- the picture --------------------------------------------------------------------------------------------------


def test_the_window_shows_what_is_saved(window: Window, folder: Path) -> None:
    """With nothing written over it, the window holds the picture on black; render makes the same of the scene."""
    silent(window)
    window.drag(1, (100, 90), (140, 70))
    shown = window.shot()
    name = window.key("s")["message"].split()[-1]
    scene = window.key("shift+s")["message"].split()[-1]
    saved = sg.Image.load(folder / name)
    floats = sg.Image.load((folder / scene).with_suffix(".npy"))
    straight = np.rint(floats.over((0.0, 0.0, 0.0)).straight()[..., :3] * 255)
    assert np.abs(straight - shown).max() <= 1 and straight.max() > 60
    assert np.array_equal(floats.rounded().pixels, saved.pixels)
    assert main(["render", str(folder / scene), "-o", str(folder / "again.png"), "--backend", "egl", "--quiet"]) == 0
    assert np.array_equal(sg.Image.load(folder / "again.png").pixels, saved.pixels)
    assert main(["render", str(folder / scene), "-o", str(folder / "again.npy"), "--backend", "egl", "--quiet"]) == 0
    assert np.array_equal(np.load(folder / "again.npy"), np.load((folder / scene).with_suffix(".npy")))


@pytest.mark.long
def test_the_reference_beside_it(window: Window) -> None:
    silent(window)
    # a volume of fewer pixels, which the reference takes its time for
    window.hands("mousemove", 120, 90, "click", "--repeat", 5, "--delay", 2, 5)
    window.ask("settle")
    plain = window.shot().astype(int)
    assert "left: this picture" not in window.ask("look")["message"]
    split = window.key("d")
    shown = window.shot().astype(int)
    assert split["reference"] and np.abs(shown - plain)[:90, :115].max() <= 1
    # the same picture on the right, but for the last digits, and a line between them
    assert np.abs(shown - plain)[:90, 125:].max() <= 2 and (shown[:90, 119:121] == 255).any()
    assert window.key("d")["compare"] == "difference"
    # scaled to its largest, which need not be in the upper half
    assert window.shot()[:90].max() > 20 and np.abs(window.shot()[:90] - plain[:90]).max() > 20
    assert window.key("d")["compare"] == "off" and np.abs(window.shot() - plain).max() <= 1


@pytest.fixture
def values(folder: Path) -> Iterator[Window]:
    """A window with a scene that is classified after reconstruction."""
    scene = 'volume = "blob.npy"\n[transfer]\npoints = [[4.0, 0.0], [30.0, 0.6]]\ncolormap = "hot"\n'
    (folder / "post.toml").write_text(scene + '[settings]\nclassification = "post"\nantialias = "off"\n')
    window = Window(folder / "post.toml", folder, size=(400, 300))
    yield window
    window.end()


@pytest.mark.long
def test_values_classified_after_reconstruction(values: Window, folder: Path) -> None:
    """The window draws them, and splats classified before where only those can be drawn, and says so."""
    window = values

    def told_of(told: Told, what: str) -> bool:
        return any(what in line for line in told["hud lines"])

    plain = window.ask("settle")
    assert plain["full"] and told_of(plain, "classified after") and not told_of(plain, "because of")
    silent(window)
    after = window.shot().astype(int)
    saved = window.key("s")["message"].split()[-1]
    assert sg.Image.load(folder / saved).info["classification"] == "post"
    straight = sg.Image.load(folder / saved).over((0.0, 0.0, 0.0)).straight()[..., :3] * 255
    assert np.abs(straight - after)[:250].max() < 2 and after.max() > 100
    # other blends; back, and with another transfer function
    window.key("i")
    xray, mip = window.key("b"), window.key("b")
    assert [told["settings"]["blend"] for told in (xray, mip)] == ["xray", "mip"]
    assert told_of(mip, "classified after") and xray["splats"] == plain["splats"] < mip["splats"]
    while window.key("b")["settings"]["blend"] != "composite":
        pass
    edited = window.key("]")
    assert told_of(edited, "classified after") and edited["splats"] == plain["splats"] and edited["full"]
    assert edited["points"][1][1] > plain["points"][1][1]
    # motion blur, the mean of such pictures, or streaks, which are of voxels; and at rest
    window.key("m")
    window.hands("key", "space")
    turning = window.until(lambda told: told["blurred"])
    assert (
        turning["turning"] and told_of(turning, "classified after") and not told_of(turning, "because of motion exact")
    )
    window.key("space")
    window.key("m")
    window.hands("key", "space")
    turning = window.until(lambda told: told["blurred"])
    assert turning["blurred"] and window.until(lambda told: told_of(told, "because of motion exact"))["turning"]
    still = window.key("space")
    assert still["full"] and told_of(still, "classified after")
    window.key("m")
    # what is under the cursor
    before = window.ask("double", within=PATIENCE)
    window.hands("mousemove", 200, 150, "click", 1, "click", 1)
    pivoted = window.ask("settle")
    assert pivoted["message"] == "turns about this point"
    assert np.subtract(pivoted["pivot"], before["pivot"]) @ direction(before) < -2
    # by a key: pre, auto, and post again
    for asked in ("pre", "auto", "post"):
        told = window.key("c")
        assert told["settings"]["classification"] == asked and told_of(told, "classified after") == (asked != "pre")
    # the float64 reference of the same values: last, as each change would draw it again
    with resized(window, 80, 60):
        assert window.key("d")["reference"] and told_of(window.ask("look"), "classified after")


@pytest.mark.long
def test_the_first_pictures_are_from_the_right_eye(tmp_path: Path) -> None:
    """What is shown of a file that is still being extracted is the whole of it, not its corner."""
    np.save(tmp_path / "large.npy", np.kron(blob(30).samples, np.ones((3, 3, 3), np.float32)))
    window = Window(tmp_path / "large.npy", tmp_path, behind=True)
    told = window.state
    assert told["full"] and len(told["eyes"]) > 1
    apart = np.linalg.norm(np.array(told["eyes"]) - told["eye"], axis=1)
    assert apart.max() < 0.1 * np.linalg.norm(np.subtract(told["eye"], told["middle"]))
    # in full once: splats that change nothing in the view do not draw it again
    assert told["levels"].count("in full") == 1
    window.end()


@pytest.mark.long
def test_what_cannot_be_extracted_leaves_the_picture(values: Window) -> None:
    """The window says why, its keys work on, and it goes on once something else is asked for."""
    window = values
    plain = window.ask("settle")
    told = window.ask("set", style={"threshold": 0.2}, settings={"blend": "mean"})
    assert "because of threshold" in told["message"] and told["splats"] == plain["splats"]
    # the views need something to look at
    for key in ("r", "1", "ctrl+z", "ctrl+shift+z"):
        window.hands("key", key)
    told = window.ask("look")
    assert not told["closed"] and told["splats"] == plain["splats"]
    # no key hides that the picture is another one
    window.hands("key", "r")
    window.ask("look")
    assert "because of threshold" in window.ask("look")["message"]
    told = window.ask("set", style={"threshold": 0.0})
    assert "because of" not in window.ask("settle")["message"]
    told = window.ask("settle")
    assert told["full"] and told["settings"]["blend"] == "mean" and told["splats"] > plain["splats"]


@pytest.mark.long
def test_z_k_is_shown(window: Window) -> None:
    """Far enough off, the plane is in front of the volume: all is tinted, and nothing of it in its colours."""
    silent(window)
    # one sample a pixel: with more, z_k is further away
    assert window.key("a")["settings"]["antialias"] == "paper"
    plain = window.shot().astype(int)
    window.hands("mousemove", 120, 90, "click", "--repeat", 16, "--delay", 2, 5)
    window.ask("settle")
    far = window.shot().astype(int)
    tinted = window.key("k")
    shown = window.shot().astype(int)
    assert tinted["beyond"] and np.abs(shown - far).max() > 30 and np.abs(far - plain).max() > 30
    middle = (far.sum(axis=2) < 600) & (np.indices(far.shape[:2])[0] < 130)
    assert (shown[middle][:, 0] - shown[middle][:, 2]).mean() > 20


@pytest.mark.long
def test_a_turned_view_keeps_to_its_baseline(folder: Path, splatgl_image: ImageRegression) -> None:
    """What real hands and keys make of the picture is the same as ever: every other pixel of a window of its own."""
    window = Window(folder / "blob.npy", folder)
    silent(window)
    before = window.ask("look")
    turned = window.drag(1, (100, 90), (140, 60))
    assert not np.allclose(turned["axes"], before["axes"], atol=0.05) and turned["pivot"] == before["pivot"]
    window.hands("mousemove", 170, 60, "click", 4, "click", 4)
    nearer = window.ask("settle")
    assert np.subtract(nearer["eye"], turned["eye"]) @ direction(turned) > 0.5
    encoded = window.shot()[::2, ::2]
    window.end()
    light = linear_from_srgb(encoded / 255.0).astype(np.float32)
    image = sg.Image(np.concatenate([light, np.ones_like(light[..., :1])], axis=-1), {"renderer": "llvmpipe"})
    splatgl_image(image, name="turned", tolerance=0.02)


@pytest.mark.long
def test_resizing(window: Window) -> None:
    identity = window.identity
    window.hands("windowsize", "--sync", identity, 300, 200)
    assert window.ask("settle")["size"] == [300, 200]
    assert window.shot().shape == (200, 300, 3)
    window.hands("windowsize", "--sync", identity, *SIZE)
    assert window.ask("settle")["size"] == list(SIZE)


# --- files --------------------------------------------------------------------------------------------------------


@pytest.mark.long
def test_dropped_files(window: Window, folder: Path) -> None:
    """Another volume is opened; a bad one says why, and what is shown stays."""
    # whatever another test has left
    first = window.drop(folder / "blob.npy")["splats"]
    after = window.drop(folder / "other ä %41.npy")
    assert after["source"].endswith("other ä %41.npy") and after["splats"] != first and after["full"]
    shown = window.shot()
    for name, words in (("bad.npy", "bad.npy"), ("nothing.npy", "got no such file")):
        after = window.drop(folder / name)
        assert words in "".join([after["message"], *after["asked"]]) and after["source"].endswith("other ä %41.npy")
        assert not np.array_equal(window.shot(), shown)
        # a window that has a panel tells it in a box
        told = window.key("escape") if after["asked"] else after
        assert not told["asked"]
        # the same picture but for the words, of many lines where the path is long
        assert np.array_equal(window.shot()[:5], shown[:5])
    assert window.drop(folder / "blob.npy")["splats"] == first


@pytest.mark.long
def test_several_dropped_files_are_a_series(window: Window, tmp_path: Path) -> None:
    """Sorted by their numbers, in one view and one transfer function; each once, and around again when played."""
    for number, side in ((10, 24), (2, 16), (1, 20)):
        # the first one spreads most: no note
        np.save(tmp_path / f"t{number}.npy", blob(side).samples * (1 + (number == 1)))
    told = window.drop(*(tmp_path / f"t{number}.npy" for number in (10, 1, 2)))
    assert told["times"] == 3 and told["source"].endswith("t1.npy")
    turned = window.drag(1, (100, 90), (140, 70))
    later = window.key(">")
    assert later["source"].endswith("t2.npy") and later["axes"] == turned["axes"]
    assert later["points"] == turned["points"]
    assert window.key(">")["source"].endswith("t10.npy") and window.key("<")["source"].endswith("t2.npy")
    window.hands("key", "Return")
    seen = set()
    window.until(lambda told: seen.add(told["source"][-7:]) or len(seen) == 3)
    assert len(seen) == 3
    assert not window.key("enter")["playing"]


@pytest.mark.long
def test_watching(tmp_path: Path) -> None:
    np.save(tmp_path / "v.npy", blob().samples)
    window = Window(tmp_path / "v.npy", tmp_path, watched=[str(tmp_path / "v.npy")], target=1e-6)
    # the whole text, for which the preview is compared
    window.key("i")
    # with no time at all for a frame, what moves is coarse (as coarse as is quickest), and what rests is not
    window.hands("mousemove", 100, 90, "key", "space")
    moving = window.until(lambda told: any("moving: " in line for line in told["hud lines"]))
    assert any("% of the pixels" in line for line in moving["hud lines"]), moving["hud lines"]
    assert not moving["full"] and "of the pixels" in moving["level"] and moving["turning"]
    turned = window.ask("stop")
    assert turned["full"] and any("refined to 1/255" in line for line in turned["hud lines"])
    assert any("in motion it was off by RMSE 0.0" in line for line in turned["hud lines"]), turned["hud lines"]
    np.save(tmp_path / "new.npy", blob().samples * (blob().samples > 20))
    (tmp_path / "new.npy").replace(tmp_path / "v.npy")
    window.until(lambda told: told["splats"] != turned["splats"])
    after = window.ask("settle")
    assert after["splats"] < turned["splats"] and np.allclose(after["eye"], turned["eye"])
    # closing it as a window manager does
    assert window.ask("close")["closed"]
    window.end()


@pytest.mark.long
def test_a_file_of_time_points_has_a_slider(tmp_path: Path) -> None:
    """Its ends are the first and the last one, which keys go through, too; a view stays."""
    pytest.importorskip("imgui_bundle", reason="needs the extra gui: pip install splatgl[gui]")
    tifffile = pytest.importorskip("tifffile")
    series = np.stack([blob().samples * (blob().samples > low) for low in (0, 10, 20)]).astype(np.uint8)
    tifffile.imwrite(tmp_path / "t.tif", series, imagej=True, metadata={"axes": "TZYX"})
    window = Window(tmp_path / "t.tif", tmp_path, size=(600, 450), panel=True)
    window.drop(tmp_path / "t.tif")
    # moved beside the panel
    window.drag(2, (230, 200), (60, 200))
    first = window.ask("settle")
    assert (first["times"], first["time"]) == (3, 0)
    window.ask("shot", path=str(tmp_path / "first.npy"))
    window.hands("mousemove", SLIDER[1], SLIDER[2], "mousedown", 1)
    window.ask("look")
    window.hands("mouseup", 1)
    window.until(lambda told: told["time"] == 2)
    last = window.ask("settle")
    assert last["time"] == 2 and last["eye"] == first["eye"]
    window.ask("shot", path=str(tmp_path / "last.npy"))
    # beside the panel
    before, after = (np.load(tmp_path / name)[100:, :250].astype(int) for name in ("first.npy", "last.npy"))
    assert np.abs(after - before).max() > 50
    window.hands("mousemove", SLIDER[0], SLIDER[2], "mousedown", 1)
    window.ask("look")
    window.hands("mouseup", 1)
    window.until(lambda told: told["time"] == 0)
    window.ask("settle")
    window.ask("shot", path=str(tmp_path / "again.npy"))
    assert np.array_equal(np.load(tmp_path / "again.npy")[100:, :250], np.load(tmp_path / "first.npy")[100:, :250])
    assert window.key(">")["time"] == 1
    # on the file where it is opened and where it is dropped, not on each time point
    window.end(notes=2)


@pytest.mark.long
def test_memory_stays(window: Window, folder: Path) -> None:
    """Many pictures and several files leave nothing behind."""
    window.hands("mousemove", 100, 90, "mousedown", 1)
    window.ask("turn", times=60)
    began = window.ask("turn", times=20)
    after = window.ask("turn", times=120)
    window.hands("mouseup", 1)
    # a picture that each frame left would be 17 MB or more; a machine that many share changes the level by some
    assert after["megabytes"] - began["megabytes"] < 8 and after["textures"] == began["textures"] == 3
    for number in range(6):
        told = window.drop(folder / ("other ä %41.npy" if number % 2 else "blob.npy"))
        began = told if number == 2 else began
    assert told["megabytes"] - began["megabytes"] < 8 and told["documents"] <= began["documents"] + 1


@pytest.mark.long
def test_edits_leave_nothing_behind(values: Window) -> None:
    """Contents refer to themselves, and hold what is extracted: those of edits that are over are freed at rest."""
    window = values
    before = window.ask("settle")["documents"]
    for _ in range(12):
        window.key("]")
    # but for those that undo, and what is shown, may hold
    assert window.ask("settle")["documents"] <= before + 2


@pytest.mark.long
def test_memory_stays_where_the_window_is_resized(panel: Window) -> None:
    """Pictures of other sizes leave no room behind that none of them fits."""
    sizes = (640, 480), (450, 350), (600, 450)
    megabytes = []
    far(panel)
    for _ in range(6):
        for size in sizes:
            panel.hands("windowsize", "--sync", panel.identity, *size)
            told = panel.ask("settle")
        megabytes.append(told["megabytes"])
    # it grew by a hundred where freed pictures were kept
    assert max(megabytes[4:]) - max(megabytes[1:4]) < 15, megabytes


# --- the panel ----------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def panel(folder: Path) -> Iterator[Window]:
    pytest.importorskip("imgui_bundle", reason="needs the extra gui: pip install splatgl[gui]")
    window = Window(folder / "blob.npy", folder, size=(600, 450), panel=True)
    yield window
    window.end()


def far(window: Window) -> Told:
    """Small in the window, the volume is drawn at once."""
    window.hands("mousemove", 100, 200, "click", "--repeat", 16, "--delay", 2, 5)
    return window.ask("settle")


# left and right ends of the slider of time points, and its height, in a window 600 pixels wide
SLIDER = 364, 564, 66
# left end of the panel, in a window 600 pixels wide, and the axis of opacities
LEFT, AXIS = 276, (-0.05, 1.05)


def on_plot(told: Told, value: float, opacity: float) -> tuple[int, int]:
    """Pixel of a node of the opacity curve."""
    (left, top, wide, high), (low, stop) = told["plot"]
    share = (AXIS[1] - float(transfer_editor.axis_from_opacity(opacity))) / (AXIS[1] - AXIS[0])
    return round(left + (value - low) / (stop - low) * wide), round(top + share * high)


@pytest.mark.long
def test_the_panel_edits_the_curve(panel: Window) -> None:
    """A double click adds a point, which is dragged; right and ctrl click remove it; all are undone."""
    panel.ask("reset")
    before = far(panel)
    told = panel.key("tab")
    panel.ask("double", within=PATIENCE)
    place = on_plot(told, 20.0, 0.5)
    pointed(panel, *place)
    panel.hands("click", 1, "click", 1)
    added = panel.ask("settle")
    new = [node for node in added["points"] if node not in before["points"]]
    assert len(new) == 1 and new[0] == pytest.approx((20.0, 0.5), abs=0.3)
    pointed(panel, *on_plot(told, *new[0]))
    after = panel.drag(1, place, (place[0] + 20, place[1] + 30))
    moved = [node for node in after["points"] if node not in before["points"]]
    assert len(moved) == 1 and on_plot(told, *moved[0]) == pytest.approx((place[0] + 20, place[1] + 30), abs=2)
    assert after["full"] and np.allclose(after["eye"], before["eye"])
    pointed(panel, *on_plot(told, *moved[0]))
    panel.hands("click", 3)
    assert panel.ask("settle")["points"] == before["points"]
    assert panel.key("ctrl+z")["points"] == after["points"]
    panel.hands("keydown", "ctrl", "click", 1, "keyup", "ctrl")
    assert panel.ask("settle")["points"] == before["points"]
    assert panel.key("ctrl+z")["points"] == after["points"] and panel.key("ctrl+z")["points"] == added["points"]
    assert panel.key("ctrl+z")["points"] == before["points"]
    assert panel.key("ctrl+shift+z")["points"] == added["points"]


@pytest.mark.long
def test_a_drag_during_one_frame_ends_where_the_button_is_released(panel: Window) -> None:
    panel.ask("reset")
    told = panel.key("tab")
    before = told["points"]
    start = on_plot(told, *before[1])
    stop = start[0] + 25, start[1] + 20
    told = panel.ask("hurry", places=(start, stop, (stop[0] - 60, 400)))
    moved = [node for node in told["points"] if node not in before]
    assert len(moved) == 1 and on_plot(told, *moved[0]) == pytest.approx(stop, abs=2)


@pytest.mark.long
def test_the_curve_is_zoomed_and_moved(panel: Window) -> None:
    """By the wheel about the cursor, and by a drag where no point is; no point changes."""
    panel.ask("reset")
    before = panel.key("tab")
    place = on_plot(before, 15.0, 0.03)
    pointed(panel, *place)
    panel.hands("click", 4)
    near = panel.ask("settle")
    (low, high), (first, last) = near["plot"][1], before["plot"][1]
    assert high - low < 0.95 * (last - first) and on_plot(near, 15.0, 0.03) == pytest.approx(place, abs=1)
    pointed(panel, *place)
    panel.hands("mousedown", 1)
    pointed(panel, place[0] + 20, place[1])
    pointed(panel, place[0] + 40, place[1])
    panel.hands("mouseup", 1)
    moved = panel.ask("settle")
    assert on_plot(moved, 15.0, 0.03)[0] == pytest.approx(place[0] + 40, abs=2)
    assert moved["points"] == before["points"] and np.allclose(moved["eye"], before["eye"])


@pytest.mark.long
def test_the_panel_answers_while_the_picture_is_drawn(panel: Window) -> None:
    """It is folded by the arrow in its title between two portions of a picture, which is not begun again."""
    panel.ask("reset")
    panel.key("tab")
    arrow = LEFT - 2, 18
    told = panel.ask("click", place=arrow)
    assert told["during"][3] < told["before"][3] / 2 and told["pictures"] == 1
    panel.hands("mousemove", *arrow, "click", 1)
    assert panel.ask("settle")["place"] == pytest.approx(told["before"])


@pytest.mark.long
def test_the_panel_takes_no_shortcuts(panel: Window) -> None:
    """Beside the panel the mouse turns the view, over it it does not; keys are keys."""
    panel.ask("reset")
    before = panel.key("tab")
    turned = panel.drag(1, (100, 200), (140, 180))
    assert not np.allclose(turned["eye"], before["eye"])
    panel.hands("mousemove", LEFT + 20, 300)
    assert panel.key("b")["settings"]["blend"] == "xray"
    assert np.ptp(panel.shot()[20:300, LEFT:].astype(int)) > 100


# --- ends ---------------------------------------------------------------------------------------------------------


def view(display: str, source: Path) -> subprocess.Popen[str]:
    """`splatgl view` itself, once its window shows all there is."""
    environment = {**os.environ, "DISPLAY": display}
    command = [sys.executable, "-m", "splatgl", "view", str(source), "--no-panel", "--size", "100x80"]
    process = subprocess.Popen(command, env=environment, stderr=subprocess.PIPE, text=True)
    shown(environment, process.pid, "refined")
    return process


@pytest.mark.long
def test_a_volume_larger_than_memory(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Every so many voxels at once, then as small means as fit, in the same view; another file is not replaced."""
    samples = blob(64).samples
    np.save(folder / "large.npy", samples)
    volume = sg.load(folder / "large.npy")
    bricks = bricks_of(volume, sg.default_transfer(volume), sg.Settings())
    assert bricks is not None
    # a byte less than all voxels need
    free = estimate_need(bricks, PIXELS, 0).bytes - 1
    window = Window(folder / "large.npy", folder, free=free)
    told = window.until(lambda told: any("means of" in line for line in told["hud lines"]))
    assert any("means of 2^3 voxels: smaller ones need more than" in line for line in told["hud lines"])
    assert told["splats"] < samples.size / 7
    other = window.drop(folder / "blob.npy")
    assert not any("voxels: " in line for line in window.ask("settle")["hud lines"]) and other["splats"] > 0
    window.end()


def test_ctrl_c(display: str, folder: Path) -> None:
    process = view(display, folder / "blob.npy")
    process.send_signal(signal.SIGINT)
    assert process.communicate(timeout=PATIENCE) == (None, "") and process.returncode == 0


@pytest.mark.long
def test_a_display_that_goes_away(folder: Path) -> None:
    server, name = start_display()
    process = view(name, folder / "blob.npy")
    server.terminate()
    server.wait(PATIENCE)
    _, error = process.communicate(timeout=PATIENCE)
    assert error == "splatgl: window: the display went away\n" and process.returncode == 2


@pytest.mark.long
def test_a_window_that_goes_away(display: str, folder: Path) -> None:
    """No window manager does that, but it can be done."""
    process = view(display, folder / "blob.npy")
    environment = {**os.environ, "DISPLAY": display}
    subprocess.run(["xdotool", "windowclose", shown(environment, process.pid)], env=environment, check=True)
    _, error = process.communicate(timeout=PATIENCE)
    assert error.startswith("splatgl: window: the window went away (X error ") and len(error.splitlines()) == 1
    assert process.returncode == 2


SHOWN = """
import atexit, gc, os, signal
import splatgl as sg
before = signal.getsignal(signal.SIGTERM), gc.get_freeze_count()
atexit.register(lambda: print("at exit", flush=True))
try:
    sg.show(SOURCE)
except sg.InputError as error:
    print(error, flush=True)
finally:
    print(before == (signal.getsignal(signal.SIGTERM), gc.get_freeze_count()), flush=True)
"""


@pytest.mark.long
def test_a_window_of_a_program_leaves_its_process_alone(folder: Path) -> None:
    """A display that goes away raises; the program goes on and ends as it says."""
    server, name = start_display()
    environment = {**os.environ, "DISPLAY": name}
    text = SHOWN.replace("SOURCE", repr(str(folder / "blob.npy")))
    process = subprocess.Popen([sys.executable, "-c", text], env=environment, stdout=subprocess.PIPE, text=True)
    shown(environment, process.pid, "refined")
    server.terminate()
    server.wait(PATIENCE)
    told, _ = process.communicate(timeout=PATIENCE)
    assert told.splitlines() == ["window: the display went away", "True", "at exit"] and process.returncode == 0


@pytest.mark.long
def test_a_drag_whose_source_ends(window: Window, folder: Path) -> None:
    """A file manager that fails in the middle of a drag takes no window with it."""
    window.ask("settle")
    # the window answers when the other one is gone
    window.process.send_signal(signal.SIGSTOP)
    subprocess.run([sys.executable, str(DRAG_SOURCE), window.identity], env=window.environment, check=True)
    window.process.send_signal(signal.SIGCONT)
    assert window.ask("settle")["full"] and window.drop(folder / "blob.npy")["full"]


@pytest.mark.long
def test_a_context_that_fails(window: Window) -> None:
    """One line, which `splatgl view` ends with."""
    assert window.ask("fail")["message"].startswith("window: OpenGL failed: GL_INVALID_ENUM; close other programs")


@pytest.mark.long
def test_a_display_that_is_not_there(folder: Path) -> None:
    command = [sys.executable, "-m", "splatgl", "view", str(folder / "blob.npy")]
    environment = {**os.environ, "DISPLAY": ":9999"}
    run = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=PATIENCE)
    assert run.returncode == 2 and "Failed to open display :9999" in run.stderr and len(run.stderr.splitlines()) == 1


@pytest.mark.long
def test_no_display(folder: Path) -> None:
    environment = {name: value for name, value in os.environ.items() if name not in ("DISPLAY", "WAYLAND_DISPLAY")}
    command = [sys.executable, "-m", "splatgl", "view", str(folder / "blob.npy")]
    run = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=PATIENCE)
    assert run.returncode == 2 and run.stderr.startswith("splatgl: display: expected one that opens a window, got none")
    assert len(run.stderr.splitlines()) == 1


def test_files_of_a_folder_that_cannot_be_written(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """They are looked at, too: only a folder that is named must take files."""
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr("splatgl.fileio.os.access", lambda *_: False)
    for options, word in (([], "display"), (["--folder", str(folder)], "--folder")):
        assert main(["view", str(folder / "blob.npy"), *options]) == 2
        assert capsys.readouterr().err.startswith(f"splatgl: {word}: ")
