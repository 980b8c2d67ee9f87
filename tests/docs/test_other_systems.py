"""What only Linux has is not needed: a Python without it reads, draws and writes."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from splatgl import platforms
from splatgl.fileio import budget

# found by each Python that starts, the processes of readers among them: modules and functions that Windows has not, and
# paths that only Linux has
HIDDEN = """
import os, pathlib, signal, sys
for name in ("resource", "fcntl", "pwd", "grp", "termios", "tty", "pty", "psutil"):
    sys.modules[name] = None
for name in ("sysconf", "fork", "register_at_fork", "sched_getaffinity", "getuid", "geteuid", "getgid", "getpgid",
             "killpg", "chown", "fchmod", "mkfifo", "statvfs", "getloadavg", "RTLD_NOLOAD"):
    if hasattr(os, name):
        delattr(os, name)
for name in ("SIGHUP", "SIGKILL", "SIGALRM", "SIGUSR1", "alarm", "setitimer"):
    if hasattr(signal, name):
        delattr(signal, name)
real = pathlib.Path.read_text
def read_text(self, *args, **options):
    if str(self).startswith(("/proc", "/sys")):
        raise FileNotFoundError(str(self))
    return real(self, *args, **options)
pathlib.Path.read_text = read_text
"""


@pytest.fixture
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, str]:
    """The environment of processes that lack all that."""
    (tmp_path / "sitecustomize.py").write_text(HIDDEN, encoding="utf-8")
    path = os.pathsep.join([str(tmp_path), str(Path(__file__).parents[2]), os.environ.get("PYTHONPATH", "")])
    return os.environ | {"PYTHONPATH": path}


def run(environment: dict[str, str], *arguments: str) -> str:
    told = subprocess.run([sys.executable, *arguments], env=environment, capture_output=True, text=True)
    assert told.returncode == 0, told.stderr
    return told.stdout


@pytest.mark.long
def test_a_file_is_drawn(tmp_path: Path, elsewhere: dict[str, str]) -> None:
    h5py = pytest.importorskip("h5py")
    samples = np.random.default_rng(3).random((4, 5, 6), np.float32)
    with h5py.File(tmp_path / "v.h5", "w") as file:
        file["v"] = samples
    np.save(tmp_path / "v.npy", samples)
    # the test's own: that they are gone
    run(elsewhere, "-c", "import os, sys; assert not hasattr(os, 'sysconf') and sys.modules['resource'] is None")
    for source in ("v.npy", "v.h5"):
        picture = tmp_path / f"{source}.out.npy"
        run(elsewhere, "-m", "splatgl", "render", str(tmp_path / source), "-o", str(picture), "--size", "8", "--quiet")
    drawn = [np.load(tmp_path / f"{source}.out.npy") for source in ("v.npy", "v.h5")]
    assert drawn[0].max() > 0 and np.array_equal(*drawn)
    assert "5" in run(elsewhere, "-m", "splatgl", "info", str(tmp_path / "v.h5"))


def test_a_file_that_ends_hdf5_is_told_there_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """By the process that waits, where none can limit its own time; one that can't start says nothing of the file."""
    hdf5_file = pytest.importorskip("splatgl.readers.hdf5")
    file, probe = tmp_path / "v.h5", tmp_path / "probe.py"
    file.write_bytes(b"v")
    monkeypatch.setattr(hdf5_file, "_PROBE", probe)
    monkeypatch.setattr(hdf5_file, "_PROBE_TIMEOUT", 2.0)
    for code in ("print(1, flush=True)\nwhile True: pass", "print(1, flush=True)\nimport os; os._exit(3)"):
        probe.write_text(code)
        with pytest.raises(hdf5_file.InputError, match="its library fails on the file"):
            hdf5_file._probe(file)
    for code in ("import nothing_of_that_name", "print(1)"):
        probe.write_text(code)
        hdf5_file._PROBED.clear()
        hdf5_file._probe(file)
    monkeypatch.setattr(sys, "executable", str(tmp_path / "none"))
    hdf5_file._PROBED.clear()
    hdf5_file._probe(file)


def test_memory_that_nobody_tells_is_assumed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(platforms, "Path", lambda name: Path("/nowhere") / name.lstrip("/"))
    monkeypatch.setitem(sys.modules, "psutil", None)
    assert 2**28 < platforms.free_memory() < 2**50
    monkeypatch.delattr(os, "sysconf")
    assert platforms.free_memory() == platforms.ASSUMED_FREE and budget() == platforms.ASSUMED_FREE // 2
