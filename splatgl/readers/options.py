"""`LoadOptions`, paths of datasets (FILE.h5:/NAME), and the table of formats with the options of each."""

from __future__ import annotations

import re
from argparse import ArgumentTypeError
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from splatgl.data.times import is_time
from splatgl.data.volume import Triple, Volume
from splatgl.errors import InputError, MissingOption, expected
from splatgl.options import HelpGroup, ValueKind, check_options, checked, declared, non_default, option, reject_unknown
from splatgl.readers.contents import FIXES, OTHER_GZIP

# endings of files that hold named datasets
HDF5 = (".h5", ".hdf5", ".he5", ".hdf", ".nc", ".nc4", ".emd", ".nxs", ".mat", ".vtkhdf", ".cmap")

# endings of VTK's grids of cells, pieces, blocks and AMR
VTK_DATA = (".vtu", ".vts", ".pvti", ".pvtr", ".pvtu", ".pvts", ".vtm", ".vthb", ".vth")

_INSIDE = re.compile(rf"(?is)(.+(?:{'|'.join(map(re.escape, HDF5))})):([/\\].+)")

_FIJI = "save it as TIFF with Fiji (Bio-Formats)"
SURFACE = "it is a surface: --mesh and sg.load_mesh read it"

# advice for files that are not read, by ending
CONVERTERS = {
    **dict.fromkeys((".oir", ".vsi", ".dv", ".sld", ".ics", ".ids", ".zvi", ".dm3", ".dm4", ".mvd2"), _FIJI),
    **dict.fromkeys(
        (".svs", ".ndpi", ".mrxs", ".scn"), "a slide is one plane; save a stack as OME-TIFF with Bio-Formats"
    ),
    **dict.fromkeys((".vtp", ".pvtp", ".stl", ".obj", ".off", ".glb", ".gltf"), SURFACE),
    **dict.fromkeys((".e57", ".xyz", ".pts"), "save the points as .las or .ply, such as with CloudCompare"),
    **dict.fromkeys((".j2k", ".jxl"), FIXES["JPEG 2000"]),
    **dict.fromkeys((".asc", ".hgt", ".dem", ".bil", ".flt", ".adf"), "convert it with: gdal_translate OLD NEW.tif"),
    ".gipl": "save it as .nii.gz or .mha, such as with SimpleITK",
    **dict.fromkeys((".st", ".ali"), "a tilt series is no volume; reconstruct it, such as with IMOD"),
    ".vdb": "save a dense array with numpy.save, in the order [z, y, x]",
    **dict.fromkeys((".grb", ".grib", ".grib2"), FIXES["GRIB"]),
    ".n5": "save it as OME-Zarr with Fiji (Export to N5/Zarr/OME-NGFF): no maintained Python library reads N5",
    **dict.fromkeys((".7z", ".gz", ".bz2", ".xz", ".zst"), FIXES["gzip"]),
}


def inside(source: str) -> tuple[str, str | None]:
    """File and array of FILE.h5:/a/b; another source and None."""
    match = _INSIDE.fullmatch(source)
    # a path of Windows has the slashes of the array turned round
    return (match[1], match[2].replace("\\", "/") if match[2][0] == "\\" else match[2]) if match else (source, None)


def converter(name: str) -> str:
    """Advice for a file that is not read, by its name; "" for an unknown ending."""
    low = name.lower()
    return next((fix for ending, fix in CONVERTERS.items() if low.endswith(ending)), "")


# voxel levels of a terrain, as of the terrain in [M98], 512 × 512 × 103
DEFAULT_LEVELS = 103

# meanings of samples
VALUES = ("labels", "amounts", "heights")

_NAMED_DTYPE = re.compile(r"(bool|u?int8|u?int16|u?int32|u?int64|float16|float32|float64)(le|be)?")


def sample_type(text: str) -> np.dtype:
    """The dtype named by "uint8", "uint16be", "float32le" or a numpy code such as ">u2"; little-endian if unsaid."""
    named = _NAMED_DTYPE.fullmatch(text.lower())
    try:
        dtype = np.dtype(named[1]).newbyteorder(">" if named[2] == "be" else "<") if named else np.dtype(text)
    except TypeError:
        dtype = np.dtype(object)
    if dtype.kind not in "buif":
        raise expected("dtype", 'a real number type such as uint8, uint16be, float32 or ">u2"', repr(text))
    return dtype


