"""The matter of a layer at points of the grid: of the splats that its picture draws, in float64."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Protocol, Self

import numpy as np

from splatgl.reference.sheets import weight_extinction
from splatgl.splat.kernels import BOX, Kernel
from splatgl.splat.kernels import kernel as kernel_named
from splatgl.splat.splats import Splats
from splatgl.transfer.preintegration import ClassIntegral, ValueClassifier
from splatgl.transfer.regions import crossed_depth, mean_matter

# points whose sums stay in the cache
POINTS = 1 << 13
# cells along the sides of blocks that rays skip
BLOCK = 4
# empty entries around splats on their lattice: any cell that a kernel reaches from outside has entries
PAD = 3
# entries of the table of a kernel over squared distances, and the largest squared distance
ENTRIES, FURTHEST = 1 << 18, 13.0

# of blocks of cells: whether they have anything visible, and bounds of the values at points in them
Blocks = tuple[np.ndarray, np.ndarray, np.ndarray]


class Cells:
    """Terms of splats on their lattice. terms: float32 arrays [Z, Y, X], 0 where no splat is. low [3]: grid position
    (x, y, z) of the first entry.
    """

    def __init__(self, positions: np.ndarray, terms: Sequence[np.ndarray | float]) -> None:
        cells = np.rint(positions).astype(np.int64)
        self.low = cells.min(axis=0) - PAD
        shape = (cells.max(axis=0) + PAD + 1 - self.low)[::-1]
        x, y, z = (cells - self.low).T
        self.terms = [np.zeros(shape, np.float32) for _ in terms]
        for array, term in zip(self.terms, terms, strict=True):
            array[z, y, x] = term

    @property
    def shape(self) -> tuple[int, ...]:
        """Entries along z, y, x."""
        return self.terms[0].shape

    def nearest(self, places: np.ndarray) -> np.ndarray:
        """The first term [P] of the cells around grid positions [3, P]; 0 beyond all."""
        x, y, z = (np.clip(np.rint(i).astype(np.int64) - a, 0, n - 1) for i, a, n in self._axes(places))
        return self.terms[0][z, y, x].astype(np.float64)

    def _axes(self, places: np.ndarray) -> Iterator[tuple[np.ndarray, int, int]]:
        return zip(places, self.low.tolist(), self.shape[::-1], strict=True)

    def sums(self, table: np.ndarray, places: np.ndarray) -> np.ndarray:
        """[n, P]: sums of the terms at grid positions [3, P], weighted by a kernel; table: as of `kernel_table`."""
        result = np.empty((len(self.terms), places.shape[1]))
        for first in range(0, places.shape[1], POINTS):
            some = slice(first, first + POINTS)
            result[:, some] = self._sums(table, places[:, some])
        return result

    def _sums(self, table: np.ndarray, places: np.ndarray) -> np.ndarray:
        squares, cells, offsets = [], [], np.arange(-1, 3)
        for place, low, size in self._axes(places):
            cell = np.clip(np.floor(place).astype(np.int64) - low, 1, size - 3)
            apart = (place - (cell + low)).astype(np.float32) - offsets[:, None].astype(np.float32)
            squares.append(np.minimum(apart * apart, np.float32(4)) * np.float32(ENTRIES / FURTHEST))
            cells.append(cell)
        _, height, width = self.shape
        first = (cells[2] * height + cells[1]) * width + cells[0] + offsets[:, None]
        totals = np.zeros((len(self.terms), places.shape[1]), np.float32)
        flat = [term.ravel() for term in self.terms]
        for k, j in np.ndindex(4, 4):
            # modes other than "raise" are faster; all entries exist
            weight = table.take((squares[0] + (squares[1][j] + squares[2][k])).astype(np.int64), mode="clip")
            entry = first + (offsets[k] * height + offsets[j]) * width
            for total, term in zip(totals, flat, strict=True):
                total += np.einsum("cp,cp->p", weight, term.take(entry, mode="clip"))
        return totals

    def blocks(self, extreme: np.ufunc, array: np.ndarray) -> np.ndarray:
        """Extremes of an array of entries over blocks of BLOCK entries and the blocks beside them."""
        for axis, size in enumerate(array.shape):
            array = extreme.reduceat(array, np.arange(0, size, BLOCK), axis=axis)
        for axis in range(3):
            padded = np.pad(array, [(int(n == axis),) * 2 for n in range(3)], mode="edge")
            array = extreme.reduce([padded.take(range(k, k + array.shape[axis]), axis) for k in range(3)])
        return np.asarray(array, np.float64)


def kernel_table(kernel: Kernel) -> np.ndarray:
    """float32 [ENTRIES]: a kernel at equidistant squared distances from 0 to FURTHEST."""
    middles = (np.arange(ENTRIES) + 0.5) * (FURTHEST / ENTRIES)
    return np.asarray(kernel.value(np.sqrt(middles)), np.float32)


class Matter(Protocol):
    """The matter of a layer, by its state at points: [n, P], the value first; NaN where there is none."""

    cells: Cells

    def at(self, places: np.ndarray) -> np.ndarray:
        """States [n, P] at grid positions [3, P]."""
        ...

    def between(self, first: np.ndarray, last: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Mean extinctions [P] per world length, and optical depths [P] of the iso-surfaces, from states to states."""
        ...

    def opacity(self, values: np.ndarray) -> np.ndarray:
        """Opacities [P] of values, as blends of one value show them."""
        ...

    def visible_blocks(self) -> Blocks:
        """Of blocks of cells: whether they have anything visible, and bounds of the values at points in them."""
        ...


