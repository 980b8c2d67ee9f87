"""Channels and time points of one file: which are read, and the volume that they make."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from splatgl.data.color import luma
from splatgl.data.volume import Volume
from splatgl.errors import Choice, expected
from splatgl.readers.options import LoadOptions

# units of time, as files spell them
SECONDS = {
    **{name: 1.0 for name in ("s", "sec", "second", "seconds")},
    **{name: 1e-3 for name in ("ms", "msec", "millisecond", "milliseconds")},
    **{name: 1e-6 for name in ("us", "µs", "μs", "usec", "microsecond", "microseconds")},
    **{name: 60.0 for name in ("min", "minute", "minutes")},
    **{name: 3600.0 for name in ("h", "hr", "hour", "hours")},
}

# most channels of an image: a damaged header may state any number
MOST_CHANNELS = 4096
# most channels that a message names
MOST_SHOWN = 8
# the end of a note on the time point that is read if none is asked for
TIME_HINT = "--time picks another"


@dataclass(frozen=True)
class Channel:
    """A channel: its name, its colour "#rrggbb" and the values that its file shows from black to full, if told."""

    name: str
    color: str | None = None
    window: tuple[float, float] | None = None


@dataclass(frozen=True)
class ChannelSet:
    """channels: of a file, none if it has one only. together: whether the file says that they are one picture.
    times: number of time points; step: seconds between two, None if not told. components: of a voxel without channels,
    such as those of a colour, of which a number picks one.
    """

    channels: tuple[Channel, ...] = ()
    together: bool = False
    times: int = 1
    step: float | None = None
    components: int = 1

    def chosen(self, options: LoadOptions) -> list[int | None]:
        """Numbers of the channels that are read; [None]: the file has no more than one. Raises InputError for names and
        numbers that there are not, and a Choice where one has to be picked.
        """
        count, asked = len(self.channels), options.channel
        if count < 2:
            if isinstance(asked, int) and asked >= self.components:
                this = f"a number from 0 to {self.components - 1}" if self.components > 1 else "a file of channels"
                raise expected("channel", this, asked)
            return [None if asked in ("all", None) else asked if isinstance(asked, int) else self._number(asked, count)]
        if asked is None and not self.together:
            fix = f"pick with channel=0 … channel={count - 1}, channel=all"
            error = expected("axes", "one sample per voxel", f"{count} channels", fix)
            raise Choice(str(error), "channel", [(str(n), each.name) for n, each in enumerate(self.channels)])
        if asked is None or asked == "all":
            return list(range(count))
        return [self._number(part.strip(), count) for part in str(asked).split(",")]

    def _number(self, text: str, count: int) -> int:
        names = [each.name for each in self.channels]
        if text in names:
            return names.index(text)
        if re.fullmatch("[0-9]{1,6}", text) and int(text) < count:
            return int(text)
        known = ", ".join(names[:MOST_SHOWN]) + ", …" * (len(names) > MOST_SHOWN)
        this = f"a number from 0 to {count - 1}" + (f", or one of {known}" if any(names) else "")
        raise expected("channel", this, repr(text))

    def volume(self, options: LoadOptions, read: Callable[[int | None], Volume]) -> Volume:
        """The volume of the chosen channels. read: the volume of one, by its number."""
        if options.time is not None and options.time >= self.times:
            this = f"a number from 0 to {self.times - 1}" if self.times > 1 else "a file of several time points"
            raise expected("time", this, options.time)
        numbers = self.chosen(options)
        made = [self._named(read(number), number) for number in numbers]
        notes = made[0].notes
        if self.times > 1 and options.time is None and options.array is None:
            notes = (*notes, f"time 0 of {self.times}: {TIME_HINT}")
        first = replace(made[0], times=self.times, time_step=self.step, notes=notes)
        return replace(first, channels=tuple(made)) if len(made) > 1 else first

    def _named(self, volume: Volume, number: int | None) -> Volume:
        if number is None or len(self.channels) < 2:
            return volume
        told = self.channels[number]
        hints = replace(volume.hints, window=told.window, color=told.color)
        return replace(volume, name=told.name or str(number), hints=hints)


def mark_microscope(volume: Volume) -> Volume:
    """The volume, marked as planes of a microscope."""
    return replace(volume, hints=replace(volume.hints, stack=True))


def hex_color(color: Sequence[int]) -> str:
    """Three numbers from 0 to 255 as "#rrggbb"."""
    return "#{:02x}{:02x}{:02x}".format(*(int(part) & 255 for part in color[:3]))


def parse_window(low: object, high: object) -> tuple[float, float] | None:
    """A window of values, if both are numbers and the first is below the second."""
    try:
        found = float(str(low)), float(str(high))
    except ValueError:
        return None
    return found if -1e300 < found[0] < found[1] < 1e300 else None


def split_components(values: np.ndarray, is_color: bool) -> tuple[np.ndarray, np.ndarray | None, np.ndarray | None]:
    """(samples [D, H, W], colours or None, vectors or None) out of [D, H, W, components]: luma, or lengths."""
    if is_color:
        if values.dtype != np.uint8:
            raise expected("colours", "uint8", values.dtype, "pick one with channel=0, channel=1 or channel=2")
        color = np.ascontiguousarray(values[..., :3])
        return luma(color), color, None
    vectors = np.asarray(values, np.float32)
    return np.stack([np.linalg.norm(plane, axis=-1) for plane in vectors]), None, vectors
