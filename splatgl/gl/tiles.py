"""Draws splats in tiles of pixels: places the splats, lists them by tile, and composites each tile's list.

A tile's pixels stay in registers while its splats are composited front to back; a tile terminates once almost no light
passes. This avoids sorting, quad setup and blending; setup and blending take most of a quad's time in software OpenGL.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import pairwise

import moderngl
import numpy as np

from splatgl.gl.buffers import (
    DrawOrder,
    Range,
    Texels,
    chunks,
    clear_buffer,
    free,
    grow_buffer,
    texel_texture,
    uneven,
)
from splatgl.gl.card_lists import MOST_BAND, MOST_SPLATS, CardLists
from splatgl.gl.device import Device
from splatgl.gl.features import Uniforms, feature_uniforms
from splatgl.gl.program import cover, set_uniforms
from splatgl.gl.shader import ABREAST, LISTED, NOWHERE
from splatgl.gl.target import Portions, Target
from splatgl.gl.textures import HALF_LINE_UNIT
from splatgl.splat.culling import BLOCK, Frustum, Window, blocks_in_frustum
from splatgl.splat.kernels import single_reach
from splatgl.splat.plan import Plan, Program
from splatgl.splat.splats import MOST_KEPT, Splats
from splatgl.splat.technique import COLUMNS, MOST, MOST_PIXELS, ROWS, batch_starts

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
CURSORS, DONE, LISTS, OPEN, BLOCKS, LISTED_BUFFER, IMAGE, BOUNDS = 0, 1, 2, 3, 4, 6, 0, 0
# textures of placed splats, see tiles.glsl; a program uses the first three to seven, see `_textures`
PLACED = ("bounds", "heads", "shapes", "matters", "bends", "cubics", "mixeds")


@dataclass(eq=False)
class Band:
    """Band of rows of the picture. closed: mask of terminated tiles. begun: whether nearer splats are drawn already.
    stride: pixels of the view from one sample to the next; the window is in these samples.
    """

    window: Window
    closed: np.ndarray
    begun: bool = False
    stride: int = 1


@dataclass(eq=False)
class Placed:
    """Splats in textures, and the texture of their lists by tile. held: the records and their range that are placed.
    lists: as `Tiles._count` returns them. last: whether no other splats follow.
    """

    textures: list[moderngl.Texture] = field(default_factory=list)
    framebuffer: moderngl.Framebuffer | None = None
    list: moderngl.Texture | None = None
    held: tuple[Texels, Range] | None = None
    lists: np.ndarray | None = None
    last: bool = False

    def use(self) -> None:
        """Binds the textures of splats."""
        for unit, texture in enumerate(self.textures):
            texture.use(PLACED_UNIT + unit)

    def release(self) -> None:
        """Frees the textures."""
        free(self.framebuffer, *self.textures, self.list)


class Tiles:
    """Draws splats in tiles; caches buffers and textures."""

    # shader that composites tiles
    drawing = "tile_draw.comp"
    # whether a card reads how many pairs each part has, instead of drawing again what did not fit
    exact = False
    # uniforms of the picture, set in each program
    uniforms: Uniforms

    def __init__(self, device: Device) -> None:
        self.ctx, self.programs, self.splats, self.card = device.ctx, device.programs, device.splats, device.card
        self.placed = Placed()
        self.buffers: dict[int, moderngl.Buffer] = {}
        self.band = Band(Window(0, 0, 0, 0), np.zeros(0, bool))
        # of the current picture
        self.portions = Portions(device.ctx)
        # mask of the blocks of the drawing order that may be visible; None: all
        self.shown: np.ndarray | None = None

    def release(self) -> None:
        """Frees all buffers and textures; they are recreated on demand."""
        self.placed.release()
        for buffer in self.buffers.values():
            buffer.release()
        self.placed, self.buffers = Placed(), {}

    def draw(self, target: Target, splats: Splats, plan: Plan, order: DrawOrder, portions: Portions) -> None:
        """Composites the splats into `target`, nearest first, in chunks; raises Interrupted if cancelled."""
        self.uniforms, self.portions = self._uniforms(splats, plan), portions
        if self.card is not None:
            self.card.set_entries(0)
        frustum, fits = Frustum.of(plan.view), len(splats) <= MOST_KEPT
        batches = pairwise(batch_starts(len(splats), plan.hiding.depth_batches))
        parts = [chunk for batch in batches for chunk in chunks(batch)]
        widest = MOST_PIXELS if self.card is None else MOST_BAND
        bands = [self.begin(window) for window in bands_of(plan.window, widest)]
        steps = [(part, band) for part in parts for band in bands]
        if self.card is not None:
            # it has the states of one band's tiles
            steps = [(part, band) for band in bands for part in parts]
        visible, texels, last = None, None, None
        for (begin, end), band in steps:
            portions.ask()
            if texels is None or (begin, end) != last:
                texels = self.splats.of(splats).texels(plan.program.runs, order, None if fits else (begin, end))
                visible, last = None if texels.boxes is None else blocks_in_frustum(texels.boxes, frustum), (begin, end)
                if visible is not None and visible.all():
                    visible = None
            first = 0 if fits else begin
            self.gather(target, plan, texels, (begin - first, end - first), band, visible)

    def _uniforms(self, splats: Splats, plan: Plan) -> Uniforms:
        return feature_uniforms(splats, plan)

    def begin(self, window: Window) -> Band:
        """Returns a new band, all of its tiles open."""
        across, down = tile_counts(window)
        return Band(window, np.zeros(across * down, bool))

    def gather(
        self,
        target: Target,
        plan: Plan,
        texels: Texels,
        which: Range,
        band: Band,
        shown: np.ndarray | None = None,
    ) -> None:
        """Composites splats `which` of the drawing order, nearest first, behind the splats already in the band.

        shown: mask of the order's blocks that may be visible; None: all.
        """
        self.shown, self.band = shown, band
        begin, end = which
        # smaller parts of many splats: the buffers then need little memory compared with the splats
        most = MOST if end - begin <= 2 * MOST else MOST // 2
        if self.card is not None:
            most = min(most, MOST_SPLATS)
        for first in range(begin, end if band.closed.size else begin, most):
            self._draw(target, plan, texels, (first, min(first + most, end)))

    def _draw(self, target: Target, plan: Plan, texels: Texels, which: Range) -> None:
        count = self._place(plan, texels, which)
        if self.card is not None:
            self._draw_on_card(self.card, target, plan, which[0], count)
            return
        lists = self._count(plan, count) if count else np.zeros((0, 4), np.uint32)
        if lists is None:
            middle = (which[0] + which[1]) // 2
            self._draw(target, plan, texels, (which[0], middle))
            self._draw(target, plan, texels, (middle, which[1]))
        elif len(lists):
            self._list(plan, count, int(lists[-1, 2]))
            self._add_up_all(target, plan, lists)

    def _add_up_all(self, target: Target, plan: Plan, lists: np.ndarray) -> None:
        self._add_up_parts(target, plan, lists)
        self.band.begun = True

    def _add_up_parts(self, target: Target, plan: Plan, lists: np.ndarray) -> None:
        # an empty list costs as much as makes MOST_TILES of them a dispatch
        costs = np.cumsum(lists[:, 2].astype(np.int64) - lists[:, 1] + max(ENTRIES // MOST_TILES, 1))
        for begin, end in self.portions.parts("lists", costs, ENTRIES):
            self._add_up(target, plan, lists[begin:end])

    def _draw_on_card(self, card: CardLists, target: Target, plan: Plan, first: int, count: int) -> None:
        """Composites `count` placed splats, from `first` of their order on; only the device knows the lists."""

        def program(name: str, switches: Mapping[str, bool]) -> moderngl.ComputeShader:
            return self._program(name, plan, dict(switches))

        self.portions.ask()
        if not self.band.begun:
            card.begin(self.band.closed)
        card.count_pairs(program, first, count)
        if self.exact:
            self.band.closed = card.read()
        for sort in range(card.sorts):
            card.list_tiles(program, sort)
            self._composite(card, target, plan, last=sort == card.sorts - 1)

    def _composite(self, card: CardLists, target: Target, plan: Plan, last: bool) -> None:
        """Composites the lists that are bound. last: of these splats."""
        program = self._program(self.drawing, plan, {"CARRIED": self.band.begun})
        set_uniforms(program, half_table=HALF_LINE_UNIT, opaque=1.0 - plan.hiding.cutoff)
        self.bind_target(target)
        program.run(self.band.closed.size)
        self.ctx.memory_barrier()
        self.band.begun = True

    def _place(self, plan: Plan, texels: Texels, which: Range) -> int:
        """Places the splats (projects them into textures); returns their number."""
        count = which[1] - which[0]
        if self.shown is not None:
            first = which[0] // BLOCK
            blocks = first + np.flatnonzero(self.shown[first : -(-which[1] // BLOCK)])
            self._buffer(BLOCKS, max(blocks.size, 1) * 4).write(blocks.astype(np.uint32))
            count = blocks.size * BLOCK
        switches = {"ORDERED": texels.order is not None, "CULLED": self.shown is not None}
        program = self._placing(plan, switches)
        number = _textures(plan.program)
        height = max(-(-count // ABREAST), 1)
        textures = self.placed.textures
        if len(textures) < number or textures[0].height < height:
            self._make_placed(max(number, len(textures)), height)
        for unit, texture in enumerate((texels.records, texels.rest, texels.order)):
            if texture is not None:
                texture.use(RECORDS_UNIT + unit)
        set_uniforms(program, records=RECORDS_UNIT, rest=RECORDS_UNIT + 1, order=RECORDS_UNIT + 2)
        set_uniforms(program, first=which[0], end=which[1])
        assert self.placed.framebuffer is not None
        self.placed.framebuffer.use()
        self.placed.framebuffer.viewport = (0, 0, ABREAST, height)
        self.ctx.enable_only(moderngl.NOTHING)
        for top, bottom in self.portions.parts("placing", range(1, height + 1), height):
            self.placed.framebuffer.use()
            self.placed.framebuffer.scissor = 0, top, ABREAST, bottom - top
            cover(program)
        self.placed.use()
        return count

    def _placing(self, plan: Plan, switches: dict[str, bool]) -> moderngl.Program:
        program = self.programs.for_screen("tile_place.frag", plan.program, switches)
        single = plan.program.footprint == "single"
        reach = single_reach(plan.kernel.name, plan.resolved.tolerance) if single else 1.0
        set_uniforms(program, reach=reach, **self.uniforms)
        return program

    def _make_placed(self, number: int, height: int) -> None:
        old = self.placed.framebuffer, *self.placed.textures
        size = ABREAST, uneven(height)
        self.placed.textures = [texel_texture(self.ctx, size, 4, "u4") for _ in range(number)]
        self.placed.framebuffer = self.ctx.framebuffer(self.placed.textures)
        free(*old)

    def _count(self, plan: Plan, count: int) -> np.ndarray | None:
        """Returns (tile, begin, end, 0) of each non-empty list, uint32 [lists, 4]; None beyond MOST_LISTED entries.

        Sets the cursors to the start of each run's part of each list.
        """
        across, down = tile_counts(self.band.window)
        runs = GROUPS * self.programs.shape.lanes
        # plus a slot for splats that touch no tile
        size = runs * (across * down + 1) * 4
        cursors = self._buffer(CURSORS, size)
        clear_buffer(cursors, size)
        self._run(plan, count, {"COUNTING": True})
        counts = np.frombuffer(cursors.read(size), np.uint32).reshape(runs, across * down + 1)
        counts = counts[:, :-1]
        # ordered by tile, then by run
        until = np.cumsum(counts, axis=0, dtype=np.uint32)
        unlisted = self._unlisted()
        until[:, unlisted] = 0
        lengths = until[-1].astype(np.int64)
        # each list starts at a multiple of four: shaders read four entries at once
        padded_ends = np.cumsum(-(-lengths // 4) * 4)
        if padded_ends[-1] > MOST_LISTED and count > 1:
            return None
        begins = padded_ends - (-(-lengths // 4) * 4)
        starts = np.full((runs, across * down + 1), NOWHERE, np.uint32)
        starts[:, :-1] = until - counts + begins.astype(np.uint32)
        starts[:, :-1][:, unlisted] = NOWHERE
        cursors.write(starts)
        nonempty = np.flatnonzero(lengths)
        ends = begins[nonempty] + lengths[nonempty]
        return np.stack([nonempty, begins[nonempty], ends, np.zeros_like(ends)], axis=1).astype(np.uint32)

    def _unlisted(self) -> np.ndarray:
        """Returns the mask of the band's tiles that need no lists."""
        return self.band.closed

    def _list(self, plan: Plan, count: int, total: int) -> None:
        # plus an entry that is never read
        height = (total + 4) // (LISTED * 4) + 1
        listed = self._buffer(LISTED_BUFFER, height * LISTED * 16)
        self._run(plan, count, {"COUNTING": False}, total + 4)
        texture = self.placed.list
        if texture is None or texture.height < height:
            free(texture)
            texture = self.placed.list = texel_texture(self.ctx, (LISTED, uneven(height)), 4, "u4")
        # copied: llvmpipe reads textures faster than buffers, and writes buffers faster than images
        texture.write(listed, viewport=(0, 0, LISTED, height))

    def _run(self, plan: Plan, count: int, switches: dict[str, bool], unread: int = 0) -> None:
        """Lists all splats, with at most ROUNDS iterations per dispatch. unread: a list entry that is never read."""
        program = self._program("tile_list.comp", plan, switches)
        self.placed.textures[0].bind_to_image(BOUNDS, read=True, write=False)
        runs = GROUPS * self.programs.shape.lanes
        length = -(-count // runs)
        set_uniforms(program, count=count, length_=length, unread=unread)
        lengths = np.clip(count - length * np.arange(runs), 0, length)
        # per run: splats done, and progress of the next splat, as a large splat may need several dispatches
        done = self._buffer(DONE, lengths.size * 16)
        clear_buffer(done)
        progress = np.zeros((lengths.size, 4), np.uint32)
        for begin, end in self.portions.parts("listing", range(1, sys.maxsize), ROUNDS):
            set_uniforms(program, budget=min(end - begin, ROUNDS))
            program.run(GROUPS)
            self.ctx.memory_barrier()
            before, progress = progress, np.frombuffer(done.read(lengths.size * 16), np.uint32).reshape(-1, 4)
            if not (progress[:, 0] < lengths).any():
                return
            if (progress == before).all():
                raise moderngl.Error("compute shaders do nothing")

    def _add_up(self, target: Target, plan: Plan, lists: np.ndarray) -> None:
        carried = self.band.begun
        if self.placed.list is not None:
            self.placed.list.use(LIST_UNIT)
        self.bind_target(target)
        while len(lists):
            program = self._program(self.drawing, plan, {"CARRIED": carried})
            set_uniforms(program, half_table=HALF_LINE_UNIT, list=LIST_UNIT, opaque=1.0 - plan.hiding.cutoff)
            part = lists.copy()
            part[:, 2] = np.minimum(lists[:, 2], lists[:, 1] + 4 * ROUNDS)
            self._buffer(LISTS, part.nbytes).write(part)
            flags = self._buffer(OPEN, self.band.closed.size * 4)
            clear_buffer(flags)
            program.run(len(part))
            self.ctx.memory_barrier()
            lists[:, 1] = part[:, 2]
            lists, carried = lists[lists[:, 1] < lists[:, 2]], True
        if plan.program.look.blend.ordered:
            open_ = np.frombuffer(flags.read(self.band.closed.size * 4), np.uint32)[part[:, 0]]
            self.band.closed[part[open_ == 0, 0]] = True

    def bind_target(self, target: Target) -> None:
        """Binds the target as the image that tiles read and write, and what they only read as others."""
        target.texture.bind_to_image(IMAGE, read=True, write=True)
        if self.card is None:
            for unit, texture in enumerate(self.placed.textures[1:3], IMAGE + 1):
                texture.bind_to_image(unit, read=True, write=False)

    def _buffer(self, binding: int, size: int) -> moderngl.Buffer:
        """Returns a storage buffer of at least `size` bytes, and binds it."""
        storage = grow_buffer(self.ctx, self.buffers, binding, size)
        storage.bind_to_storage_buffer(binding)
        return storage

    def _program(self, name: str, plan: Plan, switches: dict[str, bool]) -> moderngl.ComputeShader:
        program = self.programs.for_tiles(name, plan.program, switches)
        band = self.band
        set_uniforms(program, origin=band.window.box[:2], tiles=tile_counts(band.window), stride=band.stride)
        set_uniforms(program, **{placed: PLACED_UNIT + unit for unit, placed in enumerate(PLACED)}, **self.uniforms)
        return program


def bands_of(window: Window, most: int = MOST_PIXELS) -> list[Window]:
    """Splits a window into bands of at most `most` pixels; a pixel is in the same tile for any window."""
    left, top = window.x // COLUMNS * COLUMNS, window.y // ROWS * ROWS
    width, last = window.x + window.width - left, window.y + window.height
    height = max(most // max(width, 1) // ROWS, 1) * ROWS
    return [Window(left, first, width, min(height, last - first)) for first in range(top, last, height)]


def tile_counts(window: Window) -> tuple[int, int]:
    """Returns the numbers of tiles along x and y."""
    return -(-window.width // COLUMNS), -(-window.height // ROWS)


def _textures(program: Program) -> int:
    """Returns the number of textures of placed splats; see BENT in tiles.glsl."""
    if program.bent:
        return 5 if program.seen.cubic else 7
    return 4 if program.look.sheets and not program.packed else 3
