"""Checks that OpenGL blends and filters as the renderer requires, by small drawings with closed-form answers."""

from __future__ import annotations

from dataclasses import dataclass

import moderngl
import numpy as np

from splatgl.gl.context import current

LAYERS = 2000  # layers of a fine volume: 8 bits lose every layer of this opacity, half floats a third of the sum
OPACITY = 0.001  # of one layer
SIDE = 8  # pixels of the target
# 2000 roundings to the nearest float32 at a sum of at most 2, each by half a unit in the last place of [1, 2)
FLOAT32_ERROR = LAYERS * 2.0**-24
TABLE_SIZE = 256  # texels of the footprint table
# Graphics cards store 8 fractional bits of the position between two texels; fewer are a fault
FILTER_ERROR = 2.0**-8  # fraction of the step between neighbouring texels

QUAD = """
#version 330 core
flat out int layer;
out float across;
void main() {
    vec2 corner = vec2(gl_VertexID & 1, gl_VertexID >> 1);
    layer = gl_InstanceID;
    across = corner.x;
    gl_Position = vec4(corner * 2.0 - 1.0, 0.0, 1.0);
}
"""
# Premultiplied white of one opacity, or (ramp) a different exact value per layer in shuffled order
LAYER = """
#version 330 core
flat in int layer;
in float across;
uniform float opacity;
uniform bool ramp;
out vec4 color;
void main() { color = vec4(ramp ? float((layer * 1237) % 2000) / 2048.0 : opacity); }
"""
SAMPLE = """
#version 330 core
flat in int layer;
in float across;
uniform sampler2D table;
out vec4 color;
void main() { color = vec4(texture(table, vec2(across, 0.5)).r); }
"""


@dataclass(frozen=True)
class SelfCheck:
    """Comparison of a drawing with the expected answer. `required`: float32 pictures are wrong if the check fails."""

    name: str
    got: float
    answer: float
    tolerance: float  # absolute
    required: bool

    @property
    def passed(self) -> bool:
        """Whether the drawing is within the tolerance of its answer."""
        return abs(self.got - self.answer) <= self.tolerance


def run_checks(ctx: moderngl.Context) -> tuple[SelfCheck, ...]:
    """Checks blending into float32, half and 8-bit targets, and filtering of float32 tables; frees all GL objects."""
    checks: list[SelfCheck] = []
    with current(ctx):
        for target, dtype in (("rgba32f", "f4"), ("rgba16f", "f2"), ("rgba8", "f1")):
            checks += _blending(ctx, target, dtype)
        checks.append(_filtering(ctx))
    return tuple(checks)


def _blending(ctx: moderngl.Context, target: str, dtype: str) -> list[SelfCheck]:
    """Checks LAYERS layers with each of the three blend states of the renderer."""
    over = (moderngl.ONE, moderngl.ONE_MINUS_SRC_ALPHA)
    add = (moderngl.ONE, moderngl.ONE)
    cases = (
        ("over", moderngl.FUNC_ADD, over, False, 1.0 - (1.0 - OPACITY) ** LAYERS, FLOAT32_ERROR),
        ("add", moderngl.FUNC_ADD, add, False, LAYERS * OPACITY, FLOAT32_ERROR),
        ("max", moderngl.MAX, add, True, (LAYERS - 1) / 2048.0, 0.0),
    )
    checks = []
    for name, equation, function, ramp, answer, tolerance in cases:
        pixels = _draw_layers(ctx, dtype, equation, function, ramp)
        # The largest error over all pixels and channels
        got = float(pixels.flat[np.abs(pixels - answer).argmax()])
        checks.append(SelfCheck(f"{name} {target}", got, answer, tolerance, required=dtype == "f4"))
    return checks


def _draw_layers(ctx: moderngl.Context, dtype: str, equation: int, function: tuple[int, int], ramp: bool) -> np.ndarray:
    """Returns the target after LAYERS full-screen quads: float64 [SIDE, SIDE, 4]."""
    program = ctx.program(vertex_shader=QUAD, fragment_shader=LAYER)
    program["ramp"] = ramp
    program["opacity"] = OPACITY
    ctx.enable_only(moderngl.BLEND)
    ctx.blend_func = function
    ctx.blend_equation = equation, equation  # of colour and of opacity
    pixels = _draw(ctx, program, (SIDE, SIDE), dtype, LAYERS)
    ctx.blend_equation = moderngl.FUNC_ADD, moderngl.FUNC_ADD
    ctx.enable_only(moderngl.NOTHING)
    return pixels


def _filtering(ctx: moderngl.Context) -> SelfCheck:
    """Checks linear filtering of a float32 table with values outside [0, 1]: largest error in steps between texels."""
    # Alternating values make every step the same height and every error visible
    step = 6.0
    table = np.where(np.arange(TABLE_SIZE) % 2 == 0, -3.0, -3.0 + step).astype("f4")
    texture = ctx.texture((TABLE_SIZE, 1), 1, table.tobytes(), dtype="f4")
    texture.filter = (moderngl.LINEAR, moderngl.LINEAR)
    texture.repeat_x = texture.repeat_y = False

    # Slightly over 16 pixels per texel, so that all positions between two texels differ
    width = TABLE_SIZE * 16 + 1
    program = ctx.program(vertex_shader=QUAD, fragment_shader=SAMPLE)
    ctx.enable_only(moderngl.NOTHING)
    texture.use(0)
    pixels = _draw(ctx, program, (width, 1), "f4", 1)[0, :, 0]
    texture.release()

    position = (np.arange(width) + 0.5) / width * TABLE_SIZE - 0.5  # in texels, texel centres at whole numbers
    answer = np.interp(position, np.arange(TABLE_SIZE), table)  # clamps at the ends, as the texture does
    error = float(np.abs(pixels - answer).max() / step)
    return SelfCheck("linear filter r32f", error, 0.0, FILTER_ERROR, required=True)


def _draw(
    ctx: moderngl.Context, program: moderngl.Program, size: tuple[int, int], dtype: str, layers: int
) -> np.ndarray:
    """Draws `layers` full-screen quads into a new target; returns it as float64 [H, W, 4] and frees the program too."""
    texture = ctx.texture(size, 4, dtype=dtype)
    target = ctx.framebuffer([texture])
    vertices = ctx.vertex_array(program, [])
    target.use()
    target.clear()
    vertices.render(moderngl.TRIANGLE_STRIP, vertices=4, instances=layers)
    raw = np.frombuffer(target.read(components=4, dtype="f4"), "f4")
    # moderngl rebinds the bound target when it creates the next one, so a deleted target must not stay bound
    ctx.detect_framebuffer(0).use()
    for resource in (vertices, target, texture, program):
        resource.release()
    return raw.reshape(size[1], size[0], 4).astype(np.float64)
