"""The exact line integral of one splat along one pixel's ray: any affine grid, any camera, float64.

Lengths are in mean voxel spacings s̄, in eye axes (right, down, forward). A voxel's kernel is
h(A⁻¹(x − v)), of unit volume, A = eye_from_index/s̄. Antialiasing widens it across the view: along the
axes u_i of A's first two rows, of half widths σ_i, an offset shrinks by (σ_i/p)(z_v/z) where a pixel's
side p at the voxel's depth z_v is longer than σ_i. For cubic voxels this is [M98 Table 1 row 1].
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from splatgl.splat.camera import Camera
from splatgl.splat.kernel import Kernel
from splatgl.splat.path import Path
from splatgl.splat.rows import Grid

# a kernel is widened where its depth is at most this part of its distance
WIDEN_BEYOND = 3.0


@dataclass(frozen=True, eq=False)
class View:
    """A grid seen by a camera. eye_from_index [3, 3]: A. pitch: a pixel's side at depth 1, or everywhere.

    eye_index [3]: the eye in grid indices. antialias: whether p widens what is narrower.
    beyond: depths from which on σ_1 and σ_2 are widened; None: where p is wider, see `widening.py`.
    """

    kernel: Kernel
    eye_from_index: np.ndarray
    eye_index: np.ndarray
    pitch: float
    perspective: bool
    antialias: bool
    beyond: tuple[float, float] | None = None

    @classmethod
    def of(
        cls,
        grid: Grid,
        camera: Camera,
        kernel: Kernel,
        antialias: bool = True,
        beyond: tuple[float, float] | None = None,
    ) -> View:
        """The view of `grid` by `camera`; lengths in the grid's mean spacing."""
        spacing = grid.mean_spacing
        pitch = camera.extent / camera.size[1] / (1.0 if camera.perspective else spacing)
        a = camera.eye_from_world @ grid.world_from_index / spacing
        eye = grid.index_from_world(camera.eye)
        return cls(kernel, a, eye, pitch, camera.perspective, antialias, beyond)

    def voxels(self, positions: np.ndarray) -> np.ndarray:
        """Centres v [3, N] of splats at grid positions [N, 3]."""
        return np.asarray(self.eye_from_index @ (positions.astype(np.float64) - self.eye_index).T)

    @cached_property
    def index_from_eye(self) -> np.ndarray:
        return np.linalg.inv(self.eye_from_index)

    @cached_property
    def _across(self) -> tuple[np.ndarray, np.ndarray]:
        axes, widths, _ = np.linalg.svd(self.eye_from_index[:2])
        return axes, widths

    @property
    def axes(self) -> np.ndarray:
        """[2, 2]: its columns u_1, u_2, the axes across the view along which a voxel is widened."""
        return self._across[0]

    @property
    def widths(self) -> np.ndarray:
        """[2]: σ_1 ≥ σ_2, a voxel's half widths along them at the kernel's unit radius."""
        return self._across[1]

    @cached_property
    def depth_reach(self) -> float:
        """How far in depth a kernel of unit radius reaches."""
        return float(np.linalg.norm(self.eye_from_index[2]))

    @property
    def reach(self) -> float:
        """How far in depth the kernel reaches: an eye further before the voxel sees all of it."""
        return self.depth_reach * self.kernel.radius

    @cached_property
    def widened_beyond(self) -> tuple[float, float]:
        """Depths from which on σ_1 and σ_2 are widened: ∞ where they never are.

        A kernel that reaches a third of the way to the eye's plane is left alone: along it diverging rays
        change so much that no one width is right, and at the plane there is none.
        """
        if not self.antialias:
            return np.inf, np.inf
        if not self.perspective:
            first, second = (-np.inf if self.pitch > width else np.inf for width in self.widths)
            return first, second
        first, second = (max(float(width) / self.pitch, WIDEN_BEYOND * self.reach) for width in self.widths)
        return self.beyond or (first, second)

    def widened(self, z: np.ndarray) -> np.ndarray:
        """bool [2, ...]: whether antialiasing widens σ_1 and σ_2 at depth z [...]."""
        return np.stack([np.asarray(z) > depth for depth in self.widened_beyond])

    def pixel(self, z: np.ndarray) -> np.ndarray:
        """p at depth z [...]: a pixel's side."""
        return self.pitch * np.asarray(z) if self.perspective else np.full(np.shape(z), self.pitch)

    def shrink(self, z: np.ndarray) -> np.ndarray:
        """[2, ...]: min(1, σ_i/p), by which offsets along the axes shrink at the voxel's depth."""
        widened, p = self.widened(z), self.pixel(z)
        some = widened.any(axis=0)
        widths = [np.minimum(width / np.where(some, p, 1.0), 1.0) for width in self.widths]
        return np.where(widened, np.stack(widths), 1.0)

    def coverage(self, z: np.ndarray) -> np.ndarray:
        """The share of a widened footprint that the voxel's own would fill: 1/m² [M98 Eq. 6] for cubic voxels."""
        return np.asarray(self.shrink(z).prod(axis=0))


@dataclass(frozen=True, eq=False)
class Integral:
    """value: the line integral along each ray, for unit extinction · s̄.

    peak: what a ray of the same slant through the splat's middle has, so that value/peak is its shape.
    """

    value: np.ndarray
    peak: np.ndarray


