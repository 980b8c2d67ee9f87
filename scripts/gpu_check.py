"""One command for a machine with a graphics card: are pictures right on it, how fast is it, which technique serves it?

    scripts/gpu_check [-o gpu_check.json] [--short] [--software]

Checks the driver (float blending and filtering), runs the tests that need OpenGL, among them comparisons with pictures
stored from software OpenGL, within the bounds of both; draws scenes by quads and by tiles, compares the two with each
other, and times them. Prints a table and writes JSON; exit code 1 if anything is wrong. It takes at most eight minutes;
what there was no time for is said. --short leaves out the tests and draws small pictures.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

import splatgl as sg
from splatgl.data.errors import InputError
from splatgl.gl.selfcheck import run_checks

ROOT = Path(__file__).parents[1]
# seconds: all in all, and of them for the tests
MOST, TESTS = 480.0, 270.0
# what needs OpenGL: twins of shader functions, splats against float64, techniques, stored pictures
TESTED = ("twins", "twins_footprints", "twins_sheets", "splat_gl", "tiles", "sheets", "agreement", "compare_scenes")
ROUNDS = 7
TECHNIQUES = ("tiles", "quads")
# without a bound: the largest error that pictures of values were measured to have
UNBOUND = 1e-3


@dataclass(frozen=True)
class Frame:
    """A scene drawn by one technique; seconds: median of the rounds, pixels read back. apart: from the first technique;
    allowed: by the bounds of both.
    """

    scene: str
    look: str
    size: int
    technique: str
    splats: int
    first: float
    seconds: float
    apart: float
    allowed: float

    @property
    def right(self) -> bool:
        """Whether the two techniques agree."""
        return self.apart <= self.allowed

    def __str__(self) -> str:
        return (
            f"{self.scene:10} {self.look:8} {self.size:5}² {self.technique:6} {self.splats:10,} splats "
            f"{self.seconds * 1e3:9.2f} ms, first {self.first * 1e3:8.1f} ms, "
            f"{self.splats / self.seconds / 1e6:8.1f} M splats/s, apart {self.apart:.1e} of {self.allowed:.1e}"
            + ("" if self.right else ": WRONG")
        )


# how scenes are classified and drawn: the paper's splats one by one, in sheets, and values after reconstruction
LOOKS = {
    "splats": ("pre", sg.Settings.like("0.1")),
    "sheets": ("pre", sg.Settings(antialias="off")),
    "values": ("post", sg.Settings(antialias="off")),
}


def scenes(short: bool) -> Iterator[tuple[str, sg.Volume]]:
    """The paper's scenes, or a small one."""
    if short:
        yield "ball", sg.scenes.ball(24)
        return
    for name in ("tunnel", "terrain", "nerve"):
        yield name, getattr(sg.scenes, name)()


def frames(renderer: sg.Renderer, short: bool, until: float) -> Iterator[Frame]:
    """Every scene, look, size and technique, while there is time."""
    sizes = (64,) if short else (512, 1024, 2048)
    for name, volume in scenes(short):
        transfer = sg.default_transfer(volume)
        for look, (classification, settings) in LOOKS.items():
            try:
                splats = sg.extract(volume, transfer, classification=classification)
            except InputError:
                # voxels with colours of their own have no values
                continue
            for size in sizes:
                camera = sg.Camera.orbit(volume, 30, 20, size=(size, size))
                yield from _beside(renderer, (name, look), splats, camera, settings, until)


def _beside(
    renderer: sg.Renderer,
    label: tuple[str, str],
    splats: sg.Splats,
    camera: sg.Camera,
    settings: sg.Settings,
    until: float,
) -> Iterator[Frame]:
    """A picture by each technique that draws it."""
    right, bound = None, 0.0
    for technique in TECHNIQUES:
        chosen = settings.but(technique=technique)
        try:
            renderer.plan(splats, camera, chosen)
        except InputError:
            # OpenGL without compute shaders
            continue
        if time.monotonic() > until:
            return

        def draw(chosen: sg.Settings = chosen) -> sg.Image:
            return renderer.render(splats, camera, chosen, verify_bound=False)

        first, image = timed(draw)
        times: list[float] = []
        while len(times) < ROUNDS and (not times or (time.monotonic() < until and sum(times) < MOST / 60)):
            times.append(timed(draw)[0])
        own = image.info["error_bound"]
        own = own if isinstance(own, float) else UNBOUND
        apart = 0.0 if right is None else float(np.abs(image.pixels - right).max())
        allowed = own + bound
        if right is None:
            right, bound = image.pixels, own
        seconds = statistics.median(times)
        yield Frame(*label, camera.size[0], technique, len(splats), first, seconds, apart, allowed)


