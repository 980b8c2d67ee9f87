"""`splatgl compare` and `render --ref` as users run them: exit codes, folders, JSON, the report, and bad input."""

from __future__ import annotations

import json
import os
import re
import shlex
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from PIL import Image as Pillow

import splatgl as sg
from splatgl.cli.main import main
from splatgl.comparison.pairs import FilePair, compare_all, compare_files
from splatgl.comparison.pictures import find_pairs
from splatgl.comparison.verdict import Criteria

pytestmark = pytest.mark.usefixtures("shared_programs")

RIGHT = sg.Image.load(Path(__file__).parents[1] / "comparison" / "baselines" / "test_scenes" / "letter-f-composite.png")


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """right.png, wrong.png (a red pixel at column 20, row 30), and the same as 16 bits and as floats."""
    monkeypatch.chdir(tmp_path)
    pixels = RIGHT.pixels.copy()
    pixels[30, 20] = (1, 0, 0, 1)
    RIGHT.save("right.png")
    RIGHT.save("right16.png", bits=16)
    RIGHT.save("right.npy")
    sg.Image(pixels).save("wrong.png")
    return tmp_path


Said = pytest.CaptureFixture[str]


@pytest.mark.parametrize("other", ["right.png", "right16.png", "right.npy"])
def test_the_same_in_any_precision(other: str, here: Path, capsys: Said) -> None:
    assert main(["compare", "right.png", other]) == 0
    assert main(["compare", other, "right.png"]) == 0
    out = capsys.readouterr().out
    assert "right.png: same: maximum 0," in out


def test_different_says_where_and_how_much(here: Path, capsys: Said) -> None:
    assert main(["compare", "wrong.png", "right.png"]) == 1
    out = capsys.readouterr().out
    assert "wrong.png: different: one wrong pixel; columns 20–20, rows 30–30 (1×1 of 96×72), worst 1 at" in out
    assert "rmse 0." in out and "> 0.0003922" in out


@pytest.mark.parametrize(
    ("options", "code"),
    [
        (["--max-rmse", "0.1"], 0),
        (["--max-rmse", "0.001"], 1),
        (["--max-share", "0.001"], 0),
        (["--max-share", "0.001", "--max-difference", "1/2"], 1),
        (["--tolerance", "1"], 0),
        (["--tolerance", "0.5"], 1),
        (["--tolerance", "0.5", "--max-difference", "1"], 1),
        (["--tolerance", "1", "--max-difference", "0.5"], 1),
        (["--max-bias", "0.1"], 0),
        (["--max-bias", "0.0001"], 1),
        (["--max-unmatched", "0"], 1),
        (["--threshold", "1"], 1),
        (["--threshold", "1", "--max-share", "0"], 0),
        (["--min-psnr", "30"], 0),
        (["--min-psnr", "60"], 1),
        (["--min-ssim", "0.9"], 0),
        (["--min-ssim", "0.99999"], 1),
    ],
)
def test_limits(options: list[str], code: int, here: Path) -> None:
    assert main(["compare", "wrong.png", "right.png", *options]) == code


def test_flip_limit(here: Path) -> None:
    pytest.importorskip("flip_evaluator", reason="flip-evaluator is in the extra compare")
    assert main(["compare", "wrong.png", "right.png", "--max-flip", "0.1"]) == 0
    assert main(["compare", "wrong.png", "right.png", "--max-flip", "1e-5"]) == 1


def test_metric_chooses_what_is_shown(here: Path, capsys: Said) -> None:
    main(["compare", "wrong.png", "right.png", "--metric", "ssim,psnr"])
    shown = [line.split()[0] for line in capsys.readouterr().out.splitlines()[1:]]
    assert sorted(shown) == ["psnr", "ssim"]


