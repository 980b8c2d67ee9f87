"""Regions over the joint histogram: counts in closed form, edits, and copies of scenes that have them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import splatgl as sg
from splatgl.data.volume import Volume
from splatgl.scene.scene_file import SceneFile
from splatgl.transfer.regions import MOST_REGIONS, Region
from splatgl.transfer.transfer import Transfer
from splatgl.viewer.commands import Copy
from splatgl.viewer.document import Document
from splatgl.viewer.saving import copy_text, render_scene, scene_of
from splatgl.viewer.state import History, State
from tests.helpers.blobs import blob
from tests.helpers.window import MISSING, Told, Window, pointed

editor = pytest.importorskip("splatgl.viewer.transfer_editor", exc_type=ImportError)
VALUES = (0.0, 100.0)


@pytest.mark.parametrize("kind", [np.float32, np.uint8])
def test_a_ramp_has_one_gradient(kind: type) -> None:
    """A linear ramp along each axis, up and down, has all its mass at its slope over the spacing."""
    spacing = (0.5, 2.0, 4.0)
    for axis in range(3):
        for sign in (1, -1):
            line = np.arange(20)[::sign] * 4
            shape = [20 if n == 2 - axis else 1 for n in range(3)]
            samples: np.ndarray = np.broadcast_to(line.reshape(shape), (20, 20, 20)).astype(kind)
            plot = editor.JointHistogram.of(Volume(samples, spacing), VALUES, (10, 4))
            assert plot.gradients == (0.0, pytest.approx(4 / spacing[axis]))
            # values 4 to 72 in columns of 10, each in 18² voxels with neighbours all around
            counts = 18**2 * np.histogram(np.arange(1, 19) * 4, 10, VALUES)[0]
            assert (plot.counts[-1] == counts).all() and plot.counts[:-1].sum() == 0
            assert plot.heights.max() == 1.0 and plot.heights.min() == 0.0


def test_constant_and_thin_volumes_have_a_plot() -> None:
    for shape in ((8, 8, 8), (1, 5, 5), (2, 2, 2)):
        plot = editor.JointHistogram.of(Volume(np.full(shape, 7.0)), VALUES, (4, 4))
        assert plot.gradients == (0.0, 1.0) and plot.counts.sum() == np.prod(np.maximum(np.array(shape) - 2, 0))


def test_regions_are_added_changed_and_removed() -> None:
    plot = editor.JointHistogram(np.ones((2, 2)), VALUES, (0.0, 10.0))
    transfer = Transfer([(0, 0.0), (1, 0.5)])
    for shape in editor.REGION_SHAPES:
        transfer = editor.add_region(transfer, shape, plot)
    assert [region.shape for region in transfer.regions] == list(editor.REGION_SHAPES)
    assert len({region.color for region in transfer.regions}) == 3 and transfer.regions[1].gradients[0] == 0.0
    box = Region("box", (1, 2), (3, 4), "red", 0.5)
    changed = editor.change_region(transfer, 1, box)
    assert changed.regions == (transfer.regions[0], box, transfer.regions[2])
    assert editor.change_region(changed, 0, None).regions == (box, transfer.regions[2])
    alone = editor.without_curve(transfer)
    assert {opacity for _, opacity in alone.points} == {0.0} and alone.regions == transfer.regions
    assert len(editor.REGION_COLORS) < MOST_REGIONS


def test_moved_regions_stay_regions() -> None:
    """Endless sides stay, gradients stay above 0, and no side passes the other; the text has every digit."""
    box = Region("box", (10, np.inf), (1, 2), "red", 0.5)
    moved = editor.move_region(box, (20 + 1e-9, 100), (-1, 1 / 3))
    assert moved.values == (20, np.inf) and moved.gradients == (0, 0.333333)
    assert Region.parse(str(moved)) == moved
    assert editor.move_region(box, (20, 100), (2, 2)) is box


def test_a_copy_draws_the_same_picture(tmp_path: Path, renderer: sg.Renderer, monkeypatch: pytest.MonkeyPatch) -> None:
    """Regions that were added and moved, copied as Python with a scene file; the edit is undone as any other."""
    np.save(tmp_path / "blob.npy", blob().samples)
    document = Document.open(SceneFile(str(tmp_path / "blob.npy"), settings=sg.Settings(antialias="off")))
    document.extract(1)
    state = replace(State.of(document, (32, 24)), annotate=())
    plot = editor.JointHistogram.of(document.volume, (0.0, float(document.volume.samples.max())), (16, 16))
    history, base = History(state), editor.without_curve(state.style.stated)
    for shape in editor.REGION_SHAPES:
        base = editor.add_region(base, shape, plot)
    (low, high), top = plot.values, plot.gradients[1]
    base = editor.change_region(base, 1, editor.move_region(base.regions[1], (low + high / 3, high), (0, top / 3)))
    edited = state.edit(base=base)
    history.note(edited)
    assert history.undo(edited).style.base == state.style.base
    monkeypatch.chdir(tmp_path)
    wanted, before = (
        render_scene(
            scene_of(each, document), document.with_styles(each.styles, (), each.settings), renderer.render
        ).pixels
        for each in (edited, state)
    )
    space: dict[str, Any] = {}
    exec(copy_text(Copy.PYTHON, edited, document), space)
    assert SceneFile.from_toml(Path("scene.toml")).transfer["regions"] == [str(region) for region in base.regions]
    assert np.array_equal(space["image"].pixels, wanted) and not np.array_equal(before, wanted)


# --- the window -------------------------------------------------------------------------------------------------------

# places in a window of 600 × 585 pixels: the tab, its buttons, opacity and removal of the first region, and the plot,
# whose values and gradients go from its left and lower end
TAB, BOX, TRIANGLE, ALONE, OPACITY, REMOVE = (370, 242), (292, 436), (345, 436), (515, 436), (355, 461), (437, 461)
LEFT, LOW, WIDTH, HEIGHT = 309, 400, 256, 140
MIDDLE = (LEFT + WIDTH // 2, LOW - HEIGHT // 2)


@pytest.fixture(scope="module")
def shared_window(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Window]:
    if MISSING:
        pytest.skip(f"needs {' and '.join(MISSING)}: apt-get install xvfb xdotool")
    folder = tmp_path_factory.mktemp("regions")
    np.save(folder / "blob.npy", blob().samples)
    window = Window(folder / "blob.npy", folder, size=(600, 585), panel=True)
    yield window
    window.end()


@pytest.fixture
def window(shared_window: Window) -> Window:
    """The tab of regions of a file as it was opened."""
    shared_window.ask("reset")
    shared_window.key("tab")
    click(shared_window, TAB)
    return shared_window


def click(window: Window, place: tuple[int, int]) -> Told:
    pointed(window, *place)
    window.hands("click", 1)
    return window.ask("settle")


@pytest.mark.long
def test_a_drag_is_one_step_of_undo(window: Window) -> None:
    """However slowly the panel follows it; by the middle of a region, a side and a corner."""
    added = click(window, BOX)["regions"]
    pointed(window, *MIDDLE)
    moved = window.ask("hesitate", places=[(MIDDLE[0] + 20 * n, MIDDLE[1] - 10 * n) for n in range(3)])["regions"]
    (first,), (last,) = ([Region.parse(text) for text in texts] for texts in (added, moved))
    by = np.array(last.values) - first.values
    assert np.allclose(by, 40 * 40 / WIDTH, rtol=0.05) and np.ptp(by) < 1e-3 and last.gradients > first.gradients
    assert window.key("ctrl+z")["regions"] == added
    assert window.key("ctrl+shift+z")["regions"] == moved
    assert window.key("ctrl+z")["regions"] == added
    # from 0.35 to 0.65 of the plot
    right, top = LEFT + round(0.65 * WIDTH), LOW - round(0.65 * HEIGHT)
    for start, ends in (((right, MIDDLE[1]), {1}), ((right, top), {1, 3})):
        pointed(window, *start)
        sized = window.drag(1, start, (start[0] + 24, start[1] - 12))["regions"]
        both = [Region.parse(texts[0]) for texts in (added, sized)]
        limits = [np.array([*region.values, *region.gradients]) for region in both]
        assert set(np.flatnonzero(limits[0] != limits[1])) == ends
        assert window.key("ctrl+z")["regions"] == added
    assert window.key("ctrl+z")["regions"] == []


@pytest.mark.long
def test_regions_are_edited_saved_and_copied(window: Window) -> None:
    """Buttons, opacities and removal, each undone; a saved scene and a copied command hold what is drawn."""
    before = window.ask("look")
    click(window, BOX)
    both = click(window, TRIANGLE)
    assert [text.split(":")[0] for text in both["regions"]] == ["box", "triangle"]
    pointed(window, *OPACITY)
    denser = window.drag(1, OPACITY, (OPACITY[0] + 25, OPACITY[1]))
    assert Region.parse(denser["regions"][0]).opacity > 0.3 and denser["regions"][1] == both["regions"][1]
    assert click(window, REMOVE)["regions"] == both["regions"][1:]
    alone = click(window, ALONE)
    assert before["points"] == both["points"] and {opacity for _, opacity in alone["points"]} == {0.0}
    undone = [window.key("ctrl+z") for _ in range(3)]
    assert [len(told["regions"]) for told in undone] == [1, 2, 2] and undone[2]["regions"] == both["regions"]
    assert undone[0]["points"] == before["points"]
    redone = [window.key("ctrl+shift+z") for _ in range(3)][-1]
    assert (redone["regions"], redone["points"]) == (alone["regions"], alone["points"])
    assert "scene-001.toml" in window.key("shift+s")["message"]
    saved = SceneFile.from_toml(window.folder / "scene-001.toml").transfer
    assert saved["regions"] == alone["regions"] and saved["points"] == alone["points"]
    window.hands("key", "ctrl+p")
    window.ask("settle")
    window.hands("type", "as a command")
    window.ask("settle")
    assert "command copied" in window.key("enter")["message"]
    assert alone["regions"][0] in window.ask("paste")["text"]
    assert window.key("ctrl+z")["points"] == before["points"]
