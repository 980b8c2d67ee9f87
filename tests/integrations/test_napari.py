"""The plugin of napari: its manifest, files as layers right to the voxel, the viewer's camera, pictures of layers."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import time
import tomllib
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import splatgl as sg
from splatgl import readers
from splatgl.integrations.napari import draw, worker
from splatgl.integrations.napari import reader as reading
from splatgl.integrations.napari.snapshot import Look, take
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
    assert names[widget.command] == "splatgl.integrations.napari.widget:Panel"


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
    camera, mirrored = draw.camera_of(take(seen), BOX)
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
    camera, mirrored = draw.camera_of(take(seen), BOX)
    np.testing.assert_allclose(camera.forward, (0, 1, 0), atol=1e-12)
    np.testing.assert_allclose(pixel_of(camera, (6.0, 2.0, 4.0), mirrored), (34, 34), atol=1e-9)
    with pytest.raises(sg.InputError, match="view: expected the last three axes"):
        draw.camera_of(take(viewer(ndim=4, order=(1, 0, 2, 3), point=(0.0,) * 4)), BOX)


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
    image = draw.picture(viewer(layer, center=(0.0, 9.0, 8.25)), blend, size=None)
    red = image.pixels[..., 0]
    rows, columns = np.indices(red.shape) + 0.5
    place = [float((axis * red).sum() / red.sum()) for axis in (columns, rows)]
    # 2 pixels per unit from the centre
    np.testing.assert_allclose(place, (32 + 2 * (13.5 - 8.25), 24 + 2 * (4 - 9)), atol=0.05)
    assert image.info["blend"] == (blend or "mip") and image.pixels[..., 1:3].max() == 0
    assert draw.summary(image).startswith(f"64×48 pixels, {blend or 'mip'} of ")


def test_a_maximum_has_the_layers_colours() -> None:
    """Half of the contrast limits is half of the map's sRGB; gamma and opacity change it."""
    data = np.full((8, 10, 12), 128, np.uint8)
    seen = viewer(Image(data, contrast_limits=(0.0, 256.0)), center=(4.0, 5.0, 6.0))
    middle = draw.picture(seen).to_pil().getpixel((32, 24))
    assert abs(middle[0] - 128) <= 2 and middle[1] == 0
    seen.layers[0].gamma = 2.0
    assert abs(draw.picture(seen).to_pil().getpixel((32, 24))[0] - 64) <= 2


def test_the_slider_picks_the_time() -> None:
    series = np.stack([spots(), spots((4, 5, 6)), spots()])
    layer = Image(series, (2.0, 1, 1, 1))
    for point, there in ((2.0, True), (4.0, False)):
        seen = viewer(layer, center=(4.0, 5.0, 6.0), ndim=4, order=(0, 1, 2, 3), point=(point, 0.0, 0.0, 0.0))
        assert (draw.picture(seen).pixels[..., 0].max() > 0.2) == there


def shade_of(image: sg.Image, at: tuple[int, int] = (32, 24)) -> tuple[int, int, int]:
    """sRGB of a pixel (column, row)."""
    found: Any = image.to_pil().convert("RGB").getpixel(at)
    return found


def block(value: int = 128) -> np.ndarray:
    return np.full((8, 10, 12), value, np.uint8)


MIDDLE = (4.0, 5.0, 6.0)


def test_opacity_is_a_displays() -> None:
    """0.4 of a layer is 0.4 of its brightness, as of any picture that a display mixes."""
    full = Image(block(200), opacity=1.0)
    assert abs(shade_of(draw.picture(viewer(full, center=MIDDLE)))[0] - 200) <= 2
    full.opacity = 0.4
    assert abs(shade_of(draw.picture(viewer(full, center=MIDDLE)))[0] - 80) <= 2


GREEN = SimpleNamespace(name="green", map=lambda at: np.outer(at, [0, 1, 0]))
BLENDINGS = {
    "translucent": (72, 60, 0),
    "translucent_no_depth": (72, 60, 0),
    "additive": (120, 60, 0),
    "minimum": (0, 0, 0),
    "multiplicative": (0, 0, 0),
    "opaque": (0, 150, 0),
}


