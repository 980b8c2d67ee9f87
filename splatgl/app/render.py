"""`splatgl render`: renders one image of a file or a scene."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any
from uuid import uuid4

import numpy as np

from splatgl import __version__
from splatgl.app.backgrounds import ground_of, grounded
from splatgl.app.choices import choices_of
from splatgl.app.options import add_drawing, add_source, scene_from
from splatgl.app.output import check_output
from splatgl.app.scene import Scene
from splatgl.app.worker_options import add_workers, asked
from splatgl.data.errors import InputError, expected
from splatgl.data.image import Image
from splatgl.data.sizes import bytes_of, size_of
from splatgl.data.volume import Volume
from splatgl.splat.classification.transfer import Transfer
from splatgl.splat.plan.blend_mode import BLENDS

# what draws and compares is imported once there is something to draw: bad input is told at once
if TYPE_CHECKING:
    from splatgl.gl.levels import Level
    from splatgl.splat.extraction.splats import Splats
    from splatgl.splat.view.camera import Camera
    from splatgl.truth.compare_read import Picture

# delay of the progress bar in seconds
PATIENCE = 1.0


def add_parser(parser: argparse.ArgumentParser) -> None:
    """Adds the options of `splatgl render`."""
    add_source(parser)
    parser.add_argument("-o", "--output", metavar="FILE", help="picture to write, .png or .npy (default: SOURCE.png)")
    parser.add_argument(
        "--bits", type=int, choices=(8, 16), default=8, metavar="8|16", help="bits a sample of a PNG (8)"
    )
    parser.add_argument("--ref", metavar="FILE", help="compare with this picture; write only if it differs, and exit 1")
    parser.add_argument("--explain", action="store_true", help="say what is drawn, what is left out, and why")
    parser.add_argument("--savings", action="store_true", help="draw with what is left out, and say what that takes")
    parser.add_argument(
        "--check",
        type=int,
        metavar="ROWS",
        help="compare as many rows with float64 (0: none; default: some squares, with --field or without a bound)",
    )
    parser.add_argument(
        "--field",
        action="store_true",
        help="also compare some of these pixels with the field that the picture stands for",
    )
    parser.add_argument(
        "--memory",
        type=_bytes,
        metavar="SIZE",
        help="draw in bricks what needs more, such as 4GiB (half of what is free)",
    )
    parser.add_argument("--quiet", action="store_true", help="no summary and no progress bar")
    add_workers(parser)
    add_drawing(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Renders an image and prints a summary; returns 0, or 1 if it differs from --ref."""
    on_workers = asked(args)
    scene = scene_from(args)
    output = Path(args.output or f"{Path(args.source).name.split('.')[0]}.png")
    check_output(output)
    reference = _reference(args.ref, output) if args.ref else None
    volume = scene.open()
    transfer = scene.transfer_for(volume)
    ground = ground_of(args, scene, None if reference is None else reference.image)
    scene = replace(scene, settings=grounded(scene.settings, ground, transfer, output))
    image = _on_workers(args, scene, volume, transfer) if on_workers else _here(args, scene, volume, transfer)
    image = Image(image.pixels, {**image.info, **origin(scene, transfer)})
    behind = scene.settings.background if BLENDS[scene.settings.blend].unbounded else None
    ended = 0
    if reference is not None:
        from splatgl.app.compare import DIFFERENT, SAME, check_against

        verdict = check_against(image, reference, output, behind)
        if not (verdict.same and args.quiet):
            print(verdict)
        if verdict.same:
            return SAME
        ended = DIFFERENT
    image.save(output, args.bits, behind)
    if not args.quiet:
        print("\n".join([_summary(output, image), *choices_of(scene, volume, transfer, ground)]))
    return ended


def _here(args: argparse.Namespace, scene: Scene, volume: Volume, transfer: Transfer) -> Image:
    """The image, drawn by this process."""
    camera, told = None, dict[str, object]()
    if volume.coarser:
        camera, chosen = _level(args, scene, volume, transfer)
        volume, transfer, told = chosen.volume, chosen.transfer, chosen.info
    image = _in_bricks(args, scene, volume, transfer, camera)
    if image is None:
        splats = scene.splats(volume, transfer, None if args.quiet else _bar)
        if not len(splats):
            raise nothing(scene, volume)
        image = _drawn(args, scene, splats, camera or scene.view.camera(volume, splats))
    return Image(image.pixels, {**image.info, **told})


