"""Types of the public functions: they are those of the declared options, and checkers find misspelt ones."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import get_args

import keywords
import pytest

from splatgl.options import keyword
from splatgl.splat.settings import BLENDS, Blend

ROOT = Path(__file__).parents[2]

# a checker must refuse the lines that end with "# wrong", and no others
PROGRAM = """
import numpy as np
import splatgl as sg

volume = sg.Volume(np.zeros((4, 4, 4)))
sg.render("a.nii", blend="mipp")  # wrong
sg.render("a.nii", azimut=30)  # wrong
sg.render("a.nii", azimuth="left")  # wrong
sg.render("a.nii", annotate=3)  # wrong
sg.show(volume, light="gloss")  # wrong
sg.show(volume, colourmap="bone")  # wrong
sg.depth_map(volume, elevatoin=3)  # wrong
sg.Settings(blend="mipp")  # wrong
sg.Settings(tolerence=0.1)  # wrong
sg.Settings().replace(technique="cards")  # wrong
sg.Settings.like("0.1", samples="many")  # wrong
sg.load("a.nii", chanel=1)  # wrong
sg.load("a.nii", values="label")  # wrong
sg.Volume.of(np.zeros((4, 4, 4)), spacings=(1, 1, 1))  # wrong
sg.animate("a.nii", "a.gif", turntabel=90)  # wrong
sg.animate("a.nii", "a.gif", frames="many")  # wrong
sg.animate("a.nii", "a.gif", blend="mipp")  # wrong
sg.animate("a.nii", "a.gif", azimut=3).pop().stem  # wrong
sg.render("a.nii", time=slice(3))  # wrong
sg.render("a.nii", colour_of={"DAPI": "blue"})  # wrong
sg.render("a.nii", log="yes")  # wrong
sg.render("a.nii", only_labels=3.5)  # wrong
sg.render("a.nii", preset="mri", color_of={"DAPI": "blue"}, only_labels=[3, 7], layers=[volume])
sg.render("a.nii", labels="s.nii", log=True, window_of={"DAPI": (0, 3)}, mesh="a.stl", like="0.1")
number: int = sg.show(volume)  # wrong
sg.presets()["mri"].uper()  # wrong
sg.animate(["a.nii", volume], "a.mp4", "mri", frames=60, spin=3.0, only=(0, 9), fps=25, axis=(0, 0, 1))[0].stem
sg.animate("a.nii", "a.gif", time=slice(0, 9, 2), workers=2, devices=(0, 1), scheduler=None)
sg.animate(volume, "f/{frame}.png", bits=16, resume=True, keyframes="k.toml", blend="mip", hold=3, size=64)
picture = sg.show(volume)
if isinstance(picture, sg.Image):
    picture.save("a.png")
sg.preset(next(iter(sg.presets())), volume)
sg.render("a.nii", size=(640, 480), window=[0, 3], blend="mip", background="white", azimuth=np.float64(3)).save("a.png")
sg.render(volume, "ct-bone", size="640x480", points=[(0, 0.1), (3.5, 1)], memory="2GiB", clip=["x>0.3"], surfaces=True)
sg.show(volume, eye=np.zeros(3), annotate=["scale", "axes"], streamlines=True, spacing=(1, 1, 2), unit="mm")
sg.Settings(background="#fff", light="glossy", light_from=(3, 4), clip=[(0, 0, 1, 3)]).replace(samples=2).background
sg.load("a.tif", channel="all", array=3)
"""
WRONG = [number for number, line in enumerate(PROGRAM.splitlines(), 1) if line.endswith("# wrong")]


def test_the_keywords_are_those_of_the_declared_options() -> None:
    assert keywords.TARGET.read_text(encoding="utf-8") == keywords.compose(), "python scripts/keywords.py writes them"
    assert tuple(BLENDS) == get_args(Blend)


def test_an_option_without_a_type_is_refused() -> None:
    with pytest.raises(ValueError, match="options without a hint: b"):
        list(keywords.write_class("A", "", {name: keyword(name, hint) for name, hint in (("a", "int"), ("b", ""))}))


def lines_of_errors(output: str) -> list[int]:
    return sorted({int(found) for found in re.findall(r"program\.py:(\d+)(?::\d+)?(?: -)?:? error", output)})


@pytest.mark.long
@pytest.mark.parametrize("checker", ["mypy", "pyright", "basedpyright"])
def test_a_checker_finds_the_mistakes(checker: str, tmp_path: Path) -> None:
    """With the rules that a user's project has by default."""
    path = tmp_path / "program.py"
    path.write_text(PROGRAM, encoding="utf-8")
    if checker == "mypy":
        command = [sys.executable, "-m", "mypy", "--config-file", str(ROOT / "pyproject.toml"), str(path)]
    else:
        if shutil.which(checker) is None:
            pytest.skip(f"{checker} is not installed")
        command = [checker, "--level", "error", "--pythonpath", sys.executable, str(path)]
    ended = subprocess.run(command, capture_output=True, text=True, cwd=ROOT)
    print(ended.stdout, ended.stderr)
    assert lines_of_errors(ended.stdout) == WRONG
