"""What users type: sources without a command, values below zero, near misses, new folders, messages in its words."""

from __future__ import annotations

import io
import os
import shlex
import subprocess
import sys
from collections.abc import Callable
from inspect import signature
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image as Pillow

import splatgl as sg
from splatgl.cli.main import COMMANDS, _command_of, _parser, main
from splatgl.cli.options import scene_from
from splatgl.cli.parser import Parser
from splatgl.errors import InputError
from splatgl.options import MEANINGS, nearest
from splatgl.scene.api import GROUPS, PLAIN, scene_of
from splatgl.scene.scene_file import SceneFile

pytestmark = pytest.mark.usefixtures("shared_programs")

Said = pytest.CaptureFixture[str]


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    np.save("noise.npy", np.random.default_rng(6).random((6, 7, 8)).astype(np.float32))
    Path("x.raw").write_bytes(b"12345678")
    np.savez("two.npz", a=np.zeros((3, 4, 5)), b=np.ones((4, 5, 6)))
    return tmp_path


def ended(arguments: list[str]) -> Any:
    """The exit code, of usage errors too."""
    try:
        return main(arguments)
    except SystemExit as stop:
        return stop.code


def command(name: str) -> Parser:
    found = _command_of(_parser([name]), name)
    assert found is not None
    return found


