"""The plugin of napari: its manifest, files as layers right to the voxel, the viewer's camera, pictures of layers."""

from __future__ import annotations

import tomllib
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import splatgl as sg
from splatgl import readers
from splatgl.integrations.napari import panel
from splatgl.integrations.napari import reader as reading
from tests.helpers.phantom import F

ROOT = Path(__file__).parents[2]
MANIFEST = Path(reading.__file__).with_name("napari.yaml")
SPACING, ORIGIN = (0.5, 0.7, 2.0), (-3.0, 4.0, 5.0)
TURNED = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])


class Image:
    """A stand-in of napari's layer, which `Volume.of` tells by its module."""

    __module__ = "napari.layers.image"

    def __init__(self, data: np.ndarray, scale: tuple[float, ...] = (1, 1, 1), **given: Any) -> None:
        self.data, self.ndim, self.scale, self.name = data, data.ndim, np.array(scale, float), "cells"
        self.visible, self.rgb, self.multiscale, self.opacity, self.gamma, self.units = (
            True,
            False,
            False,
            1.0,
            1.0,
            None,
        )
        self.contrast_limits, self.rendering, self.blending = (0.0, 255.0), "mip", "translucent"
        self.dtype = data.dtype
        self.colormap = SimpleNamespace(name="red", map=lambda at: np.outer(at, [1, 0, 0]))
        self.__dict__.update(given)

    def data_to_world(self, at: Any) -> Any:
        return tuple(np.asarray(at) * self.scale)

    def world_to_data(self, at: Any) -> Any:
        return tuple(np.asarray(at) / self.scale)


def viewer(*layers: Any, **given: Any) -> Any:
    """A stand-in of a viewer of a canvas of 64×48 pixels."""
    camera = {"center": (0.0, 0.0, 0.0), "zoom": 2.0, "perspective": 0.0, "orientation": ("away", "down", "right")}
    camera |= {"view_direction": (1.0, 0.0, 0.0), "up_direction": (0.0, -1.0, 0.0)}
    dims = {"ndisplay": 3, "ndim": 3, "order": (0, 1, 2), "point": (0.0, 0.0, 0.0)}
    for name, value in given.items():
        (camera if name in camera else dims)[name] = value
    return SimpleNamespace(
        layers=list(layers),
        camera=SimpleNamespace(**camera),
        dims=SimpleNamespace(**dims),
        canvas=SimpleNamespace(size=(48, 64)),
    )


def world_of(given: dict[str, Any], at: tuple[int, ...]) -> np.ndarray:
    """Where the keywords of a layer place a voxel, in napari's world."""
    if "affine" in given:
        return np.asarray((given["affine"] @ [*at, 1.0])[:-1])
    return np.asarray(np.array(at) * given["scale"] + given["translate"])


def save_nrrd(path: Path, direction: np.ndarray) -> Path:
    nrrd = pytest.importorskip("nrrd", reason="pynrrd writes the file")
    header = {"space": "left-posterior-superior", "space directions": (direction * SPACING).T, "space origin": ORIGIN}
    nrrd.write(str(path), F, header, index_order="C")
    return path


def test_the_manifest_is_npe2s() -> None:
    npe2 = pytest.importorskip("npe2", reason="npe2 reads manifests")
    manifest = npe2.PluginManifest.from_file(MANIFEST)
    assert manifest.name == "splatgl"
    (reader,), (widget,) = manifest.contributions.readers, manifest.contributions.widgets
    assert reader.filename_patterns == reading.patterns() and reader.accepts_directories
    names = {each.id: str(each.python_name) for each in manifest.contributions.commands}
    assert names[reader.command] == f"{reading.__name__}:{reading.reader_of.__name__}"
    assert names[widget.command] == "splatgl.integrations.napari.widget:NapariPanel"


def test_the_package_names_the_manifest() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    module, name = project["entry-points"]["napari.manifest"]["splatgl"].split(":")
    assert ROOT.joinpath(*module.split("."), name) == MANIFEST and MANIFEST.is_file()


