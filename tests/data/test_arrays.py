"""Arrays and images of other libraries become volumes: the same samples at the same places, without copies."""

from __future__ import annotations

import gc
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import splatgl as sg
from splatgl.readers import load

pytestmark = pytest.mark.usefixtures("sound_files")

SAMPLES = np.arange(2 * 3 * 4, dtype=np.uint16).reshape(2, 3, 4)
GIVEN = {"spacing": (1.0, 2.0, 3.0), "origin": (4.0, 5.0, 6.0), "unit": "um", "name": "cells"}


def of(library: str, what: str) -> Any:
    return pytest.importorskip(library, reason=f"{what} come from {library}")


def places(volume: sg.Volume) -> dict[int, tuple[float, ...]]:
    """Where each sample of SAMPLES is in the world."""
    found = np.asarray(volume.samples[:])
    index = np.argwhere(np.ones(found.shape, bool))
    world = index[:, ::-1] @ volume.world_from_index.T + np.array(volume.origin)
    return {int(found[tuple(at)]): tuple(np.round(point, 9).tolist()) for at, point in zip(index, world, strict=True)}


def test_arrays_are_views_and_options_replace_what_they_say() -> None:
    plain = sg.Volume.of(SAMPLES)
    assert np.shares_memory(plain.samples, SAMPLES) and plain.spacing == (1, 1, 1) and plain.name == ""
    turned = np.asfortranarray(SAMPLES).T[::-1]
    assert np.shares_memory(sg.Volume.of(turned).samples, turned)
    volume = sg.Volume.of(SAMPLES, **GIVEN)
    assert {name: getattr(volume, name) for name in GIVEN} == GIVEN
    # and of what is a volume
    assert sg.Volume.of(volume, spacing=(2, 2, 2)).spacing == (2, 2, 2) and sg.Volume.of(volume).origin == (4, 5, 6)
    assert (np.asarray(sg.Volume.of(SAMPLES.tolist()).samples) == SAMPLES).all()


def test_masked_samples_are_not_drawn() -> None:
    masked = np.ma.masked_greater(SAMPLES, 20)
    volume = sg.Volume.of(masked)
    assert (np.isnan(volume.samples) == (SAMPLES > 20)).all() and volume.samples.dtype == np.float32
    assert sg.Volume.of(np.ma.asarray(SAMPLES)).samples.dtype == np.uint16


@pytest.mark.parametrize(
    ("x", "told"),
    [
        (np.zeros((3, 4)), r"3 axes .* got 2 \(3×4\); stack"),
        (np.zeros((20, 30, 40, 3)), r"3 axes .* got 4 \(20×30×40×3\); pick a channel: x\[\.\.\., 0\]"),
        (np.zeros((2, 30, 40, 50)), r"3 axes .* pick a channel or time: x\[0\]"),
        (np.zeros(()), "got 0 .a single number"),
        (np.zeros((2, 2, 2), complex), "real numbers, got .* complex128; take abs"),
        (np.zeros((2, 2, 2), object), "real numbers, got .* object; convert"),
        (np.zeros((2, 0, 2)), "at least one voxel"),
        ([[1, 2], [3]], "got list"),
        ("head.nii", "an array or image, got the text 'head.nii'; read a file by sg.load"),
        (Path("head.nii"), "sg.load"),
        ({"ct": SAMPLES}, "got a dict of ct; pick one"),
        (None, "got a NoneType"),
    ],
)
def test_what_makes_no_volume_is_refused_in_a_line(x: Any, told: str) -> None:
    with pytest.raises(sg.InputError, match=told) as found:
        sg.Volume.of(x)
    assert "\n" not in str(found.value)


def test_unknown_options_are_refused() -> None:
    with pytest.raises(sg.InputError, match=r"some of spacing.*got spacings"):
        sg.Volume.of(SAMPLES, spacings=(1, 1, 1))  # type: ignore[call-arg]
    with pytest.raises(sg.InputError, match="array: expected no value"):
        sg.Volume.of(SAMPLES, array="ct")


