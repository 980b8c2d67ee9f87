"""Numbers and colours of the points or cells of meshes in files: which array is drawn, and what it makes of a mesh."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np

from splatgl.data.mesh import Mesh
from splatgl.data.readers.vtk_arrays import PointArray
from splatgl.data.readers.vtk_xml import VtkXml, arrays_of
from splatgl.errors import expected

# of PLY: coordinates and looks, which are no numbers of points; and names that come first, in this order
LOOKS = ("x", "y", "z", "nx", "ny", "nz", "s", "t", "u", "v", "texture_u", "texture_v", "flags")
COLORS = ("red", "green", "blue", "alpha", "r", "g", "b", "a")
FIRST = ("quality", "scalar", "value", "intensity")
# attributes of arrays of VTK that are no numbers of points
DIRECTIONS = ("Normals", "TCoords", "Tangents")
# beginning of the names of VTK's own, such as vtkGhostType
OWN = "vtk"


@dataclass(frozen=True, eq=False)
class Numbers:
    """name: of the array. values float64 [N], or colors uint8 [N, 3], of points; of cells, if `of_cells`."""

    name: str
    values: np.ndarray | None = None
    colors: np.ndarray | None = None
    of_cells: bool = False


def numbers_of(file: VtkXml, piece: Element, counts: tuple[int, int], array: str | None) -> Numbers | None:
    """What a piece of VTK's PolyData is coloured by: the array of that name, else what the file says is active, else
    the first with a number each, of points before cells; None if there is none. counts: of points and cells.

    Of vectors it is the length; bytes of three or four each are colours. Raises InputError for a name that there is
    not.
    """
    found: list[tuple[PointArray, bool]] = []
    active, apart = [], []
    for name, count in zip(("PointData", "CellData"), counts, strict=True):
        owner = piece.find(name)
        if owner is not None and count:
            found += [(each, name == "CellData") for each in arrays_of(file, owner, (1, 1, count))]
            active.append(owner.get("Scalars"))
            apart += [owner.get(attribute) for attribute in DIRECTIONS]
    if array is not None:
        chosen = next((each for each in found if each[0].name == array), None)
        if chosen is None:
            raise expected("array", f"one of {', '.join(each.name for each, _ in found) or 'none'}", repr(array))
    else:
        shown = [each for each in found if each[0].name not in apart and not each[0].name.startswith(OWN)]
        order = [
            *(each for name in active if name for each in shown if each[0].name == name),
            *(each for each in shown if each[0].components == 1),
        ]
        chosen = next(iter(order), None)
    return None if chosen is None else _read(*chosen)


def _read(array: PointArray, of_cells: bool) -> Numbers:
    rows = array.read().reshape(-1, array.components)
    if array.dtype == np.uint8 and array.components in (3, 4):
        return Numbers(array.name, None, rows[:, :3], of_cells)
    values = rows[:, 0] if array.components == 1 else np.linalg.norm(rows.astype(np.float64), axis=1)
    return Numbers(array.name, values.astype(np.float64), None, of_cells)


def of_ply(raw: Any, array: str | None) -> Numbers | None:
    """What a PLY file is coloured by: the property of its vertices of that name, or `quality`, `scalar…`, `value` or
    `intensity`, or the first that is none of a place, a normal or a colour. raw: as trimesh has them.
    """
    table: Any = raw.get("vertex", {}).get("data") if isinstance(raw, dict) else None
    names = table if isinstance(table, dict) else getattr(getattr(table, "dtype", None), "names", None) or ()
    known = {name: np.asarray(table[name]) for name in names}
    shown = [name for name, each in known.items() if name.lower() not in (*LOOKS, *COLORS) and each.dtype.kind in "iuf"]
    if array is not None:
        if array not in known:
            raise expected("array", f"one of {', '.join(shown) or 'none'}", repr(array))
        return Numbers(array, known[array].reshape(-1).astype(np.float64))
    ranked = sorted(shown, key=lambda name: next((n for n, each in enumerate(FIRST) if name.startswith(each)), 9))
    return Numbers(ranked[0], known[ranked[0]].reshape(-1).astype(np.float64)) if ranked else None


def colored(mesh: Mesh, numbers: Numbers | None, points: np.ndarray) -> Mesh:
    """A mesh with the numbers of points; of each vertex those of the point `points` [N]."""
    if numbers is None:
        return mesh
    values, colors = (None if each is None else each[points] for each in (numbers.values, numbers.colors))
    return replace(mesh, values=values, colors=colors, quantity=numbers.name)


def by_cells(mesh: Mesh, numbers: Numbers, cells: np.ndarray) -> Mesh:
    """A mesh with the numbers of cells, of each triangle those of the cell `cells` [M]: triangles share no vertices."""
    apart = replace(
        mesh,
        vertices=mesh.vertices[mesh.faces].reshape(-1, 3),
        faces=np.arange(3 * len(mesh)).reshape(-1, 3),
        corner_normals=mesh.normals,
    )
    return colored(apart, numbers, np.repeat(cells, 3))


def together(meshes: Sequence[Mesh]) -> Mesh:
    """Meshes as one; what has no value or colour is drawn as the file's default."""
    some = [each for each in meshes if len(each)]
    if len(some) < 2:
        return some[0] if some else Mesh(np.zeros((0, 3)), np.zeros((0, 3), np.int64))
    first = np.cumsum([0, *(len(each.vertices) for each in some)])
    values = colors = normals = None
    if any(each.values is not None for each in some):
        values = [np.full(len(each.vertices), np.nan) if each.values is None else each.values for each in some]
    if any(each.colors is not None for each in some):
        gray = [np.full((len(each.vertices), 3), 200, np.uint8) for each in some]
        colors = [own if each.colors is None else each.colors for each, own in zip(some, gray, strict=True)]
    if any(each.corner_normals is not None for each in some):
        normals = np.concatenate([each.normals for each in some])
    return Mesh(
        np.concatenate([each.vertices for each in some]),
        np.concatenate([each.faces + start for each, start in zip(some, first[:-1], strict=True)]),
        colors=None if colors is None else np.concatenate(colors),
        values=None if values is None else np.concatenate(values),
        quantity=next((each.quantity for each in some if each.quantity), ""),
        corner_normals=normals,
    )
