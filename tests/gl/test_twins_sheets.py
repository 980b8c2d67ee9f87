"""Sheets in GLSL and their float64 twins: places, weights, sums, rays, and light over a sheet."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import splatgl as sg
from splatgl.geometry.clipping import FACE, FLUSH, Clip
from splatgl.geometry.view import GridView
from splatgl.gl.features import clip_uniforms
from splatgl.gl.sheet_tiles import sheet_uniforms
from splatgl.gl.textures import CLASS_UNIT, class_uniforms
from splatgl.planning.plan import Plan
from splatgl.reference import blend as blends
from splatgl.reference.rays import Bounds, Rays, pixel_slopes
from splatgl.reference.sheets import (
    RaySegments,
    SheetField,
    between_sheets,
    bulge,
    composite_sums,
    means_of,
    remove_bend,
    weight_extinction,
)
from splatgl.splat.kernels import Kernel, kernel
from splatgl.splat.lighting import surface_light
from splatgl.splat.settings import BLENDS
from splatgl.splat.sheets import Sheets, layer_wave
from splatgl.transfer.preintegration import CELLS, ValueClassifier
from tests.helpers.noise import GRIDS, noise, views
from tests.helpers.sheet_twins import RAMP, uniforms
from tests.helpers.twins import COUNT, Twin

# normals of planes, and distances from the middle
CUTS = (((0.3, 0.5, 0.8), -1.0), ((-0.6, 0.2, 0.1), -1.4), ((0.0, -1.0, 0.0), -2.0))


def samples(grid: str = "cubes", size: int = 8, transfer: sg.Transfer = RAMP) -> sg.Splats:
    """Noise to be classified after reconstruction, every voxel of it."""
    cells = np.random.default_rng(3).random((size, size, size))
    return sg.extract(sg.Volume(cells, **GRIDS[grid]), transfer, classification="post-all")


def planned(splats: sg.Splats, view: str, count: int, **changes: Any) -> Plan:
    settings = sg.Settings(compositing="sheets", sheets=count, antialias="off", tolerance=1e-6, **changes)
    return sg.plan(splats, views(splats)[view], settings, tiles=True)


def sheet_place(sheets: Sheets, view: GridView, positions: np.ndarray, first: float) -> np.ndarray:
    return sheets.places(view, positions) - first


def sheet_base(sheets: Sheets, place: np.ndarray) -> np.ndarray:
    return sheets.base(place)


def sheet_weights(sheets: Sheets, t: np.ndarray) -> np.ndarray:
    return sheets.weights(t, np.zeros(len(t)))


def set_ray(rays: Rays, splats: sg.Splats, plan: Plan, first: float) -> np.ndarray:
    """[6, N]: a ray's ends in sheets, mean spacings per sheet, unit world direction; if cut [10, N], of its face the
    normal and the end in sheets, too.
    """
    thick, offset = plan.resolved.sheets.thickness, 0.0
    if not plan.view.perspective:
        along = plan.view.index_from_eye[:, 2]
        offset = along @ (rays.start - plan.view.eye_index[:, None]) / np.linalg.norm(along)
    ends = (np.stack([rays.near, rays.far]) + offset) / thick - first
    found = np.concatenate([ends, [rays.stretch * thick], rays.toward.T])
    return found if rays.face is None else np.concatenate([found, rays.face.T, [ends[0] + FACE / thick]])


def valued(splat: np.ndarray, share: np.ndarray, steps: int) -> np.ndarray:
    """A footprint's value: over its peak, if it weighs values."""
    return share if steps else share * splat[3]


def term_of(splat: np.ndarray, steps: int) -> np.ndarray:
    return splat if steps else np.concatenate([splat[:3], np.ones_like(splat[:1])])


def add_four(splats: list[np.ndarray], shares: np.ndarray, weights: list[np.ndarray], steps: int) -> np.ndarray:
    """[5, sheets, N]: sums of four splats' terms [4, N] and masses by weights [sheets, N]."""
    sums = np.zeros((5, *weights[0].shape))
    for splat, share, weight in zip(splats, shares, weights, strict=True):
        add_splat(sums, splat, share, weight, steps)
    return sums


def add_splat(sums: np.ndarray, splat: np.ndarray, share: np.ndarray, weight: np.ndarray, steps: int) -> None:
    """Adds a splat to sums of add_four."""
    by_sheet = weight * valued(splat, share, steps)
    sums[:4] += term_of(splat, steps)[:, None] * by_sheet
    sums[4] += by_sheet


def join_value(light: np.ndarray, value: np.ndarray, length: np.ndarray, join: str) -> np.ndarray:
    return blends.join_values(light, value, length, join)


def shown(field: SheetField, light: np.ndarray) -> np.ndarray:
    """[N, 4]: the classes of values and lengths [N, 4]."""
    return field.shown(light)


