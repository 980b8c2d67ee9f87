"""`splatgl report`: measures error against run time, also on workers of Dask."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from itertools import chain, count
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from splatgl import __version__
from splatgl.cli.options import add_backend, add_options, record_of
from splatgl.comparison.metrics import require_flip
from splatgl.data.halving import halve_volume
from splatgl.data.scenes import FORMULAS
from splatgl.distributed.worker import Drawing, keep_latest, renderer
from splatgl.errors import InputError, expected
from splatgl.options import declared
from splatgl.scene.draw import WorkerOptions, terminal_bar
from splatgl.scene.scene_file import SceneFile
from splatgl.splat.extract import extract
from splatgl.splat.kernels import require_built_in
from splatgl.splat.settings import Settings
from splatgl.splat.splats import Splats
from splatgl.studies.accuracy.content import CONVERGENCE
from splatgl.studies.accuracy.ground_truth import LEVELS, Level, Request, Subject, Truths
from splatgl.studies.accuracy.methods import AXES, add_kernel, methods
from splatgl.studies.accuracy.sweep import Task, truths_of

if TYPE_CHECKING:
    from distributed import Client

    from splatgl.gl.renderer import Renderer
    from splatgl.studies.accuracy.sweep import Results, Tick


# modules that measure and write are imported later: errors in the input are reported at once

# default sources
DEFAULT_SCENES = ("tunnel", "terrain", "nerve")
# folder of computed references
TRUTHS_FOLDER = "truths"
INTERRUPTED = 130
# maximum pixels per side, since references take several rays per pixel; and maximum rounds
MAX_SIZE, MAX_ROUNDS = 16384, 10_000


def add_parser(parser: argparse.ArgumentParser) -> None:
    """Adds the options of `splatgl report`."""
    parser.add_argument("sources", nargs="*", metavar="SOURCE", help="built-in scenes, files, scene.toml (the paper's)")
    parser.add_argument("-o", "--output", metavar="DIR", default="report", help="folder to write into (default report)")
    level = parser.add_mutually_exclusive_group()
    level.add_argument("--quick", action="store_true", help="small pictures and coarse volumes, in under a minute")
    level.add_argument("--full", action="store_true", help="full pictures and volumes, however long they take")
    parser.add_argument("--only", nargs="+", action="extend", default=[], metavar="NAME", help="only these")
    kind = declared(Settings)["kernel"].kind
    about = "also measure a kernel: a name, or MODULE:NAME of Python, which runs that module's code"
    parser.add_argument("--kernel", type=kind.parse, metavar=kind.metavar, help=about)
    parser.add_argument("--peers", action="store_true", help="also measure the ray casters of VTK (extra bench)")
    parser.add_argument("--size", type=int, metavar="N", help="pixels along each side of a picture")
    parser.add_argument("--rounds", type=int, metavar="N", help="number of timings of each method")
    parser.add_argument("--resume", action="store_true", help="continue with the results in DIR")
    parser.add_argument("--list", action="store_true", help="list the methods, and draw nothing")
    parser.add_argument("--quiet", action="store_true", help="no progress bar and no summary")
    add_options(parser, WorkerOptions)
    add_backend(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Measures and writes the report; returns 0, or 130 after Ctrl-C, with a report of the completed part."""
    if args.kernel is not None:
        add_kernel(args.kernel)
    if args.list:
        print(list_methods())
        return 0
    if record_of(args, WorkerOptions).are_used:
        require_built_in(args.kernel or "auto")
    level = _level(args)
    known = {*methods(), *AXES}
    for name in args.only:
        if name not in known:
            raise expected("--only", "methods or axes of splatgl report --list", repr(name))
    return _measure(args, level, args.sources or list(DEFAULT_SCENES), _folder(args.output))


