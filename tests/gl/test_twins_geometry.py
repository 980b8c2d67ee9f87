"""Ellipses, quads, projections and tiles: GLSL against float64, each with a stated bound."""

from __future__ import annotations

import numpy as np
import pytest

import splatgl as sg
from splatgl.geometry.view import GridView, perpendicular_axes, smallest_axis, tangents, voxel_ellipse
from splatgl.planning.culling import PIXEL_MARGIN, Frustum
from splatgl.planning.plan import Plan
from splatgl.planning.technique import COLUMNS, ROWS
from splatgl.reference.rays import pixel_ends
from splatgl.splat.footprint import NEAR, SplatQuads, quad_plane, table_quad
from tests.helpers.noise import GRIDS, inside, noise, views
from tests.helpers.splatting import SPLATS
from tests.helpers.twins import COUNT, Twin, pixel_of, some_voxels

CASES = [(grid, view) for grid in GRIDS for view in ("far", "fitted", "parallel", "parallel, far")]


def to_index(view: GridView, offset: np.ndarray) -> np.ndarray:
    return np.asarray(view.index_from_eye @ offset)


def clip_from_eye(view: GridView, point: np.ndarray) -> np.ndarray:
    """Clip coordinates [4, N]; NEAR is where z = −w, as z only clips what is nearer."""
    across = point[:2] / view.edge[:, None]
    one = np.ones_like(point[2])
    deep = (point[2] - 2 * NEAR, point[2]) if view.perspective else (0 * one, one)
    return np.stack([*across, *deep])


def near_projection(view: GridView, voxel: np.ndarray, off: np.ndarray) -> np.ndarray:
    """Distance [N], index axes, of the voxels from the rays at offsets [2, N], in pixels, from their centres."""
    slope = voxel[:2] / voxel[2] + off * view.pitch
    i, ray = to_index(view, voxel), to_index(view, np.stack([*slope, np.ones_like(voxel[2])]))
    return np.asarray(np.linalg.norm(np.cross(i, ray, axis=0), axis=0) / np.linalg.norm(ray, axis=0))


def planar_projection(view: GridView, quad: SplatQuads, off: np.ndarray) -> np.ndarray:
    """Footprint coordinates [2, N] at offsets [2, N], in pixels, on quads that are parallel to the image."""
    side = view.pixel_side(quad.voxel[2]) * off
    axes = (quad.axis_1, quad.axis_2)
    return np.stack([(axis[:2] * side).sum(axis=0) / size for axis, size in zip(axes, quad.size, strict=True)])


def widened_corner(view: GridView, quad: SplatQuads, corner: np.ndarray) -> np.ndarray:
    """A corner [2, N] further out by PIXEL_MARGIN of a pixel along both axes."""
    return np.asarray(corner * (1 + PIXEL_MARGIN * view.pixel_side(quad.voxel[2]) / (quad.size * view.kernel.radius)))


def triangle_of(local: np.ndarray, off: np.ndarray) -> np.ndarray:
    """D² [N] at offsets [2, N] of the matrices [4, N]."""
    return np.asarray((local[:2] * off).sum(axis=0) ** 2 + (local[2:] * off).sum(axis=0) ** 2)


def form_radius(view: GridView, center: np.ndarray, half_side: np.ndarray) -> np.ndarray:
    """[N]: R times the longest of the rays, index axes, at the corners of squares within the picture; before z_k."""
    ends = np.stack([center - half_side, center + half_side])
    middle = np.array(view.size)[:, None] / 2
    x, y = ((ends.clip(0, 2 * middle) - middle) * view.pitch).transpose(1, 0, 2)
    rays = np.stack([[x[i], y[j], np.ones_like(x[0])] for i in (0, 1) for j in (0, 1)])
    return np.asarray(view.kernel.radius * np.linalg.norm(view.index_from_eye @ rays, axis=1).max(axis=0))


def extent_of(triangle: np.ndarray, radius: np.ndarray) -> np.ndarray:
    """[3, N]: height, width and k of the ellipse of a form up to radius², PIXEL_MARGIN larger."""
    root = np.zeros((triangle.shape[1], 2, 2))
    root[:, 0, 0], root[:, 0, 1], root[:, 1, 1] = triangle
    covariance = np.linalg.inv(root.transpose(0, 2, 1) @ root)
    x, y, mixed = covariance[:, 0, 0], covariance[:, 1, 1], covariance[:, 0, 1]
    k = mixed / y
    width = radius * np.sqrt(x - mixed**2 / y) + PIXEL_MARGIN * (1 + np.abs(k))
    return np.stack([radius * np.sqrt(y) + PIXEL_MARGIN, width, k])


