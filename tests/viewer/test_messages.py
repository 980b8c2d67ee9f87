"""What a window must not do to its user: lose edits, hide keys, keep on telling of errors that are over."""

from __future__ import annotations

import ast
import os
import threading
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from splatgl.annotations.text import FONT, Text, _fit_block
from splatgl.data.volume import Volume
from splatgl.scene.scene_file import SceneFile
from splatgl.splat.settings import Settings
from splatgl.transfer.statistics import statistics
from splatgl.viewer import hud, loading, viewer
from splatgl.viewer.commands import COMMANDS
from splatgl.viewer.document import Document
from splatgl.viewer.input import help_rows
from splatgl.viewer.jobs import JobKind, Jobs
from splatgl.viewer.loading import Files, OpenedFile
from splatgl.viewer.state import State
from tests.helpers.blobs import blob
from tests.helpers.window import MISSING, Window, silent

driven = pytest.mark.skipif(bool(MISSING), reason=f"needs {' and '.join(MISSING)}: apt-get install xvfb xdotool")
WITH_GUI = "needs the extra gui: pip install splatgl[gui]"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("calm")
    np.save(place / "blob.npy", blob().samples)
    return place


@pytest.fixture(scope="module")
def shared(folder: Path) -> Iterator[Window]:
    window = Window(folder / "blob.npy", folder)
    yield window
    window.end()


@pytest.fixture
def window(shared: Window) -> Window:
    shared.ask("reset")
    shared.hands("mousemove", 120, 90)
    return shared


@pytest.mark.parametrize("scale", [1.0, 2.0])
def test_the_help_fits_small_windows(scale: float) -> None:
    """All keys in 640 × 480 pixels, in letters of 10 pixels at least."""
    text = Text(tuple("\t".join(row) for row in help_rows(COMMANDS)), "middle", fit=True)
    size = round(640 * scale), round(480 * scale)
    block = _fit_block(text, size, scale)
    assert block.size[0] <= size[0] and block.size[1] <= size[1] and block.height >= 0.75 * FONT * scale
    cells = [cell for line in text.lines for cell in line.split("\t") if cell]
    assert len([cell for cell in block.cells if cell[1] >= 0]) == len(cells)
    # with more room, its groups stand apart
    wide = {cell: y for cell, _, y in _fit_block(text, (size[0] * 2, size[1] * 2), scale).cells}
    assert wide["EDIT"] - wide["quit"] > 1.4 * (wide["quit"] - wide["save the floats (NPY) and the scene"])


@pytest.mark.long
@driven
def test_edits_are_not_lost(window: Window) -> None:
    """Quitting asks once, by whatever way; a saved scene, or an edit that was undone, is no reason to."""
    window.key("]")
    told = window.key("q")
    assert not told["closed"] and "edits are not saved" in told["message"]
    # another key later, it asks again
    window.key("h")
    assert "edits" not in window.key("1")["message"]
    assert not window.ask("request")["closed"] and not window.key("escape")["closed"]
    assert not window.key("ctrl+q")["closed"] and window.key("ctrl+q")["closed"]
    window.ask("reset")
    window.key("]")
    assert "saved" in window.key("shift+s")["message"] and window.key("q")["closed"]
    window.ask("reset")
    window.key("]")
    window.key("ctrl+z")
    assert window.key("q")["closed"]


@pytest.mark.long
@driven
def test_another_file_asks_and_is_undone(folder: Path) -> None:
    """Without the panel, a second drop is obeyed."""
    np.save(folder / "other.npy", blob(12).samples)
    window = Window(folder / "blob.npy", folder)
    extinction = window.key("]")["extinction"]
    told = window.drop(folder / "other.npy")
    assert "edits are not saved" in told["message"] and told["source"].endswith("blob.npy")
    told = window.drop(folder / "other.npy")
    assert told["source"].endswith("other.npy") and told["extinction"] != extinction
    told = window.key("ctrl+z")
    assert told["source"].endswith("blob.npy") and told["extinction"] == extinction
    assert window.key("ctrl+y")["source"].endswith("other.npy")
    window.end()


