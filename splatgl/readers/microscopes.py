"""Files of microscopes that libraries read, Leica's LIF, Nikon's ND2, Olympus's OIB and OIF; what their readers share.

Planes of OIB and OIF are TIFF files, in a compound file or next to the settings.
"""

from __future__ import annotations

import io
import math
import os
import re
import struct
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from splatgl.data.affine import metres_in
from splatgl.data.times import seconds_in
from splatgl.data.volume import Triple, Volume
from splatgl.errors import expected, import_extra
from splatgl.fileio import WHOLE_BYTES, byte_count, held_within_budget, require_memory
from splatgl.readers.channels import Channel, ChannelSet, hex_color, mark_microscope, split_colors
from splatgl.readers.chunked import Chunked, OneFile
from splatgl.readers.common import MAX_BYTES, decoder_errors, parse_number, parse_xml, require_bytes, require_plausible
from splatgl.readers.elsewhere import look
from splatgl.readers.options import LoadOptions
from splatgl.readers.tiff import logged_errors
from splatgl.readers.tiff_images import list_series, select_image
from splatgl.readers.tiff_validation import check_before_decoding

# order of the axes of an image; other axes precede them
ORDER = "TCZYXS"
# planes that a header may state beyond those that are stored, as aborted recordings do; they are read as 0
FREE_PLANES, PLANES_PER_STORED = 4096, 64


class BoundedFile(io.BufferedReader):
    """A file whose reads never allocate more than the file's size."""

    def read(self, size: int | None = -1, /) -> bytes:
        """Up to `size` bytes; all without a size."""
        there = os.fstat(self.fileno()).st_size
        return super().read(min(size, there) if size is not None and size >= 0 else size)


class Planes:
    """The planes [Y, X] or [Y, X, S] of an image, behind leading axes, as `Chunked` reads them.

    read: the plane at an index along the leading axes, or None for one that is missing, which is 0.
    """

    fill_value = 0

    def __init__(
        self,
        lead: Sequence[int],
        plane: Sequence[int],
        dtype: Any,
        read: Callable[[tuple[int, ...]], np.ndarray | None],
    ) -> None:
        self.lead, self.plane, self.dtype, self.read = tuple(lead), tuple(plane), np.dtype(dtype), read
        self.shape, self.chunks = self.lead + self.plane, (1,) * len(self.lead) + self.plane

    def __getitem__(self, key: tuple[int | slice, ...]) -> np.ndarray:
        count = len(self.lead)
        leading = zip(key[:count], self.lead, strict=True)
        places = [range(size)[at] if isinstance(at, slice) else [at] for at, size in leading]
        within = key[count:]
        counts = [len(place) for place in places]
        empty = np.broadcast_to(np.zeros((), self.dtype), self.plane)
        block = np.zeros([*counts, *empty[within].shape], self.dtype)
        for target, index in zip(np.ndindex(*counts), product(*places), strict=True):
            plane = self.read(index)
            if plane is None:
                continue
            if plane.shape != self.plane or plane.dtype != self.dtype:
                raise expected("plane", f"{self.dtype} {self.plane}", f"{plane.dtype} {plane.shape}")
            block[target] = plane[within]
        return np.asarray(block[tuple(slice(None) if isinstance(at, slice) else 0 for at in key[:count])])


@dataclass(frozen=True)
class MicroscopeImage:
    """An image of a file: a letter for each axis (see ORDER) and its size, a function that returns the samples as an
    array or `Planes`, its channels, the spacing of voxels, seconds between time points, and the number of planes that
    are not stored.
    """

    name: str
    axes: str
    shape: tuple[int, ...]
    load: Callable[[], Any]
    channels: tuple[Channel, ...] = ()
    spacing: Triple = (1.0, 1.0, 1.0)
    unit: str = ""
    step: float | None = None
    missing: int = 0


def check_planes(lead: Sequence[int], plane: Sequence[int], dtype: np.dtype, stored: int) -> None:
    """Raises InputError for very large planes, and for far more planes than are stored."""
    if min((*lead, *plane)) < 1:
        raise expected("size", "at least one entry along each axis", (*lead, *plane), "the header is damaged")
    if byte_count(plane, dtype) > MAX_BYTES:
        got = f"{byte_count(plane, dtype)} ({' × '.join(map(str, plane))})"
        raise expected("planes", f"at most {MAX_BYTES} bytes each", got, "save a part of the image")
    if math.prod(lead) > FREE_PLANES + PLANES_PER_STORED * stored:
        raise expected("planes", f"about the file's {stored}", math.prod(lead), "the header is damaged")


