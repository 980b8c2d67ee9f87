"""`Cues`: which share of the sky, and of the light, reaches each place: ambient occlusion and shadows.

Both come from a coarse grid of extinction. Of the sky a cell keeps the mean m₀ and the first moment m₁ of what passes
from directions all around, so that a surface with normal n sees m₀ + 2 n · m₁ of it, weighted by cosines: 1 of an open
plane, whatever its slope.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from weakref import WeakKeyDictionary

import numpy as np

from splatgl.splat.cues.coarse import Caster, Coarse
from splatgl.splat.cues.sweep import Sweep
from splatgl.splat.extraction.kept import Same
from splatgl.splat.extraction.splats import Grid, Splats
from splatgl.splat.view.trilinear import trilinear as trilinear

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
class Cues:
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
