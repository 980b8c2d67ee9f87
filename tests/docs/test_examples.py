"""The examples run, are short, and draw something."""

from __future__ import annotations

import re
import runpy
import subprocess
import sys
from pathlib import Path

import mkdocs_hooks
import numpy as np
import pytest
from PIL import Image as Pillow

import splatgl as sg
from splatgl.splat.kernels import KERNELS

FOLDER = Path(__file__).parents[2] / "scripts" / "examples"
MOST_LINES = 30
# arguments of each example, and the number of pictures that it draws
ARGUMENTS = {
    "render_a_file": (["v.npy", "out.png"], 1),
    "points": (["out.png"], 1),
    "own_kernel": ([], 1),
    "numpy_volume": ([], 1),
    "several_views": ([], 1),
    "compare_pictures": ([], 1),
    "compare_settings": (["out.png"], 1),
    "turntable": (["v.npy", "frames", "2"], 2),
    "layers": (["out.png"], 1),
    "segmentation": ([], 3),
    "mesh": ([], 1),
    "clip": (["v.npy", "out.png", "out-2.png"], 2),
    "movie": ([], 1),
    "notebook": ([], 1),
    "large_volume": ([], 1),
    "dask_frames": (["v.npy", "frames", "2", "1"], 2),
    "transfer_function": ([], 3),
}
# starts processes of its own, or pytest
SPAWN = ("dask_frames", "test_picture")


def test_every_example_is_run_and_short() -> None:
    assert {path.stem for path in FOLDER.glob("*.py")} == {*ARGUMENTS, "test_picture"}
    lines = {path.stem: len(path.read_text(encoding="utf-8").splitlines()) for path in FOLDER.glob("*.py")}
    assert {name: n for name, n in lines.items() if n > MOST_LINES} == {}


def test_the_site_has_ten_of_them_as_they_are() -> None:
    text = (Path(sg.__file__).parent / "docs" / "examples.md").read_text(encoding="utf-8")
    linked = re.findall(r"\(\.\./\.\./scripts/examples/(\w+)\.py\)", text)
    programs = re.findall(r"(?ms)^```python\n(.*?)^```$", mkdocs_hooks.site_page(text))
    assert len(set(linked)) == 10
    assert programs == [(FOLDER / f"{name}.py").read_text(encoding="utf-8") for name in linked]


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with a small volume, and no display."""
    monkeypatch.chdir(tmp_path)
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    np.save("v.npy", sg.scenes.ball(8).samples)
    return tmp_path


# seconds on software OpenGL
SLOW = pytest.param("turntable", marks=pytest.mark.long)


@pytest.mark.few(3)
@pytest.mark.parametrize("name", [SLOW, *(name for name in ARGUMENTS if name not in (*SPAWN, "turntable"))])
def test_examples(name: str, here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    arguments, count = ARGUMENTS[name]
    monkeypatch.setattr(sys, "argv", [name, *arguments])
    # as large as check_pictures needs
    orbit = sg.Camera.orbit
    monkeypatch.setattr(sg.Camera, "orbit", lambda *args, **given: orbit(*args, **given).resized((64, 64)))
    kernels = dict(KERNELS)
    try:
        runpy.run_path(str(FOLDER / f"{name}.py"), run_name="__main__")
    finally:
        KERNELS.clear()
        KERNELS.update(kernels)
    check_pictures(here, count)


def check_pictures(folder: Path, count: int) -> None:
    """There are that many pictures, and none is blank."""
    drawn = [*folder.glob("out*"), *folder.glob("frames/*.png")]
    assert len(drawn) == count
    for path in drawn:
        assert np.asarray(Pillow.open(path).convert("RGBA")).std() > 10


@pytest.mark.long
def test_dask_example(here: Path) -> None:
    pytest.importorskip("distributed", reason="distributed is in the extra scale")
    arguments, count = ARGUMENTS["dask_frames"]
    subprocess.run([sys.executable, FOLDER / "dask_frames.py", *arguments], check=True, capture_output=True)
    check_pictures(here, count)


@pytest.mark.long
def test_pytest_example(here: Path) -> None:
    (here / "test_picture.py").write_text((FOLDER / "test_picture.py").read_text(encoding="utf-8"))
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:napari", "test_picture.py"]
    codes = [
        subprocess.run([*command, *options], check=False, capture_output=True).returncode
        for options in ([], ["--splatgl-update"], [])
    ]
    assert codes == [1, 0, 0]
    assert len(list((here / "baselines" / "test_picture").glob("*.png"))) == 3
