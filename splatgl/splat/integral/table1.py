"""A splat's contribution along a ray, in float64: Table 1 of the paper.

The eye is at the origin, +z is depth, the voxel spacing 1. A voxel is v = (x, y, z_v); a ray passes
through (w, 1)·z. All values are line integrals of the kernel (arc length), low-passed where
z_v ≥ z_k: stretched by m = z_v/z_k, weakened by 1/m² [M98 Eq. 4, 6]. Arrays broadcast: voxel [..., 3],
slope [..., 2] → [...]. OpenGL draws rows 4 and 5 by `quads.py`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from splatgl.splat.integral.curved_ray import CurvedRay
from splatgl.splat.kernel.kernels import Kernel


@dataclass(frozen=True)
class Splat:
    """Quantities shared by the rows, for broadcast voxels and rays.

    planar: the paper's analysis in the (y, z) plane, where a stretch by m weakens by 1/m only.
    """

    kernel: Kernel
    voxel: np.ndarray
    slope: np.ndarray
    z_k: float
    planar: bool = False

    @property
    def z(self) -> np.ndarray:
        """Depth of the voxel [...], z_v."""
        return np.asarray(self.voxel[..., 2])

    @property
    def beyond(self) -> np.ndarray:
        """bool: z_v ≥ z_k, where antialiasing begins."""
        return np.asarray(self.z >= self.z_k)

    @property
    def m(self) -> np.ndarray:
        """The stretch: z_v/z_k beyond z_k, else 1 [M98 Eq. 4]."""
        return np.where(self.beyond, self.z / self.z_k, 1.0)

    @property
    def gain(self) -> np.ndarray:
        """The weakening that conserves a splat's energy: 1/m² [M98 Eq. 6], 1/m in the plane."""
        return np.asarray(self.m ** (-1.0 if self.planar else -2.0))

    @property
    def offset(self) -> np.ndarray:
        """Ray minus voxel on the plane at the voxel's depth: e = w z_v − c [..., 2]."""
        return np.asarray(self.slope * self.z[..., None] - self.voxel[..., :2])

    @property
    def sec_p(self) -> np.ndarray:
        """Arc length per depth along the pixel's ray."""
        return np.sqrt(1 + _dot(self.slope, self.slope))

    @property
    def distance(self) -> np.ndarray:
        """True distance of voxel and ray, from local offsets to avoid cancellation."""
        e, w = self.offset, self.slope
        cross = e[..., 0] * w[..., 1] - e[..., 1] * w[..., 0]
        return np.sqrt(_dot(e, e) + cross * cross) / self.sec_p

    @property
    def tan_length(self) -> np.ndarray:
        """|v| tan δ: distance from v of the ray's intersection with the plane through v perpendicular to v."""
        e, w, v = self.offset, self.slope, self.voxel
        cross = np.stack([e[..., 1], -e[..., 0], v[..., 0] * w[..., 1] - v[..., 1] * w[..., 0]], axis=-1)
        along = v[..., 0] * w[..., 0] + v[..., 1] * w[..., 1] + v[..., 2]
        length = np.sqrt(_dot(v, v))
        ahead = along > 0
        return np.where(ahead, np.sqrt(_dot(cross, cross)) * length / np.where(ahead, along, 1.0), np.inf)


def row1(splat: Splat) -> np.ndarray:
    """Trapezoid stretch, diverging rays: the correct value [M98 Table 1 row 1]."""
    return np.where(splat.beyond, _trapezoid(splat), splat.kernel.footprint(splat.distance))


def row2(splat: Splat) -> np.ndarray:
    """Box stretch, diverging rays [M98 Table 1 row 2]."""
    m = splat.m[..., None]
    a, e = splat.slope / m, splat.offset / m
    return np.where(splat.beyond, _oblique(splat, e, a, splat.sec_p), splat.kernel.footprint(splat.distance))


def row3(splat: Splat) -> np.ndarray:
    """Ray-perpendicular, ideal [M98 Table 1 row 3, with its errors corrected]."""
    length = np.sqrt(_dot(splat.voxel, splat.voxel))
    tan = np.minimum(splat.tan_length / length, 1e150)
    q = np.sqrt(1 + (tan / splat.m) ** 2)
    value = np.sqrt(1 + tan * tan) / q * splat.gain * splat.kernel.footprint(length * tan / (splat.m * q))
    return np.where(splat.beyond, value, splat.kernel.footprint(splat.distance))


