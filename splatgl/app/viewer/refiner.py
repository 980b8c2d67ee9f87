"""`Refiner`: whether a picture is wanted now, and how good a one: loose while something moves, right once it rests."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from splatgl.app.viewer.pacing import LADDER, REST, Pace, rests

# the finest level whose splats are made at once when the transfer function changes
COARSE = next(number for number, level in enumerate(LADDER) if level.stride > 1)

Wanted = tuple[object, ...]


@dataclass(frozen=True)
class Moment:
    """idle: seconds since the last input. turning: on its own. held: a button is down, and a full picture could not be
    given up once it is begun. whole: all splats are made.
    """

    idle: float
    turning: bool = False
    held: bool = False
    whole: bool = True

    @property
    def moving(self) -> bool:
        """Whether the view turns on its own, or the last input is less than REST seconds ago."""
        return self.turning or self.idle < REST


class Refiner:
    """Knows what was drawn last and how long which level takes. What is wanted are tuples of values."""

    def __init__(self, splats: Sequence[int], pixels: int, target: float) -> None:
        # of a moving camera, and of a transfer function being edited
        self.pace = self.edit = Pace.of(splats, pixels, target)
        self.drawn: Wanted = ()
        self.refused: Wanted = ()
        self.full = True

    def level(self, wanted: Wanted, now: Moment) -> int | None:
        """The level of the ladder to draw now; None for no picture."""
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
        """After a picture was drawn; full: nothing is left to be refined."""
        # the first of a movement moves what it needs to the graphics card: it says little of the next
        first, self.full = self.full and not full, full
        self.drawn, self.refused = wanted, ()
        if first and (self.pace if now.whole else self.edit).met[level]:
            return
        if now.whole:
            self.pace = self.pace.drawn(level, seconds)
        else:
            self.edit = self.edit.drawn(level, seconds)

    def refuse(self, wanted: Wanted) -> None:
        """This picture cannot be had: it is not tried again."""
        self.refused = wanted

    def renew(self, splats: Sequence[int], pixels: int) -> None:
        """For other splats, or another window."""
        self.pace, self.edit = self.pace.again(splats, pixels), self.edit.again(splats, pixels)

    def patience(self, wanted: Wanted, now: Moment) -> float | None:
        """Seconds until a picture is due; None if none is."""
        if wanted == self.refused:
            return None
        if wanted != self.drawn:
            return 0.0
        return None if self.full or not now.whole else max(0.0, REST - now.idle)
