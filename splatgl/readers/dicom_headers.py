"""Finds DICOM files in folders and archives, and reads their headers."""

from __future__ import annotations

import math
import os
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import IO, Any

import numpy as np

from splatgl.data.affine import value_unit_name
from splatgl.errors import InputError, expected, import_extra
from splatgl.readers.common import require_plausible
from splatgl.readers.dicom_vendors import SUV, Mosaic, find_mosaic, is_angiogram, suv_factor

SUFFIXES = (".dcm", ".dicom", ".ima")
MAGIC, MAGIC_AT = b"DICM", 128
# a file without preamble begins with group 2 or 8, in either byte order
BARE = (b"\x02\x00", b"\x08\x00", b"\x00\x08")
# what follows the group there: the group's length, the character set or the kind of image, with a VR or a short length
FIRST_ELEMENTS = (
    *(b"\0\0UL\4\0", b"\0\0\4\0\0\0", b"\0\1OB\0\0", b"\0\1\2\0\0\0"),
    *(b"\5\0" + end for end in (b"CS\x0a\0", b"\x0a\0\0\0", b"CS\x0e\0", b"\x0e\0\0\0")),
    *(b"\x08\0CS" + bytes([size, 0]) for size in range(8, 64, 2)),
    *(b"\x08\0" + bytes([size, 0, 0, 0]) for size in range(8, 64, 2)),
)
# depth of searched folders: those of a CD (patient, study, series) and one more
DEPTH = 5
# most files of a source, and most that are examined to see whether a folder holds DICOM
MOST_FILES, MOST_TRIED = 100_000, 2_000


@dataclass(frozen=True)
class DicomSource:
    """A file, or a member of a zip. name: for messages, relative to the given path."""

    path: Path
    name: str
    member: str | None = None

    @contextmanager
    def open(self) -> Iterator[LimitedFile]:
        """Opens the file. Raises InputError if a zip's member cannot be read."""
        if self.member is None:
            with self.path.open("rb") as file:
                yield LimitedFile(file, self.path.stat().st_size)
            return
        with open_zip(self.path) as archive, archive.open(self.member) as packed:
            yield LimitedFile(packed, archive.getinfo(self.member).file_size)


class LimitedFile:
    """A file that limits reads to its end: libraries allocate buffers of any length that a damaged header states."""

    def __init__(self, file: IO[bytes], size: int) -> None:
        self.file, self.size = file, size

    def read(self, count: int | None = -1) -> bytes:
        """At most `count` bytes. The whole rest is never read: pydicom would inflate it."""
        if count is None or count < 0:
            raise expected("transfer syntax", "one that isn't deflated", "deflated", "save it uncompressed")
        return self.file.read(min(count, max(self.size - self.file.tell(), 0)))

    def seek(self, offset: int, whence: int = 0) -> int:
        """Moves to an offset, and returns the position."""
        return self.file.seek(offset, whence)

    def tell(self) -> int:
        """The position."""
        return self.file.tell()


@contextmanager
def open_zip(path: Path) -> Iterator[zipfile.ZipFile]:
    """Opens a zip; its failures, also of members that are read meanwhile, become InputError."""
    try:
        with zipfile.ZipFile(path) as archive:
            yield archive
    except (InputError, OSError, MemoryError):
        raise
    except (NotImplementedError, RuntimeError) as error:
        raise expected("zip", "deflated members without a password", "other members", "unpack it") from error
    except Exception as error:
        # zipfile raises many types, IndexError for a member without a name among them
        raise InputError("cannot be read as zip: the file is cut short or damaged") from error


def is_dicom_start(head: bytes, name: str) -> bool:
    """Whether a file is DICOM: it has the magic after the preamble, or begins with a first group and has a DICOM name,
    or with an element that only a first group has.
    """
    bare = head.startswith(BARE) and (name.lower().endswith(SUFFIXES) or head[2:8] in FIRST_ELEMENTS)
    return head[MAGIC_AT:] == MAGIC or bare


def is_dicom(path: Path) -> bool:
    """Whether a file is DICOM, or one of a folder's first files is."""
    files = islice(_files(path), MOST_TRIED) if path.is_dir() else iter([path])
    return any(is_dicom_start(_first_bytes(file), file.name) for file in files)


def find_sources(path: Path) -> list[DicomSource]:
    """All DICOM files of a path, sorted by name. Raises InputError for too many files, and for a bad zip."""
    if path.is_dir():
        paths = list(islice(_files(path), MOST_FILES + 1))
        files = [DicomSource(file, file.relative_to(path).as_posix()) for file in paths]
        files = [source for source in _limit_files(files) if is_dicom_start(_first_bytes(source.path), source.name)]
        return sorted(files, key=lambda source: source.name)
    if is_dicom(path):
        listed = _list_directory(path) if path.name.upper().startswith("DICOMDIR") else set()
        beside = find_sources(path.parent) if listed else []
        return [source for source in beside if source.name.lower() in listed] or [DicomSource(path, path.name)]
    return _zip_members(path) if zipfile.is_zipfile(path) else []


