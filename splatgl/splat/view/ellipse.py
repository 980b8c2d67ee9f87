"""A voxel's projection on a plane, antialiasing's smallest width, and the planes through the eye that touch a kernel.

Twin of `shaders/ellipse.glsl`. Lengths in mean spacings, eye axes; vectors are [3, N].
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from splatgl.splat.view.view import View


class Ellipse(NamedTuple):
    """Half axes of a kernel of unit radius, projected on a plane: unit vectors [3, N]; width [2, N], σ₁ ≥ σ₂."""

    axis_1: np.ndarray
    axis_2: np.ndarray
    width: np.ndarray


def perpendicular_axes(unit: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Two unit vectors perpendicular to the unit vectors [3, N] and to each other."""
    x, y, z = unit
    s = np.where(z < 0, -1.0, 1.0)
    a = -1 / (s + z)
    b = x * y * a
    return np.stack([1 + s * x * x * a, s * b, -s * x]), np.stack([b, s + y * y * a, -y])


def smallest_axis(view: View, z: np.ndarray) -> np.ndarray:
    """Antialiasing's smallest half axis at depth z [N]: a pixel's side; 0 without antialiasing.  [M98 Eq. 3]"""
    return view.pixel_side(np.maximum(z, 0.0)) if view.antialias else np.zeros(np.shape(z))


def voxel_ellipse(eye_from_index: np.ndarray, e1: np.ndarray, e2: np.ndarray) -> Ellipse:
    """The voxel's ellipse on the planes of the unit vectors e1 and e2: eigenvectors of the rows' products."""
    row_1, row_2 = eye_from_index.T @ e1, eye_from_index.T @ e2
    square_1, square_2, mixed = ((a * b).sum(axis=0) for a, b in ((row_1, row_1), (row_2, row_2), (row_1, row_2)))
    angle = 0.5 * np.arctan2(2 * mixed, square_1 - square_2)
    root = np.hypot((square_1 - square_2) / 2, mixed)
    # the widths' product from the cross product, without cancellation for flat voxels
    cross = np.cross(row_1, row_2, axis=0)
    area = np.sqrt((cross * cross).sum(axis=0))
    width_1 = np.sqrt((square_1 + square_2) / 2 + root)
    axis_1 = e1 * np.cos(angle) + e2 * np.sin(angle)
    axis_2 = e2 * np.cos(angle) - e1 * np.sin(angle)
    return Ellipse(axis_1, axis_2, np.stack([width_1, area / width_1]))


def tangents(
    x: np.ndarray | float, z: np.ndarray | float, step: np.ndarray, deep: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """How far below and above x/z the slopes s are at which planes through the eye touch an ellipsoid at (x, z).

    step, deep: components [3, ...] of its half axes along the picture and along depth. (x − s z)² = |step − s deep|².
    """
    a, b, c = z * z - _dot(deep, deep), x * z - _dot(step, deep), x * x - _dot(step, step)
    middle, root = b - a * x / z, np.sqrt(np.maximum(b * b - a * c, 0.0))
    return (root - middle) / a, (root + middle) / a


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.asarray(a[0] * b[0] + a[1] * b[1] + a[2] * b[2])
