"""Moving splats: GLSL against float64, each with a stated bound."""

from __future__ import annotations

import numpy as np
import pytest
from paper.forms import stretched_footprint

import splatgl as sg
from splatgl.geometry.view import GridView, tangents
from splatgl.gl.features import frame_block
from splatgl.planning.plan import Plan
from splatgl.splat.footprint import table_quad
from splatgl.splat.motion import FAR, NEAREST, Streaks, eye_point, streak_of, streaks
from splatgl.splat.motion_blur import COLUMNS, ROWS, blur_table, moving_opacity
from tests.helpers.noise import noise, views
from tests.helpers.splatting import SPLATS
from tests.helpers.streaks import (
    blur,
    hermite,
    inner_of,
    isolation,
    length_of,
    pass_kernels,
    passing_on_quad,
    share,
    step_on,
)
from tests.helpers.twins import COUNT, Twin, some_voxels

MOVE = sg.Motion(spin=(0, 3, 20), velocity=(0.4, 0, 0))
BOTH = "bool widened = PERSPECTIVE == 0 || is_widened(v); Inner inner = inner_of(v, widened);"


def moving(grid: str, name: str, motion: str = "exact", **change: object) -> tuple[sg.Splats, GridView, Plan]:
    splats = noise(grid)
    plan = sg.plan(splats, views(splats)[name], SPLATS.replace(tolerance=1e-6, motion=motion, **change), MOVE)
    assert plan.exposure is not None
    return splats, plan.view, plan


def some_steps(rng: np.random.Generator, view: GridView, voxel: np.ndarray) -> np.ndarray:
    """Paths [2, N] of up to 4 widths of the splats."""
    return np.asarray(rng.uniform(-4, 4, (2, voxel.shape[1])) * np.maximum(view.pixel_side(voxel[2]), view.widths[0]))


def reach_along(view: GridView, voxel: np.ndarray, heading: np.ndarray, half: np.ndarray) -> np.ndarray:
    """How far [N] rays that meet a kernel on its path are from its middle, along `heading` [2, N] at its depth."""
    steps = np.einsum("in,ij->jn", heading, view.eye_from_index[:2]) * view.kernel.radius
    deep = np.repeat(view.eye_from_index[2][:, None], half.size, axis=1) * view.kernel.radius
    at = (heading * voxel[:2]).sum(axis=0)
    ends = [tangents(at + side * half, voxel[2], steps, deep) for side in (-1, 1)]
    return np.asarray(np.max(ends, axis=(0, 1)) * voxel[2])


