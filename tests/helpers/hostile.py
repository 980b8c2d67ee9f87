"""Refusal of hostile files, within bounds of memory and time."""

from __future__ import annotations

import signal
import tracemalloc
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from splatgl.errors import InputError
from splatgl.readers import load

SECONDS, HANGS = 20, 600
"""Longest processor time for one bad file, of which most take milliseconds; and after how long one that waits hangs."""

MIB = 2**20
ROOM = 16 * MIB
"""Most memory that refusing a small file may take."""


@contextmanager
def bounds(room: int) -> Iterator[None]:
    """Fails when the block takes more than `room` bytes or does not end."""

    def stop(_signal: int, _frame: object) -> None:
        pytest.fail(f"still reading after {SECONDS} s of processor time, or {HANGS} s in all")

    before = [signal.signal(each, stop) for each in (signal.SIGPROF, signal.SIGALRM)]
    signal.setitimer(signal.ITIMER_PROF, SECONDS)
    signal.alarm(HANGS)
    tracemalloc.reset_peak()
    held = tracemalloc.get_traced_memory()[0]
    try:
        yield
        assert tracemalloc.get_traced_memory()[1] - held < room
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.alarm(0)
        for each, handler in zip((signal.SIGPROF, signal.SIGALRM), before, strict=True):
            signal.signal(each, handler)


def refused(path: Path, message: str) -> None:
    with bounds(ROOM), pytest.raises(InputError) as caught:
        load(path)
    line = str(caught.value)
    assert line.startswith(f"{path}: ") or len(line) > 200
    assert line.isprintable() and message in line


def spin(path: str) -> None:
    """Notes a call in a file, and does not end."""
    with Path(path).open("a") as file:
        file.write("called\n")
    loop(path)


def loop(_path: str | Path) -> None:
    """Does not end."""
    while True:
        pass
