"""Depth maps, by rays through the reconstructed field.

Rays skip empty boxes of voxels. Elsewhere they step by half a voxel, and stop at every plane of samples, between which
values have no kinks; within the decisive step, values are evaluated PARTS times.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np

from splatgl.data.mesh import Mesh
from splatgl.data.volume import Volume
from splatgl.errors import expected
from splatgl.reference.layers import crossings
from splatgl.reference.rays import Pixels, Rays
from splatgl.splat.camera import Camera
from splatgl.splat.clipping import Clip, Plane
from splatgl.splat.extract import why_only_pre
from splatgl.splat.extract_values import gradients
from splatgl.splat.grid import Grid
from splatgl.splat.iso import crossed_depth
from splatgl.splat.kernels import kernel
from splatgl.splat.mask_field import MaskField, clip_to_mask
from splatgl.splat.preintegration import ClassIntegral
from splatgl.splat.scene import Layer, Scene
from splatgl.splat.settings import Settings
from splatgl.splat.transfer import Transfer
from splatgl.splat.view import GridView

# rays per thread, and maximum number of threads
RAYS, THREADS = 1 << 14, 8
# evaluations within the decisive step
PARTS = 8
# least optical depth that counts as something
LEAST = 1e-9
MOST_SHARE = 1 - 1e-6
# rows of pixels whose rays are intersected with triangles together
BAND = 32
# opacity of an opaque surface: its optical depth exceeds that of any share
OPAQUE = 1 - 1e-12
# values of `at` that search for an extreme value
EXTREMES = ("max", "min")

At = float | str
# whether values are visible
IsVisible = Callable[[np.ndarray], np.ndarray]


def depths(
    x: Volume | Scene, camera: Camera, at: At = 0.5, settings: Settings | None = None, transfer: Transfer | None = None
) -> np.ndarray:
    """Eye-space depths float64 [H, W], along the view direction in world units, of rays through pixel centres.

    at: depth at which this share of light is absorbed, from 0 (at the first matter) to below 1; or "max" or "min": of
    the largest or least value, as shown by `mip` and `minip`. NaN where the ray absorbs less, or the value is
    transparent. settings: clip planes, and whether voxels are classified before interpolation. Meshes absorb their
    opacity. Raises InputError for other `at`, for clouds of points, and for volumes that are read in parts.
    """
    settings = settings or Settings()
    scene = Scene([Layer(x, transfer)]) if isinstance(x, Volume) else x
    scene.require_voxels("depth map")
    share, sign = _parse_at(at)
    cut = [(layer, (*settings.clip, *planes)) for layer, planes in zip(scene.shown, scene.planes, strict=True)]
    pre = settings.classification == "pre"
    fields = [LayerField.of(layer, planes, camera, pre, sign) for layer, planes in cut]
    count = camera.size[0] * camera.size[1]
    if sign:
        walk = partial(_extreme_depths, fields, [_visibility_test(layer.seen, sign) for layer, _ in cut])
    else:
        walk = partial(
            _absorption_depths, fields, _surfaces(scene.surfaces(settings), camera), LEAST - float(np.log1p(-share))
        )
    groups = [np.arange(first, min(first + RAYS, count)) for first in range(0, count, RAYS)]
    with ThreadPoolExecutor(min(os.cpu_count() or 1, THREADS)) as pool:
        result = np.concatenate(list(pool.map(walk, groups)))
    return result.reshape(camera.size[::-1])


def _parse_at(at: At) -> tuple[float, float]:
    """The absorbed share; and the sign of the values whose maximum is searched, 0 for a share."""
    if at in EXTREMES:
        return 0.0, 1.0 if at == "max" else -1.0
    if isinstance(at, str) or not 0 <= float(at) <= MOST_SHARE:
        raise expected("at", "a share from 0 to below 1, max or min", repr(at)[:80])
    return float(at), 0.0


def _visibility_test(look: Transfer, sign: float) -> IsVisible:
    """Returns a test whether values, multiplied by a sign, are visible; the values of labels are their opacities."""

    def shown(values: np.ndarray) -> np.ndarray:
        return np.asarray((values * sign if look.labels else look.opacity(values * sign)) > 0)

    return shown


@dataclass(frozen=True, eq=False)
class Surfaces:
    """Meshes along rays. depth, passed [P, K]: eye-space depths, nearest first, the last infinite; and optical depths,
    the last 0.
    """

    depth: np.ndarray
    passed: np.ndarray


def _surfaces(meshes: Sequence[Mesh], camera: Camera) -> Surfaces:
    count = camera.size[0] * camera.size[1]
    if not meshes:
        return Surfaces(np.full((count, 1), np.inf), np.zeros((count, 1)))
    width, height = camera.size
    tops = range(0, height, BAND)
    crossed = [
        crossings(meshes, camera, Pixels.of_rows(camera.size, top, min(top + BAND, height)), None) for top in tops
    ]
    most = max(band.distance.shape[1] for band in crossed)
    distance, opacity = np.full((count, most), np.inf), np.zeros((count, most))
    for top, hits in zip(tops, crossed, strict=True):
        pixels = slice(top * width, top * width + len(hits.distance))
        distance[pixels, : hits.distance.shape[1]] = hits.distance
        opacity[pixels, : hits.distance.shape[1]] = hits.light[..., 3]
    return Surfaces(distance / _ray_lengths(camera)[:, None], -np.log1p(-np.minimum(opacity, OPAQUE)))


def _ray_lengths(camera: Camera) -> np.ndarray:
    """[P]: lengths of the rays through all pixel centres, per eye-space depth."""
    across, down = (slopes.ravel() for slopes in np.meshgrid(*camera.slopes()))
    return np.sqrt(across**2 + down**2 + 1) if camera.perspective else np.ones(len(across))


@dataclass(eq=False)
class Walk:
    """Active rays: their numbers, depths, passed optical depths, next surfaces, and last values [layers, N]; NaN for
    rays that have just entered.
    """

    ray: np.ndarray
    depth: np.ndarray
    passed: np.ndarray
    surface: np.ndarray
    value: np.ndarray

    def keep(self, some: np.ndarray) -> None:
        """Continues with some of the rays."""
        self.ray, self.depth, self.passed, self.surface = (
            array[some] for array in (self.ray, self.depth, self.passed, self.surface)
        )
        self.value = self.value[:, some]


def _begin(fields: Sequence[LayerField], rays: np.ndarray) -> Walk:
    count = len(rays)
    nearest = np.min([np.where(field.far > field.near, field.near, np.inf)[rays] for field in fields], axis=0)
    zero = np.zeros(count)
    start = np.where(np.isfinite(nearest), nearest, 0.0)
    return Walk(rays, start, zero, np.zeros(count, np.int64), np.full((len(fields), count), np.nan))


def _step_ends(fields: Sequence[LayerField], walk: Walk) -> np.ndarray:
    """End of each ray's next step: after half a voxel, at a plane of samples or a label's face, or at the start or end
    of a layer.
    """
    end = walk.depth + np.min([field.step[walk.ray] for field in fields], axis=0)
    for field in fields:
        end = np.minimum(end, field.face(walk.depth, walk.ray))
        for edge in (field.near[walk.ray], field.far[walk.ray]):
            end = np.where((edge > walk.depth) & (edge < end), edge, end)
    return end


def _pass_step(field: LayerField, walk: Walk, some: np.ndarray, end: np.ndarray, number: int) -> np.ndarray:
    """Optical depths [N] of a layer along a step of some rays to depths `end`; stores the values there in the walk."""
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
        (low, high), slope = clip_to_mask(at, (begin, to)), (last - first) / (to - begin)
        first, last, begin, to = first + slope * (low - begin), last + slope * (high - to), low, high
    mean = field.look.mean(first, last, (field.look.until(first), field.look.until(last)))
    crossed = crossed_depth(*field.look.surfaces, first, last) if len(field.look.surfaces[0]) else 0.0
    passed[inside[known]] = mean * (to - begin) * field.length[ray[known]] + crossed
    return passed


def _absorption_depths(fields: Sequence[LayerField], surfaces: Surfaces, enough: float, rays: np.ndarray) -> np.ndarray:
    """Depths where the optical depth along rays reaches `enough`; NaN where it does not."""
    result = np.full(len(rays), np.nan)
    # decisive steps: their ends, and the optical depth still missing
    within = np.full((3, len(rays)), np.nan)
    walk, at = _begin(fields, rays), rays[0]
    while len(walk.ray):
        free = np.min([field.free(walk.depth, walk.ray) for field in fields], axis=0)
        end = np.where(free > 0, walk.depth + free, _step_ends(fields, walk))
        # a step ends at a surface, too
        next_ = surfaces.depth[walk.ray, walk.surface]
        meets = next_ <= end
        end = np.where(meets, np.maximum(next_, walk.depth), end)
        some = np.flatnonzero(free == 0)
        passed = np.zeros(len(end))
        for number, field in enumerate(fields):
            walk.value[number, free > 0] = np.nan
            passed[some] += _pass_step(field, walk, some, end[some], number)
        ends = np.flatnonzero(walk.passed + passed >= enough)
        within[:, walk.ray[ends] - at] = walk.depth[ends], end[ends], enough - walk.passed[ends]
        walk.passed += passed
        on = walk.passed < enough
        hit = np.flatnonzero(meets & on & np.isfinite(next_))
        walk.passed[hit] += surfaces.passed[walk.ray[hit], walk.surface[hit]]
        walk.surface[hit] += 1
        ends = hit[walk.passed[hit] >= enough]
        result[walk.ray[ends] - at] = next_[ends]
        walk.depth = end
        walk.keep((walk.passed < enough) & np.isfinite(end))
    some = np.flatnonzero(np.isfinite(within[0]))
    begin, end, left = within[:, some]
    result[some] = _refine(fields, rays[some], (begin, end), left)
    return result


def _refine(
    fields: Sequence[LayerField], rays: np.ndarray, ends: tuple[np.ndarray, np.ndarray], left: np.ndarray
) -> np.ndarray:
    """Depth within a step where the missing optical depth is reached: divides the step, then the decisive part, by
    PARTS.
    """
    begin, end = ends
    all_rays = np.arange(len(rays))
    share = np.zeros(len(rays))
    for _ in range(2):
        part = (end - begin) / PARTS
        passed = np.zeros((PARTS + 1, len(rays)))
        walk = Walk(rays, begin, passed[0], passed[0], np.full((len(fields), len(rays)), np.nan))
        for n in range(PARTS):
            to = begin + part * (n + 1)
            more = [_pass_step(field, walk, all_rays, to, number) for number, field in enumerate(fields)]
            passed[n + 1] = passed[n] + np.sum(more, axis=0)
            walk.depth = to
        # the parts do not add up exactly to the step
        left = np.minimum(left, passed[-1])
        n = np.clip((passed < left).sum(axis=0) - 1, 0, PARTS - 1)
        low, high = passed[n, all_rays], passed[n + 1, all_rays]
        begin, left = begin + part * n, left - low
        end = begin + part
        share = np.clip(left / np.where(high > low, high - low, 1.0), 0.0, 1.0)
    return np.asarray(begin + (end - begin) * share)


def _extreme_depths(fields: Sequence[LayerField], shown: Sequence[IsVisible], rays: np.ndarray) -> np.ndarray:
    """Depths of the largest values along rays; NaN where that value is invisible or there is none."""
    best, place, layer = np.full(len(rays), -np.inf), np.full(len(rays), np.nan), np.zeros(len(rays), np.int64)
    walk, at = _begin(fields, rays), rays[0]

    def look(number: int, field: LayerField, some: np.ndarray, depth: np.ndarray) -> None:
        ray = walk.ray[some]
        inside = np.flatnonzero((depth >= field.near[ray]) & (depth <= field.far[ray]) & (field.far > field.near)[ray])
        ray, visible = ray[inside] - at, depth[inside]
        if field.samples.nearest:
            # the value of the voxel that the ray enters there
            visible = (visible + field.face(visible, ray + at)) / 2
        value = field.values(visible, ray + at)
        if field.mask is not None:
            value[field.kept(depth[inside], ray + at) < 0] = -np.inf
        better = np.flatnonzero(value > best[ray])
        best[ray[better]], place[ray[better]] = value[better], depth[inside[better]]
        layer[ray[better]] = number

    while len(walk.ray):
        free = np.min([field.free(walk.depth, walk.ray, best[walk.ray - at]) for field in fields], axis=0)
        some = np.flatnonzero(free == 0)
        for number, field in enumerate(fields):
            look(number, field, some, walk.depth[some])
        walk.depth = np.where(free > 0, walk.depth + free, _step_ends(fields, walk))
        walk.keep(np.isfinite(walk.depth))
    visible = np.zeros(len(rays), bool)
    for number, field in enumerate(fields):
        walk = _begin(fields, rays[np.isfinite(place) & (layer == number)])
        step = 2 * field.step[walk.ray] / PARTS
        middle = place[walk.ray - at]
        for n in () if field.samples.nearest else range(-PARTS // 2, PARTS // 2 + 1):
            look(number, field, np.arange(len(walk.ray)), middle + n * step)
        visible[walk.ray - at] = shown[number](best[walk.ray - at])
    return np.where(visible, place, np.nan)


# cells along the sides of boxes that rays skip
BLOCK = 4
# cells of the extinction table, and of the integral from which it is sampled
CELLS, LEAST_CELLS = 1 << 16, 1 << 12
# steps between two voxels
STEPS = 2
# distance, in voxels, within which a place is at a face
AT_FACE = 1e-9


@dataclass(frozen=True, eq=False)
class Samples:
    """Numbers on a grid. flat: [D·H·W] in the order z, y, x; shape: (D, H, W). nearest: without interpolation.

    missing: which samples are missing, or None; these hold the mean of their neighbours.
    """

    flat: np.ndarray
    shape: tuple[int, int, int]
    nearest: bool = False
    missing: np.ndarray | None = None

    @classmethod
    def of(cls, samples: np.ndarray, nearest: bool = False) -> Samples:
        """Samples of an array [D, H, W]."""
        finite = np.isfinite(samples) if samples.dtype.kind == "f" else None
        if finite is None or finite.all():
            return cls(samples.ravel(), samples.shape, nearest)
        return cls(_fill_missing(samples, finite).ravel(), samples.shape, nearest, ~finite.ravel())

    def at(self, places: np.ndarray) -> np.ndarray:
        """Values [N] at grid positions [3, N], linear between samples; NaN nearest to missing ones."""
        last = np.array(self.shape[::-1])[:, None] - 1
        places = np.clip(places, 0, last)
        kind = np.float32 if self.flat.dtype.itemsize <= 2 or self.flat.dtype == np.float32 else np.float64
        x, y, z = (self.shape[1] * self.shape[2], self.shape[2], 1)[::-1]
        strides = np.array([x, y, z])[:, None]
        cell = np.rint(places).astype(np.int64)
        if self.nearest:
            values = self.flat.take((cell * strides).sum(axis=0)).astype(np.float64)
        else:
            first = np.minimum(places.astype(np.int64), np.maximum(last - 1, 0))
            share = (places - first).astype(kind)
            base = (first * strides).sum(axis=0)
            dx, dy, dz = (stride if size > 1 else 0 for stride, size in zip((x, y, z), self.shape[::-1], strict=True))
            rows = [self._between(base + step, dx, share[0], kind) for step in (0, dy, dz, dy + dz)]
            near, far = (a + (b - a) * share[1] for a, b in (rows[:2], rows[2:]))
            values = np.asarray(near + (far - near) * share[2], np.float64)
        if self.missing is not None:
            values[self.missing.take((cell * strides).sum(axis=0))] = np.nan
        return values

    def _between(self, at: np.ndarray, stride: int, share: np.ndarray, kind: type) -> np.ndarray:
        first: np.ndarray = self.flat.take(at).astype(kind)
        return np.asarray(first + (self.flat.take(at + stride).astype(kind) - first) * share)


@dataclass(frozen=True, eq=False)
class Look:
    """Extinction per world length of values. below [CELLS + 1]: its integral from `low` on, at equal steps up to
    `high`; None: values are extinctions. surfaces: values of iso-surfaces, and their optical depths.
    """

    low: float = 0.0
    high: float = 1.0
    below: np.ndarray | None = None
    surfaces: tuple[np.ndarray, np.ndarray] = (np.zeros(0), np.zeros(0))

    def until(self, values: np.ndarray) -> np.ndarray:
        """Integral of extinction from the lowest value to values [N]."""
        if self.below is None:
            return values * np.abs(values) / 2
        place = np.clip((values - self.low) * (CELLS / (self.high - self.low)), 0, CELLS)
        cell = np.minimum(place, CELLS - 1).astype(np.int64)
        below = self.below.take(cell)
        return np.asarray(below + (self.below.take(cell + 1) - below) * (place - cell))

    def mean(self, first: np.ndarray, last: np.ndarray, until: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
        """Mean extinctions between values `first` and `last`. until: their integrals."""
        if self.below is None:
            return np.maximum((first + last) / 2, 0.0)
        width = (self.high - self.low) / CELLS
        alike = np.abs(last - first) < width
        mean = (until[1] - until[0]) / np.where(alike, 1.0, last - first)
        some = np.flatnonzero(alike)
        place = np.clip(((first[some] + last[some]) / 2 - self.low) / width, 0, CELLS - 1).astype(np.int64)
        mean[some] = (self.below.take(place + 1) - self.below.take(place)) / width
        return mean

    def holds(self, low: np.ndarray, high: np.ndarray) -> np.ndarray:
        """Whether any value from `low` to `high` has extinction; False where low > high."""
        first, last = low.ravel(), high.ravel()
        until = self.until(first), self.until(last)
        with np.errstate(invalid="ignore"):
            some = (first <= last) & ((until[1] > until[0]) | (self.mean(first, last, until) > 0))
        some |= crossed_depth(*self.surfaces, first, last) > 0
        return np.asarray(some.reshape(low.shape))


@dataclass(frozen=True, eq=False)
class LayerField:
    """A layer along rays. start, per_depth [3, P]: grid positions at depth 0, and per eye-space depth; near, far [P]:
    depths between which a ray is in the clipped layer; length [P]: of a ray, per depth. low, high: least and greatest
    sample of each box of BLOCK cells; holds: whether it has anything visible. mask: of the layer, or None.
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
        """pre: classify voxels, then interpolate. sign: 1 or −1: search the largest of the values times this sign,
        instead of absorption. Raises InputError for volumes that are read in parts.
        """
        volume = layer.volume
        if not isinstance(volume.samples, np.ndarray):
            fix = "draw a coarser --level, or a part of it"
            raise expected(volume.name or "volume", "samples in memory or mapped, for depths", "some in parts", fix)
        if sign:
            samples, look = _search_samples(layer, sign), Look()
        else:
            samples, look = _absorbing_samples(layer, pre)
        grid = Grid.of(volume)
        view = GridView.of(grid, camera, kernel("b-spline"), antialias=False)
        pixels = np.arange(camera.size[0] * camera.size[1])
        rays = Rays.of(view, camera, volume.shape[::-1], pixels, Clip.of(planes, grid))
        length = _ray_lengths(camera)
        # index units of a ray per depth
        speed = length / (rays.stretch * grid.mean_spacing)
        low, high = _block_extremes(samples)
        holds = np.ones(low.shape, bool) if sign else look.holds(low, high)
        # masked voxels of labels are transparent already
        mask = MaskField.of(volume) if not samples.nearest else None
        if mask is not None:
            unmasked = _block_extremes(Samples.of(volume.kept((0, 0, 0), volume.shape).astype(np.uint8)))[1] > 0
            holds, high = holds & unmasked, np.where(unmasked, high, -np.inf)
        ends = rays.near / speed, rays.far / speed
        return cls(samples, look, rays.start, rays.direction * speed, *ends, length, low, high, holds, mask)

    @cached_property
    def step(self) -> np.ndarray:
        """Depths between two points of each ray."""
        return np.asarray(1 / (STEPS * np.linalg.norm(self.per_depth, axis=0)))

    def face(self, depth: np.ndarray, rays: np.ndarray) -> np.ndarray:
        """Depths of the next planes of samples behind depths of rays, where values have kinks; for labels, of the next
        faces of voxels.
        """
        along, half = self.per_depth[:, rays], 0.5 if self.samples.nearest else 0.0
        place, ahead = self.start[:, rays] + along * depth, np.where(along > 0, 1.0, -1.0)
        passed = np.floor(place * ahead + half + AT_FACE) + 1 - half
        with np.errstate(divide="ignore", invalid="ignore"):
            left = np.where(along == 0, np.inf, (passed - place * ahead) / np.abs(along))
        return np.asarray(depth + left.min(axis=0))

    def values(self, depth: np.ndarray, rays: np.ndarray) -> np.ndarray:
        """Values at depths of rays; NaN where samples are missing. rays: their numbers."""
        return self.samples.at(self.start[:, rays] + self.per_depth[:, rays] * depth)

    def kept(self, depth: np.ndarray, rays: np.ndarray) -> np.ndarray:
        """The mask minus its edge at depths of rays; matter ends where it falls below 0."""
        assert self.mask is not None
        return self.mask.at(self.start[:, rays] + self.per_depth[:, rays] * depth)

    def free(self, depth: np.ndarray, rays: np.ndarray, best: np.ndarray | None = None) -> np.ndarray:
        """Empty distance ahead of depths of rays: 0 where something may be visible, infinite behind the layer.

        best: values above which something is visible.
        """
        start, along = self.start[:, rays], self.per_depth[:, rays]
        last = np.array(self.samples.shape[::-1])[:, None] - 1
        cell = np.minimum(np.clip(start + along * depth, 0, last).astype(np.int64), np.maximum(last - 1, 0)) // BLOCK
        x, y, z = cell
        empty = ~self.holds[z, y, x] if best is None else self.high[z, y, x] <= best
        some = np.flatnonzero(empty)
        ends = np.where(along[:, some] > 0, cell[:, some] + 1, cell[:, some]) * float(BLOCK)
        # the outermost cells extend to the volume's ends, at `far`
        outer = (ends <= 0) | (ends >= last)
        with np.errstate(divide="ignore", invalid="ignore"):
            out = np.where((along[:, some] == 0) | outer, np.inf, (ends - start[:, some]) / along[:, some])
        distance = np.zeros(len(depth))
        # slightly beyond the end of the box
        distance[some] = np.maximum(out.min(axis=0) - depth[some], 0.0) + 1e-6 * self.step[rays[some]]
        distance = np.where(depth < self.near[rays], self.near[rays] - depth, distance)
        return np.where((depth >= self.far[rays]) | (self.far[rays] <= self.near[rays]), np.inf, distance)


