"""Splats in 16 bytes: voxels of similar matter joined to larger splats, positions as steps of a grid, values as entries
of a table of 256, which classifies them before reconstruction. Web pages draw them; see shaders/quantized_records.glsl.

Blocks of 2, 4 and 8 voxels a side are joined where that changes opacity, colour and normals least per splat that is
saved. A joined splat has the mean opacity of the rays through its block along the three axes, as extinction.
"""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from splatgl.data.color import linear_from_srgb, srgb_from_linear
from splatgl.errors import expected
from splatgl.geometry.grid import Grid, corners_of
from splatgl.splat.splats import POINT, Splats, assemble, is_points

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
    """Classified voxels of a layer. cells int [N, 3]: (x, y, z); depth [N]: optical depth per mean spacing; color
    [N, 3]: linear; normal [N, 3]: unit or zero; values [N]: samples, or None. size [N]: log₂ of their sides, voxels.
    position [N, 3]: in cells.
    """

    layer: QuantizedLayer
    position: np.ndarray
    depth: np.ndarray
    color: np.ndarray
    normal: np.ndarray
    values: np.ndarray | None = None
    size: np.ndarray | None = None
    joinable: bool = True

    @classmethod
    def of(cls, layer: QuantizedLayer, splats: Splats, offset: np.ndarray, values: np.ndarray | None) -> Matter:
        """The matter of splats classified before reconstruction; offset [3]: of their grid in cells of the page's."""
        normal = splats.records["normal"].astype(np.float32)
        size = np.linalg.norm(normal, axis=1, keepdims=True)
        normal /= np.where(size > 0, size, 1)
        if not splats.shaded:
            normal[:] = 0
        position = splats.positions + offset
        joinable = not is_points(splats.records.dtype)
        return cls(layer, position, splats.depths.astype(np.float64), splats.colors, normal, values, None, joinable)

    def __len__(self) -> int:
        return len(self.depth)

    @cached_property
    def blocks(self) -> VoxelBlocks:
        """The blocks that the voxels may be joined to."""
        return VoxelBlocks.of(self)

    def joined(self, limit: float) -> Matter:
        """The matter with the blocks joined that cost at most `limit` per saved splat."""
        return self.blocks.joined(self, limit) if self.joinable else self


def _spread(cells: np.ndarray) -> np.ndarray:
    """Bits of cells [N] (up to 16), two zeros after each."""
    x = cells.astype(np.uint64)
    for shift, mask in (
        (16, 0xFF0000FF0000FF),
        (8, 0xF00F00F00F00F00F),
        (4, 0x30C30C30C30C30C3),
        (2, 0x9249249249249249),
    ):
        x = (x | (x << np.uint64(shift))) & np.uint64(mask)
    return x


def _buried(cells: np.ndarray, depth: np.ndarray) -> np.ndarray:
    """uint8 [N]: the levels of blocks whose kernels reach nothing but opaque voxels from a voxel."""
    low, level = cells.min(axis=0), np.zeros(len(cells), np.uint8)
    shape = np.ptp(cells, axis=0) + 1
    if np.prod(shape.astype(np.float64)) > MOST_CELLS:
        return level
    opaque = np.zeros(shape, bool)
    place = tuple((cells - low).T)
    opaque[place] = depth > OPAQUE_DEPTH
    # kernels reach a side beyond a block: first 1 + 1 voxels, then 2 and 4 more
    for shift in (1, 1, 2, 4):
        for axis in range(3):
            ahead, back = [slice(None)] * 3, [slice(None)] * 3
            ahead[axis], back[axis] = slice(shift, None), slice(None, -shift)
            # beyond the ends there is nothing
            before, behind = np.zeros_like(opaque), np.zeros_like(opaque)
            before[tuple(ahead)], behind[tuple(back)] = opaque[tuple(back)], opaque[tuple(ahead)]
            opaque = opaque & before & behind
        level += opaque[place]
    # the first shift alone buries no block
    return np.maximum(level, 1) - 1