def packed_extent(extent: np.ndarray) -> np.ndarray:
    """[3, N]: with width and k in half precision, and no smaller."""
    height, width, k = extent
    near = k.astype(np.float16).astype(float)
    return np.stack([height, ((width + np.abs(k - near) * height) * 1.002).astype(np.float16).astype(float), near])


def reached_by(ends: np.ndarray, origin: int, side: int, many: int) -> np.ndarray:
    """[2, N]: first and last tile whose outer pixels' centres the ends [2, N] reach; (1, 0): none."""
    first = origin + np.arange(many) * side + 0.5
    inside = (first + side - 1 >= ends[0][:, None]) & (first <= ends[1][:, None])
    some, last = inside.any(axis=1), many - 1 - inside[:, ::-1].argmax(axis=1)
    return np.where(some, np.stack([inside.argmax(axis=1), last]), [[1], [0]])


def rows_of(center: np.ndarray, height: np.ndarray, origin: int, many: int) -> np.ndarray:
    """[2, N]: first and last row of tiles."""
    return reached_by(np.stack([center - height, center + height]), origin, ROWS, many)


def span_of(center: np.ndarray, extent: np.ndarray, row: np.ndarray, origin: np.ndarray, many: int) -> np.ndarray:
    """[2, N]: first and last tile in a row of tiles, by many chords."""
    height, width, k = extent[:, None, :]
    top = origin[1] + row * ROWS + 0.5 - center[1]
    y = top + np.linspace(0, ROWS - 1, 1000)[:, None]
    chord = width * np.sqrt(np.maximum(1 - (y / height) ** 2, 0))
    inside = np.abs(y) <= height
    low = np.where(inside, k * y - chord, np.inf).min(axis=0)
    high = np.where(inside, k * y + chord, -np.inf).max(axis=0)
    return reached_by(center[0] + np.stack([low, high]), origin[0], COLUMNS, many)


def seen(grid: str, name: str, **change: object) -> tuple[sg.Splats, GridView, Plan]:
    splats = noise(grid)
    plan = sg.plan(splats, views(splats)[name], SPLATS.replace(**change), tiles=True)
    return splats, plan.view, plan


@pytest.mark.turns(2)
@pytest.mark.few(8)
@pytest.mark.parametrize("blur_width", [0.5, 1.0, 2.0])
@pytest.mark.parametrize(("grid", "name"), CASES)
def test_a_voxel_across_the_view(grid: str, name: str, blur_width: float, twin: Twin, rng: np.random.Generator) -> None:
    splats, view, plan = seen(grid, name, blend="xray", blur_width=blur_width)
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


@pytest.mark.turns(2)
@pytest.mark.few(16)
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


@pytest.mark.turns(2)
@pytest.mark.few(8)
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


@pytest.mark.turns(2)
@pytest.mark.few(8)
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


