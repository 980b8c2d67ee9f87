"""What only Linux has is not needed: a Python without it reads, draws and writes."""

from __future__ import annotations

import ctypes
import errno
import io
import os
import signal
import subprocess
import sys
from pathlib import Path, PureWindowsPath
from types import SimpleNamespace

import numpy as np
import pytest

from splatgl import platforms
from splatgl.cli import main as command_line
from splatgl.data.mask import parse_mask
from splatgl.errors import InputError
from splatgl.fileio import budget, check_output, write_file
from splatgl.readers import elsewhere as other_process
from splatgl.readers.options import inside
from splatgl.readers.remote import address_name, is_address
from splatgl.scene.meshes import LOOK, split_look
from tests.helpers.blobs import LONGEST
from tests.helpers.other_system import HIDDEN

pytestmark = pytest.mark.usefixtures("shared_programs")


@pytest.fixture
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, str]:
    """The environment of processes that lack all that."""
    (tmp_path / "sitecustomize.py").write_text(HIDDEN, encoding="utf-8")
    path = os.pathsep.join([str(tmp_path), str(Path(__file__).parents[2]), os.environ.get("PYTHONPATH", "")])
    return os.environ | {"PYTHONPATH": path}


def run(environment: dict[str, str], *arguments: str) -> str:
    out, error = subprocess.PIPE, subprocess.STDOUT
    # one that hangs is aborted, and says where
    command = [sys.executable, "-X", "faulthandler", *arguments]
    process = subprocess.Popen(command, env=environment, stdout=out, stderr=error, text=True)
    try:
        told = process.communicate(timeout=LONGEST)[0]
    except subprocess.TimeoutExpired:
        process.send_signal(signal.SIGABRT)
        told = process.communicate()[0]
    assert process.returncode == 0, told
    return told


# what Mesa answers there, versions that are requested, folders below the home folder, and words of the doctor
SYSTEMS = {
    "win32": ({}, "wgl 460 450", ("AppData/Local",) * 2, "driver of the graphics card"),
    "darwin": (
        {"MESA_GL_VERSION_OVERRIDE": "4.1", "MESA_GLSL_VERSION_OVERRIDE": "410"},
        "cgl 410",
        ("Library/Caches", "Library/Application Support"),
        "desktop of macOS",
    ),
}


@pytest.mark.parametrize("system", ["win32", pytest.param("darwin", marks=pytest.mark.long)])
def test_another_system(tmp_path: Path, elsewhere: dict[str, str], system: str) -> None:
    """All modules are imported, a file is read and drawn, and the doctor speaks of that system alone."""
    h5py = pytest.importorskip("h5py")
    mesa, versions, folders, words = SYSTEMS[system]
    samples = np.random.default_rng(3).random((4, 5, 6), np.float32)
    np.save(tmp_path / "v.npy", samples)
    with h5py.File(tmp_path / "v.h5", "w") as file:
        file["v"] = samples
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "XDG_CACHE_HOME", "XDG_STATE_HOME", "LOCALAPPDATA"):
        elsewhere.pop(name, None)
    text = run(elsewhere | mesa, "-m", "tests.helpers.other_system", system, str(tmp_path))
    assert "pictures are right" in text and f"backend {versions}\n" in text and words in text
    report = text[text.index("versions\n") : text.index("pictures are right")]
    assert "apt-get" not in text and "osmesa" not in text and "egl" not in report.lower()
    assert "folder " + " ".join(f"/home/{folder}" for folder in folders) in text
    assert ("draws by tiles" in text) == (system == "win32")
    refused = "v.npy: cannot be written: it is open, here or in another program; close it, or choose another name"
    assert (refused in text) == (system == "win32")
    assert np.load(tmp_path / "w.npy").max() > 0.1 and np.load(tmp_path / "c.npy").max() > 0.1
    assert "exit render 0" in text and "exit info 0" in text and f"auto, {versions[:3]} or window" in text
    window = next(line for line in text.splitlines() if line.startswith("splatgl: OpenGL: "))
    assert "window says: " in window and words in window and f"exit {tmp_path / 'v.h5:'}/v 2" in text
    assert not [path for path in tmp_path.iterdir() if path.name.startswith(".")]


def test_a_drive_is_no_option() -> None:
    assert inside(r"C:\v.h5:/a/b") == (r"C:\v.h5", "/a/b") and inside(r"C:\v.h5") == (r"C:\v.h5", None)
    assert inside(str(PureWindowsPath("C:/d") / "v.h5:/a/b")) == (r"C:\d\v.h5", "/a/b")
    assert split_look(r"C:\m.stl:bone:0.5", str.isalpha) == (r"C:\m.stl", "bone", 0.5)
    for look in (str.isalpha, lambda text: LOOK.fullmatch(text) is not None):
        assert split_look(r"C:\m.stl", look) == (r"C:\m.stl", "", 1.0)
    assert parse_mask(r"C:\m.nii:1,2:outside") == (r"C:\m.nii", (1, 2), True)
    assert parse_mask(r"C:\m.nii") == (r"C:\m.nii", (), False)
    assert not is_address(r"C:\v.nrrd") and not is_address("C:/v.nrrd") and is_address("s3://v.nrrd")