@dataclass(frozen=True, eq=False)
class VoxelBlocks:
    """Blocks of voxels in Morton order. order [N]: that sorts the voxels. starts: of blocks in that order, by level
    from 1; parents: number of the block twice as large; cost: of joining per saved splat.
    """

    order: np.ndarray
    starts: list[np.ndarray]
    parents: list[np.ndarray]
    cost: list[np.ndarray]

    @classmethod
    def of(cls, matter: Matter) -> VoxelBlocks:
        """The blocks of voxels, and the costs of joining them."""
        cells = np.rint(matter.position).astype(np.int64)
        key = _spread(cells[:, 0]) | (_spread(cells[:, 1]) << np.uint64(1)) | (_spread(cells[:, 2]) << np.uint64(2))
        order = np.argsort(key, kind="stable")
        key = key[order]
        opacity = -np.expm1(-matter.depth)
        buried = (_buried(cells, matter.depth) if len(cells) else np.zeros(0, np.uint8))[order]
        # what the eye sees of a voxel: its light, how it turns with the normal, its opacity
        lit = 0.7 * matter.color.mean(axis=1, keepdims=True) * matter.normal
        seen = (np.concatenate([matter.color, lit, np.ones((len(cells), 1))], axis=1) * opacity[:, None])[order]
        starts, sums, squares = [], [seen], [(seen * seen).sum(axis=1)]
        begins = np.arange(len(key))
        for level in range(1, LEVELS + 1):
            within = key >> np.uint64(3 * level)
            begin = np.flatnonzero(np.append(True, within[1:] != within[:-1])) if len(key) else begins
            groups = np.searchsorted(begins, begin)
            sums.append(np.add.reduceat(sums[-1], groups) if len(key) else sums[-1])
            squares.append(np.add.reduceat(squares[-1], groups) if len(key) else squares[-1])
            starts.append(begin)
            begins = begin
        parents = [np.searchsorted(starts[n + 1], starts[n], side="right") - 1 for n in range(LEVELS - 1)]
        cost = []
        for n in range(LEVELS):
            voxels = 8.0 ** (n + 1)
            spread = squares[n + 1] - (sums[n + 1] ** 2).sum(axis=1) / voxels
            saved = np.diff(np.append(starts[n], len(key))) - 1
            # kernels of blocks near surfaces reach beyond them, the larger the farther
            leaks = opacity[order] ** 2 * (buried <= n)
            leak = np.add.reduceat(leaks, starts[n]) if len(key) else spread
            spread = np.where(leak > 0, spread + LEAK * 2**n * leak, HIDDEN * spread)
            # equal blocks are told apart, so that some of them can be joined
            apart = (spread + 1e-9) * (1 + 0.01 * (np.arange(len(spread)) * 0.618034 % 1))
            cost.append(np.where(saved > 0, apart, np.inf) / np.maximum(saved, 1))
        return cls(order, starts, parents, cost)

    def chosen(self, limit: float) -> list[np.ndarray]:
        """bool by level: the blocks that are joined, of which none is within another."""
        covered = self.cost[-1] <= limit
        found = [covered]
        for level in range(LEVELS - 2, -1, -1):
            within = covered[self.parents[level]]
            join = self.cost[level] <= limit
            found.insert(0, join & ~within)
            covered = join | within
        return found

    def count(self, limit: float) -> int:
        """Number of splats."""
        joined = self.chosen(limit)
        members = [
            np.diff(np.append(start, len(self.order)))[join] for start, join in zip(self.starts, joined, strict=True)
        ]
        return len(self.order) - sum(int((each - 1).sum()) for each in members)

    def joined(self, matter: Matter, limit: float) -> Matter:
        """The matter with these blocks joined."""
        number, size = np.full(len(self.order), -1), np.zeros(len(self.order), np.uint8)
        count = 0
        for level, (start, join) in enumerate(zip(self.starts, self.chosen(limit), strict=True), 1):
            members = np.diff(np.append(start, len(self.order)))
            names = np.where(join, np.cumsum(join) - 1 + count, -1)
            name = np.repeat(names, members)
            number[name >= 0], size[name >= 0] = name[name >= 0], level
            count += int(join.sum())
        alone = number < 0
        number[alone] = count + np.arange(int(alone.sum()))
        total = count + int(alone.sum())
        index = self.order
        depth, position = matter.depth[index], matter.position[index]
        side = np.zeros(total, np.uint8)
        side[number] = size
        sides = 2.0**side
        mean = _ray_depth(np.rint(position).astype(np.int64), depth, number, size, sides)
        opacity = -np.expm1(-depth)
        share = np.bincount(number, opacity, total)

        def average(array: np.ndarray) -> np.ndarray:
            columns = [np.bincount(number, opacity * column, total) / share for column in array.T]
            return np.stack(columns, axis=1)

        # both sides of a surface are lit alike: normals are turned to that of the densest voxel
        normal, densest = matter.normal[index], np.zeros(total, np.int64)
        by_depth = np.argsort(depth, kind="stable")
        densest[number[by_depth]] = by_depth
        turned = normal * np.where((normal * normal[densest[number]]).sum(axis=1) < 0, -1.0, 1.0)[:, None]
        turned = average(turned)
        length = np.linalg.norm(turned, axis=1, keepdims=True)
        turned /= np.where(length > 1e-3, length, np.inf)
        values = None
        if matter.values is not None:
            member = matter.values[index]
            values = average(member[:, None])[:, 0]
            # a mean of two kinds of matter may be transparent
            depths = np.interp(
                values, np.linspace(matter.layer.low, matter.layer.high, CLASSES), matter.layer.table[:, 3]
            )
            values = np.where(depths < 0.5 * mean, member[densest], values)
        return Matter(matter.layer, average(position), mean, average(matter.color[index]), turned, values, side)


