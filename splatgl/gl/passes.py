"""Runs the draw pass (splats into a float target, by a technique) and the resolve pass (samples into pixels)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import replace
from typing import Protocol

import moderngl
import numpy as np

from splatgl.data.color import light_of_display
from splatgl.data.mesh import Mesh
from splatgl.gl.adaptive_samples import AdaptiveSamples, SingleSamples
from splatgl.gl.buffers import DrawOrder, free, texel_texture
from splatgl.gl.context import current
from splatgl.gl.device import Device
from splatgl.gl.features import FRAME_BINDING, STYLE_BINDING, frame_block, style_block
from splatgl.gl.layer_quads import LayerQuads
from splatgl.gl.layers import Drawn, LayerBatch, LayerTiles, union
from splatgl.gl.meshes import DepthLimits, Surfaces
from splatgl.gl.program import Switches, cover, set_uniforms, use_blend
from splatgl.gl.quads import CORNERS, Quads, SheetQuads
from splatgl.gl.shader import ComputeShape
from splatgl.gl.sheet_fragments import SheetFragments
from splatgl.gl.sheet_tiles import SheetTiles, SplatBatches
from splatgl.gl.target import Portions, RenderTarget
from splatgl.gl.tiles import SplatTiles, Tiles
from splatgl.planning.culling import PixelWindow, clip_behind_eye, order_for, visible_boxes
from splatgl.planning.plan import Plan
from splatgl.planning.resolve import END_CORRECTION
from splatgl.splat.quantized import QUANTIZED_ROW, QuantizedSplats
from splatgl.splat.splats import Splats

# texture units of quantised splats and their tables, beside those of textures.py; switches of their shaders
SPLATS_UNIT, CLASSES_UNIT = 24, 25
QUANTIZED_SWITCHES: Switches = {"QUANTIZED": True, "POINTS": False}
# names of targets: of the picture, of the matter between two surfaces, and of a layer
ROLES = ("draw", "part", "layer")


class Technique(Protocol):
    """Method of drawing splats into a float target."""

    def draw(
        self,
        target: RenderTarget,
        splats: Splats,
        plan: Plan,
        order: DrawOrder,
        portions: Portions,
        limits: DepthLimits | None = None,
    ) -> None:
        """Draws all splats of a picture; raises Interrupted if cancelled between portions. limits: depths between which
        the matter of sheets and boxes is drawn; None: all.
        """

    def release(self) -> None:
        """Frees the cached objects; they are recreated on demand."""


class Passes:
    """Techniques of a device, and their GL objects, which are cached between pictures. shape: of compute shaders."""

    def __init__(self, ctx: moderngl.Context, owned: ExitStack, shape: ComputeShape) -> None:
        device = self.device = Device(ctx, owned, shape)
        self.ctx, self.targets, self.tiles = ctx, device.targets, Tiles(device)
        self.single, self.sheets = SingleSamples(device), SheetTiles(device, self.tiles)
        quads, splats, single = Quads(device), SplatTiles(device, self.tiles), None if device.card else self.single
        self.layers = LayerTiles(device, self.sheets, splats, single)
        self.sheet_quads, self.layer_quads = SheetQuads(device), LayerQuads(device)
        fragments = SheetFragments(device, self.sheet_quads, self.single)
        self.techniques: dict[str, Technique] = {
            "quads": quads,
            "tiles": splats,
            "sheets in quads": self.sheet_quads,
            "sheets in tiles": AdaptiveSamples(self.sheets, single) if device.compute else fragments,
            "boxes in quads": quads,
            "boxes in tiles": splats,
            "streaks": quads,
        }
        self.surfaces = Surfaces(device)
        owned.callback(self.release)

    def release(self) -> None:
        """Frees the targets, and the buffers of splats and techniques."""
        # when moderngl creates a framebuffer, it rebinds the current one, which must not be freed by then
        self.ctx.detect_framebuffer(0).use()
        free(self.device, self.surfaces, self.tiles, self.layers, self.layer_quads)
        free(*self.techniques.values())

    def draw(
        self,
        splats: Splats,
        plan: Plan,
        role: str = "draw",
        interrupted: Callable[[], bool] | None = None,
        batches: SplatBatches | None = None,
    ) -> np.ndarray:
        """Returns the picture of the splats, float32 [H, W, 4]; of batches with a shell its samples.

        role: name under which the target is cached. interrupted: is called between portions; if it returns True,
        Interrupted is raised. batches: are drawn instead of `splats`, which then only describe them.
        """
        if plan.exposure is None:
            splats = visible_boxes(clip_behind_eye(splats, plan.resolved.camera), plan.resolved)
        target = self.targets.get(role, plan.view.size, plan.target)
        portions = Portions(self.ctx, interrupted, plan.view.size[0] * plan.view.size[1])
        # of a cancelled picture
        self.single.kept = None
        card = self.device.card if self._computes(plan) and batches is None else None
        while True:
            target.clear()
            if len(splats) and not plan.window.is_empty:
                self._draw_splats(target, splats, plan, portions, batches)
            if batches is not None and batches.shell is not None:
                return target.read(plan.window)
            pixels = self._read(target, plan, portions)
            if card is None or card.fits():
                return pixels

    def draw_layers(self, layers: Sequence[Drawn], interrupted: Callable[[], bool] | None = None) -> np.ndarray:
        """Returns the picture of layers, float32 [H, W, 4], composited together along rays."""
        plan = layers[0][1]
        target, scratch = (self.targets.get(role, plan.view.size, plan.target) for role in ("draw", "layer"))
        target.clear()
        self.single.kept = None
        visible = [
            (visible_boxes(clip_behind_eye(splats, plan.resolved.camera), plan.resolved), plan)
            for splats, plan in layers
        ]
        portions = Portions(self.ctx, interrupted, plan.view.size[0] * plan.view.size[1])
        window = union([plan.window for _, plan in layers])
        if not window.is_empty:
            self._layers_by(plan).composite(target, LayerBatch(visible, self.bind, scratch, portions))
        return self._read(target, replace(plan, window=window), portions)

    def draw_surfaces(
        self,
        meshes: Sequence[Mesh],
        lit: bool,
        layers: Sequence[Drawn],
        interrupted: Callable[[], bool] | None = None,
    ) -> np.ndarray:
        """Returns the picture of meshes and the layers between them, float32 [H, W, 4]. lit: shades meshes."""
        first, plan = layers[0]
        camera, unit = plan.resolved.camera, first.grid.mean_spacing
        target, part, scratch = (self.targets.get(role, plan.view.size, plan.target) for role in ROLES)
        target.clear()
        visible = [(visible_boxes(clip_behind_eye(splats, camera), plan.resolved), plan) for splats, plan in layers]
        visible = [layer for layer in visible if len(layer[0]) and not layer[1].window.is_empty]
        portions = Portions(self.ctx, interrupted, plan.view.size[0] * plan.view.size[1])
        self.bind(first, plan)
        self.single.kept = None
        for limits, light in self.surfaces.peeled(meshes, camera, unit, lit, plan.program.appearance.light.plain):
            part.clear()
            if len(visible) > 1:
                together = LayerBatch(visible, self.bind, scratch, portions, limits)
                self._layers_by(plan).composite(part, together)
            elif visible:
                self._draw_splats(part, *visible[0], portions, limits=limits)
            self.bind(first, plan)
            self.surfaces.composite(target, part, light)
        return self._read(target, replace(plan, window=PixelWindow(0, 0, *plan.view.size)), portions)

    def _computes(self, plan: Plan) -> bool:
        """Whether compute shaders draw a plan; others draw tiles of one volume alone."""
        return self.device.compute and plan.program.technique == "tiles"

    def _layers_by(self, plan: Plan) -> LayerTiles | LayerQuads:
        """Returns what draws layers by the technique of a plan."""
        return self.layers if self._computes(plan) else self.layer_quads

    def joined(self, samples: np.ndarray, whole: Splats, plan: Plan) -> np.ndarray:
        """Returns the picture of joined samples of its parts, float32 [H, W, 4]."""
        target = self.targets.get("draw", plan.view.size, plan.target)
        target.texture.write(np.ascontiguousarray(samples, np.float32), (0, 0, *target.size))
        if plan.program.appearance.shows_value:
            self.bind(whole, plan)
            if self._computes(plan):
                self.sheets.show(target, whole, plan)
            else:
                self.sheet_quads.show_samples(target, whole, plan, samples)
        return self._read(target, plan, Portions(self.ctx))

    def _read(self, target: RenderTarget, plan: Plan, portions: Portions) -> np.ndarray:
        """Returns the pixels of the target's samples."""
        behind = plan.resolved.behind
        if plan.resolved.averaged or behind is not None:
            pixels = self._resolve(target, plan, behind, portions).read()
        else:
            pixels = target.read(plan.window)
        return light_of_display(pixels) if plan.resolved.display else pixels

    def _draw_splats(
        self,
        target: RenderTarget,
        splats: Splats,
        plan: Plan,
        portions: Portions,
        batches: SplatBatches | None = None,
        limits: DepthLimits | None = None,
    ) -> None:
        self.bind(splats, plan)
        if batches is not None:
            drawing = self.sheets if self._computes(plan) else self.sheet_quads
            drawing.draw_batches(target, splats, plan, batches, portions)
            return
        appearance = plan.program.appearance
        boxes = order_for(splats, plan.resolved.camera) if appearance.hides and not appearance.sheets else None
        order = DrawOrder(boxes, boxes is not None and plan.order == "front-to-back")
        kind = "sheets in " if plan.resolved.sheets else "boxes in " if plan.resolved.boxes else ""
        technique = f"{kind}{plan.program.technique}"
        self.techniques[technique].draw(target, splats, plan, order, portions, limits)

    def bind(self, splats: Splats, plan: Plan) -> None:
        """Uploads and binds the uniform blocks, tables and fields of a picture."""
        device = self.device
        device.frame.write(frame_block(splats, plan).tobytes())
        device.style.write(style_block(splats, plan).tobytes())
        device.frame.bind_to_uniform_block(FRAME_BINDING)
        device.style.bind_to_uniform_block(STYLE_BINDING)
        device.tables.use(plan)
        device.fields.use(splats, plan)

    def _resolve(
        self, source: RenderTarget, plan: Plan, behind: tuple[float, ...] | None, portions: Portions
    ) -> RenderTarget:
        program = self.single.resolving(plan)
        width, height = plan.view.size
        target = self.targets.get("resolve", (width // plan.samples, height // plan.samples), "rgba32f")
        target.framebuffer.use()
        self.ctx.enable_only(moderngl.NOTHING)
        source.texture.use(location=0)
        program["samples"], program["last"] = plan.samples, (width - 1, height - 1)
        program["ends"] = END_CORRECTION if plan.resolved.averaged else 0.0
        program["background"] = (*behind, 1.0) if behind else (0.0, 0.0, 0.0, 0.0)
        rows = height // plan.samples
        for top, bottom in portions.parts("resolving", range(1, rows + 1), rows):
            target.framebuffer.use()
            target.framebuffer.scissor = 0, top, target.size[0], bottom - top
            cover(program)
        return target


def draw_quantized(passes: Passes, splats: QuantizedSplats, planned: Plan) -> np.ndarray:
    """The picture of quantised splats as web pages draw them, by the same shaders, textures, order and half floats:
    linear premultiplied float32 [H, W, 4], row 0 on top, without a background. planned: of their outline.
    """
    ctx, view = passes.ctx, planned.view
    eye = view.eye_index if view.perspective else np.where(view.index_from_eye[:, 2] >= 0, -np.inf, np.inf)
    numbers = np.zeros((len(splats), 4), np.uint32)
    numbers[:, 0] = splats.back_to_front(eye, order_for(planned.splats, planned.resolved.camera).axis)
    rows, tables = -(-len(splats) // QUANTIZED_ROW), np.stack([layer.table for layer in splats.layers])
    # the last row is filled up by splats that are not drawn
    words = np.resize(splats.records, rows * QUANTIZED_ROW)
    with current(ctx):
        program = passes.device.programs.for_splats(planned.program, QUANTIZED_SWITCHES)
        passes.bind(planned.splats, planned)
        splat_texture = texel_texture(ctx, (QUANTIZED_ROW, rows), 4, "u4", words.tobytes())
        classes = texel_texture(ctx, tables.shape[1::-1], 4, "f4", tables.astype(np.float32).tobytes())
        splat_texture.use(SPLATS_UNIT)
        classes.use(CLASSES_UNIT)
        set_uniforms(program, quantized_splats=SPLATS_UNIT, class_table=CLASSES_UNIT, position_step=splats.step)
        use_blend(ctx, planned.program.appearance.join, nearest_first=False)
        target = passes.targets.get("draw", view.size, planned.target)
        target.clear()
        instances = ctx.buffer(numbers.tobytes())
        quads = ctx.vertex_array(program, [(instances, "4u4/i", "in_first")])
        quads.render(moderngl.TRIANGLE_STRIP, vertices=CORNERS, instances=len(splats))
        pixels = target.read()
        free(quads, instances, splat_texture, classes)
    return pixels
