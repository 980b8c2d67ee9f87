"""Ellipses, quads, projections and tiles: GLSL against float64, each with a stated bound."""

from __future__ import annotations

import numpy as np
import pytest
from noise import GRIDS, inside, noise, views
from twins import COUNT, Twin, pixel_of, some_voxels

import splatgl as sg
from splatgl.splat.integral.quads import NEAR, Quads, quad_plane, table_quad
from splatgl.splat.plan.plan import Plan
from splatgl.splat.plan.tiling import COLUMNS, ROWS
from splatgl.splat.view.block_culling import Frustum
from splatgl.splat.view.ellipse import perpendicular_axes, smallest_axis, tangents, voxel_ellipse
from splatgl.splat.view.screen_bounds import PIXEL_MARGIN
from splatgl.splat.view.view import View
from splatgl.truth.extent import pixel_ends

CASES = [(grid, view) for grid in GRIDS for view in ("far", "fitted", "parallel", "parallel, far")]


def to_index(view: View, offset: np.ndarray) -> np.ndarray:
    return np.asarray(view.index_from_eye @ offset)


def clip_from_eye(view: View, point: np.ndarray) -> np.ndarray:
    """Clip coordinates [4, N]; NEAR is where z = −w, as z only clips what is nearer."""
    across = point[:2] / view.edge[:, None]
    one = np.ones_like(point[2])
    deep = (point[2] - 2 * NEAR, point[2]) if view.perspective else (0 * one, one)
    return np.stack([*across, *deep])


def near_projection(view: View, voxel: np.ndarray, off: np.ndarray) -> np.ndarray:
    """Distance [N], index axes, of the voxels from the rays at offsets [2, N], in pixels, from their centres."""
    slope = voxel[:2] / voxel[2] + off * view.pitch
    i, ray = to_index(view, voxel), to_index(view, np.stack([*slope, np.ones_like(voxel[2])]))
    return np.asarray(np.linalg.norm(np.cross(i, ray, axis=0), axis=0) / np.linalg.norm(ray, axis=0))


def planar_projection(view: View, quad: Quads, off: np.ndarray) -> np.ndarray:
    """Footprint coordinates [2, N] at offsets [2, N], in pixels, on quads that are parallel to the image."""
    side = view.pixel_side(quad.voxel[2]) * off
    axes = (quad.axis_1, quad.axis_2)
    return np.stack([(axis[:2] * side).sum(axis=0) / size for axis, size in zip(axes, quad.size, strict=True)])


def widened_corner(view: View, quad: Quads, corner: np.ndarray) -> np.ndarray:
    """A corner [2, N] further out by PIXEL_MARGIN of a pixel along both axes."""
    return np.asarray(corner * (1 + PIXEL_MARGIN * view.pixel_side(quad.voxel[2]) / (quad.size * view.kernel.radius)))


def triangle_of(local: np.ndarray, off: np.ndarray) -> np.ndarray:
    """D² [N] at offsets [2, N] of the matrices [4, N]."""
    return np.asarray((local[:2] * off).sum(axis=0) ** 2 + (local[2:] * off).sum(axis=0) ** 2)


def tiles_around(center: np.ndarray, half: np.ndarray, origin: np.ndarray, tiles: np.ndarray) -> np.ndarray:
    """[4, N]: first and last tile along x and y; none: the first is beyond the last."""
    ends = [np.floor((center + side * half - origin[:, None]) / [[COLUMNS], [ROWS]]) for side in (-1, 1)]
    return np.concatenate([ends[0].clip(0, tiles[:, None]), ends[1].clip(-1, tiles[:, None] - 1)])


def touches(tile: np.ndarray, center: np.ndarray, origin: np.ndarray) -> np.ndarray:
    """Distance [N] of centres from the pixel centres' box of tiles; the circle touches if its radius is as long."""
    half = (np.array([[COLUMNS], [ROWS]]) - 1) / 2
    middle = origin[:, None] + tile * [[COLUMNS], [ROWS]] + 0.5 + half
    return np.asarray(np.hypot(*np.maximum(np.abs(center - middle) - half, 0.0)))


def circle_around(triangle: np.ndarray, half_side: np.ndarray) -> np.ndarray:
    """Radius [N] of the circle around the ellipse that just fits into the square."""
    root = np.zeros((triangle.shape[1], 2, 2))
    root[:, 0, 0], root[:, 0, 1], root[:, 1, 1] = triangle
    covariance = np.linalg.inv(root.transpose(0, 2, 1) @ root)
    longest = np.linalg.eigvalsh(covariance)[:, 1]
    return np.asarray(half_side * np.sqrt(longest / np.diagonal(covariance, axis1=1, axis2=2).max(axis=1)))


