"""Files of programs in HDF5 and in classic NetCDF: EMD, NeXus, MATLAB, VTK, ITK, Velox, EMAN2, Chimera."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from splatgl import InputError, load
from splatgl.annotations.canvas import AnnotatedSubject
from splatgl.data import affine
from splatgl.data.affine import Coordinate, make_lattice
from splatgl.readers import hdf5_files, list_volumes
from splatgl.readers.chunked import Chunked
from splatgl.readers.contents import identify

pytestmark = pytest.mark.usefixtures("sound_files")

h5py = pytest.importorskip("h5py")

F = (np.arange(4 * 5 * 6).reshape(4, 5, 6) * 7 % 251).astype(np.float32)
RGB = np.stack([F, F[::-1], 255 - F], -1).astype(np.uint8)
# coordinates along z, y, x
PLACES = (10 + 2.0 * np.arange(4), 0.5 * np.arange(5), 0.25 * np.arange(6))


def emd(
    path: Path, data: np.ndarray, axes: dict[str, tuple[np.ndarray, str]], first: int = 1, cut: bool = False
) -> Path:
    """cut: writes the first two of even coordinates, as emdfile does."""
    with h5py.File(path, "w") as file:
        group = file.create_group("data/cube")
        group.attrs["emd_group_type"] = 1
        group["data"] = data
        for number, (name, (places, unit)) in enumerate(axes.items(), first):
            node = group.create_dataset(f"dim{number}", data=places[:2] if cut else places)
            node.attrs["name"], node.attrs["units"] = name, unit
    return path


@pytest.mark.parametrize(("unit", "cut", "first"), [("[n_m]", False, 1), ("nm", True, 0)])
def test_emd_has_the_grid_of_its_axes(tmp_path: Path, unit: str, cut: bool, first: int) -> None:
    axes = {name: (places, unit) for name, places in zip("zyx", PLACES, strict=True)}
    volume = load(emd(tmp_path / "a.emd", F, axes, first, cut))
    assert (volume.spacing, volume.origin, volume.unit) == ((0.25, 0.5, 2), (0, 0, 10), "nm")
    np.testing.assert_array_equal(volume.samples, F)
    turned = load(emd(tmp_path / "b.emd", F.transpose(2, 0, 1), {name: axes[name] for name in "xzy"}, first, cut))
    np.testing.assert_array_equal(turned.samples, F)
    assert turned.spacing == volume.spacing


def test_an_axis_in_a_unit_of_time_is_time_and_not_of_channels(tmp_path: Path) -> None:
    axes = {"frame number": (np.arange(3) * 2.0, "min"), **{n: (p, "nm") for n, p in zip("zyx", PLACES, strict=True)}}
    path = emd(tmp_path / "a.emd", np.stack([F, F + 1, F + 2]), axes)
    volume = load(path, time=2)
    assert (volume.times, volume.time_step) == (3, 120) and np.array_equal(volume.samples, F + 2)
    # travel times of a survey are depths
    axes = {"inline": (PLACES[0], ""), "crossline": (PLACES[1], ""), "travel": (PLACES[2], "ms")}
    assert load(emd(tmp_path / "b.emd", F, axes)).shape == F.shape


def nexus(path: Path, style: str) -> Path:
    with h5py.File(path, "w") as file:
        entry = file.create_group("entry")
        entry.attrs["NX_class"] = "NXentry"
        data = entry.create_group("result")
        data.attrs["NX_class"] = "NXdata"
        node = data.create_dataset("volume", data=F)
        if style == "old":
            node.attrs["signal"], node.attrs["axes"] = 1, "slow:middle:fast"
        else:
            data.attrs["signal"], data.attrs["axes"] = "volume", ["fast", "slow", "middle"]
            for n, name in ((2, "fast"), (0, "slow"), (1, "middle")):
                data.attrs[f"{name}_indices"] = n
            file.attrs["default"], entry.attrs["default"] = "entry", "result"
        # the last axis has the faces of voxels
        faces = np.append(PLACES[2], PLACES[2][-1] + 0.25) - 0.125
        for name, places in zip(("slow", "middle", "fast"), (*PLACES[:2], faces), strict=True):
            data.create_dataset(name, data=places).attrs["units"] = "um"
        data["errors"] = F * 0
        file["entry/instrument/data"] = np.zeros((3, 5, 6))
    return path


@pytest.mark.parametrize("style", ["old", "new"])
def test_nexus_leads_to_its_signal_and_its_axes(tmp_path: Path, style: str) -> None:
    volume = load(nexus(tmp_path / "a.nxs", style))
    np.testing.assert_array_equal(volume.samples, F)
    assert (volume.spacing, volume.origin, volume.unit) == ((0.25, 0.5, 2), (0, 0, 10), "um")
    assert "/entry/result/volume is rendered" in volume.notes[0] and "/entry/result/errors" in volume.notes[0]
    assert not load(tmp_path / "a.nxs", array="/entry/result/errors").samples.any()


def test_links_of_nexus_lead_to_no_other_file(tmp_path: Path) -> None:
    path = nexus(tmp_path / "a.nxs", "old")
    with h5py.File(path, "a") as file:
        del file["entry/result/slow"]
        file["entry/result/slow"] = h5py.ExternalLink("b.h5", "/slow")
    with pytest.raises(InputError, match="expected data in this file"):
        load(path)


def matlab(path: Path, array: np.ndarray, kind: str) -> Path:
    """A file as MATLAB's save -v7.3 writes it: a user block, and the axes in the reverse order."""
    with h5py.File(path, "w", userblock_size=512) as file:
        if np.iscomplexobj(array):
            pairs = np.zeros(array.T.shape, [("real", array.real.dtype), ("imag", array.real.dtype)])
            pairs["real"], pairs["imag"] = array.T.real, array.T.imag
            array = pairs.T
        file.create_dataset("volume", data=array.T).attrs["MATLAB_class"] = np.bytes_(kind)
        file.create_dataset("name", data=np.ones((3, 1), "u2")).attrs["MATLAB_class"] = np.bytes_("char")
    with path.open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM")
    return path


