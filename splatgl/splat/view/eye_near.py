"""Whether a kernel contains the eye or crosses its plane: it then has no projection, as rays start inside it."""

from __future__ import annotations

import numpy as np

from splatgl.splat.extraction.splats import Splats
from splatgl.splat.motion.motion import Exposure
from splatgl.splat.view.block_culling import Frustum
from splatgl.splat.view.slab import between
from splatgl.splat.view.view import View

# half lines are compiled in if a splat is nearer in depth than this many kernel reaches; tiles take them for those
# nearer than HAS_PLACE reaches, the others have a place in the picture. Between the two both draw the same, so that no
# rounding of float32 decides whether a splat is drawn
AROUND_EYE, HAS_PLACE = 2.0, 1.5
# a moving kernel's centre is near within this many radii: the root of HALF_LINE_REACH, with a margin
NEAR_RADII = 1.06
# quads: a kernel is around the eye if its centre is nearer than √HALF_LINE_REACH radii
HALF_LINE_REACH = 1.1


def eye_is_near(splats: Splats, view: View, exposure: Exposure | None) -> bool:
    """Whether a potentially visible splat is around the eye; perspective views only."""
    if not len(splats):
        return False
    low, high = splats.index_bounds
    if exposure is not None:
        # within reach of the box of all centres, flow included
        near = NEAR_RADII * view.kernel.radius
        if exposure.flow is not None:
            near += float(np.linalg.norm(exposure.drift(splats), axis=1).max())
        return bool(np.linalg.norm(view.eye_index - np.clip(view.eye_index, low, high)) < near)
    box = np.where(view.eye_from_index[2] > 0, low, high) - view.eye_index
    if view.eye_from_index[2] @ box > AROUND_EYE * view.reach:
        return False
    return bool(Frustum.of(view).reached(between(splats, view, -view.reach, AROUND_EYE * view.reach)).any())
