"""A still splat's value on a pixel's ray: GLSL against float64, each with a stated bound."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from paper import forms as approximations

import splatgl as sg
from splatgl.geometry.view import GridView
from splatgl.splat.footprint import Splat
from splatgl.splat.kernels import Kernel, kernel, polynomials
from splatgl.splat.line_integral import row1
from tests.helpers.noise import GRIDS, inside, noise, views
from tests.helpers.splatting import SPLATS
from tests.helpers.twins import COUNT, Twin, some_voxels


def radial(shape: Kernel, d2: np.ndarray) -> np.ndarray:
    """F/F(0) at squared distances."""
    return np.asarray(shape.footprint(np.sqrt(np.maximum(d2, 0.0))) / shape.footprint(np.zeros(())))


def footprint(shape: Kernel, at: np.ndarray) -> np.ndarray:
    return radial(shape, (at * at).sum(axis=0))


def ray_at(view: GridView, pixel: np.ndarray) -> np.ndarray:
    """[3, N]: the rays, of depth 1, of places in the picture [2, N], pixels."""
    across = (pixel - np.array(view.size)[:, None] / 2) * view.pitch
    return np.stack([*across, np.ones(pixel.shape[1])])


def ray_of(view: GridView, pixel: np.ndarray) -> np.ndarray:
    """[3, N]: the ray's length, 1/|across|², and the integral over F of a kernel that is not widened."""
    ray = ray_at(view, pixel)
    length, across = (np.linalg.norm(vector, axis=0) for vector in (ray, view.index_from_eye @ ray))
    return np.stack([length, across**-2, length / across])


def exact_share(shape: Kernel, at: np.ndarray, gain: np.ndarray, further: np.ndarray) -> np.ndarray:
    """(1 + gain · at) F/F(0) of a widened footprint, whose D² is |at|² + further."""
    return np.asarray((1 + (gain * at).sum(axis=0)) * radial(shape, (at * at).sum(axis=0) + further))


def half_line(view: GridView, voxel: np.ndarray, place: np.ndarray) -> np.ndarray:
    """The integral from the eye on, in an index space in which the kernel is round, times the length of its steps."""
    ray = np.stack([*place, np.ones(place.shape[1])])
    direction = view.index_from_eye @ ray
    speed = np.linalg.norm(ray, axis=0) / np.linalg.norm(direction, axis=0)
    return np.asarray(approximations.half_line(view.kernel, (view.index_from_eye @ voxel).T, direction.T) * speed)


def near_reach(view: GridView, distance: np.ndarray) -> np.ndarray:
    """Radius [N] of a ball's outline on the plane through its centre, seen from that distance."""
    return np.asarray(distance * np.tan(np.arcsin(view.kernel.radius / distance)))


def near_quad(view: GridView, voxel: np.ndarray, place: np.ndarray) -> np.ndarray:
    """The footprint at the true distance."""
    return row1(replace(view, antialias=False), voxel, place).value


def cubic_quad(view: GridView, voxel: np.ndarray, place: np.ndarray) -> np.ndarray:
    """The ellipse of perspective space with the trapezoid's term."""
    return approximations.form_bprime(Splat(view.kernel, voxel.T, place.T, 1 / view.pitch))


def far_quad(view: GridView, voxel: np.ndarray, place: np.ndarray) -> np.ndarray:
    """The integral of the widened kernel itself."""
    return row1(view, voxel, place).value


@pytest.mark.parametrize("name", ["crawfis-max", "gaussian"])
@pytest.mark.parametrize("tolerance", [1 / 255, 1e-6])
def test_radial_footprints(name: str, tolerance: float, twin: Twin, rng: np.random.Generator) -> None:
    """A table's by 1e−5 of the peak, polynomials' by 5e−5 of themselves."""
    splats, shape = noise(), kernel(name)
    settings = SPLATS.replace(kernel=name, tolerance=tolerance)
    plan = sg.plan(splats, views(splats)["fitted"], settings, tiles=True)
    d2 = rng.uniform(0, 1.1 * shape.radius**2, COUNT)
    found = twin("footprint_eval.glsl", "result.x = radial(x)", plan, splats, x=d2)[:, 0]
    assert (plan.program.footprint == "polynomial") == (tolerance > 1e-3 and polynomials(name) is not None)
    assert np.abs(found - radial(shape, d2)).max() < (1e-5 if plan.program.footprint == "radial" else 5e-5)


