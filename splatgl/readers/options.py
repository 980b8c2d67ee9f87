"""`LoadOptions`, and paths of datasets: FILE.h5:/NAME."""

from __future__ import annotations

import re
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np

from splatgl.data.volume import Triple
from splatgl.errors import InputError, expected

HDF5 = (".h5", ".hdf5", ".he5", ".nc")
"""Endings of files that hold named datasets."""

_INSIDE = re.compile(rf"(?is)(.+(?:{'|'.join(map(re.escape, HDF5))})):(/.+)")

_FIJI = "save it as TIFF with Fiji (Bio-Formats)"
_PARAVIEW = "turn it into a .vti with ParaView's filter Resample To Image"
_SURFACE = "surfaces are not drawn; voxelize it"

CONVERTERS = {
    **dict.fromkeys((".czi", ".lif", ".nd2", ".oib", ".oif", ".lsm", ".vsi", ".dv", ".sld", ".ics", ".xml"), _FIJI),
    **dict.fromkeys(
        (".svs", ".ndpi", ".mrxs", ".scn"), "a slide is one plane; save a stack as OME-TIFF with Bio-Formats"
    ),
    **dict.fromkeys((".vtu", ".vts", ".pvtu", ".pvts"), _PARAVIEW),
    **dict.fromkeys((".vtp", ".pvtp", ".ply", ".stl", ".obj", ".off", ".glb", ".gltf"), _SURFACE),
    ".mat": "save the array with numpy.save, in the order [z, y, x]",
    ".mnc": "convert it with mnc2nii",
    ".st": "a tilt series is no volume; reconstruct it, such as with IMOD",
    ".ali": "a tilt series is no volume; reconstruct it, such as with IMOD",
    ".vdb": "save a dense array with numpy.save, in the order [z, y, x]",
    ".grb": "convert it with: cdo -f nc4 copy OLD NEW.nc",
    ".grib": "convert it with: cdo -f nc4 copy OLD NEW.nc",
    ".grib2": "convert it with: cdo -f nc4 copy OLD NEW.nc",
    ".hdf": "convert HDF4 with h4toh5; HDF5 is read as .h5",
    ".ozx": "it is a Zarr store in a zip: unpack it into a folder with: unzip FILE -d NAME.zarr",
    ".zarr.zip": "it is a Zarr store in a zip: unpack it into a folder with: unzip FILE -d NAME.zarr",
    ".7z": "unpack it",
    ".gz": "unpack it",
    ".bz2": "unpack it",
}
"""What to do with files that are not read, by ending."""


def inside(source: str) -> tuple[str, str | None]:
    """The file and the array in it of FILE.h5:/a/b; any other source as it is, and None."""
    found = _INSIDE.fullmatch(source)
    return (found[1], found[2]) if found else (source, None)


def converter(name: str) -> str:
    """What to do with a file of that name, which is not read; "" if that is not known."""
    low = name.lower()
    return next((fix for ending, fix in CONVERTERS.items() if low.endswith(ending)), "")


DEFAULT_LEVELS = 103
"""Voxel levels of a terrain: the height of the terrain volume in [M98], 512 × 512 × 103."""

VALUES = ("labels", "amounts", "heights")
"""What samples may be."""

_NAMED_DTYPE = re.compile(r"(bool|u?int8|u?int16|u?int32|u?int64|float16|float32|float64)(le|be)?")

_TYPES: dict[str, tuple[tuple[type, ...], str]] = {
    "dtype": ((str,), "the name of a type"),
    "header_offset": ((int,), "a whole number of bytes"),
    "array": ((str, int), "a name or a number"),
    "channel": ((int, str), "a number, a name, several of them, or all"),
    "time": ((int,), "a whole number"),
    "level": ((int,), "a whole number"),
    "series": ((str, int), "a number or the end of a UID"),
    "color": ((str, Path), "the path of a picture"),
    "relief": ((int, float), "a positive height in world units"),
    "levels": ((int,), "a whole number"),
    "values": ((str,), "labels, amounts or heights"),
    "anywhere": ((bool,), "true or false"),
}
"""What an option may be, and how that is said."""


