"""Splats in 16 bytes: voxels of similar matter joined to larger splats, positions as steps of a grid, values as entries
of a table of 256, which classifies them before reconstruction. Web pages draw them; see shaders/quantized_records.glsl.

Blocks of 2, 4 and 8 voxels a side are joined where that changes opacity, colour and normals least per splat that is
saved. A joined splat has the mean opacity of the rays through its block along the three axes, as extinction.
"""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from splatgl.data.color import srgb_from_linear
from splatgl.errors import expected
from splatgl.geometry.grid import Grid, corners_of
from splatgl.splat.hidden_interior import least_around
from splatgl.splat.splats import POINT, Splats, assemble

# texels in a row of the texture of splats; entries of a layer's table
QUANTIZED_ROW, CLASSES = 2048, 256
# shares of optical depth are 2^((SHARE_ONE − code) / SHARE_STEPS)
SHARE_STEPS, SHARE_ONE = 16, 64
# steps of a position in a cell: the middles of blocks are halves. Layers of a page, joined levels
STEPS, MOST_LAYERS, LEVELS = 2, 32, 3
# optical depth of a voxel that hides those behind it
OPAQUE_DEPTH = 1.5
# weights, when blocks are joined, of hidden ones, and of matter whose kernels reach beyond surfaces
HIDDEN, LEAK = 1e-3, 0.6
# most cells in which hidden voxels are found
MOST_CELLS = 2**28
# a splat: position in steps; value; normal on an unfolded octahedron; code of its share; log₂ of its side, and 8 times
# the number of its layer; sRGB, and whether it has that colour instead of the layer's
QUANTIZED = np.dtype(
    [("position", "<u2", 3), ("value", "<u2"), ("normal", "u1", 2), ("share", "u1"), ("kind", "u1"), ("own", "u1", 4)]
)


@dataclass(frozen=True, eq=False)
class QuantizedLayer:
    """A layer's table. table [CLASSES, 4]: linear RGB and optical depth per mean spacing, of values from low to high.

    own: whether splats have colours of their own, and no values. span: values that the colours span.
    """

    name: str
    table: np.ndarray
    low: float = 0.0
    high: float = 1.0
    own: bool = False
    span: tuple[float, float] = (0.0, 1.0)


@dataclass(frozen=True, eq=False)
class Matter:
    """Classified voxels of a layer. position [N, 3]: (x, y, z) in cells; depth [N]: optical depth per mean spacing;
    color [N, 3]: linear; normal [N, 3]: unit or zero; values [N]: samples, or None; size [N]: log₂ of their sides,
    voxels. joinable: whether they are voxels.
    """

    layer: QuantizedLayer
    position: np.ndarray
    depth: np.ndarray
    color: np.ndarray
    normal: np.ndarray
    values: np.ndarray | None
    size: np.ndarray
    joinable: bool = True

    def __len__(self) -> int:
        return len(self.depth)

    @cached_property
    def blocks(self) -> VoxelBlocks:
        """The blocks that the voxels may be joined to."""
        return VoxelBlocks.of(self)

    def joined(self, limit: float) -> Matter:
        """The matter with the blocks joined that cost at most `limit` per saved splat."""
        if not self.joinable:
            return self
        order, (number, level) = self.blocks.order, self.blocks.numbers(limit)
        depth, normal, opacity = self.depth[order], self.normal[order], -np.expm1(-self.depth[order])
        size, total = np.zeros(number.max() + 1, np.uint8), np.bincount(number, opacity)
        size[number] = level
        mean = _ray_depth(np.rint(self.position[order]).astype(np.int64), depth, number, size)

        def average(array: np.ndarray) -> np.ndarray:
            return np.stack([np.bincount(number, opacity * column) / total for column in array.T], axis=1)

        # both sides of a surface are lit alike: normals are turned to that of the densest voxel
        by_depth, densest = np.argsort(depth, kind="stable"), np.zeros(len(size), np.int64)
        densest[number[by_depth]] = by_depth
        turned = average(normal * np.where((normal * normal[densest[number]]).sum(axis=1) < 0, -1.0, 1.0)[:, None])
        length = np.linalg.norm(turned, axis=1, keepdims=True)
        turned /= np.where(length > 1e-3, length, np.inf)
        values = None
        if self.values is not None:
            member, (low, high) = self.values[order], (self.layer.low, self.layer.high)
            values = average(member[:, None])[:, 0]
            # a mean of two kinds of matter may be transparent
            depths = np.interp(values, np.linspace(low, high, CLASSES), self.layer.table[:, 3])
            values = np.where(depths < 0.5 * mean, member[densest], values)
        position, color = average(self.position[order]), average(self.color[order])
        return replace(self, position=position, depth=mean, color=color, normal=turned, values=values, size=size)