# --- without a command -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("source", ["noise.npy", "tunnel", "https://host/v.zarr", "./render"])
def test_a_source_alone_opens_the_window(source: str, here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    opened = []
    (here / "render").write_text("a file named as a command")
    monkeypatch.setenv("DISPLAY", ":1")
    monkeypatch.setattr("splatgl.cli.view.run", lambda args: opened.append((args.source, args.azimuth)) or 0)
    assert main([source, "--azimuth", "-30"]) == 0
    assert opened == [(source, -30.0)]


def test_a_command_stays_one_beside_a_file_of_its_name(here: Path, capsys: Said) -> None:
    (here / "render").write_text("hello")
    assert ended(["render"]) == 2
    assert "required: SOURCE;" in capsys.readouterr().err


def test_without_a_display_it_says_how_to_render(here: Path, capsys: Said, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr("sys.platform", "linux")
    Path("my head.npy").write_bytes(Path("noise.npy").read_bytes())
    assert main(["my head.npy"]) == 2
    assert "splatgl render 'my head.npy' -o picture.png" in capsys.readouterr().err


NEAR = {
    "rendr x": "rendr: expected a command or a file that is there, got neither (did you mean render?); see splatgl",
    "tunel": "(did you mean tunnel?)",
    "what.nii": "got neither; see splatgl --help",
    "--size 3 noise.npy": "expected a command or a file first, got --size",
    "render noise.npy --zom 3": "splatgl render: unknown option --zom (did you mean --zoom?); see splatgl render",
    "render noise.npy --backgruond=black": "unknown option --backgruond=black (did you mean --background?)",
    "render noise.npy --qqqqq": "unknown option --qqqqq; see",
    "view noise.npy two.npz": "expected SOURCE, got also two.npz; splatgl render draws several, splatgl animate",
    "doctor 3": "splatgl doctor: expected no more, got also 3",
    "render -": "SOURCE: expected a file, got standard input; save it to a file first",
    "info *.npy": "*.npy: expected one file, got a pattern; splatgl render and animate draw several",
}


@pytest.mark.parametrize("typed", NEAR)
def test_near_misses(typed: str, here: Path, capsys: Said) -> None:
    assert ended(typed.split()) == 2
    told = capsys.readouterr()
    assert NEAR[typed] in told.err and told.out == ""
    assert len(told.err.splitlines()) == 1


# what users of 3D Slicer, ParaView, PyVista, VTK, napari, Fiji and F3D type → what is advised; "": nothing
MEANT = {
    **{"--mip": "--blend mip", "--max": "--blend mip", "--minip": "--blend minip", "--average": "--blend mean"},
    **{"--blend-mode": "--blend", "--rendering": "--blend", "--opacity": "--points", "--alpha": "--points"},
    **{"--clim": "--window", "--contrast-limits": "--window", "--scalar-range": "--window", "--cmap": "--colormap"},
    **{"--lut": "--colormap", "--window-level": "--level-width", "--wl": "--level-width", "--bg": "--background"},
    **{"--background-color": "--background", "--ppi": "--dpi", "--resolution": "--size", "--window-size": "--size"},
    **{"--camera-position": "--eye", "--cpos": "--eye", "--focal-point": "--look-at", "--view-up": "--up"},
    **{"--rotate": "--azimuth", "--yaw": "--azimuth", "--pitch": "--elevation", "--view-angle": "--fov"},
    **{"--parallel-projection": "--orthographic", "--scale-bar": "--annotate scale", "--ruler": "--annotate scale"},
    **{"--scalar-bar": "--annotate colorbar", "--legend": "--annotate legend", "--axis": "--annotate axes"},
    **{"--bounding-box": "--annotate box", "--title": "--annotate title=TEXT", "--roi": "--crop", "--cut": "--clip"},
    **{"--overlay": "--layer", "--segmentation": "--labels", "--model": "--mesh", "--scalars": "--array"},
    **{"--component": "--channel", "--timestep": "--time", "--voxel-size": "--spacing", "--dims": "--shape"},
    **{"--shade": "--shading", "--lights": "--light", "--ssao": "--ambient-occlusion", "--msaa": "--samples"},
    **{"--gradient-opacity": "--gradient", "--jobs": "--workers", "--screenshot": "--output", "--zoomfactor": ""},
    **{"--cuda": "--gpu", "--gpu-id": "--device", "--hardware": "--gpu"},
    **{"--interpolation": "", "--verbose": "", "--theme": "", "--lod": "", "--flip": "", "--smooth": "", "--style": ""},
    **{"--edges": "", "--stereo": "", "--fullscreen": "", "--jitter": "", "--hdri": "", "--tone-mapping": ""},
}


@pytest.mark.parametrize("typed", MEANT)
def test_options_of_other_programs(typed: str) -> None:
    """By meaning; where nothing is meant, there is no suggestion."""
    advised = nearest(typed, command("render")._option_string_actions)
    assert advised == (f"did you mean {MEANT[typed]}?" if MEANT[typed] else "")


def test_meanings_are_options_and_commands() -> None:
    """Every suggestion is there, and no word for it is an option of the command that it is advised for."""
    flags = {flag.strip("-") for name in COMMANDS for flag in command(name)._option_string_actions}
    assert {suggestion.partition(" ")[0] for suggestion in MEANINGS} <= flags | set(COMMANDS)
    own = {flag.strip("-") for flag in command("render")._option_string_actions}
    assert {word for words in MEANINGS.values() for word in words.split()} & own <= {"view"}


def test_commands_and_keywords_by_meaning(here: Path, capsys: Said) -> None:
    for typed, advised in (("movie", "animate"), ("diff", "compare"), ("screenshot", "render"), ("show", "view")):
        assert ended([typed, "noise.npy"]) == 2
        assert f"(did you mean {advised}?)" in capsys.readouterr().err
    with pytest.raises(InputError, match=r"got mip; did you mean blend='mip'\?"):
        sg.render(np.zeros((4, 4, 4)), mip=True)  # type: ignore[call-arg]
    for name, meant in (("gpu", "gpu"), ("cuda", "gpu"), ("device_id", "device")):
        with pytest.raises(InputError, match=f"got {name}; {meant} is an argument of sg.Renderer"):
            sg.render(np.zeros((4, 4, 4)), **{name: 1})  # type: ignore[misc]


# --- values ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("option", "value", "name", "found"),
    [
        ("--window", "-160,240", "window", (-160, 240)),
        ("--points", "-500:0,200:.8", "points", ((-500, 0), (200, 0.8))),
        ("--points", "-.5:0,2:1", "points", ((-0.5, 0), (2, 1))),
        ("--eye", "-1,2,3", "eye", (-1, 2, 3)),
        ("--look-at", "-1e3,-2,-3", "look_at", (-1000, -2, -3)),
        ("--up", "-0,0,-1", "up", (0, 0, -1)),
        ("--azimuth", "-30", "azimuth", -30),
        ("--elevation", "-inf", "elevation", -np.inf),
    ],
)
def test_values_below_zero(option: str, value: str, name: str, found: object) -> None:
    for arguments in ([option, value, "v.npy"], ["v.npy", f"{option}={value}"], ["v.npy", option, value]):
        assert getattr(_parser(["render"]).parse_args(["render", *arguments]), name) == found


def test_no_option_looks_like_a_number() -> None:
    """Else the values could not be told from it."""
    for name in COMMANDS:
        parser = command(name)
        assert not parser._has_negative_number_optionals


# --- messages --------------------------------------------------------------------------------------------------------

# the command's arguments and the message's beginning, or what it advises
WORDED = {
    "x.raw": "x.raw: dtype: expected one in the name (such as _uint8) or as an option, got neither; "
    "give --shape X,Y,Z and --dtype TYPE",
    "x.raw --offset -3": "x.raw: --offset: expected zero or more bytes, got -3",
    "x.raw --shape 2,2,2 --dtype wood": "x.raw: --dtype: expected a real number type",
    "x.raw --shape 2,2,3 --dtype uint8": "; give the --shape X,Y,Z, --dtype TYPE and --offset BYTES that fit",
    # the picture's --size is not the file's
    "x.raw --shape 2,2,3 --dtype uint8 --size 40": "x.raw: size: expected 12 bytes",
    "two.npz": "pick one with --array NAME; there are: a, b",
    "two.npz --array c": "two.npz: --array: expected one of a, b, got 'c'",
    "noise.npy --array c": "noise.npy: options: expected some of --spacing, --values, --channel for NumPy, got --array",
    "noise.npy --spacing 0,1,1": "noise.npy: --spacing: expected three positive numbers",
    "noise.npy --look-at 1,2,3": "--look-at: expected an eye that looks there, got none; give --eye too",
    "noise.npy --eye 1,2,3 --look-at 1,2,3": "--look-at: expected a point other than the eye",
    "noise.npy --table-size -5": "--table-size: expected a whole number from",
    "noise.npy --z-s -1": "--z-s: expected a depth",
    "noise.npy --window 5,3": "--window: expected finite low < high",
    "noise.npy --points 1:2": "--points: expected",
    "noise.npy --unit -1": "--unit: expected a positive, finite length",
    "noise.npy --threshold 2": "--threshold: expected an opacity",
    "noise.npy --like 9": "--like: expected a version",
    "noise.npy --tolerance 7": "--tolerance: expected a number in",
    "noise.npy --backend metal": "--backend: expected",
    "scene.toml": "scene.toml [camera]: look_at: expected 3 finite numbers",
    "load.toml": "load.toml [load]: header_offset: expected zero or more bytes",
    # the key of a scene is not the option that was not given; one that was, is
    "eye.toml": "look_at: expected an eye",
    "plain.toml --table-size 1": "--table-size: expected a whole number",
}


@pytest.mark.parametrize("typed", WORDED)
def test_messages_name_options_as_typed(typed: str, here: Path, capsys: Said) -> None:
    volume = 'volume = "noise.npy"\n'
    Path("scene.toml").write_text(f"{volume}[camera]\nlook_at = 3\n")
    Path("eye.toml").write_text(f"{volume}[camera]\nlook_at = [1, 2, 3]\n")
    Path("load.toml").write_text(f"{volume}[load]\nheader_offset = -1\n")
    Path("plain.toml").write_text(volume)
    assert main(["render", *typed.split()]) == 2
    line = capsys.readouterr().err
    beginning = "splatgl: " if not WORDED[typed].startswith(("pick", ";")) else ""
    assert beginning + WORDED[typed] in line
    assert len(line.splitlines()) == 1


def test_names_in_paths_and_quotes_stay() -> None:
    parser = command("render")
    args = _parser(["render"]).parse_args(["render", "array=1.npz", "--array", "a"])
    for message in (
        "array=1.npz: contents: expected NumPy archive, as the name says, got PNG",
        "a: data file: expected a file next to the header, got nothing named 'channel=3'",
        "look_at.npy: cannot be read",
    ):
        assert parser.with_flags(message, args) == message


def test_reader_options_are_flags() -> None:
    from splatgl.options import declared, names_of
    from splatgl.readers.options import LoadOptions

    assert (
        set(names_of(LoadOptions))
        == {*declared(LoadOptions)} - {"levels"}
        == {*command("info").flags} & {*declared(LoadOptions)}
    )


# --- files -----------------------------------------------------------------------------------------------------------


def test_folders_are_made_with_the_file(here: Path) -> None:
    assert main(["render", "noise.npy", "--size", "8", "-o", "new/folder/a.png", "--quiet"]) == 0
    assert sg.Image.load("new/folder/a.png").pixels.shape == (8, 8, 4)
    assert main(["compare", "new/folder/a.png", "new/folder/a.png", "--diff", "c/d.png", "--report", "e/r.html"]) == 0
    assert Path("c/d.png").is_file() and Path("e/r.html").is_file()
    turn = ["animate", "noise.npy", "--size", "8", "--frames", "2", "--quiet"]
    assert main([*turn, "-o", "h/i/{frame}.png"]) == 0 and len(list(Path("h/i").iterdir())) == 2
    assert main([*turn, "-o", "j/turn.gif"]) == 0 and [p.name for p in Path("j").iterdir()] == ["turn.gif"]


@pytest.mark.parametrize(
    "typed",
    [
        "render none.npy -o new/a.png",
        "render noise.npy -o new/a.png --threshold 0.99999",
        "render noise.npy -o new/a.png --size 0",
        "animate none.npy -o new/{frame}.png",
        "animate none.npy -o new/a.gif",
        "pyramid none.npy -o new/p.zarr",
        "compare none.png none.png --report new/a.html",
    ],
)
def test_a_run_that_fails_leaves_no_folder(typed: str, here: Path, capsys: Said) -> None:
    before = sorted(here.rglob("*"))
    assert ended(typed.split()) == 2
    assert sorted(here.rglob("*")) == before


@pytest.mark.parametrize("output", ["x.raw/a.png", "x.raw/b/c.png", "/dev/null/a.png"])
def test_a_folder_that_cannot_be_is_told_before_any_work(output: str, here: Path, capsys: Said) -> None:
    assert main(["render", "none.npy", "-o", output]) == 2
    assert f"splatgl: {output}: expected a folder, got the file" in capsys.readouterr().err


def test_the_source_is_never_overwritten(here: Path, capsys: Said) -> None:
    from PIL import Image as Pillow

    Pillow.fromarray(np.arange(64, dtype=np.uint8).reshape(8, 8)).save("height.png")
    Path("link.png").symlink_to("height.png")
    Path("height.csv").write_text("1,2,3\n4,5,6\n7,8,9\n")
    Path("s.toml").write_text('volume = "height.png"\n')
    for typed in (
        "render height.png",
        "render height.png -o link.png",
        "render s.toml -o height.png",
        "render noise.npy -o noise.npy",
        "render link.png --color height.png -o height.png",
        "presets height.png -o height.png",
        "render 2.npy --layer noise.npy -o noise.npy",
        "render 2.npy --layer noise.npy --depth noise.npy -o a.png",
        "render 2.npy --mask noise.npy:outside -o noise.npy",
        "animate 1.npy -o {frame}.npy --frames 3 --size 8",
        "animate 2.npy --layer 1.npy -o {frame}.npy --frames 3 --size 8",
    ):
        for name in ("1.npy", "2.npy"):
            Path(name).write_bytes(Path("noise.npy").read_bytes())
        before = {path: path.read_bytes() for path in here.iterdir()}
        assert main(typed.split()) == 2, typed
        assert "expected another file than the source" in capsys.readouterr().err
        assert {path: path.read_bytes() for path in here.iterdir()} == before
    assert main(["render", "height.png", "-o", "picture.png", "--size", "8", "--quiet"]) == 0


# --- terminals -------------------------------------------------------------------------------------------------------


def test_a_command_computes_small_products_in_one_thread() -> None:
    """OpenBLAS reads the variable when numpy is imported, so it is set before."""
    code = "import os, sys\nfrom splatgl.cli.main import main\nsys.argv = ['splatgl', '--version']\n"
    code += (
        "try:\n    main()\nexcept SystemExit:\n    print(os.environ['OPENBLAS_NUM_THREADS'], 'numpy' in sys.modules)"
    )
    environment = {name: value for name, value in os.environ.items() if name != "OPENBLAS_NUM_THREADS"}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=environment, check=True)
    assert done.stdout.splitlines()[-1] == "1 False"


