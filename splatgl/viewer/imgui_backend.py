"""Dear ImGui backend: passes GLFW events in and draws into the window. Needs the extra `gui`."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import imgui_bundle
from imgui_bundle import imgui, implot

from splatgl.gl.context import current
from splatgl.viewer.commands import Command
from splatgl.viewer.document import Document
from splatgl.viewer.hud import DisplayedFrame
from splatgl.viewer.input import CODES
from splatgl.viewer.panel import Panel
from splatgl.viewer.state import State
from splatgl.viewer.trackball import docked_width
from splatgl.viewer.window import Window

GLSL = "#version 330"
# height of letters at a content scale of 1
FONT = 14.0
# maximum seconds of a double click, long enough for slow frames
DOUBLE = 0.5
RELEASE, PRESS = 0, 1
ESCAPE = 256
# maximum number of frames that are due
MOST_FRAMES = 20
# seconds that the cursor rests before a tooltip; frames that it takes: ImGui sees the rest, measures and draws it
TOOLTIP, TOOLTIP_FRAMES = 0.4, 3
# frames in which a list that opens gives the keys to its field
FIELD_FRAMES = 3
# events of the mouse that may not share a frame
MOUSE = {"cursor", "button"}
# GLFW codes of the keys that go through the panel's widgets and edit them
ARROWS = ("left", "right", "up", "down")
MOVING = ("space", "escape", "enter", "tab", "page_up", "page_down", "home", "end", *ARROWS)
MOVES = {code: f"{name}_arrow" if name in ARROWS else name for code, name in CODES.items() if name in MOVING}
MOVES |= {342: "left_alt", 348: "menu"}
# and those used by text fields; letters are for ctrl+A, C, V, X, Z
KEYS = {**MOVES, 259: "backspace", 261: "delete", **{ord(letter): letter.lower() for letter in "ACVXZ"}}
TAB = 258
# GLFW's bits of the modifier keys, left and right
BITS = {340: 1, 344: 1, 341: 2, 345: 2, 342: 4, 346: 4}
MODIFIERS = ((1, imgui.Key.mod_shift), (2, imgui.Key.mod_ctrl), (4, imgui.Key.mod_alt))


class Gui:
    """Dear ImGui in a window, with the panel."""

    def __init__(self, window: Window, commands: Iterable[Command], has_strip: bool = True) -> None:
        self.window = window
        self.panel = Panel(commands, has_strip)
        self.cursor: tuple[float, float] = (-1.0, -1.0)
        # kind and values of events that ImGui has not got yet
        self.waiting: list[tuple[str, tuple[Any, ...]]] = []
        self.context, self.plots = imgui.create_context(), implot.create_context()
        self.io = imgui.get_io()
        # no ini file
        self.io.set_ini_filename("")
        self.last = time.perf_counter()
        # frames that are due: ImGui only measures the first
        self.owed = 2
        # when a tooltip is due, if the cursor moved over the panel
        self.tooltip_at = math.inf
        # whether keys go through the panel's widgets; frames until a field that opens takes them
        self.focused, self.until_field = False, 0
        # whose colours are set
        self.theme = ""
        with current(window.screen.ctx):
            imgui.backends.opengl3_init(GLSL)
        self.io.mouse_double_click_time, self.io.mouse_single_click_delay = DOUBLE, 2 * DOUBLE
        _load_font()
        _shape_widgets()
        imgui.get_style().scale_all_sizes(window.scale)
        imgui.get_style().font_scale_main = window.scale
        _fit_plots(window.scale)

    @property
    def touched(self) -> bool:
        """Whether the cursor is over the panel or drags one of its widgets."""
        return self.panel.covers(*self.cursor) or self.held

    @property
    def left_edge(self) -> float:
        """Left edge of the panel, pixels."""
        width, _ = self.window.glfw.get_window_size(self.window.handle)
        return self.panel.place[0] * self.window.size[0] / max(width, 1)

    @property
    def held(self) -> bool:
        """Whether a widget of the panel is being dragged."""
        return bool(self.io.want_capture_mouse and imgui.is_any_item_active())

    def focus(self) -> None:
        """Gives the keys that go through widgets to the panel, from its first widget on, or back to the picture."""
        self.focused = self.panel.focusing = not self.focused

    def event(self, kind: str, *values: Any) -> bool:
        """Handles a GLFW event; True if the panel consumes it: over the panel, keys for a text field, and those that go
        through widgets, if it has them.
        """
        if kind != "cursor" or not self.waiting or self.waiting[-1][0] != kind:
            # it handles an event in a frame, and shows its effect in the next
            self.owed = min(max(self.owed, 1) + 1, MOST_FRAMES)
        self.waiting.append((kind, values))
        if kind == "cursor":
            self.cursor = values[0], values[1]
            self.tooltip_at = time.monotonic() + TOOLTIP if self.touched else math.inf
            return False
        if kind in ("button", "scroll"):
            # ImGui's bit flag is one frame old: the cursor may have moved since
            covered = self.panel.covers(*self.cursor)
            self.focused &= covered or kind == "scroll"
            return covered
        if kind == "key" and values[:2] == (ESCAPE, PRESS) and (self.panel.popup or self.focused):
            # one thing at a time: a list, an edit, the keys in the panel
            self.panel.closes = len(imgui.get_current_context().open_popup_stack)
            self.focused &= self.panel.popup or imgui.is_any_item_active()
            return True
        moves = self.focused and kind == "key" and values[0] in MOVES
        is_taken = bool(self.io.want_text_input or self.panel.popup or self.panel.is_opening or moves)
        is_tab = kind == "key" and values[0] == TAB and values[1] != RELEASE
        if not is_taken and (is_tab or kind == "character"):
            # ImGui would begin an edit of the first field, and letters would reach one that opens later
            self.waiting.pop()
        return is_taken

    def tooltip_is_due(self, now: float) -> bool:
        """Whether the cursor has rested long enough for a tooltip, which the next frame then shows; True once."""
        is_due = now >= self.tooltip_at
        if is_due:
            self.tooltip_at, self.owed = math.inf, max(self.owed, TOOLTIP_FRAMES)
        return is_due

    def _pass_events(self) -> None:
        """Passes events to ImGui until the mouse moves after a button or the reverse: of a move and a release in one
        frame it ignores the move, and a slider would not reach the place where the button was released. So it ignores a
        letter whose ctrl is released in the same frame.
        """
        passed: set[str] = set()
        self.until_field = FIELD_FRAMES if self.panel.is_opening else max(self.until_field - 1, 0)
        while self.waiting:
            kind, values = self.waiting[0]
            if self.until_field and kind not in MOUSE:
                return
            is_modifier = kind == "key" and values[0] in BITS
            if (kind in MOUSE and passed & MOUSE - {kind}) or (is_modifier and "key" in passed):
                return
            passed.add("modifier" if is_modifier else kind)
            self.waiting.pop(0)
            self._pass(kind, *values)

    def _pass(self, kind: str, *values: Any) -> None:
        io = self.io
        if kind == "cursor":
            io.add_mouse_pos_event(*values)
        elif kind == "scroll":
            io.add_mouse_wheel_event(*values)
        elif kind == "button":
            button, action, bits = values
            self._modify(bits)
            io.add_mouse_button_event(button, action != RELEASE)
        elif kind == "character":
            io.add_input_character(values[0])
        else:
            code, action, bits = values
            # GLFW's bits are those before the key
            bit = BITS.get(code, 0)
            self._modify(bits & ~bit | bit * (action != RELEASE))
            if code in KEYS:
                io.add_key_event(getattr(imgui.Key, KEYS[code]), action != RELEASE)

    def _modify(self, bits: int) -> None:
        for bit, key in MODIFIERS:
            self.io.add_key_event(key, bool(bits & bit))

    def frame(self, state: State, document: Document, frame: DisplayedFrame | None) -> State:
        """Draws the panel over the window's back buffer; returns the edited state."""
        now = time.perf_counter()
        width, height = self.window.glfw.get_window_size(self.window.handle)
        pixels = self.window.size
        self.io.display_size = imgui.ImVec2(width, height)
        self.io.display_framebuffer_scale = imgui.ImVec2(pixels[0] / max(width, 1), pixels[1] / max(height, 1))
        self.io.delta_time = max(now - self.last, 1e-4)
        self.last = now
        was_open = self.panel.takes_moves
        if was_open:
            # the veil behind boxes fades in by frames, of which a window at rest draws none
            imgui.get_current_context().dim_bg_ratio = 1.0
        if state.theme != self.theme:
            self.theme = state.theme
            _color(state.theme)
        with current(self.window.screen.ctx):
            docked = docked_width(pixels, self.window.scale) > 0
            room = width if docked else round(width * state.pose.camera.size[0] / max(pixels[0], 1)), height
            state = self._handle_events(state, lambda now: self.panel.draw(now, document, frame, room, docked))
            imgui.backends.opengl3_render_draw_data(imgui.get_draw_data())
        if self.panel.takes_moves and not was_open:
            self.window.listener.refresh()
        return state

    def _handle_events(self, state: State, draw: Callable[[State], State]) -> State:
        """Lets ImGui handle events, each in a frame, until the state changes; returns the state."""
        before = state
        while True:
            self.owed = max(self.owed - 1, 0)
            self._pass_events()
            # a frame before may have closed a box
            self._navigate(state.panel)
            imgui.backends.opengl3_new_frame()
            imgui.new_frame()
            state = draw(state)
            imgui.render()
            self.io.delta_time = 1e-4
            if not self.owed or state is not before or self.panel.widgets.effects:
                return state

    def _navigate(self, is_shown: bool) -> None:
        """Lets keys go through widgets, in the panel if it has the keys, and in boxes."""
        self.focused &= is_shown
        navigates = imgui.ConfigFlags_.nav_enable_keyboard.value
        if self.panel.takes_moves or (self.focused and not self.panel.popup):
            self.io.config_flags |= navigates
        else:
            self.io.config_flags &= ~navigates
            imgui.set_nav_cursor_visible(False)

    def close(self) -> None:
        """Frees Dear ImGui's GPU resources and its context."""
        with current(self.window.screen.ctx):
            self.panel.gallery.close()
            imgui.backends.opengl3_shutdown()
        implot.destroy_context(self.plots)
        imgui.destroy_context(self.context)


