"""`Marks`: strokes and small pictures that a window shows over its picture, drawn by OpenGL in its pixels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import moderngl
import numpy as np

from splatgl.gl.program import build

Color = tuple[float, float, float, float]
Place = tuple[float, float]


@dataclass(frozen=True)
class Stroke:
    """A straight line with round ends, a dot where both are one. start, stop: pixels, (0, 0) at the upper left corner;
    color: sRGB, straight alpha, 0 … 1; width, and that of a dark rim around it, pixels.
    """

    start: Place
    stop: Place
    color: Color
    width: float = 1.5
    rim: float = 1.0


@dataclass(frozen=True, eq=False)
class Sprite:
    """A picture uint8 [h, w, 4], sRGB, straight alpha, row 0 on top, in a rectangle of the window: left, top, right,
    bottom, pixels. smooth: interpolated. The same array is uploaded once.
    """

    pixels: np.ndarray
    place: tuple[float, float, float, float]
    smooth: bool = False


@dataclass(frozen=True, eq=False)
class Marks:
    """What is drawn, sprites first, in order."""

    sprites: tuple[Sprite, ...] = ()
    strokes: tuple[Stroke, ...] = ()

    def __bool__(self) -> bool:
        return bool(self.sprites or self.strokes)


class Marker:
    """Draws marks with a window's context, which is current."""

    def __init__(self, ctx: moderngl.Context) -> None:
        self.ctx = ctx
        self.programs: dict[str, tuple[moderngl.Program, moderngl.VertexArray]] = {}
        self.instances: moderngl.Buffer | None = None
        # by the identity of their pixels, which are kept so that none is given to others
        self.textures: dict[int, tuple[np.ndarray, moderngl.Texture]] = {}

    def draw(self, size: tuple[int, int], marks: Marks) -> None:
        """Draws into the bound framebuffer of `size` pixels."""
        self.ctx.enable_only(moderngl.BLEND)
        self.ctx.blend_func = moderngl.SRC_ALPHA, moderngl.ONE_MINUS_SRC_ALPHA
        self._forget(marks.sprites)
        if marks.sprites:
            self._sprites(size, marks.sprites)
        if marks.strokes:
            self._strokes(size, marks.strokes)
        self.ctx.enable_only(moderngl.NOTHING)

    def release(self) -> None:
        """Frees what was made."""
        self._forget(())
        while self.programs:
            program, drawn = self.programs.popitem()[1]
            drawn.release()
            program.release()
        if self.instances is not None:
            self.instances.release()
            self.instances = None

    def _forget(self, kept: Sequence[Sprite]) -> None:
        for identity in self.textures.keys() - {id(each.pixels) for each in kept}:
            self.textures.pop(identity)[1].release()

    def _sprites(self, size: tuple[int, int], sprites: Sequence[Sprite]) -> None:
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
        rows = [(*each.start, *each.stop, *each.color, each.width, each.rim) for each in strokes]
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
            self.instances.release()
            self.programs["stroke"][1].release()
            program = self.programs["stroke"][0]
        else:
            program = build(self.ctx, "stroke.vert", "stroke.frag", {})
        self.instances = self.ctx.buffer(reserve=2 * size)
        layout = (self.instances, "2f 2f 4f 2f/i", "start", "stop", "ink", "widths")
        self.programs["stroke"] = program, self.ctx.vertex_array(program, [layout])