class Counting:
    """A numpy array that counts what is read of it."""

    def __init__(self, array: np.ndarray) -> None:
        self.array, self.shape, self.dtype, self.read = array, array.shape, array.dtype, 0

    def __getitem__(self, key: Any) -> np.ndarray:
        part = self.array[key]
        self.read = max(self.read, part.size)
        return part


def test_arrays_on_disk_are_read_in_parts() -> None:
    """Their slices alone are asked for, while the picture's splats are extracted."""
    big = np.zeros((1400, 96, 96), np.uint8)
    big[340:360, 20:30, 20:30] = 1
    counting = Counting(big)
    volume = sg.Volume.of(counting)
    assert counting.read == 0
    transfer = sg.Transfer([(0, 0), (1, 0.5)])
    splats = sg.extract(volume, transfer)
    assert 0 < counting.read < big.size
    assert (splats.records == sg.extract(sg.Volume(big), transfer).records).all()


def test_zarr_dask_and_hdf5_stay_where_they_are(tmp_path: Path) -> None:
    zarr, dask = of("zarr", "chunked arrays"), of("dask.array", "lazy arrays")
    stored = zarr.create_array(tmp_path / "a.zarr", name="raw", data=SAMPLES, chunks=(1, 3, 4))
    lazy = dask.from_array(SAMPLES, chunks=1)
    for array in (stored, lazy):
        volume = sg.Volume.of(array)
        assert volume.samples is array and places(volume) == places(sg.Volume(SAMPLES))
    assert sg.Volume.of(stored).name == "raw"
    with pytest.raises(sg.InputError, match="got a Group of raw; pick one"):
        sg.Volume.of(zarr.open(tmp_path / "a.zarr", mode="r"))
    with pytest.raises(sg.InputError, match=r"known sizes.*compute_chunk_sizes"):
        sg.Volume.of(lazy[lazy[:, 0, 0] > 3])


def test_hdf5(tmp_path: Path) -> None:
    h5py = of("h5py", "datasets of HDF5")
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["cells/raw"] = SAMPLES
        volume = sg.Volume.of(file["cells/raw"])
        assert volume.name == "raw" and volume.samples == file["cells/raw"]
        assert places(volume) == places(sg.Volume(SAMPLES))
        with pytest.raises(sg.InputError, match="a File of cells; pick one"):
            sg.Volume.of(file)


def labelled(**coords: Any) -> Any:
    xarray = of("xarray", "DataArrays")
    even = {"z": [6.0, 9.0], "y": [5.0, 7.0, 9.0], "x": [4.0, 5.0, 6.0, 7.0], **coords}
    named = {name: (name, values, {"units": "micrometer"}) for name, values in even.items()}
    return xarray.DataArray(SAMPLES, dims=("z", "y", "x"), coords=named, name="cells", attrs={"units": "HU"})


def test_coordinates_of_xarray_are_the_grid() -> None:
    right = sg.Volume(SAMPLES, **GIVEN)
    array = labelled()
    for turned in (array, array.transpose("x", "z", "y"), array.rename(x="lon", y="lat", z="level").transpose()):
        volume = sg.Volume.of(turned)
        assert {name: getattr(volume, name) for name in GIVEN} == GIVEN
        assert places(volume) == places(right) and np.shares_memory(volume.samples, SAMPLES)
    # names that say nothing: z, y, x in order
    assert places(sg.Volume.of(array.rename(x="c", y="b", z="a"))) == places(right)
    assert sg.Volume.of(array, spacing=(1, 1, 1), unit="m").spacing == (1, 1, 1)
    assert sg.Volume.of(array.expand_dims("t")).shape == SAMPLES.shape


