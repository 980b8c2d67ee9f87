"""Statistics of a volume's values from a sample of its planes: range, background and thresholds.

Big mapped files are not read whole: at most PLANES planes, each subsampled.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from splatgl.data.volume import Volume

# most planes and values of a sample: a few tens of MB, half a second
PLANES, VALUES = 32, 1 << 21
# share of samples at exactly the lowest value from which a volume counts as sparse
SPARSE = 0.95
# sparse volumes with fewer other values than this in the sample are read whole
FEW = 2000
# most voxels of those, and of the level of a multiscale image that is sampled, if one has as few
MOST_WHOLE, MOST_OF_LEVEL = 1 << 31, 1 << 27
# half of a normal distribution lies this many deviations around its middle
HALF = 0.6745
# a background's noise reaches so many deviations above its middle: 7 of a million values are beyond
REACH = 4.5
# shares of a normal distribution within one and two deviations, and how far those of a noisy background may be off
NORMAL, NOT_NORMAL = ((1.0, 0.683), (2.0, 0.954)), 0.06
# most values that noise is judged by
NOISE_VALUES = 1 << 18
# values above a noisy background, per value that its noise brings there, from which they are an object
OBJECT = 10.0
BINS = 256
# percentile of the values where the histogram ends, so that a few outliers don't stretch its bins
HISTOGRAM_END = 99.9
# a face of the box is touched by an object if more than this share of it is covered
TOUCHED = 0.015
# a complete object touches at most this many of the box's six faces (a cut neck: 1; a slab: 2)
WHOLE = 3
# otherwise, an object that covers at most this share of the faces counts as foreground
COVERED = 0.25
RUNGS = 3
# values beyond are scaled: sums of squares of others fit float64
LARGE = 1e150


@dataclass(frozen=True)
class Cut:
    """A threshold between two classes of values, with the classes' mean values."""

    value: float
    below: float
    above: float

    def ramp(self, share: float) -> tuple[float, float]:
        """From `share` of the way to the class below, to `share` of the way to the class above."""
        return self.value - share * (self.value - self.below), self.value + share * (self.above - self.value)


@dataclass(frozen=True, eq=False)
class Statistics:
    """values: finite samples, sorted; those of a background with noise, as of a camera, count as the highest of it.
    background: share of them at exactly the lowest value.

    cuts: thresholds, each splitting the values above the last one (empty for a constant volume).
    whole: index of the cut between the object and its surroundings.
    """

    values: np.ndarray
    background: float
    cuts: tuple[Cut, ...]
    whole: int

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
        return float(np.percentile(self.values, percent))

    def share_above(self, value: float) -> float:
        """Share of the sampled values above a value."""
        return 1.0 - float(np.searchsorted(self.values, value, side="right")) / max(len(self.values), 1)


def statistics(volume: Volume) -> Statistics:
    """The statistics of a volume's finite values; of a sparse one, all non-background values count."""
    volume = next((level for level in (volume, *volume.coarser) if level.count <= MOST_OF_LEVEL), volume)
    sample = _sample(volume)
    finite = np.sort(sample[np.isfinite(sample)])
    if len(finite) == 0:
        return Statistics(finite, 1.0, (), 0)
    noise = _noise_end(finite)
    if noise is not None:
        finite = np.maximum(finite, noise)
    outstanding = finite[finite > finite[0]]
    background = 1.0 - len(outstanding) / len(finite)
    if background >= SPARSE and len(outstanding) < FEW and volume.count <= MOST_WHOLE:
        finite = _with_outstanding(volume, float(finite[0]))
    cuts = _ladder(finite)
    return Statistics(finite, background, cuts, _whole(sample, cuts))


def _sample(volume: Volume) -> np.ndarray:
    """float64 [d, h, w] of at most PLANES planes; includes first and last planes, rows and columns."""
    depth, height, width = volume.shape
    planes = np.unique(np.linspace(0, depth - 1, PLANES).round().astype(int))
    step = max(1, int(np.ceil(np.sqrt(len(planes) * height * width / VALUES))))
    y, x = (np.unique(np.append(np.arange(0, n, step), n - 1)) for n in (height, width))
    return np.stack([np.asarray(volume.samples[int(z)])[np.ix_(y, x)].astype(np.float64) for z in planes])


