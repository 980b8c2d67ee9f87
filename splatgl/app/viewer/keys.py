"""GLFW keys to the names used in bindings: letters by keyboard label, symbols by typed character."""

from __future__ import annotations

from splatgl.app.viewer.bindings import NAMED, chord

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
