"""Frame times, compared with a lower bound, with all features enabled, and with VTK if installed.

    .venv/bin/python scripts/bench_frames.py [--data FOLDER] [--rounds N] [--csv FILE] [--curves]

The lower bound draws as many points of the same size into the same target with shaders that compute nothing. VTK
(extra `bench`) casts rays at half-voxel steps through the same volume, with the same camera, opacities and
pixels. "sheets" composites the same splats by sheets, "after" values classified after reconstruction, one sample a
pixel. Variants are interleaved in random order; times are wall clock around a finished frame, for splats including
readback. Every image of the planned frames is compared with the float64 reference. Compare ratios.
"""

from __future__ import annotations

import argparse
import importlib.util
import os
import random
import statistics
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import moderngl
import numpy as np
from bench_rows import tell

import splatgl as sg
from splatgl.app.scene import Scene, View
from splatgl.gl.target import Target
from splatgl.splat.plan.suited import extracted
from splatgl.truth.report.peers import Peer

FLOOR_VERTEX = """#version 330
in vec3 place; uniform mat4 clip_from_index; uniform float size;
void main() { gl_Position = clip_from_index * vec4(place, 1.0); gl_PointSize = size / gl_Position.w; }
"""
FLOOR_FRAGMENT = "#version 330\nout vec4 light; void main() { light = vec4(0.01); }"
# seconds per variant: some are a hundred times as slow, so each gets as many rounds as fit into this
LONGEST = 8.0
# kernels of values classified after reconstruction
KERNELS = ("crawfis-max", "b-spline")
# splats one by one
SPLATS = sg.Settings.like("0.1")


@dataclass(frozen=True)
class Row:
    scene: str
    size: int
    way: str
    splats: int
    median: float
    low: float
    high: float
    note: str

    def __str__(self) -> str:
        return (
            f"{self.scene:16} {self.size:5} {self.way:16} {self.splats:9,} splats "
            f"{self.median * 1e3:9.1f} ms ({self.low * 1e3:.1f} … {self.high * 1e3:.1f})  {self.note}"
        )


@dataclass(frozen=True)
class Case:
    """A scene with camera and settings; vtk: points of an opacity function in the volume's values."""

    name: str
    volume: sg.Volume
    transfer: sg.Transfer
    splats: sg.Splats
    settings: sg.Settings
    peers: bool


def case(
    name: str,
    source: str,
    settings: sg.Settings | None = None,
    peers: bool = False,
    every: int = 1,
    **transfer: object,
) -> Case:
    """every: of that many slices one is used."""
    scene = Scene(source, transfer=transfer)
    volume = scene.open()
    if every > 1:
        x, y, z = volume.spacing
        samples = np.ascontiguousarray(volume.samples[::every])
        volume = sg.Volume(samples, (x, y, z * every), volume.origin, volume.direction, frame=volume.frame)
    chosen = scene.transfer_for(volume)
    splats = sg.extract(volume, chosen, classification="pre")
    return Case(name, volume, chosen, splats, settings or SPLATS, peers)


def floor(renderer: sg.Renderer, splats: sg.Splats, camera: sg.Camera, chosen: sg.Plan) -> Callable[[], np.ndarray]:
    """A frame of points whose shaders compute nothing."""
    ctx = renderer.ctx
    spacing = splats.grid.mean_spacing
    program = ctx.program(vertex_shader=FLOOR_VERTEX, fragment_shader=FLOOR_FRAGMENT)
    eye = np.eye(4)
    eye[:3, :3] = camera.eye_from_world @ splats.grid.world_from_index / spacing
    eye[:3, 3] = camera.eye_from_points(splats.grid.origin) / spacing
    clip = np.diag([2 / camera.extent, 2 / camera.extent, 0.5, 1.0])
    clip[3] = [0, 0, 1, 0]
    program["clip_from_index"].write((clip @ eye).T.astype("f4").tobytes())  # type: ignore[union-attr]
    program["size"] = 2 * chosen.kernel.radius * camera.size[1] / camera.extent
    places = ctx.buffer(np.ascontiguousarray(splats.positions))
    vertices = ctx.vertex_array(program, [(places, "3f4", "place")])

    def frame() -> np.ndarray:
        target: Target = renderer.passes.targets.get("draw", camera.size, "rgba32f")
        target.clear()
        ctx.enable_only(moderngl.BLEND | moderngl.PROGRAM_POINT_SIZE)
        ctx.blend_func = moderngl.ONE, moderngl.ONE_MINUS_SRC_ALPHA
        vertices.render(moderngl.POINTS)
        return target.read()

    return frame


