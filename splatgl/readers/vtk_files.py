"""Files that VTK reads, and PyVista with it, in another process: grids of cells, pieces, blocks, AMR, VTKHDF, series;
and the selection among the arrays of VTK's grids.

Grids of cells and AMR are resampled to even ones, whose steps are those of the smallest cell, or larger ones where the
grid would exceed the budget of voxels or of memory; a note states the error at the file's own points.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from splatgl.data.affine import Coordinate, describe_error, interpolate_grid, make_lattice, volume_on_grid
from splatgl.data.times import Times
from splatgl.data.volume import Volume, triple
from splatgl.errors import InputError, MissingOption, expected, import_extra, list_names
from splatgl.fileio import budget
from splatgl.readers.channels import (
    COLOR_NOTE,
    VECTOR_NOTE,
    ChannelSet,
    is_color_rule,
    is_vector_rule,
    split_components,
)
from splatgl.readers.common import Shape, array_fields, decoder_errors
from splatgl.readers.elsewhere import call
from splatgl.readers.hdf5_files import check_group
from splatgl.readers.options import SURFACE, LoadOptions
from splatgl.readers.vtk_xml import check_xml, is_xml, parse_vtk, spell_numbers

# most voxels: so many per cell, but at least and at most these numbers, within the memory of so many bytes per voxel
_MOST_FINER, _FREE_VOXELS, _MOST_VOXELS, _VOXEL_BYTES = 64, 2**15, 2**24, 64
# largest coordinate
_MOST_PLACE = 1e30
# bit of VTK's marks of cells that another piece has, too
_TWICE = 1
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
    size = check_xml(path, options.anywhere) if is_xml(path) else path.stat().st_size
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
            reader = pyvista.get_reader(str(path)).reader
        if hasattr(reader, "CreateCellToPointOff"):
            # OpenFOAM's values of cells, not means of them at points
            reader.CreateCellToPointOff()
        return reader
    with path.open("rb") as file:
        head = file.read(1024)
    text = None
    if is_xml(path):
        module, name = "vtkIOXML", "vtkXMLGenericDataObjectReader"
        if re.search(rb"type=.vtk\w*(AMR|HierarchicalBox)", head):
            name = "vtkXMLUniformGridAMRReader"
        elif text := spell_numbers(path):
            name = f"vtkXML{parse_vtk(path, ()).kind}Reader"
    else:
        is_legacy = head.lower().startswith(b"# vtk")
        module, name = ("vtkIOLegacy", "vtkGenericDataObjectReader") if is_legacy else ("vtkIOHDF", "vtkHDFReader")
    reader = getattr(import_extra(f"vtkmodules.{module}", "grids of cells and blocks", "vtk", "vtk"), name)()
    reader.SetFileName(str(path))
    if text:
        reader.ReadFromInputStringOn()
        reader.SetInputString(text.decode())
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
        return _resample_amr([leaf for _, leaf in entries], options)
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
        return place_on_even(leaf, _select(leaf, options)[0], even=options.spacing is not None)
    return _resample(leaf, options)


def place_on_even(data: Any, choice: Selection, even: bool = False) -> Volume:
    """The volume of selected arrays of a vtkImageData or vtkRectilinearGrid. even: see `Selection.rectilinear`."""
    if data.IsA("vtkRectilinearGrid"):
        axes = (data.GetXCoordinates(), data.GetYCoordinates(), data.GetZCoordinates())
        return choice.rectilinear([vtk_numbers(axis) for axis in axes], even)
    matrix = np.reshape(data.GetDirectionMatrix().GetData(), (3, 3)) * np.array(data.GetSpacing())
    origin = np.array(data.GetOrigin()) + matrix @ np.array(data.GetExtent()[::2])
    return choice.volume(matrix, origin, data.GetDimensions()[::-1], "direction and spacing")


def _select(data: Any, options: LoadOptions) -> tuple[Selection, Shape]:
    """The selected arrays of an image or a rectilinear grid, and its points [D, H, W]."""
    w, h, d = data.GetDimensions()
    points, cells = list_arrays(data.GetPointData(), (d, h, w)), list_arrays(data.GetCellData(), count_cells((d, h, w)))
    return select_arrays(points, cells, options), (d, h, w)


def vtk_numbers(array: Any) -> np.ndarray:
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
        values, count = vtk_numbers(array), array.GetNumberOfComponents()
        is_vectors = count == 3 and (values.dtype.kind == "f" or array is vectors)
        values = values.reshape(*shape, count)
        name = array.GetName() or f"array {number}"
        arrays.append(PointArray(name, count, is_vectors, values.view, values.dtype, array is active))
    return arrays


# --- grids of cells ---------------------------------------------------------------------------------------------------


def _resample(grid: Any, options: LoadOptions) -> Volume:
    """The volume of a grid of cells, whose arrays are replaced: voxels of the smallest cell's size, valued by VTK."""
    from vtkmodules.vtkFiltersCore import vtkCellCenters

    choice = _keep_selected(grid, options)
    grid = _solid(grid)
    points, count = finite_points(grid), grid.GetNumberOfCells()
    # 1. the even grid
    numbers, offsets = corners(grid.GetCells(), "Cells", len(points))
    ends = points[numbers]
    low, high = ends.min(axis=0), ends.max(axis=0)
    extents = np.maximum.reduceat(ends, offsets[:-1]) - np.minimum.reduceat(ends, offsets[:-1])
    del ends
    sizes = np.where((extents > 0).all(axis=1), extents.prod(axis=1), np.inf)
    if not np.isfinite(sizes).any():
        raise expected("cells", "some with a volume", "flat ones", SURFACE)
    voxels = even_counts(high - low, extents[sizes.argmin()], count)
    step = (high - low) / voxels
    # 2. the values there, and at the file's own points
    samples, vectors = _probe(grid, (low + step / 2, step, voxels), choice.vectors is not None)
    if choice.of_cells:
        centers = vtkCellCenters()
        centers.SetInputData(grid)
        centers.VertexCellsOff()
        centers.Update()
        points = finite_points(centers.GetOutput())
    owner = grid.GetCellData() if choice.of_cells else grid.GetPointData()
    back = _trilinear(samples, ((points - low) / step - 0.5)[:, ::-1])
    error = describe_error(back, vtk_numbers(owner.GetArray("values")))
    return _volume(samples, choice, (low + step / 2, step), f"{count} cells", error, vectors)


