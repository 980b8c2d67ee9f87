"""Meshes: PLY, OBJ, OFF, STL, GLB, VTP, TRK and TCK, with colours and values at vertices."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from splatgl.coercion import public
from splatgl.data.affine import metres_in
from splatgl.data.mesh import SIDES, Mesh, ring_points
from splatgl.errors import InputError, expected, import_extra
from splatgl.fileio import require_existing
from splatgl.readers import with_path
from splatgl.readers.common import decoder_errors, silence_libraries
from splatgl.readers.elsewhere import call
from splatgl.readers.polygons import DEFAULT, Polygons, read_obj, read_off, read_ply_polygons
from splatgl.readers.vtk_files import PointArray, corners, finite_points, list_arrays, open_reader, vtk_errors
from splatgl.readers.vtk_images import parse_legacy
from splatgl.readers.vtk_xml import check_xml

# default radius of lines: a share of the diagonal of all lines
THIN = 1 / 400
# default radius of balls: a share of the diagonal of all points
THICK = 1 / 200
# comments on the directions of x and y, as 3D Slicer writes them, and on the unit of length
SPACE = re.compile(rb"SPACE\s*[=:]\s*(LPS|RAS)")
UNIT = re.compile(rb"UNITS?\s*[=:]\s*([A-Za-z]+)")
HEADER = 1024

# arguments: path, radius of lines, name of an array of numbers
Read = Callable[[Path, float | None, str | None], Mesh]
# "#rrggbb"; any other text names a colour map
CODE = re.compile("#[0-9a-fA-F]{6}")


@public
def load_mesh(
    path: str | Path,
    color: str | tuple[float, float, float] | None = None,
    opacity: float = 1.0,
    radius: float | None = None,
    array: str | None = None,
    window: tuple[float, float] | None = None,
) -> Mesh:
    """The triangles of a file, in the file's coordinates. color: replaces the file's; or the name of a colour map for
    numbers of points or cells. radius: of lines, world units. array: the name of those numbers, if there are several.
    window: the values at the ends of the map.

    Numbers are drawn if the file has no colours, or if a map or an array is named. Raises InputError for a file that is
    no mesh, for an unknown array, and for a map without numbers.
    """
    file = Path(path)
    require_existing(file, path)
    read = MESHES.get(file.suffix.lower())
    if read is None:
        raise expected(path, f"a mesh: {', '.join(sorted(MESHES))}", file.suffix or "no ending")
    try:
        if not file.is_file():
            raise InputError("expected a file, got a folder, pipe or device")
        # a file's contents are untrusted: any failure is attributed to the file
        with silence_libraries(), decoder_errors("a mesh"):
            mesh = read(file, radius, array)
        if not len(mesh):
            raise expected("mesh", "at least one triangle or line", "none")
    except (InputError, OSError) as error:
        raise with_path(path, InputError(str(error))) from error
    mesh = replace(mesh, opacity=opacity, name=file.name, window=window)
    return color_mesh(mesh, color)


def color_mesh(mesh: Mesh, color: str | tuple[float, float, float] | None) -> Mesh:
    """The mesh in a colour, or with its values in a colour map. Raises InputError for a map without values."""
    if color is None:
        return mesh
    if not isinstance(color, str) or CODE.fullmatch(color):
        return replace(mesh, color=color, colors=None, values=None)
    if mesh.values is None:
        what = f"{mesh.name}: numbers at its points or cells".strip(": ")
        raise expected("mesh", f"{what}, for the colour map {color}", "none")
    return replace(mesh, colormap=color, colors=None)


def _read_polygons(read: Callable[[Path], Polygons], path: Path, radius: float | None, array: str | None) -> Mesh:
    """Reads polygons, and lines as tubes; points without either become balls."""
    some, world = read(path), _find_world(path)
    numbers = select_ply_numbers(some.columns, array)
    colors = some.colors if array is None else None
    if not len(some.ends) and not some.lines:
        balls = _make_balls(some.points, some.colors, radius)
        repeated = np.repeat(np.arange(len(some.points)), len(balls.vertices) // max(len(some.points), 1))
        colors = balls.colors if array is None else None
        return replace(assign_numbers(balls, numbers, repeated), colors=colors, **world)
    triangles, _ = some.fans()
    # without triangles at points that have no place
    there = np.isfinite(some.points).all(axis=1)
    triangles = triangles[there[some.numbers[triangles]].all(axis=1)]
    mesh = Mesh(np.where(there[:, None], some.points, 0.0), some.numbers[triangles], colors=colors)
    if numbers is not None:
        mesh = replace(mesh, values=numbers.values, quantity=numbers.name)
    mesh, kept = _merge_vertices(mesh)
    if some.corner_colors is not None and array is None:
        mesh = replace(_separate_corners(mesh), colors=some.corner_colors[triangles[kept]].reshape(-1, 3))
    tubes = _make_tubes([some.points[line] for line in some.lines], radius)
    return replace(join_meshes([mesh, tubes]), **world)


def _merge_vertices(mesh: Mesh) -> tuple[Mesh, np.ndarray]:
    """The mesh with one vertex for those of equal place, colour and value, and without triangles of two corners; bool
    [M]: triangles that are kept.
    """
    extra = [array for array in (mesh.colors, mesh.values) if array is not None]
    rows = np.column_stack([mesh.vertices, *extra])
    _, first, number = np.unique(rows, axis=0, return_index=True, return_inverse=True)
    faces = number.reshape(-1)[mesh.faces]
    kept = (faces != np.roll(faces, 1, axis=1)).all(axis=1)
    used, faces = np.unique(faces[kept], return_inverse=True)
    vertices = first[used]
    colors, values = (None if array is None else array[vertices] for array in (mesh.colors, mesh.values))
    faces = faces.reshape(-1, 3)
    return replace(mesh, vertices=mesh.vertices[vertices], faces=faces, colors=colors, values=values), kept


def _read_triangles(path: Path, radius: float | None, array: str | None) -> Mesh:
    """Reads the triangles of all parts of a file in trimesh; points without triangles become balls."""
    trimesh = import_extra("trimesh", "meshes in STL and GLB", "trimesh", "mesh")
    if array is not None:
        raise expected("array", "no value for STL and GLB", repr(array))
    with decoder_errors("a mesh"):
        scene, parts = trimesh.load_scene(path, process=False), list[Mesh]()
        for node in scene.graph.nodes_geometry:
            transform, name = scene.graph[node]
            part = scene.geometry[name].copy().apply_transform(transform)
            points, colors = np.asarray(part.vertices, np.float64), None
            if not hasattr(part, "faces"):
                parts.append(_make_balls(points, getattr(part, "colors", None), radius))
                continue
            looks = part.visual
            if looks.kind == "texture":
                # unless the material states no colour or picture
                names = ("baseColorFactor", "baseColorTexture", "image", "diffuse")
                is_seen = any(getattr(looks.material, name, None) is not None for name in names)
                looks = looks.to_color() if is_seen else None
            if looks is not None and looks.kind in ("vertex", "face"):
                # one of all vertices, or one of each
                colors = np.broadcast_to(np.asarray(looks.vertex_colors)[..., :3], points.shape)
            parts.append(_merge_vertices(Mesh(points, np.asarray(part.faces), colors=colors))[0])
    return replace(join_meshes(parts), **_find_world(path))


def _make_balls(points: np.ndarray, colors: np.ndarray | None, radius: float | None) -> Mesh:
    """Balls at points [N, 3]. colors: sRGB [N, 3 or 4] of the points, or None."""
    size = float(np.linalg.norm(np.ptp(points, axis=0))) if len(points) else 0.0
    mesh = Mesh.of_points(points, radius or size * THICK or 1.0)
    vertex_colors = None
    if colors is not None and len(colors) == len(points) > 0:
        vertex_colors = np.repeat(np.asarray(colors)[:, :3], len(mesh.vertices) // len(points), axis=0)
    return Mesh(mesh.vertices, mesh.faces, colors=vertex_colors)


def _find_world(path: Path) -> dict[str, Any]:
    """Frame and unit of a file as comments at its beginning state them, by the names of a mesh's fields."""
    with path.open("rb") as file:
        head = file.read(HEADER)
    frame, unit = (match[1].decode() if match else "" for match in (SPACE.search(head), UNIT.search(head)))
    return {"frame": frame or None, "unit": unit if metres_in(unit) else ""}


