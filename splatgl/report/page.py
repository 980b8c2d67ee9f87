"""The report: an HTML page with recommendations, diagrams, pictures and tables; numbers as CSV, JSON and text."""

from __future__ import annotations

import base64
import csv
import io
from collections.abc import Collection, Iterator, Mapping, Sequence
from html import escape
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from splatgl.comparison.reports import data_uri, heat_map, html_page, html_table, largest_difference, to_display
from splatgl.data.image import Image
from splatgl.errors import InputError
from splatgl.fileio import write_file
from splatgl.report.methods import (
    AXES,
    BESIDE_EWA,
    DEFAULT,
    EWA,
    EXACT,
    PAPER,
    PAPER_FLOAT,
    PAPER_TABLE,
    TRUTHS,
    methods,
)
from splatgl.report.sweep import EffortLevel, Point, SceneResults, Timing, Truths, front

if TYPE_CHECKING:
    from splatgl.gl.renderer import Renderer


Cells = Sequence[str]


def table(columns: Cells, rows: Sequence[Cells], title: str, folded: bool = False, strong: Collection[int] = ()) -> str:
    """HTML of a table; "" without rows. title: its caption. folded: collapsed by default. strong: indices of
    highlighted rows.
    """
    if not rows:
        return ""
    classes = ["strong" if n in strong else "" for n in range(len(rows))]
    body, title = f'<div class="wide">{html_table(columns, rows, classes)}</div>', escape(title[:1].upper() + title[1:])
    if folded:
        return f"<details><summary>{title}</summary>{body}</details>"
    return f'<section class="table"><h3>{title}</h3>{body}</section>'


HOW = (
    "Each method draws the same view. Its time is the wall clock around a finished frame with its pixels read back: "
    "the median of {rounds} rounds in which every method has its turn, each round in another random order, each turn "
    "after a warm-up frame of the same method. The speed of a machine varies: reproducible are the times relative to "
    "exact, round by round. Errors are those of linear, premultiplied light over all four channels; RMSE is relative "
    "to the truth's own root mean square. The sampled truth is drawn in float32; the ray integral is sampled more "
    "coarsely, and its difference from splats of the same samples added to the sampled truth. The field is sampled as "
    "coarsely, at {rays}×{rays} rays a pixel and {steps} points a voxel. Of a scene with a formula it is the formula, "
    "so that errors are against the true picture. For other samples it is the b-spline reconstruction: methods with "
    "that kernel differ only by sheets, steps and pixels, others also by their reconstruction. Extraction is not part "
    "of a frame. A method is on the front (●) if none is as fast and more accurate, by medians."
)
AT_PIXELS = " Errors are those of {pixels} random pixels that show matter, not of all; --full compares all."
NAMES = {"reference": "drawing", "sampled": "antialiasing", "integral": "splatting", "field": "the field"}
PLAIN = {
    "reference": "an exact drawing of the same splats",
    "sampled": "the same splats at many samples a pixel",
    "integral": "light along each ray through the splats",
    "field": "the true picture",
}
# a preview errs at most this many times as much as the default, and takes less than the default by this factor
PREVIEW_ERROR, PREVIEW_TIME = 3.0, 1.5
# the best method for print errs at most this many times as much as the default
FINER = 0.8


def choices(scene: SceneResults) -> dict[str, Point]:
    """Methods that are recommended for a scene by purpose: the default, a fast one for previews, the most accurate one
    for print.

    Empty if the default was not measured. What is no better than the default is the default.
    """
    truth = scene.deciding_truth
    default = scene.point(DEFAULT, truth)
    if default is None:
        return {}
    others = [p for p in scene.rivals(truth) if p.name != DEFAULT]
    quick = [
        p
        for p in others
        if p.error <= PREVIEW_ERROR * default.error and default.time.over(p.time).median >= PREVIEW_TIME
    ]
    finer = [p for p in others if p.error < FINER * default.error]
    fastest = min(quick, key=lambda p: p.time.median, default=default)
    best = min(finer, key=lambda p: p.error, default=default)
    return {"default": default, "previews": fastest, "print": best}


def conclusion(scene: SceneResults) -> list[str]:
    """Sentences about the results; **words** are bold."""
    return [text for text in (_recommended(scene), _drawing(scene), _field(scene)) if text]


