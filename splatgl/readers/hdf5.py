"""HDF5 and NetCDF-4 datasets.

The last three axes are z, y, x unless dimension labels, ilastik's "axistags" or names of dimension scales say
otherwise. Spacing comes from dimension scales, else from attributes; it is never guessed. NetCDF's packed and missing
values are unpacked (CF conventions 1.11, sections 2.5.1 and 8.1).

An HDF5 file can refer to others (external links, external storage, virtual datasets): they are read only if that is
permitted. Only filters with bounded results are run.
"""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from splatgl.data.affine import (
    METRES,
    Coordinate,
    Lattice,
    axis_kind,
    make_lattice,
    unit_name,
    value_unit_name,
)
from splatgl.data.volume import Volume
from splatgl.errors import Choice, expected
from splatgl.readers.channels import MOST_CHANNELS, SECONDS, Channel, ChannelSet
from splatgl.readers.chunked import Packing
from splatgl.readers.common import (
    decoder_errors,
)
from splatgl.readers.hdf5_files import (
    MOST_VALUES,
    attribute_numbers,
    attribute_text,
    attribute_texts,
    dimension_scales,
    find_datasets,
    find_node,
    has_real_numbers,
    open_hdf5,
)
from splatgl.readers.hdf5_parts import read_samples
from splatgl.readers.options import LoadOptions

# attributes with the steps along a dataset's axes in their order, or one step for all; the first attribute counts
_SPACINGS = (
    *("element_size_um", "spacing", "Spacing", "voxel_size", "voxelSize", "VoxelSize", "voxelsize"),
    *("pixel_size", "pixelSize", "resolution", "Resolution"),
)

# an unlabelled first or last axis of at most so many entries is taken for channels
_FEW = 16


def read(path: Path, options: LoadOptions) -> Volume:
    """The volume of a dataset: `array` names it (/a/b), else it is the only one that may be a volume.

    `channel` picks an entry along a fourth axis, `time` one along an axis of time. Samples of more than WHOLE_BYTES are
    read in parts.
    """
    file = open_hdf5(path)
    # a file's contents are untrusted: any failure is attributed to the file
    with decoder_errors("HDF5"):
        dataset = _select_dataset(file, options)
        kinds = _axis_kinds(dataset)
        axes = _find_axes(dataset.shape, kinds)
        if axes is None:
            this, fix = "three axes, and a first or last one of few channels", "label its dimensions, or save a part"
            raise expected(dataset.name, this, _join_shape(dataset.shape), fix)
        others = [axis for axis, size in enumerate(dataset.shape) if size > 1 and axis not in axes]
        time = next((axis for axis in others if kinds[axis] == "time"), None)
        others = [axis for axis in others if axis != time]
        channels = _find_channels(path, dataset, others, time, options)
        grid = _grid(path, dataset, axes, options)

        def read_channel(channel: int | None) -> Volume:
            picked: dict[int, str | int] = dict.fromkeys(set(range(len(dataset.shape))) - set(axes), 0)
            picked |= dict.fromkeys(others, "channel") | ({} if time is None else {time: "time"})
            number = channel if channels.channels else options.channel_number(channels.components)
            index = replace(options, array=None, channel=number).index(dataset.shape, picked)
            samples: Any = read_samples(path, dataset, index, options.anywhere, _read_packing(dataset))
            return grid.volume(_transpose(samples, axes), "spacing", value_unit=_value_unit(dataset))

        # here the option `array` is a dataset, not a time point
        return channels.volume(replace(options, array=None), read_channel)


def _find_channels(path: Path, dataset: Any, others: list[int], time: int | None, options: LoadOptions) -> ChannelSet:
    """The time points, and the channels, named by number, if there is one axis beside space and time."""
    count = dataset.shape[others[0]] if len(others) == 1 else 1
    channels = tuple(Channel(str(n)) for n in range(count)) if 1 < count <= MOST_CHANNELS else ()
    components = 1 if count == 1 and not others else MOST_CHANNELS**2
    if time is None:
        return ChannelSet(channels, components=components)
    step = _time_step(path, dataset, time, options)
    return ChannelSet(channels, False, dataset.shape[time], step, components)


def list_datasets(path: Path) -> list[str]:
    """A line per dataset: name, type and shape; a star marks datasets that may be volumes."""
    with decoder_errors("HDF5"), open_hdf5(path) as file:
        nodes = find_datasets(file)
        kinds = {name: node.dtype if has_real_numbers(node) else "no numbers" for name, node in nodes.items()}
        return [
            f"{'*' if _is_volume(node) else ' '} {name}   {kinds[name]} {_join_shape(node.shape or ())}"
            for name, node in nodes.items()
        ]


