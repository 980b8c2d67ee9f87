"""What TIFF files say of their channels and time points: OME-XML, and ImageJ's metadata."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any
from xml.etree.ElementTree import Element

from splatgl.data.readers.several import SECONDS, Channel, Several, rgb_of, window_of

WHITE = "#ffffff"
# ImageJ's colours of a composite without lookup tables, which it leaves out of its files
COMPOSITE = ("#ff0000", "#00ff00", "#0000ff", WHITE, "#00ffff", "#ff00ff", "#ffff00")


def several(tiff: Any, pixels: Element | None, axes: str, shape: tuple[int, ...]) -> Several:
    """The channels and time points of an image of those axes. pixels: OME's element of it."""
    sizes = dict(zip(axes, shape, strict=True))
    count, times = sizes.get("C", 1), sizes.get("T", 1)
    if pixels is not None:
        found = _of_ome(pixels, count, times)
    elif tiff.imagej_metadata:
        found = _of_imagej(tiff.imagej_metadata, count, times)
    else:
        found = Several(tuple(Channel(str(n)) for n in range(count)), times=times)
    return replace(found, components=sizes.get("S", 1))


def _of_ome(pixels: Element, count: int, times: int) -> Several:
    """Colours are signed numbers of 32 bits, RGBA; times are seconds unless said otherwise."""
    nodes = [node for node in pixels if node.tag.endswith("}Channel")][:count]
    found = [Channel(node.get("Name") or str(n), _ome_color(node.get("Color"))) for n, node in enumerate(nodes)]
    found += [Channel(str(n)) for n in range(len(found), count)]
    together = count > 1 and any(each.color for each in found)
    step = _positive(pixels.get("TimeIncrement")) * SECONDS.get(pixels.get("TimeIncrementUnit", "s"), 0.0)
    return Several(tuple(found), together, times, step or None)


def _ome_color(text: str | None) -> str | None:
    try:
        number = int(text or "") & 0xFFFFFFFF
    except ValueError:
        return None
    return rgb_of([number >> 24, number >> 16, number >> 8])


def _of_imagej(metadata: Mapping[str, Any], count: int, times: int) -> Several:
    """Colours are the ends of lookup tables, windows the display ranges."""
    tables, ranges = metadata.get("LUTs", ()), metadata.get("Ranges", ())
    labels, composite = _labels(metadata.get("Labels", ()), count), metadata.get("mode") == "composite"
    usual = dict(enumerate(COMPOSITE)) if composite and not len(tables) else {}
    found = []
    for n in range(count):
        color = rgb_of([int(row[-1]) for row in tables[n]]) if n < len(tables) and len(tables[n]) == 3 else usual.get(n)
        window = window_of(*ranges[2 * n : 2 * n + 2]) if len(ranges) >= 2 * n + 2 else None
        found.append(Channel(labels[n], color, window))
    together = count > 1 and (composite or any(each.color not in (None, WHITE) for each in found))
    return Several(tuple(found), together, times, _positive(metadata.get("finterval")) or None)


def _labels(told: Any, count: int) -> list[str]:
    """Names of channels: the planes' labels, where each channel has its own on all its planes; else numbers."""
    texts = [str(text).strip() for text in told] if isinstance(told, list | tuple) else []
    names = texts[:count]
    # channels vary fastest over the planes
    same = all(text == names[n % count] for n, text in enumerate(texts))
    return names if same and len(set(names) - {""}) == count else [str(n) for n in range(count)]


def _positive(text: object) -> float:
    """A positive, finite number; 0 for anything else."""
    try:
        number = float(str(text))
    except ValueError:
        return 0.0
    return number if math.isfinite(number) and number > 0 else 0.0
