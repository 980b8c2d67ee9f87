"""Volumes become arrays and images of other libraries, and the same volumes again."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import splatgl as sg

RNG = np.random.default_rng(3)
TURN = np.array([[0.8, -0.6, 0.0], [0.6, 0.8, 0.0], [0.0, 0.0, 1.0]])


def make_volume(**changes: Any) -> sg.Volume:
    given = {"spacing": (0.5, 1.0, 2.0), "origin": (3.0, -4.0, 5.0), "unit": "mm", "name": "brain"} | changes
    return sg.Volume(RNG.integers(0, 200, (3, 4, 5)).astype(given.pop("dtype", np.int16)), **given)


def assert_same_place(first: sg.Volume, second: sg.Volume) -> None:
    """The same samples at the same places of the world."""
    assert np.array_equal(np.asarray(first.samples), np.asarray(second.samples))
    assert np.allclose(first.world_from_index, second.world_from_index) and np.allclose(first.origin, second.origin)


@pytest.mark.parametrize("direction", [np.eye(3), np.diag([-1.0, -1.0, 1.0])])
@pytest.mark.parametrize("unit", ["mm", "um", ""])
def test_xarray_and_back(direction: np.ndarray, unit: str) -> None:
    pytest.importorskip("xarray")
    volume = make_volume(direction=direction, unit=unit, value_unit="HU", quantity="attenuation")
    array = volume.to_xarray()
    assert array.dims == ("z", "y", "x") and array.name == "brain" and np.shares_memory(array.values, volume.samples)
    assert float(array.x[1] - array.x[0]) == 0.5 * direction[0, 0] and float(array.z[0]) == 5.0
    back = sg.Volume.of(array)
    assert_same_place(volume, back)
    assert (back.unit, back.name, back.value_unit) == (unit, "brain", "HU")


def test_a_turned_grid_has_no_coordinates() -> None:
    pytest.importorskip("xarray")
    with pytest.raises(sg.InputError, match=r"direction: expected axes along x, y and z .* to_simpleitk"):
        make_volume(direction=TURN).to_xarray()


def test_channels_of_xarray() -> None:
    pytest.importorskip("xarray")
    parts = tuple(make_volume(name=name) for name in ("DAPI", "GFP"))
    array = sg.Volume(parts[0].samples, channels=parts).to_xarray()
    assert array.dims[0] == "channel" and list(array.channel.values) == ["DAPI", "GFP"]
    assert np.array_equal(array.sel(channel="GFP").values, parts[1].samples)


def test_dask_reads_nothing(tmp_path: Path) -> None:
    pytest.importorskip("dask.array")
    zarr = pytest.importorskip("zarr")
    store = zarr.create_array(tmp_path / "a.zarr", shape=(4, 6, 8), chunks=(2, 3, 4), dtype="u2")
    store[:] = RNG.integers(0, 9, store.shape)
    array = sg.Volume.of(store).to_dask()
    assert array.chunks == ((2, 2), (3, 3), (4, 4)) and np.array_equal(array.compute(), store[:])
    volume = make_volume()
    assert np.array_equal(volume.to_dask().compute(), volume.samples)


@pytest.mark.parametrize("frame", ["RAS", "LPS", None])
@pytest.mark.parametrize(("unit", "factor"), [("mm", 1.0), ("um", 1e-3), ("", 1.0)])
def test_simpleitk_is_in_lps_and_mm(frame: str | None, unit: str, factor: float) -> None:
    pytest.importorskip("SimpleITK")
    volume = make_volume(frame=frame, unit=unit, direction=TURN)
    image = volume.to_simpleitk()
    place = image.TransformIndexToPhysicalPoint((2, 1, 0))
    world = (volume.world_from_index @ [2, 1, 0] + volume.origin) * factor
    assert np.allclose(place, world * ([-1, -1, 1] if frame == "RAS" else 1))
    assert_same_place(volume.placed("LPS", "mm"), sg.Volume.of(image))


@pytest.mark.parametrize("dtype", [np.uint8, np.int16, np.float32, np.float64, np.float16, bool, np.int64])
def test_types_of_images(dtype: type) -> None:
    """Those that ITK and NIfTI lack become the next that holds them."""
    pytest.importorskip("SimpleITK")
    pytest.importorskip("nibabel")
    volume = make_volume(dtype=dtype)
    for image in (volume.to_simpleitk(), volume.to_nibabel()):
        assert np.array_equal(np.asarray(sg.Volume.of(image).samples), volume.samples)


@pytest.mark.parametrize("frame", ["RAS", "LPS", None])
def test_nibabel_is_in_ras_and_mm(frame: str | None, tmp_path: Path) -> None:
    nibabel = pytest.importorskip("nibabel")
    volume = make_volume(frame=frame, direction=TURN, unit="um")
    image = volume.to_nibabel()
    world = (volume.world_from_index @ [2, 1, 0] + volume.origin) * 1e-3
    assert np.allclose((image.affine @ [2, 1, 0, 1])[:3], world * ([-1, -1, 1] if frame == "LPS" else 1))
    nibabel.save(image, tmp_path / "a.nii")
    assert_same_place(volume.placed("RAS", "mm"), sg.load(tmp_path / "a.nii"))


def test_an_array_of_xarray_draws_itself() -> None:
    xarray = pytest.importorskip("xarray")
    import splatgl.integrations.xarray  # noqa: F401

    field = xarray.DataArray(RNG.random((6, 7, 8)), dims=("z", "y", "x"), coords={"x": np.arange(8) * 0.5})
    right = sg.render(field, size=24, azimuth=40)
    assert np.array_equal(field.splatgl.render(size=24, azimuth=40).pixels, right.pixels)
    volume = field.splatgl.volume(name="f")
    assert (volume.name, volume.spacing[0]) == ("f", 0.5)