def _join_shape(shape: tuple[int, ...]) -> str:
    return "×".join(map(str, shape)) or "one value"


def _select_dataset(file: Any, options: LoadOptions) -> Any:
    """The dataset that `array` names, else the only one that may be a volume."""
    if options.array is not None:
        node = find_node(file, str(options.array), options.anywhere)
        if not hasattr(node, "shape") or not has_real_numbers(node):
            datasets = find_datasets(file)
            names = [name for name, dataset in datasets.items() if _is_volume(dataset)] or list(datasets)
            got = f"the group {options.array!r}" if hasattr(node, "keys") else repr(options.array)
            raise expected("array", f"a dataset of real numbers: {', '.join(names) or 'the file has no dataset'}", got)
        return node
    nodes = find_datasets(file)
    volumes = [node for node in nodes.values() if _is_volume(node)]
    if len(volumes) != 1:
        listed = ", ".join(f"{name} {_join_shape(node.shape or ())}" for name, node in nodes.items()) or "nothing"
        count = f"{len(volumes) or 'none'} in {listed}"
        error = expected("datasets", "one volume", count, "pick one with array=/NAME, or FILE:/NAME")
        raise Choice(str(error), "array", []) if volumes else error
    return volumes[0]


def _is_volume(node: Any) -> bool:
    """Whether a dataset may be a volume: real numbers, with three axes of space that are longer than one."""
    if not has_real_numbers(node):
        return False
    axes = _find_axes(node.shape, _axis_kinds(node))
    return axes is not None and min(node.shape[axis] for axis in axes) > 1


def _axis_kinds(dataset: Any) -> list[str]:
    """The kind of each axis, see `axis_kind`: by labels, by "axistags", or by dimension scales."""
    scales = dimension_scales(dataset) or [None] * len(dataset.shape)
    names = [text.lower() for text in attribute_texts(dataset, "DIMENSION_LABELS")]
    if not any(names) and "axistags" in dataset.attrs:
        try:
            names = [str(axis["key"]).lower() for axis in json.loads(attribute_text(dataset, "axistags"))["axes"]]
        except (ValueError, KeyError, TypeError, RecursionError):
            names = []
    if not any(names):
        names = ["" if scale is None else _last_name(scale) for scale in scales]
    if len(names) != len(dataset.shape):
        return [""] * len(dataset.shape)
    return [
        axis_kind(name, {} if scale is None else _attributes(scale)) for name, scale in zip(names, scales, strict=True)
    ]


def _last_name(node: Any) -> str:
    return str(node.name).rsplit("/", 1)[-1]


def _attributes(scale: Any) -> dict[str, str]:
    """The attributes of a dimension scale that describe its axis."""
    return {name: attribute_text(scale, name) for name in ("units", "unit", "positive", "standard_name", "axis")}


def _find_axes(shape: tuple[int, ...], kinds: list[str]) -> list[int] | None:
    """The numbers of the axes z, y, x: those of known kind, else the three that remain without axes of one entry and
    without a short first or last of four axes; None if that is ambiguous.
    """
    if len(shape) < 3 or min(shape) < 1:
        return None
    long = [axis for axis, size in enumerate(shape) if size > 1]
    named = {kind: kinds.index(kind) for kind in "xyz" if kinds.count(kind) == 1}
    if len(named) == 3:
        return [named["z"], named["y"], named["x"]]
    times = [axis for axis in long if kinds[axis] in ("time", "c")]
    free = [axis for axis in range(len(shape)) if axis not in times]
    if len(free) > 3:
        free = [axis for axis in free if axis in long]
    if len(free) == 4 and min(shape[free[0]], shape[free[3]]) <= _FEW:
        free = free[1:] if shape[free[0]] <= shape[free[3]] else free[:3]
    return free if len(free) == 3 else None


def _transpose(samples: Any, axes: list[int]) -> Any:
    """Transposes samples to z, y, x."""
    order = np.argsort(axes).tolist()
    if order == [0, 1, 2]:
        return samples
    if not isinstance(samples, np.ndarray):
        raise expected("axes", "the order z, y, x for a dataset that is read in parts", "another order", "transpose it")
    return samples.transpose(np.argsort(order).tolist())


