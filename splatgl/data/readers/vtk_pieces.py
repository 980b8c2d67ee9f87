"""Pieces of a VTK grid joined into one: each array of all of them as one array."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from splatgl.data.readers.files import Shape
from splatgl.data.readers.vtk_arrays import PointArray
from splatgl.errors import expected

Index = tuple[int, int, int]


@dataclass(frozen=True)
class Piece:
    """Part of a grid: index (x, y, z) of its first point, points along z, y, x, and the arrays of points and cells."""

    low: Index
    shape: Shape
    points: list[PointArray]
    cells: list[PointArray]


def cells_along(points: int) -> int:
    """Cells along an axis; a flat grid has one layer."""
    return max(points - 1, 1)


def joined(pieces: Sequence[Piece], cells: bool) -> tuple[list[PointArray], Index]:
    """The arrays of the points or cells of all pieces, and the index of the first point.

    Where pieces overlap the later one counts. Raises InputError, once an array is read, if they leave gaps.
    """
    first: Index = tuple(min(piece.low[axis] for piece in pieces) for axis in range(3))  # type: ignore[assignment]
    groups = [piece.cells if cells else piece.points for piece in pieces]
    if len(pieces) == 1:
        return groups[0], first
    told = [[(each.name, each.components, each.dtype) for each in group] for group in groups]
    if any(each != told[0] for each in told):
        raise expected("pieces", "the same arrays in all", "others", "save the grid again")
    last = [max(piece.low[axis] + piece.shape[2 - axis] for piece in pieces) for axis in range(3)]
    shape = tuple(end - begin for end, begin in zip(last[::-1], first[::-1], strict=True))
    counts: Shape = tuple(cells_along(size) for size in shape) if cells else shape  # type: ignore[assignment]
    lows = [tuple(at - begin for at, begin in zip(piece.low, first, strict=True))[::-1] for piece in pieces]
    return [
        PointArray(one.name, one.components, one.is_vectors, partial(_join, parts, lows, counts), one.dtype)
        for one, *_ in zip(*groups, strict=True)
        for parts in [[group[groups[0].index(one)] for group in groups]]
    ], first


def _join(parts: Sequence[PointArray], lows: Sequence[tuple[int, ...]], shape: Shape) -> np.ndarray:
    """One array [D, H, W, components] out of those of the pieces."""
    # every piece is checked against its file before the whole is allocated
    arrays = [part.read() for part in parts]
    if np.prod(shape, dtype=np.float64) > sum(array.size / array.shape[3] for array in arrays):
        raise expected("pieces", "a whole grid", "gaps between them")
    whole = np.empty((*shape, parts[0].components), parts[0].dtype)
    filled = np.zeros(shape, bool)
    for array, low in zip(arrays, lows, strict=True):
        box = tuple(slice(at, at + size) for at, size in zip(low, array.shape[:3], strict=True))
        whole[box], filled[box] = array, True
    if not filled.all():
        raise expected("pieces", "a whole grid", "gaps between them")
    return whole
