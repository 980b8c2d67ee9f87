"""The uniform blocks Frame and Style of `shaders/frame.glsl`, mirrored as std140 records."""

from __future__ import annotations

from typing import Any

import numpy as np

from splatgl.geometry.camera import FAR
from splatgl.geometry.view import eye_from_index
from splatgl.planning.culling import Frustum
from splatgl.planning.plan import Plan
from splatgl.splat.footprint import NEAR
from splatgl.splat.motion import Exposure
from splatgl.splat.motion_blur import line_area
from splatgl.splat.sheets import counted_box
from splatgl.splat.splats import Splats

# binding points of the blocks
FRAME_BINDING, STYLE_BINDING = 0, 1

# types of GLSL in numpy; a matrix is three columns of a vec4
FLOAT, VEC2, VEC4, MATRIX = np.dtype("<f4"), np.dtype("<2f4"), np.dtype("<4f4"), np.dtype(("<f4", (3, 4)))


def std140(*rows: tuple[Any, ...]) -> np.dtype:
    """Returns the record of a block whose rows are a type and the names of its fields: each begins at a multiple of its
    size, of 16 bytes at most, and the record is as long as whole vec4s.
    """
    fields = [(name, kind) for kind, *names in rows for name in names]
    offsets, end = [], 0
    for _, kind in fields:
        offsets.append(-(-end // min(kind.itemsize, 16)) * min(kind.itemsize, 16))
        end = offsets[-1] + kind.itemsize
    names, formats = zip(*fields, strict=True)
    return np.dtype({"names": names, "formats": formats, "offsets": offsets, "itemsize": -(-end // 16) * 16})


FRAME = std140(
    (MATRIX, "eye_from_index", "index_from_eye", "eye_from_world"),
    (VEC4, "base", "eye_from_base"),
    (VEC2, "clip_scale"),
    (FLOAT, "pixel_pitch", "switch_depth", "near", "depth_reach"),
    (VEC2, "image_center", "beyond", "edge", "support", "stretch"),
    (MATRIX, "first_from_index", "last_from_index"),
    (VEC4, "first_from_base", "last_from_base"),
    (FLOAT, "line", "weaken", "blur"),
)
STYLE = std140(
    (FLOAT, "radius", "peak", "opacity_length", "ambient", "diffuse", "radial_scale", "radial_last", "brightest"),
    (FLOAT, "specular", "sharpness"),
    (VEC4, "light"),
)
# a depth beyond all splats, in mean spacings
FURTHEST = 1e30


def frame_block(splats: Splats, plan: Plan) -> np.ndarray:
    """Returns the view in units of the mean spacing, computed in float64, then rounded: FRAME, shape ()."""
    view, block = plan.view, np.zeros((), FRAME)
    block["eye_from_index"][:, :3] = view.eye_from_index.T
    block["index_from_eye"][:, :3] = view.index_from_eye.T
    block["eye_from_world"][:, :3] = plan.resolved.camera.eye_from_world.T
    # the offset of a far eye is along the view: no float32 loss across the view
    base = base_of(splats, view.eye_index)
    block["base"][:3] = base
    block["eye_from_base"][:3] = view.eye_from_index @ (view.eye_index - base)
    block["clip_scale"] = 1 / view.edge
    block["pixel_pitch"], block["blur"] = view.pitch, view.blur
    block["switch_depth"] = min(plan.z_s / splats.grid.mean_spacing, 2 * FAR)
    block["near"] = NEAR
    block["depth_reach"] = view.reach
    block["image_center"] = np.array(view.size) / 2
    # infinite depths (never or always widened) are clipped to float32
    block["beyond"] = np.clip(view.widened_beyond, -FURTHEST, FURTHEST)
    frustum = Frustum.of(view)
    block["edge"], block["support"], block["stretch"] = frustum.edge, frustum.support, frustum.stretch
    if plan.exposure is not None:
        _add_path(block, splats, plan, plan.exposure)
    return block


def _add_path(block: np.ndarray, splats: Splats, plan: Plan, exposure: Exposure) -> None:
    """Writes the grid placement when the shutter opens and closes, in the field of view of the exposure's middle."""
    middle, grid = exposure.middle, splats.grid
    base = base_of(splats, grid.index_from_world(middle.eye))
    for name, camera in (("first", exposure.first), ("last", exposure.last)):
        # same operations as for the middle, so that splats at rest have a path of length zero
        matrix = eye_from_index(grid, camera)
        matrix[:2] *= middle.extent / camera.extent
        block[f"{name}_from_index"][:, :3] = matrix.T
        block[f"{name}_from_base"][:3] = matrix @ (grid.index_from_world(camera.eye) - base)
    line = float(line_area(plan.kernel, np.zeros(())))
    block["line"] = line
    # E₁/(E₁ + l W), or the disc's share  [M98 Eq. 11]
    block["weaken"] = 2 / (np.pi * plan.kernel.radius) if plan.program.motion == "paper" else line


def base_of(splats: Splats, eye: np.ndarray) -> np.ndarray:
    """Returns frame.base [3], the voxel nearest to the eye in grid indices."""
    return np.asarray(np.clip(np.rint(eye), *np.rint(counted_box(splats))))


def style_block(splats: Splats, plan: Plan) -> np.ndarray:
    """Returns the constants of the scene: STYLE, shape ()."""
    block = np.zeros((), STYLE)
    block["radius"] = plan.kernel.radius
    block["peak"] = plan.kernel.footprint(np.zeros(()))
    block["opacity_length"] = splats.unit / splats.grid.mean_spacing
    block["radial_scale"] = (plan.lookup.size - 1) / plan.kernel.radius**2
    block["radial_last"] = plan.lookup.size - 1
    block["brightest"] = max(splats.brightest, 1.0)
    light = plan.program.look.light
    for name in ("ambient", "diffuse", "specular", "sharpness"):
        block[name] = getattr(light, name)
    if light.direction is not None:
        block["light"] = (*light.direction, 1.0)
    return block
