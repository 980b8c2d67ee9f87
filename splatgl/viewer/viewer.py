"""`Viewer`: the event loop of the window."""

from __future__ import annotations

import os
import time
from dataclasses import dataclass, replace
from functools import partial
from importlib.util import find_spec
from math import prod
from pathlib import Path
from typing import Any

import numpy as np

from splatgl.errors import USER_ERRORS, error_text, missing_extra
from splatgl.gl.renderer import Renderer
from splatgl.gl.screen import Screen
from splatgl.gl.target import Interrupted
from splatgl.viewer.adaptive_quality import LADDER, REST, STEP, TARGET, IdleTrim, Moment, Refiner, give_back_large
from splatgl.viewer.document import Document
from splatgl.viewer.file_dialogs import OPEN, SAVE, Dialogs
from splatgl.viewer.frame_renderer import FrameRenderer
from splatgl.viewer.hud import progress
from splatgl.viewer.input import Hands
from splatgl.viewer.jobs import EXTRACTING, Extractor, Jobs, followed
from splatgl.viewer.key_bindings import BINDINGS, Binding
from splatgl.viewer.loading import Files, Recent, arrived
from splatgl.viewer.overlays import Marking
from splatgl.viewer.reference_view import Reference, follow
from splatgl.viewer.saving import SAVES, as_seen, saved
from splatgl.viewer.slice_views import Slicing, column
from splatgl.viewer.state import History, State
from splatgl.viewer.trackball import up_of
from splatgl.viewer.window import Window

# automatic rotation in degrees per second
SPEED = 30.0
UNSAVED = "edits are not saved: shift+s saves the scene; quit again to leave without"
# minimum seconds between the time points of a series that is played
PLAYED = 0.1


def moved_on(viewer: Viewer) -> None:
    """Turns and plays on; once all rests, notes a step of the history and frees what is given up."""
    now, state = viewer.now(), viewer.state
    if state.turning:
        viewer.state = state = replace(
            state, pose=state.pose.spun(SPEED * (now - viewer.ticked), up_of(viewer.document))
        )
        viewer.hands.touched = now
    shown = viewer.files.time == state.time and not viewer.files.jobs.busy and not viewer.dirty
    if state.playing and viewer.files.times and shown and now - viewer.played >= PLAYED:
        viewer.state = state = replace(state, time=(state.time + 1) % len(viewer.files.times))
        viewer.played = now
    viewer.ticked = now
    resting = now - viewer.hands.touched >= REST and not viewer.window.held
    if resting and not state.asks:
        viewer.history.note(state)
    viewer.sweep.look(viewer.painter.frame, resting, now)


def answered(viewer: Viewer) -> None:
    """Runs what the state asks of the window."""
    asks, viewer.state = viewer.state.asks, replace(viewer.state, asks=())
    for ask in asks:
        if ask in ("undo", "redo"):
            undone = viewer.history.undone if ask == "undo" else viewer.history.redone
            viewer.state = undone(viewer.state)
            viewer.hands.touch()
        elif ask == "cancel":
            _cancelled(viewer)
        elif ask in (OPEN, SAVE):
            viewer.dialogs.ask(ask)
        elif ask.startswith(f"{OPEN} "):
            viewer.hands.drop([ask.removeprefix(f"{OPEN} ")])
        elif ask == "forget":
            viewer.recent = viewer.recent.forgotten()
        elif ask in SAVES:
            told = viewer.state, ask, viewer.document, viewer.renderer.render, viewer.options.folder
            viewer.state = saved(*told, partial(as_seen, viewer))
            if ask == "save" and viewer.state.message.startswith("saved"):
                viewer.history.keep(viewer.state)
    viewer.dialogs.look()
    picked = viewer.state.picked
    if picked is not None:
        state, scene = viewer.state, viewer.document.scene
        kept = replace(scene, settings=state.settings, annotate=state.annotate, meshes=state.meshes)
        viewer.files.pick(kept, *picked)
        viewer.state = replace(state, picked=None)
    if viewer.files.times and not viewer.dirty:
        viewer.files.show_time(viewer.state.time)
    if "quit" in asks or viewer.window.closing:
        _quit(viewer)
    elif viewer.state.message != UNSAVED:
        viewer.warned = False


def _cancelled(viewer: Viewer) -> None:
    """Gives up what is being read; closes a window that has nothing to show."""
    opening = viewer.files.opening
    if viewer.files.cancel():
        viewer.closed |= viewer.document.waiting
        viewer.state = replace(viewer.state, time=viewer.files.time)
        if opening:
            # what waited for it
            viewer.files.refine(viewer.document)


