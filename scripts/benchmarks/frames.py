"""Frame times and errors, beside a lower bound and, if it is installed, VTK.

    .venv/bin/python scripts/benchmarks/frames.py [--data FOLDER] [--rounds N] [--only WORD] [--csv FILE] [--curves]

"0.1" draws splats as `--like 0.1` does; the lower bound draws as many points of the same size into the same target with
shaders that compute nothing. "one sample" is the default with one sample a pixel. VTK (extra `vtk`) casts rays at
half-voxel steps through the same volume, with the same camera, opacities and pixels. Variants are interleaved in random
order; times are wall clock around a finished frame with its pixels read back. Compare ratios.

Errors are RMSE from one truth, in pixels spread over the matter, of 4×4 rays each: the field of the values, classified
at every point; of volumes with colours of their own the integral of their splats' field. Of X-rays relative to the
brightest.
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
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import moderngl
import numpy as np
from rows import tell
from vtk_peers import Peer

import splatgl as sg
from splatgl.gl.target import RenderTarget
from splatgl.planning.resolve import extract_for_settings, select_splats
from splatgl.reference.field import kept_field_integral, ray_integral_at
from splatgl.scene.scene_file import SceneFile
from splatgl.scene.view import ViewOptions

FLOOR_VERTEX = """#version 330
in vec3 place; uniform mat4 clip_from_index; uniform float size;
void main() { gl_Position = clip_from_index * vec4(place, 1.0); gl_PointSize = size / gl_Position.w; }
"""
FLOOR_FRAGMENT = "#version 330\nout vec4 light; void main() { light = vec4(0.01); }"
# seconds per variant: some are a hundred times as slow, so each gets as many rounds as fit into this
LONGEST = 8.0
# pixels that are compared with the truth
PIXELS = 256
# splats one by one
SPLATS = sg.Settings.like("0.1")

Frame = Callable[[], Any] | Peer


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
    """A scene and its blend; peers: whether VTK can draw it."""

    name: str
    volume: sg.Volume
    transfer: sg.Transfer
    blend: str = "composite"

    @cached_property
    def splats(self) -> sg.Splats:
        """Voxels, classified before."""
        return sg.extract(self.volume, self.transfer, classification="pre")

    @property
    def peers(self) -> bool:
        return self.blend == "composite" and self.volume.color is None


def case(name: str, source: str, blend: str = "composite", every: int = 1, **transfer: object) -> Case:
    """every: of that many slices one is used."""
    scene = SceneFile(source, transfer=transfer)
    volume = scene.open()
    if every > 1:
        x, y, z = volume.spacing
        samples = np.ascontiguousarray(volume.samples[::every])
        volume = sg.Volume(samples, (x, y, z * every), volume.origin, volume.direction, frame=volume.frame)
    return Case(name, volume, scene.transfer_for(volume), blend)


class Right:
    """Pixels of a case's true picture."""

    def __init__(self, chosen: Case, camera: sg.Camera, drawn: sg.Splats, image: sg.Image) -> None:
        """drawn: the splats of `image`, the default picture."""
        seen = np.flatnonzero(image.pixels[..., 3] > 0)
        self.pixels = seen[np.linspace(0, len(seen) - 1, min(PIXELS, len(seen))).astype(int)]
        settings = sg.Settings(blend=chosen.blend)
        march = ray_integral_at if drawn.post is None else kept_field_integral
        self.light = march(drawn, camera, self.pixels, settings=settings, samples=4)
        self.one = self.light.max() if chosen.blend == "xray" else 1.0

    def error(self, image: sg.Image) -> str:
        off = image.pixels.reshape(-1, 4)[self.pixels] - self.light
        return f"off by {np.sqrt((off**2).mean()) / self.one:.2g}"


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
        target: RenderTarget = renderer.passes.targets.get("draw", camera.size, "rgba32f")
        target.clear()
        ctx.enable_only(moderngl.BLEND | moderngl.PROGRAM_POINT_SIZE)
        ctx.blend_func = moderngl.ONE, moderngl.ONE_MINUS_SRC_ALPHA
        vertices.render(moderngl.POINTS)
        return target.read()

    return frame


def ways(renderer: sg.Renderer, chosen: Case, camera: sg.Camera) -> tuple[dict[str, Frame], Right]:
    """What draws the case, and its truth."""
    old, own = SPLATS.replace(blend=chosen.blend), sg.Settings(blend=chosen.blend)
    splats = extract_for_settings(chosen.volume, chosen.transfer, own)

    def draw(some: sg.Splats, settings: sg.Settings) -> Frame:
        return partial(renderer.render, some, camera, settings, verify_bound=False)

    found: dict[str, Frame] = {
        "0.1": draw(chosen.splats, old),
        "floor": floor(renderer, chosen.splats, camera, renderer.plan(chosen.splats, camera, old)),
        "default": draw(splats, own),
        "one sample": draw(splats, own.replace(antialias="supersample", samples=1)),
    }
    if chosen.peers and importlib.util.find_spec("vtk") is None:
        print("VTK left out: not installed (pip install splatgl[vtk])")
    elif chosen.peers:
        twice = own.replace(antialias="supersample", samples=2)
        for name, mapper, asked in (("VTK CPU", "cpu", own), ("VTK CPU 2×2", "cpu", twice), ("VTK OpenGL", "gpu", own)):
            found[name] = Peer(mapper, (chosen.volume, chosen.transfer), camera, asked)
    image = renderer.render(splats, camera, own, verify_bound=False)
    return found, Right(chosen, camera, select_splats(splats, own, moving=False), image)


