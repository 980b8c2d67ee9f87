"""Meshes from files: PLY, STL, OBJ, OFF and GLB by trimesh; VTP; lines of TRK and TCK by nibabel."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np

from splatgl.data.errors import InputError, expected, missing_extra
from splatgl.data.mesh import COLOR, Mesh
from splatgl.data.readers.files import library, quiet
from splatgl.data.readers.vtk_xml import VtkXml, arrays_of, numbers_in, parse_vtk

# a line's radius, where none is given: a share of the diagonal of all
THIN = 1 / 400
# a ball's, as well
THICK = 1 / 200
# 3D Slicer and others say in a comment which way x and y point
SPACE = re.compile(rb"SPACE\s*[=:]\s*(LPS|RAS)")
HEADER = 1024

Read = Callable[[Path, float | None], Mesh]


def load_mesh(
    path: str | Path,
    color: str | tuple[float, float, float] | None = None,
    opacity: float = 1.0,
    radius: float | None = None,
) -> Mesh:
    """The triangles of a file, in its own coordinates. color: instead of the file's. radius: of lines, world units.

    Raises InputError for what is no mesh.
    """
    place = Path(path)
    read = MESHES.get(place.suffix.lower())
    if read is None:
        raise expected(path, f"a mesh: {', '.join(sorted(MESHES))}", place.suffix or "no ending")
    try:
        if not place.is_file():
            raise InputError("expected a file, got " + ("a folder" if place.is_dir() else "nothing of that name"))
        # all that a file says is untrusted: any failure is attributed to it
        with quiet(), library("a mesh"):
            found = read(place, radius)
        if not len(found):
            raise expected("mesh", "at least one triangle or line", "none")
    except (InputError, OSError) as error:
        raise InputError(f"{path}: {error}") from error
    colors = found.colors if color is None else None
    looks = COLOR if color is None else color
    return Mesh(found.vertices, found.faces, looks, opacity, colors, place.name, found.frame)


def _triangles(path: Path, radius: float | None) -> Mesh:
    """Triangles; of points without any, balls."""
    try:
        import trimesh
    except ImportError:
        raise missing_extra("meshes", "trimesh", "mesh") from None
    with library("a mesh"):
        found: Any = trimesh.load_mesh(path, process=True)
        # of several parts, all
        joint: Any = found.to_mesh() if hasattr(found, "to_mesh") else found
        vertices, faces = np.asarray(joint.vertices), np.asarray(joint.faces)
        if not len(faces) and isinstance(cloud := trimesh.load(path), trimesh.PointCloud):
            return _balls(np.asarray(cloud.vertices), cloud.colors, radius, _frame(path))
    return Mesh(vertices, faces, colors=_colors(joint), frame=_frame(path))


def _balls(points: np.ndarray, colors: np.ndarray | None, radius: float | None, frame: str | None) -> Mesh:
    """A ball at each of points [N, 3]. colors: sRGB [N, 3 or 4] of these, or None."""
    size = float(np.linalg.norm(np.ptp(points, axis=0))) if len(points) else 0.0
    found = Mesh.of_points(points, radius or size * THICK or 1.0)
    shown = None
    if colors is not None and len(colors) == len(points) > 0:
        shown = np.repeat(np.asarray(colors)[:, :3], len(found.vertices) // len(points), axis=0)
    return Mesh(found.vertices, found.faces, colors=shown, frame=frame)


def _colors(found: Any) -> np.ndarray | None:
    """sRGB [N, 3] of vertices, if the file has any."""
    if getattr(found.visual, "kind", None) not in ("vertex", "face"):
        return None
    with library("colours of a mesh"):
        return np.asarray(found.visual.vertex_colors)[:, :3]


def _frame(path: Path) -> str | None:
    with path.open("rb") as file:
        found = SPACE.search(file.read(HEADER))
    return found[1].decode() if found else None


def _tracks(path: Path, radius: float | None) -> Mesh:
    try:
        import nibabel
    except ImportError:
        raise missing_extra("tracks", "nibabel", "readers") from None
    with library("tracks"):
        lines = [np.asarray(line, np.float64) for line in nibabel.streamlines.load(path).streamlines]
    mesh = _tubes(lines, radius)
    # nibabel gives them in RAS, millimetres
    return Mesh(mesh.vertices, mesh.faces, frame="RAS")


def _tubes(lines: list[np.ndarray], radius: float | None) -> Mesh:
    points = np.concatenate([np.zeros((0, 3)), *lines])
    size = float(np.linalg.norm(np.ptp(points, axis=0))) if len(points) else 0.0
    return Mesh.of_lines(lines, radius or size * THIN or 1.0)


def _vtp(path: Path, radius: float | None) -> Mesh:
    """All pieces of PolyData: polygons and strips as triangles, lines as tubes; vertices alone are left out."""
    file = parse_vtk(path, ("PolyData",))
    vertices, faces = [np.zeros((0, 3))], [np.zeros((0, 3), np.int64)]
    first = 0
    for piece in file.root.iter("Piece"):
        points = _points(file, piece)
        triangles = _fans(*_cells(file, piece, "Polys", len(points)))
        triangles += [_strip(cell) for cell in np.split(*_cells(file, piece, "Strips", len(points)))]
        lines = [points[cell] for cell in np.split(*_cells(file, piece, "Lines", len(points)))]
        tubes = _tubes(lines, radius)
        vertices += [points, tubes.vertices]
        faces += [each + first for each in triangles] + [tubes.faces + first + len(points)]
        first += len(points) + len(tubes.vertices)
    return Mesh(np.concatenate(vertices), np.concatenate(faces))


def _points(file: VtkXml, piece: Element) -> np.ndarray:
    """float64 [N, 3]."""
    count, owner = _count(piece, "NumberOfPoints"), piece.find("Points")
    found = [] if owner is None or not count else arrays_of(file, owner, (1, 1, count))
    if count and not (found and found[0].components == 3):
        raise expected("Points", "an array of three numbers a point", "none")
    return found[0].read().reshape(-1, 3).astype(np.float64) if found else np.zeros((0, 3))


def _cells(file: VtkXml, piece: Element, name: str, points: int) -> tuple[np.ndarray, np.ndarray]:
    """The numbers of the points of all cells, int64, and the ends of all cells."""
    count, owner = _count(piece, f"NumberOf{name}"), piece.find(name)
    nothing = np.zeros(0, np.int64)
    if not count or owner is None:
        return nothing, nothing
    nodes = {node.get("Name"): node for node in owner.findall("DataArray")}
    if not nodes.keys() >= {"offsets", "connectivity"}:
        raise expected(name, "the arrays offsets and connectivity", ", ".join(map(str, nodes)) or "none")
    (ends,) = (array for array in arrays_of(file, owner, (1, 1, count)) if array.name == "offsets")
    offsets = ends.read().ravel().astype(np.int64)
    if (np.diff(offsets, prepend=0) < 0).any() or offsets[-1] > 2**40:
        raise expected(name, "offsets that do not fall", "others")
    if not offsets[-1]:
        return nothing, nothing
    (each,) = (array for array in arrays_of(file, owner, (1, 1, int(offsets[-1]))) if array.name == "connectivity")
    numbers = each.read().ravel().astype(np.int64)
    if not (numbers.min() >= 0 and numbers.max() < points):
        raise expected(name, f"numbers of {points} points", f"{numbers.min()} to {numbers.max()}")
    return numbers, offsets


def _count(piece: Element, name: str) -> int:
    count = int(numbers_in(piece, name, "0", 1)[0])
    if count < 0:
        raise expected(name, "zero or more", count)
    return count


def _fans(numbers: np.ndarray, ends: np.ndarray) -> list[np.ndarray]:
    """Triangles [N, 3] of polygons, those of as many corners together."""
    sizes, found = np.diff(ends, prepend=0), []
    for size in np.unique(sizes[sizes > 2]).tolist():
        cells = numbers[(ends - sizes)[sizes == size][:, None] + np.arange(size)]
        first = np.broadcast_to(cells[:, :1], (len(cells), size - 2))
        found.append(np.stack([first, cells[:, 1:-1], cells[:, 2:]], axis=2).reshape(-1, 3))
    return found


def _strip(cell: np.ndarray) -> np.ndarray:
    """Triangles [n − 2, 3] of a strip."""
    return np.stack([cell[:-2], cell[1:-1], cell[2:]], axis=1)


MESHES: dict[str, Read] = {
    **dict.fromkeys((".ply", ".stl", ".obj", ".off", ".glb"), _triangles),
    **dict.fromkeys((".trk", ".tck"), _tracks),
    ".vtp": _vtp,
}
"""Endings and their readers."""
