"""Frames of DICOM: their positions, and their pixels."""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from typing import Any

import numpy as np

from splatgl.data.color import LUMA
from splatgl.errors import expected, missing_extra
from splatgl.readers.common import DEFLATE_RATIO, MAX_BYTES, require_bytes
from splatgl.readers.dicom_headers import (
    PARAMETRIC_MAP,
    SIEMENS_B,
    DicomHeader,
    LimitedFile,
    Numbers,
    dicom_errors,
    finite_numbers,
    plain_text,
    read_dataset,
)
from splatgl.readers.dicom_vendors import clock_seconds

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
    ("FrameReferenceDateTime", "FrameContentSequence", "acquisition times"),
    ("FrameAcquisitionDateTime", "FrameContentSequence", "acquisition times"),
    ("InstanceNumber", "", "images"),
)


@dataclass(frozen=True, eq=False)
class DicomFrame:
    """An image: its header, its number in the file; position [3] and orientation [6] in LPS mm, as in DICOM.

    spacing: (x, y) of its pixels or None. step: from slice to slice by the header, or None; negative if frames of
    nuclear medicine are stacked against the normal. thickness: of the slice, or None. scale: (slope, intercept).
    times: values of TIMES, NaN for missing ones. stack: what tells it from other stacks of its series, "" without one.
    slice: number of its slice, for one of several images of a slice that has no position; else None. aspect: height of
    a pixel in widths, where its size is unknown. segment: number of the one that it is a mask of, or None.
    """

    header: DicomHeader
    number: int
    position: Numbers | None
    orientation: Numbers | None
    spacing: tuple[float, float] | None
    step: float | None
    thickness: float | None
    scale: tuple[float, float]
    times: Numbers
    stack: str = ""
    slice: int | None = None
    aspect: float = 1.0
    segment: int | None = None

    @property
    def order(self) -> Numbers:
        """Key that sorts images at one position: `times`, where NaN comes first."""
        return tuple(-math.inf if math.isnan(time) else time for time in self.times)


# classes of nuclear medicine images, where SpacingBetweenSlices has a sign (PS3.3 C.8.4.15)
NUCLEAR = ("1.2.840.10008.5.1.4.1.1.20", "1.2.840.10008.5.1.4.1.1.5")
# classes whose frames are moments: ultrasound, angiography, fluoroscopy, endoscopy, microscopy, photography
_CLASSES = "1.2.840.10008.5.1.4.1.1."
FILMS = tuple(
    _CLASSES + number for number in ("3", "3.1", "12.1", "12.1.1", "12.2", "12.2.1", "77.1.1.1", "77.1.2.1", "77.1.4.1")
)
SLIDE, ULTRASOUND_VOLUME = _CLASSES + "77.1.6", _CLASSES + "6.2"
# tags that FrameIncrementPointer names where frames are moments, and milliseconds from one to the next (PS3.3 C.7.6.5)
_MOMENT_TAGS = (0x00181063, 0x00181065)
# kinds of nuclear images whose frames are views of one slice (PS3.3 C.8.4.9)
# unit of a region of an ultrasound image (PS3.3 C.8.5.5)
_CENTIMETRES = 3
_PLANAR = ("STATIC", "DYNAMIC", "GATED", "WHOLE BODY")


def list_frames(of: DicomHeader, tags: Any) -> list[DicomFrame]:
    """All frames of a file. Raises InputError for a damaged header, and for more frames than it has bytes."""
    if of.frames > min(of.room, MOST_FRAMES):
        this = f"at most {min(of.room, MOST_FRAMES)} frames, in {of.room} bytes"
        raise expected("pixels", this, of.frames, "the header is damaged")
    with dicom_errors():
        shared = next(iter(tags.get("SharedFunctionalGroupsSequence") or ()), None)
        per_frame = tags.get("PerFrameFunctionalGroupsSequence")
        if per_frame is not None and len(per_frame) != of.frames:
            raise expected("frames", f"{of.frames}, as the header says", len(per_frame), "the file is damaged")
        if of.sop == SLIDE:
            fix = "it is one plane; save a stack as OME-TIFF with Bio-Formats"
            raise expected("DICOM", "slices", "tiles of a slide", fix)
        if per_frame is None:
            first = _read_frame(of, 0, _Groups(tags, ()))
            if of.frames > 1:
                return _separate_moments(tags, _multiframe(tags, first))
            if of.mosaic.tiles == 1:
                return [first]
            places = of.mosaic.places(first.position, first.orientation, first.spacing, first.step)
            return [replace(first, number=number, position=place) for number, place in enumerate(places)]
        parts = (tuple(item for item in (group, shared) if item is not None) for group in per_frame)
        frames = [_read_frame(of, number, _Groups(tags, groups)) for number, groups in enumerate(parts)]
        # a stack is more than a slice
        is_split = 1 < len({frame.stack for frame in frames}) <= len(frames) / 2
        return _separate_moments(tags, frames if is_split else [replace(frame, stack="") for frame in frames])


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


