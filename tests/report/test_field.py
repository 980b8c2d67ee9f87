"""The report's fourth truth: the field itself, of formulas and of samples; and methods classified after."""

from __future__ import annotations

import csv
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from statistics import median_low

import numpy as np
import pytest
from benchmarks.convergence import STUDIES, Study

import splatgl as sg
from splatgl.cli.main import main
from splatgl.data.scenes import FORMULAS
from splatgl.reference.field import field_integral
from splatgl.report.methods import axis_of, methods
from splatgl.report.page import conclusion
from splatgl.report.sweep import LEVELS, ReportSubject, SceneResults, Sweep, Truths
from tests.helpers.noise import close_up

pytestmark = pytest.mark.usefixtures("shared_programs")

LEVEL = replace(LEVELS["quick"], size=16, rounds=1)


@pytest.fixture(scope="module")
def balls() -> ReportSubject:
    found = ReportSubject.open("balls", LEVEL)
    return replace(found, camera=close_up(found.splats(), 30, 20, found.camera.size))


def rmse(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.sqrt(((a - b) ** 2).mean() / (b**2).mean()))


def test_scenes_with_formulas_are_samples_of_them(balls: ReportSubject) -> None:
    """Never of joined voxels, however few splats a level takes."""
    assert balls.formula is FORMULAS["balls"] and balls.no_field == ""
    few = ReportSubject.open("balls", replace(LEVEL, splats=10))
    assert few.content and few.content[0].shape == (48, 48, 48) and not few.note
    assert ReportSubject.open("letter-f", LEVEL).formula is None


def test_a_file_of_the_same_name_has_no_formula(tmp_path: Path) -> None:
    np.save(tmp_path / "balls.npy", sg.scenes.ball(4).samples)
    assert ReportSubject.open(str(tmp_path / "balls.npy"), LEVEL).formula is None


