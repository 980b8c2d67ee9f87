"""Picking: the first matter along the ray through the cursor."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from splatgl.app.viewer.content import Content
from splatgl.app.viewer.measuring import under_cursor
from splatgl.app.viewer.pacing import STRIDES
from splatgl.app.viewer.state import State
from splatgl.splat.camera import Camera
from splatgl.splat.clipping import Clip, Plane
from splatgl.splat.splats import Splats
from splatgl.splat.view import eye_from_index

# splats within this many voxels of the ray count; the ray ends at this optical depth
WITHIN = 1.0
ENOUGH = 0.7


def pivoted(state: State, content: Content, place: tuple[float, float]) -> State:
    """The state with the matter under a pixel as its centre of rotation, if there is any."""
    if state.parts:
        # of layers and meshes
        seen = under_cursor(state, content, place)
        found = None if seen is None else np.array(seen.place)
    else:
        found = picked(content.at(STRIDES[1]), state.pose.camera, place, state.settings.clip)
    if found is None:
        return replace(state, message="nothing here to turn about")
    return replace(state, pose=state.pose.about(found), message="turns about this point")


def picked(
    splats: Splats, camera: Camera, place: tuple[float, float], cuts: tuple[Plane, ...] = ()
) -> np.ndarray | None:
    """World point [3] of the matter under a pixel that planes keep; None if there is none.

    The point is at optical depth ENOUGH (half of the light is absorbed), or, in fainter matter, at its middle.
    """
    # the ray in the splats' grid, and the distances of the splats from it in mean spacings
    pitch = camera.extent / camera.size[1]
    across = (np.array(place) - np.array(camera.size) / 2) * pitch
    direction = np.array([*across, 1.0]) if camera.perspective else np.array([0.0, 0.0, 1.0])
    start = np.zeros(3) if camera.perspective else np.array([*across, 0.0])
    scale = splats.grid.mean_spacing
    axes = eye_from_index(splats.grid, camera).astype(np.float32)
    origin = (camera.eye_from_points(splats.grid.origin) - start) / scale
    unit = direction / np.linalg.norm(direction)
    points = splats.positions @ axes.T + origin.astype(np.float32)
    along = points @ unit.astype(np.float32)
    near = np.flatnonzero((along > 0) & ((points * points).sum(axis=1) - along * along < WITHIN**2))
    clip = Clip.of(cuts, splats.grid)
    near = near if clip is None else near[clip.keeps(splats.positions[near])]
    depth = splats.depths_of(near).astype(np.float64)
    if not depth.any():
        return None

    # front to back, accumulating optical depth
    order = np.argsort(along[near])
    near, total = near[order], np.cumsum(depth[order])
    met = near[int(np.searchsorted(total, min(ENOUGH, total[-1] / 2)))]
    return np.asarray((start + unit * float(along[met]) * scale) @ camera.eye_from_world + camera.eye)
