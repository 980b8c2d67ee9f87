"""Datasets of HDF5 and NetCDF as volumes.

The last three axes are z, y, x unless dimension labels, ilastik's "axistags", names of coordinates or the program's
layout say otherwise. Spacing comes from coordinates, else from attributes; it is never guessed. NetCDF's packed and
missing values are unpacked (CF conventions 1.11, sections 2.5.1 and 8.1).

An HDF5 file can refer to others (external links, external storage, virtual datasets): they are read only if that is
permitted. Only filters with bounded results are run.

Format: "NetCDF classic file format specifications", docs.unidata.ucar.edu. The library reads zeros beyond the end of a
file that is cut short, so sizes are checked first.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from splatgl.data.affine import (
    METRES,
    Coordinate,
    CoordinateGrid,
    curved_notes,
    make_lattice,
    metres_in,
    unit_name,
    value_unit_name,
)
from splatgl.data.arrays import Transposed
from splatgl.data.times import Times, seconds_in
from splatgl.data.volume import Volume
from splatgl.errors import InputError, MissingOption, expected, import_extra
from splatgl.readers import vtk_files
from splatgl.readers.channels import (
    COLOR_NOTE,
    MAGNITUDE_NOTE,
    MOST_CHANNELS,
    Channel,
    ChannelSet,
    is_color_rule,
    magnitudes,
    split_components,
)
from splatgl.readers.chunked import CF_NUMBERS, Packing
from splatgl.readers.common import array_fields, decoder_errors, require_bytes
from splatgl.readers.hdf5_files import (
    MOST_VALUES,
    attribute_numbers,
    attribute_text,
    attribute_texts,
    find_datasets,
    find_node,
    has_numbers,
    open_hdf5,
    probe,
    read_samples,
)
from splatgl.readers.hdf5_layouts import AxisScale, axis_scales, default_dataset, layout_grid, layout_kinds
from splatgl.readers.options import LoadOptions

# attributes with the steps along a dataset's axes in their order, or one step for all; the first attribute counts
_SPACINGS = (
    *("element_size_um", "spacing", "Spacing", "voxel_size", "voxelSize", "VoxelSize", "voxelsize"),
    *("pixel_size", "pixelSize", "resolution", "Resolution"),
)

# an unlabelled first or last axis of at most so many entries is taken for channels
_FEW = 16


def read(path: Path, options: LoadOptions) -> Volume:
    """The volume of a dataset: `array` names it (/a/b), else it is the only one that may be a volume, or the default.

    `channel` picks an entry along a fourth axis, `time` one along an axis of time. Colours become `Volume.color`, and
    complex numbers their magnitude. Samples of more than WHOLE_BYTES are read in parts.
    """
    file = open_hdf5(path)
    # a file's contents are untrusted: any failure is attributed to the file
    with decoder_errors("HDF5"):
        vtk = find_node(file, vtk_files.HDF, anywhere=False)
        if vtk is not None and options.array is None:
            return vtk_files.read_hdf5(path, file, options)
        if options.array is None:
            nodes = find_datasets(file)
            dataset, notes = choose_dataset(nodes, partial(default_dataset, file))
        else:
            dataset, notes = find_node(file, str(options.array), options.anywhere), ()
            if not hasattr(dataset, "shape") or not has_numbers(dataset):
                if vtk is not None:
                    return vtk_files.read_hdf5(path, file, options)
                raise array_error(find_datasets(file), dataset, options)
        return read_dataset(path, dataset, options, notes)


def read_dataset(path: Path, dataset: Any, options: LoadOptions, notes: tuple[str, ...] = ()) -> Volume:
    """The volume of a dataset: of h5py, or of another library with h5py's names."""
    kinds = _axis_kinds(dataset)
    axes = _find_axes(dataset.shape, kinds)
    if axes is None:
        this, fix = "three axes of space, and a first or last one of few entries", "label its axes, or save a part"
        raise expected(dataset.name, this, _join_shape(dataset.shape), fix)
    others = [axis for axis, size in enumerate(dataset.shape) if size > 1 and axis not in axes]
    time = next((axis for axis in others if kinds[axis] == "time"), None)
    colors = next((axis for axis in others if _is_color_axis(dataset, axis, kinds)), None)
    colors = colors if options.channel is None else None
    others = [axis for axis in others if axis not in (time, colors)]
    channels = _find_channels(path, dataset, others, time, kinds, options)
    grid, frame = _grid(path, dataset, axes, options)
    name = dataset.name.rsplit("/", 1)[-1]
    is_complex = dataset.dtype.kind in "cV"
    stated = {name: attribute_numbers(dataset, name) for name in CF_NUMBERS}
    packing = None if is_complex else Packing.of(stated, dataset.dtype, attribute_text(dataset, "_Unsigned"))
    values_of = magnitudes if is_complex else packing.values if packing else None
    dtype = np.dtype(np.float32) if packing else dataset.dtype
    title = attribute_text(dataset, "long_name")
    about = {"frame": frame, **array_fields(name, dtype, _value_unit(dataset), grid.unit, title=title)}

    def read_channel(channel: int | None) -> Volume:
        picked: dict[int, str | int] = dict.fromkeys(set(range(len(dataset.shape))) - {*axes, colors}, 0)
        picked |= dict.fromkeys(others, "channel") | ({} if time is None else {time: "time"})
        number = channel if channels.channels else options.channel_number(channels.components)
        index = replace(options, array=None, channel=number).index(dataset.shape, picked)
        samples: Any = read_samples(path, dataset, index, options.anywhere, values_of)
        if colors is not None:
            return _read_colors(grid, samples, axes, colors, about)
        volume = grid.volume(_transpose(samples, axes), "spacing", **about)
        return replace(volume, notes=(*notes, *[MAGNITUDE_NOTE] * is_complex, *volume.notes))

    # here the option `array` is a dataset, not a time point
    return channels.volume(replace(options, array=None), read_channel)