@pytest.mark.parametrize("name", ["crawfis-max", "b-spline"])
def test_weights_of_values(name: str, twin: Twin, rng: np.random.Generator) -> None:
    """By 4e−4 of the peak, and near the rim by 8e−4 of themselves."""
    volume = sg.Volume(np.random.default_rng(3).random((6, 6, 6)))
    splats = sg.extract(volume, sg.Transfer([(0, 0), (1, 0.9)]), classification="post", kernel=name)
    plan = sg.plan(splats, views(splats)["fitted"], sg.Settings(), tiles=True)
    assert plan.program.footprint == "single"
    d2 = rng.uniform(0, 1.1 * kernel(name).radius ** 2, COUNT)
    found, right = (
        twin("footprint_eval.glsl", "result.x = radial(x)", plan, splats, x=d2)[:, 0],
        radial(kernel(name), d2),
    )
    assert np.abs(found - right).max() < 4.1e-4 and found.min() > -1e-6
    some = right > 0.01
    assert some.any() and np.abs(found[some] / right[some] - 1).max() < 8.1e-4


def test_footprints_of_table_1(twin: Twin, rng: np.random.Generator) -> None:
    """Between a table's 256² texels, by 2e−4 of the peak; a corner of a quad beyond its table is 0."""
    splats = noise()
    plan = sg.plan(splats, views(splats)["fitted"], SPLATS.replace(align="ray", footprint="table"))
    place = rng.uniform(-1.1, 1.1, (2, COUNT)) * plan.kernel.radius
    found = twin("splat.frag", "at = a; result.x = footprint()", plan, splats, a=place.T)[:, 0]
    assert np.abs(found - footprint(plan.kernel, place)).max() < 2e-4


@pytest.mark.parametrize("grid", GRIDS)
def test_rays(grid: str, twin: Twin, rng: np.random.Generator) -> None:
    splats = noise(grid)
    plan = sg.plan(splats, views(splats)["wide"], SPLATS.replace(align="exact"))
    pixel = rng.uniform(0, 1, (2, COUNT)) * np.array(plan.view.size)[:, None]
    found = twin("footprint_eval.glsl", "result.xyz = ray_at(p)", plan, splats, p=pixel.T)[:, :3].T
    assert np.abs(found - ray_at(plan.view, pixel)).max() < 1e-6
    expression = "Ray ray = ray_of(p); result.xyz = vec3(ray.length_, ray.shrink, ray.gain)"
    found = twin("footprint_eval.glsl", expression, plan, splats, p=pixel.T)[:, :3].T
    right = ray_of(plan.view, pixel)
    if grid in ("cubes", "turned"):
        # a cube's ray has the same length in both axes
        right[2] = 1.0
    assert np.abs(found / right - 1).max() < 2e-6


@pytest.mark.parametrize("grid", ["cubes", "sheared"])
def test_shares_beyond_z_k(grid: str, twin: Twin, rng: np.random.Generator) -> None:
    """A widened quad's terms, of any size; by 1e−4 of the peak."""
    splats = noise(grid)
    settings = SPLATS.replace(align="exact", attenuation="optical-depth", tolerance=1e-6)
    plan = sg.plan(splats, views(splats)["far"], settings)
    at = rng.uniform(-1, 1, (2, COUNT)) * plan.kernel.radius
    a, b, c, e, g = rng.uniform(-0.2, 0.2, (5, 2, COUNT))
    if grid == "cubes":
        # bend = (−γ, κ, λ, β): D² = |at|² + κ x³, and 1 + λ x + β x² + γ y²
        bend, cubic, mixed = np.stack([-np.abs(e[0]), a[0], b[0], c[0]]), np.zeros((4, COUNT)), np.zeros((4, COUNT))
        gain, further = np.stack([b[0] + c[0] * at[0], np.abs(e[0]) * at[1]]), a[0] * at[0] ** 3
    else:
        # bend = (−1, 0, g): D² = |at|² + (a·at)(c·at)² + (e·at)(b·at)(c·at), and 1 + g·at
        bend, cubic, mixed = np.stack([*np.outer((-1, 0), np.ones(COUNT)), *g]), np.stack([*a, *c]), np.stack([*e, *b])
        first, second, third, fourth = ((each * at).sum(axis=0) for each in (a, b, c, e))
        gain, further = g, first * third**2 + fourth * second * third
    expression = "bend = b; cubic = c; mixed = m; result.x = exact_share(a, 0.0, Ray(1.0, 1.0, 1.0))"
    inputs = {"a": at.T, "b": bend.T, "c": cubic.T, "m": mixed.T}
    found = twin("footprint_eval.glsl", expression, plan, splats, **inputs)[:, 0]
    assert np.abs(found - exact_share(plan.kernel, at, gain, further)).max() < 1e-4


NEAR = """
    vec3 e1, e2, i = index_from_eye() * v;
    perpendicular_axes(normalize(i), e1, e2);
    Quad quad = near_quad(eye_from_index() * e1, eye_from_index() * e2, dot(i, i))
"""


