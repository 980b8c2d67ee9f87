"""`splatgl figure` 5, 6, 12, 13 and 14: options of the rendered figures, and drawing them."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from textwrap import fill
from typing import TYPE_CHECKING

from splatgl import __version__
from splatgl.animation.camera_track import Turning
from splatgl.annotations.contact_sheet import encoded
from splatgl.app.figures.metrics import SHUTTER, numbers
from splatgl.app.figures.render import PICTURES, Motioned, PictureFigure, Shown, by_moments, picture
from splatgl.data.image import Image
from splatgl.errors import expected
from splatgl.fileio import check_output, check_source, write_whole
from splatgl.scene.draw import Drawing
from splatgl.scene.parse import size
from splatgl.scene.scene_file import Scene
from splatgl.scene.view import View
from splatgl.splat.camera import Camera
from splatgl.splat.motion import Draw, moments
from splatgl.splat.motion_blur import MOTIONS
from splatgl.splat.resolve import blur
from splatgl.splat.settings import MAX_MOMENTS, Settings
from splatgl.splat.splats import Splats
from splatgl.truth.figures.tables import PAGE

if TYPE_CHECKING:
    from splatgl.gl.renderer import Renderer

MAX_FRAMES = 10_000
# options of rendered figures only
ONLY = ("source", "color", "size", "spin", "frames", "motion", "moments")


def add_pictures(parser: argparse.ArgumentParser) -> None:
    """Adds the source and the options of the rendered figures."""
    names = " ".join(map(str, PICTURES))
    parser.add_argument("source", nargs="?", metavar="SOURCE", help=f"{names}: a volume or scene.toml for the paper's")
    group = parser.add_argument_group(f"rendered figures ({names})")
    group.add_argument("--color", metavar="PICTURE", help="colour picture laid over a height map")
    group.add_argument("--size", type=size, metavar="W×H", help="pixels of each picture")
    group.add_argument("--spin", type=float, metavar="DEG", help="12, 13, 14: degrees a frame")
    group.add_argument("--frames", type=int, metavar="N", help="14: how many frames")
    group.add_argument("--motion", choices=MOTIONS, metavar="|".join(MOTIONS), help="12, 13, 14: blur by streaks")
    group.add_argument("--moments", type=int, metavar="N", help="12, 13, 14: blur by N pictures instead; 0: none")


def refuse(args: argparse.Namespace) -> None:
    """InputError for an option that the other figures do not have."""
    given = [name for name in ONLY if getattr(args, name) is not None]
    if given:
        names = ", ".join(map(str, PICTURES))
        raise expected(f"figure {args.number}", "no picture options", given[0], f"they are for {names}")


def run_picture(args: argparse.Namespace) -> int:
    """Draws, writes or prints one rendered figure; returns 0."""
    figure = _asked(PICTURES[int(args.number)], args)
    output = Path(args.output or f"figure{figure.number}.png")
    drawn = bool(args.output) or not (args.csv or args.text)
    scene = _scene(figure, args)
    pictures, tables = [(output, ".png")] if drawn else [], [(Path(args.csv), ".csv")] if args.csv else []
    for path, suffix in pictures + tables:
        check_output(path, (suffix,))
        check_source(path, args.source, *scene.files)
    with Drawing().renderer() as renderer:
        shown = Shown(figure, scene, renderer.render, _blur(renderer, args))
        if drawn:
            about = figure.caption if args.source is None else f"{figure.caption} Here: {shown.volume.name}."
            write_whole(output, encoded(picture(shown), about, f"splatgl {__version__}"))
            print(f"{output}:", fill(f"Figure {figure.number}. {about}", PAGE), sep="\n")
        if args.csv or args.text:
            table = numbers(shown)
            if args.csv:
                write_whole(Path(args.csv), table.csv().encode())
                print(f"{args.csv}: the numbers of figure {figure.number}")
            if args.text:
                print(fill(f"Figure {figure.number}. {figure.caption}", PAGE), table.text(), sep="\n\n")
    return 0


def _blur(renderer: Renderer, args: argparse.Namespace) -> Motioned | None:
    """Motion blur: streaks if requested, and by default for sums, for which they are exact; else the mean of as many
    images as requested or as the path lengths need; none for 0.
    """
    if args.moments is not None:
        return by_moments(args.moments) if args.moments else None

    def blurred(draw: Draw, track: Turning) -> Draw:
        def one(splats: Splats, camera: Camera, settings: Settings) -> Image:
            asked = settings.but(motion=args.motion or "auto")
            if blur(splats, asked) == "moments":
                # a strip's view is narrow: use the count for the whole image
                whole = replace(camera, size=(camera.size[1], camera.size[1]))
                asked = asked.but(moments=moments(splats, whole, track.turn, SHUTTER))
            return renderer.render(splats, camera, asked, track.turn)

        return one

    return blurred


def _asked(figure: PictureFigure, args: argparse.Namespace) -> PictureFigure:
    """The figure with the options applied; InputError for invalid ones."""
    turns = figure.spin != 0
    for name, allowed in (("spin", turns), ("frames", figure.number == 14), ("motion", turns), ("moments", turns)):
        if getattr(args, name) is not None and not allowed:
            raise expected(f"figure {figure.number}", f"no --{name}", getattr(args, name))
    if args.frames is not None and not 2 <= args.frames <= MAX_FRAMES:
        raise expected("--frames", f"a whole number from 2 to {MAX_FRAMES}", args.frames)
    if args.moments is not None and args.motion is not None:
        raise expected(f"figure {figure.number}", "one of --motion and --moments", "both")
    if args.moments is not None and not 0 <= args.moments <= MAX_MOMENTS:
        raise expected("--moments", f"a whole number from 0 to {MAX_MOMENTS}", args.moments)
    if args.spin is not None and not 0 < abs(args.spin) <= 360:
        raise expected("--spin", "an angle up to 360 degrees, not 0", args.spin)
    return replace(figure, spin=args.spin or figure.spin, frames=args.frames or figure.frames)


def _scene(figure: PictureFigure, args: argparse.Namespace) -> Scene:
    """The requested scene or the paper's; a scene.toml overrides everything it can specify."""
    source = args.source or figure.source
    wanted = args.size or (figure.size, figure.size)
    scene = Scene(source, view=View(size=wanted))
    if Path(source).suffix == ".toml":
        scene = Scene.from_toml(Path(source))
        scene = replace(scene, view=replace(scene.view, size=args.size)) if args.size else scene
    return replace(scene, load={**scene.load, "color": args.color}) if args.color else scene
