"""Times and peak memory of each stage: load, extract, first frame, next frames; and of a whole command.

    .venv/bin/python scripts/benchmarks/stages.py [--data FOLDER] [--rounds N] [--csv FILE]

Real volumes are used if FOLDER (or the environment's SPLATGL_DATA) contains them; a 512³ uint16 file is
generated. Timings are noisy: compare ratios within one run.
"""

from __future__ import annotations

import argparse
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from rows import tell

import splatgl as sg
from splatgl.scene.scene_file import SceneFile

SIZE = (512, 512)
# edge of the generated memory-mapped volume, voxels
LARGE = 512


@dataclass(frozen=True)
class Row:
    """A measured stage: median, minimum and maximum of the rounds, in `unit`."""

    scene: str
    stage: str
    median: float
    low: float
    high: float
    unit: str
    note: str = ""

    def __str__(self) -> str:
        return (
            f"{self.scene:34} {self.stage:16} {self.median:9.3f} {self.unit:3} "
            f"({self.low:.3f} … {self.high:.3f}) {self.note}"
        )


def timed(scene: str, stage: str, rounds: int, work: Callable[[], object], note: str = "") -> Row:
    times = []
    for _ in range(rounds):
        start = time.perf_counter()
        work()
        times.append(time.perf_counter() - start)
    return Row(scene, stage, statistics.median(times), min(times), max(times), "s", note)


def stages(name: str, rounds: int, renderer: sg.Renderer, **transfer: object) -> Iterator[Row]:
    """Load, extract, first and next frames of one scene or file, as `splatgl render` does them."""
    scene = SceneFile(name, transfer=transfer)
    label = Path(name).name
    volume = scene.open()
    yield timed(label, "load", rounds, scene.open, " × ".join(map(str, volume.shape[::-1])))
    chosen = scene.transfer_for(volume)
    splats = sg.extract(volume, chosen)
    yield timed(label, "extract", rounds, lambda: sg.extract(volume, chosen), f"{len(splats):,} splats")
    camera = scene.view.camera(volume, splats)
    yield timed(label, "first frame", 1, lambda: renderer.render(splats, camera), f"{SIZE[0]}×{SIZE[1]}")
    yield timed(label, "next frames", rounds, lambda: renderer.render(splats, camera))
    for blend in ("xray", "mip"):
        settings = sg.Settings(blend=blend)
        renderer.render(splats, camera, settings)
        yield timed(label, f"next, {blend}", rounds, lambda s=settings: renderer.render(splats, camera, s))


def large_extraction() -> Iterator[Row]:
    """Extraction of a memory-mapped 512³ uint16 file in a separate process: time, and memory beyond the splats."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"large_{LARGE}x{LARGE}x{LARGE}_uint16.raw"
        samples = np.memmap(path, np.uint16, "w+", shape=(LARGE, LARGE, LARGE))
        rng = np.random.default_rng(0)
        for z in range(LARGE):
            samples[z] = rng.integers(0, 1000, (LARGE, LARGE), dtype=np.uint16)
        samples.flush()
        del samples
        run = subprocess.run(
            [sys.executable, __file__, "--extract-only", str(path)], capture_output=True, text=True, check=True
        )
        seconds, peak, splats, count = (float(part) for part in run.stdout.split())
        note = f"{int(count):,} splats"
        yield Row(path.name, "extract", seconds, seconds, seconds, "s", note)
        beyond = (peak - splats) / 2**30
        yield Row(path.name, "memory", beyond, beyond, beyond, "GiB", "peak beyond the splats, Python included")


def extract_only(path: str) -> None:
    """Prints seconds, peak resident bytes, the splats' bytes and their number."""
    volume = sg.load(path)
    start = time.perf_counter()
    splats = sg.extract(volume, sg.Transfer([(950, 0), (1000, 0.5)]), classification="pre")
    seconds = time.perf_counter() - start
    held = sum(part.nbytes for part in (splats.records, splats.cell_x, splats.row_z, splats.row_y, splats.row_start))
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
    print(seconds, peak, held, len(splats))


def whole_command(source: str, rounds: int) -> Row:
    """`splatgl render SOURCE` as a process, start to end."""
    with tempfile.TemporaryDirectory() as folder:
        output = str(Path(folder) / "out.png")
        command = [sys.executable, "-m", "splatgl", "render", source, "-o", output, "--quiet"]
        return timed(Path(source).name, "whole command", rounds, lambda: subprocess.run(command, check=True))


def measure(data: Path | None, rounds: int) -> Iterator[Row]:
    with sg.Renderer() as renderer:
        print(renderer.info)
        for name in ("tunnel", "terrain", "nerve"):
            yield from stages(name, rounds, renderer)
        if data is not None:
            male = data / "visible_male_128x256x256_uint8.raw"
            yield from stages(str(male), rounds, renderer, preset="ct-bone")
            yield from stages(str(data / "stent_ct_128x128x256.nrrd"), rounds, renderer)
    yield from large_extraction()
    yield whole_command("tunnel", rounds)
    if data is not None:
        yield whole_command(str(data / "stent_ct_128x128x256.nrrd"), rounds)


def main() -> None:
    parser = argparse.ArgumentParser(
        allow_abbrev=False, description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--data", type=Path, default=os.environ.get("SPLATGL_DATA"), help="folder of real volumes")
    parser.add_argument("--rounds", type=int, default=5, help="times each stage is measured (5)")
    parser.add_argument("--csv", type=Path, help="also write the rows here")
    parser.add_argument("--extract-only", help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.extract_only:
        extract_only(args.extract_only)
        return
    tell(measure(args.data and Path(args.data), args.rounds), args.csv)


if __name__ == "__main__":
    main()
