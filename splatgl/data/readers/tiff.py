"""TIFF stacks, ImageJ and OME-TIFF through tifffile; contiguous uncompressed samples are memory-mapped.

Pages are planes along z, rows run along y, row 0 first. The resolution tags count only where ImageJ's metadata
confirms them: other programs write 72 dpi by default.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from splatgl.data.color import luma
from splatgl.data.errors import InputError, expected
from splatgl.data.readers.files import (
    MAX_BYTES,
    WHOLE,
    byte_count,
    library,
    map_array,
    require_bytes,
    require_plausible,
    selection,
)
from splatgl.data.readers.grid import METRES, unit_name
from splatgl.data.readers.options import LoadOptions
from splatgl.data.readers.several import as_microscope
from splatgl.data.readers.terrain import grey_heights, terrain_of_picture
from splatgl.data.readers.tiff_channels import several
from splatgl.data.readers.tiff_checks import check_chain, check_ome
from splatgl.data.readers.tiff_lzw import guard
from splatgl.data.readers.tiff_parts import open_tiff, parts
from splatgl.data.readers.xml_tree import parse_xml
from splatgl.data.sizes import require_memory
from splatgl.data.volume import Triple, Volume

_CODECS = {
    1: "none",
    5: "LZW",
    8: "deflate",
    32773: "PackBits",
    32946: "deflate",
    34925: "LZMA",
    34926: "Zstandard",
    50000: "Zstandard",
}
"""Compressions of whole numbers as they are: each is told how many bytes a strip may expand to."""

_FREE_PLANES, _PLANES_PER_PAGE = 4096, 64
"""Planes that metadata may state beyond the file's pages, as aborted recordings do; all that are missing read as 0."""

Grid = tuple[Triple, str]


@dataclass(frozen=True)
class _Series:
    """A level of the first series according to tifffile; offset: of its samples if they are one uncompressed run."""

    axes: str
    shape: tuple[int, ...]
    dtype: np.dtype
    offset: int | None
    is_color: bool
    is_compressed: bool
    segments: tuple[tuple[int, int], ...]
    grid: Grid

    @property
    def long(self) -> list[int]:
        """Axes that are z, y or x, or have more than one entry."""
        return [axis for axis, size in enumerate(self.shape) if size > 1 or self.axes[axis] in "ZYX"]


def read(path: Path, options: LoadOptions) -> Volume:
    """The volume of the first series of a TIFF file, or the terrain of a 2-D one.

    `channel` picks channels, `time` a time point, `level` one of a multiscale image, whose coarser levels are read in
    parts. Spacing and unit are those of ImageJ's or OME's metadata, else 1.
    """
    check_chain(path)
    with _complaints(), ExitStack() as stack:
        tiff = stack.enter_context(open_tiff(path))
        with library("TIFF"):
            if tiff.ome_metadata:
                check_ome(parse_xml(tiff.ome_metadata, "OME-XML"))
            found = [_describe(level, tiff) for level in tiff.series[0].levels]
        number = options.level or 0
        if number >= len(found) or (options.level is not None and len(found) == 1):
            this = f"a number from 0 to {len(found) - 1}" if len(found) > 1 else "a multiscale image"
            raise expected("level", this, number)
        for series in found:
            _check_bytes(path, series)
        series = found[number]
        z = _stack_axis(series)
        if z is None:
            return terrain_of_picture(path, grey_heights(np.squeeze(_pixels(path, tiff, series, number))), options)
        large = len(found) > 1 and series.offset is None and byte_count(series.shape, series.dtype) > WHOLE
        times = dict(zip(series.axes, series.shape, strict=True)).get("T", 1)
        time = options.time_number(times) if times > 1 else 0
        pixels = None if large else _pixels(path, tiff, series, number, time)

        def read_one(channel: int | None) -> Volume:
            whole = _is_rgb(series) and (channel is None or _is_channelled(series))
            index = _index(series, z, replace(options, channel=0 if channel is None and whole else channel))
            here = index if pixels is None else _index_of(pixels, index)
            (samples,) = parts(path, [number], series.axes, index) if pixels is None else [pixels[here]]
            volume = _on_grid(samples, series, found[0])
            if pixels is not None and whole:
                return _colored(volume, pixels, here, series)
            if options.level is not None or len(found) == 1:
                return volume
            others = [n for n, level in enumerate(found) if n and _alike(level, series)]
            coarser = zip(parts(path, others, series.axes, index), others, strict=True)
            return replace(volume, coarser=tuple(_on_grid(samples, found[n], series) for samples, n in coarser))

        with library("TIFF"):
            told = several(tiff, series.axes, series.shape)
        volume = told.volume(options, read_one)
        return as_microscope(volume) if tiff.ome_metadata or tiff.imagej_metadata else volume


