"""MetaImage: .mha, and .mhd with a data file; uncompressed samples are memory-mapped.

Format: itk.org/Wiki/MetaIO/Documentation. A row of TransformMatrix is the direction of one axis (the matrix is
stored column by column), so that its transpose is `Volume.direction`. World coordinates are ITK's: LPS.
"""

from __future__ import annotations

import re
from dataclasses import replace
from itertools import takewhile
from pathlib import Path

import numpy as np

from splatgl.data.volume import Volume, triple
from splatgl.errors import expected
from splatgl.fileio import byte_count, decode_text
from splatgl.readers.channels import ChannelSet, split_voxels
from splatgl.readers.common import (
    convert_words,
    decoder_errors,
    find_data_file,
    grid_shape,
    inflate,
    map_array,
    read_text,
    stack_files,
)
from splatgl.readers.options import LoadOptions

# numpy codes by ElementType; MetaIO's LONG always has four bytes
TYPES = {
    **{"MET_CHAR": "i1", "MET_SHORT": "i2", "MET_INT": "i4", "MET_LONG": "i4", "MET_LONG_LONG": "i8"},
    **{"MET_UCHAR": "u1", "MET_USHORT": "u2", "MET_UINT": "u4", "MET_ULONG": "u4", "MET_ULONG_LONG": "u8"},
    **{"MET_FLOAT": "f4", "MET_DOUBLE": "f8"},
}

_MATRIX_NAMES = ("TransformMatrix", "Rotation", "Orientation")

# LPS axis and direction of an axis that comes from a side
_SIDES = {"R": (0, 1), "L": (0, -1), "A": (1, 1), "P": (1, -1), "I": (2, 1), "S": (2, -1)}
# a name with a place for a number, such as slice%03d.raw
_PATTERN = re.compile(r"[^%]*%0?[0-9]{0,2}d[^%]*")
# longest header, with comments, and longest name of a file, in bytes; longer ones mean another kind of file
_HEADER_LIMIT, _LINE_LIMIT = 2**20, 4096
# most header lines: the format has some forty fields, and programs add their own
_LINES_LIMIT = 10_000
Fields = dict[str, str]


def read(path: Path, options: LoadOptions) -> Volume:
    """The volume of a MetaImage file; `time` picks a time point of a 4-D file, `channel` one of a voxel's samples.

    Without `channel`, three or four bytes are a colour, with its luma as samples, and three signed or real numbers are
    a vector in the world, with its length as samples.
    """
    fields, files, start = _header(path)
    sizes = convert_words(fields.get("DimSize", "").split(), int, "DimSize")
    grid_shape(sizes[:3])
    if len(sizes) != _integer(fields, "NDims", 3) or min(sizes) < 1:
        raise expected("DimSize", f"{fields['NDims']} positive numbers", fields["DimSize"], "the header is damaged")
    channels = max(_integer(fields, "ElementNumberOfChannels", 1), 1)
    shape = (*sizes[::-1], channels)
    times = sizes[3] if len(sizes) > 3 else 1
    step = _numbers(fields, ("ElementSpacing", "ElementSize"), [1.0] * 4)[3:4]
    time_points = ChannelSet(times=times, step=step[0] if times > 1 and step else None)

    def read_samples(_: int | None) -> Volume:
        samples = _read_data(path, fields, (files, start), shape, options.anywhere)
        samples = samples[options.point] if len(sizes) > 3 else samples
        return _volume(samples, fields, options)

    return time_points.volume(replace(options, channel=None), read_samples)


def _volume(samples: np.ndarray, fields: Fields, options: LoadOptions) -> Volume:
    """The volume of samples [D, H, W, channels]."""
    samples, color, vectors, color_notes = split_voxels(samples, options)
    direction, frame, notes = _direction(fields)
    return Volume(
        samples,
        triple(_numbers(fields, ("ElementSpacing", "ElementSize"), [1.0] * 3)[:3], "ElementSpacing"),
        triple(_numbers(fields, ("Offset", "Position", "Origin"), [0.0] * 3)[:3], "Offset"),
        direction,
        fields.get("DistanceUnits", ""),
        frame=frame,
        color=color,
        vectors=vectors,
        notes=(*color_notes, *notes, *_ignored_notes(fields)),
    )


def _direction(fields: Fields) -> tuple[np.ndarray, str | None, tuple[str, ...]]:
    """Direction [3, 3], frame, and notes: ITK's convention, LPS, if the file states an orientation.

    A letter of AnatomicalOrientation is the side that an axis comes from: RAI is from right, anterior and inferior.
    """
    count = _integer(fields, "NDims", 3)
    matrix = np.array(_numbers(fields, _MATRIX_NAMES, []))
    if matrix.size not in (0, count * count):
        raise expected("TransformMatrix", f"{count * count} numbers", matrix.size)
    # a row of the matrix is the direction of one axis: axes become columns
    stated = matrix.reshape(count, count).T[:3, :3] if matrix.size else None
    letters = fields.get("AnatomicalOrientation", "").upper()[:3]
    sides = [_SIDES[letter] for letter in letters if letter in _SIDES]
    lettered = None
    if len({axis for axis, _ in sides}) == 3:
        lettered = np.zeros((3, 3))
        for axis, (world, sign) in enumerate(sides):
            lettered[world, axis] = sign
    if stated is None:
        return (np.eye(3), None, ()) if lettered is None else (lettered, "LPS", ())
    # the letters must name the nearest axes of the matrix
    agrees = lettered is None or (lettered * stated).sum(axis=0).min() > 0.5
    note = f"AnatomicalOrientation {letters} contradicts TransformMatrix, which is used"
    return stated, "LPS", () if agrees else (note,)


