"""`splatgl info` and `splatgl doctor`: contents of a file, and the rendering environment."""

from __future__ import annotations

import argparse


def add_info_parser(parser: argparse.ArgumentParser) -> None:
    """Adds the options of `splatgl info`."""
    from splatgl.app.options import add_source

    add_source(parser)
    parser.set_defaults(run=_info)


def add_doctor_parser(parser: argparse.ArgumentParser) -> None:
    """Adds the options of `splatgl doctor`."""
    parser.add_argument("--backend", default="auto", help="auto, egl, osmesa or window")
    parser.add_argument("--device", type=int, help="index of the EGL device")
    parser.set_defaults(run=_doctor)


def _info(args: argparse.Namespace) -> int:
    from splatgl.app.info import describe
    from splatgl.app.options import scene_from_source

    print(describe(scene_from_source(args).open()))
    return 0


def _doctor(args: argparse.Namespace) -> int:
    from splatgl.app.doctor import report

    text, right = report(args.backend, args.device)
    print(text)
    return 0 if right else 1
