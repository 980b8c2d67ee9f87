"""Ambient occlusion and shadows: a coarse grid of extinction, and the light that its cells receive.

Cells are blocks of whole voxels of the first volume's grid, with means of the voxels in them; voxels of other volumes
are shared out over the eight cells around each.

Of the sky a cell keeps the mean m₀ and the first moment m₁ of what passes
from directions all around, so that a surface with normal n sees m₀ + 2 n · m₁ of it, weighted by cosines: 1 of an open
plane, whatever its slope.

The grid's slices are sheared so that rays are lines along an axis, summed along these, and sheared back: two linear
interpolations, however long a ray is.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from weakref import WeakKeyDictionary

import numpy as np

from splatgl.splat.clipping import Clip, Plane
from splatgl.splat.grid import Grid, corners_of, trilinear
from splatgl.splat.preintegration import CELLS
from splatgl.splat.splats import Same, Splats, in_parts

# most cells along the longest side, and empty ones around all
MOST_CELLS, MARGIN = 112, 2
# largest optical depth of a voxel: opaque ones in a block hide about what they cover, not all that is behind it
MOST_DEPTH = 3.0
# splats at a time
PART = 2**18

# splats, and the planes that cut them
Caster = tuple[Splats, tuple[Plane, ...]]


@dataclass(frozen=True, eq=False)
class Coarse:
    """extinction float32 [Z, Y, X]: per world length. cells: the centre of (x, y, z) lies at `cells` of it."""

    extinction: np.ndarray
    cells: Grid

    @classmethod
    def of(cls, casters: Sequence[Caster]) -> Coarse:
        """The cells around all splats."""
        first = casters[0][0].grid
        every = np.concatenate([_box(splats, first) for splats, _ in casters])
        low, high = np.rint(every.min(axis=0)) - 0.5, every.max(axis=0) + 0.5
        widths = np.linalg.norm(first.world_from_index, axis=0)
        side = float(((high - low) * widths).max()) / MOST_CELLS
        block = np.maximum(np.ceil(side / widths - 1e-9), 1.0)
        count = np.ceil((high - low) / block - 1e-9).astype(int) + 2 * MARGIN
        # of the centre of the first cell, in the first volume's indices
        start = low + (0.5 - MARGIN) * block
        cells = Grid(first.world_from_index * block, first.world_from_index @ start + first.origin)
        total = np.zeros(int(count.prod()))
        for n, (splats, planes) in enumerate(casters):
            for place, weight in _weights(splats, planes, cells, count, shared=n > 0):
                total += np.bincount(place, weight, len(total))
        volume = abs(np.linalg.det(cells.world_from_index))
        return cls((total / volume).astype(np.float32).reshape(count[::-1]), cells)


def _box(splats: Splats, grid: Grid) -> np.ndarray:
    """Corners [8, 3] of the box of all splats' voxels less half a voxel, in indices of a grid."""
    if splats.grid is grid:
        return splats.corners_in_grid()
    return grid.index_from_world(corners_of(*splats.index_bounds) @ splats.grid.world_from_index.T + splats.grid.origin)


