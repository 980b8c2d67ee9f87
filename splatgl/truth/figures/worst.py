"""The ray with a form's largest error: a fine sweep over each voxel's footprint, refined around its maximum.

An error is |form − row 1| of one splat on one ray. `Plane` is the paper's analysis in the (y, z) plane, where
a stretch by m attenuates by 1/m; `Space` is the splat as drawn.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from splatgl.splat.footprint import FORMS, ROWS, Splat, row1
from splatgl.splat.kernels import Kernel

Form = Callable[[Splat], np.ndarray]
ALL: dict[str, Form] = {**ROWS, **FORMS}

# rays across a footprint of the first sweep: in the plane, and along each of two axes
PLANE_RAYS = 401
SPACE_RAYS = 41
# the sweep's margin around the footprint
MARGIN = 1.05
# points along each axis of a refinement; each is four times finer, down to 1e−6 of a sweep's step
CLOSER = 9
ROUNDS = 7
# bisections of a footprint's rim: 1e−12 of a sweep
RIM_STEPS = 40
# fraction of a footprint inside its rim
INSIDE = 0.999


@dataclass(frozen=True)
class Peak:
    """value [N]: the largest of each of N functions; place [N, D]: where, in [−1, 1]^D."""

    value: np.ndarray
    place: np.ndarray


def maximum(function: Callable[[np.ndarray], np.ndarray], count: int, axes: int, points: int) -> Peak:
    """The largest values of `count` functions at once over [−1, 1]^axes.

    function: places [N, K, D] → values [N, K]. points: of the first sweep, along each axis.
    """
    middle, reach = np.zeros((count, 1, axes)), 1.0
    value = np.full(count, -np.inf)
    for look in range(ROUNDS + 1):
        steps = np.linspace(-1.0, 1.0, points if look == 0 else CLOSER)
        mesh = np.stack(np.meshgrid(*[steps] * axes, indexing="ij"), axis=-1).reshape(1, -1, axes)
        place = np.clip(middle + reach * mesh, -1.0, 1.0)
        found = function(place)
        best = found.argmax(axis=1)
        value = np.maximum(value, found[np.arange(count), best])
        middle = place[np.arange(count), best][:, None]
        reach *= steps[1] - steps[0]
    return Peak(value, middle[:, 0])


@dataclass(frozen=True)
class Plane:
    """Voxels (0, y, z) [N] and rays in their plane; place ±1 is a little outside of the footprint."""

    kernel: Kernel
    z_k: float
    y: np.ndarray
    z: np.ndarray

    @property
    def reach(self) -> np.ndarray:
        """[N]: slopes from the voxel's to the sweep's end."""
        m = np.maximum(self.z / self.z_k, 1.0)
        return np.asarray(MARGIN * self.kernel.radius * m / self.z * (1 + (self.y / self.z) ** 2))

    def slope(self, place: np.ndarray) -> np.ndarray:
        """Slopes dy/dz [N, K] of places [N or 1, K]."""
        return np.asarray((self.y / self.z)[:, None] + self.reach[:, None] * place)

    def splat(self, place: np.ndarray, planar: bool = True) -> Splat:
        """Arguments of the forms, for places [N or 1, K]; planar: False for the splat as drawn."""
        slope = self.slope(place)
        voxel = np.stack([np.zeros_like(self.y), self.y, self.z], axis=-1)[:, None]
        return Splat(self.kernel, voxel, np.stack([np.zeros_like(slope), slope], axis=-1), self.z_k, planar)

    def error(self, form: Form) -> Peak:
        """The largest |form − row 1| of each voxel, excluding its rim (see `spike`)."""
        return self._peak(lambda splat: difference(form, splat))

    def top(self) -> np.ndarray:
        """[N]: the largest value of row 1."""
        return self._peak(row1).value

    def spike(self, form: Form) -> np.ndarray:
        """[N]: the largest |form − row 1| where either footprint ends.

        The footprint of a truncated kernel falls to 0 like a square root; if the two end a few 1e−5 of
        their radius apart, the error is a spike of that width, which hardly any pixel samples.
        """
        rims = np.concatenate([self._rims(row1), self._rims(form)], axis=1)
        return np.asarray(difference(form, self.splat(rims)).max(axis=1))

    def _peak(self, value: Callable[[Splat], np.ndarray]) -> Peak:
        """The largest value within row 1's footprint but for its rim; place in that of the sweep."""
        low, high = (INSIDE * self._rims(row1)).T[:, :, None]
        middle, half = (low + high) / 2, (high - low) / 2
        found = maximum(lambda at: value(self.splat(middle + half * at[..., 0])), len(self.y), 1, PLANE_RAYS)
        return Peak(found.value, middle + half * found.place)

    def _rims(self, form: Form) -> np.ndarray:
        """Places [N, 2] just outside of a footprint, on either side."""
        inside, outside = np.zeros((len(self.y), 2)), np.tile([-1.0, 1.0], (len(self.y), 1))
        for _ in range(RIM_STEPS):
            middle = (inside + outside) / 2
            within = form(self.splat(middle)) > 0
            inside, outside = np.where(within, middle, inside), np.where(within, outside, middle)
        return outside

    def levels(self, form: Form) -> np.ndarray:
        """[N]: the largest error in levels, 1/255 of row 1's largest value."""
        return np.asarray(255 * self.error(form).value / self.top())


@dataclass(frozen=True)
class Space:
    """Voxels [N, 3], further from the eye than twice the kernel's radius, and all rays of their footprints.

    A place is (along the voxel's radial direction, across it) on the plane through the voxel perpendicular to
    its own ray; length 1 is the footprint's rim with a margin.
    """

    kernel: Kernel
    z_k: float
    voxel: np.ndarray

    def splat(self, place: np.ndarray) -> Splat:
        """Arguments of the forms, for places [N or 1, K, 2]."""
        v = self.voxel
        length = np.linalg.norm(v, axis=-1)
        out = np.hypot(v[:, 0], v[:, 1])
        unit = np.where(out[:, None] > 0, v[:, :2] / np.where(out > 0, out, 1.0)[:, None], (1.0, 0.0))
        radial = np.concatenate([unit * v[:, 2:], -out[:, None]], axis=-1) / length[:, None]
        across = np.stack([-unit[:, 1], unit[:, 0], np.zeros_like(out)], axis=-1)
        # a ball appears larger than its radius at the voxel's distance
        rim = MARGIN * self.kernel.radius * np.maximum(v[:, 2] / self.z_k, 1.0) * length / (length - self.kernel.radius)
        step = place * rim[:, None, None]
        ray = v[:, None] + step[..., :1] * radial[:, None] + step[..., 1:] * across[:, None]
        return Splat(self.kernel, v[:, None], ray[..., :2] / ray[..., 2:], self.z_k)

    def error(self, form: Form, rays: int = SPACE_RAYS) -> Peak:
        """The largest |form − row 1| of each voxel."""
        return maximum(lambda place: difference(form, self.splat(place)), len(self.voxel), 2, rays)

    def top(self, rays: int = SPACE_RAYS) -> np.ndarray:
        """[N]: the largest value of row 1."""
        return maximum(lambda place: row1(self.splat(place)), len(self.voxel), 2, rays).value

    def levels(self, form: Form) -> np.ndarray:
        """[N]: the largest error in levels, 1/255 of row 1's largest value."""
        return np.asarray(255 * self.error(form).value / self.top())


def difference(form: Form, splat: Splat) -> np.ndarray:
    """|form − row 1|."""
    return np.abs(form(splat) - row1(splat))
