"""Classification after reconstruction: running integrals of the transfer function.

The kernels reconstruct value and gradient; the transfer function classifies the reconstructed value. [Mueller, Möller &
Crawfis 1999] Values are linear along a step of a ray, whose extinction and emission are means over these values:
differences of one running integral. [Engel, Kraus & Ertl 2001, without the table of pairs]
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from splatgl.data.fills import distinct
from splatgl.transfer.regions import ABOVE, OPAQUE, mean_matter
from splatgl.transfer.transfer import Transfer

# largest value of a running integral in whole numbers: differences fit into 32 bits with a sign
WHOLE = 2**31 - 1
# cells between two points of a transfer function, however close
PARTS = 64
# cells beside a point of opacity 1 count as opaque if their opacity is at most this much lower
TIP = 1e-3
# rounding of opacities at the ends of cells
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
        """Integrates a transfer function over at least `cells` cells from low to high, PARTS between two points."""
        place = np.arange(cells + 1) / cells
        points = distinct(np.array([low, high, *(value for value in transfer.bends if low < value < high)]))
        part = np.arange(PARTS)[:, None] / PARTS
        between = points[:-1] * (1 - part) + points[1:] * part
        knots = distinct(np.concatenate([low * (1 - place) + high * place, between.ravel()]))
        start, width = knots[:-1], np.diff(knots)
        # two points within a cell, as a value at a step is on its upper side; exact where it is linear
        opaque = _is_beside_opaque(transfer, start, width, (high - low) / cells)
        near, far = (_emission(transfer, start + share * width, opaque) for share in (0.25, 0.75))
        mean = (near + far) / 2
        slope = np.clip(far - near, -mean, mean)
        below = np.concatenate([np.zeros((1, 4)), np.cumsum(mean * width[:, None], axis=0)])
        outside = _emission(transfer, np.array([low - (high - low), high + (high - low)]))
        return cls(knots, below, mean - slope, mean + slope, outside)

    def until(self, values: np.ndarray) -> np.ndarray:
        """[N, 4]: integrals from the first knot to values [N]; negative below the knot."""
        cell = self._cells(values)
        inside = np.clip(values, self.knots[0], self.knots[-1])
        part = inside - self.knots[cell]
        share = (part / (self.knots[cell + 1] - self.knots[cell]))[:, None]
        low, high = self.low[cell], self.high[cell]
        beyond = np.where((values < inside)[:, None], self.outside[0], self.outside[1])
        within = part[:, None] * (low + share * (high - low) / 2)
        return np.asarray(self.below[cell] + within + (values - inside)[:, None] * beyond)

    def mean(self, first: np.ndarray, last: np.ndarray) -> np.ndarray:
        """[N, 4]: means over the values from first to last [N], in either order."""
        apart = last - first
        cell = self._cells(first)
        width = self.knots[cell + 1] - self.knots[cell]
        middle = (first + last) / 2
        share = ((middle - self.knots[cell]) / width)[:, None]
        same = self.low[cell] + share * (self.high[cell] - self.low[cell])
        same = np.where((middle < self.knots[0])[:, None], self.outside[0], same)
        same = np.where((middle >= self.knots[-1])[:, None], self.outside[1], same)
        end = self._cells(last)
        alike = (apart == 0) | ((end == cell) & (self._outside(first) == self._outside(last)))
        some = np.flatnonzero(~alike)
        turned = apart[some] < 0
        low, high = np.where(turned, last[some], first[some]), np.where(turned, first[some], last[some])
        cells = np.where(turned, end[some], cell[some]), np.where(turned, cell[some], end[some])
        same[some] = self._between(low, high, *cells) / (high - low)[:, None]
        return np.maximum(same, 0.0)

    def _between(self, low: np.ndarray, high: np.ndarray, first: np.ndarray, last: np.ndarray) -> np.ndarray:
        """[N, 4]: integrals from low to high [N], in cells `first` and `last` that differ, or beyond the ends: sums of
        parts, as differences of integrals from the first knot lose all digits of values close together beside a knot.
        """
        below, above = low < self.knots[0], high >= self.knots[-1]
        rest = np.where(below, 0.0, self.knots[first + 1] - low)[:, None]
        part = np.where(above, 0.0, high - self.knots[last])[:, None]
        width = np.diff(self.knots)[:, None]
        slope = (self.high - self.low) / width / 2
        whole = self.below[np.where(above, len(width), last)] - self.below[np.where(below, 0, first + 1)]
        ends = rest * (self.high[first] - rest * slope[first]) + part * (self.low[last] + part * slope[last])
        beyond = np.where(below, self.knots[0] - low, 0.0)[:, None] * self.outside[0]
        beyond += np.where(above, high - self.knots[-1], 0.0)[:, None] * self.outside[1]
        return np.asarray(whole + ends + beyond)

    def table(self, cells: int) -> tuple[np.ndarray, float]:
        """uint32 [cells + 1, 4]: integrals from the first knot to the ends of `cells` equal cells, per cell width; and
        their unit.
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