def test_the_field_is_the_formulas(renderer: sg.Renderer, balls: ReportSubject) -> None:
    """Means of finely marched rays; that of the samples is near, and another."""
    truths = Truths(renderer, balls, LEVEL)
    found = truths.get("field", sg.Settings()).pixels
    assert balls.content is not None
    volume, transfer = balls.content
    world, origin = volume.world_from_index, np.asarray(volume.origin)[:, None]

    def field(places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return FORMULAS["balls"](world @ places + origin)

    fine = field_integral(volume, transfer, balls.camera, field, 4, samples=4).pixels
    assert rmse(found, fine) < 0.01
    samples = Truths(renderer, replace(balls, formula=None), LEVEL).get("field", sg.Settings()).pixels
    assert 1e-5 < rmse(samples, found) < 0.01
    # the kernel of splats is none of its concern, light and background are
    assert truths.get("field", sg.Settings(kernel="gaussian")).pixels is found
    unlit = truths.get("field", sg.Settings(shading="off")).pixels
    assert rmse(unlit[..., 3], found[..., 3]) == 0 and unlit[..., :3].sum() > 1.1 * found[..., :3].sum()
    over = truths.get("field", sg.Settings(background=(0.5, 0.5, 0.5))).pixels
    assert np.abs(over[..., :3] - found[..., :3] - 0.5 * (1 - found[..., 3:])).max() < 1e-12


def swept(renderer: sg.Renderer, subject: ReportSubject, *names: str) -> SceneResults:
    made = Sweep(Truths(renderer, subject, LEVEL))
    made.pictures(LEVEL.methods(names), lambda text: None)
    made.times(1, lambda text: None)
    return made.results


@pytest.mark.long
def test_methods_are_measured_against_the_field(renderer: sg.Renderer, balls: ReportSubject) -> None:
    names = ("exact", "sheets 3", "post b-spline", "post b-spline 2×2", "post crawfis-max 2×2")
    scene = swept(renderer, balls, *names)
    rows = {row.method: row for row in scene.rows}
    error = {name: row.error("field") or np.nan for name, row in rows.items()}
    best, other = error["post b-spline 2×2"], error["post crawfis-max 2×2"]
    assert best < 0.5 * other < 0.4 * error["exact"] and best < error["post b-spline"]
    # each against what it draws
    assert set(rows["exact"].errors) == {"reference", "sampled", "integral", "field"}
    assert set(rows["sheets 3"].errors) == {"integral", "field"} and set(rows["post b-spline"].errors) == {"field"}
    # every extraction is timed, and no part of a frame
    seconds = {row.method: row.extraction for row in scene.rows}
    assert seconds["post b-spline"] == seconds["post b-spline 2×2"] != seconds["exact"]
    assert all(second and second > 0 for second in seconds.values())
    told = conclusion(scene)[-1]
    assert told.startswith("**The field itself** (the formula") and "post b-spline 2×2" in told
    assert scene.rows[0].missing == {}


def test_who_competes_for_which_front() -> None:
    for name, method in methods().items():
        axis = axis_of(name)
        if method.changes.get("classification") == "post":
            assert axis.measured == ("field",)
    assert axis_of("gaussian").competes("field") and not axis_of("gaussian").competes("reference")


@pytest.mark.few(2)
@pytest.mark.parametrize(
    ("changed", "why"),
    [
        (lambda subject: replace(subject, content=None), "splats alone"),
        (lambda subject: replace(subject, settings=sg.Settings(blend="xray")), "blend composite"),
        (lambda subject: ReportSubject.open("letter-f", LEVEL), "colours of its own"),
    ],
    ids=["splats", "xray", "colours"],
)
def test_scenes_without_a_field(
    renderer: sg.Renderer, balls: ReportSubject, changed: Callable[[ReportSubject], ReportSubject], why: str
) -> None:
    subject = changed(balls)
    assert why in subject.no_field
    with pytest.raises(sg.InputError, match="composite" if why == "blend composite" else why):
        Truths(renderer, subject, LEVEL).get("field", subject.settings)
    scene = swept(renderer, subject, "exact")
    assert "field" not in scene.truths and not scene.rivals("field")
    assert conclusion(scene)[-1].startswith("**The field** is no truth here") and why in conclusion(scene)[-1]


@pytest.mark.long
def test_a_report_without_a_field(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A line says so, and methods classified after are left out."""
    monkeypatch.setattr("splatgl.report.page._diagrams", lambda scenes, head: ())
    asked = ["--quick", "--size", "32", "--rounds", "1", "--only", "exact", "post b-spline", "sheets 3", "--quiet"]
    assert main(["report", "letter-f", "balls", *asked, "-o", str(tmp_path)]) == 0
    text = (tmp_path / "report.html").read_text()
    assert text.count("<b>The field</b> is no truth here: letter-f: only classification pre is possible, because") == 1
    assert text.count("<b>The field itself</b> (the formula") == 1
    rows = {(row["scene"], row["method"]): row for row in csv.DictReader((tmp_path / "report.csv").open())}
    assert "colours" in rows["letter-f", "post b-spline"]["omitted"] and not rows["letter-f", "exact"]["field_rmse"]
    assert rows["letter-f", "sheets 3"]["integral_rmse"]
    post = rows["balls", "post b-spline"]
    assert float(post["field_rmse"]) < 0.6 * float(rows["balls", "exact"]["field_rmse"])
    assert float(post["extraction"]) > 0


@pytest.mark.few(3)
@pytest.mark.parametrize("study", STUDIES, ids=lambda study: study.name)
def test_errors_converge_as_expected(renderer: sg.Renderer, study: Study) -> None:
    orders = [order for _, _, order in study.rows(renderer) if order is not None]
    assert median_low(orders) == pytest.approx(study.expected, abs=0.45)


def test_the_field_converges(renderer: sg.Renderer) -> None:
    (study,) = (study for study in STUDIES if study.name == "points of the field")
    rows = study.rows(renderer)
    assert all(order == pytest.approx(study.expected, abs=0.2) for _, _, order in rows[1:])
    assert rows[-1][1] < 1e-4
