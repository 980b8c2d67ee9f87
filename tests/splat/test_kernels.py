"""Kernels against closed forms and quadrature; the footprint table against its stated error."""

from __future__ import annotations

import itertools
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from paper.__main__ import main as draw_figure
from PIL import Image as Pillow

import splatgl as sg
from splatgl.cli.main import main
from splatgl.report.methods import AXES
from splatgl.splat.kernels import KERNELS, PiecewiseCubic, footprint_table, has_negative, kernel, polynomials
from tests.helpers.splatting import SPLATS

pytestmark = pytest.mark.usefixtures("shared_programs")


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
        settings = SPLATS.replace(kernel=registered, technique=technique, blend=blend)
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
        ("negative", (1.0,), ((1.0, -3.0, 2.0, 0.0),), "a footprint that is largest in the middle"),
        ("box", (0.5,), ((1.0, 0.0, 0.0, 0.0),), "a step of at most 0.001 at its rim"),
    ],
)
def test_what_is_no_kernel_is_refused(name: str, knots: tuple, pieces: tuple, message: str) -> None:
    with pytest.raises(sg.InputError, match=message):
        sg.register_kernel(PiecewiseCubic(name, knots, pieces))
    assert name not in KERNELS or name == "gaussian"


# --- kernels that are negative somewhere -----------------------------------------------------------------------------


@pytest.fixture
def mitchell() -> Iterator[str]:
    sg.register_kernel(PiecewiseCubic.of_family("mitchell"))
    yield "mitchell"
    del KERNELS["mitchell"]


@pytest.mark.parametrize(("b", "c"), [(1.0, 0.0), (1 / 3, 1 / 3), (0.6, 0.2), (0.0, 0.5)])
def test_family_of_mitchell_and_netravali(b: float, c: float) -> None:
    """Along a line the weights of lattice points add up to 1; by distance the volume of B + 2C = 1 is 2πB/3."""
    shape = PiecewiseCubic.of_family("member", b, c)
    place = np.linspace(0, 1, 11)[:, None]
    line = shape.value(np.abs(place - np.arange(-2, 4))) / shape.scale
    assert np.allclose(line.sum(axis=1), 1, atol=1e-14)
    # linear fields, and from Catmull-Rom on squares too: its second moment, and so its volume, is 0
    assert np.allclose(line @ np.arange(-2.0, 4), place[:, 0], atol=1e-14)
    assert b > 0 or np.allclose(line @ np.arange(-2.0, 4) ** 2, place[:, 0] ** 2, atol=1e-14)
    if b:
        assert 1 / shape.scale == pytest.approx(2 * np.pi * b / 3, rel=1e-12)
        return
    with pytest.raises(sg.InputError, match=r"volume 1, got .*Catmull-Rom, has volume 0"):
        sg.register_kernel(replace(shape, name="catmull-rom"))


def test_a_negative_kernel_draws_sums_within_its_bound(renderer: sg.Renderer, mitchell: str) -> None:
    """By both techniques, of cubes and of others; X-rays take it without being asked for voxels classified before."""
    assert has_negative(mitchell) and not any(has_negative(name) for name in KERNELS if name != mitchell)
    assert kernel(mitchell).footprint(np.array(1.4)) < 0 and polynomials(mitchell) is None
    for spacing, zoom in (((1, 1, 2), 1), ((1, 1, 1), 1 / 12)):
        volume = sg.Volume(np.random.default_rng(2).random((7, 8, 9)) ** 20, spacing=spacing)
        scene = sg.Scene([sg.Layer(volume, sg.Transfer([(0, 0), (1, 0.6)]))])
        camera = sg.Camera.orbit(volume, 20, 30, size=(48, 48), zoom=zoom)
        for technique in ("quads", "tiles"):
            settings = sg.Settings(kernel=mitchell, technique=technique, blend="xray", tolerance=1e-4)
            image = renderer.render(scene, camera, settings, verify_bound=False)
            right = sg.reference.render(scene.splats(settings)[0], camera, settings).pixels
            assert image.info["kernel"] == mitchell and right.min() < 0 < right.max()
            assert np.abs(image.pixels - right).max() <= image.info["error_bound"] < 0.01 * right.max()


def test_a_sum_over_the_plane_is_the_volume(renderer: sg.Renderer, mitchell: str) -> None:
    """∫∫ τ of one voxel over a parallel view is its extinction, for negative lobes as for others."""
    samples = np.zeros((5, 5, 5))
    samples[2, 2, 2] = 1
    transfer = sg.Transfer([(0, 0), (1, 0.5)])
    splats = sg.extract(sg.Volume(samples), transfer, classification="pre")
    camera = sg.Camera.orthographic((2, -20, 2), (2, 2, 2), (0, 0, 1), height=6, size=(96, 96))
    for name in (mitchell, "b-spline"):
        image = renderer.render(splats, camera, sg.Settings(kernel=name, blend="xray", antialias="off"))
        assert image.pixels[..., 3].sum() * (6 / 96) ** 2 == pytest.approx(np.log(2), rel=1e-4)