def test_matlab_has_rows_columns_and_pages(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    rows = F.transpose(1, 2, 0)
    path = matlab(tmp_path / "a.mat", rows, "single")
    np.testing.assert_array_equal(load(path).samples, F)
    magnitude = load(matlab(tmp_path / "b.mat", rows * (3 + 4j), "double"))
    np.testing.assert_allclose(magnitude.samples, 5 * F, rtol=1e-6)
    assert "complex numbers are rendered by their magnitude" in magnitude.notes
    np.testing.assert_array_equal(load(matlab(tmp_path / "c.mat", RGB.transpose(1, 2, 0, 3), "uint8")).color, RGB)
    np.testing.assert_array_equal(load(matlab(tmp_path / "d.mat", RGB.transpose(1, 2, 3, 0), "uint8")).color, RGB)
    monkeypatch.setattr(hdf5_files, "WHOLE_BYTES", 100)
    with h5py.File(path, "a") as file:
        del file["volume"]
        node = file.create_dataset("volume", data=F.transpose(0, 2, 1), chunks=(2, 3, 5), compression="gzip")
        node.attrs["MATLAB_class"] = np.bytes_("single")
    parts = load(path).samples
    assert not isinstance(parts, np.ndarray) and np.array_equal(parts[1:3, :2], F[1:3, :2])


def test_older_files_of_matlab_are_told(tmp_path: Path) -> None:
    (tmp_path / "a.mat").write_bytes(b"MATLAB 5.0 MAT-file, Platform: GLNXA64".ljust(300))
    with pytest.raises(InputError, match=r"MATLAB's format before 7.3; save it in MATLAB with save\(..., '-v7.3'\)"):
        load(tmp_path / "a.mat")


def test_layouts_with_steps_in_attributes(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "eman.hdf", "w") as file:
        file["MDF/images/0/image"] = F
        for axis, step in zip("xyz", (1.5, 1.25, 2), strict=True):
            file["MDF/images/0"].attrs[f"EMAN.apix_{axis}"] = step
    with h5py.File(tmp_path / "chimera.cmap", "w") as file:
        file["Chimera/image1/data_zyx"] = F
        file["Chimera/image1"].attrs["step"], file["Chimera/image1"].attrs["origin"] = (1.5, 1.25, 2.0), (1.0, 2.0, 3.0)
    for name, origin in (("eman.hdf", (0, 0, 0)), ("chimera.cmap", (1, 2, 3))):
        volume = load(tmp_path / name)
        assert (volume.spacing, volume.origin, volume.unit) == ((1.5, 1.25, 2), origin, "Å")
        np.testing.assert_array_equal(volume.samples, F)


def test_velox_has_frames_last_and_its_pixels_in_text(tmp_path: Path) -> None:
    pixels = {"PixelSize": {"width": "2e-10", "height": "3e-10"}, "PixelUnitX": "m", "PixelUnitY": "m"}
    about = np.zeros((1000, 4), np.uint8)
    text = json.dumps({"BinaryResult": pixels}).encode()
    about[: len(text)] = np.frombuffer(text, np.uint8)[:, None]
    with h5py.File(tmp_path / "a.emd", "w") as file:
        file["Data/Image/01ab/Data"], file["Data/Image/01ab/Metadata"] = np.moveaxis(F, 0, -1), about
    volume = load(tmp_path / "a.emd")
    np.testing.assert_array_equal(volume.samples, F)
    assert np.allclose(volume.spacing, (0.2, 0.3, 0.2)) and volume.unit == "nm"


def test_itk_writes_the_same_grid_to_hdf5(tmp_path: Path) -> None:
    itk = pytest.importorskip("SimpleITK")
    image = itk.GetImageFromArray(F)
    image.SetSpacing((0.25, 0.5, 2))
    image.SetOrigin((1, 2, 3))
    image.SetDirection((0, 0, 1, 1, 0, 0, 0, 1, 0))
    itk.WriteImage(image, str(tmp_path / "a.h5"))
    volume = load(tmp_path / "a.h5")
    np.testing.assert_array_equal(volume.samples, F)
    place = volume.origin + volume.direction @ (np.array(volume.spacing) * (3, 2, 1))
    np.testing.assert_allclose(place, image.TransformIndexToPhysicalPoint((3, 2, 1)))
    assert volume.frame == "LPS"


def test_four_axes_without_labels_are_not_told_as_channels(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["a"] = np.zeros((40, 5, 6, 7), np.float32)
    with pytest.raises(InputError, match="got 7 entries along axis 4 of 40×5×6×7; pick with channel=0"):
        load(tmp_path / "a.h5")


def test_bytes_of_three_or_four_are_colours(tmp_path: Path) -> None:
    for count in (3, 4):
        color = np.concatenate([RGB, RGB], -1)[..., :count]
        with h5py.File(tmp_path / "a.h5", "w") as file:
            file.create_dataset("a", data=color, chunks=(2, 5, 6, count), compression="gzip")
        volume = load(tmp_path / "a.h5")
        np.testing.assert_array_equal(volume.color, RGB)
        assert any("read as a colour" in note for note in volume.notes)
        np.testing.assert_array_equal(load(tmp_path / "a.h5", channel=1).samples, RGB[..., 1])


# --- VTK --------------------------------------------------------------------------------------------------------------


def vtk_image(arrays: dict[str, np.ndarray], cells: bool = False) -> Any:
    """An image with a corner at index (2, 1, 0), turned; the first array of one component or of colours is active."""
    vtk = pytest.importorskip("vtk")
    from vtkmodules.util.numpy_support import numpy_to_vtk

    image = vtk.vtkImageData()
    image.SetExtent(2, 7 + cells, 1, 5 + cells, 0, 3 + cells)
    image.SetSpacing(0.25, 0.5, 2)
    image.SetOrigin(1, 2, 3)
    image.SetDirectionMatrix(0, 0, 1, 1, 0, 0, 0, 1, 0)
    data = image.GetCellData() if cells else image.GetPointData()
    for name, array in arrays.items():
        values = numpy_to_vtk(np.ascontiguousarray(array.reshape(-1, *array.shape[3:])), deep=1)
        values.SetName(name)
        data.SetVectors(values) if name == "flow" else data.SetScalars(values)
    return image


def write_vtk(image: Any, path: Path) -> Path:
    import vtk

    writer = {".vtkhdf": vtk.vtkHDFWriter, ".vti": vtk.vtkXMLImageDataWriter, ".vtk": vtk.vtkDataSetWriter}[
        path.suffix
    ]()
    writer.SetFileName(str(path))
    writer.SetInputData(image)
    assert writer.Write()
    return path


def test_vtkhdf_of_points_and_cells_is_where_vtk_has_it(tmp_path: Path) -> None:
    for cells in (False, True):
        image = vtk_image({"a": F}, cells)
        volume = load(write_vtk(image, tmp_path / "a.vtkhdf"))
        np.testing.assert_array_equal(volume.samples, F)
        # the last sample is a corner, or the middle of a cell
        last = volume.origin + volume.direction @ (np.array(volume.spacing) * (5, 4, 3))
        if cells:
            box = image.GetCell(image.GetNumberOfCells() - 1).GetBounds()
            right = [(box[axis] + box[axis + 1]) / 2 for axis in (0, 2, 4)]
        else:
            right = image.GetPoint(image.GetNumberOfPoints() - 1)
        np.testing.assert_allclose(last, right)


@pytest.mark.parametrize("ending", [".vtkhdf", ".vti", ".vtk"])
def test_vtk_has_colours_and_vectors(tmp_path: Path, ending: str) -> None:
    volume = load(write_vtk(vtk_image({"rgb": RGB}), tmp_path / f"a{ending}"))
    np.testing.assert_array_equal(volume.color, RGB)
    assert any("read as a colour" in note for note in volume.notes)
    flow = np.stack([F, 2 * F, -F], -1)
    volume = load(write_vtk(vtk_image({"flow": flow}), tmp_path / f"b{ending}"))
    np.testing.assert_array_equal(volume.vectors, flow)


def test_steps_and_names_of_vtkhdf(tmp_path: Path) -> None:
    path = write_vtk(vtk_image({"a": F}), tmp_path / "a.vtkhdf")
    with h5py.File(path, "a") as file:
        del file["VTKHDF/PointData/a"]
        file["VTKHDF/PointData/a"], file["VTKHDF/PointData/b"] = np.stack([F, F + 1]), np.stack([F + 2, F + 3])
        file.create_group("VTKHDF/Steps").attrs["NSteps"] = 2
        file["VTKHDF/Steps/Values"] = [0.5, 2.0]
    assert load(path).times == 2 and "array a of 2 is rendered" in load(path).notes[0]
    np.testing.assert_array_equal(load(path, array="b", time=1).samples, F + 3)
    np.testing.assert_array_equal(load(path, array="/VTKHDF/PointData/a", channel=1).samples, F + 1)
    with h5py.File(path, "a") as file:
        file["VTKHDF"].attrs["Type"] = np.bytes_("PolyData")
    with pytest.raises(InputError, match="cannot be read by VTK"):
        load(path)


# --- NetCDF-3 ---------------------------------------------------------------------------------------------------------


def classic(path: Path, times: int, version: int = 1) -> Path:
    io = pytest.importorskip("scipy.io")
    with io.netcdf_file(path, "w", version=version) as file:
        for name, size in zip(("valid_time", "level", "lat", "lon"), (None, *F.shape), strict=True):
            file.createDimension(name, size)
        axes = {"valid_time": 6.0 * np.arange(times), **dict(zip(("level", "lat", "lon"), PLACES, strict=True))}
        for name, places in axes.items():
            node = file.createVariable(name, "d", (name,))
            node[:], node.units = places, "hours since 2000-01-01" if name == "valid_time" else "m"
        node = file.createVariable("t", "h", ("valid_time", "level", "lat", "lon"))
        node[:] = np.stack([F + n for n in range(times)]).astype("h")
        node.scale_factor, node.add_offset, node._FillValue, node.units = 0.5, 10.0, np.int16(7), "K"
    return path


@pytest.mark.parametrize("version", [1, 2])
def test_classic_netcdf_has_axes_times_and_packed_values(tmp_path: Path, version: int) -> None:
    netcdf = pytest.importorskip("netCDF4")
    path = classic(tmp_path / "a.nc", 3, version)
    volume = load(path, time=1)
    with netcdf.Dataset(path) as file:
        right = file["t"][1]
    np.testing.assert_array_equal(np.isnan(volume.samples), right.mask)
    np.testing.assert_array_equal(volume.samples, right.filled(np.nan).astype(np.float32))
    assert (volume.spacing, volume.origin, volume.unit) == ((0.25, 0.5, 2), (0, 0, 10), "m")
    assert (volume.times, volume.time_step, volume.value_unit) == (3, 6 * 3600, "K") and not volume.channels
    # packed temperatures over metres are a field
    assert (volume.quantity, volume.hints.preset) == ("t", "field")
    with netcdf.Dataset(path, "a") as file:
        file["t"].long_name = "air temperature"
    named = load(path, time=1)
    assert (named.quantity, named.hints.preset) == ("air temperature", "field")
    assert AnnotatedSubject.of(named).value_name == "air temperature, K"
    assert np.array_equal(load(f"{path}:/t", time=1).samples, volume.samples, equal_nan=True)
    assert not volume.notes and list_volumes(path)[-1] == "* /t   int16 3×4×5×6"


def test_classic_netcdf_of_64_bits_in_parts_and_without_ending(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    netcdf = pytest.importorskip("netCDF4")
    path = tmp_path / "field"
    with netcdf.Dataset(path, "w", format="NETCDF3_64BIT_DATA") as file:
        for name, size in zip("zyx", F.shape, strict=True):
            file.createDimension(name, size)
        file.createVariable("a", "u8", ("z", "y", "x"))[:] = F
    assert load(path).samples.dtype == np.uint64 and np.array_equal(load(path).samples, F)
    monkeypatch.setattr(hdf5_files, "WHOLE_BYTES", 100)
    parts = load(path).samples
    assert isinstance(parts, Chunked) and np.array_equal(parts[1:3], F[1:3])


def test_classic_netcdf_that_is_cut_short_is_refused(tmp_path: Path) -> None:
    """Its library reads zeros there."""
    pytest.importorskip("netCDF4")
    path = classic(tmp_path / "a.nc", 2)
    path.write_bytes(path.read_bytes()[:-50])
    with pytest.raises(InputError, match="the file is cut short"):
        load(path)


# --- contents ---------------------------------------------------------------------------------------------------------


def test_hdf5_is_known_by_its_mark_also_behind_a_user_block(tmp_path: Path) -> None:
    path = matlab(tmp_path / "data", F.transpose(1, 2, 0), "single")
    assert identify(path) == "HDF5" and np.array_equal(load(path).samples, F)
    wrong = path.rename(tmp_path / "a.nrrd")
    assert "its contents are HDF5, not what its name says" in load(wrong).notes
    (tmp_path / "a.hdf").write_bytes(b"\x0e\x03\x13\x01" + bytes(100))
    with pytest.raises(InputError, match="expected HDF5, as the name says, got HDF4; convert it with h4toh5"):
        load(tmp_path / "a.hdf")


def test_an_impossible_grid_is_refused_before_it_is_resampled(monkeypatch: pytest.MonkeyPatch) -> None:
    """A damaged coordinate made hundreds of thousands of planes, which took six seconds."""
    places = (np.array([0.0, 1e72, 3e75]), np.arange(4.0), np.arange(5.0))
    axes = [Coordinate.of(name, each, {"units": "m"}) for name, each in zip("zyx", places, strict=True)]
    grid = make_lattice(axes)
    monkeypatch.setattr(affine, "interpolate_planes", lambda *_: pytest.fail("resampled"))
    with pytest.raises(InputError, match="coordinates: expected three finite numbers"):
        grid.volume(np.zeros((3, 4, 5), np.float32), "coordinates")
