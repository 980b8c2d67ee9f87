"""Meshes and vectors of scenes: options, files, colours."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from splatgl.data.volume import Hints, Volume
from splatgl.errors import InputError, expected
from splatgl.fileio import toml_value

if TYPE_CHECKING:
    from splatgl.data.mesh import Mesh
    from splatgl.scene.scene_file import SceneFile


# the keys of a table, and their types
KEYS: dict[str, tuple[type, ...]] = {
    "file": (str,),
    "color": (str,),
    "opacity": (int, float),
    "radius": (int, float),
    "array": (str,),
    "window": (list,),
    "clip": (bool,),
    "visible": (bool,),
}


@dataclass(frozen=True)
class MeshFile:
    """A mesh of a scene. color: #rrggbb or a name of CSS, or of a colour map for its values; "": the file's. radius: of
    lines, world units, or None. array: the name of its values, "": the file's first; window: of these. clip: whether
    the scene's planes cut it. visible: whether it is drawn.
    """

    file: str
    color: str = ""
    opacity: float = 1.0
    radius: float | None = None
    array: str = ""
    window: tuple[float, float] | None = None
    clip: bool = False
    visible: bool = True

    @property
    def name(self) -> str:
        """What it is called."""
        return Path(self.file).name

    @property
    def linear(self) -> tuple[float, float, float] | None:
        """Its colour, linear RGB; None: the file's, or those of its values. Raises InputError for what is no name of a
        colour or a colour map.
        """
        return _linear(self.color) if self.color else None

    def open(self) -> Mesh:
        """The mesh. Raises InputError as `load_mesh`, and for a colour that has no name."""
        from splatgl.readers.meshes import load_mesh

        found = load_mesh(self.file, None, self.opacity, self.radius, self.array or None, self.window)
        return self.dressed(found)

    def dressed(self, mesh: Mesh) -> Mesh:
        """A mesh of the same file in this colour and opacity."""
        from splatgl.readers.meshes import color_mesh

        made = replace(mesh, opacity=self.opacity, clipped=self.clip)
        return color_mesh(made, self.linear or self.color or None)

    @classmethod
    def of_table(cls, folder: Path, what: str, table: Any) -> MeshFile:
        """Of a scene file in a folder. Raises InputError for other keys and values."""
        if not isinstance(table, Mapping):
            raise expected(what, "a table", repr(table)[:80])
        unknown = [key for key in table if key not in KEYS]
        if unknown:
            raise expected(what, f"keys {', '.join(KEYS)}", ", ".join(unknown))
        if "file" not in table:
            raise expected(what, "the key file", ", ".join(table) or "none")
        for key, value in table.items():
            if not isinstance(value, KEYS[key]) or isinstance(value, bool) != (bool in KEYS[key]):
                raise expected(f"{what}: {key}", " or ".join(kind.__name__ for kind in KEYS[key]), repr(value)[:80])
        if not 0 <= table.get("opacity", 1) <= 1:
            raise expected(f"{what}: opacity", "a factor from 0 to 1", table["opacity"])
        given = {**table, "file": str(folder / table["file"])}
        if "window" in table:
            numbers = [n for n in table["window"] if isinstance(n, int | float) and not isinstance(n, bool)]
            if len(numbers) != len(table["window"]) or len(numbers) != 2 or not numbers[0] < numbers[1]:
                raise expected(f"{what}: window", "two numbers, the first below the second", repr(table["window"])[:80])
            given["window"] = (float(numbers[0]), float(numbers[1]))
        return cls(**given)

    def lines(self, file: str) -> list[str]:
        """The lines of its table; file: its path there."""
        given: dict[str, Any] = {"file": file, "color": self.color or None, "radius": self.radius}
        given |= {"opacity": float(self.opacity)} if self.opacity != 1 else {}
        given |= {"array": self.array or None, "window": self.window, "clip": self.clip or None}
        given |= {} if self.visible else {"visible": False}
        told = [f"{key} = {toml_value(key, value)}" for key, value in given.items() if value is not None]
        return ["", "[[mesh]]", *told]


@dataclass(frozen=True)
class HeldMesh(MeshFile):
    """A mesh in memory."""

    held: Mesh | None = None

    def open(self) -> Mesh:
        """The mesh with its opacity, and in its colour if there is one."""
        assert self.held is not None
        return replace(self.dressed(self.held), clipped=self.clip or self.held.clipped)

    def lines(self, file: str) -> list[str]:
        """Raises InputError: a scene file names a mesh's file."""
        raise expected("scene", "meshes in files, which a scene file can name", "one in memory")


# endings of sources that are meshes, drawn alone
ALONE = (".ply", ".stl", ".obj", ".off", ".glb", ".vtp", ".trk", ".tck")
# shortest side of the box around a mesh, in its longest
FLAT = 1e-3


def is_mesh(source: str) -> bool:
    """Whether a source is a mesh, by its ending."""
    return Path(source).suffix.lower() in ALONE


def stage(source: str) -> Volume:
    """A volume of nothing in the box of a mesh that is drawn alone: its world, and what the view is fitted to."""
    mesh = MeshFile(source).open()
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    side = np.maximum(high - low, FLAT * max(float((high - low).max()), 1e-30))
    # two samples along each axis, cells of half a side
    (a, b, c), (x, y, z) = (side / 2).tolist(), ((low + high) / 2 - side / 4).tolist()
    hints = Hints(points=((0.0, 0.0), (1.0, 0.0)), window=(0.0, 1.0))
    nothing = np.zeros((2, 2, 2), np.uint8)
    return Volume(nothing, (a, b, c), (x, y, z), name=Path(source).name, frame=mesh.frame, hints=hints)


def surfaces_of(scene: SceneFile) -> list[MeshFile]:
    """The meshes of a scene, with the one that stands for its volume unless it is among them."""
    found = [
        each if isinstance(each, MeshFile) else HeldMesh(each.name, opacity=each.opacity, held=each)
        for each in scene.meshes
    ]
    alone = is_mesh(scene.volume) and scene.volume not in [each.file for each in found]
    return [MeshFile(scene.volume), *found] if alone else found


def mark_clipped(mesh: MeshFile | Mesh) -> MeshFile | Mesh:
    """The same, cut by planes."""
    return replace(mesh, clip=True) if isinstance(mesh, MeshFile) else replace(mesh, clipped=True)


def _linear(color: str) -> tuple[float, float, float] | None:
    """Of a colour; None for the name of a colour map. Raises InputError for others."""
    from splatgl.data.color import read_background
    from splatgl.splat.colormaps import colormap

    try:
        found = read_background(color)
    except ValueError:
        found = ""
    if not isinstance(found, str):
        return found
    try:
        colormap(color)
    except InputError:
        this = "a colour such as #e8dcc8 or red, or a colour map such as viridis"
        raise InputError(f"mesh: expected {this}, got {color!r}") from None
    return None


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


def asked_vectors(given: Mapping[str, Any], base: Vectors) -> Vectors:
    """The options over what a scene file says; those that are None or missing are not given."""
    names = {"vectors": "show", "streamlines": "streamlines", "arrows": "arrows"}
    over = {field: given[name] for name, field in names.items() if given.get(name) is not None}
    return Vectors(**{**base.told, **over}) if over else base
