"""`Refiner`: decides whether a frame is due and at which level: previews in motion, full quality at rest."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

from splatgl.app.viewer.pacing import LADDER, REST, STRIDES, Pace, rests

Wanted = tuple[object, ...]


@dataclass(frozen=True)
class Moment:
    """idle: seconds since the last input. turning: automatic rotation. held: a button is down and a full-quality frame
    could not be cancelled. strides: those that are extracted.
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
        self.pace = Pace.of(splats, pixels, target)
        self.drawn: Wanted = ()
        self.refused: Wanted = ()
        # the level of the last frame, and whether no refinement of it remains
        self.last, self.full = 0, True
        # whether the last frame began a motion: it includes uploads to the GPU, and does not predict the next
        self.first = False

    def level(self, wanted: Wanted, now: Moment) -> int | None:
        """Index into LADDER of the frame to draw now; None for no frame."""
        if wanted == self.refused or not now.strides:
            return None
        if wanted != self.drawn:
            if self.full:
                self.pace = self.pace.started()
            return now.finest(self.pace.level if now.moving else 0)
        if self.full or now.moving or not rests(self.pace, now.idle, now.held and now.whole):
            return None
        due = now.finest(0)
        return due if due < self.last or due == 0 else None

    def done(self, wanted: Wanted, level: int, full: bool) -> None:
        """Records a drawn frame; full: no refinement remains."""
        self.first, self.full, self.last = self.full and not full, full, level
        self.drawn, self.refused = wanted, ()

    def took(self, level: int, seconds: float, rest: float) -> None:
        """Records the time of that frame once it is shown: its picture's, and all else."""
        if not (self.first and self.pace.met[level]):
            self.pace = self.pace.drawn(level, seconds, rest)

    def refuse(self, wanted: Wanted) -> None:
        """Marks a frame as impossible: it is not retried."""
        self.refused = wanted

    def renew(self, splats: Sequence[int], pixels: int) -> None:
        """Adapts to other splats or another window size."""
        self.pace = self.pace.again(splats, pixels)

    def patience(self, wanted: Wanted, now: Moment) -> float | None:
        """Seconds until a frame is due; None if none is."""
        if wanted == self.refused or not now.strides:
            return None
        if wanted != self.drawn:
            return 0.0
        waits = self.full or (now.finest(0) >= self.last > 0 and not now.whole)
        return None if waits else max(0.0, REST - now.idle)
