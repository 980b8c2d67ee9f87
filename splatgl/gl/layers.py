"""Draws overlapping layers in tiles: stores the optical depth of each layer along each ray, then composites them
together.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import moderngl
import numpy as np

from splatgl.errors import InputError
from splatgl.gl.adaptive_samples import SingleSamples
from splatgl.gl.buffers import DrawOrder, clear_buffer, free, most_block
from splatgl.gl.device import Device
from splatgl.gl.meshes import DepthLimits
from splatgl.gl.program import set_uniforms
from splatgl.gl.shader import PAGE
from splatgl.gl.sheet_tiles import SheetTiles
from splatgl.gl.target import Portions, RenderTarget
from splatgl.gl.tiles import LISTS, SplatTiles, TileBand, tile_counts
from splatgl.planning.culling import PixelWindow, order_for
from splatgl.planning.plan import Plan
from splatgl.planning.technique import COLUMNS, ROWS
from splatgl.splat.sheets import index_direction
from splatgl.splat.splats import Splats

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


@dataclass(frozen=True, eq=False)
class LayerBatch:
    """Layers that are composited together. bind: binds the uniforms and tables of a layer. scratch: target for the
    light of a single layer; where it is opaque, the layer's matter behind is skipped. limits, stride, needed: as of
    Spec.
    """

    layers: Sequence[Drawn]
    bind: Callable[[Splats, Plan], None]
    scratch: RenderTarget
    portions: Portions
    limits: DepthLimits | None = None
    stride: int = 1
    needed: np.ndarray | None = None


class LayerTiles:
    """Draws several layers in tiles. single: None: all pixels take all samples."""

    # first and last page, and number of pieces, of each pixel and layer
    heads: moderngl.Buffer | None = None

    def __init__(self, device: Device, sheets: SheetTiles, splats: SplatTiles, single: SingleSamples | None) -> None:
        self.device, self.sheets, self.splats, self.single = device, sheets, splats, single
        # samples of the next window by the stride, by what the latest needed
        self.sizes: dict[int, int] = {}

    def release(self) -> None:
        """Frees the heads; they are recreated on demand."""
        free(self.heads)
        self.heads = None

    def composite(self, target: RenderTarget, layers: LayerBatch) -> None:
        """Composites the layers into `target`; where one sample a pixel is enough, only into the target of these."""
        plan, window = layers.layers[0][1], union([plan.window for _, plan in layers.layers])
        if self.single is not None and plan.resolved.allowed and layers.limits is None:
            one = partial(self._draw_windows, replace(layers, stride=plan.samples))
            layers = replace(layers, needed=self.single.needed(plan, window, one))
        self._draw_windows(layers, target, window)

    def _draw_windows(self, layers: LayerBatch, target: RenderTarget, whole: PixelWindow) -> None:
        """Composites the layers of a window, in windows whose matter fits into the pages."""
        block = most_block(self.device.ctx)
        # pages, and pixels whose heads fit into a block
        room, most = min(ROOM, block // (PIECE * PAGE)), min(MOST, (block // 4 - 1) // (HEAD * len(layers.layers)))
        waiting, least, next_size = [whole], most, self.sizes.get(layers.stride, FIRST)
        while waiting:
            window = waiting.pop()
            height = max(min(next_size, most) // max(window.width, 1) // ROWS, 1) * ROWS
            if height < window.height:
                window, rest = _rows(window, height)
                waiting.append(rest)
            used = self._window(layers, target, window, room)
            if used > room:
                waiting += [window] if window.height > ROWS else _columns(window)
            # what is nearer to the middle of the picture needs more
            size = window.width * window.height
            enough = int(SHARE * size * room / max(used, 1))
            # by a row of tiles at least, to which heights are rounded down
            larger = max(int(GROWTH * size), size + window.width * ROWS)
            least, next_size = min(least, enough), min(enough, larger)
        # for the next picture
        self.sizes[layers.stride] = max(least, ROWS * ROWS)

    def _window(self, layers: LayerBatch, target: RenderTarget, window: PixelWindow, room: int) -> int:
        """Composites a window; returns the number of pages it needs. If more than `room`, nothing is composited."""
        band, drawn = TileBand.of(window, layers.stride), layers.layers
        pixels = band.closed.size * ROWS * COLUMNS
        heads, used, holding = self._empty_heads(drawn, pixels), 0, np.zeros(band.closed.size, np.uint32)
        for n, (splats, plan) in enumerate(drawn):
            layers.bind(splats, plan)
            uneven = UNEVEN * plan.resolved.tolerance
            keeping = partial(self._keep_matter, {"layer": n, "band": pixels, "room": room, "uneven": uneven})
            holding |= self._keep_layer(layers, (splats, plan), window, keeping).astype(np.uint32) << n
            used = int(np.frombuffer(heads.read(4), np.uint32)[0])
            if used > room:
                return used * len(drawn) // (n + 1)
        layers.bind(*drawn[0])
        self._over(target, drawn, band, holding)
        return used

    def _keep_layer(
        self, layers: LayerBatch, drawn: Drawn, window: PixelWindow, keeping: Callable[[moderngl.ComputeShader], None]
    ) -> np.ndarray:
        """Stores the matter of a layer in a window; returns the mask of the tiles that may have any."""
        (splats, plan), scratch, portions, limits = drawn, layers.scratch, layers.portions, layers.limits
        if plan.resolved.boxes:
            scratch.clear()
            order = DrawOrder(order_for(splats, plan.resolved.camera), nearest_first=True)
            self.splats.draw(scratch, splats, replace(plan, window=window), order, portions, limits, keeping)
            return np.ones(TileBand.of(window).closed.size, bool)
        more = {"limits": limits, "keeping": keeping, "stride": layers.stride, "needed": layers.needed, "exact": True}
        spec = self.sheets.begin_all(scratch, splats, plan, portions, **more)
        band = self.sheets.draw_window(spec, splats, self.sheets.ordered(spec, splats, window), window)
        return band.drawn if self.device.card is None else np.ones_like(band.drawn)

    def _over(self, target: RenderTarget, layers: Sequence[Drawn], band: TileBand, holding: np.ndarray) -> None:
        """Composites the tiles of a band. holding: of each tile a bit for each layer that may have matter there."""
        plan = layers[0][1]
        program = self.device.programs.for_tiles("layers_over.comp", plan.program, {"LAYERS": len(layers)})
        self.sheets.tiles.bind_images(target)
        self._bind_pieces()
        set_uniforms(
            program,
            band=holding.size * ROWS * COLUMNS,
            stride=float(band.stride),
            opaque=1.0 - plan.hiding.cutoff,
            origin=band.window.box[:2],
            tiles=tile_counts(band.window),
            **layer_uniforms(layers),
        )
        tiles = np.flatnonzero(holding)
        lists = np.stack([tiles, holding[tiles]], axis=1).astype(np.uint32)
        self.sheets.tiles.buffers.bind(LISTS, max(lists.nbytes, 8)).write(lists)
        program.run(len(tiles))
        self.device.ctx.memory_barrier()

    def _empty_heads(self, layers: Sequence[Drawn], pixels: int) -> moderngl.Buffer:
        """Returns the heads, without a page; lists are empty where they are not written before they are read."""
        size = 4 * (1 + HEAD * len(layers) * pixels)
        if self.heads is None or self.heads.size < size:
            free(self.heads)
            self.heads = self.device.ctx.buffer(reserve=size)
        is_listed = self.device.card is None and not any(plan.resolved.boxes for _, plan in layers)
        clear_buffer(self.heads, 4 if is_listed else size)
        return self.heads

    def _bind_pieces(self) -> None:
        """Binds the buffers of layer_pages.glsl; the passes that list splats bind other buffers there."""
        assert self.heads is not None
        self.heads.bind_to_storage_buffer(HEADS)
        self.sheets.tiles.buffers.bind(PAGES, min(POOL, most_block(self.device.ctx)))

    def _keep_matter(self, uniforms: dict[str, float], program: moderngl.ComputeShader) -> None:
        """Sets up a program to store the matter of a layer. uniforms: of layer_pages.glsl."""
        set_uniforms(program, **uniforms)
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


def union(windows: Sequence[PixelWindow]) -> PixelWindow:
    """Returns the smallest window around all non-empty windows, its left and top at a tile's edge."""
    nonempty = [w for w in windows if w.width and w.height]
    if not nonempty:
        return PixelWindow(0, 0, 0, 0)
    left, top = min(w.x for w in nonempty) // COLUMNS * COLUMNS, min(w.y for w in nonempty) // ROWS * ROWS
    return PixelWindow(
        left, top, max(w.x + w.width for w in nonempty) - left, max(w.y + w.height for w in nonempty) - top
    )


def _rows(window: PixelWindow, height: int) -> tuple[PixelWindow, PixelWindow]:
    """Splits a window below its first `height` rows."""
    x, y, width, total = window.box
    return PixelWindow(x, y, width, height), PixelWindow(x, y + height, width, total - height)


def _columns(window: PixelWindow) -> list[PixelWindow]:
    """Splits a row of tiles into two halves; raises InputError for a single tile."""
    x, y, width, height = window.box
    if width <= COLUMNS:
        raise InputError("layers: these overlapping layers need too much GPU memory; hide layers or lower --size")
    part = -(-width // (2 * COLUMNS)) * COLUMNS
    return [PixelWindow(x, y, part, height), PixelWindow(x + part, y, width - part, height)]
