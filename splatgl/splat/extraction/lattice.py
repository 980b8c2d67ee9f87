"""`Lattice`: splats in planes of rows, found from the rows that they are extracted in, without a sort by place."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from splatgl.splat.extraction.splats import Splats


@dataclass(frozen=True, eq=False)
class Lattice:
    """Splats as planes of rows: members are sorted by their cells along axes[0], then [1], then [2].

    index [N]: the members' records; None: the records in their own order. plane [P], row [M], cell [N]: coordinates
    along the three axes; plane_start [P+1] counts rows, row_start [M+1] members.
    """

    axes: tuple[int, int, int]
    index: np.ndarray | None
    plane: np.ndarray
    plane_start: np.ndarray
    row: np.ndarray
    row_start: np.ndarray
    cell: np.ndarray


def lattice_across(splats: Splats, axis: int) -> Lattice:
    """The splats in planes across `axis` (0 is x)."""
    if axis == 2:
        plane, plane_start = _groups(splats.row_z)
        return Lattice((2, 1, 0), None, plane, plane_start, splats.row_y, splats.row_start, splats.cell_x)
    if axis == 1:
        # whole rows, bucketed by y; z still ascends
        rows, count = _bucketed(splats.row_y), np.diff(splats.row_start)
        row_start = np.concatenate([[0], np.cumsum(count[rows])])
        index = ranges(splats.row_start[rows], count[rows])
        plane, plane_start = _groups(splats.row_y[rows])
        return Lattice((1, 2, 0), index, plane, plane_start, splats.row_z[rows], row_start, splats.cell_x[index])
    # single splats, bucketed by x; z, then y still ascend
    index = _bucketed(splats.cell_x)
    y, z = _in_rows(splats, splats.row_y, index), _in_rows(splats, splats.row_z, index)
    row_x, row_z, row_start = index_rows(z, splats.cell_x[index])
    plane, plane_start = _groups(row_x)
    return Lattice((0, 2, 1), index, plane, plane_start, row_z, row_start, y)


def columns(splats: Splats) -> Lattice:
    """The splats in planes across y of rows along z, for access to neighbours along z."""
    index = _bucketed(splats.cell_x)
    index = index[_bucketed(_in_rows(splats, splats.row_y, index))]
    y, z = _in_rows(splats, splats.row_y, index), _in_rows(splats, splats.row_z, index)
    row_y, row_x, row_start = index_rows(splats.cell_x[index], y)
    plane, plane_start = _groups(row_y)
    return Lattice((1, 0, 2), index, plane, plane_start, row_x, row_start, z)


def index_rows(y: np.ndarray, z: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(row_z, row_y, row_start) from the splats' cell y and z in row order."""
    if not len(y):
        return np.zeros(0, np.int32), np.zeros(0, np.int32), np.zeros(1, np.int64)
    first = np.ones(len(y), bool)
    np.not_equal(y[1:], y[:-1], out=first[1:])
    first[1:] |= z[1:] != z[:-1]
    start = np.flatnonzero(first)
    return z[start].astype(np.int32), y[start].astype(np.int32), np.append(start, len(y))


def ranges(first: np.ndarray, length: np.ndarray, step: np.ndarray | int = 1) -> np.ndarray:
    """The whole numbers first, first + step, … of every range, one after another; 32 bits wide if they fit."""
    some = length > 0
    first, length, step = first[some], length[some], np.broadcast_to(step, len(some))[some]
    last = first + step * (length - 1)
    found = np.repeat(step.astype(_kind(max(length.sum(), first.max(initial=0), last.max(initial=0)))), length)
    found[np.cumsum(length) - length] = first - np.append(0, last[:-1])
    return np.asarray(np.cumsum(found, dtype=found.dtype, out=found))


def _kind(most: int) -> type[np.int32] | type[np.int64]:
    """The narrower type that holds numbers up to `most`."""
    return np.int32 if most < 2**31 else np.int64


def _in_rows(splats: Splats, coordinate: np.ndarray, index: np.ndarray) -> np.ndarray:
    """A coordinate of rows, of those splats."""
    return np.repeat(coordinate, np.diff(splats.row_start))[index]


def _groups(ascending: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The different values of an ascending array, and where each begins: [P] and int64 [P+1]."""
    start = np.flatnonzero(np.diff(ascending, prepend=ascending[:1] - 1))
    return ascending[start], np.append(start, len(ascending))


def _bucketed(coordinate: np.ndarray) -> np.ndarray:
    """[N]: stable sort by coordinate. Computed once per volume, never per view.

    16-bit coordinates, the usual case, use numpy's radix sort.
    """
    narrow = len(coordinate) and np.iinfo(np.int16).min <= coordinate.min() and coordinate.max() <= 32767
    order = np.argsort(coordinate.astype(np.int16) if narrow else coordinate, kind="stable")
    return order.astype(_kind(len(coordinate)))