def run(*arguments: str, **environment: str) -> subprocess.CompletedProcess[bytes]:
    command = [sys.executable, "-m", "splatgl", *arguments]
    return subprocess.run(command, capture_output=True, env={**os.environ, **environment}, check=False)


@pytest.mark.few(1)
@pytest.mark.parametrize("environment", [{}, {"LC_ALL": "C", "PYTHONIOENCODING": "ascii", "PYTHONUTF8": "1"}])
@pytest.mark.parametrize("name", ["with space.npy", "köpfe.npy", "two\nlines.npy", "-minus.npy", "\udcff.npy"])
def test_names_of_any_kind(name: str, environment: dict[str, str], here: Path) -> None:
    """In a terminal that knows ASCII alone, too."""
    Path(name).write_bytes(Path("noise.npy").read_bytes())
    done = run("render", "--size", "8", f"--output={name[:-4]}.png", "--", name, **environment)
    assert (done.returncode, done.stderr) == (0, b"")
    assert Path(f"{name[:-4]}.png").is_file()
    failed = run("info", "--array", "a", "--", name, **environment)
    assert failed.returncode == 2 and len(failed.stderr.splitlines()) == 1 and b"--array" in failed.stderr


@pytest.mark.few(1)
@pytest.mark.parametrize("typed", ["render --help", "info noise.npy", "--help", "compare --help"])
def test_a_reader_that_leaves_is_no_error(typed: str, here: Path) -> None:
    read, write = os.pipe()
    os.close(read)
    with os.fdopen(write, "w") as pipe:
        command = [sys.executable, "-m", "splatgl", *typed.split()]
        done = subprocess.run(command, stdout=pipe, stderr=subprocess.PIPE, check=False)
    assert (done.returncode, done.stderr) == (0, b"")


