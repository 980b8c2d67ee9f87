"""Error against run time: errors, fronts, the registry, resuming, and the files that come out."""

from __future__ import annotations

import csv
import json
import re
from collections.abc import Iterator
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import splatgl as sg
from splatgl.cli.main import main
from splatgl.cli.report import list_methods
from splatgl.data.scenes import SCENES
from splatgl.reference.field import field_integral
from splatgl.reference.ray_integral import ray_integral
from splatgl.studies.accuracy import content, methods
from splatgl.studies.accuracy import sweep as work
from splatgl.studies.accuracy.content import verdict
from splatgl.studies.accuracy.export import publish
from splatgl.studies.accuracy.ground_truth import LEVELS, Subject, Truths
from splatgl.studies.accuracy.pareto import Point, Timing, cheapest, dominance, front, stairs
from splatgl.studies.accuracy.sweep import Results, Store, Sweep, errors, select_methods
from splatgl.studies.accuracy.vtk_peers import MAPPERS, Peer
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
HEAD = {"version": "0", "level": "quick", "size": 16, "rounds": 2, "machine": MACHINE}


def point(name: str, error: float, seconds: float) -> Point:
    return Point(name, error, Timing.of({0: seconds}))


def noisy(points: list[Point], rng: np.random.Generator, rounds: int = 9) -> list[Point]:
    """The same, timed anew: the machine up to twice as slow in each round, each method 5 % off."""
    slow = rng.uniform(1, 2, rounds) * rng.uniform(1, 3)

    def timed(p: Point) -> Timing:
        return Timing.of(dict(enumerate(p.time.median * slow * rng.lognormal(0, 0.05, rounds))))

    return [replace(p, time=timed(p)) for p in points]


@pytest.fixture(scope="module")
def subject() -> Subject:
    volume = sg.scenes.ball(5)
    transfer = sg.Transfer(points=[(0.0, 0.0), (1.0, 0.6)], unit=1.0)

    def build(threshold: float, coarse: int, post: str) -> sg.Splats:
        if post:
            return sg.extract(volume, transfer, classification="post", kernel=post)
        return sg.extract(volume, transfer, max(threshold, 0.05 * coarse), classification="pre")

    camera = sg.Camera.orbit(volume, azimuth=20, elevation=10, size=(16, 16))
    return Subject("ball", camera, SPLATS, build, content=(volume, transfer))


def sweep(renderer: sg.Renderer, subject: Subject, store: Store, folder: Path | None = None) -> Sweep:
    return Sweep(renderer, subject, Truths(renderer, subject, LEVEL, folder), store, flip=False)


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
    assert found["p999"] == pytest.approx(0.002, rel=0.1)
    assert found["energy"] == pytest.approx((0.1 - 10 * 0.002) / 500)


def test_the_front_and_what_it_beats() -> None:
    fast, good, slow = point("fast", 1e-1, 1.0), point("good", 1e-4, 2.0), point("slow", 1e-3, 3.0)
    alike, wasted = point("alike", 1.05e-4, 1.98), point("wasted", 1e-1, 5.0)
    points = [fast, good, slow, alike, wasted]
    assert front(points) == [fast, good]
    assert str(dominance(good, points)) == "front"
    assert {str(dominance(p, points)) for p in (slow, wasted, alike)} == {"dominated by good"}
    named = {limit: p.name if p else None for limit, p in cheapest(points, (1e-1, 1e-2, 1e-5))}
    assert named == {1e-1: "fast", 1e-2: "alike", 1e-5: None}


def test_the_cheapest_is_the_cheapest() -> None:
    """By median, whatever the noise of the times and however near the next is; of equal times the most accurate."""
    rng = np.random.default_rng(3)
    for _ in range(50):
        times, errors_ = np.round(rng.lognormal(0, 0.1, 12), 2), 10.0 ** rng.uniform(-5, 0, 12)
        points = noisy([point(str(n), e, t) for n, (e, t) in enumerate(zip(errors_, times, strict=True))], rng)
        for limit, found in cheapest(points):
            under = [p for p in points if p.error <= limit]
            assert (found is None) == (not under)
            assert found is None or all((found.time.median, found.error) <= (p.time.median, p.error) for p in under)
    tied = [point("a", 1e-3, 1.0), point("b", 1e-4, 1.0), point("c", 1e-5, 1.001)]
    assert [p and p.name for _, p in cheapest(tied, (1e-2, 5e-5, 1e-6))] == ["b", "c", None]


