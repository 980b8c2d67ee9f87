"""NumPy files (.npy, .npz), and raw samples without a header."""

from __future__ import annotations

import io
import re
import zipfile
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import numpy as np

from splatgl.data.volume import Volume
from splatgl.errors import MissingOption, expected
from splatgl.fileio import byte_count, require_memory
from splatgl.readers.channels import MAGNITUDE_NOTE, is_color_rule, split_voxels
from splatgl.readers.common import decoder_errors, grid_shape, map_array, require_bytes, require_plausible
from splatgl.readers.options import LoadOptions, sample_type

# most bytes read for a header; NumPy refuses headers of more than 10 000
_HEADER_LIMIT = 2**16


@dataclass(frozen=True)
class _Header:
    """A .npy header, and the offset of the samples."""

    shape: tuple[int, ...]
    fortran: bool
    dtype: np.dtype
    offset: int

    @property
    def about(self) -> str:
        """The size along x, y, z, and the type."""
        return f"{' × '.join(map(str, self.shape[::-1]))} {self.dtype.name}"

    @property
    def is_volume(self) -> bool:
        """Whether it may be a volume: three axes beside those of one entry, and one of a colour's or vector's parts."""
        return _voxel_shape(self.shape, self.dtype) is not None and self.dtype.kind in "buifc"


def _voxel_shape(shape: tuple[int, ...], dtype: np.dtype) -> tuple[int, int, int, int] | None:
    """(z, y, x, numbers per voxel) of an array's shape without axes of one entry; None for other arrays."""
    if not shape or min(shape) < 1:
        return None
    parts = is_color_rule(dtype, shape[-1]) or (dtype.kind in "if" and shape[-1] == 3)
    count = shape[-1] if len(shape) > 3 and parts else 1
    rest = list(shape[:-1] if count > 1 else shape)
    while len(rest) > 3 and 1 in rest:
        rest.remove(1)
    return (rest[0], rest[1], rest[2], count) if len(rest) == 3 else None


def _make_volume(array: np.ndarray, options: LoadOptions) -> Volume:
    """The volume of an array that may be one, see `_Header.is_volume`."""
    shape = _voxel_shape(array.shape, array.dtype)
    assert shape is not None
    if shape[3] > 1:
        samples, color, vectors, notes = split_voxels(array.reshape(shape), options)
        return Volume(samples, color=color, vectors=vectors, notes=notes)
    options.reject("channel", "several numbers per voxel")
    values = array.reshape(shape[:3])
    if values.dtype.kind != "c":
        return Volume(values)
    return Volume(np.stack([np.abs(plane).astype(np.float32) for plane in values]), notes=(MAGNITUDE_NOTE,))


def read_npy(path: Path, options: LoadOptions) -> Volume:
    """The array [z, y, x] of a .npy file, mapped in either order of axes, also with colours or vectors behind x.

    Axes of one entry beside three others are left out.
    """
    with path.open("rb") as file:
        header = _read_header(file)
    _check_header(header)
    if header.fortran:
        return _make_volume(map_array(path, header.offset, header.dtype, header.shape[::-1]).T, options)
    return _make_volume(map_array(path, header.offset, header.dtype, header.shape), options)


def read_npz(path: Path, options: LoadOptions) -> Volume:
    """The array named by `array`, or the only 3-D one, of a .npz file; read as a whole."""
    # 1. the arrays in it
    with decoder_errors("NumPy .npz"), zipfile.ZipFile(path) as archive:
        members = {name.removesuffix(".npy"): name for name in archive.namelist() if name.endswith(".npy")}
        headers = {}
        for name, file_name in members.items():
            if archive.getinfo(file_name).compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
                raise expected(file_name, "stored or deflated data, as NumPy writes", "another compression")
            with archive.open(file_name) as file:
                headers[name] = _read_header(file)
    name = _select_array(headers, options)
    header = headers[name]
    _check_header(header)
    # 2. the archive's directory, the array's header and the compressed bytes must agree before it is read
    with decoder_errors("NumPy .npz"), zipfile.ZipFile(path) as archive:
        member = archive.getinfo(members[name])
        require_bytes(byte_count(header.shape, header.dtype), member.file_size - header.offset)
        there = min(member.compress_size, path.stat().st_size)
        require_plausible(member.file_size, there)
        require_memory(byte_count(header.shape, header.dtype), there)
        with archive.open(member) as file:
            samples = np.lib.format.read_array(file, allow_pickle=False)
    return _make_volume(samples, options)


