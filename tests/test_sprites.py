"""Sprites are quads by other means; closed pixels hide no more than they may; nothing lies outside the window."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import splatgl as sg
from splatgl.splat.occlusion import cuts
from splatgl.splat.sprites import Window

GRIDS = {
    "cubes": {},
    "turned": {"direction": np.array([[0.8, -0.6, 0], [0.6, 0.8, 0], [0, 0, 1.0]])},
    "1:2:5": {"spacing": (1.0, 2.0, 5.0)},
    "sheared": {"direction": np.array([[1, 0.4, 0.2], [0, 1, 0.3], [0, 0, 1.4]])},
}


def noise(grid: str = "cubes", size: int = 12, opacity: float = 0.4, seed: int = 3) -> sg.Splats:
    cells = np.random.default_rng(seed).random((size, size, size))
    return sg.extract(sg.Volume(cells, **GRIDS[grid]), sg.Transfer([(0.3, 0), (1, opacity)], colormap="hot"))


def views(splats: sg.Splats) -> dict[str, sg.Camera]:
    """Far beyond z_k, near, so near that many centres lie beyond the edges, and parallel."""
    out = sg.Camera.orbit(splats, 30, 20, size=(48, 36))
    middle = splats.corners.mean(axis=0)
    span = float(np.linalg.norm(np.ptp(splats.corners, axis=0)))
    close = sg.Camera.look_at(middle - out.forward * span * 0.9, middle + span * 0.2, (0, 0, 1), 30, (40, 60))
    return {
        "far": sg.Camera.orbit(splats, 30, 20, size=(9, 7)),
        "fitted": out,
        "close": close,
        "wide": sg.Camera.look_at(middle - out.forward * span * 0.8, middle, (0, 0, 1), 110, (50, 40)),
        "parallel": out.parallel(splats),
        "parallel, close": out.parallel(splats, height=span * 0.3),
        "parallel, far": out.resized((6, 5)).parallel(splats),
    }


@pytest.mark.parametrize("blend", ["composite", "xray", "mip"])
@pytest.mark.parametrize("view", views(noise()))
@pytest.mark.parametrize("grid", GRIDS)
def test_sprites_draw_what_quads_draw(renderer: sg.Renderer, grid: str, view: str, blend: str) -> None:
    splats = noise(grid)
    camera = views(splats)[view]
    for kernel in ("crawfis-max", "gaussian"):
        settings = sg.Settings(blend=blend, kernel=kernel, occlusion="off")
        assert renderer.plan(splats, camera, settings).program.primitive == "sprite"
        sprites = renderer.render(splats, camera, settings).pixels
        quads = renderer.render(splats, camera, settings.but(primitive="quad")).pixels
        assert quads.max() > 0.05
        assert np.abs(sprites - quads).max() < 1e-4 * max(quads.max(), 1.0)


@pytest.mark.parametrize("attenuation", ["opacity", "optical-depth", "fill"])
def test_attenuation_is_the_same(renderer: sg.Renderer, attenuation: str) -> None:
    splats = noise("1:2:5")
    camera = views(splats)["far"]
    settings = sg.Settings(attenuation=attenuation)
    sprites = renderer.render(splats, camera, settings).pixels
    assert np.abs(sprites - renderer.render(splats, camera, settings.but(primitive="quad")).pixels).max() < 2e-5


@pytest.mark.parametrize("view", views(noise()))
@pytest.mark.parametrize("grid", GRIDS)
def test_no_splat_reaches_beyond_the_window(renderer: sg.Renderer, grid: str, view: str) -> None:
    splats = noise(grid, opacity=1.0)
    few = sg.Splats.from_points(np.array([[0.0, 0, 0], [3, 2, 1]]), np.ones((2, 3)), np.ones(2))
    for subject in (splats, few):
        camera = views(splats)[view]
        chosen = sg.plan(subject, camera)
        whole = replace(chosen, window=Window(0, 0, *camera.size))
        assert (renderer.passes.draw(subject, camera, chosen) == renderer.passes.draw(subject, camera, whole)).all()


def test_a_small_thing_has_a_small_window() -> None:
    one = sg.Splats.from_points(np.zeros((1, 3)), np.ones((1, 3)), np.ones(1))
    camera = sg.Camera.look_at((0, -50.0, 0), (5, 0, 3.0), (0, 0, 1), 60, (200, 100))
    window = sg.plan(one, camera).window
    assert 0 < window.width < 24 and 0 < window.height < 24


def test_quads_where_sprites_cannot_be(renderer: sg.Renderer) -> None:
    splats = noise()
    inside = sg.Camera.look_at((5.0, 5, 5), (5, 9, 5), (0, 0, 1), 60, (16, 16))
    assert renderer.plan(splats, inside).program.primitive == "quad"
    fitted = views(splats)["fitted"]
    for settings in (sg.Settings(align="ray"), sg.Settings(footprint="table"), sg.Settings.paper()):
        assert renderer.plan(splats, fitted, settings).program.primitive == "quad"
    # larger than OpenGL's points
    assert sg.plan(splats, fitted, sprite_limit=3.0).program.primitive == "quad"
    with pytest.raises(sg.InputError, match=r"^primitive sprite: expected footprints by distance"):
        renderer.render(splats, inside, sg.Settings(primitive="sprite"))


@pytest.fixture(scope="module")
def solid() -> sg.Splats:
    """A ball that hides most of itself."""
    z, y, x = np.mgrid[-18:19, -18:19, -18:19]
    cells = np.clip(17.5 - np.sqrt(x * x + y * y + z * z), 0, 1) + 0.2 * np.random.default_rng(2).random(x.shape)
    return sg.extract(sg.Volume(cells), sg.Transfer([(0.25, 0), (1, 0.9)], colormap="hot", shading=False))


@pytest.mark.parametrize("tolerance", [1 / 255, 1e-2, 1e-5])
def test_closed_pixels_hide_less_than_the_tolerance(renderer: sg.Renderer, solid: sg.Splats, tolerance: float) -> None:
    camera = sg.Camera.orbit(solid, 20, 30, size=(120, 120))
    settings = sg.Settings(tolerance=tolerance)
    chosen = renderer.plan(solid, camera, settings)
    assert chosen.parts > 1 and chosen.program.order == "front-to-back"
    closed = renderer.render(solid, camera, settings).pixels
    opened = renderer.render(solid, camera, settings.but(occlusion="off", order="front-to-back")).pixels
    error = float(np.abs(closed - opened).max())
    assert 0.05 * chosen.passing < error <= chosen.passing + 2e-6
    assert chosen.passing < tolerance
    # and it is at the closing that they differ: pixels that let more through are the same, bit for bit
    open_ = opened[..., 3] < 1 - 2 * chosen.passing
    assert (closed[open_] == opened[open_]).all() and open_.any()


@pytest.mark.parametrize("antialias", ["paper", "supersample"])
@pytest.mark.parametrize("view", ["all", "parallel", "close", "far"])
@pytest.mark.parametrize("grid", GRIDS)
def test_hidden_splats_are_hidden(renderer: sg.Renderer, grid: str, view: str, antialias: str) -> None:
    """On every grid and from everywhere; where nothing is closed, nothing changes."""
    z, y, x = np.mgrid[-18:19, -18:19, -18:19]
    cells = np.clip(17.5 - np.sqrt(x * x + y * y + z * z), 0, 1) + 0.2 * np.random.default_rng(2).random(x.shape)
    splats = sg.extract(sg.Volume(cells, **GRIDS[grid]), sg.Transfer([(0.25, 0), (1, 0.95)], shading=False))
    camera = sg.Camera.orbit(splats, 20, 30, size=(110, 90))
    middle = splats.corners.mean(axis=0)
    back = camera.forward * float(np.linalg.norm(np.ptp(splats.corners, axis=0))) * 0.62
    camera = {
        "all": camera,
        "parallel": camera.parallel(splats),
        "close": sg.Camera.look_at(middle - back, middle, (0, 0, 1), 30, (110, 90)),
        "far": camera.resized((37, 29)),
    }[view]
    settings = sg.Settings(antialias=antialias, samples=3)
    chosen = renderer.plan(splats, camera, settings)
    if grid in ("cubes", "turned") and view != "close":
        assert chosen.program.hiding
    closed = renderer.render(splats, camera, settings).pixels
    opened = renderer.render(splats, camera, settings.but(occlusion="off", order="front-to-back")).pixels
    assert np.abs(closed - opened).max() <= chosen.passing + 3e-6


def test_bright_colours_are_hidden_later(solid: sg.Splats) -> None:
    records = solid.records.copy()
    records["color"] *= 10
    bright = replace(solid, records=records)
    camera = sg.Camera.orbit(solid, 20, 30, size=(120, 120))
    assert sg.plan(bright, camera).passing == pytest.approx(sg.plan(solid, camera).passing / bright.brightest)


def test_nothing_is_closed_where_all_is_seen(solid: sg.Splats) -> None:
    camera = sg.Camera.orbit(solid, 20, 30, size=(120, 120))
    for settings in (
        sg.Settings(blend="xray"),
        sg.Settings(blend="mip"),
        sg.Settings(order="back-to-front"),
        sg.Settings(occlusion="off"),
        sg.Settings(primitive="quad"),
    ):
        assert sg.plan(solid, camera, settings).parts == 1
    assert sg.plan(noise(), camera).parts == 1


def test_parts_take_every_splat_once() -> None:
    for count, number in ((10, 3), (100_001, 17), (5, 48)):
        ends = cuts(count, number)
        assert ends[0] == 0 and ends[-1] == count and len(ends) == number + 1 and ends == sorted(ends)
