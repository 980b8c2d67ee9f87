"""Routes mouse and keys to tools and commands."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from splatgl.viewer.clip_tool import Held, cut, handles, under
from splatgl.viewer.commands import acted
from splatgl.viewer.key_bindings import Binding, keymap
from splatgl.viewer.measure_tool import clicked, pivoted
from splatgl.viewer.trackball import Mouse, Place, up_of, wheeled

if TYPE_CHECKING:
    from splatgl.viewer.viewer import Viewer


# maximum number of panel frames queued by events
MOST_FRAMES = 20


class Hands:
    """The listener of a viewer's window. asked: input counter; a full-quality frame is cancelled when it changes."""

    def __init__(self, viewer: Viewer, bindings: Iterable[Binding]) -> None:
        self.viewer = viewer
        self.keys = keymap(bindings)
        self.mouse = Mouse()
        self.tools = Tools(viewer)
        self.touched = viewer.now()
        self.asked = 0

    def touch(self) -> None:
        """Notes input that may change the picture."""
        self.asked += 1
        self.touched = self.viewer.now()
        self.viewer.refresh()

    def key(self, chord: str) -> None:
        """Runs the action bound to `chord`, if any."""
        action = self.keys.get(chord)
        if action:
            self.viewer.state = acted(self.viewer.state, action, self.viewer.document)
            self.touch()

    def press(self, button: str, held: tuple[str, ...], place: Place) -> None:
        """Starts a drag; a double click sets the pivot."""
        viewer = self.viewer
        if viewer.slicing.press(button, place) or self.tools.press(button, held, place):
            return
        if self.mouse.doubles(button, place, viewer.now()):
            before = viewer.state.pose.pivot
            viewer.state = pivoted(viewer.state, viewer.document, place)
            if viewer.state.pose.pivot is not before:
                found = viewer.state.slices.through(viewer.state.pose.pivot, viewer.document.volume)
                viewer.state = replace(viewer.state, slices=found)
            self.touch()
        self.mouse = self.mouse.press(button, held, place, viewer.state.pose, viewer.now())
        drag = self.mouse.drag
        if viewer.state.turntable and drag is not None:
            self.mouse = replace(self.mouse, drag=replace(drag, up=up_of(viewer.document)))

    def release(self, button: str) -> None:
        """Ends the drag."""
        self.viewer.slicing.release()
        self.tools.release(button, self.viewer.window.at)
        self.mouse = self.mouse.release()

    def move(self, place: Place) -> None:
        """Moves the view by the current drag, if any, and stops the automatic rotation."""
        if not self.viewer.slicing.move(place) and not self.tools.move(place) and self.mouse.drag is not None:
            viewer, pose = self.viewer, self.mouse.drag.to(place)
            viewer.state = replace(viewer.state, pose=pose.resized(viewer.size), turning=False)
            self.touch()

    def wheel(self, notches: float, place: Place) -> None:
        """Zooms at `place`; upwards zooms in. Over a slice it moves that."""
        if self.viewer.slicing.wheel(notches, place):
            return
        self.viewer.state = replace(self.viewer.state, pose=wheeled(self.viewer.state.pose, place, notches))
        self.touch()

    def resize(self, size: tuple[int, int]) -> None:
        """Fits the view to a window of `size` in pixels; a minimised one keeps its last size."""
        if min(size) > 0:
            viewer, before = self.viewer, self.viewer.state.pose
            pose = before.resized(viewer.size)
            viewer.state = replace(viewer.state, pose=pose)
            # it is the same view
            viewer.history.fitted(before, pose)
            viewer.home = pose if viewer.home is before else viewer.home
            self.touch()

    def fill(self) -> None:
        """Fits the picture into the window, if it does not."""
        if self.viewer.state.pose.camera.size != self.viewer.size:
            self.resize(self.viewer.window.size)

    def drop(self, paths: list[str]) -> None:
        """Opens the files; the current document stays until they are loaded."""
        if paths:
            viewer = self.viewer
            viewer.files.open(paths, viewer.state.settings, viewer.document.waiting)
            self.touch()

    def refresh(self) -> None:
        """Shows the window's document again in the next step."""
        self.viewer.refresh()

    def raw(self, kind: str, *values: Any) -> bool:
        """Passes an event to the panel; True if it is the panel's. A cursor that moves elsewhere shows nothing new."""
        viewer = self.viewer
        if viewer.panel is None or not viewer.state.panel or viewer.state.help:
            return False
        over = viewer.panel.touched
        taken = bool(viewer.panel.event(kind, *values))
        if kind != "cursor" or viewer.window.held or over or viewer.panel.touched:
            self.asked += kind != "cursor" or viewer.window.held
            # the panel handles one event per frame and shows its effect in the next
            viewer.dirty = min(max(viewer.dirty, 1) + 1, MOST_FRAMES)
        return taken


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
        if button != "left" or held or not state.cuts.shown or viewer.document.waiting:
            return False
        found = under(handles(state.cuts, viewer.document.volume), state.pose.camera, place, viewer.window.scale)
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
        cuts = held.to(viewer.document.volume, before.pose.camera, place)
        viewer.state = cut(replace(before, message=""), viewer.document, cuts)
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
            viewer.state = clicked(viewer.state, viewer.document, place)
            viewer.hands.touch()


def _apart(a: Place, b: Place) -> Place:
    return a[0] - b[0], a[1] - b[1]
