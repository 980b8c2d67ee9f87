"""`volume_of`: volumes from arrays and images of other libraries; samples are views, or stay on disk, if possible."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import fields, replace
from importlib import import_module
from importlib.util import find_spec
from pathlib import PurePath
from typing import Any

import numpy as np

from splatgl.data.affine import (
    Coordinate,
    axis_kind,
    curved_notes,
    make_lattice,
    unit_name,
    value_unit_name,
    volume_on_grid,
)
from splatgl.data.volume import ArrayOptions, Hints, Volume, triple
from splatgl.errors import InputError, expected, list_names, one_line
from splatgl.options import reject_unknown

# root module of a type, or of one of its bases → its function; others are arrays
_SOURCES = {
    "h5py": "splatgl.readers.hdf5_files.of_dataset",
    "xarray": "splatgl.data.arrays.of_xarray",
    "SimpleITK": "splatgl.data.arrays.of_simpleitk",
    "nibabel": "splatgl.data.arrays.of_nibabel",
    "napari": "splatgl.data.arrays.of_napari",
    "vtkmodules": "splatgl.integrations.vtk.image_data.volume_from_vtk",
}


def volume_of(x: Any, **options: Any) -> Volume:
    """The volume in `x`, with the options of `ArrayOptions`; see `Volume.of`."""
    names = [field.name for field in fields(ArrayOptions)]
    reject_unknown("options", sorted(options), names, f"some of {', '.join(names)}")
    array_options = ArrayOptions(**options)
    if isinstance(x, Volume):
        array_options.no_array("a volume")
    volume = x if isinstance(x, Volume) else _find_converter(x)(x, array_options)
    # where the array does not know its spacing, its levels do not either
    levels = {"coarser": ()} if array_options.spacing is not None or array_options.origin is not None else {}
    on_grid = {name: value for name, value in array_options.given.items() if name != "name"} | levels
    channels = tuple(replace(channel, **on_grid) for channel in volume.channels)
    volume = replace(volume, **array_options.given, **levels, channels=channels)
    if array_options.values not in (None, "labels", "amounts"):
        raise expected("values", "labels or amounts", repr(array_options.values))
    return volume if array_options.values is None else volume.of_values(array_options.values)


def _find_converter(x: Any) -> Any:
    for base in type(x).__mro__:
        place = _SOURCES.get(base.__module__.partition(".")[0])
        if place is not None:
            module, _, name = place.rpartition(".")
            return getattr(import_module(module), name)
    return of_array


def of_xarray(x: Any, options: ArrayOptions) -> Volume:
    """The volume of a DataArray, or of the variable `array` of a Dataset."""
    array = _variable(x, options).squeeze(drop=True) if len(x.dims) > 3 else _variable(x, options)
    if array.ndim > 3:
        extra = next((name for name in array.dims if _dimension_kind(array, name) not in tuple("xyz")), array.dims[0])
        fix = f"pick one by x.isel({extra}=0)"
        raise expected("DataArray", "3 dimensions", f"{array.ndim} ({', '.join(map(str, array.dims))})", fix)
    check_samples(array, "DataArray")
    axes = _order_axes([_dimension_kind(array, name) for name in array.dims])
    names = [array.dims[axis] for axis in axes]
    # 1. samples: views in memory and of dask; arrays in a file are read in parts
    if getattr(array.variable, "_in_memory", False) or array.chunks is not None:
        samples = array.transpose(*names).data
        samples = samples if array.chunks is not None else check_samples(samples, "DataArray")
    else:
        samples = Transposed(array, axes)
    # 2. the grid
    grid = make_lattice([_coordinate(array, name, options) for name in names], even=options.spacing is not None)
    flat = {str(name): entry.attrs for name, entry in array.coords.items() if entry.ndim > 1}
    is_placed = options.spacing is not None or all(name in array.coords for name in names[1:])
    grid = replace(grid, notes=(*grid.notes, *curved_notes(flat, is_placed)))
    title, unit = str(array.attrs.get("long_name") or ""), value_unit_name(array.attrs.get("units"))
    return grid.volume(samples, "coordinates", name=str(array.name or title), quantity=title, value_unit=unit)


def time_points_of(x: Any) -> list[Any]:
    """The time points of an array or Dataset of xarray with one dimension of time; else the object alone."""
    if not hasattr(x, "isel") or not hasattr(x, "dims"):
        return [x]
    times = [name for name in x.dims if _dimension_kind(x, name) == "time"]
    return [x.isel({times[0]: number}) for number in range(x.sizes[times[0]])] if len(times) == 1 else [x]


def _variable(x: Any, options: ArrayOptions) -> Any:
    """The DataArray: x itself, or one of a Dataset."""
    if not hasattr(x, "data_vars"):
        if not hasattr(x, "coords") or not hasattr(x, "dims") or not hasattr(x, "dtype"):
            raise expected("array", "a DataArray or Dataset of xarray", f"a {type(x).__name__}")
        options.no_array("a DataArray")
        return x
    names = [str(name) for name in x.data_vars]
    if options.array is None and len(names) == 1:
        return x[names[0]]
    if options.array not in names:
        raise expected("array", f"one of {', '.join(names)}", repr(options.array), "name one: array=…")
    return x[options.array]


def _dimension_kind(array: Any, name: Any) -> str:
    return axis_kind(str(name), array.coords[name].attrs if name in array.coords else {})


def _order_axes(kinds: list[str]) -> list[int]:
    """The numbers of the dimensions z, y, x; dimensions of unknown or doubtful kinds fill the rest in order."""
    sure = {axis: kinds.index(axis) for axis in "zyx" if kinds.count(axis) == 1}
    rest = iter(i for i in range(len(kinds)) if i not in sure.values())
    return [sure[axis] if axis in sure else next(rest) for axis in "zyx"]


def _coordinate(array: Any, name: Any, options: ArrayOptions) -> Coordinate:
    """A dimension, with its coordinates if it has some."""
    is_known = name in array.coords and (options.spacing is None or array.coords[name].dtype.kind in "uif")
    if not is_known:
        return Coordinate(str(name), int(array.sizes[name]))
    coordinate = array.coords[name]
    values = np.asarray(coordinate.values)
    if values.dtype.kind not in "uif":
        raise expected(f"coordinate {name}", "numbers", f"type {values.dtype}", "give spacing=(x, y, z)")
    return Coordinate.of(str(name), values.astype(np.float64), coordinate.attrs)


# colour maps that need no library, and those that napari shares with cmap and matplotlib
BUILTIN_MAPS = ("gray", "viridis")
SHARED_MAPS = ("magma", "inferno", "plasma", "turbo", "twilight", "twilight_shifted", "hsv")


def of_napari(x: Any, options: ArrayOptions) -> Volume:
    """The volume of a napari layer: world (x, y, z) is napari's (z, y, x); `array` picks along a fourth axis.

    Multiscale data keep their levels. Contrast limits become the window; the colour map is named if it is known.
    """
    kind = getattr(x, "kind", type(x).__name__)
    if not hasattr(x, "data_to_world") or not hasattr(x, "data") or kind not in ("Image", "Labels"):
        raise expected("layer", "an Image or Labels layer of napari", f"a {kind}")
    if getattr(x, "rgb", False):
        raise expected("layer", "one number per voxel", "colours (rgb)", "pick a channel: x.data[..., 0]")
    levels = list(x.data) if x.multiscale else [x.data]
    finest = tuple(levels[0].shape)
    lead, volumes = _lead_index(finest, options), []
    look: dict[str, Any] = {"labels": ()} if kind == "Labels" else {"hints": _hints(x)}
    for data in levels:
        if lead:
            # zarr's and HDF5's arrays would be read as a whole
            is_lazy = isinstance(data, np.ndarray) or type(data).__module__.partition(".")[0] == "dask"
            data = data[lead] if is_lazy else Transposed(data, lead=lead)
        volumes.append(volume_of_level(x, lead, finest[-3:], data, **look))
    return replace(volumes[0], coarser=tuple(volumes[1:]))


def volume_of_level(layer: Any, lead: Sequence[int], finest: Sequence[int], samples: Any, **more: Any) -> Volume:
    """The volume of a level of a napari layer, placed as the layer is. lead: index along the axes before z, y, x;
    finest: shape of the first level, whose box all levels fill; more: fields of `Volume`.
    """
    samples = check_samples(samples, "layer")
    # napari's world coordinates of the first voxel and of its neighbours
    corners = np.vstack([np.zeros(3), np.eye(3)])
    world = np.array([np.asarray(layer.data_to_world((*lead, *corner)))[-3:] for corner in corners])
    origin, matrix = world[0][::-1], (world[1:] - world[0]).T[::-1, ::-1]
    scaled = matrix * (np.array(finest) / samples.shape)[::-1]
    units = {unit_name(str(unit)) for unit in tuple(getattr(layer, "units", None) or ())[-3:]}
    start, unit = origin + (scaled - matrix) @ np.full(3, 0.5), units.pop() if len(units) == 1 else ""
    return volume_on_grid(samples, scaled, start, "transform", unit=unit, name=layer.name, **more)


def _lead_index(shape: tuple[int, ...], options: ArrayOptions) -> tuple[int, ...]:
    """The index along the axes before z, y, x."""
    count = len(shape) - 3
    if count <= 0:
        options.no_array("the layer")
        return ()
    number = options.array
    if count == 1 and isinstance(number, int) and 0 <= number < shape[0]:
        return (number,)
    if number is None and all(size == 1 for size in shape[:count]):
        return (0,) * count
    what = "channel or time" if shape[0] <= CHANNELS else "time"
    fix = f"pick a {what}: array=0 … array={shape[0] - 1}" if count == 1 else "take a volume of its data"
    raise expected("layer", "3 axes [z, y, x]", f"{len(shape)} ({'×'.join(map(str, shape))})", fix)


def _hints(x: Any) -> Hints:
    """The window and colour map of an image layer."""
    low, high = (float(limit) for limit in x.contrast_limits)
    name = str(x.colormap.name)
    known = name in BUILTIN_MAPS or (name in SHARED_MAPS and any(map(find_spec, ("cmap", "matplotlib"))))
    return Hints(window=(low, high) if low < high else None, colormap=name if known else None)


def of_simpleitk(x: Any, options: ArrayOptions) -> Volume:
    """The volume of a SimpleITK image, a read-only view of its memory: world in LPS, mm."""
    if not hasattr(x, "GetNumberOfComponentsPerPixel"):
        raise expected("array", "an Image of SimpleITK", f"a {type(x).__name__}", "execute it first")
    import SimpleITK

    options.no_array("an image")
    size, count = x.GetSize(), x.GetNumberOfComponentsPerPixel()
    if len(size) != 3:
        fix = "take a volume of it: x[:, :, :, 0]" if len(size) == 4 else "join planes by SimpleITK.JoinSeries"
        raise expected("image", "3 dimensions", f"{len(size)} ({'×'.join(map(str, size))})", fix)
    if count > 1:
        fix = f"pick one of 0 … {count - 1} by SimpleITK.VectorIndexSelectionCast(x, 0)"
        raise expected("image", "one number per voxel", f"{count} channels", fix)
    samples = check_samples(np.asarray(_OwnedView(SimpleITK.GetArrayViewFromImage(x), x)), "image")
    direction = np.array(x.GetDirection()).reshape(3, 3)
    spacing, origin = triple(x.GetSpacing(), "spacing"), triple(x.GetOrigin(), "origin")
    return Volume(samples, spacing, origin, direction, "mm", frame="LPS")


def of_nibabel(x: Any, options: ArrayOptions) -> Volume:
    """The volume of a nibabel image, as `load` reads its file; `array` picks the time point of a 4-D one."""
    if not hasattr(x, "dataobj") or not hasattr(x, "affine"):
        raise expected("array", "a volume image of nibabel", f"a {type(x).__name__}")
    from splatgl.readers.nifti import volume_of_image
    from splatgl.readers.options import LoadOptions

    if "sform_code" in x.header:
        return volume_of_image(x, LoadOptions(array=options.array))
    # MGH and others, in mm: nibabel gives their affines to RAS
    options.no_array("an image")
    if len(x.shape) != 3:
        fix = "pick one by x.slicer[..., 0]"
        raise expected("image", "3 axes [x, y, z]", f"{len(x.shape)} ({'×'.join(map(str, x.shape))})", fix)
    data = x.dataobj
    samples = data.T if isinstance(data, np.ndarray) else Transposed(data, (2, 1, 0))
    samples = check_samples(samples, "image")
    return volume_on_grid(samples, x.affine[:3, :3], x.affine[:3, 3], "affine", unit="mm", frame="RAS")


Key = int | slice | tuple[int | slice, ...]


class Transposed:
    """An array's axes in another order, read in parts: slices of it are numpy arrays.

    axes: the axis of `array` for each axis here; None for an axis of one entry that the array lacks. lead: the index
    along the array's first axes, from behind which `axes` count.
    """

    def __init__(self, array: Any, axes: Sequence[int | None] = (0, 1, 2), lead: tuple[int, ...] = ()) -> None:
        self.array, self.axes, self.lead = array, tuple(axes), lead
        self.shape = self.sizes(array.shape)
        self.dtype = np.dtype(array.dtype)

    def sizes(self, sizes: Sequence[int]) -> tuple[int, ...]:
        """Sizes along the axes here, out of those along the array's axes."""
        return tuple(1 if axis is None else int(sizes[len(self.lead) + axis]) for axis in self.axes)

    def source(self, index: Sequence[Any]) -> tuple[Any, ...]:
        """The index of the array for an index along all axes here."""
        entries = {axis: entry for axis, entry in zip(self.axes, index, strict=True) if axis is not None}
        return (*self.lead, *(entries[axis] for axis in range(len(entries))))

    def __getitem__(self, key: Key) -> np.ndarray:
        index = key if isinstance(key, tuple) else (key,)
        index += (slice(None),) * (len(self.shape) - len(index))
        free = [axis for axis, entry in zip(self.axes, index, strict=True) if isinstance(entry, slice)]
        there = [axis for axis in free if axis is not None]
        part = np.asarray(self.array[self.source(index)]).transpose([sorted(there).index(axis) for axis in there])
        return np.expand_dims(part, free.index(None)) if None in free else part


