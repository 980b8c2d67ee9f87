"""`scripts/gpu_check`: its short form on software OpenGL, what it refuses, leaves out, and tells of a wrong picture."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import splatgl as sg
from splatgl.gl import buffers

sys.path.insert(0, str(Path(__file__).parents[2] / "scripts"))
import gpu_check

from tests.gpu import gpu_check_tests


@pytest.mark.long
def test_short_form(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    told = tmp_path / "told.json"
    assert gpu_check.main(["--short", "--software", "-o", str(told)]) == 0
    found = json.loads(told.read_text())
    frames = found["frames"]
    assert found["right"] and [path.name for path in tmp_path.iterdir()] == ["told.json"]
    assert {(frame["look"], frame["way"]) for frame in frames} == {
        (look, way) for look in gpu_check.LOOKS for way in gpu_check.WAYS
    }
    for frame in frames:
        stages = {"project", "count", "list", "add up"} | ({"sort"} if frame["look"] != "splats" else set())
        assert set(frame["stages"]) == (stages if frame["way"] == "tiles" else set())
    ways = [error["way"] for error in found["errors"]]
    assert ways[: len(gpu_check.WAYS)] == list(gpu_check.WAYS) and all(0 < e["error"] < 0.1 for e in found["errors"])
    assert all(frame["seconds"] > 0 and frame["upload"] >= 0 for frame in frames)
    # the first way is what the others are compared with
    apart = [frame["apart"] for frame in frames if frame["way"] == "quads"]
    assert (
        all(0 < each < 0.01 for each in apart) and [frame["apart"] for frame in frames].count(None) == len(apart) == 3
    )
    # pixels end one by one, or with their tile
    assert all(frame["apart"] < 1e-3 for frame in frames if frame["way"] == "columns")
    assert all(frame["apart"] is None or frame["apart"] <= frame["allowed"] < 0.01 for frame in frames)
    assert set(found["quads over tiles"]) == set(gpu_check.LOOKS) and "the tests" in found["left out"]
    said = capsys.readouterr().out
    assert all(f"{look}: quads take" in said for look in gpu_check.LOOKS) and said.count("; auto draws ") == 3
    assert said.endswith("told.json: everything that was checked is right; left out: the tests\n")


def by_quads(monkeypatch: pytest.MonkeyPatch, changed: Callable[[sg.Image], sg.Image]) -> None:
    """Pictures by quads are what `changed` makes of them."""
    render = sg.Renderer.render

    def drawn(
        self: sg.Renderer, splats: sg.Splats, camera: sg.Camera, settings: sg.Settings, **more: object
    ) -> sg.Image:
        image = render(self, splats, camera, settings, **more)
        return changed(image) if settings.technique == "quads" else image

    monkeypatch.setattr(sg.Renderer, "render", drawn)
    monkeypatch.setattr(gpu_check, "errors", lambda *_: iter(()))
    monkeypatch.setattr(gpu_check, "WAYS", {way: gpu_check.WAYS[way] for way in ("columns", "quads")})


@pytest.mark.long
def test_a_wrong_picture_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    by_quads(monkeypatch, lambda image: sg.Image(image.pixels * np.float32(0.9), image.info))
    assert gpu_check.main(["--short", "--software", "-o", str(tmp_path / "told.json")]) == 1
    assert not json.loads((tmp_path / "told.json").read_text())["right"]
    assert "something is WRONG" in capsys.readouterr().out


def test_a_picture_that_fails_is_told_with_the_others(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def failing(image: sg.Image) -> sg.Image:
        raise sg.InputError("out of memory")

    by_quads(monkeypatch, failing)
    assert gpu_check.main(["--short", "--software", "-o", str(tmp_path / "told.json")]) == 1
    told = json.loads((tmp_path / "told.json").read_text())
    assert told["failed"] == [f"ball {look} 64² by quads: FAILED: out of memory" for look in gpu_check.LOOKS]
    assert len(told["frames"]) == len(gpu_check.LOOKS) and not told["right"]
    assert "something is WRONG" in capsys.readouterr().out


def test_what_there_is_no_time_for_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Nothing is wrong, but nothing was compared either."""
    monkeypatch.setattr(gpu_check, "MOST", 0.0)
    assert gpu_check.main(["--short", "--software", "-o", str(tmp_path / "told.json")]) == 0
    told, said = json.loads((tmp_path / "told.json").read_text()), capsys.readouterr().out
    left = ["errors of ball", *(f"ball {look} 64²" for look in gpu_check.LOOKS)]
    assert told["left out"] == [*left, "the tests"] and told["right"] and not told["frames"]
    assert all(f"{name}: left out: no time\n" in said for name in left)
    assert said.endswith(f"told.json: everything that was checked is right; left out: {', '.join(left)}, the tests\n")