@pytest.mark.parametrize("blending", BLENDINGS)
@pytest.mark.parametrize("ndisplay", [2, 3])
def test_layers_are_blended_as_napari_does(blending: str, ndisplay: int) -> None:
    """Red at 0.6 of 200, and 0.4 of green at 150 over it."""
    layers = Image(block(200), opacity=0.6), Image(block(150), opacity=0.4, blending=blending, colormap=GREEN)
    image = draw.picture(viewer(*layers, center=MIDDLE, ndisplay=ndisplay, point=MIDDLE))
    assert np.abs(np.subtract(shade_of(image), BLENDINGS[blending])).max() <= 2


def test_a_maximum_leaves_out_what_is_below_its_limits() -> None:
    """Where its largest value is at the low contrast limit, the layer below is seen as it is."""
    below = Image(block(200))
    above = Image(spots((4, 5, 11)), blending="translucent", colormap=GREEN)
    image = draw.picture(viewer(below, above, center=MIDDLE))
    assert abs(shade_of(image, (26, 24))[0] - 200) <= 2 and shade_of(image, (26, 24))[1] == 0
    assert shade_of(image, (42, 24))[1] > 100


def planes(*rows: tuple[tuple[float, ...], tuple[float, ...], bool]) -> list[SimpleNamespace]:
    return [SimpleNamespace(position=at, normal=normal, enabled=enabled) for at, normal, enabled in rows]


@pytest.mark.long
def test_clipping_planes_cut_a_layer() -> None:
    """The right half of a block is left; napari takes places for the world's, and draws from half a voxel before."""
    cut = planes(((0, 0, 12.0), (0, 0, 1), True), ((0, 0, 4.0), (0, 0, -1), False))
    layer = Image(block(), (1, 1, 2), experimental_clipping_planes=cut)
    seen = viewer(layer, center=(4.0, 5.0, 11.0))
    red = draw.picture(seen).pixels[24, :, 0]
    # from 12 − 1 to 23 world units, of two pixels
    assert np.flatnonzero(red > 0.1).tolist() == list(range(32, 56))
    other = Image(block(), (1, 1, 2))
    assert (draw.picture(viewer(layer, other, center=MIDDLE)).pixels[24, 20, 0]) > 0.1, "the others stay whole"


@pytest.mark.few(1)
@pytest.mark.parametrize(("thickness", "right"), [(1.0, 90), (4.0, 130)])
def test_a_plane_shows_what_is_across_it(thickness: float, right: int) -> None:
    """Values rise along z by 20: napari takes samples from half its thickness before the plane on."""
    ramp = np.broadcast_to((np.arange(12) * 20)[:, None, None], (12, 10, 12)).astype(np.uint8)
    plane = SimpleNamespace(position=(5.0, 5.0, 6.0), normal=(1, 0, 0), thickness=thickness)
    image = draw.picture(viewer(Image(ramp, depiction="plane", plane=plane), center=MIDDLE))
    # thickness 1: one sample, at 4.5; thickness 4: five, up to 6.5
    assert abs(shade_of(image)[0] - right) <= 4
    assert image.info["notes"] == ()


@pytest.mark.long
def test_iso_surfaces_stand_at_their_threshold() -> None:
    """A ball of values 200 less 20 for each voxel from its middle: 100 is reached at a radius of 5."""
    z, y, x = np.mgrid[:17, :17, :17] - 8.0
    ball = (200 - 20 * np.sqrt(x * x + y * y + z * z)).clip(0).astype(np.float32)
    for threshold in (100.0, 60.0):
        layer = Image(ball, rendering="iso", iso_threshold=threshold)
        image = draw.picture(viewer(layer, center=(8.0, 8.0, 8.0)))
        radius = np.sqrt((image.pixels[..., 0] > 0.02).sum() / np.pi) / 2
        assert radius == pytest.approx((200 - threshold) / 20, abs=0.25)