def _is_color_axis(dataset: Any, axis: int, kinds: list[str]) -> bool:
    """Whether an axis holds the parts of a colour in bytes: the last one, or the one that MATLAB has for colours."""
    placed = axis == len(dataset.shape) - 1 or "MATLAB_class" in dataset.attrs
    return placed and kinds[axis] == "c" and is_color_rule(dataset.dtype, dataset.shape[axis])


def _read_colors(grid: CoordinateGrid, samples: Any, axes: list[int], colors: int, about: dict[str, Any]) -> Volume:
    """The volume of samples along the axes of space and of colours."""
    if not isinstance(samples, np.ndarray) or any(places is not None for places in grid.between):
        raise expected("colours", "an even grid in one part", "another", "pick one with channel=0 … channel=2")
    ranks = np.argsort(np.argsort([*axes, colors])).tolist()
    luma, color, _ = split_components(samples.transpose(ranks), is_color=True)
    volume = grid.volume(luma, "spacing", color=color, **about)
    return replace(volume, notes=(COLOR_NOTE, *volume.notes))


def _find_channels(
    path: Path, dataset: Any, others: list[int], time: int | None, kinds: list[str], options: LoadOptions
) -> ChannelSet:
    """The time points, and the channels, named by number, if there is one axis beside space and time."""
    count = dataset.shape[others[0]] if len(others) == 1 else 1
    channels = tuple(Channel(str(n)) for n in range(count)) if 1 < count <= MOST_CHANNELS else ()
    components = 1 if count == 1 and not others else MOST_CHANNELS**2
    what = "channels"
    if channels and kinds[others[0]] != "c":
        what = f"entries along axis {others[0] + 1} of {_join_shape(dataset.shape)}"
    channel_set = ChannelSet(channels, components=components, what=what)
    if time is None:
        return channel_set
    step, moments = _find_times(path, dataset, time, options)
    return replace(channel_set, times=dataset.shape[time], step=step, moments=moments)


def list_datasets(path: Path) -> list[str]:
    """A line per dataset: name, type and shape; a star marks datasets that may be volumes."""
    with decoder_errors("HDF5"), open_hdf5(path) as file:
        return describe_datasets(find_datasets(file))


def describe_datasets(nodes: dict[str, Any]) -> list[str]:
    """A line per dataset, see `list_datasets`."""
    types = {
        name: ("complex" if node.dtype.kind in "cV" else node.dtype) if has_numbers(node) else "no numbers"
        for name, node in nodes.items()
    }
    return [
        f"{'*' if _is_volume(node) else ' '} {name}   {types[name]} {_join_shape(node.shape or ())}"
        for name, node in nodes.items()
    ]


def _join_shape(shape: tuple[int, ...]) -> str:
    return "×".join(map(str, shape)) or "one value"


def choose_dataset(
    nodes: dict[str, Any], default: Callable[[Sequence[str]], str | None] = lambda _: None
) -> tuple[Any, tuple[str, ...]]:
    """The only dataset that may be a volume, or the default among several; a note on the others.

    default: picks one of several names, or none.
    """
    volumes = {name: node for name, node in nodes.items() if _is_volume(node)}
    if len(volumes) == 1:
        return next(iter(volumes.values())), ()
    named = default(list(volumes))
    if named is not None:
        others = ", ".join(name for name in volumes if name != named)
        return volumes[named], (f"{named} is rendered, the file's default; --array picks another: {others}",)
    listed = ", ".join(f"{name} {_join_shape(node.shape or ())}" for name, node in nodes.items()) or "no dataset"
    if not volumes:
        raise expected("datasets", "one of numbers with three axes of space", listed)
    fix = "pick one with array=/NAME, or FILE:/NAME"
    error = expected("datasets", "one volume", f"{len(volumes)} in {listed}", fix)
    raise MissingOption(str(error), "array", [])


