"""Coordinates, packing and names in Zarr stores of xarray, by the conventions of CF."""

from __future__ import annotations

import base64
import struct
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from splatgl.data.affine import Coordinate, Lattice, axis_kind, curved_notes, make_lattice
from splatgl.readers.chunked import CF_NUMBERS, Packing

# most coordinates that are read along a dimension, and most bytes of one that is text
MOST_COORDINATES, MOST_TEXT = 2**20, 2**10


def dimension_names(node: Any) -> list[str]:
    """Names of an array's dimensions, "" for an unnamed one; [] if the array states none."""
    stated = getattr(node.metadata, "dimension_names", None) or node.attrs.asdict().get("_ARRAY_DIMENSIONS") or []
    names = [str(name or "") for name in stated]
    return names if len(names) == len(node.shape) else []


def read_lattice(group: Any, node: Any, names: Sequence[str], even: bool) -> Lattice:
    """The grid by the coordinates along z, y and x; even: whether their places do not count."""
    axes = _read_coordinates(group, node, names)
    grid = make_lattice(axes, even=even)
    stated = [owner.attrs.asdict().get("coordinates") for owner in (node, group) if owner is not None]
    about: dict[str, dict[str, Any]] = {name: {} for name in str(next(filter(None, stated), "")).split()}
    is_placed = even or all(axis.places is not None for axis in axes[1:])
    return replace(grid, notes=(*grid.notes, *curved_notes(about, is_placed)))


def _read_coordinates(group: Any, node: Any, names: Sequence[str]) -> list[Coordinate]:
    """Coordinates along z, y and x, from arrays with the dimensions' names (xarray, CF)."""
    dimensions = dimension_names(node)
    coordinates = []
    for name in ("z", "y", "x"):
        axis = names.index(name)
        scale = _find_scale(group, dimensions[axis], node.shape[axis]) if dimensions else None
        if scale is None:
            coordinates.append(Coordinate(dimensions[axis] if dimensions else name, node.shape[axis]))
        else:
            packing = read_packing(scale)
            places = np.asarray(scale[:] if packing is None else packing.values(scale[:]), np.float64)
            coordinates.append(Coordinate.of(dimensions[axis], places, scale.attrs.asdict()))
    return coordinates


def _find_scale(group: Any, name: str, size: int) -> Any:
    """The array of a dimension's coordinates, None without one."""
    node: Any = group.get(name) if group is not None and name else None
    is_scale = getattr(node, "shape", None) == (size,) and node.dtype.kind in "uif" and size <= MOST_COORDINATES
    return node if is_scale else None


def read_packing(node: Any) -> Packing | None:
    """The packing in an array's CF attributes, as xarray writes them, or None; format 2 has a fill value instead."""
    attributes = node.attrs.asdict()
    stated = {name: _parse_numbers(attributes.get(name)) for name in CF_NUMBERS}
    if stated["_FillValue"] is None and dimension_names(node) and node.metadata.zarr_format == 2 and node.fill_value:
        # zarr itself fills with 0
        stated["_FillValue"] = _parse_numbers(node.fill_value)
    return Packing.of(stated, node.dtype, attributes.get("_Unsigned"))


def _parse_numbers(value: Any) -> np.ndarray | None:
    """Numbers, or one coded as base64 of eight bytes, as xarray writes floats in format 3; else None."""
    if isinstance(value, str):
        try:
            return np.array(struct.unpack("<d", base64.b64decode(value, validate=True)))
        except (ValueError, struct.error):
            return None
    numbers = np.asarray(value).ravel()
    return numbers if numbers.dtype.kind in "uif" else None


def dimension_kind(group: Any, name: str, size: int) -> str:
    """z, y, x, t or c, by a dimension's coordinates or name; else its name."""
    scale = _find_scale(group, name, size)
    kind = axis_kind(name, {} if scale is None else scale.attrs.asdict())
    return {"time": "t"}.get(kind, kind or name.lower() or "?")


def channel_names(group: Any, node: Any, names: Sequence[str], count: int) -> list[dict[str, str]]:
    """Names of channels in an array of text with the dimension's name, as xarray writes them; [] without them."""
    dimensions = [name for name, kind in zip(dimension_names(node), names, strict=False) if kind not in tuple("zyxt")]
    texts: Any = group.get(dimensions[0]) if group is not None and len(dimensions) == 1 else None
    is_text = (
        getattr(texts, "shape", None) == (count,) and texts.dtype.kind in "US" and texts.dtype.itemsize <= MOST_TEXT
    )
    return [{"label": str(text)} for text in texts[:]] if is_text else []
