"""The optional features of shaders: one row each, with its switch, its uniforms and its textures.

A row's switch chooses between an include and its twin without effect (`clip_ray.glsl`, `clip_ray_off.glsl`). A new
feature is a row and an include.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass

import moderngl
import numpy as np

from splatgl.errors import expected
from splatgl.gl.uniforms import base_of
from splatgl.splat.clipping import MOST_CLIPS
from splatgl.splat.plan import Plan, Program
from splatgl.splat.splats import Splats

Uniforms = dict[str, object]
# texture unit of each sampler of a field on voxels or cells
FIELD_UNITS = {"sky_field": 18, "shade_field": 19, "mask_field": 20}


@dataclass(frozen=True)
class Feature:
    """switch: set where `is_on`. uniforms, fields: what its include reads; fields by sampler: float32 or uint8
    [D, H, W] or [D, H, W, 4].
    """

    switch: str
    is_on: Callable[[Program], bool]
    uniforms: Callable[[Splats, Plan], Uniforms] = lambda splats, plan: {}
    fields: Callable[[Splats, Plan], Mapping[str, np.ndarray | None]] = lambda splats, plan: {}


def clip_uniforms(splats: Splats, plan: Plan) -> Uniforms:
    """The planes of clip_ray.glsl, from the eye, with unit normals in index space."""
    clip = plan.resolved.clip
    assert clip is not None
    planes, normals = np.zeros((MOST_CLIPS, 4)), np.zeros((MOST_CLIPS, 3))
    rows = np.column_stack([clip.g, clip.place - clip.g @ plan.view.eye_index])
    planes[: len(rows)] = rows / np.linalg.norm(clip.g, axis=1)[:, None]
    normals[: len(rows)] = clip.normal
    return {"clips": len(rows), "clip": [*map(tuple, planes)], "clip_normal": [*map(tuple, normals)]}


def mask_uniforms(splats: Splats, plan: Plan) -> Uniforms:
    """The place of mask_ray.glsl's field."""
    assert plan.resolved.mask is not None
    return {"mask_low": tuple(plan.resolved.mask.low - plan.view.eye_index)}


def mask_field(splats: Splats, plan: Plan) -> dict[str, np.ndarray | None]:
    """The mask's voxels; with normals if matter is lit."""
    mask = plan.resolved.mask
    assert mask is not None
    return {"mask_field": mask.faced if plan.program.look.shading else mask.kept}


def cue_uniforms(splats: Splats, plan: Plan) -> Uniforms:
    """Turns offsets from the eye, index axes, and normals, world axes, into cells of cues.glsl."""
    cues = plan.resolved.cues
    assert cues is not None
    turn, moved = cues.cell_from_index
    return {
        "cell_from_index": tuple(turn.T.ravel()),
        "cell_from_normal": tuple(cues.cell_from_normal.T.ravel()),
        "cell_of_eye": tuple(turn @ plan.view.eye_index + moved),
        "cue_strength": (cues.occlusion, cues.shadows),
    }


def cue_fields(splats: Splats, plan: Plan) -> dict[str, np.ndarray | None]:
    """The light in the cells."""
    assert plan.resolved.cues is not None
    return {"sky_field": plan.resolved.cues.fields.sky, "shade_field": plan.resolved.cues.fields.shade}


def weight_uniforms(splats: Splats, plan: Plan) -> Uniforms:
    """The table place of gradients of record values, per mean spacing."""
    assert splats.post is not None
    _, low, step = splats.post.weights
    return {"weight_scale": (splats.post.span / splats.grid.mean_spacing / step, -low / step)}


def box_uniforms(splats: Splats, plan: Plan) -> Uniforms:
    """The eye and the places of normals, index axes from frame.base, for boxes.glsl."""
    labels, base = splats.labels, base_of(splats, plan.view.eye_index)
    assert labels is not None
    return {
        "box_eye": tuple(plan.view.eye_index - base),
        "normals_low": tuple(np.array(labels.low) - base),
        "normals_step": float(labels.step),
    }


def box_field(splats: Splats, plan: Plan) -> dict[str, np.ndarray | None]:
    """Normals of labels."""
    assert splats.labels is not None
    return {"mask_field": splats.labels.faced}


FEATURES = (
    Feature("WEIGHTED", lambda program: program.look.weighted, weight_uniforms),
    Feature("CLIPPED", lambda program: program.look.clipped, clip_uniforms),
    Feature("MASKED", lambda program: program.look.masked, mask_uniforms, mask_field),
    Feature("LIGHT", lambda program: not program.look.light.plain),
    Feature("SKY", lambda program: program.look.sky, cue_uniforms, cue_fields),
    Feature("SHADOWS", lambda program: program.look.shadows, cue_uniforms, cue_fields),
    Feature("BOXES", lambda program: program.boxes, box_uniforms, box_field),
    Feature("PACKED", lambda program: program.packed),
)


def features_of(program: Program) -> list[Feature]:
    """The features that are on."""
    return [feature for feature in FEATURES if feature.is_on(program)]


def feature_uniforms(splats: Splats, plan: Plan) -> Uniforms:
    """The uniforms of all features that are on."""
    return {name: value for each in features_of(plan.program) for name, value in each.uniforms(splats, plan).items()}


class FieldTextures:
    """3-D textures of fields by sampler, kept for the next picture."""

    def __init__(self, ctx: moderngl.Context, owned: ExitStack) -> None:
        self.ctx = ctx
        self.textures: dict[str, tuple[np.ndarray, moderngl.Texture3D]] = {}
        owned.callback(self.release)

    def use(self, splats: Splats, plan: Plan) -> None:
        """Binds the fields of all features that are on. Raises InputError for a field beyond OpenGL's size."""
        for feature in features_of(plan.program):
            for sampler, field in feature.fields(splats, plan).items():
                if field is not None:
                    self._texture(sampler, field).use(FIELD_UNITS[sampler])

    def release(self) -> None:
        """Frees the textures; they are made again on demand."""
        for _, texture in self.textures.values():
            texture.release()
        self.textures = {}

    def _texture(self, sampler: str, field: np.ndarray) -> moderngl.Texture3D:
        held = self.textures.get(sampler)
        if held is not None and held[0] is field:
            return held[1]
        (depth, height, width), most = field.shape[:3], self.ctx.info["GL_MAX_3D_TEXTURE_SIZE"]
        if max(depth, height, width) > most:
            what = sampler.partition("_")[0]
            raise expected(what, f"a box of at most {most} voxels a side around it", max(depth, height, width))
        if held is not None:
            self.textures.pop(sampler)[1].release()
        kind = "f4" if field.dtype == np.float32 else "f1"
        channels = field.shape[3] if field.ndim == 4 else 1
        texture = self.ctx.texture3d((width, height, depth), channels, field.tobytes(), alignment=1, dtype=kind)
        texture.filter = (moderngl.NEAREST, moderngl.NEAREST)
        self.textures[sampler] = field, texture
        return texture
