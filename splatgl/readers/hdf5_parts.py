"""Samples of HDF5 datasets: mapped, read, or read in parts. Only filters with bounded results are run."""

from __future__ import annotations

import io
from collections.abc import Iterable, Sequence
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from splatgl.errors import expected
from splatgl.fileio import WHOLE_BYTES, byte_count
from splatgl.readers.chunked import Chunked, OneFile, Packing
from splatgl.readers.common import (
    DEFLATE_RATIO,
    MAX_BYTES,
    decoder_errors,
    inflated_size,
    map_array,
    require_bytes,
    require_plausible,
)
from splatgl.readers.hdf5_files import external_error

# filters by number whose results are bounded by the stored bytes; others state a size themselves, or are plug-ins
_FILTERS = {1: "gzip", 2: "shuffle", 3: "fletcher32", 32000: "lzf"}
_GZIP = 1

# least bytes that are read together, if the file's chunks are smaller
_PART_BYTES = 2**20


def read_samples(
    path: Path, dataset: Any, index: Sequence[int | slice], anywhere: bool, packed: Packing | None = None
) -> np.ndarray | Chunked:
    """The part `index` of a dataset, as [D, H, W]: mapped, read, or from WHOLE_BYTES on read in parts.

    Slices of the index begin at 0. Raises InputError for data that must not be decoded.
    """
    is_hdf5 = hasattr(dataset, "id")
    if is_hdf5:
        _check_storage(dataset, anywhere)
    if is_hdf5 and anywhere:
        # links may lead to another file
        path = Path(dataset.file.filename)
    offset = dataset.id.get_offset() if is_hdf5 and not (dataset.external or dataset.chunks) else None
    if offset is not None and packed is None:
        return map_array(path, int(offset), dataset.dtype, dataset.shape)[tuple(index)]
    part = (_DatasetPart if is_hdf5 else _Part)(path, dataset, index, packed)
    if byte_count(part.free, part.dtype) > WHOLE_BYTES:
        return Chunked(str(path), part, part.index, part, "HDF5" if is_hdf5 else "NetCDF")
    if is_hdf5 and not anywhere:
        require_plausible(byte_count(part.free, dataset.dtype), dataset.id.get_storage_size(), bounded=False)
    return part[part.index]


def _check_storage(dataset: Any, anywhere: bool) -> None:
    """Raises InputError for data in other files, for filters with unbounded results, and for very large chunks."""
    if not anywhere and (dataset.external or dataset.is_virtual):
        raise external_error(dataset.name, dataset.external[0][0] if dataset.external else "a virtual dataset")
    stated = dataset.id.get_create_plist()
    codes = [stated.get_filter(number)[0] for number in range(stated.get_nfilters())]
    unknown = [str(code) for code in codes if code not in _FILTERS]
    if unknown or codes.count(_GZIP) > 1:
        fix = "repack it with: h5repack -f GZIP=4 OLD NEW"
        known = ", ".join(_FILTERS.values())
        raise expected("filters", f"only {known}", ", ".join(unknown) or "gzip twice", fix)
    chunk = byte_count(dataset.chunks or (), dataset.dtype)
    if chunk > MAX_BYTES:
        fix = "repack it with smaller ones: h5repack -l CHUNK=64x64x64 OLD NEW"
        raise expected("chunks", f"at most {MAX_BYTES} bytes each", chunk, fix)


class _Part(OneFile):
    """An array with h5py's names for `Chunked`, and its file."""

    fill_value: Any = 0

    def __init__(self, path: Path, dataset: Any, index: Sequence[int | slice], packed: Packing | None) -> None:
        super().__init__(path)
        self.dataset, self.index, self.packed = dataset, tuple(index), packed
        ends = zip(self.index, dataset.shape, strict=True)
        self.shape = tuple(size if isinstance(at, int) or at.stop is None else at.stop for at, size in ends)
        self.free = [size for size, at in zip(self.shape, self.index, strict=True) if isinstance(at, slice)]
        self.dtype = np.dtype(np.float32) if packed else np.dtype(dataset.dtype)
        self.stored = tuple(dataset.chunks or ())
        self.chunks = self._joined()

    def _joined(self) -> tuple[int, ...]:
        """Samples along each axis that are read together: one chunk of the file, or several small ones."""
        sizes = list(self.stored or (1,) * len(self.shape))
        while byte_count(sizes, self.dtype) <= _PART_BYTES // 2:
            short = [
                axis for axis, at in enumerate(self.index) if isinstance(at, slice) and sizes[axis] < self.shape[axis]
            ]
            if not short:
                break
            # the shortest axis; of equal ones the faster one in the file
            axis = min(short, key=lambda axis: (sizes[axis], -axis))
            sizes[axis] *= 2
        return tuple(sizes)

    def _values(self, stored: np.ndarray) -> np.ndarray:
        return stored if self.packed is None else self.packed.values(stored)

    def __getitem__(self, key: tuple[int | slice, ...]) -> np.ndarray:
        return self._values(np.asarray(self.dataset[key]))

    def tag(self) -> str:
        """The path, size and time of the file, and the dataset in it."""
        return f"{super().tag()} {self.dataset.name} {self.packed}"


class _DatasetPart(_Part):
    """A dataset of HDF5 for `Chunked`; each chunk is checked before HDF5 decodes it."""

    def __init__(self, path: Path, dataset: Any, index: Sequence[int | slice], packed: Packing | None) -> None:
        super().__init__(path, dataset, index, packed)
        self.empty = not dataset.is_virtual and not dataset.external and not dataset.id.get_storage_size()
        self.checked = dataset.compression == "gzip"
        with decoder_errors("HDF5"):
            self.fill_value = self._values(np.asarray(dataset.fillvalue)[None])[0]

    def __getitem__(self, key: tuple[int | slice, ...]) -> np.ndarray:
        with decoder_errors("HDF5"):
            for place in self._touched(key) if self.checked else ():
                self._check_chunk(place)
            return super().__getitem__(key)

    def _touched(self, key: tuple[int | slice, ...]) -> Iterable[tuple[int, ...]]:
        """Index of the first sample of each chunk of the file that is to be read."""
        ends = [(at, at + 1) if isinstance(at, int) else (at.start or 0, at.stop) for at in key]
        return product(
            *(
                range(low - low % step, size if high is None else high, step)
                for (low, high), size, step in zip(ends, self.shape, self.stored, strict=True)
            )
        )

    def _check_chunk(self, place: tuple[int, ...]) -> None:
        """Raises InputError if the chunk expands beyond its size."""
        chunk = self.dataset.id.get_chunk_info_by_coord(place)
        if chunk.byte_offset is not None and chunk.size * DEFLATE_RATIO > MAX_BYTES:
            require_bytes(chunk.size, self.path.stat().st_size)
            room = byte_count(self.stored, self.dataset.dtype)
            if inflated_size(io.BytesIO(self.dataset.id.read_direct_chunk(place)[1]), room) > room:
                raise expected("chunk", f"{room} bytes", "more", "the file is damaged")

    def holds(self, place: Sequence[int]) -> bool:
        """Whether the file may store the samples that are read together there."""
        if self.empty or self.chunks != self.stored:
            return not self.empty
        begin = tuple(at - at % size for at, size in zip(place, self.stored, strict=True))
        return self.dataset.id.get_chunk_info_by_coord(begin).byte_offset is not None
