"""TOML tables, atomic writes, byte sizes, and checks of output paths."""

from __future__ import annotations

import codecs
import errno
import json
import math
import os
import re
import shutil
import stat
import sys
import tempfile
import tomllib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from difflib import get_close_matches
from itertools import islice
from numbers import Integral, Real
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from splatgl.errors import SIMILAR, InputError, expected
from splatgl.platforms import free_memory

if TYPE_CHECKING:
    import numpy as np


Result = TypeVar("Result")

# names that Windows keeps for devices, with any ending
DEVICES = re.compile(r"(?i)(con|prn|aux|nul|com\d|lpt\d)(\.|$)")


def check_output(path: Path, suffixes: tuple[str, ...] = (".png", ".npy")) -> None:
    """Raises InputError, before any work, if `path` cannot be written or has none of the suffixes."""
    if path.suffix.lower() not in suffixes:
        raise expected(path, f"a name that ends in {' or '.join(suffixes)}", repr(path.suffix))
    if os.path.exists(path) and not os.path.isfile(path):
        raise expected(path, "a file to write", "a directory" if os.path.isdir(path) else "a pipe or device")
    if sys.platform == "win32" and DEVICES.match(path.name):
        raise expected(path, "a file to write", "the name of a device of Windows", "choose another name")
    check_folder(path.parent, path)
    if os.path.exists(path) and not os.access(path, os.W_OK):
        raise InputError(f"{path}: cannot be written: permission denied")


def require_file(path: Path) -> None:
    """Raises InputError, which says what it is, for a path that is no file."""
    if not path.is_file():
        kind = "a directory" if path.is_dir() else "a pipe or device" if path.exists() else "no such file"
        raise InputError(f"{path}: cannot be read: {kind}")


def check_folder(folder: Path, name: Path | str) -> None:
    """Raises InputError, which begins with `name`, if a folder can neither be written to nor be made."""
    parent = next(path for path in (folder, *folder.absolute().parents) if os.path.lexists(path))
    if not parent.is_dir():
        raise expected(name, "a folder", f"the file {parent}", "choose another name")
    if not os.access(parent, os.W_OK | os.X_OK):
        raise InputError(f"{name}: cannot be written: permission denied")


def overwrites(path: Path, sources: Iterable[str | None]) -> bool:
    """Whether writing `path` would overwrite one of the sources, also through a link; None is no source."""
    return os.path.exists(path) and any(
        source and os.path.exists(source) and path.samefile(source) for source in sources
    )


def check_source(path: Path, *sources: str | None) -> None:
    """Raises InputError if writing `path` would overwrite one of the sources; None is no source."""
    if overwrites(path, sources):
        raise expected(path, "another file than the source", "the source itself", "name another one with -o")


# files of a folder among which a name is looked for
MOST_NAMES = 1000


def require_existing(path: Path, what: object, this: str = "a file") -> None:
    """Raises InputError, which suggests a similar name in its folder, for a path that does not exist."""
    if path.exists():
        return
    is_listed = path.parent.is_dir() and os.access(path.parent, os.R_OK)
    names = [file.name for file in islice(path.parent.iterdir() if is_listed else (), MOST_NAMES)]
    similar = get_close_matches(path.name, names, 1, SIMILAR)
    raise expected(what, this, "no such file", f"did you mean {similar[0]}?" if similar else "check the path")


# most bytes of an array that is read as a whole
WHOLE_BYTES = 2**28


def byte_count(shape: Sequence[int], dtype: np.dtype) -> int:
    """Bytes of an array, exact for sizes of any magnitude."""
    return math.prod(int(size) for size in shape) * dtype.itemsize


# share of the available memory that is used unless a budget is set
SHARE = 0.5
# share of the budget that samples in memory take, or chunks of them, and bytes that they may always take
HELD_SHARE, ALWAYS = 1 / 8, 2**25
# bytes of the process that draws nothing much: Python, numpy, OpenGL and a reader
PROCESS = 190 << 20
# the budget that was set, if any
_budget: list[int] = []


