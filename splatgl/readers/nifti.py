"""Files that nibabel reads: NIfTI, Analyze, MGH, MINC 1 and 2, AFNI and Philips' PAR/REC, in RAS and millimetres.

Analyze files state no orientation: nibabel takes x from right to left, as SPM does. NIfTI pairs have the same endings.

nibabel's arrays are [x, y, z] with x fastest, and its affine takes (x, y, z) to RAS+ (nipy.org/nibabel, "Coordinate
systems and affines"); the transpose of the array is [z, y, x]. MINC's arrays are [z, y, x] or [t, z, y, x].
"""

from __future__ import annotations

import io
import math
import re
import struct
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from splatgl.data.affine import volume_on_grid
from splatgl.data.volume import Volume, triple
from splatgl.errors import expected, import_extra
from splatgl.fileio import byte_count, require_memory
from splatgl.readers.channels import MAGNITUDE_NOTE, ChannelSet, Components, magnitudes, split_voxels
from splatgl.readers.common import (
    decoder_errors,
    grid_shape,
    map_array,
    open_unpacked,
    packing_of,
    require_bytes,
    require_plausible,
)
from splatgl.readers.hdf5_files import open_hdf5
from splatgl.readers.microscopes import BoundedFile
from splatgl.readers.options import LoadOptions

# bytes of an Analyze header, and its first number
_HEADER = 348
_MGH_TYPES: dict[int, np.dtype] = {0: np.dtype(">u1"), 1: np.dtype(">i4"), 3: np.dtype(">f4"), 4: np.dtype(">i2")}
# byte at which the samples of an .mgh file begin, behind its header
_MGH_START = 284
# bytes of the flag that tells whether an .mgh file states spacing and orientation
_RAS_FLAG = slice(28, 30)
# an index [x, y, z, …], a function that reads the samples [z, y, x] there; slope and intercept of samples
Index = tuple[int | slice, ...]
Read = Callable[[Index], np.ndarray]
Scaling = tuple[float, float]
_NOT_SCALED: Scaling = (1.0, 0.0)


def read_analyze(path: Path, options: LoadOptions) -> Volume:
    """The volume of an Analyze or NIfTI pair in RAS, packed or not; `time` picks the time point of a 4-D image."""
    nibabel = import_extra("nibabel", "Analyze files", "nibabel", "readers")
    # 1. both files; `path` may be either
    stem, packing = re.fullmatch(r"(.*?)\.[^.]*(\.gz|)", path.name, re.I | re.S).groups()  # type: ignore[union-attr]
    header, data = (
        find_beside(path, stem, (f"{suffix}{packing}", f"{suffix.upper()}{packing}")) for suffix in (".hdr", ".img")
    )
    first = _first_bytes(header)
    if first[344:347] == b"ni1" or first[4:7] == b"ni2":
        return _read_nifti(first, data, options)
    if len(first) < _HEADER or struct.pack("<i", _HEADER) not in (first[:4], first[3::-1]):
        raise expected(header.name, "an Analyze header of 348 bytes", "another header", "is this an Analyze file?")
    # 2. its sizes, checked against the data; SPM's scale factor and origin, without its .mat file
    with decoder_errors("Analyze"):
        fields = nibabel.spm2analyze.Spm2AnalyzeHeader(first[:_HEADER])
        shape, dtype, start = _shape(fields), fields.get_data_dtype(), int(fields.get_data_offset())
        scaling, affine = _scaling(*fields.get_slope_inter()), fields.get_best_affine()
    read_samples = _open_samples(data, shape, dtype, start, scaling)
    options.reject("channel", "several numbers per voxel")

    def read_time(time: int) -> np.ndarray:
        return read_samples((*[slice(None)] * 3, *map(int, np.unravel_index(time, shape[3:], order="F"))))

    volume = volume_in_time(read_time, math.prod(shape[3:]), 0.0, affine, options)
    matlab = header.with_name(f"{stem}.mat")
    note = f"the orientation in {matlab.name} is not read: save the volume as NIfTI with SPM"
    return replace(volume, notes=(*volume.notes, *[note] * matlab.is_file()))


