"""Volumes, meshes, masks and cuts in several units of length: the picture is that of all in one unit, in every door."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import splatgl as sg
from splatgl.cli.main import main
from splatgl.data.affine import World
from splatgl.data.volume import AxisCoordinate
from splatgl.geometry.scissors import Scissors
from splatgl.scene.open_scene import OpenScene
from splatgl.scene.scene_file import SceneFile
from splatgl.scene.view import ViewOptions
from splatgl.viewer.adaptive_quality import StandIn
from splatgl.viewer.document import Document
from splatgl.writers.surface import save_mesh
from tests.helpers.blobs import blob

pytestmark = pytest.mark.usefixtures("shared_programs")

SIZE = (32, 24)
# numbers of the unit in a millimetre
PER_MM = {"mm": 1.0, "um": 1000.0, "m": 0.001}
OTHERS = ("um", "m")
FAINT: Any = {"points": [[0.0, 0.0], [40.0, 0.05]], "colormap": "gray"}
TRIANGLE = np.array([(4.0, 1.0, 3.0), (15.0, 2.0, 4.0), (6.0, 9.0, 14.0)])
# all lengths of a transfer function: at these gradients per millimetre, and opacities per 2 mm
LOOKS = {
    "points": sg.Transfer([(10, 0), (40, 0.6)], "viridis"),
    "unit": sg.Transfer([(10, 0), (40, 0.6)], "viridis", unit=2.0),
    "gradient": sg.Transfer([(5, 0), (10, 0.6)], "viridis", unit=2.0, gradient=[(2, 0.0), (12, 1.0)]),
    "regions": sg.Transfer(unit=2.0, regions=["box:10,90,3,12:#ffcc88:0.5", "triangle:5,60,0,20:#4488ff:0.4"]),
}


def stored(unit: str, samples: np.ndarray, corner: tuple[float, float, float], **more: Any) -> sg.Volume:
    """Samples at a place given in millimetres, stored in a unit."""
    spacing, place = np.array([1.0, 1.0, 1.25]) * PER_MM[unit], np.array(corner) * PER_MM[unit]
    return sg.Volume(samples, tuple(spacing), tuple(place), unit=unit, **more)


def look_in(unit: str, name: str) -> sg.Transfer:
    """A look whose lengths are numbers of a unit."""
    look, factor = LOOKS[name], PER_MM[unit]
    regions = [replace(region, gradients=[size / factor for size in region.gradients]) for region in look.regions]
    gradient = [(size / factor, weight) for size, weight in look.gradient]
    return replace(look, unit=look.unit and look.unit * factor, gradient=gradient, regions=regions)


def base() -> sg.Volume:
    return stored("mm", blob(12).samples, (5.0, -3.0, 2.0), name="base")


def other(unit: str, **more: Any) -> sg.Volume:
    return stored(unit, blob(8).samples[::-1, ::-1], (8.0, -1.0, 4.0), name="other", **more)


def segments(unit: str) -> sg.Volume:
    labels = np.zeros((8, 8, 8), np.uint8)
    labels[1:4, 1:7, 1:7], labels[4:7, 1:5, 1:7] = 1, 2
    return stored(unit, labels, (8.0, -1.0, 4.0), labels=(), name="seg")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The same in files of each unit."""
    place = tmp_path_factory.mktemp("units")
    base().save(place / "base.nrrd")
    for unit in PER_MM:
        other(unit).save(place / f"other-{unit}.nrrd")
        segments(unit).save(place / f"seg-{unit}.nrrd")
        mesh = sg.Mesh(TRIANGLE * PER_MM[unit], [(0, 1, 2), (0, 2, 1)], unit=unit)
        save_mesh(mesh, place / f"mesh-{unit}.ply")
    return place


def check_equal(picture: Callable[[str], np.ndarray], least: float = 0.3) -> None:
    """The picture of each other unit is that of millimetres, but for rounding, and shows something."""
    right = picture("mm")
    for unit in OTHERS:
        assert np.abs(picture(unit) - right).max() < 2e-5
    assert right[..., 3].max() > least


