"""Layers and meshes in float64.

Along a ray each layer is a sequence of pieces of constant matter. Between any two ends of pieces, the extinctions and
emissions of all layers add up.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from splatgl.data.mesh import Mesh
from splatgl.geometry.camera import Camera
from splatgl.reference.label_boxes import BoxScene
from splatgl.reference.rays import Boxes, Pixels
from splatgl.reference.sheets import Pieces, SheetScene, add_behind
from splatgl.splat.lighting import Light, surface_light
from splatgl.transfer.colormaps import colors_at


@dataclass(frozen=True, eq=False)
class LayerScene:
    """Data shared by all pixels of a picture of layers, drawn in sheets or boxes."""

    layers: Sequence[SheetScene | BoxScene]

    def band_height(self) -> int:
        """Rows of pixels drawn together."""
        return max(min(layer.band_height() for layer in self.layers) // (2 * len(self.layers)), 1)

    def part(self, wanted: Pixels) -> np.ndarray:
        """Wanted pixels of the picture, float64 [P, 4]."""
        return merge_pieces([layer.pieces(wanted) for layer in self.layers])

    def between(self, wanted: Pixels, near: np.ndarray, far: np.ndarray) -> np.ndarray:
        """Light [P, 4] of wanted pixels between distances [P], world units."""
        return merge_pieces([layer.pieces(wanted, near, far) for layer in self.layers])


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
    the last. light [P, K, 4]: premultiplied. mesh [P, K]: number of the mesh, −1 for the last.
    """

    distance: np.ndarray
    light: np.ndarray
    mesh: np.ndarray


@dataclass(frozen=True, eq=False)
class SurfaceScene:
    """Data shared by all pixels of a picture of volumes with meshes. camera: of the samples; light: None: unlit."""

    scene: SheetScene | BoxScene | LayerScene
    meshes: Sequence[Mesh]
    camera: Camera
    light: Light | None

    def band_height(self) -> int:
        """Rows of pixels drawn together."""
        return self.scene.band_height()

    def part(self, wanted: Pixels) -> np.ndarray:
        """Wanted pixels of the picture, float64 [P, 4]."""
        surfaces = crossings(self.meshes, self.camera, wanted, self.light)
        light, near = np.zeros((len(wanted), 4)), np.zeros(len(wanted))
        for far, surface in zip(surfaces.distance.T, surfaces.light.transpose(1, 0, 2), strict=True):
            for part in (self.scene.between(wanted, near, far), surface):
                light += (1 - light[:, 3:]) * part
            near = far
        return light


def crossings(meshes: Sequence[Mesh], camera: Camera, wanted: Pixels, light_by: Light | None) -> Crossings:
    """Surfaces along the rays of wanted pixels, followed by an empty one at infinity."""
    count = len(wanted)
    shown = [number for number, mesh in enumerate(meshes) if len(mesh) and mesh.opacity > 0]
    parts = [_cross_mesh(meshes[number], camera, wanted, light_by) for number in shown]
    pixel = np.concatenate([np.arange(count), *(part[0] for part in parts)])
    distance = np.concatenate([np.full(count, np.inf), *(part[1] for part in parts)])
    light = np.concatenate([np.zeros((count, 4)), *(part[2] for part in parts)])
    mesh = np.repeat([-1, *shown], [count, *(len(part[0]) for part in parts)])
    order = np.lexsort((distance, pixel))
    pixel, distance, light, mesh = pixel[order], distance[order], light[order], mesh[order]
    first = np.searchsorted(pixel, np.arange(count))
    place = np.arange(len(pixel)) - first[pixel]
    size = count, place.max() + 1
    result = Crossings(np.full(size, np.inf), np.zeros((*size, 4)), np.full(size, -1))
    result.distance[pixel, place], result.light[pixel, place], result.mesh[pixel, place] = distance, light, mesh
    return result


def _cross_mesh(
    mesh: Mesh, camera: Camera, wanted: Pixels, light_by: Light | None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Indices of wanted pixels [N], distances [N] and light [N, 4] where their rays cross a mesh."""
    corners = camera.eye_from_points(mesh.vertices)[mesh.faces]
    ahead = (corners[..., 2] > 0).any(axis=1) if camera.perspective else (corners[..., 2] >= 0).any(axis=1)
    faces = np.flatnonzero(ahead)
    triangle, pixel = wanted.within(_pixel_boxes(corners[faces], camera))
    triangle = faces[triangle]
    a, b, c = (corners[triangle, n] for n in range(3))
    across, down = camera.slopes()
    ray = np.column_stack([across[wanted.column[pixel]], down[wanted.row[pixel]], np.ones(len(pixel))])
    start = np.zeros_like(ray)
    if not camera.perspective:
        start[:, :2], ray[:, :2] = ray[:, :2], 0.0
    # Möller and Trumbore 1997
    side, other, from_a = b - a, c - a, start - a
    aside, along = np.cross(ray, other), np.cross(from_a, side)
    determinant = (side * aside).sum(axis=1)
    safe = np.where(determinant == 0, 1.0, determinant)
    u, v, depth = (np.asarray((x * y).sum(axis=1) / safe) for x, y in ((from_a, aside), (ray, along), (other, along)))
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


def _pixel_boxes(corners: np.ndarray, camera: Camera) -> Boxes:
    """Pixels in the screen boxes of triangles [N, 3, 3]; all pixels for those that cross the eye's plane."""
    depth = corners[..., 2:] if camera.perspective else np.ones_like(corners[..., 2:])
    crosses = np.less_equal(depth, 0).any(axis=(1, 2))
    projected = corners[..., :2] / np.where(depth > 0, depth, 1.0)
    low = np.where(crosses[:, None], -np.inf, projected.min(axis=1))
    high = np.where(crosses[:, None], np.inf, projected.max(axis=1))
    ends = []
    for n, axis in enumerate(camera.slopes()):
        ends += [np.searchsorted(axis, low[:, n]), np.searchsorted(axis, high[:, n], side="right")]
    return Boxes(*ends)
