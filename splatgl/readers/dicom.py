"""DICOM series: selects one, sorts its slices into a grid, and reads it.

Slices are sorted by ImagePositionPatient along the normal of ImageOrientationPatient (PS3.3 C.7.6.2); the patient's
frame is LPS in millimetres. Stored windows (VOI) are for slices and not used: most begin below air or background,
which would be drawn, too.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, replace
from itertools import groupby
from operator import attrgetter
from pathlib import Path

import numpy as np

from splatgl.data.affine import interpolate_planes
from splatgl.data.volume import Triple, Volume
from splatgl.errors import InputError, error_prefix, expected
from splatgl.fileio import byte_count, require_memory
from splatgl.readers import dicom_segments
from splatgl.readers.dicom_frames import (
    TIMES,
    ULTRASOUND_VOLUME,
    DicomFrame,
    check_header,
    decode_frames,
    is_color,
    list_frames,
    slice_normal,
)
from splatgl.readers.dicom_headers import DicomHeader, find_sources, read_header
from splatgl.readers.dicom_vendors import ANGIOGRAM, value_hints
from splatgl.readers.options import LoadOptions


def read(path: Path, options: LoadOptions) -> Volume:
    """The volume in LPS of the largest series of a file, folder or zip, or of the series that `series` names.

    `array` picks one of several images at each place. Samples are rescaled (Hounsfield units); they stay whole numbers
    unless a scale, padding or a missing slice makes them float32; NaN stands for no value.
    """
    # 1. the images
    contents = find_series(path)
    if not contents.series:
        several = contents.segments
        if len(several) > 1:
            names = ", ".join(head.source.name for head in several[:5])
            raise expected("DICOM", "one segmentation", f"{len(several)}: {names}", "name one of the files")
        return dicom_segments.read(several[0].source, several[0].modality, options)
    if options.channel is not None:
        raise expected("channel", "no value for images", options.channel)
    series = select_series(contents.series, options)
    damaged = f"{contents.damaged} damaged file{'s are' if contents.damaged > 1 else ' is'} left out"
    notes = [damaged] * bool(contents.damaged)
    if len(contents.series) > 1 and options.series is None:
        which = f"{series.number} of {len(contents.series)}" + f" ({series.stack})" * bool(series.stack)
        notes.append(f"series {which} is read, the largest; series=N picks another")
    for kind, title in SEGMENTS.items():
        count = sum(head.modality == kind for head in contents.segments)
        note = f"{title} in {count} files ({kind}) next to the images are not rendered; --labels FILE adds one"
        notes += [note] * bool(count)
    group, left = largest_group(series.frames)
    for head in {id(frame.header): frame.header for frame in group}.values():
        with _with_file_name(head, group):
            check_header(head)
    notes += dict.fromkeys(note for frame in group for note in frame.header.notes)
    if len(group) == 1 and path.is_file() and group[0].header.source.member is None:
        others = sum(other.suffix.lower() == path.suffix.lower() for other in path.parent.iterdir()) - 1
        note = f"one slice; its folder has {others} more such files: give the folder for all slices of the series"
        notes += [note] * (others > 0)
    # 2. their grid and samples
    grid = make_grid(group, options)
    samples, color = _read_samples(grid)
    if grid.between is not None:
        samples = interpolate_planes(samples, grid.between)
        color = None if color is None else interpolate_planes(color, np.rint(np.nan_to_num(grid.between)))
    head = group[0].header
    return Volume(
        samples,
        grid.spacing,
        grid.origin,
        grid.direction,
        grid.unit,
        frame=grid.frame,
        color=color,
        notes=(*notes, *left, *grid.notes),
        value_unit=head.value_unit,
        quantity="dose" if head.modality == "RTDOSE" else "",
        hints=ANGIOGRAM if head.angiogram else value_hints(head.modality, samples, head.value_unit),
        times=grid.times,
        time_step=grid.time_step,
    )


def _with_file_name(head: DicomHeader, group: Sequence[DicomFrame]) -> AbstractContextManager[None]:
    """Puts the file's name before an error, if there are several files."""
    several = len({frame.header.source for frame in group}) > 1
    return error_prefix(head.source.name) if several else nullcontext()


