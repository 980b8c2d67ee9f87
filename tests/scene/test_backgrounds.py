"""Backgrounds: names of colours, those that are chosen for a picture, and what keeps its alpha."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import splatgl as sg
from splatgl.cli.main import main
from splatgl.data.color import AUTO, CLEAR, read_background
from splatgl.options import declared
from splatgl.scene.open_scene import BLACK, WHITE, OpenScene, with_background
from splatgl.scene.scene_file import SceneFile

pytestmark = pytest.mark.usefixtures("shared_programs")

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


@pytest.mark.parametrize(
    ("settings", "is_lit", "right"),
    [
        ({}, True, WHITE),
        ({}, False, BLACK),
        ({"blend": "mip"}, True, BLACK),
        ({"blend": "xray"}, True, None),
        ({"shading": "on"}, False, WHITE),
        ({"shading": "off"}, True, BLACK),
        ({"background": "transparent"}, True, None),
        ({"background": None}, True, None),
        ({"background": BLACK}, True, BLACK),
    ],
)
def test_the_default_background(settings: dict[str, Any], is_lit: bool, right: object) -> None:
    assert with_background(sg.Settings(**settings), is_lit).background == right
    transfer = (SURFACE if is_lit else GLOW).fields
    volume = sg.Volume(np.indices((4, 4, 4))[0].astype(np.float32))
    file = SceneFile("ramp", transfer=transfer, settings=sg.Settings(**settings))
    assert OpenScene.of(file, volume).file.settings.background == right


def test_a_picture_has_a_background(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["render", "ball.npy", "-o", "a.png", *SAME]) == 0
    assert "splats on white" in capsys.readouterr().out
    assert corner("a.png") == [1.0] * 4
    assert main(["render", "ball.npy", "-o", "b.png", *SAME, "--preset", "microscopy"]) == 0
    assert "splats on black" in capsys.readouterr().out
    assert corner("b.png") == [0.0, 0.0, 0.0, 1.0]
    assert main(["render", "ball.npy", "-o", "c.png", *SAME, "--background", "transparent"]) == 0
    assert main(["render", "ball.npy", "-o", "d.png", *SAME, "--like", "0.1"]) == 0
    assert "splats on " not in capsys.readouterr().out
    assert corner("c.png") == corner("d.png") == [0.0] * 4


@pytest.mark.parametrize("suffix", [".npy", ".png", ".jpg", ".tif", ".exr", ".pdf", ".svg"])
@pytest.mark.parametrize("options", [{}, {"blend": "mip"}, {"background": "#336699"}, {"background": "transparent"}])
def test_all_files_of_all_doors_have_one_background(here: Path, suffix: str, options: dict[str, str]) -> None:
    if suffix in (".tif", ".exr", ".pdf", ".svg"):
        pytest.importorskip({".tif": "tifffile", ".exr": "OpenEXR"}.get(suffix, "matplotlib"))
    given = [word for name, value in options.items() for word in (f"--{name}", value)]
    command = ["render", "ball.npy", "-o", f"a{suffix}", "--size", "20", "--quiet", *given]
    if suffix == ".jpg" and options == {"background": "transparent"}:
        assert main(command) == 2
        with pytest.raises(sg.InputError, match="expected an opaque picture, got transparent pixels; name a"):
            sg.render("ball.npy", size=20, **options).save("a.jpg")
        return
    image = sg.render("ball.npy", size=20, **options)
    image.save(f"b{suffix}")
    assert main(command) == 0
    assert Path(f"a{suffix}").read_bytes() == Path(f"b{suffix}").read_bytes()
    right = {"mip": [0, 0, 0, 1], "#336699": [0.0331048, 0.132868, 0.318547, 1], "transparent": [0] * 4}
    assert image.pixels[0, 0].tolist() == pytest.approx(right.get(next(iter(options.values()), ""), [1] * 4), 1e-5)


def test_python_has_the_background_of_the_command(here: Path) -> None:
    """Of files, arrays, scenes of layers, splats and scene files; a renderer takes what its settings state."""
    Path("s.toml").write_text('volume = "ball.npy"\n')
    volume = sg.load("ball.npy")
    for transfer, ground in ((SURFACE, WHITE), (GLOW, BLACK)):
        scene, splats = sg.Scene([sg.Layer(volume, transfer)]), sg.extract(volume, transfer)
        for x, look in (
            ("ball.npy", transfer),
            (volume, transfer),
            ("s.toml", transfer),
            (scene, None),
            (splats, None),
        ):
            assert sg.render(x, look, size=12).pixels[0, 0].tolist() == [*ground, 1.0]
            assert not sg.render(x, look, size=12, background="transparent").pixels[0, 0].any()
    assert sg.render("ball.npy", size=12, like="0.1").pixels[0, 0, 3] == 0


def test_a_jpeg_of_sums_is_on_black(here: Path) -> None:
    """Black is no sum; a background that is stated lies behind the sums of all files of samples."""
    sg.render("ball.npy", size=12, blend="xray").save("a.jpg")
    # but for the ripples of 8×8 pixels
    assert corner("a.jpg") == pytest.approx([0.0, 0.0, 0.0, 1.0], abs=2e-3)
    sg.render("ball.npy", size=12, blend="xray", background="white").save("b.png")
    assert corner("b.png") == [1.0] * 4


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
    assert corner("f1.png") == corner("f1.npy") == [1.0] * 4


def test_a_scene_says_its_background(here: Path) -> None:
    Path("s.toml").write_text('volume = "ball.npy"\n[settings]\nbackground = [0, 0, 1]\n')
    assert main(["render", "s.toml", "-o", "a.png", *SAME]) == 0
    assert corner("a.png") == [0.0, 0.0, 1.0, 1.0]
    Path("t.toml").write_text('volume = "ball.npy"\n')
    assert main(["render", "t.toml", "-o", "t.png", *SAME]) == 0
    assert corner("t.png") == [1.0] * 4
    Path("u.toml").write_text(SceneFile("ball.npy", settings=sg.Settings(background="transparent")).to_toml())
    assert main(["render", "u.toml", "-o", "u.png", *SAME]) == 0
    assert corner("u.png") == [0.0] * 4
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
