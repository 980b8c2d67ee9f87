"""`splatgl render`: renders one image of a file or a scene."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from splatgl import __version__
from splatgl.app.options import add_drawing, add_source, scene_from
from splatgl.app.output import check_output
from splatgl.app.scene import Scene
from splatgl.data.errors import InputError, expected
from splatgl.data.image import Image
from splatgl.data.volume import Slab, Volume
from splatgl.splat.classification.transfer import Transfer
from splatgl.splat.plan.blend_mode import BLENDS

# what draws and compares is imported once there is something to draw: bad input is told at once
if TYPE_CHECKING:
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
    parser.add_argument("--quiet", action="store_true", help="no summary and no progress bar")
    add_drawing(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Renders an image and prints a summary; returns 0, or 1 if it differs from --ref."""
    scene = scene_from(args)
    output = Path(args.output or f"{Path(args.source).name.split('.')[0]}.png")
    check_output(output)
    reference = _reference(args.ref, output) if args.ref else None
    volume = scene.open()
    transfer = scene.transfer_for(volume)
    splats = scene.splats(volume, transfer, None if args.quiet else _bar)
    if not len(splats):
        raise nothing(scene, volume)
    image, camera = _drawn(args, scene, volume, splats)
    image = Image(image.pixels, {**image.info, **origin(scene, transfer)})
    ground = scene.settings.background if BLENDS[scene.settings.blend].unbounded else None
    ended = 0
    if reference is not None:
        from splatgl.app.compare import DIFFERENT, SAME, check_against

        verdict = check_against(image, reference, output, ground)
        if not (verdict.same and args.quiet):
            print(verdict)
        if verdict.same:
            return SAME
        ended = DIFFERENT
    image.save(output, args.bits, ground)
    if not args.quiet:
        print(_summary(output, image, splats, camera))
    return ended


def _reference(name: str, output: Path) -> Picture:
    """The picture to compare with; InputError if it is missing, or would be overwritten."""
    from splatgl.app.compare import check_apart
    from splatgl.truth.compare_read import read

    found = read(name)
    check_apart(output, Path(name))
    return found


def _drawn(args: argparse.Namespace, scene: Scene, volume: Volume, splats: Splats) -> tuple[Image, Camera]:
    """The image, checked, and its camera; prints what --explain and --savings ask for."""
    from splatgl.app.savings import savings
    from splatgl.gl.renderer import Renderer
    from splatgl.truth.check import check, refuse

    camera = scene.view.camera(volume, splats)
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
    return image, camera


def origin(scene: Scene, transfer: Transfer) -> dict[str, object]:
    """Provenance stored in an image."""
    return {
        "version": __version__,
        "source": Path(scene.volume).name,
        "threshold": scene.threshold,
        "transfer": transfer.to_toml(),
    }


def _summary(output: Path, image: Image, splats: Splats, camera: Camera) -> str:
    info = image.info
    return "\n".join(
        [
            f"{output}: {camera.size[0]}×{camera.size[1]}, {len(splats):,} splats in {info['seconds']:.2f} s",
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
    told += f"\noff by at most {checked['largest']:.2g}, RMSE {checked['rmse']:.2g}, in {checked['pixels']} pixels"
    told += " drawn in float64"
    field = checked.get("field")
    if field is None:
        return told
    far = f"off the field itself by at most {field['largest']:.2g}, RMSE {field['rmse']:.2g}"
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


def _bar(slabs: Iterator[Slab], count: int) -> Iterator[Slab]:
    """Progress bar over slabs, if tqdm is installed and stderr is a terminal."""
    if not sys.stderr.isatty():
        return slabs
    try:
        from tqdm import tqdm
    except ImportError:
        return slabs
    return iter(tqdm(slabs, "extracting", total=count, unit="slab", delay=PATIENCE, leave=False))
