"""`splatgl animate`: frames or a movie of a rotating volume, of keyframes, or of a time series of volumes."""

from __future__ import annotations

import argparse
from pathlib import Path

from splatgl.animation.animation import FRAMES, FULL_TURN, Animation, Frames, draw_frames
from splatgl.animation.movie import need, write_movie
from splatgl.cli.options import (
    add_drawing,
    add_source,
    add_workers,
    drawing_of,
    for_output,
    record_of,
    scene_from,
    uses_workers,
)
from splatgl.errors import expected
from splatgl.fileio import check_source
from splatgl.options import Kind
from splatgl.scene.draw import DrawOptions

FPS = 30.0
# shortest movie of a series, seconds
SHORTEST = 2.0
MAX_FRAMES = 1_000_000
# a GIF frame lasts at most 655 s
MIN_FPS, MAX_FPS = 0.01, 1000.0
# most degrees or time units per frame; beyond it sines lose all precision
MAX_PACE = 1e9
BLACK = (0.0, 0.0, 0.0)


def add_parser(parser: argparse.ArgumentParser) -> None:
    """Adds the options of `splatgl animate`."""
    add_source(parser)
    parser.add_argument("more", nargs="*", metavar="SOURCE", help="further volumes, or a pattern: a series in time")
    parser.add_argument(
        "-o", "--output", metavar="FILE", required=True, help="frames/{frame:04d}.png or .npy, movie.mp4, .webm or .gif"
    )
    group = parser.add_argument_group("animation")
    group.add_argument(
        "--frames", type=int, metavar="N", help=f"number of frames of the whole animation (default {FRAMES})"
    )
    group.add_argument("--only", type=_span, metavar="A-B", help="draw only frames A to B, counted from 0")
    group.add_argument(
        "--turntable",
        type=float,
        metavar="DEG",
        help=f"total angle of a camera that orbits the volume (default {FULL_TURN:g})",
    )
    group.add_argument("--spin", type=float, metavar="DEG", help="rotation of the volume per frame")
    group.add_argument(
        "--axis",
        type=Kind.numbers(3, "X,Y,Z").parse,
        metavar="X,Y,Z",
        help="axis of rotation through the centre (default: up)",
    )
    group.add_argument(
        "--keyframes", metavar="FILE.toml", help="views of some frames; the frames between are interpolated"
    )
    group.add_argument(
        "--hold", type=int, default=1, metavar="N", help="frames for each volume of a series (default 1)"
    )
    group.add_argument("--moments", type=int, metavar="N", help="number of pictures whose mean is a frame")
    group.add_argument(
        "--shutter",
        type=float,
        metavar="DEG",
        help="time that the shutter is open, 360 for a whole frame (default 180)",
    )
    group.add_argument(
        "--flow",
        type=float,
        metavar="F",
        help="motion blur along the vectors of the volume, F times their length per frame",
    )
    about = f"frames per second of a movie (default {FPS:g}, fewer for a short series: at least {SHORTEST:g} s)"
    group.add_argument("--fps", type=float, metavar="N", help=about)
    group.add_argument("--resume", action="store_true", help="keep frames that exist")
    about = "scale,colorbar,axes,directions,box,title=TEXT,time=TEXT; time: of each volume of a series"
    parser.add_argument("--annotate", metavar="NAMES", help=about)
    parser.add_argument(
        "--bits", type=int, choices=(8, 16), default=8, metavar="8|16", help="bits a sample (default 8)"
    )
    parser.add_argument("--quiet", action="store_true", help="no summary and no progress bar")
    add_workers(parser)
    add_drawing(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Renders the requested frames that do not exist yet; returns 0."""
    _check(args)
    on_workers = uses_workers(args)
    animation = Animation.of(for_output(scene_from(args), Path(args.output)), args)
    frames = Frames.at(args.output, animation.mark)
    if frames.movie:
        need(frames.movie)
    wanted = animation.numbers
    sources = [file for scene in animation.scenes for file in scene.files]
    for n in wanted:
        check_source(frames.path(n), *sources)
    frames.sweep(wanted)
    todo = [n for n in wanted if not (args.resume and frames.done(n))]
    if todo and on_workers:
        from splatgl.distributed.cluster import connected

        with connected(args.workers, args.scheduler, None if args.quiet else print) as client:
            draw_frames(client, animation, frames, todo, drawing_of(args), args.quiet)
    elif todo:
        with record_of(args, DrawOptions).renderer() as renderer:
            animation.draw(renderer, frames, todo, args.quiet)
    if frames.movie:
        ground = animation.scenes[0].settings.background or BLACK
        fps = args.fps or _fps(animation)
        write_movie(frames.movie, [frames.path(n) for n in wanted], fps, ground)
        frames.clear(wanted)
    if not args.quiet:
        resumed = f", {len(wanted) - len(todo)} of them existed" if len(todo) < len(wanted) else ""
        names = dict.fromkeys(str(frames.movie or frames.path(n)) for n in (wanted[0], wanted[-1]))
        print(f"{' to '.join(names)}: {len(wanted)} frames{resumed}")
    return 0


def _check(args: argparse.Namespace) -> None:
    """Raises InputError for invalid numbers and for conflicting motions."""
    given = [f"--{name}" for name in ("turntable", "spin", "keyframes") if getattr(args, name) is not None]
    if len(given) > 1:
        raise expected("animate", "one of --turntable, --spin and --keyframes", " and ".join(given))
    for name, low, high in (("frames", 1, MAX_FRAMES), ("hold", 1, MAX_FRAMES)):
        value = getattr(args, name)
        if value is not None and not low <= value <= high:
            raise expected(f"--{name}", f"a whole number from {low} to {high}", value)
    if args.fps is not None and not MIN_FPS <= args.fps <= MAX_FPS:
        raise expected("--fps", f"a number from {MIN_FPS:g} to {MAX_FPS:g}", args.fps)
    for name in ("turntable", "spin", "flow"):
        value = getattr(args, name)
        if value is not None and not abs(value) <= MAX_PACE:
            raise expected(f"--{name}", f"a number from {-MAX_PACE:g} to {MAX_PACE:g}", value)


def _fps(animation: Animation) -> float:
    """Default frames per second: fewer for a short series, so that it can be followed."""
    return min(FPS, animation.count / SHORTEST) if len(animation.scenes) > 1 else FPS


def _span(text: str) -> tuple[int, int]:
    first, _, last = text.partition("-")
    if not (first.isdecimal() and (last or first).isdecimal() and int(first) <= int(last or first)):
        raise argparse.ArgumentTypeError(f"expected A-B, such as 10-19, got {text!r}")
    return int(first), int(last or first)
