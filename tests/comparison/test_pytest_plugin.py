"""The pytest plugin as a user meets it: missing, updated, passed, broken; classes of renderers; xdist; the report."""

from __future__ import annotations

import io
import os
import re
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import numpy.fft
import PIL.Image
import PIL.PngImagePlugin
import pytest

import splatgl as sg
import splatgl.comparison.image_regression
import splatgl.gl.renderer
from splatgl.comparison.pictures import as_image
from splatgl.errors import InputError

pytest_plugins = ["pytester"]

# pytester drops what its runs import first, and numpy's parts can be loaded only once: so they are here before
PRESENT = (numpy.fft, PIL.PngImagePlugin, splatgl.comparison.image_regression, splatgl.gl.renderer)

TEST = """
import numpy as np, os, splatgl as sg

def picture(level=0.5, renderer="llvmpipe (LLVM 15)"):
    pixels = np.zeros((20, 30, 4), np.float32)
    pixels[5:15, 5:20] = (level, 0.1, 0.2, 1)
    return sg.Image(pixels, {"renderer": renderer})
"""
ONE = TEST + "\ndef test_it(splatgl_image):\n    splatgl_image(picture(float(os.environ.get('LEVEL', 0.5))))\n"


@pytest.fixture(autouse=True)
def quick(pytester: pytest.Pytester) -> None:
    """Other packages' plugins take a second to load in each run."""
    others = ("zarr", "napari", "napari-plugin-engine", "npe2", "platformdirs")
    pytester.makeini(f"[pytest]\naddopts = {' '.join(f'-p no:{name}' for name in others)}")


@pytest.fixture
def project(pytester: pytest.Pytester) -> pytest.Pytester:
    pytester.makepyfile(test_one=ONE)
    return pytester


def baselines(project: pytest.Pytester) -> list[str]:
    return sorted(path.relative_to(project.path).as_posix() for path in project.path.rglob("*.png"))


def test_from_missing_to_passing_to_broken(project: pytest.Pytester, monkeypatch: pytest.MonkeyPatch) -> None:
    missing = project.runpytest()
    missing.assert_outcomes(failed=1)
    missing.stdout.fnmatch_lines(["*no baseline: expected baselines/test_one/test_it.png", "*--splatgl-update"])
    assert baselines(project) == [], "nothing is written unless asked"
    updated = project.runpytest("--splatgl-update")
    updated.assert_outcomes(passed=1)
    updated.stdout.fnmatch_lines(["wrote baselines/test_one/test_it.png"])
    assert baselines(project) == ["baselines/test_one/test_it.png"]
    written = (project.path / baselines(project)[0]).read_bytes()
    project.runpytest().assert_outcomes(passed=1)
    monkeypatch.setenv("LEVEL", "0.6")
    broken = project.runpytest()
    broken.assert_outcomes(failed=1)
    said = ["test_it differs: *", "*where: columns 5–19, rows 5–14*", "*limits: rmse *", "*baseline: *test_it.png"]
    broken.stdout.fnmatch_lines(said)
    assert (project.path / baselines(project)[0]).read_bytes() == written, "a failure never updates"
    project.runpytest("--splatgl-update").assert_outcomes(passed=1)
    project.runpytest().assert_outcomes(passed=1)


def test_updating_leaves_what_passes_alone(project: pytest.Pytester, monkeypatch: pytest.MonkeyPatch) -> None:
    project.runpytest("--splatgl-update")
    before = (project.path / baselines(project)[0]).stat().st_mtime_ns
    again = project.runpytest("--splatgl-update")
    again.stdout.no_fnmatch_line("*wrote*")
    assert (project.path / baselines(project)[0]).stat().st_mtime_ns == before