def _read_samples(grid: SliceGrid) -> tuple[np.ndarray, np.ndarray | None]:
    """Samples [D, H, W], and colours uint8 [D, H, W, 3] of coloured frames, else None."""
    planes = [(plane, frame) for plane, frame in enumerate(grid.planes) if frame is not None]
    group = [frame for _, frame in planes]
    shape = (len(grid.planes), *group[0].header.mosaic.plane)
    dtype = _choose_dtype(group, len(planes) < len(grid.planes))
    headers = {id(frame.header): frame.header for frame in group}.values()
    voxel = dtype.itemsize + 3 * is_color(group[0].header)
    require_memory(byte_count(shape, np.dtype(np.uint8)) * voxel, sum(header.room for header in headers))
    samples = np.full(shape, np.nan, dtype) if len(planes) < len(grid.planes) else np.empty(shape, dtype)
    color = np.zeros((*shape, 3), np.uint8) if is_color(group[0].header) else None
    places = {id(frame): plane for plane, frame in planes}
    files: dict[int, list[DicomFrame]] = {}
    for frame in group:
        files.setdefault(id(frame.header), []).append(frame)
    for file_frames in files.values():
        with _with_file_name(file_frames[0].header, group):
            for frame, stored, colors in decode_frames(file_frames[0].header, file_frames):
                plane = places[id(frame)]
                values = _rescale(frame, stored, samples.dtype)
                samples = _widen(samples, values)
                samples[plane] = values
                if color is not None and colors is not None:
                    color[plane] = colors
    return samples, color


def _choose_dtype(group: Sequence[DicomFrame], gaps: bool) -> np.dtype:
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
    smallest = next((t for t in fitting if np.iinfo(t).min <= low and high <= np.iinfo(t).max), np.dtype(np.float32))
    # 16 bits shifted to Hounsfield units nearly always fit into 16 bits; `_widen` handles the exceptions
    return np.dtype(np.int16) if smallest == np.int32 and max(head.allocated for head in heads) <= 16 else smallest


def _widen(samples: np.ndarray, values: np.ndarray) -> np.ndarray:
    """The samples; as int32 if their type cannot hold these values."""
    if samples.dtype.kind == "f" or np.can_cast(values.dtype, samples.dtype):
        return samples
    limits = np.iinfo(samples.dtype)
    fits = limits.min <= values.min() and values.max() <= limits.max
    return samples if fits else samples.astype(np.int32)


def _rescale(frame: DicomFrame, stored: np.ndarray, dtype: np.dtype) -> np.ndarray:
    """Values of a frame: rescaled, MONOCHROME1 inverted so that larger is brighter, NaN for padding."""
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


# shares of the slice distance: positions within SAME are the same place; deviations from even slices above EVEN get a
# note, above UNEVEN there is no even grid
SAME, EVEN, UNEVEN = 0.01, 0.02, 0.25
# slices touch if their thickness is this share of their distance: where one is missing, the share is at most a half
TOUCH = 0.65
# distances of uneven slices above this multiple of the least may be gaps; most planes per slice
GAP, MOST_PLANES = 1.5, 8
# differences of cosines, and shares of pixel sizes, that count as equal
ALIKE = 2e-3


@dataclass(frozen=True)
class SliceGrid:
    """Frames by plane, None where a slice is missing; spacing, origin, direction as in `Volume`; notes.

    between: fractional slice numbers of the volume's planes, for uneven slices (1.5: midway from the second to the
    third; NaN: left empty); None: one plane per slice.
    """

    planes: tuple[DicomFrame | None, ...]
    spacing: Triple
    origin: Triple
    direction: np.ndarray
    unit: str
    frame: str | None
    notes: tuple[str, ...]
    between: np.ndarray | None = None
    times: int = 1
    time_step: float | None = None


def largest_group(frames: Sequence[DicomFrame]) -> tuple[list[DicomFrame], tuple[str, ...]]:
    """The largest group of frames of one stack; notes on the others."""
    chosen = max(group_frames(frames), key=rank)
    left = len(frames) - len(chosen)
    return chosen, (f"{left} of {len(frames)} images have another size or orientation: left out",) if left else ()


