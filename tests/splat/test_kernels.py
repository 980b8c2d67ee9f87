"""Kernels against closed forms and quadrature; the footprint table against its stated error."""

from __future__ import annotations

import itertools
from collections.abc import Iterator

import numpy as np
import pytest

import splatgl as sg
from splatgl.splat.kernels import KERNELS, PiecewiseCubic, footprint_table, kernel
from tests.helpers.splatting import SPLATS


@pytest.mark.parametrize("name", KERNELS)
def test_unit_volume(name: str) -> None:
    h = kernel(name)
    # ∫∫ F over the plane is the kernel's volume; a fine polar rule
    nodes, weights = np.polynomial.legendre.leggauss(200)
    total, low = 0.0, 0.0
    for knot in h.knots:
        r = low + (nodes + 1) / 2 * (knot - low)
        total += float((weights / 2 * (knot - low) * 4 * np.pi * r**2 * h.value(r)).sum())
        low = knot
    assert total == pytest.approx(1.0, abs=1e-12)


@pytest.mark.parametrize(
    ("name", "volume", "d", "footprint"),
    [
        ("gaussian", 1.966468767, 0.0, 1.253234749),
        ("crawfis-max", 0.999999228, 0.0, 0.699943425324),
        ("crawfis-max", 0.999999228, 0.25, 0.620047499790),
        ("crawfis-max", 0.999999228, 0.5, 0.427743241521),
        ("crawfis-max", 0.999999228, 1.0, 0.073867994858),
    ],
)
def test_footprint_values(name: str, volume: float, d: float, footprint: float) -> None:
    assert float(kernel(name).footprint(np.array(d))) * volume == pytest.approx(footprint, abs=2e-9)


@pytest.mark.parametrize("name", KERNELS)
def test_rim_and_center(name: str) -> None:
    h = kernel(name)
    assert h.footprint(np.array([h.radius, h.radius + 1, 1e9])).tolist() == [0, 0, 0]
    assert np.isfinite(h.footprint(np.array([0.0, 1e-300, 1e-12]))).all()
    assert float(h.partial(np.array(0.3), np.array(-0.4))) == -float(h.partial(np.array(0.3), np.array(0.4)))


@pytest.mark.parametrize("name", KERNELS)
def test_partial_is_the_integral_of_value(name: str) -> None:
    h = kernel(name)
    d, t = 0.6, 0.9
    u = np.linspace(0, t, 20001)
    middle = (u[1:] + u[:-1]) / 2
    brute = float(h.value(np.hypot(d, middle)).sum() * (u[1] - u[0]))
    assert float(h.partial(np.array(d), np.array(t))) == pytest.approx(brute, rel=1e-8)


def test_lattice_ripple() -> None:
    """A constant field rebuilt from the lattice: Crawfis–Max 0.119 % rms, Gaussian 4.4 %."""
    axis = np.arange(-3, 4)
    lattice = np.stack(np.meshgrid(axis, axis, axis), axis=-1).reshape(-1, 3)
    cell = (np.arange(10) + 0.5) / 10
    points = np.stack(np.meshgrid(cell, cell, cell), axis=-1).reshape(-1, 3)
    r = np.linalg.norm(points[:, None] - lattice[None], axis=-1)
    ripple = {name: kernel(name).value(r).sum(axis=1) - 1 for name in KERNELS}
    assert np.sqrt((ripple["crawfis-max"] ** 2).mean()) == pytest.approx(0.00119, abs=3e-5)
    assert np.abs(ripple["gaussian"]).max() == pytest.approx(0.044, abs=3e-3)


def test_table_is_symmetric_and_empty_beyond_the_rim() -> None:
    h = kernel("crawfis-max")
    table = footprint_table(h, 256)
    assert table.shape == (256, 256)
    assert (table == table.T).all()
    assert (table == table[::-1]).all()
    assert table[0, 0] == 0
    assert 0.9998 < table.max() < 1


@pytest.mark.parametrize(("bits", "bound"), [(32, 1.5e-4), (16, 1.5e-4), (8, 2.0e-3)])
def test_table_error(bits: int, bound: float) -> None:
    """Bilinear look-up in a 256×256 table of Crawfis–Max, relative to F(0)."""
    h, n = kernel("crawfis-max"), 256
    table = footprint_table(h, n)
    if bits < 32:
        table = np.rint(table * (2**bits - 1)) / (2**bits - 1)
    at = np.random.default_rng(5).uniform(0.5, n - 1.5, (100000, 2))
    low = at.astype(int)
    part = at - low
    mixed = np.zeros(len(at))
    for dy in (0, 1):
        for dx in (0, 1):
            weight = np.abs(1 - dy - part[:, 0]) * np.abs(1 - dx - part[:, 1])
            mixed += weight * table[low[:, 0] + dy, low[:, 1] + dx]
    place = ((at + 0.5) / n * 2 - 1) * h.radius
    exact = h.footprint(np.hypot(place[:, 0], place[:, 1])) / float(h.footprint(np.zeros(())))
    worst = float(np.abs(mixed - exact).max())
    assert bound / 4 < worst < bound


def test_unknown_kernel() -> None:
    with pytest.raises(ValueError, match=r"kernel: expected crawfis-max or .* or b-spline-free, got 'box'"):
        kernel("box")


B_SPLINE = ((2 / 3, 0.0, -1.0, 0.5), (4 / 3, -2.0, 1.0, -1 / 6))


@pytest.fixture
def registered() -> Iterator[str]:
    sg.register_kernel(PiecewiseCubic("radial-b-spline", (1.0, 2.0), B_SPLINE))
    yield "radial-b-spline"
    del KERNELS["radial-b-spline"]


@pytest.mark.long
def test_a_registered_kernel_draws_within_its_bound(renderer: sg.Renderer, registered: str) -> None:
    """Known to settings, plan, tables, shaders, reference and bound, without a touch to any of them."""
    volume = sg.Volume(np.random.default_rng(2).random((7, 8, 9)), spacing=(1, 1, 2))
    splats = sg.extract(volume, sg.Transfer([(0, 0), (1, 0.6)]), classification="pre")
    for technique, zoom, blend in itertools.product(("quads", "tiles"), (1, 1 / 12), ("composite", "xray", "mip")):
        camera = sg.Camera.orbit(splats, 20, 30, size=(64, 64), zoom=zoom)
        settings = SPLATS.but(kernel=registered, technique=technique, blend=blend)
        image = renderer.render(splats, camera, settings, verify_bound=False)
        right = sg.reference.render(splats, camera, settings).pixels
        assert image.info["kernel"] == registered and right.max() > 0.01
        assert np.abs(image.pixels - right).max() <= image.info["error_bound"]


@pytest.mark.parametrize(
    ("name", "knots", "pieces", "message"),
    [
        ("gaussian", (1.0, 2.0), B_SPLINE, "a new name"),
        ("Mine!", (1.0, 2.0), B_SPLINE, "a new name"),
        ("wide", (1.0, 9.0), B_SPLINE, "a radius of at most 4"),
        ("negative", (1.0,), ((1.0, -3.0, 2.0, 0.0),), "values from 0 on"),
        ("box", (0.5,), ((1.0, 0.0, 0.0, 0.0),), "a step of at most 0.001 at its rim"),
    ],
)
def test_what_is_no_kernel_is_refused(name: str, knots: tuple, pieces: tuple, message: str) -> None:
    with pytest.raises(sg.InputError, match=message):
        sg.register_kernel(PiecewiseCubic(name, knots, pieces))
    assert name not in KERNELS or name == "gaussian"
