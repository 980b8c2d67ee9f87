"""Which methods are worth their time: the Pareto front, what dominates the others, the cheapest under each error."""

from __future__ import annotations

import math
import statistics
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

# errors are told apart by so many decades, 26 %
DECADES = 0.1
# a method is faster in a round if it takes less than 1/FASTER of the time, and surely so in that share of the rounds
FASTER, SURE = 1.1, 0.75
# errors that the cheapest method is asked for
ERRORS = (1e-1, 3e-2, 1e-2, 1 / 255, 1e-3, 1e-4, 1e-5)


@dataclass(frozen=True)
class Timing:
    """Seconds for a frame: the median of `count` rounds, the least and the most of them, and all by round."""

    median: float
    low: float
    high: float
    count: int
    rounds: Mapping[int, float] = field(default_factory=dict, compare=False)

    @classmethod
    def of(cls, rounds: Mapping[int, float]) -> Timing:
        """Of at least one round."""
        seconds = rounds.values()
        return cls(statistics.median(seconds), min(seconds), max(seconds), len(rounds), rounds)

    def faster(self, other: Timing) -> float:
        """In what share of the rounds that both had this was faster: what slows a machine down slows down both."""
        both = self.rounds.keys() & other.rounds.keys()
        pairs = [(self.rounds[n], other.rounds[n]) for n in both] or [(self.median, other.median)]
        return sum(FASTER * mine < theirs for mine, theirs in pairs) / len(pairs)

    def over(self, other: Timing) -> Timing:
        """How many times as long as the other, round by round: what two reports agree on, however busy the machine."""
        both = self.rounds.keys() & other.rounds.keys()
        return Timing.of({n: self.rounds[n] / other.rounds[n] for n in both} or {0: self.median / other.median})


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


@dataclass(frozen=True)
class Standing:
    """How a point stands among others: in what share of the rounds it is worth its time beside `rival`, beside whom
    it is so in the fewest; 1 without any.
    """

    share: float = 1.0
    rival: Point | None = None

    @property
    def word(self) -> str:
        """Either "front", "dominated", or "unsure", which is what noise may make of either."""
        return "front" if self.share >= SURE else "dominated" if self.share <= 1 - SURE else "unsure"

    def __str__(self) -> str:
        """Either "front", "dominated by …" or "front, or behind …"."""
        if self.rival is None or self.word == "front":
            return "front"
        return f"{'dominated by' if self.word == 'dominated' else 'front, or behind'} {self.rival.name}"


def standing(point: Point, points: Sequence[Point]) -> Standing:
    """How `point`, one of `points`, stands.

    It is on the front if it is surely faster than every other that is as right or more. Of two that are as right, the
    first in `points` need only not be surely slower: of the same error and time it stands for both.
    """
    mine = points.index(point)
    found = []
    for n, other in enumerate(points):
        if n != mine and other.rounded <= point.rounded:
            first = other.rounded == point.rounded and mine < n
            share = 1 - other.time.faster(point.time) if first else point.time.faster(other.time)
            found.append(Standing(share, other))
    # of rivals that beat it alike, the most right is told
    return min(found, key=lambda s: (s.share, s.rival.rounded if s.rival else 0.0), default=Standing())


def front(points: Sequence[Point], unsure: bool = False) -> list[Point]:
    """The points on the front, the fastest first; unsure: those too of which the times don't tell."""
    words = ("front", "unsure") if unsure else ("front",)
    return sorted((p for p in points if standing(p, points).word in words), key=lambda p: p.time.median)


def stairs(points: Sequence[Point]) -> list[Point]:
    """The front as it is drawn, by medians: of what may be on it, each that is more right than all that are faster."""
    found: list[Point] = []
    for point in front(points, unsure=True):
        if not found or point.error < found[-1].error:
            found.append(point)
    return found


def cheapest(points: Sequence[Point], limits: Sequence[float] = ERRORS) -> list[tuple[float, Point | None]]:
    """For each error, the fastest that stays under it; of those that are not surely slower, the most right."""
    found: list[tuple[float, Point | None]] = []
    for limit in limits:
        under = [point for point in points if point.error <= limit]
        fastest = min(under, key=lambda p: p.time.median, default=None)
        alike = [p for p in under if fastest is not None and fastest.time.faster(p.time) < SURE]
        found.append((limit, min(alike, key=lambda p: p.rounded, default=None)))
    return found


def finite(points: Iterable[Point]) -> list[Point]:
    """The points whose error is a finite number."""
    return [point for point in points if math.isfinite(point.error)]
