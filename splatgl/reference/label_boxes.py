"""Labels as boxes of constant density, in float64: the twin of `shaders/boxes.glsl`."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from splatgl.geometry.clipping import FACE, FLUSH
from splatgl.planning.ordering import back_to_front, order_for
from splatgl.planning.resolve import Resolved
from splatgl.reference.blend import ADD, Band, Part, pixels
from splatgl.reference.rays import Pixels, index_rays, pair_values, pixel_boxes, pixel_slopes
from splatgl.reference.sheets import Pieces
from splatgl.splat.lighting import surface_light
from splatgl.splat.line_integral import Integral
from splatgl.splat.splats import Splats

# least component of a ray in index space: a ray along a face is in one of the two voxels
LEAST = 1e-18
# samples per band
BAND = 1 << 16


@dataclass(frozen=True, eq=False)
class BoxRays:
    """Rays of P pixels; their parameter is eye-space depth in mean spacings. start, direction [3, P]: grid positions at
    depth 0, and steps per depth. near, far [P]: depths between which they are drawn. stretch [P]: mean spacings per
    depth. toward [P, 3]: unit vectors, world axes. face [P, 3]: normals of the planes that clip their starts, or 0.
    faced [P]: depths up to which boxes are lit as those faces.
    """

    start: np.ndarray
    direction: np.ndarray
    near: np.ndarray
    far: np.ndarray
    stretch: np.ndarray
    toward: np.ndarray
    face: np.ndarray
    faced: np.ndarray

    @classmethod
    def of(cls, resolved: Resolved, lateral: np.ndarray) -> BoxRays:
        """Rays through slopes, or lengths, [2, P] from the middle of the picture."""
        view, camera, clip = resolved.view, resolved.camera, resolved.clip
        start, direction, along = index_rays(view, lateral)
        direction = np.where(np.abs(direction) < LEAST, LEAST, direction)
        stretch = np.linalg.norm(along, axis=0)
        near, far, face = np.zeros(len(stretch)), np.full(len(stretch), np.inf), np.zeros((len(stretch), 3))
        if clip is not None:
            enters, leaves, plane = clip.along(start, direction)
            face = np.where((enters * np.linalg.norm(direction, axis=0) > FLUSH)[:, None], clip.normal[plane], 0.0)
            near, far = np.maximum(near, enters), leaves
        toward = (along / stretch).T @ camera.eye_from_world
        return cls(start, direction, near, far, stretch, toward, face, near + FACE / np.linalg.norm(direction, axis=0))

    def ends(self, position: np.ndarray, ray: np.ndarray) -> np.ndarray:
        """[2, N]: depths at which rays, by number [N], enter and leave the boxes of voxels [N, 3]; entry ≥ exit where
        they miss.
        """
        start, direction = self.start[:, ray], self.direction[:, ray]
        faces = np.stack([(position.T + side - start) / direction for side in (-0.5, 0.5)])
        entry, exit_ = faces.min(axis=0).max(axis=0), faces.max(axis=0).min(axis=0)
        return np.stack([np.maximum(entry, self.near[ray]), np.minimum(exit_, self.far[ray])])


class BoxScene:
    """Data shared by all pixels of a picture of boxes, which are the footprints of its splats."""

    def __init__(self, splats: Splats, resolved: Resolved) -> None:
        assert splats.labels is not None
        self.resolved, self.camera, self.view, self.normals = resolved, resolved.camera, resolved.view, splats.labels
        self.look, self.spacing = resolved.look, splats.grid.mean_spacing
        self.position = splats.positions.astype(np.float64)
        self.boxes = pixel_boxes(self.view, "row1", self.view.voxels(splats.positions), self.camera)
        self.order = np.arange(0)
        if len(splats):
            self.order = back_to_front(splats, order_for(splats, self.camera))[::-1]
        depth = splats.records["optical_depth"].astype(np.float64)
        self.depth = -np.expm1(-depth * splats.unit / self.spacing) if self.look.join == "max" else depth
        self.color = splats.colors.astype(np.float64)

    def on(self, splat: np.ndarray, ray: np.ndarray) -> Integral:
        """The lengths, in mean spacings, of rays [2, P] within boxes of splats [P]."""
        rays = BoxRays.of(self.resolved, ray)
        entry, exit_ = rays.ends(self.position[splat], np.arange(len(splat)))
        return Integral(np.maximum(exit_ - entry, 0.0) * rays.stretch, np.ones(len(splat)))

    def band_height(self) -> int:
        """Rows of pixels drawn together."""
        return max(1, BAND // self.camera.size[0])

    def part(self, wanted: Pixels) -> np.ndarray:
        """Wanted pixels of the picture, float64 [P, 4]."""
        return self._light(wanted, self._rays(wanted))

    def between(self, wanted: Pixels, near: np.ndarray, far: np.ndarray) -> np.ndarray:
        """Light [P, 4] of wanted pixels between distances [P], world units."""
        return self._light(wanted, self._rays(wanted, near, far))

    def pieces(self, wanted: Pixels, near: np.ndarray | None = None, far: np.ndarray | None = None) -> Pieces:
        """Pieces of matter along the rays of wanted pixels, or along their parts between distances [P]."""
        rays = self._rays(wanted, near, far)
        chunks = list(self._pass_boxes(wanted, rays))
        part = Passed(
            *(np.concatenate([getattr(chunk, name) for chunk in chunks], axis=-1) for name in vars(chunks[0]))
        )
        order = np.argsort(part.pixel, kind="stable")
        pixel, count = part.pixel[order], np.bincount(part.pixel, minlength=len(wanted))
        place = np.arange(len(pixel)) - np.repeat(np.cumsum(count) - count, count)
        ends, matter = np.zeros((len(count), count.max() + 1, 2)), np.zeros((len(count), count.max() + 1, 4))
        world = (rays.stretch * self.spacing)[pixel, None]
        ends[pixel, place] = part.ends.T[order] * world
        matter[pixel, place] = self._matter(part, rays)[order]
        # empty pieces at the end of a ray follow its last one
        return Pieces(np.maximum.accumulate(ends.reshape(len(ends), -1), axis=1).reshape(ends.shape), matter)

    def _rays(self, wanted: Pixels, near: np.ndarray | None = None, far: np.ndarray | None = None) -> BoxRays:
        """Rays of wanted pixels, clipped to distances [P], world units, if given."""
        rays = BoxRays.of(self.resolved, pixel_slopes(wanted.index, self.camera, self.resolved.view.pitch))
        if near is None or far is None:
            return rays
        length = rays.stretch * self.spacing
        return replace(rays, near=np.maximum(rays.near, near / length), far=np.minimum(rays.far, far / length))

    def _pass_boxes(self, wanted: Pixels, rays: BoxRays) -> Iterator[Passed]:
        """Yields the parts of boxes along rays, in drawing order; at least one chunk."""
        yield Passed(np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros((2, 0)))
        for pairs in pair_values(self, self.boxes, self.order, wanted, self.camera):
            ends = rays.ends(self.position[pairs.splat], pairs.pixel)
            some = ends[1] > ends[0]
            yield Passed(pairs.splat[some], pairs.pixel[some], ends[:, some])

    def _light(self, wanted: Pixels, rays: BoxRays) -> np.ndarray:
        """Blends the boxes along the rays of wanted pixels: light [P, 4]."""
        gathered = Band.empty(len(wanted))
        for part in self._pass_boxes(wanted, rays):
            if not len(part.pixel):
                continue
            matter = self._matter(part, rays)
            depth = matter[:, 3]
            color = matter[:, :3] / np.where(depth > 0, depth, 1.0)[:, None]
            ADD[self.look.join](gathered, Part(part.pixel, depth, color, np.ones(len(depth))))
        return pixels(gathered, self.look)

    def _matter(self, part: Passed, rays: BoxRays) -> np.ndarray:
        """[N, 4]: emission and optical depth, or opacity, of parts of boxes."""
        depth = self.depth[part.splat]
        if self.look.join != "max":
            depth = depth * (part.ends[1] - part.ends[0]) * rays.stretch[part.pixel]
        color = self.color[part.splat]
        if self.look.hides:
            factor, highlight = self._shade(part, rays)
            color = color * factor[:, None] + highlight[:, None]
        return np.column_stack([color * depth[:, None], depth])

    def _shade(self, part: Passed, rays: BoxRays) -> tuple[np.ndarray, np.ndarray]:
        """Factors of colours [N] and highlights [N] of parts of boxes."""
        look, (entry, exit_) = self.look, part.ends
        start, direction = rays.start[:, part.pixel].T, rays.direction[:, part.pixel].T
        nothing = np.zeros((len(entry), 3))
        normal = self.normals.at(start + direction * entry[:, None]) if look.shading else nothing
        toward, shines = rays.toward[part.pixel], look.light.within(self.camera)
        middle = start + direction * part.ends.mean(axis=0)[:, None]

        def light(of: np.ndarray) -> np.ndarray:
            cues = self.resolved.cues
            reached = None if cues is None else cues.light_shares(middle, of, toward)
            return np.stack(surface_light(of, toward, look.light, shines, reached))

        result = light(nothing)
        # in the middle of a voxel of a thin label, normals are half as long as at its face
        result += np.minimum(2 * np.linalg.norm(normal, axis=1), 1.0) * (light(normal) - result)
        face = rays.face[part.pixel]
        if look.shading and face.any():
            share = np.clip((rays.faced[part.pixel] - entry) / (exit_ - entry), 0.0, 1.0) * face.any(axis=1)
            result += share * (light(face) - result)
        return result[0], result[1]


@dataclass(frozen=True, eq=False)
class Passed:
    """Parts of boxes along rays: indices of splats [N] and pixels [N], and depths [2, N] of their ends."""

    splat: np.ndarray
    pixel: np.ndarray
    ends: np.ndarray
