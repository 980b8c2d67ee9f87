"""How the process of a window gives memory back."""

from __future__ import annotations

import ctypes
from contextlib import suppress

# glibc's number of the option, and bytes of a block that is given back as soon as it is freed
M_MMAP_THRESHOLD, LARGE = -3, 1 << 20


def give_back_large() -> None:
    """Freed pictures go back to the system. glibc would keep them, and fit none of another size in their places: a
    window that is resized would grow without end. Other systems' allocators stay as they are.
    """
    with suppress(OSError, AttributeError, TypeError):
        ctypes.CDLL(None).mallopt(M_MMAP_THRESHOLD, LARGE)