@pytest.mark.parametrize("look", LOOKS)
def test_layers_of_a_scene_keep_the_lengths_of_their_look(look: str, renderer: sg.Renderer) -> None:
    camera = sg.Camera.orbit(base(), 30, 20, size=SIZE)

    def picture(unit: str) -> np.ndarray:
        layers = [
            sg.Layer(base(), sg.Transfer([(0, 0.0), (40, 0.05)])),
            sg.Layer(other(unit), look_in(unit, look), clip="z<0.8"),
        ]
        scene = sg.Scene(layers)
        assert scene.layers[1].volume.unit == "mm"
        return renderer.render(scene, camera, sg.Settings(antialias="off")).pixels

    check_equal(picture, 0.2)


DOORS = {
    "layer": lambda folder, unit: {"layers": [folder / f"other-{unit}.nrrd"]},
    "labels": lambda folder, unit: {"labels": folder / f"seg-{unit}.nrrd"},
    "mask": lambda folder, unit: {"mask": f"{folder}/seg-{unit}.nrrd:2"},
    "mesh": lambda folder, unit: {"meshes": [folder / f"mesh-{unit}.ply"]},
    "mask of arrays": lambda folder, unit: {"mask": segments(unit)},
    "arrays": lambda folder, unit: {"layers": [other(unit)]},
    "uncut": lambda folder, unit: {"clip": "z>0.5", "uncut": f"{folder}/seg-{unit}.nrrd:1"},
}


@pytest.mark.parametrize("door", DOORS)
def test_units_in_python(door: str, folder: Path) -> None:
    def picture(unit: str) -> np.ndarray:
        more = DOORS[door](folder, unit)
        return sg.render(folder / "base.nrrd", size=SIZE, **FAINT, **more).pixels

    check_equal(picture, 0.1)


def test_units_of_the_command(folder: Path, tmp_path: Path) -> None:
    def picture(unit: str) -> np.ndarray:
        out = tmp_path / f"{unit}.npy"
        added = ["--layer", f"{folder}/other-{unit}.nrrd", "--mesh", f"{folder}/mesh-{unit}.ply:red"]
        masked = ["--mask", f"{folder}/seg-{unit}.nrrd:outside", "--size", "32", "--quiet", "--check", "0"]
        assert main(["render", str(folder / "base.nrrd"), *added, *masked, "-o", str(out)]) == 0
        return sg.Image.load(out).pixels

    check_equal(picture)


