"""A report as one HTML page that needs no other file: diagrams, thumbnails, magnified differences, tables."""

from __future__ import annotations

import base64
import re
from collections.abc import Mapping
from html import escape
from importlib.resources import files

from splatgl.truth.report.content import NAMES, Block, Diagram, Heading, Pictures, Table, Text, blocks
from splatgl.truth.report.results import Results
from splatgl.truth.report.thumbnails import COMPARED, Strip, Thumbnail
from splatgl.truth.report.words import number

STYLE = "page.css"


def page(results: Results, diagrams: Mapping[str, bytes], strips: Mapping[str, Strip]) -> str:
    """The whole page. diagrams: PNG files by scene; strips: thumbnails by scene."""
    css = files("splatgl.truth.report").joinpath(STYLE).read_text(encoding="utf-8")
    title = "Error against run time: " + ", ".join(scene.name for scene in results.scenes)
    body = [_block(block, diagrams, strips) for block in blocks(results)]
    return "\n".join(
        [
            f'<!doctype html><html lang="en"><meta charset="utf-8"><title>{escape(title)}</title><style>{css}</style>',
            '<meta name="viewport" content="width=device-width, initial-scale=1"><main>',
            *(part for part in body if part),
            "</main></html>\n",
        ]
    )


def _block(block: Block, diagrams: Mapping[str, bytes], strips: Mapping[str, Strip]) -> str:
    match block:
        case Heading(text, level):
            return f"<h{level}>{escape(text)}</h{level}>"
        case Text(lines, bullets):
            parts = [_marked(line) for line in lines]
            if bullets:
                return "<ul>" + "".join(f"<li>{part}" for part in parts) + "</ul>"
            return "".join(f"<p>{part}</p>" for part in parts)
        case Table():
            return _table(block)
        case Diagram(scene):
            if scene not in diagrams:
                return ""
            data = base64.b64encode(diagrams[scene]).decode("ascii")
            return f'<img class="diagram" alt="{escape(scene)}" src="data:image/png;base64,{data}">'
        case Pictures(scene):
            return _strip(strips[scene]) if scene in strips else ""


def _marked(text: str) -> str:
    """Escaped, **words** in bold."""
    return re.sub(r"\*\*(.+?)\*\*", r"<b>\1</b>", escape(text))


def _table(table: Table) -> str:
    if not table.rows:
        return ""
    head = "".join(f"<th>{escape(cell)}" for cell in table.head)
    rows = [
        f"<tr{' class=strong' if n in table.strong else ''}>" + "".join(f"<td>{escape(cell)}" for cell in cells)
        for n, cells in enumerate(table.rows)
    ]
    body = f'<div class="wide"><table><tr>{head}{"".join(rows)}</table></div>'
    title = escape(table.title[:1].upper() + table.title[1:])
    if table.folded:
        return f"<details><summary>{title}</summary>{body}</details>"
    return f'<section class="table">{f"<h3>{title}</h3>" if title else ""}{body}</section>'


def _strip(strip: Strip) -> str:
    """Columns of a method each: its picture, and its difference from each truth."""
    scales = "; ".join(
        f"{NAMES[truth]}: black is none, pale {number(strip.scales[truth])} and more"
        for truth in COMPARED
        if any(truth in each.differences for each in strip.thumbnails)
    )
    columns = "".join(_column(each) for each in strip.thumbnails)
    kind = "strip squares" if strip.small else "strip"
    return f'<h3>Pictures, and their differences on one scale ({scales})</h3><div class="{kind}">{columns}</div>'


def _column(each: Thumbnail) -> str:
    pictures = [f'<img alt="{escape(each.name)}" src="{each.picture}">']
    for truth in COMPARED:
        if truth in each.differences:
            name = NAMES[truth]
            pictures.append(f'<img alt="difference, {name}" src="{each.differences[truth]}"><i>{name}</i>')
    return f"<figure><figcaption>{escape(each.name)}</figcaption>{''.join(pictures)}</figure>"
