"""Common base of the OpenGL backends: find functions, make a context current, release it.

OpenGL keeps one current context per thread, and the window systems are independent: if an EGL context is made current
while an OSMesa one is, calls go to the wrong one. Each thread therefore stores its current loader and unbinds it before
it binds another. What other libraries of the process made current (Qt, VTK, another moderngl) is asked of EGL and GLX,
unbound before a context of ours is bound, and bound again after.

A forked process has its parent's context memory, but not its threads and connections: with llvmpipe, draw calls hang,
even in a new context of a library that the parent had used. Both are refused.
"""

from __future__ import annotations

import ctypes
import os
import threading
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from typing import ClassVar, TypeVar

from splatgl.errors import expected

Opened = TypeVar("Opened")
# core profiles in the order in which they are asked for: some drivers give exactly what is asked. 4.3 has compute
# shaders, 3.3 is the least that has instanced attributes and float targets
VERSIONS = ((4, 6), (4, 5), (4, 3), (3, 3))
# from egl.h
EGL_DRAW, EGL_READ = 0x3059, 0x305A
# functions that return handles
EGL_ASKED = ("eglGetCurrentContext", "eglGetCurrentDisplay", "eglGetCurrentSurface")
GLX_ASKED = ("glXGetCurrentContext", "glXGetCurrentDisplay", "glXGetCurrentDrawable", "glXGetCurrentReadDrawable")
SPAWN = 'start worker processes with multiprocessing.get_context("spawn"), and open a Renderer in each'


class BackendError(Exception):
    """A backend is unavailable; the message gives the reason in one line."""


def newest(create: Callable[[int, int], Opened]) -> Opened:
    """The result of `create(major, minor)` for the newest version that there is; BackendError if there is none."""
    refusal = BackendError("no OpenGL")
    for version in VERSIONS:
        try:
            return create(*version)
        except BackendError as error:
            refusal = error
    raise refusal


@dataclass(frozen=True)
class Host:
    """Another library's context that is current in this thread. unbind: leaves none of its window system current.
    bind: makes it current again, on the surfaces that it was drawing to.
    """

    unbind: Callable[[], object]
    bind: Callable[[], object]


def current_host() -> Host | None:
    """The context that EGL or GLX have current in this thread, which is another library's while no loader is."""
    return _of_egl() or _of_glx()


def _of_egl() -> Host | None:
    egl = _in_process("libEGL.so.1", EGL_ASKED, "eglMakeCurrent")
    context = egl.eglGetCurrentContext() if egl else None
    if egl is None or not context:
        return None
    interface, display = egl.eglQueryAPI(), egl.eglGetCurrentDisplay()
    surfaces = egl.eglGetCurrentSurface(EGL_DRAW), egl.eglGetCurrentSurface(EGL_READ)

    def bind() -> None:
        egl.eglBindAPI(interface)
        egl.eglMakeCurrent(display, *surfaces, context)

    return Host(partial(egl.eglMakeCurrent, display, None, None, None), bind)


def _of_glx() -> Host | None:
    glx = _in_process("libGL.so.1", GLX_ASKED, "glXMakeContextCurrent")
    context = glx.glXGetCurrentContext() if glx else None
    if glx is None or not context:
        return None
    display, drawables = glx.glXGetCurrentDisplay(), (glx.glXGetCurrentDrawable(), glx.glXGetCurrentReadDrawable())
    make = glx.glXMakeContextCurrent
    return Host(partial(make, display, None, None, None), partial(make, display, *drawables, context))


def _in_process(name: str, asked: tuple[str, ...], bind: str) -> ctypes.CDLL | None:
    """A library that the process has loaded, with the functions `asked` for handles and the one that binds four."""
    if name not in _Process.libraries and hasattr(os, "RTLD_NOLOAD"):
        try:
            library = ctypes.CDLL(name, mode=os.RTLD_NOLOAD)
            for function in asked:
                getattr(library, function).restype = ctypes.c_void_p
            getattr(library, bind).argtypes = [ctypes.c_void_p] * 4
        except (OSError, AttributeError):
            # not loaded, or without OpenGL of that system
            return None
        _Process.libraries[name] = library
    return _Process.libraries.get(name)


