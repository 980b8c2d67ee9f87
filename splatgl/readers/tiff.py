"""TIFF, OME-TIFF and stacks of ImageJ.

Pages are planes along z, rows run along y, row 0 first. Resolution tags that programs write without knowing any, such
as 72 dpi, do not count.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np

from splatgl.data.affine import shared_unit, unit_name
from splatgl.data.volume import Lengths, Triple, Volume, triple
from splatgl.errors import InputError, expected, import_extra
from splatgl.fileio import WHOLE_BYTES, byte_count, held_within_budget, require_memory
from splatgl.readers.channels import MAGNITUDE_NOTE, magnitudes, mark_microscope, split_colors
from splatgl.readers.chunked import Chunked, OneFile, TransposedChunks
from splatgl.readers.common import (
    decoder_errors,
    find_data_file,
    map_array,
    parse_xml,
    require_bytes,
    require_plausible,
)
from splatgl.readers.heightmap import HEIGHTS, HeightMetadata, classify_picture, grey_heights, make_plane, make_terrain
from splatgl.readers.options import LoadOptions
from splatgl.readers.tiff_images import (
    calibrate,
    find_calibration,
    find_channels,
    find_files,
    find_pixels,
    list_series,
    plane_step,
    read_survey,
    select_image,
)
from splatgl.readers.tiff_validation import check_before_decoding, check_chain, check_ome, check_page, check_strips

# planes that metadata may state beyond the file's pages, as aborted recordings do; missing planes are read as 0
_FREE_PLANES, _PLANES_PER_PAGE = 4096, 64
# most bands of a survey in planes of their own; more are a stack
_MOST_BANDS = 4
# resolutions that programs write without knowing any, and millimetres of an inch
_USUAL_DPI, _INCH = (72, 75, 96, 100, 120, 150, 200, 300, 600, 1200), 25.4
# TIFF's number of centimetres, and micrometres in one
_CENTIMETRES, _MICROMETRES = 3, 1e4
Grid = tuple[Triple, str]


@dataclass(frozen=True)
class _Series:
    """A level of tifffile's series. offset: of samples in one uncompressed run, else None. bits: of a stored sample."""

    axes: str
    shape: tuple[int, ...]
    dtype: np.dtype
    offset: int | None
    is_color: bool
    is_compressed: bool
    bits: int
    grid: Grid

    @property
    def long(self) -> list[int]:
        """Axes z, y and x, and axes with more than one entry."""
        return [axis for axis, size in enumerate(self.shape) if size > 1 or self.axes[axis] in "ZYX"]


def list_images(path: Path) -> list[str]:
    """A line for each image of a file: its number, name and size; a star marks the image that `read` selects."""
    check_chain(path)
    with logged_errors(), open_tiff(path) as tiff, decoder_errors("TIFF"):
        return list_series(tiff.series)


def read(path: Path, options: LoadOptions) -> Volume:
    """The volume of a TIFF file's largest image, or of image `series`; a 2-D image becomes a terrain or a plane.

    `channel` picks channels, `time` a time point, `level` a level of a multiscale image, whose coarser levels are read
    in parts. Spacing and unit come from ImageJ's or OME's metadata, else 1.
    """
    check_chain(path)
    with logged_errors(), ExitStack() as stack:
        tiff = stack.enter_context(open_tiff(path))
        with decoder_errors("TIFF"):
            root = parse_xml(tiff.ome_metadata, "OME-XML") if tiff.ome_metadata else None
            if root is not None:
                check_ome(root)
        names = find_files(root, path.name)
        if names:
            for name in names:
                if (path.parent / name).is_file():
                    check_chain(find_data_file(path, name, options.anywhere))
            tiff = stack.enter_context(open_tiff(path, is_several=True))
        with decoder_errors("TIFF"):
            pages = (filter(None, series.pages) for series in tiff.series if names)
            held = [{page.parent.filehandle.name for page in some} for some in pages]
            own = [n for n, files in enumerate(held) if path.name in files]
            chosen = replace(options, series=own[0] + 1) if len(own) == 1 and options.series is None else options
            place, notes = select_image(tiff.series, chosen)
            pixels = find_pixels(tiff, place)
            survey = read_survey(tiff.series[place].keyframe)
        image = _Image(path, tiff, place, pixels, survey)
        volume = _read_image(image, options)
        notes += (f"planes are in {len(names)} files of the folder",) * image.series.is_multifile
        return replace(volume, notes=(*notes, *_ignored_notes(image), *volume.notes))