def find_beside(path: Path, stem: str, endings: tuple[str, ...]) -> Path:
    """The file of a pair beside `path`, or `path` itself. Raises InputError without one."""
    found = next((path.with_name(stem + ending) for ending in endings if path.with_name(stem + ending).is_file()), None)
    if found is None:
        raise expected("pair", f"{stem}{endings[0]} beside it", "none", "put both files side by side")
    return found


def read_mgh(path: Path, options: LoadOptions) -> Volume:
    """The volume of an .mgh or .mgz file in RAS; `array` picks one of several frames."""
    nibabel = import_extra("nibabel", "MGH files", "nibabel", "readers")
    with decoder_errors("MGH"), open_unpacked(path) as file:
        first = file.read(_MGH_START)
    require_bytes(_MGH_START, len(first), "header")
    version, *sizes, code = struct.unpack(">6i", first[:24])
    if version != 1 or code not in _MGH_TYPES:
        raise expected("header", "version 1, and type 0, 1, 3 or 4", f"{version}, {code}", "is this an MGH file?")
    read_samples = _open_samples(path, sizes, _MGH_TYPES[code], _MGH_START)
    with decoder_errors("MGH"):
        affine = nibabel.freesurfer.mghformat.MGHHeader(first).get_affine()
    volume = volume_on_affine(read_samples(options.index(sizes, {3: "array"})), affine)
    note = "the header states no orientation (goodRASFlag 0): coronal slices of voxels of 1 mm are taken"
    is_oriented = any(first[_RAS_FLAG])
    return volume if is_oriented else replace(volume, notes=(*volume.notes, note))


def volume_in_time(
    read_time: Callable[[int], np.ndarray], times: int, step: float, affine: np.ndarray, options: LoadOptions
) -> Volume:
    """The volume of the picked time point. read_time: samples [z, y, x] of a time point. step: seconds between two.
    affine [4, 4]: from indices (x, y, z) to RAS in millimetres.
    """

    def read_one(_: int | None) -> Volume:
        samples = read_time(options.time_number(times))
        if samples.dtype.kind not in "buif":
            raise expected("samples", "real numbers", samples.dtype, "convert it to one number per voxel")
        return volume_on_affine(samples.astype(np.float32) if samples.dtype == np.float64 else samples, affine)

    return ChannelSet(times=times, step=step).volume(options, read_one)


def volume_on_affine(samples: np.ndarray, affine: np.ndarray) -> Volume:
    """The volume of samples [z, y, x] in millimetres, by an affine [4, 4] of nibabel."""
    return volume_on_grid(samples, affine[:3, :3], affine[:3, 3], "affine", unit="mm", frame="RAS")


def check_sizes(sizes: Sequence[int], space: slice = slice(3)) -> None:
    """Raises InputError for sizes that no image has. space: those along x, y and z, in either order."""
    grid_shape(sizes[space])
    if min(sizes) < 1:
        raise expected("dimensions", "at least one entry along each axis", list(sizes), "the header is damaged")


# units of length by the lowest three bits of xyzt_units (nifti1.h); other codes are no lengths
_UNITS = {1: "m", 2: "mm", 3: "um"}
# seconds of the units of time in the next three bits
_TIMES = {8: 1.0, 16: 1e-3, 24: 1e-6}
# NIFTI_INTENT_DISPVECT, VECTOR, RGB_VECTOR and RGBA_VECTOR: numbers of a voxel along the fifth axis
_COMPONENTS = (1006, 1007, 2003, 2004)
_VECTORS_ALONG = "vectors are taken along right, front and head; programs of ITK write them along left, back and head"
# NIFTI_INTENT_LABEL: samples number segments (nifti1.h)
_LABELS = 1002
UNORIENTED = "no sform or qform: the file does not state the patient's orientation"

# bytes of the header of NIfTI-2; NIfTI-1 has 348. Bytes read to check gzip data: more than either
_NIFTI2_BYTES, _SNIFF_BYTES = 540, 1024


def read(path: Path, options: LoadOptions) -> Volume:
    """The volume of a .nii, .nii.gz or .nii.bz2 file in RAS, packed or not by its contents; `time` picks the time point
    of a 4-D image, `array` one of several numbers along its fifth axis.

    Samples with a slope or intercept are scaled to float32, others keep their type.
    """
    return _read_nifti(_first_bytes(path), path, options)


