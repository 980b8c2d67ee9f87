"""The last few splats on the GPU: as records in drawing order for quads, as records and orders of them for sprites, and
both as textures for tiles.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Generic, TypeVar

import moderngl
import numpy as np

from splatgl.splat.blocks import boxes
from splatgl.splat.order import Order, back_to_front
from splatgl.splat.rows import GL_ATTRIBUTES, GL_FORMAT, Splats

# splats of which buffers are kept, and bytes of records of all but the last of them
KEPT, KEPT_BYTES = 3, 2**28
# bytes of drawing orders kept, 4 a splat: what a hand that turns to and fro comes back to, not what a movie passes once
ORDER_BYTES = 2**25

# records are sorted for tiles where an order is asked for again, up to so many bytes: read in turn they come sooner
SORTED_BYTES = 2**25

# what is drawn in which order; None: any will do. nearest first or last
Sequence = tuple[Order | None, bool]
# [begin, end) of the drawing order
Range = tuple[int, int]


# a list of indices
Listed = TypeVar("Listed", bound=moderngl.Buffer | moderngl.Texture)


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
        # by whether the order begins with them, and ends
        self.sorted: dict[tuple[bool, bool], Sorted] = {}
        self.indexed: Indexed | None = None
        self.textured: Textured | None = None

    def quads(self, program: moderngl.Program, sequence: Sequence, which: Range) -> moderngl.VertexArray:
        """A vertex array whose instances are splats `which` of the drawing order."""
        part = which[0] == 0, which[1] == len(self.splats)
        found = self.sorted.setdefault(part, Sorted(self.ctx, self.splats))
        return found.vertices(program, sequence, which)

    def sprites(self, program: moderngl.Program, sequence: Sequence) -> moderngl.VertexArray:
        """A vertex array whose vertices are the splats in drawing order."""
        self.indexed = self.indexed or Indexed(self.ctx, self.splats)
        return self.indexed.vertices(program, sequence)

    def texels(self, runs: bool, sequence: Sequence) -> Texels:
        """The splats as textures, with runs if they are wanted, and their drawing order."""
        self.textured = self.textured or Textured(self.ctx, self.splats)
        return self.textured.texels(runs, sequence)

    def release(self) -> None:
        for part in (*self.sorted.values(), self.indexed, self.textured):
            if part is not None:
                part.release()
        self.sorted, self.indexed, self.textured = {}, None, None


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
        self.orders = Orders(splats, self._listed, self._forget)
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
        order = self.orders.of(sequence)
        if key not in self.arrays:
            self.arrays[key] = self.ctx.vertex_array(
                program, [_content(program, self.buffer, "")], index_buffer=order, index_element_size=4
            )
        return self.arrays[key]

    def release(self) -> None:
        self.orders.release()
        _release(self.arrays, self.buffer)

    def _listed(self, indices: np.ndarray) -> moderngl.Buffer:
        return self.ctx.buffer(indices)

    def _forget(self, sequence: Sequence) -> None:
        """A list of indices goes, and what joins it to programs."""
        for key in [key for key in self.arrays if key[1] == sequence]:
            self.arrays.pop(key).release()


class Orders(Generic[Listed]):
    """The latest drawing orders on the GPU. make: of indices, uint32 [N]; forget: told what goes."""

    def __init__(
        self, splats: Splats, make: Callable[[np.ndarray], Listed], forget: Callable[[Sequence], None] | None = None
    ) -> None:
        self.splats, self.make, self.forget = splats, make, forget
        self.kept: OrderedDict[Sequence, Listed] = OrderedDict()

    def of(self, sequence: Sequence) -> Listed | None:
        """The list of indices; None for any order."""
        if sequence[0] is None:
            return None
        if sequence in self.kept:
            self.kept.move_to_end(sequence)
            return self.kept[sequence]
        if len(self.kept) > 1 and (len(self.kept) + 1) * 4 * len(self.splats) > ORDER_BYTES:
            oldest, listed = self.kept.popitem(last=False)
            if self.forget:
                self.forget(oldest)
            listed.release()
        self.kept[sequence] = self.make(_indices(self.splats, sequence).astype(np.uint32))
        return self.kept[sequence]

    def release(self) -> None:
        while self.kept:
            self.kept.popitem()[1].release()


# splats abreast in a texture: tiles.glsl's ABREAST
ABREAST = 1024
# a record's 32-bit words: two texels of four, and the last
WORDS = 9


@dataclass(frozen=True)
class Texels:
    """Records' words 0 to 7, two texels a splat, and 8; indices in drawing order, None where they stand in it or any
    will do; and boxes around blocks of those that stand in it.
    """

    records: moderngl.Texture
    rest: moderngl.Texture
    order: moderngl.Texture | None
    boxes: np.ndarray | None = None


class Textured:
    """Records and drawing orders as textures: what shaders gather that draw no vertices."""

    def __init__(self, ctx: moderngl.Context, splats: Splats) -> None:
        self.ctx, self.splats = ctx, splats
        self.orders = Orders(splats, self._listed)
        self.records: moderngl.Texture | None = None
        self.rest: moderngl.Texture | None = None
        self.runs = False
        # what was asked for last, and records in an order that was asked for again
        self.asked: tuple[bool, Sequence] | None = None
        self.sorted: tuple[tuple[bool, Sequence], Texels] | None = None

    def texels(self, runs: bool, sequence: Sequence) -> Texels:
        asked, self.asked = self.asked, (runs, sequence)
        if self.sorted is not None and self.sorted[0] == self.asked:
            return self.sorted[1]
        if asked == self.asked and sequence[0] is not None and self.splats.records.nbytes <= SORTED_BYTES:
            self._release_sorted()
            words = self._words(runs)[_indices(self.splats, sequence)]
            around = boxes(words[:, :3].view(np.float32))
            found = Texels(self._texture(words[:, :8], 4, 2), self._texture(words[:, 8:], 1, 1), None, around)
            self.sorted = self.asked, found
            return found
        if self.rest is None or (runs and not self.runs):
            self._release_rest()
            words = self._words(runs)
            if self.records is None:
                self.records = self._texture(words[:, :8], 4, 2)
            self.rest, self.runs = self._texture(words[:, 8:], 1, 1), runs
        assert self.records is not None
        return Texels(self.records, self.rest, self.orders.of(sequence))

    def release(self) -> None:
        self.orders.release()
        self._release_rest()
        self._release_sorted()
        if self.records is not None:
            self.records.release()
            self.records = None

    def _release_rest(self) -> None:
        if self.rest is not None:
            self.rest.release()
            self.rest = None

    def _release_sorted(self) -> None:
        if self.sorted is not None:
            self.sorted[1].records.release()
            self.sorted[1].rest.release()
            self.sorted = None

    def _words(self, runs: bool) -> np.ndarray:
        return (self.splats.records_with_runs if runs else self.splats.records).view(np.uint32).reshape(-1, WORDS)

    def _listed(self, indices: np.ndarray) -> moderngl.Texture:
        return self._texture(indices[:, None], 1, 1)

    def _texture(self, words: np.ndarray, channels: int, each: int) -> moderngl.Texture:
        """Of words [N, channels · each]: `each` texels a splat."""
        height = -(-max(len(words), 1) // ABREAST)
        padded = np.zeros((height * ABREAST, words.shape[1]), np.uint32)
        padded[: len(words)] = words
        texture = self.ctx.texture((ABREAST * each, height), channels, padded, alignment=4, dtype="u4")
        texture.filter = (moderngl.NEAREST, moderngl.NEAREST)
        return texture


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
