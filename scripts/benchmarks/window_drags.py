"""Pictures a second of a drag in the window, at all pixels and all voxels, and what a frame spends outside the drawing.

    xvfb-run -s "-screen 0 1280x1024x24" .venv/bin/python scripts/benchmarks/window_drags.py [FILE …]
        [--size WxH] [--moves N] [--profile N]

FILE is a volume or a scene.toml. The panel is shown. All pixels and voxels are drawn, as at rest and then to the
tolerance of motion; a drag moves the cursor N times along a circle, a frame a move. "outside" is the frame without the
renderer's picture: panel, text and swap of buffers. CPU: processor seconds of all threads, which hardly depend on
load. --profile prints the N functions that take most of the drag's time.
"""

from __future__ import annotations

import argparse
import cProfile
import pstats
import statistics
import time
from dataclasses import replace
from math import inf
from pathlib import Path

from window import drags, rest

from splatgl.gl.renderer import Renderer
from splatgl.options import ValueKind
from splatgl.scene.scene_file import SceneFile
from splatgl.viewer.adaptive_quality import LADDER
from splatgl.viewer.document import Document
from splatgl.viewer.trackball import Pointer
from splatgl.viewer.viewer import Options, Viewer


def dragged(viewer: Viewer, level: int, moves: int, profile: int) -> str:
    """A row of the table: of the frames of a drag of so many moves, at a level of the ladder."""
    # any time is short enough, and no finer level is tried
    refiner = viewer.refiner
    refiner.pace, refiner.full = replace(refiner.pace, level=level, target=inf, wait=moves + 2), False
    steps = drags(viewer)
    walls, cpus, drawn, profiler = [], [], [], cProfile.Profile()
    # the first frame uploads what the others use
    for number in range(moves + 1):
        before, cpu = time.perf_counter(), time.process_time()
        next(steps)()
        # a move is new however busy the machine is
        viewer.touched = inf
        if profile and number:
            profiler.enable()
        viewer.step(0.0)
        profiler.disable()
        walls.append(time.perf_counter() - before)
        cpus.append(time.process_time() - cpu)
        frame = viewer.painter.frame
        if frame is None or frame.level != LADDER[level]:
            raise RuntimeError(f"level: expected {LADDER[level]}, got {frame and frame.level}")
        drawn.append(frame.seconds)
    viewer.mouse("release", Pointer(viewer.input.cursor, "left"))
    if profile:
        pstats.Stats(profiler).sort_stats("tottime").print_stats(profile)
    walls, cpus, drawn = walls[1:], cpus[1:], drawn[1:]
    outside = statistics.median(wall - picture for wall, picture in zip(walls, drawn, strict=True))
    return (
        f"{len(walls) / sum(walls):5.1f}/s, median {statistics.median(walls) * 1e3:4.0f} ms, worst "
        f"{max(walls) * 1e3:4.0f} ms, outside {outside * 1e3:4.1f} ms | CPU {statistics.median(cpus) * 1e3:4.0f} ms"
    )


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(
        allow_abbrev=False, description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("files", nargs="*", default=["nerve", "terrain", "tunnel"])
    parser.add_argument("--size", type=ValueKind.picture_size().parse, default=(1024, 768))
    parser.add_argument("--moves", type=int, default=40)
    parser.add_argument("--profile", type=int, default=0, metavar="N")
    args = parser.parse_args()
    for file in args.files:
        with Renderer("window") as renderer:
            document = Document.open(SceneFile.from_toml(Path(file)) if file.endswith(".toml") else SceneFile(file))
            viewer = Viewer(document, renderer, Options(size=args.size))
            rest(viewer)
            print(f"{document.volume.name}: {document.counts[0]:,} splats", flush=True)
            for level in (0, 1):
                print(f"   drag, {LADDER[level]}:", dragged(viewer, level, args.moves, args.profile), flush=True)
                rest(viewer)
            viewer.close()


if __name__ == "__main__":
    main()