def parse_bytes(text: str) -> int:
    """Parses a number of bytes: 4GiB, 500MB, 1e9. Raises InputError for other text."""
    match = re.fullmatch(r"([0-9.]+(?:e[0-9]+)?) *(?:([kmgt])(i?)b?|b?)", text.strip().lower())
    try:
        assert match is not None
        number, unit, binary = match.groups()
        return int(float(number) * (1024 if binary else 1000) ** ("kmgt".index(unit) + 1 if unit else 0))
    except (AssertionError, ValueError):
        raise expected("memory", "a number of bytes, such as 4GiB or 500MB", repr(text)) from None


def format_bytes(count: int) -> str:
    """A number of bytes as text, such as 3.7 GiB."""
    size, units = float(count), ["bytes", "KiB", "MiB", "GiB", "TiB"]
    while size >= 1024 and len(units) > 1:
        size, units = size / 1024, units[1:]
    return f"{size:.0f} {units[0]}" if units[0] == "bytes" else f"{size:.1f} {units[0]}"


@contextmanager
def within(memory: int | None) -> Iterator[None]:
    """Sets the memory budget of this process, bytes, for what is done meanwhile; None: leaves it as it is.
    Raises InputError for no bytes.
    """
    if memory is not None and memory <= 0:
        raise expected("memory", "a positive number of bytes", memory)
    before = [*_budget]
    _budget[:] = before if memory is None else [memory]
    try:
        yield
    finally:
        _budget[:] = before


def stated_budget() -> int | None:
    """The budget that `within` has set, bytes; None: none."""
    return _budget[0] if _budget else None


def call_within(memory: int | None, work: Callable[..., Result], *arguments: object) -> Result:
    """Calls work(*arguments) within a memory budget, as `within` sets it."""
    with within(memory):
        return work(*arguments)


def require_memory(
    needed: int, there: int, fix: str = "free memory, or save a smaller part of it", what: str = "samples"
) -> None:
    """Raises InputError if `needed` bytes exceed the budget. there: bytes that they are packed in; what: their name."""
    most = budget()
    if needed > most:
        got = f"{format_bytes(needed)}, packed in {format_bytes(max(there, 0))}"
        raise expected(what, f"at most {format_bytes(most)} in memory", got, fix)


def held_within_budget(most: int) -> int:
    """Bytes that samples in memory, or decoded chunks of them, may take: `most`, or their share of the budget."""
    return min(most, max(int(HELD_SHARE * budget()), ALWAYS))


def budget() -> int:
    """Memory budget in bytes: as set, else SHARE of the free memory."""
    return _budget[0] if _budget else int(SHARE * free_memory())


# marks at the start of text, and their codings
_BYTE_ORDER_MARKS = {codecs.BOM_UTF8: "utf-8", codecs.BOM_UTF16_LE: "utf-16-le", codecs.BOM_UTF16_BE: "utf-16-be"}


def decode_text(raw: bytes) -> str:
    """The text of a header or a table: in the coding of its byte-order mark, else UTF-8, else Latin-1 as Windows has it
    (cp1252). Headers in which programs have mixed codings are decoded line by line.
    """
    for mark, coding in _BYTE_ORDER_MARKS.items():
        if raw.startswith(mark):
            return raw[len(mark) :].decode(coding, "replace")
    try:
        return raw.decode("utf-8")
    except UnicodeDecodeError:
        return raw.decode("cp1252", "replace")


# longest file in bytes: a transfer function with a node for each of 65536 values
MAX_BYTES = 2**20


def load_table(path: Path, what: str) -> dict[str, Any]:
    """The table in a TOML file. what: the kind of file for messages, such as "a scene". Raises InputError naming it."""
    try:
        require_existing(path, path, what)
        # a pipe would block, a device could be endless
        if not path.is_file():
            raise expected(path, f"{what} in a TOML file", "a folder, pipe or device")
        with path.open("rb") as file:
            data = file.read(MAX_BYTES + 1)
        if len(data) > MAX_BYTES:
            raise expected(path, f"{what} of at most {MAX_BYTES} bytes", "more")
        return parse_table(data.decode("utf-8-sig"), f"{path}: expected {what} in TOML")
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: expected {what} in TOML, got {error}") from error


def parse_table(text: str, expectation: str) -> dict[str, Any]:
    """The table in TOML text. Raises InputError whose message begins with `expectation`."""
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        # ValueError: bad TOML, invalid dates, and integers too long to convert
        raise InputError(f"{expectation}, got {' '.join(str(error).split())}") from error


