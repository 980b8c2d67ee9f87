"""`Screen`: a window with a context of its own that shows a picture over a ground and under an overlay.

Pictures arrive as arrays, independent of the renderer and its context.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from typing import Any, cast

import moderngl
import numpy as np

from splatgl.errors import InputError, expected
from splatgl.gl.backends import BackendError, Loader, WindowContext, open_window, restore_context
from splatgl.gl.buffers import free
from splatgl.gl.context import adopt, current
from splatgl.gl.program import build
from splatgl.platforms import DISPLAY_FIX, has_display, window_fix

# drawn below a picture without a background
GROUNDS = ("black", "white", "checks")
# largest window side, larger than any display; GLFW aborts the process on a negative side
MOST_PIXELS = 16384
# texture units, by the sampler's name
UNITS = {"picture": 0, "other": 1, "overlay": 2}


@dataclass(frozen=True)
class ScreenStyle:
    """Style of the displayed picture; see shaders/screen.frag.

    scale: factor of the light (1/brightest for an X-ray). compare: "split" shows `other` right of the middle,
    "difference" shows |picture − other| × gain. background: linear RGB that the picture already contains.
    """

    ground: str = "black"
    scale: float = 1.0
    compare: str = "none"
    gain: float = 1.0
    overlay: bool = True
    background: tuple[float, float, float] | None = None


class Screen:
    """A visible window; main thread only. Raises InputError without a display."""

    def __init__(self, size: tuple[int, int], title: str) -> None:
        if not all(1 <= side <= MOST_PIXELS for side in size):
            sides = f"{size[0]}×{size[1]}"
            raise expected("size", f"a window of 1 to {MOST_PIXELS} pixels a side", sides, "choose another --size")
        self.owned = ExitStack()
        try:
            self.loader = open_window(size, title, visible=True)
            _check_shown(self.loader)
            self.ctx = adopt(self.loader)
        except BackendError as error:
            fix = window_fix(str(error)) if has_display() else f"{DISPLAY_FIX}, or use splatgl render"
            raise expected("display", "one that opens a window", error, fix) from error
        finally:
            restore_context()
        self.owned.callback(self.ctx.release)
        self.textures: dict[str, moderngl.Texture] = {}
        self.programs: dict[tuple[str, bool], tuple[moderngl.Program, moderngl.VertexArray]] = {}
        self.marker = Marker(self.ctx)
        with current(self.ctx):
            self.owned.callback(self._release)
            for name in UNITS:
                self.put(name, np.zeros((1, 1, 4), np.uint8))

    @property
    def window(self) -> Any:
        """GLFW's handle of the window."""
        return cast("WindowContext", self.loader.system).window

    def put(self, name: str, pixels: np.ndarray) -> None:
        """Uploads pixels [H, W, 4], float32 (linear) or uint8 (sRGB), as the `picture`, `other` or `overlay`."""
        size, dtype = (pixels.shape[1], pixels.shape[0]), "f4" if pixels.dtype == np.float32 else "f1"
        with self._working():
            old = self.textures.get(name)
            if old is not None and (old.size, old.dtype) == (size, dtype):
                old.write(np.ascontiguousarray(pixels))
                return
            self.textures[name] = self.ctx.texture(size, 4, np.ascontiguousarray(pixels), dtype=dtype)
            self.textures[name].repeat_x = self.textures[name].repeat_y = False
            free(old)

    def draw(self, size: tuple[int, int], look: ScreenStyle) -> None:
        """Draws the textures into the window's back buffer of `size` pixels; restores the current context."""
        with self._working():
            program, whole = self._program(look.compare, look.overlay)
            self.ctx.screen.use()
            self.ctx.viewport = (0, 0, *size)
            self.ctx.enable_only(moderngl.NOTHING)
            for name, unit in UNITS.items():
                if name in program:
                    # nearest texel at equal sizes, linear interpolation of a smaller preview
                    kind = moderngl.NEAREST if self.textures[name].size == size else moderngl.LINEAR
                    self.textures[name].filter = (kind, kind)
                    self.textures[name].use(location=unit)
                    program[name] = unit
            values: dict[str, Any] = {"size": size, "scale": look.scale, "gain": look.gain}
            values["ground"] = GROUNDS.index(look.ground)
            values["background"] = (*look.background, 1.0) if look.background else (0.0, 0.0, 0.0, 0.0)
            for name, value in values.items():
                if name in program:
                    program[name] = value
            whole.render(moderngl.TRIANGLES, vertices=3)

    def mark(self, size: tuple[int, int], marks: ScreenMarks) -> None:
        """Draws marks over the window's back buffer of `size` pixels; restores the current context."""
        if marks:
            with self._working():
                self.ctx.screen.use()
                self.ctx.viewport = (0, 0, *size)
                self.marker.draw(size, marks)

    def read(self, size: tuple[int, int]) -> np.ndarray:
        """Returns the back buffer: uint8 [H, W, 3], row 0 on top."""
        with current(self.ctx):
            data = self.ctx.screen.read(viewport=(0, 0, *size), components=3, alignment=1)
            # moderngl names a colour attachment, which a window lacks: GL sets an error but reads the back buffer
            _ = self.ctx.error
        return np.frombuffer(data, np.uint8).reshape(size[1], size[0], 3)[::-1]

    @contextmanager
    def _working(self) -> Iterator[None]:
        """Makes the window's context current; raises InputError if OpenGL failed or lost the context."""
        with current(self.ctx):
            try:
                yield
                problem = self.ctx.error
            except moderngl.Error as error:
                problem = str(error)
        if problem != "GL_NO_ERROR":
            raise InputError(f"window: OpenGL failed: {problem}; close other programs that use the graphics card")

    def close(self) -> None:
        """Frees all GL objects and the window; further calls do nothing."""
        with current(self.ctx):
            self.owned.close()

    def _program(self, compare: str, overlay: bool) -> tuple[moderngl.Program, moderngl.VertexArray]:
        """Returns the program of a style, compiled on first use."""
        if (compare, overlay) not in self.programs:
            switches: dict[str, str | int | bool] = {"COMPARE": f"COMPARE_{compare.upper()}", "OVERLAY": overlay}
            program = build(self.ctx, "screen.vert", "screen.frag", switches)
            self.programs[compare, overlay] = program, self.ctx.vertex_array(program, [])
        return self.programs[compare, overlay]

    def _release(self) -> None:
        self.marker.release()
        while self.textures:
            self.textures.popitem()[1].release()
        while self.programs:
            program, whole = self.programs.popitem()[1]
            whole.release()
            program.release()


