"""A kernel with a tabulated footprint: equal to 1e−12, several times as fast.

Just inside a knot a footprint behaves as a half-integer power of the distance to it, so each interval
between two knots is tabulated over √(knot − d), where it is smooth.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from splatgl.splat.kernel.kernels import Kernel, kernel

# cubics per interval: error 3e−14 of F(0)
CUBICS = 4096


@dataclass(frozen=True, eq=False)
class Tabulated:
    """The kernel `exact` with F(d) by cubic interpolation."""

    exact: Kernel
    tables: tuple[np.ndarray, ...]

    @property
    def name(self) -> str:
        """Identifier of the exact kernel."""
        return self.exact.name

    @property
    def radius(self) -> float:
        """R of the exact kernel."""
        return self.exact.radius

    @property
    def knots(self) -> tuple[float, ...]:
        """Knots of the exact kernel, the limits of the tables."""
        return self.exact.knots

    def value(self, r: np.ndarray) -> np.ndarray:
        """g(r) of the exact kernel, any shape."""
        return self.exact.value(r)

    def partial(self, d: np.ndarray, t: np.ndarray) -> np.ndarray:
        """P_d(t) of the exact kernel."""
        return self.exact.partial(d, t)

    def footprint(self, d: np.ndarray) -> np.ndarray:
        """F(d) from the tables, d ≥ 0, any shape; 0 for d ≥ R."""
        d = np.asarray(d, dtype=np.float64)
        found, low = np.zeros(d.shape), 0.0
        for knot, table in zip(self.knots, self.tables, strict=True):
            inside = (d >= low) & (d < knot)
            found[inside] = _look_up(table, np.sqrt((knot - d[inside]) / (knot - low)))
            low = knot
        return found


@lru_cache(maxsize=16)
def tabulated(name: str) -> Tabulated:
    """The kernel of that name with a tabulated footprint, cached. InputError for an unknown name."""
    exact = kernel(name)
    tables, low = [], 0.0
    for knot in exact.knots:
        tables.append(_table(exact, low, knot))
        low = knot
    return Tabulated(exact, tuple(tables))


def _table(exact: Kernel, low: float, knot: float) -> np.ndarray:
    """Cubics [CUBICS, 4] through F at the ends and at two points between, in x = √((knot − d)/(knot − low))."""
    thirds = np.arange(3 * CUBICS + 1) / (3 * CUBICS)
    f = exact.footprint(np.clip(knot - thirds * thirds * (knot - low), low, knot))
    # the cubic through four equidistant values, in p ∈ [0, 1) between the outer ones
    values = np.stack([f[0:-1:3], f[1::3], f[2::3], f[3::3]], axis=1)
    return np.asarray(values @ np.linalg.inv(np.vander(np.arange(4) / 3, increasing=True)).T)


def _look_up(table: np.ndarray, x: np.ndarray) -> np.ndarray:
    place = x * CUBICS
    cell = np.minimum(place.astype(np.intp), CUBICS - 1)
    place -= cell
    c = np.take(table, cell, axis=0)
    return np.asarray(((c[..., 3] * place + c[..., 2]) * place + c[..., 1]) * place + c[..., 0])
