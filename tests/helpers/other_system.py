"""Emulates Windows or macOS in a Python of Linux: python -m tests.helpers.other_system win32|darwin FOLDER.

Emulated: `sys.platform`; modules, functions, signals and files that only Linux has are gone (`HIDDEN`, before anything
is imported); glcontext's modules `wgl` and `darwin`, opengl32.dll and the framework OpenGL, on top of EGL, and no other
library; the kernel's functions for free memory; on Windows a file that is mapped can't be replaced. Not emulated: paths
(`os.name` stays), drivers and windows.
"""

from __future__ import annotations

import ctypes
import importlib
import os
import pkgutil
import sys
import types
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

# for a sitecustomize.py, which each Python imports first
HIDDEN = """
import os, pathlib, signal, sys
# colorama calls a console that only Windows has
for name in ("resource", "fcntl", "pwd", "grp", "termios", "tty", "pty", "psutil", "colorama"):
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
FREE = 6 << 30  # bytes that the kernel reports
asked: list[int] = []  # versions of OpenGL
mapped: set[str] = set()  # files that Windows would not replace


class Function:
    """A function of a C library: its types can be set."""

    def __init__(self, call: Callable[..., Any]) -> None:
        self.call = call

    def __call__(self, *arguments: Any) -> Any:
        return self.call(*arguments)


class Context:
    """A context of glcontext's `wgl` and `darwin`: freed, it leaves none current."""

    def __init__(self, real: Any, make_current: Callable[[int | None], bool]) -> None:
        self.real, self.make_current = real, make_current
        self.load_opengl_function = real.load_opengl_function

    def __enter__(self) -> None:
        self.real.__enter__()

    def __exit__(self, *error: object) -> None:
        self.real.__exit__(*error)

    def release(self) -> None:
        self.make_current(None)
        self.real.release()


def become(system: str) -> Callable[[], int | None]:
    """Turns this process into one of win32 or darwin; splatgl must be imported after it. Returns a function that tells
    the handle of the current context.
    """
    real = ctypes.CDLL
    egl = real("libEGL.so.1")
    for name in ("eglGetCurrentContext", "eglGetCurrentDisplay"):
        getattr(egl, name).restype = ctypes.c_void_p
    egl.eglMakeCurrent.argtypes = [ctypes.c_void_p] * 4
    displays: list[int] = []

    def make_current(context: int | None) -> bool:
        displays[:] = [egl.eglGetCurrentDisplay() or displays[0]]
        return bool(egl.eglMakeCurrent(displays[0], None, None, context))

    def load(name: str | None, mode: int = 0) -> Any:
        libraries: dict[str | None, dict[str, Callable[..., Any]]] = {
            "opengl32.dll": {
                "wglGetCurrentDC": egl.eglGetCurrentDisplay,
                "wglGetCurrentContext": egl.eglGetCurrentContext,
                "wglMakeCurrent": lambda device, context: make_current(context),
            },
            "/System/Library/Frameworks/OpenGL.framework/OpenGL": {
                "CGLGetCurrentContext": egl.eglGetCurrentContext,
                "CGLSetCurrentContext": lambda context: not make_current(context),
            },
            None: {"sysctlbyname": sysctl},
        }
        if name is None and system == "win32":
            raise TypeError("a name is needed")
        if name not in libraries or (name == "opengl32.dll") != (system == "win32"):
            raise AssertionError(f"{name} is not of this system")
        return types.SimpleNamespace(**{key: Function(call) for key, call in libraries[name].items()})

    ctypes.CDLL = load  # type: ignore[misc, assignment]
    sys.platform = system
    if system == "win32":
        ctypes.WinDLL = load  # type: ignore[attr-defined]
        kernel = types.SimpleNamespace(GlobalMemoryStatusEx=memory_status)
        ctypes.windll = types.SimpleNamespace(kernel32=kernel)  # type: ignore[attr-defined]
        replace = os.replace

        def reject_mapped(source: str, target: str) -> None:
            if os.path.realpath(target) in mapped:
                raise PermissionError(13, "Access is denied")
            replace(source, target)

        os.replace = reject_mapped  # type: ignore[assignment]
    _replace_glcontext(system, make_current)
    return egl.eglGetCurrentContext  # type: ignore[no-any-return]


def _replace_glcontext(system: str, make_current: Callable[[int | None], bool]) -> None:
    """glcontext as it is built there, on top of its EGL."""
    from glcontext import egl as real

    def create(mode: str = "detect", libgl: str = "opengl32.dll", glversion: int = 330) -> Any:
        assert mode == "standalone" and libgl == "opengl32.dll"
        asked.append(glversion)
        if glversion > 450:
            raise RuntimeError("wglCreateContextAttribsARB failed")
        made = real.create_context(mode=mode, libegl="libEGL.so.1", libgl="libGL.so.1", glversion=glversion)
        return Context(made, make_current)

    def create_newest(mode: str = "detect") -> Any:
        return create(mode, glversion=410)

    name, made = ("wgl", create) if system == "win32" else ("darwin", create_newest)
    module = types.ModuleType(f"glcontext.{name}")
    module.create_context = made  # type: ignore[attr-defined]
    sys.modules |= {f"glcontext.{name}": module, "glcontext.egl": None, "glcontext.x11": None}  # type: ignore[dict-item]
    import glcontext

    del glcontext.egl
    setattr(glcontext, name, module)


