"""Attenuation by fill: runs of cells, its limits, and its distance from supersampling against the other forms."""

from __future__ import annotations

import math

import numpy as np
import pytest

import splatgl as sg
from splatgl.splat.footprint import fill_depth
from splatgl.splat.kernels import kernel
from splatgl.splat.splats import OCTAVES
from tests.helpers.splatting import SPLATS

FORMS = ("opacity", "optical-depth", "fill")


def matter(cells: np.ndarray, opacity: float = 0.99) -> sg.Splats:
    transfer = sg.Transfer([(0.5, 0), (0.5, opacity)], shading=False, unit=1.0, colormap="white")
    return sg.extract(sg.Volume(cells.astype(np.uint8)), transfer, classification="pre")


def lengths(splats: sg.Splats) -> np.ndarray:
    """Run lengths [N, 3] along x, y, z, as the code rounds them."""
    codes = np.stack([splats.runs & 31, (splats.runs >> 5) & 31, (splats.runs >> 10) & 31], axis=1)
    return 2.0 ** (codes * OCTAVES)


def test_runs_of_random_cells() -> None:
    """Every run against a walk over the cells, within the code's 12 %."""
    cells = np.random.default_rng(9).random((7, 8, 9)) < 0.6
    splats = matter(cells)
    found = lengths(splats)
    for (x, y, z), run in zip(splats.positions.astype(int), found, strict=True):
        for axis, (line, at) in enumerate(((cells[z, y, :], x), (cells[z, :, x], y), (cells[:, y, x], z))):
            start = stop = at
            while start > 0 and line[start - 1]:
                start -= 1
            while stop + 1 < len(line) and line[stop + 1]:
                stop += 1
            assert run[axis] == pytest.approx(stop - start + 1, rel=0.13)


@pytest.mark.parametrize(("shape", "axis"), [((1, 1, 300), 0), ((1, 300, 1), 1), ((300, 1, 1), 2)])
def test_runs_of_a_thread(shape: tuple[int, int, int], axis: int) -> None:
    run = lengths(matter(np.ones(shape)))
    assert run[:, axis] == pytest.approx(300, rel=0.13)
    assert (np.delete(run, axis, axis=1) == 1).all()


def depth_of(run: tuple[float, float, float], depth: float, m: float) -> float:
    """What is drawn for depth, looking along z at cubes 1/m of a pixel wide."""
    codes = np.rint(np.log2(run) / OCTAVES).astype(np.int16)
    packed = np.array([codes[0] + 32 * codes[1] + 1024 * codes[2]], np.int16)
    along = np.array([[0.0], [0.0], [1.0]])
    return float(fill_depth(np.array([depth]), along, np.ones(3), np.array([m]), np.array([m**-2.0]), packed)[0])


def test_limits() -> None:
    # matter that fills its pixel keeps its optical depth
    assert depth_of((900, 900, 1), 2.0, 8.0) == pytest.approx(2.0, rel=1e-3)
    # a dot keeps what it hides: ∫ (1 − e^(−τF))
    h = kernel("crawfis-max")
    d = np.linspace(0, h.radius, 4001)
    middle = (d[1:] + d[:-1]) / 2
    hidden = float((2 * np.pi * middle * (d[1] - d[0]) * -np.expm1(-4.6 * h.footprint(middle))).sum())
    assert depth_of((1, 1, 1), 4.6, 1000.0) == pytest.approx(hidden, rel=0.07)
    # thin matter is the same by any form
    assert depth_of((1, 1, 1), 1e-6, 16.0) == pytest.approx(1e-6, rel=1e-3)
    # nothing happens at m = 1, and little just beyond it
    assert depth_of((1, 1, 1), 4.6, 1.0) == 4.6
    assert depth_of((1, 1, 1), 4.6, 1.0001) == pytest.approx(4.6, rel=1e-3)
    # a deep column is opaque, not more
    assert depth_of((900, 900, 900), 4.6, 8.0) * 2 ** (round(math.log2(900) / OCTAVES) * OCTAVES) < 7


