"""Channels and time points of a file: their selection, and the volume of them."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from splatgl.data.color import luma
from splatgl.data.times import Times
from splatgl.data.volume import Volume
from splatgl.errors import MissingOption, expected, list_names
from splatgl.readers.common import parse_number
from splatgl.readers.options import LoadOptions

# most channels of an image: a damaged header may state any number
MOST_CHANNELS = 4096
# notes on the rules by which components are read
COLOR_NOTE = "three or four bytes per voxel are read as a colour: --channel N picks one"
VECTOR_NOTE = "three numbers per voxel are read as a vector, whose length is rendered; --channel N picks one"
MAGNITUDE_NOTE = "complex numbers are rendered by their magnitude"
# advice in the note on a time point that is read without option
TIME_HINT = "--time picks another"


@dataclass(frozen=True)
class Channel:
    """A channel: its name, its colour "#rrggbb" and its window of values from black to full, if the file has them.
    active: whether the file shows it. inverted: whether low values are the full ones.
    """

    name: str
    color: str | None = None
    window: tuple[float, float] | None = None
    active: bool = True
    inverted: bool = False


@dataclass(frozen=True)
class ChannelSet:
    """channels: of a file, empty if it has only one. together: whether the file shows them as one picture; None: if one
    has a colour. times: number of time points; step: seconds between two, no positive number if unknown; moments: as of
    a volume. components: numbers per voxel without channels, such as those of a colour; `channel` picks one. what: the
    name of the channels in messages.
    """

    channels: tuple[Channel, ...] = ()
    together: bool | None = None
    times: int = 1
    step: float | None = None
    components: int = 1
    what: str = "channels"
    moments: Times | None = None

    def select(self, options: LoadOptions) -> list[int | None]:
        """Numbers of the selected channels; [None]: the file has only one. Raises Choice if one has to be picked."""
        count, requested = len(self.channels), options.channel
        if count < 2:
            if isinstance(requested, int) and requested >= self.components:
                this = f"a number from 0 to {self.components - 1}" if self.components > 1 else "a file of channels"
                raise expected("channel", this, requested)
            if requested in ("all", None):
                return [None]
            return [requested if isinstance(requested, int) else self._number(str(requested), count)]
        together = any(channel.color for channel in self.channels) if self.together is None else self.together
        if requested is None and not together:
            fix = f"pick with channel=0 … channel={count - 1}, channel=all"
            error = expected("axes", "one sample per voxel", f"{count} {self.what}", fix)
            raise MissingOption(
                str(error), "channel", [(str(n), channel.name) for n, channel in enumerate(self.channels)]
            )
        if requested is None:
            return [n for n, channel in enumerate(self.channels) if channel.active] or list(range(count))
        if requested == "all":
            return list(range(count))
        return [self._number(part.strip(), count) for part in str(requested).split(",")]

    def _number(self, text: str, count: int) -> int:
        names = [channel.name for channel in self.channels]
        if text in names:
            return names.index(text)
        if re.fullmatch("[0-9]{1,6}", text) and int(text) < count:
            return int(text)
        this = f"a number from 0 to {count - 1}" + (f", or one of {list_names(names)}" if any(names) else "")
        raise expected("channel", this, repr(text))

    def volume(self, options: LoadOptions, read: Callable[[int | None], Volume]) -> Volume:
        """The volume of the selected channels. read: reads the channel of a number."""
        if options.time is not None and options.point >= self.times:
            this = f"a number from 0 to {self.times - 1}" if self.times > 1 else "a file of several time points"
            this += f", or a time such as {self.moments.values[-1]}" if self.moments else ""
            raise expected("time", this, options.time)
        numbers = self.select(options)
        volumes = [self._named(read(number), number) for number in numbers]
        notes = volumes[0].notes
        if self.times > 1 and options.time is None and options.array is None:
            notes = (*notes, f"time 0 of {self.times}: {TIME_HINT}")
        off = [channel.name or str(n) for n, channel in enumerate(self.channels) if n not in numbers]
        if off and options.channel is None and None not in numbers:
            notes = (*notes, f"channel {list_names(off)}: switched off in the file; --channel all draws every channel")
        step = float(self.step) if self.step and 0 < self.step < math.inf else None
        first = replace(volumes[0], times=self.times, time_step=step, time=options.point, notes=notes)
        first = replace(first, moments=self.moments)
        return replace(first, channels=tuple(volumes)) if len(volumes) > 1 else first

    def _named(self, volume: Volume, number: int | None) -> Volume:
        if number is None or len(self.channels) < 2:
            return volume
        channel = self.channels[number]
        hints = replace(volume.hints, window=channel.window, color=channel.color, inverted=channel.inverted)
        return replace(volume, name=channel.name or str(number), hints=hints)


def mark_microscope(volume: Volume) -> Volume:
    """The volume, marked as a stack of pictures, such as a microscope's, whose rows go down."""
    return replace(volume, hints=replace(volume.hints, stack=True))


