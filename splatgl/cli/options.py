"""Adds options to argparse, and builds scenes from parsed arguments."""

from __future__ import annotations

import argparse
from dataclasses import fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from splatgl.cli.parser import OPENGL, WORKERS
from splatgl.data.color import AUTO, CLEAR
from splatgl.errors import expected
from splatgl.options import BASIC, LAYERS, PAPER, PICTURE, TRANSFER, Option, declared, instance
from splatgl.readers.options import LoadOptions, inside
from splatgl.readers.remote import is_address
from splatgl.scene.meshes import VECTORS, Vectors, is_mesh
from splatgl.scene.scene_file import SceneFile, TransferChoice
from splatgl.scene.view import ViewOptions
from splatgl.splat.settings import LIKE, Settings
from splatgl.splat.transfer import Transfer

if TYPE_CHECKING:
    from splatgl.distributed.worker import Drawing


ANNOTATE = Option(
    instance("names", str, metavar="NAMES"),
    "scale, colorbar, axes, directions, box, title=TEXT. Or time=TEXT; several are separated by commas",
    PICTURE,
    BASIC,
)
# options of a scene that leave a part of the volume out
CUTS = ("clip", "crop", "mask")


def add_layers(parser: argparse.ArgumentParser) -> None:
    """Adds the options of further layers, of meshes and of vectors."""
    add_options(parser, SceneFile, "threshold", *CUTS)
    add_options(parser, TransferChoice, "preset", "only_labels")
    group = group_of(parser, LAYERS)
    group.add_argument("--clip-meshes", action="store_true", default=None, help="--clip and --crop clip meshes, too")
    labels: Any = group.add_argument("--labels", metavar="FILE", help="segmentation that is drawn over the volume")
    labels.summary = labels.help
    for name, field in VECTORS.items():
        add_option(parser, name, declared(Vectors)[field])


def add_source(parser: argparse.ArgumentParser, optional: bool = False) -> None:
    """Adds the source, which may be optional, and the reader options."""
    about = "file, folder or address of a volume, a built-in scene (tunnel, terrain, nerve), or a scene.toml"
    parser.add_argument("source", metavar="SOURCE", help=about, nargs="?" if optional else None)
    add_options(parser, LoadOptions)


def add_transfer(parser: argparse.ArgumentParser) -> None:
    """Adds the options of the transfer function."""
    add_options(parser, TransferChoice, "color_of", "window_of")
    group = group_of(parser, TRANSFER)
    group.add_argument("--transfer", metavar="FILE.toml", help="a saved transfer function")
    add_options(parser, Transfer)
    add_options(parser, SceneFile, "layers", "meshes", "surfaces", *CUTS)


def add_backend(parser: argparse.ArgumentParser, default: str = "auto") -> None:
    """Adds the OpenGL backend options."""
    group = group_of(parser, OPENGL)
    group.add_argument("--backend", default=default, metavar="NAME", help=f"auto, egl, osmesa or window ({default})")
    group.add_argument("--device", type=int, metavar="N", help="which EGL device, from 0; splatgl doctor lists several")
    group.add_argument("--gpu", action="store_true", help="fail if only a software renderer is there")


def add_drawing(parser: argparse.ArgumentParser, default: str = "auto") -> None:
    """Adds all rendering options but the source: backend, view, transfer function and settings."""
    add_backend(parser, default)
    add_options(parser, ViewOptions)
    add_transfer(parser)
    add_options(parser, SceneFile, "threshold", "layers", "meshes", "surfaces")
    add_settings(parser)


def add_settings(parser: argparse.ArgumentParser) -> None:
    """Adds the options of Settings, and their presets of earlier versions."""
    add_options(parser, Settings, "moments", "shutter")
    group = group_of(parser, PAPER)
    group.add_argument("--like", metavar="VERSION", help=f"defaults of an earlier version: {', '.join(LIKE)}")
    group.add_argument("--paper", action="store_true", help="hardware path of 1998: hybrid, 8-bit table and target")


def add_options(parser: argparse.ArgumentParser, record: Any, *leave: str) -> None:
    """Adds the options that a dataclass declares, but those to leave out, in groups by their titles."""
    defaults = {each.name: each.default for each in fields(record)}
    for name, option in declared(record).items():
        if option.group and name not in leave:
            add_option(parser, name, option, defaults[name])


def add_option(parser: argparse.ArgumentParser, name: str, option: Option, default: Any = None) -> None:
    """Adds an option. A BASIC one gets the attribute `summary`: its line of `--help`."""
    kind, rest = option.kind, option.help.removeprefix(option.summary)
    summary = option.summary + (f": {', '.join(option.choices)}" if option.choices else "")
    if isinstance(default, int | float) and default and "default" not in option.help:
        summary += f" (default {default:g})"
    arguments: dict[str, Any] = {"dest": name, "help": (summary + rest).replace("%", "%%")}
    if option.bare is not None and not kind.metavar:
        arguments |= {"action": "store_const", "const": option.bare}
    else:
        arguments |= {"type": kind.parse, "metavar": option.metavar or kind.metavar}
        arguments |= {"choices": option.choices, "type": str} if option.choices else {}
        arguments |= {"nargs": "?", "const": option.bare} if option.bare is not None else {}
        arguments |= {"action": "append"} if option.repeat else {}
    flag = option.flag or f"--{name.replace('_', '-')}"
    action: Any = group_of(parser, option.group).add_argument(flag, **arguments)
    action.summary = summary if option.level == BASIC else ""


def group_of(parser: argparse.ArgumentParser, title: str) -> argparse._ArgumentGroup:
    """The group of that title, which is added if there is none."""
    groups = {group.title: group for group in parser._action_groups}
    return groups.get(title) or parser.add_argument_group(title)


def scene_from(args: argparse.Namespace) -> SceneFile:
    """The scene of a command's options; they override a scene.toml."""
    _refuse_many(args)
    source, array = inside(args.source)
    given = {name: value for name, value in vars(args).items() if value is not None and name != "annotate"}
    if is_mesh(source) and not hasattr(args, "meshes"):
        raise expected(source, "a volume", "a mesh", "splatgl render draws it")
    if isinstance(given.get("time"), slice):
        if not hasattr(args, "more"):
            raise expected("--time", "one time point", "several", "splatgl animate draws them")
        del given["time"]
    if given.get("background") == AUTO:
        given["background"] = CLEAR
    path = Path(source)
    scene = SceneFile.from_toml(path) if path.suffix == ".toml" and not is_address(source) else SceneFile(source)
    settings = Settings.paper() if given.get("paper") else scene.settings
    if "like" in given:
        settings = Settings.like(given["like"], **settings.given)
    named = {} if array is None else {"array": array}
    transfer = {**scene.transfer, **({} if "transfer" not in given else Transfer.load(given["transfer"]).fields)}
    scene = replace(scene, settings=settings, transfer=transfer).with_options(**{**named, **given})
    return scene.blended() if "blend" in vars(args) and args.blend is None else scene


def _refuse_many(args: argparse.Namespace) -> None:
    """InputError for standard input, and for a pattern where one volume is drawn."""
    source = args.source
    if source == "-":
        raise expected("SOURCE", "a file", "standard input", "save it to a file first")
    pattern = any(sign in source for sign in "*?[") and not is_address(source)
    if pattern and not hasattr(args, "more") and not Path(source).exists():
        raise expected(source, "one file", "a pattern", "splatgl animate draws a series")


def add_workers(parser: argparse.ArgumentParser) -> None:
    """Adds the options of who draws."""
    group = group_of(parser, WORKERS)
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