@dataclass(frozen=True, eq=False)
class ValueMatter:
    """Values, and magnitudes of gradients per world length where opacity depends on them, that are classified after
    reconstruction: means of kernels.
    """

    cells: Cells
    post: ValueClassifier
    table: np.ndarray
    spacing: float
    unit: float

    @classmethod
    def of(cls, splats: Splats, some: np.ndarray | slice) -> Self:
        """Of some splats."""
        assert splats.post is not None
        records, post = splats.records[some], splats.post
        gradient = [*records["gradient"].T] if post.transfer.needs_gradients else list[np.ndarray]()
        cells = Cells(records["position"], [1.0, records["value"], *gradient])
        return cls(cells, post, kernel_table(kernel_named(post.kernel)), splats.grid.mean_spacing, splats.unit)

    def at(self, places: np.ndarray) -> np.ndarray:
        """States [1 or 2, P]: value, and magnitude of the gradient."""
        mass, *sums = self.cells.sums(self.table, places)
        mass[mass == 0] = np.nan
        states = [self.post.value(sums[0] / mass)]
        if len(sums) > 1:
            states.append(np.linalg.norm(sums[1:], axis=0) / mass * (self.post.span / self.spacing))
        return np.stack(states)

    @cached_property
    def _extinction(self) -> ClassIntegral:
        whole = self.post.integral
        parts = {name: getattr(whole, name)[:, 3:] for name in ("below", "low", "high", "outside")}
        return replace(whole, **parts)

    @cached_property
    def _surfaces(self) -> tuple[np.ndarray, np.ndarray]:
        values, matter = self.post.surfaces
        return self.post.value(values), matter[:, 3]

    def between(self, first: np.ndarray, last: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Of points without a value, the value is that of the other end."""
        first, last = np.where(np.isnan(first), last, first), np.where(np.isnan(last), first, last)
        known, transfer = np.isfinite(first[0]), self.post.transfer
        first, last = (np.where(known, state, 0.0) for state in (first, last))
        mean = self._extinction.mean(first[0], last[0])[:, 0]
        if transfer.gradient:
            mean = weight_extinction(mean, transfer.weight((first[1] + last[1]) / 2))
        if transfer.regions:
            mean = mean + mean_matter(transfer.regions, first, last)[:, 3]
        crossed = crossed_depth(*self._surfaces, first[0], last[0]) if transfer.iso else np.zeros(len(known))
        return np.where(known, mean / self.unit, 0.0), np.where(known, crossed, 0.0)

    def opacity(self, values: np.ndarray) -> np.ndarray:
        """By the transfer function."""
        return self.post.transfer.opacity(values)

    def visible_blocks(self) -> Blocks:
        """By all values between the coefficients around."""
        is_there, value = self.cells.terms[0] > 0, self.post.value(self.cells.terms[1])
        low = self.cells.blocks(np.minimum, np.where(is_there, value, np.inf))
        high = self.cells.blocks(np.maximum, np.where(is_there, value, -np.inf))
        some = low <= high
        if not self.post.transfer.regions:
            ends = np.stack([low[some], high[some]])[:, None]
            # surfaces lie between two values, too
            some[some] = sum(self._replaced().between(*ends)) > 0
        return some, low, high

    def _replaced(self) -> Self:
        """The same whose opacity no gradient weighs."""
        post = self.post.with_transfer(replace(self.post.transfer, gradient=()))
        return replace(self, post=post)


@dataclass(frozen=True, eq=False)
class VoxelMatter:
    """Extinctions per world length of voxels that are classified before reconstruction: sums of kernels, or without a
    kernel's table those of the boxes of labels.
    """

    cells: Cells
    table: np.ndarray | None
    unit: float

    @classmethod
    def of(cls, splats: Splats, some: np.ndarray | slice, kernel: Kernel) -> Self:
        """Of some splats."""
        records = splats.records[some]
        cells = Cells(records["position"], [records["optical_depth"] / splats.grid.mean_spacing])
        return cls(cells, None if kernel is BOX else kernel_table(kernel), splats.unit)

    def at(self, places: np.ndarray) -> np.ndarray:
        """States [1, P]: extinction."""
        return self.cells.nearest(places)[None] if self.table is None else self.cells.sums(self.table, places)

    def between(self, first: np.ndarray, last: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Means; there are no surfaces."""
        return (first[0] + last[0]) / 2, np.zeros(first.shape[1])

    def opacity(self, values: np.ndarray) -> np.ndarray:
        """Of extinctions, over the reference length."""
        return -np.expm1(-values * self.unit)

    def visible_blocks(self) -> Blocks:
        """Where a voxel is."""
        highest = self.cells.blocks(np.maximum, self.cells.terms[0])
        # sums of kernels may exceed all voxels
        return highest > 0, np.zeros_like(highest), np.where(highest > 0, np.inf, 0.0)
