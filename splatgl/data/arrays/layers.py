"""Image and Labels layers of napari: data, placement in its world, contrast limits and colour map."""

from __future__ import annotations

from dataclasses import replace
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

import numpy as np

from splatgl.data.arrays.parts import Turned
from splatgl.data.arrays.plain import CHANNELS, checked
from splatgl.data.readers.grid import axes_of, triple, unit_name
from splatgl.data.volume import Hints, Volume
from splatgl.errors import expected

if TYPE_CHECKING:
    from splatgl.data.arrays import ArrayOptions

# colour maps that are there without a library, and those that napari shares with cmap and matplotlib
OWN, SHARED = ("gray", "viridis"), ("magma", "inferno", "plasma", "turbo", "twilight", "twilight_shifted", "hsv")


def of_napari(x: Any, options: ArrayOptions) -> Volume:
    """The volume of a napari layer: world (x, y, z) is napari's (z, y, x); `array` picks along a fourth axis.

    Multiscale data keep their levels. Contrast limits are the window, a colour map that is known its name.
    """
    kind = type(x).__name__
    if not hasattr(x, "data_to_world") or not hasattr(x, "data") or kind not in ("Image", "Labels"):
        raise expected("layer", "an Image or Labels layer of napari", f"a {kind}")
    if getattr(x, "rgb", False):
        raise expected("layer", "one number per voxel", "colours (rgb)", "pick a channel: x.data[..., 0]")
    levels = list(x.data) if x.multiscale else [x.data]
    finest = tuple(levels[0].shape)
    lead = _lead(finest, options)
    # napari's world, as its own function places the first voxel and its neighbours
    corners = np.vstack([np.zeros(3), np.eye(3)])
    world = np.array([x.data_to_world((*lead, *corner))[-3:] for corner in corners])
    origin, matrix = world[0][::-1], (world[1:] - world[0]).T[::-1, ::-1]
    hints = _hints(x)
    unit = _unit(x)
    made = []
    for data in levels:
        factor = np.array(finest[-3:]) / data.shape[-3:]
        scaled = matrix * factor[::-1]
        spacing, direction = axes_of(scaled, "the layer's transform")
        # levels fill the same box
        start = origin + (scaled - matrix) @ np.full(3, 0.5)
        # zarr's and HDF5's arrays would be read whole
        samples = checked(data if not lead else data[lead] if _is_view(data) else Turned(data, lead=lead), "layer")
        made.append(Volume(samples, spacing, triple(start, "translate"), direction, unit, x.name, hints=hints))
    if kind == "Labels":
        made = [replace(each, labels=()) for each in made]
    first, *coarser = made
    object.__setattr__(first, "coarser", tuple(coarser))
    return first


def _lead(shape: tuple[int, ...], options: ArrayOptions) -> tuple[int, ...]:
    """The place along the axes before z, y, x."""
    count = len(shape) - 3
    if count <= 0:
        options.no_array("the layer")
        return ()
    asked = options.array
    if count == 1 and isinstance(asked, int) and 0 <= asked < shape[0]:
        return (asked,)
    if asked is None and all(size == 1 for size in shape[:count]):
        return (0,) * count
    what = "channel or time" if shape[0] <= CHANNELS else "time"
    fix = f"pick a {what}: array=0 … array={shape[0] - 1}" if count == 1 else "take a volume of its data"
    raise expected("layer", "3 axes [z, y, x]", f"{len(shape)} ({'×'.join(map(str, shape))})", fix)


def _is_view(data: Any) -> bool:
    """Whether a part of the data costs nothing before it is used."""
    return isinstance(data, np.ndarray) or type(data).__module__.partition(".")[0] == "dask"


def _hints(x: Any) -> Hints:
    """The window and colour map that the layer is shown with; labels have none."""
    if type(x).__name__ == "Labels":
        return Hints()
    low, high = (float(limit) for limit in x.contrast_limits)
    name = str(x.colormap.name)
    known = name in OWN or (name in SHARED and any(find_spec(each) for each in ("cmap", "matplotlib")))
    return Hints(window=(low, high) if low < high else None, colormap=name if known else None)


def _unit(x: Any) -> str:
    """The unit of z, y and x, if they share one."""
    units = {unit_name(str(unit)) for unit in tuple(getattr(x, "units", None) or ())[-3:]}
    return units.pop() if len(units) == 1 else ""
