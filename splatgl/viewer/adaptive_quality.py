"""Adapts the quality of previews to the time of frames, refines still pictures, and returns memory.

LADDER lists the quality levels of a preview, with a floor: an eighth of the pixels, and every second voxel. Where that
takes long, half of these pixels; coarser voxels only where it would without other processes, too. The time of
a frame is that of its picture, which depends on the level, and of text, panel and swap, which does not. SLOW_FRAMES
slow frames switch to a coarser level, if that is expected to gain something; a level that turns out to gain nothing is
left again. QUICK_FRAMES quick frames switch to the next finer level, if that is expected to stay well within the
target; every switch back doubles the wait before the next attempt, which prevents flicker. Costs of levels are
measured; for levels not drawn yet they are estimated from the work.

All levels but FULL are drawn to LENIENT, an error far below that of coarser voxels; the first of them, with all pixels
and voxels, takes a third of FULL's time.

A coarse stand-in is shown at once; finer voxels are read in a thread.
"""

from __future__ import annotations

import ctypes
import gc
import os
from collections.abc import Callable, Collection, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from splatgl.data.volume import FEWEST, Volume, halve_volume, subsample
from splatgl.errors import USER_ERRORS
from splatgl.fileio import budget, format_bytes
from splatgl.planning.bricks import bricks_of, estimate_need
from splatgl.splat.settings import AVERAGED, LENIENT, Settings
from splatgl.splat.splats import MOST_KEPT
from splatgl.transfer.transfer import Transfer

# glibc's option M_MMAP_THRESHOLD, and its value: larger blocks, bytes, return to the system once freed
M_MMAP_THRESHOLD, MAPPED = -3, 1 << 20
# seconds after which unused objects are freed although the window is busy
SWEPT = 5.0


def return_large_blocks() -> None:
    """Makes glibc return freed pictures to the system: a window that is resized would grow without end. Other
    allocators stay as they are.
    """
    with suppress(OSError, AttributeError, TypeError):
        ctypes.CDLL(None).mallopt(M_MMAP_THRESHOLD, MAPPED)


def return_free_memory() -> None:
    """Returns freed small blocks to the system, which glibc would keep below blocks in use."""
    with suppress(OSError, AttributeError, TypeError):
        ctypes.CDLL(None).malloc_trim(0)


class IdleTrim:
    """Frees unused documents and pictures. They refer to themselves: Python alone frees them late. owns_process:
    whether objects that are there already are not looked through each time, which takes 40 ms.
    """

    def __init__(self, now: float, owns_process: bool) -> None:
        self.frame: object = None
        self.at, self.owns_process = now, owns_process
        if owns_process:
            gc.freeze()

    def close(self) -> None:
        """Leaves all objects to Python again."""
        if self.owns_process:
            gc.unfreeze()

    def look(self, frame: object, resting: bool, now: float) -> None:
        """Frees memory once for a frame that rests, and seldom for frames in motion."""
        if frame is not self.frame and (resting or now - self.at > SWEPT):
            gc.collect()
            return_free_memory()
            self.frame, self.at = frame, now


# target seconds per frame in motion
TARGET = 0.033
# minimum seconds between frames during automatic rotation
STEP = 1 / 60
# seconds without input before the full-quality frame; longer than the interval between mouse move events
REST = 0.05
# a full-quality frame that takes longer than this many seconds follows a preview, and if it cannot be cancelled, it
# waits until no button is held
HELD = 0.2
# fractions of the target: above SLOW a frame is slow; a finer level must be expected to take less than QUICK
SLOW, QUICK = 1.15, 0.8
SLOW_FRAMES, QUICK_FRAMES = 2, 4
# how many times faster a coarser level must be, and must be expected to be before it is tried; frames of more than
# POOR seconds go down to the floor: single measurements of small gains are not reliable
GAIN, TRIED, POOR = 1.3, 1.05, 0.1
# weight of the newest frame in a level's cost, and its upper bound in multiples of the earlier cost
NEWEST, MOST_RISE = 0.5, 2.0
# before any measurement: seconds per pixel covered by tens of splats, and the cost of a splat in pixels (llvmpipe)
PIXEL, PIXELS_PER_SPLAT = 1.5e-7, 2.0
# seconds of a frame above which there is no floor; by how much fewer they are than processor seconds of software OpenGL
# where no other process takes the processor
STUCK, PARALLEL = 0.2, 1.6 if (os.cpu_count() or 1) > 1 else 1.0
# share of a preview's time, with one sample a pixel to LENIENT, of that of all that is asked for
LENIENT_SHARE = 1 / 3


