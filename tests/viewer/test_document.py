"""Layers, channels and meshes in the window: the pictures of `splatgl render`, edits, drops and what is refused."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import splatgl as sg
from splatgl.annotations.canvas import AnnotatedSubject
from splatgl.cli.main import main
from splatgl.errors import InputError, MissingOption
from splatgl.scene.meshes import MeshFile, read_meshes
from splatgl.scene.open_scene import OpenScene
from splatgl.scene.scene_file import SceneFile
from splatgl.scene.view import ViewOptions
from splatgl.viewer.commands import why_not
from splatgl.viewer.document import Document
from splatgl.viewer.files import watched_files
from splatgl.viewer.hud import Overlays
from splatgl.viewer.loading import open_document
from splatgl.viewer.saving import render_scene, save_picture, save_scene, scene_of
from splatgl.viewer.state import History, State
from tests.helpers.blobs import blob
from tests.helpers.commands import acted
from tests.helpers.window import MISSING, Window

pytestmark = pytest.mark.usefixtures("shared_programs")

SIZE = (96, 72)
# the panel of a window of 640 × 460 pixels
WIDE = (640, 460)
OPAQUE = 'volume = "blob.npy"\nthreshold = 0.01\n[transfer]\npoints = [[4.0, 0.0], [30.0, 0.6]]\n'
TWO = """
[settings]
antialias = "off"
[[layer]]
volume = "other.npy"
opacity = 0.4
clip = ["x>0.4"]
[layer.transfer]
points = [[3.0, 0.0], [20.0, 0.7]]
colormap = "hot"
[[mesh]]
file = "ball.ply"
color = "red"
[[mesh]]
file = "wall.stl"
opacity = 0.5
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("layers")
    trimesh = pytest.importorskip("trimesh")
    np.save(place / "blob.npy", blob(14).samples)
    np.save(place / "other.npy", blob(10).samples[::-1])
    for name, mesh, at in (
        ("ball.ply", trimesh.creation.icosphere(2, 4.0), (12, 4, 6)),
        ("wall.stl", trimesh.creation.box((12, 1, 12)), (6, 9, 6)),
    ):
        mesh.apply_translation(at)
        mesh.export(place / name)
    (place / "two.toml").write_text(OPAQUE + TWO)
    (place / "cut.ply").write_bytes((place / "ball.ply").read_bytes()[:700])
    return place


@pytest.fixture(scope="module")
def document(folder: Path) -> Document:
    return Document.open(SceneFile.from_toml(folder / "two.toml"))


@pytest.fixture
def state(document: Document) -> State:
    return State.of(document, SIZE)


def saved(state: State, document: Document, renderer: sg.Renderer, folder: Path) -> tuple[np.ndarray, np.ndarray]:
    """What the window draws of a state, and what `splatgl render` makes of the scene that it saves."""
    state = replace(state, annotate=())
    drawn = document.with_styles(state.styles, state.mesh_files, state.settings)
    subject, settings = drawn.subject_at(1, state.settings)
    shown = renderer.render(subject, state.pose.camera, settings, verify_bound=False).pixels
    name = save_scene(state, document, renderer.render, folder).split()[-1]
    options = ["--backend", renderer.info.backend, "--quiet"]
    assert main(["render", str(folder / name), "-o", str(folder / "again.npy"), *options]) == 0
    again = np.load(folder / "again.npy")
    assert np.array_equal(np.load((folder / name).with_suffix(".npy")), again)
    return shown, again


def turned(state: State) -> State:
    return replace(state, pose=state.pose.rotated((40, 30), (60, 40)))


# --- pictures -----------------------------------------------------------------------------------------------------


@pytest.mark.long
def test_a_saved_scene_renders_equal(
    state: State, document: Document, renderer: sg.Renderer, folder: Path, tmp_path: Path
) -> None:
    """Bit for bit, also edited: another transfer function, opacities, a hidden mesh, one in another colour."""
    plain, again = saved(turned(state), document, renderer, folder)
    # the view is saved as numbers, which round
    assert np.abs(plain - again).max() < 1e-4 and plain[..., 3].max() > 0.9
    look = replace(state.styles[1], opacity=0.8)
    edited = turned(acted(replace(state.with_style(1, look), selected=1), "opacity-down", document))
    ball, wall = edited.mesh_files
    edited = replace(edited, mesh_files=(replace(ball, visible=False), replace(wall, color="#30a0ff")))
    other, again = saved(edited, document, renderer, folder)
    assert np.abs(other - again).max() < 1e-4 and np.abs(other - plain).max() > 0.2


