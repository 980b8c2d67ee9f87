"""`Viewer`: the event loop of the window. It alone holds what changes; other modules compute the next values."""

from __future__ import annotations

import os
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from importlib.util import find_spec
from math import prod
from pathlib import Path
from typing import Any

import numpy as np

from splatgl.data.image import Image
from splatgl.errors import USER_ERRORS, error_text, missing_extra
from splatgl.gl.renderer import Renderer
from splatgl.gl.screen import Marks, Screen
from splatgl.gl.target import Interrupted
from splatgl.viewer.adaptive_quality import LADDER, REST, STEP, TARGET, IdleTrim, Moment, Refiner, return_large_blocks
from splatgl.viewer.commands import COMMANDS, Command, Copy, Effect, Open, OpenOption, Request
from splatgl.viewer.document import Document
from splatgl.viewer.file_dialogs import OPEN, SAVE, Dialogs
from splatgl.viewer.frame_renderer import FrameRenderer
from splatgl.viewer.hud import progress_text
from splatgl.viewer.input import InputHandler
from splatgl.viewer.jobs import Done, Extractor, Jobs, Kind
from splatgl.viewer.loading import Files, Loaded, MeshesRead, Opened, Recent, Reloaded, TimePoint
from splatgl.viewer.overlays import Overlays
from splatgl.viewer.reference_view import Reference, ReferenceInputs
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
from splatgl.viewer.slice_views import SliceTool, column_width
from splatgl.viewer.state import History, State, changed_fields
from splatgl.viewer.tool import MouseEvent, Pointer, View, docked_width
from splatgl.viewer.trackball import up_direction
from splatgl.viewer.window import Window

# automatic rotation in degrees per second
SPEED = 30.0
# minimum seconds between the time points of a series that plays
PLAYED = 0.1
# maximum seconds to wait for events when idle: bounds the response to Ctrl-C
IDLE = 0.25
# maximum number of panel frames queued by events
MOST_FRAMES = 20
UNSAVED = "edits are not saved: shift+s saves the scene; quit again to leave without"
OTHER = "the picture before"
# purpose of the extra library, for the message where it is missing
PANEL = "the panel with the opacity curve, colours, settings, cuts and files"
# topics of messages, which are cleared once the topic is over
OPENING, READING, EXTRACTING, PICTURE, COUNT = "opening", "reading", "extracting", "picture", "count"
TOPICS = {Kind.OPEN: OPENING, Kind.EXTRACT: EXTRACTING}


@dataclass(frozen=True)
class Options:
    """Startup options. folder: for saved images; source: the path that is being read already."""

    size: tuple[int, int] = (1024, 768)
    target: float = TARGET
    folder: Path = Path(".")
    commands: tuple[Command, ...] = COMMANDS
    ground: str = "black"
    panel: bool = True
    source: str = ""


