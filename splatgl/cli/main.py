"""The command line: `splatgl COMMAND …`. Exit codes: 0 done, 1 a comparison differs, 2 bad input."""

from __future__ import annotations

import argparse
import atexit
import errno
import gc
import io
import os
import re
import shlex
import signal
import sys
import warnings
from collections.abc import Callable, Iterable, Sequence
from contextlib import redirect_stderr, redirect_stdout, suppress
from itertools import takewhile
from typing import NamedTuple, NoReturn, TextIO

from splatgl import __version__
from splatgl.cli.parser import BAD_INPUT, NEGATIVE, HelpAll, Parser, one_line
from splatgl.errors import NOT_NEEDED, InputError, InputWarning, expected, import_extra
from splatgl.fileio import within
from splatgl.plugins import find_function, load_plugins

# what to cite: the method; .github/CITATION.cff has it and the software for reference managers
CITATION = "after Mueller et al., Splatting Errors and Antialiasing, IEEE TVCG 4(2):178-191, 1998"
# exit code of a program that a signal ends, less the signal's number: 130 for Ctrl-C
SIGNALLED = 128


def main(argv: Sequence[str] | None = None) -> int:
    """Runs a command and returns its exit code. Bad input prints one line on standard error."""
    arguments = list(sys.argv[1:] if argv is None else argv)
    if argv is None:
        # the process ends: a last search for garbage would take a tenth of a second
        atexit.register(gc.freeze)
        # products of small matrices alone are computed, for which threads of OpenBLAS wait without sleeping; numpy
        # reads this when it is imported
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
        # its extensions of headers are read by no command; it imports it in a third of its time
        NOT_NEEDED["nibabel"] = "pydicom"
        _occupy_descriptors()
        _hear_signals()
    for stream in (sys.stdout, sys.stderr):
        # names of files, × and … in any encoding
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
    streams = redirect_stdout(SafeStream(sys.stdout)), redirect_stderr(SafeStream(sys.stderr))
    with streams[0] as output, streams[1] as errors, warnings.catch_warnings():
        # commands print notes on files by themselves
        warnings.simplefilter("ignore", InputWarning)
        try:
            code = _run(arguments)
        except SystemExit as stop:
            # of argparse: help, or bad usage
            sys.exit(_end(output, errors, stop.code, argv is None))
        return int(_end(output, errors, code, argv is None) or 0)


class SafeStream(io.TextIOBase):
    """Standard output or error that may be missing, closed or full: failed prints do not stop the work.

    stream: Python's own, or None. error: of the first text that was not written; nothing is written after it.
    """

    def __init__(self, stream: TextIO | None) -> None:
        self.stream = stream
        self.error: Exception | None = None

    @property
    def encoding(self) -> str:  # type: ignore[override]
        """The stream's encoding."""
        return getattr(self.stream, "encoding", None) or "utf-8"

    def write(self, text: str) -> int:
        """Writes as far as possible."""
        self._attempt(lambda stream: stream.write(text))
        return len(text)

    def flush(self) -> None:
        """Flushes as far as possible."""
        self._attempt(lambda stream: stream.flush())

    def _attempt(self, action: Callable[[TextIO], object]) -> None:
        if self.stream is not None and self.error is None:
            try:
                action(self.stream)
            except (OSError, ValueError) as error:
                # ValueError: of a closed stream
                self.error = error

    @property
    def is_lost(self) -> bool:
        """Whether text is missing that somebody waits for: not that of a closed pipe, which Windows calls invalid."""
        windows = sys.platform == "win32" and getattr(self.error, "errno", None) == errno.EINVAL
        return isinstance(self.error, OSError) and not isinstance(self.error, BrokenPipeError) and not windows

    def isatty(self) -> bool:
        """Whether it is a terminal."""
        return self.stream is not None and self.stream.isatty()

    def fileno(self) -> int:
        """The descriptor. Raises OSError without one."""
        return super().fileno() if self.stream is None else self.stream.fileno()


def _end(output: SafeStream, errors: SafeStream, code: str | int | None, ends: bool) -> str | int | None:
    """The exit code of a command by its own. Where its output cannot be written: a line, and BAD_INPUT instead of 0.

    ends: whether the process ends. Python flushes both streams then, and would complain: they become a null device.
    """
    output.flush()
    if output.is_lost:
        print(f"splatgl: standard output: cannot be written: {getattr(output.error, 'strerror', '')}", file=errors)
    errors.flush()
    for stream in (output, errors):
        if stream.error and ends:
            # it may be no file
            with suppress(OSError, ValueError):
                os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
    return code or (BAD_INPUT if output.is_lost else code)


