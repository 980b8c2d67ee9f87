"""HDF5 and NetCDF-4: one dataset of the file as a volume.

The last three axes are z, y, x unless labels of the dimensions, ilastik's "axistags" or names of dimension scales say
otherwise. Spacing comes from dimension scales, else from attributes; none is guessed. NetCDF's packed and missing
values are unpacked (CF conventions 1.11, sections 2.5.1 and 8.1).
"""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from splatgl.data.affine import METRES, Coordinate, Lattice, axes_of, kind_of, lattice, stated, triple, unit_name
from splatgl.data.readers.files import library, selection
from splatgl.data.readers.hdf5_file import (
    MOST_VALUES,
    Packed,
    datasets,
    is_numbers,
    node_at,
    numbers_of,
    open_hdf5,
    samples_of,
    scales_of,
    text_of,
    texts_of,
)
from splatgl.data.readers.options import LoadOptions
from splatgl.data.readers.several import MOST_CHANNELS, SECONDS, Channel, Several
from splatgl.data.volume import Volume
from splatgl.errors import choice, expected

_SPACINGS = (
    *("element_size_um", "spacing", "Spacing", "voxel_size", "voxelSize", "VoxelSize", "voxelsize"),
    *("pixel_size", "pixelSize", "resolution", "Resolution"),
)
"""Attributes with the steps along a dataset's axes, or one for all, in the order of its axes; the first one counts."""

_FEW = 16
"""Most entries of a first or last axis without a label that is taken for channels."""


@dataclass(frozen=True)
class _Axes:
    """Numbers of the axes z, y, x of a dataset, and of the others that have several entries."""

    space: tuple[int, int, int]
    others: tuple[int, ...]


def read(path: Path, options: LoadOptions) -> Volume:
    """The volume of a dataset: `array` names it (/a/b), else it is the only one that may be a volume.

    `channel` picks an entry along a fourth axis, `time` one along an axis of time. Samples of over WHOLE bytes are read
    in parts.
    """
    file = open_hdf5(path)
    # all that a file says is untrusted: any failure is attributed to it
    with library("HDF5"):
        dataset = _chosen(file, options)
        kinds = _kinds(dataset)
        axes = _axes(dataset.shape, kinds)
        if axes is None:
            this = "three axes, and a first or last one of few channels"
            raise expected(dataset.name, this, _size(dataset.shape), "label its dimensions, or save one part of it")
        time = next((axis for axis in axes.others if kinds[axis] == "time"), None)
        told = _several(path, dataset, axes, time, options)
        grid = _grid(path, dataset, axes, options)
        spacing, direction = axes_of(grid.matrix, "spacing")

        def one(channel: int | None) -> Volume:
            extra: dict[int, tuple[str, int | None]] = {
                axis: ("channel", (channel if told.channels else options.channel_number) if axis in axes.others else 0)
                for axis in range(len(dataset.shape))
                if axis not in axes.space
            }
            if time is not None:
                extra[time] = ("time", options.time or 0)
            index = selection(dataset.shape, extra)
            samples: Any = samples_of(path, dataset, index, options.anywhere, _packed(dataset))
            return Volume(
                grid.resampled(_turned(samples, axes)),
                spacing,
                triple(grid.origin, "origin"),
                direction,
                grid.unit,
                value_unit=_value_unit(dataset),
                notes=grid.notes,
            )

        # the array is a dataset, not a time point
        return told.volume(replace(options, array=None), one)


def _several(path: Path, dataset: Any, axes: _Axes, time: int | None, options: LoadOptions) -> Several:
    """The time points, and the channels by their numbers, if one axis beside them is left."""
    others = [axis for axis in axes.others if axis != time]
    count = dataset.shape[others[0]] if len(others) == 1 else 1
    channels = tuple(Channel(str(n)) for n in range(count)) if 1 < count <= MOST_CHANNELS else ()
    components = 1 if count == 1 and not others else MOST_CHANNELS**2
    if time is None:
        return Several(channels, components=components)
    step = _time_step(path, dataset, time, options)
    return Several(channels, False, dataset.shape[time], step, components)


def contents(path: Path) -> list[str]:
    """A line per dataset: name, type and shape; those that may be volumes begin with a star."""
    with library("HDF5"), open_hdf5(path) as file:
        found = datasets(file)
        return [f"{'*' if _may_be(node) else ' '} {name}   {_told(node)}" for name, node in found.items()]


