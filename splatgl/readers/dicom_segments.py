"""DICOM segments as labels: segmentations (SEG, PS3.3 A.51), frame by frame, and contours (RTSTRUCT, PS3.3 C.8.8.6).

Segments that overlap are in several channels with a table each.
"""

from __future__ import annotations

from collections.abc import Callable, Container, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from splatgl.data.color import srgb_from_linear
from splatgl.data.volume import Label, Volume
from splatgl.errors import expected
from splatgl.fileio import byte_count, require_memory
from splatgl.readers.channels import Channel, ChannelSet, hex_color
from splatgl.readers.dicom_frames import (
    PALETTE,
    DicomFrame,
    check_header,
    decode_frames,
    list_frames,
    slice_normal,
    to_rgb,
)
from splatgl.readers.dicom_headers import (
    DicomHeader,
    DicomSource,
    dicom_errors,
    finite_numbers,
    plain_text,
    read_header,
)
from splatgl.readers.options import LoadOptions

# most channels for segments that overlap, and most segments of a file
MOST_LAYERS, MOST_SEGMENTS = 8, 4096
# most planes from the first to the last slice of segments
MOST_PLANES = 4096
# most voxels, and least voxel size in mm, of the grid for contours
MOST_VOXELS, FINEST = 2**25, 0.25
# voxels of the contours' grid before the first contour
MARGIN = 1.382
# closed contours (PS3.3 C.8.8.6.3); keyholes of the second kind leave out what two of them enclose
CLOSED = ("CLOSED_PLANAR", "CLOSEDPLANAR_XOR")
# mm by which points of a contour leave its plane, by which contours of a plane differ, and the cosine of planes that
# count as axial, coronal or sagittal
MOST_BENT, SAME_HEIGHT, NEARLY = 0.1, 0.02, 0.9999
# most numbers of contours, and most rows that the edges of a plane cross
MOST_POINTS, MOST_CROSSED = 10_000_000, 2**23


@dataclass(frozen=True)
class PlaneGrid:
    """Even planes: shape [D, H, W], and the grid as in `Volume`, in LPS and mm."""

    shape: tuple[int, int, int]
    spacing: tuple[float, float, float]
    origin: tuple[float, float, float]
    direction: np.ndarray


def read(source: DicomSource, kind: str, options: LoadOptions) -> Volume:
    """The labels of a segmentation or of contours; `channel` picks one if overlapping segments take several."""
    if options.array is not None or options.series is not None:
        raise expected("array and series", "no value for segments", "one", "pick segments by --only-labels")
    head, tags = read_header(source)
    with dicom_errors():
        table = _segment_labels(head, tags) if kind == "SEG" else _region_labels(tags)
        grid, masks, notes = (_frame_masks if kind == "SEG" else _contour_masks)(head, tags, table)
        layers, left = _pack_layers(grid, table, masks)
    # several layers become channels
    names = [
        ", ".join(label.name for label in labels) if len(labels) < 4 else f"segments {n}"
        for n, (_, labels) in enumerate(layers)
    ]
    channels = ChannelSet(tuple(map(Channel, names)) if len(layers) > 1 else (), together=True)

    def read_layer(channel: int | None) -> Volume:
        samples, labels = layers[channel or 0]
        at = (grid.spacing, grid.origin, grid.direction)
        return Volume(samples, *at, unit="mm", frame="LPS", labels=labels, notes=(*notes, *left))

    volume = channels.volume(options, read_layer)
    all_labels = tuple(label for channel in volume.channels for label in channel.labels or ())
    return replace(volume, labels=tuple(sorted(all_labels, key=lambda label: label.number))) if all_labels else volume


