"""`Viewer`: the window, which holds document and state and performs effects. Other modules compute the next values."""

from __future__ import annotations

import os
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
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
from splatgl.geometry.camera import Camera
from splatgl.gl.renderer import Renderer
from splatgl.gl.screen import Screen, ScreenMarks
from splatgl.gl.target import Interrupted
from splatgl.scene.meshes import is_mesh
from splatgl.splat.settings import Settings
from splatgl.splat.splats import checked
from splatgl.viewer import commands
from splatgl.viewer.adaptive_quality import (
    LADDER,
    PARALLEL,
    REST,
    STEP,
    TARGET,
    IdleTrim,
    InputTiming,
    Refiner,
    Wanted,
    return_large_blocks,
)
from splatgl.viewer.clip_tool import leaves_nothing, set_cuts
from splatgl.viewer.commands import (
    AS_SHOWN,
    COMMANDS,
    NO_FILE,
    Command,
    Copy,
    CopyText,
    Effect,
    LeaveDocument,
    Open,
    OpenOption,
    PictureOptions,
    Question,
    Save,
    SaveAction,
    ShowSection,
    WindowRequest,
    ask_for_files,
    ask_to_leave,
    tell_error,
)
from splatgl.viewer.document import Document
from splatgl.viewer.files import ADD, OPEN, SAVE, Dialogs, Recent, WindowLayout, grouped, is_segmentation
from splatgl.viewer.frame_renderer import FrameRenderer
from splatgl.viewer.hud import Overlays, help_sprite, is_light, progress_text, readout_label
from splatgl.viewer.input import InputHandler
from splatgl.viewer.jobs import Extractor, FinishedJob, JobKind, Jobs
from splatgl.viewer.loading import Files, Loaded, OpenedFile, ReplacedDocument
from splatgl.viewer.measure_tool import Readout
from splatgl.viewer.movie_track import stop_preview
from splatgl.viewer.recorder import Recorder, movie_command, movie_scene
from splatgl.viewer.reference_view import Reference
from splatgl.viewer.saving import (
    compose_screenshot,
    copy_text,
    free_path,
    is_scene_name,
    save_as,
    save_picture,
    save_scene,
    scene_of,
    try_save,
)
from splatgl.viewer.slice_views import SliceTool, column_width
from splatgl.viewer.state import THEMES, ClipState, History, State, changed_fields, played, stated_transfers
from splatgl.viewer.trackball import MouseEvent, Pointer, Viewport, docked_width, fits_panel, up_direction
from splatgl.viewer.window import Window

# screen units of the first window
SIZE = (1024, 768)
OTHER = "the picture before"
# topics of messages, which are cleared once the topic is over
OPENING, READING, EXTRACTING, PICTURE, COUNT = "opening", "reading", "extracting", "picture", "count"
TOPICS = {JobKind.OPEN: OPENING, JobKind.EXTRACT: EXTRACTING}
CUTS_ENDED = "the cuts are removed: they would leave nothing of this volume"
UNSAVED = "edits are not saved: shift+s saves the scene; quit again to leave without"
CHANGED = "the scene file has changed: ctrl+z brings the edits back"
RECORDING = "a movie is recorded; quit again to cancel it"
LEAVING = "edits are not saved: shift+s saves the scene; open it again to leave without"
# purpose of the extra library, for the message where it is missing
PANEL = "the panel with the opacity curve, colours, settings, cuts and files"
# the panel's dialog, beside those of files
SAVE_PICTURE = "save-picture"
# commands that a preview goes on at
PREVIEWS = ("preview", "hud", "panel", "keyframe")
# seconds between two looks for events while a frame is prepared
POLLED = 0.05
# seconds between two texts while a frame is drawn
TOLD = 0.5
# maximum panel frames between two portions of a picture
MOST_SHOWN = 2
# seconds of a preview that the panel waits for
WAITED = 0.05
# automatic rotation in degrees per second
SPEED = 30.0
# maximum seconds to wait for events when idle: bounds the response to Ctrl-C
IDLE = 0.25


@dataclass(frozen=True)
class Options:
    """Startup options. size: screen units; None: that of the latest window. folder: for saved images; source: the path
    that is being read already. owns_process: whether the process is the window's alone, so that it may close the window
    on signals and tune the memory of others.
    """

    size: tuple[int, int] | None = None
    target: float = TARGET
    folder: Path = Path(".")
    commands: tuple[Command, ...] = COMMANDS
    ground: str = "black"
    panel: bool = True
    source: str = ""
    owns_process: bool = False


