"""Converts napari's points, shapes, surfaces, tracks and vectors to meshes at the viewer's sliders."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from splatgl.data.mesh import SIDES, Mesh
from splatgl.readers.meshes import join_meshes

# most balls of a layer, and most different radii of them
MOST_POINTS, MOST_SIZES = 20_000, 32
# corners of an ellipse
CORNERS = 48
LIT = "lit in linear light, brighter than napari's shading"
# distance from a slider within which matter is shown, samples
NEAR = 0.5


def meshes_of(layer: Any, point: np.ndarray, camera: Any) -> tuple[tuple[Mesh, ...], tuple[str, ...]]:
    """Meshes of a layer in the world (x, y, z), and notes on what is left out. point [n]: world place of the sliders.
    camera: whose zoom gives the world's size of pixels.
    """
    kinds = {"Points": _points, "Shapes": _shapes, "Surface": _surface, "Tracks": _tracks, "Vectors": _vectors}
    place = _Place(layer, point, float(camera.zoom))
    meshes, notes = kinds[type(layer).__name__](layer, place)
    opacity = float(layer.opacity)
    return tuple(replace(mesh, opacity=mesh.opacity * opacity) for mesh in meshes if len(mesh)), tuple(notes)


def world_matrix(layer: Any) -> np.ndarray:
    """World from indices [n + 1, n + 1] of a layer's data."""
    start = np.asarray(layer.data_to_world(np.zeros(layer.ndim)), float)
    matrix = np.eye(layer.ndim + 1)
    matrix[:-1, -1] = start
    for axis, unit in enumerate(np.eye(layer.ndim)):
        matrix[:-1, axis] = np.asarray(layer.data_to_world(unit), float) - start
    return matrix


class _Place:
    """World places of a layer's coordinates, and whether these are at the sliders."""

    def __init__(self, layer: Any, point: np.ndarray, zoom: float) -> None:
        self.matrix, self.count, self.zoom = world_matrix(layer), int(layer.ndim), zoom
        self.at = np.asarray(layer.world_to_data(point[-self.count :]), float)

    @property
    def scale(self) -> float:
        """World length of a unit of the data: the mean over the displayed axes."""
        return float(np.linalg.norm(self.matrix[:-1, -1 - min(self.count, 3) : -1], axis=0).mean())

    def world(self, data: np.ndarray) -> np.ndarray:
        """World (x, y, z) of coordinates [N, n]."""
        places = (data @ self.matrix[:-1, :-1].T + self.matrix[:-1, -1])[:, -3:]
        if places.shape[1] < 3:
            places = np.column_stack([np.zeros((len(places), 3 - places.shape[1])), places])
        return np.asarray(places[:, ::-1])

    def is_near(self, data: np.ndarray) -> np.ndarray:
        """Whether coordinates [N, n] are at the sliders of the axes before the last three."""
        lead = max(self.count - 3, 0)
        return np.asarray((np.abs(data[:, :lead] - self.at[:lead]) <= NEAR).all(axis=1))


Found = tuple[list[Mesh], list[str]]


