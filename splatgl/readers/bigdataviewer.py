"""BigDataViewer: an XML file of views, and their samples in HDF5, with levels, time points and registrations.

Format: "BigDataViewer: XML + HDF5 format", imagej.net. A view is a setup at a time point; setups that differ in their
channel alone are the channels of one image. Samples are unsigned, though HDF5's type says signed.
"""

from __future__ import annotations

import re
from collections import defaultdict
from dataclasses import dataclass, replace
from functools import partial
from operator import methodcaller
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np

from splatgl.data.affine import unit_name, volume_on_grid
from splatgl.data.arrays import ConvertedArray
from splatgl.data.volume import Lengths, Volume
from splatgl.errors import expected
from splatgl.readers.channels import MOST_CHANNELS, Channel, ChannelSet, mark_microscope
from splatgl.readers.common import decoder_errors, find_data_file, parse_xml
from splatgl.readers.hdf5_files import find_node, open_hdf5, read_samples
from splatgl.readers.options import LoadOptions
from splatgl.readers.tiff_images import list_series, select_image

# most bytes of the XML, and time points
_MOST_BYTES, _MOST_TIMES = 2**26, 10**6
# relative difference of voxel sizes and registration at which the registration has other units
_OTHER_UNITS = 0.01


@dataclass(frozen=True)
class _View:
    """An image: name, a setup for each channel, time points by their numbers, and voxels along x, y, z."""

    name: str
    setups: tuple[Element, ...]
    times: tuple[int, ...]
    size: tuple[int, ...]

    @property
    def axes(self) -> str:
        """A letter for each axis of `shape`."""
        return "TCZYX"

    @property
    def shape(self) -> tuple[int, ...]:
        """Time points, channels, and voxels along z, y, x."""
        return (len(self.times), len(self.setups), *self.size[::-1])


def list_images(path: Path) -> list[str]:
    """A line for each image."""
    with decoder_errors("BigDataViewer"):
        return list_series(_find_views(_parse(path)))


def read(path: Path, options: LoadOptions) -> Volume:
    """The volume of an XML file; `series` picks an image (angle, tile, illumination), `time`, `channel` and `level` the
    rest. All levels are read; samples of more than WHOLE_BYTES are read in parts.
    """
    with decoder_errors("BigDataViewer"):
        root = _parse(path)
        views = _find_views(root)
        place, notes = select_image(views, options)
        view = views[place]
        loader = root.find("SequenceDescription/ImageLoader")
        name = None if loader is None else loader.findtext("hdf5")
        if loader is None or loader.get("format") != "bdv.hdf5" or not name:
            got = "none" if loader is None else repr(loader.get("format"))
            raise expected("ImageLoader", "bdv.hdf5", got, "save it again as XML/HDF5")
        data = find_data_file(path, name, options.anywhere)
        file = open_hdf5(data)
        named = root.findall("SequenceDescription/ViewSetups/Attributes[@name='channel']/Channel")
        names = {node.findtext("id", ""): node.findtext("name", "") for node in named}
        numbers = [setup.findtext("attributes/channel", str(n)) for n, setup in enumerate(view.setups)]
        channels = ChannelSet(tuple(Channel(names.get(n) or n) for n in numbers), False, len(view.times))
        time = view.times[options.time_number(len(view.times))]
        read_one = partial(_read_setup, data, file, root, (view, time), options)
        volume = channels.volume(options, lambda channel: read_one(view.setups[channel or 0]))
    return replace(mark_microscope(volume), notes=(*notes, *volume.notes))


def _parse(path: Path) -> Element:
    if path.stat().st_size > _MOST_BYTES:
        raise expected("XML", f"at most {_MOST_BYTES} bytes", path.stat().st_size)
    root = parse_xml(path.read_bytes(), "BigDataViewer's XML")
    if root.tag != "SpimData":
        raise expected("XML", "an element SpimData", repr(root.tag), "is this a file of BigDataViewer?")
    return root


def _find_views(root: Element) -> list[_View]:
    """The images: groups of setups of one size that differ in their channel alone."""
    times = _read_times(root.find("SequenceDescription/Timepoints"))
    groups = defaultdict[tuple[Any, ...], list[Element]](list)
    for setup in root.findall("SequenceDescription/ViewSetups/ViewSetup")[:MOST_CHANNELS]:
        size = tuple(int(word) for word in setup.findtext("size", "").split())
        others = tuple((node.tag, node.text) for node in setup.find("attributes") or () if node.tag != "channel")
        groups[size, others].append(setup)
    views = []
    for (size, others), setups in groups.items():
        name = ", ".join(f"{tag} {text}" for tag, text in others) if len(groups) > 1 else ""
        views.append(_View(name or setups[0].findtext("name", ""), tuple(setups), times, size))
    return views


