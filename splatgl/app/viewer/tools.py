"""`Tools`: what the mouse does beside moving the view: handles of cuts are dragged."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from splatgl.app.viewer.cutting import cut
from splatgl.app.viewer.handles import Held, handles, under
from splatgl.app.viewer.measuring import clicked
from splatgl.app.viewer.sight import Place

if TYPE_CHECKING:
    from splatgl.app.viewer.viewer import Viewer


# pixels within which a press and its release are a click
CLICK = 4.0


class Tools:
    """Takes the mouse's events before the view does; each method tells whether it took one."""

    def __init__(self, viewer: Viewer) -> None:
        self.viewer = viewer
        self.held: Held | None = None
        # where the left button was pressed, and the cursor
        self.pressed: Place | None = None
        self.at: Place = (-1.0, -1.0)

    def press(self, button: str, held: tuple[str, ...], place: Place) -> bool:
        """A button is pressed."""
        viewer, state = self.viewer, self.viewer.state
        self.pressed = place if button == "left" and not held else None
        if button != "left" or held or not state.cuts.shown or viewer.content.waiting:
            return False
        found = under(handles(state.cuts, viewer.content.volume), state.pose.camera, place, viewer.window.scale)
        self.held = None if found is None else Held(found, place, replace(state.cuts, active=True))
        return found is not None

    def move(self, place: Place) -> bool:
        """The cursor moves."""
        viewer, held = self.viewer, self.held
        self.at = place
        if viewer.state.probe and viewer.hands.mouse.drag is None:
            viewer.refresh()
        if held is None:
            return False
        before = viewer.state
        cuts = held.to(viewer.content.volume, before.pose.camera, place)
        viewer.state = cut(replace(before, message=""), viewer.content, cuts)
        if viewer.state.cuts != before.cuts or viewer.state.message != before.message:
            viewer.hands.touch()
        return True

    def release(self, button: str, place: Place) -> None:
        """A button is released; a click picks a point of a distance."""
        if button != "left":
            return
        self.held, pressed, self.pressed = None, self.pressed, None
        viewer = self.viewer
        if viewer.state.ruler.active and pressed is not None and max(map(abs, _apart(pressed, place))) < CLICK:
            viewer.state = clicked(viewer.state, viewer.content, place)
            viewer.hands.touch()


def _apart(a: Place, b: Place) -> Place:
    return a[0] - b[0], a[1] - b[1]