def test_two_reports_never_contradict_each_other() -> None:
    """Whatever the noise: what is on the front in one is not dominated in the other, and what is clear stays."""
    rng = np.random.default_rng(5)
    clear = [point(str(n), 10.0**-n, 1.5**n) for n in range(6)]
    points = [*clear, point("worse", 1e-2, 3.0), point("close", 1e-3, 0.9 * 1.5**4), point("twin", 1e-5, 1.5**5)]
    for _ in range(20):
        found = [noisy(points, rng) for _ in range(2)]
        words = [{p.name: dominance(p, run).word for p in run} for run in found]
        for name in words[0]:
            assert {words[0][name], words[1][name]} != {"front", "dominated"}, name
        assert {p.name for run in found for p in front(run)} <= {p.name for p in clear}
        assert {"0", "1", "2", "3", "4"} <= {p.name for p in front(found[0])}
        assert words[0]["worse"] == "dominated" and words[0]["twin"] in ("dominated", "unsure")


def test_times_are_compared_round_by_round() -> None:
    quick, slow = Timing.of({0: 1.0, 1: 9.0, 2: 1.0, 3: 1.0}), Timing.of({0: 2.0, 1: 18.0, 2: 2.0, 4: 0.1})
    assert quick.faster(slow) == 1.0 and slow.faster(quick) == 0.0 and slow.over(quick).median == 2.0
    assert (quick.median, quick.low, quick.high, quick.count) == (1.0, 1.0, 9.0, 4)
    # of times that could be either way nothing is said
    points = [Point("a", 1e-3, slow), Point("b", 1e-2, Timing.of({0: 1.0, 1: 18.0, 2: 1.0, 4: 0.1}))]
    assert str(dominance(points[1], points)) == "front, or behind a"
    assert front(points) == points[:1] and front(points, unsure=True) == stairs(points) == points[::-1]


def test_no_error_is_the_best() -> None:
    assert [p.name for p in front([point("a", 0.0, 2.0), point("b", 1e-9, 1.0), point("c", 1e-9, 3.0)])] == ["b", "a"]


def test_the_registry_holds_what_trades_accuracy_for_time() -> None:
    names = set(methods.methods())
    assert {"exact", "grid", "ray", "z_s 50%", "table 32", "table 512", "bits 8", "gaussian"} <= names
    assert {"2×2", "8×8", "target rgba8", "tolerance 0.0001", "threshold 0.1", "quads", "preview 1/2"} <= names
    for axis in methods.AXES.values():
        assert axis.about and axis.methods and set(axis.truths) <= set(methods.TRUTHS)
    quick = select_methods(LEVELS["quick"])
    assert {*methods.AXES} - {"peers"} == {methods.axis_of(m.name).name for m in quick}
    assert (
        len(select_methods(LEVELS["full"], peers=True))
        == len(names)
        > len(select_methods(LEVELS["quick"], peers=True))
        > len(quick)
    )


@pytest.fixture
def undrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """No diagrams, which take most of a small report's time."""
    monkeypatch.setattr("splatgl.studies.accuracy.export._diagrams", lambda results: {})


@pytest.fixture
def mine() -> Iterator[str]:
    """A method of one's own."""
    axes = methods.AXES
    methods.register(methods.Axis("mine", "made up", (methods.Method("mine 1", {"table_size": 77}),)))
    yield "mine 1"
    # from where it was put: the test may have others in their place
    del axes["mine"]