def _dtype(text: Any) -> str:
    if not isinstance(text, str):
        raise ValueError
    sample_type(text)
    return text


def _text(value: Any) -> str:
    if not isinstance(value, str | int) or isinstance(value, bool):
        raise ValueError
    return str(value)


def _channel(value: Any) -> int | str:
    if isinstance(value, str) and not re.fullmatch("[0-9]{1,6}", value):
        return value
    return ValueKind.whole(0, this="zero or more").check(int(value) if isinstance(value, str) else value)


def _time(value: Any) -> int | str:
    """A number of a time point, or the text of a time; numbers that are not whole are times. ValueError for others."""
    if isinstance(value, float | np.floating):
        return repr(float(value))
    return value if isinstance(value, str) and is_time(value) else ValueKind.whole(0).check(value)


def read_time(text: str) -> int | slice | str:
    """A time point, its time, or time points FIRST:END:STEP as in Python. Raises ValueError for other text."""
    if is_time(text):
        return text
    parts = [int(part) if part else None for part in text.split(":")]
    if len(parts) == 1 and parts[0] is not None:
        return parts[0]
    if len(parts) not in (2, 3) or (len(parts) == 3 and parts[2] == 0):
        raise ValueError
    return slice(*parts)


def _check_pairs(value: Any) -> tuple[tuple[str, Any], ...]:
    """Pairs of a mapping, or of pairs, by their names. ValueError for others."""
    pairs = dict(value)
    if not pairs or not all(isinstance(name, str) for name in pairs):
        raise ValueError
    return tuple(sorted(pairs.items()))


def _read_pairs(text: str) -> tuple[tuple[str, str], ...]:
    pairs = [part.partition("=") for part in text.split(",")]
    if not all(name and mark for name, mark, _ in pairs):
        raise ValueError
    return tuple((name.strip(), value.strip()) for name, _, value in pairs)


_option = partial(option, group=HelpGroup.READING)


