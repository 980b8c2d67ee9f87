"""Writes an accuracy report as an HTML page with thumbnails, and its files."""

from __future__ import annotations

import base64
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from html import escape
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from splatgl.comparison.html_report import data_uri, heat_map, html_page, largest_difference, to_display
from splatgl.data.image import Image
from splatgl.errors import InputError
from splatgl.fileio import write_file
from splatgl.splat.settings import Settings
from splatgl.studies.accuracy.content import (
    CONVERGENCE,
    NAMES,
    Block,
    Diagram,
    Pictures,
    blocks,
    number,
)
from splatgl.studies.accuracy.diagram import convergence, picture
from splatgl.studies.accuracy.export import as_csv, as_json, as_markdown
from splatgl.studies.accuracy.ground_truth import Subject, Truths
from splatgl.studies.accuracy.methods import EXACT, PAPER, methods
from splatgl.studies.accuracy.sweep import Results, SceneResults, Store

if TYPE_CHECKING:
    from splatgl.gl.renderer import Renderer

STYLE = "page.css"


def page(results: Results, diagrams: Mapping[str, bytes], strips: Mapping[str, Strip]) -> str:
    """The whole page. diagrams: PNG files by scene; strips: thumbnails by scene."""
    css = files("splatgl.studies.accuracy").joinpath(STYLE).read_text(encoding="utf-8")
    title = "Error against run time: " + ", ".join(scene.name for scene in results.scenes)
    parts = [_block(block, diagrams, strips) for block in blocks(results)]
    return html_page(title, css, ["<main>", *parts, "</main>"])


def _block(block: Block, diagrams: Mapping[str, bytes], strips: Mapping[str, Strip]) -> str:
    match block:
        case Diagram(scene):
            if scene not in diagrams:
                return ""
            data = base64.b64encode(diagrams[scene]).decode("ascii")
            return f'<img class="diagram" alt="{escape(scene)}" src="data:image/png;base64,{data}">'
        case Pictures(scene):
            return _strip(strips[scene]) if scene in strips else ""
        case _:
            return block.html()


def _strip(strip: Strip) -> str:
    """A column per method: its image, and its difference from each truth."""
    scales = "; ".join(
        f"{NAMES[truth]}: black is none, pale {number(strip.scales[truth])} and more"
        for truth in COMPARED
        if any(truth in thumbnail.differences for thumbnail in strip.thumbnails)
    )
    columns = "".join(map(_column, strip.thumbnails))
    kind = "strip squares" if strip.small else "strip"
    return f'<h3>Pictures, and their differences on one scale ({scales})</h3><div class="{kind}">{columns}</div>'


def _column(thumbnail: Thumbnail) -> str:
    pictures = [f'<img alt="{escape(thumbnail.name)}" src="{thumbnail.picture}">']
    for truth in COMPARED:
        if truth in thumbnail.differences:
            name = NAMES[truth]
            pictures.append(f'<img alt="difference, {name}" src="{thumbnail.differences[truth]}"><i>{name}</i>')
    return f"<figure><figcaption>{escape(thumbnail.name)}</figcaption>{''.join(pictures)}</figure>"


PAGE = "report.html"


def publish(results: Results, store: Store, folder: Path, strips: Mapping[str, Strip]) -> list[str]:
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


@dataclass(frozen=True)
class Thumbnail:
    """One method's picture and its differences, as data URIs, by truth."""

    name: str
    picture: str
    differences: dict[str, str]


@dataclass(frozen=True)
class Strip:
    """A scene's thumbnails, the truth first. scales: the brightest difference, by truth.

    small: whether pixels are shown as squares.
    """

    thumbnails: tuple[Thumbnail, ...]
    scales: dict[str, float]
    small: bool


def strip(renderer: Renderer, subject: Subject, scene: SceneResults, truths: Truths) -> Strip:
    """Thumbnails of the methods, drawn again: the images are bitwise identical."""
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
    cells = [Thumbnail(name, data_uri(to_display(right, peak)), {}) for name, right in _truth(truths, subject.settings)]
    for name in rows:
        heats = {t: _heat(differences[name, t], scales[t]) for t in COMPARED if (name, t) in differences}
        cells.append(Thumbnail(name, data_uri(to_display(drawn[name], peak)), heats))
    return Strip(tuple(cells), scales, max(subject.camera.size) <= SQUARES)


def _truth(truths: Truths, settings: Settings) -> Iterator[tuple[str, Image]]:
    """(name, image) of the sampled truth and of the field, if any."""
    for truth, name in (("sampled", "sampled truth"), ("field", "the field")):
        try:
            yield name, truths.get(truth, settings)
        except InputError:
            continue


def _scale(differences: list[np.ndarray]) -> float:
    return max((float(np.percentile(d, BRIGHTEST)) for d in differences), default=0.0) or 1.0


def _heat(difference: np.ndarray, scale: float) -> str:
    """Heat map from 0 to `scale`, which is set by an extra pixel that is cropped afterwards."""
    clipped = np.minimum(difference, np.float32(scale))
    with_scale = np.pad(clipped, ((0, 1), (0, 0)))
    with_scale[-1, 0] = scale
    return data_uri(heat_map(with_scale)[:-1])
