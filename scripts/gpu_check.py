"""Checks a machine with a graphics card: correctness of images, speed, and the faster technique.

    scripts/gpu_check [-o gpu_check.json] [--short] [--software]

Checks the driver (float blending and filtering), runs the tests that need OpenGL, among them comparisons with stored
images of software OpenGL, within the bounds of both; draws scenes by quads and by tiles in the shapes of a card and of
a processor, compares and times them, the stages of tiles, and the upload of their splats. With VTK, its GPU mapper
draws the same scenes, and errors of all are measured from the field. Prints a table and writes JSON; exit code 1 if
anything is wrong. Takes at most eight minutes; lists omitted checks with reasons. --short omits the tests and draws
small images.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import statistics
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, closing
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import moderngl
import numpy as np
from benchmarks.vtk_peers import Peer

import splatgl as sg
from splatgl.cli.doctor import check_line
from splatgl.errors import InputError
from splatgl.fileio import check_output, write_file
from splatgl.gl.buffers import DrawOrder, InstanceBuffer, SplatTextures
from splatgl.gl.card_lists import CardLists
from splatgl.gl.context import current
from splatgl.gl.selfcheck import run_checks
from splatgl.gl.sheet_tiles import SheetTiles
from splatgl.gl.tiles import Projector, SplatTiles
from splatgl.reference.field import field_integral
from tests.gpu.gpu_check_tests import tests

# seconds in total, and for the tests
MOST, TESTS = 480.0, 270.0
ROUNDS = 7
# uploads of splats; the fastest counts
UPLOADS = 3
# ways to draw: technique, and shape of compute shaders. The first is what the others are compared with
WAYS = {"tiles": ("tiles", "card"), "columns": ("tiles", "processor"), "quads": ("quads", "processor")}
# stages of tiles in the card's shape, by the methods that queue them
STAGES: tuple[tuple[str, type, str], ...] = (
    ("sort", CardLists, "sort_by_sheet"),
    ("project", Projector, "project"),
    ("count", CardLists, "count_pairs"),
    ("list", CardLists, "list_tiles"),
    ("add up", SheetTiles, "composite"),
    ("add up", SplatTiles, "composite"),
)
# pixels along a side of the pictures whose errors are measured, and samples a voxel of the field
MEASURED, STEPS = 96, 4
# seconds of rounds after which no other round starts
ENOUGH = MOST / 60
# expected ratio of times for four times the pixels
GROWTH = 3
# largest measured error of images of values, which have no bound
UNBOUND = 1e-3


# renderers by the shape of their compute shaders
Renderers = Mapping[str, sg.Renderer]
# pixels and their error bound
Pixels = tuple[np.ndarray, float]


@dataclass(frozen=True)
class Frame:
    """A scene drawn in one of WAYS. first: seconds of the first frame, with compilation, upload and ordering;
    upload: seconds of uploading splats; seconds: median of the rounds with readback. apart: difference from the
    first way, None for that; allowed: by the bounds of both. auto: the technique of the default settings. stages:
    seconds of the device by stage of STAGES.
    """

    scene: str
    look: str
    size: int
    way: str
    splats: int
    first: float
    upload: float
    seconds: float
    apart: float | None
    allowed: float
    auto: str
    stages: dict[str, float]

    @property
    def right(self) -> bool:
        """Whether the two ways agree."""
        return self.apart is None or self.apart <= self.allowed

    def __str__(self) -> str:
        compared = "" if self.apart is None else f"{self.apart:10.1e}{self.allowed:10.1e}"
        return (
            f"{self.scene:8}{self.look:7}{self.size:5}² {self.way:8}{self.splats:9,}{self.seconds * 1e3:10.2f}"
            f"{self.first * 1e3:10.1f}{self.upload * 1e3:10.1f}{self.splats / self.seconds / 1e6:11.2f}"
            f"{compared}{'' if self.right else '  WRONG'}"
            + "".join(f"\n{name:>27}{seconds * 1e3:20.2f}" for name, seconds in self.stages.items())
        )


HEAD = (
    f"{'scene':8}{'look':7}{'size':>5}  {'by':8}{'splats':>9}{'frame, ms':>10}{'first':>10}{'upload':>10}"
    f"{'M splats/s':>11}{'apart':>10}{'allowed':>10}"
)
LEGEND = f"""\
splats: one by one, as in the paper; sheets: of the same splats; values: classified after reconstruction, the default
by: quads; tiles in the shape of a card; columns: tiles in the shape of a processor
frame: median of up to {ROUNDS}, pixels read back; first: with shaders compiled, splats uploaded and ordered
below it the time of the device by stage: sort by sheet, project, count and list the splats of tiles, add them up
apart: largest difference from the picture by tiles; allowed: by the error bounds of both
"""


@dataclass(frozen=True)
class LeftOut:
    """An omitted check and the reason. broken: whether it failed."""

    what: str
    why: str
    broken: bool = False

    def __str__(self) -> str:
        return f"{self.what}: {'FAILED' if self.broken else 'left out'}: {self.why}"


# classification and settings: single splats as in the paper, sheets of splats, values after reconstruction
LOOKS = {
    "splats": ("pre", sg.Settings.like("0.1")),
    "sheets": ("pre", sg.Settings(antialias="off")),
    "values": ("post", sg.Settings(antialias="off")),
}


@dataclass(frozen=True, eq=False)
class Subject:
    """Splats of a scene, and their settings."""

    scene: str
    look: str
    volume: sg.Volume
    splats: sg.Splats
    settings: sg.Settings

    def at(self, size: int) -> str:
        """Name with the size of an image."""
        return f"{self.scene} {self.look} {size}²"

    def camera(self, size: int) -> sg.Camera:
        """A view of the whole scene."""
        return sg.Camera.orbit(self.volume, 30, 20, size=(size, size))


def scenes(short: bool) -> Iterator[tuple[str, sg.Volume]]:
    """The paper's scenes, or a small one."""
    if short:
        yield "ball", sg.scenes.ball(12)
        return
    for name in ("tunnel", "terrain", "nerve"):
        yield name, getattr(sg.scenes, name)()


