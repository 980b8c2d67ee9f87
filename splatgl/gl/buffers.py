"""The last few splats on the GPU: as records in drawing order for quads, as records and orders of them for sprites."""

from __future__ import annotations

from collections import OrderedDict
from contextlib import ExitStack

import moderngl
import numpy as np

from splatgl.splat.order import Order, back_to_front
from splatgl.splat.rows import GL_ATTRIBUTES, GL_FORMAT, Splats

# splats of which buffers are kept, and bytes of records of all but the last of them
KEPT, KEPT_BYTES = 3, 2**28
# bytes of drawing orders kept, 4 a splat: what a hand that turns to and fro comes back to, not what a movie passes once
ORDER_BYTES = 2**25

# what is drawn in which order; None: any will do. nearest first or last
Sequence = tuple[Order | None, bool]
# [begin, end) of the drawing order
Range = tuple[int, int]


class SplatBuffers:
    """What hangs on splats themselves, of the last few: whoever goes to and fro between some uploads each once."""

    def __init__(self, ctx: moderngl.Context, owned: ExitStack) -> None:
        self.ctx = ctx
        self.kept: list[SplatBuffer] = []
        owned.callback(self.release)

    def of(self, splats: Splats) -> SplatBuffer:
        """The latest last; the oldest go first, until few are left and the rest are small."""
        found = next((buffer for buffer in self.kept if buffer.splats is splats), None) or SplatBuffer(self.ctx, splats)
        self.kept = [*(buffer for buffer in self.kept if buffer is not found), found]
        while len(self.kept) > KEPT or sum(buffer.splats.records.nbytes for buffer in self.kept[:-1]) > KEPT_BYTES:
            self.kept.pop(0).release()
        return found

    def release(self) -> None:
        while self.kept:
            self.kept.pop().release()


class SplatBuffer:
    """The splats on the GPU, in either form."""

    def __init__(self, ctx: moderngl.Context, splats: Splats) -> None:
        self.ctx, self.splats = ctx, splats
        # those that the order begins with, and others
        self.sorted: dict[bool, Sorted] = {}
        self.indexed: Indexed | None = None

    def quads(self, program: moderngl.Program, sequence: Sequence, which: Range) -> moderngl.VertexArray:
        """A vertex array whose instances are splats `which` of the drawing order."""
        found = self.sorted.setdefault(which[0] == 0, Sorted(self.ctx, self.splats))
        return found.vertices(program, sequence, which)

    def sprites(self, program: moderngl.Program, sequence: Sequence) -> moderngl.VertexArray:
        """A vertex array whose vertices are the splats in drawing order."""
        self.indexed = self.indexed or Indexed(self.ctx, self.splats)
        return self.indexed.vertices(program, sequence)

    def release(self) -> None:
        for part in (*self.sorted.values(), self.indexed):
            if part is not None:
                part.release()
        self.sorted, self.indexed = {}, None


class Sorted:
    """Records in drawing order, written again for every new one: what instances of a quad need."""

    def __init__(self, ctx: moderngl.Context, splats: Splats) -> None:
        self.ctx, self.splats = ctx, splats
        self.written: tuple[Sequence, bool, Range] | None = None
        self.buffer: moderngl.Buffer | None = None
        self.arrays: dict[int, moderngl.VertexArray] = {}

    def vertices(self, program: moderngl.Program, sequence: Sequence, which: Range) -> moderngl.VertexArray:
        wanted = (sequence, "in_runs" in program, which)
        # where any order will do, the one that is there does; and more than is read does no harm
        (order, _), runs, _ = wanted
        there = self.written is not None and self.written[2] == which and (self.written[1] or not runs)
        if not there or (order is not None and self.written != wanted):
            self._upload(*wanted)
            self.written = wanted
        assert self.buffer is not None
        if program.glo not in self.arrays:
            self.arrays[program.glo] = self.ctx.vertex_array(program, self._content(program, self.buffer))
        return self.arrays[program.glo]

    def release(self) -> None:
        _release(self.arrays, self.buffer)

    def _content(self, program: moderngl.Program, buffer: moderngl.Buffer) -> list[tuple]:
        return [_content(program, buffer, "/i")]

    def _upload(self, sequence: Sequence, runs: bool, which: Range) -> None:
        records = self.splats.records_with_runs if runs else self.splats.records
        if sequence[0] is not None:
            records = records[_indices(self.splats, sequence)[slice(*which)]]
        if self.buffer is None:
            self.buffer = self.ctx.buffer(records)
        else:
            self.buffer.orphan(records.nbytes)
            self.buffer.write(records)


class Indexed:
    """Records as they stand, and a list of indices for every drawing order: a turned view uploads next to nothing."""

    def __init__(self, ctx: moderngl.Context, splats: Splats) -> None:
        self.ctx, self.splats = ctx, splats
        self.runs = False
        self.buffer: moderngl.Buffer | None = None
        self.orders: OrderedDict[Sequence, moderngl.Buffer] = OrderedDict()
        self.arrays: dict[tuple[int, Sequence], moderngl.VertexArray] = {}

    def vertices(self, program: moderngl.Program, sequence: Sequence) -> moderngl.VertexArray:
        # records: with runs once a program wants them
        runs = "in_runs" in program
        if self.buffer is None:
            self.buffer = self.ctx.buffer(self.splats.records_with_runs if runs else self.splats.records)
            self.runs = runs
        elif runs and not self.runs:
            self.buffer.write(self.splats.records_with_runs)
            self.runs = True
        # the order, and the array that joins the two for this program
        key = (program.glo, sequence)
        order = self._order(sequence)
        if key not in self.arrays:
            self.arrays[key] = self.ctx.vertex_array(
                program, [_content(program, self.buffer, "")], index_buffer=order, index_element_size=4
            )
        return self.arrays[key]

    def release(self) -> None:
        _release(self.arrays, self.buffer, *self.orders.values())

    def _order(self, sequence: Sequence) -> moderngl.Buffer | None:
        """The list of indices; None for any order."""
        if sequence[0] is None:
            return None
        if sequence in self.orders:
            self.orders.move_to_end(sequence)
            return self.orders[sequence]
        if len(self.orders) > 1 and (len(self.orders) + 1) * 4 * len(self.splats) > ORDER_BYTES:
            oldest, buffer = self.orders.popitem(last=False)
            for key in [key for key in self.arrays if key[1] == oldest]:
                self.arrays.pop(key).release()
            buffer.release()
        self.orders[sequence] = self.ctx.buffer(_indices(self.splats, sequence).astype(np.uint32))
        return self.orders[sequence]


def _indices(splats: Splats, sequence: Sequence) -> np.ndarray:
    order, nearest_first = sequence
    assert order is not None
    found = back_to_front(splats, order)
    return found[::-1] if nearest_first else found


def _release(arrays: dict, *buffers: moderngl.Buffer | None) -> None:
    for array in arrays.values():
        array.release()
    arrays.clear()
    for buffer in buffers:
        if buffer is not None:
            buffer.release()


def _content(program: moderngl.Program, buffer: moderngl.Buffer, per: str) -> tuple:
    """The record's format with the attributes that a program does not read skipped."""
    used = [name for name in GL_ATTRIBUTES if name in program]
    sizes = {"3f4": "12x", "1f4": "4x", "3i2": "6x", "1i2": "2x"}
    named = iter(GL_ATTRIBUTES)
    kept = [part if next(named) in used else sizes[part] for part in GL_FORMAT.split()]
    return (buffer, " ".join(kept) + per, *used)