def _read_frame(of: DicomHeader, number: int, groups: _Groups) -> DicomFrame:
    """Reads the header of a frame."""
    position = finite_numbers(groups.get("ImagePositionPatient", "PlanePositionSequence"), 3)
    orientation = finite_numbers(groups.get("ImageOrientationPatient", "PlaneOrientationSequence"), 6)
    if of.sop == ULTRASOUND_VOLUME:
        position = finite_numbers(groups.get("ImagePositionVolume", "PlanePositionVolumeSequence"), 3)
        orientation = finite_numbers(groups.get("ImageOrientationVolume", "PlaneOrientationVolumeSequence"), 6)
    detector = next(iter(groups.tags.get("DetectorInformationSequence") or ()), None)
    if detector is not None and position is None:
        position = finite_numbers(detector.get("ImagePositionPatient"), 3)
        orientation = orientation or finite_numbers(detector.get("ImageOrientationPatient"), 6)
    (thickness,) = finite_numbers([groups.get("SliceThickness", "PixelMeasuresSequence")], 1) or (0.0,)
    (gap,) = finite_numbers([groups.get("SpacingBetweenSlices", "PixelMeasuresSequence")], 1) or (0.0,)
    step = (gap if of.sop in NUCLEAR or of.modality == "NM" else abs(gap)) or abs(thickness)
    stack = groups.get("StackID", "FrameContentSequence")
    dose = finite_numbers([groups.tags.get("DoseGridScaling")], 1)
    way, scale = ("PixelValueTransformationSequence", "Rescale")
    if of.sop == PARAMETRIC_MAP:
        way, scale = ("RealWorldValueMappingSequence", "RealWorldValue")
    slope = dose or finite_numbers([groups.get(f"{scale}Slope", way)], 1)
    shift = finite_numbers([groups.get(f"{scale}Intercept", way)], 1)
    times = [_read_time(groups, tag, sequence) for tag, sequence, _ in TIMES]
    ratio = finite_numbers(groups.get("PixelAspectRatio"), 2)
    segment = groups.get("ReferencedSegmentNumber", "SegmentIdentificationSequence")
    return DicomFrame(
        of,
        number,
        position,
        _unit_axes(orientation),
        _pixel_size(groups),
        step or None,
        abs(thickness) or None,
        ((slope[0] if slope and slope[0] else 1.0) * of.factor, (shift[0] if shift else 0.0) * of.factor),
        tuple(times),
        f"stack {plain_text(stack)}" if stack else "",
        aspect=ratio[0] / ratio[1] if ratio is not None and min(ratio) > 0 else 1.0,
        segment=None if segment is None else int(segment),
    )


def _pixel_size(groups: _Groups) -> tuple[float, float] | None:
    """Millimetres (x, y) of a pixel, in ultrasound by the first region in centimetres; None if unknown."""
    names = ("PixelSpacing", "ImagerPixelSpacing", "NominalScannedPixelSpacing")
    sizes = next((size for name in names if (size := groups.get(name, "PixelMeasuresSequence"))), None)
    pixel = finite_numbers(sizes, 2)
    if pixel is not None:
        return (pixel[1], pixel[0]) if min(pixel) > 0 else None
    for region in groups.tags.get("SequenceOfUltrasoundRegions") or ():
        units = [region.get(f"PhysicalUnits{axis}Direction") for axis in "XY"]
        steps = finite_numbers([region.get(f"PhysicalDelta{axis}") for axis in "XY"], 2)
        if units == [_CENTIMETRES] * 2 and steps is not None and all(steps):
            return abs(steps[0]) * 10, abs(steps[1]) * 10
    return None


