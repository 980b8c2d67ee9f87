"""Draws splats as textured quads: one by one, blended in drawing order, or added up to sheets.  [M98 §3.5]

Splats are sorted by their first sheet. A splat is drawn once, into the textures of all sheets that it contributes to.
When a sheet is complete, a pass over its pixels composites it, and its textures are cleared for the next sheet. Blends
of one value collect the values of all sheets in a separate texture, which the last pass classifies.
"""

from __future__ import annotations

import functools
import weakref
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import chain
from typing import NamedTuple

import moderngl
import numpy as np

from splatgl.errors import expected
from splatgl.geometry.grid import corners_of
from splatgl.geometry.view import GridView
from splatgl.gl.buffers import (
    DrawOrder,
    InstanceBuffer,
    Range,
    SortedRecords,
    chunks,
    free,
    texel_texture,
    uneven,
)
from splatgl.gl.device import Device
from splatgl.gl.features import Uniforms, feature_uniforms, frame_block
from splatgl.gl.meshes import DepthLimits
from splatgl.gl.program import EXTREMES, cover, set_uniforms, use_blend
from splatgl.gl.sheet_tiles import SplatBatches, may_show, sheet_uniforms
from splatgl.gl.target import Portions, RenderTarget, settle
from splatgl.gl.textures import BLUR_UNIT, CLASS_UNIT, HALF_LINE_UNIT
from splatgl.gl.tiles import bands_of
from splatgl.planning.clusters import touched_tiles
from splatgl.planning.culling import PixelWindow, screen_bounds
from splatgl.planning.plan import Plan
from splatgl.splat.sheets import NearField, Sheets, index_direction
from splatgl.splat.splats import MOST_KEPT, Splats

CORNERS = 4


class Quads:
    """Draws splats as instanced quads, which cover motion streaks; needs only OpenGL 3.3 and supports every plan. Keeps
    the latest splats that flow.
    """

    def __init__(self, device: Device) -> None:
        self.ctx, self.programs, self.splats = device.ctx, device.programs, device.splats
        self.flowing: SortedRecords | None = None

    def draw(
        self,
        target: RenderTarget,
        splats: Splats,
        plan: Plan,
        order: DrawOrder,
        portions: Portions,
        limits: DepthLimits | None = None,
    ) -> None:
        """Blends the splats into `target` in drawing order, chunk by chunk; raises Interrupted if cancelled."""
        program = self.programs.for_splats(plan.program, {"LIMITED": True} if limits is not None else {})
        if limits is not None:
            limits.use_in(program, splats.grid.mean_spacing)
        set_uniforms(program, half_table=HALF_LINE_UNIT, blur_table=BLUR_UNIT, **feature_uniforms(splats, plan))
        use_blend(self.ctx, plan.program.appearance.join, order.nearest_first)
        target.framebuffer.use()
        for chunk in chunks((0, len(splats))):
            quads = self._instances(splats, plan, order, chunk)
            for begin, end in portions.over(*chunk):
                vertices = quads.vertices(program, begin - chunk[0])
                vertices.render(moderngl.TRIANGLE_STRIP, vertices=CORNERS, instances=end - begin)

    def release(self) -> None:
        """Frees the instances of splats that flow."""
        free(self.flowing)
        self.flowing = None

    def _instances(self, splats: Splats, plan: Plan, order: DrawOrder, which: Range) -> InstanceBuffer:
        """Returns the instances of splats `which` of the drawing order."""
        if not plan.program.flow:
            return self.splats.of(splats).quads(plan.program.runs, order, which)
        assert plan.exposure is not None
        if len(splats) > MOST_KEPT:
            raise expected("splats", f"at most {MOST_KEPT:,} that flow", f"{len(splats):,}", "raise the threshold")
        if self.flowing is None or not self.flowing.flows(splats, plan.exposure):
            self.release()
            self.flowing = SortedRecords(self.ctx, splats, plan.exposure)
        self.flowing.write(order, plan.program.runs, which)
        return self.flowing.instances


# texture units of a sheet and the two sheets before it, and of the joined values
UNITS = {
    **{"sheet_sums": 4, "sheet_masses": 5, "sums_before": 6, "masses_before": 7},
    **{"sums_earlier": 8, "masses_earlier": 9},
}
JOINED_UNIT, JOINED_BEFORE_UNIT = 10, 11
# less than any value and any −value
LEAST = -float(np.finfo(np.float32).max)