@dataclass(frozen=True)
class PreviewLevel:
    """scale: of the window's pixels, along each axis. stride: downsampling factor of the volume, by averaging. exact:
    whether it is drawn with the requested settings.
    """

    scale: float = 1.0
    stride: int = 1
    exact: bool = False

    def size(self, full: tuple[int, int]) -> tuple[int, int]:
        """Render size (width, height) for a window of `full` pixels, at least 1 × 1."""
        return max(1, round(full[0] * self.scale)), max(1, round(full[1] * self.scale))

    def settings(self, settings: Settings) -> Settings:
        """The requested settings with the reductions of a preview."""
        if self.exact:
            return settings
        lenient = settings.replace(tolerance=max(settings.tolerance, LENIENT))
        return lenient.replace(antialias="paper") if settings.antialias in AVERAGED else lenient

    def __str__(self) -> str:
        pixels = [f"{self.scale**2:.0%} of the pixels"] if self.scale < 1 else []
        voxels = [f"voxels x{self.stride}"] if self.stride > 1 else []
        return ", ".join(pixels + voxels) or ("in full" if self.exact else "all pixels and voxels")


FULL = PreviewLevel(exact=True)
# finest first. Measured on bones, a stent and a neuron: an eighth of the pixels has half the error of every second
# voxel; coarser voxels turn thin things into blobs
_SHARES = {1: (0.84, 0.71, 0.5, 0.35), 2: (0.71, 0.5, 0.35, 0.25), 4: (0.5, 0.35), 8: (0.5,)}
LADDER = (
    FULL,
    PreviewLevel(),
    *(PreviewLevel(share, stride) for stride, shares in _SHARES.items() for share in shares),
)
STRIDES = tuple(sorted({level.stride for level in LADDER}))
# the floor, and the one below it while the machine is busy
FLOOR, BUSY_FLOOR = LADDER.index(PreviewLevel(0.35, 2)), LADDER.index(PreviewLevel(0.25, 2))


