"""The user-facing exception: one line on what failed, why, and how to fix it."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from importlib import import_module
from typing import Any


class InputError(ValueError):
    """Bad input. The message is one line; the command line prints it and exits with code 2."""


class InputWarning(UserWarning):
    """A note on a file, one line, such as a spacing that is assumed; commands, windows and views print it."""


def warn(notes: Iterable[str], of: object) -> None:
    """Warns of notes on a file, at the line outside of splatgl that asked for it."""
    level, frame = 2, sys._getframe(1)
    while frame.f_back and frame.f_globals.get("__name__", "").partition(".")[0] == "splatgl":
        level, frame = level + 1, frame.f_back
    for note in notes:
        warnings.warn(f"{of}: {note}", InputWarning, level)


class MissingOption(InputError):
    """Missing option: the file contains several things, of which the option picks one, or does not contain the stated
    one.

    option: the reader option (a field of LoadOptions). choices: (name, description) of the possible choices, listed by
    `splatgl info`; the message is complete without them.
    """

    def __init__(self, message: str, option: str = "", choices: Sequence[tuple[str, str]] = ()) -> None:
        super().__init__(message)
        self.option = option
        self.choices = tuple(choices)


# errors that the user gets as one line, and that end neither the window nor a batch
USER_ERRORS = (InputError, MemoryError)


def error_text(error: BaseException) -> str:
    """The message of one of USER_ERRORS."""
    return str(error) or "not enough memory"


def expected(what: object, this: object, got: object, fix: str = "") -> InputError:
    """An `InputError` in the standard form: `<what>: expected <this>, got <that>; <how to fix>`."""
    line = f"{what}: expected {this}, got {got}" + (f"; {fix}" if fix else "")
    return InputError(" ".join(line.split()))


@contextmanager
def error_prefix(what: str) -> Iterator[None]:
    """Prefixes an InputError with the location of a value, such as a table of a file."""
    try:
        yield
    except InputError as error:
        line = f"{what}: {error}"
        raise (
            MissingOption(line, error.option, error.choices) if isinstance(error, MissingOption) else InputError(line)
        ) from error


# least similarity of a misspelt word to the one that is suggested
SIMILAR = 0.8


def list_names(names: Sequence[object], most: int = 8) -> str:
    """The first names as text, which ends with … if there are more."""
    return ", ".join(map(str, names[:most])) + ", …" * (len(names) > most)


def one_line(error: BaseException, most: int = 200) -> str:
    """The first letters of the message of another library's error in one line; its type without a message."""
    return " ".join(str(error).split())[:most] or type(error).__name__


def missing_extra(what: str, library: str, extra: str) -> InputError:
    """An `InputError` for a missing library, naming the extra that installs it."""
    return InputError(f"{what}: needs the library {library}; install it with: pip install 'splatgl[{extra}]'")


# modules that libraries import if they can, and this process does not need; empty where it is a user's program
NOT_NEEDED: dict[str, str] = {}


def import_extra(module: str, what: str, library: str, extra: str) -> Any:
    """The module of an extra, imported without what is NOT_NEEDED. Raises InputError, which names the extra, if its
    library is missing.
    """
    without = NOT_NEEDED.get(module)
    is_hidden = without is not None and without not in sys.modules and module not in sys.modules
    if is_hidden:
        # Python's own way to make an import fail
        sys.modules[without] = None  # type: ignore[assignment, index]
    try:
        return import_module(module)
    except ImportError as error:
        raise missing_extra(what, library, extra) from error
    finally:
        if is_hidden:
            del sys.modules[without]  # type: ignore[arg-type]
