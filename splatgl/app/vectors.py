"""Vectors in pictures: `--vectors`, `--streamlines`, `--arrows`, and the table [vectors] of scene files."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any

from splatgl.data.volume import Volume
from splatgl.errors import expected

if TYPE_CHECKING:
    from splatgl.data.mesh import Mesh

# what is drawn as values instead of the volume's own
SHOWN = ("magnitude", "direction")
# numbers of lines and arrows, where none is given, and most
LINES, ARROWS, MOST = 200, 400, 10_000
# factor of the opacities of a volume with lines or arrows, unless its look is given
FAINT = 0.15


@dataclass(frozen=True)
class Vectors:
    """How a volume's vectors are drawn. show: "magnitude", "direction" or "": the volume's own values. streamlines,
    arrows: how many. colormap: of their speeds. Raises InputError for others.
    """

    show: str = ""
    streamlines: int = 0
    arrows: int = 0
    colormap: str = "viridis"

    def __post_init__(self) -> None:
        if self.show not in ("", *SHOWN):
            raise expected("vectors", " or ".join(SHOWN), repr(self.show)[:80])
        for name, most in (("streamlines", LINES), ("arrows", ARROWS)):
            count = most if getattr(self, name) is True else getattr(self, name) or 0
            if not isinstance(count, int) or not 0 <= count <= MOST:
                raise expected(name, f"a whole number up to {MOST}", repr(count)[:80])
            object.__setattr__(self, name, count)
        if not isinstance(self.colormap, str):
            raise expected("colormap", "a name", repr(self.colormap)[:80])

    @property
    def drawn(self) -> bool:
        """Whether there are lines or arrows."""
        return bool(self.streamlines or self.arrows)

    @property
    def told(self) -> dict[str, Any]:
        """The fields that differ from their defaults."""
        every = {each.name: (getattr(self, each.name), each.default) for each in fields(self)}
        return {name: value for name, (value, default) in every.items() if value != default}

    def values(self, volume: Volume) -> Volume:
        """The volume that is drawn. Raises InputError for one without vectors."""
        if not self.show:
            return volume
        from splatgl.splat.vector_field import directions, magnitudes

        return magnitudes(volume) if self.show == "magnitude" else directions(volume)

    def meshes(self, volume: Volume) -> list[Mesh]:
        """Lines and arrows. Raises InputError for a volume without vectors."""
        from splatgl.splat.vector_field import arrows, streamlines

        found = [streamlines(volume, self.streamlines, colormap=self.colormap)] if self.streamlines else []
        return found + ([arrows(volume, self.arrows, colormap=self.colormap)] if self.arrows else [])

    @classmethod
    def of_table(cls, table: Mapping[str, Any]) -> Vectors:
        """Of a scene file. Raises InputError for other keys and values."""
        unknown = [key for key in table if key not in (known := [each.name for each in fields(cls)])]
        if unknown:
            raise expected("vectors", f"keys {', '.join(known)}", ", ".join(unknown))
        return cls(**table)


def add_vectors(parser: argparse.ArgumentParser) -> None:
    """Adds the options of vectors."""
    group = parser.add_argument_group("vectors, such as velocities, of the volume")
    about = "draw their lengths, coloured by direction or not, instead of the volume's values"
    group.add_argument("--vectors", choices=SHOWN, metavar="|".join(SHOWN), help=about)
    for name, count, what in (("streamlines", LINES, "lines along them"), ("arrows", ARROWS, "arrows")):
        about = f"{what}, spread evenly, coloured by speed ({count})"
        group.add_argument(f"--{name}", nargs="?", const=count, type=int, metavar="N", help=about)


def asked_vectors(given: Mapping[str, Any], base: Vectors) -> Vectors:
    """The options over what a scene file says; those that are None or missing are not given."""
    names = {"vectors": "show", "streamlines": "streamlines", "arrows": "arrows"}
    over = {field: given[name] for name, field in names.items() if given.get(name) is not None}
    return Vectors(**{**base.told, **over}) if over else base
