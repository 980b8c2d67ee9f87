"""Layers, meshes, and labels as boxes of constant density, in float64.

Along a ray each layer is a sequence of pieces of constant matter. Between any two ends of pieces, the extinctions and
emissions of all layers add up.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from splatgl.data.mesh import Mesh
from splatgl.geometry.camera import Camera
from splatgl.geometry.clipping import FACE
from splatgl.planning.culling import back_to_front, order_for
from splatgl.planning.resolve import Resolved
from splatgl.reference.blend import ADD, Accumulator, pixels
from splatgl.reference.rays import Bounds, PixelBoxes, Pixels, Rays, box_ends, pair_values, pixel_boxes, pixel_slopes
from splatgl.reference.sheets import ConstantPieces, SheetScene, composite_sums
from splatgl.splat.lighting import LightModel, surface_light
from splatgl.splat.line_integral import Integral
from splatgl.splat.splats import Splats
from splatgl.transfer.colormaps import colors_at

# least component of a ray in index space: a ray along a face is in one of the two voxels
LEAST = 1e-18
# samples per band
BAND = 1 << 16


class BoxScene:
    """Data shared by all pixels of a picture of boxes, which are the footprints of its splats."""

    def __init__(self, splats: Splats, resolved: Resolved) -> None:
        assert splats.labels is not None
        self.resolved, self.camera, self.view, self.normals = resolved, resolved.camera, resolved.view, splats.labels
        self.appearance, self.spacing = resolved.appearance, splats.grid.mean_spacing
        self.position = splats.positions.astype(np.float64)
        self.boxes = pixel_boxes(self.view, "row1", self.view.voxels(splats.positions), self.camera)
        self.order = np.arange(0)
        if len(splats):
            self.order = back_to_front(splats, order_for(splats, self.camera))[::-1]
        depth = splats.records["optical_depth"].astype(np.float64)
        self.depth = -np.expm1(-depth * splats.unit / self.spacing) if self.appearance.join == "max" else depth
        self.color = splats.colors.astype(np.float64)

    def on(self, splat: np.ndarray, ray: np.ndarray) -> Integral:
        """The lengths, in mean spacings, of rays [2, P] within boxes of splats [P]."""
        rays = self.through(ray)
        entry, exit_ = self.ends(rays, splat, np.arange(len(splat)))
        return Integral(np.maximum(exit_ - entry, 0.0) * rays.stretch, np.ones(len(splat)))

    def band_height(self) -> int:
        """Rows of pixels drawn together."""
        return max(1, BAND // self.camera.size[0])

    def part(self, wanted: Pixels, near: np.ndarray | None = None, far: np.ndarray | None = None) -> np.ndarray:
        """Wanted pixels of the picture, float64 [P, 4], or their light between distances [P], world units."""
        rays = self._rays(wanted, near, far)
        gathered = Accumulator.empty(len(wanted))
        for splat, pixel, ends in self._pass_boxes(wanted, rays):
            if not len(pixel):
                continue
            matter = self._matter(splat, pixel, ends, rays)
            depth = matter[:, 3]
            color = matter[:, :3] / np.where(depth > 0, depth, 1.0)[:, None]
            ADD[self.appearance.join](gathered, pixel, depth, color, np.ones(len(depth)))
        return pixels(gathered, self.appearance)

    def pieces(self, wanted: Pixels, near: np.ndarray | None = None, far: np.ndarray | None = None) -> ConstantPieces:
        """Ray segments of constant density along the rays of wanted pixels, or along their parts between distances
        [P].
        """
        rays = self._rays(wanted, near, far)
        chunks = zip(*self._pass_boxes(wanted, rays), strict=True)
        splat, of_pixel, depths = (np.concatenate(parts, axis=-1) for parts in chunks)
        order = np.argsort(of_pixel, kind="stable")
        pixel, count = of_pixel[order], np.bincount(of_pixel, minlength=len(wanted))
        place = np.arange(len(pixel)) - np.repeat(np.cumsum(count) - count, count)
        ends, matter = np.zeros((len(count), count.max() + 1, 2)), np.zeros((len(count), count.max() + 1, 4))
        world = (rays.stretch * self.spacing)[pixel, None]
        ends[pixel, place] = depths.T[order] * world
        matter[pixel, place] = self._matter(splat, of_pixel, depths, rays)[order]
        # empty pieces at the end of a ray follow its last one
        return np.maximum.accumulate(ends.reshape(len(ends), -1), axis=1).reshape(ends.shape), matter

    def through(self, lateral: np.ndarray) -> Rays:
        """Rays through slopes, or lengths, [2, P] from the middle of the picture."""
        rays = Rays.of(self.view, self.camera, Bounds(clip=self.resolved.clip), lateral)
        return replace(rays, direction=np.where(np.abs(rays.direction) < LEAST, LEAST, rays.direction))

    def _rays(self, wanted: Pixels, near: np.ndarray | None = None, far: np.ndarray | None = None) -> Rays:
        """Rays of wanted pixels, clipped to distances [P], world units, if given."""
        rays = self.through(pixel_slopes(wanted.index, self.camera, self.view.pitch))
        return rays if near is None or far is None else rays.between(near / self.spacing, far / self.spacing)

    def ends(self, rays: Rays, splat: np.ndarray, ray: np.ndarray) -> np.ndarray:
        """[2, N]: distances at which rays, by number [N], enter and leave boxes of splats [N]; entry ≥ exit where they
        miss.
        """
        position = self.position[splat].T
        entry, exit_ = box_ends(rays.start[:, ray], rays.direction[:, ray], position - 0.5, position + 0.5)
        return np.stack([np.maximum(entry, rays.near[ray]), np.minimum(exit_, rays.far[ray])])

    def _pass_boxes(self, wanted: Pixels, rays: Rays) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
        """Yields the parts of boxes along rays, in drawing order: indices of splats [N] and pixels [N], and depths
        [2, N] of their ends; at least one chunk.
        """
        yield np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros((2, 0))
        for splat, pixel, _ in pair_values(self, self.boxes, self.order, wanted, self.camera):
            ends = self.ends(rays, splat, pixel)
            some = ends[1] > ends[0]
            yield splat[some], pixel[some], ends[:, some]

    def _matter(self, splat: np.ndarray, pixel: np.ndarray, ends: np.ndarray, rays: Rays) -> np.ndarray:
        """[N, 4]: emission and optical depth, or opacity, of parts of boxes."""
        depth = self.depth[splat]
        if self.appearance.join != "max":
            depth = depth * (ends[1] - ends[0]) * rays.stretch[pixel]
        color = self.color[splat]
        if self.appearance.hides:
            factor, highlight = self._shade(pixel, ends, rays)
            color = color * factor[:, None] + highlight[:, None]
        return np.column_stack([color * depth[:, None], depth])

    def _shade(self, pixel: np.ndarray, ends: np.ndarray, rays: Rays) -> tuple[np.ndarray, np.ndarray]:
        """Factors of colours [N] and highlights [N] of parts of boxes."""
        appearance, (entry, exit_) = self.appearance, ends
        start, direction = rays.start[:, pixel].T, rays.direction[:, pixel].T
        nothing = np.zeros((len(entry), 3))
        normal = self.normals.at(start + direction * entry[:, None]) if appearance.shading else nothing
        toward, shines = rays.toward[pixel], appearance.light.within(self.camera)
        middle = start + direction * ends.mean(axis=0)[:, None]

        def light(of: np.ndarray) -> np.ndarray:
            cues = self.resolved.cues
            reached = None if cues is None else cues.light_shares(middle, of, toward)
            return np.stack(surface_light(of, toward, appearance.light, shines, reached))

        result = light(nothing)
        # in the middle of a voxel of a thin label, normals are half as long as at its face
        result += np.minimum(2 * np.linalg.norm(normal, axis=1), 1.0) * (light(normal) - result)
        if appearance.shading and rays.face is not None:
            face, faced = rays.face[pixel], rays.entry[pixel] + FACE
            share = np.clip((faced - entry) / (exit_ - entry), 0.0, 1.0) * face.any(axis=1)
            result += share * (light(face) - result)
        return result[0], result[1]


@dataclass(frozen=True, eq=False)
class LayerScene:
    """Data shared by all pixels of a picture of layers, drawn in sheets or boxes."""

    layers: Sequence[SheetScene | BoxScene]

    def band_height(self) -> int:
        """Rows of pixels drawn together."""
        return max(min(layer.band_height() for layer in self.layers) // (2 * len(self.layers)), 1)

    def part(self, wanted: Pixels, near: np.ndarray | None = None, far: np.ndarray | None = None) -> np.ndarray:
        """Wanted pixels of the picture, float64 [P, 4], or their light between distances [P], world units."""
        layers = [layer.pieces(wanted, near, far) for layer in self.layers]
        ends = np.concatenate([own.reshape(len(own), -1) for own, _ in layers], axis=1)
        order = np.argsort(ends, axis=1, kind="stable")
        edges = np.take_along_axis(ends, order, axis=1).T
        # of an end the layer whose piece ends there, −1 where one begins
        ending = np.concatenate([np.tile([-1, n], own.shape[1]) for n, (own, _) in enumerate(layers)])[order].T
        light = np.zeros((len(ends), 4))
        at = [np.zeros(len(ends), np.intp) for _ in layers]
        for first, last, ended in zip(edges[:-1], edges[1:], ending[:-1], strict=True):
            middle, matter = (first + last) / 2, np.zeros_like(light)
            for n, (own, own_matter) in enumerate(layers):
                at[n] += ended == n
                some = np.flatnonzero((last > first) & (at[n] < own.shape[1]))
                begin, end = own[some, at[n][some]].T
                inside = (begin < middle[some]) & (middle[some] < end)
                some, length = some[inside], (end - begin)[inside]
                matter[some] += own_matter[some, at[n][some]] * ((last - first)[some] / length)[:, None]
            light += (1 - light[:, 3:]) * composite_sums(matter[:, None])
        return light


# difference of barycentric coordinates, and relative difference of depths, that is only rounding
ON_EDGE = 1e-9


@dataclass(frozen=True, eq=False)
class SurfaceScene:
    """Data shared by all pixels of a picture of volumes with meshes. camera: of the samples; light: None: unlit."""

    scene: SheetScene | BoxScene | LayerScene
    meshes: Sequence[Mesh]
    camera: Camera
    light: LightModel | None

    def band_height(self) -> int:
        """Rows of pixels drawn together."""
        return self.scene.band_height()

    def part(self, wanted: Pixels) -> np.ndarray:
        """Wanted pixels of the picture, float64 [P, 4]."""
        distances, lights, _ = crossings(self.meshes, self.camera, wanted, self.light)
        light, near = np.zeros((len(wanted), 4)), np.zeros(len(wanted))
        for far, surface in zip(distances.T, lights.transpose(1, 0, 2), strict=True):
            for part in (self.scene.part(wanted, near, far), surface):
                light += (1 - light[:, 3:]) * part
            near = far
        return light


def crossings(
    meshes: Sequence[Mesh], camera: Camera, wanted: Pixels, light_by: LightModel | None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Surfaces along the rays of wanted pixels, nearest first, and an empty one at infinity: distances [P, K] from the
    eye, or from its plane, world units; light [P, K, 4], premultiplied; numbers of the meshes [P, K], −1 for the last.
    """
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
    distances, lights, numbers = np.full(size, np.inf), np.zeros((*size, 4)), np.full(size, -1)
    distances[pixel, place], lights[pixel, place], numbers[pixel, place] = distance, light, mesh
    return distances, lights, numbers


def _cross_mesh(
    mesh: Mesh, camera: Camera, wanted: Pixels, light_by: LightModel | None
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


def _pixel_boxes(corners: np.ndarray, camera: Camera) -> PixelBoxes:
    """Pixels in the screen boxes of triangles [N, 3, 3]; all pixels for those that cross the eye's plane."""
    depth = corners[..., 2:] if camera.perspective else np.ones_like(corners[..., 2:])
    crosses = np.less_equal(depth, 0).any(axis=(1, 2))
    projected = corners[..., :2] / np.where(depth > 0, depth, 1.0)
    low = np.where(crosses[:, None], -np.inf, projected.min(axis=1))
    high = np.where(crosses[:, None], np.inf, projected.max(axis=1))
    ends = []
    for n, axis in enumerate(camera.slopes()):
        ends += [np.searchsorted(axis, low[:, n]), np.searchsorted(axis, high[:, n], side="right")]
    return PixelBoxes(*ends)
