"""`Table`: named columns and rows, as aligned text or Markdown."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

# width of a printed page, characters
TEXT_WIDTH = 78


@dataclass(frozen=True)
class Table:
    """Named columns, with units in the names; each row has a value per column. title: its caption, behind which
    Markdown is collapsed.
    """

    columns: tuple[str, ...]
    rows: tuple[tuple[float | str | None, ...], ...]
    title: str = ""

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
        """Markdown, collapsed behind the title if there is one."""
        text = "\n".join([_line(self.columns), "|" + "---|" * len(self.columns), *map(_line, self.cells)])
        return f"<details><summary>{self.title}</summary>\n\n{text}\n\n</details>" if self.title else text


def _line(cells: Sequence[str]) -> str:
    # escape bars, which would end the cell
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"
