"""The exact line integral on any grid: against Table 1 on cubes, brute force along the ray, and closed forms."""

from __future__ import annotations

import numpy as np
import pytest

import splatgl as sg
from splatgl.geometry.grid import Grid
from splatgl.geometry.view import GridView
from splatgl.splat.footprint import ROWS, Splat, on_quads, table_quad
from splatgl.splat.kernels import Gaussian, kernel, tabulate
from splatgl.splat.line_integral import row1

KERNELS = ("crawfis-max", "gaussian")
TURN = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0]
SHEAR = np.array([[1.0, 0.35, 0.1], [0.0, 1.0, -0.25], [0.2, 0.0, 1.0]])
GRIDS = {
    "boxes": np.diag([1, 1.2, 4.0]),
    "sheared": SHEAR @ np.diag([0.5, 1, 2]),
    "flat": TURN @ np.diag([1, 1, 30.0]),
}


def view_of(matrix: np.ndarray, name: str = "crawfis-max", height: float | None = None, fov: float = 60) -> GridView:
    """100 pixels high, from an eye at no special place."""
    grid = Grid(matrix, np.array([1.0, 2, 3]))
    eye, target, up = (4, 5, -6), (1, 0, 20), (0, 1, 0)
    camera = sg.Camera.look_at(eye, target, up, fov, (100, 100))
    if height:
        camera = sg.Camera.orthographic(eye, target, up, height, (100, 100))
    return GridView.of(grid, camera, kernel(name))