def _list_directory(path: Path) -> set[str]:
    """Lower-case names, relative to its folder, of the files in a table of contents; empty for another file."""
    pydicom = import_extra("pydicom", "DICOM files", "pydicom", "dicom")
    with dicom_errors(), path.open("rb") as file:
        bounded: Any = LimitedFile(file, path.stat().st_size)
        tags = pydicom.dcmread(bounded, force=True, specific_tags=["DirectoryRecordSequence"])
        found = (item.get("ReferencedFileID") for item in tags.get("DirectoryRecordSequence") or ())
        return {"/".join([name] if isinstance(name, str) else map(str, name)).lower() for name in found if name}


def _limit_files(sources: list[DicomSource]) -> list[DicomSource]:
    if len(sources) > MOST_FILES:
        raise expected("folder", f"at most {MOST_FILES} files", "more", "name the folder of one study")
    return sources


def _files(folder: Path, depth: int = DEPTH) -> Iterator[Path]:
    """Files of a folder, then of its subfolders, without hidden and unreadable ones."""
    try:
        entries = sorted(os.scandir(folder), key=lambda entry: entry.name)
    except OSError:
        return
    entries = [entry for entry in entries if not entry.name.startswith(".")]
    yield from (Path(entry.path) for entry in entries if entry.is_file())
    for entry in entries if depth else ():
        if entry.is_dir(follow_symlinks=False):
            yield from _files(Path(entry.path), depth - 1)


def _first_bytes(path: Path) -> bytes:
    try:
        with path.open("rb") as file:
            return file.read(MAGIC_AT + len(MAGIC))
    except OSError:
        return b""


def _zip_members(path: Path) -> list[DicomSource]:
    """The DICOM members of a zip."""
    with open_zip(path) as archive:
        infos = [info for info in archive.infolist() if not info.is_dir()]
        if sum(info.compress_size for info in infos) > path.stat().st_size:
            raise expected("zip", "separate members", "members that overlap", "the file is damaged")
        for info in infos:
            require_plausible(info.file_size, info.compress_size)
        members = []
        for source in _limit_files([DicomSource(path, info.filename, info.filename) for info in infos]):
            with archive.open(source.name) as file:
                if is_dicom_start(file.read(MAGIC_AT + len(MAGIC)), source.name):
                    members.append(source)
    return sorted(members, key=lambda source: source.name)


Numbers = tuple[float, ...]

# bits of a byte
_BYTE = 8
# tag of the rows of the first overlay
OVERLAY = 0x60000010

LONG_VRS = (b"OB", b"OW", b"OF", b"OD", b"UN")

# elements of pixels, as little-endian files begin them
PIXELS = {
    b"\xe0\x7f\x10\x00": "PixelData",
    b"\xe0\x7f\x08\x00": "FloatPixelData",
    b"\xe0\x7f\x09\x00": "DoubleFloatPixelData",
}

# Siemens' b-value, in files before the standard had one
SIEMENS_B = 0x0019100C

# class of parametric maps, whose values are those of their real-world mapping
PARAMETRIC_MAP = "1.2.840.10008.5.1.4.1.1.30"
# names of units of values
UNITS = {
    "HU": "HU",
    "BQML": "Bq/ml",
    "CNTS": "counts",
    "PROPCNTS": "counts",
    "GML": "g/ml",
    "CM2ML": "cm²/ml",
    "GY": "Gy",
}


@dataclass(frozen=True, eq=False)
class DicomHeader:
    """Header that the frames of a file share. size: (rows, columns) of its images, each a mosaic of slices. stored:
    (bits stored, whether signed); 0 bits for floating point. shift: bits below those stored. swapped: whether bytes
    are in big-endian words of two.

    padding: least and largest stored value that stands for no value. lut: first stored value and the values of a
    modality LUT. sop: class of the file. pixels, offset: name of the pixels' element, "" without pixels; the byte
    of their values; room: bytes from there on. notes: on header entries that are not drawn, and on SUV. factor: of
    rescaled values to SUV. angiogram: whether vessels are brightest.
    """

    source: DicomSource
    series: str
    number: int
    modality: str
    description: str
    size: tuple[int, int]
    mosaic: Mosaic
    frames: int
    photometric: str
    samples: int
    allocated: int
    stored: tuple[int, bool]
    padding: tuple[float, float] | None
    lut: tuple[int, np.ndarray] | None
    syntax: str
    sop: str
    pixels: str
    offset: int
    room: int
    value_unit: str = ""
    notes: tuple[str, ...] = ()
    factor: float = 1.0
    angiogram: bool = False
    shift: int = 0
    swapped: bool = False