def _hear_signals() -> None:
    """Makes the signals of schedulers and of closed terminals interrupt as Ctrl-C does, so that no part of a file is
    left; ignored ones, as under nohup, stay ignored.
    """

    def interrupt(number: int, _: object) -> NoReturn:
        raise KeyboardInterrupt(number)

    for name in ("SIGTERM", "SIGHUP"):
        number = getattr(signal, name, None)
        if number is not None and signal.getsignal(number) == signal.SIG_DFL:
            signal.signal(number, interrupt)


def _occupy_descriptors() -> None:
    """Opens a null device for each of the standard descriptors that is closed, which a file would get otherwise."""
    for descriptor in range(3):
        try:
            os.fstat(descriptor)
        except OSError:
            # gets the lowest free one
            os.open(os.devnull, os.O_RDWR)


def _run(arguments: list[str]) -> int:
    args = command = None
    try:
        if "_ARGCOMPLETE" in os.environ:
            _complete()
        arguments = _with_command(arguments)
        parser = _parser(arguments)
        command = _command_of(parser, *arguments[:1])
        if command is not None:
            _reject_unknown(command, arguments[1:])
        args, rest = parser.parse_known_args(arguments)
        if command is not None and rest:
            _reject_rest(command, rest)
        reject_empty(args)
        # a program that calls the command goes on with its own budget
        with within(getattr(args, "memory", None)):
            return int(args.run(args))
    except InputError as error:
        return _tell(error, command.with_flags(str(error), args) if command else str(error))
    except MemoryError as error:
        return _tell(error, f"not enough memory: {error}; use a smaller volume or a higher --threshold")
    except KeyboardInterrupt as error:
        _tell(error, "interrupted")
        return SIGNALLED + (error.args[0] if error.args else signal.SIGINT)


def _complete() -> None:
    """Completes the words of a shell's line by argcomplete, which ends the process; imports only the line's command."""
    completion = import_extra("argcomplete", "completion", "argcomplete", "completion")
    completion.autocomplete(_parser(os.environ.get("COMP_LINE", "").split()[1:2]), always_complete_options="long")


def _tell(error: BaseException, message: str) -> int:
    """Prints a message, and the error's notes, a line each; returns BAD_INPUT."""
    for line in (message, *getattr(error, "__notes__", ())):
        print(f"splatgl: {one_line(line)}", file=sys.stderr)
    return BAD_INPUT


def _with_command(arguments: list[str]) -> list[str]:
    """The arguments, with `view` before a source alone. Raises InputError without a display, and for unknown words."""
    if not arguments or arguments[0] in COMMANDS:
        return arguments
    if re.fullmatch(r"[a-z][a-z0-9-]*", arguments[0]) and not os.path.exists(arguments[0]):
        # of other packages
        COMMANDS.update((arguments[0], row) for row in load_plugins("commands", Subcommand, arguments[0]))
        if arguments[0] in COMMANDS:
            return arguments
    if arguments[0].startswith("-"):
        known = ("--help", "--version", "-h")
        if arguments[0] not in known:
            near = _nearest(arguments[0], known)
            Parser(prog="splatgl").error(f"expected a command or a file first, got {arguments[0]}{near}")
        return arguments
    from splatgl.data.scenes import SCENES
    from splatgl.platforms import has_display
    from splatgl.readers.options import inside
    from splatgl.readers.remote import is_address

    source = arguments[0]
    if source in SCENES or is_address(source) or os.path.exists(inside(source)[0]):
        if has_display():
            return ["view", *arguments]
        line = shlex.join(["splatgl", "render", source, "-o", "picture.png"])
        raise expected("display", "one, to open a window", "none", f"{line} draws a picture")
    near = _nearest(source, [*COMMANDS, *SCENES])
    Parser(prog="splatgl").error(f"{source}: expected a command or a file that is there, got neither{near}")


def _nearest(word: str, known: Iterable[str]) -> str:
    """` (did you mean …?)`, or "" if no known word is similar."""
    from splatgl.options import nearest

    near = nearest(word.partition("=")[0], known)
    return f" ({near})" if near else ""


def _command_of(parser: argparse.ArgumentParser, name: str = "") -> Parser | None:
    (commands,) = (action for action in parser._actions if isinstance(action, argparse._SubParsersAction))
    command: Parser | None = commands.choices.get(name)
    return command


