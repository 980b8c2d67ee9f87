"""Reads files as napari layers: mapped or lazy samples with the file's geometry, colours and window."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from splatgl import readers
from splatgl.data.color import color_of_dye
from splatgl.data.volume import Volume
from splatgl.integrations.exchange import lazy_samples
from splatgl.readers import formats
from splatgl.transfer.statistics import sampled_steps

LayerData = tuple[Any, dict[str, Any], str]

# suffixes that napari reads too, or that name no particular format
OTHERS = (".npy", ".png", ".jpg", ".jpeg", ".csv", ".bin", ".dat", ".zip", ".img")
# napari's names of units in `Volume.unit`
UNITS = {"Å": "angstrom", "in": "inch"}
# axes of napari, (z, y, x), in the order (x, y, z)
TURN = slice(None, None, -1)


def patterns() -> list[str]:
    """Patterns of file names, as the manifest lists them."""
    return list(dict.fromkeys(f"*{suffix}" for form in formats() for suffix in form.suffixes if suffix not in OTHERS))


def reader_of(path: str | Sequence[str]) -> Callable[[Any], list[LayerData]] | None:
    """Function that reads a path; None for several paths of one stack, and missing files."""
    if not isinstance(path, str):
        if len(path) != 1:
            return None
        path = path[0]
    if not Path(path).exists():
        return None
    return read


def read(path: str | Sequence[str]) -> list[LayerData]:
    """Data, keywords and kind of each layer of a file or folder: one per channel, as image or labels.

    Raises InputError as `load`.
    """
    name = path if isinstance(path, str) else path[0]
    volume = readers.load(name)
    channels = volume.channels or (volume,)
    return [_layer(name, volume, number, channel) for number, channel in enumerate(channels)]


def _layer(path: str, first: Volume, number: int, channel: Volume) -> LayerData:
    several = first.times > 1
    levels = (channel, *channel.coarser)
    data = [lazy_samples(level.samples if level.color is None else level.color) for level in levels]
    if several:
        data = [_times(data[0], first.times, partial(_time, path, number))]
    metadata: dict[str, Any] = {"frame": channel.frame, "notes": first.notes}
    keywords = {"name": channel.name or first.name, "metadata": metadata, **_geometry(channel, first, several)}
    shown = data if len(data) > 1 else data[0]
    if channel.labels is not None and channel.samples.dtype.kind in "ui":
        return shown, {**keywords, **_label_keywords(channel)}, "labels"
    if channel.color is not None:
        return shown, {**keywords, "rgb": True}, "image"
    limits = _range(data[0]) if several and isinstance(channel.samples, np.ndarray) else {}
    return shown, {**keywords, **limits, **_display(channel, len(first.channels) > 1)}, "image"


def _time(path: str, channel: int, time: int) -> Any:
    """Samples of a channel at a time point."""
    volume = readers.load(path, time=time)
    part = (volume.channels or (volume,))[channel]
    return np.asarray(part.samples if part.color is None else part.color)


def _times(sample: Any, count: int, read_one: Callable[[int], Any]) -> Any:
    """Dask array of all time points along a first axis."""
    import dask.array
    from dask.delayed import delayed

    parts = [delayed(read_one)(number) for number in range(count)]
    return dask.array.stack([dask.array.from_delayed(part, sample.shape, sample.dtype) for part in parts])


def _geometry(volume: Volume, first: Volume, several: bool) -> dict[str, Any]:
    """Keywords that place voxels in napari's world (z, y, x), or (time, z, y, x)."""
    unit = UNITS.get(volume.unit, volume.unit) or "pixel"
    step, lead = first.time_step, int(several)
    keywords: dict[str, Any] = {"units": ("second" if step else "pixel",) * lead + (unit,) * 3}
    if np.array_equal(volume.direction, np.eye(3)):
        scale, translate = list(volume.spacing[::-1]), list(volume.origin[::-1])
        return {**keywords, "scale": [step or 1.0] * lead + scale, "translate": [0.0] * lead + translate}
    # turned, mirrored or sheared
    affine = np.eye(4 + lead)
    affine[lead:-1, lead:-1] = volume.world_from_index[TURN, TURN]
    affine[lead:-1, -1] = volume.origin[TURN]
    affine[:lead, :lead] *= step or 1.0
    return {**keywords, "affine": affine}


def _range(times: Any) -> dict[str, Any]:
    """Contrast limits of a few time points [time, z, y, x]: napari would use a single plane."""
    parts = [np.asarray(times[number]) for number in sampled_steps(len(times))]
    known = np.concatenate([part[np.isfinite(part)] for part in parts])
    low, high = (float(known.min()), float(known.max())) if known.size else (0.0, 0.0)
    return {"contrast_limits": (low, high)} if low < high else {}


def _display(volume: Volume, several: bool) -> dict[str, Any]:
    """Keywords of the window, and of the colour of a channel."""
    hints, keywords = volume.hints, dict[str, Any]()
    if hints.window is not None:
        keywords["contrast_limits"] = hints.window
    color = hints.color or (color_of_dye(volume.name) if several else None)
    if color is not None:
        keywords["colormap"] = color
    return {**keywords, "blending": "additive"} if several else keywords


def _label_keywords(volume: Volume) -> dict[str, Any]:
    """Keywords of the labels' colours and names."""
    labels = volume.labels or ()
    colors: dict[int | None, str] = {label.number: label.color for label in labels if label.color}
    keywords: dict[str, Any] = {}
    if colors:
        keywords["colormap"] = {None: "transparent", 0: "transparent", **colors}
    if any(label.name for label in labels):
        numbers = [0, *(label.number for label in labels)]
        keywords["features"] = {"index": numbers, "name": ["", *(label.name for label in labels)]}
    return keywords
