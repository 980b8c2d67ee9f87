"""What readers.py does with a file, and watches while it does: deep reading, and leaks."""

from __future__ import annotations

import ctypes
import gc
import os
import re
import resource
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np

import splatgl as sg
from splatgl.cli.volume_info import describe
from splatgl.data.volume import Volume
from splatgl.errors import MissingOption
from splatgl.readers import elsewhere, list_volumes
from splatgl.scene.scene_file import SceneFile

TOUCH = 2**22
"""Samples up to which a loaded volume is summed up and described whole; of a larger one both ends are."""

FEW = 8
"""Most channels of a file whose last time point is read too."""

EVERY, GROWTH = 500, 48 * 2**20
"""Files between two looks at memory, and bytes that it may grow by beyond what the first of these took."""


LONG = 10.0
"""Most seconds that VTK may read a file."""


# --- reading ----------------------------------------------------------------------------------------------------------


def read(path: Path, kind: str) -> None:
    """Loads a file, its last time point and what a choice leads to, and reads every sample."""
    if kind == "transfer":
        sg.Transfer.load(path)
        return
    if kind == "scene":
        _touch(SceneFile.from_toml(path).open())
        return
    if kind == "mesh":
        float(np.sum(sg.load_mesh(path).vertices))
        return
    list_volumes(path)
    given: dict[str, object] = {}
    try:
        volume = sg.load(path)
    except MissingOption as needed:
        first = needed.choices[0][0] if needed.choices else None
        picked = {"channel": "all", "array": first, "series": 1}.get(needed.option)
        if picked is None:
            raise
        given = {needed.option: picked}
        volume = sg.load(path, **given)  # type: ignore[arg-type]
    _touch(volume)
    if volume.times > 1 and len(volume.channels) <= FEW:
        _touch(sg.load(path, time=volume.times - 1, **given))  # type: ignore[arg-type]


def _touch(volume: Volume) -> None:
    whole = volume.count <= TOUCH
    others = [each.samples for each in (*volume.coarser, *volume.channels)]
    for array in (volume.samples, volume.color, volume.vectors, *others):
        if array is not None and volume.shape[1] * volume.shape[2] <= TOUCH:
            for plane in range(array.shape[0]) if whole else (0, array.shape[0] - 1):
                np.sum(array[plane], dtype=np.float64)
    if whole:
        describe(volume)


# --- leaks ------------------------------------------------------------------------------------------------------------


class Watch:
    """Compares what a process holds after a file with what it held before the first one."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.temporary = folder, folder.with_suffix(".tmp")
        self.temporary.mkdir(parents=True, exist_ok=True)
        tempfile.tempdir = os.environ["TMPDIR"] = str(self.temporary)
        gc.collect()
        self.files, self.base, self.first = 0, self._held(), 0

    def after(self) -> str:
        """What the last file left behind, "" for nothing."""
        self.files += 1
        # 1. handles, maps, processes and temporary files: rings of references are freed by the collector
        held = self._held()
        if self._exceeds(held):
            gc.collect()
            held = self._held()
        if self._exceeds(held):
            said, self.base = f"handles, maps, processes, temporary files: {self.base} before, {held} after", held
            return said
        # 2. memory
        if self.files % EVERY:
            return ""
        grown = self.memory() - (self.first or self.memory())
        self.first = self.first or self.memory()
        if grown > GROWTH:
            self.first += grown
            return f"{grown / 2**20:.1f} MiB more after {self.files} files than after {EVERY}"
        return ""

    def grown(self) -> int:
        """Bytes more than after the first EVERY files."""
        return self.memory() - self.first if self.first else 0

    def memory(self) -> int:
        """Resident bytes, without what the allocator keeps."""
        gc.collect()
        ctypes.CDLL(None).malloc_trim(0)
        return int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize()

    def _exceeds(self, held: tuple[int, ...]) -> bool:
        """Whether more is held than before: a process that reads files may have ended."""
        return any(now > before for now, before in zip(held, self.base, strict=True))

    def _held(self) -> tuple[int, int, int, int]:
        maps = Path("/proc/self/maps").read_text().count(f"{self.folder}/")
        task = Path(f"/proc/self/task/{os.getpid()}/children")
        left = sum(1 for _ in self.temporary.rglob("*"))
        return len(os.listdir("/proc/self/fd")), maps, len(task.read_text().split()), left


# --- the other process ------------------------------------------------------------------------------------------------


def start_elsewhere() -> None:
    """Starts the process that reads and looks at files beside this one, which is there from the beginning."""
    elsewhere.call("common.parse_number", 0, "1")
    elsewhere.SECONDS = LONG


def uses_hdf5(names: Sequence[str]) -> bool:
    """Whether files of these names are read by HDF5's library."""
    return any(re.search(r"\.(h5|hdf5|he5|nc|mnc|ims|emd|nxs|mat|vtkhdf)$", name) for name in names)
