"""The window's table of the guide: whole frames of drags, edits and openings, with panel and text on.

    xvfb-run -s "-screen 0 1280x1024x24" .venv/bin/python scripts/benchmarks/window.py [FILE …]
        [--size WxH] [--seconds S]

A drag moves the cursor along a circle, as fast as frames come. A frame is all between one event and the next: the
picture, the text, the panel and the swap of buffers. "edit": an opacity node is dragged. Compare ratios.
"""

from __future__ import annotations

import argparse
import math
import statistics
import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from splatgl.gl.renderer import Renderer
from splatgl.options import ValueKind
from splatgl.scene.scene_file import SceneFile
from splatgl.transfer.transfer import Transfer
from splatgl.viewer.document import Document
from splatgl.viewer.trackball import Pointer
from splatgl.viewer.viewer import Options, Viewer

# longest wait for a picture at rest
PATIENCE = 120.0


@dataclass(frozen=True)
class Moving:
    """Frames of one motion: seconds of each, and what the worst and the most frequent gave up."""

    seconds: tuple[float, ...]
    levels: Counter[str]
    rest: float

    def told(self) -> str:
        """One row of the table."""
        rate, worst = len(self.seconds) / sum(self.seconds), max(self.seconds)
        level = self.levels.most_common(1)[0][0]
        return f"{rate:5.1f}/s, worst {worst * 1e3:4.0f} ms | {level} | at rest after {self.rest:.2f} s"


def settled(viewer: Viewer) -> bool:
    """Whether the picture at rest is shown and nothing is being worked on."""
    frame = viewer.painter.frame
    return frame is not None and frame.full and not viewer.dirty and not viewer.busy


def rest(viewer: Viewer) -> float:
    """Seconds until the picture is in full."""
    begun = time.perf_counter()
    viewer.step(0.0)
    while not settled(viewer) and time.perf_counter() - begun < PATIENCE:
        viewer.step()
    return time.perf_counter() - begun


def moved(viewer: Viewer, steps: Iterator[Callable[[], None]], seconds: float) -> Moving:
    """Does one step a frame for some seconds, then waits for the picture at rest."""
    times, levels, begun = [], Counter[str](), time.perf_counter()
    while time.perf_counter() - begun < seconds:
        before = time.perf_counter()
        next(steps)()
        viewer.step(0.0)
        times.append(time.perf_counter() - before)
        frame = viewer.painter.frame
        levels[str(frame.level) if frame else "nothing"] += 1
    viewer.mouse("release", Pointer(viewer.input.cursor, "left"))
    # the first frame of a motion uploads what the others use
    return Moving(tuple(times[1:]), levels, rest(viewer))


def drags(viewer: Viewer) -> Iterator[Callable[[], None]]:
    """Cursor positions of a drag along a circle."""
    width, height = viewer.state.pose.camera.size
    viewer.mouse("press", Pointer((width / 2, height / 2), "left"))
    turn = 0.0
    while True:
        turn += 0.1
        place = width / 2 + height / 4 * math.sin(turn), height / 2 + height / 4 * math.cos(turn)
        yield lambda place=place: (viewer.raw("cursor", *place), viewer.mouse("move", Pointer(place)))  # type: ignore[misc]


def edits(viewer: Viewer) -> Iterator[Callable[[], None]]:
    """Positions of the curve's second node, to and fro, towards more matter."""
    base = viewer.state.style.base
    low, high = base.points[0][0], base.points[-1][0]
    turn = 0.0
    while True:
        turn += 0.3
        place = (low + (high - low) * (0.25 + 0.2 * math.sin(turn)), 0.1)
        yield lambda node=place: changed(viewer, with_node(base, node))  # type: ignore[misc]


def with_node(base: Transfer, node: tuple[float, float]) -> Transfer:
    """The transfer function with one more node."""
    return replace(base, points=tuple(sorted({*base.points, node})))


def changed(viewer: Viewer, base: Transfer) -> None:
    """As the panel does."""
    viewer.state = viewer.state.edit(base=base)
    viewer.touch()


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(
        allow_abbrev=False, description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("files", nargs="*", default=["nerve", "terrain", "tunnel"])
    parser.add_argument("--size", type=ValueKind.picture_size().parse, default=(1024, 768))
    parser.add_argument("--seconds", type=float, default=4.0)
    args = parser.parse_args()
    for file in args.files:
        begun = time.perf_counter()
        with Renderer("window") as renderer:
            document = Document.open(SceneFile.from_toml(Path(file)) if file.endswith(".toml") else SceneFile(file))
            viewer = Viewer(document, renderer, Options(size=args.size))
            while viewer.painter.frame is None:
                viewer.step(0.0)
            first = time.perf_counter() - begun
            rest(viewer)
            print(
                f"{document.volume.name}: {document.counts[0]:,} splats, first {first:.2f} s, "
                f"refined {time.perf_counter() - begun:.2f} s",
                flush=True,
            )
            print("   drag", moved(viewer, drags(viewer), args.seconds).told(), flush=True)
            print("   edit", moved(viewer, edits(viewer), args.seconds).told(), flush=True)
            times = []
            for _ in range(20):
                before = time.perf_counter()
                viewer.raw("cursor", 200.0, 200.0)
                viewer.mouse("move", Pointer((200.0, 200.0)))
                viewer.step(0.0)
                times.append(time.perf_counter() - before)
            print(f"   hover {statistics.median(times) * 1e3:.1f} ms", flush=True)
            viewer.close()


if __name__ == "__main__":
    main()