@dataclass(frozen=True)
class PreviewPace:
    """Quality level of previews, and the costs that it follows from. level: index into LADDER. costs: seconds of each
    level's picture, as far as known.

    work: cost of each level in pixel equivalents.
    met: number of frames drawn at each level. fixed: seconds of a frame without its picture. alone: seconds of a whole
    frame at the floor, without other processes.
    slow, quick: consecutive frames above and below the bounds. wait: quick frames required before a finer level.
    finer_one: the level that slow frames left, until it is known whether that gained anything.
    """

    work: tuple[float, ...]
    level: int = 0
    costs: tuple[float | None, ...] = (None,) * len(LADDER)
    met: tuple[int, ...] = (0,) * len(LADDER)
    fixed: float = 0.0
    alone: float = 0.0
    slow: int = 0
    quick: int = 0
    wait: int = QUICK_FRAMES
    finer_one: int | None = None
    target: float = TARGET

    @classmethod
    def of(cls, splats: Sequence[int], pixels: int, target: float = TARGET) -> PreviewPace:
        """The pace before any frame. splats: numbers at each of STRIDES; pixels: of the window."""
        counts = dict(zip(STRIDES, splats, strict=True))
        work = [
            (counts[level.stride] * PIXELS_PER_SPLAT + pixels * level.scale**2) * (1 if level.exact else LENIENT_SHARE)
            for level in LADDER
        ]
        return cls(tuple(work), target=target)

    def again(self, splats: Sequence[int], pixels: int) -> PreviewPace:
        """The pace for other splats or another window size: measured costs, scaled in proportion to the work."""
        fresh = PreviewPace.of(splats, pixels, self.target)
        costs = [
            None if cost is None else cost * new / old
            for cost, new, old in zip(self.costs, fresh.work, self.work, strict=True)
        ]
        alone = self.alone * fresh.work[FLOOR] / self.work[FLOOR]
        return replace(fresh, level=self.level, costs=tuple(costs), met=self.met, fixed=self.fixed, alone=alone)

    def expected(self, level: int) -> float:
        """Expected seconds of a whole frame of a level: measured, or from its work and the nearest measured level."""
        value = self.costs[level]
        if value is not None and self.met[level] > 1:
            return self.fixed + value
        # a level's first frame includes one-time setup: used only if there is no other measurement
        known = {i: value for i, value in enumerate(self.costs) if value is not None}
        known = {i: value for i, value in known.items() if self.met[i] > 1} or known
        if not known:
            return self.fixed + self.work[level] * PIXEL
        nearest = min(known, key=lambda i: abs(i - level))
        estimate = known[nearest] * self.work[level] / self.work[nearest]
        return self.fixed + (estimate if value is None else min(value, estimate))

    def drawn(self, level: int, seconds: float, rest: float = 0.0, alone: float | None = None) -> PreviewPace:
        """The pace after a frame of a level. seconds: of its picture; rest: of all else; alone: of both without other
        processes, None: as long. Only frames at the preview level can change that level.
        """
        before = self.costs[level]
        cost, trend = seconds, 1.0
        if before is not None and self.met[level] > 1:
            # one slow frame is no trend
            cost = before + NEWEST * (min(seconds, MOST_RISE * before) - before)
            # the scene's cost changed: scale the other levels alike
            trend = cost / max(before, 1e-9)
        costs = tuple(
            cost if i == level else None if other is None else other * trend for i, other in enumerate(self.costs)
        )
        met = tuple(count + (i == level) for i, count in enumerate(self.met))
        fixed = self.fixed + NEWEST * (rest - self.fixed) if self.fixed else rest
        known = replace(self, costs=costs, met=met, fixed=fixed)
        if level == FLOOR and met[level] > 1:
            newest = seconds + rest if alone is None else alone
            known = replace(known, alone=newest if not self.alone else self.alone + NEWEST * (newest - self.alone))
        if level != self.level:
            return known
        left = known.finer_one
        if left is not None and met[level] > 1:
            known = replace(known, finer_one=None)
            if known.expected(level) < POOR and known.expected(left) < GAIN * known.expected(level):
                return replace(known, level=left, slow=0, quick=0, wait=2 * self.wait)
        return known._judged(min(cost, seconds) + fixed)

    def _judged(self, seconds: float) -> PreviewPace:
        """The pace with another level, if one is due after a frame of so many seconds."""
        if self.level not in self._allowed:
            # the floor is fast enough again
            return replace(self, level=FLOOR, slow=0, quick=0)
        slow = self.slow + 1 if seconds > SLOW * self.target else 0
        quick = self.quick + 1 if self.finer() and not slow else 0
        coarser = self.coarser() if slow >= SLOW_FRAMES else None
        if coarser is not None:
            return replace(self, level=coarser, finer_one=self.level, slow=0, quick=0, wait=2 * self.wait)
        # no level meets the target: a finer one may be as slow as this one
        if quick >= self.wait or (slow >= SLOW_FRAMES and self.level and self.expected(self.level - 1) < self._enough):
            return replace(self, level=self.level - 1, slow=0, quick=0)
        return replace(self, slow=min(slow, SLOW_FRAMES), quick=quick)

    def started(self) -> PreviewPace:
        """The pace at the finest level expected to meet the target, else at the finest that is nearly the fastest."""
        level = next((level for level in self._allowed if self.expected(level) <= self._enough), self._allowed[-1])
        left = 0 if level and self.met[0] else None
        return replace(self, level=level, slow=0, quick=0, wait=QUICK_FRAMES, finer_one=left)

    def coarser(self) -> int | None:
        """A coarser level that is faster, or may be; preferably one that meets the target. None if there is none."""
        now = self.expected(self.level)
        gains = [
            level
            for level in self._allowed
            if level > self.level
            and (now >= POOR or self.expected(level) * (GAIN if self.met[level] > 1 else TRIED) < now)
        ]
        return next((level for level in gains if self.expected(level) <= self.target), next(iter(gains), None))

    def finer(self) -> bool:
        """Whether the next finer level is expected to stay well within the target."""
        return self.level > 0 and self.expected(self.level - 1) < QUICK * self.target

    @property
    def _enough(self) -> float:
        """Seconds of a frame that is fast enough: the target, or nearly those of the fastest level, up to POOR."""
        return max(self.target, min(GAIN * min(map(self.expected, self._allowed)), POOR))

    @property
    def _allowed(self) -> range:
        """The levels down to the floor; to the next one if it is too slow; all if it is so without other processes."""
        is_slow = self.met[FLOOR] > 1 and self.expected(FLOOR) > STUCK
        return range((len(LADDER) if self.alone > STUCK else BUSY_FLOOR + 1) if is_slow else FLOOR + 1)


