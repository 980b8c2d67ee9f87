"""Every tag [M98 …] in Python and GLSL names an equation, table, figure or section that the paper has."""

from __future__ import annotations

import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
FILES = [*ROOT.glob("splatgl/**/*.py"), *ROOT.glob("shaders/*")]
# what the paper has: equations 1–11, one table of five rows, figures 1–14, sections 1–6 and their parts
EQUATION, FIGURE = r"(?:1[01]|[1-9])", r"(?:1[0-4]|[1-9])"
EQUATIONS, FIGURES = rf"Eqs?\. {EQUATION}((, |–){EQUATION})*", rf"Figs?\. {FIGURE}((, |–){FIGURE})*"
KNOWN = re.compile(rf"({EQUATIONS}|Table 1( rows? [1-5](–[1-5])?)?|{FIGURES}|§3\.5|§[1-6](\.[1-4])?)(?![\d.]\d)")


def tags(path: Path) -> list[str]:
    return re.findall(r"\[M98 ([^\]]+)\]", path.read_text(encoding="utf-8"))


def wrong_tags(path: Path) -> list[str]:
    """The tags of a file of which some part is not in the paper."""
    return [tag for tag in tags(path) if not all(KNOWN.match(part) for part in tag.split(" / "))]


def test_tags() -> None:
    wrong = [f"{path.relative_to(ROOT)}: [M98 {tag}]" for path in FILES for tag in wrong_tags(path)]
    assert wrong == []


def test_there_are_tags_and_the_check_can_fail(tmp_path: Path) -> None:
    assert sum(len(tags(path)) for path in FILES) > 30
    (tmp_path / "a.py").write_text("# [M98 Eq. 6] [M98 Eq. 6 / §7] [M98 Table 2] [M98 Fig. 3]")
    assert wrong_tags(tmp_path / "a.py") == ["Eq. 6 / §7", "Table 2"]
    for wrong in ("Eq. 12", "Table 2", "Table 1 row 6", "Fig. 15", "§7", "§3.6", "§4.5", "equation 3"):
        match = KNOWN.match(wrong)
        assert not match or match.end() < len(wrong)
