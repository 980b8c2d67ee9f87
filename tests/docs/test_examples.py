"""The examples run, and draw something."""

from __future__ import annotations

import runpy
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image as Pillow

import splatgl as sg
from splatgl.splat.kernels import KERNELS

FOLDER = Path(__file__).parents[2] / "scripts" / "examples"
ARGUMENTS = {
    "render_a_file": ["v.npy", "out.png"],
    "points": ["out.png"],
    "own_kernel": ["out.png"],
    "compare_settings": ["out.png"],
    "turntable": ["v.npy", "frames", "2"],
}


def test_every_example_is_run() -> None:
    assert {path.stem for path in FOLDER.glob("*.py")} == ARGUMENTS.keys()


@pytest.mark.few(1)
@pytest.mark.parametrize("name", ARGUMENTS)
def test_examples(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", [name, *ARGUMENTS[name]])
    np.save("v.npy", sg.scenes.ball(8).samples)
    kernels = dict(KERNELS)
    try:
        runpy.run_path(str(FOLDER / f"{name}.py"), run_name="__main__")
    finally:
        KERNELS.clear()
        KERNELS.update(kernels)
    drawn = [*tmp_path.glob("out.png"), *tmp_path.glob("frames/*.png")]
    assert len(drawn) == (2 if name == "turntable" else 1)
    for path in drawn:
        assert np.asarray(Pillow.open(path)).std() > 10


def test_the_documentation_has_every_public_name(tmp_path: Path) -> None:
    pdoc = pytest.importorskip("pdoc", reason="scripts/docs needs pdoc; it is in the extra dev")
    for name in sg.__all__:
        getattr(sg, name)
    pdoc.pdoc("splatgl", output_directory=tmp_path)
    page = (tmp_path / "splatgl.html").read_text(encoding="utf-8")
    modules = {"__version__", "distributed", "scenes", "reference"}
    assert [name for name in sg.__all__ if f'id="{name}"' not in page and name not in modules] == []
