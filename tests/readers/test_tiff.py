"""Images of TIFF files: several in one, packed and compressed samples, GeoTIFF's grid and holes, planes or terrains."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

import splatgl as sg
from splatgl.cli.main import main
from splatgl.errors import InputError
from splatgl.readers import load

tifffile = pytest.importorskip("tifffile")

RNG = np.random.default_rng(7)
STACK = RNG.integers(0, 4000, (12, 32, 40)).astype(np.uint16)
GREY: dict[str, Any] = {"photometric": "minisblack"}


def several(path: Path) -> Path:
    """An overview in colours, the stack, and one of three planes at another scale; all in OME's metadata."""
    steps = {"PhysicalSizeX": 0.5, "PhysicalSizeY": 0.5, "PhysicalSizeZ": 2.0}
    with tifffile.TiffWriter(path) as file:
        file.write(np.zeros((640, 480, 3), np.uint8), photometric="rgb", metadata={"Name": "macro", "axes": "YXS"})
        file.write(STACK, metadata={"Name": "cells", "axes": "ZYX", **steps}, **GREY)
        file.write(STACK[:3], metadata={"Name": "ref", "axes": "ZYX", **dict.fromkeys(steps, 3.0)}, **GREY)
    return path


def test_the_stack_of_an_ome_tiff_is_read_and_others_can_be(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = several(tmp_path / "a.ome.tif")
    volume = load(path)
    assert np.array_equal(volume.samples, STACK) and volume.spacing == (0.5, 0.5, 2)
    told = "image 2 cells 40×32×12 of 3 is read, the largest stack; --series N picks another: "
    assert volume.notes == (told + "1 macro 480×640, 3 ref 40×32×3",)
    for series in (3, "3", "ref"):
        other = load(path, series=series)
        assert np.array_equal(other.samples, STACK[:3]) and other.spacing == (3, 3, 3) and not other.notes
    overview = load(path, series="macro")
    assert overview.shape == (1, 640, 480) and overview.color is not None
    with pytest.raises(InputError, match=r"series: expected one of 1 macro .*, 3 ref .*, got '4'"):
        load(path, series=4)
    assert main(["info", str(path)]) == 0
    listed = capsys.readouterr().out.splitlines()[:3]
    assert [line[:11] for line in listed] == ["  1   macro", "* 2   cells", "  3   ref 4"]


def test_pages_of_other_sizes_are_another_image(tmp_path: Path) -> None:
    with tifffile.TiffWriter(tmp_path / "a.tif") as file:
        file.write(np.zeros((64, 48), np.uint8), metadata=None, **GREY)
        for plane in STACK:
            file.write(plane, metadata=None, **GREY)
    volume = load(tmp_path / "a.tif")
    assert np.array_equal(volume.samples, STACK) and "1 48×64" in volume.notes[0]


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"array": 2}, "array: expected an axis beside z, y, x and channels"),
        ({"channel": 1}, "channel: expected a file of channels, got 1"),
        ({"time": 1}, "time: expected a file of several time points, got 1"),
        ({"relief": 2.0}, "relief: expected a single picture of heights, got 12 planes"),
        ({"values": "heights"}, "values: expected a single picture of heights, got 12 planes"),
        ({"color": "a.png"}, "color: expected a single picture of heights"),
        ({"series": "x"}, "series: expected one of 1 40×32×12, got 'x'"),
    ],
)
def test_no_option_is_ignored(tmp_path: Path, options: dict[str, Any], said: str) -> None:
    tifffile.imwrite(tmp_path / "a.tif", STACK, metadata=None, **GREY)
    with pytest.raises(InputError, match=said):
        load(tmp_path / "a.tif", **options)
    assert load(tmp_path / "a.tif", array=0, channel=0, series=1).shape == STACK.shape


