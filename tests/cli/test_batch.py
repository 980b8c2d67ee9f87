"""Pictures of several sources by one command; records in JSON as the guide lists them."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image as Pillow

import splatgl as sg
from splatgl.animation.movie import expanded
from splatgl.cli import presets
from splatgl.cli.main import main
from splatgl.data.image import Image
from splatgl.errors import InputError

pytestmark = pytest.mark.usefixtures("shared_programs")

GUIDE = Path(__file__).parents[2] / "splatgl" / "docs" / "publishing.md"
Said = pytest.CaptureFixture[str]


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with two volumes of different brightness and size, and a damaged file between them."""
    monkeypatch.chdir(tmp_path)
    ball = sg.scenes.ball(8).samples
    np.save("a1.npy", ball.astype(np.float32))
    Path("a2.npy").write_bytes(b"no array")
    np.save("a3.npy", 2 * np.pad(ball, 4).astype(np.float32))
    return tmp_path


def drawn(*arguments: str) -> int:
    return main(["render", *arguments, "--size", "24", "--check", "0"])


def test_a_picture_of_each_and_errors_at_the_end(here: Path, capsys: Said) -> None:
    """The damaged file leaves nothing behind, and stops no other."""
    assert drawn("a*.npy", "-o", "out/{name}.png", "--quiet") == 2
    assert sorted(path.name for path in Path("out").iterdir()) == ["a1.png", "a3.png"]
    told = capsys.readouterr().err.splitlines()
    assert told[0].startswith("splatgl: a2.npy: contents") and told[1:] == ["2 of 3 pictures drawn, 1 failed"]
    # what a command alone draws, bit for bit
    assert drawn("a3.npy", "-o", "one.png", "--quiet") == 0
    assert np.array_equal(Image.load("one.png").pixels, Image.load("out/a3.png").pixels)


def test_a_sheet_shows_all_patients(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Said) -> None:
    """By one command, of a pattern of folders; a sheet in vectors, of one source or over a picture is refused."""
    monkeypatch.chdir(tmp_path)
    ball = sg.scenes.ball(8).samples
    for number in range(10):
        folder = Path("patients") / f"p{number}"
        folder.mkdir(parents=True)
        np.save(folder / "ct.npy", (ball * (number + 1)).astype(np.float32))
    assert drawn("patients/*/ct.npy", "-o", "out/{folder}.png", "--sheet", "all.png", "--quiet") == 0
    sheet, names = Image.load("all.png").pixels, sorted(Path("out").iterdir())
    line = sheet.shape[0] // 3 - 24
    assert [path.stem for path in names] == [f"p{n}" for n in range(10)] and sheet.shape[1] == 4 * 24
    for number, name in enumerate(names):
        row, column = divmod(number, 4)
        top, left = row * (24 + line) + line, column * 24
        assert np.abs(sheet[top : top + 24, left : left + 24] - Image.load(name).pixels).max() < 0.01
        assert np.ptp(sheet[top - line : top, left : left + 20, 0]) > 0.5
    for options, told in (
        (["patients/*/ct.npy", "-o", "{folder}.svg", "--sheet", "a.png"], "--sheet: expected pictures in pixels"),
        (["patients/p1/ct.npy", "--sheet", "a.png"], "--sheet: expected several sources, got one"),
        (["patients/*/ct.npy", "-o", "{folder}.png", "--sheet", "p3.png"], "--sheet: expected another file than -o"),
    ):
        assert drawn(*options) == 2 and told in capsys.readouterr().err


def test_same_tells_of_a_window_that_is_given_once(here: Path, capsys: Said) -> None:
    """The default window of a CT could be level and width, too, but nobody gave it."""
    ct = np.where(np.indices((12, 12, 12))[0] > 6, 300, -1000).astype(np.int16)
    for name in ("c1.npy", "c2.npy", "c3.npy"):
        np.save(name, ct + (np.indices(ct.shape)[2] % 7).astype(np.int16))
    for window, count in (((), 0), (("--window", "40,400"), 1)):
        assert drawn("c1.npy", "c2.npy", "c3.npy", "-o", "{name}.png", "--same", *window) == 0
        assert capsys.readouterr().err.count("if they are level and width") == count


