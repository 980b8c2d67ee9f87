"""What a user waits for in the window, from outside: by real keys and drags, and the pixels that X shows.

    .venv/bin/python scripts/benchmarks/latency.py [FILE …] [--size WxH] [--times N] [--busy N,N…]

Needs Xvfb. Each file is opened in a process of its own: seconds until the window is there, until it shows
something, and until its title says "refined"; then milliseconds, median and worst: from a key to changed pixels (of
`p`, which changes the projection, and `]`, which changes opacities), from a click to the list of presets at rest and
while the picture refines, and from a move of a point of the opacity curve to a changed picture; and pictures a second
of a drag along a circle. --busy: one table for each number of processes that are busy meanwhile, such as 0,6.
"""

from __future__ import annotations

import argparse
import ctypes
import ctypes.util
import json
import math
import os
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from splatgl.options import ValueKind

# seconds after which something will not come; pixels along a side of the squares that are watched, in the picture and
# in an open list; seconds of a drag
PATIENCE, SIDE, LISTED, DRAGGED = 120.0, 400, 60, 4.0
# pixels of the panel, and from a list's field to the middle of what is watched of the open list, below tooltips; of a
# move of a point
PANEL, BELOW, MOVED = 330, 150, 12
# seconds after a key in which the picture is being refined
REFINING = 0.1
ESCAPE = 0xFF1B
# opens the window of `splatgl view`, and prints where its widgets are
SERVE = "--window"
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
        # of the picture
        self.middle = (screen[0] - PANEL) // 2, screen[1] // 2

    def key(self, letter: str | int) -> None:
        """Presses a key, a letter or the number of a symbol, and lets it go."""
        symbol = ord(letter) if isinstance(letter, str) else letter
        code = X.XKeysymToKeycode(self.display, ctypes.c_ulong(symbol))
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

    def seen(self, middle: tuple[float, float] | None = None, side: int = SIDE) -> bytes:
        """The pixels of a square, by default that in the middle of the picture."""
        left, top = (round(place) - side // 2 for place in middle or self.middle)
        sides = ctypes.c_uint(side), ctypes.c_uint(side)
        image = X.XGetImage(self.display, self.root, left, top, *sides, ctypes.c_ulong(ALL_PLANES), PIXMAP)
        data = ctypes.c_void_p.from_address(image + DATA).value or 0
        pixels = ctypes.string_at(data, side * ctypes.c_int.from_address(image + PITCH).value)
        X.XFree(ctypes.c_void_p(data))
        X.XFree(ctypes.c_void_p(image))
        return pixels

    def titles(self) -> list[str]:
        """What the titles of all windows say."""
        some, count = (ctypes.c_ulong * 2)(), ctypes.c_uint()
        windows = ctypes.POINTER(ctypes.c_ulong)()
        X.XQueryTree(self.display, self.root, some, some, ctypes.byref(windows), ctypes.byref(count))
        titles = []
        for window in windows[: count.value]:
            title = ctypes.c_char_p()
            X.XFetchName(self.display, ctypes.c_ulong(window), ctypes.byref(title))
            titles.append((title.value or b"").decode(errors="replace"))
        if count.value:
            X.XFree(windows)
        return titles

    def has_title(self, word: str) -> bool:
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


def measure(hands: Hands, file: str, size: tuple[int, int], times: int) -> str:
    """A row of the table."""
    environment = {**os.environ, "DISPLAY": hands.name, "SPLATGL_RECENT": "off"}
    view = [sys.executable, __file__, SERVE, file, "--size", f"{size[0]}x{size[1]}"]
    hands.move(*hands.middle)
    black = hands.seen()
    begun = time.perf_counter()
    process = subprocess.Popen(view, env=environment, stdout=subprocess.PIPE)
    try:
        opened = []
        shown = (
            (lambda: hands.has_title("splatgl")),
            (lambda: shows(hands, black)),
            (lambda: hands.has_title("refined")),
        )
        for is_shown in shown:
            until(is_shown)
            opened.append(time.perf_counter() - begun)
        parts = [" ".join(f"{seconds:5.2f}" for seconds in opened) + " s"]
        if times:
            assert process.stdout is not None
            # the latest are those of the file, which is read behind an empty window
            lines = os.read(process.stdout.fileno(), 1 << 16).splitlines()
            parts += waits(hands, times, json.loads(lines[-1]))
        return " | ".join(parts)
    finally:
        process.terminate()
        process.wait(PATIENCE)


def serve(arguments: list[str]) -> None:
    """Runs `splatgl view`; prints where the panel has its list of presets and a point of the curve."""
    from imgui_bundle import imgui

    from splatgl.cli.main import main as run_command
    from splatgl.viewer import panel
    from splatgl.viewer.preset_gallery import PresetGallery
    from splatgl.viewer.transfer_editor import ROOM, CurveEditor, axis_from_opacity

    places: dict[str, tuple[float, float]] = {}
    draw_list, draw_curve = PresetGallery.draw, CurveEditor.draw

    def note_list(gallery: PresetGallery, *arguments: Any) -> Any:
        drawn = draw_list(gallery, *arguments)
        low, high = imgui.get_item_rect_min(), imgui.get_item_rect_max()
        places["list"] = (low.x + high.x) / 2, (low.y + high.y) / 2
        return drawn

    def note_curve(curve: CurveEditor, transfer: Any, *arguments: Any) -> Any:
        drawn, before = draw_curve(curve, transfer, *arguments), dict(places)
        (left, top, width, height), (low, up) = curve.box, curve.range
        # one that the axis shows, as high as any
        value, opacity = max(
            (point for point in transfer.points if low <= point[0] <= up),
            key=lambda point: point[1],
            default=(low, 0.0),
        )
        share = (float(axis_from_opacity(opacity)) - ROOM[0]) / (ROOM[1] - ROOM[0])
        places["node"] = left + width * (value - low) / (up - low), top + height * (1 - share)
        if width > 1 and places != before:
            print(json.dumps(places), flush=True)
        return drawn

    # methods are replaced for this process alone
    vars(panel)["PresetGallery"].draw, vars(panel)["CurveEditor"].draw = note_list, note_curve
    sys.exit(run_command(["view", *arguments]))


def shows(hands: Hands, black: bytes) -> bool:
    """Whether the window shows something: until then it is of one colour."""
    now = hands.seen()
    return now != black and len(set(now[::16])) > 4


def waits(hands: Hands, times: int, places: dict[str, tuple[float, float]]) -> list[str]:
    """What keys, clicks and drags take. places: of the panel's list of presets and a point of its curve."""
    seconds = {name: [press(hands, letters[number % 2]) for number in range(times)] for name, letters in KEYS.items()}
    seconds["list"] = [click(hands, places["list"]) for _ in range(times)]
    seconds["list, refining"] = [click(hands, places["list"], "p") for _ in range(times)]
    seconds["node"] = move_point(hands, places["node"], times)
    texts = [
        f"{name} {statistics.median(values) * 1e3:4.0f} {max(values) * 1e3:5.0f} ms" for name, values in seconds.items()
    ]
    return [*texts, f"drag {dragged(hands):5.1f}/s"]


def refine(hands: Hands) -> None:
    """Waits for the refined picture."""
    # the first new picture, and what it becomes
    time.sleep(0.1)
    until(lambda: hands.has_title("refined"))
    time.sleep(0.2)


def press(hands: Hands, letter: str) -> float:
    """Seconds from a key to a changed picture."""
    before = hands.seen()
    hands.key(letter)
    waited = until(lambda: hands.seen() != before)
    refine(hands)
    return waited


def click(hands: Hands, place: tuple[float, float], letter: str = "") -> float:
    """Seconds from a click to an open list. letter: a key that has just changed the picture, which is being refined."""
    beside = place[0], place[1] + BELOW
    hands.move(*place)
    refine(hands)
    before = hands.seen(beside, LISTED)
    if letter:
        hands.key(letter)
        time.sleep(REFINING)
    begun = time.perf_counter()
    hands.button(True)
    hands.button(False)
    until(lambda: hands.seen(beside, LISTED) != before)
    waited = time.perf_counter() - begun
    hands.key(ESCAPE)
    until(lambda: hands.seen(beside, LISTED) == before)
    refine(hands)
    return waited


def move_point(hands: Hands, place: tuple[float, float], times: int) -> list[float]:
    """Seconds from moves of a point of the curve, up and down, to changed pictures."""
    hands.move(*place)
    refine(hands)
    hands.button(True)
    waited = []
    for number in range(times):
        before = hands.seen()
        hands.move(place[0], place[1] + MOVED * (1 + number % 2))
        waited.append(until(lambda before=before: hands.seen() != before))  # type: ignore[misc]
        refine(hands)
    hands.move(*place)
    hands.button(False)
    refine(hands)
    return waited


def dragged(hands: Hands) -> float:
    """Pictures a second while the mouse goes round."""
    x, y = hands.middle
    # away from the panel, whose points could be dragged
    hands.move(x, y)
    refine(hands)
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


@contextmanager
def busy(count: int) -> Iterator[None]:
    """So many processes are busy."""
    processes = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(count)]
    try:
        yield
    finally:
        for process in processes:
            process.terminate()
            process.wait(PATIENCE)


def main() -> None:
    """Prints the tables."""
    parser = argparse.ArgumentParser(
        allow_abbrev=False, description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("files", nargs="*", default=["nerve", "terrain", "tunnel"])
    parser.add_argument("--size", type=ValueKind.picture_size().parse, default=(1024, 768))
    parser.add_argument("--times", type=int, default=20, help="of each key, click and move; 0: opens only (20)")
    parser.add_argument("--busy", type=lambda text: [int(part) for part in text.split(",")], default=[0], metavar="N,N")
    args = parser.parse_args()
    for count in args.busy:
        print(f"{count} busy processes: window, first, refined | from a key, a click, a move: median, worst | drag")
        for file in args.files:
            hands = Hands(args.size)
            try:
                with busy(count):
                    print(f"{Path(file).name}: {measure(hands, file, args.size, args.times)}", flush=True)
            finally:
                hands.end()


if __name__ == "__main__":
    serve(sys.argv[2:]) if sys.argv[1:2] == [SERVE] else main()
