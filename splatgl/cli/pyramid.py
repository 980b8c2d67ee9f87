"""`splatgl pyramid`: writes a volume with coarser levels, or with voxels already classified.

A coarser classified voxel has the mean opacity of the rays through its eight voxels along each axis, as
extinction. The mean of extinctions would make an opaque thread in it as wide as the voxel (RMSE .15; this .08), and
the mean of values would lose the thread.
"""

from __future__ import annotations

import argparse
import math
import os
import shutil
from collections.abc import Iterator
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from splatgl.cli.options import add_source, add_transfer, scene_from
from splatgl.data.color import srgb_from_linear
from splatgl.data.volume import FEWEST, Places, Volume
from splatgl.errors import InputError, expected, missing_extra
from splatgl.fileio import check_folder, new_folder, shorten_name
from splatgl.scene.open_scene import print_notes
from splatgl.splat.extract import extract
from splatgl.splat.grid import Grid
from splatgl.splat.transfer import Transfer

# voxels along the sides of a chunk, and chunks along those of a box in memory; the coarsest level is one chunk
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
    scene, output = scene_from(args), Path(args.output)
    _check(output)
    scene.require_one_volume()
    volume = scene.open()
    print_notes(volume, args.quiet, is_alone=True)
    if scene.threshold:
        raise expected("--threshold", "none: a pyramid has all voxels", scene.threshold)
    part = output.with_name(f".{shorten_name(output.name)}.{os.getpid()}.part")
    try:
        with new_folder(output.parent):
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
    """Raises InputError, before any work, if the store cannot be written."""
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
    attributes: dict[str, Any] = {"color": "color", "unit": unit, "shading": transfer.shading, "frame": volume.frame}
    group.attrs["splatgl"] = {**attributes, "direction": volume.direction.tolist()}
    return shapes


def _arrays(group: Any, number: int, shape: Places) -> tuple[Any, Any]:
    """Creates the arrays of opacity and colour of a level; empty chunks are not stored."""
    chunks = (CHUNK,) * 3
    opacity = group.create_array(str(number), shape=shape, chunks=chunks, dtype="f4", fill_value=0)
    name, all_of = f"color/{number}", (*shape, 3)
    return opacity, group.create_array(name, shape=all_of, chunks=(*chunks, 3), dtype="u1", fill_value=0)


def _set(opacity: Any, color: Any, low: Places, high: Places, found: tuple[np.ndarray, np.ndarray]) -> None:
    box = tuple(map(slice, low, high))
    if found[0].any():
        opacity[box], color[box] = found


def _boxes(shape: Places) -> Iterator[tuple[Places, Places]]:
    """Yields boxes (low, high) of whole chunks, (z, y, x), that cover a level."""
    side = BOX * CHUNK
    for at in product(*(range(0, count, side) for count in shape)):
        z, y, x = (min(a + side, count) for a, count in zip(at, shape, strict=True))
        yield (at[0], at[1], at[2]), (z, y, x)


def _divided(shape: Places, steps: Places) -> Places:
    z, y, x = (math.ceil(count / step) for count, step in zip(shape, steps, strict=True))
    return z, y, x


# voxels around a box that its gradients need
HALO = 1
# largest opacity of a voxel in means
OPAQUE = 1 - 2.0**-24

Classified = tuple[np.ndarray, np.ndarray]


def classified(volume: Volume, transfer: Transfer, low: Places, high: Places) -> Classified:
    """Opacity float32 [d, h, w] per mean spacing, and sRGB uint8 [d, h, w, 3], of the voxels low ≤ (z, y, x) < high."""
    first, last = volume.around(low, high, HALO)
    part = volume.part(first, last)
    inside = tuple(slice(a - f, b - f) for a, b, f in zip(low, high, first, strict=True))
    unit = transfer.unit or Grid(volume.world_from_index, np.asarray(volume.origin)).mean_spacing
    splats = extract(part, replace(transfer, unit=unit), classification="pre")
    opacity, shade = np.zeros(part.shape, np.float32), np.zeros((*part.shape, 3), np.uint8)
    x, y, z = splats.records["position"].T
    opacity[z, y, x] = -np.expm1(-splats.records["optical_depth"].astype(np.float64))
    shade[z, y, x] = np.rint(srgb_from_linear(splats.colors) * 255)
    return opacity[inside], shade[inside]


def steps_of(shape: Places) -> Places:
    """Reduction factor, 2 or 1, of each axis (z, y, x) of a level; short axes stay."""
    z, y, x = (2 if count >= FEWEST else 1 for count in shape)
    return z, y, x


def halved(opacity: np.ndarray, color: np.ndarray, steps: Places, sides: tuple[float, float, float]) -> Classified:
    """A level of half as many voxels along each axis whose step is 2. The last of an odd count is taken twice.

    opacity [d, h, w] is stated per a length; sides (z, y, x): of its voxels, in those lengths.
    """
    odd = [(0, count % step) for count, step in zip(opacity.shape, steps, strict=True)]
    opacity, color = np.pad(opacity, odd, mode="edge"), np.pad(color, [*odd, (0, 0)], mode="edge")
    blocks = [part for count, step in zip(opacity.shape, steps, strict=True) for part in (count // step, step)]
    extinction = -np.log1p(-np.minimum(opacity.reshape(blocks).astype(np.float64), OPAQUE))
    within = (1, 3, 5)
    along = []
    for axis, step, side in zip(within, steps, sides, strict=True):
        through = np.exp(-extinction.sum(axis=axis, keepdims=True) * side).mean(axis=within)
        along.append(-np.log(np.maximum(through, 1 - OPAQUE)) / (step * side))
    weight = extinction[..., None]
    total = (color.reshape(*blocks, 3) * weight).sum(axis=within)
    shade = total / np.maximum(weight.sum(axis=within), 1e-30)
    return (-np.expm1(-np.mean(along, axis=0))).astype(np.float32), np.rint(shade).astype(np.uint8)