def _measure(args: argparse.Namespace, level: Level, sources: list[str], folder: Path) -> int:
    """Measures, writes the report and returns the exit code."""
    # an unreadable source must neither delete existing results nor leave a folder behind
    scenes = subjects(sources, level)

    from splatgl.cli.doctor import machine
    from splatgl.gl.renderer import Renderer
    from splatgl.gl.target import check_size
    from splatgl.studies.accuracy.export import publish
    from splatgl.studies.accuracy.sweep import NAME, Results, Store, Task, run_task

    ended = 0
    with Renderer(args.backend, args.device, args.gpu) as renderer:
        head = {
            "version": __version__,
            "level": level.name,
            "size": level.size,
            "rounds": level.rounds,
            "sources": [Path(source).name for source in sources],
            "only": args.only,
            "peers": args.peers,
            "machine": machine(renderer.info),
        }
        for scene in scenes:
            check_size(renderer.ctx, scene.camera.size)
        try:
            (folder / TRUTHS_FOLDER).mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InputError(f"{folder}: cannot be created: {error.strerror or error}") from error
        store = Store(folder / NAME, head, args.resume)
        if not args.resume:
            # code changes may invalidate those of an earlier report
            for path in (folder / TRUTHS_FOLDER).glob("*.npy"):
                path.unlink()
        task = Task(level, tuple(args.only), args.peers, _has_flip(), folder / TRUTHS_FOLDER)
        if record_of(args, WorkerOptions).are_used:
            _prepare(args, renderer, sources, scenes, task)
        try:
            with _progress(task.steps(len(scenes)), args.quiet) as tick:
                run_task(renderer, scenes, task, store, tick)
        except KeyboardInterrupt:
            print("splatgl: interrupted; the pages show what is done, --resume goes on", file=sys.stderr)
            ended = INTERRUPTED
        results = Results.of(store)
        strips = {subject.name: _strip(renderer, subject, results, task) for subject in scenes[: len(results.scenes)]}
    written = publish(results, store, folder, strips)
    if not args.quiet:
        print("\n".join(written))
    return ended


def _prepare(
    args: argparse.Namespace, renderer: Renderer, sources: list[str], scenes: list[Subject], task: Task
) -> None:
    """Computes truths on workers, which end before timing starts."""
    by = record_of(args, WorkerOptions)
    with by.connected(None if args.quiet else print) as client:
        count = prepare(client, renderer, sources, scenes, task, by.drawing)
    if not args.quiet:
        print(f"{count} truths by workers; this process measures times afterwards")


def _strip(renderer: Renderer, subject: Subject, results: Results, task: Task) -> str:
    from splatgl.studies.accuracy.export import strip
    from splatgl.studies.accuracy.ground_truth import Truths

    scene = next(scene for scene in results.scenes if scene.name == subject.name)
    return strip(renderer, subject, scene, Truths(renderer, subject, task.level, task.folder))


def _level(args: argparse.Namespace) -> Level:
    level = LEVELS["quick" if args.quick else "full" if args.full else "normal"]
    for name, least, most in (("size", 8, MAX_SIZE), ("rounds", 1, MAX_ROUNDS)):
        value = getattr(args, name)
        if value is not None and not least <= value <= most:
            raise expected(f"--{name}", f"a number of at least {least}, up to {most}", value)
    return replace(level, size=args.size or level.size, rounds=args.rounds or level.rounds)


def _folder(name: str) -> Path:
    """The output folder. Raises InputError for an invalid one before any measurement."""
    folder = Path(name)
    there = next((path for path in (folder, *folder.absolute().parents) if path.exists()), folder)
    if not name or not there.is_dir():
        raise expected(there if name else "--output", "a folder", "a file" if name else repr(name), "give another name")
    if not os.access(there, os.W_OK):
        raise InputError(f"{there}: cannot be written into; give another name to --output")
    return folder


def _has_flip() -> bool:
    try:
        require_flip()
    except InputError:
        return False
    return True


def list_methods() -> str:
    """List of methods as text."""
    lines = []
    for axis in AXES.values():
        lines.append(f"{axis.name}: {axis.about}")
        lines += [f"  {method.name}{'' if method.quick else '  (not with --quick)'}" for method in axis.methods]
    return "\n".join(lines)


