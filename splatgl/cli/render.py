"""`splatgl render`: draws a picture, a depth map, or both."""

from __future__ import annotations

import argparse
import time
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from splatgl import __version__
from splatgl.animation.movie import is_pattern
from splatgl.cli.options import ON_PAPER, add_drawing, add_source, record_of, scene_from
from splatgl.cli.output import OutputOptions
from splatgl.cli.parser import add_options, group_of
from splatgl.data.color import AUTO
from splatgl.data.image import Image, save_map
from splatgl.errors import expected
from splatgl.options import HelpGroup, declared, names_of
from splatgl.scene.draw import DrawOptions, WorkerOptions, depths_of, draw, draw_on_workers
from splatgl.scene.open_scene import OpenScene
from splatgl.scene.scene_file import SceneFile
from splatgl.scene.view import ViewOptions

if TYPE_CHECKING:
    from splatgl.comparison.pictures import Picture
    from splatgl.data.color import Color


def depth_at(text: str) -> float | str:
    """An argparse type."""
    try:
        return text if text in ("max", "min") else float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"expected a share from 0 to below 1, max or min, got {text!r}") from None


def write_depths(scene: OpenScene, path: str, at: float | str | None) -> None:
    """Writes a depth map, and prints its range. at: as of `depths`."""
    from splatgl.reference.depth_pick import HALF

    started = time.perf_counter()
    camera, settings = scene.camera, scene.file.settings
    depth = depths_of(scene, at)
    share = (settings.join if settings.shows_value else HALF) if at is None else at
    unit = scene.volume.unit or "units"
    info = {"version": __version__, "source": Path(scene.file.volume).name, "depth_at": share, "unit": unit}
    view = {"eye": camera.eye.tolist(), "forward": camera.forward.tolist(), "perspective": camera.perspective}
    save_map(depth, path, {**info, **view})
    if not scene.is_quiet:
        known = depth[np.isfinite(depth)]
        span = f"{known.min():g} to {known.max():g} {unit}" if len(known) else "none"
        seconds = time.perf_counter() - started
        print(f"{path}: depths {span} in {known.size / depth.size:.1%} of the pixels ({seconds:.2g} s)")


# modules that draw and compare are imported after the options are checked: bad input is reported at once


EXAMPLES = """examples:
  splatgl render head.nii.gz -o head.png
  splatgl render head.nii.gz --preset ct-bone --azimuth 60 --background black
  splatgl render head_64x256x256_uint8.raw --blend xray -o sums.npy"""


# the value of --field without a number
CHECK = object()


