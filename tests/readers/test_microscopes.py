"""CZI, LIF, ND2 and OIB: files written after the formats' descriptions, beside their libraries' own reading."""

from __future__ import annotations

import gzip
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from splatgl.cli.main import main
from splatgl.data.color import luma
from splatgl.data.volume import Volume
from splatgl.errors import InputError, MissingOption
from splatgl.readers import list_volumes, load, microscopes
from splatgl.readers.chunked import Chunked
from splatgl.readers.common import is_mapped
from tests.helpers import microscope_files as files
from tests.helpers.microscope_files import COLORS, NAMES, SPACING, STACK, STEP

ZEISS = Path(files.__file__).with_name("zeiss.czi.gz")
SECOND = STACK[:, :, :2] + 1


def check(path: Path, stack: np.ndarray, y: float = SPACING[1], colors: tuple[str | None, ...] = COLORS) -> None:
    """The volume of a file is a stack of both channels, at every time."""
    for time in range(len(stack)):
        volume = load(path, time=time, channel="all")
        for number, channel in enumerate(volume.channels):
            np.testing.assert_array_equal(np.asarray(channel.samples), stack[time, number])
            assert (channel.name, channel.hints.color) == (NAMES[number], colors[number])
    np.testing.assert_allclose(volume.spacing, (SPACING[0], y, SPACING[2]))
    assert (volume.unit, volume.times, len(volume.channels)) == ("um", len(stack), stack.shape[1])
    assert volume.time_step in (STEP, None) and volume.hints.stack
    np.testing.assert_array_equal(load(path, channel="GFP").samples, stack[0, 1])


# --- Zeiss -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("compression", [0, 4, 5, 6], ids=["plain", "JPEG XR", "Zstandard", "split Zstandard"])
def test_czi(tmp_path: Path, compression: int) -> None:
    if compression:
        pytest.importorskip("imagecodecs")
    path = files.czi(tmp_path / "a.czi", (STACK, SECOND), compression, pyramid=True)
    check(path, STACK)
    volume = load(path)
    assert volume.time_step == STEP and volume.channels[1].hints.window == pytest.approx((655.35, 3276.75))
    assert "image 1 well 0 7×5×3×2×2 of 2 is read" in volume.notes[0] and "--series N picks another" in volume.notes[0]
    np.testing.assert_array_equal(load(path, series="well 1", channel=1).samples, SECOND[0, 1])
    assert list_volumes(path) == ["* 1   well 0 7×5×3×2×2", "  2   well 1 7×5×2×2×2"]


def test_czi_of_its_own_library(tmp_path: Path) -> None:
    """A file that pylibCZIrw 6.1 wrote: scenes of two tiles a plane, split Zstandard."""
    pytest.importorskip("imagecodecs")
    (tmp_path / "a.czi").write_bytes(gzip.decompress(ZEISS.read_bytes()))
    check(tmp_path / "a.czi", STACK[:, :, :2])
    np.testing.assert_array_equal(load(tmp_path / "a.czi", series=2, channel=0).samples, SECOND[0, 0])


def test_czi_beside_czifile(tmp_path: Path) -> None:
    czifile = pytest.importorskip("czifile")
    path = files.czi(tmp_path / "a.czi")
    with czifile.CziFile(path) as file:
        assert file.axes == "STCZYX0"
        np.testing.assert_array_equal(file.asarray()[0, ..., 0], STACK)


