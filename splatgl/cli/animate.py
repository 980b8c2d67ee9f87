"""`splatgl animate`: frames or a movie of a rotating volume, of keyframes, or of a time series of volumes."""

from __future__ import annotations

import argparse

from splatgl.animation.animation import Animation, Timeline
from splatgl.animation.api import FPS, SHORTEST, check_fps, timeline_of, with_blur, write_animation
from splatgl.animation.movie import expanded, volumes
from splatgl.cli.options import add_drawing, add_source, record_of, require_sources, scene_from
from splatgl.cli.parser import JoinList, add_options, group_of
from splatgl.options import HelpGroup
from splatgl.scene.draw import DrawOptions, WorkerOptions
from splatgl.splat.settings import Settings


def add_parser(parser: argparse.ArgumentParser) -> None:
    """Adds the options of `splatgl animate`."""
    add_source(parser)
    parser.add_argument(
        "more", nargs="*", default=[], metavar="SOURCE", help="further volumes, or a pattern: a series in time"
    )
    parser.add_argument(
        "-o", "--output", metavar="FILE", required=True, help="frames/{frame:04d}.png or .npy, movie.mp4, .webm or .gif"
    )
    group = group_of(parser, HelpGroup.ANIMATION)
    add_options(parser, Timeline)
    add_options(parser, Settings, "moments", "shutter")
    about = f"frames per second of a movie (default {FPS:g}, fewer for a short series: at least {SHORTEST:g} s)"
    group.add_argument("--fps", type=float, metavar="N", help=about)
    group.add_argument("--resume", action="store_true", help="keep frames that exist")
    about = "scale,colorbar,legend,axes,directions,box,title=TEXT,time=TEXT; time: of each volume of a series"
    parser.add_argument("--annotate", action=JoinList, metavar="NAMES", help=about)
    parser.add_argument(
        "--bits", type=int, choices=(8, 16), default=8, metavar="8|16", help="bits a sample (default 8)"
    )
    parser.add_argument("--quiet", action="store_true", help="no summary and no progress bar")
    add_options(parser, DrawOptions, "explain")
    add_options(parser, WorkerOptions)
    add_options(parser, DrawOptions, "memory")
    add_drawing(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Renders the requested frames that do not exist yet; returns 0."""
    timeline, by = record_of(args, Timeline), record_of(args, WorkerOptions)
    check_fps(args.fps, "--fps")
    scene = scene_from(args)
    timeline, fps = timeline_of(scene, timeline, args.fps)
    require_sources(expanded(args.more))
    scenes = volumes(with_blur(scene, args.shutter), args.more)
    animation = Animation.of(scenes, timeline, args.time, args.bits, args.quiet)
    how = record_of(args, DrawOptions)
    files, existing = write_animation(animation, args.output, by, how, fps, args.resume, args.quiet)
    if not args.quiet:
        resumed = f", {existing} of them existed" if existing else ""
        names = dict.fromkeys(map(str, (files[0], files[-1])))
        print(f"{' to '.join(names)}: {len(animation.numbers)} frames{resumed}")
    return 0
