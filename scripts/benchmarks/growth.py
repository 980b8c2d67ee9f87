"""How a frame's time grows with voxels and with pixels, beside VTK's casters: a table, and a figure of both axes.

    .venv/bin/python scripts/benchmarks/growth.py [--sides 64 128 256 512] [--sizes 128 256 512 1024] [--rounds 3]
                                                  [--kinds solid surface sparse] [--csv FILE] [--figure FILE.png]

Volumes of three kinds: a solid ball, which fills half of the box; the ball's surface, a few voxels thick; and twelve
wound threads of 3 voxels. Times against voxels are of 512² pixels, those against pixels of 256³ voxels: wall clock
around a finished frame, its pixels read back, medians, variants interleaved in random order, without extraction. VTK
(extra `vtk`) casts rays at half-voxel steps; its mapper for graphics cards draws by the same OpenGL driver.
"""

from __future__ import annotations

import argparse
import random
import statistics
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from frames import Frame, timed
from rows import tell
from vtk_peers import Peer

import splatgl as sg
from splatgl.planning.resolve import extract_for_settings
from splatgl.report.diagram import BLACK, BLUE, GRAY, RED, encode, sheet, style
from splatgl.scene.view import ViewOptions

# voxels a side against pixels, pixels a side against voxels
SIDE, SIZE = 256, 512
RAMP = [(0.4, 0.0), (0.6, 0.9)]
OPACITIES = {"solid": RAMP, "surface": [(0.3, 0.0), (0.5, 0.3), (0.7, 0.0)], "sparse": RAMP}
# of threads: number, windings, share of the box that they wind through, voxels² of their profile's variance
THREADS, WINDINGS, WOUND, VARIANCE = 12, 1.5, 0.42, 1.7
LINES = {"default": (BLACK, "-"), "one sample": (BLUE, "--"), "VTK OpenGL": (RED, "-."), "VTK CPU": (GRAY, ":")}


@dataclass(frozen=True)
class Row:
    kind: str
    side: int
    size: int
    way: str
    splats: int
    seconds: float

    def __str__(self) -> str:
        place = f"{self.kind:8} {self.side:4}³ voxels {self.size:5}² pixels"
        return f"{place} {self.way:10} {self.splats:10,} splats {self.seconds * 1e3:9.1f} ms"


def volume_of(kind: str, side: int) -> sg.Volume:
    """A cube of `side` voxels, values 0 to 1 in bytes."""
    samples = np.zeros((side,) * 3, np.uint8)
    middle = (side - 1) / 2
    if kind != "sparse":
        across = np.arange(side) - middle
        square = across[:, None] ** 2 + across**2
        radius = side * (3 / (8 * np.pi)) ** (1 / 3)
        for z, height in enumerate(across):
            # from 1 to 0 within 6 voxels
            samples[z] = 255 * np.clip((radius - np.sqrt(square + height**2)) / 6 + 0.5, 0, 1)
        return sg.Volume(samples)
    thread, z = np.mgrid[:THREADS, :side]
    turn = 2 * np.pi * (thread / THREADS + WINDINGS * z / side * np.where(thread % 2, 1, -1))
    x, y = (middle + WOUND * side * (0.4 + 0.6 * thread / THREADS) * wave(turn) for wave in (np.cos, np.sin))
    for dy, dx in np.ndindex(7, 7):
        column, row = np.rint(x).astype(int) + dx - 3, np.rint(y).astype(int) + dy - 3
        value = 255 * np.exp(-((column - x) ** 2 + (row - y) ** 2) / (2 * VARIANCE))
        np.maximum.at(samples, (z, row, column), value.astype(np.uint8))
    return sg.Volume(samples)