@contextmanager
def _progress(steps: int, quiet: bool) -> Iterator[Tick]:
    """A function that takes the description of a step, and shows it and the steps done on a terminal."""
    with terminal_bar(is_quiet=quiet, total=steps, unit="step") as bar:

        def tick(text: str) -> None:
            if bar is not None:
                bar.set_description(text, refresh=False)
                bar.update()

        yield tick


def subjects(sources: Sequence[str], level: Level) -> list[Subject]:
    """Scenes of all sources with unique names, valid for files. Raises InputError as `subject`."""
    scenes: list[Subject] = []
    for source in sources:
        scene = subject(source, level)
        taken = {CONVERGENCE, *(other.name for other in scenes)}
        names = chain([scene.name], (f"{scene.name}-{n}" for n in count(2)))
        scenes.append(replace(scene, name=next(name for name in names if name not in taken)))
    return scenes


def subject(source: str, level: Level) -> Subject:
    """Scene of a source, downsampled to at most the level's number of splats."""
    scene = SceneFile.from_toml(Path(source)) if source.endswith(".toml") else SceneFile(source)
    scene.require_one_volume()
    volume = scene.open()
    transfer, scene = scene.transfer_for(volume), scene.cut(volume)
    splats = extract(volume, transfer, scene.threshold, classification="pre")
    if not len(splats):
        raise expected(source, "voxels that are not transparent", "none", "give a scene.toml with a transfer function")
    camera = replace(scene.view, size=_fit_size(scene.view.size, level.size)).camera(volume, splats)
    formula = FORMULAS.get(scene.volume) if not scene.load else None
    halvings = 0
    # averaged voxels would not be samples of the formula
    while formula is None and level.splats is not None and len(splats) > level.splats and min(volume.shape) > 1:
        joint = halve_volume(volume, bool(transfer.labels))
        fewer = extract(joint, transfer, scene.threshold, classification="pre")
        # thin structures may vanish when averaged with empty voxels
        if not len(fewer):
            break
        volume, splats, halvings = joint, fewer, halvings + 1
    note = f"voxels joined {2**halvings}×{2**halvings}×{2**halvings}" if halvings else ""

    def build(threshold: float, coarse: int, post: str) -> Splats:
        part, least, how = volume, max(threshold, scene.threshold), "post" if post else "pre"
        for _ in range(coarse):
            part = halve_volume(part, bool(transfer.labels))
        return extract(part, transfer, least, classification=how, kernel=post)

    name = Path(source).name.split(".")[0]
    return Subject(name, camera, scene.settings, build, note, (volume, transfer), formula)


def _fit_size(size: tuple[int, int], longest: int) -> tuple[int, int]:
    """The size scaled to `longest` pixels on its longer side."""
    scale = longest / max(size)
    return max(1, round(size[0] * scale)), max(1, round(size[1] * scale))


def prepare(
    client: Client, here: Renderer, sources: Sequence[str], scenes: Sequence[Subject], task: Task, drawing: Drawing
) -> int:
    """Computes missing truths on workers and writes them into the folder; returns their number."""
    from splatgl.distributed.cluster import spread

    truths = {scene.name: Truths(here, scene, task.level, task.folder) for scene in scenes}
    items = []
    for source, scene in zip(sources, scenes, strict=True):
        there = str(Path(source).resolve()) if Path(source).exists() else source
        for request in truths_of(truths[scene.name], task):
            path = truths[scene.name].path(request[0])
            if path is not None and not path.exists():
                items.append((f"{scene.name}: {request[1]}", (there, scene.name, task.level, drawing, request)))
    for _, (name, key, pixels) in spread(client, _truth, items):
        truths[name].write(key, pixels)
    return len(items)


def _truth(source: str, name: str, level: Level, drawing: Drawing, request: Request) -> tuple[str, str, np.ndarray]:
    """On a worker: one truth."""
    scene = keep_latest((source, name, level), lambda: replace(subject(source, level), name=name))
    return name, request[0], Truths(renderer(drawing), scene, level).compute(*request)
