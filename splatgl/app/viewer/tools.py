"""`Tools`: what the mouse does beside moving the view: handles of cuts are dragged."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from splatgl.app.viewer.cutting import cut
from splatgl.app.viewer.handles import Held, handles, under
from splatgl.app.viewer.sight import Place

if TYPE_CHECKING:
    from splatgl.app.viewer.viewer import Viewer


class Tools:
    """Takes the mouse's events before the view does; each method tells whether it took one."""

    def __init__(self, viewer: Viewer) -> None:
        self.viewer = viewer
        self.held: Held | None = None

    def press(self, button: str, held: tuple[str, ...], place: Place) -> bool:
        """A button is pressed."""
        viewer, state = self.viewer, self.viewer.state
        if button != "left" or held or not state.cuts.shown or viewer.content.waiting:
            return False
        found = under(handles(state.cuts, viewer.content.volume), state.pose.camera, place, viewer.window.scale)
        self.held = None if found is None else Held(found, place, replace(state.cuts, active=True))
        return found is not None

    def move(self, place: Place) -> bool:
        """The cursor moves."""
        viewer, held = self.viewer, self.held
        if held is None:
            return False
        before = viewer.state
        cuts = held.to(viewer.content.volume, before.pose.camera, place)
        viewer.state = cut(replace(before, message=""), viewer.content, cuts)
        if viewer.state.cuts != before.cuts or viewer.state.message != before.message:
            viewer.hands.touch()
        return True

    def release(self, button: str) -> None:
        """A button is released."""
        if button == "left":
            self.held = None
