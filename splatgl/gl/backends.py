"""Opens contexts: headless ones of the platform (EGL, WGL of Windows, CGL of macOS), OSMesa's and GLFW's.

OpenGL keeps one current context per thread, and the window systems are independent: if an EGL context is made current
while an OSMesa one is, calls go to the wrong one. Each thread therefore stores its current loader and unbinds it before
it binds another. The current context of another library of the process (Qt, VTK, another moderngl) is unbound before
a context of this module is bound, and bound again afterwards.

A forked process has its parent's context memory, but not its threads and connections: with llvmpipe, draw calls hang,
even in a new context of a library that the parent had used. This module refuses both.
"""

from __future__ import annotations

import ctypes
import os
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from typing import Any, ClassVar, NamedTuple, Protocol, TypeVar

from splatgl.errors import expected
from splatgl.platforms import BACKENDS, has_display


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


Opened = TypeVar("Opened")
# core profiles in the order of the attempts: some drivers give exactly the requested version. 4.3 has compute shaders,
# 3.3 is the oldest with instanced attributes and float targets
VERSIONS = ((4, 6), (4, 5), (4, 3), (3, 3))
SPAWN = 'start worker processes with multiprocessing.get_context("spawn"), and open a Renderer in each'


class BackendError(Exception):
    """A backend is unavailable; the message gives the reason in one line."""


class ContextLost(BackendError):
    """Another library ended the display of a context, and with it the context."""


def newest(create: Callable[[int, int], Opened]) -> Opened:
    """Returns `create(major, minor)` for the newest version that opens; raises BackendError if none does."""
    refusal = BackendError("no OpenGL")
    for version in VERSIONS:
        try:
            return create(*version)
        except BackendError as error:
            refusal = error
    raise refusal


class _Thread(threading.local):
    """State of a thread: the current loader, the context of another library that was current before it, and the loader
    that was current when a fork began.
    """

    current: Loader | None = None
    host: Host | None = None
    forking: Loader | None = None


class _Process:
    """State of the process: OpenGL libraries that it opened, libraries that its parent opened before the fork, and the
    number of forks.
    """

    opened: ClassVar[set[str]] = set()
    inherited: ClassVar[set[str]] = set()
    forks: ClassVar[int] = 0


_thread = _Thread()


def _before_fork() -> None:
    """Unbinds the current context: the child cannot, and other window systems would refuse their contexts there."""
    loader = _thread.current
    _thread.forking = loader if loader is not None and loader.system.holds() else None
    if _thread.forking is not None:
        switch_to(None)


def _in_parent() -> None:
    if _thread.forking is not None:
        switch_to(_thread.forking)


def _in_child() -> None:
    """Marks all opened libraries as inherited."""
    _thread.current = _thread.forking = _thread.host = None
    _Process.inherited |= _Process.opened
    _Process.forks += 1


# Windows does not fork
if hasattr(os, "register_at_fork"):
    os.register_at_fork(before=_before_fork, after_in_parent=_in_parent, after_in_child=_in_child)


class System(Protocol):
    """A context of a window system. backend: one of BACKENDS."""

    backend: str

    def address(self, name: str) -> int:
        """Returns the address of an OpenGL function, 0 if there is none; the context must be current."""

    def bind(self) -> None:
        """Makes this context current; raises BackendError if the system cannot."""

    def unbind(self) -> None:
        """Leaves no context of this window system current."""

    def destroy(self) -> None:
        """Frees the context, which must not be current."""

    def holds(self) -> bool:
        """Whether the system reports this context as current; other libraries may have switched it."""


class Loader:
    """A core context of OpenGL 3.3 or newer for moderngl's `create_context(context=loader)`.

    As a context manager it makes its context current and restores the previous one on exit.
    create: creates the context; library: the OpenGL implementation. Raises BackendError if a parent process opened it
    before the fork.
    """

    def __init__(self, library: str, create: Callable[[], System]) -> None:
        if library in _Process.inherited:
            raise BackendError(f"{library} was opened before this process was forked, and its threads were left behind")
        _Process.opened.add(library)
        # some libraries make a new context current, others refuse to create one while another is current
        leave()
        self._before: list[Loader | None] = []
        self._released = False
        self._forks = _Process.forks
        self.system = create()
        self.make_current()

    @property
    def inherited(self) -> bool:
        """Whether the context was opened before this process was forked."""
        return self._forks != _Process.forks

    def check_process(self) -> None:
        """Raises InputError in a forked process for a context of its parent."""
        if self.inherited:
            raise expected("context", "one opened in this process", "one from before it was forked", SPAWN)

    def load_opengl_function(self, name: str) -> int:
        """Returns the address of an OpenGL function; moderngl calls this method."""
        return self.system.address(name)

    def make_current(self) -> Loader | None:
        """Makes this context current in this thread and returns the loader that was current before. Raises InputError
        for an inherited context.
        """
        self.check_process()
        before = _thread.current
        if before is not None and not before.system.holds():
            # another library has switched: its context is restored on exit, or `before` if it left none current
            _thread.current = None
            before = None if current_host() else before
        if before is not self or _thread.current is None:
            switch_to(self)
        return before

    def __enter__(self) -> Loader:
        self._before.append(self.make_current())
        return self

    def __exit__(self, *_: object) -> None:
        switch_to(self._before.pop())

    def release(self) -> None:
        """Frees the context; no effect on a second call or in a forked process that inherited it."""
        if self._released or self.inherited:
            return
        if _thread.current is self:
            switch_to(None)
        self._released = True
        self.system.destroy()


