"""GLFW window: passes events to a `Viewer`, with positions in image pixels."""

from __future__ import annotations

import ctypes
import ctypes.util
import os
import sys
from typing import TYPE_CHECKING, Any

from splatgl.annotations.text import legible
from splatgl.gl.backends import BackendError
from splatgl.gl.screen import Screen
from splatgl.viewer.input import from_character, from_key, modifiers
from splatgl.viewer.trackball import Place, Pointer

if TYPE_CHECKING:
    from splatgl.viewer.viewer import Viewer

BUTTONS = ("left", "right", "middle")
# offsets of resourceid and error_code in Xlib's XErrorEvent
RESOURCE, CODE = 16, 32
# smallest window, in screen coordinates
SMALLEST = 64


class Window:
    """A screen's window: events, size and title."""

    def __init__(self, screen: Screen, listener: Viewer) -> None:
        import glfw

        self.glfw, self.screen, self.listener, self.handle = glfw, screen, listener, screen.window
        self.errors = XErrors(self.handle)
        # cursor position at the time of an event: a later query may return a newer one
        self.at: Place = self._pixels(*glfw.get_cursor_pos(self.handle))
        # place and size before fullscreen
        self.before: tuple[int, int, int, int] | None = None
        # as warnings, whose filters other threads change; failures that matter are checked where they occur
        glfw.ERROR_REPORTING = "ignore"
        glfw.swap_interval(1)
        glfw.set_window_size_limits(self.handle, SMALLEST, SMALLEST, glfw.DONT_CARE, glfw.DONT_CARE)
        glfw.set_key_callback(self.handle, self._key)
        glfw.set_char_callback(self.handle, self._character)
        glfw.set_mouse_button_callback(self.handle, self._button)
        glfw.set_cursor_pos_callback(self.handle, self._cursor)
        glfw.set_scroll_callback(self.handle, self._scroll)
        glfw.set_drop_callback(self.handle, self._drop)  # type: ignore[arg-type]
        glfw.set_framebuffer_size_callback(self.handle, lambda _, width, height: listener.resize((width, height)))
        glfw.set_window_refresh_callback(self.handle, lambda _: listener.refresh())

    @property
    def unit_size(self) -> tuple[int, int]:
        """Width and height in screen units, those before fullscreen."""
        width, height = self.before[2:] if self.before else self.glfw.get_window_size(self.handle)
        return int(width), int(height)

    @property
    def size(self) -> tuple[int, int]:
        """Pixels; (0, 0) while minimised."""
        width, height = self.glfw.get_framebuffer_size(self.handle)
        # of a window that is gone they are any numbers
        self.errors.check()
        return int(width), int(height)

    @property
    def scale(self) -> float:
        """Content scale of the display, for text, at least 1."""
        return max(1.0, float(self.glfw.get_window_content_scale(self.handle)[1]))

    @property
    def held(self) -> bool:
        """Whether a button is down."""
        buttons = range(len(BUTTONS))
        return any(self.glfw.get_mouse_button(self.handle, button) == self.glfw.PRESS for button in buttons)

    @property
    def closing(self) -> bool:
        """Whether the user asked to close the window."""
        return bool(self.glfw.window_should_close(self.handle))

    def stay(self) -> None:
        """Cancels the user's request to close the window."""
        self.glfw.set_window_should_close(self.handle, False)

    def wait(self, seconds: float) -> None:
        """Handles events; waits for the first at most `seconds`."""
        if seconds > 0:
            self.glfw.wait_events_timeout(seconds)
        else:
            self.glfw.poll_events()
        self.errors.check()

    def wake(self) -> None:
        """Ends a wait; callable from any thread."""
        self.glfw.post_empty_event()

    def fill(self, whole: bool) -> None:
        """Enters or leaves fullscreen."""
        if whole == (self.before is not None):
            return
        monitor = self.glfw.get_primary_monitor() if whole else None
        if monitor:
            self.before = (*self.glfw.get_window_pos(self.handle), *self.glfw.get_window_size(self.handle))
            mode = self.glfw.get_video_mode(monitor)
            size = mode.size
            self.glfw.set_window_monitor(self.handle, monitor, 0, 0, size.width, size.height, mode.refresh_rate)
        elif self.before is not None:
            self.glfw.set_window_monitor(self.handle, None, *self.before, self.glfw.DONT_CARE)  # type: ignore[arg-type]
            self.before = None

    def title(self, text: str) -> None:
        """Sets the text of the title bar."""
        self.glfw.set_window_title(self.handle, legible(text))

    def copy(self, text: str) -> None:
        """Puts text on the clipboard."""
        self.glfw.set_clipboard_string(self.handle, text)

    def show(self) -> None:
        """Swaps the buffers."""
        self.glfw.swap_buffers(self.handle)

    def _pixels(self, x: float, y: float) -> Place:
        size, window = self.size, self.glfw.get_window_size(self.handle)
        return x * size[0] / max(window[0], 1), y * size[1] / max(window[1], 1)

    def _key(self, _: Any, code: int, scan: int, action: int, bits: int) -> None:
        if self.listener.raw("key", code, action, bits) or action == self.glfw.RELEASE:
            return
        chord = from_key(code, self.glfw.get_key_name(code, scan), bits)
        if chord:
            self.listener.key(chord)

    def _character(self, _: Any, code: int) -> None:
        if not self.listener.raw("character", code) and (chord := from_character(chr(code))):
            self.listener.key(chord)

    def _button(self, _: Any, button: int, action: int, bits: int) -> None:
        taken = self.listener.raw("button", button, action, bits)
        if button >= len(BUTTONS):
            return
        # releases are always passed on: the press may predate the cursor's entry into the panel
        if action == self.glfw.RELEASE:
            self.listener.mouse("release", Pointer(self.at, BUTTONS[button], modifiers(bits)))
        elif not taken:
            self.listener.mouse("press", Pointer(self.at, BUTTONS[button], modifiers(bits)))

    def _cursor(self, _: Any, x: float, y: float) -> None:
        self.listener.raw("cursor", x, y)
        self.at = self._pixels(x, y)
        self.listener.mouse("move", Pointer(self.at))

    def _scroll(self, _: Any, x: float, y: float) -> None:
        if not self.listener.raw("scroll", x, y):
            self.listener.mouse("wheel", Pointer(self.at, notches=y))

    def _drop(self, _: Any, paths: Any) -> None:
        self.listener.drop([os.fsdecode(path) for path in paths])


