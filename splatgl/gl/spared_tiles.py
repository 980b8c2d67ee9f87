"""Takes one sample a pixel where that is enough: draws it, finds the tiles that need all samples, and draws these."""

from __future__ import annotations

import sys

import moderngl
import numpy as np

from splatgl.gl.buffers import Range, Texels
from splatgl.gl.device import Device
from splatgl.gl.program import cover, set_uniforms
from splatgl.gl.sheet_tiles import MOST_PIXELS, SheetTiles
from splatgl.gl.target import Target
from splatgl.gl.tiles import Band, Placed, bands_of, tile_counts
from splatgl.splat.culling import Window
from splatgl.splat.plan import Plan
from splatgl.splat.splats import Splats
from splatgl.splat.technique import COLUMNS, ROWS

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
        self.kept: tuple[Target, Target] | None = None

    def begin(self, plan: Plan) -> Target:
        """Returns an empty target of one sample a pixel."""
        width, height = plan.view.size
        target = self.targets.get("single", (width // plan.samples, height // plan.samples), "rgba32f")
        target.clear()
        return target

    def measure(self, target: Target, plan: Plan, window: Window) -> tuple[np.ndarray, float]:
        """Returns bool [rows, columns] of the tiles of samples that need all of them, and their share of those in which
        there is anything. window: pixels that are drawn; the others are 0.
        """
        width, height = plan.view.size
        errors = self.targets.get("errors", (-(-width // COLUMNS), -(-height // ROWS)), "rgba32f")
        program = self.programs.for_screen("edges.frag")
        last = min(window.x + window.width, target.size[0]) - 1, min(window.y + window.height, target.size[1]) - 1
        top = window.y * plan.samples // ROWS
        rows = Window(0, top, errors.size[0], -(-(last[1] + 1) * plan.samples // ROWS) - top)
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

    def resolving(self, plan: Plan) -> moderngl.Program:
        """Returns the program of the resolve pass; `kept` is then forgotten."""
        program = self.programs.for_screen("resolve.frag", plan.program, {"SINGLE": self.kept is not None})
        set_uniforms(program, allowed=plan.resolved.allowed, single=SINGLE_UNIT, errors=ERRORS_UNIT)
        for target, unit in zip(self.kept or (), (SINGLE_UNIT, ERRORS_UNIT), strict=False):
            target.texture.use(unit)
        self.kept = None
        return program


def single_windows(window: Window, k: int) -> tuple[Window, Window]:
    """Returns the pixels of a window of k × k samples, in whole tiles of one sample a pixel; and a row of tiles in the
    middle of these.
    """
    x, y, width, height = window.box
    end = -(-(x + width) // k), -(-(y + height) // k)
    (whole,) = bands_of(Window(x // k, y // k, end[0] - x // k, end[1] - y // k), sys.maxsize)
    middle = whole.y + whole.height // ROWS // 2 * ROWS
    return whole, Window(whole.x, middle, whole.width, min(ROWS, whole.y + whole.height - middle))


class SparedTiles(SheetTiles):
    """Draws sheets in tiles, of which those without edges take one sample a pixel."""

    # None: pixels take all samples
    single: SingleSamples | None = None

    def __init__(self, device: Device) -> None:
        super().__init__(device)
        # splats and lists of the bands of one sample a pixel; and those that are reused next, the last first
        self.parts, self.spare = list[tuple[Window, Placed]](), list[Placed]()

    def release(self) -> None:
        """Frees all buffers and textures; they are recreated on demand."""
        super().release()
        for placed in (*self.spare, *(placed for _, placed in self.parts)):
            placed.release()
        self.parts, self.spare = [], []

    def _draw_sorted(self, target: Target, splats: Splats, plan: Plan, texels: Texels) -> None:
        needed = None
        if self.single is not None and plan.resolved.allowed and self.limits is None and len(splats) <= MOST_HELD:
            needed = self._draw_single(self.single, splats, plan, texels)
        if needed is None:
            super()._draw_sorted(target, splats, plan, texels)
            return
        # as many samples in a band as there are pixels: the same storage holds the open sheets of both
        pixels = plan.window.width * plan.window.height // plan.samples**2
        for window in bands_of(plan.window, min(max(pixels, 1), MOST_PIXELS)):
            self._draw_needed(target, plan, self._begin(splats, plan, window), needed)

    def _draw_single(self, single: SingleSamples, splats: Splats, plan: Plan, texels: Texels) -> np.ndarray | None:
        """Draws one sample a pixel. Returns bool [rows, columns] of the tiles of samples that need all; None if most
        do: of volumes that are not solid a row of tiles in the middle tells.
        """
        target, (whole, strip) = single.begin(plan), single_windows(plan.window, plan.samples)
        try:
            self.stride = plan.samples
            if plan.hiding.depth_batches == 1:
                self._draw_bands(target, splats, plan, texels, [strip])
                if single.measure(target, plan, strip)[1] > MOST_NEEDED:
                    single.kept = None
                    self._reuse_parts()
                    return None
                target.clear()
            self._draw_bands(target, splats, plan, texels, bands_of(whole, MOST_PIXELS))
        finally:
            self.stride = 1
        return single.measure(target, plan, whole)[0]

    def _draw_bands(self, target: Target, splats: Splats, plan: Plan, texels: Texels, bands: list[Window]) -> None:
        """Draws one sample a pixel in bands; keeps their splats and lists in `parts`."""
        self._reuse_parts()
        for window in bands:
            self._draw_window(target, splats, plan, texels, window)
        while self.spare:
            self.spare.pop().release()

    def _reuse_parts(self) -> None:
        """Makes the splats and lists of `parts` those that are reused next, in their order."""
        self.spare = [*self.spare, self.placed, *(placed for _, placed in reversed(self.parts))]
        self.placed, self.parts = self.spare.pop(), []

    def _place(self, plan: Plan, texels: Texels, which: Range) -> int:
        held = self.placed.held
        if held is None or held[0] is not texels or held[1] != which:
            # placing may be cancelled
            self.placed.held = None
            count = super()._place(plan, texels, which)
            self.placed.held = texels, which
            return count
        self.placed.use()
        return which[1] - which[0]

    def _unlisted(self) -> np.ndarray:
        if self.stride == 1:
            return self.band.closed
        # samples at the edges of a tile may pass one that is closed at its pixels' centres
        across, down = tile_counts(self.band.window)
        open_ = np.pad(~self.band.closed.reshape(down, across), 1)
        for axis in (0, 1):
            open_ = open_ | np.roll(open_, 1, axis) | np.roll(open_, -1, axis)
        return np.asarray(~open_[1:-1, 1:-1].ravel())

    def _add_up_all(self, target: Target, plan: Plan, lists: np.ndarray) -> None:
        if self.stride == 1:
            super()._add_up_all(target, plan, lists)
            return
        self.placed.lists, self.placed.last = lists, self.last
        super()._add_up_all(target, plan, lists[~self.band.closed[lists[:, 0]]])
        # only now: a cancelled picture keeps what is placed in one place
        self.parts.append((self.band.window, self.placed))
        self.placed = self.spare.pop() if self.spare else Placed()

    def _draw_needed(self, target: Target, plan: Plan, band: Band, needed: np.ndarray) -> None:
        """Composites all samples of the tiles `needed` of a band, by the lists of the tiles of one sample a pixel."""
        k, (across, down), own = plan.samples, tile_counts(band.window), self.placed
        row, column = band.window.y // ROWS, band.window.x // COLUMNS
        band.closed |= ~needed[row : row + down, column : column + across].ravel()
        steps = np.mgrid[:k, :k].reshape(2, -1)
        for window, placed in self.parts:
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
            self.placed, self.last = placed, placed.last
            placed.use()
            try:
                self._add_up_all(target, plan, lists.astype(np.uint32))
            finally:
                self.placed = own
        self._flush(target, plan)
