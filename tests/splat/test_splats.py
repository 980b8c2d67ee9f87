"""Parts of a computation run side by side."""

from __future__ import annotations

import os
from threading import Barrier

import pytest

from splatgl.splat.splats import in_parts

PATIENCE = 20.0


@pytest.mark.skipif((os.cpu_count() or 1) < 2, reason="one processor")
def test_parts_run_side_by_side() -> None:
    """Each waits for another one."""
    both = Barrier(2)
    assert in_parts(4, 1, lambda part: (both.wait(PATIENCE), part.start)[1]) == [0, 1, 2, 3]


def test_parts_of_parts_end() -> None:
    """More of them than threads, all of which wait for others."""
    nested = in_parts(64, 1, lambda some: sum(in_parts(10, 2, lambda part: part.stop - part.start)) + some.start)
    assert nested == list(range(10, 74))


def test_an_error_of_a_part_is_raised() -> None:
    with pytest.raises(ZeroDivisionError):
        in_parts(9, 1, lambda part: 1 / (part.start - 5))
