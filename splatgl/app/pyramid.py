"""`splatgl pyramid`: writes a volume, classified, with its coarser levels as OME-Zarr."""

from __future__ import annotations

import argparse
import math
import os
import shutil
from collections.abc import Iterator
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from splatgl.app.options import add_source, add_transfer, scene_from_transfer
from splatgl.data.volume import Places, Volume
from splatgl.errors import InputError, expected, missing_extra
from splatgl.fileio import check_folder, made, shortened
from splatgl.scene.draw import tell
from splatgl.splat.extraction.classified import classified, halved, steps_of
from splatgl.splat.grid import Grid
from splatgl.splat.transfer import Transfer

# voxels along the sides of a chunk, and chunks along those of a box that is made at once; the coarsest level is a chunk
CHUNK, BOX = 64, 2
UNITS = {"mm": "millimeter", "um": "micrometer", "nm": "nanometer", "m": "meter", "cm": "centimeter"}


def add_parser(parser: argparse.ArgumentParser) -> None:
    """Adds the options of `splatgl pyramid`."""
    add_source(parser)
    parser.add_argument("-o", "--output", required=True, metavar="DIR.zarr", help="store to write")
    parser.add_argument("--quiet", action="store_true", help="no summary")
    add_transfer(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Writes the store, or nothing."""
    scene, output = scene_from_transfer(args), Path(args.output)
    _check(output)
    volume = scene.open()
    tell(volume, args.quiet)
    if scene.threshold:
        raise expected("--threshold", "none: of a pyramid all voxels are kept", scene.threshold)
    part = output.with_name(f".{shortened(output.name)}.{os.getpid()}.part")
    try:
        with made(output.parent):
            try:
                shapes = write(part, volume, scene.transfer_for(volume))
                part.rename(output)
            finally:
                shutil.rmtree(part, ignore_errors=True)
    except OSError as error:
        raise InputError(f"{output}: cannot be written: {error.strerror or error}") from error
    if not args.quiet:
        print(f"{output}: " + ", ".join("×".join(map(str, shape[::-1])) for shape in shapes))
    return 0


def _check(output: Path) -> None:
    """InputError, before any work, if the store cannot be written."""
    try:
        import zarr  # noqa: F401
    except ImportError:
        raise missing_extra("pyramids", "zarr", "readers") from None
    if output.suffix != ".zarr":
        raise expected(output, "a name that ends in .zarr", repr(output.suffix))
    if output.exists():
        raise expected(output, "a name that is free", "one that is there", "remove it first")
    check_folder(output.parent, output)


def write(path: Path, volume: Volume, transfer: Transfer) -> list[Places]:
    """Writes the levels of a classified volume; returns their shapes (D, H, W), finest first."""
    import zarr

    group = zarr.open_group(path, mode="w", zarr_format=2)
    spacing = np.array(volume.spacing[::-1])
    unit = transfer.unit or Grid(volume.world_from_index, np.asarray(volume.origin)).mean_spacing
    shapes, scales, begins = [volume.shape], [spacing], [np.array(volume.origin[::-1])]
    opacity, color = _arrays(group, 0, volume.shape)
    for low, high in _boxes(volume.shape):
        _set(opacity, color, low, high, classified(volume, transfer, low, high))
    while max(shapes[-1]) > CHUNK:
        shape, scale, steps = shapes[-1], scales[-1], steps_of(shapes[-1])
        next_shape = _divided(shape, steps)
        coarse, shade = _arrays(group, len(shapes), next_shape)
        for low, high in _boxes(next_shape):
            box = tuple(slice(a * s, min(b * s, n)) for a, b, s, n in zip(low, high, steps, shape, strict=True))
            z, y, x = (scale / unit).tolist()
            _set(coarse, shade, low, high, halved(opacity[box], color[box], steps, (z, y, x)))
        # the middle of the first block, along the volume's own axes
        middle = volume.direction @ ((np.array(steps[::-1]) - 1) / 2 * scale[::-1])
        shapes.append(next_shape)
        scales.append(scale * steps)
        begins.append(begins[-1] + middle[::-1])
        opacity, color = coarse, shade
    axes: list[Any] = [{"name": name, "type": "space"} for name in "zyx"]
    if volume.unit in UNITS:
        axes = [{**axis, "unit": UNITS[volume.unit]} for axis in axes]
    datasets: list[Any] = [
        {
            "path": str(number),
            "coordinateTransformations": [
                {"type": "scale", "scale": scale.tolist()},
                {"type": "translation", "translation": begin.tolist()},
            ],
        }
        for number, (scale, begin) in enumerate(zip(scales, begins, strict=True))
    ]
    image: dict[str, Any] = {"version": "0.4", "name": volume.name, "axes": axes, "datasets": datasets}
    group.attrs["multiscales"] = [image]
    told: dict[str, Any] = {"color": "color", "unit": unit, "shading": transfer.shading, "frame": volume.frame}
    group.attrs["splatgl"] = {**told, "direction": volume.direction.tolist()}
    return shapes


def _arrays(group: Any, number: int, shape: Places) -> tuple[Any, Any]:
    """Opacity and colour of a level; chunks of nothing are not stored."""
    chunks = (CHUNK,) * 3
    opacity = group.create_array(str(number), shape=shape, chunks=chunks, dtype="f4", fill_value=0)
    name, all_of = f"color/{number}", (*shape, 3)
    return opacity, group.create_array(name, shape=all_of, chunks=(*chunks, 3), dtype="u1", fill_value=0)


def _set(opacity: Any, color: Any, low: Places, high: Places, found: tuple[np.ndarray, np.ndarray]) -> None:
    box = tuple(map(slice, low, high))
    if found[0].any():
        opacity[box], color[box] = found


def _boxes(shape: Places) -> Iterator[tuple[Places, Places]]:
    """Boxes from low to high (z, y, x) of whole chunks, which make up all of it."""
    side = BOX * CHUNK
    for at in product(*(range(0, count, side) for count in shape)):
        z, y, x = (min(a + side, count) for a, count in zip(at, shape, strict=True))
        yield (at[0], at[1], at[2]), (z, y, x)


def _divided(shape: Places, steps: Places) -> Places:
    z, y, x = (math.ceil(count / step) for count, step in zip(shape, steps, strict=True))
    return z, y, x
