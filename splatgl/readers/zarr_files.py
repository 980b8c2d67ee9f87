"""Zarr stores: checks of their files, codecs and chunks, stores in a zip, and coordinates by xarray.

Members are checked before anything reads them: what is deflated expands no more than MAX_BYTES, and metadata no more
than MOST_METADATA.
"""

from __future__ import annotations

import base64
import math
import os
import struct
import zipfile
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from splatgl.data.affine import Coordinate, CoordinateGrid, axis_kind, curved_notes, make_lattice
from splatgl.errors import expected, list_names
from splatgl.fileio import byte_count
from splatgl.readers.chunked import CF_NUMBERS, Packing, Stored, file_tag, folder_tag
from splatgl.readers.common import DEFLATE_RATIO, MAX_BYTES, decoder_errors, inflated_size, require_plausible
from splatgl.readers.contents import ZARR
from splatgl.readers.remote import MOST_METADATA


class ZipPath(zipfile.Path):
    """A file or folder in a zip, with what readers of stores use of a `Path` beside."""

    def __str__(self) -> str:
        return str(self.root.filename)

    def resolve(self) -> ZipPath:
        """The path itself."""
        return self

    def stat(self) -> Any:
        """The unpacked size, as st_size."""
        return SimpleNamespace(st_size=self.root.getinfo(self.at).file_size)

    def rglob(self, _pattern: str) -> Iterator[ZipPath]:
        """All files below."""
        names = (name for name in self.root.namelist() if name.startswith(self.at) and not name.endswith("/"))
        return (ZipPath(self.root, name) for name in names)

    def tag(self) -> str:
        """Text that changes with the contents."""
        return f"{file_tag(Path(str(self)).resolve())} {self.at}"


def open_zip(path: Path) -> tuple[Any, ZipPath, str]:
    """(zip as zarr reads it, its root, path of the only Zarr store in it). Raises InputError for a zip without one."""
    import zarr

    with decoder_errors("a zip"):
        archive = zipfile.ZipFile(path)
        store = zarr.storage.ZipStore(path, mode="r", read_only=True)
    members, folders = archive.infolist(), set[str]()
    if sum(member.compress_size for member in members) > path.stat().st_size:
        raise expected("zip", "separate members", "members that overlap", "the file is damaged")
    for member in members:
        if member.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED) or member.flag_bits & 1:
            raise expected(member.filename, "stored or deflated data", "another compression", "zip the folder again")
        folder, _, name = member.filename.rpartition("/")
        folders |= {folder} if name in ZARR[:3] else set()
        is_metadata = name in ZARR
        most = MOST_METADATA if is_metadata else MAX_BYTES if member.compress_type else path.stat().st_size
        if member.file_size > most:
            raise expected(member.filename, f"at most {most} bytes", member.file_size, "the file is damaged")
    least = min((folder.count("/") + bool(folder) for folder in folders), default=0)
    roots = sorted(folder for folder in folders if folder.count("/") + bool(folder) == least)
    if len(roots) != 1:
        raise expected("zip", "one Zarr store", list_names(roots) or "other files", "unpack it and name the store")
    return store, ZipPath(archive), roots[0]


Fetch = Callable[[Sequence[str]], None]

_COMPRESSORS = ("zlib", "gzip", "blosc", "zstd", "lz4")

# codecs that turn numbers into numbers; others run stored code (pickle), or have no bound
_FILTERS = (
    *("bytes", "transpose", "sharding_indexed", "crc32c", "crc32", "adler32"),
    *("shuffle", "delta", "fixedscaleoffset", "quantize", "bitround"),
)

# bytes of the header of a Blosc chunk; the last four are its length
_BLOSC_HEADER = 16
# chunks that may be read without a file each: they take a moment
_FREE_CHUNKS = 4096
# missing chunks per existing chunk: sparse volumes leave most of them out
_CHUNKS_PER_FILE = 64
# bytes of a shard's index per chunk, existing or not
_INDEX_BYTES = 16
# largest factor by which filters change the size of a sample: eight bytes for one
_DECLARED_ROOM = 8


