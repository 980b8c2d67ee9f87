"""Datasets of an HDF5 file through h5py: listed, checked before HDF5 decodes them, mapped or read in parts.

An HDF5 file can name others (external links, external storage, virtual datasets): they are not followed unless that is
permitted. Only filters whose results have a bound are run.
"""

from __future__ import annotations

import importlib.util
import math
import subprocess
import sys
import zlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from splatgl.data.readers.chunked import Chunked
from splatgl.data.readers.files import (
    CHUNK_BYTES,
    DEFLATE_RATIO,
    MAX_BYTES,
    library,
    map_array,
    require_bytes,
    require_plausible,
)
from splatgl.errors import InputError, expected, missing_extra
from splatgl.fileio import WHOLE, byte_count

_FILTERS = {1: "gzip", 2: "shuffle", 3: "fletcher32", 32000: "lzf"}
"""Filters by number whose results are bounded by what is stored; others state a size of their own, or are plug-ins."""

_GZIP = 1

_PART_BYTES = 2**20
"""Bytes that are read together at least, if the file's chunks are smaller."""

_MOST_OBJECTS, _MOST_LINKS, MOST_VALUES = 10_000, 32, 2**20
"""Most objects that are looked at, soft links that lead to one, and numbers of an attribute or a dimension scale."""


_PROBE = Path(__file__).with_name("hdf5_probe.py")

_PATIENCE = None if importlib.util.find_spec("resource") else 60.0
"""Seconds after which a process that looks at a file is ended, where none can end itself by its processor time."""

_SOUND: set[tuple[str, int, int]] = set()
"""Files that a process of its own has looked at: path, bytes, time."""


@dataclass(frozen=True)
class Packed:
    """How stored numbers become values: number · scale + offset; those equal to `fill` are missing."""

    scale: float = 1.0
    offset: float = 0.0
    fill: float | None = None


def open_hdf5(path: Path) -> Any:
    """The file in h5py, for reading."""
    try:
        import h5py
    except ImportError:
        raise missing_extra("HDF5 files", "h5py", "readers") from None
    _probe(path)
    with library("HDF5"):
        return h5py.File(path, "r", locking=False)


def _probe(path: Path) -> None:
    """InputError if HDF5's C library crashes or loops on the file: found in a process of its own, once a file."""
    told = path.stat()
    key = (str(path.resolve()), told.st_size, told.st_mtime_ns)
    if key in _SOUND:
        return
    # -P: the folder of the script holds modules with common names
    run = [sys.executable, "-P", str(_PROBE), str(path)]
    none, out = subprocess.DEVNULL, subprocess.PIPE
    try:
        ended = subprocess.run(run, stdin=none, stdout=out, stderr=none, timeout=_PATIENCE)
        # a process that did not get as far says nothing about the file
        failed = ended.returncode != 0 and bool(ended.stdout)
    except subprocess.TimeoutExpired:
        failed = True
    except OSError:
        # the program that Python is embedded in, or none
        failed = False
    if failed:
        raise InputError("cannot be read as HDF5: its library fails on the file, which may be damaged")
    _SOUND.add(key)


def datasets(file: Any) -> dict[str, Any]:
    """All datasets by name that lie in the file itself. Raises InputError for very many objects."""
    import h5py

    found, seen = dict[str, Any](), 0

    def look(name: str, node: Any) -> None:
        nonlocal seen
        seen += 1
        if seen > _MOST_OBJECTS:
            raise expected("file", f"at most {_MOST_OBJECTS} groups and datasets", "more", "name one by array=/…")
        if isinstance(node, h5py.Dataset):
            found["/" + name] = node

    file.visititems(look)
    return found


def node_at(file: Any, name: str, anywhere: bool) -> Any:
    """The group or dataset of that name, None if there is none. InputError for another file's, if not `anywhere`."""
    import h5py

    node, parts, links = file, [part for part in name.split("/") if part not in ("", ".")], 0
    while parts:
        if not isinstance(node, h5py.Group):
            return None
        part = parts.pop(0)
        link = node.get(part, getlink=True)
        if isinstance(link, h5py.ExternalLink) and not anywhere:
            raise _elsewhere(name, link.filename)
        if isinstance(link, h5py.SoftLink):
            links += 1
            if links > _MOST_LINKS:
                raise expected(name, f"at most {_MOST_LINKS} links that lead there", "more")
            node = file if link.path.startswith("/") else node
            parts = [each for each in link.path.split("/") if each not in ("", ".")] + parts
            continue
        node = node.get(part)
    return node