def group_frames(frames: Sequence[DicomFrame]) -> list[list[DicomFrame]]:
    """Frames of one stack, size, kind and orientation."""
    groups: dict[tuple[object, ...], list[tuple[np.ndarray, list[DicomFrame]]]] = {}
    for frame in frames:
        head = frame.header
        placed = (frame.position is None, frame.orientation is None)
        key = (frame.stack, head.mosaic.plane, head.samples, head.photometric, *placed)
        shape = np.array([*(frame.orientation or ()), *(np.log(frame.spacing) if frame.spacing else ())])
        alike = groups.setdefault(key, [])
        for first, members in alike:
            if first.shape == shape.shape and np.abs(first - shape).max(initial=0) < ALIKE:
                members.append(frame)
                break
        else:
            alike.append((shape, [frame]))
    return [members for alike in groups.values() for _, members in alike]


def split_stacks(frames: list[DicomFrame]) -> list[list[DicomFrame]]:
    """The stacks of a series, each of two frames at least; single frames stay with the largest stack."""
    groups = group_frames(frames)
    stacks = [group for group in groups if len(group) > 1] or [frames]
    if len(stacks) > 1:
        max(stacks, key=rank).extend(frame for group in groups if len(group) == 1 for frame in group)
    return stacks if len(stacks) > 1 else [frames]


def rank(frames: Sequence[DicomFrame]) -> tuple[bool, int]:
    """Sort key of frames by size: stacks after single pictures, then by voxels."""
    return len(frames) > 1, sum(math.prod(frame.header.mosaic.plane) for frame in frames)


def make_grid(frames: Sequence[DicomFrame], options: LoadOptions) -> SliceGrid:
    """The grid of frames of the same size and orientation. Raises InputError for slices that make no grid."""
    first = frames[0]
    across = first.spacing or (1.0, first.aspect)
    unsized = () if first.spacing or first.position is None else ("no size of pixels: 1 mm is assumed",)
    if not first.spacing and first.aspect != 1:
        unsized = (*unsized, f"pixels are {first.aspect:.4g} times as high as wide, by PixelAspectRatio")
    unit = "mm" if first.spacing else ""
    if first.position is None or first.orientation is None:
        grid = _stack_by_number(frames, options, across, unit)
        return replace(grid, notes=(*grid.notes, *unsized))
    # 1. the images at each place, along the normal
    axes = np.array(first.orientation).reshape(2, 3)
    normal = slice_normal(first.orientation)
    places = np.array([frame.position for frame in frames])
    along = places @ normal
    order = np.argsort(along, kind="stable")
    apart = np.diff(along[order])
    least = max(SAME * min(float(apart.max(initial=0)), abs(first.step or 0.0) or np.inf), 1e-4)
    same = np.cumsum(np.append(0, apart > least))
    by_place = [[frames[order[n]] for n in group] for _, group in groupby(range(len(order)), lambda n: same[n])]
    chosen, notes, times, time_step = _select_images(by_place, options)
    notes += unsized
    # 2. their plane numbers, and the even step between planes
    positions = np.array([frame.position for frame in chosen])
    between = None
    indices = np.zeros(1, np.int64) if len(chosen) == 1 else _plane_numbers(positions @ normal, chosen)
    if len(chosen) == 1:
        origin, step = positions[0], normal * abs(first.step or across[0])
    elif indices is None:
        origin, step, between, new_notes = _resample_planes(positions, positions @ normal, chosen)
        notes += new_notes
    else:
        # the even positions nearest to those of the planes, by least squares
        n = indices - indices.mean()
        step = n @ (positions - positions.mean(axis=0)) / (n @ n)
        origin = positions.mean(axis=0) - indices.mean() * step
        notes += _check_line(indices, positions, origin, step)
    indices = np.arange(len(chosen)) if indices is None else indices
    planes: list[DicomFrame | None] = [None] * (int(indices[-1]) + 1)
    for index, frame in zip(indices.tolist(), chosen, strict=True):
        planes[index] = frame
    length = float(np.linalg.norm(step))
    direction = np.column_stack([axes[0], axes[1], step / length])
    x, y, z = origin.tolist()
    # volumes of ultrasound lie in a frame of the transducer
    space = None if first.header.sop == ULTRASOUND_VOLUME else "LPS"
    return SliceGrid(
        tuple(planes), (*across, length), (x, y, z), direction, unit or "mm", space, notes, between, times, time_step
    )