class Viewer:
    """Shows one document at a time. `step()` runs one iteration of the event loop; `run()` loops until closed.

    files: what is being read already; failed: why nothing could be shown at all.
    """

    def __init__(
        self, document: Document, renderer: Renderer, options: Options | None = None, files: Files | None = None
    ) -> None:
        return_large_blocks()
        self.options, self.renderer = options or Options(), renderer
        # effects of commands, performed in the next step
        self.effects: list[Effect] = []
        # number of inputs, and the time of the latest: a full-quality frame is cancelled by new ones
        self.inputs, self.touched = 0, self.now()
        self.closed, self.dirty = False, 1
        self.failed: BaseException | None = None
        self.screen = Screen(self.options.size, "splatgl")
        try:
            self.window = Window(self.screen, self)
            wake = self.window.wake
            self.slices = SliceTool(wake)
            self.input = InputHandler(self.options.commands, self.slices)
            self.extractor, self.reference, self.overlays = Extractor(wake), Reference(Jobs(wake)), Overlays()
            self.painter = FrameRenderer(self.screen, renderer, self.options.commands)
            self.document = document
            self.panel: Any = None
            self.state = replace(State.of(document, self.options.size), ground=self.options.ground)
            # the next document, whose coarsest splats are being extracted
            self.coming: Document | None = None
            if self.options.panel and find_spec("imgui_bundle"):
                # over the picture it is opened when it is wanted
                self.state = replace(self.state, panel=docked_width(self.window.size, self.window.scale) > 0)
                self._open_panel()
        except BaseException:
            self.screen.close()
            raise
        self.history = History(self.state)
        self.dialogs, self.recent = Dialogs(), Recent.of(os.environ)
        # the view that was fitted to the document
        self.home = self.state.pose
        # transfer functions as opened: a file that changes keeps edited ones
        self.bases = [style.base for style in document.styles]
        self.files = files or Files(Jobs(wake), (), None, self.now())
        self.files.jobs.wake = wake
        self.files.refine(document)
        self.refiner = Refiner(document.counts, prod(self.size), self.options.target)
        self.ticked = self.played = self.now()
        self.trim = IdleTrim(self.ticked)
        # whether the next request to quit is obeyed although edits are lost
        self.warned = False
        # topic and message of the latest error; why the latest picture was not drawn
        self.last_error, self.reject_reason = ("", ""), ""

    # --- what is shown ----------------------------------------------------------------------------------------------

    @property
    def view(self) -> View:
        """The window beside the panel, for tools."""
        (width, height), scale = self.window.size, self.window.scale
        width -= docked_width((width, height), scale) if self.panel is not None and self.state.panel else 0
        return View((max(width, 1), max(height, 1)), scale, self.now())

    @property
    def size(self) -> tuple[int, int]:
        """Pixels of the picture: the window without the panel and the slices."""
        width, height = self.view.size
        return max(width - column_width((width, height), self.state.slices.shown), 1), height

    @property
    def busy(self) -> str | None:
        """The work in other threads; None if there is none."""
        return self.files.busy or (OPENING if self.document.is_loading else self.extractor.busy)

    @property
    def pending_reason(self) -> str | None:
        """The note while the picture of the state cannot be drawn; None if it can."""
        rejected = self.coming is None and self.wanted() == self.refiner.refused
        return OTHER if rejected or (self.coming and self.extractor.has_failed(self.coming)) else None

    def wanted(self) -> tuple[object, ...]:
        """Key of a frame: all its inputs, as values or immutable objects."""
        return self.state.pose, self.state.settings, self.document, self.state.show_zk and self.state.compare == "off"

    def now(self) -> float:
        """Monotonic clock in seconds."""
        return time.monotonic()

    # --- events of the window ---------------------------------------------------------------------------------------

    def refresh(self) -> None:
        """Redisplays the window's content in the next step."""
        self.dirty = max(self.dirty, 1)

    def touch(self) -> None:
        """Notes input that may change the picture."""
        self.inputs += 1
        self.touched = self.now()
        self.refresh()

    def update(self, state: State) -> None:
        """Takes the next state. While slices move, the picture stays as it is, and is refined further."""
        changes = changed_fields(state, self.state)
        self.state = state
        if changes - {"slices"}:
            self.touch()
        elif changes:
            self.refresh()

    def key(self, chord: str) -> None:
        """Runs the command of a key, if there is one."""
        command = self.input.commands.get(chord)
        if command is not None:
            self.state, effects = command(self.state, self.document)
            self.effects += effects
            self.touch()

    def mouse(self, event: MouseEvent, pointer: Pointer) -> None:
        """Passes a mouse event to the tools."""
        self.update(self.input.handle(event, pointer, self.state, self.document, self.view))
        if event == "move" and self.state.probe and not self.input.is_dragging:
            self.refresh()

    def resize(self, size: tuple[int, int]) -> None:
        """Fits the view to a window of `size` in pixels; a minimised one keeps its last size."""
        if min(size) > 0:
            before = self.state.pose
            pose = before.resized(self.size)
            self.state = replace(self.state, pose=pose)
            # the same view in another size
            self.history.resize(before, pose)
            self.home = pose if self.home is before else self.home
            self.touch()

    def drop(self, paths: Sequence[str]) -> None:
        """Opens the files; the current document stays until they are loaded."""
        if paths:
            self.files.open(paths, self.state.settings, self.document.is_loading)
            self.touch()

    def raw(self, kind: str, *values: Any) -> bool:
        """Passes an event to the panel; True if the panel consumes it. A cursor elsewhere changes nothing there."""
        if self.panel is None or self.state.help:
            return False
        before = self.panel.touched
        consumed = bool(self.panel.event(kind, *values))
        if kind != "cursor" or self.window.held or before or self.panel.touched:
            # the panel handles one event per frame and shows its effect in the next
            self.dirty = min(max(self.dirty, 1) + 1, MOST_FRAMES)
        return consumed

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
        if level is not None and self.painter.frame is not None:
            picture, whole = self.painter.frame.seconds, time.perf_counter() - begun
            self.painter.whole = whole
            self.refiner.took(level, picture, whole - picture)

    def close(self) -> None:
        """Frees the window and its resources, but not the renderer."""
        self.closed = True
        self.dialogs.close()
        self.reference.forget()
        self.extractor.wanted = None
        if self.panel is not None:
            self.panel.close()
        self.screen.close()

    def _patience(self) -> float:
        """Seconds to wait for events; a held button defers the full-quality frame."""
        if self.dirty or self.effects:
            return 0.0
        if self.state.turning:
            return max(0.0, self.ticked + STEP - self.now())
        if self.state.playing and self.files.times and not self.files.jobs.busy:
            return max(0.0, self.played + PLAYED - self.now())
        moment = self._moment()
        due = self.refiner.patience(self.wanted(), moment)
        if not moment.whole:
            due = min(IDLE if due is None else due, max(0.0, REST - moment.idle) or IDLE)
        return IDLE if due is None or (due == 0.0 and moment.held) else min(due, IDLE)

    def _advance(self) -> None:
        """Advances rotation and time series; at rest, records a step of the history and frees unused memory."""
        now, state = self.now(), self.files.check(self.state, self.now())
        if state.turning:
            state = replace(state, pose=state.pose.spun(SPEED * (now - self.ticked), up_direction(self.document)))
            self.touched = now
        shown = self.files.time == state.time and not self.files.jobs.busy and not self.dirty
        if state.playing and self.files.times and shown and now - self.played >= PLAYED:
            state = replace(state, time=(state.time + 1) % len(self.files.times))
            self.played = now
        self.state, self.ticked = state, now
        resting = now - self.touched >= REST and not self.window.held
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
        if chosen and self.dialogs.kind == OPEN:
            self.drop(chosen)
        elif chosen:
            times, path = self.files.times, Path(chosen[0])
            args = self.state, self.document, self.renderer.render, path, self._composed, times
            self._save(path.name, partial(save_as, *args), is_scene_name(path))
        if self.files.times and not self.dirty:
            self.files.show_time(self.state.time)
        if self.window.closing and Request.QUIT not in effects:
            self._quit()
        if self.state.message != UNSAVED:
            self.warned = False

    def _perform_one(self, effect: Effect) -> None:
        draw, folder = self.renderer.render, self.options.folder
        match effect:
            case Request.UNDO | Request.REDO:
                step = self.history.undo if effect is Request.UNDO else self.history.redo
                self.state = step(self.state)
                self.touch()
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
            case Open(()):
                source = Path(self.document.scene.volume)
                self._open_dialog(OPEN, source.parent if source.exists() else Path(), "")
            case Open(paths):
                self.drop(paths)
            case OpenOption(option, value):
                state = self.state
                scene = replace(self.document.scene, settings=state.settings, annotate=state.annotate)
                self.files.open_option(replace(scene, meshes=state.mesh_files), option, value)
            case Request.FORGET_RECENT:
                self.recent = self.recent.forgotten()
            case Request.PALETTE:
                if self.panel is None:
                    self._open_panel()
                if self.panel is not None:
                    self.panel.panel.palette.open()
            case Request.SAVE_AND_QUIT:
                self._save("scene", partial(save_scene, self.state, self.document, draw, folder), True)
                self.closed = not self.history.has_unsaved_edits(self.state)
            case Request.DISCARD:
                self.closed = True
            case Request.QUIT:
                self._quit()

    def _save(self, name: str, save: Any, is_scene: bool) -> None:
        """Saves, and shows the message. name: of what is saved; is_scene: whether edits are saved by it."""
        self.say(f"saving {name}")
        self._show()
        message, done = try_save(save)
        self.state = replace(self.state, message=message)
        if done and is_scene:
            self.history.mark_saved(self.state)
        self.refresh()

    def _composed(self, image: Image) -> Image:
        """The picture with the ruler and the slices of the window. Raises InputError for unreadable slices."""
        slices = None
        if self.slices.panes(self.state, self.document, self.view):
            marks = self.slices.complete_marks(self.state, self.document, self.view)
            self.screen.draw(self.size, self.painter.look(self.state, self.reference))
            self.screen.mark(self.window.size, marks)
            slices = np.asarray(self.screen.read(self.window.size)[:, self.size[0] : self.view.size[0]])
            # the next frame has the panel again
            self.refresh()
        return compose_screenshot(image, self.state, self.document, self.window.scale, slices)

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
        if not self.history.has_unsaved_edits(self.state) or self.warned:
            self.closed = True
            return
        self.warned = True
        self.window.stay()
        if self.panel is None:
            self.say(UNSAVED)
        else:
            self.panel.panel.unsaved.opening = True
            self.refresh()

    def say(self, message: str, topic: str = "") -> None:
        """Shows a message until the next key, or until its topic is cleared."""
        self.state = replace(self.state, message=message)
        self.last_error = (topic, message) if topic else self.last_error
        self.refresh()

    def clear_message(self, topic: str) -> None:
        """Clears the message of a topic."""
        if self.last_error[0] == topic:
            if self.state.message == self.last_error[1]:
                self.state = replace(self.state, message="")
                self.refresh()
            self.last_error = ("", "")

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
            case MeshesRead():
                self.history.note(self.state)
                self._take(self.document.with_meshes(done.value.read))
                self.state = done.value.added_to(self.state)
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
        self.say(error_text(error), TOPICS.get(kind, READING))
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
            if loaded.reopen is not None:
                self.files.follow(loaded)
            self._begin(loaded)
        else:
            # with meshes that were added meanwhile
            document = document.with_meshes({**shown.read, **document.read})
            if isinstance(loaded, TimePoint):
                self.files.time = loaded.number
            elif not loaded.is_finer:
                self.files.time = 0
            is_reloaded = isinstance(loaded, Reloaded)
            if is_reloaded and document.scene != shown.scene:
                self._begin(Opened(document))
            elif is_reloaded and self.bases == [style.stated for style in self.state.styles]:
                self._rebase(document)
                self.state = replace(self.state, message="")
            elif len(document.styles) != len(self.state.styles):
                self._rebase(document)
        self._take(document)
        self.files.refine(document)
        self.touch()

    def _begin(self, opened: Opened) -> None:
        """Starts with the state of another document, without the steps of the one before."""
        document, before = opened.document, self.state.pose
        self.files.times, self.files.time = opened.times, 0
        changes: dict[str, Any] = {"times": len(opened.times), "file_options": opened.options, "message": opened.note}
        self.state = replace(self.state.opened(document), **changes)
        self.home, self.bases = self.state.pose, [style.base for style in document.styles]
        if opened.is_option and np.array_equal(document.volume.corners, self.document.volume.corners):
            self.state = replace(self.state, pose=before)
        self.history.begin(self.state)
        # buffers for the file before would stay as long as the window
        self.renderer.free()

    def _rebase(self, document: Document) -> None:
        """Takes the transfer functions of a document; drops the history if it has other layers."""
        edited, count = self.history.has_unsaved_edits(self.state), len(self.state.styles)
        self.state, self.bases = self.state.with_bases(document), [style.base for style in document.styles]
        if len(document.styles) != count:
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

    def _take(self, document: Document) -> None:
        """Shows a document."""
        self.clear_message(EXTRACTING)
        self.document, self.coming, self.extractor.failed = document, None, None
        self.refiner.renew(document.counts, prod(self.size))
        self.refresh()

    # --- frames -----------------------------------------------------------------------------------------------------

    def _follow_state(self, blurs: bool) -> None:
        """Shows the document in the styles of the state once its coarsest splats are extracted; finer ones follow at
        rest. Until then, the previous document is shown.
        """
        state, extractor = self.state, self.extractor
        if self.coming is not None:
            if self.coming.extracted:
                self._take(self.coming)
            elif not extractor.has_failed(self.coming):
                extractor.request(self.coming, False)
                return
        base = self.coming or self.document
        document = base.with_styles(state.styles, state.mesh_files, state.moving, blurs)
        if document is self.coming:
            # it failed, until the state changes
            if not state.message:
                self.say(extractor.why, EXTRACTING)
            return
        if document is not self.document and not document.extracted:
            self.coming = document
            extractor.request(document, False)
            return
        if document is not self.document or self.coming is not None:
            self._take(document)
        moving = document.for_settings(state.moving, True)
        incomplete = [each for each in (document, moving) if not each.is_complete]
        if incomplete:
            extractor.request(incomplete[0], self.now() - self.touched >= REST)
        self._warn_if_too_large()

    def _warn_if_too_large(self) -> None:
        """Shows a message while a layer has too many splats to draw them all."""
        document = self.document
        if document.exceeds_budget and document.extracted[0] == 2 and not self.state.message:
            count = sum(8 * len(layer.at(2)) for layer in document.drawn_layers if layer.exceeds_budget)
            self.say(f"some {count:,} splats: too many to draw all; make more of it transparent", COUNT)
        elif not document.exceeds_budget:
            self.clear_message(COUNT)

    def _moment(self) -> Moment:
        # quads near the eye may be slow even in portions: deferred until the mouse button is released
        frame = self.painter.frame
        held = self.input.is_dragging and (frame is None or frame.plan.program.technique == "quads")
        return Moment(self.now() - self.touched, self.state.turning, held, self.document.extracted)

    def _draw(self) -> int | None:
        """Renders a preview after changes, or the full-quality frame at rest. Returns its level, if any."""
        gliding = self.state.turning or (self.input.is_dragging and self._moment().moving)
        blurs = gliding and self.state.blur != "off"
        self._follow_state(blurs)
        wanted, moment, inputs = self.wanted(), self._moment(), self.inputs
        level = self.refiner.level(wanted, moment)
        if level is None:
            if wanted == self.refiner.refused:
                self._say_rejected()
            return None
        if wanted != self.refiner.drawn:
            self.reference.forget()
        try:
            interrupted = partial(self._is_interrupted, inputs)
            frame = self.painter.draw(self.state, self.document, LADDER[level], blurs, interrupted)
        except Interrupted:
            return None
        except USER_ERRORS as error:
            self.refiner.refuse(wanted)
            self.reject_reason = error_text(error)
            # also for a view that turns, which is rejected again each time
            self._say_rejected()
            return None
        self.clear_message(PICTURE)
        self.refiner.done(wanted, level, frame.full)
        self.dirty = max(self.dirty, 1 + frame.full)
        return level

    def _say_rejected(self) -> None:
        """Shows why the picture is another one, which no key hides."""
        # the previous document need not support the settings of the coming one
        if self.coming is None and not self.state.message:
            self.say(self.reject_reason, PICTURE)

    def _is_interrupted(self, inputs: int) -> bool:
        """Polls events during a frame and shows the panel that they change; True after new input, which cancels it."""
        self.window.wait(0.0)
        if self.dirty and self.inputs == inputs and self.panel is not None:
            self._redisplay()
        return self.inputs != inputs or self.window.closing

    def _compare(self) -> None:
        """Requests the reference of a full-quality frame once its view is at rest."""
        frame, reference = self.painter.frame, self.reference
        if self.state.compare == "off" or not frame or not frame.full or self.refiner.drawn != self.wanted():
            if reference.wanted is not None:
                reference.forget()
        elif reference.wanted is None:
            settings = self.state.settings.but(classification="auto")
            reference.request(ReferenceInputs.of(self.document, self.state.pose.camera, settings))

    def _show(self) -> None:
        """Displays the image, its overlay and the panel if any of them changed."""
        note = self.painter.compared(self.state, self.reference)
        doing = self.busy or self.pending_reason
        if self.painter.write(self.state, self.document, self.window.scale, doing, note):
            self.refresh()
        if self.dirty:
            self._redisplay()
            self.window.title(f"{self.document.volume.name} - splatgl - {doing or progress_text(self.painter.frame)}")

    def _redisplay(self) -> None:
        """Displays the latest image with the panel as it is now."""
        self.dirty -= 1
        self._compose()
        self.window.show()

    def shot(self) -> np.ndarray:
        """The window's current image, uint8 [H, W, 3], sRGB."""
        self._compose()
        return self.screen.read(self.window.size)

    def _compose(self) -> None:
        """Draws the window's content into its back buffer."""
        if self.state.panel and self.panel is None:
            self._open_panel()
        self.screen.draw(self.size, self.painter.look(self.state, self.reference))
        self.screen.mark(self.window.size, self._marks())
        if self.panel is not None and not self.state.help:
            before, panel = self.state, self.panel.panel
            panel.recent = self.recent.paths
            self.state = self.panel.frame(self.state, self.document, self.painter.frame)
            effects, panel.widgets.effects = panel.widgets.effects, []
            self.effects += effects
            if self.state is not before or effects:
                self.touch()
            if self.panel.waiting:
                self.refresh()

    def _marks(self) -> Marks:
        slices = self.slices.marks(self.state, self.document, self.view)
        # nothing lies over the help
        if self.document.is_loading or self.painter.frame is None or self.state.help:
            return slices
        covered = self.panel is not None and self.panel.touched
        cursor = None if covered or self.input.is_dragging else self.input.cursor
        return self.overlays.marks(self.state, self.document, self.view, cursor, slices)

    def _open_panel(self) -> None:
        """Creates the panel, or sets a message on how to install its library."""
        if not find_spec("imgui_bundle"):
            message = str(missing_extra(PANEL, "imgui-bundle", "gui"))
            self.state = replace(self.state, panel=False, message=message)
        else:
            from splatgl.viewer.imgui_backend import Gui

            self.panel = Gui(self.window, self.options.commands, self.options.panel)
