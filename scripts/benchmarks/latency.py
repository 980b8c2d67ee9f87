"""What a user waits for in the window, from outside: by real keys and drags, and the pixels that X shows.

    .venv/bin/python scripts/benchmarks/latency.py [FILE …] [--size WxH] [--times N]

Needs Xvfb. Each file is opened in a process of its own: seconds until the window is there, until it shows
something, and until its title says "refined"; then milliseconds from a key to changed pixels (of `p`, which changes the
projection, and `]`, which changes opacities), median and worst; and pictures a second of a drag along a circle.
"""

from __future__ import annotations

import argparse
import ctypes
import ctypes.util
import math
import os
import statistics
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

from splatgl.options import Kind

# seconds after which something will not come; pixels along a side of the square that is watched; of a drag
PATIENCE, SIDE, DRAGGED = 120.0, 400, 4.0
# keys that are pressed in turn: each changes the picture again, where more and more opacity would end to
KEYS = {"p": "pp", "]": "]["}
PIXMAP, ALL_PLANES, DATA, PITCH = 2, 0xFFFFFFFF, 16, 44


def library(name: str) -> ctypes.CDLL:
    """One of X's libraries."""
    return ctypes.CDLL(ctypes.util.find_library(name) or f"lib{name}.so.6")


X, TEST = library("X11"), library("Xtst")
X.XOpenDisplay.restype = X.XGetImage.restype = ctypes.c_void_p
X.XDefaultRootWindow.restype = ctypes.c_ulong