def _read_times(node: Element | None) -> tuple[int, ...]:
    """The numbers of the time points: a range, or a list as "0-4,7" or "0-8:2"."""
    if node is None:
        return (0,)
    if node.get("type") == "range":
        first, last = (int(node.findtext(name, "0")) for name in ("first", "last"))
        text = f"{first}-{last}"
    else:
        text = (node.findtext("integerpattern") or node.text or "0").strip() or "0"
    times = list[int]()
    for part in text.split(","):
        match = re.fullmatch(r"\s*(\d{1,7})(?:-(\d{1,7})(?::(\d{1,7}))?)?\s*", part)
        if match is None or (match[3] and not int(match[3])):
            raise expected("Timepoints", "numbers as 0-4,7", repr(text[:40]))
        times += range(int(match[1]), int(match[2] or match[1]) + 1, int(match[3] or 1))
        if len(times) > _MOST_TIMES:
            raise expected("Timepoints", f"at most {_MOST_TIMES}", "more")
    return tuple(times)


def _read_setup(
    path: Path, file: Any, root: Element, view: tuple[_View, int], options: LoadOptions, setup: Element
) -> Volume:
    """The volume of a setup at a time point, with its coarser levels. view: the image, and the time point's number."""
    image, time = view
    number = int(setup.findtext("id", "0"))
    # 1. levels: factors along x, y, z
    node = find_node(file, f"s{number:02}/resolutions", anywhere=False)
    if not hasattr(node, "shape") or len(node.shape) != 2 or node.shape[1] != 3 or not 0 < node.shape[0] <= 64:
        raise expected(f"s{number:02}/resolutions", "three factors a level", "none", "is this the right HDF5 file?")
    factors = np.asarray(node[()], np.float64)
    # 2. the grid of the finest level, and the samples
    matrix, origin, unit = _find_grid(root, setup, time)
    volumes = []
    for level in options.level_numbers(len(factors)):
        name = f"t{time:05}/s{number:02}/{level}/cells"
        cells = find_node(file, name, options.anywhere)
        if not hasattr(cells, "shape") or len(cells.shape) != 3 or cells.dtype.kind not in "iu":
            raise expected(name, "whole numbers [z, y, x]", "none", "the view is missing")
        if level == 0 and cells.shape != image.size[::-1]:
            raise expected(name, f"{image.size[::-1]} voxels, as the XML says", cells.shape)
        samples: Any = read_samples(path, cells, [slice(None)] * 3, options.anywhere)
        unsigned = np.dtype(f"{cells.dtype.str[0]}u{cells.dtype.itemsize}")
        if isinstance(samples, np.ndarray):
            samples = samples.view(unsigned)
        else:
            samples = ConvertedArray(samples, samples.shape, unsigned, methodcaller("view", unsigned))
        shift = (factors[level] - 1) / 2
        grid = matrix * factors[level], matrix @ shift + origin
        volumes.append(volume_on_grid(samples, *grid, "affine", unit=unit, whole=Lengths.of(matrix, image.size)))
    return replace(volumes[0], coarser=tuple(volumes[1:]))


def _find_grid(root: Element, setup: Element, time: int) -> tuple[np.ndarray, np.ndarray, str]:
    """World from the index (x, y, z) of a view: matrix [3, 3], origin, and the unit of length.

    Registrations are often in units of a voxel's width: they are scaled to the sizes of voxels that the setup states.
    """
    stated = [float(word) for word in setup.findtext("voxelSize/size", "1 1 1").split()]
    unit = unit_name(setup.findtext("voxelSize/unit", ""))
    registered = np.eye(4)
    number = setup.findtext("id", "0")
    for node in root.findall("ViewRegistrations/ViewRegistration"):
        if (node.get("timepoint"), node.get("setup")) != (str(time), number):
            continue
        # the first transformation is applied last
        for transform in node.findall("ViewTransform"):
            numbers = np.array((transform.findtext("affine") or "").split(), np.float64)
            registered = registered @ np.vstack([numbers.reshape(3, 4), [0, 0, 0, 1]])
    matrix, origin = registered[:3, :3], registered[:3, 3]
    lengths = np.linalg.norm(matrix, axis=0)
    if len(stated) != 3 or not (np.array(stated) > 0).all():
        return matrix, origin, ""
    scales = np.array(stated) / np.maximum(lengths, 1e-300)
    if np.ptp(scales) > _OTHER_UNITS * scales.max():
        # a registration that does not scale leaves the sizes of voxels
        turned = np.allclose(lengths, 1, atol=_OTHER_UNITS)
        return (matrix * stated, origin, unit) if turned else (matrix, origin, "")
    scale = float(scales.mean())
    return matrix * scale, origin * scale, unit
