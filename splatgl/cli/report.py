"""`splatgl report`: measures error against run time."""

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

from splatgl import __version__
from splatgl.cli.options import add_backend, record_of
from splatgl.data.scenes import SCENES
from splatgl.errors import InputError, expected
from splatgl.opengl import OpenGL
from splatgl.options import declared
from splatgl.report.methods import AXES, add_kernel, methods
from splatgl.report.sweep import LEVELS, EffortLevel, ReportSubject, Sweep, Truths
from splatgl.scene.draw import terminal_bar
from splatgl.splat.settings import Settings

if TYPE_CHECKING:
    from splatgl.report.sweep import Tick


# default sources
DEFAULT_SCENES = ("tunnel", "terrain", "nerve")
INTERRUPTED = 130
# maximum pixels per side, since references take several rays per pixel; and maximum rounds
MAX_SIZE, MAX_ROUNDS = 16384, 10_000


def add_parser(parser: argparse.ArgumentParser) -> None:
    """Adds the options of `splatgl report`."""
    parser.add_argument("sources", nargs="*", metavar="SOURCE", help="built-in scenes, files, scene.toml (the paper's)")
    parser.add_argument("-o", "--output", metavar="DIR", default="report", help="folder to write into (default report)")
    level = parser.add_mutually_exclusive_group()
    level.add_argument("--quick", action="store_true", help="small pictures and coarse volumes, in under a minute")
    level.add_argument(
        "--full", action="store_true", help="all methods and pixels of full volumes, however long they take"
    )
    parser.add_argument("--only", nargs="+", action="extend", default=[], metavar="NAME", help="only these")
    kind = declared(Settings)["kernel"].kind
    about = "also measure a kernel: a name, or MODULE:NAME of Python, which runs that module's code"
    parser.add_argument("--kernel", type=kind.parse, metavar=kind.metavar, help=about)
    parser.add_argument("--size", type=int, metavar="N", help="pixels along each side of a picture")
    parser.add_argument("--rounds", type=int, metavar="N", help="number of timings of each method")
    parser.add_argument("--list", action="store_true", help="list the methods, and draw nothing")
    parser.add_argument("--quiet", action="store_true", help="no progress bar and no summary")
    add_backend(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Measures and writes the report; returns 0, or 130 after Ctrl-C, with a report of the completed part."""
    if args.kernel is not None:
        add_kernel(args.kernel)
    if args.list:
        print(list_methods())
        return 0
    level, known = _level(args), {*methods(), *AXES}
    for name in args.only:
        if name not in known:
            raise expected("--only", "methods or axes of splatgl report --list", repr(name))
    folder = _folder(args.output)
    # an unreadable source must leave no folder behind
    subjects = open_subjects(args.sources or DEFAULT_SCENES, level)

    from splatgl.cli.doctor import machine
    from splatgl.gl.renderer import open_renderer
    from splatgl.gl.target import check_size
    from splatgl.report.page import publish, strip

    ended, scenes, strips, wanted = 0, [], {}, level.methods(args.only)
    with open_renderer(record_of(args, OpenGL)) as renderer:
        for subject in subjects:
            check_size(renderer.ctx, subject.camera.size)
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InputError(f"{folder}: cannot be created: {error.strerror or error}") from error
        try:
            with _progress(len(subjects) * len(wanted) * (1 + level.rounds), args.quiet) as tick:
                for subject in subjects:
                    truths = Truths(renderer, subject, level)
                    sweep = Sweep(truths)
                    scenes.append(sweep.results)
                    sweep.pictures(wanted, tick)
                    sweep.times(level.rounds, tick)
                    strips[subject.name] = strip(renderer, sweep.results, truths)
        except KeyboardInterrupt:
            print("splatgl: interrupted; the page shows what is done", file=sys.stderr)
            ended = INTERRUPTED
        head = {"version": __version__, "machine": machine(renderer.info)}
    written = publish(scenes, head, level, folder, strips)
    if not args.quiet:
        print("\n".join(written))
    return ended


def _level(args: argparse.Namespace) -> EffortLevel:
    own = [source for source in args.sources if source not in SCENES]
    level = LEVELS["quick" if args.quick else "full" if args.full else "whole" if own else "normal"]
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


def open_subjects(sources: Sequence[str], level: EffortLevel) -> list[ReportSubject]:
    """Scenes of all sources with unique names, valid for files. Raises InputError as `ReportSubject.open`."""
    subjects: list[ReportSubject] = []
    for source in sources:
        subject = ReportSubject.open(source, level)
        taken = {other.name for other in subjects}
        names = chain([subject.name], (f"{subject.name}-{n}" for n in count(2)))
        subjects.append(replace(subject, name=next(name for name in names if name not in taken)))
    return subjects