def _first_bytes(path: Path) -> bytes:
    """The first bytes of a file, unpacked: errors of its packing are reported before nibabel's header errors."""
    with decoder_errors("packed data" if packing_of(path) else "NIfTI"), open_unpacked(path) as file:
        return bytes(file.read(_SNIFF_BYTES))


def _read_nifti(first: bytes, data: Path, options: LoadOptions) -> Volume:
    """The volume of a file that begins with these bytes. data: the file of the samples, the same or the other of a
    pair.
    """
    nibabel = import_extra("nibabel", "NIfTI files", "nibabel", "readers")
    # the header's first number identifies NIfTI-2; nibabel's detection may run other parsers on the file
    is_nifti2 = first[:4] in (_NIFTI2_BYTES.to_bytes(4, "little"), _NIFTI2_BYTES.to_bytes(4, "big"))
    is_pair = (first[4:7] if is_nifti2 else first[344:347]) in (b"ni1", b"ni2")
    module = nibabel.nifti2 if is_nifti2 else nibabel.nifti1
    form = getattr(module, f"Nifti{1 + is_nifti2}{'Pair' * is_pair}Header")
    with decoder_errors("NIfTI"):
        header = form(first[: form.sizeof_hdr])
        shape, dtype, start = _shape(header), header.get_data_dtype(), int(header.get_data_offset())
    scaling = _scaling(float(header["scl_slope"]), float(header["scl_inter"]))
    read_samples = _open_samples(data, shape, dtype, start, scaling)
    affine, notes = _affine(header)
    volume = _volume_of(header, shape, affine, read_samples, options)
    return replace(volume, notes=(*notes, *volume.notes))


def _shape(header: Any) -> tuple[int, ...]:
    """The sizes that a header of nibabel states, three at least."""
    sizes = tuple(int(size) for size in header.get_data_shape())
    return (*sizes, 1) if len(sizes) == 2 else sizes


def volume_of_image(image: Any, options: LoadOptions) -> Volume:
    """The volume of a nibabel image with a NIfTI header, in a file or in memory, as `read` returns it."""
    data, sizes = image.dataobj, tuple(int(size) for size in image.shape)
    codes = image.header["sform_code"] or image.header["qform_code"]
    is_stored = hasattr(data, "get_unscaled")
    scaling = (float(data.slope), float(data.inter)) if is_stored else _NOT_SCALED

    def read_whole(index: Index) -> np.ndarray:
        return _scale(np.asanyarray(data.get_unscaled() if is_stored else data)[index].T, *scaling)

    file = getattr(data, "file_like", None)
    read_samples: Read = read_whole
    if isinstance(file, str | Path):
        read_samples = _open_samples(Path(file), sizes, data.dtype, int(data.offset), scaling)
    return _volume_of(image.header, sizes, image.affine if codes else None, read_samples, options)


def _open_samples(
    path: Path, shape: Sequence[int], dtype: np.dtype, start: int, scaling: Scaling = _NOT_SCALED
) -> Read:
    """A function that reads the samples [z, y, x] of a file at an index, mapped where the file permits. shape: in the
    file, [x, y, z, …]; start: the byte of the first, unpacked if the file is packed. Raises InputError for a file that
    cannot hold them.
    """
    # nibabel names the parts of RGB24 and RGBA32
    if dtype.kind not in "uifc" and dtype.names not in (("R", "G", "B"), ("R", "G", "B", "A")):
        raise expected("samples", "numbers or colours", dtype, "convert the file to one number per voxel")
    check_sizes(shape)
    needed, there, packed = start + byte_count(shape, dtype), path.stat().st_size, packing_of(path)
    if packed:
        require_plausible(needed, there, bounded=packed == "gzip")
    else:
        require_bytes(needed, there)

    def read_samples(index: Index) -> np.ndarray:
        if not packed:
            return _scale(map_array(path, start, dtype, shape[::-1]).T[index].T, *scaling)
        from nibabel.arrayproxy import ArrayProxy

        # memory for the picked samples only; scaled ones take room twice
        count = math.prod(size for size, at in zip(shape, index, strict=True) if at == slice(None))
        room = dtype.itemsize + (scaling != _NOT_SCALED) * np.dtype(np.float32).itemsize
        require_memory(count * room, there)
        with decoder_errors("packed data"), open_unpacked(path) as file:
            stored = np.asanyarray(ArrayProxy(file, (tuple(shape), dtype, start))[index])
        return _scale(stored.T, *scaling)

    return read_samples


