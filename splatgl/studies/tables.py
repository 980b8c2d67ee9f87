"""Tables and text blocks as CSV, JSON, Markdown, HTML and plain text."""

from __future__ import annotations

import csv
import io
import json
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from typing import Any

from splatgl.comparison.html_report import html_table

# width of a printed page, characters
PAGE = 78
BOLD = re.compile(r"\*\*(.+?)\*\*")


@dataclass(frozen=True)
class Table:
    """Named columns, with units in the names; each row has a value per column.

    title: its caption. folded: collapsed by default, where possible. strong: indices of highlighted rows.
    """

    columns: tuple[str, ...]
    rows: tuple[tuple[float | str, ...], ...]
    title: str = ""
    folded: bool = False
    strong: frozenset[int] = frozenset()

    def csv(self) -> str:
        """Comma-separated text with a header, numbers in full precision."""
        lines = [",".join(self.columns)]
        lines += [",".join(v if isinstance(v, str) else repr(float(v)) for v in row) for row in self.rows]
        return "\n".join(lines) + "\n"

    @property
    def cells(self) -> list[list[str]]:
        """The rows as text, numbers with four digits."""
        return [[v if isinstance(v, str) else f"{v:.4g}" for v in row] for row in self.rows]

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


@dataclass(frozen=True)
class Heading:
    """A heading; level: 1 for the report's title, 2 and more for sections."""

    text: str
    level: int = 2

    def markdown(self) -> str:
        """Markdown."""
        return f"{'#' * self.level} {self.text}"

    def html(self) -> str:
        """HTML."""
        return f"<h{self.level}>{escape(self.text)}</h{self.level}>"


@dataclass(frozen=True)
class Text:
    """Paragraphs, one per line, or the items of a list; **words** are bold."""

    lines: tuple[str, ...]
    bullets: bool = False

    def markdown(self) -> str:
        """Markdown."""
        return "\n".join(f"* {line}" for line in self.lines) if self.bullets else "\n\n".join(self.lines)

    def html(self) -> str:
        """HTML."""
        tag = "li" if self.bullets else "p"
        lines = (BOLD.sub(r"<b>\1</b>", escape(line)) for line in self.lines)
        body = "".join(f"<{tag}>{line}</{tag}>" for line in lines)
        return f"<ul>{body}</ul>" if self.bullets else body


def as_csv(fields: Sequence[str], rows: Iterable[Mapping[str, Any]]) -> str:
    """A header line and a line per row; numbers in full precision, empty cells for missing values."""
    buffer = io.StringIO()
    writer = csv.DictWriter(buffer, fields, lineterminator="\n", restval="")
    writer.writeheader()
    writer.writerows(rows)
    return buffer.getvalue()


def as_json(value: Any) -> str:
    """Lists and dictionaries of plain values; NaN and infinity become null."""
    return json.dumps(_finite(value), ensure_ascii=False, indent=1) + "\n"


def _line(cells: Sequence[str]) -> str:
    # escape bars, which would end the cell
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


def _finite(value: Any) -> Any:
    """The value, with null for numbers that JSON cannot represent."""
    if isinstance(value, Mapping):
        return {key: _finite(part) for key, part in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(part) for part in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
