"""Reads TOML tables from untrusted files: regular files only, with limited size and nesting; and writes values."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Sequence
from numbers import Integral, Real
from pathlib import Path
from typing import Any

from splatgl.data.errors import InputError, expected

MAX_BYTES = 2**20
"""Longest file in bytes: a transfer function with a node for each of 65536 values."""


def load_table(path: Path, what: str) -> dict[str, Any]:
    """The table in a TOML file. what: the kind of file for messages, such as "a scene". Raises InputError naming it."""
    try:
        # a pipe would block, a device could be endless
        if path.exists() and not path.is_file():
            raise expected(path, f"{what} in a TOML file", "a folder, pipe or device")
        with path.open("rb") as file:
            data = file.read(MAX_BYTES + 1)
        if len(data) > MAX_BYTES:
            raise expected(path, f"{what} of at most {MAX_BYTES} bytes", "more")
        return parse_table(data.decode("utf-8"), f"{path}: expected {what} in TOML")
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: expected {what} in TOML, got {error}") from error


def parse_table(text: str, expectation: str) -> dict[str, Any]:
    """The table in TOML text. Raises InputError whose message begins with `expectation`."""
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        # ValueError: bad TOML, invalid dates, and integers too long to convert
        raise InputError(f"{expectation}, got {' '.join(str(error).split())}") from error


def toml_value(what: str, value: Any) -> str:
    """A string, number, boolean, or sequence of them as TOML. Raises InputError for what TOML cannot hold."""
    if isinstance(value, str):
        # JSON escapes everything that TOML requires, except DEL
        text = json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
        if any("\ud800" <= letter <= "\udfff" for letter in text):
            raise expected(what, "text that TOML can hold", repr(value)[:80])
        return text
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, Integral):
        return str(int(value))
    if isinstance(value, Real):
        return repr(float(value))
    if isinstance(value, Sequence):
        return "[" + ", ".join(toml_value(what, part) for part in value) + "]"
    raise expected(what, "text, numbers or lists of them", type(value).__name__)
