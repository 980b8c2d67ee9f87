"""Checks a machine with a graphics card: correctness of images, speed, and the faster technique.

    scripts/gpu_check [-o gpu_check.json] [--short] [--software]

Checks the driver (float blending and filtering), runs the tests that need OpenGL, among them comparisons with stored
images of software OpenGL, within the bounds of both; draws scenes by quads and by tiles, compares and times both, and
the upload of their splats. Prints a table and writes JSON; exit code 1 if anything is wrong. Takes at most eight
minutes; lists omitted checks with reasons. --short omits the tests and draws small images.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import statistics
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

import splatgl as sg
from splatgl.cli.doctor import check_line
from splatgl.errors import InputError
from splatgl.fileio import check_output, write_file
from splatgl.gl.buffers import DrawOrder, Instances, Textured
from splatgl.gl.context import current
from splatgl.gl.selfcheck import run_checks
from tests.gpu.gpu_check_tests import tests

# seconds in total, and for the tests
MOST, TESTS = 480.0, 270.0
ROUNDS = 7
# uploads of splats; the fastest counts
UPLOADS = 3
TECHNIQUES = ("tiles", "quads")
# seconds of rounds after which no other round starts
ENOUGH = MOST / 60
# expected ratio of times for four times the pixels
GROWTH = 3
# largest measured error of images of values, which have no bound
UNBOUND = 1e-3


# pixels and their error bound
Pixels = tuple[np.ndarray, float]


@dataclass(frozen=True)
class Frame:
    """A scene drawn by one technique. first: seconds of the first frame, with compilation, upload and ordering;
    upload: seconds of uploading splats; seconds: median of the rounds with readback. apart: difference from the
    first technique, None for that; allowed: by the bounds of both. auto: the technique of the default settings.
    """

    scene: str
    look: str
    size: int
    technique: str
    splats: int
    first: float
    upload: float
    seconds: float
    apart: float | None
    allowed: float
    auto: str

    @property
    def right(self) -> bool:
        """Whether the two techniques agree."""
        return self.apart is None or self.apart <= self.allowed

    def __str__(self) -> str:
        compared = "" if self.apart is None else f"{self.apart:10.1e}{self.allowed:10.1e}"
        return (
            f"{self.scene:8}{self.look:7}{self.size:5}² {self.technique:6}{self.splats:9,}{self.seconds * 1e3:10.2f}"
            f"{self.first * 1e3:10.1f}{self.upload * 1e3:10.1f}{self.splats / self.seconds / 1e6:11.2f}"
            f"{compared}{'' if self.right else '  WRONG'}"
        )


HEAD = (
    f"{'scene':8}{'look':7}{'size':>5}  {'by':6}{'splats':>9}{'frame, ms':>10}{'first':>10}{'upload':>10}"
    f"{'M splats/s':>11}{'apart':>10}{'allowed':>10}"
)
LEGEND = f"""\
splats: one by one, as in the paper; sheets: of the same splats; values: classified after reconstruction, the default
frame: median of up to {ROUNDS}, pixels read back; first: with shaders compiled, splats uploaded and ordered
apart: largest difference from the picture by {TECHNIQUES[0]}; allowed: by the error bounds of both
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
        yield "ball", sg.scenes.ball(24)
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


def frames(renderer: sg.Renderer, short: bool, until: float) -> Iterator[Frame | LeftOut]:
    """Draws all subjects by all techniques, small images first, while there is time."""
    took = dict.fromkeys(subjects(short), 0.0)
    for size in (64,) if short else (512, 1024, 2048):
        for subject, before in took.items():
            if time.monotonic() + GROWTH * before > until:
                yield LeftOut(subject.at(size), "no time")
                continue
            took[subject] = 0.0
            for frame in compared(renderer, subject, size, until):
                took[subject] += frame.first + frame.seconds if isinstance(frame, Frame) else 0.0
                yield frame


def compared(renderer: sg.Renderer, subject: Subject, size: int, until: float) -> Iterator[Frame | LeftOut]:
    """Draws a subject by all techniques, even after `until`: a single image cannot be compared."""
    right: Pixels | None = None
    for technique in TECHNIQUES:
        what, settings = f"{subject.at(size)} by {technique}", subject.settings.but(technique=technique)
        try:
            renderer.plan(subject.splats, subject.camera(size), settings)
        except InputError as error:
            # OpenGL without compute shaders
            yield LeftOut(what, str(error))
            continue
        try:
            frame, pixels = draw_by(renderer, subject, settings, size, right, until)
        except InputError as error:
            yield LeftOut(what, str(error), broken=True)
            continue
        right = right or pixels
        yield frame


def draw_by(
    renderer: sg.Renderer,
    subject: Subject,
    settings: sg.Settings,
    size: int,
    right: Pixels | None,
    until: float,
) -> tuple[Frame, Pixels]:
    """(frame, pixels and bound) of a subject. right: pixels and bound of the first technique."""
    camera, technique = subject.camera(size), settings.technique

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
    label = subject.scene, subject.look, size, technique, len(subject.splats)
    upload = time_upload(renderer, subject.splats, technique)
    auto = renderer.plan(subject.splats, camera, subject.settings.but(technique="auto")).program.technique
    return Frame(*label, first, upload, statistics.median(times), apart, allowed, auto), pixels


def time_upload(renderer: sg.Renderer, splats: sg.Splats, technique: str) -> float:
    """Seconds to upload splats, as textures for tiles or instances for quads."""
    times = []
    with current(renderer.ctx):
        for _ in range(UPLOADS):
            textures, instances = Textured(renderer.ctx, splats), Instances(renderer.ctx)
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
    times = {(frame.scene, frame.look, frame.size, frame.technique): frame.seconds for frame in frames}
    ratios: dict[str, list[float]] = {}
    for (scene, look, size, technique), seconds in times.items():
        tiles = times.get((scene, look, size, "tiles"))
        if technique == "quads" and tiles:
            ratios.setdefault(look, []).append(seconds / tiles)
    return {look: float(np.exp(np.mean(np.log(some)))) for look, some in ratios.items()}


def main(arguments: Sequence[str] | None = None) -> int:
    """Exit code: 0 if all checks pass, 1 if not, 2 without a graphics card or an output file."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("-o", "--output", default="gpu_check.json", metavar="FILE", help="JSON (gpu_check.json)")
    parser.add_argument("--short", action="store_true", help="small pictures, no tests: seconds")
    parser.add_argument("--software", action="store_true", help="also if only software OpenGL is there")
    args = parser.parse_args(arguments)
    until = time.monotonic() + MOST
    try:
        check_output(Path(args.output), (".json",))
        with sg.Renderer(require_gpu=not args.software) as renderer:
            report = measure(renderer, args.short, until)
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


def measure(renderer: sg.Renderer, short: bool, until: float) -> dict[str, Any]:
    """Report of driver checks, tests, and frames; prints results at once."""
    print(f"{renderer.info}\n{platform.platform()}, {os.cpu_count()} cores")
    checks = run_checks(renderer.ctx)
    print("\n".join(check_line(check) for check in checks), flush=True)
    # before the frames, which use the remaining time
    tested = {"failed": [], "left out": ["the tests"]} if short else tests(TESTS, not renderer.info.software)
    print(f"{LEGEND}{HEAD}", flush=True)
    done: list[Frame] = []
    others: list[LeftOut] = []
    for frame in frames(renderer, short, until):
        print(frame, flush=True)
        if isinstance(frame, Frame):
            done.append(frame)
        else:
            others.append(frame)
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
    }


if __name__ == "__main__":
    sys.exit(main())
