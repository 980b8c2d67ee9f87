"""Layers, meshes, masks and cuts in LPS and RAS beside each other: the window draws what `splatgl render` does."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import pytest

import splatgl as sg
from splatgl.data.volume import subsample
from splatgl.geometry.scissors import Scissors
from splatgl.readers import load
from splatgl.scene.meshes import MeshFile
from splatgl.scene.open_scene import OpenScene
from splatgl.scene.scene_file import SceneFile
from splatgl.scene.view import ViewOptions
from splatgl.viewer import layer_splats
from splatgl.viewer.adaptive_quality import StandIn
from splatgl.viewer.document import Document
from splatgl.viewer.jobs import Jobs
from splatgl.viewer.loading import AddedFiles, Files
from splatgl.viewer.measure_tool import under_cursor
from splatgl.viewer.saving import scene_of
from splatgl.viewer.segments import segment_corners
from splatgl.viewer.slice_views import slice_values
from splatgl.viewer.state import State
from tests.helpers.blobs import blob
from tests.helpers.points import write_ply

SIZE = (40, 32)
FAINT = {"points": [[0.0, 0.0], [40.0, 0.05]], "colormap": "gray"}
SOLID = {"points": [[0.0, 0.0], [40.0, 0.6]], "colormap": "viridis"}
OTHER = {"LPS": "RAS", "RAS": "LPS"}
SUFFIX = {"LPS": ".nrrd", "RAS": ".nii.gz"}
TRIANGLE = np.array([(4.0, 1.0, 3.0), (15.0, 2.0, 4.0), (6.0, 9.0, 14.0)])
# grids of a layer, world from index in LPS: of the first volume, mirrored and turned, sheared
GRIDS = {
    "straight": np.diag([1.0, 1.0, 1.25]),
    "mirrored": np.array([[0, -1.1, 0], [1.0, 0, 0], [0, 0, 1.2]]),
    "sheared": np.array([[1.0, 0.3, 0], [0, 1.0, 0.2], [0, 0, 1.1]]),
}
FLIP = {"LPS": np.ones(3), "RAS": np.array([-1.0, -1.0, 1.0])}


def volume_in(frame: str, samples: np.ndarray, grid: str, corner: Sequence[float], **more: object) -> sg.Volume:
    """Samples at a place of the patient, given in LPS, stored in a frame."""
    world = FLIP[frame][:, None] * GRIDS[grid]
    spacing = np.linalg.norm(world, axis=0)
    return sg.Volume(samples, tuple(spacing), tuple(FLIP[frame] * corner), world / spacing, frame=frame, **more)  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("frames")
    labels = np.zeros((8, 8, 8), np.uint8)
    labels[1:4, 1:7, 1:7], labels[4:7, 1:5, 1:7] = 1, 2
    inside = np.zeros((12, 12, 12), np.uint8)
    inside[:, :, 5:] = 1
    for frame, suffix in SUFFIX.items():
        volume_in(frame, blob(12).samples, "straight", (5.0, -3.0, 2.0)).save(place / f"base-{frame}{suffix}")
        volume_in(frame, inside, "straight", (5.0, -3.0, 2.0), labels=()).save(place / f"mask-{frame}{suffix}")
        for grid in GRIDS:
            corner = (13.0, -1.0, 4.0) if grid == "mirrored" else (8.0, -1.0, 4.0)
            volume_in(frame, labels, grid, corner, labels=()).save(place / f"seg-{grid}-{frame}{suffix}")
            value = volume_in(frame, blob(8).samples[::-1, ::-1], grid, corner)
            value.save(place / f"other-{grid}-{frame}{suffix}")
    np.save(place / "plain.npy", blob(12).samples)
    return place


def scene_with(folder: Path, name: str, **more: object) -> SceneFile:
    """A scene of a first volume, cheap to draw."""
    settings, view = sg.Settings(antialias="off", background="transparent"), ViewOptions(SIZE)
    return SceneFile(str(folder / name), transfer=FAINT, settings=settings, view=view, **more)  # type: ignore[arg-type]


def base(folder: Path, frame: str, **more: object) -> SceneFile:
    return scene_with(folder, f"base-{frame}{SUFFIX[frame]}", **more)


def layer(folder: Path, kind: str, grid: str, frame: str, **more: object) -> SceneFile:
    look = SOLID if kind == "other" else {}
    return SceneFile(str(folder / f"{kind}-{grid}-{frame}{SUFFIX[frame]}"), transfer=look, **more)  # type: ignore[arg-type]


def rendered(scene: SceneFile, renderer: sg.Renderer) -> tuple[np.ndarray, sg.Camera]:
    """The picture of `splatgl render`, and its camera."""
    opened = OpenScene.read(scene)
    image = renderer.render(opened.subject, opened.camera, opened.settings, verify_bound=False)
    return image.pixels, opened.camera


def window_picture(document: Document, camera: sg.Camera, renderer: sg.Renderer) -> np.ndarray:
    subject, settings = document.subject_at(1, document.scene.settings)
    return renderer.render(subject, camera, settings, verify_bound=False).pixels


def check_window(scene: SceneFile, renderer: sg.Renderer) -> np.ndarray:
    """Compares the window's first picture with that of render, bit for bit; returns it."""
    right, camera = rendered(scene, renderer)
    document = Document.open(scene, quiet=True)
    home = document.home(SIZE).camera
    assert np.array_equal(home.eye, camera.eye) and np.array_equal(home.eye_from_world, camera.eye_from_world)
    assert np.array_equal(window_picture(document, camera, renderer), right)
    return right


