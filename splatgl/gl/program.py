"""Cache of compiled programs, keyed by the plan's choices, and OpenGL's blend state."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import ExitStack
from typing import cast

import moderngl
import numpy as np

from splatgl.gl.features import FIELD_UNITS, features_of
from splatgl.gl.shader import ShaderError, compose, declared_switches
from splatgl.gl.uniforms import FRAME_BINDING, STYLE_BINDING
from splatgl.splat.kernels import kernel, polynomials, single_polynomial
from splatgl.splat.plan import Program
from splatgl.splat.settings import BlendMode

Switches = Mapping[str, str | int | bool]
Chosen = tuple[tuple[str, str | int | bool], ...]
Compiled = moderngl.Program | moderngl.ComputeShader

# most compiled programs that are kept: a combination of settings takes some five, of 2 MB each with llvmpipe
MOST_PROGRAMS = 48


def use_blend(ctx: moderngl.Context, mode: BlendMode, nearest_first: bool = True) -> None:
    """Makes OpenGL blend premultiplied fragments, of extremes the maximum; for a minimum shaders write −value."""
    ctx.enable_only(moderngl.BLEND)
    ctx.blend_equation = moderngl.MAX if mode.extreme else moderngl.FUNC_ADD  # type: ignore[assignment]
    if not mode.ordered:
        ctx.blend_func = moderngl.ONE, moderngl.ONE
    elif nearest_first:
        ctx.blend_func = moderngl.ONE_MINUS_DST_ALPHA, moderngl.ONE
    else:
        ctx.blend_func = moderngl.ONE, moderngl.ONE_MINUS_SRC_ALPHA


def splat_switches(program: Program) -> dict[str, str | int | bool]:
    """The shader switches that a plan's choices set."""
    look, seen = program.look, program.seen
    return {
        "ALIGN": f"ALIGN_{program.align.upper()}",
        "PERSPECTIVE": seen.perspective,
        "ANTIALIAS": seen.antialias,
        "CUBIC": seen.cubic,
        "HALF_LINE": seen.half_line,
        "SHADING": look.shading,
        "JOIN": f"JOIN_{look.blend.join.upper()}",
        # values are means by shares of the peak
        "PEAK": look.blend.peak or look.steps > 0,
        **({"SHEETS": look.sheets, "STEPS": look.steps} if look.sheets else {}),
        "ATTENUATION": f"ATTENUATION_{look.attenuation.upper().replace('-', '_')}",
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
    """The coefficients in the five vectors of footprint_eval.glsl."""
    if program.footprint == "single":
        numbers = [*single_polynomial(program.kernel), kernel(program.kernel).radius ** -2]
    elif program.footprint == "polynomial":
        fitted = polynomials(program.kernel)
        assert fitted is not None
        numbers = [*fitted.inner, *fitted.outer, fitted.split, kernel(program.kernel).radius ** -2]
    else:
        return {}
    vectors = np.pad(np.array(numbers, np.float32), (0, -len(numbers) % 4)).reshape(-1, 4).tolist()
    return {f"POLYNOMIALS_{n}": f"vec4({', '.join(map(repr, vector))})" for n, vector in enumerate(vectors)}


def build(
    ctx: moderngl.Context, vertex: str, fragment: str | None, switches: Switches, varyings: tuple[str, ...] = ()
) -> moderngl.Program:
    """Composes and compiles one program; compiler messages are mapped to files and lines."""
    stages = [name for name in (vertex, fragment) if name]
    known = frozenset().union(*map(declared_switches, stages))
    texts = [compose(name, switches, known) for name in stages]
    try:
        program = ctx.program(
            vertex_shader=texts[0].source,
            fragment_shader=texts[1].source if fragment else None,
            varyings=varyings,
        )
    except moderngl.Error as error:
        # moderngl's message names the stage that failed
        stage = 1 if fragment and "fragment_shader" in str(error) else 0
        raise ShaderError(f"{stages[stage]}: {texts[stage].explain(str(error))}") from error
    _bind_blocks(program)
    return program


def build_compute(ctx: moderngl.Context, name: str, switches: Switches) -> moderngl.ComputeShader:
    """Composes and compiles a compute shader."""
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


class Programs:
    """The program cache; compiles on the first use of a plan's choices, and frees what was used longest ago."""

    def __init__(self, ctx: moderngl.Context, owned: ExitStack) -> None:
        self.ctx = ctx
        # by shader files and switches, the latest used last; and how many were compiled
        self.kept: dict[tuple[tuple[str, ...], Chosen], Compiled] = {}
        self.compiled = 0
        # the switches that a shader reads, found once per request
        self.read: dict[tuple[object, ...], Chosen] = {}
        owned.callback(self._free, 0)

    def for_splats(self, program: Program) -> moderngl.Program:
        """The program that draws splats as quads with a plan's choices."""
        stages = "splat.vert", "splat.frag"
        return self._drawing(*stages, self._read(stages, program, {}))

    def for_screen(
        self, fragment: str, program: Program | None = None, more: Switches | None = None
    ) -> moderngl.Program:
        """A fragment shader over the whole target, with a plan's choices if it has any; more: its own switches."""
        chosen = self._read((fragment,), program, more or {}) if program else ()
        return self._drawing("whole.vert", fragment, chosen)

    def for_meshes(self, perspective: bool, light: bool) -> moderngl.Program:
        """The program that draws triangles. light: whether it is another than the plain one."""
        return self._drawing("surface.vert", "surface.frag", (("PERSPECTIVE", perspective), ("LIGHT", light)))

    def for_tiles(self, name: str, program: Program, more: Switches) -> moderngl.ComputeShader:
        """One of the tile compute shaders; more: its own switches."""
        chosen = self._read((name,), program, more)
        found = self._kept((name,), chosen, lambda: build_compute(self.ctx, name, dict(chosen)))
        return cast(moderngl.ComputeShader, found)

    def _drawing(self, vertex: str, fragment: str, chosen: Chosen) -> moderngl.Program:
        found = self._kept((vertex, fragment), chosen, lambda: build(self.ctx, vertex, fragment, dict(chosen)))
        return cast(moderngl.Program, found)

    def _kept(self, stages: tuple[str, ...], chosen: Chosen, compiled: Callable[[], Compiled]) -> Compiled:
        """What is compiled of these files and switches."""
        found = self.kept.pop((stages, chosen), None)
        if found is None:
            found = compiled()
            self.compiled += 1
        self.kept[stages, chosen] = found
        self._free(MOST_PROGRAMS)
        return found

    def _free(self, most: int) -> None:
        while len(self.kept) > most:
            found = self.kept.pop(next(iter(self.kept)))
            if isinstance(found, moderngl.Program) and found.extra is not None:
                found.extra.release()
            found.release()

    def _read(self, stages: tuple[str, ...], program: Program, more: Switches) -> Chosen:
        """The plan's switches that the shaders read; a change of any other recompiles nothing."""
        asked = (stages, program, *more.items())
        if asked not in self.read:
            read = frozenset().union(*map(declared_switches, stages))
            chosen = {**splat_switches(program), **more}
            self.read[asked] = tuple((switch, value) for switch, value in chosen.items() if switch in read)
        return self.read[asked]
