"""Key bindings: the default ones, GLFW's names of keys, and a TOML file of others. `commands.ACTIONS` acts.

[bindings]
turn = ["space", "t"]       # action = the keys that do it, instead of the usual ones
quit = "q"
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from splatgl.annotations.annotate import ANNOTATIONS
from splatgl.errors import expected
from splatgl.fileio import load_table

MODIFIERS = ("ctrl", "alt", "shift")
# names of keys without a character; function keys are f1 to f12
NAMED = (
    *("escape", "enter", "tab", "space", "backspace", "insert", "delete", "home", "end", "page_up", "page_down"),
    *("left", "right", "up", "down"),
    *(f"f{n}" for n in range(1, 13)),
)


@dataclass(frozen=True)
class Binding:
    """An action, its keys, and its help text."""

    action: str
    keys: tuple[str, ...]
    about: str


BINDINGS = (
    Binding("reset", ("r", "home"), "back to the first view"),
    Binding("isometric", ("v", "9"), "isometric view"),
    Binding("front", ("1",), "view from the front, Anterior, along +Y"),
    Binding("back", ("ctrl+1",), "view from the back, Posterior, along -Y"),
    Binding("right", ("3",), "view from the right, along -X"),
    Binding("left", ("ctrl+3",), "view from the left, along +X"),
    Binding("top", ("7",), "view from the top, Superior, along -Z"),
    Binding("bottom", ("ctrl+7",), "view from the bottom, Inferior, along +Z"),
    Binding("projection", ("p", "5"), "perspective or orthographic"),
    Binding("blend", ("b",), "next blend mode"),
    Binding("antialias", ("a",), "next kind of antialiasing"),
    Binding("align", ("g",), "next alignment of the splats"),
    Binding("motion", ("m",), "next kind of motion blur, while turning"),
    Binding("beyond", ("k",), "the z_k plane, and what lies beyond it"),
    Binding("attenuation", ("w",), "next form of attenuation beyond z_k"),
    Binding("compositing", ("o",), "composite single splats, or sheets of them"),
    Binding("classification", ("c",), "classify before reconstruction, or after"),
    Binding("compare", ("d",), "float64 reference beside it, or the difference"),
    Binding("opacity-down", ("[",), "less opaque"),
    Binding("opacity-up", ("]",), "more opaque"),
    Binding("threshold-down", (",",), "lower threshold: keep more voxels"),
    Binding("threshold-up", (".",), "higher threshold: keep fewer voxels"),
    Binding("turn-left", ("left",), "turn the view to the left"),
    Binding("turn-right", ("right",), "turn the view to the right"),
    Binding("turn-up", ("up",), "look from higher"),
    Binding("turn-down", ("down",), "look from lower"),
    Binding("zoom-in", ("+", "="), "nearer"),
    Binding("zoom-out", ("-",), "farther"),
    Binding("roll-left", ("page_up",), "roll to the left"),
    Binding("roll-right", ("page_down",), "roll to the right"),
    Binding("turntable", ("u",), "drags turn a turntable, or a trackball"),
    Binding("handles", ("x",), "handles of the cutting box and planes"),
    Binding("cuts", ("shift+x",), "cuts on or off"),
    Binding("plane", ("ctrl+x",), "cut by another plane, which faces you"),
    Binding("uncut", ("delete",), "remove all cuts"),
    Binding("turn", ("space",), "turn on its own, or stop"),
    Binding("play", ("enter",), "play a time series, or stop"),
    Binding("earlier", ("<",), "the time point before"),
    Binding("later", (">",), "the next time point"),
    Binding("screenshot", ("s", "f12"), "save the picture (PNG)"),
    Binding("save", ("shift+s",), "save the floats (NPY) and the scene"),
    Binding("open", ("ctrl+o",), "open files"),
    Binding("save-as", ("ctrl+s",), "save the scene or the picture as"),
    Binding("undo", ("ctrl+z",), "undo the last change"),
    Binding("redo", ("ctrl+shift+z", "ctrl+y"), "redo what was undone"),
    Binding("annotations", ("j",), "axes, scale bar and patient directions"),
    *(Binding(row.name, (row.key,), row.title) for row in ANNOTATIONS.values() if row.key and not row.default),
    Binding("probe", ("y",), "the value under the cursor"),
    Binding("measure", ("e",), "distance between two points: click on them"),
    Binding("slices", ("z",), "three slices: the wheel and clicks move them"),
    Binding("slice-colors", ("shift+z",), "slices in grey or in colours"),
    Binding("light", ("l",), "next light: head, matte, glossy, flat"),
    Binding("fullscreen", ("f11", "f"), "fullscreen"),
    Binding("hud", ("i",), "what is drawn and how: short, full, or off"),
    Binding("panel", ("tab",), "show or hide the panel"),
    Binding("ground", ("n",), "next ground: black, white, checks, grey, blue"),
    Binding("help", ("?", "f1"), "all keys"),
    Binding("close", ("escape",), "close what is open; stop what goes on"),
    Binding("quit", ("q", "ctrl+q"), "quit"),
)
MOUSE = (
    ("left drag", "turn"),
    ("shift+left, middle drag", "pan"),
    ("wheel, right drag", "zoom to the cursor"),
    ("ctrl+left drag", "roll"),
    ("double click", "turn about the point under the cursor"),
    ("drop a file", "open it; several: a series; a mesh: over it"),
)


def keymap(bindings: Iterable[Binding]) -> dict[str, str]:
    """Key → action. Raises InputError for a key bound to two actions."""
    actions: dict[str, str] = {}
    for binding in bindings:
        for key in binding.keys:
            if actions.setdefault(key, binding.action) != binding.action:
                raise expected(f"key {key}", "one action", f"{actions[key]} and {binding.action}")
    return actions


def remapped(changes: Mapping[str, object], bindings: Iterable[Binding] = BINDINGS) -> tuple[Binding, ...]:
    """The bindings with the keys of some actions replaced. Raises InputError for unknown actions and keys."""
    known = {binding.action: binding for binding in bindings}
    for action, keys in changes.items():
        if action not in known:
            raise expected("bindings", f"actions {', '.join(known)}", repr(action))
        given = [keys] if isinstance(keys, str) else keys
        if not isinstance(given, list) or not all(isinstance(key, str) for key in given):
            raise expected(f"bindings: {action}", "a key or a list of keys", repr(keys))
        known[action] = replace(known[action], keys=tuple(checked(action, key) for key in given))
    keymap(known.values())
    return tuple(known.values())


def load_bindings(path: str | Path) -> tuple[Binding, ...]:
    """The bindings with the overrides of a TOML file's [bindings]. Raises InputError naming the file."""
    table = load_table(Path(path), "key bindings")
    changes = table.get("bindings")
    if not isinstance(changes, dict) or len(table) != 1:
        raise expected(path, "the table [bindings] alone", ", ".join(table) or "an empty file")
    return remapped(changes)


