"""Cache of compiled programs, keyed by the plan's choices, and the table of blend states."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import dataclass

import moderngl
import numpy as np

from splatgl.gl.cue_fields import CUES_BINDING, SAMPLERS
from splatgl.gl.mask_texture import MASK_SAMPLER, MASK_UNIT
from splatgl.gl.shader import ShaderError, compose, declared_switches
from splatgl.gl.uniforms import FRAME_BINDING, STYLE_BINDING
from splatgl.splat.kernel.kernels import kernel, polynomials, single_polynomial
from splatgl.splat.plan.plan import Program

Switches = Mapping[str, str | int | bool]
Chosen = tuple[tuple[str, str | int | bool], ...]


@dataclass(frozen=True)
class Blend:
    """GL blend state of premultiplied fragments."""

    equation: int
    source: int
    destination: int


# keyed by blend mode and, where order matters, front to back
BLEND_STATES = {
    ("over", False): Blend(moderngl.FUNC_ADD, moderngl.ONE, moderngl.ONE_MINUS_SRC_ALPHA),
    ("over", True): Blend(moderngl.FUNC_ADD, moderngl.ONE_MINUS_DST_ALPHA, moderngl.ONE),
    ("sum", False): Blend(moderngl.FUNC_ADD, moderngl.ONE, moderngl.ONE),
    ("max", False): Blend(moderngl.MAX, moderngl.ONE, moderngl.ONE),
    # of one value, see sheet_close.frag
    ("min", False): Blend(moderngl.MAX, moderngl.ONE, moderngl.ONE),
    ("mean", False): Blend(moderngl.FUNC_ADD, moderngl.ONE, moderngl.ONE),
}


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
        **({"SHEETS": look.sheets, "STEPS": look.steps, "WEIGHTED": look.weighted} if look.sheets else {}),
        **({"CLIPPED": True} if look.clipped else {}),
        **({"MASKED": True} if look.masked else {}),
        **({} if look.light.plain else {"LIGHT": True}),
        **({"SKY": True} if look.sky else {}),
        **({"SHADOWS": True} if look.shadows else {}),
        "ATTENUATION": f"ATTENUATION_{look.attenuation.upper().replace('-', '_')}",
        **({"PACKED": True} if program.packed else {}),
        "FOOTPRINT": f"FOOTPRINT_{program.footprint.upper()}",
        "MOTION": f"MOTION_{program.motion.upper()}",
        "FLOW": program.flow,
        "POINTS": program.points,
        "TILED": program.technique == "tiles",
        "DOUBLINGS": program.exp_doublings,
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


def _bind_blocks(program: moderngl.Program | moderngl.ComputeShader) -> None:
    for block, binding in (("Frame", FRAME_BINDING), ("Style", STYLE_BINDING), ("Cues", CUES_BINDING)):
        if block in program:
            program[block].binding = binding  # type: ignore[union-attr]
    for sampler, unit in (*SAMPLERS.items(), (MASK_SAMPLER, MASK_UNIT)):
        if sampler in program:
            program[sampler] = unit


class Programs:
    """The program cache; compiles on the first use of a plan's choices."""

    def __init__(self, ctx: moderngl.Context, owned: ExitStack) -> None:
        self.ctx = ctx
        self.owned = owned
        self.splat: dict[Chosen, moderngl.Program] = {}
        self.screen: dict[tuple[str, Chosen], moderngl.Program] = {}
        self.tiles: dict[tuple[str, Chosen], moderngl.ComputeShader] = {}
        # the switches that a shader reads, found once per request
        self.read: dict[tuple[object, ...], Chosen] = {}

    def for_splats(self, program: Program) -> moderngl.Program:
        """The program that draws splats as quads with a plan's choices."""
        stages = "splat.vert", "splat.frag"
        key = self._read(stages, program, {})
        if key not in self.splat:
            self.splat[key] = self._keep(build(self.ctx, *stages, dict(key)))
        return self.splat[key]

    def for_screen(
        self, fragment: str, program: Program | None = None, more: Switches | None = None
    ) -> moderngl.Program:
        """A fragment shader over the whole target, with a plan's choices if it has any; more: its own switches."""
        key = (fragment, self._read((fragment,), program, more or {}) if program else ())
        if key not in self.screen:
            self.screen[key] = self._keep(build(self.ctx, "whole.vert", fragment, dict(key[1])))
        return self.screen[key]

    def for_meshes(self, perspective: bool, light: bool) -> moderngl.Program:
        """The program that draws triangles. light: whether it is another than the plain one."""
        key = ("surface.frag", (("PERSPECTIVE", perspective), ("LIGHT", light)))
        if key not in self.screen:
            self.screen[key] = self._keep(build(self.ctx, "surface.vert", "surface.frag", dict(key[1])))
        return self.screen[key]

    def for_tiles(self, name: str, program: Program, more: Switches) -> moderngl.ComputeShader:
        """One of the tile compute shaders; more: its own switches."""
        key = (name, self._read((name,), program, more))
        if key not in self.tiles:
            self.tiles[key] = build_compute(self.ctx, name, dict(key[1]))
            self.owned.callback(self.tiles[key].release)
        return self.tiles[key]

    def _read(self, stages: tuple[str, ...], program: Program, more: Switches) -> Chosen:
        """The plan's switches that the shaders read; a change of any other recompiles nothing."""
        asked = (stages, program, *more.items())
        if asked not in self.read:
            read = frozenset().union(*map(declared_switches, stages))
            chosen = {**splat_switches(program), **more}
            self.read[asked] = tuple((switch, value) for switch, value in chosen.items() if switch in read)
        return self.read[asked]

    def _keep(self, program: moderngl.Program) -> moderngl.Program:
        self.owned.callback(program.release)
        return program
