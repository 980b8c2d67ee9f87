"""Statistics of histograms, Otsu's threshold, background noise, and values far from all others.

Statistics leave them out, and scenes do not draw them.

Background noise is only assumed to fall in density by more than half within each standard deviation. The noise of
cameras (Gaussian, Poisson, or cut off at zero) falls much faster beyond two deviations.

Large mapped files are sampled: at most PLANES planes, each subsampled.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from splatgl.data.arrays import ConvertedArray, missing_type
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
class OutlierValues:
    """Values that belong to no object. fills: marks of missing values. low, high: others lie beyond these."""

    fills: tuple[float, ...] = ()
    low: float = -math.inf
    high: float = math.inf

    def near(self, values: np.ndarray) -> np.ndarray:
        """bool, the shape of values: which belong to objects; False for NaN."""
        near = (values >= np.float64(self.low)) & (values <= np.float64(self.high))
        for fill in self.fills:
            near &= values != np.float64(fill)
        return np.asarray(near)


def find_outliers(volume: Volume, sample: np.ndarray, values: np.ndarray) -> OutlierValues:
    """Values of a volume far from all others; none if its file or options state what samples mean.

    sample [d, h, w]: of the samples, with the ends of all axes. values: the finite ones, sorted.
    """
    hints = volume.hints
    if volume.labels is not None or volume.color is not None or hints.values or hints.points or not len(values):
        return OutlierValues()
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
    beyond = rest[_count_up_to(rest, high + spread) :]
    is_saturated = last in LARGEST_INTEGERS and (not len(beyond) or beyond[0] == beyond[-1])
    apart = spread * (1 if is_saturated else UNUSUAL)
    hot = OutlierValues(fills, low - UNUSUAL * spread, high + apart)
    if not 0 < spread < math.inf or (first >= hot.low and last <= hot.high):
        return OutlierValues(fills)
    flanks = OutlierValues(fills, low - FLANK * spread, high + FLANK * spread)
    return hot if _are_hot(volume, hot, flanks) and kind_of(volume)[0] != LABELS else OutlierValues(fills)


def _pads(fill: float, rest: np.ndarray) -> bool:
    """Whether a number is as far from the rest as padding: a usual one beyond their spread, or one without a custom."""
    low, high = inner_range(rest)
    apart = max(low - fill, fill - high)
    is_usual = fill in LARGEST_INTEGERS or (fill > 0 and is_nines(fill))
    is_negative = fill < 0 and not OF_CT[0] <= fill <= OF_CT[1]
    is_far = (is_usual and apart > high - low) or (is_negative and -fill > FURTHER * max(abs(low), abs(high)))
    is_far |= abs(fill) >= TIMES_LARGER * max(abs(low), abs(high))
    return bool(is_far) and len(distinct(rest)) >= DISTINCT


def _are_hot(volume: Volume, limits: OutlierValues, flanks: OutlierValues) -> bool:
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
        has_value = np.isfinite(block) & OutlierValues(limits.fills).near(block)
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


def _correlation(blocks: list[np.ndarray], limits: OutlierValues) -> float:
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


def without_outliers(volume: Volume, far: OutlierValues) -> Volume:
    """The volume with NaN, which is invisible, instead of values far from all others, and in place of lone ones in
    memory the median of those around them; with notes.
    """
    if far == OutlierValues():
        return volume

    def with_missing(block: np.ndarray) -> np.ndarray:
        return np.where(far.near(block), block, np.nan).astype(missing_type(block.dtype))

    def changed(part: Volume) -> Volume:
        samples = part.samples
        return replace(
            part, samples=ConvertedArray(samples, samples.shape, missing_type(np.dtype(samples.dtype)), with_missing)
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


def _repaired(samples: np.ndarray, far: OutlierValues) -> np.ndarray:
    """Samples with medians of those around lone ones beyond the limits, and NaN for others far from the rest."""
    near = far.near(samples)
    places = np.argwhere(~near & np.isfinite(samples) & OutlierValues(far.fills).near(samples))
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


# least number of samples to measure noise
LEAST = 4096
# rounds of outlier removal, and standard deviations beyond which a value is an outlier
ROUNDS, BEYOND = 8, 3.0
# quantiles: the median, and one standard deviation from it
MIDDLE, LOWER, UPPER = 0.5, 0.158655, 0.841345
# largest ratio of the spreads above and below the median in a peak
LOPSIDED = 2.0
# standard deviations above the level between which the cut is searched, and steps of the search
NEAREST, FURTHEST, STEPS = 2.0, 16.0, 56
# standard deviations above a cut between which the object's density is measured
NEXT, LAST = 1.0, 4.0
# objects are at least FOUND of the samples, and ONE_SIDED times as many as lie equally far below the level
FOUND, ONE_SIDED = 1e-5, 2.0


@dataclass(frozen=True)
class NoiseBackground:
    """Background. level, noise: mean and standard deviation. cut: values above belong to objects."""

    level: float
    noise: float
    cut: float


def background_of(values: np.ndarray, least_share: float) -> NoiseBackground | None:
    """Background of sorted finite values; None if it has less than `least_share` of them or no peak."""
    if len(values) < LEAST or not np.isfinite(float(values[-1]) - float(values[0])):
        return None
    level, noise = _peak(values)
    if not noise > 0 or not level + FURTHEST * noise > level:
        # a constant background, with a few pixels below it
        ground = NoiseBackground(level, 0.0, level) if values[0] < level else None
    else:
        ground = _cut(values, level, noise)
    if ground is None or _count_up_to(values, ground.cut) < least_share * len(values):
        return None
    above = len(values) - _count_up_to(values, ground.cut)
    below = np.searchsorted(values, 2 * ground.level - ground.cut, side="left")
    return ground if above >= max(FOUND * len(values), 1) and above >= ONE_SIDED * below else None


def _peak(values: np.ndarray) -> tuple[float, float]:
    """Median and standard deviation of the values without outliers; a deviation of 0 if there is no peak."""
    inliers = values
    level, noise = 0.0, 0.0
    for _ in range(ROUNDS):
        low, level, high = (float(_quantile(inliers, share)) for share in (LOWER, MIDDLE, UPPER))
        # the lower spread is unusable if values are cut off below, as integers at 0 are
        symmetric = low > values[0]
        if symmetric and (high - level > LOPSIDED * (level - low) + _step(inliers)):
            return level, 0.0
        noise = (high - low) / 2 if symmetric else high - level
        inner = values[_count_up_to(values, level - BEYOND * noise) : _count_up_to(values, level + BEYOND * noise)]
        if len(inner) in (0, len(inliers)):
            break
        inliers = inner
    return level, noise


def _cut(values: np.ndarray, level: float, noise: float) -> NoiseBackground | None:
    """Background up to the value at which noise and objects are about equally dense; None if there is none."""
    width = max(noise / 2, _step(values[: _count_up_to(values, level + BEYOND * noise)]))
    for place in level + noise * np.linspace(NEAREST, FURTHEST, STEPS + 1):
        here = _count_up_to(values, place + width / 2) - _count_up_to(values, place - width / 2)
        near, far = _count_up_to(values, place + NEXT * noise), _count_up_to(values, place + LAST * noise)
        if len(values) - near < FOUND * len(values):
            return None
        objects = (far - near) / ((LAST - NEXT) * noise)
        if here / width <= 2 * objects:
            return NoiseBackground(level, noise, float(place))
    return None


def _quantile(values: np.ndarray, share: float) -> float:
    """Quantile of sorted values; equal whole numbers are spread evenly over the step around them."""
    at = share * (len(values) - 1)
    value = values[int(at)]
    first, last = np.searchsorted(values, value, side="left"), _count_up_to(values, value)
    step = _step(values)
    return float(value + ((at - first) / max(last - first, 1) - 0.5) * step if last - first > 1 else value)


def _step(values: np.ndarray) -> float:
    """Distance from the median value to the next, 1 for whole numbers; 0 if the median does not repeat."""
    middle = values[len(values) // 2]
    first, last = np.searchsorted(values, middle, side="left"), _count_up_to(values, middle)
    return float(values[last] - middle) if last - first > 1 and last < len(values) else 0.0


def _count_up_to(values: np.ndarray, value: float) -> int:
    """Number of sorted values that are at most `value`."""
    return int(np.searchsorted(values, value, side="right"))


# maximum number of planes and values of a sample: a few tens of MB, half a second
PLANES, VALUES = 32, 1 << 21
# planes in which noise is looked for where a window is stated
FEW_PLANES = 5
# share of samples at exactly the lowest value, or in the noise around one, from which a volume counts as sparse
SPARSE = 0.95
# least share of a volume's voxels that are the noise of its background; and least deviation of differences of their
# neighbours, as a share of that of independent values: tissue of similar values is smoother
NOISY, INDEPENDENT = 0.25, 0.8
# sparse volumes with fewer other values than this in the sample are read whole
FEW = 2000
# maximum number of voxels of these, and of the level of a multiscale image that is sampled
MOST_WHOLE, MOST_OF_LEVEL = 1 << 31, 1 << 27
BINS = 256
# steps of float64 by which values differ that are the same but for rounding
ROUNDED = 2 * BINS
# percentile of the values where the histogram and the spread end, so that a few outliers don't stretch them
HISTOGRAM_END = 99.9
# a face of the box is touched by an object if more than this share of it is covered
TOUCHED = 0.015
# a complete object touches at most this many of the box's six faces (a cut neck: 1; a slab: 2)
WHOLE = 3
# otherwise, an object that covers at most this share of the faces counts as foreground
COVERED = 0.25
RUNGS = 3
# larger values are scaled, so that sums of squares fit float64
LARGE = 1e150
# largest half of a difference that float64 can hold
LARGEST_HALF = 8e307


@dataclass(frozen=True)
class ClassThreshold:
    """A threshold between two classes of values, with the classes' mean values."""

    value: float
    below: float
    above: float

    def ramp(self, share: float) -> tuple[float, float]:
        """The values at `share` of the way from the cut to the class below and to the class above."""
        return self.value - share * (self.value - self.below), self.value + share * (self.above - self.value)


