"""Adds options to argparse, and builds scenes from parsed arguments."""

from __future__ import annotations

import argparse
import re
from collections.abc import Callable
from dataclasses import fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from splatgl.data.color import AUTO, CLEAR
from splatgl.errors import expected
from splatgl.options import BASIC, PAPER, Kind, Option, declared
from splatgl.readers.options import VALUES, LoadOptions, inside
from splatgl.readers.remote import is_address
from splatgl.scene.meshes import ARROWS, LINES, SHOWN, MeshFile, asked_vectors, is_mesh, mark_clipped
from splatgl.scene.parse import (
    _integers,
    _pairs,
    color_of,
    numbers,
    only_labels,
    size,
    times,
    window_of,
)
from splatgl.scene.scene_file import SceneFile
from splatgl.scene.view import ViewOptions
from splatgl.splat.presets import is_preset
from splatgl.splat.segment_surfaces import SMOOTHING, strength_of
from splatgl.splat.settings import LIKE, Settings

if TYPE_CHECKING:
    from splatgl.distributed.worker import Drawing


# a preset or a colour map behind a file's name
LOOK = re.compile(r"#?[\w-]+")


def add_layers(parser: argparse.ArgumentParser) -> None:
    """Adds the options of what is drawn beside the volume, and of its channels."""
    parser.add_argument(
        "--layer",
        type=layer_option,
        action="append",
        metavar="FILE[:LOOK[:OPACITY]]",
        help="another volume in the picture, with a preset or a colour map, and a factor of its opacities",
    )
    parser.add_argument(
        "--color-of",
        type=color_of,
        action="append",
        metavar="CHANNEL=COLOR",
        help="the colour of a channel, #rrggbb or a name",
    )
    parser.add_argument(
        "--window-of", type=window_of, action="append", metavar="CHANNEL=LOW,HIGH", help="from clear to full"
    )
    about = "a surface (.ply, .stl, .obj, .vtp, …) or lines (.trk, .tck), a colour, or MAP=ARRAY for values, an opacity"
    parser.add_argument("--mesh", type=mesh_option, action="append", metavar="FILE[:COLOUR[:OPACITY]]", help=about)
    about = "--clip and --crop cut meshes, too"
    parser.add_argument("--clip-meshes", action="store_true", help=about)
    add_vectors(parser)
    parser.add_argument("--labels", metavar="FILE", help="a segmentation that is laid over the volume")
    about = f"segmentations as smooth closed surfaces, smoothed from 0 to 1 ({SMOOTHING}), instead of voxels"
    parser.add_argument("--surfaces", nargs="?", const=SMOOTHING, type=float, metavar="S", help=about)


def layer_option(text: str) -> SceneFile:
    """An argparse type: the layer of FILE[:LOOK[:OPACITY]]; LOOK: a preset or a colour map."""
    source, look, opacity = with_look(text, lambda last: not last or bool(LOOK.fullmatch(last)), "LOOK")
    return SceneFile(
        source, transfer={"preset" if is_preset(look) else "colormap": look} if look else {}, opacity=opacity
    )


def mesh_option(text: str) -> MeshFile:
    """An argparse type: the mesh of FILE[:COLOUR[:OPACITY]]; COLOUR: or MAP, MAP=ARRAY or =ARRAY."""
    file, look, opacity = with_look(text, _is_color, "COLOUR")
    color, _, array = look.partition("=")
    return MeshFile(file, color, opacity, array=array)


def _is_color(text: str) -> bool:
    return not any(sign in text.partition("=")[0] for sign in "./")


def with_look(text: str, is_look: Callable[[str], bool], word: str) -> tuple[str, str, float]:
    """File, look and opacity of FILE[:LOOK[:OPACITY]]; word: what argparse's error calls the look."""
    source, look, opacity = text, "", 1.0
    head, colon, last = source.rpartition(":")
    if colon and (number := _number(last)) is not None:
        source, opacity = head, number
        head, colon, last = source.rpartition(":")
    if colon and is_look(last):
        source, look = head, last
    if not source or not 0 <= opacity <= 1:
        told = f"expected FILE[:{word}[:OPACITY]] with an opacity from 0 to 1, got {text!r}"
        raise argparse.ArgumentTypeError(told)
    return source, look, opacity


def _number(text: str) -> float | None:
    try:
        return float(text)
    except ValueError:
        return None


