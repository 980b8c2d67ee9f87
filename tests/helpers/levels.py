"""Volumes with coarser levels, and their stores."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

import splatgl as sg
from splatgl.data.volume import halve_volume

SOFT = sg.Transfer([(0.2, 0.0), (0.8, 0.05)], colormap="hot", shading=False)


def with_levels(volume: sg.Volume, count: int) -> sg.Volume:
    found = [volume]
    for _ in range(count):
        found.append(halve_volume(found[-1]))
    return replace(volume, coarser=tuple(found[1:]))


def write(path: Path, volume: sg.Volume) -> None:
    """As an OME-Zarr image."""
    zarr = pytest.importorskip("zarr")
    group = zarr.open_group(path, mode="w", zarr_format=2)
    steps = []
    for number, level in enumerate((volume, *volume.coarser)):
        group.create_array(str(number), data=level.samples, chunks=(16, 16, 16))
        scale = {"type": "scale", "scale": list(level.spacing[::-1])}
        move = {"type": "translation", "translation": list(level.origin[::-1])}
        steps.append({"path": str(number), "coordinateTransformations": [scale, move]})
    axes = [{"name": name, "type": "space"} for name in "zyx"]
    group.attrs["multiscales"] = [{"version": "0.4", "axes": axes, "datasets": steps}]