def subjects(short: bool) -> Iterator[Subject]:
    """All scenes in all applicable LOOKS."""
    for name, volume in scenes(short):
        transfer = sg.default_transfer(volume)
        for look, (classification, settings) in LOOKS.items():
            # voxels with colours of their own have no values
            if classification == "pre" or volume.color is None:
                splats = sg.extract(volume, transfer, classification=classification)
                yield Subject(name, look, volume, splats, settings)


def frames(renderers: Renderers, short: bool, until: float) -> Iterator[Frame | LeftOut]:
    """Draws all subjects in all ways, small images first, while there is time."""
    took = dict.fromkeys(subjects(short), 0.0)
    for size in (64,) if short else (512, 1024, 2048):
        for subject, before in took.items():
            if time.monotonic() + GROWTH * before > until:
                yield LeftOut(subject.at(size), "no time")
                continue
            took[subject] = 0.0
            for frame in compared(renderers, subject, size, until):
                took[subject] += frame.first + frame.seconds if isinstance(frame, Frame) else 0.0
                yield frame


def compared(renderers: Renderers, subject: Subject, size: int, until: float) -> Iterator[Frame | LeftOut]:
    """Draws a subject in all ways, even after `until`: a single image cannot be compared."""
    right: Pixels | None = None
    for way, (technique, shape) in WAYS.items():
        what, settings = f"{subject.at(size)} by {way}", subject.settings.replace(technique=technique)
        renderer = renderers[shape]
        try:
            renderer.plan(subject.splats, subject.camera(size), settings)
        except InputError as error:
            # OpenGL without compute shaders
            yield LeftOut(what, str(error))
            continue
        try:
            frame, pixels = draw_by(renderer, replace(subject, settings=settings), way, size, right, until)
        except InputError as error:
            yield LeftOut(what, str(error), broken=True)
            continue
        right = right or pixels
        yield frame


