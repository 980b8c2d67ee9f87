"""Keys of the commands: names of keys, and TOML files that change the default keys.

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
from splatgl.viewer.commands import COMMANDS, MOUSE, Command

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
