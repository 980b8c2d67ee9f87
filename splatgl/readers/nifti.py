"""NIfTI, Analyze and MGH, through nibabel.

Analyze files state no orientation: nibabel takes x from right to left, as SPM does. NIfTI pairs have the same endings.

nibabel's arrays are [x, y, z] with x fastest, and its affine takes (x, y, z) to RAS+ (nipy.org/nibabel,
"Coordinate systems and affines"); the transpose of the array is [z, y, x].
"""

from __future__ import annotations

import gzip
import struct
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from splatgl.data.affine import volume_on_grid
from splatgl.data.volume import Volume, triple
from splatgl.errors import expected, import_extra
from splatgl.fileio import byte_count, require_memory
from splatgl.readers.channels import ChannelSet
from splatgl.readers.common import (
    decoder_errors,
    grid_shape,
    has_whole_numbers,
    require_bytes,
    require_plausible,
)
from splatgl.readers.options import LoadOptions

# bytes of an Analyze header, and its first number
_HEADER = 348
_MGH_TYPES: dict[int, np.dtype] = {0: np.dtype(">u1"), 1: np.dtype(">i4"), 3: np.dtype(">f4"), 4: np.dtype(">i2")}
# byte at which the samples of an .mgh file begin
_MGH_START = 284


def read_analyze(path: Path, options: LoadOptions) -> Volume:
    """The volume of an Analyze or NIfTI pair in RAS; `array` picks the time point of a 4-D image."""
    nibabel = import_extra("nibabel", "Analyze files", "nibabel", "readers")
    # 1. both files; `path` may be either
    header, data = (_pair_file(path, suffix) for suffix in (".hdr", ".img"))
    with header.open("rb") as file:
        first = file.read(_HEADER)
    if len(first) < _HEADER or struct.pack("<i", _HEADER) not in (first[:4], first[3::-1]):
        raise expected(header.name, "an Analyze header of 348 bytes", "another header", "is this an Analyze file?")
    # 2. its sizes, checked against the data
    with decoder_errors("Analyze"):
        if first[344:347] == b"ni1":
            form: Any = nibabel.Nifti1Pair
        else:
            # SPM's scale factor and origin, without its .mat file
            spm = {"header_class": nibabel.spm2analyze.Spm2AnalyzeHeader}
            form = type("Image", (nibabel.analyze.AnalyzeImage,), spm)
        image = form.from_file_map(form.make_file_map({"header": str(header), "image": str(data)}), mmap="r")
        dtype = np.dtype(image.get_data_dtype())
        sizes = [int(size) for size in image.shape]
        start = int(image.dataobj.offset)
    _check(sizes, dtype)
    require_bytes(max(start, 0) + byte_count(sizes, dtype), data.stat().st_size)
    return _mgh_volume(image, sizes, options)


def read_mgh(path: Path, options: LoadOptions) -> Volume:
    """The volume of an .mgh or .mgz file in RAS; `array` picks one of several frames."""
    nibabel = import_extra("nibabel", "MGH files", "nibabel", "readers")
    packed = path.name.lower().endswith("z")
    # 1. sizes, checked before nibabel reads behind the samples
    with decoder_errors("MGH"), gzip.open(path) if packed else path.open("rb") as file:
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
    # 2. the image; a packed one is inflated up to the stated sizes
    with decoder_errors("MGH"):
        image = nibabel.MGHImage.from_filename(path, mmap="r")
    return _mgh_volume(image, [int(size) for size in image.shape], options)


def _pair_file(path: Path, suffix: str) -> Path:
    """The file of the pair with that suffix, in the case of the given path."""
    file = path.with_suffix(suffix.upper() if path.suffix.isupper() else suffix)
    if not file.is_file():
        raise expected("pair", f"{file.name} beside it", "none", "put both files side by side")
    return file


def _check(sizes: list[int], dtype: np.dtype) -> None:
    if dtype.kind not in "uif":
        raise expected("samples", "real numbers", dtype, "convert the file to one number per voxel")
    _check_sizes(sizes)


