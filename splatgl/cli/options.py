"""Adds options to argparse, and builds scenes from parsed arguments."""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from dataclasses import fields, replace
from difflib import get_close_matches
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from splatgl.animation.movie import is_pattern
from splatgl.cli.parser import add_option, add_options, group_of
from splatgl.data.scenes import SCENES
from splatgl.errors import SIMILAR, expected
from splatgl.opengl import OpenGL
from splatgl.options import HelpGroup, declared, names_of
from splatgl.platforms import CHOICES
from splatgl.readers import require_source
from splatgl.readers.options import LoadOptions, inside
from splatgl.readers.remote import is_address
from splatgl.scene.meshes import VECTORS, MeshFile, Vectors, is_mesh
from splatgl.scene.scene_file import SceneFile
from splatgl.scene.transfer_choice import CHANNEL_KEYS, TransferChoice
from splatgl.scene.view import ViewOptions
from splatgl.splat.settings import LIKE, Settings
from splatgl.transfer.presets import ALIASES, PRESETS
from splatgl.transfer.transfer import Transfer

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

    Record = TypeVar("Record", bound=DataclassInstance)

# options of the view of a picture alone
ON_PAPER = ("dpi", "width")


def add_source(parser: argparse.ArgumentParser, optional: bool = False) -> None:
    """Adds the source, which may be optional, and the reader options."""
    about = "file, folder or address of a volume, a built-in scene (tunnel, terrain, nerve), or a scene.toml"
    parser.add_argument("source", metavar="SOURCE", help=about, nargs="?" if optional else None)
    add_options(parser, LoadOptions)


def add_transfer(parser: argparse.ArgumentParser) -> None:
    """Adds the options of the transfer function of one volume."""
    add_options(parser, TransferChoice, "preset", "level_width", "file", "curve", "colors")
    add_options(parser, Transfer)
    add_options(parser, SceneFile, "threshold")
    add_options(parser, TransferChoice, "only_labels", "name_of", "names")


def add_backend(parser: argparse.ArgumentParser, default: str = "auto") -> None:
    """Adds the OpenGL backend options."""
    group = group_of(parser, HelpGroup.OPENGL)
    group.add_argument("--backend", default=default, metavar="NAME", help=f"{CHOICES} (default {default})")
    about = "number of the EGL device, from 0; splatgl doctor lists them"
    group.add_argument("--device", type=int, metavar="N", help=about)
    group.add_argument("--gpu", action="store_true", default=None, help="fail if OpenGL is a software renderer")


def add_view(parser: argparse.ArgumentParser, size: str) -> None:
    """Adds the options of the camera. size: the default size of a picture."""
    sized = replace(option := declared(ViewOptions)["size"], help=f"{option.help} (default {size})")
    add_option(parser, "size", sized)
    add_options(parser, ViewOptions, *(name for name in names_of(ViewOptions) if name not in ("size", *ON_PAPER)))


def add_drawing(parser: argparse.ArgumentParser, backend: str = "auto", size: str = "512x512") -> None:
    """Adds all options of a picture but the source: OpenGL, view, transfer function, layers and settings."""
    add_backend(parser, backend)
    add_view(parser, size)
    add_transfer(parser)
    add_options(parser, TransferChoice, *CHANNEL_KEYS)
    add_options(parser, SceneFile, "clip", "crop", "mask", "uncut", "scissors", "layers", "meshes", "slice_planes")
    add_options(parser, SceneFile, "surfaces", "measures")
    group = group_of(parser, HelpGroup.LAYERS)
    labels: Any = group.add_argument(
        "--labels", metavar="FILE|NAME", help="segmentation to draw: a file, or a name in OME-Zarr"
    )
    labels.summary = labels.help
    group.add_argument("--clip-meshes", action="store_true", default=None, help="--clip and --crop clip meshes, too")
    add_options(parser, MeshFile)
    for name, field in VECTORS.items():
        add_option(parser, name, declared(Vectors)[field])
    add_settings(parser)


def add_settings(parser: argparse.ArgumentParser) -> None:
    """Adds the options of Settings, and their presets of earlier versions."""
    add_options(parser, Settings, *(name for name in names_of(Settings) if name not in ("moments", "shutter")))
    group = group_of(parser, HelpGroup.PAPER)
    group.add_argument("--like", metavar="VERSION", help=f"defaults of an earlier version: {', '.join(LIKE)}")
    group.add_argument("--paper", action="store_true", help="hardware path of 1998: hybrid, 8 bits, streaks")


def scene_from(args: argparse.Namespace, source: str | None = None) -> SceneFile:
    """The scene of a command's options; they override a scene.toml. source: None: the command's."""
    named = args.source if source is None else source
    _reject_many(named, hasattr(args, "more"))
    source, array = inside(named)
    given = {name: value for name, value in vars(args).items() if value is not None}
    if is_mesh(source) and not hasattr(args, "meshes"):
        raise expected(source, "a volume", "a mesh", "splatgl render draws it")
    if isinstance(given.get("time"), slice):
        if not hasattr(args, "turntable"):
            raise expected("--time", "one time point", "several", "splatgl animate draws them")
        del given["time"]
    path = Path(source)
    scene = SceneFile.from_toml(path) if path.suffix == ".toml" and not is_address(source) else SceneFile(source)
    scene = scene.with_options(**{**({} if array is None else {"array": array}), **given})
    return scene.with_preset_blend() if vars(args).get("blend", "") is None else scene


def volume_source(args: argparse.Namespace) -> tuple[str, dict[str, Any]]:
    """The source and the options of its reader, of a command that reads one volume. Raises InputError for a mesh."""
    source, array = inside(args.source)
    if is_mesh(source):
        raise expected(source, "a volume", "a mesh", "splatgl render draws it")
    options = {name: getattr(args, name) for name in names_of(LoadOptions) if getattr(args, name) is not None}
    return source, options if array is None else {"array": array, **options}


def record_of(args: argparse.Namespace, record: type[Record]) -> Record:
    """A dataclass of the options that its fields, and those of OpenGL in it, have on the command line."""
    given: dict[str, Any] = {
        item.name: record_of(args, OpenGL) if isinstance(item.default, OpenGL) else getattr(args, item.name, None)
        for item in fields(record)
    }
    return record(**{name: value for name, value in given.items() if value is not None})


def preset_advice(word: str) -> str:
    """`did you mean --preset …?` for the name of a preset, also a misspelt one; "" for other words and for sources."""
    if word in SCENES or Path(inside(word)[0]).exists():
        return ""
    similar = get_close_matches(word.lower(), (*PRESETS, *ALIASES), 1, SIMILAR)
    return f"did you mean --preset {similar[0]}?" if similar else ""


def require_sources(sources: Iterable[str]) -> None:
    """Raises InputError for the first source that does not exist."""
    for source in sources:
        if advice := preset_advice(source):
            raise expected(source, "a file", "no such file", advice)
        if source not in SCENES:
            require_source(source)


def _reject_many(source: str, takes_many: bool) -> None:
    """InputError for standard input, for a pattern where one volume is drawn, and for the name of a preset."""
    if advice := preset_advice(source):
        raise expected(source, "a file", "no such file", advice)
    if source == "-":
        raise expected("SOURCE", "a file", "standard input", "save it to a file first")
    if is_pattern(source) and not takes_many:
        raise expected(source, "one file", "a pattern", "splatgl render and animate draw several")


def name_of(source: str) -> str:
    """The name of a source without its endings, from which pictures are named."""
    return Path(source).name.split(".")[0]
