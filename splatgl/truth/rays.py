"""Rays of pixels in index space, clipped to a volume's box and by planes."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from splatgl.splat.camera import Camera
from splatgl.splat.clipping import FLUSH, GRAZING, Clip
from splatgl.splat.view import View


@dataclass(frozen=True, eq=False)
class Rays:
    """Of pixels [P]. start, direction [3, P]: grid indices; unit vectors of index space.

    near, far [P]: distances from the start between which a ray is in the box, equal if nowhere. stretch [P]: mean
    spacings per index unit along the ray. toward [P, 3]: unit vectors along it in world axes. face [P, 3]: normal of
    the plane that cuts its beginning off, world axes, 0 without one; None: no plane cuts any. entry [P]: distances at
    which rays enter what planes leave, whatever parts of them are taken.
    """

    start: np.ndarray
    direction: np.ndarray
    near: np.ndarray
    far: np.ndarray
    stretch: np.ndarray
    toward: np.ndarray
    face: np.ndarray | None = None
    entry: np.ndarray | None = None

    def between(self, near: np.ndarray, far: np.ndarray) -> Rays:
        """The parts of the rays between distances [P], mean spacings."""
        begin, end = np.maximum(self.near, near / self.stretch), np.minimum(self.far, far / self.stretch)
        return replace(self, near=begin, far=np.maximum(begin, end))

    @classmethod
    def of(
        cls, view: View, camera: Camera, shape: tuple[int, int, int], pixel: np.ndarray, clip: Clip | None = None
    ) -> Rays:
        """Rays of `camera`'s pixels; the box holds the cells of `shape` voxels along x, y, z. clip: cuts them."""
        row, column = np.divmod(pixel, camera.size[0])
        across = (column + 0.5 - camera.size[0] / 2) * view.pitch
        down = (row + 0.5 - camera.size[1] / 2) * view.pitch
        zero, one = np.zeros(len(pixel)), np.ones(len(pixel))
        if view.perspective:
            start, along = np.zeros((3, len(pixel))), np.stack([across, down, one])
        else:
            start, along = np.stack([across, down, zero]), np.stack([zero, zero, one])
        start, direction = view.index_from_eye @ start + view.eye_index[:, None], view.index_from_eye @ along
        speed = np.linalg.norm(direction, axis=0)
        direction = direction / speed
        flush = np.where(np.abs(direction) < GRAZING, FLUSH, 0.0)
        low, high = -0.5 - flush, np.array(shape)[:, None] - 0.5 + flush
        with np.errstate(divide="ignore", invalid="ignore"):
            ends = np.stack([(low - start) / direction, (high - start) / direction])
        # along an axis without motion, a ray is always or never inside
        still, inside = direction == 0, (start >= low) & (start <= high)
        near = np.where(still, np.where(inside, -np.inf, np.inf), ends.min(axis=0)).max(axis=0)
        far = np.where(still, np.where(inside, np.inf, -np.inf), ends.max(axis=0)).min(axis=0)
        # a parallel view begins at its eye's plane, too
        near = np.maximum(near, 0.0)
        toward = (camera.eye_from_world.T @ along).T
        toward = toward / np.linalg.norm(toward, axis=1, keepdims=True)
        face = None
        if clip is not None:
            enters, leaves, plane = clip.along(start, direction)
            face = np.where((enters > near + FLUSH)[:, None], clip.normal[plane], 0.0)
            near, far = np.maximum(near, enters), np.minimum(far, leaves)
        hit = far > near
        stretch = np.linalg.norm(along, axis=0) / speed
        near, far = np.where(hit, near, 0.0), np.where(hit, far, 0.0)
        return cls(start, direction, near, far, stretch, toward, face, near)
