"""What is typed and dragged in the panel's fields, by real keys and buttons."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from splatgl.data.color import linear_from_srgb
from splatgl.data.volume import Volume
from splatgl.scene.scene_file import SceneFile
from splatgl.transfer.presets import PRESETS, preset
from splatgl.transfer.statistics import statistics
from splatgl.transfer.transfer import Transfer
from splatgl.viewer.commands import COMMANDS
from splatgl.viewer.document import Document
from splatgl.viewer.state import State
from tests.helpers.blobs import blob
from tests.helpers.window import MISSING, Window, pointed

pytestmark = pytest.mark.skipif(bool(MISSING), reason=f"needs {' and '.join(MISSING)}: apt-get install xvfb xdotool")
# places in a window of 600 × 585 pixels: the fields of the extinction and of the threshold, and lists
EXTINCTION, THRESHOLD, COLORS = (463, 166), (400, 191), (450, 116)
PRESET, FIRST, SHIFT = (450, 91), (350, 80), (463, 501)
# the list of sizes of the dialog that saves
SIZES = (350, 278)
# of the window that nothing shows
SIZE = (600, 500)
# pixels of a row of the palette
ROW = 400 * 14
# what texts lie on
BACKGROUNDS = ["window_bg", "popup_bg", "button", "frame_bg", "frame_bg_hovered", "button_hovered", "tab_selected"]
BACKGROUNDS += ["header", "header_hovered", "header_active", "button_active", "frame_bg_active", "slider_grab"]
# seconds that the cursor rests before a tooltip
TOOLTIP = 0.4
# the list of shapes and its first one; two places of the strip of colours, without a point
SHAPES, STEP, STRIP, ASIDE = (500, 477), (460, 357), (510, 431), (540, 431)


@pytest.fixture(scope="module")
def shared_panel(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Window]:
    pytest.importorskip("imgui_bundle", reason="needs the extra gui: pip install splatgl[gui]")
    folder = tmp_path_factory.mktemp("panel")
    np.save(folder / "blob.npy", blob().samples)
    window = Window(folder / "blob.npy", folder, size=(600, 585), panel=True)
    yield window
    window.end()


@pytest.fixture
def panel(shared_panel: Window) -> Window:
    """The panel, as it began."""
    shared_panel.ask("reset")
    shared_panel.key("tab")
    return shared_panel


def test_numbers_are_dragged(panel: Window) -> None:
    before = panel.ask("look")
    pointed(panel, *THRESHOLD)
    after = panel.drag(1, THRESHOLD, (THRESHOLD[0] + 60, THRESHOLD[1]))
    assert after["threshold"] > before["threshold"] == 0.0 and np.allclose(after["eye"], before["eye"])
    pointed(panel, *EXTINCTION)
    assert panel.drag(1, EXTINCTION, (EXTINCTION[0] + 60, EXTINCTION[1]))["extinction"] != 1.0


@pytest.mark.long
def test_a_resting_cursor_shows_a_tooltip(panel: Window) -> None:
    """Although a window at rest draws no frames."""
    below = slice(PRESET[1] + 14, PRESET[1] + 26), slice(PRESET[0] + 20, PRESET[0] + 80)
    pointed(panel, *PRESET)
    time.sleep(2 * TOOLTIP)
    panel.ask("look")
    shown = panel.shot()[below]
    pointed(panel, 10, 10)
    assert (panel.shot()[below] != shown).any()


@pytest.mark.long
def test_numbers_are_typed(panel: Window) -> None:
    """Ctrl+click opens a field; its letters and digits are no shortcuts; escape gives up what is typed."""
    before = panel.ask("look")
    pointed(panel, *THRESHOLD)
    panel.hands("keydown", "ctrl", "click", 1, "keyup", "ctrl")
    panel.ask("settle")
    for key in ("b", "q", "1", "escape"):
        told = panel.key(key)
    assert told["settings"] == before["settings"] and told["axes"] == before["axes"] and not told["closed"]
    assert told["threshold"] == 0.0
    panel.hands("keydown", "ctrl", "click", 1, "keyup", "ctrl")
    panel.ask("settle")
    panel.hands("key", "ctrl+a")
    panel.hands("type", "0.25")
    assert panel.key("enter")["threshold"] == 0.25
    # shortcuts again
    assert panel.key("b")["settings"]["blend"] == "xray"
    assert panel.key("ctrl+z")["settings"]["blend"] == "composite" and panel.key("ctrl+z")["threshold"] == 0.0


@pytest.mark.long
def test_escape_closes_a_list(panel: Window) -> None:
    """One thing at a time, and never the window."""
    pointed(panel, *COLORS)
    panel.hands("click", 1)
    assert panel.ask("settle")["dialog"]
    told = panel.key("escape")
    assert not told["dialog"] and told["panel"] and not told["closed"]
    panel.hands("mousemove", 100, 200)
    assert panel.key("?")["help"] and not panel.key("escape")["help"]
    told = panel.key("escape")
    assert not told["closed"] and told["panel"]
    # of a dialog, its list first
    assert panel.key("ctrl+s")["dialog"]
    pointed(panel, *SIZES)
    panel.hands("click", 1)
    panel.ask("settle")
    assert panel.key("escape")["dialog"] and not panel.key("escape")["dialog"]


@pytest.mark.long
def test_commands_are_found_by_their_words(panel: Window) -> None:
    """The typed letters are no shortcuts; the arrows choose, Enter runs, and the panel may be hidden."""
    for hidden in (False, True):
        before = panel.key("tab") if hidden else panel.ask("look")
        panel.hands("key", "ctrl+p", "type", "next bl")
        told = panel.ask("settle")
        assert told["dialog"] and told["settings"] == before["settings"]
        first = panel.shot()
        panel.hands("key", "Down")
        panel.ask("settle")
        # two rows change their background
        assert (panel.shot() != first).any(axis=2).sum() > ROW
        panel.hands("key", "Up")
        panel.ask("settle")
        told = panel.key("enter")
        assert not told["dialog"] and told["settings"]["blend"] == ("mip" if hidden else "xray")


@pytest.mark.long
def test_edits_are_asked_for_before_the_window_closes(panel: Window) -> None:
    panel.key("b")
    panel.hands("key", "q")
    assert panel.until(lambda told: told["dialog"])["closed"] is False
    assert not panel.key("escape")["dialog"]
    told = panel.ask("set", effects=["SAVE_AND_LEAVE"])
    assert told["closed"] and (panel.folder / "scene-001.toml").exists()
    panel.ask("reset")
    panel.key("b")
    assert panel.ask("set", effects=["LEAVE"])["closed"]
    panel.ask("reset")


def test_texts_stand_out_from_what_they_lie_on() -> None:
    """By WCAG 2: texts 4.5, signs 3."""
    pytest.importorskip("imgui_bundle", reason="needs the extra gui: pip install splatgl[gui]")
    from splatgl.viewer.imgui_backend import COLORS, USES

    def ratio(front: np.ndarray, back: np.ndarray) -> float:
        dark, light = sorted(float(linear_from_srgb(each) @ [0.2126, 0.7152, 0.0722]) for each in (front, back))
        return (light + 0.05) / (dark + 0.05)

    for theme, colors in COLORS.items():
        base, solid = np.array(colors[0]), dict[str, np.ndarray]()
        for color, opacities in zip(colors, USES, strict=True):
            for opacity, names in opacities.items():
                solid |= {name: opacity * np.array(color) + (1 - opacity) * base for name in names}
        ratios = {name: ratio(solid["text"], solid[name]) for name in BACKGROUNDS}
        assert min(ratios.values()) >= 4.5, (theme, ratios)
        assert ratio(solid["text_disabled"], base) >= 4.5 and ratio(solid["check_mark"], solid["frame_bg"]) >= 3.0


@pytest.fixture
def gui() -> Iterator[Any]:
    """ImGui in a frame that nothing shows."""
    library = pytest.importorskip("imgui_bundle", reason="needs the extra gui: pip install splatgl[gui]")
    gui, plots = library.imgui, library.implot
    contexts = gui.create_context(), plots.create_context()
    gui.get_io().backend_flags |= gui.BackendFlags_.renderer_has_textures
    gui.get_io().set_ini_filename("")
    gui.get_io().display_size = gui.ImVec2(*SIZE)
    gui.new_frame()
    yield gui
    gui.end_frame()
    plots.destroy_context(contexts[1])
    gui.destroy_context(contexts[0])


def test_nothing_is_told_of_a_volume_that_is_being_opened(gui: Any) -> None:
    """No curve or values of its placeholder; menus are there."""
    from splatgl.viewer.panel import Panel

    panel, loading = Panel(COMMANDS), Document.placeholder(SceneFile("head.nii"))
    for document in (loading, replace(loading, is_loading=False)):
        for _ in range(3):
            # ImGui measures in the first
            panel.draw(replace(State.of(document, SIZE), panel=True), document, None, SIZE, True)
            gui.end_frame()
            gui.new_frame()
        assert (panel.curve.stats is None) is document.is_loading and panel.covers(400.0, 10.0)


def test_long_names_end_with_an_ellipsis(gui: Any) -> None:
    """As many letters as there is room for."""
    from splatgl.viewer.panel_sections import shorten

    name = "Left ventricular myocardium"
    whole = gui.calc_text_size(name).x
    assert shorten(name, whole) == name and shorten(name, 1.0) == "…"
    for room in (40.0, 90.0, whole - 1):
        short = shorten(name, room)
        assert name.startswith(short[:-1]) and short.endswith("…") and gui.calc_text_size(short).x <= room
        assert gui.calc_text_size(f"{name[: len(short) + 1]}…").x > room


def test_a_shift_moves_points_and_window() -> None:
    shifted = pytest.importorskip("splatgl.viewer.preset_gallery", exc_type=ImportError).shifted
    linear = Transfer([(100, 0.0), (300, 0.5)], window=(50, 400))
    assert (moved := shifted(linear, 20.0)).points == ((120, 0.0), (320, 0.5)) and moved.window == (70, 420)
    log = shifted(Transfer([(1, 0.0), (100, 0.5)], scale="log"), 1.0)
    assert log.points == ((2, 0.0), (200, 0.5)) and log.window is None
    # values of a logarithmic scale stay above 0
    assert shifted(log, -50.0).points[0][0] > 0


def test_gradients_keep_their_form_and_presets_are_those_of_the_volume(monkeypatch: pytest.MonkeyPatch) -> None:
    """A curve of several nodes is stretched; statistics of the volume are taken once for all presets."""
    module = pytest.importorskip("splatgl.viewer.preset_gallery", exc_type=ImportError)
    plain = Transfer([(0, 0.0), (1, 0.5)])
    assert module.with_gradient(plain, 1.0, 3.0).gradient == ((1, 0), (3, 1))
    curve = replace(plain, gradient=((0, 0.2), (1, 0.7), (4, 0.4)))
    assert module.with_gradient(curve, 2.0, 10.0).gradient == ((2, 0.2), (4, 0.7), (10, 0.4))
    assert module.with_gradient(curve, 2.0, 2.0).gradient == ()
    volume = Volume(blob().samples)
    stats, right = statistics(volume), {name: preset(name, volume) for name in PRESETS}
    monkeypatch.setattr("splatgl.transfer.presets.statistics", None)
    gallery = module.PresetGallery()
    gallery._begin(volume, stats)
    assert gallery.transfers == right


def test_shapes_take_the_place_of_a_curve() -> None:
    """From its first to its last point, as high as it was; colours stay. A step is in the middle."""
    with_shape = pytest.importorskip("splatgl.viewer.transfer_editor", exc_type=ImportError).with_shape
    curve = Transfer([(10, 0.0), (20, 0.6), (30, 0.3)])
    tent = with_shape(curve, "tent", 100.0)
    assert tent.points == ((10, 0), (20, 0.6), (30, 0)) and tent.window == (10, 30)
    step = with_shape(tent, "step", 100.0)
    assert step.points == ((20, 0), (20, 0.6)) and step.window == (10, 30)
    assert with_shape(step, "ramp", 100.0).points == ((20, 0), (100, 0.6))
    log = with_shape(Transfer([(1, 0.0), (100, 0.0)], scale="log"), "step", 1000.0)
    assert log.points == ((10, 0), (10, 0.8))


@pytest.mark.long
def test_presets_are_chosen_by_their_pictures(panel: Window) -> None:
    """The list has a picture of each; a click on one takes it, which undo takes back, as it does a shift."""
    before = panel.ask("look")
    pointed(panel, *PRESET)
    panel.hands("click", 1)
    assert panel.ask("settle")["dialog"]
    assert panel.until(lambda told: told["pictures"] == len(PRESETS))["points"] == before["points"]
    # it begins with the active one
    pointed(panel, *FIRST)
    panel.hands("click", "--repeat", 40, 4)
    panel.ask("settle")
    panel.hands("click", 1)
    chosen = panel.until(lambda told: not told["dialog"])
    assert chosen["points"] == [list(point) for point in preset("ct-bone", Volume(blob().samples)).points]
    pointed(panel, *SHIFT)
    moved = panel.drag(1, SHIFT, (SHIFT[0] + 30, SHIFT[1]))
    by = {round(b[0] - a[0], 6) for a, b in zip(chosen["points"], moved["points"], strict=True)}
    assert len(by) == 1 and by.pop() > 0
    assert panel.key("ctrl+z")["points"] == chosen["points"] and panel.key("ctrl+z")["points"] == before["points"]


@pytest.mark.long
def test_shapes_and_colours_of_values_are_edited_by_hand(panel: Window) -> None:
    """A shape is chosen from its list; a double click adds a colour, a drag moves it, a click opens its colour, a right
    click removes it; each can be undone.
    """
    before = panel.ask("look")
    pointed(panel, *SHAPES)
    panel.hands("click", 1)
    panel.ask("settle")
    pointed(panel, *STEP)
    panel.hands("click", 1)
    step = panel.until(lambda told: not told["dialog"])
    assert len(step["points"]) == 2 and step["points"][0][0] == step["points"][1][0]
    assert panel.key("ctrl+z")["points"] == before["points"]
    pointed(panel, *STRIP)
    panel.hands("click", "--repeat", 2, "--delay", 60, 1)
    added = panel.ask("settle")
    assert len(added["colors"]) == len(before["colors"]) + 1 and added["window"] == before["window"]
    pointed(panel, *STRIP)
    moved = panel.drag(1, STRIP, ASIDE)
    place = next(n for n, (a, b) in enumerate(zip(added["colors"], moved["colors"], strict=True)) if a[0] != b[0])
    (first, color), (last, same) = added["colors"][place], moved["colors"][place]
    assert last > first and same == color
    pointed(panel, *ASIDE)
    panel.hands("click", 1)
    assert panel.ask("settle")["dialog"]
    panel.key("escape")
    pointed(panel, *ASIDE)
    panel.hands("click", 3)
    assert len(panel.ask("settle")["colors"]) == len(before["colors"])
    for _ in range(3):
        undone = panel.key("ctrl+z")
    assert undone["colors"] == before["colors"]


def marked(panel: Window) -> tuple[int, int]:
    """Middle of the frame that marks a widget, found by its colour in the window's picture."""
    from splatgl.viewer.imgui_backend import COLORS as THEMES

    accent = np.rint(np.array(THEMES["dark"][-1]) * 255)
    rows, columns = np.nonzero((np.abs(panel.shot() - accent) <= 3).all(axis=-1))
    lines = [row for row in np.unique(rows) if (rows == row).sum() > 12]
    assert lines, "no widget is marked"
    across = columns[np.isin(rows, lines)]
    return (int(across.min()) + int(across.max())) // 2, (lines[0] + lines[-1]) // 2


