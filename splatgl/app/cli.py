"""The command line: `splatgl COMMAND …`. Exit codes: 0 done, 1 a comparison differs, 2 bad input."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence

from splatgl import __version__
from splatgl.data.errors import InputError, expected

BAD_INPUT = 2
# exit code of a program interrupted by Ctrl-C
INTERRUPTED = 130


def main(argv: Sequence[str] | None = None) -> int:
    """Runs a command and returns its exit code. Bad input prints one line on standard error."""
    arguments = list(sys.argv[1:] if argv is None else argv)
    try:
        args = _parser(arguments).parse_args(arguments)
        _refuse_empty(args)
        return int(args.run(args))
    except InputError as error:
        print(f"splatgl: {error}", file=sys.stderr)
        return BAD_INPUT
    except MemoryError as error:
        print(f"splatgl: not enough memory: {error}; use a smaller volume or a higher --threshold", file=sys.stderr)
        return BAD_INPUT
    except KeyboardInterrupt:
        print("splatgl: interrupted", file=sys.stderr)
        return INTERRUPTED
    except BrokenPipeError:
        return 0


def _refuse_empty(args: argparse.Namespace) -> None:
    """InputError for an empty argument, such as one from an unset shell variable."""
    for name, value in vars(args).items():
        if value == "" or (isinstance(value, list) and "" in value):
            raise expected(name.replace("_", "-"), "a name", "nothing", "leave it out, or say what it is")


def _parser(arguments: Sequence[str]) -> argparse.ArgumentParser:
    parser = Parser(
        prog="splatgl",
        description="Volume rendering by texture splats in OpenGL.",
        epilog="splatgl COMMAND --help tells a command's options.",
    )
    parser.add_argument("--version", action="version", version=f"splatgl {__version__}")
    commands = parser.add_subparsers(title="commands", metavar="COMMAND", required=True)
    for name, (about, add) in COMMANDS.items():
        usage = f"splatgl {name} [options]" + OPERANDS.get(name, "")
        command = commands.add_parser(name, help=about, description=f"{about[0].upper()}{about[1:]}.", usage=usage)
        # import and add options for the selected command only
        if name in arguments[:1]:
            add()(command)
    return parser


class Parser(argparse.ArgumentParser):
    """Argument parser that reports a usage error in one line, as for any bad input."""

    def error(self, message: str) -> None:  # type: ignore[override]
        """Exits with BAD_INPUT and one line on stderr."""
        self.exit(BAD_INPUT, f"{self.prog}: {message}; see {self.prog} --help\n")


def _render() -> Callable[[argparse.ArgumentParser], None]:
    from splatgl.app.render import add_parser

    return add_parser


def _view() -> Callable[[argparse.ArgumentParser], None]:
    from splatgl.app.view import add_parser

    return add_parser


def _animate() -> Callable[[argparse.ArgumentParser], None]:
    from splatgl.app.animate import add_parser

    return add_parser


def _pyramid() -> Callable[[argparse.ArgumentParser], None]:
    from splatgl.app.pyramid import add_parser

    return add_parser


def _compare() -> Callable[[argparse.ArgumentParser], None]:
    from splatgl.app.compare import add_parser

    return add_parser


def _info() -> Callable[[argparse.ArgumentParser], None]:
    from splatgl.app.inspect import add_info_parser

    return add_info_parser


def _doctor() -> Callable[[argparse.ArgumentParser], None]:
    from splatgl.app.inspect import add_doctor_parser

    return add_doctor_parser


def _figure() -> Callable[[argparse.ArgumentParser], None]:
    from splatgl.app.figures.cli import add_parser

    return add_parser


def _explain_splat() -> Callable[[argparse.ArgumentParser], None]:
    from splatgl.app.explain import add_parser

    return add_parser


def _stress() -> Callable[[argparse.ArgumentParser], None]:
    from splatgl.app.stress import add_parser

    return add_parser


def _report() -> Callable[[argparse.ArgumentParser], None]:
    from splatgl.app.report import add_parser

    return add_parser


def _presets() -> Callable[[argparse.ArgumentParser], None]:
    from splatgl.app.presets import add_parser

    return add_parser


COMMANDS: dict[str, tuple[str, Callable[[], Callable[[argparse.ArgumentParser], None]]]] = {
    "render": ("draw a volume or a scene into a picture", _render),
    "view": ("open a window on a volume or a scene", _view),
    "animate": ("draw a turning volume, keyframes or a series in time into frames or a movie", _animate),
    "compare": ("tell whether two pictures, or folders of them, are the same, and what changed", _compare),
    "info": ("tell what is in a volume file", _info),
    "presets": ("tell which transfer functions there are by name, or draw a volume by each of them", _presets),
    "pyramid": ("write a volume, classified, with coarser levels that keep thin things", _pyramid),
    "doctor": ("tell what this machine draws with, and whether it draws right", _doctor),
    "report": ("tell what accuracy costs: error against run time of every method", _report),
    "figure": ("draw a figure of the paper, or tell which of its claims hold", _figure),
    "stress": ("draw scenes at the extremes, and tell whether each keeps its bound", _stress),
    "explain-splat": ("tell how right each kind of splat is for one voxel", _explain_splat),
}
# positional arguments by command
OPERANDS = {
    "render": " SOURCE",
    "view": " SOURCE",
    "animate": " SOURCE… -o OUTPUT",
    "compare": " ACTUAL EXPECTED",
    "report": " [SOURCE…]",
    "info": " SOURCE",
    "presets": " [SOURCE]",
    "figure": " N",
    "explain-splat": " X,Y,Z",
}
