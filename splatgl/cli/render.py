"""`splatgl render`: draws a picture, a depth map, or both."""

from __future__ import annotations

import argparse
import time
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING
from uuid import uuid4

import numpy as np

from splatgl import __version__
from splatgl.cli.options import (
    ANNOTATE,
    add_drawing,
    add_option,
    add_source,
    add_workers,
    asked,
    group_of,
    scene_from,
)
from splatgl.cli.output import summary
from splatgl.data.image import MAPS, SAVED, Image, save_map
from splatgl.data.image_files import require_library
from splatgl.data.volume import Volume
from splatgl.errors import InputError, expected
from splatgl.fileio import check_output, check_source, parse_bytes
from splatgl.options import ACCURACY, SPEED, whole
from splatgl.scene.background import as_drawn, backed
from splatgl.scene.draw import (
    OF_BLENDS,
    DrawOptions,
    _work_bar,
    asked_for,
    depth_share,
    depths_of,
    draw,
    lay,
    nothing,
    origin,
    tell,
    unbacked,
    with_room,
)
from splatgl.scene.meshes import is_mesh
from splatgl.scene.scene_file import SceneFile
from splatgl.splat.settings import BLENDS
from splatgl.splat.transfer import Transfer

if TYPE_CHECKING:
    from splatgl.comparison.compare import Picture


def depth_at(text: str) -> float | str:
    """An argparse type."""
    try:
        return text if text in OF_BLENDS.values() else float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"expected a share from 0 to below 1, max or min, got {text!r}") from None


def check_depth(args: argparse.Namespace, scene: SceneFile) -> None:
    """InputError, before any work, for a map that can't be written."""
    if args.depth is None:
        if args.depth_at is not None:
            raise expected("--depth-at", "a file for the depths", "none", "add --depth depth.npy")
        return
    path = Path(args.depth)
    check_output(path, MAPS)
    require_library(path.suffix.lower())
    check_source(path, args.source, *scene.files, args.output, args.ref)
    if args.output is not None and path.absolute() == Path(args.output).absolute():
        raise expected("--depth", "another file than -o", str(path))


def write_depths(args: argparse.Namespace, scene: SceneFile, volume: Volume, transfer: Transfer) -> bool:
    """Writes the map that is asked for, and tells its range; whether nothing else is to be drawn."""
    if args.depth is None:
        return False
    started = time.perf_counter()
    at = depth_share(args.depth_at, scene.settings)
    alone = args.output is None and args.ref is None
    found, camera = depths_of(scene, volume, transfer, at, args.quiet or not alone)
    unit = volume.unit or "units"
    told = {"version": __version__, "source": Path(scene.volume).name, "depth_at": at, "unit": unit}
    view = {"eye": camera.eye.tolist(), "forward": camera.forward.tolist(), "perspective": camera.perspective}
    save_map(found, args.depth, {**told, **view})
    if not args.quiet:
        known = found[np.isfinite(found)]
        span = f"{known.min():g} to {known.max():g} {unit}" if len(known) else "none"
        seconds = time.perf_counter() - started
        print(f"{args.depth}: depths {span} in {known.size / found.size:.1%} of the pixels ({seconds:.2g} s)")
    return alone


# what draws and compares is imported once there is something to draw: bad input is told at once


EXAMPLES = """examples:
  splatgl render head.nii.gz -o head.png
  splatgl render head.nii.gz --preset ct-bone --azimuth 60 --background black
  splatgl render head_64x256x256_uint8.raw --blend xray -o sums.npy"""