def add_parser(parser: argparse.ArgumentParser) -> None:
    """Adds the options of `splatgl render`."""
    parser.description = f"{parser.description}\n\n{EXAMPLES}"
    add_source(parser)
    parser.add_argument(
        "more", nargs="*", default=[], metavar="SOURCE", help="more sources, or a pattern: one picture per source"
    )
    about = ".png, .jpg, .svg, .pdf, .npy, .tif or .exr (default SOURCE.png); of several sources with {name}"
    parser.add_argument("-o", "--output", metavar="FILE", help=about)
    add_options(parser, SceneFile, "annotate", "slices", "label_fill")
    parser.add_argument("--quiet", action="store_true", help="no summary and no progress bar")
    output = group_of(parser, HelpGroup.OUTPUT)
    add_options(parser, ViewOptions, *ON_PAPER)
    about = "use one camera, of the first source, and one transfer function, of the source whose values vary most"
    output.add_argument("--same", action="store_true", help=about)
    output.add_argument("--sheet", metavar="FILE", help="also write one picture of all, with the names of their files")
    output.add_argument("--json", action="store_true", help="print one line of JSON per picture instead of a summary")
    output.add_argument(
        "--bits", type=int, choices=(8, 16), default=8, metavar="8|16", help="bits a sample of a PNG (default 8)"
    )
    about = "write the depth at which each pixel's ray is absorbed: .npy, .tif, .exr or .png (without -o: only that)"
    output.add_argument("--depth", metavar="FILE", help=about)
    about = (
        "share absorbed at that depth, 0 to 1, or maximum or minimum value (default 0.5; max for mip, min for minip)"
    )
    output.add_argument("--depth-at", type=depth_at, metavar="SHARE|max|min", help=about)
    about = "compare with this picture; write only if it differs, and exit with 1"
    output.add_argument("--ref", metavar="FILE", help=about)
    add_options(parser, DrawOptions, *(name for name in names_of(DrawOptions) if name != "check_field"))
    # --field N picks the field of a plate's well, --field alone compares with the field that the picture shows
    number = parser._option_string_actions["--field"]
    number.nargs, number.const = "?", CHECK
    number.help = f"{number.help}; without a number: {declared(DrawOptions)['check_field'].help}"
    add_options(parser, WorkerOptions)
    add_drawing(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Renders images and prints summaries; returns 0, 1 if one differs from --ref, or 2 if one of several failed."""
    args.check_field = args.field is CHECK or None
    args.field = None if args.check_field else args.field
    output, how = record_of(args, OutputOptions), record_of(args, DrawOptions)
    by, sources, scene_of = record_of(args, WorkerOptions), (args.source, *args.more), partial(scene_from, args)
    if args.more or is_pattern(args.source) or "{" in (args.output or ""):
        from splatgl.cli.batch import run_batch

        return run_batch(sources, scene_of, output, how, by)
    if output.same or output.sheet:
        raise expected("--same" if output.same else "--sheet", "several sources", "one")
    file, reference = scene_of(args.source), None
    output.check(file.files)
    if output.ref:
        if args.annotate is not None:
            raise expected("annotate", "no --ref, which compares pictures without annotations", output.ref)
        reference = _reference(output.ref, output.path)
        file = replace(file, annotate=())
        if args.background is None and file.settings.background == AUTO:
            file = replace(file, settings=replace(file.settings, background=_behind(reference.image)))
    return render(file, output, how, by, reference)


def render(
    file: SceneFile, output: OutputOptions, how: DrawOptions, by: WorkerOptions, reference: Picture | None
) -> int:
    """Renders the picture of a scene, writes it and prints its summary; returns 0, or 1 if it differs from a reference,
    beside which it is written only then.
    """
    scene = OpenScene.read(file, output.is_quiet)
    if file.slices:
        _check_slices(output, how, by)
    if output.depth is not None:
        write_depths(scene, output.depth, output.depth_at)
        if output.output is None and reference is None:
            return 0
    image = draw_on_workers(scene, how, by) if by.are_used else draw(scene, how)
    image = image.with_accuracy()
    status = 0 if reference is None else _compare(image, reference, output)
    if reference is not None and status == 0:
        return status
    image.save(output.path, output.bits)
    if text := output.report(image, scene):
        print(text)
    return status


def _behind(reference: Image) -> Color | str | None:
    """The background of a reference: as its provenance states, else the default one of an opaque picture."""
    match reference.info.get("background", AUTO):
        case [float() | int() as red, float() | int() as green, float() | int() as blue]:
            return red, green, blue
        case "auto" if (reference.pixels[..., 3] == 1).all():
            return AUTO
    return None


def _check_slices(output: OutputOptions, how: DrawOptions, by: WorkerOptions) -> None:
    """Raises InputError for options of pictures in space beside --slice."""
    others = {"--depth": output.depth, "--workers": by.workers, "--scheduler": by.scheduler, "--explain": how.explain}
    for name, value in {**others, "--savings": how.savings, "--field": how.check_field}.items():
        if value:
            raise expected("--slice", f"no {name} beside it", value, "--slice-plane shows a slice in space")


def _compare(image: Image, reference: Picture, output: OutputOptions) -> int:
    """Compares with --ref, and prints the verdict; returns 0, or 1 for a different picture."""
    from splatgl.cli.compare import check_against
    from splatgl.comparison.pairs import DIFFERENT, SAME

    verdict = check_against(image, reference, output.path)
    if not (verdict.same and output.is_quiet):
        print(verdict)
    return SAME if verdict.same else DIFFERENT


def _reference(name: str, output: Path) -> Picture:
    """Reads the picture of --ref. Raises InputError if it is missing, or would be overwritten."""
    from splatgl.cli.compare import check_apart
    from splatgl.comparison.pictures import read

    reference = read(name)
    check_apart(output, Path(name))
    return reference
