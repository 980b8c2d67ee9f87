"""Footprints of splats: the five rows of Table 1, quads, and attenuation beyond z_k, in float64.

The eye is at the origin, +z is depth, the voxel spacing 1. A voxel is v = (x, y, z_v); a ray passes
through (w, 1)·z. All values are line integrals of the kernel (arc length), low-passed where
z_v ≥ z_k: stretched by m = z_v/z_k, weakened by 1/m² [M98 Eq. 4, 6]. Arrays broadcast: voxel [..., 3],
slope [..., 2] → [...]. OpenGL draws rows 4 and 5 as `SplatQuads`.

Attenuation: a pixel wider than a voxel averages over sub-pixel columns. Weakening opacity by 1/m² suits isolated
matter, weakening optical depth suits matter that fills its pixel; with both, matter behind opaque matter widens it.
The runs of occupied cells around a splat give:

* column T = τ · the length of the ray in its run of matter; its opacity is A = 1 − e^(−T).
* A lone voxel's footprint hides more than its face, since the exponential saturates: by a rim of
  T/√(41 + 1.1 T²) voxels, within 7 % of ∫(1 − e^(−T F)) for T up to 16. So hidden = A Π(1 + rim/run).
* A run fills the share 1/m if it is one cell, 1 if it is long against the pixel; the product over the
  two most filled axes is the pixel's fill φ. For one cell it falls by 2 (m − 1)/m¹⁶ faster at first:
  up to z_k a cell is as sharp as its kernel, already more than its pixel's average.
* The column's depth becomes T (hidden/T)^(1−φ): T for a filled pixel (φ = 1), `hidden` for φ = 0,
  and T again for m → 1. It is at most 5.5, an opacity of 1 − 1/245: more would only darken the
  neighbouring pixels that its stretched footprint touches.

The constants are fits to supersampled pictures; scripts/benchmarks/attenuation.py prints their errors.

Quads are the float64 twin of `shaders/quads.glsl`, in the same steps. Lengths in mean spacings, eye axes.
[M98 Table 1 row 4] [M98 Table 1 row 5]
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from splatgl.geometry.view import GridView, dot, perpendicular_axes, smallest_axis, voxel_ellipse
from splatgl.splat.kernels import Kernel
from splatgl.splat.line_integral import CurvedRay, Integral
from splatgl.splat.splats import OCTAVES

# first-order terms of long voxels are omitted if they change a footprint by more than this share
FIRST_ORDER = 0.5

# optical depth at which a column is opaque in 8 bits
LARGEST_DEPTH = 5.5
# rim(T) = T/√(RIM_START + RIM_GROWTH T²), voxels
RIM_START, RIM_GROWTH = 41.0, 1.1
# a lone cell's share of its pixel falls as 1/m − ONSET (m − 1)/m^ONSET_POWER
ONSET, ONSET_POWER = 2.0, 16
# rays with a smaller component along an axis count as perpendicular to it
GRAZING = 1e-3


def fill_depth(
    depth: np.ndarray, along: np.ndarray, widths: np.ndarray, pixel: np.ndarray, coverage: np.ndarray, runs: np.ndarray
) -> np.ndarray:
    """Optical depth per mean spacing [N] that replaces `depth` where a pixel is wider than a voxel.

    along [3, N]: the ray's unit vector in index steps per mean spacing; widths [3]: lengths of the grid's
    steps; pixel [N]: a pixel's side at the voxel, both in mean spacings; coverage [N]: 1/m²; runs: coded.
    """
    run = run_lengths(runs)
    m = np.maximum(pixel / widths[:, None], 1.0)
    layers = (run / np.maximum(np.abs(along), GRAZING)).min(axis=0)
    column = depth * layers
    # filled share of the pixel
    alone = 1 / m - ONSET * (m - 1) / m**ONSET_POWER
    share = 1 - (1 - alone) / (1 + ((run - 1) / (m + 1)) ** 4)
    filled = share.prod(axis=0) / share.min(axis=0)
    # opacity of the column, rim included
    wider = 1 + column / np.sqrt(RIM_START + RIM_GROWTH * column**2) / run
    hidden = -np.expm1(-column) * wider.prod(axis=0) / wider.max(axis=0)
    ratio = np.minimum(hidden / np.where(column > 0, column, 1.0), 1.0)
    left = column * ratio ** (1 - filled)
    stretch = 1 / np.sqrt(coverage)
    left = np.minimum(left, LARGEST_DEPTH * stretch / np.maximum(stretch - 1, 1e-6))
    return np.where(coverage < 1, left / layers, depth)


def run_lengths(runs: np.ndarray) -> np.ndarray:
    """Run lengths of occupied voxels [3, N] along the grid's axes, in voxels, from their codes [N]."""
    return np.asarray(np.exp2(np.stack([runs >> bits & 31 for bits in (0, 5, 10)]) * OCTAVES))


