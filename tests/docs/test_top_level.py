"""The top level of the repository, or of a source archive, holds what it should and nothing else."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
# and dotfiles
ALLOWED = {"pyproject.toml", "splatgl", "shaders", "tests", "scripts", "README.md", "LICENSE", "constraints.txt"}


def tracked(root: Path) -> set[str]:
    """What git tracks at the top level; none before the first commit."""
    # `safe.directory`: a checkout owned by another user is listed too
    command = ["git", "-c", f"safe.directory={root}", "ls-files", "-z"]
    listing = subprocess.run(command, cwd=root, capture_output=True, text=True, check=True).stdout
    return {path.split("/")[0] for path in listing.split("\0") if path}


def test_nothing_is_missing() -> None:
    assert {path.name for path in ROOT.iterdir()} >= ALLOWED


def test_nothing_else_is_tracked() -> None:
    if not (ROOT / ".git").exists() or shutil.which("git") is None:
        pytest.skip("no git, or not a git checkout: no list of tracked files")
    names = tracked(ROOT)
    assert {name for name in names if name not in ALLOWED and not name.startswith(".")} == set()
    assert names >= ALLOWED or not names
