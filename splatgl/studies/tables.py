"""Writes tables as CSV, JSON, Markdown and text."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

# width of a printed page, characters
PAGE = 78


@dataclass(frozen=True)
class Table:
    """Named columns, with units in the names; each row has a value per column."""

    columns: tuple[str, ...]
    rows: tuple[tuple[float | str, ...], ...]

    def csv(self) -> str:
        """Comma-separated text with a header, numbers in full precision."""
        lines = [",".join(self.columns)]
        lines += [",".join(v if isinstance(v, str) else repr(float(v)) for v in row) for row in self.rows]
        return "\n".join(lines) + "\n"

    def text(self) -> str:
        """Aligned columns, four digits each."""
        cells = [self.columns, *[tuple(v if isinstance(v, str) else f"{v:.4g}" for v in row) for row in self.rows]]
        widths = [max(len(row[i]) for row in cells) for i in range(len(self.columns))]
        return "\n".join("  ".join(c.rjust(w) for c, w in zip(row, widths, strict=True)) for row in cells)


def as_csv(fields: Sequence[str], rows: Iterable[Mapping[str, Any]]) -> str:
    """A header line and a line per row; numbers in full precision, empty cells for missing values."""
    buffer = io.StringIO()
    writer = csv.DictWriter(buffer, fields, lineterminator="\n", restval="")
    writer.writeheader()
    writer.writerows(rows)
    return buffer.getvalue()


def as_json(value: Any) -> str:
    """Lists and dictionaries of plain values; NaN and infinity become null."""
    return json.dumps(_plain(value), ensure_ascii=False, indent=1) + "\n"


def as_markdown(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A Markdown table without a final newline."""
    return "\n".join([_line(head), "|" + "---|" * len(head), *(_line(row) for row in rows)])


def _line(cells: Sequence[str]) -> str:
    # escape bars, which would end the cell
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


def _plain(value: Any) -> Any:
    """The value with numbers that JSON cannot represent replaced."""
    if isinstance(value, Mapping):
        return {key: _plain(part) for key, part in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(part) for part in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