def even_spacing(x: float, y: float, z: float) -> Triple:
    """Positive spacing: unknown ones, 0 or not finite, are taken from x, else 1."""
    known = [abs(step) if math.isfinite(step) else 0.0 for step in (x, y, z)]
    return known[0] or 1.0, known[1] or known[0] or 1.0, known[2] or known[0] or 1.0


# images of a file, and the file
Found = tuple[Sequence[MicroscopeImage], OneFile]


def functions_of(
    form: str, find: Callable[[Path], Found]
) -> tuple[Callable[[Path], list[str]], Callable[[Path, LoadOptions], Volume]]:
    """The functions of a `Format`: one lists the images of a file, a line each, one reads a volume. form: its name."""

    def list_images(path: Path) -> list[str]:
        with decoder_errors(form):
            images, _ = find(path)
            return list_series(images)

    def read(path: Path, options: LoadOptions) -> Volume:
        with decoder_errors(form):
            images, file = find(path)
        return _read_image(path, form, images, options, file)

    return list_images, read


def _read_image(
    path: Path, form: str, images: Sequence[MicroscopeImage], options: LoadOptions, file: OneFile
) -> Volume:
    """The volume of the image that `series` picks, else of the largest stack.

    `channel` picks channels, `time` a time point, `array` an entry along an axis that is none of these. An image
    without z is a plane, as thick as a pixel is wide. Samples of more than WHOLE_BYTES are read in parts.
    """
    place, notes = select_image(images, options)
    image = images[place]
    sizes = dict(zip(image.axes, image.shape, strict=True))
    count = sizes.get("C", 1)
    channels = (*image.channels, *(Channel(str(n)) for n in range(len(image.channels), count)))[:count]
    channel_set = ChannelSet(channels, None, sizes.get("T", 1), image.step, sizes.get("S", 1))
    if all(axis in ORDER for axis in image.axes):
        options.reject("array", f"an axis beside time, channels and space, where this has {image.axes}")

    def read_one(channel: int | None) -> Volume:
        # a colour's components are numbered where there are no channels
        component = channel if count == 1 and "S" in sizes else None
        picked: dict[int, str | int] = {}
        for axis, letter in enumerate(image.axes):
            if letter == "C":
                picked[axis] = 0 if channel is None or count == 1 else channel
            elif letter == "T":
                picked[axis] = "time"
            elif letter not in "ZYXS":
                picked[axis] = "array"
            elif letter == "S" and component is not None:
                picked[axis] = component
        index = options.index(image.shape, picked)
        samples = _read_samples(path, form, array, index, file)
        samples = samples if "Z" in sizes else samples[None]
        samples, color = split_colors(samples) if len(samples.shape) == 4 else (samples, None)
        return Volume(samples, image.spacing, unit=image.unit, color=color)

    with decoder_errors(form):
        array = image.load()
    volume = mark_microscope(channel_set.volume(options, read_one))
    gap = f"{image.missing} planes are missing in the file, and are rendered as 0"
    return replace(volume, notes=(*notes, *[gap] * bool(image.missing), *volume.notes))


def _read_samples(path: Path, form: str, array: Any, index: tuple[int | slice, ...], file: OneFile) -> Any:
    """The part of an array that `index` leaves free: mapped, read, or read in parts."""
    if isinstance(array, np.ndarray):
        return array[index]
    free = [size for size, at in zip(array.shape, index, strict=True) if isinstance(at, slice)]
    if len(free) == 3 and byte_count(free, array.dtype) > held_within_budget(WHOLE_BYTES):
        return Chunked(str(path), array, index, file, form)
    require_memory(byte_count(free, array.dtype), path.stat().st_size)
    with decoder_errors(form):
        return array[index]


# colours by the names of Leica's lookup tables
_COLORS = {
    **{"red": "#ff0000", "green": "#00ff00", "blue": "#0000ff", "cyan": "#00ffff", "magenta": "#ff00ff"},
    **{"yellow": "#ffff00", "gray": "#ffffff", "grey": "#ffffff"},
}
# letters of axes by the number DimID of their description
_LETTERS = {"1": "X", "2": "Y", "3": "Z", "4": "T"}
# of the XML at the file's start: a mark, bytes, a mark, letters of UTF-16
_HEADER = struct.Struct("<9xI")


