"""Clips a parallel view's splats behind the plane through its eye; decided once, in float64."""

from __future__ import annotations

from weakref import WeakKeyDictionary

import numpy as np

from splatgl.splat.extraction.splats import Splats
from splatgl.splat.view.camera import Camera

# rounding: a splat behind the plane by less than this share of its distance from the eye counts as on it
ON_PLANE = 1e-9
# cache: the latest clipping plane of each set of splats, and its result
_latest: WeakKeyDictionary[Splats, tuple[tuple[float, ...], Splats]] = WeakKeyDictionary()


def ahead(splats: Splats, camera: Camera) -> Splats:
    """The splats not behind a parallel view's eye; all in a perspective view. Caches the latest result."""
    if camera.perspective or not len(splats):
        return splats
    depth = camera.eye_from_points(splats.corners)
    if depth[:, 2].min() >= 0.0:
        return splats
    plane = (*camera.eye.tolist(), *camera.forward.tolist())
    latest = _latest.get(splats)
    if latest is None or latest[0] != plane:
        latest = plane, _cut(splats, camera, ON_PLANE * float(np.linalg.norm(depth, axis=1).max()))
        _latest[splats] = latest
    return latest[1]


def _cut(splats: Splats, camera: Camera, slack: float) -> Splats:
    """The splats without those behind the eye by more than `slack`, world units."""
    normal = camera.forward @ splats.grid.world_from_index
    offset = camera.forward @ (splats.grid.origin - camera.eye)
    kept = splats.positions @ normal + offset >= -slack
    return splats if kept.all() else splats.part(kept)
