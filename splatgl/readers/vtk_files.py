"""Files that VTK reads, and PyVista with it, in another process: grids of cells, pieces, blocks, AMR, VTKHDF, series.

Grids of cells and AMR are resampled to even ones, whose steps are those of the smallest cell, or larger ones where the
grid would exceed the budget of voxels or of memory; a note states the error at the file's own points.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from splatgl.data.affine import describe_error
from splatgl.data.times import Times
from splatgl.data.volume import Volume, triple
from splatgl.errors import InputError, expected, import_extra, list_names
from splatgl.fileio import budget
from splatgl.readers.channels import ChannelSet
from splatgl.readers.common import Shape, decoder_errors
from splatgl.readers.elsewhere import call
from splatgl.readers.hdf5_files import check_group
from splatgl.readers.options import SURFACE, LoadOptions
from splatgl.readers.vtk_arrays import MARKS, PointArray, Selection, count_cells, select_arrays
from splatgl.readers.vtk_xml import check_xml

# most voxels: so many per cell, but at least and at most these numbers, within the memory of so many bytes per voxel
_MOST_FINER, _FREE_VOXELS, _MOST_VOXELS, _VOXEL_BYTES = 64, 2**15, 2**24, 64
# largest coordinate
_MOST_PLACE = 1e30
# bits of VTK's marks of cells that another piece or a finer level has, too
_COVERED = 1 | 8
# first kind of cells without a fixed number of points, and polyhedra
_FREE, _POLYHEDRON = 41, 42
_GRIDS = ("vtkImageData", "vtkRectilinearGrid", "vtkStructuredGrid", "vtkUnstructuredGrid", "vtkExplicitStructuredGrid")
# the group in HDF5 that VTK reads
HDF = "VTKHDF"
# what VTK says of a file
_ERROR = re.compile(r"(?:ERROR|Warning): In [^\n]*\n(?:[^\n(]*\([^\n)]*\): )?([^\n]*)")


def read(path: Path, options: LoadOptions) -> Volume:
    """The volume of a file of VTK; `array` names a block, an array, or both, as in 3/density, `channel` picks a
    component, `time` a step. What lies outside of all cells is NaN.
    """
    with path.open("rb") as file:
        size = check_xml(path, options.anywhere) if file.read(16).lstrip()[:1] == b"<" else path.stat().st_size
    volume: Volume = call("vtk_files.read_data", size, path, options)
    return volume


def read_hdf5(path: Path, file: Any, options: LoadOptions) -> Volume:
    """The volume in the group HDF of an open file of HDF5; options as in `read`."""
    check_group(file, HDF, options.anywhere)
    file.close()
    volume: Volume = call("vtk_files.read_data", path.stat().st_size, path, options)
    return volume


def read_with_pyvista(path: Path, options: LoadOptions) -> Volume:
    """The volume of a file of a simulation that PyVista knows; options as in `read`."""
    size = sum(file.stat().st_size for file in path.parent.iterdir() if file.is_file())
    volume: Volume = call("vtk_files.read_data", size, path, options, True)
    return volume


# --- in the other process ---------------------------------------------------------------------------------------------


def read_data(path: Path, options: LoadOptions, with_pyvista: bool = False) -> Volume:
    """The volume of a file, read in this process."""
    with decoder_errors("VTK"):
        return _read_data(path, options, with_pyvista)


def _read_data(path: Path, options: LoadOptions, with_pyvista: bool) -> Volume:
    reader = open_reader(path, with_pyvista)
    with vtk_errors():
        reader.UpdateInformation()
    key = import_extra("vtkmodules.vtkCommonExecutionModel", "", "vtk", "vtk").vtkStreamingDemandDrivenPipeline
    steps = reader.GetOutputInformation(0).Get(key.TIME_STEPS()) or ()

    def read_step(_: int | None) -> Volume:
        with vtk_errors():
            reader.UpdateTimeStep(steps[options.point]) if steps else reader.Update()
        return _convert(reader.GetOutputDataObject(0), replace(options, time=None))

    moments = Times.of(map(float, steps)) if len(steps) > 1 else None
    return ChannelSet(times=max(len(steps), 1), moments=moments, components=2**20).volume(options, read_step)


def open_reader(path: Path, with_pyvista: bool = False) -> Any:
    """VTK's reader of a file. Raises InputError, which names the extra, without VTK or PyVista."""
    if with_pyvista:
        pyvista = import_extra("pyvista", f"{path.suffix} files", "pyvista", "pyvista")
        with decoder_errors("a format of PyVista"):
            return pyvista.get_reader(str(path)).reader
    with path.open("rb") as file:
        head = file.read(1024)
    if head.lstrip()[:1] == b"<":
        module, name = "vtkIOXML", "vtkXMLGenericDataObjectReader"
        if re.search(rb"type=.vtk\w*(AMR|HierarchicalBox)", head):
            name = "vtkXMLUniformGridAMRReader"
    else:
        is_legacy = head.lower().startswith(b"# vtk")
        module, name = ("vtkIOLegacy", "vtkGenericDataObjectReader") if is_legacy else ("vtkIOHDF", "vtkHDFReader")
    reader = getattr(import_extra(f"vtkmodules.{module}", "grids of cells and blocks", "vtk", "vtk"), name)()
    reader.SetFileName(str(path))
    if "AMR" in name:
        # all levels
        reader.SetMaximumLevelsToReadByDefault(0)
    return reader


