"""The paper's figures: their numbers against stored and closed ones, their geometry, and that each can be read."""

from __future__ import annotations

import io
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from paper.__main__ import main
from paper.figures import FIGURES, footprint_errors, geometry, motion_blur
from paper.figures.footprint_errors import ALL, DEPTHS, OFFSETS, SURFACE_ROWS, Plane, Space, Surfaces, maximum
from paper.figures.forms_table import forms_table
from paper.figures.paper_setup import PAPER, Setting

from splatgl.errors import InputError
from splatgl.report.diagram import PRINT_RESOLUTION, style
from splatgl.splat.footprint import ROWS, Splat
from splatgl.splat.kernels import Gaussian, register_kernel
from tests.paper.helpers import refused

STORED = json.loads((Path(__file__).parent / "fig10.json").read_text())


@pytest.fixture(scope="module")
def fig10() -> Surfaces:
    return footprint_errors.surfaces()


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_maximum_closes_in_on_the_largest_of_several_hills() -> None:
    peaks = np.array([[0.123456, -0.7], [-0.98765, 0.4]])

    def hills(place: np.ndarray) -> np.ndarray:
        far = [((place - p[:, None]) ** 2).sum(axis=-1) for p in (peaks, -0.5 * peaks)]
        return np.maximum(1 - far[0], 0.999 - 50 * far[1])

    found = maximum(hills, 2, 2, 41)
    assert found.value == pytest.approx(1.0, abs=1e-10)
    assert found.place == pytest.approx(peaks, abs=1e-5)


def test_figure_10_is_on_the_stored_grid() -> None:
    assert tuple(STORED["y"]) == OFFSETS and tuple(STORED["dz"]) == DEPTHS
    assert STORED["z_k"] == pytest.approx(PAPER.z_k, abs=1e-9)


@pytest.mark.parametrize("row", ["row5", "row3", "row2", "tmax"])
def test_figure_10_has_the_stored_errors(row: str, fig10: Surfaces) -> None:
    found = fig10.top if row == "tmax" else fig10.errors[row]
    assert np.abs(found - np.array(STORED[row])).max() < 1e-6


def test_figure_10_row_4_has_the_stored_errors_but_for_spikes(fig10: Surfaces) -> None:
    """Three of the 190 stored maxima were met by chance within the spike that the cut leaves at the rim."""
    stored, found = np.array(STORED["row4"]), fig10.errors["row4"]
    wrong = np.argwhere(np.abs(stored - found) >= 1e-6)
    assert len(wrong) == 3
    for i, j in wrong:
        plane = Plane(PAPER.kernel, PAPER.z_k, np.array([OFFSETS[j]]), np.array([PAPER.z_k + DEPTHS[i]]))
        spike = float(plane.spike(ALL["row4"])[0]) / PAPER.kernel.scale
        assert found[i, j] < stored[i, j] <= spike


def test_errors_of_figure_9() -> None:
    """The voxels of Fig. 9, rows 5 and 4."""
    right = [(0.2225, 0.0006), (27.11, 0.149), (7.812, 7.808)]
    for voxel, pair in zip(footprint_errors.VOXELS, right, strict=True):
        for row, level, digit in zip(("row5", "row4"), pair, (5e-3, 5e-4), strict=True):
            swept = voxel.levels(row, np.linspace(-0.96, 0.96, 1001)).max()
            assert float(voxel.plane.levels(ALL[row])[0]) == pytest.approx(level, abs=digit)
            assert float(swept) == pytest.approx(level, abs=max(digit, 2e-3 * level))


