"""Meshes and vectors of scenes: options, files, colours."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from splatgl.data.affine import World
from splatgl.data.mesh import CAPS, OF_VOLUME
from splatgl.data.volume import Volume, empty_volume
from splatgl.errors import InputError, error_prefix, expected
from splatgl.fileio import toml_rows
from splatgl.options import HelpGroup, Option, ValueKind, check_options, declared, non_default, option, reject_unknown
from splatgl.readers.points import is_points

if TYPE_CHECKING:
    from splatgl.data.mesh import Mesh
    from splatgl.scene.scene_file import SceneFile


@dataclass(frozen=True)
class MeshFile:
    """A mesh of a scene. color: #rrggbb, a CSS name, or a colour map for its values; "": the file's colour. radius: of
    lines, world units, or None. array: name of the values, "": the file's first array; window: of these values. clip:
    whether the scene's planes clip the mesh; caps: and close it, as of `Mesh`. visible: whether it is drawn. title: its
    name in lists; "": the file's.
    """

    file: str = field(metadata={"option": Option(ValueKind.instance("the name of a file", str))})
    color: str = option("", ValueKind.instance("the name of a colour", str))
    opacity: float = option(1.0, ValueKind.number("a factor from 0 to 1", 0, 1))
    radius: float | None = option(None, ValueKind.number())
    array: str = option("", ValueKind.instance("the name of an array", str))
    window: tuple[float, float] | None = option(None, ValueKind.interval())
    clip: bool = option(False, ValueKind.flag())
    caps: str = option(
        "",
        ValueKind.choice(CAPS),
        "close meshes where --clip and --crop cut them, in their colour or with the volume's values there",
        group=HelpGroup.LAYERS,
    )
    visible: bool = option(True, ValueKind.flag())
    title: str = option("", ValueKind.instance("a name", str))
    held: Mesh | None = None

    def __post_init__(self) -> None:
        check_options(self)
        # caps close what is cut
        object.__setattr__(self, "clip", self.clip or bool(self.caps))

    @classmethod
    def of(cls, mesh: Any) -> MeshFile:
        """The entry of a Mesh, or of the name of a file. Raises InputError for other types."""
        from splatgl.data.mesh import Mesh

        if isinstance(mesh, MeshFile | str | Path):
            return mesh if isinstance(mesh, MeshFile) else cls(str(mesh))
        if not isinstance(mesh, Mesh):
            raise expected("meshes", "meshes, or names of files", type(mesh).__name__)
        return cls(mesh.name, opacity=mesh.opacity, clip=mesh.clipped, caps=mesh.caps, held=mesh)

    @classmethod
    def read(cls, text: str) -> MeshFile:
        """The entry of FILE[:COLOUR[:OPACITY]]; COLOUR: or MAP, MAP=ARRAY or =ARRAY. Raises ValueError otherwise."""
        file, look, opacity = split_look(text, lambda name: not any(sign in name.partition("=")[0] for sign in "./"))
        color, _, array = look.partition("=")
        return cls(file, color, opacity, array=array)

    @property
    def name(self) -> str:
        """Name of the mesh in messages and lists."""
        return self.title or Path(self.file).name

    @property
    def linear(self) -> tuple[float, float, float] | None:
        """The colour, linear RGB; None: the file's colour, or a colour map. Raises InputError for an unknown name."""
        return _linear(self.color) if self.color else None

    def open(self) -> Mesh:
        """The mesh. Raises InputError as `load_mesh`, and for an unknown colour."""
        from splatgl.readers.meshes import load_mesh

        if self.held is not None:
            return self.apply_to(self.held)
        mesh = load_mesh(self.file, None, self.opacity, self.radius, self.array or None, self.window)
        return self.apply_to(mesh)

    def apply_to(self, mesh: Mesh) -> Mesh:
        """The mesh in the colour and opacity of this entry. mesh: of the same file."""
        from splatgl.readers.meshes import color_mesh

        styled = replace(mesh, opacity=self.opacity, clipped=self.clip, caps=self.caps)
        return color_mesh(styled, self.linear or self.color or None)

    @classmethod
    def of_table(cls, what: str, table: Any) -> MeshFile:
        """The entry of a table of a scene file. Raises InputError for unknown keys and bad values."""
        if not isinstance(table, Mapping):
            raise expected(what, "a table", repr(table)[:80])
        reject_unknown(what, table, declared(cls))
        if "file" not in table:
            raise expected(what, "the key file", ", ".join(table) or "none")
        with error_prefix(what):
            return cls(**table)

    def lines(self) -> list[str]:
        """Lines of the table of a scene file. Raises InputError for a mesh in memory."""
        if self.held is not None:
            raise expected("scene", "meshes in files, which a scene file can name", "one in memory")
        return toml_rows("[[mesh]]", non_default(self))


