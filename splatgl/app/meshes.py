"""Meshes beside volumes: `--mesh`, and the tables [[mesh]] of scene files."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from splatgl.data.errors import InputError, expected
from splatgl.data.toml import toml_value
from splatgl.data.volume import Hints, Volume

if TYPE_CHECKING:
    from splatgl.app.scene import Scene
    from splatgl.data.mesh import Mesh

# the keys of a table, and their types
KEYS: dict[str, tuple[type, ...]] = {
    "file": (str,),
    "color": (str,),
    "opacity": (int, float),
    "radius": (int, float),
    "visible": (bool,),
}


@dataclass(frozen=True)
class MeshFile:
    """A mesh of a scene. color: #rrggbb or a name of CSS; "": the file's. radius: of lines, world units, or None.
    visible: whether it is drawn.
    """

    file: str
    color: str = ""
    opacity: float = 1.0
    radius: float | None = None
    visible: bool = True

    @property
    def name(self) -> str:
        """What it is called."""
        return Path(self.file).name

    @property
    def linear(self) -> tuple[float, float, float] | None:
        """Its colour, linear RGB; None: the file's. Raises InputError for a colour that has no name."""
        return _linear(self.color) if self.color else None

    def open(self) -> Mesh:
        """The mesh. Raises InputError as `load_mesh`, and for a colour that has no name."""
        from splatgl.data.readers.mesh_files import load_mesh

        return load_mesh(self.file, self.linear, self.opacity, self.radius)

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
        return cls(**{**table, "file": str(folder / table["file"])})

    def lines(self, file: str) -> list[str]:
        """The lines of its table; file: its path there."""
        given = {"file": file, "color": self.color or None, "radius": self.radius}
        given |= {"opacity": float(self.opacity)} if self.opacity != 1 else {}
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
        look: dict[str, Any] = {} if self.linear is None else {"color": self.linear, "colors": None}
        return replace(self.held, opacity=self.opacity, **look)

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


def surfaces_of(scene: Scene) -> list[MeshFile]:
    """The meshes of a scene, with the one that stands for its volume unless it is among them."""
    found = [
        each if isinstance(each, MeshFile) else HeldMesh(each.name, opacity=each.opacity, held=each)
        for each in scene.meshes
    ]
    alone = is_mesh(scene.volume) and scene.volume not in [each.file for each in found]
    return [MeshFile(scene.volume), *found] if alone else found


def mesh_option(text: str) -> MeshFile:
    """An argparse type: the mesh of FILE[:COLOUR[:OPACITY]]."""
    return MeshFile(*with_look(text, lambda last: "." not in last and "/" not in last, "COLOUR"))


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


def _linear(color: str) -> tuple[float, float, float]:
    from splatgl.app.backgrounds import background

    try:
        found = background(color)
    except argparse.ArgumentTypeError:
        found = ""
    if isinstance(found, str):
        raise InputError(f"mesh: expected a colour such as #e8dcc8 or red, got {color!r}")
    return found
