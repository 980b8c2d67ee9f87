"""Tables of labels beside a segmentation: ITK-SNAP's label descriptions, found by their first lines."""

from __future__ import annotations

import re
from pathlib import Path

from splatgl.data.volume import Label
from splatgl.errors import expected

ENDINGS = (".label", ".lbl", ".txt")
MARK = "ITK-SnAP Label Description File"
# letters of a table at most, and of its first lines that tell what it is
MOST, FIRST = 1 << 20, 400
# number, red, green, blue, opacity, whether it is shown, whether as a mesh, and the name in quotation marks
NUMBER_AND_COLOR = r"\s*(\d{1,9})\s+(\d{1,3})\s+(\d{1,3})\s+(\d{1,3})\s+"
ROW = re.compile(NUMBER_AND_COLOR + r'(\d+\.?\d*|\.\d+)\s+(\d{1,9})\s+\d+\s+"([^"]*)"\s*')


def table_beside(path: Path, stem: str) -> tuple[Label, ...] | None:
    """The labels of stem.label, stem.lbl or stem.txt beside `path`, but 0; None without such a table of ITK-SNAP.

    Raises InputError for a table with other lines, or without labels.
    """
    for name in (stem + ending for ending in ENDINGS):
        table = path.parent / name
        if not table.is_file():
            continue
        with table.open(encoding="utf-8", errors="replace") as file:
            text = file.read(FIRST)
            if MARK.lower() in text.lower():
                return _labels(name, text + file.read(MOST))
    return None


def _labels(name: str, text: str) -> tuple[Label, ...]:
    found: dict[int, Label] = {}
    for number, line in enumerate(text.splitlines(), 1):
        if not line.strip() or line.startswith("#"):
            continue
        row = ROW.fullmatch(line)
        rgb = [int(part) for part in row.group(2, 3, 4)] if row else [256]
        opacity = float(row[5]) if row else 0.0
        if row is None or max(rgb) > 255 or opacity > 1:
            raise expected(f"{name}, line {number}", 'NUMBER R G B A VIS MSH "NAME"', repr(line[:60]))
        color, hidden = "#{:02x}{:02x}{:02x}".format(*rgb), not int(row[6])
        found[int(row[1])] = Label(int(row[1]), row[7], color, opacity, hidden)
    found.pop(0, None)
    if not found:
        raise expected(name, "labels", "none", "remove the file")
    return tuple(sorted(found.values(), key=lambda label: label.number))