def _ray_depth(
    cells: np.ndarray, depth: np.ndarray, number: np.ndarray, size: np.ndarray, sides: np.ndarray
) -> np.ndarray:
    """Depth per voxel [blocks] of the mean opacity of the rays through each block along the axes."""
    side = 1 << size.astype(np.int64)
    first = np.concatenate([[0], np.cumsum((sides * sides).astype(np.int64))])
    block = np.repeat(np.arange(len(sides)), np.diff(first))
    total = np.zeros(len(sides))
    within = cells % side[:, None]
    for axis in range(3):
        one, two = (within[:, other] for other in range(3) if other != axis)
        column = np.bincount(first[number] + one * side + two, depth, first[-1])
        through = np.bincount(block, np.exp(-column), len(sides)) / (sides * sides)
        total -= np.log(np.maximum(through, 2.0**-24)) / sides
    return total / 3


def join_matter(matters: Sequence[Matter], most: int) -> list[Matter]:
    """The layers in at most `most` splats together. Raises InputError if there are more, as of points."""
    fixed = sum(len(matter) for matter in matters if not matter.joinable)
    voxels = [matter for matter in matters if matter.joinable and len(matter)]
    least = fixed + sum(matter.blocks.count(np.inf) for matter in voxels)
    if sum(map(len, matters)) <= most:
        return list(matters)
    if least > most:
        raise expected("splats", f"at least {least:,}, as the scene has them after joining all blocks", f"{most:,}")
    low, high = -60.0, 40.0
    for _ in range(24):
        middle = (low + high) / 2
        fits = fixed + sum(matter.blocks.count(2.0**middle) for matter in voxels) <= most
        low, high = (low, middle) if fits else (middle, high)
    # the widest search ends at all blocks
    return [matter.joined(2.0**high if high < 40 else np.inf) if len(matter) else matter for matter in matters]


