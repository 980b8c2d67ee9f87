"""Axes, channels and time points of Zarr arrays: OME-Zarr's axes and omero, names of dimensions, or their order."""

from __future__ import annotations

import base64
import re
import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from splatgl.data.affine import Coordinate, kind_of
from splatgl.data.readers.several import MOST_CHANNELS, SECONDS, Channel, Several, rgb_of, window_of
from splatgl.data.volume import Label
from splatgl.errors import expected

MOST_COORDINATES = 2**20
"""Most coordinates along a dimension that are read."""


def by_numbers(name: str) -> list[Any]:
    """A key that sorts names with numbers in them by these: 2 before 10."""
    return [(0, int(part), "") if part.isdigit() else (1, 0, part) for part in re.split(r"(\d+)", name) if part]


def dimensions_of(node: Any) -> list[str]:
    """Names of the dimensions of an array, "" of one without; [] if none are told."""
    told = getattr(node.metadata, "dimension_names", None) or node.attrs.asdict().get("_ARRAY_DIMENSIONS") or []
    names = [str(name or "") for name in told]
    return names if len(names) == len(node.shape) else []


def coordinates_of(group: Any, node: Any, names: Sequence[str]) -> list[Coordinate]:
    """Those along z, y and x: of the arrays that are called as the dimensions are, beside the array (xarray, CF)."""
    dimensions = dimensions_of(node)
    found = []
    for name in ("z", "y", "x"):
        axis = names.index(name)
        scale = _scale(group, dimensions[axis], node.shape[axis]) if dimensions else None
        if scale is None:
            found.append(Coordinate(dimensions[axis] if dimensions else name, node.shape[axis]))
        else:
            packing = packing_of(scale)
            places = np.asarray(scale[:] if packing is None else packing.values(scale[:]), np.float64)
            found.append(Coordinate.of(dimensions[axis], places, scale.attrs.asdict()))
    return found


def _scale(group: Any, name: str, size: int) -> Any:
    """The array of coordinates of a dimension beside the array; None if there is none."""
    node: Any = group.get(name) if group is not None and name else None
    is_scale = getattr(node, "shape", None) == (size,) and node.dtype.kind in "uif" and size <= MOST_COORDINATES
    return node if is_scale else None


@dataclass(frozen=True)
class Packing:
    """How stored numbers become values: number · scale + offset; those equal to `fill` are missing."""

    scale: float
    offset: float
    fill: float | None

    def values(self, stored: np.ndarray) -> np.ndarray:
        """Values, float32, NaN where they are missing."""
        found = stored.astype(np.float64) * self.scale + self.offset
        return (found if self.fill is None else np.where(stored == self.fill, np.nan, found)).astype(np.float32)


def packing_of(node: Any) -> Packing | None:
    """What CF's attributes say of an array, as xarray writes them; None if numbers are values.

    A missing value is the attribute's, or of format 2 the array's own fill value.
    """
    told = node.attrs.asdict()
    scale, offset, fill, missing = (
        _one_number(told.get(name)) for name in ("scale_factor", "add_offset", "_FillValue", "missing_value")
    )
    if fill is None and dimensions_of(node) and node.metadata.zarr_format == 2:
        # zarr itself fills with 0
        fill = _one_number(node.fill_value) or None
    fill = missing if fill is None else fill
    if scale is None and offset is None and (fill is None or np.isnan(fill)):
        return None
    return Packing(1.0 if scale is None else scale, 0.0 if offset is None else offset, fill)


def _one_number(value: Any) -> float | None:
    """A number, or that in base64 of eight bytes, as xarray writes floats in format 3."""
    if isinstance(value, str):
        try:
            return float(struct.unpack("<d", base64.b64decode(value, validate=True))[0])
        except (ValueError, struct.error):
            return None
    found = np.asarray(value).ravel()
    return float(found[0]) if found.size == 1 and found.dtype.kind in "uif" else None


class Unpacked:
    """The values of a packed array, behind the interface that `Chunked` reads."""

    def __init__(self, array: Any, packing: Packing) -> None:
        self.array, self.packing = array, packing
        self.shape, self.chunks, self.dtype = array.shape, array.chunks, np.dtype(np.float32)
        self.fill_value = packing.values(np.asarray(array.fill_value or 0)).item()

    def __getitem__(self, index: Any) -> np.ndarray:
        return self.packing.values(np.asarray(self.array[index]))


