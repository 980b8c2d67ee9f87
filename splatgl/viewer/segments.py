"""Segments of a layer: names, edits of their looks, and boxes of their voxels."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import product
from typing import Any

import numpy as np

from splatgl.data.volume import Label, Volume
from splatgl.transfer.colormaps import labels_of, select_labels
from splatgl.viewer.state import LayerStyle

# planes that are searched at a time
SLAB = 16


@dataclass(frozen=True)
class Segment:
    """A segment and its look. color: "#rrggbb"; opacity: per length of a voxel."""

    number: int
    name: str
    color: str
    opacity: float


def style_with_segments(style: LayerStyle, volume: Volume, transfer: Mapping[str, Any]) -> LayerStyle:
    """The style with all segments of a volume, and their names; those that its transfer function leaves out or makes
    clear are hidden, with the opacity to show them in. transfer: options of the transfer function.
    """
    stated = style.base.labels
    if not stated:
        return style
    drawn = {number: (number, color, opacity) for number, color, opacity in stated if opacity > 0}
    # others than the chosen ones
    table = volume.labels or (labels_of(volume) if "only_labels" in transfer else ())
    known = {label.number: replace(label, hidden=False, opacity=label.opacity or 1.0) for label in table}
    # numbers of a scene's own that the volume's table has not
    known |= {number: Label(number, color=color) for number, color, _ in stated if number not in known}
    colors = {number: color for number, color, _ in stated}
    looks = {
        number: (number, colors.get(number, color), opacity)
        for number, color, opacity in select_labels(tuple(known.values()))
    }
    labels = tuple((looks | drawn).values())
    base = replace(style.base, labels=labels) if set(labels) != set(stated) else style.base
    # a saved scene has the names of a table, too
    listed = [(label.number, label.name) for label in table if label.name] if transfer.get("names") else []
    chosen = {int(number): str(name) for number, name in (*listed, *transfer.get("name_of", ()))}
    names = tuple((number, name) for number, name in sorted(chosen.items()) if number in looks)
    return replace(style, base=base, hidden=frozenset(looks.keys() - drawn.keys()), names=names)


@lru_cache(maxsize=8)
def list_segments(
    labels: tuple[tuple[int, str, float], ...],
    table: tuple[Label, ...] | None,
    chosen: tuple[tuple[int, str], ...] = (),
) -> tuple[Segment, ...]:
    """The segments of a transfer function's labels. table: names of the volume's segments; chosen: names instead."""
    names = {**{label.number: label.name for label in table or ()}, **dict(chosen)}
    return tuple(
        Segment(number, names.get(number) or f"segment {number}", color, opacity) for number, color, opacity in labels
    )


def find_segments(text: str, segments: tuple[Segment, ...]) -> tuple[Segment, ...]:
    """The segments whose names hold all words of a text, and that of the number that it is."""
    words = text.lower().split()
    if not words:
        return segments
    return tuple(
        segment
        for segment in segments
        if all(word in segment.name.lower() for word in words) or words == [str(segment.number)]
    )


def segment_name(style: LayerStyle, volume: Volume, value: float) -> str:
    """The name of the segment that a value of a layer numbers; "" if it has none."""
    names = (*style.names, *((label.number, label.name) for label in volume.labels or ()))
    return next((name for number, name in names if number == value), "")


def value_text(style: LayerStyle, volume: Volume, value: float, index: Sequence[int]) -> str:
    """A value of a layer, and the name of its segment, its unit or, of colours, the red, green and blue of a voxel.
    index: of the voxel, (x, y, z).
    """
    more = segment_name(style, volume, value) or volume.value_unit
    if isinstance(volume.color, np.ndarray):
        more = "of rgb " + ", ".join(map(str, volume.color[tuple(index)[::-1]]))
    return f"{value:.6g} {more}".rstrip()


def with_name(style: LayerStyle, number: int, name: str) -> LayerStyle:
    """The style with another name of a segment; "": the file's."""
    names = {**dict(style.names), number: name.strip()}
    return replace(style, names=tuple((number, name) for number, name in sorted(names.items()) if name))


def with_look(style: LayerStyle, number: int, color: str, opacity: float) -> LayerStyle:
    """The style with another look of a segment."""
    labels = tuple((number, color, opacity) if entry[0] == number else entry for entry in style.base.labels)
    return replace(style, base=replace(style.base, labels=labels))


def with_shown(style: LayerStyle, numbers: Collection[int], are_shown: bool) -> LayerStyle:
    """The style with segments shown or hidden."""
    return replace(style, hidden=style.hidden - set(numbers) if are_shown else style.hidden | set(numbers))


def with_only(style: LayerStyle, number: int) -> LayerStyle:
    """The style with one segment shown, and all others hidden."""
    return replace(style, hidden=frozenset(other for other, _, _ in style.base.labels) - {number})


def segment_corners(volume: Volume, number: int) -> np.ndarray | None:
    """Corners [8, 3], world units, of the box around the voxels of a segment; None if it has none."""
    flat = [np.zeros(size, bool) for size in volume.shape]
    for slab in volume.slabs(SLAB, halo=0):
        inside = slab.samples == number
        flat[0][slab.start : slab.stop] = inside.any(axis=(1, 2))
        across = inside.any(axis=0)
        flat[1] |= across.any(axis=1)
        flat[2] |= across.any(axis=0)
    if not flat[0].any():
        return None
    ends = [(np.flatnonzero(axis)[0] - 0.5, np.flatnonzero(axis)[-1] + 0.5) for axis in reversed(flat)]
    return np.array(list(product(*ends))) @ volume.world_from_index.T + np.asarray(volume.origin)