def test_additive_rendering_multiplies_what_is_left() -> None:
    """8 voxels of colour c: 1 less (1 − c)^(8 / 0.8), in each channel."""
    colors = SimpleNamespace(name="two", map=lambda at: np.outer(at, [0.2, 0.1, 0.0]))
    image = draw.picture(viewer(Image(block(255), rendering="additive", colormap=colors), center=MIDDLE))
    right = [255 * (1 - (1 - c) ** 10) for c in (0.2, 0.1, 0.0)]
    assert shade_of(image) == pytest.approx(right, abs=3)


@pytest.mark.parametrize("order", [(0, 1, 2), (1, 0, 2), (2, 1, 0)])
@pytest.mark.parametrize("vertical", ["down", "up"])
def test_a_flat_view_shows_its_slice(order: tuple[int, int, int], vertical: str) -> None:
    """Each pixel is the nearest voxel of the slice where the slider stands."""
    data = np.random.default_rng(3).integers(0, 255, (8, 10, 12)).astype(np.uint8)
    center, point = (0.0, 4.2, 5.1), np.zeros(3)
    point[order[0]] = 3.4 * 2
    flat = {"ndisplay": 2, "order": order, "point": tuple(point), "center": center}
    layer = Image(data, (2, 2, 2))
    image = draw.picture(viewer(layer, **flat, orientation=("away", vertical, "right")))
    shown = np.moveaxis(data, order, (0, 1, 2))[3]
    sign = 1 if vertical == "down" else -1
    rows = (center[1] + sign * (np.arange(48) + 0.5 - 24) / 2) / 2
    columns = (center[2] + (np.arange(64) + 0.5 - 32) / 2) / 2
    right = np.zeros((48, 64))
    for row, at in enumerate(np.floor(rows + 0.5).astype(int)):
        for column, place in enumerate(np.floor(columns + 0.5).astype(int)):
            if 0 <= at < shown.shape[0] and 0 <= place < shown.shape[1]:
                right[row, column] = shown[at, place]
    assert (np.abs(np.asarray(image.to_pil().convert("RGB"))[..., 0].astype(int) - right) <= 1).all()
    assert draw.summary(image) == "64×48 pixels, slices"


def test_a_flat_view_is_interpolated_and_ends() -> None:
    steps = np.zeros((4, 4, 4), np.uint8)
    steps[2, :, 2:] = 200
    flat = {"ndisplay": 2, "point": (2.0, 0.0, 0.0), "center": (0.0, 1.5, 1.5), "zoom": 8.0}
    red = np.asarray(draw.picture(viewer(Image(steps, interpolation2d="linear"), **flat)).to_pil())[24, :, 0]
    assert abs(int(red[32]) - 100 - 200 / 16) <= 1 and red[15] == red[48] == 0 and red[47] == 200
    outside = viewer(Image(steps), **{**flat, "point": (4.0, 0.0, 0.0)})
    assert not draw.picture(outside).pixels[..., :3].any()


def test_what_is_left_out_is_told() -> None:
    points = type("Points", (), {"visible": True, "ndim": 3, "name": "spots"})()
    hidden = type("Shapes", (), {"visible": False, "ndim": 3, "name": "lines"})()
    colors = Image(np.zeros((8, 10, 12, 3), np.uint8), rgb=True, name="photo", ndim=3)
    first = Image(block(), rendering="attenuated_mip", interpolation3d="nearest")
    second = Image(block(), rendering="translucent", name="nuclei", bounding_box=SimpleNamespace(visible=True))
    seen = viewer(points, hidden, colors, first, second, center=MIDDLE)
    seen.scale_bar, seen.axes = SimpleNamespace(visible=True), SimpleNamespace(visible=False)
    image = draw.picture(seen)
    notes: Any = image.info["notes"]
    assert notes == (
        "not drawn: spots, a Points layer",
        "not drawn: scale bar",
        "cells: drawn between voxels, not by the nearest",
        "not drawn: nuclei's bounding box",
        "nuclei: its colour map is opaque, so that napari shows the faces of its box: drawn denser for larger values",
        "layers that are not opaque surfaces are drawn over each other in their order, not by depth",
    )
    assert draw.summary(image).splitlines()[1:] == list(notes)
    snapshot = take(viewer(Image(block()), center=MIDDLE))
    assert draw.draw_snapshot(snapshot).info["notes"] == ()
    # light is of surfaces
    snapshot.look = replace(snapshot.look, light="flat")
    (note,) = draw.draw_snapshot(snapshot).notes
    assert note.startswith("light: no effect")


