"""Pareto front of error against time, dominance, and the cheapest method under each error."""

from __future__ import annotations

import math
import statistics
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

# resolution of errors in decades: 26 %
DECADES = 0.1
# a method is faster in a round if it takes less than 1/FASTER of the time; certain in SURE of the rounds
FASTER, SURE = 1.1, 0.75
# error limits for the cheapest method
ERRORS = (1e-1, 3e-2, 1e-2, 1 / 255, 1e-3, 1e-4, 1e-5)


@dataclass(frozen=True)
class Timing:
    """Seconds per frame: median, minimum and maximum of `count` rounds, and all by round."""

    median: float
    low: float
    high: float
    count: int
    rounds: Mapping[int, float] = field(default_factory=dict, compare=False)

    @classmethod
    def of(cls, rounds: Mapping[int, float]) -> Timing:
        """Statistics of at least one round."""
        seconds = rounds.values()
        return cls(statistics.median(seconds), min(seconds), max(seconds), len(rounds), rounds)

    def faster(self, other: Timing) -> float:
        """Fraction of common rounds in which this was faster: load on the machine slows both in the same round."""
        both = self.rounds.keys() & other.rounds.keys()
        pairs = [(self.rounds[n], other.rounds[n]) for n in both] or [(self.median, other.median)]
        return sum(FASTER * mine < theirs for mine, theirs in pairs) / len(pairs)

    def over(self, other: Timing) -> Timing:
        """Ratio to the other's time, by round: comparable between reports, whatever the load."""
        both = self.rounds.keys() & other.rounds.keys()
        return Timing.of({n: self.rounds[n] / other.rounds[n] for n in both} or {0: self.median / other.median})


@dataclass(frozen=True)
class Point:
    """A method's position in a work–precision diagram."""

    name: str
    error: float
    time: Timing

    @property
    def rounded(self) -> float:
        """The logarithmic error, quantized to steps of DECADES; −∞ for 0."""
        return round(math.log10(self.error) / DECADES) if self.error > 0 else -math.inf


@dataclass(frozen=True)
class Standing:
    """Standing of a point: the fraction of rounds in which it is on the front against `rival`, the point with the
    smallest such fraction; 1 without rivals.
    """

    share: float = 1.0
    rival: Point | None = None

    @property
    def word(self) -> str:
        """Either "front", "dominated", or "unsure" if noise allows both."""
        return "front" if self.share >= SURE else "dominated" if self.share <= 1 - SURE else "unsure"

    def __str__(self) -> str:
        """Either "front", "dominated by …" or "front, or behind …"."""
        if self.rival is None or self.word == "front":
            return "front"
        return f"{'dominated by' if self.word == 'dominated' else 'front, or behind'} {self.rival.name}"


def standing(point: Point, points: Sequence[Point]) -> Standing:
    """The standing of `point`, one of `points`.

    It is on the front if it is certainly faster than every other that is at least as accurate. Of two equally
    accurate points, the first in `points` only needs not to be certainly slower: it represents both.
    """
    mine = points.index(point)
    found = []
    for n, other in enumerate(points):
        if n != mine and other.rounded <= point.rounded:
            first = other.rounded == point.rounded and mine < n
            share = 1 - other.time.faster(point.time) if first else point.time.faster(other.time)
            found.append(Standing(share, other))
    # of equal rivals, report the most accurate
    return min(found, key=lambda s: (s.share, s.rival.rounded if s.rival else 0.0), default=Standing())


def front(points: Sequence[Point], unsure: bool = False) -> list[Point]:
    """The points on the front, fastest first; unsure: including those that the timings cannot decide."""
    words = ("front", "unsure") if unsure else ("front",)
    return sorted((p for p in points if standing(p, points).word in words), key=lambda p: p.time.median)


def stairs(points: Sequence[Point]) -> list[Point]:
    """The drawn front, by medians: of its possible members, each that is more accurate than all faster ones."""
    found: list[Point] = []
    for point in front(points, unsure=True):
        if not found or point.error < found[-1].error:
            found.append(point)
    return found


def cheapest(points: Sequence[Point], limits: Sequence[float] = ERRORS) -> list[tuple[float, Point | None]]:
    """For each error, the point below it whose median time is the shortest; of equal times, the most accurate."""
    found: list[tuple[float, Point | None]] = []
    for limit in limits:
        under = (point for point in points if point.error <= limit)
        found.append((limit, min(under, key=lambda p: (p.time.median, p.error), default=None)))
    return found


def finite(points: Iterable[Point]) -> list[Point]:
    """The points with finite errors."""
    return [point for point in points if math.isfinite(point.error)]