# nearest depth drawn, in voxels: a perspective quad nearer than that would overflow its clip coordinates
NEAR = 1e-3


@dataclass(frozen=True, eq=False)
class SplatQuads:
    """The quads of N splats. All vectors are [3, N].

    voxel: the centre. normal: across the plane (parallel to the image: 0, 0, 1). axis_1, axis_2: unit
    vectors along the ellipse's axes; size [2, N]: its half axes at the kernel's unit radius.
    gain [N]: the line integral at the centre over F(0). coverage [N]: the unwidened area's share.
    """

    voxel: np.ndarray
    normal: np.ndarray
    axis_1: np.ndarray
    axis_2: np.ndarray
    size: np.ndarray
    gain: np.ndarray
    coverage: np.ndarray

    def take(self, index: np.ndarray) -> SplatQuads:
        """The quads at those indices."""
        return SplatQuads(*(part[..., index] for part in vars(self).values()))


def table_quad(view: GridView, voxel: np.ndarray, align: str) -> SplatQuads:
    """The quads of voxels [3, N]; align: see `quad_plane`."""
    normal, e1, e2 = quad_plane(view, voxel, align)
    ellipse = voxel_ellipse(view.eye_from_index, e1, e2)
    # antialiasing: no half axis is shorter than a pixel's side
    size = np.maximum(ellipse.width, smallest_axis(view, voxel[2]))
    shared = 1 / (size[0] * size[1])
    area = ellipse.width[0] * ellipse.width[1]
    return SplatQuads(voxel, normal, ellipse.axis_1, ellipse.axis_2, size, shared, area * shared)