Wanted = tuple[object, ...]


@dataclass(frozen=True)
class InputTiming:
    """Input state of a frame. idle: seconds since the last input. turning: automatic rotation. held: a button is down
    and a full-quality frame could not be cancelled. strides: with extracted splats.
    """

    idle: float
    turning: bool = False
    held: bool = False
    strides: Collection[int] = STRIDES

    @property
    def moving(self) -> bool:
        """Whether the view rotates automatically or the last input is less than REST seconds old."""
        return self.turning or self.idle < REST

    @property
    def whole(self) -> bool:
        """Whether all splats are extracted."""
        return 1 in self.strides

    def finest(self, level: int) -> int:
        """The given level, or the nearest one, coarser if there is any, whose splats are extracted."""
        tried = (*range(level, len(LADDER)), *reversed(range(level)))
        return next(number for number in tried if LADDER[number].stride in self.strides)


class Refiner:
    """Tracks the last frame and the cost of each level. Frames are identified by tuples of their inputs."""

    def __init__(self, splats: Sequence[int], pixels: int, target: float) -> None:
        self.pace = PreviewPace.of(splats, pixels, target)
        self.drawn: Wanted = ()
        self.refused: Wanted = ()
        # the level of the last frame, and whether no refinement of it remains
        self.last, self.full = 0, True
        # whether the last frame began a motion: it includes uploads to the GPU, and does not predict the next
        self.first = False

    def level(self, wanted: Wanted, now: InputTiming) -> int | None:
        """Index into LADDER of the frame to draw now; None for no frame."""
        if wanted == self.refused or not now.strides:
            return None
        if wanted != self.drawn:
            if self.full:
                self.pace = self.pace.started()
            # on a busy machine, the view may rest before it is drawn
            is_slow = self.pace.expected(0) > HELD
            return now.finest(self.pace.level if now.moving or is_slow else 0)
        is_held = now.held and now.whole and self.pace.expected(0) > HELD
        if self.full or now.moving or now.idle < REST or is_held:
            return None
        due = now.finest(0)
        return due if due < self.last or due == 0 else None

    def step(self, wanted: Wanted, now: InputTiming, draw: Callable[[int], tuple[Wanted, bool]]) -> int | None:
        """Draws the frame that is due, and returns its level; None if none is. draw: at a level; returns the inputs, as
        finer voxels may be read, and whether no refinement remains. A frame with an error is not tried again.
        """
        level, was_full = self.level(wanted, now), self.full
        if level is not None:
            try:
                self.drawn, self.full = draw(level)
            except USER_ERRORS:
                self.refused = wanted
                raise
            self.first, self.last, self.refused = was_full and not self.full, level, ()
        return level

    def took(self, level: int, seconds: float, rest: float, alone: float | None = None) -> None:
        """Records the seconds of a displayed frame: of its picture, of all else, and alone, see `PreviewPace.drawn`."""
        if not (self.first and self.pace.met[level]):
            self.pace = self.pace.drawn(level, seconds, rest, alone)

    def renew(self, splats: Sequence[int], pixels: int) -> None:
        """Adapts to other splats or another window size."""
        self.pace = self.pace.again(splats, pixels)

    def seconds_until_due(self, wanted: Wanted, now: InputTiming) -> float | None:
        """Seconds until a frame is due; None if none is."""
        if wanted == self.refused or not now.strides:
            return None
        if wanted != self.drawn:
            return 0.0
        waits = self.full or (now.finest(0) >= self.last > 0 and not now.whole)
        return None if waits else max(0.0, REST - now.idle)


