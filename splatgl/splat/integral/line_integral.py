"""The exact line integral of one splat along one pixel's ray, as `View` widens it; for cubic voxels Table 1 row 1."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from splatgl.splat.integral.curved_ray import CurvedRay
from splatgl.splat.kernel.kernels import Kernel
from splatgl.splat.view.view import View


@dataclass(frozen=True, eq=False)
class Integral:
    """value: the line integral along each ray, for unit extinction · s̄.

    peak: that of a ray of the same slant through the splat's centre; value/peak is the footprint's shape.
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
        widened = np.flatnonzero(view.is_widened(z))
        if len(widened):
            some = _bent(view, (x[widened], y[widened], z[widened]), (u[widened], v[widened]))
            found.value[widened], found.peak[widened] = some.value, some.peak
    return Integral(found.value.reshape(shape), found.peak.reshape(shape))


Triple = tuple[np.ndarray, np.ndarray, np.ndarray]
Pair = tuple[np.ndarray, np.ndarray]


def _straight(view: View, voxel: Triple, slope: Pair) -> Integral:
    """Unwidened kernels: F(D)/|A⁻¹d̂|; the integral starts at the eye if the kernel reaches the eye's plane."""
    x, y, z = voxel
    w_x, w_y = slope
    # e = w z_v − c; D = |(A⁻¹e)×(A⁻¹d)|/|A⁻¹d| = |Aᵀ(e×d)|/|A⁻¹d|, without cancellation
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
    """∫ from the eye, which lies `along` before the ray's closest point to the kernel's centre."""
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
    path = CurvedRay.of(p0, p1, p2, z, view.depth_reach)
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
