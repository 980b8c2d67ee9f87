"""Nikon's ND2 files, by the library nd2: positions are images, frames are read in parts."""

from __future__ import annotations

import math
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from splatgl.data.volume import Volume
from splatgl.errors import expected, import_extra
from splatgl.fileio import byte_count
from splatgl.readers.channels import Channel, hex_color
from splatgl.readers.common import decoder_errors, require_plausible
from splatgl.readers.microscopes import BoundedFile, Image, OpenFile, Planes, check_planes, even_spacing, read_image
from splatgl.readers.options import LoadOptions
from splatgl.readers.tiff_images import list_series


def list_images(path: Path) -> list[str]:
    """A line for each position."""
    with decoder_errors("ND2"):
        return list_series(_find_images(path, _open(path)))


def read(path: Path, options: LoadOptions) -> Volume:
    """The volume of an ND2 file; `series` is the position, for the other options see `read_image`."""
    with decoder_errors("ND2"):
        file = _open(path)
        images = _find_images(path, file)
    return read_image(path, "ND2", images, options, file)


def _open(path: Path) -> OpenFile:
    nd2 = import_extra("nd2", "Nikon's ND2 files", "nd2", "microscopes")
    file = BoundedFile(path.open("rb", buffering=0))
    try:
        return OpenFile(path, nd2.ND2File(file))
    except BaseException:
        file.close()
        raise


def _find_images(path: Path, file: OpenFile) -> list[Image]:
    """The positions of a file; each has axes T, Z, C or some of them, in the order of its loops."""
    source = file.file
    if source.is_legacy:
        raise expected("file", "an ND2 file of version 2 or later", "an older one", "save it as TIFF with Fiji")
    attributes, loops = source.attributes, source.experiment
    # 1. loops by the letters of their axes, outer ones first
    letters = {"TimeLoop": "T", "NETimeLoop": "T", "XYPosLoop": "P", "ZStackLoop": "Z", "CustomLoop": "U"}
    axes = "".join(letters.get(loop.type, "?") for loop in loops)
    counts = [int(loop.count) for loop in loops]
    if "?" in axes or len(set(axes)) < len(axes):
        raise expected("loops", "one each of time, position and z", ", ".join(loop.type for loop in loops))
    # 2. planes: the components of a pixel are channels, or colours of one channel
    components, channels = int(attributes.componentCount), int(attributes.channelCount or 1)
    is_color = components == 3 * channels and channels == 1
    dtype, plane = np.dtype(source.dtype), (int(attributes.heightPx), int(attributes.widthPx or 0))
    frame = (1 if is_color else components, *plane, 3 if is_color else 1)
    stored = int(attributes.sequenceCount)
    check_planes(counts, frame, dtype, stored)
    require_plausible(byte_count(frame, dtype), path.stat().st_size)
    # 3. the positions, each with the frames of its number in the loop
    place = axes.find("P")
    points: Any = next((loop.parameters.points for loop in loops if loop.type == "XYPosLoop"), [])
    lead = [n for n in range(len(axes)) if n != place]
    sizes = [*(counts[n] for n in lead), frame[0]]
    x, y, z = (float(step) for step in source.voxel_size())
    dyes = [channel.channel for channel in source.metadata.channels]
    names = tuple(Channel(dye.name or str(n), hex_color(dye.color[:3])) for n, dye in enumerate(dyes))
    images = []
    for number in range(counts[place] if place >= 0 else 1):
        name = (points[number].name if number < len(points) else "") or f"position {number}" * (place >= 0)
        read_plane = partial(_read_plane, source, frame, (counts, place, number))
        planes = Planes(sizes, frame[1:] if is_color else plane, dtype, read_plane)
        images.append(
            Image(
                name,
                "".join(axes[n] for n in lead) + "CYX" + "S" * is_color,
                planes.shape,
                partial(lambda planes: planes, planes),
                names,
                even_spacing(x, y, z if "Z" in axes else 0.0),
                "um" if x > 0 else "",
                _time_step(source),
                max(math.prod(counts) - stored, 0),
            )
        )
    return images


def _read_plane(
    source: Any, shape: tuple[int, ...], position: tuple[list[int], int, int], index: tuple[int, ...]
) -> np.ndarray:
    """The plane of an index along all loops but that of positions, and of a channel. shape: of a frame [C, Y, X, S].
    position: sizes of the loops, the place of positions among them or -1, and the position.
    """
    counts, place, number = position
    loops = list(index[:-1])
    if place >= 0:
        loops.insert(place, number)
    # the last loop runs fastest
    frame = np.asarray(source.read_frame(int(np.ravel_multi_index(loops, counts)) if loops else 0))
    if frame.size != math.prod(shape):
        raise expected("frame", str(shape), frame.shape, "the file is damaged")
    # the library squeezes axes of one entry
    plane = frame.reshape(shape)[index[-1]]
    return plane if shape[3] > 1 else plane[..., 0]


def _time_step(source: Any) -> float | None:
    """Seconds between time points, None if unknown."""
    loop = next((loop for loop in source.experiment if loop.type == "TimeLoop"), None)
    period = float(loop.parameters.periodMs) / 1000 if loop is not None else 0.0
    return period if period > 0 and math.isfinite(period) else None