def _on_workers(args: argparse.Namespace, scene: Scene, volume: Volume, transfer: Transfer) -> Image:
    """The image, drawn in parts by workers of Dask."""
    from splatgl.app.worker_options import drawing_of
    from splatgl.distributed.cluster import connected
    from splatgl.distributed.slabs import Job, draw_parts
    from splatgl.splat.bricks.opaque import Opaque

    for name in ("check", "field", "savings", "explain"):
        if getattr(args, name):
            raise expected(f"--{name}", "a picture that is drawn by this process", "--workers or --scheduler")
    if scene.threshold:
        raise expected("--threshold", "none, with --workers or --scheduler", scene.threshold)
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
        return bytes_of(text)
    except InputError as error:
        raise argparse.ArgumentTypeError(str(error).removeprefix("memory: ")) from None


def _reference(name: str, output: Path) -> Picture:
    """The picture to compare with; InputError if it is missing, or would be overwritten."""
    from splatgl.app.compare import check_apart
    from splatgl.truth.compare_read import read

    found = read(name)
    check_apart(output, Path(name))
    return found


def _level(args: argparse.Namespace, scene: Scene, volume: Volume, transfer: Transfer) -> tuple[Camera, Level]:
    """The camera, and the level of a multiscale image that it takes."""
    from splatgl.gl.levels import just_finer, level_for
    from splatgl.gl.renderer import Renderer
    from splatgl.splat.bricks.opaque import Opaque

    camera = scene.view.camera(volume, Opaque(volume, transfer))
    if just_finer(volume, camera) == 0:
        return camera, level_for(volume, transfer, camera, scene.settings)
    with Renderer(args.backend, args.device, args.gpu) as renderer:
        found = level_for(volume, transfer, camera, scene.settings, renderer)
    if not args.quiet:
        print(found)
    return camera, found


def _in_bricks(
    args: argparse.Namespace, scene: Scene, volume: Volume, transfer: Transfer, camera: Camera | None
) -> Image | None:
    """The image, drawn brick by brick, if it needs more than --memory; else None."""
    from splatgl.splat.bricks.estimate import budget
    from splatgl.splat.bricks.opaque import Opaque
    from splatgl.splat.bricks.within import bricks_of, fits

    bricks = None if scene.threshold else bricks_of(volume, transfer, scene.settings)
    if bricks is None:
        return None
    most = budget() if args.memory is None else args.memory
    need = fits(bricks, scene.view.size, most)
    if need is None:
        return None
    for name in ("check", "field", "savings"):
        if getattr(args, name):
            fix = "give more --memory, or a part of the volume"
            raise expected(f"--{name}", f"a picture that fits into {size_of(most)}", size_of(need.bytes), fix)
    if not args.quiet:
        told = f"up to about {need.most:,} splats need {size_of(need.bytes)}, more than {size_of(most)}"
        if need.bytes <= most:
            told = f"up to about {need.most:,} splats are more than are drawn at once"
        print(f"{told}: drawn in {len(bricks.low):,} bricks, nearest first")
    from splatgl.gl.renderer import Renderer

    camera = camera or scene.view.camera(volume, Opaque(volume, transfer))
    with Renderer(args.backend, args.device, args.gpu) as renderer, _work_bar(args.quiet, "brick") as bar:
        if args.explain:
            print(renderer.plan(bricks.whole, camera, scene.settings).explain())
        image = renderer.render_bricks(bricks, camera, scene.settings, bar, bands=need.bands(most))
    if not image.info["splats"]:
        raise nothing(scene, volume)
    if args.check is None:
        from splatgl.truth.check import check_bricks

        image = check_bricks(image, bricks, camera, scene.settings)
    return image