def _read_time(groups: _Groups, tag: str | int, sequence: str) -> float:
    """A tag as a number that orders images, NaN without one; of an acquisition's time and date their seconds."""
    try:
        value = groups.get(tag, sequence)
        text = value.decode() if isinstance(value, bytes) else str(value)
        if tag == "AcquisitionTime":
            return clock_seconds(groups.get("AcquisitionDate"), text)
        # YYYYMMDDHHMMSS.F&ZZXX
        return clock_seconds(text[:8], text[8:]) if "DateTime" in str(tag) else float(text)
    except (NotImplementedError, ValueError):
        # of pydicom, too: an unknown type, or a value that is not of its tag's type
        return math.nan


def _multiframe(tags: Any, first: DicomFrame) -> list[DicomFrame]:
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


def _separate_moments(tags: Any, frames: list[DicomFrame]) -> list[DicomFrame]:
    """The frames; those of a film, and of nuclear medicine without positions, as images of one slice."""
    if any(frame.position for frame in frames):
        return frames
    head, kind = frames[0].header, [str(word) for word in tags.get("ImageType") or ()][2:3]
    pointers = tags.get("FrameIncrementPointer")
    named = {int(tag) for tag in (pointers if isinstance(pointers, Sequence) else [pointers]) if tag}
    is_film = head.sop in FILMS or not named.isdisjoint(_MOMENT_TAGS)
    slices = finite_numbers(tags.get("SliceVector"), len(frames))
    if slices is not None:
        return [replace(frame, slice=int(number)) for frame, number in zip(frames, slices, strict=True)]
    if not is_film and not (head.sop in NUCLEAR and not set(kind).isdisjoint(_PLANAR)):
        return frames
    if is_film or "DYNAMIC" in kind:
        frames = _with_times(tags, frames)
    return [replace(frame, slice=0, stack=head.source.name) for frame in frames]


def _with_times(tags: Any, frames: list[DicomFrame]) -> list[DicomFrame]:
    """The frames with their numbers as time points, and their times in milliseconds where the file has them."""
    count = len(frames)
    steps = finite_numbers(tags.get("FrameTimeVector"), count)
    phases = tags.get("PhaseInformationSequence") or ()
    durations = [tags.get("FrameTime"), *[phase.get("ActualFrameDuration") for phase in phases if len(phases) == 1]]
    rates = [finite_numbers([tags.get(name)], 1) for name in ("CineRate", "RecommendedDisplayFrameRate")]
    known = [number[0] for value in durations if (number := finite_numbers([value], 1)) and number[0] > 0]
    known += [1000 / rate[0] for rate in rates if rate and rate[0] > 0]
    times = np.cumsum((0.0, *steps[1:])) if steps else np.arange(count) * next(iter(known), math.nan)
    timed = []
    for n, (frame, time) in enumerate(zip(frames, times.tolist(), strict=True)):
        stated = {"TemporalPositionIdentifier": float(n), "FrameReferenceTime": time}
        values = zip(TIMES, frame.times, strict=True)
        timed.append(replace(frame, times=tuple(stated.get(str(tag), value) for (tag, _, _), value in values)))
    return timed


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


# most tiles of a JPEG 2000 picture: its decoder allocates all at once
MOST_TILES = 4096
# start of a JPEG 2000 picture in boxes; others start with their codestream
JP2 = b"\0\0\0\x0cjP  "


