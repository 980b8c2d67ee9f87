"""Textures of footprints, of transfer functions, and of the sheets around the eye."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack

import moderngl
import numpy as np

from splatgl.gl.buffers import free, texel_texture
from splatgl.gl.program import Programs, cover, set_uniforms
from splatgl.gl.shader import TABLE_ROW
from splatgl.planning.plan import Plan
from splatgl.splat.kernels import Kernel, footprint_table, half_line_table, radial_table
from splatgl.splat.motion_blur import blur_table
from splatgl.splat.sheets import NearField
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


class TableTextures:
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


# texture units
SUMS_UNIT, MASSES_UNIT, VOXELS_UNIT = 28, 29, 30
# minimum distance of two rays of the grid, in voxels (the field is linear between them); maximum rows of the grid
LEAST_APART, MOST_ROWS = 1 / 128, 16_000
# uniforms of a picture without near sheets
NO_NEAR_SHEETS: dict[str, object] = {"near_base": -(2**30)}


class NearSheets:
    """Draws near sheets; reuses its textures between pictures."""

    def __init__(self, ctx: moderngl.Context, programs: Programs, tables: TableTextures, owned: ExitStack) -> None:
        self.ctx, self.programs, self.tables = ctx, programs, tables
        self.voxels: moderngl.Texture3D | None = None
        self.target: moderngl.Framebuffer | None = None
        self.textures: list[moderngl.Texture] = []
        owned.callback(self.release)

    def release(self) -> None:
        """Frees the textures; they are recreated on demand."""
        free(self.target, *self.textures, self.voxels)
        self.target, self.textures, self.voxels = None, [], None

    def draw(self, near: NearField | None, plan: Plan, first_sheet: float) -> dict[str, object]:
        """Draws the near sheets and binds their textures; returns uniforms of near_sheets.glsl and sheet_sort.comp.

        first_sheet: number of the first sheet, from which the shaders count.
        """
        if near is None:
            return NO_NEAR_SHEETS
        sheets = plan.resolved.sheets
        assert sheets is not None
        step = grid_step(near, plan)
        columns, rows = (-(-(side - 1) // step) + 1 for side in plan.view.size)
        self._prepare(near, (columns, rows * (near.count + 1)))
        assert self.target is not None
        program = self.programs.for_screen("near_field.frag", plan.program, {"SIDE": 2 * near.around})
        self.tables.use(plan)
        low = tuple(near.low - plan.view.eye_index)
        set_uniforms(program, near_voxels=VOXELS_UNIT, near_low=low, thickness=sheets.thickness)
        set_uniforms(program, near_step=step, near_rows=rows)
        self.target.use()
        self.ctx.enable_only(moderngl.NOTHING)
        cover(program)
        for unit, texture in zip((SUMS_UNIT, MASSES_UNIT), self.textures, strict=True):
            texture.use(unit)
        first = -int(first_sheet)
        return {
            "near_sums": SUMS_UNIT,
            "near_masses": MASSES_UNIT,
            "near_sheets": (first - 1, first + near.count),
            "near_grid": (1.0 / step, float(rows)),
            "near_base": first + near.count - sheets.count + 1,
        }

    def _prepare(self, near: NearField, size: tuple[int, int]) -> None:
        """Uploads the voxels and creates textures of the given size."""
        shape = near.cells.shape[2::-1]
        if self.voxels is None or self.voxels.size != shape:
            free(self.voxels)
            self.voxels = self.ctx.texture3d(shape, 4, alignment=4, dtype="f4")
            self.voxels.filter = (moderngl.NEAREST, moderngl.NEAREST)
        self.voxels.write(np.ascontiguousarray(near.cells))
        self.voxels.use(VOXELS_UNIT)
        if self.target is None or self.target.size != size:
            old = self.target, *self.textures
            self.textures = [self.ctx.texture(size, components, dtype="f4") for components in (4, 1)]
            for texture in self.textures:
                texture.filter = (moderngl.LINEAR, moderngl.LINEAR)
                texture.repeat_x = texture.repeat_y = False
            self.target = self.ctx.framebuffer(self.textures)
            free(*old)


def grid_step(near: NearField, plan: Plan) -> int:
    """Returns the distance of two rays of the grid, in pixels (or samples), between which linear interpolation stays
    within the tolerance, even for a field as rough as noise.
    """
    view, sheets = plan.view, plan.resolved.sheets
    assert sheets is not None
    widths = np.linalg.svd(view.index_from_eye, compute_uv=False)
    # maximum distance, in voxels, of neighbouring pixels' rays at the furthest sheet
    apart = view.pitch * widths[0] / widths[-1] * sheets.thickness * (near.count - 1)
    allowed = max(float(np.sqrt(plan.resolved.tolerance)), LEAST_APART)
    return max(int(allowed / apart), -(-view.size[1] * (near.count + 1) // MOST_ROWS), 1)