def hex_color(color: Sequence[int]) -> str:
    """Three numbers from 0 to 255 as "#rrggbb"."""
    return "#{:02x}{:02x}{:02x}".format(*(int(part) & 255 for part in color[:3]))


def parse_window(low: object, high: object) -> tuple[float, float] | None:
    """(low, high) if both are numbers and low is below high; else None."""
    window = parse_number(low), parse_number(high)
    return window if -1e300 < window[0] < window[1] < 1e300 else None


def magnitudes(values: np.ndarray) -> np.ndarray:
    """Magnitudes of complex numbers, or of pairs named real and imag [D, …], float32."""
    pairs = ((plane["real"], plane["imag"]) if plane.dtype.names else (plane.real, plane.imag) for plane in values)
    return np.stack([np.hypot(*(part.astype(np.float64) for part in pair)).astype(np.float32) for pair in pairs])


def is_color_rule(dtype: np.dtype, count: int) -> bool:
    """Whether `count` components of a voxel, without a stated meaning, are read as a colour: three or four bytes."""
    return dtype == np.uint8 and count in (3, 4)


def is_vector_rule(dtype: np.dtype | None, count: int) -> bool:
    """Whether `count` components of a voxel, without a stated meaning, are a vector: three signed or real numbers."""
    return dtype is not None and dtype.kind in "if" and count == 3


def split_colors(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Luma [D, H, W] and colours uint8 [D, H, W, 3] of colours of 8 or 16 bits, with or without alpha; see `luma`."""
    color = values if values.dtype.itemsize == 1 else (values >> 8).astype(np.uint8)
    return luma(color), np.ascontiguousarray(color[..., :3])


def split_components(values: np.ndarray, is_color: bool) -> tuple[np.ndarray, np.ndarray | None, np.ndarray | None]:
    """(samples [D, H, W], colours or None, vectors or None) of [D, H, W, components]: samples are luma or lengths."""
    if is_color:
        if values.dtype != np.uint8:
            raise expected("colours", "uint8", values.dtype, "pick one with channel=0 … channel=2")
        return (*split_colors(values), None)
    vectors = np.asarray(values, np.float32)
    return np.stack([np.linalg.norm(plane, axis=-1) for plane in vectors]), None, vectors


# samples [D, H, W], colours or None, vectors or None, and notes
Components = tuple[np.ndarray, np.ndarray | None, np.ndarray | None, tuple[str, ...]]


def split_voxels(values: np.ndarray, options: LoadOptions) -> Components:
    """The samples, colours, vectors and notes of [D, H, W, components] without a stated meaning: `channel` picks one,
    else three or four bytes are a colour, and three signed or real numbers a vector.
    """
    is_color = is_color_rule(values.dtype, values.shape[-1])
    if options.channel is None and (is_color or is_vector_rule(values.dtype, values.shape[-1])):
        return (*split_components(values, is_color), (COLOR_NOTE if is_color else VECTOR_NOTE,))
    return values[options.index(values.shape, {3: "channel"})], None, None, ()
