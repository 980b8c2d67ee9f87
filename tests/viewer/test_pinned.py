"""A picture that is kept beside the one that is edited, from the same place."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import splatgl as sg
from splatgl.scene.scene_file import SceneFile
from splatgl.viewer.adaptive_quality import FULL
from splatgl.viewer.commands import COMMANDS
from splatgl.viewer.document import Document
from splatgl.viewer.frame_renderer import FrameRenderer
from splatgl.viewer.saving import compose_screenshot, save_picture
from splatgl.viewer.state import History, PinnedView, State
from tests.helpers.blobs import blob
from tests.helpers.window import MISSING, Window

(PIN,) = (command for command in COMMANDS if command.id == "pin")


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("pinned") / "blob.npy"
    np.save(path, blob().samples)
    return path


def test_what_is_pinned_stays(file: Path) -> None:
    """Through edits, undo and other files, until it is unpinned; the reference takes its place."""
    document = Document.open(SceneFile(str(file)))
    state = State.of(document, (32, 24))
    early, _ = PIN(state, document)
    assert early.pinned is None and "refined" in early.message
    for stride in (4, 2, 1):
        document.extract(stride)
    pinned, _ = PIN(state, document)
    assert pinned.beside is not None and pinned.beside.document is document
    history = History(pinned)
    edited = pinned.edit(extinction=3.0)
    history.note(edited)
    assert history.undo(edited).beside is pinned.beside
    # and is freed once it is unpinned, whatever the steps
    assert not any(step.pinned for step in (*history.past, *history.future, history.now))
    assert edited.opened(document).beside is pinned.beside
    assert replace(edited, compare="split").beside is None
    assert PIN(edited, document)[0].pinned is None


def test_what_is_pinned_hinders_no_picture(file: Path, renderer: sg.Renderer) -> None:
    """Where it cannot be drawn, its side is clear, with the reason; nothing else is refused."""
    document = Document.open(SceneFile(str(file)))
    for stride in (4, 2, 1):
        document.extract(stride)
    painter, camera = FrameRenderer.__new__(FrameRenderer), State.of(document, (32, 24)).pose.camera
    painter.renderer = renderer
    for align, reason in (("ray", "quads can draw"), ("auto", "")):
        pinned = PinnedView(document, sg.Settings(align=align, compositing="sheets"))
        pixels = painter._draw_pinned(pinned, camera, FULL, None)
        assert pixels.shape == (24, 32, 4) and bool(pixels.any()) != bool(reason)
        assert (reason in painter.not_beside) and bool(painter.not_beside) == bool(reason)


@pytest.mark.parametrize("blends", [("composite", "mip"), ("xray", "composite"), ("composite", "xray")])
def test_both_pictures_are_saved(file: Path, renderer: sg.Renderer, tmp_path: Path, blends: tuple[str, str]) -> None:
    """Beside each other, each as it is saved alone."""
    document = Document.open(SceneFile(str(file), settings=sg.Settings(antialias="off")))
    base = replace(State.of(document, (32, 24)), annotate=())
    left, right = (replace(base, settings=base.settings.replace(blend=blend)) for blend in blends)
    draw, alone = renderer.render, list[np.ndarray]()
    for state in (left, right):
        shown = document.for_settings(state.settings)
        save_picture(state, shown, draw, tmp_path)
        alone.append(sg.Image.load(tmp_path / f"picture-{len(alone) + 1:03d}.png").pixels)
    pinned = replace(left, pinned=PinnedView(document.for_settings(right.settings), right.settings))
    shown = document.for_settings(left.settings)
    save_picture(pinned, shown, draw, tmp_path, lambda image: compose_screenshot(image, pinned, shown, draw, 1.0, None))
    both = sg.Image.load(tmp_path / "picture-003.png").pixels
    assert both.shape == (24, 64, 4) and both.max() > 0.5
    assert np.array_equal(both[:, :32], alone[0]) and np.allclose(both[:, 33:], alone[1][:, 1:], atol=2 / 255)
    assert np.ptp(both[:, 32], axis=0).max() == 0 and 0.1 < both[0, 32, 0] < 0.3


@pytest.mark.long
@pytest.mark.skipif(bool(MISSING), reason=f"needs {' and '.join(MISSING)}: apt-get install xvfb xdotool")
def test_both_pictures_turn_and_one_is_edited(file: Path) -> None:
    window = Window(file, file.parent, size=(480, 240))
    window.key("ctrl+d")
    # the next key hides the message; without texts and axes
    window.key("j")
    left, right = np.s_[80:160, 80:160], np.s_[80:160, 320:400]
    first = window.shot().astype(int)
    assert np.abs(first[left] - first[right]).max() <= 1 and first[left].max() > 100
    before = window.ask("settle")
    after = window.drag(1, (360, 120), (400, 100))
    assert not np.allclose(after["eye"], before["eye"]) and after["size"] == [240, 240]
    turned = window.shot().astype(int)
    assert all(np.abs(turned[part] - first[part]).max() > 5 for part in (left, right))
    window.key("b")
    edited = window.shot().astype(int)
    assert np.array_equal(edited[right], turned[right]) and np.abs(edited[left] - turned[left]).max() > 5
    window.key("ctrl+d")
    assert np.abs(window.shot()[right].astype(int) - turned[right]).max() > 5
    window.end()