@pytest.mark.parametrize("direction", [np.eye(3), TURNED], ids=["straight", "turned"])
def test_voxels_lie_where_the_file_says(tmp_path: Path, direction: np.ndarray) -> None:
    path = save_nrrd(tmp_path / "letter.nrrd", direction)
    read = reading.reader_of([str(path)])
    assert read is not None and reading.reader_of([str(path), str(path)]) is None
    ((data, given, kind),) = read(str(path))
    assert (kind, given["name"], given["metadata"]["frame"]) == ("image", "letter", "LPS")
    assert ("affine" in given) == (direction is TURNED)
    volume = sg.load(path)
    for at in np.ndindex(F.shape):
        assert data[at] == F[at]
        right = volume.world_from_index @ at[::-1] + ORIGIN
        np.testing.assert_allclose(world_of(given, at), right[::-1], atol=1e-12)


def test_channels_have_their_colours_and_windows(tmp_path: Path) -> None:
    tifffile = pytest.importorskip("tifffile", reason="tifffile writes the file")
    two = np.stack([F.astype(np.uint16), F.astype(np.uint16) * 2])
    ranges = {"Ranges": (1.0, 90.0, 2.0, 180.0), "mode": "composite", "axes": "ZCYX", "spacing": 3, "unit": "um"}
    path = tmp_path / "two.tif"
    tifffile.imwrite(path, two.transpose(1, 0, 2, 3), imagej=True, metadata=ranges, resolution=(2, 2))
    volume = sg.load(path)
    for n, (data, given, kind) in enumerate(reading.read(str(path))):
        np.testing.assert_array_equal(data, two[n])
        assert kind == "image" and given["scale"] == [3, 0.5, 0.5] and given["units"] == ("um",) * 3
        assert given["contrast_limits"] == ((1, 90), (2, 180))[n] and given["blending"] == "additive"
        assert given.get("colormap") == volume.channels[n].hints.color