def timed(frame: Frame) -> tuple[sg.Image | None, float]:
    """A finished frame and its seconds; a peer times itself, in its own process. The floor has no picture."""
    if isinstance(frame, Peer):
        return frame.frame()
    started = time.perf_counter()
    image = frame()
    return image if isinstance(image, sg.Image) else None, time.perf_counter() - started


def measure(renderer: sg.Renderer, chosen: Case, size: int, rounds: int) -> Iterator[Row]:
    """Measures all variants of a scene, interleaved in random order."""
    camera = ViewOptions(size=(size, size)).camera(chosen.volume, chosen.splats)
    todo, right = ways(renderer, chosen, camera)
    images = {name: timed(frame)[0] for name, frame in todo.items()}
    times: dict[str, list[float]] = {name: [] for name in todo}
    turns = [name for name in todo for _ in range(rounds)]
    random.Random(1).shuffle(turns)
    for name in turns:
        if sum(times[name]) < LONGEST:
            times[name].append(timed(todo[name])[1])
    for frame in todo.values():
        if isinstance(frame, Peer):
            frame.close()
    base = statistics.median(times["default"])
    for name, found in times.items():
        median, image = statistics.median(found), images[name]
        note = f"{median / base:.2f} × default" + (f", {right.error(image)}" if image else "")
        yield Row(chosen.name, size, name, len(chosen.splats), median, min(found), max(found), note)


def ball(count: int) -> Case:
    """About `count` splats of all opacities."""
    edge = max(round((count / 0.52) ** (1 / 3)), 4)
    z, y, x = np.mgrid[:edge, :edge, :edge] - (edge - 1) / 2
    inside = (np.sqrt(x * x + y * y + z * z) < edge / 2) * np.random.default_rng(1).random((edge, edge, edge))
    transfer = sg.Transfer([(0, 0), (1, 0.05)], shading=False)
    volume = sg.Volume(inside.astype(np.float32))
    return Case(f"ball {count / 1e6:g} M", volume, transfer)


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
        camera = ViewOptions(size=(size, size)).camera(tunnel.volume, tunnel.splats)
        yield from _planned(renderer, tunnel, camera, rounds)


def _planned(renderer: sg.Renderer, chosen: Case, camera: sg.Camera, rounds: int) -> Iterator[Row]:
    times = []
    for _ in range(rounds + 1):
        started = time.perf_counter()
        renderer.render(chosen.splats, camera, SPLATS, verify_bound=False)
        times.append(time.perf_counter() - started)
    later = times[1:]
    yield Row(
        chosen.name, camera.size[1], "0.1", len(chosen.splats), statistics.median(later), min(later), max(later), ""
    )


def cases(data: Path | None) -> Iterator[Case]:
    """Scenes of every shape: cubic and long voxels, sparse and solid, with colours of their own."""
    for name in ("tunnel", "terrain", "nerve"):
        yield case(name, name)
    if data is not None:
        head, male = str(data / "head_mri_160x232x160.nii.gz"), str(data / "visible_male_128x256x256_uint8.raw")
        yield case("stent, X-ray", str(data / "stent_ct_128x128x256.nrrd"), "xray")
        yield case("neuron", str(data / "neuron_a_409x415x119.tif"))
        yield case("male, bone", male, preset="ct-bone")
        yield case("male", male)
        yield case("MRI, 8:1", head, every=8)
        yield case("lung CT", str(data / "lung_ct_115x157x129.mha"))
        yield case("tooth", str(data / "tooth.nhdr"))


def all_rows(data: Path | None, rounds: int, only: str) -> Iterator[Row]:
    with sg.Renderer() as renderer:
        print(renderer.info)
        for chosen in cases(data):
            if only in chosen.name:
                for size in (512, 1024):
                    yield from measure(renderer, chosen, size, rounds)


def all_curves(rounds: int) -> Iterator[Row]:
    with sg.Renderer() as renderer:
        yield from curves(renderer, rounds)


def main() -> None:
    parser = argparse.ArgumentParser(
        allow_abbrev=False, description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--data", type=Path, default=os.environ.get("SPLATGL_DATA"), help="folder of real volumes")
    parser.add_argument("--rounds", type=int, default=7, help="times each way is measured (7)")
    parser.add_argument("--only", default="", metavar="WORD", help="scenes whose name has this word")
    parser.add_argument("--curves", action="store_true", help="instead: time over splats and over pixels")
    parser.add_argument("--csv", type=Path, help="also write the rows here")
    args = parser.parse_args()
    found = all_curves(args.rounds) if args.curves else all_rows(args.data and Path(args.data), args.rounds, args.only)
    tell(found, args.csv)


if __name__ == "__main__":
    main()
