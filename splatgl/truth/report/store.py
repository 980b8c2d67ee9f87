"""Store of results as JSON lines, written immediately, so that an interrupted report can be resumed."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from splatgl.errors import InputError, expected

NAME = "runs.jsonl"
# kinds of lines, and their keys
KINDS: dict[str, set[str]] = {
    "head": set(),
    "scene": {"scene", "mark", "splats", "size", "note"},
    "picture": {"scene", "axis", "method", "same_as", "omitted"},
    "time": {"scene", "method", "round", "seconds"},
    "convergence": {"study", "unit", "expected", "floor", "values", "errors", "orders"},
}


class Store:
    """The lines of a report. lines: all of them, in the order written."""

    def __init__(self, path: Path, head: Mapping[str, Any], resume: bool = False) -> None:
        """Starts or resumes a store. Raises InputError if the existing one belongs to another report."""
        self.path = path
        self.lines: list[dict[str, Any]] = list(_read(path)) if resume and path.exists() else []
        begun = {"kind": "head", **head}
        if self.lines:
            old = self.lines[0]
            other = [name for name in begun if old.get(name) != begun[name]]
            if other:
                what = f"{other[0]} {begun[other[0]]!r}"
                got = repr(old.get(other[0]))
                raise expected(f"{path} --resume", what, got, "leave out --resume to begin anew")
        try:
            # drop a truncated line
            path.write_text("".join(f"{_text(line)}\n" for line in self.lines), encoding="utf-8")
        except OSError as error:
            raise InputError(f"{path}: cannot be written: {error.strerror or error}") from error
        if not self.lines:
            self.add("head", **head)

    def add(self, kind: str, **values: Any) -> dict[str, Any]:
        """Writes a line, and returns it."""
        line = {"kind": kind, **values}
        self.lines.append(line)
        try:
            with self.path.open("a", encoding="utf-8") as file:
                file.write(f"{_text(line)}\n")
        except OSError as error:
            raise InputError(f"{self.path}: cannot be written: {error.strerror or error}") from error
        return line

    def of(self, kind: str, **values: Any) -> list[dict[str, Any]]:
        """The lines of that kind with those values."""
        return [
            line
            for line in self.lines
            if line["kind"] == kind and all(line.get(name) == value for name, value in values.items())
        ]


def _text(line: Mapping[str, Any]) -> str:
    return json.dumps(line, ensure_ascii=False)


def _read(path: Path) -> Iterator[dict[str, Any]]:
    """The complete lines. InputError for a file that is not a report."""
    for number, text in enumerate(path.read_text(encoding="utf-8", errors="replace").splitlines(), start=1):
        try:
            line = json.loads(text)
        except ValueError:
            # only the last line can be truncated
            return
        kind = line.get("kind") if isinstance(line, dict) else None
        if kind not in KINDS or not line.keys() >= KINDS[kind] or (number == 1) != (kind == "head"):
            raise expected(f"{path} line {number}", "a line of a report", text[:60], "leave out --resume to begin anew")
        yield line
