"""Dear ImGui backend: passes GLFW events in and draws into the window. Needs the extra `gui`."""

from __future__ import annotations

import time
from typing import Any

from imgui_bundle import imgui

from splatgl.app.viewer.content import Content
from splatgl.app.viewer.hud import Frame
from splatgl.app.viewer.panel import Panel
from splatgl.app.viewer.state import State
from splatgl.app.viewer.window import Window
from splatgl.gl.context import current

GLSL = "#version 330"
RELEASE = 0
# GLFW codes of the keys used by text fields; letters are for ctrl+A, C, V, X, Z
KEYS = {
    256: imgui.Key.escape,
    257: imgui.Key.enter,
    335: imgui.Key.enter,
    259: imgui.Key.backspace,
    261: imgui.Key.delete,
    262: imgui.Key.right_arrow,
    263: imgui.Key.left_arrow,
    264: imgui.Key.down_arrow,
    265: imgui.Key.up_arrow,
    268: imgui.Key.home,
    269: imgui.Key.end,
    **{ord(letter): getattr(imgui.Key, letter.lower()) for letter in "ACVXZ"},
}
MODIFIERS = ((1, imgui.Key.mod_shift), (2, imgui.Key.mod_ctrl), (4, imgui.Key.mod_alt))


class Gui:
    """A panel in a window."""

    def __init__(self, window: Window) -> None:
        self.window = window
        self.panel = Panel()
        self.cursor: tuple[float, ...] = (-1.0, -1.0)
        self.context = imgui.create_context()
        self.io = imgui.get_io()
        # no ini file
        self.io.set_ini_filename("")
        self.last = time.perf_counter()
        with current(window.screen.ctx):
            imgui.backends.opengl3_init(GLSL)
        imgui.get_style().window_rounding = 4.0
        imgui.get_style().font_scale_main = window.scale

    def event(self, kind: str, *values: Any) -> bool:
        """Handles a GLFW event; True if the panel consumed it."""
        io = self.io
        if kind == "cursor":
            io.add_mouse_pos_event(*values)
            self.cursor = values
            return False
        if kind in ("button", "scroll"):
            if kind == "button":
                io.add_mouse_button_event(values[0], values[1] != RELEASE)
            else:
                io.add_mouse_wheel_event(*values)
            # ImGui's own flag is one frame old: the cursor may have moved since
            return self.panel.covers(*self.cursor)
        # keys go to the panel only while a text field is active
        if kind == "character":
            io.add_input_character(values[0])
        else:
            code, action, bits = values
            for bit, key in MODIFIERS:
                io.add_key_event(key, bool(bits & bit))
            if code in KEYS:
                io.add_key_event(KEYS[code], action != RELEASE)
        return bool(io.want_text_input)

    def frame(self, state: State, content: Content, frame: Frame | None) -> State:
        """Draws the panel over the window's back buffer; returns the edited state."""
        now = time.perf_counter()
        width, height = self.window.glfw.get_window_size(self.window.handle)
        pixels = self.window.size
        self.io.display_size = imgui.ImVec2(width, height)
        self.io.display_framebuffer_scale = imgui.ImVec2(pixels[0] / max(width, 1), pixels[1] / max(height, 1))
        self.io.delta_time = max(now - self.last, 1e-4)
        self.last = now
        with current(self.window.screen.ctx):
            imgui.backends.opengl3_new_frame()
            imgui.new_frame()
            state = self.panel.draw(state, content, frame, (width, height))
            imgui.render()
            imgui.backends.opengl3_render_draw_data(imgui.get_draw_data())
        return state

    def close(self) -> None:
        """Frees Dear ImGui's GPU resources and its context."""
        with current(self.window.screen.ctx):
            imgui.backends.opengl3_shutdown()
        imgui.destroy_context(self.context)
