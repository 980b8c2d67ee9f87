"""Layers drawn in tiles: what each holds along every ray is kept, then composited together, nearest first."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import moderngl
import numpy as np

from splatgl.errors import InputError
from splatgl.gl.buffers import DrawOrder, SplatBuffers
from splatgl.gl.near_sheets import NearSheets
from splatgl.gl.program import Programs
from splatgl.gl.shader import LANES, PAGE
from splatgl.gl.sheet_tiles import BoxTiles, SheetTiles
from splatgl.gl.target import Portions, Target
from splatgl.gl.textures import Tables
from splatgl.gl.tiles import Band, set_uniforms
from splatgl.splat.culling import Window
from splatgl.splat.ordering import order_for
from splatgl.splat.plan import Plan
from splatgl.splat.sheets import index_direction
from splatgl.splat.splats import Splats
from splatgl.splat.technique import COLUMNS, ROWS

# buffer bindings, as of layer_pages.glsl
HEADS, PAGES = 1, 7
# bytes of all pages together, which every OpenGL with compute shaders allows; of a piece; and of a page
POOL, PIECE = 2**27, 16
ROOM = POOL // (PIECE * PAGE)
# pixels of the first window, of the largest, and the share of the pages that the next one is meant to take
FIRST, MOST, SHARE = 2**17, 2**20, 0.7

# optical depth of the thickest piece that is joined from several, in tolerances
THIN = 1.0

Drawn = tuple[Splats, Plan]


class LayerTiles(SheetTiles):
    """Reuses buffers and textures between pictures, as Tiles does."""

    # uniforms of layer_pages.glsl, and pieces of each pixel and layer
    keeping: dict[str, float]
    heads: moderngl.Buffer | None = None

    def __init__(
        self,
        ctx: moderngl.Context,
        programs: Programs,
        splats: SplatBuffers,
        whole: Callable[[moderngl.Program], None],
        tables: Tables,
        near: NearSheets,
        boxes: BoxTiles,
    ) -> None:
        super().__init__(ctx, programs, splats, whole, tables, near)
        self.boxes = boxes

    def release(self) -> None:
        """Frees all buffers and textures; they are recreated on demand."""
        super().release()
        if self.heads is not None:
            self.heads.release()
        self.heads = None

    def composite(
        self,
        target: Target,
        scratch: Target,
        layers: Sequence[Drawn],
        bind: Callable[[Splats, Plan], None],
        portions: Portions,
    ) -> None:
        """Composites the layers into `target`, in windows as large as the pages hold.

        scratch: for each layer's own light, behind which nothing of it is drawn. bind: sets uniforms of a layer.
        """
        whole = union([plan.window for _, plan in layers])
        waiting, size = [whole], FIRST
        while waiting:
            window = waiting.pop()
            height = max(size // max(window.width, 1) // ROWS, 1) * ROWS
            if height < window.height:
                window, rest = _rows(window, height)
                waiting.append(rest)
            taken = self._window(target, scratch, layers, bind, portions, window)
            if taken > ROOM:
                waiting += [window] if window.height > ROWS else _columns(window)
            size = int(np.clip(SHARE * window.width * window.height * ROOM / max(taken, 1), ROWS, MOST))

    def _window(
        self,
        target: Target,
        scratch: Target,
        layers: Sequence[Drawn],
        bind: Callable[[Splats, Plan], None],
        portions: Portions,
        window: Window,
    ) -> int:
        """Composites a window; returns the pages that its matter takes, of more than ROOM before it is composited."""
        band = self.begin(window)
        pixels = band.closed.size * ROWS * LANES
        heads, taken = self._empty_heads(len(layers), pixels), 0
        for n, (splats, plan) in enumerate(layers):
            bind(splats, plan)
            self.keeping = {"layer": n, "band": pixels, "room": ROOM, "thin": THIN * plan.resolved.tolerance}
            scratch.clear()
            if plan.resolved.boxes:
                self._draw_boxes(scratch, splats, replace(plan, window=window), portions)
            else:
                self._draw_window(scratch, splats, plan, self._sorted(splats, plan, window), window, portions)
            taken = int(np.frombuffer(heads.read(4), np.uint32)[0])
            if taken > ROOM:
                return taken
        bind(*layers[0])
        self._over(target, layers, band, pixels)
        return taken

    def _draw_boxes(self, scratch: Target, splats: Splats, plan: Plan, portions: Portions) -> None:
        """Draws a layer of boxes in the plan's window."""
        order = DrawOrder(order_for(splats, plan.resolved.camera), nearest_first=True)
        self.boxes.keeping = self._keep_matter
        try:
            self.boxes.draw(scratch, splats, plan, order, portions)
        finally:
            self.boxes.keeping = None

    def _over(self, target: Target, layers: Sequence[Drawn], band: Band, pixels: int) -> None:
        plan = layers[0][1]
        program = self.programs.for_tiles("layers_over.comp", plan.program, {"LAYERS": len(layers)})
        self.bind_target(target)
        self._bind_pieces()
        set_uniforms(program, band=pixels, opaque=1.0 - plan.hiding.cutoff, **layer_uniforms(layers))
        x, y, width, _ = band.window.box
        set_uniforms(program, origin=(x, y), tiles=(-(-width // COLUMNS), -(-band.window.height // ROWS)))
        program.run(band.closed.size)
        self.ctx.memory_barrier()

    def _empty_heads(self, layers: int, pixels: int) -> moderngl.Buffer:
        size = 16 * (1 + layers * pixels)
        if self.heads is None or self.heads.size < size:
            if self.heads is not None:
                self.heads.release()
            self.heads = self.ctx.buffer(reserve=size)
        self.heads.clear(size)
        return self.heads

    def _bind_pieces(self) -> None:
        """Binds the buffers of layer_pages.glsl; while splats are listed, others are in their place."""
        assert self.heads is not None
        self.heads.bind_to_storage_buffer(HEADS)
        self._buffer(PAGES, POOL)

    def _program(self, name: str, plan: Plan, switches: dict[str, bool]) -> moderngl.ComputeShader:
        if name != "sheet_draw.comp":
            return super()._program(name, plan, switches)
        program = super()._program(name, plan, {**switches, "LAYERED": True})
        self._keep_matter(program)
        return program

    def _keep_matter(self, program: moderngl.ComputeShader) -> None:
        """Makes a program keep a layer's matter."""
        set_uniforms(program, **self.keeping)
        self._bind_pieces()


def layer_uniforms(layers: Sequence[Drawn]) -> dict[str, object]:
    """Uniforms of layers_over.comp, in the unit of length of the first layer."""
    unit = layers[0][0].grid.mean_spacing
    found: dict[str, list[object]] = {
        name: [] for name in ("index_from_eye", "direction", "thickness", "first_sheet", "brightest")
    }
    for splats, plan in layers:
        sheets, view = plan.resolved.sheets, plan.view
        # columns, as OpenGL reads them
        scaled = view.index_from_eye.T * (unit / splats.grid.mean_spacing)
        found["index_from_eye"].append(tuple(scaled.ravel()))
        found["direction"].append(tuple(index_direction(view)))
        # of boxes grid steps from the eye
        found["thickness"].append(sheets.thickness if sheets else 1.0)
        found["first_sheet"].append(float(sheets.range(splats, view)[0]) if sheets else 0.0)
        found["brightest"].append(max(splats.brightest, 1.0))
    return dict(found)


def union(windows: Sequence[Window]) -> Window:
    """The smallest window that holds all, from a whole tile on; empty ones do not count."""
    some = [w for w in windows if w.width and w.height]
    if not some:
        return Window(0, 0, 0, 0)
    left, top = min(w.x for w in some) // COLUMNS * COLUMNS, min(w.y for w in some) // ROWS * ROWS
    return Window(left, top, max(w.x + w.width for w in some) - left, max(w.y + w.height for w in some) - top)


def _rows(window: Window, height: int) -> tuple[Window, Window]:
    """The upper rows of a window, and the rest."""
    x, y, width, all_ = window.box
    return Window(x, y, width, height), Window(x, y + height, width, all_ - height)


def _columns(window: Window) -> list[Window]:
    """The two halves of a row of tiles; InputError for a single tile."""
    x, y, width, height = window.box
    if width <= COLUMNS:
        raise InputError("layers: 8×8 samples of them hold more matter than there is room for; draw fewer together")
    part = -(-width // (2 * COLUMNS)) * COLUMNS
    return [Window(x, y, part, height), Window(x + part, y, width - part, height)]