def test_descending_coordinates_mirror_nothing(renderer: sg.Renderer) -> None:
    """Samples in the other order with coordinates in the other order are the same volume, and the same picture."""
    array = labelled()
    for name in "xyz":
        volume = sg.Volume.of(array.isel({name: slice(None, None, -1)}))
        assert places(volume) == places(sg.Volume.of(array))
    xarray = of("xarray", "DataArrays")
    letter = sg.scenes.SCENES["letter-f"]()
    axes = {name: np.arange(size, dtype=float) for name, size in zip("zyx", letter.shape, strict=True)}
    up = xarray.DataArray(np.asarray(letter.samples), dims=("z", "y", "x"), coords=axes)
    drawn = []
    for each in (up, up.isel(x=slice(None, None, -1))):
        volume = sg.Volume.of(each)
        splats = sg.extract(volume, sg.Transfer([(0, 0), (float(np.max(letter.samples)), 0.9)], shading=False))
        camera = sg.Camera.orbit(volume, 30, 20, size=(64, 64))
        drawn.append(renderer.render(splats, camera).pixels)
    assert np.abs(drawn[0] - drawn[1]).max() < 2e-3
    assert np.abs(drawn[0] - drawn[0][:, ::-1]).max() > 0.5


def test_units_of_xarray_are_brought_together() -> None:
    array = labelled()
    array.z.attrs["units"] = "nm"
    volume = sg.Volume.of(array)
    assert volume.unit == "um" and volume.spacing == pytest.approx((1, 2, 0.003))
    array.z.attrs["units"] = "hPa"
    volume = sg.Volume.of(array)
    assert volume.unit == "" and volume.spacing[:2] == (1, 2) and "1 hPa of z is rendered as" in volume.notes[0]


def test_what_xarray_holds_else_is_refused() -> None:
    xarray = of("xarray", "DataArrays")
    uneven = labelled(y=[1.0, 2.0, 4.0])
    volume = sg.Volume.of(uneven)
    told = "y: 3 samples in steps of 1 to 2 um, resampled every 1 um; RMSE at its own points 0 % of the range"
    assert volume.spacing == (1, 1, 3) and volume.notes == (told,)
    assert sg.Volume.of(uneven, spacing=(1, 1, 1)).spacing == (1, 1, 1)
    with pytest.raises(sg.InputError, match="coordinate y: expected coordinates that rise or fall"):
        sg.Volume.of(labelled(y=[1.0, 1.0, 1.0]))
    with pytest.raises(sg.InputError, match=r"got 4 \(t, z, y, x\); pick one by x\.isel\(t=0\)"):
        sg.Volume.of(xarray.concat([labelled(), labelled()], "t"))
    both = xarray.Dataset({"a": labelled(), "b": labelled() + 1})
    with pytest.raises(sg.InputError, match="one of a, b"):
        sg.Volume.of(both)
    assert int(np.asarray(sg.Volume.of(both, array="b").samples)[0, 0, 0]) == 1


def test_xarray_of_dask_stays_lazy() -> None:
    dask = of("dask.array", "lazy arrays")
    array = labelled().copy(data=dask.from_array(SAMPLES)).transpose("y", "x", "z")
    volume = sg.Volume.of(array)
    assert isinstance(volume.samples, dask.Array) and places(volume) == places(sg.Volume(SAMPLES, **GIVEN))


def test_simpleitk() -> None:
    sitk = of("SimpleITK", "images of ITK")
    image = sitk.GetImageFromArray(SAMPLES)
    image.SetSpacing((1, 2, 3))
    image.SetOrigin((4, 5, 6))
    image.SetDirection((0, 1, 0, -1, 0, 0, 0, 0, -1))
    volume = sg.Volume.of(image)
    right = {}
    for z, y, x in np.ndindex(SAMPLES.shape):
        point = image.TransformIndexToPhysicalPoint((x, y, z))
        right[int(SAMPLES[z, y, x])] = tuple(np.round(point, 9).tolist())
    assert places(volume) == right and (volume.unit, volume.frame) == ("mm", "LPS")
    # the image's memory, which lives on
    assert np.shares_memory(volume.samples, sitk.GetArrayViewFromImage(image)) and not volume.samples.flags.writeable
    part = volume.samples[1:]
    del image, volume
    gc.collect()
    assert (part == SAMPLES[1:]).all()
    for size, kind, told in (
        ([4, 4, 4], sitk.sitkVectorUInt8, "got [23] channels.*VectorIndexSelectionCast"),
        ([4, 4, 4], sitk.sitkComplexFloat32, "real numbers, got .*complex64"),
        ([4, 4], sitk.sitkUInt8, "3 dimensions, got 2"),
        ([4, 4, 4, 2], sitk.sitkUInt8, "3 dimensions, got 4"),
    ):
        with pytest.raises(sg.InputError, match=told):
            sg.Volume.of(sitk.Image(size, kind))


