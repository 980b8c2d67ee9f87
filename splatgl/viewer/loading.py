"""Opens and remembers files, and applies the results of background jobs to the viewer."""

from __future__ import annotations

import json
import os
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from math import prod
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from splatgl.animation.movie import by_numbers, time_points
from splatgl.data.mesh import Mesh
from splatgl.data.scenes import SCENES
from splatgl.errors import USER_ERRORS, Choice, InputError, error_text
from splatgl.fileio import write_file
from splatgl.readers import list_volumes, load
from splatgl.readers.remote import is_address
from splatgl.scene.meshes import MeshFile, is_mesh
from splatgl.scene.scene_file import SceneFile
from splatgl.splat.settings import Settings
from splatgl.viewer.document import Document, Together, read_meshes, source_key
from splatgl.viewer.file_watch import Watch, watched
from splatgl.viewer.jobs import Done, Jobs
from splatgl.viewer.state import FileOption

if TYPE_CHECKING:
    from splatgl.splat.transfer import Transfer
    from splatgl.viewer.state import State
    from splatgl.viewer.viewer import Viewer


def arrived(viewer: Viewer, done: Done) -> None:
    """Handles a finished job; bad input only sets the message, or closes a window that has nothing to show."""
    viewer.refresh()
    viewer.files.finished(done.name)
    if isinstance(done.error, USER_ERRORS):
        viewer.say(error_text(done.error), done.name.split()[0])
        if viewer.document.waiting:
            viewer.failed, viewer.closed = done.error, True
        elif done.name.startswith(TIME):
            # the slider goes back to what is shown
            viewer.state = replace(viewer.state, time=viewer.files.time, playing=False)
        elif done.name.startswith(OPENING):
            # which waited for what was to be opened
            viewer.files.refine(viewer.document)
    elif done.error is not None:
        raise done.error
    elif isinstance(done.result, Brought):
        _brought(viewer, done.result)
    elif not isinstance(done.result, News):
        viewer.over(done.name.split()[0])
        viewer.refiner.renew(viewer.document.counts, prod(viewer.size))
        # all time points have the view of the first
        if viewer.state.pose is viewer.home and viewer.document.whole and viewer.files.time == 0:
            _fit(viewer)
    elif not done.result.stale(viewer.document):
        _apply_opened(viewer, done.result)


def _apply_opened(viewer: Viewer, news: News) -> None:
    """Takes a loaded file; a reloaded one keeps its view unless its scene file changed, a time point keeps all."""
    document, shown = news.document, viewer.document
    for what in () if news.finer else ("opening", "reading"):
        viewer.over(what)
    if news.reopen is not None or shown.waiting:
        viewer.recent = viewer.recent.opened(news.path or viewer.options.source)
    if news.reopen is not None:
        viewer.files.turn_to(news)
    elif not shown.waiting and isinstance(shown, Together) and shown.read:
        # meshes that were laid over what is shown meanwhile
        own = document.read if isinstance(document, Together) else {}
        document = Together.with_meshes(document, {**shown.read, **own})
    if news.time is not None:
        viewer.files.time = news.time
    elif not news.finer:
        viewer.files.times, viewer.files.time = news.times or viewer.files.times, 0
    if news.time is None and (news.reopen is not None or shown.waiting or document.scene != shown.scene):
        viewer.files.times = news.times
        before = viewer.state.pose
        viewer.state = replace(viewer.state.opened(document), times=len(news.times), picks=news.picks)
        viewer.home = viewer.state.pose
        if news.picked and np.array_equal(document.volume.corners, shown.volume.corners):
            viewer.state = replace(viewer.state, pose=before)
        viewer.history.begin(viewer.state)
        # what is kept for pictures of the file before would stay as long as the window
        viewer.renderer.free()
    elif news.time is None and _bases(viewer.state) == _bases(shown):
        _based(viewer, document)
        viewer.state = replace(viewer.state, message="")
    elif len(document.looks) != len(viewer.state.looks):
        _based(viewer, document)
    viewer.take(document)
    viewer.files.refine(document)
    viewer.hands.touch()


def _based(viewer: Viewer, document: Document) -> None:
    """Takes the transfer functions of a document, and forgets the steps of others, if it has other channels."""
    edited, count = viewer.history.unsaved(viewer.state), len(viewer.state.looks)
    viewer.state = viewer.state.based_on(document)
    if len(document.looks) != count:
        viewer.history.forget(viewer.state)
    if not edited:
        viewer.history.keep(viewer.state)