def picture_size(data: bytes) -> tuple[tuple[int, ...], int]:
    """((rows, columns), tiles) of a JPEG, JPEG-LS or JPEG 2000 picture; ((), 0) without a header."""
    at = data.find(b"\xff\x4f\xff\x51") if data.startswith(JP2) else 0
    if data[at : at + 4] == b"\xff\x4f\xff\x51" and len(data) >= at + 42:
        x, y, x0, y0, w, h, left, top = struct.unpack_from(">8I", data, at + 8)
        tiles = -(-(x - left) // w) * -(-(y - top) // h) if w and h else 0
        return (y - y0, x - x0), tiles
    at = 2 if data.startswith(b"\xff\xd8") else len(data)
    while at + 9 <= len(data):
        marker, length = data[at + 1], int.from_bytes(data[at + 2 : at + 4], "big")
        if data[at] != 0xFF:
            break
        if marker == 0xFF:
            at += 1
            continue
        # frame headers: all of C0 to CF but Huffman tables, reserved and arithmetic conditioning; F7 of JPEG-LS
        if (0xC0 <= marker <= 0xCF and marker not in (0xC4, 0xC8, 0xCC)) or marker == 0xF7:
            return struct.unpack_from(">HH", data, at + 5), 1
        at += 2 + max(length, 2)
    return (), 0


# most bytes of a frame, 64 MiB, whatever its compressed size: decoders hold several times as many
FREE_FRAME = MAX_BYTES // 8
COLORS = ("RGB", "YBR_FULL", "YBR_FULL_422", "YBR_ICT", "YBR_RCT", "YBR_PARTIAL_422", "YBR_PARTIAL_420")
PALETTE = "PALETTE COLOR"
GREYS = ("MONOCHROME1", "MONOCHROME2")

RLE = "1.2.840.10008.1.2.5"


def is_color(header: DicomHeader) -> bool:
    """Whether the frames are in colour."""
    return header.photometric in (*COLORS, PALETTE)


def check_header(header: DicomHeader) -> None:
    """Raises InputError for unsupported pixels, and for sizes that the file cannot contain."""
    uid = find_decoder(header.syntax)
    rows, columns = header.size
    kinds = {1: (*GREYS, PALETTE), 3: (*COLORS, PALETTE)}
    if header.photometric not in kinds.get(header.samples, ()):
        # a damaged file may hold any text
        known = header.photometric in (*COLORS, *GREYS, PALETTE, "ARGB", "CMYK", "HSV")
        got = f"{header.samples} × {header.photometric if known else 'unknown'}"
        raise expected("pixels", "grey, RGB, YBR or palette pixels", got, "convert the file")
    if header.allocated not in ((8, 16) if is_color(header) else (1, 8, 16, 32, 64)):
        this = "1 or 8 to 64 bits each, colours 8 or 16"
        raise expected("pixels", this, f"{header.allocated} bits", "convert the file")
    if not 0 <= header.stored[0] <= header.allocated:
        raise expected("bits stored", f"at most {header.allocated}", header.stored[0], "the header is damaged")
    there, bits = header.room, frame_bits(header)
    if not uid.is_encapsulated:
        require_bytes(-(-bits * header.frames // 8), there, "pixels")
        return
    needed = bits // 8
    # a fragment takes 8 bytes at least
    if header.frames > there // 8 or needed > max(there * DEFLATE_RATIO, FREE_FRAME):
        got = f"{there} compressed bytes for {header.frames} × {columns} × {rows}"
        raise expected("pixels", "sizes that they can hold", got, "the file is cut short or its header is damaged")


def frame_bits(header: DicomHeader) -> int:
    """Bits of an uncompressed frame."""
    bits = math.prod(header.size) * header.samples * header.allocated
    return bits * 2 // 3 if header.photometric == "YBR_FULL_422" and find_decoder(header.syntax).is_native else bits


def find_decoder(syntax: str) -> Any:
    """pydicom's decoder. Raises InputError if there is none, or if its library is not installed."""
    from pydicom.pixels import get_decoder

    with dicom_errors():
        try:
            decoder = get_decoder(syntax)
        except NotImplementedError:
            from pydicom.uid import UID

            name = UID(syntax).name if UID(syntax).is_transfer_syntax else "an unknown one"
            fix = "save the file uncompressed, for example with dcmdjpeg or gdcmconv --raw"
            raise expected("transfer syntax", "uncompressed, RLE, JPEG, JPEG-LS or JPEG 2000", name, fix) from None
        if not decoder.is_available:
            wavelets = "2000" in decoder.UID.name
            library, extra = ("pylibjpeg-openjpeg", "dicom") if wavelets else ("pylibjpeg-libjpeg", "dicom-jpeg")
            raise missing_extra(f"DICOM files in {UID_NAMES.get(syntax, decoder.UID.name)}", library, extra)
        return decoder


# short names of transfer syntaxes with long names
UID_NAMES = {"1.2.840.10008.1.2.4.50": "JPEG Baseline", "1.2.840.10008.1.2.4.70": "JPEG Lossless"}


def decode_frames(
    header: DicomHeader, frames: Sequence[DicomFrame], tags: Any = None
) -> Iterator[tuple[DicomFrame, np.ndarray, np.ndarray | None]]:
    """(frame, stored values [H, W], colours uint8 [H, W, 3] or None) of frames of one file, by their numbers. tags: the
    file's data set, read if it is not given.
    """
    wanted = {frame.number: frame for frame in frames}
    is_mosaic = header.mosaic.tiles > 1
    numbers = [0] if is_mosaic else sorted(wanted)
    with header.source.open() as file:
        tags = read_dataset(file) if tags is None else tags
        arrays = _decode(file, header, numbers, tags)
        for number in numbers:
            with dicom_errors():
                array = next(arrays)
                color = to_rgb(array, header, tags) if is_color(header) else None
            if array.shape[:2] != header.size:
                raise expected("pixels", f"{header.size}", array.shape[:2], "the file is damaged")
            if color is not None:
                array = np.rint(color @ LUMA).astype(np.uint8)
            for place in sorted(wanted) if is_mosaic else [number]:
                part = header.mosaic.tile(place) if is_mosaic else ()
                yield wanted[place], array[part], None if color is None else color[part]


def _decode(file: LimitedFile, header: DicomHeader, numbers: Sequence[int], tags: Any) -> Iterator[np.ndarray]:
    """Values of frames, whose numbers ascend; the sizes that a compressed frame's header states are checked first."""
    from pydicom.encaps import encapsulate, generate_frames, parse_basic_offsets, parse_fragments
    from pydicom.pixels import as_pixel_options

    decoder = find_decoder(header.syntax)
    shift = header.shift if decoder.is_native and header.stored[0] + header.shift <= header.allocated else 0
    plain = {"bits_stored": header.stored[0] + shift} if header.stored[0] else {}
    plain |= {"number_of_frames": header.frames if decoder.is_native else 1}
    wide = "OB" if header.allocated <= 8 and not header.swapped else "OW"
    options: Any = as_pixel_options(tags, pixel_keyword=header.pixels, pixel_vr=wide, **plain)
    options.pop("extended_offsets", None)
    file.seek(header.offset)
    if decoder.is_native and header.allocated == 1:
        count = math.prod(header.size)
        for number in numbers:
            # pydicom's decoder loses the last byte of frames that begin late in their first
            place, bit = divmod(number * count, 8)
            file.seek(header.offset + place)
            packed = np.frombuffer(file.read(-(-(bit + count) // 8)), np.uint8)
            yield np.unpackbits(packed, bitorder="little")[bit : bit + count].reshape(header.size)
        return
    if decoder.is_native:
        # one by one: `iter_array` takes the frames behind the first of YBR_FULL_422 for those of YBR_FULL
        for number in numbers:
            array = decoder.as_array(file, index=number, **options)[0]
            yield array >> shift if shift else array
        return
    # what decoders make of the part of a picture is no error
    parse_basic_offsets(file)
    for place in parse_fragments(file)[1][-1:]:
        file.seek(place + 4)
        require_bytes(place + 8 + int.from_bytes(file.read(4), "little"), file.size, "pixels")
    file.seek(header.offset)
    stored = generate_frames(file, number_of_frames=header.frames)
    for number, before in zip(numbers, (-1, *numbers), strict=False):
        data = next(islice(stored, number - before - 1, None), b"")
        if not data:
            raise expected("pixels", f"{header.frames} frames", number, "the file is cut short")
        if header.syntax != RLE:
            check_picture(picture_size(data), *header.size, exact=True)
        yield decoder.as_array(encapsulate([data], has_bot=False), index=0, **options)[0]


def check_picture(stated: tuple[tuple[int, ...], int], rows: int, columns: int, exact: bool = False) -> None:
    """Raises InputError for a picture that is larger (or not `exact`ly as large) or of many tiles, as `picture_size`
    states.
    """
    size, tiles = stated
    fits = bool(size) and (size == (rows, columns) if exact else size[0] <= rows and size[1] <= columns)
    if not fits or not 1 <= tiles <= MOST_TILES:
        this = f"{columns} × {rows} pixels" + ("" if exact else " at most")
        got = f"{size[1]} × {size[0]} in {tiles} tiles" if size else "none"
        raise expected("compressed picture", this, got, "the file is damaged")


def to_rgb(array: np.ndarray, header: DicomHeader, tags: Any) -> np.ndarray:
    """RGB, uint8 [H, W, 3]."""
    if header.photometric == PALETTE:
        from pydicom.pixels import apply_color_lut

        for name in ("Red", "Green", "Blue"):
            table, (count, *_) = f"{name}PaletteColorLookupTableData", tags[f"{name}PaletteColorLookupTableDescriptor"]
            if table in tags and len(tags[table].value) == count + 1:
                # a byte that makes the length even counts for pydicom
                tags[table].value = tags[table].value[:count]
        array = apply_color_lut(array, tags)[..., :3]
    if array.dtype.itemsize > 1:
        bits = array.dtype.itemsize * 8 if header.photometric == PALETTE else header.stored[0] or header.allocated
        array = array >> max(bits - 8, 0)
    return np.clip(array, 0, 255).astype(np.uint8)