# --- samples ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("bits", [1, 2, 4, 10, 12, 14])
def test_packed_samples(tmp_path: Path, bits: int) -> None:
    """They take fewer bytes than in memory, which is no damage; of a file that is cut it is told."""
    samples = (STACK % 2**bits).astype(np.uint16 if bits > 8 else np.uint8)[:, :, :37]
    stored = samples > 0 if bits == 1 else samples
    options = {} if bits == 1 else {"bitspersample": bits}
    tifffile.imwrite(tmp_path / "a.tif", stored, metadata=None, **GREY, **options)
    assert np.array_equal(load(tmp_path / "a.tif").samples, stored)
    whole = (tmp_path / "a.tif").read_bytes()
    (tmp_path / "a.tif").write_bytes(whole[:-200])
    with pytest.raises(InputError, match=r"cut short|damaged"):
        load(tmp_path / "a.tif")


def test_jpeg_and_jpeg_2000(tmp_path: Path) -> None:
    pytest.importorskip("imagecodecs")
    z, y, x = np.indices((6, 64, 64))
    ball = 4000 * np.exp(-(((x - 32) / 14) ** 2 + ((y - 28) / 12) ** 2 + ((z - 3) / 2) ** 2))
    told = {"axes": "ZYX", "PhysicalSizeX": 0.25, "PhysicalSizeY": 0.25, "PhysicalSizeZ": 1.0}
    for name, samples in (("jpeg2000", ball.astype(np.uint16)), ("jpeg", (ball / 16).astype(np.uint8))):
        path = tmp_path / f"{name}.ome.tif"
        tifffile.imwrite(path, samples, compression=name, tile=(64, 64), metadata=told)
        volume = load(path)
        assert volume.spacing == (0.25, 0.25, 1.0)
        assert np.abs(volume.samples.astype(float) - samples).max() <= (0 if name == "jpeg2000" else 12)
        assert np.array_equal(volume.samples, tifffile.imread(path))


def test_a_picture_in_a_strip_may_not_be_larger_than_that(tmp_path: Path) -> None:
    """Decoders allocate what it states."""
    pytest.importorskip("imagecodecs")
    path = tmp_path / "a.tif"
    tifffile.imwrite(path, STACK[:2, :32, :32].astype(np.uint8), compression="jpeg", tile=(32, 32), metadata=None)
    data = bytearray(path.read_bytes())
    at = data.index(b"\xff\xc0")
    assert struct.unpack_from(">HH", data, at + 5) == (32, 32)
    struct.pack_into(">HH", data, at + 5, 60000, 60000)
    path.write_bytes(data)
    with pytest.raises(InputError, match="compressed picture: expected 32 × 32 pixels at most, got 60000 × 60000"):
        load(path)


def test_other_compressions_name_what_converts_them(tmp_path: Path) -> None:
    tifffile.imwrite(tmp_path / "a.tif", STACK)
    with tifffile.TiffFile(tmp_path / "a.tif", mode="r+b") as file:
        for page in file.pages:
            page.tags["Compression"].overwrite(34676)
    with pytest.raises(InputError, match=r"compression: .* got SGILOG; convert it with: tiffcp -c zip OLD NEW"):
        load(tmp_path / "a.tif")


def test_black_on_white_is_told(tmp_path: Path) -> None:
    tifffile.imwrite(tmp_path / "a.tif", STACK, photometric="miniswhite", metadata=None)
    assert "0 as white" in load(tmp_path / "a.tif").notes[0]


# --- heights ---------------------------------------------------------------------------------------------------------

Y, X = np.indices((64, 80))
HEIGHTS = (685 + 1300 * np.exp(-(((X - 45) / 14) ** 2 + ((Y - 35) / 12) ** 2))).astype(np.float32)


def geo(missing: str = "", geographic: bool = False, unit: int = 9001, step: float = 30.0) -> list[Any]:
    keys = (1, 1, 0, 3, 1024, 0, 1, 2 if geographic else 1, 1025, 0, 1, 1, 3076, 0, 1, unit)
    corner = (10.0, 47.0) if geographic else (5e5, 5.2e6)
    tags = [
        (33550, 12, 3, (step, step, 0.0), True),
        (33922, 12, 6, (0.0, 0.0, 0.0, *corner, 0.0), True),
        (34735, 3, len(keys), keys, True),
    ]
    return [*tags, (42113, 2, len(missing) + 1, missing, True)] if missing else tags