def test_classes_of_renderers(pytester: pytest.Pytester, monkeypatch: pytest.MonkeyPatch) -> None:
    """A class has its own baselines, several if need be; what has none is held to the portable one."""
    pytester.makepyfile(
        test_two=TEST
        + "\ndef test_it(splatgl_image):\n"
        + "    splatgl_image(picture(float(os.environ['LEVEL']), os.environ['BY']), name='front')\n"
    )

    def run(level: float, by: str, *options: str) -> bool:
        monkeypatch.setenv("LEVEL", str(level))
        monkeypatch.setenv("BY", by)
        return pytester.runpytest(*options).ret == 0

    assert run(0.5, "llvmpipe", "--splatgl-update")
    assert run(0.5, "NVIDIA H100")
    assert not run(0.6, "NVIDIA H100")
    assert run(0.6, "NVIDIA H100", "--splatgl-update-class")
    assert run(0.6, "NVIDIA H100") and run(0.5, "llvmpipe") and run(0.5, "AMD Radeon")
    assert not run(0.5, "NVIDIA H100"), "its own baseline stands instead of the portable one"
    assert not run(0.6, "llvmpipe"), "another class's does not count"
    assert run(0.7, "NVIDIA H100", "--splatgl-update-add")
    assert run(0.6, "NVIDIA H100") and run(0.7, "NVIDIA H100")
    assert baselines(pytester) == [f"baselines/test_two/front{end}.png" for end in (".nvidia-2", ".nvidia", "")]


@pytest.mark.long
def test_one_more_that_is_right(pytester: pytest.Pytester, monkeypatch: pytest.MonkeyPatch) -> None:
    """What is added takes nothing away: the picture that was right stays right."""
    pytester.makepyfile(
        test_add=TEST
        + "\ndef test_it(splatgl_image):\n"
        + "    splatgl_image(picture(float(os.environ['LEVEL']), os.environ['BY']))\n"
    )

    def run(level: float, by: str, *options: str) -> bool:
        monkeypatch.setenv("LEVEL", str(level))
        monkeypatch.setenv("BY", by)
        return pytester.runpytest(*options).ret == 0

    assert run(0.5, "", "--splatgl-update-add"), "the first is the portable one"
    assert run(0.6, "", "--splatgl-update-add")
    assert run(0.7, "AMD Radeon", "--splatgl-update-add")
    stem = "baselines/test_add/test_it"
    assert baselines(pytester) == [f"{stem}.amd-2.png", f"{stem}.png", f"{stem}.portable-2.png"]
    assert all(run(level, by) for level in (0.5, 0.6) for by in ("", "AMD Radeon", "Apple M2"))
    assert run(0.7, "AMD Radeon") and not run(0.7, "") and not run(0.7, "Apple M2")
    # of several, the nearest tells what differs
    monkeypatch.setenv("LEVEL", "0.61")
    monkeypatch.setenv("BY", "")
    said = pytester.runpytest().stdout
    said.fnmatch_lines(["*worst 0.0*", "*baseline: *test_it.portable-2.png, the nearest of 2"])
    # an update renews the first, and leaves what was added
    assert run(0.8, "AMD Radeon", "--splatgl-update")
    assert len(baselines(pytester)) == 3 and run(0.8, "") and run(0.6, "") and not run(0.5, "")
    assert run(0.9, "AMD Radeon", "--splatgl-update-class")
    assert run(0.9, "AMD Radeon") and run(0.7, "AMD Radeon") and not run(0.8, "AMD Radeon")
    # the class's own is what an update renews where there is one
    assert run(0.3, "AMD Radeon", "--splatgl-update") and run(0.3, "AMD Radeon") and run(0.8, "")


PLACES = """
class TestOne:
    def test_it(self, splatgl_image):
        splatgl_image(picture(0.2))

class TestTwo:
    def test_it(self, splatgl_image):
        splatgl_image(picture(0.4))

import pytest
@pytest.fixture
def compared(splatgl_image):
    splatgl_image(picture(0.6), name="before")
    yield
    splatgl_image(picture(0.7), name="after")

def test_fixture(compared):
    pass

@pytest.mark.parametrize("long", ["é" * 300, "x" * 300, "x" * 299 + "y"])
def test_long(long, splatgl_image):
    splatgl_image(picture(0.8 if long[-1] == "y" else 0.9), name=long)
"""


def test_every_place_has_its_own_baseline(pytester: pytest.Pytester) -> None:
    """Tests of one name in two classes, fixtures that compare, names longer than files may have."""
    pytester.makepyfile(test_places=TEST + PLACES)
    result = pytester.runpytest("--splatgl-report", "out")
    result.assert_outcomes(failed=5, errors=1)
    result.stdout.fnmatch_lines(["*6 of 6 pictures differ, are missing or unusable: out/index.html"])
    pytester.runpytest("--splatgl-update").assert_outcomes(passed=6)
    pytester.runpytest().assert_outcomes(passed=6)
    names = [Path(path).stem for path in baselines(pytester)]
    assert len(names) == 7 and {"TestOne-test_it", "TestTwo-test_it", "before", "after"} <= set(names)


