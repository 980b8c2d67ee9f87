"""VTK's grids of cells, resampled to even ones, and collections of VTK's files.

Of AMR each voxel gets the value of the finest block there. The steps are those of the smallest cell, or larger ones
where the grid would exceed the budget of voxels or of memory; a note states the error at the file's own points.

Format: "VTK XML file formats", docs.vtk.org.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np

from splatgl.data.affine import describe_error, interpolate_grid
from splatgl.data.times import Times
from splatgl.data.volume import Volume, triple
from splatgl.errors import expected, import_extra, list_names
from splatgl.fileio import budget
from splatgl.readers import vtk_xml
from splatgl.readers.channels import ChannelSet
from splatgl.readers.common import Shape, decoder_errors, find_data_file, grid_shape
from splatgl.readers.options import LoadOptions, converter
from splatgl.readers.vtk_legacy import MARKS, Selection, select_arrays
from splatgl.readers.vtk_xml import VtkXml, image_grid, parse_numbers, parse_vtk, read_array, read_arrays, read_pieces

# points of a cell with a volume, by VTK's number of its kind (vtkCellType.h)
_POINTS = {10: 4, 11: 8, 12: 8, 13: 6, 14: 5, 15: 10, 16: 12, 24: 10, 25: 20, 26: 15, 27: 13, 29: 27, 31: 12, 32: 18}
_POINTS |= {33: 24, 37: 19}
# kinds of fewer dimensions, which are left out
_FLAT = (*range(10), 21, 22, 23, 28, 30, 34, 35, 36)
# most voxels: so many per cell, but at least and at most these numbers, within the memory of so many bytes per voxel
_MOST_FINER, _FREE_VOXELS, _MOST_VOXELS, _VOXEL_BYTES = 64, 2**15, 2**24, 64
# most blocks of an AMR grid, and largest coordinate
_MOST_BLOCKS, _MOST_PLACE = 2**16, 1e30
# largest offset of a cell in the numbers of points
_MOST_ENDS = 2**40
# VTK's number of hexahedra, and the bit of its marks of cells that another piece has, too
_HEXAHEDRON, _TWICE = 12, 1


def _even_counts(span: np.ndarray, steps: np.ndarray, cells: int) -> np.ndarray:
    """Voxels along x, y, z of a box at these steps, or fewer."""
    most = max(min(max(_MOST_FINER * cells, _FREE_VOXELS), _MOST_VOXELS, budget() // _VOXEL_BYTES), 1)
    with np.errstate(all="ignore"):
        # damaged coordinates give steps of no length, or none at all
        counts = np.clip(np.nan_to_num(np.ceil(span / np.minimum(steps, span) - 0.01), nan=1.0), 1.0, most)
    while counts.prod() > most:
        counts = np.maximum(np.floor(counts * (most / counts.prod()) ** (1 / 3)), 1.0)
    return counts.astype(np.int64)


# --- unstructured grids -----------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Mesh:
    """Points [P, 3]; the cells with a volume: kinds [C], offsets [C + 1] into the numbers of points `corners`, and
    numbers `kept` among the file's cells.
    """

    points: np.ndarray
    kinds: np.ndarray
    offsets: np.ndarray
    corners: np.ndarray
    kept: np.ndarray

    def only(self, wanted: np.ndarray) -> _Mesh:
        """The cells of a mask [C]."""
        sizes = np.diff(self.offsets)
        corners, offsets = self.corners[np.repeat(wanted, sizes)], np.concatenate([[0], np.cumsum(sizes[wanted])])
        return _Mesh(self.points, self.kinds[wanted], offsets, corners, self.kept[wanted])

    @property
    def extents(self) -> np.ndarray:
        """Sizes [C, 3] of the cells' boxes."""
        places, starts = self.points[self.corners], self.offsets[:-1]
        sizes: np.ndarray = np.maximum.reduceat(places, starts) - np.minimum.reduceat(places, starts)
        return sizes

    @property
    def centers(self) -> np.ndarray:
        """Means [C, 3] of the cells' points."""
        sums = np.add.reduceat(self.points[self.corners], self.offsets[:-1])
        return np.asarray(sums / np.diff(self.offsets)[:, None])


@dataclass(frozen=True)
class _Piece:
    """A piece: its cells, its selected array, and the values and vectors (None without) of the cells or points."""

    mesh: _Mesh
    choice: Selection
    values: np.ndarray
    vectors: np.ndarray | None


