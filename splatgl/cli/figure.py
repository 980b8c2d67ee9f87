"""`splatgl figure`: the paper's figures as images and numbers, and checks of its claims."""

from __future__ import annotations

import argparse
from pathlib import Path
from textwrap import fill

from paper.claims import page
from paper.figures import FIGURES, Figure
from paper.figures.rendered import PICTURES, add_pictures, check_no_options, run_picture

from splatgl import __version__
from splatgl.errors import expected
from splatgl.fileio import check_output, write_file
from splatgl.report.tables import PAGE

# figures whose text output is the claims based on them
CLAIMED = (9, 10)
# numbers of all available figures
KNOWN = sorted([*FIGURES, *PICTURES])


def add_parser(parser: argparse.ArgumentParser) -> None:
    """Adds the options of `splatgl figure`."""
    names = " ".join(map(str, KNOWN))
    parser.add_argument("number", metavar="N", help=f"{names}, or claims: checks all claims of the paper")
    add_pictures(parser)
    parser.add_argument("-o", "--output", metavar="FILE", help=".png or .svg to write (default figureN.png)")
    parser.add_argument("--csv", metavar="FILE", help="write the numbers; no picture without --output")
    parser.add_argument(
        "--text", "--numbers", action="store_true", help="print the numbers; no picture without --output"
    )
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Draws, writes or prints one figure; returns 0."""
    if args.number == "claims":
        if args.output or args.csv:
            raise expected("figure claims", "no file to write", args.output or args.csv, "it is printed")
        print(page())
        return 0
    if args.number in map(str, PICTURES):
        return run_picture(args)
    check_no_options(args)
    figure = _figure(args.number)
    output = Path(args.output or f"figure{figure.number}.png")
    drawn = bool(args.output) or not (args.csv or args.text)
    if drawn:
        check_output(output, (".png", ".svg"))
    if args.csv:
        check_output(Path(args.csv), (".csv",))
        write_file(Path(args.csv), figure.table().csv().encode())
        print(f"{args.csv}: the numbers of figure {figure.number}")
    if drawn:
        write_file(output, figure.picture(output.suffix.lower(), f"splatgl {__version__}"))
        print(f"{output}:", fill(f"Figure {figure.number}. {figure.caption}", PAGE), sep="\n")
    if args.text:
        print(text(figure))
    return 0


def text(figure: Figure) -> str:
    """A figure's data as a page of text."""
    head = fill(f"Figure {figure.number}. {figure.caption}", PAGE)
    body = page(figure.number) if figure.number in CLAIMED else figure.table().text()
    return f"{head}\n\n{body}"


def _figure(number: str) -> Figure:
    if not number.isdecimal() or int(number) not in FIGURES:
        known = ", ".join(map(str, KNOWN))
        raise expected("figure", f"one of {known}, or claims", number)
    return FIGURES[int(number)]
