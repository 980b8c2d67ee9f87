"""Checks the files, codecs and chunks of a Zarr store before zarr decodes anything."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

from splatgl.errors import expected
from splatgl.fileio import byte_count
from splatgl.readers.chunked import OneFile, folder_tag
from splatgl.readers.common import DEFLATE_RATIO, MAX_BYTES, inflated_size, require_plausible
from splatgl.readers.zarr_zip import ZipPath

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


class ChunkFiles(OneFile):
    """The files of an array's chunks, each checked before it is decoded. path: of the store, a `Path` or `ZipPath`.
    fetch: brings files of the store here.

    index: turns a caller's index into the array's, where the caller has its axes in another order.
    """

    def __init__(self, path: Any, array: Any, fetch: Fetch | None = None) -> None:
        super().__init__(path)
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
