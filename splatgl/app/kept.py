"""The renderer that calls in one process share: opened by the first, closed at the end of the process."""

from __future__ import annotations

import atexit
from collections.abc import Iterator
from contextlib import contextmanager
from threading import RLock

from splatgl.errors import InputError
from splatgl.gl.backends import BackendError, restored
from splatgl.gl.context import current, inherited
from splatgl.gl.renderer import Renderer

# one picture at a time, in any thread
_LOCK = RLock()
_kept: list[Renderer] = []


@contextmanager
def kept_renderer() -> Iterator[Renderer]:
    """The shared renderer, for the calling thread alone. InputError as `Renderer` raises, and in a forked process."""
    with _LOCK, restored():
        if _kept and inherited(_kept[0].ctx):
            # a forked process can't close it either
            _kept.clear()
        if _kept and not _usable(_kept[0]):
            _kept.clear()
        if not _kept:
            _kept.append(Renderer())
        try:
            yield _kept[0]
        except InputError:
            raise
        except BackendError as error:
            # another library switched OpenGL's context behind ours
            close_kept()
            raise InputError(f"OpenGL: {error}; draw in a process of its own") from error
        except BaseException:
            # whatever was interrupted is not used again
            close_kept()
            raise


def _usable(renderer: Renderer) -> bool:
    """Whether its context is still there: VTK ends the display that it shares with others of the process."""
    try:
        with current(renderer.ctx):
            return True
    except BackendError:
        return False


def close_kept() -> None:
    """Closes the shared renderer; the next call opens another."""
    with _LOCK:
        while _kept:
            last = _kept.pop()
            # what is gone has freed itself
            if inherited(last.ctx) or _usable(last):
                last.close()


atexit.register(close_kept)
