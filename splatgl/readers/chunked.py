"""Chunked arrays that are read in parts, in any order of axes, with a cache of the extremes of chunks."""

from __future__ import annotations

import atexit
import hashlib
import math
import os
import zipfile
from collections import OrderedDict
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from pathlib import Path
from threading import Lock
from typing import Any, Protocol
from weakref import WeakSet, finalize

import numpy as np

from splatgl.data.arrays import Key, Transposed
from splatgl.errors import InputError, expected
from splatgl.fileio import ALWAYS, PROCESS, atomic_write, budget, byte_count, format_bytes, held_within_budget
from splatgl.readers.common import decoder_errors
from splatgl.readers.remote import cache_folder

# most bytes of an array's decoded chunks in the cache
CACHE_BYTES = 2**27
# copies of a chunk that decoding holds at a time: stored, decoded, and as samples
COPIES = 3


def file_tag(path: Path | str) -> str:
    """The path, size and time of a file."""
    status = os.stat(path)
    return f"{path} {status.st_size} {status.st_mtime_ns}"


class Stored(Protocol):
    """The files of an array's chunks, which are named by the index of any sample; here of one file."""

    path: Path

    def tag(self) -> str:
        """Text that changes with the contents: the path, size and time of the file."""
        return file_tag(self.path)

    def ready(self, places: Iterable[Sequence[int]]) -> None:
        """Called before chunks are read, with an index for each; does nothing, as all chunks are in the file."""
        return

    def holds(self, place: Sequence[int]) -> bool:
        """Whether a chunk is stored: every one is. Others may raise InputError."""
        return True


class OneFile(Stored):
    """The file of all chunks. file: of a library, with the method close, open as long as this object lives."""

    def __init__(self, path: Path, file: Any = None) -> None:
        self.path, self.file = path.resolve(), file
        if file is not None:
            finalize(self, file.close)