@dataclass(frozen=True, eq=False)
class Statistics:
    """values: finite samples, sorted, without those far from all others. background: share of them at exactly the
    lowest value.

    cuts: thresholds, each of which splits the values above the previous one (empty for a constant volume).
    whole: index of the cut between the object and its surroundings. ground: background of a sparse volume, if it is
    noise; its values are set to its level. noise: background of independent values, of any volume.
    """

    values: np.ndarray
    background: float
    cuts: tuple[ClassThreshold, ...]
    whole: int
    ground: NoiseBackground | None = None
    noise: NoiseBackground | None = None

    @property
    def sparse(self) -> bool:
        """Whether the background is at least SPARSE of all samples."""
        return self.background >= SPARSE

    @property
    def constant(self) -> bool:
        """Whether there is only one value, or none."""
        return len(self.values) == 0 or bool(self.values[0] == self.values[-1])

    def percentile(self, percent: float) -> float:
        """The value that `percent` of the samples, 0 to 100, do not exceed; interpolated linearly."""
        return sorted_percentile(self.values, percent)

    def share_above(self, value: float) -> float:
        """Share of the sampled values above a value."""
        return 1.0 - float(np.searchsorted(self.values, value, side="right")) / max(len(self.values), 1)


def statistics(volume: Volume) -> Statistics:
    """Statistics of a volume's finite values; sparse volumes are read whole for their foreground."""
    volume, sample, finite, far = _examine(volume)
    if far != OutlierValues():
        finite, sample = finite[far.near(finite)], np.where(far.near(sample), sample, np.nan)
    if len(finite) == 0:
        return Statistics(finite, 1.0, (), 0)
    _even_out(finite)
    background = _count_up_to(finite, finite[0]) / len(finite)
    noise = background_of(finite, NOISY) if background < SPARSE else None
    ground = background_of(finite, SPARSE) if noise is not None else None
    if ground is not None:
        finite[: _count_up_to(finite, ground.cut)] = ground.level
        background = _count_up_to(finite, finite[0]) / len(finite)
    if background >= SPARSE and (1.0 - background) * len(finite) < FEW and volume.count <= MOST_WHOLE:
        finite = _foreground(volume, float(finite[0]), ground, far)
        _even_out(finite)
    cuts = _ladder(finite)
    if noise is not None and not _is_independent(volume, noise):
        noise = None
    return Statistics(finite, background, cuts, _object_rung(sample, cuts), ground, noise)


