"""The command line as users use it: good defaults, one clear line for bad input, nothing half-written."""

from __future__ import annotations

import argparse
import json
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import splatgl as sg
from splatgl.cli.main import COMMANDS, _command_of, _parser, main

NOISE = np.random.default_rng(6).random((6, 7, 8)).astype(np.float32)


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    np.save("noise.npy", NOISE)
    return tmp_path


def said(capsys: pytest.CaptureFixture[str]) -> str:
    return capsys.readouterr().err.strip()


def test_render_a_file(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["render", "noise.npy", "--size", "40x30"]) == 0
    image = sg.Image.load("noise.png")
    assert image.pixels.shape == (30, 40, 4)
    assert image.pixels[..., 3].max() > 0.5
    info = image.info
    assert info["source"] == "noise.npy"
    assert info["renderer"]
    assert info["version"] == sg.__version__
    assert sg.Transfer.from_toml(str(info["transfer"])).points
    assert "noise.png: 40×30" in capsys.readouterr().out
    assert sorted(p.name for p in here.iterdir()) == ["noise.npy", "noise.png"]


@pytest.mark.few(1)
@pytest.mark.parametrize(
    "options",
    [
        ["--paper"],
        ["--blend", "xray", "--background", "black"],
        ["--blend", "mip", "--colormap", "hot"],
        ["--orthographic"],
        ["--height", "3", "--azimuth", "90", "--elevation", "-20", "--zoom", "2"],
        ["--eye", "20,30,10", "--look-at", "3,3,3", "--up", "0,1,0", "--fov", "20"],
        ["--points", "0:0,1:0.5", "--window", "0,1", "--unit", "2", "--gradient", "0:0.1,1:1"],
        ["--preset", "microscopy", "--threshold", "0.1"],
        ["--antialias", "supersample", "--samples", "2", "--align", "hybrid", "--z-s", "30"],
        ["--bits", "16", "--background", "#336699"],
    ],
)
def test_options(options: list[str], here: Path) -> None:
    assert main(["render", "noise.npy", "--size", "24", "-o", "a.png", *options]) == 0
    assert sg.Image.load("a.png").pixels[..., 3].max() > 0.1


def test_scene_file_and_options_over_it(here: Path) -> None:
    (here / "sub").mkdir()
    (here / "sub" / "s.toml").write_text(
        'volume = "../noise.npy"\nthreshold = 0.1\n[transfer]\npoints = [[0, 0], [1, 0.9]]\ncolormap = "hot"\n'
        '[camera]\nsize = [20, 10]\nazimuth = 70\n[settings]\nblend = "mip"\n'
    )
    assert main(["render", "sub/s.toml", "-o", "a.npy"]) == 0
    volume = sg.load("noise.npy")
    splats = sg.extract(volume, sg.Transfer([(0, 0), (1, 0.9)], colormap="hot"), 0.1, classification="pre")
    camera = sg.Camera.orbit(splats, 70, 20, size=(20, 10))
    with sg.Renderer() as renderer:
        settings = sg.Settings(blend="mip", background="black")
        assert (np.load("a.npy") == renderer.render(splats, camera, settings).pixels).all()
    assert main(["render", "sub/s.toml", "-o", "b.png", "--blend", "xray", "--size", "8"]) == 0
    assert sg.Image.load("b.png").info["blend"] == "xray"


