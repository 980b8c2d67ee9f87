"""The paper's rendered figures: panels pixel for pixel, letters, numbers; from any volume."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
from paper.__main__ import main
from paper.figures import rendered
from paper.figures.rendered import (
    GAP,
    INK,
    MARGIN,
    PAPER,
    PICTURES,
    ROOM,
    RenderedFigure,
    by_moments,
    enlarge,
    sheet,
    wrapped,
)
from PIL import Image

import splatgl as sg
from splatgl.scene.scene_file import SceneFile
from splatgl.scene.view import ViewOptions
from tests.helpers.splatting import SPLATS
from tests.paper.helpers import refused

DATA = Path(os.environ.get("SPLATGL_DATA", Path(__file__).parents[3] / "shared" / "data"))


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def page(path: str = "f.png") -> np.ndarray:
    with Image.open(path) as picture:
        return np.asarray(picture)


@pytest.fixture
def brief(monkeypatch: pytest.MonkeyPatch) -> None:
    """Captions that fit below small pictures."""
    monkeypatch.setattr(rendered, "VARIANTS", "ijkl")


def test_panels_are_pixel_for_pixel(rng: np.random.Generator) -> None:
    first, second = rng.random((2, 4, 5, 3))
    line = np.zeros((32, 40), bool)
    line[2, 3] = True
    found = sheet([[(enlarge(first, 8), "one"), (enlarge(second, 8, line), "two")], [(enlarge(first, 3), "")]])
    shown = np.rint(sg.Image(np.dstack([first, np.ones((4, 5))])).straight()[..., :3] * 255)
    assert (found[MARGIN : MARGIN + 32 : 8, MARGIN : MARGIN + 40 : 8] == shown).all()
    left = MARGIN + 40 + GAP
    assert tuple(found[MARGIN + 2, left + 3]) == INK and tuple(found[MARGIN + 1, left + 3]) == PAPER
    top = MARGIN + 32 + ROOM + GAP
    top += len(found) - (top + 12 + ROOM + MARGIN)
    assert (found[top : top + 12 : 3, MARGIN : MARGIN + 15 : 3] == shown).all()
    # letters stand below the first row, none below the second
    assert (found[MARGIN + 32 : top] < 128).any() and not (found[top + 12 :] < 128).any()


@pytest.mark.parametrize("side", [192, 96, 40])
def test_captions_are_whole(side: int) -> None:
    """No word leaves the page, and none touches that of another picture."""
    blank = np.full((8, side, 3), 255, np.uint8)
    both = sheet([[(blank, words) for words in rendered.VARIANTS[2:]]])
    inked = np.flatnonzero((both < 128).any(axis=(0, 2)))
    assert inked[0] >= MARGIN and inked[-1] < both.shape[1] - MARGIN and np.diff(inked).max() >= GAP - 2
    assert [wrapped("(d) motion-blurred and antialiased", width, 15) for width in (1000, 1)] == [
        ["(d) motion-blurred and antialiased"],
        ["(d)", "motion-blurred", "and", "antialiased"],
    ]


@pytest.mark.long
def test_figure_5_is_the_tunnel_twice(here: Path, renderer: sg.Renderer, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["5", "-o", "f.png", "--size", "60"]) == 0
    assert "Figure 5. A tunnel" in capsys.readouterr().out
    found = page()
    scene = SceneFile("tunnel", view=ViewOptions(size=(60, 60)))
    volume = scene.open()
    splats = sg.extract(volume, scene.transfer_for(volume), classification="pre")
    camera = scene.view.camera(volume, splats)
    for panel, name in enumerate(("off", "paper")):
        right = renderer.render(splats, camera, SPLATS.replace(antialias=name, background=(0, 0, 0)))
        shown = np.rint(right.straight()[..., :3] * 255)
        left = MARGIN + panel * (180 + GAP)
        drawn = found[MARGIN : MARGIN + 180, left : left + 180].reshape(60, 3, 60, 3, 3)[:, 1, :, 1]
        # all but the line at z_k, of which little lies in a picture of 60 pixels
        assert (drawn == shown).all(axis=-1).mean() > 0.93
    with Image.open("f.png") as picture:
        assert picture.info["Description"] == PICTURES[5].caption


@pytest.mark.usefixtures("brief")
@pytest.mark.parametrize("number", ["5", "13"])
def test_figures_by_the_hardware_path(
    here: Path, renderer: sg.Renderer, capsys: pytest.CaptureFixture[str], number: str
) -> None:
    """Panel (b) is the picture of `--paper` and `--kernel`, pixel for pixel; the caption says so."""
    asked = ["--size", "32", "--paper", "--kernel", "gaussian", *(["--moments", "0"] if number == "13" else [])]
    assert main([number, "letter-f", "-o", "f.png", *asked]) == 0
    assert "kernel gaussian, by the hardware path of 1998." in " ".join(capsys.readouterr().out.split())
    figure = PICTURES[int(number)]
    scene = SceneFile("letter-f", view=ViewOptions(size=(32, 32)))
    shown = RenderedFigure(figure, scene, renderer.render)
    camera, ground = shown.track.camera(1 if figure.spin else 0), figure.background
    settings = sg.Settings.paper(kernel="gaussian", background=ground)
    right = np.rint(renderer.render(shown.splats, camera, settings).straight()[..., :3] * 255)
    width, times = 32 * figure.times, figure.times
    drawn = page()[MARGIN:, MARGIN + width + GAP :][: -MARGIN - ROOM, :width][::times, ::times]
    rows = [top for top in range(33 - len(drawn)) if (drawn == right[top : top + len(drawn)]).all(axis=-1).mean() > 0.9]
    assert rows and len(drawn) > 8


def test_numbers_of_another_kernel(renderer: sg.Renderer) -> None:
    scene = SceneFile("letter-f", view=ViewOptions(size=(8, 8))).with_options(kernel="gaussian")
    shown = RenderedFigure(PICTURES[5], scene, renderer.render)
    assert {(blend, kernel) for blend, kernel, _ in shown.kinds} == {("xray", "gaussian"), ("composite", "gaussian")}


@pytest.mark.usefixtures("brief")
def test_figure_12_has_four_panels_of_the_users_volume(here: Path) -> None:
    assert main(["12", "letter-f", "-o", "f.png", "--size", "40", "--moments", "5", "--spin", "120"]) == 0
    four = page()
    assert main(["12", "letter-f", "-o", "g.png", "--size", "40", "--moments", "0", "--spin", "120"]) == 0
    two = page("g.png")
    assert four.shape[1] == two.shape[1] == 80 + GAP + 2 * MARGIN and four.shape[0] > 1.7 * two.shape[0]
    # the blurred ones are blurred: there is less contrast in them
    height = (four.shape[0] - 2 * MARGIN - 2 * ROOM - GAP) // 2
    panels = [
        four[MARGIN + row * (height + ROOM + GAP) :][:height, MARGIN : MARGIN + 40].astype(float) for row in (0, 1)
    ]
    steps = [(np.diff(p, axis=1) ** 2).sum() for p in panels]
    assert steps[1] < 0.7 * steps[0]


@pytest.mark.usefixtures("brief")
def test_figures_blur_from_frame_to_frame_unless_a_shutter_says_otherwise(
    here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The paper's streak runs from t−1 to t. Contrast falls with the exposure."""
    panels = []
    for shutter in ((), ("--shutter", "360"), ("--shutter", "45")):
        command = ["12", "letter-f", "-o", "f.png", "--size", "32", "--moments", "8", "--spin", "60"]
        assert main([*command, *shutter]) == 0
        assert f"60° a frame, shutter {shutter[1] if shutter else 360}°" in " ".join(capsys.readouterr().out.split())
        panels.append(page()[-MARGIN - ROOM - 20 : -MARGIN - ROOM, MARGIN : MARGIN + 32].astype(float))
    whole, said, short = ((np.diff(panel, axis=1) ** 2).sum() for panel in panels)
    assert whole == said and whole < 0.8 * short


