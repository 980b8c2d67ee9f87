"""Zarr stores in a zip (.zarr.zip, .ozx), read where they are.

Members are checked before anything reads them: what is deflated expands no more than MAX_BYTES, and metadata no more
than MOST_METADATA.
"""

from __future__ import annotations

import zipfile
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from splatgl.errors import expected, list_names
from splatgl.readers.chunked import file_tag
from splatgl.readers.common import MAX_BYTES, decoder_errors
from splatgl.readers.contents import ZARR
from splatgl.readers.remote import MOST_METADATA


class ZipPath:
    """A file or folder in a zip, with what readers of stores use of a `Path`."""

    def __init__(self, archive: zipfile.ZipFile, file: Path, name: str = "") -> None:
        self.archive, self.file, self.path = archive, file, name

    def __truediv__(self, name: str) -> ZipPath:
        return ZipPath(self.archive, self.file, f"{self.path}/{name}".strip("/"))

    def __str__(self) -> str:
        return str(self.file)

    @property
    def name(self) -> str:
        """The last part of the name."""
        return self.path.rsplit("/", 1)[-1]

    def resolve(self) -> ZipPath:
        """The path itself."""
        return self

    def is_file(self) -> bool:
        """Whether the zip has that file."""
        return self.path in self.archive.NameToInfo

    def stat(self) -> Any:
        """The unpacked size, as st_size."""
        return SimpleNamespace(st_size=self.archive.NameToInfo[self.path].file_size)

    def open(self, _mode: str = "rb") -> Any:
        """Opens the file."""
        return self.archive.open(self.path)

    def rglob(self, _pattern: str) -> Iterator[ZipPath]:
        """All files below."""
        inside = f"{self.path}/" if self.path else ""
        names = (name for name in self.archive.NameToInfo if name.startswith(inside) and not name.endswith("/"))
        return (ZipPath(self.archive, self.file, name) for name in names)

    def tag(self) -> str:
        """Text that changes with the contents."""
        return f"{file_tag(self.file.resolve())} {self.path}"


def open_zip(path: Path) -> tuple[Any, ZipPath, str]:
    """(zip as zarr reads it, its root, path of the only Zarr store in it). Raises InputError for a zip without one."""
    import zarr

    with decoder_errors("a zip"):
        archive = zipfile.ZipFile(path)
        store = zarr.storage.ZipStore(path, mode="r", read_only=True)
    members, folders = archive.infolist(), set[str]()
    if sum(member.compress_size for member in members) > path.stat().st_size:
        raise expected("zip", "separate members", "members that overlap", "the file is damaged")
    for member in members:
        if member.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED) or member.flag_bits & 1:
            raise expected(member.filename, "stored or deflated data", "another compression", "zip the folder again")
        folder, _, name = member.filename.rpartition("/")
        folders |= {folder} if name in ZARR[:3] else set()
        is_metadata = name in ZARR
        most = MOST_METADATA if is_metadata else MAX_BYTES if member.compress_type else path.stat().st_size
        if member.file_size > most:
            raise expected(member.filename, f"at most {most} bytes", member.file_size, "the file is damaged")
    least = min((folder.count("/") + bool(folder) for folder in folders), default=0)
    roots = sorted(folder for folder in folders if folder.count("/") + bool(folder) == least)
    if len(roots) != 1:
        raise expected("zip", "one Zarr store", list_names(roots) or "other files", "unpack it and name the store")
    return store, ZipPath(archive, path), roots[0]