def test_colors_and_gaps_of_czi(tmp_path: Path) -> None:
    rgb = np.random.default_rng(1).integers(0, 255, (1, 1, 3, 5, 7, 3)).astype(np.uint8)
    volume = load(files.czi(tmp_path / "a.czi", (rgb,)))
    np.testing.assert_array_equal(volume.color, rgb[0, 0])
    np.testing.assert_array_equal(load(tmp_path / "a.czi", channel=2).samples, rgb[0, 0, ..., 2])
    # transparent voxels are
    rgba = np.concatenate([rgb, rgb[..., :1]], axis=-1)
    volume = load(files.czi(tmp_path / "c.czi", (rgba,)))
    np.testing.assert_array_equal(volume.color, rgb[0, 0])
    np.testing.assert_array_equal(volume.samples, luma(rgba[0, 0]))
    assert (volume.samples < luma(rgb[0, 0])).any()
    # a plane that the directory does not list
    data = files.czi(tmp_path / "b.czi").read_bytes()
    at = data.index(b"ZISRAWDIRECTORY") + 32
    count = int.from_bytes(data[at : at + 4], "little")
    (tmp_path / "b.czi").write_bytes(data[:at] + (count - 2).to_bytes(4, "little") + data[at + 4 :])
    gap = load(tmp_path / "b.czi", time=1, channel="GFP")
    assert "1 planes are missing in the file, and are rendered as 0" in gap.notes
    np.testing.assert_array_equal(gap.samples, STACK[1, 1] * np.array([1, 1, 0], np.uint16)[:, None, None])


# --- Leica -----------------------------------------------------------------------------------------------------------


def test_lif(tmp_path: Path) -> None:
    liffile = pytest.importorskip("liffile")
    path = files.lif(tmp_path / "a.lif", {"small": SECOND[:1], "large": STACK})
    check(path, STACK)
    volume = load(path)
    assert is_mapped(volume.samples) and volume.time_step == STEP and "image 2 large" in volume.notes[0]
    np.testing.assert_array_equal(load(path, series="small", channel=0).samples, SECOND[0, 0])
    assert list_volumes(path) == ["  1   small 7×5×2×2", "* 2   large 7×5×3×2×2"]
    with liffile.LifFile(path) as file:
        image = file.images["large"]
        order = [image.dims.index(axis) for axis in "TCZYX"]
        np.testing.assert_array_equal(image.asarray().transpose(order), STACK)
        step = {axis: np.diff(image.coords[axis])[0] for axis in "XYZT"}
    np.testing.assert_allclose([step[axis] * 1e6 for axis in "XYZ"], volume.spacing)
    assert step["T"] == pytest.approx(volume.time_step)


# --- Nikon -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("lossless", [False, True])
def test_nd2(tmp_path: Path, lossless: bool) -> None:
    library = pytest.importorskip("nd2")
    path = files.nd2(tmp_path / "a.nd2", (STACK, STACK + 1), lossless)
    check(path, STACK, y=SPACING[0])
    np.testing.assert_array_equal(load(path, series="well 1", time=1, channel=1).samples, STACK[1, 1] + 1)
    assert list_volumes(path) == ["* 1   well 0 7×5×2×3×2", "  2   well 1 7×5×2×3×2"]
    with library.ND2File(path) as file:
        assert dict(file.sizes) == {"T": 2, "P": 2, "Z": 3, "C": 2, "Y": 5, "X": 7}
        np.testing.assert_array_equal(file.asarray().transpose(1, 0, 3, 2, 4, 5), [STACK, STACK + 1])
        assert tuple(file.voxel_size()) == (SPACING[0], SPACING[0], SPACING[2])


# --- Olympus ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("ending", ["oib", "oif"])
def test_oib(tmp_path: Path, ending: str) -> None:
    oiffile = pytest.importorskip("oiffile")
    path = files.oib(tmp_path / f"a.{ending}")
    check(path, STACK, colors=(None, None))
    with pytest.raises(MissingOption, match="got 2 channels"):
        load(path)
    with closing(oiffile.OifFile(path)) as file:
        np.testing.assert_array_equal(file.asarray(0).reshape(2, 3, 2, 5, 7).transpose(2, 0, 1, 3, 4), STACK)
        assert (file.axes, file.shape) == ("TZCYX", (2, 3, 2, 5, 7))