class XErrors:
    """Errors of X on the display of a window: of the window and of the display they are kept, others are ignored, such
    as those of the source of a drag that ends. Those of other displays go to the handler before.
    """

    def __init__(self, handle: Any) -> None:
        self.message, self.is_raised = "", False
        name = ctypes.util.find_library("X11") if sys.platform.startswith("linux") else None
        self.library = None if name is None else ctypes.CDLL(name)
        import glfw

        # GLFW for Wayland has none of these; 0 means no such window
        display = getattr(glfw, "get_x11_display", lambda: None)()
        if self.library is None or not display or not hasattr(self.library, "XSetIOErrorExitHandler"):
            self.library = None
            return
        here = self.display = ctypes.cast(display, ctypes.c_void_p).value
        ways = (getattr(glfw, name, None) for name in ("get_x11_window", "get_glx_window"))
        windows = {way(handle) for way in ways if way is not None} - {0, None}

        def failed(where: int, event: int) -> int:
            if where != here:
                return int(self.before(where, event)) if self.before else 0
            number = ctypes.string_at(event, CODE + 1)[CODE]
            # nearly always BadWindow (3) or BadDrawable (9)
            if ctypes.c_ulong.from_address(event + RESOURCE).value in windows:
                self.message = self.message or f"the window went away (X error {number})"
            return 0

        def broken(where: int) -> int:
            if where != here:
                return int(self.before_end(where)) if self.before_end else 0
            self.message = "the display went away"
            return 0

        # kept while C calls them; the last one stands for Xlib's own, which ends the process
        self.callbacks = HANDLER(failed), ENDED(broken), EXIT(lambda *_: None)
        self.library.XSetErrorHandler.restype, self.library.XSetIOErrorHandler.restype = HANDLER, ENDED
        self.before = self.library.XSetErrorHandler(self.callbacks[0])
        self.before_end = self.library.XSetIOErrorHandler(self.callbacks[1])
        self.library.XSetIOErrorExitHandler(ctypes.c_void_p(here), self.callbacks[2], None)

    def check(self) -> None:
        """Raises BackendError if the window or its display is gone, once: what is closed then has no window."""
        if self.message and not self.is_raised:
            self.is_raised = True
            raise BackendError(self.message)

    def close(self) -> None:
        """Hands the errors back to the handlers before; those of a window that is gone may still come."""
        if self.library is not None and not self.message:
            self.library.XSync(ctypes.c_void_p(self.display), 0)
            self.library.XSetErrorHandler(self.before)
            self.library.XSetIOErrorHandler(self.before_end)
            self.library = None


# Xlib's handlers of errors, of the end of a display, and of the exit after it
HANDLER = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_void_p, ctypes.c_void_p)
ENDED = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_void_p)
EXIT = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p)