def _stack_by_number(
    frames: Sequence[DicomFrame], options: LoadOptions, across: tuple[float, float], unit: str
) -> SliceGrid:
    """Frames without positions, in the order of their slices, or of their numbers; films are one slice."""
    notes: tuple[str, ...] = ()
    times, time_step = 1, None
    if any(frame.slice is None for frame in frames):
        for name in ("array", "time"):
            options.reject(name, "images with positions")
        ordered = sorted(frames, key=lambda frame: (*frame.order[-1:], frame.header.source.name, frame.number))
    else:
        number = attrgetter("slice")
        of_slice = groupby(sorted(frames, key=number), number)
        ordered, notes, times, time_step = _select_images([list(images) for _, images in of_slice], options)
    signed = (ordered[0].step if len(ordered) > 1 else None) or across[0]
    step, direction = abs(signed), np.diag([1.0, 1.0, np.sign(signed)])
    how = f"{step:g} {unit}".strip() + " apart"
    if len(ordered) > 1:
        notes = (*notes, f"no positions: {len(ordered)} images in the order of their numbers, {how}")
    return SliceGrid(
        tuple(ordered), (*across, step), (0.0, 0.0, 0.0), direction, unit, None, notes, times=times, time_step=time_step
    )


def _select_images(
    by_place: list[list[DicomFrame]], options: LoadOptions
) -> tuple[list[DicomFrame], tuple[str, ...], int, float | None]:
    """One image of each place, by its number `time` or `array` in the order of TIMES, else the first; notes on it, the
    number of time points, and seconds between them or None.
    """
    ordered = [sorted(images, key=lambda frame: (*frame.order, frame.number)) for images in by_place]
    most, least = max(map(len, ordered)), min(map(len, ordered))
    if most == 1 or most != least:
        for name in ("array", "time"):
            if getattr(options, name) is not None:
                raise expected(name, "a series with the same number of images at each position", f"{least} to {most}")
        repeated = sum(map(len, ordered)) - len(ordered)
        note = f"{repeated} images have the position of another one; the first of each is read"
        return [images[0] for images in ordered], (note,) if repeated else (), 1, None
    number = options.time_number(most)
    # the numbers of each kind; those of the first tag that differ everywhere
    values: dict[str, list[float]] = {}
    for n, (_, _, title) in enumerate(TIMES):
        column = [image.times[n] for image in ordered[0]]
        if len(set(column)) == most:
            values.setdefault(title, column)
    kinds = list(values)
    kind = (*kinds, "images")[0]
    chosen = [images[number] for images in ordered]
    picked = options.array is not None or options.time is not None
    timed = kind in TIME_KINDS
    shown = () if timed else values.get(kind, ())[:MOST_LISTED]
    listed = f" ({', '.join(f'{value:g}' for value in shown)})" if shown and kind != "images" else ""
    option = "time" if timed else "array"
    note = f"{most} {kind} at each position{listed}: number {number} is read; {option}=N picks another"
    return chosen, () if picked else (note,), most if timed else 1, _time_step(values) if timed else None


# kinds of images at the same place that are times, and those whose numbers are times, in seconds; most values in a note
TIME_KINDS = (
    *("phases", "time slots", "time slices", "time points", "trigger times", "frame times", "acquisitions"),
    "acquisition times",
)
CLOCKS = {"frame times": 1e-3, "trigger times": 1e-3, "acquisition times": 1.0}
MOST_LISTED = 8


def _time_step(values: dict[str, list[float]]) -> float | None:
    """Seconds between two time points by the first numbers that are times, None if they are unknown."""
    for kind, seconds in CLOCKS.items():
        step = float(np.median(np.diff(values.get(kind, (0.0, np.nan))))) * seconds
        if 0 < step < np.inf:
            return step
    return None


def _plane_numbers(along: np.ndarray, frames: Sequence[DicomFrame]) -> np.ndarray | None:
    """Plane numbers of sorted places: multiples of the usual distance if larger distances are gaps, consecutive numbers
    if distances are about even; None for other slices, which are resampled.
    """
    apart = np.diff(along)
    lacking = _find_gaps(apart, frames)
    for step in (float(np.median(apart)), float(apart.min())):
        steps = np.rint(apart / step)
        if (steps >= 1).all() and (np.abs(apart - steps * step) <= EVEN * step * np.maximum(steps, 2)).all():
            if not lacking[steps > 1].all():
                return None
            missing = int(steps.sum()) - len(apart)
            if missing > len(along):
                fix = "pick another series, or remove the slices at other distances"
                raise expected(
                    "slices", "at most as many missing as existing ones", f"{missing} missing of {len(along)}", fix
                )
            return np.append(0, np.cumsum(steps)).astype(np.int64)
    indices = np.arange(len(along))
    off = along - np.polyval(np.polyfit(indices, along, 1), indices)
    return indices if np.abs(off).max() <= UNEVEN * apart.mean() else None


