"""Labels: colours and opacities of segments, whose numbers are names, not amounts: nothing lies between two of them."""

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import numpy as np

from splatgl.data.color import linear_from_srgb
from splatgl.data.volume import Label, Volume
from splatgl.errors import expected

# (number, "#rrggbb", opacity), ascending
Shown = Sequence[tuple[int, str, float]]

# opacity of a label, per reference length
SOLID = 0.99
# most numbers that a volume without a table of labels may have: a list of them takes seconds
MOST_LABELS = 1 << 20
# colours of labels without one, which differ in hue and lightness; beyond, turned hues
COLORS = (
    *("#e0a48c", "#7fb069", "#5aa9e6", "#f2c14e", "#b388eb", "#e4572e", "#2ec4b6", "#f48fb1", "#a1887f", "#90a4ae"),
    *("#c0ca33", "#3f6fb5", "#d4a017", "#8d5a97", "#4caf50", "#ff8a65", "#00a6a6", "#b0413e", "#6d9dc5", "#f0e442"),
)
# turn of the hue from one round of COLORS to the next: the golden ratio's
TURN = 0.618034
# turns after which hues repeat, so that those of numbers of 64 bits have digits left
TURNS = 1_000_003


def color_of(number: int) -> str:
    """The colour of a label that has none: the same in every file."""
    return colors_of([number])[0]


def colors_of(numbers: Sequence[int]) -> list[str]:
    """The colours of labels that have none."""
    turns, places = zip(*(divmod(abs(number) - 1, len(COLORS)) for number in numbers), strict=True)
    rgb = np.array([[int(COLORS[place][k : k + 2], 16) for k in (1, 3, 5)] for place in places], np.float64)
    angle = 2 * np.pi * (np.array([turn % TURNS for turn in turns]) * TURN % 1.0)
    # a rotation about the grey axis
    c, s = np.cos(angle)[:, None], np.sin(angle)[:, None] / 3**0.5
    around = rgb[:, [1, 2, 0]] - rgb[:, [2, 0, 1]]
    turned = c * rgb + (1 - c) * rgb.mean(axis=1, keepdims=True) - s * around
    whole = np.clip(turned, 0, 255).round().astype(int).tolist()
    return ["#{:02x}{:02x}{:02x}".format(*row) for row in whole]


def labels_of(volume: Volume) -> tuple[Label, ...]:
    """The labels of a volume: those of its table, else all numbers but 0. Raises InputError for what is no number of a
    label, or for too many.
    """
    if volume.labels:
        return volume.labels
    found: np.ndarray = np.zeros(0, volume.samples.dtype)
    for slab in volume.slabs(16, halo=0):
        there = np.unique(slab.samples)
        if there.dtype.kind == "f":
            there = there[np.isfinite(there)]
            if (there != np.rint(there)).any():
                raise expected(volume.name or "labels", "whole numbers", volume.samples.dtype.name)
        found = np.union1d(found, there)
        if len(found) > MOST_LABELS:
            raise expected(volume.name or "labels", f"at most {MOST_LABELS} labels", "more", "is it a segmentation?")
    return tuple(Label(number) for number in map(int, found.tolist()) if number)


def shown_labels(labels: Sequence[Label], only: Sequence[tuple[int, float]] | None = None) -> Shown:
    """Colours and opacities of labels. only: numbers of those that are shown, hidden ones too, and factors of their
    opacities. Raises InputError for a number that there is not.
    """
    table = {label.number: label for label in labels}
    chosen = [(each.number, float(not each.hidden)) for each in labels] if only is None else list(only)
    for number, _ in chosen:
        if number not in table:
            known = [str(label.number) for label in labels[:20]]
            raise expected("only_labels", f"some of {', '.join(known)}{', …' * (len(table) > 20)}", number)
    bare = [number for number, _ in chosen if not table[number].color]
    colors = dict(zip(bare, colors_of(bare), strict=True)) if bare else {}
    named = ((table[number], factor) for number, factor in chosen)
    return checked_labels(
        [(each.number, each.color or colors[each.number], SOLID * each.opacity * factor) for each, factor in named]
    )


def checked_labels(labels: Any) -> Shown:
    """Labels in the order of their numbers; InputError for anything else than triples of them."""
    found = []
    for entry in labels:
        match entry:
            case [int() | np.integer() as number, str() as color, int() | float() as opacity] if re.fullmatch(
                "#[0-9a-fA-F]{6}", color
            ):
                found.append((int(number), color, float(opacity)))
            case _:
                raise expected("labels", '(number, "#rrggbb", opacity) of each', repr(entry))
    if not all(0 <= opacity <= 1 for _, _, opacity in found):
        raise expected("labels", "opacities from 0 to 1", [opacity for _, _, opacity in found])
    if len({number for number, _, _ in found}) < len(found):
        raise expected("labels", "each number once", [number for number, _, _ in found])
    return tuple(sorted(found))


def label_opacity(labels: Shown, values: np.ndarray) -> np.ndarray:
    """Opacities, float64, the shape of values: 0 of what is no label."""
    return _looked_up(labels, values, 0)


def label_color(labels: Shown, values: np.ndarray) -> np.ndarray:
    """Linear RGB, float64 [..., 3]."""
    return _looked_up(labels, values, 1)


def label_place(labels: Shown, values: np.ndarray) -> np.ndarray:
    """Places of values in `labels`, from 1 on, float64; 0 of what is no label."""
    return _looked_up(labels, values, 2)


def _looked_up(labels: Shown, values: np.ndarray, column: int) -> np.ndarray:
    numbers, *columns = _table(tuple(labels), values.dtype.kind in "bui")
    values = values.astype(numbers.dtype, copy=False)
    place = np.minimum(np.searchsorted(numbers, values), len(numbers) - 1)
    same, table = numbers[place] == values, columns[column]
    return np.where(same[..., None] if table.ndim > 1 else same, table[place], 0.0)


@lru_cache(maxsize=8)
def _table(labels: Shown, whole: bool) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Numbers in ascending order, opacities, linear RGB, and places in `labels` from 1 on. whole: of 64 bits, as
    float64 does not hold them all; those that are unsigned wrap around, as values do.
    """
    named = [number for number, _, _ in labels]
    numbers = np.array(named, object).astype(np.uint64 if min(named) >= 0 else np.int64).astype(np.int64)
    numbers = numbers if whole else np.array(named, np.float64)
    order = np.argsort(numbers, kind="stable")
    opacities = np.array([opacity for _, _, opacity in labels])
    srgb = np.array([[int(color[k : k + 2], 16) for k in (1, 3, 5)] for _, color, _ in labels])
    return numbers[order], opacities[order], linear_from_srgb(np.arange(256) / 255)[srgb[order]], order + 1
