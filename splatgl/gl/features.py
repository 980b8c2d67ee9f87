"""Table of the optional features of shaders, and the uniform blocks Frame and Style of `shaders/frame.glsl`.

A switch chooses between an include and its twin without effect (`clip_ray.glsl`, `clip_ray_off.glsl`). To add a
feature, add a row and an include.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any

import moderngl
import numpy as np

from splatgl.errors import expected
from splatgl.geometry.camera import FAR
from splatgl.geometry.clipping import MOST_CLIPS
from splatgl.geometry.view import eye_from_index
from splatgl.planning.culling import Frustum
from splatgl.planning.plan import Plan, Program
from splatgl.splat.footprint import NEAR
from splatgl.splat.motion import Exposure
from splatgl.splat.motion_blur import line_area
from splatgl.splat.sheets import counted_box
from splatgl.splat.splats import Splats
from splatgl.transfer.regions import MOST_ISO, MOST_REGIONS

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
    light = plan.program.appearance.light
    for name in ("ambient", "diffuse", "specular", "sharpness"):
        block[name] = getattr(light, name)
    if light.direction is not None:
        block["light"] = (*light.direction, 1.0)
    return block


Uniforms = dict[str, object]
# texture unit of each sampler of a field on voxels or cells
FIELD_UNITS = {"sky_field": 18, "shade_field": 19, "mask_field": 20}


@dataclass(frozen=True)
class Feature:
    """Optional feature of shaders. switch: is set if `is_on`. uniforms: values of the include's uniforms. fields: the
    include's textures by sampler, float32 or uint8 [D, H, W] or [D, H, W, 4].
    """

    switch: str
    is_on: Callable[[Program], bool]
    uniforms: Callable[[Splats, Plan], Uniforms] = lambda splats, plan: {}
    fields: Callable[[Splats, Plan], Mapping[str, np.ndarray | None]] = lambda splats, plan: {}


def clip_uniforms(splats: Splats, plan: Plan) -> Uniforms:
    """Returns the clip planes of clip_ray.glsl, relative to the eye, with unit normals in index space."""
    clip = plan.resolved.clip
    assert clip is not None
    planes, normals = np.zeros((MOST_CLIPS, 4)), np.zeros((MOST_CLIPS, 3))
    rows = np.column_stack([clip.g, clip.place - clip.g @ plan.view.eye_index])
    planes[: len(rows)] = rows / np.linalg.norm(clip.g, axis=1)[:, None]
    normals[: len(rows)] = clip.normal
    return {"clips": len(rows), "clip": [*map(tuple, planes)], "clip_normal": [*map(tuple, normals)]}


def mask_uniforms(splats: Splats, plan: Plan) -> Uniforms:
    """Returns the position of the field of mask_ray.glsl, relative to the eye, in index space, and the record values
    per mean spacing from which on gradients light its faces.
    """
    mask = plan.resolved.mask
    assert mask is not None and splats.post is not None
    return {"mask_low": tuple(mask.low - plan.view.eye_index), "mask_sure": mask.sure_of(splats.post.span)}


def mask_field(splats: Splats, plan: Plan) -> dict[str, np.ndarray | None]:
    """Returns the voxels of the mask, with normals if shading is on."""
    mask = plan.resolved.mask
    assert mask is not None
    return {"mask_field": mask.faced if plan.program.appearance.shading else mask.kept}


def cue_uniforms(splats: Splats, plan: Plan) -> Uniforms:
    """Returns the maps of offsets from the eye (index axes) and of normals (world axes) to the cells of cues.glsl."""
    cues = plan.resolved.cues
    assert cues is not None
    turn, shift = cues.cell_from_index
    return {
        "cell_from_index": tuple(turn.T.ravel()),
        "cell_from_normal": tuple(cues.cell_from_normal.T.ravel()),
        "cell_of_eye": tuple(turn @ plan.view.eye_index + shift),
        "cue_strength": (cues.occlusion, cues.shadows),
    }


def cue_fields(splats: Splats, plan: Plan) -> dict[str, np.ndarray | None]:
    """Returns the occlusion and shadow fields of the cells."""
    assert plan.resolved.cues is not None
    return {"sky_field": plan.resolved.cues.fields.sky, "shade_field": plan.resolved.cues.fields.shade}


def weight_uniforms(splats: Splats, plan: Plan) -> Uniforms:
    """Returns scale and offset that map gradients, in record values per mean spacing, to places in the weight table."""
    assert splats.post is not None
    _, low, step = splats.post.weights
    return {"weight_scale": (splats.post.span / splats.grid.mean_spacing / step, -low / step)}


def iso_uniforms(splats: Splats, plan: Plan) -> Uniforms:
    """Returns the record values of iso-surfaces, and their matter, for iso_surfaces.glsl."""
    assert splats.post is not None
    values, matter = splats.post.surfaces
    rest = MOST_ISO - len(values)
    return {
        "isos": len(values),
        "iso_value": np.pad(values, (0, rest)).tolist(),
        "iso_matter": [*map(tuple, np.pad(matter, ((0, rest), (0, 0))).tolist())],
        "iso_lit": plan.program.appearance.iso == "lit",
    }


def region_uniforms(splats: Splats, plan: Plan) -> Uniforms:
    """Returns the regions for regions.glsl: limits of values in cells of the classification table, and of gradients in
    record values per mean spacing.
    """
    post = splats.post
    assert post is not None
    regions, scale = post.transfer.regions, splats.grid.mean_spacing / post.span
    limits, matter, shape = np.zeros((MOST_REGIONS, 4)), np.zeros((MOST_REGIONS, 4)), np.zeros(MOST_REGIONS, int)
    for number, region in enumerate(regions):
        limits[number] = *post.places(np.array(region.values)), *(np.array(region.gradients) * scale)
        matter[number], shape[number] = region.matter, region.kind
    image = next((region.table.shape[:2] for region in regions if region.is_image), (1, 1))
    return {
        "region_count": len(regions),
        "region_limits": [*map(tuple, np.clip(limits, -FURTHEST, FURTHEST))],
        "region_matter": [*map(tuple, matter)],
        "region_shape": shape.tolist(),
        "image_size": image[::-1],
        "image_unit": post.image[1],
    }


def box_uniforms(splats: Splats, plan: Plan) -> Uniforms:
    """Returns the eye and the grid of normals for boxes.glsl, in index space relative to frame.base."""
    labels, base = splats.labels, base_of(splats, plan.view.eye_index)
    assert labels is not None
    return {
        "box_eye": tuple(plan.view.eye_index - base),
        "normals_low": tuple(np.array(labels.low) - base),
        "normals_step": float(labels.step),
    }


def box_field(splats: Splats, plan: Plan) -> dict[str, np.ndarray | None]:
    """Returns the normals of the labels."""
    assert splats.labels is not None
    return {"mask_field": splats.labels.faced}


FEATURES = (
    Feature("WEIGHTED", lambda program: program.appearance.weighted, weight_uniforms),
    Feature("REGIONS", lambda program: program.appearance.regions, region_uniforms),
    Feature("CLIPPED", lambda program: program.appearance.clipped, clip_uniforms),
    Feature("MASKED", lambda program: program.appearance.masked, mask_uniforms, mask_field),
    Feature("ISO", lambda program: bool(program.appearance.iso), iso_uniforms),
    Feature("LIGHT", lambda program: not program.appearance.light.plain),
    Feature("SKY", lambda program: program.appearance.sky, cue_uniforms, cue_fields),
    Feature("SHADOWS", lambda program: program.appearance.shadows, cue_uniforms, cue_fields),
    Feature("BOXES", lambda program: program.boxes, box_uniforms, box_field),
    Feature("PACKED", lambda program: program.packed),
)


def features_of(program: Program) -> list[Feature]:
    """Returns the features that are on."""
    return [feature for feature in FEATURES if feature.is_on(program)]


def feature_uniforms(splats: Splats, plan: Plan) -> Uniforms:
    """Returns the uniforms of all features that are on."""
    return {name: value for row in features_of(plan.program) for name, value in row.uniforms(splats, plan).items()}


class FieldTextures:
    """Cache of the fields' 3-D textures, by sampler."""

    def __init__(self, ctx: moderngl.Context, owned: ExitStack) -> None:
        self.ctx = ctx
        self.textures: dict[str, tuple[np.ndarray, moderngl.Texture3D]] = {}
        owned.callback(self.release)

    def use(self, splats: Splats, plan: Plan) -> None:
        """Binds the fields of all features that are on; raises InputError if a field exceeds OpenGL's texture size."""
        for feature in features_of(plan.program):
            for sampler, field in feature.fields(splats, plan).items():
                if field is not None:
                    self._texture(sampler, field).use(FIELD_UNITS[sampler])

    def release(self) -> None:
        """Frees the textures; they are recreated on demand."""
        for _, texture in self.textures.values():
            texture.release()
        self.textures = {}

    def _texture(self, sampler: str, field: np.ndarray) -> moderngl.Texture3D:
        cached = self.textures.get(sampler)
        if cached is not None and cached[0] is field:
            return cached[1]
        (depth, height, width), limit = field.shape[:3], self.ctx.info["GL_MAX_3D_TEXTURE_SIZE"]
        if max(depth, height, width) > limit:
            option = sampler.partition("_")[0]
            raise expected(option, f"a box of at most {limit} voxels a side around it", max(depth, height, width))
        if cached is not None:
            self.textures.pop(sampler)[1].release()
        kind = "f4" if field.dtype == np.float32 else "f1"
        channels = field.shape[3] if field.ndim == 4 else 1
        texture = self.ctx.texture3d((width, height, depth), channels, field.tobytes(), alignment=1, dtype=kind)
        texture.filter = (moderngl.NEAREST, moderngl.NEAREST)
        self.textures[sampler] = field, texture
        return texture