class ConvertedArray:
    """An array of a shape and type that is read in parts, each of which a function changes."""

    def __init__(
        self, array: Any, shape: Sequence[int], dtype: np.dtype, change: Callable[[np.ndarray], np.ndarray]
    ) -> None:
        self.array, self.shape, self.dtype, self.change = array, tuple(shape), dtype, change

    def __getitem__(self, key: Any) -> np.ndarray:
        return self.change(np.asarray(self.array[key]))


class ArrayWindow:
    """A box of an array that is read in parts, as an array of its own."""

    def __init__(self, array: Any, box: tuple[slice, ...]) -> None:
        keys = (*box, *[slice(None)] * (len(array.shape) - len(box)))
        self.array, self.dtype = array, np.dtype(array.dtype)
        self.ranges = [range(size)[at] for size, at in zip(array.shape, keys, strict=True)]
        self.shape = tuple(map(len, self.ranges))

    @classmethod
    def of(cls, array: Any, box: tuple[slice, ...]) -> Any:
        """The box of an array; a view of one in memory."""
        return array[box] if isinstance(array, np.ndarray) else cls(array, box)

    def __getitem__(self, key: Any) -> np.ndarray:
        keys = key if isinstance(key, tuple) else (key,)
        keys += (slice(None),) * (len(self.shape) - len(keys))
        places = [steps[at] for steps, at in zip(self.ranges, keys, strict=True)]
        index = (slice(at.start, at.stop, at.step) if isinstance(at, range) else at for at in places)
        return np.asarray(self.array[tuple(index)])


