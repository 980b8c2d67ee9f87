"""What moving splats need on the GPU besides still ones: where the grid goes, and how far each splat flows."""

from __future__ import annotations

from contextlib import ExitStack

import moderngl
import numpy as np

from splatgl.gl.buffers import Attribute, Sorted
from splatgl.gl.draw_order import Range, Sequence, indices
from splatgl.gl.uniforms import PATH, PATH_BINDING, path_block
from splatgl.splat.motion import Exposure
from splatgl.splat.plan import Plan
from splatgl.splat.rows import Splats

# texture unit of the table of blurred footprints
BLUR_UNIT = 3


class StreakBuffers:
    """The block Path, made for the first picture that moves, and the last splats that flow."""

    def __init__(self, ctx: moderngl.Context, owned: ExitStack) -> None:
        self.ctx, self.owned = ctx, owned
        self.path: moderngl.Buffer | None = None
        self.flowing: Flowing | None = None
        owned.callback(self.release)

    def bind_path(self, splats: Splats, plan: Plan) -> None:
        if self.path is None:
            self.path = self.ctx.buffer(reserve=PATH.itemsize)
            self.owned.callback(self.path.release)
        self.path.write(path_block(splats, plan).tobytes())
        self.path.bind_to_uniform_block(PATH_BINDING)

    def quads(self, splats: Splats, sequence: Sequence, plan: Plan, program: moderngl.Program) -> Sorted:
        """The splats, and how far they flow, as instances in drawing order."""
        assert plan.exposure is not None
        if self.flowing is None or not self.flowing.holds(splats, plan.exposure):
            self.release()
            self.flowing = Flowing(self.ctx, splats, plan.exposure)
        self.flowing.write(sequence, "in_runs" in program, (0, len(splats)))
        return self.flowing

    def release(self) -> None:
        if self.flowing is not None:
            self.flowing.release()
        self.flowing = None


class Flowing(Sorted):
    """Records in drawing order, and beside them how far each splat flows in half of the exposure, in grid steps."""

    def __init__(self, ctx: moderngl.Context, splats: Splats, exposure: Exposure) -> None:
        super().__init__(ctx, splats)
        self.exposure = exposure
        self.drift = exposure.drift(splats).astype(np.float32)
        self.drift_buffer = ctx.buffer(reserve=self.drift.nbytes)

    def holds(self, splats: Splats, exposure: Exposure) -> bool:
        mine = self.exposure
        return splats is self.splats and exposure.flow is mine.flow and exposure.frames == mine.frames

    def release(self) -> None:
        super().release()
        self.drift_buffer.release()

    def _attributes(self) -> list[Attribute]:
        return [*super()._attributes(), ("in_flow", self.drift_buffer, "f", "3f4", 0, self.drift.itemsize * 3)]

    def _upload(self, sequence: Sequence, runs: bool, which: Range) -> None:
        super()._upload(sequence, runs, which)
        drift = self.drift if sequence[0] is None else self.drift[indices(self.splats, sequence)]
        self.drift_buffer.write(np.ascontiguousarray(drift))
