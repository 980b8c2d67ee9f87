"""GLFW's keys as the bindings name them: letters as the keyboard is labelled, signs as they are typed."""

from __future__ import annotations

from splatgl.app.viewer.bindings import NAMED, chord

# GLFW's codes (glfw3.h): printable keys have those of ASCII, function keys and the number pad follow on
FIRST_FUNCTION, FIRST_PAD, LAST_PAD = 290, 320, 329
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
    """The chord of a key event; None for signs, which come as characters. label: the key's, as GLFW tells it."""
    held = modifiers(bits)
    if code in CODES:
        return chord(CODES[code], held)
    if label and len(label) == 1 and label.isalpha():
        return chord(label.lower(), held)
    # a sign with ctrl or alt makes no character
    if label and len(label) == 1 and {"ctrl", "alt"} & set(held):
        return chord(label, held)
    return None


def from_character(character: str) -> str | None:
    """The chord of a typed sign; None for letters, digits and blanks, which come as keys."""
    return None if character.isalnum() or character.isspace() else character
