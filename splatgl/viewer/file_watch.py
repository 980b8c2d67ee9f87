"""`Watch`: tells when the files of a scene have changed."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path

from splatgl.data.scenes import SCENES
from splatgl.readers.remote import is_address
from splatgl.scene.scene_file import SceneFile


def watched_files(path: str, scene: SceneFile) -> tuple[str, ...]:
    """The files of the scene opened from `path`; empty for a built-in scene. What lies at an address is not watched."""
    files = dict.fromkeys((path, *scene.files))
    return tuple(file for file in files if file not in SCENES and not is_address(file))


# polling period in seconds
PERIOD = 1.0

Stamp = tuple[int, int] | None


@dataclass(frozen=True)
class Watch:
    """paths, and the last stamp seen of each: (mtime in ns, bytes), None for a missing file. gone: numbers of checks
    in a row that found one missing.
    """

    paths: tuple[Path, ...]
    seen: tuple[Stamp, ...]
    due: float
    gone: int = 0

    @classmethod
    def of(cls, paths: Iterable[str | Path], now: float) -> Watch:
        """Watches `paths` from their current stamps; the first check is due after PERIOD seconds."""
        found = tuple(Path(path) for path in paths)
        return cls(found, tuple(map(_stamp, found)), now + PERIOD)

    def look(self, now: float) -> tuple[Watch, bool]:
        """Checks the files if due; True if one changed and all exist: a file being replaced may be missing briefly."""
        if now < self.due:
            return self, False
        stamps = tuple(map(_stamp, self.paths))
        if None in stamps:
            return replace(self, due=now + PERIOD, gone=self.gone + 1), False
        return replace(self, seen=stamps, due=now + PERIOD, gone=0), stamps != self.seen

    @property
    def missing(self) -> str:
        """The name of a file that is missing for longer than a replacement takes; "" if none is."""
        absent = [path.name for path in self.paths if not path.exists()] if self.gone > 1 else []
        return absent[0] if absent else ""


def _stamp(path: Path) -> Stamp:
    try:
        found = path.stat()
    except OSError:
        return None
    return found.st_mtime_ns, found.st_size
