"""Depth maps, by rays through the reconstructed field.

Rays pass boxes of voxels that hold nothing at once, and walk through others in half voxels and from plane to plane of
samples, between which values have no kinks; within the step that decides, values are looked up PARTS times.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np

from splatgl.data.mesh import Mesh
from splatgl.data.volume import Volume
from splatgl.errors import expected
from splatgl.reference.layers import crossings
from splatgl.reference.rays import Rays
from splatgl.splat.camera import Camera
from splatgl.splat.clipping import Clip, Plane
from splatgl.splat.culling import Window
from splatgl.splat.extract import only_pre
from splatgl.splat.extract_values import gradients
from splatgl.splat.grid import Grid
from splatgl.splat.kernels import kernel
from splatgl.splat.mask_field import MaskField, kept_part
from splatgl.splat.preintegration import ClassIntegral
from splatgl.splat.scene import Layer, Scene
from splatgl.splat.settings import Settings
from splatgl.splat.transfer import Transfer
from splatgl.splat.view import GridView

# rays that a thread walks together, and most threads
RAYS, THREADS = 1 << 14, 8
# places looked at within the step that decides
PARTS = 8
# optical depth of the least share that is told from nothing
LEAST = 1e-9
MOST_SHARE = 1 - 1e-6
# rows of pixels whose rays are cut with triangles together
BAND = 32
# what an opaque surface absorbs: an optical depth that no share exceeds
OPAQUE = 1 - 1e-12
# of what is looked for along a ray
EXTREMES = ("max", "min")

At = float | str
# whether values can be seen
Shown = Callable[[np.ndarray], np.ndarray]


def depths(
    x: Volume | Scene,
    camera: Camera,
    at: At = 0.5,
    settings: Settings | None = None,
    transfer: Transfer | None = None,
) -> np.ndarray:
    """Eye-space depths float64 [H, W], along the view direction in world units, of rays through pixel centres.

    at: the share of light whose absorption a depth tells, from 0 (where anything is) to below 1; or "max" or "min": of
    the largest or least value, as `mip` and `minip` show it. NaN where the ray absorbs less, or that value is clear.
    settings: planes that cut, and whether voxels are classified before they are interpolated; else values are. Meshes
    absorb their opacity. Raises InputError for other `at`, and for volumes that are read in parts.
    """
    settings = settings or Settings()
    scene = Scene([Layer(x, transfer)]) if isinstance(x, Volume) else x
    share, sign = _asked(at)
    cut = [(layer, (*settings.clip, *own)) for layer, own in zip(scene.shown, scene.planes, strict=True)]
    pre = settings.classification == "pre"
    fields = [LayerField.of(layer, planes, camera, pre, sign) for layer, planes in cut]
    count = camera.size[0] * camera.size[1]
    if sign:
        walk = partial(_extreme, fields, [_shown(layer.seen, sign) for layer, _ in cut])
    else:
        walk = partial(_absorbed, fields, _surfaces(scene.surfaces(settings), camera), LEAST - float(np.log1p(-share)))
    groups = [np.arange(first, min(first + RAYS, count)) for first in range(0, count, RAYS)]
    with ThreadPoolExecutor(min(os.cpu_count() or 1, THREADS)) as pool:
        found = np.concatenate(list(pool.map(walk, groups)))
    return found.reshape(camera.size[::-1])


def _asked(at: At) -> tuple[float, float]:
    """The share that is absorbed; and 0, or the sign of values whose maximum is looked for."""
    if at in EXTREMES:
        return 0.0, 1.0 if at == "max" else -1.0
    if isinstance(at, str) or not 0 <= float(at) <= MOST_SHARE:
        raise expected("at", "a share from 0 to below 1, max or min", repr(at)[:80])
    return float(at), 0.0


def _shown(look: Transfer, sign: float) -> Shown:
    """Tells whether values times a sign can be seen; of labels opacities are looked for."""

    def shown(values: np.ndarray) -> np.ndarray:
        return np.asarray((values * sign if look.labels else look.opacity(values * sign)) > 0)

    return shown


@dataclass(frozen=True, eq=False)
class Surfaces:
    """Meshes along rays. depth, passed [P, K]: eye-space depths, nearest first, and optical depths; the last infinite
    and none.
    """

    depth: np.ndarray
    passed: np.ndarray


def _surfaces(meshes: Sequence[Mesh], camera: Camera) -> Surfaces:
    count = camera.size[0] * camera.size[1]
    if not meshes:
        return Surfaces(np.full((count, 1), np.inf), np.zeros((count, 1)))
    width, height = camera.size
    bands = [Window(0, top, width, min(BAND, height - top)) for top in range(0, height, BAND)]
    found = [crossings(meshes, camera, band, None) for band in bands]
    most = max(each.distance.shape[1] for each in found)
    distance, opacity = np.full((count, most), np.inf), np.zeros((count, most))
    for band, each in zip(bands, found, strict=True):
        pixels = slice(band.y * width, (band.y + band.height) * width)
        distance[pixels, : each.distance.shape[1]] = each.distance
        opacity[pixels, : each.distance.shape[1]] = each.light[..., 3]
    across, down = (each.ravel() for each in np.meshgrid(*camera.slopes()))
    length = np.sqrt(across**2 + down**2 + 1) if camera.perspective else np.ones(count)
    return Surfaces(distance / length[:, None], -np.log1p(-np.minimum(opacity, OPAQUE)))


@dataclass(eq=False)
class Walk:
    """Rays that walk on, by number: where they are, what they passed, the next surface, and the last values of each
    layer with integrals of extinction up to them; NaN where a ray comes from elsewhere.
    """

    ray: np.ndarray
    depth: np.ndarray
    passed: np.ndarray
    surface: np.ndarray
    value: np.ndarray

    def keep(self, some: np.ndarray) -> None:
        """Goes on with some of them."""
        self.ray, self.depth, self.passed, self.surface = (
            each[some] for each in (self.ray, self.depth, self.passed, self.surface)
        )
        self.value = self.value[:, some]


def _begin(fields: Sequence[LayerField], rays: np.ndarray) -> Walk:
    count = len(rays)
    nearest = np.min([np.where(each.far > each.near, each.near, np.inf)[rays] for each in fields], axis=0)
    zero = np.zeros(count)
    start = np.where(np.isfinite(nearest), nearest, 0.0)
    return Walk(rays, start, zero, np.zeros(count, np.int64), np.full((len(fields), count), np.nan))


def _ends(fields: Sequence[LayerField], walk: Walk) -> np.ndarray:
    """Where a step of each ray ends: half a voxel on, at a plane of samples or a label's face, or where a layer begins
    or ends.
    """
    end = walk.depth + np.min([each.step[walk.ray] for each in fields], axis=0)
    for each in fields:
        end = np.minimum(end, each.face(walk.depth, walk.ray))
        for edge in (each.near[walk.ray], each.far[walk.ray]):
            end = np.where((edge > walk.depth) & (edge < end), edge, end)
    return end


def _through(field: LayerField, walk: Walk, some: np.ndarray, end: np.ndarray, number: int) -> np.ndarray:
    """Optical depths [N] of a layer on a step of some rays to depths `end`; its values there are kept."""
    ray, depth = walk.ray[some], walk.depth[some]
    passed = np.zeros(len(some))
    inside = np.flatnonzero((depth >= field.near[ray]) & (end <= field.far[ray]) & (depth < end))
    ray = ray[inside]
    first = walk.value[number, some[inside]]
    new = np.flatnonzero(np.isnan(first))
    if field.samples.nearest:
        # a step is within a voxel
        first = last = field.values((depth[inside] + end[inside]) / 2, ray)
    else:
        first[new] = field.values(depth[inside[new]], ray[new])
        last = field.values(end[inside], ray)
    walk.value[number, some] = np.nan
    walk.value[number, some[inside]] = last
    known = np.flatnonzero(~(np.isnan(first) | np.isnan(last)))
    first, last, begin, to = first[known], last[known], depth[inside[known]], end[inside[known]]
    if field.mask is not None:
        at = field.kept(begin, ray[known]), field.kept(to, ray[known])
        (low, high), slope = kept_part(at, (begin, to)), (last - first) / (to - begin)
        first, last, begin, to = first + slope * (low - begin), last + slope * (high - to), low, high
    mean = field.look.mean(first, last, (field.look.until(first), field.look.until(last)))
    passed[inside[known]] = mean * (to - begin) * field.length[ray[known]]
    return passed


def _absorbed(fields: Sequence[LayerField], surfaces: Surfaces, enough: float, rays: np.ndarray) -> np.ndarray:
    """Depths where the optical depth along rays reaches `enough`; NaN where it does not."""
    found = np.full(len(rays), np.nan)
    # steps within which it is reached: their ends, and the optical depth that is left
    within = np.full((3, len(rays)), np.nan)
    walk, at = _begin(fields, rays), rays[0]
    while len(walk.ray):
        free = np.min([each.free(walk.depth, walk.ray) for each in fields], axis=0)
        end = np.where(free > 0, walk.depth + free, _ends(fields, walk))
        # a step ends at a surface, too
        next_ = surfaces.depth[walk.ray, walk.surface]
        meets = next_ <= end
        end = np.where(meets, np.maximum(next_, walk.depth), end)
        some = np.flatnonzero(free == 0)
        passed = np.zeros(len(end))
        for number, each in enumerate(fields):
            walk.value[number, free > 0] = np.nan
            passed[some] += _through(each, walk, some, end[some], number)
        ends = np.flatnonzero(walk.passed + passed >= enough)
        within[:, walk.ray[ends] - at] = walk.depth[ends], end[ends], enough - walk.passed[ends]
        walk.passed += passed
        on = walk.passed < enough
        hit = np.flatnonzero(meets & on & np.isfinite(next_))
        walk.passed[hit] += surfaces.passed[walk.ray[hit], walk.surface[hit]]
        walk.surface[hit] += 1
        ends = hit[walk.passed[hit] >= enough]
        found[walk.ray[ends] - at] = next_[ends]
        walk.depth = end
        walk.keep((walk.passed < enough) & np.isfinite(end))
    some = np.flatnonzero(np.isfinite(within[0]))
    begin, end, left = within[:, some]
    found[some] = _within(fields, rays[some], (begin, end), left)
    return found


def _within(
    fields: Sequence[LayerField], rays: np.ndarray, ends: tuple[np.ndarray, np.ndarray], left: np.ndarray
) -> np.ndarray:
    """Where within a step the optical depth that is left is reached: by PARTS of it, and of the part that decides."""
    begin, end = ends
    every = np.arange(len(rays))
    share = np.zeros(len(rays))
    for _ in range(2):
        part = (end - begin) / PARTS
        passed = np.zeros((PARTS + 1, len(rays)))
        walk = Walk(rays, begin, passed[0], passed[0], np.full((len(fields), len(rays)), np.nan))
        for n in range(PARTS):
            to = begin + part * (n + 1)
            more = [_through(each, walk, every, to, number) for number, each in enumerate(fields)]
            passed[n + 1] = passed[n] + np.sum(more, axis=0)
            walk.depth = to
        # what the parts add up to is not exactly what the step did
        left = np.minimum(left, passed[-1])
        n = np.clip((passed < left).sum(axis=0) - 1, 0, PARTS - 1)
        low, high = passed[n, every], passed[n + 1, every]
        begin, left = begin + part * n, left - low
        end = begin + part
        share = np.clip(left / np.where(high > low, high - low, 1.0), 0.0, 1.0)
    return np.asarray(begin + (end - begin) * share)


def _extreme(fields: Sequence[LayerField], shown: Sequence[Shown], rays: np.ndarray) -> np.ndarray:
    """Depths of the largest values along rays; NaN where that can't be seen, or there is none."""
    best, place, layer = np.full(len(rays), -np.inf), np.full(len(rays), np.nan), np.zeros(len(rays), np.int64)
    walk, at = _begin(fields, rays), rays[0]

    def look(number: int, each: LayerField, some: np.ndarray, depth: np.ndarray) -> None:
        ray = walk.ray[some]
        inside = np.flatnonzero((depth >= each.near[ray]) & (depth <= each.far[ray]) & (each.far > each.near)[ray])
        ray, seen = ray[inside] - at, depth[inside]
        if each.samples.nearest:
            # of the voxel that the ray enters there
            seen = (seen + each.face(seen, ray + at)) / 2
        value = each.values(seen, ray + at)
        if each.mask is not None:
            value[each.kept(depth[inside], ray + at) < 0] = -np.inf
        better = np.flatnonzero(value > best[ray])
        best[ray[better]], place[ray[better]] = value[better], depth[inside[better]]
        layer[ray[better]] = number

    while len(walk.ray):
        free = np.min([each.free(walk.depth, walk.ray, best[walk.ray - at]) for each in fields], axis=0)
        some = np.flatnonzero(free == 0)
        for number, each in enumerate(fields):
            look(number, each, some, walk.depth[some])
        walk.depth = np.where(free > 0, walk.depth + free, _ends(fields, walk))
        walk.keep(np.isfinite(walk.depth))
    seen = np.zeros(len(rays), bool)
    for number, each in enumerate(fields):
        walk = _begin(fields, rays[np.isfinite(place) & (layer == number)])
        if each.samples.nearest:
            seen[walk.ray - at] = shown[number](best[walk.ray - at])
            continue
        step = 2 * each.step[walk.ray] / PARTS
        middle = place[walk.ray - at]
        for n in range(-PARTS // 2, PARTS // 2 + 1):
            look(number, each, np.arange(len(walk.ray)), middle + n * step)
        seen[walk.ray - at] = shown[number](best[walk.ray - at])
    return np.where(seen, place, np.nan)


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
        view = GridView.of(grid, camera, kernel("b-spline"), antialias=False)
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
