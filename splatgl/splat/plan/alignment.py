"""Orientation of quads: `align` and the depth z_s at which `hybrid` switches.  [M98 §4]"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from splatgl.splat.extraction.splats import Splats
from splatgl.splat.integral.table1 import switch_depth
from splatgl.splat.kernel.kernels import kernel
from splatgl.splat.plan.settings import Settings
from splatgl.splat.view.view import View

# one level of an 8-bit picture
LEVELS = 255.0
# the volume's extent is rounded up to powers of this, so that a moving camera seldom changes z_s
REACH_STEP = 1.1


def alignment(splats: Splats, view: View, settings: Settings, notes: list[str]) -> tuple[str, float]:
    """(align, z_s). `auto` never picks grid: it loses path length, visible in the sum of many splats."""
    if not view.perspective:
        if settings.align != "grid":
            notes.append("rotation left out: in an orthographic view every ray is perpendicular to the image")
        return "grid", 0.0
    if settings.align != "hybrid":
        return ("exact" if settings.align == "auto" else settings.align), 0.0
    if settings.z_s is not None:
        return "hybrid", settings.z_s
    z_k = splats.grid.mean_spacing / view.pitch
    return "hybrid", z_k * _switch(splats, view, settings)


def _switch(splats: Splats, view: View, settings: Settings) -> float:
    """z_s/z_k from the tolerance, at the volume's extent from the view axis, rounded up."""
    reach = max(float(np.hypot(*view.box(splats)[:2]).max()), 1.0)
    rounded = REACH_STEP ** np.ceil(np.log(reach) / np.log(REACH_STEP))
    half_angle = float(np.arctan(view.edge.max()))
    return _cached_switch(view.kernel.name, half_angle, max(view.size), float(rounded), settings.tolerance * LEVELS)


@lru_cache(maxsize=256)
def _cached_switch(name: str, half_angle: float, pixels: int, reach: float, levels: float) -> float:
    return switch_depth(kernel(name), half_angle, pixels, reach, levels)
