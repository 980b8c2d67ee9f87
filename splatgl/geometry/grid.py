"""`Grid`: the affine lattice of voxels, and trilinear lookups in it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from splatgl.data.volume import Volume
    from splatgl.splat.splats import Splats


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
        rows, count = _bucket_sort(splats.row_y), np.diff(splats.row_start)
        row_start = np.concatenate([[0], np.cumsum(count[rows])])
        index = ranges(splats.row_start[rows], count[rows])
        plane, plane_start = _groups(splats.row_y[rows])
        return Lattice((1, 2, 0), index, plane, plane_start, splats.row_z[rows], row_start, splats.cell_x[index])
    # single splats, bucketed by x; z, then y still ascend
    index = _bucket_sort(splats.cell_x)
    y, z = _row_values(splats, splats.row_y, index), _row_values(splats, splats.row_z, index)
    row_x, row_z, row_start = index_rows(z, splats.cell_x[index])
    plane, plane_start = _groups(row_x)
    return Lattice((0, 2, 1), index, plane, plane_start, row_z, row_start, y)


def columns(splats: Splats) -> Lattice:
    """The splats in planes across y of rows along z, for access to neighbours along z."""
    index = _bucket_sort(splats.cell_x)
    index = index[_bucket_sort(_row_values(splats, splats.row_y, index))]
    y, z = _row_values(splats, splats.row_y, index), _row_values(splats, splats.row_z, index)
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
    steps = np.repeat(step.astype(_index_type(max(length.sum(), first.max(initial=0), last.max(initial=0)))), length)
    steps[np.cumsum(length) - length] = first - np.append(0, last[:-1])
    return np.asarray(np.cumsum(steps, dtype=steps.dtype, out=steps))


def _index_type(most: int) -> type[np.int32] | type[np.int64]:
    """The narrower type that holds numbers up to `most`."""
    return np.int32 if most < 2**31 else np.int64


def _row_values(splats: Splats, coordinate: np.ndarray, index: np.ndarray) -> np.ndarray:
    """Coordinates of the rows of the splats at `index`."""
    return np.repeat(coordinate, np.diff(splats.row_start))[index]


def _groups(ascending: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distinct values [P] of an ascending array, and the start of each, int64 [P+1]."""
    start = np.flatnonzero(np.diff(ascending, prepend=ascending[:1] - 1))
    return ascending[start], np.append(start, len(ascending))


def _bucket_sort(coordinate: np.ndarray) -> np.ndarray:
    """[N]: stable sort by coordinate. Computed once per volume, never per view.

    16-bit coordinates, the usual case, use numpy's radix sort.
    """
    narrow = len(coordinate) and np.iinfo(np.int16).min <= coordinate.min() and coordinate.max() <= 32767
    order = np.argsort(coordinate.astype(np.int16) if narrow else coordinate, kind="stable")
    return order.astype(_index_type(len(coordinate)))


@dataclass(frozen=True, eq=False)
class Grid:
    """The affine lattice of positions: world = world_from_index @ position + origin."""

    world_from_index: np.ndarray
    origin: np.ndarray

    @classmethod
    def of(cls, volume: Volume) -> Grid:
        """The grid of a volume's voxels."""
        return cls(volume.world_from_index, np.asarray(volume.origin))

    @property
    def mean_spacing(self) -> float:
        """|det A|^(1/3): the side of the cube with a voxel's volume; the unit of length in GL."""
        return float(np.exp(np.linalg.slogdet(self.world_from_index)[1] / 3))

    @property
    def smallest_spacing(self) -> float:
        """The smallest width of a voxel in any direction, world units: the first below a pixel."""
        return float(np.linalg.svd(self.world_from_index, compute_uv=False)[-1])

    @property
    def cubic(self) -> bool:
        """True if a voxel is a cube in any rotation: the footprint is then a disc."""
        scaled = self.world_from_index / self.mean_spacing
        return bool(np.abs(scaled.T @ scaled - np.eye(3)).max() < 1e-6)

    def index_from_world(self, point: np.ndarray) -> np.ndarray:
        """Grid coordinates (x, y, z) of world points [..., 3], float64."""
        return np.asarray((np.asarray(point) - self.origin) @ np.linalg.inv(self.world_from_index).T)


def corners_of(low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """The eight corners [8, 3] of the box between two [3]."""
    return np.array([[x, y, z] for z in (low[2], high[2]) for y in (low[1], high[1]) for x in (low[0], high[0])])


def dilate(mask: np.ndarray, axes: Sequence[int] = (0, 1, 2)) -> np.ndarray:
    """True where the mask or a neighbour along the axes, also diagonally, is True."""
    for axis in axes:
        a = np.moveaxis(mask, axis, 0)
        result = a.copy(order="K")
        result[1:] |= a[:-1]
        result[:-1] |= a[1:]
        mask = np.moveaxis(result, 0, axis)
    return mask


def trilinear(field: np.ndarray, place: np.ndarray) -> np.ndarray:
    """[P, n]: a field [Z, Y, X, n] at places [P, 3] (x, y, z) in cells; clamped at its edges."""
    last = np.array(field.shape[2::-1]) - 1
    inside = np.clip(place, 0, last)
    low = np.minimum(inside.astype(np.int64), np.maximum(last - 1, 0))
    part = inside - low
    total = np.zeros((len(place), field.shape[3]))
    for corner in np.ndindex(2, 2, 2):
        x, y, z = np.minimum(low + np.array(corner), last).T
        share = np.where(corner, part, 1 - part).prod(axis=1)
        total += share[:, None] * field[z, y, x].astype(np.float64)
    return total
