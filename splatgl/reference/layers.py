"""Layers and meshes in float64.

Along a ray each layer is a sequence of pieces of constant matter. Between any two ends of pieces, the extinctions and
emissions of all layers add up.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from splatgl.data.mesh import Mesh
from splatgl.reference.label_boxes import BoxScene
from splatgl.reference.sheets import Pieces, SheetScene, add_behind
from splatgl.splat.camera import Camera
from splatgl.splat.colormaps import colors_at
from splatgl.splat.culling import Window
from splatgl.splat.lighting import Light, surface_light


@dataclass(frozen=True, eq=False)
class LayerScene:
    """Data shared by all windows of a picture of layers, drawn in sheets or boxes."""

    layers: Sequence[SheetScene | BoxScene]

    def band_height(self) -> int:
        """Rows of pixels drawn together."""
        return max(min(layer.band_height() for layer in self.layers) // (2 * len(self.layers)), 1)

    def part(self, window: Window) -> np.ndarray:
        """A window of the picture, float64 [h, w, 4]."""
        light = merge_pieces([layer.pieces(window) for layer in self.layers])
        return light.reshape(window.height, window.width, 4)

    def between(self, window: Window, near: np.ndarray, far: np.ndarray) -> np.ndarray:
        """Light [P, 4] of a window's pixels between distances [P], world units."""
        return merge_pieces([layer.pieces(window, near, far) for layer in self.layers])


def merge_pieces(layers: Sequence[Pieces]) -> np.ndarray:
    """Light [P, 4] of layers' pieces along P rays."""
    ends = np.concatenate([layer.ends.reshape(len(layer.ends), -1) for layer in layers], axis=1)
    order = np.argsort(ends, axis=1, kind="stable")
    edges = np.take_along_axis(ends, order, axis=1).T
    # of an end the layer whose piece ends there, −1 where one begins
    ending = np.concatenate([np.tile([-1, n], layer.ends.shape[1]) for n, layer in enumerate(layers)])[order].T
    light = np.zeros((len(ends), 4))
    at = [np.zeros(len(ends), np.intp) for _ in layers]
    for first, last, ended in zip(edges[:-1], edges[1:], ending[:-1], strict=True):
        middle, matter = (first + last) / 2, np.zeros_like(light)
        for n, layer in enumerate(layers):
            at[n] += ended == n
            some = np.flatnonzero((last > first) & (at[n] < layer.ends.shape[1]))
            begin, end = layer.ends[some, at[n][some]].T
            inside = (begin < middle[some]) & (middle[some] < end)
            some, length = some[inside], (end - begin)[inside]
            matter[some] += layer.matter[some, at[n][some]] * ((last - first)[some] / length)[:, None]
        light = add_behind(light, matter)
    return light


# difference of barycentric coordinates, and relative difference of depths, that is only rounding
ON_EDGE = 1e-9


@dataclass(frozen=True, eq=False)
class Crossings:
    """Surfaces along rays, nearest first. distance [P, K]: from the eye, or from its plane, world units; infinite after
    the last. light [P, K, 4]: premultiplied.
    """

    distance: np.ndarray
    light: np.ndarray


@dataclass(frozen=True, eq=False)
class SurfaceScene:
    """Data shared by all windows of a picture of volumes with meshes. camera: of the samples; light: None: unlit."""

    scene: SheetScene | BoxScene | LayerScene
    meshes: Sequence[Mesh]
    camera: Camera
    light: Light | None

    def band_height(self) -> int:
        """Rows of pixels drawn together."""
        return self.scene.band_height()

    def part(self, window: Window) -> np.ndarray:
        """A window of the picture, float64 [h, w, 4]."""
        surfaces = crossings(self.meshes, self.camera, window, self.light)
        light, near = np.zeros((window.height * window.width, 4)), np.zeros(window.height * window.width)
        for far, surface in zip(surfaces.distance.T, surfaces.light.transpose(1, 0, 2), strict=True):
            for part in (self.scene.between(window, near, far), surface):
                light += (1 - light[:, 3:]) * part
            near = far
        return light.reshape(window.height, window.width, 4)


def crossings(meshes: Sequence[Mesh], camera: Camera, window: Window, light_by: Light | None) -> Crossings:
    """Surfaces along the rays of a window's pixels, followed by an empty one at infinity."""
    across, down = camera.slopes()
    across, down = across[window.x : window.x + window.width], down[window.y : window.y + window.height]
    lateral = np.stack([slopes.ravel() for slopes in np.meshgrid(across, down)], axis=1)
    shown = [mesh for mesh in meshes if len(mesh) and mesh.opacity > 0]
    parts = [_cross_mesh(mesh, camera, lateral, (across, down), light_by) for mesh in shown]
    pixel = np.concatenate([np.arange(len(lateral)), *(part[0] for part in parts)])
    distance = np.concatenate([np.full(len(lateral), np.inf), *(part[1] for part in parts)])
    light = np.concatenate([np.zeros((len(lateral), 4)), *(part[2] for part in parts)])
    order = np.lexsort((distance, pixel))
    pixel, distance, light = pixel[order], distance[order], light[order]
    first = np.searchsorted(pixel, np.arange(len(lateral)))
    place = np.arange(len(pixel)) - first[pixel]
    result = Crossings(np.full((len(lateral), place.max() + 1), np.inf), np.zeros((len(lateral), place.max() + 1, 4)))
    result.distance[pixel, place], result.light[pixel, place] = distance, light
    return result


