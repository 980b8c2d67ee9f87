"""`splatgl presets`: lists the presets, or draws a sheet of a volume with each preset."""

from __future__ import annotations

import argparse
import json
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from splatgl.cli.options import add_backend, add_source, add_view, record_of, scene_from
from splatgl.data.volume import Volume, subsample
from splatgl.errors import expected
from splatgl.fileio import check_output, check_source, write_file
from splatgl.scene.open_scene import OpenScene, print_notes, with_background
from splatgl.scene.scene_file import SceneFile
from splatgl.splat.settings import Settings
from splatgl.transfer.presets import PRESETS, default_transfer, preset, with_preset_blend
from splatgl.transfer.transfer import Transfer

if TYPE_CHECKING:
    from PIL.Image import Image as Picture

    from splatgl.geometry.camera import Camera
    from splatgl.gl.renderer import Renderer


# pixels of an image's side by default, of a label's height and of its letters; images in a row
SIDE, LABEL, LETTERS, ROW = 256, 22, 14, 6
# larger volumes are subsampled, voxels
MOST = 1 << 26
INK, PAPER = "#202020", "#e8e8e8"
# label of the first image, without a preset
DEFAULT = "default"


def add_parser(parser: argparse.ArgumentParser) -> None:
    """Adds the options of `splatgl presets`."""
    add_source(parser, optional=True)
    parser.add_argument("-o", "--output", metavar="FILE.png", help="the sheet to write (presets.png)")
    about = "print one line of JSON: the presets, with a volume their points and windows for it"
    parser.add_argument("--json", action="store_true", help=about)
    add_backend(parser)
    add_view(parser, f"{SIDE}x{SIDE}")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Lists the presets, or draws a sheet of them; returns 0."""
    if args.source is None:
        if args.output:
            raise expected("presets", "a volume to draw", "none", f"splatgl presets FILE -o {args.output}")
        width = max(map(len, PRESETS))
        text = "\n".join(f"{row.name:<{width}}  {row.about}" for row in PRESETS.values())
        print(as_json() if args.json else text)
        return 0
    if args.json:
        if args.output:
            raise expected("--json", "no picture beside it", args.output, "leave one of them out")
        print(as_json(scene_from(args).open()))
        return 0
    output = Path(args.output or "presets.png")
    check_output(output, (".png",))
    scene = scene_from(args)
    scene.require_one_volume()
    check_source(output, args.source, *scene.files)
    scene = replace(scene, view=replace(scene.view, size=args.size or (SIDE, SIDE)))
    whole = scene.open()
    scene, volume = scene.cut(whole), subsampled(whole)
    looks = {DEFAULT: (default_transfer(volume), scene.settings)}
    looks |= {name: (preset(name, volume), with_preset_blend(scene.settings, name)) for name in PRESETS}
    from splatgl.scene.draw import DrawOptions, progress_bar

    print_notes(whole, is_alone=True)
    camera = scene.view.camera(volume, volume)
    pictures: dict[str, Picture | None] = {}
    with record_of(args, DrawOptions).renderer() as renderer, progress_bar("preset", is_quiet=False) as progress:
        for name, look in looks.items():
            pictures[name] = draw_preset(renderer, scene, volume, camera, look)
            progress(len(pictures), len(looks))
    write_file(output, sheet(pictures, scene.view.size))
    print(f"{output}: {len(pictures)} pictures of {volume.name or 'the volume'}, from the same eye")
    return 0


def as_json(volume: Volume | None = None) -> str:
    """One line of JSON: a list of the presets. volume: for whose values points and windows are listed."""
    records = []
    for name, row in PRESETS.items():
        record = {"name": name, **{key: getattr(row, key) for key in ("about", "colormap", "blend")}}
        if volume is not None:
            transfer = preset(name, volume)
            record |= {"points": transfer.points, "window": transfer.window, "colormap": transfer.colormap}
        records.append(record)
    return json.dumps(records, allow_nan=False, ensure_ascii=False)


def subsampled(volume: Volume) -> Volume:
    """Finest level of at most MOST voxels, else the subsampled coarsest level."""
    levels = (volume, *volume.coarser)
    level = next((level for level in levels if level.count <= MOST), levels[-1])
    step = next(n for n in range(1, level.count + 1) if level.count <= MOST * n**3)
    if step == 1:
        return replace(level, coarser=())
    return subsample(replace(level, coarser=()), step)


def draw_preset(
    renderer: Renderer, scene: SceneFile, volume: Volume, camera: Camera, look: tuple[Transfer, Settings]
) -> Picture | None:
    """Image on a suitable background; None if nothing is visible."""
    from PIL import Image as Pillow

    transfer, settings = look
    splats = OpenScene(replace(scene, settings=settings), volume, transfer).splats
    if not len(splats):
        return None
    image = renderer.render(splats, camera, with_background(settings, transfer.shading))
    samples = (image.straight()[..., :3] * 255).round().astype("uint8")
    return Pillow.fromarray(samples, "RGB")


def sheet(pictures: dict[str, Picture | None], size: tuple[int, int]) -> bytes:
    """PNG of labelled pictures of a size, pixels, in rows."""
    from io import BytesIO

    from PIL import Image as Pillow
    from PIL import ImageDraw, ImageFont

    columns = min(ROW, len(pictures))
    rows = -(-len(pictures) // columns)
    wide, high = size
    page = Pillow.new("RGB", (columns * wide, rows * (high + LABEL)), PAPER)
    pen, font = ImageDraw.Draw(page), ImageFont.load_default(LETTERS)
    for number, (name, picture) in enumerate(pictures.items()):
        x, y = number % columns * wide, number // columns * (high + LABEL)
        pen.text((x + wide / 2, y + LABEL / 2), name, INK, font, "mm")
        if picture is None:
            pen.text((x + wide / 2, y + LABEL + high / 2), "nothing is visible", INK, font, "mm")
        else:
            page.paste(picture, (x, y + LABEL))
    file = BytesIO()
    page.save(file, "PNG")
    return file.getvalue()