def timed(work: Callable[[], Any]) -> tuple[float, Any]:
    """Seconds that it takes, and what it returns."""
    start = time.perf_counter()
    found = work()
    return time.perf_counter() - start, found


def tests(limit: float, card: bool) -> dict[str, Any]:
    """Outcome of the tests that need OpenGL, printed too. card: refuses software OpenGL."""
    environment = os.environ | ({"SPLATGL_REQUIRE_GPU": "1"} if card else {})
    files = [f"tests/test_{name}.py" for name in TESTED]
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-m", "not long", *files]
    with TemporaryDirectory() as folder:
        log = Path(folder) / "log"
        with log.open("w") as file:
            process = subprocess.Popen(command, stdout=file, stderr=subprocess.STDOUT, cwd=ROOT, env=environment)
            try:
                code: int | None = process.wait(limit)
            except subprocess.TimeoutExpired:
                process.terminate()
                process.wait()
                code = None
        lines = log.read_text(errors="replace").splitlines()
    failed = [line.removeprefix("FAILED ") for line in lines if line.startswith("FAILED ")]
    if code not in (0, None) and not failed:
        failed = lines[-1:]
    ended = "passed" if code == 0 else "ran out of time" if code is None else "FAILED"
    print("\n".join([*failed, f"tests {ended}: {lines[-1] if lines else ''}"]))
    return {"ended": ended, "failed": failed}


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
    """Exit code 0 if everything is right, 1 if not, 2 if there is no graphics card."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("-o", "--output", default="gpu_check.json", metavar="FILE", help="JSON (gpu_check.json)")
    parser.add_argument("--short", action="store_true", help="small pictures, no tests: seconds")
    parser.add_argument("--software", action="store_true", help="also if only software OpenGL is there")
    args = parser.parse_args(arguments)
    until = time.monotonic() + MOST
    try:
        with sg.Renderer(require_gpu=not args.software) as renderer:
            told = measured(renderer, args.short, until - (0 if args.short else TESTS))
    except InputError as error:
        print(error, file=sys.stderr)
        return 2
    if not args.short:
        told["tests"] = tests(max(until - time.monotonic(), 1.0), not args.software)
        told["right"] &= not told["tests"]["failed"]
    half = Path(f"{args.output}.{os.getpid()}")
    half.write_text(json.dumps(told, indent=1))
    half.replace(args.output)
    print(f"{args.output}: {'everything is right' if told['right'] else 'something is WRONG'}")
    return 0 if told["right"] else 1


def measured(renderer: sg.Renderer, short: bool, until: float) -> dict[str, Any]:
    """What the driver computes, and all frames; printed as they come."""
    print(f"{renderer.info}\n{platform.platform()}, {os.cpu_count()} cores")
    checks = run_checks(renderer.ctx)
    for check in checks:
        word = "ok" if check.passed else "WRONG" if check.required else "coarse"
        print(f"  {check.name:18} {word:6} {check.got:.6f}, exact {check.answer:.6f}")
    found = []
    for frame in frames(renderer, short, until):
        print(frame, flush=True)
        found.append(frame)
    ratios = slower(found)
    for look, ratio in ratios.items():
        print(f"{look}: quads take {ratio:.2f} times as long as tiles")
    return {
        "renderer": asdict(renderer.info),
        "machine": platform.platform(),
        "right": all(check.passed for check in checks if check.required) and all(frame.right for frame in found),
        "checks": [asdict(check) | {"passed": bool(check.passed)} for check in checks],
        "frames": [asdict(frame) | {"right": frame.right} for frame in found],
        "quads over tiles": ratios,
    }


if __name__ == "__main__":
    sys.exit(main())
