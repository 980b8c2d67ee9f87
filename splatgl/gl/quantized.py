"""Draws quantised splats as web pages do: the same shaders, textures, order and half floats, in OpenGL."""

from __future__ import annotations

import moderngl
import numpy as np

from splatgl.geometry.camera import Camera
from splatgl.gl.buffers import free, texel_texture
from splatgl.gl.context import current
from splatgl.gl.features import FRAME_BINDING, STYLE_BINDING, frame_block, style_block
from splatgl.gl.program import Switches, set_uniforms, splat_switches, use_blend
from splatgl.gl.quads import CORNERS
from splatgl.gl.renderer import Renderer
from splatgl.planning.culling import order_for
from splatgl.planning.plan import Plan, plan
from splatgl.splat.quantized import QUANTIZED_ROW, QuantizedSplats
from splatgl.splat.settings import Settings

# texture units of splats and tables, beside those of textures.py
SPLATS_UNIT, CLASSES_UNIT = 24, 25
# the paper's hardware path in half floats
SETTINGS = Settings(
    classification="pre",
    compositing="splats",
    align="ray",
    footprint="table",
    table_bits=16,
    attenuation="opacity",
    antialias="paper",
    technique="quads",
    target="rgba16f",
    order="back-to-front",
)


def quantized_plan(splats: QuantizedSplats, camera: Camera, settings: Settings) -> Plan:
    """The plan of a picture; settings: what SETTINGS leave open, such as the light and the kernel."""
    given = {name: value for name, value in vars(SETTINGS).items() if name in SETTINGS.given and name != "antialias"}
    chosen = settings.replace(**given)
    return plan(splats.outline, camera, chosen)


def quantized_switches(planned: Plan) -> Switches:
    """The switches of splat.vert and splat.frag for a plan."""
    return {**splat_switches(planned.program), "QUANTIZED": True, "POINTS": False}


def draw_quantized(
    renderer: Renderer, splats: QuantizedSplats, camera: Camera, settings: Settings = SETTINGS
) -> np.ndarray:
    """The picture of the splats, linear premultiplied float32 [H, W, 4], row 0 on top, without a background."""
    planned, ctx, device = quantized_plan(splats, camera, settings), renderer.ctx, renderer.passes.device
    outline = planned.splats
    with current(ctx):
        program = device.programs.for_splats(planned.program, {"QUANTIZED": True, "POINTS": False})
        device.frame.write(frame_block(outline, planned).tobytes())
        device.style.write(style_block(outline, planned).tobytes())
        device.frame.bind_to_uniform_block(FRAME_BINDING)
        device.style.bind_to_uniform_block(STYLE_BINDING)
        device.tables.use(planned)
        rows = -(-max(len(splats), 1) // QUANTIZED_ROW)
        words = np.zeros((rows * QUANTIZED_ROW, 4), np.uint32)
        words[: len(splats)] = splats.words
        tables = np.stack([layer.table for layer in splats.layers]).astype(np.float32)
        textures = [
            texel_texture(ctx, (QUANTIZED_ROW, rows), 4, "u4", words.tobytes()),
            texel_texture(ctx, tables.shape[1::-1], 4, "f4", tables.tobytes()),
        ]
        for texture, unit in zip(textures, (SPLATS_UNIT, CLASSES_UNIT), strict=True):
            texture.use(unit)
        names = {"quantized_splats": SPLATS_UNIT, "class_table": CLASSES_UNIT, "position_step": splats.step}
        set_uniforms(program, **names)
        use_blend(ctx, "over", nearest_first=False)
        target = device.targets.get("draw", planned.view.size, planned.target)
        target.clear()
        if len(splats):
            view = planned.view
            eye = view.eye_index if view.perspective else np.where(view.index_from_eye[:, 2] >= 0, -np.inf, np.inf)
            numbers = np.zeros((len(splats), 4), np.uint32)
            numbers[:, 0] = splats.back_to_front(eye, order_for(outline, camera).axis)
            instances = ctx.buffer(numbers.tobytes())
            quads = ctx.vertex_array(program, [(instances, "4u4/i", "in_first")])
            quads.render(moderngl.TRIANGLE_STRIP, vertices=CORNERS, instances=len(splats))
            free(quads, instances)
        pixels = target.read()
        free(*textures)
    return pixels