def _volume(
    samples: np.ndarray,
    choice: Selection,
    grid: tuple[np.ndarray, np.ndarray],
    what: str,
    error: str,
    vectors: np.ndarray | None = None,
) -> Volume:
    """The volume of resampled values on a grid (origin, step), with a note on what was resampled."""
    size = "×".join(map(str, samples.shape[::-1]))
    about = choice.about | {"notes": (f"{what}, resampled to {size} voxels; {error}", *choice.about["notes"])}
    return Volume(samples, triple(grid[1], "cells"), triple(grid[0], "cells"), vectors=vectors, **about)


def _resample_amr(blocks: list[Any], options: LoadOptions) -> Volume:
    """The volume of AMR: each voxel has the value of the finest block there, of the cell or linear between points.
    blocks: coarse ones first.
    """
    choices, shapes = zip(*(_select(block, options) for block in blocks), strict=True)
    choice = choices[0]
    if len({each.of_cells for each in choices}) > 1:
        raise expected("blocks", "one array in all of them", "different arrays", "name one with array=NAME")
    # 1. steps, corners and first samples of the blocks, x, y, z, and the even grid
    steps = np.array([block.GetSpacing() for block in blocks])
    lows = np.array([block.GetOrigin() for block in blocks]) + steps * [block.GetExtent()[::2] for block in blocks]
    if not (steps > 0).all() or not (np.abs([steps, lows]) < _MOST_PLACE).all():
        raise expected("blocks", "positive steps and finite places", "others", "the file is damaged")
    highs = lows + steps * [np.maximum(np.subtract(shape[::-1], 1), 1) for shape in shapes]
    firsts, low, high = lows + steps / 2 * choice.of_cells, lows.min(axis=0), highs.max(axis=0)
    voxels = even_counts(high - low, steps.min(axis=0), sum(each.samples.size for each in choices))
    step = (high - low) / voxels
    voxels, start = voxels + (not choice.of_cells), low + step / 2 * choice.of_cells
    kinds = {each.samples.dtype for each in choices}
    wide = np.dtype(np.float64 if any(kind.itemsize > 4 for kind in kinds) else np.float32)
    samples, owner = np.full(tuple(voxels[::-1]), np.nan, wide), np.full(tuple(voxels[::-1]), -1.0)
    for n, each in enumerate(choices):
        box, indices = [], []
        for axis in (2, 1, 0):
            # voxels whose places lie in the block, but for rounding
            begin = np.ceil((lows[n, axis] - start[axis]) / step[axis] - 1e-6)
            end = np.floor((highs[n, axis] - start[axis]) / step[axis] + 1e-6) + 1
            box.append(slice(*np.clip([begin, max(begin, end)], 0, voxels[axis]).astype(int).tolist()))
            places = start[axis] + step[axis] * np.arange(box[-1].start, box[-1].stop)
            at = (places - firsts[n, axis]) / steps[n, axis]
            at = np.clip(np.rint(at + 1e-9) if choice.of_cells else at, 0, each.samples.shape[2 - axis] - 1)
            indices.append(at)
        samples[tuple(box)], owner[tuple(box)] = interpolate_grid(each.samples, indices), steps[n].prod()
    # 2. the error at the points of each block that no finer one covers
    stored, back = [], []
    for n, each in enumerate(choices):
        places = [firsts[n, axis] + steps[n, axis] * np.arange(each.samples.shape[2 - axis]) for axis in (2, 1, 0)]
        indices = [
            np.clip((place - start[axis]) / step[axis], 0, voxels[axis] - 1)
            for place, axis in zip(places, (2, 1, 0), strict=True)
        ]
        seen = owner[np.ix_(*(np.rint(at).astype(int) for at in indices))] == steps[n].prod()
        stored.append(each.samples[seen].astype(np.float64))
        back.append(interpolate_grid(samples, indices)[seen])
    if len(kinds) == 1 and not np.isnan(samples).any():
        samples = samples.astype(kinds.pop().newbyteorder("="))
    what = f"{len(blocks)} blocks of {len(np.unique(steps.prod(axis=1)))} levels"
    error = describe_error(np.concatenate(back), np.concatenate(stored))
    return _volume(samples, choice, (start, step), what, error)