def _load_font() -> None:
    """Loads a font with Latin, Greek and Cyrillic letters, which the library's own bitmaps lack."""
    file = Path(imgui_bundle.__file__).parent / "assets" / "fonts" / "Roboto" / "Roboto-Regular.ttf"
    if file.exists():
        imgui.get_io().fonts.add_font_from_file_ttf(str(file), FONT)


# sRGB of the panel by theme: background, fields, lines, text, and the one colour of what is active
COLORS: dict[str, tuple[tuple[float, float, float], ...]] = {
    "dark": ((0.11, 0.12, 0.13), (0.19, 0.2, 0.22), (0.28, 0.3, 0.33), (0.9, 0.91, 0.92), (0.3, 0.55, 0.85)),
    "light": ((0.95, 0.95, 0.96), (0.86, 0.87, 0.88), (0.75, 0.76, 0.78), (0.1, 0.1, 0.12), (0.22, 0.48, 0.82)),
}
# what each of these colours is for, by opacity: the accent is that of grabs and of hovered or pressed widgets
USES: tuple[dict[float, tuple[str, ...]], ...] = (
    {1.0: ("window_bg", "title_bg", "title_bg_active", "title_bg_collapsed", "menu_bar_bg", "popup_bg")},
    {1.0: ("frame_bg", "button", "scrollbar_grab", "tab", "checkbox_selected_bg"), 0.0: ("scrollbar_bg",)},
    {1.0: ("border", "separator", "frame_bg_hovered"), 0.5: ("header_hovered", "table_row_bg_alt")},
    {1.0: ("text",), 0.65: ("text_disabled",)},
    {
        1.0: ("check_mark", "slider_grab_active", "input_text_cursor", "nav_cursor"),
        0.6: ("slider_grab", "button_active", "header_active", "frame_bg_active", "scrollbar_grab_active"),
        0.5: ("button_hovered", "text_selected_bg", "tab_hovered", "tab_selected", "scrollbar_grab_hovered"),
        0.3: ("header",),
    },
)


