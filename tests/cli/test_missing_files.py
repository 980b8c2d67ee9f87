"""A path that does not exist: the first thing that is said, in every command and option that takes one."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import splatgl as sg
from splatgl.cli.main import main
from splatgl.errors import InputError

pytestmark = pytest.mark.usefixtures("shared_programs")

COMMANDS = (
    *("render none.what", "render none", "render none.toml", "render none.stl", "render none.nii.gz"),
    *("render a.npy --mesh none.stl", "render a.npy --mesh none.what", "render a.npy --mask none.what"),
    *("render a.npy --labels none.what", "render a.npy --layer none.what", "render a.npy --transfer none.toml"),
    *("info none.what", "animate none.what -o a.gif", "animate a.npy -o a{frame}.png --keyframes none.toml"),
    *("pick none.what 1,1", "convert none.what a.nrrd", "pyramid none.what -o a.zarr", "report none.what"),
    *("surface none.what -o a.stl --iso 3", "render none.h5:/a", "compare none.png a.png", "view none.what"),
)


@pytest.mark.parametrize("command", COMMANDS)
def test_no_such_file_is_said_first(
    command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    np.save("a.npy", np.pad(np.ones((4, 4, 4), np.float32), 2))
    assert main(command.split()) == 2
    line = capsys.readouterr().err
    assert "got no such file" in line and len(line) < 120 and line.count("\n") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["a.npy"]


def test_similar_names_are_suggested(tmp_path: Path) -> None:
    for name in ("head.nii.gz", "scene.toml", "mesh.stl"):
        (tmp_path / name).write_text("")
    for load, name, near in (
        (sg.load, "haed.nii.gz", "head.nii.gz"),
        (sg.load_mesh, "mash.stl", "mesh.stl"),
        (sg.render, "scen.toml", "scene.toml"),
    ):
        with pytest.raises(InputError, match=f"got no such file; did you mean {near}"):
            load(str(tmp_path / name))


def test_reading_options_of_built_in_scenes(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["render", "terrain", "--color", "none.png"]) == 2
    assert "expected none of reading for a built-in scene, got " in capsys.readouterr().err


@pytest.mark.parametrize("command", ["render tunnel", "render tunnel --slice z=3", "view tunnel", "pick tunnel 1,1"])
@pytest.mark.parametrize("size", ["0", "0x4", "4x-3"])
def test_sizes_are_of_at_least_a_pixel(command: str, size: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([*command.split(), "--size", size]) == 2
    assert "--size: expected a width and a height of at least one whole pixel" in capsys.readouterr().err
