"""Channels and time points of files: orders of axes, planes, what is read, and one picture of several channels."""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import pytest

import splatgl as sg
from splatgl.cli.main import main
from splatgl.data.color import color_of_dye
from splatgl.data.volume import Hints
from splatgl.fileio import WHOLE_BYTES
from splatgl.planning.scene import channel_transfers
from splatgl.readers.chunked import Chunked
from splatgl.scene.scene_file import SceneFile
from splatgl.scene.view import ViewOptions, orient_stack

pytestmark = pytest.mark.usefixtures("shared_programs")

tifffile = pytest.importorskip("tifffile")
SIZES = {"T": 3, "C": 2, "Z": 4, "Y": 10, "X": 12}


def values(order: str) -> np.ndarray:
    """Every value once, along axes of that order."""
    shape = [SIZES[axis] for axis in order]
    return np.arange(np.prod(shape), dtype=np.uint16).reshape(shape)


def imwrite(path: Path, order: str, **options: object) -> Path:
    tifffile.imwrite(path, values(order), metadata={"axes": order}, photometric="minisblack", **options)
    return path


def check_tiff(path: Path) -> None:
    """Every channel at every time has the samples that tifffile reads along the axes that it names."""
    with tifffile.TiffFile(path) as file:
        series = file.series[0]
        axes, whole = series.axes, series.asarray()
    sizes = dict(zip(axes, whole.shape, strict=True))
    for time, channel in product(range(sizes.get("T", 1)), range(sizes.get("C", 1))):
        index = {"T": time, "C": channel}
        right = whole[tuple(index.get(axis, slice(None)) for axis in axes)]
        given = {name: index[axis] for name, axis in (("time", "T"), ("channel", "C")) if axis in axes}
        volume = sg.load(path, **given)
        assert np.array_equal(volume.samples, right if "Z" in axes else right[None]), (axes, given)
        assert volume.times == sizes.get("T", 1)
    assert len(sg.load(path, channel="all").channels) == (SIZES["C"] if "C" in axes else 0)


@pytest.mark.parametrize("compression", [None, "zlib"])
@pytest.mark.parametrize("order", ["TCZYX", "TZCYX", "CTZYX", "CZTYX", "ZCTYX", "ZTCYX", "CZYX", "TZYX", "TCYX", "CYX"])
def test_ome_axes(order: str, compression: str | None, tmp_path: Path) -> None:
    check_tiff(imwrite(tmp_path / "a.ome.tif", order, ome=True, compression=compression))


@pytest.mark.parametrize("order", ["TZCYX", "ZCYX", "TZYX", "TCYX", "CYX", "TYX"])
def test_imagej_axes(order: str, tmp_path: Path) -> None:
    check_tiff(imwrite(tmp_path / "a.tif", order, imagej=True))


def test_one_time_point_is_decoded_alone(tmp_path: Path) -> None:
    """Damage in another one is not met: the pages of that are not read."""
    path = imwrite(tmp_path / "a.ome.tif", "TZYX", ome=True, compression="zlib")
    with tifffile.TiffFile(path) as file:
        page = file.pages[SIZES["Z"] * 2]
        place, count = page.dataoffsets[0], page.databytecounts[0]
    data = bytearray(path.read_bytes())
    data[place : place + count] = b"\xff" * count
    path.write_bytes(data)
    assert np.array_equal(sg.load(path, time=1).samples, values("TZYX")[1])
    with pytest.raises(sg.InputError, match="cannot be read as TIFF"):
        sg.load(path, time=2)


def test_a_plane_is_no_terrain_and_time_no_depth(tmp_path: Path) -> None:
    """One plane of a microscope is seen along z; without its metadata pages are planes."""
    volume = SceneFile(str(imwrite(tmp_path / "a.ome.tif", "TYX", ome=True))).open()
    assert volume.shape == (1, 10, 12) and volume.hints.up == (0, -1, 0)
    tifffile.imwrite(tmp_path / "b.tif", values("TYX"), photometric="minisblack", metadata=None)
    assert sg.load(tmp_path / "b.tif").shape == (3, 10, 12)


def test_channels_of_colours(tmp_path: Path) -> None:
    """A channel may have three colours itself: it is picked, its colours are kept."""
    rgb = np.random.default_rng(5).integers(0, 256, (4, 4, 10, 12, 3), np.uint8)
    tifffile.imwrite(tmp_path / "a.ome.tif", rgb, ome=True, photometric="rgb", metadata={"axes": "CZYXS"})
    assert np.array_equal(sg.load(tmp_path / "a.ome.tif", channel=3).color, rgb[3])