def _told(node: Any) -> str:
    return f"{node.dtype if is_numbers(node) else 'no numbers'} {_size(node.shape or ())}"


def _size(shape: tuple[int, ...]) -> str:
    return "×".join(map(str, shape)) or "one value"


def _chosen(file: Any, options: LoadOptions) -> Any:
    """The dataset that is asked for, else the only one that may be a volume."""
    if options.array is not None:
        node = node_at(file, str(options.array), options.anywhere)
        if not hasattr(node, "shape") or not is_numbers(node):
            every = datasets(file)
            names = [name for name, each in every.items() if _may_be(each)] or list(every)
            got = f"the group {options.array!r}" if hasattr(node, "keys") else repr(options.array)
            raise expected("array", f"a dataset of real numbers: {', '.join(names) or 'the file has no dataset'}", got)
        return node
    found = datasets(file)
    volumes = [node for node in found.values() if _may_be(node)]
    if len(volumes) != 1:
        listed = ", ".join(f"{name} {_size(node.shape or ())}" for name, node in found.items()) or "nothing"
        told = f"{len(volumes) or 'none'} in {listed}"
        error = expected("datasets", "one volume", told, "pick one with array=/NAME, or FILE:/NAME")
        raise choice(error, "array", []) if volumes else error
    return volumes[0]


def _may_be(node: Any) -> bool:
    """Whether a dataset is plausibly a volume: of real numbers, with three axes of space that are longer than one."""
    if not is_numbers(node):
        return False
    axes = _axes(node.shape, _kinds(node))
    return axes is not None and min(node.shape[axis] for axis in axes.space) > 1


def _kinds(dataset: Any) -> list[str]:
    """What each axis is, see `kind_of`: by labels, by "axistags", or by dimension scales."""
    scales = scales_of(dataset) or [None] * len(dataset.shape)
    names = [text.lower() for text in texts_of(dataset, "DIMENSION_LABELS")]
    if not any(names) and "axistags" in dataset.attrs:
        try:
            names = [str(axis["key"]).lower() for axis in json.loads(text_of(dataset, "axistags"))["axes"]]
        except (ValueError, KeyError, TypeError, RecursionError):
            names = []
    if not any(names):
        names = ["" if scale is None else _name(scale) for scale in scales]
    if len(names) != len(dataset.shape):
        return [""] * len(dataset.shape)
    return [
        kind_of(name, {} if scale is None else _attributes(scale)) for name, scale in zip(names, scales, strict=True)
    ]


def _name(node: Any) -> str:
    return str(node.name).rsplit("/", 1)[-1]


def _attributes(scale: Any) -> dict[str, str]:
    """What a dimension scale tells of its axis."""
    return {name: text_of(scale, name) for name in ("units", "unit", "positive", "standard_name", "axis")}


def _axes(shape: tuple[int, ...], kinds: list[str]) -> _Axes | None:
    """The axes of space: those that are told, else three of them without those of one entry, and without a short first
    or last one of four; None if they are not clear.
    """
    if len(shape) < 3 or min(shape) < 1:
        return None
    long = [axis for axis, size in enumerate(shape) if size > 1]
    named = {kind: kinds.index(kind) for kind in "xyz" if kinds.count(kind) == 1}
    if len(named) == 3:
        z, y, x = named["z"], named["y"], named["x"]
        return _Axes((z, y, x), tuple(axis for axis in long if axis not in (z, y, x)))
    times = [axis for axis in long if kinds[axis] in ("time", "c")]
    free = [axis for axis in range(len(shape)) if axis not in times]
    if len(free) > 3:
        free = [axis for axis in free if axis in long]
    if len(free) == 4 and min(shape[free[0]], shape[free[3]]) <= _FEW:
        free = free[1:] if shape[free[0]] <= shape[free[3]] else free[:3]
    if len(free) != 3:
        return None
    z, y, x = free
    return _Axes((z, y, x), tuple(axis for axis in long if axis not in free))


def _turned(samples: Any, axes: _Axes) -> Any:
    """Samples in the order z, y, x."""
    order = np.argsort(axes.space).tolist()
    if order == [0, 1, 2]:
        return samples
    if not isinstance(samples, np.ndarray):
        raise expected("axes", "z, y, x in this order where the dataset is read in parts", "another", "transpose it")
    return samples.transpose(np.argsort(order).tolist())