@contextmanager
def vtk_errors() -> Iterator[None]:
    """Raises InputError for what VTK says to be an error."""
    from vtkmodules.vtkCommonCore import vtkOutputWindow, vtkStringOutputWindow

    window = vtkStringOutputWindow()
    vtkOutputWindow.SetInstance(window)
    yield
    said = _ERROR.findall(window.GetOutput()) if "error" in window.GetOutput().lower() else []
    if said:
        raise InputError(f"cannot be read by VTK: {said[0].strip(' .')[:200]}; the file may be damaged")


def leaves(data: Any) -> Iterator[tuple[str, Any]]:
    """Data sets in a tree of blocks, and their names."""
    from vtkmodules.vtkCommonDataModel import vtkCompositeDataSet

    if not data.IsA("vtkCompositeDataSet"):
        yield "", data
        return
    steps = data.NewIterator()
    steps.InitTraversal()
    while not steps.IsDoneWithTraversal():
        name = steps.GetCurrentMetaData().Get(vtkCompositeDataSet.NAME()) if steps.HasCurrentMetaData() else ""
        yield name or "", steps.GetCurrentDataObject()
        steps.GoToNextItem()


def _convert(data: Any, options: LoadOptions) -> Volume:
    """The volume of a data object of VTK."""
    if data is None:
        raise expected("file", "data that VTK reads", "none", "the file may be damaged")
    every = list(leaves(data))
    entries = [(name, leaf) for name, leaf in every if any(map(leaf.IsA, _GRIDS)) and leaf.GetNumberOfCells() > 0]
    if not entries:
        is_surface = any(leaf.IsA("vtkPolyData") for _, leaf in every)
        raise expected("data", "cells", "a surface" if is_surface else "none", SURFACE if is_surface else "")
    if data.IsA("vtkUniformGridAMR"):
        return _resample(data, [leaf for _, leaf in entries], options)
    if data.IsA("vtkPartitionedDataSet") and len(entries) > 1:
        from vtkmodules.vtkFiltersCore import vtkAppendFilter

        joined = vtkAppendFilter()
        for _, leaf in entries:
            joined.AddInputData(leaf)
        joined.Update()
        entries = [("", joined.GetOutput())]
    leaf, array = entries[0][1], options.array
    if data.IsA("vtkCompositeDataSet"):
        leaf, array = select_entry(entries, options, "blocks")
    options = replace(options, array=array)
    if leaf.IsA("vtkImageData") or leaf.IsA("vtkRectilinearGrid"):
        return _convert_even(leaf, options)
    return _resample(leaf, [leaf], options)


def _convert_even(data: Any, options: LoadOptions) -> Volume:
    """The volume of an image or a rectilinear grid."""
    w, h, d = data.GetDimensions()
    shape = (d, h, w)
    choice = select_arrays(
        list_arrays(data.GetPointData(), shape), list_arrays(data.GetCellData(), count_cells(shape)), options
    )
    if data.IsA("vtkRectilinearGrid"):
        places = [_numbers(axis) for axis in (data.GetXCoordinates(), data.GetYCoordinates(), data.GetZCoordinates())]
        return choice.rectilinear(places, even=options.spacing is not None)
    matrix = np.reshape(data.GetDirectionMatrix().GetData(), (3, 3)) * np.array(data.GetSpacing())
    origin = np.array(data.GetOrigin()) + matrix @ np.array(data.GetExtent()[::2])
    return choice.volume(matrix, origin, shape, "direction and spacing")


def _numbers(array: Any) -> np.ndarray:
    """An array of VTK, a view of its memory."""
    from vtkmodules.util.numpy_support import vtk_to_numpy

    return np.asarray(vtk_to_numpy(array)).view(np.ndarray)