def _check_sizes(sizes: list[int]) -> list[int]:
    grid_shape(sizes[:3])
    if min(sizes) < 1:
        raise expected("dimensions", "at least one entry along each axis", sizes, "the header is damaged")
    return sizes


def _mgh_volume(image: Any, sizes: list[int], options: LoadOptions) -> Volume:
    long = [axis for axis in range(3, len(sizes)) if sizes[axis] > 1]
    picked: dict[int, str | int] = {axis: "array" if axis in long else 0 for axis in range(3, len(sizes))}
    if not long and options.array is not None:
        options.array_number(1)
    with decoder_errors("image"):
        # samples with a scale factor become float
        proxy = image.dataobj
        scaled = (float(getattr(proxy, "slope", 1.0)), float(getattr(proxy, "inter", 0.0))) != (1.0, 0.0)
        stored = np.asanyarray(proxy) if scaled else np.asanyarray(proxy.get_unscaled())
    samples = stored[options.index(sizes, picked)].T
    converted = samples.astype(np.float32) if samples.dtype == np.float64 and scaled else samples
    return volume_on_grid(converted, image.affine[:3, :3], image.affine[:3, 3], "affine", unit="mm", frame="RAS")


# units of length by the lowest three bits of xyzt_units (nifti1.h); other codes are no lengths
_UNITS = {1: "m", 2: "mm", 3: "um"}
# seconds of the units of time in the next three bits
_TIMES = {8: 1.0, 16: 1e-3, 24: 1e-6}
# NIFTI_INTENT_LABEL: samples number segments (nifti1.h)
_LABELS = 1002
UNORIENTED = "no sform or qform: the file does not state the patient's orientation"

# bytes read to check gzip data: more than either header
_SNIFF_BYTES = 1024
# sizeof_hdr of NIfTI-2, the first number of the file; NIfTI-1 has 348
_NIFTI2_BYTES = 540


def read(path: Path, options: LoadOptions) -> Volume:
    """The volume of a .nii or .nii.gz file in RAS; `time` picks the time point of a 4-D image.

    Samples with a slope or intercept are scaled to float32, others keep their type.
    """
    image = _open(path)
    _check_bytes(path, image)
    return volume_of_image(image, options)


def volume_of_image(image: Any, options: LoadOptions) -> Volume:
    """The volume of a nibabel image with a NIfTI header, in a file or in memory, as `read` returns it."""
    # time points, pixdim[4] apart
    sizes, zooms = _check_sizes([int(size) for size in image.shape]), image.header.get_zooms()
    unit = _TIMES.get(int(image.header["xyzt_units"]) & 56, 0.0)
    step = float(zooms[3]) * unit if len(zooms) > 3 else 0.0
    times = ChannelSet(times=sizes[3] if len(sizes) > 3 else 1, step=step if 0 < step < float("inf") else None)
    volume = times.volume(options, lambda _: _volume(image, sizes, options))
    is_labels = int(image.header["intent_code"]) == _LABELS and all(map(has_whole_numbers, volume.samples))
    return replace(volume, labels=()) if is_labels else volume


def _volume(image: Any, sizes: list[int], options: LoadOptions) -> Volume:
    # 1. the index
    times = sizes[3] if len(sizes) > 3 else 1
    arrays = [axis for axis in range(4, len(sizes)) if sizes[axis] > 1]
    if not arrays and times == 1:
        options.refuse("array", "a file of several time points or arrays")
    # if there are several arrays, `array` picks one, not a time point
    picked: dict[int, str | int] = {axis: "array" if axis in arrays else 0 for axis in range(4, len(sizes))}
    if len(sizes) > 3:
        picked[3] = options.time or 0 if arrays else "time"
    # 2. samples
    stored, slope, intercept = _read_stored(image.dataobj, options.index(sizes, picked))
    if stored.dtype.kind not in "buif":
        raise expected("samples", "real numbers", stored.dtype, "convert it to one number per voxel")
    samples = _scale(stored.T, slope, intercept)
    # 3. grid
    unit = _UNITS.get(int(image.header["xyzt_units"]) & 7, "")
    if not (image.header["sform_code"] or image.header["qform_code"]):
        # a zoom of zero means unknown
        zooms = [abs(float(zoom)) or 1.0 for zoom in image.header.get_zooms()[:3]]
        return Volume(samples, triple(zooms, "pixdim"), unit=unit, notes=(UNORIENTED,))
    return volume_on_grid(samples, image.affine[:3, :3], image.affine[:3, 3], "affine", unit=unit, frame="RAS")


