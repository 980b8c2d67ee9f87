"""Imaris files (.ims, version 5.5): HDF5 with a pyramid of levels, time points and channels.

Layout: "Imaris 5.5 file format", imaris.oxinst.com. Attributes hold numbers as letters; a level's dataset is padded to
whole chunks, and its group states the image's size. All levels span the box from ExtMin to ExtMax.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from splatgl.data.affine import volume_on_grid
from splatgl.data.volume import Lengths, Volume
from splatgl.errors import expected
from splatgl.readers.channels import Channel, ChannelSet, hex_color, mark_microscope, parse_window
from splatgl.readers.common import convert_words, decoder_errors, grid_shape, parse_number
from splatgl.readers.hdf5_files import attribute_text, find_node, has_real_numbers, open_hdf5
from splatgl.readers.hdf5_parts import read_samples
from splatgl.readers.options import LoadOptions

# most levels; each has at most half the voxels of the level before
_MOST = 64
# most time points or channels
_MOST_ENTRIES = 100_000


def read(path: Path, options: LoadOptions) -> Volume:
    """The volume of an Imaris file with its coarser levels.

    `channel` picks channels, `time` a time point, `level` a level. Samples of more than WHOLE_BYTES are read in parts.
    """
    file = open_hdf5(path)
    with decoder_errors("Imaris"):
        # 1. the image
        finest = _find_group(file, "DataSet/ResolutionLevel 0")
        times = _count_groups(finest, "TimePoint")
        channels = _count_groups(_find_group(finest, "TimePoint 0"), "Channel")
        time = options.time_number(times)
        # 2. its levels
        levels = _count_groups(_find_group(file, "DataSet"), "ResolutionLevel", _MOST)
        wanted = options.level_numbers(levels)
        # 3. the samples, and the box of all levels
        image = _find_group(file, "DataSetInfo/Image")
        channel_set = ChannelSet(tuple(_read_channel(file, n) for n in range(channels)), channels > 1, times)

        def read_one(channel: int | None) -> Volume:
            place = f"TimePoint {time}/Channel {channel or 0}"
            whole, *parts = (_find_group(file, f"DataSet/ResolutionLevel {level}/{place}") for level in (0, *wanted))
            volumes = [_read_volume(path, part, image, options, whole) for part in parts]
            return replace(volumes[0], coarser=tuple(volumes[1:]))

        return mark_microscope(channel_set.volume(options, read_one))


def _read_channel(file: Any, number: int) -> Channel:
    """A channel's name, colour ("r g b" from 0 to 1) and window, if the file has them."""
    node = find_node(file, f"DataSetInfo/Channel {number}", anywhere=False)
    if node is None:
        return Channel(str(number))
    color, ends = (attribute_text(node, name).split() for name in ("Color", "ColorRange"))
    parts = [parse_number(part) for part in color]
    fine = len(parts) == 3 and all(0 <= part <= 1 for part in parts)
    rgb = hex_color([round(part * 255) for part in parts]) if fine else None
    return Channel(attribute_text(node, "Name") or str(number), rgb, parse_window(*ends) if len(ends) == 2 else None)


def _find_group(file: Any, name: str) -> Any:
    node = find_node(file, name, anywhere=False)
    if node is None or not hasattr(node, "keys"):
        raise expected("file", f"a group {name!r}", "none", "is this an Imaris file?")
    return node


def _count_groups(group: Any, name: str, most: int = _MOST_ENTRIES) -> int:
    """The number of groups "NAME 0", "NAME 1", …"""
    count = 0
    while count < most and f"{name} {count}" in group:
        count += 1
    if not count:
        raise expected("file", f"a group '{name} 0'", "none", "is this an Imaris file?")
    return count


def _sizes(channel: Any, padded: Sequence[int]) -> list[int]:
    return [int(_read_number(channel, f"ImageSize{axis}", size)) for axis, size in zip("XYZ", padded, strict=True)]


def _read_volume(path: Path, channel: Any, image: Any, options: LoadOptions, whole: Any) -> Volume:
    """The volume of a channel at a level. whole: its group at the finest level."""
    data = find_node(channel, "Data", options.anywhere)
    if not hasattr(data, "shape") or not has_real_numbers(data) or len(data.shape) != 3:
        raise expected(f"{channel.name}/Data", "a dataset of real numbers with three axes", "none")
    # 1. the part of the dataset that is the image
    padded = data.shape[::-1]
    sizes = _sizes(channel, padded)
    shape = grid_shape(sizes, "ImageSize")
    if any(size > room for size, room in zip(shape, data.shape, strict=True)):
        raise expected("ImageSize", f"at most the dataset's {padded}", sizes, "the file is damaged")
    samples = read_samples(path, data, [slice(0, size) for size in shape], options.anywhere)
    # 2. its box
    low, high = _read_corner(image, "ExtMin", [0, 0, 0]), _read_corner(image, "ExtMax", sizes)
    matrix = np.diag((high - low) / sizes)
    origin = low + matrix @ (0.5, 0.5, 0.5)
    finest = _sizes(whole, whole["Data"].shape[::-1])
    lengths = Lengths.of(np.diag((high - low) / finest), finest)
    unit = attribute_text(image, "Unit")
    return volume_on_grid(samples, matrix, origin, "ExtMin and ExtMax", unit=unit, whole=lengths)


def _read_corner(image: Any, name: str, default: Sequence[float]) -> np.ndarray:
    return np.array([_read_number(image, f"{name}{axis}", value) for axis, value in enumerate(default)])


def _read_number(node: Any, name: str, default: float) -> float:
    """The number in the letters of an attribute."""
    return convert_words([attribute_text(node, name)], float, name)[0] if name in node.attrs else default
