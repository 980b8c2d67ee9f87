"""`Tool`: interface of the mouse tools, and the mouse events that they handle."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from splatgl.viewer.document import Document
    from splatgl.viewer.state import State

# pixels, (0, 0) at the upper left corner
Place = tuple[float, float]
MouseEvent = Literal["press", "move", "release", "wheel"]


@dataclass(frozen=True)
class View:
    """A window. size: pixels, at least 1; scale: of its text; time: monotonic clock, seconds."""

    size: tuple[int, int]
    scale: float = 1.0
    time: float = 0.0


@dataclass(frozen=True)
class Pointer:
    """A mouse event. button: "left", "middle" or "right" where one is pressed or released; modifiers: keys that are
    down; notches: of the wheel, upwards positive.
    """

    place: Place
    button: str = ""
    modifiers: tuple[str, ...] = ()
    notches: float = 0.0


class Tool:
    """Handles mouse events. Each method returns the new state, or None to leave the event to the next tool."""

    def press(self, state: State, document: Document, view: View, pointer: Pointer) -> State | None:
        """A button is pressed."""
        return None

    def move(self, state: State, document: Document, view: View, pointer: Pointer) -> State | None:
        """The cursor moves."""
        return None

    def release(self, state: State, document: Document, view: View, pointer: Pointer) -> State | None:
        """A button is released; every tool gets this event, whatever the others return."""
        return None

    def wheel(self, state: State, document: Document, view: View, pointer: Pointer) -> State | None:
        """The wheel turns."""
        return None
