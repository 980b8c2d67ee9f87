"""`Recent`: the files that the user opened last; `Arrangement`: how the window was left."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from splatgl.data.scenes import SCENES
from splatgl.errors import InputError
from splatgl.fileio import write_file
from splatgl.platforms import user_folder

MOST_RECENT = 10
# environment variable that turns memory off, and its values that do
SWITCH, OFF = "SPLATGL_RECENT", ("", "0", "off", "no", "false")
# most bytes of a file that is read: larger ones are others
LARGEST = 1 << 20


@dataclass(frozen=True)
class Recent:
    """Recent files. paths: the latest first. file: that holds the list; None: no file does."""

    paths: tuple[str, ...] = ()
    file: Path | None = None

    @classmethod
    def of(cls, environment: Mapping[str, str]) -> Recent:
        """The list of the user; empty where it is turned off, or where there is no folder for it."""
        file = _state_file("recent.json", environment)
        return cls(_read_list(file), file) if file is not None else cls()

    def opened(self, path: str) -> Recent:
        """The list with a file that was opened, first; without built-in scenes and addresses, which may hold keys."""
        if self.file is None or not path or path in SCENES or "://" in path:
            return self
        # another window may have added some
        absolute = os.path.abspath(path)
        others = (other for other in _read_list(self.file) if other != absolute)
        return self._written((absolute, *others)[:MOST_RECENT])

    def forgotten(self) -> Recent:
        """The empty list."""
        return self._written(())

    def _written(self, paths: tuple[str, ...]) -> Recent:
        if self.file is not None:
            _write(self.file, paths)
        return replace(self, paths=paths)


# smallest and largest sides of a window that are remembered, screen units
SIDES = (64, 1 << 14)


@dataclass(frozen=True)
class Arrangement:
    """How the window stands. size: width and height, screen units; panel, slices: whether they are shown; theme: of
    the panel's THEMES; "": the first.
    """

    size: tuple[int, int] | None = None
    panel: bool = True
    slices: bool = False
    theme: str = ""

    @classmethod
    def of(cls, environment: Mapping[str, str]) -> Arrangement:
        """How the user left the latest window; the default where nothing is remembered or the file is damaged."""
        file = _state_file("window.json", environment)
        stored = _read_json(file) if file is not None else None
        if not isinstance(stored, dict):
            return cls()
        size, default = stored.get("size"), cls()
        if not (isinstance(size, list) and len(size) == 2 and all(_is_side(side) for side in size)):
            size = None
        kept: dict[str, Any] = {name: stored.get(name) for name in ("panel", "slices", "theme")}
        right = {name: value for name, value in kept.items() if type(value) is type(getattr(default, name))}
        return replace(default, size=tuple(size) if size else None, **right)

    def remember(self, environment: Mapping[str, str]) -> None:
        """Stores it for the next window, where there is a folder for it."""
        file = _state_file("window.json", environment)
        if file is not None and self != Arrangement.of(environment):
            _write(file, asdict(self))


def _is_side(value: object) -> bool:
    return type(value) is int and SIDES[0] <= value <= SIDES[1]


def _state_file(name: str, environment: Mapping[str, str]) -> Path | None:
    """A file of what is remembered; None where that is turned off, or where there is no folder for it."""
    folder = user_folder("state", environment)
    is_off = environment.get(SWITCH, "on").lower() in OFF
    return None if is_off or not folder.is_absolute() else folder / "splatgl" / name


def _write(file: Path, value: Any) -> None:
    """Writes a value as JSON, if that is possible."""
    with suppress(OSError, InputError):
        # other users must not read it
        file.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        write_file(file, json.dumps(value, indent=0).encode())


def _read_json(file: Path) -> Any:
    """The value in a file; None if it is missing, damaged or unreadable."""
    try:
        return json.loads(file.read_bytes()) if file.stat().st_size <= LARGEST else None
    except (OSError, ValueError, RecursionError):
        return None


def _read_list(file: Path) -> tuple[str, ...]:
    """The paths in a file; none if it is no list."""
    paths = _read_json(file)
    return tuple(path for path in paths if isinstance(path, str))[:MOST_RECENT] if isinstance(paths, list) else ()
