"""Footprints beyond the paper's Table 1: as cheap as its practical rows, and nearly or wholly exact.

Substituting t = z_v (z − z_v)/z turns row 1's integral into a straight line in perspective space, with
the slope of the voxel's own ray, a_v = c/(z_v m). From it follow `b`, `b1`, `a` and `bprime`; before z_k
the footprint at the true distance, `c`, is exact. Forms take and return what `footprint.ROWS` do, and
are the twins of `shaders/approximations.glsl`: `c` of `near_quad`, `bprime` of `cubic_quad`.
"""

from __future__ import annotations

import numpy as np

from splatgl.splat.integral.table1 import Splat, row4
from splatgl.splat.kernel.kernels import Kernel


def form_c(splat: Splat) -> np.ndarray:
    """The footprint at the true distance of voxel and ray before z_k, exact there; `b` beyond it."""
    return np.where(splat.beyond, form_b(splat), splat.kernel.footprint(splat.distance))


def form_b(splat: Splat) -> np.ndarray:
    """m⁻² (sec_p/q_v) F(√(|E|² − (E·a_v)²/q_v²)): an ellipse on the image plane, valid for z_v ≥ z_k."""
    return _elliptic(splat, splat.sec_p)


def form_b1(splat: Splat) -> np.ndarray:
    """`b` with the length of the voxel's ray for the pixel's: a texture times an alpha, the cost of row 5."""
    sec_v = np.sqrt(1 + _dot(splat.voxel[..., :2], splat.voxel[..., :2]) / splat.z**2)
    return _elliptic(splat, sec_v)


def form_bprime(splat: Splat) -> np.ndarray:
    """`b` with the trapezoid's first-order term beyond z_k, `c` before it: within 1e−3 level of row 1."""
    e, a, q2 = _perspective_line(splat)
    t = -_dot(e, a) / q2
    z = np.where(splat.beyond, splat.z, np.inf)
    d2 = _dot(e, e) - t * t * q2 + 2 * t**3 / z
    gain = splat.gain * splat.sec_p / np.sqrt(q2) * (1 - 3 * t / (q2 * z))
    value = gain * splat.kernel.footprint(np.sqrt(np.maximum(d2, 0.0)))
    return np.where(splat.beyond, value, form_c(splat))


def form_a(splat: Splat) -> np.ndarray:
    """The ray-perpendicular quad made elliptic: radial axis × q_v cos θ_v, gain × sec θ_v/q_v; row 4 before z_k."""
    q2 = _perspective_line(splat)[2]
    length = np.sqrt(_dot(splat.voxel, splat.voxel))
    sec_v = length / splat.z
    radial, across = _on_ray_plane(splat)
    squeeze = np.sqrt(q2) / sec_v
    d = np.hypot(radial / squeeze, across) / splat.m
    value = splat.gain / squeeze * splat.kernel.footprint(d)
    return np.where(splat.beyond, value, row4(splat))


# first-order terms of long voxels are omitted if they change a footprint by more than this share
FIRST_ORDER = 0.5

FORMS = {"a": form_a, "b": form_b, "b1": form_b1, "c": form_c, "bprime": form_bprime}


def half_line(kernel: Kernel, voxel: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """The unstretched kernel's integral along a ray that starts at the eye, for any eye position.

    voxel [..., 3] relative to the eye, direction [..., 3] of any length: P_d(L) + P_d(clamp(v·d̂, −L, L)) with the
    half chord L = √(R² − d²); 0 for a kernel behind the eye, F(d) for one wholly before it.
    """
    unit = direction / np.sqrt(_dot(direction, direction))[..., None]
    cross = np.cross(voxel, unit)
    d = np.sqrt(_dot(cross, cross))
    chord = np.sqrt(np.maximum((kernel.radius - d) * (kernel.radius + d), 0.0))
    along = np.clip(_dot(voxel, unit), -chord, chord)
    return kernel.partial(d, chord) + kernel.partial(d, along)


def _perspective_line(splat: Splat) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """E = e/m, a_v and q_v² = 1 + |a_v|²."""
    m = splat.m[..., None]
    a = splat.voxel[..., :2] / (splat.z[..., None] * m)
    return splat.offset / m, a, 1 + _dot(a, a)


def _elliptic(splat: Splat, seconds: np.ndarray) -> np.ndarray:
    e, a, q2 = _perspective_line(splat)
    d2 = _dot(e, e) - _dot(e, a) ** 2 / q2
    return splat.gain * seconds / np.sqrt(q2) * splat.kernel.footprint(np.sqrt(np.maximum(d2, 0.0)))


def _on_ray_plane(splat: Splat) -> tuple[np.ndarray, np.ndarray]:
    """The ray's intersection with the plane through v perpendicular to v: radial and tangential components."""
    length = np.sqrt(_dot(splat.voxel, splat.voxel))
    ray = np.concatenate([splat.slope, np.ones((*splat.slope.shape[:-1], 1))], axis=-1)
    along = _dot(splat.voxel, ray)
    c = splat.voxel[..., :2]
    out = np.sqrt(_dot(c, c))
    safe = np.where(out > 0, out, 1.0)
    # unit vectors on the plane: across = (−c_y, c_x, 0)/|c|, radial = (c z, −|c|²)/(|c| |v|)
    across = (c[..., 0] * ray[..., 1] - c[..., 1] * ray[..., 0]) / safe
    radial = (_dot(c, ray[..., :2]) * splat.z / safe - out) / length
    scale = length**2 / along
    flat = out == 0
    across = np.where(flat, ray[..., 1], across) * scale
    radial = np.where(flat, ray[..., 0], radial) * scale
    return radial, across


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.asarray((a * b).sum(axis=-1))
