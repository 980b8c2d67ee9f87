"""Least and largest samples of a store's chunks, kept between runs: chunks that show nothing need not be read again."""

from __future__ import annotations

import atexit
import hashlib
import os
import tempfile
import zipfile
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from splatgl.data.readers.remote import cache_folder

# what is known of a chunk: nothing; its extent; that no sample is finite
UNKNOWN, KNOWN, EMPTY = 0, 1, 2
# most chunks of an array whose extents are kept
MOST = 1 << 24

Place = tuple[int, ...]


class Extents:
    """Those of an array of chunks. tag: of the store's contents; those of another tag are not taken."""

    def __init__(self, counts: Place, dtype: np.dtype, tag: str) -> None:
        self.file = cache_folder() / "extents" / f"{hashlib.sha256(tag.encode()).hexdigest()[:32]}.npz"
        self.low, self.high = np.zeros(counts, dtype), np.zeros(counts, dtype)
        self.known, self.changed = np.zeros(counts, np.uint8), False
        try:
            with np.load(self.file) as kept:
                found = [np.asarray(kept[name]) for name in ("low", "high", "known")]
        except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
            return
        if [(each.shape, each.dtype) for each in found] == [(counts, dtype)] * 2 + [(counts, np.dtype(np.uint8))]:
            self.low, self.high, self.known = found

    def add(self, place: Place, chunk: np.ndarray) -> None:
        """Takes note of a chunk that was read."""
        if self.known[place] != UNKNOWN:
            return
        if not self.changed:
            self.changed = True
            atexit.register(self.save)
        finite = chunk if chunk.dtype.kind in "bui" else chunk[np.isfinite(chunk)]
        if finite.size:
            self.low[place], self.high[place] = finite.min(), finite.max()
        self.known[place] = KNOWN if finite.size else EMPTY

    def of(self, places: Iterable[Place]) -> np.ndarray | None:
        """[2]: least and largest finite sample of those chunks, [0] if there is none; None if one is not known."""
        at = tuple(np.array(list(places)).T)
        known = self.known[at]
        if (known == UNKNOWN).any():
            return None
        some = known == KNOWN
        if not some.any():
            return np.zeros(0, self.low.dtype)
        return np.array([self.low[at][some].min(), self.high[at][some].max()])

    def save(self) -> None:
        """Writes what is known; a folder that can't be written is left as it is."""
        try:
            self.file.parent.mkdir(parents=True, exist_ok=True)
            with tempfile.NamedTemporaryFile(dir=self.file.parent, delete=False) as file:
                np.savez_compressed(file, low=self.low, high=self.high, known=self.known)
            os.replace(file.name, self.file)
            self.changed = False
        except OSError:
            pass


def tag_of(folder: Path) -> str:
    """The path, sizes and times of all files of an array: whatever is written into it changes the tag."""
    found = []
    folders = [str(folder.resolve())]
    while folders:
        with os.scandir(folders.pop()) as entries:
            for entry in entries:
                if entry.is_dir(follow_symlinks=False):
                    folders.append(entry.path)
                else:
                    told = entry.stat()
                    found.append(f"{entry.path} {told.st_size} {told.st_mtime_ns}")
    return "\n".join(sorted(found))