def _buried(cells: np.ndarray, depth: np.ndarray) -> np.ndarray:
    """[N]: the levels of blocks whose kernels reach nothing but opaque voxels from a voxel."""
    low, shape = cells.min(axis=0), np.ptp(cells, axis=0) + 1
    if np.prod(shape.astype(np.float64)) > MOST_CELLS:
        return np.zeros(len(cells), int)
    place, opaque = tuple((cells - low).T), np.zeros(shape, bool)
    opaque[place] = depth > OPAQUE_DEPTH
    # kernels reach a side beyond a block
    return np.sum([least_around(opaque, 2**level)[place] for level in range(1, LEVELS + 1)], axis=0)


class VoxelBlocks(NamedTuple):
    """Blocks of voxels. order [N]: Morton's, of the voxels; key [N]: their places in it. members and cost [LEVELS, B],
    of the larger blocks around each of the smallest: numbers of voxels, and cost of joining per saved splat.
    """

    order: np.ndarray
    key: np.ndarray
    members: np.ndarray
    cost: np.ndarray

    @classmethod
    def of(cls, matter: Matter) -> VoxelBlocks:
        """The blocks of voxels, and the costs of joining them."""
        cells = np.rint(matter.position).astype(np.int64)
        bits = np.arange(int(cells.max()).bit_length())
        # two zeros after each bit
        spread = ((np.arange(cells.max() + 1)[:, None] >> bits & 1) << 3 * bits).sum(axis=1)
        key = spread[cells] @ np.array([1, 2, 4])
        order = np.argsort(key, kind="stable")
        key, opacity, buried = key[order], -np.expm1(-matter.depth), _buried(cells, matter.depth)[order]
        # what the eye sees of a voxel: its light, how it turns with the normal, its opacity
        lit = 0.7 * matter.color.mean(axis=1, keepdims=True) * matter.normal
        sums = (np.concatenate([matter.color, lit, np.ones((len(cells), 1))], axis=1) * opacity[:, None])[order]
        squares, starts, opacity = (sums * sums).sum(axis=1), [np.arange(len(key))], opacity[order]
        found = list[tuple[np.ndarray, np.ndarray]]()
        for level in range(LEVELS):
            start = np.flatnonzero(np.diff(key >> 3 * (level + 1), prepend=-1))
            groups = np.searchsorted(starts[-1], start)
            sums, squares = np.add.reduceat(sums, groups), np.add.reduceat(squares, groups)
            members = np.diff(start, append=len(key))
            spread = squares - (sums**2).sum(axis=1) / 8.0 ** (level + 1)
            # kernels of blocks near surfaces reach beyond them, the larger the farther
            leak = np.add.reduceat(opacity**2 * (buried <= level), start)
            spread = np.where(leak > 0, spread + LEAK * 2**level * leak, HIDDEN * spread)
            # equal blocks are told apart, so that some of them can be joined
            apart = (spread + 1e-9) * (1 + 0.01 * (np.arange(len(spread)) * 0.618034 % 1))
            starts.append(start)
            around = np.searchsorted(start, starts[1], side="right") - 1
            cost = np.where(members > 1, apart, np.inf) / np.maximum(members - 1, 1)
            found.append((members[around], cost[around]))
        return cls(order, key, *map(np.stack, zip(*found, strict=True)))

    def levels(self, limit: float) -> np.ndarray:
        """[B]: levels of the largest blocks that are joined, 0 for none."""
        return np.asarray((np.arange(1, LEVELS + 1)[:, None] * (self.cost <= limit)).max(axis=0))

    def count(self, limit: float) -> int:
        """Number of splats."""
        level = self.levels(limit)
        joined = np.take_along_axis(self.members, np.maximum(level - 1, 0)[None], axis=0)[0]
        return round(float((self.members[0] / np.where(level, joined, 1)).sum()))

    def numbers(self, limit: float) -> tuple[np.ndarray, np.ndarray]:
        """Of each voxel [N] in order: the number of its splat, and the level of its block, 0 outside of blocks."""
        level = np.repeat(self.levels(limit), self.members[0])
        begins = (np.diff(self.key >> 3 * level, prepend=-1) != 0) | (np.diff(level, prepend=0) != 0)
        return np.cumsum(begins) - 1, level