def _pack_layers(
    grid: PlaneGrid, table: Sequence[Label], masks: Callable[[int], Iterator[tuple[int, np.ndarray]]]
) -> tuple[list[tuple[np.ndarray, tuple[Label, ...]]], tuple[str, ...]]:
    """(samples [D, H, W], labels of their numbers) of each layer: a segment is in the first where it overlaps no other;
    notes on segments that are left out.
    """
    dtype = np.dtype(np.uint8 if max((label.number for label in table), default=0) < 256 else np.uint16)
    layers: list[np.ndarray] = []
    layer_labels: list[list[Label]] = []
    left, empty = 0, 0
    for label in table:
        planes = {n: mask for n, mask in masks(label.number) if mask.any()}
        if not planes:
            empty += 1
            continue
        place = next(
            (k for k, layer in enumerate(layers) if not any((layer[n] != 0)[m].any() for n, m in planes.items())), None
        )
        if place is None:
            if len(layers) == MOST_LAYERS:
                left += 1
                continue
            layers.append(np.zeros(grid.shape, dtype))
            layer_labels.append([])
            place = len(layers) - 1
        for n, mask in planes.items():
            layers[place][n][mask] = label.number
        layer_labels[place].append(label)
    if not layers:
        raise expected("segments", "at least one voxel", "none")
    notes = (f"{empty} of {len(table)} segments are empty",) * bool(empty)
    notes += (f"{left} of {len(table)} segments overlap more than {MOST_LAYERS} others: left out",) * bool(left)
    return [(layer, tuple(labels)) for layer, labels in zip(layers, layer_labels, strict=True)], notes


# --- segmentations ----------------------------------------------------------------------------------------------------


def _segment_labels(head: DicomHeader, tags: Any) -> tuple[Label, ...]:
    """Number, name and colour of each segment, of the file's palette if it states no other."""
    items = list(tags.get("SegmentSequence") or ())
    if not 1 <= len(items) <= MOST_SEGMENTS:
        raise expected("segments", f"1 to {MOST_SEGMENTS}", len(items), "the file is damaged")
    labels = {}
    for item in items:
        lab = finite_numbers(item.get("RecommendedDisplayCIELabValue"), 3)
        number = int(item.SegmentNumber)
        if 0 < number < 2**16:
            rgb = _srgb(lab) if lab else None
            if rgb is None and head.photometric == PALETTE:
                rgb = to_rgb(np.array([[number]], np.uint16), head, tags)[0, 0].tolist()
            labels[number] = Label(number, plain_text(item.get("SegmentLabel")), hex_color(rgb) if rgb else None)
    return tuple(labels.values())


def _srgb(lab: Sequence[float]) -> list[int]:
    """sRGB from 0 to 255 of CIELab as DICOM codes it (PS3.3 C.10.7.1.1), with white D65, as programs write it."""
    level = lab[0] / 65535 * 100
    a, b = (part / 65535 * 255 - 128 for part in lab[1:])
    f = (level + 16) / 116
    xyz = np.array([f + a / 500, f, f - b / 200])
    xyz = np.where(xyz > 6 / 29, xyz**3, 3 * (6 / 29) ** 2 * (xyz - 4 / 29)) * (0.95047, 1.0, 1.08883)
    linear = np.array([[3.2406, -1.5372, -0.4986], [-0.9689, 1.8758, 0.0415], [0.0557, -0.2040, 1.0570]]) @ xyz
    return [round(part * 255) for part in srgb_from_linear(np.clip(linear, 0.0, 1.0)).tolist()]


