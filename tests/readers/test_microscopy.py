"""TIFF and Zarr, plain and with OME's metadata: the phantom written and read back, mapped where it can be."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from splatgl.errors import InputError
from splatgl.readers import load, tiff
from splatgl.readers.chunked import Chunked
from splatgl.readers.common import is_mapped
from tests.helpers.phantom import SPACING, F, check

# --- TIFF ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("compression", [None, "zlib"])
@pytest.mark.parametrize("byteorder", ["<", ">"])
def test_tiff_ignores_resolution_tags_without_metadata(tmp_path: Path, compression: str | None, byteorder: str) -> None:
    tifffile = pytest.importorskip("tifffile")
    options = {"photometric": "minisblack", "resolution": (72, 72), "metadata": None, "byteorder": byteorder}
    tifffile.imwrite(tmp_path / "letter.tif", F.astype(np.uint16), compression=compression, **options)
    check(load(tmp_path / "letter.tif"), grid=False, frame=None, mapped=compression is None)


def test_tiff_imagej(tmp_path: Path) -> None:
    tifffile = pytest.importorskip("tifffile")
    metadata = {"spacing": 3.0, "unit": "micron", "axes": "ZYX"}
    resolution = (1 / SPACING[0], 1 / SPACING[1])
    tifffile.imwrite(tmp_path / "letter.tif", F, imagej=True, resolution=resolution, metadata=metadata)
    volume = load(tmp_path / "letter.tif")
    np.testing.assert_array_equal(volume.samples, F)
    np.testing.assert_allclose(volume.spacing, SPACING, rtol=1e-6)
    assert volume.unit == "um" and is_mapped(volume.samples)


@pytest.mark.parametrize(
    ("places", "stated", "step", "told"),
    [
        ([10, 12.5, 15], None, 2.5, ""),
        ([10, 12.5, 15], 2.5, 2.5, ""),
        ([15, 12.5, 10], None, 2.5, "descend by their positions"),
        ([10, 12, 15], 2, 2, "2 to 3 um apart by their positions, and are rendered evenly"),
        ([10, 12.5, 15], 4, 4, "2.5 um apart by their positions, but rendered 4 um apart"),
        ([10, 10, 10], 4, 4, ""),
    ],
)
def test_positions_of_planes(tmp_path: Path, places: list[float], stated: float | None, step: float, told: str) -> None:
    """They are the spacing where the file states no other; what isn't drawn of them is told."""
    tifffile = pytest.importorskip("tifffile")
    planes = {"PositionZ": places, "PositionZUnit": ["µm"] * 3}
    sizes = {"PhysicalSizeX": 0.5, "PhysicalSizeY": 0.5} | ({} if stated is None else {"PhysicalSizeZ": stated})
    metadata = {"axes": "ZYX", "Plane": planes, **sizes}
    tifffile.imwrite(tmp_path / "a.ome.tif", np.zeros((3, 8, 9), np.uint8), metadata=metadata, photometric="minisblack")
    volume = load(tmp_path / "a.ome.tif")
    assert volume.spacing == (0.5, 0.5, step)
    assert [told in note for note in volume.notes] == [True] * bool(told)


def test_tiff_ome_channels_and_units(tmp_path: Path) -> None:
    tifffile = pytest.importorskip("tifffile")
    metadata = {"axes": "CZYX", "PhysicalSizeX": 1.5, "PhysicalSizeY": 2.25, "PhysicalSizeZ": 3000}
    metadata |= {"PhysicalSizeZUnit": "nm"}
    tifffile.imwrite(tmp_path / "letter.ome.tif", np.stack([F + 1, F]), metadata=metadata)
    with pytest.raises(InputError, match="pick with channel=0 … channel=1, channel=all"):
        load(tmp_path / "letter.ome.tif")
    volume = load(tmp_path / "letter.ome.tif", channel=1)
    np.testing.assert_array_equal(volume.samples, F)
    np.testing.assert_allclose(volume.spacing, SPACING)
    assert (volume.unit, volume.name, is_mapped(volume.samples)) == ("um", "letter", True)