class Chunked:
    """The part of a Zarr array that `index` leaves free, as samples [D, H, W]. Slices of it are numpy arrays.

    form: the file's format. Raises InputError, which begins with `name`, the file's path or address, if a part can't be
    read.
    """

    def __init__(self, name: str, array: Any, index: Sequence[int | slice], files: Stored, form: str = "Zarr") -> None:
        self.name, self.array, self.index, self.files, self.form = name, array, tuple(index), files, form
        axes = [axis for axis, place in enumerate(self.index) if isinstance(place, slice)]
        self.shape = tuple(int(array.shape[axis]) for axis in axes)
        self.chunks = tuple(int(array.chunks[axis]) for axis in axes)
        self.dtype = np.dtype(array.dtype)
        self.cache: OrderedDict[tuple[int, ...], np.ndarray] = OrderedDict()

    @cached_property
    def extents(self) -> Extents | None:
        """Extremes of the chunks that were read, now or before; None for colours, and for very many chunks."""
        if len(self.shape) != 3:
            return None
        counts = tuple(-(-size // chunk) for size, chunk in zip(self.shape, self.chunks, strict=True))
        tag = f"{self.index} {self.shape} {self.files.tag()}"
        return Extents(counts, self.dtype, tag) if math.prod(counts) <= MOST else None

    def extent(self, low: Sequence[int], high: Sequence[int]) -> np.ndarray | None:
        """Range [2] of the finite samples from low to below high, [0] without any; None if not known yet."""
        touched = (range(a // n, -(-b // n)) for a, b, n in zip(low, high, self.chunks, strict=True))
        return self.extents.of(product(*touched)) if self.extents else None

    def __getitem__(self, key: Key) -> np.ndarray:
        keys = key if isinstance(key, tuple) else (key,)
        keys += (slice(None),) * (len(self.shape) - len(keys))
        sizes = zip(self.shape, keys, strict=True)
        steps = [range(size)[at] if isinstance(at, slice) else range(at, at + 1) for size, at in sizes]
        # from the first to the last sample along each axis
        begin, end = [min(step, default=0) for step in steps], [max(step, default=-1) + 1 for step in steps]
        result = np.empty([b - a for a, b in zip(begin, end, strict=True)], self.dtype)
        touched = [range(a // size, -(-b // size)) for a, b, size in zip(begin, end, self.chunks, strict=True)]
        with _LOCK:
            missing = [place for place in product(*touched) if place not in self.cache]
        self.files.ready(self._begin(place) for place in missing)
        for place in product(*touched):
            low = [n * chunk for n, chunk in zip(place, self.chunks, strict=True)]
            high = [min(a + chunk, size) for a, chunk, size in zip(low, self.chunks, self.shape, strict=True)]
            first, last = list(map(max, low, begin)), list(map(min, high, end))
            to, of = (
                tuple(slice(a - start, b - start) for a, b, start in zip(first, last, starts, strict=True))
                for starts in (begin, low)
            )
            result[to] = self._chunk(place, low, high)[of]
        spans = zip(keys, steps, strict=True)
        return result[tuple(slice(None, None, step.step) if isinstance(at, slice) else 0 for at, step in spans)]

    def _begin(self, place: tuple[int, ...]) -> list[int]:
        """The index of a chunk's first sample, along all axes of the array."""
        free = iter(n * chunk for n, chunk in zip(place, self.chunks, strict=True))
        return [next(free) if isinstance(at, slice) else at for at in self.index]

    def _chunk(self, place: tuple[int, ...], low: list[int], high: list[int]) -> np.ndarray:
        with _LOCK:
            if place in self.cache:
                self.cache.move_to_end(place)
                return self.cache[place]
        free = iter(map(slice, low, high))
        part = tuple(next(free) if isinstance(at, slice) else at for at in self.index)
        try:
            with decoder_errors(f"{self.form}, chunk {', '.join(map(str, place))}"):
                is_stored = self.files.holds(self._begin(place))
                empty = np.asarray(self.array.fill_value or 0, self.dtype)
                size = [b - a for a, b in zip(low, high, strict=True)]
                if is_stored:
                    _check_fits(tuple(size), self.dtype)
                chunk = np.asarray(self.array[part]) if is_stored else np.broadcast_to(empty, size)
        except InputError as error:
            raise InputError(f"{self.name}: {error}") from error
        with _LOCK:
            if self.extents:
                self.extents.add(place, chunk)
            if not is_stored:
                return chunk
            self.cache[place] = chunk
            _drop_oldest(self)
        return chunk


# arrays with decoded chunks, and the lock of their caches
_ARRAYS: WeakSet[Chunked] = WeakSet()
_LOCK = Lock()


def _drop_oldest(read: Chunked) -> None:
    """Keeps the chunks of an array that was just read within CACHE_BYTES, and those of all arrays within their share of
    the memory: those of others go first, and one stays.
    """
    _ARRAYS.add(read)
    sizes = {each: len(each.cache) * byte_count(each.chunks, each.dtype) for each in (*_ARRAYS, read)}
    share = held_within_budget(sum(sizes.values()))
    for each in (*(other for other in sizes if other is not read), read):
        one = byte_count(each.chunks, each.dtype)
        while len(each.cache) > (each is read) and (sum(sizes.values()) > share or sizes[each] > CACHE_BYTES):
            each.cache.popitem(last=False)
            sizes[each] -= one


def _check_fits(chunks: tuple[int, ...], dtype: np.dtype) -> None:
    """Raises InputError for chunks of which the memory budget cannot hold one while it is decoded."""
    copies, most = COPIES * byte_count(chunks, dtype), budget()
    if copies > ALWAYS and (needed := PROCESS + copies) > most:
        got = f"{format_bytes(needed)} for one of {'×'.join(map(str, reversed(chunks)))}"
        fix = "give more --memory, or save the array in smaller chunks"
        raise expected("chunks", f"one that is decoded in {format_bytes(most)} in all", got, fix)


# state of a chunk's extremes: not known; known; no finite sample
UNKNOWN, KNOWN, EMPTY = 0, 1, 2
# most chunks of an array whose extremes are stored
MOST = 1 << 24

Place = tuple[int, ...]


class Extents:
    """Extremes of an array's chunks, stored in the cache folder by `tag`, which changes with the contents."""

    def __init__(self, counts: Place, dtype: np.dtype, tag: str) -> None:
        self.file = cache_folder() / "extents" / f"{hashlib.sha256(tag.encode()).hexdigest()[:32]}.npz"
        self.low, self.high = np.zeros(counts, dtype), np.zeros(counts, dtype)
        self.known, self.changed = np.zeros(counts, np.uint8), False
        try:
            with np.load(self.file) as archive:
                arrays = [np.asarray(archive[name]) for name in ("low", "high", "known")]
        except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
            return
        if [(array.shape, array.dtype) for array in arrays] == [(counts, dtype)] * 2 + [(counts, np.dtype(np.uint8))]:
            self.low, self.high, self.known = arrays

    def add(self, place: Place, chunk: np.ndarray) -> None:
        """Stores the extremes of a chunk that was read."""
        if self.known[place] != UNKNOWN:
            return
        if not self.changed:
            self.changed = True
            atexit.register(self.save)
        finite = chunk if chunk.dtype.kind in "bui" else chunk[np.isfinite(chunk)]
        if finite.size:
            self.low[place], self.high[place] = finite.min(), finite.max()
        self.known[place] = KNOWN if finite.size else EMPTY

    def of(self, places: Iterable[Place]) -> np.ndarray | None:
        """Minimum and maximum finite sample [2] of some chunks, [0] if none is finite; None if a chunk is not known."""
        at = tuple(np.array(list(places)).T)
        known = self.known[at]
        if (known == UNKNOWN).any():
            return None
        some = known == KNOWN
        if not some.any():
            return np.zeros(0, self.low.dtype)
        return np.array([self.low[at][some].min(), self.high[at][some].max()])

    def save(self) -> None:
        """Writes the known extremes, if the folder can be written."""
        with suppress(InputError), atomic_write(self.file) as temporary, temporary.open("wb") as file:
            np.savez_compressed(file, low=self.low, high=self.high, known=self.known)
            self.changed = False


def folder_tag(folder: Path) -> str:
    """Paths, sizes and times of all files of an array: any change of the array changes the tag."""
    files = (os.path.join(place, name) for place, _, names in os.walk(folder.resolve()) for name in names)
    return "\n".join(map(file_tag, sorted(files)))


class TransposedChunks:
    """A Zarr array with its axes in another order, as `Chunked` reads it; nothing is read before it is indexed.

    names: one per axis of the array; wanted: names in the order wanted; an unknown name is an axis of one entry.
    packing: of values into the array's numbers; None: these are the values.
    """

    def __init__(self, array: Any, names: Sequence[str], wanted: Sequence[str], packing: Packing | None = None) -> None:
        self.turned = Transposed(array, [names.index(name) if name in names else None for name in wanted])
        self.shape, self.dtype, self.chunks = self.turned.shape, self.turned.dtype, self.turned.sizes(array.chunks)
        self.packing, self.fill_value = packing, array.fill_value
        if packing is not None:
            self.dtype = np.dtype(np.float32)
            self.fill_value = packing.values(np.asarray(array.fill_value or 0)).item()

    def __getitem__(self, key: Key) -> np.ndarray:
        stored = self.turned[key]
        return stored if self.packing is None else self.packing.values(stored)


# CF's attributes of packing (conventions 1.11, sections 2.5.1 and 8.1)
CF_NUMBERS = ("scale_factor", "add_offset", "_FillValue", "missing_value", "valid_min", "valid_max", "valid_range")
# most numbers that stand for missing values
_MOST_FILLS = 8


@dataclass(frozen=True)
class Packing:
    """Packing of values into stored numbers: value = number · scale + offset; numbers equal to one of `fills`, below
    `low` and above `high` are missing. unsigned: whether signed numbers stand for those of the same bits without sign.
    """

    scale: float = 1.0
    offset: float = 0.0
    fills: tuple[float, ...] = ()
    low: float = -math.inf
    high: float = math.inf
    unsigned: bool = False

    @classmethod
    def of(cls, stated: Mapping[str, np.ndarray | None], dtype: np.dtype, unsigned: object) -> Packing | None:
        """The packing that CF's attributes state; None if there are none: stored numbers are values."""
        turned = str(unsigned).lower() == "true" and dtype.kind == "i"
        numbers = {name: np.asarray(value, np.float64).ravel() for name, value in stated.items() if value is not None}
        wrap = 2.0 ** (8 * dtype.itemsize) if turned else 0.0
        limits = {name: np.where(value < 0, value + wrap, value) for name, value in numbers.items()}
        fills = np.concatenate([limits.get(name, np.zeros(0))[:_MOST_FILLS] for name in CF_NUMBERS[2:4]])
        low, high = (_one(limits.get(name), default) for name, default in zip(CF_NUMBERS[4:6], _EVERY, strict=True))
        if len(limits.get("valid_range", ())) == 2:
            low, high = limits["valid_range"].tolist()
        scale, offset = _one(numbers.get("scale_factor"), 1.0), _one(numbers.get("add_offset"), 0.0)
        packing = cls(scale, offset, tuple(fills[np.isfinite(fills)].tolist()), low, high, turned)
        return packing if packing != cls() or {"scale_factor", "add_offset"} & numbers.keys() else None

    def values(self, stored: np.ndarray) -> np.ndarray:
        """Values, float32; NaN where they are missing."""
        if self.unsigned:
            stored = stored.view(f"{stored.dtype.byteorder}u{stored.dtype.itemsize}")
        values = stored.astype(np.float64) * self.scale + self.offset
        # numbers of the stored type, to which attributes in double precision are rounded
        real = stored.dtype if stored.dtype.kind == "f" else np.dtype(np.float64)
        missing = np.isin(stored, np.array(self.fills, real)) if self.fills else np.zeros(stored.shape, bool)
        if (self.low, self.high) != _EVERY:
            missing |= (stored < real.type(self.low)) | (stored > real.type(self.high))
        return np.where(missing, np.nan, values).astype(np.float32)


_EVERY = (-math.inf, math.inf)


def _one(numbers: np.ndarray | None, default: float) -> float:
    """The only number, else the default."""
    return default if numbers is None or numbers.size != 1 or math.isnan(numbers[0]) else float(numbers[0])
