"""The notebooks in scripts/notebooks run from an empty folder, and hold no output."""

from __future__ import annotations

import ast
import json
from pathlib import Path

import pytest

import splatgl as sg

FOLDER = Path(__file__).parents[2] / "scripts" / "notebooks"
NOTEBOOKS = sorted(path.name for path in FOLDER.glob("*.ipynb"))


def cells(name: str) -> list[str]:
    """The code of a notebook's cells."""
    notebook = json.loads((FOLDER / name).read_text(encoding="utf-8"))
    code = [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]
    assert not any(cell["outputs"] or cell["execution_count"] for cell in code)
    return ["".join(cell["source"]) for cell in code]


def execute(code: str, names: dict[str, object]) -> object:
    """What a cell shows: the value of its last expression, or None."""
    tree = ast.parse(code)
    last = tree.body.pop() if isinstance(tree.body[-1], ast.Expr) else None
    exec(compile(tree, "cell", "exec"), names)
    return eval(compile(ast.Expression(last.value), "cell", "eval"), names) if isinstance(last, ast.Expr) else None


@pytest.mark.long
@pytest.mark.parametrize("name", NOTEBOOKS)
def test_a_notebook_runs(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {"__name__": "__main__"}
    shown = [execute(code, names) for code in cells(name)]
    pictures = [each for each in shown if isinstance(each, sg.Image)]
    assert pictures and all(picture.pixels.any() for picture in pictures)


def test_there_are_three() -> None:
    assert len(NOTEBOOKS) == 3 and all(map(cells, NOTEBOOKS))