@pytest.mark.parametrize(
    ("settings", "told"),
    [
        ({"blend": "composite"}, "expected blend xray .* got blend composite; b-spline"),
        ({"blend": "mip", "classification": "pre"}, "got blend mip"),
        ({"blend": "xray", "classification": "post"}, "got blend xray, classified after"),
    ],
)
def test_a_negative_kernel_draws_no_opacities(mitchell: str, settings: Any, told: str) -> None:
    volume = sg.Volume(np.random.default_rng(2).random((5, 5, 5)))
    scene, chosen = sg.Scene([volume]), sg.Settings(kernel=mitchell, **settings)
    with pytest.raises(sg.InputError, match=told):
        sg.plan(scene.splats(chosen)[0], sg.Camera.orbit(volume, size=(8, 8)), chosen)


def test_a_negative_kernel_around_the_eye_is_refused(mitchell: str) -> None:
    volume = sg.Volume(np.random.default_rng(2).random((5, 5, 5)))
    settings = sg.Settings(kernel=mitchell, blend="xray")
    camera = sg.Camera.look_at((2, 2, 2), (2, 9, 2), (0, 0, 1), size=(8, 8))
    with pytest.raises(sg.InputError, match="an eye outside of all kernels, got one inside"):
        sg.plan(sg.Scene([volume]).splats(settings)[0], camera, settings)


# --- kernels of modules ----------------------------------------------------------------------------------------------

MODULE = """
from splatgl import PiecewiseCubic
smooth = PiecewiseCubic.of_family("smooth-family", 1.0, 0.0)
number = 3
"""


@pytest.fixture
def module(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """The name of a module in the current folder."""
    (tmp_path / "kernels_of_mine.py").write_text(MODULE)
    monkeypatch.chdir(tmp_path)
    yield "kernels_of_mine"
    KERNELS.pop("smooth-family", None)
    sys.modules.pop("kernels_of_mine", None)


def test_the_option_imports_a_kernel(module: str, capsys: pytest.CaptureFixture[str]) -> None:
    np.save("a.npy", np.random.default_rng(3).random((6, 6, 6)))
    paths = [*sys.path]
    line = ["render", "a.npy", "-o", "a.png", "--size", "32", "--quiet", "--classification", "pre", "--kernel"]
    assert main([*line, f"{module}:smooth"]) == 0 and sys.path == paths
    # twice in a process is once
    assert main([*line, f"{module}:smooth"]) == 0
    with Pillow.open("a.png") as picture:
        assert "smooth-family" in str(picture.info)
    # workers have not registered it
    for more in (["render", "a.npy"], ["render", "a.npy", "a.npy"], ["animate", "a.npy", "-o", "a.gif"]):
        files = ["-o", "{name}.png"] if more.count("a.npy") > 1 else []
        assert main([*more, *files, "--workers", "1", "--quiet", "--kernel", f"{module}:smooth"]) == 2
        assert "--kernel: expected a built-in one, with --workers" in capsys.readouterr().err
    assert main(["report", "--list", "--kernel", f"{module}:smooth"]) == 0
    assert "post smooth-family 2×2" in capsys.readouterr().out
    for axis in ("kernel smooth-family", "post smooth-family"):
        del AXES[axis]


def test_figures_import_a_kernel(module: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert draw_figure(["explain", "10,5,600", "--kernel", f"{module}:smooth"]) == 0
    assert "kernel smooth-family, radius" in capsys.readouterr().out
    picture = ["5", "letter-f", "-o", "a.png", "--size", "8"]
    assert draw_figure([*picture, "--kernel", f"{module}:smooth"]) == 0
    assert "kernel smooth-family" in " ".join(capsys.readouterr().out.split())


@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("nowhere:smooth", "got ModuleNotFoundError: No module named 'nowhere'"),
        ("kernels_of_mine:rough", "has no attribute 'rough'"),
        ("kernels_of_mine:number", "a kernel such as PiecewiseCubic, got int"),
        ("rough", "expected NAME|MODULE:NAME, auto or crawfis-max"),
    ],
)
def test_a_kernel_that_cannot_be_imported_is_told(
    module: str, name: str, told: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as stop:
        main(["render", "tunnel", "--kernel", name])
    said = capsys.readouterr().err
    assert stop.value.code == 2 and told in said and said.count("\n") == 1


def test_no_file_imports_a_kernel(module: str, capsys: pytest.CaptureFixture[str]) -> None:
    Path("scene.toml").write_text(f'volume = "tunnel"\n[settings]\nkernel = "{module}:smooth"\n')
    assert main(["render", "scene.toml", "-o", "a.png"]) == 2
    assert "kernel: expected auto or" in capsys.readouterr().err and module not in sys.modules
    with pytest.raises(sg.InputError, match="kernel: expected auto or"):
        sg.Settings(kernel=f"{module}:smooth")
    assert module not in sys.modules
