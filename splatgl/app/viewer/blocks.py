"""How the process of a window gives memory back."""

from __future__ import annotations

import ctypes
import gc
from contextlib import suppress

# glibc's number of the option, and bytes of a block that is given back as soon as it is freed
M_MMAP_THRESHOLD, LARGE = -3, 1 << 20
# seconds after which what is given up is freed although the window is busy: it takes some 30 ms
SWEPT = 5.0


def give_back_large() -> None:
    """Freed pictures go back to the system. glibc would keep them, and fit none of another size in their places: a
    window that is resized would grow without end. Other systems' allocators stay as they are.
    """
    with suppress(OSError, AttributeError, TypeError):
        ctypes.CDLL(None).mallopt(M_MMAP_THRESHOLD, LARGE)


def give_back_free() -> None:
    """What is freed of small blocks goes back, too: what lies above keeps it, and a peak would last as long as the
    window. Only glibc needs that.
    """
    with suppress(OSError, AttributeError, TypeError):
        ctypes.CDLL(None).malloc_trim(0)


class Sweep:
    """Frees what is given up. Contents and pictures refer to themselves, and hold splats and textures: Python by itself
    keeps them until it has made many other objects.
    """

    def __init__(self, now: float) -> None:
        self.frame: object = None
        self.at = now

    def look(self, frame: object, resting: bool, now: float) -> None:
        """Sweeps once a frame that is shown at rest, and seldom where there is no rest."""
        if frame is not self.frame and (resting or now - self.at > SWEPT):
            gc.collect()
            give_back_free()
            self.frame, self.at = frame, now
