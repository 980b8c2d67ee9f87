"""The scene that the paper analyses its errors in: one camera, one kernel, one volume.  [M98 §4.2, Figs. 9 and 10]

Lengths are in voxel spacings; the eye is at the origin and looks along +z.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from splatgl.splat.camera import Camera
from splatgl.splat.kernels import Gaussian

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

    @property
    def peak(self) -> float:
        """F(0) of the unstretched kernel of unit volume."""
        return float(self.kernel.footprint(np.zeros(())))


PAPER = Setting()
