"""Writes the guide's table of extreme cases, splatgl/docs/accuracy.md, from what `splatgl stress` found.

splatgl stress --markdown stress.md && python scripts/stress_table.py stress.md
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

PAGE = Path(__file__).parents[1] / "splatgl" / "docs" / "accuracy.md"
# a heading, a line below it, and the rows
TABLE = re.compile(r"(?m)^\| case \| what is extreme \|.*\n(?:\|.*\n)+")


def main(found: str) -> None:
    """Replaces the table in the guide by that of the file. Exits with a message if it is not of all cases."""
    page, tables = PAGE.read_text(encoding="utf-8"), TABLE.findall(Path(found).read_text(encoding="utf-8"))
    if [len(table.splitlines()) for table in tables] != [len(TABLE.findall(page)[0].splitlines())]:
        sys.exit(f"{found}: expected the table of all cases, got another; run splatgl stress without --case")
    PAGE.write_text(TABLE.sub(lambda _: tables[0], page), encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1])
