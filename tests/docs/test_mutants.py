"""scripts/mutants.py: its list fits the code and the tests, and it tells what it must."""

from __future__ import annotations

import re
import sys
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "scripts"))
import mutants
from mutants import MUTANTS, Mutant

from tests.helpers.marks import mark_later, mark_long

ROOT = Path(__file__).parents[2]
# folders of what computes, but of those that scripts/test does not try; least numbers of files, and of shaders
ROOMS = {path.parent.name for path in ROOT.glob("splatgl/*/__init__.py")} - {"integrations"}
LEAST, LEAST_SHADERS = 60, 10


@pytest.mark.parametrize("mutant", MUTANTS, ids=lambda each: each.file)
def test_a_mutant_stands_in_its_file(mutant: Mutant) -> None:
    """Its text stands there once, and its test is there; so the list stays true where code moves."""
    assert (ROOT / mutant.file).read_text("utf-8").count(mutant.text) == 1, mutant
    assert mutant.replacement != mutant.text
    file, name = re.fullmatch(r"(tests/\w+/test_\w+\.py)::(\w+)(?:\[.+\])?", mutant.test).groups()  # type: ignore[union-attr]
    assert re.search(rf"^def {name}\(", (ROOT / file).read_text("utf-8"), re.MULTILINE), mutant.test


def test_tests_of_mutants_are_quick(are_long: dict[str, bool]) -> None:
    """Of the files that are collected each named case is there, and runs in `scripts/test`."""
    files = {each.split("::")[0] for each in are_long}
    named = {each.test for each in MUTANTS if each.test.split("::")[0] in files}
    assert sorted(each for each in named if are_long.get(each, True)) == []


def test_what_computes_has_mutants() -> None:
    files = [each.file for each in MUTANTS]
    assert len({(each.file, each.text) for each in MUTANTS}) == len(MUTANTS) and len(set(files)) >= LEAST
    assert {file.split("/")[1] for file in files if file.startswith("splatgl/")} == ROOMS
    assert sum(file.startswith("shaders/") for file in files) >= LEAST_SHADERS


class Today:
    """Stands in for the date."""

    number = 0

    @classmethod
    def today(cls) -> Any:
        return cls

    @classmethod
    def toordinal(cls) -> int:
        return cls.number


def test_all_have_their_turn(monkeypatch: pytest.MonkeyPatch) -> None:
    """Within as many days as there are turns, each once."""
    tried: list[Mutant] = []
    monkeypatch.setattr(mutants.datetime, "date", Today)
    monkeypatch.setattr(mutants, "try_all", lambda chosen: tried.extend(chosen) or 0)
    for Today.number in range(mutants.TURNS):
        assert mutants.main(["--turn"]) == 0
    assert sorted(tried) == sorted(MUTANTS)


@dataclass(eq=False)
class Case:
    """Stands in for a case of a test, with its marks."""

    nodeid: str
    marks: dict[str, pytest.Mark]

    def get_closest_marker(self, name: str) -> pytest.Mark | None:
        return self.marks.get(name)

    def add_marker(self, name: str) -> None:
        self.marks[name] = getattr(pytest.mark, name).mark


def test_long_cases_take_turns(monkeypatch: pytest.MonkeyPatch) -> None:
    """Within three days each long case once, and the quick ones each day."""
    monkeypatch.setattr(mutants.datetime, "date", Today)
    marks = {"few": pytest.mark.few(2).mark, "turns": pytest.mark.turns(3).mark}
    runs = Counter[str]()
    for Today.number in range(3):
        cases = [Case(f"test_drawn[{n}]", dict(marks)) for n in range(12)]
        mark_long(cases)  # type: ignore[arg-type]
        mark_later(cases)  # type: ignore[arg-type]
        runs.update(case.nodeid for case in cases if "later" not in case.marks)
    assert sorted(runs.values()) == [1] * 10 + [3] * 2


@pytest.mark.long
def test_survivors_and_tests_that_tell_nothing_fail(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A harmless line survives; a test that does not pass unbroken, or that could not run, tells nothing."""
    killed = next(each for each in MUTANTS if each.file == "splatgl/data/color.py")
    harmless = killed._replace(replacement=f"{killed.text} ")
    missing = killed._replace(test=killed.test.split("::")[0] + "::test_nothing")
    unreadable = killed._replace(replacement="(")
    shader = next(each for each in MUTANTS if each.file == "shaders/quads.glsl")._replace(replacement="(")
    for mutant, code, told in (
        (killed, 0, "killed"),
        (harmless, 1, "SURVIVES"),
        (missing, 2, "ERROR: not found"),
        (unreadable, 2, "ended with 4"),
        (shader, 2, "GLSL Compiler failed"),
    ):
        monkeypatch.setattr(mutants, "MUTANTS", (mutant,))
        assert mutants.main([]) == code
        out, error = capsys.readouterr()
        assert told in out + error