def _read_tracks(path: Path, radius: float | None, array: str | None) -> Mesh:
    if array is not None:
        raise expected("array", "no value for tracks", repr(array))
    nibabel = import_extra("nibabel", "tracks", "nibabel", "readers")
    with decoder_errors("tracks"):
        lines = [np.asarray(line, np.float64) for line in nibabel.streamlines.load(path).streamlines]
    mesh = _make_tubes(lines, radius)
    # nibabel returns RAS, millimetres
    return Mesh(mesh.vertices, mesh.faces, frame="RAS", unit="mm")


def _make_tubes(lines: list[np.ndarray], radius: float | None) -> Mesh:
    points = np.concatenate([np.zeros((0, 3)), *lines])
    size = float(np.linalg.norm(np.ptp(points, axis=0))) if len(points) else 0.0
    return Mesh.of_lines(lines, radius or size * THIN or 1.0)


def _read_vtk(path: Path, radius: float | None, array: str | None) -> Mesh:
    """Reads PolyData of VTK, in another process."""
    is_xml = path.suffix.lower() != ".vtk"
    size = check_xml(path, False, ("PolyData", "PPolyData")) if is_xml else path.stat().st_size
    if not is_xml:
        parse_legacy(path)
    mesh: Mesh = call("meshes.read_poly_data", size, path, radius, array)
    return mesh


