"""Screen extents of splats: boxes that contain every ray on which the footprint is nonzero.

Lengths in mean spacings, eye axes; boxes are of slopes (perspective) or of eye x, y (orthographic).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from splatgl.splat.camera import Camera
from splatgl.splat.culling import STRETCHED, Window
from splatgl.splat.view import View, smallest_axis

# relative enlargement of a box against rounding
MARGIN = 1e-9
# splats looked at together: their temporaries stay in the cache
SOME = 1 << 16


@dataclass(frozen=True, eq=False)
class Boxes:
    """Pixels left ≤ column < right, top ≤ row < bottom; int64 [N]; empty ones have right = left."""

    left: np.ndarray
    right: np.ndarray
    top: np.ndarray
    bottom: np.ndarray


def pixel_boxes(view: View, row: str, voxel: np.ndarray, camera: Camera) -> Boxes:
    """The pixels of `camera` that voxels [3, N] can reach in that row of Table 1."""
    left, right, top, bottom = pixel_ends(view, row, voxel, camera)
    empty = (right <= left) | (bottom <= top)
    return Boxes(left, np.where(empty, left, right), top, bottom)


def pixel_ends(view: View, row: str, voxel: np.ndarray, camera: Camera) -> tuple[np.ndarray, ...]:
    """left, right, top and bottom separately: equal if no pixel centre lies between, right < left if the voxel is not
    visible.
    """
    low, high = _bounds(view, row, voxel, camera)
    width, height = camera.size
    grow = MARGIN * (high - low)
    ends = []
    for axis, count in ((0, width), (1, height)):
        # pixel i's centre is at (i + ½ − count/2) · pitch
        first = np.ceil((low[axis] - grow[axis]) / view.pitch + count / 2 - 0.5)
        last = np.floor((high[axis] + grow[axis]) / view.pitch + count / 2 - 0.5) + 1
        ends += [np.clip(end, 0, count).astype(np.int64) for end in (first, last)]
    return tuple(ends)


def _bounds(view: View, row: str, voxel: np.ndarray, camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    """Lowest and highest slope, or x and y, [2, N] each; low > high if not visible."""
    z = voxel[2]
    if not view.perspective:
        half = _half_axes(view, view.widths[:, None] / view.shrink(z))
        return voxel[:2] - half, voxel[:2] + half
    corner = np.array([camera.extent * camera.size[0] / camera.size[1], camera.extent]) / 2
    if row == "row5":
        ahead = z > 0
        depth = np.where(ahead, z, 1.0)
        p = smallest_axis(view, depth)
        half = _half_axes(view, np.maximum(view.widths[:, None], p))
        return (voxel[:2] - half) / depth, np.where(ahead, (voxel[:2] + half) / depth, -np.inf)
    if row == "row4":
        # the quad's outline from the eye is inside that of a ball
        p = smallest_axis(view, z)
        size = view.kernel.radius * np.maximum(np.linalg.norm(view.eye_from_index, 2), p)
        length = np.sqrt((voxel * voxel).sum(axis=0))
        square = (size / np.maximum(np.hypot(length, size), 1e-300) * length) ** 2
        return _outline(voxel, corner, (square, square, square, 0.0, 0.0))
    low, high = _outline(voxel, corner, _ellipsoid(view))
    widened = view.is_widened(z)
    some = _widened(view, row, voxel[:, widened], corner)
    low[:, widened], high[:, widened] = some
    return low, high


def _half_axes(view: View, size: np.ndarray) -> np.ndarray:
    """[2, N]: half extents of an ellipse across the view with half axes size · R [2, N] along the view's axes."""
    return np.asarray(view.kernel.radius * np.sqrt((view.axes**2) @ (size * size)))


Quadric = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray | float, np.ndarray | float]


def _ellipsoid(view: View) -> Quadric:
    """R² A Aᵀ, an ellipsoid that contains the kernel: its xx, yy, zz, xz and yz."""
    q = view.kernel.radius**2 * view.eye_from_index @ view.eye_from_index.T
    return q[0, 0], q[1, 1], q[2, 2], q[0, 2], q[1, 2]


