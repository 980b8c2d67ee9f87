"""Sheets in float64: the twin of `shaders/sheet_draw.comp`, with exact footprints and transfer functions.

Classified before: extinction and extinction · colour add up within a sheet. Classified after: masses, and values and
gradients by mass, add up within a sheet; a quadratic B-spline joins the sums of sheets, and their means are classified
in parts, or joined to one value that is classified.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from splatgl.splat.camera import Camera
from splatgl.splat.culling import Window
from splatgl.splat.kernels import Kernel, tabulated
from splatgl.splat.lighting import shone
from splatgl.splat.resolve import Resolved
from splatgl.splat.sheets import ABSENT, NearField, Sheets
from splatgl.splat.splats import Splats
from splatgl.truth.extent import Boxes, pixel_boxes
from splatgl.truth.pairs import Row, Values, values
from splatgl.truth.rays import Rays
from splatgl.truth.sheet_field import SheetField, ray_offset

# floats of the sums of a band of pixels
MOST_SUMS = 2**24


class SheetScene:
    """Data shared by all windows: positions, sheets and what each splat adds to them."""

    def __init__(self, splats: Splats, resolved: Resolved, depth: np.ndarray | None, row: str = "row1") -> None:
        """depth [N]: attenuated optical depths of splats classified before; None: classified after."""
        assert resolved.sheets is not None
        self.resolved, self.sheets, self.camera = resolved, resolved.sheets, resolved.camera
        view = self.view = replace(resolved.view, kernel=tabulated(resolved.kernel.name))
        voxel = view.voxels(splats.positions)
        self.spacing = splats.grid.mean_spacing
        self.row = Row.of(view, row, voxel, splats.grid)
        self.boxes: Boxes = pixel_boxes(view, self.row.name, voxel, self.camera)
        place = self.sheets.places(view, splats.positions)
        self.base = self.sheets.base(place)
        self.weights = self.sheets.weights(place, self.base)
        self.first = int(self.base.min()) if len(splats) else 0
        self.many = int(self.base.max()) + self.sheets.count - self.first if len(splats) else 1
        self.field, self.near = None, NearField.of(splats, view, self.sheets)
        if self.near is not None:
            last = max(self.first + self.many, self.near.count)
            self.first = min(self.first, -1)
            self.many = last - self.first
        if depth is not None:
            color = splats.colors.astype(np.float64)
            color = shone(color, splats, self.camera, voxel, resolved)
            self.terms = depth[:, None] * np.concatenate([color, np.ones((len(splats), 1))], axis=1)
        else:
            self.field = SheetField.of(splats, resolved, view, self.near.count if self.near else 0)
            value = splats.records["value"].astype(np.float64)
            self.terms = np.column_stack([np.ones(len(splats)), value, splats.records["gradient"].astype(np.float64)])

    def band_height(self) -> int:
        """Rows of pixels whose sums fit into MOST_SUMS."""
        return max(MOST_SUMS // (max(self.many, 1) * self.terms.shape[1] * self.camera.size[0]), 1)

    def part(self, window: Window) -> np.ndarray:
        """A window of the picture, float64 [h, w, 4]."""
        return self.parts([window])[0]

    def parts(self, windows: Sequence[Window]) -> list[np.ndarray]:
        """Windows of the picture, float64 [h, w, 4]; small ones together, as the sheets of all are passed in turn."""
        sizes = [w.width * w.height for w in windows]
        if len(windows) > 1 and sum(sizes) * self.many * self.terms.shape[1] > MOST_SUMS:
            return [self.part(window) for window in windows]
        sums = np.concatenate([self._sums(window) for window in windows])
        found = composited(sums) if self.field is None else self._classified(sums, windows)
        ends = np.cumsum(sizes)[:-1]
        return [part.reshape(w.height, w.width, 4) for part, w in zip(np.split(found, ends), windows, strict=True)]

    def _sums(self, window: Window) -> np.ndarray:
        """[P, sheets, terms] of a window's pixels."""
        sums = np.zeros((self.terms.shape[1], window.width * window.height * self.many))
        for found in values(self.row, self.boxes, np.arange(len(self.base)), window, self.camera):
            self._add(sums, found)
        by_sheet = sums.T.reshape(-1, self.many, len(sums))
        if self.near is not None:
            rays = self._rays(window, None, None)
            by_sheet[:, : -1 - self.first] = 0
            for sheet in range(-1, self.near.count):
                by_sheet[:, sheet - self.first] = near_sums(self.near, self.view.kernel, rays, sheet, self.sheets)
        return by_sheet

    def _classified(self, sums: np.ndarray, windows: Sequence[Window]) -> np.ndarray:
        assert self.field is not None
        places = np.concatenate([_pixels(window, self.camera) for window in windows])
        rays = Rays.of(self.view, self.camera, self.field.post.shape, places, self.resolved.clip)
        return self.field.composited(sums, rays, self.first, self.sheets)

    def between(self, window: Window, near: np.ndarray, far: np.ndarray) -> np.ndarray:
        """Light [P, 4] of what a window's pixels see between distances [P], world units."""
        sums, rays = self._sums(window), self._rays(window, near, far)
        if self.field is None:
            return composited(sums * self._within(rays)[..., None])
        return self.field.composited(sums, rays, self.first, self.sheets)

    def pieces(self, window: Window, near: np.ndarray | None = None, far: np.ndarray | None = None) -> Pieces:
        """What a window's pixels see of the scene, or of it between distances [P], in pieces along their rays."""
        sums, rays = self._sums(window), self._rays(window, near, far)
        if self.field is None:
            # a sheet lies in the middle of its matter
            middle = self.first + np.arange(self.many)[None, :, None] + np.zeros((len(sums), 1, 1))
            sums = sums if near is None else sums * self._within(rays)[..., None]
            return Pieces(self._depths(rays, middle + np.array([-0.5, 0.5])), sums)
        every = np.ones(len(sums), bool)
        number = (self.many + 2) * self.sheets.steps
        ends, matter = np.zeros((len(sums), number, 2)), np.zeros((len(sums), number, 4))
        for n, part in enumerate(self.field.parts(sums, rays, self.first, self.sheets, lambda: every)):
            # a piece for each part, also where nothing is known
            ends[:, n] = part.sheet + (n % self.sheets.steps) / self.sheets.steps
            ends[part.pixel, n] = part.sheet + np.stack(part.ends, axis=1)
            matter[part.pixel, n] = self.field.matter(part, rays)
        return Pieces(self._depths(rays, ends), matter)

    def _rays(self, window: Window, near: np.ndarray | None, far: np.ndarray | None) -> Rays:
        """Rays of a window's pixels; of voxels all of each, before its limits."""
        shape = (1, 1, 1) if self.field is None else self.field.post.shape
        rays = Rays.of(self.view, self.camera, shape, _pixels(window, self.camera), self.resolved.clip)
        if self.field is None:
            rays = replace(rays, near=np.zeros_like(rays.near), far=np.full_like(rays.far, np.inf))
        return rays if near is None or far is None else rays.between(near / self.spacing, far / self.spacing)

    def _within(self, rays: Rays) -> np.ndarray:
        """The shares [P, sheets] of the matter around sheets that lie within rays."""
        middle = self.first + np.arange(self.many)
        offset = ray_offset(self.view, rays)
        ends = [((end + offset) / self.sheets.thickness)[:, None] - middle for end in (rays.near, rays.far)]
        return np.asarray(np.clip(ends[1], -0.5, 0.5) - np.clip(ends[0], -0.5, 0.5))

    def _depths(self, rays: Rays, places: np.ndarray) -> np.ndarray:
        """Distances along rays, world units, of places [P, …] in sheets."""
        around = (slice(None), *[None] * (places.ndim - 1))
        offset = np.broadcast_to(ray_offset(self.view, rays), len(places))[around]
        return np.asarray((places * self.sheets.thickness - offset) * (rays.stretch * self.spacing)[around])

    def _add(self, sums: np.ndarray, found: Values) -> None:
        value, splat = found.integral.value, found.splat
        if self.field is not None:
            value = value / found.integral.peak
        entry = found.pixel * self.many + self.base[splat] - self.first
        shares = [weight[splat] * value for weight in self.weights]
        for total, term in zip(sums, self.terms.T, strict=True):
            own = term[splat]
            for j, share in enumerate(shares):
                total += np.bincount(entry + j, share * own, len(total))


