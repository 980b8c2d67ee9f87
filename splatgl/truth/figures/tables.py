"""The data of a figure, as numbers."""

from __future__ import annotations

from dataclasses import dataclass

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
