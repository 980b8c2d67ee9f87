"""Analyze 7.5 (.hdr with .img) and FreeSurfer's volumes (.mgh, .mgz), through nibabel; plain samples are mapped.

nibabel's arrays are [x, y, z], and its affine takes (x, y, z) to RAS+. Analyze files state no orientation: nibabel
takes x from right to left, as SPM does. A pair in the NIfTI format has these names too, and is read as such.
"""

from __future__ import annotations

import gzip
import struct
from pathlib import Path
from typing import Any

import numpy as np

from splatgl.data.affine import axes_of, triple
from splatgl.data.readers.files import grid_shape, library, require_bytes, require_plausible, selection
from splatgl.data.readers.options import LoadOptions
from splatgl.data.volume import Volume
from splatgl.errors import expected, missing_extra
from splatgl.fileio import byte_count, require_memory

_HEADER = 348
"""Bytes of an Analyze header, which its first number states."""

_MGH_TYPES: dict[int, np.dtype] = {0: np.dtype(">u1"), 1: np.dtype(">i4"), 3: np.dtype(">f4"), 4: np.dtype(">i2")}
_MGH_START = 284
"""Byte at which the samples of an .mgh file begin."""


def read_analyze(path: Path, options: LoadOptions) -> Volume:
    """The volume of an Analyze or NIfTI pair in RAS; `array` picks the time point of a 4-D one."""
    nibabel = _nibabel("Analyze files")
    # 1. both files, of which either may be named
    header, data = (_beside(path, suffix) for suffix in (".hdr", ".img"))
    with header.open("rb") as file:
        first = file.read(_HEADER)
    if len(first) < _HEADER or struct.pack("<i", _HEADER) not in (first[:4], first[3::-1]):
        raise expected(header.name, "an Analyze header of 348 bytes", "another", "is this an Analyze file?")
    # 2. its sizes, checked against the data
    with library("Analyze"):
        if first[344:347] == b"ni1":
            form: Any = nibabel.Nifti1Pair
        else:
            # SPM's scale factor and origin, without the .mat file that it would look for
            spm = {"header_class": nibabel.spm2analyze.Spm2AnalyzeHeader}
            form = type("Image", (nibabel.analyze.AnalyzeImage,), spm)
        image = form.from_file_map(form.make_file_map({"header": str(header), "image": str(data)}), mmap="r")
        dtype = _dtype_of(image)
        sizes = [int(size) for size in image.shape]
        start = int(image.dataobj.offset)
    _check(sizes, dtype)
    require_bytes(max(start, 0) + byte_count(sizes, dtype), data.stat().st_size)
    return _volume(image, sizes, "mm", options)


def read_mgh(path: Path, options: LoadOptions) -> Volume:
    """The volume of an .mgh or .mgz file in RAS; `array` picks one of several frames."""
    nibabel = _nibabel("MGH files")
    packed = path.name.lower().endswith("z")
    # 1. sizes, checked before nibabel looks for what follows the samples
    with library("MGH"), gzip.open(path) if packed else path.open("rb") as file:
        first = file.read(_MGH_START)
    require_bytes(_MGH_START, len(first), "header")
    version, *sizes, code = struct.unpack(">6i", first[:24])
    if version != 1 or code not in _MGH_TYPES:
        raise expected("header", "version 1, and type 0, 1, 3 or 4", f"{version}, {code}", "is this an MGH file?")
    _check(sizes, _MGH_TYPES[code])
    needed, there = _MGH_START + byte_count(sizes, _MGH_TYPES[code]), path.stat().st_size
    if packed:
        require_plausible(needed, there)
        require_memory(needed, there)
    else:
        require_bytes(needed, there)
    # 2. the image; of a packed one no more is inflated than the sizes say
    with library("MGH"):
        image = nibabel.MGHImage.from_filename(path, mmap="r")
    return _volume(image, [int(size) for size in image.shape], "mm", options)


def _nibabel(what: str) -> Any:
    try:
        import nibabel
    except ImportError:
        raise missing_extra(what, "nibabel", "readers") from None
    return nibabel


def _dtype_of(image: Any) -> np.dtype:
    return np.dtype(image.get_data_dtype())


def _beside(path: Path, suffix: str) -> Path:
    """The file of the pair with that suffix, in the case of the one that is named."""
    found = path.with_suffix(suffix.upper() if path.suffix.isupper() else suffix)
    if not found.is_file():
        raise expected("pair", f"{found.name} beside it", "none", "put both files side by side")
    return found


def _check(sizes: list[int], dtype: np.dtype) -> None:
    if dtype.kind not in "uif":
        raise expected("samples", "real numbers", dtype, "convert the file to one number per voxel")
    grid_shape(sizes[:3])
    if min(sizes) < 1:
        raise expected("dimensions", "at least one entry along each axis", sizes, "the header is damaged")


def _volume(image: Any, sizes: list[int], unit: str, options: LoadOptions) -> Volume:
    long = [axis for axis in range(3, len(sizes)) if sizes[axis] > 1]
    extra = {axis: ("array", options.array_number(sizes[axis]) if axis in long else 0) for axis in range(3, len(sizes))}
    if not long and options.array is not None:
        options.array_number(1)
    with library("image"):
        # what has a scale factor becomes float
        proxy = image.dataobj
        scaled = (float(getattr(proxy, "slope", 1.0)), float(getattr(proxy, "inter", 0.0))) != (1.0, 0.0)
        stored = np.asanyarray(proxy) if scaled else np.asanyarray(proxy.get_unscaled())
    samples = stored[selection(sizes, extra)].T
    spacing, direction = axes_of(image.affine[:3, :3], "affine")
    kept = samples.astype(np.float32) if samples.dtype == np.float64 and scaled else samples
    return Volume(kept, spacing, triple(image.affine[:3, 3], "affine"), direction, unit, frame="RAS")
