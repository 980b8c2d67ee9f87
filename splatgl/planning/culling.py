"""Culling and order: splats outside the view or hidden by others, their order, and bounds of opaque samples.

Along every axis the cells beyond the eye's are read in descending order first, the rest ascending:
plane by plane, within a plane row by row, within a row splat by splat. Of two cells that share a face,
the one on the eye's side comes last. Planes lie across the view, so that overlapping footprints are
seldom drawn out of depth order.  [M98 §3.5: drawn back to front without a sort]

In parallel views rays begin at the eye's plane. Values on it also depend on voxels behind it, so that splats classified
after reconstruction are kept as far behind the plane as their kernels reach.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import combinations, product

import numpy as np

from splatgl.data.volume import Slab, Volume
from splatgl.geometry.camera import Camera
from splatgl.geometry.clipping import LatestParts
from splatgl.geometry.grid import Grid, dilate, ranges
from splatgl.geometry.view import GridView, centres_between, tangents
from splatgl.planning.resolve import Resolved
from splatgl.splat.extract import ExtinctionTable
from splatgl.splat.hidden_interior import least_around
from splatgl.splat.kernels import kernel
from splatgl.splat.motion import Exposure
from splatgl.splat.splats import Splats, assemble, record_type
from splatgl.transfer.preintegration import opaque_intervals
from splatgl.transfer.transfer import Transfer


@dataclass(frozen=True)
class OrderKey:
    """Key of the drawing order: the eye's cell (x, y, z), and the axis (0 is x) perpendicular to the planes."""

    cell: tuple[int, int, int]
    axis: int


def order_for(splats: Splats, camera: Camera) -> OrderKey:
    """The order for a view; it changes only with the eye's cell or main axis.

    The cell is at most one beyond the splats; an orthographic eye is infinitely far back along the view.
    """
    low, high = np.rint(splats.index_bounds).astype(np.int64) + np.array([[-1], [1]])
    index_from_world = np.linalg.inv(splats.grid.world_from_index)
    view = index_from_world @ camera.forward
    if camera.perspective:
        eye = np.rint(splats.grid.index_from_world(camera.eye))
    else:
        eye = np.where(view > 0, -np.inf, np.inf)
    x, y, z = (int(n) for n in np.clip(eye, low, high))
    # the planes whose normal is nearest to the view direction; z on a tie
    across = np.abs(view) / np.linalg.norm(index_from_world, axis=1)
    axis = 2 - int(np.argmax(across[::-1]))
    return OrderKey((x, y, z), axis)


def back_to_front(splats: Splats, order: OrderKey) -> np.ndarray:
    """Record indices [N] in drawing order; reversed it is front to back."""
    lattice = splats.lattice(order.axis)
    outer, middle, inner = (order.cell[axis] for axis in lattice.axes)
    planes = _far_first(np.array([0]), np.array([len(lattice.plane)]), _count_before(lattice.plane <= outer))
    rows = _split_ranges(lattice.plane_start, _count_before(lattice.row <= middle), planes)
    splat = _split_ranges(lattice.row_start, _count_before(lattice.cell <= inner), rows)
    return splat if lattice.index is None else lattice.index[splat]


def _count_before(inside: np.ndarray) -> np.ndarray:
    """Number of inside members among the first 0, 1, … n: [n+1]."""
    count = np.zeros(len(inside) + 1, np.int32 if len(inside) < 2**31 else np.int64)
    np.cumsum(inside, out=count[1:])
    return count


def _split_ranges(start: np.ndarray, inside: np.ndarray, chosen: np.ndarray) -> np.ndarray:
    """The members of each chosen range in turn, each range far side first."""
    return _far_first(start[chosen], start[chosen + 1], inside)


def _far_first(start: np.ndarray, stop: np.ndarray, inside: np.ndarray) -> np.ndarray:
    """Members start … stop−1 of every range: those beyond the eye descending, then the rest ascending."""
    split = start + inside[stop] - inside[start]
    first = np.stack([stop - 1, start], axis=1).ravel()
    length = np.stack([stop - split, split - start], axis=1).ravel()
    return ranges(first, length, np.tile([-1, 1], len(start)))


