"""What every way to an OpenGL context has in common: find functions, make current, let go.

OpenGL keeps one current context per thread, and the window systems do not know of each other: making an EGL context
current while an OSMesa one is leaves the calls going to the wrong one. Each thread therefore remembers which loader is
current here, and unbinds it before another is bound.
"""

from __future__ import annotations

import threading
from abc import ABC, abstractmethod


class BackendError(Exception):
    """A backend cannot serve here; the message is one line that says why."""


class _Thread(threading.local):
    """The loader whose context is current in this thread."""

    current: Loader | None = None


_thread = _Thread()


class Loader(ABC):
    """An OpenGL 3.3 core context as moderngl wants it: `create_context(context=loader)`.

    As a context manager it makes its context current and afterwards brings back whichever was current before.
    """

    backend: str

    def __init__(self) -> None:
        self._before: list[Loader | None] = []
        self._released = False

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
        return self.address(name)

    def make_current(self) -> Loader | None:
        """Make this context current in this thread; returns the loader that was current before."""
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
        """Free the context; a second call does nothing."""
        if self._released:
            return
        if _thread.current is self:
            switch_to(None)
        self._released = True
        self.destroy()


def current_loader() -> Loader | None:
    """The loader whose context is current in this thread."""
    return _thread.current


def switch_to(loader: Loader | None) -> None:
    """Make `loader` the thread's current one, or none. One released meanwhile counts as none."""
    target = None if loader is None or loader._released else loader
    if _thread.current is target:
        return
    if _thread.current is not None:
        _thread.current.unbind()
        _thread.current = None
    if target is not None:
        target.bind()
        _thread.current = target
