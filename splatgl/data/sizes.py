"""Numbers of bytes, as options and in messages."""

from __future__ import annotations

import re

from splatgl.data.errors import expected


def bytes_of(text: str) -> int:
    """Parses a number of bytes: 4GiB, 500MB, 1e9. Raises InputError for other text."""
    found = re.fullmatch(r"([0-9.]+(?:e[0-9]+)?) *(?:([kmgt])(i?)b?|b?)", text.strip().lower())
    try:
        assert found is not None
        number, unit, binary = found.groups()
        return int(float(number) * (1024 if binary else 1000) ** ("kmgt".index(unit) + 1 if unit else 0))
    except (AssertionError, ValueError):
        raise expected("memory", "a number of bytes, such as 4GiB or 500MB", repr(text)) from None


def size_of(count: int) -> str:
    """A number of bytes as text, such as 3.7 GiB."""
    size, units = float(count), ["bytes", "KiB", "MiB", "GiB", "TiB"]
    while size >= 1024 and len(units) > 1:
        size, units = size / 1024, units[1:]
    return f"{size:.0f} {units[0]}" if units[0] == "bytes" else f"{size:.1f} {units[0]}"
