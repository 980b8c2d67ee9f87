"""The user-facing exception: one line on what failed, why, and how to fix it."""

from __future__ import annotations


class InputError(ValueError):
    """Bad input. The message is one line; the command line prints it and exits with code 2."""


def expected(what: object, this: object, got: object, fix: str = "") -> InputError:
    """An `InputError` in the standard form: `<what>: expected <this>, got <that>; <how to fix>`."""
    line = f"{what}: expected {this}, got {got}" + (f"; {fix}" if fix else "")
    return InputError(" ".join(line.split()))


def missing_extra(what: str, library: str, extra: str) -> InputError:
    """An `InputError` for a missing library, naming the extra that installs it."""
    return InputError(f"{what}: needs the library {library}; install it with: pip install 'splatgl[{extra}]'")
