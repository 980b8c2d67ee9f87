"""`Points`: positions without a grid, with colours and sizes of their own; the spacing of a cloud; classes of sizes."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np

from splatgl.data.volume import LEAST_LENGTH
from splatgl.errors import expected

# points whose neighbours are searched, and neighbours of each
SAMPLED, NEIGHBOURS = 512, 8
# share of the points at either end of an axis that are left out: scans have outliers
OUTLIERS = 0.01
# side of the first cells of the search, in those that would hold one point each if all filled their box
FIRST = 0.25
# most classes of sizes; sizes within this factor are equal if there are more of them
MOST_SIZES, ALIKE = 7, 1.1
# relative rounding of sizes that are equal
ROUNDING = 1e-4


@dataclass(frozen=True, eq=False)
class Points:
    """Points at world positions. places: float64 [N, 3], finite. colors: linear RGB, float32 [N, 3]. size: their
    diameter, world units, at which their opacity is ½.
    """

    places: np.ndarray
    colors: np.ndarray
    size: float

    def __post_init__(self) -> None:
        count = len(self.places)
        if self.places.shape != (count, 3) or self.colors.shape != (count, 3):
            raise expected("points", "positions and colours [N, 3]", f"{self.places.shape}, {self.colors.shape}")
        if not count:
            raise expected("points", "at least one with finite coordinates", "none")
        if not 0 < self.size < np.inf:
            raise expected("size of points", "a positive length", self.size)

    def __len__(self) -> int:
        return len(self.places)

    @property
    def bounds(self) -> np.ndarray:
        """Minimum and maximum coordinates [2, 3]."""
        return np.array([self.places.min(axis=0), self.places.max(axis=0)])


def size_classes(sizes: np.ndarray) -> list[tuple[float, np.ndarray]]:
    """Up to MOST_SIZES sizes for sizes [N], and the numbers of the points of each: the sizes themselves, or of more of
    them classes that are evenly spaced by their factor.
    """
    low, high = float(sizes.min()), float(sizes.max())
    known, number = np.unique(np.rint(np.log(sizes) / ROUNDING), return_inverse=True)
    if len(known) <= MOST_SIZES:
        return [(float(np.median(sizes[number == n])), np.flatnonzero(number == n)) for n in range(len(known))]
    count = min(int(np.ceil(np.log(high / low) / np.log(ALIKE))), MOST_SIZES)
    if count < 2:
        return [(float(np.sqrt(low * high)), np.arange(len(sizes)))]
    step = (high / low) ** (1 / count)
    number = np.clip(np.log(sizes / low) / np.log(step), 0, count - 1).astype(int)
    members = [(low * step ** (n + 0.5), np.flatnonzero(number == n)) for n in range(count)]
    return [(size, which) for size, which in members if len(which)]


def median_spacing(places: np.ndarray) -> float:
    """Median distance of neighbours on a surface through points [N, 3]: that of a square lattice as dense as the disc
    of NEIGHBOURS points. Of fewer points by fewer; 1 for points all in one place.
    """
    low = np.quantile(places, OUTLIERS, axis=0, method="lower")
    high = np.quantile(places, 1 - OUTLIERS, axis=0, method="higher")
    places = places[((places >= low) & (places <= high)).all(axis=1)]
    count = min(NEIGHBOURS, len(places) - 1)
    extent = np.ptp(places, axis=0)
    longest = float(extent.max())
    if count < 1 or longest < LEAST_LENGTH:
        return 1.0
    sides = np.maximum(extent, longest / len(places))
    cell = max(FIRST * float(np.prod(sides / longest) / len(places)) ** (1 / 3) * longest, longest / 2**20)
    sample = places[:: max(len(places) // SAMPLED, 1)]
    while True:
        distance = _neighbour_distances(places, sample, cell, count)
        middle = float(np.median(distance))
        # farther neighbours may lie beyond the cells around
        if middle <= cell or cell >= longest:
            near = middle if np.isfinite(middle) and middle > 0 else longest / len(places)
            return near * float(np.sqrt(np.pi / count))
        cell *= 2


def _neighbour_distances(places: np.ndarray, sample: np.ndarray, cell: float, count: int) -> np.ndarray:
    """Distances [M] from sampled points to their neighbour number `count`, among those in the 27 cells around; infinite
    if these hold fewer.
    """
    low = places.min(axis=0)
    counts = np.floor(np.ptp(places, axis=0) / cell).astype(np.int64) + 3
    factors = np.array([1, counts[0], counts[0] * counts[1]])

    def keys(of: np.ndarray) -> np.ndarray:
        # one cell is free around all
        return np.asarray((np.floor((of - low) / cell).astype(np.int64) + 1) @ factors)

    all_keys = keys(places)
    order = np.argsort(all_keys, kind="stable")
    # three cells along x at a time, in nine rows [M, 9]
    middle = keys(sample)[:, None] + [y * factors[1] + z * factors[2] for y, z in product((-1, 0, 1), repeat=2)]
    begin = np.searchsorted(all_keys[order], middle - 1, "left")
    end = np.searchsorted(all_keys[order], middle + 1, "right")
    result = np.full(len(sample), np.inf)
    for n, ends in enumerate(zip(begin.tolist(), end.tolist(), strict=True)):
        near = np.concatenate([order[first:last] for first, last in zip(*ends, strict=True)])
        if len(near) > count:
            squared = ((places[near] - sample[n]) ** 2).sum(axis=1)
            result[n] = np.sqrt(np.partition(squared, count)[count])
    return result
