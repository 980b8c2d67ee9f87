"""Rays of pixels, pairs of splats and pixels, and extents of splats on the screen.

The perspective mapping to ray space (slopes, distance from the eye) is replaced by its Jacobian J at the voxel, by
which a Gaussian remains one. Its projection of covariance Q = J A Aᵀ Jᵀ is convolved with a Gaussian of a pixel p:
Q + p², whatever the depth, where [M98 Eq. 4] takes the larger of voxel and pixel. All in units of the kernel's own
variance, so that the filter is for a pixel what the kernel is for a voxel. Both are normalised: energy is kept.

Lengths are in mean spacings, in eye axes; extents are slopes (perspective) or eye x, y (orthographic).

There is no loop over splats: boxes are unrolled into rows, rows into pixels.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Protocol, Self
from weakref import WeakKeyDictionary

import numpy as np

from splatgl.data.mesh import unroll_ranges
from splatgl.errors import expected
from splatgl.geometry.camera import Camera
from splatgl.geometry.clipping import FLUSH, GRAZING, Clip
from splatgl.geometry.grid import Grid
from splatgl.geometry.view import GridView, smallest_axis
from splatgl.planning.culling import STRETCHED, block_boxes
from splatgl.splat.footprint import ROWS, Splat, SplatQuads, fill_depth, on_quads, table_quad
from splatgl.splat.line_integral import Integral, row1
from splatgl.splat.splats import Splats, in_parts


@dataclass(frozen=True, eq=False)
class EwaEllipses:
    """The ellipses of N splats in slopes, or eye x and y. middle [2, N]; shape [3, N]: xx, xy, yy of the covariance.

    gain [N]: the line integral at the middle over F(0), 0 for kernels that reach the eye's plane, where J means
    nothing. coverage [N]: the unfiltered ellipse's share of the filtered one's area.
    """

    middle: np.ndarray
    shape: np.ndarray
    gain: np.ndarray
    coverage: np.ndarray

    @classmethod
    def of(cls, view: GridView, voxel: np.ndarray) -> EwaEllipses:
        """The ellipses of voxels [3, N]. Raises InputError for a kernel that is not a Gaussian."""
        if view.kernel.name != "gaussian":
            raise expected("kernel", "gaussian, as the affine image of no other keeps its form", view.kernel.name)
        x, y, z = voxel
        middle, jacobian, density = voxel[:2], np.ones_like(z), np.ones_like(z)
        rows = np.broadcast_to(np.eye(2, 3)[..., None], (2, 3, len(z))).copy()
        if view.perspective:
            ahead = z > view.reach
            depth = np.where(ahead, z, 1.0)
            middle = voxel[:2] / depth
            rows[:, :2] /= depth
            rows[:, 2] = -middle / depth
            jacobian = np.sqrt(x * x + y * y + depth * depth) / depth**3
            density = np.where(ahead, 1.0, 0.0)
        across = np.einsum("ijn,jk->ikn", rows, view.eye_from_index)
        shape = np.stack([(across[i] * across[j]).sum(axis=0) for i, j in ((0, 0), (0, 1), (1, 1))])
        filtered = shape + np.array([[1.0], [0.0], [1.0]]) * view.filter_pitch**2 * view.antialias
        area = np.sqrt(_determinant(filtered))
        volume = abs(float(np.linalg.det(view.eye_from_index)))
        return cls(middle, filtered, density * jacobian * volume / area, np.sqrt(_determinant(shape)) / area)

    def bounds(self, radius: float) -> tuple[np.ndarray, np.ndarray]:
        """Lowest and highest slopes, or x and y, [2, N] each; low > high where nothing is drawn."""
        half = radius * np.sqrt(self.shape[[0, 2]])
        return self.middle - half, np.where(self.gain > 0, self.middle + half, -np.inf)

    def on(self, view: GridView, splat: np.ndarray, ray: np.ndarray) -> Integral:
        """Line integrals of splats [P] along rays [2, P]."""
        u, v = ray - self.middle[:, splat]
        xx, xy, yy = shape = self.shape[:, splat]
        square = (yy * u * u - 2 * xy * u * v + xx * v * v) / _determinant(shape)
        peak = self.gain[splat] * view.kernel.footprint(np.zeros(()))
        return Integral(self.gain[splat] * view.kernel.footprint(np.sqrt(np.maximum(square, 0.0))), peak)


def _determinant(shape: np.ndarray) -> np.ndarray:
    xx, xy, yy = shape
    return np.asarray(xx * yy - xy * xy)


# relative enlargement of a box against rounding
MARGIN = 1e-9
# splats processed together: their temporaries stay in the cache
SOME = 1 << 16
# consecutive splats that are examined as one box
RUN = 16
# side, in pixels, of the squares in which pixels are searched for
SQUARE = 4


@dataclass(frozen=True, eq=False)
class PixelBoxes:
    """Pixels left ≤ column < right, top ≤ row < bottom; int64 [N]; empty ones have right = left."""

    left: np.ndarray
    right: np.ndarray
    top: np.ndarray
    bottom: np.ndarray

    def take(self, some: np.ndarray) -> PixelBoxes:
        """Some boxes, by number."""
        return PixelBoxes(self.left[some], self.right[some], self.top[some], self.bottom[some])


@dataclass(frozen=True, eq=False)
class Pixels:
    """Pixels of a picture of `size` (width, height): int64 row [P] and column [P], row by row."""

    size: tuple[int, int]
    row: np.ndarray
    column: np.ndarray

    @classmethod
    def of(cls, size: tuple[int, int], index: np.ndarray) -> Self:
        """The pixels of ascending row-major indices [P]."""
        return cls(size, *np.divmod(np.asarray(index, np.int64), size[0]))

    def __len__(self) -> int:
        return len(self.row)

    @property
    def index(self) -> np.ndarray:
        """[P]: row-major indices in the picture."""
        return self.row * self.size[0] + self.column

    @cached_property
    def _lines(self) -> tuple[np.ndarray, np.ndarray]:
        """[H + 1]: how many rows before each have pixels; [rows, W + 1]: how many pixels are before each column of a
        row that has some, with those of earlier rows.
        """
        width, height = self.size
        used, line = np.unique(self.row, return_inverse=True)
        is_used = np.zeros(height + 1, np.int32)
        is_used[used + 1] = 1
        count = np.bincount(line * (width + 1) + self.column + 1, minlength=len(used) * (width + 1))
        return np.cumsum(is_used), np.cumsum(count).reshape(len(used), width + 1)

    @cached_property
    def _squares(self) -> np.ndarray:
        """[rows + 1, columns + 1]: how many pixels are above and to the left of each corner of the squares."""
        across, down = (-(-side // SQUARE) for side in self.size)
        square = self.row // SQUARE * across + self.column // SQUARE
        count = np.bincount(square, minlength=down * across).reshape(down, across)
        return np.pad(count.cumsum(axis=0).cumsum(axis=1), ((1, 0), (1, 0)))

    def most_in(self, boxes: PixelBoxes) -> np.ndarray:
        """[N]: upper limits on the numbers of pixels in boxes; 0 for empty ones."""
        if not len(self):
            return np.zeros(len(boxes.left), np.int64)
        rank, before = self._lines
        first, last = int(self.column.min()), int(self.column.max()) + 1
        wide = np.minimum(boxes.right, last) - np.maximum(boxes.left, first)
        fullest = int(np.diff(before[:, -1], prepend=0).max())
        return np.maximum(rank[boxes.bottom] - rank[boxes.top], 0) * np.clip(wide, 0, fullest)

    def within(self, boxes: PixelBoxes) -> tuple[np.ndarray, np.ndarray]:
        """Pairs of boxes and their pixels, box by box and row by row: indices of boxes [M] and of pixels [M]."""
        rank, before = self._lines
        owner, line = unroll_ranges(rank[boxes.top], np.maximum(rank[boxes.bottom], rank[boxes.top]))
        line_part, pixel = unroll_ranges(before[line, boxes.left[owner]], before[line, boxes.right[owner]])
        return owner[line_part], pixel

    def are_near(self, place: np.ndarray, half: np.ndarray) -> np.ndarray:
        """bool [N]: whether squares within `half` + 1 pixels [N] of places [2, N] may have a pixel. Pixel i is between
        places i and i + 1.
        """
        left, right, top, bottom = _squares_around(place, half, self.size)
        squares = self._squares
        return np.asarray(squares[bottom, right] - squares[top, right] - squares[bottom, left] + squares[top, left] > 0)


def _squares_around(place: np.ndarray, half: np.ndarray, size: tuple[int, int]) -> list[np.ndarray]:
    """left, right, top and bottom [N] of the squares of a picture within `half` + 1 pixels [N] of places [2, N]."""
    ends = []
    for at, side in zip(place, size, strict=True):
        last = -(-side // SQUARE)
        for end, more in ((at - half - 1, 0), (at + half + 1, 1)):
            ends.append(np.clip(np.floor(end / SQUARE) + more, 0, last).astype(np.int32))
    return ends


def pixel_boxes(view: GridView, row: str, voxel: np.ndarray, camera: Camera) -> PixelBoxes:
    """Pixels of `camera` that voxels [3, N] can reach in a row of Table 1."""
    left, right, top, bottom = pixel_ends(view, row, voxel, camera)
    empty = (right <= left) | (bottom <= top)
    return PixelBoxes(left, np.where(empty, left, right), top, bottom)


def pixel_ends(view: GridView, row: str, voxel: np.ndarray, camera: Camera) -> tuple[np.ndarray, ...]:
    """left, right, top and bottom [N] of voxels; equal if no pixel centre is between, right < left if invisible."""
    low, high = _bounds(view, row, voxel, camera)
    width, height = camera.size
    grow = MARGIN * (high - low)
    ends = []
    for axis, count in ((0, width), (1, height)):
        # pixel i's centre is at (i + ½ − count/2) · pitch
        first = np.ceil((low[axis] - grow[axis]) / view.pitch + count / 2 - 0.5)
        last = np.floor((high[axis] + grow[axis]) / view.pitch + count / 2 - 0.5) + 1
        ends += [np.clip(end, 0, count).astype(np.int64) for end in (first, last)]
    return tuple(ends)


def _bounds(view: GridView, row: str, voxel: np.ndarray, camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    """Lowest and highest slopes, or x and y, [2, N] each; low > high if invisible."""
    z = voxel[2]
    if row == EWA:
        return EwaEllipses.of(view, voxel).bounds(view.kernel.radius)
    if not view.perspective:
        half = _half_axes(view, view.widths[:, None] / view.shrink(z))
        return voxel[:2] - half, voxel[:2] + half
    corner = np.array([camera.extent * camera.size[0] / camera.size[1], camera.extent]) / 2
    if row == "row5":
        ahead = z > 0
        depth = np.where(ahead, z, 1.0)
        p = smallest_axis(view, depth)
        half = _half_axes(view, np.maximum(view.widths[:, None], p))
        return (voxel[:2] - half) / depth, np.where(ahead, (voxel[:2] + half) / depth, -np.inf)
    if row == "row4":
        # the quad's outline from the eye is inside that of a ball
        p = smallest_axis(view, z)
        size = view.kernel.radius * np.maximum(np.linalg.norm(view.eye_from_index, 2), p)
        length = np.sqrt((voxel * voxel).sum(axis=0))
        square = (size / np.maximum(np.hypot(length, size), 1e-300) * length) ** 2
        return _outline(voxel, corner, (square, square, square, 0.0, 0.0))
    # R² A Aᵀ, an ellipsoid that contains the kernel
    q = view.kernel.radius**2 * view.eye_from_index @ view.eye_from_index.T
    low, high = _outline(voxel, corner, (q[0, 0], q[1, 1], q[2, 2], q[0, 2], q[1, 2]))
    widened = view.is_widened(z)
    some = _widened_bounds(view, row, voxel[:, widened], corner)
    low[:, widened], high[:, widened] = some
    return low, high


def _half_axes(view: GridView, size: np.ndarray) -> np.ndarray:
    """[2, N]: half extents of an ellipse across the view with half axes size · R [2, N] along the view's axes."""
    return np.asarray(view.kernel.radius * np.sqrt((view.axes**2) @ (size * size)))


