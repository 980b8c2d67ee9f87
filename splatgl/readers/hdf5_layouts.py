"""Layouts of HDF5 files: axes by names and attributes, and Imaris.

Sources: "NeXus: NXdata" (manual.nexusformat.org); "EMD file format" (emdatasets.com) and emdfile; MATLAB's "MAT-file
versions" (rows run fastest, which HDF5 lists last); ITK's HDF5ImageIO; EMAN2's and UCSF Chimera's descriptions of HDF5.

Layout: "Imaris 5.5 file format", imaris.oxinst.com. Attributes hold numbers as letters; a level's dataset is padded to
whole chunks, and its group states the image's size. All levels span the box from ExtMin to ExtMax.
"""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from splatgl.data.affine import CoordinateGrid, axis_kind, volume_on_grid
from splatgl.data.times import seconds_in
from splatgl.data.volume import Lengths, Volume
from splatgl.errors import expected
from splatgl.readers.channels import Channel, ChannelSet, hex_color, is_color_rule, mark_microscope, parse_window
from splatgl.readers.common import convert_words, decoder_errors, grid_shape, parse_number
from splatgl.readers.hdf5_files import (
    attribute_numbers,
    attribute_text,
    attribute_texts,
    dimension_scales,
    find_node,
    has_numbers,
    open_hdf5,
    read_samples,
)
from splatgl.readers.options import LoadOptions

# most groups from the root to NeXus' default data; most bytes of Velox' description of an image
_DEPTH, _MOST_BYTES = 8, 2**20
# kinds of real numbers
REAL = "buif"
# units of length that EMD's files spell in their own way
_EMD_UNITS = {"[n_m]": "nm", "[u_m]": "um", "[m_m]": "mm", "A": "Å", "[Å]": "Å"}


@dataclass(frozen=True)
class AxisScale:
    """Coordinates along an axis: their dataset, and the axis's name. ends: whether two stand for even ones, by EMD;
    faces: whether one more than there are samples are the faces of voxels, by NeXus.
    """

    node: Any
    name: str
    ends: bool = False
    faces: bool = False

    @property
    def attributes(self) -> dict[str, str]:
        """The attributes that describe the axis."""
        names = ("units", "unit", "positive", "standard_name", "axis")
        texts = {name: attribute_text(self.node, name) for name in names}
        return {name: _EMD_UNITS.get(text, text) if self.ends else text for name, text in texts.items()}

    def fits(self, size: int) -> bool:
        """Whether the coordinates are those of `size` samples."""
        counts = {(size,), *[(2,)] * self.ends, *[(size + 1,)] * self.faces}
        return has_numbers(self.node, REAL) and self.node.shape in counts

    def spread(self, places: np.ndarray, size: int) -> np.ndarray:
        """The coordinates of `size` samples out of those of the dataset."""
        if self.ends and len(places) == 2:
            return np.asarray(places[0] + (places[1] - places[0]) * np.arange(size))
        return (places[1:] + places[:-1]) / 2 if len(places) == size + 1 else places


def axis_scales(dataset: Any) -> list[AxisScale | None]:
    """The coordinates of each axis, None for an axis without any: dimension scales, or those of EMD or NeXus."""
    if hasattr(dataset, "scales"):
        return list(dataset.scales)
    scales = dimension_scales(dataset)
    if any(scale is not None for scale in scales):
        return [None if node is None else AxisScale(node, _last_name(node)) for node in scales]
    none: list[AxisScale | None] = [None] * len(dataset.shape)
    parent = dataset.parent
    if "emd_group_type" in parent.attrs:
        return _emd_scales(dataset, parent) or none
    names = _nexus_axes(dataset, parent)
    nodes = [find_node(dataset.file, f"{parent.name}/{name}", anywhere=False) if name else None for name in names]
    return [AxisScale(node, _last_name(node), faces=True) if hasattr(node, "shape") else None for node in nodes] or none


def _last_name(node: Any) -> str:
    return str(node.name).rsplit("/", 1)[-1]


