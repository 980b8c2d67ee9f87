"""`Watch`: detects changes of the files of a scene."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path

from splatgl.data.scenes import SCENES
from splatgl.readers.remote import is_address
from splatgl.scene.scene_file import SceneFile


def watched_files(path: str, scene: SceneFile) -> tuple[str, ...]:
    """The local files of the scene opened from `path`; none for a built-in scene."""
    files = dict.fromkeys((path, *scene.files))
    return tuple(file for file in files if file not in SCENES and not is_address(file))


# polling period in seconds
PERIOD = 1.0

Stamp = tuple[int, int] | None


@dataclass(frozen=True)
class Watch:
    """seen: the last stamp of each path: (mtime in ns, bytes), None for a missing file. gone: number of consecutive
    checks with a missing file.
    """

    paths: tuple[Path, ...]
    seen: tuple[Stamp, ...]
    due: float
    gone: int = 0

    @classmethod
    def of(cls, paths: Iterable[str | Path], now: float) -> Watch:
        """Watches `paths` from their current stamps; the first check is due after PERIOD seconds."""
        files = tuple(Path(path) for path in paths)
        return cls(files, tuple(map(_stamp, files)), now + PERIOD)

    def look(self, now: float) -> tuple[Watch, bool]:
        """Checks the files if due; True if one changed and all exist: a file may be missing while it is replaced."""
        if now < self.due:
            return self, False
        stamps = tuple(map(_stamp, self.paths))
        if None in stamps:
            return replace(self, due=now + PERIOD, gone=self.gone + 1), False
        return replace(self, seen=stamps, due=now + PERIOD, gone=0), stamps != self.seen

    @property
    def missing(self) -> str:
        """Name of a file that is missing for longer than a replacement takes; "" if none is."""
        absent = [path.name for path in self.paths if not path.exists()] if self.gone > 1 else []
        return absent[0] if absent else ""


def _stamp(path: Path) -> Stamp:
    try:
        status = path.stat()
    except OSError:
        return None
    return status.st_mtime_ns, status.st_size
