"""Selects images and channels of a TIFF file, by its OME-XML and ImageJ's text, with their grids by GeoTIFF tags."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np

from splatgl.data.affine import METRES, unit_name
from splatgl.data.times import seconds_in
from splatgl.errors import expected, list_names
from splatgl.fileio import byte_count, require_memory
from splatgl.readers.channels import Channel, ChannelSet, hex_color, parse_window
from splatgl.readers.common import parse_number, parse_xml
from splatgl.readers.heightmap import DEGREE, HeightMetadata
from splatgl.readers.options import LoadOptions

Coefficients = Sequence[float]


def _inverse_rodbard(x: np.ndarray, c: Coefficients) -> np.ndarray:
    inside = (x >= c[0]) & (x < c[3])
    share = (x - c[0]) / np.where(inside, c[3] - x, 1.0)
    return np.where(inside, c[2] * np.power(share, 1 / c[1], where=inside, out=np.zeros_like(x)), 0.0)


def _gamma_variate(x: np.ndarray, c: Coefficients) -> np.ndarray:
    after = np.maximum(x - c[0], 0.0)
    return np.where(after > 0, c[1] * np.power(after, c[2]) * np.exp(-after / c[3]), 0.0)


# of each function: its number, coefficients, name, and values at stored numbers
FUNCTIONS: dict[int, tuple[int, str, Callable[[np.ndarray, Coefficients], np.ndarray]]] = {
    0: (2, "straight line", lambda x, c: c[0] + c[1] * x),
    1: (3, "polynomial of degree 2", lambda x, c: np.polyval(c[2::-1], x)),
    2: (4, "polynomial of degree 3", lambda x, c: np.polyval(c[3::-1], x)),
    3: (5, "polynomial of degree 4", lambda x, c: np.polyval(c[4::-1], x)),
    4: (2, "exponential", lambda x, c: c[0] * np.exp(c[1] * x)),
    5: (2, "power", lambda x, c: c[0] * np.power(x, c[1])),
    6: (2, "logarithm", lambda x, c: np.where(x == 0, -1000 * c[0], c[0] * np.log(c[1] * x))),
    7: (4, "Rodbard", lambda x, c: c[3] + (c[0] - c[3]) / (1 + np.power(x / c[2], c[1]))),
    8: (4, "gamma variate", _gamma_variate),
    9: (3, "logarithm with offset", lambda x, c: c[0] + c[1] * np.log(x - c[2])),
    10: (4, "inverse Rodbard", _inverse_rodbard),
    11: (3, "exponential with offset", lambda x, c: c[0] * np.exp(-c[1] * x) + c[2]),
    12: (4, "Gaussian", lambda x, c: c[0] + (c[1] - c[0]) * np.exp(-((x - c[2]) ** 2) / (2 * c[3] ** 2))),
    13: (3, "exponential recovery", lambda x, c: c[0] * (1 - np.exp(-c[1] * x)) + c[2]),
    21: (0, "uncalibrated optical density", lambda x, c: np.log10(255.0 / np.where(x == 0, 0.5, x))),
}
# the calibration of signed numbers of 16 bits, which are stored without a sign
SIGNED = (-32768.0, 1.0)


@dataclass(frozen=True)
class Calibration:
    """function: a key of FUNCTIONS. clipped: whether values below 0 are 0. unit: of the values."""

    function: int
    coefficients: tuple[float, ...]
    clipped: bool
    unit: str

    @classmethod
    def of(cls, metadata: Mapping[str, Any] | None, dtype: np.dtype) -> Calibration | None:
        """The calibration in ImageJ's metadata; None without one, and for other numbers than 8 and 16 bits."""
        metadata = metadata or {}
        function = int(parse_number(metadata.get("cf"), -1.0))
        if function not in FUNCTIONS or dtype.kind != "u" or dtype.itemsize > 2:
            return None
        stated = (parse_number(metadata.get(f"c{n}")) for n in range(FUNCTIONS[function][0]))
        coefficients = tuple(map(float, stated))
        if not np.isfinite(coefficients).all() or (function == 0 and coefficients in ((0, 1), (coefficients[0], 0))):
            return None
        unit = str(metadata.get("vunit", "")).strip()
        unit = "" if unit.lower() in ("gray value", "grey value") else unit
        return cls(function, coefficients, str(metadata.get("zeroclip", "")).lower() == "true", unit)

    def __str__(self) -> str:
        """A note on the values."""
        if self.function == 0:
            offset, slope = self.coefficients
            return f"values are {offset:g} + {slope:g} × the stored ones, by ImageJ's calibration"
        return f"values are calibrated from the stored ones by ImageJ's function {FUNCTIONS[self.function][1]}"

    def values(self, stored: Any) -> np.ndarray:
        """The values of stored numbers, float64; NaN for those without one."""
        with np.errstate(all="ignore"):
            values = FUNCTIONS[self.function][2](np.asarray(stored, np.float64), self.coefficients)
            values = np.where(np.isfinite(values), values, np.nan)
            return np.where(values < 0, 0.0, values) if self.clipped else values


