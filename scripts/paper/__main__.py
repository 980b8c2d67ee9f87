"""`scripts/figure`: the paper's figures as images and numbers, checks of its claims, and the errors of one splat."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from textwrap import fill

from paper.claims import page
from paper.explain import add_parser as add_explained
from paper.figures import FIGURES, Figure
from paper.figures.forms_table import CAPTION, forms_picture, forms_table
from paper.figures.rendered import PICTURES, add_pictures, check_no_options, run_picture
from paper.tables import TEXT_WIDTH

from splatgl import __version__
from splatgl.cli.main import reject_empty
from splatgl.cli.parser import BAD_INPUT, Parser, one_line
from splatgl.errors import InputError, expected
from splatgl.fileio import check_output, write_file

# figures whose text output is the claims based on them
CLAIMED = (9, 10)
# numbers of all available figures
KNOWN = sorted([*FIGURES, *PICTURES])
# the paper's table as a picture
TABLE_1 = Figure("table1", CAPTION, forms_picture, forms_table)
# text, of which Table 1 is a picture, too
PRINTED = {"claims": page, "table1": lambda: text(TABLE_1)}


def main(arguments: Sequence[str] | None = None) -> int:
    """Draws, writes or prints; returns 0, or BAD_INPUT after a line about bad input."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    if given[:1] == ["explain"]:
        about = "Print the error of each form of splat for one voxel."
        parser = Parser(prog="scripts/figure explain", description=about)
        add_explained(parser)
    else:
        parser = Parser(prog="scripts/figure", description="Draw a figure of the paper, or check its claims.")
        add_parser(parser)
    args = parser.parse_args(given[1:] if given[:1] == ["explain"] else given)
    try:
        reject_empty(args)
        return int(args.run(args))
    except InputError as error:
        print(f"{parser.prog}: {one_line(parser.with_flags(str(error), args))}", file=sys.stderr)
        return BAD_INPUT


def add_parser(parser: argparse.ArgumentParser) -> None:
    """Adds the options of `scripts/figure`."""
    names = " ".join(map(str, KNOWN))
    parser.add_argument(
        "number",
        metavar="N",
        help=f"{names}; {'; '.join(PRINTED)}; explain X,Y,Z: the errors of a splat",
    )
    add_pictures(parser)
    parser.add_argument("-o", "--output", metavar="FILE", help=".png or .svg to write (default figureN.png)")
    parser.add_argument("--numbers", action="store_true", help="print the numbers; no picture without --output")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Draws, writes or prints one figure; returns 0."""
    if args.number in PRINTED:
        if args.output and args.number != TABLE_1.number:
            raise expected(f"figure {args.number}", "no file to write", args.output, "it is printed")
        print(PRINTED[args.number]())
        if args.output:
            _write(TABLE_1, Path(args.output))
        return 0
    if args.number in map(str, PICTURES):
        return run_picture(args)
    check_no_options(args)
    figure = _figure(args.number)
    output = Path(args.output or f"figure{figure.number}.png")
    if args.output or not args.numbers:
        _write(figure, output)
        print(f"{output}:", fill(figure.title, TEXT_WIDTH), sep="\n")
    if args.numbers:
        print(text(figure))
    return 0


def _write(figure: Figure, output: Path) -> None:
    """Writes a picture. Raises InputError for other endings."""
    check_output(output, (".png", ".svg"))
    write_file(output, figure.picture(output.suffix.lower(), f"splatgl {__version__}"))


def text(figure: Figure) -> str:
    """A figure's data as a page of text."""
    head = fill(figure.title, TEXT_WIDTH)
    body = page(figure.number) if figure.number in CLAIMED else figure.table().text()
    return f"{head}\n\n{body}"


def _figure(number: str) -> Figure:
    if not number.isdecimal() or int(number) not in FIGURES:
        known = ", ".join(map(str, KNOWN))
        raise expected("figure", f"one of {known}, or {' or '.join(PRINTED)}", number)
    return FIGURES[int(number)]


if __name__ == "__main__":
    sys.exit(main())