def _quit(viewer: Viewer) -> None:
    """Closes the window, at the second request if edits would be lost."""
    if not viewer.history.unsaved(viewer.state) or viewer.warned:
        viewer.closed = True
        return
    viewer.warned = True
    viewer.window.stay()
    viewer.say(UNSAVED)


# maximum seconds to wait for events when idle: bounds the response to Ctrl-C
IDLE = 0.25
OTHER = "the picture before"
# what is missing without its library
PANEL = "the panel with the opacity curve, colours, settings, cuts and files"


@dataclass(frozen=True)
class Options:
    """Startup options. folder: for saved images; source: the path that is being read already."""

    size: tuple[int, int] = (1024, 768)
    target: float = TARGET
    folder: Path = Path(".")
    bindings: tuple[Binding, ...] = BINDINGS
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
        give_back_large()
        self.options = options or Options()
        self.screen = Screen(self.options.size, "splatgl")
        try:
            self.hands = Hands(self, self.options.bindings)
            self.window = Window(self.screen, self.hands)
            self.extractor = Extractor(self.window.wake)
            self.reference = Reference(Jobs(self.window.wake))
            self.marking, self.slicing = Marking(), Slicing(self)
            self.painter = FrameRenderer(self.screen, renderer, self.options.bindings)
            self.renderer = renderer
            self.document = document
            # the next one, whose coarsest splats are being extracted
            self.coming: Document | None = None
            self.state = replace(State.of(document, self.whole), ground=self.options.ground)
            self.panel: Any = None
            if self.options.panel and find_spec("imgui_bundle"):
                self.state = replace(self.state, panel=True)
                self._open_panel()
        except BaseException:
            self.screen.close()
            raise
        self.history = History(self.state)
        self.dialogs, self.recent = Dialogs(self), Recent.of(os.environ)
        # the view that was fitted to what is shown
        self.home = self.state.pose
        self.files = files or Files(Jobs(self.window.wake), (), None, self.now())
        self.files.jobs.wake = self.window.wake
        self.files.refine(document)
        self.refiner = Refiner(document.counts, prod(self.size), self.options.target)
        self.ticked = self.played = self.now()
        self.sweep = IdleTrim(self.ticked)
        # whether the next request to quit is obeyed although edits are lost
        self.warned = False
        # what the latest error was of, and what it said; why the latest picture was not drawn
        self.trouble, self.refusal = ("", ""), ""
        self.closed = False
        self.failed: BaseException | None = None
        self.dirty = 1

    @property
    def whole(self) -> tuple[int, int]:
        """The window's size, pixels, at least 1."""
        width, height = self.window.size
        return max(width, 1), max(height, 1)

    @property
    def size(self) -> tuple[int, int]:
        """The picture's, pixels: the window's without the slices."""
        width, height = self.whole
        return max(width - column(self.whole, self.state.slices.shown), 1), height

    @property
    def busy(self) -> str | None:
        """What is being done in other threads; None if nothing is."""
        return self.files.busy or ("opening" if self.document.waiting else self.extractor.busy)

    @property
    def stale(self) -> str | None:
        """What is said while the picture of the state cannot be drawn; None if it can."""
        refused = self.coming is None and self.wanted() == self.refiner.refused
        return OTHER if refused or (self.coming and self.coming is self.extractor.failed) else None

    def refresh(self) -> None:
        """Redisplays the window's document in the next step."""
        self.dirty = max(self.dirty, 1)

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
        for done in (*self.files.jobs.collect(), *self.extractor.collect()):
            arrived(self, done)
        if self.reference.collect() or self.slicing.collect():
            self.refresh()
        self.state = self.files.look(self.state, self.now())
        moved_on(self)
        # what is saved has the window's size, and what is drawn that of what was opened and toggled
        self.hands.fill()
        answered(self)
        if self.closed or min(self.window.size) < 1:
            return
        self.hands.fill()
        level = self._draw()
        follow(self)
        self._show()
        if level is not None and self.painter.frame is not None:
            picture, whole = self.painter.frame.seconds, time.perf_counter() - begun
            self.painter.whole = whole
            self.refiner.took(level, picture, whole - picture)

    def now(self) -> float:
        """Monotonic clock in seconds."""
        return time.monotonic()

    def shot(self) -> np.ndarray:
        """The window's current image, uint8 [H, W, 3], sRGB."""
        self._compose()
        return self.screen.read(self.window.size)

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
        if self.dirty:
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

    def _moment(self) -> Moment:
        # quads near the eye may be slow even in portions: deferred until the mouse button is released
        frame = self.painter.frame
        held = self.hands.mouse.drag is not None and (frame is None or frame.plan.program.technique == "quads")
        return Moment(self.now() - self.hands.touched, self.state.turning, held, self.document.extracted)

    def wanted(self) -> tuple[object, ...]:
        """Key of a frame: all its inputs, as values or immutable objects."""
        return self.state.pose, self.state.settings, self.document, self.state.beyond and self.state.compare == "off"

    def _draw(self) -> int | None:
        """Renders a preview after changes, or the full-quality frame at rest, which is shown again with its text.
        Returns its level; None if none was due.
        """
        blurs = self._blurs()
        followed(self, blurs)
        wanted, moment, asked = self.wanted(), self._moment(), self.hands.asked
        level = self.refiner.level(wanted, moment)
        if level is None:
            if wanted == self.refiner.refused:
                self._refused()
            return None
        if wanted != self.refiner.drawn:
            self.reference.forget()
        try:
            frame = self.painter.draw(self.state, self.document, LADDER[level], blurs, lambda: self._given_up(asked))
        except Interrupted:
            return None
        except USER_ERRORS as error:
            self.refiner.refuse(wanted)
            self.refusal = error_text(error)
            # of a view that turns, too, which is refused anew each time
            self._refused()
            return None
        self.over("picture")
        self.refiner.done(wanted, level, frame.full)
        self.dirty = max(self.dirty, 1 + frame.full)
        return level

    def _refused(self) -> None:
        """Says why the picture is another one, which no key hides."""
        # the document before need not suit what is asked of the one that is coming
        if self.coming is None and not self.state.message:
            self.say(self.refusal, "picture")

    def say(self, message: str, of: str = "") -> None:
        """Shows a message until the next key, or until what it is of is over."""
        self.state = replace(self.state, message=message)
        self.trouble = (of, message) if of else self.trouble
        self.refresh()

    def over(self, of: str) -> None:
        """Takes back what was said of something, now that it is over."""
        if self.trouble[0] == of:
            if self.state.message == self.trouble[1]:
                self.state = replace(self.state, message="")
                self.refresh()
            self.trouble = ("", "")

    def _blurs(self) -> bool:
        """Whether the view moves continuously and motion is blurred."""
        gliding = self.state.turning or (self.hands.mouse.drag is not None and self._moment().moving)
        return gliding and self.state.blur != "off"

    def _given_up(self, asked: int) -> bool:
        """Polls events during a frame; True after new input, which cancels it."""
        self.window.wait(0.0)
        return self.hands.asked != asked or self.window.closing

    def _show(self) -> None:
        """Displays the image, its overlay and the panel if any of them changed."""
        said = self.painter.compared(self.state, self.reference)
        doing = self.busy or self.stale
        if self.painter.write(self.state, self.document, self.window.scale, doing, said):
            self.refresh()
        if not self.dirty:
            return
        self.dirty -= 1
        self._compose()
        self.window.show()
        self.window.title(f"{self.document.volume.name} - splatgl - {doing or progress(self.painter.frame)}")

    def _compose(self) -> None:
        """Draws the window's document into its back buffer."""
        if self.state.panel and self.panel is None:
            self._open_panel()
        self.screen.draw(self.size, self.painter.look(self.state, self.reference))
        self.screen.mark(self.window.size, self.marking.marked(self))
        if self.panel is not None and self.state.panel and not self.state.help:
            before = self.state
            self.panel.panel.recent = self.recent.paths
            self.state = self.panel.frame(self.state, self.document, self.painter.frame)
            if self.state is not before:
                self.hands.touch()

    def take(self, document: Document) -> None:
        """Sets the displayed document."""
        self.over(EXTRACTING)
        self.document, self.coming, self.extractor.failed = document, None, None
        self.refiner.renew(document.counts, prod(self.size))
        self.refresh()

    def show_panel(self) -> Any:
        """Opens the panel, whose library is there; returns what draws it."""
        self.state = replace(self.state, panel=True)
        if self.panel is None:
            self._open_panel()
        return self.panel.panel

    def _open_panel(self) -> None:
        """Creates the panel, or sets a message on how to install its library."""
        if not find_spec("imgui_bundle"):
            said = str(missing_extra(PANEL, "imgui-bundle", "gui"))
            self.state = replace(self.state, panel=False, message=said)
        else:
            from splatgl.viewer.imgui_backend import Gui

            self.panel = Gui(self.window)
