"""Segments in the window: their list, edits, names and boxes, and the scene that keeps them."""

from __future__ import annotations

from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import splatgl as sg
from splatgl.cli.main import main
from splatgl.data.volume import Label
from splatgl.errors import InputError
from splatgl.geometry.slices import SliceLayer
from splatgl.scene.draw import DrawOptions, draw
from splatgl.scene.open_scene import OpenScene
from splatgl.scene.scene_file import SceneFile
from splatgl.viewer.commands import COMMANDS, is_enabled
from splatgl.viewer.document import Document
from splatgl.viewer.measure_tool import describe_pick, under_cursor
from splatgl.viewer.saving import render_scene, save_scene, scene_of
from splatgl.viewer.segments import (
    find_segments,
    list_segments,
    segment_corners,
    segment_name,
    with_look,
    with_name,
    with_only,
    with_shown,
)
from splatgl.viewer.slice_planes import layer_painter
from splatgl.viewer.slice_views import panes
from splatgl.viewer.state import History, Slices, State
from tests.helpers.commands import acted
from tests.helpers.window import MISSING, Window, pointed

pytestmark = pytest.mark.usefixtures("shared_programs")

SIZE = (32, 24)
TABLE = (
    '# ITK-SnAP Label Description File\n1 200 40 30 1 1 1 "Liver"\n2 20 90 220 1 1 1 "Left kidney"\n'
    '3 40 200 60 0.5 0 1 "Tumour"\n'
)


def numbers() -> np.ndarray:
    """Three boxes beside each other along x."""
    samples = np.zeros((6, 8, 12), np.uint8)
    samples[1:5, 1:7, 1:4], samples[1:5, 1:7, 4:8], samples[2:4, 2:5, 8:11] = 1, 2, 3
    return samples


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("segments")
    sg.Volume(numbers(), labels=()).save(place / "seg.nrrd")
    (place / "seg.txt").write_text(TABLE)
    return place


@pytest.fixture(scope="module")
def document(folder: Path) -> Document:
    return Document.open(SceneFile(str(folder / "seg.nrrd"), settings=sg.Settings(antialias="off")))


@pytest.fixture
def state(document: Document) -> State:
    return replace(State.of(document, SIZE), annotate=())


def test_all_segments_of_the_table_are_listed(document: Document, state: State, folder: Path) -> None:
    """What the file hides and what a scene leaves out, too; showing it takes its own opacity."""
    layer = document.layers[0]
    rows = list_segments(tuple(state.style.base.labels), layer.volume.labels)
    assert [(row.number, row.name, row.color) for row in rows] == [
        (1, "Liver", "#c8281e"),
        (2, "Left kidney", "#145adc"),
        (3, "Tumour", "#28c83c"),
    ]
    assert state.style.hidden == {3} and layer.transfer == state.style.transfer
    assert state.style.transfer.opacity(np.array([1, 3])).tolist() == [0.99, 0.0]
    shown = with_shown(state.style, [3], True)
    assert shown.transfer.opacity(np.array([3])).tolist() == pytest.approx([0.99 / 2])
    scene = SceneFile(str(folder / "seg.nrrd"), transfer={"only_labels": ((2, 0.5),)})
    chosen = Document.open(scene).styles[0]
    assert chosen.hidden == {1, 3} and len(chosen.base.labels) == 3
    assert chosen.transfer.opacity(np.array([1, 2])).tolist() == pytest.approx([0.0, 0.99 / 2])


def test_segments_without_a_table_are_numbered(tmp_path: Path) -> None:
    np.save(tmp_path / "seg.npy", numbers())
    scene = SceneFile(str(tmp_path / "seg.npy"), load={"values": "labels"}, transfer={"only_labels": ((2, 1.0),)})
    document = Document.open(scene)
    rows = list_segments(tuple(document.styles[0].base.labels), document.volume.labels)
    assert [row.name for row in rows] == ["segment 1", "segment 2", "segment 3"]
    assert document.styles[0].hidden == {1, 3}


def test_segments_are_found_by_name_and_number() -> None:
    rows = list_segments(((1, "#ff0000", 0.9), (12, "#00ff00", 0.9)), (Label(1, "Left kidney"), Label(12, "Liver 1")))
    for text, found in (("", [1, 12]), ("kid LEFT", [1]), ("1", [1, 12]), ("12", [12]), ("spleen", [])):
        assert [row.number for row in find_segments(text, rows)] == found