def toml_value(what: str, value: Any) -> str:
    """A string, number, boolean, or sequence of them as TOML. Raises InputError for values that TOML cannot store."""
    if isinstance(value, str):
        # JSON escapes everything that TOML requires, except DEL
        text = json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
        if any("\ud800" <= letter <= "\udfff" for letter in text):
            raise expected(what, "text that TOML can hold", repr(value)[:80])
        return text
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, Integral):
        return str(int(value))
    if isinstance(value, Real):
        return repr(float(value))
    if isinstance(value, Sequence):
        return "[" + ", ".join(toml_value(what, part) for part in value) + "]"
    raise expected(what, "text, numbers or lists of them", type(value).__name__)


def toml_rows(head: str, table: Mapping[str, Any]) -> list[str]:
    """Lines of a table of TOML: an empty one, the head, such as [settings] or [[mesh]], and a line for each key."""
    return ["", head, *(f"{key} = {toml_value(key, value)}" for key, value in table.items())]


# most bytes of a shortened name: file systems allow 255, of which an ending takes some
LONGEST = 200


def write_file(target: Path, data: bytes) -> None:
    """Writes a file as `atomic_write` does. Raises InputError if it cannot be written."""
    with atomic_write(target) as temporary:
        temporary.write_bytes(data)


@contextmanager
def atomic_write(target: Path) -> Iterator[Path]:
    """Yields a temporary file next to `target`, which replaces it at the end and takes its mode; removed on failure.

    The target of a link is replaced, not the link. Missing folders are made. Raises InputError if the file cannot be
    written; no new folder is left then.
    """
    try:
        real = Path(os.path.realpath(target))
        mode = _mode(real)
        with new_folder(real.parent):
            temporary = ""
            try:
                with tempfile.NamedTemporaryFile(
                    dir=real.parent, prefix=f".{shorten_name(real.name)}.", delete=False
                ) as file:
                    temporary = file.name
                yield Path(temporary)
                os.chmod(temporary, mode)
                _replace(temporary, real)
            finally:
                if temporary and os.path.exists(temporary):
                    os.unlink(temporary)
    except OSError as error:
        raise InputError(f"{target}: cannot be written: {error.strerror or error}") from error


def _replace(temporary: str, real: Path) -> None:
    """Renames a file to one that may exist. Raises OSError; Windows replaces no file that is open."""
    try:
        os.replace(temporary, real)
    except PermissionError:
        if sys.platform != "win32":
            raise
        raise OSError(
            errno.EACCES, "it is open, here or in another program; close it, or choose another name"
        ) from None


def shorten_name(name: str) -> str:
    """A file name, cut so that an ending can be added."""
    return name.encode(errors="surrogateescape")[:LONGEST].decode(errors="ignore")


def _mode(real: Path) -> int:
    """The permissions of an existing file, else of a new one. Raises OSError for anything but a file."""
    try:
        mode = os.lstat(real).st_mode
    except FileNotFoundError:
        return 0o666 & ~_umask()
    if stat.S_ISLNK(mode):
        raise OSError(errno.ELOOP, os.strerror(errno.ELOOP))
    if stat.S_ISDIR(mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
    if not stat.S_ISREG(mode):
        raise OSError(errno.EINVAL, "a pipe or device")
    return stat.S_IMODE(mode)


@contextmanager
def atomic_folder(target: Path) -> Iterator[Path]:
    """Yields a path next to `target`, a free name, that becomes it at the end; the folder there is removed on failure.

    Missing parents are made. Raises InputError if it cannot be written.
    """
    part = target.with_name(f".{shorten_name(target.name)}.{os.getpid()}.part")
    try:
        with new_folder(target.parent):
            try:
                yield part
                part.rename(target)
            finally:
                shutil.rmtree(part, ignore_errors=True)
    except OSError as error:
        raise InputError(f"{target}: cannot be written: {error.strerror or error}") from error


@contextmanager
def new_folder(folder: Path) -> Iterator[None]:
    """Makes a folder and its missing parents; removes them if the work in it fails, unless they contain files."""
    missing = [path for path in (folder, *folder.parents) if not path.exists()]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        yield
    except BaseException:
        for path in missing:
            # a folder that holds something stays, and so do its parents
            with suppress(OSError):
                path.rmdir()
        raise


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
