"""DataArrays of xarray: dimensions by name, the grid from evenly spaced coordinates, units from their attributes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from splatgl.data.arrays.parts import Turned
from splatgl.data.arrays.plain import checked
from splatgl.data.readers.even import Coordinate, kind_of, lattice
from splatgl.data.readers.grid import axes_of, stated, triple
from splatgl.data.volume import Volume
from splatgl.errors import expected

if TYPE_CHECKING:
    from splatgl.data.arrays import ArrayOptions


def of_xarray(x: Any, options: ArrayOptions) -> Volume:
    """The volume of a DataArray, or of one variable of a Dataset, which `array` names."""
    array = _variable(x, options).squeeze(drop=True) if len(x.dims) > 3 else _variable(x, options)
    if array.ndim > 3:
        extra = next((name for name in array.dims if _axis(array, name) not in tuple("xyz")), array.dims[0])
        fix = f"pick one by x.isel({extra}=0)"
        raise expected("DataArray", "3 dimensions", f"{array.ndim} ({', '.join(map(str, array.dims))})", fix)
    checked(array, "DataArray")
    axes = _order([_axis(array, name) for name in array.dims])
    names = [array.dims[axis] for axis in axes]
    # 1. samples: views in memory and of dask; what is still in a file is read in parts
    if getattr(array.variable, "_in_memory", False) or array.chunks is not None:
        samples = array.transpose(*names).data
        samples = samples if array.chunks is not None else checked(samples, "DataArray")
    else:
        samples = Turned(array, axes)
    # 2. the grid
    grid = lattice([_coordinate(array, name, options) for name in names], even=options.spacing is not None)
    spacing, direction = axes_of(grid.matrix, "coordinates")
    title = str(array.name or array.attrs.get("long_name", ""))
    unit = stated(array.attrs.get("units"))
    return Volume(
        grid.resampled(samples),
        spacing,
        triple(grid.origin, "coordinates"),
        direction,
        grid.unit,
        title,
        value_unit=unit,
        notes=grid.notes,
    )


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


def _axis(array: Any, name: Any) -> str:
    return kind_of(str(name), array.coords[name].attrs if name in array.coords else {})


def _order(kinds: list[str]) -> list[int]:
    """For z, y, x, the dimension that it is; those of unknown or doubtful kinds fill the rest in order."""
    sure = {axis: kinds.index(axis) for axis in "zyx" if kinds.count(axis) == 1}
    rest = iter(i for i in range(len(kinds)) if i not in sure.values())
    return [sure[axis] if axis in sure else next(rest) for axis in "zyx"]


def _coordinate(array: Any, name: Any, options: ArrayOptions) -> Coordinate:
    """A dimension, with its places if it has a coordinate."""
    is_known = name in array.coords and (options.spacing is None or array.coords[name].dtype.kind in "uif")
    if not is_known:
        return Coordinate(str(name), int(array.sizes[name]))
    coordinate = array.coords[name]
    values = np.asarray(coordinate.values)
    if values.dtype.kind not in "uif":
        raise expected(f"coordinate {name}", "numbers", f"type {values.dtype}", "give spacing=(x, y, z)")
    return Coordinate.of(str(name), values.astype(np.float64), coordinate.attrs)
