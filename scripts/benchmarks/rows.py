"""Reports benchmark results: prints rows of a dataclass as they arrive, and writes them with the renderer's name."""

from __future__ import annotations

import csv
from collections.abc import Iterable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import splatgl as sg


def tell(found: Iterable[Any], path: Path | None) -> list[Any]:
    """Prints and returns the rows; given a path, also writes them as CSV, with a column for GL_RENDERER."""
    rows = []
    for row in found:
        print(row, flush=True)
        rows.append(row)
    if path is None:
        return rows
    with sg.Renderer() as renderer:
        name = renderer.info.renderer
    told = [{**asdict(row), "renderer": name} for row in rows]
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, list(told[0]) if told else [])
        writer.writeheader()
        writer.writerows(told)
    return rows
