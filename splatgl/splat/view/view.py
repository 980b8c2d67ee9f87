"""`View`: any affine grid seen by any camera, float64; computed once per picture.

Lengths are in mean voxel spacings s̄, in eye axes (right, down, forward). A voxel's kernel is
h(A⁻¹(x − v)), of unit volume, A = eye_from_index/s̄. Antialiasing widens it across the view: along the
axes u_i of A's first two rows, of half widths σ_i, an offset shrinks by (σ_i/p)(z_v/z) where a pixel's
side p at the voxel's depth z_v is longer than σ_i.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from splatgl.splat.extraction.splats import Grid, Splats
from splatgl.splat.kernel.kernels import Kernel
from splatgl.splat.view.camera import Camera

# a kernel is widened only from this many of its reaches in depth on
WIDEN_BEYOND = 3.0


def eye_from_index(grid: Grid, camera: Camera) -> np.ndarray:
    """[3, 3]: A, the grid's steps in eye axes and mean spacings."""
    return np.asarray(camera.eye_from_world @ grid.world_from_index / grid.mean_spacing)


@dataclass(frozen=True, eq=False)
class View:
    """A grid seen by a camera. eye_from_index [3, 3]: A. pitch: a pixel's side at depth 1, or everywhere.

    eye_index [3]: the eye in grid indices. size: pixels along x and y. antialias: whether widths below p are widened.
    beyond: depths from which σ_1 and σ_2 are widened; None: from where p is wider, see `widening.py`.
    """

    kernel: Kernel
    eye_from_index: np.ndarray
    eye_index: np.ndarray
    pitch: float
    size: tuple[int, int]
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
        a = eye_from_index(grid, camera)
        eye = grid.index_from_world(camera.eye)
        return cls(kernel, a, eye, pitch, camera.size, camera.perspective, antialias, beyond)

    def voxels(self, positions: np.ndarray) -> np.ndarray:
        """Centres v [3, N] of splats at grid positions [N, 3]."""
        return np.asarray(self.eye_from_index @ (positions.astype(np.float64) - self.eye_index).T)

    def box(self, splats: Splats) -> np.ndarray:
        """Corners [3, 8] of the box of all splats, half a voxel larger."""
        return self.voxels(splats.corners_in_grid(0.5))

    @property
    def edge(self) -> np.ndarray:
        """[2]: slopes, or lengths, from the middle of the picture to its edges along x and y."""
        return np.array(self.size) / 2 * self.pitch

    @cached_property
    def index_from_eye(self) -> np.ndarray:
        """A⁻¹ [3, 3]: grid steps of an offset in eye axes, mean spacings."""
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
        """Half extent in depth of a kernel of unit radius."""
        return float(np.linalg.norm(self.eye_from_index[2]))

    @property
    def reach(self) -> float:
        """Half extent in depth of the kernel: an eye at least this far in front of the voxel is outside it."""
        return self.depth_reach * self.kernel.radius

    @cached_property
    def widened_beyond(self) -> tuple[float, float]:
        """Depths from which σ_1 and σ_2 are widened; ∞ for never.

        A kernel that reaches a third of the way to the eye's plane is not widened: rays diverge so much
        within it that no single width is right, and at the plane none exists.
        """
        if not self.antialias:
            return np.inf, np.inf
        if not self.perspective:
            first, second = (-np.inf if self.pitch > width else np.inf for width in self.widths)
            return first, second
        first, second = (max(float(width) / self.pitch, WIDEN_BEYOND * self.reach) for width in self.widths)
        return self.beyond or (first, second)

    def widened(self, z: np.ndarray) -> np.ndarray:
        """Whether antialiasing widens σ_1 and σ_2 at depth z [...]; bool [2, ...]."""
        return np.stack([np.asarray(z) > depth for depth in self.widened_beyond])

    def is_widened(self, z: np.ndarray) -> np.ndarray:
        """Whether antialiasing widens the voxel at depth z [...] at all; bool [...]."""
        return np.asarray(np.asarray(z) > self.widened_beyond[1])

    def pixel_side(self, z: np.ndarray) -> np.ndarray:
        """A pixel's side p at depth z [...]."""
        return self.pitch * np.asarray(z) if self.perspective else np.full(np.shape(z), self.pitch)

    def shrink(self, z: np.ndarray) -> np.ndarray:
        """[2, ...]: min(1, σ_i/p), the factors on offsets along the axes at the voxel's depth."""
        widened, p = self.widened(z), self.pixel_side(z)
        some = widened.any(axis=0)
        widths = [np.minimum(width / np.where(some, p, 1.0), 1.0) for width in self.widths]
        return np.where(widened, np.stack(widths), 1.0)

    def coverage(self, z: np.ndarray) -> np.ndarray:
        """The unwidened footprint's share of the widened one's area: 1/m² [M98 Eq. 6] for cubic voxels."""
        return np.asarray(self.shrink(z).prod(axis=0))
