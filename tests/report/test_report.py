"""Error against run time: errors, fronts, the registry, and the files that come out."""

from __future__ import annotations

import csv
import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import splatgl as sg
from splatgl.cli.main import main
from splatgl.cli.report import list_methods
from splatgl.report import methods
from splatgl.report.page import as_csv, conclusion, left_out, page, registry, strip
from splatgl.report.sweep import LEVELS, Point, ReportSubject, SceneResults, Sweep, Timing, Truths, errors, front
from tests.helpers.splatting import SPLATS
from tests.stress import CASES, run_case

pytestmark = pytest.mark.usefixtures("shared_programs")

LEVEL = replace(LEVELS["quick"], size=16, rounds=2)
MACHINE = {
    "renderer": "none",
    "opengl": "4.5",
    "processor": "p",
    "cores": 2,
    "system": "s",
    "python": "3",
    "versions": {},
}
HEAD = {"version": "0", "machine": MACHINE}


def point(name: str, error: float, seconds: float) -> Point:
    return Point(name, error, Timing((seconds,)))


@pytest.fixture(scope="module")
def subject() -> ReportSubject:
    volume = sg.scenes.ball(5)
    transfer = sg.Transfer(points=[(0.0, 0.0), (1.0, 0.6)], unit=1.0)

    def build(threshold: float, coarse: int, post: str) -> sg.Splats:
        if post:
            return sg.extract(volume, transfer, classification="post", kernel=post)
        return sg.extract(volume, transfer, max(threshold, 0.05 * coarse), classification="pre")

    camera = sg.Camera.orbit(volume, azimuth=20, elevation=10, size=(16, 16))
    return ReportSubject("ball", camera, SPLATS, build, content=(volume, transfer))


def swept(renderer: sg.Renderer, subject: ReportSubject, *only: str, rounds: int = 1) -> SceneResults:
    """Results of some methods or axes."""
    made = Sweep(Truths(renderer, subject, LEVEL))
    made.pictures(LEVEL.methods(only), lambda text: None)
    made.times(rounds, lambda text: None)
    return made.results


def test_errors_of_known_pictures() -> None:
    right = np.full((10, 100, 4), 0.5)
    drawn = right.copy()
    drawn[0, 0] += 0.1
    drawn[:, 1] -= 0.002
    found = errors(sg.Image(drawn), sg.Image(right))
    assert found["maximum"] == pytest.approx(0.1)
    assert found["rmse"] == pytest.approx(np.sqrt((0.01 + 10 * 4e-6) / 1000) / 0.5)
    # one pixel of a thousand is far off, ten by less than a step
    assert found["share_over"] == pytest.approx(1 / 1000)
    assert found["energy"] == pytest.approx((0.1 - 10 * 0.002) / 500)


def test_the_front_is_of_what_is_faster_or_more_accurate_than_all_others() -> None:
    fast, good, slow = point("fast", 1e-1, 1.0), point("good", 1e-4, 2.0), point("slow", 1e-3, 3.0)
    twin, wasted, exact = point("twin", 1e-4, 2.0), point("wasted", 1e-1, 5.0), point("exact", 0.0, 9.0)
    assert front([wasted, slow, fast, good, twin, exact]) == [fast, good, exact]
    assert front([]) == []


def test_times_are_compared_round_by_round() -> None:
    """Load slows all methods of a round: ratios hold where medians do not."""
    quick, slow = Timing((1.0, 9.0, 1.0, 1.0)), Timing((2.0, 18.0, 2.0))
    assert quick.median == 1.0 and slow.over(quick).rounds == (2.0, 2.0, 2.0)


def test_the_registry_holds_what_trades_accuracy_for_time() -> None:
    names = set(methods.methods())
    assert {"exact", "grid", "ray", "z_s 50%", "table 32", "table 512", "bits 8", "gaussian"} <= names
    assert {"2×2", "8×8", "target rgba8", "tolerance 0.0001", "threshold 0.1", "quads", "preview 1/2"} <= names
    for axis in methods.AXES.values():
        assert axis.about and axis.methods and set(axis.truths) <= set(methods.TRUTHS)
    quick, full = (LEVELS[name].methods() for name in ("quick", "full"))
    assert {*methods.AXES} == {methods.axis_of(m.name).name for m in quick}
    assert len(names) == len(full) > len(quick)
    assert [m.name for m in LEVELS["quick"].methods(("tolerance", "4×4"))][-1] == "tolerance 0.0001"