def list_arrays(attributes: Any, shape: Shape) -> list[PointArray]:
    """The arrays of numbers of points or cells [D, H, W, components], views of VTK's memory."""
    active, vectors = attributes.GetScalars(), attributes.GetVectors()
    arrays = []
    for number in range(attributes.GetNumberOfArrays()):
        array = attributes.GetArray(number)
        # texts are no arrays of numbers
        if array is None or array.GetNumberOfTuples() != np.prod(shape):
            continue
        values, count = _numbers(array), array.GetNumberOfComponents()
        is_vectors = count == 3 and (values.dtype.kind == "f" or array is vectors)
        values = values.reshape(*shape, count)
        name = array.GetName() or f"array {number}"
        arrays.append(PointArray(name, count, is_vectors, values.view, values.dtype, array is active))
    return arrays


# --- grids of cells ---------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Part:
    """Cells of a leaf: the selected array; the smallest cell's sizes; the box; values at places [N, 3]."""

    choice: Selection
    cells: int
    smallest: np.ndarray
    box: np.ndarray
    places: np.ndarray
    values: np.ndarray


def _resample(data: Any, grids: list[Any], options: LoadOptions) -> Volume:
    """The volume of a grid of cells, or of AMR. grids: the leaves of `data`, whose arrays are replaced."""
    is_amr = data.IsA("vtkUniformGridAMR")
    solids, parts = [], []
    for grid in grids:
        choice = _keep_selected(grid, options)
        solids.append(_solid(grid))
        parts.append(_measure(solids[-1], choice))
    choice = parts[0].choice
    kinds = {(part.choice.of_cells, part.choice.vectors is None) for part in parts}
    if len(kinds) > 1:
        raise expected("blocks", "one array in all of them", "different arrays", "name one with array=NAME")
    # 1. the even grid: voxels of the smallest cell's size, at cells' centres or at AMR's points
    low, high = np.min([part.box[0] for part in parts], axis=0), np.max([part.box[1] for part in parts], axis=0)
    smallest = min((part.smallest for part in parts), key=np.prod)
    if (high <= low).any():
        raise expected("cells", "some with a volume", "flat ones", SURFACE)
    voxels = even_counts(high - low, smallest, sum(part.cells for part in parts))
    step, shift = (high - low) / voxels, 0.0 if is_amr and not choice.of_cells else 0.5
    voxels, start = voxels + (not shift), low + shift * step
    # 2. the values there, by VTK, and at the file's own points
    samples, vectors = _probe(data if is_amr else solids[0], (start, step, voxels), choice.vectors is not None)
    values = np.concatenate([part.values for part in parts])
    places = np.concatenate([part.places for part in parts])
    back = _trilinear(samples, ((places - start) / step)[:, ::-1])
    size = "×".join(map(str, voxels))
    what = f"{len(grids)} blocks" if is_amr else f"{parts[0].cells} cells"
    if is_amr:
        what += f" of {data.GetNumberOfLevels()} levels"
    note = f"{what}, resampled to {size} voxels; {describe_error(back, values)}"
    about = choice.about | {"notes": (note, *choice.about["notes"])}
    dtype = choice.samples.dtype if is_amr and not np.isnan(samples).any() else np.dtype(np.float32)
    spacing, origin = triple(step, "cells"), triple(start, "cells")
    return Volume(samples.astype(dtype), spacing, origin, vectors=vectors, **about)


def _keep_selected(grid: Any, options: LoadOptions) -> Selection:
    """Selects among the arrays of a grid, and leaves it `values` and `vectors` alone, with VTK's marks."""
    from vtkmodules.util.numpy_support import numpy_to_vtk

    owners = (grid.GetPointData(), grid.GetCellData())
    sizes = (grid.GetNumberOfPoints(), grid.GetNumberOfCells())
    choice = select_arrays(
        *(list_arrays(owner, (1, 1, size)) for owner, size in zip(owners, sizes, strict=True)), options
    )
    kept = [("values", choice.samples), *([] if choice.vectors is None else [("vectors", choice.vectors)])]
    arrays = [(name, np.array(values[0, 0], np.float64)) for name, values in kept]
    for owner in owners:
        for name in [owner.GetArrayName(number) for number in range(owner.GetNumberOfArrays())]:
            if name != MARKS[0]:
                owner.RemoveArray(name)
    for name, values in arrays:
        array = numpy_to_vtk(values, deep=1)
        array.SetName(name)
        owners[choice.of_cells].AddArray(array)
    return choice