@pytest.mark.long
def test_a_saved_scene_keeps_its_size_on_paper(folder: Path, renderer: sg.Renderer, tmp_path: Path) -> None:
    """Its floats are those of render at that size; a picture is as large as in the window."""
    view = ViewOptions(size=(48, 36), dpi=72.0, width="1in")
    document = Document.open(SceneFile(str(folder / "blob.npy"), view=view))
    state = State.of(document, SIZE)
    name = save_scene(state, document, renderer.render, tmp_path).split()[-1]
    again = SceneFile.from_toml(tmp_path / name).view
    assert (again.dpi, again.width, again.size) == (72.0, "1in", (72, round(72 * SIZE[1] / SIZE[0])))
    assert np.load((tmp_path / name).with_suffix(".npy")).shape[:2] == again.size[::-1]
    picture = save_picture(state, document, renderer.render, tmp_path).split()[-1]
    assert sg.Image.load(tmp_path / picture).pixels.shape[:2] == SIZE[::-1]


def test_hidden_parts_are_not_drawn(state: State, document: Document, renderer: sg.Renderer, folder: Path) -> None:
    """The first one hidden, all hidden but meshes, and the volume alone, which is the picture of one volume."""
    first, second = state.styles
    hidden = state.with_style(0, replace(first, visible=False))
    without, again = saved(hidden, document, renderer, folder)
    assert np.abs(without - again).max() < 1e-4
    bare = hidden.with_style(1, replace(second, visible=False))
    meshes, again = saved(bare, document, renderer, folder)
    assert np.abs(meshes - again).max() < 1e-4 and 0.9 < meshes[..., 3].max() <= 1
    alone = state.with_style(1, replace(second, opacity=0.0))
    shown, again = saved(replace(alone, mesh_files=()), document, renderer, folder)
    (folder / "one.toml").write_text(OPAQUE + '[settings]\nantialias = "off"\n')
    one = Document.open(SceneFile.from_toml(folder / "one.toml"))
    right = renderer.render(
        one.layers[0].at(1), state.pose.camera, sg.Settings(antialias="off", background="white")
    ).pixels
    assert np.abs(shown - again).max() < 1e-4 and np.array_equal(shown, right)


def test_the_view_is_that_of_render(document: Document, folder: Path) -> None:
    from splatgl.scene.open_scene import OpenScene

    scene = SceneFile.from_toml(folder / "two.toml")
    volume = scene.open()
    right = replace(scene.view, size=SIZE).camera(volume, OpenScene.of(scene, volume).scene)
    found = document.home(SIZE).camera
    assert np.array_equal(found.eye, right.eye) and np.array_equal(found.eye_from_world, right.eye_from_world)


@pytest.mark.long
def test_an_opacity_weakens_once(folder: Path, tmp_path: Path, renderer: sg.Renderer) -> None:
    """Of one volume, too: a saved scene that keeps the factor beside points with it would be fainter."""
    text = 'volume = "blob.npy"\nopacity = 0.3\n[settings]\nantialias = "off"\nbackground = "transparent"\n'
    (folder / "faint.toml").write_text(text)
    document = Document.open(SceneFile.from_toml(folder / "faint.toml"))
    shown, again = saved(turned(State.of(document, SIZE)), document, renderer, folder)
    assert np.abs(shown - again).max() < 1e-4 and 0.01 < shown[..., 3].max() < 0.9


