"""Turned slices of the window, and slices as planes in its picture: geometry, undo, scene files, keys and the mouse."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import splatgl as sg
from splatgl.geometry.slices import SliceLayer, parse_slices
from splatgl.scene.scene_file import SceneFile
from splatgl.viewer.document import Document
from splatgl.viewer.saving import save_scene, scene_of
from splatgl.viewer.slice_planes import STRAIGHT, layer_painter, middle, normals, planes, slices_of, texts, turned
from splatgl.viewer.slice_views import Pane, SliceTool, turn_dots
from splatgl.viewer.state import History, Slices, State
from splatgl.viewer.trackball import Pointer, Viewport
from tests.helpers.commands import acted

UP = np.array([0.0, 0.0, 1.0])
SIZE = (400, 300)


def grid(direction: np.ndarray | None = None) -> sg.Volume:
    samples = np.random.default_rng(2).random((12, 14, 16)).astype(np.float32)
    turn = np.eye(3) if direction is None else direction
    return sg.Volume(samples, spacing=(1.0, 1.5, 2.0), origin=(3.0, -2.0, 1.0), direction=turn)


@pytest.fixture
def document(tmp_path: Path) -> Document:
    np.save(tmp_path / "noise.npy", grid().samples)
    points = ((0.2, 0.0), (1.0, 0.05))
    return Document.open(SceneFile(str(tmp_path / "noise.npy"), transfer={"points": points, "window": (0.0, 1.0)}))


def test_turned_slices_share_their_point_and_stay_at_right_angles() -> None:
    volume = grid(np.eye(3)[:, [1, 2, 0]])
    slices = Slices(place=(0.3, 0.6, 0.5))
    for axis in (0, 1, 2, 0):
        before = normals(slices, volume)
        slices = replace(slices, turn=turned(slices.turn, before[axis], 25.0))
        after = normals(slices, volume)
        # its own stays, the others turn by the angle
        assert np.allclose(after[axis], before[axis])
        assert np.allclose(
            (after * before).sum(axis=1), [1.0 if n == axis else np.cos(np.radians(25)) for n in range(3)]
        )
        assert np.allclose(after @ after.T, np.eye(3))
        point = middle(slices, volume)
        assert all(abs((point - plane.point) @ plane.normal) < 1e-9 for plane in planes(slices, volume, UP))
    assert turned(turned(STRAIGHT, UP, 40.0), UP, -40.0) == STRAIGHT


@pytest.mark.parametrize("degrees", [0.0, 33.0])
def test_a_scene_holds_them_as_texts(degrees: float) -> None:
    volume = grid()
    slices = Slices(place=(0.3, 0.6, 0.5), turn=turned(STRAIGHT, np.array([0.6, 0.0, 0.8]), degrees))
    slices = slices if degrees else slices.at(slices.index(volume), volume)
    found = slices_of(Slices(), texts(slices, volume), volume)
    assert found.in_space and np.allclose(found.place, slices.place) and np.allclose(found.turn, slices.turn)
    for text, plane in zip(texts(slices, volume), planes(slices, volume, UP), strict=True):
        (parsed,) = parse_slices(text, volume)
        assert (
            np.allclose(np.abs(parsed.normal @ plane.normal), 1)
            and abs((parsed.point - plane.point) @ plane.normal) < 1e-6
        )
    # other planes stay as they are
    assert (
        slices_of(Slices(), ("z=3", "x=2"), volume)
        == Slices()
        == slices_of(Slices(), ("x=1@0.5", "y=1", "z=1"), volume)
    )


def test_pixels_of_turned_slices_are_the_field() -> None:
    """A linear field; beside the volume nothing is drawn."""
    z, y, x = np.indices((20, 20, 20)).astype(np.float32)
    volume = sg.Volume(x + y + z)
    slices = Slices(turn=turned(STRAIGHT, np.array([1.0, 0.0, 0.0]), 30.0))
    state_planes = planes(slices, volume, UP)
    low, high = state_planes[2].box
    wide, tall = ((high - low) * 5).tolist()
    pane = Pane(2, state_planes[2], (0, 0, 200, 200), (10.0, 20.0, 10.0 + wide, 20.0 + tall))
    transfer = sg.Transfer(points=[(0.0, 0.0), (57.0, 0.5)])
    pixels = pane.pixels(layer_painter((SliceLayer(volume, transfer),), False, only=True))
    rows, columns = np.nonzero(pixels[..., 3])
    assert 0.9 < len(rows) / pixels[..., 3].size <= 1
    for row, column in zip(rows[::97], columns[::97], strict=True):
        point = pane.point(
            (10.0 + (column + 0.5) * wide / pixels.shape[1], 20.0 + (row + 0.5) * tall / pixels.shape[0])
        )
        assert abs(int(pixels[row, column, 0]) - point.sum() / 57 * 255) <= 1.5


def test_keys_turn_and_show_them_and_undo_takes_back(document: Document) -> None:
    state = State.of(document, SIZE)
    history = History(state)
    shown = acted(state, "slices-in-space", document)
    assert shown.slice_planes == ("x=8", "y=7", "z=6") and shown.slices.in_space
    history.note(shown)
    assert history.has_unsaved_edits(shown)
    once = acted(shown, "turn-slices-x", document)
    history.note(once)
    assert len(once.slice_planes) == 3 and all(":" in text for text in once.slice_planes) and once.slices.shown
    back = acted(acted(once, "turn-slices-back-x", document), "turn-slices-y", document)
    assert np.allclose(
        back.slices.turn, turned(STRAIGHT, normals(once.slices, document.volume)[1] * 0 + [0, 1, 0], 5.0)
    )
    undone = history.undo(once)
    assert undone.slice_planes == shown.slice_planes and undone.slices.turn == STRAIGHT and undone.slices.shown
    assert history.redo(undone).slice_planes == once.slice_planes
    straight = acted(once, "straighten-slices", document)
    assert straight.slice_planes == shown.slice_planes and straight.slices.turn == STRAIGHT
    hidden = acted(once, "slices-in-space", document)
    assert not hidden.slice_planes and not hidden.slices.in_space
    sums = replace(state, settings=state.settings.replace(blend="mip"))
    assert "composite" in acted(sums, "slices-in-space", document).message


def test_a_drag_of_a_dot_turns_the_other_slices(document: Document) -> None:
    """By the angle at the common point, whatever the path; the wheel then moves along the normal."""
    state = acted(acted(State.of(document, SIZE), "slices", document), "slices-in-space", document)
    view, tool = Viewport(SIZE), SliceTool(lambda: None)
    pane = tool.panes(state, document, view)[0]
    _, dot = turn_dots(pane, state.slices, document.volume)[0]
    x, y = np.subtract(dot, pane.pixel(pane.plane.point))
    angle = np.radians(20.0)
    far = np.add(
        pane.pixel(pane.plane.point), [x * np.cos(angle) - y * np.sin(angle), x * np.sin(angle) + y * np.cos(angle)]
    )
    assert tool.press(state, document, view, Pointer(dot, "left")) is state
    passing = tool.move(state, document, view, Pointer((far[0] + 9, far[1] - 4)))
    assert passing is not None
    moved = tool.move(passing, document, view, Pointer(tuple(far.tolist())))
    assert moved is not None
    tool.release(moved, document, view, Pointer(dot, "left"))
    before, after = normals(state.slices, document.volume), normals(moved.slices, document.volume)
    assert np.allclose(after[pane.axis], before[pane.axis])
    assert np.allclose(np.delete((after * before).sum(axis=1), pane.axis), np.cos(angle))
    # the line of the other slice goes through the cursor
    now = tool.panes(moved, document, view)[0]
    ends = [np.array(place) for _, place in turn_dots(now, moved.slices, document.volume)[:2]]
    along, towards = ends[1] - ends[0], far - ends[0]
    assert abs(along[0] * towards[1] - along[1] * towards[0]) / np.linalg.norm(along) < 1.0
    assert moved.slice_planes == texts(moved.slices, document.volume)
    middle_of = ((pane.room[0] + pane.room[2]) / 2, (pane.room[1] + pane.room[3]) / 2)
    wheeled = tool.wheel(moved, document, view, Pointer(middle_of, notches=2))
    assert wheeled is not None
    pushed = middle(wheeled.slices, document.volume) - middle(moved.slices, document.volume)
    assert np.allclose(pushed, 2 * document.volume.spacing[pane.axis] * after[pane.axis])
    # a click sets the point that all contain
    clicked = tool.press(wheeled, document, view, Pointer((middle_of[0] + 7, middle_of[1] + 5), "left"))
    assert clicked is not None and clicked.slices.place != wheeled.slices.place
    assert tool.complete_marks(clicked, document, view).sprites


def test_the_window_draws_what_render_makes_of_its_scene(
    document: Document, renderer: sg.Renderer, tmp_path: Path
) -> None:
    state = acted(acted(State.of(document, (48, 40)), "slices-in-space", document), "turn-slices-y", document)
    scene = scene_of(state, document)
    assert scene.slice_planes == state.slice_planes
    name = save_scene(state, document, renderer.render, tmp_path).split()[-1]
    again = Document.open(SceneFile.from_toml(tmp_path / name))
    opened = State.of(again, (48, 40))
    assert opened.slice_planes == state.slice_planes and opened.slices.in_space
    assert np.allclose(opened.slices.turn, state.slices.turn)
    drawn = np.load(tmp_path / name.replace(".toml", ".npy"))
    same = sg.render(str(tmp_path / name))
    assert np.array_equal(drawn, same.pixels)
    without = replace(SceneFile.from_toml(tmp_path / name), slice_planes=())
    (tmp_path / "plain.toml").write_text(without.to_toml(tmp_path))
    assert np.abs(sg.render(str(tmp_path / "plain.toml")).pixels - drawn).max() > 0.2
