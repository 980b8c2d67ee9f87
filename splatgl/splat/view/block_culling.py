"""Frustum culling of splats and of blocks of consecutive splats."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from splatgl.splat.view.view import View

# splats per block: BLOCK in tile_place.frag
BLOCK = 256
# pixels added to the picture: a tile may cross its edge
MARGIN = 8
# beyond z_k a footprint's radius is R pixels, times √2 for slant, plus a margin for its first-order terms
STRETCHED = 2.0


@dataclass(frozen=True, eq=False)
class Frustum:
    """Planes through the picture's edges, in eye axes and mean spacings; fields are [2], along x and y.

    edge: slopes, or lengths, from the middle to the planes. support: largest distance beyond them from which a kernel
    still reaches them, times the length of (1, edge). stretch: the same at depth 1 for a widened kernel.
    """

    view: View
    edge: np.ndarray
    support: np.ndarray
    stretch: np.ndarray

    @classmethod
    def of(cls, view: View) -> Frustum:
        """The planes of a view's picture, MARGIN pixels beyond its edges."""
        edge = view.edge + MARGIN * view.pitch
        normals = np.zeros((2, 2, 3))
        for axis in (0, 1):
            normals[axis, :, axis] = 1.0
            normals[axis, :, 2] = edge[axis] * np.array([-1, 1]) if view.perspective else 0.0
        support = view.kernel.radius * np.linalg.norm(normals @ view.eye_from_index, axis=-1).max(axis=1)
        widest = STRETCHED * view.kernel.radius * view.pitch * view.antialias
        if not view.perspective:
            return cls(view, edge, np.maximum(support, widest), np.zeros(2))
        return cls(view, edge, support, np.full(2, widest * (1 + float(np.hypot(*edge)))))

    def reached(self, center: np.ndarray, half: np.ndarray | None = None) -> np.ndarray:
        """Whether splats within `half` [3, N] of `center` [3, N], eye axes, may be visible; bool [N]."""
        half = np.zeros_like(center) if half is None else half
        furthest = center[2] + half[2] if self.view.perspective else np.ones(center.shape[1:])
        beyond = np.abs(center[:2]) - half[:2] - self.edge[:, None] * furthest
        reach = np.maximum(self.support[:, None], self.stretch[:, None] * furthest)
        ahead = center[2] + half[2] > -self.view.reach if self.view.perspective else True
        return np.asarray((beyond <= reach * (1 + 1e-3) + 1e-3 * self.support[:, None]).all(axis=0) & ahead)


def boxes(positions: np.ndarray) -> np.ndarray:
    """Bounding boxes of each BLOCK of positions [N, 3], grid indices: centre and half sides [blocks, 6]."""
    if not len(positions):
        return np.zeros((0, 6))
    begins = np.arange(0, len(positions), BLOCK)
    low, high = (extreme.reduceat(positions, begins).astype(np.float64) for extreme in (np.minimum, np.maximum))
    return np.concatenate([(low + high) / 2, (high - low) / 2], axis=1)


def shown(around: np.ndarray, frustum: Frustum) -> np.ndarray:
    """Which boxes [blocks, 6] may contain a visible splat; bool [blocks]."""
    view = frustum.view
    return frustum.reached(view.voxels(around[:, :3]), np.abs(view.eye_from_index) @ around[:, 3:].T)