# voxels per slab
SLAB_VOXELS = 1 << 22
# maximum number of voxels examined for a view, and in images of several levels, which are not read at full resolution;
# above it, the volume's box is used
MOST_EXAMINED, MOST_OF_LEVELS = 1 << 31, 1 << 28
# others around a sample that make it part of an object: a line one voxel wide has two
MOST_ALONE = 2


@dataclass(frozen=True, eq=False)
class OpaqueBounds:
    """Opaque part of a volume, as a subject of views; reads the volume on first use. Serves splats of values too, whose
    transparent voxels would widen the view. is_robust: whether opaque samples count that have at least MOST_ALONE
    others around them, if there are any.
    """

    volume: Volume
    transfer: Transfer
    is_robust: bool = False

    @property
    def full_extent(self) -> Volume:
        """The volume."""
        return self.volume

    @property
    def robust(self) -> OpaqueBounds:
        """The same without samples that are alone."""
        return replace(self, is_robust=True)

    @property
    def frame(self) -> str | None:
        """The volume's anatomical frame: LPS, RAS or None."""
        return self.volume.frame

    @property
    def nothing(self) -> bool:
        """Whether all samples were examined and none is opaque."""
        return self._ends is None and self.volume.count <= (MOST_OF_LEVELS if self.volume.coarser else MOST_EXAMINED)

    @property
    def corners(self) -> np.ndarray:
        """Corners [8, 3], world units, of the box around opaque samples; of the volume if there are none."""
        return self.volume.corners if self._ends is None else self._ends.corners

    @property
    def outline(self) -> np.ndarray:
        """Points [N, 3], world units, whose convex hull contains the opaque samples."""
        return self.volume.outline if self._ends is None else self._ends.outline

    @cached_property
    def _ends(self) -> Splats | None:
        """The first and the last opaque sample of each row, as splats."""
        volume = self.volume
        if volume.count > (MOST_OF_LEVELS if volume.coarser else MOST_EXAMINED):
            return None
        record = record_type(volume.shape, post=False)
        keeps = ExtinctionTable.of(self.transfer, volume.samples.dtype, 0.0, record).keeps
        if volume.samples.dtype.kind == "f":
            keeps = partial(_is_within, opaque_intervals(self.transfer))
        _, height, width = volume.shape
        halo = max(int(bool(self.transfer.iso)), 2 * self.is_robust)
        slabs = volume.slabs(max(1, SLAB_VOXELS // (height * width)), halo=halo)
        ends = np.concatenate([_row_ends(slab, self._opaque(slab, keeps)) for slab in slabs])
        if not len(ends):
            return replace(self, is_robust=False)._ends if self.is_robust else None
        records = np.zeros(len(ends), record)
        records["position"] = ends
        grid = Grid.of(volume)
        return assemble(records, ends, grid, grid.mean_spacing, volume.name)

    def _opaque(self, slab: Slab, keeps: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
        """bool: which samples of a slab, without its halo, are opaque or beside an iso-surface, and unmasked."""
        samples, volume = np.ascontiguousarray(slab.samples), self.volume
        inner = slice(slab.before, slab.before + slab.stop - slab.start)
        part = slice(None) if self.is_robust else inner
        opaque = keeps(samples[part])
        for surface in self.transfer.iso:
            opaque = opaque | _is_beside(surface.value, samples)[part]
        if volume.masks:
            first = slab.start - (slab.before if self.is_robust else 0)
            opaque = opaque & volume.kept((first, 0, 0), (first + len(opaque), *volume.shape[1:]))
        return _without_lone(opaque)[inner] if self.is_robust else opaque


def _is_within(intervals: np.ndarray, samples: np.ndarray) -> np.ndarray:
    """bool: which samples lie in closed intervals [n, 2]; faster than their opacities."""
    most = float(np.finfo(samples.dtype).max)
    inside = np.zeros(samples.shape, bool)
    # limits of numpy's type: Python's numbers would be rounded to the samples' type
    for low, high in np.clip(intervals, -most, most):
        inside |= (samples >= low) & (samples <= high)
    return inside


def _without_lone(opaque: np.ndarray) -> np.ndarray:
    """bool [D, H, W]: the samples with at least MOST_ALONE others among the 26 around them, or beside such a one."""
    count = opaque.astype(np.uint8)
    for axis in range(3):
        padded = np.pad(count, [(int(axis == n), int(axis == n)) for n in range(3)])
        parts = [padded.take(np.arange(n, n + count.shape[axis]), axis) for n in range(3)]
        count = parts[0] + parts[1] + parts[2]
    return np.asarray(opaque & dilate(opaque & (count > MOST_ALONE)))


def _is_beside(value: float, samples: np.ndarray) -> np.ndarray:
    """bool: which samples have a neighbour on the other side of a value."""
    level = np.float64(value)
    return np.asarray(dilate(samples > level) & dilate(samples <= level))


def _row_ends(slab: Slab, opaque: np.ndarray) -> np.ndarray:
    """int32 [N, 3] (x, y, z), in row order: the ends of the rows' opaque samples."""
    z, y = np.nonzero(opaque.any(axis=2))
    rows = opaque[z, y]
    first, last = rows.argmax(axis=1), rows.shape[1] - 1 - rows[:, ::-1].argmax(axis=1)
    ends = np.stack([np.stack([x, y, z + slab.start], axis=1) for x in (first, last)], axis=1)
    return ends.reshape(-1, 3).astype(np.int32)


# rounding: a splat behind the plane by less than this share of its distance from the eye counts as on the plane
ON_PLANE = 1e-9
# kernel radii behind the plane within which voxels affect values on the plane and in the sheets around it
BEHIND = 3.0
# cache: splats in front of the latest plane through the eye
_latest_ahead = LatestParts()


def clip_behind_eye(splats: Splats, camera: Camera) -> Splats:
    """Splats in front of a parallel view's eye, for labels those partly in front; all splats of perspective views.
    Caches the latest result.
    """
    if camera.perspective or not len(splats):
        return splats
    depth = camera.eye_from_points(splats.corners)
    if depth[:, 2].min() >= 0.0:
        return splats
    plane = (*camera.eye.tolist(), *camera.forward.tolist())
    slack = ON_PLANE * float(np.linalg.norm(depth, axis=1).max())
    if splats.labels is not None:
        # boxes that the plane cuts are kept
        slack += 0.5 * float(np.abs(camera.forward @ splats.grid.world_from_index).sum())
    return _latest_ahead.of(splats, plane, lambda: _is_ahead(splats, camera, slack))


def _is_ahead(splats: Splats, camera: Camera, slack: float) -> np.ndarray:
    """bool [N]: whether splats are at most `slack`, world units, behind the eye."""
    normal = camera.forward @ splats.grid.world_from_index
    offset = camera.forward @ (splats.grid.origin - camera.eye)
    if splats.post is not None:
        slack += BEHIND * kernel(splats.post.kernel).radius * float(np.linalg.norm(normal))
    return np.asarray(splats.positions @ normal + offset >= -slack)


# splats per block: BLOCK in tile_project.frag
BLOCK = 256
# pixels added around the picture, since a tile may cross its edge
BLOCK_MARGIN = 8
# beyond z_k a footprint's radius is R pixels times the blur's width, times √2 for slant, plus a margin for its
# first-order terms
STRETCHED = 2.0


@dataclass(frozen=True, eq=False)
class Frustum:
    """Planes through the picture's edges, in eye axes and mean spacings; fields are [2], along x and y.

    edge: slopes, or lengths, from the middle to the planes. support: largest distance outside the planes at which a
    kernel still reaches them, times the length of (1, edge). stretch: the same at depth 1 for a widened kernel.
    """

    view: GridView
    edge: np.ndarray
    support: np.ndarray
    stretch: np.ndarray

    @classmethod
    def of(cls, view: GridView) -> Frustum:
        """Planes BLOCK_MARGIN pixels outside the edges of a view's picture."""
        edge = view.edge + BLOCK_MARGIN * view.pitch
        normals = np.zeros((2, 2, 3))
        for axis in (0, 1):
            normals[axis, :, axis] = 1.0
            normals[axis, :, 2] = edge[axis] * np.array([-1, 1]) if view.perspective else 0.0
        support = view.kernel.radius * np.linalg.norm(normals @ view.eye_from_index, axis=-1).max(axis=1)
        widest = STRETCHED * view.kernel.radius * view.filter_pitch * view.antialias
        if not view.perspective:
            return cls(view, edge, np.maximum(support, widest), np.zeros(2))
        return cls(view, edge, support, np.full(2, widest * (1 + float(np.hypot(*edge)))))

    def may_show(self, center: np.ndarray, half: np.ndarray | None = None) -> np.ndarray:
        """bool [N]: whether splats within `half` [3, N] of `center` [3, N], eye axes, may be visible."""
        half = np.zeros_like(center) if half is None else half
        furthest = center[2] + half[2] if self.view.perspective else np.ones(center.shape[1:])
        beyond = np.abs(center[:2]) - half[:2] - self.edge[:, None] * furthest
        reach = np.maximum(self.support[:, None], self.stretch[:, None] * furthest)
        ahead = center[2] + half[2] > -self.view.reach if self.view.perspective else True
        return np.asarray((beyond <= reach * (1 + 1e-3) + 1e-3 * self.support[:, None]).all(axis=0) & ahead)


def block_boxes(positions: np.ndarray, block: int = BLOCK) -> np.ndarray:
    """[blocks, 6]: centres and half sides of the boxes around each `block` of positions [N, 3], grid indices. block: a
    power of two.
    """
    if not len(positions):
        return np.zeros((0, 6))
    # the last block is filled with its last position
    low = high = np.pad(positions.T, ((0, 0), (0, -len(positions) % block)), "edge")
    while block > 1:
        # in half the time of numpy's reduceat
        low, high = np.minimum(low[:, ::2], low[:, 1::2]), np.maximum(high[:, ::2], high[:, 1::2])
        block //= 2
    low, high = low.T.astype(np.float64), high.T.astype(np.float64)
    return np.concatenate([(low + high) / 2, (high - low) / 2], axis=1)


def blocks_in_frustum(around: np.ndarray, frustum: Frustum) -> np.ndarray:
    """bool [blocks]: whether boxes [blocks, 6] may contain a visible splat."""
    view = frustum.view
    return frustum.may_show(view.voxels(around[:, :3]), np.abs(view.eye_from_index) @ around[:, 3:].T)


# pixels around the outline, for rounding
OUTLINE_MARGIN = 1.0


def tiles_beside_box(
    view: GridView, shape: tuple[int, int, int], window: PixelWindow, side: tuple[int, int]
) -> np.ndarray:
    """bool [tiles]: whether a tile lies outside the silhouette of the box of `shape` voxels (x, y, z).

    Tiles of `side` pixels (x, y) cover the window row by row. All False unless the whole box is in front of the eye.
    """
    across, down = (-(-size // pixels) for size, pixels in zip((window.width, window.height), side, strict=True))
    ends = [(-0.5, size - 0.5) for size in shape]
    corners = view.voxels(np.array(list(product(*ends))))
    if view.perspective and corners[2].min() <= view.depth_reach:
        return np.zeros(across * down, bool)
    depth = corners[2] if view.perspective else np.ones(8)
    places = (corners[:2] / depth).T / view.pitch + np.array(view.size) / 2
    # centres of tiles, and half the distance between their outermost pixel centres
    half = (np.array(side) - 1) / 2
    x = window.x + np.arange(across) * side[0] + side[0] / 2
    y = window.y + np.arange(down) * side[1] + side[1] / 2
    beside = np.zeros((down, across), bool)
    for a, b in combinations(places, 2):
        along = b - a
        length = float(np.hypot(*along))
        if length < 1e-6:
            continue
        normal = np.array([along[1], -along[0]]) / length
        apart = (places - a) @ normal
        # an edge of the silhouette has all corners on one side
        for sign in (1.0, -1.0):
            if (sign * apart).max() <= 1e-6:
                reach = sign * ((x - a[0]) * normal[0] + (y[:, None] - a[1]) * normal[1]) - np.abs(normal) @ half
                beside |= reach > OUTLINE_MARGIN
    return beside.ravel()


# half lines are compiled in if a splat is nearer in depth than AROUND_EYE kernel reaches; tiles use them for splats
# nearer than HAS_PLACE reaches, the others have a place in the picture. Between the limits both draw the same, so that
# float32's rounding never decides whether a splat is drawn
AROUND_EYE, HAS_PLACE = 2.0, 1.5
# a moving kernel is near the eye within this many radii: the root of HALF_LINE_REACH, with a margin
NEAR_RADII = 1.06
# quads: the eye is inside a kernel if its centre is nearer than √HALF_LINE_REACH radii
HALF_LINE_REACH = 1.1


def eye_is_near(splats: Splats, view: GridView, exposure: Exposure | None) -> bool:
    """Whether a possibly visible splat surrounds the eye; perspective views only."""
    if not len(splats):
        return False
    low, high = splats.index_bounds
    if exposure is not None:
        # within reach of the box around all centres, flow included
        near = NEAR_RADII * view.kernel.radius
        if exposure.flow is not None:
            near += float(np.linalg.norm(exposure.drift(splats), axis=1).max())
        return bool(np.linalg.norm(view.eye_index - np.clip(view.eye_index, low, high)) < near)
    box = np.where(view.eye_from_index[2] > 0, low, high) - view.eye_index
    if view.eye_from_index[2] @ box > AROUND_EYE * view.reach:
        return False
    return bool(Frustum.of(view).may_show(centres_between(splats, view, -view.reach, AROUND_EYE * view.reach)).any())


# splats within this many kernel reaches of the eye's plane may cover the whole picture
CLEARANCE = 2.0
# iterations for the furthest centre beyond the edge: each step is a tenth of the previous one
ROUNDS = 5
# pixels around the window, for rounding
BOUNDS_MARGIN = 2
# pixels around a splat: rasterizers snap positions to 1/256 of a pixel or finer, and float32 rounds them
PIXEL_MARGIN = 2.0**-5


@dataclass(frozen=True)
class PixelWindow:
    """Rectangle of pixels; (x, y) is its first pixel."""

    x: int
    y: int
    width: int
    height: int

    @property
    def box(self) -> tuple[int, int, int, int]:
        """(x, y, width, height) in pixels."""
        return self.x, self.y, self.width, self.height

    @property
    def is_empty(self) -> bool:
        """Whether it has no pixels."""
        return self.width <= 0 or self.height <= 0


@dataclass(frozen=True)
class ScreenBounds:
    """Screen extent of splats. window: all pixels that they cover. mean_depth: of their box, in mean spacings."""

    window: PixelWindow
    mean_depth: float


def screen_bounds(box: np.ndarray, view: GridView) -> ScreenBounds:
    """Screen bounds of all splats in a box; the whole picture if the eye is near. box [8, 3]: corners, grid indices."""
    corners, size = view.voxels(box), view.size
    # reaches of kernels, and of widened ones in pixels
    steps, widest = view.eye_from_index * view.kernel.radius, STRETCHED * view.kernel.radius * view.blur
    if not view.perspective:
        half = max(float(np.linalg.norm(steps[:2], axis=1).max()) / view.pitch, widest)
        return ScreenBounds(_window(corners[:2].T / view.pitch, half, size), float(corners[2].mean()))
    # the kernel's reach in depth, and the nearest centre
    deep, nearest = float(np.linalg.norm(steps[2])), float(corners[2].min())
    middle = max(float(corners[2].mean()), deep, 1e-9)
    if nearest <= CLEARANCE * deep:
        return ScreenBounds(PixelWindow(0, 0, *size), middle)
    # the largest are centred beyond the edge and still reach into the picture
    across = steps[:2]
    furthest = np.array([_furthest(nearest, edge, s, steps[2]) for edge, s in zip(view.edge, across, strict=True)])
    sides = [_sides(nearest, slope, step, steps[2]) for slope, step in zip(furthest, across, strict=True)]
    half = max(max(max(side) for side in sides) / view.pitch, widest * (1 + float(np.hypot(*furthest))))
    return ScreenBounds(_window((corners[:2] / corners[2]).T / view.pitch, half, size), middle)


def _sides(z: float, slope: float, step: np.ndarray, deep: np.ndarray) -> tuple[float, float]:
    """Extents, in slopes, of an ellipsoid at (slope z, z), inwards and outwards, on either side of the view.

    step, deep: components of the half axes along the picture and along depth.
    """
    below, above = zip(*(tangents(slope * z, z, step, turn * deep) for turn in (1, -1)), strict=True)
    return float(max(below)), float(max(above))


def _furthest(z: float, edge: float, step: np.ndarray, deep: np.ndarray) -> float:
    """Slope of the furthest centre beyond the edge whose splat still reaches the edge."""
    beyond = 0.0
    for _ in range(ROUNDS):
        beyond = _sides(z, edge + beyond, step, deep)[0]
    return edge + beyond * (1 + 1e-3)


def _window(places: np.ndarray, half: float, size: tuple[int, int]) -> PixelWindow:
    """Pixels within `half` of positions [N, 2]; both in pixels, from the picture's centre."""
    middle = np.array(size) / 2
    low = np.clip(np.floor(places.min(axis=0) + middle - half) - BOUNDS_MARGIN, 0, size)
    high = np.clip(np.ceil(places.max(axis=0) + middle + half) + BOUNDS_MARGIN, 0, size)
    (x, y), (right, bottom) = low.astype(int), high.astype(int)
    return PixelWindow(int(x), int(y), int(right - x), int(bottom - y))


# a splat is hidden behind at most LAYERS layers of cells on every side of total optical depth HIDING: e^−6.2 = 0.002 of
# its light passes, half of the tolerance FAITHFUL, below which nothing is culled
LAYERS, HIDING, FAITHFUL = 4, 6.2, 1 / 256
# maximum number of cells in the splats' box
CELLS = 1 << 27
# minimum fraction of culled splats that justifies a copy
WORTH = 0.3
# optical depth behind which boxes of labels are hidden: 6e−6 of the light passes; number of boxes below which all are
# drawn
OPAQUE, FEW = 12.0, 1 << 14
# cache: visible boxes of the latest splats
_latest_skin = LatestParts()


def visible_shell(splats: Splats) -> Splats:
    """Removes splats that are hidden from every side; returns the same object if hardly any are, or if they are
    classified after reconstruction.

    Valid for composite images from outside the splats' box with no splat beyond z_k, where attenuated footprints let
    splats behind them contribute.
    """
    if splats.post is not None or not len(splats):
        return splats
    keep = _is_exposed(splats, HIDING)
    if keep.mean() > 1.0 - WORTH:
        return splats
    return splats.part(keep, among_all=True)


def visible_boxes(splats: Splats, resolved: Resolved) -> Splats:
    """Removes boxes of labels that others hide from every side, if the eye is outside and nothing is clipped; returns
    all splats otherwise. Caches the latest result.
    """
    blended = not resolved.boxes or not resolved.appearance.hides or resolved.clip is not None
    if blended or len(splats) < FEW:
        return splats
    camera = resolved.camera
    if camera.perspective:
        if not eye_is_outside(splats, camera.eye, 0.5):
            return splats
    elif camera.eye_from_points(splats.corners)[:, 2].min() < 0:
        return splats

    def keeps() -> np.ndarray:
        keep = _is_exposed(splats, OPAQUE * splats.grid.mean_spacing / splats.grid.smallest_spacing)
        return keep if keep.mean() <= 1.0 - WORTH else np.ones(len(splats), bool)

    return _latest_skin.of(splats, OPAQUE, keeps)


def _is_exposed(splats: Splats, hiding: float) -> np.ndarray:
    """bool [N]: whether some side of a splat has less than optical depth `hiding`, in cells of a mean spacing."""
    cells = splats.cells.astype(np.int64)
    cells -= cells.min(axis=0)
    shape = cells.max(axis=0) + 1
    if np.prod(shape, dtype=np.float64) > CELLS:
        return np.ones(len(splats), bool)
    depth = np.zeros(shape, np.float32)
    depth[tuple(cells.T)] = splats.records["optical_depth"]

    # hidden by 1 to LAYERS layers that are dense enough
    hidden = np.zeros(shape, bool)
    for layer in range(1, LAYERS + 1):
        depth = least_around(depth)
        hidden |= depth >= hiding / layer
        if not (depth >= hiding / LAYERS).any():
            break
    return ~hidden[tuple(cells.T)]


def eye_is_outside(splats: Splats, eye: np.ndarray, margin: float = 0.0) -> bool:
    """Whether an eye position, world units, is outside the box of all splats' centres, larger by a margin in voxels."""
    low, high = splats.index_bounds + np.array([[-margin], [margin]])
    place = splats.grid.index_from_world(eye)
    return bool((place < low).any() or (place > high).any())