def _ignored_notes(fields: Fields) -> tuple[str, ...]:
    """Notes on header entries that are ignored."""
    scale = [_numbers(fields, (f"ElementToIntensityFunction{name}",), []) for name in ("Slope", "Offset")]
    scaled = scale[0] not in ([], [1.0]) or scale[1] not in ([], [0.0])
    return ("values are as stored: the file's ElementToIntensityFunction is not applied",) * scaled


def _header(path: Path) -> tuple[Fields, list[str], int]:
    """Fields up to ElementDataFile, which is the last; the names that follow a LIST; the offset after the fields."""
    fields: Fields = {}
    lines = 0
    with path.open("rb") as file:
        while "ElementDataFile" not in fields:
            line = file.readline(_HEADER_LIMIT)
            key, equals, value = decode_text(line).partition("=")
            if (line.strip() and not equals) or file.tell() > _HEADER_LIMIT or not key.strip().isascii():
                raise expected("header", "lines 'key = value'", repr(line[:16]), "is this a MetaImage file?")
            if not line:
                raise expected("header", "a last line 'ElementDataFile = …'", "none", "the file is cut short")
            lines += 1
            if lines > _LINES_LIMIT:
                raise expected("header", f"at most {_LINES_LIMIT} lines", "more", "is this a MetaImage file?")
            if equals:
                fields[key.strip()] = value.strip()
        start = file.tell()
        listed = fields["ElementDataFile"].upper().split()[:1] == ["LIST"]
        file_names = (decode_text(file.readline(_LINE_LIMIT)).strip() for _ in range(_LINES_LIMIT * listed))
        names = list(takewhile(bool, file_names))
    if fields.get("NDims") not in ("3", "4"):
        raise expected("NDims", "3 or 4", fields.get("NDims", "none"))
    return fields, names, start


def _list_files(name: str, names: list[str], shape: tuple[int, ...]) -> tuple[list[str], int]:
    """Names of the files of slices, and the number of their axes; ([], 0) if the data are in one file.

    name: "LIST" or "LIST 2D" with names behind it, or a pattern with the first and the last number, and the step.
    """
    words = name.split()
    if words[0].upper() == "LIST":
        axes = re.fullmatch(r"([1-9])D?", words[1].upper()) if len(words) > 1 else None
        return names, int(axes[1]) if axes else len(shape) - 2
    if "%" not in name:
        return [], 0
    numbers = [int(word) for word in words[1:] if re.fullmatch("-?[0-9]{1,7}", word)]
    if not _PATTERN.fullmatch(words[0]) or len(numbers) != len(words) - 1 or not 1 <= len(numbers) <= 3:
        raise expected("ElementDataFile", "LIST, or a name%03d.raw FIRST LAST STEP", repr(name))
    first, last, step = (*numbers, *(numbers[0] + shape[0] - 1, 1)[len(numbers) - 1 :])
    return [words[0] % number for number in range(first, last + 1, max(step, 1))[: _LINES_LIMIT + 1]], len(shape) - 2


def _read_data(
    path: Path, fields: Fields, behind: tuple[list[str], int], shape: tuple[int, ...], anywhere: bool
) -> np.ndarray:
    """Samples [shape] of this file, another, or several. behind: names and offset behind the header's fields."""
    name = fields["ElementDataFile"]
    if not name:
        raise expected("ElementDataFile", "LOCAL, LIST or a name", "none")
    if name.upper() == "LOCAL":
        return _read_file(path, fields, behind[1], shape)
    names, axes = _list_files(name, behind[0], shape)
    if not axes:
        return _read_file(find_data_file(path, name, anywhere), fields, 0, shape)
    # channels of a voxel are an axis, too
    return stack_files(path, names, axes + 1, shape, anywhere, lambda file, of: _read_file(file, fields, 0, of))


def _read_file(path: Path, fields: Fields, start: int, shape: tuple[int, ...]) -> np.ndarray:
    """Samples [shape] of a file from byte `start` on: text, zlib or plain; HeaderSize -1 counts from the end."""
    dtype, skip = _dtype(fields), _integer(fields, "HeaderSize", 0)
    if not _flag(fields, "BinaryData", True):
        with path.open("rb") as file, decoder_errors("MetaImage text data"):
            file.seek(start)
            return read_text(file, dtype, shape, path.stat().st_size - start)
    if skip < -1:
        raise expected("HeaderSize", "-1 (from the end), 0 or more", skip)
    if _flag(fields, "CompressedData", False):
        return inflate(path, start + max(skip, 0), dtype, shape)
    if skip == -1:
        start, skip = max(path.stat().st_size - byte_count(shape, dtype), 0), 0
    return map_array(path, start + skip, dtype, shape)


def _dtype(fields: Fields) -> np.dtype:
    name = fields.get("ElementType", "none").removesuffix("_ARRAY")
    if name not in TYPES:
        raise expected("ElementType", "a MetaImage number type such as MET_SHORT", name)
    big = _flag(fields, "ElementByteOrderMSB", False) or _flag(fields, "BinaryDataByteOrderMSB", False)
    return np.dtype(TYPES[name]).newbyteorder(">" if big else "<")


def _flag(fields: Fields, name: str, default: bool) -> bool:
    return fields.get(name, str(default)).lower() in ("true", "1")


def _integer(fields: Fields, name: str, default: int) -> int:
    """The whole number of a field; the default without the field."""
    numbers: list[int] = convert_words(fields.get(name, str(default)).split(), int, name)
    if len(numbers) != 1:
        raise expected(name, "one whole number", repr(fields[name]))
    return numbers[0]


def _numbers(fields: Fields, names: tuple[str, ...], default: list[float]) -> list[float]:
    """The numbers of the first field among `names` that the header has."""
    name = next((name for name in names if name in fields), None)
    return default if name is None else convert_words(fields[name].split(), float, name)
