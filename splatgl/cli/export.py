"""`splatgl export`, `convert`, `surface` and `pyramid`: write a scene for browsers and viewers, and a volume in another
format, as a mesh, or with coarser levels.

A coarser classified voxel has the mean opacity of the rays through its eight voxels along each axis, as
extinction. The mean of extinctions would make an opaque thread in it as wide as the voxel (RMSE .15; this .08), and
the mean of values would lose the thread.
"""

from __future__ import annotations

import argparse
import os
import shlex
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from splatgl.cli.options import add_drawing, add_source, add_transfer, record_of, scene_from, volume_source
from splatgl.cli.parser import add_option, add_options
from splatgl.data.arrays import ArrayWindow
from splatgl.data.color import srgb_from_linear
from splatgl.data.volume import Places, Volume, triple, with_parts
from splatgl.errors import expected, import_extra
from splatgl.exporters.api import Exporter, ExportOptions
from splatgl.fileio import atomic_folder, check_folder, check_output, check_source
from splatgl.geometry.clipping import crop_ends
from splatgl.options import ValueKind, declared
from splatgl.readers import load_source
from splatgl.scene.draw import DrawOptions, progress_bar
from splatgl.scene.open_scene import OpenScene, print_lines, print_notes
from splatgl.scene.scene_file import SceneFile
from splatgl.splat.extract import extract
from splatgl.transfer.regions import OPAQUE, extinction_of
from splatgl.transfer.transfer import Transfer
from splatgl.writers import TARGETS, find_target, formats, save
from splatgl.writers.formats import describe_levels, finer_box, level_boxes, level_grids
from splatgl.writers.surface import EXTRA, SAVED, iso_mesh, save_mesh

EXAMPLES = """examples:
  splatgl export head.nii.gz -o head.html
  splatgl export head.nii.gz -o head.html --splats 200000 --max-size 3MB
  splatgl export head.nii.gz -o head.spz
  splatgl export wind.vti --streamlines -o wind.glb"""


def add_export_parser(parser: argparse.ArgumentParser) -> None:
    """Adds the options of `splatgl export`."""
    parser.description = f"{parser.description}\n\n{EXAMPLES}"
    add_source(parser)
    about = "file to write: .html, .ply, .spz or .glb"
    parser.add_argument("-o", "--output", required=True, metavar="FILE", help=about)
    parser.add_argument("--quiet", action="store_true", help="no summary and no notes")
    add_options(parser, ExportOptions)
    add_drawing(parser)
    parser.set_defaults(run=run_export)


def run_export(args: argparse.Namespace) -> int:
    """Writes the file, or nothing."""
    options, path = record_of(args, ExportOptions), Path(args.output)
    options.check(path, args.source)
    scene = OpenScene.read(scene_from(args), args.quiet)
    # names without their folders
    words = [Path(word).name if os.path.exists(word) else word for word in sys.argv[1:]]
    how = replace(record_of(args, DrawOptions), check=0)
    tell = (lambda line: None) if args.quiet else lambda line: print(f"{path}: {line}")
    Exporter(scene, options, how, shlex.join(["splatgl", *words]), tell).write(path)
    return 0


def add_convert_parser(parser: argparse.ArgumentParser) -> None:
    """Adds the options of `splatgl convert`."""
    add_source(parser)
    suffixes = ", ".join(target.suffixes[0] for target in TARGETS)
    parser.add_argument("output", metavar="OUT", help=f"file to write: {suffixes}")
    about = "DICOM images that labels were drawn on, whose patient and frame of reference .dcm has"
    parser.add_argument("--images", metavar="DIR", help=about)
    parser.add_argument("--quiet", action="store_true", help="no summary")
    crop = declared(SceneFile)["crop"]
    add_option(parser, "crop", replace(crop, help="write these voxels along x, y, z", level="basic"))
    parser.set_defaults(run=run_convert)


def run_convert(args: argparse.Namespace) -> int:
    """Writes the file, or nothing."""
    output, (source, options) = Path(args.output), volume_source(args)
    target = find_target(output)
    check_source(output, source)
    times = options.pop("time", None)

    def open_time(number: int | str | None) -> Volume:
        volume = load_source(source, **options if number is None else {**options, "time": number})
        return crop_volume(volume, args.crop) if args.crop else volume

    volume, numbers = _read_times(open_time, times, "times" in target.holds and "array" not in options)
    print_notes(volume, args.quiet, has_times=numbers is not None)
    count = len(numbers or (0,))
    notes = save(volume, output, count, lambda n: open_time(numbers[n]) if numbers else volume, args.images)
    print_lines(notes, args.quiet)
    if not args.quiet:
        size = " × ".join(map(str, volume.shape[::-1])) + f", {count} time points" * (count > 1)
        print(f"{output}: {target.title}, {size}")
    return 0


def _read_times(
    open_time: Callable[[int | str | None], Volume], times: Any, holds_times: bool
) -> tuple[Volume, list[int] | None]:
    """The first volume to write, and the numbers of the time points if they are several.

    times: --time, a number or a slice; None: all that the file has, if the format holds them.
    """
    if isinstance(times, int | str):
        return open_time(times), None
    volume = open_time(None)
    if times is None and not (holds_times and volume.times > 1):
        return volume, None
    numbers = list(range(volume.times))[times or slice(None)]
    if not numbers:
        raise expected("time", f"some of 0 to {volume.times - 1}", "none")
    step = volume.time_step
    apart = numbers[1] - numbers[0] if len(numbers) > 1 else 1
    volume = volume if numbers[0] == 0 else open_time(numbers[0])
    return replace(volume, time_step=step and step * abs(apart)), numbers if len(numbers) > 1 else None


