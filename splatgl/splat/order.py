"""Back to front straight from the rows, without a sort: each axis is split at the eye's cell.

Cells beyond the eye's are read downwards first, the rest upwards, along z, then y, then x: at most
eight boxes, each in a fixed direction. Of two cells that share a face, the one on the eye's side of
the face comes last.  [M98 §5: drawn back to front without a sort]
"""

from __future__ import annotations

import numpy as np

from splatgl.splat.camera import Camera
from splatgl.splat.rows import Splats

Cell = tuple[int, int, int]


def eye_cell(splats: Splats, camera: Camera) -> Cell:
    """The cell (x, y, z) that holds the eye, at most one beyond the splats: the key of the order.

    Orthographic: the eye is infinitely far back along the view.
    """
    low, high = np.rint(splats.index_bounds).astype(np.int64) + np.array([[-1], [1]])
    if camera.perspective:
        eye = np.rint(splats.grid.index_from_world(camera.eye))
    else:
        view = np.linalg.solve(splats.grid.world_from_index, camera.forward)
        eye = np.where(view > 0, -np.inf, np.inf)
    x, y, z = (int(n) for n in np.clip(eye, low, high))
    return x, y, z


def back_to_front(splats: Splats, cell: Cell) -> np.ndarray:
    """Record indices int64 [N] in drawing order for an eye in `cell`; reversed it is front to back."""
    x, y, z = cell
    boxes = []
    planes, rows = splats.plane_start, splats.row_start
    # where each plane's rows pass the eye's y, and each row's splats the eye's x
    split_y = planes[:-1] + _count_to(splats.row_y <= y, planes)
    split_x = rows[:-1] + _count_to(splats.cell_x <= x, rows)
    plane_z = splats.row_z[planes[:-1]] if len(splats.row_z) else splats.row_z
    for far_z in (True, False):
        chosen = _directed(np.flatnonzero((plane_z > z) == far_z), far_z)
        for far_y in (True, False):
            start, stop = _side(planes, split_y, chosen, far_y)
            row = _ranges(start, stop, far_y)
            for far_x in (True, False):
                start, stop = _side(rows, split_x, row, far_x)
                boxes.append(_ranges(start, stop, far_x))
    return np.concatenate(boxes)


def _directed(indices: np.ndarray, downwards: bool) -> np.ndarray:
    return indices[::-1] if downwards else indices


def _side(start: np.ndarray, split: np.ndarray, chosen: np.ndarray, far: bool) -> tuple[np.ndarray, np.ndarray]:
    """The part of each chosen range beyond the eye (far) or up to it."""
    return (split[chosen], start[chosen + 1]) if far else (start[chosen], split[chosen])


def _count_to(inside: np.ndarray, start: np.ndarray) -> np.ndarray:
    """How many of each range's members are inside; members inside come first."""
    return np.diff(np.concatenate([[0], np.cumsum(inside)])[start])


def _ranges(start: np.ndarray, stop: np.ndarray, downwards: bool) -> np.ndarray:
    """All of start … stop−1 of every range in turn, each range read downwards or upwards."""
    length = stop - start
    offset = np.concatenate([[0], np.cumsum(length)])
    within = np.arange(offset[-1]) - np.repeat(offset[:-1], length)
    return np.repeat(stop - 1, length) - within if downwards else np.repeat(start, length) + within