def test_nothing_to_draw_is_told() -> None:
    hidden = Image(spots(), visible=False)
    with pytest.raises(sg.InputError, match="layers: expected a visible Image, Labels or other layer"):
        draw.picture(viewer(hidden))
    with pytest.raises(sg.InputError, match="blend: expected one of composite"):
        draw.picture(viewer(Image(spots((1, 1, 1)))), "iso")


def test_sliders_of_five_axes_pick_a_volume() -> None:
    """Of times and channels: only the one where both sliders stand is read."""
    series = np.zeros((2, 3, 8, 10, 12), np.uint8)
    series[1, 2] = spots((4, 5, 6))
    layer = Image(series, (2.0, 1.0, 1, 1, 1))
    dims = {"center": MIDDLE, "ndim": 5, "order": (0, 1, 2, 3, 4)}
    for point, there in (((2.0, 2.0), True), ((2.0, 1.0), False), ((0.0, 2.0), False)):
        seen = viewer(layer, **dims, point=(*point, 0.0, 0.0, 0.0))
        assert (draw.picture(seen).pixels[..., 0].max() > 0.2) == there
        assert take(seen).layers[0].data.shape == (8, 10, 12)


def test_colours_are_as_dense_as_they_are_bright() -> None:
    data = np.zeros((8, 10, 12, 3), np.uint8)
    data[2:6, 3:7, 4:8] = (0, 200, 40)
    for rendering in ("mip", "translucent"):
        layer = Image(data, rgb=True, ndim=3, rendering=rendering)
        image = draw.picture(viewer(layer, center=MIDDLE))
        # what is bright is solid
        assert shade_of(image)[1] > 140, rendering
    assert image.info["notes"] == () and shade_of(image)[1] > 4 * shade_of(image)[2] > 4 * shade_of(image)[0]
    assert shade_of(image, (3, 3)) == (0, 0, 0)


@pytest.fixture
def layers(monkeypatch: pytest.MonkeyPatch) -> Any:
    """napari's own layers, without a window."""
    monkeypatch.setenv("QT_QPA_PLATFORM", "offscreen")
    return pytest.importorskip("napari.layers", reason="layers of napari")


def meshes_at(layer: Any, point: tuple[float, ...] = (0.0,) * 4) -> tuple[sg.Mesh, ...]:
    seen = viewer(layer, ndim=len(point), order=tuple(range(len(point))), point=point)
    (taken,) = take(seen).layers
    assert taken.kind == "Mesh"
    return taken.meshes


def test_points_are_balls_where_the_sliders_are(layers: Any) -> None:
    places = np.array([[0, 1, 2, 3], [0, 5, 5, 5], [1, 4, 4, 4.0]])
    looks = {"face_color": ["red", "lime", "blue"], "border_width": 0.5, "opacity": 0.5}
    points = layers.Points(places, size=[2, 4, 2], scale=(1, 1, 1, 2), **looks)
    small, large = meshes_at(points)
    # napari draws half of the border outside of the size
    balls = (small, (6, 2, 1), 1.5 * 4 / 3, (255, 0, 0)), (large, (10, 5, 5), 1.5 * 8 / 3, (0, 255, 0))
    for mesh, middle, radius, color in balls:
        np.testing.assert_allclose((mesh.vertices.max(axis=0) + mesh.vertices.min(axis=0)) / 2, middle, atol=1e-6)
        assert np.linalg.norm(mesh.vertices - middle, axis=1) == pytest.approx(radius)
        assert mesh.opacity == 0.5 and mesh.colors is not None and (mesh.colors == color).all()
    (blue,) = meshes_at(points, (1.0, 0.0, 0.0, 0.0))
    assert blue.colors is not None and (blue.colors == (0, 0, 255)).all()


