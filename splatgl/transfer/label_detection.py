"""Decides whether whole numbers are labels or amounts: labels form flat areas with sharp borders.

Measured on neighbours along the three axes, all over the volume:
- alike: share of equal neighbours beyond that of the same values in random order. Noise has none.
- jumps: share of unequal neighbours with other values of the volume between them. Smooth fields have few.
- between: share of unequal second neighbours with a third value in the middle. Blurred edges have many.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, replace

import numpy as np

from splatgl.data.fills import distinct
from splatgl.data.volume import Volume
from splatgl.errors import expected

# largest distance from whole numbers of values that are taken for them: scaled integers are off by half the scale
ROUNDING = 0.02
# planes that are read in a row, how often, and how many voxels of them are examined
THREE, TIMES, PLACES = 3, 8, 1 << 17
# least number of neighbours not both of the most frequent value; with fewer, slabs are read until there are MORE
ENOUGH, MORE = 300, 3000
# maximum number of voxels read for these, and planes per read
MOST, SLAB = 1 << 27, 16
# widest range of values that are counted; wider ones are sorted
SPAN = 1 << 20
# least share of equal neighbours in segments: cells of three voxels have .35, noise .01
FLAT = 0.3
# least share of jumps of up to FEW values, and of more: nested tissues have .08 and numbered cells .6, noise of a third
# of a step on a smooth field .05
FEW, JUMPS, JUMPS_OF_MORE = 4, 0.05, 0.15
# limits for a tumour at the rim of an organ: areas flatter, and with fewer values between, than in any picture
FLATTEST, CLEANEST, JUMPS_OF_CLEAN = 0.7, 0.02, 0.02
# largest share of values between per unequal neighbour, without jumps and with jumps alone: pictures with blurred edges
# have .4 to 2, touching cells of three voxels .5
BETWEEN, BETWEEN_OF_JUMPS = 0.25, 0.6
# largest number of distinct values for which a note says that they are drawn as amounts
TOLD = 32
NAMES = re.compile(
    r"(?<![a-z])(labels?|labelmap|d?seg(mentation|mented|s)?|masks?|aseg|aparc|atlas|parcellation|rois?|annotations?)(?![a-z])"
)
LABELS, MASK, AMOUNTS = "labels", "mask", "amounts"


@dataclass(frozen=True)
class NeighbourCounts:
    """count: distinct values. alike, jumps, between: shares from 0 to 1, see above. seen: neighbours examined."""

    count: int
    alike: float
    jumps: float = 0.0
    between: float = 0.0
    seen: int = 0

    @property
    def flat(self) -> bool:
        """Whether equal values are adjacent."""
        return self.alike >= FLAT

    @property
    def names(self) -> bool:
        """Whether the values number segments."""
        clean = self.alike >= FLATTEST and self.between <= CLEANEST
        least = JUMPS_OF_MORE if self.count > FEW else JUMPS_OF_CLEAN if clean else JUMPS
        most = BETWEEN + (BETWEEN_OF_JUMPS - BETWEEN) * self.jumps
        return self.flat and self.jumps >= least and self.between <= most * (1 - self.alike)


def kind_of(volume: Volume, most: float = 0.0) -> tuple[str, NeighbourCounts | None]:
    """LABELS, MASK (two values, one of them a segment) or AMOUNTS; and the measured shares, None unless the values are
    whole numbers without a unit, or at most so far off. Flat areas without jumps are labels if the volume's name says
    so.
    """
    triples = None if volume.value_unit else _whole_triples(volume, most)
    if triples is None:
        return AMOUNTS, None
    shares = compare_neighbours(triples)
    if shares.count == 2:
        return MASK if shares.flat or volume.samples.dtype == bool else AMOUNTS, shares
    named = shares.flat and bool(NAMES.search(volume.name.lower()))
    return LABELS if shares.count > 2 and (shares.names or named) else AMOUNTS, shares


def mark_kind(volume: Volume) -> Volume:
    """Marks a volume as labels, a mask or amounts unless its file or hints decide; adds a note in doubtful cases."""
    hints = volume.hints
    decided_before = volume.labels is not None or hints.values or volume.color is not None or volume.channels
    if decided_before or hints.points or hints.preset or hints.window or hints.color:
        return volume
    kind, shares = kind_of(volume, ROUNDING)
    if kind != AMOUNTS:
        # numbers off by the rounding of a file's scale
        rounded = volume.rounded(ROUNDING)
        kind, volume = (AMOUNTS, volume) if rounded is None else (kind, rounded)
    if kind == LABELS:
        note = "whole numbers in flat areas are rendered as labels; --values amounts renders them as amounts"
        return replace(volume, labels=(), notes=(*volume.notes, note))
    marked = replace(volume, hints=replace(hints, values=kind))
    if kind == MASK or shares is None or shares.count < 2 or not (shares.alike >= FLATTEST or shares.count <= TOLD):
        return marked
    why = "areas that blend into each other" if shares.flat else "areas that are not flat"
    note = f"whole numbers in {why} are rendered as amounts; --values labels renders each in a colour"
    return replace(marked, notes=(*volume.notes, note))


def as_segmentation(marked: Volume, option: str, source: str) -> Volume:
    """Returns a volume whose kind is known as labels. Raises InputError, which names the option, for amounts."""
    if any(part.labels is not None for part in marked.channels or (marked,)):
        return marked
    if marked.hints.values != MASK:
        fix = "--labels FILE adds one; --values labels, if these numbers are names"
        raise expected(option, "a segmentation", f"amounts in {source}", fix)
    # two values, one of which is a segment
    return marked.of_values("labels")


def compare_neighbours(triples: list[np.ndarray]) -> NeighbourCounts:
    """Measures the shares in rows of three voxels. triples: [3, N] along each axis."""
    if not any(rows.size for rows in triples):
        return NeighbourCounts(0, 0.0)
    # 1. equal neighbours, except pairs of the most frequent value, which is the ground
    values, ranks = _ranks(np.concatenate(triples, axis=1))
    share = np.bincount(ranks[1], minlength=len(values)) / max(ranks.shape[1], 1)
    ground = int(share.argmax())
    first, middle, last = ranks
    informative = (first != ground) | (middle != ground)
    apart = np.abs(first - middle)[informative]
    if not len(apart):
        return NeighbourCounts(len(values), 1.0)
    unlike = int(np.count_nonzero(apart))
    most = float(share[ground]) ** 2
    chance = (float((share**2).sum()) - most) / max(1 - most, 1e-12)
    alike = (1 - unlike / len(apart) - chance) / (1 - chance) if chance < 1 else 1.0
    # 2. values between unequal ones
    over = first != last
    between = int(np.count_nonzero(over & (middle != first) & (middle != last)))
    jumps = int(np.count_nonzero(apart > 1)) / max(unlike, 1)
    return NeighbourCounts(len(values), alike, jumps, between / max(int(np.count_nonzero(over)), 1), len(apart))


def _ranks(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distinct values, ascending, and the rank of each value among them."""
    wide = values.astype(np.int64) if values.dtype.kind in "bi" else values
    if values.size and float(wide.max()) - float(wide.min()) < SPAN:
        # far faster than sorting
        above = (wide - wide.min()).astype(np.int32)
        present = np.bincount(above.reshape(-1)) > 0
        return np.flatnonzero(present), (np.cumsum(present) - 1)[above]
    different, places = np.unique(values, return_inverse=True)
    return different, places.reshape(values.shape)


