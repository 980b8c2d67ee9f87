"""DICOM files of a folder, a zip or alone: which there are, and reads of them that are bounded by their sizes."""

from __future__ import annotations

import os
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import IO

from splatgl.data.readers.files import require_plausible
from splatgl.errors import InputError, expected

SUFFIXES = (".dcm", ".dicom", ".ima")
MAGIC, MAGIC_AT = b"DICM", 128
# groups 2 and 8, which a file without preamble begins with, in either byte order
BARE = (b"\x02\x00", b"\x08\x00", b"\x00\x08")
DEPTH = 5
"""Folders below folders that are looked into: those of a CD (patient, study, series) and one more."""
MOST_FILES, MOST_TRIED = 100_000, 2_000
"""Most files of a source, and most that are tried to tell whether a folder holds any."""


@dataclass(frozen=True)
class Source:
    """A file, or a member of a zip. name: as it is told in messages, from the given path on."""

    path: Path
    name: str
    member: str | None = None

    @contextmanager
    def open(self) -> Iterator[Bounded]:
        """The bytes; InputError if a zip's member cannot be read."""
        if self.member is None:
            with self.path.open("rb") as file:
                yield Bounded(file, self.path.stat().st_size)
            return
        with zip_file(self.path) as archive, archive.open(self.member) as packed:
            yield Bounded(packed, archive.getinfo(self.member).file_size)


class Bounded:
    """A file that never reads beyond its end: libraries ask for whatever length a damaged header states, and buffers
    of that length would be allocated.
    """

    def __init__(self, file: IO[bytes], size: int) -> None:
        self.file, self.size = file, size

    def read(self, count: int | None = -1) -> bytes:
        """At most `count` bytes. The whole rest is never read: pydicom asks for it where it inflates."""
        if count is None or count < 0:
            raise expected("transfer syntax", "one that isn't deflated", "deflated", "save it uncompressed")
        return self.file.read(min(count, max(self.size - self.file.tell(), 0)))

    def seek(self, offset: int, whence: int = 0) -> int:
        """Moves; returns the place."""
        return self.file.seek(offset, whence)

    def tell(self) -> int:
        """The place."""
        return self.file.tell()


@contextmanager
def zip_file(path: Path) -> Iterator[zipfile.ZipFile]:
    """An opened zip; its own failures, also of members that are read meanwhile, as InputError."""
    try:
        with zipfile.ZipFile(path) as archive:
            yield archive
    except (InputError, OSError, MemoryError):
        raise
    except (NotImplementedError, RuntimeError) as error:
        raise expected("zip", "members that are deflated, without a password", "others", "unpack it") from error
    except Exception as error:
        # zipfile raises many types, IndexError for a member without a name among them
        raise InputError("cannot be read as zip: the file is cut short or damaged") from error


def looks_like(head: bytes, name: str) -> bool:
    """Whether a file is DICOM: the magic after the preamble, or a DICOM name and the first group of a bare one."""
    return head[MAGIC_AT:] == MAGIC or (name.lower().endswith(SUFFIXES) and head.startswith(BARE))


def is_dicom(path: Path) -> bool:
    """Whether a file is one, or a folder holds one among its first files."""
    files = islice(_files(path), MOST_TRIED) if path.is_dir() else iter([path])
    return any(looks_like(_head(file), file.name) for file in files)


def sources(path: Path) -> list[Source]:
    """All DICOM files of a path, by name. Raises InputError for too many, and for a bad zip."""
    if path.is_dir():
        files = list(islice(_files(path), MOST_FILES + 1))
        found = [Source(file, file.relative_to(path).as_posix()) for file in files]
        found = [source for source in _few(found) if looks_like(_head(source.path), source.name)]
        return sorted(found, key=lambda source: source.name)
    if is_dicom(path):
        return [Source(path, path.name)]
    return _members(path) if zipfile.is_zipfile(path) else []


def _few(found: list[Source]) -> list[Source]:
    if len(found) > MOST_FILES:
        raise expected("folder", f"at most {MOST_FILES} files", "more", "name the folder of one study")
    return found


def _files(folder: Path, depth: int = DEPTH) -> Iterator[Path]:
    """Files of a folder, then of the folders in it; hidden ones and those that may not be read are left out."""
    try:
        entries = sorted(os.scandir(folder), key=lambda entry: entry.name)
    except OSError:
        return
    entries = [entry for entry in entries if not entry.name.startswith(".")]
    yield from (Path(entry.path) for entry in entries if entry.is_file())
    for entry in entries if depth else ():
        if entry.is_dir(follow_symlinks=False):
            yield from _files(Path(entry.path), depth - 1)


def _head(path: Path) -> bytes:
    try:
        with path.open("rb") as file:
            return file.read(MAGIC_AT + len(MAGIC))
    except OSError:
        return b""


def _members(path: Path) -> list[Source]:
    """Members of a zip that are DICOM."""
    with zip_file(path) as archive:
        infos = [info for info in archive.infolist() if not info.is_dir()]
        if sum(info.compress_size for info in infos) > path.stat().st_size:
            raise expected("zip", "members beside each other", "members that overlap", "the file is damaged")
        for info in infos:
            require_plausible(info.file_size, info.compress_size)
        found = []
        for source in _few([Source(path, info.filename, info.filename) for info in infos]):
            with archive.open(source.name) as file:
                if looks_like(file.read(MAGIC_AT + len(MAGIC)), source.name):
                    found.append(source)
    return sorted(found, key=lambda source: source.name)