def source_key(file: MeshFile) -> MeshFile:
    """Key of the data of a mesh, whatever its style."""
    return replace(file, color="", opacity=1.0, clip=False, caps="", visible=True, title="")


def read_meshes(files: Sequence[MeshFile]) -> dict[MeshFile, Mesh]:
    """The data of meshes, by `source_key`. Raises InputError as `MeshFile.open`."""
    return {key: key.open() for key in dict.fromkeys(map(source_key, files))}


def styled_mesh(file: MeshFile, mesh: Mesh) -> Mesh:
    """The mesh of a file in the style of its entry, with the normals that it has."""
    styled = file.apply_to(mesh)
    # normals take as long as a frame, and do not depend on colours
    vars(styled)["normals"] = mesh.normals
    return styled


# a preset or a colour map behind a file's name
LOOK = re.compile(r"#?[\w-]+")


def split_look(text: str, is_look: Callable[[str], bool]) -> tuple[str, str, float]:
    """File, look and opacity of FILE[:LOOK[:OPACITY]]. Raises ValueError without a file, and for a bad opacity."""
    source, look, opacity = text, "", 1.0
    head, colon, last = source.rpartition(":")
    with suppress(ValueError):
        source, opacity = (head, float(last)) if colon else (source, opacity)
    head, colon, last = source.rpartition(":")
    if colon and is_look(last):
        source, look = head, last
    if not source or not 0 <= opacity <= 1:
        raise ValueError
    return source, look, opacity


# suffixes of mesh files, which can be a source
ALONE = (".ply", ".stl", ".obj", ".off", ".glb", ".vtp", ".trk", ".tck")


def is_mesh(source: str) -> bool:
    """Whether a source is a mesh file, by its suffix; PLY files without faces are points."""
    return Path(source).suffix.lower() in ALONE and not is_points(source)


def reject_volume_options(mesh: str, names: Sequence[str]) -> None:
    """Raises InputError for options, by their names, that change only volumes, where a mesh is drawn without one."""
    if names:
        fix = "--clip-meshes clips meshes" if names[0] == "clip" else "name the volume first and meshes by --mesh"
        raise expected(names[0], "a volume, which it changes", f"the mesh {mesh}", fix)


def clipped_meshes(source: str, meshes: tuple[MeshFile, ...], options: Mapping[str, Any]) -> tuple[MeshFile, ...]:
    """The meshes of a scene, and its source if it is one, as options `clip_meshes` and `caps` have planes cut them; as
    they are without these. Raises InputError if there is no mesh.
    """
    caps = options.get("caps")
    if not (caps or options.get("clip_meshes")):
        return meshes
    adds_source = is_mesh(source) and source not in [mesh.file for mesh in meshes]
    cut = [MeshFile(source)] * adds_source + [*meshes]
    if not cut:
        name, this = ("caps", "a mesh to close") if caps else ("clip_meshes", "a mesh to cut")
        raise expected(name, this, "none", "--mesh adds one")
    return tuple(replace(mesh, clip=True, caps=caps or mesh.caps) for mesh in cut)


