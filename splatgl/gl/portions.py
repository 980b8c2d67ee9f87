"""Draws in portions of a fraction of a second, so that Ctrl-C or the caller can cancel in between."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator

import moderngl

# target time of a portion in seconds, without and with a cancellation callback
SECONDS, ASKED_SECONDS = 0.3, 0.1
# splats of the first portion and of the largest, at up to PIXELS pixels; a near splat may cover them all
FIRST, MOST, PIXELS = 2**8, 2**17, 2**20
# largest ratio between the sizes of successive portions
GROWTH = 8.0


class Interrupted(Exception):
    """A picture was cancelled by its caller."""


class Portions:
    """Portions of one picture, each sized by the time of the last. pixels: number of the picture's samples."""

    def __init__(self, ctx: moderngl.Context, interrupted: Callable[[], bool] | None, pixels: int) -> None:
        self.ctx, self.interrupted = ctx, interrupted
        self.seconds = ASKED_SECONDS if interrupted else SECONDS
        share = min(PIXELS / pixels, 1.0)
        self.size, self.most = FIRST * share, MOST * share

    def ask(self) -> None:
        """Raises Interrupted if the caller cancels."""
        if self.interrupted and self.interrupted():
            raise Interrupted

    def over(self, begin: int, end: int) -> Iterator[tuple[int, int]]:
        """Yields ranges [begin, end) of splats; waits for the GPU after each."""
        while begin < end:
            self.ask()
            last = min(begin + max(int(self.size), 1), end)
            started = time.perf_counter()
            yield begin, last
            self.ctx.finish()
            took = time.perf_counter() - started
            growth = min(max(self.seconds / max(took, 1e-6), 1 / GROWTH), GROWTH)
            # the end of a range, however quick, does not tell how long a whole portion takes
            if last < end or growth < 1:
                self.size = min(self.size * growth, self.most)
            begin = last