@contextmanager
def dicom_errors() -> Iterator[None]:
    """Turns any failure of pydicom into an InputError that does not quote it: it may quote names from the file."""
    try:
        yield
    except (InputError, OSError, MemoryError):
        raise
    except Exception as error:
        raise InputError(f"cannot be read as DICOM ({type(error).__name__}); the file is damaged") from error


def read_dataset(file: LimitedFile) -> Any:
    """Reads the header; the file is at the pixels' element afterwards, or at its end."""
    pydicom = import_extra("pydicom", "DICOM files", "pydicom", "dicom")
    with dicom_errors():
        tags: Any = pydicom.dcmread(file, stop_before_pixels=True, force=True)
        if "TransferSyntaxUID" not in tags.file_meta:
            implicit, little = tags.original_encoding
            uid = pydicom.uid
            plain = uid.ExplicitVRLittleEndian if little else uid.ExplicitVRBigEndian
            tags.file_meta.TransferSyntaxUID = uid.ImplicitVRLittleEndian if implicit else plain
        return tags


def read_header(source: DicomSource) -> tuple[DicomHeader, Any]:
    """The header of a file, and its data set. Raises InputError for a damaged file."""
    with source.open() as file:
        tags = read_dataset(file)
        at = file.tell()
        pixels = file.read(6)
    # an element in explicit VR, whatever the syntax says, has 12 bytes before its value, in implicit VR 8
    at += 12 if pixels[4:] in LONG_VRS else 8
    with dicom_errors():
        palette = str(tags.get("PhotometricInterpretation") or "MONOCHROME2")
        rows, columns, count = (whole_number(tags.get(name), 0) for name in ("Rows", "Columns", "NumberOfFrames"))
        allocated, stored = whole_number(tags.get("BitsAllocated"), 0), whole_number(tags.get("BitsStored"), 0)
        factor, suv_note = suv_factor(tags) if tags.get("Modality") == "PT" else (1.0, "")
        mosaic, split = find_mosaic(tags, rows, columns)
        keyword = PIXELS.get(pixels[:4]) or PIXELS.get(pixels[1::-1] + pixels[3:1:-1], "")
        return DicomHeader(
            source,
            series=str(tags.get("SeriesInstanceUID") or ""),
            number=whole_number(_optional(tags, "SeriesNumber"), -(2**31)),
            modality=plain_text(tags.get("Modality")) or "?",
            description=plain_text(_optional(tags, "SeriesDescription")),
            size=(rows, columns),
            mosaic=mosaic,
            frames=max(count, 1),
            photometric=palette,
            samples=max(whole_number(tags.get("SamplesPerPixel"), 0), 1),
            allocated=allocated,
            stored=(0 if "Float" in keyword else stored or allocated, tags.get("PixelRepresentation") == 1),
            padding=_read_padding(tags, "" if keyword == "PixelData" else keyword.removesuffix("PixelData")),
            lut=_read_lut(tags),
            syntax=str(tags.file_meta.TransferSyntaxUID),
            sop=str(tags.get("SOPClassUID") or tags.file_meta.get("MediaStorageSOPClassUID") or ""),
            pixels=keyword,
            offset=at,
            room=max(file.size - at, 0),
            value_unit="SUV" if suv_note.startswith(SUV) else _value_unit(tags),
            notes=(*[suv_note] * bool(suv_note), *split, *_ignored_notes(tags, max(count, 1))),
            factor=factor,
            angiogram=is_angiogram(tags),
            shift=max(whole_number(tags.get("HighBit"), 0) + 1 - (stored or allocated), 0),
            swapped=allocated == 8 and pixels == b"\x7f\xe0\x00\x10OW",
        ), tags


def _ignored_notes(tags: Any, count: int) -> tuple[str, ...]:
    """Notes on header entries of a file of `count` frames that do not affect its volume."""
    views = [str(kind) for kind in tags.get("ImageType") or ()][2:3]
    notes = {
        "overlays in the file are not rendered": OVERLAY in tags,
        "values are not mapped to real-world units, for which the file has a table": _real_world(tags) is not None
        and tags.get("SOPClassUID") != PARAMETRIC_MAP,
        "the frames are views from around the patient, not slices: stacked as they come": tags.get("Modality") == "NM"
        and count > 1
        and views in (["TOMO"], ["GATED TOMO"]),
        "a negative SpacingBetweenSlices has no meaning but in nuclear medicine: taken as positive": count > 1
        and tags.get("Modality") != "NM"
        and (finite_numbers([tags.get("SpacingBetweenSlices")], 1) or (0.0,))[0] < 0
        and "PerFrameFunctionalGroupsSequence" not in tags,
    }
    return tuple(note for note, is_there in notes.items() if is_there)