class Viewer:
    """Shows one document at a time. `step()` runs one iteration of the event loop; `run()` loops until closed.

    files: what is being read already; failed: why nothing could be shown at all.
    """

    # what was shown before the document was opened, and after it was left by undo
    before: ReplacedDocument | None = None
    after: ReplacedDocument | None = None
    # whether the next request to quit is obeyed although edits are lost
    warned = False

    def __init__(
        self, document: Document, renderer: Renderer, options: Options | None = None, files: Files | None = None
    ) -> None:
        self.options, self.renderer = options or Options(), renderer
        if self.options.owns_process:
            return_large_blocks()
        # effects of commands, performed in the next step
        self.effects: list[Effect] = []
        # number of inputs, and the time of the latest: a full-quality frame is cancelled by new ones
        self.inputs, self.touched = 0, self.now()
        # when a frame in preparation looked for events
        self.polled = self.touched
        # when the text was written, and what is drawn was begun; what that is, while it takes long
        self.told = self.begun = self.touched
        self.drawing = ""
        self.closed, self.dirty = False, 1
        self.failed: BaseException | None = None
        arrangement = WindowLayout.of(os.environ)
        size = self.options.size or arrangement.size or SIZE
        self.screen = Screen(size, "splatgl")
        try:
            self.window = Window(self.screen, self)
            wake = self.window.wake
            self.slices = SliceTool(wake)
            self.input = InputHandler(self.options.commands, self.slices)
            self.extractor, self.reference, self.overlays = Extractor(wake), Reference(Jobs(wake)), Overlays()
            self.recorder, self.readout = Recorder(), Readout(Jobs(wake))
            self.painter = FrameRenderer(self.screen, renderer)
            self.document = document
            self.panel: Any = None
            theme = arrangement.theme if arrangement.theme in THEMES else THEMES[0]
            state = replace(State.of(document, size), ground=self.options.ground, theme=theme)
            self.state = replace(state, slices=replace(state.slices, shown=arrangement.slices))
            # the next document, whose coarsest splats are being extracted
            self.coming: Document | None = None
            if self.options.panel and find_spec("imgui_bundle"):
                is_open = arrangement.panel and fits_panel(self.window.size, self.window.scale)
                self.state = replace(self.state, panel=is_open)
                self.open_panel()
        except BaseException:
            self.screen.close()
            raise
        self.history = History(self.state)
        self.recent, self.dialogs, self.chosen_options = Recent.of(os.environ), Dialogs(), AS_SHOWN
        # the view that was fitted to the document
        self.home = self.state.pose
        # transfer functions as opened: a file that changes keeps edited ones
        self.bases = stated_transfers(document.styles)
        self.files = files or Files(Jobs(wake), (), None, self.now())
        self.files.jobs.wake = wake
        self.files.refine(document)
        self.refiner = Refiner(document.counts, prod(self.size), self.options.target)
        self.ticked = self.played = self.now()
        self.trim = IdleTrim(self.ticked, self.options.owns_process)
        # pixels from the left picture to the one that the mouse is in
        self.right_edge = 0
        # topic and message of the latest error; why the latest picture was not drawn
        self.last_error, self.reject_reason = ("", ""), ""
        if document.is_empty and self.panel is None:
            self.say(NO_FILE)

    # --- what is shown ----------------------------------------------------------------------------------------------

    @property
    def view(self) -> Viewport:
        """The part of the window next to the panel, for tools."""
        (width, height), scale = self.window.size, self.window.scale
        has_panel = self.panel is not None and self.state.panel and not self.document.is_empty
        width -= docked_width((width, height), scale) if has_panel else 0
        return Viewport((max(width, 1), max(height, 1)), scale, self.now())

    @property
    def size(self) -> tuple[int, int]:
        """Pixels of the picture; there are two while a view is pinned."""
        width, height = self.shown_size
        return max(width // (1 + (self.state.beside is not None)), 1), height

    @property
    def shown_size(self) -> tuple[int, int]:
        """Pixels of all pictures: the window without the panel and the slices."""
        width, height = self.view.size
        # there are no slices of a file that is not read yet
        column = 0 if self.document.is_loading else column_width((width, height), self.state.slices)
        return max(width - column, 1), height

    def remember(self) -> None:
        """Saves the window's layout and scene for the next one."""
        # in narrow windows, the panel is open only while it is wanted
        panel = (
            self.state.panel if fits_panel(self.window.size, self.window.scale) else WindowLayout.of(os.environ).panel
        )
        size, slices, theme = self.window.unit_size, self.state.slices.shown, self.state.theme
        WindowLayout(size, panel, slices, theme).remember(os.environ)
        if not self.document.is_loading:
            with suppress(*USER_ERRORS):
                self.recent.keep(scene_of(self.state, self.document))

    @property
    def busy(self) -> str | None:
        """The work in other threads; None if there is none."""
        is_opening = self.document.is_loading and not self.document.is_empty
        return self.files.busy or (OPENING if is_opening else self.extractor.busy)

    @property
    def pending_reason(self) -> str | None:
        """The note while the picture of the state cannot be drawn; None if it can."""
        rejected = self.coming is None and self.wanted() == self.refiner.refused
        return OTHER if rejected or (self.coming and self.extractor.has_failed(self.coming)) else None

    @property
    def is_closing(self) -> bool:
        """Whether the window was asked to close, so that nothing more is drawn."""
        return self.window.closing or WindowRequest.QUIT in self.effects

    def wanted(self) -> Wanted:
        """Key of a frame: all its inputs, as values or immutable objects."""
        state = self.state
        return state.pose, state.settings, self.document, state.show_zk and state.compare == "off", state.beside

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
            # its own command ends a preview
            state = self.state if command.id in PREVIEWS else stop_preview(self.state)
            self.state, effects = command(state, self.document)
            self.touch()
            for effect in effects:
                # a field opens at once: the keys that follow are its own
                has_field = effect in (WindowRequest.PALETTE, WindowRequest.SAVE_AS)
                (self.perform_one if has_field else self.effects.append)(effect)

    def mouse(self, event: MouseEvent, pointer: Pointer) -> None:
        """Passes a mouse event to the tools; any but a move ends a preview."""
        if event != "move":
            self.state = stop_preview(self.state)
        pointer = self._linked(event, pointer)
        self.update(self.input.handle(event, pointer, self.state, self.document, self.view))
        if event == "move" and not self.input.is_dragging:
            self._look_at_cursor()

    def _look_at_cursor(self) -> None:
        """Reads the picture under a cursor at rest over a whole picture, and shows the slices' values there."""
        cursor, frame = self.input.cursor, self.painter.frame
        covered = self.panel is not None and self.panel.touched
        is_whole = frame is not None and frame.full and self.refiner.drawn == self.wanted()
        is_shown = is_whole and self.state.hud != "off" and not (covered or self.state.help)
        self.readout.look(self.state, self.document, cursor if is_shown else None)
        if self.state.probe or self.state.slices.shown:
            self.refresh()

    def _linked(self, event: MouseEvent, pointer: Pointer) -> Pointer:
        """The same place in the left picture, of one in the right picture; a drag stays where it began."""
        width, (x, y) = self.size[0], pointer.place
        if event == "press" or not (event == "release" or self.window.held):
            is_right = self.state.beside is not None and width <= x < self.shown_size[0]
            self.right_edge = width if is_right else 0
        return replace(pointer, place=(x - self.right_edge, y))

    def resize(self, size: tuple[int, int]) -> None:
        """Fits the view to a window of `size` in pixels; a minimised one keeps its last size. A view that nobody has
        moved is fitted anew, any other one keeps its height.
        """
        if min(size) > 0:
            before, document = self.state.pose, self.document
            is_first = before.view() == document.home(before.camera.size).view()
            pose = document.home(self.size) if is_first else before.resized(self.size)
            self.state = replace(self.state, pose=pose)
            # the same view in another size
            self.history.resize(before, pose)
            self.home = pose if self.home is before else self.home
            self.touch()

    def drop(self, paths: Sequence[str]) -> None:
        """Adds dropped segmentations; asks what to do with other files, or opens them where only that is possible, or
        nothing can ask.
        """
        is_scene, is_series = any(path.endswith(".toml") for path in paths), len(grouped(paths)[0]) > 1
        is_clear = self.document.is_loading and not (self.document.is_empty and is_series)
        if self.panel is None or is_scene or is_clear:
            self.open(paths, self.document.is_loading)
        elif paths and all(map(is_segmentation, paths)):
            self.perform_one(Open(tuple(paths), adds=True))
        elif paths:
            self.ask(ask_for_files(paths, self.is_edited))

    def open(self, paths: Sequence[str], are_alone: bool = True) -> None:
        """Opens the files, and asks first if edits would be lost; the current document stays until they are loaded.
        are_alone: whether meshes alone replace it, too; else they are added.
        """
        replaces = are_alone or not all(map(is_mesh, paths))
        if paths and not (replaces and self.asks_to_leave(Open(tuple(paths)))):
            self._replace(Open(tuple(paths)), are_alone)
            self.touch()

    def asks_to_leave(self, opens: Open | OpenOption) -> bool:
        """Whether edits would be lost, and the window asks about it; without the panel, a second request is obeyed."""
        if not self.is_edited or self.state.message == LEAVING:
            return False
        self.ask(ask_to_leave(opens), LEAVING)
        return True

    @property
    def is_edited(self) -> bool:
        """Whether edits would be lost."""
        return not self.document.is_loading and self.history.has_unsaved_edits(self.state)

    def raw(self, kind: str, *values: Any) -> bool:
        """Passes an event to the panel; True if the panel consumes it. A cursor elsewhere changes nothing there."""
        if self.panel is None or self.state.help:
            return False
        before = self.panel.touched
        consumed = bool(self.panel.event(kind, *values))
        if kind != "cursor" or self.window.held or before or self.panel.touched:
            self.refresh()
        return consumed

    def say(self, message: str, topic: str = "") -> None:
        """Shows a message until the next key, or until its topic is cleared."""
        self.state = replace(self.state, message=message)
        self.last_error = (topic, message) if topic else self.last_error
        self.refresh()

    def ask(self, question: Question, message: str = "", topic: str = "") -> None:
        """Asks in a box, which stays until it is answered; without the panel, shows a message instead."""
        if self.panel is None:
            self.say(message, topic)
        else:
            self.panel.panel.questions.ask(question)
            self.refresh()

    def clear_message(self, topic: str) -> None:
        """Clears the message of a topic."""
        if self.last_error[0] == topic:
            if self.state.message == self.last_error[1]:
                self.state = replace(self.state, message="")
                self.refresh()
            self.last_error = ("", "")

    def take(self, document: Document) -> None:
        """Shows a document."""
        self.clear_message(EXTRACTING)
        self.document, self.coming, self.extractor.failed = document, None, None
        self.refiner.renew(document.counts, prod(self.size))
        self.refresh()

    def open_panel(self) -> None:
        """Creates the panel unless it is there, or sets a message on how to install its library."""
        if not find_spec("imgui_bundle"):
            message = str(missing_extra(PANEL, "imgui-bundle", "gui"))
            self.state = replace(self.state, panel=False, message=message)
        elif self.panel is None:
            from splatgl.viewer.imgui_backend import Gui

            self.panel = Gui(self.window, self.options.commands, self.options.panel)

    # --- the picture --------------------------------------------------------------------------------------------------

    def _follow_state(self, blurs: bool) -> None:
        """Shows the document in the styles of the state once its coarsest splats are extracted; finer ones follow at
        rest. Until then, the previous document is shown.
        """
        state, extractor = self.state, self.extractor
        if self.coming is not None:
            if self.coming.extracted:
                self.take(self.coming)
            elif not extractor.has_failed(self.coming):
                extractor.request(self.coming, False)
                return
        base = self.coming or self.document
        placed = base.with_planes(state.slice_planes)
        document = placed.with_styles(state.styles, state.mesh_files, state.moving, blurs)
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
            self.take(document)
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

    def _moment(self) -> InputTiming:
        # quads near the eye may be slow even in portions: deferred until the mouse button is released
        frame = self.painter.frame
        held = self.input.is_dragging and (frame is None or frame.plan.program.technique == "quads")
        return InputTiming(self.now() - self.touched, self.state.gliding, held, self.document.extracted)

    def _draw(self) -> int | None:
        """Renders a preview after changes, or the full-quality frame at rest. Returns its level, if any."""
        gliding = self.state.gliding or (self.input.is_dragging and self._moment().moving)
        blurs = gliding and self.state.blur != "off"
        self._follow_state(blurs)
        wanted, inputs, level = self.wanted(), self.inputs, None

        def draw(level: int) -> tuple[Wanted, bool]:
            if wanted != self.refiner.drawn:
                self.reference.forget()
            # quick previews need no portions
            is_slow = level == 0 or self.refiner.pace.expected(level) > WAITED
            interrupted = partial(self._is_interrupted, inputs, level == 0) if is_slow else None
            self.begun, self.drawing = self.now(), "refining" if level == 0 else ""
            try:
                with checked(self._check_closing):
                    frame = self.painter.draw(self.state, self.document, LADDER[level], blurs, interrupted)
            finally:
                self.drawing = ""
            self.clear_message(PICTURE)
            self.dirty = max(self.dirty, 1 + frame.full)
            return wanted, frame.full

        try:
            level = self.refiner.step(wanted, self._moment(), draw)
        except Interrupted:
            pass
        except USER_ERRORS as error:
            self.reject_reason = error_text(error)
        # no key hides why the picture is another one; the previous document need not support the settings of the coming
        if wanted == self.refiner.refused and self.coming is None and not self.state.message:
            self.say(self.reject_reason, PICTURE)
        return level

    def _check_closing(self) -> None:
        """Polls events while a frame is prepared, now and then; raises Interrupted once the window is to close."""
        if self.now() - self.polled > POLLED:
            self.window.wait(0.0)
            self.polled = self.now()
        if self.is_closing:
            raise Interrupted

    def _is_interrupted(self, inputs: int, is_full: bool = True) -> bool:
        """Polls events during a frame and shows the panel that they change; True after new input, which cancels the
        frame if `is_full`. A preview goes on, and shows the panel only while the cursor is over it. The text goes on
        with other threads, and counts the seconds of a frame.
        """
        self.window.wait(0.0)
        if self.inputs == inputs and self.now() - self.told > TOLD:
            self.show()
        # a change is shown after the frame that makes it
        for _ in range(MOST_SHOWN):
            if self.dirty and self.panel is not None and (self.inputs == inputs if is_full else self.panel.touched):
                self._redisplay()
        return self.is_closing or (is_full and self.inputs != inputs)

    def _compare(self) -> None:
        """Requests the reference of a full-quality frame once its view is at rest."""
        frame, reference = self.painter.frame, self.reference
        if self.state.compare == "off" or not frame or not frame.full or self.refiner.drawn != self.wanted():
            if reference.wanted is not None:
                reference.forget()
        elif reference.wanted is None:
            settings = self.state.settings.replace(classification="auto")
            reference.request(self.document, self.state.pose.camera, settings)

    def show(self) -> None:
        """Displays the image, its overlay and the panel if any of them changed."""
        running = self.recorder.running
        note = self.painter.compared(self.state, self.reference)
        note = f"recording {running.target.name}: {running.text}" if running else note
        self.told = self.now()
        drawing = f"{self.drawing}, {self.told - self.begun:.0f} s" if self.drawing else None
        doing = self.busy or self.pending_reason or drawing
        if self.painter.write(self.state, self.document, self.window.scale, doing, note):
            self.refresh()
        if self.dirty:
            self._redisplay()
            words = self.document.volume.name, "splatgl", doing or progress_text(self.painter.frame)
            self.window.title("splatgl" if self.document.is_empty and not doing else " - ".join(filter(None, words)))

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
            self.open_panel()
        self.screen.draw(self.drawn_size, self.painter.look(self.state, self.reference))
        self.screen.mark(self.window.size, self._marks())
        if self.panel is not None and not self.state.help:
            before, panel = self.state, self.panel.panel
            panel.recent, panel.widgets.recording = self.recent, self.recorder.running
            panel.widgets.idle = self._idle()
            # no check of what is drawn meanwhile begins a frame of the panel within this one, or leaves it open
            with checked(lambda: None):
                self.state = self.panel.frame(self.state, self.document, self.painter.frame)
            effects, panel.widgets.effects = panel.widgets.effects, []
            self.effects += effects
            if self.state is not before or effects:
                self.touch()
            if self.panel.waiting or self.panel.owed:
                self.refresh()
        if self.state.help:
            # over picture, slices and the room of the panel: nothing is drawn anew for it
            size, commands = self.window.size, self.options.commands
            sprite = help_sprite(size, self.view.size[0], self.window.scale, commands)
            self.screen.mark(size, ScreenMarks(labels=(sprite,)))

    def _idle(self) -> frozenset[str]:
        """Names of commands that have nothing to do, which their history or the recorder tells."""
        history, idle = self.history, set[str]()
        if not (history.past or self.before or history.has_changes(self.state)):
            idle.add("undo")
        if not (history.future or self.after):
            idle.add("redo")
        return frozenset(idle if self.recorder.running else idle | {"cancel-recording"})

    @property
    def drawn_size(self) -> tuple[int, int]:
        """Pixels of the picture, and of the pinned one."""
        width, height = self.size
        return width * (1 + (self.state.beside is not None)), height

    def _marks(self) -> ScreenMarks:
        covered = self.panel is not None and self.panel.touched
        cursor = None if covered or self.input.is_dragging else self.input.cursor
        slices = self.slices.marks(self.state, self.document, self.view, cursor, cursor and self.readout.point)
        # nothing lies over the help
        if self.document.is_loading or self.painter.frame is None or self.state.help:
            return slices
        lies_over = self.panel is not None and self.state.panel and self.view.size[0] == self.window.size[0]
        edge = self.panel.left_edge if lies_over else self.size[0]
        marks = self.overlays.marks(self.state, self.document, self.view, cursor, slices, edge)
        is_read = cursor is not None and not self.state.probe
        lines = self.readout.lines if is_read else ()
        texts = readout_label(lines, self.painter.written_to, edge, self.view.scale, is_light(self.state))
        return replace(marks, labels=(*marks.labels, *texts))

    # --- the loop ---------------------------------------------------------------------------------------------------

    def run(self) -> None:
        """Runs `step()` until the window is closed."""
        while not self.closed:
            self.step()
        if self.failed is not None:
            raise self.failed

    def step(self, wait: float | None = None) -> None:
        """Handles events and finished jobs, renders a frame if one is due, and displays it. wait: maximum seconds."""
        self.window.wait(self._seconds_until_due() if wait is None else wait)
        begun, processed = time.perf_counter(), time.process_time()
        self.window.fill(self.state.fullscreen)
        self.collect()
        self._advance()
        # saved pictures have the size of the window, and frames that of what was opened and toggled
        self._fill()
        self.perform()
        if self.closed or min(self.window.size) < 1:
            return
        self._fill()
        level = self._draw()
        if self.is_closing:
            return
        if level is not None:
            self._look_at_cursor()
        self._compare()
        self.show()
        if level is None and self.panel is not None and not self.dirty:
            gallery = self.panel.panel.gallery
            end = self.now() + WAITED
            while gallery.render_next(self.renderer, self.state.pose, self.screen.ctx) and not self.is_closing:
                self.refresh()
                if self.now() > end:
                    break
        if level is not None and self.painter.frame is not None:
            picture, whole = self.painter.frame.seconds, time.perf_counter() - begun
            self.painter.whole = whole
            # a software renderer's own time, whatever other processes take
            alone = (time.process_time() - processed) / PARALLEL if self.renderer.info.software else whole
            self.refiner.took(level, picture, whole - picture, min(alone, whole))

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

    def _seconds_until_due(self) -> float:
        """Seconds to wait for events; a held button defers the full-quality frame."""
        if self.dirty or self.effects or self.is_closing:
            return 0.0
        if self.state.gliding:
            return max(0.0, self.ticked + STEP - self.now())
        if self.state.playing and self.files.times and not self.files.jobs.busy:
            return max(0.0, self.played + 1 / self.state.pace - self.now())
        moment = self._moment()
        due = self.refiner.seconds_until_due(self.wanted(), moment)
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

    def perform(self) -> None:
        """Performs the effects of commands, and opens or saves what was chosen in a dialog."""
        effects, self.effects = self.effects, []
        for effect in effects:
            self.perform_one(effect)
        chosen = self.dialogs.take(self.panel and self.panel.panel.browser)
        if chosen and self.dialogs.kind != SAVE:
            self.perform_one(Open(tuple(chosen), adds=self.dialogs.kind == ADD))
        elif chosen:
            self.perform_one(Save(chosen[0], self.chosen_options))
        if self.files.times and not self.dirty:
            self.files.show_time(self.state.time)
        if self.window.closing and WindowRequest.QUIT not in effects:
            self._quit()
        if self.state.message not in (UNSAVED, RECORDING):
            self.warned = False

    def perform_one(self, effect: Effect) -> None:
        """Performs one effect of a command."""
        folder = self.options.folder
        match effect:
            case WindowRequest.UNDO | WindowRequest.REDO:
                self._step(effect is WindowRequest.UNDO)
            case WindowRequest.CANCEL:
                self._cancel()
            case WindowRequest.SAVE_PICTURE:
                self._save(
                    "picture", partial(save_picture, folder=folder, add=partial(self._composed, self.state)), False
                )
            case WindowRequest.SAVE_SCENE:
                self._save("scene", partial(save_scene, folder=folder), True)
            case WindowRequest.SAVE_AS:
                self._open_dialog(SAVE_PICTURE, folder, free_path(folder, "picture", ".png").name)
            case Save():
                self._save_as(Path(effect.path), effect.options, effect.action)
            case Copy():
                self.window.copy(copy_text(effect, self.state, self.document))
                self.say(f"{effect.value} copied: it draws this picture")
            case CopyText(text):
                self.window.copy(text)
            case Open(()):
                source = Path(self.document.scene.volume)
                folder = source.parent if source.exists() else Path()
                self._open_dialog(ADD if effect.adds else OPEN, folder, "")
            case Open(paths, adds=False):
                self.open(paths)
            case Open(paths) if self.document.is_empty:
                self._replace(effect)
                self.touch()
            case Open(paths):
                # scissors that were drawn meanwhile cut them, too
                self.files.add(paths, replace(self.document.scene, scissors=self.state.styles[0].scissors))
            case OpenOption():
                if not self.asks_to_leave(effect):
                    self._replace(effect)
            case LeaveDocument(opens, saves):
                if saves:
                    self._save("scene", partial(save_scene, folder=folder, has_picture=False), True)
                if not (saves and self.history.has_unsaved_edits(self.state)):
                    self._replace(opens)
            case WindowRequest.RECORD:
                self._record(free_path(folder, "movie", self.state.movie.form))
            case WindowRequest.RECORD_AS:
                form, self.chosen_options = self.state.movie.form or MOVIES[0], AS_SHOWN
                self._open_dialog(SAVE, folder, free_path(folder, "movie", form).name)
            case WindowRequest.CANCEL_RECORDING:
                self.say("nothing is recorded" if not self.recorder.cancel() else "the recording is cancelled")
            case WindowRequest.COPY_MOVIE:
                self._record(None)
            case WindowRequest.FORGET_RECENT:
                self.recent = self.recent.forgotten()
            case WindowRequest.PALETTE | WindowRequest.FOCUS | ShowSection():
                self._reach_panel(effect)
            case WindowRequest.QUIT:
                self._quit()

    def _replace(self, opens: Open | OpenOption | None, are_alone: bool = True) -> None:
        """Opens other files, or another part of the file, or closes the window, whatever is not saved. are_alone: as of
        `open`.
        """
        state = self.state
        if opens is None:
            self.closed = True
        elif isinstance(opens, Open):
            # what stands for a file has no settings of its own
            settings = Settings() if self.document.is_loading else state.settings
            self.files.open(opens.paths, settings, are_alone or self.document.is_loading, opens.adds)
        else:
            edits: dict[str, Any] = {"settings": state.settings, "annotate": state.annotate}
            scene = replace(self.document.scene, **edits, meshes=state.mesh_files)
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
            self.take(left.document)
            self.renderer.free()
            self.files.refine(left.document)
        self.touch()

    def _leave(self) -> ReplacedDocument:
        """The document and its edits, for undo after another file was opened."""
        self.history.note(self.state)
        state = replace(self.state, pinned=None, preview=None)
        return ReplacedDocument(self.document.coarse(), state, self.history, self.home, self.bases, self.files.shown)

    def _reach_panel(self, effect: WindowRequest | ShowSection) -> None:
        """Opens the list of commands, or a section of the panel, or gives the keys to the panel or to the picture."""
        self.state = replace(self.state, panel=self.state.panel or effect is not WindowRequest.PALETTE)
        self.open_panel()
        if self.panel is None:
            return
        if isinstance(effect, ShowSection):
            self.panel.panel.section = effect.title
        else:
            (self.panel.focus if effect is WindowRequest.FOCUS else self.panel.panel.palette.open)()
        # the panel places a section once it is open
        self.dirty = max(self.dirty, 2)

    def _record(self, target: Path | None) -> None:
        """Begins a movie of the state, or copies its command (None); says why it cannot be drawn."""
        shown = stop_preview(self.state), self.document, self.files.times
        try:
            if target is not None:
                self.recorder.start(*movie_scene(*shown), target)
            else:
                self.window.copy(movie_command(*shown))
                self.say("command copied: it draws this movie")
        except USER_ERRORS as error:
            self.say(error_text(error))

    def _save(self, name: str, save: Any, is_scene: bool) -> None:
        """Saves, and shows the message; a picture is cancelled by the escape key, or by closing the window. name: of
        what is saved; is_scene: whether edits are saved by it.
        """
        # events meanwhile change the window, not what is saved
        state, self.drawing, self.begun = self.state, f"saving {name}", self.now()
        self.say(f"{self.drawing}; escape cancels")
        self.show()
        try:
            with checked(self._check_saving):
                message, done = try_save(lambda: save(state, self.document, self._draw_saved))
        except Interrupted:
            message, done = f"the {name} is not saved: cancelled", True
        finally:
            self.drawing = ""
        # it has cancelled the picture
        self.effects = [effect for effect in self.effects if effect is not WindowRequest.CANCEL]
        self.say(message if done else "")
        if not done:
            self.ask(tell_error(message), message)
        elif is_scene:
            self.history.mark_saved(state)

    def _draw_saved(self, subject: Any, camera: Camera, settings: Settings) -> Image:
        """A picture that is saved."""
        return self.renderer.render(subject, camera, settings, interrupted=self._cancels_saving)

    def _cancels_saving(self) -> bool:
        """Polls events; returns whether a picture that is saved is cancelled."""
        return self._is_interrupted(self.inputs, is_full=False) or WindowRequest.CANCEL in self.effects

    def _check_saving(self) -> None:
        """Polls events while a picture that is saved is prepared; raises Interrupted if it is cancelled."""
        if self.now() - self.polled > POLLED:
            self.polled = self.now()
            if self._cancels_saving():
                raise Interrupted

    def _save_as(self, path: Path, options: PictureOptions, action: SaveAction) -> None:
        """Saves under a name, copies the command that draws it, or asks for another place."""
        if action is SaveAction.ASK:
            self.chosen_options = options
            self._open_dialog(SAVE, path.parent, path.name)
        elif action is SaveAction.COPY:
            self.window.copy(copy_text(Copy.COMMAND, self.state, self.document, options, path.name))
            self.say("command copied: it draws this picture" + ", without what is beside it" * (self._beside > 0))
        elif path.suffix.lower() in MOVIES:
            self._record(path)
        else:
            save = partial(
                save_as, target=path, add=partial(self._composed, self.state), times=self.files.times, options=options
            )
            self._save(path.name, save, is_scene_name(path) and options == AS_SHOWN)

    def _composed(self, state: State, image: Image) -> Image:
        """The picture of a state with the slices of the window and the one beside it. Raises InputError for unreadable
        slices.
        """
        slices = None
        if self.slices.panes(state, self.document, self.view):
            marks = self.slices.complete_marks(state, self.document, self.view)
            self.screen.draw(self.drawn_size, self.painter.look(state, self.reference))
            self.screen.mark(self.window.size, marks)
            slices = np.asarray(self.screen.read(self.window.size)[:, self.shown_size[0] : self.view.size[0]])
            # the next frame has the panel again
            self.refresh()
        return compose_screenshot(image, state, self.document, self._draw_saved, self.window.scale, slices)

    @property
    def _beside(self) -> int:
        """The width of the pinned picture and of the slices, pixels."""
        return self.drawn_size[0] - self.size[0] + self.view.size[0] - self.shown_size[0]

    def _open_dialog(self, kind: str, folder: Path, name: str) -> None:
        if not find_spec("imgui_bundle"):
            self.say(str(missing_extra("the file dialog", "imgui-bundle", "gui")))
        elif kind == SAVE_PICTURE:
            self.open_panel()
            self.panel.panel.saving.open(folder / name, self.size, self._beside)
        else:
            self.dialogs.open(kind, folder.resolve(), name, self._browser)

    def _browser(self) -> Any:
        """Opens the panel, which draws the file dialog."""
        self.state = replace(self.state, panel=True)
        self.open_panel()
        return self.panel.panel.browser

    def _cancel(self) -> None:
        """Abandons what is being read; closes a window that has nothing to show."""
        opening = self.files.opening
        if self.files.cancel():
            self.closed |= self.document.is_loading and not self.document.is_empty
            self.state = replace(self.state, time=self.files.time)
            if opening:
                # finer voxels waited for it
                self.files.refine(self.document)

    def _quit(self) -> None:
        """Closes the window; asks first, or waits for a second request, if edits would be lost."""
        is_edited, is_recording = self.is_edited, self.recorder.running is not None
        if not (is_edited or is_recording) or self.warned:
            self.closed = True
            return
        self.warned = True
        self.window.stay()
        if is_edited:
            lost = " The movie that is being recorded is cancelled then." * is_recording
            self.ask(replace(commands.UNSAVED, text=commands.UNSAVED.text + lost), UNSAVED)
        else:
            self.say(RECORDING)

    # --- results of worker threads ----------------------------------------------------------------------------------

    def collect(self) -> None:
        """Takes the results of the worker threads."""
        for done in (*self.files.jobs.collect(), *self.extractor.collect()):
            self.apply(done)
        notes = self.slices.collect()
        for note in notes or ():
            self.say(note)
        if self.readout.collect(self.document):
            # the cursor may have moved meanwhile
            self._look_at_cursor()
            self.refresh()
        if self.reference.collect() or notes is not None:
            self.refresh()

    def apply(self, done: FinishedJob) -> None:
        """Applies a finished job. Bad input only sets the message, or closes a window that has nothing to show."""
        self.refresh()
        self.files.finish(done.kind)
        if done.error is not None:
            self._apply_error(done.kind, done.error)
            return
        match done.kind:
            case JobKind.ADD:
                self.history.note(self.state)
                self.state, document = done.value.added_to(self.state, self.document)
                state = self.state
                self.take(document)
                self.files.refine(document.with_styles(state.styles, state.mesh_files, state.settings))
                self.touch()
            case JobKind.EXTRACT:
                self.clear_message(EXTRACTING)
                self.refiner.renew(self.document.counts, prod(self.size))
                # all time points have the view of the first
                if self.state.pose is self.home and 1 in self.document.extracted and self.files.time == 0:
                    self._fit_home()
            case JobKind.REFINE if done.value.scene is not self.document.scene:
                # of a document that is no longer shown
                pass
            case _:
                self._apply_loaded(done.kind, done.value)

    def _apply_error(self, kind: JobKind, error: BaseException) -> None:
        if not isinstance(error, USER_ERRORS):
            raise error
        message, topic = error_text(error), TOPICS.get(kind, READING)
        if kind in (JobKind.EXTRACT, JobKind.RELOAD):
            self.say(message, topic)
        else:
            self.ask(tell_error(message), message, topic)
        if self.document.is_loading and not self.document.is_empty:
            self.failed, self.closed = error, True
        elif kind is JobKind.TIME_POINT:
            # the slider goes back to the visible time point
            self.state = replace(self.state, time=self.files.time, playing=False)
        elif kind is JobKind.OPEN:
            # finer voxels waited for the file
            self.files.refine(self.document)

    def _apply_loaded(self, kind: JobKind, loaded: Loaded) -> None:
        """Shows a loaded file. A reloaded one keeps its view unless its scene file changed; a time point keeps all."""
        shown = self.document
        if kind is not JobKind.REFINE:
            self.clear_message(OPENING)
            self.clear_message(READING)
        if isinstance(loaded, OpenedFile):
            document = loaded.document
            self.recent = self.recent.opened(loaded.path or self.options.source)
            self._begin(loaded)
            if loaded.reopen is not None:
                self.files.follow(loaded)
        else:
            document, number = loaded if isinstance(loaded, tuple) else (loaded, 0)
            document, is_reloaded = document.with_additions(shown), kind is not JobKind.TIME_POINT
            if kind is not JobKind.REFINE:
                self.files.time = number
            if is_reloaded and not document.is_described_as(shown):
                is_edited = self.history.has_unsaved_edits(self.state)
                self._begin(OpenedFile(document))
                is_kept = is_edited and self.before is not None
                self.state = replace(self.state, message=CHANGED if is_kept else "")
            elif (is_reloaded or document.scene.look) and self.bases == stated_transfers(self.state.styles):
                # the segments of time points are their own
                self._rebase(document)
                self.state = replace(self.state, message="" if is_reloaded else self.state.message)
            elif document.file_numbers != shown.file_numbers:
                self._rebase(document)
        self.take(document)
        self.files.refine(document)
        self.touch()

    def _begin(self, opened: OpenedFile) -> None:
        """Starts with the state of another document; undo shows the one before, unless it takes too much memory."""
        document, before = opened.document, self.state.pose
        is_kept = not self.document.is_loading and self.document.bytes <= budget()
        self.before, self.after = self._leave() if is_kept else None, None
        self.files.times, self.files.time = opened.times, 0
        changes: dict[str, Any] = {"times": len(opened.times), "file_options": opened.options, "message": opened.note}
        self.state = replace(self.state.opened(document), **changes)
        if leaves_nothing(self.state.settings.clip, document):
            # planes of the file before
            self.state = set_cuts(replace(self.state, message=CUTS_ENDED), document, ClipState())
        self.home, self.bases = self.state.pose, stated_transfers(document.styles)
        if opened.is_option and np.array_equal(document.volume.corners, self.document.volume.corners):
            self.state = replace(self.state, pose=before)
        self.history = History(self.state)
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
                self.history = History(self.state)
