"""Marks of cases that are not drawn each time."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

import pytest

from tests.helpers.splatting import GOLDEN

# tests, too, import what is in scripts
sys.path.insert(0, str(Path(__file__).parents[2] / "scripts"))
from mutants import MUTANTS, of_today

# tests that alone may notice a broken line
NEEDED = {mutant.test for mutant in MUTANTS}


def mark_long(items: Sequence[pytest.Item]) -> None:
    """Of a test marked few(n), all cases but n are long; these are spread over the product of its parameters, beside
    those that mutants name.
    """
    for count, found in _cases(items, "few"):
        quick = {int(len(found) * ((k + 0.5) * GOLDEN % 1)) for k in range(count)}
        for number in set(range(len(found))) - quick:
            if found[number].nodeid not in NEEDED:
                found[number].add_marker("long")


def mark_later(items: Sequence[pytest.Item]) -> None:
    """Of the long cases of a test marked turns(n), all are marked `later` but every n-th, others each day."""
    for count, found in _cases(items, "turns"):
        long = [item for item in found if item.get_closest_marker("long")]
        for item in set(long) - set(of_today(long, count)):
            item.add_marker("later")


def _cases(items: Sequence[pytest.Item], name: str) -> list[tuple[int, list[pytest.Item]]]:
    """(number that the mark states, cases) of each test that has the mark."""
    cases: dict[str, list[pytest.Item]] = {}
    counts: dict[str, int] = {}
    for item in items:
        if mark := item.get_closest_marker(name):
            test = item.nodeid.split("[")[0]
            cases.setdefault(test, []).append(item)
            (counts[test],) = mark.args
    return [(counts[test], found) for test, found in cases.items()]
