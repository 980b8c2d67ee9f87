"""`splatgl view`: interactive window for a volume, a scene, or nothing yet."""

from __future__ import annotations

import argparse
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from splatgl.cli.options import add_drawing, add_source, record_of, scene_from
from splatgl.data.color import AUTO, CLEAR
from splatgl.errors import expected
from splatgl.fileio import check_folder
from splatgl.opengl import OpenGL
from splatgl.scene.scene_file import SceneFile
from splatgl.scene.view import ViewOptions
from splatgl.viewer.adaptive_quality import TARGET
from splatgl.viewer.show import open_window, start_empty, start_reading

if TYPE_CHECKING:
    from splatgl.viewer.commands import Command


def add_parser(parser: argparse.ArgumentParser) -> None:
    """Adds the options of `splatgl view`."""
    add_source(parser, optional=True)
    group = parser.add_argument_group("window")
    group.add_argument("--list-bindings", action=ListBindings, nargs=0, help="print the keys and their actions")
    group.add_argument("--bindings", metavar="FILE.toml", help="other keys: table [bindings] of action = keys")
    group.add_argument("--watch", action="store_true", help="read the file or scene.toml again when it changes")
    group.add_argument("--folder", metavar="DIR", help="folder of saved pictures and scenes (default .)")
    group.add_argument("--frame-time", type=float, default=TARGET * 1e3, metavar="MS", help="while moving (default 33)")
    group.add_argument("--ground", type=_ground, metavar="black|white|checks", help="background of the window")
    group.add_argument("--no-panel", action="store_true", help="do not show the panel (extra gui)")
    add_drawing(parser, "window", "the latest's")
    parser.set_defaults(run=run)


def _ground(text: str) -> str:
    from splatgl.gl.screen import GROUNDS

    if text not in GROUNDS:
        raise argparse.ArgumentTypeError(f"expected {' or '.join(GROUNDS)}, got {text!r}")
    return text


class ListBindings(argparse.Action):
    """Prints the bindings, including those of a preceding --bindings, and exits."""

    def __call__(self, parser: Any, namespace: argparse.Namespace, *_: Any) -> None:
        """Prints the bindings and exits."""
        from splatgl.viewer.commands import COMMANDS
        from splatgl.viewer.input import list_bindings, load_bindings

        changed = getattr(namespace, "bindings", None)
        print(list_bindings(load_bindings(changed) if changed else COMMANDS))
        parser.exit()


def _scene(args: argparse.Namespace, source: str) -> SceneFile:
    """The scene of a command's options; a ground is seen behind a picture that states no background."""
    scene = scene_from(args, source)
    return scene.with_options(background=CLEAR) if args.ground and scene.settings.background == AUTO else scene


def run(args: argparse.Namespace) -> int:
    """Opens the window; returns 0 once it is closed."""
    folder = Path(args.folder or ".")
    # files of a folder that cannot be written are looked at, too
    if args.folder:
        check_folder(folder, "--folder")
    if not args.frame_time > 0:
        raise expected("--frame-time", "milliseconds above 0", args.frame_time)
    commands: tuple[Command, ...] = ()
    if args.bindings:
        from splatgl.viewer.input import load_bindings

        commands = load_bindings(args.bindings)
    opengl, source, is_empty = record_of(args, OpenGL), args.source or "", args.source is None
    scene = _scene(args, source)
    if is_empty and scene.with_options(size=ViewOptions().size) != SceneFile(""):
        raise expected("SOURCE", "a file for these options", "none", "splatgl view alone opens an empty window")
    reopen = partial(_scene, args, source)
    files = start_empty() if is_empty else start_reading(scene, source if args.watch else "", reopen)
    # imported late: bad input is reported at once
    from splatgl.viewer.viewer import Options

    options = Options(
        size=scene.view.size if args.size else None,
        target=args.frame_time / 1e3,
        folder=folder,
        commands=commands or Options().commands,
        ground=args.ground or Options.ground,
        panel=not args.no_panel,
        source=source,
        owns_process=True,
    )
    open_window(files, scene, options, opengl)
    return 0