def streak_corner(corner: np.ndarray, step: np.ndarray, reach: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
    """[2, N]: corners of the rectangle around the path, further by reach[0] at either end and reach[1] to a side."""
    half = np.hypot(*step) / 2
    heading = step / (2 * half)
    return np.asarray(heading * corner[0] * (half + reach[0]) + [-heading[1], heading[0]] * corner[1] * reach[1])


def streaked(depth: np.ndarray, shape: np.ndarray, most: np.ndarray, isolated: np.ndarray) -> np.ndarray:
    """Opacity [N] of a moving splat of that depth: shape and most are its footprint's mean and maximum, over F(0)."""
    return moving_opacity(depth * shape, depth * most, isolated)


def test_what_moves_hides(twin: Twin, rng: np.random.Generator) -> None:
    length, through = 10.0 ** rng.uniform(-2, 2, (2, COUNT))
    found = twin("motion_opacity.glsl", "result.x = isolation(a.x, a.y)", a=np.stack([length, through], axis=1))[:, 0]
    assert np.abs(found - isolation(length, through)).max() < 1e-5
    most = 10.0 ** rng.uniform(-3, 2, COUNT)
    mean, alone = most * 10.0 ** rng.uniform(-3, 0, COUNT), rng.random(COUNT)
    inputs = np.stack([mean, most, alone], axis=1)
    found = twin("motion_opacity.glsl", "result.x = dwelt_opacity(a.x, a.y, a.z)", a=inputs)[:, 0]
    assert np.abs(found - moving_opacity(mean, most, alone)).max() < 2e-5


@pytest.mark.parametrize("name", ["fitted", "parallel"])
def test_streaks(name: str, twin: Twin) -> None:
    """Where a path's mean is, and how far it goes, in shares of the way from the eye."""
    splats, view, plan = moving("cubes", name)
    right = streaks(splats, views(splats)[name], MOVE, 180.0)
    local = splats.positions - frame_block(splats, plan)["base"][:3]
    expression = """
        vec3 v = eye_from_index() * l - frame.eye_from_base.xyz;
        Streak found = streak_of(v, eye_point(frame.first_from_index, frame.first_from_base, l),
                                 eye_point(frame.last_from_index, frame.last_from_base, l));
        result = vec4(v.xy + found.shift, found.move)
    """
    found = twin("motion.glsl", expression, plan, splats, l=local)
    ahead = right.middle[2] > max(NEAREST, 1.2 * view.reach)
    scale = np.abs(right.middle).max()
    assert ahead.mean() > 0.5
    assert np.abs(found[ahead, :2] - right.middle[:2, ahead].T).max() < 1e-5 * scale
    assert np.abs(found[ahead, 2:] - right.step[:, ahead].T).max() < 1e-5 * scale
    # the same by steps
    first = eye_point(splats, plan.exposure.first, None, 0.0, plan.exposure.middle.extent)
    expression = "result.xyz = eye_point(frame.first_from_index, frame.first_from_base, l)"
    found = twin("motion.glsl", expression, plan, splats, l=local)[:, :3]
    assert np.abs(found - first.T).max() < 1e-6 * scale


@pytest.mark.parametrize("name", ["fitted", "parallel"])
def test_paths(name: str, twin: Twin, rng: np.random.Generator) -> None:
    """Any three places of a path, by 1e−6 of their distance from the eye."""
    splats, view, plan = moving("cubes", name)
    v = some_voxels(rng, view, splats)
    ends = v + rng.normal(0, 0.5, (2, *v.shape))
    expression = "Streak found = streak_of(v, a, b); result = vec4(found.shift, found.move)"
    found = twin("motion.glsl", expression, plan, splats, v=v.T, a=ends[0].T, b=ends[1].T).T
    right = np.concatenate(streak_of(v, ends[0], ends[1], view.perspective))
    assert np.abs(found - right).max() < 1e-6 * np.abs(v).max()


@pytest.mark.parametrize("grid", ["cubes", "sheared"])
@pytest.mark.parametrize("name", ["far", "fitted", "parallel"])
def test_kernels_on_their_paths(grid: str, name: str, twin: Twin, rng: np.random.Generator) -> None:
    """Offsets and paths in the kernel's own axes by 1e−5, and how rays pass them by 2e−6 of the largest."""
    splats, view, plan = moving(grid, name)
    v = some_voxels(rng, view, splats)
    step = some_steps(rng, view, v)
    inner = inner_of(view, v[2])
    expression = f"{BOTH} result = vec4(length(inner.axes * s), inner.shrink, length_of(inner, v, s))"
    found = twin("motion.glsl", expression, plan, splats, v=v.T, s=step.T).T
    across = np.linalg.norm(inner.axes[:, 0] * step[0] + inner.axes[:, 1] * step[1], axis=0)
    assert np.abs(found[0] / across - 1).max() < 1e-5
    assert np.abs(found[1:3] - inner.shrink).max() < 1e-5
    right = length_of(view, Streaks(plan.exposure.middle, v, step))
    assert np.abs(found[3] - right).max() < 1e-5 * right.max()
    at = some_steps(rng, view, v) / 2
    expression = f"{BOTH} Passing it = passing(v, p, s, inner); result = vec4(it.along, it.across2, it.size, it.gain)"
    found = twin("footprint_eval.glsl streak.glsl", expression, plan, splats, v=v.T, s=step.T, p=at.T).T
    passed = pass_kernels(view, v, (v[:2] + at) / (v[2] if view.perspective else 1.0), step)
    rights = np.stack([passed.along, passed.across**2, passed.length, passed.gain])
    assert (np.abs(found - rights).max(axis=1) < 2e-6 * rights.max(axis=1)).all()


@pytest.mark.parametrize("align", ["grid", "ray"])
def test_footprints_on_the_paths_of_quads(align: str, twin: Twin, rng: np.random.Generator) -> None:
    """Steps as quads of rows 4 and 5 see them, and how points of these pass them, by 1e−5 of the largest."""
    splats, view, plan = moving("sheared", "fitted", align=align)
    v = some_voxels(rng, view, splats)
    step, at = some_steps(rng, view, v), rng.uniform(-2, 2, (2, COUNT))
    found = twin("motion.glsl", "result.xy = step_on(splat_quad(v), s)", plan, splats, v=v.T, s=step.T)[:, :2].T
    right = step_on(table_quad(view, v, align), step)
    # an ellipse's axis has two directions
    assert np.abs(np.abs(found) - np.abs(right)).max() < 1e-5 * np.abs(right).max()
    expression = "Passing it = passing_on_quad(p, s); result = vec4(it.along, it.across2, it.size, it.gain)"
    found = twin("footprint_eval.glsl streak.glsl", expression, plan, splats, s=right.T, p=at.T).T
    passed = passing_on_quad(at, right)
    rights = np.stack([passed.along, passed.across**2, passed.length, passed.gain])
    assert (np.abs(found - rights).max(axis=1) < 1e-5 * rights.max(axis=1)).all()


@pytest.mark.parametrize("grid", ["cubes", "sheared"])
def test_corners_of_streaks(grid: str, twin: Twin, rng: np.random.Generator) -> None:
    """As far as their kernels reach by 2e−3, and up to 1.3 times as far where tangents would lose their digits."""
    splats, view, plan = moving(grid, "fitted", antialias="off", align="exact")
    deep = view.reach * rng.uniform(2, 2 * FAR, COUNT)
    v = np.stack([*(deep * rng.uniform(-0.5, 0.5, (2, COUNT))), deep])
    step, corner = some_steps(rng, view, v), np.sign(rng.uniform(-1, 1, (2, COUNT)))
    half, heading = np.hypot(*step) / 2, step / np.hypot(*step)
    expression = "result.x = reach_along(normalize(s), v, splat_quad(v), false, 0.5 * length(s))"
    found = twin("motion.glsl", expression, plan, splats, v=v.T, s=step.T)[:, 0]
    right = reach_along(view, v, heading, half)
    # right is from the path's end on either side
    near = deep < FAR * view.reach
    assert np.abs(found / right - 1)[near].max() < 2e-3
    assert (found / right)[~near].min() > 1 and (found / right)[~near].max() < 2.0
    expression = "result.xy = streak_corner(c, v, s, splat_quad(v), false)"
    found = twin("motion.glsl", expression, plan, splats, v=v.T, s=step.T, c=corner.T)[:, :2].T
    beside = reach_along(view, v, np.stack([-heading[1], heading[0]]), np.zeros(COUNT))
    corners = streak_corner(corner, step, (right, beside))
    assert np.abs(found - corners)[:, near].max() < 2e-3 * np.abs(corners).max()


def test_tables_of_streaks(twin: Twin, rng: np.random.Generator) -> None:
    """Cubics by 2e−6, shares of lines by 1e−6; means along paths, and maxima, by 1e−5 of the peak, as the table."""
    splats, _, plan = moving("cubes", "fitted")
    table, kernel = blur_table(plan.kernel.name, dtype="<f8"), plan.kernel
    first, last, part = rng.normal(size=(COUNT, 2)), rng.normal(size=(COUNT, 2)), rng.random(COUNT)
    found = twin("footprint_eval.glsl streak.glsl", "result.x = hermite(a, b, p)", plan, a=first, b=last, p=part)[:, 0]
    assert np.abs(found - hermite(first, last, part)).max() < 2e-6
    t, row = rng.uniform(-1.2, 1.2, COUNT), rng.integers(0, ROWS - 1, COUNT)
    inputs = np.stack([t, row, part], axis=1)
    expression = f"result.x = share(a.x, int(a.y + 0.5), a.z, {COLUMNS - 1})"
    found = twin("footprint_eval.glsl streak.glsl", expression, plan, splats, a=inputs)[:, 0]
    assert np.abs(found - share(table, t, row, part)).max() < 1e-6
    along, across, length = rng.uniform(-3, 3, COUNT), rng.uniform(0, 1.2, COUNT), 10.0 ** rng.uniform(-3, 1, COUNT)
    inputs = np.stack([along, across**2, length, np.ones(COUNT)], axis=1)
    expression = "Passing p = Passing(a.x, a.y, a.z, a.w); result.xy = vec2(blurred(p), stretched(p))"
    found = twin("footprint_eval.glsl streak.glsl", expression, plan, splats, a=inputs)
    right = blur(table, along, across, length)
    assert np.abs(found[:, 0] - right).max() < 1e-5
    right = stretched_footprint(kernel, along, across, length) / kernel.footprint(np.zeros(()))
    assert np.abs(found[:, 1] - right).max() < 1e-5


@pytest.mark.few(9)
@pytest.mark.parametrize("motion", ["exact", "energy", "paper"])
@pytest.mark.parametrize("grid", ["cubes", "sheared"])
@pytest.mark.parametrize("name", ["far", "fitted", "parallel"])
def test_streaks_in_a_pixel(motion: str, grid: str, name: str, twin: Twin, rng: np.random.Generator) -> None:
    """A streak's value at a pixel in shares of the largest, and that its quad holds all that is not 0."""
    splats, view, plan = moving(grid, name, blend="xray", motion=motion)
    voxel = some_voxels(rng, view, splats)
    step, at = some_steps(rng, view, voxel), some_steps(rng, view, voxel) * 1.25
    ray = (voxel[:2] + at) / (voxel[2] if view.perspective else 1.0)
    expression = f"""
        {BOTH}
        Quad quad = splat_quad(v);
        vec2 corner = streak_corner(vec2(1.0), v, s, quad, widened), h = normalize(s);
        result.x = streak_shape(passing(v, p, s, inner)) * style.peak;
        mat2 along = mat2(h.x, -h.y, h.y, h.x);
        vec2 beyond = abs(along * p) - abs(along * corner);
        result.y = max(beyond.x, beyond.y)
    """
    found = twin("footprint_eval.glsl streak.glsl", expression, plan, splats, v=voxel.T, p=at.T, s=step.T)
    right = pass_kernels(view, voxel, ray, step).streak_shape(view, motion)
    assert right.max() > 1e-3
    assert np.abs(found[:, 0] - right).max() < 2e-4 * right.max()
    outside = found[:, 1] > 0
    assert 0.05 < outside.mean() < 0.95 and right[outside].max() < 1e-5 * right.max()


def test_opacities_of_streaks(twin: Twin, rng: np.random.Generator) -> None:
    """A moving splat's opacity at a pixel, by 2e−4, with its matter's isolation."""
    splats, view, plan = moving("cubes", "far", attenuation="fill")
    voxel = some_voxels(rng, view, splats)
    step, at = some_steps(rng, view, voxel), some_steps(rng, view, voxel) / 2
    depth, alone = 10.0 ** rng.uniform(-2, 1, voxel.shape[1]), rng.random(voxel.shape[1])
    expression = f"""
        {BOTH}
        path_center = v; path_step = s; at = p; inner_x = inner.axes[0]; inner_y = inner.axes[1];
        path_isolation = vec3(d.y, inner.shrink); splat.a = d.x;
        result.x = streaked()
    """
    inputs = {"v": voxel.T, "s": step.T, "p": at.T, "d": np.stack([depth, alone], axis=1)}
    found = twin("splat.frag", expression, plan, splats, **inputs)[:, 0]
    passed, peak = pass_kernels(view, voxel, (voxel[:2] + at) / voxel[2], step), view.kernel.footprint(np.zeros(()))
    right = streaked(depth, passed.streak_shape(view, "exact") / peak, passed.most(view) / peak, alone)
    assert np.abs(found - right).max() < 2e-4
