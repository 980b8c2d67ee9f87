"""Draws sheets in tiles without compute shaders: numpy lists the projected splats by tile, fragments composite lists.

Every fragment of `sheet_draw.frag` draws a column of pixels of a tile, or on a graphics card one pixel, as an
invocation of `sheet_draw.comp` does. Lists that this cannot draw at once are drawn by quads.
"""

from __future__ import annotations

from functools import partial
from typing import NamedTuple

import moderngl
import numpy as np

from splatgl.gl.adaptive_samples import SingleSamples, single_windows
from splatgl.gl.buffers import DrawOrder, free, texel_texture, uneven
from splatgl.gl.device import Device
from splatgl.gl.meshes import LIMIT_UNITS, DepthLimits
from splatgl.gl.program import cover, set_uniforms
from splatgl.gl.quads import SheetQuads
from splatgl.gl.shader import ABREAST, LISTED, ShaderError
from splatgl.gl.sheet_tiles import MOST_ENTRIES, sheet_uniforms
from splatgl.gl.target import Portions, RenderTarget
from splatgl.gl.textures import CLASS_UNIT, HALF_LINE_UNIT
from splatgl.gl.tiles import (
    LIST_UNIT,
    MOST_LISTED,
    PLACED,
    PLACED_UNIT,
    ProjectedSplats,
    Projector,
    Spec,
    bands_of,
    tile_counts,
)
from splatgl.planning.culling import PixelWindow
from splatgl.planning.plan import Plan
from splatgl.planning.technique import COLUMNS, ROWS
from splatgl.splat.sheets import NearField
from splatgl.splat.splats import Splats

# maximum number of splats that are projected, and of pixels whose tiles are drawn at once, 16 bytes each
MOST_PROJECTED, MOST_PIXELS = 2**23, 2**22
# tiles that are listed at once: numpy sorts numbers of 16 bits by radix
MOST_TILES = 2**16
# texture units of the tiles' ranges, and of the rows of pixels of fragments
RANGES_UNIT, ROWS_UNIT = 6, 2
# cost of a tile's drawing, in entries of its list, and of a portion of the drawing
TILE_COST, PORTION = 16, 2**20


class TileLists(NamedTuple):
    """Lists of the splats of tiles. window: of the picture's samples `stride` apart, whose tiles these are. names:
    numbers of projected splats, tile by tile in the order of first sheets, uint32 [entries]. ends: of the tiles' lists,
    int64 [tiles + 1], of which the first is 0.
    """

    window: PixelWindow
    names: np.ndarray
    ends: np.ndarray

    @property
    def ranges(self) -> np.ndarray:
        """Begins and ends of the lists, uint32 [rows, columns, 2]."""
        across, down = tile_counts(self.window)
        return np.stack([self.ends[:-1], self.ends[1:]], axis=1).astype(np.uint32).reshape(down, across, 2)

    @property
    def longest(self) -> int:
        """The number of entries of the longest list."""
        return int(np.diff(self.ends).max(initial=0))


