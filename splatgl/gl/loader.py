"""What every way to an OpenGL context has in common: find functions, make current, let go.

OpenGL keeps one current context per thread, and the window systems do not know of each other: making an EGL context
current while an OSMesa one is leaves the calls going to the wrong one. Each thread therefore remembers which loader is
current here, and unbinds it before another is bound.

A forked process has the memory behind its parent's contexts, but none of the threads and connections: with llvmpipe,
whatever draws there waits for ever, also in a new context of a library that the parent had used. Both are refused.
"""

from __future__ import annotations

import os
import threading
from abc import ABC, abstractmethod
from typing import ClassVar

from splatgl.data.errors import expected

SPAWN = 'start worker processes with multiprocessing.get_context("spawn"), and open a Renderer in each'


class BackendError(Exception):
    """A backend cannot serve here; the message is one line that says why."""


class _Thread(threading.local):
    """The loader whose context is current in this thread, and the one that was when it began to fork."""

    current: Loader | None = None
    forking: Loader | None = None


class _Process:
    """The libraries that this process has opened, those that its parent had at the fork, and the forks up to here."""

    opened: ClassVar[set[str]] = set()
    inherited: ClassVar[set[str]] = set()
    forks: ClassVar[int] = 0


_thread = _Thread()


def _before_fork() -> None:
    """Nothing is current: the child could not let it go, and other window systems would refuse theirs there."""
    loader = _thread.current
    _thread.forking = loader if loader is not None and loader.holds() else None
    if _thread.forking is not None:
        switch_to(None)


def _in_parent() -> None:
    if _thread.forking is not None:
        switch_to(_thread.forking)


def _in_child() -> None:
    """What was opened until now is out of use."""
    _thread.current = _thread.forking = None
    _Process.inherited |= _Process.opened
    _Process.forks += 1


# Windows does not fork
if hasattr(os, "register_at_fork"):
    os.register_at_fork(before=_before_fork, after_in_parent=_in_parent, after_in_child=_in_child)


class Loader(ABC):
    """An OpenGL 3.3 core context as moderngl wants it: `create_context(context=loader)`.

    As a context manager it makes its context current and afterwards brings back whichever was current before.
    library: what implements OpenGL here; BackendError if the process that this one was forked from had opened it.
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
        """Whether it was opened before this process was forked."""
        return self._forks != _Process.forks

    def check_process(self) -> None:
        """InputError in a forked process, for a context of its parent."""
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
        """Whether the system says that this context is current: other libraries switch without asking."""

    def load_opengl_function(self, name: str) -> int:
        """Address of an OpenGL function, by the name that moderngl calls."""
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
        """Free the context; a second call does nothing, nor does any in a forked process that inherited it."""
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
    """Make `loader` the thread's current one, or none. One released meanwhile, or inherited, counts as none."""
    target = None if loader is None or loader._released or loader.inherited else loader
    if _thread.current is target:
        return
    if _thread.current is not None:
        _thread.current.unbind()
        _thread.current = None
    if target is not None:
        target.bind()
        _thread.current = target
