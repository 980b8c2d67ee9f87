"""`LabelNormals`: normals that light labels, since the faces of their boxes would look like bricks.

Normals are gradients of the smoothed opacity of all labels: where two labels touch there is no surface. Their length is
their certainty, relative to the opacity: faint and opaque labels are lit alike, and voxels deep inside are not lit.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from splatgl.data.volume import Slab, Volume
from splatgl.geometry.grid import trilinear
from splatgl.geometry.mask_field import ONE, ZERO

# sums of two neighbours along each axis: a binomial of 1.6 voxels' deviation; and reach of normals, in voxels
SUMS = 10
HALO = SUMS // 2 + 1
# gradient over smoothed opacity from which on a normal is certain: half of the ratio at a plane face
SURE = 0.24
# maximum number of normals, 128 MB; larger volumes have one for every `step` voxels along each axis
MOST = 2**25
# maximum number along an axis, the least size of OpenGL's textures
LONGEST = 2048


@dataclass(frozen=True, eq=False)
class LabelNormals:
    """faced uint8 [d, h, w, 4]: 0, and normals towards matter, world axes, of lengths from 0 to 1, coded as in
    MaskField; of every `step`-th voxel from `low` (x, y, z) on.
    """

    faced: np.ndarray
    low: tuple[int, int, int]
    step: int

    @classmethod
    def empty(cls, volume: Volume) -> LabelNormals:
        """Zero normals of a volume, to which slabs are added."""
        step = int(np.ceil(max((volume.count / MOST) ** (1 / 3), max(volume.shape) / LONGEST)))
        shape = [-(-size // step) for size in volume.shape]
        normals = np.zeros((*shape, 4), np.uint8)
        normals[..., 1:] = ZERO
        return cls(normals, (0, 0, 0), step)

    def add(self, volume: Volume, slab: Slab, opacity: np.ndarray) -> None:
        """Adds the normals of a slab. opacity float32: of all its samples, including HALO planes on each side within
        the volume.
        """
        # only within HALO of opaque voxels; at indices that `step` divides
        opaque = opacity > 0
        if not opaque.any():
            return
        places = [np.flatnonzero(opaque.any(axis=tuple({0, 1, 2} - {axis}))) for axis in range(3)]
        first = np.array([slab.start - slab.before, 0, 0])
        low = np.maximum(first + [place[0] for place in places] - HALO, [slab.start, 0, 0])
        high = np.minimum(first + [place[-1] + 1 + HALO for place in places], [slab.stop, *volume.shape[1:]])
        low = -(-low // self.step) * self.step
        if (low >= high).any():
            return
        smooth = _smooth(_padded_part(opacity, low - HALO - first, high + HALO - first))
        inner = slice(1, -1, self.step)
        middle = smooth[inner, inner, inner]
        gradient = np.empty((*middle.shape, 3), np.float32)
        for axis in range(3):
            below, above = ([inner] * 3 for _ in range(2))
            below[axis], above[axis] = slice(None, -2, self.step), slice(2, None, self.step)
            gradient[..., 2 - axis] = smooth[tuple(above)] - smooth[tuple(below)]
        sure = np.minimum(_length(gradient) / (2 * SURE * np.maximum(middle[..., None], np.float32(1e-6))), 1.0)
        world = gradient @ np.linalg.inv(volume.world_from_index).astype(np.float32)
        normal = world / np.maximum(_length(world), np.float32(1e-30)) * sure
        z, y, x = (slice(a, a + size) for a, size in zip((low // self.step).tolist(), middle.shape, strict=True))
        self.faced[z, y, x, 1:] = np.rint(normal * ONE + ZERO)

    def crop(self, low: np.ndarray, high: np.ndarray) -> LabelNormals:
        """The normals around voxels from `low` to `high` (x, y, z)."""
        size = np.array(self.faced.shape[2::-1])
        first = np.clip(low // self.step - 1, 0, size - 1)
        last = np.clip(-(-high // self.step) + 2, 1, size)
        (x, y, z), (right, bottom, back) = first.tolist(), last.tolist()
        part = np.ascontiguousarray(self.faced[z:back, y:bottom, x:right])
        return replace(self, faced=part, low=(x * self.step, y * self.step, z * self.step))

    def of_voxels(self, x: np.ndarray, y: np.ndarray, z: np.ndarray) -> np.ndarray:
        """[N, 3]: normals of voxels, or of the nearest voxel with one."""
        last = np.array(self.faced.shape[:3]) - 1
        cells = [
            np.minimum((index + self.step // 2) // self.step, most) for index, most in zip((z, y, x), last, strict=True)
        ]
        return (self.faced[tuple(cells)][:, 1:].astype(np.float32) - ZERO) / ONE

    def at(self, places: np.ndarray) -> np.ndarray:
        """[P, 3]: normals at grid positions [P, 3], linear between voxels; clamped at the ends."""
        return np.asarray((trilinear(self.faced[..., 1:], (places - np.array(self.low)) / self.step) - ZERO) / ONE)


def _padded_part(opacity: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """The part low ≤ (z, y, x) < high, 0 beyond the ends."""
    part = np.zeros(high - low, np.float32)
    first, last = np.maximum(low, 0), np.minimum(high, opacity.shape)
    inside = tuple(slice(a, b) for a, b in zip(first - low, last - low, strict=True))
    part[inside] = opacity[tuple(slice(a, b) for a, b in zip(first, last, strict=True))]
    return part


def _smooth(values: np.ndarray) -> np.ndarray:
    """SUMS sums of neighbours along each axis, shorter by as many, over what these make of 1."""
    for axis in range(3):
        lower, upper = ([slice(None)] * 3 for _ in range(2))
        lower[axis], upper[axis] = slice(None, -1), slice(1, None)
        for _ in range(SUMS):
            values = values[tuple(lower)] + values[tuple(upper)]
        values *= np.float32(0.5**SUMS)
    return values


def _length(vectors: np.ndarray) -> np.ndarray:
    return np.sqrt(np.einsum("...i,...i->...", vectors, vectors))[..., None]