def test_same_camera_and_window(here: Path, capsys: Said) -> None:
    """The second is twice as bright and larger: alone it looks as the first, with --same it does not."""
    assert drawn("a1.npy", "a3.npy", "-o", "{name}.npz.png", "--json") == 0
    assert drawn("a1.npy", "a3.npy", "-o", "{name}-same.png", "--json", "--same") == 0
    apart, same = np.split(np.array([json.loads(line) for line in capsys.readouterr().out.splitlines()]), 2)
    assert apart[0]["transfer"] == same[0]["transfer"] == same[1]["transfer"] != apart[1]["transfer"]
    assert apart[0]["camera"] == same[0]["camera"] == same[1]["camera"] != apart[1]["camera"]


def test_same_takes_the_look_of_the_widest_source(here: Path, capsys: Said) -> None:
    """An empty first one is drawn, clear, and does not make the others solid; channels keep what a preset means."""
    tifffile = pytest.importorskip("tifffile", reason="tifffile writes the file")
    ball = sg.scenes.ball(8).samples
    view = ["--eye", "30,-20,12", "--look-at", "4,4,4", "--background", "transparent"]
    for n in range(3):
        np.save(f"e{n}.npy", ball.astype(np.float32) * n)
        both = np.stack([ball, np.roll(ball, 2, 2)], 1).astype(np.uint16) * (n + 1)
        tifffile.imwrite(f"c{n}.tif", both, imagej=True, metadata={"axes": "ZCYX", "mode": "composite"})
    channels = ["--channel", "all", "--preset", "mri"]
    for sources, options in ((["e0.npy", "e1.npy", "e2.npy"], []), (["c0.tif", "c2.tif"], channels)):
        assert drawn(*sources, "-o", "same-{name}.npy", "--same", *view, *options) == 0
        said = capsys.readouterr().err
        assert f"all use the transfer function of {sources[-1]}, whose values vary most" in said
        assert ("the picture is empty: e0.npy: expected voxels with an opacity" in said) == (sources[0] == "e0.npy")
        assert drawn(sources[-1], "-o", "alone.npy", *view, *options, "--quiet") == 0
        assert np.array_equal(np.load(f"same-{sources[-1][:2]}.npy"), np.load("alone.npy"))
    empty, half, full = (np.load(f"same-e{n}.npy")[..., 3].mean() for n in range(3))
    assert empty == 0 < half < 0.8 * full
    # slices have the window of the widest, too
    assert drawn("e0.npy", "e1.npy", "e2.npy", "-o", "slice-{name}.npy", "--same", "--slice", "z=4", "--quiet") == 0
    empty, half, full = (np.load(f"slice-e{n}.npy")[..., :3] for n in range(3))
    # under the same scale bar
    assert 0.1 * np.abs(full - empty).max() < np.abs(half - empty).max() < 0.8 * np.abs(full - empty).max()
    assert (empty <= half + 1e-6).all() and (half <= full + 1e-6).all()


REFUSED = {
    "a1.npy a3.npy -o out.png": "-o: expected a name for each source, such as 'out/{name}.png', got out.png",
    "a1.npy b/a1.npy -o {name}.png": "-o: expected a file for each source, got a1.png for a1.npy and b/a1.npy; ",
    "a1.npy a3.npy -o {what}.png": "-o: expected a name with {name}, {folder} or {number}, got {what}.png",
    "a1.npy a3.npy -o {name}.npy": "a1.npy: expected another file than the source",
    "a1.npy a3.npy -o {name}.what": "a1.what: expected a name that ends in",
    "a1.npy a3.npy --depth d.npy": "--depth: expected one source, got several",
    "b*.npy": "b*.npy: expected a pattern that files fit, got none",
    "a1.npy --same": "--same: expected several sources, got one",
}


@pytest.mark.parametrize("typed", REFUSED)
def test_what_is_refused_before_anything_is_drawn(typed: str, here: Path, capsys: Said) -> None:
    before = sorted(Path().iterdir())
    assert drawn(*typed.split()) == 2
    told = capsys.readouterr()
    assert REFUSED[typed] in told.err and len(told.err.splitlines()) == 1 and told.out == ""
    assert sorted(Path().iterdir()) == before


@pytest.mark.long
def test_workers_draw_a_file_each(here: Path, capsys: Said) -> None:
    """The same pictures, bit for bit, with the first one's camera and window."""
    pytest.importorskip("distributed", reason="distributed is in the extra scale")
    for folder, more in (("one", []), ("two", ["--workers", "2"])):
        assert drawn("a*.npy", "-o", f"{folder}/{{name}}.npy", "--same", "--quiet", *more) == 2
        assert capsys.readouterr().err.splitlines()[-1] == "2 of 3 pictures drawn, 1 failed"
    for name in ("a1", "a3"):
        assert np.array_equal(np.load(f"one/{name}.npy"), np.load(f"two/{name}.npy"))


