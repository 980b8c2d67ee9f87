"""Vectors in pictures: `--vectors`, `--streamlines`, `--arrows`, and the table [vectors] of scene files."""

from __future__ import annotations

import argparse

from splatgl.scene.meshes import ARROWS, LINES, SHOWN


def add_vectors(parser: argparse.ArgumentParser) -> None:
    """Adds the options of vectors."""
    group = parser.add_argument_group("vectors, such as velocities, of the volume")
    about = "draw their lengths, coloured by direction or not, instead of the volume's values"
    group.add_argument("--vectors", choices=SHOWN, metavar="|".join(SHOWN), help=about)
    for name, count, what in (("streamlines", LINES, "lines along them"), ("arrows", ARROWS, "arrows")):
        about = f"{what}, spread evenly, coloured by speed ({count})"
        group.add_argument(f"--{name}", nargs="?", const=count, type=int, metavar="N", help=about)
