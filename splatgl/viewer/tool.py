"""`Tool`: interface of the mouse tools, and the mouse events that they handle."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, Protocol

if TYPE_CHECKING:
    from splatgl.viewer.document import Document
    from splatgl.viewer.state import State

# pixels, (0, 0) at the upper left corner
Place = tuple[float, float]
MouseEvent = Literal["press", "move", "release", "wheel"]


# width of the panel, the least of the picture beside it, and that of windows in which the panel is open at first, at a
# content scale of 1
PANEL, BESIDE, ROOMY = 330.0, 310.0, 800.0


def docked_width(window: tuple[int, int], scale: float) -> int:
    """Pixels of the panel beside the picture; 0 in windows so narrow that it lies over the picture."""
    return round(PANEL * scale) if window[0] >= (PANEL + BESIDE) * scale else 0


def is_roomy(window: tuple[int, int], scale: float) -> bool:
    """Whether a window opens with its panel; in narrower ones the panel is opened when it is wanted."""
    return window[0] >= ROOMY * scale


@dataclass(frozen=True)
class View:
    """A window without its docked panel. size: pixels, at least 1; scale: of its text; time: monotonic, in seconds."""

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


class Tool(Protocol):
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