def row4(splat: Splat) -> np.ndarray:
    """Ray-perpendicular, practical: a textured quad perpendicular to the eye–voxel ray [M98 Table 1 row 4]."""
    return splat.gain * splat.kernel.footprint(splat.tan_length / splat.m)


def row5(splat: Splat) -> np.ndarray:
    """Grid-aligned: a textured quad parallel to the image plane [M98 Table 1 row 5]."""
    e = splat.offset
    return splat.gain * splat.kernel.footprint(np.sqrt(_dot(e, e)) / splat.m)


ROWS = {"row1": row1, "row2": row2, "row3": row3, "row4": row4, "row5": row5}


def switch_depth(kernel: Kernel, half_angle: float, pixels: int, extent: float, tolerance: float) -> float:
    """z_s/z_k: the nearest depth beyond z_k where grid-aligned instead of ray-perpendicular splats cost
    at most `tolerance` levels (255 · difference / peak) more at the volume's edge [M98 §4.2, Fig. 10].

    half_angle in radians; pixels across the image; extent: the largest |y| of the volume in voxels.
    """
    z_k = pixels / (2 * np.tan(half_angle))
    low, high = 1.0, 1.0
    while _extra_error(kernel, z_k, half_angle, extent, high) > tolerance and high < SWITCH_LIMIT:
        low, high = high, high * 1.25
    if _extra_error(kernel, z_k, half_angle, extent, low) <= tolerance:
        return low
    for _ in range(24):
        middle = (low + high) / 2
        if _extra_error(kernel, z_k, half_angle, extent, middle) > tolerance:
            low = middle
        else:
            high = middle
    return high


# beyond 100 z_k a footprint is so wide on the voxel's scale that both forms agree
SWITCH_LIMIT = 100.0
# rays across one footprint, to find its largest error
SWITCH_RAYS = 401


def _extra_error(kernel: Kernel, z_k: float, half_angle: float, extent: float, m: float) -> float:
    """Largest error of row 5 less that of row 4, over the rays of a voxel at the edge, in levels of its peak."""
    z = m * z_k
    y = min(extent, z * np.tan(half_angle))
    voxel = np.array([0.0, y, z])
    # the rays that meet the voxel's footprint
    reach = kernel.radius * m / z * (1 + (y / z) ** 2)
    slope = np.zeros((SWITCH_RAYS, 2))
    slope[:, 1] = y / z + np.linspace(-reach, reach, SWITCH_RAYS)
    splat = Splat(kernel, voxel, slope, z_k, planar=True)
    right = row1(splat)
    grid, ray = (float(np.abs(row(splat) - right).max()) for row in (row5, row4))
    return 255.0 * (grid - ray) / float(right.max())


def _oblique(splat: Splat, e: np.ndarray, a: np.ndarray, seconds: np.ndarray) -> np.ndarray:
    """m⁻² (sec/q) F(√(|E|² − (E·a)²/q²)): a straight line of slope a through the stretched kernel."""
    q2 = 1 + _dot(a, a)
    t = _dot(e, a)
    d = np.sqrt(np.maximum(_dot(e, e) - t * t / q2, 0.0))
    return seconds / np.sqrt(q2) * splat.gain * splat.kernel.footprint(d)


def _trapezoid(splat: Splat) -> np.ndarray:
    """(sec_p/m²) ∫ g(√(|E + a_v t|² + (t/(1 − t/z_v))²)) dt."""
    shape = np.broadcast_shapes(splat.voxel.shape[:-1], splat.slope.shape[:-1])
    beyond = np.broadcast_to(splat.beyond, shape)
    z = np.broadcast_to(splat.z, shape)[beyond]
    e = np.broadcast_to(splat.offset / splat.m[..., None], (*shape, 2))[beyond]
    a = np.broadcast_to(splat.voxel[..., :2] / splat.m[..., None], (*shape, 2))[beyond] / z[:, None]
    zero, one = np.zeros_like(z), np.ones_like(z)
    path = CurvedRay.of((*e.T, zero), (*a.T, zero), (zero, zero, one), z, reach=1.0)
    total = np.zeros(shape)
    total[beyond] = path.integral(splat.kernel, power=1 if splat.planar else 0)
    return np.asarray(splat.sec_p * splat.gain * total)


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.asarray((a * b).sum(axis=-1))
