"""The paper's camera, kernel and volume.

Lengths are in voxel spacings; the eye is at the origin and looks along +z.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from splatgl.geometry.camera import Camera
from splatgl.splat.kernels import Gaussian, Kernel

# fraction of the volume's length before z_k in the paper's plots: 102.4 of 512
BEFORE = 0.2


def straight_ahead(pixels: int, fov: float = 60.0) -> Camera:
    """The camera at the origin whose eye axes (right, down, forward) are the world's x, y, z; fov in degrees."""
    return Camera.look_at((0, 0, 0), (0, 0, 1), up=(0, -1, 0), fov=fov, size=(pixels, pixels))


@dataclass(frozen=True)
class Setting:
    """A volume of n³ voxels in a picture of n² pixels, half-angle 30°, kernel exp(−2r²) cut at 2."""

    n: int = 512
    kernel: Gaussian = field(default_factory=Gaussian)

    @cached_property
    def camera(self) -> Camera:
        """Perspective from the origin along +z, n² pixels."""
        return straight_ahead(self.n)

    @property
    def z_k(self) -> float:
        """Depth at which a voxel is one pixel wide [M98 Eq. 3]."""
        return float(self.camera.z_k(1.0))

    @property
    def front(self) -> float:
        """Depth of the volume's front."""
        return self.z_k - BEFORE * self.n

    @property
    def back(self) -> float:
        """Depth of the volume's back."""
        return self.front + self.n

    @property
    def edge(self) -> float:
        """The largest |x| or |y| in the volume."""
        return self.n / 2

    @property
    def slope(self) -> float:
        """Slope of the picture's edge: tan of the half-angle."""
        return self.camera.extent / 2


PAPER = Setting()


@dataclass(frozen=True)
class Stretched:
    """The kernel of the voxel (y, z) where a voxel is one pixel wide at depth z_k; eye axes, voxel spacings."""

    kernel: Kernel
    y: float
    z: float
    z_k: float

    @property
    def m(self) -> float:
        """z_v/z_k beyond z_k, else 1 [M98 Eq. 4]."""
        return max(self.z / self.z_k, 1.0)

    def width(self, depth: np.ndarray, box: bool = False) -> np.ndarray:
        """Relative width at a depth: z/z_k in diverging rays, m in a box [M98 Fig. 7]."""
        fixed = box or self.z < self.z_k
        return np.full(np.shape(depth), self.m) if fixed else np.asarray(depth) / self.z_k

    def value(self, row: str, y: np.ndarray, depth: np.ndarray) -> np.ndarray:
        """Values at points (y, depth), as a share of g(0), of the kernel that a row of Table 1 integrates, unweakened.

        Row 5 integrates over depth: where rays are parallel its kernel is round. The others integrate over the ray's
        length, row 4 from where it meets its quad.
        """
        slope = y / depth
        if row == "row5":
            across, along = (slope * self.z - self.y) / self.m, depth - self.z
        elif row == "row4":
            facing, length = self.z + slope * self.y, np.hypot(self.y, self.z)
            across = length * (slope * self.z - self.y) / (self.m * facing)
            along = np.sqrt(1 + slope**2) * (depth - length**2 / facing)
        else:
            across, along = (y - self.y) / self.width(depth, row == "row2"), depth - self.z
        return np.asarray(self.kernel.value(np.hypot(across, along)) / self.kernel.value(np.zeros(())))

    def quad(self, row: str) -> np.ndarray:
        """[N, 2]: points (depth, y) of the quad of row 4 or 5, which is m·R to either side of the voxel."""
        voxel = np.array([self.z, self.y])
        direction = np.array([0.0, 1.0]) if row == "row5" else np.array([-self.y, self.z]) / np.hypot(*voxel)
        half = self.m * self.kernel.radius
        return voxel + np.outer(np.linspace(-half, half, 41), direction)

    def outline(self, box: bool = False) -> np.ndarray:
        """[5, 2]: corners (depth, y) of the bounding trapezoid or box."""
        near, far = self.z - self.kernel.radius, self.z + self.kernel.radius
        ends = np.array([near, near, far, far, near])
        half = self.kernel.radius * self.width(ends, box) * np.array([-1, 1, 1, -1, -1])
        return np.stack([ends, self.y + half], axis=1)

    def box_for_trapezoid(self) -> tuple[float, float]:
        """Difference of a box from the trapezoid [M98 §4.2], at their outlines' corners and at the kernel's rim."""
        corners = np.abs(self.outline()[:, 1] - self.outline(box=True)[:, 1]).max()
        turn = np.linspace(0, np.pi, 1801)
        depth, across = self.z + self.kernel.radius * np.cos(turn), self.kernel.radius * np.sin(turn)
        rim = np.abs(across * (self.width(depth) - self.width(depth, box=True))).max()
        return float(corners), float(rim)
