"""Run lengths of occupied cells around each splat, along x, y and z.

A run of one is the width of a dot, thread, sheet or surface layer. Runs give the filled share of a pixel
wider than a voxel and its number of layers in depth.
"""

from __future__ import annotations

import numpy as np

from splatgl.splat.extraction.lattice import Lattice, columns
from splatgl.splat.extraction.splats import Splats

# five bits an axis: code k stands for a run of 2^(k·OCTAVES) cells, so that 31 is about 1000
OCTAVES = 0.32
CODES = 32
# neighbours whose optical depths differ by more than this factor break a run
CONTRAST = 4.0


def packed_runs(splats: Splats) -> np.ndarray:
    """int16 [N]: run lengths along x, y, z, coded, as x + 32 y + 1024 z."""
    runs = np.empty((3, len(splats)), np.int16)
    octaves = np.log2(np.maximum(splats.records["optical_depth"], np.finfo(np.float32).tiny))
    for axis, lattice in enumerate((splats.lattice(2), splats.lattice(0), columns(splats))):
        runs[axis] = _runs_along(lattice, octaves if lattice.index is None else octaves[lattice.index])
    return runs[0] + 32 * runs[1] + 1024 * runs[2]


def _runs_along(lattice: Lattice, octaves: np.ndarray) -> np.ndarray:
    """int16 [N], by record: coded length of the run of similar neighbours that contains each member, along its rows.

    octaves [N]: log2 of the members' optical depth.
    """
    count = len(lattice.cell)
    row = np.repeat(np.arange(len(lattice.row)), np.diff(lattice.row_start))
    # cells that hold several points stay in one run
    breaks = (np.diff(row) != 0) | (np.diff(lattice.cell) > 1) | (np.abs(np.diff(octaves)) > np.log2(CONTRAST))
    first = np.concatenate([[0], np.flatnonzero(breaks) + 1]) if count else np.zeros(0, np.int64)
    last = np.append(first[1:], count) - 1 if count else first
    length = lattice.cell[last] - lattice.cell[first] + 1
    code = np.minimum(np.rint(np.log2(length) / OCTAVES), CODES - 1).astype(np.int16)
    runs = np.repeat(code, np.diff(np.append(first, count)))
    result = np.empty(count, np.int16)
    result[slice(None) if lattice.index is None else lattice.index] = runs
    return result
