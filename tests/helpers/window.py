"""A viewer in a real window, under Xvfb, driven by xdotool."""

from __future__ import annotations

import atexit
import ctypes
import ctypes.util
import json
import os
import select
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

MISSING = [tool for tool in ("Xvfb", "xdotool") if shutil.which(tool) is None]

DRIVER, DRAG_SOURCE = (Path(__file__).with_name(name) for name in ("view_driver.py", "drag_source.py"))
SIZE = (240, 180)
# seconds after which something hangs: none of it takes as long on a machine that many share
PATIENCE = 300.0
# xdotool's (X's) names of keys
NAMES = {
    "[": "bracketleft",
    "]": "bracketright",
    ",": "comma",
    ".": "period",
    "?": "question",
    "<": "less",
    ">": "greater",
}
NAMES |= {
    "space": "space",
    "escape": "Escape",
    "home": "Home",
    "tab": "Tab",
    "delete": "Delete",
    "page_up": "Prior",
    "page_down": "Next",
    "left": "Left",
    "right": "Right",
    "up": "Up",
    "down": "Down",
    "f6": "F6",
    "f11": "F11",
    "+": "plus",
    "=": "equal",
    "-": "minus",
    "f1": "F1",
    "f12": "F12",
    "enter": "Return",
    "<": "less",
    ">": "greater",
}

Told = dict[str, Any]


def start_display(screen: str = "640x480") -> tuple[subprocess.Popen[bytes], str]:
    """An X server on a number that is free, and its name."""
    read, write = os.pipe()
    # what clients leave behind stays
    command = ["Xvfb", "-displayfd", str(write), "-screen", "0", f"{screen}x24", "-nolisten", "tcp", "-noreset"]
    server = subprocess.Popen(command, pass_fds=[write], stderr=subprocess.DEVNULL)
    # a failed test ends nothing
    atexit.register(server.kill)
    os.close(write)
    with os.fdopen(read) as pipe:
        number = pipe.readline().strip()
    return server, f":{number}"


def set_dpi(display: str, dpi: int) -> None:
    """What xrdb does with Xft.dpi: GLFW reads its content scale there."""
    name = ctypes.util.find_library("X11")
    assert name
    library = ctypes.CDLL(name)
    library.XOpenDisplay.restype = ctypes.c_void_p
    library.XDefaultRootWindow.restype = ctypes.c_ulong
    server = ctypes.c_void_p(library.XOpenDisplay(display.encode()))
    root, text = ctypes.c_ulong(library.XDefaultRootWindow(server)), f"Xft.dpi:\t{dpi}\n".encode()
    # RESOURCE_MANAGER, of type STRING, in 8 bits, replaced
    library.XChangeProperty(server, root, ctypes.c_ulong(23), ctypes.c_ulong(31), 8, 0, text, len(text))
    library.XCloseDisplay(server)


def shown(environment: dict[str, str], pid: int, title: str = "") -> str:
    """The X server's number of a process's window, once it is there and its title holds those words."""
    search = ["xdotool", "search", "--sync", "--onlyvisible", "--all", "--pid", str(pid), "--name", title]
    found = subprocess.run(search, env=environment, check=True, capture_output=True, text=True, timeout=PATIENCE)
    return found.stdout.split()[-1]


