"""Checks that an output file can be written, before any work."""

from __future__ import annotations

import os
from pathlib import Path

from splatgl.data.errors import InputError, expected


def check_output(path: Path, suffixes: tuple[str, ...] = (".png", ".npy")) -> None:
    """InputError, before any work, if `path` cannot be written or has none of the suffixes."""
    if path.suffix.lower() not in suffixes:
        raise expected(path, f"a name that ends in {' or '.join(suffixes)}", repr(path.suffix))
    if path.is_dir():
        raise expected(path, "a file to write", "a directory")
    if not path.parent.is_dir():
        raise expected(path, "a folder that exists", f"no folder {path.parent}", "make it first")
    if not os.access(path.parent, os.W_OK) or (path.exists() and not os.access(path, os.W_OK)):
        raise InputError(f"{path}: cannot be written: permission denied")
