"""The diagram: labels that don't overlap, looks that differ without colour, points where they should be."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest

import splatgl as sg
from splatgl.cli.main import _parser
from splatgl.report.diagram import _figure, picture, places, plot_styles
from splatgl.report.methods import DEFAULT, EXACT, TRUTHS, methods
from splatgl.report.page import choices, conclusion
from splatgl.report.sweep import Row, SceneResults, Subject, Timing

FRAME = np.array([0.0, 0.0, 400.0, 300.0])
HEAD = {"version": "0", "machine": {"renderer": "llvmpipe (LLVM)"}}


def test_labels_overlap_nothing(rng: np.random.Generator) -> None:
    points = rng.uniform((20, 20), (380, 280), (30, 2))
    sizes = np.array([(rng.uniform(20, 60), 9.0) for _ in points])
    found = places(points, sizes, FRAME, [points[:6]])
    boxes = [(*p, *(p + size)) for p, size in zip(found, sizes, strict=True) if p is not None]
    assert len(boxes) > 20
    for a, b in combinations(boxes, 2):
        assert a[2] <= b[0] or b[2] <= a[0] or a[3] <= b[1] or b[3] <= a[1]
    for box in boxes:
        assert box[0] >= 0 and box[1] >= 0 and box[2] <= 400 and box[3] <= 300
        inside = (points > (box[0], box[1])).all(axis=1) & (points < (box[2], box[3])).all(axis=1)
        assert not inside.any()


def test_a_label_without_room_is_left_out() -> None:
    small = np.array([0.0, 0.0, 30.0, 12.0])
    assert places(np.array([[15.0, 6.0]]), np.array([(60.0, 9.0)]), small) == [None]


def test_the_first_label_is_nearest() -> None:
    first, second = places(np.array([[100.0, 100.0], [300.0, 200.0]]), np.array([(30.0, 9.0)] * 2), FRAME)
    assert first is not None and second is not None and first[0] == pytest.approx(107.0)


def test_axes_differ_without_colour() -> None:
    told = [(look.marker, str(look.dashes)) for look in plot_styles().values()]
    assert len(set(told)) == len(told)


def subject() -> Subject:
    splats = sg.Splats.from_points(np.eye(3), np.ones((3, 3)), np.full(3, 0.5))
    return Subject("made up", sg.Camera.orbit(splats, size=(8, 8)), sg.Settings(), lambda *how: splats)


def scene(error: float = 1e-3) -> SceneResults:
    """Every third method: enough for all axes, and for labels that are in each other's way."""
    rows = []
    for n, method in enumerate(list(methods().values())[::3]):
        timing = Timing(tuple(0.01 * (1 + n) * np.array([0.9, 1.0, 1.1])))
        found = {truth: {"rmse": error / (1 + n)} for truth in TRUTHS}
        rows.append(Row(method.name, timing=timing, errors=found))
    return SceneResults(subject(), rows)


def test_the_legend_names_every_mark() -> None:
    """The default and exact splats, which have marks of their own, too."""
    pytest.importorskip("matplotlib")
    rows = list(replace(row, method=name) for row, name in zip(scene().rows, (DEFAULT, EXACT, "2×2"), strict=False))
    (legend,) = _figure(replace(scene(), rows=rows), HEAD).legends
    told = {text.get_text() for text in legend.get_texts()}
    assert {DEFAULT, EXACT} <= told and "" not in told


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
        rows.append(Row(name, timing=timing, errors={"field": {"rmse": error}}))
    return SceneResults(subject(), rows)


def test_what_to_take() -> None:
    """The default; for previews what is faster and not much worse; for print what is better."""
    all_made = decided(**{"default": (0.1, 0.2), "exact": (0.2, 0.1), "2×2": (0.25, 0.01), "4×4": (0.9, 0.001)})
    assert [c.point.name for c in choices(all_made)] == ["default", "2×2", "default"]
    finer = decided(**{"default": (0.1, 0.2), "exact": (0.2, 0.19), "post b-spline 4×4": (0.05, 2.0)})
    assert [c.point.name for c in choices(finer)] == ["default", "default", "post b-spline 4×4"]
    assert choices(decided(exact=(0.1, 0.2))) == ()
    assert conclusion(all_made)[0].startswith(
        "**Take the default** (10 % off in 200 ms), for print, too; for previews single splats, 2×2 samples a pixel: "
        "25 % off in 10 ms."
    )


def test_options_of_methods_are_those_of_the_command() -> None:
    parser = _parser(["render"])
    for method in methods().values():
        if method.options and not method.coarse:
            parser.parse_args(["render", "tunnel", *method.options.split()])
