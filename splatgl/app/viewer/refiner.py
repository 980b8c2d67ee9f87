"""`Refiner`: decides whether a frame is due and at which level: previews in motion, full quality at rest."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from splatgl.app.viewer.pacing import LADDER, REST, Pace, rests

# the finest level whose splats are extracted synchronously after a change of the transfer function
COARSE = next(number for number, level in enumerate(LADDER) if level.stride > 1)

Wanted = tuple[object, ...]


@dataclass(frozen=True)
class Moment:
    """idle: seconds since the last input. turning: automatic rotation. held: a button is down and a full-quality frame
    could not be cancelled. whole: all splats are extracted.
    """

    idle: float
    turning: bool = False
    held: bool = False
    whole: bool = True

    @property
    def moving(self) -> bool:
        """Whether the view rotates automatically or the last input is less than REST seconds old."""
        return self.turning or self.idle < REST


class Refiner:
    """Tracks the last frame and the cost of each level. Frames are identified by tuples of their inputs."""

    def __init__(self, splats: Sequence[int], pixels: int, target: float) -> None:
        # for camera motion, and for edits of the transfer function
        self.pace = self.edit = Pace.of(splats, pixels, target)
        self.drawn: Wanted = ()
        self.refused: Wanted = ()
        self.full = True

    def level(self, wanted: Wanted, now: Moment) -> int | None:
        """Index into LADDER of the frame to draw now; None for no frame."""
        if wanted == self.refused:
            return None
        if wanted != self.drawn:
            if self.full:
                self.pace, self.edit = self.pace.started(), self.edit.started()
            if not now.whole:
                return max(self.edit.level, COARSE)
            return self.pace.level if now.moving else 0
        resting = not now.moving and rests(self.pace, now.idle, now.held)
        return 0 if now.whole and resting and not self.full else None

    def done(self, wanted: Wanted, level: int, seconds: float, now: Moment, full: bool) -> None:
        """Records a drawn frame; full: no refinement remains."""
        # the first frame of a motion includes uploads to the GPU: it does not predict the next
        first, self.full = self.full and not full, full
        self.drawn, self.refused = wanted, ()
        if first and (self.pace if now.whole else self.edit).met[level]:
            return
        if now.whole:
            self.pace = self.pace.drawn(level, seconds)
        else:
            self.edit = self.edit.drawn(level, seconds)

    def refuse(self, wanted: Wanted) -> None:
        """Marks a frame as impossible: it is not retried."""
        self.refused = wanted

    def renew(self, splats: Sequence[int], pixels: int) -> None:
        """Adapts to other splats or another window size."""
        self.pace, self.edit = self.pace.again(splats, pixels), self.edit.again(splats, pixels)

    def patience(self, wanted: Wanted, now: Moment) -> float | None:
        """Seconds until a frame is due; None if none is."""
        if wanted == self.refused:
            return None
        if wanted != self.drawn:
            return 0.0
        return None if self.full or not now.whole else max(0.0, REST - now.idle)