def test_shapes_surfaces_tracks_and_vectors_are_meshes(layers: Any) -> None:
    square = np.array([[1, 0, 0], [1, 0, 4], [1, 4, 4], [1, 4, 0.0]])
    colors = {"edge_color": "red", "face_color": "blue"}
    shape = layers.Shapes([square], shape_type="rectangle", edge_width=0.5, opacity=1, **colors)
    face, edge = meshes_at(shape, (0.0,) * 3)
    assert len(face) == 4 and np.allclose(face.vertices[:, 2], 1) and face.vertices[:, :2].max() == 4
    assert edge.vertices.max() == pytest.approx(4.25, abs=0.02) and (edge.colors == (255, 0, 0)).all()
    triangle = (np.array([[0, 0, 0], [0, 0, 6], [3, 0, 0.0]]), np.array([[0, 1, 2]]), np.array([0.0, 1.0, 2.0]))
    (surface,) = meshes_at(layers.Surface(triangle, colormap="gray", contrast_limits=(0, 2)), (0.0,) * 3)
    assert surface.vertices.tolist() == [[0, 0, 0], [6, 0, 0], [0, 0, 3]] and surface.colors is not None
    assert np.abs(surface.colors[:, 0].astype(int) - (0, 127, 255)).max() <= 1
    rows = [[7, time, 0, 0, 2.0 * time] for time in range(5)]
    track = layers.Tracks(np.array(rows), tail_length=2, head_length=0, tail_width=4)
    (tube,) = meshes_at(track, (3.0, 0.0, 0.0, 0.0))
    # of the last two times, two pixels thick at a zoom of two
    assert (tube.vertices[:, 0].min(), tube.vertices[:, 0].max()) == (2.0, 6.0)
    assert np.linalg.norm(tube.vertices[:, 1:], axis=1) == pytest.approx(1.0)
    arrow = layers.Vectors(np.array([[[0, 0, 0], [0, 0, 3.0]]]), length=2, edge_width=1)
    assert meshes_at(arrow, (0.0,) * 3)[0].vertices[:, 0].max() == 6.0


def test_shading_and_styles_are_napari_s_or_noted(layers: Any) -> None:
    places = np.array([[0, 1, 2.0], [0, 5, 5]])
    triangle = (np.array([[0, 0, 0], [0, 0, 6], [3, 0, 0.0]]), np.array([[0, 1, 2]]), np.array([0.0, 1.0, 2.0]))
    plain = [layers.Points(places, border_width=0), layers.Surface(triangle, shading="none")]
    lit = [layers.Points(places, border_width=0, shading="spherical"), layers.Surface(triangle, shading="smooth")]
    styled = [
        (layers.Points(places, border_color="red"), "without a ring"),
        (layers.Vectors(np.array([[[0, 0, 0], [0, 0, 3.0]]]), vector_style="triangle"), "not of style triangle"),
        (layers.Tracks(np.array([[7, time, 0, 0, time] for time in range(5)])), "do not fade with age"),
    ]

    def notes_of(layer: Any) -> str:
        point = (3.0,) * (layer.ndim if layer.ndim > 3 else 0) or (0.0,) * 3
        return " ".join(
            take(viewer(layer, ndim=len(point), order=tuple(range(len(point))), point=point)).layers[0].notes
        )

    for layer in plain:
        assert (meshes_at(layer, (0.0,) * 3)[0].normals == 0).all() and not notes_of(layer)
    for layer in lit:
        assert meshes_at(layer, (0.0,) * 3)[0].normals.any() and "brighter than napari's" in notes_of(layer)
    for layer, note in styled:
        assert note in notes_of(layer), layer


