"""`splatgl info` and `splatgl doctor`: contents of a file, and checks of the rendering environment."""

from __future__ import annotations

import argparse
import json
from functools import partial

from splatgl.cli.parser import Parser
from splatgl.errors import MissingOption
from splatgl.platforms import CHOICES


def add_info_parser(parser: Parser) -> None:
    """Adds the options of `splatgl info`."""
    from splatgl.cli.options import add_source

    add_source(parser)
    parser.add_argument("--json", action="store_true", help="print one line of JSON")
    parser.set_defaults(run=partial(_info, parser))


def add_doctor_parser(parser: argparse.ArgumentParser) -> None:
    """Adds the options of `splatgl doctor`."""
    parser.add_argument("--backend", default="auto", help=CHOICES)
    parser.add_argument("--device", type=int, help="index of the EGL device")
    parser.add_argument(
        "--report",
        nargs="?",
        const="",
        metavar="FILE",
        help="for a report of a fault: versions of all packages, and FILE's header without names and values",
    )
    parser.set_defaults(run=_doctor)


def _info(parser: Parser, args: argparse.Namespace) -> int:
    from splatgl.cli.options import scene_from
    from splatgl.cli.volume_info import describe_picture, drawn_picture
    from splatgl.readers import list_volumes
    from splatgl.scene.open_scene import print_notes

    scene = scene_from(args)
    picture = drawn_picture(scene.volume)
    if picture is not None:
        print(json.dumps({"source": args.source, **picture.info}) if args.json else describe_picture(picture))
        return 0
    listed_ = [] if "array" in scene.load else list_volumes(scene.volume)
    if len(listed_) > 1 and not args.json:
        print("\n".join([*listed_, ""]))
    try:
        volume = scene.open()
    except MissingOption as error:
        if args.json:
            choices = [{"name": name, "about": about} for name, about in error.choices]
            print(json.dumps({"source": args.source, "option": error.option, "choices": choices}, ensure_ascii=False))
            return 0
        from splatgl.cli.volume_info import describe_choice

        print(describe_choice(scene.volume, error, parser.with_flags(str(error), args)))
        return 0
    from splatgl.cli.volume_info import as_json, describe

    if args.json:
        print(as_json(args.source, volume))
        return 0
    print_notes(volume)
    print(describe(volume))
    return 0


def _doctor(args: argparse.Namespace) -> int:
    from splatgl.cli.doctor import report
    from splatgl.opengl import OpenGL

    text, right = report(OpenGL(args.backend, args.device), args.report)
    print(text)
    return 0 if right else 1