def reaches(frustum: Frustum, voxel: np.ndarray, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """[2, N]: how far voxels are beyond planes through such slopes, or lengths, and how far they may be."""
    z = voxel[2] if frustum.view.perspective else np.ones(voxel.shape[1])
    reach = np.maximum(frustum.support[:, None], frustum.stretch[:, None] * z)
    return np.maximum(low[:, None] * z - voxel[:2], voxel[:2] - high[:, None] * z), reach


def test_what_reaches_into_the_picture(twin: Twin, rng: np.random.Generator) -> None:
    """The GPU's planes are the CPU's, within its margin: it leaves out nothing that the CPU keeps by more."""
    for grid in GRIDS:
        splats = noise(grid)
        for camera in (*views(splats).values(), inside(splats, (0.4, 0.9, 0.2))):
            plan = sg.plan(splats, camera, SPLATS, tiles=True)
            frustum = Frustum.of(plan.view)
            voxel = plan.view.voxels(rng.uniform(-30, 40, (COUNT, 3)))
            voxel = voxel[:, voxel[2] > -plan.view.reach]
            found = twin("projection.glsl", "result.x = float(may_show(v))", plan, splats, v=voxel.T)[:, 0] > 0
            right = frustum.may_show(voxel)
            assert not (found & ~right).any()
            assert (found != right).mean() < 0.02
            # of a part of the picture: between other planes
            low, high = frustum.edge * [[-0.5, 0.1], [0.2, 0.7]]
            expression = f"result.x = float(reaches(v, vec4({', '.join(map(str, [*low, *high]))})))"
            found = twin("projection.glsl", expression, plan, splats, v=voxel.T)[:, 0] > 0
            beyond, reach = reaches(frustum, voxel, low, high)
            near = np.abs(beyond - reach).min(axis=0) < 1e-4 * reach.max()
            assert (found == (beyond <= reach).all(axis=0))[~near].all() and 0 < found.mean() < right.mean()


def test_forms_of_tiles(twin: Twin, rng: np.random.Generator) -> None:
    """A triangle's form is the matrix's by 1e−5; its extent by 1e−4 of itself, packed by half precision."""
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
    expression = "Extent e = extent_of(t, h); result = vec4(e.height, e.width, e.k, 0.0)"
    found = twin("tiles.glsl", expression, t=t.T, h=half)[:, :3].T
    right = extent_of(t, half)
    assert np.abs(found / right - 1).max() < 1e-4
    expression = "Extent e = unpacked_extent(packed_extent(Extent(t.x, t.y, t.z)));"
    found = twin("tiles.glsl", f"{expression} result = vec4(e.height, e.width, e.k, 0.0)", t=right.T)[:, :3].T
    assert np.abs(found / packed_extent(right) - 1).max() < 2e-3
    # it holds the ellipse
    assert (found[1] >= right[1] + np.abs(found[2] - right[2]) * right[0]).all()


def test_ellipses_hold_footprints_near_the_eye(twin: Twin, rng: np.random.Generator) -> None:
    """The form's radius is the twin's by 1e−5; no ray within the kernel's radius is beyond it, slanted and near."""
    for grid in GRIDS:
        splats = noise(grid)
        plan = sg.plan(splats, inside(splats, (0.4, 0.9, 0.2)), SPLATS.replace(antialias="off"), tiles=True)
        view = plan.view
        center, half = rng.uniform(-50, 50, (2, COUNT)), rng.uniform(1, 90, COUNT)
        expression = "result.x = form_radius(vec3(0.0, 0.0, 9.0), c, h, vec3(1.0))"
        found = twin("tile_project.frag", expression, plan, splats, c=center.T, h=half)[:, 0]
        assert np.abs(found / form_radius(view, center, half) - 1).max() < 1e-5
        voxel = view.voxels(rng.uniform(-12, 24, (COUNT, 3)))
        voxel = voxel[:, voxel[2] > 1.5 * view.reach]
        middle = np.array(view.size)[:, None] / 2
        at = voxel[:2] / voxel[2] / view.pitch + middle
        pixel = at + rng.uniform(-3, 3, at.shape) / voxel[2] / view.pitch
        ray = view.index_from_eye @ np.stack([*(pixel - middle) * view.pitch, np.ones(voxel.shape[1])])
        i = view.index_from_eye @ voxel
        form = np.linalg.norm(np.cross(i.T, ray.T), axis=1)
        within = form < view.kernel.radius * np.linalg.norm(ray, axis=0)
        within &= ((pixel > 0) & (pixel < 2 * middle)).all(axis=0)
        sides = np.abs(pixel - at).max(axis=0)
        assert within.any() and (form <= form_radius(view, at, sides))[within].all()


def test_tiles_of_splats(twin: Twin, rng: np.random.Generator) -> None:
    """Exact on eighths of a pixel; ellipses may be listed in a tile more where many chords just miss it."""
    origin, tiles = np.array([3, 5]), np.array([7, 4])
    state = {"origin": tuple(origin), "tiles": tuple(tiles)}
    center, half = rng.integers(-200, 700, (2, COUNT)) / 8, rng.integers(1, 300, COUNT) / 8
    for name, expression, right in (
        ("reached_by", "reached_by(c, 3.0, 8, 7)", reached_by(np.sort(center, axis=0), 3, 8, 7)),
        ("rows_of", "rows_of(c.y, h)", rows_of(center[1], half, 5, 4)),
    ):
        given = np.sort(center, axis=0) if name == "reached_by" else center
        found = twin("tiles.glsl", f"result.xy = vec2({expression})", state=state, c=given.T, h=half)[:, :2].T
        none = found[0] > found[1]
        assert (none == (right[0] > right[1])).all() and (found == right)[:, ~none].all()
    extent = np.stack([half, rng.uniform(0.5, 40, COUNT), rng.normal(size=COUNT)])
    row = rng.integers(0, 4, COUNT)
    expression = "result.xy = vec2(span_of(c, Extent(e.x, e.y, e.z), int(r + 0.5)))"
    found = twin("tiles.glsl", expression, state=state, c=center.T, e=extent.T, r=row)[:, :2].T
    right = span_of(center, extent, row, origin, 7)
    some = right[0] <= right[1]
    assert (found[0] <= right[0])[some].all() and (found[1] >= right[1])[some].all()
    assert (found == right)[:, some].mean() > 0.99 and (found[0] <= found[1])[~some].mean() < 0.02
