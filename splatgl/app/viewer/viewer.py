"""`Viewer`: the event loop: turns events into states and renders them, as few frames as possible."""

from __future__ import annotations

import gc
import time
from dataclasses import dataclass, replace
from importlib.util import find_spec
from math import prod
from pathlib import Path
from typing import Any

import numpy as np

from splatgl.app.viewer.bindings import BINDINGS, Binding, keymap
from splatgl.app.viewer.content import Content
from splatgl.app.viewer.difference import Reference, Wanted
from splatgl.app.viewer.files import Files, News, Reopen
from splatgl.app.viewer.hud import progress
from splatgl.app.viewer.jobs import Done, Jobs
from splatgl.app.viewer.mouse import Mouse, wheeled
from splatgl.app.viewer.pacing import LADDER, REST, STEP, TARGET
from splatgl.app.viewer.painter import Painter
from splatgl.app.viewer.pick import pivoted
from splatgl.app.viewer.pose import Place
from splatgl.app.viewer.refiner import Moment, Refiner
from splatgl.app.viewer.saving import saved
from splatgl.app.viewer.state import State, acted, up_of
from splatgl.app.viewer.window import Window
from splatgl.data.errors import InputError, missing_extra
from splatgl.gl.portions import Interrupted
from splatgl.gl.renderer import Renderer
from splatgl.gl.screen import Screen

# maximum seconds to wait for events when idle: bounds the response to Ctrl-C
IDLE = 0.25
# maximum number of panel frames queued by events
MOST_FRAMES = 20
# automatic rotation in degrees per second
SPEED = 30.0


@dataclass(frozen=True)
class Options:
    """Startup options. reopen: reloads the scene when watched files change; folder: for saved images."""

    size: tuple[int, int] = (1024, 768)
    target: float = TARGET
    folder: Path = Path(".")
    bindings: tuple[Binding, ...] = BINDINGS
    ground: str = "black"
    panel: bool = True
    watched: tuple[str, ...] = ()
    reopen: Reopen | None = None


