"""Draws in portions that end within a part of a second, so that Ctrl-C, or another picture, is heard in between."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator

import moderngl

# how long a portion should take, seconds, and where somebody asks to interrupt it
SECONDS, ASKED_SECONDS = 0.3, 0.1
# splats of a picture's first portion, and of any at most, for so many pixels or fewer: the nearest may each cover all
FIRST, MOST, PIXELS = 2**8, 2**17, 2**20
# by how much a portion may be larger or smaller than the one before
GROWTH = 8.0


class Interrupted(Exception):
    """A picture was cancelled by its caller."""


class Portions:
    """Of one picture: each is as large as the last one's time says. pixels: of the picture's samples."""

    def __init__(self, ctx: moderngl.Context, interrupted: Callable[[], bool] | None, pixels: int) -> None:
        self.ctx, self.interrupted = ctx, interrupted
        self.seconds = ASKED_SECONDS if interrupted else SECONDS
        share = min(PIXELS / pixels, 1.0)
        self.size, self.most = FIRST * share, MOST * share

    def ask(self) -> None:
        """Raises Interrupted if the caller wants the picture no longer."""
        if self.interrupted and self.interrupted():
            raise Interrupted

    def over(self, begin: int, end: int) -> Iterator[tuple[int, int]]:
        """[begin, end) of splats in turn; what is drawn between two of them is waited for."""
        while begin < end:
            self.ask()
            last = min(begin + max(int(self.size), 1), end)
            started = time.perf_counter()
            yield begin, last
            self.ctx.finish()
            took = time.perf_counter() - started
            self.size *= min(max(self.seconds / max(took, 1e-6), 1 / GROWTH), GROWTH)
            self.size = min(self.size, self.most)
            begin = last
