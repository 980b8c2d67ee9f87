"""Textures of footprints and transfer functions."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack

import moderngl
import numpy as np

from splatgl.gl.buffers import texel_texture
from splatgl.gl.shader import TABLE_ROW
from splatgl.planning.plan import Plan
from splatgl.splat.kernels import Kernel, footprint_table, half_line_table, radial_table
from splatgl.splat.motion_blur import blur_table
from splatgl.splat.splats import Splats
from splatgl.transfer.preintegration import WEIGHTS, ValueClassifier

# texture units
FOOTPRINT_UNIT, HALF_LINE_UNIT, BLUR_UNIT, CLASS_UNIT = 0, 1, 3, 15
# rows of weights by gradient behind the classification table
WEIGHT_ROWS = WEIGHTS // TABLE_ROW + 1
# bits of a channel → moderngl's dtype, numpy's dtype, and the stored value of 1.0
FORMATS: dict[int, tuple[str, np.dtype, int]] = {
    32: ("f4", np.dtype("<f4"), 1),
    16: ("nu2", np.dtype("<u2"), 65535),
    8: ("f1", np.dtype("u1"), 255),
}
# texels along each axis of the half-line table: bilinear error 1e−5
HALF_LINE_SIZE = 256


class Tables:
    """Cache of table textures."""

    def __init__(self, ctx: moderngl.Context, owned: ExitStack) -> None:
        self.ctx, self.owned = ctx, owned
        self.kept: dict[tuple[str, str, int, int], moderngl.Texture] = {}
        # classification table of the last splats that were classified after reconstruction
        self.classes: tuple[ValueClassifier, moderngl.Texture] | None = None

    def use(self, plan: Plan) -> None:
        """Binds the tables that a plan's program reads."""
        kernel, program = plan.kernel, plan.program
        size, bits = plan.lookup.size, plan.lookup.bits
        if size > 1:
            make = footprint_table if program.footprint == "table" else radial_table
            self._of(kernel, program.footprint, size, bits, lambda: make(kernel, size)).use(FOOTPRINT_UNIT)
        if program.seen.half_line:
            table = self._of(kernel, "half line", HALF_LINE_SIZE, 32, lambda: half_line_table(kernel, HALF_LINE_SIZE))
            table.use(HALF_LINE_UNIT)
        if program.motion == "exact":
            self._of(kernel, "blur", 0, 32, lambda: blur_table(kernel.name).packed).use(BLUR_UNIT)

    def classification(self, splats: Splats) -> moderngl.Texture:
        """Returns the table of the splats' transfer function, see sheet_draw.comp; cached for the next picture."""
        assert splats.post is not None
        cached = self.classes
        if cached is None or cached[0] is not splats.post:
            table, _ = splats.post.table
            rows = -(-len(table) // TABLE_ROW)
            image = splats.post.image[0].reshape(-1, 4)
            texels = np.zeros((rows + WEIGHT_ROWS + -(-len(image) // TABLE_ROW), TABLE_ROW, 4), np.uint32)
            texels[:rows].reshape(-1, 4)[: len(table)] = table
            if splats.post.transfer.gradient:
                weights = splats.post.weights[0].view(np.uint32)
                texels[rows:].reshape(-1, 4)[: len(weights), 0] = weights
            texels[rows + WEIGHT_ROWS :].reshape(-1, 4)[: len(image)] = image
            if cached is not None and cached[1].size != texels.shape[1::-1]:
                cached[1].release()
                cached = None
            if cached is None:
                texture = texel_texture(self.ctx, texels.shape[1::-1], 4, "u4", texels.tobytes())
                self.owned.callback(texture.release)
            else:
                texture = cached[1]
                texture.write(texels)
            self.classes = cached = splats.post, texture
        return cached[1]

    def _of(self, kernel: Kernel, kind: str, size: int, bits: int, make: Callable[[], np.ndarray]) -> moderngl.Texture:
        key = (kernel.name, kind, size, bits)
        if key not in self.kept:
            self.kept[key] = self._texture(make(), bits)
        return self.kept[key]

    def _texture(self, texels: np.ndarray, bits: int) -> moderngl.Texture:
        dtype, store, one = FORMATS[bits]
        data = (np.rint(texels * one) if one > 1 else texels).astype(store)
        height, width, *components = data.shape
        channels = components[0] if components else 1
        texture = self.ctx.texture((width, height), channels, data.tobytes(), alignment=1, dtype=dtype)
        self.owned.callback(texture.release)
        texture.filter = (moderngl.LINEAR, moderngl.LINEAR)
        texture.repeat_x = texture.repeat_y = False
        return texture


def class_uniforms(post: ValueClassifier) -> dict[str, object]:
    """Returns the uniforms of the classification table, which is bound to CLASS_UNIT."""
    before, behind = post.integral.outside
    return {
        "class_table": CLASS_UNIT,
        "class_scale": post.scale,
        "class_unit": post.table[1],
        "class_before": tuple(before),
        "class_behind": tuple(behind),
        "class_seen": post.seen,
    }