@dataclass(frozen=True)
class LoadOptions:
    """Options of reading a file; each format supports some of them, and rejects others.

    dtype: "uint8", "uint16be", ">u2". array: a name (npz, VTK, Zarr) or the number of a time point (NIfTI, TIFF,
    DICOM). channel: several are "0,2", "DAPI,GFP" or "all". series: from 1 on. levels: voxel levels of a height map.
    Raises InputError for values that no file could have.
    """

    shape: tuple[int, int, int] | None = _option(
        None,
        ValueKind.numbers(3, "X,Y,Z", "three positive whole numbers (x, y, z)", integers=True, positive=True),
        "voxels along x, y, z of a headerless file",
    )
    dtype: str | None = _option(
        None,
        ValueKind("the name of a type", _dtype, metavar="TYPE", hint="str"),
        "sample type of a headerless file, such as uint8, int16, >u2 or float32",
    )
    spacing: Triple | None = _option(
        None,
        ValueKind.numbers(3, "X,Y,Z", "three positive numbers (x, y, z)", positive=True),
        "voxel spacing, instead of the file's, in its unit",
        level="basic",
    )
    header_offset: int = _option(
        0,
        ValueKind.whole(0, this="zero or more bytes", metavar="BYTES"),
        "bytes to skip in a headerless file",
        flag="--offset",
    )
    array: str | int | None = _option(
        None,
        ValueKind("a name or a number", _text, hint="str | int"),
        "array, block or step of a file with several",
    )
    channel: int | str | None = _option(
        None,
        ValueKind(
            "a number of zero or more, a name, several of them, or all", _channel, metavar="N|NAME,…", hint="int | str"
        ),
        "number of a channel, from 0. Of TIFF, Zarr and Imaris also its name, several, or all",
        level="basic",
    )
    time: int | str | None = _option(
        None,
        ValueKind(
            "zero or more, or a time such as 1.5s",
            _time,
            read_time,
            "N|TIME",
            written="a number, a time such as 1.5s, or FIRST:END:STEP",
            hint="int | float | str",
        ),
        "time point of a file, from 0, or its time, such as 2.0, 1.5s or 2019-03-21. animate and convert take several, "
        "FIRST:END:STEP",
    )
    level: int | None = _option(
        None,
        ValueKind.whole(0, this="zero or more"),
        "level of a multiscale OME-Zarr or TIFF image, 0 is the finest (by the view)",
    )
    series: str | int | None = _option(
        None,
        ValueKind("a number or the end of a UID", _text, metavar="N|UID", hint="str | int"),
        "DICOM series, or image, scene or position of a file: its number in splatgl info, UID or name",
    )
    well: str | None = _option(
        None, ValueKind("the path of a well", _text, metavar="ROW/COLUMN", hint="str"), "well of a plate, such as B/3"
    )
    field: int | None = _option(
        None, ValueKind.whole(0, this="zero or more"), "number of a field of a plate's well, from 0"
    )
    color: str | Path | None = _option(
        None,
        ValueKind.instance("the path of a picture", str, Path, metavar="PICTURE"),
        "colour picture laid over a height map",
    )
    relief: float | None = _option(
        None,
        ValueKind.number("a positive height in world units", 0, above=True, metavar="L"),
        "height of a height map's relief, world units",
    )
    levels: int = option(DEFAULT_LEVELS, ValueKind.whole(2, this="two or more voxel levels"))
    values: str | None = _option(
        None,
        ValueKind.choice(VALUES, "labels, amounts or heights"),
        "meaning of samples. Default: as the file says, else labels if equal samples form flat areas",
    )
    point_size: float | None = _option(
        None,
        ValueKind.number("a positive length in world units", 0, above=True, metavar="L"),
        "diameter of a cloud's points, world units (default: the file's, else their spacing)",
    )
    anywhere: bool = _option(
        False,
        ValueKind.flag(),
        "read the data of a detached header outside its folder, too. For trusted files only",
        bare=True,
    )

    own: tuple[tuple[str, Any], ...] | None = _option(
        None,
        ValueKind(
            "names and values of options",
            _check_pairs,
            _read_pairs,
            "NAME=VALUE,…",
            hint="Mapping[str, object]",
        ),
        "options that a plug-in's format has of its own",
        flag="--reader-option",
    )

    def __post_init__(self) -> None:
        check_options(self)

    @property
    def given(self) -> set[str]:
        """Names of the options that differ from their defaults."""
        return set(non_default(self))

    def channel_number(self, count: int) -> int | None:
        """`channel` below `count` of a format without channel names, or None if it was not given."""
        if isinstance(self.channel, str):
            raise expected("channel", "a whole number", repr(self.channel))
        return self._below("channel", count)

    def _below(self, name: str, count: int) -> int | None:
        """The number that an option states, None without one. Raises InputError for others than those below `count`."""
        number: int | None = getattr(self, name)
        if number is not None and number >= count:
            raise expected(name, f"a number from 0 to {count - 1}", number)
        return number

    def index(self, shape: Sequence[int], picked: Mapping[int, str | int]) -> tuple[int | slice, ...]:
        """The index of an array that picks one entry along some axes, and keeps the others.

        picked: axis → the entry, or the option that states it: time, array or channel. Raises InputError for an entry
        that the axis lacks, and Choice if the option has to pick one.
        """
        index: list[int | slice] = [slice(None)] * len(shape)
        for axis, name in picked.items():
            count = int(shape[axis])
            if isinstance(name, int):
                index[axis] = name
                continue
            numbers = {"time": self.time_number, "array": self.array_number, "channel": self.channel_number}
            entry = numbers[name](count)
            if entry is None and count > 1:
                fix = f"pick one with {name}=0 … {name}={count - 1}"
                error = expected("axes", "one sample per voxel", f"{count} along an extra axis", fix)
                place = f"along one axis of {' × '.join(map(str, shape))}"
                raise MissingOption(str(error), name, [(f"0 … {count - 1}", place)])
            index[axis] = entry or 0
        return tuple(index)

    def level_numbers(self, count: int) -> range:
        """The level that `level` picks, else all of `count` levels."""
        level = self._below("level", count)
        return range(count) if level is None else range(level, level + 1)

    def reject(self, name: str, this: str) -> None:
        """InputError for an option that the file does not support; 0 is accepted. this: files that support it."""
        value = getattr(self, name)
        if value not in (None, 0, "0"):
            raise expected(name, this, repr(value), "leave it out")

    def time_number(self, count: int) -> int:
        """The time point below `count`: `time`, else `array`, else the first. InputError if both are given."""
        if self.time is not None and self.array is not None:
            raise expected("array", "none together with time", repr(self.array), "leave one of them out")
        return (self._below("time", count) if self.array is None else self.array_number(count)) or 0

    @property
    def point(self) -> int:
        """The number of the time point, 0 by default; `load` has replaced times by numbers."""
        return int(self.time or 0)

    def array_number(self, count: int) -> int | None:
        """`array` as a number below `count`, or None if it was not given."""
        if self.array is None:
            return None
        if not re.fullmatch("[0-9]{1,9}", str(self.array)) or int(self.array) >= count:
            raise expected("array", f"a number from 0 to {count - 1}", repr(self.array))
        return int(self.array)


