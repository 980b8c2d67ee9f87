"""One walk along rays in float64: of depth maps and picks, through the layers that pictures show, and of pictures of
fields, in slabs of equal thickness. Rays skip blocks of cells without visible values.

Between two points of a ray through layers, at most 1/STEPS voxel apart, values are linear, or where they turn a
parabola: all values between are classified, iso-surfaces between are crossed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np

from splatgl.data.mesh import Mesh
from splatgl.errors import expected
from splatgl.geometry.camera import Camera
from splatgl.geometry.clipping import Clip
from splatgl.geometry.grid import ranges
from splatgl.geometry.mask_field import MaskField, clip_to_mask
from splatgl.geometry.view import GridView
from splatgl.planning.culling import clip_behind_eye
from splatgl.planning.resolve import draws_boxes, kernel_name, select_splats
from splatgl.planning.scene import Scene
from splatgl.reference.layers import crossings
from splatgl.reference.rays import Bounds, Pixels, Rays, index_rays, pixel_slopes
from splatgl.reference.sheets import mean_classes
from splatgl.splat.kernels import BOX, Kernel
from splatgl.splat.kernels import kernel as kernel_named
from splatgl.splat.settings import Settings
from splatgl.splat.splats import Splats
from splatgl.transfer.preintegration import ClassIntegral, ValueClassifier
from splatgl.transfer.regions import crossed_depth

# points whose sums stay in the cache
POINTS = 1 << 13
# cells along the sides of blocks that rays skip
BLOCK = 4
# empty entries around splats on their lattice: any cell that a kernel reaches from outside has entries
PAD = 3
# entries of the table of a kernel over squared distances, and the largest squared distance
ENTRIES, FURTHEST = 1 << 18, 13.0


class LatticeTerms:
    """Terms of splats on their lattice, 0 where no splat is, and the kernel that weighs them. low [3]: grid position
    (x, y, z) of the first entry; shape: entries along z, y, x.

    is_exact: terms float64 [N + 1] of N splats, which `index` finds, and the last for entries without one; else those
    float32 of all entries, weighted by a table of the kernel, which is faster. Without a kernel: boxes.
    """

    def __init__(
        self, positions: np.ndarray, terms: Sequence[np.ndarray | float], kernel: Kernel | None, is_exact: bool = False
    ) -> None:
        cells = np.rint(positions).astype(np.int64)
        ends = cells if len(cells) else np.zeros((1, 3), np.int64)
        self.low = ends.min(axis=0) - PAD
        self.shape = tuple((ends.max(axis=0) + PAD + 1 - self.low)[::-1].tolist())
        self.kernel, self.real, self.scale = kernel, np.float64 if is_exact else np.float32, 1.0
        x, y, z = (cells - self.low).T
        self.index = np.full(self.shape, len(cells), np.int32) if is_exact else None
        if self.index is not None:
            self.index[z, y, x] = np.arange(len(cells))
            self.terms = [np.append(np.broadcast_to(term, len(cells)), 0.0) for term in terms]
            return
        self.terms = [np.zeros(self.shape, np.float32) for _ in terms]
        for array, term in zip(self.terms, terms, strict=True):
            array[z, y, x] = term
        if kernel is not None:
            self.scale = ENTRIES / FURTHEST
            middles = (np.arange(ENTRIES) + 0.5) * (FURTHEST / ENTRIES)
            self.table = np.asarray(kernel.value(np.sqrt(middles)), np.float32)

    @property
    def held(self) -> np.ndarray:
        """bool [Z, Y, X]: where splats are."""
        return self.terms[0] > 0 if self.index is None else self.index < len(self.terms[0]) - 1

    def _axes(self, places: np.ndarray) -> Iterator[tuple[np.ndarray, int, int]]:
        return zip(places, self.low.tolist(), self.shape[::-1], strict=True)

    def sums(self, places: np.ndarray) -> np.ndarray:
        """[n, P]: sums of the terms at grid positions [3, P], weighted by the kernel; of boxes, the terms around."""
        if self.kernel is None:
            x, y, z = (np.clip(np.rint(i).astype(np.int64) - a, 0, n - 1) for i, a, n in self._axes(places))
            return np.stack([term[z, y, x].astype(np.float64) for term in self.terms])
        result = np.empty((len(self.terms), places.shape[1]))
        for first in range(0, places.shape[1], POINTS):
            some = slice(first, first + POINTS)
            result[:, some] = self._sums(self.kernel, places[:, some])
        return result

    def _sums(self, kernel: Kernel, places: np.ndarray) -> np.ndarray:
        squares, cells, offsets, real = [], [], np.arange(-1, 3), self.real
        for place, low, size in self._axes(places):
            cell = np.clip(np.floor(place).astype(np.int64) - low, 1, size - 3)
            apart = (place - (cell + low)).astype(real) - offsets[:, None].astype(real)
            squares.append(np.minimum(apart * apart, real(4)) * real(self.scale))
            cells.append(cell)
        _, height, width = self.shape
        first = (cells[2] * height + cells[1]) * width + cells[0] + offsets[:, None]
        totals = np.zeros((len(self.terms), places.shape[1]), real)
        flat = [term.ravel() for term in self.terms]
        for k, j in np.ndindex(4, 4):
            square = squares[0] + (squares[1][j] + squares[2][k])
            entry = first + (offsets[k] * height + offsets[j]) * width
            # modes other than "raise" are faster; all entries exist
            if self.index is None:
                weight = self.table.take(square.astype(np.int64), mode="clip")
            else:
                weight, entry = kernel.value(np.sqrt(square)), self.index.take(entry, mode="clip")
            for total, term in zip(totals, flat, strict=True):
                total += np.einsum("cp,cp->p", weight, term.take(entry, mode="clip"))
        return totals


@dataclass(frozen=True, eq=False)
class CurrentExtreme:
    """Values [P] that rays must exceed, times a sign: 1 for the largest values, −1 for the least, 0: no block of cells
    is known not to.
    """

    value: np.ndarray
    sign: float


@dataclass(frozen=True, eq=False)
class Blocks:
    """Blocks of BLOCK cells along the sides. low [3]: grid position (x, y, z) of the first of `shape` cells along z, y,
    x. visible [Z, Y, X]: whether blocks have anything visible; least, most [Z, Y, X]: bounds of the values at points in
    them.
    """

    low: np.ndarray
    shape: tuple[int, ...]
    visible: np.ndarray
    least: np.ndarray
    most: np.ndarray

    def free(
        self, places: np.ndarray, along: np.ndarray, step: np.ndarray, limit: np.ndarray | None = None, sign: float = 1
    ) -> np.ndarray:
        """Depths [N] up to the ends of blocks without anything visible, or whose values times `sign` do not exceed
        `limit` [N], and SLIGHTLY of a step [N] more; 0 elsewhere. places, along [3, N]: grid positions, and per depth.
        """
        place = places - self.low[:, None]
        block = np.clip(np.floor(place), 0, np.array(self.shape)[::-1, None] - 1).astype(np.int64) // BLOCK
        x, y, z = block
        if limit is None:
            is_empty = ~self.visible[z, y, x]
        else:
            is_empty = (self.most[z, y, x] if sign > 0 else -self.least[z, y, x]) <= limit
        some, free = np.flatnonzero(is_empty), np.zeros(len(step))
        along = along[:, some]
        ends = np.where(along > 0, block[:, some] + 1, block[:, some]) * float(BLOCK)
        with np.errstate(divide="ignore", invalid="ignore"):
            out = np.where(along == 0, np.inf, (ends - place[:, some]) / along).min(axis=0)
        # slightly beyond the end of the block
        free[some] = np.maximum(out, 0.0) + SLIGHTLY * step[some]
        return free


def block_extremes(extreme: np.ufunc, array: np.ndarray) -> np.ndarray:
    """Extremes of an array of cells over blocks of BLOCK cells along the sides and the blocks beside them."""
    for axis, size in enumerate(array.shape):
        array = extreme.reduceat(array, np.arange(0, size, BLOCK), axis=axis)
    for axis in range(3):
        padded = np.pad(array, [(int(n == axis),) * 2 for n in range(3)], mode="edge")
        array = extreme.reduce([padded.take(range(k, k + array.shape[axis]), axis) for k in range(3)])
    return np.asarray(array, np.float64)


@dataclass(frozen=True, eq=False)
class ValueMatter:
    """Values, and magnitudes of gradients per world length where opacity depends on them, that are classified after
    reconstruction: means of kernels.
    """

    cells: LatticeTerms
    post: ValueClassifier
    spacing: float
    unit: float

    @classmethod
    def of(cls, splats: Splats, some: np.ndarray | slice) -> Self:
        """Of some splats."""
        assert splats.post is not None
        records, post = splats.records[some], splats.post
        gradient = [*records["gradient"].T] if post.transfer.needs_gradients else list[np.ndarray]()
        cells = LatticeTerms(records["position"], [1.0, records["value"], *gradient], kernel_named(post.kernel))
        return cls(cells, post, splats.grid.mean_spacing, splats.unit)

    def at(self, places: np.ndarray) -> np.ndarray:
        """States [1 or 2, P]: value, and magnitude of the gradient."""
        mass, *sums = self.cells.sums(places)
        mass[mass == 0] = np.nan
        states = [self.post.value(sums[0] / mass)]
        if len(sums) > 1:
            states.append(np.linalg.norm(sums[1:], axis=0) / mass * (self.post.span / self.spacing))
        return np.stack(states)

    @cached_property
    def _extinction(self) -> ClassIntegral:
        whole = self.post.integral
        parts = {name: getattr(whole, name)[:, 3:] for name in ("below", "low", "high", "outside")}
        return replace(whole, **parts)

    @cached_property
    def _surfaces(self) -> tuple[np.ndarray, np.ndarray]:
        values, matter = self.post.surfaces
        return self.post.value(values), matter[:, 3]

    def between(self, first: np.ndarray, last: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Of points without a value, the value is that of the other end."""
        first, last = np.where(np.isnan(first), last, first), np.where(np.isnan(last), first, last)
        known, transfer = np.isfinite(first[0]), self.post.transfer
        first, last = (np.where(known, state, 0.0) for state in (first, last))
        mean = mean_classes(self._extinction, transfer, (first, last))[:, 0]
        crossed = crossed_depth(*self._surfaces, first[0], last[0]) if transfer.iso else np.zeros(len(known))
        return np.where(known, mean / self.unit, 0.0), np.where(known, crossed, 0.0)

    def opacity(self, values: np.ndarray) -> np.ndarray:
        """By the transfer function."""
        return self.post.transfer.opacity(values)

    def visible_blocks(self) -> Blocks:
        """By all values between the coefficients around."""
        is_there, value = self.cells.held, self.post.value(self.cells.terms[1])
        low = block_extremes(np.minimum, np.where(is_there, value, np.inf))
        high = block_extremes(np.maximum, np.where(is_there, value, -np.inf))
        some = low <= high
        if not self.post.transfer.regions:
            ends = np.stack([low[some], high[some]])[:, None]
            # surfaces lie between two values, too
            ungraded = self.post.with_transfer(replace(self.post.transfer, gradient=()))
            some[some] = sum(replace(self, post=ungraded).between(*ends)) > 0
        return Blocks(self.cells.low, self.cells.shape, some, low, high)


