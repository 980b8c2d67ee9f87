"""`Ground`: the noise around one value that most of a volume holds, as a camera's offset, and where objects begin.

Nothing is assumed of the noise but that its density falls within each standard deviation by more than a half: that of
cameras (Gaussian, Poisson, or cut off at zero) falls much faster from two on.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

# fewer samples tell nothing of their noise
LEAST = 4096
# rounds of leaving out what is not noise, and standard deviations beyond which it isn't
ROUNDS, BEYOND = 8, 3.0
# quantiles: the median, and those one standard deviation from it
MIDDLE, LOWER, UPPER = 0.5, 0.158655, 0.841345
# largest ratio of the spreads above and below the median: a peak, and no slope
LOPSIDED = 2.0
# standard deviations above the level: the range of the cut, and its steps
NEAREST, FURTHEST, STEPS = 2.0, 16.0, 56
# standard deviations from a cut to the values whose density is the object's there
NEXT, LAST = 1.0, 4.0
# objects are at least this share of the samples, and as many times what lies as far below the level
FOUND, ONE_SIDED = 1e-5, 2.0


@dataclass(frozen=True)
class Ground:
    """level, noise: mean and standard deviation of the background. cut: values above are an object's."""

    level: float
    noise: float
    cut: float


def ground_of(values: np.ndarray, least_share: float) -> Ground | None:
    """The ground of sorted finite values, if at least that share of them belongs to it, and objects stand out above."""
    if len(values) < LEAST or not np.isfinite(float(values[-1]) - float(values[0])):
        return None
    level, noise = _peak(values)
    if not noise > 0 or not level + FURTHEST * noise > level:
        # one value: the noise of a camera that is off, with a few pixels below it
        found = Ground(level, 0.0, level) if values[0] < level else None
    else:
        found = _cut(values, level, noise)
    if found is None or _upto(values, found.cut) < least_share * len(values):
        return None
    above = len(values) - _upto(values, found.cut)
    below = np.searchsorted(values, 2 * found.level - found.cut, side="left")
    return found if above >= max(FOUND * len(values), 1) and above >= ONE_SIDED * below else None


def _peak(values: np.ndarray) -> tuple[float, float]:
    """Median and standard deviation of the values without those BEYOND; a deviation of 0 where there is no peak."""
    kept = values
    level, noise = 0.0, 0.0
    for _ in range(ROUNDS):
        low, level, high = (float(_quantile(kept, share)) for share in (LOWER, MIDDLE, UPPER))
        # values cut off below, as of integers at 0, tell nothing of the noise below
        whole = low > values[0]
        if whole and (high - level > LOPSIDED * (level - low) + _step(kept)):
            return level, 0.0
        noise = (high - low) / 2 if whole else high - level
        inner = values[_upto(values, level - BEYOND * noise) : _upto(values, level + BEYOND * noise)]
        if len(inner) in (0, len(kept)):
            break
        kept = inner
    return level, noise


def _cut(values: np.ndarray, level: float, noise: float) -> Ground | None:
    """The ground up to where noise and objects are about as dense: most voxels are told right there."""
    width = max(noise / 2, _step(values[: _upto(values, level + BEYOND * noise)]))
    for place in level + noise * np.linspace(NEAREST, FURTHEST, STEPS + 1):
        here = _upto(values, place + width / 2) - _upto(values, place - width / 2)
        near, far = _upto(values, place + NEXT * noise), _upto(values, place + LAST * noise)
        if len(values) - near < FOUND * len(values):
            return None
        objects = (far - near) / ((LAST - NEXT) * noise)
        if here / width <= 2 * objects:
            return Ground(level, noise, float(place))
    return None


def _quantile(values: np.ndarray, share: float) -> float:
    """Within a step of whole numbers, too: equal values are spread over the step around them."""
    at = share * (len(values) - 1)
    value = values[int(at)]
    first, last = np.searchsorted(values, value, side="left"), _upto(values, value)
    step = _step(values)
    return float(value + ((at - first) / max(last - first, 1) - 0.5) * step if last - first > 1 else value)


def _step(values: np.ndarray) -> float:
    """1 for whole numbers, else what lies between one value that repeats and the next; 0 where none does."""
    middle = values[len(values) // 2]
    first, last = np.searchsorted(values, middle, side="left"), _upto(values, middle)
    return float(values[last] - middle) if last - first > 1 and last < len(values) else 0.0


def _upto(values: np.ndarray, value: float) -> int:
    """How many sorted values are at most that one."""
    return int(np.searchsorted(values, value, side="right"))