def _scaling(slope: float | None, intercept: float | None) -> Scaling:
    """Slope and intercept; a slope of zero or none means no scaling, an intercept that is no number 0 (nifti1.h)."""
    if not slope or not np.isfinite(slope):
        return _NOT_SCALED
    return slope, intercept if intercept and np.isfinite(intercept) else 0.0


# square of a quaternion's first part that counts as 0, half a turn (nifti1_io.c)
_HALF_TURN = 1e-7
# length beyond 1 of a quaternion that is more than rounding
_ROUNDED = 1e-3
# share of a voxel by which sform and qform may differ across the grid
_SAME_PLACE = 0.5


def _affine(header: Any) -> tuple[np.ndarray | None, tuple[str, ...]]:
    """The grid [4, 4], None without one, and notes: the sform, else the qform, unless it is no grid."""
    notes: list[str] = []
    grids: list[tuple[str, np.ndarray]] = []
    for name in ("sform", "qform"):
        if int(header[f"{name}_code"]):
            with decoder_errors("NIfTI"), np.errstate(all="ignore"):
                matrix, length = (header.get_sform(), 1.0) if name == "sform" else _qform(header)
                matrix = np.asarray(matrix, np.float64)
            if not grids and length > 1 + _ROUNDED:
                notes.append(f"the qform's quaternion is {length:.3g} long, and taken for one of length 1")
            if np.isfinite(matrix).all() and (np.linalg.norm(matrix[:3, :3], axis=0) > 0).all():
                grids.append((name, matrix))
            elif not grids:
                notes.append(f"the file's {name} is no grid and ignored")
    if len(grids) == 2:
        # the largest distance between the places of the grid's corners
        sizes = (*header.get_data_shape(), 1)[:3]
        corners = np.array(list(product(*((0, size) for size in sizes), (1,))), np.float64)
        matrix, other = (matrix for _, matrix in grids)
        far = float(np.linalg.norm(corners @ (other - matrix).T, axis=1).max())
        if far > _SAME_PLACE * np.linalg.norm(matrix[:3, :3], axis=0).min():
            notes.append(f"the sform is used; the qform differs from it by up to {far:.3g}")
    return grids[0][1] if grids else None, tuple(notes)


def _qform(header: Any) -> tuple[np.ndarray, float]:
    """The grid [4, 4] by the header's quaternion (nifti1.h, method 2), and the length of its three stored parts. The
    fourth is what they lack to length 1; where they are longer, by rounding or not, they are normed, as the format's
    library does.
    """
    from nibabel.quaternions import quat2mat

    others = np.array([header[f"quatern_{letter}"] for letter in "bcd"], np.float64)
    square = float(others @ others)
    turn = quat2mat((math.sqrt(1 - square) if square < 1 - _HALF_TURN else 0.0, *others))
    steps = np.abs(np.asarray(header["pixdim"][1:4], np.float64))
    # pixdim[0] is -1 where the third axis is mirrored; 0 counts as 1
    steps[2] *= -1.0 if header["pixdim"][0] < 0 else 1.0
    matrix = np.eye(4)
    matrix[:3, :3] = turn * steps
    matrix[:3, 3] = [header[f"qoffset_{axis}"] for axis in "xyz"]
    return matrix, math.sqrt(square)