def memory_status(place: Any) -> int:
    """GlobalMemoryStatusEx of Windows."""
    status = place._obj
    assert ctypes.sizeof(status) == 64 and status[0] == 64
    status[1:3] = [4 * FREE, FREE]
    return 1


def sysctl(name: bytes, value: Any, size: Any, new: None, length: Any) -> int:
    """sysctlbyname of macOS."""
    numbers = {b"kern.memorystatus_level": (25, 4), b"hw.memsize": (4 * FREE, 8)}
    value._obj.value, size._obj.value = numbers[name]
    return 0


def import_all() -> list[str]:
    """Imports all modules of splatgl; returns names of those that can be."""
    names = []
    for module in pkgutil.walk_packages([str(Path(__file__).parents[2] / "splatgl")], "splatgl."):
        try:
            importlib.import_module(module.name)
        except ImportError:
            continue
        names.append(module.name)
    return names


def main(system: str, folder: Path) -> None:
    """Imports, reads, draws and writes; prints the doctor's text."""
    before = import_all()
    for name in [name for name in sys.modules if name.partition(".")[0] == "splatgl"]:
        del sys.modules[name]
    handle = become(system)
    after = import_all()
    assert len(before) > 200 and after == before, set(before) ^ set(after)
    print("modules", len(after))

    import numpy as np

    import splatgl as sg
    from splatgl.cli import doctor
    from splatgl.cli.main import main as command
    from splatgl.distributed import workers
    from splatgl.fileio import budget
    from splatgl.gl.context import current
    from splatgl.opengl import OpenGL
    from splatgl.platforms import free_memory, has_display, user_folder
    from splatgl.readers.common import is_mapped
    from splatgl.viewer.adaptive_quality import return_free_memory, return_large_blocks

    assert free_memory() == FREE and budget() == FREE // 2 and has_display()
    return_large_blocks()
    return_free_memory()
    print("folder", user_folder("cache", {"HOME": "/home"}), user_folder("state", {"HOME": "/home"}))

    # a file is read, drawn and not replaced while it is mapped
    volume = sg.load(folder / "v.npy")
    assert is_mapped(volume.samples)
    splats, camera = sg.extract(volume, sg.default_transfer(volume)), sg.Camera.orbit(volume, size=(9, 8))
    right = sg.reference.render(splats, camera).pixels
    assert right.max() > 0.1 and np.array_equal(sg.load(folder / "v.h5").samples, volume.samples)
    mapped.add(os.path.realpath(folder / "v.npy"))
    try:
        sg.Image(right).save(folder / "v.npy")
        print("written")
    except sg.InputError as error:
        print("refused", error)
    sg.Image(right).save(folder / "w.npy")

    # another library's context is current again after each call
    module = sys.modules["glcontext.wgl" if system == "win32" else "glcontext.darwin"]
    host = module.create_context(mode="standalone")
    other = handle()
    assert other
    asked.clear()
    with sg.Renderer() as renderer:
        print("backend", renderer.info.backend, *asked)
        assert handle() == other
        with current(renderer.ctx):
            assert handle() not in (other, None)
        assert np.abs(renderer.render(splats, camera).pixels - right).max() < 1e-3
        assert handle() == other and (renderer.tiles is True) == (system == "win32")
    assert handle() == other
    assert workers.device_of(workers.Drawing(), 1) is None
    assert workers.call(lambda: workers.renderer(workers.Drawing()).info.backend) == ("wgl", "cgl")[system == "darwin"]
    workers.release()
    assert handle() == other
    host.release()
    assert not handle()
    images = doctor._images(tiles=False)
    doctor._images = lambda tiles: {name: images[name] for name in ("default",)}  # type: ignore[assignment]
    print(doctor.report(OpenGL())[0])
    # commands; no window opens, and the reason is one line
    file = str(folder / "v.h5:") + "/v"
    drawing = ["render", file, "-o", str(folder / "c.npy"), "--size", "8", "--quiet"]
    for words in (drawing, ["info", file], ["render", "--help-all"], [file]):
        sys.stdout.flush()
        with suppress(SystemExit):
            print("exit", words[0], command(words))
    try:
        sg.Renderer(device=0)
    except sg.InputError as error:
        print(error)


if __name__ == "__main__":
    main(sys.argv[1], Path(sys.argv[2]))