def _weights(
    splats: Splats, planes: tuple[Plane, ...], cells: Grid, count: np.ndarray, shared: bool
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Cells, and extinction times volume of splats in them."""
    clip = Clip.of(planes, splats.grid)
    size = splats.grid.mean_spacing
    into = np.linalg.inv(cells.world_from_index)
    turn, moved = into @ splats.grid.world_from_index, into @ (np.asarray(splats.grid.origin) - cells.origin)

    def found(part: slice) -> list[tuple[np.ndarray, np.ndarray]]:
        position = splats.records["position"][part].astype(np.float64)
        weight = np.minimum(depths(splats, part), MOST_DEPTH) * size**2
        if clip is not None:
            weight[~clip.keeps(position)] = 0.0
        if splats.mask is not None:
            weight[~splats.mask.keeps(position)] = 0.0
        place = position @ turn.T + moved
        return _shared(place, weight, count) if shared else [(_flat(np.rint(place).astype(np.int64), count), weight)]

    for pairs in in_parts(len(splats), PART, found):
        yield from pairs


def _shared(place: np.ndarray, weight: np.ndarray, count: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """The eight cells around places [N, 3], and the shares of weights [N] in them."""
    low = np.floor(place).astype(np.int64)
    part = place - low
    pairs = []
    for corner in np.ndindex(2, 2, 2):
        share = np.where(corner, part, 1 - part).prod(axis=1)
        pairs.append((_flat(low + np.array(corner), count), weight * share))
    return pairs


def _flat(cell: np.ndarray, count: np.ndarray) -> np.ndarray:
    """Numbers of cells [N, 3] (x, y, z), of which all lie in the grid."""
    x, y, z = np.clip(cell, 0, count - 1).T
    return np.asarray((z * count[1] + y) * count[0] + x)


def depths(splats: Splats, part: slice) -> np.ndarray:
    """Optical depths [N] over a mean spacing of some splats; of values means over those that lie in a voxel."""
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
    return np.asarray(extinction * (splats.grid.mean_spacing / splats.unit))


# cells: how far the sky is looked for; what begins nearer hides neither sky nor light; how far before a surface it is
# asked what reaches it
REACH, SKY_BEGINS, LIGHT_BEGINS, BEFORE = 24.0, 1.0, 2.0, 1.0
# beyond all cells
FAR = 1e9
# weights of the corners of an icosahedron and of a dodecahedron, by which means over directions are exact to degree 9
# [McLaren 1963]
ICOSAHEDRON, DODECAHEDRON = 5 / 168, 9 / 280
# cache: the latest grids of each first caster
_latest: WeakKeyDictionary[Splats, list[Fields]] = WeakKeyDictionary()
MOST_LATEST = 2


@dataclass(frozen=True, eq=False)
class Fields:
    """What cells know. sky float32 [Z, Y, X, 4]: m₁ (x, y, z) in world axes, and m₀; shade [Z, Y, X]: the light that
    passes; None: not asked for. key: what they depend on. seconds: that they took.
    """

    coarse: Coarse
    sky: np.ndarray | None
    shade: np.ndarray | None
    key: tuple[object, ...]
    seconds: float


@dataclass(frozen=True, eq=False)
class LightVolume:
    """Of one picture. casters: all matter, with the planes that cut it. occlusion, shadows: strengths from 0 to 1.

    light: towards it, world axes; None without shadows. grid: of the positions that are asked for.
    """

    casters: tuple[Caster, ...]
    grid: Grid
    occlusion: float
    shadows: float
    light: np.ndarray | None

    @property
    def key(self) -> tuple[object, ...]:
        """Equal for equal pictures of the same splats."""
        return self.occlusion, self.shadows, *_key(self.casters, self.occlusion > 0, self.light)

    @cached_property
    def fields(self) -> Fields:
        """Made once for the same matter and light."""
        return _made(self.casters, self.occlusion > 0, self.light)

    @property
    def cell_from_index(self) -> tuple[np.ndarray, np.ndarray]:
        """[3, 3] and [3]: cells (x, y, z) of grid positions i are M @ i + o."""
        cells = self.fields.coarse.cells
        into = np.linalg.inv(cells.world_from_index)
        return into @ self.grid.world_from_index, into @ (np.asarray(self.grid.origin) - cells.origin)

    @property
    def cell_from_normal(self) -> np.ndarray:
        """[3, 3]: by how many cells a unit normal in world axes leads away from a surface."""
        cells = self.fields.coarse.cells
        return np.linalg.inv(cells.world_from_index) * (BEFORE * cells.mean_spacing)

    def reached(self, positions: np.ndarray, normal: np.ndarray, toward: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The shares [P] of ambient and of direct light at grid positions [P, 3], of surfaces with normals [P, 3] of
        any length, seen along rays [P, 3], world axes. Float64 twin of `shaders/cues.glsl`.
        """
        size = np.linalg.norm(normal, axis=1)
        n = normal / np.where(size > 0, size, 1.0)[:, None]
        # to the side that is seen
        n = n * np.where((n * toward).sum(axis=1) > 0, -1.0, 1.0)[:, None]
        turn, moved = self.cell_from_index
        place = positions @ turn.T + moved + n @ self.cell_from_normal.T
        sky = light = np.ones(len(n))
        if self.fields.sky is not None:
            seen = trilinear(self.fields.sky, place)
            share = np.where(size > 0, seen[:, 3] + 2 * (n * seen[:, :3]).sum(axis=1), 2 * seen[:, 3])
            sky = 1 - self.occlusion * (1 - np.clip(share, 0.0, 1.0))
        if self.fields.shade is not None:
            light = 1 - self.shadows * (1 - trilinear(self.fields.shade[..., None], place)[:, 0])
        return sky, light


def _key(casters: Sequence[Caster], sky: bool, light: np.ndarray | None) -> tuple[object, ...]:
    seen = None if light is None else tuple(np.round(light, 9).tolist())
    return tuple((Same(s.records), s.post and Same(s.post), planes) for s, planes in casters), sky, seen


def _made(casters: Sequence[Caster], sky: bool, light: np.ndarray | None) -> Fields:
    key, first = _key(casters, sky, light), casters[0][0]
    kept = _latest.setdefault(first, [])
    same = next((each for each in kept if each.key == key), None)
    if same is not None:
        return same
    # of the same matter in another light
    started = time.perf_counter()
    near = next((each for each in kept if each.key[0] == key[0]), None)
    coarse = near.coarse if near else Coarse.of(casters)
    seen = (near.sky if near else None) if sky else None
    seen = sky_of(coarse) if sky and seen is None else seen
    side = coarse.cells.mean_spacing
    shade = None if light is None else Sweep.of(coarse, light).through(LIGHT_BEGINS * side, FAR * side)
    found = Fields(coarse, seen, shade, key, time.perf_counter() - started)
    _latest[first] = [found, *kept][:MOST_LATEST]
    return found


def axes() -> tuple[np.ndarray, np.ndarray]:
    """Unit vectors [16, 3], each for itself and its opposite, and their weights [16], of which both together add up
    to 1.
    """
    g = (1 + np.sqrt(5)) / 2
    twelve = [(0, 1, g), (0, 1, -g), (1, g, 0), (1, -g, 0), (g, 0, 1), (-g, 0, 1)]
    twenty = [(1, 1, 1), (1, 1, -1), (1, -1, 1), (-1, 1, 1)]
    twenty += [(1 / g, 0, g), (1 / g, 0, -g), (0, g, 1 / g), (0, g, -1 / g), (g, 1 / g, 0), (g, -1 / g, 0)]
    # turned away from the axes along which surfaces of volumes lie
    a, b = 0.35, 0.6
    turn = np.array([[np.cos(a), -np.sin(a), 0], [np.sin(a), np.cos(a), 0], [0, 0, 1]])
    turn = turn @ np.array([[1, 0, 0], [0, np.cos(b), -np.sin(b)], [0, np.sin(b), np.cos(b)]])
    found = np.array([*twelve, *twenty]) @ turn.T
    weights = np.array([ICOSAHEDRON] * 6 + [DODECAHEDRON] * 10)
    return found / np.linalg.norm(found, axis=1, keepdims=True), weights


def sky_of(coarse: Coarse) -> np.ndarray:
    """The sky of `Fields`."""
    side = coarse.cells.mean_spacing
    found = np.zeros((*coarse.extinction.shape, 4), np.float32)
    for direction, weight in zip(*axes(), strict=True):
        sweep = Sweep.of(coarse, direction)
        along, against = (sweep.through(SKY_BEGINS * side, REACH * side, each) for each in (False, True))
        found[..., 3] += np.float32(weight) * (along + against)
        apart = np.float32(weight) * (along - against)
        for axis in range(3):
            found[..., axis] += np.float32(direction[axis]) * apart
    return found


@dataclass(frozen=True, eq=False)
class Sweep:
    """Rays along a world direction [3], slice by slice along the axis of which they pass the most cells.

    axis: of arrays [Z, Y, X]. slopes: cells along the two others, per slice. step: world length from slice to slice.
    backwards: whether the direction is towards smaller indices. depth [n, H, W]: integrals until the slices' ends,
    in sheared slices.
    """

    axis: int
    slopes: tuple[float, float]
    step: float
    backwards: bool
    shape: tuple[int, int]
    depth: np.ndarray

    @classmethod
    def of(cls, coarse: Coarse, direction: np.ndarray) -> Sweep:
        """The sums along a unit vector, and against it."""
        along = np.linalg.solve(coarse.cells.world_from_index, direction)[::-1]
        axis = int(np.abs(along).argmax())
        slopes = tuple((np.delete(along, axis) / along[axis]).tolist())
        step = 1 / abs(float(along[axis]))
        slices = np.moveaxis(coarse.extinction, axis, 0)
        n, height, width = slices.shape
        grown = [size + int(np.ceil(abs(s) * (n - 1))) + 1 for size, s in zip((height, width), slopes, strict=True)]
        depth = np.zeros((n + 1, *grown), np.float32)
        for k, plane in enumerate(slices):
            (y, fy), (x, fx) = _places(slopes, k, n)
            into = depth[k + 1, y : y + height + 1, x : x + width + 1]
            for dy, wy in ((0, 1 - fy), (1, fy)):
                for dx, wx in ((0, 1 - fx), (1, fx)):
                    into[dy : dy + height, dx : dx + width] += (wy * wx * step) * plane
        np.cumsum(depth, axis=0, out=depth)
        return cls(axis, slopes, step, float(along[axis]) < 0, (height, width), depth)

    def through(self, begin: float, end: float, against: bool = False) -> np.ndarray:
        """float32 [Z, Y, X]: transmittances from world distances `begin` to `end` beyond cells' centres."""
        n = len(self.depth) - 1
        sign = -1.0 if self.backwards != against else 1.0
        middle = np.arange(n) + 0.5
        near, far = (self._until(middle + sign * length / self.step) for length in (begin, end))
        return self._sheared_back(np.exp(-np.abs(far - near)))

    def _until(self, places: np.ndarray) -> np.ndarray:
        """Integrals until places along the axis, one for each slice."""
        n = len(self.depth) - 1
        inside = np.clip(places, 0.0, n)
        low = np.minimum(inside.astype(int), n - 1)
        part = (inside - low).astype(np.float32)[:, None, None]
        below = self.depth[low]
        return np.asarray(below + part * (self.depth[low + 1] - below))

    def _sheared_back(self, values: np.ndarray) -> np.ndarray:
        n, (height, width) = len(values), self.shape
        found = np.empty((n, height, width), np.float32)
        for k, plane in enumerate(values):
            (y, fy), (x, fx) = _places(self.slopes, k, n)
            part = plane[y : y + height + 1, x : x + width + 1]
            rows = part[:-1] + np.float32(fy) * (part[1:] - part[:-1])
            found[k] = rows[:, :-1] + np.float32(fx) * (rows[:, 1:] - rows[:, :-1])
        return np.moveaxis(found, 0, self.axis)


def _places(slopes: tuple[float, ...], k: int, n: int) -> list[tuple[int, float]]:
    """Where slice k of n lies in the sheared ones along both axes: whole cells, and the rest."""
    found = []
    for slope in slopes:
        place = (n - 1 - k) * slope if slope > 0 else -k * slope
        whole = int(place)
        found.append((whole, place - whole))
    return found
