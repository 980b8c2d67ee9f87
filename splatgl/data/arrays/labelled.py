"""DataArrays of xarray: dimensions by name, the grid from evenly spaced coordinates, units from their attributes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from splatgl.data.arrays.parts import Turned
from splatgl.data.arrays.plain import checked
from splatgl.data.errors import expected
from splatgl.data.readers.grid import METRES, stated, unit_name
from splatgl.data.volume import Volume

if TYPE_CHECKING:
    from splatgl.data.arrays import ArrayOptions

# names of dimensions, lower case, by axis; others keep their order
NAMES = {
    "x": ("x", "lon", "longitude", "easting", "column", "col"),
    "y": ("y", "lat", "latitude", "northing", "row"),
    "z": ("z", "lev", "level", "depth", "height", "altitude", "elevation", "plane", "slice"),
}
# how far a coordinate may be from even steps, in steps
EVEN = 0.01


def of_xarray(x: Any, options: ArrayOptions) -> Volume:
    """The volume of a DataArray, or of one variable of a Dataset, which `array` names."""
    array = _variable(x, options).squeeze(drop=True) if len(x.dims) > 3 else _variable(x, options)
    if array.ndim > 3:
        extra = next(name for name in array.dims if _axis(name) is None) if _unnamed(array) else array.dims[0]
        fix = f"pick one by x.isel({extra}=0)"
        raise expected("DataArray", "3 dimensions", f"{array.ndim} ({', '.join(map(str, array.dims))})", fix)
    checked(array, "DataArray")
    axes = _order([str(name) for name in array.dims])
    names = [array.dims[axis] for axis in axes]
    # 1. samples: views in memory and of dask; what is still in a file is read in parts
    if getattr(array.variable, "_in_memory", False) or array.chunks is not None:
        samples = array.transpose(*names).data
        samples = samples if array.chunks is not None else checked(samples, "DataArray")
    else:
        samples = Turned(array, axes)
    # 2. the grid: along z, y, x
    steps = [_step(array, name) if options.spacing is None else (0.0, 1.0, "") for name in names]
    factors, unit = _lengths([unit for _, _, unit in steps])
    first = [start * factor for (start, _, _), factor in zip(steps, factors, strict=True)]
    step = [length * factor for (_, length, _), factor in zip(steps, factors, strict=True)]
    sz, sy, sx = (abs(length) for length in step)
    oz, oy, ox = first
    # a descending coordinate is an axis that points backwards
    direction = np.diag(np.sign(step[::-1]))
    name = str(array.name or array.attrs.get("long_name", ""))
    return Volume(
        samples, (sx, sy, sz), (ox, oy, oz), direction, unit, name, value_unit=stated(array.attrs.get("units"))
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


def _axis(name: Any) -> str | None:
    return next((axis for axis, known in NAMES.items() if str(name).lower() in known), None)


def _unnamed(array: Any) -> bool:
    return any(_axis(name) is None for name in array.dims)


def _order(names: list[str]) -> list[int]:
    """For z, y, x, the dimension that it is: by name; those of unknown or doubtful names fill the rest in order."""
    known = [_axis(name) for name in names]
    sure = {axis: known.index(axis) for axis in NAMES if known.count(axis) == 1}
    rest = iter(i for i in range(len(names)) if i not in sure.values())
    return [sure[axis] if axis in sure else next(rest) for axis in ("z", "y", "x")]


def _step(array: Any, name: Any) -> tuple[float, float, str]:
    """First coordinate, step and unit along a dimension; (0, 1, "") without a coordinate."""
    if name not in array.coords:
        return 0.0, 1.0, ""
    coordinate = array.coords[name]
    values = np.asarray(coordinate.values)
    if values.dtype.kind not in "uif":
        fix = "give spacing=(x, y, z)"
        raise expected(f"coordinate {name}", "numbers", f"type {values.dtype}", fix)
    unit = unit_name(str(coordinate.attrs.get("units", "")))
    values = values.astype(np.float64)
    if not np.isfinite(values).all():
        raise expected(f"coordinate {name}", "finite numbers", "others", "give spacing=(x, y, z)")
    count = len(values)
    step = float(values[-1] - values[0]) / max(count - 1, 1) if count > 1 else 1.0
    off = float(np.abs(values - (values[0] + step * np.arange(count))).max())
    if step == 0 or off > EVEN * abs(step):
        gaps = np.diff(values)
        got = f"{gaps.min():g} to {gaps.max():g}"
        low, high = (f"x.{name}[{i}].item()" for i in (0, -1))
        fix = f"resample: x.interp({name}=np.linspace({low}, {high}, {count}))"
        raise expected(f"coordinate {name}", "even steps", got, fix)
    return float(values[0]), step, unit


def _lengths(units: list[str]) -> tuple[list[float], str]:
    """Factors that convert coordinates to one unit of length, and its name; ones where their units are no lengths."""
    told = [unit for unit in units if unit]
    if len(told) == len(units) and all(unit in METRES for unit in told):
        return [METRES[unit] / METRES[told[-1]] if unit != told[-1] else 1.0 for unit in units], told[-1]
    return [1.0] * len(units), told[0] if told and len(set(units)) == 1 else ""
