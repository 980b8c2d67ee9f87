"""Whether files changed: their times and sizes, asked for now and then."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path

# seconds between two looks
PERIOD = 1.0

Stamp = tuple[int, int] | None


@dataclass(frozen=True)
class Watch:
    """paths and what was last seen of them: (mtime in ns, bytes), None for a file that is not there."""

    paths: tuple[Path, ...]
    seen: tuple[Stamp, ...]
    due: float

    @classmethod
    def of(cls, paths: Iterable[str | Path], now: float) -> Watch:
        """Watches `paths` as they are now, the first look due after PERIOD seconds."""
        found = tuple(Path(path) for path in paths)
        return cls(found, tuple(map(_stamp, found)), now + PERIOD)

    def look(self, now: float) -> tuple[Watch, bool]:
        """After a look, if one is due: whether a file changed and is there (one being replaced is waited for)."""
        if now < self.due:
            return self, False
        stamps = tuple(map(_stamp, self.paths))
        if None in stamps:
            return replace(self, due=now + PERIOD), False
        return replace(self, seen=stamps, due=now + PERIOD), stamps != self.seen


def _stamp(path: Path) -> Stamp:
    try:
        found = path.stat()
    except OSError:
        return None
    return found.st_mtime_ns, found.st_size