def _is_rgb(series: _Series) -> bool:
    """Whether its samples are colours of 8 or 16 bits, with or without alpha."""
    count = dict(zip(series.axes, series.shape, strict=True)).get("S", 0)
    return series.is_color and count in (3, 4) and series.dtype in (np.uint8, np.uint16)


def _is_channelled(series: _Series) -> bool:
    """Whether samples of a pixel are not its channels, but the colours of each channel."""
    return "C" in (series.axes[axis] for axis in series.long)


def _colored(volume: Volume, pixels: np.ndarray, index: tuple[int | slice, ...], series: _Series) -> Volume:
    """The volume with its colours, and their luma as samples. index: of one component."""
    axis = series.axes.index("S")
    every = (*index[:axis], slice(0, 3), *index[axis + 1 :])
    color = np.moveaxis(pixels[every], sum(isinstance(at, slice) for at in index[:axis]), -1)
    color = color if color.dtype.itemsize == 1 else (color >> 8).astype(np.uint8)
    return replace(volume, samples=luma(color), color=np.ascontiguousarray(color))


def _alike(level: _Series, finest: _Series) -> bool:
    """Whether it is the finest one with fewer places along z, y and x."""
    if level.axes != finest.axes:
        return False
    sizes = zip(level.axes, level.shape, finest.shape, strict=True)
    return all(size == finer or (axis in "ZYX" and size < finer) for axis, size, finer in sizes)


def _on_grid(samples: Any, level: _Series, finest: _Series) -> Volume:
    """The samples of a level, in the box of the finest."""
    sizes = [dict(zip(series.axes, series.shape, strict=True)) for series in (finest, level)]
    shrunk = [sizes[0].get(axis, 1) / sizes[1].get(axis, 1) for axis in "XYZ"]
    x, y, z = (size * factor for size, factor in zip(finest.grid[0], shrunk, strict=True))
    origin = [(size * (factor - 1)) / 2 for size, factor in zip(finest.grid[0], shrunk, strict=True)]
    return Volume(samples, (x, y, z), (origin[0], origin[1], origin[2]), unit=finest.grid[1])


@contextmanager
def _complaints() -> Iterator[None]:
    """Raises the first error that tifffile only logs: it reads truncated files without failing."""
    handler = _FirstError()
    logger = logging.getLogger("tifffile")
    propagate, logger.propagate = logger.propagate, False
    logger.addHandler(handler)
    try:
        yield
    finally:
        logger.removeHandler(handler)
        logger.propagate = propagate
    if handler.message:
        raise InputError(f"cannot be read as TIFF: {handler.message}; the file is cut short or damaged")


class _FirstError(logging.Handler):
    """Keeps the first error that is logged."""

    message = ""

    def emit(self, record: logging.LogRecord) -> None:
        if record.levelno >= logging.ERROR and not self.message:
            self.message = record.getMessage()


