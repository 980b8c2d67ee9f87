"""Levels of a multiscale TIFF file as samples that are read in parts, through tifffile and zarr."""

from __future__ import annotations

import weakref
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from splatgl.data.readers.chunked import Chunked
from splatgl.data.readers.files import library
from splatgl.data.readers.tiff_lzw import guard
from splatgl.data.readers.turned import Turned
from splatgl.errors import missing_extra

OTHER_KINDS = ("avs", "bif", "eer", "mmstack", "ndpi", "ndtiff", "philips", "qpi", "scn", "svs")
"""Kinds of slide scanners' pictures and of series over many files, which are read as plain pages."""


def open_tiff(path: Path) -> Any:
    """The file in tifffile; other files that OME's metadata name are ignored."""
    try:
        import tifffile
    except ImportError:
        raise missing_extra("TIFF files", "tifffile", "readers") from None
    kinds: Any = {f"is_{kind}": False for kind in OTHER_KINDS}
    with library("TIFF"):
        return tifffile.TiffFile(path, _multifile=False, **kinds)


def parts(path: Path, place: int, levels: Sequence[int], axes: str, index: Sequence[int | slice]) -> list[Chunked]:
    """What `index` leaves free of those levels of an image, by its place in tiff.series; the file is open as long as
    one of them lives. axes: of the index; one that the series lacks has one entry.
    """
    try:
        import zarr
    except ImportError:
        raise missing_extra("multiscale TIFF files", "zarr", "readers") from None
    file = _OneFile(path)
    with library("TIFF"):
        series = file.tiff.series[place]
        for level in levels:
            guard(series.levels[level].pages)
        found = [(zarr.open_array(series.aszarr(level=level), mode="r"), series.levels[level].axes) for level in levels]
        arrays = [Turned(array, names, axes) for array, names in found]
    return [Chunked(str(path), array, index, file, "TIFF") for array in arrays]


class _OneFile:
    """An open file that holds all chunks."""

    def __init__(self, path: Path) -> None:
        self.path, self.tiff = path.resolve(), open_tiff(path)
        weakref.finalize(self, self.tiff.close)

    def tag(self) -> str:
        """The path, size and time of the file."""
        told = self.path.stat()
        return f"{self.path} {told.st_size} {told.st_mtime_ns}"

    def ready(self, places: Iterable[Sequence[int]]) -> None:
        """Nothing is to be brought here."""

    def holds(self, place: Sequence[int]) -> bool:
        """Every chunk is in the file."""
        return True