def read(path: Path, options: LoadOptions) -> Volume:
    """The volume of a .vtu or .vts file, or of the pieces of a .pvtu or .pvts file; `array` names an array, `channel`
    picks a component. Vectors are drawn by magnitude. What lies outside of all cells is NaN.
    """
    vtk = import_extra("vtkmodules.vtkFiltersCore", "unstructured grids", "vtk", "vtk")
    kinds = ("UnstructuredGrid", "StructuredGrid")
    file = parse_vtk(path, (*kinds, *(f"P{kind}" for kind in kinds)))
    files = [file]
    if file.kind not in kinds:
        names = [node.get("Source", "") for node in file.root.findall(f"{file.kind}/Piece")]
        files = [parse_vtk(find_data_file(path, name, options.anywhere), (file.kind[1:],)) for name in names]
    with decoder_errors("VTK XML"):
        nodes = [(source, node) for source in files for node in source.root.findall(f"{source.kind}/Piece")]
        parts = [_read_part(source, node, options) for source, node in nodes if all(_sizes(source, node))]
    if not parts:
        raise expected("Piece", "one or more with cells", "none", "it is a surface: save it as .vtp for --mesh")
    mesh, choice = _join([part.mesh for part in parts]), parts[0].choice
    if any((part.choice.of_cells, part.vectors is None) != (choice.of_cells, choice.vectors is None) for part in parts):
        raise expected("pieces", "the same arrays in all pieces", "different arrays", "save the grid again")
    # 1. the even grid: voxels of the smallest cell's size
    low, high = mesh.points[mesh.corners].min(axis=0), mesh.points[mesh.corners].max(axis=0)
    extents = mesh.extents
    sizes = np.where((extents > 0).all(axis=1), extents.prod(axis=1), np.inf)
    if not np.isfinite(sizes).any() or (high <= low).any():
        raise expected("cells", "some with a volume", "flat ones", "it is a surface: save it as .vtp for --mesh")
    voxels = _even_counts(high - low, extents[sizes.argmin()], len(mesh.kinds))
    step = (high - low) / voxels
    # 2. the values there, by VTK, and at the file's own points
    values = np.concatenate([part.values for part in parts])
    grid = (low + step / 2, step, voxels)
    samples = _probe(vtk, mesh, values[:, None], choice.of_cells, grid)[..., 0]
    vectors = [part.vectors for part in parts if part.vectors is not None]
    flow = _probe(vtk, mesh, np.concatenate(vectors), choice.of_cells, grid) if vectors else None
    places = mesh.centers if choice.of_cells else mesh.points
    back = _trilinear(samples, ((places - low) / step - 0.5)[:, ::-1])
    kind = "×".join(map(str, voxels))
    note = f"{len(mesh.kinds)} cells, resampled to {kind} voxels; {describe_error(back, values)}"
    spacing, origin = triple(step, "cells"), triple(low + step / 2, "cells")
    about = choice.about | {"notes": (note, *choice.about["notes"])}
    return Volume(samples, spacing, origin, vectors=None if flow is None else np.nan_to_num(flow), **about)


def _sizes(file: VtkXml, node: Element) -> tuple[int, int]:
    """Points and cells of a piece."""
    if file.kind == "UnstructuredGrid":
        return read_count(node, "NumberOfPoints"), read_count(node, "NumberOfCells")
    shape = _structured_shape(node)
    return math.prod(shape), math.prod(count - 1 for count in shape)


def _structured_shape(node: Element) -> Shape:
    """Points of a structured piece along z, y, x."""
    extent = [int(number) for number in parse_numbers(node, "Extent", "", 6)]
    return grid_shape([max(extent[axis + 1] - extent[axis] + 1, 1) for axis in (0, 2, 4)], "Extent")


def _read_part(file: VtkXml, node: Element, options: LoadOptions) -> _Piece:
    """A piece without cells that other pieces have, too."""
    sizes = _sizes(file, node)
    mesh = _read_mesh(file, node) if file.kind == "UnstructuredGrid" else _read_curved(file, node)
    owners = [node.find(name) for name in ("PointData", "CellData")]
    points, cells = (
        [] if owner is None else read_arrays(file, owner, (1, 1, size))
        for owner, size in zip(owners, sizes, strict=True)
    )
    ghosts = next((array.read().ravel() for array in cells if array.name == MARKS[0]), None)
    if ghosts is not None:
        mesh = mesh.only(ghosts[mesh.kept] & _TWICE == 0)
    choice = select_arrays(points, cells, options)
    values, vectors = choice.samples[0, 0], None if choice.vectors is None else choice.vectors[0, 0]
    if choice.of_cells:
        values, vectors = values[mesh.kept], None if vectors is None else vectors[mesh.kept]
    return _Piece(mesh, choice, values, vectors)


