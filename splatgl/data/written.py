"""Files that are written whole or not at all, and the folders that they need."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from splatgl.data.errors import InputError


def write_whole(target: Path, data: bytes) -> None:
    """Writes a file atomically: to a temporary name, then renamed. Makes the folders that are missing.

    Raises InputError if it cannot be written; no new folder is left then.
    """
    try:
        with made(target.parent):
            _write(target, data)
    except OSError as error:
        raise InputError(f"{target}: cannot be written: {error.strerror or error}") from error


def _write(target: Path, data: bytes) -> None:
    temporary = ""
    try:
        with tempfile.NamedTemporaryFile(dir=target.parent, prefix=f".{target.name}.", delete=False) as file:
            temporary = file.name
            file.write(data)
        os.chmod(temporary, 0o666 & ~_umask())
        os.replace(temporary, target)
    finally:
        if temporary and os.path.exists(temporary):
            os.unlink(temporary)


@contextmanager
def made(folder: Path) -> Iterator[None]:
    """Makes a folder, and those above it that are missing; they are removed if the work in it fails and left none."""
    missing = [path for path in (folder, *folder.parents) if not path.exists()]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        yield
    except BaseException:
        for path in missing:
            # one that holds something stays, as do those above
            with suppress(OSError):
                path.rmdir()
        raise


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
