"""Unstructured grids and AMR, written by VTK itself and resampled: a linear field is exact, the error is told."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from splatgl.data.volume import Volume
from splatgl.errors import InputError
from splatgl.fileio import within
from splatgl.readers import load, vtk_files

vtk = pytest.importorskip("vtk")
SLOPE = np.array([1.0, 10, -3])


def line(places: np.ndarray) -> np.ndarray:
    return np.asarray(places @ SLOPE + 2)


def centers(volume: Volume) -> np.ndarray:
    """Places [D, H, W, 3] of the voxels."""
    index = np.moveaxis(np.indices(volume.shape)[::-1], 0, -1)
    return np.asarray(index @ volume.world_from_index.T + volume.origin)


def mesh(kind: str) -> Any:
    """A box of uneven hexahedra or tetrahedra, with a linear field and a wave of points, and numbers of cells."""
    from vtk.util.numpy_support import numpy_to_vtk, vtk_to_numpy

    axes = [np.array([0, 0.5, 1, 2, 4]), np.array([1.0, 2, 3.5]), np.array([-1.0, 0, 0.5, 1.5])]
    grid = vtk.vtkRectilinearGrid()
    grid.SetDimensions(*map(len, axes))
    for name, each in zip("XYZ", axes, strict=True):
        getattr(grid, f"Set{name}Coordinates")(numpy_to_vtk(each.astype(float), deep=1))
    if kind == "tetrahedra":
        split = vtk.vtkRectilinearGridToTetrahedra()
        split.SetInputData(grid)
    else:
        split = vtk.vtkAppendFilter()
        split.AddInputData(grid)
    split.Update()
    out = split.GetOutput()
    places = vtk_to_numpy(out.GetPoints().GetData()).astype(float)
    cells = np.arange(out.GetNumberOfCells(), dtype=float)
    for data, name, values in (
        (out.GetPointData(), "line", line(places)),
        (out.GetPointData(), "wave", np.sin(2 * places.sum(axis=1))),
        (out.GetCellData(), "number", cells),
    ):
        array = numpy_to_vtk(values, deep=1)
        array.SetName(name)
        data.AddArray(array)
    return out


def save(writer: Any, path: Path, data: Any) -> Path:
    writer.SetFileName(str(path))
    writer.SetInputData(data)
    assert writer.Write()
    return path


@pytest.mark.parametrize("mode", ["Ascii", "Appended"])
@pytest.mark.parametrize("kind", ["hexahedra", "tetrahedra"])
def test_unstructured_grids(tmp_path: Path, kind: str, mode: str) -> None:
    writer = vtk.vtkXMLUnstructuredGridWriter()
    getattr(writer, f"SetDataModeTo{mode}")()
    data = mesh(kind)
    volume = load(save(writer, tmp_path / "a.vtu", data))
    np.testing.assert_allclose(volume.samples, line(centers(volume)), atol=1e-4)
    cells = data.GetNumberOfCells()
    assert re.match(rf"{cells} cells, resampled to \d+×\d+×\d+ voxels; RMSE at its own points 0 % of", volume.notes[0])
    np.testing.assert_allclose([volume.corners.min(axis=0), volume.corners.max(axis=0)], [[0, 1, -1], [4, 3.5, 1.5]])
    # the smallest cell is .5 × 1 × .5
    np.testing.assert_allclose(volume.spacing, (0.5, 2.5 / 3, 0.5))
    wave = load(tmp_path / "a.vtu", array="wave")
    assert float(wave.notes[0].split("points ")[1].split(" %")[0]) > 1
    # VTK's own value in the middle of each voxel
    number = load(tmp_path / "a.vtu", array="number")
    places = centers(number)
    for index in ((0, 0, 0), (2, 1, 3), (4, 2, 7)):
        at = data.FindCell(places[index].tolist(), None, 0, 1e-9, vtk.reference(0), [0.0] * 3, [0.0] * 30)
        assert number.samples[index] == at


@pytest.mark.parametrize("version", [42, 51])
@pytest.mark.parametrize("coding", ["ASCII", "Binary"])
def test_legacy_cells(tmp_path: Path, coding: str, version: int) -> None:
    """As in XML; a file that is cut is refused, where VTK returns any values."""
    want = load(save(vtk.vtkXMLUnstructuredGridWriter(), tmp_path / "a.vtu", mesh("tetrahedra")))
    writer = vtk.vtkUnstructuredGridWriter()
    getattr(writer, f"SetFileTypeTo{coding}")()
    writer.SetFileVersion(version)
    path = save(writer, tmp_path / "a.vtk", mesh("tetrahedra"))
    volume = load(path)
    np.testing.assert_allclose(volume.samples, want.samples, rtol=1e-5, atol=1e-4)
    assert volume.spacing == want.spacing and volume.notes[0] == want.notes[0]
    data = path.read_bytes()
    for end in (data.index(b"CELL_TYPES") + 30, data.index(b"POINT_DATA") + 200):
        path.write_bytes(data[:end])
        with pytest.raises(InputError, match=r"cut short|damaged"):
            load(path)


@pytest.mark.parametrize("encoded", [True, False], ids=["base64", "raw"])
def test_cut_arrays_are_refused(tmp_path: Path, encoded: bool) -> None:
    """VTK returns any values for the missing bytes of an uncompressed array."""
    writer = vtk.vtkXMLUnstructuredGridWriter()
    writer.SetCompressorTypeToNone()
    writer.SetEncodeAppendedData(encoded)
    path = save(writer, tmp_path / "a.vtu", mesh("hexahedra"))
    data = path.read_bytes()
    assert load(path).samples.size
    end = data.rindex(b"</AppendedData>")
    for changed in (data[: end - 20], data[: end - 20] + data[end:]):
        path.write_bytes(changed)
        with pytest.raises(InputError, match="the file is cut short or its header states a wrong size"):
            load(path)


def test_gaps_between_pieces_are_refused(tmp_path: Path) -> None:
    """VTK returns any values there."""
    writer = vtk.vtkXMLStructuredGridWriter()
    writer.SetDataModeToAscii()
    text = save(writer, tmp_path / "a.vts", curved()).read_text()
    piece = text[text.index("<Piece") : text.index("</Piece>") + 8]
    more = piece.replace('Extent="0 5 0 2 0 3"', 'Extent="7 12 0 2 0 3"')
    assert more != piece
    (tmp_path / "a.vts").write_text(text.replace(piece, piece + more).replace('WholeExtent="0 5', 'WholeExtent="0 12'))
    with pytest.raises(InputError, match="pieces: expected a whole grid, got gaps between them"):
        load(tmp_path / "a.vts")


@pytest.mark.parametrize("number", ["9223372036854775807", "1e30", "9" * 400])
def test_numbers_that_vtk_counts_up_to_are_limited(number: str, tmp_path: Path) -> None:
    writer = vtk.vtkXMLPUnstructuredGridWriter()
    writer.SetDataModeToAscii()
    text = save(writer, tmp_path / "a.pvtu", mesh("hexahedra")).read_text()
    changed = text.replace('NumberOfComponents="3"', f'NumberOfComponents="{number}"')
    assert changed != text
    (tmp_path / "a.pvtu").write_text(changed)
    with pytest.raises(InputError, match="NumberOfComponents: expected") as caught:
        load(tmp_path / "a.pvtu")
    assert len(str(caught.value)) < 400


def test_cells_in_a_time_series(tmp_path: Path) -> None:
    save(vtk.vtkXMLUnstructuredGridWriter(), tmp_path / "a.vtu", mesh("hexahedra"))
    steps = "".join(f'<DataSet timestep="{n}" file="a.vtu"/>' for n in range(2))
    (tmp_path / "a.pvd").write_text(f'<VTKFile type="Collection"><Collection>{steps}</Collection></VTKFile>')
    series, alone = load(tmp_path / "a.pvd", time=1, array="wave"), load(tmp_path / "a.vtu", array="wave")
    assert series.times == 2 and series.spacing == alone.spacing
    np.testing.assert_array_equal(series.samples, alone.samples)


def curved() -> Any:
    """A bent block of 6 × 3 × 4 points with a linear field, flow along it, and numbers of cells."""
    from vtk.util.numpy_support import numpy_to_vtk

    z, y, x = np.indices((4, 3, 6)) * 1.0
    places = np.stack([x + 0.3 * y, y + 0.1 * z, z + 0.2 * x], axis=-1).reshape(-1, 3)
    grid, points = vtk.vtkStructuredGrid(), vtk.vtkPoints()
    points.SetData(numpy_to_vtk(places, deep=1))
    grid.SetDimensions(6, 3, 4)
    grid.SetPoints(points)
    for name, values in (("flow", np.stack([line(places), places[:, 0], 0 * places[:, 0]], 1)), ("line", line(places))):
        array = numpy_to_vtk(values, deep=1)
        array.SetName(name)
        grid.GetPointData().AddArray(array)
    return grid


def test_curved_grids_and_vectors(tmp_path: Path) -> None:
    volume = load(save(vtk.vtkXMLStructuredGridWriter(), tmp_path / "a.vts", curved()))
    inside = ~np.isnan(volume.samples)
    assert 0.3 < inside.mean() < 1 and volume.notes[0].startswith("30 cells, resampled to ")
    np.testing.assert_allclose(volume.samples[inside], line(centers(volume))[inside], atol=1e-4)
    assert volume.vectors is not None
    right = np.stack([line(centers(volume)), centers(volume)[..., 0], 0 * volume.samples], -1)
    np.testing.assert_allclose(volume.vectors[inside], right[inside], atol=1e-4)
    assert not volume.vectors[~inside].any()
    speed = load(tmp_path / "a.vts", array="flow")
    lengths = np.linalg.norm(right, axis=-1)[inside]
    # interpolated lengths are beside lengths of interpolated vectors
    assert np.abs(speed.samples[inside] - lengths).max() < 0.1 * lengths.max() and speed.hints.preset == "field"
    (tmp_path / "b.xml").write_bytes((tmp_path / "a.vts").read_bytes())
    assert load(tmp_path / "b.xml").shape == volume.shape


@pytest.mark.parametrize("kind", ["UnstructuredGrid", "StructuredGrid"])
def test_pieces_of_cells_are_joined(tmp_path: Path, kind: str) -> None:
    """Two pieces that share a layer of cells: the second marks it as the first one's, and its values count nowhere."""
    from vtk.util.numpy_support import numpy_to_vtk, vtk_to_numpy

    ending, whole = {"UnstructuredGrid": ("vtu", mesh("hexahedra"))}.get(kind, ("vts", curved()))
    writer = getattr(vtk, f"vtkXML{kind}Writer")
    if kind == "StructuredGrid":
        for n, extent in enumerate([(0, 3, 0, 2, 0, 3), (2, 5, 0, 2, 0, 3)]):
            part = vtk.vtkExtractGrid()
            part.SetInputData(whole)
            part.SetVOI(*extent)
            part.Update()
            parts = part.GetOutput()
            marks = numpy_to_vtk((n * (np.arange(18) % 3 == 0)).astype(np.uint8), deep=1)
            marks.SetName("vtkGhostType")
            parts.GetCellData().AddArray(marks)
            save(writer(), tmp_path / f"{n}.{ending}", parts)
    else:
        x = np.array([whole.GetCell(n).GetBounds()[0] for n in range(whole.GetNumberOfCells())])
        for n, wanted in enumerate([x < 1.5, x > 0.9]):
            part = vtk.vtkExtractCells()
            part.SetInputData(whole)
            ids = vtk.vtkIdList()
            for number in np.flatnonzero(wanted).tolist():
                ids.InsertNextId(number)
            part.SetCellList(ids)
            part.Update()
            parts = part.GetOutput()
            twice = vtk_to_numpy(parts.GetCellData().GetArray("number")).copy()
            marks = numpy_to_vtk((n * (x[twice.astype(int)] < 1.5)).astype(np.uint8), deep=1)
            marks.SetName("vtkGhostType")
            parts.GetCellData().AddArray(marks)
            save(writer(), tmp_path / f"{n}.{ending}", parts)
    extents = ("0 3 0 2 0 3", "2 5 0 2 0 3")
    pieces = "".join(f'<Piece Extent="{extent}" Source="{n}.{ending}"/>' for n, extent in enumerate(extents))
    points, cells = {"vtu": (("line", "wave"), ("number",)), "vts": (("flow", "line"), ())}[ending]
    lists = [
        f"<P{owner}>"
        + "".join(
            f'<PDataArray type="{"UInt8" if name == "vtkGhostType" else "Float64"}" Name="{name}" {size}/>'
            for name in names
        )
        + f"</P{owner}>"
        for owner, names, size in (
            ("PointData", [name for name in points if name != "flow"], ""),
            ("CellData", (*cells, "vtkGhostType"), ""),
            ("Points", ["Points"], 'NumberOfComponents="3"'),
        )
    ]
    whole_extent = 'WholeExtent="0 5 0 2 0 3"'
    text = f'<VTKFile type="P{kind}"><P{kind} {whole_extent}>{"".join(lists)}{pieces}</P{kind}></VTKFile>'
    (tmp_path / f"a.p{ending}").write_text(text)
    joined, alone = load(tmp_path / f"a.p{ending}"), load(save(writer(), tmp_path / f"b.{ending}", whole))
    np.testing.assert_allclose(joined.samples, alone.samples, atol=1e-4)
    assert joined.spacing == pytest.approx(alone.spacing)
    assert joined.notes[0].split(",")[0] == alone.notes[0].split(",")[0]
    (tmp_path / f"a.p{ending}").write_text(text.replace("0.", "../0."))
    with pytest.raises(InputError, match="folder"):
        load(tmp_path / f"a.p{ending}")


