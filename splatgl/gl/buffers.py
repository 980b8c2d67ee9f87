"""Splats on the GPU: sorted instance buffers for quads, textures of records and drawing orders for tiles."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from typing import NamedTuple, Protocol, TypeVar
from weakref import WeakKeyDictionary

import moderngl
import numpy as np

from splatgl.gl.shader import ABREAST
from splatgl.planning.clusters import Clusters
from splatgl.planning.culling import OrderKey, back_to_front, block_boxes
from splatgl.splat.motion import Exposure
from splatgl.splat.splats import MOST_KEPT, Splats, check_now

# cache limits: entries, and bytes of the records of all entries but the latest
KEPT, KEPT_BYTES = 3, 2**28
# limit in bytes of records that are sorted for tiles when an order repeats: sequential reads are faster
SORTED_BYTES = 2**25

# records per upload of words, a multiple of ABREAST
PART = 2**20

K = TypeVar("K")
# name, buffer, int or float, moderngl's format, offset and stride in bytes
Attribute = tuple[str, moderngl.Buffer, str, str, int, int]
# attributes of four words of a record each; the attribute in_rest has the remaining words
WORDS = ("in_first", "in_second")
# bytes of a splat's drift
DRIFT_BYTES = 12


class Freeable(Protocol):
    """An object of OpenGL, or an owner of some."""

    def release(self) -> object:
        """Frees it."""


def free(*parts: Freeable | None) -> None:
    """Frees those that there are."""
    for part in parts:
        if part is not None:
            part.release()


def texel_texture(
    ctx: moderngl.Context, size: tuple[int, int], components: int, dtype: str, data: bytes | None = None
) -> moderngl.Texture:
    """Returns a texture whose texels are read as they are, without interpolation."""
    texture = ctx.texture(size, components, data, alignment=4, dtype=dtype)
    texture.filter = (moderngl.NEAREST, moderngl.NEAREST)
    return texture


class SplatBuffers:
    """LRU cache of GPU splat buffers."""

    def __init__(self, ctx: moderngl.Context, owned: ExitStack) -> None:
        self.ctx = ctx
        self.kept: list[SplatBuffer] = []
        owned.callback(self.release)

    def of(self, splats: Splats) -> SplatBuffer:
        """Returns the buffers of `splats`, creates them on a miss, and evicts the least recently used beyond KEPT or
        KEPT_BYTES.
        """
        # records of values do not depend on the transfer function, so several sets of splats may share them
        matches = (buffer for buffer in self.kept if buffer.splats.records is splats.records)
        latest = next(matches, None) or SplatBuffer(self.ctx, splats)
        self.kept = [*(buffer for buffer in self.kept if buffer is not latest), latest]
        while len(self.kept) > KEPT or sum(buffer.splats.records.nbytes for buffer in self.kept[:-1]) > KEPT_BYTES:
            self.kept.pop(0).release()
        return latest

    def release(self) -> None:
        """Frees the buffers of all splats."""
        while self.kept:
            self.kept.pop().release()


class SplatBuffer:
    """One set of splats on the GPU, as instances or textures."""

    def __init__(self, ctx: moderngl.Context, splats: Splats) -> None:
        self.ctx, self.splats = ctx, splats
        # keyed by whether the range starts the drawing order, and whether it ends it
        self.sorted: dict[tuple[bool, bool], SortedRecords] = {}
        self.textured: SplatTextures | None = None
        self.clustered: tuple[Clusters, moderngl.Texture] | None = None

    def quads(self, runs: bool, order: DrawOrder, which: Range) -> InstanceBuffer:
        """Returns the splats `which` of the drawing order as instances, with runs if `runs`."""
        part = which[0] == 0, which[1] == len(self.splats)
        ordered = self.sorted.setdefault(part, SortedRecords(self.ctx, self.splats))
        ordered.write(order, runs, which)
        return ordered.instances

    def texels(self, runs: bool, order: DrawOrder, which: Range | None = None) -> SplatTexels:
        """Returns textures of the splats, with runs if `runs`, and of their drawing order; which: only this range."""
        self.textured = self.textured or SplatTextures(self.ctx, self.splats)
        return self.textured.part(runs, order, which) if which else self.textured.texels(runs, order)

    def clusters(self) -> tuple[Clusters, moderngl.Texture]:
        """Returns the clusters of the splats, and a texture of their names."""
        if self.clustered is None:
            clusters = Clusters.of(self.splats)
            self.clustered = clusters, _filled(self.ctx, clusters.names[:, None])
        return self.clustered

    def release(self) -> None:
        """Frees the instances and the textures; they are uploaded again on demand."""
        free(*self.sorted.values(), self.textured, self.clustered[1] if self.clustered else None)
        self.sorted, self.textured, self.clustered = {}, None, None


class InstanceBuffer:
    """Instance buffer of records."""

    def __init__(self, ctx: moderngl.Context) -> None:
        self.ctx = ctx
        self.buffer: moderngl.Buffer | None = None
        self.drift: moderngl.Buffer | None = None
        self.record = np.dtype("V0")
        self.arrays: dict[moderngl.Program, moderngl.VertexArray] = {}

    def fill(self, records: np.ndarray, drift: np.ndarray | None = None) -> None:
        """Uploads records, which are in drawing order, and their drift, if any, float32 [N, 3]."""
        self.record = records.dtype
        self.buffer = self._write(self.buffer, records)
        self.drift = None if drift is None else self._write(self.drift, drift)

    def _write(self, buffer: moderngl.Buffer | None, rows: np.ndarray) -> moderngl.Buffer:
        if buffer is None:
            return self.ctx.buffer(rows)
        buffer.orphan(rows.nbytes)
        buffer.write(rows)
        return buffer

    def vertices(self, program: moderngl.Program, first: int) -> moderngl.VertexArray:
        """Returns a vertex array of the uploaded instances from `first` on."""
        array = self.arrays.get(program)
        if array is None:
            array = self.arrays[program] = self.ctx.vertex_array(program, [])
        for name, buffer, kind, layout, offset, stride in self._attributes():
            if name in program:
                location = program[name].location  # type: ignore[union-attr]
                array.bind(location, kind, buffer, layout, offset + first * stride, stride, 1)
        return array

    def release(self) -> None:
        """Frees the vertex arrays and the buffers; they are recreated on demand."""
        free(*self.arrays.values(), self.buffer, self.drift)
        self.arrays.clear()
        self.buffer, self.drift = None, None

    def _attributes(self) -> list[Attribute]:
        assert self.buffer is not None
        size = self.record.itemsize
        fours = size // 16
        attributes: list[Attribute] = [(WORDS[n], self.buffer, "i", "4u4", 16 * n, size) for n in range(fours)]
        attributes.append(("in_rest", self.buffer, "i", f"{size // 4 - 4 * fours}u4", 16 * fours, size))
        return attributes if self.drift is None else [*attributes, ("in_flow", self.drift, "f", "3f4", 0, DRIFT_BYTES)]


class SortedRecords:
    """Records in drawing order, rewritten for each new order. exposure: of splats that flow; their instances have the
    drift during half of it, in grid steps.
    """

    def __init__(self, ctx: moderngl.Context, splats: Splats, exposure: Exposure | None = None) -> None:
        self.splats, self.exposure, self.instances = splats, exposure, InstanceBuffer(ctx)
        self.drift = None if exposure is None else exposure.drift(splats).astype(np.float32)
        self.written: tuple[DrawOrder, bool, Range] | None = None

    def write(self, order: DrawOrder, runs: bool, which: Range) -> None:
        """Uploads splats `which` of the drawing order, with runs if `runs`, unless the buffer already holds them."""
        request = (order, runs, which)
        # an order that does not matter reuses the written one; runs that no shader reads do no harm
        has_range = self.written is not None and self.written[2] == which and (self.written[1] or not runs)
        if not has_range or (order.boxes is not None and self.written != request):
            records = self.splats.records_with_runs if runs else self.splats.records
            rows = slice(*which) if order.boxes is None else indices(self.splats, order)[slice(*which)]
            drift = None if self.drift is None else np.ascontiguousarray(self.drift[rows])
            self.instances.fill(np.ascontiguousarray(records[rows]), drift)
            self.written = request

    def flows(self, splats: Splats, exposure: Exposure) -> bool:
        """Whether these are the instances of splats, for the same flow and number of frames."""
        current = self.exposure
        same = current is not None and exposure.flow is current.flow and exposure.frames == current.frames
        return same and splats is self.splats

    def release(self) -> None:
        """Frees the instances; they are uploaded again on demand."""
        self.instances.release()
        self.written = None


@dataclass(frozen=True)
class SplatTexels:
    """Textures of splats. records: the first words, 4 in one texel, or 8 of points in two; rest: the other 2 words, or
    1 of points; order: indices in drawing order, None if the records are sorted or the order does not matter;
    boxes: boxes around blocks of sorted records.
    """

    records: moderngl.Texture
    rest: moderngl.Texture
    order: moderngl.Texture | None
    boxes: np.ndarray | None = None


class SplatTextures:
    """Records and drawing orders as textures, for shaders without vertex input."""

    def __init__(self, ctx: moderngl.Context, splats: Splats) -> None:
        self.ctx, self.splats = ctx, splats
        self.orders = Orders(splats, lambda rows: _filled(ctx, rows[:, None]))
        self.records: moderngl.Texture | None = None
        self.rest: moderngl.Texture | None = None
        self.runs = False
        # the last request, and records sorted by a repeated order
        self.asked: tuple[bool, DrawOrder] | None = None
        self.sorted: tuple[tuple[bool, DrawOrder], SplatTexels] | None = None

    def texels(self, runs: bool, order: DrawOrder) -> SplatTexels:
        """Returns textures of all splats; an order requested twice in a row gets sorted records, if they are small."""
        asked, self.asked = self.asked, (runs, order)
        if self.sorted is not None and self.sorted[0] == self.asked:
            return self.sorted[1]
        if asked == self.asked and order.boxes is not None and self.splats.records.nbytes <= SORTED_BYTES:
            texels = self._in_order(runs, order, (0, len(self.splats)))
            self.sorted = self.asked, texels
            return texels
        if self.rest is None or (runs and not self.runs):
            self._release_rest()
            first, rest = self._words(runs)
            if self.records is None:
                self.records = _filled(self.ctx, first)
            self.rest, self.runs = _filled(self.ctx, rest), runs
        assert self.records is not None
        return SplatTexels(self.records, self.rest, self.orders.of(order))

    def part(self, runs: bool, order: DrawOrder, which: Range) -> SplatTexels:
        """Uploads splats `which` alone, of a set too large to keep; frees all others."""
        self.release()
        texels = self._in_order(runs, order, which)
        self.sorted = (runs, order), texels
        self.asked = None
        return texels

    def _in_order(self, runs: bool, order: DrawOrder, which: Range) -> SplatTexels:
        self._release_sorted()
        rows = slice(*which) if order.boxes is None else indices(self.splats, order)[slice(*which)]
        first, rest = (_filled(self.ctx, words[rows]) for words in self._words(runs))
        return SplatTexels(first, rest, None, block_boxes(self.splats.records["position"][rows]))

    def release(self) -> None:
        """Frees all textures; they are recreated on demand."""
        self.orders.release()
        self._release_rest()
        self._release_sorted()
        free(self.records)
        self.records = None

    def _release_rest(self) -> None:
        free(self.rest)
        self.rest = None

    def _release_sorted(self) -> None:
        if self.sorted is not None:
            free(self.sorted[1].records, self.sorted[1].rest)
            self.sorted = None

    def _words(self, runs: bool) -> tuple[np.ndarray, np.ndarray]:
        return _words(self.splats.records_with_runs if runs else self.splats.records)


class ReusedTextures:
    """Records of one set of splats after another, in textures that are reused and grow on demand."""

    def __init__(self, ctx: moderngl.Context) -> None:
        self.ctx = ctx
        self.textures: list[moderngl.Texture] = []

    def texels(self, records: np.ndarray) -> SplatTexels:
        """Returns textures of the records, in the order of the records; valid until the next call."""
        words = _words(records)
        if not self.textures or self.textures[0].height < _rows(records):
            self.release()
            self.textures = [_filled(self.ctx, part) for part in words]
        else:
            for texture, part in zip(self.textures, words, strict=True):
                write_words(texture, part)
        first, rest = self.textures
        return SplatTexels(first, rest, None)

    def release(self) -> None:
        """Frees the textures."""
        free(*self.textures)
        self.textures = []


def _words(records: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns the first words of the records [N, multiple of four] and the remaining words."""
    words = records.view(np.uint32).reshape(-1, records.itemsize // 4)
    fours = words.shape[1] // 4 * 4
    return words[:, :fours], words[:, fours:]


def _rows(items: np.ndarray) -> int:
    """Returns the number of texture rows that hold the items."""
    return -(-max(len(items), 1) // ABREAST)


def uneven(rows: int) -> int:
    """Returns at least `rows`; below 1024 an odd number, as llvmpipe compiles shaders again for powers of two."""
    return max(rows, 2) | 1 if rows < 1024 else rows


def order_texture(ctx: moderngl.Context, old: moderngl.Texture | None, count: int) -> moderngl.Texture:
    """Returns a texture for the order of `count` splats: the old one, or a larger one after it is freed."""
    height = -(-max(count, 1) // ABREAST)
    if old is not None and old.height >= height:
        return old
    free(old)
    return texel_texture(ctx, (ABREAST, uneven(height)), 1, "u4")


def grow_buffer(ctx: moderngl.Context, buffers: dict[K, moderngl.Buffer], key: K, size: int) -> moderngl.Buffer:
    """Returns a buffer of at least `size` bytes from `buffers`; replaces a smaller one by an empty one."""
    buffer = buffers.get(key)
    if buffer is None or buffer.size < size:
        free(buffer)
        buffer = buffers[key] = ctx.buffer(reserve=size)
    return buffer


class Buffers:
    """Storage buffers by binding; enlarged on demand, and kept between pictures."""

    def __init__(self, ctx: moderngl.Context) -> None:
        self.ctx = ctx
        self.kept: dict[int, moderngl.Buffer] = {}

    def bind(self, binding: int, size: int) -> moderngl.Buffer:
        """Returns a buffer of at least `size` bytes, and binds it."""
        storage = grow_buffer(self.ctx, self.kept, binding, size)
        storage.bind_to_storage_buffer(binding)
        return storage

    def release(self) -> None:
        """Frees all buffers."""
        free(*self.kept.values())
        self.kept = {}


def clear_buffer(buffer: moderngl.Buffer, size: int | None = None) -> None:
    """Writes zeros to the first `size` bytes, by default to all. Buffer.clear maps the buffer instead: NVIDIA's driver
    then loses the second write after it.
    """
    buffer.write(bytes(buffer.size if size is None else size))


def most_block(ctx: moderngl.Context) -> int:
    """Returns the size, in bytes, of the largest storage block that the device binds."""
    return int(ctx.info.get("GL_MAX_SHADER_STORAGE_BLOCK_SIZE", 2**24))


def _padded(words: np.ndarray) -> np.ndarray:
    """Returns the words [N, n], padded with zeros to whole rows of a texture."""
    padded = np.zeros((_rows(words) * ABREAST, words.shape[1]), np.uint32)
    padded[: len(words)] = words
    return padded


def _filled(ctx: moderngl.Context, words: np.ndarray) -> moderngl.Texture:
    """Creates a texture of words [N, n], up to four per texel."""
    channels = min(words.shape[1], 4)
    size = ABREAST * words.shape[1] // channels, uneven(_rows(words))
    texture = texel_texture(ctx, size, channels, "u4")
    write_words(texture, words)
    return texture


def write_words(texture: moderngl.Texture, words: np.ndarray) -> None:
    """Writes words [N, n] into a texture's first rows, PART at a time: a padded copy of all would double the memory."""
    for first in range(0, max(len(words), 1), PART):
        check_now()
        part = _padded(words[first : first + PART])
        texture.write(part, (0, first // ABREAST, texture.width, len(part) // ABREAST), alignment=4)


# limit in bytes of cached drawing orders, 4 per splat: enough to turn back and forth interactively, not for a movie
ORDER_BYTES = 2**25
# splats per upload of sets too large to keep
CHUNK = 2**22

# [begin, end) of the drawing order
Range = tuple[int, int]
# latest drawing order of each set uploaded in chunks
_latest: WeakKeyDictionary[Splats, tuple[OrderKey, np.ndarray]] = WeakKeyDictionary()


class DrawOrder(NamedTuple):
    """Drawing order. boxes: the order of the rows, None if it has no effect."""

    boxes: OrderKey | None
    nearest_first: bool


def chunks(which: Range) -> list[Range]:
    """Splits the range into parts that the GPU holds one at a time."""
    begin, end = which
    if end - begin <= MOST_KEPT:
        return [which]
    return [(first, min(first + CHUNK, end)) for first in range(begin, end, CHUNK)]


def indices(splats: Splats, order: DrawOrder) -> np.ndarray:
    """Returns the indices [N] of the records in drawing order."""
    assert order.boxes is not None
    cached = _latest.get(splats)
    rows = cached[1] if cached and cached[0] == order.boxes else back_to_front(splats, order.boxes)
    if len(splats) > MOST_KEPT:
        _latest[splats] = order.boxes, rows
    return rows[::-1] if order.nearest_first else rows


class Orders:
    """LRU cache of drawing orders on the GPU. make: creates a texture from indices [N]."""

    def __init__(self, splats: Splats, make: Callable[[np.ndarray], moderngl.Texture]) -> None:
        self.splats, self.make = splats, make
        self.kept: OrderedDict[DrawOrder, moderngl.Texture] = OrderedDict()

    def of(self, order: DrawOrder) -> moderngl.Texture | None:
        """Returns the index texture, None if the order has no effect."""
        if order.boxes is None:
            return None
        if order in self.kept:
            self.kept.move_to_end(order)
            return self.kept[order]
        if len(self.kept) > 1 and (len(self.kept) + 1) * 4 * len(self.splats) > ORDER_BYTES:
            self.kept.popitem(last=False)[1].release()
        self.kept[order] = self.make(indices(self.splats, order))
        return self.kept[order]

    def release(self) -> None:
        """Frees the textures of all orders."""
        while self.kept:
            self.kept.popitem()[1].release()
