"""Axes, channels and time points of Zarr arrays: OME-Zarr's axes and omero, names of dimensions, or their order."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

from splatgl.data.errors import expected
from splatgl.data.readers.several import MOST_CHANNELS, SECONDS, Channel, Several, rgb_of, window_of
from splatgl.data.volume import Label


def axis_names(node: Any, multiscale: Mapping[str, Any] | None) -> list[str]:
    """One name per axis, with y and x, and z but for an image of one plane; without metadata t, c, z, y, x or the last
    of these.
    """
    count = len(node.shape)
    axes = (multiscale or {}).get("axes")
    names = [axis if isinstance(axis, str) else str(axis.get("name", "?")) for axis in axes] if axes else []
    if not names:
        told = getattr(node.metadata, "dimension_names", None) or node.attrs.asdict().get("_ARRAY_DIMENSIONS") or []
        names = [str(name or "?").lower() for name in told]
        known = {"time": "t", "channel": "c", "depth": "z"}
        names = [known.get(name, name) for name in names]
        names = names if len(names) == count and {"z", "y", "x"} <= set(names) else []
    names = names or list("tczyx")[5 - min(count, 5) :]
    space = sorted(name for name in names if name in ("z", "y", "x"))
    if len(names) != count or space not in (["x", "y", "z"], ["x", "y"]) or (len(space) < 3 and not axes):
        raise expected("axes", "z, y and x among the array's axes", f"{names} of {count}")
    return [name if name in tuple("zyxt") else f"c {name}" for name in names]


def several(omero: Any, node: Any, multiscale: Mapping[str, Any] | None) -> Several:
    """The channels and time points of an array. omero: what the group says of the channels."""
    names = axis_names(node, multiscale)
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