@pytest.mark.parametrize(
    ("k", "levels", "ripple"), [(2.0, 27.11, 0.043), (1.38**2, 27.12, 0.033), (1.38, 27.18, 0.006)]
)
def test_readings_of_the_papers_gaussian_fit_its_figure_9(k: float, levels: float, ripple: float) -> None:
    """Errors at z_k and at the back do not tell k; the largest deviation of a lattice's sum from 1 does."""
    shape = Gaussian(k)
    planes = [Plane(shape, PAPER.z_k, np.array([v.y]), np.array([v.z])) for v in footprint_errors.VOXELS[1:]]
    near, far = (float(plane.levels(ALL["row5"])[0]) for plane in planes)
    assert near == pytest.approx(levels, abs=5e-3) and far == pytest.approx(7.813, abs=2e-3)
    cell = np.stack(np.meshgrid(*[np.arange(8) / 8] * 3, indexing="ij"), axis=-1)[..., None, :]
    lattice = np.stack(np.meshgrid(*[np.arange(-2, 4)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    total = shape.value(np.linalg.norm(cell - lattice, axis=-1)).sum(axis=-1)
    assert np.abs(total - 1).max() == pytest.approx(ripple, abs=6e-4)


def test_a_gaussian_with_a_visible_rim_is_refused() -> None:
    with pytest.raises(InputError, match=r"kernel gaussian-flat: expected a step of at most 0\.001"):
        register_kernel(Gaussian(1.38, name="gaussian-flat"))


def test_space_and_plane_find_the_same_before_z_k() -> None:
    """Before z_k nothing is stretched; the worst ray of row 5 lies in the voxel's plane."""
    plane = Plane(PAPER.kernel, PAPER.z_k, np.array([120.0]), np.array([400.0]))
    space = Space(PAPER.kernel, PAPER.z_k, np.array([[0.0, 120.0, 400.0]]))
    turned = Space(PAPER.kernel, PAPER.z_k, np.array([[72.0, -96.0, 400.0]]))
    expected = float(plane.levels(ALL["row5"])[0])
    assert float(space.levels(ALL["row5"])[0]) == pytest.approx(expected, abs=1e-6)
    assert float(turned.levels(ALL["row5"])[0]) == pytest.approx(expected, abs=1e-6)


def test_rays_are_one_voxel_apart_at_z_k() -> None:
    scene = geometry.example_resampling()
    before, at, beyond = (scene.pitch(depth) for depth in scene.marked)
    assert before < 1 < beyond and at == pytest.approx(1)
    # the samples at z_k are voxels
    there = scene.samples[np.isclose(scene.samples[:, 0], scene.z_k), 1]
    assert len(there) == 8 and np.abs(there[:, None] - scene.rows).min(axis=1).max() < 1e-12
    assert all(row[2] == pytest.approx(row[3]) for row in geometry.triangles_table().rows)


def test_footprints_beyond_z_k_are_lost_without_the_stretch() -> None:
    for depth in geometry.DEPTHS:
        as_it_is, stretched = (geometry.footprint_pixels(depth, s) for s in (False, True))
        assert stretched.max() > 0
        if depth <= 0.5:
            assert (as_it_is == stretched).all()
        if depth > 2:
            assert not as_it_is.any()
            assert float(stretched.max()) < depth**-2


def test_trapezoid_has_rays_for_sides_and_is_off_by_r_squared_over_z_k() -> None:
    voxel = geometry.far_voxel()
    (near, low), (_, high), (far, top), (_, bottom), _ = voxel.outline()
    assert high / near == pytest.approx(top / far) == pytest.approx(-low / near) == pytest.approx(-bottom / far)
    assert voxel.box_for_trapezoid()[0] == pytest.approx(voxel.kernel.radius**2 / voxel.z_k)
    trapezoid, box = (voxel.value(row, np.array(1.2), np.array(voxel.z)) for row in ("row1", "row2"))
    assert trapezoid == box


@pytest.mark.parametrize("row", ["row1", "row2", "row4", "row5"])
def test_drawn_kernels_integrate_to_their_rows(row: str) -> None:
    """Figs. 8 and 9: row 5's over depth, the others' over the ray's length; row 1's weakened by (z_k/z)² within."""
    voxel = geometry.oblique_voxel()
    slope = (voxel.y + np.array([-2.0, -0.7, 0.0, 1.3]))[:, None] / voxel.z
    depth = voxel.z + np.linspace(-4, 4, 8001)
    weight = (voxel.z_k / depth) ** 2 if row == "row1" else np.full_like(depth, voxel.m**-2.0)
    measure = np.ones_like(slope) if row == "row5" else np.sqrt(1 + slope**2)
    peak = voxel.kernel.value(np.zeros(()))
    found = (measure * weight * voxel.value(row, slope * depth, depth) * peak).sum(axis=1) * (depth[1] - depth[0])
    splat = Splat(voxel.kernel, np.array([0.0, voxel.y, voxel.z]), np.hstack([0 * slope, slope]), voxel.z_k)
    assert found == pytest.approx(ROWS[row](splat), rel=2e-3)


def test_quads_lie_across_their_rays() -> None:
    voxel = geometry.oblique_voxel()
    for row, across in (("row5", (1.0, 0.0)), ("row4", (voxel.z, voxel.y))):
        quad = voxel.quad(row)
        assert (quad - (voxel.z, voxel.y)) @ across == pytest.approx(0, abs=1e-12)
        assert np.linalg.norm(quad[-1] - quad[0]) == pytest.approx(2 * voxel.m * voxel.kernel.radius)


@pytest.fixture
def light(monkeypatch: pytest.MonkeyPatch) -> None:
    """Fig. 10 over few voxels and Fig. 11's table of few lengths, as they take seconds whole."""
    few = footprint_errors.surfaces((-102.4, -1e-6, 0.0, 105.0, 409.6), (0.0, 128.0, 256.0))
    monkeypatch.setattr(footprint_errors, "surfaces", lambda *_: few)
    monkeypatch.setattr(motion_blur, "LENGTHS", motion_blur.LENGTHS[:2])


@pytest.mark.few(3)
@pytest.mark.usefixtures("light")
@pytest.mark.parametrize("number", FIGURES)
def test_pictures_can_be_read(number: int) -> None:
    """No two labels overlap, and none leaves the page; some ink is on it."""
    pytest.importorskip("matplotlib", reason="draws figures; it is in the extra plots")
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    with style():
        figure = FIGURES[number].draw()
        canvas = FigureCanvasAgg(figure)
        canvas.draw()
        page = figure.bbox
        shown = drawn_texts(figure)
        boxes = [t.get_window_extent(canvas.get_renderer()) for t in shown]
        ink = np.asarray(canvas.buffer_rgba())[..., :3]
    assert len(shown) >= 6 and (ink < 128).any(axis=-1).mean() > 0.005
    for i, (text, box) in enumerate(zip(shown, boxes, strict=True)):
        assert page.x0 <= box.x0 and box.x1 <= page.x1 and page.y0 <= box.y0 and box.y1 <= page.y1, text
        for other, there in zip(shown[:i], boxes[:i], strict=True):
            assert not box.padded(-1).overlaps(there.padded(-1)), (text, other)


@pytest.mark.usefixtures("light")
def test_figure_10c_is_row_5_minus_row_4_over_depth() -> None:
    pytest.importorskip("matplotlib", reason="draws figures; it is in the extra plots")
    grid = footprint_errors.surfaces()
    with style():
        curves = footprint_errors.error_surfaces().axes[-1].lines
    for curve, y in zip(curves, (256.0, 128.0), strict=False):
        column = list(grid.y).index(y)
        extra = (grid.errors["row5"] - grid.errors["row4"])[:, column]
        assert curve.get_xydata() == pytest.approx(np.column_stack([grid.dz, extra]))
    assert [line.get_xdata()[0] for line in curves[-2:]] == [0, 70]


def drawn_texts(figure: Any) -> list[Any]:
    """Every text that is on the page: not those of axes that are off, nor of ticks beyond an axis' ends."""
    found = list(figure.texts)
    for legend in [*figure.legends, *filter(None, (axes.get_legend() for axes in figure.axes))]:
        found += legend.get_texts()
    for axes in figure.axes:
        found += axes.texts
        if not axes.axison:
            continue
        found += [axes.title, axes._left_title, axes._right_title]
        for axis in axes._axis_map.values():
            low, high = sorted(axis.get_view_interval())
            found.append(axis.label)
            found += [tick.label1 for tick in axis.get_major_ticks() if low <= tick.get_loc() <= high]
    return [text for text in found if text.get_visible() and text.get_text().strip()]


@pytest.mark.few(1)
@pytest.mark.usefixtures("light")
@pytest.mark.parametrize("number", FIGURES)
def test_pictures_are_written(number: int, here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("matplotlib", reason="draws figures; it is in the extra plots")
    from PIL import Image

    assert main([str(number)]) == 0
    assert main([str(number), "-o", "a.svg", "--numbers"]) == 0
    said = capsys.readouterr().out
    assert f"Figure {number}. " in said and sum(character.isdigit() for character in said) > 30
    with Image.open(io.BytesIO((here / f"figure{number}.png").read_bytes())) as picture:
        assert picture.width == 3.5 * PRINT_RESOLUTION
        assert picture.info["Description"] == FIGURES[number].caption
    svg = (here / "a.svg").read_text()
    assert svg.startswith("<?xml") and len(svg) > 4000


def test_the_same_figure_is_the_same_bytes(here: Path) -> None:
    pytest.importorskip("matplotlib", reason="draws figures; it is in the extra plots")
    for suffix in (".png", ".svg"):
        assert FIGURES[3].picture(suffix) == FIGURES[3].picture(suffix)


def test_the_table_of_figure_10_holds_its_surfaces(fig10: Surfaces) -> None:
    table = np.array(FIGURES[10].table().rows)
    assert table.shape == (190, 7)
    assert (table[:, 2:6].T.reshape(4, 19, 10) == [fig10.errors[row] for row in SURFACE_ROWS]).all()


def test_text_needs_no_matplotlib(
    here: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    assert main(["4", "--numbers"]) == 0
    assert "z_v/z_k" in capsys.readouterr().out
    assert main(["4"]) == 2
    assert "pip install 'splatgl[plots]'" in capsys.readouterr().err
    assert list(here.iterdir()) == []


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["15"], "figure: expected one of 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, or claims or table1, got 15"),
        (["-3"], "scripts/figure"),
        (["ten"], "figure: expected one of"),
        (["3", "-o", "a.jpg"], "a.jpg: expected a name that ends in .png or .svg"),
        (["3", "-o", "/dev/null/a.png"], "/dev/null/a.png: expected a folder, got the file /dev/null"),
        (["3", "-o", ""], "expected a name"),
        (["3", "-o", "."], ".: expected a name that ends in .png or .svg"),
        (["claims", "-o", "a.png"], "figure claims: expected no file to write"),
    ],
)
def test_bad_input_is_one_line(
    arguments: list[str], message: str, here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    refused(arguments, message, here, capsys)


def test_setting_is_the_papers() -> None:
    assert (PAPER.front, PAPER.back) == pytest.approx((341.005, 853.005), abs=1e-3)
    assert PAPER.z_k == pytest.approx(443.405006737633, abs=1e-9)
    assert Setting(256).z_k == pytest.approx(PAPER.z_k / 2)


def test_the_table_of_rows_holds_form_bprime_to_a_thousandth_of_a_level(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["table1", "-o", str(tmp_path / "table1.svg")]) == 0
    assert b"Four approximations of Table 1" in (tmp_path / "table1.svg").read_bytes()
    printed = capsys.readouterr().out
    assert forms_table().text() in printed and "form b′" in printed.splitlines()[5]
    found = {row[:2]: dict(zip(("2", "3", "4", "5", "b"), row[2:], strict=True)) for row in forms_table().rows}
    assert max(row["b"] for row in found.values()) < 1e-3
    assert found["edge", "+1"]["5"] == pytest.approx(27.1, abs=0.1)
    assert found["edge", "+410"]["4"] == pytest.approx(7.81, abs=0.01)
    assert found["corner", "+200"]["4"] == pytest.approx(16.64, abs=0.01)
    assert all(row["b"] == row["2"] == 0 for (_, behind), row in found.items() if behind == "-50")