class _OwnedView:
    """An array's memory, whose arrays keep its `owner` alive."""

    def __init__(self, view: np.ndarray, owner: Any) -> None:
        self.__array_interface__ = view.__array_interface__
        self.held = (view, owner)


# a first or last axis of at most so many entries is taken for channels
CHANNELS = 8


def of_array(x: Any, options: ArrayOptions) -> Volume:
    """The volume of an array [z, y, x] on a grid of unit spacing."""
    options.no_array("an array")
    # the last part of the path in a file
    is_stored = type(x).__module__.partition(".")[0] in ("h5py", "zarr") and isinstance(x.name, str)
    return Volume(check_samples(x), name=x.name.strip("/").rpartition("/")[2] if is_stored else "")


def check_samples(x: Any, what: str = "array") -> Any:
    """`x` as 3-D samples of real numbers: itself or a view; lists are copied. Raises InputError for anything else."""
    samples = _fill_masked(x) if isinstance(x, np.ma.MaskedArray) else _as_array(x, what)
    if samples.dtype.kind not in "buif":
        fix = "take abs(x), x.real or x.imag" if samples.dtype.kind == "c" else "convert it by x.astype(…)"
        raise expected(what, "real numbers", f"samples of type {samples.dtype}", fix)
    check_axes(samples.shape, what)
    if not all(isinstance(size, int | np.integer) for size in samples.shape):
        raise expected(what, "known sizes", samples.shape, "call x.compute_chunk_sizes()")
    return samples