def test_other_compound_files_are_not_called_damaged(tmp_path: Path) -> None:
    pytest.importorskip("oiffile")
    (tmp_path / "a.oib").write_bytes(files.compound({"Workbook": bytes(5000)}, "VBA", {"Stream": b"x"}))
    with pytest.raises(InputError, match=r"a\.oib: file: expected OibInfo.txt in it, got another compound file"):
        load(tmp_path / "a.oib")


def test_chains_of_an_oib_that_never_end(tmp_path: Path) -> None:
    pytest.importorskip("oiffile")
    data = bytearray(files.oib(tmp_path / "a.oib").read_bytes())
    place = 512 * (int.from_bytes(data[76:80], "little") + 1)
    data[place : place + 4] = bytes(4)
    (tmp_path / "a.oib").write_bytes(data)
    with pytest.raises(InputError, match=r"chains that end|takes too long"):
        load(tmp_path / "a.oib")


# --- all -------------------------------------------------------------------------------------------------------------

WRITERS: dict[str, Callable[[Path], Path]] = {
    "czi": files.czi,
    "lif": lambda path: files.lif(path, {"a": STACK}),
    "nd2": files.nd2,
    "oib": files.oib,
}
LIBRARIES = {"lif": "liffile", "nd2": "nd2", "oib": "oiffile"}


@pytest.mark.parametrize("ending", WRITERS)
def test_large_images_are_read_in_parts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, ending: str) -> None:
    if ending in LIBRARIES:
        pytest.importorskip(LIBRARIES[ending])
    path = WRITERS[ending](tmp_path / f"a.{ending}")
    monkeypatch.setattr(microscopes, "WHOLE_BYTES", 100)
    samples = load(path, channel="GFP", time=1).samples
    assert isinstance(samples, Chunked) if ending != "lif" else is_mapped(samples)
    np.testing.assert_array_equal(samples[1:, 2:4, ::2], STACK[1, 1, 1:, 2:4, ::2])


@pytest.mark.parametrize("ending", WRITERS)
def test_what_a_file_lacks_is_refused(tmp_path: Path, ending: str, capsys: pytest.CaptureFixture[str]) -> None:
    if ending in LIBRARIES:
        pytest.importorskip(LIBRARIES[ending])
    path = WRITERS[ending](tmp_path / f"a.{ending}")
    for given, said in (
        ({"time": 2}, "time: expected a number from 0 to 1, got 2"),
        ({"channel": "RFP"}, "channel: expected a number from 0 to 1, or one of DAPI, GFP, got 'RFP'"),
        ({"series": 3}, "series: expected one of 1 "),
        ({"array": 1}, "array: expected an axis beside time, channels and space"),
        ({"level": 0}, "options: expected some of"),
    ):
        with pytest.raises(InputError, match=said):
            load(path, **{"channel": 0, **given})
    path.write_bytes(path.read_bytes()[:300])
    assert main(["info", str(path)]) == 2
    assert capsys.readouterr().err.count("\n") == 1


@pytest.mark.parametrize("ending", WRITERS)
def test_contents_tell_the_format(tmp_path: Path, ending: str) -> None:
    if ending in LIBRARIES:
        pytest.importorskip(LIBRARIES[ending])
    for name in ("scan", "scan.tif"):
        path = WRITERS[ending](tmp_path / f"a.{ending}").rename(tmp_path / name)
        volume = load(path, channel=1)
        np.testing.assert_array_equal(volume.samples, STACK[0, 1])
        assert any("not what its name says" in note for note in volume.notes) == (name == "scan.tif")


def test_a_plane_is_as_thick_as_a_pixel(tmp_path: Path) -> None:
    volume: Volume = load(files.czi(tmp_path / "a.czi", (STACK[:1, :, :1, :, :],)))
    assert volume.shape == (1, 5, 7) and volume.times == 1
    loaded: Any = np.asarray(volume.samples)
    np.testing.assert_array_equal(loaded, STACK[0, 0, :1])
