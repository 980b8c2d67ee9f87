"""Lists the frames of a DICOM file: their places, scales and times, by the headers of classic and enhanced files."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from splatgl.errors import expected
from splatgl.readers.dicom_headers import SIEMENS_B, Header, Numbers, dicom_errors, finite_numbers

# most frames of a file
MOST_FRAMES = 100_000

# tags that distinguish images at the same place, in this order: tag, its sequence in enhanced files, name
TIMES: tuple[tuple[str | int, str, str], ...] = (
    ("EnergyWindowVector", "", "energy windows"),
    ("DetectorVector", "", "detectors"),
    ("PhaseVector", "", "phases"),
    ("RRIntervalVector", "", "beats"),
    ("TimeSlotVector", "", "time slots"),
    ("TimeSliceVector", "", "time slices"),
    ("TemporalPositionIdentifier", "", "time points"),
    ("TemporalPositionIndex", "FrameContentSequence", "time points"),
    ("TriggerTime", "", "trigger times"),
    ("NominalCardiacTriggerDelayTime", "CardiacSynchronizationSequence", "trigger times"),
    ("EchoTime", "", "echo times"),
    ("EffectiveEchoTime", "MREchoSequence", "echo times"),
    ("DiffusionBValue", "", "b-values"),
    ("DiffusionBValue", "MRDiffusionSequence", "b-values"),
    (SIEMENS_B, "", "b-values"),
    ("FrameReferenceTime", "", "frame times"),
    ("AcquisitionNumber", "", "acquisitions"),
    ("AcquisitionTime", "", "acquisition times"),
    ("InstanceNumber", "", "images"),
)


@dataclass(frozen=True, eq=False)
class Frame:
    """An image: its header, its number in the file; position [3] and orientation [6] in LPS mm, as in DICOM.

    spacing: (x, y) of its pixels or None. step: from slice to slice by the header, or None; negative if frames of
    nuclear medicine are stacked against the normal. thickness: of the slice, or None. scale: (slope, intercept).
    times: values of TIMES, NaN for missing ones.
    """

    header: Header
    number: int
    position: Numbers | None
    orientation: Numbers | None
    spacing: tuple[float, float] | None
    step: float | None
    thickness: float | None
    scale: tuple[float, float]
    times: Numbers

    @property
    def order(self) -> Numbers:
        """Key that sorts images at one place: `times`, where NaN comes first."""
        return tuple(-math.inf if math.isnan(time) else time for time in self.times)


# classes of nuclear medicine images, where SpacingBetweenSlices has a sign (PS3.3 C.8.4.15)
NUCLEAR = ("1.2.840.10008.5.1.4.1.1.20", "1.2.840.10008.5.1.4.1.1.5")


def list_frames(of: Header, tags: Any) -> list[Frame]:
    """All frames of a file. Raises InputError for a damaged header, and for more frames than it has bytes."""
    if of.frames > min(of.room, MOST_FRAMES):
        this = f"at most {min(of.room, MOST_FRAMES)} frames, in {of.room} bytes"
        raise expected("pixels", this, of.frames, "the header is damaged")
    with dicom_errors():
        shared = next(iter(tags.get("SharedFunctionalGroupsSequence") or ()), None)
        per_frame = tags.get("PerFrameFunctionalGroupsSequence")
        if per_frame is not None and len(per_frame) != of.frames:
            raise expected("frames", f"{of.frames}, as the header says", len(per_frame), "the file is damaged")
        if per_frame is None:
            first = _read_frame(of, 0, _Groups(tags, ()))
            split = _split_mosaic(first) if of.mosaic.tiles > 1 else [first]
            return _multiframe(tags, first) if of.frames > 1 else split
        places = (tuple(item for item in (group, shared) if item is not None) for group in per_frame)
        return [_read_frame(of, number, _Groups(tags, groups)) for number, groups in enumerate(places)]


@dataclass(frozen=True)
class _Groups:
    """Functional groups of a frame, before the shared ones, and their data set."""

    tags: Any
    groups: tuple[Any, ...]

    def get(self, tag: str | int, sequence: str = "") -> Any:
        """The value of a tag: in a sequence of a functional group, else in the data set; None without one."""
        for group in self.groups if sequence else ():
            items = group.get(sequence)
            if items and items[0].get(tag) is not None:
                return items[0].get(tag)
        value = self.tags.get(tag)
        # an element by its number
        return getattr(value, "value", None) if isinstance(tag, int) else value


def _read_frame(of: Header, number: int, groups: _Groups) -> Frame:
    """Reads the header of a frame."""
    position = finite_numbers(groups.get("ImagePositionPatient", "PlanePositionSequence"), 3)
    orientation = finite_numbers(groups.get("ImageOrientationPatient", "PlaneOrientationSequence"), 6)
    detector = next(iter(groups.tags.get("DetectorInformationSequence") or ()), None)
    if detector is not None and position is None:
        position = finite_numbers(detector.get("ImagePositionPatient"), 3)
        orientation = orientation or finite_numbers(detector.get("ImageOrientationPatient"), 6)
    (thickness,) = finite_numbers([groups.get("SliceThickness", "PixelMeasuresSequence")], 1) or (0.0,)
    (gap,) = finite_numbers([groups.get("SpacingBetweenSlices", "PixelMeasuresSequence")], 1) or (0.0,)
    step = (gap if of.sop in NUCLEAR or of.modality == "NM" else abs(gap)) or abs(thickness)
    pixel = finite_numbers(
        groups.get("PixelSpacing", "PixelMeasuresSequence") or groups.tags.get("ImagerPixelSpacing"), 2
    )
    dose = finite_numbers([groups.tags.get("DoseGridScaling")], 1)
    slope = dose or finite_numbers([groups.get("RescaleSlope", "PixelValueTransformationSequence")], 1)
    shift = finite_numbers([groups.get("RescaleIntercept", "PixelValueTransformationSequence")], 1)
    times = [_read_time(groups, tag, sequence) for tag, sequence, _ in TIMES]
    return Frame(
        of,
        number,
        position,
        _unit_axes(orientation),
        (pixel[1], pixel[0]) if pixel and min(pixel) > 0 else None,
        step or None,
        abs(thickness) or None,
        ((slope[0] if slope and slope[0] else 1.0) * of.factor, (shift[0] if shift else 0.0) * of.factor),
        tuple(times),
    )


def _read_time(groups: _Groups, tag: str | int, sequence: str) -> float:
    """A tag as a number that orders images, NaN without one. A time of day HHMMSS.F is ordered as a number, too."""
    try:
        value = groups.get(tag, sequence)
        return float(value.decode() if isinstance(value, bytes) else str(value))
    except (NotImplementedError, ValueError):
        # of pydicom, too: an unknown type, or a value that is not of its tag's type
        return math.nan


def _multiframe(tags: Any, first: Frame) -> list[Frame]:
    """The frames of a multi-frame file without functional groups: along the normal, by offsets or the step.

    Frames of nuclear medicine state their slice, and their number among several images of it.
    """
    count = first.header.frames
    stated = tags.get("GridFrameOffsetVector")
    offsets = finite_numbers(stated, count)
    if stated is None and first.step:
        slices = finite_numbers(tags.get("SliceVector"), count) or tuple(range(1, count + 1))
        offsets = tuple(first.step * (number - 1) for number in slices)
    vectors = [finite_numbers(tags.get(tag), count) if str(tag).endswith("Vector") else None for tag, _, _ in TIMES]
    times = [
        tuple(vector[n] if vector else time for vector, time in zip(vectors, first.times, strict=True))
        for n in range(count)
    ]
    if first.position is None or first.orientation is None or offsets is None:
        return [replace(first, number=number, position=None, times=times[number]) for number in range(count)]
    normal, start = slice_normal(first.orientation), np.array(first.position)
    if stated is not None and offsets[0] and abs(offsets[0] - start[2]) < 1e-3:
        # a dose's offsets that begin with the position's z are coordinates along z (PS3.3 C.8.8.3.2)
        normal = np.array([0.0, 0.0, 1.0])
    places = [start + (offset - (offsets[0] if stated is not None else 0.0)) * normal for offset in offsets]
    return [replace(first, number=n, position=tuple(place.tolist()), times=times[n]) for n, place in enumerate(places)]


def _split_mosaic(first: Frame) -> list[Frame]:
    """The slices of a mosaic."""
    places = first.header.mosaic.places(first.position, first.orientation, first.spacing, first.step)
    return [replace(first, number=number, position=place) for number, place in enumerate(places)]


def slice_normal(orientation: Numbers) -> np.ndarray:
    """The unit normal [3] of an image: rows' direction × columns' direction."""
    normal = np.cross(orientation[:3], orientation[3:])
    return np.asarray(normal / np.linalg.norm(normal))


def _unit_axes(orientation: Numbers | None) -> Numbers | None:
    """Both directions with length 1; None for invalid directions."""
    if orientation is None:
        return None
    axes = np.array(orientation).reshape(2, 3)
    lengths = np.linalg.norm(axes, axis=1, keepdims=True)
    if not (np.abs(lengths - 1) < 0.1).all() or abs(float((axes[0] * axes[1]).sum())) > 0.1:
        return None
    return tuple((axes / lengths).ravel().tolist())
