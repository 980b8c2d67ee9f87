"""How quads are turned: `align` and the depth z_s at which `hybrid` switches.  [M98 §4]"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from splatgl.data.errors import expected
from splatgl.splat.camera import Camera
from splatgl.splat.footprint import switch_depth
from splatgl.splat.kernel import kernel
from splatgl.splat.rows import Splats
from splatgl.splat.settings import Settings

# one level of an 8-bit picture
LEVELS = 255.0
# the volume's reach, for z_s, is rounded up to powers of this: a moving camera seldom needs a new z_s
REACH_STEP = 1.1


def alignment(splats: Splats, camera: Camera, settings: Settings, notes: list[str]) -> tuple[str, float]:
    """(align, z_s). `auto` never picks grid: it loses path length, and the sum of many splats shows it."""
    if not camera.perspective:
        if settings.align != "grid":
            notes.append("rotation left out: in an orthographic view every ray is perpendicular to the image")
        return "grid", 0.0
    if settings.align == "a" and not splats.grid.cubic:
        raise expected("align a", "cubic voxels", "others", "use exact, b1 or ray")
    if settings.align != "hybrid":
        return ("exact" if settings.align == "auto" else settings.align), 0.0
    if settings.z_s is not None:
        return "hybrid", settings.z_s
    z_k = camera.z_k(splats.grid.mean_spacing)
    return "hybrid", z_k * _switch(splats, camera, settings)


def _switch(splats: Splats, camera: Camera, settings: Settings) -> float:
    """z_s/z_k from the tolerance; the volume's reach from the view axis, rounded up, is its edge."""
    spacing = splats.grid.mean_spacing
    corners = camera.eye_from_points(splats.corners) / spacing
    reach = max(float(np.hypot(corners[:, 0], corners[:, 1]).max()), 1.0)
    rounded = REACH_STEP ** np.ceil(np.log(reach) / np.log(REACH_STEP))
    width, height = camera.size
    half_angle = float(np.arctan(camera.extent / 2 * max(width / height, 1.0)))
    return _cached_switch(settings.kernel, half_angle, max(width, height), float(rounded), settings.tolerance * LEVELS)


@lru_cache(maxsize=256)
def _cached_switch(name: str, half_angle: float, pixels: int, reach: float, levels: float) -> float:
    return switch_depth(kernel(name), half_angle, pixels, reach, levels)