def _bases(x: State | Document) -> list[Transfer]:
    return [look.base for look in x.looks]


def _brought(viewer: Viewer, brought: Brought) -> None:
    """Lays meshes over what is shown, which is edited meanwhile; undoing it takes them away again."""
    viewer.history.note(viewer.state)
    viewer.take(Together.with_meshes(viewer.document, brought.read))
    names = ", ".join(Path(each.file).name for each in brought.files)
    # a file that is dropped again takes the place of the one before
    kept = [each for each in viewer.state.meshes if source_key(each) not in brought.read]
    viewer.state = viewer.state.joined((*kept, *brought.files), f"{names} lies in the picture; ctrl+z takes it away")
    viewer.hands.touch()


def _fit(viewer: Viewer) -> None:
    """Fits a view that nobody has changed to the finest splats, as `splatgl render` does."""
    home = viewer.document.home(viewer.size)
    if home.view() == viewer.home.view():
        return
    viewer.home = home
    viewer.state = replace(viewer.state, pose=viewer.home)
    if not viewer.history.past and not viewer.history.unsaved(viewer.state):
        viewer.history.begin(viewer.state)


# options of `load` that pick one of what a file holds
PICKING = ("array", "channel")
# bytes of a file that is read again to learn what else it holds, at most
SMALL = 1 << 26
# what `splatgl info` marks volumes with
MARK, BESIDE = "* ", "   "
EVERY = "all"


def opened(scene: SceneFile) -> tuple[Document, tuple[FileOption, ...]]:
    """The document of a scene, and what of its file can be picked. Where one has to be, that is the first."""
    try:
        document = Document.open(scene)
    except Choice as error:
        found = _found(scene.volume, error)
        if error.option not in PICKING or not found or error.option in scene.load:
            raise
        pick = FileOption(error.option, found)
        document, others = opened(replace(scene, load={**scene.load, pick.option: found[0][0]}))
        return document, (pick, *(each for each in others if each.option != pick.option))
    return document, _picks(scene, document)


def _picks(scene: SceneFile, document: Document) -> tuple[FileOption, ...]:
    """What else could have been read, as far as that is told at once."""
    if scene.volume in SCENES or is_address(scene.volume) or document.scene.vectors.show:
        return ()
    names = [part.volume.name for part in document.channels]
    found = {"array": _listed(scene.volume)}
    if len(names) > 1 and scene.load.get("channel", EVERY) == EVERY:
        found["channel"] = ((EVERY, "together"), *((str(n), name) for n, name in enumerate(names)))
    for option in PICKING:
        path = Path(scene.volume)
        if option in scene.load and not found.get(option) and (path.is_dir() or path.stat().st_size <= SMALL):
            found[option] = _without(scene, option)
    return tuple(FileOption(option, choices) for option, choices in found.items() if len(choices) > 1)


def _without(scene: SceneFile, option: str) -> tuple[tuple[str, str], ...]:
    """What a reader offers where an option is not given."""
    try:
        volume = load(scene.volume, **{name: value for name, value in scene.load.items() if name != option})
    except Choice as error:
        return _found(scene.volume, error) if error.option == option else ()
    except InputError:
        return ()
    if option == "channel" and len(volume.channels) > 1:
        return ((EVERY, "together"), *((str(n), each.name) for n, each in enumerate(volume.channels)))
    return ()


def _found(path: str, error: Choice) -> tuple[tuple[str, str], ...]:
    """What there is to pick from; of HDF5, datasets that may be volumes."""
    given = [(value, words) for value, words in error.found if "…" not in value]
    return tuple(given) or (_listed(path) if error.option == "array" else ())


def _listed(path: str) -> tuple[tuple[str, str], ...]:
    lines = [line.removeprefix(MARK).split(BESIDE, 1) for line in list_volumes(path) if line.startswith(MARK)]
    return tuple((name, words[0] if words else "") for name, *words in lines)


GONE = "is gone: its last picture stays"
# what jobs begin with
OPENING, TIME = "opening", "reading time"
Reopen = Callable[[], SceneFile]