@dataclass(frozen=True)
class Format:
    """A format: its name, suffixes, reader and supported options. Of another package it is what an entry point of the
    group `splatgl.readers` leads to.

    reader, tells, lists: functions, or places of functions: module.function of this folder, PACKAGE.MODULE:FUNCTION of
    any. reader: returns the volume of a path and `LoadOptions`. own: dataclass of options, fields by `option`, that no
    other format has; the reader gets an instance of it as a third argument.

    signatures: kinds of contents (contents.py) next to the title; "?" bytes of no known kind, "*" any bytes, "no bytes"
    none. kinds: a volume is a "file", a "folder", or either. detect: function of a path (module.function) that
    recognizes the format by the contents of a file or folder. list_volumes: function that returns a line for each
    volume in it.
    """

    title: str
    suffixes: tuple[str, ...]
    reader: str | Callable[..., Volume]
    options: tuple[str, ...] = ()
    signatures: tuple[str, ...] = ()
    kinds: tuple[str, ...] = ("file",)
    detect: str | Callable[[Path], bool] = ""
    list_volumes: str | Callable[[Path], list[str]] = ""
    own: type | None = None

    def own_options(self, options: LoadOptions) -> tuple[Any, ...]:
        """The instance of `own`, if the format has options of its own. Raises InputError for other names and values."""
        if self.own is None:
            return ()
        known, given = declared(self.own), dict(options.own or ())
        reject_unknown("own", given, known, f"some of {', '.join(known)} for {self.title}")
        read = {}
        for name, value in given.items():
            kind = known[name].kind
            try:
                # text is of the command line
                read[name] = kind.parse(value) if isinstance(value, str) else checked(kind, name, value)
            except ArgumentTypeError as error:
                raise InputError(f"{name}: {error}") from error
        return (self.own(**read),)


_PICTURES = ("PNG", "JPEG", "BMP")
_TERRAIN = ("color", "relief", "levels")
_ZARR = ("array", "channel", "field", "level", "time", "well")
_HDF5 = ("array", "channel", "time", "anywhere")
_TIFF = ("array", "channel", "level", "time", "series")
_MICROSCOPE = ("array", "channel", "time", "series")
_NIFTI, _VTK = ("array", "channel", "time"), ("array", "channel", "time", "anywhere")
_MRC = (".mrc", ".map", ".rec", ".ccp4", ".mrc.gz", ".map.gz", ".mrc.bz2", ".map.bz2")