def _read_packing(dataset: Any) -> Packing | None:
    """NetCDF's packing of the numbers, None if they are values."""
    stated = {
        name: attribute_numbers(dataset, name) for name in ("scale_factor", "add_offset", "_FillValue", "missing_value")
    }
    scale, offset, *fills = (
        None if numbers is None or numbers.size != 1 else float(numbers[0]) for numbers in stated.values()
    )
    return Packing.of(scale, offset, next((fill for fill in fills if fill is not None and np.isfinite(fill)), None))


def _grid(path: Path, dataset: Any, axes: list[int], options: LoadOptions) -> Lattice:
    """The grid of the axes of space."""
    # the dimension scales of the axes of space, None for an axis without a number per sample
    sizes = [dataset.shape[axis] for axis in axes]
    all_scales = dimension_scales(dataset) or [None] * len(dataset.shape)
    scales = [
        all_scales[axis] if _is_scale(all_scales[axis], size) else None for axis, size in zip(axes, sizes, strict=True)
    ]
    plain = [Coordinate(name, size) for name, size in zip("zyx", sizes, strict=True)]
    for name in () if all(scale is not None for scale in scales) else _SPACINGS:
        steps = _steps(attribute_numbers(dataset, name), len(dataset.shape), axes)
        if steps is not None:
            unit = "um" if name == "element_size_um" else _unit(dataset)
            return replace(make_lattice(plain), matrix=np.diag(steps[::-1]), unit=unit)
    coordinates = [
        known
        if scale is None
        else Coordinate.of(_last_name(scale), _read_scale(path, scale, options), _attributes(scale))
        for known, scale in zip(plain, scales, strict=True)
    ]
    grid = make_lattice(coordinates, dataset.name, even=options.spacing is not None)
    named = attribute_text(dataset, "coordinates").split()
    # curved grids have coordinates along two axes at once
    curved = [name for name in named if axis_kind(name, {}) in ("x", "y")] if None in scales[1:] else []
    note = f"x and y are numbers of samples: coordinates in two dimensions ({', '.join(curved[:4])}) are not used"
    return replace(grid, notes=(*grid.notes, *[note] * bool(curved)))


def _read_scale(path: Path, scale: Any, options: LoadOptions) -> np.ndarray:
    return np.asarray(read_samples(path, scale, [slice(None)], options.anywhere)[:], np.float64)


def _time_step(path: Path, dataset: Any, axis: int, options: LoadOptions) -> float | None:
    """Seconds between two time points by the scale of their axis, also in CF's "hours since …"; None if unknown."""
    scales = dimension_scales(dataset)
    scale = scales[axis] if axis < len(scales) else None
    if not _is_scale(scale, dataset.shape[axis]):
        return None
    unit = SECONDS.get((attribute_text(scale, "units") or attribute_text(scale, "unit")).split(" ")[0].lower())
    places = _read_scale(path, scale, options)
    steps = np.diff(places)
    even = len(steps) and np.isfinite(places).all() and np.ptp(steps) <= 1e-3 * abs(steps[0])
    return float(steps[0]) * unit if unit and even and steps[0] > 0 else None


def _unit(node: Any) -> str:
    """The stated unit of length, "" for none; NetCDF's unit is mostly that of the values."""
    units = {unit_name(attribute_text(node, name)) for name in ("unit", "units")} & set(METRES)
    return units.pop() if len(units) == 1 else ""


def _value_unit(dataset: Any) -> str:
    """The unit of values; "" for a length, which may be the grid's."""
    unit = attribute_text(dataset, "units") or attribute_text(dataset, "unit")
    return "" if unit_name(unit) in METRES else value_unit_name(unit)


def _is_scale(scale: Any, size: int) -> bool:
    # for a dimension without coordinates NetCDF writes a scale with this name
    none = "This is a netCDF dimension but not"
    plain = scale is not None and has_real_numbers(scale) and scale.shape == (size,) and size <= MOST_VALUES
    return plain and not attribute_text(scale, "NAME").startswith(none)


def _steps(numbers: np.ndarray | None, count: int, axes: list[int]) -> list[float] | None:
    """Steps along z, y, x from one number, or one per axis of space or of the dataset; None for anything else."""
    if numbers is None or not np.isfinite(numbers).all():
        return None
    if numbers.size == 1:
        numbers = np.repeat(numbers, 3)
    if numbers.size == count > 3:
        numbers = numbers[axes]
    return numbers.tolist() if numbers.size == 3 and (numbers > 0).all() else None
