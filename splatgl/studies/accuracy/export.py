"""Writes an accuracy report: its text as Markdown, its numbers as CSV and JSON, and an HTML page with thumbnails."""

from __future__ import annotations

import base64
from collections.abc import Iterator, Mapping
from html import escape
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from splatgl.comparison.html_report import data_uri, heat_map, html_page, largest_difference, to_display
from splatgl.data.image import Image
from splatgl.errors import InputError
from splatgl.fileio import write_file
from splatgl.splat.settings import Settings
from splatgl.studies import tables
from splatgl.studies.accuracy.content import (
    CONVERGENCE,
    NAMES,
    OVERVIEW,
    Block,
    Diagram,
    Pictures,
    blocks,
    choices,
    number,
    rivals,
)
from splatgl.studies.accuracy.diagram import convergence, overview, picture
from splatgl.studies.accuracy.ground_truth import Subject, Truths
from splatgl.studies.accuracy.methods import EXACT, PAPER, TRUTHS, methods
from splatgl.studies.accuracy.pareto import Timing, dominance
from splatgl.studies.accuracy.sweep import Results, Row, SceneResults, Store
from splatgl.studies.tables import Heading, Table, Text

if TYPE_CHECKING:
    from splatgl.gl.renderer import Renderer


def as_markdown(results: Results, diagrams: Mapping[str, str]) -> str:
    """The whole report without images of the methods. diagrams: file names by scene."""
    parts = []
    for block in blocks(results):
        match block:
            case Diagram(scene=scene):
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


STYLE = "page.css"


def page(results: Results, diagrams: Mapping[str, bytes], strips: Mapping[str, str]) -> str:
    """The whole page. diagrams: PNG files by scene; strips: HTML of the thumbnails by scene."""
    css = files("splatgl.studies.accuracy").joinpath(STYLE).read_text(encoding="utf-8")
    title = "Error against run time: " + ", ".join(scene.name for scene in results.scenes)
    parts = [_block(block, diagrams, strips) for block in blocks(results)]
    return html_page(title, css, ["<main>", *parts, "</main>"])


def _block(block: Block, diagrams: Mapping[str, bytes], strips: Mapping[str, str]) -> str:
    match block:
        case Diagram(scene, folded):
            if scene not in diagrams:
                return ""
            data = base64.b64encode(diagrams[scene]).decode("ascii")
            image = f'<img class="diagram" alt="{escape(scene)}" src="data:image/png;base64,{data}">'
            return f"<details><summary>All methods, against each truth</summary>{image}</details>" if folded else image
        case Pictures(scene):
            return strips.get(scene, "")
        case _:
            return block.html()


PAGE = "report.html"


def publish(results: Results, store: Store, folder: Path, strips: Mapping[str, str]) -> list[str]:
    """Writes all possible files; returns a line about them, and a line about missing files."""
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
        write_file(folder / name, data)
    others = ", ".join(name for name in written if name != PAGE)
    return [f"{folder / PAGE}: {len(results.scenes)} scenes; beside it {others}", *left_out]


def _diagrams(results: Results) -> dict[str, bytes]:
    """All diagrams as PNG and SVG by file name."""
    diagrams = {scene.name: picture(scene, results.head) for scene in results.scenes}
    diagrams |= {f"{s.name}{OVERVIEW}": overview(s, results.head) for s in results.scenes if choices(s)}
    if results.convergence:
        diagrams[CONVERGENCE] = convergence(results.convergence, results.head)
    return {name + suffix: data for name, files in diagrams.items() for suffix, data in files.items()}


# methods with thumbnails, if drawn
PREVIEW = "preview 1/2"
SPLATS = (PAPER, "grid", "ray", EXACT, "no antialiasing", "2×2", "4×4", PREVIEW)
SHOWN = (*SPLATS, "sheets 3", "post b-spline", "post b-spline 2×2")
# percentile of the worst method's differences shown as the brightest
BRIGHTEST = 99.5
COMPARED = ("reference", "sampled", "field")
# images up to this many pixels a side are enlarged on the page
SQUARES = 128


def strip(renderer: Renderer, subject: Subject, scene: SceneResults, truths: Truths) -> str:
    """HTML of thumbnails, the truths first: a column per method with its image and its difference from each truth.

    The methods draw again; the images are bitwise identical.
    """
    rows = {name: row for name in SHOWN if (row := scene.row(name)) is not None and not row.omitted}
    drawn: dict[str, Image] = {}
    differences: dict[tuple[str, str], np.ndarray] = {}
    for name, row in rows.items():
        splats, settings = subject.inputs(methods()[name])
        drawn[name] = renderer.render(splats, subject.camera, settings)
        for truth in COMPARED:
            if truth in row.errors:
                differences[name, truth] = largest_difference(drawn[name], truths.get(truth, settings))
    scales = {t: _scale([d for (name, of), d in differences.items() if of == t and name != PREVIEW]) for t in COMPARED}
    peak = max((float(image.pixels.max()) for image in drawn.values()), default=1.0) or 1.0
    peak = peak if subject.settings.blend == "xray" else 1.0
    columns = [_column(name, to_display(right, peak), {}) for name, right in _truth(truths, subject.settings)]
    for name in rows:
        heats = {t: heat_map(differences[name, t], scales[t]) for t in COMPARED if (name, t) in differences}
        columns.append(_column(name, to_display(drawn[name], peak), heats))
    legend = "; ".join(
        f"{NAMES[truth]}: black is none, pale {number(scales[truth])} and more"
        for truth in COMPARED
        if any(of == truth for _, of in differences)
    )
    kind = "strip squares" if max(subject.camera.size) <= SQUARES else "strip"
    head = f"<h3>Pictures, and their differences on one scale ({legend})</h3>"
    return f'{head}<div class="{kind}">{"".join(columns)}</div>'


def _column(name: str, shown: np.ndarray, heats: Mapping[str, np.ndarray]) -> str:
    pictures = [f'<img alt="{escape(name)}" src="{data_uri(shown)}">']
    for truth, heat in heats.items():
        pictures.append(f'<img alt="difference, {NAMES[truth]}" src="{data_uri(heat)}"><i>{NAMES[truth]}</i>')
    return f"<figure><figcaption>{escape(name)}</figcaption>{''.join(pictures)}</figure>"


def _truth(truths: Truths, settings: Settings) -> Iterator[tuple[str, Image]]:
    """(name, image) of the sampled truth and of the field, if any."""
    for truth, name in (("sampled", "sampled truth"), ("field", "the field")):
        try:
            yield name, truths.get(truth, settings)
        except InputError:
            continue


def _scale(differences: list[np.ndarray]) -> float:
    return max((float(np.percentile(d, BRIGHTEST)) for d in differences), default=0.0) or 1.0
