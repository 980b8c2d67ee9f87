"""No pixel that a footprint reaches is left out: not by the window that is read back, nor by a splat's tiles."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import splatgl as sg
from splatgl.geometry.view import GridView
from splatgl.planning.culling import PixelWindow
from splatgl.reference.rays import pixel_boxes
from splatgl.splat.kernels import kernel
from tests.helpers.noise import GRIDS, noise, views
from tests.helpers.splatting import SPLATS

# a footprint's value from which on a pixel must have been reached, of its peak: at 0.99 of its reach it is 7e-6
RIM = 1e-6


def single(grid: str, rng: np.random.Generator) -> sg.Splats:
    """One voxel of that grid."""
    cells = np.zeros((3, 3, 3))
    cells[tuple(rng.integers(0, 3, 3))] = 1
    return sg.extract(
        sg.Volume(cells, **GRIDS[grid]), sg.Transfer([(0.5, 0), (1, 0.5)], shading=False), classification="pre"
    )


def slack_of(grid: str, parallel: bool, n: int, fov: float, settings: sg.Settings) -> int:
    """Pixels by which the window of a splat anywhere in the picture is larger than what the reference reaches."""
    rng = np.random.default_rng(n)
    splats = single(grid, rng)
    middle = splats.corners.mean(axis=0)
    # so far off that depth hardly changes over the splat
    towards, across = np.linalg.qr(rng.normal(size=(3, 3)))[0][:2]
    eye = middle - 300 * splats.grid.mean_spacing * towards
    target = middle + rng.uniform(-0.5, 0.5) * fov * splats.grid.mean_spacing * across
    camera = sg.Camera.look_at(eye, target, rng.normal(size=3), fov, (500, 400))
    camera = camera.parallel(splats) if parallel else camera
    window = sg.plan(splats, camera, settings).window
    view = GridView.of(splats.grid, camera, kernel("crawfis-max"), blur=settings.blur_width)
    box = pixel_boxes(view, "row1", view.voxels(splats.positions), camera)
    reached = (int(box.left[0]), int(box.right[0]), int(box.top[0]), int(box.bottom[0]))
    assert window.x <= reached[0] and reached[1] <= window.x + window.width
    assert window.y <= reached[2] and reached[3] <= window.y + window.height
    return min(window.width - (reached[1] - reached[0]), window.height - (reached[3] - reached[2]))


@pytest.mark.parametrize("parallel", [False, True])
@pytest.mark.parametrize("grid", GRIDS)
def test_the_window_holds_all_that_the_reference_reaches(grid: str, parallel: bool) -> None:
    """Of single splats a hundred pixels wide, anywhere in the picture: the window is hardly larger."""
    slack = [slack_of(grid, parallel, n, 1.0, SPLATS) for n in range(20)]
    # rounding's margin and no more, so that any smaller one would cut
    assert min(slack) <= 8


@pytest.mark.parametrize("parallel", [False, True])
@pytest.mark.parametrize("grid", GRIDS)
def test_the_window_holds_splats_of_several_pixels_blur(grid: str, parallel: bool) -> None:
    for n in range(20):
        slack_of(grid, parallel, n, 40.0, SPLATS.replace(blur_width=4.0))


@pytest.mark.parametrize("grid", GRIDS)
def test_a_splat_is_in_every_tile_that_it_reaches(renderer: sg.Renderer, grid: str) -> None:
    """Splats apart from each other, at any place in their tiles: where the reference has light, so has the picture."""
    shape = GRIDS[grid]
    rng = np.random.default_rng(7)
    cells = np.zeros((1, 60, 60))
    cells[0, 2::7, 2::7] = 1
    splats = sg.extract(
        sg.Volume(cells, **shape), sg.Transfer([(0.5, 0), (1, 0.5)], shading=False), classification="pre"
    )
    reached = 0
    for turn in range(4):
        camera = sg.Camera.orbit(splats, 20 + turn, 70, size=(400, 300)).parallel(splats)
        camera = sg.Camera(camera.eye + rng.random(3), camera.eye_from_world, camera.size, camera.extent, False)
        settings = SPLATS.replace(blend="xray", technique="tiles", antialias="off")
        drawn = renderer.render(splats, camera, settings).pixels[..., 3]
        right = sg.reference.render(splats, camera, settings).pixels[..., 3]
        rim = (right > RIM * right.max()) & (right < 1e-4 * right.max())
        reached += int(rim.sum())
        assert (drawn[right > RIM * right.max()] > 0).all()
    assert reached > 1000


@pytest.mark.few(12)
@pytest.mark.parametrize("view", views(noise()))
@pytest.mark.parametrize("grid", GRIDS)
def test_no_splat_reaches_beyond_the_window(renderer: sg.Renderer, grid: str, view: str) -> None:
    splats = noise(grid, opacity=1.0)
    few = sg.Splats.from_points(np.array([[0.0, 0, 0], [3, 2, 1]]), np.ones((2, 3)), np.ones(2))
    for subject in (splats, few):
        camera = views(splats)[view]
        chosen = sg.plan(subject, camera, SPLATS)
        whole = replace(chosen, window=PixelWindow(0, 0, *camera.size))
        assert (renderer.passes.draw(subject, chosen) == renderer.passes.draw(subject, whole)).all()
