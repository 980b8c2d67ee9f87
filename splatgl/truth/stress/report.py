"""The suite's results as a table for a terminal, CSV, JSON and Markdown."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from textwrap import fill

import numpy as np

from splatgl.truth import table_io
from splatgl.truth.stress.case import Case, Check, Result

# widths of the table's columns in characters: 97 with the spaces between them
WIDTHS = (18, 24, 9, 9, 8, 8, 8, 6)
HEAD = ("case", "what", "right", "found", "error", "bound", "paper's", "")
# page width in characters
PAGE = 96
FIELDS = ("case", "what", "right", "found", "error", "bound", "relative", "paper", "paper_error", "kept")


def heading() -> str:
    """The names of the columns."""
    return _line(HEAD)


def line(result: Result) -> str:
    """One line per case, with the check nearest to its bound, or farthest over it."""
    return _check_line(result.case.name, result.worst, result.ok)


def lines(result: Result) -> str:
    """All checks of a case, a line each."""
    return "\n".join(_check_line(result.case.name, each, each.ok) for each in result.checks)


def verdict(results: Sequence[Result]) -> str:
    """Number of cases within their bounds, and the names of the others."""
    broken = [result for result in results if not result.ok]
    pictures, bad = (sum(getattr(result, name) for result in results) for name in ("pictures", "bad_pixels"))
    seconds = sum(result.seconds for result in results)
    parts = [
        f"{len(results) - len(broken)} of {len(results)} cases keep their bounds; {pictures} pictures, "
        f"{bad} values in them not finite; {seconds:.0f} s"
    ]
    for result in broken:
        checks = "; ".join(each.what for each in result.checks if not each.ok)
        bad = f"{result.bad_pixels} values not finite" if result.bad_pixels else ""
        parts.append(f"broken: {result.case.name}: {'; '.join(filter(None, (checks, bad)))}")
    return "\n".join(fill(part, PAGE) for part in parts)


def about(case: Case) -> str:
    """Description of a case."""
    parts = ((case.name, case.stresses), ("how", case.how), ("right", case.right))
    return "\n".join(fill(f"{name}: {text}", PAGE, subsequent_indent="  ") for name, text in parts)


def as_csv(results: Iterable[Result]) -> str:
    """A header, and a line per check."""
    return table_io.as_csv(FIELDS, (_row(result, each) for result in results for each in result.checks))


def as_json(results: Sequence[Result], renderer: str) -> str:
    """Everything, by case."""
    cases = [
        {
            "name": result.case.name,
            "stresses": result.case.stresses,
            "how": result.case.how,
            "right": result.case.right,
            "kept": result.ok,
            "pictures": result.pictures,
            "not_finite": result.bad_pixels,
            "seconds": round(result.seconds, 3),
            "checks": [_row(result, each) for each in result.checks],
        }
        for result in results
    ]
    return table_io.as_json({"renderer": renderer, "cases": cases})


def as_markdown(results: Sequence[Result], renderer: str) -> str:
    """A table of all cases, each with the check nearest to its bound, and a summary line."""
    lines = []
    for result in results:
        worst = result.worst
        error, bound = (_error(value, worst.relative) for value in (worst.error, worst.bound))
        paper = "" if worst.paper_error is None else _error(worst.paper_error, worst.relative)
        shown = error if result.ok else f"**{error}**"
        lines.append((f"`{result.case.name}`", result.case.stresses, shown, bound, paper))
    table = table_io.as_markdown(("case", "what is extreme", "error", "bound", "paper's"), lines)
    return f"{table}\n\n{verdict(results)}. Drawn by {renderer}.\n"


def _check_line(name: str, each: Check, ok: bool) -> str:
    paper = "" if each.paper_error is None else _error(each.paper_error, each.relative)
    cells = (
        name,
        each.what,
        _number(each.right),
        _number(each.found),
        _error(each.error, each.relative),
        _error(each.bound, each.relative),
        paper,
        "ok" if ok else "BROKEN",
    )
    return _line(cells)


def _line(cells: Sequence[str]) -> str:
    parts = []
    for n, (cell, width) in enumerate(zip(cells, WIDTHS, strict=True)):
        cut = cell if len(cell) <= width else cell[: width - 1] + "…"
        parts.append(cut.ljust(width) if n < 2 or n == len(WIDTHS) - 1 else cut.rjust(width))
    return " ".join(parts).rstrip()


def _number(value: float) -> str:
    return f"{value:.4g}"


def _error(value: float, relative: bool) -> str:
    if np.isinf(value):
        return "∞"
    if not relative:
        return f"{value:.2g}"
    return f"{100 * value:.2g}%" if value < 0.1 else f"{100 * value:.0f}%"


def _row(result: Result, each: Check) -> dict[str, object]:
    values = (
        result.case.name,
        each.what,
        each.right,
        each.found,
        each.error,
        each.bound,
        each.relative,
        each.paper,
        each.paper_error,
        each.ok,
    )
    return dict(zip(FIELDS, values, strict=True))