def test_channels_are_parts(folder: Path, renderer: sg.Renderer) -> None:
    tifffile = pytest.importorskip("tifffile")
    planes = np.stack([blob(12).samples.astype(np.uint16) * 50, blob(12).samples[::-1].astype(np.uint16) * 40], 1)
    channel = {"Name": ["one", "two"]}
    tifffile.imwrite(folder / "c.ome.tif", planes, ome=True, metadata={"axes": "ZCYX", "Channel": channel})
    document, picks = open_document(
        SceneFile(str(folder / "c.ome.tif"), {"channel": "all"}, settings=sg.Settings(antialias="off"))
    )
    assert document.names == ("one", "two")
    assert [(option.option, option.selected(document.scene.load)) for option in picks] == [("channel", 0)]
    assert [value for value, _ in picks[0].values] == ["all", "0", "1"]
    state = State.of(document, SIZE)
    plain, again = saved(state, document, renderer, folder)
    assert np.abs(plain - again).max() < 1e-4
    look = replace(state.styles[1], base=replace(state.styles[1].base, colormap="#ff8800"))
    other, again = saved(state.with_style(1, look), document, renderer, folder)
    assert np.abs(other - again).max() < 1e-4 and np.abs(other - plain).max() > 0.02
    # a scene file has one transfer function: the other channel is a layer of it
    assert [each.load["channel"] for each in scene_of(state, document).layers] == [1]


def test_legends_and_reopened_scenes_have_the_names_of_channels(
    tmp_path: Path, renderer: sg.Renderer, monkeypatch: pytest.MonkeyPatch
) -> None:
    """And those that the user gives, as on the screen."""
    parts = [sg.Volume(blob(12).samples, name=name) for name in ("one", "two")]
    replace(parts[0], channels=tuple(parts)).save(tmp_path / "c.ome.zarr")
    document = Document.open(SceneFile(str(tmp_path / "c.ome.zarr"), load={"channel": "all"}))
    state = replace(State.of(document, SIZE), annotate=("legend",))
    state = state.with_style(1, replace(state.styles[1], title="nuclei"))
    shown: list[tuple[str, ...]] = []
    overlays = Overlays()

    def draw(subject: AnnotatedSubject, *_: object) -> np.ndarray:
        shown.append(tuple(name for name, _ in subject.legend))
        return np.zeros((1, 1, 4), np.uint8)

    monkeypatch.setattr(overlays.overlay, "draw", draw)
    overlays.annotations(state, document)
    scene = scene_of(state, document)
    legend = OpenScene.read(scene, True).annotated_subject.legend
    assert shown == [("one", "nuclei")] and tuple(name for name, _ in legend) == shown[0]
    assert Document.open(scene).names == shown[0]
    # in saved pictures, too
    for save in (save_picture, save_scene):
        save(state, document, renderer.render, tmp_path)
    options = ["--backend", renderer.info.backend, "--quiet"]
    assert main(["render", str(tmp_path / "scene-001.toml"), "-o", str(tmp_path / "again.png"), *options]) == 0
    pictures = [sg.Image.load(tmp_path / name).pixels for name in ("picture-001.png", "again.png")]
    assert np.array_equal(*pictures) and pictures[0][:20, :20].max() == 1


def test_scenes_state_a_classification_that_all_layers_allow(folder: Path) -> None:
    """Labels are classified before reconstruction, of whatever the others are."""
    np.save(folder / "ones.npy", (blob(12).samples > blob(12).samples.mean()).astype(np.uint8))
    labels = SceneFile(str(folder / "ones.npy"), load={"values": "labels"})
    scene = SceneFile(str(folder / "blob.npy"), settings=sg.Settings(classification="auto"))
    for source, stated in ((scene, "post"), (replace(scene, layers=(labels,)), "auto"), (labels, "pre")):
        document = Document.open(source)
        state = State.of(document, SIZE)
        state = replace(state, settings=state.settings.replace(classification="post"))
        assert scene_of(state, document).settings.classification == stated


@pytest.mark.long
def test_coarser_strides_in_motion(folder: Path, renderer: sg.Renderer) -> None:
    """All parts have them: the picture is nearly the same, of fewer splats."""
    np.save(folder / "large.npy", blob(40).samples)
    scene = SceneFile.from_toml(folder / "two.toml")
    document = Document.open(replace(scene, volume=str(folder / "large.npy")))
    state = State.of(document, SIZE)
    assert set(document.extracted) < {1, 2, 4, 8}
    for stride in (2, 1):
        document.extract(stride)
    assert document.counts[1] < document.counts[0] / 4 and {1, 2} <= set(document.extracted)
    fine, coarse = (
        renderer.render(subject, state.pose.camera, settings).pixels
        for subject, settings in (document.subject_at(stride, state.settings) for stride in (1, 2))
    )
    assert 0 < np.abs(fine - coarse).mean() < 0.02


# --- edits --------------------------------------------------------------------------------------------------------


