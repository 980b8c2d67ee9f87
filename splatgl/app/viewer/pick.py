"""What is under the cursor: the first matter that a ray meets."""

from __future__ import annotations

import numpy as np

from splatgl.splat.extraction.splats import Splats
from splatgl.splat.view.camera import Camera
from splatgl.splat.view.view import eye_from_index

# a splat is met within this many voxels of the ray; the ray ends where it has gone through this optical depth
WITHIN = 1.0
ENOUGH = 0.7


def picked(splats: Splats, camera: Camera, place: tuple[float, float]) -> np.ndarray | None:
    """World point [3] of the matter under a pixel, None where there is none.

    It is where the ray's optical depth reaches ENOUGH (half of the light is gone), or, in fainter matter, its middle.
    """
    # the ray in the splats' grid, and each splat's distance from it, in mean spacings
    pitch = camera.extent / camera.size[1]
    across = (np.array(place) - np.array(camera.size) / 2) * pitch
    direction = np.array([*across, 1.0]) if camera.perspective else np.array([0.0, 0.0, 1.0])
    start = np.zeros(3) if camera.perspective else np.array([*across, 0.0])
    scale = splats.grid.mean_spacing
    axes = eye_from_index(splats.grid, camera).astype(np.float32)
    origin = (camera.eye_from_points(splats.grid.origin) - start) / scale
    unit = direction / np.linalg.norm(direction)
    points = splats.records["position"] @ axes.T + origin.astype(np.float32)
    along = points @ unit.astype(np.float32)
    near = np.flatnonzero((along > 0) & ((points * points).sum(axis=1) - along * along < WITHIN**2))
    if not len(near):
        return None

    # from the eye on, through what each adds
    near = near[np.argsort(along[near])]
    total = np.cumsum(splats.records["optical_depth"][near].astype(np.float64))
    met = near[int(np.searchsorted(total, min(ENOUGH, total[-1] / 2)))]
    return np.asarray((start + unit * float(along[met]) * scale) @ camera.eye_from_world + camera.eye)
