"""`Viewer`: the event loop of the window. It alone holds what changes; other modules compute the next values."""

from __future__ import annotations

import time
from dataclasses import replace
from functools import partial
from importlib.util import find_spec
from math import prod
from pathlib import Path
from typing import Any

import numpy as np

from splatgl.animation.animation import MOVIES
from splatgl.data.image import Image
from splatgl.errors import USER_ERRORS, error_text, missing_extra
from splatgl.fileio import budget
from splatgl.viewer import questions
from splatgl.viewer.adaptive_quality import REST, STEP
from splatgl.viewer.commands import Add, Copy, CopyText, Effect, Leave, Open, OpenOption, Request
from splatgl.viewer.display import EXTRACTING, OPENING, READING
from splatgl.viewer.document import Document
from splatgl.viewer.file_dialogs import ADD, OPEN, SAVE
from splatgl.viewer.jobs import Done, Kind
from splatgl.viewer.live_view import LiveView
from splatgl.viewer.loading import Added, Left, Loaded, Opened, Reloaded, TimePoint
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
from splatgl.viewer.state import History, played, stated_transfers
from splatgl.viewer.trackball import up_direction

# automatic rotation in degrees per second
SPEED = 30.0
# maximum seconds to wait for events when idle: bounds the response to Ctrl-C
IDLE = 0.25
UNSAVED = "edits are not saved: shift+s saves the scene; quit again to leave without"
CHANGED = "the scene file has changed: ctrl+z brings the edits back"
RECORDING = "a movie is recorded; quit again to cancel it"
TOPICS = {Kind.OPEN: OPENING, Kind.EXTRACT: EXTRACTING}


