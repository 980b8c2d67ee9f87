"""How long napari's window stands still while its panel draws a file, and when pictures appear.

    xvfb-run -a -s "-screen 0 1600x1200x24" .venv/bin/python scripts/benchmarks/napari_panel.py FILE [--canvas WxH]

A timer of 10 ms ticks in the window's thread: the longest time between two ticks is how long it stood still. Printed
are the longest and the 99th percentile, of 2 s in which nothing is drawn, of each picture until it is done, and of the
picture with its copying to the clipboard; seconds until the first preview and the picture; and the load.
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Callable
from itertools import pairwise
from typing import Any

import numpy as np

from splatgl.options import Kind

# milliseconds between ticks; seconds after which a picture will not come, and of the time in which nothing is drawn
TICK, PATIENCE, IDLE = 10, 120.0, 2.0


class Ticks:
    """Times of the ticks of a timer in the window's thread."""

    def __init__(self) -> None:
        from qtpy.QtCore import Qt, QTimer

        self.times: list[float] = []
        self.timer = QTimer()
        self.timer.setTimerType(Qt.TimerType.PreciseTimer)
        self.timer.timeout.connect(lambda: self.times.append(time.perf_counter()))
        self.timer.start(TICK)

    def run(self, until: Callable[[], bool], begin: Callable[[], Any] | None = None) -> str:
        """Runs the window's loop until a condition holds; milliseconds between ticks. begin: called in the loop."""
        from qtpy.QtCore import QEventLoop, QTimer

        loop, end, done = QEventLoop(), time.monotonic() + PATIENCE, QTimer()
        done.timeout.connect(lambda: loop.quit() if until() or time.monotonic() > end else None)
        self.times = [time.perf_counter()]
        if begin is not None:
            QTimer.singleShot(0, begin)
        done.start(TICK)
        loop.exec_() if hasattr(loop, "exec_") else loop.exec()
        gaps = 1e3 * np.array([b - a for a, b in pairwise(self.times)])
        return f"longest {gaps.max():6.1f} ms, 99 % {np.percentile(gaps, 99):5.1f} ms, {len(gaps)} ticks"


def main() -> None:
    """Prints the times of a file."""
    parser = argparse.ArgumentParser(
        allow_abbrev=False, description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("file")
    parser.add_argument("--canvas", default="666x800", help="size of napari's canvas in pixels")
    arguments = parser.parse_args()
    wide, high = Kind.picture_size().check(arguments.canvas)

    import napari

    import splatgl as sg
    from splatgl.integrations.napari.widget import Panel

    viewer = napari.Viewer(show=True)
    volume = sg.load(arguments.file)
    viewer.add_image(np.asarray(volume.samples), scale=volume.spacing[::-1], rendering="mip")
    viewer.dims.ndisplay = 3
    panel = Panel(viewer)
    ticks, shown = Ticks(), dict[str, float]()

    def wait(seconds: float) -> Callable[[], bool]:
        end = time.monotonic() + seconds
        return lambda: time.monotonic() > end

    def note(answer: Any) -> None:
        shown.setdefault(answer.state, time.perf_counter() - started)

    panel.answered.connect(note)
    panel.sizes.setCurrentText(f"{wide}x{high}")
    ticks.run(wait(5.0))
    print(f"load {os.getloadavg()[0]:.1f}; {volume.name}, {wide}×{high}")
    print(f"{'nothing is drawn':28}", ticks.run(wait(IDLE)))
    for name, blend in (("first picture", "as shown"), ("again", "as shown"), ("composite", "composite")):
        shown.clear()
        panel.blends.setCurrentText(blend)
        started = time.perf_counter()
        gaps = ticks.run(lambda: "done" in shown or "error" in shown, panel.draw)
        times = ", ".join(f"{state} {seconds:.2f} s" for state, seconds in shown.items())
        print(f"{name:28} {gaps}; {times}")
        print(f"{'  copied':28}", ticks.run(wait(0.2), panel.copy))
    panel.follow.setChecked(True)
    shown.clear()
    started = time.perf_counter()
    turn = iter(range(10**6))

    def step() -> bool:
        camera = getattr(viewer, "scene", viewer).camera
        number = next(turn)
        if number % 10 == 0 and number < 200:
            camera.angles = (0.0, number / 2.0, 90.0)
        return number >= 200 and panel.state == "done"

    print(f"{'followed, with its redraws':28}", ticks.run(step), ", ".join(f"{k} {v:.2f} s" for k, v in shown.items()))
    panel.follow.setChecked(False)
    turn = iter(range(10**6))
    print(f"{'turned, nothing is drawn':28}", ticks.run(lambda: step() or next(turn) > 200))
    panel.worker.close()
    os._exit(0)


if __name__ == "__main__":
    main()