def _reject_unknown(command: argparse.ArgumentParser, words: Sequence[str]) -> None:
    """Exits with the first unknown option, before argparse asks for operands and required options."""
    known = command._option_string_actions
    for word in takewhile(lambda word: word != "--", words):
        is_flag = len(word) > 1 and word[0] == "-" and " " not in word and not NEGATIVE.match(word)
        if is_flag and (word.partition("=")[0] if word[1] == "-" else word[:2]) not in known:
            command.error(f"unknown option {word}{_nearest(word, known)}")


def _reject_rest(command: argparse.ArgumentParser, rest: list[str]) -> NoReturn:
    name = command.prog.split()[-1]
    series = "; splatgl render draws several, splatgl animate a series" if name == "view" else ""
    operands = COMMANDS[name].operands
    from splatgl.cli.options import preset_advice

    preset = f" ({near})" if "--preset" in command._option_string_actions and (near := preset_advice(rest[0])) else ""
    command.error(f"expected {operands or 'no more'}, got also {' '.join(rest)}{preset or series}")


def reject_empty(args: argparse.Namespace) -> None:
    """InputError for an empty argument, such as an unset shell variable."""
    for name, value in vars(args).items():
        if value == "" or (isinstance(value, list) and "" in value):
            raise expected(name, "a name", "nothing", "leave it out, or say what it is")


def _parser(arguments: Sequence[str]) -> argparse.ArgumentParser:
    parser = Parser(
        prog="splatgl",
        usage="splatgl COMMAND [options] …\n       splatgl FILE        (as splatgl view FILE)",
        description="Volume rendering by texture splats in OpenGL.",
        epilog="splatgl COMMAND --help lists the options of a command.",
    )
    parser.add_argument("--version", action="version", version=f"splatgl {__version__} ({CITATION})")
    commands = parser.add_subparsers(title="commands", metavar="COMMAND", required=True, prog="splatgl")
    for name, row in COMMANDS.items():
        usage = f"splatgl {name} [options] {row.operands}".rstrip()
        description = f"{row.help[0].upper()}{row.help[1:]}."
        command = commands.add_parser(name, help=row.help, description=description, usage=usage)
        # only the module of this command is imported
        if name in arguments[:1]:
            find_function(row.place, "splatgl.cli")(command)
            if command.is_long:
                command.add_argument("--help-all", action=HelpAll, nargs=0, help=argparse.SUPPRESS)
    return parser


class Subcommand(NamedTuple):
    """A command. Of another package it is what an entry point of the group `splatgl.commands` leads to, with its name.

    place: function, or place of one as of a `Format`, that adds options to an argparse parser, and sets `run`: a
    function of the arguments that returns the exit code.
    """

    help: str
    place: str | Callable[[argparse.ArgumentParser], None]
    operands: str = ""


COMMANDS = {
    "render": Subcommand("draw pictures of volumes or scenes", "render.add_parser", "SOURCE…"),
    "view": Subcommand("open a window on a volume or a scene", "view.add_parser", "SOURCE"),
    "animate": Subcommand(
        "draw frames or a movie: a turntable, keyframes, or a series", "animate.add_parser", "SOURCE… -o OUTPUT"
    ),
    "compare": Subcommand("compare pictures or folders, and describe changes", "compare.add_parser", "ACTUAL EXPECTED"),
    "info": Subcommand("describe a volume file", "info.add_info_parser", "SOURCE"),
    "presets": Subcommand("list the presets, or render a volume with each", "presets.add_parser", "[SOURCE]"),
    "export": Subcommand(
        "write a page that turns in a browser, splats for other viewers, or surfaces",
        "export.add_export_parser",
        "SOURCE -o OUT.html",
    ),
    "convert": Subcommand("write a volume in another format", "export.add_convert_parser", "SOURCE OUT"),
    "surface": Subcommand(
        "write the surface at a value as a mesh", "export.add_surface_parser", "SOURCE --iso VALUE -o OUT.stl"
    ),
    "pyramid": Subcommand(
        "write a classified volume with coarser levels", "export.add_pyramid_parser", "SOURCE -o DIR.zarr"
    ),
    "pick": Subcommand("print the value and position under a pixel", "pick.add_parser", "SOURCE X,Y"),
    "doctor": Subcommand("describe and check the OpenGL of this machine", "info.add_doctor_parser"),
    "report": Subcommand("measure error against run time of every method", "report.add_parser", "[SOURCE…]"),
}