def _shape_widgets() -> None:
    """Sets flat widgets, and sections apart by space alone."""
    style = imgui.get_style()
    style.window_rounding = style.frame_rounding = style.popup_rounding = style.grab_rounding = 3.0
    style.window_border_size = style.frame_border_size = 0.0
    style.window_padding, style.frame_padding = imgui.ImVec2(10.0, 8.0), imgui.ImVec2(6.0, 3.0)
    style.item_spacing, style.item_inner_spacing = imgui.ImVec2(8.0, 5.0), imgui.ImVec2(6.0, 3.0)
    # the cursor may have moved a little before the latest frame
    style.hover_delay_short = 0.8 * TOOLTIP
    style.set_color_(imgui.Col_.modal_window_dim_bg, imgui.ImVec4(0.0, 0.0, 0.0, 0.6))


def _color(theme: str) -> None:
    """Sets the colours of a theme."""
    style = imgui.get_style()
    for color, opacities in zip(COLORS[theme], USES, strict=True):
        for opacity, names in opacities.items():
            for name in names:
                style.set_color_(getattr(imgui.Col_, name), imgui.ImVec4(*color, opacity))


def _fit_plots(scale: float) -> None:
    """Sets narrow margins for plots, and no mouse buttons but the drag that moves an axis."""
    style, keys = implot.get_style(), implot.get_input_map()
    style.plot_padding = imgui.ImVec2(2.0 * scale, 4.0 * scale)
    style.label_padding = imgui.ImVec2(3.0 * scale, 3.0 * scale)
    for name in ("major_tick_len", "minor_tick_len", "major_tick_size", "minor_tick_size"):
        size = getattr(style, name)
        setattr(style, name, imgui.ImVec2(size.x * scale, size.y * scale))
    # a double click adds a point instead
    keys.fit = imgui.MouseButton_.middle
