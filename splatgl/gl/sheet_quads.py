"""Sheets drawn by quads, without compute shaders: splats are blended into open sheets, which composite one by one.

Splats are sorted by their first sheet. Each is drawn once, into the textures of all sheets that share it; a pass over
the pixels that a sheet reaches then composites it, and its textures are cleared for the sheet that opens next. Blends
of one value join a sheet's values to those of nearer ones in a texture of their own, which a last pass classifies.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import moderngl
import numpy as np

from splatgl.gl.buffers import DrawOrder, Instances, uneven
from splatgl.gl.near_sheets import NearSheets
from splatgl.gl.program import Programs, use_blend
from splatgl.gl.quads import CORNERS
from splatgl.gl.sheet_tiles import sheet_uniforms
from splatgl.gl.target import Portions, Target, settle
from splatgl.gl.textures import CLASS_UNIT, HALF_LINE_UNIT, Tables
from splatgl.gl.tiles import bands_of, set_uniforms
from splatgl.gl.uniforms import frame_block
from splatgl.splat.culling import Window, screen_bounds
from splatgl.splat.grid import corners_of
from splatgl.splat.plan import Plan
from splatgl.splat.settings import BLENDS, BlendMode
from splatgl.splat.sheets import NearField, Sheets
from splatgl.splat.splats import Splats
from splatgl.splat.view import GridView

# texture units of a sheet, of the two before, and of values joined to one
UNITS = {
    **{"sheet_sums": 4, "sheet_masses": 5, "sums_before": 6, "masses_before": 7},
    **{"sums_earlier": 8, "masses_earlier": 9},
}
JOINED_UNIT = 10
# below every value, and every −value
LEAST = -float(np.finfo(np.float32).max)


# most pixels of a band of the picture: its open sheets take up to 120 bytes a pixel
MOST_PIXELS = 2**22


class Group(NamedTuple):
    """Splats begin to end, exclusive, that have the same first sheet; window: the pixels that they reach."""

    begin: int
    end: int
    window: Window


class Kind(NamedTuple):
    """What textures depend on: the picture's size; the rows of a band of it; sheets that share a splat; whether values
    are classified after, and joined.
    """

    size: tuple[int, int]
    rows: int
    sheets: int
    post: bool
    one_value: bool


class SheetQuads:
    """Reuses its textures and its buffer between pictures. whole: draws one triangle over the bound framebuffer.
    frame: the uniform block of that name.
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
        """Composites the sheets into `target`, nearest first; raises Interrupted if cancelled. order: is not used."""
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
        chosen, groups = by_first_sheet(splats, sheets, plan.view)
        near = range(0)
        if field is not None:
            # and two sheets behind them, to which what they hold reaches
            nearest = -int(first_sheet)
            near = range(nearest - 1, nearest + field.count + 2)
            groups = {base: group for base, group in groups.items() if base >= int(str(uniforms["near_base"]))}
        records = splats.records_with_runs if plan.program.runs else splats.records
        self.instances.fill(records[chosen])
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
        """Blends splats into the sheets from their first on."""
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
        """Composites a sheet within a window; classified after, what lies around the one before."""
        set_uniforms(program, sheet=sheet)
        ring.use(sheet)
        into.scissor = window.box
        into.use()
        use_blend(self.ctx, blend)
        self.whole(program)

    def _show(self, target: Target, splats: Splats, plan: Plan, ring: Ring) -> None:
        """Classifies the value that each pixel's sheets were joined to."""
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
    """Textures of the open sheets of a band, used in turn, and classified after of the two before; and of a picture's
    values and lengths of blends of one value.
    """

    def __init__(self, ctx: moderngl.Context, kind: Kind) -> None:
        self.ctx, self.kind, self.count, self.slots, self.top = ctx, kind, kind.sheets, kind.sheets + 2 * kind.post, 0
        wide, size = uneven(kind.size[0]), (uneven(kind.size[0]), uneven(kind.rows))
        self.sums = [ctx.texture(size, 4, dtype="f4") for _ in range(self.slots)]
        self.masses = [ctx.texture(size, 1, dtype="f4") for _ in range(self.slots * kind.post)]
        self.values = [ctx.texture((wide, uneven(kind.size[1])), 2, dtype="f4") for _ in range(kind.one_value)]
        for texture in (*self.sums, *self.masses, *self.values):
            texture.filter = (moderngl.NEAREST, moderngl.NEAREST)
        # of all that are open from a slot on, and of one slot
        self.open = [ctx.framebuffer(self._attachments(n, self.count)) for n in range(self.slots)]
        self.each = [ctx.framebuffer(self._attachments(n, 1)) for n in range(self.slots)]
        self.joined = ctx.framebuffer(self.values) if self.values else None
        if self.joined:
            self.joined.viewport = (0, 0, *kind.size)

    def begin(self, band: Window, window: Window) -> None:
        """Empties all sheets for a band of the picture, within a window of it."""
        self.top = band.y
        for slot, framebuffer in enumerate(self.open):
            framebuffer.viewport = (0, -band.y, *self.kind.size)
            self.clear(slot, window)

    def clear(self, sheet: int, window: Window) -> None:
        """Empties a sheet within a window of the picture."""
        x, y, width, height = window.box
        self.each[sheet % self.slots].clear(viewport=(x, y - self.top, width, height))
        settle(self.ctx)

    def use(self, sheet: int) -> None:
        """Binds the textures of a sheet and, classified after, of the two before."""
        held = (sheet, sheet - 1, sheet - 2) if self.masses else (sheet,)
        textures = [each[n % self.slots] for n in held for each in (self.sums, self.masses) if each]
        for unit, texture in zip(UNITS.values(), textures, strict=False):
            texture.use(unit)

    def release(self) -> None:
        """Frees the textures."""
        for part in (*self.open, *self.each, self.joined, *self.sums, *self.masses, *self.values):
            if part is not None:
                part.release()

    def _attachments(self, first: int, count: int) -> list[moderngl.Texture | moderngl.Renderbuffer]:
        some = [(first + n) % self.slots for n in range(count)]
        return [each[n] for each in (self.sums, self.masses) if each for n in some]