# a sheet beyond all others
FAR = 2**30
# maximum pixels of a band of the picture: open sheets take up to 120 bytes per pixel
MOST_PIXELS = 2**22


class SheetGroup(NamedTuple):
    """Splats with the same first sheet, from begin to end (exclusive). window: pixels that they reach."""

    begin: int
    end: int
    window: PixelWindow


class RingFormat(NamedTuple):
    """Properties that determine a ring's textures. size: pixels of the picture. rows: of a band. sheets: sheets per
    splat. post: whether values are classified after reconstruction.
    """

    size: tuple[int, int]
    rows: int
    sheets: int
    post: bool


@dataclass(frozen=True, eq=False)
class SheetPicture:
    """Splats that are drawn in sheets, with the uniforms of their programs. field: near sheets. limits: depths between
    which the volume is drawn; None: all.
    """

    splats: Splats
    plan: Plan
    uniforms: Uniforms
    field: NearField | None
    limits: DepthLimits | None = None

    @property
    def first(self) -> int:
        """Number of the first sheet, counted from the eye; the shaders count from it."""
        return int(float(str(self.uniforms["first_sheet"])))

    @property
    def near(self) -> range:
        """The near sheets, and the two sheets behind them that their kernels reach."""
        return range(0) if self.field is None else range(-self.first - 1, self.field.count - self.first + 2)


