"""Formats, file targets and commands of other packages: entry points of the groups `splatgl.readers`, `splatgl.writers`
and `splatgl.commands`.
"""

from __future__ import annotations

from functools import cache
from importlib import import_module
from typing import Any

from splatgl.errors import one_line, warn


@cache
def load_plugins(group: str, kind: type, name: str | None = None) -> tuple[Any, ...]:
    """The objects of a kind to which the entry points of splatgl.`group` lead, or those of a name. Warns of others, and
    of those that cannot be imported: a faulty package does not stop what needs none of it.
    """
    from importlib.metadata import entry_points

    found, faults = [], []
    for entry in entry_points(group=f"splatgl.{group}"):
        if name not in (None, entry.name):
            continue
        try:
            value = entry.load()
        except Exception as error:
            faults.append(f"{entry.value}: cannot be imported: {one_line(error)}")
            continue
        if isinstance(value, kind):
            found.append(value)
        else:
            faults.append(f"{entry.value}: expected a {kind.__name__}, got a {type(value).__name__}")
    warn(faults, f"plug-in of splatgl.{group}")
    return tuple(found)


def find_function(place: Any, package: str) -> Any:
    """The function at module.function of a package of splatgl, or at PACKAGE.MODULE:FUNCTION of any; a function stays.
    It is imported now, so that a table of functions imports none of them.
    """
    if callable(place):
        return place
    module, _, name = place.rpartition(":") if ":" in place else f"{package}.{place}".rpartition(".")
    return getattr(import_module(module), name)