def checked(action: str, key: str) -> str:
    """Normalized key name, modifiers in canonical order: `Shift+Ctrl+S` → `ctrl+shift+s`."""
    *modifiers, name = key.lower().split("+") if not key.endswith("+") else [*key.lower()[:-1].split("+")[:-1], "+"]
    if set(modifiers) - set(MODIFIERS) or len(set(modifiers)) < len(modifiers) or not (len(name) == 1 or name in NAMED):
        fix = f"write a character or one of {', '.join(NAMED[:11])}, …, after {', '.join(m + '+' for m in MODIFIERS)}"
        raise expected(f"bindings: {action}", "a key", repr(key), fix)
    return chord(name, modifiers)


def chord(name: str, modifiers: Iterable[str]) -> str:
    """Key name with its modifiers in the order of MODIFIERS."""
    return "+".join([m for m in MODIFIERS if m in set(modifiers)] + [name])


def listing(bindings: Iterable[Binding]) -> str:
    """The bindings as text, one per line, for the help and `--list-bindings`."""
    rows = [(", ".join(binding.keys), binding.about, binding.action) for binding in bindings]
    width, about = max(len(keys) for keys, _, _ in rows), max(len(text) for _, text, _ in rows)
    lines = [f"{keys:<{width}}  {text:<{about}}  {action}" for keys, text, action in rows]
    mouse = max(len(move) for move, _ in MOUSE)
    return "\n".join([*lines, "", *(f"{move:<{mouse}}  {text}" for move, text in MOUSE)])


# GLFW key codes (glfw3.h): ASCII for printable keys; function keys and the number pad follow
FIRST_FUNCTION, FIRST_PAD = 290, 320
CODES = {
    256: "escape",
    257: "enter",
    258: "tab",
    32: "space",
    259: "backspace",
    260: "insert",
    261: "delete",
    262: "right",
    263: "left",
    264: "down",
    265: "up",
    266: "page_up",
    267: "page_down",
    268: "home",
    269: "end",
    335: "enter",
    **{FIRST_FUNCTION + n: f"f{n + 1}" for n in range(12)},
    **{FIRST_PAD + n: str(n) for n in range(10)},
    **{ord("0") + n: str(n) for n in range(10)},
}
SHIFT, CONTROL, ALT = 1, 2, 4
assert set(CODES.values()) <= {*NAMED, *"0123456789"}


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