@pytest.mark.long
@driven
def test_views_and_settings_are_undone(window: Window) -> None:
    before = window.ask("look")
    turned = window.drag(1, (100, 90), (140, 70))
    edited = window.key("b")
    assert edited["axes"] == turned["axes"] != before["axes"] and edited["settings"]["blend"] == "xray"
    undone = window.key("ctrl+z")
    assert undone["settings"]["blend"] == "composite" and undone["axes"] == turned["axes"]
    assert window.key("ctrl+z")["axes"] == before["axes"]
    assert "nothing to undo" in window.key("ctrl+z")["message"]
    window.key("ctrl+y")
    redone = window.key("ctrl+shift+z")
    assert redone["settings"]["blend"] == "xray" and redone["axes"] == turned["axes"]
    assert "nothing to redo" in window.key("ctrl+y")["message"]


@pytest.mark.long
@driven
def test_k_says_when_nothing_is_beyond(window: Window) -> None:
    assert "all voxels are nearer" in window.key("k")["message"]
    window.key("k")
    window.key("p")
    assert "orthographic view" in window.key("k")["message"]


@pytest.mark.long
@driven
def test_a_file_that_is_removed_says_so(tmp_path: Path) -> None:
    """Its picture stays; the words go once it is back, and those of a damaged one once it is mended."""
    path, aside = tmp_path / "v.npy", tmp_path / "aside.npy"
    np.save(path, blob().samples)
    window = Window(path, tmp_path, watched=[str(path)])
    silent(window)
    # an edit, so that the transfer function is not the file's
    window.key("]")
    before = window.shot()
    path.rename(aside)
    assert "v.npy is gone" in window.until(lambda told: "is gone" in told["message"])["message"]
    assert np.array_equal(window.shot()[:120], before[:120])
    aside.rename(path)
    assert not window.until(lambda told: not told["message"])["message"]
    aside.write_bytes(b"\x93NUMPY not quite")
    aside.rename(path)
    assert "v.npy" in window.until(lambda told: "NumPy" in told["message"])["message"]
    np.save(aside, blob(20).samples)
    aside.rename(path)
    assert not window.until(lambda told: not told["message"])["message"]
    assert window.ask("settle")["splats"] != window.state["splats"]
    window.end()


