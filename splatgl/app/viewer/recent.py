"""Files that were opened lately: their paths and no more, in the user's folder of states (XDG)."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

from splatgl.data.scenes import SCENES
from splatgl.errors import InputError
from splatgl.fileio import write_whole

MOST = 10
# the environment's switch, and the values that turn the list off
SWITCH, OFF = "SPLATGL_RECENT", ("", "0", "off", "no", "false")
# bytes of a list that is read: larger ones are no such list
LARGEST = 1 << 20


@dataclass(frozen=True)
class Recent:
    """paths: the latest first. file: where they are kept; None: nowhere."""

    paths: tuple[str, ...] = ()
    file: Path | None = None

    @classmethod
    def of(cls, environment: Mapping[str, str]) -> Recent:
        """Those of the user; none where they are switched off, or where there is no folder for them."""
        if environment.get(SWITCH, "on").lower() in OFF:
            return cls()
        folder = Path(environment.get("XDG_STATE_HOME", ""))
        if not folder.is_absolute():
            home = environment.get("HOME", "") or os.path.expanduser("~")
            folder = Path(home) / ".local" / "state"
        if not folder.is_absolute():
            return cls()
        file = folder / "splatgl" / "recent.json"
        return cls(_read(file), file)

    def opened(self, path: str) -> Recent:
        """With a file that was opened, first. Built-in scenes, addresses (which may hold keys) are not kept."""
        if self.file is None or not path or path in SCENES or "://" in path:
            return self
        # another window may have added some
        absolute = os.path.abspath(path)
        found = replace(self, paths=(absolute, *(each for each in _read(self.file) if each != absolute))[:MOST])
        found._write()
        return found

    def forgotten(self) -> Recent:
        """Without any."""
        found = replace(self, paths=())
        found._write()
        return found

    def _write(self) -> None:
        if self.file is None:
            return
        with suppress(OSError, InputError):
            # others have no business with them
            self.file.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
            write_whole(self.file, json.dumps(self.paths, indent=0).encode())


def _read(file: Path) -> tuple[str, ...]:
    """What a file lists; nothing of one that is missing, damaged or not to be read."""
    try:
        if file.stat().st_size > LARGEST:
            return ()
        found = json.loads(file.read_bytes())
    except (OSError, ValueError, RecursionError):
        return ()
    return tuple(each for each in found if isinstance(each, str))[:MOST] if isinstance(found, list) else ()
