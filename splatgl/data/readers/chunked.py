"""`Chunked`: three axes of an array in a store, read in parts; the last decoded chunks are kept."""

from __future__ import annotations

import math
from collections import OrderedDict
from collections.abc import Iterable, Sequence
from functools import cached_property
from itertools import product
from threading import Lock
from typing import Any, Protocol

import numpy as np

from splatgl.data.readers.extents import MOST, Extents
from splatgl.data.readers.files import library
from splatgl.errors import InputError

KEPT_BYTES = 2**27
"""Bytes of decoded chunks that are kept."""

Key = int | slice | tuple[int | slice, ...]


class Files(Protocol):
    """What lies behind an array's chunks, named by the place of any sample of theirs."""

    def tag(self) -> str:
        """What changes with the contents."""
        ...

    def ready(self, places: Iterable[Sequence[int]]) -> None:
        """Called before chunks are read, with all that are."""

    def holds(self, place: Sequence[int]) -> bool:
        """Whether anything is stored for a chunk; may raise InputError."""
        ...


class Chunked:
    """A Zarr array, or what `index` leaves free of it, as samples [D, H, W]. Slices of it are numpy arrays.

    form: the format of the file that it is in. Raises InputError, which begins with `name`, the file's path or address,
    if a part can't be read.
    """

    def __init__(self, name: str, array: Any, index: Sequence[int | slice], files: Files, form: str = "Zarr") -> None:
        self.name, self.array, self.index, self.files, self.form = name, array, tuple(index), files, form
        axes = [axis for axis, place in enumerate(self.index) if isinstance(place, slice)]
        self.shape = tuple(int(array.shape[axis]) for axis in axes)
        self.chunks = tuple(int(array.chunks[axis]) for axis in axes)
        self.dtype = np.dtype(array.dtype)
        self.kept: OrderedDict[tuple[int, ...], np.ndarray] = OrderedDict()
        self.lock = Lock()

    @cached_property
    def extents(self) -> Extents | None:
        """Of the chunks that were read, now or before; None of colours, and of very many."""
        if len(self.shape) != 3:
            return None
        counts = tuple(-(-size // chunk) for size, chunk in zip(self.shape, self.chunks, strict=True))
        tag = f"{self.index} {self.shape} {self.files.tag()}"
        return Extents(counts, self.dtype, tag) if math.prod(counts) <= MOST else None

    def extent(self, low: Sequence[int], high: Sequence[int]) -> np.ndarray | None:
        """[2]: a range that holds all finite samples from low to below high, [0] if there are none; None if one is not
        known without reading.
        """
        touched = (range(a // n, -(-b // n)) for a, b, n in zip(low, high, self.chunks, strict=True))
        return self.extents.of(product(*touched)) if self.extents else None

    def __getitem__(self, key: Key) -> np.ndarray:
        given = key if isinstance(key, tuple) else (key,)
        whole = given + (slice(None),) * (len(self.shape) - len(given))
        asked = [
            range(size)[place] if isinstance(place, slice) else range(place, place + 1)
            for size, place in zip(self.shape, whole, strict=True)
        ]
        # all from the first to the last
        ranges = [range(min(each), max(each) + 1) if len(each) else range(0) for each in asked]
        found = np.empty([len(each) for each in ranges], self.dtype)
        touched = [
            range(each.start // chunk, (each.stop - 1) // chunk + 1) if len(each) else range(0)
            for each, chunk in zip(ranges, self.chunks, strict=True)
        ]
        with self.lock:
            missing = [place for place in product(*touched) if place not in self.kept]
        self.files.ready(self._begin(place) for place in missing)
        for place in product(*touched):
            low = [n * chunk for n, chunk in zip(place, self.chunks, strict=True)]
            high = [min(a + chunk, size) for a, chunk, size in zip(low, self.chunks, self.shape, strict=True)]
            first = [max(a, each.start) for a, each in zip(low, ranges, strict=True)]
            last = [min(b, each.stop) for b, each in zip(high, ranges, strict=True)]
            to = tuple(slice(a - each.start, b - each.start) for a, b, each in zip(first, last, ranges, strict=True))
            of = tuple(slice(a - start, b - start) for a, b, start in zip(first, last, low, strict=True))
            found[to] = self._chunk(place, low, high)[of]
        return found[
            tuple(
                slice(None, None, each.step) if isinstance(place, slice) else 0
                for place, each in zip(whole, asked, strict=True)
            )
        ]

    def _begin(self, place: tuple[int, ...]) -> list[int]:
        """Where a chunk begins, along all axes of the array."""
        free = iter(n * chunk for n, chunk in zip(place, self.chunks, strict=True))
        return [next(free) if isinstance(at, slice) else at for at in self.index]

    def _chunk(self, place: tuple[int, ...], low: list[int], high: list[int]) -> np.ndarray:
        with self.lock:
            if place in self.kept:
                self.kept.move_to_end(place)
                return self.kept[place]
        free = iter(map(slice, low, high))
        part = tuple(next(free) if isinstance(at, slice) else at for at in self.index)
        try:
            with library(f"{self.form}, chunk {', '.join(map(str, place))}"):
                if not self.files.holds(self._begin(place)):
                    empty = np.asarray(self.array.fill_value or 0, self.dtype)
                    chunk = np.broadcast_to(empty, [b - a for a, b in zip(low, high, strict=True)])
                    if self.extents:
                        self.extents.add(place, chunk)
                    return chunk
                chunk = np.asarray(self.array[part])
        except InputError as error:
            raise InputError(f"{self.name}: {error}") from error
        with self.lock:
            if self.extents:
                self.extents.add(place, chunk)
            self.kept[place] = chunk
            most = max(KEPT_BYTES // max(math.prod(self.chunks) * self.dtype.itemsize, 1), 1)
            while len(self.kept) > most:
                self.kept.popitem(last=False)
        return chunk