def _ray_depth(cells: np.ndarray, depth: np.ndarray, number: np.ndarray, size: np.ndarray) -> np.ndarray:
    """Depth per voxel [blocks] of the mean opacity of the rays through each block along the axes."""
    side = 1 << size.astype(np.int64)
    first = np.concatenate([[0], np.cumsum(side * side)])
    block, total = np.repeat(np.arange(len(side)), np.diff(first)), np.zeros(len(side))
    within = cells % side[number, None]
    for axis in range(3):
        one, two = np.delete(within, axis, axis=1).T
        column = np.bincount(first[number] + one * side[number] + two, depth, first[-1])
        through = np.bincount(block, np.exp(-column), len(side)) / (side * side)
        total -= np.log(np.maximum(through, 2.0**-24)) / side
    return total / 3


@dataclass(frozen=True, eq=False)
class JoinedMatter:
    """Layers on one grid in few splats. found: number of splats before any were joined."""

    layers: tuple[Matter, ...]
    grid: Grid
    found: int

    @classmethod
    def of(cls, layers: Sequence[Matter], grid: Grid, most: int) -> JoinedMatter:
        """The layers in at most `most` splats. Raises InputError if there are more, as of points."""
        found = sum(map(len, layers))

        def count(limit: float) -> int:
            return sum(matter.blocks.count(limit) if matter.joinable else len(matter) for matter in layers)

        if found <= most:
            return cls(tuple(layers), grid, found)
        if (least := count(np.inf)) > most:
            raise expected("splats", f"at least {least:,}, as the scene has them after joining all blocks", f"{most:,}")
        low, high = -60.0, 40.0
        for _ in range(24):
            middle = (low + high) / 2
            low, high = (low, middle) if count(2.0**middle) <= most else (middle, high)
        # the widest search ends at all blocks
        return cls(tuple(matter.joined(2.0**high if high < 40 else np.inf) for matter in layers), grid, found)

    def __len__(self) -> int:
        return sum(map(len, self.layers))

    def counted(self, what: str = "", joined: str = " of ") -> str:
        """Their number, and that of the voxels that were joined to them."""
        return f"{len(self):,}{what}" + (f"{joined}{self.found:,} voxels" if self.found > len(self) else "")

    def column(self, name: str) -> np.ndarray:
        """A field [N, …] of the splats of all layers."""
        return np.concatenate([getattr(matter, name) for matter in self.layers])

    @property
    def world(self) -> np.ndarray:
        """Positions [N, 3] in world units."""
        return np.asarray(self.column("position") @ self.grid.world_from_index.T + self.grid.origin)

    @property
    def outline(self) -> Splats:
        """Splats at the corners of the box from the grid's first cell to the last splat, for plans."""
        corners = corners_of(np.zeros(3), self.column("position").max(axis=0))
        records = np.zeros(len(corners), POINT)
        records["position"], records["optical_depth"] = corners, 1.0
        # one normal that is not zero: the layers are shaded
        shaded = any(matter.normal.any() for matter in self.layers)
        return assemble(records, np.rint(corners).astype(np.int64), self.grid, self.grid.mean_spacing, "page", shaded)