@dataclass(frozen=True, eq=False)
class QuantizedSplats:
    """words uint32 [N, 4]: splats in row order (z, y, x) of their positions, as shaders/quantized_records.glsl reads
    them. step: of positions, in cells of the grid. found: number of splats before any were joined.
    """

    words: np.ndarray
    grid: Grid
    step: float
    layers: tuple[QuantizedLayer, ...]
    found: int = 0

    @classmethod
    def of(cls, matters: Sequence[Matter], grid: Grid, most: int, bits: int = 8) -> QuantizedSplats:
        """The splats of layers on a grid, at most `most`; bits: of values."""
        if len(matters) > MOST_LAYERS:
            raise expected("layers", f"at most {MOST_LAYERS} in a page", len(matters))
        found, matters = sum(map(len, matters)), join_matter(matters, most)
        reach = max((float(matter.position.max(initial=0.0)) for matter in matters), default=0.0)
        fine = all(matter.joinable for matter in matters)
        step = 1 / STEPS if fine else max(reach, 1.0) / 65535
        if reach / step > 65535:
            raise expected("grid", f"at most {65535 // STEPS:,} voxels along each axis", f"{reach:,.0f}")
        words = np.concatenate(
            [np.zeros((0, 4), np.uint32), *(_words(m, n, step, bits) for n, m in enumerate(matters))]
        )
        x, y, z = (words[:, 0] & 0xFFFF, words[:, 0] >> 16, words[:, 1] & 0xFFFF)
        return cls(words[np.lexsort((x, y, z))], grid, step, tuple(matter.layer for matter in matters), found)

    def __len__(self) -> int:
        return len(self.words)

    @property
    def positions(self) -> np.ndarray:
        """[N, 3]: (x, y, z) in cells of the grid."""
        w = self.words
        return np.stack([w[:, 0] & 0xFFFF, w[:, 0] >> 16, w[:, 1] & 0xFFFF], axis=1) * self.step

    @property
    def outline(self) -> Splats:
        """Splats at the corners of the box of all, for plans."""
        position = self.positions
        corners = corners_of(position.min(axis=0, initial=0.0), position.max(axis=0, initial=0.0))
        corners = corners[np.lexsort(corners.T)]
        records = np.zeros(len(corners), POINT)
        records["position"], records["optical_depth"] = corners, 1.0
        # one normal that is not zero: the layers are shaded
        shaded = bool((self.words[:, 2] & 0xFFFF).any())
        return assemble(records, np.rint(corners).astype(np.int64), self.grid, self.grid.mean_spacing, "page", shaded)

    def back_to_front(self, eye: np.ndarray, axis: int) -> np.ndarray:
        """Order [N] of the splats seen from a place (x, y, z) in cells, ±∞ for parallel views: along each axis from
        both ends to the eye, plane by plane across `axis`. A page walks sorted rows, and sorts nothing for a view.
        """
        position = self.positions
        # what is beyond the eye follows what is before it, in the opposite order
        keys = [np.where(column <= at, column, 2e6 - column) for column, at in zip(position.T, eye, strict=True)]
        numbers = np.where(position[:, int(axis == 0)] <= eye[int(axis == 0)], 1, -1) * np.arange(len(position))
        return np.lexsort([numbers, *(keys[other] for other in range(3) if other != axis), keys[axis]])

    @property
    def sizes(self) -> np.ndarray:
        """[N]: sides of the splats, voxels."""
        return 2.0 ** ((self.words[:, 2] >> 24) & 7)

    @property
    def normals(self) -> np.ndarray:
        """[N, 3]: unit normals, or zeros."""
        return octahedral_normal(self.words[:, 2] & 0xFFFF)

    def classified(self) -> tuple[np.ndarray, np.ndarray]:
        """Linear RGB [N, 3], and optical depth [N] per mean spacing."""
        w = self.words
        layer, place = w[:, 2] >> 27, (w[:, 1] >> 16) / 65535 * (CLASSES - 1)
        entry = np.minimum(place.astype(np.int64), CLASSES - 2)
        tables = np.stack([layer.table for layer in self.layers])
        part = (place - entry)[:, None]
        matter = tables[layer, entry] * (1 - part) + tables[layer, entry + 1] * part
        own = np.stack([(w[:, 3] >> shift) & 0xFF for shift in (0, 8, 16)], axis=1) / 255
        color = np.where((w[:, 3] >> 24)[:, None] > 0, linear_from_srgb(own), matter[:, :3])
        share = 2.0 ** ((SHARE_ONE - ((w[:, 2] >> 16) & 0xFF).astype(np.float64)) / SHARE_STEPS)
        return color, matter[:, 3] * share

    def packed(self) -> tuple[bytes, list[list[int]]]:
        """Deflated planes of bytes, and for each of the 16 bytes of a splat: [0, value] of all splats, [1, the earlier
        byte it equals] or [2, its number among the planes]. Positions are differences from the splat before.
        """
        halves = self.words.astype("<u4").view("<u2").reshape(-1, 8).copy()
        halves[1:, [0, 1, 2]] -= halves[:-1, [0, 1, 2]].copy()
        planes, about, kept = halves.view(np.uint8).T, list[list[int]](), list[bytes]()
        for number, plane in enumerate(planes):
            twin = next((n for n in range(number) if about[n][0] == 2 and (planes[n] == plane).all()), None)
            if not len(plane) or (plane == plane[0]).all():
                about.append([0, int(plane[0]) if len(plane) else 0])
            elif twin is not None:
                about.append([1, twin])
            else:
                about.append([2, len(kept)])
                kept.append(plane.tobytes())
        return zlib.compress(b"".join(kept)), about


