"""What the mouse means: drags, the wheel, double clicks; from places in pixels of the picture to poses."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

from splatgl.app.viewer.pose import DRAG, NOTCH, Place, Pose

# two presses within so many seconds and pixels are a double click
DOUBLE, APART = 0.35, 5.0


@dataclass(frozen=True, eq=False)
class Drag:
    """A button held down: what it does, and where it began."""

    kind: str
    start: Place
    pose: Pose

    def to(self, place: Place) -> Pose:
        """The pose when the cursor is at a place; it depends on that and the start alone."""
        if self.kind == "rotate":
            return self.pose.rotated(self.start, place)
        if self.kind == "roll":
            return self.pose.rolled(self.start, place)
        if self.kind == "pan":
            return self.pose.panned(self.start, place)
        return self.pose.zoomed(self.start, DRAG ** (self.start[1] - place[1]))


@dataclass(frozen=True, eq=False)
class Mouse:
    """The drag under way, if any, and the last press: when and where."""

    drag: Drag | None = None
    pressed: tuple[float, Place] = (-1e9, (0.0, 0.0))

    def press(self, button: str, modifiers: Collection[str], place: Place, pose: Pose, now: float) -> Mouse:
        """After a button goes down; the first button of several keeps the drag."""
        kind = {"left": "rotate", "middle": "pan", "right": "zoom"}.get(button)
        if button == "left" and "shift" in modifiers:
            kind = "pan"
        elif button == "left" and "ctrl" in modifiers:
            kind = "roll"
        if kind is None or self.drag is not None:
            return self
        return Mouse(Drag(kind, place, pose), (now, place) if button == "left" else self.pressed)

    def doubles(self, button: str, place: Place, now: float) -> bool:
        """Whether a press now is the second of a double click."""
        when, where = self.pressed
        near = abs(place[0] - where[0]) < APART and abs(place[1] - where[1]) < APART
        return button == "left" and now - when < DOUBLE and near

    def release(self) -> Mouse:
        """After a button goes up: no drag, the last press kept for double clicks."""
        return Mouse(None, self.pressed)


def wheeled(pose: Pose, place: Place, notches: float) -> Pose:
    """After so many notches of the wheel, upwards is nearer."""
    return pose.zoomed(place, NOTCH**notches)
