"""Numbers shared by shaders and Python: the values of `#constant NAME`."""

from __future__ import annotations

import numpy as np

from splatgl.splat.extraction import run_lengths as runs
from splatgl.splat.integral import approximations as forms
from splatgl.splat.integral import attenuation as fill
from splatgl.splat.motion import blur_table, motion
from splatgl.splat.motion import motion_opacity as dwell
from splatgl.splat.plan import tiling
from splatgl.splat.view import block_culling as blocks
from splatgl.splat.view import eye_near as near
from splatgl.splat.view import screen_bounds

# splats per row of the placed textures, and groups of four entries per row of the tile list
ABREAST, LISTED = 1024, 2048
# invocations per work group
LANES = 8
# cursor of a terminated tile
NOWHERE = 0xFFFFFFFF

CONSTANTS: dict[str, float | np.uint32] = {
    "ABREAST": np.uint32(ABREAST),
    "AHEAD": motion.AHEAD,
    "AROUND_EYE": near.AROUND_EYE,
    "BLOCK": np.uint32(blocks.BLOCK),
    "COLUMNS": tiling.COLUMNS,
    "DENSE": dwell.DENSE,
    "DENSEST": dwell.DENSEST,
    "FAR": motion.FAR,
    "FIRST_ORDER": forms.FIRST_ORDER,
    "GRAZING": fill.GRAZING,
    "HALF_LINE_REACH": near.HALF_LINE_REACH,
    "LANES": LANES,
    "LARGEST_DEPTH": fill.LARGEST_DEPTH,
    "LEAST": dwell.LEAST,
    "LISTED": np.uint32(LISTED),
    "MOST_DOUBLINGS": tiling.MOST_DOUBLINGS,
    "NEAREST": motion.NEAREST,
    "NOWHERE": np.uint32(NOWHERE),
    "ONSET": fill.ONSET,
    "PIXEL_MARGIN": screen_bounds.PIXEL_MARGIN,
    "RIM_GROWTH": fill.RIM_GROWTH,
    "RIM_START": fill.RIM_START,
    "ROWS": tiling.ROWS,
    "RUN_OCTAVES": runs.OCTAVES,
    "SHORT": blur_table.SHORT,
}


def glsl(name: str) -> str:
    """The constant as a GLSL literal; KeyError for an unknown name."""
    value = CONSTANTS[name]
    return f"{value}u" if isinstance(value, np.uint32) else repr(value)