def _points(layer: Any, place: _Place) -> Found:
    data = np.asarray(layer.data, float).reshape(-1, place.count)
    sizes = np.broadcast_to(np.asarray(layer.size, float).reshape(len(data), -1).mean(axis=1), len(data))
    faces, edges = (np.asarray(getattr(layer, name), float) for name in ("face_color", "border_color"))
    colors = np.where(faces[:, 3:] > 0, faces, edges)
    shown = place.is_near(data) & np.asarray(layer.shown, bool) & (sizes > 0) & (colors[:, 3] > 0)
    numbers, notes = np.flatnonzero(shown), list[str]()
    if len(numbers) > MOST_POINTS:
        notes.append(f"{MOST_POINTS:,} of {len(numbers):,} points are drawn")
        numbers = numbers[np.linspace(0, len(numbers) - 1, MOST_POINTS).astype(int)]
    if not len(numbers):
        return [], notes
    # the border lies half outside of the point
    widths = np.broadcast_to(np.asarray(layer.border_width, float), len(data))
    widths = widths * np.where(edges[:, 3] > 0, sizes if layer.border_width_is_relative else 1.0, 0.0)
    radii = (sizes + widths)[numbers] / 2 * place.scale
    if (widths[numbers] > 0).any() and (faces[numbers] != edges[numbers]).any():
        notes.append("its points have the colour of their faces, without a ring in that of their borders")
    known = np.unique(radii)
    if len(known) > MOST_SIZES:
        known = np.quantile(radii, np.linspace(0, 1, MOST_SIZES))
        notes.append(f"points are drawn in {MOST_SIZES} sizes")
    nearest = np.abs(radii[:, None] - known).argmin(axis=1)
    meshes = []
    for number in np.unique(nearest):
        chosen = numbers[nearest == number]
        ball = Mesh.of_points(place.world(data[chosen]), float(known[number]))
        meshes.append(_shade(_paint(ball, colors[chosen], len(ball.vertices) // len(chosen)), layer, notes))
    return meshes, notes


def _shapes(layer: Any, place: _Place) -> Found:
    meshes = list[Mesh]()
    looks = zip(layer.data, layer.shape_type, layer.edge_width, layer.edge_color, layer.face_color, strict=True)
    for data, kind, width, edge, face in looks:
        corners = np.asarray(data, float).reshape(-1, place.count)
        if not place.is_near(corners).all():
            continue
        if kind == "ellipse":
            corners = _ellipse(corners)
        path, is_open = place.world(corners), kind in ("line", "path")
        if face[3] > 0 and not is_open:
            meshes.append(_fan(path, np.asarray(face, float)))
        if edge[3] > 0 and width > 0:
            closed = path if is_open else np.vstack([path, path[:1]])
            tube = Mesh.of_lines([closed], float(width) / 2 * place.scale)
            meshes.append(_paint(tube, np.array([edge], float), len(tube.vertices)))
    return meshes, ["faces that are not convex are drawn as fans around their middle"] * any(
        kind == "polygon" for kind in layer.shape_type
    )


def _ellipse(corners: np.ndarray) -> np.ndarray:
    """Points of the ellipse in a box [4, n]."""
    middle, across, down = corners.mean(axis=0), (corners[1] - corners[0]) / 2, (corners[3] - corners[0]) / 2
    angle = np.linspace(0, 2 * np.pi, CORNERS, endpoint=False)[:, None]
    return np.asarray(middle + np.cos(angle) * across + np.sin(angle) * down)


def _fan(path: np.ndarray, color: np.ndarray) -> Mesh:
    count = np.arange(len(path))
    faces = np.column_stack([np.full(len(path), len(path)), count, (count + 1) % len(path)])
    mesh = Mesh(np.vstack([path, path.mean(axis=0)]), faces)
    return _paint(mesh, color[None], len(path) + 1)


def _surface(layer: Any, place: _Place) -> Found:
    vertices, faces = np.asarray(layer.data[0], float), np.asarray(layer.data[1], np.int64)
    near = place.is_near(vertices)
    faces = faces[near[faces].all(axis=1)]
    colors = layer.vertex_colors
    if colors is None:
        low, high = (float(limit) for limit in layer.contrast_limits)
        values = np.asarray(layer.vertex_values, float)
        values = values.reshape(-1, values.shape[-1])[0] if values.ndim > 1 else values
        shares = np.clip((values - low) / ((high - low) or 1.0), 0, 1) ** float(layer.gamma)
        colors = np.asarray(layer.colormap.map(shares), float)
    notes = ["its texture is not drawn"] if getattr(layer, "texture", None) is not None else []
    mesh = _paint(Mesh(place.world(vertices), faces), np.asarray(colors, float), 1)
    return [_shade(mesh, layer, notes)], notes


def _shade(mesh: Mesh, layer: Any, notes: list[str]) -> Mesh:
    """The mesh with the shading of its layer, and a note where that is none of napari's."""
    if str(layer.shading) == "none":
        return mesh.unlit()
    if LIT not in notes:
        notes.append(LIT)
    return mesh


def _tracks(layer: Any, place: _Place) -> Found:
    data, colors = np.asarray(layer.data, float), np.asarray(layer.track_colors, float)
    age = place.at[0] - data[:, 1] if place.count > 1 else np.zeros(len(data))
    near = (age <= float(layer.tail_length)) & (age >= -float(layer.head_length))
    lines, painted = list[np.ndarray](), list[np.ndarray]()
    for number in np.unique(data[near, 0]):
        chosen = near & (data[:, 0] == number)
        if chosen.sum() > 1:
            lines.append(place.world(data[chosen, 1:]))
            painted.append(colors[chosen])
    notes = ["its tails do not fade with age"] * bool(lines)
    return _tubes(lines, painted, float(layer.tail_width) / 2 / place.zoom), notes


def _vectors(layer: Any, place: _Place) -> Found:
    data = np.asarray(layer.data, float)
    chosen = np.flatnonzero(place.is_near(data[:, 0]))
    ends = data[chosen, 0] + data[chosen, 1] * float(layer.length)
    lines = [np.vstack(pair) for pair in zip(place.world(data[chosen, 0]), place.world(ends), strict=True)]
    colors = np.asarray(layer.edge_color, float)[chosen]
    radius = float(layer.edge_width) / 2 * place.scale
    # napari's style of a line is as wide at both ends
    notes = [f"its vectors are lines, not of style {layer.vector_style}"] * (str(layer.vector_style) != "line")
    return _tubes(lines, [np.repeat(color[None], 2, axis=0) for color in colors], radius), notes * bool(lines)


def _tubes(lines: Sequence[np.ndarray], colors: Sequence[np.ndarray], radius: float) -> list[Mesh]:
    """Tubes [N, 3] whose points have colours [N, 4]."""
    if not lines:
        return []
    tubes = [Mesh.of_lines([line], radius) for line in lines]
    painted = [_paint(t, c, SIDES) for t, c in zip(tubes, colors, strict=True) if len(t.vertices) == SIDES * len(c)]
    return [replace(join_meshes(painted), opacity=painted[0].opacity)] if painted else []


def _paint(mesh: Mesh, colors: np.ndarray, times: int) -> Mesh:
    """The mesh in sRGB and alpha [N, 4], each of that many vertices; its opacity is their mean alpha."""
    painted = np.repeat(np.rint(255 * np.clip(colors[:, :3], 0, 1)).astype(np.uint8), times, axis=0)
    alpha = float(colors[:, 3].mean()) if colors.shape[1] > 3 and len(colors) else 1.0
    return replace(mesh, colors=painted, opacity=alpha)