def reach(panel: Window, place: tuple[int, int]) -> None:
    """Presses the arrow down until the widget at a place is marked."""
    for _ in range(60):
        across, down = marked(panel)
        if abs(down - place[1]) < 8:
            return
        panel.hands("key", "Down")
        panel.ask("look")
    raise AssertionError(f"no widget is reached at {place}, the last at {across, down}")


@pytest.mark.long
def test_widgets_are_reached_and_edited_by_keys(panel: Window) -> None:
    """F6 gives the panel the keys that go through widgets, which a frame marks; Escape gives them back."""
    before = panel.ask("look")
    assert panel.key("f6")["focused"]
    # keys that edit nothing keep their commands
    assert np.allclose(panel.key("down")["eye"], before["eye"]) and panel.key("b")["settings"]["blend"] == "xray"
    assert panel.key("ctrl+z")["settings"]["blend"] == "composite"
    reach(panel, EXTINCTION)
    panel.hands("key", "space", "Right", "Right", "Right")
    moved = panel.ask("settle")
    assert moved["extinction"] > 1.0 and np.allclose(moved["eye"], before["eye"]) and not moved["turning"]
    # one thing at a time
    assert panel.key("escape")["focused"]
    # Tab opens the number of the next one to be typed
    panel.hands("key", "Tab")
    panel.ask("look")
    panel.hands("type", "0.25")
    assert panel.key("enter")["threshold"] == 0.25
    panel.hands("key", *["Up"] * 10)
    panel.ask("settle")
    reach(panel, COLORS)
    panel.hands("key", "space")
    assert panel.ask("settle")["dialog"]
    told = panel.key("escape")
    assert not told["dialog"] and told["focused"]
    assert not panel.key("escape")["focused"]
    assert not np.allclose(panel.key("down")["eye"], before["eye"])
    # a click in the picture gives them back, too
    panel.key("f6")
    panel.hands("mousemove", 100, 200, "click", 1)
    assert not panel.ask("settle")["focused"]
