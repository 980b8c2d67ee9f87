"""Tables as CSV, Markdown, HTML and plain text."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

from splatgl.comparison.html_report import html_table

# width of a printed page, characters
PAGE = 78


@dataclass(frozen=True)
class Table:
    """Named columns, with units in the names; each row has a value per column.

    title: its caption. folded: collapsed by default, where possible. strong: indices of highlighted rows.
    """

    columns: tuple[str, ...]
    rows: tuple[tuple[float | str | None, ...], ...]
    title: str = ""
    folded: bool = False
    strong: frozenset[int] = frozenset()

    def csv(self) -> str:
        """Comma-separated text with a header, numbers in full precision, None as nothing."""
        buffer = io.StringIO()
        csv.writer(buffer, lineterminator="\n").writerows([self.columns, *self.rows])
        return buffer.getvalue()

    @property
    def cells(self) -> list[list[str]]:
        """The rows as text, numbers with four digits."""
        return [["" if v is None else v if isinstance(v, str) else f"{v:.4g}" for v in row] for row in self.rows]

    def text(self) -> str:
        """Aligned columns."""
        rows = [list(self.columns), *self.cells]
        widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
        return "\n".join("  ".join(c.rjust(w) for c, w in zip(row, widths, strict=True)) for row in rows)

    def markdown(self) -> str:
        """Markdown, collapsed behind the title if folded; empty for a table without rows."""
        if not self.rows:
            return ""
        rows = [
            [f"**{cell}**" if cell and n in self.strong else cell for cell in row] for n, row in enumerate(self.cells)
        ]
        text = "\n".join([_line(self.columns), "|" + "---|" * len(self.columns), *map(_line, rows)])
        if self.folded:
            return f"<details><summary>{self.title}</summary>\n\n{text}\n\n</details>"
        return f"{self.title}\n\n{text}" if self.title else text

    def html(self) -> str:
        """HTML, as `markdown`."""
        if not self.rows:
            return ""
        classes = ["strong" if n in self.strong else "" for n in range(len(self.rows))]
        body = f'<div class="wide">{html_table(self.columns, self.cells, classes)}</div>'
        title = escape(self.title[:1].upper() + self.title[1:])
        if self.folded:
            return f"<details><summary>{title}</summary>{body}</details>"
        return f'<section class="table">{f"<h3>{title}</h3>" if title else ""}{body}</section>'


def _line(cells: Sequence[str]) -> str:
    # escape bars, which would end the cell
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"
