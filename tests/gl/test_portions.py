"""Pictures in portions and in chunks: the same bits, however they are cut, and an end between any two of them."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
import pytest

import splatgl as sg
from splatgl.gl import buffers, quads, target, tiles
from splatgl.splat.splats import checked
from tests.helpers.noise import noise, views
from tests.helpers.splatting import SPLATS

TECHNIQUES = ("quads", "tiles")


def record(asked: list[bool]) -> bool:
    """Counts a call that cancels nothing."""
    asked.append(False)
    return False


@pytest.fixture
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    """Portions of a few hundred splats, and dispatches of a few tiles."""
    monkeypatch.setattr(target, "FIRST", 300)
    monkeypatch.setattr(target, "GROWTH", 1.0)
    monkeypatch.setattr(tiles, "ENTRIES", 1000)


@pytest.mark.parametrize("kind", TECHNIQUES)
@pytest.mark.usefixtures("small")
def test_a_picture_can_be_cancelled_between_portions(processor: sg.Renderer, kind: str) -> None:
    """Wherever it is cancelled, what comes next is right bit for bit; whoever asks changes nothing."""
    splats = noise(size=20, opacity=0.9)
    camera = views(splats)["fitted"]
    for change in ({}, {"occlusion": "off"}, {"blend": "xray"}):
        settings = SPLATS.replace(technique=kind, **change)
        right = processor.render(splats, camera, settings).pixels
        asked: list[bool] = []
        counted = processor.render(splats, camera, settings, interrupted=partial(record, asked)).pixels
        assert (counted == right).all()
        assert len(asked) > 5
        for allowed in (0, 1, len(asked) - 1):
            answers = iter([False] * allowed + [True])
            with pytest.raises(sg.Interrupted):
                processor.render(splats, camera, settings, interrupted=partial(next, answers))
        assert (processor.render(splats, camera, settings).pixels == right).all()


def test_too_many_that_flow_are_refused(renderer: sg.Renderer, monkeypatch: pytest.MonkeyPatch) -> None:
    """Their flow is kept beside their records, whole."""
    splats = noise(size=8, opacity=0.5)
    flow = sg.Motion(flow=np.full((len(splats), 3), 0.1))
    settings = SPLATS.replace(motion="exact")
    renderer.render(splats, views(splats)["fitted"], settings, motion=flow)
    monkeypatch.setattr(quads, "MOST_KEPT", len(splats) - 1)
    with pytest.raises(sg.InputError, match=r"^splats: expected at most \d+ that flow, got \d+; raise the"):
        renderer.render(splats, views(splats)["fitted"], settings, motion=flow)


def test_portions_grow_and_shrink_with_the_time_they_take(
    renderer: sg.Renderer, monkeypatch: pytest.MonkeyPatch
) -> None:
    now = [0.0]
    monkeypatch.setattr("splatgl.gl.target.time.perf_counter", lambda: now[0])
    found = target.Portions(renderer.ctx, None, 2**22)
    ends, each = [], 1e-4
    for begin, end in found.over(0, 400_000):
        now[0] += (end - begin) * each
        each = 1e-7 if begin > 100_000 else 1e-4
        ends.append(end)
    sizes = np.diff([0, *ends])
    # a picture of four times the pixels begins with a quarter; then what takes 0.3 s; then what is quick
    assert sizes[0] == 2**6 and abs(sizes[3] - 3000) < 5 and max(sizes) == 2**15 and ends[-1] == 400_000


def test_portions_leave_a_panel_its_time(renderer: sg.Renderer, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of whatever work: on a machine ten times slower than another, too; without a panel, all at once."""
    now = [0.0]
    monkeypatch.setattr("splatgl.gl.target.time.perf_counter", lambda: now[0])
    costs = np.cumsum(np.random.default_rng(3).integers(1, 1000, 20_000))
    for each in (3e-8, 3e-7):
        asking = target.Portions(renderer.ctx, lambda: False, 2**20)
        took, ends = [], [0]
        for begin, end in asking.parts("lists", costs, 2**20):
            took.append(each * float(costs[end - 1] - (costs[begin - 1] if begin else 0)))
            now[0] += took[-1]
            assert begin == ends[-1]
            ends.append(end)
        assert ends[-1] == len(costs) and max(took) < 0.033
        assert np.median(took) > 0.024
    alone = target.Portions(renderer.ctx)
    assert list(alone.parts("lists", costs, costs[-1])) == [(0, len(costs))]


