"""Labels: colours and opacities of segments, whose numbers are names, not amounts: nothing lies between two of them."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

import numpy as np

from splatgl.data.errors import expected
from splatgl.data.volume import Label, Volume
from splatgl.splat.classification.colormap import colormap

# (number, "#rrggbb", opacity), ascending
Shown = Sequence[tuple[int, str, float]]

# opacity of a label, per reference length
SOLID = 0.99
# most numbers that a volume without a table of labels may have
MOST_LABELS = 4096
# colours of labels without one, which differ in hue and lightness; beyond, turned hues
COLORS = (
    *("#e0a48c", "#7fb069", "#5aa9e6", "#f2c14e", "#b388eb", "#e4572e", "#2ec4b6", "#f48fb1", "#a1887f", "#90a4ae"),
    *("#c0ca33", "#3f6fb5", "#d4a017", "#8d5a97", "#4caf50", "#ff8a65", "#00a6a6", "#b0413e", "#6d9dc5", "#f0e442"),
)
# turn of the hue from one round of COLORS to the next: the golden ratio's
TURN = 0.618034


def color_of(number: int) -> str:
    """The colour of a label that has none: the same in every file."""
    turn, place = divmod(abs(number) - 1, len(COLORS))
    if turn == 0:
        return COLORS[place]
    red, green, blue = (int(COLORS[place][k : k + 2], 16) for k in (1, 3, 5))
    angle = 2 * np.pi * (turn * TURN % 1.0)
    # a rotation about the grey axis
    c, s = float(np.cos(angle)), float(np.sin(angle)) / 3**0.5
    rows = np.full((3, 3), (1 - c) / 3) + c * np.eye(3) + s * np.array([[0, -1, 1], [1, 0, -1], [-1, 1, 0]])
    turned = np.clip(rows @ [red, green, blue], 0, 255).round().astype(int)
    return "#{:02x}{:02x}{:02x}".format(*turned.tolist())


def labels_of(volume: Volume) -> tuple[Label, ...]:
    """The labels of a volume: those of its table, else all numbers but 0. Raises InputError for what is no number of a
    label, or for too many.
    """
    if volume.labels:
        return volume.labels
    if volume.samples.dtype.kind not in "bui":
        raise expected(volume.name or "labels", "whole numbers", volume.samples.dtype.name)
    found = np.zeros(0, np.int64)
    for slab in volume.slabs(16, halo=0):
        found = np.union1d(found, np.unique(slab.samples))
        if len(found) > MOST_LABELS:
            raise expected(volume.name or "labels", f"at most {MOST_LABELS} labels", "more", "is it a segmentation?")
    return tuple(Label(int(number)) for number in found if number != 0)


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
    named = ((table[number], factor) for number, factor in chosen)
    return checked_labels(
        [(each.number, each.color or color_of(each.number), SOLID * each.opacity * factor) for each, factor in named]
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
    return _looked_up(labels, values, np.array([[opacity] for _, _, opacity in labels]))[..., 0]


def label_color(labels: Shown, values: np.ndarray) -> np.ndarray:
    """Linear RGB, float64 [..., 3]."""
    return _looked_up(labels, values, np.array([colormap(color)[0] for _, color, _ in labels]))


def _looked_up(labels: Shown, values: np.ndarray, table: np.ndarray) -> np.ndarray:
    numbers = np.array([number for number, _, _ in labels], np.float64)
    place = np.minimum(np.searchsorted(numbers, values), len(numbers) - 1)
    return np.where((numbers[place] == values)[..., None], table[place], 0.0)
