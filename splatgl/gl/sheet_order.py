"""Sorts splats by their first sheet on the GPU, anew for every picture: by counting, run by run."""

from __future__ import annotations

import moderngl
import numpy as np

from splatgl.gl.buffers import Texels, uneven
from splatgl.gl.constants import ABREAST, LANES
from splatgl.gl.near_sheets import NOTHING
from splatgl.gl.program import Programs
from splatgl.gl.tables import class_uniforms
from splatgl.gl.uniforms import base_of
from splatgl.splat.clipping import MOST_CLIPS, Clip
from splatgl.splat.culling import Window
from splatgl.splat.plan import Plan
from splatgl.splat.sheets import index_direction
from splatgl.splat.splats import Splats
from splatgl.splat.view import View

# most splats of a run: llvmpipe ends a loop after 65535 iterations; and the least runs, for all cores and lanes
MOST_RUN, LEAST_RUNS = 60_000, 64
# texture unit of the records, buffer binding of the cursors, and image unit of the order
RECORDS_UNIT, CURSORS, IMAGE = 5, 0, 0

# of sheets from the first: no end
EVERYWHERE = (-1e9, 1e9)

Uniforms = dict[str, object]


def sheet_uniforms(splats: Splats, plan: Plan) -> Uniforms:
    """Uniforms of sheets.glsl and sheet_close.glsl."""
    sheets, view, post = plan.resolved.sheets, plan.view, splats.post
    assert sheets is not None
    found: Uniforms = {
        "sheet_eye": tuple(view.eye_index - base_of(splats, view.eye_index)),
        "sheet_direction": tuple(index_direction(view)),
        "thickness": sheets.thickness,
        "kernel_variance": sheets.variance,
        "kernel_spectrum": sheets.spectrum,
        "full_mass": sheets.mass,
        "first_sheet": float(sheets.range(splats, view)[0]),
        "shell": EVERYWHERE,
        "partial": False,
        **NOTHING,
        "edges": window_edges(view, Window(0, 0, *view.size)),
    }
    if post is not None:
        found |= class_uniforms(post)
        if plan.program.look.weighted:
            _, low, step = post.weights
            # of gradients of record values per mean spacing
            found["weight_scale"] = (post.span / splats.grid.mean_spacing / step, -low / step)
        found |= {
            "box_low": tuple(-0.5 - view.eye_index),
            "box_high": tuple(np.array(post.shape) - 0.5 - view.eye_index),
        }
    if plan.resolved.clip is not None:
        found |= clip_uniforms(plan.resolved.clip, view)
    if plan.resolved.mask is not None:
        found["mask_low"] = tuple(plan.resolved.mask.low - view.eye_index)
    return found


def clip_uniforms(clip: Clip, view: View) -> Uniforms:
    """The planes of sheet_close.glsl, from the eye; unit normals of index space."""
    rows = np.zeros((MOST_CLIPS, 4))
    own = np.column_stack([clip.g, clip.place - clip.g @ view.eye_index])
    rows[: len(clip.g)] = own / np.linalg.norm(clip.g, axis=1)[:, None]
    normals = np.zeros((MOST_CLIPS, 3))
    normals[: len(clip.g)] = clip.normal
    return {"clips": len(clip.g), "clip": [*map(tuple, rows)], "clip_normal": [*map(tuple, normals)]}


def window_edges(view: View, window: Window) -> tuple[float, ...]:
    """Slopes, or lengths in mean spacings, of the left, upper, right and lower edge of a window of samples."""
    x, y, width, height = window.box
    ends = np.array([[x, y], [x + width, y + height]]) - np.array(view.size) / 2
    return tuple((ends * view.pitch).ravel().tolist())


def sheet_span(splats: Splats, plan: Plan) -> int:
    """How many sheets the splats may belong to."""
    assert plan.resolved.sheets is not None
    first, last = plan.resolved.sheets.range(splats, plan.view)
    return last - first + 1


class SheetOrder:
    """Reuses its buffer and texture between pictures; they grow on demand."""

    def __init__(self, ctx: moderngl.Context, programs: Programs) -> None:
        self.ctx, self.programs = ctx, programs
        self.cursors: moderngl.Buffer | None = None
        self.order: moderngl.Texture | None = None

    def release(self) -> None:
        """Frees the buffer and the texture; they are recreated on demand."""
        for part in (self.cursors, self.order):
            if part is not None:
                part.release()
        self.cursors, self.order = None, None

    def sorted(self, count: int, number: int, plan: Plan, texels: Texels, uniforms: Uniforms) -> tuple[Texels, int]:
        """The same records with their order by first sheet, and how many of them may be visible.

        count: of splats. number: of sheets.
        """
        runs = max(LEAST_RUNS, -(-count // (MOST_RUN * LANES)) * LANES)
        size = runs * (number + 1) * 4
        cursors = self._cursors(size)
        cursors.clear(size)
        texels.records.use(RECORDS_UNIT)
        self._run(plan, True, {**uniforms, "count": count, "number": number}, runs)
        found = np.frombuffer(cursors.read(size), np.uint32).reshape(runs, number + 1)
        # sheet by sheet, within a sheet run by run
        until = np.cumsum(found.T, dtype=np.uint32).reshape(number + 1, runs)
        cursors.write(np.ascontiguousarray((until - found.T).T))
        order = self._order(count)
        order.bind_to_image(IMAGE, read=False, write=True)
        self._run(plan, False, {**uniforms, "count": count, "number": number}, runs)
        return Texels(texels.records, texels.rest, order), int(until[-1, 0]) - int(found[0, -1])

    def _run(self, plan: Plan, counting: bool, uniforms: Uniforms, runs: int) -> None:
        program = self.programs.for_tiles("sheet_sort.comp", plan.program, {"COUNTING": counting})
        values = {**uniforms, "records": RECORDS_UNIT, "length_": -(-int(str(uniforms["count"])) // runs)}
        for name, value in values.items():
            if name in program:
                program[name] = value
        program.run(runs // LANES)
        self.ctx.memory_barrier()

    def _cursors(self, size: int) -> moderngl.Buffer:
        if self.cursors is None or self.cursors.size < size:
            if self.cursors is not None:
                self.cursors.release()
            self.cursors = self.ctx.buffer(reserve=size)
        self.cursors.bind_to_storage_buffer(CURSORS)
        return self.cursors

    def _order(self, count: int) -> moderngl.Texture:
        height = -(-max(count, 1) // ABREAST)
        if self.order is None or self.order.height < height:
            if self.order is not None:
                self.order.release()
            self.order = self.ctx.texture((ABREAST, uneven(height)), 1, dtype="u4")
            self.order.filter = (moderngl.NEAREST, moderngl.NEAREST)
        return self.order
