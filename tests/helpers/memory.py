"""Memory that a process holds."""

from __future__ import annotations

import os

import pytest

from splatgl.gl import large_volumes
from splatgl.planning.bricks import Bricks


def resident_mebibytes() -> float:
    """Memory that this process holds."""
    try:
        with open("/proc/self/statm") as file:
            return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 2**20
    except OSError:
        pytest.skip("no /proc here to read the memory from")


def allow_any_memory(patch: pytest.MonkeyPatch) -> None:
    """Lets pictures in bricks, and choices of a level, take more than their budget, so that small ones are tested."""
    patch.setattr(Bricks, "least", lambda *_: 0)
    patch.setattr(large_volumes, "PROCESS", -(2**60))