def test_grids_of_cells_fit_in_memory(tmp_path: Path) -> None:
    path = save(vtk.vtkXMLUnstructuredGridWriter(), tmp_path / "a.vtu", mesh("hexahedra"))
    with within(64 * 60):
        volume = load(path)
    assert 20 < volume.count <= 60
    np.testing.assert_allclose(volume.samples, line(centers(volume)), atol=1e-4)


def test_bad_cells(tmp_path: Path) -> None:
    writer = vtk.vtkXMLUnstructuredGridWriter()
    writer.SetDataModeToAscii()
    text = save(writer, tmp_path / "a.vtu", mesh("hexahedra")).read_text()
    types = text.index('Name="types"')
    for changed, said in (
        (
            re.sub(r'(Name="connectivity"[^>]*>\s*)0 ', r"\g<1>9999 ", text),
            "Cells: expected numbers of 60 points",
        ),
        (text[:types] + text[types:].replace("11 11", "42 11", 1), "types: expected polyhedra with faces, got none"),
        (text[:types] + text[types:].replace("11 11", "10 11", 1), "other numbers of points"),
        (text[:types] + text[types:].replace("11", "9"), "got flat ones; it is a surface"),
        (
            text[:types] + text[types:].replace("11 11", "200 11", 1),
            "types: expected cells that VTK knows, got number 200",
        ),
        (text.replace('NumberOfCells="', 'NumberOfCells="-'), "cannot be read: .*; the file may be damaged"),
        (text.replace('Points="60"', 'Points="59.5"'), "Cells: expected numbers of 59 points"),
    ):
        (tmp_path / "a.vtu").write_text(changed)
        with pytest.raises(InputError, match=said):
            load(tmp_path / "a.vtu")


