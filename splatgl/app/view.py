"""`splatgl view`: interactive window for a volume or a scene."""

from __future__ import annotations

import argparse
import signal
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Any

from splatgl.app.layered import add_layers
from splatgl.app.options import add_drawing, add_source, scene_from
from splatgl.app.viewer.bindings import BINDINGS, listing, load_bindings
from splatgl.app.viewer.pacing import TARGET
from splatgl.errors import InputError, expected
from splatgl.fileio import check_folder

if TYPE_CHECKING:
    from splatgl.app.viewer.files import Files, Reopen
    from splatgl.app.viewer.viewer import Options
    from splatgl.scene.scene_file import Scene

# seconds in which most mistakes in what is asked for are found, before a window is opened
AT_ONCE = 0.1


def add_parser(parser: argparse.ArgumentParser) -> None:
    """Adds the options of `splatgl view`."""
    add_source(parser)
    add_layers(parser)
    group = parser.add_argument_group("window")
    group.add_argument("--list-bindings", action=ListBindings, help="print which key does what")
    group.add_argument("--bindings", metavar="FILE.toml", help="other keys: a table [bindings] of action = keys")
    group.add_argument("--watch", action="store_true", help="read the file, or the scene.toml, again when it changes")
    group.add_argument("--folder", default=".", metavar="DIR", help="where pictures and scenes are saved (.)")
    group.add_argument("--frame-time", type=float, default=TARGET * 1e3, metavar="MS", help="while moving (33)")
    group.add_argument("--ground", type=_ground, metavar="black|white|checks", help="behind it")
    group.add_argument("--no-panel", action="store_true", help="without the panel of the extra gui")
    add_drawing(parser, "window")
    parser.set_defaults(run=run)


def _ground(text: str) -> str:
    from splatgl.gl.screen import GROUNDS

    if text not in GROUNDS:
        raise argparse.ArgumentTypeError(f"expected {' or '.join(GROUNDS)}, got {text!r}")
    return text


class ListBindings(argparse.Action):
    """Prints the bindings, including those of a preceding --bindings, and exits."""

    def __init__(self, **options: Any) -> None:
        super().__init__(**{**options, "nargs": 0})

    def __call__(self, parser: Any, namespace: argparse.Namespace, *_: Any) -> None:
        """Prints the bindings and exits."""
        changed = getattr(namespace, "bindings", None)
        print(listing(load_bindings(changed) if changed else BINDINGS))
        parser.exit()


def run(args: argparse.Namespace) -> int:
    """Opens the window; returns 0 after it closes for any reason."""
    folder = Path(args.folder)
    check_folder(folder, "--folder")
    if not args.frame_time > 0:
        raise expected("--frame-time", "milliseconds above 0", args.frame_time)
    bindings = load_bindings(args.bindings) if args.bindings else BINDINGS
    scene = scene_from(args)
    files = reading(scene, args.source if args.watch else "", lambda: scene_from(args))
    # after what may be bad input: these take longer than to tell it
    from splatgl.app.viewer.viewer import Options

    options = Options(
        size=scene.view.size if args.size or args.source.endswith(".toml") else Options().size,
        target=args.frame_time / 1e3,
        folder=folder,
        bindings=bindings,
        ground=args.ground or Options.ground,
        panel=not args.no_panel,
        source=args.source,
    )
    opened(files, scene, options, args.backend, args.device, args.gpu)
    return 0


def reading(scene: Scene, source: str = "", reopen: Reopen | None = None) -> Files:
    """Begins to read a scene. Raises what its reader does, if that is found out within AT_ONCE. source: of what is
    watched, and read again by `reopen`.
    """
    from splatgl.app.viewer.files import Files, watched
    from splatgl.app.viewer.jobs import Jobs

    jobs = Jobs(lambda: None)
    files = Files(jobs, watched(source, scene) if source else (), reopen, time.monotonic())
    files.begin(scene)
    if jobs.settled(AT_ONCE) and jobs.done and jobs.done[0].error is not None:
        raise jobs.done[0].error
    return files


def opened(
    files: Files,
    scene: Scene,
    options: Options,
    backend: str = "window",
    device: int | None = None,
    gpu: bool = False,
) -> None:
    """Opens the window for what is being read, and returns once it is closed for any reason."""
    from splatgl.app.viewer.content import Content
    from splatgl.app.viewer.viewer import Viewer
    from splatgl.gl.backends import BackendError
    from splatgl.gl.renderer import Renderer

    with Renderer(backend, device, gpu) as renderer:
        viewer = Viewer(Content.nothing(scene), renderer, options, files)
        try:
            with _ended_by_signals(viewer):
                viewer.run()
        except BackendError as error:
            raise InputError(f"window: {error}") from error
        finally:
            viewer.close()


@contextmanager
def _ended_by_signals(viewer: Any) -> Iterator[None]:
    """Closes the window on SIGINT, SIGHUP and SIGTERM."""

    def close(number: int, frame: FrameType | None) -> None:
        viewer.closed = True

    names = [name for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)]
    before = {name: signal.signal(getattr(signal, name), close) for name in names}
    try:
        yield
    finally:
        for name, handler in before.items():
            signal.signal(getattr(signal, name), handler)
        sys.stdout.flush()