def test_edits_are_of_what_is_selected(state: State, document: Document) -> None:
    edited = acted(replace(state, selected=1), "opacity-up", document)
    assert edited.styles[0] == state.styles[0] and edited.styles[1].extinction == 1.25
    assert edited.style is edited.styles[1] and replace(edited, selected=0).style == state.style
    drawn = document.with_styles(edited.styles, edited.mesh_files, edited.settings)
    assert drawn.layers[0] is document.layers[0] and drawn.layers[1] is not document.layers[1]
    assert drawn.with_styles(edited.styles, edited.mesh_files, edited.settings) is drawn


def test_edits_are_undone(state: State) -> None:
    history = History(state)
    assert not history.has_unsaved_edits(replace(state, selected=1))
    hidden = state.with_style(1, replace(state.styles[1], visible=False))
    history.note(hidden)
    assert history.has_unsaved_edits(hidden)
    faint = replace(hidden, mesh_files=(replace(hidden.mesh_files[0], opacity=0.2), hidden.mesh_files[1]))
    history.note(faint)
    assert history.has_unsaved_edits(faint)
    back = history.undo(faint)
    assert back.mesh_files == state.mesh_files and back.styles == hidden.styles
    back = history.undo(back)
    assert back.styles == state.styles and not history.has_unsaved_edits(back)


def test_meshes_look_as_their_files_say(folder: Path) -> None:
    """Colour and opacity are changed without reading again."""
    file = MeshFile(str(folder / "ball.ply"), "#3366cc", 0.3)
    found = Document.open(SceneFile(str(folder / "blob.npy"))).with_meshes(read_meshes([file]))
    made = found.with_styles(found.styles, (file,), sg.Settings())
    (mesh,) = made.meshes
    right = file.open()
    assert np.array_equal(mesh.shades, right.shades) and mesh.opacity == right.opacity
    assert np.array_equal(mesh.normals, right.normals)


def test_opacities_of_layers_are_those_of_stills(folder: Path) -> None:
    """Beside the transfer functions, also of the first: slices of layers that add up multiply them."""
    from splatgl.scene.open_scene import OpenScene

    other = SceneFile(str(folder / "blob.npy"), opacity=0.3)
    scene = replace(other, opacity=0.5, layers=(other,))
    opacities = [layer.opacity for layer in OpenScene.read(scene).scene.shown]
    assert opacities == [style.opacity for style in Document.open(scene).styles] == [0.5, 0.3]


def test_blends_without_an_order_draw_no_meshes(state: State, document: Document) -> None:
    assert why_not(state.settings.replace(blend="mip"), state, document)
    assert acted(state, "blend", document).settings.blend == "composite"


# --- files --------------------------------------------------------------------------------------------------------


def test_a_mesh_alone(folder: Path, renderer: sg.Renderer) -> None:
    """It opens, and its look is saved."""
    scene = SceneFile(str(folder / "ball.ply"), settings=sg.Settings(antialias="off", background="transparent"))
    document = Document.open(scene)
    state = State.of(document, SIZE)
    plain, again = saved(state, document, renderer, folder)
    assert np.abs(plain - again).max() < 1e-4 and plain[..., 3].max() > 0.9
    blue = replace(state, mesh_files=(replace(state.mesh_files[0], color="blue"),))
    shown, again = saved(blue, document, renderer, folder)
    assert np.abs(shown - again).max() < 1e-4 and shown[..., 0].max() == 0 < shown[..., 2].max()


@pytest.mark.long
def test_a_mesh_in_memory_is_not_saved(folder: Path, renderer: sg.Renderer) -> None:
    mesh = MeshFile(str(folder / "ball.ply")).open()
    document = Document.open(SceneFile(str(folder / "blob.npy"), meshes=(MeshFile.of(mesh),)))
    with pytest.raises(InputError, match="meshes in files"):
        save_scene(State.of(document, SIZE), document, renderer.render, folder)


