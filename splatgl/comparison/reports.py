"""Writes comparisons: an HTML file with their images, a summary in Markdown, and JUnit with attached pictures."""

from __future__ import annotations

import base64
import re
import shlex
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from importlib.resources import files
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from splatgl.comparison.metrics import DIFFERENCE_ROWS, Comparison, over_channels
from splatgl.comparison.verdict import Pair, Tolerance, Verdict, format_metric
from splatgl.data.image import Image, encode_png
from splatgl.fileio import write_file
from splatgl.options import declared

# pixels along the longer side of an image in a report, and of the enlarged detail
LARGEST, DETAIL = 1024, 64
# margin in pixels around a small difference
MARGIN = 6
# heat map, sRGB: no difference is black, the largest pale yellow; lightness increases evenly
HEAT = np.array([(0, 0, 0), (60, 15, 110), (165, 35, 105), (245, 105, 45), (253, 190, 70), (252, 255, 200)])
# heat map shades: more than an 8-bit screen can show
SHADES = 1024
# zlib level: images of noise compress slowly, without gain at higher levels
COMPRESSION = 4


# a rectangle of an image in pixels: left, top, right, bottom; the last two are exclusive
Box = tuple[int, int, int, int]


def to_display(image: Image, peak: float = 1.0) -> np.ndarray:
    """The image for display: sRGB, straight alpha, uint8 [H, W, 4]; X-rays relative to their peak."""
    pixels = shrink(image.pixels, np.mean)
    return np.rint(Image(pixels / np.float32(peak)).straight() * 255).astype(np.uint8)


def largest_difference(actual: Image, right: Image, mask: np.ndarray | None = None) -> np.ndarray:
    """Maximum |difference| over the channels, float32 [H, W]; 0 where `mask` is False."""
    a, b = actual.pixels, right.pixels
    worst = np.empty(a.shape[:2], np.float32)
    with np.errstate(over="ignore"):
        for top in range(0, len(a), DIFFERENCE_ROWS):
            band = slice(top, top + DIFFERENCE_ROWS)
            over_channels(np.subtract(a[band], b[band], dtype=np.float32), worst[band])
    # clamp overflow to the largest float32
    np.minimum(worst, np.finfo(np.float32).max, out=worst)
    return worst if mask is None else np.where(mask, worst, np.float32(0))


def heat_map(difference: np.ndarray, most: float | None = None) -> np.ndarray:
    """Heat map of the difference from 0 to `most`, by default its maximum, sRGB uint8 [H, W, 3]."""
    at = np.linspace(0, len(HEAT) - 1, SHADES)
    shades = np.stack([np.interp(at, np.arange(len(HEAT)), channel) for channel in HEAT.T], axis=-1)
    # any difference is brighter than black
    share = np.minimum(difference / np.float32(most or difference.max() or 1), np.float32(1))
    place = np.ceil(share * np.float32(SHADES - 1)).astype(np.uint16)
    return np.take(np.rint(shades).astype(np.uint8), place, axis=0, mode="clip")


