"""The shared renderer of a process."""

from __future__ import annotations

import atexit
from collections.abc import Iterator
from contextlib import contextmanager
from threading import RLock

from splatgl.errors import InputError
from splatgl.gl.backends import BackendError, restored
from splatgl.gl.context import current, inherited
from splatgl.gl.renderer import Renderer

# one picture at a time in all threads
_LOCK = RLock()
_renderers: list[Renderer] = []


@contextmanager
def shared_renderer() -> Iterator[Renderer]:
    """The shared renderer, locked for the calling thread. Raises InputError as `Renderer`."""
    with _LOCK, restored():
        if _renderers and inherited(_renderers[0].ctx):
            # a forked process cannot close it
            _renderers.clear()
        if _renderers and not is_usable(_renderers[0]):
            _renderers.clear()
        if not _renderers:
            _renderers.append(Renderer())
        try:
            yield _renderers[0]
        except InputError:
            raise
        except BackendError as error:
            # another library switched OpenGL's context
            close_shared_renderer()
            raise InputError(f"OpenGL: {error}; draw in a process of its own") from error
        except BaseException:
            # an interrupted renderer is not used again
            close_shared_renderer()
            raise


def is_usable(renderer: Renderer) -> bool:
    """Whether the context still exists: VTK ends the display that it shares with other libraries of the process."""
    try:
        with current(renderer.ctx):
            return True
    except BackendError:
        return False


def close_shared_renderer() -> None:
    """Closes the shared renderer; the next call opens a new one."""
    with _LOCK:
        while _renderers:
            last = _renderers.pop()
            # a lost context has freed itself
            if inherited(last.ctx) or is_usable(last):
                last.close()


atexit.register(close_shared_renderer)