def _join(meshes: list[_Mesh]) -> _Mesh:
    """The cells of all pieces; points at their borders stay twice."""
    points, cells, ends = ([0], [0], [0])
    for mesh in meshes:
        points.append(points[-1] + len(mesh.points))
        cells.append(cells[-1] + len(mesh.kinds))
        ends.append(ends[-1] + len(mesh.corners))
    offsets = [mesh.offsets[1:] + end for mesh, end in zip(meshes, ends, strict=False)]
    return _Mesh(
        np.concatenate([mesh.points for mesh in meshes]),
        np.concatenate([mesh.kinds for mesh in meshes]),
        np.concatenate([[0], *offsets]),
        np.concatenate([mesh.corners + first for mesh, first in zip(meshes, points, strict=False)]),
        np.arange(cells[-1]),
    )


def _read_curved(file: VtkXml, node: Element) -> _Mesh:
    """The points of a structured piece, and its hexahedra."""
    shape = _structured_shape(node)
    points = read_points(file, node, math.prod(shape))
    number = np.arange(len(points)).reshape(shape)
    ring, (d, h, w) = [(0, 0), (0, 1), (1, 1), (1, 0)], (size - 1 for size in shape)
    corners = np.stack([number[z : z + d, y : y + h, x : x + w] for z in (0, 1) for y, x in ring], axis=-1)
    count = d * h * w
    return _Mesh(points, np.full(count, _HEXAHEDRON), 8 * np.arange(count + 1), corners.ravel(), np.arange(count))


def read_count(node: Element, name: str) -> int:
    """The number of an attribute; 0 without it. Raises InputError for others than whole ones of at least 0."""
    number = parse_numbers(node, name, "0", 1)[0]
    if number < 0 or number != int(number):
        raise expected(name, "a whole number from 0", f"{number:g}")
    return int(number)


def _read_mesh(file: VtkXml, node: Element) -> _Mesh:
    """The points and cells of a piece. Raises InputError for numbers that are no points, and for unknown cells."""
    number, count = _sizes(file, node)
    if number < 1 or count < 1:
        raise expected("Piece", "points and cells", f"{number} and {count}")
    points = read_points(file, node, number)
    every, ends = read_cells(file, node, "Cells", count, number)
    sizes, kinds = np.diff(ends, prepend=0), _read_whole(file, node, ("Cells", "types"), count)
    unknown = sorted(set(kinds.tolist()) - set(_POINTS) - set(_FLAT))
    if unknown:
        this = "tetrahedra, voxels, hexahedra, wedges, pyramids, prisms or quadratic ones"
        raise expected("types", this, f"numbers {unknown[:8]}", "resample it with ParaView's filter Resample To Image")
    kept = np.flatnonzero(np.isin(kinds, list(_POINTS)))
    needed = np.array([_POINTS[kind] for kind in kinds[kept].tolist()], np.int64)
    if not len(kept) or (sizes[kept] != needed).any():
        got = "flat ones" if not len(kept) else "cells with other numbers of points"
        raise expected("cells", "some with a volume", got, "it is a surface: save it as .vtp for --mesh")
    offsets = np.concatenate([[0], np.cumsum(needed)])
    # places in `every` of the kept cells' points
    starts = np.repeat((ends - sizes)[kept] - offsets[:-1], needed)
    corners = every[starts + np.arange(offsets[-1])]
    return _Mesh(points, kinds[kept], offsets, corners, kept)


def read_points(file: VtkXml, node: Element, number: int) -> np.ndarray:
    """The points, float64 [P, 3], of a piece."""
    array = node.find("Points/DataArray")
    if array is None:
        raise expected("Points", "an array", "none")
    points = read_array(file, array, (1, 1, number)).read().reshape(-1)
    if points.size != 3 * number or not (np.abs(points) < _MOST_PLACE).all():
        raise expected("Points", f"{number} times three finite coordinates", points.size)
    return np.asarray(points.reshape(-1, 3).astype(np.float64))


