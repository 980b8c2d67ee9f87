"""Depth maps: `splatgl render --depth FILE`, and `depth_map` in Python."""

from __future__ import annotations

import argparse
import time
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from splatgl import __version__
from splatgl.app.layered import is_layered, layered
from splatgl.app.scene import Scene
from splatgl.data.image import MAPS, save_map
from splatgl.data.image_files import need
from splatgl.data.volume import Volume
from splatgl.errors import expected
from splatgl.fileio import check_output, check_source
from splatgl.splat.settings import Settings
from splatgl.splat.transfer import Transfer

if TYPE_CHECKING:
    from splatgl.splat.camera import Camera
    from splatgl.splat.scene import Scene as Layers

# what is looked for where nothing is said: half of the light, or what the blend shows
HALF = 0.5
OF_BLENDS = {"mip": "max", "minip": "min"}


def add_depth(parser: argparse.ArgumentParser) -> None:
    """Adds the options of depth maps."""
    about = "write the depth at which each pixel's ray is absorbed: .npy, .tif, .exr or .png (without -o: only that)"
    parser.add_argument("--depth", metavar="FILE", help=about)
    about = "absorbed by a share from 0 to 1, or the largest or least value (0.5; of mip and minip these)"
    parser.add_argument("--depth-at", type=depth_at, metavar="SHARE|max|min", help=about)


def depth_at(text: str) -> float | str:
    """An argparse type."""
    try:
        return text if text in OF_BLENDS.values() else float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"expected a share from 0 to below 1, max or min, got {text!r}") from None


def check_depth(args: argparse.Namespace, scene: Scene) -> None:
    """InputError, before any work, for a map that can't be written."""
    if args.depth is None:
        if args.depth_at is not None:
            raise expected("--depth-at", "a file for the depths", "none", "add --depth depth.npy")
        return
    path = Path(args.depth)
    check_output(path, MAPS)
    need(path.suffix.lower())
    check_source(path, args.source, *scene.files, args.output, args.ref)
    if args.output is not None and path.absolute() == Path(args.output).absolute():
        raise expected("--depth", "another file than -o", str(path))


def write_depths(args: argparse.Namespace, scene: Scene, volume: Volume, transfer: Transfer) -> bool:
    """Writes the map that is asked for, and tells its range; whether nothing else is to be drawn."""
    if args.depth is None:
        return False
    started = time.perf_counter()
    at = _at(args.depth_at, scene.settings)
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


def depths_of(
    scene: Scene, volume: Volume, transfer: Transfer, at: float | str, quiet: bool = True
) -> tuple[np.ndarray, Camera]:
    """Depths float64 [H, W] of a scene whose cuts are in its settings, and the camera of its picture."""
    from splatgl.reference.depth_map import depths

    drawn = layered(scene, volume, transfer, quiet)
    camera = camera_of(scene, volume, transfer, drawn)
    return depths(drawn, camera, at, scene.settings.but(clip=())), camera


def camera_of(scene: Scene, volume: Volume, transfer: Transfer, drawn: Layers | None) -> Camera:
    """The camera of the scene's picture, which is fitted to what that is drawn from. drawn: of layers or meshes."""
    from splatgl.splat.extract import only_pre
    from splatgl.splat.opaque_bounds import Opaque
    from splatgl.splat.resolve import one_by_one

    if drawn is not None and is_layered(scene, volume):
        return scene.view.camera(volume, drawn)
    if scene.view.is_fixed(volume):
        return scene.view.camera(volume, volume)
    before = scene.settings.classification == "pre" or one_by_one(scene.settings, moving=False)
    # of several levels, one is chosen by the camera
    if not volume.coarser and (before or only_pre(volume, transfer, scene.threshold)):
        splats = scene.splats(volume, transfer)
        if len(splats):
            return scene.view.camera(volume, splats)
    return scene.view.camera(volume, Opaque(volume, transfer))


def _at(given: float | str | None, settings: Settings) -> float | str:
    return OF_BLENDS.get(settings.blend, HALF) if given is None else given


def depth_map(
    x: Any,
    transfer: Transfer | str | Mapping[str, Any] | None = None,
    camera: Camera | None = None,
    settings: Settings | None = None,
    at: float | str | None = None,
    **options: Any,
) -> np.ndarray:
    """Eye-space depths float64 [H, W] of the picture that `render` draws with the same arguments: along the view
    direction, world units, row 0 on top, of rays through pixel centres; NaN where there is nothing.

    at: where the ray is absorbed by that share, from 0 (where anything is) to below 1; "max" or "min": at the largest
    or least value; None: ½, or the value that mip and minip show. Needs no OpenGL. Raises InputError as `render`, for
    splats, and for volumes that are read in parts.
    """
    from splatgl.app.picture import is_splats, scene_of

    if is_splats(x):
        raise expected("depths", "a volume, an array or a file", "splats")
    scene, _ = scene_of(x, transfer, camera, settings, options)
    volume = scene.open()
    scene, chosen = scene.cut(volume), scene.transfer_for(volume)
    return depths_of(scene, volume, chosen, _at(at, scene.settings))[0]
