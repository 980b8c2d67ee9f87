"""NumPy's own files: .npy (memory-mapped) and .npz (one array of it)."""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import IO

import numpy as np

from splatgl.data.errors import expected
from splatgl.data.readers.files import byte_count, library, map_array, require_bytes, require_plausible
from splatgl.data.readers.options import LoadOptions
from splatgl.data.volume import Volume

Header = tuple[tuple[int, ...], bool, np.dtype]


def read_npy(path: Path, _options: LoadOptions) -> Volume:
    """The array [z, y, x] of a .npy file, mapped in either order of axes."""
    with path.open("rb") as file:
        shape, fortran, dtype = _header(file)
        offset = file.tell()
    if not fortran:
        return Volume(map_array(path, offset, dtype, shape))
    return Volume(map_array(path, offset, dtype, shape[::-1]).T)


def read_npz(path: Path, options: LoadOptions) -> Volume:
    """The array named by `array`, or the only 3-D one, of a .npz file; read whole."""
    with library("NumPy .npz", zipfile.BadZipFile), zipfile.ZipFile(path) as archive:
        member = archive.getinfo(_member(archive, options))
        # the archive's directory, the array's own header and the compressed bytes must agree before it is read
        with archive.open(member) as file:
            shape, _, dtype = _header(file)
            offset = file.tell()
        require_bytes(byte_count(shape, dtype), member.file_size - offset)
        require_plausible(member.file_size, member.compress_size)
        with archive.open(member) as file:
            return Volume(np.lib.format.read_array(file, allow_pickle=False))


def _member(archive: zipfile.ZipFile, options: LoadOptions) -> str:
    names = {name.removesuffix(".npy"): name for name in archive.namelist() if name.endswith(".npy")}
    listed = ", ".join(names) or "none"
    if options.array is not None:
        if options.array not in names:
            raise expected("array", f"one of {listed}", repr(options.array))
        return names[options.array]
    volumes = [name for name in names if _dimensions(archive, names[name]) == 3]
    if len(volumes) != 1:
        fix = f"pick one with array=NAME; there are: {listed}"
        raise expected("arrays", "one 3-D array", f"{len(volumes)} 3-D arrays", fix)
    return names[volumes[0]]


def _dimensions(archive: zipfile.ZipFile, member: str) -> int:
    with archive.open(member) as file:
        return len(np.lib.format.read_array_header_1_0(file)[0]) if _version(file) == (1, 0) else 3


def _version(file: IO[bytes]) -> tuple[int, int]:
    return np.lib.format.read_magic(file)


def _header(file: IO[bytes]) -> Header:
    with library("NumPy .npy"):
        version = _version(file)
        read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
        shape, fortran, dtype = read(file)
    if len(shape) != 3 or min(shape) < 1 or dtype.kind not in "buif":
        raise expected("array", "a 3-D array [z, y, x] of real numbers", f"{dtype} {shape}")
    return shape, fortran, dtype