def array_error(nodes: dict[str, Any], node: Any, options: LoadOptions) -> InputError:
    """The error for `array`, which names no dataset of numbers. node: the group of that name, if there is one."""
    names = [name for name, dataset in nodes.items() if _is_volume(dataset)] or list(nodes)
    got = f"the group {options.array!r}" if hasattr(node, "keys") else repr(options.array)
    return expected("array", f"a dataset of numbers: {', '.join(names) or 'the file has no dataset'}", got)


def _is_volume(node: Any) -> bool:
    """Whether a dataset may be a volume: numbers, with three axes of space that are longer than one."""
    if not has_numbers(node):
        return False
    axes = _find_axes(node.shape, _axis_kinds(node))
    return axes is not None and min(node.shape[axis] for axis in axes) > 1


def _axis_kinds(dataset: Any) -> list[str]:
    """The kind of each axis, see `axis_kind`: by labels, by "axistags", by coordinates, or by the program's layout.

    A last axis of three or four bytes is one of colours unless it has another label.
    """
    names = [text.lower() for text in attribute_texts(dataset, "DIMENSION_LABELS")]
    if not any(names) and "axistags" in dataset.attrs:
        try:
            names = [str(axis["key"]).lower() for axis in json.loads(attribute_text(dataset, "axistags"))["axes"]]
        except (ValueError, KeyError, TypeError, RecursionError):
            names = []
    kinds = layout_kinds(dataset, axis_scales(dataset), names)
    colored = len(kinds) > 3 and not kinds[-1] and is_color_rule(dataset.dtype, dataset.shape[-1])
    return [*kinds[:-1], "c"] if colored else kinds


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
    ranks = np.argsort(order).tolist()
    return samples.transpose(ranks) if isinstance(samples, np.ndarray) else Transposed(samples, ranks)


def _grid(path: Path, dataset: Any, axes: list[int], options: LoadOptions) -> tuple[CoordinateGrid, str | None]:
    """The grid of the axes of space, and its frame if the program has one."""
    stated = layout_grid(dataset)
    if stated is not None:
        return stated
    # the coordinates along the axes of space, None for an axis without a number per sample
    sizes, every = [dataset.shape[axis] for axis in axes], axis_scales(dataset)
    scales = [every[axis] if _is_scale(every[axis], dataset.shape[axis]) else None for axis in axes]
    plain = [Coordinate(name, size) for name, size in zip("zyx", sizes, strict=True)]
    for name in () if all(scale is not None for scale in scales) else _SPACINGS:
        steps = _steps(attribute_numbers(dataset, name), len(dataset.shape), axes)
        if steps is not None:
            unit = "um" if name == "element_size_um" else _unit(dataset)
            return replace(make_lattice(plain), matrix=np.diag(steps[::-1]), unit=unit), None
    coordinates = [
        known
        if scale is None
        else Coordinate.of(scale.name, _read_scale(path, scale, known.size, options), scale.attributes)
        for known, scale in zip(plain, scales, strict=True)
    ]
    grid = make_lattice(coordinates, dataset.name, even=options.spacing is not None)
    named = attribute_text(dataset, "coordinates").split()
    curved = curved_notes({name: {} for name in named}, None not in scales[1:])
    return replace(grid, notes=(*grid.notes, *curved)), None


def _read_scale(path: Path, scale: AxisScale, size: int, options: LoadOptions) -> np.ndarray:
    places = read_samples(path, scale.node, [slice(None)], options.anywhere)
    return scale.spread(np.asarray(places[:], np.float64), size)


def _find_times(path: Path, dataset: Any, axis: int, options: LoadOptions) -> tuple[float | None, Times | None]:
    """Seconds between two time points, and their times, by the scale of their axis, also in CF's "hours since …"; None
    if unknown.
    """
    scale, size = axis_scales(dataset)[axis], dataset.shape[axis]
    if scale is None or not _is_scale(scale, size):
        return None, None
    about = scale.attributes
    stated = about["units"] or about["unit"]
    unit = seconds_in(stated.split(" ")[0])
    places = _read_scale(path, scale, size, options)
    steps = np.diff(places)
    even = len(steps) and np.isfinite(places).all() and np.ptp(steps) <= 1e-3 * abs(steps[0])
    step = float(steps[0]) * unit if unit and even and steps[0] > 0 else None
    return step, Times.of(places, stated, attribute_text(scale.node, "calendar"))