def ways(renderer: sg.Renderer, chosen: Case, size: int) -> dict[str, Callable[[], Any] | Peer]:
    camera = View(size=(size, size)).camera(chosen.volume, chosen.splats)
    plan = renderer.plan(chosen.splats, camera, chosen.settings)
    everything = plan.forced(technique="quads", cubic=False, antialias=True, attenuation="fill", half_line=True)
    found: dict[str, Callable[[], Any] | Peer] = {
        "planned": lambda: renderer.render(chosen.splats, camera, chosen.settings, verify_bound=False),
        "floor": floor(renderer, chosen.splats, camera, plan),
    }
    if everything.program.align == "exact":
        found["everything on"] = lambda: renderer.passes.draw(chosen.splats, everything)
    own = sg.Settings(blend=chosen.settings.blend)
    default = partial(renderer.render, extracted(chosen.volume, chosen.transfer, own), camera, own, verify_bound=False)
    found["default"] = default
    if chosen.settings.blend == "composite":
        sheets = chosen.settings.but(compositing="sheets")
        found["sheets"] = lambda: renderer.render(chosen.splats, camera, sheets, verify_bound=False)
    for kernel in KERNELS if chosen.peers else ():
        splats = sg.extract(chosen.volume, chosen.transfer, classification="post", kernel=kernel)
        once = sg.Settings(antialias="off")
        found[f"after, {kernel}"] = partial(renderer.render, splats, camera, once, verify_bound=False)
    if chosen.peers and importlib.util.find_spec("vtk") is None:
        print("VTK left out: not installed (pip install splatgl[bench])")
    elif chosen.peers:
        for name, mapper in (("VTK CPU", "cpu"), ("VTK GPU mapper", "gpu")):
            found[name] = Peer(mapper, (chosen.volume, chosen.transfer), camera, chosen.settings)
    return found


def seconds(frame: Callable[[], Any] | Peer) -> float:
    """Seconds of one finished frame; a peer times itself, in its own process."""
    if isinstance(frame, Peer):
        return frame.frame()[1]
    started = time.perf_counter()
    frame()
    return time.perf_counter() - started


def measure(renderer: sg.Renderer, chosen: Case, size: int, rounds: int) -> Iterator[Row]:
    """Measures all variants of a scene, interleaved in random order."""
    todo = ways(renderer, chosen, size)
    times: dict[str, list[float]] = {name: [] for name in todo}
    for frame in todo.values():
        seconds(frame)
    turns = [name for name in todo for _ in range(rounds)]
    random.Random(1).shuffle(turns)
    for name in turns:
        if sum(times[name]) < LONGEST:
            times[name].append(seconds(todo[name]))
    for frame in todo.values():
        if isinstance(frame, Peer):
            frame.close()
    base = statistics.median(times["planned"])
    for name, found in times.items():
        median = statistics.median(found)
        note = f"{median / base:.2f} × planned" if name != "planned" else error(renderer, chosen, size)
        yield Row(chosen.name, size, name, len(chosen.splats), median, min(found), max(found), note)