@pytest.mark.parametrize(("frame", "kind"), list(product(OTHER, ("seg", "other"))))
def test_layers_of_another_frame(frame: str, kind: str, folder: Path, renderer: sg.Renderer) -> None:
    """The picture is that of render, and, but for rounding, that of a layer stored in the same frame."""
    for grid in GRIDS:
        scenes = [base(folder, frame, layers=(layer(folder, kind, grid, each),)) for each in (OTHER[frame], frame)]
        other, same = (check_window(scene, renderer) for scene in scenes)
        assert np.abs(other - same).max() < 2e-3 and other[..., 3].max() > 0.5
        # the layer is seen
        assert np.abs(other - rendered(base(folder, frame), renderer)[0]).max() > 0.3


def parts(folder: Path, own: str, frame: str) -> dict[str, dict[str, object]]:
    """What is added to a first volume in `own`: from files in `frame`."""
    other, seg = (layer(folder, kind, "sheared", frame) for kind in ("other", "seg"))
    mesh = MeshFile.of(sg.Mesh(TRIANGLE * FLIP[frame], [(0, 1, 2)], frame=frame, name="m"))  # type: ignore[arg-type]
    mask, own_mask = (str(folder / f"mask-{each}{SUFFIX[each]}") for each in (frame, own))
    hidden = replace(other, visible=False)
    # of the file's own frame
    sides = ("x>0.4", "y<0.8") if frame == "LPS" else ("x<0.6", "y>0.2")
    places = np.random.default_rng(3).uniform((8, -2, 4), (15, 8, 14), (60, 3)) * FLIP[frame]
    file = folder / f"points-{frame}.ply"
    write_ply(file, "ascii", dict.fromkeys("xyz", "double"), list(places.T))
    cloud = replace(load(file), frame=frame)
    return {
        "mesh": {"meshes": (mesh, replace(mesh, color="red", clip=True)), "clip": ("z>0.4",)},
        "mask": {"mask": (mask,)},
        "planes of a layer": {"layers": (replace(other, clip=sides),), "clip": ("z<0.9",)},
        "crop of a layer": {"layers": (replace(other, crop="2:6,:,1:"),)},
        "mask of a layer": {"layers": (replace(other, mask=(own_mask,)),)},
        "mask of all": {"layers": (other,), "mask": (mask,)},
        "scissors": {"layers": (other, seg), "scissors": (Scissors("0.5,-1 2,-1 2,2 0.5,2"),)},
        "uncut": {"layers": (other,), "clip": ("z>0.5",), "uncut": mask},
        "hidden first": {"layers": (other, seg), "visible": False},
        "hidden layer": {"layers": (hidden, seg)},
        "points": {"layers": (SceneFile.of(cloud),)},
        "slices": {"layers": (seg,), "slice_planes": ("z@0.5",)},
        "box": {"layers": (seg,), "annotate": ("box",), "view": ViewOptions((72, 64))},
    }


@pytest.mark.parametrize("own", OTHER)
@pytest.mark.parametrize("what", ["mesh", "mask", "planes of a layer", "crop of a layer", "mask of a layer"])
def test_cuts_and_meshes_of_another_frame(own: str, what: str, folder: Path, renderer: sg.Renderer) -> None:
    check_parts(own, what, folder, renderer)


@pytest.mark.long
@pytest.mark.parametrize("own", OTHER)
@pytest.mark.parametrize(
    "what", ["mask of all", "scissors", "uncut", "hidden first", "hidden layer", "points", "slices", "box"]
)
def test_more_of_another_frame(own: str, what: str, folder: Path, renderer: sg.Renderer) -> None:
    check_parts(own, what, folder, renderer)


def check_parts(own: str, what: str, folder: Path, renderer: sg.Renderer) -> None:
    """The window draws what render does, and, but for rounding, what is drawn of files in one frame."""
    scenes = [replace(base(folder, own), **parts(folder, own, frame)[what]) for frame in (OTHER[own], own)]
    other, same = (check_window(scene, renderer) for scene in scenes)
    assert np.abs(other - same).max() < 2e-3 and other[..., 3].max() > 0.05
    alone = rendered(replace(base(folder, own), view=scenes[0].view), renderer)[0]
    assert np.abs(other - alone).max() > 0.05


