"""What readers.py does with a file, and watches while it does: deep reading, leaks, and quick looks elsewhere."""

from __future__ import annotations

import contextlib
import ctypes
import gc
import os
import re
import resource
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

import splatgl as sg
from splatgl.cli.volume_info import describe
from splatgl.data.volume import Volume
from splatgl.errors import MissingOption
from splatgl.readers import elsewhere, hdf5_files, list_volumes, tiff_validation
from splatgl.scene.scene_file import SceneFile

TOUCH = 2**22
"""Samples up to which a loaded volume is summed up and described whole; of a larger one both ends are."""

FEW = 8
"""Most channels of a file whose last time point is read too."""

EVERY, GROWTH = 500, 48 * 2**20
"""Files between two looks at memory, and bytes that it may grow by beyond what the first of these took."""


LONG = 10.0
"""Most seconds that VTK may read a file."""

LOOK = 3
"""Most seconds of processor time of a look elsewhere."""

XR = "tiff-xr"
"""Seeds whose pictures are first decoded in another process."""


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


# --- looks elsewhere --------------------------------------------------------------------------------------------------


def quick_looks(reader: str, names: Sequence[str]) -> None:
    """Has a process that never opens a file fork for each look of the reader at a file of HDF5 or JPEG XR in another
    process: a new Python takes 0.3 s each time.

    names: of the reader's files. The look is the reader's own, with the same limits.
    """
    module: Any
    # the process of VTK's readers is there from the beginning
    elsewhere.call("common.parse_number", 0, "1")
    elsewhere.SECONDS = LONG
    if reader == XR:
        import imagecodecs  # noqa: F401

        module, script = tiff_validation, tiff_validation._TRY
    elif uses_hdf5(names):
        import h5py  # noqa: F401

        module, script = hdf5_files, hdf5_files._PROBE.read_text(encoding="utf-8")
    else:
        return
    ours, theirs = os.pipe()
    answers, answer = os.pipe()
    if not os.fork():
        _serve(ours, answer, script)
    for end in (ours, answer):
        os.close(end)

    def run(program: Sequence[str], _seconds: float) -> bool:
        os.write(theirs, os.fsencode(program[-1]) + b"\0")
        return int(os.read(answers, 16)) == 0

    module.run_elsewhere = run


def _serve(ours: int, answer: int, script: str) -> None:
    """Answers each path with the exit status of a script, until the pipe is closed."""
    silent = os.open(os.devnull, os.O_RDWR)
    for number in (0, 1, 2):
        os.dup2(silent, number)
    # the pipe to the process that counts must end with the one that reads
    for number in map(int, os.listdir("/proc/self/fd")):
        if number > 2 and number not in (ours, answer):
            with contextlib.suppress(OSError):
                os.close(number)
    while path := os.read(ours, 4096):
        child = os.fork()
        if not child:
            # processor time of the parent does not count
            resource.setrlimit(resource.RLIMIT_CPU, (LOOK, LOOK))
            sys.argv = ["look", os.fsdecode(path.rstrip(b"\0"))]
            try:
                exec(script, {"__name__": "__main__"})
            except SystemExit as ended:
                os._exit(int(ended.code or 0))
            except BaseException:
                os._exit(1)
            os._exit(0)
        _, status = os.waitpid(child, 0)
        os.write(answer, str(status).encode())
    os._exit(0)


def uses_hdf5(names: Sequence[str]) -> bool:
    """Whether files of these names are read by HDF5's library."""
    return any(re.search(r"\.(h5|hdf5|he5|nc|mnc|ims|emd|nxs|mat|vtkhdf)$", name) for name in names)