def error(renderer: sg.Renderer, chosen: Case, size: int) -> str:
    """The planned image's maximum error and its bound."""
    camera = View(size=(size, size)).camera(chosen.volume, chosen.splats)
    drawn = renderer.render(chosen.splats, camera, chosen.settings)
    right = sg.reference.render(chosen.splats, camera, chosen.settings).pixels
    off = float(np.abs(drawn.pixels - right).max())
    limit = drawn.info["error_bound"]
    return f"error {off:.1e}, bound {limit:.1e}" + ("" if off <= limit else ": BROKEN")  # type: ignore[operator]


def ball(count: int) -> Case:
    """About `count` splats of all opacities."""
    edge = max(round((count / 0.52) ** (1 / 3)), 4)
    z, y, x = np.mgrid[:edge, :edge, :edge] - (edge - 1) / 2
    inside = (np.sqrt(x * x + y * y + z * z) < edge / 2) * np.random.default_rng(1).random((edge, edge, edge))
    transfer = sg.Transfer([(0, 0), (1, 0.05)], shading=False)
    volume = sg.Volume(inside.astype(np.float32))
    splats = sg.extract(volume, transfer, classification="pre")
    return Case(f"ball {count / 1e6:g} M", volume, transfer, splats, SPLATS, False)


def curves(renderer: sg.Renderer, rounds: int) -> Iterator[Row]:
    """Time against number of splats, and against pixels."""
    for millions in (0.1, 0.3, 1, 3, 5):
        chosen = ball(int(millions * 1e6))
        middle = chosen.splats.corners.mean(axis=0)
        # two pixels a voxel for any size of the ball
        away = middle + np.array([150.0, -250, 200])
        yield from _planned(renderer, chosen, sg.Camera.look_at(away, middle, (0, 0, 1), 40, (512, 512)), rounds)
    tunnel = case("tunnel", "tunnel")
    for size in (128, 256, 512, 1024, 2048):
        camera = View(size=(size, size)).camera(tunnel.volume, tunnel.splats)
        yield from _planned(renderer, tunnel, camera, rounds)


def _planned(renderer: sg.Renderer, chosen: Case, camera: sg.Camera, rounds: int) -> Iterator[Row]:
    times = []
    for _ in range(rounds + 1):
        started = time.perf_counter()
        renderer.render(chosen.splats, camera, chosen.settings, verify_bound=False)
        times.append(time.perf_counter() - started)
    later = times[1:]
    yield Row(
        chosen.name, camera.size[1], "planned", len(chosen.splats), statistics.median(later), min(later), max(later), ""
    )


def all_rows(data: Path | None, rounds: int, with_curves: bool) -> Iterator[Row]:
    with sg.Renderer() as renderer:
        print(renderer.info)
        if with_curves:
            yield from curves(renderer, rounds)
            return
        yield from measure(renderer, case("tunnel", "tunnel"), 512, rounds)
        yield from measure(renderer, case("terrain", "terrain"), 512, rounds)
        if data is not None:
            stent = str(data / "stent_ct_128x128x256.nrrd")
            yield from measure(renderer, case("stent, X-ray", stent, SPLATS.but(blend="xray")), 512, rounds)
            male = str(data / "visible_male_128x256x256_uint8.raw")
            neuron = str(data / "neuron_a_409x415x119.tif")
            head = str(data / "head_mri_160x232x160.nii.gz")
            for size in (512, 1024):
                yield from measure(renderer, case("MRI, 8:1", head, peers=True, every=8), size, rounds)
                yield from measure(renderer, case("male, bone", male, peers=True, preset="ct-bone"), size, rounds)
                yield from measure(renderer, case("neuron", neuron, peers=True), size, rounds)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, default=os.environ.get("SPLATGL_DATA"), help="folder of real volumes")
    parser.add_argument("--rounds", type=int, default=7, help="times each way is measured (7)")
    parser.add_argument("--curves", action="store_true", help="instead: time over splats and over pixels")
    parser.add_argument("--csv", type=Path, help="also write the rows here")
    args = parser.parse_args()
    tell(all_rows(args.data and Path(args.data), args.rounds, args.curves), args.csv)


if __name__ == "__main__":
    main()
