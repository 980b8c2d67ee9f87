"""Draws in portions that end within a part of a second, so that Ctrl-C, or another picture, is heard in between."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator

import moderngl

# how long a portion should take, seconds, and where somebody asks to interrupt it
SECONDS, ASKED_SECONDS = 0.3, 0.1
# splats of a picture's first portion, of so many pixels or fewer, and of any at least
FIRST, PIXELS, FEWEST = 2**16, 2**20, 64
# by how much a portion may be larger or smaller than the one before
GROWTH = 8.0


class Interrupted(Exception):
    """A picture was cancelled by its caller."""


class Portions:
    """Of one picture: each is as large as the last one's time says. pixels: of the picture's samples."""

    def __init__(self, ctx: moderngl.Context, interrupted: Callable[[], bool] | None, pixels: int) -> None:
        self.ctx, self.interrupted = ctx, interrupted
        self.seconds = ASKED_SECONDS if interrupted else SECONDS
        self.size = FIRST / max(pixels / PIXELS, 1.0)

    def ask(self) -> None:
        """Raises Interrupted if the caller wants the picture no longer."""
        if self.interrupted and self.interrupted():
            raise Interrupted

    def over(self, begin: int, end: int) -> Iterator[tuple[int, int]]:
        """[begin, end) of splats in turn; what is drawn between two of them is waited for."""
        while begin < end:
            self.ask()
            last = min(begin + max(int(self.size), FEWEST), end)
            started = time.perf_counter()
            yield begin, last
            if last < end:
                self.ctx.finish()
                took = time.perf_counter() - started
                self.size *= min(max(self.seconds / max(took, 1e-6), 1 / GROWTH), GROWTH)
            begin = last
