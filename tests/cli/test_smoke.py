"""Commands as users run them: in processes of their own, with nothing replaced."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import splatgl as sg

# a command, and the files that it writes
COMMANDS = {
    "render v.nrrd -o v.png --size 32": ["v.png"],
    "render v.nrrd w.npy -o {name}.png --size 24 --same": ["v.png", "w.png"],
    "render s.toml -o s.png": ["s.png"],
    "render v.nrrd -o slices.png --slice z=50% --size 64": ["slices.png"],
    "animate v.nrrd -o f{frame}.png --frames 2 --size 24": ["f0.png", "f1.png"],
    "convert v.nrrd c.nii.gz": ["c.nii.gz"],
    "surface v.nrrd -o m.stl --iso 0.5": ["m.stl"],
    "pyramid v.nrrd -o p.zarr": ["p.zarr"],
    "info v.nrrd --json": [],
    "info h.h5": [],
    "compare a.png b.png": [],
    "pick v.nrrd 16,16 --size 32": [],
    "presets v.nrrd -o presets.png --size 24": ["presets.png"],
}
QUICK = ("render v.nrrd -o v.png --size 32", "animate v.nrrd", "info h.h5", "compare", "convert")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("smoke")
    place = np.indices((12, 12, 12)) - 5.5
    samples = np.exp(-(place**2).sum(axis=0) / 12).astype(np.float32)
    sg.Volume(samples, spacing=(1, 1, 2)).save(folder / "v.nrrd")
    np.save(folder / "w.npy", samples[::-1, ::2])
    (folder / "s.toml").write_text('volume = "v.nrrd"\n[camera]\nsize = [32, 24]\n[transfer]\nunit = "extent"\n')
    h5py = pytest.importorskip("h5py")
    with h5py.File(folder / "h.h5", "w") as file:
        file["data"] = samples
    for name in "ab":
        sg.Image(np.full((8, 8, 4), 0.5, np.float32), {}).save(folder / f"{name}.png")
    return folder


@pytest.mark.parametrize(
    "line", [pytest.param(each, marks=() if each.startswith(QUICK) else pytest.mark.long) for each in COMMANDS]
)
def test_a_command_in_a_process_of_its_own(line: str, folder: Path) -> None:
    run = [sys.executable, "-m", "splatgl", *line.split()]
    ended = subprocess.run(run, cwd=folder, capture_output=True, text=True, env={**os.environ}, check=False)
    assert ended.returncode == 0, ended.stdout + ended.stderr
    assert "Traceback" not in ended.stderr
    assert [name for name in COMMANDS[line] if not (folder / name).exists()] == []
    if "--json" in line:
        assert json.loads(ended.stdout)["opacity_lengths"]["spacing"] == pytest.approx(2 ** (1 / 3))
    pictures = [name for name in COMMANDS[line] if name.endswith(".png")]
    assert all(sg.Image.load(folder / name).pixels[..., :3].std() > 0 for name in pictures)


def test_bad_input_in_a_process_of_its_own(folder: Path) -> None:
    run = [sys.executable, "-m", "splatgl", "render", "missing.nrrd", "-o", "none.png"]
    ended = subprocess.run(run, cwd=folder, capture_output=True, text=True, check=False)
    assert ended.returncode == 2 and len(ended.stderr.splitlines()) == 1 and not (folder / "none.png").exists()
