"""The value of a textured quad along a ray: Table 1 rows 4 and 5 for any affine grid, in float64.

The float64 twin of `shaders/quads.glsl`, in the same steps. Lengths in mean spacings, eye axes.
[M98 Table 1 row 4] [M98 Table 1 row 5]
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from splatgl.splat.integral.line_integral import Integral
from splatgl.splat.view.ellipse import perpendicular_axes, smallest_axis, voxel_ellipse
from splatgl.splat.view.view import View

# nearest depth drawn, in voxels: a perspective quad nearer than that would overflow its clip coordinates
NEAR = 1e-3


@dataclass(frozen=True, eq=False)
class Quads:
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

    def take(self, index: np.ndarray) -> Quads:
        """The quads at those indices."""
        parts = (self.voxel, self.normal, self.axis_1, self.axis_2, self.size, self.gain, self.coverage)
        return Quads(*(part[..., index] for part in parts))


def table_quad(view: View, voxel: np.ndarray, align: str) -> Quads:
    """The quads of voxels [3, N]; align: see `quad_plane`."""
    normal, e1, e2 = quad_plane(view, voxel, align)
    ellipse = voxel_ellipse(view.eye_from_index, e1, e2)
    # antialiasing: no half axis is shorter than a pixel's side
    size = np.maximum(ellipse.width, smallest_axis(view, voxel[2]))
    shared = 1 / (size[0] * size[1])
    area = ellipse.width[0] * ellipse.width[1]
    return Quads(voxel, normal, ellipse.axis_1, ellipse.axis_2, size, shared, area * shared)


def quad_plane(view: View, voxel: np.ndarray, align: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
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


def on_quads(view: View, quad: Quads, ray: np.ndarray) -> Integral:
    """The value of each quad [N] on its own ray [2, N]; 0 for rays that leave its plane behind the eye."""
    if view.perspective:
        # from the ray's point at the voxel's depth along the ray to the plane, without cancellation
        x, y, z = quad.voxel
        e_x, e_y = ray[0] * z - x, ray[1] * z - y
        facing = quad.normal[0] * ray[0] + quad.normal[1] * ray[1] + quad.normal[2]
        with np.errstate(divide="ignore", invalid="ignore"):
            step = -(quad.normal[0] * e_x + quad.normal[1] * e_y) / facing
        seen = (facing != 0) & (z + step > 0)
        step = np.where(seen, step, 0.0)
        offset = (e_x + ray[0] * step, e_y + ray[1] * step, step)
    else:
        seen = np.full(quad.voxel.shape[1:], True)
        offset = (ray[0] - quad.voxel[0], ray[1] - quad.voxel[1], np.zeros_like(ray[0]))
    across = [sum_of(offset, axis) / size for axis, size in zip((quad.axis_1, quad.axis_2), quad.size, strict=True)]
    peak = quad.gain * view.kernel.footprint(np.zeros(()))
    return Integral(np.where(seen, quad.gain * view.kernel.footprint(np.hypot(*across)), 0.0), peak)


def sum_of(offset: tuple[np.ndarray, np.ndarray, np.ndarray], axis: np.ndarray) -> np.ndarray:
    """Dot products [...] of vectors, given by their three components [...], with `axis` [3, ...]."""
    return np.asarray(offset[0] * axis[0] + offset[1] * axis[1] + offset[2] * axis[2])