@dataclass(frozen=True)
class _Image:
    """An image of an open file: its index in tiff.series, OME's element Pixels, and its survey of heights."""

    path: Path
    tiff: Any
    place: int
    pixels: Element | None
    survey: HeightMetadata | None

    @property
    def series(self) -> Any:
        """tifffile's series."""
        return self.tiff.series[self.place]

    @property
    def is_microscope(self) -> bool:
        """Whether the image has the metadata of OME, ImageJ or LSM."""
        return self.pixels is not None or bool(self.tiff.imagej_metadata) or bool(self.tiff.is_lsm)

    def is_plane(self, options: LoadOptions) -> bool:
        """Whether a single picture is a microscope's plane by its metadata."""
        heights = self.survey is not None or bool(HEIGHTS.search(self.path.name.lower()))
        is_terrain = options.values == "heights" or options.color is not None or options.relief is not None
        return self.is_microscope and not is_terrain and (options.values is not None or not heights)


def _ignored_notes(image: _Image) -> list[str]:
    """Notes on statements of the file that are ignored."""
    notes = []
    if image.tiff.ome_metadata and image.series.kind != "ome":
        notes.append("OME's metadata name other files, or planes that are not here: only this one's pages are read")
    if image.pixels is not None and (note := plane_step(image.pixels)[2]):
        notes.append(note)
    lost = sum(page is None for page in image.series.pages)
    notes += [f"{lost} planes are missing, and are rendered as 0"] * bool(lost)
    dpi, survey = tiff_dpi(image.series.keyframe), image.survey
    if resolution_grid(dpi)[0][1] and stated_grid(image.tiff, image.pixels) is None and not (survey and survey.step):
        notes.append(resolution_grid(dpi)[1])
    return [*notes, *value_notes(image.series.keyframe)]


def value_notes(page: Any) -> list[str]:
    """Notes on the values of a page, and on tags that do not affect them."""
    calibration = find_calibration(page.parent)
    notes = {
        str(calibration): calibration is not None,
        "values are as they are stored, though the file shows 0 as white": page.photometric.name == "MINISWHITE",
        "values are indices of the file's colour table, which is not applied": page.photometric.name == "PALETTE"
        and not page.parent.is_imagej,
        "rows and columns are as stored: the tag of their orientation is not applied": page.tags.valueof(274, 1) != 1,
        MAGNITUDE_NOTE: page.dtype is not None and page.dtype.kind == "c",
    }
    return [note for note, applies in notes.items() if applies]


def _read_image(image: _Image, options: LoadOptions) -> Volume:
    tiff = image.tiff
    with decoder_errors("TIFF"):
        levels = [_describe_level(level, image, image.is_plane(options)) for level in image.series.levels]
    number = options.level or 0
    if number >= len(levels) or (options.level is not None and len(levels) == 1):
        this = f"a number from 0 to {len(levels) - 1}" if len(levels) > 1 else "a multiscale image"
        raise expected("level", this, number)
    series = levels[number]
    z = _stack_axis(series)
    if z is None or (_band_axis(image, series) == z and series.shape[z] <= _MOST_BANDS):
        return _picture_volume(image, series, number, options)
    _reject_options(series, z, options)
    size = byte_count(series.shape, series.dtype)
    large = len(levels) > 1 and series.offset is None and size > held_within_budget(WHOLE_BYTES)

    def read_one(channel: int | None) -> Volume:
        colored = _is_rgb(series) and (channel is None or _is_channelled(series))
        index = _index(series, z, replace(options, channel=0 if channel is None and colored else channel))
        if colored and not large:
            gray, color = _read_colors(image, series, number, index)
            return replace(_level_volume(gray, series, levels[0]), color=color)
        samples: Any
        if large:
            (samples,) = read_in_parts(image, [number], series.axes, index)
        else:
            samples = values_of(_read_pixels(image, series, number, index), tiff)
        volume = _level_volume(_mask_missing(samples, image.survey), series, levels[0])
        if options.level is not None or len(levels) == 1:
            return volume
        others = [n for n, level in enumerate(levels) if n and _is_coarser_level(level, series)]
        coarser = zip(read_in_parts(image, others, series.axes, index), others, strict=True)
        return replace(volume, coarser=tuple(_level_volume(samples, levels[n], series) for samples, n in coarser))

    with decoder_errors("TIFF"):
        channel_set = find_channels(tiff, image.pixels, series.axes, series.shape)
    if series.axes[z] == "S":
        channel_set = replace(channel_set, components=1)
    volume = channel_set.volume(options, read_one)
    if (calibration := find_calibration(tiff)) is not None:
        parts = tuple(replace(part, value_unit=calibration.unit) for part in volume.channels)
        volume = replace(volume, value_unit=calibration.unit, channels=parts)
    return mark_microscope(volume) if image.survey is None else volume


