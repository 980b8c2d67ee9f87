"""Clips a parallel view's splats behind the plane through its eye; decided once, in float64.

Values of the field on the plane depend on voxels behind it, too: of those classified after reconstruction so many are
kept, as rays begin at the plane.
"""

from __future__ import annotations

import numpy as np

from splatgl.splat.extraction.kept import LatestParts
from splatgl.splat.extraction.splats import Splats
from splatgl.splat.kernel.kernels import kernel
from splatgl.splat.view.camera import Camera

# rounding: a splat behind the plane by less than this share of its distance from the eye counts as on it
ON_PLANE = 1e-9
# kernel radii behind the plane, across it, within which values on it and in the sheets around it depend on voxels
BEHIND = 3.0
# cache: of the latest plane through the eye
_latest = LatestParts()


def ahead(splats: Splats, camera: Camera) -> Splats:
    """The splats not behind a parallel view's eye, of labels those not wholly behind it; all in a perspective view.
    Caches the latest result.
    """
    if camera.perspective or not len(splats):
        return splats
    depth = camera.eye_from_points(splats.corners)
    if depth[:, 2].min() >= 0.0:
        return splats
    plane = (*camera.eye.tolist(), *camera.forward.tolist())
    slack = ON_PLANE * float(np.linalg.norm(depth, axis=1).max())
    if splats.labels is not None:
        # a box is cut where the plane cuts it
        slack += 0.5 * float(np.abs(camera.forward @ splats.grid.world_from_index).sum())
    return _latest.of(splats, plane, lambda: _kept(splats, camera, slack))


def _kept(splats: Splats, camera: Camera, slack: float) -> np.ndarray:
    """bool [N]: which splats are not behind the eye by more than `slack`, world units."""
    normal = camera.forward @ splats.grid.world_from_index
    offset = camera.forward @ (splats.grid.origin - camera.eye)
    if splats.post is not None:
        slack += BEHIND * kernel(splats.post.kernel).radius * float(np.linalg.norm(normal))
    return np.asarray(splats.positions @ normal + offset >= -slack)
