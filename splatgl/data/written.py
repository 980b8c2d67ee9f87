"""Files that are written whole or not at all, and the folders that they need."""

from __future__ import annotations

import errno
import os
import stat
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from splatgl.data.errors import InputError

# most bytes of a name that is made of another: file systems have 255, of which an ending takes some
LONGEST = 200


def write_whole(target: Path, data: bytes) -> None:
    """Writes a file atomically: to a temporary name, then renamed. Makes the folders that are missing.

    Raises InputError if it cannot be written; no new folder is left then.
    """
    with replaced(target) as temporary:
        temporary.write_bytes(data)


@contextmanager
def replaced(target: Path) -> Iterator[Path]:
    """A file beside `target` to write into, which takes its place and its mode at the end, or goes if the work fails.
    Links are followed: what they lead to is replaced. Makes the folders that are missing.

    Raises InputError if it cannot be written; no new folder is left then.
    """
    try:
        real = Path(os.path.realpath(target))
        mode = _mode(real)
        with made(real.parent):
            temporary = ""
            try:
                with tempfile.NamedTemporaryFile(
                    dir=real.parent, prefix=f".{shortened(real.name)}.", delete=False
                ) as file:
                    temporary = file.name
                yield Path(temporary)
                os.chmod(temporary, mode)
                os.replace(temporary, real)
            finally:
                if temporary and os.path.exists(temporary):
                    os.unlink(temporary)
    except OSError as error:
        raise InputError(f"{target}: cannot be written: {error.strerror or error}") from error


def shortened(name: str) -> str:
    """A file's name, to which an ending can be added: its beginning, if it is long."""
    return name.encode(errors="surrogateescape")[:LONGEST].decode(errors="ignore")


def _mode(real: Path) -> int:
    """The permissions of a file that is there, else those of a new one. Raises OSError for what is no file."""
    try:
        told = os.lstat(real).st_mode
    except FileNotFoundError:
        return 0o666 & ~_umask()
    if stat.S_ISLNK(told):
        raise OSError(errno.ELOOP, os.strerror(errno.ELOOP))
    if stat.S_ISDIR(told):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
    if not stat.S_ISREG(told):
        raise OSError(errno.EINVAL, "a pipe or device")
    return stat.S_IMODE(told)


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