def amr(path: Path, points: bool = False) -> Path:
    """Two levels: a box of 6 × 4 × 4 cells of size 1, and a finer block in it, with a linear field of the places."""
    from vtk.util.numpy_support import numpy_to_vtk

    whole = vtk.vtkOverlappingAMR()
    # in VTK up to 9.4 with the number of levels
    whole.Initialize(2, [1, 1]) if vtk.vtkVersion().GetVTKMinorVersion() < 5 else whole.Initialize([1, 1])
    whole.SetOrigin([1.0, 2, 3])
    # three dimensions
    whole.SetGridDescription(8)
    for level, (low, sizes) in enumerate((((0, 0, 0), (6, 4, 4)), ((4, 2, 2), (4, 4, 2)))):
        step = 1 / 2**level
        whole.SetSpacing(level, [step] * 3)
        grid = vtk.vtkUniformGrid()
        start = np.array([1.0, 2, 3]) + np.array(low) * step
        grid.SetOrigin(*start)
        grid.SetSpacing(step, step, step)
        grid.SetDimensions(*(size + 1 for size in sizes))
        counts = np.array(sizes) + points
        index = np.moveaxis(np.indices(tuple(counts[::-1].tolist()))[::-1], 0, -1)
        values = numpy_to_vtk(line(start + (index + 0.5 * (not points)) * step).ravel(), deep=1)
        values.SetName("density")
        (grid.GetPointData() if points else grid.GetCellData()).AddArray(values)
        high = np.array(low) + sizes - 1
        whole.SetAMRBox(level, 0, vtk.vtkAMRBox(list(low), high.tolist()))
        whole.SetDataSet(level, 0, grid)
    return save(vtk.vtkXMLUniformGridAMRWriter(), path, whole)


