"""Draws the sheets nearest to the eye, which are planes perpendicular to each ray, on a coarse grid of rays."""

from __future__ import annotations

from contextlib import ExitStack

import moderngl
import numpy as np

from splatgl.gl.buffers import free
from splatgl.gl.program import Programs, cover, set_uniforms
from splatgl.gl.textures import Tables
from splatgl.planning.plan import Plan
from splatgl.splat.sheets import NearField

# texture units
SUMS_UNIT, MASSES_UNIT, VOXELS_UNIT = 28, 29, 30
# minimum distance of two rays of the grid, in voxels (the field is linear between them); maximum rows of the grid
LEAST_APART, MOST_ROWS = 1 / 128, 16_000
# uniforms of a picture without near sheets
NOTHING: dict[str, object] = {"near_base": -(2**30)}


class NearSheets:
    """Draws near sheets; reuses its textures between pictures."""

    def __init__(self, ctx: moderngl.Context, programs: Programs, tables: Tables, owned: ExitStack) -> None:
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
            return NOTHING
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