def add_parser(parser: argparse.ArgumentParser) -> None:
    """Adds the options of `splatgl render`."""
    parser.description = f"{parser.description}\n\n{EXAMPLES}"
    add_source(parser)
    parser.add_argument("-o", "--output", metavar="FILE", help=".png, .jpg, .npy, .tif or .exr (default SOURCE.png)")
    add_option(parser, "annotate", ANNOTATE)
    parser.add_argument("--quiet", action="store_true", help="no summary and no progress bar")
    output = group_of(parser, "output")
    output.add_argument(
        "--bits", type=int, choices=(8, 16), default=8, metavar="8|16", help="bits a sample of a PNG (default 8)"
    )
    about = "write the depth at which each pixel's ray is absorbed: .npy, .tif, .exr or .png (without -o: only that)"
    output.add_argument("--depth", metavar="FILE", help=about)
    about = "share absorbed at that depth, 0 to 1, or largest or least value (default 0.5; max for mip, min for minip)"
    output.add_argument("--depth-at", type=depth_at, metavar="SHARE|max|min", help=about)
    about = "compare with this picture; write only if it differs, and exit with 1"
    output.add_argument("--ref", metavar="FILE", help=about)
    accuracy = group_of(parser, ACCURACY)
    about = "number of rows to compare with float64 (0: none; default: some squares, with --field or without a bound)"
    accuracy.add_argument("--check", type=whole(0).parse, metavar="ROWS", help=about)
    about = "also compare some of these pixels with the field that the picture stands for"
    accuracy.add_argument("--field", action="store_true", help=about)
    accuracy.add_argument("--explain", action="store_true", help="print what is drawn, what is left out, and why")
    speed = group_of(parser, SPEED)
    speed.add_argument("--savings", action="store_true", help="also measure the time saved by each skipped step")
    about = "draw volumes that need more memory in bricks, such as 4GiB (default: half of the free memory)"
    speed.add_argument("--memory", type=_bytes, metavar="SIZE", help=about)
    add_workers(parser)
    add_drawing(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Renders an image and prints a summary; returns 0, or 1 if it differs from --ref."""
    on_workers = asked(args)
    scene = scene_from(args)
    output = Path(args.output or f"{Path(args.source).name.split('.')[0]}.png")
    check_output(output, SAVED)
    require_library(output.suffix.lower())
    check_source(output, args.source, *scene.files)
    check_depth(args, scene)
    annotate = asked_for(args.annotate, args.ref, scene)
    reference = _reference(args.ref, output) if args.ref else None
    volume = scene.open()
    tell(volume, args.quiet, channels=not on_workers)
    transfer = scene.transfer_for(volume)
    scene = backed(args, scene.cut(volume), as_drawn(volume, transfer), output, reference.image if reference else None)
    if write_depths(args, scene, volume, transfer):
        return 0
    scene = with_room(scene, volume, annotate)
    drawn_as = replace(scene, settings=unbacked(scene.settings, annotate))
    if on_workers:
        image = _on_workers(args, drawn_as, volume, transfer)
    else:
        image = draw(DrawOptions.of(args), drawn_as, volume, transfer)
    image = Image(image.pixels, {**image.info, **origin(scene, transfer)})
    behind = scene.settings.background if BLENDS[scene.settings.blend].unbounded else None
    ended = 0
    if reference is not None:
        from splatgl.cli.compare import DIFFERENT, SAME, check_against

        verdict = check_against(image, reference, output, behind)
        if not (verdict.same and args.quiet):
            print(verdict)
        if verdict.same:
            return SAME
        ended = DIFFERENT
    if annotate:
        image = lay(image, scene, volume, transfer, annotate, args.quiet)
    image.save(output, args.bits, behind)
    if not args.quiet:
        print(summary(output, image, scene, volume, transfer))
    return ended


def _on_workers(args: argparse.Namespace, scene: SceneFile, volume: Volume, transfer: Transfer) -> Image:
    """The image, drawn in parts by workers of Dask."""
    from splatgl.cli.options import drawing_of
    from splatgl.distributed.cluster import connected
    from splatgl.distributed.render import Job, draw_parts
    from splatgl.splat.opaque_bounds import Opaque

    for name in ("check", "field", "savings", "explain"):
        if getattr(args, name):
            raise expected(f"--{name}", "a picture that is drawn by this process", "--workers or --scheduler")
    meshes = len(scene.meshes) + scene.vectors.drawn + is_mesh(scene.volume)
    cues = [(f"--{name.replace('_', '-')}", getattr(scene.settings, name)) for name in ("ambient_occlusion", "shadows")]
    told = (*cues, ("--threshold", scene.threshold), ("layers", len(scene.layers)), ("meshes", meshes))
    told = (*told, ("--surfaces", scene.surfaces is not None))
    for what, given in told:
        if given:
            raise expected(what, "none, with --workers or --scheduler", given)
    camera = scene.view.camera(volume, Opaque(volume, transfer))
    job = Job(uuid4().hex, scene.anywhere().open, transfer, scene.settings, drawing_of(args), camera, args.memory)
    tell = None if args.quiet else print
    with connected(args.workers, args.scheduler, tell) as client, _work_bar(args.quiet, "part") as bar:
        image = draw_parts(client, job, None, bar, args.check is None)
    if not image.info["splats"]:
        raise nothing(scene, volume)
    return image


def _bytes(text: str) -> int:
    try:
        return parse_bytes(text)
    except InputError as error:
        raise argparse.ArgumentTypeError(str(error).removeprefix("memory: ")) from None


def _reference(name: str, output: Path) -> Picture:
    """The picture to compare with; InputError if it is missing, or would be overwritten."""
    from splatgl.cli.compare import check_apart
    from splatgl.comparison.compare import read

    found = read(name)
    check_apart(output, Path(name))
    return found
