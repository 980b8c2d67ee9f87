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
from splatgl.cli.main import main

pytestmark = pytest.mark.usefixtures("shared_programs")

SPLATS = sg.Splats.from_points(np.random.default_rng(1).random((50, 3)) * 9, np.ones((50, 3)), np.ones(50))


@pytest.mark.long
def test_out_of_memory_is_told_and_survived(renderer: sg.Renderer, monkeypatch: pytest.MonkeyPatch) -> None:
    """A buffer that cannot be made: one line; and the next picture is right."""
    camera = sg.Camera.orbit(SPLATS, size=(16, 16))
    right = renderer.render(SPLATS, camera).pixels

    def refuse(*_: object, **__: object) -> None:
        raise moderngl.Error("cannot create buffer")

    other = sg.Splats.from_points(np.zeros((1, 3)), np.ones((1, 3)), np.ones(1))
    with monkeypatch.context() as patch:
        patch.setattr(renderer.passes.device.splats, "of", refuse)
        with pytest.raises(sg.InputError, match="OpenGL failed on 1 splats at 16×16: cannot create buffer; try"):
            renderer.render(other, camera)
    assert (renderer.render(SPLATS, camera).pixels == right).all()


def test_a_gl_error_is_not_swallowed(renderer: sg.Renderer, monkeypatch: pytest.MonkeyPatch) -> None:
    class Broken:
        error = "GL_OUT_OF_MEMORY"

        def __getattr__(self, name: str) -> object:
            return getattr(renderer.passes.ctx, name)

    with monkeypatch.context() as patch:
        patch.setattr(renderer, "ctx", Broken())
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


# `splatgl` as it is, but for a line on standard output when drawing begins. Started with SIGINT ignored, as by a shell
# in the background, Python would not hear it.
TELLING = """
import signal, sys
from splatgl.cli.main import main
from splatgl.gl.passes import Passes

signal.signal(signal.SIGINT, signal.default_int_handler)
draw = Passes.draw

def telling(*args, **kwargs):
    print("drawing", flush=True)
    return draw(*args, **kwargs)

Passes.draw = telling
sys.exit(main(sys.argv[1:]))
"""
# processor seconds: in software the picture takes a hundred, and is in the middle after three. A part of it takes one
# or two, the way out less than one
BEGUN, MOST = 3.0, 25.0


def processor_seconds(pid: int) -> float:
    """What a process has taken so far."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


@pytest.mark.long
@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="asks /proc for a process's time")
def test_ctrl_c_in_the_middle(tmp_path: Path) -> None:
    """A long render that is interrupted ends with 130, one line, and no file, and leaves most of it undrawn."""
    drawn = ["render", "tunnel", "--antialias", "supersample", "--samples", "16", "-o", str(tmp_path / "a.png")]
    threads = {**os.environ, "LP_NUM_THREADS": "2"}
    command = [sys.executable, "-c", TELLING, *drawn]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=threads) as run:
        try:
            assert run.stdout and run.stdout.readline() == "drawing\n"
            began = processor_seconds(run.pid)
            while run.poll() is None and processor_seconds(run.pid) < began + BEGUN:
                time.sleep(0.01)
            if run.poll() == 0:
                pytest.skip("drawn too fast to be interrupted")
            run.send_signal(signal.SIGINT)
            while os.waitid(os.P_PID, run.pid, os.WEXITED | os.WNOHANG | os.WNOWAIT) is None:
                assert processor_seconds(run.pid) < began + MOST, "goes on drawing"
                time.sleep(0.01)
            _, error = run.communicate()
        finally:
            run.kill()
    assert (run.returncode, error) == (130, "splatgl: interrupted\n")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.few(1)
@pytest.mark.parametrize(("sent", "ignored"), [("SIGTERM", False), ("SIGHUP", False), ("SIGHUP", True)])
def test_signals_of_schedulers_leave_no_part(sent: str, ignored: bool, tmp_path: Path) -> None:
    """A folder that is being written disappears, and the exit code is that of the signal; nohup is respected."""
    if not hasattr(signal, sent):
        pytest.skip("a signal of other systems")
    np.save(tmp_path / "v.npy", np.zeros((4, 4, 4), np.float32))
    handler = "SIG_IGN" if ignored else "SIG_DFL"
    program = f"""
import os, signal, sys
from pathlib import Path
from splatgl.cli import export
from splatgl.cli.main import main
from splatgl.fileio import atomic_folder

def write(args):
    with atomic_folder(Path("out.zarr")) as part:
        part.mkdir()
        os.kill(os.getpid(), signal.{sent})
    return 0

signal.signal(signal.{sent}, signal.{handler})
export.run_convert = write
sys.argv = ["splatgl", "convert", "v.npy", "out.zarr"]
sys.exit(main())
"""
    done = subprocess.run([sys.executable, "-c", program], cwd=tmp_path, capture_output=True, text=True, check=False)
    if ignored:
        assert (done.returncode, done.stderr) == (0, "")
    else:
        assert (done.returncode, done.stderr) == (128 + getattr(signal, sent), "splatgl: interrupted\n")
    assert {path.name for path in tmp_path.iterdir()} == ({"v.npy", "out.zarr"} if ignored else {"v.npy"})
