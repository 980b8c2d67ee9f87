"""VTK's XML grids of even steps: images (.vti), rectilinear grids (.vtr), and those in several files (.pvti, .pvtr).

Samples are those of the points, or of the cells: these stand half a step further, and are one fewer along each axis. A
point's index counts from index 0, not from the extent's lower end, and Direction is listed row by row. Rectilinear
grids with uneven steps are refused: a volume has even ones, and those of a resampled grid are not the file's.
"""

from __future__ import annotations

from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np

from splatgl.data.affine import axes_of, even_steps, triple
from splatgl.data.readers.files import Shape, data_file, grid_shape
from splatgl.data.readers.options import LoadOptions
from splatgl.data.readers.vtk_arrays import PointArray, hints_for, pick, told
from splatgl.data.readers.vtk_pieces import Piece, cells_along, joined
from splatgl.data.readers.vtk_xml import VtkXml, arrays_of, extent_of, numbers_in, parse_vtk
from splatgl.data.volume import Volume
from splatgl.errors import expected

_UNEVEN = "resample it with ParaView's filter Resample To Image"

Grid = tuple[np.ndarray, np.ndarray]
"""World-from-index [3, 3], and the place of index (0, 0, 0)."""


def read(path: Path, options: LoadOptions) -> Volume:
    """The volume of a .vti or .vtr file; `array` picks an array by name, the first vectors go to `Volume.vectors`."""
    file = parse_vtk(path, ("ImageData", "RectilinearGrid"))
    pieces, coordinates = _pieces(file)
    return _volume(pieces, _grid(file, pieces, coordinates), options)


def read_parallel(path: Path, options: LoadOptions) -> Volume:
    """The volume of a .pvti or .pvtr file, whose pieces lie in files in its folder, as `read`."""
    parent = parse_vtk(path, ("PImageData", "PRectilinearGrid"))
    names = [node.get("Source", "") for node in parent.root.findall(f"{parent.kind}/Piece")]
    if not names or len(set(names)) < len(names):
        raise expected("Piece", "pieces in a file each", f"{len(names)} in {len(set(names))} files")
    files = [parse_vtk(data_file(path, name, options.anywhere), (parent.kind[1:],)) for name in names]
    found = [_pieces(file) for file in files]
    pieces = [piece for each, _ in found for piece in each]
    if parent.kind == "PRectilinearGrid":
        return _volume(pieces, _rectilinear(pieces, [each for _, axes in found for each in axes]), options)
    grids = [_grid(file, each, []) for file, (each, _) in zip(files, found, strict=True)]
    if any(not np.allclose(grid[0], grids[0][0]) or not np.allclose(grid[1], grids[0][1]) for grid in grids):
        raise expected("pieces", "one spacing, origin and direction", "several", "merge them with ParaView")
    return _volume(pieces, grids[0], options)


def _pieces(file: VtkXml) -> tuple[list[Piece], list[list[PointArray]]]:
    """The pieces of a file that are not empty, and the coordinates along x, y, z of each, if it has such."""
    owner = file.root.find(file.kind)
    nodes = file.root.findall(f"{file.kind}/Piece")
    if owner is None or not nodes:
        raise expected("Piece", "one or more", "none")
    extents = [extent_of(node if node.get("Extent") else owner) for node in nodes]
    kept = [n for n, extent in enumerate(extents) if all(extent[a + 1] >= extent[a] for a in (0, 2, 4))] or [0]
    found = [_piece(file, nodes[n], extents[n]) for n in kept]
    axes = [_coordinates(file, nodes[n], piece) for n, piece in zip(kept, found, strict=True)]
    return found, axes if file.kind == "RectilinearGrid" else []