class Broken(io.StringIO):
    """A stream that takes no text."""

    def __init__(self, reason: Exception) -> None:
        super().__init__()
        self.reason = reason

    def write(self, text: str) -> int:
        raise self.reason


# what is there of standard output, what is told of it, and the exit code
STREAMS: dict[str, tuple[Callable[[], Any], str, int]] = {
    "missing": (lambda: None, "", 0),
    "closed": (lambda: Broken(ValueError("I/O operation on closed file")), "", 0),
    "full": (lambda: Broken(OSError(28, "No space left on device")), "No space left on device", 2),
    "of a reader that left": (lambda: Broken(BrokenPipeError()), "", 0),
}
WORK = {
    "render noise.npy --size 8 -o o.png": "o.png",
    "render noise.npy --size 8 -o o.npy --json": "o.npy",
    "info noise.npy --json": "",
    "compare right.png right.png --diff o.png": "o.png",
    "animate noise.npy --frames 2 --size 8 -o o{frame}.png": "o1.png",
    "convert noise.npy o.npy": "o.npy",
    "presets": "",
    "--help": "",
    "--version": "",
}


@pytest.mark.parametrize("stream", STREAMS)
@pytest.mark.parametrize("typed", WORK)
def test_work_is_done_where_nothing_can_be_printed(
    typed: str, stream: str, here: Path, monkeypatch: pytest.MonkeyPatch, capsys: Said
) -> None:
    """As under pythonw, schedulers, full disks and closed pipes: files are written, and the lack of space is told."""
    Pillow.new("RGB", (9, 9)).save("right.png")
    make, told, code = STREAMS[stream]
    before = make()
    with monkeypatch.context() as patch:
        patch.setattr(sys, "stdout", before)
        assert ended(typed.split()) == code
        assert sys.stdout is before
    assert (f"splatgl: standard output: cannot be written: {told}\n" if told else "") in capsys.readouterr().err
    assert not WORK[typed] or Path(WORK[typed]).is_file()
    assert not [name for name in os.listdir() if name.startswith(".")]
    # errors are worth an exit code, too
    with monkeypatch.context() as patch:
        patch.setattr(sys, "stdout", make())
        patch.setattr(sys, "stderr", make())
        assert ended(["info", "nothing.npy"]) == 2 and ended(["render", "--nothing"]) == 2
        assert ended(typed.split()) == code


