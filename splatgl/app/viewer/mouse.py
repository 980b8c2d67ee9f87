"""Mouse input to camera poses: drags, wheel and double clicks, with positions in image pixels."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from splatgl.app.viewer.pose import DRAG, NOTCH, Pose
from splatgl.app.viewer.sight import Place

# maximum seconds and pixels between the presses of a double click
DOUBLE, APART = 0.35, 5.0


@dataclass(frozen=True, eq=False)
class Drag:
    """A drag: its operation and its start. up: of a turntable, world; None: of a trackball."""

    kind: str
    start: Place
    pose: Pose
    up: np.ndarray | None = None

    def to(self, place: Place) -> Pose:
        """The pose for a cursor position; depends only on it and the start, not on the path."""
        if self.kind == "rotate" and self.up is not None:
            return self.pose.swept(self.start, place, self.up)
        if self.kind == "rotate":
            return self.pose.rotated(self.start, place)
        if self.kind == "roll":
            return self.pose.rolled(self.start, place)
        if self.kind == "pan":
            return self.pose.panned(self.start, place)
        return self.pose.zoomed(self.start, DRAG ** (self.start[1] - place[1]))


@dataclass(frozen=True, eq=False)
class Mouse:
    """The current drag, if any, and the time and position of the last press."""

    drag: Drag | None = None
    pressed: tuple[float, Place] = (-1e9, (0.0, 0.0))

    def press(self, button: str, modifiers: Collection[str], place: Place, pose: Pose, now: float) -> Mouse:
        """State after a button press; with several buttons down, the first one keeps the drag."""
        kind = {"left": "rotate", "middle": "pan", "right": "zoom"}.get(button)
        if button == "left" and "shift" in modifiers:
            kind = "pan"
        elif button == "left" and "ctrl" in modifiers:
            kind = "roll"
        if kind is None or self.drag is not None:
            return self
        return Mouse(Drag(kind, place, pose), (now, place) if button == "left" else self.pressed)

    def doubles(self, button: str, place: Place, now: float) -> bool:
        """Whether a press now completes a double click."""
        when, where = self.pressed
        near = abs(place[0] - where[0]) < APART and abs(place[1] - where[1]) < APART
        return button == "left" and now - when < DOUBLE and near

    def release(self) -> Mouse:
        """State after a button release: no drag; the last press is kept for double clicks."""
        return Mouse(None, self.pressed)


def wheeled(pose: Pose, place: Place, notches: float) -> Pose:
    """The pose after wheel rotation by `notches`; upwards zooms in."""
    return pose.zoomed(place, NOTCH**notches)
