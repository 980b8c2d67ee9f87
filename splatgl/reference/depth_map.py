"""Depth maps, by rays through the matter that pictures show."""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from splatgl.data.volume import Volume
from splatgl.errors import expected
from splatgl.geometry.camera import Camera
from splatgl.planning.scene import Layer, Scene
from splatgl.reference.march import LayerRays, SurfaceRays, absorb, fields_of
from splatgl.reference.one_value import Shown
from splatgl.splat.settings import Blend, Settings
from splatgl.transfer.transfer import Transfer

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
            return Shown.of(layers, settings, len(some)).depth
        surfaces = SurfaceRays.of(meshes, camera, some)
        parts: list[LayerRays | SurfaceRays] = [*layers, *([surfaces] if surfaces else [])]
        enough = LEAST - float(np.log1p(-share))
        return absorb(parts, np.full(len(some), enough)).depth

    with ThreadPoolExecutor(min(os.cpu_count() or 1, THREADS)) as pool:
        result = np.concatenate(list(pool.map(follow, range(0, len(pixels), RAYS))))
    return result.reshape(camera.size[::-1])


def _parse_at(at: At | None, settings: Settings) -> tuple[float | None, Settings]:
    """The absorbed share, None for a value that a blend shows; and settings of a picture that shows it."""
    if isinstance(at, str) and at in SEARCHED:
        return None, settings.but(blend=SEARCHED[at])
    if at is None:
        return (None if settings.shows_value else HALF), settings
    if isinstance(at, str) or not 0 <= float(at) <= MOST_SHARE:
        raise expected("at", "a share from 0 to below 1, max or min", repr(at)[:80])
    return float(at), settings.absorbing