def test_meshes_and_volumes_share_a_picture(layers: Any) -> None:
    """Points are laid over a volume in their order; in one blend for all they are mixed by depth, or named."""
    ball = layers.Points(np.array([[4.0, 5, 6]]), size=4, face_color="lime", opacity=1)
    seen = viewer(Image(block(200)), ball, center=MIDDLE, point=MIDDLE)
    assert shade_of(draw.picture(seen))[1] > 150 and shade_of(draw.picture(seen), (23, 24)) == (200, 0, 0)
    assert "not drawn: Points, points or surfaces" in draw.picture(seen, "mip").info["notes"]
    assert shade_of(draw.picture(viewer(ball, center=MIDDLE, point=MIDDLE), "composite"))[1] > 150
    with pytest.raises(sg.InputError, match="layers: expected voxels, which mip draws"):
        draw.picture(viewer(ball, center=MIDDLE, point=MIDDLE), "mip")


def test_a_look_has_a_light_a_preset_and_annotations() -> None:
    z, y, x = np.indices((24, 24, 24)) - 12.0
    ball = (200 * np.exp(-(x * x + y * y + z * z) / 40)).astype(np.uint8)
    seen = take(viewer(Image(ball), center=(12.0, 12.0, 12.0)))
    plain = draw.draw_snapshot(replace(seen, look=Look(size=(80, 72))))
    changed = draw.draw_snapshot(replace(seen, look=Look(size=(80, 72), preset="ct-bone", light="glossy")))
    written = draw.draw_snapshot(replace(seen, look=Look(size=(80, 72), annotate=("scale", "axes"))))
    assert plain.info["blend"] == "mip" and changed.info["blend"] == "composite"
    assert written.info["annotated"] == ["scale", "axes"] and not np.array_equal(written.pixels, plain.pixels)


def test_previews_are_far_smaller_than_the_picture() -> None:
    seen = take(viewer(Image(np.zeros((96, 128, 128), np.uint8)), center=MIDDLE))
    first, second, last = worker.levels(replace(seen, look=Look(size=(666, 800), annotate=("scale",))))
    assert [level.look.stride for level in (first, second, last)] == [4, 2, 1]
    assert np.prod(first.size) <= 2**15 * 1.01 and np.prod(second.size) <= 2**17 * 1.01 and last.size == (666, 800)
    assert not first.look.annotate and last.look.annotate
    # small ones are drawn at once
    small = take(viewer(Image(block()), center=MIDDLE))
    assert [level.look for level in worker.levels(small)] == [small.look]


@pytest.mark.long
def test_a_process_draws_beside_the_window() -> None:
    """Answers of jobs; samples are sent once, splats are kept; errors, cancelled jobs and an ended process."""
    found: list[worker.Answer] = []
    drawing = worker.Worker(found.append)

    def answer(number: int) -> worker.Answer:
        end = time.monotonic() + 120
        while time.monotonic() < end:
            last = [each for each in found if each.job == number and each.state != "preview"]
            if last:
                return last[0]
            time.sleep(0.01)
        raise TimeoutError

    layer = Image(spots((1, 2, 9)), (3, 2, 1.5))
    seen = viewer(layer, center=(0.0, 9.0, 8.25))
    try:
        done = answer(drawing.draw(seen, Look()))
        right = draw.picture(seen)
        assert done.image is not None and done.rgb is not None and np.array_equal(done.image.pixels, right.pixels)
        assert (done.rgb == right.samples8()[..., :3]).all() and done.image.info["notes"] == ()
        known = set(drawing.known)
        seen.camera.zoom = 3.0
        again = answer(drawing.draw(seen, Look()))
        assert known == drawing.known and again.image is not None
        assert np.array_equal(again.image.pixels, draw.picture(seen).pixels)
        # samples that change in place are sent again
        layer.data[4, 5, 6] = 255
        changed = answer(drawing.draw(seen, Look()))
        assert changed.image is not None and np.array_equal(changed.image.pixels, draw.picture(seen).pixels)
        assert "one of composite" in answer(drawing.draw(seen, Look(blend="iso"))).text  # type: ignore[arg-type]
        number = drawing.draw(seen, Look(size=(900, 900)))
        drawing.cancel()
        assert not drawing.busy and all(each.job != number for each in found)
        assert answer(drawing.draw(seen, Look())).state == "done"
        assert drawing.process is not None
        process = drawing.process
        assert os.getpriority(os.PRIO_PROCESS, process.pid) > os.getpriority(os.PRIO_PROCESS, 0)
        number = drawing.draw(viewer(Image(np.zeros((96, 96, 96), np.uint8)), center=MIDDLE), Look(size=(900, 900)))
        while drawing.drawn != number:
            time.sleep(0.01)
        process.kill()
        assert "has ended" in answer(number).text
        assert answer(drawing.draw(seen, Look())).state == "done" and drawing.process is not process
    finally:
        drawing.close()