@pytest.mark.parametrize(
    ("quad", "right", "grids", "name", "allowed"),
    [
        (NEAR, near_quad, ("cubes", "1:2:5", "sheared"), "close", 2e-5),
        ("Quad quad = cubic_quad(v, true)", cubic_quad, ("cubes", "turned"), "far", 1e-3),
        ("Quad quad = far_quad(v)", far_quad, ("1:2:5", "sheared"), "far", 5e-3),
    ],
    ids=["near_quad", "cubic_quad", "far_quad"],
)
def test_quads_beyond_table_1(
    quad: str, right: Twin, grids: tuple[str, ...], name: str, allowed: float, twin: Twin, rng: np.random.Generator
) -> None:
    """At random places of each quad, in shares of the largest value; before z_k exact, beyond it to first order."""
    for grid in grids:
        splats = noise(grid)
        change = {"antialias": "off"} if name == "close" else {}
        plan = sg.plan(
            splats, views(splats)[name], SPLATS.replace(blend="xray", tolerance=1e-6, align="exact", **change)
        )
        voxel = some_voxels(rng, plan.view, splats)
        place = rng.uniform(-1, 1, (2, voxel.shape[1]))
        expression = f"""
            {quad};
            bend = quad.bend; cubic = quad.cubic; mixed = quad.mixed;
            vec2 r = p * quad.reach;
            vec3 point = v + r.x * quad.axis_1 + r.y * quad.axis_2;
            vec2 ray = point.xy / point.z;
            float shrink = 1.0 / (1.0 + dot(r, r) * max(bend.x, 0.0));
            result.x = exact_share(r, shrink, ray_of(ray / frame.pixel_pitch + frame.image_center));
            result = vec4(result.x * quad.gain * style.peak, ray, 0.0)
        """
        found = twin("footprint_eval.glsl", expression, plan, splats, v=voxel.T, p=place.T).T
        values = right(plan.view, voxel, found[1:3])
        assert values.max() > 0.01
        assert np.abs(found[0] - values).max() < allowed * values.max()


def test_outlines_of_near_kernels(twin: Twin, rng: np.random.Generator) -> None:
    splats = noise()
    plan = sg.plan(splats, views(splats)["fitted"], SPLATS)
    distance = plan.kernel.radius * 10.0 ** rng.uniform(0.01, 3, COUNT)
    found = twin("approximations.glsl", "result.x = near_reach(x * x)", plan, splats, x=distance)[:, 0]
    assert np.abs(found / near_reach(plan.view, distance) - 1).max() < 1e-5


@pytest.mark.turns(2)
@pytest.mark.few(12)
@pytest.mark.parametrize("grid", GRIDS)
@pytest.mark.parametrize("view", ["far", "fitted", "close", "wide", "parallel", "parallel, far", "inside"])
@pytest.mark.parametrize("technique", ["quads", "tiles"])
def test_line_integrals(grid: str, view: str, technique: str, twin: Twin, rng: np.random.Generator) -> None:
    """A splat's value at a pixel, by its quad or by its projection, against row 1; in shares of the largest."""
    splats = noise(grid)
    camera = inside(splats, (0.4, 0.9, 0.2)) if view == "inside" else views(splats)[view]
    tiles = technique == "tiles"
    plan = sg.plan(splats, camera, SPLATS.replace(blend="xray", tolerance=1e-6, technique=technique), tiles=tiles)
    if plan.program.align != "exact":
        # a parallel view's quads are Table 1's, which are exact there
        assert not plan.view.perspective
    voxel = some_voxels(rng, plan.view, splats)
    # a pixel that the splat covers
    side = np.maximum(plan.view.pixel_side(voxel[2]), plan.view.widths[1])
    place = (voxel[:2] + rng.uniform(-1, 1, (2, voxel.shape[1])) * side) / (voxel[2] if plan.view.perspective else 1.0)
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


@pytest.mark.parametrize("grid", GRIDS)
def test_half_lines(grid: str, twin: Twin, rng: np.random.Generator) -> None:
    """Around the eye, by the table of half lines: within its 1e−5 and float32."""
    splats = noise(grid)
    plan = sg.plan(splats, inside(splats, (0.4, 0.9, 0.2)), SPLATS.replace(blend="xray", tolerance=1e-6))
    assert plan.program.seen.half_line
    voxel = plan.view.voxels(plan.view.eye_index + rng.uniform(-1.2, 1.2, (COUNT, 3)))
    place = rng.uniform(-1, 1, (2, COUNT)) * plan.view.edge[:, None]
    pixel = place / plan.view.pitch + np.array(plan.view.size)[:, None] / 2
    expression = "result.x = half_line(to_index(v), ray_at(p)) * style.peak"
    found = twin("footprint_eval.glsl", expression, plan, splats, v=voxel.T, p=pixel.T)[:, 0]
    right = half_line(plan.view, voxel, place)
    assert np.abs(found - right).max() < 1e-4 * right.max()
