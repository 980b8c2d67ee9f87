"""Messages in the words of the command line: names of Python's options as the options that users type."""

from __future__ import annotations

import argparse
import re
from collections.abc import Iterable, Mapping
from difflib import get_close_matches

READING = (
    *("shape", "dtype", "spacing", "header_offset", "array", "channel", "level", "series", "time"),
    *("color", "relief", "anywhere", "values"),
)
"""Reader options: a message on a file may name them behind its path."""

OTHER_NAMES = {"target": "look_at"}
"""Options that Python calls otherwise where their values are checked; argparse itself checks --target."""

EXPECTED = ": expected "


def options_of(parser: argparse.ArgumentParser) -> dict[str, str]:
    """The long option of every destination; positional arguments have none."""
    return {action.dest: max(action.option_strings, key=len) for action in parser._actions if action.option_strings}


def worded(message: str, options: Mapping[str, str], args: argparse.Namespace | None) -> str:
    """The message, in which the option that it is about, and those that it advises, are as typed.

    Replaced are: the name that it begins with; behind a path that of a reader option that is given; `name=` of a
    reader option in what is expected or advised; and the names of options that a format doesn't take. The keys of a
    scene.toml stay, unless the option is given.
    """
    head, found, rest = message.partition(EXPECTED)
    if not found:
        return message
    before, colon, name = head.rpartition(": ")
    plain = name.removeprefix("transfer ")
    of_file = bool(colon) or plain != name or str(getattr(args, "source", "")).endswith(".toml")
    plain = plain if colon else OTHER_NAMES.get(plain, plain)
    given = getattr(args, plain, None) is not None
    if plain in options and (given or not of_file) and (not colon or plain in READING):
        head = before + colon + options[plain]
    reading = "|".join(name for name in READING if name in options)
    if not reading:
        return head + found + rest
    rest = re.sub(rf"(?<![\w.'-])({reading})=(?=\S)", lambda match: f"{options[match[1]]} ", rest)
    if colon and name == "options":
        rest = re.sub(rf"(?<![\w.'-])({reading})(?=[, ]|$)", lambda match: options[match[1]], rest)
    return head + found + rest


def nearest(word: str, known: Iterable[str]) -> str:
    """` (did you mean …?)`, or nothing if no known word is near."""
    found = get_close_matches(word.partition("=")[0], list(known), n=1)
    return f" (did you mean {found[0]}?)" if found else ""


def one_line(text: str) -> str:
    """The text, each character of which a terminal shows in one line; names of files hold any."""
    return "".join(letter if letter.isprintable() else "?" for letter in text)
