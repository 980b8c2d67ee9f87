"""The user-facing exception: one line on what failed, why, and how to fix it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib import import_module
from typing import Any


class InputError(ValueError):
    """Bad input. The message is one line; the command line prints it and exits with code 2."""


class Choice(InputError):
    """What a file can't be read without: an option that picks one of several things, or tells what the file does not.

    option: the reader option (a field of LoadOptions). found: what there is, a name and a few words each, to be listed
    by `splatgl info`; the message is complete without them.
    """

    def __init__(self, message: str, option: str = "", found: Sequence[tuple[str, str]] = ()) -> None:
        super().__init__(message)
        self.option = option
        self.found = tuple(found)


# what is said in a line, and ends nothing that could go on
USER_ERRORS = (InputError, MemoryError)


def error_text(error: BaseException) -> str:
    """What one of TOLD says."""
    return str(error) or "not enough memory"


def expected(what: object, this: object, got: object, fix: str = "") -> InputError:
    """An `InputError` in the standard form: `<what>: expected <this>, got <that>; <how to fix>`."""
    line = f"{what}: expected {this}, got {got}" + (f"; {fix}" if fix else "")
    return InputError(" ".join(line.split()))


@contextmanager
def error_prefix(what: str) -> Iterator[None]:
    """Puts the place of a value, such as a table of a file, before the message of an InputError."""
    try:
        yield
    except InputError as error:
        raise InputError(f"{what}: {error}") from error


def missing_extra(what: str, library: str, extra: str) -> InputError:
    """An `InputError` for a missing library, naming the extra that installs it."""
    return InputError(f"{what}: needs the library {library}; install it with: pip install 'splatgl[{extra}]'")


def import_extra(module: str, what: str, library: str, extra: str) -> Any:
    """The module of an extra. Raises InputError, which names the extra, if its library is missing."""
    try:
        return import_module(module)
    except ImportError as error:
        raise missing_extra(what, library, extra) from error