def _find_lif_images(path: Path) -> Found:
    """The images with axes x and y, without histograms of lifetimes; the XML is checked before liffile reads it."""
    liffile = import_extra("liffile", "Leica's LIF files", "liffile", "microscopes")
    opened = OneFile(path, BoundedFile(path.open("rb", buffering=0)))
    (letters,) = _HEADER.unpack(opened.file.read(_HEADER.size))
    require_bytes(2 * letters, path.stat().st_size - _HEADER.size)
    parse_xml(opened.file.read(2 * letters).decode("utf-16-le"), "LIF's XML")
    opened.file.seek(0)
    images = []
    for source in liffile.LifFile(opened.file).images:
        axes, shape = "".join(name[0] for name in source.dims), tuple(int(size) for size in source.shape)
        if source.is_flim or not {"X", "Y"} <= set(axes) or len(set(axes)) < len(axes) or min(shape) < 1:
            continue
        # other axes first, then in the order of a volume
        order = sorted(range(len(axes)), key=lambda n: (ORDER.find(axes[n]), n))
        load = partial(_map_samples, source, order)
        spacing, unit, step = _read_steps(source.xml_element)
        channels = _read_channels(source.xml_element)
        turned = "".join(axes[n] for n in order)
        images.append(
            MicroscopeImage(source.path, turned, tuple(shape[n] for n in order), load, channels, spacing, unit, step)
        )
    return images, opened


def _map_samples(source: Any, order: list[int]) -> np.ndarray:
    """The samples with axes in `order`: mapped, but colours that begin with blue, which are read."""
    blue_first = source.sizes.get("S", 1) == 3
    if blue_first:
        needed = byte_count(source.shape, source.dtype)
        require_bytes(needed, source.parent.filehandle.seek(0, 2) - source.memory_block.offset)
        require_memory(needed, source.memory_block.size)
    return np.asarray(source.asarray() if blue_first else source.asarray(out="memmap")).transpose(order)


def _read_steps(node: Any) -> tuple[tuple[float, float, float], str, float | None]:
    """Spacing in micrometres, unit, and seconds between time points; lengths reach from the first to the last entry."""
    steps, unit = dict[str, float](), ""
    for axis in node.findall("./Data/Image/ImageDescription/Dimensions/DimensionDescription"):
        letter, name = _LETTERS.get(axis.get("DimID", ""), ""), axis.get("Unit", "").strip()
        length, count = (parse_number(axis.get(key)) for key in ("Length", "NumberOfElements"))
        step = abs(length) / (count - 1) if count > 1 else 0.0
        if letter == "T":
            steps[letter] = step * (seconds_in(name) or 0.0)
        elif letter:
            metres = metres_in(name)
            steps[letter], unit = step * (metres * 1e6 if metres else 1.0), "um" if metres else unit
    return even_spacing(*(steps.get(axis, 0.0) for axis in "XYZ")), unit, steps.get("T")


def _read_channels(node: Any) -> tuple[Channel, ...]:
    """Names and colours: the dye, else the lookup table, in the order in which channels are stored."""
    nodes = node.findall("./Data/Image/ImageDescription/Channels/ChannelDescription")
    channels = list[Channel]()
    for channel_node in sorted(nodes, key=lambda channel_node: parse_number(channel_node.get("BytesInc"), 0.0)):
        keys = {item.findtext("Key"): item.findtext("Value") or "" for item in channel_node.findall("ChannelProperty")}
        table = channel_node.get("LUTName", "").strip()
        channels.append(Channel(keys.get("DyeName") or table or str(len(channels)), _COLORS.get(table.lower())))
    names = [channel.name for channel in channels]
    # of equal names none picks a channel
    return tuple(
        Channel(f"{channel.name} {n}" if names.count(channel.name) > 1 else channel.name, channel.color)
        for n, channel in enumerate(channels)
    )


