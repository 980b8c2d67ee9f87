"""`splatgl animate`: frames or a movie of a rotating volume, of keyframes, or of a time series of volumes."""

from __future__ import annotations

import argparse

from splatgl.animation.animation import FRAMES, FULL_TURN, Animation, Frames, draw_frames
from splatgl.animation.movie import need, write_movie
from splatgl.cli.options import add_drawing, add_source, add_workers, drawing_of, scene_from, uses_workers
from splatgl.errors import expected
from splatgl.fileio import check_source
from splatgl.options import Kind
from splatgl.scene.draw import DrawOptions

FPS = 30.0
# seconds that a series lasts at least
SHORTEST = 2.0
MAX_FRAMES = 1_000_000
# a GIF frame lasts at most 655 s
MIN_FPS, MAX_FPS = 0.01, 1000.0
# maximum degrees or time units per frame: beyond it sines lose all precision
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
    group.add_argument("--frames", type=int, metavar="N", help=f"how many frames there are in all ({FRAMES})")
    group.add_argument("--only", type=_span, metavar="A-B", help="draw these of them, from 0 on")
    group.add_argument(
        "--turntable", type=float, metavar="DEG", help=f"the camera goes around by this in all ({FULL_TURN:g})"
    )
    group.add_argument("--spin", type=float, metavar="DEG", help="the volume turns by this each frame")
    group.add_argument(
        "--axis", type=Kind.numbers(3, "X,Y,Z").parse, metavar="X,Y,Z", help="the axis of both, through the middle (up)"
    )
    group.add_argument("--keyframes", metavar="FILE.toml", help="where the camera is in some frames; between, it goes")
    group.add_argument("--hold", type=int, default=1, metavar="N", help="frames for each volume of a series (1)")
    group.add_argument("--moments", type=int, metavar="N", help="each frame is the mean of N, of parts of its time")
    group.add_argument("--shutter", type=float, metavar="DEG", help="how long it is open (180: half of a frame)")
    group.add_argument("--flow", type=float, metavar="F", help="blur along the volume's vectors, times F, a frame")
    about = f"frames a second of a movie ({FPS:g}; fewer for a short series, which lasts {SHORTEST:g} s)"
    group.add_argument("--fps", type=float, metavar="N", help=about)
    group.add_argument("--resume", action="store_true", help="keep the frames that are there already")
    about = "scale,colorbar,axes,directions,box,title=TEXT,time: that of each volume of a series, or time=TEXT"
    parser.add_argument("--annotate", metavar="NAMES", help=about)
    parser.add_argument("--bits", type=int, choices=(8, 16), default=8, metavar="8|16", help="bits a sample (8)")
    parser.add_argument("--quiet", action="store_true", help="no summary and no progress bar")
    add_workers(parser)
    add_drawing(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Renders the requested frames that do not exist yet; returns 0."""
    _check(args)
    on_workers = uses_workers(args)
    animation = Animation.of(scene_from(args), args)
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
        with DrawOptions(args.backend, args.device, args.gpu).renderer() as renderer:
            animation.draw(renderer, frames, todo, args.quiet)
    if frames.movie:
        ground = animation.scenes[0].settings.background or BLACK
        fps = args.fps or _fps(animation)
        write_movie(frames.movie, [frames.path(n) for n in wanted], fps, ground)
        frames.clear(wanted)
    if not args.quiet:
        kept = f", {len(wanted) - len(todo)} of them there before" if len(todo) < len(wanted) else ""
        names = dict.fromkeys(str(frames.movie or frames.path(n)) for n in (wanted[0], wanted[-1]))
        print(f"{' to '.join(names)}: {len(wanted)} frames{kept}")
    return 0


def _check(args: argparse.Namespace) -> None:
    """InputError for invalid numbers and for conflicting motions."""
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
    """Frames a second, unless given: so few of a short series that it can be followed."""
    return min(FPS, animation.count / SHORTEST) if len(animation.scenes) > 1 else FPS


def _span(text: str) -> tuple[int, int]:
    first, _, last = text.partition("-")
    if not (first.isdecimal() and (last or first).isdecimal() and int(first) <= int(last or first)):
        raise argparse.ArgumentTypeError(f"expected A-B, such as 10-19, got {text!r}")
    return int(first), int(last or first)