def shrink(pixels: np.ndarray, choose: Callable[..., np.ndarray]) -> np.ndarray:
    """Downsamples to at most LARGEST along the longer side: k×k blocks by np.mean, or by np.max to keep every peak."""
    height, width = pixels.shape[:2]
    k = -(-max(height, width) // LARGEST)
    if k == 1:
        return pixels
    padded = np.pad(pixels, [(0, -height % k), (0, -width % k), *[(0, 0)] * (pixels.ndim - 2)], mode="edge")
    # rows first: reducing whole rows is fast and leaves 1/k of the data
    rows = choose(padded.reshape(-1, k, *padded.shape[1:]), axis=1)
    return choose(rows.reshape(len(rows), -1, k, *pixels.shape[2:]), axis=2)


def detail_box(comparison: Comparison, shape: tuple[int, ...]) -> Box:
    """The region to enlarge: the box of the difference if small, else a region around the worst pixel."""
    height, width = shape[:2]
    left, top, right, bottom = comparison.box or (0, 0, width, height)
    if max(right - left, bottom - top) + 2 * MARGIN > DETAIL:
        column, row = comparison.where
        left, right, top, bottom = column, column + 1, row, row + 1
        grow = (DETAIL - 1) // 2
    else:
        grow = MARGIN
    return max(left - grow, 0), max(top - grow, 0), min(right + grow, width), min(bottom + grow, height)


def data_uri(samples: np.ndarray) -> str:
    """A PNG of uint8 [H, W, 3 or 4] as a data URI."""
    return "data:image/png;base64," + base64.b64encode(encode_png(samples, COMPRESSION)).decode("ascii")


# maximum number of cases with images: a larger page is too big to open
MOST_PICTURED = 100
# states of a case, worst first
STATES = ("unusable", "different", "missing", "same")
# the page's styles, script and controls, beside this file
ASSETS = ("report.css", "report.js", "report_controls.html")


@dataclass(frozen=True)
class Case:
    """A comparison in the report.

    state: one of STATES. line: its summary. html: its images, or empty. accept: the shell command that makes the new
    image the expected one. written, folder, stem, test_file: of a test: the baseline that it wrote, or ""; the folder
    and the stem of its baselines; its file.
    """

    name: str
    state: str
    line: str
    html: str = ""
    accept: str = ""
    written: str = ""
    folder: str = ""
    stem: str = ""
    test_file: str = ""

    @property
    def anchor(self) -> str:
        """The case's id on the page, for links."""
        return "case-" + re.sub(r"[^A-Za-z0-9_.-]+", "-", self.name).strip("-")


def pair_html(verdict: Verdict, pair: Pair) -> str:
    """Two images, their difference, and a table of all metrics."""
    difference = largest_difference(pair.actual, pair.right, pair.mask)
    return _panels(verdict, pair, difference) + _table(verdict)


def image_html(image: Image, expected: bool = False) -> str:
    """An image without a counterpart; "" for one that cannot be displayed. expected: whether it is expected."""
    if not np.isfinite(image.pixels).all():
        return ""
    panel = _panel("expected" if expected else "actual", to_display(image, image.white))
    return f'<div class="row">{panel}</div>'


def build_page(cases: Sequence[Case], title: str, extra: str = "") -> str:
    """The HTML page: counts, then differing cases with images, then a line for each equal case. extra: more HTML."""
    ranked = sorted(cases, key=lambda c: STATES.index(c.state))
    numbers = {state: sum(c.state == state for c in cases) for state in STATES}
    css, js, controls = (files("splatgl.comparison").joinpath(name).read_text(encoding="utf-8") for name in ASSETS)
    wrong = [c for c in ranked if c.state != "same"]
    rows = "".join(f"<tr><td>{escape(c.name)}<td>{escape(c.line)}" for c in cases if c.state == "same")
    parts = [
        f'<header><h1>{escape(title)}</h1><p class="counts">{_filters(numbers)}</p>',
        f"{controls if wrong else ''}</header>",
        "<main>",
        *(_section(c, pictured=i < MOST_PICTURED) for i, c in enumerate(wrong)),
        f'<details class="same"><summary>{numbers["same"]} the same</summary><table>{rows}</table></details>'
        if rows
        else "",
        extra,
        f"</main><script>{js}</script>",
    ]
    return html_page(title, css, parts)


def html_page(title: str, css: str, parts: Iterable[str]) -> str:
    """A page with a style sheet; empty parts are left out."""
    return "\n".join(
        [
            f'<!doctype html><html lang="en"><meta charset="utf-8"><title>{escape(title)}</title><style>{css}</style>',
            '<meta name="viewport" content="width=device-width, initial-scale=1">',
            *filter(None, parts),
            "</html>\n",
        ]
    )


# most columns that fit on narrow pages
FEW_COLUMNS = 5


def html_table(head: Sequence[str], rows: Iterable[Sequence[str]], classes: Iterable[str], kind: str = "") -> str:
    """A table of text. classes: of its rows, "" for none; kind: its class. Cells of many columns name theirs, so that
    style sheets can put them below each other on narrow pages.
    """
    names = [f' data-head="{escape(cell)}"' if len(head) > FEW_COLUMNS else "" for cell in head]
    kind = f"{kind} many".strip() if len(head) > FEW_COLUMNS else kind
    opening = f'<table class="{kind}">' if kind else "<table>"
    lines = [f"<tr>{''.join(f'<th>{escape(cell)}' for cell in head)}"]
    for cells, name in zip(rows, classes, strict=True):
        # a number is not parted from its unit
        texts = [escape(cell).replace(" %", "\xa0%").replace(" ms", "\xa0ms") for cell in cells]
        shown = "".join(f"<td{named}>{text}" for named, text in zip(names, texts, strict=True))
        lines.append(f"<tr{name and f' class={name}'}>{shown}")
    return f"{opening}{''.join(lines)}</table>"


def list_files(title: str, names: Sequence[str]) -> str:
    """A list of files with the command that removes them, for `build_page`; "" for none."""
    if not names:
        return ""
    rows = "".join(f"<tr><td>{escape(name)}" for name in names)
    command = escape(f"rm {' '.join(shlex.quote(name) for name in names)}")
    return f"<details open><summary>{len(names)} {title}</summary><table>{rows}</table><code>{command}</code></details>"


def _filters(numbers: Mapping[str, int]) -> str:
    """A button for each state that occurs, which shows or hides its cases."""
    return " ".join(
        f'<button class="{state}" data-state="{state}" aria-pressed="true">{count} {state}</button>'
        for state, count in numbers.items()
        if count
    )


def _section(c: Case, pictured: bool) -> str:
    body = c.html if pictured else f"<p>Only the first {MOST_PICTURED} are shown with pictures.</p>" if c.html else ""
    what, mark, rest = c.line.partition(";")
    line = f'<p class="line"><strong>{escape(what)}</strong>{mark}{escape(rest)}</p>'
    link = f'<a href="#{escape(c.anchor)}">{escape(c.name)}</a>'
    head = f'<h2><b class="{c.state}">{c.state}</b> {link}</h2>{line}'
    accept = ""
    if c.accept:
        accept = (
            '<p class="accept"><label><input type="checkbox" class="marked"> mark</label>'
            f'<button class="copy">copy</button><code>{escape(c.accept)}</code></p>'
        )
    attributes = f'class="case" id="{escape(c.anchor)}" data-state="{c.state}"'
    return f"<section {attributes}>{head}{accept}{body}</section>"


def _panels(verdict: Verdict, pair: Pair, difference: np.ndarray) -> str:
    """Two rows: the images with the box of the difference, and the enlarged detail."""
    result, both = verdict.comparison, (pair.actual, pair.right)
    rows = [_row(both, heat_map(shrink(difference, np.max)), result, _mark(verdict))]
    left, top, end, bottom = detail_box(result, difference.shape)
    if verdict.kind is not None and (end - left, bottom - top) != verdict.size:
        part = slice(top, bottom), slice(left, end)
        cut = [Image(image.pixels[part]) for image in both]
        rows.append(f'<p class="part">columns {left}–{end - 1}, rows {top}–{bottom - 1}, enlarged</p>')
        rows.append(_row(cut, heat_map(difference[part]), result, "", "detail"))
    return "".join(rows)


def _row(both: Sequence[Image], difference: np.ndarray, comparison: Comparison, mark: str, kind: str = "") -> str:
    gain = f"difference, from black to {format_metric('maximum', comparison.maximum)}"
    shown = [to_display(image, comparison.peak) for image in both]
    panels = [_panel(title, samples, kind, mark) for title, samples in zip(("actual", "expected"), shown, strict=True)]
    panels.append(_panel(gain, difference, kind, mark, "picture heat"))
    # the page's script adds one view of both images, so that the file holds them only once
    return f'<div class="row {kind}">{"".join(panels)}</div>'


def _panel(title: str, samples: np.ndarray, part: str = "", mark: str = "", kind: str = "picture") -> str:
    """A picture below its title. part: "detail" of the row; the alternative text says so."""
    height, width = samples.shape[:2]
    text = " ".join(filter(None, (title if kind != "picture" else f"{title} picture", part and f"({part})")))
    image = f'<img class="{kind}" width="{width}" height="{height}" alt="{text}" src="{data_uri(samples)}">'
    return f'<figure><figcaption>{title}</figcaption><div class="view">{image}{mark}</div></figure>'


def _mark(verdict: Verdict) -> str:
    """A frame around the difference, in per cent of the image size."""
    width, height = verdict.size
    if verdict.comparison.box is None:
        return ""
    left, top, right, bottom = verdict.comparison.box
    at = f"left:{100 * left / width:.3f}%;top:{100 * top / height:.3f}%"
    size = f"width:{100 * (right - left) / width:.3f}%;height:{100 * (bottom - top) / height:.3f}%"
    return f'<i class="mark" style="{at};{size}"></i>'


def _table(verdict: Verdict) -> str:
    rows, states = [], []
    for check in verdict.checks:
        limit = (
            "" if check.limit is None else ("≥ " if check.at_least else "≤ ") + format_metric(check.name, check.limit)
        )
        states.append("" if check.limit is None else ("ok" if check.ok else "broken"))
        rows.append((check.name, format_metric(check.name, check.value), limit, declared(Tolerance)[check.name].help))
    return html_table(("metric", "value", "limit", ""), rows, states, "metrics")


# rows of a summary in Markdown: GitHub takes 1 MiB a step
MOST_ROWS = 200
# images of a case's HTML: kind and content
IMAGES = re.compile(r'<figcaption>(actual|expected|difference)[^<]*<.*?src="data:image/png;base64,([^"]+)"')
# characters that XML has no place for
NOT_XML = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


def markdown_summary(cases: Sequence[Case], title: str, page: str = "") -> str:
    """A summary in Markdown: the counts, and a row for each case that is not the same. page: the report's place."""
    numbers = {state: sum(c.state == state for c in cases) for state in STATES}
    counts = ", ".join(f"{count} {state}" for state, count in numbers.items() if count) or "none compared"
    wrong = sorted((c for c in cases if c.state != "same"), key=lambda c: STATES.index(c.state))
    lines = [f"### {'❌' if wrong else '✅'} {title}: {counts}", ""]
    if wrong:
        lines += ["| picture | verdict | what changed |", "|---|---|---|"]
        lines += [f"| {_cell(c.name)} | {c.state} | {_cell(c.line)} |" for c in wrong[:MOST_ROWS]]
        if len(wrong) > MOST_ROWS:
            lines += [f"| … | | {len(wrong) - MOST_ROWS} more |"]
        commands = [c.accept for c in wrong if c.accept]
        if commands:
            text = "\n".join(commands[:MOST_ROWS])
            lines += ["", "<details><summary>accept all of them</summary>", "", "```sh", text, "```", "", "</details>"]
        if page:
            lines += ["", f"Pictures: `{page}` in the artefacts of this run."]
    return "\n".join(lines) + "\n"


def _cell(text: str) -> str:
    return escape(text, quote=False).replace("|", "\\|").replace("\n", " ")


def append_text(path: Path, text: str) -> None:
    """Appends to a file, as steps of a GitHub workflow do to their common summary."""
    before = path.read_bytes() if path.is_file() else b""
    write_file(path, before + text.encode())


def write_attachments(case: Case, folder: Path) -> list[Path]:
    """Writes the first actual, expected and difference images of a case as PNG files; returns their paths."""
    paths: dict[str, Path] = {}
    for kind, content in IMAGES.findall(case.html):
        if kind not in paths:
            paths[kind] = folder / f"{case.anchor.removeprefix('case-')}.{kind}.png"
            write_file(paths[kind], base64.b64decode(content))
    return list(paths.values())


def attachment_lines(paths: Sequence[Path]) -> str:
    """Lines by which Jenkins and GitLab attach files to a test of a JUnit report."""
    return "".join(f"[[ATTACHMENT|{path.resolve()}]]\n" for path in paths)


def junit_xml(cases: Sequence[Case], title: str, folder: Path | None) -> bytes:
    """A JUnit report: a test for each case. folder: for the pictures that it attaches; None attaches none."""
    wrong = sum(c.state in ("different", "missing") for c in cases)
    errors = sum(c.state == "unusable" for c in cases)
    numbers = {"tests": len(cases), "failures": wrong, "errors": errors}
    suite = ElementTree.Element("testsuite", {"name": title, **{key: str(n) for key, n in numbers.items()}})
    for case in cases:
        test = ElementTree.SubElement(suite, "testcase", {"classname": title, "name": NOT_XML.sub("?", case.name)})
        if case.state == "same":
            continue
        line = NOT_XML.sub("?", case.line)
        kind = "error" if case.state == "unusable" else "failure"
        ElementTree.SubElement(test, kind, {"message": line}).text = "\n".join(filter(None, (line, case.accept)))
        paths = write_attachments(case, folder) if folder else []
        if paths:
            ElementTree.SubElement(test, "system-out").text = attachment_lines(paths)
    suites = ElementTree.Element("testsuites")
    suites.append(suite)
    return bytes(ElementTree.tostring(suites, encoding="utf-8", xml_declaration=True))
