"""GLFW windows, hidden or shown; without a display, GLFW's null platform drawing through OSMesa."""

from __future__ import annotations

import ctypes
import os
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from splatgl.gl.loader import BackendError, Loader, newest

HIDDEN_SIZE = (16, 16)  # pixels; a hidden window is never drawn to


class WindowLoader(Loader):
    """The OpenGL context of a GLFW window, which is destroyed with it. GLFW requires the main thread."""

    backend = "window"

    def __init__(self, size: tuple[int, int] = HIDDEN_SIZE, title: str = "splatgl", visible: bool = False) -> None:
        super().__init__("the window system's OpenGL" if _has_display() else "OSMesa")
        self.window = _create(size, title, visible)
        self.make_current()

    def address(self, name: str) -> int:
        """Address of an OpenGL function as GLFW finds it, 0 if there is none."""
        import glfw

        address = glfw.get_proc_address(name)
        return ctypes.cast(address, ctypes.c_void_p).value or 0 if address else 0

    def bind(self) -> None:
        """Makes the window's context current; raises BackendError if GLFW refuses."""
        import glfw

        with _glfw_errors():
            glfw.make_context_current(self.window)

    def holds(self) -> bool:
        """Whether GLFW's current context is this window's."""
        import glfw

        current = glfw.get_current_context()
        return bool(current) and ctypes.addressof(current.contents) == ctypes.addressof(self.window.contents)

    def unbind(self) -> None:
        """Leaves no GLFW context current."""
        import glfw

        with _glfw_errors():
            glfw.make_context_current(None)  # type: ignore[arg-type]

    def destroy(self) -> None:
        """Destroys the window and its context."""
        import glfw

        with _glfw_errors():
            glfw.destroy_window(self.window)


def _create(size: tuple[int, int], title: str, visible: bool) -> Any:
    """A GLFW window with the newest core context that there is."""
    try:
        import glfw
    except ImportError as error:
        raise BackendError(f"GLFW could not be loaded ({error})") from error
    with _glfw_errors():
        # Without a display only the null platform starts, and only with OSMesa
        headless = not _has_display()
        glfw.init_hint(glfw.PLATFORM, glfw.PLATFORM_NULL if headless else glfw.ANY_PLATFORM)
        started = glfw.init()
    if not started:
        raise BackendError("GLFW did not start")

    def create(major: int, minor: int) -> Any:
        window = None
        with _glfw_errors():
            _hint(glfw, visible, (major, minor))
            window = glfw.create_window(*size, title, None, None)
        if not window:
            raise BackendError("GLFW made no window")
        return window

    return newest(create)


def _hint(glfw: Any, visible: bool, version: tuple[int, int]) -> None:
    """Sets the hints for windows created from now on."""
    glfw.default_window_hints()
    if glfw.get_platform() == glfw.PLATFORM_NULL:
        glfw.window_hint(glfw.CONTEXT_CREATION_API, glfw.OSMESA_CONTEXT_API)
    glfw.window_hint(glfw.CONTEXT_VERSION_MAJOR, version[0])
    glfw.window_hint(glfw.CONTEXT_VERSION_MINOR, version[1])
    glfw.window_hint(glfw.OPENGL_PROFILE, glfw.OPENGL_CORE_PROFILE)
    glfw.window_hint(glfw.OPENGL_FORWARD_COMPAT, sys.platform == "darwin")  # required by macOS, refused by OSMesa
    glfw.window_hint(glfw.VISIBLE, visible)


def _has_display() -> bool:
    """Whether the environment names a display; always true on macOS and Windows."""
    if sys.platform in ("darwin", "win32"):
        return True
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


@contextmanager
def _glfw_errors() -> Iterator[None]:
    """Turns GLFW's errors, by default warnings, into a BackendError."""
    import glfw

    glfw.get_error()  # clears earlier errors
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", glfw.GLFWError)
        yield
    code, description = glfw.get_error()
    if code != glfw.NO_ERROR:
        raise BackendError(description.decode() if isinstance(description, bytes) else str(description))
