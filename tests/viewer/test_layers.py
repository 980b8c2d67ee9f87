"""Layers and meshes that are added, moved, renamed and removed in the window, and the questions on dropped files."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import splatgl as sg
from splatgl.cli.main import main
from splatgl.scene.meshes import MeshFile, source_key
from splatgl.scene.scene_file import SceneFile
from splatgl.viewer.commands import Copy, LeaveDocument, Open, ask_for_files, with_settings
from splatgl.viewer.document import Document
from splatgl.viewer.jobs import Jobs
from splatgl.viewer.loading import AddedFiles, Files
from splatgl.viewer.saving import copy_text, save_scene, scene_of, source_files
from splatgl.viewer.state import History, State, stated_transfers
from tests.helpers.blobs import blob
from tests.helpers.window import MISSING, Window, pointed

pytestmark = pytest.mark.usefixtures("shared_programs")

SIZE = (32, 24)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("layers")
    np.save(place / "blob.npy", blob(10).samples)
    np.save(place / "other.npy", blob(8).samples[::-1])
    labels = np.zeros((8, 8, 8), np.uint8)
    labels[1:4, 1:7, 1:7], labels[4:7, 1:7, 1:7] = 1, 2
    sg.Volume(labels, labels=()).save(place / "seg.nrrd")
    np.savez(place / "two.npz", a=blob(8).samples, b=blob(6).samples)
    (place / "m.off").write_text("OFF\n3 1 0\n0 0 0\n9 0 0\n0 9 0\n3 0 1 2\n")
    return place


@pytest.fixture(scope="module")
def document(folder: Path) -> Document:
    return Document.open(SceneFile(str(folder / "blob.npy"), settings=sg.Settings(antialias="off")))


def read(document: Document, folder: Path, names: Sequence[str]) -> AddedFiles:
    """What is read to be added to a document."""
    files = Files(Jobs(lambda: None), (), None, 0.0)
    files.add([str(folder / name) for name in names], document.scene)
    assert files.jobs.wait(60)
    (done,) = files.jobs.collect()
    if done.error is not None:
        raise done.error
    assert isinstance(done.value, AddedFiles)
    return done.value


def added(state: State, document: Document, folder: Path, *names: str) -> tuple[State, Document]:
    return read(document, folder, names).added_to(state, document)


def shown(state: State, document: Document) -> Document:
    return document.with_styles(state.styles, state.mesh_files, state.settings)


def started(document: Document) -> State:
    return replace(State.of(document, SIZE), annotate=())


def test_added_layers_are_undone_and_redone(document: Document, folder: Path) -> None:
    pytest.importorskip("trimesh")
    state = started(document)
    history = History(state)
    state, document = added(state, document, folder, "other.npy", "seg.nrrd", "m.off")
    history.note(state)
    drawn = shown(state, document)
    assert drawn.names == ("blob", "other", "seg") and len(drawn.meshes) == 1 and state.selected == 1
    assert drawn.layers[0].by_stride and "other, seg, m.off" in state.message
    assert {style.number for style in state.styles} == {0, -1, -2}
    back = history.undo(state)
    assert shown(back, drawn).names == ("blob",) and not shown(back, drawn).meshes
    again = shown(history.redo(back), shown(back, drawn))
    # what was extracted is kept; the first layer is faint under segments
    assert again.names == drawn.names and all(a is b for a, b in zip(again.layers[1:], drawn.layers[1:], strict=True))
    assert again.layers[0].by_stride.keys() == drawn.layers[0].by_stride.keys() and back.styles[0].opacity == 1.0
    assert again.styles[0].opacity < 0.2 and "blob is faint" in state.message
    # overwriting what undo restores is refused
    assert str(folder / "seg.nrrd") in source_files(shown(back, drawn))


def test_an_edited_volume_is_faint_under_segments_once(document: Document, folder: Path) -> None:
    """What is faint already stays."""
    edited = started(document).edit(extinction=2.0)
    state, now = added(edited, document, folder, "seg.nrrd")
    assert state.styles[0].opacity < 0.2 and "blob is faint" in state.message
    again, _ = added(state, now, folder, "seg.nrrd")
    assert again.styles[0].opacity == pytest.approx(state.styles[0].opacity) and "faint" not in again.message


def test_a_file_of_several_volumes_gives_its_first(document: Document, folder: Path) -> None:
    ((layer, _),) = read(document, folder, ["two.npz"]).parts
    assert layer.volume.shape == (8, 8, 8) and layer.scene.load == {"array": "a"}


def test_bad_files_add_nothing(document: Document, folder: Path) -> None:
    (folder / "bad.npy").write_bytes(b"\x93NUMPY not quite")
    with pytest.raises(sg.InputError, match=r"bad\.npy"):
        read(document, folder, ["other.npy", "bad.npy"])


def test_more_layers_than_a_picture_has_are_hidden(document: Document, folder: Path) -> None:
    state = started(document)
    part = read(document, folder, ["other.npy"]).parts[0]
    state, document = AddedFiles((part,) * 8, (), {}).added_to(state, document)
    assert [style.visible for style in state.styles] == [True] * 8 + [False] and "8 layers at most" in state.message
    assert len(shown(state, document).drawn_layers) == 8


def test_layers_stay_with_what_is_read_meanwhile(document: Document, folder: Path) -> None:
    """Time points, and finer voxels that were asked for before."""
    state, now = added(started(document), document, folder, "other.npy")
    for news in (Document.open(SceneFile(str(folder / "other.npy"))), replace(document)):
        drawn = shown(state, news.with_additions(shown(state, now)))
        assert drawn.names[1] == "other" and drawn.layers[0].volume is news.volume
        assert news.file_numbers == {0} and list(stated_transfers(state.styles)) == [0]
    based = state.with_bases(news, True)
    assert len(based.styles) == 2 and based.with_bases(news, False).styles[1] == state.styles[1]


def test_layers_are_moved_renamed_and_removed(document: Document, folder: Path) -> None:
    pytest.importorskip("imgui_bundle")
    from splatgl.viewer.layers_panel import DOWN, REMOVE, UP, move_layer

    state, document = added(started(document), document, folder, "other.npy", "seg.nrrd")
    state = state.with_style(2, replace(state.styles[2], title="liver"))
    assert shown(state, document).names == ("blob", "other", "liver") and state.selected == 1
    up = move_layer(state, 2, UP)
    assert shown(up, document).names == ("blob", "liver", "other") and up.selected == 2
    assert move_layer(up, 1, DOWN).styles == state.styles
    for number, action in ((0, DOWN), (0, REMOVE), (1, UP)):
        refused = move_layer(state, number, action)
        assert refused.styles == state.styles and "first" in refused.message
    gone = move_layer(state, 1, REMOVE)
    assert shown(gone, document).names == ("blob", "liver") and gone.selected == 0
    assert move_layer(gone, 1, DOWN).styles == gone.styles


@pytest.mark.long
def test_a_saved_scene_keeps_layers(document: Document, renderer: sg.Renderer, folder: Path) -> None:
    """Bit for bit, in every form, and again in the window."""
    pytest.importorskip("trimesh")
    state, now = added(started(document), document, folder, "seg.nrrd", "other.npy", "m.off")
    other, seg = state.styles[2], replace(state.styles[1], title="liver", opacity=0.5, hidden=frozenset({2}))
    state = replace(state, styles=(state.styles[0], other, seg))
    state = replace(state, mesh_files=(replace(state.mesh_files[0], title="plane", opacity=0.7),))
    name = save_scene(state, now, renderer.render, folder).split()[-1]
    options = ["--backend", renderer.info.backend, "--quiet"]
    assert main(["render", str(folder / name), "-o", str(folder / "again.npy"), *options]) == 0
    assert np.array_equal(np.load((folder / name).with_suffix(".npy")), np.load(folder / "again.npy"))
    again = Document.open(SceneFile.from_toml(folder / name))
    assert again.names == ("blob", "other", "liver") and again.mesh_files[0].name == "plane"
    assert again.styles[2].hidden == {2} and again.styles[2].opacity == 0.5
    assert "liver" in copy_text(Copy.SCENE, state, now)
    assert scene_of(started(again), again).layers[1].title == "liver"


def test_dropped_files_are_asked_for() -> None:
    for paths, first in (
        (("a.npy",), "open"),
        (("m.stl",), "open"),
        (("a.npy", "b.npy"), "play as series"),
        (("a.npy", "m.stl"), "open"),
        (("a.npy", "a_seg.npy"), "open"),
        (("1_seg.npy", "2_seg.npy"), "play as series"),
    ):
        question = ask_for_files(paths)
        (text, opens), (_, adds), (_, nothing) = question.answers
        assert (text, opens, adds, nothing) == (first, Open(paths), Open(paths, adds=True), None)
    assert ask_for_files(list("abcde")).text == "a, b, c and 2 more"
    # once, although edits would be lost
    question, opens = ask_for_files(["a.npy"], is_edited=True), Open(("a.npy",))
    effects = [effect for _, effect in question.answers]
    assert effects == [LeaveDocument(opens, saves=True), LeaveDocument(opens), replace(opens, adds=True), None]
    assert question.text == "a.npy. Edits are not saved."


def test_a_title_of_a_mesh_is_no_part_of_its_data() -> None:
    assert source_key(MeshFile("m.stl", title="skull", opacity=0.5)) == source_key(MeshFile("m.stl"))


@pytest.mark.skipif(bool(MISSING), reason=f"needs {' and '.join(MISSING)}: apt-get install xvfb xdotool")
@pytest.mark.long
def test_a_dropped_file_is_added(folder: Path) -> None:
    """The question waits for an answer, undo takes the layer away, and an error stays until it is closed."""
    pytest.importorskip("imgui_bundle", reason="needs the extra gui: pip install splatgl[gui]")
    window = Window(folder / "blob.npy", folder, size=(600, 450), panel=True)
    # a name says that it is a segmentation
    assert window.drop(folder / "seg.nrrd", is_answered=False)["layers"] == ["blob", "seg"]
    assert window.key("ctrl+z")["layers"] == ["blob"]
    shutil.copy(folder / "blob.npy", folder / "more.npy")
    assert window.drop(folder / "more.npy", is_answered=False)["dialog"]
    told = window.key("escape")
    assert not told["dialog"] and told["layers"] == ["blob"]
    window.drop(folder / "more.npy", is_answered=False)
    pointed(window, 176, 245)
    window.hands("click", 1)
    assert window.ask("settle")["layers"] == ["blob", "more"]
    assert window.key("ctrl+z")["layers"] == ["blob"]
    # an error stays until it is closed
    (folder / "bad.npy").write_bytes(b"\x93NUMPY not quite")
    assert (
        window.drop(folder / "bad.npy")["dialog"] and window.key("b")["dialog"] and not window.key("escape")["dialog"]
    )
    window.end(notes=1)


def test_channels_keep_full_light_in_the_blend_that_is_chosen(tmp_path: Path, renderer: sg.Renderer) -> None:
    """As if the scene had been opened in it; and as before in the blend before."""
    z, y, x = np.indices((12, 20, 24))
    balls = [1000 * np.exp(-((x - cx) ** 2 + (y - 10) ** 2 + (z - 6) ** 2) / 12) for cx in (8, 16)]
    parts = [sg.Volume(ball.astype(np.float32), name=name) for ball, name in zip(balls, ("GFP", "DAPI"), strict=True)]
    replace(parts[0], channels=tuple(parts)).save(tmp_path / "a.zarr")
    scene = SceneFile(str(tmp_path / "a.zarr"), load={"channel": "all"})
    document = Document.open(scene, quiet=True)
    state = State.of(document, (48, 40))
    shown = with_settings(state, document, state.settings.replace(blend="mip"))
    opened = Document.open(replace(scene, settings=state.settings.replace(blend="mip")), quiet=True)
    for style, right in zip(shown.styles, opened.styles, strict=True):
        assert np.allclose(style.base.points, right.base.points) and style.base.colormap == right.base.colormap
    back = with_settings(shown, document, state.settings)
    for style, right in zip(back.styles, state.styles, strict=True):
        assert np.allclose(style.base.points, right.base.points)
    subject, settings = document.with_styles(shown.styles, (), shown.settings).subject_at(1, shown.settings)
    pixels = renderer.render(subject, state.pose.camera, settings).pixels
    assert pixels[..., 1].max() > 0.6 and pixels[..., 2].max() > 0.9
