"""`splatgl surface`: writes the surface at a value as a mesh file."""

from __future__ import annotations

import argparse
import time
from pathlib import Path

from splatgl.cli.convert import crop_volume
from splatgl.cli.options import add_source, volume_source
from splatgl.cli.parser import add_options
from splatgl.data.scenes import SCENES
from splatgl.errors import expected, import_extra
from splatgl.fileio import check_output, check_source
from splatgl.options import Kind
from splatgl.readers import load
from splatgl.scene.draw import progress_bar
from splatgl.scene.open_scene import print_notes
from splatgl.scene.scene_file import SceneFile
from splatgl.writers.surface import EXTRA, SAVED, iso_mesh, save_mesh

# what stands for the value in the name of a file
VALUE = "{iso}"


def add_parser(parser: argparse.ArgumentParser) -> None:
    """Adds the options of `splatgl surface`."""
    add_source(parser)
    about = "value whose surface is written; repeatable: one file each"
    number = Kind.number("one finite number", metavar="VALUE")
    parser.add_argument("--iso", type=number.parse, action="append", required=True, metavar="VALUE", help=about)
    about = f".stl, .ply or .obj; {VALUE} in its name is the value"
    parser.add_argument("-o", "--output", required=True, metavar="FILE", help=about)
    parser.add_argument("--quiet", action="store_true", help="no summary and no progress bar")
    add_options(parser, SceneFile, "crop")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Writes the files; returns 0."""
    source, options = volume_source(args)
    targets = _targets(args.output, args.iso)
    for target in targets.values():
        check_output(target, SAVED)
        check_source(target, source)
    for module, library in (("skimage.measure", "scikit-image"), ("trimesh", "trimesh")):
        import_extra(module, "surfaces", library, EXTRA)
    volume = SCENES[source]() if source in SCENES and not options else load(source, **options)
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
