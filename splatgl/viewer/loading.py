"""Reads files in a worker thread, with typed results."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from splatgl.animation.movie import time_points
from splatgl.data.mesh import Mesh
from splatgl.data.scenes import SCENES
from splatgl.errors import InputError, MissingOption
from splatgl.planning.scene import MOST_LAYERS
from splatgl.readers import list_volumes
from splatgl.readers.remote import is_address
from splatgl.scene.meshes import MeshFile, Vectors, is_mesh, read_meshes, source_key
from splatgl.scene.open_scene import LayerSource, look_notes, open_layer, print_lines, series_look
from splatgl.scene.scene_file import SceneFile
from splatgl.scene.transfer_choice import FAINTLY, faint_share
from splatgl.splat.settings import Settings
from splatgl.transfer.label_detection import MASK
from splatgl.viewer.adaptive_quality import STRIDES
from splatgl.viewer.document import Document, styled_layers
from splatgl.viewer.files import Watch, grouped, watched_files
from splatgl.viewer.jobs import JobKind, Jobs
from splatgl.viewer.layer_splats import LayerSplats
from splatgl.viewer.state import FileOption, LayerStyle

if TYPE_CHECKING:
    from splatgl.transfer.transfer import Transfer
    from splatgl.viewer.state import History, State
    from splatgl.viewer.trackball import Pose

T = TypeVar("T")

# --- arrays and channels that a file offers ---------------------------------------------------------------------------

# options of `load` that choose one of several volumes of a file
CHOOSING = ("array", "channel")
# most bytes of a file that is read again to learn what else it holds
SMALL = 1 << 26
# how `splatgl info` marks volumes
MARK, BESIDE = "* ", "   "
EVERY = "all"


def open_document(scene: SceneFile) -> tuple[Document, tuple[FileOption, ...]]:
    """The document of a scene, and the options of its file. Where one must be chosen, the first value is."""
    document, scene, chosen = _read_first(scene, Document.open)
    names = {option.option for option in chosen}
    return document, (*chosen, *(other for other in _file_options(scene, document) if other.option not in names))


def _read_first(source: SceneFile, read: Callable[[SceneFile], T]) -> tuple[T, SceneFile, tuple[FileOption, ...]]:
    """Returned by `read` for a source that chooses the first of several volumes: the source, and its choices."""
    try:
        return read(source), source, ()
    except MissingOption as error:
        values = _values_of(source.volume, error)
        if error.option not in CHOOSING or not values or error.option in source.load:
            raise
        first = replace(source, load={**source.load, error.option: values[0][0]})
        found, first, others = _read_first(first, read)
        return found, first, (FileOption(error.option, values), *others)


def _file_options(scene: SceneFile, document: Document) -> tuple[FileOption, ...]:
    """Other arrays and channels of the file that are known without reading it."""
    if scene.volume in SCENES or is_address(scene.volume) or document.scene.vectors.show:
        return ()
    names = [layer.volume.name for layer in document.channels]
    options = {"array": _arrays(scene.volume)}
    if len(names) > 1 and scene.load.get("channel", EVERY) == EVERY:
        options["channel"] = ((EVERY, "together"), *((str(n), name) for n, name in enumerate(names)))
    path = Path(scene.volume)
    for option in CHOOSING:
        if option in scene.load and not options.get(option) and (path.is_dir() or path.stat().st_size <= SMALL):
            options[option] = _other_values(scene, option)
    return tuple(FileOption(option, values) for option, values in options.items() if len(values) > 1)


def _other_values(scene: SceneFile, option: str) -> tuple[tuple[str, str], ...]:
    """The values that a reader offers when the option is missing."""
    try:
        volume = SceneFile(scene.volume, {name: value for name, value in scene.load.items() if name != option}).open()
    except MissingOption as error:
        return _values_of(scene.volume, error) if error.option == option else ()
    except InputError:
        return ()
    if option == "channel" and len(volume.channels) > 1:
        return ((EVERY, "together"), *((str(n), channel.name) for n, channel in enumerate(volume.channels)))
    return ()


def _values_of(path: str, error: MissingOption) -> tuple[tuple[str, str], ...]:
    """The values that an error offers; for HDF5, datasets that may be volumes."""
    values = tuple((value, words) for value, words in error.choices if "…" not in value)
    return values or (_arrays(path) if error.option == "array" else ())


def _arrays(path: str) -> tuple[tuple[str, str], ...]:
    lines = [line.removeprefix(MARK).split(BESIDE, 1) for line in list_volumes(path) if line.startswith(MARK)]
    return tuple((name, words[0] if words else "") for name, *words in lines)


# --- results of the worker thread -------------------------------------------------------------------------------------

Reopen = Callable[[], SceneFile]


@dataclass(frozen=True, eq=False)
class OpenedFile:
    """A newly opened file. times: the scenes of its time points, or of the files opened with it. options: of the file.
    reopen: reads `path` again; None for the scene that the window was opened for. is_option: whether another array or
    channel of the same file was chosen. note: on samples that are missing. watch: its files as they were before they
    were read.
    """

    document: Document
    times: tuple[SceneFile, ...] = ()
    options: tuple[FileOption, ...] = ()
    reopen: Reopen | None = None
    path: str = ""
    is_option: bool = False
    note: str = ""
    watch: Watch | None = None


@dataclass(frozen=True, eq=False)
class AddedFiles:
    """Layers and meshes that are added to the document. read: data of the meshes, by `source_key`."""

    parts: tuple[tuple[LayerSplats, LayerStyle], ...]
    files: tuple[MeshFile, ...]
    read: dict[MeshFile, Mesh]

    def added_to(self, state: State, document: Document) -> tuple[State, Document]:
        """The state and the document with these; a mesh that is added again replaces its earlier one. Layers beyond
        MOST_LAYERS are hidden. A first layer becomes faint under segments, as under `--labels`.
        """
        share = self._faint_share(state, document)
        document, numbers = document.with_layers([layer for layer, _ in self.parts])
        names = ", ".join([*(layer.name for layer, _ in self.parts), *(file.name for file in self.files)])
        message = f"{names}: added to the picture; ctrl+z takes it away"
        message += f"; {document.names[0]} is faint, so that labels in it are seen" * (share < 1)
        styles = [replace(state.styles[0], opacity=state.styles[0].opacity * share), *state.styles[1:]]
        for number, (_, style) in zip(numbers, self.parts, strict=True):
            has_room = sum(other.is_shown for other in styles) < MOST_LAYERS
            if not has_room:
                message = f"{names}: added, but not all shown: a picture has {MOST_LAYERS} layers at most"
            styles.append(replace(style, number=number, visible=style.visible and has_room))
        kept = [file for file in state.mesh_files if source_key(file) not in self.read]
        selected = len(state.styles) if self.parts else state.selected
        changes: dict[str, Any] = {"styles": tuple(styles), "mesh_files": (*kept, *self.files), "selected": selected}
        return replace(state, **changes, message=message), document.with_meshes(self.read)

    def _faint_share(self, state: State, document: Document) -> float:
        """Factor of the opacity of the first layer by which segments in it are seen, also once it is edited."""
        first, segments = state.styles[0], [layer.scene for layer, style in self.parts if style.base.labels]
        plain = replace(document.scene, settings=state.settings, transfer={}, threshold=0.0, vectors=Vectors())
        layers = tuple(replace(segment, transfer={"only_labels": ()}) for segment in segments)
        return faint_share(replace(plain, layers=layers), document.volume, first.transfer)


@dataclass(frozen=True, eq=False)
class ReplacedDocument:
    """The document and its edits before another file was opened, which undo restores. files: as of `Files.shown`."""

    document: Document
    state: State
    history: History
    home: Pose
    bases: dict[int, Transfer]
    files: tuple[Any, ...]


# of a file that changed, or with finer voxels, the document; of a series, a time point and its number
Loaded = OpenedFile | Document | tuple[Document, int]


# --- files ------------------------------------------------------------------------------------------------------------

GONE = "is gone: its last picture stays"


class Files:
    """Reads files in the worker thread of `jobs`. watched: paths that are checked for changes, which `reopen` reads."""

    def __init__(self, jobs: Jobs, watched: tuple[str, ...], reopen: Reopen | None, now: float) -> None:
        self.jobs = jobs
        self.reopen, self.watch = reopen, Watch.of(watched, now) if watched else None
        # when the running job was submitted, and the file that is being opened
        self.begun = now
        self.opening = ""
        # the scenes of a series, and the number of the visible one
        self.times: tuple[SceneFile, ...] = ()
        self.time = 0
        # files of further time points whose notes are printed
        self.printed: set[str] = set()

    @property
    def busy(self) -> str | None:
        """The file that is being read, and for how long; None if none is."""
        name = self.jobs.busy
        return f"{name}, {time.monotonic() - self.begun:.0f} s" if name else None

    @property
    def shown(self) -> tuple[Any, ...]:
        """Time points of the open file, the visible one, and how the file is read again."""
        return self.times, self.time, self.reopen, self.watch

    def show_again(self, shown: tuple[Any, ...]) -> None:
        """Goes back to the previous document, as of `shown`; cancels reading."""
        self.cancel()
        self.times, self.time, self.reopen, self.watch = shown

    def open_scene(self, scene: SceneFile) -> None:
        """Opens the scene that the window was opened for."""
        self._open(Path(scene.volume).name, lambda: _opened(scene))

    def open(self, paths: Sequence[str], settings: Settings, empty: bool = False, are_layers: bool = False) -> None:
        """Opens other files: a volume with the current settings, or a scene file with its own. Several are a series, or
        layers of one scene; segmentations and meshes beside them are added to it. Meshes alone are added to the
        document, unless it is empty.
        """
        volumes, segmentations, surfaces = grouped(paths)
        meshes = [MeshFile(path) for path in surfaces]
        if meshes and not (volumes or empty):
            self.add(paths, SceneFile(paths[0], settings=settings))
            return
        path, added = (volumes[0], tuple(meshes)) if volumes else (meshes[0].file, tuple(meshes[1:]))
        layers = [*volumes[1:] * are_layers, *segmentations]
        volumes = volumes[:1] if are_layers else volumes

        def reopen() -> SceneFile:
            scene = SceneFile.from_toml(Path(path)) if path.endswith(".toml") else SceneFile(path, settings=settings)
            return replace(scene, meshes=(*scene.meshes, *added), layers=(*scene.layers, *map(_layer_file, layers)))

        def read() -> OpenedFile:
            scene = reopen()
            times = tuple(replace(scene, volume=volume) for volume in volumes) if len(volumes) > 1 else ()
            watch = Watch.of(watched_files(path, scene), time.monotonic())
            return replace(_opened(scene, times), reopen=reopen, path=path, watch=watch)

        self._open(Path(path).name, read)

    def add(self, paths: Sequence[str], scene: SceneFile) -> None:
        """Reads volumes and meshes that are added to the document of a scene."""
        meshes = tuple(MeshFile(path) for path in paths if is_mesh(path))

        def read() -> AddedFiles:
            open_it = partial(open_layer, scene=scene, is_quiet=False, has_times=True)
            sources = [_read_layer(path, open_it) for path in paths if not is_mesh(path)]
            parts = tuple(part for source in sources for part in styled_layers(source, scene.settings))
            for layer, _ in parts:
                layer.shell(STRIDES[-1])
            return AddedFiles(parts, meshes, read_meshes(meshes))

        name = f"reading {Path(paths[0]).name}"
        self._read(JobKind.ADD, name, read, name)

    def open_option(self, scene: SceneFile, option: str, value: str) -> None:
        """Opens another array or channel of the file of a scene."""
        # other samples have other values
        transfer = {name: entry for name, entry in scene.transfer.items() if name == "preset"}
        chosen = replace(scene, load={**scene.load, option: value}, transfer=transfer)

        def read() -> OpenedFile:
            watch = Watch.of(watched_files(scene.volume, chosen), time.monotonic())
            opened = _opened(chosen)
            return replace(opened, reopen=lambda: chosen, path=scene.volume, is_option=True, watch=watch)

        self._open(f"{option} {value}", read)

    def show_time(self, number: int) -> None:
        """Reads another time point, once no other job waits. Notes on a file are printed once."""
        if number != self.time and not self.jobs.busy:
            scene = self.times[number]
            # notes on the first are printed where it is opened
            quiet = scene.volume in {self.times[0].volume, *self.printed}
            self.printed.add(scene.volume)
            work = lambda: (Document.open(scene, quiet), number)  # noqa: E731
            self._read(JobKind.TIME_POINT, f"reading time {number}", work)

    def cancel(self) -> bool:
        """Abandons the running and waiting jobs; returns whether there were any."""
        busy = self.jobs.busy is not None
        if busy:
            # a thread cannot be ended: its result is dropped
            self.jobs, self.opening = Jobs(self.jobs.wake), ""
        return busy

    def refine(self, document: Document) -> None:
        """Reads the finer voxels of a document, if there are any."""
        if document.has_finer and not self.opening:
            self._read(JobKind.REFINE, "reading finer voxels", document.refined)

    def check(self, state: State, now: float) -> State:
        """Reloads the file if it has changed; returns the state with a message while it is missing."""
        # a change while another file is opened is detected afterwards
        if self.watch is None or self.opening:
            return state
        was_gone = self.watch.gone > 1
        self.watch, changed = self.watch.look(now)
        reopen = self.reopen
        if changed and reopen is not None:
            self._read(JobKind.RELOAD, "reading again", partial(_reloaded, reopen, self.times))
        if self.watch.missing and not was_gone:
            return replace(state, message=f"{self.watch.missing} {GONE}")
        if was_gone and not self.watch.gone and state.message.endswith(GONE):
            return replace(state, message="")
        return state

    def finish(self, kind: JobKind) -> None:
        """Notes that a job has ended; the next one may open a file of the same name."""
        if kind is JobKind.OPEN and JobKind.OPEN not in dict(self.jobs.all):
            self.opening = ""

    def follow(self, opened: OpenedFile) -> None:
        """Watches the newly opened file instead, if watching is on."""
        self.reopen = opened.reopen
        self.watch = opened.watch if self.watch is not None else None

    def _open(self, name: str, work: Callable[[], OpenedFile]) -> None:
        self.opening = name
        self._read(JobKind.OPEN, f"opening {name}", work)

    def _read(self, kind: JobKind, name: str, work: Callable[[], Loaded | AddedFiles], key: str = "") -> None:
        self.begun = time.monotonic()
        self.jobs.submit(kind, name, work, key)


def _layer_file(path: str) -> SceneFile:
    """A file that is opened as a layer of another volume: as labels, if it holds labels or a mask."""
    volume, source, _ = _read_first(SceneFile(path), SceneFile.open)
    are_labels = volume.labels is not None or volume.hints.values == MASK
    return replace(source, transfer={"only_labels": ()}) if are_labels else source


def _read_layer(path: str, open_it: Callable[[SceneFile], LayerSource]) -> LayerSource:
    """A file that is added as a layer. Beside other volumes, two values are a mask, and one of them a segment."""
    source = _read_first(SceneFile(path), open_it)[0]
    if source.volume.hints.values != MASK:
        return source
    return open_it(replace(source.file, transfer={"only_labels": ()}))


def _opened(scene: SceneFile, times: tuple[SceneFile, ...] = ()) -> OpenedFile:
    document, options = open_document(scene)
    # a choice for the file holds for every time point
    scene = replace(scene, load=document.scene.load) if len(document.channels) == 1 else scene
    times = times or tuple(time_points(scene, document.volume, None))
    if len(times) > 1:
        look = series_look(times)
        notes = look_notes(look, times)
        print_lines(notes, False)
        # opacities of all volumes refer to the length in the first
        pairs = zip(document.styles, document.layers, strict=True)
        styles = tuple(replace(style, base=style.base.on(layer.stored)) for style, layer in pairs)
        length = {} if document.volume.points is not None else {"unit": styles[0].base.unit}
        times = tuple(replace(point, look=look).with_transfer(length) for point in times)
        scene = replace(scene, look=look).with_transfer(length)
        document = Document.open(scene, quiet=True) if notes else replace(document, styles=styles)
    return OpenedFile(document, times if len(times) > 1 else (), options, note=_first_note(document))


def _reloaded(reopen: Reopen, times: tuple[SceneFile, ...]) -> Document:
    """The document of a file that changed, in the look of its series. times: the scenes of the time points before."""
    scene, files = reopen(), dict.fromkeys(point.volume for point in times)
    times = tuple(replace(scene, volume=file) for file in files) if len(files) > 1 else ()
    return _opened(scene, times).document


def _first_note(document: Document) -> str:
    """A note on samples of the first layer that are missing or constant, or on opacities that it lost to labels; "" for
    none.
    """
    share = document.volume.share_missing()
    if share == 1 and not is_mesh(document.scene.volume):
        return "nothing to show: all samples are NaN"
    if 0 < share < 1:
        return f"{100 * share:.3g} % of the samples are NaN, and not drawn"
    if FAINTLY in document.volume.notes:
        return f"{document.names[0]} is {FAINTLY}, or its opacity in the panel"
    return next((note for note in document.volume.notes if note.startswith("constant: ")), "")
