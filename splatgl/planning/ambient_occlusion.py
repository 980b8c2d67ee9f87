"""Ambient occlusion and shadows: a coarse grid of extinction, and the light that its cells receive.

Cells are blocks of whole voxels of the first volume's grid and hold their means; voxels of other volumes are
distributed over the eight nearest cells.

A cell stores the mean m₀ and the first moment m₁ of the transmittance over all directions. A surface with normal n
receives the cosine-weighted share m₀ + 2 n · m₁ of the sky: 1 on an open plane, whatever its slope.

Rays are summed in a sheared copy of the grid, in which they run along an axis: two linear interpolations per ray,
however long it is.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from weakref import WeakKeyDictionary

import numpy as np

from splatgl.geometry.clipping import Clip, Plane
from splatgl.geometry.grid import Grid, corners_of, trilinear
from splatgl.splat.splats import IdentityKey, Splats, in_parts
from splatgl.transfer.preintegration import CELLS
from splatgl.transfer.regions import crossed_depth

# maximum number of cells along the longest side, and empty cells around the box
MOST_CELLS, MARGIN = 112, 2
# limit of a voxel's optical depth: opaque voxels then hide about the part of a block that they cover, not all of it
MOST_DEPTH = 3.0
# splats at a time
PART = 2**18

# splats, and the planes that clip them
Caster = tuple[Splats, tuple[Plane, ...]]


@dataclass(frozen=True, eq=False)
class CoarseGrid:
    """Grid of cells. extinction float32 [Z, Y, X]: per world length. cells: world positions of the cells' centres."""

    extinction: np.ndarray
    cells: Grid

    @classmethod
    def of(cls, casters: Sequence[Caster]) -> CoarseGrid:
        """Returns the cells around all splats."""
        first = casters[0][0].grid
        corners = np.concatenate([_box(splats, first) for splats, _ in casters])
        low, high = np.rint(corners.min(axis=0)) - 0.5, corners.max(axis=0) + 0.5
        widths = np.linalg.norm(first.world_from_index, axis=0)
        side = float(((high - low) * widths).max()) / MOST_CELLS
        block = np.maximum(np.ceil(side / widths - 1e-9), 1.0)
        count = np.ceil((high - low) / block - 1e-9).astype(int) + 2 * MARGIN
        # centre of the first cell, in the first volume's indices
        start = low + (0.5 - MARGIN) * block
        cells = Grid(first.world_from_index * block, first.world_from_index @ start + first.origin)
        total = np.zeros(int(count.prod()))
        for n, (splats, planes) in enumerate(casters):
            for place, weight in _weights(splats, planes, cells, count, shared=n > 0):
                total += np.bincount(place, weight, len(total))
        volume = abs(np.linalg.det(cells.world_from_index))
        return cls((total / volume).astype(np.float32).reshape(count[::-1]), cells)


def _box(splats: Splats, grid: Grid) -> np.ndarray:
    """Corners [8, 3] of the box of all splats' centres, in indices of a grid."""
    if splats.grid is grid:
        return splats.corners_in_grid()
    return grid.index_from_world(corners_of(*splats.index_bounds) @ splats.grid.world_from_index.T + splats.grid.origin)


