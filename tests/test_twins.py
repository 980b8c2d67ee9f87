"""GLSL functions and their float64 twins on the same random numbers, each with a stated bound."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from noise import GRIDS, inside, noise, views

import splatgl as sg
from splatgl.gl import shader
from splatgl.gl.program import build, splat_switches
from splatgl.gl.tables import BLUR_UNIT, FOOTPRINT_UNIT, HALF_LINE_UNIT
from splatgl.gl.uniforms import FRAME_BINDING, STYLE_BINDING, frame_block, style_block
from splatgl.splat.classification.shading import head_light
from splatgl.splat.extraction.run_lengths import OCTAVES
from splatgl.splat.integral.attenuation import filled_depth
from splatgl.splat.integral.line_integral import row1
from splatgl.splat.kernel.kernels import kernel, polynomials
from splatgl.splat.motion.motion import NEAREST, streaks
from splatgl.splat.motion.motion_opacity import dwelt_depth, isolation
from splatgl.splat.plan.plan import Plan
from splatgl.splat.view.block_culling import Frustum
from splatgl.truth.streak_row import passing

COUNT = 2000
UNITS = {"footprint_table": FOOTPRINT_UNIT, "half_table": HALF_LINE_UNIT, "blur_table": BLUR_UNIT}
Twin = Callable[..., np.ndarray]


@pytest.fixture
def twin(renderer: sg.Renderer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Twin]:
    """twin(files, expression, plan, splats, **inputs): float32 [N, k], what GLSL computes for each of N inputs."""
    folder = tmp_path / "shaders"
    shutil.copytree(shader.folder(), folder)
    monkeypatch.setattr(shader, "folder", lambda: folder)
    shader._read.cache_clear()
    ctx = renderer.ctx

    def computed(
        files: str, expression: str, plan: Plan | None = None, splats: sg.Splats | None = None, **inputs: Any
    ) -> np.ndarray:
        arrays = {
            name: np.ascontiguousarray(value, np.float32).reshape(len(value), -1) for name, value in inputs.items()
        }
        kinds = {1: "float", 2: "vec2", 3: "vec3", 4: "vec4"}
        head = "#define ATTRIBUTE\n#define VARYING\n#define FLAT\n"
        body = "".join(f'#include "{name}"\n' for name in files.split())
        given = "".join(f"in {kinds[value.shape[1]]} {name};\n" for name, value in arrays.items())
        main = f"out vec4 result;\nvoid main() {{ gl_Position = vec4(0.0); result = vec4(0.0); {expression}; }}\n"
        (folder / "twin.vert").write_text(head + body + given + main)
        shader._read.cache_clear()
        known = shader.declared_switches("twin.vert")
        switches = {k: v for k, v in splat_switches(plan.program).items() if k in known} if plan else {}
        program = build(ctx, "twin.vert", None, switches, varyings=("result",))
        made: list[Any] = [program]
        if plan and splats:
            blocks = (FRAME_BINDING, frame_block(splats, plan)), (STYLE_BINDING, style_block(splats, plan))
            for binding, block in blocks:
                made.append(ctx.buffer(block.tobytes()))
                made[-1].bind_to_uniform_block(binding)
            renderer.passes.tables.use(plan)
            for name, unit in UNITS.items():
                if name in program:
                    program[name] = unit
        content = [
            (ctx.buffer(value), f"{value.shape[1]}f4", name) for name, value in arrays.items() if name in program
        ]
        count = len(next(iter(arrays.values())))
        out = ctx.buffer(reserve=count * 16)
        array = ctx.vertex_array(program, content)
        array.transform(out, vertices=count)
        found = np.frombuffer(out.read(), np.float32).reshape(count, 4).astype(np.float64)
        things: list[Any] = [array, out, *(buffer for buffer, *_ in content), *reversed(made)]
        for thing in things:
            thing.release()
        return found

    yield computed
    shader._read.cache_clear()


def test_opacities(twin: Twin, rng: np.random.Generator) -> None:
    depth = 10.0 ** rng.uniform(-9, 1.4, COUNT)
    right = -np.expm1(-depth)
    exact = twin("optics.glsl", "result.x = one_minus_exp(x)", x=depth)[:, 0]
    assert np.abs(exact / right - 1).max() < 3e-6
    quick = twin("optics.glsl", "result.x = quick_one_minus_exp(x * QUICK_SCALE)", x=depth)[:, 0]
    assert np.abs(quick / right - 1).max() < 2e-6


@pytest.mark.parametrize("name", ["crawfis-max", "gaussian"])
@pytest.mark.parametrize("tolerance", [1 / 255, 1e-6])
def test_radial_footprints(name: str, tolerance: float, twin: Twin, rng: np.random.Generator) -> None:
    """A table's by 1e−5 of the peak, polynomials' by 5e−5 of themselves."""
    splats, shape = noise(), kernel(name)
    settings = sg.Settings(kernel=name, tolerance=tolerance)
    plan = sg.plan(splats, views(splats)["fitted"], settings, tiles=True)
    d2 = rng.uniform(0, 1.1 * shape.radius**2, COUNT)
    found = twin("footprint_eval.glsl", "result.x = radial(x)", plan, splats, x=d2)[:, 0]
    right = shape.footprint(np.sqrt(d2)) / shape.footprint(np.zeros(()))
    assert (plan.program.footprint == "polynomial") == (tolerance > 1e-3 and polynomials(name) is not None)
    assert np.abs(found - right).max() < (1e-5 if plan.program.footprint == "radial" else 5e-5)


@pytest.mark.parametrize("grid", GRIDS)
@pytest.mark.parametrize("view", ["far", "fitted", "close", "wide", "parallel", "parallel, far", "inside"])
@pytest.mark.parametrize("technique", ["quads", "tiles"])
def test_line_integrals(grid: str, view: str, technique: str, twin: Twin, rng: np.random.Generator) -> None:
    """A splat's value at a pixel, by its quad or by its projection, against row 1; in shares of the largest."""
    splats = noise(grid)
    camera = inside(splats, (0.4, 0.9, 0.2)) if view == "inside" else views(splats)[view]
    tiles = technique == "tiles"
    plan = sg.plan(splats, camera, sg.Settings(blend="xray", tolerance=1e-6, technique=technique), tiles=tiles)
    if plan.program.align != "exact":
        # a parallel view's quads are Table 1's, which are exact there
        assert not plan.view.perspective
    low, high = splats.index_bounds
    voxel = plan.view.voxels(rng.uniform(low, high, (COUNT, 3)))
    beside = 2.0 if plan.view.perspective else -1e9
    voxel = voxel[:, voxel[2] > beside * plan.view.reach]
    # a pixel that the splat covers
    side = plan.view.pixel_side(voxel[2]) if plan.view.perspective else plan.view.pitch
    near = rng.uniform(-1, 1, (2, voxel.shape[1])) * np.maximum(side, plan.view.widths[1])
    place = (voxel[:2] + near) / (voxel[2] if plan.view.perspective else 1.0)
    pixel = place / plan.view.pitch + np.array(plan.view.size)[:, None] / 2
    expression = """
        Quad quad = splat_quad(v);
        bend = quad.bend; cubic = quad.cubic; mixed = quad.mixed;
        Projected it = projected(v, quad);
        vec2 off = p - it.center;
        Ray ray = ray_of(p);
        at = vec2(dot(it.to_local.xy, off), dot(it.to_local.zw, off));
        result.x = ALIGN == ALIGN_EXACT ? exact_share(at, ray.shrink, ray) : radial(dot(at, at));
        result.x *= quad.gain * style.peak
    """
    found = twin("projection.glsl footprint_eval.glsl", expression, plan, splats, v=voxel.T, p=pixel.T)[:, 0]
    right = row1(plan.view, voxel, place).value
    assert right.max() > 0.01
    # beyond z_k `exact` is right to second order
    allowed = 1e-4 if not plan.view.antialias else 5e-3
    assert np.abs(found - right).max() < allowed * right.max()