class _Thread(threading.local):
    """The loader that is current in this thread, another library's context that was before it, and the loader that was
    current when a fork began.
    """

    current: Loader | None = None
    host: Host | None = None
    forking: Loader | None = None


class _Process:
    """Libraries opened by this process, those of them that tell what is current, libraries opened by its parent before
    the fork, and the number of forks.
    """

    opened: ClassVar[set[str]] = set()
    libraries: ClassVar[dict[str, ctypes.CDLL]] = {}
    inherited: ClassVar[set[str]] = set()
    forks: ClassVar[int] = 0


_thread = _Thread()


def _before_fork() -> None:
    """Unbinds the current context: the child could not, and other window systems would refuse theirs there."""
    loader = _thread.current
    _thread.forking = loader if loader is not None and loader.holds() else None
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


class Loader(ABC):
    """A core context of OpenGL 3.3 or newer for moderngl's `create_context(context=loader)`.

    As a context manager it makes its context current and restores the previous one on exit.
    library: the OpenGL implementation; BackendError if a parent process had opened it before the fork.
    """

    backend: str

    def __init__(self, library: str) -> None:
        if library in _Process.inherited:
            raise BackendError(f"{library} was opened before this process was forked, and its threads were left behind")
        _Process.opened.add(library)
        # libraries may make a new context current, or refuse to while another is
        leave()
        self._before: list[Loader | None] = []
        self._released = False
        self._forks = _Process.forks

    @property
    def inherited(self) -> bool:
        """Whether the context was opened before this process was forked."""
        return self._forks != _Process.forks

    def check_process(self) -> None:
        """Raises InputError in a forked process for a context of its parent."""
        if self.inherited:
            raise expected("context", "one opened in this process", "one from before it was forked", SPAWN)

    @abstractmethod
    def address(self, name: str) -> int:
        """Address of an OpenGL function, 0 if there is none; the context is current."""

    @abstractmethod
    def bind(self) -> None:
        """Make this context current; raises BackendError if the system refuses."""

    @abstractmethod
    def unbind(self) -> None:
        """Leave no context of this window system current."""

    @abstractmethod
    def destroy(self) -> None:
        """Free the context, which is not current."""

    @abstractmethod
    def holds(self) -> bool:
        """Whether the system reports this context as current; other libraries may have switched it."""

    def load_opengl_function(self, name: str) -> int:
        """Address of an OpenGL function; the method that moderngl calls."""
        return self.address(name)

    def make_current(self) -> Loader | None:
        """Make this context current in this thread, unless inherited; returns the loader that was current before."""
        self.check_process()
        before = _thread.current
        if before is not None and not before.holds():
            # another library's is current, which is bound again after, or none, and this one comes back
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
        """Free the context; no effect on a second call or in a forked process that inherited it."""
        if self._released or self.inherited:
            return
        if _thread.current is self:
            switch_to(None)
        self._released = True
        self.destroy()


def current_loader() -> Loader | None:
    """The loader whose context is current in this thread."""
    return _thread.current


def forked() -> bool:
    """Whether this process was forked from one that had opened an OpenGL library."""
    return bool(_Process.inherited)


def switch_to(loader: Loader | None) -> None:
    """Make `loader` the thread's current one; None, a released or an inherited one leaves none of ours current, and
    binds again what another library had.
    """
    target = None if loader is None or loader._released or loader.inherited else loader
    if _thread.current is target and (target is not None or _thread.host is None):
        return
    leave()
    try:
        if target is not None:
            target.bind()
            _thread.current = target
    finally:
        if _thread.current is None and _thread.host is not None:
            host, _thread.host = _thread.host, None
            host.bind()


def leave() -> None:
    """Leave no context current in this thread; one of another library is kept for `switch_to`."""
    loader, _thread.current = _thread.current, None
    if loader is not None and (loader.holds() or current_host() is None):
        loader.unbind()
    # or what was made current meanwhile, behind our back
    found = current_host()
    if found is not None:
        found.unbind()
        _thread.host = found


def hand_back() -> None:
    """Binds what another library had current before a context was opened, if anything; it may soon be gone."""
    if _thread.host is not None:
        switch_to(None)


@contextmanager
def restored() -> Iterator[None]:
    """Leaves the thread's current context as it was, whatever was opened meanwhile: another thread may want it."""
    before = _thread.current
    try:
        yield
    finally:
        switch_to(before)