def stage(meshes: Sequence[Mesh], name: str = "") -> Volume:
    """Empty volume with the bounding box of meshes, to place the camera."""
    frame, unit = World.shared(mesh.world for mesh in meshes)
    vertices = np.concatenate([mesh.placed(frame, unit).vertices for mesh in meshes])
    return empty_volume(vertices.min(axis=0), vertices.max(axis=0), name=name, frame=frame, unit=unit)


def surfaces_of(scene: SceneFile) -> list[MeshFile]:
    """The meshes of a scene; a source that is a mesh file is the first. InputError for slices and caps of no volume."""
    has_caps, sliced = any(mesh.caps == OF_VOLUME for mesh in scene.meshes), scene.slices or scene.slice_planes
    if is_mesh(scene.volume) and (has_caps or sliced):
        what, this = "slice" if sliced else "caps", "a volume, whose values are shown"
        raise expected(what, this, f"the mesh {scene.volume}", "name the volume first and meshes by --mesh")
    alone = is_mesh(scene.volume) and scene.volume not in [mesh.file for mesh in scene.meshes]
    return [MeshFile(scene.volume), *scene.meshes] if alone else [*scene.meshes]


def _linear(color: str) -> tuple[float, float, float] | None:
    """Linear RGB of a colour; None for the name of a colour map. Raises InputError for unknown names."""
    from splatgl.data.color import read_background
    from splatgl.transfer.colormaps import colormap

    try:
        rgb = read_background(color)
    except ValueError:
        rgb = ""
    if not isinstance(rgb, str):
        return rgb
    try:
        colormap(color)
    except InputError:
        this = "a colour such as #e8dcc8 or red, or a colour map such as viridis"
        raise InputError(f"mesh: expected {this}, got {color!r}") from None
    return None


# properties of vectors that can be drawn as values
SHOWN = ("magnitude", "direction")
# default numbers of lines and arrows, and the largest
LINES, ARROWS, MOST = 200, 400, 10_000
# options of vectors by name, and their fields of Vectors
VECTORS = {"vectors": "show", "streamlines": "streamlines", "arrows": "arrows"}


def _count(usual: int) -> ValueKind:
    """A number of lines or arrows; True: the default number."""
    count = ValueKind.whole(0, MOST, f"a whole number up to {MOST}")
    return replace(count, check=lambda value: usual if value is True else count.check(value or 0))


_option = partial(option, group=HelpGroup.LAYERS)


@dataclass(frozen=True)
class Vectors:
    """Options of a volume's vectors. show: draw "magnitude" or "direction" as values; "": the volume's values.
    streamlines, arrows: their numbers. colormap: of speeds. Raises InputError for bad values.
    """

    show: str = _option(
        "",
        ValueKind.choice(SHOWN),
        "draw the vectors' lengths instead of values, coloured by direction or not",
        flag="--vectors",
    )
    streamlines: int = _option(
        0, _count(LINES), f"lines along the vectors, coloured by speed (default {LINES})", bare=LINES
    )
    arrows: int = _option(
        0, _count(ARROWS), f"arrows along the vectors, coloured by speed (default {ARROWS})", bare=ARROWS
    )
    colormap: str = option("viridis", ValueKind.instance("a name", str))

    def __post_init__(self) -> None:
        check_options(self)

    @property
    def has_lines(self) -> bool:
        """Whether there are streamlines or arrows."""
        return bool(self.streamlines or self.arrows)

    def values(self, volume: Volume) -> Volume:
        """The volume to draw. Raises InputError if it needs vectors and has none."""
        if not self.show:
            return volume
        from splatgl.splat.vector_field import directions, magnitudes

        with error_prefix("vectors"):
            return magnitudes(volume) if self.show == "magnitude" else directions(volume)

    def meshes(self, volume: Volume) -> list[Mesh]:
        """Streamlines and arrows. Raises InputError for a volume without vectors."""
        from splatgl.splat.vector_field import arrows, streamlines

        meshes = []
        for name, count, draw in (("streamlines", self.streamlines, streamlines), ("arrows", self.arrows, arrows)):
            with error_prefix(name):
                meshes += [draw(volume, count, colormap=self.colormap)] if count else []
        return meshes