def draw_by(
    renderer: sg.Renderer,
    subject: Subject,
    way: str,
    size: int,
    right: Pixels | None,
    until: float,
) -> tuple[Frame, Pixels]:
    """(frame, pixels and bound) of a subject. right: pixels and bound of the first way."""
    camera, settings = subject.camera(size), subject.settings

    def draw() -> sg.Image:
        return renderer.render(subject.splats, camera, settings, verify_bound=False)

    first, image = timed(draw)
    times: list[float] = []
    while len(times) < ROUNDS and (not times or (time.monotonic() < until and sum(times) < ENOUGH)):
        times.append(timed(draw)[0])
    bound = image.info["error_bound"]
    pixels = image.pixels, bound if isinstance(bound, float) else UNBOUND
    apart = None if right is None else float(np.abs(image.pixels - right[0]).max())
    allowed = pixels[1] + (0.0 if right is None else right[1])
    label = subject.scene, subject.look, size, way, len(subject.splats)
    upload = time_upload(renderer, subject.splats, settings.technique)
    auto = renderer.plan(subject.splats, camera, settings.replace(technique="auto")).program.technique
    stages = stage_times(renderer, draw) if way == "tiles" else {}
    return Frame(*label, first, upload, statistics.median(times), apart, allowed, auto, stages), pixels


def stage_times(renderer: sg.Renderer, draw: Callable[[], object]) -> dict[str, float]:
    """Seconds that the device spends on each of STAGES, by its own clock."""
    queries: list[tuple[str, moderngl.Query]] = []
    originals = [(owner, name, getattr(owner, name)) for _, owner, name in STAGES]

    def timed_by_device(stage: str, original: Callable[..., Any]) -> Callable[..., Any]:
        def run(*args: Any, **options: Any) -> Any:
            query = renderer.ctx.query(time=True)
            queries.append((stage, query))
            with query:
                return original(*args, **options)

        return run

    try:
        for (stage, *_), (owner, name, original) in zip(STAGES, originals, strict=True):
            setattr(owner, name, timed_by_device(stage, original))
        draw()
    finally:
        for owner, name, original in originals:
            setattr(owner, name, original)
    with current(renderer.ctx):
        stages: dict[str, float] = {}
        for stage, query in queries:
            stages[stage] = stages.get(stage, 0.0) + query.elapsed * 1e-9
    return stages


@dataclass(frozen=True)
class Measured:
    """RMSE of a scene's picture from its field, and the seconds of a frame."""

    scene: str
    way: str
    error: float
    seconds: float

    def __str__(self) -> str:
        return f"{self.scene:8}{self.way:8} RMSE {self.error:.5f}, {self.seconds * 1e3:.2f} ms at {MEASURED}²"


def rmse(image: sg.Image, right: sg.Image) -> float:
    """Root of the mean square of all components' differences."""
    return float(np.sqrt(np.square(image.pixels - right.pixels).mean()))


def errors(renderers: Renderers, short: bool, until: float) -> Iterator[Measured | LeftOut]:
    """Measures the values of all scenes in all ways, and VTK's GPU mapper, against the field."""
    for subject in (subject for subject in subjects(short) if subject.look == "values"):
        if time.monotonic() > until:
            yield LeftOut(f"errors of {subject.scene}", "no time")
            continue
        camera = subject.camera(MEASURED)
        content = subject.volume, sg.default_transfer(subject.volume)
        field = field_integral(*content, camera, steps_per_voxel=STEPS)
        for way, (technique, shape) in WAYS.items():
            settings = subject.settings.replace(technique=technique)
            draw = partial(renderers[shape].render, subject.splats, camera, settings, verify_bound=False)
            try:
                timed(draw)
                seconds, image = timed(draw)
                yield Measured(subject.scene, way, rmse(image, field), seconds)
            except InputError as error:
                yield LeftOut(f"errors of {subject.scene} by {way}", str(error))
        try:
            with closing(Peer("gpu", content, camera, sg.Settings())) as peer:
                peer.frame()
                image, seconds = peer.frame()
                yield Measured(subject.scene, "VTK", rmse(image, field), seconds)
        except InputError as error:
            yield LeftOut(f"errors of {subject.scene} by VTK", str(error))


def time_upload(renderer: sg.Renderer, splats: sg.Splats, technique: str) -> float:
    """Seconds to upload splats, as textures for tiles or instances for quads."""
    times = []
    with current(renderer.ctx):
        for _ in range(UPLOADS):
            textures, instances = SplatTextures(renderer.ctx, splats), InstanceBuffer(renderer.ctx)
            renderer.ctx.finish()
            started = time.perf_counter()
            if technique == "tiles":
                textures.texels(False, DrawOrder(None, True))
            else:
                instances.fill(splats.records)
            renderer.ctx.finish()
            times.append(time.perf_counter() - started)
            textures.release()
            instances.release()
    return min(times)


