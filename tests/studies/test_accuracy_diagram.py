"""The diagram: labels that don't overlap, looks that differ without colour, points where they should be."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest

from splatgl.studies.accuracy.diagram import _figure, picture, plot_styles
from splatgl.studies.accuracy.methods import DEFAULT, EXACT, TRUTHS, methods
from splatgl.studies.accuracy.pareto import Timing
from splatgl.studies.accuracy.sweep import Row, SceneResults
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