@pytest.mark.long
def test_as_many_layers_as_a_picture_has(folder: Path, renderer: sg.Renderer) -> None:
    """Eight are drawn; nine are told, unless some are hidden."""
    base, layer = SceneFile(str(folder / "other.npy")), SceneFile(str(folder / "other.npy"), opacity=0.1)
    document = Document.open(replace(base, layers=(layer,) * 7, settings=sg.Settings(antialias="off")))
    state = State.of(document, (48, 36))
    picture = render_scene(replace(scene_of(state, document), annotate=()), document, renderer.render)
    assert len(document.names) == 8 and picture.pixels[..., 3].max() > 0.5
    with pytest.raises(InputError, match="at most 8 that are visible, got 9"):
        Document.open(replace(base, layers=(layer,) * 8))
    assert len(Document.open(replace(base, layers=(*(layer,) * 7, replace(layer, visible=False)))).names) == 9


def test_what_is_missing_or_damaged_is_told(folder: Path) -> None:
    scene = SceneFile.from_toml(folder / "two.toml")
    with pytest.raises(InputError, match="gone"):
        Document.open(replace(scene, layers=(SceneFile(str(folder / "gone.npy")),)))
    with pytest.raises(InputError, match="cut"):
        Document.open(replace(scene, meshes=(MeshFile(str(folder / "cut.ply")),)))
    names = {Path(each).name for each in watched_files(str(folder / "two.toml"), scene)}
    assert names == {"two.toml", "blob.npy", "other.npy", "ball.ply", "wall.stl"}


def test_one_of_several_arrays(folder: Path) -> None:
    """The first is shown where one must be picked, and all are offered."""
    h5py = pytest.importorskip("h5py")
    with h5py.File(folder / "many.h5", "w") as file:
        file["/a"], file["/group/b"] = blob(8).samples, blob(12).samples
    np.savez(folder / "many.npz", first=blob(8).samples, second=blob(10).samples)
    for name, names in (("many.h5", ["/a", "/group/b"]), ("many.npz", ["first", "second"])):
        with pytest.raises(MissingOption):
            Document.open(SceneFile(str(folder / name)))
        document, (pick,) = open_document(SceneFile(str(folder / name)))
        assert pick.option == "array" and [value for value, _ in pick.values] == names
        assert document.scene.load == {"array": names[0]} and pick.selected(document.scene.load) == 0
        document, (pick,) = open_document(SceneFile(str(folder / name), {"array": names[1]}))
        assert pick.selected(document.scene.load) == 1 and document.volume.shape[0] > 8


# --- a window -----------------------------------------------------------------------------------------------------


@pytest.fixture
def window(folder: Path) -> Iterator[Window]:
    if MISSING:
        pytest.skip(f"needs {' and '.join(MISSING)}")
    window = Window(folder / "two.toml", folder, size=WIDE, panel=True)
    yield window
    window.end()


def click(window: Window, x: int, y: int) -> dict[str, object]:
    window.hands("mousemove", x, y)
    window.ask("look")
    window.hands("click", 1)
    window.ask("settle")
    return window.ask("settle")


@pytest.mark.long
def test_the_window_shows_what_is_saved(window: Window, folder: Path) -> None:
    """A drag, a mesh hidden in the panel and shown again by undo, drops, and the picture that render makes."""
    pytest.importorskip("imgui_bundle")
    whole = window.ask("settle")
    before = window.shot().astype(int)
    # the list of layers begins below the headers of files and layers; its third row is the ball's
    hidden = click(window, 327, 128)
    shown = window.shot().astype(int)
    assert (np.abs(shown - before)[:, :300].max() > 60) and hidden["message"] == ""
    assert window.key("ctrl+z")["message"] == "undone"
    window.hands("mousemove", 60, 440)
    window.ask("settle")
    # below the words
    assert np.abs(window.shot().astype(int) - before)[160:, :300].max() <= 1
    # a dropped mesh is added to what is shown; a damaged one is told until that is closed
    window.drop(folder / "ball.ply", is_answered=False)
    added = click(window, 196, 250)
    assert "ball.ply: added" in added["message"] and added["source"] == whole["source"]
    window.drop(folder / "cut.ply", is_answered=False)
    assert click(window, 196, 250)["dialog"] and not window.key("escape")["dialog"]
    window.drag(1, (100, 90), (140, 70))
    scene = window.key("shift+s")["message"].split()[-1]
    assert main(["render", str(folder / scene), "-o", str(folder / "w.npy"), "--backend", "egl", "--quiet"]) == 0
    assert np.array_equal(np.load(folder / "w.npy"), np.load((folder / scene).with_suffix(".npy")))
