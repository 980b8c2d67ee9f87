"""Compiles shader programs, caches them by the plan's switches, and sets OpenGL's blend state."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import ExitStack
from typing import TypeAlias, cast

import moderngl
import numpy as np

from splatgl.gl.features import FIELD_UNITS, FRAME_BINDING, STYLE_BINDING, features_of
from splatgl.gl.shader import ComputeShape, ShaderError, compose, declared_switches
from splatgl.planning.plan import Program
from splatgl.splat.kernels import kernel, polynomials, single_polynomial

Switches = Mapping[str, str | int | bool]
Chosen = tuple[tuple[str, str | int | bool], ...]
Compiled: TypeAlias = moderngl.Program | moderngl.ComputeShader

# maximum number of cached programs: a combination of settings needs about five, of 2 MB each with llvmpipe
MOST_PROGRAMS = 48
# how blends join values of which one remains
EXTREMES = ("max", "min", "attenuated")


def use_blend(ctx: moderngl.Context, join: str = "over", nearest_first: bool = True) -> None:
    """Sets the blending of premultiplied fragments, as a blend joins them; extremes use the maximum (for a minimum,
    shaders write −value), and the sum of optical depths as alpha.
    """
    ctx.enable_only(moderngl.BLEND)
    equation = moderngl.MAX if join in EXTREMES else moderngl.FUNC_ADD
    alpha = moderngl.FUNC_ADD if join == "attenuated" else equation
    ctx.blend_equation = equation, alpha
    if join != "over":
        ctx.blend_func = moderngl.ONE, moderngl.ONE
    elif nearest_first:
        ctx.blend_func = moderngl.ONE_MINUS_DST_ALPHA, moderngl.ONE
    else:
        ctx.blend_func = moderngl.ONE, moderngl.ONE_MINUS_SRC_ALPHA


def splat_switches(program: Program) -> dict[str, str | int | bool]:
    """Returns the shader switches of a plan's program."""
    appearance, seen = program.appearance, program.seen
    return {
        "ALIGN": f"ALIGN_{program.align.upper()}",
        "PERSPECTIVE": seen.perspective,
        "ANTIALIAS": seen.antialias,
        "CUBIC": seen.cubic,
        "HALF_LINE": seen.half_line,
        "SHADING": appearance.shading,
        "JOIN": f"JOIN_{appearance.join.upper()}",
        # values are means weighted by shares of the peak
        "PEAK": appearance.join == "max" or appearance.steps > 0,
        **({"SHEETS": appearance.sheets, "STEPS": appearance.steps} if appearance.sheets else {}),
        "ATTENUATION": f"ATTENUATION_{appearance.attenuation.upper().replace('-', '_')}",
        "FOOTPRINT": f"FOOTPRINT_{program.footprint.upper()}",
        "MOTION": f"MOTION_{program.motion.upper()}",
        "FLOW": program.flow,
        "POINTS": program.points,
        "TILED": program.technique == "tiles",
        "DOUBLINGS": program.exp_doublings,
        **{feature.switch: True for feature in features_of(program)},
        **_polynomials(program),
    }


def _polynomials(program: Program) -> dict[str, str]:
    """Returns the kernel's coefficients as the vectors of footprint_eval.glsl; empty without polynomials."""
    if program.footprint == "single":
        coefficients = [*single_polynomial(program.kernel), kernel(program.kernel).radius ** -2]
    elif program.footprint == "polynomial":
        pieces = polynomials(program.kernel)
        assert pieces is not None
        coefficients = [*pieces.inner, *pieces.outer, pieces.split, kernel(program.kernel).radius ** -2]
    else:
        return {}
    vectors = np.pad(np.array(coefficients, np.float32), (0, -len(coefficients) % 4)).reshape(-1, 4).tolist()
    return {f"POLYNOMIALS_{n}": f"vec4({', '.join(map(repr, vector))})" for n, vector in enumerate(vectors)}


def build(
    ctx: moderngl.Context, vertex: str, fragment: str | None, switches: Switches, varyings: tuple[str, ...] = ()
) -> moderngl.Program:
    """Composes and compiles a program; ShaderError names the files and lines of compiler messages."""
    stages = [name for name in (vertex, fragment) if name]
    declared = frozenset().union(*map(declared_switches, stages))
    texts = [compose(name, switches, declared) for name in stages]
    try:
        program = ctx.program(
            vertex_shader=texts[0].source, fragment_shader=texts[1].source if fragment else None, varyings=varyings
        )
    except moderngl.Error as error:
        # the message of moderngl names the stage that failed
        stage = 1 if fragment and "fragment_shader" in str(error) else 0
        raise ShaderError(f"{stages[stage]}: {texts[stage].explain(str(error))}") from error
    _bind_blocks(program)
    return program


