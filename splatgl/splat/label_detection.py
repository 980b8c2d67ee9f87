"""Labels or amounts: whole numbers that name segments lie in flat areas with sharp borders; counts and fields do not.

Read off neighbours along the three axes, at places all over the volume:
- alike: the share of equal neighbours beyond that of the same values in random order. Noise has none.
- jumps: the share of unequal neighbours between which there are other values. A smooth field passes through these.
- between: the share of unequal second neighbours whose middle is neither of the two. Blurred edges pass through others.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, replace

import numpy as np

from splatgl.data.volume import Volume
from splatgl.readers.common import is_whole

# planes in a row that are read, how many times, and places that are looked at in them
THREE, TIMES, PLACES = 3, 8, 1 << 17
# neighbours beside others than the most frequent value; with fewer the volume is read until there are as many
ENOUGH, MORE = 300, 3000
# most voxels that are read for these, and planes of them at once
MOST, SLAB = 1 << 27, 16
# values within as many whole numbers are counted, others sorted
SPAN = 1 << 20
# least share of equal neighbours of segments: cells of three voxels have .35, noise .01
FLAT = 0.3
# least share of jumps of up to FEW values, and of more: nested tissues have .08 and numbered cells .6, noise of a third
# of a step on a smooth field .05
FEW, JUMPS, JUMPS_OF_MORE = 4, 0.05, 0.15
# of few values in areas so flat, with so few values between, as no picture has: a tumour at the rim of an organ
FLATTEST, CLEANEST, JUMPS_OF_CLEAN = 0.7, 0.02, 0.02
# largest share of values between, for each neighbour that is not alike, without jumps and with jumps alone: pictures
# with blurred edges have .4 to 2, touching cells of three voxels .5
BETWEEN, BETWEEN_OF_JUMPS = 0.25, 0.6
# numbers of few values, of which it is told that they are taken for amounts
TOLD = 32
NAMES = re.compile(
    r"(?<![a-z])(labels?|labelmap|d?seg(mentation|mented|s)?|masks?|aseg|aparc|atlas|parcellation|rois?|annotations?)(?![a-z])"
)
LABELS, MASK, AMOUNTS = "labels", "mask", "amounts"


@dataclass(frozen=True)
class Neighbours:
    """count: of different values. alike, jumps, between: shares from 0 to 1, see above. seen: neighbours looked at."""

    count: int
    alike: float
    jumps: float = 0.0
    between: float = 0.0
    seen: int = 0

    @property
    def flat(self) -> bool:
        """Whether equal values lie together."""
        return self.alike >= FLAT

    @property
    def names(self) -> bool:
        """Whether the values are numbers of segments."""
        clean = self.alike >= FLATTEST and self.between <= CLEANEST
        least = JUMPS_OF_MORE if self.count > FEW else JUMPS_OF_CLEAN if clean else JUMPS
        most = BETWEEN + (BETWEEN_OF_JUMPS - BETWEEN) * self.jumps
        return self.flat and self.jumps >= least and self.between <= most * (1 - self.alike)


def kind_of(volume: Volume) -> tuple[str, Neighbours | None]:
    """LABELS, MASK (two values, one of them a segment) or AMOUNTS; and what was seen, if the values are whole numbers
    without a unit. A name that says so decides for flat areas without jumps, which may be either.
    """
    triples = None if volume.value_unit else _whole_triples(volume)
    if triples is None:
        return AMOUNTS, None
    seen = neighbours(triples)
    if seen.count == 2:
        return MASK if seen.flat or volume.samples.dtype == bool else AMOUNTS, seen
    named = seen.flat and bool(NAMES.search(volume.name.lower()))
    return LABELS if seen.count > 2 and (seen.names or named) else AMOUNTS, seen


def decided(volume: Volume) -> Volume:
    """The volume, marked as labels, a mask or amounts where neither its file nor its hints say; with a note where its
    values may be taken for either.
    """
    hints = volume.hints
    said = volume.labels is not None or hints.values or volume.color is not None or volume.channels
    if said or hints.points or hints.preset or hints.window or hints.color:
        return volume
    kind, seen = kind_of(volume)
    if kind == LABELS:
        told = "whole numbers in flat areas are drawn as labels: --values amounts draws them as amounts"
        return replace(volume, labels=(), notes=(*volume.notes, told))
    marked = replace(volume, hints=replace(hints, values=kind))
    if kind == MASK or seen is None or seen.count < 2 or not (seen.alike >= FLATTEST or seen.count <= TOLD):
        return marked
    why = "areas that blend into each other" if seen.flat else "areas that are not flat"
    told = f"whole numbers in {why} are drawn as amounts: --values labels draws each in a colour"
    return replace(marked, notes=(*volume.notes, told))


def neighbours(triples: list[np.ndarray]) -> Neighbours:
    """What three voxels in a row tell. triples: [3, N] along each axis."""
    if not any(rows.size for rows in triples):
        return Neighbours(0, 0.0)
    # 1. equal neighbours, but those of the most frequent value, which is the ground
    values, ranks = _ranks(np.concatenate(triples, axis=1))
    share = np.bincount(ranks[1], minlength=len(values)) / max(ranks.shape[1], 1)
    ground = int(share.argmax())
    first, middle, last = ranks
    seen = (first != ground) | (middle != ground)
    apart = np.abs(first - middle)[seen]
    if not len(apart):
        return Neighbours(len(values), 1.0)
    unlike = int(np.count_nonzero(apart))
    most = float(share[ground]) ** 2
    chance = (float((share**2).sum()) - most) / max(1 - most, 1e-12)
    alike = (1 - unlike / len(apart) - chance) / (1 - chance) if chance < 1 else 1.0
    # 2. what lies between unequal ones
    over = first != last
    between = int(np.count_nonzero(over & (middle != first) & (middle != last)))
    jumps = int(np.count_nonzero(apart > 1)) / max(unlike, 1)
    return Neighbours(len(values), alike, jumps, between / max(int(np.count_nonzero(over)), 1), len(apart))


def _ranks(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Different values, and each one's place among them."""
    wide = values.astype(np.int64) if values.dtype.kind in "bi" else values
    if values.size and float(wide.max()) - float(wide.min()) < SPAN:
        # far faster than sorting
        above = (wide - wide.min()).astype(np.int32)
        there = np.bincount(above.reshape(-1)) > 0
        return np.flatnonzero(there), (np.cumsum(there) - 1)[above]
    found, places = np.unique(values, return_inverse=True)
    return found, places.reshape(values.shape)


