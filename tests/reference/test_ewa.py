"""EWA splatting in float64: the limits in which it is exact, and the energy that it keeps."""

from __future__ import annotations

import numpy as np
import pytest

import splatgl as sg
from splatgl.geometry.grid import Grid
from splatgl.geometry.view import GridView
from splatgl.reference.rays import EwaEllipses
from splatgl.splat.kernels import kernel

GAUSSIANS = sg.Settings.like("0.1", kernel="gaussian", attenuation="opacity", blend="xray")


@pytest.fixture(scope="module")
def splats() -> sg.Splats:
    transfer = sg.Transfer(points=[(0.0, 0.0), (1.0, 0.6)], unit=1.0)
    return sg.extract(sg.scenes.ball(6), transfer, classification="pre")


def far(distance: float, size: int = 32) -> sg.Camera:
    return sg.Camera.look_at((0.6 * distance, -0.8 * distance, 0), (0, 0, 0), (0, 0, 1), 30, (size, size))


def off(splats: sg.Splats, camera: sg.Camera, settings: sg.Settings) -> tuple[float, float]:
    """The largest difference from row 1 over its largest value, and the ratio of their sums."""
    ewa, right = (sg.reference.render(splats, camera, settings, row).pixels for row in ("ewa", "row1"))
    return float(np.abs(ewa - right).max() / right.max()), float(ewa.sum() / right.sum())


def test_without_a_filter_it_is_the_line_integral_of_parallel_rays(splats: sg.Splats) -> None:
    unfiltered = GAUSSIANS.replace(antialias="off")
    camera = sg.Camera.orthographic((3, -4, 2), (0, 0, 0), (0, 0, 1), 14.0, (24, 24))
    assert off(splats, camera, unfiltered)[0] < 1e-6
    # the affine error of diverging rays falls with the square of the distance
    near, distant = (off(splats, far(distance), unfiltered)[0] for distance in (40.0, 400.0))
    assert 1e-5 < distant < near / 10 < 1e-4


@pytest.mark.parametrize("distance", [40.0, 100.0, 400.0])
def test_its_filter_keeps_energy_before_and_beyond_z_k(splats: sg.Splats, distance: float) -> None:
    difference, energy = off(splats, far(distance), GAUSSIANS)
    assert energy == pytest.approx(1, abs=2e-3) and difference > 1e-3


def test_widths_add_as_variances() -> None:
    """At z_k, where the kernel is as wide as the pixel's filter, an ellipse on the axis covers twice its area."""
    camera = sg.Camera.look_at((0, 0, 0), (0, 0, 1), (0, -1, 0), 60, (64, 64))
    view = GridView.of(Grid(np.eye(3), np.zeros(3)), camera, kernel("gaussian"))
    z = np.array([1.0, 2.0, 0.5]) / view.pitch
    found = EwaEllipses.of(view, np.stack([0 * z, 0 * z, z]))
    m = z * view.pitch
    np.testing.assert_allclose(found.coverage, 1 / (1 + m**2), rtol=1e-12)
    np.testing.assert_allclose(found.gain, 1 / (1 + m**2), rtol=1e-12)


def test_kernels_that_reach_the_eye_are_left_out_and_others_than_gaussians_refused(splats: sg.Splats) -> None:
    inside = sg.Camera.look_at((0, 0, 0), (1, 0, 0), (0, 0, 1), 60, (16, 16))
    assert np.isfinite(sg.reference.render(splats, inside, GAUSSIANS, row="ewa").pixels).all()
    with pytest.raises(sg.InputError, match="kernel: expected gaussian"):
        sg.reference.render(splats, inside, GAUSSIANS.replace(kernel="crawfis-max"), row="ewa")
