"""The draw pass (splats into a float target) and the resolve pass (samples into pixels)."""

from __future__ import annotations

from contextlib import ExitStack

import moderngl
import numpy as np

from splatgl.gl.program import BLENDS, Programs
from splatgl.gl.target import Target, Targets
from splatgl.gl.uniforms import FRAME, FRAME_BINDING, STYLE, STYLE_BINDING, frame_block, style_block
from splatgl.splat.camera import Camera
from splatgl.splat.kernel import Kernel, footprint_table, half_line_table, radial_table
from splatgl.splat.order import Order, back_to_front, order_for
from splatgl.splat.plan import Plan
from splatgl.splat.rows import GL_ATTRIBUTES, GL_FORMAT, Splats

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
        self.splats = SplatBuffer(ctx, owned)
        self.frame = ctx.buffer(reserve=FRAME.itemsize)
        owned.callback(self.frame.release)
        self.style = ctx.buffer(reserve=STYLE.itemsize)
        owned.callback(self.style.release)

    def draw(self, splats: Splats, camera: Camera, plan: Plan) -> np.ndarray:
        """float32 [H, W, 4]."""
        size = (camera.size[0] * plan.samples, camera.size[1] * plan.samples)
        target = self.targets.get("draw", size, plan.program.target)
        target.framebuffer.use()
        target.framebuffer.clear()
        if len(splats):
            self._draw_splats(splats, camera, plan)
        # the sum of an X-ray has nothing to lie over
        background = plan.background if plan.program.blend != "xray" else None
        if plan.samples > 1 or background is not None:
            target = self._resolve(target, camera.size, plan.samples, background)
        return target.read()

    def _draw_splats(self, splats: Splats, camera: Camera, plan: Plan) -> None:
        program = self.programs.for_splats(plan.program)
        self.frame.write(frame_block(splats, camera, plan).tobytes())
        self.style.write(style_block(splats, plan).tobytes())
        self.frame.bind_to_uniform_block(FRAME_BINDING)
        self.style.bind_to_uniform_block(STYLE_BINDING)
        self._table(plan).use(location=0)
        if plan.program.half_line:
            program["half_table"] = 1
            self._half_table(plan.kernel).use(location=1)

        blend = BLENDS[plan.program.blend, plan.program.order]
        self.ctx.enable_only(moderngl.BLEND)
        self.ctx.blend_equation = blend.equation  # type: ignore[assignment]
        self.ctx.blend_func = blend.source, blend.destination
        order = order_for(splats, camera) if plan.program.blend == "composite" else None
        vertices = self.splats.vertices(program, splats, order, plan.program.order == "front-to-back")
        vertices.render(moderngl.TRIANGLE_STRIP, vertices=CORNERS, instances=len(splats))

    def _resolve(
        self, drawn: Target, size: tuple[int, int], samples: int, background: tuple[float, float, float] | None
    ) -> Target:
        program = self.programs.for_resolve()
        target = self.targets.get("resolve", size, "rgba32f")
        target.framebuffer.use()
        self.ctx.enable_only(moderngl.NOTHING)
        drawn.texture.use(location=0)
        program["samples"] = samples
        program["background"] = (*background, 1.0) if background else (0.0, 0.0, 0.0, 0.0)
        whole = self.ctx.vertex_array(program, [])
        try:
            whole.render(moderngl.TRIANGLES, vertices=3)
        finally:
            whole.release()
        return target

    def _table(self, plan: Plan) -> moderngl.Texture:
        """F/F(0), over the plane or over the squared distance."""
        size, bits = plan.table_size, plan.table_bits
        make = footprint_table if plan.program.footprint == "table" else radial_table
        key = (plan.kernel.name, plan.program.footprint, size, bits)
        return self.tables.get(key) or self._texture(key, make(plan.kernel, size), bits)

    def _half_table(self, kernel: Kernel) -> moderngl.Texture:
        key = (kernel.name, "half", HALF_TABLE_SIZE, 32)
        return self.tables.get(key) or self._texture(key, half_line_table(kernel, HALF_TABLE_SIZE), 32)

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


class SplatBuffer:
    """The last splats' records on the GPU, in the order in which they are drawn."""

    def __init__(self, ctx: moderngl.Context, owned: ExitStack) -> None:
        self.ctx = ctx
        self.splats: Splats | None = None
        self.uploaded: tuple[Order | None, bool, bool] | None = None
        self.buffer: moderngl.Buffer | None = None
        self.arrays: dict[int, moderngl.VertexArray] = {}
        owned.callback(self.release)

    def vertices(
        self, program: moderngl.Program, splats: Splats, order: Order | None, nearest_first: bool
    ) -> moderngl.VertexArray:
        """A vertex array whose instances are the splats in drawing order; order None: any will do."""
        if splats is not self.splats:
            self.release()
            self.splats = splats
        runs = "in_runs" in program
        if self.buffer is None or (order is not None and (order, nearest_first, runs) != self.uploaded):
            self._upload(splats, order, nearest_first, runs)
            self.uploaded = (order, nearest_first, runs)
        assert self.buffer is not None
        if program.glo not in self.arrays:
            used = [name for name in GL_ATTRIBUTES if name in program]
            self.arrays[program.glo] = self.ctx.vertex_array(program, [(self.buffer, _format(used), *used)])
        return self.arrays[program.glo]

    def release(self) -> None:
        for array in self.arrays.values():
            array.release()
        self.arrays.clear()
        if self.buffer is not None:
            self.buffer.release()
        self.buffer, self.splats, self.uploaded = None, None, None

    def _upload(self, splats: Splats, order: Order | None, nearest_first: bool, runs: bool) -> None:
        records = splats.records
        if order is not None:
            sequence = back_to_front(splats, order)
            records = records[sequence[::-1] if nearest_first else sequence]
            if runs:
                records["runs"] = splats.runs[sequence[::-1] if nearest_first else sequence]
        if self.buffer is None:
            self.buffer = self.ctx.buffer(records)
        else:
            self.buffer.write(records)


def _format(used: list[str]) -> str:
    """The record's format with the attributes that a program does not read skipped."""
    parts = GL_FORMAT.removesuffix("/i").split()
    sizes = {"3f4": "12x", "1f4": "4x", "3i2": "6x", "1i2": "2x"}
    named = iter(GL_ATTRIBUTES)
    kept = [part if part.endswith("x") or next(named) in used else sizes[part] for part in parts]
    return " ".join(kept) + "/i"