class Window:
    """A viewer in a process of its own, alone on a display of its own, and the hands at it."""

    def __init__(self, source: Path, folder: Path, environment: dict[str, str] | None = None, **options: Any) -> None:
        """options: those of the viewer; dpi: of the display's text, which is twice as large at 192."""
        dpi = options.pop("dpi", 0)
        high = max(480, options.get("size", SIZE)[1])
        self.server, display = start_display("1280x960" if dpi else f"640x{high}")
        if dpi:
            set_dpi(display, dpi)
        self.environment = {**os.environ, "DISPLAY": display}
        asked = json.dumps({"size": SIZE, "backend": "egl", "panel": False} | options)
        command = [sys.executable, str(DRIVER), str(source), str(folder), asked]
        pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
        of_viewer = {**self.environment, **(environment or {})}
        self.process = subprocess.Popen(command, env=of_viewer, text=True, **pipes)  # type: ignore[call-overload]
        atexit.register(self.process.kill)
        self.state = self._read()
        self.folder = folder

    def hands(self, *arguments: object) -> None:
        subprocess.run(
            ["xdotool", *map(str, arguments)],
            env=self.environment,
            check=True,
            capture_output=True,
        )

    def ask(self, what: str, **more: Any) -> Told:
        self.process.stdin.write(json.dumps({"do": what, **more}) + "\n")
        self.process.stdin.flush()
        return self._read()

    def until(self, reached: Callable[[Told], bool]) -> Told:
        """The state once it is as wanted; the last one where it never is."""
        end = time.monotonic() + PATIENCE
        while not reached(told := self.ask("look")) and time.monotonic() < end:
            pass
        return told

    def key(self, key: str) -> Told:
        """Presses a key as the bindings name it; returns the state when all is at rest."""
        *held, name = key.split("+") if key != "+" else [key]
        self.hands("key", "+".join([*held, NAMES.get(name, name)]))
        return self.ask("settle")

    def drag(self, button: int, start: tuple[int, int], stop: tuple[int, int], held: str = "") -> Told:
        steps = [(start[0] + (stop[0] - start[0]) * n // 4, start[1] + (stop[1] - start[1]) * n // 4) for n in range(5)]
        keys = [("keydown", held), ("keyup", held)] if held else [(), ()]
        moves = [part for place in steps[1:] for part in ("mousemove", *place)]
        self.hands("mousemove", *start, *keys[0], "mousedown", button, *moves, "mouseup", button, *keys[1])
        return self.ask("settle")

    @property
    def identity(self) -> str:
        """The X server's number of the window."""
        return shown(self.environment, self.process.pid)

    def drop(self, *paths: Path, is_answered: bool = True) -> Told:
        """Files dragged onto the window; returns the state when all is at rest. is_answered: whether Enter answers the
        question what to do with them, if the window has a panel that asks.
        """
        command = [sys.executable, str(DRAG_SOURCE), self.identity, *map(str, paths)]
        source = subprocess.Popen(command, env=self.environment)
        while source.poll() is None:
            self.ask("look")
        assert source.returncode == 0
        told = self.ask("settle")
        return self.key("enter") if is_answered and told["dialog"] else told

    def shot(self) -> np.ndarray:
        """uint8 [H, W, 3]: what the window holds."""
        self.ask("shot", path=str(self.folder / "shot.npy"))
        return np.load(self.folder / "shot.npy")

    def end(self, notes: int = 0) -> None:
        """Ends it; errors are none, but for so many notes."""
        if self.process.poll() is None:
            self.process.stdin.write('{"do": "end"}\n')
            self.process.stdin.flush()
        _, errors = self.process.communicate(timeout=PATIENCE)
        self.server.terminate()
        self.server.wait(PATIENCE)
        lines = errors.splitlines()
        assert self.process.returncode == 0 and len(lines) == notes, errors
        assert all(line.startswith("splatgl: ") for line in lines), errors

    def _read(self) -> Told:
        ready, _, _ = select.select([self.process.stdout], [], [], PATIENCE)
        line = self.process.stdout.readline() if ready else ""
        if not line:
            self.process.kill()
            self.server.kill()
        assert line, self.process.communicate()[1] or "no answer"
        return json.loads(line)


@contextmanager
def resized(window: Window, width: int, height: int) -> Iterator[None]:
    """The window has another size, in which a float64 reference takes less time."""
    before, identity = window.ask("look")["size"], window.identity
    window.hands("windowsize", "--sync", identity, width, height)
    assert window.ask("settle")["size"] == [width, height]
    yield
    # nothing is compared that would be drawn again
    while window.ask("look")["compare"] != "off":
        window.hands("key", "d")
    window.hands("windowsize", "--sync", identity, *before)
    assert window.ask("settle")["size"] == before


def silent(window: Window) -> None:
    """Nothing is written over the picture."""
    while window.key("i")["hud"] != "off":
        pass
    if window.ask("look")["annotate"]:
        assert not window.key("j")["annotate"]


def pointed(window: Window, *place: int) -> None:
    """The cursor is moved there, which the panel has seen before a button is pressed."""
    window.hands("mousemove", *place)
    for _ in range(3):
        window.ask("look")
