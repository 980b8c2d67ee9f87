"""Checks that an output file can be written, before any work; notes of a reader."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable
from pathlib import Path

from splatgl.data.errors import InputError, expected
from splatgl.data.readers.several import PICKED
from splatgl.data.volume import Volume


def check_output(path: Path, suffixes: tuple[str, ...] = (".png", ".npy")) -> None:
    """InputError, before any work, if `path` cannot be written or has none of the suffixes."""
    if path.suffix.lower() not in suffixes:
        raise expected(path, f"a name that ends in {' or '.join(suffixes)}", repr(path.suffix))
    if path.is_dir():
        raise expected(path, "a file to write", "a directory")
    check_folder(path.parent, path)
    if path.exists() and not os.access(path, os.W_OK):
        raise InputError(f"{path}: cannot be written: permission denied")


def check_folder(folder: Path, name: Path | str) -> None:
    """InputError, which begins with `name`, if a folder is neither one that can be written nor can be made."""
    there = next(path for path in (folder, *folder.absolute().parents) if os.path.lexists(path))
    if not there.is_dir():
        raise expected(name, "a folder", f"the file {there}", "choose another name")
    if not os.access(there, os.W_OK | os.X_OK):
        raise InputError(f"{name}: cannot be written: permission denied")


def overwrites(path: Path, sources: Iterable[str | None]) -> bool:
    """Whether writing `path` would overwrite one of the sources, by whatever name; None is none."""
    return os.path.exists(path) and any(each and os.path.exists(each) and path.samefile(each) for each in sources)


def check_source(path: Path, *sources: str | None) -> None:
    """InputError if writing `path` would overwrite one of the sources; None is none."""
    if overwrites(path, sources):
        raise expected(path, "another file than the source", "the source itself", "name another one with -o")


def tell(volume: Volume, quiet: bool = False, channels: bool = False, times: bool = False, layer: str = "") -> None:
    """Prints what the reader left out or assumed, on standard error. channels, times: whether all are shown. layer: the
    file of a volume beside the first.
    """
    notes = [note for note in volume.notes if not (times and note.endswith(PICKED))]
    if len(volume.channels) > 1 and not channels:
        notes.append(f"channel {volume.channels[0].name} of {len(volume.channels)} is taken: --channel picks another")
    for note in () if quiet else notes:
        print(f"splatgl: {Path(layer).name}: {note}" if layer else f"splatgl: {note}", file=sys.stderr)