def _read_stored(data: Any, index: tuple[int | slice, ...]) -> tuple[np.ndarray, float, float]:
    """The stored samples at an index, mapped where the file permits, their slope and intercept."""
    if not hasattr(data, "get_unscaled"):
        return np.asanyarray(data)[index], 1.0, 0.0
    slope, intercept, name = float(data.slope), float(data.inter), str(data.file_like)
    if not name.lower().endswith(".gz"):
        with decoder_errors("NIfTI"):
            return np.asanyarray(data.get_unscaled())[index], slope, intercept
    from nibabel.fileslice import fileslice
    from nibabel.openers import ImageOpener

    # memory for the picked samples only; scaled ones take room twice
    picked = byte_count([size for size, at in zip(data.shape, index, strict=True) if at == slice(None)], data.dtype)
    scaled = 0 if (slope, intercept) == (1.0, 0.0) else picked // data.dtype.itemsize * np.dtype(np.float32).itemsize
    require_memory(picked + scaled, Path(name).stat().st_size)
    with decoder_errors("NIfTI"), ImageOpener(name) as file:
        return np.asanyarray(fileslice(file, index, data.shape, data.dtype, data.offset, order="F")), slope, intercept


def _open(path: Path) -> Any:
    nibabel = import_extra("nibabel", "NIfTI files", "nibabel", "readers")
    # gzip errors are reported before nibabel's header errors
    with decoder_errors("gzip data"), gzip.open(path) if path.name.lower().endswith(".gz") else path.open("rb") as file:
        first = file.read(_SNIFF_BYTES)[:4]
    # the header's first number identifies NIfTI-2; nibabel's detection may run other parsers on the file
    is_nifti2 = first in (_NIFTI2_BYTES.to_bytes(4, "little"), _NIFTI2_BYTES.to_bytes(4, "big"))
    with decoder_errors("NIfTI"):
        form = nibabel.Nifti2Image if is_nifti2 else nibabel.Nifti1Image
        header = type("Header", (form.header_class,), {"exts_klass": _NoExtensions})
        reader: Any = type("Image", (form,), {"header_class": header})
        return reader.from_filename(path, mmap="r")


class _NoExtensions(list[object]):
    """Replaces nibabel's extensions, which allocate any length stated in the file."""

    @classmethod
    def from_fileobj(cls, _file: object, _size: int, _byteswap: bool) -> _NoExtensions:
        return cls()


def _check_bytes(path: Path, image: Any) -> None:
    dtype = image.get_data_dtype()
    _check([int(size) for size in image.shape], dtype)
    offset = int(image.dataobj.offset)
    if offset < 0:
        raise expected("vox_offset", "a place in the file", offset, "the header is damaged")
    needed, there = offset + byte_count(image.shape, dtype), path.stat().st_size
    if path.name.lower().endswith(".gz"):
        require_plausible(needed, there)
    else:
        require_bytes(needed, there)


def _scale(stored: np.ndarray, slope: float, intercept: float) -> np.ndarray:
    if slope == 1 and intercept == 0:
        return stored
    # plane by plane, to avoid a float64 copy of the whole
    scaled = np.empty(stored.shape, np.float32)
    for plane, source in zip(scaled, stored, strict=True):
        plane[...] = source * np.float64(slope) + intercept
    return scaled
