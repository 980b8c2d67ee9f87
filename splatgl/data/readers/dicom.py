"""DICOM through pydicom: files, folders and zips of slices, multi-frame files; one series is read, slice by slice.

Slices are sorted by ImagePositionPatient along the normal of ImageOrientationPatient (PS3.3 C.7.6.2); the patient's
frame is LPS in millimetres. Stored windows (VOI) are meant for slices and don't become the volume's: most begin below
air or background, which would be drawn, too.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from splatgl.data.affine import at_places
from splatgl.data.readers import dicom_segments
from splatgl.data.readers.dicom_grid import Grid, grid_of, largest_group
from splatgl.data.readers.dicom_headers import Frame, Header
from splatgl.data.readers.dicom_pixels import check_header, decoded, is_color
from splatgl.data.readers.dicom_series import SEGMENTS, Contents, chosen, contents
from splatgl.data.readers.options import LoadOptions
from splatgl.data.volume import Volume
from splatgl.errors import InputError, expected
from splatgl.fileio import byte_count, require_memory


def read(path: Path, options: LoadOptions) -> Volume:
    """The volume of the largest series of a file, folder or zip, or of the one that `series` names, in LPS.

    `array` picks one of several images at each place. Samples are rescaled (Hounsfield units); they stay whole numbers
    unless a scale, padding or a missing slice makes them float32, where NaN stands for what is not there.
    """
    # 1. which images
    found = contents(path)
    if not found.series:
        return _segments(found, options)
    if options.channel is not None:
        raise expected("channel", "none, for images", options.channel)
    series = chosen(found.series, options)
    notes = [f"{found.damaged} damaged file{'s are' if found.damaged > 1 else ' is'} left out"] if found.damaged else []
    if len(found.series) > 1 and options.series is None:
        notes.append(f"series {series.number} of {len(found.series)} is read, the largest; series=N picks another")
    for kind, title in SEGMENTS.items():
        count = sum(head.modality == kind for head in found.segments)
        notes += [f"{title} in {count} files ({kind}) beside the images are not drawn: --labels FILE adds one"] * (
            count > 0
        )
    group, left = largest_group(series.frames)
    for head in {id(frame.header): frame.header for frame in group}.values():
        with _of(head, group):
            check_header(head)
    notes += dict.fromkeys(note for frame in group for note in frame.header.notes)
    # 2. where they lie, and their samples
    grid = grid_of(group, options)
    samples, color = _samples(grid)
    if grid.between is not None:
        samples = at_places(samples, grid.between)
        color = None if color is None else at_places(color, np.rint(np.nan_to_num(grid.between)))
    return Volume(
        samples,
        grid.spacing,
        grid.origin,
        grid.direction,
        grid.unit,
        frame=grid.frame,
        color=color,
        notes=(*notes, *left, *grid.notes),
        value_unit=group[0].header.value_unit,
    )


def _segments(found: Contents, options: LoadOptions) -> Volume:
    """The labels of the only segmentation, or the only contours, that there are."""
    several = found.segments
    if len(several) > 1:
        names = ", ".join(head.source.name for head in several[:5])
        raise expected("DICOM", "one segmentation", f"{len(several)}: {names}", "name one of the files")
    return dicom_segments.read(several[0].source, several[0].modality, options)


@contextmanager
def _of(head: Header, group: Sequence[Frame]) -> Iterator[None]:
    """Puts the file's name before an error, where there are several."""
    try:
        yield
    except InputError as error:
        if len({frame.header.source for frame in group}) == 1 or "splatgl[" in str(error):
            raise
        raise InputError(f"{head.source.name}: {error}") from error