def test_the_hint_works_where_pytest_was_called(pytester: pytest.Pytester) -> None:
    folder = pytester.mkdir("deep")
    (folder / "test_one.py").write_text(ONE)
    pytester.chdir()
    os.chdir(folder)
    result = pytester.runpytest("--rootdir", "..")
    result.stdout.fnmatch_lines(["*then make it with: pytest test_one.py::test_it --splatgl-update"])
    pytester.runpytest("--rootdir", "..", "test_one.py::test_it", "--splatgl-update").assert_outcomes(passed=1)
    assert (folder / "baselines" / "test_one" / "test_it.png").is_file()


def test_beside_pytest_regressions(pytester: pytest.Pytester) -> None:
    """Each plugin's fixture takes its own tests' pictures: theirs bytes and images of Pillow, by `check`."""
    pytest.importorskip("pytest_regressions", reason="pytest-regressions is not installed")
    theirs = (
        "\ndef test_theirs(image_regression):\n"
        "    image_regression.check(picture().encoded(__import__('pathlib').Path('a.png')))\n"
    )
    pytester.makepyfile(test_both=ONE + theirs)
    pytester.runpytest_subprocess("--splatgl-update", "--force-regen").assert_outcomes(passed=1, failed=1)
    pytester.runpytest_subprocess().assert_outcomes(passed=2)
    assert {"baselines/test_both/test_it.png", "test_both/test_theirs.png"} <= set(baselines(pytester))


def test_the_guides_five_lines(pytester: pytest.Pytester) -> None:
    """The snippet of the guide, as a user would try it."""
    text = (Path(__file__).parents[2] / "splatgl" / "docs" / "comparing.md").read_text(encoding="utf-8")
    (snippet,) = (block for block in re.findall(r"```python\n(.*?)```", text, re.DOTALL) if "splatgl_image" in block)
    assert len([line for line in snippet.splitlines() if line]) <= 6
    pytester.makepyfile(test_snippet=snippet)
    for options, outcome in (([], "failed"), (["--splatgl-update"], "passed"), ([], "passed")):
        pytester.runpytest(*options).assert_outcomes(**{outcome: 1})
    assert baselines(pytester) == ["baselines/test_snippet/test_ball.png"]
    pytester.makepyfile(test_snippet=snippet.replace("ball(12)", "ball(11)"))
    pytester.runpytest().assert_outcomes(failed=1)


def test_only_another_class_has_one(pytester: pytest.Pytester) -> None:
    call = "\ndef test_it(splatgl_image):\n    splatgl_image(picture(renderer={!r}))\n"
    pytester.makepyfile(test_three=TEST + call.format("Mesa Intel(R) UHD"))
    pytester.runpytest("--splatgl-update-class").assert_outcomes(passed=1)
    pytester.makepyfile(test_three=TEST + call.format("Apple M2"))
    result = pytester.runpytest()
    result.stdout.fnmatch_lines(["*no baseline for apple, only test_it.intel.png: expected *test_it.png"])


CALLS = """
import PIL.Image, pytest
from splatgl.comparison.verdict import Tolerance

def test_two_pictures(splatgl_image):
    splatgl_image(picture(0.2))
    splatgl_image(picture(0.4))

@pytest.mark.parametrize("which", ["a/b", "a+b"])
def test_odd_names(splatgl_image, which):
    splatgl_image(picture(0.2 if which == "a/b" else 0.4))

def test_forms(splatgl_image, tmp_path):
    samples = np.rint(picture().straight() * 255).astype(np.uint8)
    picture().save(tmp_path / "x.png")
    pillow = PIL.Image.fromarray(samples)
    content = (tmp_path / "x.png").read_bytes()
    for image in (picture(), picture().pixels, samples, tmp_path / "x.png", content, pillow, pillow.quantize(4)):
        splatgl_image(image, name="forms")

def test_floats(splatgl_image):
    splatgl_image(picture(), bits=None, tolerance=0)

def test_deep(splatgl_image):
    splatgl_image(picture(), bits=16, tolerance=0)

def test_tolerance(splatgl_image):
    mask = np.ones((20, 30), bool)
    splatgl_image(picture(), name="t")
    for tolerance in (0.2, Tolerance.only(share=0.5), Tolerance.only(rmse=0.1)):
        splatgl_image(picture(0.6), name="t", tolerance=tolerance) if os.environ.get("LATER") else None
    mask[5:15, 5:20] = False
    splatgl_image(picture(0.6), name="t", mask=mask) if os.environ.get("LATER") else None
"""


