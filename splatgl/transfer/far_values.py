"""Values far from all others of a volume: numbers that stand for no value, hot pixels, and marks at a corner.

Statistics leave them out, and scenes do not draw them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from splatgl.data.arrays import Changed, missing_type
from splatgl.data.fills import TIMES_LARGER, custom_fills, distinct, format_numbers, inner_range, is_nines
from splatgl.data.volume import MOST_SCANNED, Volume
from splatgl.transfer.label_detection import AMOUNTS, LABELS, kind_of

# ends of integers without sign, and the largest with one
LARGEST_INTEGERS = frozenset(float(2**bits - 1) for bits in (8, 15, 16, 31, 32, 63, 64))
# padding: least share of the samples and corners of the box that have it, and distinct other values; size of
# negative numbers without a custom, of the others' largest; values that CT has as air and padding
LEAST_SHARE, CORNERS, DISTINCT, FURTHER, OF_CT = 0.01, 4, 9, 10.0, (-4096.0, -900.0)
# hot pixels: largest share of the samples, least share that is alone, and least correlation of neighbours among the
# others, 0 in noise; largest side of a mark at a corner, of the box's; distance of what is bright, of the
# others' range; distance of hot ones that are not saturated, in that range
MOST_HOT, ALONE, ALIKE, MARK, FLANK, UNUSUAL = 0.02, 0.8, 0.3, 1 / 3, 0.25, 4.0
# blocks of three planes that are examined in large volumes, and rows for the correlation
BLOCKS, ROWS = 8, 1 << 12
# hint to draw all values
FIX = "--values amounts draws them"


@dataclass(frozen=True)
class Far:
    """Values that belong to no object. fills: stand for no value. low, high: others lie beyond these."""

    fills: tuple[float, ...] = ()
    low: float = -math.inf
    high: float = math.inf

    def near(self, values: np.ndarray) -> np.ndarray:
        """bool, the shape of values: which belong to objects; False for NaN."""
        near = (values >= np.float64(self.low)) & (values <= np.float64(self.high))
        for fill in self.fills:
            near &= values != np.float64(fill)
        return np.asarray(near)


def far_values(volume: Volume, sample: np.ndarray, values: np.ndarray) -> Far:
    """Values of a volume far from all others; none if its file or options state what samples mean.

    sample [d, h, w]: of the samples, with the ends of all axes. values: the finite ones, sorted.
    """
    hints = volume.hints
    if volume.labels is not None or volume.color is not None or hints.values or hints.points or not len(values):
        return Far()
    corners = sample[np.ix_(*([0, -1] for _ in range(3)))]

    def is_padding(fill: float, share: float, rest: np.ndarray) -> bool:
        at_corners = np.count_nonzero(corners == np.float64(fill)) >= CORNERS
        return bool(at_corners) and share >= LEAST_SHARE and _pads(fill, rest) and kind_of(volume)[0] == AMOUNTS

    fills, rest = custom_fills(values, is_padding)
    low, high = inner_range(rest)
    # a single one may not be in the sample
    whole = type(volume.samples) in (np.ndarray, np.memmap)
    first, last = (volume.value_range if whole else None) or (rest[0], rest[-1])
    # lone voxels may be the object, unless they are saturated or extremely far
    spread = high - low
    apart = spread * (1 if last in LARGEST_INTEGERS and not _varies_beyond(rest, high + spread) else UNUSUAL)
    hot = Far(fills, low - UNUSUAL * spread, high + apart)
    if not 0 < spread < math.inf or (first >= hot.low and last <= hot.high):
        return Far(fills)
    flanks = Far(fills, low - FLANK * spread, high + FLANK * spread)
    return hot if _are_hot(volume, hot, flanks) and kind_of(volume)[0] != LABELS else Far(fills)


def _varies_beyond(rest: np.ndarray, limit: float) -> bool:
    """Whether there are several numbers beyond a limit."""
    beyond = rest[np.searchsorted(rest, limit, side="right") :]
    return bool(len(beyond) and beyond[0] != beyond[-1])


def _pads(fill: float, rest: np.ndarray) -> bool:
    """Whether a number is as far from the rest as padding: a usual one beyond their spread, or one without a custom."""
    low, high = inner_range(rest)
    apart = max(low - fill, fill - high)
    is_usual = fill in LARGEST_INTEGERS or (fill > 0 and is_nines(fill))
    is_negative = fill < 0 and not OF_CT[0] <= fill <= OF_CT[1]
    is_far = (is_usual and apart > high - low) or (is_negative and -fill > FURTHER * max(abs(low), abs(high)))
    is_far |= abs(fill) >= TIMES_LARGER * max(abs(low), abs(high))
    return bool(is_far) and len(distinct(rest)) >= DISTINCT


def _are_hot(volume: Volume, limits: Far, flanks: Far) -> bool:
    """Whether values beyond limits are lone voxels, or a mark at a corner, of something else than noise. flanks: limits
    of what may lie beside lone ones.
    """
    # 1. the whole volume, or blocks of a large one
    depth, all_ = volume.shape[0], volume.count <= MOST_SCANNED
    starts = [0] if all_ else distinct(np.linspace(0, max(depth - 3, 0), BLOCKS).astype(int)).tolist()
    blocks = [np.asarray(volume.samples[start : depth if all_ else start + 3]) for start in starts]
    # 2. hot voxels, and those without a bright one beside a face, which the flank of a peak would be
    count, alone, is_mark = 0, 0, False
    for block in blocks:
        has_value = np.isfinite(block) & Far(limits.fills).near(block)
        is_hot, is_bright = has_value & ~limits.near(block), has_value & ~flanks.near(block)
        beside = np.zeros_like(is_hot)
        for axis in range(3):
            a, b = np.moveaxis(is_bright, axis, 0), np.moveaxis(beside, axis, 0)
            b[1:] |= a[:-1]
            b[:-1] |= a[1:]
        count += int(np.count_nonzero(is_hot))
        alone += int(np.count_nonzero(is_hot & ~beside))
        is_mark = all_ and _is_at_corner(np.argwhere(is_hot), block.shape)
    few = 0 < count <= MOST_HOT * sum(block.size for block in blocks)
    return few and (alone >= ALONE * count or is_mark) and _correlation(blocks, limits) >= ALIKE


def _is_at_corner(places: np.ndarray, shape: tuple[int, ...]) -> bool:
    """Whether all places [N, 3] (z, y, x) lie in a small box at a corner."""
    if not len(places):
        return False
    first, last, size = places.min(axis=0), places.max(axis=0), np.array(shape)
    at_ends = (first == 0) | (last == size - 1)
    return bool((at_ends & (last - first + 1 <= np.maximum(size * MARK, 1))).all())


def _correlation(blocks: list[np.ndarray], limits: Far) -> float:
    """Correlation of neighbours along x whose values lie within finite limits."""
    pairs = []
    for block in blocks:
        rows = block.reshape(-1, block.shape[2])
        a = rows[:: max(1, len(rows) * len(blocks) // ROWS)].astype(np.float64)
        both = limits.near(a[:, :-1]) & limits.near(a[:, 1:])
        scaled = (a - limits.low) / (limits.high - limits.low)
        pairs.append(np.stack([scaled[:, :-1][both], scaled[:, 1:][both]]))
    joined = np.concatenate(pairs, axis=1)
    apart = joined - joined.mean(axis=1, keepdims=True) if joined.size else joined
    (own, shared), (_, other) = apart @ apart.T
    return float(shared / np.sqrt(own * other)) if own * other > 0 else 0.0


def without_far(volume: Volume, far: Far) -> Volume:
    """The volume with NaN, which is not drawn, in place of values far from all others, and in place of lone ones in
    memory the median of those around them; with notes.
    """
    if far == Far():
        return volume

    def with_missing(block: np.ndarray) -> np.ndarray:
        return np.where(far.near(block), block, np.nan).astype(missing_type(block.dtype))

    def changed(part: Volume) -> Volume:
        samples = part.samples
        return replace(
            part, samples=Changed(samples, samples.shape, missing_type(np.dtype(samples.dtype)), with_missing)
        )

    notes = list[str]()
    if far.fills:
        notes.append(f"voxels of {format_numbers(far.fills)}, far from all other values, are left out: {FIX}")
    small = isinstance(volume.samples, np.ndarray) and volume.count <= MOST_SCANNED
    samples = _repaired(volume.samples, far) if small else changed(volume).samples
    if far.high < math.inf:
        notes.append(
            f"single voxels below {far.low:.4g} or above {far.high:.4g}, far from all others, are left out: {FIX}"
        )
    coarser = tuple(map(changed, volume.coarser))
    return replace(volume, samples=samples, coarser=coarser, notes=(*volume.notes, *notes))


def _repaired(samples: np.ndarray, far: Far) -> np.ndarray:
    """Samples with medians of those around lone ones beyond the limits, and NaN for others far from the rest."""
    near = far.near(samples)
    places = np.argwhere(~near & np.isfinite(samples) & Far(far.fills).near(samples))
    steps = np.stack(np.meshgrid(*[[-1, 0, 1]] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    around = tuple(np.clip(places[:, None] + steps, 0, np.array(samples.shape) - 1).transpose(2, 0, 1))
    known = near[around]
    values = np.sort(np.where(known, samples[around].astype(np.float64), np.inf), axis=1)
    # of an even number the lower one, so that whole numbers stay whole
    middle = values[np.arange(len(places)), np.maximum(known.sum(axis=1) - 1, 0) // 2]
    near[tuple(places[np.isfinite(middle)].T)] = True
    result = np.array(samples, samples.dtype if near.all() else missing_type(samples.dtype))
    result[tuple(places.T)] = middle
    if not near.all():
        result[~near] = np.nan
    return result
