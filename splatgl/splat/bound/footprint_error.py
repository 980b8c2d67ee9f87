"""Error of a drawn footprint as a function of the ray's distance D, relative to F(0).

It is the sum of three errors: the position D in float32 and by the form, the form's gain, and the table.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from splatgl.splat.kernel.kernels import Kernel, kernel, polynomials, radial_table

# float32 rounds by at most half of this
ULP = 2.0**-23
# samples of the footprint from centre to rim, dense at the rim; candidate absolute errors
SAMPLES = 400
ABSOLUTE = np.logspace(-12, 0, 73)
# cancellation error of a polynomial in float32, in ULPs of its value
POLYNOMIAL_DIGITS = 64
# error of filtering 8-bit texels in 8-bit arithmetic, besides the texels' own rounding
EIGHT_BITS = 1.5 / 255


@dataclass(frozen=True)
class Lookup:
    """A footprint's table: its kernel's name, kind, size and bits."""

    kernel: str
    kind: str
    size: int
    bits: int


@dataclass(frozen=True)
class PlacementError:
    """Errors of a fragment: distance in voxels (place), value relative to itself (gain) and to F(0) (level)."""

    place: float
    gain: float = 0.0
    level: float = 0.0


def largest(lookup: Lookup, placement: PlacementError) -> float:
    """The largest error of any fragment, over F(0)."""
    return float(_missed(lookup, placement).max())


def summed(lookup: Lookup, placement: PlacementError, weight: float, overlap: float) -> float:
    """The largest accumulated error along a ray: min over σ of weight · ρ(σ) + overlap · F(0) · σ.

    missed ≤ ρ F + σ F(0): where F is small a relative error is large, and an absolute one is not.
    """
    missed = _missed(lookup, placement)
    value, peak = _profile(lookup.kernel)
    over = np.maximum(missed[None, :] - ABSOLUTE[:, None], 0.0)
    relative = np.where(over > 0, over / np.maximum(value, 1e-30), 0.0).max(axis=1)
    return float((weight * relative + overlap * peak * ABSOLUTE).min())


@lru_cache(maxsize=4)
def _profile(name: str) -> tuple[np.ndarray, float]:
    """F/F(0) at _distances, and F(0)."""
    shape = kernel(name)
    peak = float(shape.footprint(np.zeros(())))
    return np.asarray(shape.footprint(_distances(shape)) / peak), peak


def _distances(shape: Kernel) -> np.ndarray:
    return shape.radius * (1 - np.linspace(1, 0, SAMPLES) ** 3)


def _missed(lookup: Lookup, placement: PlacementError) -> np.ndarray:
    """|drawn − right| / F(0) at _distances."""
    # quantised to tenths of log10, so that moving cameras hit the cache
    return _missed_at(lookup, _step(placement.place), _step(placement.gain)) + placement.level


def _step(number: float) -> float:
    return float(10 ** (np.ceil(10 * np.log10(max(number, 1e-12))) / 10))


@lru_cache(maxsize=256)
def _missed_at(lookup: Lookup, place: float, gain: float) -> np.ndarray:
    shape = kernel(lookup.kernel)
    d = _distances(shape)
    value, peak = _profile(lookup.kernel)
    sides = [shape.footprint(np.clip(d + side * place, 0, None)) / peak for side in (-1, 1)]
    moved = np.max([np.abs(side - value) for side in sides], axis=0)
    return np.asarray(moved + _table_error(lookup, shape, d, value) + (gain + ULP) * value)


def _table_error(lookup: Lookup, shape: Kernel, d: np.ndarray, value: np.ndarray) -> np.ndarray:
    if lookup.kind == "polynomial":
        fitted = polynomials(lookup.kernel)
        assert fitted is not None
        return np.asarray(np.abs(fitted((d / shape.radius) ** 2) - value) + POLYNOMIAL_DIGITS * ULP * value)
    if lookup.kind == "radial":
        table = radial_table(shape, lookup.size)[0]
        place = np.clip((d / shape.radius) ** 2 * (lookup.size - 1), 0, lookup.size - 1)
        texel = place.astype(int)
        return np.asarray(np.abs(table[texel, 0] + table[texel, 1] * (place - texel) - value))
    # bilinear between texels h apart: h²/8 of the second derivatives, plus the texels' rounding
    h = 2 * shape.radius / lookup.size
    first = np.gradient(value, d)
    missed = h * h / 8 * (np.abs(np.gradient(first, d)) + np.abs(first) / np.maximum(d, h))
    return np.asarray(missed + (EIGHT_BITS if lookup.bits == 8 else 2.0**-lookup.bits))