def check_axes(shape: tuple[int, ...], what: str = "array") -> None:
    """Raises InputError unless there are three axes; the message says how to pick or stack."""
    got, count = "×".join(map(str, shape)) or "a single number", len(shape)
    if count == 3:
        return
    if count == 2:
        raise expected(what, "3 axes [z, y, x]", f"2 ({got})", "stack planes into one array: np.stack(planes)")
    if count == 4:
        # a few entries at one end are channels, at the front they may be points in time, too
        last = shape[-1] <= CHANNELS < shape[0]
        fix = f"pick a channel: x[..., 0] … x[..., {shape[-1] - 1}]" if last else "pick a channel or time: x[0]"
        raise expected(what, "3 axes [z, y, x]", f"4 ({got})", fix)
    raise expected(what, "3 axes [z, y, x]", f"{count} ({got})")


def _as_array(x: Any, what: str) -> Any:
    """`x` if it has a shape, a numpy dtype and slices; other libraries' arrays and lists as numpy arrays."""
    if isinstance(x, str | bytes | PurePath):
        raise expected(what, "an array or image", f"the text {str(x)[:80]!r}", "read a file by sg.load(path)")
    if hasattr(x, "keys"):
        # zarr's and h5py's groups, npz files, dictionaries
        names = list_names(list(x.keys())) or "nothing"
        raise expected(what, "an array", f"a {type(x).__name__} of {names}", "pick one: x[name]")
    try:
        dtype = getattr(x, "dtype", None)
        if isinstance(dtype, np.dtype) and hasattr(x, "shape") and hasattr(x, "__getitem__"):
            return x
        array = np.asarray(x)
    except InputError:
        raise
    except Exception as error:
        got = f"{type(x).__name__} ({one_line(error)})"
        raise expected(what, "an array [z, y, x]", got, "convert it by np.asarray") from error
    if array.dtype == object:
        raise expected(what, "an array [z, y, x]", f"a {type(x).__name__}", "convert it to an array of numbers")
    return array


def _fill_masked(x: Any) -> np.ndarray:
    """A masked array with NaN where it is masked: NaN is not drawn."""
    if not np.ma.is_masked(x) or x.dtype.kind not in "buif":
        return np.asarray(x.data)
    return np.asarray(x.astype(missing_type(x.dtype)).filled(np.nan))


def missing_type(dtype: np.dtype) -> np.dtype:
    """The type of real numbers of a type, and of NaN."""
    return dtype if dtype.kind == "f" else np.dtype(np.float32 if dtype.itemsize < 4 else np.float64)
