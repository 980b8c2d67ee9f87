"""Splats by EWA volume splatting (Zwicker, Pfister, van Baar, Gross 2001), in float64.

The perspective mapping to ray space (slopes, distance from the eye) is replaced by its Jacobian J at the voxel, by
which a Gaussian remains one. Its projection of covariance Q = J A Aᵀ Jᵀ is convolved with a Gaussian of a pixel p:
Q + p², whatever the depth, where [M98 Eq. 4] takes the larger of voxel and pixel. All in units of the kernel's own
variance, so that the filter is for a pixel what the kernel is for a voxel. Both are normalised: energy is kept.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from splatgl.errors import expected
from splatgl.geometry.view import GridView
from splatgl.splat.line_integral import Integral


@dataclass(frozen=True, eq=False)
class Ewa:
    """The ellipses of N splats in slopes, or eye x and y. middle [2, N]; shape [3, N]: xx, xy, yy of the covariance.

    gain [N]: the line integral at the middle over F(0), 0 for kernels that reach the eye's plane, where J means
    nothing. coverage [N]: the unfiltered ellipse's share of the filtered one's area.
    """

    middle: np.ndarray
    shape: np.ndarray
    gain: np.ndarray
    coverage: np.ndarray

    @classmethod
    def of(cls, view: GridView, voxel: np.ndarray) -> Ewa:
        """The ellipses of voxels [3, N]. Raises InputError for a kernel that is not a Gaussian."""
        if view.kernel.name != "gaussian":
            raise expected("kernel", "gaussian, as the affine image of no other keeps its form", view.kernel.name)
        x, y, z = voxel
        middle, jacobian, density = voxel[:2], np.ones_like(z), np.ones_like(z)
        rows = np.broadcast_to(np.eye(2, 3)[..., None], (2, 3, len(z))).copy()
        if view.perspective:
            ahead = z > view.reach
            depth = np.where(ahead, z, 1.0)
            middle = voxel[:2] / depth
            rows[:, :2] /= depth
            rows[:, 2] = -middle / depth
            jacobian = np.sqrt(x * x + y * y + depth * depth) / depth**3
            density = np.where(ahead, 1.0, 0.0)
        across = np.einsum("ijn,jk->ikn", rows, view.eye_from_index)
        shape = np.stack([(across[i] * across[j]).sum(axis=0) for i, j in ((0, 0), (0, 1), (1, 1))])
        filtered = shape + np.array([[1.0], [0.0], [1.0]]) * view.filter_pitch**2 * view.antialias
        area = np.sqrt(_determinant(filtered))
        volume = abs(float(np.linalg.det(view.eye_from_index)))
        return cls(middle, filtered, density * jacobian * volume / area, np.sqrt(_determinant(shape)) / area)

    def bounds(self, radius: float) -> tuple[np.ndarray, np.ndarray]:
        """Lowest and highest slopes, or x and y, [2, N] each; low > high where nothing is drawn."""
        half = radius * np.sqrt(self.shape[[0, 2]])
        return self.middle - half, np.where(self.gain > 0, self.middle + half, -np.inf)

    def on(self, view: GridView, splat: np.ndarray, ray: np.ndarray) -> Integral:
        """Line integrals of splats [P] along rays [2, P]."""
        u, v = ray - self.middle[:, splat]
        xx, xy, yy = shape = self.shape[:, splat]
        square = (yy * u * u - 2 * xy * u * v + xx * v * v) / _determinant(shape)
        peak = self.gain[splat] * view.kernel.footprint(np.zeros(()))
        return Integral(self.gain[splat] * view.kernel.footprint(np.sqrt(np.maximum(square, 0.0))), peak)


def _determinant(shape: np.ndarray) -> np.ndarray:
    xx, xy, yy = shape
    return np.asarray(xx * yy - xy * xy)