def read_poly_data(path: Path, radius: float | None, array: str | None) -> Mesh:
    """The mesh of VTK's PolyData, read in this process: polygons and strips as triangles, lines as tubes, without lone
    vertices.
    """
    with decoder_errors("a mesh"):
        reader = open_reader(path)
        with vtk_errors():
            reader.Update()
        data = reader.GetOutputDataObject(0)
        if data is None or not data.IsA("vtkPolyData"):
            raise expected("type", "PolyData", "nothing" if data is None else data.GetClassName())
        return join_meshes(_convert_poly_data(data, radius, array) if data.GetNumberOfPoints() else [])


def _convert_poly_data(data: Any, radius: float | None, array: str | None) -> list[Mesh]:
    """Triangles and tubes of a vtkPolyData, with their numbers or colours."""
    points = finite_points(data)
    kinds = {
        name: corners(getattr(data, f"Get{name}")(), name, len(points))
        for name in ("Verts", "Lines", "Polys", "Strips")
    }
    # first cell numbers of the kinds, as VTK counts cells
    starts = dict(zip(kinds, np.cumsum([0, *(len(ends) - 1 for _, ends in kinds.values())]).tolist(), strict=False))
    numbers = select_numbers(data, array)
    numbers_of, ends = kinds["Polys"]
    fans, owners = Polygons(points, numbers_of, ends[1:]).fans()
    strips = [np.stack([cell[:-2], cell[1:-1], cell[2:]], axis=1) for cell in _split(*kinds["Strips"])]
    cells = [owners + starts["Polys"]]
    cells += [np.full(len(strip), starts["Strips"] + n) for n, strip in enumerate(strips)]
    surface = Mesh(points, np.concatenate([numbers_of[fans], *strips]))
    lines = _split(*kinds["Lines"])
    tubes = _make_tubes([points[cell] for cell in lines], radius)
    if numbers is not None and numbers.of_cells:
        # triangles of cells share no vertices
        of_cells = np.concatenate([np.zeros(0, np.int64), *cells])
        surface = assign_numbers(_separate_corners(surface), numbers, np.repeat(of_cells, 3))
        rings = [np.full(len(ring_points(points[cell])), starts["Lines"] + n) for n, cell in enumerate(lines)]
    else:
        surface = assign_numbers(surface, numbers, np.arange(len(points)))
        rings = [cell[ring_points(points[cell])] for cell in lines]
    return [surface, assign_numbers(tubes, numbers, np.repeat(np.concatenate([np.zeros(0, np.int64), *rings]), SIDES))]


def _split(numbers: np.ndarray, offsets: np.ndarray) -> list[np.ndarray]:
    """Point numbers of each cell."""
    return np.split(numbers, offsets[1:-1]) if len(offsets) > 1 else []


# readers by ending
MESHES: dict[str, Read] = {
    **dict.fromkeys((".stl", ".glb"), _read_triangles),
    ".ply": partial(_read_polygons, read_ply_polygons),
    ".obj": partial(_read_polygons, read_obj),
    ".off": partial(_read_polygons, read_off),
    **dict.fromkeys((".trk", ".tck"), _read_tracks),
    **dict.fromkeys((".vtp", ".pvtp", ".vtk"), _read_vtk),
}


# properties of PLY that are not drawn as numbers: coordinates and colours; and preferred names, in this order
COORDINATES = ("x", "y", "z", "nx", "ny", "nz", "s", "t", "u", "v", "texture_u", "texture_v", "flags")
COLORS = ("red", "green", "blue", "alpha", "r", "g", "b", "a")
PREFERRED = ("quality", "scalar", "value", "intensity")
# start of the names of VTK's internal arrays, such as vtkGhostType
VTK_PREFIX = "vtk"


@dataclass(frozen=True, eq=False)
class MeshArray:
    """An array's name, and its values float64 [N] or colors uint8 [N, 3], of points, or of cells if `of_cells`."""

    name: str
    values: np.ndarray | None = None
    colors: np.ndarray | None = None
    of_cells: bool = False


