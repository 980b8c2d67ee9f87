"""Refusals of `splatgl figure`."""

from __future__ import annotations

from pathlib import Path

import pytest

from splatgl.cli.main import main


def refused(arguments: list[str], message: str, here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """`splatgl figure` says so in one line, with exit code 2, and writes nothing."""
    try:
        code = main(["figure", *arguments])
    except SystemExit as error:
        code = int(error.code or 0)
    said = capsys.readouterr().err.strip()
    assert code == 2 and message in said and said.count("\n") == 0
    assert list(here.iterdir()) == []
