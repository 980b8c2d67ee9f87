"""Draws every splat as an instance of a textured quad, blended in drawing order.  [M98 §3.5]"""

from __future__ import annotations

import moderngl
import numpy as np

from splatgl.errors import expected
from splatgl.gl.buffers import Attribute, DrawOrder, Range, Sorted, chunks, free, indices
from splatgl.gl.device import Device
from splatgl.gl.features import feature_uniforms
from splatgl.gl.meshes import Limits
from splatgl.gl.program import set_uniforms, use_blend
from splatgl.gl.target import Portions, Target
from splatgl.gl.textures import BLUR_UNIT, HALF_LINE_UNIT
from splatgl.planning.plan import Plan
from splatgl.splat.motion import Exposure
from splatgl.splat.splats import MOST_KEPT, Splats

CORNERS = 4


class Quads:
    """Draws splats as instanced quads; needs only OpenGL 3.3 and supports every plan."""

    def __init__(self, device: Device) -> None:
        self.ctx, self.programs, self.splats = device.ctx, device.programs, device.splats

    def draw(
        self,
        target: Target,
        splats: Splats,
        plan: Plan,
        order: DrawOrder,
        portions: Portions,
        limits: Limits | None = None,
    ) -> None:
        """Blends the splats into `target` in drawing order, chunk by chunk; raises Interrupted if cancelled."""
        program = self.programs.for_splats(plan.program, {"LIMITED": True} if limits is not None else {})
        if limits is not None:
            limits.use_in(program, splats.grid.mean_spacing)
        set_uniforms(program, half_table=HALF_LINE_UNIT, blur_table=BLUR_UNIT, **feature_uniforms(splats, plan))
        use_blend(self.ctx, plan.program.look.join, order.nearest_first)
        target.framebuffer.use()
        for chunk in chunks((0, len(splats))):
            quads = self._instances(splats, plan, order, chunk)
            for begin, end in portions.over(*chunk):
                vertices = quads.vertices(program, begin - chunk[0])
                vertices.render(moderngl.TRIANGLE_STRIP, vertices=CORNERS, instances=end - begin)

    def release(self) -> None:
        """Does nothing: Quads owns no GL objects."""

    def _instances(self, splats: Splats, plan: Plan, order: DrawOrder, which: Range) -> Sorted:
        """Returns the instances of splats `which` of the drawing order."""
        return self.splats.of(splats).quads(plan.program.runs, order, which)


class Streaks(Quads):
    """Quads that cover motion streaks; caches the latest moving splats."""

    flowing: Flowing | None = None

    def release(self) -> None:
        """Frees the buffers of the moving splats."""
        free(self.flowing)
        self.flowing = None

    def _instances(self, splats: Splats, plan: Plan, order: DrawOrder, which: Range) -> Sorted:
        if not plan.program.flow:
            return super()._instances(splats, plan, order, which)
        assert plan.exposure is not None
        if len(splats) > MOST_KEPT:
            raise expected("splats", f"at most {MOST_KEPT:,} that flow", f"{len(splats):,}", "raise the threshold")
        if self.flowing is None or not self.flowing.holds(splats, plan.exposure):
            self.release()
            self.flowing = Flowing(self.ctx, splats, plan.exposure)
        self.flowing.write(order, plan.program.runs, which)
        return self.flowing


class Flowing(Sorted):
    """Records in drawing order, and the drift of each splat during half of the exposure, in grid steps."""

    def __init__(self, ctx: moderngl.Context, splats: Splats, exposure: Exposure) -> None:
        super().__init__(ctx, splats)
        self.exposure = exposure
        self.drift = exposure.drift(splats).astype(np.float32)
        self.drift_buffer = ctx.buffer(reserve=self.drift.nbytes)

    def holds(self, splats: Splats, exposure: Exposure) -> bool:
        """Whether the buffers hold the drift of these splats, for the same flow and number of frames."""
        current = self.exposure
        return splats is self.splats and exposure.flow is current.flow and exposure.frames == current.frames

    def release(self) -> None:
        """Frees the buffers of records and drift."""
        super().release()
        self.drift_buffer.release()

    def _attributes(self) -> list[Attribute]:
        return [*super()._attributes(), ("in_flow", self.drift_buffer, "f", "3f4", 0, self.drift.itemsize * 3)]

    def _upload(self, order: DrawOrder, runs: bool, which: Range) -> None:
        super()._upload(order, runs, which)
        drift = self.drift if order.boxes is None else self.drift[indices(self.splats, order)]
        self.drift_buffer.write(np.ascontiguousarray(drift))
