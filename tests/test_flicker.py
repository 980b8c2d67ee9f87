"""Strips of one column over time, flicker and popping."""

from __future__ import annotations

import numpy as np
import pytest
from splatting import SPLATS

import splatgl as sg
from splatgl.animation.camera_track import turning
from splatgl.scene.view import View
from splatgl.studies.aliasing import flicker, popping, strip

SETTINGS = SPLATS.but(background=(0, 0, 0))


@pytest.fixture(scope="module")
def cube() -> sg.Splats:
    """Dense and of many colours, so that the drawing order shows."""
    rng = np.random.default_rng(8)
    points = np.stack(np.meshgrid(*[np.arange(8.0)] * 3), -1).reshape(-1, 3)
    return sg.Splats.from_points(points, rng.random((512, 3)), np.full(512, 2.0))


def test_a_strip_is_the_middle_column_of_each_frame(renderer: sg.Renderer, cube: sg.Splats) -> None:
    track = turning(View(size=(30, 24), elevation=20), sg.Volume(np.zeros((8, 8, 8))), cube, 5.0)
    cameras = [track.camera(n) for n in range(4)]
    found = strip(renderer.render, cube, cameras, SETTINGS)
    assert found.shape == (12, 4, 4) and found[..., :3].max() > 0.2
    for n, camera in enumerate(cameras):
        right = renderer.render(cube, camera, SETTINGS).pixels[:12, 15]
        assert np.abs(found[:, n] - right).max() < 1e-5


def test_flicker_is_the_variance_of_differences(rng: np.random.Generator) -> None:
    still = np.repeat(rng.random((9, 1, 4)), 5, axis=1)
    assert flicker(still) == 0
    noise = rng.normal(size=(200, 200, 4))
    assert flicker(noise) == pytest.approx(2, rel=0.03)


def test_popping_is_where_planes_turn(renderer: sg.Renderer, cube: sg.Splats) -> None:
    track = turning(View(size=(40, 40), elevation=15), sg.Volume(np.zeros((8, 8, 8))), cube, 1.0)
    found = popping(renderer.render, cube, track.camera, SETTINGS, turn=100)
    assert [round(pop.angle) for pop in found] == [45] or len(found) == 1
    assert all(1 > pop.change > 3 * pop.usual >= 0 for pop in found)