def _check_shown(loader: Loader) -> None:
    """Raises BackendError for GLFW's null platform, whose windows are invisible."""
    import glfw

    if glfw.get_platform() == glfw.PLATFORM_NULL:
        loader.release()
        raise BackendError("none")


LineColor = tuple[float, float, float, float]
Place = tuple[float, float]


@dataclass(frozen=True)
class Stroke:
    """Straight line with round ends; a dot if the ends are equal. start, stop: pixels, (0, 0) at the upper left corner;
    color: sRGB, straight alpha, 0 … 1; width, rim: widths in pixels of the line and of a dark rim around it.
    """

    start: Place
    stop: Place
    color: LineColor
    width: float = 1.5
    rim: float = 1.0


@dataclass(frozen=True, eq=False)
class Sprite:
    """Picture in a rectangle of the window. pixels: uint8 [h, w, 4], sRGB, straight alpha, row 0 on top; an array is
    uploaded once. place: left, top, right, bottom, in pixels. smooth: interpolate linearly.
    """

    pixels: np.ndarray
    place: tuple[float, float, float, float]
    smooth: bool = False


@dataclass(frozen=True, eq=False)
class ScreenMarks:
    """Sprites, strokes over them, and labels over both."""

    sprites: tuple[Sprite, ...] = ()
    strokes: tuple[Stroke, ...] = ()
    labels: tuple[Sprite, ...] = ()

    def __bool__(self) -> bool:
        return bool(self.sprites or self.strokes or self.labels)