def test_half_lines(twin: Twin, rng: np.random.Generator) -> None:
    """Around the eye, by the table of half lines: within its 1e−5 and float32."""
    for grid in GRIDS:
        splats = noise(grid)
        plan = sg.plan(splats, inside(splats, (0.4, 0.9, 0.2)), sg.Settings(blend="xray", tolerance=1e-6))
        assert plan.program.seen.half_line
        voxel = plan.view.voxels(plan.view.eye_index + rng.uniform(-1.2, 1.2, (COUNT, 3)))
        place = rng.uniform(-1, 1, (2, COUNT)) * plan.view.edge[:, None]
        pixel = place / plan.view.pitch + np.array(plan.view.size)[:, None] / 2
        expression = "result.x = half_line(to_index(v), ray_at(p)) * style.peak"
        found = twin("footprint_eval.glsl", expression, plan, splats, v=voxel.T, p=pixel.T)[:, 0]
        right = row1(plan.view, voxel, place).value
        assert np.abs(found - right).max() < 1e-4 * right.max()


def test_what_reaches_into_the_picture(twin: Twin, rng: np.random.Generator) -> None:
    """The GPU's planes are the CPU's, within its margin: it leaves out nothing that the CPU keeps by more."""
    for grid in GRIDS:
        splats = noise(grid)
        for camera in views(splats).values():
            plan = sg.plan(splats, camera, tiles=True)
            frustum = Frustum.of(plan.view)
            voxel = plan.view.voxels(rng.uniform(-30, 40, (COUNT, 3)))
            voxel = voxel[:, voxel[2] > -plan.view.reach]
            found = twin("projection.glsl", "result.x = float(reached(v))", plan, splats, v=voxel.T)[:, 0] > 0
            right = frustum.reached(voxel)
            assert not (found & ~right).any()
            assert (found != right).mean() < 0.02


