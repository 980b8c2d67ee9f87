"""`splatgl pick`: the value and position under a pixel of the picture that `render` draws with the same options."""

from __future__ import annotations

import argparse
import json
import math
import re
from typing import TYPE_CHECKING

from splatgl.cli.options import add_drawing, add_source, scene_from
from splatgl.errors import expected
from splatgl.scene.open_scene import OpenScene

if TYPE_CHECKING:
    from splatgl.data.volume import Volume
    from splatgl.reference.depth_pick import Picked


# exit code for a pixel that shows nothing
NOTHING = 1


def add_parser(parser: argparse.ArgumentParser) -> None:
    """Adds the options of `splatgl pick`."""
    add_source(parser)
    parser.add_argument("pixel", type=_pixel, metavar="X,Y", help="column and row, from 0 at the upper left")
    about = "first: where half of the light is absorbed; max: the largest value (default: what the blend shows)"
    parser.add_argument("--mode", choices=("first", "max"), metavar="first|max", help=about)
    parser.add_argument("--json", action="store_true", help="print one line of JSON")
    parser.add_argument("--quiet", action="store_true", help="no notes about the file")
    add_drawing(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Prints the value and the position; returns 0, or NOTHING."""
    from splatgl.reference.depth_pick import pick

    file = scene_from(args)
    width, height = file.view.size
    column, row = args.pixel
    if not (column < width and row < height):
        raise expected("X,Y", f"a pixel of {width}×{height}, or --size", f"{column},{row}")
    opened = OpenScene.read(file, args.quiet or args.json)
    picked = pick(opened.scene, opened.camera, args.pixel, mode=args.mode, settings=file.settings.replace(clip=()))
    if picked is None:
        print("null" if args.json else "nothing is seen there")
        return NOTHING
    source = None if picked.mesh is not None else opened.scene.shown[picked.layer].volume
    print((as_json if args.json else as_text)(picked, source, opened.volume.unit))
    return 0


def as_text(picked: Picked, source: Volume | None, unit: str) -> str:
    """Lines of text on the picked point. source: its volume; None: on a mesh."""
    lines = [f"place: {_numbers(picked.place)} {unit}".rstrip(), f"distance: {picked.distance:.6g} {unit}".rstrip()]
    if source is None:
        return "\n".join([f"mesh: {picked.name or picked.mesh}", *lines])
    value = f"value: {picked.value:.6g} {source.value_unit}".rstrip()
    label = _label(picked, source)
    named = [f"label: {label}"] if label else []
    return "\n".join(
        [f"layer: {picked.name or picked.layer}", value, *named, f"voxel: {_numbers(picked.index)}", *lines]
    )


def as_json(picked: Picked, source: Volume | None, unit: str) -> str:
    """One line of JSON on the picked point."""
    record: dict[str, object] = {"place": picked.place, "unit": unit, "distance": picked.distance, "name": picked.name}
    if source is None:
        return json.dumps({**record, "mesh": picked.mesh}, allow_nan=False, ensure_ascii=False)
    record |= {"voxel": picked.index, "value": picked.value, "value_unit": source.value_unit, "layer": picked.layer}
    label = _label(picked, source)
    record |= {"label": label} if label else {}
    return json.dumps(record, allow_nan=False, ensure_ascii=False)


def _label(picked: Picked, source: Volume) -> str:
    """The name of the segment; "" if the samples are not labels."""
    number = round(picked.value) if math.isfinite(picked.value) else 0
    named = next((label.name for label in source.labels or () if label.number == number), "")
    return "" if source.labels is None else named or str(number)


def _numbers(values: tuple[float, ...]) -> str:
    return ", ".join(f"{value:.6g}" for value in values)


def _pixel(text: str) -> tuple[int, int]:
    if not re.fullmatch(r"\d{1,8},\d{1,8}", text):
        raise argparse.ArgumentTypeError(f"expected a column and a row such as 200,150, got {text!r}")
    column, row = text.split(",")
    return int(column), int(row)