def seen(grid: str, name: str, **change: object) -> tuple[sg.Splats, View, Plan]:
    splats = noise(grid)
    plan = sg.plan(splats, views(splats)[name], sg.Settings(**change), tiles=True)
    return splats, plan.view, plan


@pytest.mark.parametrize(("grid", "name"), CASES)
def test_a_voxel_across_the_view(grid: str, name: str, twin: Twin, rng: np.random.Generator) -> None:
    splats, view, plan = seen(grid, name, blend="xray")
    v = some_voxels(rng, view, splats)
    for expression, right in (
        ("result.xyz = eye_from_index() * v", view.eye_from_index @ v),
        ("result.xyz = index_from_eye() * v", view.index_from_eye @ v),
        ("result.x = length(to_index(v))", np.linalg.norm(to_index(view, v), axis=0)[None]),
        ("result.x = pixel_side(v.z)", view.pixel_side(v[2])[None]),
        ("result.x = smallest_axis(-v.z)", smallest_axis(view, -v[2])[None]),
        ("result.x = smallest_axis(v.z)", smallest_axis(view, v[2])[None]),
    ):
        found = twin("ellipse.glsl", expression, plan, splats, v=v.T).T[: len(right)]
        assert np.abs(found - right).max() <= 2e-6 * np.abs(right).max(), expression
    # float32 decides as float64, but for a voxel just there
    found = twin("approximations.glsl", "result.x = float(is_widened(v))", plan, splats, v=v.T)[:, 0] > 0
    clear = np.abs(v[2] - view.widened_beyond[1]) > 1e-5 * v[2]
    assert (found == view.is_widened(v[2]))[clear].all()


@pytest.mark.parametrize("grid", GRIDS)
def test_ellipses_on_planes(grid: str, twin: Twin, rng: np.random.Generator) -> None:
    """Axes by the ellipse's quadratic form along a vector w: those of a circle are any."""
    splats, view, plan = seen(grid, "fitted")
    unit, w = rng.normal(size=(2, 3, COUNT))
    unit /= np.linalg.norm(unit, axis=0)
    e1, e2 = perpendicular_axes(unit)
    for n, right in enumerate((e1, e2), 1):
        expression = f"vec3 e1, e2; perpendicular_axes(u, e1, e2); result.xyz = e{n}"
        assert np.abs(twin("ellipse.glsl", expression, plan, splats, u=unit.T)[:, :3] - right.T).max() < 1e-6
    ellipse = voxel_ellipse(view.eye_from_index, e1, e2)
    form = sum((s * (a * w).sum(axis=0)) ** 2 for s, a in zip(ellipse.width, ellipse[:2], strict=True))
    expression = """
        Ellipse it = voxel_ellipse(a, b);
        vec2 along = it.width * vec2(dot(it.axis_1, w), dot(it.axis_2, w));
        result = vec4(it.width, dot(along, along), 0.0)
    """
    found = twin("ellipse.glsl", expression, plan, splats, a=e1.T, b=e2.T, w=w.T)
    assert np.abs(found[:, :2] / ellipse.width.T - 1).max() < 1e-5
    assert np.abs(found[:, 2] - form).max() < 1e-5 * form.max()


@pytest.mark.parametrize("grid", GRIDS)
def test_planes_that_touch_a_kernel(grid: str, twin: Twin, rng: np.random.Generator) -> None:
    """As far as a kernel's reach is a sixteenth of its depth; beyond, float32's root would lose its digits."""
    splats, view, plan = seen(grid, "fitted")
    deep = view.reach * rng.uniform(1.2, 16, COUNT)
    v = np.stack([*(deep * rng.uniform(-1, 1, (2, COUNT))), deep])
    steps = view.eye_from_index * view.kernel.radius
    right = np.stack(tangents(v[0], v[2], steps[0], steps[2]))
    expression = "mat3 rows = transpose(eye_from_index()); result.xy = tangents(v.x, v.z, rows[0], rows[2])"
    found = twin("ellipse.glsl", expression, plan, splats, v=v.T)[:, :2].T
    assert np.abs(found / right - 1).max() < 2e-3