def current_loader() -> Loader | None:
    """Returns the loader whose context is current in this thread, or None."""
    return _thread.current


def forked() -> bool:
    """Whether this process was forked from a process that had opened an OpenGL library."""
    return bool(_Process.inherited)


def switch_to(loader: Loader | None) -> None:
    """Makes `loader` current in this thread. None, a released or an inherited loader leaves no loader current and
    binds the earlier context of another library again.
    """
    target = None if loader is None or loader._released or loader.inherited else loader
    if _thread.current is target and (target is not None or _thread.host is None):
        return
    leave()
    try:
        if target is not None:
            target.system.bind()
            _thread.current = target
    finally:
        if _thread.current is None and _thread.host is not None:
            host, _thread.host = _thread.host, None
            host.bind()


def leave() -> None:
    """Leaves no context current in this thread; stores the context of another library for `switch_to`."""
    loader, _thread.current = _thread.current, None
    if loader is not None and (loader.system.holds() or current_host() is None):
        loader.system.unbind()
    # another library may have made a context current meanwhile
    other = current_host()
    if other is not None:
        other.unbind()
        _thread.host = other


def restore_context() -> None:
    """Makes the context of another library current again that was current before, if any: the library may destroy it
    later.
    """
    if _thread.host is not None:
        switch_to(None)


@contextmanager
def restored() -> Iterator[None]:
    """Restores the thread's current context after the block: another thread may need a context opened in it."""
    before = _thread.current
    try:
        yield
    finally:
        switch_to(before)


EGL_OPENGL_API, EGL_BAD_ACCESS = 0x30A2, 0x3002  # egl.h
EGL_LIBRARIES = ("libEGL.so.1", "libEGL.so")
# Any of these finds the functions; EGL itself serves if libGL, which X needs, is not installed
GL_LIBRARIES = ("libGL.so.1", "libOpenGL.so.0", *EGL_LIBRARIES)


# module of glcontext, and functions of the window system, of each backend
HEADLESS = {"egl": ("egl", EGL), "wgl": ("wgl", WGL), "cgl": ("darwin", CGL)}


class Headless:
    """Context that glcontext opens without a display: backend egl, wgl or cgl. device: of EGL, counted from 0 in the
    driver's order.
    """

    def __init__(self, backend: str, device: int = 0) -> None:
        self.backend, self._name = backend, backend.upper()
        self._context, self._library = _create_headless(backend, device)
        self._handle: int | None = None
        # glcontext leaves the new context current
        host = current_host()
        if host is not None:
            host.unbind()

    def address(self, name: str) -> int:
        """Returns the address of an OpenGL function from glcontext, 0 if there is none."""
        return int(self._context.load_opengl_function(name))

    def bind(self) -> None:
        """Makes the context current and stores its handle; raises BackendError if the system cannot."""
        is_egl = self.backend == "egl"
        if is_egl:
            # a host may have chosen OpenGL ES
            self._library.eglBindAPI(EGL_OPENGL_API)
        self._context.__enter__()
        refused = is_egl and self._library.eglGetError() == EGL_BAD_ACCESS
        handle = self._current()
        if refused or (not handle and not is_egl):
            raise BackendError(f"{self._name}'s context is current in another thread; give each thread a Renderer")
        if not handle or handle != (self._handle or handle):
            gone = f"{self._name}'s context is gone, as another library ended its display"
            raise ContextLost(f"{gone}; open another Renderer")
        self._handle = handle

    def _current(self) -> int | None:
        return current_handle(self._library, HEADLESS[self.backend][1])

    def holds(self) -> bool:
        """Whether the window system's current context is this one."""
        return bool(self._current() == self._handle)

    def unbind(self) -> None:
        """Leaves no context of the window system current."""
        self._context.__exit__(None, None, None)

    def destroy(self) -> None:
        """Frees the context. What is current stays current, which WGL and CGL do not provide for."""
        host = None if self.backend == "egl" else current_host()
        self._context.release()
        if host is not None:
            host.bind()


