"""Back-to-front order from the rows, without a sort: each axis is split at the eye's cell.

Along every axis the cells beyond the eye's are read in descending order first, the rest ascending:
plane by plane, within a plane row by row, within a row splat by splat. Of two cells that share a face,
the one on the eye's side comes last. Planes lie across the view, so that overlapping footprints are
seldom drawn out of depth order.  [M98 §3.5: drawn back to front without a sort]
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from splatgl.geometry.camera import Camera
from splatgl.geometry.grid import ranges
from splatgl.splat.splats import Splats


@dataclass(frozen=True)
class Order:
    """Key of the drawing order: the eye's cell (x, y, z), and the axis (0 is x) perpendicular to the planes."""

    cell: tuple[int, int, int]
    axis: int


def order_for(splats: Splats, camera: Camera) -> Order:
    """The order for a view; it changes only with the eye's cell or main axis.

    The cell is at most one beyond the splats; an orthographic eye is infinitely far back along the view.
    """
    low, high = np.rint(splats.index_bounds).astype(np.int64) + np.array([[-1], [1]])
    index_from_world = np.linalg.inv(splats.grid.world_from_index)
    view = index_from_world @ camera.forward
    if camera.perspective:
        eye = np.rint(splats.grid.index_from_world(camera.eye))
    else:
        eye = np.where(view > 0, -np.inf, np.inf)
    x, y, z = (int(n) for n in np.clip(eye, low, high))
    # the planes whose normal is nearest to the view direction; z on a tie
    across = np.abs(view) / np.linalg.norm(index_from_world, axis=1)
    axis = 2 - int(np.argmax(across[::-1]))
    return Order((x, y, z), axis)


def back_to_front(splats: Splats, order: Order) -> np.ndarray:
    """Record indices [N] in drawing order; reversed it is front to back."""
    lattice = splats.lattice(order.axis)
    outer, middle, inner = (order.cell[axis] for axis in lattice.axes)
    planes = _far_first(np.array([0]), np.array([len(lattice.plane)]), _count_before(lattice.plane <= outer))
    rows = _split_ranges(lattice.plane_start, _count_before(lattice.row <= middle), planes)
    splat = _split_ranges(lattice.row_start, _count_before(lattice.cell <= inner), rows)
    return splat if lattice.index is None else lattice.index[splat]


def _count_before(inside: np.ndarray) -> np.ndarray:
    """Number of inside members among the first 0, 1, … n: [n+1]."""
    count = np.zeros(len(inside) + 1, np.int32 if len(inside) < 2**31 else np.int64)
    np.cumsum(inside, out=count[1:])
    return count


def _split_ranges(start: np.ndarray, inside: np.ndarray, chosen: np.ndarray) -> np.ndarray:
    """The members of each chosen range in turn, each range far side first."""
    return _far_first(start[chosen], start[chosen + 1], inside)


def _far_first(start: np.ndarray, stop: np.ndarray, inside: np.ndarray) -> np.ndarray:
    """Members start … stop−1 of every range: those beyond the eye descending, then the rest ascending."""
    split = start + inside[stop] - inside[start]
    first = np.stack([stop - 1, start], axis=1).ravel()
    length = np.stack([stop - split, split - start], axis=1).ravel()
    return ranges(first, length, np.tile([-1, 1], len(start)))