def check_files(path: Path) -> None:
    """Raises InputError unless the store contains only plain files, folders, and links to files inside it."""
    root = path.resolve()
    folders = [path]
    while folders:
        with os.scandir(folders.pop()) as entries:
            for entry in entries:
                if entry.is_dir(follow_symlinks=False):
                    folders.append(Path(entry.path))
                elif not entry.is_file(follow_symlinks=False):
                    link = Path(entry.path)
                    if not (link.is_file() and link.resolve().is_relative_to(root)):
                        fix = "replace it by the file"
                        raise expected(link.name, "a file inside the store", "a link, pipe or device", fix)


# least samples of a chunk, if a store of very many chunks is read in parts
_LEAST_PARTS = 2**12


class ChunkFiles(Stored):
    """The files of an array's chunks, each checked before it is decoded. path: of the store, a `Path` or `ZipPath`.
    fetch: brings files of the store here.

    index: turns a caller's index into the array's, where the caller has its axes in another order.
    """

    def __init__(self, path: Any, array: Any, fetch: Fetch | None = None) -> None:
        self.path = path.resolve()
        self.folder, self.metadata, self.fetch = self.path / array.path, array.metadata, fetch
        self.index: Callable[[Sequence[int]], Sequence[int]] = tuple
        self.shape = array.shards or array.chunks
        self.bytes = byte_count(array.chunks, array.dtype)
        names = _codec_names(array)
        # a shard's chunks are read one by one, within their codec's ratio
        self.compressors = [name for name in names if name in _COMPRESSORS] if "sharding_indexed" not in names else []

    def tag(self) -> str:
        """Text that changes with the array's contents; for a growing copy its path and metadata."""
        if isinstance(self.folder, ZipPath):
            return self.folder.tag()
        if self.fetch is None:
            return folder_tag(self.folder)
        return f"{self.folder.resolve()} {sorted(self.metadata.to_dict().items())}"

    def ready(self, places: Iterable[Sequence[int]]) -> None:
        """Fetches the files of the chunks that hold the samples at `places`."""
        if self.fetch is not None:
            self.fetch(sorted({self._file(place).relative_to(self.path).as_posix() for place in places}))

    def holds(self, place: Sequence[int]) -> bool:
        """Whether the chunk of the sample at `place` has a file. Raises InputError if it must not be decoded."""
        file = self._file(place)
        there = file.is_file()
        if there:
            self.check(file)
        return there

    def _file(self, place: Sequence[int]) -> Any:
        key = tuple(at // size for at, size in zip(self.index(place), self.shape, strict=True))
        return self.folder / str(self.metadata.encode_chunk_key(key))

    def check(self, file: Path | ZipPath) -> None:
        """Raises InputError if the chunk expands beyond its size."""
        for name in self.compressors:
            _check_chunk(file, name, self.bytes)


def check_array(path: Path | ZipPath, array: Any, whole: bool = True, fetch: Fetch | None = None) -> ChunkFiles:
    """Raises InputError for codecs not known to be safe, and for chunks too large for their files.

    whole: whether the array is read at once; else each chunk's file is checked later. fetch: see ChunkFiles.
    """
    # 1. the codecs
    names = _codec_names(array)
    refused = [name for name in names if name not in (*_COMPRESSORS, *_FILTERS)]
    compressors = [name for name in names if name in _COMPRESSORS]
    if refused or len(compressors) > 1:
        known = ", ".join(_COMPRESSORS)
        raise expected("codecs", f"one of {known}", ", ".join(refused or compressors), "save it with blosc or zstd")
    # 2. the chunks on disk must be able to hold the array: a missing chunk costs nothing to write
    files = [file for file in (path / array.path).rglob("*") if file.is_file()]
    stored = sum(file.stat().st_size for file in files)
    if whole:
        require_plausible(byte_count(array.shape, array.dtype), stored, bounded=False)
    chunk = byte_count(array.chunks, array.dtype)
    if min(array.chunks) < 1 or chunk > MAX_BYTES:
        raise expected("chunks", f"at most {MAX_BYTES} bytes each", f"{chunk} {array.chunks}", "save smaller ones")
    # 3. each chunk costs time
    count = math.prod(-(-size // part) for size, part in zip(array.shape, array.chunks, strict=True))
    most = _FREE_CHUNKS + _CHUNKS_PER_FILE * len(files) + stored // _INDEX_BYTES
    if count > most and (whole or math.prod(array.chunks) < _LEAST_PARTS):
        raise expected("chunks", f"at most {most} for {len(files)} files", count, "save larger ones")
    # 4. no chunk may expand beyond its size
    chunk_files = ChunkFiles(path, array, fetch)
    if whole:
        for file in files:
            if file.name[:1] != "." and file.name != "zarr.json":
                chunk_files.check(file)
    return chunk_files


def _codec_names(array: Any) -> list[str]:
    """Names of all codecs of an array, in numcodecs or in format 3, also inside its shards."""
    metadata, names = array.metadata, []
    waiting = [*(metadata.filters or ()), metadata.compressor] if metadata.zarr_format == 2 else [*metadata.codecs]
    while waiting:
        codec = waiting.pop()
        if codec is not None:
            name = getattr(codec, "codec_id", None) or codec.to_dict()["name"]
            names.append(str(name).removeprefix("numcodecs."))
            waiting += [*getattr(codec, "codecs", ()), *getattr(codec, "index_codecs", ())]
    return names


def _check_chunk(file: Path | ZipPath, compressor: str, chunk: int) -> None:
    """Raises InputError if the chunk's header states, or long zlib data show, an expansion beyond `chunk` bytes."""
    stored, room = file.stat().st_size, _DECLARED_ROOM * chunk
    with file.open("rb") as opened:
        if compressor in ("zlib", "gzip"):
            size = inflated_size(opened, room) if stored * DEFLATE_RATIO > MAX_BYTES else 0
        else:
            head = opened.read(18)
            size = _declared_size(head, compressor, stored)
    # Blosc does not know where a chunk ends: it reads as many bytes as the header states
    if compressor == "blosc" and not _BLOSC_HEADER <= (length := int.from_bytes(head[12:16], "little")) <= stored:
        raise expected(f"chunk {file.name}", f"{stored} bytes stored", f"{length} stated", "the file is damaged")
    if size > room:
        raise expected(f"chunk {file.name}", f"{chunk} bytes", f"{size} at least", "the file is damaged")


def _declared_size(head: bytes, compressor: str, stored: int) -> int:
    """Bytes that the chunk's header states."""
    if compressor == "blosc":
        return int.from_bytes(head[4:8], "little")
    if compressor == "lz4":
        return int.from_bytes(head[:4], "little")
    # Zstandard (RFC 8878 §3.1.1.1): a descriptor, optional window and dictionary, then the optional size
    descriptor = head[4] if len(head) > 4 else 0
    single, width = descriptor >> 5 & 1, (1, 2, 4, 8)[descriptor >> 6]
    if descriptor >> 6 == 0 and not single:
        return stored * _ZSTD_RATIO
    start = 5 + (not single) + (0, 1, 2, 4)[descriptor & 3]
    return int.from_bytes(head[start : start + width], "little") + (256 if width == 2 else 0)


# most bytes per byte of Zstandard data: a block of 2**17 bytes takes four
_ZSTD_RATIO = 2**15


# most coordinates that are read along a dimension, and most bytes of one that is text
MOST_COORDINATES, MOST_TEXT = 2**20, 2**10


def dimension_names(node: Any) -> list[str]:
    """Names of an array's dimensions, "" for an unnamed one; [] if the array states none."""
    stated = getattr(node.metadata, "dimension_names", None) or node.attrs.asdict().get("_ARRAY_DIMENSIONS") or []
    names = [str(name or "") for name in stated]
    return names if len(names) == len(node.shape) else []


def read_lattice(group: Any, node: Any, names: Sequence[str], even: bool) -> CoordinateGrid:
    """The grid by the coordinates along z, y and x; even: whether their places do not count."""
    axes = _read_coordinates(group, node, names)
    grid = make_lattice(axes, even=even)
    stated = [owner.attrs.asdict().get("coordinates") for owner in (node, group) if owner is not None]
    about: dict[str, dict[str, Any]] = {name: {} for name in str(next(filter(None, stated), "")).split()}
    is_placed = even or all(axis.places is not None for axis in axes[1:])
    return replace(grid, notes=(*grid.notes, *curved_notes(about, is_placed)))


def _read_coordinates(group: Any, node: Any, names: Sequence[str]) -> list[Coordinate]:
    """Coordinates along z, y and x, from arrays with the dimensions' names (xarray, CF)."""
    dimensions = dimension_names(node)
    coordinates = []
    for name in ("z", "y", "x"):
        axis = names.index(name)
        scale = _find_scale(group, dimensions[axis], node.shape[axis]) if dimensions else None
        if scale is None:
            coordinates.append(Coordinate(dimensions[axis] if dimensions else name, node.shape[axis]))
        else:
            packing = read_packing(scale)
            places = np.asarray(scale[:] if packing is None else packing.values(scale[:]), np.float64)
            coordinates.append(Coordinate.of(dimensions[axis], places, scale.attrs.asdict()))
    return coordinates


def _find_scale(group: Any, name: str, size: int) -> Any:
    """The array of a dimension's coordinates, None without one."""
    node: Any = group.get(name) if group is not None and name else None
    is_scale = getattr(node, "shape", None) == (size,) and node.dtype.kind in "uif" and size <= MOST_COORDINATES
    return node if is_scale else None


def read_packing(node: Any) -> Packing | None:
    """The packing in an array's CF attributes, as xarray writes them, or None; format 2 has a fill value instead."""
    attributes = node.attrs.asdict()
    stated = {name: _parse_numbers(attributes.get(name)) for name in CF_NUMBERS}
    if stated["_FillValue"] is None and dimension_names(node) and node.metadata.zarr_format == 2 and node.fill_value:
        # zarr itself fills with 0
        stated["_FillValue"] = _parse_numbers(node.fill_value)
    return Packing.of(stated, node.dtype, attributes.get("_Unsigned"))


def _parse_numbers(value: Any) -> np.ndarray | None:
    """Numbers, or one coded as base64 of eight bytes, as xarray writes floats in format 3; else None."""
    if isinstance(value, str):
        try:
            return np.array(struct.unpack("<d", base64.b64decode(value, validate=True)))
        except (ValueError, struct.error):
            return None
    numbers = np.asarray(value).ravel()
    return numbers if numbers.dtype.kind in "uif" else None


def dimension_kind(group: Any, name: str, size: int) -> str:
    """z, y, x, t or c, by a dimension's coordinates or name; else its name."""
    scale = _find_scale(group, name, size)
    kind = axis_kind(name, {} if scale is None else scale.attrs.asdict())
    return {"time": "t"}.get(kind, kind or name.lower() or "?")


def channel_names(group: Any, node: Any, names: Sequence[str], count: int) -> list[dict[str, str]]:
    """Names of channels in an array of text with the dimension's name, as xarray writes them; [] without them."""
    dimensions = [name for name, kind in zip(dimension_names(node), names, strict=False) if kind not in tuple("zyxt")]
    texts: Any = group.get(dimensions[0]) if group is not None and len(dimensions) == 1 else None
    is_text = (
        getattr(texts, "shape", None) == (count,) and texts.dtype.kind in "US" and texts.dtype.itemsize <= MOST_TEXT
    )
    return [{"label": str(text)} for text in texts[:]] if is_text else []