def read_cells(file: VtkXml, node: Element, kind: str, count: int, points: int) -> tuple[np.ndarray, np.ndarray]:
    """Point numbers of all cells of a kind, int64, and the ends of the cells in them. points: of the piece."""
    ends = _read_whole(file, node, (kind, "offsets"), count)
    if np.diff(ends, prepend=0).min(initial=0) < 0 or ends.max(initial=0) > _MOST_ENDS:
        raise expected(kind, f"{count} rising offsets", "others", "the file is damaged")
    numbers = _read_whole(file, node, (kind, "connectivity"), int(ends[-1])) if ends[-1] else ends[:0]
    if numbers.size and (numbers.min() < 0 or numbers.max() >= points):
        raise expected(kind, f"numbers of {points} points", f"{numbers.min()} to {numbers.max()}")
    return numbers, ends


def _read_whole(file: VtkXml, node: Element, place: tuple[str, str], count: int) -> np.ndarray:
    """The whole numbers, int64 [count], of the array of a name below an element of a piece."""
    array = node.find(f"{place[0]}/DataArray[@Name='{place[1]}']")
    if array is None:
        raise expected(place[0], f"an array {place[1]}", "none")
    numbers = read_array(file, array, (1, 1, count)).read().reshape(-1).astype(np.int64)
    if len(numbers) != count:
        raise expected(place[1], f"{count} numbers", len(numbers), "the file is damaged")
    return numbers


def _probe(vtk: Any, mesh: _Mesh, values: np.ndarray, in_cells: bool, place: tuple[Any, Any, Any]) -> np.ndarray:
    """Values [D, H, W, K], float32, of `values` [N, K] at the voxels of a grid (origin, step, counts); NaN outside of
    all cells.
    """
    from vtkmodules.util.numpy_support import numpy_to_vtk, numpy_to_vtkIdTypeArray, vtk_to_numpy
    from vtkmodules.vtkCommonCore import vtkPoints
    from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkUnstructuredGrid

    grid, cells, points = vtkUnstructuredGrid(), vtkCellArray(), vtkPoints()
    points.SetData(numpy_to_vtk(mesh.points, deep=1))
    grid.SetPoints(points)
    cells.SetData(*(numpy_to_vtkIdTypeArray(numbers, deep=1) for numbers in (mesh.offsets, mesh.corners)))
    grid.SetCells(numpy_to_vtk(mesh.kinds.astype(np.uint8), deep=1), cells)
    array = numpy_to_vtk(np.ascontiguousarray(values, np.float64), deep=1)
    array.SetName("values")
    (grid.GetCellData() if in_cells else grid.GetPointData()).AddArray(array)
    origin, step, counts = place
    resample = vtk.vtkResampleToImage()
    resample.SetInputDataObject(grid)
    resample.UseInputBoundsOff()
    ends = origin + step * (counts - 1)
    resample.SetSamplingBounds(*np.stack([origin, ends], axis=1).ravel().tolist())
    resample.SetSamplingDimensions(*counts.tolist())
    resample.Update()
    data = resample.GetOutput().GetPointData()
    inside = vtk_to_numpy(data.GetArray("vtkValidPointMask")).astype(bool)
    probed = vtk_to_numpy(data.GetArray("values")).reshape(len(inside), -1)
    samples = np.where(inside[:, None], probed, np.nan).astype(np.float32)
    return samples.reshape(*counts[::-1], -1)


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


# --- AMR --------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Block:
    """A block: its level; low corner and step (x, y, z); its selected array, of points or of cells."""

    level: int
    low: np.ndarray
    step: np.ndarray
    choice: Selection

    @property
    def counts(self) -> np.ndarray:
        """Samples along x, y, z."""
        return np.array(self.choice.samples.shape[::-1])

    @property
    def first(self) -> np.ndarray:
        """The place of the first sample."""
        return self.low + self.step / 2 * self.choice.of_cells

    @property
    def high(self) -> np.ndarray:
        """The high corner."""
        return self.low + self.step * np.maximum(self.counts - (not self.choice.of_cells), 1)


