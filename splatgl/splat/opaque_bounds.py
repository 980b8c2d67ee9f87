"""Where the opaque samples of a volume are, which a view is fitted to: found slab by slab, without splats."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np

from splatgl.data.volume import Slab, Volume
from splatgl.splat.extract import Lookup
from splatgl.splat.grid import Grid
from splatgl.splat.preintegration import opaque_intervals
from splatgl.splat.splats import Splats, assemble, record_type
from splatgl.splat.transfer import Transfer

# voxels looked at together
SLAB_VOXELS = 1 << 22
# most voxels that are looked at for a view, and of an image of several levels, few of which a picture may take; of
# more, the volume's box is taken
MOST, MOST_OF_LEVELS = 1 << 31, 1 << 28


@dataclass(frozen=True, eq=False)
class Opaque:
    """What a camera asks of a subject; the volume is only read if it does. Splats of values are fitted to these too:
    what they carry is the kernel's coefficients, and transparent ones lie beside.
    """

    volume: Volume
    transfer: Transfer

    @property
    def frame(self) -> str | None:
        """LPS, RAS or None, as the volume has it."""
        return self.volume.frame

    @property
    def nothing(self) -> bool:
        """Whether no sample is opaque, of those that are looked at."""
        return self._ends is None and self.volume.count <= (MOST_OF_LEVELS if self.volume.coarser else MOST)

    @property
    def corners(self) -> np.ndarray:
        """The eight corners [8, 3], world units, of the box of opaque samples; of all, if there is none."""
        return self.volume.corners if self._ends is None else self._ends.corners

    @property
    def outline(self) -> np.ndarray:
        """Points [N, 3], world units, whose hull contains them."""
        return self.volume.outline if self._ends is None else self._ends.outline

    @cached_property
    def _ends(self) -> Splats | None:
        """The first and the last opaque sample of each row, as splats."""
        volume = self.volume
        if volume.count > (MOST_OF_LEVELS if volume.coarser else MOST):
            return None
        record = record_type(volume.shape, post=False)
        keeps = Lookup.of(self.transfer, volume.samples.dtype, 0.0, record).keeps
        if volume.samples.dtype.kind == "f":
            keeps = partial(_within, opaque_intervals(self.transfer))
        _, height, width = volume.shape
        slabs = volume.slabs(max(1, SLAB_VOXELS // (height * width)), halo=0)
        found = np.concatenate([_row_ends(slab, self._kept(slab, keeps)) for slab in slabs])
        if not len(found):
            return None
        records = np.zeros(len(found), record)
        records["position"] = found
        grid = Grid(volume.world_from_index, np.asarray(volume.origin))
        return assemble(records, found, grid, grid.mean_spacing, volume.name)

    def _kept(self, slab: Slab, keeps: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
        """Which samples of a slab are opaque, and kept by masks."""
        opaque, volume = keeps(np.ascontiguousarray(slab.samples)), self.volume
        if volume.masks:
            opaque = opaque & volume.kept((slab.start, 0, 0), (slab.stop, *volume.shape[1:]))
        return opaque


def _within(intervals: np.ndarray, samples: np.ndarray) -> np.ndarray:
    """Where finite samples lie in closed intervals [n, 2], bool; without opacities of all of them."""
    most = float(np.finfo(samples.dtype).max)
    found = np.zeros(samples.shape, bool)
    for low, high in np.clip(intervals, -most, most).tolist():
        found |= (samples >= low) & (samples <= high)
    return found


def _row_ends(slab: Slab, opaque: np.ndarray) -> np.ndarray:
    """int32 [N, 3] (x, y, z), in row order: the ends of the rows' opaque samples."""
    z, y = np.nonzero(opaque.any(axis=2))
    rows = opaque[z, y]
    first, last = rows.argmax(axis=1), rows.shape[1] - 1 - rows[:, ::-1].argmax(axis=1)
    ends = np.stack([np.stack([x, y, z + slab.start], axis=1) for x in (first, last)], axis=1)
    return ends.reshape(-1, 3).astype(np.int32)