@pytest.mark.long
def test_a_dropped_file_is_not_replaced(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of two files of one name the second is still being read when the one that is watched changes: no reason to read
    that again.
    """
    gates = {name: threading.Event() for name in ("a/v.npy", "b/v.npy")}

    def opened(scene: SceneFile, times: tuple[SceneFile, ...] = ()) -> OpenedFile:
        assert gates[scene.volume].wait(300.0)
        return OpenedFile(document)

    document = Document.open(SceneFile(str(folder / "blob.npy")))
    np.save(folder / "watched.npy", blob().samples)
    monkeypatch.setattr(loading, "_opened", opened)
    woken = threading.Semaphore(0)
    found = Files(Jobs(woken.release), (str(folder / "watched.npy"),), lambda: document.scene, 0.0)
    for name in gates:
        found.open([name], Settings())
        # the first is being read before the second is asked for
        while found.jobs.waiting and name == "a/v.npy":
            pass
    gates["a/v.npy"].set()
    assert woken.acquire(timeout=300.0)
    for done in found.jobs.collect():
        found.finish(done.kind)
    os.utime(folder / "watched.npy", (1, 1))
    state = State.of(document, (120, 80))
    found.check(state, 1e9)
    assert not found.jobs.waiting and (found.jobs.busy or "").startswith("opening")
    gates["b/v.npy"].set()
    assert found.jobs.wait(300.0)
    for done in found.jobs.collect():
        found.finish(done.kind)
    # now it is
    os.utime(folder / "watched.npy", (2, 2))
    found.check(state, 2e9)
    assert found.opening == "" and found.jobs.wait(300.0)
    assert [done.kind for done in found.jobs.collect()] == [JobKind.RELOAD]


@pytest.mark.long
@driven
def test_the_first_frame_has_the_panel_and_the_help_hides_it(folder: Path) -> None:
    pytest.importorskip("imgui_bundle", reason=WITH_GUI)
    window = Window(folder / "blob.npy", folder, size=(600, 450), panel=True)
    first, now = np.load(folder / "first.npy"), window.shot()
    left, top, right, _ = (round(each) for each in window.state["place"])
    assert np.abs(first[top : top + 20, left:right].astype(int) - now[top : top + 20, left:right]).max() < 3
    assert np.ptp(first[top : top + 20, left:right].astype(int)) > 100
    # nothing lies over the keys, and nothing of what is hidden takes a click
    window.key("?")
    covered = window.shot()
    turned = window.drag(1, (400, 200), (440, 180))
    assert turned["axes"] != window.state["axes"] and turned["help"]
    window.ask("reset")
    window.key("?")
    assert not window.ask("look")["panel"] and np.array_equal(window.shot(), covered)
    window.end()


@pytest.mark.long
@driven
def test_the_panel_covers_no_annotation(folder: Path) -> None:
    """The picture ends at it; where it lies over the picture, what it would cover is not drawn."""
    pytest.importorskip("imgui_bundle", reason=WITH_GUI)
    window = Window(folder / "blob.npy", folder, size=(640, 480), panel=True)
    assert window.state["size"] == [310, 480] and window.state["place"][:2] == [310, 0]
    count = len(window.state["marks"])
    for width in (639, 420):
        window.hands("windowsize", "--sync", window.identity, width, 480)
        narrow = window.ask("settle")
        assert narrow["size"] == [width, 480] and narrow["place"][0] < width - 330
        assert all(right <= narrow["place"][0] for _, _, right, _ in narrow["marks"])
    assert len(narrow["marks"]) < count == len(window.key("tab")["marks"])
    window.end()


@pytest.mark.long
@driven
def test_everything_is_twice_as_large_at_a_scale_of_two(folder: Path) -> None:
    """Text, panel, slices' letters and the reach of handles: as in a window of half the pixels at a scale of one."""
    pytest.importorskip("imgui_bundle", reason=WITH_GUI)
    small = Window(folder / "blob.npy", folder, size=(500, 400), panel=True)
    large = Window(folder / "blob.npy", folder, size=(1000, 800), panel=True, dpi=192)
    assert (small.state["scale"], large.state["scale"]) == (1.0, 2.0)
    wide = [each.state["place"][2] - each.state["place"][0] for each in (small, large)]
    assert wide[0] == 330.0 and wide[1] == 660.0
    plots = [each.state["plot"][0] for each in (small, large)]
    assert plots[1][2] == pytest.approx(2 * plots[0][2], rel=0.05) and plots[1][3] > 1.8 * plots[0][3]
    for each in (small, large):
        each.key("tab")
        each.key("z")
        each.key("x")
    # the same picture in twice as many pixels: text, letters and handles are where they are in the small one
    shots = small.shot().astype(float), large.shot().reshape(400, 2, 500, 2, 3).mean(axis=(1, 3))
    for part in (np.s_[:60, :200], np.s_[:, 367:], np.s_[60:, 200:360]):
        a, b = (shot[part].mean(axis=2) for shot in shots)
        assert np.corrcoef(a.ravel(), b.ravel())[0, 1] > 0.7
    small.end()
    large.end()


def test_names_of_the_panel_s_library_exist() -> None:
    """Also those of sections that no test opens."""
    gui = pytest.importorskip("imgui_bundle", reason=WITH_GUI)
    trees = (ast.parse(file.read_text(encoding="utf-8")) for file in Path(viewer.__file__).parent.glob("*.py"))
    used = [node for tree in trees for node in ast.walk(tree) if isinstance(node, ast.Attribute)]
    names = {(node.value.id, node.attr) for node in used if isinstance(node.value, ast.Name)}
    missing = [name for room, name in names if room in ("imgui", "implot") and not hasattr(getattr(gui, room), name)]
    assert not missing


def test_statistics_are_sentences() -> None:
    samples = np.arange(240, dtype=np.int16).reshape(4, 6, 10)
    volume = Volume(samples, spacing=(1.0, 1.0, 2.5), unit="mm", value_unit="HU")
    assert hud.describe_volume(volume, statistics(volume), 0) == (
        "10 x 6 x 4 voxels, 1 x 1 x 2.5 mm apart, 16-bit whole numbers. "
        "Values: half from 59.75 to 179.2 HU, all from 0 to 239 HU."
    )
    assert hud.describe_volume(volume, statistics(volume), 3).endswith("whole numbers. They number 3 segments.")
    empty = Volume(np.full((2, 2, 2), np.nan, np.float32))
    assert hud.describe_volume(empty, statistics(empty), 0).endswith("32-bit decimal numbers. No value is finite.")
    document = Document.open(SceneFile("tunnel"))
    assert hud.describe_picture(document, None) == "No picture yet."
    full: Any = SimpleNamespace(full=True, seconds=0.041, info={"error_bound": 0.0031})
    words = "% of the voxels have an opacity. The picture took 0.041 s; the maximum error is 0.0031 of full brightness."
    assert words in hud.describe_picture(document, full)
    moving: Any = SimpleNamespace(full=False, seconds=0.02)
    assert hud.describe_picture(document, moving) == "A picture in motion, coarser than at rest, in 0.02 s."
