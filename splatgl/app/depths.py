"""Depth maps: `splatgl render --depth FILE`, and `depth_map` in Python."""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np

from splatgl import __version__
from splatgl.data.image import MAPS, save_map
from splatgl.data.image_files import need
from splatgl.data.volume import Volume
from splatgl.errors import expected
from splatgl.fileio import check_output, check_source
from splatgl.scene.draw import OF_BLENDS, depth_share, depths_of
from splatgl.scene.scene_file import Scene
from splatgl.splat.transfer import Transfer


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
