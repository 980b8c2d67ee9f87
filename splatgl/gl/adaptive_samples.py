"""Adaptive antialiasing: one sample per pixel, then all samples in the tiles that contain edges."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import replace
from functools import partial

import moderngl
import numpy as np

from splatgl.gl.buffers import DrawOrder
from splatgl.gl.device import Device
from splatgl.gl.meshes import DepthLimits
from splatgl.gl.program import cover, set_uniforms
from splatgl.gl.sheet_tiles import MOST_PIXELS, Ordered, SheetTiles
from splatgl.gl.target import Portions, RenderTarget
from splatgl.gl.tiles import Spec, bands_of, tile_counts
from splatgl.planning.culling import PixelWindow
from splatgl.planning.plan import Plan
from splatgl.planning.technique import COLUMNS, ROWS
from splatgl.splat.splats import Splats

# most splats whose lists are kept for the second pass
MOST_HELD = 2**22
# share of tiles that need all samples from which one sample a pixel is not drawn first
MOST_NEEDED = 0.5
# texture units of the picture and of the errors
SINGLE_UNIT, ERRORS_UNIT = 2, 4


class SingleSamples:
    """A picture of one sample a pixel, and the largest error of its means in each tile of all samples."""

    def __init__(self, device: Device) -> None:
        self.ctx, self.programs, self.targets = device.ctx, device.programs, device.targets
        # the picture, and errors by tile; None: all pixels of the current picture take all samples
        self.kept: tuple[RenderTarget, RenderTarget] | None = None

    def begin(self, plan: Plan) -> RenderTarget:
        """Returns an empty target of one sample a pixel."""
        width, height = plan.view.size
        target = self.targets.get("single", (width // plan.samples, height // plan.samples), "rgba32f")
        target.clear()
        return target

    def measure(self, target: RenderTarget, plan: Plan, window: PixelWindow) -> tuple[np.ndarray, float]:
        """Returns bool [rows, columns] of the tiles of samples that need all of them, and their share of those in which
        there is anything. window: pixels that are drawn; the others are 0.
        """
        width, height = plan.view.size
        errors = self.targets.get("errors", (-(-width // COLUMNS), -(-height // ROWS)), "rgba32f")
        program = self.programs.for_screen("edges.frag")
        last = min(window.x + window.width, target.size[0]) - 1, min(window.y + window.height, target.size[1]) - 1
        top = window.y * plan.samples // ROWS
        rows = PixelWindow(0, top, errors.size[0], -(-(last[1] + 1) * plan.samples // ROWS) - top)
        errors.framebuffer.use()
        errors.framebuffer.viewport = rows.box
        self.ctx.enable_only(moderngl.NOTHING)
        target.texture.use(SINGLE_UNIT)
        program["single"], program["samples"], program["inner"] = SINGLE_UNIT, plan.samples, (*window.box[:2], *last)
        cover(program)
        self.kept = target, errors
        # rows beyond these are 0
        error, holds = np.moveaxis(errors.read(rows)[..., :2], 2, 0)
        needed = error > plan.resolved.allowed
        return needed, float(needed.sum() / max(holds.sum(), 1))

    def needed(
        self, plan: Plan, window: PixelWindow, draw: Callable[[RenderTarget, PixelWindow], None], is_probed: bool = True
    ) -> np.ndarray | None:
        """Draws one sample a pixel of a window of samples. Returns bool [rows, columns] of the tiles of samples that
        need all; None if most do. draw: composites a window of a target. is_probed: a row of tiles in the middle
        decides.
        """
        target, (whole, strip) = self.begin(plan), single_windows(window, plan.samples)
        if is_probed:
            draw(target, strip)
            if self.measure(target, plan, strip)[1] > MOST_NEEDED:
                self.kept = None
                return None
            target.clear()
        draw(target, whole)
        return self.measure(target, plan, whole)[0]

    def resolving(self, plan: Plan) -> moderngl.Program:
        """Returns the program of the resolve pass; `kept` is then forgotten."""
        program = self.programs.for_screen("resolve.frag", plan.program, {"SINGLE": self.kept is not None})
        set_uniforms(program, allowed=plan.resolved.allowed, single=SINGLE_UNIT, errors=ERRORS_UNIT)
        for target, unit in zip(self.kept or (), (SINGLE_UNIT, ERRORS_UNIT), strict=False):
            target.texture.use(unit)
        self.kept = None
        return program


def single_windows(window: PixelWindow, k: int) -> tuple[PixelWindow, PixelWindow]:
    """Returns the pixels of a window of k × k samples, in whole tiles of one sample a pixel; and a row of tiles in the
    middle of these.
    """
    x, y, width, height = window.box
    end = -(-(x + width) // k), -(-(y + height) // k)
    (whole,) = bands_of(PixelWindow(x // k, y // k, end[0] - x // k, end[1] - y // k), sys.maxsize)
    middle = whole.y + whole.height // ROWS // 2 * ROWS
    return whole, PixelWindow(whole.x, middle, whole.width, min(ROWS, whole.y + whole.height - middle))


class AdaptiveSamples:
    """Draws sheets in tiles; tiles without edges take one sample per pixel. single: None: all pixels take all
    samples.
    """

    def __init__(self, sheets: SheetTiles, single: SingleSamples | None) -> None:
        self.sheets, self.tiles, self.single = sheets, sheets.tiles, single

    def release(self) -> None:
        """Frees all buffers and textures of sheets; they are recreated on demand."""
        self.sheets.release()

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
        more = {"limits": limits, "exact": limits is not None, "held": True}
        spec = self.sheets.begin_all(target, splats, plan, portions, **more)
        ordered, needed = self.sheets.ordered(spec, splats), None
        if self.single is not None and plan.resolved.allowed and limits is None and len(splats) <= MOST_HELD:
            draw = partial(self._draw_single, spec, splats, ordered)
            # solid volumes are drawn in rounds, whose splats are not held
            needed = self.single.needed(plan, plan.window, draw, is_probed=plan.hiding.depth_batches == 1)
            if needed is None:
                self.tiles.reuse_parts()
        if needed is None:
            self.sheets.draw(spec, splats, ordered)
            return
        # as many samples in a band as there are pixels: the same storage holds the open sheets of both
        pixels = plan.window.width * plan.window.height // plan.samples**2
        for window in bands_of(plan.window, min(max(pixels, 1), MOST_PIXELS)):
            self._draw_needed(replace(spec, needed=needed), splats, window)

    def _draw_single(
        self, spec: Spec, splats: Splats, ordered: Ordered, target: RenderTarget, whole: PixelWindow
    ) -> None:
        """Draws one sample a pixel in bands; `tiles` keeps their splats and lists."""
        self.tiles.reuse_parts()
        spec = replace(spec, target=target, stride=spec.plan.samples)
        for window in bands_of(whole, MOST_PIXELS):
            self.sheets.draw_window(spec, splats, ordered, window)
        while self.tiles.spare:
            self.tiles.spare.pop().release()

    def _draw_needed(self, spec: Spec, splats: Splats, within: PixelWindow) -> None:
        """Composites all samples of needed tiles of a window, by the lists of the tiles of one sample a pixel."""
        k, (across, down), band = spec.plan.samples, tile_counts(within), self.sheets.begin_band(spec, splats, within)
        row, column = within.y // ROWS, within.x // COLUMNS
        steps = np.mgrid[:k, :k].reshape(2, -1)
        for window, placed in self.tiles.parts:
            assert placed.lists is not None
            tile, begin, end, _ = placed.lists.astype(np.int64).T
            rows, columns = np.divmod(tile, tile_counts(window)[0])
            y = (k * (window.y // ROWS + rows) - row)[:, None] + steps[0]
            x = (k * (window.x // COLUMNS + columns) - column)[:, None] + steps[1]
            inside = (y >= 0) & (y < down) & (x >= 0) & (x < across)
            tiles = np.where(inside, y * across + x, 0)
            inside &= ~band.closed[tiles]
            ends = [np.broadcast_to(each[:, None], tiles.shape)[inside] for each in (begin, end)]
            lists = np.stack([tiles[inside], *ends, np.zeros_like(ends[0])], axis=1)
            band.last = placed.last
            placed.use()
            self.tiles.add_up(spec, self.sheets, band, lists.astype(np.uint32), placed)
        self.sheets.flush(spec, band)