@dataclass(frozen=True, eq=False)
class VoxelMatter:
    """Extinctions per world length of voxels that are classified before reconstruction: sums of kernels, or those of
    the boxes of labels.
    """

    cells: LatticeTerms
    unit: float

    @classmethod
    def of(cls, splats: Splats, some: np.ndarray | slice, kernel: Kernel) -> Self:
        """Of some splats."""
        records = splats.records[some]
        terms = [records["optical_depth"] / splats.grid.mean_spacing]
        return cls(LatticeTerms(records["position"], terms, None if kernel is BOX else kernel), splats.unit)

    def at(self, places: np.ndarray) -> np.ndarray:
        """States [1, P]: extinction."""
        return self.cells.sums(places)

    def between(self, first: np.ndarray, last: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Means; there are no surfaces."""
        return (first[0] + last[0]) / 2, np.zeros(first.shape[1])

    def opacity(self, values: np.ndarray) -> np.ndarray:
        """Of extinctions, over the reference length."""
        return -np.expm1(-values * self.unit)

    def visible_blocks(self) -> Blocks:
        """Where a voxel is."""
        is_visible = block_extremes(np.maximum, self.cells.terms[0]) > 0
        # sums of kernels may exceed all voxels
        most = np.where(is_visible, np.inf, 0.0)
        return Blocks(self.cells.low, self.cells.shape, is_visible, np.zeros(most.shape), most)


# points of a ray per voxel, and of a single ray; points of all rays that are evaluated together, of a ray at least
STEPS, FINE, TOGETHER, LEAST = 2, 16, 1 << 16, 8
# parts into which a decisive step is divided, and how often
PARTS, TIMES = 8, 3
# pixels up to which only splats beside their rays are taken, and no blocks are looked for
FEW = 16
# share of a step by which rays pass the end of a block
SLIGHTLY = 1e-6
# opacity of an opaque surface: its optical depth exceeds that of any share
OPAQUE = 1 - 1e-12


def fields_of(
    scene: Scene, camera: Camera, settings: Settings, pixels: np.ndarray, what: str
) -> list[tuple[int, LayerField]]:
    """The density of the visible layers of a scene along the rays of pixels, with the numbers of these layers. Raises
    InputError, which says `what` needs it, for clouds of points and volumes that are read in parts.
    """
    scene.require_voxels(what)
    for layer in scene.shown:
        if not isinstance(layer.volume.samples, np.ndarray):
            fix = "draw a coarser --level, or a part of it"
            name = layer.volume.name or "volume"
            raise expected(name, f"samples in memory or mapped, for a {what}", "some that are read in parts", fix)
    fields = []
    for number, (splats, planes) in enumerate(zip(scene.splats(settings), scene.planes, strict=True)):
        field = LayerField.of(splats, camera, replace(settings, clip=(*settings.clip, *planes)), pixels)
        if field is not None:
            fields.append((number, field))
    return fields


@dataclass(frozen=True, eq=False)
class LayerField:
    """The density of a layer. splats: those of its picture. clip, mask: of its rays; None for voxels classified before
    reconstruction, which are whole. steps: points of a ray per voxel.
    """

    splats: Splats
    kernel: Kernel
    clip: Clip | None
    steps: int
    matter: ValueMatter | VoxelMatter

    @classmethod
    def of(cls, splats: Splats, camera: Camera, settings: Settings, pixels: np.ndarray) -> Self | None:
        """The density along the rays of pixels; None without any. settings: with the layer's clip planes."""
        chosen = clip_behind_eye(select_splats(splats, settings, False, camera), camera)
        if not len(chosen):
            return None
        is_boxes = draws_boxes(chosen, settings, False)
        kernel = BOX if is_boxes else kernel_named(kernel_name(chosen, settings))
        clip = Clip.of(settings.clip, chosen.grid) if is_boxes or chosen.post is not None else None
        some: np.ndarray | slice = slice(None)
        if len(pixels) <= FEW:
            some = _beside(chosen, _ray_ends(chosen, kernel, clip, camera, pixels))
            if not len(some):
                return None
        steps = FINE if len(pixels) <= FEW else STEPS
        if chosen.post is not None:
            return cls(chosen, kernel, clip, steps, ValueMatter.of(chosen, some))
        return cls(chosen, kernel, clip, steps, VoxelMatter.of(chosen, some, kernel))

    @cached_property
    def blocks(self) -> Blocks:
        """Blocks of cells that rays may skip."""
        return self.matter.visible_blocks()

    @property
    def mask(self) -> MaskField | None:
        """The mask of its rays."""
        return self.splats.mask if self.splats.post is not None else None

    @property
    def is_boxes(self) -> bool:
        """Whether the layer is drawn as boxes of labels."""
        return self.kernel is BOX

    def along(self, camera: Camera, pixels: np.ndarray) -> LayerRays:
        """The layer along the rays of pixels."""
        ends = _ray_ends(self.splats, self.kernel, self.clip, camera, pixels)
        return LayerRays(self, *ends, ray_lengths(camera, pixels))


def _ray_ends(
    splats: Splats, kernel: Kernel, clip: Clip | None, camera: Camera, pixels: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """start, along [3, P]: grid positions of rays at depth 0, and per eye-space depth; near, far [P]: depths between
    which they are near splats, equal if nowhere.
    """
    view = GridView.of(splats.grid, camera, kernel, antialias=False)
    start, direction, _ = index_rays(view, pixel_slopes(pixels, camera, view.pitch))
    reach = 0.5 if kernel is BOX else kernel.radius
    low, high = splats.index_bounds + np.array([[-reach], [reach]])
    if splats.post is not None:
        low, high = np.maximum(low, -0.5), np.minimum(high, np.array(splats.post.shape) - 0.5)
    near, far, _ = Bounds(low, high, clip).ends(start, direction)
    spacing = splats.grid.mean_spacing
    return start, direction / spacing, near * spacing, far * spacing


def _beside(splats: Splats, ends: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]) -> np.ndarray:
    """Numbers of the splats whose kernels may reach rays; ends: as of `_ray_ends`."""
    start, along, near, far = ends
    length = np.linalg.norm(along, axis=0) * (far - near)
    count = int(np.ceil(length.max(initial=0.0))) + 1
    places = start[:, None] + along[:, None] * (near + (far - near) * (np.arange(count + 1) / count)[:, None])
    x, y, z = np.rint(places.reshape(3, -1)[:, np.repeat(length[None] > 0, count + 1, axis=0).ravel()]).astype(np.int64)
    # a kernel, and half a voxel to the nearest of these places
    around = np.arange(-PAD, PAD + 1)
    low, size = splats.index_bounds.astype(np.int64)[0] - PAD, int(np.ptp(splats.index_bounds[:, 1])) + 4 * PAD
    row_keys = (splats.row_z - low[2]) * np.int64(size) + splats.row_y - low[1]
    keys = ((z - low[2])[:, None, None] + around[:, None]) * size + (y - low[1])[:, None, None] + around
    wanted, row = np.unique(keys, return_inverse=True)
    first, last = np.full(len(wanted), np.iinfo(np.int64).max), np.full(len(wanted), np.iinfo(np.int64).min)
    beside = np.broadcast_to(x[:, None, None], keys.shape).ravel()
    np.minimum.at(first, row.ravel(), beside)
    np.maximum.at(last, row.ravel(), beside)
    found = np.searchsorted(row_keys, wanted)
    some = np.flatnonzero(row_keys[np.minimum(found, len(row_keys) - 1)] == wanted)
    rows = found[some]
    count_in = np.diff(splats.row_start)[rows]
    members, cell = ranges(splats.row_start[rows], count_in), np.repeat(some, count_in)
    at = splats.cell_x[members]
    return np.asarray(members[(at >= first[cell] - PAD) & (at <= last[cell] + PAD)])


Pair = tuple[np.ndarray, np.ndarray]


@dataclass(frozen=True, eq=False)
class LayerRays:
    """A layer along rays. start, along [3, P]: grid positions at depth 0, and per eye-space depth; near, far [P]:
    depths between which a ray is in the layer, equal if nowhere; length [P]: of a ray, per depth.
    """

    layer: LayerField
    start: np.ndarray
    along: np.ndarray
    near: np.ndarray
    far: np.ndarray
    length: np.ndarray

    @cached_property
    def step(self) -> np.ndarray:
        """[P]: largest depth between two points of a ray."""
        return np.asarray(1 / (self.layer.steps * np.linalg.norm(self.along, axis=0)))

    def places(self, depth: np.ndarray, rays: np.ndarray) -> np.ndarray:
        """Grid positions [3, …, N] at depths […, N] of rays [N]."""
        axis = (slice(None), *[None] * (depth.ndim - 1))
        return np.asarray(self.start[:, rays][axis] + self.along[:, rays][axis] * depth)

    def states(self, depth: np.ndarray, rays: np.ndarray) -> np.ndarray:
        """[n, …, N]: states at depths […, N] of rays [N]."""
        states = self.layer.matter.at(self.places(depth, rays).reshape(3, -1))
        return states.reshape(len(states), *depth.shape)

    def until(self, depth: np.ndarray) -> LayerRays:
        """The rays up to depths [P]."""
        return replace(self, far=np.maximum(np.minimum(self.far, depth), self.near))

    def values(self, depth: np.ndarray, rays: np.ndarray) -> np.ndarray:
        """Values […, N] at depths […, N] of rays [N]; NaN outside the layer, and where the mask keeps nothing."""
        values = self.states(depth, rays)[0]
        gone = (depth < self.near[rays]) | (depth > self.far[rays]) | (self.far <= self.near)[rays]
        if self.layer.mask is not None:
            at = self.layer.mask.at(self.places(depth, rays).reshape(3, -1)).reshape(depth.shape)
            gone |= at < 0
        return np.where(gone, np.nan, values)

    def passed(self, ends: np.ndarray, rays: np.ndarray) -> np.ndarray:
        """Optical depths [K, N] between depths [K + 1, N] of rays [N]."""
        passed = np.zeros((len(ends) - 1, len(rays)))
        some = np.flatnonzero((ends[-1] > self.near[rays]) & (ends[0] < self.far[rays]))
        ends, rays = ends[:, some], rays[some]
        if self.layer.is_boxes:
            ends = np.clip(ends, self.near[rays], self.far[rays])
            # a step is within a voxel
            first = self.states((ends[:-1] + ends[1:]) / 2, rays)
            depths, states, turns = (ends[:-1], ends[1:]), (first, first), None
        else:
            depths, states, turns = self._pieces(ends, rays)
        length = np.maximum(depths[1] - depths[0], 0.0)
        mean, crossed = self._between(depths, states, turns, rays)
        passed[:, some] = mean * length * self.length[rays] + np.where(length > 0, crossed, 0.0)
        return passed

    def _pieces(self, ends: np.ndarray, rays: np.ndarray) -> tuple[Pair, Pair, np.ndarray | None]:
        """Depths [K, N] at the begin and the end of pieces between depths [K + 1, N] of rays [N], within the layer and
        its mask; the states [n, K, N] there; and whether values may have an extreme within, bool [K, N].
        """
        # one more on either side tells where values turn
        ends = np.concatenate([2 * ends[:1] - ends[1:2], ends, 2 * ends[-1:] - ends[-2:-1]])
        ends = np.clip(ends, self.near[rays], self.far[rays])
        states = self.states(ends, rays)
        rise = np.diff(states[0], axis=0)
        turns = (rise[:-2] * rise[1:-1] < 0) | (rise[1:-1] * rise[2:] < 0)
        ends, states = ends[1:-1], states[:, 1:-1]
        (first, last), (begin, end) = ((all_[..., :-1, :], all_[..., 1:, :]) for all_ in (states, ends))
        if self.layer.mask is not None:
            kept = self.layer.mask.at(self.places(ends, rays).reshape(3, -1)).reshape(ends.shape)
            low, high = clip_to_mask((kept[:-1], kept[1:]), (begin, end))
            slope = (last - first) / np.where(end > begin, end - begin, 1.0)
            turns &= (low == begin) & (high == end)
            first, last, begin, end = first + slope * (low - begin), last + slope * (high - end), low, high
        return (begin, end), (first, last), turns

    def _between(self, depths: Pair, states: Pair, turns: np.ndarray | None, rays: np.ndarray) -> Pair:
        """Mean extinctions and optical depths [K, N] of iso-surfaces of pieces of rays [N], as of `_pieces`. Where
        values turn, they are a parabola, whose two branches count.
        """
        matter, shape = self.layer.matter, depths[0].shape
        ends = [state.reshape(len(state), -1) for state in states]
        mean, crossed = matter.between(*ends)
        if turns is not None and turns.any():
            step, ray = np.nonzero(turns)
            some = step * shape[1] + ray
            first, last = (state[:, some] for state in ends)
            middle = self.states((depths[0][step, ray] + depths[1][step, ray]) / 2, rays[ray])
            middle = np.where(np.isnan(middle), (first + last) / 2, middle)
            slope, bend = 4 * middle - 3 * first - last, 2 * (first + last - 2 * middle)
            share = np.clip(-slope[0] / np.where(bend[0] == 0, 1.0, 2 * bend[0]), 0.0, 1.0)
            top = first + slope * share + bend * share**2
            branches = matter.between(first, top), matter.between(top, last)
            mean[some] = branches[0][0] * share + branches[1][0] * (1 - share)
            crossed[some] = branches[0][1] + branches[1][1]
        return mean.reshape(shape), crossed.reshape(shape)

    def stops(self, begin: np.ndarray, end: np.ndarray, rays: np.ndarray) -> np.ndarray:
        """Depths [n, N] between begin and end [N] at which rays [N] enter other voxels of labels."""
        if not self.layer.is_boxes:
            return np.zeros((0, len(rays)))
        start, along = self.start[:, rays], self.along[:, rays]
        ends = np.sort(np.stack([start + along * begin, start + along * end]), axis=0)
        most = int(np.ceil((ends[1] - ends[0]).max(initial=0.0))) + 1
        face = np.ceil(ends[0] - 0.5) + 0.5 + np.arange(most)[:, None, None]
        with np.errstate(divide="ignore", invalid="ignore"):
            depth = np.where(face <= ends[1], (face - start) / along, end)
        return np.asarray(np.clip(np.nan_to_num(depth, nan=np.inf).reshape(-1, len(rays)), begin, end))

    def free(self, depth: np.ndarray, rays: np.ndarray, best: CurrentExtreme | None) -> np.ndarray:
        """Depth [N] to pass until something may be visible from depths [N] of rays [N] on: infinite behind the layer.

        best: values that must be exceeded; None: skips blocks without visible matter.
        """
        near, far = self.near[rays], self.far[rays]
        free = np.where(depth < near, near - depth, 0.0)
        if self.layer.steps == STEPS and (best is None or best.sign):
            exceeded = () if best is None else (best.value[rays], best.sign)
            at, along, step = self.places(depth, rays), self.along[:, rays], self.step[rays]
            free = np.where(depth < near, free, self.layer.blocks.free(at, along, step, *exceeded))
        return np.where(depth >= far, np.inf, free)


@dataclass(frozen=True, eq=False)
class SurfaceRays:
    """Meshes along rays. depth, thickness [P, n]: eye-space depths of crossings, nearest first, the last infinite, and
    optical depths; mesh [P, n]: their numbers. step [P]: depth before a crossing from which rays are followed.
    """

    depth: np.ndarray
    thickness: np.ndarray
    mesh: np.ndarray
    step: np.ndarray

    @classmethod
    def of(cls, meshes: Sequence[Mesh], camera: Camera, pixels: np.ndarray) -> Self | None:
        """Of meshes along the rays of pixels; None without any."""
        distance, light, mesh = crossings(meshes, camera, Pixels.of(camera.size, pixels), None)
        if distance.shape[1] == 1:
            return None
        depth = distance / ray_lengths(camera, pixels)[:, None]
        thickness = -np.log1p(-np.minimum(light[..., 3], OPAQUE))
        step = np.where(np.isfinite(depth[:, 0]), depth[:, 0], 1.0) / STEPS
        return cls(depth, thickness, mesh, step)

    @property
    def opaque(self) -> np.ndarray:
        """[P]: depths of the first opaque crossings; infinite without one."""
        limit = -np.log1p(-OPAQUE)
        return np.asarray(np.where(self.thickness >= limit, self.depth, np.inf).min(axis=1))

    def passed(self, ends: np.ndarray, rays: np.ndarray) -> np.ndarray:
        """Optical depths [K, N] between depths [K + 1, N] of rays [N], ends included."""
        passed = np.zeros((len(ends) - 1, len(rays)))
        for depth, thickness in zip(self.depth[rays].T, self.thickness[rays].T, strict=True):
            passed += thickness * ((ends[:-1] < depth) & (depth <= ends[1:]))
        return passed

    def stops(self, begin: np.ndarray, end: np.ndarray, rays: np.ndarray) -> np.ndarray:
        """Depths [n, N] of the crossings, not beyond begin and end [N]."""
        return np.clip(self.depth[rays].T, begin, end)

    def free(self, depth: np.ndarray, rays: np.ndarray, best: CurrentExtreme | None) -> np.ndarray:
        """Depth [N] to pass until the next crossing from depths [N] of rays [N] on: infinite behind all."""
        ahead = np.where(self.depth[rays] > depth[:, None], self.depth[rays], np.inf).min(axis=1) - depth
        # a step begins before its crossing
        return np.where(ahead < self.step[rays], 0.0, ahead - self.step[rays] / 2)


@dataclass(frozen=True, eq=False)
class NearCells:
    """Where matter may be: bool `near` [Z, Y, X] of the cells from `low` (x, y, z) on."""

    near: np.ndarray
    low: np.ndarray

    def at(self, places: np.ndarray) -> np.ndarray:
        """Cells of `near` [...] around grid positions [3, ...]."""
        axes = zip(places, self.low.tolist(), self.near.shape[::-1], strict=True)
        x, y, z = (np.clip(np.rint(i).astype(np.int64) - a, 0, n - 1) for i, a, n in axes)
        return np.asarray(self.near[z, y, x])

    @cached_property
    def blocks(self) -> Blocks:
        """Blocks of these cells."""
        is_near = block_extremes(np.maximum, self.near) > 0
        return Blocks(self.low, self.near.shape, is_near, is_near, is_near)


@dataclass(frozen=True, eq=False)
class SlabRays:
    """Rays of a picture, along which depth counts slabs. far [P]: their numbers; thickness [P]: theirs, index units."""

    rays: Rays
    cells: NearCells
    far: np.ndarray
    thickness: np.ndarray

    @classmethod
    def of(cls, rays: Rays, cells: NearCells, steps_per_voxel: int) -> SlabRays:
        """Rays in slabs of at most 1/steps_per_voxel of a grid step, of equal thickness along a ray."""
        far = np.ceil((rays.far - rays.near) * steps_per_voxel)
        return cls(rays, cells, far, (rays.far - rays.near) / np.maximum(far, 1))

    @property
    def step(self) -> np.ndarray:
        """[P]: a slab."""
        return np.ones(len(self.far))

    @property
    def length(self) -> np.ndarray:
        """[P]: lengths of slabs, mean spacings."""
        return self.thickness * self.rays.stretch

    def places(self, depth: np.ndarray, rays: np.ndarray) -> np.ndarray:
        """Grid positions [3, …, N] at depths […, N] of rays [N]."""
        axis = (slice(None), *[None] * (depth.ndim - 1))
        along = self.rays.near[rays] + depth * self.thickness[rays]
        return np.asarray(self.rays.start[:, rays][axis] + self.rays.direction[:, rays][axis] * along)

    def stops(self, begin: np.ndarray, end: np.ndarray, rays: np.ndarray) -> np.ndarray:
        """Depths [0, N]: slabs are not divided."""
        return np.zeros((0, len(rays)))

    def free(self, depth: np.ndarray, rays: np.ndarray, best: CurrentExtreme | None) -> np.ndarray:
        """Slabs [N] to pass until something may be visible from depths [N] of rays [N] on: infinite behind the last.
        best: values are wanted: none is passed.
        """
        free = np.zeros(len(rays))
        if best is None:
            along = self.rays.direction[:, rays] * self.thickness[rays]
            # slabs whose middles are passed
            free = np.floor(self.cells.blocks.free(self.places(depth, rays), along, self.step[rays]) + 0.5)
        return np.where(depth >= self.far[rays], np.inf, free)


Along = Sequence[LayerRays | SurfaceRays]


def walk(
    parts: Along | Sequence[SlabRays],
    visit: Callable[[np.ndarray, np.ndarray], np.ndarray],
    best: CurrentExtreme | None = None,
) -> None:
    """Follows rays through layers and meshes, or in slabs. visit: takes numbers of rays [N] and ascending depths
    [K + 1, N], between which matter may be visible, and returns which of the rays go on. best: of `LayerRays.free`.
    """
    if not parts:
        return
    step = np.min([part.step for part in parts], axis=0)
    rays, depth = np.arange(len(step)), np.zeros(len(step))
    while len(rays):
        free = np.min([part.free(depth[rays], rays, best) for part in parts], axis=0)
        depth[rays] += free
        ready, rays = rays[free == 0], rays[(free > 0) & np.isfinite(free)]
        if not len(ready):
            continue
        ahead = np.max(
            [part.far[ready] for part in parts if not isinstance(part, SurfaceRays)] or [depth[ready]], axis=0
        )
        left = int(((ahead - depth[ready]) / step[ready]).max()) + 1
        count = int(np.clip(min(TOGETHER // len(ready), left), LEAST, None))
        ends = depth[ready] + step[ready] * np.arange(count + 1)[:, None]
        stops = [part.stops(ends[0], ends[-1], ready) for part in parts]
        if any(map(len, stops)):
            ends = np.sort(np.concatenate([ends, *stops]), axis=0)
        depth[ready] = ends[-1]
        rays = np.concatenate([rays, ready[visit(ready, ends)]])


def passed(parts: Along, ends: np.ndarray, rays: np.ndarray) -> np.ndarray:
    """Optical depths [K, N] of all layers and meshes between depths [K + 1, N] of rays [N]."""
    return np.asarray(np.sum([part.passed(ends, rays) for part in parts], axis=0))


def absorb(parts: Along, enough: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Follows rays until they have passed optical depths [P]. Returns the begin and the end [P] of short pieces within
    which they do, NaN for none, the depths [P] within these, and the optical depths [P] that rays have passed when they
    end.
    """
    total = np.zeros(len(enough))
    begin, end, left = np.full((3, len(enough)), np.nan)

    def visit(rays: np.ndarray, ends: np.ndarray) -> np.ndarray:
        until = total[rays] + np.cumsum(passed(parts, ends, rays), axis=0)
        is_enough = until >= enough[rays]
        reached = np.flatnonzero(is_enough[-1])
        step, ray = is_enough[:, reached].argmax(axis=0), rays[reached]
        begin[ray], end[ray] = ends[step, reached], ends[step + 1, reached]
        before = np.where(step > 0, until[np.maximum(step - 1, 0), reached], total[ray])
        left[ray] = enough[ray] - before
        total[rays] = until[-1]
        return ~is_enough[-1]

    walk(parts, visit)
    some = np.flatnonzero(np.isfinite(begin))
    depth = np.full(len(enough), np.nan)
    if len(some):
        begin[some], end[some], depth[some] = _refine(parts, some, (begin[some], end[some]), left[some])
    return begin, end, depth, total


def _refine(
    parts: Along, rays: np.ndarray, piece: tuple[np.ndarray, np.ndarray], left: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The part, PARTS times shorter TIMES over, of a piece between depths [N] in which rays [N] pass the optical depth
    that is left [N], and the depth within it; at a mesh if that decides.
    """
    (begin, end), all_rays = piece, np.arange(len(rays))
    for _ in range(TIMES):
        ends = begin + (end - begin) * (np.arange(PARTS + 1) / PARTS)[:, None]
        ends[-1] = end
        until = np.cumsum(passed(parts, ends, rays), axis=0)
        # the parts do not add up exactly to the piece
        left = np.minimum(left, until[-1])
        part = (until < left).sum(axis=0)
        before = np.where(part > 0, until[np.maximum(part - 1, 0), all_rays], 0.0)
        within = until[part, all_rays] - before
        begin, end, left = ends[part, all_rays], ends[part + 1, all_rays], left - before
    depth = begin + (end - begin) * np.clip(left / np.where(within > 0, within, 1.0), 0.0, 1.0)
    for surfaces in (part for part in parts if isinstance(part, SurfaceRays)):
        inside = (begin[:, None] < surfaces.depth[rays]) & (surfaces.depth[rays] <= end[:, None])
        depth = np.where(inside.any(axis=1), np.where(inside, surfaces.depth[rays], np.inf).min(axis=1), depth)
    return begin, end, np.asarray(depth)


def ray_lengths(camera: Camera, pixels: np.ndarray) -> np.ndarray:
    """[P]: lengths of the rays through the centres of pixels, per eye-space depth."""
    across, down = camera.slopes()
    row, column = np.divmod(pixels, camera.size[0])
    return np.sqrt(across[column] ** 2 + down[row] ** 2 + 1) if camera.perspective else np.ones(len(pixels))
