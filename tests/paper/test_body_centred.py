"""Body-centred cubic grids, as the guide's page on the paper derives their numbers."""

from __future__ import annotations

from itertools import product
from pathlib import Path

import numpy as np
import pytest

import splatgl
from splatgl.splat.kernels import Gaussian

GUIDE = (Path(splatgl.__file__).parent / "docs" / "paper.md").read_text(encoding="utf-8")


def basis(edge: float) -> np.ndarray:
    """[3, 3]: columns that generate the grid of cubes of that edge, with a voxel in each middle."""
    return edge / 2 * (1 - 2 * np.eye(3))


def rate(steps: np.ndarray) -> float:
    """ρ: the length of the shortest frequency at which a grid's copies of a spectrum lie."""
    some = np.array([n for n in product(range(-2, 3), repeat=3) if any(n)])
    return float(np.linalg.norm(some @ np.linalg.inv(steps), axis=1).min())


def test_rho_of_a_body_centred_grid_is_root_two_over_its_edge() -> None:
    assert rate(np.eye(3)) == pytest.approx(1)
    assert rate(basis(3.0)) == pytest.approx(np.sqrt(2) / 3)
    # edge √2: ρ of the cubic grid, with a voxel in a volume of √2
    edge = np.sqrt(2)
    assert rate(basis(edge)) == pytest.approx(1)
    volume = abs(np.linalg.det(basis(edge)))
    assert volume == pytest.approx(edge) and f"{100 * (1 - 1 / volume):.1f} % fewer" in GUIDE
    # as many voxels as the cubic grid: ρ is larger, so that z_k is nearer
    same = rate(basis(2 ** (1 / 3)))
    assert same == pytest.approx(2 ** (1 / 6)) and f"{1 / same:.3f} of" in GUIDE


def test_the_gaussians_ripple_is_that_of_twelve_copies_instead_of_six() -> None:
    gaussian, index = Gaussian(), np.array(list(product(range(-6, 7), repeat=3)))
    ripples = {}
    for name, steps in (("cubic", np.eye(3)), ("body-centred", basis(np.sqrt(2)))):
        places = np.array(list(product(np.arange(8) / 8, repeat=3))) @ steps.T
        r = np.linalg.norm(places[:, None] - (index @ steps.T)[None], axis=-1)
        total = np.where(r < gaussian.radius, gaussian.value(r), 0.0).sum(axis=1) * abs(np.linalg.det(steps))
        ripples[name] = 100 * (total.max() - 1), 100 * (total.min() - 1)
    assert f"+{ripples['body-centred'][0]:.1f} and −{-ripples['body-centred'][1]:.1f} %" in GUIDE
    assert f"±{ripples['cubic'][0]:.1f} % of the cubic" in GUIDE
