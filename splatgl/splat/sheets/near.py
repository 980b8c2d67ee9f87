"""`NearField`: the voxels around the eye, which belong to the first sheets by where each ray passes them.

A sheet's mean is of voxels at one distance from the eye, e, which a ray passes at √(e² − D²), or behind the eye. From
a few sheets on that is the sheet's own place; nearer, it is up to a third of a voxel off it. There voxels belong to
planes across each ray, by where it passes them, also to one behind the eye.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from splatgl.splat.extraction.splats import Splats
from splatgl.splat.kernel.kernels import Kernel
from splatgl.splat.sheets.sheets import Sheets
from splatgl.splat.view.view import View

# value of a cell without a splat; record values are smaller
ABSENT = float(np.float32(1e30))

# a box of voxels, low ≤ (x, y, z) < high
Box = tuple[np.ndarray, np.ndarray]


@dataclass(frozen=True, eq=False)
class NearField:
    """low int64 [3]: the first voxel (x, y, z). cells float32 [D, H, W, 4]: gradients, and values or ABSENT.

    count: sheets from the eye on that are planes; one behind it is, too. around: voxels in each direction within a
    kernel's reach.
    """

    low: np.ndarray
    cells: np.ndarray
    count: int
    around: int

    @classmethod
    def of(cls, splats: Splats, view: View, sheets: Sheets) -> NearField | None:
        """The voxels of splats around the eye; None if there are none, or none is classified after reconstruction."""
        if splats.post is None or not len(splats):
            return None
        box = near_box(view, sheets, splats.index_bounds)
        if box is None:
            return None
        position = splats.records["position"]
        inside = np.ones(len(position), bool)
        for axis in (2, 1, 0):
            inside &= (position[:, axis] >= box[0][axis]) & (position[:, axis] < box[1][axis])
        return cls.of_records(splats.records[inside], box, view, sheets)

    @classmethod
    def of_records(cls, records: np.ndarray, box: Box, view: View, sheets: Sheets) -> NearField | None:
        """The voxels of a box, which are all of its records."""
        if not len(records):
            return None
        low, high = box
        cells = np.zeros((*(high - low)[::-1], 4), np.float32)
        cells[..., 3] = ABSENT
        x, y, z = np.rint(records["position"]).astype(np.int64).T - low[:, None]
        cells[z, y, x, :3], cells[z, y, x, 3] = records["gradient"], records["value"]
        return cls(low, cells, sheets.near_count(view.kernel.radius), reach_of(view.kernel))


def reach_of(kernel: Kernel) -> int:
    """Voxels before a place, and behind it, along each axis, to which a kernel there may reach."""
    return int(np.ceil(kernel.radius))


def near_box(view: View, sheets: Sheets, bounds: np.ndarray) -> Box | None:
    """The voxels on which the near field depends; None if it is empty, or further than bounds [2, 3], least and largest
    grid position of splats: then no sheet within it holds any.
    """
    if not view.perspective or not sheets.steps:
        return None
    radius, count = view.kernel.radius, sheets.near_count(view.kernel.radius)
    furthest = (count - 1) * sheets.thickness
    reach = max(furthest + radius, (count - 1 + sheets.count / 2) * sheets.thickness)
    if np.linalg.norm(view.eye_index - np.clip(view.eye_index, *bounds)) >= reach:
        return None
    around = reach_of(view.kernel)
    low = np.floor(view.eye_index - furthest).astype(np.int64) - around + 1
    return low, np.floor(view.eye_index + furthest).astype(np.int64) + around + 1