def _solid(data: Any) -> Any:
    """The cells of a grid with three dimensions that no other piece or finer level has, a vtkUnstructuredGrid. Raises
    InputError for numbers that are no points, and for unknown cells.
    """
    from vtkmodules.vtkCommonDataModel import vtkGenericCell
    from vtkmodules.vtkFiltersCore import vtkAppendFilter, vtkThreshold

    if not data.IsA("vtkUnstructuredGrid"):
        append = vtkAppendFilter()
        append.AddInputData(data)
        append.Update()
        data = append.GetOutput()
    # 1. points, and their numbers
    offsets = corners(data.GetCells(), "Cells", len(finite_points(data)))[1]
    # 2. kinds of cells, by VTK's numbers (vtkCellType.h)
    kinds, cell = _numbers(data.GetCellTypesArray()).ravel(), vtkGenericCell()
    sizes, solid = np.diff(offsets), []
    for kind in np.unique(kinds).tolist():
        cell.SetCellType(kind)
        if kind and cell.GetCellType() != kind:
            raise expected("types", "cells that VTK knows", f"number {kind}", "the file may be damaged")
        if cell.GetCellDimension() == 3:
            solid.append(kind)
            if kind < _FREE and (sizes[kinds == kind] != cell.GetNumberOfPoints()).any():
                raise expected("cells", f"{cell.GetNumberOfPoints()} points of kind {kind}", "other numbers of points")
    if (
        _POLYHEDRON in solid
        and not (data.GetPolyhedronFaces if hasattr(data, "GetPolyhedronFaces") else data.GetFaces)()
    ):
        raise expected("types", "polyhedra with faces", "none", "the file may be damaged")
    marks = data.GetCellData().GetArray(MARKS[0])
    kept = np.isin(kinds, solid) & (True if marks is None else _numbers(marks).astype(np.int64) & _COVERED == 0)
    if not kept.any():
        raise expected("cells", "some with a volume", "flat ones", SURFACE)
    if kept.all():
        return data
    # 3. only those
    from vtkmodules.util.numpy_support import numpy_to_vtk

    wanted = numpy_to_vtk(kept.astype(np.uint8), deep=1)
    wanted.SetName("kept")
    data.GetCellData().AddArray(wanted)
    threshold = vtkThreshold()
    threshold.SetInputData(data)
    threshold.SetInputArrayToProcess(0, 0, 0, 1, "kept")
    threshold.SetLowerThreshold(0.5)
    threshold.SetThresholdFunction(vtkThreshold.THRESHOLD_UPPER)
    threshold.SetUpperThreshold(0.5)
    threshold.Update()
    return threshold.GetOutput()


def finite_points(data: Any) -> np.ndarray:
    """The points of a grid or surface, float64 [N, 3]. Raises InputError for coordinates that are not finite."""
    points = _numbers(data.GetPoints().GetData()).astype(np.float64)
    if not (np.abs(points) < _MOST_PLACE).all():
        raise expected("Points", "finite coordinates", "others", "the file is damaged")
    return points


def corners(cells: Any, what: str, points: int) -> tuple[np.ndarray, np.ndarray]:
    """Point numbers of all cells of a vtkCellArray, and the first of each cell in them, with the end. Raises InputError
    for others than numbers of the points.
    """
    cells.ConvertTo64BitStorage()
    numbers, offsets = _numbers(cells.GetConnectivityArray()), _numbers(cells.GetOffsetsArray())
    if len(offsets) > 1 and (np.diff(offsets).min() < 0 or offsets[0] != 0 or offsets[-1] > len(numbers)):
        raise expected(what, "rising offsets", "others", "the file is damaged")
    if numbers.size and (numbers.min() < 0 or numbers.max() >= points):
        raise expected(what, f"numbers of {points} points", f"{numbers.min()} to {numbers.max()}")
    return numbers, offsets


def _measure(grid: Any, choice: Selection) -> _Part:
    """Sizes, places and values of a grid of cells."""
    from vtkmodules.vtkFiltersCore import vtkCellCenters

    points = finite_points(grid)
    numbers, offsets = _numbers(grid.GetCells().GetConnectivityArray()), _numbers(grid.GetCells().GetOffsetsArray())
    ends = points[numbers]
    extents = np.maximum.reduceat(ends, offsets[:-1]) - np.minimum.reduceat(ends, offsets[:-1])
    box, there = np.stack([ends.min(axis=0), ends.max(axis=0)]), (extents > 0).all(axis=1)
    if not there.any():
        raise expected("cells", "some with a volume", "flat ones", SURFACE)
    smallest = extents[there][extents[there].prod(axis=1).argmin()]
    if choice.of_cells:
        centers = vtkCellCenters()
        centers.SetInputData(grid)
        centers.VertexCellsOff()
        centers.Update()
        points = _numbers(centers.GetOutput().GetPoints().GetData()).astype(np.float64)
    owner = grid.GetCellData() if choice.of_cells else grid.GetPointData()
    return _Part(choice, grid.GetNumberOfCells(), smallest, box, points, _numbers(owner.GetArray("values")))