def test_times_are_read_when_they_are_shown(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    tifffile = pytest.importorskip("tifffile", reason="tifffile writes the file")
    pytest.importorskip("dask.array", reason="times are an array of dask")
    series = np.stack([F.astype(np.uint16) * n for n in range(9)])
    path = tmp_path / "times.tif"
    tifffile.imwrite(path, series[:, :, None], imagej=True, metadata={"axes": "TZCYX", "finterval": 2.5})
    asked: list[Any] = []
    own = readers.load
    monkeypatch.setattr(readers, "load", lambda *a, **k: asked.append(k) or own(*a, **k))
    ((data, given, _),) = reading.read(str(path))
    assert data.shape == series.shape and given["scale"][0] == 2.5
    # a few for the contrast, as the first is empty
    few = [{"time": number} for number in (0, 2, 4, 6, 8)]
    assert asked == [{}, *few] and given["contrast_limits"] == (0.0, 8.0 * F.max())
    np.testing.assert_array_equal(np.asarray(data[3]), series[3])
    assert asked == [{}, *few, {"time": 3}]


def test_contrast_limits_of_time_points_are_of_all_planes(tmp_path: Path) -> None:
    tifffile = pytest.importorskip("tifffile", reason="tifffile writes the file")
    pytest.importorskip("dask", reason="time points are read by dask")
    # the first plane is dark
    movie = np.arange(3)[:, None, None, None] + np.array([0, 700, 40], np.uint16)[:, None, None] * np.ones((4, 5))
    path = tmp_path / "movie.ome.tif"
    tifffile.imwrite(path, movie.astype(np.uint16), metadata={"axes": "TZYX"}, photometric="minisblack")
    ((data, given, kind),) = reading.read(str(path))
    assert data.shape == (3, 3, 4, 5) and kind == "image" and given["contrast_limits"] == (0.0, 702.0)


def test_what_is_read_in_parts_stays_lazy(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    zarr = pytest.importorskip("zarr", reason="zarr writes the file")
    pytest.importorskip("dask", reason="parts are read by dask")
    samples = np.arange(6 * 7 * 8, dtype=np.uint16).reshape(6, 7, 8)
    array = zarr.create_array(tmp_path / "a.zarr", shape=samples.shape, chunks=(2, 4, 4), dtype=samples.dtype)
    array[:] = samples
    monkeypatch.setattr("splatgl.readers.ome_zarr.WHOLE_BYTES", 100)
    ((data, _, kind),) = reading.read(str(tmp_path / "a.zarr"))
    assert kind == "image" and not isinstance(data, np.ndarray)
    assert data.dtype == samples.dtype and np.array_equal(np.asarray(data), samples)


def test_labels_are_labels(monkeypatch: pytest.MonkeyPatch) -> None:
    table = (sg.data.volume.Label(1, "liver", "#ff0000"), sg.data.volume.Label(2, "", None))
    volume = sg.Volume(F.astype(np.uint8) % 3, labels=table)
    monkeypatch.setattr(readers, "load", lambda path: volume)
    ((_, given, kind),) = reading.read("seg.nii")
    assert kind == "labels" and given["colormap"] == {None: "transparent", 0: "transparent", 1: "#ff0000"}
    assert given["features"] == {"index": [0, 1, 2], "name": ["", "liver", ""]}


def pixel_of(camera: sg.Camera, point: tuple[float, float, float], mirrored: bool) -> tuple[float, float]:
    """(column, row) of a point (z, y, x)."""
    right, down, ahead = camera.eye_from_points(np.array(point[::-1]))
    pitch = camera.pixel_pitch(ahead)
    column = camera.size[0] / 2 + right / pitch
    return (camera.size[0] - column if mirrored else column), camera.size[1] / 2 + down / pitch


BOX = np.array([[x, y, z] for x in (-9.0, 9.0) for y in (-9.0, 9.0) for z in (-9.0, 9.0)])


@pytest.mark.parametrize("perspective", [0.0, 40.0])
@pytest.mark.parametrize("ndisplay", [2, 3])
@pytest.mark.parametrize("depth", ["away", "towards"])
def test_the_camera_shows_x_to_the_right_and_y_down(perspective: float, ndisplay: int, depth: str) -> None:
    """The zoom is pixels per unit at the centre; turning the axis of depth alone mirrors nothing on the screen."""
    seen = viewer(
        center=(1.0, 2.0, 3.0),
        ndisplay=ndisplay,
        perspective=perspective,
        orientation=(depth, "down", "right"),
        view_direction=(1.0 if depth == "away" else -1.0, 0.0, 0.0),
    )
    camera, mirrored = panel.camera_of(seen, BOX)
    assert camera.perspective == (perspective > 0 and ndisplay == 3) and camera.size == (64, 48)
    z = 1.0 if ndisplay == 3 else 0.0
    np.testing.assert_allclose(pixel_of(camera, (z, 2.0, 3.0), mirrored), (32, 24), atol=1e-9)
    np.testing.assert_allclose(pixel_of(camera, (z, 2.0, 8.0), mirrored), (42, 24), atol=1e-9)
    np.testing.assert_allclose(pixel_of(camera, (z, 7.0, 3.0), mirrored), (32, 34), atol=1e-9)
    # nothing is behind the eye of parallel rays
    assert camera.perspective or (camera.eye_from_points(BOX)[:, 2] > 0).all()


def test_the_order_of_the_axes_is_the_viewers() -> None:
    """Axes (z, y, x) shown as (y, z, x): y away, z down, x right."""
    seen = viewer(order=(1, 0, 2), center=(2.0, 1.0, 3.0))
    camera, mirrored = panel.camera_of(seen, BOX)
    np.testing.assert_allclose(camera.forward, (0, 1, 0), atol=1e-12)
    np.testing.assert_allclose(pixel_of(camera, (6.0, 2.0, 4.0), mirrored), (34, 34), atol=1e-9)
    with pytest.raises(sg.InputError, match="view: expected the last three axes"):
        panel.camera_of(viewer(ndim=4, order=(1, 0, 2, 3), point=(0.0,) * 4), BOX)


def spots(*places: tuple[int, int, int]) -> np.ndarray:
    data = np.zeros((8, 10, 12), np.uint8)
    for place in places:
        data[place] = 255
    return data


@pytest.mark.few(1)
@pytest.mark.parametrize("blend", [None, "composite"])
def test_a_picture_shows_a_voxel_where_napari_does(blend: str | None) -> None:
    """A voxel at z 1, y 2, x 9 of a grid scaled by (3, 2, 1.5) is right of the middle, and high."""
    layer = Image(spots((1, 2, 9)), (3, 2, 1.5))
    image = panel.picture(viewer(layer, center=(0.0, 9.0, 8.25)), blend, size=None)
    red = image.pixels[..., 0]
    rows, columns = np.indices(red.shape) + 0.5
    place = [float((axis * red).sum() / red.sum()) for axis in (columns, rows)]
    # 2 pixels per unit from the centre
    np.testing.assert_allclose(place, (32 + 2 * (13.5 - 8.25), 24 + 2 * (4 - 9)), atol=0.05)
    assert image.info["blend"] == (blend or "mip") and image.pixels[..., 1:3].max() == 0


def test_a_maximum_has_the_layers_colours() -> None:
    """Half of the contrast limits is half of the map's sRGB; gamma and opacity change it."""
    data = np.full((8, 10, 12), 128, np.uint8)
    seen = viewer(Image(data, contrast_limits=(0.0, 256.0)), center=(4.0, 5.0, 6.0))
    middle = panel.picture(seen).to_pil().getpixel((32, 24))
    assert abs(middle[0] - 128) <= 2 and middle[1] == 0
    seen.layers[0].gamma = 2.0
    assert abs(panel.picture(seen).to_pil().getpixel((32, 24))[0] - 64) <= 2


def test_the_slider_picks_the_time() -> None:
    series = np.stack([spots(), spots((4, 5, 6)), spots()])
    layer = Image(series, (2.0, 1, 1, 1))
    for point, there in ((2.0, True), (4.0, False)):
        seen = viewer(layer, center=(4.0, 5.0, 6.0), ndim=4, order=(0, 1, 2, 3), point=(point, 0.0, 0.0, 0.0))
        assert (panel.picture(seen).pixels[..., 0].max() > 0.2) == there


def shade_of(image: sg.Image, at: tuple[int, int] = (32, 24)) -> tuple[int, int, int]:
    """sRGB of a pixel (column, row)."""
    found: Any = image.to_pil().convert("RGB").getpixel(at)
    return found


def block(value: int = 128) -> np.ndarray:
    return np.full((8, 10, 12), value, np.uint8)


MIDDLE = (4.0, 5.0, 6.0)


def planes(*rows: tuple[tuple[float, ...], tuple[float, ...], bool]) -> list[SimpleNamespace]:
    return [SimpleNamespace(position=at, normal=normal, enabled=enabled) for at, normal, enabled in rows]


@pytest.mark.long
def test_clipping_planes_cut_a_layer() -> None:
    """The right half of a block is left; napari takes places for the world's, and draws from half a voxel before."""
    cut = planes(((0, 0, 12.0), (0, 0, 1), True), ((0, 0, 4.0), (0, 0, -1), False))
    layer = Image(block(), (1, 1, 2), experimental_clipping_planes=cut)
    seen = viewer(layer, center=(4.0, 5.0, 11.0))
    red = panel.picture(seen).pixels[24, :, 0]
    # from 12 − 1 to 23 world units, of two pixels
    assert np.flatnonzero(red > 0.1).tolist() == list(range(32, 56))
    other = Image(block(), (1, 1, 2))
    assert (panel.picture(viewer(layer, other, center=MIDDLE)).pixels[24, 20, 0]) > 0.1, "the others stay whole"


def test_sliders_of_five_axes_pick_a_volume() -> None:
    """Of times and channels: only the one where both sliders stand is read."""
    series = np.zeros((2, 3, 8, 10, 12), np.uint8)
    series[1, 2] = spots((4, 5, 6))
    layer = Image(series, (2.0, 1.0, 1, 1, 1))
    dims = {"center": MIDDLE, "ndim": 5, "order": (0, 1, 2, 3, 4)}
    for point, there in (((2.0, 2.0), True), ((2.0, 1.0), False), ((0.0, 2.0), False)):
        seen = viewer(layer, **dims, point=(*point, 0.0, 0.0, 0.0))
        assert (panel.picture(seen).pixels[..., 0].max() > 0.2) == there
        assert panel.volume_of(layer, seen).shape == (8, 10, 12)


def test_colours_are_as_dense_as_they_are_bright() -> None:
    data = np.zeros((8, 10, 12, 3), np.uint8)
    data[2:6, 3:7, 4:8] = (0, 200, 40)
    for rendering in ("mip", "translucent"):
        layer = Image(data, rgb=True, ndim=3, rendering=rendering)
        image = panel.picture(viewer(layer, center=MIDDLE))
        # what is bright is solid
        assert shade_of(image)[1] > 140, rendering
    assert image.info["notes"] == () and shade_of(image)[1] > 4 * shade_of(image)[2] > 4 * shade_of(image)[0]
    assert shade_of(image, (3, 3)) == (0, 0, 0)


def test_what_is_left_out_is_told() -> None:
    """Other kinds of layers, slices, other renderings; layers are mixed by depth."""
    points = type("Points", (), {"visible": True, "ndim": 3, "name": "spots"})()
    hidden = type("Shapes", (), {"visible": False, "ndim": 3, "name": "lines"})()
    above = Image(block(), rendering="iso", name="nuclei", depiction="plane")
    image = panel.picture(viewer(points, hidden, Image(block()), above, center=MIDDLE, ndisplay=2))
    assert image.notes == (
        "not rendered: spots, a Points layer of 3 axes",
        "all voxels are rendered; the 2-D view shows a slice",
        "nuclei: rendered as mip, not as iso",
        "nuclei: rendered as a volume, not as a plane",
        "layers are composited by depth, not blended as images",
    )
    assert panel.picture(viewer(Image(block()), center=MIDDLE)).notes == ()


def test_nothing_to_draw_is_told() -> None:
    with pytest.raises(sg.InputError, match="layers: expected a visible Image or Labels layer"):
        panel.picture(viewer(Image(spots(), visible=False)))
    with pytest.raises(sg.InputError, match="blend: expected composite or xray"):
        panel.picture(viewer(Image(spots((1, 1, 1)))), "iso")  # type: ignore[arg-type]


class Labels(Image):
    """A stand-in of napari's labels: 1 is lime."""

    __module__ = "napari.layers.labels"

    def get_color(self, number: int) -> np.ndarray:
        return np.array([0.0, 1.0, 0.0, 1.0]) * (number == 1)


def test_layers_of_a_scene_hide_each_other_by_depth() -> None:
    """Labels behind a faint image and before it; opacity is the layer's."""
    labels = Labels((spots((4, 5, 6)) > 0).astype(np.uint8), rendering="iso_categorical")
    image = Image(block(200), rendering="translucent", opacity=0.5)
    both, alone = (panel.picture(viewer(*layers, center=MIDDLE)) for layers in ((image, labels), (labels,)))
    assert both.info["blend"] == alone.info["blend"] == "composite"
    assert shade_of(both)[1] > 30 and shade_of(alone)[1] > 150 and shade_of(alone)[0] == 0
    faint = panel.picture(viewer(replace_opacity(image, 0.1), labels, center=MIDDLE))
    assert shade_of(faint)[1] > shade_of(both)[1] and shade_of(faint)[0] < shade_of(both)[0]


def replace_opacity(layer: Image, opacity: float) -> Image:
    layer.opacity = opacity
    return layer


def test_levels_of_a_pyramid_fit_into_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    fine = np.repeat(np.repeat(np.repeat(spots((4, 5, 6)), 2, 0), 2, 1), 2, 2)
    layer = Image(fine, (0.5, 0.5, 0.5), name="levels")
    layer.__dict__.update(data=[fine, fine[::2, ::2, ::2]], multiscale=True)
    seen = viewer(layer, center=MIDDLE)
    whole = panel.volume_of(layer, seen)
    monkeypatch.setattr(panel, "MOST_VOXELS", 2000)
    coarse = panel.volume_of(layer, seen)
    assert whole.shape == (16, 20, 24) and coarse.shape == (8, 10, 12) and not whole.coarser
    np.testing.assert_allclose(whole.corners, coarse.corners)


def test_the_widget_draws_saves_and_tells(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("QT_QPA_PLATFORM", "offscreen")
    widgets = pytest.importorskip("qtpy.QtWidgets", reason="napari's window takes PyQt6 or PySide6", exc_type=Exception)
    from splatgl.integrations.napari import widget

    application = widgets.QApplication.instance() or widgets.QApplication([])
    seen, added = viewer(Image(block()), center=MIDDLE), list[np.ndarray]()
    seen.add_image = lambda data, **given: added.append(data)
    drawn = widget.NapariPanel(seen)
    assert not any(button.isEnabled() for button in drawn.buttons[1:])
    drawn.buttons[0].click()
    assert drawn.summary.text().startswith("64×48 pixels, mip of ") and all(b.isEnabled() for b in drawn.buttons)
    drawn.add_layer()
    assert (added[0] == panel.picture(seen).samples8()[..., :3]).all()
    for name, told in (("a.png", "pixels"), ("no/x.txt", "x.txt")):
        monkeypatch.setattr(
            "splatgl.integrations.napari.widget.QFileDialog.getSaveFileName",
            lambda *_, name=name: (str(tmp_path / name), ""),
        )
        drawn.save()
        assert told in drawn.summary.text()
    assert sg.Image.load(tmp_path / "a.png").pixels.shape == (48, 64, 4)
    seen.layers.clear()
    drawn.draw()
    assert "expected a visible Image or Labels layer" in drawn.summary.text() and drawn.image is None
    assert drawn.shown.pixmap().isNull() and not drawn.buttons[1].isEnabled()
    drawn.close()
    application.processEvents()


def test_in_napari_layers_stand_where_files_say(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What napari makes of the keywords comes back as the volume that was read."""
    monkeypatch.setenv("QT_QPA_PLATFORM", "offscreen")
    layers = pytest.importorskip("napari.layers", reason="layers of napari")
    for direction in (np.eye(3), TURNED):
        path = save_nrrd(tmp_path / "letter.nrrd", direction)
        ((data, given, _),) = reading.read(str(path))
        found, right = sg.Volume.of(layers.Image(data, **given)), sg.load(path)
        np.testing.assert_allclose(found.world_from_index, right.world_from_index, atol=1e-12)
        np.testing.assert_allclose(found.origin, right.origin, atol=1e-12)
        assert (found.samples == F).all() and found.name == "letter"
    table = (sg.data.volume.Label(1, "liver", "#ff0000"),)
    monkeypatch.setattr(readers, "load", lambda path: sg.Volume(F.astype(np.uint8), labels=table))
    ((data, given, _),) = reading.read("seg.nii")
    labels = layers.Labels(data, **given)
    np.testing.assert_allclose(labels.get_color(1), (1, 0, 0, 1))
