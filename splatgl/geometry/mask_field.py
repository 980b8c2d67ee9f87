"""`MaskField`: masks of a volume and missing samples, as rays see them.

The mask is linear between voxel centres; matter ends where it passes one half, while the field of values continues
across this border. So a mask with plane faces clips like these planes, and a single kept voxel stays visible. Faces
that a mask cuts through matter are lit by the mask's gradient. Voxels classified before reconstruction are drawn whole
or not at all.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from weakref import WeakKeyDictionary

import numpy as np

from splatgl.data.volume import Places, Volume
from splatgl.errors import expected
from splatgl.fileio import format_bytes
from splatgl.geometry.clipping import FLUSH
from splatgl.geometry.grid import Grid, dilate, trilinear
from splatgl.transfer.statistics import spread

# the mask at which matter ends
EDGE = 0.5
# kept voxels are surrounded by this many, in which the mask and its gradient are known
AROUND = 3
# reach of the values on which kept places depend, in voxels: a kernel's reach plus that of sheets
REACH = 5
# maximum number of voxels in the box around kept voxels
MOST = 2**29
# the length of the smoothed mask's gradient at a plane face
FACE_GRADIENT = 0.3125
# code of a component: the byte of 0, and the step to that of 1
ZERO, ONE = 128, 127
# gradients of values, in spreads of the volume's values per mean spacing, from which on they light faces that agree
SURE = 0.05
# factors between which these gradients are records' for any transfer function: their squares are finite in float32
LEAST_SURE, MOST_SURE = 1e-15, 1e15
# cache: the field of each volume
_made: WeakKeyDictionary[Volume, MaskField | None] = WeakKeyDictionary()


@dataclass(frozen=True, eq=False)
class MaskField:
    """kept uint8 [d, h, w]: 255 or 0 for voxels from `low` (x, y, z) on, and between where faces lie between centres of
    voxels; clamped beyond. world: turns gradients from index axes to world axes, per mean spacing. sure: gradient of
    values per mean spacing from which on it lights a face that it fits; it is of the volume, so that transfer functions
    of one meaning are lit alike.
    """

    kept: np.ndarray
    low: tuple[int, int, int]
    world: np.ndarray
    shape: tuple[int, int, int]
    sure: float

    @classmethod
    def of(cls, volume: Volume) -> MaskField | None:
        """Combines the masks of a volume; None without masks. Raises InputError for a box of more than MOST voxels."""
        if not volume.masks:
            return None
        if volume not in _made:
            _made[volume] = cls._of(volume)
        return _made[volume]

    @classmethod
    def with_gaps(cls, volume: Volume, gaps: np.ndarray) -> MaskField | None:
        """Masks of a volume without the missing voxels at `gaps` [N, 3] (x, y, z), unless their box is too large."""
        mask = cls.of(volume)
        if not len(gaps):
            return mask
        if mask is None:
            low = np.maximum(gaps.min(axis=0) - AROUND, 0)
            high = np.minimum(gaps.max(axis=0) + 1 + AROUND, volume.shape[::-1])
            if int((high - low).prod(dtype=np.int64)) > MOST:
                return None
            mask = cls._around(volume, np.full((high - low)[::-1], 255, np.uint8), low)
        else:
            mask = replace(mask, kept=mask.kept.copy())
        places = gaps - np.array(mask.low)
        x, y, z = places[((places >= 0) & (places < mask.kept.shape[::-1])).all(axis=1)].T
        mask.kept[z, y, x] = 0
        return mask

    @classmethod
    def _of(cls, volume: Volume) -> MaskField:
        depth, height, width = volume.shape
        ends = np.array([[depth, height, width], [0, 0, 0]])
        for z in range(depth):
            plane = volume.kept((z, 0, 0), (z + 1, height, width))[0]
            if plane.any():
                y, x = (np.flatnonzero(plane.any(axis=axis)) for axis in (1, 0))
                ends[0] = np.minimum(ends[0], (z, y[0], x[0]))
                ends[1] = np.maximum(ends[1], (z + 1, y[-1] + 1, x[-1] + 1))
        if (ends[0] >= ends[1]).any():
            ends[1] = ends[0] = 0
            ends[1] += 1
        low = np.maximum(ends[0] - AROUND, 0)
        high = np.minimum(ends[1] + AROUND, volume.shape)
        count = int((high - low).prod())
        if count > MOST:
            fix = "draw a coarser --level, or mask less of it"
            raise expected(
                "mask", f"a box of at most {MOST:,} voxels ({format_bytes(MOST)}) around it", f"{count:,}", fix
            )
        kept = np.zeros(high - low, np.uint8)
        (z0, y0, x0), (z1, y1, x1) = low.tolist(), high.tolist()
        for z in range(z0, z1):
            kept[z - z0] = volume.mask_shares((z, y0, x0), (z + 1, y1, x1))[0]
        return cls._around(volume, kept, low[::-1])

    @classmethod
    def _around(cls, volume: Volume, kept: np.ndarray, low: np.ndarray) -> MaskField:
        """The field of `kept`, voxels of a volume from `low` (x, y, z) on."""
        grid, (x, y, z) = Grid.of(volume), low.tolist()
        world = np.linalg.inv(grid.world_from_index) * grid.mean_spacing
        return cls(kept, (x, y, z), world, volume.shape, SURE * spread(volume))

    @cached_property
    def faced(self) -> np.ndarray:
        """uint8 [d, h, w, 4]: `kept`, and the gradient of the smoothed mask, world axes; its length is at most 1, its
        value at plane faces.
        """
        smooth = self.kept.astype(np.float32) / 255
        for axis in (0, 1, 2, 0, 1, 2):
            padded = np.pad(smooth, [(int(axis == n),) * 2 for n in range(3)], mode="edge")
            below, above = (padded.take(range(k, k + smooth.shape[axis]), axis) for k in (0, 2))
            smooth = (below + 2 * smooth + above) / 4
        texels = np.empty((*smooth.shape, 4), np.uint8)
        texels[..., 0] = self.kept
        for z in range(len(smooth)):
            texels[z, ..., 1:] = np.rint(self._faces(smooth, z) * ONE + ZERO)
        return texels

    def _faces(self, smooth: np.ndarray, z: int) -> np.ndarray:
        """[h, w, 3]: gradients of `faced` in a plane, before rounding."""
        below, above = smooth[max(z - 1, 0)], smooth[min(z + 1, len(smooth) - 1)]
        padded = np.pad(smooth[z], 1, mode="edge")
        along = (padded[1:-1, 2:] - padded[1:-1, :-2], padded[2:, 1:-1] - padded[:-2, 1:-1], above - below)
        gradient = np.stack(along, axis=-1) / 2
        size = np.minimum(np.linalg.norm(gradient, axis=-1, keepdims=True) / FACE_GRADIENT, 1.0)
        world = gradient @ self.world
        length = np.linalg.norm(world, axis=-1, keepdims=True)
        return np.asarray(world / np.where(length > 0, length, 1.0) * size)

    def at(self, places: np.ndarray) -> np.ndarray:
        """[P]: the mask minus EDGE at grid positions [3, P]; the visible part ends where it falls below 0."""
        return np.asarray(trilinear(self.kept[..., None], self._cells(places))[:, 0] / 255 - EDGE)

    def normals(self, places: np.ndarray) -> np.ndarray:
        """[P, 3]: the gradients of `faced` at grid positions [3, P], world axes."""
        return np.asarray((trilinear(self.faced[..., 1:], self._cells(places)) - ZERO) / ONE)

    def _cells(self, places: np.ndarray) -> np.ndarray:
        return np.asarray(places.T - np.array(self.low))

    def face_share(self, gradient: np.ndarray, normal: np.ndarray, span: float) -> np.ndarray:
        """Share [P] of light by the mask's normals [P, 3]; values' gradients [P, 3] give the rest, in `span` per mean
        spacing. Gradients light a face where the mask follows a surface of the values.
        """
        size2, face2 = (gradient**2).sum(axis=1), (normal**2).sum(axis=1)
        along, sure = (gradient * normal).sum(axis=1), self.sure_of(span)
        alike = along * along / np.maximum(size2 * face2, 1e-30) * (size2 / (size2 + sure**2))
        return np.asarray(np.sqrt(face2) * (1.0 - alike))

    def sure_of(self, span: float) -> float:
        """`sure` in `span` per mean spacing."""
        return float(np.clip(self.sure / span, LEAST_SURE, MOST_SURE))

    def keeps(self, positions: np.ndarray) -> np.ndarray:
        """bool [N]: whether grid positions [N, 3] lie in kept voxels."""
        last = np.array(self.kept.shape[::-1]) - 1
        x, y, z = np.clip(np.rint(positions).astype(np.int64) - np.array(self.low), 0, last).T
        return np.asarray(self.kept[z, y, x] > 127)

    @cached_property
    def _near(self) -> tuple[np.ndarray, np.ndarray]:
        """bool: whether voxels of a box are within REACH of kept ones; and the box's first (z, y, x)."""
        low = np.array(self.low[::-1])
        first = np.maximum(low - REACH, 0)
        last = np.minimum(low + self.kept.shape + REACH, self.shape)
        near = np.zeros(last - first, bool)
        z, y, x = (slice(a, a + n) for a, n in zip(low - first, self.kept.shape, strict=True))
        near[z, y, x] = self.kept > 0
        for _ in range(REACH):
            near = dilate(near)
        return near, first

    def near(self, low: Places, high: Places) -> np.ndarray:
        """bool: whether voxels low ≤ (z, y, x) < high affect values at kept places."""
        near, first = self._near
        result = np.zeros([b - a for a, b in zip(low, high, strict=True)], bool)
        begin, end = np.maximum(low, first), np.minimum(high, first + near.shape)
        if (begin < end).all():
            inner = tuple(slice(a, b) for a, b in zip(begin - low, end - low, strict=True))
            result[inner] = near[tuple(slice(a, b) for a, b in zip(begin - first, end - first, strict=True))]
        return result


def clip_to_mask(
    at: tuple[np.ndarray, np.ndarray], ends: tuple[np.ndarray, np.ndarray]
) -> tuple[np.ndarray, np.ndarray]:
    """Clips segments between `ends` [P] to where the mask is kept. at: the mask minus EDGE at the ends, linear between;
    segments in a face are kept.
    """
    first, last = (np.where(np.maximum(*np.abs(at)) < FLUSH, 0.0, value) for value in at)
    with np.errstate(divide="ignore", invalid="ignore"):
        cross = ends[0] + (ends[1] - ends[0]) * (first / (first - last))
    begin = np.where(first >= 0, ends[0], np.where(last >= 0, cross, ends[0]))
    end = np.where(first >= 0, np.where(last >= 0, ends[1], cross), np.where(last >= 0, ends[1], ends[0]))
    return begin, end