class SheetFragments:
    """Draws sheets in tiles by fragments; keeps its textures between pictures. quads: draws what fragments cannot.
    single: draws one sample a pixel where that is enough.
    """

    def __init__(self, device: Device, quads: SheetQuads, single: SingleSamples) -> None:
        self.device, self.ctx, self.programs = device, device.ctx, device.programs
        self.quads, self.single = quads, single
        self.projector, self.placed = Projector(device), ProjectedSplats()
        self.fragments: moderngl.Framebuffer | None = None
        self.rows: list[moderngl.Texture] = []
        self.ranges: moderngl.Texture | None = None

    def release(self) -> None:
        """Frees all textures; they are recreated on demand."""
        free(self.projector, self.placed, self.fragments, *self.rows, self.ranges)
        self.placed, self.fragments, self.rows, self.ranges = ProjectedSplats(), None, [], None

    def draw(
        self,
        target: RenderTarget,
        splats: Splats,
        plan: Plan,
        order: DrawOrder,
        portions: Portions,
        limits: DepthLimits | None = None,
    ) -> None:
        """Composites the sheets into `target`; raises Interrupted if cancelled. order: unused."""
        assert plan.resolved.sheets is not None
        near = NearField.of(splats, plan.view, plan.resolved.sheets)
        uniforms = sheet_uniforms(splats, plan)
        uniforms |= self.device.near.draw(near, plan, float(str(uniforms["first_sheet"])))
        if limits is not None:
            uniforms["depth_unit"] = limits.unit / splats.grid.mean_spacing
        switches = {"NEAR": near is not None, "LIMITED": limits is not None, "CARD": self.programs.shape.name == "card"}
        spec = Spec(target, plan, portions, uniforms, "sheet_draw.frag", switches, limits)
        lists = self._listed(spec, splats) if self._compiles(spec) else None
        if lists is None:
            self.quads.draw(target, splats, plan, order, portions, limits)
            return
        if splats.post is not None:
            self.device.tables.classification(splats).use(CLASS_UNIT)
        needed = None
        if plan.resolved.allowed and limits is None:
            draw = partial(self._draw_windows, spec, lists, stride=plan.samples)
            needed = self.single.needed(plan, plan.window, draw)
        self._draw_windows(spec, lists, target, plan.window, 1, needed)

    def _compiles(self, spec: Spec) -> bool:
        """Whether the driver takes the fragments' text, which no driver of a card has been seen to take."""
        try:
            self._drawing(spec)
        except ShaderError:
            return False
        return True

    def _drawing(self, spec: Spec) -> moderngl.Program:
        """The program that draws the fragments."""
        more = {**spec.switches, "ROWS": self.programs.shape.rows, "COMPUTE": False}
        return self.programs.for_screen("sheet_draw.frag", spec.plan.program, more)

    def _listed(self, spec: Spec, splats: Splats) -> TileLists | None:
        """Projects the splats and returns their lists by tiles of one sample a pixel; None if these are too long."""
        plan, count = spec.plan, len(splats)
        if count > MOST_PROJECTED:
            return None
        runs = plan.program.appearance.attenuation == "fill"
        texels = self.device.splats.of(splats).texels(runs, DrawOrder(None, True))
        self.projector.project(spec, self.placed, texels, (0, count))
        spec.portions.ask()
        window, _ = single_windows(plan.window, plan.samples)
        bounds = self._read(0, count)
        # where the projection stores the place in sheets
        place = self._read(2 if plan.program.packed else 3, count)[:, 3]
        sheets = plan.resolved.sheets
        assert sheets is not None
        bases = sheets.base(place)
        shown = np.flatnonzero((bounds[:, 3] >= 0) & (bases >= int(str(spec.uniforms["near_base"]))))
        shown = shown[np.argsort(bases[shown].astype(np.int16), kind="stable")]
        lists = list_by_tile(shown, bounds[shown], window, plan.samples)
        longest = MOST_ENTRIES if lists is not None and self.programs.shape.rows > 1 else MOST_LISTED
        if lists is None or lists.longest > longest:
            return None
        self._write_list(lists)
        return lists

    def _read(self, number: int, count: int) -> np.ndarray:
        """Returns the texels of projected splats in a texture, float32 [count, 4]."""
        rows = -(-count // ABREAST)
        texels = np.empty((rows * ABREAST, 4), np.float32)
        assert self.placed.framebuffer is not None
        self.placed.framebuffer.read_into(texels, (0, 0, ABREAST, rows), 4, attachment=number, dtype="u4")
        return texels[:count]

    def _write_list(self, lists: TileLists) -> None:
        """Uploads the names, four in a texel; shaders read one texel beyond the last."""
        height = (len(lists.names) + 4) // (LISTED * 4) + 1
        if self.placed.list is None or self.placed.list.height < height:
            free(self.placed.list)
            self.placed.list = texel_texture(self.ctx, (LISTED, uneven(height)), 4, "u4")
        names = np.zeros(height * LISTED * 4, np.uint32)
        names[: len(lists.names)] = lists.names
        self.placed.list.write(names, (0, 0, LISTED, height), alignment=4)

    def _draw_windows(
        self,
        spec: Spec,
        lists: TileLists,
        target: RenderTarget,
        window: PixelWindow,
        stride: int,
        needed: np.ndarray | None = None,
    ) -> None:
        """Draws samples `stride` apart. needed: mask of the picture's tiles of samples that are drawn; None: all."""
        ratio = spec.plan.samples // stride
        row, column = lists.window.y // ROWS, lists.window.x // COLUMNS
        ranges = lists.ranges
        for band in bands_of(window, MOST_PIXELS):
            across, down = tile_counts(band)
            rows = np.arange(band.y // ROWS, band.y // ROWS + down)
            columns = np.arange(band.x // COLUMNS, band.x // COLUMNS + across)
            own = ranges[np.ix_(rows // ratio - row, columns // ratio - column)]
            if needed is not None:
                own[~needed[np.ix_(rows, columns)]] = (1, 0)
            self._draw_band(spec, target, band, stride, own)

    def _draw_band(self, spec: Spec, target: RenderTarget, band: PixelWindow, stride: int, ranges: np.ndarray) -> None:
        """Draws the tiles of a band by the ranges of their lists, uint32 [rows, columns, 2]."""
        down, across = ranges.shape[:2]
        rows = self.programs.shape.rows
        tall = ROWS if rows == 1 else 2
        self._make((across * (COLUMNS if rows == 1 else COLUMNS // 2), down * tall), (across, down))
        assert self.fragments is not None and self.ranges is not None and self.placed.list is not None
        self.ranges.write(np.ascontiguousarray(ranges), (0, 0, across, down), alignment=4)
        program = self._drawing(spec)
        placed = {name: PLACED_UNIT + unit for unit, name in enumerate(PLACED)}
        units = {**placed, "list": LIST_UNIT, "ranges": RANGES_UNIT, "half_table": HALF_LINE_UNIT, **LIMIT_UNITS}
        set_uniforms(program, **units, **spec.uniforms, origin=band.box[:2], tiles=(across, down), stride=stride)
        set_uniforms(program, opaque=1.0 - spec.plan.hiding.cutoff)
        if spec.limits is not None:
            spec.limits.use()
        self.placed.use()
        self.placed.list.use(LIST_UNIT)
        self.ranges.use(RANGES_UNIT)
        self.fragments.viewport = 0, 0, across * (COLUMNS if rows == 1 else COLUMNS // 2), down * tall
        self.ctx.enable_only(moderngl.NOTHING)
        lengths = ranges[..., 1].astype(np.int64) - ranges[..., 0] + TILE_COST
        for top, bottom in spec.portions.parts("lists", np.cumsum(lengths.sum(axis=1)), PORTION):
            self.fragments.use()
            self.fragments.scissor = 0, top * tall, self.fragments.viewport[2], (bottom - top) * tall
            cover(program)
        self._spread(spec, target, band)

    def _spread(self, spec: Spec, target: RenderTarget, band: PixelWindow) -> None:
        """Writes the pixels of a band that fragments have drawn to the target."""
        spread = self.programs.for_screen("fragments_spread.frag", spec.plan.program, {"ROWS": len(self.rows)})
        for number, texture in enumerate(self.rows):
            texture.use(ROWS_UNIT + number)
            set_uniforms(spread, **{f"row{number}": ROWS_UNIT + number})
        set_uniforms(spread, origin=band.box[:2])
        target.framebuffer.use()
        target.framebuffer.scissor = band.box
        cover(spread)
        target.framebuffer.scissor = None  # type: ignore[assignment]

    def _make(self, size: tuple[int, int], tiles: tuple[int, int]) -> None:
        """Makes textures for so many fragments and tiles, unless there are."""
        if self.ranges is None or self.ranges.width < tiles[0] or self.ranges.height < tiles[1]:
            free(self.ranges)
            self.ranges = texel_texture(self.ctx, (uneven(tiles[0]), uneven(tiles[1])), 2, "u4")
        old = self.fragments
        if old is None or old.width < size[0] or old.height < size[1]:
            before, sides = self.rows, (uneven(size[0]), uneven(size[1]))
            self.rows = [texel_texture(self.ctx, sides, 4, "f4") for _ in range(self.programs.shape.rows)]
            self.fragments = self.ctx.framebuffer(self.rows)
            free(old, *before)


def list_by_tile(names: np.ndarray, bounds: np.ndarray, window: PixelWindow, samples: int) -> TileLists | None:
    """Returns the lists of a window's tiles of pixels of `samples` samples a side; None beyond MOST_LISTED entries.

    bounds: centres (x, y) and half sides (y, x) in samples, float32 [N, 4], of splats `names` [N].
    """
    across, down = tile_counts(window)
    ends = []
    for axis, side, many, origin in ((0, COLUMNS, across, window.x), (1, ROWS, down, window.y)):
        # the centres of a tile's samples lie half a sample within it
        size, place = np.float32(side * samples), bounds[:, axis] - np.float32(origin * samples)
        reach = bounds[:, 3 - axis]
        first = np.clip(np.ceil((place - reach + np.float32(0.5)) / size) - 1, 0, many)
        last = np.clip(np.floor((place + reach - np.float32(0.5)) / size), -1, many - 1)
        ends.append((first.astype(np.int32), last.astype(np.int32)))
    (left, right), (top, bottom) = ends
    parts, counts = list[np.ndarray](), list[np.ndarray]()
    for begin in range(0, down, max(MOST_TILES // across, 1)):
        end = min(begin + max(MOST_TILES // across, 1), down)
        low, high = np.maximum(top, begin), np.minimum(bottom, end - 1)
        inside = np.flatnonzero((low <= high) & (left <= right))
        low, tall = low[inside] - begin, (high - low)[inside] + 1
        start, wide = left[inside], right[inside] - left[inside] + 1
        if sum(map(len, parts)) + int((tall.astype(np.int64) * wide).sum()) > MOST_LISTED:
            return None
        # the first tile of every row of tiles that a splat reaches, then the tiles of the row
        until = np.cumsum(tall)
        number = np.arange(until[-1] if len(until) else 0, dtype=np.int32) * across
        row = np.repeat(low * across + start - (until - tall) * across, tall) + number
        width = np.repeat(wide, tall)
        until = np.cumsum(width)
        tile = np.repeat(row - (until - width), width) + np.arange(until[-1] if len(until) else 0)
        tile = tile.astype(np.uint16)
        parts.append(np.repeat(names[inside].astype(np.uint32), tall * wide)[np.argsort(tile, kind="stable")])
        counts.append(np.bincount(tile, minlength=(end - begin) * across))
    totals = np.concatenate([[0], *counts]) if counts else np.zeros(across * down + 1, np.int64)
    return TileLists(window, np.concatenate(parts) if parts else np.zeros(0, np.uint32), np.cumsum(totals))
