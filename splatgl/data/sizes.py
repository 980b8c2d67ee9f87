"""Numbers of bytes, as options and in messages; and how much memory there is."""

from __future__ import annotations

import os
import re
from pathlib import Path

from splatgl.data.errors import expected

# share of what is available now that is used unless a budget is given
SHARE = 0.5
# free bytes where the system tells none
ASSUMED = 4 << 30
# the budget that was given, if any
_given: list[int] = []


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


def limit(memory: int | None) -> None:
    """Sets the budget of this process, bytes; None: what is free."""
    _given[:] = [] if memory is None else [memory]


def require_memory(
    needed: int, there: int, fix: str = "read it where more is free, or save a part of it", what: str = "samples"
) -> None:
    """Raises InputError for what takes `needed` bytes, in `there` packed ones, if memory is too small for it."""
    most = budget()
    if needed > most:
        got = f"{size_of(needed)}, packed in {size_of(max(there, 0))}"
        raise expected(what, f"at most {size_of(most)} in memory", got, fix)


def budget() -> int:
    """The bytes that were given; else SHARE of those that this process may still take, by the system and by its control
    group.
    """
    if _given:
        return _given[0]
    free = [_available(), *(limit - used for limit, used in _groups())]
    return int(SHARE * max(min(free), 0))


def _available() -> int:
    """Free bytes as Linux or psutil tell; else those of the machine, or ASSUMED where nothing tells, as on Windows."""
    try:
        lines = Path("/proc/meminfo").read_text(encoding="ascii").splitlines()
        (line,) = (line for line in lines if line.startswith("MemAvailable:"))
        return int(line.split()[1]) << 10
    except (OSError, ValueError):
        pass
    try:
        import psutil

        return int(psutil.virtual_memory().available)
    except ImportError:
        pass
    try:
        return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    except (AttributeError, OSError, ValueError):
        return ASSUMED


def _groups() -> list[tuple[int, int]]:
    """Limit and use of the control group's memory, of either version."""
    found = []
    root = Path("/sys/fs/cgroup")
    for limit, used in (
        ("memory.max", "memory.current"),
        ("memory/memory.limit_in_bytes", "memory/memory.usage_in_bytes"),
    ):
        try:
            found.append((int((root / limit).read_text()), int((root / used).read_text())))
        except (OSError, ValueError):
            continue
    return found