def _recommended(scene: SceneResults) -> str:
    made = choices(scene)
    if not made:
        return ""
    default = made.pop("default")
    also = "".join(f", for {purpose}, too" for purpose, point in made.items() if point.name == DEFAULT)
    others = "".join(
        f"; for {purpose} {methods()[point.name].words}: {_told(point)}"
        for purpose, point in made.items()
        if point.name != DEFAULT
    )
    off = f"Off: root mean square of the differences from {PLAIN[scene.deciding_truth]}."
    return f"**Take the default** ({_told(default)}){also}{others}. {off}"


def _told(point: Point) -> str:
    return f"{percent(point.error)} off in {milliseconds(point.time)}"


def _drawing(scene: SceneResults) -> str:
    """The error of drawing: the forms of 1998, what their table and their blending in 8 bits add, and exact splats."""
    paper, table, blending, exact = (
        scene.point(name, "reference") for name in (PAPER_FLOAT, PAPER_TABLE, PAPER, EXACT)
    )
    if not (paper and table and blending and exact and exact.error):
        return ""
    return (
        f"**Drawing**: exact errs {paper.error / exact.error:.2g} times less than the forms of 1998 (RMSE "
        f"{number(exact.error)} against {number(paper.error)}), at {exact.time.over(blending.time).median:.2g} times "
        f"their time. With tables of 8 bits these err by {number(table.error)}, and if display values are blended in 8 "
        f"bits, too, by {number(blending.error)}, which is measured against blending those in float64."
    )


def _field(scene: SceneResults) -> str:
    """Errors against the field, or the reason why there is no field."""
    if scene.subject.no_field:
        return f"**The field** is no truth here: {scene.subject.no_field}."
    nearest = min(scene.rivals("field"), key=lambda p: p.error, default=None)
    found = {name: scene.point(name, "field") for name in (DEFAULT, EXACT)}
    if nearest is None:
        return ""
    what = "the formula" if scene.subject.formula is not None else "the samples' b-spline"
    away = "".join(f"{name} is {number(p.error)} away, " for name, p in found.items() if p)
    return (
        f"**The field itself** ({what}, classified after reconstruction): {away}nearest is {nearest.name} with "
        f"{number(nearest.error)} in {milliseconds(nearest.time)}."
    )


def methods_table(scene: SceneResults) -> str:
    """HTML of all methods: time, and the error against each truth, bold on its front."""
    best = {truth: {point.name for point in front(scene.rivals(truth))} for truth in scene.truths}
    exact, rows, strong = scene.row(EXACT), [], set()
    for row in scene.rows:
        if row.omitted:
            continue
        words = methods()[row.method].words
        cells = [row.method, words if words != row.method else "", milliseconds(row.timing)]
        cells.append(f"{row.timing.over(exact.timing).median:.2g}" if row.timing and exact and exact.timing else "")
        cells += [number(row.error(truth)) + " ●" * (row.method in best[truth]) for truth in scene.truths]
        cells += [number(row.error("reference", "maximum")), number(row.bound), number(row.extraction)]
        rows.append((*cells, f"the same picture as {row.same_as}" if row.same_as else ""))
        if row.bound is not None and (row.error("reference", "maximum") or 0.0) > row.bound:
            strong.add(len(rows) - 1)
    errors = (f"error: {NAMES[truth]}" for truth in scene.truths)
    head = ("method", "in words", "time of a frame", "time / exact's", *errors, "largest error", "its limit")
    title = (
        f"Methods, their times and errors (root mean square); ● no other is both faster and more accurate: {len(rows)}"
    )
    return table((*head, "preparation, s", ""), rows, title, strong=strong)


def left_out(scene: SceneResults) -> list[Cells]:
    """Methods that were not drawn, truths that are missing, and why."""
    rows: list[Cells] = [(row.method, row.omitted) for row in scene.rows if row.omitted]
    rows += [(f"{row.method}, {NAMES[truth]}", why) for row in scene.rows for truth, why in row.missing.items()]
    untimed = [row.method for row in scene.rows if row.timing is None and not row.omitted]
    rows += [(n, f"not timed: {'drawn in float64' if methods()[n].row else 'interrupted'}") for n in untimed]
    return rows