def _even_out(values: np.ndarray) -> None:
    """Sets sorted values that differ by rounding alone to the lowest."""
    if is_constant(float(values[0]), float(values[-1])):
        values[:] = values[0]


def _is_independent(volume: Volume, ground: NoiseBackground) -> bool:
    """Whether neighbours in the background of a plane, about the middle one, differ as much as independent values."""
    sampled = _sampled_planes(volume.shape[0], PLANES)
    plane = np.asarray(volume.samples[int(sampled[len(sampled) // 2])], np.float64)
    first, second = plane[:, :-1], plane[:, 1:]
    steps = (second - first)[(first <= ground.cut) & (second <= ground.cut)]
    return len(steps) > 0 and float(np.mean(steps**2)) >= 2 * (INDEPENDENT * ground.noise) ** 2


def is_constant(low: float, high: float) -> bool:
    """Whether values from low to high differ by rounding alone."""
    return high - low <= ROUNDED * np.spacing(max(abs(low), abs(high)))


def spread(volume: Volume) -> float:
    """Range of a volume's finite values, but for outliers on either side; 0 of one value or none."""
    values = _sort_finite(_sample(_small_level(volume)))
    if not len(values):
        return 0.0
    return sorted_percentile(values, HISTOGRAM_END) - sorted_percentile(values, 100 - HISTOGRAM_END)


def values_of_planes(volume: Volume) -> np.ndarray:
    """Finite values, sorted, of FEW_PLANES planes from the first to the last."""
    return _sort_finite(_sample(_small_level(volume), FEW_PLANES))


# steps of a series whose values are read to choose its look, and of one whose values are constant in these
SAMPLED_STEPS = (5, 17)


def sampled_steps(count: int, most: int = SAMPLED_STEPS[0]) -> list[int]:
    """Numbers of a few steps of a series, from the first to the last, evenly spread."""
    return sorted({round(place) for place in np.linspace(0, count - 1, most)})


def mean_deviation(volume: Volume) -> float:
    """Mean distance of a volume's finite values from their median, which single hot voxels hardly change. Beyond
    MOST_OF_LEVEL voxels, or VALUES that are read in parts, that of a sample.
    """
    level = _small_level(volume)
    sample = _sample(level)
    ordered = _sort_finite(sample)
    if len(ordered) == 0:
        return 0.0
    is_small = level.count <= (MOST_OF_LEVEL if isinstance(level.samples, np.ndarray) else VALUES)
    middle = ordered[len(ordered) // 2]
    total, count = 0.0, 0
    for block in (slab.samples for slab in level.slabs(16, halo=0)) if is_small else (sample,):
        values = block[np.isfinite(block)].astype(np.float64)
        with np.errstate(over="ignore"):
            total, count = total + float(np.abs(values - middle).sum()), count + len(values)
    return total / count


def outliers_of(volume: Volume) -> OutlierValues:
    """Values of a volume far from all others."""
    return _examine(volume)[3]


def without_outlier_values(volume: Volume) -> Volume:
    """The volume without values far from all others, of each channel for itself, as of `without_outliers`."""
    if len(volume.channels) < 2:
        return without_outliers(volume, outliers_of(volume))
    channels = tuple(map(without_outlier_values, volume.channels))
    pairs = list(zip(channels, volume.channels, strict=True))
    notes = [f"{new.name or 'a channel'}: {note}" for new, old in pairs for note in new.notes[len(old.notes) :]]
    if not notes:
        return volume
    first, notes = channels[0], [*volume.notes, *notes]
    return replace(volume, samples=first.samples, coarser=first.coarser, channels=channels, notes=tuple(notes))


def _examine(volume: Volume) -> tuple[Volume, np.ndarray, np.ndarray, OutlierValues]:
    """The level of a volume that is sampled, the sample, its finite values, sorted, and what is far from all others."""
    level = _small_level(volume)
    sample = _sample(level)
    finite = _sort_finite(sample)
    return level, sample, finite, find_outliers(level, sample, finite)


def sorted_percentile(values: np.ndarray, percent: float) -> float:
    """np.percentile of values that are sorted already."""
    place = percent / 100 * (len(values) - 1)
    below = min(int(place), len(values) - 1)
    low, high = float(values[below]), float(values[min(below + 1, len(values) - 1)])
    share = place - below
    if high / 2 - low / 2 > LARGEST_HALF:
        return low * (1 - share) + high * share
    return low + (high - low) * share if share < 0.5 else high - (high - low) * (1 - share)


def _small_level(volume: Volume) -> Volume:
    """The finest level of at most MOST_OF_LEVEL voxels; the volume without one."""
    return next((level for level in (volume, *volume.coarser) if level.count <= MOST_OF_LEVEL), volume)


def _sample(volume: Volume, most: int = PLANES) -> np.ndarray:
    """Samples [d, h, w] of at most `most` planes, of the volume's type; includes the first and last planes, rows and
    columns.
    """
    depth, height, width = volume.shape
    planes = _sampled_planes(depth, most)
    step = max(1, int(np.ceil(np.sqrt(len(planes) * height * width / VALUES))))
    y, x = (distinct(np.append(np.arange(0, n, step), n - 1)) for n in (height, width))
    kind = volume.samples.dtype.newbyteorder("=")
    return np.stack([np.asarray(volume.samples[int(z)])[np.ix_(y, x)].astype(kind) for z in planes])


def _sampled_planes(depth: int, most: int) -> np.ndarray:
    """Numbers of at most `most` planes from the first to the last."""
    return distinct(np.linspace(0, depth - 1, most).round().astype(int))


def _sort_finite(sample: np.ndarray) -> np.ndarray:
    """The finite values, sorted, float64; converted after sorting, which is fastest for few bits."""
    if sample.dtype.kind == "f":
        return np.sort(sample[np.isfinite(sample)]).astype(np.float64)
    return np.sort(sample, axis=None, kind="stable" if sample.dtype.itemsize <= 2 else None).astype(np.float64)


def _foreground(volume: Volume, lowest: float, ground: NoiseBackground | None, far: OutlierValues) -> np.ndarray:
    """The lowest sampled value and at most VALUES of all finite values above the background, or other than the lowest,
    but those far from all others; sorted.
    """
    parts = [np.array([lowest])]
    for slab in volume.slabs(16, halo=0):
        others = slab.samples[slab.samples != lowest if ground is None else slab.samples > np.float64(ground.cut)]
        others = others.astype(np.float64)
        parts.append(others[np.isfinite(others) & far.near(others)])
    values = np.concatenate(parts)
    return np.sort(values[:: len(values) // VALUES + 1])


def _ladder(values: np.ndarray) -> tuple[ClassThreshold, ...]:
    """Cuts by Otsu's rule: between all values, then between those above the first cut, and so on."""
    cuts: list[ClassThreshold] = []
    while len(cuts) < RUNGS and len(values) > 1 and not is_constant(float(values[0]), float(values[-1])):
        cut = _otsu(values)
        cuts.append(cut)
        values = values[values > cut.value]
    return tuple(cuts)


def _otsu(values: np.ndarray) -> ClassThreshold:
    """The cut that splits sorted values into two classes of the largest between-class variance (Otsu 1979)."""
    # scale values whose range or sums exceed float64
    if not max(abs(values[0]), abs(values[-1])) < LARGE:
        cut = _otsu(values / LARGE)
        return ClassThreshold(cut.value * LARGE, cut.below * LARGE, cut.above * LARGE)
    end = sorted_percentile(values, HISTOGRAM_END)
    end = end if end > values[0] else float(values[-1])
    counts, edges = np.histogram(np.minimum(values, end), BINS, (float(values[0]), end))
    middles = (edges[1:] + edges[:-1]) / 2
    mass, moment = np.cumsum(counts)[:-1], np.cumsum(counts * middles)
    rest = len(values) - mass
    parted = (mass > 0) & (rest > 0)
    with np.errstate(divide="ignore", invalid="ignore"):
        below, above = moment[:-1] / mass, (moment[-1] - moment[:-1]) / rest
        between = np.where(parted, mass * rest * ((above - below) / (values[-1] - values[0])) ** 2, -1.0)
    # an empty interval between the classes has many best cuts: take its middle
    best = np.flatnonzero(between >= between.max() * (1 - 1e-12))
    at = int(best[len(best) // 2])
    return ClassThreshold(float(edges[at + 1]), float(below[at]), float(above[at]))


def _object_rung(sample: np.ndarray, cuts: tuple[ClassThreshold, ...]) -> int:
    """The first cut whose foreground touches at most WHOLE faces; else the first that covers at most COVERED."""
    faces = [face for axis in range(3) for face in (np.take(sample, 0, axis), np.take(sample, -1, axis))]
    shares = [[float(np.mean(face > np.float64(cut.value))) for face in faces] for cut in cuts]
    for rung, covered in enumerate(shares):
        if sum(share > TOUCHED for share in covered) <= WHOLE:
            return rung
    for rung, covered in enumerate(shares):
        if np.mean(covered) <= COVERED:
            return rung
    return 0