def crop_volume(volume: Volume, text: str) -> Volume:
    """The voxels A:B,C:D,E:F of a volume, read on demand. Raises InputError for other text."""
    ends = crop_ends(text, volume.shape)
    box = tuple(slice(*pair) for pair in ends[::-1])
    low = [begin for begin, _ in ends]

    def cut(part: Volume) -> Volume:
        origin = triple(part.world_from_index @ low + part.origin, "origin")
        names = ("samples", "color", "vectors")
        arrays: dict[str, Any] = {
            name: None if (array := getattr(part, name)) is None else ArrayWindow.of(array, box) for name in names
        }
        return replace(part, origin=origin, coarser=(), masks=(), **arrays)

    return with_parts(replace(cut(volume), coarser=()), cut)


# what stands for the value in the name of a file
VALUE = "{iso}"


def add_surface_parser(parser: argparse.ArgumentParser) -> None:
    """Adds the options of `splatgl surface`."""
    add_source(parser)
    about = "value whose surface is written; repeatable: one file each"
    number = ValueKind.number("one finite number", metavar="VALUE")
    parser.add_argument("--iso", type=number.parse, action="append", required=True, metavar="VALUE", help=about)
    about = f".stl, .ply, .obj or .glb; {VALUE} in its name is the value"
    parser.add_argument("-o", "--output", required=True, metavar="FILE", help=about)
    parser.add_argument("--quiet", action="store_true", help="no summary and no progress bar")
    add_options(parser, SceneFile, "crop")
    parser.set_defaults(run=run_surface)


def run_surface(args: argparse.Namespace) -> int:
    """Writes the files; returns 0."""
    source, options = volume_source(args)
    targets = _targets(args.output, args.iso)
    for target in targets.values():
        check_output(target, SAVED)
        check_source(target, source)
    for module, library in (("skimage.measure", "scikit-image"), ("trimesh", "trimesh")):
        import_extra(module, "surfaces", library, EXTRA)
    volume = load_source(source, **options)
    print_notes(volume, args.quiet)
    volume = crop_volume(volume, args.crop) if args.crop else volume
    for value, target in targets.items():
        started = time.perf_counter()
        with progress_bar("slab", args.quiet) as progress:
            mesh = iso_mesh(volume, value, progress)
        save_mesh(mesh, target)
        if not args.quiet:
            where = " ".join(filter(None, (mesh.unit, mesh.frame))) or "world units"
            size = f"{len(mesh.faces):,} triangles, {len(mesh.vertices):,} vertices, {where}"
            print(f"{target}: {size} ({time.perf_counter() - started:.2g} s)")
    return 0


def _targets(output: str, values: list[float]) -> dict[float, Path]:
    """The file of each value. Raises InputError for several values and one file."""
    if len(set(values)) > 1 and VALUE not in output:
        path = Path(output)
        name = path.with_name(f"{path.stem}-{VALUE}{path.suffix}")
        raise expected("-o", f"{VALUE} in its name, for {len(values)} surfaces", output, f"such as {name}")
    return {value: Path(output.replace(VALUE, f"{value:g}")) for value in values}


def add_pyramid_parser(parser: argparse.ArgumentParser) -> None:
    """Adds the options of `splatgl pyramid`."""
    add_source(parser)
    parser.add_argument("-o", "--output", required=True, metavar="DIR.zarr", help="store to write")
    parser.add_argument("--quiet", action="store_true", help="no summary")
    add_transfer(parser)
    parser.set_defaults(run=run_pyramid)


def run_pyramid(args: argparse.Namespace) -> int:
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
    import_extra("zarr", "pyramids", "zarr", "readers")
    if output.suffix != ".zarr":
        raise expected(output, "a name that ends in .zarr", repr(output.suffix))
    if output.exists():
        raise expected(output, "a name that is free", "one that is there", "remove it first")
    check_folder(output.parent, output)


def write(path: Path, volume: Volume, transfer: Transfer) -> list[Places]:
    """Writes the levels of a classified volume; returns their shapes (D, H, W), finest first."""
    import zarr

    group = zarr.open_group(path, mode="w", zarr_format=3)
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
    group.attrs["ome"] = describe_levels(volume, grids, [])
    attributes: dict[str, Any] = {"color": "color", "unit": unit, "shading": transfer.shading, "frame": volume.frame}
    group.attrs["splatgl"] = {**attributes, "direction": volume.direction.tolist()}
    return [grid.shape for grid in grids]


def _arrays(group: Any, number: int, shape: Places) -> tuple[Any, Any]:
    """Creates the arrays of opacity and colour of a level; empty chunks are not stored."""
    chunks = (formats.CHUNK,) * 3
    named: dict[str, Any] = {"dimension_names": tuple("zyx"), "fill_value": 0}
    opacity = group.create_array(str(number), shape=shape, chunks=chunks, dtype="f4", **named)
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