def test_every_pass_of_sheets_can_be_cancelled(processor: sg.Renderer, monkeypatch: pytest.MonkeyPatch) -> None:
    """In the midst of any work; what comes next is right bit for bit."""
    works: list[str] = []
    parts = target.Portions.parts

    def noted(portions: target.Portions, work: str, costs: Any, most: float) -> Any:
        for portion in parts(portions, work, costs, most):
            works.append(work)
            yield portion

    splats = noise(size=20, opacity=0.9)
    camera, settings = views(splats)["fitted"], sg.Settings()
    if processor.plan(splats, camera, settings).program.technique == "quads":
        pytest.skip("quads have one kind of work")
    right = processor.render(splats, camera, settings).pixels
    monkeypatch.setattr(target.Portions, "parts", noted)
    for module, name, value in ((target, "START", 0.3), (target, "GROWTH", 1.0), (tiles, "ROUNDS", 200)):
        monkeypatch.setattr(module, name, value)
    monkeypatch.setattr(tiles, "ENTRIES", 1000)
    assert (processor.render(splats, camera, settings, interrupted=lambda: False).pixels == right).all()
    kinds = {"sorting", "placing", "listing", "lists", "resolving"}
    assert kinds == set(works) and all(works.count(kind) > 1 for kind in kinds)
    for kind in sorted(kinds):
        works.clear()
        with pytest.raises(sg.Interrupted):
            processor.render(splats, camera, settings, interrupted=lambda kind=kind: kind in works)  # type: ignore[misc]
        assert works[-1] == kind
        assert (processor.render(splats, camera, settings).pixels == right).all()


def test_preparation_ends_where_it_is_checked(processor: sg.Renderer) -> None:
    """At each of its steps; what comes next is right bit for bit."""
    calls, left = list[int](), [0]

    def check() -> None:
        calls.append(1)
        left[0] -= 1
        if left[0] == 0:
            raise sg.Interrupted

    right = processor.render(noise(size=20), camera := views(noise(size=20))["fitted"]).pixels
    splats = noise(size=20)
    with checked(check):
        assert (processor.render(splats, camera).pixels == right).all()
    assert len(calls) > 1
    for number in range(1, len(calls) + 1):
        splats, left[0] = noise(size=20), number
        with checked(check), pytest.raises(sg.Interrupted):
            processor.render(splats, camera)
        assert (processor.render(splats, camera).pixels == right).all()


def test_the_end_of_a_range_makes_portions_no_larger(renderer: sg.Renderer) -> None:
    found = target.Portions(renderer.ctx, None, 100)
    for _ in range(3):
        assert list(found.over(0, 200)) == [(0, 200)]
    assert next(end for _, end in found.over(0, 400)) == target.FIRST


@pytest.mark.few(1)
@pytest.mark.parametrize("change", [{}, {"blend": "xray"}, {"attenuation": "fill"}], ids=str)
@pytest.mark.parametrize("kind", TECHNIQUES)
def test_too_many_splats_to_be_kept_are_drawn_in_chunks(
    renderer: sg.Renderer, monkeypatch: pytest.MonkeyPatch, kind: str, change: dict
) -> None:
    splats = noise(size=14, opacity=0.5)
    for view in ("fitted", "far"):
        camera = views(splats)[view]
        settings = SPLATS.replace(technique=kind, occlusion="off", order="front-to-back", **change)
        whole = renderer.render(splats, camera, settings).pixels
        with monkeypatch.context() as patched:
            for module in (buffers, tiles):
                patched.setattr(module, "MOST_KEPT", 1000)
            patched.setattr(buffers, "CHUNK", 300)
            chunked = [renderer.render(splats, camera, settings).pixels for _ in range(2)]
        renderer.passes.device.splats.release()
        assert (chunked[0] == chunked[1]).all()
        # sums in another order, for want of one
        assert np.abs(chunked[0] - whole).max() <= 2e-6 * whole.max()
