"""Coordinates along an axis as a start and a step: samples of a volume stand in even steps."""

from __future__ import annotations

import numpy as np

from splatgl.data.errors import expected

_MOST_UNEVEN = 1e-3
"""Deviation from even steps, in steps: coordinates are often written with few digits."""


def even_steps(places: np.ndarray, what: str, fix: str) -> tuple[float, float]:
    """(first place, step) of samples at `places` [N]; the step of one sample is NaN, that of falling ones negative.

    Raises InputError, which ends with `fix`, unless each lies within _MOST_UNEVEN steps, or a rounding of float32, of
    its even place.
    """
    found = np.asarray(places, np.float64).ravel()
    if not found.size or not np.isfinite(found).all():
        raise expected(what, "finite coordinates", "none" if not found.size else "others")
    if found.size == 1:
        return float(found[0]), float("nan")
    step = (found[-1] - found[0]) / (found.size - 1)
    off = np.abs(found - (found[0] + step * np.arange(found.size))).max()
    if step == 0 or off > max(_MOST_UNEVEN * abs(step), 1e-6 * np.abs(found).max()):
        steps = np.diff(found)
        raise expected(what, "even steps", f"steps from {steps.min():.6g} to {steps.max():.6g}", fix)
    return float(found[0]), float(step)
