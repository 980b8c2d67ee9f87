"""scripts/mutants.py: its list fits the code and the tests, and it tells what it must."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import Any

import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "scripts"))
import mutants
from mutants import MUTANTS, Mutant

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


def test_all_have_their_turn(monkeypatch: pytest.MonkeyPatch) -> None:
    """Within as many days as there are turns, each once."""
    tried: list[Mutant] = []

    class Today:
        number = 0

        @classmethod
        def today(cls) -> Any:
            return cls

        @classmethod
        def toordinal(cls) -> int:
            return cls.number

    monkeypatch.setattr(mutants.datetime, "date", Today)
    monkeypatch.setattr(mutants, "try_all", lambda chosen: tried.extend(chosen) or 0)
    for Today.number in range(mutants.TURNS):
        assert mutants.main(["--turn"]) == 0
    assert sorted(tried) == sorted(MUTANTS)


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
        (missing, 2, "no tests ran"),
        (unreadable, 2, "ended with 4"),
        (shader, 2, "GLSL Compiler failed"),
    ):
        monkeypatch.setattr(mutants, "MUTANTS", (mutant,))
        assert mutants.main([]) == code
        out, error = capsys.readouterr()
        assert told in out + error