def even_counts(span: np.ndarray, steps: np.ndarray, cells: int) -> np.ndarray:
    """Voxels along x, y, z of a box at these steps, or fewer."""
    most = max(min(max(_MOST_FINER * cells, _FREE_VOXELS), _MOST_VOXELS, budget() // _VOXEL_BYTES), 1)
    with np.errstate(all="ignore"):
        # damaged coordinates give steps of no length, or none at all
        counts = np.clip(np.nan_to_num(np.ceil(span / np.minimum(steps, span) - 0.01), nan=1.0), 1.0, most)
    while counts.prod() > most:
        counts = np.maximum(np.floor(counts * (most / counts.prod()) ** (1 / 3)), 1.0)
    return counts.astype(np.int64)


def _probe(
    data: Any, place: tuple[np.ndarray, np.ndarray, np.ndarray], with_vectors: bool
) -> tuple[np.ndarray, np.ndarray | None]:
    """Values [D, H, W] at the voxels of a grid (origin, step, counts), NaN outside of all cells, and vectors, 0 there,
    or None.
    """
    from vtkmodules.vtkFiltersCore import vtkResampleToImage

    start, step, counts = place
    resample = vtkResampleToImage()
    resample.SetInputDataObject(data)
    resample.UseInputBoundsOff()
    resample.SetSamplingBounds(*np.stack([start, start + step * (counts - 1)], axis=1).ravel().tolist())
    resample.SetSamplingDimensions(*counts.tolist())
    resample.Update()
    found, shape = resample.GetOutput().GetPointData(), tuple(counts[::-1].tolist())
    inside = _numbers(found.GetArray(MARKS[2])).astype(bool).reshape(shape)
    samples = np.where(inside, _numbers(found.GetArray("values")).reshape(shape), np.nan)
    if not with_vectors:
        return samples, None
    vectors = _numbers(found.GetArray("vectors")).reshape(*shape, 3)
    return samples, np.nan_to_num(np.where(inside[..., None], vectors, 0).astype(np.float32))


def _trilinear(samples: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Values [P] at fractional indices (z, y, x) [P, 3]; NaN outside of the samples and beside NaN."""
    most = np.array(samples.shape) - 1
    inside = ((places >= -1e-6) & (places <= most + 1e-6)).all(axis=1)
    at = np.clip(places, 0, most)
    first = np.minimum(at.astype(np.int64), np.maximum(most - 1, 0))
    share = at - first
    result = np.zeros(len(places))
    for corner in np.ndindex(2, 2, 2):
        weight = np.where(corner, share, 1 - share).prod(axis=1)
        index = np.minimum(first + corner, most)
        result += np.where(weight > 0, weight * samples[tuple(index.T)], 0.0)
    return np.where(inside, result, np.nan)


# --- blocks -----------------------------------------------------------------------------------------------------------

# the number of a time step or block, and an array in it
NUMBERED = re.compile("[0-9]{1,9}(/|$)")


def select_entry(entries: list[tuple[str, Any]], options: LoadOptions, what: str) -> tuple[Any, str | int | None]:
    """The entry that `array` names by its number or name, and the array in it."""
    listed = list_names([f"{n} ({name})" if name else f"{n}" for n, (name, _) in enumerate(entries)])
    requested = None if options.array is None else str(options.array)
    if requested is not None:
        head, _, rest = requested.partition("/")
        if NUMBERED.match(requested):
            if int(head) >= len(entries):
                raise expected("array", f"one of the {what} {listed}", repr(requested))
            return entries[int(head)][1], rest or None
        for name, entry in entries:
            if name and (requested == name or requested.startswith(f"{name}/")):
                return entry, requested[len(name) + 1 :] or None
    if len(entries) > 1:
        fix = f"pick one with array=0 … array={len(entries) - 1}, an array in it as in array=0/NAME"
        raise expected(what, "one", f"{len(entries)}: {listed}", fix)
    return entries[0][1], requested
