"""Common marks of missing values, and distinct values."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence

import numpy as np

# ends of float32 and float64, Surfer's and NetCDF's numbers; the least power of ten that no quantity has
ENDS_OF_FLOATS, ENORMOUS = (3.4028234663852886e38, 1.7976931348623157e308, 1.70141e38, 9.969209968386869e36), 1e20
# least size of enormous numbers, of the others' largest
TIMES_LARGER = 1e3
# ends of integers, and what NetCDF fills with
LEAST_INTEGERS = frozenset(float(-(2 ** (bits - 1)) + more) for bits in (14, 16, 32, 64) for more in range(3))
# 999, 9999, 9999.9, …; least power of ten
NINES, POWER = re.compile(r"9{3,}(\.(9+|25))?"), 1e4
# quantiles between which nearly all others lie; how often fills are searched at both ends
INNER, ROUNDS = (0.02, 0.98), 4


def custom_fills(
    values: np.ndarray, is_padding: Callable[[float, float, np.ndarray], bool] | None = None
) -> tuple[tuple[float, ...], np.ndarray]:
    """Numbers at the ends of sorted values that by custom mean no data, and the other values. is_padding: decides on
    other numbers, by their share and the rest of the values.
    """
    fills = set[float]()
    for _ in range(ROUNDS if len(values) else 0):
        low, high = values[[0, -1]].tolist()
        first, last = np.searchsorted(values, low, side="right"), np.searchsorted(values, high, side="left")
        # either end, or both, which are far from each other, too
        for ends, rest in (({low}, values[first:]), ({high}, values[:last]), ({low, high}, values[first:last])):
            # of two values, both are objects' or background
            if not len(rest) or rest[0] == rest[-1]:
                continue
            share = 1 - len(rest) / len(values)
            if all(_is_custom(end, rest) or (is_padding and is_padding(end, share, rest)) for end in ends):
                fills |= ends
                values = rest
                break
    return tuple(sorted(fills)), values


def inner_range(values: np.ndarray) -> tuple[float, float]:
    """Quantiles of sorted values between which nearly all lie."""
    low, high = (float(values[round(share * (len(values) - 1))]) for share in INNER)
    return low, high


def _is_custom(fill: float, rest: np.ndarray) -> bool:
    """Whether a number far from the rest means no data wherever it stands: an enormous one, or a usual negative one."""
    low, high = inner_range(rest)
    size = abs(fill)
    is_power = size >= POWER and math.isclose(size, 10.0 ** round(math.log10(size)), rel_tol=1e-6)
    if any(math.isclose(size, end, rel_tol=1e-5) for end in ENDS_OF_FLOATS) or (size >= ENORMOUS and is_power):
        return size >= TIMES_LARGER * max(abs(low), abs(high))
    return fill < 0 and (fill in LEAST_INTEGERS or is_power or is_nines(size)) and low - fill > (high - low) / 2


def is_nines(size: float) -> bool:
    """Whether a number is 999, 9999, 9999.9 and so on."""
    return NINES.fullmatch(f"{size:.9g}") is not None


def format_numbers(numbers: Sequence[float]) -> str:
    """The text of numbers in a sentence."""
    return " and ".join(f"{number:.7g}" for number in numbers)


def distinct(values: np.ndarray) -> np.ndarray:
    """The distinct values, ascending. Without counts, numpy imports its masked arrays, which takes 30 ms."""
    return np.unique(values, return_counts=True)[0]