def measure(renderer: sg.Renderer, kind: str, side: int, sizes: Sequence[int], rounds: int) -> Iterator[Row]:
    """The medians of all ways to draw one volume, by size of the picture."""
    volume, own, one = volume_of(kind, side), sg.Settings(), sg.Settings(antialias="supersample", samples=1)
    transfer = sg.Transfer([(255 * value, opacity) for value, opacity in OPACITIES[kind]])
    splats = extract_for_settings(volume, transfer, own)
    for size in sizes:
        camera = ViewOptions(size=(size, size)).camera(volume, splats)
        draw = partial(renderer.render, splats, camera, verify_bound=False)
        todo: dict[str, Frame] = {"default": partial(draw, own), "one sample": partial(draw, one)}
        with ExitStack() as peers:
            for name, mapper in (("VTK OpenGL", "gpu"), ("VTK CPU", "cpu")) if find_spec("vtk") else ():
                todo[name] = peers.enter_context(closing(Peer(mapper, (volume, transfer), camera, own)))
            for frame in todo.values():
                timed(frame)
            turns = [*todo] * rounds
            random.Random(1).shuffle(turns)
            times: dict[str, list[float]] = {name: [] for name in todo}
            for name in turns:
                times[name].append(timed(todo[name])[1])
        for name, found in times.items():
            yield Row(kind, side, size, name, len(splats), statistics.median(found))


def figure(rows: Sequence[Row], side: int, size: int, renderer: str) -> bytes:
    """The bytes of a PNG: a panel for each kind of volume, above against voxels, below against pixels."""
    kinds = list(dict.fromkeys(row.kind for row in rows))
    with style():
        drawn = sheet(4.4, 2.3 * len(kinds))
        plots = drawn.subplots(2, len(kinds), sharey=True, squeeze=False)
        for (line, column), plot in np.ndenumerate(plots):
            held, axis, power = (("size", "side", "³"), ("side", "size", "²"))[line]
            those = [row for row in rows if row.kind == kinds[column] and getattr(row, held) == (size, side)[line]]
            for name, (color, dashes) in LINES.items():
                points = sorted((getattr(row, axis), row.seconds) for row in those if row.way == name)
                if points:
                    plot.plot(*zip(*points, strict=True), "o", ls=dashes, color=color, ms=2.5, label=name)
            plot.set(xscale="log", yscale="log")
            plot.set_xlabel((f"voxels, at {size}² pixels", f"pixels, of {side}³ voxels")[line])
            ticks = sorted({getattr(row, axis) for row in those})
            plot.set_xticks(ticks, [f"{tick}{power}" for tick in ticks], minor=False)
            plot.set_xticks([], minor=True)
            plot.yaxis.set_major_formatter("{x:g}")
            plot.grid(True, which="major", color="#e4e4e4", linewidth=0.5, zorder=0)
            plot.set_title("" if line else kinds[column])
            plot.set_ylabel("" if column else "seconds a frame")
        where: Any = "outside lower center"
        drawn.legend(*plots[0, 0].get_legend_handles_labels(), loc=where, ncols=len(LINES), frameon=False)
        return encode(drawn, ".png", {"Title": "Growth", "Description": renderer}, f"splatgl {sg.__version__}", 200)


def main() -> None:
    parser = argparse.ArgumentParser(
        allow_abbrev=False, description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--sides", type=int, nargs="+", default=[64, 128, 256, 512], help="voxels along a side")
    parser.add_argument("--sizes", type=int, nargs="+", default=[128, 256, 512, 1024], help="pixels along a side")
    parser.add_argument("--kinds", nargs="+", choices=list(OPACITIES), default=list(OPACITIES))
    parser.add_argument("--rounds", type=int, default=3, help="times each way is measured (3)")
    parser.add_argument("--csv", type=Path, help="also write the rows here")
    parser.add_argument("--figure", type=Path, help="also draw them into this PNG (extra `plots`)")
    args = parser.parse_args()
    side = SIDE if SIDE in args.sides else args.sides[-1]
    size = SIZE if SIZE in args.sizes else args.sizes[-1]
    with sg.Renderer() as renderer:
        runs = [(kind, each, args.sizes if each == side else [size]) for kind in args.kinds for each in args.sides]
        found = (row for run in runs for row in measure(renderer, *run, args.rounds))
        rows = tell(found, args.csv)
        if args.figure:
            args.figure.write_bytes(figure(rows, side, size, renderer.info.renderer))


if __name__ == "__main__":
    main()
