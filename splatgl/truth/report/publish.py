"""Writes a report's files: CSV, JSON, diagrams, Markdown, and a self-contained HTML page."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from splatgl.errors import InputError
from splatgl.fileio import write_whole
from splatgl.truth.report.content import CONVERGENCE
from splatgl.truth.report.diagram import convergence, picture
from splatgl.truth.report.markdown import as_markdown
from splatgl.truth.report.page import page
from splatgl.truth.report.results import Results
from splatgl.truth.report.store import Store
from splatgl.truth.report.tables import as_csv, as_json
from splatgl.truth.report.thumbnails import Strip

PAGE = "report.html"


def publish(results: Results, store: Store, folder: Path, strips: Mapping[str, Strip]) -> list[str]:
    """Writes all possible files; returns a line about them, and one about files that could not be written."""
    written = {"report.csv": as_csv(results).encode(), "report.json": as_json(results, store).encode()}
    left_out = []
    try:
        written |= _diagrams(results)
    except InputError as error:
        left_out = [f"diagrams left out: {error}"]
    names = {name.removesuffix(".png"): name for name in written if name.endswith(".png")}
    written["report.md"] = as_markdown(results, names).encode()
    diagrams = {scene: written[name] for scene, name in names.items()}
    written[PAGE] = page(results, diagrams, strips).encode()
    for name, data in written.items():
        write_whole(folder / name, data)
    others = ", ".join(name for name in written if name != PAGE)
    return [f"{folder / PAGE}: {len(results.scenes)} scenes; beside it {others}", *left_out]


def _diagrams(results: Results) -> dict[str, bytes]:
    """Every diagram, as PNG and SVG, by file name."""
    drawn = {scene.name: picture(scene, results.head) for scene in results.scenes}
    if results.convergence:
        drawn[CONVERGENCE] = convergence(results.convergence, results.head)
    return {name + suffix: data for name, each in drawn.items() for suffix, data in each.items()}