def _samples(grid: Grid) -> tuple[np.ndarray, np.ndarray | None]:
    """Samples [D, H, W], and colours uint8 [D, H, W, 3] if the frames have some."""
    planes = [(plane, frame) for plane, frame in enumerate(grid.planes) if frame is not None]
    group = [frame for _, frame in planes]
    shape = (len(grid.planes), *group[0].header.size)
    dtype = _dtype(group, len(planes) < len(grid.planes))
    headers = {id(frame.header): frame.header for frame in group}.values()
    voxel = dtype.itemsize + 3 * is_color(group[0].header)
    require_memory(byte_count(shape, np.dtype(np.uint8)) * voxel, sum(header.room for header in headers))
    samples = np.full(shape, np.nan, dtype) if len(planes) < len(grid.planes) else np.empty(shape, dtype)
    color = np.zeros((*shape, 3), np.uint8) if is_color(group[0].header) else None
    places = {id(frame): plane for plane, frame in planes}
    files: dict[int, list[Frame]] = {}
    for frame in group:
        files.setdefault(id(frame.header), []).append(frame)
    for each in files.values():
        with _of(each[0].header, group):
            for frame, stored, colors in decoded(each[0].header, each):
                plane = places[id(frame)]
                values = _values(frame, stored, samples.dtype)
                samples = _widened(samples, values)
                samples[plane] = values
                if color is not None and colors is not None:
                    color[plane] = colors
    return samples, color


def _dtype(group: Sequence[Frame], gaps: bool) -> np.dtype:
    """The type of rescaled values: the stored one, int16 where 16 bits are shifted, int32, or float32."""
    heads = [frame.header for frame in group]
    real = any(head.stored[0] == 0 or head.padding or head.lut is not None for head in heads)
    scales = {frame.scale for frame in group}
    if is_color(heads[0]) and not gaps:
        return np.dtype(np.uint8)
    if gaps or real or any(slope != 1 or not shift.is_integer() for slope, shift in scales):
        return np.dtype(np.float32)
    low, high = 0.0, 0.0
    for bits, signed in {head.stored for head in heads}:
        least = -(2.0 ** (bits - 1)) if signed else 0.0
        shifts = [shift for _, shift in scales]
        low = min(low, least + min(shifts))
        high = max(high, least + 2.0**bits - 1 + max(shifts))
    fitting = [np.dtype(name) for name in ("uint8", "int8", "uint16", "int16", "int32")]
    found = next((t for t in fitting if np.iinfo(t).min <= low and high <= np.iinfo(t).max), np.dtype(np.float32))
    # 16 bits shifted to Hounsfield units fit into as many, but for values that hardly ever are: see `_widened`
    return np.dtype(np.int16) if found == np.int32 and max(head.allocated for head in heads) <= 16 else found


def _widened(samples: np.ndarray, values: np.ndarray) -> np.ndarray:
    """The samples, as int32 if they are whole numbers that don't hold these values."""
    if samples.dtype.kind == "f" or np.can_cast(values.dtype, samples.dtype):
        return samples
    limits = np.iinfo(samples.dtype)
    fits = limits.min <= values.min() and values.max() <= limits.max
    return samples if fits else samples.astype(np.int32)


def _values(frame: Frame, stored: np.ndarray, dtype: np.dtype) -> np.ndarray:
    """Values of a frame: rescaled, MONOCHROME1 turned so that more is brighter, NaN for padding."""
    head, (slope, shift) = frame.header, frame.scale
    if is_color(head):
        return stored
    values = stored
    if head.lut is not None:
        first, table = head.lut
        values = table[np.clip(stored.astype(np.int64) - first, 0, len(table) - 1)]
    if head.photometric == "MONOCHROME1" and head.stored[0]:
        bits, signed = head.stored
        values = (-1 if signed else 2**bits - 1) - values.astype(np.int64)
    if dtype.kind != "f":
        return values.astype(np.int64) + int(shift) if shift else values
    scaled = values.astype(np.float64) * slope + shift
    if head.padding:
        scaled[(stored >= head.padding[0]) & (stored <= head.padding[1])] = np.nan
    return scaled
