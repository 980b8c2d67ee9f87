"""Sheets: slabs of equal distance from the eye, within which splats add up; the first ones are planes.

Sheets are spheres around the eye, planes in parallel views, in index space, where a kernel is a sphere: on any grid, a
ray passes a voxel at distance e at √(e² − D²). A splat belongs to `count` sheets with the weights of a B-spline of
degree count − 1, which add up to 1.  [Mueller & Crawfis 1998]

Near the eye √(e² − D²) differs by up to a third of a voxel from the sheet's place. The first sheets, and one behind the
eye, are therefore planes across each ray, to which voxels belong by the point where the ray passes them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from splatgl.geometry.grid import corners_of
from splatgl.geometry.view import GridView
from splatgl.splat.kernels import Kernel, depth_deviation, spectrum
from splatgl.splat.splats import Splats

# value of a cell without a splat; record values are smaller
ABSENT = float(np.float32(1e30))

# a box of voxels, low ≤ (x, y, z) < high
Box = tuple[np.ndarray, np.ndarray]


@dataclass(frozen=True, eq=False)
class NearField:
    """Voxels around the eye. low int64 [3]: the first voxel (x, y, z). cells float32 [D, H, W, 4]: gradients, and
    values or ABSENT. count: sheets from the eye on that are planes. around: kernel's reach, in voxels.
    """

    low: np.ndarray
    cells: np.ndarray
    count: int
    around: int

    @classmethod
    def of(cls, splats: Splats, view: GridView, sheets: Sheets) -> NearField | None:
        """The near field of splats; None if it is empty, or if splats are classified before reconstruction."""
        if splats.post is None or not len(splats):
            return None
        box = near_box(view, sheets, splats.index_bounds)
        if box is None:
            return None
        position = splats.records["position"]
        inside = np.ones(len(position), bool)
        for axis in (2, 1, 0):
            inside &= (position[:, axis] >= box[0][axis]) & (position[:, axis] < box[1][axis])
        return cls.of_records(splats.records[inside], box, view, sheets)

    @classmethod
    def of_records(cls, records: np.ndarray, box: Box, view: GridView, sheets: Sheets) -> NearField | None:
        """The near field of all records of a box of voxels; None without records."""
        if not len(records):
            return None
        low, high = box
        cells = np.zeros((*(high - low)[::-1], 4), np.float32)
        cells[..., 3] = ABSENT
        x, y, z = np.rint(records["position"]).astype(np.int64).T - low[:, None]
        cells[z, y, x, :3], cells[z, y, x, 3] = records["gradient"], records["value"]
        return cls(low, cells, sheets.near_count(view.kernel.radius), reach_of(view.kernel))


def reach_of(kernel: Kernel) -> int:
    """Reach of a kernel along an axis, rounded up to whole voxels."""
    return int(np.ceil(kernel.radius))


def near_box(view: GridView, sheets: Sheets, bounds: np.ndarray) -> Box | None:
    """The box of voxels on which the near field depends; None if no splat reaches it. bounds [2, 3]: least and largest
    grid position of splats.
    """
    if not view.perspective or not sheets.steps:
        return None
    radius, count = view.kernel.radius, sheets.near_count(view.kernel.radius)
    furthest = (count - 1) * sheets.thickness
    reach = max(furthest + radius, (count - 1 + sheets.count / 2) * sheets.thickness)
    if np.linalg.norm(view.eye_index - np.clip(view.eye_index, *bounds)) >= reach:
        return None
    around = reach_of(view.kernel)
    low = np.floor(view.eye_index - furthest).astype(np.int64) - around + 1
    return low, np.floor(view.eye_index + furthest).astype(np.int64) + around + 1


# mass below which a sheet has no value; EDGE is added to the weights of the three sheets around a place, so that there
# is a value wherever one of them has any: less than rounding, so that values do not jump
LEAST_MASS, EDGE = 0.02, 1e-12
# mass, relative to constant matter, from which on a sheet's value is moved to the sheet's place: partly, wholly
CENTERED = (0.85, 0.95)
# values within this many voxels of the first and last layer are not moved, as gradients there belong to faces; one
# voxel further inside they are moved wholly
AMID = 1.5
# maximum number of sheets of a picture; with more, splats are composited one by one; and the longest side of a volume,
# in voxels, whose sheets are numbered from its box
MOST_SHEETS, LONGEST = 2**15, 2**13
# least number of sheets from the eye on that are planes across each ray: spheres further away err by less than a tenth
# of a voxel
NEAR = 5


@dataclass(frozen=True)
class Sheets:
    """count: sheets that share a splat, 2 to 4. thickness: index units.

    steps: parts of a sheet's thickness, each classified once; 0: splats are classified before. variance: of the kernel
    in depth, voxels²; spectrum: its Fourier transform's coefficients. mass: of a sheet on a ray through even matter.
    """

    count: int
    thickness: float
    steps: int
    variance: float
    spectrum: tuple[float, float, float, float]
    mass: float

    @classmethod
    def of(cls, kernel: Kernel, count: int, steps: int) -> Sheets:
        """The sheets that spread a splat in depth with the kernel's deviation.

        Classified before: boxes of B-spline weights, of variance h² (n + 2)/12. After: points of variance h² (n +
        1)/12, interpolated by a quadratic B-spline of variance h²/4.
        """
        degree, deviation = count - 1, depth_deviation(kernel)
        variance = (degree + 2) / 12 if steps == 0 else (degree + 1) / 12 + 1 / 4
        thickness = deviation / float(np.sqrt(variance))
        mass = thickness / float(kernel.footprint(np.zeros(())))
        return cls(count, thickness, steps, deviation**2, spectrum(kernel), mass)

    def explain(self) -> str:
        """A description, one line."""
        how = f"classified after reconstruction, in {self.steps} parts each" if self.steps else "classified before"
        return f"sheets {self.thickness:.3g} voxels thick, {self.count} share a splat, {how}"

    def near_count(self, radius: float) -> int:
        """Number of sheets from the eye on that are planes across each ray. No splat of a further sheet is within the
        kernel's `radius` of the eye.
        """
        return max(NEAR, int(np.ceil(radius / self.thickness + self.count / 2)))

    def base(self, place: np.ndarray) -> np.ndarray:
        """int64 [N]: first sheets of splats at `place` [N], distance over thickness."""
        shift = 0.5 if self.count % 2 else 0.0
        return np.floor(np.asarray(place, np.float64) + shift).astype(np.int64) - (self.count - 1) // 2

    def weights(self, place: np.ndarray, base: np.ndarray) -> np.ndarray:
        """[count, N] weights of the sheets base, base + 1, …, of splats at `place` [N]."""
        return WEIGHTS[self.count](np.asarray(place, np.float64) - base)

    def shares(self, place: np.ndarray) -> np.ndarray:
        """[N] weights of sheet 0 of splats at `place` [N]."""
        number = -self.base(place)
        inside = (number >= 0) & (number < self.count)
        weights = self.weights(place, -number)
        weight = np.take_along_axis(weights, np.clip(number, 0, self.count - 1)[None], axis=0)[0]
        return np.asarray(np.where(inside, weight, 0.0))

    def layer_terms(self, direction: np.ndarray) -> np.ndarray:
        """[2, 2, 3, N]: errors of constant matter by its layers of voxels, for planes across each axis at their
        distance and at half of it: by how many sheets its mean place is before the sheet's, per sine of the place among
        the layers; and how much wider it is spread, sheets², per cosine. direction [3, N]: unit vectors, index axes.

        First terms of Poisson's sum over voxels: first and second derivative of the weights' Fourier transform at the
        planes' frequency along the ray, times the kernel's transform at the frequency across it.
        """
        terms = []
        for order in (1, 2):
            f = np.maximum(order * np.abs(direction) * self.thickness, 0.1)
            box = np.sinc(f)
            slope = (np.cos(np.pi * f) - box) / f
            bend = -(np.pi**2) * box - 2 * slope / f
            second = (self.count - 1) * slope**2 + box * bend
            apart = np.minimum(order**2 * (1 - direction**2), 1.0)
            across = np.polyval([*self.spectrum[::-1], 1.0], apart) ** 2
            share = self.count * box ** (self.count - 2) * across
            lag = -share * box * slope * np.sign(direction) / np.pi
            terms.append(np.stack([lag, -share * (second / (2 * np.pi**2) + box**2 / 6)]))
        return np.stack(terms)

    def places(self, view: GridView, positions: np.ndarray) -> np.ndarray:
        """Distances from the eye over thickness, float64 [N], of splats at grid positions [N, 3]."""
        if view.perspective:
            x, y, z = (
                np.subtract(positions[..., n], along, dtype=np.float64) for n, along in enumerate(view.eye_index)
            )
            return np.asarray(np.sqrt(x * x + y * y + z * z) / self.thickness)
        return (np.asarray(positions, np.float64) - view.eye_index) @ index_direction(view) / self.thickness

    def range(self, splats: Splats, view: GridView) -> tuple[int, int]:
        """Least and largest first sheet of all splats, from their box."""
        low, high = counted_box(splats)
        places = self.places(view, corners_of(low, high))
        if view.perspective:
            nearest = np.clip(view.eye_index, low, high)
            places = np.append(places, self.places(view, nearest[None]))
        # float32's rounding may move a splat by a sheet
        first, last = self.base(np.array([places.min(), places.max()]))
        return int(first) - 1, int(last) + 1


def counted_box(splats: Splats) -> np.ndarray:
    """[2, 3]: lowest and highest grid indices of the box from which sheets are numbered: around all splats; of values
    around the volume, so that numbers do not depend on the transfer function, unless the volume is too long.
    """
    bounds = splats.index_bounds
    if splats.post is None or not len(splats) or max(splats.post.shape) > LONGEST:
        return bounds
    return np.stack([np.minimum(bounds[0], 0.0), np.maximum(bounds[1], np.array(splats.post.shape) - 1.0)])


def index_direction(view: GridView) -> np.ndarray:
    """[3]: unit vector along a parallel view's rays, index axes."""
    along = view.index_from_eye[:, 2]
    return np.asarray(along / np.linalg.norm(along))


def layer_wave(place: np.ndarray) -> np.ndarray:
    """sin(2π place), to 1.2e-3, of grid positions along an axis."""
    x = 0.5 - (place - np.floor(place))
    x = x * (8 - 16 * np.abs(x))
    return np.asarray(x * (0.775 + 0.225 * np.abs(x)))


def _linear(t: np.ndarray) -> np.ndarray:
    f = np.clip(t, 0.0, 1.0)
    return np.stack([1 - f, f])


def _quadratic(t: np.ndarray) -> np.ndarray:
    g = np.clip(t - 1, -0.5, 0.5)
    return np.stack([0.5 * (0.5 - g) ** 2, 0.75 - g * g, 0.5 * (0.5 + g) ** 2])


def _cubic(t: np.ndarray) -> np.ndarray:
    g = np.clip(t - 1, 0.0, 1.0)
    q = 1 - g
    return np.stack([q**3 / 6, 2 / 3 - g * g * (1 - g / 2), 2 / 3 - q * q * (1 - q / 2), g**3 / 6])


# B-splines by their number of pieces, over the place relative to the base
WEIGHTS: dict[int, Callable[[np.ndarray], np.ndarray]] = {2: _linear, 3: _quadratic, 4: _cubic}
