"""Depth maps: how far from the eye each pixel's ray meets what it shows, in float64 and without splats.

Rays pass boxes of voxels that hold nothing at once, and walk through others in half voxels and from plane to plane of
samples, between which values have no kinks; within the step that decides, values are looked up PARTS times.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial

import numpy as np

from splatgl.data.mesh import Mesh
from splatgl.data.volume import Volume
from splatgl.errors import expected
from splatgl.splat.camera import Camera
from splatgl.splat.culling import Window
from splatgl.splat.mask_field import kept_part
from splatgl.splat.scene import Layer, Scene
from splatgl.splat.settings import Settings
from splatgl.splat.transfer import Transfer
from splatgl.truth.depth_field import LayerField
from splatgl.truth.surfaces import crossings

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