# columns of `registry`
REGISTRY = ("axis", "what it is", "methods")


def registry() -> list[tuple[str, str, str]]:
    """All methods by axis; also in the guide."""
    return [(axis.name, axis.about, " · ".join(m.name for m in axis.methods)) for axis in AXES.values()]


def number(value: float | None) -> str:
    """Two digits: 0.00012 as 1.2e−4."""
    if value is None:
        return ""
    if value == 0 or 0.001 <= abs(value) < 1000:
        return f"{value:.2g}".replace("-", "−")
    mantissa, _, exponent = f"{value:.1e}".partition("e")
    return f"{mantissa}e{int(exponent)}".replace("-", "−")


def percent(error: float) -> str:
    """A relative error in per cent."""
    return f"{number(100 * error)} %"


def milliseconds(timing: Timing | None) -> str:
    """The median, with three digits, and all digits before the decimal point."""
    if timing is None:
        return ""
    value = 1e3 * timing.median
    return f"{value:.3g} ms" if value < 1000 else f"{value:.0f} ms"


# --- pictures of methods ----------------------------------------------------------------------------------------------

PLAIN_METHODS = ("no antialiasing", "2×2", "preview 1/2", "sheets 3", "post b-spline 2×2")
SHOWN = (DEFAULT, PAPER, EXACT, *PLAIN_METHODS, EWA, BESIDE_EWA)
# percentile of the worst method's differences shown as the brightest
BRIGHTEST = 99.5
COMPARED = ("reference", "sampled", "field")
# images up to this many pixels a side are enlarged on the page
SQUARES = 128


def strip(renderer: Renderer, scene: SceneResults, truths: Truths) -> str:
    """HTML of thumbnails: a column per method with its image and its difference from each truth.

    The methods draw again; the images are bitwise identical.
    """
    subject, columns = scene.subject, []
    rows = [row for name in SHOWN if (row := scene.row(name)) is not None and not row.omitted]
    differences: dict[tuple[str, str], np.ndarray] = {}
    drawn: dict[str, Image] = {}
    for row in rows:
        method = methods()[row.method]
        settings = subject.inputs(method)[1]
        drawn[row.method] = image = subject.draw(renderer, method)
        for truth in set(COMPARED) & set(row.errors) if truths.level.pixels is None else ():
            differences[row.method, truth] = largest_difference(image, truths.get(truth, settings))
    shown = [truth for truth in COMPARED if any(of == truth for _, of in differences)]
    brightest = {key: float(np.percentile(difference, BRIGHTEST)) for key, difference in differences.items()}
    scales = {truth: max(value for (_, of), value in brightest.items() if of == truth) for truth in shown}
    peak = max((subject.settings.brightest(image.pixels) for image in drawn.values()), default=1.0) or 1.0
    for name, image in drawn.items():
        heats = {t: heat_map(differences[name, t], scales[t] or 1.0) for t in shown if (name, t) in differences}
        pictures = [f'<img alt="{escape(name)}" src="{data_uri(to_display(image, peak))}">']
        for truth, heat in heats.items():
            pictures.append(f'<img alt="difference, {NAMES[truth]}" src="{data_uri(heat)}"><i>{NAMES[truth]}</i>')
        columns.append(f"<figure><figcaption>{escape(name)}</figcaption>{''.join(pictures)}</figure>")
    legend = "; ".join(f"{NAMES[truth]}: black is none, pale {number(scales[truth])} and more" for truth in shown)
    kind = "strip squares" if max(subject.camera.size) <= SQUARES else "strip"
    head = f"<h3>Pictures{f', and their differences on one scale ({legend})' if legend else ''}</h3>"
    return f'{head}<div class="{kind}">{"".join(columns)}</div>'


# --- files ------------------------------------------------------------------------------------------------------------

STYLE, PAGE = "page.css", "report.html"