def test_mask(here: Path, capsys: Said) -> None:
    mask = np.full((72, 96), 255, np.uint8)
    mask[30, 20] = 0
    Pillow.fromarray(mask).save("mask.png")
    assert main(["compare", "wrong.png", "right.png", "--mask", "mask.png", "--diff", "d.png"]) == 0
    assert not np.asarray(Pillow.open("d.png")).any()
    Pillow.fromarray(255 - mask).save("only.png")
    assert main(["compare", "wrong.png", "right.png", "--mask", "only.png"]) == 1
    assert "share 100 %" in capsys.readouterr().out
    Pillow.fromarray(0 * mask).save("none.png")
    assert main(["compare", "wrong.png", "right.png", "--mask", "none.png"]) == 2
    Pillow.fromarray(mask[:9]).save("small.png")
    assert main(["compare", "wrong.png", "right.png", "--mask", "small.png"]) == 2
    err = capsys.readouterr().err
    assert (
        "mask: expected at least one light pixel" in err and "mask: expected the pictures' size, 96×72, got 96×9" in err
    )


def test_json(here: Path, capsys: Said) -> None:
    assert main(["compare", "wrong.png", "right.png", "--json"]) == 1
    (record,) = json.loads(capsys.readouterr().out)["pairs"]
    assert (record["verdict"], record["kind"], record["broken"]) == ("different", "pixels", ["rmse", "bias", "share"])
    assert record["metrics"]["box"] == [20, 30, 21, 31]
    assert main(["compare", "right.png", "right.png", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["exit"] == 0 and found["pairs"][0]["metrics"]["psnr"] is None


def test_diff_shows_the_pixel(here: Path) -> None:
    assert main(["compare", "wrong.png", "right.png", "--diff", "d.png"]) == 1
    heat = np.asarray(Pillow.open("d.png"))
    assert np.argwhere(heat.any(axis=-1)).tolist() == [[30, 20]]


def test_the_report_needs_nothing_from_elsewhere(here: Path) -> None:
    assert main(["compare", "wrong.png", "right.png", "--report", "r.html"]) == 1
    html = Path("r.html").read_text(encoding="utf-8")
    sources = re.findall(r'src="([^"]{0,30})', html)
    assert len(sources) == 6 and all(source.startswith("data:image/png;base64,") for source in sources)
    assert set(re.findall(r'href="([^"]*)"', html)) == {"#case-wrong.png"} and 'id="case-wrong.png"' in html
    assert "<code>cp wrong.png right.png</code>" in html
    assert not re.search(r"https?:|@import|url\(", html)
    assert "one wrong pixel" in html and "columns 14–26, rows 24–36, enlarged" in html


def test_the_verdict_stands_even_if_the_report_cannot_be_written(
    here: Path, capsys: Said, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(target: Path, data: bytes) -> None:
        raise sg.InputError(f"{target}: cannot be written: No space left on device")

    monkeypatch.setattr("splatgl.cli.compare.write_file", full)
    assert main(["compare", "wrong.png", "right.png", "--report", "r.html"]) == 2
    said = capsys.readouterr()
    assert "wrong.png: different: one wrong pixel" in said.out
    assert said.err == "splatgl: r.html: cannot be written: No space left on device\n"


def test_names_are_escaped(here: Path) -> None:
    Path("a").mkdir()
    Path("b").mkdir()
    for folder, image in (("a", "wrong.png"), ("b", "right.png")):
        (here / folder / "<b>&.png").write_bytes((here / image).read_bytes())
    assert main(["compare", "a", "b", "--report", "r.html"]) == 1
    assert "&lt;b&gt;&amp;.png" in Path("r.html").read_text() and "<b>&.png" not in Path("r.html").read_text()


def folders(here: Path) -> None:
    for folder, names in (("new", ("a-same", "other", "cut", "extra")), ("old", ("a-same", "other", "cut", "gone"))):
        (here / folder / "deep").mkdir(parents=True)
        for name in names:
            source = "wrong.png" if (folder, name) == ("new", "other") else "right.png"
            length = 500 if (folder, name) == ("new", "cut") else None
            (here / folder / "deep" / f"{name}.png").write_bytes((here / source).read_bytes()[:length])


def drop_unusable(here: Path) -> None:
    for folder in ("new", "old"):
        for name in ("cut", "extra", "gone"):
            (here / folder / "deep" / f"{name}.png").unlink(missing_ok=True)


def test_folders_pairwise(here: Path, capsys: Said) -> None:
    folders(here)
    assert main(["compare", "new", "old", "--report", "r.html"]) == 2
    said = capsys.readouterr()
    assert said.out.splitlines()[-1] == "5 pairs: 1 same, 1 different, 1 unusable, 2 missing"
    assert "new/deep/other.png: different: one wrong pixel" in said.out
    assert "new/deep/cut.png: cannot be read as a picture" in said.err
    assert "deep/gone.png: no new picture: expected new/deep/gone.png" in said.out
    assert "deep/extra.png: no baseline: expected old/deep/extra.png" in said.out
    html = Path("r.html").read_text()
    assert all(
        f"{count} {state}" in html for count, state in ((1, "unusable"), (1, "different"), (2, "missing"), (1, "same"))
    )
    assert html.count("<figcaption>expected<") == 3 and html.count("<figcaption>actual<") == 3, "missing ones are shown"
    assert (
        "<code>cp new/deep/extra.png old/deep/extra.png</code>" in html and "<code>rm old/deep/gone.png</code>" in html
    )
    for folder in ("new", "old"):
        Path(folder, "deep", "cut.png").unlink()
    assert main(["compare", "new", "old"]) == 1
    drop_unusable(here)
    assert main(["compare", "new", "old"]) == 1
    assert main(["compare", "old", "old", "--quiet"]) == 0


def save_rgb(path: str, mode: str) -> None:
    Pillow.open("right.png").convert(mode).save(path)


def test_bad_input_each_in_its_own_words(here: Path, capsys: Said) -> None:
    nan = RIGHT.pixels.copy()
    nan[3, 7, 1] = np.nan
    sg.Image(nan).save("nan.npy")
    np.save("flat.npy", nan[..., 0])
    save_rgb("rgb.png", "RGB")
    save_rgb("gray.png", "L")
    Path("cut.png").write_bytes(Path("right.png").read_bytes()[:800])
    Path("cut16.png").write_bytes(Path("right16.png").read_bytes()[:800])
    Path("text.png").write_text("hello")
    Path("dir").mkdir()
    Path("full").mkdir()
    Path("full/right.png").write_bytes(Path("right.png").read_bytes())
    Path("cut.npy").write_bytes(Path("right.npy").read_bytes()[:300])
    # a comma turned into a bracket: NumPy fails by an exception of its own
    Path("header.npy").write_bytes(Path("right.npy").read_bytes().replace(b"4), }", b"4((( }"))
    Pillow.new("1", (20000, 10000)).save("huge.png")
    Path("full.html").mkdir()
    before = {path: path.read_bytes() for path in here.rglob("*.png")}
    cases = {
        "rgb.png right.png": "rgb.png: expected the mode of right.png, RGBA, got RGB; save both alike, or",
        "right.png gray.png": "right.png: expected the mode of gray.png, gray, got RGBA",
        "nan.npy right.npy": "nan.npy: expected finite numbers, got [",
        "nan.npy right.png": "nan.npy: expected finite numbers, got [",
        "right.npy nan.npy": "nan.npy: expected finite numbers, got [",
        "flat.npy right.npy": "flat.npy: expected float pixels [H, W, 4], got float32 (72, 96)",
        "cut.png right.png": "cut.png: cannot be read as a picture: ",
        "cut16.png right.png": "cut16.png: cannot be read as a picture",
        "text.png right.png": "text.png: cannot be read as a picture: cannot identify",
        "none.png right.png": "none.png: expected a picture or a folder of pictures, got no such file",
        "dir right.png": "right.png: expected a folder like dir, got a file; give two files or two folders",
        "header.npy right.npy": "header.npy: cannot be read",
        "cut.npy right.npy": "cut.npy: cannot be read",
        "huge.png right.png": "huge.png: cannot be read as a picture: Image size (200000000 pixels) exceeds limit",
        "dir dir": "dir: expected pictures (.png, .npy, .jpg, .gif, .pdf, …), got none",
        "dir full": "dir: expected pictures (.png, .npy, .jpg, .gif, .pdf, …), got none",
        "full dir": "dir: expected pictures (.png, .npy, .jpg, .gif, .pdf, …), got none",
        "full full --diff d.png": "--diff: expected two files, got two folders; use --report for folders",
        "right.png right16.png --diff right16.png": "right16.png: expected another file than the compared pictures",
        "right.png right16.png --mask rgb.png --diff ./rgb.png": "rgb.png: expected another file than the compared",
        "right.png right.png --report right.png/r.html": "right.png/r.html: expected a folder, got the file",
        "right.png right.png --report full.html": "full.html: expected a file to write, got a directory",
        "right.png right.png --mask none.png": "none.png: cannot be read: no such file",
        "right.png right.png --max-rmse none": "expected a number from 0, or a fraction such as 2/255, got 'none'",
        "right.png right.png --max-rmse=-1": "expected a number from 0",
        "right.png right.png --metric mse": "expected all, or some of maximum, rmse",
        "right.png right.png --report r.txt": "r.txt: expected a name that ends in .html",
    }
    for arguments, message in cases.items():
        try:
            code = main(["compare", *arguments.split()])
        except SystemExit as stop:
            code = int(stop.code or 0)
        err = capsys.readouterr().err
        assert code == 2, arguments
        assert message in err, (arguments, err)
        assert len(err.splitlines()) == 1, err
    assert {path: path.read_bytes() for path in here.rglob("*.png")} == before, "nothing is written"


def test_missing_flip_is_said_once(here: Path, capsys: Said, monkeypatch: pytest.MonkeyPatch) -> None:
    folders(here)
    monkeypatch.setitem(sys.modules, "flip_evaluator", None)
    for option in (["--metric", "all"], ["--max-flip", "0.1"]):
        assert main(["compare", "new", "old", *option]) == 2
        assert re.fullmatch(r"splatgl: flip: needs the library .*splatgl\[compare\]'\n", capsys.readouterr().err)


def test_the_guides_commands(here: Path) -> None:
    """Each `splatgl compare` of the guide, on the pictures that it names."""
    pytest.importorskip("flip_evaluator", reason="flip-evaluator is in the extra compare")
    text = (Path(__file__).parents[2] / "splatgl" / "docs" / "comparing.md").read_text(encoding="utf-8")
    commands = [shlex.split(line, comments=True)[1:] for line in re.findall(r"^splatgl compare .*", text, re.MULTILINE)]
    assert len(commands) >= 3
    Path("new.png").write_bytes(Path("wrong.png").read_bytes())
    Path("old.png").write_bytes(Path("right.png").read_bytes())
    Pillow.new("L", (96, 72), 255).save("part.png")
    folders(here)
    drop_unusable(here)
    for arguments in commands:
        assert main(arguments) in (0, 1), arguments
    assert Path("report.html").is_file() and Path("diff.png").is_file()


def test_any_mode_compares_what_pictures_look_like(here: Path) -> None:
    Pillow.open("right.png").convert("RGB").save("rgb.png")
    Pillow.open("rgb.png").convert("RGBA").save("opaque.png")
    assert main(["compare", "rgb.png", "opaque.png"]) == 2
    assert main(["compare", "rgb.png", "opaque.png", "--any-mode"]) == 0
    Pillow.open("rgb.png").quantize(256).save("palette.png")
    Pillow.open("palette.png").convert("RGB").save("colors.png")
    assert main(["compare", "palette.png", "colors.png"]) == 0


def test_xrays_keep_their_scale(here: Path) -> None:
    """A PNG of an X-ray is scaled to its maximum: a tenth more of everything is found all the same."""
    sums = RIGHT.pixels * np.float32(7)
    sg.Image(sums, {"blend": "xray"}).save("a.png")
    sg.Image(sums * np.float32(1.1), {"blend": "xray"}).save("b.png")
    assert main(["compare", "b.png", "a.png"]) == 1
    assert main(["compare", "a.png", "a.png"]) == 0
    sg.Image(sums).save("a.npy")
    assert main(["compare", "a.npy", "a.png"]) == 0
    assert main(["compare", "a.npy", "b.png"]) == 1


def test_render_ref(here: Path, capsys: Said) -> None:
    """Writes only what differs."""
    np.save("noise.npy", np.random.default_rng(6).random((6, 7, 8)).astype(np.float32))
    draw = ["render", "noise.npy", "--size", "40", "--quiet"]
    assert main([*draw, "-o", "ref.png"]) == 0
    assert main([*draw, "-o", "new.png", "--ref", "ref.png"]) == 0
    assert not Path("new.png").exists() and capsys.readouterr().out == ""
    assert main([*draw[:-1], "-o", "new.png", "--ref", "ref.png"]) == 0
    assert not Path("new.png").exists() and "new.png: same" in capsys.readouterr().out
    assert main([*draw, "-o", "new.png", "--ref", "ref.png", "--azimuth", "50"]) == 1
    assert "new.png: different" in capsys.readouterr().out
    assert main(["compare", "new.png", "ref.png", "--quiet"]) == 1
    # as floats, against floats and against eight bits
    assert main([*draw, "-o", "ref.npy"]) == 0
    for ref in ("ref.npy", "ref.png"):
        assert main([*draw, "-o", "new.npy", "--ref", ref]) == 0
    assert not Path("new.npy").exists()


def test_render_ref_leaves_the_right_picture_alone(here: Path, capsys: Said) -> None:
    np.save("noise.npy", np.random.default_rng(6).random((6, 7, 8)).astype(np.float32))
    draw = ["render", "noise.npy", "--size", "40", "--quiet"]
    assert main([*draw, "-o", "noise.png"]) == 0
    right = Path("noise.png").read_bytes()
    for output in ([], ["-o", "noise.png"], ["-o", "../" + here.name + "/noise.png"]):
        assert main([*draw, *output, "--ref", "noise.png", "--azimuth", "50"]) == 2
        assert "noise.png: expected another file than the compared pictures" in capsys.readouterr().err
    assert Path("noise.png").read_bytes() == right
    assert main([*draw, "-o", "x.png", "--ref", "none.png"]) == 2
    assert main([*draw, "-o", "x.png", "--ref", "right.png"]) == 2
    assert not Path("x.png").exists()
    xray = [*draw, "--blend", "xray", "--background", "white"]
    assert main([*xray, "-o", "xray.png"]) == 0
    assert main([*xray, "-o", "y.png", "--ref", "xray.png"]) == 0


def test_other_sizes_are_a_difference(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Both sizes in a line, exit code 1, both pictures in the report; of folders too."""
    for folder, (height, width) in (("a", (30, 41)), ("b", (33, 40))):
        (tmp_path / folder).mkdir()
        Pillow.new("RGB", (width, height), (9, 99, 199)).save(tmp_path / folder / "p.png")
    one, two = tmp_path / "a", tmp_path / "b"
    said = "p.png: different: size 41×30, expected 40×33; of what both have, 1200 pixels: the same"
    for first, second in ((one / "p.png", two / "p.png"), (one, two)):
        report = tmp_path / "r.html"
        assert main(["compare", str(first), str(second), "--report", str(report)]) == 1
        told = capsys.readouterr()
        assert said in told.out and not told.err
        page = report.read_text(encoding="utf-8")
        assert page.count("<figcaption>actual<") == page.count("<figcaption>expected<") == 1 and "1 different" in page
        assert main(["compare", str(first), str(second), "--json"]) == 1
        assert '"verdict": "different"' in capsys.readouterr().out


CASES = Path(os.environ.get("SPLATGL_DATA", Path(__file__).parents[3] / "shared" / "data")).parent / "cases"


def noisy(changed: list[int]) -> np.ndarray:
    """Waves of 120×90 with pixels changed by 3 levels of red, by their numbers."""
    y, x = np.indices((90, 120))
    samples = np.stack([120 + 100 * np.sin(x / 23), 120 + 100 * np.cos(y / 31), 120 + 0 * x], -1).astype(np.uint8)
    samples.reshape(-1, 3)[changed, 0] += 3
    return samples


def test_noise_of_drivers_passes_and_a_change_of_the_same_size_fails(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Said
) -> None:
    monkeypatch.chdir(tmp_path)
    square = [120 * row + column for row in range(30, 36) for column in range(50, 56)]
    scattered = [97 * number for number in range(36)]
    # 0.33 % of the pixels in both
    for name, changed in (("right", []), ("noisy", scattered), ("changed", square), ("many", range(0, 10800, 53))):
        Pillow.fromarray(noisy(list(changed))).save(f"{name}.png")
    assert main(["compare", "noisy.png", "right.png"]) == 1
    said = capsys.readouterr().out
    assert "36 scattered pixels off by up to 3 levels, as between drivers; --noise driver allows it" in said
    assert main(["compare", "noisy.png", "right.png", "--noise", "driver"]) == 0
    assert main(["compare", "changed.png", "right.png", "--noise", "driver"]) == 1
    assert "density 36/49 > 8/49" in capsys.readouterr().out
    assert main(["compare", "many.png", "right.png", "--noise", "driver"]) == 1
    assert "share 1.89 % > 0.5 %" in capsys.readouterr().out
    samples = noisy([])
    samples[10, 10, 1] += 20
    Pillow.fromarray(samples).save("spot.png")
    assert main(["compare", "spot.png", "right.png", "--noise", "driver"]) == 1
    assert "levels 20 > 8" in capsys.readouterr().out


@pytest.mark.skipif(not CASES.is_dir(), reason="the pictures of known cases are not here")
def test_noise_of_vendors() -> None:
    folder = CASES / "21-vendor-noise"
    for name, code in (("intel", 0), ("changed", 1)):
        pair = [str(folder / f"{name}.png"), str(folder / "amd.png")]
        assert main(["compare", *pair]) == 1 and main(["compare", *pair, "--noise", "driver"]) == code


def test_other_sizes_are_aligned(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Said) -> None:
    monkeypatch.chdir(tmp_path)
    samples = noisy([])
    Pillow.fromarray(samples).save("old.png")
    Pillow.fromarray(samples[3:87, 4:116]).save("new.png")
    Pillow.fromarray(samples[:84, :112] + np.uint8(9)).save("offset.png")
    assert main(["compare", "new.png", "old.png", "--align", "center"]) == 1
    assert "size 112×84, expected 120×90; of what both have, 9408 pixels: the same" in capsys.readouterr().out
    assert main(["compare", "new.png", "old.png"]) == 1
    assert ": the same" not in capsys.readouterr().out
    outputs = ["--junit", "j.xml", "--summary", "s.md", "--report", "r.html"]
    assert main(["compare", "offset.png", "old.png", *outputs]) == 1
    assert "9408 pixels: colours times 1.11;" in capsys.readouterr().out
    suite = ElementTree.parse("j.xml").getroot()[0]
    assert (suite.get("tests"), suite.get("failures"), suite.get("errors")) == ("1", "1", "0")
    attached = re.findall(r"\[\[ATTACHMENT\|(.*?)\]\]", suite[0].findtext("system-out") or "")
    assert [Path(name).name for name in attached] == [
        f"offset.png.{k}.png" for k in ("actual", "expected", "difference")
    ]
    assert all(Pillow.open(name).size == (120, 90) for name in attached)
    summary = Path("s.md").read_text(encoding="utf-8")
    assert "1 different" in summary and "| offset.png | different | size 112×84, expected 120×90;" in summary
    assert "cp offset.png old.png" in summary and "`r.html`" in summary
    main(["compare", "old.png", "old.png", "--summary", "s.md"])
    assert Path("s.md").read_text(encoding="utf-8").startswith(summary), "as steps of a workflow append"


SETTINGS = """
[tool.splatgl.compare]
noise = "driver"
ignore = ["clock"]
regions = {clock = [50, 30, 6, 6], date = "date.png"}
"""


def test_parts_that_are_ignored(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Said) -> None:
    monkeypatch.chdir(tmp_path)
    square = [120 * row + column for row in range(30, 36) for column in range(50, 56)]
    for name, changed in (("a", []), ("b", square)):
        Pillow.fromarray(noisy(changed)).save(f"{name}.png")
    date = np.zeros((90, 120), np.uint8)
    date[30:36, 50:56] = 255
    Pillow.fromarray(date).save("date.png")
    compare = ["compare", "b.png", "a.png"]
    for place, code in (("50,30,6,6", 0), ("50,30,6,5", 1), ("date.png", 0)):
        assert main([*compare, "--ignore", place]) == code
    assert main([*compare, "--ignore", "0,0,120,90"]) == 2
    assert main([*compare, "--ignore", "clock"]) == 2
    err = capsys.readouterr().err
    assert "ignore: expected a part of the picture, got all of it" in err
    assert "--ignore: expected left,top,width,height in pixels, a picture, or a name of regions, got 'clock'" in err
    Path("pyproject.toml").write_text(SETTINGS)
    assert main(compare) == 0, "of the project, also for a folder below"
    assert main([*compare, "--ignore", "0,0,9,9"]) == 1, "what is given replaces the project's"
    (tmp_path / "below").mkdir()
    monkeypatch.chdir(tmp_path / "below")
    assert main(["compare", "../b.png", "../a.png", "--ignore", "date"]) == 2, "pictures of options are here"
    Path("../pyproject.toml").write_text(SETTINGS.replace('["clock"]', '["date"]'))
    assert main(["compare", "../b.png", "../a.png"]) == 0, "pictures of the project's are there"
    Pillow.new("L", (120, 90), 255).save("all.png")
    assert main(["compare", "../b.png", "../a.png", "--mask", "all.png"]) == 0, "each in the folder of what names it"
    Path("../pyproject.toml").write_text(SETTINGS + 'metric = ["psrn"]\n')
    assert main(["compare", "../b.png", "../a.png"]) == 2
    assert "[tool.splatgl.compare]: metric: expected all, or some of maximum, rmse" in capsys.readouterr().err
    Path("../pyproject.toml").write_text(SETTINGS.replace("noise", "nois"))
    capsys.readouterr()
    assert main(["compare", "../b.png", "../a.png"]) == 2
    assert "did you mean noise?" in capsys.readouterr().err


def test_antialiased_edges(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """An edge that is smoothed otherwise passes on request; an edge that moved does not."""
    monkeypatch.chdir(tmp_path)
    for name, edge, gray in (("a", 20, 90), ("b", 20, 150), ("moved", 24, 90)):
        samples = np.full((30, 40), 255, np.uint8)
        samples[:, :edge] = 10
        samples[:, edge] = gray
        samples[::3, edge] += 30
        Pillow.fromarray(samples).save(f"{name}.png")
    assert main(["compare", "b.png", "a.png"]) == 1
    assert main(["compare", "b.png", "a.png", "--ignore-antialiased"]) == 0
    assert main(["compare", "moved.png", "a.png", "--ignore-antialiased"]) == 1


def test_frames_and_pages(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Said) -> None:
    monkeypatch.chdir(tmp_path)
    frames = [Pillow.new("L", (20, 10), 50 * number) for number in range(4)]
    for name, count in (("old.gif", 4), ("short.gif", 3)):
        frames[0].save(name, save_all=True, append_images=frames[1:count], duration=50)
    changed = [*frames[:2], Pillow.new("L", (20, 10), 233), frames[3]]
    changed[0].save("new.gif", save_all=True, append_images=changed[1:], duration=50)
    assert main(["compare", "old.gif", "old.gif"]) == 0
    assert main(["compare", "new.gif", "old.gif", "--report", "r.html"]) == 1
    assert "new.gif [3]: different" in capsys.readouterr().out
    html = Path("r.html").read_text(encoding="utf-8")
    assert "new.gif [3]" in html and "3 the same" in html
    assert main(["compare", "short.gif", "old.gif"]) == 1
    assert "no new picture in short.gif, which has fewer" in capsys.readouterr().out


def test_equal_bytes_are_not_decoded_and_processes_keep_the_order(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
        for number in range(6):
            changed = [number] if folder == "a" and number % 2 else []
            Pillow.fromarray(noisy(changed)[:9, :16]).save(tmp_path / folder / f"{number}.png")
    pairs = [FilePair(*names) for names in find_pairs(tmp_path / "a", tmp_path / "b")]
    outcomes = list(compare_all(pairs, Criteria(extra=frozenset({"ssim"})), processes=2))
    assert [o.state for o in outcomes] == ["same", "different"] * 3 and [o.files for o in outcomes] == pairs
    program = [sys.executable, "-m", "splatgl", "compare", "a", "b", "--processes", "2", "--json"]
    told = json.loads(subprocess.run(program, cwd=tmp_path, capture_output=True, check=False).stdout)
    assert [pair["verdict"] for pair in told["pairs"]] == ["same", "different"] * 3
    slow = compare_files(pairs[0], Criteria(extra=frozenset({"ssim"})))[0]
    assert outcomes[0].verdict == slow.verdict, "as if it had been decoded"
    monkeypatch.setattr("splatgl.comparison.pairs.compare_files", pytest.fail)
    assert [o.state for o in compare_all([pairs[0], pairs[2]], Criteria())] == ["same", "same"]


def save_movie(path: str, grays: tuple[int, ...]) -> None:
    av = pytest.importorskip("av", reason="av is in the extra video")
    with av.open(path, "w") as movie:
        stream = movie.add_stream("mpeg4", rate=5)
        stream.width, stream.height, stream.pix_fmt = 32, 16, "yuv420p"
        frames = [av.VideoFrame.from_ndarray(np.full((16, 32, 3), gray, np.uint8)) for gray in grays]
        for packet in [*(p for frame in frames for p in stream.encode(frame)), *stream.encode(None)]:
            movie.mux(packet)


def save_pages(path: str, grays: tuple[int, ...]) -> None:
    pytest.importorskip("pypdfium2", reason="pypdfium2 is in the extra documents")
    pages = [Pillow.new("RGB", (32, 16), (gray, 9, 9)) for gray in grays]
    pages[0].save(path, save_all=True, append_images=pages[1:])


def save_drawing(path: str, grays: tuple[int, ...]) -> None:
    pytest.importorskip("cairosvg", reason="cairosvg is in the extra documents")
    color = f"rgb({sum(grays)},9,9)"
    Path(path).write_text(
        f'<svg xmlns="http://www.w3.org/2000/svg" width="32" height="16"><circle r="9" fill="{color}"/></svg>'
    )


@pytest.mark.parametrize(("ending", "save"), [("mp4", save_movie), ("pdf", save_pages), ("svg", save_drawing)])
def test_movies_and_documents(
    ending: str,
    save: Callable[[str, tuple[int, ...]], None],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: Said,
) -> None:
    monkeypatch.chdir(tmp_path)
    save(f"a.{ending}", (20, 90))
    save(f"b.{ending}", (20, 120))
    assert main(["compare", f"a.{ending}", f"a.{ending}"]) == 0
    capsys.readouterr()
    assert main(["compare", f"a.{ending}", f"b.{ending}"]) == 1
    said = capsys.readouterr().out
    assert f"a.{ending}{'' if ending == 'svg' else ' [2]'}: different" in said
    Path(f"cut.{ending}").write_bytes(Path(f"a.{ending}").read_bytes()[:60])
    assert main(["compare", f"cut.{ending}", f"b.{ending}"]) == 2
    assert len(capsys.readouterr().err.splitlines()) == 1