def numbers_of(node: Any, name: str) -> np.ndarray | None:
    """An attribute's real numbers, or those that its text has, flat; None if it has none."""
    if name not in node.attrs:
        return None
    told = node.attrs.get_id(name)
    if math.prod(told.shape or ()) > MOST_VALUES:
        raise expected(name, f"at most {MOST_VALUES} values", told.shape)
    values = np.asarray(node.attrs[name])
    if values.dtype.kind in "buif":
        return values.astype(np.float64).ravel()
    try:
        return np.array(text_of(node, name).replace(",", " ").split(), np.float64)
    except ValueError:
        return None


def scales_of(dataset: Any) -> list[Any]:
    """The first dimension scale of each axis, None where there is none; [] if none has.

    Read from the attribute that names them: HDF5's own functions loop on damaged ones.
    """
    import h5py

    if "DIMENSION_LIST" not in dataset.attrs or dataset.attrs.get_id("DIMENSION_LIST").shape != (len(dataset.shape),):
        return []
    named = [np.asarray(each).ravel() for each in dataset.attrs["DIMENSION_LIST"]]
    nodes = [dataset.file[each[0]] if each.size and isinstance(each[0], h5py.Reference) else None for each in named]
    return [node if isinstance(node, h5py.Dataset) else None for node in nodes]


def texts_of(node: Any, name: str) -> list[str]:
    """An attribute's texts, [] if there are none."""
    if name not in node.attrs or math.prod(node.attrs.get_id(name).shape or ()) > MOST_VALUES:
        return []
    values = np.asarray(node.attrs[name]).ravel().tolist()
    return [value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value) for value in values]


def text_of(node: Any, name: str) -> str:
    """An attribute's text, also where it is an array of letters; "" if there is none."""
    if name not in node.attrs:
        return ""
    told = node.attrs.get_id(name)
    if math.prod(told.shape or ()) > MOST_VALUES:
        raise expected(name, f"at most {MOST_VALUES} letters", told.shape)
    return "".join(texts_of(node, name))


def is_numbers(dataset: Any) -> bool:
    """Whether a dataset has real numbers; types that numpy does not know are none."""
    try:
        return dataset.dtype.kind in "buif" and dataset.shape is not None
    except (TypeError, ValueError, RuntimeError, OverflowError):
        return False


def samples_of(
    path: Path, dataset: Any, index: Sequence[int | slice], anywhere: bool, packed: Packed | None = None
) -> np.ndarray | Chunked:
    """What `index` picks of a dataset, as [D, H, W]: mapped, read, or of over WHOLE bytes read in parts.

    Slices of the index begin at 0. Raises InputError for what must not be decoded.
    """
    _check(dataset, anywhere)
    if anywhere:
        # links may lead to another file
        path = Path(dataset.file.filename)
    offset = None if dataset.external or dataset.chunks else dataset.id.get_offset()
    if offset is not None and packed is None:
        return map_array(path, int(offset), dataset.dtype, dataset.shape)[tuple(index)]
    part = _Part(path, dataset, index, packed)
    if byte_count(part.free, part.dtype) > WHOLE:
        return Chunked(str(path), part, part.index, part, "HDF5")
    if not anywhere:
        require_plausible(byte_count(part.free, dataset.dtype), dataset.id.get_storage_size(), bounded=False)
    return part[part.index]


def _check(dataset: Any, anywhere: bool) -> None:
    """InputError for data in other files, for filters without a bound, and for very large chunks."""
    if not anywhere and (dataset.external or dataset.is_virtual):
        raise _elsewhere(dataset.name, dataset.external[0][0] if dataset.external else "a virtual dataset")
    stated = dataset.id.get_create_plist()
    codes = [stated.get_filter(number)[0] for number in range(stated.get_nfilters())]
    unknown = [str(code) for code in codes if code not in _FILTERS]
    if unknown or codes.count(_GZIP) > 1:
        fix = "repack it with: h5repack -f GZIP=4 OLD NEW"
        known = ", ".join(_FILTERS.values())
        raise expected("filters", f"some of {known}", ", ".join(unknown) or "gzip twice", fix)
    chunk = byte_count(dataset.chunks or (), dataset.dtype)
    if chunk > MAX_BYTES:
        fix = "repack it with smaller ones: h5repack -l CHUNK=64x64x64 OLD NEW"
        raise expected("chunks", f"at most {MAX_BYTES} bytes each", chunk, fix)