def _picture_volume(image: _Image, series: _Series, number: int, options: LoadOptions) -> Volume:
    """The terrain or the plane of a single picture; of the bands of a survey one is read."""
    bands, band_note = _band_axis(image, series), ""
    for name in ("array", "time", *["channel"] * (bands is None)):
        options.reject(name, "a stack, where this is a single picture")
    pixels = _read_pixels(image, series, number)
    if bands is not None:
        band = options.channel_number(pixels.shape[bands]) or 0
        band_note = f"band {band} of {pixels.shape[bands]} is read: --channel picks another"
        pixels = pixels.take(band, axis=bands)
    rows = np.squeeze(pixels)
    rows = rows.reshape(rows.shape if rows.ndim > 1 else (1, -1))
    rows = rows if series.is_color else values_of(rows, image.tiff)
    is_map, note = classify_picture(image.path, rows, options, image.survey is not None)
    if is_map:
        volume = make_terrain(image.path, grey_heights(rows), options, image.survey)
    else:
        volume = replace(mark_microscope(make_plane(rows)), spacing=series.grid[0], unit=series.grid[1])
    return replace(volume, notes=(*volume.notes, *filter(None, (band_note, note))))


def _band_axis(image: _Image, series: _Series) -> int | None:
    """The axis of a survey's bands, which are no colours; None without bands."""
    axis = series.axes.find("S")
    is_bands = image.survey is not None and not series.is_color and axis >= 0 and series.shape[axis] > 1
    return axis if is_bands else None


def _reject_options(series: _Series, z: int, options: LoadOptions) -> None:
    """Raises InputError for options that do not apply to the image."""
    letters = [series.axes[axis] for axis in series.long if axis != z]
    others = [letter for letter in letters if letter not in "YXCS"]
    if not others:
        options.reject("array", f"an axis beside z, y, x and channels, where this has {series.axes}")
    if options.values == "heights" or options.color is not None or options.relief is not None:
        name = "values" if options.values == "heights" else "color" if options.color is not None else "relief"
        raise expected(name, "a single picture of heights", f"{series.shape[z]} planes", "leave it out")


def _mask_missing(samples: Any, survey: HeightMetadata | None) -> Any:
    """Samples with NaN in place of GDAL's number for no data."""
    if survey is None or survey.missing is None or not isinstance(samples, np.ndarray):
        return samples
    holes = np.isin(samples, (survey.missing, np.float64(np.float32(survey.missing))))
    return np.where(holes, np.nan, samples).astype(np.float32) if holes.any() else samples


def values_of(samples: Any, tiff: Any) -> np.ndarray:
    """The values of stored samples: calibrated, or magnitudes."""
    return magnitudes(samples) if samples.dtype.kind == "c" else calibrate(samples, find_calibration(tiff))


def _is_rgb(series: _Series) -> bool:
    """Whether the samples are colours of 8 or 16 bits, with or without alpha."""
    count = dict(zip(series.axes, series.shape, strict=True)).get("S", 0)
    return series.is_color and count in (3, 4) and series.dtype in (np.uint8, np.uint16)


def _is_channelled(series: _Series) -> bool:
    """Whether a pixel's samples are the colour of each channel, not the channels."""
    return "C" in (series.axes[axis] for axis in series.long)


