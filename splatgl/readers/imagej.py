"""Calibrations of ImageJ from stored numbers to values; functions and numbers of them as in ij.measure.Calibration."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from splatgl.fileio import byte_count, require_memory
from splatgl.readers.common import parse_number

Coefficients = Sequence[float]


def _inverse_rodbard(x: np.ndarray, c: Coefficients) -> np.ndarray:
    inside = (x >= c[0]) & (x < c[3])
    share = (x - c[0]) / np.where(inside, c[3] - x, 1.0)
    return np.where(inside, c[2] * np.power(share, 1 / c[1], where=inside, out=np.zeros_like(x)), 0.0)


def _gamma_variate(x: np.ndarray, c: Coefficients) -> np.ndarray:
    after = np.maximum(x - c[0], 0.0)
    return np.where(after > 0, c[1] * np.power(after, c[2]) * np.exp(-after / c[3]), 0.0)


def _optical_density(x: np.ndarray, c: Coefficients) -> np.ndarray:
    return np.log10(255.0 / np.where(x == 0, 0.5, x))


# of each function: its number, coefficients, name, and values at stored numbers
FUNCTIONS: dict[int, tuple[int, str, Callable[[np.ndarray, Coefficients], np.ndarray]]] = {
    0: (2, "straight line", lambda x, c: c[0] + c[1] * x),
    1: (3, "polynomial of degree 2", lambda x, c: np.polyval(c[2::-1], x)),
    2: (4, "polynomial of degree 3", lambda x, c: np.polyval(c[3::-1], x)),
    3: (5, "polynomial of degree 4", lambda x, c: np.polyval(c[4::-1], x)),
    4: (2, "exponential", lambda x, c: c[0] * np.exp(c[1] * x)),
    5: (2, "power", lambda x, c: c[0] * np.power(x, c[1])),
    6: (2, "logarithm", lambda x, c: np.where(x == 0, -1000 * c[0], c[0] * np.log(c[1] * x))),
    7: (4, "Rodbard", lambda x, c: c[3] + (c[0] - c[3]) / (1 + np.power(x / c[2], c[1]))),
    8: (4, "gamma variate", _gamma_variate),
    9: (3, "logarithm with offset", lambda x, c: c[0] + c[1] * np.log(x - c[2])),
    10: (4, "inverse Rodbard", _inverse_rodbard),
    11: (3, "exponential with offset", lambda x, c: c[0] * np.exp(-c[1] * x) + c[2]),
    12: (4, "Gaussian", lambda x, c: c[0] + (c[1] - c[0]) * np.exp(-((x - c[2]) ** 2) / (2 * c[3] ** 2))),
    13: (3, "exponential recovery", lambda x, c: c[0] * (1 - np.exp(-c[1] * x)) + c[2]),
    21: (0, "uncalibrated optical density", _optical_density),
}
# the calibration of signed numbers of 16 bits, which are stored without a sign
SIGNED = (-32768.0, 1.0)


@dataclass(frozen=True)
class Calibration:
    """function: a key of FUNCTIONS. clipped: whether values below 0 are 0. unit: of the values."""

    function: int
    coefficients: tuple[float, ...]
    clipped: bool
    unit: str

    @classmethod
    def of(cls, metadata: Mapping[str, Any] | None, dtype: np.dtype) -> Calibration | None:
        """The calibration in ImageJ's metadata; None without one, and for other numbers than 8 and 16 bits."""
        metadata = metadata or {}
        function = int(parse_number(metadata.get("cf"), -1.0))
        if function not in FUNCTIONS or dtype.kind != "u" or dtype.itemsize > 2:
            return None
        stated = (parse_number(metadata.get(f"c{n}")) for n in range(FUNCTIONS[function][0]))
        coefficients = tuple(map(float, stated))
        if not np.isfinite(coefficients).all() or (function == 0 and coefficients in ((0, 1), (coefficients[0], 0))):
            return None
        unit = str(metadata.get("vunit", "")).strip()
        unit = "" if unit.lower() in ("gray value", "grey value") else unit
        return cls(function, coefficients, str(metadata.get("zeroclip", "")).lower() == "true", unit)

    def __str__(self) -> str:
        """A note on the values."""
        if self.function == 0:
            offset, slope = self.coefficients
            return f"values are {offset:g} + {slope:g} × the stored ones, by ImageJ's calibration"
        return f"values are calibrated from the stored ones by ImageJ's function {FUNCTIONS[self.function][1]}"

    def values(self, stored: Any) -> np.ndarray:
        """The values of stored numbers, float64; NaN for those without one."""
        with np.errstate(all="ignore"):
            values = FUNCTIONS[self.function][2](np.asarray(stored, np.float64), self.coefficients)
            values = np.where(np.isfinite(values), values, np.nan)
            return np.where(values < 0, 0.0, values) if self.clipped else values


def calibrate(samples: np.ndarray, calibration: Calibration | None) -> np.ndarray:
    """The values of stored samples: int16 for ImageJ's signed numbers, else float32; as stored without calibration."""
    if calibration is None:
        return samples
    if (calibration.function, calibration.coefficients, samples.dtype.itemsize) == (0, SIGNED, 2):
        return (samples.astype(np.uint16) ^ np.uint16(0x8000)).view(np.int16)
    require_memory(byte_count(samples.shape, np.dtype(np.float32)), samples.nbytes)
    table = calibration.values(np.arange(2 ** (8 * samples.dtype.itemsize))).astype(np.float32)
    return np.asarray(table[samples])
