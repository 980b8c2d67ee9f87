"""Depth maps, and `pick`: the point of a scene under a pixel, by rays in float64 through the rendered field."""

from __future__ import annotations

import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Any
from weakref import WeakKeyDictionary
from zlib import crc32

import numpy as np

from splatgl.coercion import public
from splatgl.data.volume import Triple, Volume
from splatgl.errors import expected
from splatgl.geometry.camera import Camera
from splatgl.geometry.grid import trilinear
from splatgl.planning.scene import Layer, Scene
from splatgl.reference.march import (
    PARTS,
    CurrentExtreme,
    LayerRays,
    SurfaceRays,
    ValueMatter,
    absorb,
    fields_of,
    passed,
    ray_lengths,
    walk,
)
from splatgl.splat.settings import Blend, Settings
from splatgl.transfer.transfer import Transfer

# values [P] and their depths [P]; NaN for none
Found = tuple[np.ndarray, np.ndarray]


def shown_values(
    layers: Sequence[LayerRays], settings: Settings, count: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Values that blends of one value show along `count` rays, of the layer whose value is the most opaque: its
    position in the list of layers, the value and its depth, [P] each; NaN where all is transparent.
    """
    most, layer = np.zeros(count), np.zeros(count, np.int64)
    value, depth = np.full((2, count), np.nan)
    for number, rays in enumerate(layers):
        if settings.join == "attenuated":
            values, depths = _attenuated(rays, settings.mip_attenuation)
        else:
            values, depths = _mean(rays) if settings.join == "mean" else _extreme(rays, settings.join)
        opacity = np.nan_to_num(rays.layer.matter.opacity(values))
        better = np.flatnonzero(opacity > most)
        most[better], layer[better] = opacity[better], number
        value[better], depth[better] = values[better], depths[better]
    return layer, value, depth


def _extreme(layer: LayerRays, join: str) -> Found:
    """The largest values along rays, or for the join min the least, and the first depths where the field has them."""
    count, sign = len(layer.near), 1.0 if join == "max" else -1.0
    best, depth = CurrentExtreme(np.full(count, -np.inf), sign), np.full(count, np.nan)

    def visit(rays: np.ndarray, ends: np.ndarray) -> np.ndarray:
        ends = np.clip(ends, layer.near[rays], layer.far[rays])
        # the value of the voxel that the ray enters there
        at = (ends + np.concatenate([ends[1:], ends[-1:]])) / 2 if layer.layer.is_boxes else ends
        values = np.nan_to_num(layer.values(at, rays) * sign, nan=-np.inf)
        if layer.layer.is_boxes:
            # a plane between voxels belongs to neither
            values[at == ends] = -np.inf
        place = values.argmax(axis=0), np.arange(len(rays))
        better = values[place] > best.value[rays]
        best.value[rays[better]], depth[rays[better]] = values[place][better], ends[place][better]
        return np.ones(len(rays), bool)

    walk([layer], visit, best)
    rays = np.flatnonzero(np.isfinite(depth))
    for scale in () if layer.layer.is_boxes else (1.0, 1 / PARTS):
        near = np.arange(-PARTS, PARTS + 1)[:, None] / PARTS * (scale * layer.step[rays])
        visit(rays, depth[rays] + near)
    return np.where(np.isfinite(depth), best.value * sign, np.nan), depth


def _ends(layer: LayerRays, rays: np.ndarray, ends: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Values [2, K, N] at both ends of pieces between depths [K + 1, N] of rays [N], their lengths [K, N], 0 without
    values, and the depths within the layer.
    """
    ends = np.clip(ends, layer.near[rays], layer.far[rays])
    values = layer.values(ends, rays)
    both = np.stack([values[:-1], values[1:]])
    both = np.where(np.isnan(both), both[::-1], both)
    return both, np.where(np.isfinite(both[0]), np.diff(ends, axis=0), 0.0), ends


def _attenuated(layer: LayerRays, attenuation: float) -> Found:
    """Values of the largest attenuated shares of the colours' window."""
    count, matter = len(layer.near), layer.layer.matter
    assert isinstance(matter, ValueMatter)
    low, high = matter.post.transfer.color_range
    width = (high - low) or matter.post.span
    best, passed = CurrentExtreme(np.full(count, -np.inf), 0.0), np.zeros(count)
    shown, depth = np.full((2, count), np.nan)

    def visit(rays: np.ndarray, ends: np.ndarray) -> np.ndarray:
        values, length, ends = _ends(layer, rays, ends)
        shares = np.clip((np.nan_to_num(values, nan=low) - low) / width, 0.0, 1.0)
        through = shares.mean(axis=0) * length * layer.length[rays] * (attenuation / layer.layer.splats.unit)
        before = passed[rays] + np.cumsum(np.pad(through, ((1, 0), (0, 0))), axis=0)
        passed[rays] = before[-1]
        for side, share in enumerate(shares):
            seen = np.where(length > 0, share * np.exp(-before[side : side + len(share)]), -np.inf)
            place = seen.argmax(axis=0), np.arange(len(rays))
            better = seen[place] > best.value[rays]
            best.value[rays[better]], shown[rays[better]] = seen[place][better], values[side][place][better]
            depth[rays[better]] = ends[place[0] + side, place[1]][better]
        return np.ones(len(rays), bool)

    walk([layer], visit, best)
    return shown, depth


def _mean(layer: LayerRays) -> Found:
    """Mean values over rays' lengths."""
    count = len(layer.near)
    every, depth, sums = CurrentExtreme(np.full(count, -np.inf), 0.0), np.full(count, np.nan), np.zeros((2, count))

    def add(rays: np.ndarray, ends: np.ndarray) -> np.ndarray:
        values, length, _ = _ends(layer, rays, ends)
        sums[:, rays] += np.stack([np.nan_to_num(values.mean(axis=0)) * length, length]).sum(axis=1)
        return np.ones(len(rays), bool)

    walk([layer], add, every)
    shown = np.where(sums[1] > 0, sums[0], np.nan) / np.where(sums[1] > 0, sums[1], 1.0)

    def meet(rays: np.ndarray, ends: np.ndarray) -> np.ndarray:
        values, length, ends = _ends(layer, rays, ends)
        apart = values - shown[rays]
        meets = (apart[0] * apart[1] <= 0) & (length > 0)
        some = np.flatnonzero(meets.any(axis=0))
        place = meets[:, some].argmax(axis=0), some
        rise = apart[1][place] - apart[0][place]
        share = np.clip(-apart[0][place] / np.where(rise == 0, 1.0, rise), 0.0, 1.0)
        depth[rays[some]] = ends[place] + share * (ends[place[0] + 1, some] - ends[place])
        return ~meets.any(axis=0)

    walk([layer], meet, every)
    return shown, depth


# rays per thread, and maximum number of threads
RAYS, THREADS = 1 << 13, 8
# least optical depth that counts as something
LEAST = 1e-9
MOST_SHARE = 1 - 1e-6
# share of the light that is absorbed at a pixel's depth
HALF = 0.5
# blends that show the values that are searched
SEARCHED: dict[str, Blend] = {"max": "mip", "min": "minip"}

At = float | str


def depths(
    x: Volume | Scene,
    camera: Camera,
    at: At | None = HALF,
    settings: Settings | None = None,
    transfer: Transfer | None = None,
) -> np.ndarray:
    """Eye-space depths float64 [H, W], along the view direction in world units, of rays through pixel centres.

    at: depth at which this share of light is absorbed, from 0 (at the first matter) to below 1; "max" or "min": of
    the largest or least value, as shown by `mip` and `minip`; None: ½, or where the field first has the value that the
    blend of the settings shows. NaN where the ray absorbs less, or the value is transparent. settings: of the picture
    that shows the same field. Meshes absorb their opacity. Raises InputError for other `at`, for clouds of points, and
    for volumes that are read in parts.
    """
    settings = settings or Settings()
    scene = Scene([Layer(x, transfer)]) if isinstance(x, Volume) else x
    share, settings = _parse_at(at, settings)
    pixels, meshes = np.arange(camera.size[0] * camera.size[1]), scene.surfaces(settings)
    fields = [field for _, field in fields_of(scene, camera, settings, pixels, "depth map")]

    def follow(first: int) -> np.ndarray:
        some = pixels[first : first + RAYS]
        layers = [field.along(camera, some) for field in fields]
        if share is None:
            return shown_values(layers, settings, len(some))[2]
        surfaces = SurfaceRays.of(meshes, camera, some)
        parts: list[LayerRays | SurfaceRays] = [*layers, *([surfaces] if surfaces else [])]
        enough = LEAST - float(np.log1p(-share))
        return absorb(parts, np.full(len(some), enough))[2]

    with ThreadPoolExecutor(min(os.cpu_count() or 1, THREADS)) as pool:
        result = np.concatenate(list(pool.map(follow, range(0, len(pixels), RAYS))))
    return result.reshape(camera.size[::-1])


def _parse_at(at: At | None, settings: Settings) -> tuple[float | None, Settings]:
    """The absorbed share, None for a value that a blend shows; and settings of a picture that shows it."""
    if isinstance(at, str) and at in SEARCHED:
        return None, settings.replace(blend=SEARCHED[at])
    if at is None:
        return (None if settings.shows_value else HALF), settings
    if isinstance(at, str) or not 0 <= float(at) <= MOST_SHARE:
        raise expected("at", "a share from 0 to below 1, max or min", repr(at)[:80])
    return float(at), settings.absorbing


# optical depth at which half of the light is absorbed
HALF_ABSORBED = float(np.log(2))
MODES = ("first", "max")
# share of a step behind a point at which the voxel of a label is looked up
WITHIN = 1e-6


@dataclass(frozen=True)
class Picked:
    """A point of a volume. place: world units; index: grid position (x, y, z); value: interpolated linearly; of labels,
    that of the voxel; of blends of one value, the one that is shown. distance: from the eye, or from its plane, world
    units. name: of the volume; layer: its number in the scene.

    mesh: number of the mesh, if the point is on one; then `name` is the mesh's, `layer` is -1, index and value are NaN.
    """

    place: Triple
    index: Triple
    value: float
    distance: float
    name: str
    layer: int
    mesh: int | None = None


@public
def pick(
    x: Scene | Volume | Any,
    camera: Camera | Any,
    pixel: Sequence[int],
    transfer: Transfer | Any | None = None,
    mode: str | None = None,
    attenuation: float = 0.0,
    settings: Settings | Any | None = None,
) -> Picked | None:
    """The point under the centre of a pixel (column, row), row 0 on top; None if nothing is visible there.

    A Scene or a Volume in memory keeps its voxels for the next pick, which takes milliseconds; changed samples are
    extracted anew.
    mode "first": where half of the light is absorbed, or half of the ray's total absorption; "max": the largest value,
    of an attenuated MIP the one that is shown; None: as the blend of the settings shows: mip the largest value, minip
    the least, mean the first place of the mean. attenuation: of a largest value, per reference length. settings: of the
    picture that shows the same field. Among layers, the one that absorbs most there. transfer: of a volume; None: its
    default one. Meshes absorb their opacity, and rays end at opaque ones. Raises InputError for a pixel outside the
    picture, for clouds of points, and for volumes that are read in parts.
    """
    settings = _settings_for(mode, attenuation, settings or Settings())
    scene = _scene_of(x, transfer) if isinstance(x, Volume) else x
    pixels = np.array([_pixel_number(pixel, camera)])
    fields = fields_of(scene, camera, settings, pixels, "pick")
    layers = [field.along(camera, pixels) for _, field in fields]
    surfaces = SurfaceRays.of(scene.surfaces(settings), camera, pixels)
    if settings.shows_value:
        layers = [rays.until(surfaces.opaque) for rays in layers] if surfaces else layers
        number, value, depth = (of_ray[0].item() for of_ray in shown_values(layers, settings, 1))
        if np.isfinite(depth):
            return _point(scene, fields[number][0], layers[number], depth, value)
        layers = []
    parts: list[LayerRays | SurfaceRays] = [*layers, *([surfaces] if surfaces else [])]
    total = absorb(parts, np.full(1, np.inf))[3]
    if not total[0] > 0:
        return None
    *piece, reached, _ = absorb(parts, np.minimum(HALF_ABSORBED, total / 2))
    here = np.stack(piece)
    most = int(np.argmax([passed([part], here, np.zeros(1, np.int64))[0, 0] for part in parts]))
    part, depth = parts[most], float(reached[0])
    if isinstance(part, LayerRays):
        return _point(scene, fields[most][0], part, depth)
    mesh = int(part.mesh[0, int(np.searchsorted(part.depth[0], depth))])
    return _point_of_mesh(scene, mesh, camera, pixels, depth)


# scenes of picked volumes, with the checksums of their samples and the transfer functions
_PICKED: WeakKeyDictionary[Volume, tuple[int, Transfer | None, Scene]] = WeakKeyDictionary()


def _scene_of(volume: Volume, transfer: Transfer | None) -> Scene:
    """The scene of a volume, the same one for the same samples and transfer function."""
    if not isinstance(volume.samples, np.ndarray):
        return Scene([Layer(volume, transfer)])
    code = crc32(np.ascontiguousarray(volume.samples).data)
    earlier = _PICKED.get(volume)
    if earlier is not None and earlier[:2] == (code, transfer):
        return earlier[2]
    # a copy that shares the samples: the scene does not keep the volume alive
    scene = Scene([Layer(replace(volume), transfer)])
    _PICKED[volume] = code, transfer, scene
    return scene


def _settings_for(mode: str | None, attenuation: float, settings: Settings) -> Settings:
    """Settings of a picture that shows the value that is picked."""
    if mode is None:
        return settings
    if mode not in MODES:
        raise expected("mode", " or ".join(MODES), repr(mode))
    if mode == "first":
        return settings.absorbing
    if attenuation:
        return settings.replace(blend="attenuated-mip", mip_attenuation=attenuation)
    return settings if settings.join == "attenuated" else settings.replace(blend="mip")


def _pixel_number(pixel: Any, camera: Camera) -> int:
    width, height = camera.size
    try:
        column, row = (int(number) for number in pixel)
    except (TypeError, ValueError):
        column = row = -1
    if not (0 <= column < width and 0 <= row < height):
        raise expected("pixel", f"a column and a row within {width}×{height}", repr(pixel)[:80])
    return row * width + column


def _point(scene: Scene, number: int, rays: LayerRays, depth: float, value: float | None = None) -> Picked:
    """The point of a layer at a depth. value: if known already."""
    layer = scene.shown[number]
    volume, index = layer.volume, rays.start[:, 0] + rays.along[:, 0] * depth
    if layer.seen.labels:
        # a point in the face of a voxel is in the one that begins there
        inner = index + rays.along[:, 0] * (rays.step[0] * WITHIN)
        x, y, z = np.clip(np.rint(inner), 0, np.array(volume.shape[::-1]) - 1).astype(np.int64)
        value = float(volume.samples[z, y, x])
    elif value is None:
        value = float(trilinear(volume.samples[..., None], index[None])[0, 0])
        # beside missing samples, the field's
        value = value if np.isfinite(value) else float(rays.states(np.array([depth]), np.zeros(1, np.int64))[0, 0])
    world = volume.world_from_index @ index + np.asarray(volume.origin)
    return Picked(_triple(world), _triple(index), value, depth * float(rays.length[0]), volume.name, number)


def _point_of_mesh(scene: Scene, mesh: int, camera: Camera, pixels: np.ndarray, depth: float) -> Picked:
    """The point of a mesh at a depth."""
    row, column = divmod(int(pixels[0]), camera.size[0])
    across, down = (slopes[place] for slopes, place in zip(camera.slopes(), (column, row), strict=True))
    scale = depth if camera.perspective else 1.0
    place = np.array([across * scale, down * scale, depth]) @ camera.eye_from_world + camera.eye
    distance = depth * float(ray_lengths(camera, pixels)[0])
    nothing = (np.nan,) * 3
    return Picked(_triple(place), nothing, np.nan, distance, scene.meshes[mesh].name, -1, mesh)


def _triple(numbers: np.ndarray) -> Triple:
    x, y, z = (float(number) for number in numbers)
    return x, y, z
