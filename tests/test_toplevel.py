"""The top level of the repository holds what it should and nothing else."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
ALLOWED = {"pyproject.toml", "splatgl", "shaders", "tests", "scripts", "README.md", "constraints.txt"}  # and dotfiles


def test_top_level_is_fixed() -> None:
    if not (ROOT / ".git").exists():
        pytest.skip("not a git checkout: no list of tracked files")
    # `safe.directory`: a checkout owned by another user is listed too
    command = ["git", "-c", f"safe.directory={ROOT}", "ls-files", "-z"]
    listing = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout
    tracked = {path.split("/")[0] for path in listing.split("\0") if path}
    unexpected = {name for name in tracked if name not in ALLOWED and not name.startswith(".")}
    assert unexpected == set()
    if tracked:  # nothing is tracked before the first commit
        assert tracked >= ALLOWED