@pytest.mark.parametrize("unit", OTHERS)
@pytest.mark.parametrize("look", LOOKS)
def test_the_window_draws_what_render_does(
    unit: str, look: str, folder: Path, renderer: sg.Renderer, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also after finer voxels are read, and cut by scissors that were drawn over both."""
    table = {
        name: value for name, value in look_in(unit, look).fields.items() if name in ("points", "unit", "gradient")
    }
    table |= {"regions": look_in(unit, look).regions, "colormap": "viridis"} if look == "regions" else {}
    layer = SceneFile(str(folder / f"other-{unit}.nrrd"), transfer=table, clip=("z<0.8",))
    cuts, seg = (Scissors("0.5,-1 2,-1 2,2 0.5,2"),), SceneFile(str(folder / f"seg-{unit}.nrrd"))
    plain = {"transfer": FAINT, "settings": sg.Settings(antialias="off"), "view": ViewOptions(SIZE)}
    scene = SceneFile(str(folder / "base.nrrd"), layers=(layer, seg), scissors=cuts, **plain)
    opened = OpenScene.read(scene)
    right = renderer.render(opened.subject, opened.camera, opened.settings).pixels

    def drawn(document: Document) -> np.ndarray:
        subject, settings = document.subject_at(1, document.scene.settings)
        return renderer.render(subject, opened.camera, settings).pixels

    document = Document.open(scene, quiet=True)
    assert np.array_equal(drawn(document), right) and right[..., 3].max() > 0.2
    shown = document.layers[1]
    finer = StandIn(shown.stored, "", lambda: StandIn(shown.stored))
    waiting = replace(document, pool={**document.pool, 1: replace(shown, stand_in=finer)})
    assert np.array_equal(drawn(waiting.refined()), right)


def test_series_and_same(folder: Path, tmp_path: Path) -> None:
    """Steps of a series, and pictures with one camera, are in the unit of the first."""
    first, steps = folder / "other-mm.nrrd", [str(folder / f"other-{unit}.nrrd") for unit in OTHERS]
    look = ["--points", "10:0,40:0.6", "--unit", "2", "--size", "24", "--quiet"]
    assert main(["animate", str(first), *steps, "-o", f"{tmp_path}/{{frame}}.npy", *look]) == 0
    assert main(["render", str(first), *steps, "-o", f"{tmp_path}/{{name}}.npy", "--same", *look, "--check", "0"]) == 0
    for names in (["0", "1", "2"], ["other-mm", "other-um", "other-m"]):
        right, *others = (sg.Image.load(tmp_path / f"{name}.npy").pixels for name in names)
        assert right[..., 3].max() > 0.3 and all(np.abs(picture - right).max() < 2e-5 for picture in others)
    paths = sg.animate([other("mm"), other("um")], f"{tmp_path}/a{{frame}}.npy", size=24)
    right, picture = (sg.Image.load(path).pixels for path in paths)
    assert np.abs(picture - right).max() < 2e-5


def test_what_states_no_unit_stays_as_it_is() -> None:
    """A note names a layer without a unit that meets no other; the world is of the first that states one."""
    unknown, far = replace(other("mm"), unit=""), replace(other("um"), unit="")
    scene = sg.Scene([unknown, other("um"), base()])
    assert [layer.volume.unit for layer in scene.layers] == ["", "um", "um"] and scene.layers[0].volume is unknown
    assert scene.notes == ("other states no unit of length, is taken as in um, and meets no other layer",)
    assert sg.Scene([base(), unknown]).notes == () == sg.Scene([unknown, far]).notes
    assert sg.Scene([base(), far]).notes == (
        "other states no unit of length, is taken as in mm, and meets no other layer",
    )
    assert World.shared([World(), World(None, "px"), World("RAS"), World("LPS", "mm")]) == World("RAS", "mm")


def test_placed_volumes_and_meshes() -> None:
    """Levels, channels, frame and unit at once; back and forth gives the same grid; an unknown unit changes nothing."""
    coarse = replace(other("um"), samples=blob(4).samples)
    volume = replace(other("um", frame="LPS"), coarser=(coarse,), channels=(other("um"), coarse))
    placed = volume.placed("RAS", "millimetres")
    assert (placed.unit, placed.frame, placed.channels[1].unit, placed.coarser[0].unit) == ("mm", "RAS", "mm", "mm")
    assert placed.spacing == pytest.approx((1, 1, 1.25)) and placed.origin == pytest.approx((-8, 1, 4))
    assert np.allclose(placed.placed("LPS", "um").corners, volume.corners)
    # a file's coordinates stay where they are
    axes = tuple(AxisCoordinate(name, "km", 1e-9, 2.0) for name in "xyz")
    slopes = [axis.slope for axis in replace(volume, axes=axes).placed("RAS", "mm").axes]
    assert slopes == pytest.approx([-1e-6, -1e-6, 1e-6])
    assert volume.placed(None, "px") is volume is volume.placed("LPS", "um") is volume.placed()
    mesh = sg.Mesh(TRIANGLE, [(0, 1, 2)], unit="millimeter")
    assert np.allclose(mesh.placed(None, "um").vertices, TRIANGLE * 1000) and mesh.placed("RAS") is mesh


def test_meshes_of_two_units_alone(folder: Path) -> None:
    """The camera of meshes without a volume fits all of them in one unit."""

    def picture(unit: str) -> np.ndarray:
        second = folder / f"mesh-{unit}.ply"
        return sg.render(folder / "mesh-mm.ply", meshes=[second], size=SIZE).pixels

    check_equal(picture)
