"""Seen from within: every technique draws kernels around the eye, and the pictures are the same."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import splatgl as sg
from splatgl.planning.culling import AROUND_EYE, Frustum
from tests.helpers.noise import GRIDS, LOOKS, inside, noise
from tests.helpers.splatting import SPLATS, each_two


@pytest.mark.turns(2)
@pytest.mark.few(1)
@pytest.mark.parametrize(("look", "grid", "blend"), each_two(LOOKS, GRIDS, ("composite", "xray", "mip")))
def test_tiles_draw_what_quads_draw(renderer: sg.Renderer, look: tuple[float, ...], grid: str, blend: Any) -> None:
    splats = noise(grid, size=18, opacity=0.3)
    camera = inside(splats, look)
    assert renderer.plan(splats, camera, SPLATS).program.seen.half_line
    settings = SPLATS.replace(blend=blend, order="front-to-back", occlusion="off")
    tiles, quads = (renderer.render(splats, camera, settings.replace(technique=t)).pixels for t in ("tiles", "quads"))
    assert quads.max() > 0.05
    assert np.abs(tiles - quads).max() < 5e-5 * max(quads.max(), 1.0)


def test_point_clouds(renderer: sg.Renderer) -> None:
    """Points are anywhere in their cells."""
    rng = np.random.default_rng(4)
    cloud = sg.Splats.from_points(rng.random((3000, 3)) * 20, rng.random((3000, 3)), np.full(3000, 0.1))
    for look in LOOKS:
        camera = inside(cloud, look)
        assert renderer.plan(cloud, camera, SPLATS).program.seen.half_line
        quads = renderer.render(cloud, camera, SPLATS.replace(technique="quads", order="front-to-back")).pixels
        tiles = renderer.render(cloud, camera, SPLATS.replace(technique="tiles", occlusion="off")).pixels
        assert np.abs(tiles - quads).max() < 5e-5


@pytest.mark.parametrize("fov", [20, 90, 170])
@pytest.mark.parametrize("grid", GRIDS)
def test_half_lines_only_where_a_kernel_in_sight_is_near(grid: str, fov: float) -> None:
    """As all splats one by one say: between the eye's plane and two reaches, and within the picture's edges."""
    splats = noise(grid, size=14, opacity=0.3)
    near = []
    low, high = splats.corners.min(axis=0), splats.corners.max(axis=0)
    for n in range(30):
        rng = np.random.default_rng(n)
        eye = low + (high - low) * rng.uniform(-0.4, 1.4, 3)
        camera = sg.Camera.look_at(eye, eye + rng.normal(size=3), rng.normal(size=3), fov, (20, 15))
        chosen = sg.plan(splats, camera, SPLATS)
        view = chosen.view
        v = view.voxels(splats.positions)
        some = (v[2] >= -view.reach) & (v[2] <= AROUND_EYE * view.reach)
        expected = bool(Frustum.of(view).may_show(v[:, some]).any())
        assert chosen.program.seen.half_line == expected
        near.append(expected)
    assert any(near) and not all(near)


@pytest.mark.long
def test_a_kernel_that_no_plane_cuts_is_not_left_out(renderer: sg.Renderer) -> None:
    """The frustum against the reference: whatever lights a pixel may be reached."""
    for n in range(60):
        rng = np.random.default_rng(n)
        dot = sg.Splats.from_points([[0.0, 0, 0]], [[1.0, 1, 1]], [1.0], spacing=(1.0, 0.5, 2.0))
        eye = rng.normal(size=3) * 2
        camera = sg.Camera.look_at(eye, eye + rng.normal(size=3), rng.normal(size=3), rng.uniform(20, 150), (12, 9))
        right = sg.reference.render(dot, camera, SPLATS.replace(blend="xray", antialias="off")).pixels
        chosen = sg.plan(dot, camera, SPLATS.replace(blend="xray", antialias="off"))
        v = chosen.view.voxels(dot.positions)
        assert Frustum.of(chosen.view).may_show(v)[0] or right.max() == 0
        drawn = renderer.render(dot, camera, SPLATS.replace(blend="xray", antialias="off", technique="tiles")).pixels
        assert np.abs(drawn - right).max() <= 5e-4 * max(right.max(), 1e-3)
