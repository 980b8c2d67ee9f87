"""`GridView`: a grid seen by a camera, in float64; ellipses of kernels, and slabs of depth.

Ellipses are twins of `shaders/ellipse.glsl`; vectors are [3, N].

Lengths are in mean voxel spacings s̄, in eye axes (right, down, forward). A voxel's kernel is
h(A⁻¹(x − v)), of unit volume, A = eye_from_index/s̄. Antialiasing widens it across the view: along the
axes u_i of A's first two rows, of half widths σ_i, an offset shrinks by (σ_i/p)(z_v/z) where p, a pixel's
side at the voxel's depth z_v times the blur's width, is longer than σ_i.

Antialiasing jumps by O(1/z_k) at the depth where widening begins: voxels at exactly that depth would be widened in one
precision and not in the other. The depth is increased slightly, into a gap between splats wider than float32's error.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from splatgl.geometry.camera import Camera
from splatgl.geometry.grid import Grid, ranges

if TYPE_CHECKING:
    from splatgl.splat.kernels import Kernel
    from splatgl.splat.splats import Splats


class Ellipse(NamedTuple):
    """Half axes of a kernel of unit radius, projected on a plane: unit vectors [3, N]; width [2, N], σ₁ ≥ σ₂."""

    axis_1: np.ndarray
    axis_2: np.ndarray
    width: np.ndarray


def perpendicular_axes(unit: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Two unit vectors perpendicular to the unit vectors [3, N] and to each other."""
    x, y, z = unit
    s = np.where(z < 0, -1.0, 1.0)
    a = -1 / (s + z)
    b = x * y * a
    return np.stack([1 + s * x * x * a, s * b, -s * x]), np.stack([b, s + y * y * a, -y])


def smallest_axis(view: GridView, z: np.ndarray) -> np.ndarray:
    """Antialiasing's smallest half axis p at depth z [N]; 0 without antialiasing.  [M98 Eq. 3]"""
    return view.filter_side(np.maximum(z, 0.0)) if view.antialias else np.zeros(np.shape(z))


def voxel_ellipse(eye_from_index: np.ndarray, e1: np.ndarray, e2: np.ndarray) -> Ellipse:
    """The voxel's ellipse on the planes of the unit vectors e1 and e2: eigenvectors of the rows' products."""
    row_1, row_2 = eye_from_index.T @ e1, eye_from_index.T @ e2
    square_1, square_2, mixed = ((a * b).sum(axis=0) for a, b in ((row_1, row_1), (row_2, row_2), (row_1, row_2)))
    angle = 0.5 * np.arctan2(2 * mixed, square_1 - square_2)
    root = np.hypot((square_1 - square_2) / 2, mixed)
    # the widths' product from the cross product, without cancellation for flat voxels
    cross = np.cross(row_1, row_2, axis=0)
    area = np.sqrt((cross * cross).sum(axis=0))
    width_1 = np.sqrt((square_1 + square_2) / 2 + root)
    axis_1 = e1 * np.cos(angle) + e2 * np.sin(angle)
    axis_2 = e2 * np.cos(angle) - e1 * np.sin(angle)
    return Ellipse(axis_1, axis_2, np.stack([width_1, area / width_1]))