def row1(view: View, voxel: np.ndarray, ray: np.ndarray) -> Integral:
    """The correct value for voxels [3, ...] and rays [2, ...], whose shapes broadcast; arrays [...].

    A perspective ray is z·(w, 1), its slopes w given, and starts at the eye; an orthographic one is given
    by its (x, y) and endless.  [M98 Table 1 row 1]
    """
    x, y, z, u, v = (part.ravel() for part in np.broadcast_arrays(*voxel, *ray))
    shape = np.broadcast_shapes(voxel.shape[1:], ray.shape[1:])
    if not view.perspective:
        found = _parallel(view, (x, y, z), (u, v))
    else:
        found = _straight(view, (x, y, z), (u, v))
        widened = np.flatnonzero(view.widened(z)[1])
        if len(widened):
            some = _bent(view, (x[widened], y[widened], z[widened]), (u[widened], v[widened]))
            found.value[widened], found.peak[widened] = some.value, some.peak
    return Integral(found.value.reshape(shape), found.peak.reshape(shape))


Triple = tuple[np.ndarray, np.ndarray, np.ndarray]
Pair = tuple[np.ndarray, np.ndarray]


def _straight(view: View, voxel: Triple, slope: Pair) -> Integral:
    """Kernels as they are: F(D)/|A⁻¹d̂|, and from the eye on only where one reaches to the eye's plane."""
    x, y, z = voxel
    w_x, w_y = slope
    # e = w z_v − c; D = |(A⁻¹e)×(A⁻¹d)|/|A⁻¹d| = |Aᵀ(e×d)|/|A⁻¹d|, with nothing large to cancel
    e_x, e_y = w_x * z - x, w_y * z - y
    normal = _apply(view.eye_from_index.T, (e_y, -e_x, e_x * w_y - e_y * w_x))
    direction = _apply(view.index_from_eye, (w_x, w_y, np.ones_like(w_x)))
    speed = _length(direction)
    distance = _length(normal) / speed
    footprint = view.kernel.footprint(distance)
    near = np.flatnonzero(z <= view.reach)
    if len(near):
        centre = _apply(view.index_from_eye, (x[near], y[near], z[near]))
        along = centre[0] * direction[0][near] + centre[1] * direction[1][near] + centre[2] * direction[2][near]
        along /= speed[near]
        footprint[near] = _half_line(view.kernel, distance[near], along)
    gain = np.sqrt(1 + w_x * w_x + w_y * w_y) / speed
    return Integral(gain * footprint, gain * view.kernel.footprint(np.zeros(())))


def _half_line(kernel: Kernel, distance: np.ndarray, along: np.ndarray) -> np.ndarray:
    """∫ from the eye on, which is `along` before the ray's closest point to the kernel's centre."""
    chord = np.sqrt(np.maximum((kernel.radius - distance) * (kernel.radius + distance), 0.0))
    return kernel.partial(distance, chord) + kernel.partial(distance, np.clip(along, -chord, chord))


def _parallel(view: View, voxel: Triple, ray: Pair) -> Integral:
    """Orthographic: offsets shrink by the same factor at every depth, so that the ray stays straight."""
    shrink = view.shrink(voxel[2])
    gain = shrink[0] * shrink[1]
    offset = [u_x * (ray[0] - voxel[0]) + u_y * (ray[1] - voxel[1]) for u_x, u_y in view.axes.T]
    # across the view the footprint is an ellipse of half axes σ_i R
    squares = sum((o * s / width) ** 2 for o, s, width in zip(offset, shrink, view.widths, strict=True))
    peak = gain / (view.widths[0] * view.widths[1]) * view.kernel.footprint(np.zeros(()))
    value = gain / (view.widths[0] * view.widths[1]) * view.kernel.footprint(np.sqrt(squares))
    return Integral(value, peak)


def _bent(view: View, voxel: Triple, slope: Pair) -> Integral:
    """sec_p ∫ Π f_i(z) h(A⁻¹[U f(z) Uᵀ(w z − c); z − z_v]) dz, f_i = g_i z_v/z where widened, else 1."""
    x, y, z = voxel
    w = slope
    shrink, widened = view.shrink(z), view.widened(z)
    p0, p1 = [np.zeros_like(z) for _ in range(3)], [np.zeros_like(z) for _ in range(3)]
    p2 = [np.full_like(z, b) for b in view.index_from_eye[:, 2]]
    for (u_x, u_y), g, wide in zip(view.axes.T, shrink, widened, strict=True):
        # along u: g (e + c t/z_v), straight in t, where widened; e + w δ where not
        e, c, slant = ((a * u_x + b * u_y) for a, b in ((w[0] * z - x, w[1] * z - y), (x, y), w))
        for axis, part in enumerate(view.index_from_eye[:, :2] @ (u_x, u_y)):
            p0[axis] += part * g * e
            p1[axis] += part * np.where(wide, g * c / z, 0.0)
            p2[axis] += part * np.where(wide, 0.0, slant)
    gain = np.sqrt(1 + w[0] * w[0] + w[1] * w[1]) * shrink[0] * shrink[1]
    peak = gain / _length([a + b for a, b in zip(p1, p2, strict=True)]) * view.kernel.footprint(np.zeros(()))
    path = Path.of(p0, p1, p2, z, view.depth_reach)
    # dz = dt/(1 − t/z_v)², of which each widened axis takes one factor
    value, both = np.zeros_like(z), widened[0]
    for power, index in ((0, np.flatnonzero(both)), (1, np.flatnonzero(~both))):
        if len(index):
            value[index] = gain[index] * path.take(index).integral(view.kernel, power)
    return Integral(value, peak)


def _apply(matrix: np.ndarray, vector: Triple) -> Triple:
    first, second, third = (row[0] * vector[0] + row[1] * vector[1] + row[2] * vector[2] for row in matrix)
    return first, second, third


def _length(vector: Sequence[np.ndarray]) -> np.ndarray:
    return np.sqrt(vector[0] * vector[0] + vector[1] * vector[1] + vector[2] * vector[2])