def _frame_masks(
    head: DicomHeader, tags: Any, table: Sequence[Label]
) -> tuple[PlaneGrid, Callable[[int], Iterator[tuple[int, np.ndarray]]], tuple[str, ...]]:
    """The grid of a segmentation, a function from a segment's number to its (plane, mask) pairs, and notes."""
    kind = str(tags.get("SegmentationType") or "BINARY").upper()
    if kind == "LABELMAP" and head.photometric == PALETTE:
        # the palette is a colour for each number
        head = replace(head, photometric="MONOCHROME2")
    check_header(head)
    frames = list_frames(head, tags)
    if any(frame.position is None or frame.orientation is None or frame.spacing is None for frame in frames):
        raise expected(
            "segments", "slices with positions, orientations and sizes of pixels", "none", "convert the file"
        )
    grid, planes = _place_frames(frames, head.size)
    if kind != "LABELMAP" and any(frame.segment is None for frame in frames):
        raise expected("frames", "a segment number per frame", "none", "the file is damaged")
    most = float((finite_numbers([tags.get("MaximumFractionalValue")], 1) or (255.0,))[0])

    require_memory(2 * byte_count(grid.shape, np.dtype(np.uint16)), head.room, what="segments")
    # all segments are in the same frames
    stored = list(decode_frames(head, frames, tags)) if kind == "LABELMAP" else []

    def masks(number: int) -> Iterator[tuple[int, np.ndarray]]:
        masks_by_plane: dict[int, np.ndarray] = {}
        own = stored or decode_frames(head, [frame for frame in frames if frame.segment == number], tags)
        for frame, values, _ in own:
            mask = (
                values == number if kind == "LABELMAP" else values * 2.0 >= most if kind == "FRACTIONAL" else values > 0
            )
            for plane in planes[frame.number]:
                masks_by_plane[plane] = masks_by_plane[plane] | mask if plane in masks_by_plane else mask
        yield from masks_by_plane.items()

    return grid, masks, ("fractions of segments are rendered from one half on",) * (kind == "FRACTIONAL")


def _place_frames(frames: Sequence[DicomFrame], size: tuple[int, int]) -> tuple[PlaneGrid, dict[int, list[int]]]:
    """The grid of frames, and the planes by frame number: one, or all that the thickness spans if steps are uneven."""
    first = frames[0]
    assert first.orientation is not None and first.spacing is not None
    axes = np.array(first.orientation).reshape(2, 3)
    normal = slice_normal(first.orientation)
    positions = np.array([frame.position for frame in frames])
    if np.abs(np.array([frame.orientation for frame in frames]) - first.orientation).max() > 2e-3:
        raise expected("segments", "frames of one orientation", "several", "convert the file")
    along = positions @ normal
    places = np.unique(np.round(along, 3))
    apart = np.diff(places)
    stated = abs(first.step or 0.0) or first.thickness or 1.0
    even = [h for h in (stated, float(apart.min()) if len(apart) else stated) if _is_multiple(apart, h)]
    step = even[0] if even else float(apart.min())
    count = round(float(np.ptp(along)) / step) + 1
    if count > MOST_PLANES:
        raise expected("segments", f"slices within {MOST_PLANES} planes", count, "the header is damaged")
    if len(places) > 1:
        slope, start = np.polyfit(along - along.min(), positions, 1)
    else:
        slope, start = normal, positions[0]
    reach = (step if even else max(step, first.thickness or 0.0)) / 2
    at = along.min() + step * np.arange(count)
    planes = {
        frame.number: np.flatnonzero(np.abs(at - place) <= reach * (1 + 1e-6)).tolist()
        or [int(np.abs(at - place).argmin())]
        for frame, place in zip(frames, along, strict=True)
    }
    length = float(np.linalg.norm(slope)) * step
    x, y, z = start.tolist()
    direction = np.column_stack([axes[0], axes[1], slope / np.linalg.norm(slope)])
    return PlaneGrid((count, *size), (*first.spacing, length), (x, y, z), direction), planes


def _is_multiple(apart: np.ndarray, step: float) -> bool:
    """Whether distances are whole numbers of steps."""
    counts = apart / step
    return bool(len(apart) == 0 or ((counts > 0.5).all() and np.abs(counts - np.rint(counts)).max() < 0.1))


# --- contours ---------------------------------------------------------------------------------------------------------


def _region_labels(tags: Any) -> tuple[Label, ...]:
    """Labels of the regions of interest with contours: number, name and colour."""
    names = {int(item.ROINumber): plain_text(item.get("ROIName")) for item in tags.get("StructureSetROISequence") or ()}
    labels = {}
    for item in list(tags.get("ROIContourSequence") or ())[:MOST_SEGMENTS]:
        number, color = int(item.ReferencedROINumber), finite_numbers(item.get("ROIDisplayColor"), 3)
        if item.get("ContourSequence") and 0 < number < 2**16:
            labels[number] = Label(number, names.get(number, ""), hex_color([int(c) for c in color]) if color else None)
    if not labels:
        raise expected("contours", "at least one", "none")
    return tuple(labels.values())