class Viewer:
    """Shows one content at a time. `step()` runs one iteration of the event loop; `run()` loops until closed."""

    def __init__(self, content: Content, renderer: Renderer, options: Options | None = None) -> None:
        self.options = options or Options()
        self.keys = keymap(self.options.bindings)
        self.screen = Screen(self.options.size, "splatgl")
        try:
            self.window = Window(self.screen, self)
            self.jobs = Jobs(self.window.wake)
            self.reference = Reference(Jobs(self.window.wake))
            self.painter = Painter(self.screen, renderer, self.options.bindings)
            self.renderer = renderer
            self.content = content
            self.state = replace(State.of(content, self._size()), ground=self.options.ground)
            self.panel: Any = None
            if self.options.panel and find_spec("imgui_bundle"):
                self._open_panel()
        except BaseException:
            self.screen.close()
            raise
        self.mouse = Mouse()
        self.files = Files(self.jobs, self.options.watched, self.options.reopen, self.now())
        self.files.refine(content)
        self.refiner = Refiner(content.counts, prod(self._size()), self.options.target)
        self.touched = self.ticked = self.now()
        # input counter: a full-quality frame in progress is cancelled when it changes
        self.asked = 0
        self.closed = False
        self.dirty = 1

    def key(self, chord: str) -> None:
        """Runs the action bound to `chord`, if any."""
        action = self.keys.get(chord)
        if action:
            self.state = acted(self.state, action, self.content)
            if self.state.panel and self.panel is None:
                self._open_panel()
            self._touch()

    def press(self, button: str, held: tuple[str, ...], place: Place) -> None:
        """Starts a drag; a double click sets the pivot."""
        if self.mouse.doubles(button, place, self.now()):
            self.state = pivoted(self.state, self.content, place)
            self._touch()
        self.mouse = self.mouse.press(button, held, place, self.state.pose, self.now())

    def release(self, button: str) -> None:
        """Ends the drag."""
        self.mouse = self.mouse.release()

    def move(self, place: Place) -> None:
        """Moves the view by the current drag, if any, and stops the automatic rotation."""
        if self.mouse.drag is not None:
            pose = self.mouse.drag.to(place)
            self.state = replace(self.state, pose=pose.resized(self._size()), turning=False)
            self._touch()

    def wheel(self, notches: float, place: Place) -> None:
        """Zooms at `place`; upwards zooms in."""
        self.state = replace(self.state, pose=wheeled(self.state.pose, place, notches))
        self._touch()

    def resize(self, size: tuple[int, int]) -> None:
        """Fits the view to `size` in pixels; a minimised window keeps its last size."""
        if min(size) > 0:
            self.state = replace(self.state, pose=self.state.pose.resized(size))
            self._touch()

    def drop(self, paths: list[str]) -> None:
        """Opens the first of the files; the current content stays until it is loaded."""
        if paths:
            self.files.open(paths[0], self.state.settings)
            self._touch()

    def refresh(self) -> None:
        """Redisplays the window's content in the next step."""
        self.dirty = max(self.dirty, 1)

    def raw(self, kind: str, *values: Any) -> bool:
        """Passes an event to the panel; True if consumed. Cursor moves without a button cancel no frame in progress."""
        if self.panel is None or not self.state.panel:
            return False
        self.asked += kind != "cursor" or self.window.held
        # the panel handles one event per frame and shows its effect in the next
        self.dirty = min(max(self.dirty, 1) + 1, MOST_FRAMES)
        return bool(self.panel.event(kind, *values))

    def run(self) -> None:
        """Runs `step()` until the window is closed."""
        while not self.closed:
            self.step()

    def step(self, wait: float | None = None) -> None:
        """Handles events and finished jobs, renders a frame if one is due, and displays it. wait: maximum seconds."""
        self.window.wait(self._patience() if wait is None else wait)
        for done in self.jobs.collect():
            self._finished(done)
        if self.reference.collect():
            self.refresh()
        self.files.look(self.now())
        self._turn()
        self._answer()
        if self.window.closing:
            self.closed = True
        if self.closed or min(self.window.size) < 1:
            return
        self._draw()
        self._compare()
        self._show()

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
        self.reference.forget()
        if self.panel is not None:
            self.panel.close()
        self.screen.close()

    def _patience(self) -> float:
        """Seconds to wait for events; a held button defers the full-quality frame."""
        if self.dirty:
            return 0.0
        if self.state.turning:
            return max(0.0, self.ticked + STEP - self.now())
        moment = self._moment()
        due = self.refiner.patience(self._wanted(), moment)
        if due is None and self._unfinished():
            due = max(0.0, REST - moment.idle)
        return IDLE if due is None or (due == 0.0 and moment.held) else min(due, IDLE)

    def _moment(self) -> Moment:
        # quads near the eye may be slow even in portions: deferred until the mouse button is released
        frame = self.painter.frame
        held = self.mouse.drag is not None and (frame is None or frame.plan.program.technique == "quads")
        return Moment(self.now() - self.touched, self.state.turning, held, self.content.whole)

    def _wanted(self) -> tuple[object, ...]:
        """Key of a frame: all its inputs, as values or immutable objects."""
        return self.state.pose, self.state.settings, self.content, self.state.beyond and self.state.compare == "off"

    def _draw(self) -> None:
        """Renders a preview after changes, or the full-quality frame at rest, which is shown again with its HUD."""
        blurs = self._blurs()
        self._extract(blurs)
        wanted, moment, asked = self._wanted(), self._moment(), self.asked
        level = self.refiner.level(wanted, moment)
        if level is None:
            return
        if wanted != self.refiner.drawn:
            self.reference.forget()
        try:
            frame = self.painter.draw(self.state, self.content, LADDER[level], blurs, lambda: self._given_up(asked))
        except Interrupted:
            return
        except InputError as error:
            self.refiner.refuse(wanted)
            self.state = replace(self.state, message=str(error))
            return
        self.refiner.done(wanted, level, frame.seconds, moment, frame.full)
        self.dirty = max(self.dirty, 1 + frame.full)

    def _blurs(self) -> bool:
        """Whether the view moves continuously and motion is blurred."""
        gliding = self.state.turning or (self.mouse.drag is not None and self._moment().moving)
        return gliding and self.state.blur != "off"

    def _given_up(self, asked: int) -> bool:
        """Polls events during a frame; True after new input, which cancels it."""
        self.window.wait(0.0)
        return self.asked != asked or self.window.closing

    def _extract(self, blurs: bool) -> None:
        """Takes the content that the state asks for; extracts its finest splats in the worker thread, at rest."""
        state = self.state
        content = self.content.following(state.transfer, state.threshold, state.moving, blurs)
        unfinished = self._unfinished()
        if content is not self.content:
            self._take(content)
            if content.heavy:
                said = f"some {8 * len(content.at(2)):,} splats: too many to draw all; make more of it transparent"
                self.state = replace(state, message=said)
        elif unfinished is not None and self.now() - self.touched >= REST:
            self.jobs.submit("extracting", lambda: unfinished.skin(1))

    def _unfinished(self) -> Content | None:
        """The content whose finest splats still have to be extracted, if any: that on show, or that of its motion."""
        moving = self.content.classified(self.state.moving, True)
        waiting = [content for content in (self.content, moving) if not content.whole and not content.heavy]
        return waiting[0] if waiting and not self.jobs.busy else None

    def _compare(self) -> None:
        """Requests the reference of a full-quality frame once the view is at rest."""
        frame = self.painter.frame
        if self.state.compare == "off" or frame is None or not frame.full or self.refiner.drawn != self._wanted():
            if self.reference.wanted is not None:
                self.reference.forget()
        elif self.reference.wanted is None:
            settings = self.state.settings.but(classification="auto")
            self.reference.ask(Wanted(self.content.at(1), self.state.pose.camera, settings))

    def _show(self) -> None:
        """Displays the image, its overlay and the panel if any of them changed."""
        said = self.painter.compared(self.state, self.reference)
        if self.painter.write(self.state, self.content, self.window.scale, self.jobs.busy, said):
            self.refresh()
        if not self.dirty:
            return
        self.dirty -= 1
        self._compose()
        self.window.show()
        self.window.title(f"{self.content.volume.name} - splatgl - {progress(self.state, self.painter.frame)}")

    def _compose(self) -> None:
        """Draws the window's content into its back buffer."""
        self.screen.draw(self.window.size, self.painter.look(self.state, self.reference))
        if self.panel is not None and self.state.panel and not self.state.help:
            self.state = self.panel.frame(self.state, self.content, self.painter.frame)

    def _turn(self) -> None:
        now = self.now()
        if self.state.turning:
            pose = self.state.pose.spun(SPEED * (now - self.ticked), up_of(self.content))
            self.state = replace(self.state, pose=pose)
            self.touched = now
        self.ticked = now

    def _answer(self) -> None:
        """Runs the state's pending window actions."""
        self.closed |= "quit" in self.state.asks
        self.state = saved(self.state, self.content, self.renderer.render, self.options.folder)

    def _finished(self, done: Done) -> None:
        """Handles a finished job, whose splats are in the content already; bad input only sets the message."""
        self.refresh()
        if isinstance(done.error, InputError | MemoryError):
            self.state = replace(self.state, message=str(done.error) or "not enough memory")
        elif done.error is not None:
            raise done.error
        elif isinstance(done.result, News) and not done.result.stale(self.content):
            self._opened(done.result)
        else:
            self._take(self.content)

    def _opened(self, news: News) -> None:
        """Takes a loaded file; a reloaded one keeps its view unless its scene file changed."""
        content, scene, transfer = news.content, self.content.scene, self.content.transfer
        if news.reopen is not None:
            self.files.turn_to(news, self.now())
        if news.reopen is not None or content.scene != scene:
            self.state = self.state.opened(content)
        elif self.state.base == transfer:
            self.state = replace(self.state, base=content.transfer)
        self._take(content)
        self.files.refine(content)
        # contents of the volume before refer to each other
        gc.collect()
        self._touch()

    def _take(self, content: Content) -> None:
        """Sets the displayed content."""
        self.content = content
        self.refiner.renew(content.counts, prod(self._size()))
        self.refresh()

    def _touch(self) -> None:
        self.asked += 1
        self.touched = self.now()
        self.refresh()

    def _size(self) -> tuple[int, int]:
        width, height = self.window.size
        return max(width, 1), max(height, 1)

    def _open_panel(self) -> None:
        """Creates the panel, or sets a message on how to install its library."""
        if not find_spec("imgui_bundle"):
            said = str(missing_extra("the panel", "imgui-bundle", "gui"))
            self.state = replace(self.state, panel=False, message=said)
        else:
            from splatgl.app.viewer.gui import Gui

            self.panel = Gui(self.window)
            self.state = replace(self.state, panel=True)