def test_names_that_windows_refuses(monkeypatch: pytest.MonkeyPatch) -> None:
    address = "https://there/a/b:c*d.nrrd?x=1"
    for name in ("con.png", "NUL.npy", "lpt1.a.png"):
        check_output(Path(name))
    assert address_name(address) == "b:c*d.nrrd"
    monkeypatch.setattr(sys, "platform", "win32")
    for name in ("con.png", "NUL.npy", "lpt1.a.png"):
        with pytest.raises(InputError, match=f"{name}: expected a file to write, got the name of a device of Windows"):
            check_output(Path(name))
    for name in ("cone.png", "contour.npy", "lpt.png"):
        check_output(Path(name))
    assert address_name(address) == "b_c_d.nrrd"


def test_a_pipe_that_is_closed_is_told_in_windows_words(monkeypatch: pytest.MonkeyPatch) -> None:
    class Closed(io.StringIO):
        def write(self, text: str) -> int:
            raise OSError(errno.EINVAL, "Invalid argument")

    for platform, code in (("linux", 2), ("win32", 0)):
        with monkeypatch.context() as patch:
            patch.setattr(sys, "platform", platform)
            patch.setattr(sys, "stdout", Closed())
            assert command_line.main(["presets"]) == code


def test_a_refusal_is_of_that_system(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where files that are open can be replaced, another reason is passed on."""

    def refuse(source: str, target: str) -> None:
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr(os, "replace", refuse)
    with pytest.raises(InputError, match=r"w: cannot be written: Operation not permitted$"):
        write_file(tmp_path / "w", b"w")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.long
def test_a_file_is_drawn(tmp_path: Path, elsewhere: dict[str, str]) -> None:
    h5py = pytest.importorskip("h5py")
    samples = np.random.default_rng(3).random((4, 5, 6), np.float32)
    with h5py.File(tmp_path / "v.h5", "w") as file:
        file["samples"] = samples
    np.save(tmp_path / "v.npy", samples)
    # the test's own: that they are gone
    run(elsewhere, "-c", "import os, sys; assert not hasattr(os, 'sysconf') and sys.modules['resource'] is None")
    for source in ("v.npy", "v.h5"):
        picture = tmp_path / f"{source}.out.npy"
        run(elsewhere, "-m", "splatgl", "render", str(tmp_path / source), "-o", str(picture), "--size", "8", "--quiet")
    drawn = [np.load(tmp_path / f"{source}.out.npy") for source in ("v.npy", "v.h5")]
    assert drawn[0].max() > 0 and np.array_equal(*drawn)
    assert "5" in run(elsewhere, "-m", "splatgl", "info", str(tmp_path / "v.h5"))


def test_a_look_at_a_file_is_told_there_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """By the process that waits, where none can limit its own time; one that can't start says nothing of the file."""
    monkeypatch.setattr(other_process, "_open", {})
    monkeypatch.setattr(other_process, "_LOOKS", {})
    for seconds in (0.0, 60.0):
        # ended by its processor time, or by who waits; once
        monkeypatch.setattr(other_process, "_LOOKS", {})
        other_process.call("common.parse_number", 0, "1")
        monkeypatch.setattr(other_process, "SECONDS", 5.0 - seconds)
        with pytest.raises(InputError, match="the format's library crashes, takes too long"):
            other_process.look("tests.helpers.hostile:loop", tmp_path, seconds)
        monkeypatch.setattr(other_process, "SECONDS", 60.0)
    monkeypatch.setattr(sys, "executable", str(tmp_path / "none"))
    with pytest.raises(InputError, match="the format's library crashes"):
        other_process.look("tests.helpers.hostile:loop", tmp_path, 1.0)
    monkeypatch.setattr(other_process, "_LOOKS", {})
    other_process.look("tests.helpers.hostile:loop", tmp_path, 1.0)


def test_a_look_is_limited_where_it_can_be(monkeypatch: pytest.MonkeyPatch) -> None:
    """macOS refuses some limits; Windows has none, but windows that tell of a crash, and wait for a click."""
    limited, modes = dict[str, tuple[int, int]](), list[int]()

    def limit(name: str, most: tuple[int, int]) -> None:
        if name == "memory":
            raise ValueError("current limit exceeds maximum limit")
        limited[name] = most

    names = {"RLIMIT_CPU": "time", "RLIMIT_AS": "memory", "RLIMIT_CORE": "dump", "RLIM_INFINITY": -1}
    there = SimpleNamespace(setrlimit=limit, getrlimit=lambda name: (0, -1), **names)
    monkeypatch.setitem(sys.modules, "resource", there)
    monkeypatch.setattr(other_process, "time", SimpleNamespace(process_time=lambda: 0.5))
    other_process._limit(2**30, 3.0)
    assert limited == {"time": (4, -1), "dump": (0, -1)}
    kernel = SimpleNamespace(SetErrorMode=modes.append)
    monkeypatch.setattr(ctypes, "windll", SimpleNamespace(kernel32=kernel), raising=False)
    monkeypatch.setattr(sys, "platform", "win32")
    monkeypatch.setitem(sys.modules, "resource", None)
    other_process._limit(2**30, 3.0)
    assert modes == [3]


def test_memory_that_nobody_tells_is_assumed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(platforms, "Path", lambda name: Path("/nowhere") / name.lstrip("/"))
    assert 2**28 < platforms.free_memory() < 2**50
    monkeypatch.delattr(os, "sysconf")
    assert platforms.free_memory() == platforms.ASSUMED_FREE and budget() == platforms.ASSUMED_FREE // 2