def build_compute(ctx: moderngl.Context, name: str, switches: Switches) -> moderngl.ComputeShader:
    """Composes and compiles a compute shader; ShaderError as in `build`."""
    text = compose(name, switches)
    try:
        program = ctx.compute_shader(text.source)
    except moderngl.Error as error:
        raise ShaderError(f"{name}: {text.explain(str(error))}") from error
    _bind_blocks(program)
    return program


def _bind_blocks(program: Compiled) -> None:
    for block, binding in (("Frame", FRAME_BINDING), ("Style", STYLE_BINDING)):
        if block in program:
            program[block].binding = binding  # type: ignore[union-attr]
    for sampler, unit in FIELD_UNITS.items():
        if sampler in program:
            program[sampler] = unit


def set_uniforms(program: Compiled, **values: object) -> None:
    """Sets the uniforms; skips those that the program lacks."""
    for name, value in values.items():
        # `in` would walk all members
        if program.get(name, None) is not None:
            program[name] = value


def cover(program: moderngl.Program) -> None:
    """Draws one triangle over the bound framebuffer."""
    if program.extra is None:
        # Programs frees it with the program
        program.extra = program.ctx.vertex_array(program, [])
    program.extra.render(moderngl.TRIANGLES, vertices=3)


class Programs:
    """LRU cache of compiled programs; compiles a program on its first use. shape: of the compute shaders."""

    def __init__(self, ctx: moderngl.Context, owned: ExitStack, shape: ComputeShape) -> None:
        self.ctx, self.shape = ctx, shape
        # programs by shader files and switches, the most recently used last; number of compilations
        self.kept: dict[tuple[tuple[str, ...], Chosen], Compiled] = {}
        self.compiled = 0
        # switches that the shaders read, by request
        self.read: dict[tuple[object, ...], Chosen] = {}
        owned.callback(self._free, 0)

    def for_splats(self, program: Program, more: Switches | None = None) -> moderngl.Program:
        """Returns the program that draws splats as quads with a plan's switches. more: additional switches."""
        stages = "splat.vert", "splat.frag"
        return self._drawing(*stages, self._read(stages, program, {**self.shape.switches, **(more or {})}))

    def for_screen(
        self, fragment: str, program: Program | None = None, more: Switches | None = None
    ) -> moderngl.Program:
        """Returns the program of a fragment shader that covers the target. more: switches beside those of `program`."""
        chosen = self._read((fragment,), program, more or {}) if program else ()
        return self._drawing("whole.vert", fragment, chosen)

    def for_meshes(self, perspective: bool, light: bool, textured: bool) -> moderngl.Program:
        """Returns the program that draws triangles. light: whether the light differs from the plain one."""
        chosen = (("PERSPECTIVE", perspective), ("LIGHT", light), ("TEXTURED", textured))
        return self._drawing("surface.vert", "surface.frag", chosen)

    def for_tiles(self, name: str, program: Program, more: Switches) -> moderngl.ComputeShader:
        """Returns a compute shader of the tiles. more: additional switches."""
        chosen = self._read((name,), program, {**self.shape.switches, **more})
        compiled = self._kept((name,), chosen, lambda: build_compute(self.ctx, name, dict(chosen)))
        return cast(moderngl.ComputeShader, compiled)

    def _drawing(self, vertex: str, fragment: str, chosen: Chosen) -> moderngl.Program:
        compiled = self._kept((vertex, fragment), chosen, lambda: build(self.ctx, vertex, fragment, dict(chosen)))
        return cast(moderngl.Program, compiled)

    def _kept(self, stages: tuple[str, ...], chosen: Chosen, compiled: Callable[[], Compiled]) -> Compiled:
        """Returns the program of these files and switches from the cache; compiles it on a miss."""
        program = self.kept.pop((stages, chosen), None)
        if program is None:
            program = compiled()
            self.compiled += 1
        self.kept[stages, chosen] = program
        self._free(MOST_PROGRAMS)
        return program

    def _free(self, most: int) -> None:
        while len(self.kept) > most:
            program = self.kept.pop(next(iter(self.kept)))
            if isinstance(program, moderngl.Program) and program.extra is not None:
                program.extra.release()
            program.release()

    def _read(self, stages: tuple[str, ...], program: Program, more: Switches) -> Chosen:
        """Returns the switches that the shaders read, so that a change of another one recompiles nothing."""
        key = (stages, program, *more.items())
        if key not in self.read:
            read = frozenset().union(*map(declared_switches, stages))
            chosen = {**splat_switches(program), **more}
            self.read[key] = tuple((switch, value) for switch, value in chosen.items() if switch in read)
        return self.read[key]