def _find_gaps(apart: np.ndarray, frames: Sequence[DicomFrame]) -> np.ndarray:
    """bool: whether slices are missing in each of the distances `apart`.

    If slices at the least distance touch by their thickness: where slices don't touch. Otherwise: where the distance
    is a multiple of the distances on both sides.
    """
    least = float(apart.min())
    thick = np.array([max(frame.thickness or 0.0, abs(frame.step or 0.0)) for frame in frames])
    reach = np.maximum(thick[:-1], thick[1:])
    if (reach >= TOUCH * apart)[apart <= least * (1 + EVEN)].all():
        return np.asarray((apart > GAP * least) & (reach < TOUCH * apart))
    if len(apart) < 2:
        return np.zeros(len(apart), bool)
    before, after = np.append(apart[1], apart[:-1]), np.append(apart[1:], apart[-2])
    steps = np.rint(apart / before)
    multiple = (steps >= 2) & (np.abs(apart - steps * before) <= EVEN * apart)
    return np.asarray(multiple & (np.abs(before - after) <= EVEN * before))


def _resample_planes(
    positions: np.ndarray, along: np.ndarray, frames: Sequence[DicomFrame]
) -> tuple[np.ndarray, np.ndarray, np.ndarray, tuple[str, ...]]:
    """Origin [3], step [3], fractional slice numbers and notes of planes at the least distance of uneven slices."""
    apart = np.diff(along)
    least, span = float(apart.min()), float(along[-1] - along[0])
    count = round(span / least) + 1
    slope, start = np.polyfit(along - along[0], positions, 1)
    off = np.linalg.norm(positions - start - (along - along[0])[:, None] * slope, axis=1).max()
    if count > MOST_PLANES * len(along) or off > UNEVEN * least:
        got = f"distances from {least:.4g} to {apart.max():.4g} mm"
        raise expected("slices", "about even distances", got, "pick another series, or resample them")
    at = along[0] + least * np.arange(count)
    between = np.interp(at, along, np.arange(len(along)))
    lacking = _find_gaps(apart, frames)
    inside = lacking[np.minimum(between.astype(np.int64), len(apart) - 1)]
    # up to half a step around a slice belongs to it
    near = np.abs(at - along[np.rint(between).astype(np.int64)]) <= least / 2
    between = np.where(inside & near, np.rint(between), np.where(inside, np.nan, between))
    notes = [f"uneven slices, {least:.4g} to {apart.max():.4g} mm apart: resampled every {least:.4g} mm"]
    empty = int(np.isnan(between).sum())
    notes += [f"slices are missing: {empty} of {count} planes are left empty"] if empty else []
    return start, slope * least, between, tuple(notes)


def _check_line(indices: np.ndarray, positions: np.ndarray, origin: np.ndarray, step: np.ndarray) -> tuple[str, ...]:
    """Notes on missing slices and uneven distances. Raises InputError for slices that do not lie on a line."""
    length = float(np.linalg.norm(step))
    off = float(np.linalg.norm(positions - origin - indices[:, None] * step, axis=1).max()) / length
    if off > UNEVEN:
        got = f"slices up to {off:.0%} of their distance of {length:.4g} mm beside it"
        raise expected("slices", "positions along a line", got, "pick another series")
    notes = []
    missing = int(indices[-1]) + 1 - len(indices)
    if missing:
        notes.append(f"{missing} of {indices[-1] + 1} slices are missing: left empty")
    if off > EVEN:
        notes.append(f"uneven slices: rendered {length:.4g} mm apart, an error of up to {off * length:.3g} mm")
    return tuple(notes)


# kinds of files without a volume, as messages name them
OTHERS = {
    "SEG": "a segmentation",
    "RTSTRUCT": "contours",
    "RTPLAN": "a treatment plan, without an image",
    "SR": "a report, without an image",
    "DICOMDIR": "a DICOMDIR, a table of contents: name the folder that it is in",
}

# kinds of files whose segments are read
SEGMENTS = {"SEG": "segmentations", "RTSTRUCT": "contours"}
DICOMDIR_CLASS = "1.2.840.10008.1.3.10"


