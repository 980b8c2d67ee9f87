"""MRC, Analyze, MGH, NRRD's components, VTK's grids, pieces and lists: written by the formats' libraries."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from splatgl.errors import InputError
from splatgl.readers import FORMATS, load
from splatgl.readers.common import is_mapped
from splatgl.readers.options import CONVERTERS
from tests.helpers.phantom import ORIGIN, SPACING, F, check

pytestmark = pytest.mark.usefixtures("sound_files")

COLORS = np.random.default_rng(3).integers(0, 255, (*F.shape, 3), np.uint8)


# --- MRC -------------------------------------------------------------------------------------------------------------


def mrc(path: Path, data: np.ndarray, **header: Any) -> Path:
    mrcfile = pytest.importorskip("mrcfile")
    compression = {".gz": "gzip", ".bz2": "bzip2"}.get(path.suffix)
    with mrcfile.new(path, compression=compression) as file:
        file.set_data(data)
        file.voxel_size, file.header.origin = SPACING, ORIGIN
        for name, value in header.items():
            file.header[name] = value
    return path


@pytest.mark.parametrize("dtype", ["i1", "i2", "f4", "u2", "f2"])
@pytest.mark.parametrize("name", ["letter.mrc", "letter.rec", "letter.map.gz", "letter.map.bz2"])
def test_mrc(tmp_path: Path, dtype: str, name: str) -> None:
    samples = (F // 2).astype(dtype)
    volume = load(mrc(tmp_path / name, samples))
    np.testing.assert_array_equal(volume.samples, samples)
    assert volume.samples.dtype == np.dtype(dtype) and is_mapped(volume.samples) == (name.count(".") == 1)
    np.testing.assert_allclose(volume.spacing, SPACING)
    assert (volume.origin, volume.unit, volume.name) == (ORIGIN, "Å", "letter")


@pytest.mark.parametrize("order", [(1, 2, 3), (3, 1, 2), (2, 1, 3)])
def test_axes_of_an_mrc_file_in_any_order(tmp_path: Path, order: tuple[int, int, int]) -> None:
    """mapc, mapr, maps: the axis of the cell, 1 is x, along columns, rows and sections, as the start is."""
    stored = F.astype(np.float32).transpose([3 - order[axis] for axis in (2, 1, 0)])
    header = {**dict(zip(("mapc", "mapr", "maps"), order, strict=True)), "nxstart": 2, "nystart": 3, "nzstart": 4}
    path = mrc(tmp_path / "a.map", stored, mx=5, my=7, mz=4, cella=(7.5, 15.75, 12), origin=(0, 0, 0), **header)
    volume = load(path)
    np.testing.assert_array_equal(volume.samples, F)
    np.testing.assert_allclose(volume.spacing, SPACING)
    starts = [(2, 3, 4)[order.index(axis)] for axis in (1, 2, 3)]
    np.testing.assert_allclose(volume.origin, np.multiply(starts, SPACING))


def test_oblique_cells_and_big_endian_files(tmp_path: Path) -> None:
    path = mrc(tmp_path / "a.map", F.astype(np.float32), cellb=(90, 90, 120))
    direction = load(path).direction
    np.testing.assert_allclose(direction, [[1, -0.5, 0], [0, np.sqrt(0.75), 0], [0, 0, 1]], atol=1e-12)
    mrcfile = pytest.importorskip("mrcfile")
    with mrcfile.open(path, "r+") as file:
        file.set_data(F.astype(">i2"))
    assert load(path).samples.dtype == np.dtype(">i2")
    np.testing.assert_array_equal(load(path).samples, F)


def test_a_stack_of_volumes_and_bytes_of_imod(tmp_path: Path) -> None:
    path = mrc(tmp_path / "a.mrc", np.stack([F, F + 1]).astype(np.int16))
    with pytest.raises(InputError, match="array=0 … array=1"):
        load(path)
    np.testing.assert_array_equal(load(path, array=1).samples, F + 1)
    path = mrc(tmp_path / "b.mrc", F.view(np.int8))
    data = bytearray(path.read_bytes())
    data[152:160] = np.array([1146047817, 0], "<i4").tobytes()
    path.write_bytes(data)
    np.testing.assert_array_equal(load(path).samples, F)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"mode": 5}, "mode: expected one of 0, 1, 2, 3, 4, 6, 12, got 5"),
        ({"nx": 99999999}, "the file is cut short"),
        ({"mapc": 2}, "mapc, mapr, maps: expected 1, 2 and 3"),
        ({"cellb": (10, 10, 179)}, "angles that a cell can have"),
        ({"nsymbt": -5}, "nsymbt: expected zero or more"),
    ],
    ids=str,
)
def test_damaged_mrc(tmp_path: Path, change: dict[str, Any], message: str) -> None:
    path = mrc(tmp_path / "a.mrc", F.astype(np.float32))
    from mrcfile.dtypes import HEADER_DTYPE

    data = bytearray(path.read_bytes())
    header = np.frombuffer(bytes(data[:1024]), HEADER_DTYPE).copy()
    for name, value in change.items():
        header[name] = value
    path.write_bytes(header.tobytes() + data[1024:])
    with pytest.raises(InputError, match=message):
        load(path)


def test_a_stack_of_pictures_in_mrc_is_told(tmp_path: Path) -> None:
    mrcfile = pytest.importorskip("mrcfile")
    with mrcfile.new(tmp_path / "a.mrcs") as file:
        file.set_data(F.astype(np.float32))
        file.set_image_stack()
        file.voxel_size = 2.0
    volume = load(tmp_path / "a.mrcs")
    np.testing.assert_array_equal(volume.samples, F)
    assert "stack of pictures" in volume.notes[0] and volume.spacing == (2, 2, 2)


@pytest.mark.parametrize("order", ["<", ">"])
def test_complex_mrc_is_drawn_by_its_magnitude(tmp_path: Path, order: str) -> None:
    """Modes 3, pairs of integers, and 4, pairs of floats."""
    mrcfile = pytest.importorskip("mrcfile")
    values = (F * (3 - 4j)).astype(np.complex64)
    with mrcfile.new(tmp_path / "a.mrc") as file:
        file.set_data(values.astype(order + "c8"))
        file.voxel_size = 2.0
        layout = file.header.dtype
    whole = (tmp_path / "a.mrc").read_bytes()
    header = np.frombuffer(whole[:1024], layout).copy()
    header["mode"] = 3
    pairs = np.stack([values.real, values.imag], -1).astype(order + "i2")
    (tmp_path / "b.mrc").write_bytes(header.tobytes() + pairs.tobytes())
    for name in ("a.mrc", "b.mrc"):
        volume = load(tmp_path / name)
        np.testing.assert_allclose(volume.samples, np.abs(values))
        assert volume.notes == ("complex numbers are rendered by their magnitude",) and volume.spacing == (2, 2, 2)


# --- Analyze, MGH ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("form", ["AnalyzeImage", "Spm2AnalyzeImage", "Nifti1Pair"])
def test_pairs_are_as_nibabel_reads_them(tmp_path: Path, form: str) -> None:
    nibabel = pytest.importorskip("nibabel")
    image = getattr(nibabel, form)(F.T.astype(np.int16), np.diag([-1.5, 2.25, 3, 1]))
    nibabel.save(image, tmp_path / "letter.img")
    # SPM's matrix in Matlab's format is not read
    if (tmp_path / "letter.mat").is_file():
        assert "letter.mat is not read" in load(tmp_path / "letter.hdr").notes[0]
        (tmp_path / "letter.mat").unlink()
    for name in ("letter.img", "letter.hdr"):
        volume = load(tmp_path / name)
        np.testing.assert_array_equal(volume.samples, F)
        affine = nibabel.load(tmp_path / name).affine
        np.testing.assert_allclose(volume.world_from_index, affine[:3, :3])
        np.testing.assert_allclose(volume.origin, affine[:3, 3])
        assert volume.frame == "RAS" and is_mapped(volume.samples)
    (tmp_path / "letter.img").write_bytes(bytes(100))
    with pytest.raises(InputError, match="data: expected 280 bytes, got 100"):
        load(tmp_path / "letter.hdr")


@pytest.mark.parametrize("form", ["Nifti1Pair", "Nifti2Pair"])
@pytest.mark.parametrize("ending", ["", ".gz"])
def test_pairs_of_nifti_are_as_whole_files(tmp_path: Path, form: str, ending: str) -> None:
    """Packed or not, with units, times, and scales."""
    nibabel = pytest.importorskip("nibabel")
    values = np.stack([F.T * 1.5, F.T * 3.0], -1)
    image = getattr(nibabel, form)(values.astype(np.float32), np.diag([-1.5, 2.25, 3, 1]))
    image.header.set_xyzt_units("micron", "msec")
    image.header["pixdim"][4] = 500
    image.header.set_data_dtype(np.int16)
    nibabel.save(image, tmp_path / f"letter.img{ending}")
    for name in (f"letter.img{ending}", f"letter.hdr{ending}"):
        volume = load(tmp_path / name, time=1)
        np.testing.assert_allclose(volume.samples, nibabel.load(tmp_path / name).dataobj[..., 1].T, atol=1e-4)
        assert (volume.unit, volume.times, volume.time_step) == ("um", 2, 0.5)


def test_nifti_of_one_plane_in_bzip2_and_complex(tmp_path: Path) -> None:
    """Planes are one voxel thick; complex numbers are scaled, too."""
    nibabel = pytest.importorskip("nibabel")
    nibabel.save(nibabel.Nifti1Image(F[0].T.astype(np.int16), None), tmp_path / "a.nii.bz2")
    volume = load(tmp_path / "a.nii.bz2")
    np.testing.assert_array_equal(volume.samples, F[:1])
    assert volume.name == "a"
    nibabel.save(nibabel.Nifti1Image((F.T * (3 + 4j)).astype(np.complex64), None), tmp_path / "b.nii")
    whole = bytearray((tmp_path / "b.nii").read_bytes())
    whole[112:120] = np.array([2, 1], "<f4").tobytes()
    (tmp_path / "b.nii").write_bytes(whole)
    np.testing.assert_allclose(load(tmp_path / "b.nii").samples, np.abs(F * (6 + 8j) + 1), rtol=1e-6)


@pytest.mark.parametrize("name", ["letter.mgh", "letter.mgz"])
def test_mgh(tmp_path: Path, name: str) -> None:
    nibabel = pytest.importorskip("nibabel")
    affine = np.array([[-1.5, 0, 0, 10], [0, 0, 3, 20], [0, -2.25, 0, 30], [0, 0, 0, 1]])
    nibabel.save(nibabel.MGHImage(F.T, affine), tmp_path / name)
    volume = load(tmp_path / name)
    np.testing.assert_array_equal(volume.samples, F)
    np.testing.assert_allclose(volume.world_from_index, affine[:3, :3], atol=1e-6)
    np.testing.assert_allclose(volume.origin, affine[:3, 3], atol=1e-5)
    assert (volume.frame, volume.unit, is_mapped(volume.samples)) == ("RAS", "mm", name.endswith("h"))


# --- NRRD's components -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("place", range(4))
@pytest.mark.parametrize("kind", ["RGB-color", "3-vector", "list"])
def test_components_of_nrrd_along_any_axis(tmp_path: Path, place: int, kind: str) -> None:
    nrrd = pytest.importorskip("nrrd")
    data = np.moveaxis(COLORS, -1, 3 - place).astype(np.float32 if "vector" in kind else np.uint8)
    directions: list[Any] = np.diag(SPACING).tolist()
    directions.insert(place, [np.nan] * 3)
    kinds = ["domain"] * 3
    kinds.insert(place, kind)
    header = {"kinds": kinds, "space": "left-posterior-superior", "space directions": np.array(directions)}
    nrrd.write(str(tmp_path / "a.nrrd"), data, header, index_order="C")
    np.testing.assert_array_equal(load(tmp_path / "a.nrrd", channel=1).samples, COLORS[..., 1])
    if kind == "list":
        with pytest.raises(InputError, match="channel=0 … channel=2"):
            load(tmp_path / "a.nrrd")
        return
    volume = load(tmp_path / "a.nrrd")
    assert volume.spacing == SPACING
    if kind == "RGB-color":
        np.testing.assert_array_equal(volume.color, COLORS)
        luma = COLORS @ (0.2126, 0.7152, 0.0722)
        assert np.abs(volume.samples - luma).max() <= 0.5 + 1e-9 and volume.vectors is None
    else:
        np.testing.assert_array_equal(volume.vectors, COLORS)
        np.testing.assert_allclose(volume.samples, np.linalg.norm(COLORS.astype(float), axis=-1), rtol=1e-6)


def test_time_points_of_nrrd(tmp_path: Path) -> None:
    nrrd = pytest.importorskip("nrrd")
    nrrd.write(str(tmp_path / "a.nrrd"), np.stack([F, F + 1]), {"kinds": ["domain"] * 3 + ["time"]}, index_order="C")
    first = load(tmp_path / "a.nrrd")
    assert first.times == 2 and first.notes == ("time 0 of 2: --time picks another",)
    np.testing.assert_array_equal(first.samples, F)
    for asked in ({"array": 1}, {"time": 1}):
        np.testing.assert_array_equal(load(tmp_path / "a.nrrd", **asked).samples, F + 1)


# --- VTK -------------------------------------------------------------------------------------------------------------


def vtk_grid(kind: str, cells: bool, steps: tuple[float, ...] = SPACING) -> Any:
    """VTK's own image or rectilinear grid of the phantom, from index (2, 3, 4) on."""
    vtk = pytest.importorskip("vtk", reason="the extra vtk writes the files")
    from vtk.util.numpy_support import numpy_to_vtk

    sizes = np.array(F.shape[::-1]) + cells
    extent = [2, 1 + sizes[0], 3, 2 + sizes[1], 4, 3 + sizes[2]]
    grid = vtk.vtkImageData() if kind == "vti" else vtk.vtkRectilinearGrid()
    grid.SetExtent(*map(int, extent))
    if kind == "vti":
        grid.SetSpacing(*steps)
        grid.SetOrigin(*ORIGIN)
    for axis, name in enumerate("XYZ" if kind == "vtr" else ""):
        places = ORIGIN[axis] + steps[axis] * np.arange(extent[2 * axis], extent[2 * axis + 1] + 1)
        getattr(grid, f"Set{name}Coordinates")(numpy_to_vtk(places, deep=1))
    data = grid.GetCellData() if cells else grid.GetPointData()
    for name, values in (("letter", F.ravel()), ("wind", COLORS.reshape(-1, 3).astype(np.float32))):
        array = numpy_to_vtk(values, deep=1)
        array.SetName(name)
        data.AddArray(array)
    return grid