def _emd_scales(dataset: Any, parent: Any) -> list[AxisScale | None]:
    """The scales in dim1, dim2, … beside the data, or in dim0, dim1, …; [] without any."""
    numbers = sorted(int(name[3:]) for name in parent if re.fullmatch("dim[0-9]{1,3}", name))[: len(dataset.shape)]
    nodes = [find_node(dataset.file, f"{parent.name}/dim{number}", anywhere=False) for number in numbers]
    scales: list[AxisScale | None] = [
        AxisScale(node, attribute_text(node, "name") or _last_name(node), ends=True) if hasattr(node, "shape") else None
        for node in nodes
    ]
    return scales if len(scales) == len(dataset.shape) else []


def _nexus_axes(dataset: Any, parent: Any) -> list[str]:
    """Names of the coordinates of each axis in the same group, "" for an axis without any; [] without any."""
    count = len(dataset.shape)
    owner = dataset if "axes" in dataset.attrs else parent
    texts = attribute_texts(owner, "axes") if "axes" in owner.attrs else []
    names = re.split("[:,]", texts[0].strip("[] ")) if len(texts) == 1 else texts
    if owner is parent and len(names) != count:
        return []
    placed = [""] * count
    for n, name in enumerate(map(str.strip, names)):
        stated = attribute_numbers(parent, f"{name}_indices") if name else None
        axis = int(stated[0]) if stated is not None and stated.size == 1 and np.isfinite(stated[0]) else n
        if 0 <= axis < count and re.fullmatch(r"\w[\w.-]*", name):
            placed[axis] = name
    return placed if any(placed) else []


def layout_kinds(dataset: Any, scales: Sequence[AxisScale | None], names: Sequence[str]) -> list[str]:
    """The kind of each axis, see `axis_kind`. names: labels of the axes, or [].

    Of more than three axes, one with coordinates in a unit of time is time.
    """
    shape = dataset.shape
    matlab = "MATLAB_class" in dataset.attrs
    if matlab and len(shape) >= 3:
        # rows are y, columns x, pages z; colours come behind the pages, or before them in sequences of pictures
        kinds = [*[""] * (len(shape) - 3), "z", "x", "y"]
        places = [axis for axis in (0, 1) if len(shape) == 4 and is_color_rule(dataset.dtype, shape[axis])]
        place = min(places, key=lambda axis: shape[axis], default=None)
        return kinds if place is None else ["c", *kinds[1:]] if place == 0 else ["z", "c", "x", "y"]
    if _is_velox(dataset):
        return ["y", "x", "z"]
    if not any(names):
        names = ["" if scale is None else scale.name for scale in scales]
    if len(names) != len(shape):
        return [""] * len(shape)
    about = [{} if scale is None else scale.attributes for scale in scales]
    kinds = [axis_kind(name, attributes) for name, attributes in zip(names, about, strict=True)]
    if sum(size > 1 for size in shape) > 3:
        units = [attributes.get("units") or attributes.get("unit") or "" for attributes in about]
        timed = (seconds_in(unit) is not None for unit in units)
        kinds = ["time" if is_time and not kind else kind for kind, is_time in zip(kinds, timed, strict=True)]
    return kinds


def _is_velox(dataset: Any) -> bool:
    return re.fullmatch("/Data/Image/[^/]+/Data", str(dataset.name)) is not None and len(dataset.shape) == 3


