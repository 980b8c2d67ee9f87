"""Approximations of Table 1 and moving footprints, in float64, which the package draws with shaders.

Approximations: substituting t = z_v (z − z_v)/z turns row 1's integral into a straight line in perspective space, with
the slope of the voxel's own ray, a_v = c/(z_v m). From it follow `b`, `b1`, `a` and `bprime`; before z_k
the footprint at the true distance, `c`, is exact. Forms take and return what `footprint.ROWS` do, and
are the twins of `shaders/approximations.glsl`: `c` of `near_quad`, `bprime` of `cubic_quad`.

Moving footprints are those of `motion_blur`, with its units.
"""

from __future__ import annotations

import numpy as np

from splatgl.splat.footprint import Splat, dot_last, oblique, row4
from splatgl.splat.kernels import Kernel, half_line_integral
from splatgl.splat.motion_blur import line_area, partial_area


def form_c(splat: Splat) -> np.ndarray:
    """The footprint at the true distance of voxel and ray before z_k, exact there; `b` beyond it."""
    return np.where(splat.beyond, form_b(splat), splat.kernel.footprint(splat.distance))


def form_b(splat: Splat) -> np.ndarray:
    """m⁻² (sec_p/q_v) F(√(|E|² − (E·a_v)²/q_v²)): an ellipse on the image plane, valid for z_v ≥ z_k."""
    e, a, _ = _perspective_line(splat)
    return oblique(splat, e, a, splat.sec_p)


def form_b1(splat: Splat) -> np.ndarray:
    """`b` with the length of the voxel's ray for the pixel's: a texture times an alpha, the cost of row 5."""
    sec_v = np.sqrt(1 + dot_last(splat.voxel[..., :2], splat.voxel[..., :2]) / splat.z**2)
    e, a, _ = _perspective_line(splat)
    return oblique(splat, e, a, sec_v)


def form_bprime(splat: Splat) -> np.ndarray:
    """`b` with the trapezoid's first-order term beyond z_k, `c` before it: within 1e−3 level of row 1."""
    e, a, q2 = _perspective_line(splat)
    t = -dot_last(e, a) / q2
    z = np.where(splat.beyond, splat.z, np.inf)
    d2 = dot_last(e, e) - t * t * q2 + 2 * t**3 / z
    gain = splat.gain * splat.sec_p / np.sqrt(q2) * (1 - 3 * t / (q2 * z))
    value = gain * splat.kernel.footprint(np.sqrt(np.maximum(d2, 0.0)))
    return np.where(splat.beyond, value, form_c(splat))


def form_a(splat: Splat) -> np.ndarray:
    """The ray-perpendicular quad made elliptic: radial axis × q_v cos θ_v, gain × sec θ_v/q_v; row 4 before z_k."""
    q2 = _perspective_line(splat)[2]
    length = np.sqrt(dot_last(splat.voxel, splat.voxel))
    sec_v = length / splat.z
    radial, across = _on_ray_plane(splat)
    squeeze = np.sqrt(q2) / sec_v
    d = np.hypot(radial / squeeze, across) / splat.m
    value = splat.gain / squeeze * splat.kernel.footprint(d)
    return np.where(splat.beyond, value, row4(splat))


FORMS = {"a": form_a, "b": form_b, "b1": form_b1, "c": form_c, "bprime": form_bprime}