def _select_array(headers: dict[str, _Header], options: LoadOptions) -> str:
    listed = ", ".join(headers) or "none"
    if options.array is not None:
        if options.array not in headers:
            raise expected("array", f"one of {listed}", repr(options.array))
        return options.array
    volumes = [name for name, header in headers.items() if header.is_volume]
    if len(volumes) != 1:
        fix = f"pick one with array=NAME; there are: {listed}"
        error = expected("arrays", "one 3-D array of numbers", len(volumes), fix)
        raise (
            MissingOption(str(error), "array", [(name, headers[name].about) for name in volumes]) if volumes else error
        )
    return volumes[0]


def _read_header(opened: IO[bytes]) -> _Header:
    # a false header length could cause large allocations or unbounded inflation
    file = io.BytesIO(opened.read(_HEADER_LIMIT))
    with decoder_errors("NumPy .npy"):
        version = np.lib.format.read_magic(file)
        read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
        shape, fortran, dtype = read(file)
        return _Header(shape, fortran, dtype, file.tell())


def _check_header(header: _Header) -> None:
    if not header.is_volume:
        this = "a 3-D array [z, y, x] of numbers, or [z, y, x, 3 or 4] of colours or vectors"
        is_plane = len(header.shape) == 2 and header.shape[0] > 0
        fix = f"one plane has the shape (1, {header.shape[0]}, {header.shape[1]})" if is_plane else "save a part of it"
        raise expected("array", this, f"{header.dtype} {header.shape}", fix)


_SHAPE = re.compile(r"(?<!\d)(\d+)x(\d+)x(\d+)(?!\d)", re.IGNORECASE)
_DTYPE = re.compile(r"(?<![a-z])(u?int(?:8|16|32|64)|float(?:16|32|64))(?:[ _-]?(le|be))?(?![a-z0-9])", re.IGNORECASE)


def read(path: Path, options: LoadOptions) -> Volume:
    """The volume mapped from `path`, x fastest. Raises InputError if the byte count differs from shape and type."""
    kind, sizes = _stated(path.name, options)
    for option, stated, such in (("dtype", kind, "_uint8"), ("shape", sizes, "_128x256x256_")):
        if not stated:
            headers = [header for header in (path.with_suffix(".mhd"), path.with_suffix(".nhdr")) if header.is_file()]
            fix = f"load its header {headers[0].name}" if headers else "give shape=X,Y,Z and dtype=TYPE"
            error = expected(option, f"one in the name (such as {such}) or as an option", "neither", fix)
            raise MissingOption(str(error), option, [("bytes", f"{path.stat().st_size:,}")])
    dtype, shape = sample_type(kind), grid_shape([int(size) for size in sizes])
    needed, there = options.header_offset + byte_count(shape, dtype), path.stat().st_size
    if needed != there:
        this = f"{needed} bytes ({shape[2]}x{shape[1]}x{shape[0]} {dtype.name} after {options.header_offset})"
        fix = "give the shape=X,Y,Z, dtype=TYPE and header_offset=BYTES that fit"
        raise expected("size", this, f"{there} bytes", fix)
    return Volume(map_array(path, options.header_offset, dtype, shape))


def _stated(name: str, options: LoadOptions) -> tuple[str, Any]:
    """The sample type and the sizes (x, y, z) in the options or a file's name; empty if there are none."""
    kind = options.dtype or "".join(next(iter(_DTYPE.findall(name)), ()))
    return kind, options.shape or next(iter(_SHAPE.findall(name)), ())


def states_samples(name: str, options: LoadOptions) -> bool:
    """Whether options or a file's name state the sizes or the type of raw samples."""
    return any(_stated(name, options))