def read_amr(path: Path, options: LoadOptions) -> Volume:
    """The volume of a .vthb or .vth file, whose blocks are .vti files; `array` names an array of all blocks."""
    file = parse_vtk(path, ("vtkOverlappingAMR", "vtkNonOverlappingAMR", "vtkHierarchicalBoxDataSet"))
    nodes = [
        (int(parse_numbers(level, "level", "0", 1)[0]), node.get("file", ""))
        for level in file.root.findall(f"{file.kind}/Block")
        for node in level.findall("DataSet")
    ]
    if not 0 < len(nodes) <= _MOST_BLOCKS:
        raise expected("Block", f"1 to {_MOST_BLOCKS} data sets", len(nodes))
    blocks = [_read_block(path, name, level, options) for level, name in sorted(nodes, key=lambda each: each[0])]
    if len({block.choice.of_cells for block in blocks}) > 1:
        raise expected("blocks", "one array in all of them", "different arrays", "name one with array=NAME")
    in_cells = blocks[0].choice.of_cells
    low = np.min([block.low for block in blocks], axis=0)
    high = np.max([block.high for block in blocks], axis=0)
    voxels = _even_counts(
        high - low, np.min([block.step for block in blocks], axis=0), sum(block.choice.samples.size for block in blocks)
    )
    step = (high - low) / voxels
    voxels = voxels if in_cells else voxels + 1
    start = low + step / 2 * in_cells
    dtypes = {block.choice.samples.dtype for block in blocks}
    wide = np.dtype(np.float64 if any(dtype.itemsize > 4 for dtype in dtypes) else np.float32)
    samples = np.full(tuple(voxels[::-1]), np.nan, wide)
    level = np.full(samples.shape, -1, np.int16)
    for block in blocks:
        box, values = _resample(block, start, step, voxels)
        samples[box], level[box] = values, block.level
    error = _describe_amr(blocks, samples, level, (start, step))
    if len(dtypes) == 1 and not np.isnan(samples).any():
        samples = samples.astype(dtypes.pop().newbyteorder("="))
    count, size = len({block.level for block in blocks}), "×".join(map(str, voxels))
    note = f"{len(blocks)} blocks of {count} levels, resampled to {size} voxels; {error}"
    choice = blocks[0].choice
    spacing, origin = triple(step, "blocks"), triple(start, "blocks")
    about = choice.about | {"notes": (note, *choice.about["notes"])}
    return Volume(samples, spacing, origin, **about)


def _describe_amr(
    blocks: list[_Block], samples: np.ndarray, level: np.ndarray, grid: tuple[np.ndarray, np.ndarray]
) -> str:
    """The error at the points of each block that no finer one covers. level: of the block of each voxel."""
    stored, back = [], []
    start, step = grid
    for block in blocks:
        at = [(block.first[n] + block.step[n] * np.arange(block.counts[n]) - start[n]) / step[n] for n in (2, 1, 0)]
        at = [np.clip(indices, 0, size - 1) for indices, size in zip(at, samples.shape, strict=True)]
        seen = level[np.ix_(*(np.rint(indices).astype(np.int64) for indices in at))] == block.level
        stored.append(block.choice.samples[seen])
        back.append(interpolate_grid(samples, at)[seen])
    return describe_error(np.concatenate(back), np.concatenate(stored).astype(np.float64))


def _read_block(path: Path, name: str, level: int, options: LoadOptions) -> _Block:
    if not 0 <= level < 64:
        raise expected("level", "a number from 0 to 63", level)
    file = parse_vtk(find_data_file(path, name, options.anywhere), ("ImageData",))
    pieces, _ = read_pieces(file)
    if len(pieces) != 1:
        raise expected(name, "one piece", len(pieces))
    matrix, origin = image_grid(file)
    step = np.diag(matrix)
    if not np.array_equal(matrix, np.diag(step)) or step.min() <= 0 or np.abs([*step, *origin]).max() > _MOST_PLACE:
        raise expected(name, "positive steps along the axes", matrix.tolist())
    choice = select_arrays(pieces[0].points, pieces[0].cells, options)
    return _Block(level, origin + step * pieces[0].low, step, replace(choice, vectors=None))


def _resample(
    block: _Block, start: np.ndarray, step: np.ndarray, voxels: np.ndarray
) -> tuple[tuple[slice, ...], np.ndarray]:
    """The box of voxels in a block, and their values: of the cell there, or linear between points."""
    box, indices = [], []
    for n in (2, 1, 0):
        # voxels whose places lie in the block, but for rounding
        ends = [(block.low[n] - start[n]) / step[n], (block.high[n] - start[n]) / step[n]]
        low = min(max(math.ceil(ends[0] - 1e-6), 0), int(voxels[n]))
        high = min(max(math.floor(ends[1] + 1e-6) + 1, low), int(voxels[n]))
        places = start[n] + step[n] * np.arange(low, high)
        at = np.clip((places - block.first[n]) / block.step[n], 0, block.counts[n] - 1)
        indices.append(np.rint(at + 1e-9) if block.choice.of_cells else at)
        box.append(slice(low, high))
    return tuple(box), interpolate_grid(block.choice.samples, indices)