def test_nibabel_as_its_file(tmp_path: Path) -> None:
    nibabel = of("nibabel", "NIfTI images")
    affine = np.array([[0, -2, 0, 4], [1, 0, 0, 5], [0, 0, 3, 6], [0, 0, 0, 1.0]])
    image = nibabel.Nifti1Image(SAMPLES.T, affine)
    image.header.set_xyzt_units("mm")
    volume = sg.Volume.of(image)
    right = {
        int(SAMPLES[z, y, x]): tuple(nibabel.affines.apply_affine(affine, (x, y, z)).tolist())
        for z, y, x in np.ndindex(SAMPLES.shape)
    }
    assert places(volume) == right and (volume.unit, volume.frame) == ("mm", "RAS")
    assert np.shares_memory(volume.samples, SAMPLES)
    image.header.set_slope_inter(2, 1)
    for name in ("a.nii", "a.nii.gz"):
        nibabel.save(image, tmp_path / name)
        read, held = load(tmp_path / name), sg.Volume.of(nibabel.load(tmp_path / name))
        assert (np.asarray(read.samples) == np.asarray(held.samples)).all() and read.samples.dtype == held.samples.dtype
        assert (read.world_from_index == held.world_from_index).all() and read.origin == held.origin
    nibabel.save(nibabel.MGHImage(SAMPLES.T.astype(np.int16), affine), tmp_path / "a.mgz")
    assert places(sg.Volume.of(nibabel.load(tmp_path / "a.mgz"))) == right
    series = nibabel.Nifti1Image(np.stack([SAMPLES.T, SAMPLES.T + 1], axis=-1), affine)
    assert (sg.Volume.of(series, array=1).samples == SAMPLES + 1).all()
    first = sg.Volume.of(series)
    assert first.times == 2 and (first.samples == SAMPLES).all()


@pytest.mark.parametrize("cells", [False, True])
def test_pyvista(cells: bool) -> None:
    pyvista = of("pyvista", "image data of VTK")
    size = np.array(SAMPLES.shape[::-1]) + cells
    turn = np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1.0]])
    image = pyvista.ImageData(dimensions=size, spacing=(1, 2, 3), origin=(4, 5, 6), direction_matrix=turn)
    data = image.cell_data if cells else image.point_data
    data["ct"] = SAMPLES.ravel()
    volume = sg.Volume.of(image)
    points = image.cell_centers().points if cells else image.points
    right = {int(v): tuple(np.round(p, 9).tolist()) for v, p in zip(data["ct"], points.astype(float), strict=True)}
    assert places(volume) == right and np.shares_memory(volume.samples, data["ct"]) and volume.name == "ct"
    data["pet"] = SAMPLES.ravel() + 1
    data["flow"] = np.zeros((SAMPLES.size, 3), np.float32)
    assert int(sg.Volume.of(image, array="pet").samples[0, 0, 0]) == 1
    with pytest.raises(sg.InputError, match="one of ct, pet, flow, got 'mr'"):
        sg.Volume.of(image, array="mr")
    with pytest.raises(sg.InputError, match="3 components in 'flow'"):
        sg.Volume.of(image, array="flow")
    with pytest.raises(sg.InputError, match="image data, got a PolyData; resample"):
        sg.Volume.of(pyvista.Sphere())
    with pytest.raises(sg.InputError, match="one that is active, got none"):
        sg.Volume.of(pyvista.ImageData(dimensions=(2, 2, 2)))