def _read_colors(
    image: _Image, series: _Series, level: int, index: tuple[int | slice, ...]
) -> tuple[np.ndarray, np.ndarray]:
    """Luma and colours. index: of one component."""
    axis = series.axes.index("S")
    values = _read_pixels(image, series, level, (*index[:axis], slice(None), *index[axis + 1 :]))
    return split_colors(np.moveaxis(values, sum(isinstance(at, slice) for at in index[:axis]), -1))


def _is_coarser_level(level: _Series, finest: _Series) -> bool:
    """Whether `level` is the finest level with fewer samples along z, y and x."""
    if level.axes != finest.axes:
        return False
    sizes = zip(level.axes, level.shape, finest.shape, strict=True)
    return all(size == finer or (axis in "ZYX" and size < finer) for axis, size, finer in sizes)


def _level_volume(samples: Any, level: _Series, finest: _Series) -> Volume:
    """The volume of a level, in the box of the finest level."""
    sizes = [dict(zip(series.axes, series.shape, strict=True)) for series in (finest, level)]
    shrunk = [sizes[0].get(axis, 1) / sizes[1].get(axis, 1) for axis in "XYZ"]
    x, y, z = (size * factor for size, factor in zip(finest.grid[0], shrunk, strict=True))
    origin = [(size * (factor - 1)) / 2 for size, factor in zip(finest.grid[0], shrunk, strict=True)]
    whole = Lengths.of(np.diag(finest.grid[0]), [sizes[0].get(axis, 1) for axis in "XYZ"])
    return Volume(samples, (x, y, z), (origin[0], origin[1], origin[2]), unit=finest.grid[1], whole=whole)


@contextmanager
def logged_errors() -> Iterator[None]:
    """Raises the first error that tifffile logs: it reads truncated files without an exception."""
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
        raise InputError(f"cannot be read as TIFF: {handler.message}; the file may be cut short or damaged")


class _FirstError(logging.Handler):
    """Log handler that stores the first error."""

    message = ""

    def emit(self, record: logging.LogRecord) -> None:
        if record.levelno >= logging.ERROR and not self.message:
            self.message = record.getMessage()


def _describe_level(series: Any, image: _Image, plane: bool) -> _Series:
    """Describes a level. plane: whether a single picture is a plane of a stack."""
    pages = [page for page in series.pages if page is not None]
    _check_codec(series, pages)
    check_before_decoding(pages)
    axes, shape = series.axes, tuple(series.shape)
    if min(shape, default=0) < 1:
        raise expected("size", "at least one entry along each axis", f"{axes} {shape}", "the header is damaged")
    if plane and {"Y", "X"} <= set(axes) <= set("TCYXS"):
        at = axes.index("Y")
        axes, shape = f"{axes[:at]}Z{axes[at:]}", (*shape[:at], 1, *shape[at:])
    level = _Series(
        axes=axes,
        shape=shape,
        dtype=np.dtype(series.dtype).newbyteorder(image.tiff.byteorder),
        offset=None if series.is_multifile else series.dataoffset,
        is_color=series.keyframe.photometric.name in ("RGB", "YCBCR", "CIELAB", "SEPARATED"),
        is_compressed=series.keyframe.compression != 1,
        bits=int(np.max(series.keyframe.bitspersample)),
        grid=_grid(image),
    )
    if level.offset is None:
        _check_bytes(level, pages, series.is_multifile)
    return level


def _check_codec(series: Any, pages: Sequence[Any]) -> None:
    """Raises InputError for a page that `check_page` refuses, for other pages than the first, and for pages and strips
    that are not there.
    """
    first = series.keyframe
    for frame in {id(page.keyframe): page.keyframe for page in (series, *pages)}.values():
        check_page(frame)
        if (frame.shape, frame.dtype) != (first.shape, first.dtype):
            got = f"{frame.dtype} {frame.shape}"
            raise expected(
                frame.parent.filehandle.name, f"planes of {first.dtype} {first.shape}", got, "move it elsewhere"
            )
    if len(series.pages) > _FREE_PLANES + _PLANES_PER_PAGE * len(pages):
        raise expected("planes", f"about the file's {len(pages)} pages", len(series.pages), "save it whole in one file")
    check_strips(pages)