class Hands:
    """A display of its own, with keys, a mouse and eyes."""

    def __init__(self, screen: tuple[int, int]) -> None:
        read, write = os.pipe()
        command = ["Xvfb", "-displayfd", str(write), "-screen", "0", f"{screen[0]}x{screen[1]}x24", "-nolisten", "tcp"]
        self.server = subprocess.Popen(command, pass_fds=[write], stderr=subprocess.DEVNULL)
        os.close(write)
        with os.fdopen(read) as pipe:
            self.name = f":{pipe.readline().strip()}"
        self.display = ctypes.c_void_p(X.XOpenDisplay(self.name.encode()))
        self.root = ctypes.c_ulong(X.XDefaultRootWindow(self.display))
        self.middle = screen[0] // 2, screen[1] // 2

    def key(self, letter: str) -> None:
        """Presses a key and lets it go."""
        code = X.XKeysymToKeycode(self.display, ctypes.c_ulong(ord(letter)))
        for down in (1, 0):
            TEST.XTestFakeKeyEvent(self.display, code, down, ctypes.c_ulong(0))
        X.XFlush(self.display)

    def button(self, down: bool) -> None:
        """Presses or lets go the left button."""
        TEST.XTestFakeButtonEvent(self.display, 1, int(down), ctypes.c_ulong(0))
        X.XFlush(self.display)

    def move(self, x: float, y: float) -> None:
        """Moves the cursor."""
        TEST.XTestFakeMotionEvent(self.display, -1, round(x), round(y), ctypes.c_ulong(0))
        X.XFlush(self.display)

    def seen(self) -> bytes:
        """The pixels of the square in the middle."""
        left, top = (each - SIDE // 2 for each in self.middle)
        side = ctypes.c_uint(SIDE)
        found = X.XGetImage(self.display, self.root, left, top, side, side, ctypes.c_ulong(ALL_PLANES), PIXMAP)
        data = ctypes.c_void_p.from_address(found + DATA).value or 0
        pixels = ctypes.string_at(data, SIDE * ctypes.c_int.from_address(found + PITCH).value)
        X.XFree(ctypes.c_void_p(data))
        X.XFree(ctypes.c_void_p(found))
        return pixels

    def titles(self) -> list[str]:
        """What the titles of all windows say."""
        some, count = (ctypes.c_ulong * 2)(), ctypes.c_uint()
        windows = ctypes.POINTER(ctypes.c_ulong)()
        X.XQueryTree(self.display, self.root, some, some, ctypes.byref(windows), ctypes.byref(count))
        said = []
        for window in windows[: count.value]:
            found = ctypes.c_char_p()
            X.XFetchName(self.display, ctypes.c_ulong(window), ctypes.byref(found))
            said.append((found.value or b"").decode(errors="replace"))
        if count.value:
            X.XFree(windows)
        return said

    def told(self, word: str) -> bool:
        """Whether a title holds a word."""
        return any(word in title for title in self.titles())

    def end(self) -> None:
        """Ends the display."""
        X.XCloseDisplay(self.display)
        self.server.terminate()
        self.server.wait(PATIENCE)


def until(reached: Callable[[], bool]) -> float:
    """Seconds until it is so."""
    begun = time.perf_counter()
    while not reached():
        if time.perf_counter() - begun > PATIENCE:
            raise TimeoutError
        time.sleep(0.001)
    return time.perf_counter() - begun


def told(hands: Hands, file: str, wide: tuple[int, int], times: int) -> str:
    """A row of the table."""
    environment = {**os.environ, "DISPLAY": hands.name, "SPLATGL_RECENT": "off"}
    view = [sys.executable, "-m", "splatgl", "view", file, "--size", f"{wide[0]}x{wide[1]}"]
    hands.move(*hands.middle)
    black = hands.seen()
    begun = time.perf_counter()
    process = subprocess.Popen(view, env=environment)
    try:
        opened = []
        for reached in (lambda: hands.told("splatgl"), lambda: shows(hands, black), lambda: hands.told("refined")):
            until(reached)
            opened.append(time.perf_counter() - begun)
        return " | ".join([" ".join(f"{each:5.2f}" for each in opened) + " s", *(waits(hands, times) if times else ())])
    finally:
        process.terminate()
        process.wait(PATIENCE)


def shows(hands: Hands, black: bytes) -> bool:
    """Whether the window shows something: until then it is of one colour."""
    now = hands.seen()
    return now != black and len(set(now[::16])) > 4


def waits(hands: Hands, times: int) -> list[str]:
    """What keys and a drag take."""

    def refined() -> bool:
        return hands.told("refined")

    parts = []
    for name, letters in KEYS.items():
        found = []
        for number in range(times):
            time.sleep(0.2)
            before = hands.seen()
            hands.key(letters[number % 2])
            found.append(until(lambda before=before: hands.seen() != before))  # type: ignore[misc]
            # the first new picture, and what it becomes
            time.sleep(0.1)
            until(refined)
        parts.append(f"{name} {statistics.median(found) * 1e3:4.0f} {max(found) * 1e3:5.0f} ms")
    return [*parts, f"drag {dragged(hands):5.1f}/s"]


def dragged(hands: Hands) -> float:
    """Pictures a second while the mouse goes round."""
    x, y = hands.middle
    hands.button(True)
    begun, last, pictures = time.perf_counter(), hands.seen(), 0
    while (gone := time.perf_counter() - begun) < DRAGGED:
        hands.move(x + 150 * math.sin(3 * gone), y + 150 * math.cos(3 * gone))
        time.sleep(0.004)
        now = hands.seen()
        # the first second finds the level
        pictures += now != last and gone > 1.0
        last = now
    hands.button(False)
    return pictures / (DRAGGED - 1.0)


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("files", nargs="*", default=["nerve", "terrain", "tunnel"])
    parser.add_argument("--size", type=Kind.picture_size().parse, default=(1024, 768))
    parser.add_argument("--times", type=int, default=20, help="presses of each key; 0: opens only (20)")
    args = parser.parse_args()
    print("window, first, refined | key to pixels: median, worst | drag")
    for file in args.files:
        hands = Hands(args.size)
        try:
            print(f"{Path(file).name}: {told(hands, file, args.size, args.times)}", flush=True)
        finally:
            hands.end()


if __name__ == "__main__":
    main()