@pytest.fixture
def undrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """No diagrams, which take most of a small report's time."""
    monkeypatch.setattr("splatgl.report.page._diagrams", lambda scenes, head: ())


@pytest.fixture
def mine() -> Iterator[str]:
    """A method of one's own."""
    axes = methods.AXES
    methods.register(methods.MethodAxis("mine", "made up", (methods.Method("mine 1", {"table_size": 77}),)))
    yield "mine 1"
    # from where it was put: the test may have others in their place
    del axes["mine"]


@pytest.mark.long
def test_a_new_method_is_one_entry(
    renderer: sg.Renderer, subject: ReportSubject, mine: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It appears in the report, in the stress suite, in the list and in what the README is held to."""
    with pytest.raises(sg.InputError):
        methods.register(methods.MethodAxis("other", "taken", (methods.Method(mine),)))
    scene = swept(renderer, subject, "mine")
    assert [row.method for row in scene.rows] == [mine] and scene.rows[0].timing
    assert mine in as_csv([scene]) and mine in page([scene], HEAD, LEVEL, {}, {})
    assert mine in str(registry()) and mine in list_methods()
    # that case draws all there are; two axes are enough here
    monkeypatch.setattr(methods, "AXES", {name: methods.AXES[name] for name in ("settings", "mine")})
    found = run_case(CASES["methods"], renderer)
    assert found.ok and f"{mine}: error/bound" in {each.what for each in found.checks}


@pytest.mark.turns(3)
@pytest.mark.few(6)
@pytest.mark.parametrize("name", methods.methods())
def test_every_method_draws(renderer: sg.Renderer, subject: ReportSubject, name: str) -> None:
    splats, settings = subject.inputs(methods.methods()[name])
    image = renderer.render(splats, subject.camera, settings)
    assert np.isfinite(image.pixels).all() and image.pixels.any()


def test_truths_are_four_and_kept(renderer: sg.Renderer, subject: ReportSubject) -> None:
    truths = Truths(renderer, subject, LEVEL)
    settings = SPLATS
    made = {name: truths.get(name, settings).pixels for name in methods.TRUTHS}
    reference = sg.reference.render(subject.splats(), subject.camera, settings).pixels
    np.testing.assert_array_equal(made["reference"], reference)
    fine = settings.replace(antialias="supersample", samples=8)
    sampled = sg.reference.render(subject.splats(), subject.camera, fine).pixels
    assert np.abs(made["sampled"] - sampled).max() < 0.01
    assert 0 < np.abs(made["integral"] - made["sampled"]).max() < 0.2
    assert 0 < np.abs(made["field"] - made["integral"]).max() < 0.3
    # drawn once, whatever is none of a truth's concern
    assert truths.get("integral", settings.replace(technique="quads")).pixels is made["integral"]
    for truth in ("integral", "field"):
        with pytest.raises(sg.InputError, match="composite"):
            truths.get(truth, SPLATS.replace(blend="xray"))
    with pytest.raises(sg.InputError, match="--full"):
        truths.get("reference", SPLATS.replace(antialias="supersample", samples=64))


def test_the_papers_8_bits_are_told_apart_from_its_forms(renderer: sg.Renderer, subject: ReportSubject) -> None:
    """Its framebuffer mixes display values, and is compared with a reference that mixes them: each of form, table and
    blending adds an error of its own, where against linear light the whole would be the other mixture.
    """
    scene = swept(renderer, subject, "settings")
    names = methods.EXACT, methods.PAPER_FLOAT, methods.PAPER_TABLE, methods.PAPER
    off = [point.error for name in names if (point := scene.point(name, "reference"))]
    assert len(off) == len(names)
    assert off == sorted(off) and off[0] < 0.5 * off[1]
    splats, settings = subject.inputs(methods.methods()[methods.PAPER])
    linear = Truths(renderer, subject, LEVEL).get("reference", settings.replace(target="rgba32f"))
    assert off[-1] < 0.5 * errors(renderer.render(splats, subject.camera, settings), linear)["rmse"]
    paper = scene.row(methods.PAPER)
    assert paper and set(paper.errors) == {"reference"} and "display values" in paper.missing["sampled"]
    (told,) = (line for line in conclusion(scene) if "**Drawing**" in line)
    assert "the forms of 1998" in told and "blended in 8 bits" in told


@pytest.mark.long
def test_a_sweep_and_its_repetition(
    renderer: sg.Renderer, subject: ReportSubject, monkeypatch: pytest.MonkeyPatch
) -> None:
    # so near that nothing is antialiased
    subject, turns = replace(subject, camera=subject.camera.resized((48, 48))), list[str]()
    turn = Sweep.turn
    monkeypatch.setattr(Sweep, "turn", lambda self, method: turns.append(method.name) or turn(self, method))
    found = [swept(renderer, subject, "settings", "attenuation", "radial", rounds=2) for _ in range(2)]
    first, second = ([replace(row, timing=None, extraction=0.0) for row in scene.rows] for scene in found)
    assert first == second
    # in no order that favours any
    once = turns[: len(turns) // 2]
    half = len(once) // 2
    assert once[:half] != once[half:] and sorted(once[:half]) == sorted(once[half:])
    exact, paper = found[0].row("exact"), found[0].row("paper 1998")
    assert exact and paper and exact.timing and len(exact.timing.rounds) == 2
    assert exact.errors["reference"]["rmse"] < 0.5 * paper.errors["reference"]["rmse"]
    # what asks for the same plan is the same picture, and told as such
    same = found[0].row("attenuation opacity")
    assert same and same.same_as == "exact" and same.timing == exact.timing


@pytest.mark.long
def test_the_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("matplotlib")
    folder = tmp_path / "out"
    only = ["--only", "settings", "tolerance", "antialiasing off", "2×2", "gaussian", "grid", "preview"]
    asked = ["report", "letter-f", "--quick", "--size", "12", "--rounds", "2", *only, "-o", str(folder)]
    assert main(asked) == 0
    assert "report.html" in capsys.readouterr().out
    page = (folder / "report.html").read_text()
    # nothing from elsewhere
    assert not re.findall(r"""(?:src|href)=["'](?!data:)""", page) and "<script" not in page and "url(" not in page
    assert all(word in page for word in ("letter-f", "exact", "paper 1998", "OpenGL", 'class="diagram"', "<figure>"))
    rows = list(csv.DictReader((folder / "report.csv").open()))
    assert {row["method"] for row in rows} >= {"exact", "paper 1998", "grid", "tolerance 0.0001"}
    assert all(float(row["seconds"]) > 0 for row in rows)
    # the tolerance asked for is kept
    kept = [row for row in rows if row["method"].startswith("tolerance") and float(row["tolerance"]) >= 1e-3]
    assert len(kept) == 3 and all(float(row["reference_maximum"]) <= float(row["tolerance"]) for row in kept)
    assert {path.name for path in folder.iterdir()} == {"report.html", "report.csv", "letter-f.png", "letter-f.svg"}


@pytest.mark.parametrize(
    "wrong",
    [
        ["--only", "nothing"],
        ["--size", "1"],
        ["letter-f", "--size", "1000000"],
        ["--rounds", "0"],
        ["no-such-scene"],
        ["letter-f", "no-such-file.nrrd"],
        ["{here}"],
        ["{here}/cut.nrrd"],
        ["{here}/nan.npy"],
        ["{here}/clear.toml"],
        ["letter-f", "-o", "{here}/cut.nrrd"],
        ["letter-f", "-o", "{here}/cut.nrrd/below"],
        ["letter-f", "-o", ""],
    ],
)
def test_bad_input_is_one_line(wrong: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """And leaves nothing behind."""
    (tmp_path / "cut.nrrd").write_bytes(b"NRRD0004\ntype: uchar\ndimension: 3\nsizes: 9 9 9\nencoding: raw\n\n123")
    np.save(tmp_path / "nan.npy", np.full((3, 3, 3), np.nan))
    np.save(tmp_path / "good.npy", np.ones((3, 3, 3)))
    (tmp_path / "clear.toml").write_text('volume = "good.npy"\n[transfer]\npoints = [[0, 0.0], [1, 0.0]]')
    before = sorted(tmp_path.rglob("*"))
    given = [part.format(here=tmp_path) for part in wrong]
    output = [] if "-o" in given else ["-o", str(tmp_path / "out")]
    assert main(["report", "--quick", *given, *output]) == 2
    assert len(capsys.readouterr().err.splitlines()) == 1
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.long
@pytest.mark.usefixtures("undrawn")
def test_small_and_broken_volumes_have_reports(tmp_path: Path) -> None:
    np.save(tmp_path / "one.npy", np.ones((1, 1, 1)))
    np.save(tmp_path / "holes.npy", np.where(np.arange(216) % 7, 0.5, np.nan).reshape(6, 6, 6))
    asked = ["--quick", "--size", "12", "--rounds", "1", "--only", "settings", "preview", "--quiet"]
    sources = [str(tmp_path / f"{name}.npy") for name in ("one", "holes")]
    assert main(["report", *sources, *asked, "-o", str(tmp_path / "out")]) == 0
    rows = list(csv.DictReader((tmp_path / "out" / "report.csv").open()))
    assert {row["scene"] for row in rows} == {"one", "holes"} and "nan" not in str(rows)


@pytest.mark.usefixtures("undrawn")
def test_no_sampled_truth_costs_no_report(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where a picture is too large for it: the pages say so."""

    def refuse(self: Truths, settings: sg.Settings, samples: int) -> np.ndarray:
        raise sg.InputError("image size: too large")

    monkeypatch.setattr(Truths, "_sampled", refuse)
    asked = ["report", "letter-f", "--quick", "--size", "12", "--rounds", "1", "--only", "settings", "2×2", "--quiet"]
    assert main([*asked, "-o", str(tmp_path)]) == 0
    text = (tmp_path / "report.html").read_text()
    assert "<td>exact, antialiasing<td>image size: too large" in text and "<b>Drawing</b>" in text


def test_the_list(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["report", "--list"]) == 0
    listed = capsys.readouterr().out
    assert all(name in listed for name in methods.methods())


@pytest.mark.usefixtures("undrawn")
def test_ctrl_c_leaves_pages(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(Sweep, "times", lambda *_: (_ for _ in ()).throw(KeyboardInterrupt))
    asked = ["report", "letter-f", "--quick", "--size", "12", "--only", "settings", "-o", str(tmp_path)]
    assert main(asked) == 130
    assert "the page shows what is done" in capsys.readouterr().err
    assert "not timed: interrupted" in (tmp_path / "report.html").read_text()


def test_ewa_splatting_is_measured_and_shown_but_not_timed(renderer: sg.Renderer, subject: ReportSubject) -> None:
    results = swept(renderer, subject, "ewa")
    ewa, beside = results.rows
    assert (ewa.method, beside.method) == (methods.EWA, methods.BESIDE_EWA) and not ewa.same_as
    # its filter is wider than that of the same Gaussians, which are drawn as row 1
    assert ewa.timing is None and ewa.bound is None and beside.timing is not None
    assert ewa.errors["reference"]["rmse"] > 100 * beside.errors["reference"]["rmse"]
    assert (methods.EWA, "not timed: drawn in float64") in left_out(results)
    settings = subject.inputs(methods.methods()[methods.EWA])[1]
    right = sg.reference.render(subject.splats(), subject.camera, settings, row="ewa").pixels
    np.testing.assert_array_equal(subject.draw(renderer, methods.methods()[methods.EWA]).pixels, right)
    assert f'alt="{methods.EWA}"' in strip(renderer, results, Truths(renderer, subject, LEVEL))


def test_own_data_is_measured_whole_at_some_pixels(
    renderer: sg.Renderer, subject: ReportSubject, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Errors at pixels that show matter are near those of all; what is late is left out, with a reason."""
    level = replace(LEVELS["whole"], size=16, pixels=10_000, rays=LEVEL.rays)
    some, every = (Truths(renderer, subject, level) for level in (level, replace(level, pixels=None)))
    assert 40 < len(some.places) < 256 == len(every.places)
    for name, truth in (("exact", "reference"), ("2×2", "field")):
        method = methods.methods()[name]
        image, settings = subject.draw(renderer, method), subject.inputs(method)[1]
        few, all_of = (truths.errors(image, truth, settings)["rmse"] for truths in (some, every))
        assert few == pytest.approx(all_of, rel=0.1)
    late = Sweep(Truths(renderer, subject, replace(level, seconds=0)))
    late.pictures(level.methods(), lambda text: None)
    assert {row.omitted for row in late.results.rows} == {"the 0 seconds were over; --full measures all"}
    assert [row.method for row in late.results.rows] == list(level.names)

    taken = []
    monkeypatch.setattr("splatgl.cli.report.open_subjects", lambda sources, level: taken.append(level.name) or [])
    sg.scenes.ball(5).save(tmp_path / "ball.nrrd")
    for args in ([str(tmp_path / "ball.nrrd")], ["tunnel"], [str(tmp_path / "ball.nrrd"), "--full"]):
        main(["report", *args, "-o", str(tmp_path / "report"), "--quiet"])
    assert taken == ["whole", "normal", "full"]