SCREEN = """
import os, sys, time, warnings
import numpy as np, napari, splatgl as sg
from qtpy.QtWidgets import QApplication
from splatgl.integrations.napari import draw, widget

z, y, x = np.mgrid[:30, :36, :42].astype(float)
balls = [((10, 13, 15), 7, 1.0), ((20, 22, 28), 6, 0.7), ((15, 10, 33), 5, 0.5)]
data = sum(s * np.clip((r - np.sqrt((z - a) ** 2 + (y - b) ** 2 + (x - c) ** 2)) / 2 + 0.5, 0, 1)
           for (a, b, c), r, s in balls).astype(np.float32) * 200
cut = [{"position": (18, 18, 21), "normal": (0, 1, 1), "enabled": True}]
plane = {"position": (13, 15, 21), "normal": (1, 0.3, 0.2), "thickness": 4}
CASES = {
    "maximum": [{}], "opacity": [{"opacity": 0.4}], "clip": [{"experimental_clipping_planes": cut}],
    "iso": [{"rendering": "iso", "iso_threshold": 60}], "plane": [{"depiction": "plane", "plane": plane}],
    "attenuated": [{"rendering": "attenuated_mip", "attenuation": 0.05}],
    "additive": [{"rendering": "additive"}], "average": [{"rendering": "average"}],
    "flat": [{"opacity": 0.5}],
    "two": [{"colormap": "red", "opacity": 0.6}, {"colormap": "green", "blending": "additive", "opacity": 0.5}],
}
# none of what the bridge reads is deprecated
warnings.filterwarnings("error", message=".*deprecated attribute")
viewer = napari.Viewer(show=True)
viewer.window._qt_window.resize(620, 480)
for name, layers in CASES.items():
    viewer.layers.clear()
    for number, given in enumerate(layers):
        given = {"rendering": "mip", **given}
        viewer.add_image(data[:, ::-1] if number else data, scale=(2, 1, 1), contrast_limits=(0, 200), **given)
    viewer.dims.ndisplay = 2 if name == "flat" else 3
    viewer.dims.set_point(0, 21)
    viewer.fit_to_view() if hasattr(viewer, "fit_to_view") else viewer.reset_view()
    if name != "flat":
        viewer.scene.camera.angles = (10, 25, 60)
    QApplication.processEvents()
    ours = np.asarray(draw.picture(viewer).to_pil().convert("RGB")).astype(float)
    theirs = viewer.screenshot(canvas_only=True, flash=False)[..., :3].astype(float)
    assert ours.shape == theirs.shape
    both, either = [f([ours.max(axis=-1) > 25, theirs.max(axis=-1) > 25]) for f in
                    (lambda m: m[0] & m[1], lambda m: m[0] | m[1])]
    print(name, both.sum() / either.sum(), ours.sum() / theirs.sum(), flush=True)
# the viewer's context is current again: a program of its own that is new is compiled in it
one = viewer.add_image(data, interpolation3d="linear")
viewer.screenshot(flash=False)
sg.render(one, size=32)
one.rendering, one.interpolation3d = "minip", "cubic"
viewer.add_labels((data > 100).astype(int))
viewer.screenshot(flash=False)
drawn = widget.Panel(viewer)

def wait():
    # until the panel has drawn
    end = time.monotonic() + 200
    while drawn.state in ("drawing", "preview") and time.monotonic() < end:
        QApplication.processEvents()
        time.sleep(0.01)

drawn.annotations["scale"].setChecked(True)
drawn.sizes.setCurrentText("200x160")
drawn.draw()
assert drawn.cancel_button.isEnabled() and not drawn.save_button.isEnabled()
wait()
assert drawn.image is not None and drawn.save_button.isEnabled() and "pixels" in drawn.summary.text()
assert drawn.image.pixels.shape[:2] == (160, 200) and drawn.image.info["annotated"] == ["scale"]
# samples are encoded for a display in the other process, and files in another thread
encode, sg.Image.samples8 = sg.Image.samples8, None
drawn.copy()
assert QApplication.clipboard().image().width() == 200
drawn.add_layer()
assert viewer.layers[-1].rgb and viewer.layers[-1].data.shape == (160, 200, 3)
viewer.layers.pop()
sg.Image.samples8 = encode
folder = sys.argv[1]
saved = lambda: os.path.exists(folder + "/saved.png")
refused = lambda: "x.txt" in drawn.summary.text()
for name, seen in (("saved.png", saved), ("no/x.txt", refused)):
    widget.QFileDialog.getSaveFileName = lambda *arguments: (f"{folder}/{name}", "")
    drawn.save()
    end = time.monotonic() + 60
    while not seen() and time.monotonic() < end:
        QApplication.processEvents()
    assert seen(), name
number = drawn.worker.number
drawn.follow.setChecked(True)
viewer.scene.camera.zoom *= 1.1
QApplication.processEvents()
time.sleep(0.2)
QApplication.processEvents()
assert drawn.worker.number == number + 1 and drawn.state == "drawing"
drawn.cancel()
assert drawn.state == "cancelled" and not drawn.cancel_button.isEnabled()
drawn.follow.setChecked(False)
drawn.sizes.setCurrentText("small")
drawn.draw()
assert "size: expected a width and a height" in drawn.summary.text()
drawn.sizes.setCurrentText("canvas")
viewer.layers.clear()
drawn.draw()
wait()
assert drawn.image is None and not drawn.save_button.isEnabled() and drawn.shown.pixmap().isNull()
drawn.worker.close()
assert "expected a visible Image, Labels or other layer" in drawn.summary.text()
print("done", flush=True)
os._exit(0)
"""