BAD = {
    "missing file": (["render", "none.nrrd"], "none.nrrd"),
    "directory": (["render", "folder"], "folder"),
    "empty file": (["render", "empty.nii"], "empty.nii"),
    "unknown format": (["render", "what.xyz"], "what.xyz"),
    "wrong type": (["render", "text.nrrd"], "text.nrrd"),
    "truncated": (["render", "cut.npy"], "cut.npy"),
    "raw of the wrong size": (["render", "a_9x9x9_uint8.raw"], "a_9x9x9_uint8.raw"),
    "all NaN": (["render", "nan.npy"], "nan.npy: expected finite samples, got none"),
    "nothing left": (["render", "noise.npy", "--threshold", "0.9999"], "expected voxels with an opacity above"),
    "zero spacing": (["render", "a_2x2x2_uint8.raw", "--spacing", "0,1,1"], "spacing: expected three positive"),
    "negative spacing": (["render", "a_2x2x2_uint8.raw", "--spacing=-1,1,1"], "spacing: expected three positive"),
    "eye is target": (["render", "noise.npy", "--eye", "1,2,3", "--look-at", "1,2,3"], "--look-at: expected a point"),
    "up along view": (["render", "noise.npy", "--eye", "9,0,0", "--look-at", "0,0,0", "--up", "1,0,0"], "up: expected"),
    "size 0": (["render", "noise.npy", "--size", "0"], "size: expected a width and a height"),
    "azimuth inf": (["render", "noise.npy", "--azimuth", "inf"], "azimuth: expected one finite number"),
    "elevation beyond floats": (
        ["render", "noise.npy", "--elevation", "1e400"],
        "elevation: expected one finite number",
    ),
    "tiny zoom": (["render", "noise.npy", "--zoom", "1e-308"], "zoom: expected a positive number"),
    "tiny fov": (["render", "noise.npy", "--fov", "1e-308"], "fov: expected an angle"),
    "height 0": (["render", "noise.npy", "--height", "0"], "height: expected a positive length"),
    "tiny height": (["render", "noise.npy", "--height", "1e-308"], "height: expected a positive length"),
    "eye beyond squares": (["render", "noise.npy", "--eye", "1e200,0,0"], "eye: expected three finite"),
    "eye beyond float32": (["render", "noise.npy", "--eye", "1e20,0,0"], "eye: expected within"),
    "look-at alone": (["render", "noise.npy", "--look-at", "nan,1,1"], "--look-at: expected 3 finite numbers"),
    "tiny unit": (["render", "noise.npy", "--unit", "1e-308"], "unit: expected a length"),
    "oblong voxels": (["render", "noise.npy", "--spacing", "1e20,1,1"], "spacing: expected three numbers"),
    "size beyond integers": (["render", "noise.npy", "--size", "9" * 23], "size: expected a width and a height"),
    "size beyond OpenGL": (["render", "noise.npy", "--size", "999999x2"], "image size: expected at most"),
    "suffix": (["render", "noise.npy", "-o", "a.gif"], "a.gif: expected a name that ends in"),
    "no folder": (["render", "noise.npy", "-o", "noise.npy/a.png"], "noise.npy/a.png: expected a folder"),
    "output is a folder": (["render", "noise.npy", "-o", "folder.png"], "folder.png: expected a file"),
    "output is nothing": (["render", "noise.npy", "-o", ""], "output: expected a name, got nothing"),
    "reference is nothing": (["render", "noise.npy", "--ref", ""], "ref: expected a name, got nothing"),
    "source is nothing": (["render", ""], "source: expected a name, got nothing"),
    "difference is nothing": (["compare", "a.png", "b.png", "--diff", ""], "diff: expected a name, got nothing"),
    "report is nothing": (["report", "noise.npy", "-o", ""], "output: expected a name, got nothing"),
    "report of many rounds": (["report", "noise.npy", "--rounds", "9" * 23], "--rounds: expected a number"),
    "window of no file": (["view", "--blend", "mip"], "SOURCE: expected a file for these options, got none"),
    "window of no name": (["view", ""], "source: expected a name, got nothing"),
    "window of no size": (["view", "noise.npy", "--size", "20x-1"], "size: expected a w"),
    "device": (["doctor", "--device", "-1"], "device: expected an EGL device number"),
    "backend": (["render", "noise.npy", "--backend", "metal"], "backend: expected auto"),
    "threshold": (["render", "noise.npy", "--threshold", "1.5"], "threshold: expected an opacity"),
    "preset": (["render", "noise.npy", "--preset", "nice"], "nice"),
    "bad scene": (["render", "bad.toml"], "bad.toml"),
    "unknown scene key": (["render", "key.toml"], "key.toml"),
    "transfer file": (["render", "noise.npy", "--transfer", "none.toml"], "none.toml"),
}


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("name", BAD)
def test_bad_input(name: str, here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Each with one clear line, exit code 2, and no half-written file."""
    (here / "folder").mkdir()
    (here / "folder.png").mkdir()
    (here / "empty.nii").touch()
    (here / "what.xyz").write_text("hello")
    (here / "text.nrrd").write_text("hello")
    (here / "cut.npy").write_bytes((here / "noise.npy").read_bytes()[:300])
    (here / "a_9x9x9_uint8.raw").write_bytes(b"12345678")
    (here / "a_2x2x2_uint8.raw").write_bytes(b"12345678")
    (here / "bad.toml").write_text("volume = [")
    (here / "key.toml").write_text('volume = "noise.npy"\ncolour = 3\n')
    np.save("nan.npy", np.full((3, 3, 3), np.nan))
    before = sorted(p.name for p in here.rglob("*"))
    arguments, message = BAD[name]
    assert main(arguments) == 2
    line = said(capsys)
    assert message in line
    assert line.startswith("splatgl: ")
    assert len(line.splitlines()) == 1
    assert sorted(p.name for p in here.rglob("*")) == before


@pytest.mark.parametrize(
    "arguments",
    [
        ["render", "noise.npy", "--size", "a"],
        ["render", "noise.npy", "--shape", "inf,1,1"],
        ["render", "noise.npy", "--shape", "2.5,1,1"],
        ["fly"],
        [],
        ["render"],
    ],
)
def test_bad_usage(arguments: list[str], here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as stop:
        main(arguments)
    assert stop.value.code == 2
    assert len(said(capsys).splitlines()) == 1


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
def test_unwritable_folder(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (here / "locked").mkdir(mode=0o500)
    assert main(["render", "noise.npy", "-o", "locked/a.png"]) == 2
    assert "permission denied" in said(capsys)


@pytest.mark.few(1)
@pytest.mark.parametrize("samples", [np.full((4, 4, 4), 3.0), np.ones((1, 1, 1)), np.ones((1, 5, 6)), NOISE[:, :1]])
def test_plain_volumes_render(samples: np.ndarray, here: Path) -> None:
    """Constant, single-voxel and one-voxel-thin volumes are shown."""
    np.save("v.npy", samples)
    assert main(["render", "v.npy", "--size", "32", "-o", "v.npy.png"]) == 0
    assert sg.Image.load("v.npy.png").pixels[..., 3].max() > 0.3


def test_no_opengl_at_all(here: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise sg.InputError("no OpenGL: egl: …; osmesa: …; window: …; install …")

    monkeypatch.setattr("splatgl.gl.renderer.open_context", refuse)
    assert main(["render", "noise.npy"]) == 2
    assert "no OpenGL" in said(capsys)


def test_ctrl_c(here: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupt(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("splatgl.planning.resolve.extract_for_settings", interrupt)
    assert main(["render", "noise.npy"]) == 130
    assert said(capsys) == "splatgl: interrupted"
    assert [p.name for p in here.iterdir()] == ["noise.npy"]


def test_a_report_of_a_fault_has_no_names(tmp_path: Path) -> None:
    """Type, spacing and how the file is refused, without its name, its folder and its texts."""
    from splatgl.cli.doctor import describe_header

    path = tmp_path / "Smith_John.nrrd"
    text = b"NRRD0004\ntype: uint8\ndimension: 3\nsizes: 2 2 2\nspacings: 1 2 3\nencoding: raw\nid:=Smith\n\n" + bytes(
        8
    )
    path.write_bytes(text)
    lines = "\n".join(describe_header(str(path)))
    assert "2 × 2 × 2 uint8, 1 channels" in lines and "spacing    1 × 2 × 3 of no unit" in lines and "NRRD" in lines
    path.write_bytes(text[:-3])
    refused = "\n".join(describe_header(str(path)))
    assert "refused    FILE: " in refused
    assert not any(word in lines + refused for word in ("Smith", str(tmp_path)))


def test_explain(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["render", "noise.npy", "--size", "16", "--explain"]) == 0
    told = capsys.readouterr().out
    assert "align exact" in told and "3 share a splat, classified after reconstruction" in told
    assert re.search(
        r"at most \S+ % of the pixels are off by more than \S+: 60 drawn in float64; RMSE \S+, worst at \S+ \d+, ag",
        told,
    )
    assert main(["render", "noise.npy", "--size", "16", "--explain", "--like", "0.1"]) == 0
    told = capsys.readouterr().out
    assert re.search(r"error bound \S+: the tolerance 0.00392 is met, against", told)
    assert main(["render", "noise.npy", "--size", "16", "--paper"]) == 0
    assert re.search(r"accuracy: error at most \S+, above the tolerance 0.00392\n", capsys.readouterr().out)


@pytest.mark.long
def test_savings(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Each thing left out is drawn, timed and compared; where nothing can be, that is said."""
    assert main(["render", "noise.npy", "--size", "200", "--savings", "--like", "0.1"]) == 0
    first, *others = [line for line in capsys.readouterr().out.splitlines() if "takes" in line or "times" in line]
    assert re.match(r"a frame takes [\d.e+]+ ms; without an omission:", first)
    names = ["quads for tiles", "antialiasing", "voxels of any shape", "what is hidden", "all of that, and half lines"]
    assert [line.split(":")[0].strip() for line in others] == names
    for line in others:
        found = re.search(r": ([\d.]+) times as long, changes the picture by ([\d.e+-]+) at most", line)
        assert found and float(found[1]) > 0 and float(found[2]) < 5e-4
    assert main(["render", "noise.npy", "--size", "16", "--savings", "--align", "grid"]) == 0
    assert "no omission can be undone" in capsys.readouterr().out


def test_help_shows_basic_options_in_a_line_each_and_help_all_shows_all(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    for name in COMMANDS:
        parser, pages = _command_of(_parser([name]), name), []
        for flag in ("--help", "--help-all")[: 1 + parser.is_long]:
            with pytest.raises(SystemExit) as stop:
                main([name, flag])
            pages.append(capsys.readouterr().out)
            assert stop.value.code == 0 and max(map(len, pages[-1].splitlines())) <= 80
        flags = {
            flag for action in parser._actions if action.help != argparse.SUPPRESS for flag in action.option_strings
        }
        assert flags == set(re.findall(r"(?<=[ ])--?[a-z][\w-]*(?=[ ,\n])", pages[-1])) & flags
        if parser.is_long:
            basic, _, more = pages[0].rstrip().rpartition(" default):\n")[2].partition("\n\n")
            lines = basic.splitlines()
            assert 15 <= len(lines) <= 24 and all(line.startswith("  --") for line in lines)
            assert more == f"More options: splatgl {name} --help-all"


def test_help_fits_a_terminal() -> None:
    """--help of the program and of every command: no line wider than a terminal, every option told."""
    for arguments in ([], ["render"], ["info"], ["doctor"]):
        run = subprocess.run(
            [sys.executable, "-m", "splatgl", *arguments, "--help"],
            capture_output=True, text=True, env={**os.environ, "COLUMNS": "100"}, check=True,
        )  # fmt: skip
        assert max(map(len, run.stdout.splitlines())) <= 100
        assert "SUPPRESS" not in run.stdout


def test_provenance_is_json_in_the_png(here: Path) -> None:
    from PIL import Image as Pillow

    assert main(["render", "noise.npy", "--size", "8", "--paper"]) == 0
    text = json.loads(Pillow.open("noise.png").info["splatgl"])
    assert text["footprint"] == "table 256×256 at 8 bits"


def test_defaults_of_an_earlier_version(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What a scene file gives stays; what it leaves out is as it was."""
    monkeypatch.chdir(tmp_path)
    np.save("noise.npy", np.random.default_rng(1).random((8, 8, 8)))
    Path("scene.toml").write_text('volume = "noise.npy"\n[camera]\nsize = [16, 16]\n[settings]\nantialias = "off"\n')
    before = sg.Settings.like("0.1")
    assert (before.classification, before.compositing, before.antialias) == ("pre", "splats", "paper")
    assert sg.Settings.like("0.1", antialias="auto") == before.replace(antialias="auto")
    assert main(["render", "scene.toml", "--like", "0.1", "-o", "like.png"]) == 0
    told = sg.Image.load("like.png").info
    assert (told["classification"], told["sheets"], told["antialias"]) == ("pre", 0, False)
    assert main(["render", "scene.toml", "--like", "0.0", "-o", "none.png"]) == 2 and not Path("none.png").exists()
    with pytest.raises(sg.InputError, match=r"^like: expected a version that is known: 0\.1, 0\.2, 0\.3, got '1998'$"):
        sg.Settings.like("1998")


def test_pixels_are_checked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Where no error bound is known, and where it is asked for; what is compared is the picture."""
    monkeypatch.chdir(tmp_path)
    np.save("noise.npy", np.random.default_rng(1).random((8, 8, 8)))
    asked = ["render", "noise.npy", "--size", "24", "-o", "x.png"]
    assert main(asked) == 0
    found = r"accuracy: RMSE \S+ in 60 checked pixels, at least (\d+) % of all pixels within \S+\n"
    matched = re.search(found, capsys.readouterr().out)
    assert matched
    checked: Any = sg.Image.load("x.png").info["checked"]
    assert 0 < checked["rmse"] < checked["largest"] < 0.02 and checked["pixels"] == 60
    assert 0 <= 1 - checked["share"] - float(matched[1]) / 100 < 0.01 and checked["confidence"] == 0.95
    assert main(["info", "x.png"]) == 0
    assert "with 95 % confidence" in " ".join(capsys.readouterr().out.split())
    assert main([*asked, "--like", "0.1"]) == 0 and "checked pixels" not in capsys.readouterr().out
    for amount, told in (("100", "at least "), ("0.001s", "in 16 checked"), ("576", "all pixels within"), ("0", "")):
        assert main([*asked, "--check", amount]) == 0
        said = capsys.readouterr().out
        assert ("checked pixels" in said) == bool(told) and told in said
    # beside its own error, how far it is from the field; coarser sheets are farther
    assert main([*asked, "--field"]) == 0 and "off the field itself by up to" in capsys.readouterr().out
    # of a small picture, all
    assert (
        main([*asked, "--size", "24x1", "--points", "0:0.5,1:0.5"]) == 0
        and "all pixels within" in capsys.readouterr().out
    )
    # a picture that is wrong is told from one that is right
    monkeypatch.setattr("splatgl.reference.check.render_pixels", lambda *given: np.full((len(given[-1]), 4), 0.5))
    assert main([*asked, "--check", "20"]) == 0
    checked = sg.Image.load("x.png").info["checked"]
    assert checked["largest"] > 0.3 and checked["share_above_tolerance"] > 0.9
    assert re.search(r"in 20 checked.*, up to \S+ % above the tolerance", capsys.readouterr().out)


@pytest.mark.parametrize(
    ("options", "why"),
    [
        (["--field", "--like", "0.1"], "values classified after reconstruction, got voxels classified before (class"),
        (["--field", "--threshold", "0.1"], "reconstruction, got voxels classified before (threshold)"),
        (["--field", "--classification", "pre"], "reconstruction, got voxels classified before (classification pre)"),
        (["--field", "--check", "0"], "--check: expected pixels or seconds of at least 1, with --field, got 0"),
    ],
    ids=str,
)
def test_what_cannot_be_checked_is_refused_before_drawing(
    options: list[str], why: str, here: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def draw(*_: object, **__: object) -> None:
        raise AssertionError("drawn")

    monkeypatch.setattr("splatgl.gl.renderer.Renderer.render", draw)
    assert main(["render", "noise.npy", "--size", "24", "-o", "x.png", *options]) == 2
    assert why in said(capsys) and not Path("x.png").exists()


def test_repeated_lists_are_joined(here: Path) -> None:
    """The second of an option with a list, such as --annotate, adds to the first."""
    for command, name in ((["render"], "x.png"), (["animate", "--frames", "1", "--quiet"], "{frame}.png")):
        pictures = []
        for names in (["box,axes"], ["box", "axes"], ["axes"]):
            options = [word for each in names for word in ("--annotate", each)]
            assert main([*command, "noise.npy", *options, "--size", "128", "-o", name]) == 0
            pictures.append(sg.Image.load(name.format(frame=0)).pixels)
        assert np.array_equal(pictures[0], pictures[1]) and not np.array_equal(pictures[1], pictures[2])


def test_an_annotated_xray_is_summed_up(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Errors are relative to the brightest sum, not to the scale of the annotated picture."""
    arguments = ("--blend", "xray", "--size", "64", "--check", "30", "-o", "x.png")
    assert main(["render", "balls", *arguments]) == 0
    plain = capsys.readouterr().out
    assert main(["render", "balls", *arguments, "--annotate", "scale"]) == 0
    error = re.compile(r"within \S* of [^,;:\n]*")
    assert error.search(capsys.readouterr().out)[0] == error.search(plain)[0]  # type: ignore[index]


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        ("render noise.npy --azim 30", "unknown option --azim (did you mean --azimuth?)"),
        ("render noise.npy --bac=black", "unknown option --bac=black (did you mean --backend or --background?)"),
        ("surface noise.npy --is 1", "unknown option --is (did you mean --iso?)"),
        ("animate noise.npy --out x.gif", "unknown option --out (did you mean --output?)"),
        ("--vers", "got --vers (did you mean --version?)"),
    ],
)
def test_abbreviations_are_refused_with_advice(
    here: Path, capsys: pytest.CaptureFixture[str], arguments: str, line: str
) -> None:
    with pytest.raises(SystemExit) as stop:
        main(arguments.split())
    assert stop.value.code == 2
    assert line in said(capsys)


def test_no_parser_takes_abbreviations() -> None:
    commands = [_command_of(_parser([name]), name) for name in COMMANDS]
    assert not any(command is None or command.allow_abbrev for command in (_parser([]), *commands))
    root = Path(__file__).parents[2]
    for path in (*root.glob("scripts/**/*.py"), *root.glob("tests/fuzz/*.py")):
        text = path.read_text(encoding="utf-8")
        made = len(re.findall(r"argparse\.ArgumentParser\(|\.add_parser\(", text))
        assert text.count("allow_abbrev=False") == made, path


@pytest.mark.parametrize(
    "arguments",
    [
        "render noise.npy ct-bone -o x.png",
        "render noise.npy CT-Bone -o x.png",
        "render ct-bone -o x.png",
        "animate noise.npy ct-bone -o x.gif",
        "view noise.npy ct-bone",
    ],
)
def test_names_of_presets_get_the_option(here: Path, capsys: pytest.CaptureFixture[str], arguments: str) -> None:
    try:
        code = main(arguments.split())
    except SystemExit as stop:
        code = int(stop.code or 0)
    assert code == 2
    assert "did you mean --preset ct-bone?" in said(capsys)
    assert sorted(path.name for path in here.iterdir()) == ["noise.npy"]


@pytest.mark.parametrize("command", ["render", "animate"])
def test_a_missing_second_source_is_named_before_the_output(
    here: Path, capsys: pytest.CaptureFixture[str], command: str
) -> None:
    assert main([command, "noise.npy", "nosuch.npy", "-o", "x.gif"]) == 2
    assert said(capsys).startswith("splatgl: nosuch.npy: ")
    assert sorted(path.name for path in here.iterdir()) == ["noise.npy"]


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("splatgl ani", {"animate "}),
        ("splatgl render tunnel --ble", {"--blend "}),
        ("splatgl render tunnel --blend m", {"mip", "minip", "mean"}),
    ],
)
def test_shells_complete_words(line: str, words: set[str]) -> None:
    """Commands, options and their values; argcomplete writes them to a descriptor of the shell's."""
    pytest.importorskip("argcomplete")
    asked = {"COMP_LINE": line, "COMP_POINT": str(len(line)), "_ARGCOMPLETE": "1", "_ARGCOMPLETE_IFS": "\n"}
    command = ["bash", "-c", 'exec "$0" -m splatgl 8>&1 9>/dev/null', sys.executable]
    told = subprocess.run(command, env=os.environ | asked, capture_output=True, text=True, check=True)
    assert set(told.stdout.split("\n")) == words