def test_what_can_be_given(pytester: pytest.Pytester, monkeypatch: pytest.MonkeyPatch) -> None:
    pytester.makepyfile(test_calls=TEST + CALLS)
    pytester.runpytest("--splatgl-update").assert_outcomes(passed=7)
    monkeypatch.setenv("LATER", "1")
    pytester.runpytest().assert_outcomes(passed=7)
    names = {path.name for path in pytester.path.glob("baselines/test_calls/*")}
    assert {"test_two_pictures.png", "test_two_pictures-2.png", "forms.png", "test_floats.npy", "t.png"} <= names
    assert len(names) == 8


BAD = """
import PIL.Image, pytest
@pytest.mark.parametrize("bad", ["nan", "size", "file", "type", "floats", "bytes", "mode"])
def test_bad(splatgl_image, bad):
    splatgl_image(picture(), name="good")
    wrong = {"nan": sg.Image(picture().pixels * np.float32("nan")), "size": sg.Image(picture().pixels[1:]),
             "file": "none.png", "type": [1, 2], "floats": np.zeros((20, 30, 3)),
             "bytes": b"cut", "mode": PIL.Image.new("CMYK", (30, 20))}[bad]
    splatgl_image(wrong, name="good")
"""


def test_bad_pictures_fail_in_one_line_each(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(test_bad=TEST + BAD)
    folder = pytester.mkdir("baselines") / "test_bad"
    folder.mkdir()
    picture = np.zeros((20, 30, 4), np.float32)
    picture[5:15, 5:20] = (0.5, 0.1, 0.2, 1)
    sg.Image(picture).save(folder / "good.png")
    result = pytester.runpytest()
    result.assert_outcomes(failed=7)
    for line in (
        "*good: expected finite numbers, got *",
        "*good differs: size 30×19, expected 30×20; of what both have, 570 pixels: *",
        "*none.png: cannot be read: no such file",
        "*image of 3 bytes: cannot be read as a picture*",
        "*image: expected a mode of PNG, got CMYK; convert it to RGB or RGBA",
        "*image: expected an Image, a file, its bytes, a figure, uint8 [[]H, W[]] or *, got int64 (2,)",
        "*got float64 (20, 30, 3); floats need colour and alpha*",
    ):
        result.stdout.fnmatch_lines([line])
    result.stdout.no_fnmatch_line("*Traceback*")
    result.stdout.no_fnmatch_line("*During handling*")
    # what is no picture is never written, asked or not
    before = (folder / "good.png").read_bytes()
    update = pytester.runpytest("--splatgl-update", "-k", "not size")
    update.assert_outcomes(failed=6, deselected=1)
    assert (folder / "good.png").read_bytes() == before
    (folder / "good.png").write_bytes(b"cut")
    result = pytester.runpytest("--splatgl-report", "out")
    html = (pytester.path / "out" / "index.html").read_text(encoding="utf-8")
    assert "7 unusable" in html and "test_bad.py::test_bad[type]: good" in html
    pytester.runpytest("-k", "file").stdout.fnmatch_lines(["*good.png: cannot be read as a picture*"])


MANY = """
import pytest
@pytest.mark.parametrize("number", range(8))
def test_many(splatgl_image, number):
    broken = number in (2, 5) and "BREAK" in os.environ
    splatgl_image(picture(0.3 if broken else 0.1 * number))
"""


@pytest.mark.long
def test_the_report_under_xdist(pytester: pytest.Pytester, monkeypatch: pytest.MonkeyPatch) -> None:
    """Written by several processes, compared by several, merged into one page by one."""
    pytest.importorskip("xdist", reason="pytest-xdist is in the extra dev")
    pytester.makepyfile(test_many=TEST + MANY)
    updated = pytester.runpytest_subprocess("-n", "2", "--splatgl-update")
    updated.assert_outcomes(passed=8)
    assert sum("wrote" in line for line in updated.outlines) == 8
    monkeypatch.setenv("BREAK", "1")
    result = pytester.runpytest_subprocess("-n", "2", "--splatgl-report", "out")
    result.assert_outcomes(passed=6, failed=2)
    result.stdout.fnmatch_lines(["2 of 8 pictures differ, are missing or unusable: out/index.html"])
    html = (pytester.path / "out" / "index.html").read_text(encoding="utf-8")
    assert html.count('<section class="case"') == 2
    for number in (2, 5):
        assert f"test_many.py::test_many[{number}]: test_many-{number}" in html
    assert "6 the same" in html and html.count("data:image/png;base64,") >= 10
    assert [path.name for path in (pytester.path / "out").iterdir()] == ["index.html"]


def test_the_report_shows_a_missing_ones_picture(project: pytest.Pytester) -> None:
    project.runpytest("--splatgl-report", "a/b").assert_outcomes(failed=1)
    html = (project.path / "a" / "b" / "index.html").read_text(encoding="utf-8")
    assert "1 missing" in html and html.count("data:image/png") == 1
    refused = project.runpytest("--splatgl-report", "test_one.py")
    refused.stderr.fnmatch_lines(["*expected a folder to write to, got test_one.py: *"])


def test_options_that_exclude_each_other(project: pytest.Pytester) -> None:
    result = project.runpytest("--splatgl-update", "--splatgl-update-add")
    result.stderr.fnmatch_lines(["*--splatgl-update and --splatgl-update-add: expected one of them"])


def test_the_plugin_loads_without_opengl_and_numpy() -> None:
    """It is imported in every pytest run of whoever has the package: it must be light."""
    code = (
        "import sys, splatgl.comparison.pytest_plugin\n"
        "assert not {'moderngl', 'glcontext', 'numpy', 'PIL'} & set(sys.modules), sorted(sys.modules)\n"
        "import splatgl.comparison.image_regression\n"
        "assert not {'moderngl', 'glcontext'} & set(sys.modules)"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


CONFIGURED = """
class Figure:
    def savefig(self, file, format):
        PIL.Image.new("RGB", (9, 8), (200, 10, 30)).save(file, format)

class Plotly:
    def to_image(self, format):
        figure = io.BytesIO()
        PIL.Image.new("L", (9, 8), 33).save(figure, format)
        return figure.getvalue()

class Plotter:
    def screenshot(self, filename=None, return_img=True):
        return np.full((8, 9, 3), 77, np.uint8)

class Page:
    def screenshot(self, *, type=None, path=None, full_page=False):
        return Plotly().to_image("png")

class Driver:
    def get_screenshot_as_png(self):
        return Page().screenshot()

class Element:
    screenshot_as_png = Page().screenshot()

    def screenshot(self, filename):
        raise AssertionError

def test_kinds(splatgl_image, tmp_path):
    gray = np.full((8, 9), 99, np.uint8)
    for image in (gray, gray[..., None], gray.astype(np.uint16) * 257, np.stack([gray] * 3, -1)):
        splatgl_image(image, name="gray")
    splatgl_image(gray > 0, name="white")
    splatgl_image(Figure(), name="figure")
    splatgl_image(Plotly(), name="plotly")
    splatgl_image(Plotter(), name="plotter")
    for image in (Page(), Driver(), Element()):
        splatgl_image(image, name="page")

def test_spot(splatgl_image):
    image = picture()
    image.pixels[2:4, 2:4, 1:] = float(os.environ.get("SPOT", 0))
    splatgl_image(image)

def test_strict(splatgl_image):
    image = picture()
    image.pixels[2:4, 2:4, 1:] = float(os.environ.get("SPOT", 0))
    splatgl_image(image, max_difference=2, ignore=[])
"""


@pytest.mark.parametrize(
    ("table", "message"),
    [
        (
            '[tool.splatgl.compare]\nnoise = "drivr"',
            "[tool.splatgl.compare]: noise: expected none or driver, got 'drivr'",
        ),
        ('[tool.splatgl]\nnoise = "driver"', "[tool.splatgl]: expected the table [tool.splatgl.compare], got noise"),
        ("[tool.splatgl]\ncompare = 3", "[tool.splatgl.compare]: expected a table, got another value"),
    ],
)
def test_a_fault_of_the_project_is_one_line(pytester: pytest.Pytester, table: str, message: str) -> None:
    (pytester.path / "pyproject.toml").write_text(table)
    pytester.makepyfile(test_it="def test_it(splatgl_image):\n    pass\n")
    said = pytester.runpytest().stdout.str().partition("short test summary")[0]
    assert said.count(message) == 1 and "exception" not in said


def test_settings_of_the_project(pytester: pytest.Pytester, monkeypatch: pytest.MonkeyPatch) -> None:
    """pyproject.toml, then pytest's configuration, then the test; baselines in one folder, with a class's name."""
    from splatgl.platforms import processor_vendor

    monkeypatch.setenv("GITHUB_STEP_SUMMARY", "")
    project = '[tool.splatgl.compare]\nbaselines = "kept"\nignore = ["mark"]\nregions = {mark = [1, 1, 4, 4]}\n'
    (pytester.path / "pyproject.toml").write_text(project + 'class = "cpu"\nreport = "out"\nsummary = "out/s.md"\n')
    pytester.mkdir("tests").joinpath("test_set.py").write_text("import io, PIL.Image\n" + TEST + CONFIGURED)
    assert pytester.runpytest("--splatgl-update-class").ret == 0
    names = {Path(name).relative_to("kept/tests/test_set").as_posix() for name in baselines(pytester)}
    called = ("gray", "white", "figure", "plotly", "plotter", "page", "test_spot", "test_strict")
    vendor = f".cpu-{processor_vendor()}.png"
    assert names == {name + vendor for name in called}
    monkeypatch.setenv("SPOT", "1")
    pytester.runpytest().assert_outcomes(passed=3)
    assert "✅ Image regression: 13 same" in (pytester.path / "out" / "s.md").read_text(encoding="utf-8")
    ini = pytester.path / "tox.ini"
    plain = ini.read_text()
    ini.write_text(plain + "\nsplatgl =\n  ignore = [[0, 0, 3, 3]]\n  max-rmse = 0.001\n")
    result = pytester.runpytest("--junitxml", "j.xml", "-o", "junit_logging=system-out")
    result.assert_outcomes(passed=2, failed=1)
    result.stdout.fnmatch_lines(["*limits: rmse 0.0*> 0.001"])
    junit = (pytester.path / "j.xml").read_text(encoding="utf-8")
    attached = re.findall(r'<property name="attachment" value="(.*?)"', junit)
    assert [Path(name).name.split(".")[-2] for name in attached] == ["actual", "expected", "difference"]
    assert all(Path(name).is_file() and f"[[ATTACHMENT|{name}]]" in junit for name in attached)
    ini.write_text(plain + "\nsplatgl = noise = 'drivers'\n")
    pytester.runpytest("-k", "kinds").stdout.fnmatch_lines(["splatgl: noise: expected none or driver, got 'drivers'"])


def test_baselines_that_no_test_compares(pytester: pytest.Pytester) -> None:
    """Of a whole run: names that are gone, and folders of files that are gone; of a part nothing is said."""
    pytester.makepyfile(test_one=ONE + "\ndef test_more(splatgl_image):\n    splatgl_image(picture(0.3))\n")
    pytester.makepyfile(test_gone=ONE)
    assert pytester.runpytest("--splatgl-update").ret == 0
    (pytester.path / "test_gone.py").unlink()
    pytester.makepyfile(test_one=ONE)
    unused = ["unused baseline: baselines/test_gone/test_it.png", "unused baseline: baselines/test_one/test_more.png"]
    result = pytester.runpytest("--splatgl-report", "out")
    result.stdout.fnmatch_lines(unused)
    html = (pytester.path / "out" / "index.html").read_text(encoding="utf-8")
    assert "<code>rm baselines/test_gone/test_it.png baselines/test_one/test_more.png</code>" in html
    pytester.runpytest("-k", "test_it").stdout.no_fnmatch_line("*unused*")
    pytester.makepyfile(test_one=ONE + "\ndef test_skipped():\n    __import__('pytest').skip('later')\n")
    pytester.runpytest().stdout.no_fnmatch_line("*test_more.png*")


def test_each_frame_has_a_baseline(pytester: pytest.Pytester, monkeypatch: pytest.MonkeyPatch) -> None:
    pytester.makepyfile(test_film="def test_film(splatgl_image):\n    splatgl_image('film.gif')\n")
    frames = [PIL.Image.new("L", (20, 10), 50 * number) for number in range(4)]
    for count, options, outcome in ((3, ["--splatgl-update"], "passed"), (3, [], "passed"), (2, [], "failed")):
        frames[0].save(pytester.path / "film.gif", save_all=True, append_images=frames[1:count], duration=50)
        result = pytester.runpytest(*options)
        result.assert_outcomes(**{outcome: 1})
    result.stdout.fnmatch_lines(["test_film has 2 frames, but baselines/test_film/test_film-3.png is there"])
    assert len(baselines(pytester)) == 3
    frames[0].save(pytester.path / "film.gif", save_all=True, append_images=[frames[3], frames[2]], duration=50)
    pytester.runpytest().stdout.fnmatch_lines(["test_film-2 differs: *"])


def test_axes_and_texts_of_drawings_are_pictures() -> None:
    matplotlib = pytest.importorskip("matplotlib.figure", reason="Matplotlib is in the extra plots")
    figure = matplotlib.Figure((1, 1), dpi=50)
    axes = figure.subplots()
    assert np.array_equal(as_image(axes).pixels, as_image(figure).pixels)
    drawing = '<?xml version="1.0"?>\n<svg xmlns="http://www.w3.org/2000/svg" width="32" height="16"></svg>'
    if find_spec("cairosvg") is None:
        with pytest.raises(InputError, match="SVG: needs the library cairosvg"):
            as_image(drawing)
        return
    assert as_image(drawing).pixels.shape[:2] == as_image(drawing.encode()).pixels.shape[:2] == (16, 32)


def test_the_guides_sample_project(pytester: pytest.Pytester) -> None:
    """Its files, a changed bar, and the commands of its workflow."""
    matplotlib = pytest.importorskip("matplotlib.figure", reason="Matplotlib is in the extra plots")
    # imported whole, see PRESENT
    figure = matplotlib.Figure()
    figure.subplots()
    figure.savefig(io.BytesIO())
    text = (Path(__file__).parents[2] / "splatgl" / "docs" / "image-regression.md").read_text(encoding="utf-8")
    for name, content in re.findall(r"`([\w.]+)`:\n\n```python\n(.*?)```", text, re.DOTALL):
        (pytester.path / name).write_text(content)
    pytester.syspathinsert()
    for options, outcome in (([], "failed"), (["--splatgl-update"], "passed"), ([], "passed")):
        pytester.runpytest(*options).assert_outcomes(**{outcome: 1})
    test = pytester.path / "test_chart.py"
    test.write_text(test.read_text().replace("5", "4"))
    (step,) = re.findall(r"- run: pytest (.*)", text)
    result = pytester.runpytest(*step.replace('"$GITHUB_STEP_SUMMARY"', "summary.md").split())
    said = text.partition("```text\n")[2].splitlines()[0]
    result.stdout.fnmatch_lines([said.replace("64×30", "*×*")])
    assert (pytester.path / "image-report" / "index.html").is_file()
    assert "test_bars | different |" in (pytester.path / "summary.md").read_text(encoding="utf-8")


def test_names_that_differ_in_case_alone_are_refused(pytester: pytest.Pytester) -> None:
    """Where they are written as where they are there, such as from a system that tells them apart."""
    pytester.makepyfile(test_case=TEST + "def test_it(splatgl_image):\n    splatgl_image(picture(), name='Front')\n")
    pytester.runpytest("--splatgl-update").assert_outcomes(passed=1)
    pytester.makepyfile(test_case=TEST + "def test_it(splatgl_image):\n    splatgl_image(picture(), name='front')\n")
    told = "baseline front: expected a name that differs in more than case, got Front; rename one of them: macOS and*"
    for options in ((), ("--splatgl-update",)):
        result = pytester.runpytest(*options)
        result.assert_outcomes(failed=1)
        result.stdout.fnmatch_lines([told])
    assert [Path(name).name for name in baselines(pytester)] == ["Front.png"]


def test_faults_of_the_settings_are_told_once_each(pytester: pytest.Pytester) -> None:
    (pytester.path / "pyproject.toml").write_text(
        '[tool.splatgl.compare]\nnoise = "drivers"\nmax-rmse = "abc"\nmax-difrence = 3\n'
    )
    pytester.makepyfile(
        "import numpy as np\n\n"
        + "".join(f"def test_{n}(splatgl_image):\n    splatgl_image(np.zeros((8, 8, 3)))\n\n" for n in range(3))
    )
    told = pytester.runpytest("-p", "no:cacheprovider", "--tb=short").stdout.str().partition("short test summary")[0]
    for fault in ("noise: expected none or driver", "max-rmse: expected a number", "did you mean max-difference?"):
        assert told.count(fault) == 1
    assert told.count("as the first test with pictures says") == 2