@pytest.mark.long
def test_in_napari_pictures_are_its_screenshots(tmp_path: Path) -> None:
    """Outlines and brightness, of a viewer on a display of its own, beside napari's own drawing; then the panel."""
    pytest.importorskip("napari", reason="the extra napari has the viewer")
    pytest.importorskip("qtpy.QtWidgets", reason="napari's window takes PyQt6 or PySide6", exc_type=Exception)
    if shutil.which("xvfb-run") is None:
        pytest.skip("xvfb-run: its display is where napari's window opens")
    command = ["xvfb-run", "-a", sys.executable, "-W", "ignore", "-c", SCREEN, str(tmp_path)]
    ended = subprocess.run(command, capture_output=True, text=True, env={**os.environ, "QT_QPA_PLATFORM": "xcb"})
    lines = ended.stdout.split("\n")
    assert "done" in lines, ended.stderr
    found = {
        name: (float(overlap), float(light)) for name, overlap, light in map(str.split, lines[: lines.index("done")])
    }
    print(found)
    assert len(found) == 10
    for name, (overlap, light) in found.items():
        # the plane is seen from its edge
        assert overlap > (0.8 if name == "plane" else 0.93), name
        # surfaces are lit otherwise
        assert name == "iso" or light == pytest.approx(1, abs=0.07), name


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