def add_source(parser: argparse.ArgumentParser, optional: bool = False) -> None:
    """Adds the source, which may be optional, and the reader options."""
    about = "a volume's file, folder or address, a built-in scene (tunnel, terrain, nerve), or a scene.toml"
    parser.add_argument("source", metavar="SOURCE", help=about, nargs="?" if optional else None)
    group = parser.add_argument_group("reading")
    group.add_argument("--shape", type=_integers(3), metavar="X,Y,Z", help="voxels along x, y, z of a headerless file")
    group.add_argument(
        "--dtype", metavar="TYPE", help="sample type of a headerless file: uint8, int16, >u2, float32, …"
    )
    group.add_argument("--offset", dest="header_offset", type=int, metavar="BYTES", help="skipped in a headerless file")
    about = "voxel spacing, instead of the file's and in its unit"
    group.add_argument("--spacing", type=numbers(3), metavar="X,Y,Z", help=about)
    about = "what the samples are (told by the file, else by whether equal ones lie in flat areas)"
    group.add_argument("--values", choices=VALUES, metavar="|".join(VALUES), help=about)
    group.add_argument("--array", metavar="NAME", help="which array, block or step of a file that holds several")
    group.add_argument(
        "--channel",
        metavar="N|NAME,…",
        help="which channel, from 0; of TIFF, Zarr and Imaris also its name, several, or all",
    )
    group.add_argument("--time", type=times, metavar="N", help="which time point of a file, from 0; animate: A:B:STEP")
    group.add_argument(
        "--level", type=int, metavar="N", help="level of a multiscale OME-Zarr or TIFF image, 0 the finest (measured)"
    )
    group.add_argument("--series", metavar="N|UID", help="which series of DICOM: its number in splatgl info, or a UID")
    group.add_argument("--color", metavar="PICTURE", help="colour picture laid over a height map")
    group.add_argument(
        "--anywhere", action="store_true", default=None, help="a detached header's data may lie outside its folder"
    )
    group.add_argument("--relief", type=float, metavar="L", help="height of a height map's relief, world units")


def add_transfer(parser: argparse.ArgumentParser) -> None:
    """Adds the transfer function options."""
    group = parser.add_argument_group("transfer function (default: chosen from the data)")
    group.add_argument("--preset", metavar="NAME", help="ct-bone, mr-angio, mip, …: splatgl presets lists all")
    group.add_argument("--transfer", metavar="FILE.toml", help="a transfer function saved before")
    group.add_argument(
        "--only-labels",
        type=only_labels,
        metavar="N[:A],N…",
        help="which labels of a segmentation are shown (all: every one); A: a factor of their opacity",
    )
    group.add_argument("--points", type=_pairs, metavar="V:A,V:A…", help="opacity A at value V, linear between")
    group.add_argument("--gradient", type=_pairs, metavar="G:W,G:W…", help="weight W at gradient G: t = F(∇, ρ)")
    group.add_argument(
        "--colormap", metavar="NAME", help="gray, bone, hot, viridis, …, or any of cmap's or matplotlib's"
    )
    group.add_argument("--window", type=numbers(2), metavar="LOW,HIGH", help="values that the colours span")
    group.add_argument(
        "--log", action="store_const", const="log", dest="scale", help="opacities and colours over logarithms of values"
    )
    group.add_argument(
        "--unit", type=float, metavar="L", help="world length that opacities are stated for (mean spacing)"
    )
    group.add_argument("--threshold", type=float, metavar="T", help="keep voxels with t above this opacity (0)")


def add_backend(parser: argparse.ArgumentParser, default: str = "auto") -> None:
    """Adds the OpenGL backend options."""
    group = parser.add_argument_group("OpenGL")
    group.add_argument("--backend", default=default, metavar="NAME", help=f"auto, egl, osmesa or window ({default})")
    group.add_argument("--device", type=int, metavar="N", help="which EGL device, from 0; splatgl doctor lists several")
    group.add_argument("--gpu", action="store_true", help="fail if only a software renderer is there")


def add_drawing(parser: argparse.ArgumentParser, default: str = "auto") -> None:
    """Adds all rendering options but the source: backend, view, transfer function and settings."""
    add_backend(parser, default)
    add_view(parser)
    add_transfer(parser)
    add_cuts(parser)
    add_settings(parser)