def _pixels(window: Window, camera: Camera) -> np.ndarray:
    """Numbers of a window's pixels, row by row."""
    rows = np.arange(window.y, window.y + window.height)[:, None] * camera.size[0]
    return np.asarray((rows + np.arange(window.x, window.x + window.width)).ravel())


def near_sums(near: NearField, kernel: Kernel, rays: Rays, sheet: int, sheets: Sheets) -> np.ndarray:
    """[P, 5]: mass, value and gradient by mass, of a sheet around the eye, across each ray."""
    places = rays.start + rays.direction * (sheet * sheets.thickness)
    sums = np.zeros((places.shape[1], 5))
    first = np.floor(places).astype(np.int64)
    around = near.around
    size = np.array(near.cells.shape[2::-1])[:, None]
    for step in np.ndindex(*(2 * around,) * 3):
        cell = first + np.array(step)[:, None] - around + 1
        x, y, z = np.clip(cell - near.low[:, None], 0, size - 1)
        found = near.cells[z, y, x].astype(np.float64)
        apart = cell - places
        along = (apart * rays.direction).sum(axis=0)
        across = np.sqrt(np.maximum((apart**2).sum(axis=0) - along**2, 0.0))
        weight = kernel.footprint(across) * sheets.shares(along / sheets.thickness) * (found[:, 3] < ABSENT)
        sums += weight[:, None] * np.column_stack([np.ones(len(found)), found[:, 3], found[:, :3]])
    return np.asarray(sums / kernel.footprint(np.zeros(())))


@dataclass(frozen=True, eq=False)
class Pieces:
    """Even matter along rays, nearest first. ends [P, N, 2]: world distances from the eye, or from its plane.

    matter [P, N, 4]: emission and optical depth.
    """

    ends: np.ndarray
    matter: np.ndarray


def composited(sums: np.ndarray) -> np.ndarray:
    """[P, 4]: sums [P, sheets, 4] of emission and optical depth, nearest first, mixed within each sheet."""
    depth = sums[..., 3]
    before = np.cumsum(depth, axis=1) - depth
    share = np.where(depth > 0, -np.expm1(-depth) / np.where(depth > 0, depth, 1.0), 1.0)
    color = (sums[..., :3] * (share * np.exp(-before))[..., None]).sum(axis=1)
    return np.concatenate([color, -np.expm1(-depth.sum(axis=1))[:, None]], axis=1)