def timed(work: Callable[[], Any]) -> tuple[float, Any]:
    """(seconds, result) of a function."""
    start = time.perf_counter()
    result = work()
    return time.perf_counter() - start, result


def slowdown(frames: list[Frame]) -> dict[str, float]:
    """Ratio of times of quads to tiles by look: geometric mean over subjects drawn by both."""
    times = {(frame.scene, frame.look, frame.size, frame.way): frame.seconds for frame in frames}
    ratios: dict[str, list[float]] = {}
    for (scene, look, size, way), seconds in times.items():
        tiles = times.get((scene, look, size, "tiles"))
        if way == "quads" and tiles:
            ratios.setdefault(look, []).append(seconds / tiles)
    return {look: float(np.exp(np.mean(np.log(some)))) for look, some in ratios.items()}


def main(arguments: Sequence[str] | None = None) -> int:
    """Exit code: 0 if all checks pass, 1 if not, 2 without a graphics card or an output file."""
    parser = argparse.ArgumentParser(allow_abbrev=False, description=(__doc__ or "").split("\n")[0])
    parser.add_argument("-o", "--output", default="gpu_check.json", metavar="FILE", help="JSON (gpu_check.json)")
    parser.add_argument("--short", action="store_true", help="small pictures, no tests: seconds")
    parser.add_argument("--software", action="store_true", help="also if only software OpenGL is there")
    args = parser.parse_args(arguments)
    until = time.monotonic() + MOST
    try:
        check_output(Path(args.output), (".json",))
        with ExitStack() as owned:
            shapes = dict.fromkeys(shape for _, shape in WAYS.values())
            gpu = not args.software
            renderers = {shape: owned.enter_context(sg.Renderer(require_gpu=gpu, shape=shape)) for shape in shapes}
            report = measure(renderers, args.short, until)
        write_file(Path(args.output), json.dumps(report, indent=1).encode())
    except InputError as error:
        print(f"gpu_check: {error}", file=sys.stderr)
        return 2
    print(f"{args.output}: {verdict(report['right'], report['left out'])}")
    return 0 if report["right"] else 1


def verdict(right: bool, left: Sequence[str]) -> str:
    """Last line of the output, with the omitted checks."""
    if not left:
        return "everything is right" if right else "something is WRONG"
    return f"{'everything that was checked is right' if right else 'something is WRONG'}; left out: {', '.join(left)}"


def measure(renderers: Renderers, short: bool, until: float) -> dict[str, Any]:
    """Report of driver checks, tests, errors and frames; prints results at once."""
    renderer = next(iter(renderers.values()))
    print(f"{renderer.info}\n{platform.platform()}, {os.cpu_count()} cores")
    checks = run_checks(renderer.ctx)
    print("\n".join(check_line(check) for check in checks), flush=True)
    # before the frames, which use the remaining time
    tested = {"failed": [], "left out": ["the tests"]} if short else tests(TESTS, not renderer.info.software)
    results: list[Measured | Frame | LeftOut] = []
    for error in errors(renderers, short, until):
        print(error, flush=True)
        results.append(error)
    print(f"{LEGEND}{HEAD}", flush=True)
    for frame in frames(renderers, short, until):
        print(frame, flush=True)
        results.append(frame)
    done = [result for result in results if isinstance(result, Frame)]
    others = [result for result in results if isinstance(result, LeftOut)]
    ratios = slowdown(done)
    for look, ratio in ratios.items():
        chosen = " and ".join(sorted({frame.auto for frame in done if frame.look == look}))
        print(f"{look}: quads take {ratio:.2f} times as long as tiles; auto draws {chosen}")
    failed = [str(other) for other in others if other.broken]
    right = all(check.passed for check in checks if check.required) and all(frame.right for frame in done)
    return {
        "renderer": asdict(renderer.info),
        "machine": platform.platform(),
        "right": right and not failed and not tested["failed"],
        "left out": [other.what for other in others if not other.broken] + tested["left out"],
        "failed": failed,
        "checks": [asdict(check) | {"passed": bool(check.passed)} for check in checks],
        "tests": tested,
        "frames": [asdict(frame) | {"right": frame.right} for frame in done],
        "quads over tiles": ratios,
        "errors": [asdict(result) for result in results if isinstance(result, Measured)],
    }


if __name__ == "__main__":
    sys.exit(main())