def columns(volume: sg.Volume) -> np.ndarray:
    """Solid voxels up to the top of each column, row 0 in the north; 0 of holes."""
    solid = volume.samples > 0
    depth = len(solid)
    return np.where(solid.any(axis=0), depth - np.argmax(solid[::-1], axis=0), 0)[::-1]


@pytest.mark.parametrize("dtype", ["float32", "int16", "float64"])
@pytest.mark.parametrize("missing", ["-9999", "-32768", "-3.4028234663852886e+38", "0", "nan"])
def test_no_data_of_geotiff_is_no_ground(tmp_path: Path, dtype: str, missing: str) -> None:
    if dtype == "int16" and missing in ("nan", "-3.4028234663852886e+38"):
        pytest.skip("no number of that type")
    heights = HEIGHTS.astype(dtype)
    heights[:10, :12] = float(missing)
    tifffile.imwrite(tmp_path / "a.tif", heights, extratags=geo(missing), metadata=None)
    volume = load(tmp_path / "a.tif")
    tops = columns(volume)
    assert (tops == 0).sum() == 120 and (tops[:10, :12] == 0).all()
    assert tops[tops > 0].min() == 1 and tops.max() == 103
    relief = float(np.ptp(heights[10:].astype(float)))
    assert volume.spacing == pytest.approx((30, 30, relief / 102)) and volume.unit == "m"
    assert missing == "nan" or "120 of 5,120 heights are no data" in volume.notes[0]


def test_units_of_geotiff(tmp_path: Path) -> None:
    tifffile.imwrite(tmp_path / "a.tif", HEIGHTS, extratags=geo(unit=9002, step=100.0), metadata=None)
    assert load(tmp_path / "a.tif").spacing[:2] == pytest.approx((30.48, 30.48))
    tifffile.imwrite(tmp_path / "b.tif", HEIGHTS, extratags=geo(geographic=True, step=1 / 1200), metadata=None)
    volume = load(tmp_path / "b.tif")
    metres = 6371000 * np.pi / 180 / 1200
    middle = 47 - 32 / 1200
    assert volume.spacing[:2] == pytest.approx((metres * np.cos(np.radians(middle)), metres))
    assert volume.notes == ("degrees are converted to metres at latitude 46.97°",)
    assert load(tmp_path / "a.tif", relief=500.0).spacing[2] == pytest.approx(500 / 102)
    with pytest.raises(InputError, match="relief: expected no value beside spacing"):
        load(tmp_path / "a.tif", relief=500.0, spacing=(1, 1, 1))


def test_scale_and_offset_of_gdal(tmp_path: Path) -> None:
    items = '<Item sample="0" role="scale">0.1</Item><Item sample="0" role="unittype">ft</Item>'
    text = f"<GDALMetadata>{items}</GDALMetadata>"
    tags = [*geo("-1"), (42112, 2, len(text) + 1, text, True)]
    heights = (HEIGHTS * 10).astype(np.int16)
    tifffile.imwrite(tmp_path / "a.tif", heights, extratags=tags, metadata=None)
    assert load(tmp_path / "a.tif").spacing[2] * 102 == pytest.approx(np.ptp(heights) * 0.1 * 0.3048)


@pytest.mark.parametrize("missing", [-9999.0, -32768.0, -3.4028235e38, 9.96921e36])
def test_customary_numbers_are_no_ground(tmp_path: Path, missing: float) -> None:
    """In TIFF and CSV without a tag; a depth of 9999 m among others is one."""
    heights = HEIGHTS.copy()
    heights[:10, :12] = missing
    tifffile.imwrite(tmp_path / "dem.tif", heights, metadata=None)
    np.savetxt(tmp_path / "a.csv", heights[::-1], delimiter=",", fmt="%.9g")
    for name in ("dem.tif", "a.csv"):
        volume = load(tmp_path / name)
        assert (columns(volume) == 0).sum() == 120 and columns(volume).max() == 103
        assert any("120 of 5,120 heights are" in note for note in volume.notes)
    sea = np.linspace(-9999, 3000, 5120).reshape(64, 80).astype(np.float32)
    tifffile.imwrite(tmp_path / "bathy.tif", sea, metadata=None)
    assert (columns(load(tmp_path / "bathy.tif")) > 0).all()