def some_rays(view: GridView, depth: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Voxels [3, N] of those depths all over the picture, and rays [2, N] near them, widened as they are."""
    n = len(depth)
    voxel = np.concatenate([rng.uniform(-0.57, 0.57, (2, n)) * depth, depth[None]])
    size = view.widths[:, None] / view.shrink(depth)
    ray = voxel[:2] + view.axes @ (rng.uniform(-1.2, 1.2, (2, n)) * size)
    return voxel, ray / depth if view.perspective else ray


@pytest.mark.few(2)
@pytest.mark.parametrize("name", KERNELS)
@pytest.mark.parametrize("matrix", [np.eye(3), 2.5 * TURN])
def test_cubes_are_table_1(matrix: np.ndarray, name: str, rng: np.random.Generator) -> None:
    """Rows 1, 4 and 5 of cubic voxels, however turned: the paper's, before and beyond z_k."""
    view = view_of(matrix, name)
    voxel, ray = some_rays(view, rng.uniform(3, 400, 3000), rng)
    splat = Splat(view.kernel, voxel.T, ray.T, 1 / view.pitch)
    assert splat.beyond.any() and not splat.beyond.all()
    assert np.abs(row1(view, voxel, ray).value - ROWS["row1"](splat)).max() < 1e-11
    assert view.coverage(voxel[2]) == pytest.approx(splat.m**-2, rel=1e-12)
    for align, row in (("ray", "row4"), ("grid", "row5")):
        found = table_quad(view, voxel, align)
        assert np.abs(on_quads(view, found, ray).value - ROWS[row](splat)).max() < 1e-11
        assert found.coverage == pytest.approx(splat.m**-2, rel=1e-12)


def brute_force(view: GridView, voxel: np.ndarray, ray: np.ndarray) -> tuple[float, int]:
    """∫ Π f_i(z) h(A⁻¹[U f(z) Uᵀ(w z − c); z − z_v]) ds in front of the eye; and how many axes are widened."""
    nodes, weights = np.polynomial.legendre.leggauss(16)
    edges = np.linspace(voxel[2] - view.reach, voxel[2] + view.reach, 3001)
    if view.perspective:
        edges = np.linspace(max(edges[0], 0.0), max(edges[-1], 0.0), 3001)
    half = np.diff(edges)[:, None] / 2
    z, dz = (edges[:-1, None] + half * (nodes + 1)).ravel(), (half * weights).ravel()
    pitch, stretch = (view.pitch * voxel[2], voxel[2] / z) if view.perspective else (view.pitch, 1.0)
    at = ray[:, None] * z if view.perspective else np.repeat(ray[:, None], len(z), axis=1)
    across, measure, widened = view.axes.T @ (at - voxel[:2, None]), dz, 0
    for axis, width in enumerate(view.widths):
        if pitch > width and (voxel[2] > view.reach or not view.perspective):
            across[axis] *= width / pitch * stretch
            measure = measure * (width / pitch * stretch)
            widened += 1
    local = view.index_from_eye @ np.concatenate([view.axes @ across, (z - voxel[2])[None]])
    value = view.kernel.value(np.sqrt((local * local).sum(axis=0)))
    return float((value * measure).sum() * np.sqrt(1 + (ray @ ray if view.perspective else 0.0))), widened


@pytest.mark.parametrize("height", [None, 40.0, 130.0, 1500.0])
@pytest.mark.parametrize("grid", GRIDS)
def test_brute_force_along_the_ray(grid: str, height: float | None, rng: np.random.Generator) -> None:
    """Neither, one or both axes widened; near the eye too, where only what is before it counts."""
    view = view_of(GRIDS[grid], height=height)
    # where voxels are as wide as a pixel
    first, second = view.widths[1] / view.pitch, view.widths[0] / view.pitch
    turning = np.array([0.3 * first, (first + second) / 2, 2 * second]).repeat(5)
    depth = turning if view.perspective else np.full(15, view.reach + 1)
    depth = np.concatenate([depth, rng.uniform(-0.9, 0.9, 9) * view.reach]) if view.perspective else depth
    voxel, ray = some_rays(view, depth, rng)
    near = np.abs(depth) < view.reach
    ray[:, near] = rng.uniform(-0.5, 0.5, (2, near.sum()))
    if near.any():
        voxel[:2, near] = rng.uniform(-0.5, 0.5, (2, near.sum()))
    found = row1(view, voxel, ray).value
    kinds = set()
    for n in range(len(depth)):
        right, widened = brute_force(view, voxel[:, n], ray[:, n])
        assert found[n] == pytest.approx(right, abs=2e-10 * view.coverage(depth[n : n + 1])[0])
        kinds.add(widened)
    assert (found > 0.01 * view.coverage(depth)).sum() > 3
    assert not view.perspective or {0, 1} <= kinds


@pytest.mark.parametrize(
    ("depth", "right"),
    [
        (0, 0.626617374643),
        (0.5, 1.054429570589),
        (1, 1.224761381304),
        (-0.5, 0.198805178697),
        (-2.5, 0),
        (9, 1.253234749),
    ],
)
def test_half_line(depth: float, right: float) -> None:
    """The eye in, before and beyond a kernel exp(−2r²): only what lies before it counts."""
    view = GridView(kernel("gaussian"), np.eye(3), np.zeros(3), 1e-3, (8, 8), perspective=True, antialias=True)
    found = row1(view, np.array([[0.0], [0], [depth]]), np.zeros((2, 1))).value
    assert found * 1.966468767 == pytest.approx(right, abs=1e-9)


@pytest.mark.parametrize("name", KERNELS)
def test_quadrature_is_fine_enough(name: str, rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch) -> None:
    """Four times the nodes change a widened splat by at most 1e−11 of its gain, rays through its middle included."""
    view = view_of(np.eye(3), name)
    depth = rng.uniform(1.01, 5, 3000) / view.pitch
    voxel, ray = some_rays(view, depth, rng)
    ray[:, ::2] = voxel[:2, ::2] / depth[::2] + rng.normal(0, 1e-3, (2, 1500)) * view.pitch
    found = row1(view, voxel, ray).value
    nodes, weights = np.polynomial.legendre.leggauss(96)
    monkeypatch.setattr("splatgl.splat.line_integral._RULE", ((nodes + 1) / 2, weights / 2))
    assert np.abs((found - row1(view, voxel, ray).value) / view.coverage(depth)).max() < 1e-11


def test_flat_voxels_lose_no_digits() -> None:
    """Spacing 1:1000: F(D)/|S⁻¹d̂| in extended precision."""
    spacing = np.array([1.0, 1.0, 1000.0])
    view = view_of(np.diag(spacing))
    rng = np.random.default_rng(9)
    for _ in range(50):
        ray = rng.uniform(-0.5, 0.5, 2)
        direction = np.append(ray, 1.0)
        inverse = view.index_from_eye.astype(np.longdouble)
        centre = direction * 5e3 + view.eye_from_index @ rng.uniform(-0.5, 0.5, 3)
        offset, along = inverse @ (direction * 5e3 - centre), inverse @ direction
        cross = np.cross(offset, along)
        speed = np.sqrt((along * along).sum())
        distance = float(np.sqrt((cross * cross).sum()) / speed)
        right = view.kernel.footprint(np.array(distance)) * float(np.linalg.norm(direction) / speed)
        unwidened = GridView(
            view.kernel, view.eye_from_index, view.eye_index, view.pitch, view.size, True, antialias=False
        )
        assert row1(unwidened, centre[:, None], ray[:, None]).value[0] == pytest.approx(right, rel=1e-9)


def test_extreme_views_stay_finite(rng: np.random.Generator) -> None:
    """Half-angle 89.9°, where z_k is nearer than the kernel reaches; voxels everywhere around the eye."""
    view = view_of(np.eye(3), fov=179.8)
    voxel = rng.uniform(-4, 4, (3, 20000))
    voxel[:, 0] = 0
    for value in (row1(view, voxel, rng.uniform(-500, 500, (2, 20000))).value, row1(view, voxel, voxel[:2]).value):
        assert np.isfinite(value).all() and (value >= 0).all()
        assert (value[voxel[2] < -view.reach] == 0).all()


@pytest.mark.parametrize("name", KERNELS)
def test_tabled_footprints(name: str) -> None:
    """Within 1e−12 of F(0) everywhere, also beside the knots."""
    exact, table = kernel(name), tabulate(name)
    beside = np.concatenate([np.logspace(-15, 0, 400), [0.0]])
    ends = [np.array([0.0]), *(knot - beside for knot in exact.knots), *(knot + beside for knot in exact.knots)]
    d = np.abs(np.concatenate([np.linspace(0, exact.radius, 54321), *ends, [1e9]]))
    peak = exact.footprint(np.zeros(()))
    assert np.abs(table.footprint(d) - exact.footprint(d)).max() < 1e-12 * peak
    assert table.footprint(np.array(exact.radius)) == 0
    with pytest.raises(sg.InputError, match="kernel: expected"):
        tabulate("box")


def test_narrow_kernels_bend_too() -> None:
    """A long way beyond z_k the value tends to the box stretch's, row 2, for any kernel."""
    h = Gaussian(k=9.0, radius=0.7, name="narrow")
    voxel, ray = np.array([[300.0], [100.0], [5000.0]]), np.array([[0.0602], [0.0201]])
    view = GridView(h, np.eye(3), np.zeros(3), 0.01, (8, 8), perspective=True, antialias=True)
    splat = Splat(h, voxel.T, ray.T, 100.0)
    assert row1(view, voxel, ray).value[0] == pytest.approx(float(ROWS["row2"](splat)[0]), rel=1e-3)