def half_line(kernel: Kernel, voxel: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """The unstretched kernel's integral along a ray that starts at the eye, for any eye position.

    voxel [..., 3] relative to the eye, direction [..., 3] of any length: P_d(L) + P_d(clamp(v·d̂, −L, L)) with the
    half chord L = √(R² − d²); 0 for a kernel behind the eye, F(d) for one wholly before it.
    """
    unit = direction / np.sqrt(dot_last(direction, direction))[..., None]
    cross = np.cross(voxel, unit)
    return half_line_integral(kernel, np.sqrt(dot_last(cross, cross)), dot_last(voxel, unit))


def _perspective_line(splat: Splat) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """E = e/m, a_v and q_v² = 1 + |a_v|²."""
    m = splat.m[..., None]
    a = splat.voxel[..., :2] / (splat.z[..., None] * m)
    return splat.offset / m, a, 1 + dot_last(a, a)


def _on_ray_plane(splat: Splat) -> tuple[np.ndarray, np.ndarray]:
    """The ray's intersection with the plane through v perpendicular to v: radial and tangential components."""
    length = np.sqrt(dot_last(splat.voxel, splat.voxel))
    ray = np.concatenate([splat.slope, np.ones((*splat.slope.shape[:-1], 1))], axis=-1)
    along = dot_last(splat.voxel, ray)
    c = splat.voxel[..., :2]
    out = np.sqrt(dot_last(c, c))
    safe = np.where(out > 0, out, 1.0)
    # unit vectors on the plane: across = (−c_y, c_x, 0)/|c|, radial = (c z, −|c|²)/(|c| |v|)
    across = (c[..., 0] * ray[..., 1] - c[..., 1] * ray[..., 0]) / safe
    radial = (dot_last(c, ray[..., :2]) * splat.z / safe - out) / length
    scale = length**2 / along
    flat = out == 0
    across = np.where(flat, ray[..., 1], across) * scale
    radial = np.where(flat, ray[..., 0], radial) * scale
    return radial, across


# a path shorter than this, l√k = 1e−4 at k = 2, is a point: its mean is the middle's value to 5e−10,
# while the difference of two areas loses digits
POINT = 1e-4 / np.sqrt(2.0)


def box_blur(kernel: Kernel, u: np.ndarray, v: np.ndarray, length: np.ndarray) -> np.ndarray:
    """B(u, v, l): the mean of the footprint along the path, exact; F itself for a path that is a point."""
    u, v, length = (np.asarray(x, dtype=np.float64) for x in (u, v, length))
    moves = length > POINT
    safe = np.where(moves, length, 1.0)
    ends = partial_area(kernel, u + safe / 2, v), partial_area(kernel, u - safe / 2, v)
    return np.where(moves, (ends[0] - ends[1]) / safe, kernel.footprint(np.hypot(u, v)))


def stretched_footprint(kernel: Kernel, u: np.ndarray, v: np.ndarray, length: np.ndarray) -> np.ndarray:
    """The footprint cut in half, the halves l apart, with the cut's values between them; not weakened.

    [M98 Fig. 11]
    """
    beyond = np.maximum(np.abs(u) - np.asarray(length) / 2, 0.0)
    return np.asarray(kernel.footprint(np.hypot(beyond, v)))


def paper_gain(kernel: Kernel, length: np.ndarray) -> np.ndarray:
    """The paper's weakening: the disc's area over the stretched disc's.  [M98 Eq. 11]

    It conserves the energy of a uniform disc; a footprint's energy grows up to 2.08 times.
    """
    disc = np.pi * kernel.radius
    return np.asarray(disc / (disc + 2 * np.asarray(length)))


def energy_gain(kernel: Kernel, length: np.ndarray) -> np.ndarray:
    """E₁/(E₁ + l W): the weakening that conserves the energy of `stretched_footprint`; E₁ = 1, as kernels have unit
    volume.
    """
    return np.asarray(1 / (1 + np.asarray(length) * line_area(kernel, np.zeros(()))))


def streak(kernel: Kernel, motion: str, place: tuple[np.ndarray, np.ndarray], length: np.ndarray) -> np.ndarray:
    """The contribution of a moving splat of unit extinction at `place` = (u, v); motion: exact, energy or paper."""
    if motion == "exact":
        return box_blur(kernel, *place, length)
    gain = energy_gain if motion == "energy" else paper_gain
    return gain(kernel, length) * stretched_footprint(kernel, *place, length)