def test_matter_that_is_widened(twin: Twin, rng: np.random.Generator) -> None:
    for grid in GRIDS:
        splats = noise(grid)
        plan = sg.plan(splats, views(splats)["far"], sg.Settings(attenuation="fill"), tiles=True)
        depth = 10.0 ** rng.uniform(-4, 2, COUNT)
        codes = rng.integers(0, 20, (3, COUNT))
        runs = codes[0] + 32 * codes[1] + 1024 * codes[2]
        voxel = plan.view.voxels(rng.uniform(0, 12, (COUNT, 3)))
        pixel, coverage = rng.uniform(1, 12, COUNT), rng.uniform(0.01, 1, COUNT)
        index = plan.view.index_from_eye @ voxel
        expression = "result.x = filled_depth(a.x, i, a.y, a.z, int(a.w + 0.5))"
        inputs = np.stack([depth, coverage, pixel, runs], axis=1)
        found = twin("attenuation.glsl", expression, plan, splats, a=inputs, i=index.T)[:, 0]
        widths = np.linalg.norm(plan.view.eye_from_index, axis=0)
        along = index / np.linalg.norm(voxel, axis=0)
        right = filled_depth(depth, along, widths, pixel, coverage, runs)
        assert np.abs(found / right - 1).max() < 2e-5
        length = twin("attenuation.glsl", "result.xyz = run_lengths(int(a.w + 0.5))", plan, splats, a=inputs)[:, :3]
        assert np.abs(length.T / np.exp2(codes * OCTAVES) - 1).max() < 1e-6


def test_what_moves_hides(twin: Twin, rng: np.random.Generator) -> None:
    length, through = 10.0 ** rng.uniform(-2, 2, (2, COUNT))
    found = twin("motion_opacity.glsl", "result.x = isolation(a.x, a.y)", a=np.stack([length, through], axis=1))[:, 0]
    assert np.abs(found - isolation(length, through)).max() < 1e-5
    most = 10.0 ** rng.uniform(-3, 2, COUNT)
    mean, alone = most * 10.0 ** rng.uniform(-3, 0, COUNT), rng.random(COUNT)
    inputs = np.stack([mean, most, alone], axis=1)
    found = twin("motion_opacity.glsl", "result.x = dwelt_opacity(a.x, a.y, a.z)", a=inputs)[:, 0]
    assert np.abs(found + np.expm1(-dwelt_depth(mean, most, alone))).max() < 2e-5


def test_streaks(twin: Twin, rng: np.random.Generator) -> None:
    """Where a path's mean is, and how far it goes, in shares of the way from the eye."""
    splats = noise()
    for name in ("fitted", "parallel"):
        motion = sg.Motion(spin=(0, 3, 20), velocity=(0.4, 0, 0))
        plan = sg.plan(splats, views(splats)[name], sg.Settings(), motion)
        assert plan.exposure is not None
        right = streaks(splats, views(splats)[name], motion, 180.0)
        local = splats.records["position"] - frame_block(splats, plan)["base"][:3]
        expression = """
            vec3 v = eye_from_index() * l - frame.eye_from_base.xyz;
            Streak found = streak_of(v, eye_point(frame.first_from_index, frame.first_from_base, l),
                                     eye_point(frame.last_from_index, frame.last_from_base, l));
            result = vec4(v.xy + found.shift, found.step)
        """
        found = twin("motion.glsl", expression, plan, splats, l=local)
        ahead = right.middle[2] > max(NEAREST, 1.2 * plan.view.reach)
        scale = np.abs(right.middle).max()
        assert ahead.mean() > 0.5
        assert np.abs(found[ahead, :2] - right.middle[:2, ahead].T).max() < 1e-5 * scale
        assert np.abs(found[ahead, 2:] - right.step[:, ahead].T).max() < 1e-5 * scale


