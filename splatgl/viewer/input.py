"""Passes mouse events to the first tool that handles them, and names the keys of GLFW."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from splatgl.viewer.clip_tool import ClipTool
from splatgl.viewer.commands import Command
from splatgl.viewer.document import Document
from splatgl.viewer.key_bindings import chord, keymap
from splatgl.viewer.lasso_tool import LassoTool
from splatgl.viewer.measure_tool import MeasureTool, set_pivot
from splatgl.viewer.oblique import with_slices
from splatgl.viewer.slice_views import SliceTool
from splatgl.viewer.state import State
from splatgl.viewer.tool import MouseEvent, Place, Pointer, Tool, View
from splatgl.viewer.trackball import Mouse, up_direction, zoom_by_wheel


class CameraTool(Tool):
    """Turns, moves and zooms the view; a double click sets the pivot."""

    def __init__(self) -> None:
        self.mouse = Mouse()

    def press(self, state: State, document: Document, view: View, pointer: Pointer) -> State | None:
        """Starts a drag; a double click also moves the pivot, and the slices, to the point under the cursor."""
        before = state
        if self.mouse.doubles(pointer.button, pointer.place, view.time):
            state = set_pivot(state, document, pointer.place)
            if state.pose.pivot is not before.pose.pivot:
                state = with_slices(state, state.slices.through(state.pose.pivot, document.volume), document.volume)
        mouse = self.mouse.press(pointer.button, pointer.modifiers, pointer.place, state.pose, view.time)
        if state.turntable and mouse.drag is not None:
            mouse = replace(mouse, drag=replace(mouse.drag, up=up_direction(document)))
        self.mouse = mouse
        return state

    def move(self, state: State, document: Document, view: View, pointer: Pointer) -> State | None:
        """Moves the view by the drag, and stops the automatic rotation."""
        if self.mouse.drag is None:
            return None
        pose = self.mouse.drag.to(pointer.place)
        return replace(state, pose=pose.resized(state.pose.camera.size), turning=False)

    def release(self, state: State, document: Document, view: View, pointer: Pointer) -> State | None:
        """Ends the drag."""
        self.mouse = self.mouse.release()
        return None

    def wheel(self, state: State, document: Document, view: View, pointer: Pointer) -> State | None:
        """Zooms at the cursor; upwards zooms in."""
        return replace(state, pose=zoom_by_wheel(state.pose, pointer.place, pointer.notches))


class InputHandler:
    """Commands by key, and the tools in the order in which events are offered to them. cursor: its latest place."""

    def __init__(self, commands: Iterable[Command], slices: SliceTool) -> None:
        self.commands = keymap(commands)
        self.camera = CameraTool()
        self.tools: tuple[Tool, ...] = (slices, LassoTool(), MeasureTool(), ClipTool(), self.camera)
        self.cursor: Place = (-1.0, -1.0)

    @property
    def is_dragging(self) -> bool:
        """Whether the view is being dragged."""
        return self.camera.mouse.drag is not None

    def handle(self, event: MouseEvent, pointer: Pointer, state: State, document: Document, view: View) -> State:
        """The state after a mouse event, handled by the first tool that takes it; a release is for every tool."""
        self.cursor = pointer.place
        for tool in self.tools:
            result: State | None = getattr(tool, event)(state, document, view, pointer)
            if result is not None and event != "release":
                return result
            state = result or state
        return state


# GLFW key codes (glfw3.h): ASCII for printable keys; function keys and the number pad follow
FIRST_FUNCTION, FIRST_PAD = 290, 320
# from 256 on
_NAMED = (
    *("escape", "enter", "tab", "backspace", "insert", "delete", "right", "left", "down", "up"),
    *("page_up", "page_down", "home", "end"),
)
CODES = {
    **dict(enumerate(_NAMED, 256)),
    **{32: "space", 335: "enter"},
    **{FIRST_FUNCTION + n: f"f{n + 1}" for n in range(12)},
    **{FIRST_PAD + n: str(n) for n in range(10)},
    **{ord("0") + n: str(n) for n in range(10)},
}
SHIFT, CONTROL, ALT = 1, 2, 4


def modifiers(bits: int) -> tuple[str, ...]:
    """Names of GLFW's modifier bits."""
    return tuple(name for name, bit in (("ctrl", CONTROL), ("alt", ALT), ("shift", SHIFT)) if bits & bit)


def from_key(code: int, label: str | None, bits: int) -> str | None:
    """The chord of a key event; None for symbols, which arrive as characters. label: the key's name in GLFW."""
    held = modifiers(bits)
    if code in CODES:
        return chord(CODES[code], held)
    if label and len(label) == 1 and label.isalpha():
        return chord(label.lower(), held)
    # with ctrl or alt, a symbol key produces no character event
    if label and len(label) == 1 and {"ctrl", "alt"} & set(held):
        return chord(label, held)
    return None


def from_character(character: str) -> str | None:
    """The chord of a typed symbol; None for letters, digits and blanks, which arrive as key events."""
    return None if character.isalnum() or character.isspace() else character