def close_sheet(field: SheetField | None, sums: np.ndarray, rays: Rays, sheets: Sheets) -> np.ndarray:
    """Light [4, N] of sheets' sums [N, sheets, 4 or 5]."""
    return (composite_sums(sums) if field is None else field.composite(sums, rays, 0, sheets)).T


def sheet_share(sheets: Sheets, place: np.ndarray) -> np.ndarray:
    return sheets.shares(place)


def spline_shares(u: np.ndarray) -> np.ndarray:
    """[N, 3]: of three sums, each of which alone is 1."""
    ones = np.repeat(np.eye(3)[:, None], len(u), axis=1)
    return between_sheets(ones, u)


@pytest.mark.parametrize("view", ["fitted", "parallel"])
@pytest.mark.parametrize("grid", ["cubes", "sheared"])
def test_places_in_sheets(grid: str, view: str, twin: Twin, rng: np.random.Generator) -> None:
    splats = noise(grid)
    plan = planned(splats, view, 3)
    state, sheets = uniforms(splats, plan), plan.resolved.sheets
    place = rng.uniform(0, 11, (COUNT, 3)).astype(np.float32)
    found = twin("sheets.glsl", "result.x = sheet_place(p)", plan, splats, state, p=place)[:, 0]
    right = sheet_place(sheets, plan.view, place, state["first_sheet"])
    assert np.abs(found - right).max() < 2e-5
    # every splat is in a sheet that is counted
    first, last = sheets.range(splats, plan.view)
    base = sheets.base(sheets.places(plan.view, splats.positions))
    assert first == state["first_sheet"] and first <= base.min() and base.max() <= last


@pytest.mark.parametrize("count", [2, 3, 4])
def test_weights_of_sheets(count: int, twin: Twin, rng: np.random.Generator) -> None:
    sheets = Sheets.of(kernel("b-spline"), count, 0)
    place = rng.uniform(-3, 40, COUNT).astype(np.float32).astype(np.float64)
    found = twin("sheets.glsl", "result.x = float(sheet_base(p))", state={"SHEETS": count}, p=place)[:, 0]
    assert (found == sheet_base(sheets, place)).all()
    # also beyond the pieces, where a rounded place may lie
    t = (place - sheet_base(sheets, place) + rng.choice([0, 0, 0, 0.6, -0.6], COUNT)).astype(np.float32)
    found = twin("sheets.glsl", "result = sheet_weights(t)", state={"SHEETS": count}, t=t)
    assert np.abs(found[:, :count].T - sheet_weights(sheets, t)).max() < 5e-7
    assert (found >= 0).all() and (found[:, count:] == 0).all()


@pytest.mark.parametrize("count", [2, 3, 4])
def test_places_of_layers(count: int, twin: Twin, rng: np.random.Generator) -> None:
    """How far voxels' layers move a sheet's mean place; and the one sheet of several at a place."""
    sheets = Sheets.of(kernel("b-spline"), count, 2)
    own = {"thickness": sheets.thickness, "kernel_variance": sheets.variance, "kernel_spectrum": sheets.spectrum}
    direction = rng.normal(size=(COUNT, 3))
    direction[:30] = np.eye(3)[rng.integers(3, size=30)] * rng.choice([-1, 1], 30)[:, None]
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    state = {"SHEETS": count, **own}
    right = sheets.layer_terms(direction.T)
    for order, what in np.ndindex(2, 2):
        expression = f"result.xyz = layer_terms(d, {order + 1}.0)[{what}]"
        found = twin("sheets.glsl", expression, state=state, d=direction)[:, :3]
        assert np.abs(found - right[order, what].T).max() < 2e-5
    place = rng.uniform(-40, 40, (COUNT, 3)).astype(np.float32).astype(np.float64)
    found = twin("sheets.glsl", "result.xyz = layer_wave(p)", state={"SHEETS": count}, p=place)[:, :3]
    assert np.abs(found - layer_wave(place)).max() < 1e-5
    assert np.abs(layer_wave(place) - np.sin(2 * np.pi * place)).max() < 0.0012
    number = rng.integers(-3, 40, COUNT)
    found = twin("sheets.glsl", "result.x = bulge(n)", state=state, n=number.astype(float))[:, 0]
    assert np.abs(found - bulge(number, sheets)).max() < 1e-6
    place = rng.uniform(-3, 3, COUNT).astype(np.float32).astype(np.float64)
    found = twin("sheets.glsl", "result.x = sheet_share(p)", state={"SHEETS": count}, p=place)[:, 0]
    assert np.abs(found - sheet_share(sheets, place)).max() < 1e-6


