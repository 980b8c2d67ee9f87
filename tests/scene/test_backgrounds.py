"""Backgrounds: names of colours, those that are chosen for a picture, and what keeps its alpha."""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
import pytest

import splatgl as sg
from splatgl.cli.main import main
from splatgl.data.color import AUTO, CLEAR, read_background
from splatgl.options import declared
from splatgl.scene.open_scene import BLACK, WHITE, OpenScene, default_background
from splatgl.scene.scene_file import SceneFile

SURFACE = sg.Transfer([(0.4, 0.0), (0.6, 0.9)])
GLOW = sg.Transfer([(0.4, 0.0), (0.6, 0.9)], shading=False)
SAME = ["--size", "20", "--check", "0"]


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    place = np.linalg.norm(np.indices((12, 12, 12)) - 5.5, axis=0)
    np.save("ball.npy", (8 - place).astype(np.float32).round(1))
    return tmp_path


def corner(name: str) -> list[float]:
    found: list[float] = sg.Image.load(name).pixels[0, 0].tolist()
    return found


@pytest.mark.parametrize(
    ("text", "right"),
    [
        ("black", BLACK),
        ("White", WHITE),
        ("#fff", WHITE),
        ("#ff0000", (1.0, 0.0, 0.0)),
        ("lime", (0.0, 1.0, 0.0)),
        ("gray", (0.2158605,) * 3),
        ("#808080", (0.2158605,) * 3),
        ("transparent", CLEAR),
        ("auto", AUTO),
    ],
)
def test_names_of_colours(text: str, right: object) -> None:
    assert read_background(text) == pytest.approx(right)


@pytest.mark.parametrize("text", ["", "blak", "#12", "#gggggg", "rgb(1,2)", "#11223344", "a" * 100_000])
def test_bad_colours(text: str) -> None:
    with pytest.raises(argparse.ArgumentTypeError, match=r"expected auto, transparent.*CSS"):
        declared(sg.Settings)["background"].kind.parse(text)


def test_what_suits() -> None:
    assert default_background(SURFACE, sg.Settings()) == WHITE
    assert default_background(GLOW, sg.Settings()) == default_background(SURFACE, sg.Settings(blend="mip")) == BLACK
    assert (
        default_background(GLOW, sg.Settings(shading="on")) == WHITE
        and default_background(SURFACE, sg.Settings(shading="off")) == BLACK
    )


@pytest.mark.parametrize(
    ("settings", "is_auto", "background"),
    [
        (sg.Settings(), True, WHITE),
        (sg.Settings(), False, None),
        (sg.Settings(background=BLACK), False, BLACK),
        (sg.Settings(blend="mip"), True, BLACK),
        (sg.Settings(blend="xray"), True, None),
    ],
)
def test_the_default_background_of_a_scene(settings: sg.Settings, is_auto: bool, background: object) -> None:
    volume = sg.Volume(np.indices((4, 4, 4))[0].astype(np.float32))
    file = SceneFile("ramp", transfer=SURFACE.fields, settings=settings, auto_background=is_auto)
    assert OpenScene.of(file, volume).file.settings.background == background


def test_a_picture_has_a_background(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["render", "ball.npy", "-o", "a.png", *SAME]) == 0
    assert "splats on white" in capsys.readouterr().out
    assert corner("a.png") == [1.0] * 4
    assert main(["render", "ball.npy", "-o", "b.png", *SAME, "--preset", "microscopy"]) == 0
    assert "splats on black" in capsys.readouterr().out
    assert corner("b.png") == [0.0, 0.0, 0.0, 1.0]
    assert main(["render", "ball.npy", "-o", "c.png", *SAME, "--background", "transparent"]) == 0
    assert main(["render", "ball.npy", "-o", "c.npy", *SAME]) == 0
    assert main(["render", "ball.npy", "-o", "d.png", *SAME, "--like", "0.1"]) == 0
    assert "splats on " not in capsys.readouterr().out
    assert corner("c.png") == corner("c.npy") == corner("d.png") == [0.0] * 4


def test_channels_are_on_black(here: Path) -> None:
    """They glow, in whatever look each would have alone."""
    tifffile = pytest.importorskip("tifffile")
    ball = (np.load("ball.npy") + 14).astype(np.uint8)
    tifffile.imwrite("c.ome.tif", np.stack([ball, ball]), ome=True, metadata={"axes": "CZYX"}, photometric="minisblack")
    for channel, color in (("all", 0.0), ("0", 1.0)):
        assert main(["render", "c.ome.tif", "--channel", channel, "-o", "c.png", *SAME]) == 0
        assert corner("c.png") == [color] * 3 + [1.0]


def test_frames_have_a_background(here: Path) -> None:
    draw = ["animate", "ball.npy", "--frames", "2", "--size", "16", "--quiet"]
    assert main([*draw, "-o", "f{frame}.png"]) == 0 and main([*draw, "-o", "f{frame}.npy"]) == 0
    assert corner("f1.png") == [1.0] * 4 and corner("f1.npy") == [0.0] * 4


def test_a_scene_says_its_background(here: Path) -> None:
    Path("s.toml").write_text('volume = "ball.npy"\n[settings]\nbackground = [0, 0, 1]\n')
    assert main(["render", "s.toml", "-o", "a.png", *SAME]) == 0
    assert corner("a.png") == [0.0, 0.0, 1.0, 1.0]
    Path("t.toml").write_text('volume = "ball.npy"\n')
    assert main(["render", "t.toml", "-o", "t.png", *SAME]) == 0
    assert corner("t.png") == [0.0] * 4
    assert main(["render", "s.toml", "-o", "b.png", *SAME, "--background", "auto"]) == 0
    assert corner("b.png") == [1.0] * 4
    assert main(["render", "s.toml", "-o", "c.png", *SAME, "--background", "transparent"]) == 0
    assert corner("c.png") == [0.0] * 4


@pytest.mark.parametrize("behind", [None, "transparent", "black", "#336699"])
def test_a_reference_has_the_background_that_it_was_drawn_on(here: Path, behind: str | None) -> None:
    options = [] if behind is None else ["--background", behind]
    assert main(["render", "ball.npy", "-o", "right.png", *SAME, *options]) == 0
    assert main(["render", "ball.npy", "-o", "new.png", *SAME, "--ref", "right.png"]) == 0
    other = "white" if behind != "white" and behind is not None else "black"
    assert main(["render", "ball.npy", "-o", "new.png", *SAME, "--ref", "right.png", "--background", other]) == 1


def test_python_is_transparent(renderer: sg.Renderer) -> None:
    assert sg.Settings().background is None