def _unit(node: Any) -> str:
    """The stated unit of length, "" for none; NetCDF's unit is mostly that of the values."""
    units = {unit_name(attribute_text(node, name)) for name in ("unit", "units")} & set(METRES)
    return units.pop() if len(units) == 1 else ""


def _value_unit(dataset: Any) -> str:
    """The unit of values; "" for a length, which may be the grid's."""
    unit = attribute_text(dataset, "units") or attribute_text(dataset, "unit")
    return "" if metres_in(unit) else value_unit_name(unit)


def _is_scale(scale: AxisScale | None, size: int) -> bool:
    # for a dimension without coordinates NetCDF writes a scale with this name
    none = "This is a netCDF dimension but not"
    plain = scale is not None and size <= MOST_VALUES and scale.fits(size)
    return scale is not None and plain and not attribute_text(scale.node, "NAME").startswith(none)


def _steps(numbers: np.ndarray | None, count: int, axes: list[int]) -> list[float] | None:
    """Steps along z, y, x from one number, or one per axis of space or of the dataset; None for anything else."""
    if numbers is None or not np.isfinite(numbers).all():
        return None
    if numbers.size == 1:
        numbers = np.repeat(numbers, 3)
    if numbers.size == count > 3:
        numbers = numbers[axes]
    return numbers.tolist() if numbers.size == 3 and (numbers > 0).all() else None


def read_netcdf(path: Path, options: LoadOptions) -> Volume:
    """The volume of a variable: `array` names it, else it is the only one that may be a volume; options as in HDF5."""
    with decoder_errors("NetCDF"):
        variables = _open(path)
        if options.array is None:
            variable, _ = choose_dataset(variables)
        else:
            variable = variables.get("/" + str(options.array).strip("/"))
            if variable is None or not has_numbers(variable):
                raise array_error(variables, variable, options)
        return read_dataset(path, variable, options)


def list_variables(path: Path) -> list[str]:
    """A line per variable, as `hdf5.list_datasets`."""
    with decoder_errors("NetCDF"):
        return describe_datasets(_open(path))


class _Attributes(dict[str, Any]):
    """Attributes with the method by which h5py's are asked for their shape."""

    def get_id(self, name: str) -> np.ndarray:
        return np.asarray(self[name])


class _Variable:
    """A variable with h5py's names for a dataset; scales: the coordinates of each axis, None without any."""

    chunks = None

    def __init__(self, variable: Any) -> None:
        self.variable, self.name, self.shape = variable, f"/{variable.name}", tuple(map(int, variable.shape))
        self.dtype = np.dtype(variable.dtype)
        self.attrs = _Attributes({name: variable.getncattr(name) for name in variable.ncattrs()})
        self.attrs["DIMENSION_LABELS"] = list(variable.dimensions)
        self.scales: list[AxisScale | None] = []

    def __getitem__(self, key: Any) -> np.ndarray:
        return np.asarray(self.variable[key])


def _open(path: Path) -> dict[str, Any]:
    """The variables of a file by name. Raises InputError for a file that is cut short."""
    netcdf = import_extra("netCDF4", "NetCDF-3 files", "netCDF4", "netcdf")
    probe(path)
    file = netcdf.Dataset(path, "r")
    # stored numbers, not masked or scaled ones
    file.set_auto_maskandscale(False)
    require_bytes(_least_bytes(file), path.stat().st_size)
    nodes = {name: _Variable(variable) for name, variable in file.variables.items()}
    for node in nodes.values():
        known = [nodes.get(name) for name in node.variable.dimensions]
        node.scales = [None if scale is None else AxisScale(scale, scale.name[1:]) for scale in known]
    return {node.name: node for node in nodes.values()}


def _least_bytes(file: Any) -> int:
    """Bytes that the header and the samples take at least, by the format's specification."""
    word = 8 if file.data_model == "NETCDF3_64BIT_DATA" else 4
    offset = 4 if file.data_model == "NETCDF3_CLASSIC" else 8
    size = 4 + word + 3 * (4 + word)
    size += sum(2 * word + _padded(len(name.encode())) for name in file.dimensions)
    size += _attribute_bytes(file, word)
    for name, variable in file.variables.items():
        size += 2 * word + _padded(len(name.encode())) + word * len(variable.dimensions)
        size += 4 + word + _attribute_bytes(variable, word) + 4 + word + offset
        size += math.prod(map(int, variable.shape)) * np.dtype(variable.dtype).itemsize
    return size


def _attribute_bytes(owner: Any, word: int) -> int:
    total = 0
    for name in owner.ncattrs():
        value = owner.getncattr(name)
        size = len(value.encode()) if isinstance(value, str) else np.asarray(value).nbytes
        total += 4 + 2 * word + _padded(len(name.encode())) + _padded(size)
    return total


def _padded(size: int) -> int:
    return -(-size // 4) * 4
