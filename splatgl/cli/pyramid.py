"""`splatgl pyramid`: writes a volume with coarser levels, or with voxels already classified.

A coarser classified voxel has the mean opacity of the rays through its eight voxels along each axis, as
extinction. The mean of extinctions would make an opaque thread in it as wide as the voxel (RMSE .15; this .08), and
the mean of values would lose the thread.
"""

from __future__ import annotations

import argparse
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from splatgl.cli.options import add_source, add_transfer, scene_from
from splatgl.data.color import srgb_from_linear
from splatgl.data.volume import Places, Volume
from splatgl.errors import expected, missing_extra
from splatgl.fileio import atomic_folder, check_folder
from splatgl.scene.open_scene import print_notes
from splatgl.splat.extract import extract
from splatgl.transfer.regions import OPAQUE, extinction_of
from splatgl.transfer.transfer import Transfer
from splatgl.writers import formats
from splatgl.writers.formats import describe_levels, finer_box, level_boxes, level_grids


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
    with atomic_folder(output) as part:
        shapes = write(part, volume, scene.transfer_for(volume))
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
    unit = transfer.length(volume)
    grids = level_grids(volume)
    opacity, color = _arrays(group, 0, volume.shape)
    for low, high in level_boxes(volume.shape):
        _set(opacity, color, low, high, classified(volume, transfer, low, high))
    for number, (finer, grid) in enumerate(pairwise(grids), 1):
        coarse, shade = _arrays(group, number, grid.shape)
        for low, high in level_boxes(grid.shape):
            box = finer_box(grid, finer, low, high)
            z, y, x = (finer.scale / unit).tolist()
            _set(coarse, shade, low, high, halved(opacity[box], color[box], grid.steps, (z, y, x)))
        opacity, color = coarse, shade
    group.attrs["multiscales"] = [describe_levels(volume, grids, [])]
    attributes: dict[str, Any] = {"color": "color", "unit": unit, "shading": transfer.shading, "frame": volume.frame}
    group.attrs["splatgl"] = {**attributes, "direction": volume.direction.tolist()}
    return [grid.shape for grid in grids]


def _arrays(group: Any, number: int, shape: Places) -> tuple[Any, Any]:
    """Creates the arrays of opacity and colour of a level; empty chunks are not stored."""
    chunks = (formats.CHUNK,) * 3
    opacity = group.create_array(str(number), shape=shape, chunks=chunks, dtype="f4", fill_value=0)
    name, all_of = f"color/{number}", (*shape, 3)
    return opacity, group.create_array(name, shape=all_of, chunks=(*chunks, 3), dtype="u1", fill_value=0)


def _set(opacity: Any, color: Any, low: Places, high: Places, found: tuple[np.ndarray, np.ndarray]) -> None:
    box = tuple(map(slice, low, high))
    if found[0].any():
        opacity[box], color[box] = found


# voxels around a box that its gradients need
HALO = 1

Classified = tuple[np.ndarray, np.ndarray]


def classified(volume: Volume, transfer: Transfer, low: Places, high: Places) -> Classified:
    """Opacity float32 [d, h, w] per mean spacing, and sRGB uint8 [d, h, w, 3], of the voxels low ≤ (z, y, x) < high."""
    first, last = volume.around(low, high, HALO)
    part = volume.part(first, last)
    inside = tuple(slice(a - f, b - f) for a, b, f in zip(low, high, first, strict=True))
    splats = extract(part, transfer, classification="pre")
    opacity, shade = np.zeros(part.shape, np.float32), np.zeros((*part.shape, 3), np.uint8)
    x, y, z = splats.records["position"].T
    opacity[z, y, x] = -np.expm1(-splats.records["optical_depth"].astype(np.float64))
    shade[z, y, x] = np.rint(srgb_from_linear(splats.colors) * 255)
    return opacity[inside], shade[inside]


def halved(opacity: np.ndarray, color: np.ndarray, steps: Places, sides: tuple[float, float, float]) -> Classified:
    """A level of half as many voxels along each axis whose step is 2. The last of an odd count is taken twice.

    opacity [d, h, w] is stated per a length; sides (z, y, x): of its voxels, in those lengths.
    """
    odd = [(0, count % step) for count, step in zip(opacity.shape, steps, strict=True)]
    opacity, color = np.pad(opacity, odd, mode="edge"), np.pad(color, [*odd, (0, 0)], mode="edge")
    blocks = [part for count, step in zip(opacity.shape, steps, strict=True) for part in (count // step, step)]
    extinction = extinction_of(opacity.reshape(blocks))
    within = (1, 3, 5)
    along = []
    for axis, step, side in zip(within, steps, sides, strict=True):
        through = np.exp(-extinction.sum(axis=axis, keepdims=True) * side).mean(axis=within)
        along.append(-np.log(np.maximum(through, 1 - OPAQUE)) / (step * side))
    weight = extinction[..., None]
    total = (color.reshape(*blocks, 3) * weight).sum(axis=within)
    shade = total / np.maximum(weight.sum(axis=within), 1e-30)
    return (-np.expm1(-np.mean(along, axis=0))).astype(np.float32), np.rint(shade).astype(np.uint8)