def _is_beside_opaque(transfer: Transfer, start: np.ndarray, width: np.ndarray, reach: float) -> np.ndarray:
    """bool [n]: nearly opaque cells within `reach` of a value of opacity 1. Their mean extinction would be too low for
    matter of exactly that value, since extinction rises without limit there.
    """
    quarter, half, last = (transfer.opacity(start + share * width) for share in (0.25, 0.5, 0.75))
    ends = np.stack([quarter + (quarter - last) / 2, last + (last - quarter) / 2])
    tips = distinct(np.stack([start, start + width])[ends >= OPAQUE - ROUNDING])
    if not tips.size:
        return np.zeros(len(start), bool)
    after = np.clip(np.searchsorted(tips, start), 0, len(tips) - 1)
    apart = np.minimum(np.abs(tips[after] - start - width), np.abs(start - tips[np.maximum(after - 1, 0)]))
    return np.asarray((apart <= reach) & (half >= OPAQUE - TIP))


def _emission(transfer: Transfer, values: np.ndarray, opaque: np.ndarray | None = None) -> np.ndarray:
    """[N, 4]: extinction · linear RGB, and extinction, per reference length, of values [N]. opaque: which of them have
    opacity 1.
    """
    opacity = transfer.opacity(values)
    extinction = transfer.extinction(opacity if opaque is None else np.where(opaque, 1.0, opacity), 1.0)[:, None]
    return np.concatenate([transfer.color(values) * extinction, extinction], axis=1)


# cells of the classification table, and of the table of gradient weights
CELLS, WEIGHTS = 2**14, 2**10
# limit of record values, in ranges of the transfer function, so that means stay finite in float32
FURTHEST = 2.0**20
# least range of a transfer function relative to its largest record value: two float32 numbers per table cell
RESOLVED = 2.0**-9
# intervals shrink by this share of the transfer function's range at ends of zero opacity, so that float64 resolves it
INWARDS = 2.0**-51