def _outline(voxel: np.ndarray, corner: np.ndarray, quadric: Quadric) -> tuple[np.ndarray, np.ndarray]:
    """Lowest and highest slopes of ellipsoids around voxels seen from the eye, [2, N] each.

    A plane through the eye is tangent where (n·v)² = nᵀQn. An ellipsoid that crosses the eye plane counts as visible
    everywhere, unless it is entirely outside of the image's sides or behind the eye.
    """
    z, zz = voxel[2], quadric[2]
    reach = np.sqrt(zz)
    before = z > reach
    low, high = np.full((2, len(z)), -np.inf), np.full((2, len(z)), np.inf)
    hidden = z <= -reach
    for axis, (aa, az) in enumerate(((quadric[0], quadric[3]), (quadric[1], quadric[4]))):
        a = voxel[axis]
        scale = np.where(before, (z - reach) * (z + reach), 1.0)
        root = np.sqrt(np.maximum(z * z * aa - 2 * a * z * az + a * a * zz - (aa * zz - az * az), 0.0))
        low[axis] = np.where(before, (a * z - az - root) / scale, low[axis])
        high[axis] = np.where(before, (a * z - az + root) / scale, high[axis])
        for side in (-1.0, 1.0):
            slope = side * corner[axis]
            hidden |= side * (a - slope * z) > np.sqrt(np.maximum(aa - 2 * slope * az + slope * slope * zz, 0.0))
    return np.where(hidden, np.inf, low), np.where(hidden, -np.inf, high)


def _widened(view: View, row: str, voxel: np.ndarray, corner: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The same for voxels widened by antialiasing: their lateral extent is the kernel's or a pixel's."""
    z = voxel[2]
    near = z - view.reach
    half = _half_axes(view, np.maximum(view.widths[:, None] / near, view.pixel_side(z) / z))
    if row in ("row2", "row3"):
        # their slant to the plane at the voxel's depth, or to its own ray, is at most the image corner's
        length, radius = np.sqrt((voxel * voxel).sum(axis=0)), view.kernel.radius
        half = half * np.sqrt(1 + corner @ corner) * length / np.sqrt((length - radius) * (length + radius))
    ends = np.stack([voxel[:2] / near, voxel[:2] / (z + view.reach)])
    return ends.min(axis=0) - half, ends.max(axis=0) + half


def reaching(positions: np.ndarray, view: View, windows: Sequence[Window], around: float = 0.0) -> np.ndarray:
    """Which splats may reach one of the windows of the picture, bool [N]: those near enough to all of its sides.

    positions [N, 3]: grid indices; around: of any splats that far, in grid steps, from these.
    """
    parts = (positions[start : start + SOME] for start in range(0, len(positions), SOME))
    return np.concatenate([np.zeros(0, bool), *(_reaching(part, view, windows, around) for part in parts)])


def _reaching(positions: np.ndarray, view: View, windows: Sequence[Window], around: float) -> np.ndarray:
    v = view.voxels(positions)
    # a ball around the kernel; beyond z_k footprints grow with depth
    reach = (view.kernel.radius + around) * np.linalg.norm(view.eye_from_index, 2)
    widest = STRETCHED * view.kernel.radius * view.pitch * view.antialias
    depth = np.ones(len(positions))
    if view.perspective:
        depth = np.where(v[2] > 0, v[2], 1.0)
        steepest = float(np.abs(np.array(view.size) / 2 + 1).max()) * view.pitch
        # from a plane through the eye to a point: the difference of slopes, times depth, over this
        reach, widest = reach * np.hypot(1.0, steepest), widest * np.hypot(1.0, steepest)
    half = np.maximum(reach / depth, widest)
    found = np.zeros(len(positions), bool)
    places, half = v[:2] / depth / view.pitch, half / view.pitch
    for window in windows:
        x, y = window.x + (window.width - view.size[0]) / 2, window.y + (window.height - view.size[1]) / 2
        near = np.flatnonzero(np.abs(places[0] - x) <= half + (window.width / 2 + 1))
        found[near[np.abs(places[1, near] - y) <= half[near] + (window.height / 2 + 1)]] = True
    if view.perspective:
        found = np.where(v[2] > 0, found, v[2] > -reach)
    return found