def test_what_a_dot_hides_is_near_at_any_depth() -> None:
    """∫ (1 − e^(−τF)) of one voxel within 7 %: the rim is that of a saturating exponential."""
    h = kernel("crawfis-max")
    d = np.linspace(0, h.radius, 4001)
    middle = (d[1:] + d[:-1]) / 2
    apart = []
    for depth in np.linspace(0.5, 16, 32):
        hidden = float((2 * np.pi * middle * (d[1] - d[0]) * -np.expm1(-depth * h.footprint(middle))).sum())
        apart.append(depth_of((1, 1, 1), float(depth), 1e4) / hidden - 1)
    # another rim would be off by less on one side, and by more on the other
    assert -0.07 < min(apart) < -0.05 and 0.02 < max(apart) < 0.035


@pytest.mark.parametrize("kind", ["quads", "tiles"])
def test_a_deep_dot_is_the_same_on_the_gpu(renderer: sg.Renderer, kind: str) -> None:
    """Alone in its pixels, where the rim counts most."""
    for depth in (3.0, 8.0, 16.0):
        dot = sg.Splats.from_points([[0.0, 0, 0]], [[1.0, 1, 1]], [depth])
        camera = sg.Camera.look_at((0, 0, -100), (0.01, 0.02, 0), (0, 1, 0), 12, (9, 9))
        settings = SPLATS.replace(technique=kind, occlusion="off")
        assert sg.plan(dot, camera, settings, tiles=True).program.appearance.attenuation == "fill"
        right = sg.reference.render(dot, camera, settings).pixels
        assert np.abs(renderer.render(dot, camera, settings).pixels - right).max() < 3e-4 * right.max()


def wall() -> np.ndarray:
    return np.ones((1, 96, 96))


def edge() -> np.ndarray:
    cells = np.zeros((40, 96, 96))
    cells[:, :, :49] = 1
    return cells


def dots() -> np.ndarray:
    return np.random.default_rng(5).random((24, 96, 96)) < 0.002


def threads() -> np.ndarray:
    cells = np.zeros((24, 96, 96))
    for n in range(4, 96, 11):
        cells[n % 24, n] = cells[(5 * n) % 24, :, n] = 1
    return cells


@pytest.mark.few(2)
@pytest.mark.parametrize("make", [wall, edge, dots, threads])
@pytest.mark.parametrize("m", [2.0, 4.0, 8.0])
def test_nearest_to_supersampling(make, m: float, renderer: sg.Renderer) -> None:  # type: ignore[no-untyped-def]
    """No farther from the supersampled picture than the better of the two other forms (within 1 %)."""
    splats = matter(make())
    middle = splats.corners.mean(axis=0)
    size = round(2 * math.tan(math.radians(13)) * 200 / m)
    camera = sg.Camera.look_at(middle + np.array([15.0, -30, -197]), middle, (0, -1, 0), 26, (size, size))
    samples = math.ceil(float(camera.pixel_pitch(camera.eye_from_points(splats.corners)[:, 2].max())))
    right = renderer.render(splats, camera, SPLATS.replace(antialias="supersample", samples=samples)).pixels
    rmse = {}
    for form in FORMS:
        drawn = renderer.render(splats, camera, SPLATS.replace(attenuation=form)).pixels
        rmse[form] = float(np.sqrt(((drawn - right) ** 2).mean()))
    assert rmse["fill"] <= 1.01 * min(rmse["opacity"], rmse["optical-depth"])
    if make is not wall:
        assert rmse["fill"] < 0.9 * max(rmse["opacity"], rmse["optical-depth"])


def test_nothing_changes_before_z_k(renderer: sg.Renderer) -> None:
    splats = matter(dots())
    camera = sg.Camera.orbit(splats, 30, 20, size=(300, 300))
    assert not sg.plan(splats, camera, SPLATS).program.seen.antialias
    drawn = [renderer.render(splats, camera, SPLATS.replace(attenuation=form)).pixels for form in FORMS]
    assert (drawn[0] == drawn[1]).all()
    assert (drawn[0] == drawn[2]).all()


def test_fill_is_what_auto_means() -> None:
    splats = matter(dots())
    far = sg.Camera.orbit(splats, size=(20, 20))
    assert sg.plan(splats, far, SPLATS).program.appearance.attenuation == "fill"
    assert sg.plan(splats, far, SPLATS.replace(blend="xray")).program.appearance.attenuation == "optical-depth"
