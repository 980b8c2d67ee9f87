"""The Nyquist condition of M98 §3.4, Eqs. 7–10: a stretched footprint leaks no more at any depth than at z_k.

A footprint's spectrum is taken at a picture's pixels, in cycles per pixel; what lies above ½ is aliased.
"""

from __future__ import annotations

import numpy as np
import pytest
from paper.figures.paper_setup import PAPER

from splatgl.splat.footprint import ROWS, Splat
from splatgl.splat.kernels import KERNELS, Kernel

NYQUIST = 0.5
# largest amplitude above ½ cycle per pixel, as a share of that at 0, and the share of energy there
LEAK = {"gaussian": (0.291487, 0.084761), "crawfis-max": (0.350711, 0.106563)}
DEPTHS = (1.0, 1.3, 2.0, 4.0, 16.0, 100.0)


# of the integrals over a turn and over a footprint
POINTS = 100


def bessel(x: np.ndarray) -> np.ndarray:
    """J0 by its integral over half a turn, to rounding up to x = 60."""
    turn = (np.arange(POINTS) + 0.5) / POINTS * np.pi
    return np.cos(x[..., None] * np.sin(turn)).mean(axis=-1)


def spectrum(kernel: Kernel, depth: float, stretch: bool, cycles: np.ndarray) -> np.ndarray:
    """Hankel transform, at `cycles` per pixel, of what the pixels see of a voxel on the axis at depth · z_k."""
    z_k = PAPER.z_k
    reach = kernel.radius * (max(depth, 1.0) if stretch else 1.0) / depth  # in pixels
    nodes, weights = np.polynomial.legendre.leggauss(POINTS)
    pixels, weights = (nodes + 1) / 2 * reach, weights / 2 * reach
    slope = np.stack([pixels / z_k, np.zeros_like(pixels)], axis=-1)
    splat = Splat(kernel, np.array([0.0, 0.0, depth * z_k]), slope, z_k if stretch else np.inf)
    value = ROWS["row4"](splat)
    return 2 * np.pi * (bessel(2 * np.pi * cycles[:, None] * pixels) * value * pixels * weights).sum(axis=1)


def leak(kernel: Kernel, depth: float, stretch: bool) -> tuple[float, float]:
    """Largest amplitude above ½ cycle per pixel over that at 0, and the share of energy there."""
    # 4 cycles per voxel hold all but 1e−6 of the energy
    last = 4.0 if stretch else 4.0 * depth
    nodes, weights = np.polynomial.legendre.leggauss(100)
    energies, largest = [], 0.0
    for low, high in ((0.0, NYQUIST), (NYQUIST, 1.5), (1.5, last)):
        cycles = low + (nodes + 1) / 2 * (high - low)
        amplitude = spectrum(kernel, depth, stretch, np.append(cycles, low))
        energies.append(float((amplitude[:-1] ** 2 * cycles * weights).sum() * (high - low)))
        largest = max(largest, float(np.abs(amplitude).max())) if low >= NYQUIST else largest
    return largest / float(spectrum(kernel, depth, stretch, np.zeros(1))[0]), sum(energies[1:]) / sum(energies)


@pytest.mark.parametrize("name", LEAK)
def test_a_stretched_footprint_leaks_as_little_at_every_depth(name: str) -> None:
    amplitude, energy = LEAK[name]
    for depth in DEPTHS:
        found = leak(KERNELS[name], depth, stretch=True)
        assert found[0] == pytest.approx(amplitude, abs=1e-6), depth
        assert found[1] == pytest.approx(energy, abs=1e-6), depth


@pytest.mark.parametrize("name", LEAK)
def test_the_leak_is_the_kernels_own_above_half_a_cycle_per_voxel(name: str) -> None:
    """At z_k a pixel is a voxel: the spectrum is the radial kernel's, (2/ρ) ∫ g(r) sin(2πρr) r dr."""
    kernel = KERNELS[name]
    r = (np.arange(40000) + 0.5) / 40000 * kernel.radius
    g, step = kernel.value(r), kernel.radius / 40000
    own = 2 / NYQUIST * float((g * np.sin(2 * np.pi * NYQUIST * r) * r).sum() * step)
    assert own == pytest.approx(LEAK[name][0], abs=1e-6)
    at_z_k = spectrum(kernel, 1.0, True, np.array([NYQUIST]))[0]
    assert float(at_z_k) == pytest.approx(own, abs=1e-6)


@pytest.mark.parametrize("name", KERNELS)
def test_an_unstretched_footprint_leaks_ever_more(name: str) -> None:
    leaks = [leak(KERNELS[name], depth, stretch=False) for depth in (1.0, 1.3, 2.0, 4.0)]
    assert (np.diff(leaks, axis=0) > 0).all()
    # four times as far nearly all of it is aliased
    assert leaks[-1][0] > 0.9 and leaks[-1][1] > 0.75


@pytest.mark.parametrize("name", KERNELS)
def test_the_weakening_keeps_the_energy(name: str) -> None:
    """(z_k/z_v)² of a footprint m times as wide: the same sum over the pixels as unstretched [M98 Eq. 6]."""
    nothing = np.zeros(1)
    for depth in DEPTHS:
        stretched, plain = (spectrum(KERNELS[name], depth, s, nothing)[0] for s in (True, False))
        assert stretched == pytest.approx(plain, rel=2e-5)
