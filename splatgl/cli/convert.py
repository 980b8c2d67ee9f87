"""`splatgl convert`: writes a volume in another format, with its grid, units, channels, times and labels."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from splatgl.cli.options import add_source, volume_source
from splatgl.cli.parser import add_option
from splatgl.data.arrays import Window
from splatgl.data.scenes import SCENES
from splatgl.data.volume import Volume, triple, with_parts
from splatgl.errors import expected
from splatgl.fileio import check_source
from splatgl.geometry.clipping import crop_ends
from splatgl.options import declared
from splatgl.readers import load
from splatgl.scene.open_scene import print_notes
from splatgl.scene.scene_file import SceneFile
from splatgl.writers import TARGETS, find_target, save


def add_parser(parser: argparse.ArgumentParser) -> None:
    """Adds the options of `splatgl convert`."""
    add_source(parser)
    suffixes = ", ".join(target.suffixes[0] for target in TARGETS)
    parser.add_argument("output", metavar="OUT", help=f"file to write: {suffixes}")
    parser.add_argument("--quiet", action="store_true", help="no summary")
    crop = declared(SceneFile)["crop"]
    add_option(parser, "crop", replace(crop, help="write these voxels along x, y, z", level="basic"))
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Writes the file, or nothing."""
    output, (source, options) = Path(args.output), volume_source(args)
    target = find_target(output)
    check_source(output, source)
    times = options.pop("time", None)

    def open_time(number: int | str | None) -> Volume:
        is_scene = source in SCENES and not options
        given: dict[str, Any] = {} if number is None else {"time": number}
        volume = SCENES[source]() if is_scene else load(source, **options, **given)
        return crop_volume(volume, args.crop) if args.crop else volume

    volume, numbers = _read_times(open_time, times, "times" in target.holds and "array" not in options)
    print_notes(volume, args.quiet, has_times=numbers is not None)
    count = len(numbers or (0,))
    notes = save(volume, output, count, lambda n: open_time(numbers[n]) if numbers else volume)
    if not args.quiet:
        for note in notes:
            print(f"splatgl: {note}", file=sys.stderr)
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
    """The voxels A:B,C:D,E:F of a volume, which are read when they are needed. Raises InputError for other text."""
    ends = crop_ends(text, volume.shape)
    box = tuple(slice(*pair) for pair in ends[::-1])
    low = [begin for begin, _ in ends]

    def cut(part: Volume) -> Volume:
        origin = triple(part.world_from_index @ low + part.origin, "origin")
        names = ("samples", "color", "vectors")
        arrays: dict[str, Any] = {
            name: None if (array := getattr(part, name)) is None else Window.of(array, box) for name in names
        }
        return replace(part, origin=origin, coarser=(), masks=(), **arrays)

    return with_parts(replace(cut(volume), coarser=()), cut)
