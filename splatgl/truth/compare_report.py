"""HTML report of comparisons: side by side, difference and flicker view; one self-contained file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from html import escape
from importlib.resources import files

import numpy as np

from splatgl.data.image import Image
from splatgl.truth import compare_pictures as pictures
from splatgl.truth.compare_pictures import Box
from splatgl.truth.verdict import Verdict, number

# maximum number of cases with images: a larger page is too big to open
PICTURED = 100
# states of a case, worst first
STATES = ("unusable", "different", "missing", "same")
# the page's styles and script, beside this file
ASSETS = ("report.css", "report.js")
HINTS = {
    "maximum": "largest difference of a channel",
    "rmse": "root mean square of the differences",
    "bias": "mean difference of the channel where it is largest",
    "share": "pixels over the threshold",
    "unmatched": "of these, what no neighbouring pixel explains",
    "flip": "mean FLIP error as seen at 0.7 m",
    "psnr": "peak over rmse",
    "ssim": "mean structural similarity",
}


@dataclass(frozen=True)
class Case:
    """A comparison in the report. state: one of STATES. line: its summary. html: its images, or empty."""

    name: str
    state: str
    line: str
    html: str = ""

    def as_dict(self) -> dict[str, str]:
        """As plain strings, for transfer between processes."""
        return asdict(self)


def case(verdict: Verdict, actual: Image, right: Image, mask: np.ndarray | None = None) -> Case:
    """A verdict with its images; without them if the images are the same."""
    if verdict.same:
        return Case(verdict.name, "same", verdict.line)
    difference = pictures.largest(actual, right, mask)
    return Case(verdict.name, "different", verdict.line, _panels(verdict, actual, right, difference) + _table(verdict))


def case_alone(name: str, state: str, line: str, image: Image | None = None) -> Case:
    """A case without a counterpart: only the image, if there is a displayable one."""
    if image is None or not np.isfinite(image.pixels).all():
        return Case(name, state, line)
    peak = float(image.pixels.max()) or 1.0 if image.info.get("blend") == "xray" else 1.0
    return Case(name, state, line, f'<div class="row">{_panel("actual", _image(pictures.shown(image, peak)))}</div>')


def case_of_sizes(name: str, line: str, first: Image, second: Image) -> Case:
    """A case of two pictures of different sizes, which are shown side by side."""
    panels = []
    for title, image in (("actual", first), ("expected", second)):
        finite = Image(np.nan_to_num(image.pixels, posinf=0.0, neginf=0.0), image.info)
        peak = float(finite.pixels.max()) or 1.0 if image.info.get("blend") == "xray" else 1.0
        panels.append(_panel(title, _image(pictures.shown(finite, peak))))
    return Case(name, "different", line, f'<div class="row">{"".join(panels)}</div>')


def page(cases: Sequence[Case], title: str) -> str:
    """The HTML page: counts, then differing cases with images, then a line for each equal case."""
    ranked = sorted(cases, key=lambda c: STATES.index(c.state))
    counts = {state: sum(c.state == state for c in cases) for state in STATES}
    css, js = (files("splatgl.truth").joinpath(name).read_text(encoding="utf-8") for name in ASSETS)
    wrong = [c for c in ranked if c.state != "same"]
    parts = [
        f'<!doctype html><html lang="en"><meta charset="utf-8"><title>{escape(title)}</title><style>{css}</style>',
        '<meta name="viewport" content="width=device-width, initial-scale=1">',
        f'<header><h1>{escape(title)}</h1><p class="counts">{_counts(counts)}</p>',
        f"{_controls() if wrong else ''}</header>",
        "<main>",
        *(_section(c, pictured=i < PICTURED) for i, c in enumerate(wrong)),
        _sames([c for c in ranked if c.state == "same"]),
        f"</main><script>{js}</script></html>",
    ]
    return "\n".join(part for part in parts if part)


def _counts(counts: dict[str, int]) -> str:
    return " ".join(f'<b class="{state}">{count} {state}</b>' for state, count in counts.items() if count)


def _controls() -> str:
    grounds = "".join(f'<option value="{name}">{name}</option>' for name in ("checks", "black", "white"))
    return (
        '<p class="controls"><label>enlarge <select id="zoom"><option value="0">to fit</option>'
        '<option value="1">1×</option><option value="2">2×</option><option value="4">4×</option>'
        '<option value="8">8×</option></select></label>'
        f'<label>behind what is transparent <select id="ground">{grounds}</select></label>'
        '<label>difference × <input id="gain" type="range" min="0" max="6" step="0.5" value="0">'
        "<output>1</output></label>"
        '<label><input id="flicker" type="checkbox" checked> in turn (hold to see the expected one)</label></p>'
    )


def _section(c: Case, pictured: bool) -> str:
    body = c.html if pictured else f"<p>Only the first {PICTURED} are shown with pictures.</p>" if c.html else ""
    what, mark, rest = c.line.partition(";")
    line = f'<p class="line"><strong>{escape(what)}</strong>{mark}{escape(rest)}</p>'
    head = f'<h2><b class="{c.state}">{c.state}</b> {escape(c.name)}</h2>{line}'
    return f'<section class="case">{head}{body}</section>'


def _sames(cases: Sequence[Case]) -> str:
    if not cases:
        return ""
    rows = "".join(f"<tr><td>{escape(c.name)}<td>{escape(c.line)}" for c in cases)
    return f"<details><summary>{len(cases)} the same</summary><table>{rows}</table></details>"


def _panels(verdict: Verdict, actual: Image, right: Image, difference: np.ndarray) -> str:
    """Two rows: the images with the box of the difference, and the enlarged detail."""
    found = verdict.comparison
    peak = found.peak
    part = pictures.detail(found, difference.shape)
    all_of_it = (part.right - part.left, part.bottom - part.top) == verdict.size
    gain = f"difference, from black to {number('maximum', found.maximum)}"
    rows = [_row(_shown(actual, right, peak), pictures.heat(pictures.shrunk(difference, np.max)), gain, _mark(verdict))]
    if not all_of_it:
        cut = [Image(part.of(image.pixels)) for image in (actual, right)]
        where = f"columns {part.left}–{part.right - 1}, rows {part.top}–{part.bottom - 1}, enlarged"
        rows += [
            f'<p class="part">{where}</p>',
            _row(_shown(cut[0], cut[1], peak), pictures.heat(part.of(difference)), gain, "", "detail"),
        ]
    return "".join(rows)


def _shown(actual: Image, right: Image, peak: float) -> tuple[np.ndarray, np.ndarray]:
    return pictures.shown(actual, peak), pictures.shown(right, peak)


def _row(both: tuple[np.ndarray, np.ndarray], difference: np.ndarray, gain: str, mark: str, kind: str = "") -> str:
    first, second = (_image(samples) for samples in both)
    panels = [
        _panel("actual", first + mark),
        _panel("expected", second + mark),
        _panel(gain, _image(difference, "picture heat") + mark),
        # the page's script inserts both images here, so that the file holds them only once
        _panel('<span class="now">in turn</span>', "", "flicker"),
    ]
    return f'<div class="row {kind}">{"".join(panels)}</div>'


def _panel(title: str, inside: str, kind: str = "") -> str:
    return f'<figure><figcaption>{title}</figcaption><div class="view {kind}">{inside}</div></figure>'


def _image(samples: np.ndarray, kind: str = "picture") -> str:
    height, width = samples.shape[:2]
    return f'<img class="{kind}" width="{width}" height="{height}" alt="" src="{pictures.data_uri(samples)}">'


def _mark(verdict: Verdict) -> str:
    """A frame around the difference, in per cent of the image size."""
    width, height = verdict.size
    if verdict.comparison.box is None:
        return ""
    box = Box(*verdict.comparison.box)
    at = f"left:{100 * box.left / width:.3f}%;top:{100 * box.top / height:.3f}%"
    size = f"width:{100 * (box.right - box.left) / width:.3f}%;height:{100 * (box.bottom - box.top) / height:.3f}%"
    return f'<i class="mark" style="{at};{size}"></i>'


def _table(verdict: Verdict) -> str:
    """Every metric against its limit."""
    rows = []
    for check in verdict.checks:
        limit = "" if check.limit is None else ("≥ " if check.at_least else "≤ ") + number(check.name, check.limit)
        state = "" if check.limit is None else ("ok" if check.ok else "broken")
        cells = (check.name, number(check.name, check.value), limit, HINTS.get(check.name, ""))
        rows.append(f'<tr class="{state}">' + "".join(f"<td>{escape(cell)}" for cell in cells))
    return f'<table class="metrics"><tr><th>metric<th>found<th>allowed<th>{"".join(rows)}</table>'