def _round(values: np.ndarray, most: float) -> np.ndarray | None:
    """Whole numbers in place of finite values that are at most so far off; None if one is farther off."""
    if values.dtype.kind != "f":
        return values
    rounded = np.rint(values)
    finite = np.isfinite(values)
    return rounded if (np.abs(values - rounded)[finite] <= most).all() else None


def _whole_triples(volume: Volume, most: float) -> list[np.ndarray] | None:
    """Finite values [3, N] of three voxels in a row, along each axis, rounded; None if one is farther off than most."""
    finest = next((level for level in (volume, *volume.coarser) if level.count <= MOST), volume)
    depth, height, width = finest.shape
    starts = distinct(np.linspace(0, max(depth - THREE, 0), TIMES if finest.count > PLACES else depth).astype(int))
    step = max(1, int(np.ceil(np.sqrt(len(starts) * height * width / PLACES))))
    by_axis: list[list[np.ndarray]] = [[], [], []]
    for start in starts:
        block = _round(np.asarray(finest.samples[int(start) : int(start) + THREE]), most)
        if block is None:
            return None
        for axis, rows in enumerate(_rows(block, step)):
            by_axis[axis].append(rows)
    triples = [np.concatenate(rows, axis=1) for rows in by_axis]
    if finest.count <= MOST and _count_informative(triples) < ENOUGH:
        triples = _add_triples(finest, triples, most)
    return [rows[:, np.isfinite(rows).all(axis=0)] for rows in triples]


def _rows(block: np.ndarray, step: int) -> list[np.ndarray]:
    """Values [3, N] of three voxels in a row along each axis, from every `step`th voxel of the first plane on; along an
    axis of two voxels the second counts twice.
    """
    triples = []
    for axis, size in enumerate(block.shape):
        if size < 2:
            triples.append(np.empty((THREE, 0), block.dtype))
            continue
        long = np.moveaxis(block, axis, -1)
        plane = long if axis == 0 else long[0]
        count = max(size - 2, 1)
        thinned = plane[::step, ::step] if axis == 0 else plane[::step]
        shifted = [thinned[..., min(k, size - 1) :][..., : count : step if axis else 1] for k in range(THREE)]
        triples.append(np.stack([plane.reshape(-1) for plane in shifted]))
    return triples


def _count_informative(triples: list[np.ndarray]) -> int:
    """Number of neighbours that are not both the most frequent value."""
    values = np.concatenate(triples, axis=1)
    if not values.size:
        return 0
    ordered = np.sort(values[1])
    ground = ordered[len(ordered) // 2]
    return int(np.count_nonzero((values[0] != ground) | (values[1] != ground)))


def _add_triples(volume: Volume, triples: list[np.ndarray], most: float) -> list[np.ndarray]:
    """Adds triples of a sparse volume, from slabs that hold other values than the most frequent one."""
    ground = np.median(triples[2][1]) if triples[2].size else 0
    by_axis = [[rows] for rows in triples]
    count = 0
    for slab in volume.slabs(SLAB, halo=0):
        block = _round(np.asarray(slab.samples), most)
        other = np.empty((0, 3), int) if block is None else np.argwhere(block != ground)
        if block is None or not len(other):
            continue
        low, high = np.maximum(other.min(axis=0) - 1, 0), other.max(axis=0) + 2
        block = block[tuple(map(slice, low, high))]
        for plane in range(max(len(block) - 2, 1)):
            for axis, rows in enumerate(_rows(block[plane : plane + THREE], 1)):
                by_axis[axis].append(rows)
        count += len(other)
        if count >= MORE:
            break
    return [np.concatenate(rows, axis=1) for rows in by_axis]