class SheetQuads:
    """Draws sheets by quads; reuses its textures and buffer between pictures."""

    def __init__(self, device: Device) -> None:
        self.ctx, self.programs, self.tables = device.ctx, device.programs, device.tables
        self.near, self.frame = device.near, device.frame
        self.instances = InstanceBuffer(device.ctx)
        # the latest records, where their sheets are, and their order
        self.filled: tuple[weakref.ref[np.ndarray], tuple[object, ...], SheetGroups] | None = None
        self.ring: Ring | None = None
        # joined values of blends of one value; of an attenuated maximum also those before the sheet that is closed
        self.joined: JoinedValues | None = None
        self.joined_before: JoinedValues | None = None

    def release(self) -> None:
        """Frees the textures and the buffer; they are recreated on demand."""
        free(self.instances, self.ring, self.joined, self.joined_before)
        self.filled, self.ring, self.joined, self.joined_before = None, None, None, None

    def draw(
        self,
        target: RenderTarget,
        splats: Splats,
        plan: Plan,
        order: DrawOrder,
        portions: Portions,
        limits: DepthLimits | None = None,
    ) -> None:
        """Composites the sheets into `target`, nearest first; raises Interrupted if cancelled. order: unused."""
        assert plan.resolved.sheets is not None
        picture = self.begin(splats, plan, NearField.of(splats, plan.view, plan.resolved.sheets), limits)
        groups = self.fill(picture, splats)
        for band in bands_of(PixelWindow(0, 0, *plan.view.size), MOST_PIXELS):
            self._draw_band(target, picture, band, [groups], portions)
        if plan.program.appearance.shows_value:
            self.show(target, splats, plan)

    def draw_batches(
        self, target: RenderTarget, whole: Splats, plan: Plan, batches: SplatBatches, portions: Portions
    ) -> None:
        """Composites batches of splats whose sheets do not lie before the sheets of earlier batches.

        whole: describes all splats.
        """
        picture, shell = self.begin(whole, plan, batches.near), batches.shell
        if shell is not None:
            picture.uniforms["shell"] = tuple(end - picture.first for end in shell)
        width, height = plan.view.size
        rows = min(-(-height // batches.bands), max(MOST_PIXELS // width, 1))
        for top in range(0, height, rows):
            band = PixelWindow(0, top, width, min(rows, height - top))
            visible = functools.partial(is_visible, plan=plan, band=band)
            groups = (self.fill(picture, splats) for splats in batches.of(visible) if len(splats))
            self._draw_band(target, picture, band, groups, portions)
        if plan.program.appearance.shows_value:
            self.show(target, whole, plan, partial=shell is not None)

    def begin(
        self, splats: Splats, plan: Plan, field: NearField | None, limits: DepthLimits | None = None
    ) -> SheetPicture:
        """Returns a picture whose sheets are drawn. field: voxels around the eye."""
        return SheetPicture(splats, plan, sheet_uniforms(splats, plan), field, limits)

    def fill(self, picture: SheetPicture, splats: Splats) -> dict[int, SheetGroup]:
        """Uploads splats of a picture, by first sheet, unless the latest ones are the same, seen from the same eye;
        returns their groups by first sheet, ascending.
        """
        sheets, view = picture.plan.resolved.sheets, picture.plan.view
        assert sheets is not None
        records = splats.records_with_runs if picture.plan.program.runs else splats.records
        rays = () if view.perspective else tuple(index_direction(view))
        eye = sheets, picture.first, tuple(view.eye_index), rays
        if self.filled is None or self.filled[0]() is not records or self.filled[1] != eye:
            indices, order = sort_by_number(first_sheets(splats, sheets, view, picture.first), splats.positions)
            self.instances.fill(records[indices])
            self.filled = weakref.ref(records), eye, order
        return self.filled[2].groups(view)

    def bind(self, picture: SheetPicture, band: PixelWindow, corner: tuple[int, int], piece: bool = False) -> None:
        """Sets up the programs for a band. corner: the target's place of the band's first pixel. piece: whether parts
        of sheets are kept, instead of composited.
        """
        splats, plan = picture.splats, picture.plan
        block = frame_block(splats, plan)
        if picture.field is not None:
            self.frame.write(block.tobytes())
        uniforms = picture.uniforms | self.near.draw(picture.field, plan, float(picture.first))
        features = {"NEAR": picture.field is not None, "LIMITED": picture.limits is not None, "PIECE": piece}
        self.adding = self.programs.for_splats(plan.program)
        self.closing = self.programs.for_screen("sheet_close.frag", plan.program, features)
        for program in (self.adding, self.closing):
            set_uniforms(program, half_table=HALF_LINE_UNIT, **UNITS, **uniforms)
        set_uniforms(self.closing, corner=corner, near_top=float(band.y))
        if picture.limits is not None:
            set_uniforms(self.closing, depth_top=band.y)
            picture.limits.use_in(self.closing, splats.grid.mean_spacing)
        if splats.post is not None:
            self.tables.classification(splats).use(CLASS_UNIT)
        block["image_center"][1] -= band.y
        self.frame.write(block.tobytes())

    def sweep(
        self, picture: SheetPicture, band: PixelWindow, batches: Iterable[dict[int, SheetGroup]], portions: Portions
    ) -> Iterator[tuple[int, PixelWindow]]:
        """Adds the splats of batches to their sheets. Yields each sheet once it is complete, nearest first, and the
        window in which it may hold matter.
        """
        appearance, near = picture.plan.program.appearance, picture.near
        x, _, width, _ = picture.plan.window.box
        ring = self._ring(RingFormat(picture.plan.view.size, band.height, appearance.sheets, appearance.steps > 0))
        ring.begin(band, band if near else PixelWindow(x, band.y, width, band.height))
        first_base = near.stop - 1 - appearance.sheets if near else -FAR
        reached: dict[int, SheetGroup] = {}
        waiting = set(near)
        for groups in chain(batches, [None]):
            last = FAR
            if groups is not None:
                last = max(groups, default=-FAR)
                groups = within({base: group for base, group in groups.items() if base >= first_base}, band)
                reached |= groups
                waiting.update(first + n for first in groups for n in range(ring.slots))
            for sheet in sorted(n for n in waiting if n <= last):
                portions.ask()
                if groups and sheet in groups:
                    self._add(ring, sheet, groups[sheet], portions)
                yield sheet, band if sheet in near else around(reached, sheet - ring.slots + 1, sheet)
                done = sheet - (ring.slots - ring.count)
                ring.clear(done, around(reached, done - ring.count + 1, done))
            waiting = {n for n in waiting if n > last}

    def _draw_band(
        self,
        target: RenderTarget,
        picture: SheetPicture,
        band: PixelWindow,
        batches: Iterable[dict[int, SheetGroup]],
        portions: Portions,
    ) -> None:
        appearance, into = picture.plan.program.appearance, target.framebuffer
        self.bind(picture, band, (0, band.y))
        if appearance.shows_value:
            into = self.joined_target(target.size).framebuffer
            into.clear(LEAST if appearance.join in EXTREMES else 0.0, viewport=band.box)
        before = self._begin_before(target.size) if appearance.join == "attenuated" else None
        try:
            for sheet, window in self.sweep(picture, band, batches, portions):
                into.scissor = window.box
                self.close(into, sheet, appearance.join)
                if before is not None:
                    # within the scissor
                    self.ctx.copy_framebuffer(before, into)
        finally:
            into.scissor = None  # type: ignore[assignment]

    def _add(self, ring: Ring, sheet: int, group: SheetGroup, portions: Portions) -> None:
        """Blends a group of splats into its sheets."""
        set_uniforms(self.adding, sheet=sheet)
        use_blend(self.ctx, "sum")
        ring.open[sheet % ring.slots].use()
        for begin, end in portions.over(group.begin, group.end):
            vertices = self.instances.vertices(self.adding, begin)
            vertices.render(moderngl.TRIANGLE_STRIP, vertices=CORNERS, instances=end - begin)

    def close(self, into: moderngl.Framebuffer, sheet: int, join: str | None) -> None:
        """Composites a sheet; with later classification, the matter around the sheet before it. join: None: writes."""
        assert self.ring is not None
        set_uniforms(self.closing, sheet=sheet)
        self.ring.use(sheet)
        into.use()
        if join is None:
            self.ctx.enable_only(moderngl.NOTHING)
        else:
            use_blend(self.ctx, join)
        cover(self.closing)

    def show(self, target: RenderTarget, splats: Splats, plan: Plan, partial: bool = False) -> None:
        """Classifies the joined value of each pixel. partial: keeps the values of a part."""
        program = self.programs.for_screen("sheet_show.frag", plan.program)
        set_uniforms(program, joined_values=JOINED_UNIT, **(sheet_uniforms(splats, plan) | {"partial": partial}))
        if splats.post is not None:
            self.tables.classification(splats).use(CLASS_UNIT)
        assert self.joined is not None
        self.joined.texture.use(JOINED_UNIT)
        target.framebuffer.use()
        self.ctx.enable_only(moderngl.NOTHING)
        cover(program)

    def show_samples(self, target: RenderTarget, splats: Splats, plan: Plan, samples: np.ndarray) -> None:
        """Classifies the joined values of the parts of a picture, [H, W, 4]."""
        values = np.array(samples, np.float32)
        if plan.program.appearance.join == "min":
            # as blending by the maximum keeps them
            values[..., 0] *= -1.0
        self.joined_target(target.size).texture.write(values, (0, 0, *target.size), alignment=4)
        self.show(target, splats, plan)

    def joined_target(self, size: tuple[int, int]) -> JoinedValues:
        """Returns the target of the picture's joined values, for blends of one value."""
        self.joined = self._values_of(self.joined, size)
        return self.joined

    def _values_of(self, old: JoinedValues | None, size: tuple[int, int]) -> JoinedValues:
        """Returns values of that size: the old ones, or new ones in place of them."""
        if old is not None and old.size == size:
            return old
        new = JoinedValues(self.ctx, size)
        free(old)
        return new

    def _begin_before(self, size: tuple[int, int]) -> moderngl.Framebuffer:
        """Returns the cleared target of what was joined before the sheet that is closed, and binds its texture."""
        self.joined_before = self._values_of(self.joined_before, size)
        self.joined_before.framebuffer.clear()
        self.joined_before.texture.use(JOINED_BEFORE_UNIT)
        set_uniforms(self.closing, joined_before=JOINED_BEFORE_UNIT)
        return self.joined_before.framebuffer

    def _ring(self, kind: RingFormat) -> Ring:
        """Returns textures for the open sheets, which may have more rows."""
        ring = self.ring
        if ring is None or ring.kind._replace(rows=kind.rows) != kind or ring.kind.rows < kind.rows:
            old, self.ring = ring, Ring(self.ctx, kind)
            free(old)
        assert self.ring is not None
        return self.ring


class JoinedValues:
    """Texture of the joined values of a picture of a size, as optics.glsl has them, and its framebuffer."""

    def __init__(self, ctx: moderngl.Context, size: tuple[int, int]) -> None:
        self.size = size
        self.texture = texel_texture(ctx, (uneven(size[0]), uneven(size[1])), 4, "f4")
        self.framebuffer = ctx.framebuffer([self.texture])
        self.framebuffer.viewport = (0, 0, *size)

    def release(self) -> None:
        """Frees both."""
        free(self.framebuffer, self.texture)


class Ring:
    """Ring of textures of a band's open sheets; with later classification, also of two earlier sheets."""

    def __init__(self, ctx: moderngl.Context, kind: RingFormat) -> None:
        self.ctx, self.kind, self.count, self.slots, self.top = ctx, kind, kind.sheets, kind.sheets + 2 * kind.post, 0
        size = uneven(kind.size[0]), uneven(kind.rows)
        self.sums = [texel_texture(ctx, size, 4, "f4") for _ in range(self.slots)]
        self.masses = [texel_texture(ctx, size, 1, "f4") for _ in range(self.slots * kind.post)]
        # framebuffers of all open sheets from a slot on, and of a single slot
        self.open = [ctx.framebuffer(self._attachments(n, self.count)) for n in range(self.slots)]
        self.each = [ctx.framebuffer(self._attachments(n, 1)) for n in range(self.slots)]

    def begin(self, band: PixelWindow, window: PixelWindow) -> None:
        """Starts a band of the picture; clears all sheets within a window of it."""
        self.top = band.y
        for slot, framebuffer in enumerate(self.open):
            framebuffer.viewport = (0, -band.y, *self.kind.size)
            self.clear(slot, window)

    def clear(self, sheet: int, window: PixelWindow) -> None:
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
        free(*self.open, *self.each, *self.sums, *self.masses)

    def _attachments(self, first: int, count: int) -> list[moderngl.Texture | moderngl.Renderbuffer]:
        slots = [(first + n) % self.slots for n in range(count)]
        return [textures[n] for textures in (self.sums, self.masses) if textures for n in slots]


def first_sheets(splats: Splats, sheets: Sheets, view: GridView, first: int) -> np.ndarray:
    """Returns the first sheet of each splat, counted from `first`: int16 [N], which holds up to MOST_SHEETS and which
    numpy sorts by radix.
    """
    return (sheets.base(sheets.places(view, splats.positions)) - first).astype(np.int16)


class SheetGroups(NamedTuple):
    """Groups of splats of equal number: the numbers, ascending; the first splat of each, and the end; boxes around each
    group's positions, low [G, 3] and high.
    """

    numbers: list[int]
    ends: list[int]
    low: np.ndarray
    high: np.ndarray

    def groups(self, view: GridView) -> dict[int, SheetGroup]:
        """Returns the groups by number, with the windows that they reach."""
        boxes = zip(self.low, self.high, strict=True)
        windows = [screen_bounds(corners_of(*box), view).window for box in boxes]
        groups = map(SheetGroup, self.ends, self.ends[1:], windows)
        return dict(zip(self.numbers, groups, strict=True))


def sort_by_number(numbers: np.ndarray, positions: np.ndarray) -> tuple[np.ndarray, SheetGroups]:
    """Returns indices that sort splats at grid positions [N, 3] by their numbers [N], and their order."""
    indices = np.argsort(numbers, kind="stable")
    unique, begins = np.unique(numbers[indices], return_index=True)
    in_order = positions[indices]
    low, high = (reach.reduceat(in_order, begins).astype(np.float64) for reach in (np.minimum, np.maximum))
    return indices, SheetGroups(unique.tolist(), [*begins.tolist(), len(numbers)], low, high)


def within(groups: dict[int, SheetGroup], band: PixelWindow) -> dict[int, SheetGroup]:
    """Returns the groups that reach into a band of rows, with their windows clipped to it."""
    clipped = {}
    for sheet, (begin, end, window) in groups.items():
        top, bottom = max(window.y, band.y), min(window.y + window.height, band.y + band.height)
        if top < bottom:
            clipped[sheet] = SheetGroup(begin, end, PixelWindow(window.x, top, window.width, bottom - top))
    return clipped


def around(groups: dict[int, SheetGroup], first: int, last: int) -> PixelWindow:
    """Returns the window of the groups whose first sheets are in first…last, inclusive; empty without groups."""
    windows = [groups[n].window for n in range(first, last + 1) if n in groups]
    if not windows:
        return PixelWindow(0, 0, 0, 0)
    x, y = min(w.x for w in windows), min(w.y for w in windows)
    right, bottom = max(w.x + w.width for w in windows), max(w.y + w.height for w in windows)
    return PixelWindow(x, y, right - x, bottom - y)


def is_visible(low: np.ndarray, high: np.ndarray, plan: Plan, band: PixelWindow) -> np.ndarray:
    """bool [N]: whether boxes of voxels, from low to high [N, 3] (x, y, z), may be visible in a band of the picture."""
    x, y, right, lower = touched_tiles(low.T, high.T, plan.view, band)
    return may_show(low, high, plan) & (x < right) & (y < lower)
