"""A report as Markdown, with its diagrams as files beside it."""

from __future__ import annotations

from collections.abc import Mapping

from splatgl.truth.report.content import Block, Diagram, Heading, Pictures, Table, Text, blocks
from splatgl.truth.report.results import Results


def as_markdown(results: Results, diagrams: Mapping[str, str]) -> str:
    """The whole text. diagrams: file names by scene; pictures of the methods are left to the page."""
    parts = [_block(block, diagrams) for block in blocks(results)]
    return "\n\n".join(part for part in parts if part) + "\n"


def _block(block: Block, diagrams: Mapping[str, str]) -> str:
    match block:
        case Heading(text, level):
            return f"{'#' * level} {text}"
        case Text(lines, bullets):
            return "\n".join(f"* {line}" for line in lines) if bullets else "\n\n".join(lines)
        case Table():
            return _table(block)
        case Diagram(scene):
            return f"![error against run time: {scene}]({diagrams[scene]})" if scene in diagrams else ""
        case Pictures():
            return ""


def _table(table: Table) -> str:
    if not table.rows:
        return ""
    rows = [_row(table.head), "|" + "---|" * len(table.head)]
    for n, cells in enumerate(table.rows):
        rows.append(_row([f"**{cell}**" if cell and n in table.strong else cell for cell in cells]))
    text = "\n".join(rows)
    if table.folded:
        return f"<details><summary>{table.title}</summary>\n\n{text}\n\n</details>"
    return f"{table.title}\n\n{text}"


def _row(cells: list[str] | tuple[str, ...]) -> str:
    # a bar in a cell would end it
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"