def _words(matter: Matter, number: int, step: float, bits: int) -> np.ndarray:
    """The words uint32 [N, 4] of a layer."""
    layer = matter.layer
    x, y, z = np.rint(matter.position / step).astype(np.uint32).T
    if matter.values is None:
        value = np.full(len(matter), 65535, np.uint32)
    else:
        most = 2**bits - 1
        share = np.clip((matter.values - layer.low) / (layer.high - layer.low), 0, 1)
        value = (np.rint(share * most) * (65535 // most)).astype(np.uint32)
    table = np.interp(value / 65535, np.linspace(0, 1, CLASSES), layer.table[:, 3])
    octaves = np.log2(np.maximum(matter.depth, 1e-30) / np.maximum(table, 1e-30))
    code = np.clip(np.rint(SHARE_ONE - SHARE_STEPS * octaves), 0, 255).astype(np.uint32)
    size = np.zeros(len(matter), np.uint32) if matter.size is None else matter.size.astype(np.uint32)
    normal = _octahedral(matter.normal)
    color = np.zeros(len(matter), np.uint32)
    if layer.own:
        r, g, b = np.rint(srgb_from_linear(np.clip(matter.color, 0, 1)) * 255).astype(np.uint32).T
        color = r | g << 8 | b << 16 | 1 << 24
    return np.stack(
        [x | y << 16, z | value << 16, normal | code << 16 | size << 24 | np.uint32(number) << 27, color], axis=1
    )


def _octahedral(normal: np.ndarray) -> np.ndarray:
    """Two bytes uint32 [N] of unit vectors [N, 3]; 0 of zeros."""
    size = np.abs(normal).sum(axis=1, keepdims=True)
    n = normal / np.where(size > 0, size, 1)
    x, y = n[:, 0], n[:, 1]
    folded = [(1 - np.abs(b)) * np.where(a >= 0, 1, -1) for a, b in ((x, y), (y, x))]
    place = np.where(n[:, 2:] >= 0, n[:, :2], np.stack(folded, axis=1))
    one, two = np.rint(place * 127 + 128).astype(np.uint32).T
    return np.where(size[:, 0] > 0, one | two << 8, 0).astype(np.uint32)


def octahedral_normal(code: np.ndarray) -> np.ndarray:
    """Unit vectors [N, 3] of two bytes [N]; zeros of 0."""
    f = (np.stack([code & 0xFF, code >> 8], axis=1).astype(np.float64) - 128) / 127
    n = np.concatenate([f, 1 - np.abs(f).sum(axis=1, keepdims=True)], axis=1)
    t = np.maximum(-n[:, 2], 0)[:, None]
    n[:, :2] += np.where(n[:, :2] >= 0, -t, t)
    return np.where((code == 0)[:, None], 0.0, n / np.linalg.norm(n, axis=1, keepdims=True))
