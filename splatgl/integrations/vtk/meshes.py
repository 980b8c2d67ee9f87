"""Converts VTK actors to meshes: triangles, lines as tubes and points as balls, with colours."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np

from splatgl.data.mesh import SIDES, Mesh
from splatgl.errors import expected
from splatgl.geometry.camera import Camera
from splatgl.integrations.vtk.properties import clip_planes, matrix_of, vtk_plane
from splatgl.readers.vtk_files import leaves

# name of the colour array, which VTK's filters pass on with the geometry
COLORS = "splatgl colors"
# VTK's numbers of representations
POINTS, WIREFRAME = 0, 1


@dataclass(frozen=True, eq=False)
class ActorGeometry:
    """Points float64 [N, 3], world; cells as arrays of point indices. colors uint8 [N, 4], None, or, if of_cells,
    one per cell: balls, then lines, then triangles. places float64 [N, 2]: texture coordinates, or None.
    """

    points: np.ndarray
    balls: list[np.ndarray]
    lines: list[np.ndarray]
    faces: np.ndarray
    colors: np.ndarray | None
    of_cells: bool
    places: np.ndarray | None = None

    def colors_of(self, cells: list[np.ndarray], first: int) -> np.ndarray | None:
        """Colours of the points of consecutive cells. first: index of the first cell."""
        if self.colors is None or not cells:
            return None
        if self.of_cells:
            return np.repeat(self.colors[first : first + len(cells)], [len(cell) for cell in cells], axis=0)
        return np.asarray(self.colors[np.concatenate(cells)])


def meshes_of(actor: Any, camera: Camera) -> Iterator[Mesh]:
    """Meshes of a vtkActor: surfaces, and lines and points of their pixel width at their middle; unlit as it is.

    Raises InputError for surfaces whose points differ in opacity.
    """
    meshes = _meshes(actor, camera)
    yield from meshes if actor.GetProperty().GetLighting() else (mesh.unlit() for mesh in meshes)


def _meshes(actor: Any, camera: Camera) -> Iterator[Mesh]:
    from vtkmodules.vtkFiltersCore import vtkExtractEdges
    from vtkmodules.vtkFiltersGeometry import vtkGeometryFilter

    mapper, prop = actor.GetMapper(), actor.GetProperty()
    if mapper is None or not hasattr(mapper, "GetLookupTable") or mapper.GetInputAlgorithm() is None:
        return
    mapper.GetInputAlgorithm().Update()
    style, matrix = prop.GetRepresentation(), matrix_of(actor)
    for _, data in leaves(mapper.GetInputDataObject(0, 0)):
        data = _map_scalars(data, mapper)
        surface = data if data.IsA("vtkPolyData") else _apply(vtkGeometryFilter(), data)
        surface = _clip(surface, mapper, matrix)
        shape = _shape(surface, matrix)
        wire = style == WIREFRAME or prop.GetEdgeVisibility()
        if wire and len(shape.faces):
            edges = _shape(_apply(vtkExtractEdges(), surface), matrix)
            color = prop.GetColor() if style == WIREFRAME else prop.GetEdgeColor()
            colors = edges.colors if style == WIREFRAME else None
            edges = replace(edges, balls=[], faces=edges.faces[:0], colors=colors)
            yield from _shape_meshes(edges, prop, color, camera)
        if style == POINTS:
            corners = [np.array([number]) for number in range(len(shape.points))]
            colors = None if shape.of_cells else shape.colors
            shape = ActorGeometry(shape.points, corners, [], shape.faces[:0], colors, False)
        elif style == WIREFRAME:
            shape = replace(shape, faces=shape.faces[:0])
        picture = _picture(actor)
        if picture is not None and shape.places is not None and len(shape.faces):
            yield paint_texture(shape, picture, actor)
            shape = replace(shape, faces=shape.faces[:0])
        yield from _shape_meshes(shape, prop, prop.GetColor(), camera)


def texture_differences(actor: Any) -> Iterator[str]:
    """Names of unsupported features of an actor's texture."""
    texture, picture = actor.GetTexture(), _picture(actor)
    if texture is not None and picture is None:
        yield "a texture, whose samples are not of 8 bits"
    elif picture is not None and picture.shape[2] in (2, 4) and picture[..., -1].min() < OPAQUE:
        yield "the opacities of a texture"


