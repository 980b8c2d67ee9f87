"""Images in files of microscopes: the selection of one, its channels and time points, and planes read in parts."""

from __future__ import annotations

import io
import math
import os
import weakref
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from splatgl.data.volume import Triple, Volume
from splatgl.errors import expected
from splatgl.fileio import WHOLE_BYTES, byte_count, held_within_budget, require_memory
from splatgl.readers.channels import Channel, ChannelSet, mark_microscope, split_colors
from splatgl.readers.chunked import Chunked, OneFile
from splatgl.readers.common import MAX_BYTES, decoder_errors
from splatgl.readers.options import LoadOptions
from splatgl.readers.tiff_images import select_image

# order of the axes of an image; other axes precede them
ORDER = "TCZYXS"
# planes that a header may state beyond those that are stored, as aborted recordings do; they are read as 0
FREE_PLANES, PLANES_PER_STORED = 4096, 64


class OpenFile(OneFile):
    """A file that is open in its library as long as this object lives. file: has the method close."""

    def __init__(self, path: Path, file: Any) -> None:
        super().__init__(path)
        self.file = file
        weakref.finalize(self, file.close)


class BoundedFile(io.BufferedReader):
    """A file of which no more is read, and allocated, than there is."""

    def read(self, size: int | None = -1, /) -> bytes:
        """Up to `size` bytes; all without a size."""
        there = os.fstat(self.fileno()).st_size
        return super().read(min(size, there) if size is not None and size >= 0 else size)


class Planes:
    """The planes [Y, X] or [Y, X, S] of an image, behind leading axes, as `Chunked` reads them.

    read: the plane at an index along the leading axes, or None for one that is missing, which is 0.
    """

    fill_value = 0

    def __init__(
        self,
        lead: Sequence[int],
        plane: Sequence[int],
        dtype: Any,
        read: Callable[[tuple[int, ...]], np.ndarray | None],
    ) -> None:
        self.lead, self.plane, self.dtype, self.read = tuple(lead), tuple(plane), np.dtype(dtype), read
        self.shape, self.chunks = self.lead + self.plane, (1,) * len(self.lead) + self.plane

    def __getitem__(self, key: tuple[int | slice, ...]) -> np.ndarray:
        count = len(self.lead)
        leading = zip(key[:count], self.lead, strict=True)
        places = [range(size)[at] if isinstance(at, slice) else [at] for at, size in leading]
        within = key[count:]
        counts = [len(place) for place in places]
        empty = np.broadcast_to(np.zeros((), self.dtype), self.plane)
        block = np.zeros([*counts, *empty[within].shape], self.dtype)
        for target, index in zip(np.ndindex(*counts), product(*places), strict=True):
            plane = self.read(index)
            if plane is None:
                continue
            if plane.shape != self.plane or plane.dtype != self.dtype:
                raise expected("plane", f"{self.dtype} {self.plane}", f"{plane.dtype} {plane.shape}")
            block[target] = plane[within]
        return np.asarray(block[tuple(slice(None) if isinstance(at, slice) else 0 for at in key[:count])])


@dataclass(frozen=True)
class Image:
    """An image of a file: a letter for each axis (see ORDER) and its size, a function that returns the samples as an
    array or `Planes`, its channels, the spacing of voxels, seconds between time points, and the number of planes that
    are not stored.
    """

    name: str
    axes: str
    shape: tuple[int, ...]
    load: Callable[[], Any]
    channels: tuple[Channel, ...] = ()
    spacing: Triple = (1.0, 1.0, 1.0)
    unit: str = ""
    step: float | None = None
    missing: int = 0


def check_planes(lead: Sequence[int], plane: Sequence[int], dtype: np.dtype, stored: int) -> None:
    """Raises InputError for very large planes, and for far more planes than are stored."""
    if min((*lead, *plane)) < 1:
        raise expected("size", "at least one entry along each axis", (*lead, *plane), "the header is damaged")
    if byte_count(plane, dtype) > MAX_BYTES:
        got = f"{byte_count(plane, dtype)} ({' × '.join(map(str, plane))})"
        raise expected("planes", f"at most {MAX_BYTES} bytes each", got, "save a part of the image")
    if math.prod(lead) > FREE_PLANES + PLANES_PER_STORED * stored:
        raise expected("planes", f"about the file's {stored}", math.prod(lead), "the header is damaged")


def even_spacing(x: float, y: float, z: float) -> Triple:
    """Positive spacing: unknown ones, 0 or not finite, are taken from x, else 1."""
    known = [abs(step) if math.isfinite(step) else 0.0 for step in (x, y, z)]
    return known[0] or 1.0, known[1] or known[0] or 1.0, known[2] or known[0] or 1.0


def read_image(path: Path, form: str, images: Sequence[Image], options: LoadOptions, file: OneFile) -> Volume:
    """The volume of the image that `series` picks, else of the largest stack. form: the format's name.

    `channel` picks channels, `time` a time point, `array` an entry along an axis that is none of these. An image
    without z is a plane, as thick as a pixel is wide. Samples of more than WHOLE_BYTES are read in parts.
    """
    place, notes = select_image(images, options)
    image = images[place]
    sizes = dict(zip(image.axes, image.shape, strict=True))
    count = sizes.get("C", 1)
    channels = (*image.channels, *(Channel(str(n)) for n in range(len(image.channels), count)))[:count]
    together = any(channel.color for channel in channels)
    channel_set = ChannelSet(channels, together, sizes.get("T", 1), image.step, sizes.get("S", 1))
    if all(axis in ORDER for axis in image.axes):
        options.refuse("array", f"an axis beside time, channels and space, where this has {image.axes}")

    def read_one(channel: int | None) -> Volume:
        # a colour's components are numbered where there are no channels
        component = channel if count == 1 and "S" in sizes else None
        picked: dict[int, str | int] = {}
        for axis, letter in enumerate(image.axes):
            if letter == "C":
                picked[axis] = 0 if channel is None or count == 1 else channel
            elif letter == "T":
                picked[axis] = "time"
            elif letter not in "ZYXS":
                picked[axis] = "array"
            elif letter == "S" and component is not None:
                picked[axis] = component
        index = options.index(image.shape, picked)
        samples = _read_samples(path, form, array, index, file)
        samples = samples if "Z" in sizes else samples[None]
        samples, color = split_colors(samples) if len(samples.shape) == 4 else (samples, None)
        return Volume(samples, image.spacing, unit=image.unit, color=color)

    with decoder_errors(form):
        array = image.load()
    volume = mark_microscope(channel_set.volume(options, read_one))
    gap = f"{image.missing} planes are not in the file, and are drawn as 0"
    return replace(volume, notes=(*notes, *[gap] * bool(image.missing), *volume.notes))


def _read_samples(path: Path, form: str, array: Any, index: tuple[int | slice, ...], file: OneFile) -> Any:
    """The part of an array that `index` leaves free: mapped, read, or read in parts."""
    if isinstance(array, np.ndarray):
        return array[index]
    free = [size for size, at in zip(array.shape, index, strict=True) if isinstance(at, slice)]
    if len(free) == 3 and byte_count(free, array.dtype) > held_within_budget(WHOLE_BYTES):
        return Chunked(str(path), array, index, file, form)
    require_memory(byte_count(free, array.dtype), path.stat().st_size)
    with decoder_errors(form):
        return array[index]
