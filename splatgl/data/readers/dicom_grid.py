"""Slices sorted into an even grid: by their positions, with gaps, repeated places and a tilted gantry."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np

from splatgl.data.readers.dicom_headers import TIMES, Frame, normal_of
from splatgl.data.readers.options import LoadOptions
from splatgl.data.volume import Triple
from splatgl.errors import expected

# shares of a slice's distance: positions within are the same place; an even grid is told if it's off by more than
# EVEN, and not taken beyond UNEVEN
SAME, EVEN, UNEVEN = 0.01, 0.02, 0.25
# slices touch whose thickness is this share of their distance: where one is missing, it is at most a half
TOUCH = 0.65
# of uneven slices, distances above this multiple of the least may be gaps; planes for each slice at most
GAP, MOST_PLANES = 1.5, 8
# cosines, and shares of pixels' sizes, that are taken as equal
ALIKE = 2e-3


@dataclass(frozen=True)
class Grid:
    """Frames by plane, None where a slice is missing; spacing, origin, direction as `Volume` has them; notes.

    between: of uneven slices, the places of the volume's planes among those read (1.5: midway from the second to the
    third; NaN: left empty); None: planes as they are.
    """

    planes: tuple[Frame | None, ...]
    spacing: Triple
    origin: Triple
    direction: np.ndarray
    unit: str
    frame: str | None
    notes: tuple[str, ...]
    between: np.ndarray | None = None


def largest_group(frames: Sequence[Frame]) -> tuple[list[Frame], tuple[str, ...]]:
    """The frames of one size, kind and orientation that are largest; what is told of the others."""
    groups: dict[tuple[object, ...], list[tuple[np.ndarray, list[Frame]]]] = {}
    for frame in frames:
        head = frame.header
        key = (head.size, head.samples, head.photometric, frame.position is None, frame.orientation is None)
        shape = np.array([*(frame.orientation or ()), *(np.log(frame.spacing) if frame.spacing else ())])
        alike = groups.setdefault(key, [])
        for first, members in alike:
            if first.shape == shape.shape and np.abs(first - shape).max(initial=0) < ALIKE:
                members.append(frame)
                break
        else:
            alike.append((shape, [frame]))
    chosen = max((members for alike in groups.values() for _, members in alike), key=rank)
    left = len(frames) - len(chosen)
    return chosen, (f"{left} of {len(frames)} images have another size or orientation: left out",) if left else ()


def rank(frames: Sequence[Frame]) -> tuple[bool, int]:
    """Orders frames of a volume by size: stacks after single pictures, then by voxels."""
    return len(frames) > 1, sum(frame.header.size[0] * frame.header.size[1] for frame in frames)


def grid_of(frames: Sequence[Frame], options: LoadOptions) -> Grid:
    """The grid of frames of the same size and orientation. Raises InputError for slices that make no grid."""
    first = frames[0]
    across = first.spacing or (1.0, 1.0)
    unsized = () if first.spacing or first.position is None else ("no size of pixels: 1 mm is assumed",)
    unit = "mm" if first.spacing else ""
    if first.position is None or first.orientation is None:
        return _stacked(frames, options, across, unit)
    # 1. the images of each place, along the normal
    axes = np.array(first.orientation).reshape(2, 3)
    normal = normal_of(first.orientation)
    places = np.array([frame.position for frame in frames])
    along = places @ normal
    order = np.argsort(along, kind="stable")
    same = np.cumsum(np.append(0, np.diff(along[order]) > _least(along, abs(first.step or 0.0))))
    by_place = [[frames[order[n]] for n in group] for _, group in groupby(range(len(order)), lambda n: same[n])]
    chosen, notes = _one_each(by_place, options)
    notes += unsized
    # 2. the planes that they are, and the even step between them
    positions = np.array([frame.position for frame in chosen])
    between = None
    indices = np.zeros(1, np.int64) if len(chosen) == 1 else _indices(positions @ normal, chosen)
    if len(chosen) == 1:
        origin, step = positions[0], normal * abs(first.step or across[0])
    elif indices is None:
        origin, step, between, told = _resampled(positions, positions @ normal, chosen)
        notes += told
    else:
        origin, step = _line(indices, positions)
        notes += _told(indices, positions, origin, step)
    indices = np.arange(len(chosen)) if indices is None else indices
    planes: list[Frame | None] = [None] * (int(indices[-1]) + 1)
    for index, frame in zip(indices.tolist(), chosen, strict=True):
        planes[index] = frame
    length = float(np.linalg.norm(step))
    direction = np.column_stack([axes[0], axes[1], step / length])
    x, y, z = origin.tolist()
    return Grid(tuple(planes), (*across, length), (x, y, z), direction, unit or "mm", "LPS", notes, between)


def _stacked(frames: Sequence[Frame], options: LoadOptions, across: tuple[float, float], unit: str) -> Grid:
    """Frames without positions, in the order of their numbers."""
    if options.array is not None:
        raise expected("array", "none, for images without positions", repr(options.array))
    ordered = sorted(frames, key=lambda frame: (*_key(frame)[-1:], frame.header.source.name, frame.number))
    signed = ordered[0].step or across[0]
    step, direction = abs(signed), np.diag([1.0, 1.0, np.sign(signed)])
    how = f"{step:g} {unit}".strip() + " apart"
    notes = (f"no positions: {len(frames)} images in the order of their numbers, {how}",) if len(frames) > 1 else ()
    return Grid(tuple(ordered), (*across, step), (0.0, 0.0, 0.0), direction, unit, None, notes)


def _least(along: np.ndarray, step: float) -> float:
    """Distance below which two images are at the same place; step: from slice to slice, as the header has it, or 0."""
    widest = float(np.diff(np.sort(along)).max(initial=0))
    return max(min(SAME * widest, SAME * (step or np.inf)), 1e-4)


def _key(frame: Frame) -> tuple[float, ...]:
    return tuple(-np.inf if np.isnan(time) else time for time in frame.times)


def _one_each(by_place: list[list[Frame]], options: LoadOptions) -> tuple[list[Frame], tuple[str, ...]]:
    """One image of each place: the one of that number in the order of TIMES, else the first; what is told of it."""
    each = [sorted(images, key=lambda frame: (*_key(frame), frame.number)) for images in by_place]
    most, least = max(map(len, each)), min(map(len, each))
    if most == 1 or most != least:
        if options.array is not None:
            raise expected("array", "a series with as many images at each place", f"{least} to {most}")
        repeated = sum(map(len, each)) - len(each)
        told = f"{repeated} images repeat the place of another: the first of each is read"
        return [images[0] for images in each], (told,) if repeated else ()
    number = options.array_number(most)
    titles = zip(*(images[n].times for n in range(most) for images in each[:1]), strict=True)
    kinds = [title for (_, _, title), times in zip(TIMES, titles, strict=True) if len(set(times)) == most]
    told = f"{most} {(*kinds, 'images')[0]} at each place: number {number or 0} is read; array=N picks another"
    return [images[number or 0] for images in each], () if number is not None else (told,)


def _indices(along: np.ndarray, frames: Sequence[Frame]) -> np.ndarray | None:
    """Plane numbers of sorted places: multiples of the usual distance, where all others lack slices; consecutive ones
    where distances are about even; None of other slices, which are resampled.
    """
    apart = np.diff(along)
    lacking = _lacking(apart, frames)
    for step in (float(np.median(apart)), float(apart.min())):
        steps = np.rint(apart / step)
        if (steps >= 1).all() and (np.abs(apart - steps * step) <= EVEN * step * np.maximum(steps, 2)).all():
            if not lacking[steps > 1].all():
                return None
            missing = int(steps.sum()) - len(apart)
            if missing > len(along):
                fix = "pick another series, or leave out the slices that lie apart"
                raise expected("slices", "fewer missing than there are", f"{missing} missing of {len(along)}", fix)
            return np.append(0, np.cumsum(steps)).astype(np.int64)
    indices = np.arange(len(along))
    off = along - np.polyval(np.polyfit(indices, along, 1), indices)
    return indices if np.abs(off).max() <= UNEVEN * apart.mean() else None


def _lacking(apart: np.ndarray, frames: Sequence[Frame]) -> np.ndarray:
    """bool: between which slices, so far apart, others are missing.

    Where slices at the least distance touch, by their thickness, those that don't lack some. Of others, those whose
    distance is a multiple of that on both sides.
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


