"""TIFF stacks, ImageJ and OME-TIFF through tifffile; contiguous uncompressed samples are memory-mapped.

Pages are planes along z, rows run along y, row 0 first. The resolution tags count only where ImageJ's metadata
backs them: other programs write 72 dpi without meaning it.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from types import ModuleType
from typing import Any
from xml.etree import ElementTree

import numpy as np

from splatgl.data.errors import InputError, expected, missing_extra
from splatgl.data.readers.files import library, map_array, require_bytes, require_plausible, selection
from splatgl.data.readers.grid import METRES, unit_name
from splatgl.data.readers.options import LoadOptions
from splatgl.data.readers.terrain import grey_heights, terrain_of_picture
from splatgl.data.volume import Triple, Volume

Grid = tuple[Triple, str]


def read(path: Path, options: LoadOptions) -> Volume:
    """The volume of the first series of a TIFF file, or the terrain of a 2-D one.

    `channel` picks one of several channels, `array` the number of a time point. Spacing and unit are those of
    ImageJ's or OME's metadata, else 1.
    """
    with _complaints(), ExitStack() as stack:
        with _decoding():
            tiff = stack.enter_context(_tifffile().TiffFile(path, _multifile=False))
            series = next(iter(tiff.series), None)
        if series is None:
            raise expected("contents", "an image", "none")
        _check_bytes(path, series)
        index = _index(series, options)
        pixels = _pixels(path, tiff, series)
        spacing, unit = _grid(tiff)
    if index is None:
        return terrain_of_picture(path, grey_heights(np.squeeze(pixels)), options)
    return Volume(pixels[index], spacing, unit=unit)


def _tifffile() -> ModuleType:
    try:
        import tifffile
    except ImportError:
        raise missing_extra("TIFF files", "tifffile", "readers") from None
    return tifffile


@contextmanager
def _decoding() -> Iterator[None]:
    """Around tifffile's own calls; the errors of its codecs are RuntimeErrors."""
    with library("TIFF", _tifffile().TiffFileError, RuntimeError):
        yield


@contextmanager
def _complaints() -> Iterator[None]:
    """Raises the first error that tifffile only logs: it reads what is left of a file cut short without failing."""
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
    message = ""

    def emit(self, record: logging.LogRecord) -> None:
        if record.levelno >= logging.ERROR and not self.message:
            self.message = record.getMessage()


def _check_bytes(path: Path, series: Any) -> None:
    """Every strip must lie in the file, and the strips must be able to hold the samples."""
    size, stored = path.stat().st_size, 0
    for page in series.pages:
        if page is not None:
            require_bytes(max(map(sum, zip(page.dataoffsets, page.databytecounts, strict=False)), default=0), size)
            stored += sum(page.databytecounts)
    if series.keyframe.compression == 1 and series.dataoffset is None:
        require_bytes(series.nbytes, stored)
    elif series.dataoffset is None:
        require_plausible(series.nbytes, stored, bounded=False)


def _index(series: Any, options: LoadOptions) -> tuple[int | slice, ...] | None:
    """What picks [z, y, x] from the series' axes; None for a 2-D picture."""
    axes, shape = series.axes, series.shape
    long = [axis for axis, size in enumerate(shape) if size > 1 or axes[axis] in "YXZ"]
    planar = series.keyframe.photometric.name not in ("RGB", "YCBCR", "CIELAB", "SEPARATED")
    # 1. z is the axis named Z, else the one other axis that is not a colour or channel
    stacks = [axis for axis in long if axes[axis] not in "YXC" and (axes[axis] != "S" or (planar and axis == 0))]
    named = [axis for axis in long if axes[axis] == "Z"]
    z = named[0] if named else stacks[0] if stacks else None
    if z is None and options.channel is None and not any(axes[axis] == "C" for axis in long):
        return None
    if z is None:
        raise expected("axes", "a stack of planes", f"axes {axes} of shape {shape}", "give a stack or a grey picture")
    # 2. one entry of every further axis
    extra: dict[int, tuple[str, int | None]] = {}
    for axis, letter in enumerate(axes):
        if axis != z and letter not in "YX":
            times = letter not in "CS"
            extra[axis] = ("array", options.array_number(shape[axis])) if times else ("channel", options.channel)
            extra[axis] = extra[axis] if shape[axis] > 1 else (extra[axis][0], 0)
    return selection(shape, extra)


def _pixels(path: Path, tiff: Any, series: Any) -> np.ndarray:
    if series.dataoffset is not None:
        return map_array(path, series.dataoffset, series.dtype.newbyteorder(tiff.byteorder), series.shape)
    with _decoding():
        return np.asarray(series.asarray())


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
    with library("OME-XML", ElementTree.ParseError):
        pixels = next(node for node in ElementTree.fromstring(text).iter() if node.tag.endswith("}Pixels"))
        sizes = {axis: float(pixels.get(f"PhysicalSize{axis}", 0)) for axis in "XYZ"}
    units = {axis: unit_name(pixels.get(f"PhysicalSize{axis}Unit", "um")) for axis in "XYZ"}
    if not any(sizes.values()):
        return (1.0, 1.0, 1.0), ""
    known = all(unit in METRES for unit in units.values())
    world = {axis: sizes[axis] * (METRES[units[axis]] / METRES[units["X"]] if known else 1.0) for axis in "XYZ"}
    # a size that is not given is taken from x, as for cubic voxels
    x, y, z = (world[axis] or world["X"] or 1.0 for axis in "XYZ")
    return (x, y, z), units["X"]
