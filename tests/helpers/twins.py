"""Runs GLSL functions on arrays of numbers, to compare them with their float64 twins."""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable, Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Any

import moderngl
import numpy as np
import pytest

import splatgl as sg
from splatgl.geometry.view import GridView
from splatgl.gl import shader
from splatgl.gl.features import FIELD_UNITS, FRAME_BINDING, STYLE_BINDING, feature_uniforms, frame_block, style_block
from splatgl.gl.program import build, splat_switches
from splatgl.gl.textures import BLUR_UNIT, FOOTPRINT_UNIT, HALF_LINE_UNIT
from splatgl.planning.plan import Plan

COUNT = 2000
UNITS = {"footprint_table": FOOTPRINT_UNIT, "half_table": HALF_LINE_UNIT, "blur_table": BLUR_UNIT, **FIELD_UNITS}
# what a stage declares of its own: storage qualifiers, layouts
OWN = re.compile(r"^(#define (VARYING|FLAT|CLASS_TEXEL)\b|layout\()")
# a buffer of numbers, which a function reads or writes: here an array of one
BUFFER = re.compile(r"^layout\(.*\bbuffer \w+ \{ (\w+ \w+)\[\]; \};.*$", re.MULTILINE)
FUNCTION = re.compile(r"^\w+ (\w+)\([^;{]*\) \{", re.MULTILINE)
KINDS = {1: "float", 2: "vec2", 3: "vec3", 4: "vec4"}
Twin = Callable[..., np.ndarray]


def read_again() -> None:
    """Forgets the shader files, which a test has changed."""
    for cached in (shader._read, shader._parsed, shader._declared, shader._choosing, shader._expand_all):
        cached.cache_clear()


@pytest.fixture
def twin(renderer: sg.Renderer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Twin]:
    """twin(files, expression, plan, splats, state, **inputs): float64 [N, 4], what GLSL computes for each of N inputs.

    files: those with the functions; of a stage all but `main`. state: uniforms, and switches in capitals.
    """
    folder = tmp_path / "shaders"
    shutil.copytree(shader.folder(), folder)
    monkeypatch.setattr(shader, "folder", lambda: folder)
    read_again()

    def computed(
        files: str,
        expression: str,
        plan: Plan | None = None,
        splats: sg.Splats | None = None,
        state: Mapping[str, Any] | None = None,
        **inputs: Any,
    ) -> np.ndarray:
        arrays = {
            name: np.ascontiguousarray(value, np.float32).reshape(len(value), -1) for name, value in inputs.items()
        }
        (folder / "twin.vert").write_text(_source(folder, files.split(), expression, arrays))
        read_again()
        known = shader.declared_switches("twin.vert")
        chosen = splat_switches(plan.program) if plan else {}
        chosen.update({name: value for name, value in (state or {}).items() if name.isupper()})
        switches = {name: value for name, value in chosen.items() if name in known}
        program = build(renderer.ctx, "twin.vert", None, switches, varyings=("result",))
        features = feature_uniforms(splats, plan) if plan and splats else {}
        uniforms = {name: value for name, value in {**UNITS, **features, **(state or {})}.items() if name in program}
        for name, value in uniforms.items():
            program[name] = value
        made = _bind(renderer, plan, splats) if plan and splats else []
        return _run(renderer.ctx, program, arrays, made)

    yield computed
    read_again()


def _source(folder: Path, files: list[str], expression: str, arrays: Mapping[str, np.ndarray]) -> str:
    """A vertex shader with the files' functions, whose result is what the expression writes."""
    version = max(_version(name) for name in files)
    parts = [f"// version {version}", "#define VARYING\n#define FLAT\nvec4 coordinate;"]
    for name in files:
        if not name.endswith(".glsl"):
            text = (folder / name).read_text().partition("void main()")[0].replace("gl_FragCoord", "coordinate")
            text = BUFFER.sub(r"\1[1];", text.replace("gl_LocalInvocationID", "uvec3(0u)"))
            name += ".glsl"
            lines = [line for line in text.splitlines() if not OWN.match(line) and not shader.VERSION_LINE.match(line)]
            (folder / name).write_text("\n".join(lines))
        parts.append(f'#include "{name}"')
    parts += [f"in {KINDS[value.shape[1]]} {name};" for name, value in arrays.items()]
    parts.append(f"out vec4 result;\nvoid main() {{ gl_Position = vec4(0.0); result = vec4(0.0); {expression}; }}")
    return "\n".join(parts) + "\n"


@cache
def _version(name: str) -> int:
    """The lowest GLSL version of the stages that are or include a file: all that its functions may count on.

    Stages without a version that could be composed with COMPUTE are not: theirs is off, a twin's is on.
    """
    stages = [path.name for path in shader.folder().iterdir() if path.suffix != ".glsl" and path.name != "twin.vert"]
    expanded = {stage: list(shader._expand(stage, (), set())) for stage in stages}
    for stage, blocks in list(expanded.items()):
        if "COMPUTE" in shader.declared_switches(stage) and not any(block.version for block in blocks):
            del expanded[stage]
    using = [
        blocks
        for blocks in expanded.values()
        if any(place.startswith(f"{name}:") for block in blocks for place in block.places)
    ]
    versions = [[int(block.version[1]) for block in blocks if block.version] for blocks in using]
    return min((found[0] if found else shader.VERSION for found in versions), default=shader.VERSION)


def _bind(renderer: sg.Renderer, plan: Plan, splats: sg.Splats) -> list[Any]:
    """Binds the plan's blocks and tables; returns the blocks' buffers."""
    made = []
    for binding, block in ((FRAME_BINDING, frame_block(splats, plan)), (STYLE_BINDING, style_block(splats, plan))):
        made.append(renderer.ctx.buffer(block.tobytes()))
        made[-1].bind_to_uniform_block(binding)
    renderer.passes.device.tables.use(plan)
    renderer.passes.device.fields.use(splats, plan)
    return made


def _run(ctx: moderngl.Context, program: Any, arrays: Mapping[str, np.ndarray], made: list[Any]) -> np.ndarray:
    content = [(ctx.buffer(value), f"{value.shape[1]}f4", name) for name, value in arrays.items() if name in program]
    count = len(next(iter(arrays.values())))
    out = ctx.buffer(reserve=count * 16)
    array = ctx.vertex_array(program, content)
    array.transform(out, vertices=count)
    found = np.frombuffer(out.read(), np.float32).reshape(count, 4).astype(np.float64)
    for thing in (array, out, *(buffer for buffer, *_ in content), program, *made):
        thing.release()
    return found


def functions() -> dict[str, str]:
    """Names of all GLSL functions but `main`, and their files."""
    found = {}
    for path in sorted(shader.folder().iterdir()):
        found.update({name: path.name for name in FUNCTION.findall(path.read_text(encoding="utf-8"))})
    found.pop("main")
    return found


def some_voxels(rng: np.random.Generator, view: GridView, splats: sg.Splats, beside: float = 2.0) -> np.ndarray:
    """Random voxels [3, N] among the splats; in perspective deeper than `beside` kernel reaches."""
    low, high = splats.index_bounds
    voxel = view.voxels(rng.uniform(low, high, (COUNT, 3)))
    return voxel[:, voxel[2] > (beside * view.reach if view.perspective else -np.inf)]


def pixel_of(view: GridView, voxel: np.ndarray) -> np.ndarray:
    """[2, N]: where voxels [3, N] are in the picture, pixels."""
    place = voxel[:2] / (voxel[2] if view.perspective else 1.0)
    return np.asarray(place / view.pitch + np.array(view.size)[:, None] / 2)
