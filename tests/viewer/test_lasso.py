"""Scissors in the window: drags draw outlines, which cut every layer, are undone, and are saved with the scene."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import splatgl as sg
from splatgl.scene.scene_file import SceneFile
from splatgl.viewer.clip_tool import BAD, NO_VOLUME, LassoTool, lasso_strokes
from splatgl.viewer.document import Document
from splatgl.viewer.saving import save_scene
from splatgl.viewer.state import History, State
from splatgl.viewer.trackball import Pointer, Viewport
from tests.helpers.commands import acted

SIZE = (64, 48)
VIEW = Viewport(SIZE)
# around the right half
RIGHT = ((32.0, -5.0), (70.0, -5.0), (70.0, 55.0), (32.0, 55.0), (33.0, 54.0))


@pytest.fixture
def document(tmp_path: Path) -> Document:
    z, y, x = np.indices((16, 16, 16)) / 15 - 0.5
    np.save(tmp_path / "ball.npy", np.float32(40 * np.clip(1.4 - 3 * np.sqrt(x * x + y * y + z * z), 0, 1)))
    points = ((4.0, 0.0), (30.0, 0.9))
    path = str(tmp_path / "ball.npy")
    layer = SceneFile(path, transfer={"points": points})
    return Document.open(SceneFile(path, transfer={"points": points}, layers=(layer,)))


def drawn(state: State, document: Document, outline: tuple[tuple[float, float], ...] = RIGHT) -> State:
    """The state after a drag."""
    tool = LassoTool()
    taken = tool.press(state, document, VIEW, Pointer(outline[0], "left"))
    assert taken is not None
    for place in outline[1:]:
        moved = tool.move(taken, document, VIEW, Pointer(place))
        assert moved is not None
        taken = moved
    assert len(lasso_strokes(taken.lasso, 1.0)) == len(taken.lasso.points) - 1
    released = tool.release(taken, document, VIEW, Pointer(outline[-1], "left"))
    assert released is not None
    return released


def test_a_drag_cuts_every_layer_and_is_undone(document: Document) -> None:
    state = State.of(document, SIZE)
    history = History(state)
    # without the command the drag is left to the camera
    assert LassoTool().press(state, document, VIEW, Pointer(RIGHT[0], "left")) is None
    ready = acted(state, "scissors", document)
    assert ready.lasso.active and not acted(ready, "scissors", document).lasso.active
    cut = drawn(ready, document)
    assert not cut.lasso.active and cut.message.startswith("cut")
    shown = document.with_styles(cut.styles, (), cut.settings)
    for layer in shown.layers:
        kept = layer.volume.kept((0, 0, 0), layer.volume.shape)
        assert 0.4 < kept.mean() < 0.6
    history.note(cut)
    back = history.undo(cut)
    again = shown.with_styles(back.styles, (), back.settings)
    assert not any(layer.volume.masks for layer in again.layers)
    assert not acted(cut, "uncut", document).styles[0].scissors
    # what is kept is the other half
    other = drawn(acted(state, "scissors-keep", document), document)
    half = document.with_styles(other.styles, (), other.settings).layers[0].volume
    assert (half.kept((0, 0, 0), half.shape) != kept).mean() > 0.99


def test_an_outline_around_all_or_nothing_only_says_so(document: Document) -> None:
    ready = acted(State.of(document, SIZE), "scissors", document)
    for outline in (((-90.0, -90.0), (200.0, -90.0), (200.0, 200.0), (-90.0, 200.0)), ((3.0, 3.0), (9.0, 3.0))):
        refused = drawn(ready, document, outline)
        assert refused.message == BAD and refused.lasso.active and refused.styles == ready.styles


def test_scissors_of_meshes_alone_only_say_so(tmp_path: Path) -> None:
    trimesh = pytest.importorskip("trimesh")
    trimesh.creation.box((4.0, 2.0, 1.0)).export(tmp_path / "a.stl")
    document = Document.open(SceneFile(str(tmp_path / "a.stl")))
    refused = acted(State.of(document, SIZE), "scissors", document)
    assert refused.message == NO_VOLUME and not refused.lasso.active


def test_a_saved_scene_has_the_cut_from_where_it_was_drawn(
    document: Document, renderer: sg.Renderer, tmp_path: Path
) -> None:
    """And a command draws it bit for bit, after the view was turned, too."""
    state = drawn(acted(State.of(document, SIZE), "scissors", document), document)
    state = replace(state, pose=state.pose.spun(50.0, np.array([0.0, 0, 1])))
    save_scene(state, document, renderer.render, tmp_path)
    (scene,) = tmp_path.glob("*.toml")
    assert "[[scissors]]" in scene.read_text()
    right = np.load(scene.with_suffix(".npy"))
    found, again = sg.render(scene).pixels, Document.open(SceneFile.from_toml(scene))
    assert found.shape == (48, 64, 4) and found[..., 3].max() > 0.5
    assert np.abs(found - right).max() < 2e-3
    (tmp_path / "whole.toml").write_text(replace(SceneFile.from_toml(scene), scissors=()).to_toml(tmp_path))
    assert np.abs(sg.render(tmp_path / "whole.toml").pixels - right).max() > 0.1
    # opened again, the window has the same
    state = State.of(again, SIZE)
    assert len(state.styles[1].scissors) == 1 and again.with_styles(state.styles, (), state.settings) is again