def by_first_sheet(splats: Splats, sheets: Sheets, view: GridView) -> tuple[np.ndarray, dict[int, Group]]:
    """Indices of the records in the order of their first sheets, int64 [N]; groups by first sheet, from the first."""
    positions = splats.positions
    first = sheets.range(splats, view)[0]
    # at most MOST_SHEETS: sorted as 16-bit integers by their digits
    base = (sheets.base(sheets.places(view, positions)) - first).astype(np.int16)
    chosen = np.argsort(base, kind="stable")
    found, begins = np.unique(base[chosen], return_index=True)
    sorted_ = positions[chosen]
    low, high = (reach.reduceat(sorted_, begins).astype(np.float64) for reach in (np.minimum, np.maximum))
    ends = [*begins[1:], len(splats)]
    windows = [screen_bounds(corners_of(*box), view).window for box in zip(low, high, strict=True)]
    groups = zip(begins.tolist(), ends, windows, strict=True)
    return chosen, dict(zip(found.tolist(), (Group(*each) for each in groups), strict=True))


def within(groups: dict[int, Group], band: Window) -> dict[int, Group]:
    """The groups that reach into a band of rows, and the pixels that they reach there."""
    found = {}
    for sheet, (begin, end, window) in groups.items():
        top, bottom = max(window.y, band.y), min(window.y + window.height, band.y + band.height)
        if top < bottom:
            found[sheet] = Group(begin, end, Window(window.x, top, window.width, bottom - top))
    return found


def closed(groups: dict[int, Group], slots: int) -> list[int]:
    """The sheets that hold something, and after classification the two behind each."""
    return sorted({first + n for first in groups for n in range(slots)})


def around(groups: dict[int, Group], first: int, last: int) -> Window:
    """The pixels that the splats reach whose first sheets are among `first` to `last`."""
    some = [groups[n].window for n in range(first, last + 1) if n in groups]
    if not some:
        return Window(0, 0, 0, 0)
    x, y = min(each.x for each in some), min(each.y for each in some)
    right, bottom = max(each.x + each.width for each in some), max(each.y + each.height for each in some)
    return Window(x, y, right - x, bottom - y)