def layout_grid(dataset: Any) -> tuple[CoordinateGrid, str | None] | None:
    """The grid of x, y, z and its frame, if the program writes them without coordinates; else None."""
    if not hasattr(dataset, "parent"):
        return None
    parent = dataset.parent
    if re.fullmatch("/ITKImage/[0-9]+/VoxelData", str(dataset.name)):
        # each row of the directions is that of an axis
        steps = _numbers(parent, "Spacing", np.ones(3))
        matrix = _numbers(parent, "Directions", np.eye(3)).reshape(3, 3).T * steps
        return _plain_grid(matrix, _numbers(parent, "Origin", np.zeros(3)), ""), "LPS"
    sizes = [attribute_numbers(parent, f"EMAN.apix_{axis}") for axis in "xyz"]
    steps = np.array([size[0] if size is not None and size.size == 1 else np.nan for size in sizes])
    if (steps > 0).all() and np.isfinite(steps).all():
        return _plain_grid(np.diag(steps), np.zeros(3), "Å"), None
    step, start = (attribute_numbers(parent, name) for name in ("step", "origin"))
    if _last_name(dataset).startswith("data") and step is not None and step.size == 3 and (step > 0).all():
        return _plain_grid(np.diag(step), start if start is not None and start.size == 3 else np.zeros(3), "Å"), None
    return _velox_grid(dataset, parent) if _is_velox(dataset) else None


def _velox_grid(dataset: Any, parent: Any) -> tuple[CoordinateGrid, None] | None:
    """The size of pixels in the first frame's description, which is text in a column of bytes."""
    node = find_node(dataset.file, f"{parent.name}/Metadata", anywhere=False)
    if not hasattr(node, "shape") or node.dtype != np.uint8 or len(node.shape) != 2 or node.shape[0] > _MOST_BYTES:
        return None
    try:
        about = json.loads(bytes(node[:, 0]).split(b"\0")[0])["BinaryResult"]
        width, height = (float(about["PixelSize"][name]) * 1e9 for name in ("width", "height"))
    except (ValueError, KeyError, TypeError, RecursionError):
        return None
    if about.get("PixelUnitX") != "m" or not 0 < min(width, height) < np.inf:
        return None
    return _plain_grid(np.diag([width, height, width]), np.zeros(3), "nm", "frames are rendered one pixel apart"), None


def _numbers(parent: Any, name: str, default: np.ndarray) -> np.ndarray:
    """The numbers of a small dataset; the default for another count."""
    node = find_node(parent.file, f"{parent.name}/{name}", anywhere=False)
    if not hasattr(node, "shape") or not has_numbers(node, REAL) or np.prod(node.shape) != default.size:
        return default
    return np.asarray(node[()], np.float64).ravel()


def _plain_grid(matrix: np.ndarray, origin: np.ndarray, unit: str, *notes: str) -> CoordinateGrid:
    none = (None, None, None)
    return CoordinateGrid(matrix, origin.tolist(), unit, none, none, notes)


def default_dataset(file: Any, names: Sequence[str]) -> str | None:
    """The one among several datasets that NeXus' defaults lead to, or that alone is a signal; None without one."""
    node = file
    for _ in range(_DEPTH):
        default = attribute_text(node, "default")
        below = find_node(file, f"{node.name}/{default}", anywhere=False) if default else None
        if not hasattr(below, "keys"):
            break
        node = below
    signal = f"{node.name}/{attribute_text(node, 'signal')}"
    signals = [name for name in names if _is_signal(file[name])]
    return signal if signal in names else signals[0] if len(signals) == 1 else None


def _is_signal(dataset: Any) -> bool:
    return "signal" in dataset.attrs or attribute_text(dataset.parent, "signal") == _last_name(dataset)


# most levels; each has at most half the voxels of the level before
_MOST = 64
# most time points or channels
_MOST_ENTRIES = 100_000


def read_imaris(path: Path, options: LoadOptions) -> Volume:
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
    return count


def _sizes(channel: Any, padded: Sequence[int]) -> list[int]:
    return [int(_read_number(channel, f"ImageSize{axis}", size)) for axis, size in zip("XYZ", padded, strict=True)]


def _read_volume(path: Path, channel: Any, image: Any, options: LoadOptions, whole: Any) -> Volume:
    """The volume of a channel at a level. whole: its group at the finest level."""
    data = find_node(channel, "Data", options.anywhere)
    if not hasattr(data, "shape") or not has_numbers(data, REAL) or len(data.shape) != 3:
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