def test_a_difference_is_told_by_the_exit_code_alone(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name, color in (("a.png", 0), ("b.png", 9)):
        Pillow.new("L", (9, 9), color).save(name)
    for make, _, _ in STREAMS.values():
        with monkeypatch.context() as patch:
            patch.setattr(sys, "stdout", make())
            assert main(["compare", "a.png", "b.png", "--report", "r.html"]) == 1


@pytest.mark.few(2)
@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs a device that is always full")
@pytest.mark.parametrize(
    ("redirected", "codes"),
    [(">&-", (0, 1)), (">/dev/full", (2, 1)), ("2>&-", (0, 1)), ("2>/dev/full", (0, 1)), ("<&- >&- 2>&-", (0, 1))],
)
def test_descriptors_that_are_closed_or_full(redirected: str, codes: tuple[int, int], here: Path) -> None:
    """No file takes the number of a descriptor that is closed, and Python complains of nothing when it ends."""
    for name, color in (("a.png", 0), ("b.png", 9)):
        Pillow.new("L", (9, 9), color).save(name)
    program = f"{shlex.quote(sys.executable)} -m splatgl"
    for typed, code in (("convert noise.npy o.npy", codes[0]), ("compare a.png b.png", codes[1])):
        done = subprocess.run(["sh", "-c", f"{program} {typed} {redirected}"], capture_output=True, check=False)
        assert done.returncode == code and len(done.stderr.splitlines()) <= 1 and b"Traceback" not in done.stderr
    assert np.array_equal(np.load("o.npy"), np.load("noise.npy"))


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no named pipes")
def test_pipes_are_no_files(here: Path, capsys: Said) -> None:
    """Neither read, which would wait for ever, nor replaced; in one line."""
    Pillow.new("RGB", (9, 9)).save("a.png")
    for name in ("p.npy", "p", "p.png", "p.gif"):
        os.mkfifo(name)
    for typed, told in (
        ("info p.npy", "p.npy: path: expected a file, got a pipe or device"),
        ("info p", "p: path: expected a file, got a pipe or device; save it to a file first"),
        ("info /dev/null", "/dev/null: path: expected a file, got a pipe or device"),
        ("compare p.png a.png", "p.png: cannot be read: a pipe or device"),
        ("compare a.png p.png", "p.png: cannot be read: a pipe or device"),
        ("compare a.png a.png --mask p.png", "p.png: cannot be read: a pipe or device"),
        ("render noise.npy --size 8 -o o.png --ref p.png", "p.png: cannot be read: a pipe or device"),
        ("render noise.npy --size 8 -o p.png", "p.png: expected a file to write, got a pipe or device"),
        ("animate noise.npy --frames 2 --size 8 -o p.gif", "p.gif: expected a file to write, got a pipe or device"),
    ):
        assert main(typed.split()) == 2
        assert told in capsys.readouterr().err.splitlines()[-1]
    assert set(os.listdir()) == {"noise.npy", "x.raw", "two.npz", "a.png", "p.npy", "p", "p.png", "p.gif"}


# --- what is told ----------------------------------------------------------------------------------------------------


@pytest.mark.few(1)
@pytest.mark.parametrize(
    ("typed", "told"),
    [
        (
            "--points 0:0,0.5:0.25,1:1",
            "opacity 0 at 0, 0.25 at 0.5, 1 at 1 per 1, the mean spacing; colours ivory[0.6:] over ",
        ),
        (
            "--points 0:0,0.5:0.2,0.6:0.3,2:1 --window -1,3 --colormap hot",
            "opacity 0 at 0 … 1 at 2 (4 points) per 1, the mean spacing; colours hot over -1 … 3",
        ),
        ("--threshold 0.1 --points 0:0,1:1", "; threshold 0.1"),
        ("--preset microscopy", "transfer function: preset microscopy, opacity 0 at"),
        ("--gradient 0:0,1:1", "; weighted by the gradient"),
        ("--azimuth -30 --elevation 10", "view: azimuth -30°, elevation 10°, fov 40°"),
        ("--zoom 2 --fov 30", "view: azimuth 30°, elevation 20°, zoom 2, fov 30°"),
        ("--eye 20,30,-10", "view: from the eye 20, 30, -10, fov 40°"),
        ("--height 4", "view: azimuth 30°, elevation 20°, parallel rays"),
        ("--blend xray", "a.png: 24×16 pixels, xray of "),
        ("--like 0.1", "within the tolerance 0.00392"),
        ("--check 50", " in 50 checked pixels, at least "),
        ("--check 384", " checked pixels, all pixels within "),
        ("--check 0", "accuracy: not known"),
    ],
)
def test_the_summary_tells_what_was_drawn(typed: str, told: str, here: Path, capsys: Said) -> None:
    assert main(["render", "noise.npy", "--size", "24x16", "-o", "a.png", *typed.split()]) == 0
    page = capsys.readouterr().out
    assert told in page and len(page.splitlines()) == 5
    assert not any(word in page for word in ("align", "footprint", "target", "kernel", "technique", "rgba"))
    assert sg.Image.load("a.png").info["target"]


@pytest.mark.long
def test_a_scene_tells_its_eye(here: Path, capsys: Said) -> None:
    assert main(["render", "tunnel", "--size", "8", "-o", "a.png"]) == 0
    page = capsys.readouterr().out
    assert "view: from the eye 79.5, 79.5, -8, fov 60°" in page and "colours those of the volume" in page


def test_info_lists_what_an_option_picks_from(here: Path, capsys: Said) -> None:
    """A file that render draws with an option is none that info refuses."""
    assert main(["info", "x.raw"]) == 0
    page = capsys.readouterr().out
    assert "bytes      8\n" in page and "to see it  give --shape X,Y,Z and --dtype TYPE\n" in page
    assert main(["info", "two.npz"]) == 0
    page = capsys.readouterr().out
    assert "a          5 × 4 × 3 float64\n" in page and "b          6 × 5 × 4 float64\n" in page
    assert "to see it  pick one with --array NAME\n" in page
    assert main(["info", "two.npz", "--array", "b"]) == 0 and "6 × 5 × 4" in capsys.readouterr().out
    # what no option mends is an error
    np.savez("flat.npz", a=np.zeros(3), b=np.zeros(4))
    Path("a_9x9x9_uint8.raw").write_bytes(b"12345678")
    for name in ("flat.npz", "a_9x9x9_uint8.raw", "none.npz"):
        assert main(["info", name]) == 2
        assert capsys.readouterr().out == ""
    assert main(["info", "two.npz", "--array", "c"]) == 2


def test_info_lists_channels_times_and_arrays_of_stores(here: Path, capsys: Said) -> None:
    nibabel, zarr = pytest.importorskip("nibabel"), pytest.importorskip("zarr")
    nibabel.save(nibabel.Nifti1Image(np.zeros((3, 4, 5, 6), np.int16), np.eye(4)), "times.nii")
    store = zarr.open_group("s.zarr", mode="w")
    for name, shape in (("one", (3, 4, 5)), ("two", (6, 7, 8))):
        store.create_array(name, shape=shape, dtype="u1")
    for name, lines in (
        ("times.nii", ("times      0 … 5", "--time N picks; splatgl animate plays them")),
        ("s.zarr", ("one        5 × 4 × 3 uint8", "two        8 × 7 × 6 uint8", "pick one with --array NAME")),
    ):
        assert main(["info", name]) == 0
        page = capsys.readouterr().out
        assert all(line in page for line in lines), page


def test_a_choice_is_an_error_with_what_there_is(here: Path) -> None:
    import pickle

    from splatgl.errors import MissingOption

    with pytest.raises(sg.InputError, match=r"^two\.npz: arrays: expected one 3-D array") as told:
        sg.load("two.npz")
    again = pickle.loads(pickle.dumps(told.value))
    assert isinstance(again, MissingOption) and str(again) == str(told.value)
    assert (again.option, [name for name, _ in again.choices]) == ("array", ["a", "b"])


@pytest.mark.few(1)
@pytest.mark.parametrize("suffix", [".npy", ".tif", ".exr"])
def test_pictures_of_floats_are_drawn_and_compared(suffix: str, here: Path, capsys: Said) -> None:
    pytest.importorskip({".npy": "numpy", ".tif": "tifffile", ".exr": "OpenEXR"}[suffix])
    asked = ["render", "noise.npy", "--size", "16", "--quiet", "--blend", "xray", "-o"]
    assert main([*asked, f"a{suffix}"]) == 0 and main([*asked, "b.npy"]) == 0
    assert (sg.Image.load(f"a{suffix}").pixels == np.load("b.npy")).all()
    assert main(["compare", f"a{suffix}", "b.npy", "--max-difference", "0"]) == 0
    np.save("c.npy", np.load("b.npy") * np.float32(1.001))
    assert main(["compare", f"a{suffix}", "c.npy", "--max-difference", "0"]) == 1


def test_jpeg_says_what_is_behind(here: Path, capsys: Said) -> None:
    asked = ["render", "noise.npy", "--size", "16", "--background", "transparent", "-o", "a.jpg"]
    assert main(asked) == 2 and "a.jpg: expected an opaque picture, got transparent" in capsys.readouterr().err
    assert main([*asked, "--blend", "xray"]) == 0 and "on black, as JPEG has no alpha" in capsys.readouterr().out
    assert main([*asked, "--background", "white"]) == 0 and "on black" not in capsys.readouterr().out
    assert sg.Image.load("a.jpg").pixels[0, 0].min() > 0.95


def test_a_missing_library_is_told_before_any_work(here: Path, capsys: Said, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "OpenEXR", None)
    assert main(["render", "none.npy", "-o", "a.exr"]) == 2
    assert "pip install 'splatgl[exr]'" in capsys.readouterr().err


# --- three ways in ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("typed", "keywords"),
    [
        ("--size 800x600 --azimuth 5 --up 0,1,0", {"size": "800x600", "azimuth": 5, "up": np.array([0, 1, 0])}),
        ("--size 64 --orthographic", {"size": 64, "orthographic": True}),
        (
            "--points 1:0,2:.5 --window 1,2 --log",
            {"points": [[1.0, 0.0], [2.0, 0.5]], "window": [1.0, 2.0], "scale": "log"},
        ),
        ("--background #ff0000 --samples 2 --shadows 1", {"background": "red", "samples": 2, "shadows": 1}),
        ("--clip x>0.3 --crop 1:3,:,: --mask a.nii:1", {"clip": "x>0.3", "crop": "1:3,:,:", "mask": "a.nii:1"}),
        ("--streamlines --arrows 5 --surfaces", {"streamlines": True, "arrows": 5, "surfaces": True}),
        ("--mesh a.ply --clip-meshes", {"meshes": "a.ply", "clip_meshes": True}),
        ("--channel 1 --spacing 1,2,3", {"channel": "1", "spacing": (1.0, 2.0, 3.0)}),
        ("--preset mri --log --offset 3", {"preset": "mri", "log": True, "offset": 3}),
        ("--mesh a.ply --layer b.nii:hot:0.5", {"mesh": "a.ply", "layers": ["b.nii:hot:0.5"]}),
        ("--labels a.nii --only-labels 3,4:0.5", {"labels": "a.nii", "only_labels": {3: 1, 4: 0.5}}),
        ("--labels a.nii --only-labels 3,4", {"labels": Path("a.nii"), "only_labels": [3, np.int64(4)]}),
        (
            "--color-of 0=red --color-of a=b=#00f --window-of 1=2,3",
            {"color_of": {0: "#ff0000", "a=b": "blue"}, "window_of": {"1": np.array([2, 3])}},
        ),
        ("--like 0.1 --samples 2 --paper", {"like": "0.1", "samples": 2, "paper": True}),
        ("--unit 2.5 --point-size 3", {"unit": 2.5, "point_size": 3.0}),
    ],
)
def test_command_line_keywords_and_scene_files_agree(typed: str, keywords: dict[str, Any], here: Path) -> None:
    written = scene_from(_parser(["render"]).parse_args(["render", "noise.npy", *typed.split()]))
    scene = scene_of("noise.npy", None, None, None, keywords)
    Path("again.toml").write_text(written.to_toml(here))
    assert written.to_toml(here) == scene.to_toml(here) == SceneFile.from_toml(Path("again.toml")).to_toml(here)