def test_napari(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("QT_QPA_PLATFORM", "offscreen")
    layers = of("napari.layers", "layers of napari")
    layer = layers.Image(
        SAMPLES,
        name="cells",
        scale=(3, 2, 1),
        translate=(6, 5, 4),
        rotate=(0, 0, 30),
        contrast_limits=(2, 20),
        colormap="viridis",
    )
    volume = sg.Volume.of(layer)
    right = {int(SAMPLES[at]): tuple(np.round(layer.data_to_world(at)[::-1], 9).tolist()) for at in np.ndindex(2, 3, 4)}
    assert places(volume) == right and np.shares_memory(volume.samples, SAMPLES) and volume.name == "cells"
    assert volume.hints.window == (2, 20) and volume.hints.colormap == "viridis"
    levels = layers.Image([SAMPLES.repeat(2, 0).repeat(2, 1).repeat(2, 2), SAMPLES], multiscale=True, scale=(3, 2, 1))
    found = sg.Volume.of(levels)
    assert len(found.coarser) == 1 and np.allclose(found.corners, found.coarser[0].corners)
    series = layers.Image(np.stack([SAMPLES, SAMPLES + 1]))
    assert int(np.asarray(sg.Volume.of(series, array=1).samples)[0, 0, 0]) == 1
    zarr = of("zarr", "chunked arrays")
    stored = sg.Volume.of(layers.Image(zarr.array(np.stack([SAMPLES, SAMPLES + 1]))), array=1)
    assert not isinstance(stored.samples, np.ndarray) and (stored.samples[:, 1] == SAMPLES[:, 1] + 1).all()
    for wrong, told in (
        (series, "pick a channel or time: array=0 … array=1"),
        (layers.Image(np.zeros((2, 3, 4, 3), np.uint8), rgb=True), "colours"),
        (layers.Points(np.zeros((1, 3))), "an Image or Labels layer of napari, got a Points"),
    ):
        with pytest.raises(sg.InputError, match=told):
            sg.Volume.of(wrong)


def test_no_library_is_imported_for_another_ones_array() -> None:
    code = (
        "import sys, numpy, splatgl; splatgl.Volume.of(numpy.zeros((2, 2, 2)));"
        "print({'xarray', 'SimpleITK', 'nibabel', 'napari', 'vtkmodules', 'dask', 'zarr'} & {*sys.modules})"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "set()"


def test_colours_are_bytes() -> None:
    """Other numbers are no places in the table of sRGB."""
    with pytest.raises(sg.InputError, match="color: expected uint8"):
        sg.Volume(np.zeros((2, 2, 2), np.float32), color=np.zeros((2, 2, 2, 3), np.float32))


@pytest.mark.parametrize("names", [("lat", "lon"), ("nav_lat", "nav_lon"), ("a", "b")])
def test_coordinates_in_two_dimensions_are_told(names: tuple[str, str], tmp_path: Path) -> None:
    """Curved grids are drawn by numbers of samples, in memory, in Zarr and in HDF5, with the same note."""
    xr = pytest.importorskip("xarray")
    lat, lon = np.meshgrid(np.linspace(40, 50, 6), np.linspace(0, 9, 7), indexing="ij")
    about = [{"standard_name": "latitude"}, {"standard_name": "longitude"}] if names == ("a", "b") else [{}, {}]
    coords = {
        name: (("eta", "xi"), values, attrs) for name, values, attrs in zip(names, (lat, lon), about, strict=True)
    }
    data = xr.DataArray(np.random.default_rng(1).random((5, 6, 7)), dims=("z", "eta", "xi"), coords=coords, name="u")
    note = f"x and y are numbers of samples: coordinates in two dimensions ({', '.join(names)}) are not used"
    assert sg.Volume.of(data).notes == (note,)
    assert sg.Volume.of(data, spacing=(1, 1, 1)).notes == ()
    assert note not in sg.Volume.of(data.assign_coords(eta=np.arange(6.0), xi=np.arange(7.0))).notes
    if names != ("a", "b"):
        pytest.importorskip("zarr")
        data.to_dataset().rename(eta="y", xi="x").to_zarr(tmp_path / "a.zarr")
        assert note in sg.load(tmp_path / "a.zarr", array="u").notes