def test_spacing_is_that_of_every_channel(tmp_path: Path) -> None:
    volume = sg.load(imwrite(tmp_path / "a.ome.tif", "CZYX", ome=True), channel="all", spacing=(1, 2, 3))
    assert [each.spacing for each in volume.channels] == [(1, 2, 3)] * 2 and volume.spacing == (1, 2, 3)


@pytest.mark.parametrize(
    ("labels", "names"),
    [
        (["DAPI", "GFP"] * 4, ["DAPI", "GFP"]),
        ([f"slice {n}" for n in range(8)], ["0", "1"]),
        (["", ""] * 4, ["0", "1"]),
    ],
)
def test_labels_of_imagej(labels: list[str], names: list[str], tmp_path: Path) -> None:
    """A label that all planes of a channel have is its name; labels of planes are none."""
    metadata = {"axes": "ZCYX", "Labels": labels}
    tifffile.imwrite(tmp_path / "a.tif", values("ZCYX"), imagej=True, metadata=metadata)
    assert [each.name for each in sg.load(tmp_path / "a.tif", channel="all").channels] == names


def test_planes_without_rows_are_told(tmp_path: Path) -> None:
    path = imwrite(tmp_path / "a.tif", "TZCYX", imagej=True)
    with tifffile.TiffFile(path) as file:
        place = file.pages[0].tags["ImageLength"].offset
    data = bytearray(path.read_bytes())
    # a tag of no type is not read
    data[place + 2 : place + 4] = bytes(2)
    path.write_bytes(data)
    with pytest.raises(sg.InputError, match="size: expected at least one pixel"):
        sg.load(path)


def test_a_time_that_is_not_there(tmp_path: Path) -> None:
    path = imwrite(tmp_path / "a.ome.tif", "CZYX", ome=True)
    with pytest.raises(sg.InputError, match="time: expected a file of several time points, got 5"):
        sg.load(path, channel=0, time=5)


def image(path: Path, order: str, version: str = "0.5") -> Path:
    """An OME-Zarr image by the text of that version: 0.1 and 0.2 name no axes, 0.5 is Zarr 3 and has them in "ome"."""
    zarr = pytest.importorskip("zarr")
    last = version == "0.5"
    group = zarr.open_group(path, mode="w", zarr_format=3 if last else 2)
    data = values(order.upper())
    group.create_array("0", data=data, chunks=tuple(min(size, 3) for size in data.shape))
    kinds = {"t": {"type": "time", "unit": "millisecond"}, "c": {"type": "channel"}}
    axes = [{"name": axis, **kinds.get(axis, {"type": "space", "unit": "micrometer"})} for axis in order]
    scale = [{"t": 250.0, "c": 1.0, "z": 2.0, "y": 0.5, "x": 0.25}[axis] for axis in order]
    steps = {"coordinateTransformations": [{"type": "scale", "scale": scale}]} if version >= "0.4" else {}
    named = {"axes": axes if version >= "0.4" else list(order)} if version >= "0.3" else {}
    metadata = {"multiscales": [{"version": version, "datasets": [{"path": "0", **steps}], **named}]}
    group.attrs.update({"ome": {"version": version, **metadata}} if last else metadata)
    return path


