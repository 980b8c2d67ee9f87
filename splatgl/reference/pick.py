"""`pick`: the point of a scene under a pixel, by one ray in float64 through the matter that the picture shows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from splatgl.coercion import public
from splatgl.data.volume import Triple, Volume
from splatgl.errors import expected
from splatgl.geometry.camera import Camera
from splatgl.geometry.grid import trilinear
from splatgl.planning.scene import Layer, Scene
from splatgl.reference.march import LayerRays, SurfaceRays, absorb, fields_of, passed, ray_lengths
from splatgl.reference.one_value import Shown
from splatgl.splat.settings import Settings
from splatgl.transfer.transfer import Transfer

# optical depth at which half of the light is absorbed
HALF = float(np.log(2))
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

    mode "first": where half of the light is absorbed, or half of the ray's total absorption; "max": the largest value,
    of an attenuated MIP the one that is shown; None: as the blend of the settings shows: mip the largest value, minip
    the least, mean the first place of the mean. attenuation: of a largest value, per reference length. settings: of the
    picture that shows the same field. Among layers, the one that absorbs most there. transfer: of a volume; None: its
    default one. Meshes absorb their opacity, and rays end at opaque ones. Raises InputError for a pixel outside the
    picture, for clouds of points, and for volumes that are read in parts.
    """
    settings = _settings_for(mode, attenuation, settings or Settings())
    scene = Scene([Layer(x, transfer)]) if isinstance(x, Volume) else x
    pixels = np.array([_pixel_number(pixel, camera)])
    fields = fields_of(scene, camera, settings, pixels, "pick")
    layers = [field.along(camera, pixels) for _, field in fields]
    surfaces = SurfaceRays.of(scene.surfaces(settings), camera, pixels)
    if settings.shows_value:
        layers = [rays.until(surfaces.opaque) for rays in layers] if surfaces else layers
        shown = Shown.of(layers, settings, 1)
        number, depth = int(shown.layer[0]), float(shown.depth[0])
        if np.isfinite(depth):
            return _point(scene, fields[number][0], layers[number], depth, float(shown.value[0]))
        layers = []
    parts: list[LayerRays | SurfaceRays] = [*layers, *([surfaces] if surfaces else [])]
    total = absorb(parts, np.full(1, np.inf)).total
    if not total[0] > 0:
        return None
    reached = absorb(parts, np.minimum(HALF, total / 2))
    here = np.stack([reached.begin, reached.end])
    most = int(np.argmax([passed([part], here, np.zeros(1, np.int64))[0, 0] for part in parts]))
    part, depth = parts[most], float(reached.depth[0])
    if isinstance(part, LayerRays):
        return _point(scene, fields[most][0], part, depth)
    mesh = int(part.mesh[0, int(np.searchsorted(part.depth[0], depth))])
    return _point_of_mesh(scene, mesh, camera, pixels, depth)


def _settings_for(mode: str | None, attenuation: float, settings: Settings) -> Settings:
    """Settings of a picture that shows the value that is picked."""
    if mode is None:
        return settings
    if mode not in MODES:
        raise expected("mode", " or ".join(MODES), repr(mode))
    if mode == "first":
        return settings.absorbing
    if attenuation:
        return settings.but(blend="attenuated-mip", mip_attenuation=attenuation)
    return settings if settings.join == "attenuated" else settings.but(blend="mip")


def _pixel_number(pixel: Any, camera: Camera) -> int:
    """A pixel's number, row by row."""
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