def _describe(series: Any, tiff: Any) -> _Series:
    _check_codec(series)
    pages = [page for page in series.pages if page is not None]
    guard(pages)
    segments = tuple(pair for page in pages for pair in zip(page.dataoffsets, page.databytecounts, strict=True))
    axes, shape = series.axes, tuple(series.shape)
    if min(shape, default=0) < 1:
        raise expected("size", "at least one entry along each axis", f"{axes} {shape}", "the header is damaged")
    if (tiff.ome_metadata or tiff.imagej_metadata) and _is_plane(axes, shape):
        at = axes.index("Y")
        axes, shape = f"{axes[:at]}Z{axes[at:]}", (*shape[:at], 1, *shape[at:])
    return _Series(
        axes=axes,
        shape=shape,
        dtype=np.dtype(series.dtype).newbyteorder(tiff.byteorder),
        offset=series.dataoffset,
        is_color=series.keyframe.photometric.name in ("RGB", "YCBCR", "CIELAB", "SEPARATED"),
        is_compressed=series.keyframe.compression != 1,
        segments=segments,
        grid=_grid(tiff),
    )


def _is_plane(axes: str, shape: tuple[int, ...]) -> bool:
    """Whether a microscope's series is one plane of several channels or time points."""
    long = {letter for letter, size in zip(axes, shape, strict=True) if size > 1 or letter in "YX"}
    return {"Y", "X"} <= long <= set("TCYXS") and not long.isdisjoint("TC") and "Z" not in axes


def _check_codec(series: Any) -> None:
    """Rejects non-plain sample types, codecs without a size bound, and strips larger than all samples."""
    frame = series.keyframe
    if series.dtype is None:
        raise expected("samples", "8 to 64 bits each", f"{frame.bitspersample} bits", "convert the file")
    if int(frame.compression) not in _CODECS:
        known = ", ".join(dict.fromkeys(_CODECS.values()))
        raise expected("compression", f"one of {known}", frame.compression.name, "save it with deflate")
    pages = [page for page in series.pages if page is not None]
    if len(series.pages) > _FREE_PLANES + _PLANES_PER_PAGE * len(pages):
        raise expected("planes", f"about the file's {len(pages)} pages", len(series.pages), "the metadata are damaged")
    strips, there = math.prod(frame.chunked), min(len(page.dataoffsets) for page in pages)
    if strips > there:
        raise expected("strips or tiles", f"{strips} a page", there, "the header is damaged")
    strip = math.prod(frame.chunks) * series.dtype.itemsize
    if strip > MAX_BYTES:
        raise expected("strips or tiles", f"at most {MAX_BYTES} bytes", strip, "the header is damaged")


def _check_bytes(path: Path, series: _Series) -> None:
    """Every strip must lie in the file, and the strips must be able to hold the samples."""
    if series.offset is not None:
        return
    require_bytes(max((start + count for start, count in series.segments), default=0), path.stat().st_size)
    needed, stored = byte_count(series.shape, series.dtype), sum(count for _, count in series.segments)
    if series.is_compressed:
        require_plausible(needed, stored, bounded=False)
    else:
        require_bytes(needed, stored)


def _stack_axis(series: _Series) -> int | None:
    """The axis of planes: Z, else the one other that is neither row, column, colour nor channel; None for a picture.

    Samples along a first axis S of a file that is not in colour are planes too: so are stacks often written.
    """
    letters = {axis: series.axes[axis] for axis in series.long}
    stacks = [axis for axis, letter in letters.items() if letter not in "YXCS"]
    stacks += [axis for axis, letter in letters.items() if letter == "S" and axis == 0 and not series.is_color]
    named = [axis for axis in stacks if letters[axis] == "Z"]
    if not stacks and "C" in letters.values():
        got = f"axes {series.axes} of shape {series.shape}"
        raise expected("axes", "a stack of planes or a grey picture", got, "save one channel")
    return next(iter(named + stacks), None)


