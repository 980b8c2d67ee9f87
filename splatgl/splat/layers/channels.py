"""Channels of one file in one picture: each in its own colour, as bright as it is opaque."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from splatgl.data.volume import Volume
from splatgl.errors import expected
from splatgl.splat.classification.looks import SURFACE
from splatgl.splat.classification.presets import preset
from splatgl.splat.classification.transfer import Transfer

# optical depth through the volume's thinnest side of a channel at its brightest: what lies behind shows through; and
# the least opacity of a voxel
THROUGH, LEAST = 6.0, 0.01
# of channels whose file states no colour
PALETTE = ("#4a7dff", "#3ddc5a", "#ff4b4b", "#ffd23d", "#38e1e1", "#ff5adf", "#ff9a3d", "#c9c9c9")


def channel_transfers(
    volume: Volume, colors: Mapping[str, str], windows: Mapping[str, tuple[float, float]], base: Transfer | None = None
) -> list[Transfer]:
    """The transfer function of each of a volume's channels: a ramp over its window in its colour, unshaded.

    colors, windows: by the names or numbers of channels, instead of the file's. base: whose ramp all have that are
    given no window. A channel without any window has the preset microscopy's. Raises InputError for a channel that
    there is not.
    """
    names = [each.name for each in volume.channels]
    for name in (*colors, *windows):
        if name not in names and name not in map(str, range(len(names))):
            raise expected("channel", f"one of {', '.join(names)}", repr(name))
    full = float(np.clip(-np.expm1(-THROUGH / min(volume.shape)), LEAST, SURFACE))
    found = []
    for number, channel in enumerate(volume.channels):
        keys = (channel.name, str(number))
        color = next((colors[key] for key in keys if key in colors), None)
        color = color or channel.hints.color or PALETTE[number % len(PALETTE)]
        window = next((windows[key] for key in keys if key in windows), None)
        if window is None and base is None:
            window = channel.hints.window
        ramp = base or preset("microscopy", channel).weakened(full / SURFACE)
        if window is not None:
            ramp = Transfer(((window[0], 0.0), (window[1], full)), unit=ramp.unit)
        found.append(replace(ramp, colormap=color, window=None, shading=False))
    return found