@pytest.mark.long
def test_tests_that_did_not_end_are_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(gpu_check_tests, "TESTED", ("docs/test_top_level", "docs/test_tags"))
    told = gpu_check_tests.tests(60.0, card=False)
    assert told["ended"] == "passed" and told["passed"] + told["skipped"] > 2 and not told["left out"] + told["failed"]
    told = gpu_check_tests.tests(0.01, card=False)
    assert told["ended"] == "ran out of time" and told["left out"] == ["docs/test_top_level", "docs/test_tags"]


PASSED = "tests/docs/test_top_level.py::test_one[a b] PASSED      [  2%]"
FAILED = "tests/docs/test_top_level.py::test_two FAILED           [ 12%]"


@pytest.mark.parametrize(
    ("lines", "code", "ended", "failed", "left"),
    [
        ([PASSED], 0, "passed", [], []),
        ([PASSED, FAILED], 1, "FAILED", ["tests/docs/test_top_level.py::test_two"], []),
        ([PASSED], None, "ran out of time", [], ["the rest of docs/test_top_level", "docs/test_tags"]),
        # what failed before counts
        (
            [FAILED],
            None,
            "FAILED",
            ["tests/docs/test_top_level.py::test_two"],
            ["the rest of docs/test_top_level", "docs/test_tags"],
        ),
        ([PASSED, "Aborted"], -6, "FAILED", ["pytest ended with exit code -6: Aborted"], []),
    ],
)
def test_outcome_of_tests(
    lines: list[str], code: int | None, ended: str, failed: list[str], left: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(gpu_check_tests, "TESTED", ("docs/test_top_level", "docs/test_tags"))
    told = gpu_check_tests.outcome(lines, code)
    assert (told["ended"], told["failed"], told["left out"]) == (ended, failed, left)
    assert told["passed"] == lines.count(PASSED)


@pytest.mark.parametrize("technique", ["tiles", "quads"])
def test_upload_is_that_of_splats(technique: str, renderer: sg.Renderer, monkeypatch: pytest.MonkeyPatch) -> None:
    """A delay of every upload is in it."""
    volume = sg.scenes.ball(6)
    splats = sg.extract(volume, sg.default_transfer(volume))
    assert gpu_check.time_upload(renderer, splats, technique) < 0.1
    for owner, method in ((buffers.InstanceBuffer, "fill"), (buffers, "_filled")):
        monkeypatch.setattr(owner, method, slow(getattr(owner, method)))
    assert gpu_check.time_upload(renderer, splats, technique) > 0.2


def slow(upload: Any) -> Any:
    def late(*arguments: object) -> object:
        time.sleep(0.2)
        return upload(*arguments)

    return late


def test_a_picture_that_would_take_too_long_is_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    """Not begun, by what the smaller one took."""
    both = [gpu_check.Subject(name, "splats", *[None] * 3) for name in ("quick", "slow")]
    monkeypatch.setattr(gpu_check, "subjects", lambda _: both)
    begun = []

    def compared(_: object, subject: gpu_check.Subject, size: int, until: float) -> Iterator[gpu_check.Frame]:
        begun.append(subject.at(size))
        first = 30.0 if subject.scene == "slow" else 0.1
        yield gpu_check.Frame(subject.scene, "splats", size, "tiles", 1, first, 0.0, 0.1, None, 0.0, "tiles", {})

    monkeypatch.setattr(gpu_check, "compared", compared)
    left = [
        each for each in gpu_check.frames(None, False, time.monotonic() + 60) if isinstance(each, gpu_check.LeftOut)
    ]
    assert begun == ["quick splats 512²", "slow splats 512²", "quick splats 1024²", "quick splats 2048²"]
    assert [each.what for each in left] == ["slow splats 1024²", "slow splats 2048²"]


@pytest.mark.parametrize("output", ["/dev/null/told.json", "told.txt", ""])
def test_an_output_that_cannot_be_written_is_refused_before_work(
    output: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sg, "Renderer", lambda **_: pytest.fail("a context is opened"))
    assert gpu_check.main(["--short", "--software", "-o", output]) == 2
    assert not list(tmp_path.iterdir()) and len(capsys.readouterr().err.splitlines()) == 1


def test_the_default_output_is_not_tracked() -> None:
    ignored = Path(__file__).parents[2] / ".gitignore"
    if not ignored.exists():
        pytest.skip("a source archive")
    assert "gpu_check.json" in ignored.read_text().split()


def test_a_machine_without_a_card(tmp_path: Path, renderer: sg.Renderer, capsys: pytest.CaptureFixture[str]) -> None:
    if not renderer.info.software:
        pytest.skip("a graphics card is here")
    assert gpu_check.main(["--short", "-o", str(tmp_path / "told.json")]) == 2
    assert not list(tmp_path.iterdir()) and len(capsys.readouterr().err.splitlines()) == 1