def _contour_masks(
    head: DicomHeader, tags: Any, table: Sequence[Label]
) -> tuple[PlaneGrid, Callable[[int], Iterator[tuple[int, np.ndarray]]], tuple[str, ...]]:
    """A grid for all contours, a function from a region's number to its (plane, mask) pairs, and notes."""
    closed, left = _closed_contours(tags, {label.number for label in table})
    axes = _contour_axes([points for _, points in closed])
    regions: dict[int, dict[float, list[np.ndarray]]] = {label.number: {} for label in table}
    flat = [(number, local) for number, points in closed if np.ptp((local := points @ axes.T)[:, 2]) <= MOST_BENT]
    heights = _merge_heights([float(local[:, 2].mean()) for _, local in flat])
    for (number, local), height in zip(flat, heights, strict=True):
        regions[number].setdefault(height, []).append(local[:, :2])
    left += len(closed) - len(flat)
    notes = (f"{left} contours are left out: points, open ones, or across the planes of the others",) * bool(left)
    outlines = [points for contours in regions.values() for some in contours.values() for points in some]
    grid = _contour_grid(outlines, np.unique([z for contours in regions.values() for z in contours]))
    at = grid.origin[2] + grid.spacing[2] * np.arange(grid.shape[0])
    note = f"contours are filled on a grid of {grid.spacing[0]:.3g} × {grid.spacing[1]:.3g} × {grid.spacing[2]:.3g} mm"

    def masks(number: int) -> Iterator[tuple[int, np.ndarray]]:
        contours = regions[number]
        places = np.array(sorted(contours))
        if not contours:
            return
        # if a region is drawn in every other slice, a contour stands for two slices
        thick = max(float(np.diff(places).min()) if len(places) > 1 else 0.0, grid.spacing[2])
        for n, z in enumerate(at):
            k = int(np.abs(places - z).argmin())
            if abs(places[k] - z) <= thick / 2 * (1 + 1e-6):
                yield n, _fill_contours(contours[float(places[k])], grid)

    x, y, z = (axes.T @ grid.origin).tolist()
    return replace(grid, origin=(x, y, z), direction=axes.T), masks, (note, *notes)


def _closed_contours(tags: Any, numbers: Container[int]) -> tuple[list[tuple[int, np.ndarray]], int]:
    """(number of the region, points [N, 3]) of each closed contour of these regions, and how many others there are."""
    closed, left, room = [], 0, MOST_POINTS
    for item in tags.ROIContourSequence:
        number = int(item.ReferencedROINumber)
        for contour in (item.get("ContourSequence") or ()) if number in numbers else ():
            data = np.array(contour.get("ContourData") or (), np.float64)
            room -= data.size
            if room < 0:
                raise expected("contours", f"at most {MOST_POINTS} numbers", "more")
            points = data[: data.size - data.size % 3].reshape(-1, 3)
            if contour.get("ContourGeometricType") in CLOSED and len(points) > 2 and np.isfinite(points).all():
                closed.append((number, points))
            else:
                left += 1
    if not closed:
        raise expected("contours", "closed contours", "points or open contours only", "pick another file")
    return closed, left