def _index(series: _Series, z: int, options: LoadOptions) -> tuple[int | slice, ...]:
    """The index that selects [z, y, x] from the series' axes."""
    extra: dict[int, tuple[str, int | None]] = {}
    for axis, letter in enumerate(series.axes):
        if axis == z or letter in "YX":
            continue
        if letter == "T":
            entry: int | None = options.time_number(series.shape[axis])
        else:
            entry = options.channel_number if letter in "CS" else options.array_number(series.shape[axis])
            entry = 0 if letter == "S" and _is_rgb(series) and _is_channelled(series) else entry
        option = "time" if letter == "T" else "channel" if letter in "CS" else "array"
        extra[axis] = (option, entry if axis in series.long else 0)
    return selection(series.shape, extra)


def _index_of(pixels: np.ndarray, index: tuple[int | slice, ...]) -> tuple[int | slice, ...]:
    """The index in pixels that may be those of one time point alone."""
    return tuple(at if size > 1 or isinstance(at, slice) else 0 for at, size in zip(index, pixels.shape, strict=True))


def _pixels(path: Path, tiff: Any, series: _Series, level: int, time: int = 0) -> np.ndarray:
    """All samples [series.shape]; those of one time point, if they are pages of their own that have to be decoded."""
    if series.offset is not None:
        return map_array(path, series.offset, series.dtype, series.shape)
    with library("TIFF"):
        whole = tiff.series[0].levels[level]
        ahead, at = whole.shape[: -len(whole.keyframe.shape)], whole.axes.find("T")
        if 0 <= at < len(ahead) and math.prod(ahead) == len(whole):
            pages = np.arange(len(whole)).reshape(ahead).take(time, axis=at).ravel().tolist()
            if all(whole[page] is not None for page in pages):
                shape = (*series.shape[:at], 1, *series.shape[at + 1 :])
                require_memory(byte_count(shape, series.dtype), path.stat().st_size)
                return np.asarray(tiff.asarray(key=pages, series=0, level=level)).reshape(shape)
        require_memory(byte_count(series.shape, series.dtype), path.stat().st_size)
        return np.asarray(whole.asarray()).reshape(series.shape)


def _grid(tiff: Any) -> Grid:
    if tiff.ome_metadata:
        return _ome_grid(tiff.ome_metadata)
    if tiff.imagej_metadata:
        return _imagej_grid(tiff)
    return (1.0, 1.0, 1.0), ""


def _imagej_grid(tiff: Any) -> Grid:
    """ImageJ: samples per unit in the resolution tags, spacing of planes and the unit in its own metadata."""
    tags, metadata = tiff.pages[0].tags, tiff.imagej_metadata
    per_unit = [tags[name].value if name in tags else (1, 1) for name in ("XResolution", "YResolution")]
    x, y = (below / above if above > 0 and below > 0 else 1.0 for above, below in per_unit)
    z = abs(float(metadata.get("spacing", 1.0))) or 1.0
    return (x, y, z), unit_name(str(metadata.get("unit", "")))


def _ome_grid(text: str) -> Grid:
    """OME: PhysicalSizeX/Y/Z, micrometres unless said otherwise; all are turned into the unit of x."""
    pixels = next(node for node in parse_xml(text, "OME-XML").iter() if node.tag.endswith("}Pixels"))
    sizes = {axis: float(pixels.get(f"PhysicalSize{axis}", 0)) for axis in "XYZ"}
    units = {axis: unit_name(pixels.get(f"PhysicalSize{axis}Unit", "um")) for axis in "XYZ"}
    if not any(sizes.values()):
        return (1.0, 1.0, 1.0), ""
    known = all(unit in METRES for unit in units.values())
    world = {axis: sizes[axis] * (METRES[units[axis]] / METRES[units["X"]] if known else 1.0) for axis in "XYZ"}
    # a size that is not given is taken from x, as for cubic voxels
    x, y, z = (world[axis] or world["X"] or 1.0 for axis in "XYZ")
    return (x, y, z), units["X"]