def test_looks_are_edited_and_undone(document: Document, state: State) -> None:
    history = History(state)
    edited = state.with_style(0, with_look(with_only(state.style, 2), 2, "#ffff00", 0.3))
    history.note(edited)
    assert edited.style.hidden == {1, 3}
    assert edited.style.transfer.opacity(np.arange(4)).tolist() == pytest.approx([0, 0, 0.3, 0])
    assert edited.style.transfer.color(np.array([2]))[0].tolist() == [1.0, 1.0, 0.0]
    # opacities outlive hiding, and the factor on the extinction weakens segments
    again = acted(acted(edited, "segments-hide", document), "segments-show", document)
    assert not again.style.hidden and again.style.transfer.opacity(np.array([2])).tolist() == [0.3]
    assert acted(edited, "opacity-down", document).style.transfer.opacity(np.array([2]))[0] < 0.26
    back = history.undo(edited)
    assert back.styles == state.styles


def test_segments_are_renamed_and_saved(document: Document, state: State, folder: Path, tmp_path: Path) -> None:
    """In the list, under the cursor and in the scene file, which other commands read, too; "" is the file's name."""
    history = History(state)
    renamed = state.with_style(0, with_name(with_name(state.style, 2, " Left kidney, after "), 3, "Cyst"))
    history.note(renamed)
    rows = list_segments(tuple(renamed.style.base.labels), document.volume.labels, renamed.style.names)
    assert [row.name for row in rows] == ["Liver", "Left kidney, after", "Cyst"]
    assert (
        segment_name(renamed.style, document.volume, 3.0) == "Cyst"
        and segment_name(state.style, document.volume, 9) == ""
    )
    assert with_name(renamed.style, 3, "").names == ((2, "Left kidney, after"),)
    assert history.undo(renamed).styles == state.styles and history.has_unsaved_edits(renamed)
    (tmp_path / "scene.toml").write_text(scene_of(renamed, document).to_toml(tmp_path))
    again = Document.open(SceneFile.from_toml(tmp_path / "scene.toml"))
    assert again.styles[0].names == renamed.style.names
    assert [label.name for label in again.volume.labels or ()] == ["Liver", "Left kidney, after", "Cyst"]
    assert scene_of(State.of(again, SIZE), again).transfer["name_of"] == renamed.style.names


