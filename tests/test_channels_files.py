"""Channels and time points as microscopes write them: orders of axes, planes, and what is read of a file."""

from __future__ import annotations

from itertools import product
from pathlib import Path

import numpy as np
import pytest

import splatgl as sg
from splatgl.cli.main import main
from splatgl.fileio import WHOLE
from splatgl.readers.chunked import Chunked
from splatgl.scene.scene_file import Scene

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
    volume = Scene(str(imwrite(tmp_path / "a.ome.tif", "TYX", ome=True))).open()
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
    with pytest.raises(sg.InputError, match="size: expected at least one entry along each axis"):
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
    monkeypatch.setattr("splatgl.readers.ome_zarr.WHOLE", 0 if parts else WHOLE)
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
    monkeypatch.setattr("splatgl.readers.ome_zarr.WHOLE", 0)
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
    assert "3 of them there before" in capsys.readouterr().out
    assert main([*line, "--time", "0:6:2"]) == 2
    assert "expected a frame of this animation" in capsys.readouterr().err


def test_planes_are_played(tmp_path: Path) -> None:
    """A movie of one plane: a frame is the picture of its time, not the same one again."""
    discs = np.zeros((3, 40, 60), np.uint8)
    for n in range(3):
        discs[n, 10:30, 5 + 15 * n : 20 + 15 * n] = 200
    tifffile.imwrite(tmp_path / "a.tif", discs, imagej=True, metadata={"axes": "TYX"})
    points = ["--points", "0:0,200:0.9", "--colormap", "gray"]
    out = ["-o", str(tmp_path / "{frame}.npy"), "--quiet"]
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