class Viewer(LiveView):
    """Shows one document at a time. `step()` runs one iteration of the event loop; `run()` loops until closed."""

    # what was shown before the document was opened, and after it was left by undo
    before: Left | None = None
    after: Left | None = None

    # --- the loop ---------------------------------------------------------------------------------------------------

    def run(self) -> None:
        """Runs `step()` until the window is closed."""
        while not self.closed:
            self.step()
        if self.failed is not None:
            raise self.failed

    def step(self, wait: float | None = None) -> None:
        """Handles events and finished jobs, renders a frame if one is due, and displays it. wait: maximum seconds."""
        self.window.wait(self._patience() if wait is None else wait)
        begun = time.perf_counter()
        self.window.fill(self.state.fullscreen)
        self._collect()
        self._advance()
        # saved pictures have the size of the window, and frames that of what was opened and toggled
        self._fill()
        self._perform()
        if self.closed or min(self.window.size) < 1:
            return
        self._fill()
        level = self._draw()
        self._compare()
        self._show()
        if level is None and self.panel is not None and not self.dirty:
            gallery = self.panel.panel.gallery
            if gallery.render_next(self.renderer, self.state.pose, self.screen.ctx):
                self.refresh()
        if level is not None and self.painter.frame is not None:
            picture, whole = self.painter.frame.seconds, time.perf_counter() - begun
            self.painter.whole = whole
            self.refiner.took(level, picture, whole - picture)

    def close(self) -> None:
        """Frees the window and its resources, but not the renderer."""
        self.closed = True
        if not self.window.errors.message:
            self.remember()
        self.dialogs.close()
        self.recorder.cancel()
        self.reference.forget()
        self.extractor.wanted = None
        self.trim.close()
        if self.panel is not None:
            self.panel.close()
        self.screen.close()
        self.window.errors.close()

    def _patience(self) -> float:
        """Seconds to wait for events; a held button defers the full-quality frame."""
        if self.dirty or self.effects:
            return 0.0
        if self.state.gliding:
            return max(0.0, self.ticked + STEP - self.now())
        if self.state.playing and self.files.times and not self.files.jobs.busy:
            return max(0.0, self.played + 1 / self.state.pace - self.now())
        moment = self._moment()
        due = self.refiner.patience(self.wanted(), moment)
        if not moment.whole:
            due = min(IDLE if due is None else due, max(0.0, REST - moment.idle) or IDLE)
        due = IDLE if due is None or (due == 0.0 and moment.held) else due
        return max(0.0, min(due, IDLE, self.panel.tooltip_at - self.now() if self.panel else IDLE))

    def _advance(self) -> None:
        """Advances rotation, previews, time series and recordings; at rest, records a step of the history and frees
        unused memory.
        """
        now, state = self.now(), self.files.check(self.state, self.now())
        if state.turning:
            state = replace(state, pose=state.pose.spun(SPEED * (now - self.ticked), up_direction(self.document)))
            self.touched = now
        if state.preview is not None:
            state = state.preview.show(state, now - self.ticked)
            self.touched = now
        shown = self.files.time == state.time and not self.files.jobs.busy and not self.dirty
        if state.playing and self.files.times and shown and now - self.played >= 1 / state.pace:
            state = played(state)
            self.played = now
        self.state, self.ticked = state, now
        if self.panel is not None and self.panel.tooltip_is_due(now):
            self.refresh()
        progressed, message = self.recorder.look()
        if message:
            self.say(message)
        elif progressed:
            self.refresh()
        # the panel handles one event a frame: it may not know yet that a button was released
        is_held = self.window.held or (self.panel is not None and self.panel.held)
        resting = now - self.touched >= REST and not is_held
        if resting and not self.effects:
            self.history.note(state)
        self.trim.look(self.painter.frame, resting, now)

    def _fill(self) -> None:
        """Fits the picture into the window."""
        if self.state.pose.camera.size != self.size:
            self.resize(self.window.size)

    # --- effects ----------------------------------------------------------------------------------------------------

    def _perform(self) -> None:
        """Performs the effects of commands, and opens or saves what was chosen in a dialog."""
        effects, self.effects = self.effects, []
        for effect in effects:
            self._perform_one(effect)
        chosen = self.dialogs.take(self.panel and self.panel.panel.browser)
        if chosen and self.dialogs.kind != SAVE:
            self._perform_one((Open if self.dialogs.kind == OPEN else Add)(tuple(chosen)))
        elif chosen and Path(chosen[0]).suffix.lower() in MOVIES:
            self._record(Path(chosen[0]))
        elif chosen:
            times, path = self.files.times, Path(chosen[0])
            args = self.state, self.document, self.renderer.render, path, self._composed, times
            self._save(path.name, partial(save_as, *args), is_scene_name(path))
        if self.files.times and not self.dirty:
            self.files.show_time(self.state.time)
        if self.window.closing and Request.QUIT not in effects:
            self._quit()
        if self.state.message not in (UNSAVED, RECORDING):
            self.warned = False

    def _perform_one(self, effect: Effect) -> None:
        draw, folder = self.renderer.render, self.options.folder
        match effect:
            case Request.UNDO | Request.REDO:
                self._step(effect is Request.UNDO)
            case Request.CANCEL:
                self._cancel()
            case Request.SAVE_PICTURE:
                args = self.state, self.document, draw, folder, self._composed
                self._save("picture", partial(save_picture, *args), False)
            case Request.SAVE_SCENE:
                self._save("scene", partial(save_scene, self.state, self.document, draw, folder), True)
            case Request.SAVE_AS:
                self._open_dialog(SAVE, folder, free_path(folder, "scene", ".toml").name)
            case Copy():
                self.window.copy(copy_text(effect, self.state, self.document))
                self.say(f"{effect.value} copied: it draws this picture")
            case CopyText(text):
                self.window.copy(text)
            case Open(()) | Add(()):
                source = Path(self.document.scene.volume)
                kind = OPEN if isinstance(effect, Open) else ADD
                self._open_dialog(kind, source.parent if source.exists() else Path(), "")
            case Open(paths):
                self.open(paths)
            case Add(paths):
                # scissors that were drawn meanwhile cut them, too
                self.files.add(paths, replace(self.document.scene, scissors=self.state.styles[0].scissors))
            case OpenOption():
                if not self.asks_to_leave(effect):
                    self._replace(effect)
            case Leave(opens, saves):
                if saves:
                    self._perform_one(Request.SAVE_SCENE)
                if not (saves and self.history.has_unsaved_edits(self.state)):
                    self._replace(opens)
            case Request.RECORD:
                self._record(free_path(folder, "movie", self.state.movie.form))
            case Request.RECORD_AS:
                name = free_path(folder, "movie", self.state.movie.form or MOVIES[0]).name
                self._open_dialog(SAVE, folder, name)
            case Request.CANCEL_RECORDING:
                self.say("nothing is recorded" if not self.recorder.cancel() else "the recording is cancelled")
            case Request.COPY_MOVIE:
                try:
                    self.window.copy(movie_command(stop_preview(self.state), self.document, self.files.times))
                    self.say("command copied: it draws this movie")
                except USER_ERRORS as error:
                    self.say(error_text(error))
            case Request.FORGET_RECENT:
                self.recent = self.recent.forgotten()
            case Request.PALETTE | Request.FOCUS:
                self._reach_panel(effect)
            case Request.SAVE_AND_QUIT:
                self._save("scene", partial(save_scene, self.state, self.document, draw, folder), True)
                self.closed = not self.history.has_unsaved_edits(self.state)
            case Request.DISCARD:
                self.closed = True
            case Request.QUIT:
                self._quit()

    def _replace(self, opens: Open | OpenOption) -> None:
        """Opens other files, or another part of the file, whatever is not saved."""
        state = self.state
        if isinstance(opens, Open):
            self.files.open(opens.paths, state.settings, True)
            return
        scene = replace(self.document.scene, settings=state.settings, annotate=state.annotate, meshes=state.mesh_files)
        self.files.open_option(scene, opens.option, opens.value)

    def _step(self, is_undo: bool) -> None:
        """Undoes or redoes a step; of the first, or last, of a document, shows the document before, or after, it."""
        history = self.history
        history.note(self.state)
        left = self.before if is_undo else self.after
        if left is None or (history.past if is_undo else history.future):
            self.state = (history.undo if is_undo else history.redo)(self.state)
        else:
            here = self._leave()
            self.before, self.after = (None, here) if is_undo else (here, None)
            self.files.show_again(left.files)
            self.history, self.home, self.bases = left.history, left.home, left.bases
            message = f"{left.document.volume.name or left.document.scene.volume} is shown again"
            self.state = replace(self.state.kept_in(left.state), message=message)
            self.history.resume(self.state)
            self._take(left.document)
            self.renderer.free()
            self.files.refine(left.document)
        self.touch()

    def _leave(self) -> Left:
        """The document and its edits, for undo after another file was opened."""
        self.history.note(self.state)
        state = replace(self.state, pinned=None, preview=None)
        return Left(self.document.coarse(), state, self.history, self.home, self.bases, self.files.shown)

    def _reach_panel(self, effect: Request) -> None:
        """Opens the list of commands, or gives the keys to the panel, or back to the picture."""
        if effect is Request.FOCUS:
            self.state = replace(self.state, panel=True)
        if self.panel is None:
            self._open_panel()
        if self.panel is None:
            return
        if effect is Request.PALETTE:
            self.panel.panel.palette.open()
        else:
            self.panel.focus()
        self.refresh()

    def _record(self, target: Path) -> None:
        """Begins a movie of the state, or says why it cannot be drawn."""
        try:
            scene, more = movie_scene(stop_preview(self.state), self.document, self.files.times)
            self.recorder.start(scene, more, target)
        except USER_ERRORS as error:
            self.say(error_text(error))

    def _save(self, name: str, save: Any, is_scene: bool) -> None:
        """Saves, and shows the message. name: of what is saved; is_scene: whether edits are saved by it."""
        self.say(f"saving {name}")
        self._show()
        message, done = try_save(save)
        self.say(message if done else "")
        if not done:
            self.tell_error(message)
        elif is_scene:
            self.history.mark_saved(self.state)

    def _composed(self, image: Image) -> Image:
        """The picture with the slices of the window and the one beside it. Raises InputError for unreadable slices."""
        slices = None
        if self.slices.panes(self.state, self.document, self.view):
            marks = self.slices.complete_marks(self.state, self.document, self.view)
            self.screen.draw(self._drawn_size, self.painter.look(self.state, self.reference))
            self.screen.mark(self.window.size, marks)
            slices = np.asarray(self.screen.read(self.window.size)[:, self.shown_size[0] : self.view.size[0]])
            # the next frame has the panel again
            self.refresh()
        return compose_screenshot(image, self.state, self.document, self.renderer.render, self.window.scale, slices)

    def _open_dialog(self, kind: str, folder: Path, name: str) -> None:
        if find_spec("imgui_bundle"):
            self.dialogs.open(kind, folder.resolve(), name, self._browser)
        else:
            self.say(str(missing_extra("the file dialog", "imgui-bundle", "gui")))

    def _browser(self) -> Any:
        """Opens the panel, which draws the file dialog."""
        self.state = replace(self.state, panel=True)
        if self.panel is None:
            self._open_panel()
        return self.panel.panel.browser

    def _cancel(self) -> None:
        """Abandons what is being read; closes a window that has nothing to show."""
        opening = self.files.opening
        if self.files.cancel():
            self.closed |= self.document.is_loading
            self.state = replace(self.state, time=self.files.time)
            if opening:
                # finer voxels waited for it
                self.files.refine(self.document)

    def _quit(self) -> None:
        """Closes the window; asks first, or waits for a second request, if edits would be lost."""
        is_edited, is_recording = self.history.has_unsaved_edits(self.state), self.recorder.running is not None
        if not (is_edited or is_recording) or self.warned:
            self.closed = True
            return
        self.warned = True
        self.window.stay()
        if not is_edited:
            self.say(RECORDING)
        elif self.panel is None:
            self.say(UNSAVED)
        else:
            self.panel.panel.questions.ask(questions.UNSAVED)
            self.refresh()

    # --- results of worker threads ----------------------------------------------------------------------------------

    def _collect(self) -> None:
        """Takes the results of the worker threads."""
        for done in (*self.files.jobs.collect(), *self.extractor.collect()):
            self.apply(done)
        notes = self.slices.collect()
        for note in notes or ():
            self.say(note)
        if self.reference.collect() or notes is not None:
            self.refresh()

    def apply(self, done: Done) -> None:
        """Applies a finished job. Bad input only sets the message, or closes a window that has nothing to show."""
        self.refresh()
        self.files.finish(done.kind)
        if done.error is not None:
            self._apply_error(done.kind, done.error)
            return
        match done.value:
            case Added():
                self.history.note(self.state)
                self.state, document = done.value.added_to(self.state, self.document)
                self._take(document)
                self.files.refine(document.with_styles(self.state.styles, self.state.mesh_files, self.state.settings))
                self.touch()
            case Reloaded() if done.value.is_outdated(self.document):
                pass
            case Opened() | Reloaded() | TimePoint():
                self._apply_loaded(done.value)
            case _:
                self.clear_message(EXTRACTING)
                self.refiner.renew(self.document.counts, prod(self.size))
                # all time points have the view of the first
                if self.state.pose is self.home and self.document.has_full_resolution and self.files.time == 0:
                    self._fit_home()

    def _apply_error(self, kind: Kind, error: BaseException) -> None:
        if not isinstance(error, USER_ERRORS):
            raise error
        tell = self.say if kind in (Kind.EXTRACT, Kind.RELOAD) else self.tell_error
        tell(error_text(error), TOPICS.get(kind, READING))
        if self.document.is_loading:
            self.failed, self.closed = error, True
        elif kind is Kind.TIME_POINT:
            # the slider goes back to the visible time point
            self.state = replace(self.state, time=self.files.time, playing=False)
        elif kind is Kind.OPEN:
            # finer voxels waited for the file
            self.files.refine(self.document)

    def _apply_loaded(self, loaded: Loaded) -> None:
        """Shows a loaded file. A reloaded one keeps its view unless its scene file changed; a time point keeps all."""
        document, shown = loaded.document, self.document
        if not (isinstance(loaded, Reloaded) and loaded.is_finer):
            self.clear_message(OPENING)
            self.clear_message(READING)
        if isinstance(loaded, Opened):
            self.recent = self.recent.opened(loaded.path or self.options.source)
            self._begin(loaded)
            if loaded.reopen is not None:
                self.files.follow(loaded)
        else:
            document = document.with_additions(shown)
            if isinstance(loaded, TimePoint):
                self.files.time = loaded.number
            elif not loaded.is_finer:
                self.files.time = 0
            is_reloaded = isinstance(loaded, Reloaded)
            if is_reloaded and not document.is_described_as(shown):
                is_edited = self.history.has_unsaved_edits(self.state)
                self._begin(Opened(document))
                is_kept = is_edited and self.before is not None
                self.state = replace(self.state, message=CHANGED if is_kept else "")
            elif (is_reloaded or document.scene.look) and self.bases == stated_transfers(self.state.styles):
                # the segments of time points are their own
                self._rebase(document)
                self.state = replace(self.state, message="" if is_reloaded else self.state.message)
            elif document.file_numbers != shown.file_numbers:
                self._rebase(document)
        self._take(document)
        self.files.refine(document)
        self.touch()

    def _begin(self, opened: Opened) -> None:
        """Starts with the state of another document; undo shows the one before, unless it takes too much memory."""
        document, before = opened.document, self.state.pose
        is_kept = not self.document.is_loading and self.document.bytes <= budget()
        self.before, self.after = self._leave() if is_kept else None, None
        self.history = History(self.state)
        self.files.times, self.files.time = opened.times, 0
        changes: dict[str, Any] = {"times": len(opened.times), "file_options": opened.options, "message": opened.note}
        self.state = replace(self.state.opened(document), **changes)
        self.home, self.bases = self.state.pose, stated_transfers(document.styles)
        if opened.is_option and np.array_equal(document.volume.corners, self.document.volume.corners):
            self.state = replace(self.state, pose=before)
        self.history.begin(self.state)
        # buffers for the file before would stay as long as the window
        self.renderer.free()

    def _rebase(self, document: Document) -> None:
        """Takes the transfer functions of a document; drops the history if it has other layers."""
        edited = self.history.has_unsaved_edits(self.state)
        is_same = document.file_numbers == self.document.file_numbers
        self.state, self.bases = self.state.with_bases(document, is_same), stated_transfers(document.styles)
        if not is_same:
            self.history.forget(self.state)
        if not edited:
            self.history.mark_saved(self.state)

    def _fit_home(self) -> None:
        """Fits a view that nobody has changed to the finest splats, as `splatgl render` does."""
        home = self.document.home(self.size)
        if home.view() != self.home.view():
            self.home = home
            self.state = replace(self.state, pose=home)
            if not self.history.past and not self.history.has_unsaved_edits(self.state):
                self.history.begin(self.state)