def quad_plane(view: GridView, voxel: np.ndarray, align: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The normals of the quads' planes and two unit vectors on them, [3, N] each.

    align "ray": perpendicular to the eye–voxel ray, "grid": parallel to the image.
    """
    normal, e1, e2 = (np.zeros_like(voxel) for _ in range(3))
    normal[2], e1[0], e2[1] = 1.0, 1.0, 1.0
    if align == "ray" and view.perspective:
        length = np.sqrt((voxel * voxel).sum(axis=0))
        turned = length > 0
        normal[:, turned] = voxel[:, turned] / length[turned]
        e1[:, turned], e2[:, turned] = perpendicular_axes(normal[:, turned])
    return normal, e1, e2


def on_quads(view: GridView, quad: SplatQuads, ray: np.ndarray) -> Integral:
    """Values [N] of quads, each on one of the rays [2, N]; 0 for rays that meet the plane behind the eye."""
    if view.perspective:
        # from the ray's point at the voxel's depth along the ray to the plane, without cancellation
        x, y, z = quad.voxel
        e_x, e_y = ray[0] * z - x, ray[1] * z - y
        facing = quad.normal[0] * ray[0] + quad.normal[1] * ray[1] + quad.normal[2]
        with np.errstate(divide="ignore", invalid="ignore"):
            step = -(quad.normal[0] * e_x + quad.normal[1] * e_y) / facing
        hit = (facing != 0) & (z + step > 0)
        step = np.where(hit, step, 0.0)
        offset = (e_x + ray[0] * step, e_y + ray[1] * step, step)
    else:
        hit = np.full(quad.voxel.shape[1:], True)
        offset = (ray[0] - quad.voxel[0], ray[1] - quad.voxel[1], np.zeros_like(ray[0]))
    across = [dot(offset, axis) / size for axis, size in zip((quad.axis_1, quad.axis_2), quad.size, strict=True)]
    peak = quad.gain * view.kernel.footprint(np.zeros(()))
    return Integral(np.where(hit, quad.gain * view.kernel.footprint(np.hypot(*across)), 0.0), peak)


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
        return np.sqrt(1 + dot_last(self.slope, self.slope))

    @property
    def distance(self) -> np.ndarray:
        """True distance of voxel and ray, from local offsets to avoid cancellation."""
        e, w = self.offset, self.slope
        cross = e[..., 0] * w[..., 1] - e[..., 1] * w[..., 0]
        return np.sqrt(dot_last(e, e) + cross * cross) / self.sec_p

    @property
    def tan_length(self) -> np.ndarray:
        """|v| tan δ: distance from v of the ray's intersection with the plane through v perpendicular to v."""
        e, w, v = self.offset, self.slope, self.voxel
        cross = np.stack([e[..., 1], -e[..., 0], v[..., 0] * w[..., 1] - v[..., 1] * w[..., 0]], axis=-1)
        along = v[..., 0] * w[..., 0] + v[..., 1] * w[..., 1] + v[..., 2]
        length = np.sqrt(dot_last(v, v))
        ahead = along > 0
        return np.where(ahead, np.sqrt(dot_last(cross, cross)) * length / np.where(ahead, along, 1.0), np.inf)


def row1(splat: Splat) -> np.ndarray:
    """Trapezoid stretch, diverging rays: the correct value [M98 Table 1 row 1]."""
    return np.where(splat.beyond, _trapezoid(splat), splat.kernel.footprint(splat.distance))


def row2(splat: Splat) -> np.ndarray:
    """Box stretch, diverging rays [M98 Table 1 row 2]."""
    m = splat.m[..., None]
    a, e = splat.slope / m, splat.offset / m
    return np.where(splat.beyond, oblique(splat, e, a, splat.sec_p), splat.kernel.footprint(splat.distance))


def row3(splat: Splat) -> np.ndarray:
    """Ray-perpendicular, ideal [M98 Table 1 row 3].

    Printed with y_v, z_v for x_v, y_v and without the squares in its numerators, which is corrected here.
    """
    length = np.sqrt(dot_last(splat.voxel, splat.voxel))
    tan = np.minimum(splat.tan_length / length, 1e150)
    q = np.sqrt(1 + (tan / splat.m) ** 2)
    value = np.sqrt(1 + tan * tan) / q * splat.gain * splat.kernel.footprint(length * tan / (splat.m * q))
    return np.where(splat.beyond, value, splat.kernel.footprint(splat.distance))


def row4(splat: Splat) -> np.ndarray:
    """Ray-perpendicular, practical: a textured quad perpendicular to the eye–voxel ray [M98 Table 1 row 4].

    Its denominator is z_v z_k + y_p y_v by the geometry; the printed sign, a minus, is a misprint.
    """
    return splat.gain * splat.kernel.footprint(splat.tan_length / splat.m)


def row5(splat: Splat) -> np.ndarray:
    """Grid-aligned: a textured quad parallel to the image plane [M98 Table 1 row 5]."""
    e = splat.offset
    return splat.gain * splat.kernel.footprint(np.sqrt(dot_last(e, e)) / splat.m)


ROWS = {"row1": row1, "row2": row2, "row3": row3, "row4": row4, "row5": row5}


def switch_depth(kernel: Kernel, half_angle: float, pixels: float, extent: float, tolerance: float) -> float:
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
    """Largest error of row 5 minus the largest error of row 4 over the rays of a voxel at the edge, in levels."""
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


def oblique(splat: Splat, e: np.ndarray, a: np.ndarray, seconds: np.ndarray) -> np.ndarray:
    """m⁻² (sec/q) F(√(|E|² − (E·a)²/q²)): a straight line of slope a through the stretched kernel."""
    q2 = 1 + dot_last(a, a)
    t = dot_last(e, a)
    d = np.sqrt(np.maximum(dot_last(e, e) - t * t / q2, 0.0))
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


def dot_last(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Dot products [...] of vectors [..., 2 or 3]."""
    return np.asarray((a * b).sum(axis=-1))