def _keep_selected(grid: Any, options: LoadOptions) -> Selection:
    """Selects among the arrays of a grid, and leaves it `values` and `vectors` alone, with VTK's marks."""
    from vtkmodules.util.numpy_support import numpy_to_vtk

    owners = (grid.GetPointData(), grid.GetCellData())
    sizes = (grid.GetNumberOfPoints(), grid.GetNumberOfCells())
    points, cells = (list_arrays(owner, (1, 1, size)) for owner, size in zip(owners, sizes, strict=True))
    choice = select_arrays(points, cells, options)
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
    """The cells of a grid with three dimensions that no other piece has, a vtkUnstructuredGrid. Raises
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
    kinds, cell = vtk_numbers(data.GetCellTypesArray()).ravel(), vtkGenericCell()
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
    kept = np.isin(kinds, solid) & (True if marks is None else vtk_numbers(marks).astype(np.int64) & _TWICE == 0)
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
    points = vtk_numbers(data.GetPoints().GetData()).astype(np.float64)
    if not (np.abs(points) < _MOST_PLACE).all():
        raise expected("Points", "finite coordinates", "others", "the file is damaged")
    return points


def corners(cells: Any, what: str, points: int) -> tuple[np.ndarray, np.ndarray]:
    """Point numbers of all cells of a vtkCellArray, and the first of each cell in them, with the end. Raises InputError
    for others than numbers of the points.
    """
    cells.ConvertTo64BitStorage()
    numbers, offsets = vtk_numbers(cells.GetConnectivityArray()), vtk_numbers(cells.GetOffsetsArray())
    if len(offsets) > 1 and (np.diff(offsets).min() < 0 or offsets[0] != 0 or offsets[-1] > len(numbers)):
        raise expected(what, "rising offsets", "others", "the file is damaged")
    if numbers.size and (numbers.min() < 0 or numbers.max() >= points):
        raise expected(what, f"numbers of {points} points", f"{numbers.min()} to {numbers.max()}")
    return numbers, offsets


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
    inside = vtk_numbers(found.GetArray(MARKS[2])).astype(bool).reshape(shape)
    samples = np.where(inside, vtk_numbers(found.GetArray("values")).reshape(shape), np.nan).astype(np.float32)
    if not with_vectors:
        return samples, None
    vectors = vtk_numbers(found.GetArray("vectors")).reshape(*shape, 3)
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


# --- arrays of grids --------------------------------------------------------------------------------------------------


# VTK's marks of points and cells, which are no values; bits of the first for a hidden point and a hidden cell
MARKS, HIDDEN_POINT, HIDDEN_CELL = ("vtkGhostType", "vtkGhostLevels", "vtkValidPointMask"), 2, 32


@dataclass(frozen=True)
class PointArray:
    """An array of a VTK grid; read() loads it as [D, H, W, components]. active: whether the file names it as the one
    that is drawn.
    """

    name: str
    components: int
    is_vectors: bool
    read: Callable[[], np.ndarray]
    dtype: np.dtype | None = None
    active: bool = False


@dataclass(frozen=True)
class Selection:
    """Selected arrays of a grid: samples [D, H, W] of points or of cells; colours uint8 and vectors float32
    [D, H, W, 3], or None. about: further fields of `Volume`, notes and hints among them.

    Speeds, and arrays that are named as a simulation's, get the hints of a field.
    """

    of_cells: bool
    samples: np.ndarray
    vectors: np.ndarray | None
    color: np.ndarray | None
    about: dict[str, Any]

    def volume(self, matrix: np.ndarray, origin: np.ndarray, shape: Sequence[int], what: str) -> Volume:
        """The volume on a grid of points [shape] (z, y, x), of which the first is at `origin`; the centres of cells are
        half a step farther. matrix: world-from-index; what: the name of the grid in messages.
        """
        middle = np.where(np.array(shape[::-1]) > 1, 0.5, 0.0) * self.of_cells
        arrays = {"vectors": self.vectors, "color": self.color}
        return volume_on_grid(self.samples, matrix, origin + matrix @ middle, what, **arrays, **self.about)

    def rectilinear(self, places: Sequence[np.ndarray], even: bool) -> Volume:
        """The volume on a rectilinear grid, resampled if it is uneven. places: coordinates of points along x, y, z.

        even: whether to take the steps for even.
        """
        centres = [(axis[1:] + axis[:-1]) / 2 if self.of_cells and len(axis) > 1 else axis for axis in places]
        axes = [Coordinate(name, len(axis), axis) for name, axis in zip("zyx", centres[::-1], strict=True)]
        grid = make_lattice(axes, even=even)
        vectors = None if self.vectors is None else np.asarray(grid.resampled(self.vectors))
        return grid.volume(self.samples, "coordinates", vectors=vectors, **self.about)


def select_arrays(points: Sequence[PointArray], cells: Sequence[PointArray], options: LoadOptions) -> Selection:
    """Selects among the arrays of points and of cells: those of cells if there are no others, or if one has that name.

    Without options the active array or the first with one component, else the length of the first vectors, becomes the
    samples, with NaN for hidden points or cells. `array` names another one; "scalars", "vectors" and "speed" also stand
    for the first of their kind. `channel` picks a component. Raises InputError naming the arrays if the choice is not
    clear.
    """
    marks = [[array for array in arrays if array.name == MARKS[0]] for arrays in (points, cells)]
    points, cells = ([array for array in arrays if array.name not in MARKS] for arrays in (points, cells))
    of_points, of_cells = ([array.name for array in arrays] for arrays in (points, cells))
    in_cells = not points or (options.array not in (None, *of_points) and options.array in of_cells)
    arrays = cells if in_cells else points
    if not arrays:
        raise expected("arrays", "point or cell data", "none")
    vectors = next((array for array in arrays if array.is_vectors), None)
    chosen = _select_array(arrays, vectors, options)
    is_field = chosen.is_vectors or is_vector_rule(chosen.dtype, chosen.components)
    if is_field:
        vectors = chosen
    color = None
    field = None if vectors is None else np.asarray(vectors.read(), dtype=np.float32)
    if is_field and options.channel is None and field is not None:
        samples = np.stack([np.linalg.norm(plane, axis=-1) for plane in field])
    elif options.channel is None and chosen.dtype is not None and is_color_rule(chosen.dtype, chosen.components):
        samples, color, _ = split_components(chosen.read(), is_color=True)
    else:
        samples = _component(chosen, options)
    # arrays of points and of cells are listed together
    every = [*arrays, *(points if in_cells else cells)]
    others = [array.name for array in every if array.name != chosen.name]
    notes = (COLOR_NOTE,) * (color is not None) + (VECTOR_NOTE,) * (is_field > chosen.is_vectors)
    if options.array is None and others:
        notes += (f"array {chosen.name} of {len(every)} is rendered; --array picks another: {list_names(others)}",)
    for mark in (mark for mark in marks[in_cells] if mark.read().dtype.kind in "iu"):
        hidden = (mark.read()[..., 0] & (HIDDEN_CELL if in_cells else HIDDEN_POINT)) != 0
        if hidden.any():
            samples = np.where(hidden, np.nan, samples).astype(np.float32)
            notes += (f"{hidden.sum()} {'cells' if in_cells else 'points'} that the file hides are left out",)
    about = {"notes": notes, **array_fields(chosen.name, samples.dtype, "", "mm", chosen.is_vectors)}
    return Selection(in_cells, samples, field, color, about)


def _select_array(arrays: Sequence[PointArray], vectors: PointArray | None, options: LoadOptions) -> PointArray:
    single = [array for array in arrays if array.components == 1]
    scalars = next((array for array in single if array.active), next(iter(single), None))
    if options.array is None:
        return scalars or vectors or arrays[0]
    named = next((array for array in arrays if array.name == options.array), None)
    chosen = named or {"scalars": scalars, "vectors": vectors, "speed": vectors}.get(str(options.array))
    if chosen is None:
        listed = ", ".join(f"{array.name} ({array.components})" for array in arrays)
        raise expected("array", f"one of {listed}", repr(options.array))
    return chosen


def _component(chosen: PointArray, options: LoadOptions) -> np.ndarray:
    count = chosen.components
    number = options.channel_number(count)
    if number is None and count > 1:
        fix = f"pick one with channel=0 … channel={count - 1}"
        error = expected("array", "one number per voxel", f"{count} in {chosen.name!r}", fix)
        raise MissingOption(str(error), "channel", [(f"0 … {count - 1}", f"numbers of each voxel in {chosen.name!r}")])
    return chosen.read()[..., number or 0]


def count_cells(points: Shape) -> Shape:
    """The numbers of cells between points; a flat grid has one layer."""
    d, h, w = (max(count - 1, 1) for count in points)
    return d, h, w