def calibrate(samples: np.ndarray, calibration: Calibration | None) -> np.ndarray:
    """The values of stored samples: int16 for ImageJ's signed numbers, else float32; as stored without calibration."""
    if calibration is None:
        return samples
    if (calibration.function, calibration.coefficients, samples.dtype.itemsize) == (0, SIGNED, 2):
        return (samples.astype(np.uint16) ^ np.uint16(0x8000)).view(np.int16)
    require_memory(byte_count(samples.shape, np.dtype(np.float32)), samples.nbytes)
    table = calibration.values(np.arange(2 ** (8 * samples.dtype.itemsize))).astype(np.float32)
    return np.asarray(table[samples])


WHITE, BLACK = "#ffffff", "#000000"
# ImageJ's default colours of a composite, which its files leave out
COMPOSITE = ("#ff0000", "#00ff00", "#0000ff", WHITE, "#00ffff", "#ff00ff", "#ffff00")


def find_channels(tiff: Any, pixels: Element | None, axes: str, shape: tuple[int, ...]) -> ChannelSet:
    """The channels and time points of an image with these axes. pixels: OME's element Pixels."""
    sizes = dict(zip(axes, shape, strict=True))
    count, times = sizes.get("C", 1), sizes.get("T", 1)
    if pixels is not None:
        channels = _ome_channels(pixels, count, times)
    elif tiff.imagej_metadata:
        channels = _imagej_channels(tiff.imagej_metadata, count, times, find_calibration(tiff))
    elif tiff.lsm_metadata:
        channels = _lsm_channels(tiff.lsm_metadata, count, times)
    else:
        channels = ChannelSet(tuple(Channel(str(n)) for n in range(count)), times=times)
    return replace(channels, components=sizes.get("S", 1))


def _ome_channels(pixels: Element, count: int, times: int) -> ChannelSet:
    """OME's channels: colours are signed numbers of 32 bits, RGBA; times are by default in seconds."""
    nodes = [node for node in pixels if node.tag.endswith("}Channel")][:count]
    channels = [Channel(node.get("Name") or str(n), _ome_color(node.get("Color"))) for n, node in enumerate(nodes)]
    channels += [Channel(str(n)) for n in range(len(channels), count)]
    step = parse_number(pixels.get("TimeIncrement")) * (seconds_in(pixels.get("TimeIncrementUnit", "s")) or 0.0)
    return ChannelSet(tuple(channels), times=times, step=step)


def _ome_color(text: str | None) -> str | None:
    try:
        number = int(text or "") & 0xFFFFFFFF
    except ValueError:
        return None
    return hex_color([number >> 24, number >> 16, number >> 8])


def find_calibration(tiff: Any) -> Calibration | None:
    """ImageJ's calibration of a file's values; None without one."""
    return Calibration.of(tiff.imagej_metadata, np.dtype(tiff.pages[0].dtype))


