"""Numbers of a report as CSV and JSON, and its text as Markdown."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from splatgl.studies import tables
from splatgl.studies.accuracy.content import Diagram, blocks, rivals
from splatgl.studies.accuracy.methods import EXACT, TRUTHS
from splatgl.studies.accuracy.pareto import Timing, dominance
from splatgl.studies.accuracy.sweep import Results, Row, SceneResults, Store
from splatgl.studies.tables import Heading, Table, Text


def as_markdown(results: Results, diagrams: Mapping[str, str]) -> str:
    """The whole report without images of the methods. diagrams: file names by scene."""
    parts = []
    for block in blocks(results):
        match block:
            case Diagram(scene):
                parts.append(f"![error against run time: {scene}]({diagrams[scene]})" if scene in diagrams else "")
            case Heading() | Text() | Table():
                parts.append(block.markdown())
    return "\n\n".join(filter(None, parts)) + "\n"


ERRORS = ("rmse", "maximum", "p999", "share_over", "energy", "flip")
FIELDS = (
    *("scene", "axis", "method", "same_as", "omitted", "splats", "extraction"),
    *("seconds", "seconds_low", "seconds_high", "rounds", "times_exact", "times_exact_low", "times_exact_high"),
    *("tolerance", "bound"),
    *(f"{truth}_{name}" for truth in TRUTHS for name in ERRORS),
    *(f"{truth}_standing" for truth in TRUTHS),
)


def as_csv(results: Results) -> str:
    """A header, and a line per method and scene."""
    return tables.as_csv(FIELDS, (_cells(scene, row) for scene in results.scenes for row in scene.rows))


def as_json(results: Results, store: Store) -> str:
    """JSON of the head, the methods as in the CSV, the convergence, and all runs."""
    report = {
        **{name: value for name, value in results.head.items() if name != "kind"},
        "truths": TRUTHS,
        "methods": [_cells(scene, row) for scene in results.scenes for row in scene.rows],
        "convergence": results.convergence,
        "runs": store.lines,
    }
    return tables.as_json(report)


def _cells(scene: SceneResults, row: Row) -> dict[str, Any]:
    names = ("axis", "method", "same_as", "omitted", "splats", "extraction", "tolerance", "bound")
    cells: dict[str, Any] = {"scene": scene.name, **{name: getattr(row, name) for name in names}}
    reasons = [row.omitted, *(f"{name}: {why}" for name, why in row.missing.items())]
    cells["omitted"] = "; ".join(filter(None, reasons))
    exact = scene.timing(EXACT)
    if row.timing is not None:
        cells |= {**_times("seconds", row.timing), "rounds": row.timing.count}
        if exact is not None:
            cells |= _times("times_exact", row.timing.over(exact))
    for truth, errors in row.errors.items():
        cells |= {f"{truth}_{name}": errors.get(name) for name in ERRORS}
        points = rivals(truth, scene)
        point = next((point for point in points if point.name == row.method), None)
        if point is not None:
            cells[f"{truth}_standing"] = str(dominance(point, points))
    return cells


def _times(name: str, timing: Timing) -> dict[str, float]:
    return {name: timing.median, f"{name}_low": timing.low, f"{name}_high": timing.high}
