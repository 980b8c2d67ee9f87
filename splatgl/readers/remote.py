"""Volumes at an address (https, s3, gs, and others of fsspec), copied into a cache folder.

A single file is fetched as a whole; of a Zarr store the metadata, and chunks when they are needed. The copy is read
like any store.
"""

from __future__ import annotations

import hashlib
import os
import re
import shutil
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from splatgl.errors import InputError, expected, import_extra, one_line
from splatgl.fileio import shorten_name, write_file
from splatgl.platforms import user_folder
from splatgl.readers.contents import ZARR

# number of attempts; seconds between the first two, which double; seconds for a connection and for each part of an
# answer
ATTEMPTS, WAIT, CONNECT, ANSWER = 4, 0.5, 10.0, 30.0
# most bytes of a metadata file
MOST_METADATA = 1 << 26

_ADDRESS = re.compile(r"[A-Za-z][A-Za-z0-9+.-]+://")


def is_address(source: str | Path) -> bool:
    """Whether a source is an address rather than a path."""
    return isinstance(source, str) and bool(_ADDRESS.match(source))


def address_name(address: str) -> str:
    """The last part of an address, which names the file or store; without letters that Windows does not allow in
    names.
    """
    name = address.split("?")[0].split("#")[0].rstrip("/").rsplit("/", 1)[-1]
    return re.sub(r'[<>:"\\|*]', "_", name) if sys.platform == "win32" else name


def cache_folder() -> Path:
    """The folder of fetched files: SPLATGL_CACHE, else splatgl in the user's cache folder."""
    folder = os.environ.get("SPLATGL_CACHE")
    return Path(folder) if folder else user_folder("cache") / "splatgl"


class Remote:
    """A file or store at an address, and its copy in `folder`. Raises InputError without an answer."""

    def __init__(self, address: str) -> None:
        self.address = address
        fsspec = import_extra("fsspec", "addresses", "fsspec", "remote")
        scheme = address.split("://")[0]
        options: dict[str, Any] = {"skip_instance_cache": True}
        if scheme in ("http", "https"):
            aiohttp = import_extra("aiohttp", f"{scheme} addresses", "aiohttp", "remote")
            limit = aiohttp.ClientTimeout(total=None, sock_connect=CONNECT, sock_read=ANSWER)
            options["client_kwargs"] = {"timeout": limit}
        try:
            self.files, self.root = fsspec.url_to_fs(address, **options)
        except ImportError as error:
            fix = f"pip install 'splatgl[remote]': {one_line(error)}"
            raise InputError(f"{scheme} addresses need the extra remote, {fix}") from None
        except ValueError as error:
            raise expected("address", "a protocol that fsspec knows", scheme, one_line(error)) from None
        digest = hashlib.sha256(address.encode()).hexdigest()[:16]
        self.folder = cache_folder() / f"{digest}-{re.sub(r'[^A-Za-z0-9._-]', '_', address_name(address))[:60]}"
        self.absent: set[str] = set()
        self.metadata: dict[str, bytes | None] = {}

    def path(self, name: str) -> Path:
        """The path of the copy of a store's file. Raises InputError for a name outside the store."""
        copy = self.folder / name
        if ".." in Path(name).parts or not copy.resolve().is_relative_to(self.folder.resolve()):
            raise expected("name", "a name inside the store", name)
        return copy

    def fetch(self, names: Sequence[str]) -> None:
        """Fetches files of a store that are not copied yet, in parallel; files that do not exist are remembered."""
        waiting = [name for name in names if not (name in self.absent or self.path(name).is_file())]
        for name, data in self._read_files(waiting).items():
            if data is None:
                self.absent.add(name)
            else:
                write_file(self.path(name), data)

    def __str__(self) -> str:
        return self.address

    def file(self) -> Path:
        """The copy of the single file, fetched unless there is one of the same size and tag."""
        info = self._retry(lambda: self.files.info(self.root))
        tag = "".join(str(info.get(key, "")) for key in ("size", "ETag", "Last-Modified", "LastModified", "mtime"))
        place = self.folder / hashlib.sha256(tag.encode()).hexdigest()[:16] / address_name(self.root)
        if not place.is_file():
            shutil.rmtree(self.folder, ignore_errors=True)
            place.parent.mkdir(parents=True)
            part = place.with_name(f".{shorten_name(place.name)}.part")
            self._retry(lambda: self.files.get_file(self.root, str(part)))
            part.replace(place)
        return place

    def store(self) -> Path:
        """The copy of the Zarr store with its current metadata; chunks are fetched when needed."""
        if not any(self.refresh(ZARR)):
            raise expected("address", "a file, or a Zarr store", "none", "check it")
        return self.folder

    def refresh(self, names: Sequence[str]) -> list[bytes | None]:
        """The current contents of metadata files, None for missing ones; changes remove all outdated copies."""
        copies = {name: self.path(name) for name in names}
        known = {name: copy.is_file() and copy.stat().st_size <= MOST_METADATA for name, copy in copies.items()}
        before = {name: copy.read_bytes() if known[name] else None for name, copy in copies.items()}
        after = self._read_files(names)
        self.metadata |= after
        self.absent |= {name for name, data in after.items() if data is None}
        if any(before.values()) and before != after:
            shutil.rmtree(self.folder, ignore_errors=True)
        for name, data in self.metadata.items():
            if data is not None:
                write_file(self.path(name), data)
        return list(after.values())

    def _read_files(self, names: Sequence[str]) -> dict[str, bytes | None]:
        """The contents of files, None for missing ones."""
        contents: dict[str, bytes | None] = {}
        addresses = {f"{self.root.rstrip('/')}/{name}": name for name in names}

        def ask() -> None:
            missing = [address for address, name in addresses.items() if name not in contents]
            failed = None
            for address, data in self.files.cat(missing, on_error="return").items() if missing else ():
                if isinstance(data, FileNotFoundError):
                    contents[addresses[address]] = None
                elif isinstance(data, BaseException):
                    failed = data
                else:
                    contents[addresses[address]] = data
            if failed:
                raise failed

        self._retry(ask)
        return contents

    def _retry(self, ask: Any) -> Any:
        """The answer, after several attempts. Raises InputError without an answer."""
        for attempt in range(ATTEMPTS):
            try:
                return ask()
            except FileNotFoundError:
                raise expected("address", "a file, or a Zarr store", "nothing there", "check it") from None
            except PermissionError as error:
                raise InputError(f"refused: {one_line(error)}") from None
            except Exception as error:
                # the libraries of services raise many types
                if attempt + 1 == ATTEMPTS:
                    raise InputError(f"no answer in {ATTEMPTS} attempts: {one_line(error)}") from None
                time.sleep(WAIT * 2**attempt)
        raise AssertionError