_READERS = {
    ".vti": vtk_xml.read,
    ".vtr": vtk_xml.read,
    ".pvti": vtk_xml.read_parallel,
    ".pvtr": vtk_xml.read_parallel,
    **dict.fromkeys((".vtu", ".vts", ".pvtu", ".pvts"), read),
}

# the number of a time step or block, and an array in it
_NUMBERED = re.compile("[0-9]{1,9}(/|$)")
# the name of a time step or block, and the name of its file
Entry = tuple[str, str]


def read_collection(path: Path, options: LoadOptions) -> Volume:
    """The volume of one time step of a .pvd file, or of one block of a .vtm file.

    `time` is the number of the step, `array` that of the block, or its name. An array in it follows a slash: 3/density;
    steps may be given so, too.
    """
    file = parse_vtk(path, ("Collection", "vtkMultiBlockDataSet"))
    is_series = file.kind == "Collection"
    owner = file.root.find(file.kind)
    entries = [] if owner is None else _list_steps(owner) if is_series else _list_blocks(owner)
    what = "time steps" if is_series else "blocks"
    if not entries:
        raise expected(what, "one or more", "none")
    by_time = is_series and (options.time is not None or not _NUMBERED.match(str(options.array)))
    if by_time:
        _, name = entries[min(options.point, len(entries) - 1)]
        array = options.array
    else:
        name, array = _select_entry(entries, options, what)
    entry_options = replace(options, array=array, time=None)
    moments = Times.of(float(time) for time, _ in entries) if by_time else None
    times = ChannelSet(times=len(entries) if by_time else 1, moments=moments)
    return times.volume(replace(options, channel=None), lambda _: _read_entry(path, name, entry_options, is_series))


def _read_entry(path: Path, name: str, options: LoadOptions, collections: bool) -> Volume:
    """The volume in a file that `path` names. collections: whether the file may be a collection of blocks."""
    suffix = Path(name).suffix.lower()
    if suffix not in _READERS and not (suffix == ".vtm" and collections):
        raise expected(name, f"a file of {', '.join(_READERS)}", repr(suffix), converter(name))
    file = find_data_file(path, name, options.anywhere)
    if suffix == ".vtm":
        parse_vtk(file, ("vtkMultiBlockDataSet",))
        return read_collection(file, options)
    return _READERS[suffix](file, options)


def _list_steps(owner: Element) -> list[Entry]:
    """Sorted time steps with one file each."""
    steps = sorted(
        (parse_numbers(node, "timestep", "0", 1)[0], node.get("file", "")) for node in owner.findall("DataSet")
    )
    if len({time for time, _ in steps}) < len(steps):
        raise expected("DataSet", "one file a time step", "several", "save the parts as one .pvti")
    return [(f"{time:.10g}", name) for time, name in steps]


def _list_blocks(owner: Element) -> list[Entry]:
    """The blocks that are grids, by name; all blocks if none is a grid."""
    blocks = [(node.get("name", ""), node.get("file", "")) for node in owner.iter("DataSet")]
    return [entry for entry in blocks if Path(entry[1]).suffix.lower() in _READERS] or blocks


def _select_entry(entries: list[Entry], options: LoadOptions, what: str) -> tuple[str, str | int | None]:
    """The requested file, and the array in it."""
    listed = list_names([f"{n} ({name})" if name else f"{n}" for n, (name, _) in enumerate(entries)])
    requested = None if options.array is None else str(options.array)
    if requested is not None:
        head, _, rest = requested.partition("/")
        if _NUMBERED.match(requested):
            if int(head) >= len(entries):
                raise expected("array", f"one of the {what} {listed}", repr(requested))
            return entries[int(head)][1], rest or None
        if what == "blocks":
            for name, file in entries:
                if name and (requested == name or requested.startswith(f"{name}/")):
                    return file, requested[len(name) + 1 :] or None
    if len(entries) > 1:
        fix = f"pick one with array=0 … array={len(entries) - 1}, an array in it as in array=0/NAME"
        raise expected(what, "one", f"{len(entries)}: {listed}", fix)
    return entries[0][1], requested