@dataclass(frozen=True, eq=False)
class News:
    """Document loaded by the worker thread. reopen: for a newly opened file, `path`, the function that reloads it.

    finer: whether it is a finer portion of a document with the same scene. times: of a newly opened file, the scenes of
    its time points, or of the files opened with it; time: the number of the one that this is. picks: what else the file
    holds; picked: whether this is what was picked of it. watch: its files as they were before they were read.
    """

    document: Document
    reopen: Reopen | None = None
    path: str = ""
    finer: bool = False
    times: tuple[SceneFile, ...] = ()
    time: int | None = None
    picks: tuple[FileOption, ...] = ()
    picked: bool = False
    watch: Watch | None = None

    def stale(self, shown: Document) -> bool:
        """Whether this is a portion of what is no longer shown."""
        return self.finer and self.document.scene is not shown.scene


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
        self.times: tuple[SceneFile, ...] = ()
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

    def begin(self, scene: SceneFile) -> None:
        """Opens the scene that the window was opened for."""
        self._open(Path(scene.volume).name, lambda: _opened_news(scene))

    def open(self, paths: Sequence[str], settings: Settings, empty: bool = False) -> None:
        """Opens another file: a volume with the current settings, a scene file with its own. Several are a series, and
        meshes beside them lie in their picture. Meshes alone are laid over what is shown; empty: where that is nothing.
        """
        meshes = [MeshFile(path) for path in paths if is_mesh(path)]
        named = sorted((path for path in paths if not is_mesh(path)), key=by_numbers)
        if meshes and not (named or empty):
            what = f"reading {Path(meshes[0].file).name}"
            self._read(what, lambda: Brought(tuple(meshes), read_meshes(meshes)), what)
            return
        path, beside = (named[0], tuple(meshes)) if named else (meshes[0].file, tuple(meshes[1:]))

        def scene() -> SceneFile:
            found = SceneFile.from_toml(Path(path)) if path.endswith(".toml") else SceneFile(path, settings=settings)
            return replace(found, meshes=(*found.meshes, *beside))

        def read() -> News:
            found = scene()
            times = tuple(replace(found, volume=each) for each in named) if len(named) > 1 else ()
            watch = Watch.of(watched(path, found), time.monotonic())
            return replace(_opened_news(found, times), reopen=scene, path=path, watch=watch)

        self._open(Path(path).name, read)

    def pick(self, scene: SceneFile, option: str, value: str) -> None:
        """Opens what else the file of a scene holds."""
        read = replace(scene, load={**scene.load, option: value})
        # other samples have other values
        read = replace(read, transfer={name: each for name, each in read.transfer.items() if name == "preset"})

        def found() -> News:
            watch = Watch.of(watched(scene.volume, read), time.monotonic())
            return replace(_opened_news(read), reopen=lambda: read, path=scene.volume, picked=True, watch=watch)

        self._open(f"{option} {value}", found)

    def show_time(self, number: int) -> None:
        """Reads another time point, once what is being read is there. Notes on a file are printed once."""
        if number != self.time and not self.jobs.busy:
            scene = self.times[number]
            # the first one's are printed where it is opened
            quiet = scene.volume in {self.times[0].volume, *self.told}
            self.told.add(scene.volume)
            self._read(f"{TIME} {number}", lambda: News(Document.open(scene, quiet), time=number), TIME)

    def cancel(self) -> bool:
        """Gives up what is being read; whether there was anything."""
        found = self.jobs.busy is not None
        if found:
            # a thread cannot be ended: what it reads is dropped
            self.jobs, self.opening = Jobs(self.jobs.wake), ""
        return found

    def refine(self, document: Document) -> None:
        """Reads the finer portion of what a document shows, if there is one."""
        if document.portion and document.portion.finer and not self.opening:
            self._read("reading finer voxels", lambda: News(document.finer(), finer=True), "finer")

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


def _opened_news(scene: SceneFile, times: tuple[SceneFile, ...] = ()) -> News:
    document, picks = opened(scene)
    # what has to be picked of the file is picked of every time point
    scene = replace(scene, load=document.scene.load) if len(document.channels) == 1 else scene
    found = times or tuple(time_points(scene, document.volume, None))
    return News(document, times=found if len(found) > 1 else (), picks=picks)


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
            write_file(self.file, json.dumps(self.paths, indent=0).encode())


def _read(file: Path) -> tuple[str, ...]:
    """What a file lists; nothing of one that is missing, damaged or not to be read."""
    try:
        if file.stat().st_size > LARGEST:
            return ()
        found = json.loads(file.read_bytes())
    except (OSError, ValueError, RecursionError):
        return ()
    return tuple(each for each in found if isinstance(each, str))[:MOST] if isinstance(found, list) else ()