@pytest.mark.few(32)
@pytest.mark.parametrize("mode", ["Ascii", "Binary", "Appended"])
@pytest.mark.parametrize("compressor", [0, 1, 2, 3], ids=["plain", "zlib", "lz4", "lzma"])
@pytest.mark.parametrize("cells", [False, True], ids=["points", "cells"])
@pytest.mark.parametrize("kind", ["vti", "vtr"])
def test_files_of_vtk(tmp_path: Path, kind: str, cells: bool, compressor: int, mode: str) -> None:
    grid = vtk_grid(kind, cells)
    import vtk

    writer = vtk.vtkXMLImageDataWriter() if kind == "vti" else vtk.vtkXMLRectilinearGridWriter()
    writer.SetFileName(str(tmp_path / f"letter.{kind}"))
    writer.SetInputData(grid)
    getattr(writer, f"SetDataModeTo{mode}")()
    writer.SetCompressorType(compressor)
    assert writer.Write()
    volume = load(tmp_path / f"letter.{kind}")
    np.testing.assert_array_equal(volume.samples, F)
    np.testing.assert_array_equal(volume.vectors, COLORS)
    np.testing.assert_allclose(volume.spacing, SPACING)
    # the middle of the first cell, or the first point, as VTK has it
    first = (
        np.array(grid.GetCell(0).GetBounds() if cells else np.repeat(grid.GetPoint(0), 2)).reshape(3, 2).mean(axis=1)
    )
    np.testing.assert_allclose(volume.origin, first)