def _packed(dataset: Any) -> Packed | None:
    """How NetCDF packs the numbers, None if they are values."""
    told = {name: numbers_of(dataset, name) for name in ("scale_factor", "add_offset", "_FillValue", "missing_value")}
    scale, offset, *fills = (None if found is None or found.size != 1 else float(found[0]) for found in told.values())
    fill = next((value for value in fills if value is not None and np.isfinite(value)), None)
    if scale is None and offset is None and fill is None:
        return None
    return Packed(1.0 if scale is None else scale, 0.0 if offset is None else offset, fill)


def _grid(path: Path, dataset: Any, axes: _Axes, options: LoadOptions) -> Lattice:
    """The grid of the axes of space."""
    scales = _coordinates(dataset, axes)
    sizes = [dataset.shape[axis] for axis in axes.space]
    plain = [Coordinate(name, size) for name, size in zip("zyx", sizes, strict=True)]
    for name in () if all(scale is not None for scale in scales) else _SPACINGS:
        given = _steps(numbers_of(dataset, name), len(dataset.shape), axes)
        if given is not None:
            unit = "um" if name == "element_size_um" else _unit(dataset)
            return replace(lattice(plain), matrix=np.diag(given[::-1]), unit=unit)
    told = [
        known if scale is None else Coordinate.of(_name(scale), _places(path, scale, options), _attributes(scale))
        for known, scale in zip(plain, scales, strict=True)
    ]
    grid = lattice(told, dataset.name, even=options.spacing is not None)
    named = text_of(dataset, "coordinates").split()
    # coordinates along two axes at once, of curved grids
    curved = [name for name in named if kind_of(name, {}) in ("x", "y")] if None in scales[1:] else []
    note = f"x and y are numbers of samples: coordinates in two dimensions ({', '.join(curved[:4])}) are not used"
    return replace(grid, notes=(*grid.notes, *[note] * bool(curved)))


def _places(path: Path, scale: Any, options: LoadOptions) -> np.ndarray:
    return np.asarray(samples_of(path, scale, [slice(None)], options.anywhere)[:], np.float64)


def _time_step(path: Path, dataset: Any, axis: int, options: LoadOptions) -> float | None:
    """Seconds between two time points, if the scale of their axis says so: CF's "hours since …" too."""
    scales = scales_of(dataset)
    scale = scales[axis] if axis < len(scales) else None
    if not _is_scale(scale, dataset.shape[axis]):
        return None
    unit = SECONDS.get((text_of(scale, "units") or text_of(scale, "unit")).split(" ")[0].lower())
    places = _places(path, scale, options)
    steps = np.diff(places)
    even = len(steps) and np.isfinite(places).all() and np.ptp(steps) <= 1e-3 * abs(steps[0])
    return float(steps[0]) * unit if unit and even and steps[0] > 0 else None


def _unit(node: Any) -> str:
    """The unit of length that is stated, "" for none; NetCDF's is mostly that of the values."""
    found = {unit_name(text_of(node, name)) for name in ("unit", "units")} & set(METRES)
    return found.pop() if len(found) == 1 else ""


def _value_unit(dataset: Any) -> str:
    """The unit of values; a length may as well be that of the grid."""
    told = text_of(dataset, "units") or text_of(dataset, "unit")
    return "" if unit_name(told) in METRES else stated(told)


def _coordinates(dataset: Any, axes: _Axes) -> list[Any]:
    """The dimension scales of the axes of space, None for one without a number per sample."""
    found = scales_of(dataset)
    return [
        found[axis] if axis < len(found) and _is_scale(found[axis], dataset.shape[axis]) else None
        for axis in axes.space
    ]


def _is_scale(scale: Any, size: int) -> bool:
    # of a dimension without coordinates NetCDF writes a scale that says so
    none = "This is a netCDF dimension but not"
    plain = scale is not None and is_numbers(scale) and scale.shape == (size,) and size <= MOST_VALUES
    return plain and not text_of(scale, "NAME").startswith(none)


def _steps(numbers: np.ndarray | None, count: int, axes: _Axes) -> list[float] | None:
    """Steps along z, y, x out of one number, or one per axis of space or of the dataset."""
    if numbers is None or not np.isfinite(numbers).all():
        return None
    if numbers.size == 1:
        numbers = np.repeat(numbers, 3)
    if numbers.size == count > 3:
        numbers = numbers[list(axes.space)]
    return numbers.tolist() if numbers.size == 3 and (numbers > 0).all() else None
