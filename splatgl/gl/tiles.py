"""Draws splats in tiles of pixels: projects the splats, lists them by tile, and composites each tile's list.

A tile's pixels stay in registers while its splats are composited front to back; a tile terminates once almost no light
passes. This avoids sorting, quad setup and blending; setup and blending take most of a quad's time in software OpenGL.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from itertools import pairwise
from typing import Protocol

import moderngl
import numpy as np

from splatgl.gl.buffers import (
    Buffers,
    DrawOrder,
    Range,
    SplatTexels,
    chunks,
    clear_buffer,
    free,
    order_texture,
    texel_texture,
    uneven,
    write_words,
)
from splatgl.gl.card_lists import MOST_BAND, MOST_SPLATS, CardLists
from splatgl.gl.device import Device
from splatgl.gl.features import Uniforms, feature_uniforms
from splatgl.gl.meshes import LIMIT_UNITS, DepthLimits
from splatgl.gl.program import Programs, cover, set_uniforms
from splatgl.gl.shader import ABREAST, LISTED, NOWHERE
from splatgl.gl.target import Portions, RenderTarget
from splatgl.gl.textures import HALF_LINE_UNIT
from splatgl.planning.culling import BLOCK, Frustum, PixelWindow, blocks_in_frustum
from splatgl.planning.plan import Plan, Program
from splatgl.planning.technique import COLUMNS, MOST, MOST_PIXELS, ROWS, batch_starts
from splatgl.splat.kernels import single_reach
from splatgl.splat.splats import MOST_KEPT, Splats

# maximum number of entries of all lists together
MOST_LISTED = 2**25
# work groups of the listing pass; each invocation lists one run of splats
GROUPS = min(os.cpu_count() or 1, 8)
# llvmpipe ends a loop after 65535 iterations: longer loops take several dispatches
ROUNDS = 60_000
# maximum per dispatch: tiles (every OpenGL allows this many groups along x) and list entries (0.1 s of work)
MOST_TILES, ENTRIES = 65_535, 2**20
# texture units of the placed splats, the list, and the records with their order
PLACED_UNIT, LIST_UNIT, RECORDS_UNIT = 8, 5, 5
# bindings of storage buffers; image units of the target, before those of heads and shapes, and of what is listed
CURSORS, DONE, LISTS, OPEN, LISTED_BUFFER, IMAGE, BOUNDS = 0, 1, 2, 3, 6, 0, 0
# textures of placed splats, see tiles.glsl; a program uses the first three to seven, see `_textures`
PLACED = ("bounds", "heads", "shapes", "matters", "bends", "cubics", "mixeds")


@dataclass(eq=False)
class TileBand:
    """Band of rows of the picture. closed: mask of terminated tiles. begun: whether nearer splats are drawn already.
    stride: pixels of the view from one sample to the next; the window is in these samples.

    Of sheets: end: the splat before which the picture's last one is; last: whether it is drawn. drawn: mask of tiles of
    which splats are listed; kept: of those whose open sheets are stored, None: there is no storage.
    """

    window: PixelWindow
    closed: np.ndarray
    drawn: np.ndarray
    begun: bool = False
    stride: int = 1
    end: int = -1
    last: bool = False
    kept: np.ndarray | None = None

    @classmethod
    def of(cls, window: PixelWindow, stride: int = 1) -> TileBand:
        """A new band, all of its tiles open."""
        across, down = tile_counts(window)
        return cls(window, np.zeros(across * down, bool), np.zeros(across * down, bool), stride=stride)


@dataclass(frozen=True, eq=False)
class Spec:
    """How splats are drawn in tiles of a target. uniforms: set in each program. drawing: shader that adds up lists, and
    its switches. limits: depths between which the volume is drawn; None: all. keeping: sets up that shader to store the
    matter of a layer. stride: of bands. needed: mask of the picture's tiles that are drawn; None: all. exact: whether a
    card reads how many pairs each part has, instead of drawing again what did not fit. held: whether projected splats
    are used again, those of a stride above 1 with their lists.
    """

    target: RenderTarget
    plan: Plan
    portions: Portions
    uniforms: Uniforms
    drawing: str
    switches: dict[str, bool]
    limits: DepthLimits | None = None
    keeping: Callable[[moderngl.ComputeShader], None] | None = None
    stride: int = 1
    needed: np.ndarray | None = None
    exact: bool = False
    held: bool = False

    def compiled(
        self, programs: Programs, band: TileBand, name: str, switches: Mapping[str, bool]
    ) -> moderngl.ComputeShader:
        """Returns a compute shader with the uniforms of a band."""
        is_drawing = name == self.drawing
        program = programs.for_tiles(name, self.plan.program, {**switches, **(self.switches if is_drawing else {})})
        set_uniforms(program, origin=band.window.box[:2], tiles=tile_counts(band.window), stride=band.stride)
        set_uniforms(program, **{placed: PLACED_UNIT + unit for unit, placed in enumerate(PLACED)}, **self.uniforms)
        if self.limits is not None:
            set_uniforms(program, **LIMIT_UNITS)
            self.limits.use()
        if self.keeping is not None and is_drawing:
            self.keeping(program)
        return program


@dataclass(eq=False)
class ProjectedSplats:
    """Splats in textures, and the texture of their lists by tile. held: the records and their range that are projected.
    lists: as `Lister.count` returns them. last: whether no other splats follow.
    """

    textures: list[moderngl.Texture] = field(default_factory=list)
    framebuffer: moderngl.Framebuffer | None = None
    list: moderngl.Texture | None = None
    held: tuple[SplatTexels, Range] | None = None
    lists: np.ndarray | None = None
    last: bool = False

    def use(self) -> None:
        """Binds the textures of splats."""
        for unit, texture in enumerate(self.textures):
            texture.use(PLACED_UNIT + unit)

    def release(self) -> None:
        """Frees the textures."""
        free(self.framebuffer, *self.textures, self.list)


class Adder(Protocol):
    """Adds up the listed splats of tiles in a target."""

    def add_up(self, spec: Spec, band: TileBand, placed: ProjectedSplats, lists: np.ndarray) -> None:
        """Adds up lists, as `Lister.count` returns them."""

    def composite(self, spec: Spec, band: TileBand, card: CardLists, last: bool) -> None:
        """Adds up the lists that a card has bound. last: of the splats that are projected."""


class Projector:
    """Projects splats into textures."""

    def __init__(self, device: Device) -> None:
        self.ctx, self.programs, self.compute = device.ctx, device.programs, device.compute
        self.blocks: moderngl.Texture | None = None

    def release(self) -> None:
        """Frees the texture of visible blocks; it is recreated on demand."""
        free(self.blocks)
        self.blocks = None

    def project(
        self, spec: Spec, into: ProjectedSplats, texels: SplatTexels, which: Range, shown: np.ndarray | None = None
    ) -> int:
        """Projects splats `which` of their order, unless they are held; binds them and returns their number. shown:
        mask of the order's blocks that may be visible; None: all.
        """
        held = into.held
        if spec.held and held is not None and held[0] is texels and held[1] == which:
            into.use()
            return which[1] - which[0]
        # projecting may be cancelled
        into.held, count = None, which[1] - which[0]
        if shown is not None:
            first = which[0] // BLOCK
            blocks = first + np.flatnonzero(shown[first : -(-which[1] // BLOCK)])
            self.blocks = order_texture(self.ctx, self.blocks, blocks.size)
            write_words(self.blocks, blocks.astype(np.uint32)[:, None])
            count = blocks.size * BLOCK
        switches = {"ORDERED": texels.order is not None, "CULLED": shown is not None, "COMPUTE": self.compute}
        program = self._program(spec, switches)
        height = max(-(-count // ABREAST), 1)
        self._make(into, _textures(spec.plan.program), height)
        read = {"records": texels.records, "rest": texels.rest, "order": texels.order, "blocks": self.blocks}
        for unit, (name, texture) in enumerate(read.items()):
            if texture is not None:
                texture.use(RECORDS_UNIT + unit)
                set_uniforms(program, **{name: RECORDS_UNIT + unit})
        set_uniforms(program, first=which[0], end=which[1])
        assert into.framebuffer is not None
        into.framebuffer.use()
        into.framebuffer.viewport = (0, 0, ABREAST, height)
        self.ctx.enable_only(moderngl.NOTHING)
        for top, bottom in spec.portions.parts("placing", range(1, height + 1), height):
            into.framebuffer.use()
            into.framebuffer.scissor = 0, top, ABREAST, bottom - top
            cover(program)
        into.use()
        into.held = texels, which
        return count

    def _program(self, spec: Spec, switches: dict[str, bool]) -> moderngl.Program:
        plan = spec.plan
        program = self.programs.for_screen("tile_project.frag", plan.program, switches)
        single = plan.program.footprint == "single"
        reach = single_reach(plan.kernel.name, plan.resolved.tolerance) if single else 1.0
        set_uniforms(program, reach=reach, **spec.uniforms)
        return program

    def _make(self, into: ProjectedSplats, number: int, height: int) -> None:
        """Makes so many textures of so many rows, unless there are."""
        old = into.framebuffer, *into.textures
        if len(into.textures) < number or into.textures[0].height < height:
            size = ABREAST, uneven(height)
            into.textures = [texel_texture(self.ctx, size, 4, "u4") for _ in range(max(number, len(into.textures)))]
            into.framebuffer = self.ctx.framebuffer(into.textures)
            free(*old)


class Lister:
    """Lists projected splats by tile, without a card."""

    def __init__(self, device: Device, buffers: Buffers) -> None:
        self.ctx, self.programs, self.buffers = device.ctx, device.programs, buffers

    def count(self, spec: Spec, band: TileBand, placed: ProjectedSplats, count: int) -> np.ndarray | None:
        """Returns (tile, begin, end, 0) of each non-empty list, uint32 [lists, 4]; None beyond MOST_LISTED entries.

        Sets the cursors to the start of each run's part of each list.
        """
        across, down = tile_counts(band.window)
        runs = GROUPS * self.programs.shape.lanes
        # plus a slot for splats that touch no tile
        size = runs * (across * down + 1) * 4
        cursors = self.buffers.bind(CURSORS, size)
        clear_buffer(cursors, size)
        self._run(spec, band, placed, count, {"COUNTING": True})
        counts = np.frombuffer(cursors.read(size), np.uint32).reshape(runs, across * down + 1)
        # of tiles with splats, often a few
        nonempty = np.flatnonzero(counts[:, :-1].any(axis=0) & ~unlisted_tiles(spec, band))
        counts = np.take(counts, nonempty, axis=1)
        # ordered by tile, then by run
        until = np.cumsum(counts, axis=0, dtype=np.uint32)
        lengths = until[-1].astype(np.int64)
        # each list starts at a multiple of four: shaders read four entries at once
        padded_ends = np.cumsum(-(-lengths // 4) * 4)
        if len(nonempty) and padded_ends[-1] > MOST_LISTED and count > 1:
            return None
        begins = padded_ends - (-(-lengths // 4) * 4)
        starts = np.full((runs, across * down + 1), NOWHERE, np.uint32)
        starts[:, nonempty] = until - counts + begins.astype(np.uint32)
        cursors.write(starts)
        return np.stack([nonempty, begins, begins + lengths, np.zeros_like(begins)], axis=1).astype(np.uint32)

    def list(self, spec: Spec, band: TileBand, placed: ProjectedSplats, count: int, total: int) -> None:
        """Lists the splats that were counted, of `total` entries."""
        # plus an entry that is never read
        height = (total + 4) // (LISTED * 4) + 1
        listed = self.buffers.bind(LISTED_BUFFER, height * LISTED * 16)
        self._run(spec, band, placed, count, {"COUNTING": False}, total + 4)
        texture = placed.list
        if texture is None or texture.height < height:
            free(texture)
            texture = placed.list = texel_texture(self.ctx, (LISTED, uneven(height)), 4, "u4")
        # copied: llvmpipe reads textures faster than buffers, and writes buffers faster than images
        texture.write(listed, viewport=(0, 0, LISTED, height))

    def _run(
        self,
        spec: Spec,
        band: TileBand,
        placed: ProjectedSplats,
        count: int,
        switches: dict[str, bool],
        unread: int = 0,
    ) -> None:
        """Lists all splats, with at most ROUNDS iterations per dispatch. unread: a list entry that is never read."""
        program = spec.compiled(self.programs, band, "tile_list.comp", switches)
        placed.textures[0].bind_to_image(BOUNDS, read=True, write=False)
        runs = GROUPS * self.programs.shape.lanes
        length = -(-count // runs)
        set_uniforms(program, count=count, length_=length, unread=unread)
        lengths = np.clip(count - length * np.arange(runs), 0, length)
        # per run: splats done, and progress of the next splat, as a large splat may need several dispatches
        done = self.buffers.bind(DONE, lengths.size * 16)
        clear_buffer(done)
        progress = np.zeros((lengths.size, 4), np.uint32)
        for begin, end in spec.portions.parts("listing", range(1, sys.maxsize), ROUNDS):
            set_uniforms(program, budget=min(end - begin, ROUNDS))
            program.run(GROUPS)
            self.ctx.memory_barrier()
            before, progress = progress, np.frombuffer(done.read(lengths.size * 16), np.uint32).reshape(-1, 4)
            if not (progress[:, 0] < lengths).any():
                return
            if (progress == before).all():
                raise moderngl.Error("compute shaders do nothing")


class Tiles:
    """Projects splats, lists them by tile and adds up the lists; keeps buffers and textures between pictures."""

    def __init__(self, device: Device) -> None:
        self.programs, self.card = device.programs, device.card
        self.buffers = Buffers(device.ctx)
        self.projector, self.lister = Projector(device), Lister(device, self.buffers)
        # splats that are drawn; those of bands that are held, with their lists; those to use next, the last first
        self.placed = ProjectedSplats()
        self.parts, self.spare = list[tuple[PixelWindow, ProjectedSplats]](), list[ProjectedSplats]()

    def release(self) -> None:
        """Frees all buffers and textures; they are recreated on demand."""
        free(self.buffers, self.projector, self.placed, *self.spare, *(placed for _, placed in self.parts))
        self.placed, self.parts, self.spare = ProjectedSplats(), [], []

    def reuse_parts(self) -> None:
        """Makes the splats and lists of `parts` those that are used next, in their order."""
        self.spare = [*self.spare, self.placed, *(placed for _, placed in reversed(self.parts))]
        self.placed, self.parts = self.spare.pop(), []

    def gather(
        self,
        spec: Spec,
        adder: Adder,
        texels: SplatTexels,
        which: Range,
        band: TileBand,
        shown: np.ndarray | None = None,
    ) -> None:
        """Composites splats `which` of the drawing order, nearest first, behind the splats already in the band.

        shown: mask of the order's blocks that may be visible; None: all.
        """
        begin, end = which
        # smaller parts of many splats: the buffers then need little memory compared with the splats
        most = MOST if end - begin <= 2 * MOST else MOST // 2
        if self.card is not None:
            most = min(most, MOST_SPLATS)
        for first in range(begin, end if band.closed.size else begin, most):
            self._draw(spec, adder, texels, (first, min(first + most, end)), band, shown)

    def add_up(
        self, spec: Spec, adder: Adder, band: TileBand, lists: np.ndarray, placed: ProjectedSplats | None = None
    ) -> None:
        """Adds up lists in portions. placed: their splats; None: those that are projected."""
        # an empty list costs as much as makes MOST_TILES of them a dispatch
        costs = np.cumsum(lists[:, 2].astype(np.int64) - lists[:, 1] + max(ENTRIES // MOST_TILES, 1))
        for begin, end in spec.portions.parts("lists", costs, ENTRIES):
            adder.add_up(spec, band, placed or self.placed, lists[begin:end])

    def bind_images(self, target: RenderTarget, placed: ProjectedSplats | None = None) -> None:
        """Binds the target as the image that tiles read and write, and what they only read as others."""
        target.texture.bind_to_image(IMAGE, read=True, write=True)
        if self.card is None:
            for unit, texture in enumerate((placed or self.placed).textures[1:3], IMAGE + 1):
                texture.bind_to_image(unit, read=True, write=False)

    def _draw(
        self, spec: Spec, adder: Adder, texels: SplatTexels, which: Range, band: TileBand, shown: np.ndarray | None
    ) -> None:
        band.last = which[1] == band.end
        count = self.projector.project(spec, self.placed, texels, which, shown)
        if self.card is not None:
            self._draw_on_card(spec, adder, self.card, band, (which[0], count))
            return
        lists = self.lister.count(spec, band, self.placed, count) if count else np.zeros((0, 4), np.uint32)
        if lists is None:
            middle = (which[0] + which[1]) // 2
            self._draw(spec, adder, texels, (which[0], middle), band, shown)
            self._draw(spec, adder, texels, (middle, which[1]), band, shown)
        elif len(lists):
            self.lister.list(spec, band, self.placed, count, int(lists[-1, 2]))
            self._add_up_listed(spec, adder, band, lists)

    def _add_up_listed(self, spec: Spec, adder: Adder, band: TileBand, lists: np.ndarray) -> None:
        is_kept = spec.held and spec.stride > 1
        if is_kept:
            self.placed.lists, self.placed.last = lists, band.last
            lists = lists[~band.closed[lists[:, 0]]]
        self.add_up(spec, adder, band, lists)
        band.begun = True
        if is_kept:
            # only now: a cancelled picture keeps what is projected in one place
            self.parts.append((band.window, self.placed))
            self.placed = self.spare.pop() if self.spare else ProjectedSplats()

    def _draw_on_card(self, spec: Spec, adder: Adder, card: CardLists, band: TileBand, part: Range) -> None:
        """Composites projected splats; only the device knows the lists. part: the first, and their number."""
        program = partial(spec.compiled, self.programs, band)
        spec.portions.ask()
        if not band.begun:
            card.begin(band.closed)
        card.count_pairs(program, *part)
        if spec.exact:
            band.closed = card.read()
        for sort in range(card.sorts):
            card.list_tiles(program, sort)
            adder.composite(spec, band, card, last=sort == card.sorts - 1)


class SplatTiles:
    """Draws splats one by one, or boxes, in tiles."""

    def __init__(self, device: Device, tiles: Tiles) -> None:
        self.device, self.tiles = device, tiles

    def release(self) -> None:
        """Does nothing: buffers and textures are those of `tiles`."""

    def draw(
        self,
        target: RenderTarget,
        splats: Splats,
        plan: Plan,
        order: DrawOrder,
        portions: Portions,
        limits: DepthLimits | None = None,
        keeping: Callable[[moderngl.ComputeShader], None] | None = None,
    ) -> None:
        """Composites the splats into `target`, nearest first, in chunks; raises Interrupted if cancelled. limits,
        keeping: of boxes, as in Spec.
        """
        card, spec = self.device.card, self._spec(target, splats, plan, portions, limits, keeping)
        if card is not None:
            card.set_entries(0)
        frustum, fits = Frustum.of(plan.view), len(splats) <= MOST_KEPT
        batches = pairwise(batch_starts(len(splats), plan.hiding.depth_batches))
        parts = [chunk for batch in batches for chunk in chunks(batch)]
        widest = MOST_PIXELS if card is None else MOST_BAND
        bands = [TileBand.of(window) for window in bands_of(plan.window, widest)]
        steps = [(part, band) for part in parts for band in bands]
        if card is not None:
            # it has the states of one band's tiles
            steps = [(part, band) for band in bands for part in parts]
        visible, texels, last = None, None, None
        for (begin, end), band in steps:
            portions.ask()
            if texels is None or (begin, end) != last:
                kept = self.device.splats.of(splats)
                texels = kept.texels(plan.program.runs, order, None if fits else (begin, end))
                visible, last = None if texels.boxes is None else blocks_in_frustum(texels.boxes, frustum), (begin, end)
                if visible is not None and visible.all():
                    visible = None
            first = 0 if fits else begin
            self.tiles.gather(spec, self, texels, (begin - first, end - first), band, visible)

    def _spec(
        self,
        target: RenderTarget,
        splats: Splats,
        plan: Plan,
        portions: Portions,
        limits: DepthLimits | None,
        keeping: Callable[[moderngl.ComputeShader], None] | None,
    ) -> Spec:
        uniforms = feature_uniforms(splats, plan)
        if not plan.resolved.boxes:
            return Spec(target, plan, portions, uniforms, "tile_draw.comp", {})
        if limits is not None:
            uniforms = uniforms | {"depth_unit": limits.unit / splats.grid.mean_spacing}
        switches = {"LIMITED": limits is not None, "LAYERED": keeping is not None}
        exact = any(switches.values())
        return Spec(target, plan, portions, uniforms, "box_draw.comp", switches, limits, keeping, exact=exact)

    def add_up(self, spec: Spec, band: TileBand, placed: ProjectedSplats, lists: np.ndarray) -> None:
        """Adds up lists."""
        carried, buffers, plan = band.begun, self.tiles.buffers, spec.plan
        if placed.list is not None:
            placed.list.use(LIST_UNIT)
        self.tiles.bind_images(spec.target, placed)
        while len(lists):
            program = spec.compiled(self.device.programs, band, spec.drawing, {"CARRIED": carried})
            set_uniforms(program, half_table=HALF_LINE_UNIT, list=LIST_UNIT, opaque=1.0 - plan.hiding.cutoff)
            part = lists.copy()
            part[:, 2] = np.minimum(lists[:, 2], lists[:, 1] + 4 * ROUNDS)
            buffers.bind(LISTS, part.nbytes).write(part)
            flags = buffers.bind(OPEN, band.closed.size * 4)
            clear_buffer(flags)
            program.run(len(part))
            self.device.ctx.memory_barrier()
            lists[:, 1] = part[:, 2]
            lists, carried = lists[lists[:, 1] < lists[:, 2]], True
        if plan.program.appearance.hides:
            open_ = np.frombuffer(flags.read(band.closed.size * 4), np.uint32)[part[:, 0]]
            band.closed[part[open_ == 0, 0]] = True

    def composite(self, spec: Spec, band: TileBand, card: CardLists, last: bool) -> None:
        """Composites the lists that are bound."""
        program = spec.compiled(self.device.programs, band, spec.drawing, {"CARRIED": band.begun})
        set_uniforms(program, half_table=HALF_LINE_UNIT, opaque=1.0 - spec.plan.hiding.cutoff)
        self.tiles.bind_images(spec.target)
        program.run(band.closed.size)
        self.device.ctx.memory_barrier()
        band.begun = True


def unlisted_tiles(spec: Spec, band: TileBand) -> np.ndarray:
    """Returns the mask of the band's tiles that need no lists."""
    if not spec.held or band.stride == 1:
        return band.closed
    # samples at the edges of a tile may pass one that is closed at its pixels' centres
    across, down = tile_counts(band.window)
    open_ = np.pad(~band.closed.reshape(down, across), 1)
    for axis in (0, 1):
        open_ = open_ | np.roll(open_, 1, axis) | np.roll(open_, -1, axis)
    return np.asarray(~open_[1:-1, 1:-1].ravel())


def bands_of(window: PixelWindow, most: int = MOST_PIXELS) -> list[PixelWindow]:
    """Splits a window into bands of at most `most` pixels; a pixel is in the same tile for any window."""
    left, top = window.x // COLUMNS * COLUMNS, window.y // ROWS * ROWS
    width, last = window.x + window.width - left, window.y + window.height
    height = max(most // max(width, 1) // ROWS, 1) * ROWS
    return [PixelWindow(left, first, width, min(height, last - first)) for first in range(top, last, height)]


def tile_counts(window: PixelWindow) -> tuple[int, int]:
    """Returns the numbers of tiles along x and y."""
    return -(-window.width // COLUMNS), -(-window.height // ROWS)


def _textures(program: Program) -> int:
    """Returns the number of textures of placed splats; see BENT in tiles.glsl."""
    if program.bent:
        return 5 if program.seen.cubic else 7
    return 4 if program.appearance.sheets and not program.packed else 3
