"""The series of a DICOM file, folder or zip, from headers alone, and the choice of one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from splatgl.data.readers.dicom_files import Source, sources
from splatgl.data.readers.dicom_grid import largest_group, rank
from splatgl.data.readers.dicom_headers import Frame, Header, frames, header
from splatgl.data.readers.options import LoadOptions
from splatgl.errors import InputError, expected

OTHERS = {
    "SEG": "a segmentation",
    "RTSTRUCT": "contours",
    "RTPLAN": "a treatment plan, without an image",
    "SR": "a report, without an image",
    "DICOMDIR": "a DICOMDIR, a table of contents: name the folder that it is in",
}
"""Kinds of files that hold no volume, and what to do with them."""

SEGMENTS = {"SEG": "segmentations", "RTSTRUCT": "contours"}
"""Kinds of files whose segments are read."""

DICOMDIR_CLASS = "1.2.840.10008.1.3.10"


@dataclass(frozen=True)
class Series:
    """A series of images: its number in the list, UID, kind, description, and frames."""

    number: int
    uid: str
    modality: str
    description: str
    frames: tuple[Frame, ...]

    def __str__(self) -> str:
        """What may be shown of it: nothing that identifies a patient, no UID."""
        rows, columns = self.frames[0].header.size
        told = f"{self.number}: {self.modality}, {len(self.frames)} × {columns} × {rows}"
        return f"{told}, {self.description}" if self.description else told

    @property
    def rank(self) -> tuple[bool, int]:
        """Orders series by the size of their largest stack."""
        return rank(largest_group(self.frames)[0])


@dataclass(frozen=True)
class Contents:
    """What a path holds: its series, in the order of their numbers; files that are damaged, or without images."""

    series: tuple[Series, ...]
    damaged: int
    others: tuple[Header, ...] = ()

    @property
    def segments(self) -> list[Header]:
        """Those of the others that label voxels."""
        return [head for head in self.others if head.modality in SEGMENTS]


def contents(path: Path) -> Contents:
    """The series of a path. Raises InputError if there are none, nor segments, which says what is there instead."""
    found = sources(path)
    if not found:
        raise expected("DICOM", "files of slices", "none", "name the folder or file that holds them")
    members: dict[str, list[Frame]] = {}
    others: list[Header] = []
    failed: list[InputError] = []
    for source in found:
        try:
            head, each = _frames(source)
        except InputError as error:
            if len(found) == 1 or "splatgl[" in str(error):
                raise
            failed.append(error)
            continue
        if each:
            members.setdefault(head.series, []).extend(each)
        else:
            others.append(head)
    if not members and not any(head.modality in SEGMENTS for head in others):
        raise _no_images([_kind(head) for head in others], failed)
    ordered = sorted(members.values(), key=lambda each: (each[0].header.number, each[0].header.series))
    series = (_series(number, each) for number, each in enumerate(ordered, 1))
    return Contents(tuple(series), len(failed), tuple(others))


def _series(number: int, members: list[Frame]) -> Series:
    head = members[0].header
    return Series(number, head.series, head.modality, head.description, tuple(members))


def _frames(source: Source) -> tuple[Header, list[Frame]]:
    """A file's header and frames, none if it is no image. Raises InputError for a damaged one."""
    head, told = header(source)
    if min(head.size) < 1 or head.modality in OTHERS:
        return head, []
    if not head.pixels:
        raise expected("file", "pixels behind its header", "none", "it is cut short, or holds no image")
    return head, frames(head, told)


def _kind(head: Header) -> str:
    if head.sop == DICOMDIR_CLASS:
        return "DICOMDIR"
    return head.modality if head.modality in OTHERS else ""


def _no_images(others: Sequence[str], failed: Sequence[InputError]) -> InputError:
    """What is there instead of images: the kind that can be converted, if there is one."""
    if not others and failed:
        return InputError(f"none of {len(failed)} DICOM files can be read: {failed[0]}")
    kind = next((kind for kind in OTHERS if kind in others), "")
    return expected("DICOM", "images", OTHERS.get(kind, "files without pixels"))


def chosen(found: Sequence[Series], options: LoadOptions) -> Series:
    """The series of that number, UID or end of a UID; without one, the largest. InputError for none and several."""
    if options.series is None:
        return max(found, key=lambda series: series.rank)
    asked = str(options.series)
    if asked.isascii() and asked.isdigit() and 1 <= int(asked[:9]) <= len(found):
        return found[int(asked[:9]) - 1]
    ends = [series for series in found if series.uid.endswith(asked)]
    whole = [series for series in ends if series.uid == asked] or ends
    if len(whole) != 1:
        listed = "; ".join(map(str, found[:LISTED])) + ("; …" if len(found) > LISTED else "")
        got = f"{len(whole)} of that end" if whole else "another"
        raise expected("series", f"a number from 1 to {len(found)}, or the end of one UID", got, f"there are {listed}")
    return whole[0]


LISTED = 5
"""Most series that a message lists."""


def lines(path: Path) -> list[str]:
    """A heading, and a line for each series."""
    return ["series", *(f"  {series}" for series in contents(path).series)]
