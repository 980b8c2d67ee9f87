"""Loading files: those dropped on the window, and reloading those that change while it is open."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from splatgl.app.scene import Scene
from splatgl.app.viewer.content import Content
from splatgl.app.viewer.jobs import Jobs
from splatgl.app.viewer.state import State
from splatgl.app.viewer.watch import Watch
from splatgl.data.scenes import SCENES
from splatgl.splat.plan.settings import Settings

Reopen = Callable[[], Scene]


@dataclass(frozen=True, eq=False)
class News:
    """Content loaded by the worker thread. reopen: for a newly opened file, `path`, the function that reloads it.

    finer: whether it is a finer portion of a content with the same scene.
    """

    content: Content
    reopen: Reopen | None = None
    path: str = ""
    finer: bool = False

    def stale(self, shown: Content) -> bool:
        """Whether this is a portion of what is no longer shown."""
        return self.finer and self.content.scene is not shown.scene


class Files:
    """Reads files in the worker thread of `jobs`, with News as results. watched: paths monitored for changes."""

    def __init__(self, jobs: Jobs, watched: tuple[str, ...], reopen: Reopen | None, now: float) -> None:
        self.jobs, self.reopen = jobs, reopen
        self.watch = Watch.of(watched, now) if watched else None
        # when the files that are being read were asked for, and the one that nothing but another one replaces
        self.begun = now
        self.opening = ""

    @property
    def busy(self) -> str | None:
        """What is being read, and for how long; None if nothing is."""
        what = self.jobs.busy
        return f"{what}, {time.monotonic() - self.begun:.0f} s" if what else None

    def open(self, paths: list[str], settings: Settings) -> None:
        """Opens another file: a volume with the current settings, a scene file with its own."""
        path = paths[0]

        def scene() -> Scene:
            return Scene.from_toml(Path(path)) if path.endswith(".toml") else Scene(path, settings=settings)

        self.opening = path
        self._read(f"opening {Path(path).name}", lambda: News(Content.open(scene()), scene, path))

    def refine(self, content: Content) -> None:
        """Reads the finer portion of what a content shows, if there is one."""
        if content.portion and content.portion.finer and not self.opening:
            self._read("reading finer voxels", lambda: News(content.finer(), finer=True))

    def look(self, state: State, now: float) -> State:
        """Reloads the file if it has changed; returns the state with what there is to say."""
        if self.watch is None:
            return state
        missing = self.watch.missing
        self.watch, changed = self.watch.look(now)
        reopen = self.reopen
        if changed and reopen is not None and not self.opening:
            self._read("reading again", lambda: News(Content.open(reopen())))
        if self.watch.missing and not missing:
            return replace(state, message=f"{self.watch.missing} is gone: its last picture stays")
        if missing and not self.watch.missing:
            return replace(state, message="")
        return state

    def finished(self, name: str) -> None:
        """Notes that a job has ended."""
        if name == f"opening {Path(self.opening).name}":
            self.opening = ""

    def turn_to(self, news: News, now: float) -> None:
        """Watches the newly opened file instead, if watching is on."""
        self.reopen = news.reopen
        if self.watch is not None:
            self.watch = Watch.of(watched(news.path, news.content.scene), now)

    def _read(self, what: str, work: Callable[[], News]) -> None:
        self.begun = time.monotonic()
        self.jobs.submit(what, work)


def watched(path: str, scene: Scene) -> tuple[str, ...]:
    """The files of the scene opened from `path`; empty for a built-in scene."""
    return tuple(dict.fromkeys(file for file in (path, scene.volume) if file not in SCENES))