def _contour_axes(contours: Sequence[np.ndarray]) -> np.ndarray:
    """Rows u, v and normal [3, 3] of the plane of the largest of contours [N, 3]; exact axes where it is nearly axial,
    coronal or sagittal.
    """
    moved = [points - points.mean(axis=0) for points in contours]
    areas = [np.cross(points, np.roll(points, -1, axis=0)).sum(axis=0) for points in moved]
    normal = max(areas, key=np.linalg.norm)
    size = float(np.linalg.norm(normal))
    normal = normal / size if size > 0 else np.array([0.0, 0.0, 1.0])
    axis = int(np.abs(normal).argmax())
    normal = normal * np.sign(normal[axis])
    if normal[axis] > NEARLY:
        normal = np.eye(3)[axis]
    across = np.eye(3)[1 if abs(normal[0]) > NEARLY else 0]
    across = across - (across @ normal) * normal
    across /= np.linalg.norm(across)
    return np.stack([across, np.cross(normal, across), normal])


def _merge_heights(heights: Sequence[float]) -> list[float]:
    """The heights of contours, the same for those that differ by SAME_HEIGHT at most."""
    merged, first = dict[float, float](), -np.inf
    for height in sorted(heights):
        first = height if height - first > SAME_HEIGHT else first
        merged[height] = first
    return [merged[height] for height in heights]


def _contour_grid(outlines: Sequence[np.ndarray], places: np.ndarray) -> PlaneGrid:
    """A grid, in the contours' axes, of planes at the contours' distance, as fine as MOST_VOXELS permits."""
    low, high = (np.array([pick(points, axis=0) for points in outlines]) for pick in (np.min, np.max))
    low, high = low.min(axis=0), high.max(axis=0)
    apart = np.diff(places)
    step = float(apart.min()) if len(apart) else 1.0
    count = round(float(places[-1] - places[0]) / step) + 1
    if count > MOST_PLANES:
        raise expected("contours", f"at most {MOST_PLANES} planes", count, "convert the file")
    size = max(FINEST, float(np.sqrt((high - low).prod() * count / MOST_VOXELS)))
    # no simple fraction of a voxel: symmetric contours would all have the same error of area
    low = low - MARGIN * size
    columns, rows = (int(n) for n in np.ceil((high - low) / size) + 2)
    if byte_count((count, rows, columns), np.dtype("u1")) > 4 * MOST_VOXELS:
        raise expected("contours", "a smaller extent", f"{(high - low).tolist()} mm")
    x, y = low.tolist()
    return PlaneGrid((count, rows, columns), (size, size, step), (x, y, float(places[0])), np.eye(3))


def _fill_contours(contours: Sequence[np.ndarray], grid: PlaneGrid) -> np.ndarray:
    """bool [H, W]: voxels whose centre an odd number of contours [N, 2] encloses, so that inner contours are holes."""
    # in voxels, within the box around all of them
    outlines = [(points - np.array(grid.origin[:2])) / np.array(grid.spacing[:2]) for points in contours]
    (x0, y0), (x1, y1) = (
        np.concatenate(outlines).T,
        np.concatenate([np.roll(points, -1, axis=0) for points in outlines]).T,
    )
    ends = np.ceil([[pick(x0), pick(y0)] for pick in (np.min, np.max)])
    (left, top), (right, bottom) = np.clip(ends, 0, grid.shape[:0:-1]).astype(np.int64).tolist()
    crossed = np.zeros((bottom - top, right - left + 1), bool)
    # a place for each row that an edge crosses
    first, last = (np.ceil(pick(y0, y1)).clip(top, bottom).astype(np.int64) for pick in (np.minimum, np.maximum))
    counts = last - first
    if counts.sum() > MOST_CROSSED:
        raise expected("contours", f"at most {MOST_CROSSED} crossings of rows in a plane", counts.sum())
    edge = np.repeat(np.arange(len(counts)), counts)
    rows = np.arange(len(edge)) - (np.cumsum(counts) - counts - first)[edge]
    x = x0[edge] + (rows - y0[edge]) * (x1 - x0)[edge] / (y1 - y0)[edge]
    columns = np.ceil(x).clip(left, right).astype(np.int64)
    np.logical_xor.at(crossed, (rows - top, columns - left), True)
    mask = np.zeros(grid.shape[1:], bool)
    mask[top:bottom, left:right] = np.logical_xor.accumulate(crossed, axis=1)[:, :-1]
    return mask
