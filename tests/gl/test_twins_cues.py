"""Twins of `shaders/cues.glsl`: the light that reaches a place, from grids of cells."""

from __future__ import annotations

import numpy as np
import pytest

import splatgl as sg
from splatgl.geometry.grid import trilinear
from splatgl.planning.ambient_occlusion import LightVolume
from tests.helpers.noise import noise, views
from tests.helpers.twins import COUNT, Twin

CUED = sg.Settings(classification="pre", shading="on", light="matte", ambient_occlusion=0.8, shadows=0.7)


def cell_at(cues: LightVolume, positions: np.ndarray) -> np.ndarray:
    """[N, 3]: the cells of grid positions [N, 3]."""
    turn, moved = cues.cell_from_index
    return np.asarray(positions @ turn.T + moved)


@pytest.mark.parametrize("view", ["fitted", "parallel"])
def test_cues(view: str, twin: Twin, rng: np.random.Generator) -> None:
    splats = noise("sheared")
    camera = views(splats)[view]
    plan = sg.plan(splats, camera, CUED)
    cues = plan.resolved.cues
    assert cues is not None and cues.fields.sky is not None
    # beyond the grid, too, where it goes on as at its edges
    low, high = splats.index_bounds
    positions = rng.uniform(low - 5, high + 5, (COUNT, 3))
    place, voxel = cell_at(cues, positions), plan.view.voxels(positions)
    found = twin("splat_setup.glsl", "result.xyz = cell_at(index_from_eye() * v)", plan, splats, v=voxel.T)[:, :3]
    assert np.abs(found - place).max() < 1e-4
    found = twin("cues.glsl", "result = trilinear(sky_field, p)", plan, splats, p=place)
    assert np.abs(found - trilinear(cues.fields.sky, place)).max() < 1e-5
    normal, toward = rng.normal(size=(2, COUNT, 3))
    normal[::10] = 0
    given = {"p": place, "n": normal, "t": toward}
    found = twin("cues.glsl", "result.xy = reached(p, n, t)", plan, splats, **given)[:, :2]
    right = np.stack(cues.light_shares(positions, normal, toward), axis=1)
    assert np.abs(found - right).max() < 1e-4 and right.min() < 0.9