def add_view(parser: argparse.ArgumentParser) -> None:
    """Adds the camera options."""
    group = parser.add_argument_group("view (default: all of it, from the front)")
    group.add_argument("--size", type=size, metavar="W×H", help="pixels, such as 800x600 or 512 (512x512)")
    group.add_argument(
        "--azimuth",
        type=float,
        metavar="A",
        help="degrees about the up axis, counter-clockwise from above; 0: the front",
    )
    group.add_argument("--elevation", type=float, metavar="A", help="degrees above the horizon")
    group.add_argument("--zoom", type=float, metavar="F", help="above 1 is nearer")
    group.add_argument("--fov", type=float, metavar="A", help="full vertical angle in degrees")
    group.add_argument("--eye", type=numbers(3), metavar="X,Y,Z", help="the eye, world units")
    group.add_argument("--look-at", type=numbers(3), metavar="X,Y,Z", help="what the eye looks at (the middle)")
    group.add_argument("--up", type=numbers(3), metavar="X,Y,Z", help="the direction drawn upwards (0,0,1)")
    group.add_argument("--orthographic", action="store_true", default=None, help="parallel rays")
    group.add_argument("--height", type=float, metavar="L", help="height of an orthographic picture, world units")


def add_cuts(parser: argparse.ArgumentParser) -> None:
    """Adds the options of what is cut away."""
    group = parser.add_argument_group("cuts")
    about = "keep a part: x>0.3 of the volume's box, z<=30mm, x+y>1, or a point and a normal (repeatable)"
    group.add_argument("--clip", action="append", metavar="CONDITION", help=about)
    group.add_argument("--crop", metavar="A:B,C:D,E:F", help="keep these voxels along x, y, z, and fit the view")
    about = "keep what lies where a file is not 0, or has these labels, or what lies outside of that (repeatable)"
    group.add_argument("--mask", action="append", metavar="FILE[:N,N…][:outside]", help=about)


def add_settings(parser: argparse.ArgumentParser) -> None:
    """Adds the options of Settings, and their presets of earlier versions."""
    add_options(parser, Settings, "moments", "shutter", "clip")
    group = group_of(parser, PAPER)
    group.add_argument("--like", metavar="VERSION", help=f"defaults of an earlier version: {', '.join(LIKE)}")
    group.add_argument("--paper", action="store_true", help="hardware path of 1998: hybrid, 8-bit table and target")


def add_options(parser: argparse.ArgumentParser, record: Any, *leave: str) -> None:
    """Adds the options that a dataclass declares, but those to leave out, in groups by their titles."""
    defaults = {each.name: each.default for each in fields(record)}
    for name, option in declared(record).items():
        if name not in leave:
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
        arguments |= {"type": reader(kind), "metavar": option.metavar or kind.metavar}
        arguments |= {"choices": option.choices, "type": str} if option.choices else {}
        arguments |= {"nargs": "?", "const": option.bare} if option.bare is not None else {}
        arguments |= {"action": "append"} if option.repeat else {}
    flag = option.flag or f"--{name.replace('_', '-')}"
    action: Any = group_of(parser, option.group).add_argument(flag, **arguments)
    action.summary = summary if option.level == BASIC else ""


def reader(kind: Kind) -> Callable[[str], Any]:
    """An argparse type that reads values of a kind."""

    def read(text: str) -> Any:
        try:
            return kind.read(text)
        except (ValueError, OverflowError):
            this = kind.written or f"{kind.metavar}, {kind.expected}"
            raise argparse.ArgumentTypeError(f"expected {this}, got {text[:80]!r}") from None

    return read


def group_of(parser: argparse.ArgumentParser, title: str) -> argparse._ArgumentGroup:
    """The group of that title, which is added if there is none."""
    groups = {group.title: group for group in parser._action_groups}
    return groups.get(title) or parser.add_argument_group(title)


def scene_from_source(args: argparse.Namespace) -> SceneFile:
    """The scene from the source and reader options."""
    _refuse_many(args)
    source, array = inside(args.source)
    if is_mesh(source) and not hasattr(args, "mesh"):
        raise expected(source, "a volume", "a mesh", "splatgl render draws it")
    path = Path(source)
    scene = SceneFile.from_toml(path) if path.suffix == ".toml" and not is_address(source) else SceneFile(source)
    reading = _given(args, *(f.name for f in fields(LoadOptions)))
    if isinstance(reading.get("time"), slice):
        if not hasattr(args, "more"):
            raise expected("--time", "one time point", "several", "splatgl animate draws them")
        del reading["time"]
    named = {} if array is None else {"array": array}
    return replace(scene, load={**scene.load, **named, **reading})


