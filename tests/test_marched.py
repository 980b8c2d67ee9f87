"""Pictures by sheets against a marcher of the field itself, and that marcher against closed forms."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from marcher import march

import splatgl as sg


def ramp(span: float = 10.0) -> sg.Splats:
    """A value that grows by 1 a voxel along x, of extinction value/span."""
    cells = np.broadcast_to(np.arange(16.0), (16, 16, 16)).copy()
    points = [(x, -np.expm1(-x / span)) for x in np.linspace(0, 16, 1601)]
    return sg.extract(sg.Volume(cells), sg.Transfer(points, shading=False))


@pytest.mark.parametrize("parallel", [False, True])
def test_the_marcher_integrates_a_ramp(parallel: bool) -> None:
    """Between two places amid the grid, beyond which the prefilter feels its ends."""
    splats, span = ramp(), 10.0
    eye, look = np.array([5.3, 7.2, 7.6]), np.array([0.9, 0.2, 0.1])
    camera = sg.Camera.look_at(eye, eye + look, (0, 0, 1), 20, (3, 3))
    if parallel:
        camera = sg.Camera.orthographic(eye, eye + look, (0, 0, 1), 0.1, (3, 3))
    length = 6.0 / look[0] * np.linalg.norm(look)
    ahead = replace(camera, eye=eye + look / look[0] * 6.0)
    first, last = (march(splats, each, "xray")[1, 1, 3] for each in (camera, ahead))
    right = length * (eye[0] + 3.0) / span
    assert abs(first - last - right) < 1e-4 * right
