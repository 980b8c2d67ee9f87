"""Splats between two depths; skips whole rows outside."""

from __future__ import annotations

import numpy as np

from splatgl.splat.extraction.splats import Splats
from splatgl.splat.view.view import View


def between(splats: Splats, view: View, low: float, high: float) -> np.ndarray:
    """[3, N]: the centres, eye axes in mean spacings, of the splats whose depth is from `low` to `high`."""
    # depth is linear along a row; points may be anywhere in their cells
    start = splats.row_start
    ends = np.stack([splats.records["position"][start[:-1]], splats.records["position"][start[1:] - 1]])
    steps = view.eye_from_index[2]
    depth = (ends.astype(np.float64) - view.eye_index) @ steps
    slack = np.abs(steps).sum()
    rows = np.flatnonzero((depth.max(axis=0) + slack >= low) & (depth.min(axis=0) - slack <= high))
    count = start[rows + 1] - start[rows]
    member = np.arange(count.sum()) + np.repeat(start[rows] - (np.cumsum(count) - count), count)
    found = view.voxels(splats.records["position"][member])
    return np.asarray(found[:, (found[2] >= low) & (found[2] <= high)])
