"""The diagram: labels that don't overlap, looks that differ without colour, points where they should be."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest

import splatgl as sg
from splatgl.report.diagram import _figure, picture, plot_styles
from splatgl.report.methods import DEFAULT, EXACT, TRUTHS, methods
from splatgl.report.page import choices, conclusion
from splatgl.report.sweep import ReportSubject, ResultRow, SceneResults, Timing

HEAD = {"version": "0", "machine": {"renderer": "llvmpipe (LLVM)"}}


def test_axes_differ_without_colour() -> None:
    told = [(look["marker"], str(look["linestyle"])) for look in plot_styles().values()]
    assert len(set(told)) == len(told)


def subject() -> ReportSubject:
    splats = sg.Splats.from_points(np.eye(3), np.ones((3, 3)), np.full(3, 0.5))
    return ReportSubject("made up", sg.Camera.orbit(splats, size=(8, 8)), sg.Settings(), lambda *how: splats)


def scene(error: float = 1e-3) -> SceneResults:
    """Every third method: enough for all axes, and for labels that are in each other's way."""
    rows = []
    for n, method in enumerate(list(methods().values())[::3]):
        timing = Timing(tuple(0.01 * (1 + n) * np.array([0.9, 1.0, 1.1])))
        found = {truth: {"rmse": error / (1 + n)} for truth in TRUTHS}
        rows.append(ResultRow(method.name, timing=timing, errors=found))
    return SceneResults(subject(), rows)


def test_the_legend_names_every_mark() -> None:
    """The default and exact splats, which have marks of their own, too."""
    pytest.importorskip("matplotlib")
    rows = list(replace(row, method=name) for row, name in zip(scene().rows, (DEFAULT, EXACT, "2×2"), strict=False))
    (legend,) = _figure(replace(scene(), rows=rows), HEAD).legends
    told = {text.get_text() for text in legend.get_texts()}
    assert {DEFAULT, EXACT} <= told and "" not in told


def test_labels_overlap_nothing() -> None:
    """Neither each other nor points nor lines, and they stay within their diagram."""
    pytest.importorskip("matplotlib")
    figure = _figure(scene(), HEAD)
    for plot in figure.axes:
        boxes = [text.get_window_extent() for text in plot.texts]
        assert len(boxes) > 3 and all(plot.bbox.containsx(end) for box in boxes for end in (box.x0, box.x1))
        assert not any(a.fully_overlaps(b) for a, b in combinations(boxes, 2))
        for line in plot.lines:
            points = line.get_transform().transform(line.get_xydata())
            assert not any(box.contains(*point) for box in boxes for point in points)


@pytest.mark.long
def test_pictures_come_out_the_same() -> None:
    pytest.importorskip("matplotlib")
    drawn = picture(scene(), HEAD)
    assert drawn == picture(scene(), HEAD)
    assert drawn[".png"].startswith(b"\x89PNG") and drawn[".svg"].startswith(b"<?xml")


@pytest.mark.few(1)
@pytest.mark.parametrize("error", [0.0, 1e-300])
def test_errors_of_nothing_have_a_place(error: float) -> None:
    pytest.importorskip("matplotlib")
    assert picture(scene(error), HEAD)[".png"].startswith(b"\x89PNG")


def decided(**measured: tuple[float, float]) -> SceneResults:
    """Methods by error against the field and seconds."""
    rows = []
    for name, (error, seconds) in measured.items():
        timing = Timing(tuple(seconds * np.array([0.9, 1.0, 1.1])))
        rows.append(ResultRow(name, timing=timing, errors={"field": {"rmse": error}}))
    return SceneResults(subject(), rows)


def test_what_to_take() -> None:
    """The default; for previews what is faster and not much worse; for print what is better."""
    all_made = decided(**{"default": (0.1, 0.2), "exact": (0.2, 0.1), "2×2": (0.25, 0.01), "4×4": (0.9, 0.001)})
    assert [point.name for point in choices(all_made).values()] == ["default", "2×2", "default"]
    finer = decided(**{"default": (0.1, 0.2), "exact": (0.2, 0.19), "post b-spline 4×4": (0.05, 2.0)})
    assert [point.name for point in choices(finer).values()] == ["default", "default", "post b-spline 4×4"]
    assert choices(decided(exact=(0.1, 0.2))) == {}
    assert conclusion(all_made)[0].startswith(
        "**Take the default** (10 % off in 200 ms), for print, too; for previews single splats, 2×2 samples a pixel: "
        "25 % off in 10 ms."
    )
