"""OSMesa: Mesa's software renderer as a library that needs neither display nor device. Removed in Mesa 25.1."""

from __future__ import annotations

import ctypes

from splatgl.gl.loader import BackendError, Loader, current_host, newest

LIBRARIES = ("libOSMesa.so.8", "libOSMesa.so.6", "libOSMesa.so")
# From osmesa.h and gl.h
OSMESA_FORMAT, OSMESA_DEPTH_BITS, OSMESA_PROFILE, OSMESA_CORE_PROFILE = 0x22, 0x30, 0x33, 0x34
OSMESA_MAJOR, OSMESA_MINOR = 0x36, 0x37
GL_RGBA, GL_UNSIGNED_BYTE = 0x1908, 0x1401
# OSMesa requires its own colour buffer in memory; nothing is drawn to it, so the smallest will do
BUFFER_SIDE = 1  # pixels
BUFFER_BYTES = 4 * BUFFER_SIDE * BUFFER_SIDE


class OsmesaLoader(Loader):
    """An OSMesa context of a core profile."""

    backend = "osmesa"

    def __init__(self) -> None:
        super().__init__("OSMesa")
        self._library = _library()
        self._context = newest(self._create)
        self._buffer = ctypes.create_string_buffer(BUFFER_BYTES)
        self.make_current()

    def _create(self, major: int, minor: int) -> int:
        attributes = (OSMESA_FORMAT, GL_RGBA, OSMESA_DEPTH_BITS, 0, OSMESA_PROFILE, OSMESA_CORE_PROFILE)
        version = (OSMESA_MAJOR, major, OSMESA_MINOR, minor, 0)
        packed = (ctypes.c_int * (len(attributes) + len(version)))(*attributes, *version)
        made = self._library.OSMesaCreateContextAttribs(packed, None)
        if not made:
            raise BackendError(f"OSMesa made no OpenGL {major}.{minor} core context")
        return int(made)

    def address(self, name: str) -> int:
        """Address of an OpenGL function by OSMesaGetProcAddress, 0 if there is none."""
        return self._library.OSMesaGetProcAddress(name.encode()) or 0

    def bind(self) -> None:
        """Makes the context current on its own small buffer; raises BackendError if OSMesa refuses."""
        side = BUFFER_SIDE
        if not self._library.OSMesaMakeCurrent(self._context, self._buffer, GL_UNSIGNED_BYTE, side, side):
            raise BackendError("OSMesa refused to make its context current")

    def holds(self) -> bool:
        """Whether OSMesa's current context is this one, and no other window system has one that calls go to."""
        return bool(self._library.OSMesaGetCurrentContext() == self._context) and current_host() is None

    def unbind(self) -> None:
        """Leaves no OSMesa context current."""
        self._library.OSMesaMakeCurrent(None, None, GL_UNSIGNED_BYTE, 0, 0)

    def destroy(self) -> None:
        """Frees the OSMesa context."""
        self._library.OSMesaDestroyContext(self._context)


def _library() -> ctypes.CDLL:
    """Loads libOSMesa with its functions' types; without them pointers are truncated to 32 bits."""
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
