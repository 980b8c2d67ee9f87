"""What the window shows comes from files: those that are dropped on it, and those that change while it is open."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from splatgl.app.scene import Scene
from splatgl.app.viewer.content import Content
from splatgl.app.viewer.jobs import Jobs
from splatgl.app.viewer.watch import Watch
from splatgl.data.scenes import SCENES
from splatgl.splat.plan.settings import Settings

Reopen = Callable[[], Scene]


@dataclass(frozen=True, eq=False)
class News:
    """A content that a thread has read. reopen: it is another file, `path`, and is read again so."""

    content: Content
    reopen: Reopen | None = None
    path: str = ""


class Files:
    """Reads files in the thread of some jobs, whose results are News. watched: paths looked at for changes."""

    def __init__(self, jobs: Jobs, watched: tuple[str, ...], reopen: Reopen | None, now: float) -> None:
        self.jobs, self.reopen = jobs, reopen
        self.watch = Watch.of(watched, now) if watched else None

    def open(self, path: str, settings: Settings) -> None:
        """Reads another file; a volume is drawn as the last one was, a scene as it says."""

        def scene() -> Scene:
            return Scene.from_toml(Path(path)) if path.endswith(".toml") else Scene(path, settings=settings)

        self.jobs.submit(f"opening {Path(path).name}", lambda: News(Content.open(scene()), scene, path))

    def look(self, now: float) -> None:
        """Reads the file again if it has changed."""
        if self.watch is None:
            return
        self.watch, changed = self.watch.look(now)
        reopen = self.reopen
        if changed and reopen is not None:
            self.jobs.submit("reading again", lambda: News(Content.open(reopen())))

    def turn_to(self, news: News, now: float) -> None:
        """Watches another file from now on, if any is watched."""
        self.reopen = news.reopen
        if self.watch is not None:
            self.watch = Watch.of(watched(news.path, news.content.scene), now)


def watched(path: str, scene: Scene) -> tuple[str, ...]:
    """The files that a scene is made of, of which `path` was opened; a built-in one has none."""
    return tuple(dict.fromkeys(file for file in (path, scene.volume) if file not in SCENES))
