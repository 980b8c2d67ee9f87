"""The diagram: labels that don't overlap, looks that differ without colour, points where they should be."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations, islice

import numpy as np
import pytest

from splatgl.cli.main import _parser
from splatgl.studies.accuracy.content import blocks, choices
from splatgl.studies.accuracy.diagram import _figure, overview, picture, plot_styles
from splatgl.studies.accuracy.methods import DEFAULT, EXACT, TRUTHS, methods
from splatgl.studies.accuracy.pareto import Timing
from splatgl.studies.accuracy.sweep import Results, Row, SceneResults
from splatgl.studies.plots import places

FRAME = np.array([0.0, 0.0, 400.0, 300.0])
HEAD = {"version": "0", "machine": {"renderer": "llvmpipe (LLVM)"}}


def test_labels_overlap_nothing(rng: np.random.Generator) -> None:
    points = rng.uniform((20, 20), (380, 280), (30, 2))
    sizes = np.array([(rng.uniform(20, 60), 9.0) for _ in points])
    found = places(points, sizes, FRAME, [points[:6]])
    boxes = [(*p.corner, *(p.corner + size)) for p, size in zip(found, sizes, strict=True) if p is not None]
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
    points = np.array([[100.0, 100.0], [300.0, 200.0]])
    first, second = places(points, np.array([(30.0, 9.0)] * 2), FRAME)
    assert first and second and first.leader is None
    assert first.corner[0] == pytest.approx(107.0)


def test_axes_differ_without_colour() -> None:
    told = [(look.marker, str(look.dashes)) for look in plot_styles().values()]
    assert len(set(told)) == len(told)


def scene(error: float = 1e-3) -> SceneResults:
    """Every third method: enough for all axes, and for labels that are in each other's way."""
    rows = []
    for n, method in enumerate(list(methods().values())[::3]):
        timing = Timing.of(dict(enumerate(0.01 * (1 + n) * np.array([0.9, 1.0, 1.1]))))
        found = {truth: {"rmse": error / (1 + n)} for truth in TRUTHS}
        rows.append(Row(method.name, "", "", "", timing, found))
    return SceneResults("made up", {"splats": 10, "size": [8, 8], "note": ""}, tuple(rows))


def test_the_legend_names_every_mark() -> None:
    """The default and exact splats, which have marks of their own, too."""
    pytest.importorskip("matplotlib")
    rows = tuple(replace(row, method=name) for row, name in zip(scene().rows, (DEFAULT, EXACT, "2×2"), strict=False))
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
        timing = Timing.of(dict(enumerate(seconds * np.array([0.9, 1.0, 1.1]))))
        rows.append(Row(name, "", "", "", timing, {"field": {"rmse": error}}))
    return replace(scene(), rows=tuple(rows))


def test_what_to_take() -> None:
    """The default; for previews what is faster and not much worse; for print what is better."""
    all_made = decided(**{"default": (0.1, 0.2), "exact": (0.2, 0.1), "2×2": (0.25, 0.01), "4×4": (0.9, 0.001)})
    assert [c.point.name for c in choices(all_made)] == ["default", "2×2", "default"]
    finer = decided(**{"default": (0.1, 0.2), "exact": (0.2, 0.19), "post b-spline 4×4": (0.05, 2.0)})
    assert [c.point.name for c in choices(finer)] == ["default", "default", "post b-spline 4×4"]
    assert choices(decided(exact=(0.1, 0.2))) == ()
    machine = {"renderer": "llvmpipe", "opengl": "4.5", "processor": "x", "cores": 2}
    _, sentence, table = islice(blocks(Results({"machine": machine}, (all_made,), ())), 3)
    assert sentence.lines[0] == (
        "**Take the default** (10 % off in 200 ms), for print, too; for previews single splats, 2×2 samples a pixel: "
        "25 % off in 10 ms."
    )
    options = "--like 0.1 --antialias supersample --samples 2"
    assert table.rows[1] == ("previews", f"single splats, 2×2 samples a pixel ({options})", "25 %", "10 ms")


def test_options_of_methods_are_those_of_the_command() -> None:
    parser = _parser(["render"])
    for method in methods().values():
        if method.options and not method.coarse:
            parser.parse_args(["render", "tunnel", *method.options.split()])


@pytest.mark.long
def test_the_diagram_for_deciding() -> None:
    pytest.importorskip("matplotlib")
    made = decided(**{"default": (0.1, 0.2), "exact": (0.2, 0.1), "2×2": (0.25, 0.01)})
    for results in (made, replace(made, rows=made.rows[:1])):
        drawn = overview(results, HEAD)
        assert drawn[".png"].startswith(b"\x89PNG") and b"how far from the true picture" in drawn[".svg"]