@pytest.mark.usefixtures("brief")
def test_figure_14_abuts_columns_of_blocks(here: Path, renderer: sg.Renderer) -> None:
    assert main(["14", "letter-f", "-o", "f.png", "--size", "32", "--frames", "7", "--moments", "2"]) == 0
    found = page()
    strip = found[MARGIN:, MARGIN : MARGIN + 35]
    height = found.shape[0] - 2 * MARGIN
    blocks = strip[: (height - 2 * ROOM - GAP) // 2].reshape(-1, 5, 7, 5, 3)
    assert (blocks == blocks[:, :1, :, :1]).all()
    scene = SceneFile("letter-f", view=ViewOptions(size=(32, 32)))
    shown = RenderedFigure(PICTURES[14], scene, renderer.render, by_moments(2))
    strips = shown.strips(1.0, 7)
    assert len(strips) == 4 and strips[0].shape == (16, 7, 4)
    # the first column is the middle one of the first frame
    first = renderer.render(shown.splats, shown.camera, shown.settings(0)).pixels[:16, 16]
    assert np.abs(strips[0][:, 0] - first).max() < 1e-5


@pytest.mark.long
def test_numbers_of_still_figures(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["5", "letter-f", "--numbers", "--size", "16"]) == 0
    said = capsys.readouterr().out
    for words in ("beyond z_k", "aliasing energy, antialiased (fill)", "gaussian", "mean squared error", "changes"):
        assert words in said
    assert "against standard" in said and len(said.splitlines()) > 12 and not list(here.iterdir())


@pytest.mark.long
def test_numbers_of_turning_figures(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["13", "letter-f", "--numbers", "--size", "12", "--moments", "2"]) == 0
    said = capsys.readouterr().out
    for words in ("at 1°: (a)", "at 1°: (d)", "at 5°: (c)", "longest path", "popping", "beyond z_k", "aliasing energy"):
        assert words in said
    for words in ("energy of blurred splats", "16 moments: (d)", "noise at these depths"):
        assert words in said


def test_real_terrain_is_seen_from_low(here: Path) -> None:
    folder = DATA / "terrain_puget"
    if not folder.is_dir():
        pytest.skip("no terrain_puget: set SPLATGL_DATA")
    load = {"color": str(folder / "texture_1024.png")}
    scene = SceneFile(str(folder / "height_u8_512.png"), load=load, view=ViewOptions(size=(48, 48)))
    shown = RenderedFigure(PICTURES[13], scene, lambda *_: sg.Image(np.zeros((48, 48, 4))))
    eye = shown.camera.eye_from_points(shown.splats.outline)
    assert (eye[:, 2] > 0).all() and np.abs(eye[:, 0] / eye[:, 2]).max() < 0.75
    assert shown.camera.forward[2] > -0.6


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["5", "-o", "a.svg"], "a name that ends in .png"),
        (["5", "--spin", "3"], "figure 5: expected no --spin"),
        (["6", "--frames", "3"], "figure 6: expected no --frames"),
        (["12", "--spin", "0"], "--spin: expected an angle"),
        (["5", "--shutter", "90"], "figure 5: expected no --shutter"),
        (["12", "--shutter", "361"], "--shutter: expected an angle up to 360 degrees"),
        (["14", "--frames", "1"], "--frames: expected"),
        (["13", "--moments", "-1"], "--moments: expected"),
        (["5", "nothing.nrrd"], "nothing.nrrd"),
        (["3", "letter-f"], "figure 3: expected no picture options"),
        (["5", "--size", "no"], "argument --size"),
    ],
)
def test_bad_input_is_one_line(
    arguments: list[str], message: str, here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    refused(arguments, message, here, capsys)