def _volume_of(
    header: Any, sizes: tuple[int, ...], affine: np.ndarray | None, read_samples: Read, options: LoadOptions
) -> Volume:
    check_sizes(sizes)
    # time points, pixdim[4] apart
    zooms, intent = header.get_zooms(), int(header["intent_code"])
    axis = _component_axis(sizes, intent)
    seconds = _TIMES.get(int(header["xyzt_units"]) & 56, 0.0)
    step = float(zooms[3]) * seconds if len(zooms) > 3 else 0.0
    count = sizes[3] if len(sizes) > 3 and axis != 3 else 1
    extra = [n for n in range(4, len(sizes)) if sizes[n] > 1 and n != axis]
    if len(extra) == 1 and options.array is None:
        # numbers along a fifth axis are components, whatever the intent
        options = replace(options, array=options.channel, channel=None)
    times = ChannelSet(times=count, components=4, step=step)

    def read_volume(_: int | None) -> Volume:
        index, notes = _index(sizes, options, axis)
        samples, color, vectors, told = _interpret(read_samples(index), axis is not None, options)
        notes = (*notes, *told)
        unit = _UNITS.get(int(header["xyzt_units"]) & 7, "")
        more: Any = {"color": color, "vectors": vectors, "unit": unit}
        if affine is None:
            # a zoom of zero means unknown
            known = [abs(float(zoom)) or 1.0 for zoom in (*zooms, 1.0)[:3]]
            return Volume(samples, triple(known, "pixdim"), notes=(UNORIENTED, *notes), **more)
        return volume_on_grid(samples, affine[:3, :3], affine[:3, 3], "affine", frame="RAS", notes=notes, **more)

    volume = times.volume(options, read_volume)
    if intent != _LABELS:
        return volume
    rounded = volume.rounded()
    note = "fractions are rendered as amounts, although the file's intent is labels"
    return replace(volume, notes=(*volume.notes, note)) if rounded is None else replace(rounded, labels=())


def _component_axis(sizes: tuple[int, ...], intent: int) -> int | None:
    """The axis of a voxel's components by the file's intent, None without one; it is the fifth, in some files the
    fourth.
    """
    found = [axis for axis in (4, 3) if intent in _COMPONENTS and len(sizes) > axis and sizes[axis] > 1]
    return found[0] if found and (found[0] == 4 or sizes[3] in (3, 4)) else None


def _interpret(values: np.ndarray, componented: bool, options: LoadOptions) -> Components:
    """Samples, colours, vectors and notes of values [D, H, W], which may be complex or colours, or of [C, D, H, W]."""
    if values.dtype.names:
        values = np.ascontiguousarray(values)
        parts = values.view(np.uint8).reshape(*values.shape, -1)
        return (*split_voxels(parts, options)[:3], ())
    if not componented:
        options.reject("channel", "several numbers per voxel")
    if values.dtype.kind == "c":
        return magnitudes(values), None, None, (MAGNITUDE_NOTE,)
    if not componented:
        return values, None, None, ()
    samples, color, vectors, notes = split_voxels(np.moveaxis(values, 0, -1), options)
    return samples, color, vectors, notes if vectors is None else (_VECTORS_ALONG,)


def _index(sizes: tuple[int, ...], options: LoadOptions, whole: int | None) -> tuple[Index, tuple[str, ...]]:
    """The index of the picked samples, and a note on those that no option picked. whole: an axis that is kept."""
    times = sizes[3] if len(sizes) > 3 and whole != 3 else 1
    arrays = [axis for axis in range(4, len(sizes)) if sizes[axis] > 1 and axis != whole]
    if not arrays and times == 1:
        options.reject("array", "a file of several time points or arrays")
    notes: tuple[str, ...] = ()
    if len(arrays) == 1 and options.array is None:
        options = replace(options, array=0)
        notes = (f"array 0 of {sizes[arrays[0]]} is read: --array picks another",)
    # if there are several arrays, `array` picks one, not a time point
    picked: dict[int, str | int] = {axis: "array" if axis in arrays else 0 for axis in range(4, len(sizes))}
    if len(sizes) > 3:
        picked[3] = options.point if arrays else "time"
    picked.pop(-1 if whole is None else whole, None)
    return options.index(sizes, picked), notes


def _scale(stored: np.ndarray, slope: float, intercept: float) -> np.ndarray:
    if (slope, intercept) == _NOT_SCALED or stored.dtype.kind == "V":
        return stored
    # plane by plane, to avoid a float64 copy of the whole
    scaled = np.empty(stored.shape, np.complex64 if stored.dtype.kind == "c" else np.float32)
    for plane, source in zip(scaled, stored, strict=True):
        plane[...] = source * np.float64(slope) + intercept
    return scaled


# --- MINC, AFNI and PAR/REC -------------------------------------------------------------------------------------------


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
