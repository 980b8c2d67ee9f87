"""One command for a machine with a graphics card: are pictures right on it, how fast is it, which technique serves it?

    scripts/gpu_check [-o gpu_check.json] [--short] [--software]

Checks the driver (float blending and filtering), runs the tests that need OpenGL, among them comparisons with pictures
stored from software OpenGL, within the bounds of both; draws scenes by quads and by tiles, compares the two with each
other, and times them, as the upload of their splats. Prints a table and writes JSON; exit code 1 if anything is wrong.
It takes at most eight minutes; what was left out is named, and why. --short leaves out the tests and draws small
pictures.
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

# seconds: all in all, and of them for the tests
MOST, TESTS = 480.0, 270.0
ROUNDS = 7
# how often splats are uploaded; the fastest counts
UPLOADS = 3
TECHNIQUES = ("tiles", "quads")
# seconds of rounds after which no other is drawn
ENOUGH = MOST / 60
# pictures of four times the pixels are expected to take at most so many times as long
GROWTH = 3
# without a bound: the largest error that pictures of values were measured to have
UNBOUND = 1e-3


# pixels and their error bound
Shown = tuple[np.ndarray, float]


@dataclass(frozen=True)
class Frame:
    """A scene drawn by one technique. Seconds: first, which compiles shaders, and uploads and orders splats; upload, of
    the splats alone; seconds: median of the rounds, pixels read back. apart: from the first technique, of which it is
    None; allowed: by the bounds of both. auto: the technique that is chosen where none is asked for.
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
    """What was not checked, and why. broken: it failed, where it should not."""

    what: str
    why: str
    broken: bool = False

    def __str__(self) -> str:
        return f"{self.what}: {'FAILED' if self.broken else 'left out'}: {self.why}"


# how scenes are classified and drawn: the paper's splats one by one, in sheets, and values after reconstruction
LOOKS = {
    "splats": ("pre", sg.Settings.like("0.1")),
    "sheets": ("pre", sg.Settings(antialias="off")),
    "values": ("post", sg.Settings(antialias="off")),
}


@dataclass(frozen=True, eq=False)
class Subject:
    """Splats of a scene, and how they are drawn."""

    scene: str
    look: str
    volume: sg.Volume
    splats: sg.Splats
    settings: sg.Settings

    def at(self, size: int) -> str:
        """Its name with the size of a picture."""
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
    """The scenes in all looks that they have."""
    for name, volume in scenes(short):
        transfer = sg.default_transfer(volume)
        for look, (classification, settings) in LOOKS.items():
            # voxels with colours of their own have no values
            if classification == "pre" or volume.color is None:
                splats = sg.extract(volume, transfer, classification=classification)
                yield Subject(name, look, volume, splats, settings)


def frames(renderer: sg.Renderer, short: bool, until: float) -> Iterator[Frame | LeftOut]:
    """Every subject by every technique, small pictures first; while there is time."""
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
    """A subject by every technique, even if that ends after `until`: alone, a picture tells little."""
    right: Shown | None = None
    for technique in TECHNIQUES:
        what, settings = f"{subject.at(size)} by {technique}", subject.settings.but(technique=technique)
        try:
            renderer.plan(subject.splats, subject.camera(size), settings)
        except InputError as error:
            # OpenGL without compute shaders
            yield LeftOut(what, str(error))
            continue
        try:
            frame, shown = drawn_by(renderer, subject, settings, size, right, until)
        except InputError as error:
            yield LeftOut(what, str(error), broken=True)
            continue
        right = right or shown
        yield frame


def drawn_by(
    renderer: sg.Renderer,
    subject: Subject,
    settings: sg.Settings,
    size: int,
    right: Shown | None,
    until: float,
) -> tuple[Frame, Shown]:
    """A subject by the technique of the settings, and its pixels and bound; right: those of the first technique."""
    camera, technique = subject.camera(size), settings.technique

    def draw() -> sg.Image:
        return renderer.render(subject.splats, camera, settings, verify_bound=False)

    first, image = timed(draw)
    times: list[float] = []
    while len(times) < ROUNDS and (not times or (time.monotonic() < until and sum(times) < ENOUGH)):
        times.append(timed(draw)[0])
    own = image.info["error_bound"]
    shown = image.pixels, own if isinstance(own, float) else UNBOUND
    apart = None if right is None else float(np.abs(image.pixels - right[0]).max())
    allowed = shown[1] + (0.0 if right is None else right[1])
    label = subject.scene, subject.look, size, technique, len(subject.splats)
    upload = uploaded(renderer, subject.splats, technique)
    auto = renderer.plan(subject.splats, camera, subject.settings.but(technique="auto")).program.technique
    return Frame(*label, first, upload, statistics.median(times), apart, allowed, auto), shown


