"""Settings of the tests of splats, what version 0.1 drew by default; and combinations that tests draw."""

from __future__ import annotations

import itertools
from collections.abc import Collection
from typing import Any

import splatgl as sg

# voxels classified before reconstruction, splats one by one, stretched beyond z_k
SPLATS = sg.Settings.like("0.1")

# steps of this share of a whole are spread evenly, however many there are
GOLDEN = 0.618034


def spread(count: int, *values: Collection[Any]) -> list[tuple[Any, ...]]:
    """So many of the combinations of a value each, spread over their product: all of them would take too long."""
    every = list(itertools.product(*values))
    found = [every[int(len(every) * ((k + 0.5) * GOLDEN % 1))] for k in range(count)]
    for number, each in enumerate(values):
        assert all(any(some[number] is value for some in found) for value in each), "a value is in none"
    return found


def each_two(first: Collection[Any], second: Collection[Any], third: Collection[Any]) -> list[tuple[Any, ...]]:
    """Combinations in which any two values meet; of the third there are no more than of the others."""
    assert len(third) <= min(len(first), len(second))
    places = itertools.product(enumerate(first), enumerate(second))
    return [(one, two, list(third)[(i + j) % len(third)]) for (i, one), (j, two) in places]
