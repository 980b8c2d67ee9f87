"""Pareto front of error against time, dominance, and the cheapest method below each error."""

from __future__ import annotations

import math
import statistics
from collections.abc import Mapping, Sequence
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
    """Position of a method in a work–precision diagram."""

    name: str
    error: float
    time: Timing

    @property
    def rounded(self) -> float:
        """The logarithmic error, quantized to steps of DECADES; −∞ for 0."""
        return round(math.log10(self.error) / DECADES) if self.error > 0 else -math.inf


@dataclass(frozen=True)
class Dominance:
    """share: of rounds in which a point is on the front against `rival`, the point with the smallest share."""

    share: float = 1.0
    rival: Point | None = None

    @property
    def word(self) -> str:
        """One of "front", "dominated", and "unsure" if noise allows both."""
        return "front" if self.share >= SURE else "dominated" if self.share <= 1 - SURE else "unsure"

    def __str__(self) -> str:
        """One of "front", "dominated by …" and "front, or behind …"."""
        if self.rival is None or self.word == "front":
            return "front"
        return f"{'dominated by' if self.word == 'dominated' else 'front, or behind'} {self.rival.name}"


def dominance(point: Point, points: Sequence[Point]) -> Dominance:
    """Dominance of `point`, one of `points`.

    A point is on the front if it is certainly faster than all that are at least as accurate. Of two equally accurate
    points, the first in `points` represents both unless it is certainly slower.
    """
    mine = points.index(point)
    rivals = []
    for n, other in enumerate(points):
        if n != mine and other.rounded <= point.rounded:
            first = other.rounded == point.rounded and mine < n
            share = 1 - other.time.faster(point.time) if first else point.time.faster(other.time)
            rivals.append(Dominance(share, other))
    # of equal rivals, report the most accurate
    return min(rivals, key=lambda s: (s.share, s.rival.rounded if s.rival else 0.0), default=Dominance())


def front(points: Sequence[Point], unsure: bool = False) -> list[Point]:
    """Points on the front, fastest first; unsure: with points that the timings cannot exclude."""
    words = ("front", "unsure") if unsure else ("front",)
    return sorted((p for p in points if dominance(p, points).word in words), key=lambda p: p.time.median)


def stairs(points: Sequence[Point]) -> list[Point]:
    """Front by medians, for drawing: possible members that are more accurate than all faster ones."""
    steps: list[Point] = []
    for point in front(points, unsure=True):
        if not steps or point.error < steps[-1].error:
            steps.append(point)
    return steps


def cheapest(points: Sequence[Point], limits: Sequence[float] = ERRORS) -> list[tuple[float, Point | None]]:
    """(limit, fastest point below the limit) for each limit; of equal times, the most accurate."""

    def fastest(limit: float) -> Point | None:
        below = (point for point in points if point.error <= limit)
        return min(below, key=lambda p: (p.time.median, p.error), default=None)

    return [(limit, fastest(limit)) for limit in limits]
