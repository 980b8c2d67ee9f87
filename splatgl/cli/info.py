"""`splatgl info` and `splatgl doctor`: contents of a file, and checks of the rendering environment."""

from __future__ import annotations

import argparse
from functools import partial

from splatgl.cli.parser import Parser
from splatgl.errors import Choice
from splatgl.platforms import CHOICES


def add_info_parser(parser: Parser) -> None:
    """Adds the options of `splatgl info`."""
    from splatgl.cli.options import add_source

    add_source(parser)
    parser.set_defaults(run=partial(_info, parser))


def add_doctor_parser(parser: argparse.ArgumentParser) -> None:
    """Adds the options of `splatgl doctor`."""
    parser.add_argument("--backend", default="auto", help=CHOICES)
    parser.add_argument("--device", type=int, help="index of the EGL device")
    parser.set_defaults(run=_doctor)


def _info(parser: Parser, args: argparse.Namespace) -> int:
    from splatgl.cli.options import scene_from
    from splatgl.readers import list_volumes
    from splatgl.scene.open_scene import print_notes

    scene = scene_from(args)
    listed_ = [] if "array" in scene.load else list_volumes(scene.volume)
    if len(listed_) > 1:
        print("\n".join([*listed_, ""]))
    try:
        volume = scene.open()
    except Choice as error:
        from splatgl.cli.volume_info import describe_choice

        print(describe_choice(scene.volume, error, parser.with_flags(str(error), args)))
        return 0
    from splatgl.cli.volume_info import describe

    print_notes(volume)
    print(describe(volume))
    return 0


def _doctor(args: argparse.Namespace) -> int:
    from splatgl.cli.doctor import report

    text, right = report(args.backend, args.device)
    print(text)
    return 0 if right else 1
