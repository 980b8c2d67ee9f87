"""`Performer`: performs the effects of commands on a window, and applies what its worker threads have finished."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from importlib.util import find_spec
from math import prod
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from splatgl.animation.animation import MOVIES
from splatgl.data.image import Image
from splatgl.errors import USER_ERRORS, error_text, missing_extra
from splatgl.fileio import budget
from splatgl.viewer import commands
from splatgl.viewer.commands import Add, Copy, CopyText, Effect, Leave, Open, OpenOption, Request
from splatgl.viewer.document import Document
from splatgl.viewer.files import ADD, OPEN, SAVE, Dialogs
from splatgl.viewer.jobs import Done, Kind
from splatgl.viewer.loading import Left, Loaded, Opened
from splatgl.viewer.movie_track import stop_preview
from splatgl.viewer.recorder import movie_command, movie_scene
from splatgl.viewer.saving import (
    compose_screenshot,
    copy_text,
    free_path,
    is_scene_name,
    save_as,
    save_picture,
    save_scene,
    try_save,
)
from splatgl.viewer.state import History, stated_transfers

if TYPE_CHECKING:
    from splatgl.viewer.viewer import Viewer

# topics of messages, which are cleared once the topic is over
OPENING, READING, EXTRACTING, PICTURE, COUNT = "opening", "reading", "extracting", "picture", "count"
UNSAVED = "edits are not saved: shift+s saves the scene; quit again to leave without"
CHANGED = "the scene file has changed: ctrl+z brings the edits back"
RECORDING = "a movie is recorded; quit again to cancel it"
TOPICS = {Kind.OPEN: OPENING, Kind.EXTRACT: EXTRACTING}


class Performer:
    """Performs effects, and applies finished jobs, on the document and the state of a window."""

    def __init__(self, viewer: Viewer) -> None:
        self.viewer, self.dialogs = viewer, Dialogs()
        # what was shown before the document was opened, and after it was left by undo
        self.before: Left | None = None
        self.after: Left | None = None
        # whether the next request to quit is obeyed although edits are lost
        self.warned = False

    # --- effects ----------------------------------------------------------------------------------------------------

    def perform(self) -> None:
        """Performs the effects of commands, and opens or saves what was chosen in a dialog."""
        viewer = self.viewer
        effects, viewer.effects = viewer.effects, []
        for effect in effects:
            self.perform_one(effect)
        chosen = self.dialogs.take(viewer.panel and viewer.panel.panel.browser)
        if chosen and self.dialogs.kind != SAVE:
            self.perform_one((Open if self.dialogs.kind == OPEN else Add)(tuple(chosen)))
        elif chosen and Path(chosen[0]).suffix.lower() in MOVIES:
            self._record(Path(chosen[0]))
        elif chosen:
            times, path = viewer.files.times, Path(chosen[0])
            args = viewer.state, viewer.document, viewer.renderer.render, path, self._composed, times
            self._save(path.name, partial(save_as, *args), is_scene_name(path))
        if viewer.files.times and not viewer.dirty:
            viewer.files.show_time(viewer.state.time)
        if viewer.window.closing and Request.QUIT not in effects:
            self._quit()
        if viewer.state.message not in (UNSAVED, RECORDING):
            self.warned = False

    def perform_one(self, effect: Effect) -> None:
        """Performs one effect of a command."""
        viewer, folder = self.viewer, self.viewer.options.folder
        match effect:
            case Request.UNDO | Request.REDO:
                self._step(effect is Request.UNDO)
            case Request.CANCEL:
                self._cancel()
            case Request.SAVE_PICTURE:
                args = viewer.state, viewer.document, viewer.renderer.render, folder, self._composed
                self._save("picture", partial(save_picture, *args), False)
            case Request.SAVE_SCENE:
                self._save(
                    "scene", partial(save_scene, viewer.state, viewer.document, viewer.renderer.render, folder), True
                )
            case Request.SAVE_AS:
                self._open_dialog(SAVE, folder, free_path(folder, "scene", ".toml").name)
            case Copy():
                viewer.window.copy(copy_text(effect, viewer.state, viewer.document))
                viewer.say(f"{effect.value} copied: it draws this picture")
            case CopyText(text):
                viewer.window.copy(text)
            case Open(()) | Add(()):
                source = Path(viewer.document.scene.volume)
                folder = source.parent if source.exists() else Path()
                self._open_dialog(OPEN if isinstance(effect, Open) else ADD, folder, "")
            case Open(paths):
                viewer.open(paths)
            case Add(paths):
                # scissors that were drawn meanwhile cut them, too
                viewer.files.add(paths, replace(viewer.document.scene, scissors=viewer.state.styles[0].scissors))
            case OpenOption():
                if not viewer.asks_to_leave(effect):
                    self._replace(effect)
            case Leave(opens, saves):
                if saves:
                    self.perform_one(Request.SAVE_SCENE)
                if not (saves and viewer.history.has_unsaved_edits(viewer.state)):
                    self._replace(opens)
            case Request.RECORD:
                self._record(free_path(folder, "movie", viewer.state.movie.form))
            case Request.RECORD_AS:
                form = viewer.state.movie.form or MOVIES[0]
                self._open_dialog(SAVE, folder, free_path(folder, "movie", form).name)
            case Request.CANCEL_RECORDING:
                viewer.say("nothing is recorded" if not viewer.recorder.cancel() else "the recording is cancelled")
            case Request.COPY_MOVIE:
                self._copy_movie()
            case Request.FORGET_RECENT:
                viewer.recent = viewer.recent.forgotten()
            case Request.PALETTE | Request.FOCUS:
                self._reach_panel(effect)
            case Request.SAVE_AND_QUIT:
                self.perform_one(Request.SAVE_SCENE)
                viewer.closed = not viewer.history.has_unsaved_edits(viewer.state)
            case Request.DISCARD:
                viewer.closed = True
            case Request.QUIT:
                self._quit()

    def _replace(self, opens: Open | OpenOption) -> None:
        """Opens other files, or another part of the file, whatever is not saved."""
        viewer, state = self.viewer, self.viewer.state
        if isinstance(opens, Open):
            viewer.files.open(opens.paths, state.settings, True)
            return
        changes: dict[str, Any] = {"settings": state.settings, "annotate": state.annotate, "meshes": state.mesh_files}
        viewer.files.open_option(replace(viewer.document.scene, **changes), opens.option, opens.value)

    def _step(self, is_undo: bool) -> None:
        """Undoes or redoes a step; of the first, or last, of a document, shows the document before, or after, it."""
        viewer, history = self.viewer, self.viewer.history
        history.note(viewer.state)
        left = self.before if is_undo else self.after
        if left is None or (history.past if is_undo else history.future):
            viewer.state = (history.undo if is_undo else history.redo)(viewer.state)
        else:
            here = self._leave()
            self.before, self.after = (None, here) if is_undo else (here, None)
            viewer.files.show_again(left.files)
            viewer.history, viewer.home, viewer.bases = left.history, left.home, left.bases
            message = f"{left.document.volume.name or left.document.scene.volume} is shown again"
            viewer.state = replace(viewer.state.kept_in(left.state), message=message)
            viewer.history.resume(viewer.state)
            viewer.take(left.document)
            viewer.renderer.free()
            viewer.files.refine(left.document)
        viewer.touch()

    def _leave(self) -> Left:
        """The document and its edits, for undo after another file was opened."""
        viewer = self.viewer
        viewer.history.note(viewer.state)
        state = replace(viewer.state, pinned=None, preview=None)
        return Left(viewer.document.coarse(), state, viewer.history, viewer.home, viewer.bases, viewer.files.shown)

    def _reach_panel(self, effect: Request) -> None:
        """Opens the list of commands, or gives the keys to the panel, or back to the picture."""
        viewer = self.viewer
        if effect is Request.FOCUS:
            viewer.state = replace(viewer.state, panel=True)
        if viewer.panel is None:
            viewer.open_panel()
        if viewer.panel is None:
            return
        if effect is Request.PALETTE:
            viewer.panel.panel.palette.open()
        else:
            viewer.panel.focus()
        viewer.refresh()

    def _record(self, target: Path) -> None:
        """Begins a movie of the state, or says why it cannot be drawn."""
        viewer = self.viewer
        try:
            scene, more = movie_scene(stop_preview(viewer.state), viewer.document, viewer.files.times)
            viewer.recorder.start(scene, more, target)
        except USER_ERRORS as error:
            viewer.say(error_text(error))

    def _copy_movie(self) -> None:
        viewer = self.viewer
        try:
            viewer.window.copy(movie_command(stop_preview(viewer.state), viewer.document, viewer.files.times))
            viewer.say("command copied: it draws this movie")
        except USER_ERRORS as error:
            viewer.say(error_text(error))

    def _save(self, name: str, save: Any, is_scene: bool) -> None:
        """Saves, and shows the message. name: of what is saved; is_scene: whether edits are saved by it."""
        viewer = self.viewer
        viewer.say(f"saving {name}")
        viewer.show()
        message, done = try_save(save)
        viewer.say(message if done else "")
        if not done:
            viewer.tell_error(message)
        elif is_scene:
            viewer.history.mark_saved(viewer.state)

    def _composed(self, image: Image) -> Image:
        """The picture with the slices of the window and the one beside it. Raises InputError for unreadable slices."""
        viewer, slices = self.viewer, None
        if viewer.slices.panes(viewer.state, viewer.document, viewer.view):
            marks = viewer.slices.complete_marks(viewer.state, viewer.document, viewer.view)
            viewer.screen.draw(viewer.drawn_size, viewer.painter.look(viewer.state, viewer.reference))
            viewer.screen.mark(viewer.window.size, marks)
            slices = np.asarray(viewer.screen.read(viewer.window.size)[:, viewer.shown_size[0] : viewer.view.size[0]])
            # the next frame has the panel again
            viewer.refresh()
        draw, scale = viewer.renderer.render, viewer.window.scale
        return compose_screenshot(image, viewer.state, viewer.document, draw, scale, slices)

    def _open_dialog(self, kind: str, folder: Path, name: str) -> None:
        if find_spec("imgui_bundle"):
            self.dialogs.open(kind, folder.resolve(), name, self._browser)
        else:
            self.viewer.say(str(missing_extra("the file dialog", "imgui-bundle", "gui")))

    def _browser(self) -> Any:
        """Opens the panel, which draws the file dialog."""
        viewer = self.viewer
        viewer.state = replace(viewer.state, panel=True)
        if viewer.panel is None:
            viewer.open_panel()
        return viewer.panel.panel.browser

    def _cancel(self) -> None:
        """Abandons what is being read; closes a window that has nothing to show."""
        viewer, opening = self.viewer, self.viewer.files.opening
        if viewer.files.cancel():
            viewer.closed |= viewer.document.is_loading
            viewer.state = replace(viewer.state, time=viewer.files.time)
            if opening:
                # finer voxels waited for it
                viewer.files.refine(viewer.document)

    def _quit(self) -> None:
        """Closes the window; asks first, or waits for a second request, if edits would be lost."""
        viewer = self.viewer
        is_edited, is_recording = viewer.history.has_unsaved_edits(viewer.state), viewer.recorder.running is not None
        if not (is_edited or is_recording) or self.warned:
            viewer.closed = True
            return
        self.warned = True
        viewer.window.stay()
        if not is_edited:
            viewer.say(RECORDING)
        elif viewer.panel is None:
            viewer.say(UNSAVED)
        else:
            viewer.panel.panel.questions.ask(commands.UNSAVED)
            viewer.refresh()

    # --- results of worker threads ----------------------------------------------------------------------------------

    def collect(self) -> None:
        """Takes the results of the worker threads."""
        viewer = self.viewer
        for done in (*viewer.files.jobs.collect(), *viewer.extractor.collect()):
            self.apply(done)
        notes = viewer.slices.collect()
        for note in notes or ():
            viewer.say(note)
        if viewer.reference.collect() or notes is not None:
            viewer.refresh()

    def apply(self, done: Done) -> None:
        """Applies a finished job. Bad input only sets the message, or closes a window that has nothing to show."""
        viewer = self.viewer
        viewer.refresh()
        viewer.files.finish(done.kind)
        if done.error is not None:
            self._apply_error(done.kind, done.error)
            return
        match done.kind:
            case Kind.ADD:
                viewer.history.note(viewer.state)
                viewer.state, document = done.value.added_to(viewer.state, viewer.document)
                state = viewer.state
                viewer.take(document)
                viewer.files.refine(document.with_styles(state.styles, state.mesh_files, state.settings))
                viewer.touch()
            case Kind.EXTRACT:
                viewer.clear_message(EXTRACTING)
                viewer.refiner.renew(viewer.document.counts, prod(viewer.size))
                # all time points have the view of the first
                if viewer.state.pose is viewer.home and 1 in viewer.document.extracted and viewer.files.time == 0:
                    self._fit_home()
            case Kind.REFINE if done.value.scene is not viewer.document.scene:
                # of a document that is no longer shown
                pass
            case _:
                self._apply_loaded(done.kind, done.value)

    def _apply_error(self, kind: Kind, error: BaseException) -> None:
        viewer = self.viewer
        if not isinstance(error, USER_ERRORS):
            raise error
        tell = viewer.say if kind in (Kind.EXTRACT, Kind.RELOAD) else viewer.tell_error
        tell(error_text(error), TOPICS.get(kind, READING))
        if viewer.document.is_loading:
            viewer.failed, viewer.closed = error, True
        elif kind is Kind.TIME_POINT:
            # the slider goes back to the visible time point
            viewer.state = replace(viewer.state, time=viewer.files.time, playing=False)
        elif kind is Kind.OPEN:
            # finer voxels waited for the file
            viewer.files.refine(viewer.document)

    def _apply_loaded(self, kind: Kind, loaded: Loaded) -> None:
        """Shows a loaded file. A reloaded one keeps its view unless its scene file changed; a time point keeps all."""
        viewer, shown = self.viewer, self.viewer.document
        if kind is not Kind.REFINE:
            viewer.clear_message(OPENING)
            viewer.clear_message(READING)
        if isinstance(loaded, Opened):
            document = loaded.document
            viewer.recent = viewer.recent.opened(loaded.path or viewer.options.source)
            self._begin(loaded)
            if loaded.reopen is not None:
                viewer.files.follow(loaded)
        else:
            document, number = loaded if isinstance(loaded, tuple) else (loaded, 0)
            document, is_reloaded = document.with_additions(shown), kind is not Kind.TIME_POINT
            if kind is not Kind.REFINE:
                viewer.files.time = number
            if is_reloaded and not document.is_described_as(shown):
                is_edited = viewer.history.has_unsaved_edits(viewer.state)
                self._begin(Opened(document))
                is_kept = is_edited and self.before is not None
                viewer.state = replace(viewer.state, message=CHANGED if is_kept else "")
            elif (is_reloaded or document.scene.look) and viewer.bases == stated_transfers(viewer.state.styles):
                # the segments of time points are their own
                self._rebase(document)
                viewer.state = replace(viewer.state, message="" if is_reloaded else viewer.state.message)
            elif document.file_numbers != shown.file_numbers:
                self._rebase(document)
        viewer.take(document)
        viewer.files.refine(document)
        viewer.touch()

    def _begin(self, opened: Opened) -> None:
        """Starts with the state of another document; undo shows the one before, unless it takes too much memory."""
        viewer = self.viewer
        document, before = opened.document, viewer.state.pose
        is_kept = not viewer.document.is_loading and viewer.document.bytes <= budget()
        self.before, self.after = self._leave() if is_kept else None, None
        viewer.history = History(viewer.state)
        viewer.files.times, viewer.files.time = opened.times, 0
        changes: dict[str, Any] = {"times": len(opened.times), "file_options": opened.options, "message": opened.note}
        viewer.state = replace(viewer.state.opened(document), **changes)
        viewer.home, viewer.bases = viewer.state.pose, stated_transfers(document.styles)
        if opened.is_option and np.array_equal(document.volume.corners, viewer.document.volume.corners):
            viewer.state = replace(viewer.state, pose=before)
        viewer.history.begin(viewer.state)
        # buffers for the file before would stay as long as the window
        viewer.renderer.free()

    def _rebase(self, document: Document) -> None:
        """Takes the transfer functions of a document; drops the history if it has other layers."""
        viewer = self.viewer
        edited = viewer.history.has_unsaved_edits(viewer.state)
        is_same = document.file_numbers == viewer.document.file_numbers
        viewer.state, viewer.bases = viewer.state.with_bases(document, is_same), stated_transfers(document.styles)
        if not is_same:
            viewer.history.forget(viewer.state)
        if not edited:
            viewer.history.mark_saved(viewer.state)

    def _fit_home(self) -> None:
        """Fits a view that nobody has changed to the finest splats, as `splatgl render` does."""
        viewer = self.viewer
        home = viewer.document.home(viewer.size)
        if home.view() != viewer.home.view():
            viewer.home = home
            viewer.state = replace(viewer.state, pose=home)
            if not viewer.history.past and not viewer.history.has_unsaved_edits(viewer.state):
                viewer.history.begin(viewer.state)