def test_empty_cells_of_a_table_are_holes(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("0,,1\n2,NA,3\n\n")
    assert (columns(load(tmp_path / "a.csv")) == 0).tolist() == [[False, True, False]] * 2
    (tmp_path / "a.csv").write_text("0,1\n2,x\n")
    with pytest.raises(InputError, match="table: expected heights, a row in each line, got 'x'"):
        load(tmp_path / "a.csv")


def test_no_data_of_a_stack_is_empty(tmp_path: Path) -> None:
    samples = STACK.astype(np.int16)
    samples[:, :4] = -9999
    tifffile.imwrite(tmp_path / "a.tif", samples, extratags=geo("-9999"), metadata=None)
    volume = load(tmp_path / "a.tif")
    assert np.isnan(volume.samples[:, :4]).all() and np.array_equal(volume.samples[:, 4:], samples[:, 4:])
    assert volume.spacing == (30, 30, 30)


# --- planes or terrains ----------------------------------------------------------------------------------------------


def cells() -> np.ndarray:
    """A camera's picture: an offset with noise, and some bright cells."""
    picture = RNG.normal(110, 6, (64, 80))
    for y, x in RNG.uniform(10, 54, (5, 2)):
        picture += 900 * np.exp(-(((X - x) ** 2 + (Y - y) ** 2) / 12))
    return picture.astype(np.uint16)


def test_a_microscopes_plane_is_no_terrain(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """By its metadata, its name or its dark noise; what is chosen is told, and an option chooses otherwise."""
    picture, smooth = cells(), np.rint(HEIGHTS).astype(np.uint16)
    steps = {"PhysicalSizeX": 0.2, "PhysicalSizeY": 0.2}
    tifffile.imwrite(tmp_path / "a.ome.tif", smooth, metadata={"axes": "YX", **steps}, **GREY)
    tifffile.imwrite(tmp_path / "b.tif", smooth, imagej=True, resolution=(5, 5), metadata={"unit": "um"})
    for name in ("a.ome.tif", "b.tif"):
        volume = load(tmp_path / name)
        assert volume.spacing[:2] == pytest.approx((0.2, 0.2)) and volume.unit == "um"
        assert np.array_equal(volume.samples, smooth[None]) and volume.hints.stack
    for name in ("c.tif", "c.png", "dapi.png", "x-GFP_2.tif"):
        pixels = picture if name[0] == "c" else smooth
        if name.endswith("tif"):
            tifffile.imwrite(tmp_path / name, pixels, metadata=None, **GREY)
        else:
            Image.fromarray(pixels).save(tmp_path / name)
        volume = load(tmp_path / name)
        assert np.array_equal(volume.samples, pixels[None])
        assert volume.notes == ("a single picture is rendered as a plane; --values heights renders it as a terrain",)
        assert load(tmp_path / name, values="heights").shape == (103, 64, 80)
    assert main(["info", str(tmp_path / "c.tif")]) == 0
    assert "--values heights" in capsys.readouterr().err


def test_a_map_of_heights_is_a_terrain(tmp_path: Path) -> None:
    smooth = np.rint(HEIGHTS).astype(np.uint16)
    coast = np.where(HEIGHTS > 900, HEIGHTS, 0).astype(np.uint8)
    for name, pixels in (("a.png", smooth), ("b.png", coast), ("dem.png", cells()), ("c.tif", smooth)):
        if name.endswith("tif"):
            tifffile.imwrite(tmp_path / name, pixels, metadata=None, **GREY)
        else:
            Image.fromarray(pixels).save(tmp_path / name)
        volume = load(tmp_path / name)
        told = "a single picture is rendered as a terrain; --values amounts renders it as a plane"
        assert volume.shape == (103, 64, 80) and volume.notes == (told,)
        assert np.array_equal(load(tmp_path / name, values="amounts").samples, pixels[None])
        assert load(tmp_path / name, values="labels").labels == ()
        assert not load(tmp_path / name, relief=20.0).notes
    tifffile.imwrite(tmp_path / "dem.tif", smooth, imagej=True)
    assert load(tmp_path / "dem.tif").shape == (103, 64, 80)
    np.save(tmp_path / "a.npy", STACK)
    with pytest.raises(InputError, match="values: expected labels or amounts for NumPy, got heights"):
        load(tmp_path / "a.npy", values="heights")


# --- folders of slices -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("kind", "top"), [("tif", 1000), ("png", 1000), ("bmp", 20)])
def test_a_folder_of_slices(tmp_path: Path, kind: str, top: int) -> None:
    """In the order of the numbers in their names, without leading zeros; 16 bits stay."""
    dtype = np.uint8 if kind == "bmp" else np.uint16
    inside = STACK > 2000
    for n, plane in enumerate(inside, 1):
        pixels = np.where(plane, top * n, 0).astype(dtype)
        if kind == "tif":
            tifffile.imwrite(tmp_path / f"scan_{n}.tif", pixels, metadata=None)
        else:
            Image.fromarray(pixels).save(tmp_path / f"scan_{n}.{kind}")
    (tmp_path / "scan.log").write_text("x")
    volume = load(tmp_path, spacing=(9.5, 9.5, 9.5))
    assert volume.shape == STACK.shape and volume.samples.dtype == dtype and volume.spacing == (9.5, 9.5, 9.5)
    assert np.array_equal(volume.samples, inside * (np.arange(1, 13) * top)[:, None, None])
    assert "12 slices, from scan_1" in volume.notes[0] and volume.notes[1] == "1 other file is left out"
    Image.fromarray(np.zeros((9, 9), dtype)).save(tmp_path / f"scan_99.{kind}")
    with pytest.raises(InputError, match=rf"scan_99.{kind}: expected 40×32 uint.*, as scan_1.{kind}, got 9×9"):
        load(tmp_path)
    with pytest.raises(InputError, match=r"options: expected some of .* for picture slices, got level"):
        load(tmp_path, level=1)


@pytest.mark.parametrize(("line", "dtype"), [((-32768.0, 1.0), np.int16), ((-1024.0, 2.5), np.float32)])
def test_imagej_calibrates_values(tmp_path: Path, line: tuple[float, float], dtype: type) -> None:
    """Signed numbers, which ImageJ stores without a sign, and calibrated ones, in stacks, slices and single planes."""
    stored = np.random.default_rng(5).integers(30_000, 40_000, (4, 5, 6)).astype(np.uint16)
    right: np.ndarray = (line[0] + line[1] * stored).astype(dtype)
    text = "ImageJ=1.53t\nimages={0}\nslices={0}\nunit=mm\ncf=0\nc0={1}\nc1={2}\nvunit=HU\n"
    options = {"metadata": None, "photometric": "minisblack"}
    tifffile.imwrite(tmp_path / "a.tif", stored, description=text.format(4, *line), **options)
    (tmp_path / "slices").mkdir()
    for n, plane in enumerate(stored):
        tifffile.imwrite(tmp_path / f"slices/{n}.tif", plane, description=text.format(1, *line), **options)
    for name in ("a.tif", "slices"):
        volume = load(tmp_path / name)
        assert np.array_equal(volume.samples, right) and volume.samples.dtype == dtype
    assert load(tmp_path / "a.tif").value_unit == "HU"
    assert f"{line[0]:g} + {line[1]:g} × the stored" in load(tmp_path / "a.tif").notes[0]
    assert np.array_equal(load(tmp_path / "slices/2.tif").samples, right[2:3])


CURVES: dict[int, tuple[tuple[float, ...], Callable[[float], float]]] = {
    1: ((1, 2, 3), lambda x: 1 + 2 * x + 3 * x**2),
    3: ((1, 2, 3, 4e-3, 5e-5), lambda x: 1 + 2 * x + 3 * x**2 + 4e-3 * x**3 + 5e-5 * x**4),
    4: ((2, 0.01), lambda x: 2 * math.exp(0.01 * x)),
    5: ((2, 0.5), lambda x: 2 * math.sqrt(x)),
    6: ((2, 0.5), lambda x: 2 * math.log(0.5 * x) if x else -2000),
    7: ((9, 2, 50, 1), lambda x: 1 + 8 / (1 + (x / 50) ** 2)),
    8: ((5, 2, 1.5, 40), lambda x: 2 * (x - 5) ** 1.5 * math.exp(-(x - 5) / 40) if x > 5 else 0),
    9: ((1, 2, -3), lambda x: 1 + 2 * math.log(x + 3)),
    10: ((5, 2, 3, 200), lambda x: 3 * ((x - 5) / (200 - x)) ** 0.5 if 5 <= x < 200 else 0),
    11: ((2, 0.01, 7), lambda x: 2 * math.exp(-0.01 * x) + 7),
    12: ((1, 9, 100, 30), lambda x: 1 + 8 * math.exp(-((x - 100) ** 2) / 1800)),
    13: ((2, 0.01, 7), lambda x: 2 * (1 - math.exp(-0.01 * x)) + 7),
    21: ((), lambda x: math.log10(255 / (x or 0.5))),
}


@pytest.mark.parametrize("function", CURVES)
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_curved_calibrations_of_imagej(tmp_path: Path, function: int, dtype: type) -> None:
    """The formulas of ImageJ's documentation; numbers of other types are not calibrated."""
    stored: np.ndarray = np.arange(240).reshape(4, 5, 12).astype(dtype)
    coefficients, right = CURVES[function]
    text = f"ImageJ=1.53t\nimages=4\nslices=4\ncf={function}\nvunit=OD\n"
    text += "".join(f"c{n}={number}\n" for n, number in enumerate(coefficients))
    options = {"metadata": None, "photometric": "minisblack"}
    tifffile.imwrite(tmp_path / "a.tif", stored, description=text, **options)
    volume = load(tmp_path / "a.tif")
    expected = np.vectorize(right, otypes=[float])(stored.astype(float))
    np.testing.assert_allclose(volume.samples, expected, rtol=1e-6)
    assert volume.value_unit == "OD" and "ImageJ's function" in volume.notes[0]
    tifffile.imwrite(tmp_path / "a.tif", stored.astype(np.float32), description=text, **options)
    np.testing.assert_array_equal(load(tmp_path / "a.tif").samples, stored)


def test_values_below_zero_are_clipped_where_imagej_does(tmp_path: Path) -> None:
    text = "ImageJ=1.53t\nimages=2\nslices=2\ncf=0\nc0=-5\nc1=2\nvunit=OD\nzeroclip=true\n"
    stored = np.arange(8, dtype=np.uint8).reshape(2, 2, 2)
    tifffile.imwrite(tmp_path / "a.tif", stored, description=text, metadata=None, photometric="minisblack")
    np.testing.assert_array_equal(load(tmp_path / "a.tif").samples, np.maximum(2.0 * stored - 5, 0))


def test_complex_numbers_tables_of_colours_and_turned_rows(tmp_path: Path) -> None:
    """Magnitudes are drawn; a table of colours and an orientation, which are not applied, are told."""
    values = (np.arange(60).reshape(3, 4, 5) * (3 - 4j)).astype(np.complex64)
    (tmp_path / "slices").mkdir()
    tifffile.imwrite(tmp_path / "a.tif", values, photometric="minisblack")
    for n, plane in enumerate(values):
        tifffile.imwrite(tmp_path / f"slices/{n}.tif", plane, photometric="minisblack")
    for name in ("a.tif", "slices"):
        volume = load(tmp_path / name)
        np.testing.assert_allclose(volume.samples, np.abs(values), rtol=1e-6)
        assert "complex numbers are rendered by their magnitude" in volume.notes
    table = np.zeros((3, 256), np.uint16)
    options = {"photometric": "palette", "colormap": table, "extratags": [(274, "H", 1, 3, True)]}
    tifffile.imwrite(tmp_path / "b.tif", np.zeros((3, 4, 5), np.uint8), **options)
    notes = " ".join(load(tmp_path / "b.tif").notes)
    assert "the file's colour table" in notes and "orientation is not applied" in notes


@pytest.mark.parametrize(
    ("resolution", "kind", "more", "spacing"),
    [
        ((40000, 20000), "CENTIMETER", {}, (0.25, 0.5, 3)),
        ((4, 2), "NONE", {}, (0.25, 0.5, 3)),
        ((4, 0.002), "NONE", {"yunit": "nm", "zunit": "mm"}, (0.25, 0.5, 3000)),
    ],
)
def test_units_of_imagej(tmp_path: Path, resolution: Any, kind: str, more: dict[str, str], spacing: Any) -> None:
    """Micrometres beside pixels per centimetre, as other programs write them, and units of their own along y and z."""
    grid = {"axes": "ZYX", "unit": "um", "spacing": 3.0, **more}
    options: dict[str, Any] = {"resolution": resolution, "resolutionunit": kind, "metadata": grid}
    tifffile.imwrite(tmp_path / "a.tif", STACK, imagej=True, **options)
    volume = load(tmp_path / "a.tif")
    assert volume.spacing == pytest.approx(spacing) and volume.unit == "um"


def test_spacing_of_a_plain_stack_by_its_resolution(tmp_path: Path) -> None:
    for name, per_inch, spacing, unit in (("a", (1270, 635), (20, 40, 20), "um"), ("b", (72, 72), (1, 1, 1), "")):
        options = {"resolution": per_inch, "resolutionunit": "INCH", "photometric": "minisblack"}
        tifffile.imwrite(tmp_path / f"{name}.tif", np.zeros((4, 5, 6), np.uint8), **options)
        volume = load(tmp_path / f"{name}.tif")
        assert volume.spacing == pytest.approx(spacing) and volume.unit == unit
        assert ("by the tags of resolution" in "".join(volume.notes)) == bool(unit)


def planes_in_files(folder: Path, name: str = "t{}_c{}.ome.tif") -> np.ndarray:
    """An OME-TIFF of times, channels and planes [2, 2, 3, 5, 6], a file of planes for each time and channel."""
    stack = np.random.default_rng(6).integers(0, 60_000, (2, 2, 3, 5, 6)).astype(np.uint16)
    runs = "".join(
        f'<TiffData FirstT="{t}" FirstC="{c}" FirstZ="0" IFD="0" PlaneCount="3"><UUID FileName="{name.format(t, c)}">'
        f"urn:uuid:{t}{c}</UUID></TiffData>"
        for t, c in np.ndindex(2, 2)
    )
    sizes = (
        'SizeX="6" SizeY="5" SizeZ="3" SizeC="2" SizeT="2" PhysicalSizeX="0.5" PhysicalSizeY="0.5" PhysicalSizeZ="2"'
    )
    channels = '<Channel ID="Channel:0:0" Name="DAPI"/><Channel ID="Channel:0:1" Name="GFP"/>'
    xml = (
        '<?xml version="1.0"?><OME xmlns="http://www.openmicroscopy.org/Schemas/OME/2016-06"><Image ID="Image:0">'
        f'<Pixels ID="Pixels:0" DimensionOrder="XYZCT" Type="uint16" {sizes}>{channels}{runs}</Pixels></Image></OME>'
    )
    for t, c in np.ndindex(2, 2):
        path = folder / Path(name.format(t, c)).name
        options = {"description": xml, "metadata": None, "photometric": "minisblack"}
        tifffile.imwrite(path, stack[t, c], byteorder=">" if c else "<", compression="zlib", **options)
    return stack


def test_ome_in_several_files(tmp_path: Path) -> None:
    """Every file opens the whole; tifffile reads the same; planes of a file that is gone are 0 and told."""
    stack = planes_in_files(tmp_path)
    assert np.array_equal(tifffile.imread(tmp_path / "t0_c0.ome.tif").reshape(stack.shape), stack)
    for name in ("t0_c0.ome.tif", "t1_c1.ome.tif"):
        volume = load(tmp_path / name, channel="GFP", time=1)
        assert np.array_equal(volume.samples, stack[1, 1]) and volume.times == 2
        assert volume.spacing == (0.5, 0.5, 2) and volume.unit == "um"
    (tmp_path / "t1_c0.ome.tif").unlink()
    volume = load(tmp_path / "t0_c0.ome.tif", channel="all", time=1)
    assert not np.asarray(volume.channels[0].samples).any()
    assert np.array_equal(volume.channels[1].samples, stack[1, 1])
    assert "3 planes are missing, and are rendered as 0" in volume.notes


def test_ome_names_files_of_its_folder_only(tmp_path: Path) -> None:
    stack = planes_in_files(tmp_path, "../t{}_c{}.ome.tif")
    volume = load(tmp_path / "t0_c1.ome.tif")
    assert np.array_equal(volume.samples, stack[0, 1]) and "only this one's pages" in volume.notes[0]


@pytest.mark.parametrize("way", ["contig", "separate"])
def test_a_band_of_a_survey(tmp_path: Path, way: str) -> None:
    """A second band, such as a mask, makes no stack of two planes; five bands in planes of their own are layers."""
    heights = np.add.outer(np.arange(8.0), np.arange(9.0)).astype(np.float32)
    bands = np.stack([heights, heights[::-1], *[heights] * 3], 0 if way == "separate" else -1)
    tags = [(33550, 12, 3, (30.0, 30.0, 0.0), True), (34735, 3, 4, (1, 1, 0, 0), True)]
    options = {"extratags": tags, "photometric": "minisblack", "planarconfig": way, "metadata": None}
    two = bands[:2] if way == "separate" else bands[..., :2]
    tifffile.imwrite(tmp_path / "a.tif", two, **options)
    tifffile.imwrite(tmp_path / "b.tif", heights[::-1], **{**options, "planarconfig": None})
    volume = load(tmp_path / "a.tif", channel=1)
    assert np.array_equal(volume.samples, load(tmp_path / "b.tif").samples) and volume.shape[0] == 103
    assert "band 1 of 2 is read: --channel picks another" in volume.notes
    assert not np.array_equal(load(tmp_path / "a.tif").samples, volume.samples)
    if way == "separate":
        tifffile.imwrite(tmp_path / "c.tif", bands, **options)
        assert load(tmp_path / "c.tif").shape == (5, 8, 9)


def test_rows_of_a_survey_that_run_north(tmp_path: Path) -> None:
    """The matrix of GeoTIFF tells which row is the northern one, at the far side."""
    heights = np.add.outer(np.arange(8.0), np.zeros(9)).astype(np.float32)
    for name, down, rows in (("a", -30.0, heights), ("b", 30.0, heights[::-1])):
        matrix = (30.0, 0, 0, 5e5, 0, down, 0, 5.2e6, 0, 0, 0, 0, 0, 0, 0, 1.0)
        tags = [(34264, 12, 16, matrix, True), (34735, 3, 4, (1, 1, 0, 0), True)]
        tifffile.imwrite(tmp_path / f"{name}.tif", rows, extratags=tags, photometric="minisblack", metadata=None)
    north, south = load(tmp_path / "a.tif"), load(tmp_path / "b.tif")
    assert (
        np.array_equal(north.samples, south.samples) and north.samples[-1, 0].any() and not north.samples[-1, -1].any()
    )