@dataclass(frozen=True, eq=False)
class ValueClassifier:
    """Classifies reconstructed values by `transfer`. kernel: name of the kernel whose coefficients the records hold.

    shape: voxels along x, y, z; rays end at the box of their cells. low, span: record values are (ρ − low)/span.
    kept [n, 3]: intervals of values around which voxels were kept, and the least gradient near them, values per world
    length. lean: without the voxels that only the rims of kernels need. faced: gradients at the volume's ends assume
    transparent neighbours, which lights the end faces; not if opacity varies by gradient, as it would show them.
    largest: whether all voxels were kept that any place of such a value depends on, as maxima need them.
    """

    transfer: Transfer
    kernel: str
    shape: tuple[int, int, int]
    low: float
    span: float
    kept: np.ndarray
    lean: bool = False
    faced: bool = True
    largest: bool = False

    @classmethod
    def of(
        cls, transfer: Transfer, kernel: str, shape: tuple[int, int, int], every: bool = False, largest: bool = False
    ) -> ValueClassifier:
        """Classifier with record values relative to the range over which the transfer function varies. largest: for
        maxima, which only values from the least opaque one on affect.
        """
        low, high = active_range(transfer)
        span = high - low if high > low else max(abs(low), 1.0)
        kept = np.array([[-np.inf, np.inf, 0.0]]) if every else wanted_intervals(transfer, span)
        if largest:
            kept = np.array([[kept[:, 0].min(initial=np.inf), np.inf, 0.0]])
        return cls(transfer, kernel, shape, low, span, kept, faced=not transfer.varies_by_gradient, largest=largest)

    @property
    def every(self) -> bool:
        """Whether voxels of all values are kept."""
        return bool(np.isinf(self.kept[:, :2]).all(axis=1).any())

    @property
    def wanted(self) -> np.ndarray:
        """[n, 2]: intervals of record values around which voxels are kept."""
        return np.asarray((self.kept[:, :2] - self.low) / self.span)

    @property
    def steepness(self) -> np.ndarray:
        """[n]: least gradients near these, record values per world length; 0: any."""
        return np.asarray(self.kept[:, 2] / self.span)

    def relative(self, values: np.ndarray) -> np.ndarray:
        """Record values, float32, of samples [...]."""
        with np.errstate(over="ignore"):
            u = (np.asarray(values, np.float64) - self.low) / self.span
        return np.clip(u, -FURTHEST, FURTHEST).astype(np.float32)

    def value(self, u: np.ndarray) -> np.ndarray:
        """Values ρ of record values u [...]."""
        return np.asarray(self.low + np.asarray(u, np.float64) * self.span)

    def with_transfer(self, transfer: Transfer) -> ValueClassifier:
        """Classifier of the same records by another transfer function."""
        return replace(self, transfer=transfer)

    def holds(self, transfer: Transfer) -> bool:
        """Whether the records serve another transfer function: they contain all voxels that it needs, and resolve its
        range.
        """
        low, high = self.with_transfer(transfer).range
        furthest = max(abs(low), abs(high))
        resolved = furthest <= FURTHEST and high - low >= RESOLVED * furthest
        starts, ends, least = self.kept.T
        slack = 2 * INWARDS * self.span * max(high - low, 1.0)
        wanted = wanted_intervals(transfer, self.span)
        covered = ((starts - slack <= a) & (b <= ends + slack) & (least <= size) for a, b, size in wanted)
        resolved &= self.faced != transfer.varies_by_gradient
        return resolved and all(interval.any() for interval in covered)

    @property
    def is_current(self) -> bool:
        """Whether extraction for the current transfer function would give the same records."""
        anew = ValueClassifier.of(self.transfer, self.kernel, self.shape, self.every and not self.largest, self.largest)
        same = (anew.low, anew.span, anew.faced) == (self.low, self.span, self.faced)
        return same and np.array_equal(anew.kept, self.kept)

    def around(self, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Record values [N] to assume beyond the ends beside voxels of u [N], and which u are opaque; see
        `nearest_transparent`.
        """
        return nearest_transparent((opaque_intervals(self.transfer) - self.low) / self.span, u)

    @cached_property
    def surfaces(self) -> tuple[np.ndarray, np.ndarray]:
        """Record values [n], ascending, of the iso-surfaces; their emission and optical depth [n, 4]."""
        levels = surface_levels(self.transfer, self.span)
        return (levels - self.low) / self.span, self.transfer.surface_matter()

    @cached_property
    def range(self) -> tuple[float, float]:
        """Record values of the table's ends."""
        low, high = active_range(self.transfer)
        return (low - self.low) / self.span, (max(high, low + self.span * 1e-6) - self.low) / self.span

    @cached_property
    def scale(self) -> tuple[float, float]:
        """(a, b): record value u is at a u + b in the table, in cells. A transfer function of one value, at which
        colour or opacity may be a step, has it in the middle of the first cell: a value stands for the mean over one.
        Not if the table cannot tell it from 0.
        """
        low, high = self.range
        a, (least, largest) = CELLS / (high - low), active_range(self.transfer)
        is_single = least == largest and not 0 < abs(least) < self.span * (high - low)
        return a, (0.5 if is_single else 0.0) - low * a

    def places(self, values: np.ndarray) -> np.ndarray:
        """Places of values ρ in the table, in cells."""
        a, b = self.scale
        return np.asarray((values - self.low) / self.span * a + b)

    @cached_property
    def window_share(self) -> tuple[float, float]:
        """(a, b): record value u is at the share a u + b of the colours' window, or without one 0 up to it."""
        low, high = self.transfer.color_range
        width = high - low or self.span
        return self.span / width, (self.low - low) / width

    @cached_property
    def integral(self) -> ClassIntegral:
        """Integral of the transfer function over `range`, in values ρ."""
        low, high = (float(self.value(np.array(u))) for u in self.range)
        return ClassIntegral.of(self.transfer, low, high, CELLS)

    @cached_property
    def table(self) -> tuple[np.ndarray, float]:
        """uint32 [CELLS + 1, 4] and its unit; see `ClassIntegral.table`."""
        return self.integral.table(CELLS)

    @cached_property
    def seen(self) -> tuple[float, float]:
        """Range of the table, in cells, outside which all is transparent; infinite at ends beyond which it is not."""
        some = np.flatnonzero((np.diff(self.table[0].astype(np.int64), axis=0) != 0).any(axis=1))
        before, behind = (self.integral.outside != 0).any(axis=1)
        low, high = (some[0], some[-1] + 1) if some.size else (CELLS, 0)
        for region in self.transfer.regions:
            ends = self.places(np.array(region.values))
            low, high = min(low, ends[0]), max(high, ends[1])
        return -np.inf if before else float(low), np.inf if behind else float(high)

    @cached_property
    def weights(self) -> tuple[np.ndarray, float, float]:
        """Weights, float32 [WEIGHTS + 1], of equidistant gradients; the first gradient, and the step; values per world
        length.
        """
        nodes = [size for size, _ in self.transfer.gradient]
        low, high = nodes[0], max(nodes[-1], nodes[0] * (1 + 1e-6)) or self.span * 1e-6
        sizes = np.linspace(low, high, WEIGHTS + 1)
        # a value at a step is on its upper side; the table begins on the lower one
        sizes[0] = np.nextafter(low, -np.inf)
        return self.transfer.weight(sizes).astype(np.float32), low, (high - low) / WEIGHTS

    @cached_property
    def image(self) -> tuple[np.ndarray, float]:
        """uint32 [rows, columns + 1, 4]: integrals of the rows of the regions' image up to the ends of its pixels, in
        pixels, and their unit; no rows without an image.
        """
        below = next((region.below for region in self.transfer.regions if region.is_image), np.zeros((0, 1, 4)))
        unit = float(below.max(initial=0.0)) / WHOLE or 1.0
        return np.rint(below / unit).astype(np.uint32), unit

    def mean_regions(self, first: np.ndarray, last: np.ndarray, spacing: float) -> np.ndarray:
        """[N, 4]: emission and extinction of the regions over straight lines from `first` to `last`: record values, and
        magnitudes of their gradients per mean spacing, [2, N]. spacing: the mean one, world units.
        """
        ends = [np.stack([self.value(u), size * (self.span / spacing)]) for u, size in (first, last)]
        return mean_matter(self.transfer.regions, ends[0], ends[1])

    def extinction(self, u: np.ndarray) -> np.ndarray:
        """Extinctions per reference length, float64, of record values u [N]; means over the table's cells."""
        table, unit = self.table
        a, b = self.scale
        cell = np.floor(a * np.asarray(u, np.float64) + b)
        inside = np.clip(cell, 0, CELLS - 1).astype(np.int64)
        mean = (table[inside + 1, 3] - table[inside, 3]) * unit
        return np.select([cell < 0, cell >= CELLS], list(self.integral.outside[:, 3]), mean)


def active_range(transfer: Transfer) -> tuple[float, float]:
    """Range of values in which opacity or colour varies, or that has iso-surfaces."""
    ends = [transfer.points[0][0], transfer.points[-1][0], *(transfer.window or ())]
    ends += [surface.value for surface in transfer.iso]
    ends += [value for region in transfer.regions for value in region.values if np.isfinite(value)]
    return float(min(ends)), float(max(ends))


def surface_levels(transfer: Transfer, span: float) -> np.ndarray:
    """Values [n] above which the field is inside the iso-surfaces. span: range of values of the transfer function."""
    return np.array([surface.value for surface in transfer.iso], np.float64) + ABOVE * span


def wanted_intervals(transfer: Transfer, span: float) -> np.ndarray:
    """[n, 3]: closed intervals of the values with non-zero opacity or an iso-surface, and their least gradients, values
    per world length. span: as of `surface_levels`.
    """
    levels = surface_levels(transfer, span)
    intervals = np.concatenate([opaque_intervals(transfer, 0.0), np.stack([levels, levels], axis=1)])
    steep = [region for region in transfer.regions if region.densest > 0 and region.gradients[0] > 0]
    rows = [(*region.values, region.gradients[0]) for region in steep]
    return np.concatenate([np.pad(intervals, ((0, 0), (0, 1))), np.reshape(rows, (-1, 3))])


def opaque_intervals(transfer: Transfer, steepest: float = np.inf) -> np.ndarray:
    """[n, 2]: ascending, disjoint, closed intervals of values with non-zero opacity at a gradient up to `steepest`."""
    opaque = [region for region in transfer.regions if region.densest > 0 and region.gradients[0] <= steepest]
    of_regions = np.reshape([region.values for region in opaque], (-1, 2))
    return _merge(np.concatenate([_of_points(transfer), of_regions]))


def _of_points(transfer: Transfer) -> np.ndarray:
    """[n, 2]: intervals of the values at which the transfer function's points are opaque."""
    values = np.array([value for value, _ in transfer.points], np.float64)
    opacity = np.array([share for _, share in transfer.points], np.float64)
    starts = np.concatenate([[-np.inf], values])
    ends = np.concatenate([values, [np.inf]])
    before, after = np.append(opacity[0], opacity), np.append(opacity, opacity[-1])
    some = np.maximum(before, after) > 0
    intervals = _merge(np.column_stack([starts[some], ends[some]]))
    # ends of zero opacity are excluded, also as record values: samples outside objects often have exactly that value
    opaque = transfer.opacity(np.clip(intervals, values[0], values[-1])) > 0
    by = np.maximum(np.spacing(np.abs(intervals)), INWARDS * (values[-1] - values[0])) * np.array([1, -1])
    return np.where(opaque, intervals, intervals + by)


def _merge(intervals: np.ndarray) -> np.ndarray:
    """[n, 2]: ascending, disjoint intervals that cover those of [m, 2]."""
    merged: list[list[float]] = []
    for start, end in sorted(intervals.tolist()):
        if merged and merged[-1][1] >= start:
            merged[-1][1] = max(end, merged[-1][1])
        else:
            merged.append([start, end])
    return np.array(merged, np.float64).reshape(-1, 2)


def nearest_transparent(opaque: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Replaces values [N] in the closed intervals `opaque` [n, 2] by the nearest transparent ones, if there are any;
    also returns which were opaque, bool [N].
    """
    nearest_clear, within = values.astype(np.float64), np.zeros(len(values), bool)
    # limits of numpy's type: Python's numbers would be rounded to the values' type
    for low, high in opaque:
        inside = (values >= low) & (values <= high)
        # just outside the closed interval
        below, above = np.nextafter([low, high], [-np.inf, np.inf])
        nearest = np.where(values - low <= high - values, below, above)
        np.copyto(nearest_clear, nearest, where=inside & np.isfinite(nearest))
        within |= inside
    return nearest_clear, within


def clear_isolated(gradient: np.ndarray, gone: np.ndarray, opaque: np.ndarray) -> np.ndarray:
    """Sets gradients [N, 3] of isolated opaque voxels to 0, as these have no face, and returns them.

    gone bool [2, N, 3]: whether the neighbour before and behind is missing. opaque bool [N].
    """
    gradient[opaque & gone.all(axis=(0, 2))] = 0.0
    return gradient