def test_the_first_volume_need_not_state_a_frame(folder: Path, renderer: sg.Renderer) -> None:
    """Then the first visible layer that states one, else the first mesh, gives it, also once others are hidden or
    removed.
    """
    first, second = (layer(folder, "seg", "straight", frame) for frame in ("LPS", "RAS"))
    meshes = tuple(
        MeshFile.of(sg.Mesh(TRIANGLE * sign, [(0, 1, 2)], frame=frame, name=frame))  # type: ignore[arg-type]
        for frame, sign in (("RAS", FLIP["RAS"]), ("LPS", 1.0))
    )
    scene = scene_with(folder, "plain.npy", layers=(first, second), meshes=meshes)
    check_window(scene, renderer)
    check_window(replace(scene, layers=()), renderer)
    document = Document.open(scene, quiet=True)
    camera, styles = document.home(SIZE).camera, document.styles
    for layers, shown in (
        ((replace(first, visible=False), second), (styles[0], replace(styles[1], visible=False), styles[2])),
        ((second,), (styles[0], styles[2])),
        ((second, first), (styles[0], styles[2], styles[1])),
        ((first, second), styles),
    ):
        opened = OpenScene.read(replace(scene, layers=layers))
        right = renderer.render(opened.subject, camera, opened.settings, verify_bound=False).pixels
        document = document.with_styles(shown, document.mesh_files, scene.settings)
        assert np.array_equal(window_picture(document, camera, renderer), right)


def test_added_layers_stand_where_render_draws_them(folder: Path, renderer: sg.Renderer) -> None:
    """Also in a scene that was cut in the window, and in the scene that the window saves; the pointer and the slices
    read the same voxels.
    """
    scene = base(folder, "LPS")
    document, other = Document.open(scene, quiet=True), layer(folder, "seg", "mirrored", "RAS")
    files = Files(Jobs(lambda: None), (), None, 0.0)
    files.add([other.volume], scene)
    assert files.jobs.wait(60)
    (done,) = files.jobs.collect()
    assert isinstance(done.value, AddedFiles)
    state, document = done.value.added_to(State.of(document, SIZE), document)
    document = document.with_styles(state.styles, state.mesh_files, state.settings)
    camera = state.pose.camera
    copied = replace(scene_of(state, document), view=ViewOptions(SIZE, fixed=camera))
    right = rendered(copied, renderer)[0]
    assert np.array_equal(window_picture(document, camera, renderer), right)
    assert np.abs(right - rendered(replace(scene, view=copied.view), renderer)[0]).max() > 0.3
    # a voxel of the segment 2, whose number its file gives
    seg = load(other.volume)
    place = FLIP["RAS"] * (seg.world_from_index @ (3.0, 2.0, 5.0) + np.asarray(seg.origin))
    state = replace(state, slices=state.slices.through(place, document.volume))
    assert "2" in slice_values(state, document, 60)[1]
    corners = segment_corners(document.layers[1].volume, 2)
    assert corners is not None and (corners.min(axis=0) < place).all() and (place < corners.max(axis=0)).all()
    state = replace(state, styles=(replace(state.styles[0], visible=False), state.styles[1]))
    document = document.with_styles(state.styles, (), state.settings)
    x, y, depth = camera.eye_from_points(place)
    pixel = np.array((x, y)) / camera.pixel_pitch(depth) + np.array(SIZE) / 2
    picked = under_cursor(state, document, (float(pixel[0]), float(pixel[1])))
    assert picked is not None and picked.value in (1, 2)
    assert seg.samples[tuple(np.rint(picked.index).astype(int)[::-1])] == picked.value


def test_finer_voxels_stand_in_the_same_place(
    folder: Path, renderer: sg.Renderer, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of a layer that is shown by a stand-in first, in the frame of the first volume, or of a later layer."""
    for name, frame in (("base-LPS.nrrd", "RAS"), ("plain.npy", "RAS")):
        layers = (layer(folder, "seg", "straight", "LPS"), layer(folder, "other", "sheared", frame))
        scene = scene_with(folder, name, layers=layers)
        right, camera = rendered(scene, renderer)
        with monkeypatch.context() as patched:
            patched.setattr(layer_splats, "choose_stand_in", lambda volume, *_: coarse_first(volume))
            document = Document.open(scene, quiet=True)
        assert document.has_finer
        while document.has_finer:
            document = document.refined()
        assert np.array_equal(window_picture(document, camera, renderer), right)


def coarse_first(volume: sg.Volume) -> StandIn:
    """Every second voxel, which all voxels replace."""
    return StandIn(subsample(volume, 2), "every 2nd voxel", lambda: StandIn(volume))
