"""Clusters: splats of one picture in the same box of cells, which are drawn or skipped together.

A cluster is drawn if it has splats in the sheets of a round and may touch an open tile. Rounds are ranges of sheets, so
that each sheet is complete at the end of its round, and tiles terminated by then hide all later rounds. What is left
out would not have changed any pixel.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from splatgl.geometry.view import GridView
from splatgl.planning.culling import BOUNDS_MARGIN, HAS_PLACE, STRETCHED, PixelWindow
from splatgl.planning.plan import Plan
from splatgl.planning.technique import COLUMNS, ROWS
from splatgl.splat.sheets import Sheets, index_direction
from splatgl.splat.splats import Splats, check_now, is_points

# bits of a cell along an axis of a cluster, with their mask, and of the number of a splat
SIDE_BITS, NAME_BITS = 2, 24
INSIDE = (1 << SIDE_BITS) - 1
# sheets by which float32 may place a splat nearer or further than float64
SLACK = 1
# a round has at least LEAST splats, and this share of those left; twice the share once the tiles that terminated in a
# round hid less than HIDDEN of what was left
SHARE, LEAST, HIDDEN = 0.12, 1 << 16, 0.2


class RoundSplats(NamedTuple):
    """Splats of a round. clusters int64 [n]: their numbers. sheets: first sheet and end, counted from the first of all.
    last: whether no more rounds follow.
    """

    clusters: np.ndarray
    sheets: tuple[int, int]
    last: bool


@dataclass(frozen=True, eq=False)
class Clusters:
    """low, high float64 [3, C]: boxes around the splats' positions, grid indices. corner int64 [3, C]: first cells.
    begin int64 [C + 1]: starts in `names`, and its end. names uint32 [N]: numbers of the splats, cluster by cluster,
    and from bit NAME_BITS on their cells from the corner, SIDE_BITS an axis.
    """

    low: np.ndarray
    high: np.ndarray
    corner: np.ndarray
    begin: np.ndarray
    names: np.ndarray

    @classmethod
    def of(cls, splats: Splats) -> Clusters:
        """Groups splats by boxes of 2^SIDE_BITS cells a side; in a cluster they keep their order."""
        x, starts = splats.cell_x, np.ones(len(splats), bool)
        starts[1:] = x[1:] >> SIDE_BITS != x[:-1] >> SIDE_BITS
        starts[splats.row_start[:-1]] = True
        # parts of rows, by box
        start = np.flatnonzero(starts)
        row = np.repeat(np.arange(len(splats.row_y)), np.diff(np.searchsorted(start, splats.row_start)))
        boxes = np.stack([x[start], splats.row_y[row], splats.row_z[row]]).astype(np.int64) >> SIDE_BITS
        across, down, _ = np.ptp(boxes, axis=1) + 1
        box = (boxes[2] * down + boxes[1]) * across + boxes[0]
        check_now()
        by_box = np.argsort(box, kind="stable")
        groups = np.concatenate([[0], np.flatnonzero(np.diff(box[by_box])) + 1])
        corner = boxes[:, by_box[groups]] << SIDE_BITS
        first, row = start[by_box], row[by_box]
        length = np.diff(np.append(start, len(splats)))[by_box]
        until = np.cumsum(length)
        begin = np.append((until - length)[groups], len(splats))
        check_now()
        # unsigned numbers wrap around
        order = np.repeat((first - (until - length)).astype(np.uint32), length)
        order += np.arange(len(splats), dtype=np.uint32)
        y, z = splats.row_y[row], splats.row_z[row]
        cells = (y & INSIDE) << SIDE_BITS | (z & INSIDE) << 2 * SIDE_BITS
        names = np.repeat(cells.astype(np.uint32) << NAME_BITS, length)
        names |= np.take((x & INSIDE).astype(np.uint32) << NAME_BITS, order)
        if is_points(splats.records.dtype):
            # these may be anywhere in their cells
            places, groups = [splats.records["position"][order].T.astype(np.float64)] * 2, begin[:-1]
        else:
            places = [np.stack([x[end], y, z]).astype(np.float64) for end in (first, first + length - 1)]
        low = np.minimum.reduceat(places[0], groups, axis=1)
        high = np.maximum.reduceat(places[1], groups, axis=1)
        return cls(low, high, corner, begin, names | order)

    def parts(self, clusters: np.ndarray) -> np.ndarray:
        """uint32 [n, 4], of some clusters: begin and end in `names`, and the corner, x and y in one word."""
        x, y, z = self.corner[:, clusters]
        return np.stack([self.begin[clusters], self.begin[clusters + 1], x | y << 16, z], axis=1).astype(np.uint32)

    def sheets(self, view: GridView, sheets: Sheets) -> tuple[np.ndarray, np.ndarray]:
        """int64 [C] each: the least and the largest first sheet of a splat of each cluster."""
        low, high = self.low - view.eye_index[:, None], self.high - view.eye_index[:, None]
        if view.perspective:
            near = np.linalg.norm(np.maximum(np.maximum(low, -high), 0.0), axis=0)
            far = np.linalg.norm(np.maximum(-low, high), axis=0)
        else:
            direction = index_direction(view)
            middle, half = direction @ (low + high) / 2, np.abs(direction) @ (high - low) / 2
            near, far = middle - half, middle + half
        return sheets.base(near / sheets.thickness) - SLACK, sheets.base(far / sheets.thickness) + SLACK

    def rounds(
        self, splats: Splats, plan: Plan, window: PixelWindow, closed: Callable[[], np.ndarray], stride: int = 1
    ) -> Iterator[RoundSplats]:
        """Yields the rounds of a window, nearest first. closed: returns the mask of tiles that need no splats, which
        rounds change. stride: pixels of the view from one of the window's samples to the next.
        """
        sheets, view = plan.resolved.sheets, plan.view
        assert sheets is not None
        base, end = sheets.range(splats, view)
        first, last = (np.clip(ends - base, 0, end - base) for ends in self.sheets(view, sheets))
        tiles, count = touched_tiles(self.low, self.high, view, window, stride), np.diff(self.begin)
        begin, most, wide, expected = 0, end - base + 1, 1.0, np.inf
        while begin < most:
            open_ = sums_of_open(closed().reshape(-1, -(-window.width // COLUMNS)))
            shown = np.flatnonzero((last >= begin) & has_open(tiles, open_))
            if not len(shown):
                return
            # the splats of a cluster that are left, about in the middle of its sheets that are left
            share = (last[shown] + 1 - np.maximum(first[shown], begin)) / (last[shown] + 1 - first[shown])
            middle = (np.maximum(first[shown], begin) + last[shown]) // 2
            before = np.cumsum(np.bincount(middle, count[shown] * share, most))
            if before[-1] > (1 - HIDDEN) * expected:
                wide *= 2
            target = max(SHARE * wide * before[-1], LEAST)
            until = most
            if before[-1] > 2 * target:
                until = max(int(np.searchsorted(before, target)) + 1, begin + 1)
            yield RoundSplats(shown[first[shown] < until], (begin, until), until == most)
            begin, expected = until, before[-1] - before[until - 1]


def touched_tiles(
    low: np.ndarray, high: np.ndarray, view: GridView, window: PixelWindow, stride: int = 1
) -> np.ndarray:
    """int64 [4, C]: first column and row of tiles of a window, and end column and row, that splats in boxes from low to
    high [3, C], grid indices, may touch; the end is not after the first if there are none.
    """
    centre = view.voxels((low + high).T / 2)
    half = np.abs(view.eye_from_index) @ (high - low) / 2
    nearest = centre[2] - half[2]
    # boxes around the kernels
    half = half + view.kernel.radius * np.linalg.norm(view.eye_from_index, axis=1)[:, None]
    low, high, margin = centre[:2] - half[:2], centre[:2] + half[:2], np.full(2, float(BOUNDS_MARGIN))
    everywhere = np.zeros(len(nearest), bool)
    if view.perspective:
        # a splat beside the eye has no place in the picture
        everywhere = (centre[2] - half[2] <= 0) | (nearest <= 2 * HAS_PLACE * view.depth_reach)
        ends = np.where(everywhere, 1.0, np.stack([centre[2] - half[2], centre[2] + half[2]]))
        low, high = low / np.where(low > 0, ends[1], ends[0]), high / np.where(high > 0, ends[0], ends[1])
    if view.antialias:
        slant = float(np.hypot(*view.edge)) if view.perspective else 0.0
        margin += STRETCHED * view.kernel.radius * view.blur * (1 + slant)
    offset = stride * np.array([[window.x], [window.y]]) - np.array([view.size]).T / 2
    side, many = np.array([[COLUMNS], [ROWS]]), np.array([[window.width], [window.height]])
    many, side = -(-many // side), stride * side
    first = np.floor((low / view.pitch - margin[:, None] - offset) / side)
    end = np.floor((high / view.pitch + margin[:, None] - offset) / side) + 1
    first, end = np.where(everywhere, 0, first), np.where(everywhere, many, end)
    return np.concatenate([np.clip(first, 0, many), np.clip(end, 0, many)]).astype(np.int64)


def sums_of_open(closed: np.ndarray) -> np.ndarray:
    """int64 [rows + 1, columns + 1]: numbers of open tiles above and left of each corner. closed [rows, columns]."""
    before = np.zeros((closed.shape[0] + 1, closed.shape[1] + 1), np.int64)
    before[1:, 1:] = np.cumsum(np.cumsum(~closed, axis=0), axis=1)
    return before


def has_open(tiles: np.ndarray, before: np.ndarray) -> np.ndarray:
    """bool [C]: whether rectangles of tiles [4, C] have an open one. before: of `sums_of_open`."""
    x, y, right, lower = tiles
    right, lower = np.maximum(x, right), np.maximum(y, lower)
    return np.asarray(before[lower, right] - before[y, right] - before[lower, x] + before[y, x] > 0)
