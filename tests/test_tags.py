"""Every tag [M98 …] in Python and GLSL names an equation, table, figure or section that the paper has."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
FILES = [*ROOT.glob("splatgl/**/*.py"), *ROOT.glob("shaders/*")]
# what the paper has: equations 1–11, one table of five rows, figures 1–14, sections 1–6
EQUATION, FIGURE = r"(?:1[01]|[1-9])", r"(?:1[0-4]|[1-9])"
EQUATIONS, FIGURES = rf"Eqs?\. {EQUATION}((, |–){EQUATION})*", rf"Figs?\. {FIGURE}((, |–){FIGURE})*"
KNOWN = re.compile(rf"({EQUATIONS}|Table 1( rows? [1-5](–[1-5])?)?|{FIGURES}|§[1-6](\.[1-4])?)(?![\d.]\d)")


def tags(path: Path) -> list[str]:
    return re.findall(r"\[M98 ([^\]]+)\]", path.read_text(encoding="utf-8"))


@pytest.mark.parametrize("path", FILES, ids=lambda p: str(p.relative_to(ROOT)))
def test_tags(path: Path) -> None:
    for tag in tags(path):
        for part in tag.split(" / "):
            assert KNOWN.match(part), f"[M98 {tag}]"


def test_there_are_tags_and_the_check_can_fail() -> None:
    assert sum(len(tags(path)) for path in FILES) > 30
    for wrong in ("Eq. 12", "Table 2", "Table 1 row 6", "Fig. 15", "§7", "equation 3"):
        match = KNOWN.match(wrong)
        assert not match or match.end() < len(wrong)