# options of files to write, of what is checked or printed, of OpenGL and of workers
ELSEWHERE = {"output", "quiet", "bits", "depth", "depth_at", "ref", "check", "explain", "savings", "backend", "device"}
ELSEWHERE |= {"gpu", "workers", "scheduler", "devices", "help", "help_all", "same", "sheet", "json"}


def test_every_option_of_a_picture_is_a_keyword() -> None:
    """By the name of its flag; what is written, or which OpenGL draws, is no keyword of a picture in memory."""
    shown = signature(sg.render).parameters.keys() - (GROUPS.keys() - PLAIN.keys())
    names = {flag.removeprefix("--").replace("-", "_") for flag in command("render").flags.values()}
    assert names - {*shown} == ELSEWHERE
    for function in (sg.show, sg.depth_map, sg.animate):
        assert names - {*signature(function).parameters} <= ELSEWHERE


@pytest.mark.parametrize(
    ("options", "told"),
    [
        ({"only_labels": ["a"]}, "only_labels: expected labels N or N:A"),
        ({"color_of": {"DAPI": "blau"}}, "color_of: expected a colour"),
        ({"window_of": {"DAPI": (3, 2)}}, "window_of: expected LOW below HIGH"),
        ({"log": "yes"}, "log: expected true or false"),
        ({"layers": "a.nii:hot:7"}, "layers: expected an opacity from 0 to 1"),
        ({"preset": 3}, "preset: expected a name"),
        ({"like": "0.7"}, "like: expected a version"),
    ],
)
def test_wrong_keywords_are_told_in_a_line(options: dict[str, Any], told: str) -> None:
    with pytest.raises(sg.InputError, match=told) as found:
        scene_of("noise.npy", None, None, None, options)
    assert "\n" not in str(found.value)