def _imagej_channels(
    metadata: Mapping[str, Any], count: int, times: int, calibration: Calibration | None
) -> ChannelSet:
    """ImageJ's channels: colours are the ends of lookup tables, windows the display ranges, of stored numbers."""
    tables, ranges = metadata.get("LUTs", ()), metadata.get("Ranges", ())
    # planes' labels name channels, which vary fastest, if they are the same on all planes of a channel; else numbers
    texts = [str(text).strip() for text in labels] if isinstance(labels := metadata.get("Labels"), list | tuple) else []
    same = all(text == texts[n % count] for n, text in enumerate(texts)) and len(set(texts[:count]) - {""}) == count
    names, composite = texts if same else [str(n) for n in range(count)], metadata.get("mode") == "composite"
    usual = dict(enumerate(COMPOSITE)) if composite and not len(tables) else {}
    channels = []
    for n in range(count):
        table = tables[n] if n < len(tables) else ()
        ends = [hex_color([int(row[end]) for row in table]) for end in (0, -1)] if len(table) == 3 else []
        # a negative: its table ends in black
        is_negative = len(ends) == 2 and ends[1] == BLACK != ends[0]
        color = ends[0 if is_negative else 1] if ends else usual.get(n)
        stored = np.array([parse_number(end) for end in ranges[2 * n : 2 * n + 2]])
        limits = sorted(stored if calibration is None else calibration.values(stored))
        window = parse_window(*limits) if len(limits) == 2 else None
        channels.append(Channel(names[n], color, window, inverted=is_negative))
    together = composite or any(channel.color not in (None, WHITE) for channel in channels)
    return ChannelSet(tuple(channels), together, times, parse_number(metadata.get("finterval")))


def _lsm_channels(metadata: Mapping[str, Any], count: int, times: int) -> ChannelSet:
    """The channels of Zeiss' LSM files, with names and colours, and seconds between time points."""
    table = metadata.get("ChannelColors") or {}
    names, colors = table.get("ColorNames") or (), table.get("Colors") or ()
    channels = [
        Channel(
            str(names[n]).strip("\0 ") or str(n) if n < len(names) else str(n),
            hex_color(colors[n]) if n < len(colors) and len(colors[n]) >= 3 else None,
        )
        for n in range(count)
    ]
    return ChannelSet(tuple(channels), times=times, step=parse_number(metadata.get("TimeIntervall")))


# tags of GeoTIFF (1.1 §2.5 to 2.8) and GDAL
SCALE, TIE, MATRIX, KEYS, METADATA, NODATA = 33550, 33922, 34264, 34735, 42112, 42113
# keys of GeoTIFF: kind of coordinates, units of horizontal and vertical lengths
MODEL, LINEAR, VERTICAL = 1024, 3076, 4099
GEOGRAPHIC = 2
# metres per unit, by EPSG's numbers and by GDAL's names
EPSG_METRES = {9001: 1.0, 9002: 0.3048, 9003: 1200 / 3937, 9036: 1000.0}
GDAL_METRES = {"m": 1.0, "metre": 1.0, "meter": 1.0, "ft": 0.3048, "foot": 0.3048, "us-ft": 1200 / 3937, "km": 1000.0}