def device_count() -> int:
    """Returns the number of EGL devices, 0 if EGL cannot count them or the platform has none."""
    if "egl" not in BACKENDS:
        return 0
    egl = ctypes.CDLL(_first_library("GLCONTEXT_LINUX_LIBEGL", EGL_LIBRARIES))
    egl.eglGetProcAddress.restype = ctypes.c_void_p
    egl.eglGetProcAddress.argtypes = [ctypes.c_char_p]
    address = egl.eglGetProcAddress(b"eglQueryDevicesEXT")
    if not address:
        return 0
    query = ctypes.CFUNCTYPE(ctypes.c_uint, ctypes.c_int, ctypes.c_void_p, ctypes.POINTER(ctypes.c_int))(address)
    count = ctypes.c_int(0)
    return count.value if query(0, None, ctypes.byref(count)) else 0


def _create_headless(backend: str, device: int) -> tuple[Any, ctypes.CDLL]:
    """Returns glcontext's context and the library that reports the current context. Raises BackendError for the
    bare Exceptions of glcontext.
    """
    name, api = HEADLESS[backend]
    try:
        # only the modules of this platform are built
        module = import_module(f"glcontext.{name}")
    except ImportError as error:
        raise BackendError(f"glcontext has no {backend.upper()} here ({error})") from error
    library, options = api.library, dict[str, Any]()
    if backend == "egl":
        library = _first_library("GLCONTEXT_LINUX_LIBEGL", EGL_LIBRARIES)
        libgl = _first_library("GLCONTEXT_LINUX_LIBGL", GL_LIBRARIES)
        options = {"libgl": libgl, "libegl": library, "device_index": device}
    elif backend == "wgl":
        options = {"libgl": library}

    def create(major: int, minor: int) -> Any:
        # macOS always gives its newest version
        version = {} if backend == "cgl" else {"glversion": 100 * major + 10 * minor}
        try:
            return module.create_context(mode="standalone", **options, **version)
        except Exception as error:
            raise BackendError(str(error)) from error

    try:
        return newest(create), load(library, api)
    except (OSError, AttributeError) as error:
        raise BackendError(f"{library} could not be loaded ({error})") from error


def _first_library(variable: str, names: tuple[str, ...]) -> str:
    """Returns the environment variable's library or the first of `names` that loads; BackendError if none does."""
    if os.environ.get(variable):
        names = (os.environ[variable],)
    for name in names:
        try:
            ctypes.CDLL(name)
        except OSError:
            continue
        return name
    raise BackendError(f"{names[0]} is not installed")


LIBRARIES = ("libOSMesa.so.8", "libOSMesa.so.6", "libOSMesa.so")
# From osmesa.h and gl.h
OSMESA_FORMAT, OSMESA_DEPTH_BITS, OSMESA_PROFILE, OSMESA_CORE_PROFILE = 0x22, 0x30, 0x33, 0x34
OSMESA_MAJOR, OSMESA_MINOR = 0x36, 0x37
GL_RGBA, GL_UNSIGNED_BYTE = 0x1908, 0x1401
# OSMesa requires a colour buffer in memory; nothing is drawn to it, so the smallest suffices
BUFFER_SIDE = 1  # pixels
BUFFER_BYTES = 4 * BUFFER_SIDE * BUFFER_SIDE


class Osmesa:
    """OSMesa context of a core profile."""

    backend = "osmesa"

    def __init__(self) -> None:
        self._library = _library()
        self._context = newest(self._create)
        self._buffer = ctypes.create_string_buffer(BUFFER_BYTES)

    def _create(self, major: int, minor: int) -> int:
        attributes = (OSMESA_FORMAT, GL_RGBA, OSMESA_DEPTH_BITS, 0, OSMESA_PROFILE, OSMESA_CORE_PROFILE)
        version = (OSMESA_MAJOR, major, OSMESA_MINOR, minor, 0)
        packed = (ctypes.c_int * (len(attributes) + len(version)))(*attributes, *version)
        context = self._library.OSMesaCreateContextAttribs(packed, None)
        if not context:
            raise BackendError(f"OSMesa made no OpenGL {major}.{minor} core context")
        return int(context)

    def address(self, name: str) -> int:
        """Returns the address of an OpenGL function from OSMesaGetProcAddress, 0 if there is none."""
        return self._library.OSMesaGetProcAddress(name.encode()) or 0

    def bind(self) -> None:
        """Makes the context current on its small buffer; raises BackendError if OSMesa cannot."""
        side = BUFFER_SIDE
        if not self._library.OSMesaMakeCurrent(self._context, self._buffer, GL_UNSIGNED_BYTE, side, side):
            raise BackendError("OSMesa could not make its context current")

    def holds(self) -> bool:
        """Whether this is OSMesa's current context and no other window system has one, which would get the calls."""
        return bool(self._library.OSMesaGetCurrentContext() == self._context) and current_host() is None

    def unbind(self) -> None:
        """Leaves no OSMesa context current."""
        self._library.OSMesaMakeCurrent(None, None, GL_UNSIGNED_BYTE, 0, 0)

    def destroy(self) -> None:
        """Frees the OSMesa context."""
        self._library.OSMesaDestroyContext(self._context)


