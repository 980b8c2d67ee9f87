"""Loading files: those dropped on the window, and reloading those that change while it is open."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from splatgl.animation.movie import by_numbers, time_points
from splatgl.app.viewer.choices import Pick, opened
from splatgl.app.viewer.content import Content
from splatgl.app.viewer.jobs import Jobs
from splatgl.app.viewer.parts import read as _read
from splatgl.app.viewer.watch import Watch
from splatgl.data.mesh import Mesh
from splatgl.data.scenes import SCENES
from splatgl.readers.remote import is_address
from splatgl.scene.meshes import MeshFile, is_mesh
from splatgl.scene.scene_file import Scene
from splatgl.splat.settings import Settings

if TYPE_CHECKING:
    from splatgl.app.viewer.state import State

GONE = "is gone: its last picture stays"
# what jobs begin with
OPENING, TIME = "opening", "reading time"
Reopen = Callable[[], Scene]


@dataclass(frozen=True, eq=False)
class News:
    """Content loaded by the worker thread. reopen: for a newly opened file, `path`, the function that reloads it.

    finer: whether it is a finer portion of a content with the same scene. times: of a newly opened file, the scenes of
    its time points, or of the files opened with it; time: the number of the one that this is. picks: what else the file
    holds; picked: whether this is what was picked of it. watch: its files as they were before they were read.
    """

    content: Content
    reopen: Reopen | None = None
    path: str = ""
    finer: bool = False
    times: tuple[Scene, ...] = ()
    time: int | None = None
    picks: tuple[Pick, ...] = ()
    picked: bool = False
    watch: Watch | None = None

    def stale(self, shown: Content) -> bool:
        """Whether this is a portion of what is no longer shown."""
        return self.finer and self.content.scene is not shown.scene


@dataclass(frozen=True, eq=False)
class Brought:
    """Meshes loaded by the worker thread, which join what is shown. read: by `bare`."""

    files: tuple[MeshFile, ...]
    read: dict[MeshFile, Mesh]


class Files:
    """Reads files in the worker thread of `jobs`, with News as results. watched: paths monitored for changes."""

    def __init__(self, jobs: Jobs, watched: tuple[str, ...], reopen: Reopen | None, now: float) -> None:
        self.jobs = jobs
        self.follow(watched, reopen, now)
        # when the files that are being read were asked for, and the one that nothing but another one replaces
        self.begun = now
        self.opening = ""
        # the scenes of a series, and the number of the one that is shown
        self.times: tuple[Scene, ...] = ()
        self.time = 0
        # files of further time points whose notes are printed
        self.told: set[str] = set()

    @property
    def busy(self) -> str | None:
        """What is being read, and for how long; None if nothing is."""
        what = self.jobs.busy
        return f"{what}, {time.monotonic() - self.begun:.0f} s" if what else None

    def follow(self, watched: tuple[str, ...], reopen: Reopen | None, now: float) -> None:
        """Watches these files, which `reopen` reads again."""
        self.reopen, self.watch = reopen, Watch.of(watched, now) if watched else None

    def begin(self, scene: Scene) -> None:
        """Opens the scene that the window was opened for."""
        self._open(Path(scene.volume).name, lambda: _opened(scene))

    def open(self, paths: Sequence[str], settings: Settings, empty: bool = False) -> None:
        """Opens another file: a volume with the current settings, a scene file with its own. Several are a series, and
        meshes beside them lie in their picture. Meshes alone are laid over what is shown; empty: where that is nothing.
        """
        meshes = [MeshFile(path) for path in paths if is_mesh(path)]
        named = sorted((path for path in paths if not is_mesh(path)), key=by_numbers)
        if meshes and not (named or empty):
            what = f"reading {Path(meshes[0].file).name}"
            self._read(what, lambda: Brought(tuple(meshes), _read(meshes)), what)
            return
        path, beside = (named[0], tuple(meshes)) if named else (meshes[0].file, tuple(meshes[1:]))

        def scene() -> Scene:
            found = Scene.from_toml(Path(path)) if path.endswith(".toml") else Scene(path, settings=settings)
            return replace(found, meshes=(*found.meshes, *beside))

        def read() -> News:
            found = scene()
            times = tuple(replace(found, volume=each) for each in named) if len(named) > 1 else ()
            watch = Watch.of(watched(path, found), time.monotonic())
            return replace(_opened(found, times), reopen=scene, path=path, watch=watch)

        self._open(Path(path).name, read)

    def pick(self, scene: Scene, option: str, value: str) -> None:
        """Opens what else the file of a scene holds."""
        read = replace(scene, load={**scene.load, option: value})
        # other samples have other values
        read = replace(read, transfer={name: each for name, each in read.transfer.items() if name == "preset"})

        def found() -> News:
            watch = Watch.of(watched(scene.volume, read), time.monotonic())
            return replace(_opened(read), reopen=lambda: read, path=scene.volume, picked=True, watch=watch)

        self._open(f"{option} {value}", found)

    def show_time(self, number: int) -> None:
        """Reads another time point, once what is being read is there. Notes on a file are printed once."""
        if number != self.time and not self.jobs.busy:
            scene = self.times[number]
            # the first one's are printed where it is opened
            quiet = scene.volume in {self.times[0].volume, *self.told}
            self.told.add(scene.volume)
            self._read(f"{TIME} {number}", lambda: News(Content.open(scene, quiet), time=number), TIME)

    def cancel(self) -> bool:
        """Gives up what is being read; whether there was anything."""
        found = self.jobs.busy is not None
        if found:
            # a thread cannot be ended: what it reads is dropped
            self.jobs, self.opening = Jobs(self.jobs.wake), ""
        return found

    def refine(self, content: Content) -> None:
        """Reads the finer portion of what a content shows, if there is one."""
        if content.portion and content.portion.finer and not self.opening:
            self._read("reading finer voxels", lambda: News(content.finer(), finer=True), "finer")

    def look(self, state: State, now: float) -> State:
        """Reloads the file if it has changed; returns the state with what there is to say."""
        # a change meanwhile is seen afterwards, of the file that is shown by then
        if self.watch is None or self.opening:
            return state
        gone = self.watch.gone > 1
        self.watch, changed = self.watch.look(now)
        reopen = self.reopen
        if changed and reopen is not None:
            self._read("reading again", lambda: News(opened(reopen())[0]), "again")
        if self.watch.missing and not gone:
            return replace(state, message=f"{self.watch.missing} {GONE}")
        if gone and not self.watch.gone and state.message.endswith(GONE):
            return replace(state, message="")
        return state

    def finished(self, name: str) -> None:
        """Notes that a job has ended; one that waits may open a file of the same name."""
        if name.startswith(f"{OPENING} ") and not any(each.startswith(f"{OPENING} ") for each in self.jobs.names):
            self.opening = ""

    def turn_to(self, news: News) -> None:
        """Watches the newly opened file instead, if watching is on."""
        self.reopen = news.reopen
        if self.watch is not None:
            self.watch = news.watch

    def _open(self, what: str, work: Callable[[], News]) -> None:
        self.opening = what
        self._read(f"{OPENING} {what}", work, OPENING)

    def _read(self, what: str, work: Callable[[], News | Brought], kind: str) -> None:
        self.begun = time.monotonic()
        self.jobs.submit(what, work, kind)


def _opened(scene: Scene, times: tuple[Scene, ...] = ()) -> News:
    content, picks = opened(scene)
    # what has to be picked of the file is picked of every time point
    scene = replace(scene, load=content.scene.load) if len(content.channels) == 1 else scene
    found = times or tuple(time_points(scene, content.volume, None))
    return News(content, times=found if len(found) > 1 else (), picks=picks)


def watched(path: str, scene: Scene) -> tuple[str, ...]:
    """The files of the scene opened from `path`; empty for a built-in scene. What lies at an address is not watched."""
    files = dict.fromkeys((path, *scene.files))
    return tuple(file for file in files if file not in SCENES and not is_address(file))
