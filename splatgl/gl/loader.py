"""Common base of the OpenGL backends: find functions, make a context current, release it.

OpenGL keeps one current context per thread, and the window systems are independent: if an EGL context is made current
while an OSMesa one is, calls go to the wrong one. Each thread therefore stores its current loader and unbinds it before
it binds another.

A forked process has its parent's context memory, but not its threads and connections: with llvmpipe, draw calls hang,
even in a new context of a library that the parent had used. Both are refused.
"""

from __future__ import annotations

import os
import threading
from abc import ABC, abstractmethod
from collections.abc import Iterator
from contextlib import contextmanager
from typing import ClassVar

from splatgl.data.errors import expected

SPAWN = 'start worker processes with multiprocessing.get_context("spawn"), and open a Renderer in each'


class BackendError(Exception):
    """A backend is unavailable; the message gives the reason in one line."""


class _Thread(threading.local):
    """The loader that is current in this thread, and the one that was current when a fork began."""

    current: Loader | None = None
    forking: Loader | None = None


class _Process:
    """Libraries opened by this process, libraries opened by its parent before the fork, and the number of forks."""

    opened: ClassVar[set[str]] = set()
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
    _thread.current = _thread.forking = None
    _Process.inherited |= _Process.opened
    _Process.forks += 1


# Windows does not fork
if hasattr(os, "register_at_fork"):
    os.register_at_fork(before=_before_fork, after_in_parent=_in_parent, after_in_child=_in_child)


class Loader(ABC):
    """An OpenGL 3.3 core context for moderngl's `create_context(context=loader)`.

    As a context manager it makes its context current and restores the previous one on exit.
    library: the OpenGL implementation; BackendError if a parent process had opened it before the fork.
    """

    backend: str

    def __init__(self, library: str) -> None:
        if library in _Process.inherited:
            raise BackendError(f"{library} was opened before this process was forked, and its threads were left behind")
        _Process.opened.add(library)
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
        if before is self and self.holds():
            return before
        if before is self:
            self.bind()
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
    """Make `loader` the thread's current one; None, a released or an inherited one leaves none current."""
    target = None if loader is None or loader._released or loader.inherited else loader
    if _thread.current is target:
        return
    if _thread.current is not None:
        _thread.current.unbind()
        _thread.current = None
    if target is not None:
        target.bind()
        _thread.current = target


@contextmanager
def restored() -> Iterator[None]:
    """Leaves the thread's current context as it was, whatever was opened meanwhile: another thread may want it."""
    before = _thread.current
    try:
        yield
    finally:
        switch_to(before)