def pyramid(path: Path, levels: int = 3, **options: Any) -> np.ndarray:
    """Writes an OME-TIFF of two channels with coarser levels, means over 2 × 2; returns the second channel."""
    tifffile = pytest.importorskip("tifffile")
    full = np.random.default_rng(1).integers(0, 2**16, (2, 7, 96, 80), np.uint16)
    metadata = {"axes": "CZYX", "PhysicalSizeX": 0.5, "PhysicalSizeY": 0.5, "PhysicalSizeZ": 2}
    options = {"tile": (32, 32), "compression": "zlib", **options}
    with tifffile.TiffWriter(path) as file:
        file.write(full, subifds=levels - 1, metadata=metadata, **options)
        level = full
        for _ in range(levels - 1):
            level = np.rint(level.reshape(2, 7, level.shape[2] // 2, 2, -1, 2).mean(axis=(3, 5))).astype(np.uint16)
            file.write(level, subfiletype=1, **options)
    return np.asarray(full[1])


@pytest.mark.parametrize("options", [{}, {"compression": None}, {"tile": None, "rowsperstrip": 16}], ids=str)
def test_multiscale_tiff(tmp_path: Path, options: dict[str, Any]) -> None:
    """Coarser levels lie in the box of the finest and are read in parts."""
    full = pyramid(tmp_path / "a.ome.tif", **options)
    volume = load(tmp_path / "a.ome.tif", channel=1)
    np.testing.assert_array_equal(volume.samples, full)
    assert [level.shape for level in volume.coarser] == [(7, 48, 40), (7, 24, 20)]
    for level, factor in zip(volume.coarser, (2, 4), strict=True):
        assert isinstance(level.samples, Chunked) and level.spacing == (0.5 * factor, 0.5 * factor, 2)
        np.testing.assert_allclose(level.corners, volume.corners)
        means = full.reshape(7, 96 // factor, factor, -1, factor).mean(axis=(2, 4))
        assert np.abs(level.samples[2:5] - means[2:5]).max() < 1
        alone = load(tmp_path / "a.ome.tif", channel=1, level=int(np.log2(factor)))
        assert not alone.coarser and alone.spacing == level.spacing and alone.origin == level.origin
        np.testing.assert_array_equal(alone.samples, level.samples[:])
    with pytest.raises(InputError, match=r"a\.ome\.tif: level: expected a number from 0 to 2, got 3"):
        load(tmp_path / "a.ome.tif", channel=1, level=3)


def test_a_large_multiscale_tiff_is_read_in_parts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    full = pyramid(tmp_path / "a.ome.tif")
    monkeypatch.setattr(tiff, "WHOLE_BYTES", 1000)
    volume = load(tmp_path / "a.ome.tif", channel=1)
    assert isinstance(volume.samples, Chunked)
    np.testing.assert_array_equal(volume.samples[3:5, 20:70, 1:2], full[3:5, 20:70, 1:2])
    # a tile that became nonsense is told where it is read
    store = bytearray((tmp_path / "a.ome.tif").read_bytes())
    with pytest.importorskip("tifffile").TiffFile(tmp_path / "a.ome.tif") as file:
        start, count = file.pages[9].dataoffsets[4], file.pages[9].databytecounts[4]
    store[start : start + count] = bytes(count)
    (tmp_path / "b.ome.tif").write_bytes(store)
    damaged = load(tmp_path / "b.ome.tif", channel=1)
    with pytest.raises(InputError, match=r"b\.ome\.tif: cannot be read as TIFF, chunk 2, 1, 1: "):
        np.asarray(damaged.samples[2])
    (tmp_path / "b.ome.tif").write_bytes(store[: len(store) // 2])
    with pytest.raises(InputError, match=r"b\.ome\.tif: "):
        load(tmp_path / "b.ome.tif", channel=1)


def test_only_levels_of_a_multiscale_tiff_are_named(tmp_path: Path) -> None:
    pytest.importorskip("tifffile").imwrite(tmp_path / "a.tif", F, photometric="minisblack")
    with pytest.raises(InputError, match="level: expected a multiscale image, got 0"):
        load(tmp_path / "a.tif", level=0)


# --- Zarr ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("version", [2, 3])
def test_zarr_arrays_and_groups(tmp_path: Path, version: int) -> None:
    zarr = pytest.importorskip("zarr")
    zarr.create_array(tmp_path / "letter.zarr", data=F, chunks=(2, 3, 5), zarr_format=version)
    check(load(tmp_path / "letter.zarr"), grid=False, frame=None, mapped=False)
    group = zarr.open_group(tmp_path / "group.zarr", mode="w", zarr_format=version)
    for name in ("one", "two"):
        group.create_array(name, data=F + (name == "one"))
    with pytest.raises(InputError, match=r"pick one with array=NAME; there are: (one, two|two, one)"):
        load(tmp_path / "group.zarr")
    np.testing.assert_array_equal(load(tmp_path / "group.zarr", array="two").samples, F)


@pytest.mark.parametrize("version", [2, 3])
def test_ome_zarr_level_channel_and_grid(tmp_path: Path, version: int) -> None:
    zarr = pytest.importorskip("zarr")
    group = zarr.open_group(tmp_path / "letter.ome.zarr", mode="w", zarr_format=version)
    group.create_array("0", data=np.stack([F + 1, F]))
    group.create_array("1", data=np.stack([F + 1, F])[:, ::2, ::2, ::2])
    axes = [{"name": "c", "type": "channel"}] + [{"name": name, "unit": "micrometer"} for name in "zyx"]
    levels = [
        {
            "path": str(level),
            "coordinateTransformations": [
                {"type": "scale", "scale": [1, 1.0 * step, 0.75 * step, 0.5 * step]},
                {"type": "translation", "translation": [0, 10, 20, 30]},
            ],
        }
        for level, step in enumerate((1, 2))
    ]
    whole = [{"type": "scale", "scale": [1, 3, 3, 3]}]
    multiscale = {"axes": axes, "datasets": levels, "coordinateTransformations": whole}
    attributes = {"multiscales": [multiscale]}
    group.attrs.update(attributes if version == 2 else {"ome": attributes})
    finest, coarse = (load(tmp_path / "letter.ome.zarr", channel=1, array=array) for array in (None, "1"))
    np.testing.assert_array_equal(finest.samples, F)
    assert (finest.spacing, finest.origin, finest.unit) == (SPACING, (90, 60, 30), "um")
    np.testing.assert_array_equal(coarse.samples, F[::2, ::2, ::2])
    assert coarse.spacing == (3.0, 4.5, 6.0)
    for level, right in enumerate((finest, coarse)):
        found = load(tmp_path / "letter.ome.zarr", channel=1, level=level)
        np.testing.assert_array_equal(found.samples, right.samples)
        assert found.spacing == right.spacing
    for given, said in (
        ({"level": 2}, "level: expected a number from 0 to 1, got 2"),
        ({"level": 0, "array": "1"}, "level: expected a multiscale image, and no array, got 0"),
        ({"level": -1}, "level: expected zero or more, got -1"),
    ):
        with pytest.raises(InputError, match=said):
            load(tmp_path / "letter.ome.zarr", channel=1, **given)
