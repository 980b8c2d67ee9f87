"""Parses text into numbers, colours and sizes, for the command line, TOML and keywords."""

from __future__ import annotations

import argparse
from typing import Any

from splatgl.data.color import srgb_of_name


def numbers(count: int) -> Any:
    """An argparse type that parses `count` numbers separated by commas or ×, into a tuple of floats."""

    def parse(text: str) -> tuple[float, ...]:
        try:
            found = tuple(float(part) for part in text.replace("×", ",").split(","))
        except ValueError:
            found = ()
        if len(found) != count:
            raise argparse.ArgumentTypeError(f"expected {count} numbers separated by commas, got {text!r}")
        return found

    return parse


def _integers(count: int) -> Any:
    def parse(text: str) -> tuple[int, ...]:
        try:
            found = tuple(int(part) for part in text.replace("×", ",").replace("x", ",").split(","))
        except ValueError:
            found = ()
        if len(found) != count:
            raise argparse.ArgumentTypeError(f"expected {count} whole numbers separated by commas, got {text!r}")
        return found

    return parse


def _pairs(text: str) -> tuple[tuple[float, float], ...]:
    try:
        pairs = tuple((float(v), float(a)) for v, a in (part.split(":") for part in text.split(",")))
    except ValueError:
        raise argparse.ArgumentTypeError(f"expected pairs V:A separated by commas, got {text!r}") from None
    return pairs


def color_of(text: str) -> tuple[str, str]:
    """Parses CHANNEL=COLOR; the colour is returned as #rrggbb."""
    name, _, color = text.rpartition("=")
    try:
        rgb = srgb_of_name(color)
    except ValueError:
        rgb = None
    if not name or rgb is None:
        this = "CHANNEL=COLOR, a colour #rrggbb, #rgb or of a name in CSS, such as lime"
        raise argparse.ArgumentTypeError(f"expected {this}, got {text!r}")
    return name, "#{:02x}{:02x}{:02x}".format(*rgb)


def window_of(text: str) -> tuple[str, tuple[float, ...]]:
    """Parses CHANNEL=LOW,HIGH."""
    name, _, window = text.rpartition("=")
    low, high = numbers(2)(window) if name else (0.0, 0.0)
    if not low < high:
        raise argparse.ArgumentTypeError(f"expected CHANNEL=LOW,HIGH with LOW below HIGH, got {text!r}")
    return name, (low, high)


def times(text: str) -> int | slice:
    """Parses a time point, or FIRST:END:STEP as Python does."""
    try:
        parts = [int(part) if part else None for part in text.split(":")]
    except ValueError:
        parts = []
    if len(parts) == 1 and parts[0] is not None:
        return parts[0]
    if len(parts) not in (2, 3) or (len(parts) == 3 and parts[2] == 0):
        raise argparse.ArgumentTypeError(f"expected a number, or FIRST:END:STEP, got {text!r}")
    return slice(*parts)


def only_labels(text: str) -> tuple[tuple[int, float], ...]:
    """Parses N or N:A, separated by commas: labels, and factors of their opacities; none for "all"."""
    try:
        pairs = [part.partition(":") for part in text.split(",")] if text != "all" else []
        return tuple((int(number), float(factor or 1)) for number, _, factor in pairs)
    except ValueError:
        raise argparse.ArgumentTypeError(f"expected labels N or N:A separated by commas, got {text!r}") from None


def size(text: str) -> tuple[int, int]:
    """Parses WIDTHxHEIGHT, or one number for a square, into (width, height) in pixels."""
    try:
        numbers = [int(part) for part in text.lower().replace("×", "x").split("x")]
        width, height = numbers * 2 if len(numbers) == 1 else numbers
    except ValueError:
        raise argparse.ArgumentTypeError(f"expected WIDTHxHEIGHT or one number, got {text!r}") from None
    return width, height