def test_names_of_segments_are_given_and_checked(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """By the command line, too; a volume without a table keeps its other segments."""
    np.save(tmp_path / "seg.npy", numbers())
    bare = SceneFile(str(tmp_path / "seg.npy"), load={"values": "labels"}, transfer={"name_of": [[3, "Cyst"]]})
    assert [(label.number, label.name) for label in bare.open().labels or ()] == [(1, ""), (2, ""), (3, "Cyst")]
    picture = str(tmp_path / "out.png")
    for name, message in (("7=Cyst", "--name-of: expected some of 1, 2, 3, got 7"), ("Cyst", "expected NUMBER=NAME")):
        with pytest.raises(SystemExit) if "=" not in name else nullcontext():
            assert main(["render", str(folder / "seg.nrrd"), "--name-of", name, "-o", picture]) == 2
        assert message in capsys.readouterr().err
    scene = SceneFile(str(folder / "seg.nrrd"), transfer={"name_of": 5})
    with pytest.raises(InputError, match="a number and a name for each segment"):
        scene.open()


def test_hidden_segments_are_clear_in_slices(state: State) -> None:
    volume = sg.Volume(np.array([[[0, 1, 2, 3]]], np.uint8))
    painter = layer_painter((SliceLayer(volume, with_only(state.style, 2).stated),), False, only=True)
    shown = panes(Slices(), volume, np.eye(3)[2], (300, 300))[0].pixels(painter)[0].tolist()
    assert shown == [[0] * 4, [0] * 4, [20, 90, 220, 255], [0] * 4]


def test_values_alone_have_no_segments() -> None:
    document = Document.open(SceneFile("tunnel"))
    state = State.of(document, SIZE)
    told = acted(state, "segments-hide", document)
    assert told.styles == state.styles and "no segments" in told.message


def test_segments_are_hidden_while_another_layer_is_selected(state: State, document: Document) -> None:
    """Those of all layers; of several segmentations those of the selected one."""
    values = Document.open(SceneFile("tunnel")).styles[0]
    several = replace(state, styles=(values, state.style, state.style))
    for selected, hidden in ((0, [0, 3, 3]), (2, [0, 1, 3])):
        told = acted(replace(several, selected=selected), "segments-hide", document)
        assert [len(style.hidden) for style in told.styles] == hidden
    command = next(command for command in COMMANDS if command.id == "segments-hide")
    assert is_enabled(command, several, document) and not is_enabled(
        command, replace(state, styles=(values,)), document
    )


@pytest.mark.parametrize("is_orthographic", [False, True])
def test_a_view_shows_a_whole_segment(document: Document, state: State, is_orthographic: bool) -> None:
    volume = replace(document.volume, spacing=(1.0, 2.0, 0.5), origin=(5.0, -3.0, 2.0))
    corners = segment_corners(volume, 3)
    assert corners is not None and segment_corners(volume, 9) is None
    places = np.argwhere(volume.samples == 3)[:, ::-1] @ volume.world_from_index.T + volume.origin
    half = np.abs(volume.world_from_index).sum(axis=1) / 2
    assert np.allclose(corners.min(axis=0), places.min(axis=0) - half)
    assert np.allclose(corners.max(axis=0), places.max(axis=0) + half)
    pose = state.pose.switched() if is_orthographic else state.pose
    fitted = pose.fitted(corners)
    assert np.array_equal(fitted.camera.eye_from_world, pose.camera.eye_from_world)
    assert np.allclose(fitted.pivot, corners.mean(axis=0))
    eye = fitted.camera.eye_from_points(corners)
    shares = np.abs(eye[:, :2]) / (eye[:, 2:] if fitted.camera.perspective else 1) / fitted.camera.extent * 2
    assert (eye[:, 2] > 0).all() and 0.75 < (shares / (SIZE[0] / SIZE[1], 1.0)).max() < 0.9


def test_the_value_under_the_cursor_says_the_name(document: Document, state: State) -> None:
    corners = segment_corners(document.volume, 2)
    assert corners is not None
    looked = replace(state, pose=state.pose.fitted(corners))
    lines = describe_pick(under_cursor(looked, document, (SIZE[0] / 2, SIZE[1] / 2)), document)
    assert lines[0] == "value: 2 Left kidney"


@pytest.mark.long
def test_a_saved_scene_keeps_segments(document: Document, state: State, renderer: sg.Renderer, folder: Path) -> None:
    """Bit for bit, and again in the window."""
    style = with_look(with_shown(with_shown(state.style, [3], True), [1], False), 3, "#ff00ff", 0.4)
    edited = state.with_style(0, style)
    name = save_scene(edited, document, renderer.render, folder).split()[-1]
    options = ["--backend", renderer.info.backend, "--quiet"]
    assert main(["render", str(folder / name), "-o", str(folder / "again.npy"), *options]) == 0
    saved = np.load((folder / name).with_suffix(".npy"))
    assert np.array_equal(saved, np.load(folder / "again.npy")) and saved[..., 3].max() > 0.2
    again = Document.open(SceneFile.from_toml(folder / name)).styles[0]
    assert again.hidden == {1} and again.transfer == style.transfer


def test_segments_are_smooth_in_the_window(document: Document, state: State, renderer: sg.Renderer) -> None:
    """Once the finest splats are there, as `render` draws them; other colours take no new surfaces."""
    smooth = state.with_style(0, replace(state.style, surfaces=0.5))
    shown = document.with_styles(smooth.styles, (), smooth.settings)
    assert shown.is_layered and shown.layers[0].meshes is None and len(shown.scene_at(1, ()).meshes) == 0
    shown.extract(1)
    assert [mesh.name for mesh in shown.scene_at(1, ()).meshes] == ["1", "2"]
    scene = scene_of(smooth, shown)
    assert scene.surfaces == 0.5 and Document.open(scene, quiet=True).styles[0].surfaces == 0.5
    saved = render_scene(scene, shown, renderer.render)
    drawn = draw(OpenScene.read(scene), DrawOptions(is_shared=True, check=0))
    assert np.array_equal(saved.pixels, drawn.pixels) and saved.pixels[..., 3].max() > 0.2
    blue = with_look(smooth.style, 1, "#0000ff", 0.995)
    (first, _) = shown.with_styles((blue,), (), smooth.settings).layers[0].meshes or ()
    assert first.color == (0.0, 0.0, 1.0) and first.opacity == 1.0
    assert shown.with_styles((with_shown(blue, [2], False),), (), smooth.settings).layers[0].meshes is None


@pytest.mark.skipif(bool(MISSING), reason=f"needs {' and '.join(MISSING)}: apt-get install xvfb xdotool")
@pytest.mark.long
def test_the_list_hides_and_centres(folder: Path) -> None:
    pytest.importorskip("imgui_bundle", reason="needs the extra gui: pip install splatgl[gui]")
    window = Window(folder / "seg.nrrd", folder, size=(600, 450), panel=True)
    before = window.ask("look")
    pointed(window, 282, 141)
    window.hands("click", 1)
    assert window.ask("settle")["hidden"] == [1, 3]
    pointed(window, 360, 166)
    window.hands("click", 1)
    told = window.ask("settle")
    assert not np.allclose(told["eye"], before["eye"]) and told["axes"] == before["axes"]
    assert window.key("ctrl+z")["eye"] == before["eye"] and window.key("ctrl+z")["hidden"] == [3]
    # a right click opens the field of a name
    window.hands("click", 3)
    assert window.ask("settle")["dialog"]
    window.hands("type", "Cyst")
    assert window.key("enter")["names"] == [[2, "Cyst"]]
    assert window.key("ctrl+z")["names"] == []
    window.end()