# most voxels that are read and shown at once, of a stand-in, and of a level that has coarser ones
LARGE, STAND_IN, MOST_OF_LEVEL = 1 << 23, 1 << 23, 1 << 28
# pixels of a window, all samples
PIXELS = 4 << 20


@dataclass(frozen=True, eq=False)
class StandIn:
    """Visible voxels of a volume. note: description, "" for all voxels. finer: reads the finer ones, if any.

    level: its number in a multiscale image, with which the scene is saved; None for others.
    """

    volume: Volume
    note: str = ""
    finer: Callable[[], StandIn] | None = None
    level: int | None = None


def choose_stand_in(volume: Volume, transfer: Transfer, settings: Settings) -> StandIn:
    """Chooses the first stand-in: the finest level that fits into half of free memory."""
    most = budget()
    if not volume.coarser and _fits(volume, transfer, settings, most):
        return StandIn(volume)
    levels = _levels(volume)
    number = next((n for n, level in enumerate(levels) if _fits(level, transfer, settings, most)), None)
    if number is not None:
        first = number if levels[number].count <= LARGE else len(levels) - 1
        return _level(levels, first, number)
    base = levels[-1]
    step = max(2, int(np.ceil((base.count / STAND_IN) ** (1 / 3))))
    note = f"every {step}{ {2: 'nd', 3: 'rd'}.get(step, 'th') } voxel"
    return StandIn(subsample(base, step), note, lambda: _means(base, transfer, settings, most))


def _means(volume: Volume, transfer: Transfer, settings: Settings, most: int) -> StandIn:
    """Means over the smallest blocks of voxels that fit; for labels, the most frequent label of each block."""
    labels = bool(transfer.labels)
    means, side = halve_volume(volume, labels), 2
    while not _fits(means, transfer, settings, most) and max(means.shape) >= FEWEST:
        means, side = halve_volume(means, labels), 2 * side
    what = "most frequent labels" if labels else "means"
    return StandIn(means, f"{what} of {side}^3 voxels: smaller ones need more than {format_bytes(most)}")


def _levels(volume: Volume) -> list[Volume]:
    """Levels of a multiscale image, finest first, each with its coarser levels."""
    levels = [volume, *(replace(level, name=volume.name, hints=volume.hints) for level in volume.coarser)]
    return [replace(level, coarser=tuple(levels[number + 1 :])) for number, level in enumerate(levels)]


def _level(levels: list[Volume], number: int, finest: int) -> StandIn:
    """A level, which finer levels replace one by one."""
    volume, last = levels[number], len(levels) - 1
    note = f"level {number} of {last}, {' x '.join(map(str, volume.shape[::-1]))} voxels" if number else ""
    if number > finest:
        return StandIn(volume, note, lambda: _level(levels, number - 1, finest), number)
    return StandIn(volume, f"{note}: finer ones are too large for a window" if number else "", None, number)


def _fits(volume: Volume, transfer: Transfer, settings: Settings, most: int) -> bool:
    """Whether a volume fits; a level with coarser ones must also be drawn quickly."""
    if volume.coarser and volume.count > MOST_OF_LEVEL:
        return False
    bricks = bricks_of(volume, transfer, settings)
    if bricks is None:
        return True
    wanted = estimate_need(bricks, PIXELS, most)
    return wanted.bytes <= most and not (volume.coarser and wanted.most > MOST_KEPT)
