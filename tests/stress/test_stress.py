"""Scenes at the extremes: every case of the stress suite keeps its bound, and its report says so, or says not."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import splatgl as sg
from splatgl.report import methods
from tests.helpers.splatting import SPLATS
from tests.stress import CASES, optics, run_case
from tests.stress import case as bench
from tests.stress.__main__ import GUIDE, main
from tests.stress.case import Bench, Case, Check, Result, check, parallel, row_of_dots
from tests.stress.report import PAGES, WIDTHS, as_markdown, heading, line, lines, verdict

pytestmark = pytest.mark.usefixtures("shared_programs")

# columns of a terminal
TERMINAL = 100
# quick cases that the paper's settings or formulas must break: what a case asks can be missed
BEYOND_THE_PAPER = (
    "eye-in-kernel",
    "opacity-extremes",
    "opacity-correction",
    "depth-range",
    "far-voxel",
    "zoom-range",
    "lattice-sums",
    "thin-shell",
    "rim",
    "tiny-volumes",
)


# factors by which an error, a bound and the paper's error in the guide may be off, and what is rounding
APART, ROUNDING = (2.0, 1.05, 2.0), 1e-5

# what takes longest
LONG = ("half-angle-89.9", "million-faint", "wall-0.1", "wall-0.5")
# of these tests draw a part, in which they find the same faults
IN_PART = ("constant-fog", "methods")


def told(result: Result) -> str:
    return f"{result.bad_pixels} values not finite\n{lines(result)}\n{'; '.join(c.what for c in result.checks)}"


@pytest.mark.long
@pytest.mark.turns(2)
@pytest.mark.parametrize("name", [n for n in CASES if n not in IN_PART])
def test_every_case_keeps_its_bound(renderer: sg.Renderer, name: str) -> None:
    result = run_case(CASES[name], renderer)
    kept(result)
    assert differs_from_the_guide(result) == ""


def differs_from_the_guide(result: Result) -> str:
    """What the guide's table says of a case, if its numbers are more than a factor apart from those found, else "".

    Errors as small as rounding differ between drivers; scripts/stress --guide writes the table.
    """
    written, found = (numbers_of(text, result.case.name) for text in (GUIDE.read_text(), as_markdown([result])))
    for (said, factor), value in zip(zip(written, APART, strict=True), found, strict=True):
        if not (said == value or max(said, value) <= ROUNDING or 1 / factor <= said / (value or 1e-300) <= factor):
            return f"{written} in the guide, {found} found; run scripts/stress --guide"
    return ""


def numbers_of(text: str, name: str) -> list[float]:
    """The error, the bound and the paper's error of a case in a Markdown table; 0 for none."""
    (row,) = (line for line in text.splitlines() if line.startswith(f"| `{name}` |"))
    cells = [cell.strip() for cell in row.split("|")[2:5]]
    return [float(cell.rstrip("%") or 0) / (100 if cell.endswith("%") else 1) for cell in cells]