def _check_bytes(series: _Series, pages: Sequence[Any], is_several: bool) -> None:
    """Raises InputError unless all strips of pages lie in their files and can hold the samples; of several files some
    may be missing.
    """
    for page in pages:
        ends = map(sum, zip(page.dataoffsets, page.databytecounts, strict=True))
        require_bytes(max(ends, default=0), page.parent.filehandle.size)
    stored, samples = sum(sum(page.databytecounts) for page in pages), math.prod(series.shape)
    require_plausible(byte_count(series.shape, series.dtype), stored, bounded=False)
    if not series.is_compressed:
        # samples of 1 to 31 bits may be packed
        bits = min(series.dtype.itemsize * 8, series.bits)
        require_bytes((math.prod(pages[0].shape) * len(pages) if is_several else samples) * bits // 8, stored)


def _stack_axis(series: _Series) -> int | None:
    """The axis of planes: Z, else the first other than row, column, colour and channel; None for a single picture.

    A first axis S of a file without colours holds planes, too: stacks are often written so.
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
    picked: dict[int, str | int] = {}
    for axis, letter in enumerate(series.axes):
        if letter in "CS":
            is_color = letter == "S" and _is_rgb(series) and _is_channelled(series)
            picked[axis] = "channel" if axis in series.long and not is_color else 0
        elif letter not in "YX":
            picked[axis] = "time" if letter == "T" else "array"
    picked.pop(z, None)
    return options.index(series.shape, picked)


def _read_pixels(
    image: _Image,
    series: _Series,
    level: int,
    index: tuple[Any, ...] = (...,),
) -> np.ndarray:
    """The samples at an index, all by default; only pages of it are decoded. Missing planes are 0."""
    if series.offset is not None:
        return map_array(image.path, series.offset, series.dtype, series.shape)[index]
    with decoder_errors("TIFF"):
        pages_of = image.series.levels[level]
        ahead = len(pages_of.shape) - len(pages_of.keyframe.shape)
        if index[0] is ... or math.prod(pages_of.shape[:ahead]) != len(pages_of.pages):
            require_memory(byte_count(series.shape, series.dtype), image.path.stat().st_size)
            return np.asarray(pages_of.asarray()).reshape(series.shape)[index]
        numbers = np.arange(len(pages_of.pages)).reshape(series.shape[:ahead])[index[:ahead]]
        shape, pages = (*numbers.shape, *series.shape[ahead:]), numbers.ravel().tolist()
        require_memory(byte_count(shape, series.dtype), image.path.stat().st_size)
        if all(pages_of.pages[page] is None for page in pages):
            samples = np.zeros(shape, series.dtype)
        else:
            samples = np.asarray(image.tiff.asarray(key=pages, series=image.place, level=level)).reshape(shape)
        return samples[(*[slice(None)] * numbers.ndim, *index[ahead:])]


def _grid(image: _Image) -> Grid:
    stated = stated_grid(image.tiff, image.pixels)
    if stated is None and image.survey is not None and image.survey.step is not None:
        x, y = image.survey.step
        return (x, y, min(x, y)), image.survey.unit
    return stated or resolution_grid(tiff_dpi(image.series.keyframe))[0]


def stated_grid(tiff: Any, pixels: Element | None) -> Grid | None:
    """The grid in the metadata of OME, ImageJ or LSM; None without them. pixels: OME's element Pixels."""
    if pixels is not None:
        return _ome_grid(pixels)
    if lsm := tiff.lsm_metadata:
        # in metres
        x, y, z = (float(lsm.get(f"VoxelSize{axis}", 0)) * 1e6 for axis in "XYZ")
        return (x or 1.0, y or x or 1.0, z or x or 1.0), "um"
    if not (metadata := tiff.imagej_metadata):
        return None
    # samples per unit are in the resolution tags, spacing of planes and unit in the metadata
    tags = tiff.pages[0].tags
    per_unit = [tags[name].value if name in tags else (1, 1) for name in ("XResolution", "YResolution")]
    x, y = (below / above if above > 0 and below > 0 else 1.0 for above, below in per_unit)
    first, *others = (unit_name(str(metadata.get(name, ""))) for name in ("unit", "yunit", "zunit"))
    if first == "um" and int(tiff.pages[0].resolutionunit) == _CENTIMETRES:
        # of other programs, as ImageJ reads them
        x, y = x * _MICROMETRES, y * _MICROMETRES
    unit, factors = shared_unit([first, *(other or first for other in others)])
    steps = factors * (x, y, abs(float(metadata.get("spacing", 1.0))) or 1.0)
    return triple(steps, "resolution"), unit


def resolution_grid(dpi: tuple[float, float]) -> tuple[Grid, str]:
    """The grid of pixels per inch along x and y, and a note on it; spacing 1 without a unit if none are stated, and for
    numbers that are no voxel size.
    """
    if not all(1 < resolution < 1e9 for resolution in dpi):
        return ((1.0, 1.0, 1.0), ""), ""
    if all(any(abs(resolution - usual) < 0.5 for usual in _USUAL_DPI) for resolution in dpi):
        return ((1.0, 1.0, 1.0), ""), f"{dpi[0]:.4g} dots per inch in the tags are no voxel size and ignored"
    x, y = (_INCH / resolution for resolution in dpi)
    scale, unit = (1.0, "mm") if x >= 0.1 else (1000.0, "um")
    note = f"pixels of {x * scale:.4g} {unit} by the tags of resolution, slices as far apart: --spacing sets another"
    return ((x * scale, y * scale, x * scale), unit), note


def tiff_dpi(page: Any) -> tuple[float, float]:
    """Pixels per inch along x and y by the tags; 0 if there are none."""
    # damaged tags have several values, or text
    unit = page.resolutionunit
    per = {2: 1.0, 3: _INCH / 10}.get(unit, 0.0) if isinstance(unit, int) else 0.0
    x, y = (float(number) * per for number in page.get_resolution(unit)) if per else (0.0, 0.0)
    return x, y


def _ome_grid(pixels: Element) -> Grid:
    """OME's grid: PhysicalSizeX/Y/Z, by default in micrometres; all are converted to the unit of x. Without a size
    along z the planes' positions count.
    """
    sizes = {axis: float(pixels.get(f"PhysicalSize{axis}", 0)) for axis in "XYZ"}
    units = {axis: unit_name(pixels.get(f"PhysicalSize{axis}Unit", "um")) for axis in "XYZ"}
    step, unit, _ = plane_step(pixels)
    if not sizes["Z"] and unit:
        sizes["Z"], units["Z"] = step, unit
    if not any(sizes.values()):
        return (1.0, 1.0, 1.0), ""
    unit, factors = shared_unit([units[axis] for axis in "XYZ"])
    # a missing size is taken from x, as for cubic voxels
    x, y, z = (sizes[axis] * factor or sizes["X"] or 1.0 for axis, factor in zip("XYZ", factors.tolist(), strict=True))
    return (x, y, z), unit


# tifffile's kinds of slides and of series in many files, which are read as plain pages
OTHER_KINDS = ("avs", "bif", "eer", "mmstack", "ndpi", "ndtiff", "philips", "qpi", "scn", "svs")


def open_tiff(path: Path, is_several: bool = False) -> Any:
    """Opens the file in tifffile. is_several: together with the other files that OME's metadata name."""
    tifffile = import_extra("tifffile", "TIFF files", "tifffile", "readers")
    with decoder_errors("TIFF"):
        return _plain_class(tifffile.TiffFile)(path, _multifile=is_several)


@cache
def _plain_class(tiff_file: type) -> Any:
    """The class of files to which no file is of OTHER_KINDS; some versions refuse a part of these as arguments."""
    return type("PlainTiff", (tiff_file,), {f"is_{kind}": False for kind in OTHER_KINDS})


def read_in_parts(image: _Image, levels: Sequence[int], axes: str, index: Sequence[int | slice]) -> list[Chunked]:
    """The parts of levels of an image that `index` leaves free. axes: of the index; an axis that the series lacks has
    one entry. The file stays open as long as one part lives.
    """
    zarr = import_extra("zarr", "multiscale TIFF files", "zarr", "readers")
    file = OneFile(image.path, open_tiff(image.path, image.series.is_multifile))
    with decoder_errors("TIFF"):
        series = file.file.series[image.place]
        for level in levels:
            check_before_decoding(series.levels[level].pages)
        arrays = [zarr.open_array(series.aszarr(level=level), mode="r") for level in levels]
        names = [series.levels[level].axes for level in levels]
        turned = [TransposedChunks(*stored, axes) for stored in zip(arrays, names, strict=True)]
    return [Chunked(str(image.path), array, index, file, "TIFF") for array in turned]
