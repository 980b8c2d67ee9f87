"""Leica's LIF files, by liffile: images, whose samples are mapped. Names, colours and lengths are in their XML."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from contextlib import closing, contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from splatgl.data.affine import metres_in
from splatgl.data.times import seconds_in
from splatgl.data.volume import Volume
from splatgl.errors import expected, import_extra
from splatgl.fileio import byte_count, require_memory
from splatgl.readers.channels import Channel
from splatgl.readers.chunked import OneFile
from splatgl.readers.common import decoder_errors, parse_number, require_bytes
from splatgl.readers.microscopes import ORDER, BoundedFile, Image, even_spacing, read_image
from splatgl.readers.options import LoadOptions
from splatgl.readers.tiff_images import list_series
from splatgl.readers.vtk_xml import parse_xml

# colours by the names of Leica's lookup tables
_COLORS = {
    **{"red": "#ff0000", "green": "#00ff00", "blue": "#0000ff", "cyan": "#00ffff", "magenta": "#ff00ff"},
    **{"yellow": "#ffff00", "gray": "#ffffff", "grey": "#ffffff"},
}
# letters of axes by the number DimID of their description
_LETTERS = {"1": "X", "2": "Y", "3": "Z", "4": "T"}
# of the XML at the file's start: a mark, bytes, a mark, letters of UTF-16
_HEADER = struct.Struct("<IIBI")


def list_images(path: Path) -> list[str]:
    """A line for each image."""
    with _open(path) as file, decoder_errors("LIF"):
        return list_series(_find_images(file))


def read(path: Path, options: LoadOptions) -> Volume:
    """The volume of an image; `series` picks it, for the other options see `read_image`."""
    with _open(path) as file:
        with decoder_errors("LIF"):
            images = _find_images(file)
        return read_image(path, "LIF", images, options, OneFile(path))


@contextmanager
def _open(path: Path) -> Iterator[Any]:
    """The file in liffile, whose XML is checked first."""
    liffile = import_extra("liffile", "Leica's LIF files", "liffile", "microscopes")
    with path.open("rb") as file, decoder_errors("LIF"):
        mark, _, _, letters = _HEADER.unpack(file.read(_HEADER.size))
        if mark != 0x70:
            raise expected("first bytes", "0x70", hex(mark), "is this a LIF file?")
        require_bytes(2 * letters, path.stat().st_size - _HEADER.size)
        parse_xml(file.read(2 * letters).decode("utf-16-le"), "LIF's XML")
    with closing(BoundedFile(path.open("rb", buffering=0))) as source:
        with decoder_errors("LIF"):
            file = liffile.LifFile(source)
        yield file


def _find_images(file: Any) -> list[Image]:
    """The images with axes x and y, without histograms of lifetimes."""
    images = []
    for source in file.images:
        axes, shape = "".join(name[0] for name in source.dims), tuple(int(size) for size in source.shape)
        if source.is_flim or not {"X", "Y"} <= set(axes) or len(set(axes)) < len(axes) or min(shape) < 1:
            continue
        # other axes first, then in the order of a volume
        order = sorted(range(len(axes)), key=lambda n: (ORDER.find(axes[n]), n))
        load = partial(_map_samples, source, order)
        spacing, unit, step = _read_steps(source.xml_element)
        channels = _read_channels(source.xml_element)
        turned = "".join(axes[n] for n in order)
        images.append(Image(source.path, turned, tuple(shape[n] for n in order), load, channels, spacing, unit, step))
    if not images:
        raise expected("LIF", "an image with axes x and y", "none")
    return images


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
    return even_spacing(*(steps.get(axis, 0.0) for axis in "XYZ")), unit, steps.get("T") or None


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
