"""Draws quantised splats as web pages do: the same shaders, textures, order and half floats, in OpenGL."""

from __future__ import annotations

import moderngl
import numpy as np

from splatgl.gl.buffers import free, texel_texture
from splatgl.gl.context import current
from splatgl.gl.program import Switches, set_uniforms, use_blend
from splatgl.gl.quads import CORNERS
from splatgl.gl.renderer import Renderer
from splatgl.planning.culling import order_for
from splatgl.planning.plan import Plan
from splatgl.splat.quantized import QUANTIZED_ROW, QuantizedSplats

# texture units of splats and tables, beside those of textures.py
SPLATS_UNIT, CLASSES_UNIT = 24, 25
SWITCHES: Switches = {"QUANTIZED": True, "POINTS": False}


def draw_quantized(renderer: Renderer, splats: QuantizedSplats, planned: Plan) -> np.ndarray:
    """The picture of the splats, linear premultiplied float32 [H, W, 4], row 0 on top, without a background. planned:
    of their outline.
    """
    ctx, passes, view = renderer.ctx, renderer.passes, planned.view
    eye = view.eye_index if view.perspective else np.where(view.index_from_eye[:, 2] >= 0, -np.inf, np.inf)
    numbers = np.zeros((len(splats), 4), np.uint32)
    numbers[:, 0] = splats.back_to_front(eye, order_for(planned.splats, planned.resolved.camera).axis)
    rows, tables = -(-len(splats) // QUANTIZED_ROW), np.stack([layer.table for layer in splats.layers])
    # the last row is filled up by splats that are not drawn
    words = np.resize(splats.records, rows * QUANTIZED_ROW)
    with current(ctx):
        program = passes.device.programs.for_splats(planned.program, SWITCHES)
        passes.bind(planned.splats, planned)
        splat_texture = texel_texture(ctx, (QUANTIZED_ROW, rows), 4, "u4", words.tobytes())
        classes = texel_texture(ctx, tables.shape[1::-1], 4, "f4", tables.astype(np.float32).tobytes())
        splat_texture.use(SPLATS_UNIT)
        classes.use(CLASSES_UNIT)
        set_uniforms(program, quantized_splats=SPLATS_UNIT, class_table=CLASSES_UNIT, position_step=splats.step)
        use_blend(ctx, "over", nearest_first=False)
        target = passes.targets.get("draw", view.size, planned.target)
        target.clear()
        instances = ctx.buffer(numbers.tobytes())
        quads = ctx.vertex_array(program, [(instances, "4u4/i", "in_first")])
        quads.render(moderngl.TRIANGLE_STRIP, vertices=CORNERS, instances=len(splats))
        pixels = target.read()
        free(quads, instances, splat_texture, classes)
    return pixels