def _elsewhere(name: str, where: str) -> InputError:
    fix = "copy it there with h5repack, or say --anywhere if you trust it"
    return expected(name, "data in this file", f"data elsewhere ({where})", fix)


class _Part:
    """A dataset as `Chunked` reads it, and the file behind it; each chunk is checked before HDF5 decodes it."""

    def __init__(self, path: Path, dataset: Any, index: Sequence[int | slice], packed: Packed | None) -> None:
        self.path, self.dataset, self.index, self.packed = path.resolve(), dataset, tuple(index), packed
        ends = zip(self.index, dataset.shape, strict=True)
        self.shape = tuple(size if isinstance(at, int) or at.stop is None else at.stop for at, size in ends)
        self.free = [size for size, at in zip(self.shape, self.index, strict=True) if isinstance(at, slice)]
        self.dtype = np.dtype(np.float32) if packed else np.dtype(dataset.dtype)
        self.stored = tuple(dataset.chunks or ())
        self.chunks = self._joined()
        self.empty = not dataset.is_virtual and not dataset.external and not dataset.id.get_storage_size()
        self.checked = dataset.compression == "gzip"
        with library("HDF5"):
            self.fill_value = self._values(np.asarray(dataset.fillvalue)[None])[0]

    def _joined(self) -> tuple[int, ...]:
        """Samples along each axis that are read together: chunks of the file, many if they are small."""
        sizes = list(self.stored or (1,) * len(self.shape))
        while byte_count(sizes, self.dtype) <= _PART_BYTES // 2:
            short = [
                axis for axis, at in enumerate(self.index) if isinstance(at, slice) and sizes[axis] < self.shape[axis]
            ]
            if not short:
                break
            # the shortest; of several that which runs faster in the file
            axis = min(short, key=lambda axis: (sizes[axis], -axis))
            sizes[axis] *= 2
        return tuple(sizes)

    def _values(self, stored: np.ndarray) -> np.ndarray:
        if self.packed is None:
            return stored
        values = np.float64(self.packed.scale) * stored + self.packed.offset
        return np.where(stored == self.packed.fill, np.nan, values).astype(np.float32)

    def __getitem__(self, key: tuple[int | slice, ...]) -> np.ndarray:
        with library("HDF5"):
            for place in self._touched(key) if self.checked else ():
                self._check_chunk(place)
            return self._values(np.asarray(self.dataset[key]))

    def _touched(self, key: tuple[int | slice, ...]) -> Iterable[tuple[int, ...]]:
        """The first sample of each chunk in the file that is to be read."""
        ends = [(at, at + 1) if isinstance(at, int) else (at.start or 0, at.stop) for at in key]
        return product(
            *(
                range(low - low % step, size if high is None else high, step)
                for (low, high), size, step in zip(ends, self.shape, self.stored, strict=True)
            )
        )

    def _check_chunk(self, place: tuple[int, ...]) -> None:
        """InputError if the chunk expands beyond its size."""
        told = self.dataset.id.get_chunk_info_by_coord(place)
        if told.byte_offset is not None and told.size * DEFLATE_RATIO > MAX_BYTES:
            require_bytes(told.size, self.path.stat().st_size)
            _check_inflated(self.dataset.id.read_direct_chunk(place)[1], byte_count(self.stored, self.dataset.dtype))

    def tag(self) -> str:
        """The path, size and time of the file, and the dataset in it."""
        told = self.path.stat()
        return f"{self.path} {told.st_size} {told.st_mtime_ns} {self.dataset.name} {self.packed}"

    def ready(self, places: Iterable[Sequence[int]]) -> None:
        """Nothing is to be brought here."""

    def holds(self, place: Sequence[int]) -> bool:
        """Whether anything may be stored for the samples that are read together there."""
        if self.empty or self.chunks != self.stored:
            return not self.empty
        begin = tuple(at - at % size for at, size in zip(place, self.stored, strict=True))
        return self.dataset.id.get_chunk_info_by_coord(begin).byte_offset is not None


def _check_inflated(data: bytes, room: int) -> None:
    """InputError if zlib data expand beyond `room` bytes."""
    engine, size, piece = zlib.decompressobj(), 0, data
    while size <= room and piece:
        size += len(engine.decompress(piece, CHUNK_BYTES))
        piece = engine.unconsumed_tail
    if size > room:
        raise expected("chunk", f"{room} bytes", "more", "the file is damaged")
