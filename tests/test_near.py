"""Seen from within, only the nearest planes are quads: the picture is that of quads, and behind the eye is nothing."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from test_sprites import GRIDS, noise

import splatgl as sg
from splatgl.app.savings import with_it
from splatgl.splat.near import runs
from splatgl.splat.order import order_for
from splatgl.splat.sprites import reach

LOOKS = [(0, 1, 0.1), (0, -1, 0.1), (1, 0.2, 0), (-1, 0.3, 0.1), (0.1, 0.2, 1), (0.2, 0.1, -1), (0.3, 0.9, -0.3)]


def inside(splats: sg.Splats, look: tuple[float, ...], fov: float = 40) -> sg.Camera:
    """An eye near the middle, in no special place."""
    eye = splats.corners.mean(axis=0) + 0.13
    scale = np.ptp(splats.corners, axis=0)
    return sg.Camera.look_at(eye, eye + np.array(look) * scale, (0.1, 0.3, 0.9), fov, (60, 40))


@pytest.mark.parametrize("grid", GRIDS)
@pytest.mark.parametrize("look", LOOKS)
def test_the_picture_is_that_of_quads(renderer: sg.Renderer, grid: str, look: tuple[float, ...]) -> None:
    splats = noise(grid, size=26, opacity=0.3)
    camera = inside(splats, look)
    chosen = renderer.plan(splats, camera)
    # across its thin voxels that volume is near as a whole
    if grid != "1:2:5" or 1 in np.abs(look[1:]):
        assert chosen.program.primitive == "sprite" and chosen.near is not None and chosen.half_line
    for blend in ("composite", "xray", "mip"):
        settings = sg.Settings(blend=blend)
        drawn = renderer.render(splats, camera, settings).pixels
        quads = renderer.render(splats, camera, settings.but(primitive="quad", order="front-to-back")).pixels
        assert quads.max() > 0.05
        assert np.abs(drawn - quads).max() < 5e-5 * max(quads.max(), 1.0)


def test_runs_are_nearest_first_and_leave_out_what_is_behind() -> None:
    splats = noise(size=26, opacity=0.3)
    for look in LOOKS:
        camera = inside(splats, look)
        chosen = sg.plan(splats, camera)
        assert chosen.near is not None
        found = runs(splats, chosen.near)
        assert all(first.end <= second.begin for first, second in pairwise(found))
        assert any(run.quads for run in found) and any(not run.quads for run in found)
        drawn = sum(run.end - run.begin for run in found)
        assert 0.2 * len(splats) < drawn < 0.95 * len(splats)


def test_point_clouds(renderer: sg.Renderer) -> None:
    """Points are anywhere in their cells."""
    rng = np.random.default_rng(4)
    cloud = sg.Splats.from_points(rng.random((6000, 3)) * 24, rng.random((6000, 3)), np.full(6000, 0.1))
    for look in LOOKS:
        camera = inside(cloud, look)
        assert renderer.plan(cloud, camera).near is not None
        quads = renderer.render(cloud, camera, sg.Settings(primitive="quad", order="front-to-back")).pixels
        assert np.abs(renderer.render(cloud, camera).pixels - quads).max() < 5e-5


def test_large_sprites_alone(renderer: sg.Renderer) -> None:
    """The eye is outside, but the nearest are larger than OpenGL's points."""
    splats = noise(size=26, opacity=0.3)
    camera = sg.Camera.orbit(splats, 10, 5, size=(200, 200))
    settings = sg.Settings()
    limit = 1.7 * reach(splats, camera, 1.56).largest
    chosen = sg.plan(splats, camera, settings, sprite_limit=limit)
    assert chosen.near is not None and not chosen.half_line
    assert 2 * chosen.near.reach.largest + 1 <= limit
    drawn = renderer.passes.draw(splats, camera, chosen)
    quads = renderer.render(splats, camera, settings.but(primitive="quad", order="front-to-back")).pixels
    assert np.abs(drawn - quads).max() < 5e-5


def test_where_it_does_not_pay_or_was_not_wished() -> None:
    splats = noise(size=26, opacity=0.3)
    within = inside(splats, (0, 1, 0))
    small = noise(size=8)
    for subject, camera, settings in (
        (splats, within, sg.Settings(order="back-to-front")),
        (splats, within, sg.Settings(primitive="quad")),
        (splats, within, sg.Settings(footprint="table")),
        (splats, within.parallel(splats, 10), sg.Settings()),
        # rays run along the planes, or back
        (splats, inside(splats, (1, 1, 1), fov=100), sg.Settings()),
        # nothing but near planes
        (small, inside(small, (0, 1, 0)), sg.Settings()),
    ):
        assert sg.plan(subject, camera, settings).near is None
    assert sg.plan(splats, within).near.order == order_for(splats, within)  # type: ignore[union-attr]


def test_all_as_quads_is_the_same_picture(renderer: sg.Renderer) -> None:
    """Whoever forces quads gets half lines where the eye is in a kernel."""
    splats = noise(size=26, opacity=0.3)
    camera = inside(splats, (0, 1, 0.1))
    chosen = renderer.plan(splats, camera)
    drawn = renderer.passes.draw(splats, camera, chosen)
    for way in with_it(chosen).values():
        assert np.abs(renderer.passes.draw(splats, camera, way) - drawn).max() < 5e-5
