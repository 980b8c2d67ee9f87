"""`Recent`: the files that the user opened last."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

from splatgl.data.scenes import SCENES
from splatgl.errors import InputError
from splatgl.fileio import write_file
from splatgl.platforms import user_folder

MOST_RECENT = 10
# environment variable that turns the list off, and its values that do
SWITCH, OFF = "SPLATGL_RECENT", ("", "0", "off", "no", "false")
# most bytes of a list that is read: larger files are no such list
LARGEST = 1 << 20


@dataclass(frozen=True)
class Recent:
    """Recent files. paths: the latest first. file: that holds the list; None: no file does."""

    paths: tuple[str, ...] = ()
    file: Path | None = None

    @classmethod
    def of(cls, environment: Mapping[str, str]) -> Recent:
        """The list of the user; empty where it is turned off, or where there is no folder for it."""
        if environment.get(SWITCH, "on").lower() in OFF:
            return cls()
        folder = user_folder("state", environment)
        if not folder.is_absolute():
            return cls()
        file = folder / "splatgl" / "recent.json"
        return cls(_read_list(file), file)

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
            with suppress(OSError, InputError):
                # other users must not read it
                self.file.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
                write_file(self.file, json.dumps(paths, indent=0).encode())
        return replace(self, paths=paths)


def _read_list(file: Path) -> tuple[str, ...]:
    """The paths in a file; none if it is missing, damaged or unreadable."""
    try:
        if file.stat().st_size > LARGEST:
            return ()
        paths = json.loads(file.read_bytes())
    except (OSError, ValueError, RecursionError):
        return ()
    return tuple(path for path in paths if isinstance(path, str))[:MOST_RECENT] if isinstance(paths, list) else ()
