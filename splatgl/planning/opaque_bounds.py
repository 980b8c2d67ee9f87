"""Bounds of a volume's opaque samples, to fit a view; computed slab by slab, without splats."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np

from splatgl.data.volume import Slab, Volume
from splatgl.geometry.grid import Grid, dilate
from splatgl.splat.extract import Lookup
from splatgl.splat.splats import Splats, assemble, record_type
from splatgl.transfer.preintegration import opaque_intervals
from splatgl.transfer.transfer import Transfer

# voxels per slab
SLAB_VOXELS = 1 << 22
# maximum number of voxels examined for a view, and in images of several levels, which are not read at full resolution;
# above it, the volume's box is used
MOST, MOST_OF_LEVELS = 1 << 31, 1 << 28
# others around a sample that make it part of an object: a line one voxel wide has two
MOST_ALONE = 2


@dataclass(frozen=True, eq=False)
class Opaque:
    """Opaque part of a volume, as a subject of views; reads the volume on first use. Serves splats of values too, whose
    transparent voxels would widen the view. is_robust: whether opaque samples count that have at least MOST_ALONE
    others around them, if there are any.
    """

    volume: Volume
    transfer: Transfer
    is_robust: bool = False

    @property
    def full_extent(self) -> Volume:
        """The volume."""
        return self.volume

    @property
    def robust(self) -> Opaque:
        """The same without samples that are alone."""
        return replace(self, is_robust=True)

    @property
    def frame(self) -> str | None:
        """The volume's anatomical frame: LPS, RAS or None."""
        return self.volume.frame

    @property
    def nothing(self) -> bool:
        """Whether all samples were examined and none is opaque."""
        return self._ends is None and self.volume.count <= (MOST_OF_LEVELS if self.volume.coarser else MOST)

    @property
    def corners(self) -> np.ndarray:
        """Corners [8, 3], world units, of the box around opaque samples; of the volume if there are none."""
        return self.volume.corners if self._ends is None else self._ends.corners

    @property
    def outline(self) -> np.ndarray:
        """Points [N, 3], world units, whose convex hull contains the opaque samples."""
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
            keeps = partial(_is_within, opaque_intervals(self.transfer))
        _, height, width = volume.shape
        halo = max(int(bool(self.transfer.iso)), 2 * self.is_robust)
        slabs = volume.slabs(max(1, SLAB_VOXELS // (height * width)), halo=halo)
        ends = np.concatenate([_row_ends(slab, self._opaque(slab, keeps)) for slab in slabs])
        if not len(ends):
            return replace(self, is_robust=False)._ends if self.is_robust else None
        records = np.zeros(len(ends), record)
        records["position"] = ends
        grid = Grid.of(volume)
        return assemble(records, ends, grid, grid.mean_spacing, volume.name)

    def _opaque(self, slab: Slab, keeps: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
        """bool: which samples of a slab, without its halo, are opaque or beside an iso-surface, and unmasked."""
        samples, volume = np.ascontiguousarray(slab.samples), self.volume
        inner = slice(slab.before, slab.before + slab.stop - slab.start)
        part = slice(None) if self.is_robust else inner
        opaque = keeps(samples[part])
        for surface in self.transfer.iso:
            opaque = opaque | _is_beside(surface.value, samples)[part]
        if volume.masks:
            first = slab.start - (slab.before if self.is_robust else 0)
            opaque = opaque & volume.kept((first, 0, 0), (first + len(opaque), *volume.shape[1:]))
        return _without_lone(opaque)[inner] if self.is_robust else opaque


def _is_within(intervals: np.ndarray, samples: np.ndarray) -> np.ndarray:
    """bool: which samples lie in closed intervals [n, 2]; faster than their opacities."""
    most = float(np.finfo(samples.dtype).max)
    inside = np.zeros(samples.shape, bool)
    # limits of numpy's type: Python's numbers would be rounded to the samples' type
    for low, high in np.clip(intervals, -most, most):
        inside |= (samples >= low) & (samples <= high)
    return inside


def _without_lone(opaque: np.ndarray) -> np.ndarray:
    """bool [D, H, W]: the samples with at least MOST_ALONE others among the 26 around them, or beside such a one."""
    count = opaque.astype(np.uint8)
    for axis in range(3):
        padded = np.pad(count, [(int(axis == n), int(axis == n)) for n in range(3)])
        parts = [padded.take(np.arange(n, n + count.shape[axis]), axis) for n in range(3)]
        count = parts[0] + parts[1] + parts[2]
    return np.asarray(opaque & dilate(opaque & (count > MOST_ALONE)))


def _is_beside(value: float, samples: np.ndarray) -> np.ndarray:
    """bool: which samples have a neighbour on the other side of a value."""
    level = np.float64(value)
    return np.asarray(dilate(samples > level) & dilate(samples <= level))


def _row_ends(slab: Slab, opaque: np.ndarray) -> np.ndarray:
    """int32 [N, 3] (x, y, z), in row order: the ends of the rows' opaque samples."""
    z, y = np.nonzero(opaque.any(axis=2))
    rows = opaque[z, y]
    first, last = rows.argmax(axis=1), rows.shape[1] - 1 - rows[:, ::-1].argmax(axis=1)
    ends = np.stack([np.stack([x, y, z + slab.start], axis=1) for x in (first, last)], axis=1)
    return ends.reshape(-1, 3).astype(np.int32)