def test_amr_of_cells(tmp_path: Path) -> None:
    volume = load(amr(tmp_path / "a.vthb"))
    assert volume.shape == (8, 8, 12) and volume.spacing == (0.5, 0.5, 0.5) and volume.origin == (1.25, 2.25, 3.25)
    places = centers(volume)
    fine = np.s_[2:4, 2:6, 4:8]
    np.testing.assert_allclose(volume.samples[fine], line(places[fine]))
    # a coarse cell has one value
    corner = np.array([1.0, 2, 3])
    coarse = line(np.floor(places - corner) + corner + 0.5)
    coarse[fine] = line(places[fine])
    np.testing.assert_allclose(volume.samples, coarse)
    assert volume.notes[0].startswith("2 blocks of 2 levels, resampled to 12×8×8 voxels; RMSE at its own points ")
    # beside VTK's own resampling
    reader = vtk.vtkXMLUniformGridAMRReader()
    reader.SetFileName(str(tmp_path / "a.vthb"))
    reader.SetMaximumLevelsToReadByDefault(0)
    resample = vtk.vtkResampleToImage()
    resample.SetInputConnection(reader.GetOutputPort())
    resample.UseInputBoundsOff()
    resample.SetSamplingBounds(1.25, 6.75, 2.25, 5.75, 3.25, 6.75)
    resample.SetSamplingDimensions(12, 8, 8)
    resample.Update()
    from vtk.util.numpy_support import vtk_to_numpy

    theirs = vtk_to_numpy(resample.GetOutput().GetPointData().GetArray("density")).reshape(volume.shape)
    np.testing.assert_allclose(volume.samples, theirs)


def test_amr_of_points(tmp_path: Path) -> None:
    volume = load(amr(tmp_path / "a.vthb", points=True))
    assert volume.shape == (9, 9, 13) and volume.origin == (1, 2, 3)
    np.testing.assert_allclose(volume.samples, line(centers(volume)))
    assert volume.notes[0].endswith("RMSE at its own points 0 % of the range")


def test_files_of_cells_are_known_by_their_contents(tmp_path: Path) -> None:
    path = save(vtk.vtkXMLUnstructuredGridWriter(), tmp_path / "a.vtu", mesh("hexahedra"))
    want = load(path).samples
    np.testing.assert_array_equal(load(path.rename(tmp_path / "scan")).samples, want)


def test_steps_of_damaged_cells_give_few_voxels() -> None:
    for span, steps in ((1e30, 1e-300), (1.0, np.nan), (0.0, 0.0), (np.inf, 1.0)):
        counts = vtk_files.even_counts(np.array([1.0, 1.0, span]), np.array([1.0, 1.0, steps]), 8)
        assert counts.min() >= 1 and counts.prod() <= vtk_files._FREE_VOXELS