def tangents(
    x: np.ndarray | float, z: np.ndarray | float, step: np.ndarray, deep: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Differences, below and above x/z, of the slopes s at which planes through the eye touch an ellipsoid at (x, z).

    step, deep: components [3, ...] of its half axes along the picture and along depth. (x − s z)² = |step − s deep|².
    """
    a, b, c = z * z - dot(deep, deep), x * z - dot(step, deep), x * x - dot(step, step)
    middle, root = b - a * x / z, np.sqrt(np.maximum(b * b - a * c, 0.0))
    return (root - middle) / a, (root + middle) / a


def dot(a: Sequence[np.ndarray] | np.ndarray, b: Sequence[np.ndarray] | np.ndarray) -> np.ndarray:
    """Dot products [...] of vectors given by their three components [...]."""
    return np.asarray(a[0] * b[0] + a[1] * b[1] + a[2] * b[2])


def centres_between(splats: Splats, view: GridView, low: float, high: float) -> np.ndarray:
    """[3, N]: the centres, eye axes in mean spacings, of the splats whose depth is from `low` to `high`."""
    # depth is linear along a row; points may be anywhere in their cells
    start = splats.row_start
    ends = np.stack([splats.records["position"][start[:-1]], splats.records["position"][start[1:] - 1]])
    steps = view.eye_from_index[2]
    depth = (ends.astype(np.float64) - view.eye_index) @ steps
    slack = np.abs(steps).sum()
    rows = np.flatnonzero((depth.max(axis=0) + slack >= low) & (depth.min(axis=0) - slack <= high))
    member = ranges(start[rows], start[rows + 1] - start[rows])
    centres = view.voxels(splats.records["position"][member])
    return np.asarray(centres[:, (centres[2] >= low) & (centres[2] <= high)])


# a kernel is widened only from this many of its reaches in depth on
WIDEN_BEYOND = 3.0


def eye_from_index(grid: Grid, camera: Camera) -> np.ndarray:
    """[3, 3]: A, the grid's steps in eye axes and mean spacings."""
    return np.asarray(camera.eye_from_world @ grid.world_from_index / grid.mean_spacing)


@dataclass(frozen=True, eq=False)
class GridView:
    """A grid seen by a camera. eye_from_index [3, 3]: A. pitch: a pixel's side at depth 1, or everywhere.

    eye_index [3]: the eye in grid indices. size: pixels along x and y. antialias: whether widths below p are widened.
    beyond: depths from which σ_1 and σ_2 are widened; None: from where p is wider. blur: p in pixels.
    """

    kernel: Kernel
    eye_from_index: np.ndarray
    eye_index: np.ndarray
    pitch: float
    size: tuple[int, int]
    perspective: bool
    antialias: bool
    beyond: tuple[float, float] | None = None
    blur: float = 1.0

    @classmethod
    def of(cls, grid: Grid, camera: Camera, kernel: Kernel, antialias: bool = True, blur: float = 1.0) -> GridView:
        """The view of `grid` by `camera`; lengths in the grid's mean spacing."""
        spacing = grid.mean_spacing
        pitch = camera.extent / camera.size[1] / (1.0 if camera.perspective else spacing)
        a = eye_from_index(grid, camera)
        eye = grid.index_from_world(camera.eye)
        return cls(kernel, a, eye, pitch, camera.size, camera.perspective, antialias, blur=blur)

    def voxels(self, positions: np.ndarray) -> np.ndarray:
        """Centres v [3, N] of splats at grid positions [N, 3]."""
        # whole rows of each component, as numpy multiplies them ten times faster than triples
        offsets = np.subtract(positions.T, self.eye_index[:, None], dtype=np.float64, order="C")
        return np.asarray(self.eye_from_index @ offsets)

    def box(self, splats: Splats) -> np.ndarray:
        """Corners [3, 8] of the box of all splats, half a voxel larger."""
        return self.voxels(splats.corners_in_grid(0.5))

    @property
    def edge(self) -> np.ndarray:
        """[2]: slopes, or lengths, from the middle of the picture to its edges along x and y."""
        return np.array(self.size) / 2 * self.pitch

    @cached_property
    def index_from_eye(self) -> np.ndarray:
        """A⁻¹ [3, 3]: grid steps of an offset in eye axes, mean spacings."""
        return np.linalg.inv(self.eye_from_index)

    @cached_property
    def axes(self) -> np.ndarray:
        """[2, 2]: its columns u_1, u_2, the axes across the view along which a voxel is widened."""
        return np.linalg.svd(self.eye_from_index[:2])[0]

    @cached_property
    def widths(self) -> np.ndarray:
        """[2]: σ_1 ≥ σ_2, a voxel's half widths along them at the kernel's unit radius."""
        return np.linalg.svd(self.eye_from_index[:2])[1]

    @cached_property
    def depth_reach(self) -> float:
        """Half extent in depth of a kernel of unit radius."""
        return float(np.linalg.norm(self.eye_from_index[2]))

    @property
    def reach(self) -> float:
        """Half extent in depth of the kernel: an eye at least this far in front of the voxel is outside it."""
        return self.depth_reach * self.kernel.radius

    @cached_property
    def widened_beyond(self) -> tuple[float, float]:
        """Depths from which σ_1 and σ_2 are widened; ∞ for never.

        A kernel that reaches a third of the way to the eye's plane is not widened: rays diverge so much
        within it that no single width is right, and at the plane none exists.
        """
        if not self.antialias:
            return np.inf, np.inf
        if not self.perspective:
            first, second = (-np.inf if self.filter_pitch > width else np.inf for width in self.widths)
            return first, second
        first, second = (max(float(width) / self.filter_pitch, WIDEN_BEYOND * self.reach) for width in self.widths)
        return self.beyond or (first, second)

    def widened(self, z: np.ndarray) -> np.ndarray:
        """Whether antialiasing widens σ_1 and σ_2 at depth z [...]; bool [2, ...]."""
        return np.stack([np.asarray(z) > depth for depth in self.widened_beyond])

    def is_widened(self, z: np.ndarray) -> np.ndarray:
        """Whether antialiasing widens the voxel at depth z [...] at all; bool [...]."""
        return np.asarray(np.asarray(z) > self.widened_beyond[1])

    def pixel_side(self, z: np.ndarray) -> np.ndarray:
        """A pixel's side p at depth z [...]."""
        return self.pitch * np.asarray(z) if self.perspective else np.full(np.shape(z), self.pitch)

    @property
    def filter_pitch(self) -> float:
        """p at depth 1, or everywhere: the half width of antialiasing's low-pass  [M98 §6]."""
        return self.blur * self.pitch

    def filter_side(self, z: np.ndarray) -> np.ndarray:
        """p at depth z [...], below which no half width is."""
        return self.blur * self.pixel_side(z)

    def shrink(self, z: np.ndarray) -> np.ndarray:
        """[2, ...]: min(1, σ_i/p), the factors on offsets along the axes at the voxel's depth."""
        widened, p = self.widened(z), self.filter_side(z)
        some = widened.any(axis=0)
        widths = [np.minimum(width / np.where(some, p, 1.0), 1.0) for width in self.widths]
        return np.where(widened, np.stack(widths), 1.0)

    def coverage(self, z: np.ndarray) -> np.ndarray:
        """The unwidened footprint's share of the widened one's area: 1/m² [M98 Eq. 6] for cubic voxels."""
        return np.asarray(self.shrink(z).prod(axis=0))


# a depth is a sum of four float32 products: its error is at most this many ULPs of the largest
DIGITS = 8.0
ULP = 2.0**-24
# largest increase of the depth, relative
FURTHEST = 0.02


def widening(splats: Splats, view: GridView) -> tuple[tuple[float, float], float]:
    """Depths, mean spacings, from which σ_1 and σ_2 are widened, ∞ for never, of a view whose `beyond` is None; moved
    only in perspective views with antialiasing. And the relative jump of a splat if there is no gap, else 0.
    """
    first, second = view.widened_beyond
    if not (view.antialias and view.perspective and len(splats)):
        return (first, second), 0.0
    narrow, sure = _find_gap(splats, view, second)
    if first - second <= FURTHEST * second:
        return (narrow, narrow), 0.0 if sure else _jump(view, second)
    wide, sure_too = _find_gap(splats, view, first)
    return (wide, narrow), 0.0 if sure and sure_too else _jump(view, second)


def _find_gap(splats: Splats, view: GridView, depth: float) -> tuple[float, bool]:
    """The first depth ≥ `depth` without splats near it, and whether it exists; else the middle of the widest gap."""
    low, high = splats.index_bounds
    reach = np.abs(view.eye_from_index[2]) @ np.maximum(np.abs(low - view.eye_index), np.abs(high - view.eye_index))
    margin = DIGITS * ULP * float(reach + depth)
    furthest = max(FURTHEST * depth, 4 * margin)
    near = np.sort(centres_between(splats, view, depth - margin, depth + furthest)[2])
    # starts of the gaps; the first is before `depth`
    begins = np.concatenate([[depth - margin], near])
    gaps = np.append(near, depth + furthest) - begins
    wide = np.flatnonzero(gaps >= 2 * margin)
    if len(wide):
        return max(float(begins[wide[0]]) + margin, depth), True
    widest = int(np.argmax(gaps))
    return float(begins[widest] + gaps[widest] / 2), False


def _jump(view: GridView, depth: float) -> float:
    """Relative change of a splat where widening begins: the first-order term, else 1."""
    at_a_pixel = depth <= float(view.widths[1]) / view.filter_pitch * (1 + FURTHEST)
    return min(view.reach * view.kernel.radius / depth, 1.0) if at_a_pixel else 1.0
