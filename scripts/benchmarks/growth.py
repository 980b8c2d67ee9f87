"""How time grows with voxels, pixels, layers and frames, beside VTK's casters and PyVista: a table and a figure.

    .venv/bin/python scripts/benchmarks/growth.py --out FILE.json [--figure FILE.png] [--panels voxels pixels …]
            [--kinds solid surface sparse] [--sides 64 128 …] [--sizes 128 256 …] [--layers 1 2 …] [--frames 200]
            [--rounds 3] [--only-figure]

FILE.json keeps each group of times as soon as it is measured: run again, the script measures what is missing, so that
it may be interrupted, or run panel by panel. A group is one place of a panel: all ways there, in random order.

Volumes of three kinds: a solid ball, which fills half of the box; the ball's surface, a few voxels thick; and twelve
wound threads of 3 voxels. Times against voxels are of 512² pixels, those against pixels of 256³ voxels: wall clock
around a finished frame, its pixels read back, medians, without extraction. A frame of more than 5 s is measured once.
Layers are as many volumes of threads of 128³ voxels, each turned another way, at 512² pixels. Frames are those of a
movie of the ball's surface, 128³ voxels at 480×320 pixels, that orbits once: seconds from the start of a process until
so many PNGs are written. VTK (extra `vtk`) casts rays at half-voxel steps, PyVista by its defaults; their mapper for
graphics cards draws by the same OpenGL driver. The solid ball has 1024³ voxels only if `--sides` names them: it takes
13 GB.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import random
import statistics
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, closing
from dataclasses import asdict, dataclass
from functools import partial
from importlib.util import find_spec
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np
from frames import Frame, timed
from vtk_peers import Peer, PlotterPeer, plotter_of

import splatgl as sg
from splatgl.planning.resolve import extract_for_settings
from splatgl.report.diagram import BLACK, BLUE, GRAY, GREEN, ORANGE, RED, encode, sheet, style
from splatgl.scene.view import ViewOptions

# voxels a side against pixels, pixels a side against voxels
SIDE, SIZE = 256, 512
# of layers and of movies: voxels a side; pixels of a movie
SMALL, MOVIE = 128, (480, 320)
SIDES, SIZES, LAYERS, FRAMES = [64, 128, 256, 512, 1024], [128, 256, 512, 1024, 2048, 4096], [1, 2, 4, 8], 200
# longest side of the kinds that do not fit into memory otherwise
LONGEST = {"solid": 512}
# seconds from which on a frame is measured once
LONG = 5.0
# most numbers of frames that are kept
KEPT = 12
RAMP = [(0.4, 0.0), (0.6, 0.9)]
OPACITIES = {"solid": RAMP, "surface": [(0.3, 0.0), (0.5, 0.3), (0.7, 0.0)], "sparse": RAMP}
# of threads: number, windings, share of the box that they wind through, voxels² of their profile's variance
THREADS, WINDINGS, WOUND, VARIANCE = 12, 1.5, 0.42, 1.7
LINES = {
    "default": (BLACK, "-"),
    "one sample": (BLUE, "--"),
    "draft": (BLUE, "--"),
    "VTK CPU": (GRAY, ":"),
    "VTK OpenGL": (RED, "-."),
    "PyVista": (ORANGE, "-."),
    "PyVista, CPU": (GREEN, ":"),
}
PANELS = ("voxels", "pixels", "layers", "frames")


@dataclass(frozen=True)
class Row:
    """amount: voxels or pixels along a side, layers, or frames."""

    panel: str
    kind: str
    amount: int
    way: str
    splats: int
    seconds: float

    def __str__(self) -> str:
        power = {"voxels": "³", "pixels": "²"}.get(self.panel, "")
        place = f"{self.kind:8} {self.amount:5}{power:1} {self.panel}"
        return f"{place} {self.way:12} {self.splats:10,} splats {self.seconds * 1e3:9.1f} ms"


# a panel, a kind of volume and an amount; None: all amounts of a movie
Group = tuple[str, str, int | None]


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


def transfer_of(kind: str) -> sg.Transfer:
    return sg.Transfer([(255 * value, opacity) for value, opacity in OPACITIES[kind]])


def medians(todo: dict[str, Frame], rounds: int) -> dict[str, float]:
    """Seconds of finished frames, in random order, after one that is not counted."""
    first = {name: timed(frame)[1] for name, frame in todo.items()}
    turns = [name for name in todo for _ in range(rounds if first[name] < LONG else 1)]
    random.Random(1).shuffle(turns)
    times: dict[str, list[float]] = {name: [] for name in todo}
    for name in turns:
        times[name].append(timed(todo[name])[1])
    return {name: statistics.median(found) for name, found in times.items()}


def one_volume(renderer: sg.Renderer, kind: str, side: int, size: int, rounds: int) -> tuple[int, dict[str, float]]:
    """Number of splats, and seconds of a frame by each way to draw one volume."""
    volume, transfer = volume_of(kind, side), transfer_of(kind)
    own, one = sg.Settings(), sg.Settings(antialias="supersample", samples=1)
    splats = extract_for_settings(volume, transfer, own)
    camera = ViewOptions(size=(size, size)).camera(volume, splats)
    draw = partial(renderer.render, splats, camera, verify_bound=False)
    todo: dict[str, Frame] = {"default": partial(draw, own), "one sample": partial(draw, one)}
    with ExitStack() as peers:
        for name, mapper in (("VTK CPU", "cpu"), ("VTK OpenGL", "gpu")) if find_spec("vtk") else ():
            todo[name] = peers.enter_context(closing(Peer(mapper, (volume, transfer), camera, own)))
        if find_spec("pyvista"):
            peer = peers.enter_context(closing(PlotterPeer([sg.Layer(volume, transfer)], camera, own)))
            todo["PyVista"] = peer.ask
        found = medians(todo, rounds)
    renderer.free()
    return len(splats), found


def some_layers(renderer: sg.Renderer, kind: str, count: int, rounds: int) -> tuple[int, dict[str, float]]:
    """As `one_volume`, of so many volumes, each turned another way."""
    samples, transfer = np.asarray(volume_of(kind, SMALL).samples), transfer_of(kind)
    turned = (np.rot90(samples, number % 4, (0, 1 + number // 4)) for number in range(count))
    layers = [sg.Layer(sg.Volume(np.ascontiguousarray(each)), transfer) for each in turned]
    scene, own, one = sg.Scene(layers), sg.Settings(), sg.Settings(antialias="supersample", samples=1)
    camera = ViewOptions(size=(SIZE, SIZE)).camera(layers[0].volume, scene)
    draw = partial(renderer.render, scene, camera)
    todo: dict[str, Frame] = {"default": partial(draw, own), "one sample": partial(draw, one)}
    with ExitStack() as peers:
        for name, on_cpu in (("PyVista", False), ("PyVista, CPU", True)) if find_spec("pyvista") else ():
            todo[name] = peers.enter_context(closing(PlotterPeer(layers, camera, own, on_cpu))).ask
        found = medians(todo, rounds)
    splats = sum(len(splats) for splats, _ in scene.drawn(own))
    renderer.free()
    return splats, found


def own_movie(folder: Path, kind: str, count: int, draft: bool) -> None:
    name = str(folder / "{frame:06d}.png")
    sg.animate(volume_of(kind, SMALL), name, transfer_of(kind), size=MOVIE, frames=count, draft=draft)


def plotter_movie(folder: Path, kind: str, count: int, on_cpu: bool) -> None:
    volume = volume_of(kind, SMALL)
    camera = ViewOptions(size=MOVIE).camera(volume, volume)
    plotter = plotter_of([sg.Layer(volume, transfer_of(kind))], camera, sg.Settings(), on_cpu)
    for frame in range(count):
        plotter.render()
        plotter.screenshot(str(folder / f"{frame:06d}.png"))
        plotter.camera.Azimuth(360 / count)


def movie(work: Callable[..., None], kind: str, count: int, way: bool) -> list[float]:
    """Seconds from the start of a process until each of its frames is written."""
    with tempfile.TemporaryDirectory() as folder:
        begun = time.time()
        process = multiprocessing.get_context("spawn").Process(target=work, args=(Path(folder), kind, count, way))
        process.start()
        process.join()
        written = sorted(path.stat().st_mtime - begun for path in Path(folder).glob("*.png"))
    assert len(written) == count, f"{count} frames expected, {len(written)} written"
    return written


def movies(kind: str, count: int) -> Iterator[Row]:
    ways: dict[str, tuple[Callable[..., None], bool]] = {"default": (own_movie, False), "draft": (own_movie, True)}
    if find_spec("pyvista"):
        ways |= {"PyVista": (plotter_movie, False), "PyVista, CPU": (plotter_movie, True)}
    amounts = sorted({int(n) for n in np.geomspace(1, count, KEPT).round()})
    for way, (work, choice) in ways.items():
        written = movie(work, kind, count, choice)
        yield from (Row("frames", kind, n, way, 0, written[n - 1]) for n in amounts)


def measure(renderer: sg.Renderer, group: Group, args: argparse.Namespace) -> list[Row]:
    """The rows of a group."""
    panel, kind, amount = group
    if amount is None:
        return list(movies(kind, args.frames))
    if panel == "layers":
        splats, found = some_layers(renderer, kind, amount, args.rounds)
    else:
        side, size = (amount, SIZE) if panel == "voxels" else (SIDE, amount)
        splats, found = one_volume(renderer, kind, side, size, args.rounds)
    return [Row(panel, kind, amount, way, splats, seconds) for way, seconds in found.items()]


def groups(args: argparse.Namespace) -> Iterator[Group]:
    """What is to be measured, the quick ones first."""
    sides = args.sides or SIDES
    for amount in sides:
        for kind in args.kinds:
            if args.sides or amount <= LONGEST.get(kind, amount):
                yield "voxels", kind, amount
    yield from (("pixels", kind, amount) for amount in args.sizes for kind in args.kinds)
    yield from (("layers", "sparse", amount) for amount in args.layers)
    yield "frames", "surface", None


def figure(rows: Sequence[Row], renderer: str) -> bytes:
    """The bytes of a PNG: a panel for each kind of volume, above against voxels, below against pixels; then layers and
    frames.
    """
    kinds = [kind for kind in OPACITIES if any(row.kind == kind and row.panel in PANELS[:2] for row in rows)]
    columns = max(len(kinds), 3)
    with style():
        drawn = sheet(6.4, 2.3 * columns)
        grid = drawn.add_gridspec(3, columns)
        places = {(panel, kind): grid[line, n] for line, panel in enumerate(PANELS[:2]) for n, kind in enumerate(kinds)}
        places |= {("layers", "sparse"): grid[2, 0], ("frames", "surface"): grid[2, 1]}
        titles = {
            "voxels": f"voxels, at {SIZE}² pixels",
            "pixels": f"pixels, of {SIDE}³ voxels",
            "layers": f"layers of {SMALL}³ voxels, at {SIZE}² pixels",
            "frames": "frames of a movie, " + "×".join(map(str, MOVIE)),
        }
        shared: dict[str, Any] = {}
        handles: dict[str, Any] = {}
        for (panel, kind), place in places.items():
            above = panel if panel == "frames" else "frame"
            plot = drawn.add_subplot(place, sharey=shared.get(above))
            shared.setdefault(above, plot)
            those = sorted((row for row in rows if (row.panel, row.kind) == (panel, kind)), key=lambda row: row.amount)
            for way, (color, dashes) in LINES.items():
                points = [(row.amount, row.seconds) for row in those if row.way == way]
                if points:
                    (handles[way],) = plot.plot(*zip(*points, strict=True), "o", ls=dashes, color=color, ms=2.5)
            plot.set(xscale="log", yscale="log", xlabel=titles[panel])
            power = {"voxels": "³", "pixels": "²"}.get(panel, "")
            ticks = sorted({row.amount for row in those})
            ticks = [tick for tick in ticks if panel != "frames" or tick in (1, 10, 50, ticks[-1])]
            plot.set_xticks(ticks, [f"{tick}{power}" for tick in ticks], minor=False)
            plot.set_xticks([], minor=True)
            plot.yaxis.set_major_formatter("{x:g}")
            plot.grid(True, which="major", color="#e4e4e4", linewidth=0.5, zorder=0)
            plot.set_title("" if panel == "pixels" else kind)
            is_first = panel in ("layers", "frames") or kind == kinds[0]
            plot.set_ylabel(("seconds in all" if panel == "frames" else "seconds a frame") if is_first else "")
        legend = drawn.add_subplot(grid[2, 2])
        legend.axis("off")
        legend.legend(handles.values(), handles.keys(), loc="center", frameon=False)
        return encode(drawn, ".png", {"Title": "Growth", "Description": renderer}, f"splatgl {sg.__version__}", 200)


def main() -> None:
    parser = argparse.ArgumentParser(
        allow_abbrev=False, description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, required=True, help="JSON that keeps the times")
    parser.add_argument("--figure", type=Path, help="also draw them into this PNG (extra `plots`)")
    parser.add_argument("--only-figure", action="store_true", help="measure nothing")
    parser.add_argument("--panels", nargs="+", choices=PANELS, default=list(PANELS))
    parser.add_argument("--kinds", nargs="+", choices=list(OPACITIES), default=list(OPACITIES))
    parser.add_argument("--sides", type=int, nargs="+", help="voxels along a side")
    parser.add_argument("--sizes", type=int, nargs="+", default=SIZES, help="pixels along a side")
    parser.add_argument("--layers", type=int, nargs="+", default=LAYERS, help="numbers of layers")
    parser.add_argument("--frames", type=int, default=FRAMES, help="frames of a movie (200)")
    parser.add_argument("--rounds", type=int, default=3, help="times each way is measured (3)")
    args = parser.parse_args()
    kept: dict[str, Any] = {"renderer": "", "rows": []}
    if args.out.exists():
        kept = json.loads(args.out.read_text())
    rows = [Row(**row) for row in kept["rows"]]
    done = {(row.panel, row.kind, None if row.panel == "frames" else row.amount) for row in rows}
    todo = [group for group in groups(args) if group[0] in args.panels and group not in done]
    for (panel, amount), some in groupby([] if args.only_figure else todo, key=lambda group: (group[0], group[2])):
        # a renderer of its own for each amount: memory that it kept counts for no other
        with sg.Renderer() as renderer:
            kept["renderer"] = renderer.info.renderer
            for group in some:
                begun = time.perf_counter()
                found = measure(renderer, group, args)
                rows += found
                print(*found, sep="\n")
                print(f"{panel} {amount or ''}: {time.perf_counter() - begun:.0f} s", flush=True)
                kept["rows"] = [asdict(row) for row in rows]
                args.out.write_text(json.dumps(kept, indent=1) + "\n")
    if args.figure:
        args.figure.write_bytes(figure(rows, kept["renderer"]))


if __name__ == "__main__":
    main()
