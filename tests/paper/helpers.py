"""Refusals of `scripts/figure`."""

from __future__ import annotations

from pathlib import Path

import pytest
from paper.__main__ import main


def refused(arguments: list[str], message: str, here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """`scripts/figure` says so in one line, with exit code 2, and writes nothing."""
    try:
        code = main(arguments)
    except SystemExit as error:
        code = int(error.code or 0)
    said = capsys.readouterr().err.strip()
    assert code == 2 and message in said and said.count("\n") == 0
    assert list(here.iterdir()) == []
