"""Motion blur of a footprint along a straight path, in float64.

A splat that moves by a length l while the shutter is open contributes, at (u, v) along and across its path from
the path's middle, the mean of its footprint: B = (G(u + l/2, v) − G(u − l/2, v))/l with the partial area
G(u, v) = ∫₋∞ᵘ F(√(u'² + v²)) du'. The paper instead cuts the footprint in half, puts a rectangle of length l
between the halves, and weakens it [M98 §5, Fig. 11, Eq. 11]. All lengths are in voxels, or, where
antialiasing has stretched the footprint by m, in units of m voxels.
"""

from __future__ import annotations

import numpy as np

from splatgl.splat.kernel.kernels import Kernel, unit_rule

# a path shorter than this, l√k = 1e−4 at k = 2, is a point: its mean is the middle's value to 5e−10,
# while the difference of two areas loses digits
POINT = 1e-4 / np.sqrt(2.0)
# points between two knots, where F is smooth in the angle: 1e−12 of the area
QUADRATURE_ORDER = 32
# the values of Settings.motion that are streaks
MOTIONS = ("exact", "energy", "paper")


def partial_area(kernel: Kernel, u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """∫₀ᵘ F(√(u'² + v²)) du', odd in u, for u and v of any shapes that broadcast.

    G is this plus half of the whole line's area. Between two knots F is smooth except for a root at the outer
    one, which u' = c sin θ removes.
    """
    u, v = np.broadcast_arrays(np.asarray(u, dtype=np.float64), np.asarray(v, dtype=np.float64))
    far = np.abs(u)
    total, low = np.zeros(u.shape), np.zeros(u.shape)
    for knot in kernel.knots:
        chord = half_chord(knot, v)
        high = np.minimum(far, chord)
        first, last = (np.arcsin(np.clip(x / np.where(chord > 0, chord, 1.0), 0.0, 1.0)) for x in (low, high))
        for node, weight in zip(*_RULE, strict=True):
            angle = first + (last - first) * node
            along = chord * np.sin(angle)
            total += weight * (last - first) * chord * np.cos(angle) * kernel.footprint(np.hypot(along, v))
        low = np.maximum(low, high)
    return np.copysign(total, u)


def line_area(kernel: Kernel, v: np.ndarray) -> np.ndarray:
    """∫ F(√(u² + v²)) du over the whole line at distance v from the centre; W of the paper's streak at v = 0."""
    return 2 * partial_area(kernel, half_chord(kernel.radius, v), v)


def half_chord(radius: float, v: np.ndarray) -> np.ndarray:
    """√(R² − v²), 0 beyond R."""
    v = np.minimum(np.abs(np.asarray(v, dtype=np.float64)), radius)
    return np.asarray(np.sqrt((radius - v) * (radius + v)))


def box_blur(kernel: Kernel, u: np.ndarray, v: np.ndarray, length: np.ndarray) -> np.ndarray:
    """B(u, v, l): the mean of the footprint along the path, exact; F itself for a path that is a point."""
    u, v, length = (np.asarray(x, dtype=np.float64) for x in (u, v, length))
    moves = length > POINT
    safe = np.where(moves, length, 1.0)
    ends = partial_area(kernel, u + safe / 2, v), partial_area(kernel, u - safe / 2, v)
    return np.where(moves, (ends[0] - ends[1]) / safe, kernel.footprint(np.hypot(u, v)))


def stretched(kernel: Kernel, u: np.ndarray, v: np.ndarray, length: np.ndarray) -> np.ndarray:
    """The footprint cut in half, the halves l apart, with the cut's values between them; not weakened.

    [M98 Fig. 11]
    """
    beyond = np.maximum(np.abs(u) - np.asarray(length) / 2, 0.0)
    return np.asarray(kernel.footprint(np.hypot(beyond, v)))


def paper_gain(kernel: Kernel, length: np.ndarray) -> np.ndarray:
    """The paper's weakening: the disc's area over the stretched disc's.  [M98 Eq. 11]

    It conserves the energy of a uniform disc; a footprint's energy grows up to 2.08 times.
    """
    disc = np.pi * kernel.radius
    return np.asarray(disc / (disc + 2 * np.asarray(length)))


def energy_gain(kernel: Kernel, length: np.ndarray) -> np.ndarray:
    """E₁/(E₁ + l W): the weakening that conserves the energy of `stretched`; E₁ = 1, as kernels have unit volume."""
    return np.asarray(1 / (1 + np.asarray(length) * line_area(kernel, np.zeros(()))))


def streak(kernel: Kernel, motion: str, place: tuple[np.ndarray, np.ndarray], length: np.ndarray) -> np.ndarray:
    """The contribution of a moving splat of unit extinction at `place` = (u, v); motion: exact, energy or paper."""
    if motion == "exact":
        return box_blur(kernel, *place, length)
    gain = energy_gain if motion == "energy" else paper_gain
    return gain(kernel, length) * stretched(kernel, *place, length)


_RULE = unit_rule(QUADRATURE_ORDER)
