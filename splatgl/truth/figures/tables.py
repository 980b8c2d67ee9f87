"""What a figure shows, as numbers."""

from __future__ import annotations

from dataclasses import dataclass

# width of a printed page, characters
PAGE = 78


@dataclass(frozen=True)
class Table:
    """Columns by name, each row one value a column; units stand in the names."""

    columns: tuple[str, ...]
    rows: tuple[tuple[float | str, ...], ...]

    def csv(self) -> str:
        """Comma-separated text, numbers to the last bit, with a line of names."""
        lines = [",".join(self.columns)]
        lines += [",".join(v if isinstance(v, str) else repr(float(v)) for v in row) for row in self.rows]
        return "\n".join(lines) + "\n"

    def text(self) -> str:
        """Aligned columns, four digits each."""
        cells = [self.columns, *[tuple(v if isinstance(v, str) else f"{v:.4g}" for v in row) for row in self.rows]]
        widths = [max(len(row[i]) for row in cells) for i in range(len(self.columns))]
        return "\n".join("  ".join(c.rjust(w) for c, w in zip(row, widths, strict=True)) for row in cells)
