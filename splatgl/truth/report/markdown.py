"""A report as Markdown, with its diagrams as files beside it."""

from __future__ import annotations

from collections.abc import Mapping

from splatgl.truth import table_io
from splatgl.truth.report.content import Block, Diagram, Heading, Pictures, Table, Text, blocks
from splatgl.truth.report.results import Results


def as_markdown(results: Results, diagrams: Mapping[str, str]) -> str:
    """The whole text. diagrams: file names by scene; images of the methods are only in the HTML page."""
    parts = [_block(block, diagrams) for block in blocks(results)]
    return "\n\n".join(part for part in parts if part) + "\n"


def _block(block: Block, diagrams: Mapping[str, str]) -> str:
    match block:
        case Heading(text, level):
            return f"{'#' * level} {text}"
        case Text(lines, bullets):
            return "\n".join(f"* {line}" for line in lines) if bullets else "\n\n".join(lines)
        case Table():
            return as_table(block)
        case Diagram(scene):
            return f"![error against run time: {scene}]({diagrams[scene]})" if scene in diagrams else ""
        case Pictures():
            return ""


def as_table(table: Table) -> str:
    """One table, collapsed behind its title if folded; empty for one without rows."""
    if not table.rows:
        return ""
    strong = [
        [f"**{cell}**" if cell and n in table.strong else cell for cell in row] for n, row in enumerate(table.rows)
    ]
    text = table_io.as_markdown(table.head, strong)
    if table.folded:
        return f"<details><summary>{table.title}</summary>\n\n{text}\n\n</details>"
    return f"{table.title}\n\n{text}" if table.title else text