def _find_nd2_images(path: Path) -> Found:
    """The positions of a file; each has axes T, Z, C or some of them, in the order of its loops."""
    nd2 = import_extra("nd2", "Nikon's ND2 files", "nd2", "microscopes")
    file = OneFile(path, nd2.ND2File(BoundedFile(path.open("rb", buffering=0))))
    source = file.file
    if source.is_legacy:
        raise expected("file", "an ND2 file of version 2 or later", "an older one", "save it as TIFF with Fiji")
    attributes, loops = source.attributes, source.experiment
    # 1. loops by the letters of their axes, outer ones first
    letters = {"TimeLoop": "T", "NETimeLoop": "T", "XYPosLoop": "P", "ZStackLoop": "Z", "CustomLoop": "U"}
    axes = "".join(letters.get(loop.type, "?") for loop in loops)
    counts = [int(loop.count) for loop in loops]
    if "?" in axes or len(set(axes)) < len(axes):
        raise expected("loops", "one each of time, position and z", ", ".join(loop.type for loop in loops))
    # 2. planes: the components of a pixel are channels, or colours of one channel
    components, channels = int(attributes.componentCount), int(attributes.channelCount or 1)
    is_color = components == 3 * channels and channels == 1
    dtype, plane = np.dtype(source.dtype), (int(attributes.heightPx), int(attributes.widthPx or 0))
    frame = (1 if is_color else components, *plane, 3 if is_color else 1)
    stored = int(attributes.sequenceCount)
    check_planes(counts, frame, dtype, stored)
    require_plausible(byte_count(frame, dtype), path.stat().st_size)
    # 3. the positions, each with the frames of its number in the loop
    place = axes.find("P")
    points: Any = next((loop.parameters.points for loop in loops if loop.type == "XYPosLoop"), [])
    lead = [n for n in range(len(axes)) if n != place]
    sizes = [*(counts[n] for n in lead), frame[0]]
    x, y, z = (float(step) for step in source.voxel_size())
    dyes = [channel.channel for channel in source.metadata.channels]
    names = tuple(Channel(dye.name or str(n), hex_color(dye.color[:3])) for n, dye in enumerate(dyes))
    images = []
    for number in range(counts[place] if place >= 0 else 1):
        name = (points[number].name if number < len(points) else "") or f"position {number}" * (place >= 0)
        read_plane = partial(_read_plane, source, frame, (counts, place, number))
        planes = Planes(sizes, frame[1:] if is_color else plane, dtype, read_plane)
        images.append(
            MicroscopeImage(
                name,
                "".join(axes[n] for n in lead) + "CYX" + "S" * is_color,
                planes.shape,
                partial(lambda planes: planes, planes),
                names,
                even_spacing(x, y, z if "Z" in axes else 0.0),
                "um" if x > 0 else "",
                next((loop.parameters.periodMs / 1000 for loop in loops if loop.type == "TimeLoop"), None),
                max(math.prod(counts) - stored, 0),
            )
        )
    return images, file


def _read_plane(
    source: Any, shape: tuple[int, ...], position: tuple[list[int], int, int], index: tuple[int, ...]
) -> np.ndarray:
    """The plane of an index along all loops but that of positions, and of a channel. shape: of a frame [C, Y, X, S].
    position: sizes of the loops, the place of positions among them or -1, and the position.
    """
    counts, place, number = position
    loops = list(index[:-1])
    if place >= 0:
        loops.insert(place, number)
    # the last loop runs fastest
    frame = np.asarray(source.read_frame(int(np.ravel_multi_index(loops, counts)) if loops else 0))
    # the library squeezes axes of one entry
    plane = frame.reshape(shape)[index[-1]]
    return plane if shape[3] > 1 else plane[..., 0]


list_lif, read_lif = functions_of("LIF", _find_lif_images)
list_nd2, read_nd2 = functions_of("ND2", _find_nd2_images)


# --- OIB and OIF ------------------------------------------------------------------------------------------------------


# name of a plane: s_C001Z002T003.tif; others are previews
_PLANE = re.compile(r"(?i)(?:.*[/\\])?s_?((?:[A-Z]\d{3,6})+)\.tif")
# seconds of processor time for the table of sectors
_LOOK_SECONDS = 2.0


def check_compound(path: Path) -> None:
    """Raises InputError for another compound file, and for one whose chains of sectors do not end: the library would
    follow them forever, also when it opens the file.
    """
    import oiffile

    with decoder_errors("OIB"), closing(oiffile.oiffile.CompoundFile(path)) as compound:
        for table in (compound._fat, compound._minifat):
            _check_chains(np.array(table, np.int64))
        if "OibInfo.txt" not in compound.files():
            raise expected("file", "OibInfo.txt in it", "another compound file", "is this an OIB file?")


def _check_chains(table: np.ndarray) -> None:
    """Raises InputError if a chain of sectors leads back to itself. table: the sector behind each."""
    end = len(table)
    following = np.append(np.where(table < end, table, end), end)
    for _ in range(max(end, 1).bit_length()):
        following = following[following]
    if (following != end).any():
        raise expected("sectors", "chains that end", "one that leads back to itself", "the file is damaged")