def _drawn(args: argparse.Namespace, scene: Scene, splats: Splats, camera: Camera) -> Image:
    """The image, checked; prints what --explain and --savings ask for."""
    from splatgl.app.savings import savings
    from splatgl.gl.renderer import Renderer
    from splatgl.truth.check import check, refuse

    refuse(splats, camera, scene.settings, args.check, args.field)
    with Renderer(args.backend, args.device, args.gpu) as renderer:
        if args.explain:
            print(renderer.plan(splats, camera, scene.settings).explain())
        image = renderer.render(splats, camera, scene.settings)
        if args.check is not None or args.field or image.info["error_bound"] is None:
            image = check(image, splats, camera, scene.settings, args.check, args.field)
        if args.explain:
            print(f"{_accuracy(image)}, against the float64 reference of the same splats")
        if args.savings:
            print("\n".join(savings(renderer, splats, camera, renderer.plan(splats, camera, scene.settings))))
    return image


def origin(scene: Scene, transfer: Transfer) -> dict[str, object]:
    """Provenance stored in an image."""
    return {
        "version": __version__,
        "source": Path(scene.volume).name,
        "threshold": scene.threshold,
        "transfer": transfer.to_toml(),
    }


def _summary(output: Path, image: Image) -> str:
    info, (height, width, _) = image.info, image.pixels.shape
    return "\n".join(
        [
            f"{output}: {width}×{height}, {info['splats']:,} splats in {info['seconds']:.2f} s",
            f"{info['blend']}, {info['kernel']}, align {info['align']}, {info['footprint']}, target {info['target']}",
            f"by {info['renderer']} ({info['backend']})",
            *([] if info["tolerance_met"] and "checked" not in info else [_accuracy(image)]),
        ]
    )


def _accuracy(image: Image) -> str:
    """Text of the error bound and whether it meets the tolerance, and of what was compared."""
    info = image.info
    error, tolerance, checked = info["error_bound"], info["tolerance"], info.get("checked")
    known = f"error bound {error:.3g}" if isinstance(error, float) else "no error bound"
    missed = "not " if isinstance(error, float) else "not known to be "
    told = f"{known}: the tolerance {tolerance:.3g} is {'' if info['tolerance_met'] else missed}met"
    if not isinstance(checked, dict):
        return told
    # sums have no largest value of their own
    of = f" of {image.pixels.max():.3g}" if BLENDS[str(info["blend"])].unbounded else ""
    told += f"\noff by at most {checked['largest']:.2g}{of}, RMSE {checked['rmse']:.2g}, in {checked['pixels']} pixels"
    told += " drawn in float64"
    if info.get("level"):
        told += f", of level {info['level']}'s voxels"
    field = checked.get("field")
    if field is None:
        return told
    far = f"off the field itself by at most {field['largest']:.2g}{of}, RMSE {field['rmse']:.2g}"
    return f"{told}\n{far}, in {field['pixels']} pixels"


def nothing(scene: Scene, volume: Volume) -> InputError:
    """The error for a scene without splats, with the reason."""
    if not any(np.isfinite(slab.samples).any() for slab in volume.slabs(1, halo=0)):
        return expected(scene.volume, "finite samples", "none")
    return expected(
        scene.volume,
        f"voxels with an opacity above the threshold {scene.threshold:g}",
        "none",
        "lower --threshold, or set --points to the values that matter",
    )


def _bar(parts: Iterator[Any], count: int) -> Iterator[Any]:
    """Progress bar over parts of a volume, if tqdm is installed and stderr is a terminal."""
    if not sys.stderr.isatty():
        return parts
    try:
        from tqdm import tqdm
    except ImportError:
        return parts
    return iter(tqdm(parts, "extracting", total=count, unit="part", delay=PATIENCE, leave=False))


@contextmanager
def _work_bar(quiet: bool, unit: str) -> Iterator[Callable[[int, int], None] | None]:
    """What is told of units that are done: a progress bar, if tqdm is installed and stderr is a terminal."""
    if quiet or not sys.stderr.isatty():
        yield None
        return
    try:
        from tqdm import tqdm
    except ImportError:
        yield None
        return
    with tqdm(desc="drawing", unit=unit, delay=PATIENCE, leave=False) as bar:

        def done(count: int, total: int) -> None:
            bar.total = total
            bar.update(count - bar.n)

        yield done
