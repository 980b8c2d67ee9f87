"""Draws overlapping layers in tiles: stores the matter of each layer along each ray, then composites all of it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import moderngl
import numpy as np

from splatgl.errors import InputError
from splatgl.gl.buffers import DrawOrder, clear_buffer, free, most_block
from splatgl.gl.device import Device
from splatgl.gl.program import set_uniforms
from splatgl.gl.shader import PAGE
from splatgl.gl.sheet_tiles import BoxTiles, SheetTiles
from splatgl.gl.spared_tiles import MOST_NEEDED, SingleSamples, single_windows
from splatgl.gl.target import Portions, Target
from splatgl.gl.tiles import LISTS, Band, tile_counts
from splatgl.splat.culling import Window
from splatgl.splat.ordering import order_for
from splatgl.splat.plan import Plan
from splatgl.splat.sheets import index_direction
from splatgl.splat.splats import Splats
from splatgl.splat.technique import COLUMNS, ROWS

# buffer bindings of layer_pages.glsl
HEADS, PAGES = 1, 7
# bytes of all pages together, if the device allows them, and of a piece; number of pages
POOL, PIECE = 2**27, 16
ROOM = POOL // (PIECE * PAGE)
# words of a list in the heads
HEAD = 8
# pixels of the first and of the largest window; share of the pages that a window should use
FIRST, MOST, SHARE = 2**17, 2**20, 0.7
# by how much a window may be larger than the one before
GROWTH = 1.3
# largest optical depth, in tolerances, that joining pieces moves along a ray
UNEVEN = 0.2

Drawn = tuple[Splats, Plan]


class LayerTiles(SheetTiles):
    """Draws several layers in tiles; reuses its buffers and textures between pictures."""

    # uniforms of layer_pages.glsl; first and last page, and number of pieces, of each pixel and layer
    keeping: dict[str, float]
    heads: moderngl.Buffer | None = None
    # draws one sample a pixel; None: all pixels take all samples
    single: SingleSamples | None = None
    # mask of the tiles of the picture that are drawn; None: all
    needed: np.ndarray | None = None
    exact = True

    def __init__(self, device: Device, boxes: BoxTiles) -> None:
        super().__init__(device)
        self.boxes = boxes
        # samples of the next window by the stride, by what the latest needed
        self.sizes: dict[int, int] = {}

    def release(self) -> None:
        """Frees all buffers and textures; they are recreated on demand."""
        super().release()
        free(self.heads)
        self.heads = None

    def composite(
        self,
        target: Target,
        scratch: Target,
        layers: Sequence[Drawn],
        bind: Callable[[Splats, Plan], None],
        portions: Portions,
    ) -> None:
        """Composites the layers into `target`; where one sample a pixel is enough, only into the target of these.

        scratch: target for the light of a single layer; where it is opaque, the layer's matter behind is skipped.
        bind: binds the uniforms and tables of a layer.
        """
        plan, window = layers[0][1], union([plan.window for _, plan in layers])
        draw = partial(self._draw_windows, scratch, layers, bind)
        self.needed, self.portions = None, portions
        if self.single is not None and plan.resolved.allowed and self.limits is None:
            self.needed = self._draw_single(self.single, plan, window, draw)
        try:
            draw(target, window)
        finally:
            self.needed = None

    def _draw_single(
        self, single: SingleSamples, plan: Plan, window: Window, draw: Callable[[Target, Window], None]
    ) -> np.ndarray | None:
        """Draws one sample a pixel; returns the mask of the tiles of samples that need all, None if most do."""
        target, (whole, strip) = single.begin(plan), single_windows(window, plan.samples)
        try:
            self.stride = plan.samples
            draw(target, strip)
            if single.measure(target, plan, strip)[1] > MOST_NEEDED:
                single.kept = None
                return None
            target.clear()
            draw(target, whole)
        finally:
            self.stride = 1
        return single.measure(target, plan, whole)[0]

    def _draw_windows(
        self,
        scratch: Target,
        layers: Sequence[Drawn],
        bind: Callable[[Splats, Plan], None],
        target: Target,
        whole: Window,
    ) -> None:
        """Composites the layers of a window, in windows whose matter fits into the pages."""
        block = most_block(self.ctx)
        # pages, and pixels whose heads fit into a block
        room, most = min(ROOM, block // (PIECE * PAGE)), min(MOST, (block // 4 - 1) // (HEAD * len(layers)))
        waiting, least, next_size = [whole], most, self.sizes.get(self.stride, FIRST)
        while waiting:
            window = waiting.pop()
            height = max(min(next_size, most) // max(window.width, 1) // ROWS, 1) * ROWS
            if height < window.height:
                window, rest = _rows(window, height)
                waiting.append(rest)
            used = self._window(target, scratch, layers, bind, (window, room))
            if used > room:
                waiting += [window] if window.height > ROWS else _columns(window)
            # what is nearer to the middle of the picture needs more
            size = window.width * window.height
            enough = int(SHARE * size * room / max(used, 1))
            least, next_size = min(least, enough), min(enough, int(GROWTH * size))
        # for the next picture
        self.sizes[self.stride] = max(least, ROWS * ROWS)

    def _window(
        self,
        target: Target,
        scratch: Target,
        layers: Sequence[Drawn],
        bind: Callable[[Splats, Plan], None],
        part: tuple[Window, int],
    ) -> int:
        """Composites a window; returns the number of pages it needs. If more than there are, nothing is composited.

        part: the window, and the number of pages.
        """
        window, room = part
        band = self.begin(window)
        pixels = band.closed.size * ROWS * COLUMNS
        heads, used, holding = self._empty_heads(layers, pixels), 0, np.zeros(band.closed.size, np.uint32)
        for n, (splats, plan) in enumerate(layers):
            bind(splats, plan)
            self.keeping = {"layer": n, "band": pixels, "room": room, "uneven": UNEVEN * plan.resolved.tolerance}
            if plan.resolved.boxes:
                scratch.clear()
                self._draw_boxes(scratch, splats, replace(plan, window=window))
                begun = np.ones(holding.size, bool)
            else:
                self._draw_window(scratch, splats, plan, self._sorted(splats, plan, window), window)
                begun = self.begun if self.card is None else np.ones(holding.size, bool)
            holding |= begun.astype(np.uint32) << n
            used = int(np.frombuffer(heads.read(4), np.uint32)[0])
            if used > room:
                return used * len(layers) // (n + 1)
        bind(*layers[0])
        self._over(target, layers, band, holding)
        return used

    def _begin(self, splats: Splats, plan: Plan, window: Window) -> Band:
        band = super()._begin(splats, plan, window)
        if self.needed is not None:
            across, down = tile_counts(window)
            row, column = window.y // ROWS, window.x // COLUMNS
            band.closed |= ~self.needed[row : row + down, column : column + across].ravel()
        return band

    def _draw_boxes(self, scratch: Target, splats: Splats, plan: Plan) -> None:
        """Stores the matter of a layer of boxes in the plan's window."""
        order = DrawOrder(order_for(splats, plan.resolved.camera), nearest_first=True)
        self.boxes.keeping = self._keep_matter
        try:
            self.boxes.draw(scratch, splats, plan, order, self.portions)
        finally:
            self.boxes.keeping = None

    def _over(self, target: Target, layers: Sequence[Drawn], band: Band, holding: np.ndarray) -> None:
        """Composites the tiles of a band. holding: of each tile a bit for each layer that may have matter there."""
        plan = layers[0][1]
        program = self.programs.for_tiles("layers_over.comp", plan.program, {"LAYERS": len(layers)})
        self.bind_target(target)
        self._bind_pieces()
        set_uniforms(
            program,
            band=holding.size * ROWS * COLUMNS,
            stride=float(self.stride),
            opaque=1.0 - plan.hiding.cutoff,
            **layer_uniforms(layers),
        )
        x, y, width, _ = band.window.box
        set_uniforms(program, origin=(x, y), tiles=(-(-width // COLUMNS), -(-band.window.height // ROWS)))
        tiles = np.flatnonzero(holding)
        lists = np.stack([tiles, holding[tiles]], axis=1).astype(np.uint32)
        self._buffer(LISTS, max(lists.nbytes, 8)).write(lists)
        program.run(len(tiles))
        self.ctx.memory_barrier()

    def _empty_heads(self, layers: Sequence[Drawn], pixels: int) -> moderngl.Buffer:
        """Returns the heads, without a page; lists are empty where they are not written before they are read."""
        size = 4 * (1 + HEAD * len(layers) * pixels)
        if self.heads is None or self.heads.size < size:
            free(self.heads)
            self.heads = self.ctx.buffer(reserve=size)
        is_listed = self.card is None and not any(plan.resolved.boxes for _, plan in layers)
        clear_buffer(self.heads, 4 if is_listed else size)
        return self.heads

    def _bind_pieces(self) -> None:
        """Binds the buffers of layer_pages.glsl; the passes that list splats bind other buffers there."""
        assert self.heads is not None
        self.heads.bind_to_storage_buffer(HEADS)
        self._buffer(PAGES, min(POOL, most_block(self.ctx)))

    def _program(self, name: str, plan: Plan, switches: dict[str, bool]) -> moderngl.ComputeShader:
        if name != "sheet_draw.comp":
            return super()._program(name, plan, switches)
        program = super()._program(name, plan, {**switches, "LAYERED": True})
        self._keep_matter(program)
        return program

    def _keep_matter(self, program: moderngl.ComputeShader) -> None:
        """Sets up a program to store the matter of a layer."""
        set_uniforms(program, **self.keeping)
        self._bind_pieces()


def layer_uniforms(layers: Sequence[Drawn]) -> dict[str, object]:
    """Returns the uniforms of layers_over.comp, in the first layer's unit of length."""
    unit = layers[0][0].grid.mean_spacing
    uniforms: dict[str, list[object]] = {
        name: [] for name in ("index_from_eye", "direction", "thickness", "first_sheet", "brightest")
    }
    for splats, plan in layers:
        sheets, view = plan.resolved.sheets, plan.view
        # transposed: OpenGL reads columns
        scaled = view.index_from_eye.T * (unit / splats.grid.mean_spacing)
        uniforms["index_from_eye"].append(tuple(scaled.ravel()))
        uniforms["direction"].append(tuple(index_direction(view)))
        # boxes count grid steps from the eye
        uniforms["thickness"].append(sheets.thickness if sheets else 1.0)
        uniforms["first_sheet"].append(float(sheets.range(splats, view)[0]) if sheets else 0.0)
        uniforms["brightest"].append(max(splats.brightest, 1.0))
    return dict(uniforms)


def union(windows: Sequence[Window]) -> Window:
    """Returns the smallest window around all non-empty windows, its left and top at a tile's edge."""
    nonempty = [w for w in windows if w.width and w.height]
    if not nonempty:
        return Window(0, 0, 0, 0)
    left, top = min(w.x for w in nonempty) // COLUMNS * COLUMNS, min(w.y for w in nonempty) // ROWS * ROWS
    return Window(left, top, max(w.x + w.width for w in nonempty) - left, max(w.y + w.height for w in nonempty) - top)


def _rows(window: Window, height: int) -> tuple[Window, Window]:
    """Splits a window below its first `height` rows."""
    x, y, width, total = window.box
    return Window(x, y, width, height), Window(x, y + height, width, total - height)


def _columns(window: Window) -> list[Window]:
    """Splits a row of tiles into two halves; raises InputError for a single tile."""
    x, y, width, height = window.box
    if width <= COLUMNS:
        raise InputError("layers: 8×8 samples of them hold more matter than there is room for; draw fewer together")
    part = -(-width // (2 * COLUMNS)) * COLUMNS
    return [Window(x, y, part, height), Window(x + part, y, width - part, height)]