def _find_oib_images(path: Path) -> Found:
    oiffile = import_extra("oiffile", "Olympus's OIB files", "oiffile", "microscopes")
    if path.suffix.lower() != ".oif":
        look("microscopes.check_compound", path, _LOOK_SECONDS)
    file = OneFile(path, oiffile.OifFile(path))
    source = file.file
    # 1. planes by their index, as their names have it
    planes, letters = dict[tuple[int, ...], str](), ""
    for name in source.glob("*.tif"):
        match = _PLANE.fullmatch(name)
        parts = re.findall(r"([A-Z])(\d+)", match[1].upper()) if match else []
        axes = "".join(letter for letter, _ in parts)
        if axes and len(set(axes)) == len(axes) and (not letters or axes == letters):
            letters = axes
            planes[tuple(int(digits) - 1 for _, digits in parts)] = name
    if not planes or min(map(min, planes)) < 0:
        raise expected("file", "planes named as s_C001Z001.tif", "none", "is this an OIB file?")
    counts = [max(index[n] for index in planes) + 1 for n in range(len(letters))]
    # 2. the first plane states the size of all
    first = _decode_plane(source, next(iter(planes.values())))
    check_planes(counts, first.shape, first.dtype, len(planes))
    array = Planes(counts, first.shape, first.dtype, partial(_read_oib_plane, source, planes))
    # 3. the settings
    settings = source.mainfile
    steps, units = _read_oib_steps(settings)
    spacing = even_spacing(*(steps.get(axis, 0.0) for axis in "XYZ"))
    channels = _read_oib_channels(settings, counts[letters.index("C")] if "C" in letters else 1)
    unit = "um" if "X" in units else ""
    step, missing = steps.get("T"), math.prod(counts) - len(planes)
    axes = letters + "YX"
    return [MicroscopeImage(path.stem, axes, array.shape, lambda: array, channels, spacing, unit, step, missing)], file


def _read_oib_plane(source: Any, planes: dict[tuple[int, ...], str], index: tuple[int, ...]) -> np.ndarray | None:
    return _decode_plane(source, planes[index]) if index in planes else None


def _decode_plane(source: Any, name: str) -> np.ndarray:
    tifffile = import_extra("tifffile", "Olympus's OIB files", "tifffile", "microscopes")
    with source.open_file(name) as file:
        data = file.read()
    with logged_errors(), tifffile.TiffFile(io.BytesIO(data)) as tiff:
        page = tiff.pages[0]
        check_before_decoding([page])
        require_plausible(page.nbytes, len(data))
        require_plausible(math.prod(page.chunks) * page.dtype.itemsize, len(data))
        plane = np.asarray(page.asarray())
    if plane.ndim != 2 or plane.dtype.kind not in "ui":
        raise expected("plane", "grey numbers [y, x]", f"{plane.dtype} {plane.shape}")
    return plane


def _read_oib_steps(settings: Any) -> tuple[dict[str, float], set[str]]:
    """Steps along axes in micrometres and seconds, and the axes whose unit is known.

    Lengths reach from the first to the last entry; those along x and y also from edge to edge of a pixel, which the
    convert values of the reference image state.
    """
    steps, known = dict[str, float](), set[str]()
    for number in range(8):
        axis = settings.get(f"Axis {number} Parameters Common", {})
        letter, name = str(axis.get("AxisCode", "")), str(axis.get("UnitName", "")).strip()
        count, begin, end = (parse_number(axis.get(key)) for key in ("MaxSize", "StartPosition", "EndPosition"))
        scale = seconds_in(name) if letter == "T" else (metres_in(name) or 0.0) * 1e6
        if letter and scale and count > 1 and np.isfinite(end - begin):
            steps[letter] = abs(end - begin) / (count - (letter in "ZT")) * scale
            known.add(letter)
    image = settings.get("Reference Image Parameter", {})
    for letter, key in (("X", "Width"), ("Y", "Height")):
        step, scale = parse_number(image.get(f"{key}ConvertValue")), metres_in(str(image.get(f"{key}Unit")))
        if scale and 0 < step < 1e12:
            steps[letter] = step * scale * 1e6
            known.add(letter)
    return steps, known


def _read_oib_channels(settings: Any, count: int) -> tuple[Channel, ...]:
    """Names of the channels: the dye, else the detector's."""
    names = [""] * count
    for number in range(count):
        for section in (f"GUI Channel {number + 1} Parameters", f"Channel {number + 1} Parameters"):
            part = settings.get(section, {})
            names[number] = names[number] or str(part.get("DyeName") or part.get("CH Name") or "")
    return tuple(Channel(names[number] or str(number)) for number in range(count))


list_oib, read_oib = functions_of("OIB", _find_oib_images)
