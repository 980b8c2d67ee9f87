"""Window systems (EGL, GLX, WGL of Windows, CGL of macOS), which report the context that is current in a thread."""

from __future__ import annotations

import ctypes
import os
import sys
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple


class Api(NamedTuple):
    """Functions of a window system. getters: return the arguments with which make_current binds the current context;
    the last argument is the context.
    """

    library: str
    make_current: str
    getters: tuple[str, ...]


EGL = Api(
    "libEGL.so.1",
    "eglMakeCurrent",
    ("eglGetCurrentDisplay", "eglGetCurrentSurface", "eglGetCurrentSurface", "eglGetCurrentContext"),
)
GLX = Api(
    "libGL.so.1",
    "glXMakeContextCurrent",
    ("glXGetCurrentDisplay", "glXGetCurrentDrawable", "glXGetCurrentReadDrawable", "glXGetCurrentContext"),
)
WGL = Api(
    os.environ.get("GLCONTEXT_WIN_LIBGL") or "opengl32.dll",
    "wglMakeCurrent",
    ("wglGetCurrentDC", "wglGetCurrentContext"),
)
CGL = Api("/System/Library/Frameworks/OpenGL.framework/OpenGL", "CGLSetCurrentContext", ("CGLGetCurrentContext",))
# window systems whose contexts other libraries may have made current
HOSTS = {"win32": (WGL,), "darwin": (CGL,)}.get(sys.platform, (EGL, GLX))
# from egl.h
EGL_DRAW, EGL_READ = 0x3059, 0x305A


@dataclass(frozen=True)
class Host:
    """Context of another library that is current in this thread. unbind: leaves no context of its window system
    current. bind: makes it current again, on the surfaces that it was drawing to.
    """

    unbind: Callable[[], object]
    bind: Callable[[], object]


def current_host() -> Host | None:
    """Returns the context that is current in this thread: another library's, while no loader is current."""
    for api in HOSTS:
        library = _in_process(api)
        if library is not None and current_handle(library, api):
            return _host_of(library, api)
    return None


def load(name: str, api: Api, mode: int = ctypes.DEFAULT_MODE) -> ctypes.CDLL:
    """Loads a library with the types of its functions: without them handles are cut to 32 bits. Raises OSError, and
    AttributeError without these functions.
    """
    # functions of Windows have a calling convention of their own
    library: ctypes.CDLL = getattr(ctypes, "WinDLL", ctypes.CDLL)(name, mode=mode)
    for function in api.getters:
        getattr(library, function).restype = ctypes.c_void_p
    getattr(library, api.make_current).argtypes = [ctypes.c_void_p] * len(api.getters)
    return library


def current_handle(library: ctypes.CDLL, api: Api) -> int | None:
    """Returns the handle of the window system's current context."""
    handle: int | None = getattr(library, api.getters[-1])()
    return handle


def _host_of(library: ctypes.CDLL, api: Api) -> Host:
    make_current = getattr(library, api.make_current)
    if api is EGL:
        interface, display = library.eglQueryAPI(), library.eglGetCurrentDisplay()
        surfaces = library.eglGetCurrentSurface(EGL_DRAW), library.eglGetCurrentSurface(EGL_READ)
        values = [display, *surfaces, current_handle(library, api)]
    else:
        values = [getattr(library, name)() for name in api.getters]

    def bind() -> None:
        if api is EGL:
            library.eglBindAPI(interface)
        make_current(*values)

    # the display stays, the rest is nothing
    nothing = [*values[:-1][:1], None, None, None][: len(values)]
    return Host(partial(make_current, *nothing), bind)


# loaded libraries
_libraries: dict[Api, ctypes.CDLL] = {}


def _in_process(api: Api) -> ctypes.CDLL | None:
    """Returns a library that the process has loaded, or None; that of Windows and of macOS is always there."""
    mode = getattr(os, "RTLD_NOLOAD", None) if api in (EGL, GLX) else ctypes.DEFAULT_MODE
    if api not in _libraries and mode is not None:
        try:
            _libraries[api] = load(api.library, api, mode)
        except (OSError, AttributeError):
            # not loaded, or without the functions of that window system
            return None
    return _libraries.get(api)
