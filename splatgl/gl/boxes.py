"""Boxes of voxels of labels: in tiles, each pixel's ray meets those of its tile one by one, nearest first."""

from __future__ import annotations

from collections.abc import Callable

import moderngl
import numpy as np

from splatgl.gl.draw_order import DrawOrder
from splatgl.gl.portions import Portions
from splatgl.gl.sheet_order import Uniforms, clip_uniforms
from splatgl.gl.surfaces import FARTHEST_UNIT, NEAREST_UNIT, Limits
from splatgl.gl.target import Target
from splatgl.gl.tiles import Tiles, set_uniforms
from splatgl.gl.uniforms import base_of
from splatgl.splat.plan import Plan
from splatgl.splat.splats import Splats


def box_uniforms(splats: Splats, plan: Plan) -> Uniforms:
    """Uniforms of boxes.glsl."""
    view, labels = plan.view, splats.labels
    assert labels is not None
    base = base_of(splats, view.eye_index)
    found: Uniforms = {
        "box_eye": tuple(view.eye_index - base),
        "normals_low": tuple(np.array(labels.low) - base),
        "normals_step": float(labels.step),
    }
    return found | (clip_uniforms(plan.resolved.clip, view) if plan.resolved.clip is not None else {})


class BoxTiles(Tiles):
    """Reuses buffers and textures between pictures, as Tiles does."""

    drawing = "box_draw.comp"
    uniforms: Uniforms
    # between which depths they are drawn; as one of several layers: makes a program keep their matter
    limits: Limits | None = None
    keeping: Callable[[moderngl.ComputeShader], None] | None = None

    def draw(self, target: Target, splats: Splats, plan: Plan, order: DrawOrder, portions: Portions) -> None:
        """Composites the boxes into `target`, nearest first; raises Interrupted if cancelled."""
        self.uniforms = box_uniforms(splats, plan)
        if self.limits is not None:
            self.limits.use()
            self.uniforms |= {"nearest_depth": NEAREST_UNIT, "farthest_depth": FARTHEST_UNIT}
            self.uniforms["depth_unit"] = self.limits.unit / splats.grid.mean_spacing
        super().draw(target, splats, plan, order, portions)

    def _program(self, name: str, plan: Plan, switches: dict[str, bool]) -> moderngl.ComputeShader:
        if name != self.drawing:
            return super()._program(name, plan, switches)
        own = {"LIMITED": self.limits is not None, "LAYERED": self.keeping is not None}
        program = super()._program(name, plan, {**switches, **own})
        set_uniforms(program, **self.uniforms)
        if self.keeping is not None:
            self.keeping(program)
        return program
