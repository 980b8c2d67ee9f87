"""The uniform blocks Frame and Style of `shaders/frame.glsl` and Path of `motion.glsl`, mirrored as std140 records."""

from __future__ import annotations

import numpy as np

from splatgl.splat.blur import line_area
from splatgl.splat.camera import FAR, Camera
from splatgl.splat.plan import Plan
from splatgl.splat.quads import NEAR
from splatgl.splat.rows import Splats
from splatgl.splat.shading import AMBIENT, DIFFUSE

# binding points of the blocks
FRAME_BINDING, STYLE_BINDING, PATH_BINDING = 0, 1, 2

FRAME = np.dtype(
    {
        "names": [
            "eye_from_index",
            "index_from_eye",
            "eye_from_world",
            "base",
            "eye_from_base",
            "clip_scale",
            "pixel_pitch",
            "switch_depth",
            "near",
            "depth_reach",
            "image_center",
            "beyond",
            "reach",
        ],
        "formats": [*[("<f4", (3, 4))] * 3, "<4f4", "<4f4", "<2f4", "<f4", "<f4", "<f4", "<f4", *["<2f4"] * 3],
        "offsets": [0, 48, 96, 144, 160, 176, 184, 188, 192, 196, 200, 208, 216],
        "itemsize": 224,
    }
)
STYLE = np.dtype(
    {
        "names": ["radius", "peak", "opacity_length", "ambient", "diffuse", "radial_scale", "radial_last", "brightest"],
        "formats": ["<f4"] * 8,
        "offsets": [0, 4, 8, 12, 16, 20, 24, 28],
        "itemsize": 32,
    }
)
PATH = np.dtype(
    {
        "names": ["first_from_index", "last_from_index", "first_from_base", "last_from_base", "line", "weaken"],
        "formats": [*[("<f4", (3, 4))] * 2, "<4f4", "<4f4", "<f4", "<f4"],
        "offsets": [0, 48, 96, 112, 128, 132],
        "itemsize": 144,
    }
)

# a depth that nothing is beyond, mean spacings
FURTHEST = 1e30


def frame_block(splats: Splats, camera: Camera, plan: Plan) -> np.ndarray:
    """The view, computed in float64 in units of the mean spacing and only then rounded; FRAME, shape ()."""
    spacing = splats.grid.mean_spacing
    block = np.zeros((), FRAME)
    eye = splats.grid.index_from_world(camera.eye)
    pitch = camera.extent / (camera.size[1] * plan.samples)
    aspect = camera.size[0] / camera.size[1]
    fine = np.array(camera.size) * plan.samples
    scale = np.array([2 / (camera.extent * aspect), 2 / camera.extent])

    eye_from_index = camera.eye_from_world @ splats.grid.world_from_index / spacing
    block["eye_from_index"][:, :3] = eye_from_index.T
    block["index_from_eye"][:, :3] = np.linalg.inv(eye_from_index).T
    block["eye_from_world"][:, :3] = camera.eye_from_world.T
    # a far eye's offset is along the view, so that across it float32 loses nothing
    base = _base(splats, eye)
    block["base"][:3] = base
    block["eye_from_base"][:3] = eye_from_index @ (eye - base)
    # a picture that is wider by the pad on every side
    scale *= fine / (fine + 2 * plan.pad)
    block["clip_scale"] = scale if camera.perspective else scale * spacing
    block["pixel_pitch"] = pitch if camera.perspective else pitch / spacing
    block["switch_depth"] = min(plan.z_s / spacing, 2 * FAR)
    block["near"] = NEAR
    block["depth_reach"] = plan.kernel.radius * np.linalg.norm(eye_from_index[2])
    block["image_center"] = fine / 2
    # what is never widened, or always, by numbers that float32 has
    block["beyond"] = np.clip(plan.beyond, -FURTHEST, FURTHEST)
    block["reach"] = fine / 2 + plan.pad
    return block


def path_block(splats: Splats, plan: Plan) -> np.ndarray:
    """Where the grid is when the shutter opens and closes, as the middle's lens shows it; PATH, shape ()."""
    assert plan.exposure is not None
    block = np.zeros((), PATH)
    middle, grid = plan.exposure.middle, splats.grid
    base = _base(splats, grid.index_from_world(middle.eye))
    for name, camera in (("first", plan.exposure.first), ("last", plan.exposure.last)):
        # the same steps as for the middle, so that what stands still has no path
        moved = camera.eye_from_world @ grid.world_from_index / grid.mean_spacing
        moved[:2] *= middle.extent / camera.extent
        block[f"{name}_from_index"][:, :3] = moved.T
        block[f"{name}_from_base"][:3] = moved @ (grid.index_from_world(camera.eye) - base)
    line = float(line_area(plan.kernel, np.zeros(())))
    block["line"] = line
    # E₁/(E₁ + l W), or the disc's share  [M98 Eq. 11]
    block["weaken"] = 2 / (np.pi * plan.kernel.radius) if plan.program.motion == "paper" else line
    return block


def _base(splats: Splats, eye: np.ndarray) -> np.ndarray:
    return np.asarray(np.clip(np.rint(eye), *np.rint(splats.index_bounds)))


def style_block(splats: Splats, plan: Plan) -> np.ndarray:
    """The scene's numbers; STYLE, shape ()."""
    block = np.zeros((), STYLE)
    block["radius"] = plan.kernel.radius
    block["peak"] = plan.kernel.footprint(np.zeros(()))
    block["opacity_length"] = splats.unit / splats.grid.mean_spacing
    block["radial_scale"] = (plan.table_size - 1) / plan.kernel.radius**2
    block["radial_last"] = plan.table_size - 1
    block["brightest"] = max(splats.brightest, 1.0)
    block["ambient"], block["diffuse"] = AMBIENT, DIFFUSE
    return block
