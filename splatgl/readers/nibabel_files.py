"""MINC 1 and 2, AFNI and Philips' PAR/REC, through nibabel, in RAS and millimetres.

nibabel's affine takes indices along an array's axes to RAS+; MINC's arrays are [z, y, x] or [t, z, y, x], the others
[x, y, z] or [x, y, z, t].
"""

from __future__ import annotations

import io
import math
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np

from splatgl.data.volume import Volume
from splatgl.errors import expected, import_extra
from splatgl.fileio import byte_count, require_memory
from splatgl.readers.common import decoder_errors, require_bytes, require_plausible
from splatgl.readers.hdf5_files import open_hdf5
from splatgl.readers.microscopes import BoundedFile
from splatgl.readers.nifti import check_sizes, find_beside, volume_in_time
from splatgl.readers.options import LoadOptions

# most bytes of a header in text
_HEADER_BYTES = 2**24
# samples that are scaled become float64 in nibabel
_SCALED = np.dtype(np.float64)


def read_minc(path: Path, options: LoadOptions) -> Volume:
    """The volume of a MINC file, in NetCDF-3 or HDF5; `time` picks a time point."""
    nibabel = import_extra("nibabel", "MINC files", "nibabel", "readers")
    with path.open("rb") as file:
        is_hdf5 = file.read(4) == b"\x89HDF"
    form = nibabel.minc2.Minc2File if is_hdf5 else nibabel.minc1.Minc1File
    with ExitStack() as stack, decoder_errors("MINC"):
        if is_hdf5:
            opened = open_hdf5(path)
        else:
            opened = nibabel.externals.netcdf.netcdf_file(BoundedFile(io.FileIO(path)), "r", mmap=False)
        stack.callback(opened.close)
        image = form(opened)
        shape = [int(size) for size in image.get_data_shape()]
        _check(shape, slice(-3, None), path, is_packed=is_hdf5)
        matrix, zooms = np.array(image.get_affine(), np.float64), [float(zoom) for zoom in image.get_zooms()]
        step = zooms[0] if len(shape) > 3 and len(zooms) > 3 else 0.0

        def read_samples(time: int) -> np.ndarray:
            return np.asarray(image.get_scaled_data((time,) if len(shape) > 3 else ()))

        # nibabel has the slowest axis first
        matrix[:3, :3] = matrix[:3, 2::-1]
        return volume_in_time(read_samples, shape[0] if len(shape) > 3 else 1, step, matrix, options)


def read_afni(path: Path, options: LoadOptions) -> Volume:
    """The volume of AFNI's pair .HEAD and .BRIK or .BRIK.gz, either of which may be named; `time` picks a sub-brick."""
    nibabel = import_extra("nibabel", "AFNI files", "nibabel", "readers")
    stem = path.name[: -len(".brik.gz" if path.name.lower().endswith(".gz") else ".head")]
    header = find_beside(path, stem, (".HEAD", ".head"))
    data = find_beside(path, stem, (".BRIK", ".BRIK.gz", ".brik", ".brik.gz"))
    return _read_pair(nibabel.brikhead.AFNIImage, "AFNI", header, data, options)


def read_parrec(path: Path, options: LoadOptions) -> Volume:
    """The volume of Philips' pair .PAR and .REC, in the values that the scanner displays; `time` picks a time point."""
    nibabel = import_extra("nibabel", "PAR/REC files", "nibabel", "readers")
    data = find_beside(path, path.stem, (".REC", ".rec"))
    return _read_pair(nibabel.parrec.PARRECImage, "PAR/REC", path, data, options)


def _read_pair(form: Any, title: str, header: Path, data: Path, options: LoadOptions) -> Volume:
    """The volume of a header in text and its data."""
    if header.stat().st_size > _HEADER_BYTES:
        raise expected(header.name, f"at most {_HEADER_BYTES} bytes", header.stat().st_size, "is this a header?")
    with header.open(encoding="latin-1") as file, decoder_errors(title):
        head = form.header_class.from_fileobj(file)
        shape, zooms = [int(size) for size in head.get_data_shape()], [float(zoom) for zoom in head.get_zooms()]
        affine, stored = np.asarray(head.get_affine(), np.float64), np.dtype(head.get_data_dtype())
    packed = data.name.lower().endswith(".gz")
    # before nibabel makes a scale for each of a damaged number of time points
    _check(shape, slice(3), data, packed)
    if not packed:
        require_bytes(byte_count(shape, stored), data.stat().st_size, data.name)
    step = zooms[3] if len(shape) > 3 and len(zooms) > 3 else 0.0

    def read_samples(time: int) -> np.ndarray:
        with decoder_errors(title):
            stack = form.ImageArrayProxy(str(data), head)
            return np.asarray(stack[(..., time) if len(shape) > 3 else ...]).T

    return volume_in_time(read_samples, shape[3] if len(shape) > 3 else 1, step, affine, options)


def _check(shape: list[int], space: slice, data: Path, is_packed: bool) -> None:
    """Raises InputError for sizes that the file cannot contain, or that the memory cannot."""
    if len(shape) not in (3, 4):
        raise expected("dimensions", "three or four axes", len(shape))
    check_sizes(shape, space)
    there = data.stat().st_size
    require_plausible(math.prod(shape), there, bounded=is_packed)
    require_memory(byte_count(shape, _SCALED), there)