@pytest.mark.few(10)
@pytest.mark.parametrize("parts", [False, True])
@pytest.mark.parametrize("order", ["tczyx", "xyzct", "ctyxz", "zcyxt", "zyx", "yxz", "tcyx", "yxc", "yx"])
def test_zarr_axes(order: str, parts: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Any order, at once and in parts: samples are [z, y, x], each from its place, and so is the spacing."""
    monkeypatch.setenv("SPLATGL_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr("splatgl.readers.ome_zarr.WHOLE_BYTES", 0 if parts else WHOLE_BYTES)
    path = image(tmp_path / "a.zarr", order)
    whole, names = values(order.upper()), [name for name in "tczyx" if name in order]
    whole = whole.transpose([order.index(name) for name in names])
    for time, channel in product(range(3 if "t" in order else 1), range(2 if "c" in order else 1)):
        right = whole[tuple({"t": time, "c": channel}.get(name, slice(None)) for name in names)]
        right = right if "z" in order else right[None]
        volume = sg.load(path, time=time, channel=channel if "c" in order else None)
        assert isinstance(volume.samples, Chunked) == parts and volume.shape == right.shape
        assert np.array_equal(np.asarray(volume.samples[:]), right)
        box = np.s_[0:2, 3:8, 5]
        assert np.array_equal(np.asarray(volume.samples[box]), right[box])
        assert volume.spacing == (0.25, 0.5, 2.0 if "z" in order else 0.25) and volume.unit == "um"
        assert (volume.times, volume.time_step) == ((3, 0.25) if "t" in order else (1, None))


def test_zarr_reads_the_chunks_it_needs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of turned axes, too: all chunks but one may be lost."""
    zarr = pytest.importorskip("zarr")
    monkeypatch.setenv("SPLATGL_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr("splatgl.readers.ome_zarr.WHOLE_BYTES", 0)
    path = image(tmp_path / "a.zarr", "xyzct")
    samples = sg.load(path, channel=1, time=2).samples
    # x 6…8, y 3…5, z 3, both channels, all times
    kept = path / "0" / "c" / "2" / "1" / "1" / "0" / "0"
    for file in (path / "0" / "c").rglob("*"):
        if file.is_file() and file != kept:
            file.write_bytes(b"damaged")
    right = values("XYZCT")[6:9, 3:6, 3, 1, 2].T
    assert zarr.open_array(path / "0", mode="r").shape == (12, 10, 4, 2, 3)
    assert np.array_equal(samples[3, 3:6, 6:9], right)
    with pytest.raises(sg.InputError, match="cannot be read as Zarr, chunk"):
        samples[2, 3:6, 6:9]


@pytest.mark.parametrize("version", ["0.1", "0.3", "0.4"])
def test_older_ome_zarr(version: str, tmp_path: Path) -> None:
    volume = sg.load(image(tmp_path / "a.zarr", "tczyx", version), channel=1, time=2)
    assert np.array_equal(volume.samples, values("TCZYX")[2, 1])
    assert (volume.times, volume.time_step) == (3, 0.25 if version == "0.4" else None)


@pytest.mark.parametrize("form", [2, 3])
def test_named_dimensions(form: int, tmp_path: Path) -> None:
    """Zarr 3's dimension_names, and what xarray writes into Zarr 2."""
    zarr = pytest.importorskip("zarr")
    names = ["x", "time", "z", "y"]
    given = {"dimension_names": names} if form == 3 else {}
    array = zarr.create_array(tmp_path / "a.zarr", data=values("XTZY"), zarr_format=form, **given)
    if form == 2:
        array.attrs["_ARRAY_DIMENSIONS"] = names
    volume = sg.load(tmp_path / "a.zarr", time=1)
    assert np.array_equal(volume.samples, values("XTZY")[:, 1].transpose(1, 2, 0)) and volume.times == 3


def test_resumed_frames_are_of_the_same_times(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Other time points of the same number are another animation."""
    z, y, x = np.indices((4, 10, 12))
    balls = [np.exp(-((x - 2 - n) ** 2 + (y - 5) ** 2 + (z - 2) ** 2) / 4) * 200 for n in range(6)]
    tifffile.imwrite(tmp_path / "a.ome.tif", np.array(balls, np.uint8), ome=True, metadata={"axes": "TZYX"})
    line = ["animate", str(tmp_path / "a.ome.tif"), "--size", "16", "-o", str(tmp_path / "{frame}.png"), "--resume"]
    assert main([*line, "--time", "0:3"]) == main([*line, "--time", "0:3"]) == 0
    assert "3 of them existed" in capsys.readouterr().out
    assert main([*line, "--time", "0:6:2"]) == 2
    assert "expected a frame of this animation" in capsys.readouterr().err


def test_planes_are_played(tmp_path: Path) -> None:
    """A movie of one plane: a frame is the picture of its time, not the same one again."""
    discs = np.zeros((3, 40, 60), np.uint8)
    for n in range(3):
        discs[n, 10:30, 5 + 15 * n : 20 + 15 * n] = 200
    tifffile.imwrite(tmp_path / "a.tif", discs, imagej=True, metadata={"axes": "TYX"})
    points = ["--points", "0:0,200:0.9", "--colormap", "gray"]
    out = ["-o", str(tmp_path / "{frame}.npy"), "--quiet", "--background", "transparent"]
    assert main(["animate", str(tmp_path / "a.tif"), "--size", "60x40", *points, *out]) == 0
    columns = np.arange(60) + 0.5
    alpha = [np.load(tmp_path / f"{n}.npy")[..., 3].sum(axis=0) for n in range(3)]
    centres = [(columns * each).sum() / each.sum() for each in alpha]
    assert centres[0] < centres[1] - 5 < centres[2] - 10


def test_some_times_of_several_files_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = str(imwrite(tmp_path / "a.ome.tif", "TZYX", ome=True))
    assert main(["animate", path, path, "--time", "0:2", "-o", str(tmp_path / "{frame}.npy")]) == 2
    assert "--time: expected one time point of each file" in capsys.readouterr().err


def test_zarr_of_more_channels_than_there_can_be(tmp_path: Path) -> None:
    """Told at once: a list of them would take minutes and all memory."""
    zarr = pytest.importorskip("zarr")
    group = zarr.open_group(tmp_path / "a.zarr", mode="w")
    names = ("c", "z", "y", "x")
    group.create_array("0", shape=(2**31, 4, 5, 6), chunks=(1, 4, 5, 6), dtype="u1", dimension_names=names)
    with pytest.raises(sg.InputError, match="channels: expected at most 4096, got 2147483648"):
        sg.load(tmp_path / "a.zarr", array="0")


def test_nrrd_of_other_kinds_than_axes(tmp_path: Path) -> None:
    path = tmp_path / "a.nrrd"
    fields = ("type: uint8", "dimension: 4", "sizes: 3 4 5 6", "kinds: vector" + " domain" * 4, "encoding: raw")
    path.write_bytes("\n".join(("NRRD0004", *fields, "", "")).encode() + bytes(360))
    with pytest.raises(sg.InputError, match=r"kinds: expected one per axis \(4\), got 5"):
        sg.load(path)


def test_composites_of_imagej_without_tables_are_in_its_colours(tmp_path: Path) -> None:
    """ImageJ writes no lookup tables for red, green, blue, white, cyan, magenta and yellow, in this order."""
    tifffile = pytest.importorskip("tifffile", reason="tifffile writes the file")
    planes = np.arange(2 * 8 * 3 * 4, dtype=np.uint16).reshape(2, 8, 3, 4)
    for mode, colors in (
        ("composite", ["#ff0000", "#00ff00", "#0000ff", "#ffffff", "#00ffff", "#ff00ff", "#ffff00", None]),
        ("grayscale", [None] * 8),
    ):
        path = tmp_path / f"{mode}.tif"
        tifffile.imwrite(path, planes, imagej=True, metadata={"axes": "ZCYX", "mode": mode})
        volume = sg.load(path, channel="all")
        assert [each.hints.color for each in volume.channels] == colors


# --- pictures of several channels -------------------------------------------------------------------------------------


# t, c, z, y, x
SHAPE = (3, 2, 6, 16, 18)


def samples() -> np.ndarray:
    """Every value once."""
    return np.arange(np.prod(SHAPE), dtype=np.uint16).reshape(SHAPE)


def ome(path: Path, **more: object) -> Path:
    metadata = {
        "axes": "TCZYX",
        "Channel": {"Name": ["DAPI", "GFP"], "Color": [0x0000FFFF, 0x00FF00FF]},
        "TimeIncrement": 500.0,
        "TimeIncrementUnit": "ms",
        **more,
    }
    tifffile.imwrite(path, samples(), ome=True, metadata=metadata, photometric="minisblack")
    return path


def imagej(path: Path) -> Path:
    ramp = np.arange(256, dtype=np.uint8)
    luts = [np.stack([ramp * (k == n) for k in range(3)]).astype(np.uint8) for n in (0, 1)]
    metadata = {
        "axes": "TZCYX",
        "mode": "composite",
        "LUTs": luts,
        "Ranges": (10.0, 900.0, 5.0, 700.0),
        "finterval": 2.5,
    }
    tifffile.imwrite(path, np.moveaxis(samples(), 1, 2), imagej=True, metadata=metadata)
    return path


def ome_zarr(path: Path, order: str = "tczyx") -> Path:
    zarr = pytest.importorskip("zarr")
    group = zarr.open_group(path, mode="w", zarr_format=2)
    turned = samples().transpose(["tczyx".index(axis) for axis in order])
    group.create_array("0", data=turned, chunks=turned.shape)
    kinds = {"t": {"type": "time", "unit": "second"}, "c": {"type": "channel"}}
    axes = [{"name": axis, **kinds.get(axis, {"type": "space", "unit": "micrometer"})} for axis in order]
    scale = [{"t": 4.0, "c": 1.0, "z": 2.0, "y": 0.5, "x": 0.25}[axis] for axis in order]
    steps = [{"type": "scale", "scale": scale}]
    group.attrs["multiscales"] = [
        {"version": "0.4", "axes": axes, "datasets": [{"path": "0", "coordinateTransformations": steps}]}
    ]
    channels = [("DAPI", "0000FF", 10, 900), ("GFP", "00FF00", 5, 700)]
    group.attrs["omero"] = {
        "channels": [{"label": n, "color": c, "window": {"start": a, "end": b}} for n, c, a, b in channels]
    }
    return path


@pytest.mark.parametrize("kind", ["ome", "imagej", "zarr", "zarr turned"])
def test_channels_and_times(kind: str, tmp_path: Path) -> None:
    """All channels of the first time by default; each by its number or name; the values of each, voxel by voxel."""
    path, names, windows, step = {
        "ome": lambda: (ome(tmp_path / "a.ome.tif"), ("DAPI", "GFP"), (None, None), 0.5),
        "imagej": lambda: (imagej(tmp_path / "a.tif"), ("0", "1"), ((10, 900), (5, 700)), 2.5),
        "zarr": lambda: (ome_zarr(tmp_path / "a.zarr"), ("DAPI", "GFP"), ((10, 900), (5, 700)), 4.0),
        "zarr turned": lambda: (
            ome_zarr(tmp_path / "a.zarr", "xyczt"),
            ("DAPI", "GFP"),
            ((10, 900), (5, 700)),
            4.0,
        ),
    }[kind]()
    right = samples()
    volume = sg.load(path)
    assert (volume.times, volume.time_step) == (3, step) and "time 0 of 3" in volume.notes[0]
    assert tuple(each.name for each in volume.channels) == names
    assert tuple(each.hints.window for each in volume.channels) == windows
    assert [each.hints.color for each in volume.channels] == (
        ["#ff0000", "#00ff00"] if kind == "imagej" else ["#0000ff", "#00ff00"]
    )
    for number, channel in enumerate(volume.channels):
        assert np.array_equal(channel.samples, right[0, number]) and channel.spacing == volume.spacing
    assert np.array_equal(volume.samples, right[0, 0])
    if kind.startswith("zarr"):
        assert volume.spacing == (0.25, 0.5, 2.0) and volume.unit == "um"
    for time in (0, 2):
        for asked in (1, names[1]):
            one = sg.load(path, time=time, channel=asked)
            assert np.array_equal(one.samples, right[time, 1]) and not one.channels and not one.notes
    both = sg.load(path, channel=f"{names[1]},{names[0]}", time=1)
    assert [each.name for each in both.channels] == [names[1], names[0]]
    assert np.array_equal(both.samples, right[1, 1]) and np.array_equal(both.channels[1].samples, right[1, 0])
    assert len(sg.load(path, channel="all").channels) == 2
    for options, said in (
        ({"channel": "RFP"}, f"channel: expected a number from 0 to 1, or one of {names[0]}, {names[1]}, got 'RFP'"),
        ({"channel": 2}, "channel: expected a number from 0 to 1"),
        ({"time": 3}, "time: expected a number from 0 to 2"),
        ({"time": -1}, "time: expected zero or more"),
    ):
        with pytest.raises(sg.InputError, match=said):
            sg.load(path, **options)


def test_times_of_nifti(tmp_path: Path) -> None:
    nibabel = pytest.importorskip("nibabel")
    values = np.arange(3 * 4 * 5 * 6, dtype=np.int16).reshape(3, 4, 5, 6)
    image = nibabel.Nifti1Image(values, np.diag([2, 3, 4, 1]))
    image.header.set_xyzt_units("mm", "msec")
    image.header["pixdim"][4] = 1500
    image.to_filename(tmp_path / "a.nii")
    volume = sg.load(tmp_path / "a.nii")
    assert (volume.times, volume.time_step) == (6, 1.5) and np.array_equal(volume.samples, values[..., 0].T)
    for options in ({"time": 4}, {"array": 4}):
        assert np.array_equal(sg.load(tmp_path / "a.nii", **options).samples, values[..., 4].T)


def test_colour_stacks_of_tiff(tmp_path: Path) -> None:
    """RGB and RGBA, 8 and 16 bits: alpha scales the samples; a number still picks one component."""
    rgb = np.random.default_rng(3).integers(0, 256, (5, 8, 9, 3), np.uint8)
    for name, values in (
        ("a", rgb),
        ("b", rgb.astype(np.uint16) * 257),
        ("c", np.concatenate([rgb, rgb[..., :1]], -1)),
    ):
        path = tmp_path / f"{name}.tif"
        tifffile.imwrite(path, values, photometric="rgb", extrasamples=["unassalpha"] if name == "c" else None)
        volume = sg.load(path)
        assert np.array_equal(volume.color, rgb) and volume.samples.dtype == np.uint8
        alpha = values[..., 3] / 255 if name == "c" else 1.0
        assert np.abs(volume.samples - alpha * (rgb @ [0.2126, 0.7152, 0.0722])).max() <= 0.5
        assert np.array_equal(sg.load(path, channel=1).samples, values[..., 1]) and not volume.channels


def stained(tmp_path: Path) -> Path:
    """Two balls that overlap, of different colours; over two times."""
    z, y, x = np.indices((24, 32, 40))
    first, second = (np.exp(-((x - cx) ** 2 + (y - 16) ** 2 + (z - 12) ** 2) / 40) * 1000 for cx in (15, 24))
    stack = np.stack([np.stack([first, second]), np.stack([second, first])]).astype(np.uint16)
    metadata = {"axes": "TCZYX", "Channel": {"Name": ["DAPI", "GFP"], "Color": [0x0000FFFF, 0x00FF00FF]}}
    tifffile.imwrite(tmp_path / "cells.ome.tif", stack, ome=True, metadata=metadata, photometric="minisblack")
    return tmp_path / "cells.ome.tif"


@pytest.mark.long
def test_channels_are_one_picture(
    renderer: sg.Renderer, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each in its colour and window, mixed where they overlap; not one over the other."""
    path, out = stained(tmp_path), tmp_path / "a.npy"
    monkeypatch.chdir(tmp_path)
    line = ["render", path.name, "--size", "48", "-o", "a.npy", "--window-of", "0=100,900", "--window-of", "GFP=50,800"]
    assert main([*line, "--color-of", "DAPI=Fuchsia", "--background", "transparent"]) == 0
    said = capsys.readouterr()
    assert "channels DAPI, GFP" in said.out and "time 0 of 2: --time picks another" in said.err
    volume = sg.load(path)
    windows = {"DAPI": (100.0, 900.0), "GFP": (50.0, 800.0)}
    looks = channel_transfers(volume, {"0": "#ff00ff"}, windows)
    assert [look.colormap for look in looks] == ["#ff00ff", "#00ff00"] and not any(look.shading for look in looks)
    full = 1 - np.exp(-6 / 24)
    assert [look.points for look in looks] == [((100, 0), (900, full)), ((50, 0), (800, full))]
    scene = sg.Scene([sg.Layer(each, look) for each, look in zip(volume.channels, looks, strict=True)])
    camera = ViewOptions(size=(48, 48)).camera(orient_stack(volume), scene)
    pixels = renderer.render(scene, camera).pixels
    assert np.array_equal(np.load(out), pixels)
    red, green, blue, alpha = np.moveaxis(pixels, -1, 0)
    assert np.allclose(red, blue, atol=1e-6) and (np.minimum(red, green) > 0.05).sum() > 20 and alpha.max() > 0.7
    scene_file = SceneFile(path.name, transfer={"color_of": [["DAPI", "#ff00ff"]], "window_of": list(windows.items())})
    (tmp_path / "scene.toml").write_text(scene_file.to_toml(tmp_path))
    clear = ["--background", "transparent", "--quiet"]
    assert main(["render", "scene.toml", "--size", "48", "-o", "b.npy", *clear]) == 0
    assert np.array_equal(np.load(tmp_path / "b.npy"), pixels)


def test_one_channel_has_its_colour(tmp_path: Path) -> None:
    volume = sg.load(stained(tmp_path), channel="GFP", time=0)
    transfer = sg.default_transfer(volume)
    assert transfer.colormap == "#00ff00" and not transfer.shading


@pytest.mark.parametrize(
    ("more", "said"),
    [
        (["--color-of", "RFP=#ff0000"], "channel: expected one of DAPI, GFP, got 'RFP'"),
        (["--color-of", "GFP=reddish"], "expected CHANNEL=COLOR"),
        (["--window-of", "GFP=5"], "expected CHANNEL=LOW,HIGH"),
        (["--window-of", "GFP=5,5"], "LOW below HIGH"),
        (["--channel", "0", "--color-of", "0=#ff0000"], "expected several channels"),
        (["--time", "0:2"], "--time: expected one time point"),
        (["--time", "x"], "expected a number, a time such as 1.5s, or FIRST:END:STEP"),
        (["--time", "7"], "--time: expected a number from 0 to 1"),
    ],
)
def test_bad_channels_are_told(
    tmp_path: Path, more: list[str], said: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    stained(tmp_path)
    monkeypatch.chdir(tmp_path)
    try:
        code = main(["render", "cells.ome.tif", "--size", "16", "-o", "a.png", *more])
    except SystemExit as ended:
        code = int(str(ended.code))
    assert code == 2 and said in capsys.readouterr().err and not (tmp_path / "a.png").exists()


def test_info_lists_channels_and_times(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["info", str(ome_zarr(tmp_path / "a.zarr"))]) == 0
    page = capsys.readouterr().out
    for line in (
        "0: DAPI #0000ff   10 … 900",
        "1: GFP #00ff00   5 … 700",
        "--channel N|NAME,… picks",
        "0 … 2, 4 s apart",
    ):
        assert line in page


@pytest.mark.long
def test_time_points_are_played(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """All of a file, or some; a frame is the picture of its time."""
    path = stained(tmp_path)
    line = ["animate", str(path), "--size", "16", "--channel", "GFP", "-o", str(tmp_path / "f" / "{frame}.npy")]
    assert main(line) == 0
    assert "2 frames" in capsys.readouterr().out
    frames = [np.load(tmp_path / "f" / f"{n}.npy") for n in range(2)]
    assert not np.array_equal(*frames)
    back = ["-o", str(tmp_path / "g" / "{frame}.npy"), "--time", "::-1", "--quiet", "--eye", "20,-80,20"]
    assert main([*line[:-2], *back]) == main([*line, *back[4:]]) == 0
    assert all(
        np.array_equal(np.load(tmp_path / "g" / f"{n}.npy"), np.load(tmp_path / "f" / f"{1 - n}.npy")) for n in (0, 1)
    )
    assert main([*line, "--time", "5:"]) == 2 and "--time: expected some of 0 to 1" in capsys.readouterr().err
    assert main([*line, "--time", "1", "--frames", "2", "--quiet"]) == 0


def test_flat_stacks_are_seen_as_in_a_microscope(renderer: sg.Renderer, tmp_path: Path) -> None:
    """Along z: the corner at x = y = 0 is on the left and on top; those of stacks of pictures by their hints."""
    stack = np.zeros((4, 40, 60), np.uint8)
    stack[:, 2:10, 2:14] = 200
    stack[:, 30:38, 46:58] = 60
    tifffile.imwrite(tmp_path / "a.ome.tif", stack, ome=True, metadata={"axes": "ZYX"}, photometric="minisblack")
    tifffile.imwrite(tmp_path / "plain.tif", stack, photometric="minisblack")
    assert sg.load(tmp_path / "plain.tif").hints.stack
    volume = SceneFile(str(tmp_path / "a.ome.tif")).open()
    assert volume.hints.stack and "seen along z" in volume.notes[-1]
    splats = sg.extract(volume, sg.Transfer([(30, 0), (220, 0.9)]))
    camera = ViewOptions(size=(60, 40)).camera(volume, splats)
    assert np.allclose(camera.right, (1, 0, 0)) and np.allclose(camera.forward, (0, 0, 1))
    image = renderer.render(splats, camera)
    alpha = image.pixels[..., 3]
    assert alpha[:20, :30].sum() > 1.5 * alpha[20:, 30:].sum() > 0 and alpha[20:, :30].max() < 0.05


def test_transfer_functions_of_channels_make_a_scene(tmp_path: Path) -> None:
    """`extract` with one for each channel is the scene of these layers."""
    volume = sg.load(ome(tmp_path / "a.ome.tif"))
    looks = [sg.Transfer([(0, 0), (1700, 0.3)], colormap=name, window=(0, 1700)) for name in ("hot", "viridis")]
    scene = sg.extract(volume, looks)
    assert isinstance(scene, sg.Scene) and [each.name for each in scene.splats(sg.Settings())] == ["DAPI", "GFP"]
    camera = sg.Camera.orbit(scene, 30, 20, size=(8, 8))
    layers = sg.Scene([sg.Layer(each, look) for each, look in zip(volume.channels, looks, strict=True)])
    pictures = [sg.reference.render(each, camera).pixels for each in (scene, layers)]
    assert (pictures[0] == pictures[1]).all() and pictures[0][..., 3].max() > 0.1
    with pytest.raises(sg.InputError, match="one for each of 2 channels, got 3"):
        sg.extract(volume, [*looks, looks[0]])


def omero_store(path: Path, rows: list[dict[str, object]]) -> Path:
    """An OME-Zarr store of a ball in each channel, which rows of OMERO's metadata describe."""
    zarr = pytest.importorskip("zarr")
    z, y, x = np.indices((6, 16, 32))
    balls = [1000 * ((x - 6 - 10 * n) ** 2 + (y - 8) ** 2 + (z - 3) ** 2 < 9) for n in range(len(rows))]
    group = zarr.open_group(path, mode="w", zarr_format=2)
    group.create_array("0", data=np.array(balls, np.uint16))
    axes = [{"name": "c", "type": "channel"}, *({"name": name, "type": "space"} for name in "zyx")]
    scale = {"type": "scale", "scale": [1.0, 1, 1, 1]}
    levels = [{"path": "0", "coordinateTransformations": [scale]}]
    group.attrs["multiscales"] = [{"version": "0.4", "axes": axes, "datasets": levels}]
    group.attrs["omero"] = {"channels": [{"window": {"start": 100, "end": 1000}, **row} for row in rows]}
    return path


def test_channels_that_a_file_switches_off_are_not_read(tmp_path: Path) -> None:
    rows: list[dict[str, object]]
    rows = [{"label": name, "color": color} for name, color in (("a", "00FF00"), ("b", "FF0000"), ("c", "FFFFFF"))]
    path = omero_store(tmp_path / "a.zarr", [rows[0], rows[1], {**rows[2], "active": False}])
    volume = sg.load(path)
    assert [part.name for part in volume.channels] == ["a", "b"] and "channel c: switched off" in volume.notes[0]
    assert len(sg.load(path, channel="all").channels) == 3 and sg.load(path, channel="c").notes == ()
    one = sg.load(omero_store(tmp_path / "b.zarr", [{**rows[0], "active": False}, rows[1]]))
    assert (one.name, one.channels, one.hints.color) == ("b", (), "#ff0000")
    none = omero_store(tmp_path / "c.zarr", [{**row, "active": False} for row in rows])
    assert len(sg.load(none).channels) == 3


def test_inverted_channels_are_full_where_they_are_low(tmp_path: Path) -> None:
    rows: list[dict[str, object]]
    rows = [{"label": "a", "color": "00FF00"}, {"label": "b", "color": "FF0000", "inverted": True}]
    path = omero_store(tmp_path / "a.zarr", rows)
    plain, negative = channel_transfers(sg.load(path), {}, {})
    assert plain.opacity(1000) > 0 and plain.opacity(100) == 0
    assert negative.opacity(1000) == 0 and negative.opacity(100) == plain.opacity(1000)
    alone = sg.default_transfer(sg.load(path, channel="b"))
    assert alone.opacity(100) > 0.5 and alone.opacity(1000) == 0
    sg.load(path).save(tmp_path / "again.zarr")
    assert [part.hints.inverted for part in sg.load(tmp_path / "again.zarr").channels] == [False, True]


def test_a_table_that_ends_in_black_is_a_negative(tmp_path: Path) -> None:
    ramp, zero = np.arange(256, dtype=np.uint8), np.zeros(256, np.uint8)
    tables = [np.stack([zero, ramp, zero]), np.stack([ramp[::-1]] * 3)]
    stack = values("CZYX")
    metadata = {"axes": "ZCYX", "mode": "composite", "LUTs": tables, "Ranges": (0.0, 100.0, 0.0, 100.0)}
    tifffile.imwrite(tmp_path / "a.tif", np.moveaxis(stack, 0, 1), imagej=True, metadata=metadata)
    hints = [part.hints for part in sg.load(tmp_path / "a.tif").channels]
    assert [(hint.color, hint.inverted) for hint in hints] == [("#00ff00", False), ("#ffffff", True)]


def named(*names: str, colors: tuple[str | None, ...] = ()) -> sg.Volume:
    """A volume of channels of these names, each a ball."""
    z, y, x = np.indices((6, 8, 8))
    ball = (100 * np.exp(-((x - 4) ** 2 + (y - 4) ** 2 + (z - 3) ** 2) / 6)).astype(np.float32)
    hints = [Hints(color=color) for color in colors or [None] * len(names)]
    channels = [sg.Volume(ball, name=name, hints=hint) for name, hint in zip(names, hints, strict=True)]
    return replace(channels[0], channels=tuple(channels))


@pytest.mark.parametrize(
    ("names", "primary"),
    [
        (("GFP", "DAPI", "mCherry"), "gbr"),
        (("Alexa Fluor 488", "Hoechst 33342", "Texas Red"), "gbr"),
        (("H2B-mCherry", "EGFP-tubulin", "405 nm"), "rgb"),
        (("MitoTracker Red", "blue", "SYTOX Green"), "rbg"),
        # those without a name take what the others leave
        (("nuclei", "DAPI", "2"), "gbr"),
        (("0", "1", "2"), "bgr"),
    ],
)
def test_names_of_dyes_give_colours(names: tuple[str, ...], primary: str) -> None:
    looks = channel_transfers(named(*names), {}, {})
    assert "".join("rgb"[int(np.argmax(look.color(1e9)))] for look in looks) == primary


def test_colours_of_the_file_go_before_names() -> None:
    looks = channel_transfers(named("GFP", "DAPI", colors=("#ff0000", None)), {"DAPI": "#ffff00"}, {})
    assert [look.colormap for look in looks] == ["#ff0000", "#ffff00"]
    assert [color_of_dye(name) for name in ("Reduced", "Channel 1", "0", "image_300", "")] == [None] * 5


@pytest.mark.parametrize("blend", ["mip", "minip", "mean", "attenuated-mip"])
def test_channels_of_one_value_reach_full_light(blend: str) -> None:
    """The opacity by which matter behind shows through scales no maximum."""
    for look in channel_transfers(named("a", "b"), {}, {"b": (0, 50)}, settings=sg.Settings(blend=blend)):
        assert look.opacity(1e9) == pytest.approx(0.99)
    through = channel_transfers(named("a", "b"), {}, {"b": (0, 50)})
    assert max(look.opacity(1e9) for look in through) < 0.7