@dataclass(frozen=True, eq=False)
class QuantizedSplats:
    """records [N]: QUANTIZED, in row order (z, y, x), as shaders/quantized_records.glsl reads them. step: of positions,
    in cells of the grid.
    """

    records: np.ndarray
    step: float
    layers: tuple[QuantizedLayer, ...]

    @classmethod
    def of(cls, matter: JoinedMatter, bits: int = 8) -> QuantizedSplats:
        """The splats of layers; bits: of values."""
        layers = matter.layers
        if len(layers) > MOST_LAYERS:
            raise expected("layers", f"at most {MOST_LAYERS} in a page", len(layers))
        reach = max(float(each.position.max()) for each in layers)
        step = 1 / STEPS if all(each.joinable for each in layers) else max(reach, 1.0) / 65535
        if reach / step > 65535:
            raise expected("grid", f"at most {65535 // STEPS:,} voxels along each axis", f"{reach:,.0f}")
        records = np.concatenate([_records(each, n, step, bits) for n, each in enumerate(layers)])
        return cls(records[np.lexsort(records["position"].T)], step, tuple(each.layer for each in layers))

    def __len__(self) -> int:
        return len(self.records)

    def back_to_front(self, eye: np.ndarray, axis: int) -> np.ndarray:
        """Order [N] of the splats seen from a place (x, y, z) in cells, ±∞ for parallel views: along each axis from
        both ends to the eye, plane by plane across `axis`. A page walks sorted rows, and sorts nothing for a view.
        """
        position = self.records["position"] * self.step
        before = position <= eye
        # what is beyond the eye follows what is before it, in the opposite order
        keys = np.where(before, position, 2e6 - position)
        numbers = np.where(before[:, int(axis == 0)], 1, -1) * np.arange(len(self))
        return np.lexsort([numbers, *(keys[:, other] for other in range(3) if other != axis), keys[:, axis]])

    def packed(self) -> bytes:
        """The deflated planes of the 16 bytes of a splat: positions as differences from the splat before, low bytes of
        values as differences from the high ones.
        """
        steps = self.records.copy()
        steps["position"][1:] -= self.records["position"][:-1]
        steps["value"] ^= steps["value"] >> 8
        return zlib.compress(np.ascontiguousarray(steps.view(np.uint8).reshape(-1, QUANTIZED.itemsize).T).tobytes())


def _records(matter: Matter, number: int, step: float, bits: int) -> np.ndarray:
    """The records [N] of a layer."""
    layer, records = matter.layer, np.zeros(len(matter), QUANTIZED)
    records["position"], records["value"] = np.rint(matter.position / step), 65535
    if matter.values is not None:
        most = 2**bits - 1
        share = np.clip((matter.values - layer.low) / (layer.high - layer.low), 0, 1)
        records["value"] = np.rint(share * most) * (65535 // most)
    table = np.interp(records["value"] / 65535, np.linspace(0, 1, CLASSES), layer.table[:, 3])
    octaves = np.log2(np.maximum(matter.depth, 1e-30) / np.maximum(table, 1e-30))
    records["share"] = np.clip(np.rint(SHARE_ONE - SHARE_STEPS * octaves), 0, 255)
    records["normal"], records["kind"] = _octahedral(matter.normal), matter.size + 8 * number
    if layer.own:
        records["own"][:, :3] = np.rint(srgb_from_linear(np.clip(matter.color, 0, 1)) * 255)
        records["own"][:, 3] = 1
    return records


def _octahedral(normal: np.ndarray) -> np.ndarray:
    """Two bytes [N, 2] of unit vectors [N, 3]; zeros of zeros."""
    size = np.abs(normal).sum(axis=1, keepdims=True)
    n = normal / np.where(size > 0, size, 1)
    folded = (1 - np.abs(n[:, 1::-1])) * np.where(n[:, :2] >= 0, 1, -1)
    return np.where(size > 0, np.rint(np.where(n[:, 2:] >= 0, n[:, :2], folded) * 127 + 128), 0)
