"""Moving splats as streaks: quads along their paths, with per-splat flow on the GPU."""

from __future__ import annotations

import moderngl
import numpy as np

from splatgl.errors import expected
from splatgl.gl.buffers import Attribute, Sorted
from splatgl.gl.draw_order import DrawOrder, Range, indices
from splatgl.gl.quads import Quads
from splatgl.splat.motion import Exposure
from splatgl.splat.plan import Plan
from splatgl.splat.splats import MOST_KEPT, Splats


class Streaks(Quads):
    """Quads that cover streaks; caches the last flowing splats."""

    flowing: Flowing | None = None

    def release(self) -> None:
        """Frees the buffers of the splats that flow."""
        if self.flowing is not None:
            self.flowing.release()
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
    """Records in drawing order, with each splat's drift in half of the exposure, in grid steps."""

    def __init__(self, ctx: moderngl.Context, splats: Splats, exposure: Exposure) -> None:
        super().__init__(ctx, splats)
        self.exposure = exposure
        self.drift = exposure.drift(splats).astype(np.float32)
        self.drift_buffer = ctx.buffer(reserve=self.drift.nbytes)

    def holds(self, splats: Splats, exposure: Exposure) -> bool:
        """Whether it holds these splats' drift, for the same flow and number of frames."""
        mine = self.exposure
        return splats is self.splats and exposure.flow is mine.flow and exposure.frames == mine.frames

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
