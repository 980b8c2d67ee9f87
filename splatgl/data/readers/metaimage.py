"""MetaImage, .mha and .mhd with a data file; uncompressed samples are memory-mapped.

Format: itk.org/Wiki/MetaIO/Documentation. A row of TransformMatrix is the direction of one axis (the matrix is
stored column by column), so that its transpose is `Volume.direction`. World coordinates are ITK's: LPS.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from splatgl.data.errors import InputError, expected
from splatgl.data.readers.files import byte_count, data_file, grid_shape, inflate, library, map_array, selection
from splatgl.data.readers.grid import triple, unit_name
from splatgl.data.readers.options import LoadOptions
from splatgl.data.readers.text import read_numbers, require_end
from splatgl.data.volume import Triple, Volume

_TYPES = {
    "MET_CHAR": "i1",
    "MET_UCHAR": "u1",
    "MET_SHORT": "i2",
    "MET_USHORT": "u2",
    "MET_INT": "i4",
    "MET_UINT": "u4",
    "MET_LONG": "i4",
    "MET_ULONG": "u4",
    "MET_LONG_LONG": "i8",
    "MET_ULONG_LONG": "u8",
    "MET_FLOAT": "f4",
    "MET_DOUBLE": "f8",
}
"""numpy codes by ElementType; MetaIO's LONG has four bytes on every machine."""

_MATRIX_NAMES = ("TransformMatrix", "Rotation", "Orientation")

_LINE_LIMIT = 4096
"""Longest header line in bytes; a longer one means that the file is something else."""

_LINES_LIMIT = 10_000
"""Most header lines: the format has some forty fields, and programs add their own."""

Fields = dict[str, str]


def read(path: Path, options: LoadOptions) -> Volume:
    """The volume of a MetaImage file; `channel` picks one of several samples per voxel."""
    fields, start = _header(path)
    depth, height, width = grid_shape(_integers(fields, "DimSize"))
    channels = _integer(fields, "ElementNumberOfChannels", 1)
    shape = (depth, height, width, max(channels, 1))
    samples = _data(path, fields, start, shape, options.anywhere)
    samples = samples[selection(shape, {3: ("channel", options.channel_number)})]
    matrix = np.array(_numbers(fields, _MATRIX_NAMES, list(np.eye(3).ravel())))
    if matrix.size != 9:
        raise expected("TransformMatrix", "nine numbers", matrix.size)
    # a row of the matrix is the direction of one axis: axes become columns
    direction = matrix.reshape(3, 3).T
    return Volume(
        samples,
        _spacing(fields),
        triple(_numbers(fields, ("Offset", "Position", "Origin"), [0, 0, 0]), "Offset"),
        direction,
        unit_name(fields.get("DistanceUnits", "")),
        frame=_frame(fields),
    )


def _header(path: Path) -> tuple[Fields, int]:
    """Fields up to ElementDataFile, which is the last one, and the byte after it."""
    fields: Fields = {}
    lines = 0
    with path.open("rb") as file:
        while "ElementDataFile" not in fields:
            line = file.readline(_LINE_LIMIT)
            key, equals, value = line.decode("latin-1").partition("=")
            if (line.strip() and not equals) or len(line) == _LINE_LIMIT or not key.strip().isascii():
                raise expected("header", "lines 'key = value'", repr(line[:16]), "is this a MetaImage file?")
            if not line:
                raise expected("header", "a last line 'ElementDataFile = …'", "none", "the file is cut short")
            lines += 1
            if lines > _LINES_LIMIT:
                raise expected("header", f"at most {_LINES_LIMIT} lines", "more", "is this a MetaImage file?")
            if equals:
                fields[key.strip()] = value.strip()
        start = file.tell()
    if fields.get("NDims") != "3":
        raise expected("NDims", "3", fields.get("NDims", "none"))
    return fields, start


def _data(path: Path, fields: Fields, start: int, shape: tuple[int, ...], anywhere: bool) -> np.ndarray:
    dtype = _dtype(fields)
    # 1. where: here, or in one file beside
    name = fields["ElementDataFile"]
    if name.upper() not in ("LOCAL", "LIST") and "%" not in name:
        path, start = data_file(path, name, anywhere), 0
    elif name.upper() != "LOCAL":
        raise expected("ElementDataFile", "LOCAL or one file", repr(name), "join the slices in one file")
    # 2. how: text, zlib, or as it is; HeaderSize -1 counts from the end
    if not _flag(fields, "BinaryData", True):
        return _text(path, start, dtype, shape)
    skip = _integer(fields, "HeaderSize", 0)
    if skip < -1:
        raise expected("HeaderSize", "-1 (from the end), 0 or more", skip)
    if _flag(fields, "CompressedData", False):
        return inflate(path, start + max(skip, 0), dtype, shape)
    if skip == -1:
        start, skip = max(path.stat().st_size - byte_count(shape, dtype), 0), 0
    return map_array(path, start + skip, dtype, shape)


def _dtype(fields: Fields) -> np.dtype:
    name = fields.get("ElementType", "none").removesuffix("_ARRAY")
    if name not in _TYPES:
        raise expected("ElementType", "a MetaImage number type such as MET_SHORT", name)
    big = _flag(fields, "ElementByteOrderMSB", False) or _flag(fields, "BinaryDataByteOrderMSB", False)
    return np.dtype(_TYPES[name]).newbyteorder(">" if big else "<")


def _text(path: Path, start: int, dtype: np.dtype, shape: tuple[int, ...]) -> np.ndarray:
    with path.open("rb") as file, library("MetaImage text data"):
        file.seek(start)
        count = byte_count(shape, np.dtype("u1"))
        numbers = read_numbers(file, count, dtype, path.stat().st_size - start)
        require_end(file, count)
        return numbers.reshape(shape)


def _spacing(fields: Fields) -> Triple:
    return triple(_numbers(fields, ("ElementSpacing", "ElementSize"), [1, 1, 1]), "ElementSpacing")


def _frame(fields: Fields) -> str | None:
    """LPS, the convention of ITK, if the file states an orientation at all."""
    named = fields.get("AnatomicalOrientation", "???").strip("?") != ""
    return "LPS" if named or any(name in fields for name in _MATRIX_NAMES) else None


def _flag(fields: Fields, name: str, default: bool) -> bool:
    return fields.get(name, str(default)).lower() in ("true", "1")


def _integers(fields: Fields, name: str) -> list[int]:
    try:
        return [int(word) for word in fields.get(name, "").split()]
    except ValueError:
        raise expected(name, "whole numbers", repr(fields[name])) from None


def _integer(fields: Fields, name: str, default: int) -> int:
    """The one whole number of a field, or the default if it is not there."""
    numbers = _integers({name: str(default), **fields}, name)
    if len(numbers) != 1:
        raise expected(name, "one whole number", repr(fields[name]))
    return numbers[0]


def _numbers(fields: Fields, names: tuple[str, ...], default: list[float]) -> list[float]:
    """The numbers of the first field that is there."""
    for name in names:
        if name in fields:
            try:
                return [float(word) for word in fields[name].split()]
            except ValueError:
                raise _not_numbers(name, fields[name]) from None
    return default


def _not_numbers(name: str, text: str) -> InputError:
    return expected(name, "numbers", repr(text))
