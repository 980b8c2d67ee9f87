"""`Coarse`: extinction of a picture's matter in at most about a hundred cells along each axis.

Cells are blocks of whole voxels of the first volume's grid, with means of the voxels in them; voxels of other volumes
are shared out over the eight cells around each.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from splatgl.splat.classification.post import CELLS
from splatgl.splat.extraction.parts import in_parts
from splatgl.splat.extraction.splats import Grid, Splats, corners_of
from splatgl.splat.view.clip import Clip, Plane

# most cells along the longest side, and empty ones around all
MOST_CELLS, MARGIN = 112, 2
# largest optical depth of a voxel: opaque ones in a block hide about what they cover, not all that is behind it
MOST_DEPTH = 3.0
# splats at a time
PART = 2**18

# splats, and the planes that cut them
Caster = tuple[Splats, tuple[Plane, ...]]


@dataclass(frozen=True, eq=False)
class Coarse:
    """extinction float32 [Z, Y, X]: per world length. cells: the centre of (x, y, z) lies at `cells` of it."""

    extinction: np.ndarray
    cells: Grid

    @classmethod
    def of(cls, casters: Sequence[Caster]) -> Coarse:
        """The cells around all splats."""
        first = casters[0][0].grid
        every = np.concatenate([_box(splats, first) for splats, _ in casters])
        low, high = np.rint(every.min(axis=0)) - 0.5, every.max(axis=0) + 0.5
        widths = np.linalg.norm(first.world_from_index, axis=0)
        side = float(((high - low) * widths).max()) / MOST_CELLS
        block = np.maximum(np.ceil(side / widths - 1e-9), 1.0)
        count = np.ceil((high - low) / block - 1e-9).astype(int) + 2 * MARGIN
        # of the centre of the first cell, in the first volume's indices
        start = low + (0.5 - MARGIN) * block
        cells = Grid(first.world_from_index * block, first.world_from_index @ start + first.origin)
        total = np.zeros(int(count.prod()))
        for n, (splats, planes) in enumerate(casters):
            for place, weight in _weights(splats, planes, cells, count, shared=n > 0):
                total += np.bincount(place, weight, len(total))
        volume = abs(np.linalg.det(cells.world_from_index))
        return cls((total / volume).astype(np.float32).reshape(count[::-1]), cells)


def _box(splats: Splats, grid: Grid) -> np.ndarray:
    """Corners [8, 3] of the box of all splats' voxels less half a voxel, in indices of a grid."""
    if splats.grid is grid:
        return splats.corners_in_grid()
    return grid.index_from_world(corners_of(*splats.index_bounds) @ splats.grid.world_from_index.T + splats.grid.origin)


def _weights(
    splats: Splats, planes: tuple[Plane, ...], cells: Grid, count: np.ndarray, shared: bool
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Cells, and extinction times volume of splats in them."""
    clip = Clip.of(planes, splats.grid)
    size = splats.grid.mean_spacing
    into = np.linalg.inv(cells.world_from_index)
    turn, moved = into @ splats.grid.world_from_index, into @ (np.asarray(splats.grid.origin) - cells.origin)

    def found(part: slice) -> list[tuple[np.ndarray, np.ndarray]]:
        position = splats.records["position"][part].astype(np.float64)
        weight = np.minimum(depths(splats, part), MOST_DEPTH) * size**2
        if clip is not None:
            weight[~clip.keeps(position)] = 0.0
        if splats.mask is not None:
            weight[~splats.mask.keeps(position)] = 0.0
        place = position @ turn.T + moved
        return _shared(place, weight, count) if shared else [(_flat(np.rint(place).astype(np.int64), count), weight)]

    for pairs in in_parts(len(splats), PART, found):
        yield from pairs


def _shared(place: np.ndarray, weight: np.ndarray, count: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """The eight cells around places [N, 3], and the shares of weights [N] in them."""
    low = np.floor(place).astype(np.int64)
    part = place - low
    pairs = []
    for corner in np.ndindex(2, 2, 2):
        share = np.where(corner, part, 1 - part).prod(axis=1)
        pairs.append((_flat(low + np.array(corner), count), weight * share))
    return pairs


def _flat(cell: np.ndarray, count: np.ndarray) -> np.ndarray:
    """Numbers of cells [N, 3] (x, y, z), of which all lie in the grid."""
    x, y, z = np.clip(cell, 0, count - 1).T
    return np.asarray((z * count[1] + y) * count[0] + x)


def depths(splats: Splats, part: slice) -> np.ndarray:
    """Optical depths [N] over a mean spacing of some splats; of values means over those that lie in a voxel."""
    post = splats.post
    if post is None:
        return splats.records["optical_depth"][part].astype(np.float64)
    records = splats.records[part]
    value, size = records["value"].astype(np.float64), np.linalg.norm(records["gradient"].astype(np.float64), axis=1)
    scale, shift = post.scale
    # at least a cell of the table
    half = np.maximum(scale * size, 1.0) / 2
    middle = scale * value + shift
    table, unit = post.table
    until = table[:, 3].astype(np.float64) * unit
    before, behind = post.integral.outside[:, 3]

    def integral(place: np.ndarray) -> np.ndarray:
        inside = np.clip(place, 0.0, CELLS)
        cell = np.minimum(inside.astype(np.int64), CELLS - 1)
        low = until[cell]
        beyond = (place - inside) * np.where(place < 0, before, behind)
        return np.asarray(low + (inside - cell) * (until[cell + 1] - low) + beyond)

    extinction = np.maximum(integral(middle + half) - integral(middle - half), 0.0) / (2 * half)
    if post.transfer.gradient:
        weight = post.transfer.weight(size * post.span / splats.grid.mean_spacing)
        with np.errstate(divide="ignore"):
            extinction = np.where(weight < 1, -np.log1p(np.expm1(-extinction) * weight), extinction)
    return np.asarray(extinction * (splats.grid.mean_spacing / splats.unit))