@pytest.mark.parametrize("count", [2, 3, 4])
def test_places_and_spread_of_even_matter(count: int) -> None:
    """Against sums over voxels: on rays along an axis, nearly so, and across two and three."""
    sheets, shape = Sheets.of(kernel("b-spline"), count, 2), kernel("b-spline")
    cells = np.stack(np.meshgrid(*(np.arange(-7, 8),) * 3)).reshape(3, -1)
    off = []
    for axis in ((0, 0, 1), (0.1, 0.05, 0.99), (0.28, 0, -0.96), (0.48, 0.36, 0.8), (0.577, -0.577, 0.577)):
        direction = np.array(axis) / np.linalg.norm(axis)
        terms = sheets.layer_terms(direction[:, None])[..., 0]
        for place in np.random.default_rng(1).uniform(-0.5, 0.5, (8, 3)):
            apart = cells - place[:, None]
            along = direction @ apart
            weight = shape.footprint(np.sqrt(np.maximum((apart**2).sum(axis=0) - along**2, 0)))
            weight = weight * sheet_share(sheets, along / sheets.thickness)
            along /= sheets.thickness
            mass = weight.sum() / shape.footprint(np.zeros(())) / sheets.mass
            sine, cosine = (layer_wave(np.stack([place, 2 * place]) + part) for part in ([[0], [0]], [[0.25], [0.25]]))
            lag, further = (terms[:, 0] * sine).sum(), (terms[:, 1] * cosine).sum()
            spread = (weight @ along**2) / weight.sum() - count / 12
            off.append((lag / mass + (weight @ along) / weight.sum(), further / mass - spread, mass - 1))
    most = {2: (0.025, 0.06, 0.13), 3: (0.012, 0.009, 0.06), 4: (0.005, 0.004, 0.035)}[count]
    assert (np.abs(off).max(axis=0) < most).all()


