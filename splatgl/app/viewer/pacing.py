"""How good a picture may be while it moves, so that frames keep to the target time; and when to draw it in full.

LADDER is all that a moving picture may give up. A level is left for a coarser one after SLOW_FRAMES frames that took
too long, and after QUICK_FRAMES for the finest that is expected to keep well within the target: between the two bounds
nothing changes, and who had to come back waits twice as long before the next attempt, so that nothing flickers. What
each level costs is measured; what was never drawn is estimated from the work it means.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from splatgl.splat.plan.settings import Settings

# seconds a frame may take while moving
TARGET = 0.033
# seconds between two pictures of a scene that turns on its own, at least
STEP = 1 / 60
# seconds without input before the picture is drawn in full: longer than from one move of a hand to the next
REST = 0.05
# a held button means more may come: a full picture that takes longer than this, and cannot be broken off, would be in
# the way
HELD = 0.2
# shares of the target: beyond the first a frame is slow, below the second a finer level would be welcome
SLOW, QUICK = 1.15, 0.8
SLOW_FRAMES, QUICK_FRAMES = 2, 4
# weight of the newest frame in a level's cost
NEWEST = 0.5
# until something was measured: seconds a pixel takes with the tens of splats that cover it, and how many of them a
# splat is worth (llvmpipe)
PIXEL, PIXELS_PER_SPLAT = 1.5e-7, 2.0


@dataclass(frozen=True)
class Level:
    """scale: of the window's pixels, along each axis. stride: volume of every so many voxels, averaged.

    tolerance: a looser one than asked, or None.
    """

    scale: float = 1.0
    stride: int = 1
    tolerance: float | None = None

    def size(self, full: tuple[int, int]) -> tuple[int, int]:
        """(width, height) in pixels to draw for a window of `full` pixels, at least 1 × 1."""
        return max(1, round(full[0] * self.scale)), max(1, round(full[1] * self.scale))

    def settings(self, asked: Settings) -> Settings:
        """What is asked, less what a moving picture can do without."""
        if self == FULL:
            return asked
        plain = asked.but(antialias="paper") if asked.antialias == "supersample" else asked
        return plain if self.tolerance is None else plain.but(tolerance=max(self.tolerance, asked.tolerance))

    def __str__(self) -> str:
        parts = [f"{self.scale**2:.0%} of the pixels"] * (self.scale < 1) + [f"voxels x{self.stride}"] * (
            self.stride > 1
        )
        return ", ".join(parts) or "in full"


FULL = Level()
# finest first. Measured on CT, microscopy and terrain: fewer pixels err less than larger voxels for the time they save,
# down to as many as there are voxels to show
LADDER = (
    FULL,
    Level(0.7),
    Level(0.5),
    Level(0.35),
    Level(0.7, 2),
    Level(0.5, 2),
    Level(0.35, 2),
    Level(0.25, 2),
    Level(0.5, 4),
    Level(0.35, 4),
    Level(0.25, 4),
    Level(0.25, 8),
)
STRIDES = tuple(sorted({level.stride for level in LADDER}))


@dataclass(frozen=True)
class Pace:
    """level: index into LADDER of the moving picture. costs: seconds of each level, as far as known.

    work: what each level draws, in pixels' worth. met: how often each was drawn.
    slow, quick: frames in a row beyond and below the bounds. wait: how many of the latter it takes to go finer.
    """

    work: tuple[float, ...]
    level: int = 0
    costs: tuple[float | None, ...] = (None,) * len(LADDER)
    met: tuple[int, ...] = (0,) * len(LADDER)
    slow: int = 0
    quick: int = 0
    wait: int = QUICK_FRAMES
    target: float = TARGET

    @classmethod
    def of(cls, splats: Sequence[int], pixels: int, target: float = TARGET) -> Pace:
        """splats: how many there are at each of STRIDES; pixels: the window's."""
        counts = dict(zip(STRIDES, splats, strict=True))
        work = [counts[level.stride] * PIXELS_PER_SPLAT + pixels * level.scale**2 for level in LADDER]
        return cls(tuple(work), target=target)

    def again(self, splats: Sequence[int], pixels: int) -> Pace:
        """For other splats, or another window: what was measured, in proportion to the work."""
        fresh = Pace.of(splats, pixels, self.target)
        costs = [
            None if cost is None else cost * new / old
            for cost, new, old in zip(self.costs, fresh.work, self.work, strict=True)
        ]
        return replace(fresh, level=self.level, costs=tuple(costs), met=self.met)

    def expected(self, level: int) -> float:
        """Seconds that a level is expected to take: as measured, or from its work and the nearest that was."""
        # a level's first picture also makes what the others find made: it counts only where nothing else is known
        known = {i: cost for i, cost in enumerate(self.costs) if cost is not None}
        known = {i: cost for i, cost in known.items() if self.met[i] > 1} or known
        if not known:
            return self.work[level] * PIXEL
        nearest = min(known, key=lambda i: abs(i - level))
        return known[nearest] * self.work[level] / self.work[nearest]

    def drawn(self, level: int, seconds: float) -> Pace:
        """After a frame of some level that took so long; only frames of the moving level move it."""
        before = self.costs[level]
        settled = before is not None and self.met[level] > 1
        cost = before + NEWEST * (seconds - before) if before is not None and settled else seconds
        # the scene got cheaper or dearer: so did the other levels
        trend = cost / max(before, 1e-9) if before is not None and settled else 1.0
        costs = tuple(
            cost if i == level else None if other is None else other * trend for i, other in enumerate(self.costs)
        )
        met = tuple(count + (i == level) for i, count in enumerate(self.met))
        known = replace(self, costs=costs, met=met)
        if level != self.level:
            return known
        slow = self.slow + 1 if min(cost, seconds) > SLOW * self.target else 0
        finer = known.finer()
        quick = self.quick + 1 if finer is not None and not slow else 0
        if slow >= SLOW_FRAMES:
            return replace(known.started(), wait=2 * self.wait)
        if quick >= self.wait and finer is not None:
            return replace(known, level=finer, slow=0, quick=0)
        return replace(known, slow=slow, quick=quick)

    def started(self) -> Pace:
        """With the finest level that is expected to keep the target; the cheapest of all where none is."""
        times = [self.expected(level) for level in range(len(LADDER))]
        fits = [level for level in range(len(LADDER)) if times[level] <= self.target]
        cheapest = min(range(len(LADDER)), key=times.__getitem__)
        return replace(self, level=fits[0] if fits else cheapest, slow=0, quick=0, wait=QUICK_FRAMES)

    def finer(self) -> int | None:
        """The finest level that is expected to keep well within the target, if finer than the present one."""
        better = [level for level in range(self.level) if self.expected(level) < QUICK * self.target]
        return better[0] if better else None


def rests(pace: Pace, idle: float, held: bool) -> bool:
    """Whether it is time to draw the full picture: `idle` seconds after the last input, `held`: a button is down."""
    return idle >= REST and not (held and pace.expected(0) > HELD)
