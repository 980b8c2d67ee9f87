"""`splatgl render`: renders one image of a file or a scene."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any
from uuid import uuid4

import numpy as np

from splatgl import __version__
from splatgl.app.annotations.request import asked_for, lay, unbacked, with_room
from splatgl.app.backgrounds import as_drawn, backed
from splatgl.app.depths import add_depth, check_depth, write_depths
from splatgl.app.layered import add_layers, draw_layers, is_layered
from splatgl.app.masks import check_masked
from splatgl.app.meshes import is_mesh
from splatgl.app.options import add_drawing, add_source, scene_from
from splatgl.app.output import tell
from splatgl.app.scene import Scene
from splatgl.app.summary import accuracy, summary
from splatgl.app.worker_options import add_workers, asked
from splatgl.data.image import SAVED, Image
from splatgl.data.image_files import need
from splatgl.data.volume import Volume
from splatgl.errors import InputError, expected
from splatgl.fileio import bytes_of, check_output, check_source, size_of
from splatgl.splat.settings import BLENDS
from splatgl.splat.transfer import Transfer

# what draws and compares is imported once there is something to draw: bad input is told at once
if TYPE_CHECKING:
    from splatgl.comparison.compare import Picture
    from splatgl.gl.large_volumes import Level
    from splatgl.gl.renderer import Renderer
    from splatgl.splat.camera import Camera
    from splatgl.splat.splats import Splats

# most labels that a picture stores: some 16 kB of text
LABELS = 512
# delay of the progress bar in seconds
PATIENCE = 1.0


EXAMPLES = """examples:
  splatgl render head.nii.gz -o head.png
  splatgl render head.nii.gz --preset ct-bone --azimuth 60 --size 800x600 --background black
  splatgl render head_128x256x256_uint8.raw --window -160,240 --blend xray -o sums.npy"""


@dataclass(frozen=True)
class Drawing:
    """How this process draws, as the options of `splatgl render` say. kept: by the renderer that calls share."""

    backend: str = "auto"
    device: int | None = None
    gpu: bool = False
    kept: bool = False
    memory: int | None = None
    check: int | None = None
    field: bool = False
    explain: bool = False
    savings: bool = False
    quiet: bool = True

    @classmethod
    def of(cls, args: argparse.Namespace) -> Drawing:
        """The options of a command."""
        return cls(**{each.name: getattr(args, each.name) for each in fields(cls) if each.name != "kept"})

    @contextmanager
    def renderer(self) -> Iterator[Renderer]:
        """A renderer for one picture."""
        from splatgl.app.kept import kept_renderer
        from splatgl.gl.renderer import Renderer

        opened = kept_renderer() if self.kept else Renderer(self.backend, self.device, self.gpu)
        with opened as renderer:
            yield renderer


def add_parser(parser: argparse.ArgumentParser) -> None:
    """Adds the options of `splatgl render`."""
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.description = f"{parser.description}\n\n{EXAMPLES}"
    add_source(parser)
    parser.add_argument("-o", "--output", metavar="FILE", help="a .png, .jpg, .npy, .tif or .exr (SOURCE.png)")
    parser.add_argument(
        "--bits", type=int, choices=(8, 16), default=8, metavar="8|16", help="bits a sample of a PNG (8)"
    )
    group = parser.add_argument_group("accuracy")
    add_layers(parser)
    add_depth(parser)
    parser.add_argument("--ref", metavar="FILE", help="compare with this picture; write only if it differs, and exit 1")
    parser.add_argument("--explain", action="store_true", help="say what is drawn, what is left out, and why")
    group.add_argument("--savings", action="store_true", help="draw with what is left out, and say what that takes")
    group.add_argument(
        "--check",
        type=int,
        metavar="ROWS",
        help="compare as many rows with float64 (0: none; default: some squares, with --field or without a bound)",
    )
    group.add_argument(
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
    parser.add_argument("--annotate", metavar="NAMES", help="scale,colorbar,axes,directions,box,title=TEXT,time=TEXT")
    parser.add_argument("--quiet", action="store_true", help="no summary and no progress bar")
    add_workers(parser)
    add_drawing(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Renders an image and prints a summary; returns 0, or 1 if it differs from --ref."""
    on_workers = asked(args)
    scene = scene_from(args)
    output = Path(args.output or f"{Path(args.source).name.split('.')[0]}.png")
    check_output(output, SAVED)
    need(output.suffix.lower())
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
        image = draw(Drawing.of(args), drawn_as, volume, transfer)
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
    if annotate:
        image = lay(image, scene, volume, transfer, annotate, args.quiet)
    image.save(output, args.bits, behind)
    if not args.quiet:
        print(summary(output, image, scene, volume, transfer))
    return ended


