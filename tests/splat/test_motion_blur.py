"""The moving footprint: check values, energy, limits; its table against the exact one."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from paper.forms import POINT, box_blur, energy_gain, paper_gain, streak, stretched_footprint

from splatgl.splat.kernels import Kernel, kernel
from splatgl.splat.motion_blur import (
    MOTIONS,
    SHORT,
    blur_table,
    line_area,
    moving_depth,
    partial_area,
)
from tests.helpers.streaks import blur, isolation

# (u, v, l) → B of the kernel of unit volume
PLACES = np.array([(0, 0, 0), (0.3, 0.2, 0.5), (1, 0, 2), (1, 0.5, 10), (50, 0.1, 100)], float).T
VALUES = {
    "gaussian": (0.637302138, 0.478525235, 0.199630603, 0.048422289, 0.003913527),
    "crawfis-max": (0.699943966, 0.528513077, 0.212729422, 0.050034727, 0.004167880),
}
LENGTHS = (0.0, 1e-3, 0.1, 1.0, 7.3, 100.0)
each_kernel = pytest.mark.parametrize("name", VALUES)


@each_kernel
def test_check_values(name: str) -> None:
    """To 1e−9, the tenth digit being rounded off."""
    assert np.abs(box_blur(kernel(name), *PLACES) - VALUES[name]).max() < 1e-9


@each_kernel
def test_check_values_by_the_float32_table(name: str) -> None:
    found = blur(blur_table(name), *PLACES) * kernel(name).footprint(np.zeros(()))
    assert found.dtype.itemsize <= 8 and blur_table(name).texels.dtype == np.float32
    assert np.abs(found - VALUES[name]).max() < 1e-6


@each_kernel
def test_areas_are_those_of_quadrature(name: str, rng: np.random.Generator) -> None:
    """Against the midpoint rule on 100 000 points; W is 1.570269383/1.966468767 and 0.850917029/0.999999228."""
    shape = kernel(name)
    right = {"gaussian": 1.570269383 / 1.966468767, "crawfis-max": 0.850917029 / 0.999999228}
    assert float(line_area(shape, np.zeros(()))) == pytest.approx(right[name], abs=1e-9)
    for u, v in rng.uniform((-2, 0), (2, 1.5), (4, 2)):
        middles = (np.arange(100_000) + 0.5) / 100_000 * u
        brute = float(shape.footprint(np.hypot(middles, v)).mean() * u)
        assert float(partial_area(shape, np.array(u), np.array(v))) == pytest.approx(brute, abs=2e-7)


@pytest.mark.few(2)
@each_kernel
@pytest.mark.parametrize("motion", MOTIONS)
def test_energy(name: str, motion: str) -> None:
    """The integral over the plane is 1 for `exact` and `energy`; the paper's goes up to 2.509 and 2.080."""
    shape = kernel(name)
    for length in LENGTHS:
        found = energy(shape, motion, length)
        if motion != "paper":
            assert found == pytest.approx(1, abs=1e-4), length
        else:
            assert found == pytest.approx(float(paper_gain(shape, length) / energy_gain(shape, length)), abs=1e-4)


def energy(shape: Kernel, motion: str, length: float) -> float:
    """∫∫ over the plane: across by 60 Gauss points, along from the middle outwards, denser at the ends."""
    nodes, weights = np.polynomial.legendre.leggauss(60)
    v, across = nodes * shape.radius, weights * shape.radius
    ends = np.unique([0.0, max(length / 2 - shape.radius, 0.0), length / 2, length / 2 + shape.radius])
    total = 0.0
    for low, high in pairwise(ends):
        u, along = (nodes + 1) / 2 * (high - low) + low, weights / 2 * (high - low)
        total += 2 * float(along @ streak(shape, motion, (u[:, None], v[None]), np.array(length)) @ across)
    return total


@pytest.mark.parametrize(("name", "limit"), [("gaussian", 2.509), ("crawfis-max", 2.080)])
def test_the_papers_weakening_gains_energy(name: str, limit: float) -> None:
    shape, long = kernel(name), np.array(1e7)
    assert float(paper_gain(shape, long) / energy_gain(shape, long)) == pytest.approx(limit, abs=1e-3)
    assert float(paper_gain(shape, np.zeros(()))) == 1.0 == float(energy_gain(shape, np.zeros(())))


@each_kernel
def test_a_path_that_is_a_point_is_the_footprint_itself(name: str, rng: np.random.Generator) -> None:
    shape = kernel(name)
    u, v = rng.uniform(-2, 2, (2, 500))
    still = shape.footprint(np.hypot(u, v))
    for motion in MOTIONS:
        assert (streak(shape, motion, (u, v), np.zeros(())) == still).all()
    table = blur_table(name)
    expected = (shape.footprint(np.hypot(u.astype("f4"), v.astype("f4"))) / shape.footprint(np.zeros(()))).astype("f4")
    assert (blur(table, u, v, 0.0) == expected).all()
    # and continuous there
    around = [box_blur(shape, u, v, np.array(POINT * s)) for s in (0.999, 1.001)]
    assert np.abs(around[0] - around[1]).max() < (1e-9 if name == "crawfis-max" else 1e-6)


@each_kernel
def test_table_is_near_the_exact_blur(name: str, rng: np.random.Generator) -> None:
    """In parts of the footprint's peak. The Gaussian's cut leaves a step of 3e−4 of the peak in its slope."""
    shape, table = kernel(name), blur_table(name)
    peak = float(shape.footprint(np.zeros(())))
    assert table.texels.nbytes < 300_000
    for length in (0.5 * SHORT, 1.1 * SHORT, 0.2, 1.0, 12.0):
        u = rng.uniform(-1, 1, 1500) * (shape.radius + length / 2) * 1.02
        v = rng.uniform(-1.02, 1.02, 1500) * shape.radius
        error = np.abs(blur(table, u, v, length) - box_blur(shape, u, v, np.array(length)) / peak)
        assert error.max() < (3e-5 if name == "gaussian" and length < SHORT else 8e-6)


def test_stretched_is_two_halves_and_what_is_between() -> None:
    shape = kernel("crawfis-max")
    u, v = np.linspace(-3, 3, 61), np.full(61, 0.3)
    found = stretched_footprint(shape, u, v, np.array(2.0))
    assert (found[np.abs(u) <= 1] == shape.footprint(np.array(0.3))).all()
    assert found[-10] == shape.footprint(np.hypot(u[-10] - 1, 0.3))


def test_dwelling_is_smeared_depth_for_fog_and_smeared_opacity_for_what_is_alone() -> None:
    mean, most = np.array([1e-4, 0.3, 2.0]), np.array([2e-4, 0.5, 8.0])
    assert moving_depth(mean, most, np.zeros(3)) == pytest.approx(mean)
    # a thin one alone: both are the same
    assert moving_depth(mean, most, np.ones(3))[0] == pytest.approx(1e-4, rel=1e-3)
    # an opaque one before the pixel for a tenth of the time hides little more than that
    hidden = -np.expm1(-moving_depth(np.array([1.0]), np.array([10.0]), np.ones(1)))
    assert 0.1 < float(hidden[0]) < 0.25
    assert (moving_depth(mean, mean, np.ones(3)) == mean).all()
    assert isolation(np.array([5.0, 5.0]), np.array([1.0, 1000.0])) == pytest.approx([1.0, 0.0], abs=1e-4)