def _library() -> ctypes.CDLL:
    """Loads libOSMesa and sets its functions' types; without them pointers are truncated to 32 bits."""
    for name in LIBRARIES:
        try:
            library = ctypes.CDLL(name)
        except OSError:
            continue
        if not hasattr(library, "OSMesaCreateContextAttribs"):
            raise BackendError(f"{name} is older than Mesa 12 and has no core profile")
        library.OSMesaCreateContextAttribs.restype = ctypes.c_void_p
        library.OSMesaCreateContextAttribs.argtypes = [ctypes.c_void_p, ctypes.c_void_p]
        library.OSMesaMakeCurrent.restype = ctypes.c_ubyte
        # Context, then the buffer's address, type, width and height
        pointer, number = ctypes.c_void_p, ctypes.c_int
        library.OSMesaMakeCurrent.argtypes = [pointer, pointer, ctypes.c_uint, number, number]
        library.OSMesaGetProcAddress.restype = ctypes.c_void_p
        library.OSMesaGetProcAddress.argtypes = [ctypes.c_char_p]
        library.OSMesaGetCurrentContext.restype = ctypes.c_void_p
        library.OSMesaDestroyContext.restype = None
        library.OSMesaDestroyContext.argtypes = [ctypes.c_void_p]
        return library
    raise BackendError(f"{LIBRARIES[0]} is not installed")


HIDDEN_SIZE = (16, 16)  # pixels; a hidden window is never drawn to


class WindowContext:
    """OpenGL context of a GLFW window; `destroy` closes the window too. GLFW requires the main thread."""

    backend = "window"

    def __init__(self, size: tuple[int, int], title: str, visible: bool) -> None:
        self.window = _create_window(size, title, visible)

    def address(self, name: str) -> int:
        """Returns the address of an OpenGL function from GLFW, 0 if there is none."""
        import glfw

        address = glfw.get_proc_address(name)
        return ctypes.cast(address, ctypes.c_void_p).value or 0 if address else 0

    def bind(self) -> None:
        """Makes the window's context current; raises BackendError if GLFW cannot."""
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


def open_window(size: tuple[int, int] = HIDDEN_SIZE, title: str = "splatgl", visible: bool = False) -> Loader:
    """Opens the context of a window."""
    library = "the window system's OpenGL" if has_display() else "OSMesa"
    return Loader(library, partial(WindowContext, size, title, visible))


def _create_window(size: tuple[int, int], title: str, visible: bool) -> Any:
    """Creates a GLFW window with the newest core context that opens."""
    try:
        import glfw
    except ImportError as error:
        raise BackendError(f"GLFW could not be loaded ({error})") from error
    with _glfw_errors():
        # Without a display only the null platform starts, and only with OSMesa
        headless = not has_display()
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
    """Sets the hints for the windows created next."""
    glfw.default_window_hints()
    if glfw.get_platform() == glfw.PLATFORM_NULL:
        glfw.window_hint(glfw.CONTEXT_CREATION_API, glfw.OSMESA_CONTEXT_API)
    glfw.window_hint(glfw.CONTEXT_VERSION_MAJOR, version[0])
    glfw.window_hint(glfw.CONTEXT_VERSION_MINOR, version[1])
    glfw.window_hint(glfw.OPENGL_PROFILE, glfw.OPENGL_CORE_PROFILE)
    glfw.window_hint(glfw.OPENGL_FORWARD_COMPAT, sys.platform == "darwin")  # required by macOS, refused by OSMesa
    glfw.window_hint(glfw.VISIBLE, visible)


@contextmanager
def _glfw_errors() -> Iterator[None]:
    """Turns GLFW's errors, by default warnings, into a BackendError."""
    import glfw

    glfw.get_error()  # clears earlier errors
    before, glfw.ERROR_REPORTING = glfw.ERROR_REPORTING, "ignore"
    try:
        yield
    finally:
        glfw.ERROR_REPORTING = before
    code, description = glfw.get_error()
    if code != glfw.NO_ERROR:
        raise BackendError(description.decode() if isinstance(description, bytes) else str(description))
