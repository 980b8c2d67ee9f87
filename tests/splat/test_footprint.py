"""Table 1 in float64 against the pinned vectors, and the switch depth against its table."""

from __future__ import annotations

import numpy as np
import pytest

import splatgl as sg
from splatgl.splat.footprint import ROWS, Splat, switch_depth
from splatgl.splat.kernels import kernel
from tests.helpers.noise import scale

NAMES = {"D": "gaussian", "CM": "crawfis-max"}


@pytest.mark.parametrize("row", ROWS)
def test_rows_match_the_pinned_vectors(row: str, pinned: list[dict], pinned_camera: sg.Camera) -> None:
    x, y = pinned_camera.slopes()
    for vector in pinned:
        h = kernel(NAMES[vector["kernel"]])
        i, j = vector["pixel"]
        splat = Splat(h, np.array(vector["voxel"]), np.array([x[i], y[j]]), pinned_camera.z_k(1.0))
        assert float(ROWS[row](splat)) / scale(h) == pytest.approx(vector[row], abs=1e-11)


@pytest.mark.few(2)
@pytest.mark.parametrize(
    ("half_angle", "expected"),
    [
        (15, (1.000, 1.089, 1.210, 1.322, 1.421)),
        (30, (1.231, 1.348, 1.448, 1.532, 1.600)),
        (45, (1.418, 1.519, 1.601, 1.666, 1.718)),
        (60, (1.614, 1.704, 1.773, 1.827, 1.869)),
    ],
)
def test_switch_depth(half_angle: float, expected: tuple[float, ...]) -> None:
    """z_s/z_k for 8, 4, 2, 1 and 0.5 levels at the edge of a 512³ volume in a 512² picture."""
    for levels, right in zip((8, 4, 2, 1, 0.5), expected, strict=True):
        found = switch_depth(kernel("gaussian"), np.radians(half_angle), 512, 256, levels)
        assert found == pytest.approx(right, abs=1.5e-3)


def test_nothing_comes_from_behind() -> None:
    """A voxel behind the eye has no ray-perpendicular footprint on any ray."""
    splat = Splat(kernel("gaussian"), np.array([0.1, 0.0, -3.0]), np.zeros((1, 2)), 443.0)
    assert ROWS["row4"](splat) == 0


def test_row_4_has_a_plus_where_a_minus_is_printed() -> None:
    """tan δ = (y_p z_v − y_v z_k)/(z_v z_k + y_p y_v) in the plane; the printed minus misses by many levels."""
    h, z_k, y, z = kernel("gaussian"), 443.405, 256.0, 500.0
    pixel = y * z_k / z + np.linspace(-1.5, 1.5, 31)
    voxel = np.array([0.0, y, z])
    slope = np.stack([np.zeros(31), pixel / z_k], axis=-1)
    found = ROWS["row4"](Splat(h, voxel, slope, z_k, planar=True))
    for sign, right in ((1, True), (-1, False)):
        tan = (pixel * z - y * z_k) / (z * z_k + sign * pixel * y)
        m = z / z_k
        printed = h.footprint(np.abs(np.hypot(y, z) * tan / m)) / m
        worst = 255 * np.abs(found - printed).max() / found.max()
        assert worst < 1e-8 if right else worst > 20
