"""`Display`: the document and the state of the window, and the events that change them."""

from __future__ import annotations

import os
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from importlib.util import find_spec
from math import prod
from pathlib import Path
from typing import Any

from splatgl.errors import missing_extra
from splatgl.gl.renderer import Renderer
from splatgl.gl.screen import Screen
from splatgl.scene.meshes import is_mesh
from splatgl.viewer.adaptive_quality import TARGET, IdleTrim, Refiner, return_large_blocks
from splatgl.viewer.commands import COMMANDS, Command, Effect, Open, OpenOption
from splatgl.viewer.document import Document
from splatgl.viewer.file_dialogs import Dialogs
from splatgl.viewer.frame_renderer import FrameRenderer
from splatgl.viewer.input import InputHandler
from splatgl.viewer.jobs import Extractor, Jobs
from splatgl.viewer.loading import Files
from splatgl.viewer.movie_track import stop_preview
from splatgl.viewer.overlays import Overlays
from splatgl.viewer.questions import ask_for_files, ask_to_leave, tell_error
from splatgl.viewer.recorder import Recorder
from splatgl.viewer.reference_view import Reference
from splatgl.viewer.remembered import Arrangement, Recent
from splatgl.viewer.slice_views import SliceTool, column_width
from splatgl.viewer.state import THEMES, History, State, changed_fields, stated_transfers
from splatgl.viewer.tool import MouseEvent, Pointer, View, docked_width, is_roomy
from splatgl.viewer.window import Window

# screen units of the first window
SIZE = (1024, 768)
OTHER = "the picture before"
LEAVING = "edits are not saved: shift+s saves the scene; open it again to leave without"
# purpose of the extra library, for the message where it is missing
PANEL = "the panel with the opacity curve, colours, settings, cuts and files"
# commands that a preview goes on at
PREVIEWS = ("preview", "hud", "panel", "keyframe")
# topics of messages, which are cleared once the topic is over
OPENING, READING, EXTRACTING, PICTURE, COUNT = "opening", "reading", "extracting", "picture", "count"


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


