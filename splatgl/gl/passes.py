"""The draw pass (splats into a float target) and the resolve pass (samples into pixels)."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from itertools import pairwise

import moderngl
import numpy as np

from splatgl.data.errors import expected
from splatgl.gl.buffers import SplatBuffers
from splatgl.gl.closing import HIDDEN_UNIT, Closing
from splatgl.gl.draw_order import Range, Sequence, chunks
from splatgl.gl.portions import Portions
from splatgl.gl.program import BLENDS, Programs
from splatgl.gl.streaks import BLUR_UNIT, StreakBuffers
from splatgl.gl.target import Target, Targets
from splatgl.gl.tiles import Tiles
from splatgl.gl.uniforms import FRAME, FRAME_BINDING, STYLE, STYLE_BINDING, frame_block, style_block
from splatgl.splat.ahead import ahead
from splatgl.splat.blocks import shown
from splatgl.splat.blur_table import blur_table
from splatgl.splat.camera import Camera
from splatgl.splat.kernel import Kernel, footprint_table, half_line_table, radial_table
from splatgl.splat.near import runs
from splatgl.splat.occlusion import TILE, cuts
from splatgl.splat.order import order_for
from splatgl.splat.plan import Plan
from splatgl.splat.rows import MOST_KEPT, Splats

# bits of a footprint table → moderngl's dtype, numpy's, and what 1.0 is stored as
TABLES: dict[int, tuple[str, np.dtype, int]] = {
    32: ("f4", np.dtype("<f4"), 1),
    16: ("nu2", np.dtype("<u2"), 65535),
    8: ("f1", np.dtype("u1"), 255),
}
CORNERS = 4
# texels along each axis of the half-line table: bilinear error 1e−5
HALF_TABLE_SIZE = 256


class Passes:
    """What is kept in the context between pictures: programs, targets, tables, and the last splats."""

    def __init__(self, ctx: moderngl.Context, owned: ExitStack) -> None:
        self.ctx = ctx
        self.owned = owned
        self.programs = Programs(ctx, owned)
        self.targets = Targets(ctx, owned)
        self.tables: dict[tuple[str, str, int, int], moderngl.Texture] = {}
        self.splats = SplatBuffers(ctx, owned)
        self.streaks = StreakBuffers(ctx, owned)
        self.whole: dict[int, moderngl.VertexArray] = {}
        self.tiles = Tiles(ctx, self.programs, self._whole, owned)
        self.closing = Closing(ctx, self.programs, self.targets, self._whole)
        self.frame = ctx.buffer(reserve=FRAME.itemsize)
        owned.callback(self.frame.release)
        self.style = ctx.buffer(reserve=STYLE.itemsize)
        owned.callback(self.style.release)

    def draw(
        self,
        splats: Splats,
        camera: Camera,
        plan: Plan,
        role: str = "draw",
        interrupted: Callable[[], bool] | None = None,
    ) -> np.ndarray:
        """float32 [H, W, 4]. role: the name of the target, which is kept for it. interrupted: asked between two
        portions; Interrupted is raised where it says so.
        """
        if plan.exposure is None:
            splats = ahead(splats, camera)
        size = (camera.size[0] * plan.samples, camera.size[1] * plan.samples)
        target = self.targets.get(role, size, plan.program.target, depth=plan.parts > 1)
        target.clear()
        portions = Portions(self.ctx, interrupted, size[0] * size[1])
        if plan.program.primitive == "tile":
            self.tiles.begin(plan)
        if len(splats):
            seen = plan.exposure.middle if plan.exposure else camera
            if plan.near:
                for run in runs(splats, plan.near):
                    chosen = plan.nearest_quads if run.quads else plan
                    self._draw_splats(target, splats, seen, chosen, (run.begin, run.end), portions)
            else:
                self._draw_splats(target, splats, seen, plan, (0, len(splats)), portions)
        # the sum of an X-ray has nothing to lie over
        background = plan.background if plan.program.blend != "xray" else None
        if plan.samples > 1 or background is not None:
            return self._resolve(target, camera.size, plan, background).read()
        return target.read(plan.window)

    def _draw_splats(
        self,
        target: Target,
        splats: Splats,
        camera: Camera,
        plan: Plan,
        which: Range,
        portions: Portions,
    ) -> None:
        """Splats `which` of the drawing order."""
        self.frame.write(frame_block(splats, camera, plan).tobytes())
        self.style.write(style_block(splats, plan).tobytes())
        self.frame.bind_to_uniform_block(FRAME_BINDING)
        self.style.bind_to_uniform_block(STYLE_BINDING)
        if plan.program.footprint != "polynomial":
            self._table(plan).use(location=0)
        ordered = plan.program.blend == "composite" or which != (0, len(splats))
        order = order_for(splats, camera) if ordered else None
        sequence = (order, order is not None and plan.program.order == "front-to-back")
        if plan.program.primitive == "tile":
            self._draw_tiles(target, splats, camera, plan, (sequence, which), portions)
            return
        program = self.programs.for_splats(plan.program)
        if plan.program.half_line:
            program["half_table"] = 1
            self._half_table(plan.kernel).use(location=1)
        self._bind_path(program, splats, plan)
        if plan.program.hiding:
            program["hidden"], program["hidden_tile"] = HIDDEN_UNIT, float(TILE)

        blend = BLENDS[plan.program.blend, plan.program.order]
        self.ctx.blend_equation = blend.equation  # type: ignore[assignment]
        self.ctx.blend_func = blend.source, blend.destination
        if plan.program.primitive == "sprite":
            vertices = self.splats.of(splats).sprites(program, sequence)
            self._draw_sprites(vertices, target, plan, which, portions)
            return
        target.framebuffer.use()
        self.ctx.enable_only(moderngl.BLEND)
        if plan.program.flow and len(splats) > MOST_KEPT:
            raise expected("splats", f"at most {MOST_KEPT:,} that flow", f"{len(splats):,}", "raise the threshold")
        for chunk in chunks(which):
            if plan.program.flow:
                quads = self.streaks.quads(splats, sequence, plan, program)
            else:
                quads = self.splats.of(splats).quads(program, sequence, chunk)
            for begin, end in portions.over(*chunk):
                vertices = quads.vertices(program, begin - chunk[0])
                vertices.render(moderngl.TRIANGLE_STRIP, vertices=CORNERS, instances=end - begin)

    def _draw_tiles(
        self,
        target: Target,
        splats: Splats,
        camera: Camera,
        plan: Plan,
        what: tuple[Sequence, Range],
        portions: Portions,
    ) -> None:
        """what: the drawing order, and which splats of it."""
        sequence, which = what
        parts = pairwise(which[0] + cut for cut in cuts(which[1] - which[0], plan.parts))
        for begin, end in (chunk for part in parts for chunk in chunks(part)):
            kept = len(splats) <= MOST_KEPT
            texels = self.splats.of(splats).texels(
                plan.program.attenuation == "fill", sequence, None if kept else (begin, end)
            )
            seen = None if texels.boxes is None else shown(texels.boxes, splats, camera, plan)
            if seen is not None and seen.all():
                seen = None
            first = 0 if kept else begin
            self.tiles.draw(target, plan, texels, (begin - first, end - first), begin > 0, seen, portions.ask)

    def _bind_path(self, program: moderngl.Program, splats: Splats, plan: Plan) -> None:
        """What streaks need besides; nothing for a still."""
        if plan.exposure is None:
            return
        self.streaks.bind_path(splats, plan)
        if plan.program.motion == "exact":
            program["blur_table"] = BLUR_UNIT
            self._blur_table(plan.kernel).use(location=BLUR_UNIT)

    def _draw_sprites(
        self, vertices: moderngl.VertexArray, target: Target, plan: Plan, which: Range, portions: Portions
    ) -> None:
        """In parts, nearest first; between two of them pixels are closed that next to nothing passes."""
        if plan.program.hiding:
            self.closing.begin(target)
        for part in pairwise(which[0] + cut for cut in cuts(which[1] - which[0], plan.parts)):
            tested = plan.parts > 1 and part[0] > which[0]
            if tested:
                self.closing.close(target, plan)
            target.framebuffer.use()
            # centres beyond the edge are clipped, so that the edge is moved out
            target.widen(plan.pad)
            self.ctx.enable_only(moderngl.BLEND | moderngl.PROGRAM_POINT_SIZE | (moderngl.DEPTH_TEST if tested else 0))
            for begin, end in portions.over(*part):
                vertices.render(moderngl.POINTS, vertices=end - begin, first=begin)
        target.widen(0)

    def _resolve(
        self, drawn: Target, size: tuple[int, int], plan: Plan, background: tuple[float, float, float] | None
    ) -> Target:
        program = self.programs.for_screen("resolve.frag")
        target = self.targets.get("resolve", size, "rgba32f")
        target.framebuffer.use()
        self.ctx.enable_only(moderngl.NOTHING)
        drawn.texture.use(location=0)
        program["samples"] = plan.samples
        program["background"] = (*background, 1.0) if background else (0.0, 0.0, 0.0, 0.0)
        self._whole(program)
        return target

    def _whole(self, program: moderngl.Program) -> None:
        """One triangle over the whole target."""
        if program.glo not in self.whole:
            self.whole[program.glo] = self.ctx.vertex_array(program, [])
            self.owned.callback(self.whole[program.glo].release)
        self.whole[program.glo].render(moderngl.TRIANGLES, vertices=3)

    def _table(self, plan: Plan) -> moderngl.Texture:
        """F/F(0), over the plane or over the squared distance."""
        size, bits = plan.table_size, plan.table_bits
        make = footprint_table if plan.program.footprint == "table" else radial_table
        key = (plan.kernel.name, plan.program.footprint, size, bits)
        return self.tables.get(key) or self._texture(key, make(plan.kernel, size), bits)

    def _half_table(self, kernel: Kernel) -> moderngl.Texture:
        key = (kernel.name, "half", HALF_TABLE_SIZE, 32)
        return self.tables.get(key) or self._texture(key, half_line_table(kernel, HALF_TABLE_SIZE), 32)

    def _blur_table(self, kernel: Kernel) -> moderngl.Texture:
        key = (kernel.name, "blur", 0, 32)
        return self.tables.get(key) or self._texture(key, blur_table(kernel.name).packed, 32)

    def _texture(self, key: tuple[str, str, int, int], texels: np.ndarray, bits: int) -> moderngl.Texture:
        dtype, store, one = TABLES[bits]
        data = (np.rint(texels * one) if one > 1 else texels).astype(store)
        height, width, *components = data.shape
        channels = components[0] if components else 1
        texture = self.ctx.texture((width, height), channels, data.tobytes(), alignment=1, dtype=dtype)
        self.owned.callback(texture.release)
        texture.filter = (moderngl.LINEAR, moderngl.LINEAR)
        texture.repeat_x = texture.repeat_y = False
        self.tables[key] = texture
        return texture
