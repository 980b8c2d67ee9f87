"""A layer as rays of a depth map see it: values between samples, extinction, and boxes of voxels that hold nothing."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from splatgl.errors import expected
from splatgl.splat.camera import Camera
from splatgl.splat.clipping import Clip, Plane
from splatgl.splat.extract import only_pre
from splatgl.splat.extract_values import gradients
from splatgl.splat.grid import Grid
from splatgl.splat.kernels import kernel
from splatgl.splat.mask_field import MaskField
from splatgl.splat.preintegration import ClassIntegral
from splatgl.splat.scene import Layer
from splatgl.splat.view import View
from splatgl.truth.rays import Rays

# cells along the sides of boxes that are passed at once
BLOCK = 4
# cells of the table of extinction, and least of those between its points
CELLS, LEAST_CELLS = 1 << 16, 1 << 12
# steps between two voxels
STEPS = 2
# voxels within which a place is at a face
AT_FACE = 1e-9


@dataclass(frozen=True, eq=False)
class Samples:
    """Numbers on a grid. flat: [D·H·W] in the order z, y, x; shape: (D, H, W). nearest: nothing lies between two.

    missing: which samples are none, or None; they have the mean of their neighbours.
    """

    flat: np.ndarray
    shape: tuple[int, int, int]
    nearest: bool = False
    missing: np.ndarray | None = None

    @classmethod
    def of(cls, samples: np.ndarray, nearest: bool = False) -> Samples:
        """Of an array [D, H, W]."""
        finite = np.isfinite(samples) if samples.dtype.kind == "f" else None
        if finite is None or finite.all():
            return cls(samples.ravel(), samples.shape, nearest)
        return cls(_filled(samples, finite).ravel(), samples.shape, nearest, ~finite.ravel())

    def at(self, places: np.ndarray) -> np.ndarray:
        """Values [N] at grid positions [3, N], linear between samples; NaN in the cells of those that are none."""
        last = np.array(self.shape[::-1])[:, None] - 1
        places = np.clip(places, 0, last)
        kind = np.float32 if self.flat.dtype.itemsize <= 2 or self.flat.dtype == np.float32 else np.float64
        x, y, z = (self.shape[1] * self.shape[2], self.shape[2], 1)[::-1]
        strides = np.array([x, y, z])[:, None]
        cell = np.rint(places).astype(np.int64)
        if self.nearest:
            found = self.flat.take((cell * strides).sum(axis=0)).astype(np.float64)
        else:
            first = np.minimum(places.astype(np.int64), np.maximum(last - 1, 0))
            share = (places - first).astype(kind)
            base = (first * strides).sum(axis=0)
            dx, dy, dz = (stride if size > 1 else 0 for stride, size in zip((x, y, z), self.shape[::-1], strict=True))
            rows = [self._between(base + step, dx, share[0], kind) for step in (0, dy, dz, dy + dz)]
            near, far = (a + (b - a) * share[1] for a, b in (rows[:2], rows[2:]))
            found = np.asarray(near + (far - near) * share[2], np.float64)
        if self.missing is not None:
            found[self.missing.take((cell * strides).sum(axis=0))] = np.nan
        return found

    def _between(self, at: np.ndarray, stride: int, share: np.ndarray, kind: type) -> np.ndarray:
        first: np.ndarray = self.flat.take(at).astype(kind)
        return np.asarray(first + (self.flat.take(at + stride).astype(kind) - first) * share)


@dataclass(frozen=True, eq=False)
class Look:
    """Extinction per world length of values. below [CELLS + 1]: its integral from `low` on, at equal steps until
    `high`; None: values are extinctions.
    """

    low: float = 0.0
    high: float = 1.0
    below: np.ndarray | None = None

    def until(self, values: np.ndarray) -> np.ndarray:
        """The integral of extinction over values [N], from the lowest on."""
        if self.below is None:
            return values * np.abs(values) / 2
        place = np.clip((values - self.low) * (CELLS / (self.high - self.low)), 0, CELLS)
        cell = np.minimum(place, CELLS - 1).astype(np.int64)
        below = self.below.take(cell)
        return np.asarray(below + (self.below.take(cell + 1) - below) * (place - cell))

    def mean(self, first: np.ndarray, last: np.ndarray, until: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
        """Mean extinction between two values, of which the integrals are known."""
        if self.below is None:
            return np.maximum((first + last) / 2, 0.0)
        width = (self.high - self.low) / CELLS
        alike = np.abs(last - first) < width
        found = (until[1] - until[0]) / np.where(alike, 1.0, last - first)
        some = np.flatnonzero(alike)
        place = np.clip(((first[some] + last[some]) / 2 - self.low) / width, 0, CELLS - 1).astype(np.int64)
        found[some] = (self.below.take(place + 1) - self.below.take(place)) / width
        return found

    def holds(self, low: np.ndarray, high: np.ndarray) -> np.ndarray:
        """Whether any value between two has an extinction; of low above high, none."""
        first, last = low.ravel(), high.ravel()
        until = self.until(first), self.until(last)
        with np.errstate(invalid="ignore"):
            some = (first <= last) & ((until[1] > until[0]) | (self.mean(first, last, until) > 0))
        return np.asarray(some.reshape(low.shape))


@dataclass(frozen=True, eq=False)
class LayerField:
    """A layer along rays. start, per_depth [3, P]: grid positions at depth 0, and per eye-space depth; near, far [P]:
    depths between which a ray is within the layer and its cuts; length [P]: of a ray, per depth. low, high: least and
    greatest sample of each box of BLOCK cells; holds: whether any of it can be seen. mask: what cuts it, or None.
    """

    samples: Samples
    look: Look
    start: np.ndarray
    per_depth: np.ndarray
    near: np.ndarray
    far: np.ndarray
    length: np.ndarray
    low: np.ndarray
    high: np.ndarray
    holds: np.ndarray
    mask: MaskField | None = None

    @classmethod
    def of(
        cls, layer: Layer, planes: tuple[Plane, ...], camera: Camera, pre: bool = False, sign: float = 0.0
    ) -> LayerField:
        """pre: voxels are classified, then interpolated. sign: 1 or −1: times that, values are looked for, not what
        absorbs. Raises InputError for volumes that are read in parts.
        """
        volume = layer.volume
        if not isinstance(volume.samples, np.ndarray):
            fix = "draw a coarser --level, or a part of it"
            raise expected(volume.name or "volume", "samples in memory or mapped, for depths", "some in parts", fix)
        if sign:
            samples, look = _of_values(layer, sign), Look()
        else:
            samples, look = _seen(layer, pre)
        grid = Grid(volume.world_from_index, np.asarray(volume.origin))
        view = View.of(grid, camera, kernel("b-spline"), antialias=False)
        pixels = np.arange(camera.size[0] * camera.size[1])
        rays = Rays.of(view, camera, volume.shape[::-1], pixels, Clip.of(planes, grid))
        across, down = (each.ravel() for each in np.meshgrid(*camera.slopes()))
        length = np.sqrt(across**2 + down**2 + 1) if camera.perspective else np.ones(len(pixels))
        # index units of a ray per depth
        speed = length / (rays.stretch * grid.mean_spacing)
        low, high = _extremes(samples)
        holds = np.ones(low.shape, bool) if sign else look.holds(low, high)
        # of labels, voxels that masks leave out are clear
        mask = MaskField.of(volume) if not samples.nearest else None
        if mask is not None:
            kept = _extremes(Samples.of(volume.kept((0, 0, 0), volume.shape).astype(np.uint8)))[1] > 0
            holds, high = holds & kept, np.where(kept, high, -np.inf)
        ends = rays.near / speed, rays.far / speed
        return cls(samples, look, rays.start, rays.direction * speed, *ends, length, low, high, holds, mask)

    def part(self, some: np.ndarray) -> LayerField:
        """Along some of the rays."""
        start, along = self.start[:, some], self.per_depth[:, some]
        ends = {name: getattr(self, name)[some] for name in ("near", "far", "length")}
        return replace(self, start=start, per_depth=along, **ends)

    @cached_property
    def step(self) -> np.ndarray:
        """Depths between two points of each ray."""
        return np.asarray(1 / (STEPS * np.linalg.norm(self.per_depth, axis=0)))

    def face(self, depth: np.ndarray, rays: np.ndarray) -> np.ndarray:
        """Depths of the next planes of samples behind depths of rays, where values have kinks; of labels, of the next
        faces of voxels.
        """
        along, half = self.per_depth[:, rays], 0.5 if self.samples.nearest else 0.0
        place, ahead = self.start[:, rays] + along * depth, np.where(along > 0, 1.0, -1.0)
        passed = np.floor(place * ahead + half + AT_FACE) + 1 - half
        with np.errstate(divide="ignore", invalid="ignore"):
            left = np.where(along == 0, np.inf, (passed - place * ahead) / np.abs(along))
        return np.asarray(depth + left.min(axis=0))

    def values(self, depth: np.ndarray, rays: np.ndarray) -> np.ndarray:
        """Values at depths of rays, by number; NaN where none is known."""
        return self.samples.at(self.start[:, rays] + self.per_depth[:, rays] * depth)

    def kept(self, depth: np.ndarray, rays: np.ndarray) -> np.ndarray:
        """The mask less its edge at depths of rays; matter ends where it falls below 0."""
        assert self.mask is not None
        return self.mask.at(self.start[:, rays] + self.per_depth[:, rays] * depth)

    def free(self, depth: np.ndarray, rays: np.ndarray, best: np.ndarray | None = None) -> np.ndarray:
        """How far nothing can be seen from depths of rays on: 0 where something may be, infinite behind the layer.

        best: values that must be exceeded instead.
        """
        start, along = self.start[:, rays], self.per_depth[:, rays]
        last = np.array(self.samples.shape[::-1])[:, None] - 1
        cell = np.minimum(np.clip(start + along * depth, 0, last).astype(np.int64), np.maximum(last - 1, 0)) // BLOCK
        x, y, z = cell
        empty = ~self.holds[z, y, x] if best is None else self.high[z, y, x] <= best
        some = np.flatnonzero(empty)
        ends = np.where(along[:, some] > 0, cell[:, some] + 1, cell[:, some]) * float(BLOCK)
        # the outermost cells reach until the volume's ends, which far tells
        outer = (ends <= 0) | (ends >= last)
        with np.errstate(divide="ignore", invalid="ignore"):
            out = np.where((along[:, some] == 0) | outer, np.inf, (ends - start[:, some]) / along[:, some])
        found = np.zeros(len(depth))
        # a little beyond the end of the box
        found[some] = np.maximum(out.min(axis=0) - depth[some], 0.0) + 1e-6 * self.step[rays[some]]
        found = np.where(depth < self.near[rays], self.near[rays] - depth, found)
        return np.where((depth >= self.far[rays]) | (self.far[rays] <= self.near[rays]), np.inf, found)


def _of_values(layer: Layer, sign: float) -> Samples:
    """Values times a sign, of labels the opacities of their voxels, times it, as pictures of maxima show these."""
    values = layer.volume.samples
    if layer.seen.labels:
        return Samples.of(_opacities(layer) * sign, nearest=True)
    return Samples.of(values if sign > 0 else -values.astype(np.float64))


def _opacities(layer: Layer) -> np.ndarray:
    """Of the voxels of labels; 0 of those that masks leave out."""
    volume = layer.volume
    opacity = np.asarray(layer.seen.opacity(volume.samples), np.float64)
    opacity = np.where(opacity > layer.threshold, opacity, 0.0)
    return opacity * volume.kept((0, 0, 0), volume.shape) if volume.masks else opacity


def _seen(layer: Layer, pre: bool) -> tuple[Samples, Look]:
    """Values with their extinctions; or extinctions of voxels, where these are classified before reconstruction."""
    volume, look = layer.volume, layer.seen
    unit = look.unit or Grid(volume.world_from_index, np.zeros(3)).mean_spacing
    values = np.asarray(volume.samples)
    finite = values[np.isfinite(values)] if values.dtype.kind == "f" else values
    low, high = (float(finite.min()), float(finite.max())) if finite.size else (0.0, 0.0)
    if look.labels and not look.gradient:
        return Samples.of(look.extinction(_opacities(layer), unit).astype(np.float32), nearest=True), Look()
    if pre or look.gradient or only_pre(volume, look, layer.threshold) or not low < high:
        opacity = look.opacity(values)
        if look.gradient:
            z, y, x = (each.ravel() for each in np.indices(values.shape))
            slope = gradients(values, x, y, z) @ np.linalg.inv(volume.world_from_index)
            opacity = opacity * look.weight(np.linalg.norm(slope, axis=1)).reshape(values.shape)
        opacity = np.where(opacity > layer.threshold, opacity, 0.0)
        return Samples.of(look.extinction(opacity, unit).astype(np.float32), bool(look.labels)), Look()
    knots = np.linspace(low, high, CELLS + 1)
    return Samples.of(values), Look(low, high, ClassIntegral.of(look, low, high, LEAST_CELLS).until(knots)[:, 3] / unit)


def _extremes(samples: Samples) -> tuple[np.ndarray, np.ndarray]:
    """Least and greatest sample of each box of BLOCK cells [D, H, W], its far faces with it."""
    found = []
    for extreme in (np.minimum, np.maximum):
        some = samples.flat.reshape(samples.shape)
        if samples.missing is not None:
            gone = np.inf if extreme is np.minimum else -np.inf
            some = np.where(samples.missing.reshape(samples.shape) & ~np.isfinite(some), gone, some)
        for axis, size in enumerate(samples.shape):
            starts = np.arange(0, max(size - 1, 1), BLOCK)
            within = extreme.reduceat(some, starts, axis=axis)
            ends = np.minimum(starts + BLOCK, size - 1)
            some = extreme(within, some.take(ends, axis=axis))
        found.append(some.astype(np.float64))
    return found[0], found[1]


def _filled(samples: np.ndarray, finite: np.ndarray) -> np.ndarray:
    """Samples, those that are not finite as the mean of the finite ones of their 26 neighbours, or NaN without any."""
    sums, count = np.where(finite, samples, 0.0).astype(np.float64), finite.astype(np.float64)
    for axis in range(3):
        for each in (sums, count):
            wide = np.pad(each, [(1, 1) if n == axis else (0, 0) for n in range(3)])
            size = each.shape[axis]
            each += wide.take(range(size), axis=axis) + wide.take(range(2, size + 2), axis=axis)
    with np.errstate(invalid="ignore"):
        return np.where(finite, samples, np.where(count > 0, sums / count, np.nan))