@dataclass(frozen=True)
class DicomSeries:
    """A series of images, or a stack of it: its number in the list, and its frames."""

    number: int
    frames: tuple[DicomFrame, ...]

    @property
    def head(self) -> DicomHeader:
        """The header of the first frame, whose UID, kind and description are those of the series."""
        return self.frames[0].header

    @property
    def stack(self) -> str:
        """Its stack in the series, "" if it is the whole."""
        return self.frames[0].stack

    def __str__(self) -> str:
        """Description without UID or anything that identifies a patient."""
        rows, columns = self.head.mosaic.plane
        text = f"{self.number}: {self.head.modality}, {len(self.frames)} × {columns} × {rows}"
        return ", ".join(filter(None, (text, self.head.description, self.stack)))


@dataclass(frozen=True)
class DicomContents:
    """Contents of a path: series in the order of their numbers; number of damaged files; headers without images."""

    series: tuple[DicomSeries, ...]
    damaged: int
    others: tuple[DicomHeader, ...] = ()

    @property
    def segments(self) -> list[DicomHeader]:
        """Headers of files that label voxels."""
        return [head for head in self.others if head.modality in SEGMENTS]


def find_series(path: Path) -> DicomContents:
    """The series and segments of a path. Raises InputError, which describes other contents, if there are none."""
    files = find_sources(path)
    if not files:
        raise expected("DICOM", "DICOM files", "none", "give the folder or file that contains them")
    members: dict[str, list[DicomFrame]] = {}
    others: list[DicomHeader] = []
    failed: list[InputError] = []
    for source in files:
        try:
            head, tags = read_header(source)
            is_image = min(head.size) > 0 and head.modality not in OTHERS
            if is_image and not head.pixels:
                raise expected("file", "pixels after its header", "none", "it is truncated, or contains no image")
            file_frames = list_frames(head, tags) if is_image else []
        except InputError as error:
            if len(files) == 1 or "splatgl[" in str(error):
                raise
            failed.append(error)
            continue
        if file_frames:
            members.setdefault(head.series, []).extend(file_frames)
        else:
            others.append(head)
    if not members and not any(head.modality in SEGMENTS for head in others):
        raise _no_images_error(others, failed)
    ordered = sorted(members.values(), key=lambda frames: (frames[0].header.number, frames[0].header.series))
    stacks = (stack for frames in ordered for stack in split_stacks(frames))
    series = tuple(DicomSeries(number, tuple(stack)) for number, stack in enumerate(stacks, 1))
    return DicomContents(series, len(failed), tuple(others))


def _no_images_error(others: Sequence[DicomHeader], failed: Sequence[InputError]) -> InputError:
    """The error for a path without images, naming the kind of file that is there instead."""
    if not others and failed:
        return InputError(f"none of {len(failed)} DICOM files can be read: {failed[0]}")
    kinds = {"DICOMDIR" if head.sop == DICOMDIR_CLASS else head.modality for head in others}
    return expected("DICOM", "images", next((OTHERS[kind] for kind in OTHERS if kind in kinds), "files without pixels"))


def rank_series(series: DicomSeries) -> tuple[bool, int]:
    """Sort key of series by the size of their largest stack."""
    return rank(largest_group(series.frames)[0])


def select_series(candidates: Sequence[DicomSeries], options: LoadOptions) -> DicomSeries:
    """The series that `series` names by number, UID or end of a UID, else the largest."""
    if options.series is None:
        return max(candidates, key=rank_series)
    requested = str(options.series)
    if requested.isascii() and requested.isdigit() and 1 <= int(requested[:9]) <= len(candidates):
        return candidates[int(requested[:9]) - 1]
    ends = [candidate for candidate in candidates if candidate.head.series.endswith(requested)]
    matches = [candidate for candidate in ends if candidate.head.series == requested] or ends
    if len({candidate.head.series for candidate in matches}) != 1:
        this, got = f"a number from 1 to {len(candidates)}, or the end of one UID", f"{len(matches) or 'no'} matches"
        listed = "; ".join(map(str, candidates[:LISTED])) + "; …" * (len(candidates) > LISTED)
        raise expected("series", this, got, f"pick one of {listed}")
    return max(matches, key=rank_series)


# most series that a message lists
LISTED = 5


def list_series(path: Path) -> list[str]:
    """A heading, and a line for each series."""
    return ["series", *(f"  {series}" for series in find_series(path).series)]