def _cross_mesh(
    mesh: Mesh, camera: Camera, lateral: np.ndarray, axes: tuple[np.ndarray, np.ndarray], light_by: Light | None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Pixels [N], distances [N] and light [N, 4] where rays through slopes, or lengths, [P, 2] cross a mesh."""
    corners = camera.eye_from_points(mesh.vertices)[mesh.faces]
    ahead = (corners[..., 2] > 0).any(axis=1) if camera.perspective else (corners[..., 2] >= 0).any(axis=1)
    faces = np.flatnonzero(ahead)
    pixel, triangle = _candidates(corners[faces], camera, *axes)
    triangle = faces[triangle]
    a, b, c = (corners[triangle, n] for n in range(3))
    ray = np.column_stack([lateral[pixel], np.ones(len(pixel))])
    start = np.zeros_like(ray)
    if not camera.perspective:
        start[:, :2], ray[:, :2] = ray[:, :2], 0.0
    # Möller and Trumbore 1997
    side, other, from_a = b - a, c - a, start - a
    across, along = np.cross(ray, other), np.cross(from_a, side)
    determinant = (side * across).sum(axis=1)
    safe = np.where(determinant == 0, 1.0, determinant)
    u, v, depth = (np.asarray((x * y).sum(axis=1) / safe) for x, y in ((from_a, across), (ray, along), (other, along)))
    hit = _unique_hits(
        np.min([u, v, 1 - u - v], axis=0), pixel, np.where((determinant != 0) & (depth > 0), depth, np.nan)
    )
    pixel, triangle, ray, depth = pixel[hit], triangle[hit], ray[hit], depth[hit]
    share = np.stack([1 - u - v, u, v], axis=1)[hit][..., None]
    length = np.linalg.norm(ray, axis=1)
    if mesh.texture is not None:
        paint = mesh.texture.light((mesh.vertices[mesh.faces[triangle]] * share).sum(axis=1))
        there = paint[:, 3] > 0
        return pixel[there], (depth * length)[there], paint[there] * mesh.opacity
    normal = (mesh.normals[triangle] * share).sum(axis=1) @ camera.eye_from_world.T
    color = colors_at(mesh, triangle, share[..., 0])
    if light_by is not None:
        factor, highlight = surface_light(normal, ray / length[:, None], light_by, light_by.direction)
        color = color * factor[:, None] + highlight[:, None]
    light = np.column_stack([color, np.ones(len(color))]) * mesh.opacity
    return pixel, depth * length, light


def _unique_hits(inside: np.ndarray, pixel: np.ndarray, depth: np.ndarray) -> np.ndarray:
    """Indices of the crossings among candidates [N], by pixel and depth; a ray through a shared edge or corner crosses
    once, as in OpenGL. inside [N]: the smallest barycentric coordinate; depth: NaN for none.
    """
    hit = np.flatnonzero((inside >= -ON_EDGE) & ~np.isnan(depth))
    hit = hit[np.lexsort((depth[hit], pixel[hit]))]
    on_edge = inside[hit] <= ON_EDGE
    alike = (np.diff(pixel[hit]) == 0) & (np.diff(depth[hit]) <= ON_EDGE * depth[hit[1:]])
    return np.delete(hit, np.flatnonzero(on_edge[1:] & on_edge[:-1] & alike) + 1)


def _candidates(
    corners: np.ndarray, camera: Camera, across: np.ndarray, down: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Pairs of pixels and triangles whose screen box contains them; all pixels for triangles that cross the eye's
    plane. across [W], down [H]: ascending.
    """
    depth = corners[..., 2:] if camera.perspective else np.ones_like(corners[..., 2:])
    crosses = np.less_equal(depth, 0).any(axis=(1, 2))
    projected = corners[..., :2] / np.where(depth > 0, depth, 1.0)
    low = np.where(crosses[:, None], -np.inf, projected.min(axis=1))
    high = np.where(crosses[:, None], np.inf, projected.max(axis=1))
    # the columns and rows of each box
    (left, right), (top, bottom) = (
        (np.searchsorted(axis, low[:, n]), np.searchsorted(axis, high[:, n], side="right"))
        for n, axis in enumerate((across, down))
    )
    wide, count = right - left, (right - left) * (bottom - top)
    triangle = np.repeat(np.arange(len(corners)), count)
    place = np.arange(len(triangle)) - np.repeat(np.cumsum(count) - count, count)
    row, column = np.divmod(place, np.maximum(wide, 1)[triangle])
    return (row + top[triangle]) * len(across) + column + left[triangle], triangle
