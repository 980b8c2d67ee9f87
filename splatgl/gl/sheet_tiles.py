"""Draws sheets in tiles: sorts splats by first sheet, adds them up per sheet and pixel, and composites the sheets."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import pairwise

import moderngl
import numpy as np

from splatgl.gl.buffers import (
    DrawOrder,
    Range,
    Rewritten,
    Texels,
    clear_buffer,
    free,
    grow_buffer,
    most_block,
    order_texture,
)
from splatgl.gl.card_lists import CardLists
from splatgl.gl.device import Device
from splatgl.gl.features import Uniforms, feature_uniforms
from splatgl.gl.meshes import FARTHEST_UNIT, NEAREST_UNIT, Limits
from splatgl.gl.near_sheets import NOTHING
from splatgl.gl.program import set_uniforms
from splatgl.gl.shader import CONTINUED
from splatgl.gl.target import Portions, Target
from splatgl.gl.textures import CLASS_UNIT, HALF_LINE_UNIT, class_uniforms
from splatgl.gl.tiles import GROUPS, LIST_UNIT, LISTS, MOST_TILES, OPEN, Band, Tiles, bands_of
from splatgl.gl.uniforms import base_of
from splatgl.splat.bricks import IsVisible, Shell
from splatgl.splat.culling import Frustum, Window, blocks_in_frustum, screen_bounds, tiles_beside_box
from splatgl.splat.grid import corners_of
from splatgl.splat.plan import Plan
from splatgl.splat.sheets import NearField, index_direction
from splatgl.splat.splats import Splats
from splatgl.splat.technique import COLUMNS, ROWS, batch_starts
from splatgl.splat.view import GridView

# image units of the classification table and of the list; binding of the open sheets, and mark of a list whose tile has
# stored ones
CLASS_IMAGE, LIST_IMAGE, RINGS, CONTINUES = 3, 4, 5, np.uint32(2)
# floats per pixel of the open sheets, see open_sheets.glsl; bytes of a tile, a multiple of every device's alignment
RING = 36
RING_BYTES = RING * ROWS * COLUMNS * 4
# maximum list entries of a tile per dispatch: with the sheets between them, loop iterations stay below 65535
MOST_ENTRIES = 30_000
# voxels beyond a clip plane that may contribute to the side it keeps: reach of a kernel and of the sheets
AROUND_CUT = 6
# maximum pixels per band: between several dispatches, open sheets take 4 RING bytes per pixel
MOST_PIXELS = 2**20


@dataclass(frozen=True)
class Batches:
    """Batches of splats that are drawn while later ones are extracted.

    of: yields the batches of a band, nearest first; its argument tells whether a box of voxels may be visible there.
    bands: number of bands of rows, drawn one after another. shell: range of sheets that are drawn, see
    `Bricks.within`; None: all. near: voxels around the eye.
    """

    of: Callable[[IsVisible], Iterator[Splats]]
    bands: int = 1
    shell: Shell | None = None
    near: NearField | None = None


class SheetTiles(Tiles):
    """Draws sheets in tiles; reuses its buffers and textures between pictures."""

    # pixels of the view from one sample to the next
    stride = 1

    def __init__(self, device: Device) -> None:
        super().__init__(device)
        self.tables, self.order, self.batch = device.tables, SheetOrder(device), Rewritten(device.ctx)
        # near sheets, and whether the picture has any; mask of the band's tiles that were drawn
        self.near, self.is_near, self.begun = device.near, False, np.zeros(0, bool)
        self.uniforms = {}
        # depths between which matter is drawn; None: all
        self.limits: Limits | None = None
        # number of splats; whether the current splats are the last; mask of tiles whose open sheets are stored
        self.count, self.last = 0, False
        self.kept: np.ndarray | None = None

    def release(self) -> None:
        """Frees all buffers and textures; they are recreated on demand."""
        super().release()
        self.order.release()
        self.batch.release()

    def draw(self, target: Target, splats: Splats, plan: Plan, order: DrawOrder, portions: Portions) -> None:
        """Composites the sheets into `target`, nearest first; raises Interrupted if cancelled. order: unused."""
        self.exact, self.portions = self.limits is not None, portions
        self._draw_sorted(target, splats, plan, self._sorted(splats, plan))

    def _draw_sorted(self, target: Target, splats: Splats, plan: Plan, texels: Texels) -> None:
        for window in bands_of(plan.window, MOST_PIXELS):
            self._draw_window(target, splats, plan, texels, window)

    def _sorted(self, splats: Splats, plan: Plan, window: Window | None = None) -> Texels:
        """Returns splats that a window (or the picture) may show, by first sheet unless they are drawn in rounds; sets
        `uniforms` and `count`.
        """
        texels = self.splats.of(splats).texels(plan.program.look.attenuation == "fill", DrawOrder(None, True))
        assert plan.resolved.sheets is not None
        self._begin_picture(splats, plan, NearField.of(splats, plan.view, plan.resolved.sheets))
        if self.limits is not None:
            self.uniforms["depth_unit"] = self.limits.unit / splats.grid.mean_spacing
        if window is not None:
            self.uniforms["edges"] = window_edges(plan.view, Window(*(self.stride * side for side in window.box)))
        if self._in_rounds(plan):
            return texels
        texels, self.count = self._in_order(texels, len(splats), sheet_span(splats, plan), plan)
        return texels

    def _in_order(self, texels: Texels, count: int, number: int, plan: Plan) -> tuple[Texels, int]:
        """Returns `count` records by their first of `number` sheets, and how many of them may be visible."""
        if self.card is None:
            return self.order.sorted((count, number), plan, texels, self.uniforms, self.portions)
        order = self.card.sort_by_sheet(
            lambda name, switches: self._program(name, plan, dict(switches)), texels, count, number, self.uniforms
        )
        return Texels(texels.records, texels.rest, order), count

    def _begin_picture(self, splats: Splats, plan: Plan, near: NearField | None) -> None:
        """Sets `uniforms` and draws the near sheets."""
        self.uniforms = sheet_uniforms(splats, plan)
        self.uniforms |= self.near.draw(near, plan, float(str(self.uniforms["first_sheet"])))
        self.is_near = near is not None

    def _draw_window(self, target: Target, splats: Splats, plan: Plan, texels: Texels, window: Window) -> None:
        """Composites a window of the picture. texels: result of `_sorted`."""
        band = self._begin(splats, plan, window)
        if self._in_rounds(plan):
            self._draw_rounds(target, splats, plan, texels, band)
        else:
            for which in pairwise(batch_starts(self.count, plan.hiding.depth_batches)):
                self.gather(target, plan, texels, which, band)
        self._flush(target, plan)

    def _in_rounds(self, plan: Plan) -> bool:
        """Whether splats are sorted and drawn in rounds of sheets; a card sorts all at once."""
        return self.card is None and plan.hiding.depth_batches > 1

    def _draw_rounds(self, target: Target, splats: Splats, plan: Plan, texels: Texels, band: Band) -> None:
        """Composites a band's splats sheets by sheets, without clusters of which only closed tiles are left."""
        clusters, names = self.splats.of(splats).clusters()
        uniforms = self.uniforms | {"sheets": sheet_span(splats, plan)}
        for part in clusters.rounds(splats, plan, band.window, self._unlisted, band.stride):
            begin, end = part.sheets
            names.use(NAMES_UNIT)
            parts, in_round = clusters.parts(part.clusters), uniforms | {"begin": begin}
            numbers = len(splats), end - begin
            ordered, count = self.order.sorted(numbers, plan, texels, in_round, self.portions, parts)
            self.count = count if part.last else count + 1
            self.gather(target, plan, ordered, (0, count), band)

    def draw_batches(self, target: Target, whole: Splats, plan: Plan, batches: Batches, portions: Portions) -> None:
        """Composites batches of splats whose sheets do not lie before the sheets of earlier batches.

        whole: describes all splats.
        """
        self.exact, self.portions = True, portions
        self._begin_picture(whole, plan, batches.near)
        if batches.shell is not None:
            first = float(str(self.uniforms["first_sheet"]))
            self.uniforms |= {"shell": tuple(end - first for end in batches.shell), "partial": True}
        (window,) = bands_of(plan.window, sys.maxsize)
        rows = -(-window.height // ROWS)
        for part in bands_of(window, -(-rows // batches.bands) * ROWS * window.width):
            self._draw_band(target, whole, plan, batches, part)

    def least_bands(self, window: Window) -> int:
        """Returns the number of bands into which batches of splats must be drawn: a dispatch takes MOST_TILES tiles."""
        across, down = -(-window.width // COLUMNS) + 1, -(-window.height // ROWS) + 1
        return 1 if self.card is None else -(-down // max(MOST_TILES // across, 1))

    def _draw_band(self, target: Target, whole: Splats, plan: Plan, batches: Batches, window: Window) -> None:
        band = self._begin(whole, plan, window)
        across = -(-window.width // COLUMNS)

        def is_visible(low: np.ndarray, high: np.ndarray) -> bool:
            if not may_show(low, high, plan):
                return False
            x, y, width, height = screen_bounds(corners_of(low, high), plan.view).window.box
            x, y = x - window.x, y - window.y
            tiles = band.closed.reshape(-1, across)
            rows = slice(max(y, 0) // ROWS, max(-(-(y + height) // ROWS), 0))
            return not tiles[rows, max(x, 0) // COLUMNS : max(-(-(x + width) // COLUMNS), 0)].all()

        span = sheet_span(whole, plan)
        for splats in batches.of(is_visible):
            texels = self.batch.texels(splats.records)
            texels, count = self._in_order(texels, len(splats), span, plan)
            self.count = count + 1
            self.gather(target, plan, texels, (0, count), band)
        self._flush(target, plan)

    def show(self, target: Target, whole: Splats, plan: Plan) -> None:
        """Classifies the values of a target that holds the joined parts of a picture."""
        self.portions = Portions(self.ctx)
        self._begin_picture(whole, plan, None)
        for window in bands_of(plan.window, MOST_PIXELS):
            self._begin(whole, plan, window)
            # no splats are left; each tile only has to classify its values
            clear_buffer(self._keep())
            if self.card is not None:
                self.card.begin(self.band.closed, CONTINUED)
                self.band.begun = True
            self.kept = np.ones(self.band.closed.size, bool)
            self._flush(target, plan)

    def _begin(self, splats: Splats, plan: Plan, window: Window) -> Band:
        """Returns a new band, whose tiles beside the volume's box are closed."""
        self.kept, self.last, self.band = None, False, replace(self.begin(window), stride=self.stride)
        band, self.begun = self.band, np.zeros(self.band.closed.size, bool)
        if splats.post is not None:
            table = self.tables.classification(splats)
            table.use(CLASS_UNIT)
            table.bind_to_image(CLASS_IMAGE, read=True, write=False)
            seen = Window(*(self.stride * side for side in window.box))
            side = self.stride * COLUMNS, self.stride * ROWS
            band.closed |= tiles_beside_box(plan.view, splats.post.shape, seen, side)
        return band

    def _draw(self, target: Target, plan: Plan, texels: Texels, which: Range) -> None:
        self.last = which[1] == self.count
        super()._draw(target, plan, texels, which)

    def _flush(self, target: Target, plan: Plan) -> None:
        """Composites the sheets that are still open, and the near sheets of tiles without splats."""
        if self.card is not None:
            if not self.last:
                if not self.band.begun:
                    self.card.begin(self.band.closed)
                self.card.bind_empty()
                self.last = True
                self._composite(self.card, target, plan, last=True)
            return
        self.last = True
        waiting = np.zeros_like(self.begun) if self.kept is None else self.kept.copy()
        if self.is_near:
            waiting |= ~(self.begun | self.band.closed)
        indices = np.flatnonzero(waiting)
        if len(indices):
            lists = np.stack([indices, *np.zeros((3, len(indices)), np.int64)], axis=1).astype(np.uint32)
            # a band of batches may exceed the tiles of a dispatch
            self._add_up_parts(target, plan, lists)

    def _add_up(self, target: Target, plan: Plan, lists: np.ndarray) -> None:
        if self.placed.list is not None:
            self.placed.list.use(LIST_UNIT)
            self.placed.list.bind_to_image(LIST_IMAGE, read=True, write=False)
        self.begun[lists[:, 0]] = True
        self.bind_target(target)
        while len(lists):
            part = lists.copy()
            part[:, 2] = np.minimum(lists[:, 2], lists[:, 1] + MOST_ENTRIES)
            part[:, 3] = self.last & (part[:, 2] == lists[:, 2])
            complete = part[:, 3] > 0
            if not complete.all() and self.kept is None:
                self._keep()
            if self.kept is not None:
                part[:, 3] |= CONTINUES * self.kept[part[:, 0]].astype(np.uint32)
            program = self._program("sheet_draw.comp", plan, {"CARRIED": self.kept is not None})
            set_uniforms(program, half_table=HALF_LINE_UNIT, list=LIST_UNIT, opaque=1.0 - plan.hiding.cutoff)
            self._buffer(LISTS, part.nbytes).write(part)
            flags = self._buffer(OPEN, self.band.closed.size * 4)
            clear_buffer(flags)
            program.run(len(part))
            self.ctx.memory_barrier()
            open_ = np.frombuffer(flags.read(self.band.closed.size * 4), np.uint32)[part[:, 0]] > 0
            self.band.closed[part[~open_, 0]] = True
            if self.kept is not None:
                self.kept[part[:, 0]] = open_ & ~complete
            lists[:, 1] = part[:, 2]
            lists = lists[~complete & open_ & (lists[:, 1] < lists[:, 2])]

    def _composite(self, card: CardLists, target: Target, plan: Plan, last: bool) -> None:
        complete = self.last and last
        carried = self.band.begun or not complete
        tiles = self.band.closed.size
        rings = self._buffer(RINGS, tiles * RING_BYTES) if carried else None
        program = self._program("sheet_draw.comp", plan, {"CARRIED": carried})
        set_uniforms(program, half_table=HALF_LINE_UNIT, opaque=1.0 - plan.hiding.cutoff, complete=complete)
        self.bind_target(target)
        # so many tiles at a time that a block holds their open sheets
        most = max(most_block(self.ctx) // RING_BYTES, 1) if carried else tiles
        for first in range(0, tiles, most):
            part = min(most, tiles - first)
            if rings is not None:
                rings.bind_to_storage_buffer(RINGS, offset=first * RING_BYTES, size=part * RING_BYTES)
            set_uniforms(program, first_tile=first)
            program.run(part)
        self.ctx.memory_barrier()
        self.band.begun = True

    def _keep(self) -> moderngl.Buffer:
        """Returns storage for the open sheets of all tiles, none of which are stored yet."""
        self.kept = np.zeros(self.band.closed.size, bool)
        return self._buffer(RINGS, self.kept.size * RING_BYTES)

    def _program(self, name: str, plan: Plan, switches: dict[str, bool]) -> moderngl.ComputeShader:
        limited = self.limits is not None and name == "sheet_draw.comp"
        features = {"LIMITED": limited, "NEAR": self.is_near} if name == "sheet_draw.comp" else {}
        program = super()._program(name, plan, {**switches, **{switch: True for switch, on in features.items() if on}})
        if self.limits is not None:
            set_uniforms(program, nearest_depth=NEAREST_UNIT, farthest_depth=FARTHEST_UNIT)
            self.limits.use()
        return program


class BoxTiles(Tiles):
    """Draws boxes in tiles; reuses its buffers and textures between pictures."""

    drawing = "box_draw.comp"
    # depths between which boxes are drawn; None: all. For one of several layers: sets up a program to store the matter
    limits: Limits | None = None
    keeping: Callable[[moderngl.ComputeShader], None] | None = None

    def _uniforms(self, splats: Splats, plan: Plan) -> Uniforms:
        uniforms = super()._uniforms(splats, plan)
        self.exact = self.limits is not None or self.keeping is not None
        if self.limits is None:
            return uniforms
        self.limits.use()
        units = {"nearest_depth": NEAREST_UNIT, "farthest_depth": FARTHEST_UNIT}
        return uniforms | units | {"depth_unit": self.limits.unit / splats.grid.mean_spacing}

    def _program(self, name: str, plan: Plan, switches: dict[str, bool]) -> moderngl.ComputeShader:
        if name != self.drawing:
            return super()._program(name, plan, switches)
        features = {"LIMITED": self.limits is not None, "LAYERED": self.keeping is not None}
        program = super()._program(name, plan, {**switches, **features})
        if self.keeping is not None:
            self.keeping(program)
        return program


# maximum splats of a run (llvmpipe ends a loop after 65535 iterations); minimum runs, for all cores and lanes
MOST_RUN, LEAST_RUNS = 60_000, 64
# texture units of the records and of clusters; buffer bindings of the cursors, and of parts and runs of a round; image
# unit of the order
RECORDS_UNIT, NAMES_UNIT, CURSORS, PARTS, RUNS, IMAGE = 5, 6, 0, 2, 3, 0

# range of sheets without ends
EVERYWHERE = (-1e9, 1e9)


def sheet_uniforms(splats: Splats, plan: Plan) -> Uniforms:
    """Returns the uniforms of sheets.glsl, sheet_composite.glsl and the plan's features."""
    sheets, view, post = plan.resolved.sheets, plan.view, splats.post
    assert sheets is not None
    uniforms: Uniforms = {
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
        uniforms |= class_uniforms(post)
        uniforms |= {
            "box_low": tuple(-0.5 - view.eye_index),
            "box_high": tuple(np.array(post.shape) - 0.5 - view.eye_index),
            "window_share": (*post.window_share, plan.resolved.mip_attenuation),
        }
    return uniforms | feature_uniforms(splats, plan)


def window_edges(view: GridView, window: Window) -> tuple[float, ...]:
    """Returns the left, upper, right and lower edge of a window of samples, as slopes or lengths in mean spacings."""
    x, y, width, height = window.box
    ends = np.array([[x, y], [x + width, y + height]]) - np.array(view.size) / 2
    return tuple((ends * view.pitch).ravel().tolist())


def may_show(low: np.ndarray, high: np.ndarray, plan: Plan) -> bool:
    """Whether a part of a box of voxels, from low to high (x, y, z), is in the picture and kept by clip planes."""
    clip = plan.resolved.clip
    if clip is not None and not clip.meets(low - AROUND_CUT, high + AROUND_CUT):
        return False
    return bool(blocks_in_frustum(np.concatenate([low + high, high - low])[None] / 2, Frustum.of(plan.view))[0])


def sheet_span(splats: Splats, plan: Plan) -> int:
    """Returns the number of sheets that may be a splat's first sheet."""
    assert plan.resolved.sheets is not None
    first, last = plan.resolved.sheets.range(splats, plan.view)
    return last - first + 1


class SheetOrder:
    """Sorts splats by first sheet; reuses its buffer and texture between pictures, and enlarges them on demand."""

    def __init__(self, device: Device) -> None:
        self.ctx, self.programs = device.ctx, device.programs
        self.buffers: dict[int, moderngl.Buffer] = {}
        self.order: moderngl.Texture | None = None

    def release(self) -> None:
        """Frees the buffers and the texture; they are recreated on demand."""
        free(*self.buffers.values(), self.order)
        self.buffers, self.order = {}, None

    def sorted(
        self,
        numbers: tuple[int, int],
        plan: Plan,
        texels: Texels,
        uniforms: Uniforms,
        portions: Portions,
        parts: np.ndarray | None = None,
    ) -> tuple[Texels, int]:
        """Returns the records with their order by first sheet, and the number of records that may be visible.

        numbers: of splats and of sheets. parts: parts of clusters to sort, see `Clusters.parts`; None: sorts all
        splats.
        """
        (count, number), lanes = numbers, self.programs.shape.lanes
        if parts is not None:
            lengths = np.cumsum(parts[:, 1] - parts[:, 0], dtype=np.int64)
            count = int(lengths[-1]) if len(lengths) else 0
        runs = max(LEAST_RUNS, -(-count // (MOST_RUN * lanes)) * lanes)
        if parts is not None:
            ends = np.searchsorted(lengths, count * np.arange(1, runs) / runs)
            self._buffer(RUNS, (runs + 1) * 4).write(np.array([0, *ends, len(parts)], np.uint32))
            self._buffer(PARTS, max(parts.nbytes, 16)).write(parts)
        values = {"sheets": number, "begin": 0, **uniforms, "records": RECORDS_UNIT, "clustered": NAMES_UNIT}
        values |= {"number": number, "count": count, "length_": -(-count // runs)}
        size = runs * (number + 1) * 4
        cursors = self._buffer(CURSORS, size)
        clear_buffer(cursors, size)
        texels.records.use(RECORDS_UNIT)
        switches = {"CLUSTERED": parts is not None}
        self._run(plan, {**switches, "COUNTING": True}, values, runs, portions)
        counts = np.frombuffer(cursors.read(size), np.uint32).reshape(runs, number + 1)[:, :number]
        # ordered by sheet, then by run
        until = np.cumsum(counts.T, dtype=np.uint32).reshape(number, runs)
        starts = np.zeros((runs, number + 1), np.uint32)
        starts[:, :number] = (until - counts.T).T
        cursors.write(starts)
        order = self.order = order_texture(self.ctx, self.order, count)
        order.bind_to_image(IMAGE, read=False, write=True)
        self._run(plan, {**switches, "COUNTING": False}, values, runs, portions)
        return Texels(texels.records, texels.rest, order), int(until[-1, -1])

    def _run(self, plan: Plan, switches: dict[str, bool], values: Uniforms, runs: int, portions: Portions) -> None:
        program, lanes = self.programs.for_tiles("sheet_sort.comp", plan.program, switches), self.programs.shape.lanes
        # for all cores
        ends = range(GROUPS, runs // lanes + GROUPS, GROUPS)
        for begin, end in portions.parts("sorting", range(1, len(ends) + 1), len(ends)):
            first = begin * GROUPS
            set_uniforms(program, first_run=first * lanes, **values)
            program.run(min(end * GROUPS, runs // lanes) - first)
            self.ctx.memory_barrier()

    def _buffer(self, binding: int, size: int) -> moderngl.Buffer:
        """Returns a storage buffer of at least `size` bytes, and binds it."""
        storage = grow_buffer(self.ctx, self.buffers, binding, size)
        storage.bind_to_storage_buffer(binding)
        return storage
