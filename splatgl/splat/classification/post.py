"""`PostClassified`: what classification after reconstruction needs of a volume: transfer function, box and values.

The kernels reconstruct value and gradient; the transfer function classifies the reconstructed value.
[Mueller, Möller & Crawfis 1999]
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from splatgl.splat.classification.transfer import Transfer

# entries of the classification table
ENTRIES = 2**13
# points of a transfer function averaged for an entry: an opacity narrower than an entry keeps its integral
FINER = 8
# largest multiple of the transfer function's range that a value is kept at; means stay finite in float32
FURTHEST = 2.0**20
# least range of a transfer function relative to its largest record value: two float32 numbers in each table entry
RESOLVED = 2.0**-10


@dataclass(frozen=True, eq=False)
class PostClassified:
    """transfer: of reconstructed values. kernel: whose coefficients the values are.

    shape: voxels along x, y, z; rays end at the box of their cells. low, span: record values are (ρ − low)/span.
    kept [n, 2]: intervals of values that voxels were kept for.
    """

    transfer: Transfer
    kernel: str
    shape: tuple[int, int, int]
    low: float
    span: float
    kept: np.ndarray

    @classmethod
    def of(cls, transfer: Transfer, kernel: str, shape: tuple[int, int, int]) -> PostClassified:
        """Values relative to the range over which the transfer function varies."""
        low, high = active_range(transfer)
        span = high - low if high > low else max(abs(low), 1.0) * 1e-3
        return cls(transfer, kernel, shape, low, span, opaque_intervals(transfer))

    def relative(self, values: np.ndarray) -> np.ndarray:
        """Record values, float32, of samples [...]."""
        with np.errstate(over="ignore"):
            u = (np.asarray(values, np.float64) - self.low) / self.span
        return np.clip(u, -FURTHEST, FURTHEST).astype(np.float32)

    def value(self, u: np.ndarray) -> np.ndarray:
        """Values ρ of record values u [...]."""
        return np.asarray(self.low + np.asarray(u, np.float64) * self.span)

    def recolored(self, transfer: Transfer) -> PostClassified:
        """The same values under another transfer function."""
        return replace(self, transfer=transfer)

    def holds(self, transfer: Transfer) -> bool:
        """Whether the records serve another transfer function: they hold all voxels of its opaque values, and resolve
        the values over which it varies.
        """
        low, high = self.recolored(transfer).range
        furthest = max(abs(low), abs(high))
        resolved = furthest <= FURTHEST and high - low >= RESOLVED * furthest
        starts, ends = self.kept.T
        return resolved and all(((starts <= a) & (b <= ends)).any() for a, b in opaque_intervals(transfer))

    @property
    def fresh(self) -> bool:
        """Whether extraction for the transfer function would give the same records."""
        anew = PostClassified.of(self.transfer, self.kernel, self.shape)
        return (anew.low, anew.span) == (self.low, self.span) and np.array_equal(anew.kept, self.kept)

    @cached_property
    def range(self) -> tuple[float, float]:
        """Record values of the table's ends."""
        low, high = active_range(self.transfer)
        return (low - self.low) / self.span, (max(high, low + self.span * 1e-6) - self.low) / self.span

    @cached_property
    def scale(self) -> tuple[float, float]:
        """(a, b): record value u lies at a u + b between the table's entries, before clamping."""
        low, high = self.range
        a = (ENTRIES - 2) / (high - low)
        # entry 1 is the mean of the first interval, at its middle
        return a, 0.5 - low * a

    def entries(self, u: np.ndarray) -> np.ndarray:
        """The nearest table entries, int64, of record values u [...]."""
        a, b = self.scale
        return np.clip(np.rint(a * np.asarray(u, np.float64) + b), 0, ENTRIES - 1).astype(np.int64)

    def table(self, unit: float) -> np.ndarray:
        """float64 [ENTRIES, 4]: linear RGB, and extinction per `unit` world lengths, over `range`.

        unit: the transfer function's reference length in world units. Each entry is a mean over its interval; the
        first and last are the values beyond the ends.
        """
        low, high = (self.value(np.array(u)) for u in self.range)
        place = (np.arange((ENTRIES - 2) * FINER) + 0.5) / ((ENTRIES - 2) * FINER)
        values = low * (1 - place) + high * place
        extinction = self.transfer.extinction(self.transfer.opacity(values), unit)
        color = self.transfer.color(values)
        table = np.empty((ENTRIES, 4))
        # colours are weighted by extinction, so that a step's transparent side leaves no trace
        weight = extinction.reshape(-1, FINER)
        weight = np.where(weight.sum(axis=1, keepdims=True) > 0, weight, 1.0)
        table[1:-1, :3] = (color.reshape(-1, FINER, 3) * weight[..., None]).sum(axis=1) / weight.sum(axis=1)[:, None]
        table[1:-1, 3] = extinction.reshape(-1, FINER).mean(axis=1)
        # far below and above
        for entry, value in ((0, low - self.span), (-1, high + self.span)):
            table[entry, :3] = self.transfer.color(value)
            table[entry, 3] = self.transfer.extinction(self.transfer.opacity(value), unit)
        return table


def active_range(transfer: Transfer) -> tuple[float, float]:
    """The values between which opacity or colour varies."""
    ends = [transfer.points[0][0], transfer.points[-1][0], *(transfer.window or ())]
    return float(min(ends)), float(max(ends))


def opaque_intervals(transfer: Transfer) -> np.ndarray:
    """[n, 2]: closed intervals of values, ascending and disjoint, that contain all of non-zero opacity."""
    values = np.array([value for value, _ in transfer.points], np.float64)
    opacity = np.array([share for _, share in transfer.points], np.float64)
    starts = np.concatenate([[-np.inf], values])
    ends = np.concatenate([values, [np.inf]])
    before, after = np.append(opacity[0], opacity), np.append(opacity, opacity[-1])
    some = np.maximum(before, after) > 0
    found: list[list[float]] = []
    for start, end in zip(starts[some], ends[some], strict=True):
        if found and found[-1][1] >= start:
            found[-1][1] = end
        else:
            found.append([float(start), float(end)])
    return np.array(found, np.float64).reshape(-1, 2)
