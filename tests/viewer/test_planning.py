"""A picture is planned once, by whichever front end it is drawn."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import splatgl as sg
from splatgl.cli.main import main
from splatgl.planning import plan as plans
from splatgl.planning import scene as scenes
from splatgl.scene.scene_file import SceneFile
from splatgl.viewer.adaptive_quality import FULL
from splatgl.viewer.document import Document
from splatgl.viewer.frame_renderer import FrameRenderer
from splatgl.viewer.notebook import Session
from splatgl.viewer.state import State
from tests.helpers.doors import NoScreen

SIZE = (24, 20)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """A scene file with one volume."""
    z, y, x = np.mgrid[-4:5, -4:5, -4:5]
    np.save(tmp_path / "ball.npy", np.exp(-(x * x + y * y + z * z) / 9.0).astype(np.float32))
    (tmp_path / "scene.toml").write_text(f'volume = "ball.npy"\n[camera]\nsize = [{SIZE[0]}, {SIZE[1]}]\n')
    return tmp_path / "scene.toml"


def by_python(path: Path) -> None:
    sg.render(path)


def by_command(path: Path) -> None:
    target = str(path.with_name("picture.npy"))
    assert main(["render", str(path), "--explain", "--savings", "--check", "5", "-o", target]) == 0


def in_window(path: Path) -> None:
    document = Document.open(SceneFile.from_toml(path))
    with sg.Renderer() as renderer:
        painter = FrameRenderer(NoScreen(), renderer)  # type: ignore[arg-type]
        painter.draw(State.of(document, SIZE), document, FULL, False, None)


def in_notebook(path: Path) -> None:
    session = Session(SceneFile.from_toml(path))
    while session.frame() is not None:
        pass
    assert session.level == FULL


@pytest.mark.parametrize("draw", [by_python, by_command, in_window, in_notebook])
def test_a_picture_is_planned_once(draw: Callable[[Path], None], path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    planned, drawn = list[object](), list[object]()
    plan, render = plans.plan_layer, sg.Renderer.draw

    def counted(*arguments: Any, **others: Any) -> Any:
        planned.append(arguments)
        return plan(*arguments, **others)

    def rendered(self: sg.Renderer, *arguments: Any, **others: Any) -> sg.Image:
        drawn.append(arguments)
        return render(self, *arguments, **others)

    monkeypatch.setattr(scenes, "plan_layer", counted)
    monkeypatch.setattr(plans, "plan_layer", counted)
    monkeypatch.setattr(sg.Renderer, "draw", rendered)
    draw(path)
    assert len(planned) == len(drawn) > 0
