"""`scripts/gpu_check`: its short form on software OpenGL, what it refuses, and what it tells of a wrong picture."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import pytest

import splatgl as sg

sys.path.insert(0, str(Path(__file__).parents[1] / "scripts"))
import gpu_check


def test_short_form(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    told = tmp_path / "told.json"
    assert gpu_check.main(["--short", "--software", "-o", str(told)]) == 0
    found = json.loads(told.read_text())
    frames = found["frames"]
    assert found["right"] and [path.name for path in tmp_path.iterdir()] == ["told.json"]
    assert {(frame["look"], frame["technique"]) for frame in frames} == {
        (look, technique) for look in gpu_check.LOOKS for technique in gpu_check.TECHNIQUES
    }
    assert all(frame["seconds"] > 0 and 0 <= frame["apart"] <= frame["allowed"] < 0.01 for frame in frames)
    assert set(found["quads over tiles"]) == set(gpu_check.LOOKS)
    assert "everything is right" in capsys.readouterr().out


def test_a_wrong_picture_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    render = sg.Renderer.render

    def wrong(
        self: sg.Renderer, splats: sg.Splats, camera: sg.Camera, settings: sg.Settings, **more: object
    ) -> sg.Image:
        image = render(self, splats, camera, settings, **more)
        return sg.Image(image.pixels * np.float32(0.9), image.info) if settings.technique == "quads" else image

    monkeypatch.setattr(sg.Renderer, "render", wrong)
    assert gpu_check.main(["--short", "--software", "-o", str(tmp_path / "told.json")]) == 1
    assert not json.loads((tmp_path / "told.json").read_text())["right"]
    assert "something is WRONG" in capsys.readouterr().out


def test_a_machine_without_a_card(tmp_path: Path, renderer: sg.Renderer, capsys: pytest.CaptureFixture[str]) -> None:
    if not renderer.info.software:
        pytest.skip("a graphics card is here")
    assert gpu_check.main(["--short", "-o", str(tmp_path / "told.json")]) == 2
    assert not list(tmp_path.iterdir()) and len(capsys.readouterr().err.splitlines()) == 1