def uploaded(renderer: sg.Renderer, splats: sg.Splats, technique: str) -> float:
    """Seconds until splats in memory are on the card, as textures for tiles or instances for quads."""
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
    """Seconds that it takes, and what it returns."""
    start = time.perf_counter()
    found = work()
    return time.perf_counter() - start, found


def slower(found: list[Frame]) -> dict[str, float]:
    """How many times as long quads take as tiles: geometric mean by look, over what both drew."""
    times = {(it.scene, it.look, it.size, it.technique): it.seconds for it in found}
    ratios: dict[str, list[float]] = {}
    for (scene, look, size, technique), seconds in times.items():
        tiles = times.get((scene, look, size, "tiles"))
        if technique == "quads" and tiles:
            ratios.setdefault(look, []).append(seconds / tiles)
    return {look: float(np.exp(np.mean(np.log(some)))) for look, some in ratios.items()}


def main(arguments: Sequence[str] | None = None) -> int:
    """Exit code 0 if all that was checked is right, 1 if not, 2 if there is no card, or nowhere to write."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("-o", "--output", default="gpu_check.json", metavar="FILE", help="JSON (gpu_check.json)")
    parser.add_argument("--short", action="store_true", help="small pictures, no tests: seconds")
    parser.add_argument("--software", action="store_true", help="also if only software OpenGL is there")
    args = parser.parse_args(arguments)
    until = time.monotonic() + MOST
    try:
        check_output(Path(args.output), (".json",))
        with sg.Renderer(require_gpu=not args.software) as renderer:
            told = measured(renderer, args.short, until)
        write_file(Path(args.output), json.dumps(told, indent=1).encode())
    except InputError as error:
        print(f"gpu_check: {error}", file=sys.stderr)
        return 2
    print(f"{args.output}: {verdict(told['right'], told['left out'])}")
    return 0 if told["right"] else 1


def verdict(right: bool, left: Sequence[str]) -> str:
    """The last line: what was left out is not right by that."""
    if not left:
        return "everything is right" if right else "something is WRONG"
    return f"{'everything that was checked is right' if right else 'something is WRONG'}; left out: {', '.join(left)}"


def measured(renderer: sg.Renderer, short: bool, until: float) -> dict[str, Any]:
    """What the driver computes, the tests, and all frames; printed as they come."""
    print(f"{renderer.info}\n{platform.platform()}, {os.cpu_count()} cores")
    checks = run_checks(renderer.ctx)
    print("\n".join(check_line(check) for check in checks), flush=True)
    # before the frames, which take what time they leave
    tested = {"failed": [], "left out": ["the tests"]} if short else tests(TESTS, not renderer.info.software)
    print(f"{LEGEND}{HEAD}", flush=True)
    found: list[Frame] = []
    others: list[LeftOut] = []
    for frame in frames(renderer, short, until):
        print(frame, flush=True)
        if isinstance(frame, Frame):
            found.append(frame)
        else:
            others.append(frame)
    ratios = slower(found)
    for look, ratio in ratios.items():
        chosen = " and ".join(sorted({frame.auto for frame in found if frame.look == look}))
        print(f"{look}: quads take {ratio:.2f} times as long as tiles; auto draws {chosen}")
    failed = [str(other) for other in others if other.broken]
    right = all(check.passed for check in checks if check.required) and all(frame.right for frame in found)
    return {
        "renderer": asdict(renderer.info),
        "machine": platform.platform(),
        "right": right and not failed and not tested["failed"],
        "left out": [other.what for other in others if not other.broken] + tested["left out"],
        "failed": failed,
        "checks": [asdict(check) | {"passed": bool(check.passed)} for check in checks],
        "tests": tested,
        "frames": [asdict(frame) | {"right": frame.right} for frame in found],
        "quads over tiles": ratios,
    }


if __name__ == "__main__":
    sys.exit(main())