def _whole_triples(volume: Volume) -> list[np.ndarray] | None:
    """Finite values [3, N] of voxels in a row along each axis; None if they are no whole numbers."""
    finest = next((level for level in (volume, *volume.coarser) if level.count <= MOST), volume)
    depth, height, width = finest.shape
    starts = np.unique(np.linspace(0, max(depth - THREE, 0), TIMES if finest.count > PLACES else depth).astype(int))
    step = max(1, int(np.ceil(np.sqrt(len(starts) * height * width / PLACES))))
    found: list[list[np.ndarray]] = [[], [], []]
    for start in starts:
        block = np.asarray(finest.samples[int(start) : int(start) + THREE])
        if not is_whole(block):
            return None
        for axis, rows in enumerate(_rows(block, step)):
            found[axis].append(rows)
    triples = [np.concatenate(rows, axis=1) for rows in found]
    if finest.count <= MOST and _informative(triples) < ENOUGH:
        triples = _sought(finest, triples)
    return [_finite(rows) for rows in triples]


def _rows(block: np.ndarray, step: int) -> list[np.ndarray]:
    """Three voxels in a row along each axis [3, N], from every `step`th along y and x of the first plane on; two along
    an axis of two, the second twice.
    """
    found = []
    for axis, size in enumerate(block.shape):
        if size < 2:
            found.append(np.empty((THREE, 0), block.dtype))
            continue
        long = np.moveaxis(block, axis, -1)
        plane = long if axis == 0 else long[0]
        count = max(size - 2, 1)
        thinned = plane[::step, ::step] if axis == 0 else plane[::step]
        shifted = [thinned[..., min(k, size - 1) :][..., : count : step if axis else 1] for k in range(THREE)]
        found.append(np.stack([each.reshape(-1) for each in shifted]))
    return found


def _informative(triples: list[np.ndarray]) -> int:
    """How many neighbours are not both the most frequent value."""
    values = np.concatenate(triples, axis=1)
    if not values.size:
        return 0
    ordered = np.sort(values[1])
    ground = ordered[len(ordered) // 2]
    return int(np.count_nonzero((values[0] != ground) | (values[1] != ground)))


def _sought(volume: Volume, triples: list[np.ndarray]) -> list[np.ndarray]:
    """The triples, and more of a sparse volume, from the slabs that hold other values than the most frequent."""
    ground = np.median(triples[2][1]) if triples[2].size else 0
    found = [[rows] for rows in triples]
    seen = 0
    for slab in volume.slabs(SLAB, halo=0):
        block = np.asarray(slab.samples)
        other = np.argwhere(block != ground)
        if not len(other) or not is_whole(block):
            continue
        low, high = np.maximum(other.min(axis=0) - 1, 0), other.max(axis=0) + 2
        block = block[tuple(map(slice, low, high))]
        for plane in range(max(len(block) - 2, 1)):
            for axis, rows in enumerate(_rows(block[plane : plane + THREE], 1)):
                found[axis].append(rows)
        seen += len(other)
        if seen >= MORE:
            break
    return [np.concatenate(rows, axis=1) for rows in found]


def _finite(rows: np.ndarray) -> np.ndarray:
    if rows.dtype.kind != "f":
        return rows
    return np.asarray(rows[:, np.isfinite(rows).all(axis=0)])