# xx, yy, zz, xz and yz of a quadratic form
Quadric = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray | float, np.ndarray | float]


def _outline(voxel: np.ndarray, corner: np.ndarray, quadric: Quadric) -> tuple[np.ndarray, np.ndarray]:
    """Lowest and highest slopes, seen from the eye, of ellipsoids around voxels, [2, N] each.

    A plane through the eye is tangent where (n·v)² = nᵀQn. An ellipsoid that crosses the eye's plane counts as visible
    everywhere, unless it is entirely outside the image's sides or behind the eye.
    """
    z, zz = voxel[2], quadric[2]
    reach = np.sqrt(zz)
    before = z > reach
    low, high = np.full((2, len(z)), -np.inf), np.full((2, len(z)), np.inf)
    hidden = z <= -reach
    for axis, (aa, az) in enumerate(((quadric[0], quadric[3]), (quadric[1], quadric[4]))):
        a = voxel[axis]
        scale = np.where(before, (z - reach) * (z + reach), 1.0)
        root = np.sqrt(np.maximum(z * z * aa - 2 * a * z * az + a * a * zz - (aa * zz - az * az), 0.0))
        low[axis] = np.where(before, (a * z - az - root) / scale, low[axis])
        high[axis] = np.where(before, (a * z - az + root) / scale, high[axis])
        for side in (-1.0, 1.0):
            slope = side * corner[axis]
            hidden |= side * (a - slope * z) > np.sqrt(np.maximum(aa - 2 * slope * az + slope * slope * zz, 0.0))
    return np.where(hidden, np.inf, low), np.where(hidden, -np.inf, high)