def test_a_stale_row_of_the_guide_is_found(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Numbers of another order, another bound, or a lost column."""
    case, fine = CASES["wall-0.99"], (0.0031, 0.0039, 0.025)
    guide = tmp_path / "guide.md"
    monkeypatch.setattr("tests.stress.test_stress.GUIDE", guide)
    row = "| `wall-0.99` | {} | {} | {} |\n"
    checks = (check("α", 1 - fine[0], 1.0, fine[1], paper=1 - fine[2]),)
    for written, stale in ((fine, False), ((0.0036, 0.0039, 0.03), False), ((0.0076, 0.012, 0.48), True)):
        guide.write_text(row.format(*written))
        assert bool(differs_from_the_guide(Result(case, checks, 1, 0, 0.0))) is stale


@pytest.mark.long
@pytest.mark.parametrize("name", [n for n in CASES if n not in (*LONG, *IN_PART)][::4])
def test_cases_at_the_default_tolerance(renderer: sg.Renderer, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Bounds are stated at a tolerance of 1e-6; what it leaves out at its default is at most the tolerance."""
    monkeypatch.setattr(bench, "FINEST", SPLATS.tolerance)
    result = run_case(CASES[name], renderer)
    assert result.bad_pixels == 0
    for each in result.checks:
        allowed = SPLATS.tolerance * (1.0 if each.relative else max(1.0, abs(each.right)))
        assert each.error <= each.bound + allowed, told(result)


@pytest.mark.long
def test_fog_seen_from_a_few_places(renderer: sg.Renderer, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(optics, "VIEWS", 8)
    kept(run_case(CASES["constant-fog"], renderer))


@pytest.mark.long
def test_a_method_of_every_axis(renderer: sg.Renderer, monkeypatch: pytest.MonkeyPatch) -> None:
    few = {name: replace(axis, methods=axis.methods[-1:]) for name, axis in methods.AXES.items()}
    monkeypatch.setattr(methods, "AXES", {**few, "settings": methods.AXES["settings"]})
    kept(run_case(CASES["methods"], renderer))


def kept(result: Result) -> None:
    assert result.ok, told(result)
    assert result.pictures > 0
    assert all(np.isfinite(each.bound) for each in result.checks)


@pytest.mark.few(2)
@pytest.mark.parametrize("name", BEYOND_THE_PAPER)
def test_the_papers_form_breaks_it(renderer: sg.Renderer, name: str) -> None:
    checks = run_case(CASES[name], renderer).checks
    assert any(each.paper_error is not None and each.paper_error > each.bound for each in checks)


def test_the_paper_is_charged_with_its_own_error(renderer: sg.Renderer) -> None:
    """Of display values, which it mixes: against linear light alone it would be several times as far."""
    rng = np.random.default_rng(5)
    splats = row_of_dots(3.0 * np.arange(60), 0.08, rng.uniform(0, 0.4, (60, 3)))
    camera, desk = parallel(1.0, (1, 1)), Bench(renderer)
    settings = sg.Settings.paper()
    drawn = renderer.render(splats, camera, settings).pixels
    own = np.abs(drawn - sg.reference.render(splats, camera, settings).pixels).max()
    right = desk.truth(splats, camera, attenuation="opacity")
    assert np.abs(desk.paper(splats, camera) - right).max() == pytest.approx(own, abs=1e-5)
    assert np.abs(drawn - right).max() > 2 * own > 0


def test_cases_say_what_they_are() -> None:
    for case in CASES.values():
        assert len(case.name) <= WIDTHS[0]
        assert case.stresses and case.how and case.right
    assert set(PAGES) <= set(CASES)
    assert len(CASES) >= 39


def test_an_error_is_measured_where_it_is_largest() -> None:
    found = check("both", [[1.0, 2.5], [3.0, 4.0]], [[1.0, 2.0], [3.0, 4.1]], 0.4, paper=[[0.0, 2.0], [3.0, 4.0]])
    assert (found.right, found.found, found.error, found.ok) == (2.0, 2.5, 0.5, False)
    assert (found.paper, found.paper_error) == (0.0, 1.0)
    assert found.share == pytest.approx(1.25)
    assert check("share", 1.01, 1.0, 0.011, relative=True).ok
    assert not check("share", 2.01e-8, 2e-8, 0.001, relative=True).ok


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_no_number_keeps_no_bound(value: float) -> None:
    assert not check("one", [0.0, value], 0.0, 1e300).ok


def test_no_bound_is_no_promise() -> None:
    """Nothing is kept by an infinite bound, whatever the error; the line says so."""
    for error in (0.0, 0.24):
        found = check("α", 1.0 - error, 1.0, np.inf)
        assert not found.ok and found.share == np.inf
        assert line(Result(draws(0.0), (found,), 1, 0, 0.0)).endswith("BROKEN")


def draws(value: float) -> Case:
    """A case whose picture has that value in it."""

    def run(bench: Bench) -> list[Check]:
        bench.pictures, bench.bad_pixels = 1, int(not np.isfinite(value))
        return [check("value", 0.0 if np.isnan(value) else value, 0.0, 0.5)]

    return Case("made-up", "nothing", "not at all", "0", run)


def raises(bench: Bench) -> list[Check]:
    raise ValueError("no such thing")


def test_results_of_made_up_cases(renderer: sg.Renderer) -> None:
    assert run_case(draws(0.4), renderer).ok
    assert not run_case(draws(0.6), renderer).ok
    assert not run_case(draws(np.nan), renderer).ok
    raised = run_case(Case("raising", "an error", "by raising", "none", raises), renderer)
    assert not raised.ok
    assert "raising: ValueError: no such thing" in verdict([raised])


def test_pixels_that_are_no_numbers_are_counted(renderer: sg.Renderer, monkeypatch: pytest.MonkeyPatch) -> None:
    bench = Bench(renderer)
    pixels = np.zeros((2, 2, 4), np.float32)
    pixels[0, 0, 1], pixels[1, 1, 3] = np.nan, np.inf
    monkeypatch.setattr(sg.Renderer, "render", lambda *_: sg.Image(pixels))
    bench.draw(None, None)  # type: ignore[arg-type]
    assert (bench.pictures, bench.bad_pixels) == (1, 2)


@pytest.fixture
def results(renderer: sg.Renderer) -> list[Result]:
    return [run_case(case, renderer) for case in (CASES["rim"], CASES["tiny-volumes"], draws(0.6))]


def test_tables_fit_a_terminal(results: list[Result]) -> None:
    text = "\n".join([heading(), *map(line, results), *map(lines, results), verdict(results)])
    assert max(map(len, text.splitlines())) <= TERMINAL
    assert "BROKEN" in line(results[2]) and "BROKEN" not in line(results[0])
    assert "2 of 3 cases keep their bounds" in text and "broken: made-up: value" in text


def test_a_table_has_a_row_for_each_case(results: list[Result]) -> None:
    table = as_markdown(results)
    assert "| `made-up` | **0.6** | 0.5 |" in table and "| `rim` | " in table


def test_a_broken_bound_is_exit_code_1(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setitem(CASES, "made-up", draws(0.6))
    assert main(["--case", "made-up"]) == 1
    assert "broken: made-up" in capsys.readouterr().out


def test_the_list_and_bad_names(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--list"]) == 0
    listed = capsys.readouterr().out
    assert all(name in listed for name in CASES)
    for wrong in (["--case", "nothing"], ["--explain", "nothing"], ["--csv", "a.csv"]):
        with pytest.raises(SystemExit, match="2"):
            main(wrong)
        assert len(capsys.readouterr().err.splitlines()) == 1


@pytest.mark.few(1)
@pytest.mark.parametrize("name", sorted(set(PAGES) - {"million-faint"}))
def test_pages_fit_a_terminal_and_hold_numbers(renderer: sg.Renderer, name: str) -> None:
    page = PAGES[name](Bench(renderer))
    assert max(map(len, page.splitlines())) <= TERMINAL
    assert "nan" not in page
    assert sum(character.isdigit() for character in page) > 100


@pytest.mark.long
def test_a_page_by_the_command(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--explain", "thin-shell"]) == 0
    page = capsys.readouterr().out
    assert "sampled ever more coarsely" in page and "thin-shell" in page