def _search_samples(layer: Layer, sign: float) -> Samples:
    """Values times a sign; for labels their opacities, as in pictures of maxima."""
    values = layer.volume.samples
    if layer.seen.labels:
        return Samples.of(_opacities(layer) * sign, nearest=True)
    return Samples.of(values if sign > 0 else -values.astype(np.float64))


def _opacities(layer: Layer) -> np.ndarray:
    """Opacities [D, H, W] of labels' voxels; 0 where masked."""
    volume = layer.volume
    opacity = np.asarray(layer.seen.opacity(volume.samples), np.float64)
    opacity = np.where(opacity > layer.threshold, opacity, 0.0)
    return opacity * volume.kept((0, 0, 0), volume.shape) if volume.masks else opacity


def _absorbing_samples(layer: Layer, pre: bool) -> tuple[Samples, Look]:
    """Values with their extinctions; or extinctions of voxels classified before reconstruction."""
    volume, look = layer.volume, layer.seen
    unit = look.unit or Grid.of(volume).mean_spacing
    values = np.asarray(volume.samples)
    finite = values[np.isfinite(values)] if values.dtype.kind == "f" else values
    low, high = (float(finite.min()), float(finite.max())) if finite.size else (0.0, 0.0)
    if look.labels and not look.needs_gradients:
        return Samples.of(look.extinction(_opacities(layer), unit).astype(np.float32), nearest=True), Look()
    if pre or look.needs_gradients or why_only_pre(volume, look, layer.threshold) or not low < high:
        if look.iso:
            raise expected("depths of iso-surfaces", "values that no gradient weighs", "weighed or classified voxels")
        opacity = look.opacity(values)
        if look.needs_gradients:
            z, y, x = (index.ravel() for index in np.indices(values.shape))
            slope = gradients(values, x, y, z) @ np.linalg.inv(volume.world_from_index)
            opacity = look.classify(values.ravel(), np.linalg.norm(slope, axis=1))[0].reshape(values.shape)
        opacity = np.where(opacity > layer.threshold, opacity, 0.0)
        return Samples.of(look.extinction(opacity, unit).astype(np.float32), bool(look.labels)), Look()
    knots = np.linspace(low, high, CELLS + 1)
    below = ClassIntegral.of(look, low, high, LEAST_CELLS).until(knots)[:, 3] / unit
    surfaces = np.array([surface.value for surface in look.iso]), look.surface_matter()[:, 3]
    return Samples.of(values), Look(low, high, below, surfaces)


def _block_extremes(samples: Samples) -> tuple[np.ndarray, np.ndarray]:
    """Least and greatest sample of each box of BLOCK cells [D, H, W], including its far faces."""
    extremes = []
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
        extremes.append(some.astype(np.float64))
    return extremes[0], extremes[1]


def _fill_missing(samples: np.ndarray, finite: np.ndarray) -> np.ndarray:
    """Replaces samples that are not finite by the mean of their finite neighbours, out of 26; NaN if there are none."""
    sums, count = np.where(finite, samples, 0.0).astype(np.float64), finite.astype(np.float64)
    for axis in range(3):
        for array in (sums, count):
            wide = np.pad(array, [(1, 1) if n == axis else (0, 0) for n in range(3)])
            size = array.shape[axis]
            array += wide.take(range(size), axis=axis) + wide.take(range(2, size + 2), axis=axis)
    with np.errstate(invalid="ignore"):
        return np.where(finite, samples, np.where(count > 0, sums / count, np.nan))