@dataclass(frozen=True)
class LoadOptions:
    """Options for a file beyond its path; each format supports some of these and rejects the others.

    shape: voxels along (x, y, z), x fastest; dtype: "uint8", "uint16be", ">u2"; header_offset: bytes to skip (raw).
    spacing: (x, y, z) in world units, overrides what the file says.
    array: name of the array (npz, VTK, zarr) or number of the time point (NIfTI, TIFF, DICOM).
    channel: number of the channel of a file with several samples per voxel; of TIFF and Zarr also its name, several
    ("0,2", "DAPI,GFP") or "all". time: number of the time point, from 0. level: of a multiscale image, 0 the finest.
    series: number of a DICOM series in the list of `splatgl info`, from 1 on, or the end of its UID.
    color: path of the colour picture of a height map; relief: the world height that the map spans;
    levels: voxel levels of the terrain.
    values: "labels" or "amounts", what samples are, where the file does not say or says it wrongly; "heights" of a
    terrain, of a single picture.
    anywhere: the data of a detached header may lie outside its folder; only for trusted headers.
    Raises InputError for values that no file could have.
    """

    shape: tuple[int, int, int] | None = None
    dtype: str | None = None
    spacing: Triple | None = None
    header_offset: int = 0
    array: str | int | None = None
    channel: int | str | None = None
    time: int | None = None
    level: int | None = None
    series: str | int | None = None
    color: str | Path | None = None
    relief: float | None = None
    levels: int = DEFAULT_LEVELS
    values: str | None = None
    anywhere: bool = False

    def __post_init__(self) -> None:
        # 1. types: options also come from command lines and scene files
        for name, (types, this) in _TYPES.items():
            value = getattr(self, name)
            if value is not None and (not isinstance(value, types) or isinstance(value, bool) != (bool in types)):
                raise expected(name, this, repr(value))
        for name in ("shape", "spacing"):
            _set_triple(self, name)
        for name in ("array", "series"):
            if getattr(self, name) is not None:
                object.__setattr__(self, name, str(getattr(self, name)))
        # 2. values
        if self.dtype is not None:
            sample_type(self.dtype)
        if self.header_offset < 0:
            raise expected("header_offset", "zero or more bytes", self.header_offset)
        if isinstance(self.channel, str) and re.fullmatch("[0-9]{1,6}", self.channel):
            object.__setattr__(self, "channel", int(self.channel))
        for name in ("channel", "level", "time"):
            value = getattr(self, name)
            if isinstance(value, int) and value < 0:
                raise expected(name, "zero or more", value)
        if self.values not in (None, *VALUES):
            raise expected("values", "labels, amounts or heights", repr(self.values))
        if self.levels < 2:
            raise expected("levels", "two or more voxel levels", self.levels)
        if self.relief is not None and not 0 < self.relief < np.inf:
            raise expected("relief", "a positive height in world units", self.relief)

    @property
    def given(self) -> set[str]:
        """Names of the options that differ from their defaults."""
        return {option.name for option in fields(self) if getattr(self, option.name) != option.default}

    @property
    def channel_number(self) -> int | None:
        """`channel`, of a format whose channels have no names."""
        if isinstance(self.channel, str):
            raise expected("channel", "a whole number", repr(self.channel))
        return self.channel

    def refuse(self, name: str, this: str) -> None:
        """InputError for an option of what the file has none or one of; the number of the one is no error.

        this: what would have it, in words.
        """
        value = getattr(self, name)
        if value not in (None, 0, "0"):
            raise expected(name, this, repr(value), "leave it out")

    def time_number(self, count: int) -> int:
        """The time point below `count`: `time`, else `array`, else the first. InputError if both are given."""
        if self.time is not None and self.array is not None:
            raise expected("array", "none beside time", repr(self.array), "leave one of them out")
        if self.time is not None and self.time >= count:
            raise expected("time", f"a number from 0 to {count - 1}", self.time)
        return self.time if self.time is not None else self.array_number(count) or 0

    def array_number(self, count: int) -> int | None:
        """`array` as a number below `count`, or None if it was not given."""
        if self.array is None:
            return None
        if not re.fullmatch("[0-9]{1,9}", str(self.array)) or int(self.array) >= count:
            raise expected("array", f"a number from 0 to {count - 1}", repr(self.array))
        return int(self.array)


def _set_triple(options: LoadOptions, name: str) -> None:
    """Converts `shape` to three positive ints, `spacing` to three positive floats; lists are accepted."""
    value = getattr(options, name)
    if value is None:
        return
    kind, this = (int, "positive whole numbers") if name == "shape" else (float, "positive numbers")
    try:
        numbers = tuple(kind(number) for number in value)
    except (TypeError, ValueError):
        numbers = ()
    if len(numbers) != 3 or not all(0 < number < np.inf for number in numbers) or list(numbers) != list(value):
        raise expected(name, f"three {this} (x, y, z)", repr(value))
    object.__setattr__(options, name, numbers)


def sample_type(text: str) -> np.dtype:
    """The dtype named by "uint8", "uint16be", "float32le" or a numpy code such as ">u2"; little-endian if unsaid."""
    named = _NAMED_DTYPE.fullmatch(text.lower())
    try:
        dtype = np.dtype(named[1]).newbyteorder(">" if named[2] == "be" else "<") if named else np.dtype(text)
    except TypeError:
        raise _bad_dtype(text) from None
    if dtype.kind not in "buif":
        raise _bad_dtype(text)
    return dtype


def _bad_dtype(text: str) -> InputError:
    return expected("dtype", 'a real number type such as uint8, uint16be, float32 or ">u2"', repr(text))
