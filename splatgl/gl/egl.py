"""EGL without a display, on a chosen device: a graphics card's driver or Mesa's llvmpipe."""

from __future__ import annotations

import ctypes
import os
from typing import Any

from splatgl.gl.loader import BackendError, Loader, current_host, newest

EGL_OPENGL_API, EGL_BAD_ACCESS = 0x30A2, 0x3002  # egl.h
EGL_LIBRARIES = ("libEGL.so.1", "libEGL.so")
# Any of these finds the functions; EGL itself serves if libGL, which X needs, is not installed
GL_LIBRARIES = ("libGL.so.1", "libOpenGL.so.0", *EGL_LIBRARIES)


class EglLoader(Loader):
    """An EGL context on device number `device`, counted from 0 in the driver's order."""

    backend = "egl"

    def __init__(self, device: int) -> None:
        super().__init__("EGL")
        self._context, self._egl = _create(device)
        self._handle: int | None = None
        # glcontext makes it current without asking
        made = current_host()
        if made is not None:
            made.unbind()
        self.make_current()

    def address(self, name: str) -> int:
        """Address of an OpenGL function as glcontext finds it, 0 if there is none."""
        return int(self._context.load_opengl_function(name))

    def bind(self) -> None:
        """Makes the EGL context current and stores its handle; raises BackendError if EGL refuses."""
        # a host may have chosen OpenGL ES
        self._egl.eglBindAPI(EGL_OPENGL_API)
        self._context.__enter__()
        error = self._egl.eglGetError()
        found = self._egl.eglGetCurrentContext()
        if error == EGL_BAD_ACCESS:
            raise BackendError("EGL's context is current in another thread; give each thread a Renderer")
        if not found or found != (self._handle or found):
            raise BackendError("EGL's context is gone, as another library ended its display; open another Renderer")
        self._handle = found

    def holds(self) -> bool:
        """Whether EGL's current context is this one."""
        return bool(self._egl.eglGetCurrentContext() == self._handle)

    def unbind(self) -> None:
        """Leaves no EGL context current."""
        self._context.__exit__(None, None, None)

    def destroy(self) -> None:
        """Frees the EGL context."""
        self._context.release()


def device_count() -> int:
    """Number of EGL devices; 0 if EGL cannot count them."""
    egl = ctypes.CDLL(_first_library("GLCONTEXT_LINUX_LIBEGL", EGL_LIBRARIES))
    egl.eglGetProcAddress.restype = ctypes.c_void_p
    egl.eglGetProcAddress.argtypes = [ctypes.c_char_p]
    address = egl.eglGetProcAddress(b"eglQueryDevicesEXT")
    if not address:
        return 0
    query = ctypes.CFUNCTYPE(ctypes.c_uint, ctypes.c_int, ctypes.c_void_p, ctypes.POINTER(ctypes.c_int))(address)
    count = ctypes.c_int(0)
    return count.value if query(0, None, ctypes.byref(count)) else 0


def _create(device: int) -> tuple[Any, ctypes.CDLL]:
    """The EGL context by glcontext, and the library that queries the current one. glcontext raises bare Exceptions."""
    try:
        from glcontext import egl
    except ImportError as error:  # not built on this system
        raise BackendError(f"glcontext has no EGL here ({error})") from error
    libegl = _first_library("GLCONTEXT_LINUX_LIBEGL", EGL_LIBRARIES)
    libgl = _first_library("GLCONTEXT_LINUX_LIBGL", GL_LIBRARIES)
    library = ctypes.CDLL(libegl)
    library.eglGetCurrentContext.restype = ctypes.c_void_p

    def create(major: int, minor: int) -> Any:
        version = 100 * major + 10 * minor
        try:
            return egl.create_context(
                mode="standalone", libgl=libgl, libegl=libegl, glversion=version, device_index=device
            )
        except Exception as error:
            raise BackendError(str(error)) from error

    return newest(create), library


def _first_library(variable: str, names: tuple[str, ...]) -> str:
    """The environment variable's library or the first of `names` that loads."""
    if os.environ.get(variable):
        names = (os.environ[variable],)
    for name in names:
        try:
            ctypes.CDLL(name)
        except OSError:
            continue
        return name
    raise BackendError(f"{names[0]} is not installed")