def select_image(images: Sequence[Any], options: LoadOptions) -> tuple[int, tuple[str, ...]]:
    """(index, notes) of the image that `series` names or numbers from 1 on, else the largest stack.

    images: with name, shape and axes, a letter for each axis, as tifffile's series.
    """
    if not images:
        raise expected("file", "one image at least", "none in it")
    requested = None if options.series is None else str(options.series)
    lines = [f"{n} {image}" for n, image in enumerate(map(describe_series, images), 1)]
    if requested is not None:
        named = [n for n, image in enumerate(images) if image.name == requested]
        number = int(requested) - 1 if re.fullmatch("[0-9]{1,6}", requested) else -1
        if not named and not 0 <= number < len(images):
            raise expected("series", f"one of {list_names(lines, 6)}", repr(requested))
        return named[0] if named else number, ()
    sizes = [
        math.prod(n for n, axis in zip(image.shape, image.axes, strict=True) if axis not in "SCT") for image in images
    ]
    planes = [math.prod(image.shape[image.axes.index(axis)] for axis in "YX" if axis in image.axes) for image in images]
    # stacks first: an overview of one plane may have more pixels
    place = max(range(len(images)), key=lambda n: (sizes[n] > planes[n], sizes[n], -n))
    if len(images) == 1:
        return 0, ()
    others = list_names([line for n, line in enumerate(lines) if n != place], 6)
    note = f"image {lines[place]} of {len(images)} is read, the largest stack; --series N picks another: {others}"
    return place, (note,)


def list_series(images: Sequence[Any]) -> list[str]:
    """A line for each image: its number, name and size; a star marks the one that is read by default."""
    place, _ = select_image(images, LoadOptions())
    return [f"{'*' if n == place else ' '} {n + 1}   {describe_series(image)}" for n, image in enumerate(images)]


def describe_series(series: Any) -> str:
    """An image's name and size, x first."""
    sizes = [str(n) for n, axis in zip(series.shape, series.axes, strict=True) if axis != "S"]
    return f"{series.name} {'×'.join(reversed(sizes))}".strip()


def find_pixels(tiff: Any, place: int) -> Element | None:
    """OME-XML's element Pixels of an image of tiff.series; None without OME-XML."""
    if not tiff.ome_metadata:
        return None
    nodes = [node for node in parse_xml(tiff.ome_metadata, "OME-XML").iter() if node.tag.endswith("}Pixels")]
    series = tiff.series[place]
    first: Any = next((page for page in series.pages if page is not None), None)
    # images without pages are not in tiff.series: match by the first page
    for node in nodes if first is not None and len(nodes) > 1 else ():
        runs = [child for child in node if child.tag.endswith("}TiffData")]
        if series.is_multifile:
            name = first.parent.filehandle.name
            runs = [run for run in runs if any(child.get("FileName") == name for child in run)]
        if runs and min(int(run.get("IFD", 0)) for run in runs) == first.index:
            return node
    return nodes[min(place, len(nodes) - 1)] if nodes else None


def find_files(root: Element | None, name: str) -> set[str]:
    """Names of the files, of one folder, that OME's metadata name beside the file `name`, and this; none without."""
    nodes = () if root is None else root.iter()
    names = {node.get("FileName") or name for node in nodes if node.tag.endswith("}UUID")}
    is_beside = len(names) > 1 and name in names and not any(set(file) & set("/\\") for file in names)
    return names if is_beside else set()


# shares of a step between planes by which positions may differ from even ones, and from PhysicalSizeZ
UNEVEN, OTHER_STEP = 0.1, 0.05


def plane_step(pixels: Element) -> tuple[float, str, str]:
    """(step from plane to plane by their PositionZ, its unit, note on positions that are not drawn); 0, "" and "" where
    positions are missing, or are all the same. Of several channels and times the first counts.
    """
    planes = [node for node in pixels if node.tag.endswith("}Plane") and {node.get("TheC"), node.get("TheT")} == {"0"}]
    places = {node.get("TheZ"): parse_number(node.get("PositionZ"), None) for node in planes}
    ordered = [places.get(str(n)) for n in range(len(places))]
    heights = np.array([math.nan if place is None else place for place in ordered])
    count = int(pixels.get("SizeZ", 0))
    if count < 2 or len(heights) != count or not np.isfinite(heights).all() or not np.ptp(heights) > 0:
        return 0.0, "", ""
    steps = np.diff(heights)
    step, unit = float(steps.mean()), unit_name(planes[0].get("PositionZUnit") or "")
    unit = unit if unit in METRES else ""
    if np.abs(steps - step).max() > UNEVEN * abs(step):
        apart = f"{steps.min():.4g} to {steps.max():.4g} {unit}".strip()
        return 0.0, "", f"planes are {apart} apart by their positions, and are rendered evenly"
    note = "planes descend by their positions; the first is rendered lowest all the same" if step < 0 else ""
    stated, of = parse_number(pixels.get("PhysicalSizeZ")), unit_name(pixels.get("PhysicalSizeZUnit", "um"))
    if stated > 0 and unit and of in METRES and abs(abs(step) * METRES[unit] / (stated * METRES[of]) - 1) > OTHER_STEP:
        note = f"planes are {abs(step):.4g} {unit} apart by their positions, but rendered {stated:.4g} {of} apart"
    return abs(step), unit, note


