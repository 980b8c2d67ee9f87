"""Files as layers of napari: the samples, mapped or lazy, where the file places them, as the file shows them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from splatgl import readers
from splatgl.data.volume import Volume
from splatgl.readers import FORMATS

LayerData = tuple[Any, dict[str, Any], str]

# endings of what napari reads as well, and of what may be anything
OTHERS = (".npy", ".png", ".jpg", ".jpeg", ".csv", ".bin", ".dat", ".zip", ".img")
# names of units in `Volume.unit` as napari knows them
UNITS = {"Å": "angstrom", "in": "inch"}
# axes of napari, (z, y, x), in the order (x, y, z)
TURN = slice(None, None, -1)


def patterns() -> list[str]:
    """The patterns of file names that are offered, as the manifest lists them."""
    return [f"*{suffix}" for form in FORMATS for suffix in form.suffixes if suffix not in OTHERS]


def reader_of(path: str | Sequence[str]) -> Callable[[Any], list[LayerData]] | None:
    """The function that reads a path, None for what is not read: several paths that are one stack."""
    if not isinstance(path, str):
        if len(path) != 1:
            return None
        path = path[0]
    if not Path(path).exists():
        return None
    return read


def read(path: str | Sequence[str]) -> list[LayerData]:
    """Data, keywords and kind of each layer of a file or folder: one per channel; colours and labels are told apart.

    Raises InputError for what `load` refuses.
    """
    name = path if isinstance(path, str) else path[0]
    volume = readers.load(name)
    channels = volume.channels or (volume,)
    return [_layer(name, volume, number, each) for number, each in enumerate(channels)]


def _layer(path: str, first: Volume, number: int, channel: Volume) -> LayerData:
    several = first.times > 1
    levels = [each.color if each.color is not None else each.samples for each in (channel, *channel.coarser)]
    data = [_lazy(each) for each in levels]
    if several:
        data = [_times(data[0], first.times, partial(_time, path, number))]
    metadata: dict[str, Any] = {"frame": channel.frame, "notes": first.notes}
    given = {"name": channel.name or first.name, "metadata": metadata, **_placed(channel, first, several)}
    whole = data if len(data) > 1 else data[0]
    if channel.labels is not None and channel.samples.dtype.kind in "ui":
        return whole, {**given, **_named(channel)}, "labels"
    if channel.color is not None:
        return whole, {**given, "rgb": True}, "image"
    limits = _range(channel.samples) if several else {}
    return whole, {**given, **limits, **_shown(channel, len(first.channels) > 1)}, "image"


def _lazy(samples: Any) -> Any:
    """An array of numpy as it is, what is read in parts as one of dask."""
    if isinstance(samples, np.ndarray):
        return samples
    import dask.array

    chunks, meta = getattr(samples, "chunks", "auto"), np.empty((0,) * len(samples.shape), samples.dtype)
    return dask.array.from_array(samples, chunks=chunks, name=False, meta=meta)


def _time(path: str, channel: int, time: int) -> Any:
    """The samples of a channel at a time point."""
    volume = readers.load(path, time=time)
    found = (volume.channels or (volume,))[channel]
    return np.asarray(found.samples if found.color is None else found.color)


def _times(sample: Any, count: int, read_one: Callable[[int], Any]) -> Any:
    """All time points along a first axis; each is read when it is shown."""
    import dask.array
    from dask.delayed import delayed

    parts = [delayed(read_one)(number) for number in range(count)]
    return dask.array.stack([dask.array.from_delayed(each, sample.shape, sample.dtype) for each in parts])


def _placed(volume: Volume, first: Volume, several: bool) -> dict[str, Any]:
    """The keywords that place voxels in napari's world (z, y, x), or (time, z, y, x)."""
    unit = UNITS.get(volume.unit, volume.unit) or "pixel"
    step, lead = first.time_step, int(several)
    given: dict[str, Any] = {"units": ("second" if step else "pixel",) * lead + (unit,) * 3}
    if np.array_equal(volume.direction, np.eye(3)):
        scale, translate = list(volume.spacing[::-1]), list(volume.origin[::-1])
        return {**given, "scale": [step or 1.0] * lead + scale, "translate": [0.0] * lead + translate}
    # turned, mirrored or sheared
    affine = np.eye(4 + lead)
    affine[lead:-1, lead:-1] = volume.world_from_index[TURN, TURN]
    affine[lead:-1, -1] = volume.origin[TURN]
    affine[:lead, :lead] *= step or 1.0
    return {**given, "affine": affine}


def _range(samples: Any) -> dict[str, Any]:
    """Contrast limits of a time point in memory: napari would take those of one plane."""
    known = samples[np.isfinite(samples)] if isinstance(samples, np.ndarray) else np.zeros(0)
    low, high = (float(known.min()), float(known.max())) if known.size else (0.0, 0.0)
    return {"contrast_limits": (low, high)} if low < high else {}


def _shown(volume: Volume, several: bool) -> dict[str, Any]:
    """The window, and the colours of one of several channels."""
    hints, given = volume.hints, dict[str, Any]()
    if hints.window is not None:
        given["contrast_limits"] = hints.window
    if hints.color is not None:
        given["colormap"] = hints.color
    return {**given, "blending": "additive"} if several else given


def _named(volume: Volume) -> dict[str, Any]:
    """Colours and names of labels that have them."""
    labels = volume.labels or ()
    colors: dict[int | None, str] = {label.number: label.color for label in labels if label.color}
    given: dict[str, Any] = {}
    if colors:
        given["colormap"] = {None: "transparent", 0: "transparent", **colors}
    if any(label.name for label in labels):
        numbers = [0, *(label.number for label in labels)]
        given["features"] = {"index": numbers, "name": ["", *(label.name for label in labels)]}
    return given
