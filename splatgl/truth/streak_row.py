"""A moving splat along a pixel's ray, in float64: the twin of `shaders/streak.glsl`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from splatgl.splat.line_integral import Integral, row1
from splatgl.splat.motion_blur import blur_table, energy_gain, paper_gain, stretched
from splatgl.splat.view import View
from splatgl.truth.pairs import Row


@dataclass(frozen=True, eq=False)
class StreakRow(Row):
    """Row 1 for voxels [3, N] that move by step [2, N] across the view; motion: exact, energy or paper."""

    step: np.ndarray
    motion: str

    def on(self, splat: np.ndarray, ray: np.ndarray) -> Integral:
        """value: the mean along the path; peak: the maximum."""
        voxel, step = self.voxel[:, splat], self.step[:, splat]
        found = row1(self.view, voxel, ray)
        found.peak[:] = found.value
        # a kernel around the eye has no image position to move from
        moving = np.flatnonzero(step.any(axis=0) & (voxel[2] > self.view.reach))
        if len(moving):
            passed = passing(self.view, voxel[:, moving], ray[:, moving], step[:, moving])
            found.value[moving] = passed.streak_shape(self.view, self.motion)
            found.peak[moving] = passed.most(self.view)
        return found


@dataclass(frozen=True, eq=False)
class Passing:
    """Rays' closest passes of moving kernels, in the kernel's own units.

    along, across [P]: the offset along and across the path; length [P]: the path's; gain [P]: integral over F.
    """

    along: np.ndarray
    across: np.ndarray
    length: np.ndarray
    gain: np.ndarray

    def streak_shape(self, view: View, motion: str) -> np.ndarray:
        """Values [P] of the streaks; motion: exact by the blur table, energy or paper by a scaled peak."""
        kernel = view.kernel
        if motion == "exact":
            table = blur_table(kernel.name, dtype="<f8")
            peak = kernel.footprint(np.zeros(()))
            return np.asarray(self.gain * peak * table.blurred(self.along, self.across, self.length))
        weaken = energy_gain if motion == "energy" else paper_gain
        return np.asarray(weaken(kernel, self.length) * self.most(view))

    def most(self, view: View) -> np.ndarray:
        """The maximum on the path: at the closest point."""
        return np.asarray(self.gain * stretched(view.kernel, self.along, self.across, self.length))


class Inner(NamedTuple):
    """Maps offsets across the view to the kernel's own axes: axes [3, 2, N]; shrink: see View.shrink."""

    axes: np.ndarray
    shrink: np.ndarray


def inner_of(view: View, z: np.ndarray) -> Inner:
    """The map of voxels at depth z [N], antialiasing included."""
    shrink = view.shrink(z)
    own = view.index_from_eye[:, :2] @ view.axes
    return Inner(np.einsum("ij,jn,kj->ikn", own, shrink, view.axes), shrink)


def passing(view: View, voxel: np.ndarray, ray: np.ndarray, step: np.ndarray) -> Passing:
    """How rays [2, N] pass voxels [3, N] that move by step [2, N].

    Beyond z_k in perspective space, where the ray has the voxel's slope; first-order term of the trapezoid.
    """
    z = voxel[2]
    inner = inner_of(view, z)
    if view.perspective:
        slope = np.where(view.is_widened(z), voxel[:2] / z, ray)
        offset, seconds, depth = ray * z - voxel[:2], np.sqrt(1 + (ray * ray).sum(axis=0)), z
    else:
        slope = np.zeros_like(step)
        offset, seconds, depth = ray - voxel[:2], np.ones_like(z), np.full_like(z, np.inf)

    # offset, slope and step in the kernel's own axes, scaled down where antialiasing widens
    o, line, move = (inner.axes[:, 0] * vector[0] + inner.axes[:, 1] * vector[1] for vector in (offset, slope, step))
    ahead = view.index_from_eye[:, 2:]
    line = line + ahead
    square = (line * line).sum(axis=0)
    t = -(o * line).sum(axis=0) / square
    across_line = move - (move * line).sum(axis=0) / square * line
    length = np.sqrt((across_line * across_line).sum(axis=0))
    heading = across_line / np.where(length > 0, length, 1.0)
    gain = seconds * inner.shrink[0] * inner.shrink[1] / np.sqrt(square)

    # the point on the path nearest to the ray, and the offset from there to the ray
    r = o + t * line
    passed = np.clip((r * heading).sum(axis=0), -length / 2, length / 2)
    r = r - passed * heading
    t = t + passed / np.where(length > 0, length, 1.0) * (move * line).sum(axis=0) / square

    # the ray bends in a widened kernel: the trapezoid's term shifts it and changes its length
    bends = np.where(inner.shrink.min(axis=0) < 1, 1 / depth, 0.0)
    toward, deep = (r * ahead).sum(axis=0), (line * ahead).sum(axis=0)
    distance2 = (r * r).sum(axis=0)
    moved = np.maximum(distance2 + 2 * bends * t * t * toward, 0.0)
    r = r * np.sqrt(moved / np.where(distance2 > 0, distance2, 1.0))
    gain = gain * (1 - bends * (2 * t * deep + toward) / square)

    further = (r * heading).sum(axis=0)
    across = np.sqrt(np.maximum((r * r).sum(axis=0) - further * further, 0.0))
    return Passing(passed + further, across, length, gain)
