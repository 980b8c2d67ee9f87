"""`ClassIntegral`: a transfer function's means over intervals of values, so that no step or spike is passed over.

Along a part of a ray values are linear; its extinction and emission are means over the values that it passes. [Engel,
Kraus & Ertl 2001, without its table of pairs: differences of one running integral]
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from splatgl.splat.classification.transfer import OPAQUE, Transfer

# largest value of a running integral in whole numbers: differences fit into 32 bits with a sign
WHOLE = 2**31 - 1
# cells between two points of a transfer function, however close they are
PARTS = 64
# opacity below 1 of cells beside a point of opacity 1 that are as opaque as it
TIP = 1e-3
# of opacities at the ends of cells
ROUNDING = 1e-9


@dataclass(frozen=True, eq=False)
class ClassIntegral:
    """Cells between ascending `knots` [n + 1], with the first and last value beyond the ends.

    Components are extinction · linear RGB, and extinction, per reference length. below [n + 1, 4]: their integrals from
    the first knot. low, high [n, 4]: at the ends of each cell, linear between. outside [2, 4]: beyond the ends.
    """

    knots: np.ndarray
    below: np.ndarray
    low: np.ndarray
    high: np.ndarray
    outside: np.ndarray

    @classmethod
    def of(cls, transfer: Transfer, low: float, high: float, cells: int) -> ClassIntegral:
        """At least so many cells between low < high, and PARTS between two points of the transfer function."""
        place = np.arange(cells + 1) / cells
        points = np.unique([low, high, *(value for value in transfer.bends if low < value < high)])
        part = np.arange(PARTS)[:, None] / PARTS
        between = points[:-1] * (1 - part) + points[1:] * part
        knots = np.unique(np.concatenate([low * (1 - place) + high * place, between.ravel()]))
        start, width = knots[:-1], np.diff(knots)
        # two points within a cell, as a value at a step is on its upper side; exact where it is linear
        opaque = _beside_opaque(transfer, start, width, (high - low) / cells)
        near, far = (_emission(transfer, start + share * width, opaque) for share in (0.25, 0.75))
        mean = (near + far) / 2
        slope = np.clip(far - near, -mean, mean)
        below = np.concatenate([np.zeros((1, 4)), np.cumsum(mean * width[:, None], axis=0)])
        outside = _emission(transfer, np.array([low - (high - low), high + (high - low)]))
        return cls(knots, below, mean - slope, mean + slope, outside)

    def until(self, values: np.ndarray) -> np.ndarray:
        """[N, 4]: the integral from the first knot to values [N]; negative below it."""
        cell = self._cells(values)
        inside = np.clip(values, self.knots[0], self.knots[-1])
        part = inside - self.knots[cell]
        share = (part / (self.knots[cell + 1] - self.knots[cell]))[:, None]
        low, high = self.low[cell], self.high[cell]
        beyond = np.where((values < inside)[:, None], self.outside[0], self.outside[1])
        within = part[:, None] * (low + share * (high - low) / 2)
        return np.asarray(self.below[cell] + within + (values - inside)[:, None] * beyond)

    def mean(self, first: np.ndarray, last: np.ndarray) -> np.ndarray:
        """[N, 4]: means over the values between first and last [N], in either order."""
        apart = last - first
        cell = self._cells(first)
        width = self.knots[cell + 1] - self.knots[cell]
        middle = (first + last) / 2
        share = ((middle - self.knots[cell]) / width)[:, None]
        same = self.low[cell] + share * (self.high[cell] - self.low[cell])
        same = np.where((middle < self.knots[0])[:, None], self.outside[0], same)
        same = np.where((middle >= self.knots[-1])[:, None], self.outside[1], same)
        alike = (apart == 0) | ((self._cells(last) == cell) & (self._outside(first) == self._outside(last)))
        found = (self.until(last) - self.until(first)) / np.where(alike, 1.0, apart)[:, None]
        return np.maximum(np.where(alike[:, None], same, found), 0.0)

    def table(self, cells: int) -> tuple[np.ndarray, float]:
        """uint32 [cells + 1, 4]: integrals from the first knot on to the ends of so many cells of equal width, in the
        unit that is returned, per cell width.
        """
        place = np.arange(cells + 1) / cells
        until = np.maximum(self.until(self.knots[0] * (1 - place) + self.knots[-1] * place), 0.0)
        width = (self.knots[-1] - self.knots[0]) / cells
        unit = float(until.max()) / width / WHOLE or 1.0
        return np.rint(until / width / unit).astype(np.uint32), unit

    def _cells(self, values: np.ndarray) -> np.ndarray:
        return np.clip(np.searchsorted(self.knots, values, side="right") - 1, 0, len(self.low) - 1)

    def _outside(self, values: np.ndarray) -> np.ndarray:
        return (values >= self.knots[-1]).astype(int) - (values < self.knots[0])


def _beside_opaque(transfer: Transfer, start: np.ndarray, width: np.ndarray, reach: float) -> np.ndarray:
    """bool [n]: the cells within `reach` of a value of opacity 1, as nearly opaque themselves. There extinction rises
    without end, and a mean over a cell is not that of flat matter whose value is the point itself.
    """
    quarter, half, last = (transfer.opacity(start + share * width) for share in (0.25, 0.5, 0.75))
    ends = np.stack([quarter + (quarter - last) / 2, last + (last - quarter) / 2])
    tips = np.unique(np.stack([start, start + width])[ends >= OPAQUE - ROUNDING])
    if not tips.size:
        return np.zeros(len(start), bool)
    after = np.clip(np.searchsorted(tips, start), 0, len(tips) - 1)
    apart = np.minimum(np.abs(tips[after] - start - width), np.abs(start - tips[np.maximum(after - 1, 0)]))
    return np.asarray((apart <= reach) & (half >= OPAQUE - TIP))


def _emission(transfer: Transfer, values: np.ndarray, opaque: np.ndarray | None = None) -> np.ndarray:
    """[N, 4]: extinction · linear RGB, and extinction, per reference length, of values [N]; opaque: which of them have
    the most.
    """
    opacity = transfer.opacity(values)
    extinction = transfer.extinction(opacity if opaque is None else np.where(opaque, 1.0, opacity), 1.0)[:, None]
    return np.concatenate([transfer.color(values) * extinction, extinction], axis=1)