def _noise_end(values: np.ndarray) -> float | None:
    """Where the noise of a background ends that nearly all of sorted values belong to; None if there is none.

    Its middle and deviation are those of the shortest range of half of all values, which what is brighter hardly
    moves. It must be normal: values of an object are not.
    """
    values = values[:: len(values) // NOISE_VALUES + 1]
    half = len(values) // 2
    if half < FEW:
        return None
    values = _spread(values)
    widths = values[half:] - values[: len(values) - half]
    at = int(np.argmin(widths))
    middle, deviation = float(values[at] + values[at + half]) / 2, float(widths[at]) / (2 * HALF)
    end = middle + REACH * deviation
    if not (np.isfinite(end) and end > middle):
        return None
    for reach, share in NORMAL:
        ends = np.searchsorted(values, [middle - reach * deviation, middle + reach * deviation])
        if abs((ends[1] - ends[0]) / len(values) - share) > NOT_NORMAL:
            return None
    beyond = 1.0 - np.searchsorted(values, end, side="right") / len(values)
    below = np.searchsorted(values, middle - REACH * deviation) / len(values)
    # of noise alone, as many lie below
    expected = max(below, 3.4e-6)
    return end if OBJECT * expected < beyond <= 1.0 - SPARSE else None


def _spread(values: np.ndarray) -> np.ndarray:
    """Sorted whole numbers, those that are equal spread evenly over what was rounded to them; others as they are."""
    first = np.flatnonzero(np.diff(values, prepend=-np.inf))
    if not (values[first] == np.rint(values[first])).all():
        return values
    count = np.diff(np.append(first, len(values)))
    place = np.arange(len(values)) - np.repeat(first, count)
    return np.asarray(values + (place + 0.5) / np.repeat(count, count) - 0.5)


def _with_outstanding(volume: Volume, lowest: float) -> np.ndarray:
    """All finite values above the lowest sampled one (at most VALUES of them), and that one, sorted."""
    found = [np.array([lowest])]
    for slab in volume.slabs(16, halo=0):
        others = slab.samples[slab.samples > lowest].astype(np.float64)
        found.append(others[np.isfinite(others)])
    values = np.concatenate(found)
    return np.sort(values[:: len(values) // VALUES + 1])


def _ladder(values: np.ndarray) -> tuple[Cut, ...]:
    """Cuts by Otsu's rule: between all values, then between those above the first cut, and so on."""
    cuts: list[Cut] = []
    while len(cuts) < RUNGS and len(values) > 1 and values[0] < values[-1]:
        cut = _otsu(values)
        cuts.append(cut)
        values = values[values > cut.value]
    return tuple(cuts)


def _otsu(values: np.ndarray) -> Cut:
    """The cut that splits sorted values into two classes of the largest between-class variance (Otsu 1979)."""
    # a span, and sums, that float64 holds
    if not max(abs(values[0]), abs(values[-1])) < LARGE:
        cut = _otsu(values / LARGE)
        return Cut(cut.value * LARGE, cut.below * LARGE, cut.above * LARGE)
    end = float(np.percentile(values, HISTOGRAM_END))
    end = end if end > values[0] else float(values[-1])
    counts, edges = np.histogram(np.minimum(values, end), BINS, (float(values[0]), end))
    middles = (edges[1:] + edges[:-1]) / 2
    mass, moment = np.cumsum(counts)[:-1], np.cumsum(counts * middles)
    rest = len(values) - mass
    parted = (mass > 0) & (rest > 0)
    with np.errstate(divide="ignore", invalid="ignore"):
        below, above = moment[:-1] / mass, (moment[-1] - moment[:-1]) / rest
        between = np.where(parted, mass * rest * (above - below) ** 2, -1.0)
    # an empty interval between the classes has many best cuts: take its middle
    best = np.flatnonzero(between >= between.max() * (1 - 1e-12))
    at = int(best[len(best) // 2])
    return Cut(float(edges[at + 1]), float(below[at]), float(above[at]))


def _whole(sample: np.ndarray, cuts: tuple[Cut, ...]) -> int:
    """The first cut whose foreground touches at most WHOLE faces; else the first that covers at most COVERED."""
    faces = [face for axis in range(3) for face in (np.take(sample, 0, axis), np.take(sample, -1, axis))]
    shares = [[float(np.mean(face > cut.value)) for face in faces] for cut in cuts]
    for rung, covered in enumerate(shares):
        if sum(share > TOUCHED for share in covered) <= WHOLE:
            return rung
    for rung, covered in enumerate(shares):
        if np.mean(covered) <= COVERED:
            return rung
    return 0