def _piece(file: VtkXml, node: Element, extent: list[int]) -> Piece:
    low = (extent[0], extent[2], extent[4])
    shape = grid_shape([extent[axis + 1] - extent[axis] + 1 for axis in (0, 2, 4)], "Extent")
    cells: Shape = tuple(cells_along(count) for count in shape)  # type: ignore[assignment]
    of_points, of_cells = node.find("PointData"), node.find("CellData")
    return Piece(
        low,
        shape,
        [] if of_points is None else arrays_of(file, of_points, shape),
        [] if of_cells is None else arrays_of(file, of_cells, cells),
    )


def _coordinates(file: VtkXml, node: Element, piece: Piece) -> list[PointArray]:
    """Of a rectilinear piece: the coordinates along x, y, z."""
    owner = node.find("Coordinates")
    nodes = [] if owner is None else owner.findall("DataArray")
    if file.kind != "RectilinearGrid":
        return []
    if owner is None or len(nodes) != 3:
        raise expected("Coordinates", "three arrays", len(nodes))
    found = []
    for each, count in zip(nodes, piece.shape[::-1], strict=True):
        alone = Element("Coordinates")
        alone.append(each)
        found += arrays_of(file, alone, (1, 1, count))
    return found


def _grid(file: VtkXml, pieces: list[Piece], coordinates: list[list[PointArray]]) -> Grid:
    if file.kind == "RectilinearGrid":
        return _rectilinear(pieces, coordinates)
    image = file.root.find(file.kind)
    assert image is not None
    direction = np.array(numbers_in(image, "Direction", "1 0 0 0 1 0 0 0 1", 9)).reshape(3, 3)
    return direction * numbers_in(image, "Spacing", "1 1 1", 3), np.array(numbers_in(image, "Origin", "0 0 0", 3))


def _rectilinear(pieces: list[Piece], coordinates: list[list[PointArray]]) -> Grid:
    """The grid of even coordinates; one without steps, of a single sample, has the least of the other two."""
    steps, starts = [], []
    for axis, name in enumerate("xyz"):
        first = min(piece.low[axis] for piece in pieces)
        count = max(piece.low[axis] + piece.shape[2 - axis] for piece in pieces) - first
        parts = [axes[axis].read().ravel() for axes in coordinates]
        if count > sum(part.size for part in parts):
            raise expected("pieces", "a whole grid", f"gaps along {name}")
        places = np.full(count, np.nan)
        for piece, part in zip(pieces, parts, strict=True):
            places[piece.low[axis] - first :][: part.size] = part
        start, step = even_steps(places, f"coordinates along {name}", _UNEVEN)
        steps.append(step)
        starts.append((start, first))
    known = [abs(step) for step in steps if np.isfinite(step)] or [1.0]
    steps = [step if np.isfinite(step) else min(known) for step in steps]
    return np.diag(steps), np.array([start - step * n for (start, n), step in zip(starts, steps, strict=True)])


def _volume(pieces: list[Piece], grid: Grid, options: LoadOptions) -> Volume:
    matrix, origin = grid
    spacing, direction = axes_of(matrix, "Direction and Spacing")
    # 1. the arrays of the points, or of the cells if there are no others, or one of that name
    points, low = joined(pieces, cells=False)
    cells, _ = joined(pieces, cells=True)
    named = [each.name for each in points]
    of_cells = not points or (options.array not in (None, *named) and options.array in [each.name for each in cells])
    arrays = cells if of_cells else points
    samples, vectors = pick(arrays, options)
    hints = hints_for(arrays, options, samples)
    # 2. where the first of them stands
    counts = np.array([max(piece.low[axis] + piece.shape[2 - axis] for piece in pieces) for axis in range(3)]) - low
    first = np.array(low, np.float64) + (np.where(counts > 1, 0.5, 0.0) if of_cells else 0.0)
    place = triple(matrix @ first + origin, "Origin")
    # arrays of points and of cells are listed together
    notes = told([*arrays, *(points if of_cells else cells)], options)
    return Volume(samples, spacing, place, direction, vectors=vectors, hints=hints, notes=notes)
