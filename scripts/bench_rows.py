"""Writes what a benchmark found: rows of one dataclass, with who drew them."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import splatgl as sg


def save(path: Path, rows: Sequence[Any]) -> None:
    """A CSV file with a column for each of the rows' fields, and one for GL_RENDERER."""
    with sg.Renderer() as renderer:
        name = renderer.info.renderer
    told = [{**asdict(row), "renderer": name} for row in rows]
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, list(told[0]) if told else [])
        writer.writeheader()
        writer.writerows(told)
