"""Surfaces of segments: a net of vertices where voxels of several labels meet, smoothed within half a voxel.

After Frisken, "SurfaceNets for Multi-Label Segmentations with Preservation of Sharp Boundaries", Journal of Computer
Graphics Techniques 11(1), 2022: segments that touch share vertices; there are no gaps and overlaps between them.
Vertices are drawn to the mean of their neighbours, which takes volume from what is convex or thin; it is given back
where it was taken, so that balls, vessels and single voxels keep theirs.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from splatgl.data.mesh import Mesh
from splatgl.data.volume import Volume
from splatgl.errors import expected
from splatgl.fileio import budget, size_of
from splatgl.splat.colormaps import SOLID, Shown, label_place, labels_of
from splatgl.splat.presets import default_transfer, label_transfer
from splatgl.splat.transfer import Transfer

# strength where none is given, as 3D Slicer has it
SMOOTHING = 0.5
# rounds of STEPS to the mean of neighbours, by a share of the way at strength 1, after each of which volume is given
# back, within so many rings of neighbours
ROUNDS, STEPS, SHARE, RINGS = 5, 2, 0.8, 8
# farthest that a vertex lies from the corner of voxels that it stands for, along each axis, in voxels
FARTHEST = 0.5
# cells of 2×2×2 voxels around the face between two voxels, in steps along the two axes across
AROUND = ((0, 0), (1, 0), (1, 1), (0, 1))
# triangles of a quad
HALVES = np.array([[0, 1, 2], [0, 2, 3]])
# planes that are read at once
SLAB = 16
# bytes a voxel while nets are made, of balls that fill much of a grid of 256³
BYTES = 14


def surfaces(
    volume: Volume, transfer: Transfer | None = None, smoothing: float = SMOOTHING, closed: bool = True
) -> tuple[Mesh, ...]:
    """A closed surface of each label that is shown and has voxels, in its colour, name and opacity, in the order of
    their numbers. Two that touch share the vertices of their border.

    transfer: that of labels; None: the default one. smoothing: from 0, the faces of voxels, to 1. closed: False: a
    border is in one of both meshes, that of the more opaque segment or of the lower number, as a picture needs it once.
    Masks cut the voxels. Raises InputError for a volume without labels, and for one that memory is too small for.
    """
    return smoothed_surfaces(volume, transfer, smoothing, closed)[0]


def smoothed_surfaces(
    volume: Volume, transfer: Transfer | None, smoothing: float, closed: bool
) -> tuple[tuple[Mesh, ...], float]:
    """The same, and how far from the corners of voxels their vertices are at most, in voxels."""
    strength, what = strength_of(smoothing), f"surfaces of {volume.name or 'a volume'}"
    chosen = transfer or (label_transfer(volume) if volume.labels is not None else default_transfer(volume))
    if not is_segmentation(volume, chosen):
        raise expected(what, "a segmentation", "amounts", "--values labels, if its numbers are names")
    if (need := volume.count * BYTES) > (most := budget()):
        fix = "draw boxes, a part, or a coarser level"
        raise expected(what, f"a segmentation that needs up to {size_of(most)}", size_of(need), fix)
    shown = [each for each in chosen.labels if each[2] > 0]
    numbers, low = _numbered(volume, shown)
    net = Net.of(numbers)
    places = net.smoothed(strength)
    world = (places + low) @ volume.world_from_index.T + volume.origin
    names = {each.number: each.name for each in volume.labels or ()}
    found = []
    for place, vertices, faces in _parts(net, world, np.array([each[2] for each in shown]), closed):
        number, color, opacity = shown[place]
        if np.linalg.det(volume.world_from_index) < 0:
            faces = faces[:, ::-1]
        name = names.get(number) or str(number)
        found.append(Mesh(vertices, faces, color, min(opacity / SOLID, 1.0), name=name, frame=volume.frame))
    return tuple(found), float(np.linalg.norm(places - net.corners, axis=1).max(initial=0.0))


def is_segmentation(volume: Volume, transfer: Transfer) -> bool:
    """Whether a volume is drawn as labels; also one of labels that holds none."""
    return bool(transfer.labels) or (volume.labels is not None and not labels_of(volume))


def strength_of(smoothing: Any) -> float:
    """A strength of smoothing; True: the default one. Raises InputError for others than from 0 to 1."""
    if smoothing is True:
        return SMOOTHING
    if isinstance(smoothing, bool) or not isinstance(smoothing, int | float | np.number) or not 0 <= smoothing <= 1:
        raise expected("surfaces", "a strength of smoothing from 0 to 1", repr(smoothing)[:80])
    return float(smoothing)


def _numbered(volume: Volume, shown: Shown) -> tuple[np.ndarray, np.ndarray]:
    """Places in `shown`, from 1 on, of the labels of voxels; 0 of others, and of those that masks leave out. In the box
    of all that are not 0, which begins at (x, y, z).
    """
    found: np.ndarray = np.zeros(volume.shape, np.min_scalar_type(len(shown)))
    for slab in volume.slabs(SLAB, halo=0) if shown else ():
        part = found[slab.start : slab.stop]
        part[:] = label_place(shown, slab.samples)
        if volume.masks:
            part *= volume.kept((slab.start, 0, 0), (slab.stop, *volume.shape[1:]))
    ends = [np.flatnonzero(found.any(axis=tuple({0, 1, 2} - {axis}))) for axis in range(3)]
    box = [slice(each[0], each[-1] + 1) if len(each) else slice(0, 1) for each in ends]
    return found[tuple(box)], np.array([each.start for each in reversed(box)])


def _parts(
    net: Net, world: np.ndarray, opacities: np.ndarray, closed: bool
) -> Iterator[tuple[int, np.ndarray, np.ndarray]]:
    """Of each segment: its place from 0 on, vertices [N, 3] and faces [M, 3], which turn right-handed about outward."""
    quad, outward, corner = net.ends
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
    first = np.searchsorted(net.owned, (places + 1) * len(net.corners))
    ends = np.searchsorted(side[order, 0], places)
    for place in np.flatnonzero(np.diff(first)).tolist():
        low, high = first[place : place + 2]
        own = faces[order[ends[place] : ends[place + 1]]].reshape(-1, 3) - low
        yield place, world[net.owned[low:high] % len(net.corners)], own


@dataclass(frozen=True, eq=False)
class Net:
    """The surfaces between segments. corners [V, 3]: those of voxels of which it consists, grid indices (x, y, z).
    quads [Q, 4]: numbers of corners, right-handed about the direction from the first of `sides` [Q, 2], numbers of
    segments, to the second. joins: of each axis, neighbours along it (lower, upper), and whether three or more
    segments meet between them, outside being one.
    """

    corners: np.ndarray
    quads: np.ndarray
    sides: np.ndarray
    joins: tuple[tuple[np.ndarray, np.ndarray, np.ndarray], ...]

    @classmethod
    def of(cls, numbers: np.ndarray) -> Net:
        """Of numbers [D, H, W] of segments; 0 is outside of all, as is what lies beyond the ends."""
        padded = np.pad(numbers, 1)
        shape = tuple(size - 1 for size in padded.shape)
        step = np.array([shape[1] * shape[2], shape[2], 1])
        active = np.zeros(int(np.prod(shape)), bool)
        quads, sides, joins = [], [], []
        for axis in range(3):
            lower, upper = (np.moveaxis(padded, axis, 0)[part] for part in (slice(None, -1), slice(1, None)))
            found = np.nonzero(lower != upper)
            sides.append(np.stack([lower[found], upper[found]], axis=1).astype(np.int64))
            order = [axis, *(each for each in range(3) if each != axis)]
            # (z, y, x) turns the other way than (x, y, z)
            b, c = step[axis - 1], step[axis - 2]
            first = np.stack(found, axis=1) @ step[order] - b - c
            quads.append(np.stack([first + i * b + j * c for i, j in AROUND], axis=1))
            active[quads[-1]] = True
        cells = np.flatnonzero(active)
        places = np.stack(np.unravel_index(cells, shape), axis=1)
        for axis in range(3):
            # what the four voxels are that meet between a corner and the next
            between = [np.insert(each, axis, 1) for each in AROUND]
            met = np.sort([padded[tuple((places + each).T)] for each in between], axis=0)
            kinds = (np.diff(met, axis=0) > 0).sum(axis=0) + 1
            lower = np.flatnonzero(kinds > 1)
            joins.append((lower, np.searchsorted(cells, cells[lower] + step[axis]), kinds[lower] > 2))
        quad = np.searchsorted(cells, np.concatenate(quads))
        return cls(places[:, ::-1] - 0.5, quad, np.concatenate(sides), tuple(joins))

    @cached_property
    def ends(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Of the sides of quads that are segments: numbers of the quads, and whether it is their first side [E]; and
        corners of that segment [E, 4], numbers of `owned`.
        """
        quad, second = np.nonzero(self.sides)
        return quad, second == 0, self._owned[1].reshape(-1, 4)

    @property
    def owned(self) -> np.ndarray:
        """Segment · V + corner, ascending, of all corners of segments [W]."""
        return self._owned[0]

    @cached_property
    def _owned(self) -> tuple[np.ndarray, np.ndarray]:
        quad, second = np.nonzero(self.sides)
        keys = self.sides[quad, second][:, None] * len(self.corners) + self.quads[quad]
        found: tuple[np.ndarray, np.ndarray] = np.unique(keys, return_inverse=True)
        return found

    def smoothed(self, strength: float) -> np.ndarray:
        """Corners [V, 3], grid indices, smoothed."""
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
        """Within FARTHEST of where they come from."""
        return np.clip(places, self.corners - FARTHEST, self.corners + FARTHEST)

    def _shares(self) -> list[tuple[np.ndarray, ...]]:
        """The joins, and the weights of each in the means of its lower and its upper end. Corners of lines along which
        three segments meet have neighbours on that line alone, which so stays sharp.
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
        """Moves [V, 3] of corners, along normals, that give segments back what volume they lost within RINGS."""
        quad, outward, corner = self.ends
        # the mean of areas before and now: what is won is right for all moves along normals, however far
        area = (across(places[self.quads]) + across(self.corners[self.quads])) / 2
        won = ((places - self.corners)[self.quads].mean(axis=1) * area).sum(axis=1)
        sign = np.where(outward, 1.0, -1.0)
        each = np.bincount(corner.ravel(), minlength=len(self.owned))

        def spread(of_sides: np.ndarray) -> np.ndarray:
            return np.bincount(corner.ravel(), np.repeat(of_sides / 4, 4), len(self.owned))

        lost = -spread(won[quad] * sign)
        for _ in range(RINGS):
            lost = spread((lost / each)[corner].sum(axis=1))
        normal = np.stack([spread(area[quad, axis] * sign) for axis in range(3)], axis=1)
        # at edges and tips, where quads look different ways, no further than twice as far as on a plane
        size = np.maximum((normal**2).sum(axis=1), (spread(np.linalg.norm(area, axis=1)[quad]) / 2) ** 2)
        moves = (lost / np.maximum(size, 1e-12))[:, None] * normal
        owner = self.owned % len(self.corners)
        count = np.maximum(np.bincount(owner, minlength=len(self.corners)), 1)
        return np.stack([np.bincount(owner, moves[:, axis], len(count)) for axis in range(3)], axis=1) / count[:, None]


def across(corners: np.ndarray) -> np.ndarray:
    """Vectors [Q, 3] along the normals of quads [Q, 4, 3], as long as their areas."""
    return np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1]) / 2