@pytest.mark.parametrize("cells", [False, True], ids=["points", "cells"])
@pytest.mark.parametrize("kind", ["vti", "vtr"])
def test_pieces_in_several_files(tmp_path: Path, kind: str, cells: bool) -> None:
    grid = vtk_grid(kind, cells)
    import vtk

    writer = vtk.vtkXMLPImageDataWriter() if kind == "vti" else vtk.vtkXMLPRectilinearGridWriter()
    path = tmp_path / f"letter.p{kind}"
    writer.SetFileName(str(path))
    writer.SetInputData(grid)
    writer.SetNumberOfPieces(3)
    writer.SetEndPiece(2)
    writer.Write()
    np.testing.assert_array_equal(load(path).samples, F)
    text = path.read_text()
    (tmp_path / "in").mkdir()
    (tmp_path / "in" / path.name).write_text(text.replace('Source="', 'Source="../'))
    with pytest.raises(InputError, match="--anywhere"):
        load(tmp_path / "in" / path.name)
    np.testing.assert_array_equal(load(tmp_path / "in" / path.name, anywhere=True).samples, F)


AXES = (
    *('<DataArray type="Float64" format="ascii">0 1 2 3 4</DataArray>',),
    '<DataArray type="Float64" format="ascii">0 2 4 6 8 10 12</DataArray>',
    '<DataArray type="Float64" format="ascii">{z}</DataArray>',
)


