"""Nice numbers: 1, 2 or 5 times a power of ten."""

from __future__ import annotations

import math

import numpy as np

STEPS = (1.0, 2.0, 5.0)


def nice_below(length: float) -> float:
    """The largest of 1, 2, 5 · 10ⁿ that is at most a positive `length`."""
    power = math.floor(math.log10(length))
    # a power of ten may be missed by rounding
    fine = [step * 10.0**n for n in (power - 1, power, power + 1) for step in STEPS]
    return max(each for each in fine if each <= length * (1 + 1e-12))


def ticks(low: float, high: float, most: int) -> list[float]:
    """At most `most` (≥ 2) multiples of a nice number from low to high; none if there is nothing between them."""
    if not (high > low and math.isfinite(high - low)):
        return []
    step = nice_below((high - low) / most)
    while math.floor(high / step + 1e-9) - math.ceil(low / step - 1e-9) + 1 > most:
        step = nice_below(step * 2.5 * (1 + 1e-9))
    first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
    return [float(np.float64(f"{n * step:.12g}")) for n in range(first, last + 1)]


def log_ticks(low: float, high: float, most: int) -> list[float]:
    """At most `most` of 1, 2, 5 · 10ⁿ from low > 0 to high, else of powers of ten, or of every few of them."""
    first, last = math.floor(math.log10(low)), math.ceil(math.log10(high))
    for steps, every in [(STEPS, 1), *(((1.0,), n) for n in range(1, last - first + 2))]:
        powers = [n for n in range(first, last + 1) if n % every == 0]
        found = [float(f"{step:g}e{n}") for n in powers for step in steps]
        found = [each for each in found if low * (1 - 1e-9) <= each <= high * (1 + 1e-9)]
        if len(found) <= most:
            return found
    return []