# --- JSON ------------------------------------------------------------------------------------------------------------


def keys_of(command: str) -> dict[str, str]:
    """What the guide says of the keys of a record."""
    rows = re.findall(rf"(?m)^\| `{command}` \| (.+?) \| (.+) \|$", GUIDE.read_text(encoding="utf-8"))
    return {key: about for keys, about in rows for key in re.findall(r"`(\w+)`", keys)}


def json_of(capsys: Said, *arguments: str) -> Any:
    assert main(list(arguments)) == 0
    (line,) = capsys.readouterr().out.splitlines()
    return json.loads(line, parse_constant=lambda name: pytest.fail(f"{name} is not JSON"))


CHECKS: dict[str, Callable[[Any], bool]] = {
    "size": lambda value: value == [24, 24],
    "source": lambda value: value.endswith("a1.npy"),
    "splats": lambda value: isinstance(value, int) and value > 0,
    "error": lambda value: value is None,
    "notes": lambda value: all(isinstance(text, str) for text in value),
    "camera": lambda value: set(value) == {"eye", "forward", "up", "perspective", "extent"},
    "transfer": lambda value: set(value) == {"points", "colormap", "window", "length"},
    "dpi": lambda value: value == 200,
}


def test_records_have_the_keys_of_the_guide(here: Path, capsys: Said) -> None:
    record = json_of(capsys, "render", "a1.npy", "-o", "a.png", "--size", "24", "--dpi", "200", "--json")
    assert set(record) == set(keys_of("render"))
    assert [key for key, check in CHECKS.items() if not check(record[key])] == []
    info = json_of(capsys, "info", "a1.npy", "--json")
    samples = np.load("a1.npy")
    assert set(info) == set(keys_of("info")) and info["voxels"] == list(samples.shape[::-1])
    assert info["range"] == [samples.min(), samples.max()] and info["mean"] == pytest.approx(samples.mean())
    assert sum(info["histogram"]["counts"]) == samples.size == np.prod(info["levels"][0])
    plain, fitted = json_of(capsys, "presets", "--json"), json_of(capsys, "presets", "a1.npy", "--json")
    assert {row["name"] for row in plain} == set(sg.presets())
    assert all(set(row) == set(keys_of("presets")) for row in fitted)
    assert all(set(row) == set(keys_of("presets")) - {"points", "window"} for row in plain)


def test_a_sheet_of_presets_holds_whole_pictures() -> None:
    """Of whatever size, beside each other under their names."""
    red, blue = (Pillow.new("RGB", (160, 40), color) for color in ("#ff0000", "#0000ff"))
    page = np.asarray(Pillow.open(BytesIO(presets.sheet({"a": red, "b": None, "c": blue}, (160, 40)))))
    assert page.shape == (presets.LABEL + 40, 480, 3)
    assert (page[presets.LABEL :, :160] == (255, 0, 0)).all() and (page[presets.LABEL :, 320:] == (0, 0, 255)).all()


def test_json_of_errors_and_choices(here: Path, capsys: Said) -> None:
    np.savez("two.npz", a=np.load("a1.npy"), b=np.load("a1.npy"))
    record = json_of(capsys, "info", "two.npz", "--json")
    assert record["option"] == "array" and [row["name"] for row in record["choices"]] == ["a", "b"]
    assert drawn("a2.npy", "a3.npy", "--json") == 2
    lines = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert set(lines[0]) == {"source", "output", "error"} and "NumPy" in lines[0]["error"]
    assert lines[1]["error"] is None


def test_patterns_may_name_folders(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Folders of patients with a volume each; folders that exist may hold brackets."""
    monkeypatch.chdir(tmp_path)
    for name in ("p[1]", "p10", "p2"):
        (tmp_path / "all" / name).mkdir(parents=True)
        np.save(tmp_path / "all" / name / "ct.npy", np.ones((2, 2, 2)))
    assert expanded(["all/*/ct.npy"]) == [f"all/{name}/ct.npy" for name in ("p2", "p10", "p[1]")]
    assert expanded(["all/p[1]/*.npy"]) == ["all/p[1]/ct.npy"]
    assert len(expanded([str(tmp_path / "**" / "c?.npy")])) == 3
    with pytest.raises(InputError, match="expected a pattern that files fit, got none"):
        expanded(["none*/ct.npy"])