def _weights(
    splats: Splats, planes: tuple[Plane, ...], cells: Grid, count: np.ndarray, shared: bool
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Yields numbers of cells, and the splats' extinction times volume in each."""
    clip = Clip.of(planes, splats.grid)
    size = splats.grid.mean_spacing
    into = np.linalg.inv(cells.world_from_index)
    turn, moved = into @ splats.grid.world_from_index, into @ (np.asarray(splats.grid.origin) - cells.origin)

    def weigh_part(part: slice) -> list[tuple[np.ndarray, np.ndarray]]:
        position = splats.records["position"][part].astype(np.float64)
        weight = np.minimum(voxel_depths(splats, part), MOST_DEPTH) * size**2
        if clip is not None:
            weight[~clip.keeps(position)] = 0.0
        if splats.mask is not None:
            weight[~splats.mask.keeps(position)] = 0.0
        place = position @ turn.T + moved
        return (
            _share_out(place, weight, count)
            if shared
            else [(_cell_numbers(np.rint(place).astype(np.int64), count), weight)]
        )

    for pairs in in_parts(len(splats), PART, weigh_part):
        yield from pairs


def _share_out(place: np.ndarray, weight: np.ndarray, count: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """The eight cells around places [N, 3], and the part of the weights [N] that each receives."""
    low = np.floor(place).astype(np.int64)
    part = place - low
    pairs = []
    for corner in np.ndindex(2, 2, 2):
        share = np.where(corner, part, 1 - part).prod(axis=1)
        pairs.append((_cell_numbers(low + np.array(corner), count), weight * share))
    return pairs


def _cell_numbers(cell: np.ndarray, count: np.ndarray) -> np.ndarray:
    """Linear indices [N] of cells [N, 3] (x, y, z), clamped to the grid."""
    x, y, z = np.clip(cell, 0, count - 1).T
    return np.asarray((z * count[1] + y) * count[0] + x)


def voxel_depths(splats: Splats, part: slice) -> np.ndarray:
    """Optical depths [N] of some splats over one mean spacing; the mean over the values in a voxel if these are
    classified after reconstruction.
    """
    post = splats.post
    if post is None:
        return splats.records["optical_depth"][part].astype(np.float64)
    records = splats.records[part]
    value, size = records["value"].astype(np.float64), np.linalg.norm(records["gradient"].astype(np.float64), axis=1)
    scale, shift = post.scale
    # at least a cell of the table
    half = np.maximum(scale * size, 1.0) / 2
    middle = scale * value + shift
    table, unit = post.table
    until = table[:, 3].astype(np.float64) * unit
    before, behind = post.integral.outside[:, 3]

    def integral(place: np.ndarray) -> np.ndarray:
        inside = np.clip(place, 0.0, CELLS)
        cell = np.minimum(inside.astype(np.int64), CELLS - 1)
        low = until[cell]
        beyond = (place - inside) * np.where(place < 0, before, behind)
        return np.asarray(low + (inside - cell) * (until[cell + 1] - low) + beyond)

    extinction = np.maximum(integral(middle + half) - integral(middle - half), 0.0) / (2 * half)
    if post.transfer.gradient:
        weight = post.transfer.weight(size * post.span / splats.grid.mean_spacing)
        with np.errstate(divide="ignore"):
            extinction = np.where(weight < 1, -np.log1p(np.expm1(-extinction) * weight), extinction)
    if post.transfer.regions:
        first, last = (np.stack([value + side * half / scale, size]) for side in (-1, 1))
        extinction = extinction + post.mean_regions(first, last, splats.grid.mean_spacing)[:, 3]
    depth = extinction * (splats.grid.mean_spacing / splats.unit)
    if post.transfer.iso:
        levels, matter = post.surfaces
        depth += crossed_depth(levels, matter[:, 3], value - size / 2, value + size / 2)
    return np.asarray(depth)


# in cells: reach of the sky's rays; distances at which rays towards the sky and the light begin; distance before a
# surface at which the light is looked up
REACH, SKY_BEGINS, LIGHT_BEGINS, BEFORE = 24.0, 1.0, 2.0, 1.0
# a distance beyond all cells
FAR = 1e9
# weights of the corners of an icosahedron and of a dodecahedron: means over directions are exact to degree 9
# [McLaren 1963]
ICOSAHEDRON, DODECAHEDRON = 5 / 168, 9 / 280
# cache: the latest grids of each scene's first splats
_latest: WeakKeyDictionary[Splats, list[LightFields]] = WeakKeyDictionary()
MOST_LATEST = 2


@dataclass(frozen=True, eq=False)
class LightFields:
    """Light in the cells, None where a picture needs none. sky float32 [Z, Y, X, 4]: m₁ (x, y, z) in world axes, and
    m₀; shade [Z, Y, X]: transmittance towards the light. key: of the cache. seconds: time to compute them.
    """

    coarse: CoarseGrid
    sky: np.ndarray | None
    shade: np.ndarray | None
    key: tuple[object, ...]
    seconds: float


@dataclass(frozen=True, eq=False)
class LightVolume:
    """Ambient occlusion and shadows of one picture. casters: all splats, with the planes that clip them.

    occlusion, shadows: strengths from 0 to 1. light: direction to the light, world axes; None without shadows. grid: of
    the positions at which light is looked up.
    """

    casters: tuple[Caster, ...]
    grid: Grid
    occlusion: float
    shadows: float
    light: np.ndarray | None

    @property
    def key(self) -> tuple[object, ...]:
        """Cache key: equal for equal light of the same splats."""
        return self.occlusion, self.shadows, *self._key

    @property
    def _key(self) -> tuple[object, ...]:
        direction = None if self.light is None else tuple(np.round(self.light, 9).tolist())
        casters = tuple((IdentityKey(s.records), s.post and IdentityKey(s.post), planes) for s, planes in self.casters)
        return casters, self.occlusion > 0, direction

    @cached_property
    def fields(self) -> LightFields:
        """The light in the cells, computed once for the same splats and light."""
        key, first = self._key, self.casters[0][0]
        cached = _latest.setdefault(first, [])
        same = next((fields for fields in cached if fields.key == key), None)
        if same is not None:
            return same
        # reuse the grids of the same splats in another light
        started = time.perf_counter()
        near = next((fields for fields in cached if fields.key[0] == key[0]), None)
        coarse = near.coarse if near else CoarseGrid.of(self.casters)
        sky = shade = None
        if self.occlusion > 0:
            sky = near.sky if near and near.sky is not None else compute_sky(coarse)
        if self.light is not None:
            side = coarse.cells.mean_spacing
            shade = RaySums.of(coarse, self.light).transmittance(LIGHT_BEGINS * side, FAR * side)
        fields = LightFields(coarse, sky, shade, key, time.perf_counter() - started)
        _latest[first] = [fields, *cached][:MOST_LATEST]
        return fields

    @property
    def cell_from_index(self) -> tuple[np.ndarray, np.ndarray]:
        """M [3, 3] and o [3]: the cell (x, y, z) of grid position i is M @ i + o."""
        cells = self.fields.coarse.cells
        into = np.linalg.inv(cells.world_from_index)
        return into @ self.grid.world_from_index, into @ (np.asarray(self.grid.origin) - cells.origin)

    @property
    def cell_from_normal(self) -> np.ndarray:
        """[3, 3]: turns a unit normal, world axes, into the offset in cells at which light is looked up."""
        cells = self.fields.coarse.cells
        return np.linalg.inv(cells.world_from_index) * (BEFORE * cells.mean_spacing)

    def light_shares(
        self, positions: np.ndarray, normal: np.ndarray, toward: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Shares [P] of ambient and of direct light that reach surfaces at grid positions [P, 3].

        normal [P, 3]: of any length; toward [P, 3]: directions of the rays; world axes. Float64 twin of
        `shaders/cues.glsl`.
        """
        size = np.linalg.norm(normal, axis=1)
        n = normal / np.where(size > 0, size, 1.0)[:, None]
        # to the visible side
        n = n * np.where((n * toward).sum(axis=1) > 0, -1.0, 1.0)[:, None]
        turn, moved = self.cell_from_index
        place = positions @ turn.T + moved + n @ self.cell_from_normal.T
        sky = light = np.ones(len(n))
        if self.fields.sky is not None:
            moments = trilinear(self.fields.sky, place)
            share = np.where(size > 0, moments[:, 3] + 2 * (n * moments[:, :3]).sum(axis=1), 2 * moments[:, 3])
            sky = 1 - self.occlusion * (1 - np.clip(share, 0.0, 1.0))
        if self.fields.shade is not None:
            light = 1 - self.shadows * (1 - trilinear(self.fields.shade[..., None], place)[:, 0])
        return sky, light


def sky_directions() -> tuple[np.ndarray, np.ndarray]:
    """Unit vectors [16, 3], which also stand for their opposites, and their weights [16], per direction."""
    g = (1 + np.sqrt(5)) / 2
    twelve = [(0, 1, g), (0, 1, -g), (1, g, 0), (1, -g, 0), (g, 0, 1), (-g, 0, 1)]
    twenty = [(1, 1, 1), (1, 1, -1), (1, -1, 1), (-1, 1, 1)]
    twenty += [(1 / g, 0, g), (1 / g, 0, -g), (0, g, 1 / g), (0, g, -1 / g), (g, 1 / g, 0), (g, -1 / g, 0)]
    # rotated away from the axes, along which surfaces of volumes often lie
    a, b = 0.35, 0.6
    turn = np.array([[np.cos(a), -np.sin(a), 0], [np.sin(a), np.cos(a), 0], [0, 0, 1]])
    turn = turn @ np.array([[1, 0, 0], [0, np.cos(b), -np.sin(b)], [0, np.sin(b), np.cos(b)]])
    directions = np.array([*twelve, *twenty]) @ turn.T
    weights = np.array([ICOSAHEDRON] * 6 + [DODECAHEDRON] * 10)
    return directions / np.linalg.norm(directions, axis=1, keepdims=True), weights


def compute_sky(coarse: CoarseGrid) -> np.ndarray:
    """Computes `LightFields.sky`: one sweep for each direction and its opposite."""
    side = coarse.cells.mean_spacing
    sky = np.zeros((*coarse.extinction.shape, 4), np.float32)
    for direction, weight in zip(*sky_directions(), strict=True):
        sweep = RaySums.of(coarse, direction)
        along, against = (sweep.transmittance(SKY_BEGINS * side, REACH * side, backward) for backward in (False, True))
        sky[..., 3] += np.float32(weight) * (along + against)
        apart = np.float32(weight) * (along - against)
        for axis in range(3):
            sky[..., axis] += np.float32(direction[axis]) * apart
    return sky


@dataclass(frozen=True, eq=False)
class RaySums:
    """Running sums along rays of one world direction, slice by slice along the axis closest to it.

    axis: of arrays [Z, Y, X]. slopes: cells along the other two axes, per slice. step: world length from slice to
    slice. backwards: whether the direction points to smaller indices. depth [n, H, W]: optical depth up to the slices'
    ends, in the sheared grid.
    """

    axis: int
    slopes: tuple[float, float]
    step: float
    backwards: bool
    shape: tuple[int, int]
    depth: np.ndarray

    @classmethod
    def of(cls, coarse: CoarseGrid, direction: np.ndarray) -> RaySums:
        """Returns the sums along a unit vector; they serve the opposite direction, too."""
        along = np.linalg.solve(coarse.cells.world_from_index, direction)[::-1]
        axis = int(np.abs(along).argmax())
        slopes = tuple((np.delete(along, axis) / along[axis]).tolist())
        step = 1 / abs(float(along[axis]))
        slices = np.moveaxis(coarse.extinction, axis, 0)
        n, height, width = slices.shape
        grown = [size + int(np.ceil(abs(s) * (n - 1))) + 1 for size, s in zip((height, width), slopes, strict=True)]
        depth = np.zeros((n + 1, *grown), np.float32)
        for k, plane in enumerate(slices):
            (y, fy), (x, fx) = _shear_offsets(slopes, k, n)
            into = depth[k + 1, y : y + height + 1, x : x + width + 1]
            for dy, wy in ((0, 1 - fy), (1, fy)):
                for dx, wx in ((0, 1 - fx), (1, fx)):
                    into[dy : dy + height, dx : dx + width] += (wy * wx * step) * plane
        np.cumsum(depth, axis=0, out=depth)
        return cls(axis, slopes, step, float(along[axis]) < 0, (height, width), depth)

    def transmittance(self, begin: float, end: float, against: bool = False) -> np.ndarray:
        """float32 [Z, Y, X]: transmittance between world distances `begin` and `end` from the cells' centres."""
        n = len(self.depth) - 1
        sign = -1.0 if self.backwards != against else 1.0
        middle = np.arange(n) + 0.5
        near, far = (self._depth_until(middle + sign * length / self.step) for length in (begin, end))
        return self._unshear(np.exp(-np.abs(far - near)))

    def _depth_until(self, places: np.ndarray) -> np.ndarray:
        """Optical depth up to places along the axis, one for each slice."""
        n = len(self.depth) - 1
        inside = np.clip(places, 0.0, n)
        low = np.minimum(inside.astype(int), n - 1)
        part = (inside - low).astype(np.float32)[:, None, None]
        below = self.depth[low]
        return np.asarray(below + part * (self.depth[low + 1] - below))

    def _unshear(self, values: np.ndarray) -> np.ndarray:
        n, (height, width) = len(values), self.shape
        upright = np.empty((n, height, width), np.float32)
        for k, plane in enumerate(values):
            (y, fy), (x, fx) = _shear_offsets(self.slopes, k, n)
            part = plane[y : y + height + 1, x : x + width + 1]
            rows = part[:-1] + np.float32(fy) * (part[1:] - part[:-1])
            upright[k] = rows[:, :-1] + np.float32(fx) * (rows[:, 1:] - rows[:, :-1])
        return np.moveaxis(upright, 0, self.axis)


def _shear_offsets(slopes: tuple[float, ...], k: int, n: int) -> list[tuple[int, float]]:
    """Offset of slice k of n in the sheared grid along both axes: whole cells, and the rest."""
    offsets = []
    for slope in slopes:
        place = (n - 1 - k) * slope if slope > 0 else -k * slope
        whole = int(place)
        offsets.append((whole, place - whole))
    return offsets
