"""Faults while running: a clear message, no half-written output, a non-zero exit code, GL objects released."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import moderngl
import numpy as np
import pytest

import splatgl as sg
from splatgl.app.cli import main

SPLATS = sg.Splats.from_points(np.random.default_rng(1).random((50, 3)) * 9, np.ones((50, 3)), np.ones(50))


def test_out_of_memory_is_told_and_survived(renderer: sg.Renderer, monkeypatch: pytest.MonkeyPatch) -> None:
    """A buffer that cannot be made: one line; and the next picture is right."""
    camera = sg.Camera.orbit(SPLATS, size=(16, 16))
    right = renderer.render(SPLATS, camera).pixels

    def refuse(*_: object, **__: object) -> None:
        raise moderngl.Error("cannot create buffer")

    other = sg.Splats.from_points(np.zeros((1, 3)), np.ones((1, 3)), np.ones(1))
    with monkeypatch.context() as patch:
        patch.setattr(renderer.passes.splats, "of", refuse)
        with pytest.raises(sg.InputError, match="OpenGL failed on 1 splats at 16×16: cannot create buffer; try"):
            renderer.render(other, camera)
    assert (renderer.render(SPLATS, camera).pixels == right).all()


def test_a_gl_error_is_not_swallowed(renderer: sg.Renderer, monkeypatch: pytest.MonkeyPatch) -> None:
    class Broken:
        error = "GL_OUT_OF_MEMORY"

        def __getattr__(self, name: str) -> object:
            return getattr(renderer.passes.ctx, name)

    monkeypatch.setattr(renderer, "ctx", Broken())
    with pytest.raises(sg.InputError, match="GL_OUT_OF_MEMORY"):
        renderer.render(SPLATS, sg.Camera.orbit(SPLATS, size=(16, 16)))


def test_full_disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.chdir(tmp_path)
    np.save("v.npy", np.ones((3, 3, 3)))

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.replace", full)
    assert main(["render", "v.npy", "--size", "8"]) == 2
    assert "v.png: cannot be written: No space left on device" in capsys.readouterr().err
    assert [p.name for p in tmp_path.iterdir()] == ["v.npy"]


def test_ctrl_c_in_the_middle(tmp_path: Path) -> None:
    """A long render that is interrupted ends with 130, one line, and no file."""
    output = tmp_path / "a.png"
    command = [sys.executable, "-m", "splatgl", "render", "tunnel", "--antialias", "supersample", "--samples", "16"]
    run = subprocess.Popen([*command, "-o", str(output)], stderr=subprocess.PIPE, text=True, env=os.environ.copy())
    time.sleep(1.5)
    run.send_signal(signal.SIGINT)
    _, error = run.communicate(timeout=60)
    assert run.returncode == 130
    assert error.strip().splitlines()[-1] == "splatgl: interrupted"
    assert "Traceback" not in error
    assert list(tmp_path.iterdir()) == []
