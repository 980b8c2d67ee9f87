"""Datasets of HDF5 and NetCDF as volumes.

The last three axes are z, y, x unless dimension labels, ilastik's "axistags", names of coordinates or the program's
layout say otherwise. Spacing comes from coordinates, else from attributes; it is never guessed. NetCDF's packed and
missing values are unpacked (CF conventions 1.11, sections 2.5.1 and 8.1).

An HDF5 file can refer to others (external links, external storage, virtual datasets): they are read only if that is
permitted. Only filters with bounded results are run.

Sources of layouts: "NeXus: NXdata" (manual.nexusformat.org); "EMD file format" (emdatasets.com) and emdfile; MATLAB's
"MAT-file versions" (rows run fastest, which HDF5 lists last); ITK's HDF5ImageIO; descriptions of HDF5 by EMAN2 and UCSF
Chimera; "Imaris 5.5 file format", imaris.oxinst.com: attributes hold numbers as letters; a level's dataset is padded to
whole chunks, and its group states the image's size. All levels span the box from ExtMin to ExtMax.

Format: "NetCDF classic file format specifications", docs.unidata.ucar.edu. The library reads zeros beyond the end of a
file that is cut short, so sizes are checked first.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from splatgl.data.affine import (
    METRES,
    Coordinate,
    CoordinateGrid,
    axis_kind,
    curved_notes,
    make_lattice,
    metres_in,
    unit_name,
    value_unit_name,
    volume_on_grid,
)
from splatgl.data.arrays import Transposed
from splatgl.data.times import Times, seconds_in
from splatgl.data.volume import Lengths, Volume
from splatgl.errors import InputError, MissingOption, expected, import_extra
from splatgl.readers import vtk_files
from splatgl.readers.channels import (
    COLOR_NOTE,
    MAGNITUDE_NOTE,
    MOST_CHANNELS,
    Channel,
    ChannelSet,
    hex_color,
    is_color_rule,
    magnitudes,
    mark_microscope,
    parse_window,
    split_components,
)
from splatgl.readers.chunked import CF_NUMBERS, Packing
from splatgl.readers.common import array_fields, convert_words, decoder_errors, grid_shape, parse_number, require_bytes
from splatgl.readers.hdf5_files import (
    MOST_VALUES,
    attribute_numbers,
    attribute_text,
    attribute_texts,
    dimension_scales,
    find_datasets,
    find_node,
    has_numbers,
    open_hdf5,
    probe,
    read_samples,
)
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


# --- layouts ----------------------------------------------------------------------------------------------------------


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