@pytest.mark.parametrize("motion", ["exact", "energy", "paper"])
@pytest.mark.parametrize("grid", ["cubes", "sheared"])
@pytest.mark.parametrize("name", ["far", "fitted", "parallel"])
def test_streaks_in_a_pixel(motion: str, grid: str, name: str, twin: Twin, rng: np.random.Generator) -> None:
    """A streak's value at a pixel in shares of the largest, and that its quad holds all that is not 0."""
    splats, move = noise(grid), sg.Motion(spin=(0, 0, 10))
    plan = sg.plan(splats, views(splats)[name], sg.Settings(blend="xray", motion=motion, tolerance=1e-6), move)
    view = plan.view
    low, high = splats.index_bounds
    voxel = view.voxels(rng.uniform(low, high, (COUNT, 3)))
    wide = np.maximum(view.pixel_side(voxel[2]), view.widths[0])
    step, at = rng.uniform(-4, 4, (2, COUNT)) * wide, rng.uniform(-5, 5, (2, COUNT)) * wide
    ray = (voxel[:2] + at) / (voxel[2] if view.perspective else 1.0)
    expression = """
        bool widened = PERSPECTIVE == 0 || is_widened(v);
        Quad quad = splat_quad(v);
        vec2 corner = streak_corner(vec2(1.0), v, s, quad, widened), h = normalize(s);
        result.x = streak_shape(passing(v, p, s, inner_of(v, widened))) * style.peak;
        mat2 along = mat2(h.x, -h.y, h.y, h.x);
        vec2 beyond = abs(along * p) - abs(along * corner);
        result.y = max(beyond.x, beyond.y)
    """
    found = twin("footprint_eval.glsl streak.glsl", expression, plan, splats, v=voxel.T, p=at.T, s=step.T)
    right = passing(view, voxel, ray, step).streak_shape(view, motion)
    assert right.max() > 1e-3
    assert np.abs(found[:, 0] - right).max() < 2e-4 * right.max()
    outside = found[:, 1] > 0
    assert 0.05 < outside.mean() < 0.95 and right[outside].max() < 1e-5 * right.max()


def test_light(twin: Twin, rng: np.random.Generator) -> None:
    splats = noise("sheared")
    for camera in (views(splats)["fitted"], views(splats)["parallel"]):
        plan = sg.plan(splats, camera, sg.Settings(shading="on"))
        voxel = plan.view.voxels(splats.records["position"])
        expression = "in_normal = ivec3(round(n)); result.x = head_light(v)"
        normal = splats.records["normal"].astype(np.float64)
        found = twin("splat_setup.glsl", expression, plan, splats, v=voxel.T, n=normal)[:, 0]
        assert np.abs(found - head_light(splats, camera, voxel)).max() < 2e-6


def test_forms_and_colours_of_tiles(twin: Twin, rng: np.random.Generator) -> None:
    """A triangle's form is the matrix's; packed colours come back within half of 2⁻²¹."""
    plan = sg.plan(noise(), views(noise())["fitted"], tiles=True)
    local, color = rng.normal(size=(COUNT, 4)), rng.random((COUNT, 3))
    found = twin("tiles.glsl", "result.xyz = triangle_of(a)", plan, a=local)
    x, y = rng.normal(size=(2, COUNT))
    form = (found[:, 0] * x + found[:, 1] * y) ** 2 + (found[:, 2] * y) ** 2
    right = (local[:, 0] * x + local[:, 1] * y) ** 2 + (local[:, 2] * x + local[:, 3] * y) ** 2
    assert np.abs(form - right).max() < 1e-5 * right.max()
    found = twin("tiles.glsl", "result.xyz = unpacked_color(packed_color(a))", plan, a=color)[:, :3]
    assert np.abs(found - color).max() < 3.5e-7
