"""Headerless raw files: shape and type from the name (`male_128x256x256_uint8.raw`) or from the options."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from splatgl.data.readers.files import grid_shape, map_array
from splatgl.data.readers.options import LoadOptions, sample_type
from splatgl.data.volume import Volume
from splatgl.errors import InputError, choice, expected
from splatgl.fileio import byte_count

_SHAPE = re.compile(r"(?<!\d)(\d+)x(\d+)x(\d+)(?!\d)", re.IGNORECASE)
_DTYPE = re.compile(r"(?<![a-z])(u?int(?:8|16|32|64)|float(?:16|32|64))(le|be)?(?![a-z0-9])", re.IGNORECASE)


def read(path: Path, options: LoadOptions) -> Volume:
    """The volume mapped from `path`, x fastest. Raises InputError if the byte count differs from shape and type."""
    dtype = _dtype(path, options)
    shape = grid_shape(options.shape or _shape(path))
    needed, there = options.header_offset + byte_count(shape, dtype), path.stat().st_size
    if needed != there:
        this = f"{needed} bytes ({shape[2]}x{shape[1]}x{shape[0]} {dtype.name} after {options.header_offset})"
        fix = "give the shape=X,Y,Z, dtype=TYPE and header_offset=BYTES that fit"
        raise expected("size", this, f"{there} bytes", fix)
    return Volume(map_array(path, options.header_offset, dtype, shape))


def _shape(path: Path) -> tuple[int, int, int]:
    found = _SHAPE.search(path.name)
    if found is None:
        raise _unstated(path, "shape", "_128x256x256_")
    return int(found[1]), int(found[2]), int(found[3])


def _dtype(path: Path, options: LoadOptions) -> np.dtype:
    found = options.dtype or _DTYPE.search(path.name)
    if found is None:
        raise _unstated(path, "dtype", "_uint8")
    return sample_type(found if isinstance(found, str) else found[0])


def _unstated(path: Path, option: str, such: str) -> InputError:
    """The error for a file of which neither its name nor an option tells the shape or the type."""
    error = expected(option, f"one in the name (such as {such}) or as an option", "neither", _fix(path))
    return choice(error, option, [("bytes", f"{path.stat().st_size:,}")])


def _fix(path: Path) -> str:
    headers = [header for header in (path.with_suffix(".mhd"), path.with_suffix(".nhdr")) if header.is_file()]
    return f"load its header {headers[0].name}" if headers else "give shape=X,Y,Z and dtype=TYPE"
