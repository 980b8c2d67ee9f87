"""Passes mouse events to the first tool that handles them; keys of the commands, and files that change them.

[bindings]
turn = ["space", "t"]       # command = its keys, instead of the default ones
quit = "q"
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from splatgl.errors import expected
from splatgl.fileio import load_table
from splatgl.viewer.clip_tool import ClipTool, LassoTool
from splatgl.viewer.commands import COMMANDS, MOUSE, Command
from splatgl.viewer.document import Document
from splatgl.viewer.measure_tool import MeasureTool, set_pivot
from splatgl.viewer.slice_planes import with_slices
from splatgl.viewer.slice_views import SliceTool
from splatgl.viewer.state import State
from splatgl.viewer.trackball import Mouse, MouseEvent, Place, Pointer, Tool, Viewport, up_direction, zoom_by_wheel

MODIFIERS = ("ctrl", "alt", "shift")
# most letters of the keys in a row of the help
LONGEST = 22
# names of keys without a character; function keys are f1 to f12
NAMED = (
    *("escape", "enter", "tab", "space", "backspace", "insert", "delete", "home", "end", "page_up", "page_down"),
    *("left", "right", "up", "down"),
    *(f"f{n}" for n in range(1, 13)),
)


def keymap(commands: Iterable[Command]) -> dict[str, Command]:
    """Key → command. Raises InputError for a key of two commands."""
    keys: dict[str, Command] = {}
    for command in commands:
        for key in command.keys:
            if keys.setdefault(key, command) is not command:
                raise expected(f"key {key}", "one action", f"{keys[key].id} and {command.id}")
    return keys


def rebind(changes: Mapping[str, object], commands: Iterable[Command] = COMMANDS) -> tuple[Command, ...]:
    """The commands with other keys for some of them. Raises InputError for unknown commands and keys."""
    known = {command.id: command for command in commands}
    for name, keys in changes.items():
        if name not in known:
            raise expected("bindings", f"actions {', '.join(known)}", repr(name))
        names = [keys] if isinstance(keys, str) else keys
        if not isinstance(names, list) or not all(isinstance(key, str) for key in names):
            raise expected(f"bindings: {name}", "a key or a list of keys", repr(keys))
        known[name] = replace(known[name], keys=tuple(normalize_key(name, key) for key in names))
    keymap(known.values())
    return tuple(known.values())


def load_bindings(path: str | Path) -> tuple[Command, ...]:
    """The commands with the keys of a TOML file's table [bindings]. Raises InputError naming the file."""
    table = load_table(Path(path), "key bindings")
    changes = table.get("bindings")
    if not isinstance(changes, dict) or len(table) != 1:
        raise expected(path, "the table [bindings] alone", ", ".join(table) or "an empty file")
    return rebind(changes)


def normalize_key(command: str, key: str) -> str:
    """Key name in lower case, with its modifiers in order: `Shift+Ctrl+S` → `ctrl+shift+s`. InputError names the
    command.
    """
    *modifiers, name = key.lower().split("+") if not key.endswith("+") else [*key.lower()[:-1].split("+")[:-1], "+"]
    if set(modifiers) - set(MODIFIERS) or len(set(modifiers)) < len(modifiers) or not (len(name) == 1 or name in NAMED):
        fix = f"write a character or one of {', '.join(NAMED[:11])}, …, after {', '.join(m + '+' for m in MODIFIERS)}"
        raise expected(f"bindings: {command}", "a key", repr(key), fix)
    return chord(name, modifiers)


def chord(name: str, modifiers: Iterable[str]) -> str:
    """Key name with its modifiers in the order of MODIFIERS."""
    return "+".join([m for m in MODIFIERS if m in set(modifiers)] + [name])


def help_rows(commands: Iterable[Command]) -> list[tuple[str, str]]:
    """Keys and title of each command that has keys, below the names of their menus, then the moves of the mouse."""
    rows: dict[str, dict[str, list[str]]] = {}
    for command in commands:
        if command.keys:
            rows.setdefault(command.menu, {}).setdefault(command.row or command.title, []).extend(command.keys)
    table = [*rows.items(), ("Mouse", {text: [move] for move, text in MOUSE})]
    return [
        row for name, texts in table for row in ((name.upper(), ""), *((_join_keys(k), t) for t, k in texts.items()))
    ]


def _join_keys(keys: Sequence[str]) -> str:
    """The first keys of a row, as many as a narrow column takes; signs stand without commas, which could be keys."""
    if not any(character.isalnum() for key in keys for character in key):
        return " ".join(keys)
    count = max(n for n in range(1, len(keys) + 1) if n == 1 or len(", ".join(keys[:n])) <= LONGEST)
    return ", ".join(keys[:count])


def list_bindings(commands: Iterable[Command]) -> str:
    """The commands as text, one per line, for `--list-bindings`."""
    rows = [(", ".join(command.keys), command.title, command.id) for command in commands]
    keys, titles = max(len(keys) for keys, _, _ in rows), max(len(title) for _, title, _ in rows)
    moves = max(len(move) for move, _ in MOUSE)
    lines = [f"{key:<{keys}}  {title:<{titles}}  {name}" for key, title, name in rows]
    return "\n".join([*lines, "", *(f"{move:<{moves}}  {text}" for move, text in MOUSE)])


class CameraTool(Tool):
    """Turns, moves and zooms the view; a double click sets the pivot."""

    def __init__(self) -> None:
        self.mouse = Mouse()

    def press(self, state: State, document: Document, view: Viewport, pointer: Pointer) -> State | None:
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

    def move(self, state: State, document: Document, view: Viewport, pointer: Pointer) -> State | None:
        """Moves the view by the drag, and stops the automatic rotation."""
        if self.mouse.drag is None:
            return None
        pose = self.mouse.drag.to(pointer.place)
        return replace(state, pose=pose.resized(state.pose.camera.size), turning=False)

    def release(self, state: State, document: Document, view: Viewport, pointer: Pointer) -> State | None:
        """Ends the drag."""
        self.mouse = self.mouse.release()
        return None

    def wheel(self, state: State, document: Document, view: Viewport, pointer: Pointer) -> State | None:
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

    def handle(self, event: MouseEvent, pointer: Pointer, state: State, document: Document, view: Viewport) -> State:
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