def _refuse_many(args: argparse.Namespace) -> None:
    """InputError for what is no file: standard input, and a pattern where one volume is drawn."""
    source = args.source
    if source == "-":
        raise expected("SOURCE", "a file", "standard input", "save it to a file first")
    pattern = any(sign in source for sign in "*?[") and not is_address(source)
    if pattern and not hasattr(args, "more") and not Path(source).exists():
        raise expected(source, "one file", "a pattern", "splatgl animate draws a series")


def scene_from_transfer(args: argparse.Namespace) -> SceneFile:
    """The scene from the source, reader and transfer function options."""
    scene = scene_from_source(args)
    threshold = scene.threshold if args.threshold is None else args.threshold
    transfer = {**scene.transfer, **_transfer_file(args.transfer), **_given(args, *TRANSFER)}
    layers = (*scene.layers, *(getattr(args, "layer", None) or ()))
    if getattr(args, "labels", None) is not None:
        layers = (*layers, SceneFile(args.labels, transfer={"only_labels": args.only_labels or ()}))
    elif args.only_labels is not None:
        transfer["only_labels"] = args.only_labels
    meshes = (*scene.meshes, *(getattr(args, "mesh", None) or ()))
    if getattr(args, "clip_meshes", False):
        named = [each.file for each in meshes if isinstance(each, MeshFile)]
        alone = (MeshFile(scene.volume),) if is_mesh(scene.volume) and scene.volume not in named else ()
        meshes = tuple(mark_clipped(each) for each in (*alone, *meshes))
    given = getattr(args, "surfaces", None)
    smoothing = scene.surfaces if given is None else strength_of(given)
    vectors = asked_vectors(vars(args), scene.vectors)
    found = replace(scene, transfer=transfer, threshold=threshold, layers=layers, meshes=meshes)
    found = replace(found, vectors=vectors, surfaces=smoothing)
    found.refuse_more(vars(args))
    return found


def scene_from(args: argparse.Namespace) -> SceneFile:
    """The scene from all options; they override a scene.toml."""
    scene = scene_from_transfer(args)
    settings = Settings.paper() if args.paper else scene.settings
    if args.like is not None:
        settings = Settings.like(args.like, **settings.given)
    found = replace(scene, view=view_of(args, scene.view), settings=settings.but(**_settings(args)))
    found = replace(found, clip=found.clip if args.clip is None else tuple(args.clip), crop=args.crop or found.crop)
    found = replace(found, mask=found.mask if args.mask is None else tuple(args.mask))
    return found if args.blend else found.blended()


def view_of(args: argparse.Namespace, view: ViewOptions, size: tuple[int, int] | None = None) -> ViewOptions:
    """A view with what is given. size: where none is."""
    view = view if size is None else replace(view, size=size)
    return replace(view, **_given(args, *(f.name for f in fields(ViewOptions))))


def _settings(args: argparse.Namespace) -> dict[str, Any]:
    """The fields of Settings that are given; a background that is to be chosen is none yet."""
    given = _given(args, *(f.name for f in fields(Settings) if f.name not in CUTS))
    if given.get("background") in (AUTO, CLEAR):
        given["background"] = None
    return given


CUTS = ("clip", "crop")
TRANSFER = ("preset", "points", "gradient", "colormap", "window", "scale", "unit", "color_of", "window_of")


def _transfer_file(path: str | None) -> dict[str, Any]:
    if path is None:
        return {}
    from splatgl.splat.transfer import Transfer

    transfer = Transfer.load(path)
    return {f.name: getattr(transfer, f.name) for f in fields(Transfer)}


def _given(args: argparse.Namespace, *names: str) -> dict[str, Any]:
    return {name: value for name in names if (value := getattr(args, name, None)) is not None}


def add_vectors(parser: argparse.ArgumentParser) -> None:
    """Adds the options of vectors."""
    group = parser.add_argument_group("vectors, such as velocities, of the volume")
    about = "draw their lengths, coloured by direction or not, instead of the volume's values"
    group.add_argument("--vectors", choices=SHOWN, metavar="|".join(SHOWN), help=about)
    for name, count, what in (("streamlines", LINES, "lines along them"), ("arrows", ARROWS, "arrows")):
        about = f"{what}, spread evenly, coloured by speed ({count})"
        group.add_argument(f"--{name}", nargs="?", const=count, type=int, metavar="N", help=about)


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