def _real_world(tags: Any) -> Any:
    """The first mapping of stored to real-world values, of the file, all frames or the first; None without one."""
    groups = (tags.get(f"{name}FunctionalGroupsSequence") or () for name in ("Shared", "PerFrame"))
    places = (tags, *(next(iter(items), None) for items in groups))
    found = (place.get("RealWorldValueMappingSequence") for place in places if place is not None)
    return next((items[0] for items in found if items), None)


def _value_unit(tags: Any) -> str:
    """The unit of rescaled values: RescaleType, Units of a PET, or DoseUnits, else HU for a CT; of parametric maps that
    of their mapping.
    """
    if tags.get("SOPClassUID") == PARAMETRIC_MAP:
        units = next(iter(getattr(_real_world(tags), "MeasurementUnitsCodeSequence", None) or ()), None)
        return value_unit_name(plain_text(getattr(units, "CodeValue", "")))
    names = ("RescaleType", "Units", "DoseUnits")
    kind = next((text for name in names if (text := plain_text(_optional(tags, name)))), "")
    if not kind and plain_text(tags.get("Modality")) == "CT":
        return "HU"
    return UNITS.get(kind, "")


def _optional(tags: Any, tag: str) -> Any:
    """The value of an optional tag: None if it is damaged."""
    try:
        return tags.get(tag)
    except Exception:
        return None


def _read_padding(tags: Any, pixels: str) -> tuple[float, float] | None:
    """The range of stored values that stand for no value. Zero is not padding: MRI pads with its background.

    pixels: "Float" or "DoubleFloat" of floating-point pixels, else "".
    """
    limits = []
    for value in (tags.get(f"{pixels}PixelPadding{name}") for name in ("Value", "RangeLimit")):
        if isinstance(value, bytes) and len(value) == 2:
            value = int.from_bytes(value, "little" if tags.original_encoding[1] else "big")
        number = finite_numbers([value], 1)
        if number is None:
            break
        # whole numbers are of the pixels' type (US or SS), whatever type the file states
        limits.append(number[0] if pixels else _wrap_sign(tags, number[0]))
    return (min(limits), max(limits)) if limits and limits[0] else None


def _wrap_sign(tags: Any, value: float) -> float:
    """A number of 16 bits in the pixels' type: 63536 becomes −2000 for signed pixels, and the reverse."""
    signed, bits = tags.get("PixelRepresentation") == 1, whole_number(tags.get("BitsAllocated"), 16)
    if bits > 16 or not -(2**15) <= value < 2**16:
        return value
    return value - 2**16 if signed and value >= 2**15 else value + 2**16 if not signed and value < 0 else value


def _read_lut(tags: Any) -> tuple[int, np.ndarray] | None:
    """First stored value and entries of the modality LUT; None without one. Raises InputError for a damaged LUT."""
    items = tags.get("ModalityLUTSequence")
    if not items:
        return None
    count, first, bits = (int(entry) for entry in items[0].LUTDescriptor)
    data, count = items[0].LUTData, count or 2**16
    order = "<" if tags.original_encoding[1] else ">"
    entries = np.frombuffer(data, f"{order}u2") if isinstance(data, bytes) else np.atleast_1d(np.asarray(data))
    if bits == _BYTE and len(entries) == -(-count // 2) < count and entries.dtype.kind in "ui":
        # two entries in each number of 16 bits, the first one in its lower byte
        entries = entries.astype("<u2").view(np.uint8)[:count]
    if entries.dtype.kind not in "ui" or count != len(entries) or not _BYTE <= bits <= 2 * _BYTE:
        raise expected("modality LUT", f"{count} entries, by its descriptor", len(entries), "the header is damaged")
    return int(_wrap_sign(tags, first)), entries.astype(np.int64)


def finite_numbers(value: Any, count: int) -> Numbers | None:
    """`count` finite numbers; None for anything else."""
    try:
        numbers = tuple(float(number) for number in value)
    except (TypeError, ValueError):
        return None
    return numbers if len(numbers) == count and all(map(math.isfinite, numbers)) else None


def whole_number(value: Any, least: int) -> int:
    """A whole number of at least `least`; `least` if there is none."""
    try:
        return max(int(value), least)
    except (TypeError, ValueError):
        return least


def plain_text(value: Any) -> str:
    """Printable text of a tag, at most 64 characters."""
    text = str(value or "")
    with suppress(UnicodeError):
        # UTF-8 without SpecificCharacterSet, which pydicom takes for Latin-1
        text = text.encode("latin-1").decode("utf-8")
    return "".join(c if c.isprintable() else "?" for c in text)[:64].strip()