def draw(how: Drawing, scene: Scene, volume: Volume, transfer: Transfer) -> Image:
    """The image, drawn by this process."""
    if is_layered(scene, volume):
        return draw_layers(how, scene, volume, transfer)
    check_masked(scene.volume, volume, transfer)
    camera, told = None, dict[str, object]()
    if volume.coarser:
        camera, chosen = _level(how, scene, volume, transfer)
        volume, transfer, told = chosen.volume, chosen.transfer, chosen.info
    image = _in_bricks(how, scene, volume, transfer, camera)
    if image is None:
        splats = scene.splats(volume, transfer, None if how.quiet else _bar)
        if not len(splats):
            raise nothing(scene, volume)
        image = drawn(how, scene, splats, camera or scene.view.camera(volume, splats))
    return Image(image.pixels, {**image.info, **told})


def _on_workers(args: argparse.Namespace, scene: Scene, volume: Volume, transfer: Transfer) -> Image:
    """The image, drawn in parts by workers of Dask."""
    from splatgl.app.worker_options import drawing_of
    from splatgl.distributed.cluster import connected
    from splatgl.distributed.slabs import Job, draw_parts
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
        return bytes_of(text)
    except InputError as error:
        raise argparse.ArgumentTypeError(str(error).removeprefix("memory: ")) from None


def _reference(name: str, output: Path) -> Picture:
    """The picture to compare with; InputError if it is missing, or would be overwritten."""
    from splatgl.app.compare import check_apart
    from splatgl.comparison.compare import read

    found = read(name)
    check_apart(output, Path(name))
    return found


def _level(how: Drawing, scene: Scene, volume: Volume, transfer: Transfer) -> tuple[Camera, Level]:
    """The camera, and the level of a multiscale image that it takes."""
    from splatgl.gl.large_volumes import just_finer, level_for
    from splatgl.splat.opaque_bounds import Opaque

    camera = scene.view.camera(volume, Opaque(volume, transfer))
    if just_finer(volume, camera) == 0:
        return camera, level_for(volume, transfer, camera, scene.settings)
    with how.renderer() as renderer:
        found = level_for(volume, transfer, camera, scene.settings, renderer)
    if not how.quiet:
        print(found)
    return camera, found


def _in_bricks(how: Drawing, scene: Scene, volume: Volume, transfer: Transfer, camera: Camera | None) -> Image | None:
    """The image, drawn brick by brick, if it needs more than --memory; else None."""
    from splatgl.fileio import budget
    from splatgl.splat.bricks import bricks_of, fits
    from splatgl.splat.opaque_bounds import Opaque

    bricks = None if scene.threshold else bricks_of(volume, transfer, scene.settings)
    if bricks is None:
        return None
    most = budget() if how.memory is None else how.memory
    need = fits(bricks, scene.view.size, most)
    if need is None:
        return None
    for name in ("check", "field", "savings"):
        if getattr(how, name):
            fix = "give more --memory, or a part of the volume"
            raise expected(f"--{name}", f"a picture that fits into {size_of(most)}", size_of(need.bytes), fix)
    if not how.quiet:
        told = f"{need}, together more than {size_of(most)}"
        if need.bytes <= most:
            told = f"up to about {need.most:,} splats are more than are drawn at once"
        print(f"{told}: drawn in {len(bricks.low):,} bricks, nearest first")

    camera = camera or scene.view.camera(volume, Opaque(volume, transfer))
    with how.renderer() as renderer, _work_bar(how.quiet, "brick") as bar:
        if how.explain:
            print(renderer.plan(bricks.whole, camera, scene.settings).explain())
        image = renderer.render_bricks(bricks, camera, scene.settings, bar, bands=need.bands(most))
    if not image.info["splats"]:
        raise nothing(scene, volume)
    if how.check is None:
        from splatgl.reference.check import check_bricks

        image = check_bricks(image, bricks, camera, scene.settings)
    return image


def drawn(how: Drawing, scene: Scene, splats: Splats, camera: Camera) -> Image:
    """The image, checked; prints what --explain and --savings ask for."""
    from splatgl.app.savings import savings
    from splatgl.reference.check import check, refuse

    refuse(splats, camera, scene.settings, how.check, how.field)
    with how.renderer() as renderer:
        if how.explain:
            print(renderer.plan(splats, camera, scene.settings).explain())
        image = renderer.render(splats, camera, scene.settings)
        if how.check is not None or how.field or image.info["error_bound"] is None:
            image = check(image, splats, camera, scene.settings, how.check, how.field)
        if how.explain:
            print(f"{accuracy(image)}, against the float64 reference of the same splats")
        if how.savings:
            print("\n".join(savings(renderer, splats, camera, renderer.plan(splats, camera, scene.settings))))
    return image


def origin(scene: Scene, transfer: Transfer) -> dict[str, object]:
    """Provenance stored in an image; of very many labels only how many, as readers of PNG limit texts."""
    few = len(transfer.labels) <= LABELS
    return {
        "version": __version__,
        "source": Path(scene.volume).name,
        "threshold": scene.threshold,
        "transfer": transfer.to_toml() if few else f"# {len(transfer.labels):,} labels in colours of their numbers",
    }


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