def _widened_bounds(view: GridView, row: str, voxel: np.ndarray, corner: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Lowest and highest slopes of voxels widened by antialiasing, as wide as the kernel or its low-pass."""
    z = voxel[2]
    near = z - view.reach
    half = _half_axes(view, np.maximum(view.widths[:, None] / near, view.filter_side(z) / z))
    if row in ("row2", "row3"):
        # the slant to the plane at the voxel's depth, or to the voxel's ray, is at most the image corner's
        length, radius = np.sqrt((voxel * voxel).sum(axis=0)), view.kernel.radius
        half = half * np.sqrt(1 + corner @ corner) * length / np.sqrt((length - radius) * (length + radius))
    ends = np.stack([voxel[:2] / near, voxel[:2] / (z + view.reach)])
    return ends.min(axis=0) - half, ends.max(axis=0) + half


_run_boxes: WeakKeyDictionary[Splats, np.ndarray] = WeakKeyDictionary()


def run_boxes(splats: Splats) -> np.ndarray:
    """[runs, 6]: centres and half sides of the boxes of RUN splats each, cached for their lifetime."""
    boxes = _run_boxes.get(splats)
    if boxes is None:
        boxes = _run_boxes[splats] = block_boxes(splats.records["position"], RUN)
    return boxes


def splats_may_reach(splats: Splats, view: GridView, wanted: Pixels) -> np.ndarray:
    """bool [N]: whether splats may reach one of the pixels of the picture; of runs of RUN splats whose box may reach
    none, no position is examined.
    """
    boxes, positions = run_boxes(splats), splats.records["position"]
    found = np.repeat(may_reach(boxes[:, :3], view, wanted, np.linalg.norm(boxes[:, 3:], axis=1)), RUN)[
        : len(positions)
    ]
    near = np.flatnonzero(found)

    def examine(part: slice) -> None:
        found[near[part]] = may_reach(positions[near[part]], view, wanted)

    in_parts(len(near), SOME, examine)
    return found


def may_reach(positions: np.ndarray, view: GridView, wanted: Pixels, around: np.ndarray | float = 0.0) -> np.ndarray:
    """bool [N]: whether splats up to `around` grid steps from grid positions [N, 3] may reach one of the pixels of the
    picture.
    """
    discs = PixelDiscs.of(positions, view, around)
    return np.where(discs.is_ahead, wanted.are_near(discs.place, discs.half), discs.surrounds_eye)


@dataclass(frozen=True, eq=False)
class PixelDiscs:
    """Discs of pixels that splats may reach. place [2, N]: their middles, pixel i being between i and i + 1; half [N]:
    their radii. is_ahead [N]: whether all of a disc's splats are before the eye; surrounds_eye [N]: whether they may
    reach any pixel.
    """

    place: np.ndarray
    half: np.ndarray
    is_ahead: np.ndarray
    surrounds_eye: np.ndarray

    @classmethod
    def of(cls, positions: np.ndarray, view: GridView, around: np.ndarray | float) -> Self:
        """Of splats up to `around` grid steps from grid positions [N, 3]."""
        v = view.voxels(positions)
        # a ball around the kernel; beyond z_k footprints grow with depth
        size = float(np.linalg.norm(view.eye_from_index, 2))
        reach, further = view.kernel.radius * size, around * size
        widest = STRETCHED * view.kernel.radius * view.filter_pitch * view.antialias
        depth, slant, is_ahead = np.ones(len(positions)), 1.0, np.ones(len(positions), bool)
        if view.perspective:
            # a splat around a place in front of the eye may be behind it
            is_ahead, depth = v[2] > further, np.where(v[2] > 0, v[2], 1.0)
            # distance from a plane through the eye to a point: difference of slopes times depth, divided by this
            slant = float(np.hypot(1.0, np.abs(np.array(view.size) / 2 + 1).max() * view.pitch))
        half = np.maximum(reach * slant / depth, widest * slant) + further * slant * (1 + widest) / depth
        place = v[:2] / depth / view.pitch + np.array(view.size)[:, None] / 2
        return cls(place, half / view.pitch, is_ahead, ~is_ahead & (v[2] > -reach - further))


def reached_squares(positions: np.ndarray, view: GridView, around: np.ndarray) -> np.ndarray:
    """bool [rows, columns]: which squares of SQUARE pixels of the picture may be reached by splats up to `around` [N]
    grid steps from grid positions [N, 3].
    """
    discs = PixelDiscs.of(positions, view, around)
    down, across = (-(-side // SQUARE) for side in view.size[::-1])
    if discs.surrounds_eye.any():
        return np.ones((down, across), bool)
    ahead = discs.is_ahead
    left, right, top, bottom = _squares_around(discs.place[:, ahead], discs.half[ahead], view.size)
    ends = np.concatenate([(row * (across + 1) + column) for row in (top, bottom) for column in (left, right)])
    count = np.bincount(ends, np.repeat([1, -1, -1, 1], len(left)), (down + 1) * (across + 1))
    return count.reshape(down + 1, across + 1).cumsum(axis=0).cumsum(axis=1)[:-1, :-1] > 0.5


# pairs per chunk: temporaries of 2 MB stay in the cache
PAIRS = 1 << 18
# rows drawn as quads, with their alignment; their formula holds on every grid
QUAD_ROWS = {"row4": "ray", "row5": "grid"}
# drawn beside the rows of Table 1
EWA = "ewa"


@dataclass(frozen=True, eq=False)
class FootprintRow:
    """One row of Table 1, or EWA, for voxels [3, N]."""

    view: GridView
    name: str
    voxel: np.ndarray
    quads: SplatQuads | EwaEllipses | None

    @classmethod
    def of(cls, view: GridView, name: str, voxel: np.ndarray, grid: Grid) -> FootprintRow:
        """The named row. Raises InputError for an unknown row, or one that does not exist for the grid."""
        if name == EWA:
            return cls(view, name, voxel, EwaEllipses.of(view, voxel))
        if name not in ROWS:
            raise expected("row", " or ".join([*ROWS, EWA]), repr(name))
        if name in ("row2", "row3") and not grid.cubic:
            raise expected("row", "row1, row4 or row5 for voxels that are not cubes", repr(name))
        # in orthographic projection, all rows are equal
        row = name if view.perspective or name in QUAD_ROWS else "row1"
        return cls(view, row, voxel, table_quad(view, voxel, QUAD_ROWS[row]) if row in QUAD_ROWS else None)

    def coverage(self) -> np.ndarray:
        """[N]: share of the widened footprint that the unwidened one covers."""
        return self.quads.coverage if self.quads else self.view.coverage(self.voxel[2])

    def attenuate_depth(self, splats: Splats, attenuation: str) -> np.ndarray:
        """Optical depths [N]; with attenuation fill, weakened by the share of their pixel that their matter fills."""
        depth, view = splats.records["optical_depth"].astype(np.float64), self.view
        if attenuation != "fill":
            return depth
        z = self.voxel[2]
        ray = self.voxel if view.perspective else np.array([[0.0], [0.0], [1.0]])
        length = np.sqrt((ray * ray).sum(axis=0))
        along = view.index_from_eye @ (ray / np.where(length > 0, length, 1.0))
        pixel = np.where(view.is_widened(z), view.filter_side(z), 0.0)
        widths = np.linalg.norm(view.eye_from_index, axis=0)
        return fill_depth(depth, along, widths, pixel, self.coverage(), splats.runs)

    def on(self, splat: np.ndarray, ray: np.ndarray) -> Integral:
        """Line integrals of splats [P] along rays [2, P]."""
        if isinstance(self.quads, EwaEllipses):
            return self.quads.on(self.view, splat, ray)
        if self.quads:
            return on_quads(self.view, self.quads.take(splat), ray)
        voxel = self.voxel[:, splat]
        integral = row1(self.view, voxel, ray)
        if self.name != "row1":
            # rows 2 and 3 equal row 1 where nothing is widened
            some = np.flatnonzero(self.view.is_widened(voxel[2]))
            cubes = Splat(self.view.kernel, voxel[:, some].T, ray[:, some].T, 1 / self.view.filter_pitch)
            integral.value[some] = ROWS[self.name](cubes)
        return integral


class Footprints(Protocol):
    """Splats along rays of a view."""

    @property
    def view(self) -> GridView:
        """The view."""

    def on(self, splat: np.ndarray, ray: np.ndarray) -> Integral:
        """Line integrals of splats [P] along rays [2, P]."""


def pair_values(
    row: Footprints, boxes: PixelBoxes, order: np.ndarray, wanted: Pixels, camera: Camera
) -> Iterator[tuple[np.ndarray, np.ndarray, Integral]]:
    """Yields the pairs of splats and wanted pixels in chunks, splats in the given order: numbers [P] of both, and line
    integrals [P].
    """
    slopes, most = pixel_slopes(wanted.index, camera, row.view.pitch), wanted.most_in(boxes)
    visible = order[most[order] > 0]
    chunks = np.flatnonzero(np.diff(np.cumsum(most[visible]) // PAIRS)) + 1
    for chunk in np.split(visible, chunks):
        owner, pixel = wanted.within(boxes.take(chunk))
        splat = chunk[owner]
        integral = row.on(splat, slopes[:, pixel])
        hit = np.flatnonzero(integral.value != 0)
        yield splat[hit], pixel[hit], Integral(integral.value[hit], integral.peak[hit])


def pixel_slopes(pixel: np.ndarray, camera: Camera, pitch: float) -> np.ndarray:
    """[2, P]: slopes, or lengths, from the middle of the picture to the centres of pixels [P]."""
    row, column = np.divmod(pixel, camera.size[0])
    return np.stack([(column + 0.5 - camera.size[0] / 2) * pitch, (row + 0.5 - camera.size[1] / 2) * pitch])


def index_rays(view: GridView, lateral: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Starts and directions, grid indices, and directions, eye axes, [3, P] each, of rays through slopes, or lengths,
    [2, P]. The rays' parameter is eye-space depth in mean spacings.
    """
    zero, one = np.zeros(lateral.shape[1]), np.ones(lateral.shape[1])
    if view.perspective:
        start, along = np.zeros((3, len(one))), np.stack([*lateral, one])
    else:
        start, along = np.stack([*lateral, zero]), np.stack([zero, zero, one])
    return view.index_from_eye @ start + view.eye_index[:, None], view.index_from_eye @ along, along


def box_ends(
    start: np.ndarray, direction: np.ndarray, low: np.ndarray, high: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Parameters [P] at which rays [3, P] enter and leave the box from low to high; entry > exit where they miss it."""
    with np.errstate(divide="ignore", invalid="ignore"):
        ends = np.stack([(low - start) / direction, (high - start) / direction])
    # along an axis that a ray does not move along, it is always or never inside
    still, inside = direction == 0, (start >= low) & (start <= high)
    near = np.where(still, np.where(inside, -np.inf, np.inf), ends.min(axis=0)).max(axis=0)
    far = np.where(still, np.where(inside, np.inf, -np.inf), ends.max(axis=0)).min(axis=0)
    return near, far


@dataclass(frozen=True, eq=False)
class Bounds:
    """Where rays are followed: in a box of grid positions from low to high [3], within a clip's planes, and from depth
    `first` on.
    """

    low: np.ndarray | float = -np.inf
    high: np.ndarray | float = np.inf
    clip: Clip | None = None
    first: float = 0.0

    @classmethod
    def of_voxels(cls, shape: tuple[int, int, int], clip: Clip | None = None) -> Self:
        """The cells of `shape` voxels along x, y, z."""
        return cls(np.full(3, -0.5), np.array(shape) - 0.5, clip)

    def ends(self, start: np.ndarray, direction: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
        """Depths near, far [P] between which rays [3, P] are inside, equal if nowhere; and the normals [P, 3], world
        axes, of the planes that clip their starts, else 0; None without planes.
        """
        flush = np.where(np.abs(direction) < GRAZING * np.linalg.norm(direction, axis=0), FLUSH, 0.0)
        low, high = (np.reshape(end, (-1, 1)) for end in (self.low, self.high))
        near, far = box_ends(start, direction, low - flush, high + flush)
        # parallel rays begin at the eye's plane, too
        near, face = np.maximum(near, self.first), None
        if self.clip is not None:
            enters, leaves, plane = self.clip.along(start, direction)
            face = np.where((enters > near + FLUSH)[:, None], self.clip.normal[plane], 0.0)
            near, far = np.maximum(near, enters), np.minimum(far, leaves)
        hit = far > near
        return np.where(hit, near, 0.0), np.where(hit, far, 0.0), face


@dataclass(frozen=True, eq=False)
class Rays:
    """Rays of pixels [P]. start, direction [3, P]: grid indices; unit vectors of index space.

    near, far [P]: distances between which a ray is in the box, equal if nowhere. stretch [P]: mean spacings per index
    unit along the ray. toward [P, 3]: unit vectors, world axes. entry [P]: distances at which rays enter the clipped
    box, also for parts of rays. face [P, 3]: normal of the plane that clips the start of the ray, world axes, else 0;
    None without planes.
    """

    start: np.ndarray
    direction: np.ndarray
    near: np.ndarray
    far: np.ndarray
    stretch: np.ndarray
    toward: np.ndarray
    entry: np.ndarray
    face: np.ndarray | None = None

    def between(self, near: np.ndarray, far: np.ndarray) -> Rays:
        """The parts of the rays between distances [P], mean spacings."""
        begin, end = np.maximum(self.near, near / self.stretch), np.minimum(self.far, far / self.stretch)
        return replace(self, near=begin, far=np.maximum(begin, end))

    @classmethod
    def of(cls, view: GridView, camera: Camera, bounds: Bounds, lateral: np.ndarray) -> Rays:
        """Rays through slopes, or lengths, [2, P] from the middle of `camera`'s picture, within bounds."""
        start, direction, along = index_rays(view, lateral)
        speed = np.linalg.norm(direction, axis=0)
        direction = direction / speed
        near, far, face = bounds.ends(start, direction)
        toward = (camera.eye_from_world.T @ along).T
        toward = toward / np.linalg.norm(toward, axis=1, keepdims=True)
        return cls(start, direction, near, far, np.linalg.norm(along, axis=0) / speed, toward, near, face)