def select_numbers(data: Any, array: str | None) -> MeshArray | None:
    """Numbers that colour a vtkPolyData: the array of that name, else the active array, else the first with one
    component, of points before cells; None without any.

    Vectors give their length; three or four bytes are a colour. Raises InputError for an unknown name.
    """
    arrays: list[tuple[PointArray, bool]] = []
    apart = []
    for owner, count in (
        (data.GetPointData(), data.GetNumberOfPoints()),
        (data.GetCellData(), data.GetNumberOfCells()),
    ):
        arrays += [(item, owner is not data.GetPointData()) for item in list_arrays(owner, (1, 1, count))]
        apart += [item.GetName() for item in (owner.GetNormals(), owner.GetTCoords(), owner.GetTangents()) if item]
    if array is not None:
        chosen = next((item for item in arrays if item[0].name == array), None)
        if chosen is None:
            raise expected("array", f"one of {', '.join(item.name for item, _ in arrays) or 'none'}", repr(array))
    else:
        shown = [item for item in arrays if item[0].name not in apart and not item[0].name.startswith(VTK_PREFIX)]
        order = [item for item in shown if item[0].active] + [item for item in shown if item[0].components == 1]
        chosen = next(iter(order), None)
    if chosen is None:
        return None
    source, of_cells = chosen
    rows = source.read().reshape(-1, source.components)
    if source.dtype == np.uint8 and source.components in (3, 4):
        return MeshArray(source.name, None, rows[:, :3], of_cells)
    values = rows[:, 0] if source.components == 1 else np.linalg.norm(rows.astype(np.float64), axis=1)
    return MeshArray(source.name, values.astype(np.float64), None, of_cells)


def select_ply_numbers(known: Mapping[str, np.ndarray], array: str | None) -> MeshArray | None:
    """Numbers that colour a PLY file: the vertex property of that name, or `quality`, `scalar…`, `value`, `intensity`,
    or the first that is no coordinate, normal or colour. known: properties by name.
    """
    shown = [
        name
        for name, entry in known.items()
        if name.lower() not in (*COORDINATES, *COLORS) and entry.dtype.kind in "iuf"
    ]
    if array is not None:
        if array not in known:
            raise expected("array", f"one of {', '.join(shown) or 'none'}", repr(array))
        return MeshArray(array, known[array].reshape(-1).astype(np.float64))
    ranked = sorted(shown, key=lambda name: next((n for n, entry in enumerate(PREFERRED) if name.startswith(entry)), 9))
    return MeshArray(ranked[0], known[ranked[0]].reshape(-1).astype(np.float64)) if ranked else None


def assign_numbers(mesh: Mesh, numbers: MeshArray | None, points: np.ndarray) -> Mesh:
    """A mesh with the numbers of points. points [N]: the point number of each vertex."""
    if numbers is None:
        return mesh
    values, colors = (None if array is None else array[points] for array in (numbers.values, numbers.colors))
    return replace(mesh, values=values, colors=colors, quantity=numbers.name)


def _separate_corners(mesh: Mesh) -> Mesh:
    """The mesh with a vertex at each corner of each triangle, and the normals that the corners had."""
    return replace(
        mesh,
        vertices=mesh.vertices[mesh.faces].reshape(-1, 3),
        faces=np.arange(3 * len(mesh)).reshape(-1, 3),
        corner_normals=mesh.normals,
    )


def join_meshes(meshes: Sequence[Mesh]) -> Mesh:
    """Joins meshes; parts without value or colour are drawn in the file's default colour."""
    some = [mesh for mesh in meshes if len(mesh)]
    if len(some) < 2:
        return some[0] if some else Mesh(np.zeros((0, 3)), np.zeros((0, 3), np.int64))
    first = np.cumsum([0, *(len(mesh.vertices) for mesh in some)])
    values = colors = normals = None
    if any(mesh.values is not None for mesh in some):
        values = [np.full(len(mesh.vertices), np.nan) if mesh.values is None else mesh.values for mesh in some]
    if any(mesh.colors is not None for mesh in some):
        gray = [np.tile(DEFAULT, (len(mesh.vertices), 1)) for mesh in some]
        colors = [default if mesh.colors is None else mesh.colors for mesh, default in zip(some, gray, strict=True)]
    if any(mesh.corner_normals is not None for mesh in some):
        normals = np.concatenate([mesh.normals for mesh in some])
    return Mesh(
        np.concatenate([mesh.vertices for mesh in some]),
        np.concatenate([mesh.faces + start for mesh, start in zip(some, first[:-1], strict=True)]),
        colors=None if colors is None else np.concatenate(colors),
        values=None if values is None else np.concatenate(values),
        quantity=next((mesh.quantity for mesh in some if mesh.quantity), ""),
        corner_normals=normals,
    )
