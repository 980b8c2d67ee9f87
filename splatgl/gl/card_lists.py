"""Sorts splats by sheet and lists them by tile on a graphics card, without reading anything back.

A stable radix sort orders (sheet, splat) and (tile, splat) pairs, so that the same splats give the same bits. The sizes
of its dispatches are in a buffer that only the device reads. A tile has one of three states: untouched, or one of
CONTINUED and CLOSED.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import moderngl
import numpy as np

from splatgl.gl.buffers import SplatTexels, clear_buffer, free, grow_buffer, most_block, order_texture
from splatgl.gl.features import Uniforms
from splatgl.gl.program import set_uniforms
from splatgl.gl.shader import CLOSED, SORT_BLOCK, SORT_LANES

# maximum number of splats of a part, and of pairs of a sort: passes are short enough for a watchdog
MOST_SPLATS, MOST_PAIRS = 2**20, 2**23
MOST_UINT = 2**32 - 1
# bytes of a pair; bits of a digit
PAIR, BITS = 8, 4
# card_work.glsl: the word of the pairs that were counted last; byte offsets of the most pairs, and of the sizes of
# dispatches
TOTAL, MOST_NEEDED, BY_ENTRY, BY_BLOCK = 3, 8, 16, 32
# byte offset of the tiles' states behind them, and most tiles of a band
STATES_AT, MOST_TILES = 256, 65_535
# maximum number of groups of a dispatch
MOST_GROUPS = 65_535
# maximum number of pixels of a band of tiles
MOST_BAND = 2**21
# bindings, see the shaders
WORK_BINDING, FIRST_BINDING, SECOND_BINDING, STATES, THIRD_BINDING, LISTED = 0, 1, 2, 3, 4, 6
RECORDS_UNIT, IMAGE = 5, 0

# returns a shader with the picture's uniforms and switches
Compile = Callable[[str, dict[str, bool]], moderngl.ComputeShader]


class CardLists:
    """Sorts splats and lists them by tile; reuses its buffers between pictures, and enlarges them on demand."""

    def __init__(self, ctx: moderngl.Context) -> None:
        self.ctx = ctx
        self.buffers: dict[str, moderngl.Buffer] = {}
        self.order: moderngl.Texture | None = None
        # pairs of a sort, which fit into a storage block of this OpenGL; number of sorts of a part
        self.room, self.sorts = min(MOST_PAIRS, most_block(ctx) // PAIR), 1
        # tiles of the band; the splats that are listed, as uniforms
        self.tiles, self.part = 1, {"number": 1}

    def release(self) -> None:
        """Frees the buffers and the texture; they are recreated on demand."""
        free(*self.buffers.values(), self.order)
        self.buffers, self.order = {}, None

    def begin(self, closed: np.ndarray, state: int = 0) -> None:
        """Begins a band of tiles. closed: mask of those that show nothing. state: of the others."""
        self.tiles = closed.size
        self._work().write(np.where(closed, CLOSED, state).astype(np.uint32), offset=STATES_AT)

    def set_entries(self, count: int, drawn: int = MOST_UINT) -> None:
        """Writes the number of pairs to sort, and of the splats of the order that are drawn."""
        sizes = [min(-(-count // SORT_LANES), MOST_GROUPS), 1, 1, 0, -(-count // SORT_BLOCK), 1, 1, 0]
        work = self._work()
        work.write(np.array([count, drawn], np.uint32))
        work.write(np.array(sizes, np.uint32), offset=BY_ENTRY)
        self._bind_work()

    def fits(self) -> bool:
        """Whether the pairs of all parts since the last call fitted into their sorts; waits for the device. If not,
        the next parts have more sorts: the picture must be drawn again.
        """
        work = self._work()
        (most,) = np.frombuffer(work.read(4, offset=MOST_NEEDED), np.uint32).tolist()
        work.write(np.zeros(1, np.uint32), offset=MOST_NEEDED)
        fitted = most <= self.room * self.sorts
        self.sorts = max(-(-most // self.room), 1)
        return fitted

    def sort_by_sheet(
        self, compile_: Compile, texels: SplatTexels, count: int, number: int, uniforms: Uniforms
    ) -> moderngl.Texture:
        """Returns the order of `count` splats by their first of `number` sheets. uniforms: of first_sheet.glsl."""
        self.set_entries(count, 0)
        self._bind("pairs", FIRST_BINDING, count * PAIR)
        texels.records.use(RECORDS_UNIT)
        program = compile_("card_sheets.comp", {})
        self._run(program, BY_ENTRY, {**uniforms, "records": RECORDS_UNIT, "count": count, "number": number})
        self.order = order_texture(self.ctx, self.order, count)
        self.order.bind_to_image(IMAGE, read=False, write=True)
        self._sort(compile_, number, count, in_image=True)
        return self.order

    def count_pairs(self, compile_: Compile, first: int, count: int) -> None:
        """Counts the tiles of `count` projected splats, from `first` of their order on."""
        size = self.tiles * 4
        self.part = {"first": first, "count": count, "number": -(-count // SORT_LANES)}
        # all sorts of these splats leave out the same tiles
        self.ctx.copy_buffer(self._buffer("closed", size), self._work(), size, read_offset=STATES_AT)
        self._bind_part()
        self._run_groups(compile_("card_pairs.comp", {"COUNTING": True}), self.part["number"], self.part)
        self._scan(compile_, 0)

    def read(self) -> np.ndarray:
        """Returns the mask of the band's terminated tiles, and sets the number of sorts to that of the pairs that were
        counted last; waits for the device.
        """
        words = np.frombuffer(self._work().read(STATES_AT + self.tiles * 4), np.uint32)
        self.sorts = max(-(-int(words[TOTAL]) // self.room), 1)
        return words[STATES_AT // 4 :] == CLOSED

    def list_tiles(self, compile_: Compile, sort: int) -> None:
        """Lists the splats that were counted by tile: the pairs of number `sort` of the sorts. Binds the lists."""
        self._bind_part()
        self._scan(compile_, 1 + sort)
        self._bind("pairs", THIRD_BINDING, self.room * PAIR)
        self._run(compile_("card_pairs.comp", {"COUNTING": False}), BY_ENTRY, self.part | {"skipped": sort * self.room})
        pairs = self._sort(compile_, self.tiles - 1, self.room)
        self._bind(pairs, FIRST_BINDING, self.room * PAIR)
        self.bind_empty()
        self._run(compile_("card_lists.comp", {}), BY_ENTRY, {})

    def bind_empty(self) -> None:
        """Binds the tiles' states, and lists that are empty."""
        clear_buffer(self._buffer("lists", self.tiles * 16), self.tiles * 16)
        self._bind("lists", SECOND_BINDING, self.tiles * 16)
        self._bind("listed", LISTED, self.room * 4)
        self._work().bind_to_storage_buffer(STATES, offset=STATES_AT, size=self.tiles * 4)

    def _bind_part(self) -> None:
        groups = self.part["number"]
        self._bind_work()
        self._bind("sums", FIRST_BINDING, groups * 4)
        self._bind("offsets", SECOND_BINDING, groups * SORT_LANES * 4)
        self._bind("closed", STATES, self.tiles * 4)

    def _scan(self, compile_: Compile, sort: int) -> None:
        """Sums the pairs of groups of splats (sort 0), or sets the number of entries of sort 1, 2, …"""
        values = self.part | {"number": 0 if sort else self.part["number"]}
        values |= {"skipped": max(sort - 1, 0) * self.room, "room": self.room}
        self._run_groups(compile_("card_scan.comp", {"PAIRS": True}), 1, values)

    def _sort(self, compile_: Compile, largest: int, most: int, in_image: bool = False) -> str:
        """Sorts at most `most` pairs by their first words, up to `largest`; returns the buffer that holds them.

        in_image: writes the second words to the bound image instead.
        """
        source, target = "pairs", "sorted"
        passes = -(-max(largest.bit_length(), 1) // BITS)
        counting = compile_("card_sort.comp", {"COUNTING": True})
        for n in range(passes):
            self._bind("counts", FIRST_BINDING, 2**BITS * -(-most // SORT_BLOCK) * 4)
            self._bind(source, SECOND_BINDING, most * PAIR)
            self._run(counting, BY_BLOCK, {"shift": BITS * n})
            self._run_groups(compile_("card_scan.comp", {"PAIRS": False}), 1, {})
            self._bind(target, THIRD_BINDING, most * PAIR)
            moving = compile_("card_sort.comp", {"COUNTING": False, "LAST": in_image and n == passes - 1})
            self._run(moving, BY_BLOCK, {"shift": BITS * n})
            source, target = target, source
        return source

    def _run(self, program: moderngl.ComputeShader, sizes: int, values: Mapping[str, object]) -> None:
        """Runs as many groups as the device computed. sizes: byte offset in the buffer of the work."""
        set_uniforms(program, **values)
        program.run_indirect(self._work(), sizes)
        self.ctx.memory_barrier()

    def _run_groups(self, program: moderngl.ComputeShader, groups: int, values: Mapping[str, object]) -> None:
        set_uniforms(program, **values)
        program.run(groups)
        self.ctx.memory_barrier()

    def _work(self) -> moderngl.Buffer:
        """Returns the buffer of card_work.glsl and of the tiles' states, at first of zeros."""
        is_new = "work" not in self.buffers
        work = self._buffer("work", STATES_AT + MOST_TILES * 4)
        if is_new:
            clear_buffer(work)
        return work

    def _bind_work(self) -> None:
        self._work().bind_to_storage_buffer(WORK_BINDING, size=STATES_AT)

    def _bind(self, name: str, binding: int, size: int) -> None:
        self._buffer(name, size).bind_to_storage_buffer(binding)

    def _buffer(self, name: str, size: int) -> moderngl.Buffer:
        """Returns a buffer of at least `size` bytes; a larger one than before is empty."""
        return grow_buffer(self.ctx, self.buffers, name, size)
