"""Largest number, and largest total optical depth, of splats on one ray of a picture.

Two upper bounds. By planes: a ray meets at most the cells of an ellipse in each lattice plane that it crosses. By
positions: few splats, or few blocks of them, are counted in each cell of the screen that their footprints may touch;
few splats ring by ring, for the light that they give.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np

from splatgl.geometry.view import GridView
from splatgl.splat.splats import Splats

# largest ratio of lattice points in an ellipse across a plane to its area: measured over positions, angles and lengths
DISCRETE = 1.35
# largest distance of a point from its cell's centre
OFF = np.sqrt(3.0) / 2
# tiles along each axis of the picture, for bounding directions
TILES = 8
# up to FEW splats, and up to FEW_POINTS that lie on no lattice, are counted individually; more in blocks of BLOCK cells
# a side, if at most FEW of at most MOST_BLOCKS blocks are occupied. Points lie on surfaces, which fill blocks little.
FEW, FEW_POINTS, BLOCK, MOST_BLOCKS = 8192, 2**22, 8, 2**22
# cells along half of a median footprint, and along each axis of the picture at most CELLS, or the root of the number of
# splats or blocks if that is more
FINE, CELLS = 8, 256
# relative error of sums of depths in float64
ROUNDED = 1e-9
# rings of a footprint, and samples of F in each
RINGS, PER_RING = 6, 32
# splats counted at a time
PART = 2**20
# ratio of a drawn footprint's reach to the kernel's, beyond z_k, for its first-order terms
STRETCHED = 1.25


@dataclass(frozen=True)
class RayOverlap:
    """count: splats whose footprints one ray meets. depth: their Σ τ g, with the effective length g (1 for cubes before
    z_k), in units of the kernel's line integral. light: Σ τ g F/F(0), of footprints F that fall from their centres.
    """

    count: float
    depth: float
    light: float


@dataclass(frozen=True, eq=False)
class SplatGroups:
    """Single splats or blocks of them. place [N, 3]: centres, grid indices; radius [N]: of the ball around the members'
    centres; count [N]; depth [N]: Σ τ.
    """

    place: np.ndarray
    radius: np.ndarray
    count: np.ndarray
    depth: np.ndarray


@dataclass(frozen=True, eq=False)
class CellCounts:
    """Lattice occupancy. aligned: whether all splats are at their cells' centres; count, depth: largest number and Σ τ
    in one cell; planes [3]: occupied planes across x, y, z; groups: None if there are too many blocks.
    """

    aligned: bool
    count: int
    depth: float
    planes: np.ndarray
    groups: SplatGroups | None


def ray_overlap(splats: Splats, view: GridView, astray: float = 0.0) -> RayOverlap:
    """The largest overlap of any ray, for at least one splat. astray: largest displacement of a splat, grid steps."""
    # reach of a splat from its centre, grid steps
    radius, cells = view.kernel.radius + astray, cells_of(splats)
    by_planes = _overlap_by_planes(splats, view, radius)
    if cells.groups is None:
        return by_planes
    by_places = overlap_by_places(cells.groups, view, [(radius, 1.0)])
    light = depth = min(by_planes.depth, by_places.depth)
    if astray == 0.0 and len(splats) <= FEW:
        light = min(depth, _light(cells.groups, view))
    return RayOverlap(min(by_planes.count, by_places.count), depth, light)


def _light(groups: SplatGroups, view: GridView) -> float:
    """An upper bound on Σ τ g F/F(0): in each ring of a footprint its largest |F| there and beyond."""
    radii = view.kernel.radius * np.linspace(0.0, 1.0, RINGS * PER_RING + 1)
    value = np.abs(view.kernel.footprint(radii)) / float(view.kernel.footprint(np.zeros(())))
    largest = np.maximum.accumulate(value[::-1])[::-1][:-1:PER_RING]
    discs = zip(radii[PER_RING::PER_RING], -np.diff(largest, append=0.0), strict=True)
    return overlap_by_places(groups, view, list(discs)).depth


def _longest_reach(view: GridView) -> float:
    """Longest reach of a kernel of unit radius."""
    return float(np.linalg.norm(view.eye_from_index, ord=2))


def _overlap_by_planes(splats: Splats, view: GridView, radius: float) -> RayOverlap:
    cells, corners, longest, stretch = cells_of(splats), view.box(splats), _longest_reach(view), 1.0
    if view.antialias:
        # area of the widest footprint over its unwidened area
        widest = view.filter_pitch * (float(corners[2].max()) if view.perspective else 1.0)
        stretch = float(np.maximum(widest / view.widths, 1.0).prod())
    radius += 0.0 if cells.aligned else OFF
    ellipse = DISCRETE * np.pi * radius**2
    # directions at the corners of the tiles, in index steps, and their lengths
    if view.perspective:
        across, down = (np.linspace(-1, 1, TILES + 1) * edge for edge in view.edge)
        ray = np.stack([*np.meshgrid(across, down), np.ones((TILES + 1, TILES + 1))])
    else:
        ray = np.zeros((3, 2, 2))
        ray[2] = 1.0
    steps = np.tensordot(view.index_from_eye, ray, 1)
    same_sign = np.abs(_corners(np.sign(steps)).sum(axis=0)) == 4
    least = np.where(same_sign, _corners(np.abs(steps)).min(axis=0), 0.0)
    with np.errstate(divide="ignore", over="ignore"):
        crossed = cells.planes[:, None, None] / least
    index = (crossed * _corners(np.sqrt((steps * steps).sum(axis=0))).max(axis=0)).min(axis=0).max()
    length = (crossed * _corners(np.sqrt((ray * ray).sum(axis=0))).max(axis=0)).min(axis=0).max()
    if view.perspective:
        # the ray begins at the eye
        far = float(np.linalg.norm(corners, axis=0).max())
        shortest = float(np.linalg.norm(view.index_from_eye, ord=2))
        index = min(index, far * shortest + 2 * np.sqrt(3.0))
        length = min(length, far + 2 * np.sqrt(3.0) * longest)
    # wide footprints have a smaller discrete excess: a border of half a cell
    wide = radius * np.sqrt(stretch)
    area = min(DISCRETE * np.pi * wide**2, np.pi * (wide + OFF) ** 2)
    count = min(float(len(splats)), area * index * cells.count)
    depth = min(splats.total_depth * longest, ellipse * length * cells.depth)
    return RayOverlap(count, depth, depth)


def overlap_by_places(groups: SplatGroups, view: GridView, discs: list[tuple[float, float]]) -> RayOverlap:
    """The largest overlap of any ray with discs of the groups' splats, of each reach and with each weight of depth."""
    # of a ball around the members' kernels, an ellipsoid in eye axes
    quadric = view.eye_from_index @ view.eye_from_index.T
    many, depth, screen = 0.0, ROUNDED * float(groups.depth.sum(dtype=np.float64)), None
    parts = -(-len(groups.place) // PART)
    for first in range(parts):
        # every part is spread over all groups
        part = slice(first, None, parts)
        around, count = groups.radius[part], groups.count[part]
        voxel = view.voxels(groups.place[part])
        deep = groups.depth[part] * _peaks(view, voxel[2] - around * view.depth_reach)
        for reach, weight in discs:
            size = reach + around
            ahead = size * np.sqrt(quadric[2, 2])
            before = voxel[2] > (ahead if view.perspective else -ahead)
            everywhere = ~before & (voxel[2] > -ahead)
            many += float(count[everywhere].sum())
            depth += weight * float(deep[everywhere].sum(dtype=np.float64))
            if before.any():
                low, high = _outlines(voxel[:, before], size[before], quadric, view)
                if view.antialias:
                    ends = _widened_outlines(voxel[:, before], around[before], reach, view)
                    low, high = np.minimum(low, ends[0]), np.maximum(high, ends[1])
                screen = screen or _Screen.of(low, high, view.edge, len(groups.place))
                screen.add(low, high, count[before], weight * deep[before])
    if screen is not None:
        most, deepest = screen.largest()
        many, depth = many + most, depth + deepest
    depth *= _longest_reach(view)
    return RayOverlap(many, depth, depth)


def _peaks(view: GridView, z: np.ndarray) -> np.ndarray:
    """Upper bounds [N], over `_longest_reach`, on the line integrals of kernels at depths z [N] through their centres:
    f₁ f₂ sec/|(f w, 1)| with the slope w of the ray and the shrink factors f ≤ 1 across the view, at most 1.
    """
    slant = float(np.sqrt(1 + view.edge @ view.edge)) if view.perspective else 1.0
    return np.asarray(np.minimum(view.coverage(z) * slant, 1.0))


def _outlines(
    voxel: np.ndarray, size: np.ndarray, quadric: np.ndarray, view: GridView
) -> tuple[np.ndarray, np.ndarray]:
    """Lowest and highest slopes, or x and y, [2, N] each, of ellipsoids size² · quadric around voxels [3, N] before the
    eye: planes through the eye are tangent where (n·v)² = nᵀ Q n.
    """
    square = size * size
    if not view.perspective:
        half = size * np.sqrt(np.diag(quadric)[:2, None])
        return voxel[:2] - half, voxel[:2] + half
    z, zz = voxel[2], square * quadric[2, 2]
    scale, ends = z * z - zz, []
    for a, aa, az in zip(voxel[:2], np.diag(quadric), quadric[2], strict=False):
        middle = a * z - square * az
        root = np.sqrt(np.maximum(middle * middle - scale * (a * a - square * aa), 0.0))
        ends.append([(middle - root) / scale, (middle + root) / scale])
    low, high = np.array(ends).swapaxes(0, 1)
    return low, high


def _widened_outlines(
    voxel: np.ndarray, around: np.ndarray, reach: float, view: GridView
) -> tuple[np.ndarray, np.ndarray]:
    """Lowest and highest slopes, or x and y, [2, N] each, of widened kernels of radius `reach` up to `around` [N] grid
    steps from voxels [3, N] before the eye; low > high where none is widened.
    """
    # the first-order terms may shift the middle as far as the rim
    reach += (STRETCHED - 1) * max(reach, view.kernel.radius)
    centres = np.sqrt((view.eye_from_index**2).sum(axis=1))[:, None] * around
    low, high = voxel[:2] - centres[:2], voxel[:2] + centres[:2]
    if not view.perspective:
        half = reach * np.sqrt(view.axes**2 @ np.maximum(view.widths, view.filter_pitch) ** 2)[:, None]
        return low - half, high + half
    nearest = np.maximum(voxel[2] - centres[2], view.widened_beyond[1])
    # the kernel's near end, where it is widest in slopes
    deep = reach * view.depth_reach
    near = np.maximum(nearest - deep, deep)
    half = reach * np.sqrt(view.axes**2 @ np.maximum(view.widths[:, None] / near, view.filter_pitch) ** 2)
    slope = np.maximum(np.abs(low), np.abs(high)) / nearest
    half += slope * deep / near
    some = voxel[2] + centres[2] > view.widened_beyond[1]
    ends = [
        np.minimum(low / nearest, low / (voxel[2] + centres[2])),
        np.maximum(high / nearest, high / (voxel[2] + centres[2])),
    ]
    return np.where(some, ends[0] - half, np.inf), np.where(some, ends[1] + half, -np.inf)


@dataclass(frozen=True, eq=False)
class _Screen:
    """Cells of the picture; a box counts for the whole of a cell that it touches. edge [2]: of the picture, from its
    middle; size [2]: of a cell; steps [2, rows, columns]: of the number and of the depth of boxes from cell to cell.
    """

    edge: np.ndarray
    size: np.ndarray
    steps: np.ndarray

    @classmethod
    def of(cls, low: np.ndarray, high: np.ndarray, edge: np.ndarray, boxes: int) -> _Screen:
        """Empty cells for so many boxes, of sizes such as those from low to high [2, N]."""
        cells = max(CELLS, math.isqrt(boxes))
        size = np.maximum(np.median(high - low, axis=1) / (2 * FINE), 2 * edge / cells)
        across, down = (int(n) + 1 for n in np.maximum(np.ceil(2 * edge / size), 1))
        return cls(edge, size, np.zeros((2, down, across)))

    def add(self, low: np.ndarray, high: np.ndarray, *weights: np.ndarray) -> None:
        """Adds boxes from low to high [2, N] with two weights [N] each."""
        _, down, across = self.steps.shape
        most = np.array([[across - 1], [down - 1]])
        (left, top), (right, bottom) = (
            np.clip(np.floor((end + self.edge[:, None]) / self.size[:, None]) + more, 0, most).astype(np.int64)
            for more, end in ((0, low), (1, high))
        )
        corners = ((top, left, 1), (bottom, right, 1), (top, right, -1), (bottom, left, -1))
        for row, column, sign in corners:
            place = row * across + column
            for steps, weight in zip(self.steps, weights, strict=True):
                steps += sign * np.bincount(place, weight, down * across).reshape(down, across)

    def largest(self) -> list[float]:
        """The largest sum of each of the weights over a point of the picture."""
        return [float(steps.cumsum(axis=0).cumsum(axis=1).max()) for steps in self.steps]


_cells: WeakKeyDictionary[Splats, CellCounts] = WeakKeyDictionary()


def cells_of(splats: Splats) -> CellCounts:
    """The occupancy of `splats`, cached for their lifetime."""
    cells = _cells.get(splats)
    if cells is None:
        cells = _cells[splats] = _count(splats)
    return cells


def _count(splats: Splats) -> CellCounts:
    position, depth = splats.records["position"], splats.records["optical_depth"]
    # splats of a cell are adjacent
    first = np.ones(len(splats), bool)
    np.not_equal(splats.cell_x[1:], splats.cell_x[:-1], out=first[1:])
    first[splats.row_start[:-1]] = True
    count, deepest = 1, splats.deepest
    if not first.all():
        start = np.flatnonzero(first)
        count = int(np.diff(start, append=len(splats)).max())
        deepest = float(np.add.reduceat(depth, start, dtype=np.float64).max())
    coordinates = splats.cell_x, splats.row_y, splats.row_z
    # in parts, to save memory
    planes = [len(np.unique(np.concatenate([np.unique(part) for part in _parts(along)]))) for along in coordinates]
    aligned = all(bool((part == np.rint(part)).all()) for part in _parts(position))
    return CellCounts(
        aligned, count, deepest, np.array(planes, dtype=np.float64), _group(splats, FEW if aligned else FEW_POINTS)
    )


def _parts(values: np.ndarray) -> Iterator[np.ndarray]:
    """Yields PART values at a time, to save memory."""
    return (values[first : first + PART] for first in range(0, len(values), PART))


def _group(splats: Splats, few: int) -> SplatGroups | None:
    """Single splats if there are at most `few`, else blocks of them."""
    position, depth = splats.records["position"], splats.records["optical_depth"]
    if len(position) <= few:
        return SplatGroups(position, np.broadcast_to(0.0, len(position)), np.broadcast_to(1.0, len(position)), depth)
    first, last = splats.index_bounds
    wide = np.floor((last - first) / BLOCK) + 1
    if float(wide.prod()) > MOST_BLOCKS:
        return None
    x, y, _ = (int(n) for n in wide)
    count, total = np.zeros(int(wide.prod()), np.int64), np.zeros(int(wide.prod()))
    for places, depths in zip(_parts(position), _parts(depth), strict=True):
        block = ((places - first.astype(np.float32)) / np.float32(BLOCK)).astype(np.int32)
        block = np.minimum(block, wide.astype(np.int32) - 1)
        name = (block[:, 2] * y + block[:, 1]) * x + block[:, 0]
        count += np.bincount(name, minlength=len(count))
        total += np.bincount(name, depths, minlength=len(count))
    used = np.flatnonzero(count)
    if len(used) > FEW:
        return None
    middle = (np.stack([used % x, used // x % y, used // (x * y)], axis=1) + 0.5) * BLOCK + first
    return SplatGroups(
        middle, np.full(len(used), BLOCK * np.sqrt(3.0) / 2), count[used].astype(np.float64), total[used]
    )


def _corners(values: np.ndarray) -> np.ndarray:
    """The four corners of each tile: [4, …, n − 1, m − 1] of [..., n, m]."""
    rows = values[..., :-1, :], values[..., 1:, :]
    return np.stack([part for row in rows for part in (row[..., :-1], row[..., 1:])])
