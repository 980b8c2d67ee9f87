"""Equal pictures are equal files: in every run, at any time, and by every door."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import splatgl as sg
from splatgl.cli.main import main
from splatgl.data.image import Accuracy
from splatgl.gl.renderer import Renderer
from splatgl.scene.scene_file import SceneFile
from splatgl.viewer.document import Document
from splatgl.viewer.saving import save_picture, scene_of
from splatgl.viewer.state import State
from tests.helpers.doors import command
from tests.helpers.memory import allow_any_memory

LIBRARIES = {".tif": "tifffile", ".exr": "OpenEXR", ".pdf": "matplotlib", ".svg": "matplotlib", ".mp4": "av"}
LIBRARIES[".webm"] = "av"
DAY = 86_400.0
# pictures without a bound, with one, of several layers, of sums, of slices, with annotations, and with occlusion
LOOKS: dict[str, list[str]] = {
    "default": [],
    "bound": ["--like", "0.1"],
    "layers": ["--layer", "ball.npy:hot:0.5"],
    "sums": ["--blend", "xray", "--background", "#336699"],
    "slices": ["--slice", "z=50%"],
    "annotated": ["--annotate", "scale,box", "--size", "72"],
    "occlusion": ["--ambient-occlusion", "0.5"],
    "unused": ["--samples", "3"],
}


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    place = np.linalg.norm(np.indices((12, 12, 12)) - 5.5, axis=0)
    np.save("ball.npy", (8 - place).astype(np.float32).round(1))
    return tmp_path


@pytest.fixture
def pass_a_year(monkeypatch: pytest.MonkeyPatch) -> Any:
    """A function after whose call it is another day, and all takes another time."""
    clocks = {name: getattr(time, name) for name in ("time", "perf_counter")}

    def change() -> None:
        for name, clock in clocks.items():
            monkeypatch.setattr(time, name, lambda clock=clock: 3 * clock() + 365 * DAY)

    return change


def content(name: str) -> bytes:
    return Path(name).read_bytes()


@pytest.mark.parametrize("suffix", [".png", ".jpg", ".tif", ".exr", ".pdf", ".svg", ".npy"])
def test_two_runs_write_the_same(suffix: str, pass_a_year: Any) -> None:
    if suffix in LIBRARIES:
        pytest.importorskip(LIBRARIES[suffix])
    draw = ("render", "ball.npy", "--size", "72", "--annotate", "scale", "--ambient-occlusion", "0.5", "--quiet", "-o")
    command(*draw, f"a{suffix}")
    pass_a_year()
    command(*draw, f"b{suffix}")
    assert content(f"a{suffix}") == content(f"b{suffix}")


@pytest.mark.parametrize("suffix", [".nii.gz", ".nrrd", ".mha", ".ome.tif", ".npy"])
def test_two_runs_convert_to_the_same(suffix: str, pass_a_year: Any) -> None:
    if suffix == ".ome.tif":
        pytest.importorskip("tifffile")
    command("convert", "ball.npy", f"a{suffix}")
    pass_a_year()
    command("convert", "ball.npy", f"b{suffix}")
    assert content(f"a{suffix}") == content(f"b{suffix}")


@pytest.mark.parametrize("suffix", [".gif", ".mp4", ".webm"])
def test_two_runs_write_the_same_movie(suffix: str, pass_a_year: Any) -> None:
    if suffix in LIBRARIES:
        pytest.importorskip(LIBRARIES[suffix])
    sg.animate("ball.npy", f"a{suffix}", frames=3, size=32)
    pass_a_year()
    command("animate", "ball.npy", "-o", f"b{suffix}", "--frames", "3", "--size", "32", "--quiet")
    assert content(f"a{suffix}") == content(f"b{suffix}")


@pytest.mark.parametrize("look", LOOKS)
def test_doors_write_the_same(look: str, renderer: Renderer) -> None:
    """Command, batch, Python and, in a view of its own, the window; a picture without a bound states its errors."""
    options = ["--size", "24", *LOOKS[look]]
    command("render", "ball.npy", "-o", "a.png", *options)
    command("render", "ball.npy", "-o", "{name}-b.png", *options, "--quiet")
    names = [name.removeprefix("--").replace("-", "_") for name in LOOKS[look][::2]]
    plain: dict[str, Any] = {"size": 24, **dict(zip(names, LOOKS[look][1::2], strict=True))}
    plain |= {name: int(plain[name]) for name in ("size", "samples") if name in plain}
    plain |= {"ambient_occlusion": 0.5} if look == "occlusion" else {}
    renamed = {"layer": "layers", "slice": "slices"}
    image = sg.render("ball.npy", **{renamed.get(name, name): value for name, value in plain.items()})
    image.save("c.png")
    assert content("a.png") == content("ball-b.png") == content("c.png")
    info = sg.Image.load("c.png").info
    assert "seconds" not in str(info) and ("checked" in info) == (look not in ("bound", "slices"))
    if look == "slices":
        return
    document = Document.open(SceneFile("ball.npy").with_options(**image_options(plain, renamed)), quiet=True)
    state = State.of(document, (72, 72))
    save_picture(state, document, renderer.render, Path())
    Path("scene.toml").write_text(scene_of(state, document, on_paper=False).to_toml(Path()))
    sg.render("scene.toml").save("d.png")
    assert content("picture-001.png") == content("d.png")


def image_options(plain: dict[str, Any], renamed: dict[str, str]) -> dict[str, Any]:
    options = {renamed.get(name, name): value for name, value in plain.items()}
    return {**options, "layers": (SceneFile.read(options["layers"]),)} if "layers" in options else options


def test_a_comparison_by_time_is_not_stored(capsys: pytest.CaptureFixture[str]) -> None:
    """The number of its pixels differs in each run: it is printed, and the file says so."""
    draw = ["render", "ball.npy", "--size", "24", "-o"]
    assert main([*draw, "a.png", "--check", "0.01s"]) == 0 and main([*draw, "b.png", "--check", "0.02s"]) == 0
    assert capsys.readouterr().out.count("checked pixels") == 2
    assert content("a.png") == content("b.png")
    assert sg.Image.load("a.png").info["checked"] == "of as many pixels as a time allows: not stored"
    assert sg.Image.load("a.png").accuracy.checked is None


@pytest.mark.parametrize("look", ["default", "bound", "layers", "sums"])
def test_accuracy_on_demand_is_that_of_the_command(look: str, capsys: pytest.CaptureFixture[str]) -> None:
    """Its numbers, and its words; of annotated pictures that of the picture below."""
    draw = ["render", "ball.npy", "--size", "72", "-o", "a.png", "--check", "60", *LOOKS[look]]
    assert main(draw) == 0
    said, info = capsys.readouterr().out, sg.Image.load("a.png").info
    names = {"like": "like", "layer": "layers", "blend": "blend", "background": "background"}
    options: Any = dict(zip((names[name[2:]] for name in LOOKS[look][::2]), LOOKS[look][1::2], strict=True))
    for annotate in (None, "scale"):
        image = sg.render("ball.npy", size=72, annotate=annotate, **options)
        assert "checked" not in image.info
        accuracy = image.accuracy
        assert isinstance(accuracy, Accuracy) and accuracy is image.accuracy
        assert accuracy.checked == info["checked"] and accuracy.error_bound == info["error_bound"]
        assert accuracy.tolerance_met is (None if look in ("default", "layers") else info["tolerance_met"])
        assert accuracy.summary in said and str(accuracy).endswith(accuracy.comparisons[0])


def test_accuracy_of_a_renderer_of_bricks_and_of_files(renderer: Renderer, monkeypatch: pytest.MonkeyPatch) -> None:
    allow_any_memory(monkeypatch)
    volume = sg.load("ball.npy")
    splats = sg.extract(volume, sg.default_transfer(volume))
    camera = sg.Camera.orbit(volume, size=(24, 24))
    image = renderer.render(splats, camera)
    assert image.accuracy.checked == sg.check(image, splats, camera).info["checked"]
    assert image.info["tolerance_met"] is None is image.accuracy.tolerance_met
    bricks = sg.render("ball.npy", size=64, memory="1MiB")
    assert bricks.info["bricks"] and bricks.accuracy.checked is not None and bricks.accuracy.checked["pixels"] == 10
    image.save("a.png")
    read = sg.Image.load("a.png")
    assert read.accuracy == image.accuracy
    unknown = sg.Image(np.zeros((4, 4, 4))).accuracy
    assert unknown == Accuracy(None, None, None) and str(unknown) == "its error is not known"


def test_the_tolerance_of_sums_is_a_part_of_the_brightest_pixel() -> None:
    accuracy = Accuracy(0.03, 0.004, True, brightest=8.0)
    assert accuracy.summary == "error at most 0.03, within the tolerance 0.032 of 8"
    assert str(accuracy) == "error bound 0.03: the tolerance 0.032 of 8 is met"
    plain = Accuracy(0.03, 0.004, False)
    assert plain.summary == "error at most 0.03, above the tolerance 0.004"


def test_unchecked_pictures_say_nothing() -> None:
    command("render", "ball.npy", "--size", "24", "-o", "a.png", "--check", "0", "--quiet")
    assert "checked" not in sg.Image.load("a.png").info
    sg.render("ball.npy", size=24).save("b.png", checked=False)
    assert Path("b.png").read_bytes() == Path("a.png").read_bytes()