class Display:
    """The document and the state of the window.

    files: what is being read already; failed: why nothing could be shown at all.
    """

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
        self.closed, self.dirty = False, 1
        self.failed: BaseException | None = None
        arrangement = Arrangement.of(os.environ)
        size = self.options.size or arrangement.size or SIZE
        self.screen = Screen(size, "splatgl")
        try:
            self.window = Window(self.screen, self)
            wake = self.window.wake
            self.slices = SliceTool(wake)
            self.input = InputHandler(self.options.commands, self.slices)
            self.extractor, self.reference, self.overlays = Extractor(wake), Reference(Jobs(wake)), Overlays()
            self.recorder = Recorder()
            self.painter = FrameRenderer(self.screen, renderer, self.options.commands)
            self.document = document
            self.panel: Any = None
            theme = arrangement.theme if arrangement.theme in THEMES else THEMES[0]
            state = replace(State.of(document, size), ground=self.options.ground, theme=theme)
            self.state = replace(state, slices=replace(state.slices, shown=arrangement.slices))
            # the next document, whose coarsest splats are being extracted
            self.coming: Document | None = None
            if self.options.panel and find_spec("imgui_bundle"):
                is_open = arrangement.panel and is_roomy(self.window.size, self.window.scale)
                self.state = replace(self.state, panel=is_open)
                self._open_panel()
        except BaseException:
            self.screen.close()
            raise
        self.history = History(self.state)
        self.dialogs, self.recent = Dialogs(), Recent.of(os.environ)
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
        # whether the next request to quit is obeyed although edits are lost
        self.warned = False
        # pixels from the left picture to the one that the mouse is in
        self.right_edge = 0
        # topic and message of the latest error; why the latest picture was not drawn
        self.last_error, self.reject_reason = ("", ""), ""

    # --- what is shown ----------------------------------------------------------------------------------------------

    @property
    def view(self) -> View:
        """The window beside the panel, for tools."""
        (width, height), scale = self.window.size, self.window.scale
        # the help takes the room of the panel
        has_panel = self.panel is not None and self.state.panel and not self.state.help
        width -= docked_width((width, height), scale) if has_panel else 0
        return View((max(width, 1), max(height, 1)), scale, self.now())

    @property
    def size(self) -> tuple[int, int]:
        """Pixels of the picture; there are two while another is pinned beside it."""
        width, height = self.shown_size
        return max(width // (1 + (self.state.beside is not None)), 1), height

    @property
    def shown_size(self) -> tuple[int, int]:
        """Pixels of all pictures: the window without the panel and the slices."""
        width, height = self.view.size
        return max(width - column_width((width, height), self.state.slices.shown), 1), height

    def remember(self) -> None:
        """Stores how the window stands for the next one."""
        # in narrow windows, the panel is open only while it is wanted
        panel = self.state.panel if is_roomy(self.window.size, self.window.scale) else Arrangement.of(os.environ).panel
        size, slices, theme = self.window.unit_size, self.state.slices.shown, self.state.theme
        Arrangement(size, panel, slices, theme).remember(os.environ)

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
            self.effects += effects
            self.touch()

    def mouse(self, event: MouseEvent, pointer: Pointer) -> None:
        """Passes a mouse event to the tools; any but a move ends a preview."""
        if event != "move":
            self.state = stop_preview(self.state)
        pointer = self._linked(event, pointer)
        self.update(self.input.handle(event, pointer, self.state, self.document, self.view))
        if event == "move" and self.state.probe and not self.input.is_dragging:
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
        """Asks what to do with dropped files; opens them where only that is possible, or nothing can ask."""
        is_scene = any(path.endswith(".toml") for path in paths)
        if self.panel is None or self.document.is_loading or is_scene:
            self.open(paths, self.document.is_loading)
        elif paths:
            self.panel.panel.questions.ask(ask_for_files(paths))
            self.refresh()

    def open(self, paths: Sequence[str], are_alone: bool = True) -> None:
        """Opens the files, and asks first if edits would be lost; the current document stays until they are loaded.
        are_alone: whether meshes alone replace it, too; else they are added.
        """
        replaces = are_alone or not all(map(is_mesh, paths))
        if paths and not (replaces and self.asks_to_leave(Open(tuple(paths)))):
            self.files.open(paths, self.state.settings, are_alone)
            self.touch()

    def asks_to_leave(self, opens: Open | OpenOption) -> bool:
        """Whether edits would be lost, and the window asks about it; without the panel, a second request is obeyed."""
        is_edited = not self.document.is_loading and self.history.has_unsaved_edits(self.state)
        if not is_edited or self.state.message == LEAVING:
            return False
        if self.panel is None:
            self.say(LEAVING)
        else:
            self.panel.panel.questions.ask(ask_to_leave(opens))
            self.refresh()
        return True

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

    def tell_error(self, message: str, topic: str = "") -> None:
        """Shows an error in a box until it is closed; without the panel, as a message."""
        if self.panel is None:
            self.say(message, topic)
        else:
            self.panel.panel.questions.ask(tell_error(message))
            self.refresh()

    def clear_message(self, topic: str) -> None:
        """Clears the message of a topic."""
        if self.last_error[0] == topic:
            if self.state.message == self.last_error[1]:
                self.state = replace(self.state, message="")
                self.refresh()
            self.last_error = ("", "")

    def _take(self, document: Document) -> None:
        """Shows a document."""
        self.clear_message(EXTRACTING)
        self.document, self.coming, self.extractor.failed = document, None, None
        self.refiner.renew(document.counts, prod(self.size))
        self.refresh()

    def _open_panel(self) -> None:
        """Creates the panel, or sets a message on how to install its library."""
        if not find_spec("imgui_bundle"):
            message = str(missing_extra(PANEL, "imgui-bundle", "gui"))
            self.state = replace(self.state, panel=False, message=message)
        else:
            from splatgl.viewer.imgui_backend import Gui

            self.panel = Gui(self.window, self.options.commands, self.options.panel)