@pytest.mark.long
@pytest.mark.usefixtures("undrawn")
def test_a_new_method_is_one_entry(
    renderer: sg.Renderer, subject: Subject, mine: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It appears in the report, in the stress suite, in the list and in what the README is held to."""
    with pytest.raises(sg.InputError):
        methods.register(methods.Axis("other", "taken", (methods.Method(mine),)))
    store = Store(tmp_path / "runs.jsonl", HEAD)
    store.add("scene", scene="ball", mark="", splats=1, size=[16, 16], note="")
    made, wanted = sweep(renderer, subject, store), select_methods(LEVEL, ("mine",))
    made.pictures(wanted, lambda text: None)
    made.times(wanted, 2, lambda text: None)
    (line,) = store.of("picture")
    assert line["method"] == mine and "77" in line["drawn"]["footprint"]
    publish(Results.of(store), store, tmp_path, {})
    for name in ("report.md", "report.html", "report.csv", "report.json"):
        assert mine in (tmp_path / name).read_text()

    assert mine in content.registry().markdown() and mine in list_methods()
    # that case draws all there are; two axes are enough here
    monkeypatch.setattr(methods, "AXES", {name: methods.AXES[name] for name in ("settings", "mine")})
    found = run_case(CASES["methods"], renderer)
    assert found.ok and f"{mine}: error/bound" in {each.what for each in found.checks}


@pytest.mark.few(6)
@pytest.mark.parametrize("name", [name for name, method in methods.methods().items() if not method.peer])
def test_every_method_draws(renderer: sg.Renderer, subject: Subject, name: str) -> None:
    splats, settings = subject.inputs(methods.methods()[name])
    image = renderer.render(splats, subject.camera, settings)
    assert np.isfinite(image.pixels).all() and image.pixels.any()


def test_truths_are_four_and_kept(renderer: sg.Renderer, subject: Subject, tmp_path: Path) -> None:
    truths = Truths(renderer, subject, LEVEL, tmp_path)
    settings = SPLATS
    made = {name: truths.get(name, settings).pixels for name in methods.TRUTHS}
    reference = sg.reference.render(subject.splats(), subject.camera, settings).pixels
    np.testing.assert_array_equal(made["reference"], reference)
    fine = settings.but(antialias="supersample", samples=8)
    sampled = sg.reference.render(subject.splats(), subject.camera, fine).pixels
    assert np.abs(made["sampled"] - sampled).max() < 0.01
    assert 0 < np.abs(made["integral"] - made["sampled"]).max() < 0.2
    assert 0 < np.abs(made["field"] - made["integral"]).max() < 0.3
    assert len(list(tmp_path.iterdir())) == 4
    again = Truths(renderer, subject, LEVEL, tmp_path).get("integral", settings).pixels
    np.testing.assert_array_equal(again, made["integral"])
    for truth in ("integral", "field"):
        with pytest.raises(sg.InputError, match="composite"):
            truths.get(truth, SPLATS.but(blend="xray"))
    with pytest.raises(sg.InputError, match="--full"):
        truths.get("reference", SPLATS.but(antialias="supersample", samples=64))


def test_the_papers_8_bits_are_told_apart_from_its_forms(
    renderer: sg.Renderer, subject: Subject, tmp_path: Path
) -> None:
    """Its framebuffer mixes display values, and is compared with a reference that mixes them: each of form, table and
    blending adds an error of its own, where against linear light the whole would be the other mixture.
    """
    store = Store(tmp_path / "runs.jsonl", HEAD)
    store.add("scene", scene="ball")
    made, wanted = sweep(renderer, subject, store), select_methods(LEVEL, ("settings",))
    made.pictures(wanted, lambda text: None)
    made.times(wanted, 1, lambda text: None)
    (scene,) = Results.of(store).scenes
    names = methods.EXACT, methods.PAPER_FLOAT, methods.PAPER_TABLE, methods.PAPER
    off = [scene.error(name, "reference") or np.nan for name in names]
    assert off == sorted(off) and off[0] < 0.5 * off[1]
    splats, settings = subject.inputs(methods.methods()[methods.PAPER])
    linear = made.truths.get("reference", settings.but(target="rgba32f"))
    assert off[-1] < 0.5 * (errors(renderer.render(splats, subject.camera, settings), linear)["rmse"] or 0.0)
    paper = scene.row(methods.PAPER)
    assert paper and set(paper.errors) == {"reference"} and "display values" in paper.missing["sampled"]
    (told,) = (line for line in content.conclusion(scene) if "**Drawing**" in line)
    assert "the forms of 1998" in told and "blended in 8 bits" in told


@pytest.mark.long
def test_a_sweep_and_its_repetition(renderer: sg.Renderer, subject: Subject, tmp_path: Path) -> None:
    # so near that nothing is antialiased
    subject = replace(subject, camera=subject.camera.resized((48, 48)))
    wanted = select_methods(LEVEL, ("settings", "attenuation", "radial"))
    found = []
    for name in ("one", "two"):
        store = Store(tmp_path / name, HEAD)
        store.add("scene", scene="ball")
        made = sweep(renderer, subject, store)
        made.pictures(wanted, lambda text: None)
        made.times(wanted, 2, lambda text: None)
        found.append(store)
    first, second = (store.of("picture") for store in found)
    assert first == second
    # in no order that favours any
    turns = [line["method"] for line in found[0].of("time")]
    half = len(turns) // 2
    assert turns[:half] != turns[half:] and sorted(turns[:half]) == sorted(turns[half:])
    (scene,) = Results.of(found[0]).scenes
    exact, paper = scene.row("exact"), scene.row("paper 1998")
    assert exact and paper and exact.timing and exact.timing.count == 2
    off = [row.error("reference") or np.nan for row in (exact, paper)]
    assert off[0] < 0.5 * off[1]
    # what asks for the same plan is the same picture, and told as such
    same = scene.row("attenuation opacity")
    assert same and same.same_as == "exact" and same.timing == exact.timing


def test_what_was_cut_short_goes_on(renderer: sg.Renderer, subject: Subject, tmp_path: Path) -> None:
    path = tmp_path / "runs.jsonl"
    wanted = select_methods(LEVEL, ("settings",))
    ticks = []

    def stop(text: str) -> None:
        ticks.append(text)
        if len(ticks) == 3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        sweep(renderer, subject, Store(path, HEAD)).pictures(wanted, stop)
    with path.open("a") as file:
        file.write('{"kind": "pict')
    store = Store(path, HEAD, resume=True)
    assert len(store.of("picture")) == 2
    made = sweep(renderer, subject, store)
    made.pictures(wanted, lambda text: None)
    made.times(wanted, 2, lambda text: None)
    assert len(store.of("picture")) == 4 and len(store.of("time")) == 8
    # all there: nothing is done twice, and the file is what is in memory
    made.times(wanted, 2, lambda text: None)
    assert [json.loads(line) for line in path.read_text().splitlines()] == store.lines
    assert len(store.of("time")) == 8


def test_other_reports_are_not_resumed(tmp_path: Path) -> None:
    path = tmp_path / "runs.jsonl"
    Store(path, HEAD)
    with pytest.raises(sg.InputError, match="leave out --resume"):
        Store(path, {**HEAD, "size": 32}, resume=True)
    Store(path, HEAD).add("time", scene="ball")
    with pytest.raises(sg.InputError, match="line 2"):
        Store(path, HEAD, resume=True)
    path.write_text("[1]\n")
    with pytest.raises(sg.InputError, match="line 1"):
        Store(path, HEAD, resume=True)


def test_tolerances_are_told_apart() -> None:
    assert verdict(1e-5, 1e-3, 1e-4) == ("kept, as promised", True)
    assert verdict(1e-5, 1e-4, 1e-3)[1] and "promises less" in verdict(1e-5, 1e-4, 1e-3)[0]
    assert "says so" in verdict(1e-4, 1e-5, 1e-3)[0] and not verdict(1e-4, 1e-5, 1e-3)[1]
    assert "BEYOND" in verdict(1e-2, 1e-5, 1e-3)[0]


@pytest.mark.long
def test_the_command(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("matplotlib")
    folder = tmp_path / "out"
    only = ["--only", "settings", "tolerance", "antialiasing off", "2×2", "gaussian", "grid", "preview"]
    asked = ["report", "letter-f", "--quick", "--size", "20", "--rounds", "2", *only, "-o", str(folder)]
    assert main(asked) == 0
    assert "report.html" in capsys.readouterr().out
    page = (folder / "report.html").read_text()
    # nothing from elsewhere
    assert not re.findall(r"""(?:src|href)=["'](?!data:)""", page) and "<script" not in page and "url(" not in page
    for word in (
        "letter-f",
        "exact",
        "paper 1998",
        "Convergence",
        "Tolerance",
        "llvmpipe" if "llvmpipe" in page else "OpenGL",
    ):
        assert word in page
    rows = list(csv.DictReader((folder / "report.csv").open()))
    assert {row["method"] for row in rows} >= {"exact", "paper 1998", "grid", "tolerance 0.0001"}
    assert all(float(row["seconds"]) > 0 for row in rows)
    told = json.loads((folder / "report.json").read_text())
    assert told["machine"]["renderer"] and told["machine"]["versions"]["numpy"]
    assert sum(run["kind"] == "time" for run in told["runs"]) >= 12
    for line in told["convergence"]:
        middle = sorted(order for order in line["orders"] if order is not None)[len(line["orders"]) // 2 - 1]
        assert middle == pytest.approx(line["expected"], abs=0.45), line["study"]
    # the tolerance asked for is kept
    for row in rows:
        if row["axis"] == "tolerance" and float(row["tolerance"]) >= 1e-3:
            assert float(row["reference_maximum"]) <= float(row["tolerance"])
    assert "| exact |" in (folder / "report.md").read_text()
    before = (folder / "report.csv").read_text()
    monkeypatch.setattr("splatgl.studies.accuracy.export._diagrams", lambda results: {})
    assert main([*asked, "--resume", "--quiet"]) == 0
    assert (folder / "report.csv").read_text() == before
    assert main([*asked, "--resume", "--rounds", "3"]) == 2


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
def test_small_and_broken_volumes_have_reports(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(work, "STUDIES", ())
    np.save(tmp_path / "one.npy", np.ones((1, 1, 1)))
    np.save(tmp_path / "holes.npy", np.where(np.arange(216) % 7, 0.5, np.nan).reshape(6, 6, 6))
    asked = ["--quick", "--size", "12", "--rounds", "1", "--only", "settings", "preview", "--quiet"]
    sources = [str(tmp_path / f"{name}.npy") for name in ("one", "holes")]
    assert main(["report", *sources, *asked, "-o", str(tmp_path / "out")]) == 0
    rows = list(csv.DictReader((tmp_path / "out" / "report.csv").open()))
    assert {row["scene"] for row in rows} == {"one", "holes"} and "nan" not in str(rows)


def test_a_kept_truth_that_is_damaged_is_made_again(renderer: sg.Renderer, subject: Subject, tmp_path: Path) -> None:
    made = Truths(renderer, subject, LEVEL, tmp_path).get("reference", SPLATS).pixels
    (path,) = tmp_path.iterdir()
    for damage in (path.read_bytes()[:60], b"", b"nothing"):
        path.write_bytes(damage)
        again = Truths(renderer, subject, LEVEL, tmp_path).get("reference", SPLATS).pixels
        np.testing.assert_array_equal(again, made)


@pytest.mark.usefixtures("undrawn")
def test_no_sampled_truth_costs_no_report(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Where a picture is too large for it: the pages say so."""

    def refuse(self: Truths, settings: sg.Settings, samples: int) -> np.ndarray:
        raise sg.InputError("image size: too large")

    monkeypatch.setattr(Truths, "_sampled", refuse)
    monkeypatch.setattr(work, "STUDIES", ())
    asked = ["report", "letter-f", "--quick", "--size", "12", "--rounds", "1", "--only", "settings", "2×2", "--quiet"]
    assert main([*asked, "-o", str(tmp_path)]) == 0
    text = (tmp_path / "report.md").read_text()
    assert "exact, antialiasing | image size: too large" in text
    assert "**Drawing**" in text and "**Antialiasing**" not in text


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
    assert "--resume goes on" in capsys.readouterr().err
    assert "not timed: interrupted" in (tmp_path / "report.md").read_text()


@pytest.mark.long
def test_peers_draw_the_same_scene(tmp_path: Path) -> None:
    pytest.importorskip("vtk")
    volume = sg.scenes.ball(8)
    transfer = sg.Transfer(points=[(0.2, 0.0), (0.2, 0.5), (1.0, 0.5)], window=(0, 1), unit=1.0, shading=False)
    camera = sg.Camera.orbit(volume, azimuth=20, elevation=10, size=(40, 40))
    drawn = ray_integral(sg.extract(volume, transfer, classification="pre"), camera, SPLATS, 2).pixels
    for mapper in MAPPERS:
        with closing(Peer(mapper, (volume, transfer), camera, SPLATS)) as peer:
            image, seconds = peer.frame()
        assert seconds > 0 and image.pixels.shape == drawn.shape
        # the same ball at the same place, its edge aside
        assert np.abs(image.pixels - drawn).mean() < 0.2 * drawn.mean()
        assert np.abs(image.pixels[20, 20] - drawn[20, 20]).max() < 0.05


@pytest.mark.few(1)
@pytest.mark.parametrize("mapper", MAPPERS)
def test_peers_draw_the_trilinear_field(mapper: str) -> None:
    pytest.importorskip("vtk")
    volume = SCENES["balls"]()
    drawn, field = peer_and_field(mapper, volume, sg.default_transfer(volume))
    # measured: 0.023 of the blue by the CPU's caster, 0.0037 of the others by OpenGL's
    assert np.abs(drawn.sum(axis=(0, 1)) / field.sum(axis=(0, 1)) - 1).max() < 0.03
    assert np.sqrt(np.square(drawn - field).mean()) < 0.003


@pytest.mark.few(1)
@pytest.mark.parametrize(("mapper", "bound"), [("cpu", 0.02), ("gpu", 0.1)])
def test_peers_draw_the_box_of_the_voxels(mapper: str, bound: float) -> None:
    """Half a voxel beyond the outer samples, on a turned grid; OpenGL's steps reach beyond it by a part of a step."""
    pytest.importorskip("vtk")
    turned = np.array([[0.8, -0.6, 0.0], [0.6, 0.8, 0.0], [0.0, 0.0, 1.0]])
    ramp = np.broadcast_to(np.linspace(0, 1, 9, dtype=np.float32), (5, 7, 9))
    volume = sg.Volume(ramp, (1.0, 1.5, 2.0), (3.0, 4.0, 5.0), turned)
    transfer = sg.Transfer(points=[(0, 0.1), (1, 0.3)], unit=1.5, shading=False)
    drawn, field = peer_and_field(mapper, volume, transfer)
    assert np.abs(drawn.sum(axis=(0, 1)) / field.sum(axis=(0, 1)) - 1).max() < bound
    assert np.sqrt(np.square(drawn - field).mean()) < 0.03


def peer_and_field(mapper: str, volume: sg.Volume, transfer: sg.Transfer) -> tuple[np.ndarray, np.ndarray]:
    """A peer's picture and the trilinear field's, [48, 48, 4]."""
    camera = sg.Camera.orbit(volume, azimuth=30, elevation=20, size=(48, 48))
    with closing(Peer(mapper, (volume, transfer), camera, SPLATS)) as peer:
        return peer.frame()[0].pixels, field_integral(volume, transfer, camera, "trilinear", 4).pixels


def test_samples_of_peers_are_averaged() -> None:
    pytest.importorskip("vtk")
    volume = sg.scenes.ball(8)
    content, camera = (volume, sg.default_transfer(volume)), sg.Camera.orbit(volume, size=(20, 16))
    found = []
    for view, settings in (
        (camera, SPLATS.but(antialias="supersample", samples=2)),
        (camera.resized((40, 32)), SPLATS.but(antialias="off")),
    ):
        with closing(Peer("cpu", content, view, settings)) as peer:
            found.append(peer.frame()[0].pixels)
    means, fine = found
    assert np.abs(means - fine.reshape(16, 2, 20, 2, 4).mean(axis=(1, 3))).max() < 1e-6


@pytest.mark.parametrize("changed", [{"blend": "xray"}, {"background": (1.0, 1.0, 1.0)}])
def test_what_peers_cannot_draw_is_left_out(changed: dict) -> None:
    pytest.importorskip("vtk")
    volume = sg.scenes.ball(4)
    content = (volume, sg.default_transfer(volume))
    with pytest.raises(sg.InputError):
        Peer("cpu", content, sg.Camera.orbit(volume), SPLATS.but(**changed))