def vtr(path: Path, samples: np.ndarray = F, z: str = "9 6 3 0") -> Path:
    numbers = " ".join(map(str, samples.ravel()))
    path.write_text(
        '<VTKFile type="RectilinearGrid"><RectilinearGrid WholeExtent="0 4 0 6 0 3">'
        '<Piece Extent="0 4 0 6 0 3"><PointData>'
        f'<DataArray type="UInt8" Name="a" format="ascii">{numbers}</DataArray></PointData><Coordinates>'
        f"{''.join(AXES).format(z=z)}</Coordinates></Piece></RectilinearGrid></VTKFile>"
    )
    return path


def test_rectilinear_grids(tmp_path: Path) -> None:
    volume = load(vtr(tmp_path / "letter.vtr"))
    np.testing.assert_array_equal(volume.samples, F)
    assert volume.spacing == (1, 2, 3) and volume.origin == (0, 0, 9)
    np.testing.assert_array_equal(volume.direction, np.diag([1, 1, -1]))
    uneven = vtr(tmp_path / "letter.vtr", z="0 1 2 9")
    assert load(uneven).shape == (10, 7, 5) and load(uneven, spacing=(1, 2, 3)).shape == F.shape
    with pytest.raises(InputError, match="coordinate z: expected coordinates that rise or fall throughout"):
        load(vtr(tmp_path / "letter.vtr", z="0 1 1 9"))