def read_survey(page: Any) -> HeightMetadata | None:
    """The survey of heights in the GeoTIFF and GDAL tags of a page; None without these tags."""
    tags = {code: page.tags[code].value for code in (SCALE, TIE, MATRIX, KEYS, METADATA, NODATA) if code in page.tags}
    if not tags:
        return None
    # four numbers a key behind a header of four; keys with short values have the place 0 (GeoTIFF 1.1 §7.1)
    values = tags.get(KEYS, ())
    rows = [tuple(values[n : n + 4]) for n in range(4, len(values) - 3, 4)]
    keys = {int(key): int(value) for key, place, _, value in rows if place == 0}
    items = _gdal_items(str(tags.get(METADATA, "")))
    step, top = _pixel_size(tags)
    is_south_first = SCALE not in tags and len(tags.get(MATRIX, ())) == 16 and float(tags[MATRIX][5]) > 0
    length = EPSG_METRES.get(keys.get(LINEAR, 9001), 1.0)
    upward = GDAL_METRES.get(items.get("unittype", "").lower(), EPSG_METRES.get(keys.get(VERTICAL, 9001), 1.0))
    unit: str = "m" if keys and step else ""
    notes: tuple[str, ...] = ()
    if step and keys.get(MODEL) == GEOGRAPHIC:
        middle = top + (1 if is_south_first else -1) * step[1] * page.shape[0] / 2
        step = (step[0] * DEGREE * max(math.cos(math.radians(middle)), 1e-3), step[1] * DEGREE)
        notes = (f"degrees are converted to metres at latitude {middle:.4g}°",)
    elif step and unit:
        step = (step[0] * length, step[1] * length)
    slope, offset = (parse_number(items.get(name), default) for name, default in (("scale", 1.0), ("offset", 0.0)))
    missing = parse_number(str(tags.get(NODATA, "")).strip("\0 "), None)
    return HeightMetadata(step, unit, missing, slope * (upward if unit else 1.0), offset, notes, is_south_first)


def _pixel_size(tags: Mapping[int, Any]) -> tuple[tuple[float, float] | None, float]:
    """Widths of a pixel along x and y, None if unknown; and y of the first row."""
    tie = [float(number) for number in tags.get(TIE, ())]
    top = tie[4] + tie[1] * float(tags[SCALE][1]) if len(tie) >= 6 and SCALE in tags else 0.0
    if SCALE in tags:
        x, y = (abs(float(number)) for number in tags[SCALE][:2])
    elif len(tags.get(MATRIX, ())) == 16:
        rows = [float(number) for number in tags[MATRIX]]
        x, y, top = math.hypot(rows[0], rows[4]), math.hypot(rows[1], rows[5]), rows[7]
    else:
        return None, 0.0
    return ((x, y) if 0 < x < 1e12 and 0 < y < 1e12 else None), top


def _gdal_items(text: str) -> dict[str, str]:
    """GDAL's items of the first band by their role: scale, offset, unittype."""
    if not text.strip().startswith("<"):
        return {}
    nodes = [node for node in parse_xml(text.strip("\0 \n"), "GDAL_METADATA").iter() if node.get("sample", "0") == "0"]
    return {node.get("role", ""): (node.text or "").strip() for node in nodes if node.get("role")}
