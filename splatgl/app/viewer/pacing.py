"""Adaptive quality: holds the target frame time during motion, and decides when to render at full quality.

LADDER lists the quality levels of a preview. SLOW_FRAMES slow frames switch to a coarser level; QUICK_FRAMES quick
ones to the finest level expected to stay well within the target. Between the two bounds the level is kept, and every
switch back to a coarser level doubles the wait before the next attempt, which prevents flicker. Costs of levels are
measured; for levels not drawn yet they are estimated from the work.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from splatgl.splat.plan.resolve import AVERAGED
from splatgl.splat.plan.settings import Settings

# target seconds per frame in motion
TARGET = 0.033
# minimum seconds between frames during automatic rotation
STEP = 1 / 60
# seconds without input before the full-quality frame; longer than the interval between mouse move events
REST = 0.05
# while a button is held, no full-quality frame that takes longer than this many seconds and cannot be cancelled
HELD = 0.2
# fractions of the target: above SLOW a frame is slow; a finer level must be expected to take less than QUICK
SLOW, QUICK = 1.15, 0.8
SLOW_FRAMES, QUICK_FRAMES = 2, 4
# weight of the newest frame in a level's cost
NEWEST = 0.5
# before any measurement: seconds per pixel covered by tens of splats, and the cost of a splat in pixels (llvmpipe)
PIXEL, PIXELS_PER_SPLAT = 1.5e-7, 2.0


@dataclass(frozen=True)
class Level:
    """scale: of the window's pixels, along each axis. stride: downsampling factor of the volume, by averaging.

    tolerance: a looser tolerance than requested, or None.
    """

    scale: float = 1.0
    stride: int = 1
    tolerance: float | None = None

    def size(self, full: tuple[int, int]) -> tuple[int, int]:
        """Render size (width, height) for a window of `full` pixels, at least 1 × 1."""
        return max(1, round(full[0] * self.scale)), max(1, round(full[1] * self.scale))

    def settings(self, asked: Settings) -> Settings:
        """The requested settings with the reductions of a preview."""
        if self == FULL:
            return asked
        plain = asked.but(antialias="paper") if asked.antialias in AVERAGED else asked
        return plain if self.tolerance is None else plain.but(tolerance=max(self.tolerance, asked.tolerance))

    def __str__(self) -> str:
        parts = [f"{self.scale**2:.0%} of the pixels"] * (self.scale < 1) + [f"voxels x{self.stride}"] * (
            self.stride > 1
        )
        return ", ".join(parts) or "in full"


FULL = Level()
# finest first. Measured on CT, microscopy and terrain: for the same time saved, fewer pixels cause less error than
# larger voxels, down to as many pixels as there are voxels to show
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
    """level: index into LADDER of the preview. costs: seconds of each level, as far as known.

    work: cost of each level in pixel equivalents. met: number of frames drawn at each level.
    slow, quick: consecutive frames above and below the bounds. wait: quick frames required before a finer level.
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
        """splats: their number at each of STRIDES; pixels: the window's."""
        counts = dict(zip(STRIDES, splats, strict=True))
        work = [counts[level.stride] * PIXELS_PER_SPLAT + pixels * level.scale**2 for level in LADDER]
        return cls(tuple(work), target=target)

    def again(self, splats: Sequence[int], pixels: int) -> Pace:
        """For other splats or another window size: measured costs, scaled in proportion to the work."""
        fresh = Pace.of(splats, pixels, self.target)
        costs = [
            None if cost is None else cost * new / old
            for cost, new, old in zip(self.costs, fresh.work, self.work, strict=True)
        ]
        return replace(fresh, level=self.level, costs=tuple(costs), met=self.met)

    def expected(self, level: int) -> float:
        """Expected seconds of a level: measured, or from its work and the nearest measured level."""
        # a level's first frame includes one-time setup: used only if there is no other measurement
        known = {i: cost for i, cost in enumerate(self.costs) if cost is not None}
        known = {i: cost for i, cost in known.items() if self.met[i] > 1} or known
        if not known:
            return self.work[level] * PIXEL
        nearest = min(known, key=lambda i: abs(i - level))
        return known[nearest] * self.work[level] / self.work[nearest]

    def drawn(self, level: int, seconds: float) -> Pace:
        """After a frame of a level that took `seconds`; only frames at the preview level can change that level."""
        before = self.costs[level]
        settled = before is not None and self.met[level] > 1
        cost = before + NEWEST * (seconds - before) if before is not None and settled else seconds
        # the scene's cost changed: scale the other levels alike
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
        """Starts at the finest level expected to meet the target, or at the cheapest if none is."""
        times = [self.expected(level) for level in range(len(LADDER))]
        fits = [level for level in range(len(LADDER)) if times[level] <= self.target]
        cheapest = min(range(len(LADDER)), key=times.__getitem__)
        return replace(self, level=fits[0] if fits else cheapest, slow=0, quick=0, wait=QUICK_FRAMES)

    def finer(self) -> int | None:
        """The finest level expected to stay well within the target, if finer than the current one."""
        better = [level for level in range(self.level) if self.expected(level) < QUICK * self.target]
        return better[0] if better else None


def rests(pace: Pace, idle: float, held: bool) -> bool:
    """Whether to render the full-quality frame, `idle` seconds after the last input; held: a button is down."""
    return idle >= REST and not (held and pace.expected(0) > HELD)