def page(
    scenes: Sequence[SceneResults],
    head: Mapping[str, Any],
    level: EffortLevel,
    diagrams: Mapping[str, bytes],
    strips: Mapping[str, str],
) -> str:
    """The whole page. head: version and machine. diagrams: PNG by file name; strips: HTML of thumbnails by scene."""
    machine, title = head["machine"], "Error against run time"
    parts = ["<main>", f"<h1>{title}</h1>"]
    told = [f"{machine['renderer']}, OpenGL {machine['opengl']}", f"{machine['processor']}, {machine['cores']} cores"]
    told += [machine["system"], f"Python {machine['python']}"]
    told += [f"{name} {version}" for name, version in machine["versions"].items()]
    parts.append(f"<p>{escape('; '.join(told))}.</p>")
    for scene in scenes:
        subject, name = scene.subject, scene.subject.name
        size = f"{subject.camera.size[0]}×{subject.camera.size[1]} pixels"
        note = f" ({subject.note})" if subject.note else ""
        parts += [f"<h2>{escape(name)}</h2>", f"<p>{len(subject.splats()):,} splats{note}, {size}.</p>"]
        parts.append(f"<ul>{''.join(f'<li>{_bold(text)}</li>' for text in conclusion(scene))}</ul>")
        if (file := f"{name}.png") in diagrams:
            data = base64.b64encode(diagrams[file]).decode("ascii")
            parts.append(f'<img class="diagram" alt="{escape(name)}" src="data:image/png;base64,{data}">')
        parts += [strips.get(name, ""), methods_table(scene)]
        parts.append(table(("what", "why"), left_out(scene), "left out", folded=True))
    truths = "; ".join(f"**{NAMES[truth]}**: against {about}" for truth, about in TRUTHS.items())
    how = HOW.format(rounds=level.rounds, rays=level.rays, steps=level.steps)
    how += AT_PIXELS.format(pixels=level.pixels) * (level.pixels is not None)
    parts += ["<h2>How it was measured</h2>", *(f"<p>{_bold(text)}</p>" for text in (f"{truths}.", how))]
    css = files("splatgl.report").joinpath(STYLE).read_text(encoding="utf-8")
    named = f"{title}: {', '.join(scene.subject.name for scene in scenes)}"
    listed = table(REGISTRY, registry(), f"all {len(methods())} methods, by what is varied", folded=True)
    return html_page(named, css, [*parts, listed, "</main>"])


def _bold(text: str) -> str:
    """HTML of a text in which **words** are bold."""
    return "".join(f"<b>{part}</b>" if n % 2 else part for n, part in enumerate(escape(text).split("**")))


def as_csv(scenes: Sequence[SceneResults]) -> str:
    """A header, and a line per method and scene; numbers in full precision, empty cells for missing values."""
    names = ("rmse", "maximum", "share_over", "energy")
    columns = ("scene", "method", "same_as", "omitted", "splats", "extraction", "tolerance", "bound", "seconds")
    buffer = io.StringIO()
    rows: list[Sequence[Any]] = [(*columns, *(f"{truth}_{name}" for truth in TRUTHS for name in names))]
    for scene in scenes:
        for row in scene.rows:
            first = [scene.subject.name, *(getattr(row, name) for name in columns[1:-1])]
            first.append(row.timing.median if row.timing else None)
            rows.append((*first, *(row.error(truth, name) for truth in TRUTHS for name in names)))
    csv.writer(buffer, lineterminator="\n").writerows(rows)
    return buffer.getvalue()


def publish(
    scenes: Sequence[SceneResults], head: Mapping[str, Any], level: EffortLevel, folder: Path, strips: Mapping[str, str]
) -> list[str]:
    """Writes the page, the numbers and the diagrams; returns a line about them, and a line about missing files."""
    told = []
    try:
        diagrams = dict(_diagrams(scenes, head))
    except InputError as error:
        diagrams, told = {}, [f"diagrams left out: {error}"]
    written = {PAGE: page(scenes, head, level, diagrams, strips).encode(), "report.csv": as_csv(scenes).encode()}
    for name, data in {**written, **diagrams}.items():
        write_file(folder / name, data)
    others = ", ".join(["report.csv", *diagrams])
    return [f"{folder / PAGE}: {len(scenes)} scenes; beside it {others}", *told]


def _diagrams(scenes: Sequence[SceneResults], head: Mapping[str, Any]) -> Iterator[tuple[str, bytes]]:
    """Diagrams as PNG and SVG by file name. Raises InputError without Matplotlib."""
    from splatgl.report.diagram import picture

    for scene in scenes:
        for suffix, data in picture(scene, head).items():
            yield f"{scene.subject.name}{suffix}", data