@pytest.mark.parametrize("align", ["ray", "grid"])
@pytest.mark.parametrize(("grid", "name"), CASES)
def test_quads_of_table_1(align: str, grid: str, name: str, twin: Twin, rng: np.random.Generator) -> None:
    splats, view, plan = seen(grid, name, align=align, technique="quads")
    v, w = some_voxels(rng, view, splats), rng.normal(size=3)
    expression = "vec3 e1, e2; quad_plane(v, e1, e2); result.xyz = cross(e1, e2)"
    found = twin("quads.glsl", expression, plan, splats, v=v.T)[:, :3]
    assert np.abs(found - quad_plane(view, v, align)[0].T).max() < 2e-6
    right = table_quad(view, v, align)
    sides = zip((right.axis_1, right.axis_2), right.size, strict=True)
    form = sum((size * (axis * w[:, None]).sum(axis=0)) ** 2 for axis, size in sides)
    expression = f"""
        Quad it = table_quad(v);
        vec2 along = vec3({w[0]}, {w[1]}, {w[2]}) * mat2x3(it.axis_1, it.axis_2);
        result = vec4(it.gain, it.coverage, dot(along, along), it.reach)
    """
    found = twin("quads.glsl", expression, plan, splats, v=v.T)
    rights = np.stack([right.gain, right.coverage, form, np.full_like(form, view.kernel.radius)], axis=1)
    assert np.abs(found - rights).max() < 2e-5 * max(rights.max(), 1.0)


@pytest.mark.parametrize(("grid", "name"), CASES)
def test_corners(grid: str, name: str, twin: Twin, rng: np.random.Generator) -> None:
    splats, view, plan = seen(grid, name, align="grid", technique="quads")
    v = some_voxels(rng, view, splats)
    found = twin("splat.vert", "result = clip_from_eye(v)", plan, splats, v=v.T).T
    right = clip_from_eye(view, v)
    assert np.abs(found - right).max() < 1e-6 * np.abs(right).max()
    corner = np.sign(rng.uniform(-1, 1, (2, v.shape[1])))
    expression = "result.xy = widened_corner(c, v, table_quad(v)) - c"
    found = twin("splat.vert", expression, plan, splats, v=v.T, c=corner.T)[:, :2].T
    right = widened_corner(view, table_quad(view, v, "grid"), corner) - corner
    assert np.abs(found - right).max() < 2e-5 * np.abs(right).max() + 2e-7


@pytest.mark.parametrize(("grid", "name"), CASES)
def test_planar_projections(grid: str, name: str, twin: Twin, rng: np.random.Generator) -> None:
    """Centres by 1e−5 of the picture, footprint coordinates by 1e−4 voxels; the square just holds the footprint."""
    splats, view, plan = seen(grid, name, align="grid", technique="quads")
    v, off = some_voxels(rng, view, splats), rng.uniform(-1, 1, 2)
    found = twin("projection.glsl", "result.xy = pixel_of(v)", plan, splats, v=v.T)[:, :2].T
    assert np.abs(found - pixel_of(view, v)).max() < 1e-5 * max(view.size)
    expression = f"""
        Quad quad = table_quad(v);
        Projected it = planar_projection(v, quad.axis_1, quad.axis_2, quad.reach);
        vec2 off = vec2({off[0]}, {off[1]}) * it.half_side;
        result = vec4(length(vec2(dot(it.to_local.xy, off), dot(it.to_local.zw, off))), off, it.half_side)
    """
    found = twin("projection.glsl", expression, plan, splats, v=v.T).T
    quad = table_quad(view, v, "grid")
    right = np.hypot(*planar_projection(view, quad, found[1:3]))
    assert np.abs(found[0] - right).max() < 1e-4
    half = np.hypot(quad.size[0] * quad.axis_1[:2], quad.size[1] * quad.axis_2[:2]).max(axis=0)
    half = half * view.kernel.radius / view.pixel_side(v[2]) + PIXEL_MARGIN
    assert np.abs(found[3] / half - 1).max() < 1e-5