UNEVEN = np.array([0.0, 1, 2, 5, 9.3]), np.array([5.0, 3, 1, -4, -5, -6.5]), np.array([-2.0, 0, 1, 4])


@pytest.mark.parametrize("cells", [False, True], ids=["points", "cells"])
def test_uneven_grids_of_vtk_are_resampled(tmp_path: Path, cells: bool) -> None:
    """A linear field is exact; the error of another one at the file's points is the one that is told."""
    vtk = pytest.importorskip("vtk")
    from vtk.util.numpy_support import numpy_to_vtk

    grid = vtk.vtkRectilinearGrid()
    grid.SetDimensions(*map(len, UNEVEN))
    for name, places in zip("XYZ", UNEVEN, strict=True):
        getattr(grid, f"Set{name}Coordinates")(numpy_to_vtk(places, deep=1))
    own = [(each[1:] + each[:-1]) / 2 if cells else each for each in UNEVEN]
    z, y, x = np.meshgrid(*own[::-1], indexing="ij")
    fields = {"line": x + 10 * y - 3 * z, "wave": np.sin(x * 1.3) * np.cos(y + z)}
    data = grid.GetCellData() if cells else grid.GetPointData()
    for name, values in (*fields.items(), ("wind", np.stack([x, y, z], axis=-1).reshape(-1, 3))):
        array = numpy_to_vtk(values.reshape(-1, values.shape[-1] if name == "wind" else 1), deep=1)
        array.SetName(name)
        data.AddArray(array)
    kinds = (("a.vtr", vtk.vtkXMLRectilinearGridWriter()), ("a.vtk", vtk.vtkRectilinearGridWriter()))
    for name, writer in kinds:
        writer.SetFileName(str(tmp_path / name))
        writer.SetInputData(grid)
        assert writer.Write()
    volume, legacy = load(tmp_path / "a.vtr"), load(tmp_path / "a.vtk")
    np.testing.assert_allclose(volume.samples, legacy.samples, rtol=1e-5, atol=1e-5)
    assert volume.notes[0] == legacy.notes[0] and volume.spacing == legacy.spacing
    places = np.moveaxis(np.indices(volume.shape)[::-1], 0, -1) @ volume.world_from_index.T + volume.origin
    np.testing.assert_allclose(volume.samples, places @ (1, 10, -3), rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(volume.vectors, places, rtol=1e-6, atol=1e-6)
    assert volume.direction[1, 1] == -1 and volume.notes[0].endswith("; RMSE at its own points 0 % of the range")
    least = [min(abs(np.diff(each))) for each in own]
    assert all(step / 1.3 < length < step * 1.01 for length, step in zip(volume.spacing, least, strict=True))
    # the error that is told, by another interpolation
    wave = load(tmp_path / "a.vtr", array="wave")
    at = [
        (each - start) / step
        for each, start, step in zip(own, wave.origin, np.diag(wave.world_from_index), strict=True)
    ]
    ndimage = pytest.importorskip("scipy.ndimage")
    back = ndimage.map_coordinates(np.asarray(wave.samples), np.meshgrid(*at[::-1], indexing="ij"), order=1)
    error = np.sqrt(np.mean((back - fields["wave"]) ** 2)) / np.ptp(fields["wave"])
    assert wave.notes[0].endswith(f"; RMSE at its own points {100 * error:.2g} % of the range") and error > 1e-3


def listed(path: Path, kind: str, entries: str) -> Path:
    path.write_text(f'<VTKFile type="{kind}" version="1.0"><{kind}>{entries}</{kind}></VTKFile>')
    return path


def test_time_series_and_blocks(tmp_path: Path) -> None:
    for n in range(3):
        vtr(tmp_path / f"{n}.vtr", F + n)
    steps = "".join(f'<DataSet timestep="{10 - n}" file="{n}.vtr"/>' for n in range(3))
    series = listed(tmp_path / "letter.pvd", "Collection", steps)
    # in the order of time
    first = load(series)
    assert (first.times, first.notes[-1]) == (3, "time 0 of 3: --time picks another")
    np.testing.assert_array_equal(first.samples, F + 2)
    for options in ({"time": 1}, {"time": 1, "array": "a"}, {"array": 1}):
        np.testing.assert_array_equal(load(series, **options).samples, F + 1)
    with pytest.raises(InputError, match=r"time: expected a number from 0 to 2, or a time such as .*, got 3"):
        load(series, time=3)
    np.testing.assert_array_equal(load(series, array="2/a").samples, F)
    pytest.importorskip("vtk", reason="reads blocks")
    blocks = '<Block index="0" name="b"><DataSet index="0" name="one" file="0.vtr"/></Block>'
    blocks += '<DataSet index="1" name="two" file="1.vtr"/><DataSet index="2" name="mesh" file="2.vtp"/>'
    (tmp_path / "2.vtp").write_text(
        '<VTKFile type="PolyData"><PolyData><Piece NumberOfPoints="0"/></PolyData></VTKFile>'
    )
    several = listed(tmp_path / "letter.vtm", "vtkMultiBlockDataSet", blocks)
    for name in ("two", 1, "two/a", "1/a"):
        np.testing.assert_array_equal(load(several, array=name).samples, F + 1)
    with pytest.raises(InputError, match=r"blocks: expected one, got 2: 0 \(one\), 1 \(two\)"):
        load(several)
    with pytest.raises(InputError, match="time: expected a file of several time points, got 1"):
        load(several, array=1, time=1)
    with pytest.raises(InputError, match="a name inside the header's folder"):
        load(listed(tmp_path / "b.pvd", "Collection", '<DataSet file="../x.vtr"/>'))
    with pytest.raises(InputError, match=r"x\.vtp: expected a file of .*--mesh"):
        load(listed(tmp_path / "c.pvd", "Collection", '<DataSet file="x.vtp"/>'))


# --- formats that are not read ---------------------------------------------------------------------------------------


def test_formats_that_are_not_read_say_what_converts_them(tmp_path: Path) -> None:
    read = {suffix for form in FORMATS for suffix in form.suffixes}
    assert not read & set(CONVERTERS)
    for suffix, fix in CONVERTERS.items():
        (tmp_path / f"a{suffix}").write_bytes(b"data")
        with pytest.raises(InputError) as caught:
            load(tmp_path / f"a{suffix}")
        assert str(caught.value).endswith(f"format: expected one that is read, got '{suffix}'; {fix}")


def test_phantom_is_checked(tmp_path: Path) -> None:
    """The plain grid where a file has none."""
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "letter.hdf5", "w") as file:
        file["a"] = F
    check(load(tmp_path / "letter.hdf5"), grid=False, frame=None, mapped=True)
