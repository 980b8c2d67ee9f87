"""`scripts/figure explain` prints the right numbers, near the eye too."""

from __future__ import annotations

import numpy as np
import pytest
from paper.__main__ import main
from paper.figures.footprint_errors import ALL
from paper.figures.paper_setup import PAPER

from splatgl.splat.kernels import KERNELS

Lines = dict[str, list[str]]


def explain(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[str, Lines]:
    """The page, and its table by the form's name: worst, off, centre."""
    assert main(["explain", *arguments]) == 0
    text = capsys.readouterr().out
    assert max(len(line) for line in text.splitlines()) <= 78
    table = {line.split()[0]: line.split()[-3:] for line in text.splitlines() if line.split()[:1]}
    return text, {name: table[name.replace("prime", "′")] for name in ALL}


def test_numbers_of_a_far_voxel(capsys: pytest.CaptureFixture[str]) -> None:
    """At the picture's corner at z_k: the worst of the volume, in levels of F(0)/m²."""
    z_k = PAPER.z_k
    text, table = explain(capsys, f"256,256,{z_k + 1e-9!r}", "--kernel", "gaussian")
    assert "443.405" in text and "1/m²  1 " in text
    # row 1's largest value is up to 15 % above F(0) there
    assert 0.256 <= float(table["row2"][0]) <= 0.256 * 1.15
    assert 47.7 <= float(table["row5"][0]) <= 47.8 * 1.15
    assert float(table["bprime"][0]) < 1.2e-3 and table["row1"][0] == "0"
    assert float(table["row5"][2]) < 0.3


@pytest.mark.long
def test_spacing_is_a_unit(capsys: pytest.CaptureFixture[str]) -> None:
    """Twice the spacing at twice the distance is the same splat."""
    one = explain(capsys, "-100,50,600")[1]
    two = explain(capsys, "-200,100,1200", "--spacing", "2")[1]
    assert one == two
    assert explain(capsys, "100,-50,600")[1] == one


def test_stretch(capsys: pytest.CaptureFixture[str]) -> None:
    text, table = explain(capsys, "0,0,886.810013475266")
    assert "m     2 " in text and "1/m²  0.25 " in text
    assert table["row4"][0] == table["row5"][0]


def test_the_eye_inside_of_the_kernel(capsys: pytest.CaptureFixture[str]) -> None:
    text, table = explain(capsys, "0,0,0.5", "--kernel", "gaussian")
    assert "eye is inside the kernel" in text and "half line" in text
    # the half that is behind the eye: F(0) − P(R) − P(1/2), as its share
    shape, nothing = KERNELS["gaussian"], np.zeros(())
    whole = float(shape.footprint(nothing))
    lost = whole - float(shape.partial(nothing, np.array(2.0)) + shape.partial(nothing, np.array(0.5)))
    assert float(table["row1"][2]) == pytest.approx(255 * lost / whole, rel=5e-3)


def test_behind_the_eye(capsys: pytest.CaptureFixture[str]) -> None:
    """Quads behind the eye show nothing; what is missing is what reaches before it."""
    text, table = explain(capsys, "0,0,-1")
    assert "inside the kernel" in text and "behind the eye" in text
    assert float(table["row4"][0]) > 1 and table["b"] == ["–", "–", "–"]


def test_reaching_the_eyes_plane(capsys: pytest.CaptureFixture[str]) -> None:
    text, table = explain(capsys, "3,0,1", "--fov", "120")
    assert "reaches the eye's plane" in text and "inside" not in text
    assert table["c"][0] == "0"
    # far to the other side a ray meets the kernel behind the eye only
    assert float(explain(capsys, "3,0,1", "--fov", "170")[1]["c"][0]) > 1


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["1,2"], "expected 3 numbers"),
        (["1,2,nan"], "X,Y,Z: expected finite numbers"),
        (["1e23,2,100"], "X,Y,Z: expected finite numbers"),
        (["1,2,100", "--spacing", "1e-308"], "spacing: expected a positive length"),
        (["0,0,-2"], "X,Y,Z: expected a voxel in front of the eye"),
        (["1,2,3", "--size", "0"], "size: expected"),
        (["1,2,3", "--fov", "180"], "fov: expected"),
        (["1,2,3", "--kernel", "box"], "--kernel: expected NAME|MODULE:NAME, auto or crawfis-max"),
        (["1,2,3", "--spacing", "0"], "spacing: expected a positive length"),
    ],
)
def test_bad_input_is_one_line(arguments: list[str], message: str, capsys: pytest.CaptureFixture[str]) -> None:
    try:
        code = main(["explain", *arguments])
    except SystemExit as error:
        code = int(error.code or 0)
    said = capsys.readouterr().err.strip()
    assert code == 2 and message in said and said.count("\n") == 0
