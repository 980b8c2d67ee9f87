"""Tables of labels: FreeSurfer's and 3D Slicer's lines "number name R G B A", ITK-SNAP's "number R G B A V M "name"",
and CSV or TSV with or without a header, such as BIDS's "index name color".
"""

from __future__ import annotations

import csv
import re
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from splatgl.data.color import srgb_of_name
from splatgl.data.volume import Label
from splatgl.errors import InputError, expected
from splatgl.fileio import MAX_BYTES, decode_text, require_existing

ENDINGS = (".label", ".lbl", ".txt")
MARK = "ITK-SnAP Label Description File"
# bytes of its first lines that identify a table
FIRST = 400
# number, red, green, blue, opacity, visible, mesh visible, and the name in quotation marks
NUMBER_AND_COLOR = r"\s*(\d{1,9})\s+(\d{1,3})\s+(\d{1,3})\s+(\d{1,3})\s+"
ROW = re.compile(NUMBER_AND_COLOR + r'(\d+\.?\d*|\.\d+)\s+(\d{1,9})\s+\d+\s+"([^"]*)"\s*')
FORM = "a number and a name on each line, as of FreeSurfer, ITK-SNAP, 3D Slicer, CSV or TSV"
# columns of red, green and blue by their names, in lower case without what is no letter
CHANNELS = [re.compile(f"(color|colour)?({name}|{name[0]})") for name in ("red", "green", "blue")]


def read_label_table(path: Path) -> dict[int, Label]:
    """The labels of a table by their numbers. Raises InputError for a missing file, and for a line of another form."""
    require_existing(path, path, "a table of labels")
    try:
        # a pipe would block
        text = _first_text(path, MAX_BYTES) if path.is_file() else ""
        lines = [line for line in text.splitlines() if line.strip() and not line.lstrip().startswith("#")]
        if MARK.lower() in text[:FIRST].lower() or (lines and all(map(ROW.fullmatch, lines))):
            return {label.number: label for label in _parse_labels(str(path), text)}
        mark = next((mark for mark in "\t,;" if lines and mark in lines[0]), "")
        labels = _of_columns(path, list(csv.reader(lines, delimiter=mark))) if mark else _of_lines(path, lines)
    except (OSError, csv.Error) as error:
        raise InputError(f"{path}: expected a table of labels, got {error}") from error
    if not labels:
        raise expected(path, FORM, "none")
    return {label.number: label for label in labels}


def _of_lines(path: Path, lines: Sequence[str]) -> list[Label]:
    """Labels of lines apart by spaces; the first may be a header."""
    labels = []
    for place, line in enumerate(lines):
        words = line.split()
        count = next((n for n in (4, 3) if len(words) > n + 1 and all(map(_is_whole, words[-n:]))), 0)
        end = len(words) - count
        name, color = " ".join(words[1:end]), words[end : end + 3]
        if name and _is_whole(words[0]):
            labels.append(Label(int(words[0]), name.strip('"'), _color(color)))
        elif place:
            raise expected(path, FORM, repr(line[:80]))
    return labels


def _of_columns(path: Path, rows: Sequence[Sequence[str]]) -> list[Label]:
    """Labels of rows, by the names in a header or else by what stands in the columns."""
    rows = [[cell.strip() for cell in row] for row in rows]
    header = [] if any(map(_is_whole, rows[0])) else [re.sub("[^a-z]", "", cell.lower()) for cell in rows[0]]
    body = rows[bool(header) :]
    columns = [[row[n] if n < len(row) else "" for row in body] for n in range(len(rows[0]))]
    whole = [n for n, column in enumerate(columns) if all(map(_is_whole, column))]
    texts = [n for n, column in enumerate(columns) if n not in whole and not all(map(_is_color, column))]
    named = [n for n in texts if n < len(header) and "name" in header[n]] or texts
    if not (body and whole and named):
        raise expected(path, FORM, repr(",".join(rows[0])[:80]))
    parts = [next((n for n, name in enumerate(header) if channel.fullmatch(name)), -1) for channel in CHANNELS]
    parts = [n for n in whole[1:] if n > named[0]][:3] if not header else parts if min(parts) >= 0 else []
    single = [[n] for n, column in enumerate(columns) if n not in (named[0], *whole) and any(map(_is_color, column))]
    color = parts if len(parts) == 3 else single[0] if single else []
    return [
        Label(int(row[whole[0]]), row[named[0]], _color([row[n] for n in color])) for row in zip(*columns, strict=True)
    ]


def _is_whole(text: str) -> bool:
    return re.fullmatch(r"-?\d{1,18}", text) is not None


def _is_color(text: str) -> bool:
    return re.fullmatch("#([0-9a-fA-F]{3}|[0-9a-fA-F]{6})", text) is not None


def _color(cells: Sequence[str]) -> str | None:
    """#rrggbb of red, green and blue from 0 to 255, or of one text; None for others."""
    with suppress(ValueError):
        rgb = srgb_of_name(cells[0]) if len(cells) == 1 else tuple(map(int, cells))
        return "#{:02x}{:02x}{:02x}".format(*rgb) if len(rgb) == 3 and max(rgb) < 256 else None
    return None


def load_label_table(path: Path, stem: str) -> tuple[Label, ...] | None:
    """The labels except 0 of ITK-SNAP's table stem.label, stem.lbl or stem.txt beside `path`; None without a table.

    Raises InputError for a table with other lines, or without labels.
    """
    for table in list_label_tables(path.parent, stem):
        return _parse_labels(table.name, _first_text(table, MAX_BYTES))
    return None


def list_label_tables(folder: Path, stem: str) -> list[Path]:
    """ITK-SNAP's tables of labels of a file with that stem."""
    tables = [table for ending in ENDINGS if (table := folder / (stem + ending)).is_file()]
    return [table for table in tables if MARK.lower() in _first_text(table, FIRST).lower()]


def _first_text(path: Path, most: int) -> str:
    """Text at the start of a file, of at most so many bytes."""
    with path.open("rb") as file:
        return decode_text(file.read(most))


def _parse_labels(name: str, text: str) -> tuple[Label, ...]:
    labels: dict[int, Label] = {}
    for number, line in enumerate(text.splitlines(), 1):
        if not line.strip() or line.startswith("#"):
            continue
        row = ROW.fullmatch(line)
        rgb = [int(part) for part in row.group(2, 3, 4)] if row else [256]
        opacity = float(row[5]) if row else 0.0
        if row is None or max(rgb) > 255 or opacity > 1:
            raise expected(f"{name}, line {number}", 'NUMBER R G B A VIS MSH "NAME"', repr(line[:60]))
        color, hidden = "#{:02x}{:02x}{:02x}".format(*rgb), not int(row[6])
        labels[int(row[1])] = Label(int(row[1]), row[7], color, opacity, hidden)
    labels.pop(0, None)
    if not labels:
        raise expected(name, "labels", "none", "remove the file")
    return tuple(sorted(labels.values(), key=lambda label: label.number))
