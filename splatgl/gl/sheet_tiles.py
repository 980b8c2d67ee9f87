"""Draws sheets in tiles: sorts splats by first sheet, adds them up per sheet and pixel, and composites the sheets."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from typing import Any

import moderngl
import numpy as np

from splatgl.geometry.view import GridView
from splatgl.gl.buffers import (
    Buffers,
    DrawOrder,
    ReusedTextures,
    SplatTexels,
    clear_buffer,
    free,
    most_block,
    order_texture,
)
from splatgl.gl.card_lists import CardLists
from splatgl.gl.device import Device
from splatgl.gl.features import Uniforms, base_of, feature_uniforms
from splatgl.gl.program import set_uniforms
from splatgl.gl.shader import CONTINUED
from splatgl.gl.target import Portions, RenderTarget
from splatgl.gl.textures import CLASS_UNIT, HALF_LINE_UNIT, NO_NEAR_SHEETS, class_uniforms
from splatgl.gl.tiles import (
    GROUPS,
    LIST_UNIT,
    LISTS,
    MOST_TILES,
    OPEN,
    ProjectedSplats,
    Spec,
    TileBand,
    Tiles,
    bands_of,
    tile_counts,
    unlisted_tiles,
)
from splatgl.planning.bricks import IsVisible, Shell
from splatgl.planning.clusters import has_open, sums_of_open, touched_tiles
from splatgl.planning.culling import Frustum, PixelWindow, blocks_in_frustum, tiles_beside_box
from splatgl.planning.plan import Plan
from splatgl.planning.technique import COLUMNS, ROWS, batch_starts
from splatgl.splat.sheets import NearField, index_direction
from splatgl.splat.splats import Splats

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
class SplatBatches:
    """Batches of splats that are drawn while later ones are extracted.

    of: yields the batches of a band, nearest first; its argument tells whether a box of voxels may be visible there.
    bands: number of bands of rows, drawn one after another. shell: range of sheets that are drawn, see
    `Bricks.within`; None: all. near: voxels around the eye.
    """

    of: Callable[[IsVisible], Iterator[Splats]]
    bands: int = 1
    shell: Shell | None = None
    near: NearField | None = None


# records by their first sheet, and how many of them may be visible; all records and 0 if they are drawn in rounds
Ordered = tuple[SplatTexels, int]


class SheetTiles:
    """Draws sheets in tiles; keeps buffers and textures between pictures."""

    def __init__(self, device: Device, tiles: Tiles) -> None:
        self.device, self.tiles = device, tiles
        self.order, self.batch = SheetOrder(device), ReusedTextures(device.ctx)

    def release(self) -> None:
        """Frees all buffers and textures but those of `tiles`; they are recreated on demand."""
        free(self.order, self.batch)

    def begin(
        self, target: RenderTarget, splats: Splats, plan: Plan, portions: Portions, near: NearField | None, **more: Any
    ) -> Spec:
        """Draws the near sheets; returns how the others are drawn. more: further fields of Spec."""
        uniforms = sheet_uniforms(splats, plan)
        uniforms |= self.device.near.draw(near, plan, float(str(uniforms["first_sheet"])))
        spec = Spec(target, plan, portions, uniforms, "sheet_draw.comp", {}, **more)
        if spec.limits is not None:
            uniforms["depth_unit"] = spec.limits.unit / splats.grid.mean_spacing
        on = {"LIMITED": spec.limits is not None, "NEAR": near is not None, "LAYERED": spec.keeping is not None}
        return replace(spec, switches={name: True for name, is_on in on.items() if is_on})

    def begin_all(self, target: RenderTarget, splats: Splats, plan: Plan, portions: Portions, **more: Any) -> Spec:
        """As `begin`, with the near sheets of splats that are all there."""
        assert plan.resolved.sheets is not None
        near = NearField.of(splats, plan.view, plan.resolved.sheets)
        return self.begin(target, splats, plan, portions, near, **more)

    def ordered(self, spec: Spec, splats: Splats, window: PixelWindow | None = None) -> Ordered:
        """Returns splats that a window (or the picture) may show."""
        texels = self.device.splats.of(splats).texels(
            spec.plan.program.appearance.attenuation == "fill", DrawOrder(None, True)
        )
        if window is not None:
            spec.uniforms["edges"] = window_edges(spec.plan.view, in_pixels(window, spec.stride))
        if self._in_rounds(spec.plan):
            return texels, 0
        return self._in_order(spec, texels, len(splats), sheet_span(splats, spec.plan))

    def _in_order(self, spec: Spec, texels: SplatTexels, count: int, number: int) -> Ordered:
        """Returns `count` records by their first of `number` sheets."""
        card, uniforms = self.device.card, spec.uniforms
        if card is None:
            return self.order.sorted((count, number), spec.plan, texels, uniforms, spec.portions)
        # sorting depends on no band
        program = partial(spec.compiled, self.device.programs, TileBand.of(PixelWindow(0, 0, 0, 0)))
        order = card.sort_by_sheet(program, texels, count, number, uniforms)
        return SplatTexels(texels.records, texels.rest, order), count

    def draw(self, spec: Spec, splats: Splats, ordered: Ordered) -> None:
        """Composites the picture."""
        for window in bands_of(spec.plan.window, MOST_PIXELS):
            self.draw_window(spec, splats, ordered, window)

    def draw_window(self, spec: Spec, splats: Splats, ordered: Ordered, window: PixelWindow) -> TileBand:
        """Composites a window of the picture."""
        band = self.begin_band(spec, splats, window)
        if self._in_rounds(spec.plan):
            self._draw_rounds(spec, splats, ordered[0], band)
        else:
            texels, band.end = ordered
            for which in pairwise(batch_starts(band.end, spec.plan.hiding.depth_batches)):
                self.tiles.gather(spec, self, texels, which, band)
        self.flush(spec, band)
        return band

    def _in_rounds(self, plan: Plan) -> bool:
        """Whether splats are sorted and drawn in rounds of sheets; a card sorts all at once."""
        return self.device.card is None and plan.hiding.depth_batches > 1

    def _draw_rounds(self, spec: Spec, splats: Splats, texels: SplatTexels, band: TileBand) -> None:
        """Composites a band's splats sheets by sheets, without clusters of which only closed tiles are left."""
        clusters, names = self.device.splats.of(splats).clusters()
        uniforms = spec.uniforms | {"sheets": sheet_span(splats, spec.plan)}
        unlisted = partial(unlisted_tiles, spec, band)
        for part in clusters.rounds(splats, spec.plan, band.window, unlisted, band.stride):
            begin, end = part.sheets
            names.use(NAMES_UNIT)
            parts, in_round = clusters.parts(part.clusters), uniforms | {"begin": begin}
            numbers = len(splats), end - begin
            ordered, count = self.order.sorted(numbers, spec.plan, texels, in_round, spec.portions, parts)
            band.end = count if part.last else count + 1
            self.tiles.gather(spec, self, ordered, (0, count), band)

    def draw_batches(
        self, target: RenderTarget, whole: Splats, plan: Plan, batches: SplatBatches, portions: Portions
    ) -> None:
        """Composites batches of splats whose sheets do not lie before the sheets of earlier batches.

        whole: describes all splats.
        """
        spec = self.begin(target, whole, plan, portions, batches.near, exact=True)
        if batches.shell is not None:
            first = float(str(spec.uniforms["first_sheet"]))
            spec.uniforms.update(shell=tuple(end - first for end in batches.shell), partial=True)
        (window,) = bands_of(plan.window, sys.maxsize)
        rows = -(-window.height // ROWS)
        for part in bands_of(window, -(-rows // batches.bands) * ROWS * window.width):
            self._draw_band(spec, whole, batches, part)

    def least_bands(self, window: PixelWindow) -> int:
        """Returns the number of bands into which batches of splats must be drawn: a dispatch takes MOST_TILES tiles."""
        across, down = -(-window.width // COLUMNS) + 1, -(-window.height // ROWS) + 1
        return 1 if self.device.card is None else -(-down // max(MOST_TILES // across, 1))

    def _draw_band(self, spec: Spec, whole: Splats, batches: SplatBatches, window: PixelWindow) -> None:
        plan, band = spec.plan, self.begin_band(spec, whole, window)
        across = -(-window.width // COLUMNS)

        open_ = sums_of_open(band.closed.reshape(-1, across))

        def is_visible(low: np.ndarray, high: np.ndarray) -> np.ndarray:
            tiles = touched_tiles(low.T, high.T, plan.view, window)
            return may_show(low, high, plan) & has_open(tiles, open_)

        span = sheet_span(whole, plan)
        for splats in batches.of(is_visible):
            texels, count = self._in_order(spec, self.batch.texels(splats.records), len(splats), span)
            band.end = count + 1
            self.tiles.gather(spec, self, texels, (0, count), band)
            open_ = sums_of_open(band.closed.reshape(-1, across))
        self.flush(spec, band)

    def show(self, target: RenderTarget, whole: Splats, plan: Plan) -> None:
        """Classifies the values of a target that holds the joined parts of a picture."""
        spec, card = self.begin(target, whole, plan, Portions(self.device.ctx), None), self.device.card
        for window in bands_of(plan.window, MOST_PIXELS):
            band = self.begin_band(spec, whole, window)
            # no splats are left; each tile only has to classify its values
            clear_buffer(self._keep(band))
            if card is not None:
                card.begin(band.closed, CONTINUED)
                band.begun = True
            band.kept = np.ones(band.closed.size, bool)
            self.flush(spec, band)

    def begin_band(self, spec: Spec, splats: Splats, window: PixelWindow) -> TileBand:
        """Returns a new band, whose tiles beside the volume's box, and those that are not needed, are closed."""
        band = TileBand.of(window, spec.stride)
        if splats.post is not None:
            table = self.device.tables.classification(splats)
            table.use(CLASS_UNIT)
            table.bind_to_image(CLASS_IMAGE, read=True, write=False)
            side = spec.stride * COLUMNS, spec.stride * ROWS
            band.closed |= tiles_beside_box(spec.plan.view, splats.post.shape, in_pixels(window, spec.stride), side)
        if spec.needed is not None:
            across, down = tile_counts(window)
            row, column = window.y // ROWS, window.x // COLUMNS
            band.closed |= ~spec.needed[row : row + down, column : column + across].ravel()
        return band

    def flush(self, spec: Spec, band: TileBand) -> None:
        """Composites the sheets that are still open, and the near sheets of tiles without splats."""
        card = self.device.card
        if card is not None:
            if not band.last:
                if not band.begun:
                    card.begin(band.closed)
                card.bind_empty()
                band.last = True
                self.composite(spec, band, card, last=True)
            return
        band.last = True
        waiting = np.zeros_like(band.drawn) if band.kept is None else band.kept.copy()
        if "NEAR" in spec.switches:
            waiting |= ~(band.drawn | band.closed)
        indices = np.flatnonzero(waiting)
        if len(indices):
            lists = np.stack([indices, *np.zeros((3, len(indices)), np.int64)], axis=1).astype(np.uint32)
            # a band of batches may exceed the tiles of a dispatch
            self.tiles.add_up(spec, self, band, lists)

    def add_up(self, spec: Spec, band: TileBand, placed: ProjectedSplats, lists: np.ndarray) -> None:
        """Adds up lists per sheet, and composites the sheets that are complete."""
        buffers = self.tiles.buffers
        if placed.list is not None:
            placed.list.use(LIST_UNIT)
            placed.list.bind_to_image(LIST_IMAGE, read=True, write=False)
        band.drawn[lists[:, 0]] = True
        self.tiles.bind_images(spec.target, placed)
        while len(lists):
            part = lists.copy()
            part[:, 2] = np.minimum(lists[:, 2], lists[:, 1] + MOST_ENTRIES)
            part[:, 3] = band.last & (part[:, 2] == lists[:, 2])
            complete = part[:, 3] > 0
            if not complete.all() and band.kept is None:
                self._keep(band)
            if band.kept is not None:
                part[:, 3] |= CONTINUES * band.kept[part[:, 0]].astype(np.uint32)
            program = spec.compiled(self.device.programs, band, spec.drawing, {"CARRIED": band.kept is not None})
            set_uniforms(program, half_table=HALF_LINE_UNIT, list=LIST_UNIT, opaque=1.0 - spec.plan.hiding.cutoff)
            buffers.bind(LISTS, part.nbytes).write(part)
            flags = buffers.bind(OPEN, band.closed.size * 4)
            clear_buffer(flags)
            program.run(len(part))
            self.device.ctx.memory_barrier()
            open_ = np.frombuffer(flags.read(band.closed.size * 4), np.uint32)[part[:, 0]] > 0
            band.closed[part[~open_, 0]] = True
            if band.kept is not None:
                band.kept[part[:, 0]] = open_ & ~complete
            lists[:, 1] = part[:, 2]
            lists = lists[~complete & open_ & (lists[:, 1] < lists[:, 2])]

    def composite(self, spec: Spec, band: TileBand, card: CardLists, last: bool) -> None:
        """Adds up the lists that are bound, and composites the sheets that are complete."""
        complete = band.last and last
        carried = band.begun or not complete
        tiles = band.closed.size
        rings = self.tiles.buffers.bind(RINGS, tiles * RING_BYTES) if carried else None
        program = spec.compiled(self.device.programs, band, spec.drawing, {"CARRIED": carried})
        set_uniforms(program, half_table=HALF_LINE_UNIT, opaque=1.0 - spec.plan.hiding.cutoff, complete=complete)
        self.tiles.bind_images(spec.target)
        # so many tiles at a time that a block holds their open sheets
        most = max(most_block(self.device.ctx) // RING_BYTES, 1) if carried else tiles
        for first in range(0, tiles, most):
            part = min(most, tiles - first)
            if rings is not None:
                rings.bind_to_storage_buffer(RINGS, offset=first * RING_BYTES, size=part * RING_BYTES)
            set_uniforms(program, first_tile=first)
            program.run(part)
        self.device.ctx.memory_barrier()
        band.begun = True

    def _keep(self, band: TileBand) -> moderngl.Buffer:
        """Returns storage for the open sheets of all tiles, none of which are stored yet."""
        band.kept = np.zeros(band.closed.size, bool)
        return self.tiles.buffers.bind(RINGS, band.kept.size * RING_BYTES)


def in_pixels(window: PixelWindow, stride: int) -> PixelWindow:
    """Returns the pixels of the view of a window of samples."""
    return PixelWindow(*(stride * side for side in window.box))


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
        **NO_NEAR_SHEETS,
        "edges": window_edges(view, PixelWindow(0, 0, *view.size)),
    }
    if post is not None:
        uniforms |= class_uniforms(post)
        uniforms |= {
            "box_low": tuple(-0.5 - view.eye_index),
            "box_high": tuple(np.array(post.shape) - 0.5 - view.eye_index),
            "window_share": (*post.window_share, plan.resolved.mip_attenuation),
        }
    return uniforms | feature_uniforms(splats, plan)


def window_edges(view: GridView, window: PixelWindow) -> tuple[float, ...]:
    """Returns the left, upper, right and lower edge of a window of samples, as slopes or lengths in mean spacings."""
    x, y, width, height = window.box
    ends = np.array([[x, y], [x + width, y + height]]) - np.array(view.size) / 2
    return tuple((ends * view.pitch).ravel().tolist())


def may_show(low: np.ndarray, high: np.ndarray, plan: Plan) -> np.ndarray:
    """bool [N]: whether parts of boxes of voxels, from low to high [N, 3] (x, y, z), are in the picture and kept by
    clip planes.
    """
    shown = blocks_in_frustum(np.concatenate([low + high, high - low], axis=1) / 2, Frustum.of(plan.view))
    clip = plan.resolved.clip
    return shown if clip is None else shown & clip.meets(low - AROUND_CUT, high + AROUND_CUT)


def sheet_span(splats: Splats, plan: Plan) -> int:
    """Returns the number of sheets that may be a splat's first sheet."""
    assert plan.resolved.sheets is not None
    first, last = plan.resolved.sheets.range(splats, plan.view)
    return last - first + 1


class SheetOrder:
    """Sorts splats by first sheet; reuses its buffer and texture between pictures, and enlarges them on demand."""

    def __init__(self, device: Device) -> None:
        self.ctx, self.programs, self.buffers = device.ctx, device.programs, Buffers(device.ctx)
        self.order: moderngl.Texture | None = None

    def release(self) -> None:
        """Frees the buffers and the texture; they are recreated on demand."""
        free(self.buffers, self.order)
        self.order = None

    def sorted(
        self,
        numbers: tuple[int, int],
        plan: Plan,
        texels: SplatTexels,
        uniforms: Uniforms,
        portions: Portions,
        parts: np.ndarray | None = None,
    ) -> tuple[SplatTexels, int]:
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
            self.buffers.bind(RUNS, (runs + 1) * 4).write(np.array([0, *ends, len(parts)], np.uint32))
            self.buffers.bind(PARTS, max(parts.nbytes, 16)).write(parts)
        values = {"sheets": number, "begin": 0, **uniforms, "records": RECORDS_UNIT, "clustered": NAMES_UNIT}
        values |= {"number": number, "count": count, "length_": -(-count // runs)}
        size = runs * (number + 1) * 4
        cursors = self.buffers.bind(CURSORS, size)
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
        return SplatTexels(texels.records, texels.rest, order), int(until[-1, -1])

    def _run(self, plan: Plan, switches: dict[str, bool], values: Uniforms, runs: int, portions: Portions) -> None:
        program, lanes = self.programs.for_tiles("sheet_sort.comp", plan.program, switches), self.programs.shape.lanes
        # for all cores
        ends = range(GROUPS, runs // lanes + GROUPS, GROUPS)
        for begin, end in portions.parts("sorting", range(1, len(ends) + 1), len(ends)):
            first = begin * GROUPS
            set_uniforms(program, first_run=first * lanes, **values)
            program.run(min(end * GROUPS, runs // lanes) - first)
            self.ctx.memory_barrier()
