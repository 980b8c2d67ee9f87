"""Draws sheets by quads, without compute shaders: blends splats into open sheets, and composites sheet by sheet.

Splats are sorted by their first sheet. A splat is drawn once, into the textures of all sheets that it contributes to.
When a sheet is complete, a pass over its pixels composites it, and its textures are cleared for the next sheet. Blends
of one value collect the values of all sheets in a separate texture, which the last pass classifies.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import moderngl
import numpy as np

from splatgl.gl.buffers import DrawOrder, Instances, uneven
from splatgl.gl.near_sheets import NearSheets
from splatgl.gl.program import Programs, set_uniforms, use_blend
from splatgl.gl.quads import CORNERS
from splatgl.gl.sheet_tiles import sheet_uniforms
from splatgl.gl.target import Portions, Target, settle
from splatgl.gl.textures import CLASS_UNIT, HALF_LINE_UNIT, Tables
from splatgl.gl.tiles import bands_of
from splatgl.gl.uniforms import frame_block
from splatgl.splat.culling import Window, screen_bounds
from splatgl.splat.grid import corners_of
from splatgl.splat.plan import Plan
from splatgl.splat.settings import BLENDS, BlendMode
from splatgl.splat.sheets import NearField, Sheets
from splatgl.splat.splats import Splats
from splatgl.splat.view import GridView

# texture units of a sheet and the two sheets before it, and of the joined values
UNITS = {
    **{"sheet_sums": 4, "sheet_masses": 5, "sums_before": 6, "masses_before": 7},
    **{"sums_earlier": 8, "masses_earlier": 9},
}
JOINED_UNIT = 10
# less than any value and any −value
LEAST = -float(np.finfo(np.float32).max)


# maximum pixels of a band of the picture: open sheets take up to 120 bytes per pixel
MOST_PIXELS = 2**22


class Group(NamedTuple):
    """Splats with the same first sheet, from begin to end (exclusive). window: pixels that they reach."""

    begin: int
    end: int
    window: Window


class Kind(NamedTuple):
    """Properties that determine a ring's textures. size: pixels of the picture. rows: of a band. sheets: sheets per
    splat. post: whether values are classified after reconstruction. one_value: whether a pixel's values are joined.
    """

    size: tuple[int, int]
    rows: int
    sheets: int
    post: bool
    one_value: bool


class SheetQuads:
    """Draws sheets by quads; reuses its textures and buffer between pictures. whole: draws one triangle over the bound
    framebuffer. frame: buffer of the uniform block Frame.
    """

    def __init__(
        self,
        ctx: moderngl.Context,
        programs: Programs,
        whole: Callable[[moderngl.Program], None],
        tables: Tables,
        near: NearSheets,
        frame: moderngl.Buffer,
    ) -> None:
        self.ctx, self.programs, self.whole, self.tables, self.frame = ctx, programs, whole, tables, frame
        self.near = near
        self.instances = Instances(ctx)
        self.ring: Ring | None = None

    def release(self) -> None:
        """Frees the textures and the buffer; they are recreated on demand."""
        self.instances.release()
        if self.ring is not None:
            self.ring.release()
        self.ring = None

    def draw(self, target: Target, splats: Splats, plan: Plan, order: DrawOrder, portions: Portions) -> None:
        """Composites the sheets into `target`, nearest first; raises Interrupted if cancelled. order: unused."""
        sheets, look = plan.resolved.sheets, plan.program.look
        assert sheets is not None
        uniforms, field = sheet_uniforms(splats, plan), NearField.of(splats, plan.view, sheets)
        first_sheet = float(str(uniforms["first_sheet"]))
        uniforms |= self.near.draw(field, plan, first_sheet)
        adding = self.programs.for_splats(plan.program)
        closing = self.programs.for_screen("sheet_close.frag", plan.program, {"NEAR": True} if field else {})
        for program in (adding, closing):
            set_uniforms(program, half_table=HALF_LINE_UNIT, **UNITS, **uniforms)
        if splats.post is not None:
            self.tables.classification(splats).use(CLASS_UNIT)
        indices, groups = by_first_sheet(splats, sheets, plan.view)
        near = range(0)
        if field is not None:
            # the near sheets, and the two sheets behind them, to which their matter extends
            nearest = -int(first_sheet)
            near = range(nearest - 1, nearest + field.count + 2)
            groups = {base: group for base, group in groups.items() if base >= int(str(uniforms["near_base"]))}
        records = splats.records_with_runs if plan.program.runs else splats.records
        self.instances.fill(records[indices])
        bands = bands_of(Window(0, 0, *plan.view.size), MOST_PIXELS)
        ring = self._ring(Kind(plan.view.size, bands[0].height, look.sheets, look.steps > 0, look.blend.one_value))
        into = ring.joined or target.framebuffer
        if ring.joined:
            ring.joined.clear(LEAST if look.blend.extreme else 0.0)
        try:
            for band in bands:
                block = frame_block(splats, plan)
                block["image_center"][1] -= band.y
                self.frame.write(block.tobytes())
                set_uniforms(closing, top=band.y, near_top=float(band.y))
                reached = within(groups, band)
                ring.begin(band, band if near else around(reached, min(groups), max(groups)))
                for sheet in sorted({*near, *closed(reached, ring.slots)}):
                    portions.ask()
                    if sheet in reached:
                        self._add(adding, ring, sheet, reached[sheet], portions)
                    window = band if sheet in near else around(reached, sheet - ring.slots + 1, sheet)
                    self._close(into, closing, look.blend, ring, sheet, window)
                    done = sheet - (ring.slots - ring.count)
                    ring.clear(done, around(reached, done - ring.count + 1, done))
        finally:
            into.scissor = None  # type: ignore[assignment]
        if ring.joined:
            self._show(target, splats, plan, ring)

    def _add(self, program: moderngl.Program, ring: Ring, sheet: int, group: Group, portions: Portions) -> None:
        """Blends a group of splats into its sheets."""
        set_uniforms(program, sheet=sheet)
        use_blend(self.ctx, BLENDS["xray"])
        ring.open[sheet % ring.slots].use()
        for begin, end in portions.over(group.begin, group.end):
            vertices = self.instances.vertices(program, begin)
            vertices.render(moderngl.TRIANGLE_STRIP, vertices=CORNERS, instances=end - begin)

    def _close(
        self,
        into: moderngl.Framebuffer,
        program: moderngl.Program,
        blend: BlendMode,
        ring: Ring,
        sheet: int,
        window: Window,
    ) -> None:
        """Composites a sheet within a window; with later classification, the matter around the sheet before it."""
        set_uniforms(program, sheet=sheet)
        ring.use(sheet)
        into.scissor = window.box
        into.use()
        use_blend(self.ctx, blend)
        self.whole(program)

    def _show(self, target: Target, splats: Splats, plan: Plan, ring: Ring) -> None:
        """Classifies the joined value of each pixel."""
        program = self.programs.for_screen("sheet_show.frag", plan.program)
        set_uniforms(program, joined_values=JOINED_UNIT, **sheet_uniforms(splats, plan))
        ring.values[0].use(JOINED_UNIT)
        target.framebuffer.use()
        self.ctx.enable_only(moderngl.NOTHING)
        self.whole(program)

    def _ring(self, kind: Kind) -> Ring:
        if self.ring is None or self.ring.kind != kind:
            old, self.ring = self.ring, Ring(self.ctx, kind)
            if old is not None:
                old.release()
        return self.ring


class Ring:
    """Ring of textures of a band's open sheets; with later classification, also of two earlier sheets. values: texture
    of the picture's joined values and lengths, for blends of one value.
    """

    def __init__(self, ctx: moderngl.Context, kind: Kind) -> None:
        self.ctx, self.kind, self.count, self.slots, self.top = ctx, kind, kind.sheets, kind.sheets + 2 * kind.post, 0
        wide, size = uneven(kind.size[0]), (uneven(kind.size[0]), uneven(kind.rows))
        self.sums = [ctx.texture(size, 4, dtype="f4") for _ in range(self.slots)]
        self.masses = [ctx.texture(size, 1, dtype="f4") for _ in range(self.slots * kind.post)]
        self.values = [ctx.texture((wide, uneven(kind.size[1])), 2, dtype="f4") for _ in range(kind.one_value)]
        for texture in (*self.sums, *self.masses, *self.values):
            texture.filter = (moderngl.NEAREST, moderngl.NEAREST)
        # framebuffers of all open sheets from a slot on, and of a single slot
        self.open = [ctx.framebuffer(self._attachments(n, self.count)) for n in range(self.slots)]
        self.each = [ctx.framebuffer(self._attachments(n, 1)) for n in range(self.slots)]
        self.joined = ctx.framebuffer(self.values) if self.values else None
        if self.joined:
            self.joined.viewport = (0, 0, *kind.size)

    def begin(self, band: Window, window: Window) -> None:
        """Starts a band of the picture; clears all sheets within a window of it."""
        self.top = band.y
        for slot, framebuffer in enumerate(self.open):
            framebuffer.viewport = (0, -band.y, *self.kind.size)
            self.clear(slot, window)

    def clear(self, sheet: int, window: Window) -> None:
        """Clears a sheet within a window of the picture."""
        x, y, width, height = window.box
        self.each[sheet % self.slots].clear(viewport=(x, y - self.top, width, height))
        settle(self.ctx)

    def use(self, sheet: int) -> None:
        """Binds the textures of a sheet; with later classification, also of the two sheets before it."""
        sheets = (sheet, sheet - 1, sheet - 2) if self.masses else (sheet,)
        textures = [ring[n % self.slots] for n in sheets for ring in (self.sums, self.masses) if ring]
        for unit, texture in zip(UNITS.values(), textures, strict=False):
            texture.use(unit)

    def release(self) -> None:
        """Frees the textures."""
        for part in (*self.open, *self.each, self.joined, *self.sums, *self.masses, *self.values):
            if part is not None:
                part.release()

    def _attachments(self, first: int, count: int) -> list[moderngl.Texture | moderngl.Renderbuffer]:
        slots = [(first + n) % self.slots for n in range(count)]
        return [textures[n] for textures in (self.sums, self.masses) if textures for n in slots]


def by_first_sheet(splats: Splats, sheets: Sheets, view: GridView) -> tuple[np.ndarray, dict[int, Group]]:
    """Returns indices that sort the records by first sheet, int64 [N], and the groups by first sheet, ascending."""
    positions = splats.positions
    first = sheets.range(splats, view)[0]
    # 16-bit integers hold up to MOST_SHEETS, and numpy sorts them by radix
    base = (sheets.base(sheets.places(view, positions)) - first).astype(np.int16)
    indices = np.argsort(base, kind="stable")
    numbers, begins = np.unique(base[indices], return_index=True)
    in_order = positions[indices]
    low, high = (reach.reduceat(in_order, begins).astype(np.float64) for reach in (np.minimum, np.maximum))
    ends = [*begins[1:], len(splats)]
    windows = [screen_bounds(corners_of(*box), view).window for box in zip(low, high, strict=True)]
    groups = zip(begins.tolist(), ends, windows, strict=True)
    return indices, dict(zip(numbers.tolist(), (Group(*group) for group in groups), strict=True))


def within(groups: dict[int, Group], band: Window) -> dict[int, Group]:
    """Returns the groups that reach into a band of rows, with their windows clipped to it."""
    clipped = {}
    for sheet, (begin, end, window) in groups.items():
        top, bottom = max(window.y, band.y), min(window.y + window.height, band.y + band.height)
        if top < bottom:
            clipped[sheet] = Group(begin, end, Window(window.x, top, window.width, bottom - top))
    return clipped


def closed(groups: dict[int, Group], slots: int) -> list[int]:
    """Returns the sheets that may hold matter, ascending: `slots` sheets from each group's first sheet on."""
    return sorted({first + n for first in groups for n in range(slots)})


def around(groups: dict[int, Group], first: int, last: int) -> Window:
    """Returns the window of the groups whose first sheets are in first…last, inclusive; empty without groups."""
    windows = [groups[n].window for n in range(first, last + 1) if n in groups]
    if not windows:
        return Window(0, 0, 0, 0)
    x, y = min(w.x for w in windows), min(w.y for w in windows)
    right, bottom = max(w.x + w.width for w in windows), max(w.y + w.height for w in windows)
    return Window(x, y, right - x, bottom - y)