# opacity of 8 bits
OPAQUE = 255
# most triangles of a mesh that is cut for its texture
MOST_PARTS = 2**19


def _picture(actor: Any) -> np.ndarray | None:
    """Texture of an actor, uint8 [H, W, channels], row 0 at the bottom; None without, and for other samples."""
    from vtkmodules.util.numpy_support import vtk_to_numpy

    texture = actor.GetTexture()
    if texture is None or texture.GetCubeMap():
        return None
    texture.Update()
    data = texture.GetInput()
    scalars = None if data is None else data.GetPointData().GetScalars()
    if scalars is None:
        return None
    width, height, _ = data.GetDimensions()
    samples = vtk_to_numpy(scalars).reshape(height, width, -1)
    return samples if samples.dtype == np.uint8 else None


def paint_texture(shape: ActorGeometry, picture: np.ndarray, actor: Any) -> Mesh:
    """Triangles of a shape, cut until each spans about a texel, in the colours of a texture times the actor's."""
    prop, faces = actor.GetProperty(), shape.faces
    assert shape.places is not None
    plain = Mesh(shape.points, faces)
    places = shape.places[faces]
    texels = (places - np.roll(places, 1, axis=1)) * (picture.shape[1], picture.shape[0])
    longest = np.hypot(texels[..., 0], texels[..., 1]).max(axis=1)
    cuts = 2 ** np.ceil(np.log2(np.maximum(longest, 1.0))).astype(int)
    while cuts.max() > 1 and int((cuts.astype(np.int64) ** 2).sum()) > MOST_PARTS:
        cuts = np.maximum(cuts // 2, 1)
    parts: list[tuple[np.ndarray, ...]] = []
    corners = np.concatenate([shape.points[faces], plain.normals, places], axis=2)
    for count in np.unique(cuts):
        weights, numbers = _cut(int(count))
        rows = np.einsum("pc,tcx->tpx", weights, corners[cuts == count])
        first = np.arange(len(rows))[:, None, None] * len(weights)
        parts.append((rows.reshape(-1, rows.shape[2]), (numbers + first).reshape(-1, 3)))
    start = np.cumsum([0, *(len(rows) for rows, _ in parts)])
    vertices = np.concatenate([rows for rows, _ in parts])
    triangles = np.concatenate([numbers + n for n, (_, numbers) in zip(start, parts, strict=False)])
    colors = _texels(picture, vertices[:, 6:], actor.GetTexture()) * np.clip(prop.GetColor(), 0.0, 1.0)
    normals = vertices[:, 3:6][triangles]
    normals /= np.maximum(np.linalg.norm(normals, axis=2, keepdims=True), 1e-30)
    opacity = float(np.clip(prop.GetOpacity(), 0.0, 1.0))
    painted = np.rint(colors).astype(np.uint8)
    return Mesh(vertices[:, :3], triangles, opacity=opacity, colors=painted, corner_normals=normals)


def _cut(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Shares [P, 3] of a triangle's corners at the points of its count² equal parts, and their numbers [count², 3]."""
    points = [(i, j) for i in range(count + 1) for j in range(count + 1 - i)]
    number = {point: n for n, point in enumerate(points)}
    up = [((i, j), (i + 1, j), (i, j + 1)) for i in range(count) for j in range(count - i)]
    down = [((i + 1, j), (i + 1, j + 1), (i, j + 1)) for i in range(count) for j in range(count - i - 1)]
    shares = np.array(points, float) / count
    weights = np.column_stack([1 - shares.sum(axis=1), shares])
    return weights, np.array([[number[point] for point in part] for part in [*up, *down]], np.int64)


def _texels(picture: np.ndarray, places: np.ndarray, texture: Any) -> np.ndarray:
    """sRGB [N, 3] from 0 to 255 at texture coordinates [N, 2], repeated or clamped, of the nearest texel or linear."""
    rgb = picture[..., :3] if picture.shape[2] > 2 else np.repeat(picture[..., :1], 3, axis=2)
    columns, rows = (places * (picture.shape[1], picture.shape[0]) - 0.5).T
    return _sample_plane(rgb, rows, columns, bool(texture.GetInterpolate()), bool(texture.GetRepeat()))


def _shape_meshes(shape: ActorGeometry, prop: Any, color: Any, camera: Camera) -> Iterator[Mesh]:
    """Balls, tubes and triangles of a shape."""
    code = "#{:02x}{:02x}{:02x}".format(*np.rint(255 * np.clip(color, 0, 1)).astype(int).tolist())
    full = float(np.clip(prop.GetOpacity(), 0.0, 1.0))
    if shape.balls:
        colors, opacity = _opacity(shape.colors_of(shape.balls, 0), full)
        places = shape.points[np.concatenate(shape.balls)]
        ball = Mesh.of_points(places, _radius(places, prop.GetPointSize(), camera), color=code, opacity=opacity)
        yield _recolor(ball, colors, len(ball.vertices) // len(places))
    if shape.lines:
        colors, opacity = _opacity(shape.colors_of(shape.lines, len(shape.balls)), full)
        lines = [shape.points[line] for line in shape.lines]
        radius = _radius(np.concatenate(lines), prop.GetLineWidth(), camera)
        yield _recolor(Mesh.of_lines(lines, radius, color=code, opacity=opacity), colors, SIDES)
    if len(shape.faces):
        corners, first = list(shape.faces), len(shape.balls) + len(shape.lines)
        if shape.of_cells and shape.colors is not None:
            # triangles share no vertices, each of which has one colour
            colors, opacity = _opacity(shape.colors_of(corners, first), full)
            numbers = np.arange(3 * len(shape.faces)).reshape(-1, 3)
            yield Mesh(shape.points[shape.faces.ravel()], numbers, code, opacity, colors)
        else:
            colors, opacity = _opacity(shape.colors, full)
            yield Mesh(shape.points, shape.faces, code, opacity, colors)


def _recolor(mesh: Mesh, colors: np.ndarray | None, times: int) -> Mesh:
    """The mesh with colours, each for that many vertices."""
    if colors is None:
        return mesh
    return Mesh(mesh.vertices, mesh.faces, mesh.color, mesh.opacity, np.repeat(colors, times, axis=0))


def _opacity(colors: np.ndarray | None, full: float) -> tuple[np.ndarray | None, float]:
    """Colours [N, 3], and their common opacity times `full`. Raises InputError for several opacities."""
    if colors is None or not len(colors):
        return None, full
    alpha = colors[:, 3]
    if alpha.min() != alpha.max():
        raise expected("mesh", "one opacity", f"some from {alpha.min() / 255:.2g} to {alpha.max() / 255:.2g}")
    return colors[:, :3], full * float(alpha[0]) / 255


def _radius(places: np.ndarray, pixels: float, camera: Camera) -> float:
    """World length of half as many pixels at the middle of points."""
    depth = float(camera.eye_from_points(places.mean(axis=0))[2])
    return pixels / 2 * float(camera.pixel_pitch(abs(depth) or 1.0))


def _map_scalars(data: Any, mapper: Any) -> Any:
    """The data with the mapped colours of its scalars, if the mapper shows them."""
    from vtkmodules.vtkCommonCore import reference
    from vtkmodules.vtkRenderingCore import vtkAbstractMapper

    cells: Any = reference(0)
    copy = data.NewInstance()
    copy.ShallowCopy(data)
    if not mapper.GetScalarVisibility():
        return copy
    selection = mapper.GetScalarMode(), mapper.GetArrayAccessMode(), mapper.GetArrayId(), mapper.GetArrayName()
    scalars = vtkAbstractMapper.GetScalars(data, *selection, cells)
    if scalars is None or int(cells) not in (0, 1):
        return copy
    table = scalars.GetLookupTable() or mapper.GetLookupTable()
    if not mapper.GetUseLookupTableScalarRange():
        table.SetRange(mapper.GetScalarRange())
    table.Build()
    colors = table.MapScalars(scalars, mapper.GetColorMode(), mapper.GetArrayComponent())
    colors.SetName(COLORS)
    (copy.GetCellData() if int(cells) else copy.GetPointData()).AddArray(colors)
    return copy


def _clip(data: Any, mapper: Any, matrix: np.ndarray) -> Any:
    """The data clipped by the mapper's planes. matrix: world-from-data."""
    from vtkmodules.vtkFiltersCore import vtkClipPolyData

    for plane in clip_planes(mapper):
        x, y, z, w = (np.array([*plane[:3], -plane[3]]) @ matrix).tolist()
        clip = vtkClipPolyData()
        clip.SetClipFunction(vtk_plane((x, y, z, -w)))
        data = _apply(clip, data)
    return data


def _apply(filter: Any, data: Any) -> Any:
    filter.SetInputData(data)
    filter.Update()
    return filter.GetOutput()


def _shape(data: Any, matrix: np.ndarray) -> ActorGeometry:
    """Polygonal data as arrays, polygons as triangles."""
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkFiltersCore import vtkTriangleFilter

    step = vtkTriangleFilter()
    step.PassLinesOn()
    step.PassVertsOn()
    data = _apply(step, data)
    vtk_points = data.GetPoints()
    points = np.zeros((0, 3)) if vtk_points is None else vtk_to_numpy(vtk_points.GetData()).astype(np.float64)
    on_cells = data.GetCellData().GetArray(COLORS)
    colors, places = on_cells or data.GetPointData().GetArray(COLORS), data.GetPointData().GetTCoords()
    return ActorGeometry(
        points @ matrix[:3, :3].T + matrix[:3, 3],
        _cells(data.GetVerts()),
        _cells(data.GetLines()),
        np.array(_cells(data.GetPolys()), np.int64).reshape(-1, 3),
        None if colors is None else vtk_to_numpy(colors).copy(),
        on_cells is not None,
        None if places is None else vtk_to_numpy(places)[:, :2].astype(np.float64),
    )


def _cells(cells: Any) -> list[np.ndarray]:
    """Point indices of each cell of a vtkCellArray."""
    from vtkmodules.util.numpy_support import vtk_to_numpy

    numbers, ends = vtk_to_numpy(cells.GetConnectivityArray()), vtk_to_numpy(cells.GetOffsetsArray())
    return np.split(numbers, ends[1:-1]) if len(ends) > 1 else []


def _sample_plane(
    samples: np.ndarray, rows: np.ndarray, columns: np.ndarray, is_linear: bool, repeats: bool
) -> np.ndarray:
    """Samples [N, M, …] at fractional indices [P, …] along the first two axes, linear in between or the nearest; beyond
    the ends the last ones, or the samples again if they repeat.
    """

    def take(rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
        sized = zip((rows, columns), samples.shape, strict=False)
        row, column = ((at % size if repeats else np.clip(at, 0, size - 1)).astype(np.intp) for at, size in sized)
        return np.asarray(samples[row, column])

    if not is_linear:
        return take(np.floor(rows + 0.5), np.floor(columns + 0.5))
    total = np.zeros((*rows.shape, *samples.shape[2:]))
    for down, right in product((0, 1), repeat=2):
        weight = np.abs(1 - down - rows % 1) * np.abs(1 - right - columns % 1)
        part = take(np.floor(rows) + down, np.floor(columns) + right)
        total += part * weight.reshape(weight.shape + (1,) * (samples.ndim - 2))
    return total
