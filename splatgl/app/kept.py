"""The renderer that calls in one process share: opened by the first, closed at the end of the process."""

from __future__ import annotations

import atexit
from collections.abc import Iterator
from contextlib import contextmanager
from threading import RLock

from splatgl.data.errors import InputError
from splatgl.gl.context import inherited
from splatgl.gl.loader import BackendError, restored
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


def close_kept() -> None:
    """Closes the shared renderer; the next call opens another."""
    with _LOCK:
        while _kept:
            _kept.pop().close()


atexit.register(close_kept)