# all formats; each but points takes `spacing` and `values` too
FORMATS = (
    Format("NumPy", (".npy",), "raw.read_npy", ("channel",)),
    Format("NumPy archive", (".npz",), "raw.read_npz", ("array", "channel")),
    Format("raw", (".raw", ".bin", ".dat"), "raw.read", ("shape", "dtype", "header_offset"), ("*",)),
    Format("NRRD", (".nrrd", ".nhdr"), "nrrd.read", ("array", "channel", "time", "anywhere")),
    Format("NIfTI", (".nii", ".nii.gz", ".nii.bz2"), "nifti.read", _NIFTI, ("Analyze", "gzip", "bzip2")),
    Format("Analyze", (".hdr", ".img", ".hdr.gz", ".img.gz"), "nifti.read_analyze", _NIFTI, ("?", "gzip", OTHER_GZIP)),
    Format("MGH", (".mgh",), "nifti.read_mgh", ("array",), ("?",)),
    Format("MGH, gzipped", (".mgz",), "nifti.read_mgh", ("array",), ("MGH", "gzip")),
    Format("TIFF", (".tif", ".tiff", ".lsm"), "tiff.read", (*_TIFF, *_TERRAIN), list_volumes="tiff.list_images"),
    Format("MetaImage", (".mha", ".mhd"), "metaimage.read", ("channel", "time", "anywhere"), ("?",)),
    Format("legacy VTK", (".vtk",), "vtk_images.read_legacy", ("array", "channel")),
    Format("VTK grid", (".vti", ".vtr"), "vtk_images.read", ("array", "channel"), ("XML",)),
    Format("VTK data", (*VTK_DATA,), "vtk_files.read", (*_VTK,), ("XML",)),
    Format("VTK series", (".pvd",), "vtk_images.read_series", (*_VTK,), ("XML",)),
    Format("MRC", _MRC, "mrc.read", ("array",), ("?", "gzip", "bzip2")),
    Format("HDF5", HDF5, "hdf5.read", _HDF5, list_volumes="hdf5.list_datasets"),
    Format("NetCDF-3", (".nc", ".cdf", ".nc3"), "hdf5.read_netcdf", _HDF5, list_volumes="hdf5.list_variables"),
    Format("Imaris", (".ims",), "hdf5.read_imaris", ("array", "channel", "level", "time", "anywhere"), ("HDF5",)),
    Format(
        "BigDataViewer",
        (".xml",),
        "bigdataviewer.read",
        ("channel", "level", "time", "series", "anywhere"),
        ("XML",),
        list_volumes="bigdataviewer.list_images",
    ),
    Format("CZI", (".czi",), "czi.read", _MICROSCOPE, list_volumes="czi.list_images"),
    Format("LIF", (".lif",), "microscopes.read_lif", _MICROSCOPE, list_volumes="microscopes.list_lif"),
    Format("ND2", (".nd2",), "microscopes.read_nd2", _MICROSCOPE, ("JPEG 2000",), list_volumes="microscopes.list_nd2"),
    Format(
        "OIB",
        (".oib", ".oif"),
        "microscopes.read_oib",
        _MICROSCOPE,
        ("?", "a compound file"),
        list_volumes="microscopes.list_oib",
    ),
    Format(
        "Zarr",
        (".zarr",),
        "ome_zarr.read",
        _ZARR,
        kinds=("folder",),
        detect="ome_zarr.is_store",
        list_volumes="ome_zarr.list_images",
    ),
    Format("Zarr, zipped", (".zarr.zip", ".ozx"), "ome_zarr.read", _ZARR, list_volumes="ome_zarr.list_images"),
    Format(
        "DICOM",
        (".dcm", ".dicom", ".ima", ".zip"),
        "dicom.read",
        ("array", "channel", "series", "time"),
        # a preamble may be the header of a TIFF file
        ("ZIP", "TIFF"),
        ("file", "folder"),
        "dicom_headers.is_dicom",
        "dicom.list_series",
    ),
    Format("points", (".las", ".laz", ".pcd", ".ply"), "points.read", ("array", "point_size"), ("LAS", "PLY", "PCD")),
    Format("MINC", (".mnc",), "nifti.read_minc", ("time",), ("NetCDF-3", "HDF5")),
    Format("AFNI", (".head", ".brik", ".brik.gz"), "nifti.read_afni", ("time",), ("?", "gzip", OTHER_GZIP)),
    Format("PAR/REC", (".par",), "nifti.read_parrec", ("time",)),
    Format(
        "picture slices", (), "image_stack.read", ("channel", "time"), kinds=("folder",), detect="image_stack.is_slices"
    ),
    Format("height picture", (".png", ".jpg", ".jpeg", ".bmp"), "heightmap.read_picture", _TERRAIN, _PICTURES),
    Format("height table", (".csv",), "heightmap.read_csv", _TERRAIN, ("?",)),
    # last, as most are told by their endings alone
    Format(
        "simulation",
        (
            *(".foam", ".xdmf", ".case", ".exo", ".e", ".ex2", ".exii", ".cgns", ".cas", ".inp", ".neu", ".nek5000"),
            *(".grdecl", ".segy", ".sgy", ".cube"),
        ),
        "vtk_files.read_with_pyvista",
        ("array", "channel", "time"),
        ("?", "XML", "HDF5", "NetCDF-3", "no bytes"),
    ),
)
