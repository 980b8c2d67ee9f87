"""`--workers`, `--scheduler` and `--devices`: several processes that draw."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from splatgl.errors import expected

if TYPE_CHECKING:
    from splatgl.distributed.worker import Drawing


def add_workers(parser: argparse.ArgumentParser) -> None:
    """Adds the options of who draws."""
    group = parser.add_argument_group("several processes or machines (extra scale)")
    group.add_argument("--workers", type=int, metavar="N", help="draw in N processes of this machine")
    group.add_argument("--scheduler", metavar="ADDRESS", help="draw with the workers of a Dask scheduler, tcp://…:8786")
    group.add_argument("--devices", type=_devices, metavar="N,…", help="their EGL devices in turn (one card each)")


def asked(args: argparse.Namespace) -> bool:
    """Whether workers are to draw. InputError for options that exclude each other."""
    if args.workers is not None and args.scheduler is not None:
        raise expected("--workers", "either it or --scheduler", "both")
    if args.devices and args.device is not None:
        raise expected("--devices", "either it or --device", "both")
    found = args.workers is not None or args.scheduler is not None
    if args.devices and not found:
        raise expected("--devices", "--workers or --scheduler beside it", "neither")
    return found


def drawing_of(args: argparse.Namespace) -> Drawing:
    """How workers open OpenGL."""
    from splatgl.distributed.worker import Drawing

    devices = args.devices or (() if args.device is None else (args.device,))
    return Drawing(args.backend, tuple(devices), args.gpu)


def _devices(text: str) -> tuple[int, ...]:
    found = text.split(",")
    if not all(each.isdecimal() for each in found):
        raise argparse.ArgumentTypeError(f"expected numbers separated by commas, got {text!r}")
    return tuple(map(int, found))