@pytest.mark.parametrize("grid", GRIDS)
def test_near_projections(grid: str, twin: Twin, rng: np.random.Generator) -> None:
    """Distances by 1e−4 of themselves; the square around a splat holds every pixel that it covers, and few more."""
    splats, view, plan = seen(grid, "fitted", antialias="off", blend="xray", align="exact")
    v, off = some_voxels(rng, view, splats, 3.0), rng.uniform(-1, 1, 2)
    expression = f"""
        Projected it = near_projection(v);
        vec2 off = vec2({off[0]}, {off[1]}) * it.half_side;
        result = vec4(length(vec2(dot(it.to_local.xy, off), dot(it.to_local.zw, off))), off, it.half_side)
    """
    found = twin("projection.glsl", expression, plan, splats, v=v.T).T
    ray = np.stack([*(v[:2] / v[2] + found[1:3] * view.pitch), np.ones_like(v[2])])
    right = near_projection(view, v, found[1:3]) * np.linalg.norm(to_index(view, ray), axis=0)
    assert np.abs(found[0] / right - 1).max() < 1e-4
    left, right, top, bottom = pixel_ends(view, "row1", v, plan.resolved.camera)
    middle = pixel_of(view, v)
    whole = (left > 0) & (right < view.size[0]) & (top > 0) & (bottom < view.size[1])
    ends = np.stack([middle[0] - left, right - middle[0], middle[1] - top, bottom - middle[1]]).max(axis=0)
    # the last pixel's centre is half a pixel before its end, and the edge at most a pixel beyond that centre
    beyond = (found[3] - PIXEL_MARGIN - (ends - 0.5))[whole]
    assert whole.mean() > 0.5 and (beyond > -1e-3).all() and (beyond < 1 + 1e-3).all()


def test_what_reaches_into_the_picture(twin: Twin, rng: np.random.Generator) -> None:
    """The GPU's planes are the CPU's, within its margin: it leaves out nothing that the CPU keeps by more."""
    for grid in GRIDS:
        splats = noise(grid)
        for camera in (*views(splats).values(), inside(splats, (0.4, 0.9, 0.2))):
            plan = sg.plan(splats, camera, tiles=True)
            frustum = Frustum.of(plan.view)
            voxel = plan.view.voxels(rng.uniform(-30, 40, (COUNT, 3)))
            voxel = voxel[:, voxel[2] > -plan.view.reach]
            found = twin("projection.glsl", "result.x = float(reached(v))", plan, splats, v=voxel.T)[:, 0] > 0
            right = frustum.reached(voxel)
            assert not (found & ~right).any()
            assert (found != right).mean() < 0.02


def test_forms_of_tiles(twin: Twin, rng: np.random.Generator) -> None:
    """A triangle's form is the matrix's by 1e−5; its circle by 1e−4 of itself."""
    local, off = rng.normal(size=(4, COUNT)), rng.normal(size=(2, COUNT))
    expression = """
        vec3 t = triangle_of(a);
        vec2 at = vec2(dot(t.xy, o), t.z * o.y);
        result.x = dot(at, at)
    """
    found = twin("tiles.glsl", expression, a=local.T, o=off.T)
    right = triangle_of(local, off)
    assert np.abs(found[:, 0] - right).max() < 1e-5 * right.max()
    t, half = rng.uniform(0.1, 2, (3, COUNT)) * [[1], [-1], [1]], rng.uniform(0.5, 50, COUNT)
    found = twin("tiles.glsl", "result.x = circle_around(t, h)", t=t.T, h=half)[:, 0]
    assert np.abs(found / circle_around(t, half) - 1).max() < 1e-4


def test_tiles_of_splats(twin: Twin, rng: np.random.Generator) -> None:
    """Exact on eighths of a pixel; circles that are nearer than 1e−3 pixels to touching may be either."""
    origin, tiles = np.array([3, 5]), np.array([7, 4])
    state = {"origin": tuple(origin), "tiles": tuple(tiles)}
    center, half = rng.integers(-200, 700, (2, COUNT)) / 8, rng.integers(-40, 300, COUNT) / 8
    expression = "result = vec4(tiles_around(c, h))"
    found = twin("tiles.glsl", expression, state=state, c=center.T, h=half)
    assert (tiles_around(center, half, origin, tiles) == found.T).all()
    tile = np.stack([rng.integers(0, count, COUNT) for count in tiles])
    expression = "result.x = float(touches(ivec2(t + 0.5), c, h))"
    found = twin("tiles.glsl", expression, state=state, t=tile.T, c=center.T, h=np.abs(half))[:, 0] > 0
    far = touches(tile, center, origin)
    clear = np.abs(far - np.abs(half)) > 1e-3
    assert (found == (far <= np.abs(half)))[clear].all() and 0.05 < found.mean() < 0.95
