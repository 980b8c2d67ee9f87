"""Render targets and their readback."""

from __future__ import annotations

import time
from bisect import bisect_right
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from weakref import WeakKeyDictionary

import moderngl
import numpy as np

from splatgl.errors import InputError, expected
from splatgl.gl.buffers import free, texel_texture, uneven
from splatgl.gl.context import is_software
from splatgl.planning.culling import PixelWindow

# target format → moderngl's dtype, numpy's dtype, and the stored value of 1.0
FORMATS: dict[str, tuple[str, np.dtype, float]] = {
    "rgba32f": ("f4", np.dtype("<f4"), 1.0),
    "rgba16f": ("f2", np.dtype("<f2"), 1.0),
    "rgba8": ("f1", np.dtype("u1"), 255.0),
}
# cache: whether a context draws in software
_software: WeakKeyDictionary[moderngl.Context, bool] = WeakKeyDictionary()


@dataclass(frozen=True, eq=False)
class RenderTarget:
    """Render target [H, W] of RGBA, row 0 on top; the texture may be larger by a row and a column."""

    size: tuple[int, int]
    texture: moderngl.Texture
    framebuffer: moderngl.Framebuffer
    format: str

    def read(self, window: PixelWindow | None = None) -> np.ndarray:
        """Returns the pixels, float32 [H, W, 4]; rows outside the window are zero and are not read."""
        name, dtype, one = FORMATS[self.format]
        width, height = self.size
        first, rows = (window.y, window.height) if window else (0, height)
        # the operating system maps zero pages lazily: rows outside the window cost nothing
        pixels = np.zeros((height, width, 4), dtype)
        if rows:
            box = (0, first, width, rows)
            self.framebuffer.read_into(pixels[first : first + rows], box, 4, alignment=1, dtype=name)
        return pixels if self.format == "rgba32f" else pixels.astype(np.float32) / np.float32(one)

    def clear(self) -> None:
        """Binds and clears the target."""
        self.framebuffer.use()
        self.framebuffer.clear()
        settle(self.framebuffer.ctx)

    def release(self) -> None:
        """Frees the target."""
        free(self.framebuffer, self.texture)


def settle(ctx: moderngl.Context) -> None:
    """Waits until the pass into a framebuffer ends, on software renderers only. llvmpipe frees the memory of released
    textures only when as many passes are queued again; with one pass at a time, the next pass frees it.
    """
    if ctx not in _software:
        _software[ctx] = is_software(str(ctx.info["GL_RENDERER"]))
    if _software[ctx]:
        ctx.finish()


class Targets:
    """One target per role ("draw", "resolve"), recreated only when its size or format changes."""

    def __init__(self, ctx: moderngl.Context, owned: ExitStack) -> None:
        self.ctx = ctx
        self.kept: dict[str, RenderTarget] = {}
        owned.callback(self.release)

    def get(self, role: str, size: tuple[int, int], form: str) -> RenderTarget:
        """Returns the role's target of `size` (width, height) in the texture format `form`; does not clear it."""
        target = self.kept.get(role)
        if target is None or target.size != size or target.format != form:
            # moderngl rebinds the current framebuffer when it creates another, so the old one is freed last
            old, target = target, self._make(size, form)
            target.framebuffer.use()
            self.kept[role] = target
            free(old)
        return target

    def release(self) -> None:
        """Frees all targets."""
        while self.kept:
            self.kept.popitem()[1].release()

    def _make(self, size: tuple[int, int], form: str) -> RenderTarget:
        check_size(self.ctx, size)
        try:
            texture = texel_texture(self.ctx, (uneven(size[0]), uneven(size[1])), 4, FORMATS[form][0])
            target = RenderTarget(size, texture, self.ctx.framebuffer([texture]), form)
            target.framebuffer.viewport = (0, 0, *size)
            return target
        except moderngl.Error as error:
            raise InputError(
                f"image size {size[0]}×{size[1]}: OpenGL cannot draw into {form} of that size ({error})"
            ) from error


def check_size(ctx: moderngl.Context, size: tuple[int, int]) -> None:
    """Raises InputError for a picture larger than this OpenGL supports."""
    limits = [ctx.info["GL_MAX_TEXTURE_SIZE"], *ctx.info["GL_MAX_VIEWPORT_DIMS"]]
    limit = int(min(limits))
    if max(size) > limit:
        raise expected(
            "image size", f"at most {limit}×{limit} samples on this OpenGL", f"{size[0]}×{size[1]}", "ask for less"
        )


# intended time of a portion in seconds, without and with a cancellation callback, which may draw a panel meanwhile
SECONDS, ASKED_SECONDS = 0.3, 0.03
# splats of the first portion and of the largest, for up to PIXELS pixels; a near splat may cover all pixels
FIRST, MOST, PIXELS = 2**8, 2**17, 2**20
# largest ratio between the sizes of successive portions; of the largest, the first one of other work than splats
GROWTH, START = 8.0, 1 / 16


# kind of work
SPLATS = "splats"


class Interrupted(Exception):
    """The caller cancelled the picture."""


class Portions:
    """Portions of one picture, each sized by the time of the previous one of its kind. pixels: number of the picture's
    samples.
    """

    def __init__(self, ctx: moderngl.Context, interrupted: Callable[[], bool] | None = None, pixels: int = 1) -> None:
        self.ctx, self.interrupted = ctx, interrupted
        self.seconds = ASKED_SECONDS if interrupted else SECONDS
        share = min(PIXELS / pixels, 1.0)
        self.sizes, self.most = {SPLATS: FIRST * share}, MOST * share

    def ask(self) -> None:
        """Raises Interrupted if the caller cancels."""
        if self.interrupted and self.interrupted():
            raise Interrupted

    def over(self, begin: int, end: int) -> Iterator[tuple[int, int]]:
        """Yields ranges [begin, end) of splats; waits for the GPU after each."""
        for first, last in self.parts(SPLATS, range(1, end - begin + 1), self.most):
            yield begin + first, begin + last

    def parts(self, work: str, costs: Sequence[int] | np.ndarray, most: float) -> Iterator[tuple[int, int]]:
        """Yields ranges of items whose costs are at most `most`, but at least one item. Unless nobody asks, or for
        splats, waits for the GPU after each, and adapts the next one's costs to the time. costs: sums up to each item.
        """
        begin, done = 0, 0
        is_timed = work == SPLATS or self.interrupted is not None
        self.sizes.setdefault(work, most * START if is_timed else most)
        while begin < len(costs):
            self.ask()
            end = max(bisect_right(costs, done + int(min(self.sizes[work], most))), begin + 1)
            start = time.perf_counter()
            yield begin, end
            if is_timed:
                self.ctx.finish()
                duration = time.perf_counter() - start
                growth = min(max(self.seconds / max(duration, 1e-6), 1 / GROWTH), GROWTH)
                # the last portion of a range may be short: if it is quick, larger portions may still be slow
                if end < len(costs) or growth < 1:
                    self.sizes[work] = min(self.sizes[work] * growth, most)
            begin, done = end, int(costs[end - 1])