@pytest.mark.few(3)
@pytest.mark.parametrize("view", ["fitted", "wide", "parallel"])
@pytest.mark.parametrize("grid", ["cubes", "sheared"])
@pytest.mark.parametrize("cut", [False, True])
def test_rays_in_sheets(cut: bool, grid: str, view: str, twin: Twin) -> None:
    """Of all pixels, with planes before, behind and between; ends of rays that miss what is left are one."""
    splats = samples(grid)
    middle = splats.corners.mean(axis=0)
    clip = [(*normal, float(np.dot(normal, middle) + d)) for normal, d in CUTS] if cut else ()
    plan = planned(splats, view, 3, clip=clip)
    camera, post = plan.resolved.camera, splats.post
    assert post is not None
    width, height = camera.size
    pixel = np.arange(width * height)
    at = np.stack([pixel % width, pixel // width], axis=1) + 0.5
    state = uniforms(splats, plan)
    state |= {"box_low": tuple(-0.5 - plan.view.eye_index)}
    state |= {"box_high": tuple(np.array(post.shape) - 0.5 - plan.view.eye_index)}
    parts = {"vec4(ends[0], lengths[0], 0.0)": 3, "vec4(toward[0], 0.0)": 3, **({"face[0]": 4} if cut else {})}
    found = np.concatenate(
        [
            twin("sheet_draw.comp", f"first = a; set_ray(0); result = {part}", plan, splats, state, a=at)[:, :some].T
            for part, some in parts.items()
        ]
    )
    slopes = pixel_slopes(pixel, camera, plan.view.pitch)
    rays = Rays.of(plan.view, camera, Bounds.of_voxels(post.shape, plan.resolved.clip), slopes)
    right = set_ray(rays, splats, plan, state["first_sheet"])
    hit = rays.far > rays.near
    assert hit.sum() > 40 and (found[1] - found[0])[~hit].max(initial=0) < 1e-4
    if rays.face is not None:
        assert 20 < (rays.face[hit] != 0).any(axis=1).sum() < hit.sum() - 20
    assert np.abs((found - right)[:, hit]).max() < 1e-4 and np.abs((found - right)[2:6]).max() < 1e-5


def clip_ray(clip: Clip, start: np.ndarray, direction: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """[P, 3], [P, 2]: normals of faces, and ends of rays that begin at 0."""
    enters, leaves, plane = clip.along(start, direction)
    return np.where((enters > FLUSH)[:, None], clip.normal[plane], 0.0), np.stack(
        [np.maximum(enters, 0), leaves], axis=1
    )


def test_planes_clip_rays(twin: Twin, rng: np.random.Generator) -> None:
    """Rays along planes, too, are kept everywhere or nowhere."""
    splats = samples("sheared")
    middle = splats.corners.mean(axis=0)
    planes = [(*normal, float(np.dot(normal, middle) + d)) for normal, d in CUTS]
    plan = planned(splats, "fitted", 3, clip=planes)
    clip, eye = plan.resolved.clip, plan.view.eye_index
    assert clip is not None
    start, direction = rng.uniform(-8, 8, (3, COUNT)), rng.normal(size=(3, COUNT))
    direction[:, :50] = np.cross(clip.g[0], rng.normal(size=(50, 3))).T
    direction /= np.linalg.norm(direction, axis=0)
    state, inputs = clip_uniforms(splats, plan), {"s": start.T, "d": direction.T}
    setup = "float near = 0.0, far = 1e9; vec3 face = clip_ray(s, d, 1.0, near, far);"
    face = twin("clip_ray.glsl", f"{setup} result.xyz = face", None, None, state, **inputs)[:, :3]
    ends = twin("clip_ray.glsl", f"{setup} result.xy = vec2(near, far)", None, None, state, **inputs)[:, :2]
    right_face, right_ends = clip_ray(clip, start + eye[:, None], direction)
    clear = np.abs(clip.g @ direction / np.linalg.norm(clip.g, axis=1)[:, None]).min(axis=0) > 1e-3
    assert 100 < (right_face[clear] != 0).any(axis=1).sum() < COUNT - 100
    near = np.abs(right_ends) < 1e3
    assert np.abs(ends - right_ends)[near & clear[:, None]].max() < 1e-2
    assert (np.abs(face - right_face)[clear].max(axis=1) < 1e-5).mean() > 0.999


@pytest.mark.few(3)
@pytest.mark.parametrize("steps", [0, 2])
@pytest.mark.parametrize("count", [2, 3, 4])
def test_sums_of_four(count: int, steps: int, twin: Twin, rng: np.random.Generator) -> None:
    splats = samples() if steps else noise(size=8)
    plan = planned(splats, "fitted", count, **({"steps": steps} if steps else {}))
    splat, weight = rng.uniform(-1, 1, (4, COUNT)), rng.random((4, COUNT))
    distance = rng.uniform(0, 0.5, COUNT)
    setup = """
        Joined four[4]; vec4 weights[4];
        for (int i = 0; i < 4; i++) {
            four[i].offset = vec2(0.0); four[i].around = false;
            four[i].shape = vec4(a.x * float(i), 0.0, 0.0, 0.0);
            four[i].splat = s * float(i + 1); weights[i] = w / float(i + 1);
        }
        sum0[0] = sum1[0] = sum2[0] = sum3[0] = masses[0] = vec4(0.0);
        add_four(0, four, Ray(1.0, 1.0, 1.0), weights);
    """
    one = setup.replace(
        "add_four(0, four, Ray(1.0, 1.0, 1.0), weights)",
        """
        for (int i = 0; i < 4; i++) add_splat(0, four[i], Ray(1.0, 1.0, 1.0), weights[i])""",
    )
    shape = plan.kernel
    shares = shape.footprint(distance * np.arange(4)[:, None]) / shape.footprint(np.zeros(()))
    numbers = [i + 1 for i in range(4)]
    right = add_four([splat * n for n in numbers], shares, [weight / n for n in numbers], steps)
    inputs = {"s": splat.T, "w": weight.T, "a": distance}
    for adding in (setup, one):
        for sheet in range(count):
            found = twin("sheet_draw.comp", f"{adding} result = sum{sheet}[0]", plan, splats, **inputs)
            assert np.abs(found.T - right[:4, sheet]).max() < 2e-4
        if steps:
            found = twin("sheet_draw.comp", f"{adding} result = masses[0]", plan, splats, **inputs)
            assert np.abs(found.T - right[4]).max() < 2e-4


def share_at(shape: Kernel, triangle: np.ndarray, offset: np.ndarray, ray: np.ndarray) -> np.ndarray:
    """The share of a peak at pixel offsets [2, N]; ray [2, N]: shrink and gain."""
    across = triangle[0] * offset[0] + triangle[1] * offset[1]
    d = np.sqrt((across**2 + (triangle[2] * offset[1]) ** 2) * ray[0])
    return np.asarray(shape.footprint(d) / shape.footprint(np.zeros(())) * ray[1])


@pytest.mark.parametrize("steps", [0, 2])
def test_shares_of_a_splat(steps: int, twin: Twin, rng: np.random.Generator) -> None:
    splats = samples() if steps else noise(size=8)
    plan = planned(splats, "fitted", 3, **({"steps": steps} if steps else {}))
    triangle, splat = rng.uniform(-0.5, 0.5, (3, COUNT)), rng.uniform(0, 1, (4, COUNT))
    offset, row, ray = rng.uniform(-2, 2, (2, COUNT)), 3, rng.uniform(0.5, 1, (2, COUNT))
    setup = """
        Joined it; it.offset = o; it.around = false; it.splat = s;
        it.shape = vec4(t.x * o.x, t.yz, 0.0);
        Ray ray = Ray(1.0, r.x, r.y)
    """
    inputs = {"o": offset.T, "s": splat.T, "t": triangle.T, "r": ray.T}
    share = share_at(plan.kernel, triangle, offset + np.array([[0], [row]]), ray)
    found = twin("sheet_draw.comp", f"{setup}; result.x = share_at(it, ray, {row}.0)", plan, splats, **inputs)[:, 0]
    assert np.abs(found - share).max() < 5e-5
    expression = f"{setup}; result.x = valued(it, ray, {row})"
    found = twin("sheet_draw.comp", expression, plan, splats, {"stride": 1.0}, **inputs)[:, 0]
    assert np.abs(found - valued(splat, share, steps)).max() < 5e-5
    found = twin("sheet_draw.comp", f"{setup}; result = term_of({row}, it)", plan, splats, **inputs)
    assert np.abs(found.T - term_of(splat, steps)).max() < 1e-6


def some_rays(rng: np.random.Generator) -> Rays:
    """Rays whose ends are between sheets 0 and 2, nearly all of them."""
    near, far, start = rng.uniform(-1.5, 0.5, COUNT), rng.uniform(0.3, 2.5, COUNT), rng.uniform(-1, 1, (3, COUNT))
    toward = rng.normal(size=(COUNT, 3))
    toward /= np.linalg.norm(toward, axis=1, keepdims=True)
    return Rays(start, toward.T[::-1], near, np.maximum(far, near), rng.uniform(0.5, 2, COUNT), toward, near)


def of_layers(rays: Rays, sheets: Sheets) -> dict[str, np.ndarray]:
    """Inputs of LAYERS: rays among voxels."""
    return {"p": rays.start.T, "q": rays.direction.T * sheets.thickness}


LAYERS = """
    layer_first[0] = p; layer_step[0] = q;
    layers[0] = layer_terms(q / thickness, 1.0); half_layers[0] = layer_terms(q / thickness, 2.0);
"""


def class_state(renderer: sg.Renderer, splats: sg.Splats) -> dict[str, object]:
    """The classification table's uniforms."""
    renderer.passes.device.tables.classification(splats).use(CLASS_UNIT)
    return class_uniforms(splats.post)


def class_until(post: ValueClassifier, u: np.ndarray) -> np.ndarray:
    return post.integral.until(post.value(u))


def class_mean(post: ValueClassifier, first: np.ndarray, last: np.ndarray) -> np.ndarray:
    return post.integral.mean(post.value(first), post.value(last))


STEEP = [(0, 0), (0.2, 0.9), (0.2, 0.1), (0.5, 0.1), (0.50001, 0.99), (0.50002, 0.1), (0.9, 0), (1, 0.5)]


@pytest.mark.parametrize("points", [[(0, 0), (1, 0.9)], STEEP], ids=["ramp", "steps and a spike"])
def test_classes_of_values(
    points: list[tuple[float, float]], renderer: sg.Renderer, twin: Twin, rng: np.random.Generator
) -> None:
    """Over intervals of all widths, in either direction, and beyond the ends."""
    splats = samples(transfer=sg.Transfer(points, colormap="hot"))
    post, plan, state = splats.post, planned(splats, "fitted", 3), class_state(renderer, splats)
    first = rng.uniform(-0.5, 1.5, COUNT)
    last = first + np.where(rng.random(COUNT) < 0.5, 1, -1) * 10 ** rng.uniform(-3.5, 0.3, COUNT)
    last[:20] = first[:20]
    a, b = post.scale
    places = {"f": a * first + b, "l": a * last + b}
    right = class_mean(post, first, last)
    found = twin(
        "sheet_draw.comp", "result = class_mean(class_until(f), class_until(l))", plan, splats, state, **places
    )
    # within a cell of the table the mean is that of the cell; a place is rounded to 2^-11 of a cell
    narrow = np.abs(last - first) < 0.01
    allowed = np.where(narrow, 2e-2 if points is STEEP else 2e-4, 2e-4)[:, None] * right.max()
    assert right.max() > 1 and (np.abs(found - right) < allowed).mean() > 0.999
    assert (np.abs(found - right) < 2e-5 * right.max() + 0.1 * allowed * narrow[:, None])[~narrow].mean() > 0.99
    # integrals from the table's first cell on
    expression = "Until it = class_until(l); result = vec4(it.below) * class_unit + it.above"
    until = class_until(post, last) * a / post.span
    assert np.abs(twin("sheet_draw.comp", expression, plan, splats, state, **places) - until).max() < 1e-4 * until.max()


def test_the_last_cell_of_the_table(renderer: sg.Renderer, twin: Twin) -> None:
    """Matter in the last two cells alone: up to the middle of the last, half of its matter counts."""
    splats = samples(transfer=sg.Transfer([(0, 0), (1 - 2 / CELLS, 0), (1, 0.9)]))
    post, plan, state = splats.post, planned(splats, "fitted", 3), class_state(renderer, splats)
    places, ends = np.full(COUNT, CELLS - 0.5), np.array([CELLS - 1.0, CELLS])
    (a, b), until = post.scale, "Until it = class_until(l); result = vec4(it.below) * class_unit + it.above"
    right = class_until(post, (ends - b) / a).mean(axis=0) * a / post.span
    found = twin("sheet_draw.comp", until, plan, splats, state, l=places)
    assert right.max() > 0 and np.abs(found - right).max() < 1e-2 * right.max()


def weight_of(splats: sg.Splats, gradient: np.ndarray) -> np.ndarray:
    """Of gradients [N, 3] of record values per mean spacing."""
    size = np.linalg.norm(gradient, axis=1) * splats.post.span / splats.grid.mean_spacing
    return splats.post.transfer.weight(size)


def test_weights_of_gradients(renderer: sg.Renderer, twin: Twin, rng: np.random.Generator) -> None:
    transfer = sg.Transfer([(0, 0), (1, 0.9)], gradient=[(0.3, 0.1), (0.8, 1), (0.8, 0.5), (1.5, 0)])
    splats = samples("sheared", transfer=transfer)
    plan, gradient = planned(splats, "fitted", 3), rng.normal(size=(COUNT, 3))
    class_state(renderer, splats)
    found = twin("sheet_draw.comp", "result.x = weight_of(g)", plan, splats, uniforms(splats, plan), g=gradient)[:, 0]
    off = np.abs(found - weight_of(splats, gradient))
    # a step within a cell is a ramp there
    assert plan.program.appearance.weighted and (off < 1e-4).mean() > 0.99 and off.max() < 0.5
    inputs = {"e": 10 ** rng.uniform(-9, 1.2, COUNT), "w": np.minimum(rng.uniform(0, 1.1, COUNT), 1)}
    found = twin("sheet_draw.comp", "result.x = weighted(e, w)", plan, splats, uniforms(splats, plan), **inputs)[:, 0]
    right = weight_extinction(inputs["e"], inputs["w"])
    # a weight near 1 of an opacity near 1 leaves few digits
    assert (np.abs(found - right) <= 4e-6 * right * np.maximum(1, 0.1 * np.exp(right))).all()


@pytest.mark.parametrize("lit", [{}, {"light": "glossy"}, {"light": "matte", "light_from": (0.0, 0.0)}])
@pytest.mark.parametrize("cut", [False, True])
def test_light_over_matter(
    cut: bool, lit: dict[str, Any], renderer: sg.Renderer, twin: Twin, rng: np.random.Generator
) -> None:
    """Also of the face of a cut, of which a part may be before the end."""
    splats = samples()
    plan = planned(splats, "fitted", 3, clip=[(1.0, 0, 0, 0)] if cut else (), **lit)
    field, state = SheetField.of(splats, plan.resolved, plan.view), class_state(renderer, splats)
    light = rng.random((COUNT, 4))
    first = np.column_stack([rng.uniform(-0.3, 1.3, COUNT), rng.normal(size=(COUNT, 3))])
    last = np.column_stack([rng.uniform(-0.3, 1.3, COUNT), rng.normal(size=(COUNT, 3))])
    first[::10, 1:] = last[::10, 1:] = 0
    length, toward = rng.uniform(0, 2, COUNT), some_rays(rng).toward
    matter = class_mean(field.post, first[:, 0], last[:, 0])
    inputs = {"l": light, "m": matter, "g": (first[:, 1:] + last[:, 1:]) / 2, "a": length, "t": toward}
    face = np.column_stack([rng.normal(size=(COUNT, 3)), rng.uniform(-0.5, 1.5, COUNT)])
    face[::3, :3] = 0
    steps = "vec4 w = weighed(m, g, a); toward[0] = t;" + " face[0] = f;" * cut
    steps += " vec2 s = light_of(0, g, 0.0, 1.0); w.rgb = w.rgb * s.x + w.a * s.y"
    inputs |= {"f": face} if cut else {}
    found = twin("sheet_draw.comp", f"{steps}; result = behind(l, w)", plan, splats, state, **inputs)
    along = length * splats.unit / splats.grid.mean_spacing
    faced = np.clip(face[:, 3], 0, 1)
    ends, middle = (np.zeros(COUNT), np.ones(COUNT)), (first + last) / 2
    none = np.zeros(COUNT)
    part = RaySegments(np.arange(COUNT), none.astype(int), none, ends, first, middle, last, along, faced, none)
    rays = replace(some_rays(rng), toward=toward, face=face[:, :3] if cut else None)
    right = light + (1 - light[:, 3:]) * composite_sums(field.matter(part, rays)[:, None])
    shines = np.broadcast_to(0.0 if field.shines is None else field.shines, (COUNT, 3))
    inputs |= {"s": shines}
    found_light = twin(
        "sheet_draw.comp", "result.xy = surface_light(g, t, s, vec2(1.0))", plan, splats, state, **inputs
    )[:, :2]
    right_light = np.stack(surface_light(inputs["g"], toward, field.appearance.light, field.shines), axis=1)
    assert np.abs(found_light - right_light).max() < 1e-5
    assert plan.resolved.appearance.shading and np.abs(found - right).max() < (1e-5 if lit else 2e-6)


@pytest.mark.parametrize("steps", [0, 1, 3])
def test_light_over_sheets(steps: int, renderer: sg.Renderer, twin: Twin, rng: np.random.Generator) -> None:
    splats = samples() if steps else noise(size=8)
    plan = planned(splats, "fitted", 2, **({"steps": steps} if steps else {}))
    field, state = None, {}
    if steps:
        field = SheetField.of(splats, plan.resolved, plan.view)
        state = class_state(renderer, splats)
    # masses on both sides of the least, and emission beside depth
    mass = 10 ** rng.uniform(-4, 0, (COUNT, 2, 1))
    mean = np.concatenate([rng.uniform(0, 1, (COUNT, 2, 1)), rng.normal(size=(COUNT, 2, 3))], axis=2)
    sums = np.concatenate([mass, mean * mass], axis=2)
    if not steps:
        sums = np.concatenate([rng.random((COUNT, 2, 3)) * mass, mass * 4], axis=2)
    rays, sheets = some_rays(rng), plan.resolved.sheets
    expression = """
        open_pixel(0); masses[0] = vec4(m, 0.0, 0.0); sum0[0] = a; sum1[0] = b;
        ends[0] = e.xy; lengths[0] = e.z; toward[0] = t;
        for (int n = 0; n < 4; n++) if (take_sheet(0, n)) close_sheet(0, n);
        result = light[0]
    """
    if steps:
        state |= {**sheet_uniforms(splats, plan), "first_sheet": 0.0}
        expression = expression.replace("for", LAYERS + " for")
    ordered = np.roll(sums[..., 1:], -1, axis=2) if steps else sums
    thick = sheets.thickness
    ends = np.stack([rays.near / thick, rays.far / thick, rays.stretch * thick], axis=1)
    inputs = {"m": mass[..., 0], "a": ordered[:, 0], "b": ordered[:, 1], "e": ends, "t": rays.toward}
    inputs |= of_layers(rays, sheets) if steps else {}
    found = twin("sheet_draw.comp", expression, plan, splats, state, **inputs)
    right = close_sheet(field, sums, rays, sheets)
    assert right.max() > 0.3 and np.abs(found.T - right).max() < (5e-4 if steps else 3e-6)


def centered(field: SheetField, sums: np.ndarray, rays: Rays, sheets: Sheets) -> np.ndarray:
    return field.center(sums, rays, 0, sheets)


def values_around(around: np.ndarray, rays: Rays, sheets: Sheets) -> np.ndarray:
    """[N, 3]: of sums and further spread [3, N, 6]."""
    return remove_bend(around, rays.toward * (rays.stretch * sheets.thickness)[:, None])[..., 1].T


def test_sums_at_the_place_of_a_sheet(twin: Twin, rng: np.random.Generator) -> None:
    """Masses on both sides of those whose values are moved, and how three sums are joined."""
    splats = samples()
    plan = planned(splats, "fitted", 3, steps=2)
    field, sheets, rays = SheetField.of(splats, plan.resolved, plan.view), plan.resolved.sheets, some_rays(rng)
    # amid the grid of 8³
    rays = replace(rays, start=rays.start + 3.5)
    mass = sheets.mass * rng.uniform(0.8, 1, COUNT)
    sums = np.column_stack([mass, rng.uniform(0, 1, COUNT), rng.normal(size=(COUNT, 3))])[:, None] + np.zeros((1, 3, 1))
    right = centered(field, sums, rays, sheets)
    state = {**sheet_uniforms(splats, plan), "first_sheet": 0.0}
    inputs = {"s": np.roll(sums[:, 2, 1:], -1, axis=1), "m": mass, "t": rays.toward}
    inputs |= {"e": rays.stretch * sheets.thickness, **of_layers(rays, sheets)}
    setup = f"toward[0] = t; lengths[0] = e / style.opacity_length; float mass = m, further; {LAYERS}"
    found = twin("sheet_draw.comp", f"{setup} result = centered(0, 2, s, mass, further)", plan, splats, state, **inputs)
    few = mass < 0.85 * sheets.mass
    off = np.abs(right[:, 2, 1] - sums[:, 2, 1])
    assert (off[few] == 0).all() and off.max() > 0.05 and 10 < few.sum() < COUNT - 10
    assert np.abs(found - np.roll(right[:, 2, 1:5], -1, axis=1)).max() < 2e-5
    expression = f"{setup} centered(0, 2, s, mass, further); result.xy = vec2(mass, further)"
    found = twin("sheet_draw.comp", expression, plan, splats, state, **inputs)[:, :2]
    assert np.abs(found - right[:, 2, [0, 5]]).max() < 2e-5 and (right[few, 2, 5] == 0).all()
    near = np.array([right[:, n, 5] for n in range(3)])
    expression = """
        toward[0] = t; lengths[0] = e / style.opacity_length;
        start[0] = a; middle[0] = b; before[0] = 2.0 * c - b; spread[0] = vec3(d.xy, 2.0 * d.z - d.y);
        result.xyz = values_around(0)
    """
    three = rng.normal(size=(3, COUNT, 5))
    bent = values_around(np.concatenate([three, near[..., None]], axis=2), rays, sheets)
    own = {name: np.roll(part[:, 1:], -1, axis=1) for name, part in zip("abc", three, strict=True)}
    own |= {"d": near.T, "t": rays.toward, "e": rays.stretch * sheets.thickness}
    found = twin("sheet_draw.comp", expression, plan, splats, state, **own)[:, :3]
    assert np.abs(found - bent).max() < 2e-5 and np.abs(bent - three[..., 1].T).max() > 0.05
    u = rng.uniform(0, 1, COUNT)
    found = twin("sheet_draw.comp", "result.xyz = spline_shares(u)", plan, splats, u=u)[:, :3]
    assert np.abs(found - spline_shares(u)).max() < 1e-6


def test_no_gap_between_the_values_of_sheets(rng: np.random.Generator) -> None:
    """What is between two values at the border of two sheets is in neither: the same there, from both sides."""
    a, b, c, d = rng.uniform(0.5, 1, (4, COUNT, 5))
    behind_, ahead = np.stack([(a + b) / 2, b, (b + c) / 2]), np.stack([(b + c) / 2, c, (c + d) / 2])
    ends = [means_of(between_sheets(*side)) for side in ((behind_, np.ones(COUNT)), (ahead, np.zeros(COUNT)))]
    assert np.abs(ends[0] - ends[1]).max() < 1e-9


@pytest.mark.parametrize("blend", [name for name in BLENDS if sg.Settings(blend=name).shows_value])
def test_one_value_of_sheets(blend: str, renderer: sg.Renderer, twin: Twin, rng: np.random.Generator) -> None:
    """Its join, its class, and both over sheets whose ends are in the box."""
    splats = samples()
    plan = planned(splats, "fitted", 2, steps=2, blend=blend)
    field = SheetField.of(splats, plan.resolved, plan.view)
    state = class_state(renderer, splats) | {"window_share": (*splats.post.window_share, 0.05)}
    light = np.column_stack([rng.uniform(-1, 2, COUNT), rng.uniform(0, 2, COUNT), np.zeros((COUNT, 2))])
    light[::5] = 0
    value, length = rng.uniform(-1, 2, COUNT), rng.choice([0, 0.3, 1], COUNT)
    found = twin(
        "sheet_draw.comp", "result = join_value(l, a.x, a.y)", plan, splats, l=light, a=np.stack([value, length], 1)
    )
    assert np.abs(found - join_value(light, value, length, field.appearance.join)).max() < 1e-6
    found = twin("optics.glsl", "result.x = joined_value(l)", plan, splats, l=light)[:, 0]
    right = blends.joined_value(light, field.appearance.join)
    assert (np.abs(found - right) / (1 + np.abs(right)))[light[:, 1] > 0].max() < 1e-6
    found = twin("sheet_draw.comp", "result = shown(l)", plan, splats, state, l=light)
    assert np.abs(found - shown(field, light)).max() < 3e-4 and (found[::5] == 0).all()
    mass, mean = 10 ** rng.uniform(-3, 0, (COUNT, 2, 1)), rng.uniform(0, 1, (COUNT, 2, 4))
    sums = np.concatenate([mass, mean * mass], axis=2)
    rays, sheets = some_rays(rng), plan.resolved.sheets
    expression = f"""
        open_pixel(0); masses[0] = vec4(m, 0.0, 0.0); sum0[0] = a; sum1[0] = b; ends[0] = e.xy;
        lengths[0] = e.z; toward[0] = t; {LAYERS}
        for (int n = 0; n < 4; n++) if (take_sheet(0, n)) close_sheet(0, n);
        result = shown(light[0])
    """
    state |= {**sheet_uniforms(splats, plan), "first_sheet": 0.0}
    ordered = np.roll(sums[..., 1:], -1, axis=2)
    ends = np.stack([rays.near, rays.far, rays.stretch * sheets.thickness**2], axis=1) / sheets.thickness
    inputs = {"m": mass[..., 0], "a": ordered[:, 0], "b": ordered[:, 1], "e": ends, "t": rays.toward}
    inputs |= of_layers(rays, sheets)
    found = twin("sheet_draw.comp", expression, plan, splats, state, **inputs)
    right = close_sheet(field, sums, rays, sheets)
    assert right[3].max() > 0.5 and np.abs(found.T - right).max() < 5e-4


def test_attenuated_maxima(twin: Twin, rng: np.random.Generator) -> None:
    """Parts of rays, some without length, behind some light or none."""
    light = np.column_stack([rng.uniform(0, 1, (COUNT, 2)), np.zeros(COUNT), rng.exponential(1, COUNT)])
    shares, depth = rng.uniform(0, 1, (COUNT, 3)), rng.exponential(1, COUNT)
    length = rng.uniform(0, 1, COUNT) * (rng.random(COUNT) < 0.8)
    found = twin("optics.glsl", "result = join_attenuated(l, s, x, d)", l=light, s=shares, x=length, d=depth)
    assert np.abs(found - blends.join_attenuated(light, shares.T, length, depth)).max() < 5e-6
