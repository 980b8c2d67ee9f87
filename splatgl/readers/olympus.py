"""Olympus's OIB and OIF files, by oiffile: planes are TIFF files, in a compound file or next to the settings."""

from __future__ import annotations

import io
import math
import re
from contextlib import closing
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from splatgl.data.affine import metres_in
from splatgl.data.times import seconds_in
from splatgl.errors import expected, import_extra
from splatgl.readers.channels import Channel
from splatgl.readers.chunked import OneFile
from splatgl.readers.common import decoder_errors, parse_number, require_plausible
from splatgl.readers.elsewhere import look
from splatgl.readers.microscopes import Found, MicroscopeImage, Planes, check_planes, even_spacing, functions_of
from splatgl.readers.tiff import logged_errors
from splatgl.readers.tiff_validation import check_before_decoding

# name of a plane: s_C001Z002T003.tif; others are previews
_PLANE = re.compile(r"(?i)(?:.*[/\\])?s_?((?:[A-Z]\d{3,6})+)\.tif")
# seconds of processor time for the table of sectors
_LOOK_SECONDS = 2.0


def _open(path: Path) -> OneFile:
    oiffile = import_extra("oiffile", "Olympus's OIB files", "oiffile", "microscopes")
    if path.suffix.lower() != ".oif":
        look("olympus.check_compound", path, _LOOK_SECONDS)
    return OneFile(path, oiffile.OifFile(path))


def check_compound(path: Path) -> None:
    """Raises InputError for another compound file, and for one whose chains of sectors do not end: the library would
    follow them forever, also when it opens the file.
    """
    import oiffile

    with decoder_errors("OIB"), closing(oiffile.oiffile.CompoundFile(path)) as compound:
        for table in (compound._fat, compound._minifat):
            _check_chains(np.array(table, np.int64))
        if "OibInfo.txt" not in compound.files():
            raise expected("file", "OibInfo.txt in it", "another compound file", "is this an OIB file?")


def _check_chains(table: np.ndarray) -> None:
    """Raises InputError if a chain of sectors leads back to itself. table: the sector behind each."""
    end = len(table)
    following = np.append(np.where(table < end, table, end), end)
    for _ in range(max(end, 1).bit_length()):
        following = following[following]
    if (following != end).any():
        raise expected("sectors", "chains that end", "one that leads back to itself", "the file is damaged")


def _find_images(path: Path) -> Found:
    file = _open(path)
    source = file.file
    # 1. planes by their index, as their names have it
    planes, letters = dict[tuple[int, ...], str](), ""
    for name in source.glob("*.tif"):
        match = _PLANE.fullmatch(name)
        parts = re.findall(r"([A-Z])(\d+)", match[1].upper()) if match else []
        axes = "".join(letter for letter, _ in parts)
        if axes and len(set(axes)) == len(axes) and (not letters or axes == letters):
            letters = axes
            planes[tuple(int(digits) - 1 for _, digits in parts)] = name
    if not planes or min(map(min, planes)) < 0:
        raise expected("file", "planes named as s_C001Z001.tif", "none", "is this an OIB file?")
    counts = [max(index[n] for index in planes) + 1 for n in range(len(letters))]
    # 2. the first plane states the size of all
    first = _decode_plane(source, next(iter(planes.values())))
    check_planes(counts, first.shape, first.dtype, len(planes))
    array = Planes(counts, first.shape, first.dtype, partial(_read_plane, source, planes))
    # 3. the settings
    settings = source.mainfile
    steps, units = _read_steps(settings)
    spacing = even_spacing(*(steps.get(axis, 0.0) for axis in "XYZ"))
    channels = _read_channels(settings, counts[letters.index("C")] if "C" in letters else 1)
    unit = "um" if "X" in units else ""
    step, missing = steps.get("T"), math.prod(counts) - len(planes)
    axes = letters + "YX"
    return [MicroscopeImage(path.stem, axes, array.shape, lambda: array, channels, spacing, unit, step, missing)], file


def _read_plane(source: Any, planes: dict[tuple[int, ...], str], index: tuple[int, ...]) -> np.ndarray | None:
    return _decode_plane(source, planes[index]) if index in planes else None


def _decode_plane(source: Any, name: str) -> np.ndarray:
    tifffile = import_extra("tifffile", "Olympus's OIB files", "tifffile", "microscopes")
    with source.open_file(name) as file:
        data = file.read()
    with logged_errors(), tifffile.TiffFile(io.BytesIO(data)) as tiff:
        page = tiff.pages[0]
        check_before_decoding([page])
        require_plausible(page.nbytes, len(data))
        require_plausible(math.prod(page.chunks) * page.dtype.itemsize, len(data))
        plane = np.asarray(page.asarray())
    if plane.ndim != 2 or plane.dtype.kind not in "ui":
        raise expected("plane", "grey numbers [y, x]", f"{plane.dtype} {plane.shape}")
    return plane


def _read_steps(settings: Any) -> tuple[dict[str, float], set[str]]:
    """Steps along axes in micrometres and seconds, and the axes whose unit is known.

    Lengths reach from the first to the last entry; those along x and y also from edge to edge of a pixel, which the
    convert values of the reference image state.
    """
    steps, known = dict[str, float](), set[str]()
    for number in range(8):
        axis = settings.get(f"Axis {number} Parameters Common", {})
        letter, name = str(axis.get("AxisCode", "")), str(axis.get("UnitName", "")).strip()
        count, begin, end = (parse_number(axis.get(key)) for key in ("MaxSize", "StartPosition", "EndPosition"))
        scale = seconds_in(name) if letter == "T" else (metres_in(name) or 0.0) * 1e6
        if letter and scale and count > 1 and np.isfinite(end - begin):
            steps[letter] = abs(end - begin) / (count - (letter in "ZT")) * scale
            known.add(letter)
    image = settings.get("Reference Image Parameter", {})
    for letter, key in (("X", "Width"), ("Y", "Height")):
        step, scale = parse_number(image.get(f"{key}ConvertValue")), metres_in(str(image.get(f"{key}Unit")))
        if scale and 0 < step < 1e12:
            steps[letter] = step * scale * 1e6
            known.add(letter)
    return steps, known


def _read_channels(settings: Any, count: int) -> tuple[Channel, ...]:
    """Names of the channels: the dye, else the detector's."""
    names = [""] * count
    for number in range(count):
        for section in (f"GUI Channel {number + 1} Parameters", f"Channel {number + 1} Parameters"):
            part = settings.get(section, {})
            names[number] = names[number] or str(part.get("DyeName") or part.get("CH Name") or "")
    return tuple(Channel(names[number] or str(number)) for number in range(count))


list_images, read = functions_of("OIB", _find_images)
