"""Surfaces of segments: a net of vertices where voxels of several labels meet, smoothed within half a voxel.

After Frisken, "SurfaceNets for Multi-Label Segmentations with Preservation of Sharp Boundaries", Journal of Computer
Graphics Techniques 11(1), 2022: adjacent segments share vertices, without gaps and overlaps. Vertices move to the mean
of their neighbours, which shrinks convex and thin parts; the lost volume is restored locally, so that balls, vessels
and single voxels keep their volume.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from splatgl.coercion import public
from splatgl.data.mesh import Mesh
from splatgl.data.volume import Volume
from splatgl.errors import expected
from splatgl.fileio import budget, format_bytes
from splatgl.transfer.colormaps import SOLID, LabelStyles, label_place, labels_of
from splatgl.transfer.presets import default_transfer, label_transfer
from splatgl.transfer.transfer import Transfer

# default strength, as in 3D Slicer
SMOOTHING = 0.5
# rounds; steps of each towards the mean of neighbours, by a share of the distance at strength 1; rings of neighbours
# within which a round's lost volume is restored
ROUNDS, STEPS, SHARE, RINGS = 5, 2, 0.8, 8
# largest distance of a vertex from its corner of voxels along each axis, in voxels
FARTHEST = 0.5
# cells of 2×2×2 voxels around the face between two voxels, in steps along the two axes across
AROUND = ((0, 0), (1, 0), (1, 1), (0, 1))
# triangles of a quad
HALVES = np.array([[0, 1, 2], [0, 2, 3]])
# planes per read
SLAB = 16
# peak bytes per voxel, measured for balls that fill much of a grid of 256³
BYTES = 14


@public
def surfaces(
    volume: Volume | Any, transfer: Transfer | Any | None = None, smoothing: float = SMOOTHING, closed: bool = True
) -> tuple[Mesh, ...]:
    """Closed surfaces of all visible labels that have voxels, with their colours, names and opacities, in the order of
    their numbers. Adjacent surfaces share the vertices of their border.

    transfer: of labels; None: the default one. smoothing: from 0 (faces of voxels) to 1. closed: False: only the mesh
    of the more opaque segment, or of the lower number, has a border's faces, as a picture needs them once. Masks clip
    the voxels. Raises InputError for a volume without labels, and for one too large for memory.
    """
    return smooth_surfaces(volume, transfer, smoothing, closed)[0]


def smooth_surfaces(
    volume: Volume, transfer: Transfer | None, smoothing: float, closed: bool
) -> tuple[tuple[Mesh, ...], float]:
    """Like `surfaces`; also returns the largest distance of a vertex from its corner of voxels, in voxels."""
    strength, what = check_strength(smoothing), f"surfaces of {volume.name or 'a volume'}"
    chosen = transfer or (label_transfer(volume) if volume.labels is not None else default_transfer(volume))
    if not is_segmentation(volume, chosen):
        raise expected(what, "a segmentation", "amounts", "use --values labels if its numbers are labels")
    if (need := volume.count * BYTES) > (most := budget()):
        fix = "draw boxes, a part or a coarser level"
        raise expected(what, f"a segmentation that needs up to {format_bytes(most)}", format_bytes(need), fix)
    shown = [label for label in chosen.labels if label[2] > 0]
    numbers, low = _number_labels(volume, shown)
    net = SurfaceNet.of(numbers)
    places = net.smooth(strength)
    world = (places + low) @ volume.world_from_index.T + volume.origin
    names = {label.number: label.name for label in volume.labels or ()}
    meshes = []
    for place, vertices, faces in _parts(net, world, np.array([label[2] for label in shown]), closed):
        number, color, opacity = shown[place]
        if np.linalg.det(volume.world_from_index) < 0:
            faces = faces[:, ::-1]
        name = names.get(number) or str(number)
        meshes.append(Mesh(vertices, faces, color, min(opacity / SOLID, 1.0), name=name, frame=volume.frame))
    return tuple(meshes), float(np.linalg.norm(places - net.corners, axis=1).max(initial=0.0))


def is_segmentation(volume: Volume, transfer: Transfer) -> bool:
    """Whether a volume is drawn as labels, even if it contains none."""
    return bool(transfer.labels) or (volume.labels is not None and not labels_of(volume))


def check_strength(smoothing: Any) -> float:
    """Checks a strength of smoothing; True: the default one. Raises InputError unless it is from 0 to 1."""
    if smoothing is True:
        return SMOOTHING
    if isinstance(smoothing, bool) or not isinstance(smoothing, int | float | np.number) or not 0 <= smoothing <= 1:
        raise expected("surfaces", "a strength of smoothing from 0 to 1", repr(smoothing)[:80])
    return float(smoothing)


def _number_labels(volume: Volume, shown: LabelStyles) -> tuple[np.ndarray, np.ndarray]:
    """Voxels' labels as positions in `shown`, counted from 1, 0 for other and masked voxels, in the box around all that
    are not 0; and the box's first voxel (x, y, z).
    """
    numbers: np.ndarray = np.zeros(volume.shape, np.min_scalar_type(len(shown)))
    for slab in volume.slabs(SLAB, halo=0) if shown else ():
        part = numbers[slab.start : slab.stop]
        part[:] = label_place(shown, slab.samples)
        if volume.masks:
            part *= volume.kept((slab.start, 0, 0), (slab.stop, *volume.shape[1:]))
    ends = [np.flatnonzero(numbers.any(axis=tuple({0, 1, 2} - {axis}))) for axis in range(3)]
    box = [slice(indices[0], indices[-1] + 1) if len(indices) else slice(0, 1) for indices in ends]
    return numbers[tuple(box)], np.array([part.start for part in reversed(box)])


def _parts(
    net: SurfaceNet, world: np.ndarray, opacities: np.ndarray, closed: bool
) -> Iterator[tuple[int, np.ndarray, np.ndarray]]:
    """Yields for each segment: its index, vertices [N, 3], and faces [M, 3], counter-clockwise seen from outside."""
    quad, outward, corner, owned = net.ends
    side = np.where(outward[:, None], net.sides[quad], net.sides[quad, ::-1]) - 1
    rank = np.argsort(np.argsort(-opacities, kind="stable"))
    keep = np.full(len(quad), True) if closed else (side[:, 1] < 0) | (rank[side[:, 0]] < rank[side[:, 1]])
    # quads are halved along their shorter diagonal
    diagonals = world[net.quads[:, :2]] - world[net.quads[:, 2:]]
    turned = np.greater(*np.linalg.norm(diagonals, axis=2).T)[quad]
    corner = np.where(turned[:, None], np.roll(corner, -1, axis=1), corner)
    faces = np.where(outward[:, None, None], corner[:, HALVES], corner[:, HALVES[:, ::-1]])
    order = np.flatnonzero(keep)[np.argsort(side[keep, 0], kind="stable")]
    places = np.arange(len(opacities) + 1)
    first = np.searchsorted(owned, (places + 1) * len(net.corners))
    ends = np.searchsorted(side[order, 0], places)
    for place in np.flatnonzero(np.diff(first)).tolist():
        low, high = first[place : place + 2]
        triangles = faces[order[ends[place] : ends[place + 1]]].reshape(-1, 3) - low
        yield place, world[owned[low:high] % len(net.corners)], triangles


@dataclass(frozen=True, eq=False)
class SurfaceNet:
    """The surfaces between segments. corners [V, 3]: corners of voxels on them, grid indices (x, y, z).

    quads [Q, 4]: indices of corners, right-handed about the direction from the first to the second of `sides` [Q, 2],
    numbers of segments. joins: for each axis, pairs of neighbouring corners (lower, upper), and whether three or more
    segments, including the outside, meet between them.
    """

    corners: np.ndarray
    quads: np.ndarray
    sides: np.ndarray
    joins: tuple[tuple[np.ndarray, np.ndarray, np.ndarray], ...]

    @classmethod
    def of(cls, numbers: np.ndarray) -> SurfaceNet:
        """Builds the net of segment numbers [D, H, W]; 0 and everything beyond the ends is outside."""
        padded = np.pad(numbers, 1)
        shape = tuple(size - 1 for size in padded.shape)
        step = np.array([shape[1] * shape[2], shape[2], 1])
        active = np.zeros(int(np.prod(shape)), bool)
        quads, sides, joins = [], [], []
        for axis in range(3):
            lower, upper = (np.moveaxis(padded, axis, 0)[part] for part in (slice(None, -1), slice(1, None)))
            borders = np.nonzero(lower != upper)
            sides.append(np.stack([lower[borders], upper[borders]], axis=1).astype(np.int64))
            order = [axis, *(other for other in range(3) if other != axis)]
            # (z, y, x) has the opposite orientation of (x, y, z)
            b, c = step[axis - 1], step[axis - 2]
            first = np.stack(borders, axis=1) @ step[order] - b - c
            quads.append(np.stack([first + i * b + j * c for i, j in AROUND], axis=1))
            active[quads[-1]] = True
        cells = np.flatnonzero(active)
        places = np.stack(np.unravel_index(cells, shape), axis=1)
        for axis in range(3):
            # the four voxels that meet between a corner and the next
            between = [np.insert(offset, axis, 1) for offset in AROUND]
            met = np.sort([padded[tuple((places + offset).T)] for offset in between], axis=0)
            kinds = (np.diff(met, axis=0) > 0).sum(axis=0) + 1
            lower = np.flatnonzero(kinds > 1)
            joins.append((lower, np.searchsorted(cells, cells[lower] + step[axis]), kinds[lower] > 2))
        quad = np.searchsorted(cells, np.concatenate(quads))
        return cls(places[:, ::-1] - 0.5, quad, np.concatenate(sides), tuple(joins))

    @cached_property
    def ends(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """The E sides of quads that are segments: indices of the quads [E], whether it is their first side [E], and the
        segment's corners [E, 4], indices into the last: segment · V + corner of all corners of all segments, ascending.
        """
        quad, second = np.nonzero(self.sides)
        keys = self.sides[quad, second][:, None] * len(self.corners) + self.quads[quad]
        owned, corner = np.unique(keys, return_inverse=True)
        return quad, second == 0, corner.reshape(-1, 4), owned

    def smooth(self, strength: float) -> np.ndarray:
        """Smoothed corners [V, 3], grid indices."""
        if not strength or not len(self.corners):
            return self.corners
        places, shares = self.corners, self._shares()
        for _ in range(ROUNDS):
            for _ in range(STEPS):
                mean = np.zeros_like(places)
                for lower, upper, *weights in shares:
                    mean[lower] += weights[0] * places[upper]
                    mean[upper] += weights[1] * places[lower]
                places = self._near(places + SHARE * strength * (mean - places))
            places = self._near(places + self._missing(places))
        return places

    def _near(self, places: np.ndarray) -> np.ndarray:
        """Clamps places to FARTHEST from their corners."""
        return np.clip(places, self.corners - FARTHEST, self.corners + FARTHEST)

    def _shares(self) -> list[tuple[np.ndarray, ...]]:
        """The joins, and their weights in the means of their lower and upper ends. Corners on a line where three
        segments meet only have neighbours on that line, which so stays sharp.
        """
        lines = np.zeros(len(self.corners), np.int64)
        for lower, upper, several in self.joins:
            lines[lower] += several
            lines[upper] += several
        on_line = lines > 1
        weights = [(several | ~on_line[lower], several | ~on_line[upper]) for lower, upper, several in self.joins]
        count = np.zeros(len(self.corners))
        for (lower, upper, _), (first, last) in zip(self.joins, weights, strict=True):
            count[lower] += first
            count[upper] += last
        return [
            (lower, upper, (first / count[lower])[:, None], (last / count[upper])[:, None])
            for (lower, upper, _), (first, last) in zip(self.joins, weights, strict=True)
        ]

    def _missing(self, places: np.ndarray) -> np.ndarray:
        """Moves [V, 3] of corners along normals that restore the volume lost within RINGS."""
        quad, outward, corner, owned = self.ends
        # the mean of areas before and after makes the gain exact for moves along normals of any length
        area = (area_vectors(places[self.quads]) + area_vectors(self.corners[self.quads])) / 2
        won = ((places - self.corners)[self.quads].mean(axis=1) * area).sum(axis=1)
        sign = np.where(outward, 1.0, -1.0)
        quads_around = np.bincount(corner.ravel(), minlength=len(owned))

        def spread(of_sides: np.ndarray) -> np.ndarray:
            return np.bincount(corner.ravel(), np.repeat(of_sides / 4, 4), len(owned))

        lost = -spread(won[quad] * sign)
        for _ in range(RINGS):
            lost = spread((lost / quads_around)[corner].sum(axis=1))
        normal = np.stack([spread(area[quad, axis] * sign) for axis in range(3)], axis=1)
        # at edges and tips, where normals of quads differ, at most twice as far as on a plane
        size = np.maximum((normal**2).sum(axis=1), (spread(np.linalg.norm(area, axis=1)[quad]) / 2) ** 2)
        moves = (lost / np.maximum(size, 1e-12))[:, None] * normal
        owner = owned % len(self.corners)
        count = np.maximum(np.bincount(owner, minlength=len(self.corners)), 1)
        return np.stack([np.bincount(owner, moves[:, axis], len(count)) for axis in range(3)], axis=1) / count[:, None]


def area_vectors(corners: np.ndarray) -> np.ndarray:
    """Vectors [Q, 3] along the normals of quads [Q, 4, 3], as long as their areas."""
    return np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1]) / 2
