"""`LabelNormals`: what lights voxels of labels, which are drawn as boxes.

Faces of boxes would be lit like bricks. Normals are gradients of the opacity of all labels, smoothed: where two labels
touch there is no surface, however different their numbers are. They are as long as they are sure, against opacity: a
surface of faint labels is lit as one of opaque ones, and what lies deep in either is not lit by chance.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from splatgl.data.volume import Slab, Volume
from splatgl.splat.view.mask import ONE, ZERO
from splatgl.splat.view.trilinear import trilinear

# sums of two neighbours along each axis: a binomial of 1.6 voxels' deviation; and voxels on which normals depend
SUMS = 10
HALO = SUMS // 2 + 1
# the gradient over the smoothed opacity from which on a normal is sure: half of what both are at a plane face
SURE = 0.24
# most normals of a volume, 128 MB: of larger ones, every so many voxels along each axis has one
MOST = 2**25


@dataclass(frozen=True, eq=False)
class LabelNormals:
    """faced uint8 [d, h, w, 4]: 0, and normals in world axes of lengths from 0 to 1, towards matter, as MaskField has
    them; of every `step`-th voxel from `low` (x, y, z) on.
    """

    faced: np.ndarray
    low: tuple[int, int, int]
    step: int

    @classmethod
    def empty(cls, volume: Volume) -> LabelNormals:
        """Those of a volume, to which slabs are added."""
        step = int(np.ceil((volume.count / MOST) ** (1 / 3)))
        shape = [-(-size // step) for size in volume.shape]
        found = np.zeros((*shape, 4), np.uint8)
        found[..., 1:] = ZERO
        return cls(found, (0, 0, 0), step)

    def add(self, volume: Volume, slab: Slab, opacity: np.ndarray) -> None:
        """Adds the normals of a slab's own planes. opacity float32: of all its samples, of which HALO planes lie on
        each side of these, but beyond the volume's ends.
        """
        before = HALO - slab.before
        after = HALO - (len(opacity) - slab.before - (slab.stop - slab.start))
        smooth = np.pad(opacity, ((before, after), (HALO, HALO), (HALO, HALO)))
        for axis in range(3):
            lower, upper = ([slice(None)] * 3 for _ in range(2))
            lower[axis], upper[axis] = slice(None, -1), slice(1, None)
            for _ in range(SUMS):
                smooth = smooth[tuple(lower)] + smooth[tuple(upper)]
            smooth *= np.float32(0.5**SUMS)
        # own planes, rows and columns, and one more on each side
        first = -slab.start % self.step
        own = slice(1 + first, -1, self.step), slice(1, -1, self.step), slice(1, -1, self.step)
        middle = smooth[own]
        gradient = np.empty((*middle.shape, 3), np.float32)
        for axis in range(3):
            below, above = (tuple(_moved(each, side * (axis == n)) for n, each in enumerate(own)) for side in (-1, 1))
            gradient[..., 2 - axis] = (smooth[above] - smooth[below]) / 2
        sure = np.minimum(_length(gradient) / (SURE * np.maximum(middle[..., None], np.float32(1e-6))), 1.0)
        world = gradient @ np.linalg.inv(volume.world_from_index).astype(np.float32)
        length = _length(world)
        normal = world / np.where(length > 0, length, 1.0) * sure
        z = (slab.start + first) // self.step
        self.faced[z : z + len(middle), ..., 1:] = np.rint(normal * ONE + ZERO)

    def cut(self, low: np.ndarray, high: np.ndarray) -> LabelNormals:
        """Those around voxels from `low` to `high` (x, y, z)."""
        size = np.array(self.faced.shape[2::-1])
        first = np.clip(low // self.step - 1, 0, size - 1)
        last = np.clip(-(-high // self.step) + 2, 1, size)
        (x, y, z), (right, bottom, back) = first.tolist(), last.tolist()
        part = np.ascontiguousarray(self.faced[z:back, y:bottom, x:right])
        return replace(self, faced=part, low=(x * self.step, y * self.step, z * self.step))

    def at(self, places: np.ndarray) -> np.ndarray:
        """[P, 3]: normals at grid positions [P, 3], linear between voxels; beyond the last as there."""
        return np.asarray((trilinear(self.faced[..., 1:], (places - np.array(self.low)) / self.step) - ZERO) / ONE)


def _moved(own: slice, by: int) -> slice:
    """A slice that ends before the last, one further or less far."""
    return slice(own.start + by, own.stop + by or None, own.step)


def _length(vectors: np.ndarray) -> np.ndarray:
    return np.sqrt(np.einsum("...i,...i->...", vectors, vectors))[..., None]
