"""Which methods are worth their time: the Pareto front, what dominates the others, the cheapest under each error."""

from __future__ import annotations

import math
import statistics
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

# errors are told apart by so many decades, 26 %; times of a ratio below ALIKE are the same: one method's own differ
# as much from turn to turn
DECADES, ALIKE = 0.1, 1.05
# errors that the cheapest method is asked for
ERRORS = (1e-1, 3e-2, 1e-2, 1 / 255, 1e-3, 1e-4, 1e-5)


@dataclass(frozen=True)
class Timing:
    """Seconds for a frame: the median of `count`, and the quartiles around it."""

    median: float
    low: float
    high: float
    count: int

    @classmethod
    def of(cls, seconds: Sequence[float]) -> Timing:
        """Of at least one time; quartiles by linear interpolation."""
        if len(seconds) < 2:
            return cls(seconds[0], seconds[0], seconds[0], 1)
        low, median, high = statistics.quantiles(seconds, n=4, method="inclusive")
        return cls(median, low, high, len(seconds))

    def no_longer(self, other: Timing) -> bool:
        """Whether this takes no more time than the other, as far as their spread tells."""
        return self.median <= ALIKE * other.median or self.low <= other.high


@dataclass(frozen=True)
class Point:
    """A method's place in a work–precision diagram."""

    name: str
    error: float
    time: Timing

    @property
    def rounded(self) -> float:
        """The error as errors are told apart, in steps of DECADES; −∞ for none."""
        return round(math.log10(self.error) / DECADES) if self.error > 0 else -math.inf


def front(points: Sequence[Point]) -> list[Point]:
    """The points that no other beats, the fastest first.

    One beats another by a smaller error in no more time, or by less time at the same error. Times whose quartiles
    come within ALIKE of each other are the same, so that two runs agree; of the same error and time the first stands
    for all.
    """
    classes: dict[float, list[Point]] = {}
    for point in points:
        classes.setdefault(point.rounded, []).append(point)
    best: list[Point] = []
    for error in sorted(classes):
        fastest = min(classes[error], key=lambda p: p.time.median)
        point = next(p for p in classes[error] if p.time.no_longer(fastest.time))
        if not any(other.time.no_longer(point.time) for other in best):
            best.append(point)
    return sorted(best, key=lambda p: p.time.median)


def beaten(point: Point, points: Sequence[Point]) -> Point | None:
    """The point of the front that does so: the most right of those that take no more time; None if it is on it."""
    best = front(points)
    if point in best:
        return None
    righter = [p for p in best if p.rounded <= point.rounded]
    rivals = [p for p in righter if p.time.no_longer(point.time)]
    # spreads don't order: what beats it by way of a third may itself take a little more
    return min(rivals, key=lambda p: p.rounded) if rivals else min(righter, key=lambda p: p.time.median)


def standing(point: Point, points: Sequence[Point]) -> str:
    """Either "front" or "dominated by …"."""
    rival = beaten(point, points)
    return f"dominated by {rival.name}" if rival else "front"


def cheapest(points: Sequence[Point], limits: Sequence[float] = ERRORS) -> list[tuple[float, Point | None]]:
    """For each error, the fastest that stays under it."""
    return [
        (limit, min((p for p in points if p.error <= limit), key=lambda p: p.time.median, default=None))
        for limit in limits
    ]


def finite(points: Iterable[Point]) -> list[Point]:
    return [point for point in points if math.isfinite(point.error)]
