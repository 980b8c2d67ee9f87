"""What moving splats need on the GPU besides still ones: where the grid goes, and how far each splat flows."""

from __future__ import annotations

from contextlib import ExitStack

import moderngl
import numpy as np

from splatgl.gl.buffers import Range, Sequence, Sorted, _indices
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

    def quads(self, program: moderngl.Program, splats: Splats, sequence: Sequence, plan: Plan) -> moderngl.VertexArray:
        """A vertex array whose instances are splats, and how far they flow, in drawing order."""
        assert plan.exposure is not None
        if self.flowing is None or not self.flowing.holds(splats, plan.exposure):
            self.release()
            self.flowing = Flowing(self.ctx, splats, plan.exposure)
        return self.flowing.vertices(program, sequence, (0, len(splats)))

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

    def _content(self, program: moderngl.Program, buffer: moderngl.Buffer) -> list[tuple]:
        return [*super()._content(program, buffer), (self.drift_buffer, "3f4/i", "in_flow")]

    def _upload(self, sequence: Sequence, runs: bool, which: Range) -> None:
        super()._upload(sequence, runs, which)
        drift = self.drift if sequence[0] is None else self.drift[_indices(self.splats, sequence)]
        self.drift_buffer.write(np.ascontiguousarray(drift))