def _resampled(
    positions: np.ndarray, along: np.ndarray, frames: Sequence[Frame]
) -> tuple[np.ndarray, np.ndarray, np.ndarray, tuple[str, ...]]:
    """Origin [3] and step [3] of planes at the least distance of uneven slices, their places among the slices, and what
    is told of them. Raises InputError where that makes far more planes than there are slices.
    """
    apart = np.diff(along)
    least, span = float(apart.min()), float(along[-1] - along[0])
    count = round(span / least) + 1
    slope, start = np.polyfit(along - along[0], positions, 1)
    off = np.linalg.norm(positions - start - (along - along[0])[:, None] * slope, axis=1).max()
    if count > MOST_PLANES * len(along) or off > UNEVEN * least:
        got = f"distances from {least:.4g} to {apart.max():.4g} mm"
        raise expected("slices", "distances of one volume", got, "pick another series, or resample them")
    at = along[0] + least * np.arange(count)
    between = np.interp(at, along, np.arange(len(along)))
    lacking = _lacking(apart, frames)
    inside = lacking[np.minimum(between.astype(np.int64), len(apart) - 1)]
    # half a plane belongs to the slice on either side
    near = np.abs(at - along[np.rint(between).astype(np.int64)]) <= least / 2
    between = np.where(inside & near, np.rint(between), np.where(inside, np.nan, between))
    notes = [f"uneven slices, {least:.4g} to {apart.max():.4g} mm apart: resampled every {least:.4g} mm"]
    empty = int(np.isnan(between).sum())
    notes += [f"slices are missing: {empty} of {count} planes are left empty"] if empty else []
    return start, slope * least, between, tuple(notes)


def _line(indices: np.ndarray, positions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Origin [3] and step [3] of the even positions nearest to those of the planes, by least squares."""
    n = indices - indices.mean()
    step = n @ (positions - positions.mean(axis=0)) / (n @ n)
    return positions.mean(axis=0) - indices.mean() * step, step


def _told(indices: np.ndarray, positions: np.ndarray, origin: np.ndarray, step: np.ndarray) -> tuple[str, ...]:
    """What is told of missing slices and uneven distances. Raises InputError for slices that leave a line."""
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
        notes.append(f"uneven slices: drawn {length:.4g} mm apart, which is off by up to {off * length:.3g} mm")
    return tuple(notes)