def axis_names(node: Any, multiscale: Mapping[str, Any] | None, group: Any = None) -> list[str]:
    """One name per axis, with y and x, and z but for an image of one plane; without metadata t, c, z, y, x or the last
    of these. group: of the array, which may hold the coordinates of its dimensions.
    """
    count = len(node.shape)
    axes = (multiscale or {}).get("axes")
    names = [axis if isinstance(axis, str) else str(axis.get("name", "?")) for axis in axes] if axes else []
    if not names:
        names = [_kind(group, name, size) for name, size in zip(dimensions_of(node), node.shape, strict=False)]
        names = names if len(names) == count and {"z", "y", "x"} <= set(names) else []
    names = names or list("tczyx")[5 - min(count, 5) :]
    space = sorted(name for name in names if name in ("z", "y", "x"))
    if len(names) != count or space not in (["x", "y", "z"], ["x", "y"]) or (len(space) < 3 and not axes):
        raise expected("axes", "z, y and x among the array's axes", f"{names} of {count}")
    return [name if name in tuple("zyxt") else f"c {name}" for name in names]


def _kind(group: Any, name: str, size: int) -> str:
    """z, y, x, t or c, by a dimension's coordinates or name; else its name."""
    scale = _scale(group, name, size)
    kind = kind_of(name, {} if scale is None else scale.attrs.asdict())
    return {"time": "t"}.get(kind, kind or name.lower() or "?")


def several(omero: Any, node: Any, multiscale: Mapping[str, Any] | None, group: Any = None) -> Several:
    """The channels and time points of an array. omero: what the group says of the channels."""
    names = axis_names(node, multiscale, group)
    sizes = dict(zip(names, node.shape, strict=True))
    count = max((size for name, size in sizes.items() if name not in tuple("zyxt")), default=1)
    if count > MOST_CHANNELS:
        raise expected("channels", f"at most {MOST_CHANNELS}", count, "the header is damaged")
    told = omero.get("channels", []) if isinstance(omero, Mapping) else []
    found = [_channel(n, told[n] if n < len(told) else {}) for n in range(count)]
    together = count > 1 and any(each.color for each in found)
    return Several(tuple(found), together, sizes.get("t", 1), _step(multiscale, names))


def _channel(number: int, told: Any) -> Channel:
    told = told if isinstance(told, Mapping) else {}
    color = str(told.get("color", "")).removeprefix("#")
    window = told.get("window")
    window = window if isinstance(window, Mapping) else {}
    return Channel(
        str(told.get("label") or number),
        f"#{color.lower()}" if re.fullmatch("[0-9a-fA-F]{6}", color) else None,
        window_of(window.get("start"), window.get("end")),
    )


def labels_of(attributes: Mapping[str, Any]) -> tuple[Label, ...] | None:
    """The labels of an image of labels, with their colours (image-label); None of other images."""
    told = attributes.get("image-label")
    if not isinstance(told, Mapping):
        return None
    names = {entry.get("label-value"): str(entry.get("name", "")) for entry in told.get("properties") or ()}
    found: dict[int, Label] = {}
    for entry in told.get("colors") or ():
        number, rgba = entry.get("label-value"), entry.get("rgba", ())
        if isinstance(number, int) and number != 0 and len(rgba) >= 3:
            found[number] = Label(number, names.get(number, ""), rgb_of(rgba))
    return tuple(found.values())


def _step(multiscale: Mapping[str, Any] | None, names: list[str]) -> float | None:
    """Seconds between two time points: the scale along t, if its unit is told. Versions 0.1 to 0.3 tell none."""
    axes = (multiscale or {}).get("axes")
    if multiscale is None or not axes or "t" not in names:
        return None
    axis = axes[names.index("t")]
    unit = SECONDS.get(axis.get("unit", "")) if isinstance(axis, Mapping) else None
    scale = 1.0
    for owner in (*multiscale["datasets"][:1], multiscale):
        for step in owner.get("coordinateTransformations", ()):
            if step.get("type") == "scale" and len(step.get("scale", ())) == len(names):
                scale *= float(step["scale"][names.index("t")])
    return scale * unit if unit and scale > 0 else None