class Marker:
    """Draws marks with a window's context, which must be current."""

    def __init__(self, ctx: moderngl.Context) -> None:
        self.ctx = ctx
        self.programs: dict[str, tuple[moderngl.Program, moderngl.VertexArray]] = {}
        self.instances: moderngl.Buffer | None = None
        # by the id of the pixels, which are stored so that Python does not reuse their ids
        self.textures: dict[int, tuple[np.ndarray, moderngl.Texture]] = {}

    def draw(self, size: tuple[int, int], marks: ScreenMarks) -> None:
        """Draws the marks into the bound framebuffer of `size` pixels."""
        self.ctx.enable_only(moderngl.BLEND)
        self.ctx.blend_func = moderngl.SRC_ALPHA, moderngl.ONE_MINUS_SRC_ALPHA
        self._forget((*marks.sprites, *marks.labels))
        self._sprites(size, marks.sprites)
        if marks.strokes:
            self._strokes(size, marks.strokes)
        self._sprites(size, marks.labels)
        self.ctx.enable_only(moderngl.NOTHING)

    def release(self) -> None:
        """Frees the textures, programs and the buffer; they are recreated on demand."""
        self._forget(())
        while self.programs:
            program, vertices = self.programs.popitem()[1]
            free(vertices, program)
        free(self.instances)
        self.instances = None

    def _forget(self, sprites: Sequence[Sprite]) -> None:
        """Frees the textures of all pictures but those of `sprites`."""
        for identity in self.textures.keys() - {id(sprite.pixels) for sprite in sprites}:
            self.textures.pop(identity)[1].release()

    def _sprites(self, size: tuple[int, int], sprites: Sequence[Sprite]) -> None:
        if not sprites:
            return
        if "sprite" not in self.programs:
            program = build(self.ctx, "sprite.vert", "sprite.frag", {})
            self.programs["sprite"] = program, self.ctx.vertex_array(program, [])
        program, drawn = self.programs["sprite"]
        program["size"] = size
        program["shown"] = 0
        for sprite in sprites:
            texture = self._texture(sprite.pixels)
            kind = moderngl.LINEAR if sprite.smooth else moderngl.NEAREST
            texture.filter = (kind, kind)
            texture.use(location=0)
            program["place"] = sprite.place
            drawn.render(moderngl.TRIANGLE_STRIP, vertices=4)

    def _texture(self, pixels: np.ndarray) -> moderngl.Texture:
        if id(pixels) not in self.textures:
            texture = self.ctx.texture(pixels.shape[1::-1], 4, np.ascontiguousarray(pixels))
            texture.repeat_x = texture.repeat_y = False
            self.textures[id(pixels)] = pixels, texture
        return self.textures[id(pixels)][1]

    def _strokes(self, size: tuple[int, int], strokes: Sequence[Stroke]) -> None:
        rows = [(*line.start, *line.stop, *line.color, line.width, line.rim) for line in strokes]
        data = np.array(rows, np.float32)
        if self.instances is None or self.instances.size < data.nbytes:
            self._grow(data.nbytes)
        assert self.instances is not None
        self.instances.write(data)
        program, drawn = self.programs["stroke"]
        program["size"] = size
        drawn.render(moderngl.TRIANGLE_STRIP, vertices=4, instances=len(rows))

    def _grow(self, size: int) -> None:
        if self.instances is not None:
            free(self.instances, self.programs["stroke"][1])
            program = self.programs["stroke"][0]
        else:
            program = build(self.ctx, "stroke.vert", "stroke.frag", {})
        self.instances = self.ctx.buffer(reserve=2 * size)
        layout = (self.instances, "2f 2f 4f 2f/i", "start", "stop", "ink", "widths")
        self.programs["stroke"] = program, self.ctx.vertex_array(program, [layout])
