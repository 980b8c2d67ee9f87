"""Numbers shared by shaders and Python: the values of `#constant NAME`."""

from __future__ import annotations

import numpy as np

from splatgl.splat.classification import colormap, mesh_colors, post
from splatgl.splat.extraction import records, run_lengths
from splatgl.splat.integral import approximations, attenuation
from splatgl.splat.motion import blur_table, motion, motion_opacity
from splatgl.splat.plan import tiling
from splatgl.splat.sheets import near, sheets
from splatgl.splat.view import block_culling, clip, eye_near, mask, screen_bounds

# splats per row of the placed textures, and groups of four entries per row of the tile list
ABREAST, LISTED = 1024, 2048
# ends of cells of the classification table along its rows
TABLE_ROW = 128
# invocations per work group
LANES = 8
# pieces of matter of a page, of which the last names the next page
PAGE = 8
# cursor of a terminated tile
NOWHERE = 0xFFFFFFFF

CONSTANTS: dict[str, float | np.uint32] = {
    "ABREAST": np.uint32(ABREAST),
    "ABSENT": near.ABSENT,
    "AHEAD": motion.AHEAD,
    "BLOCK": np.uint32(block_culling.BLOCK),
    "CELLS": post.CELLS,
    "COLOR_SCALE": records.COLOR_SCALE,
    "COLUMNS": tiling.COLUMNS,
    "DENSE": motion_opacity.DENSE,
    "DENSEST": motion_opacity.DENSEST,
    "FACE": clip.FACE,
    "FAR": motion.FAR,
    "FIRST_ORDER": approximations.FIRST_ORDER,
    "GRAZING": attenuation.GRAZING,
    "FLUSH": clip.FLUSH,
    "GRAZING_RAY": clip.GRAZING,
    "HALF_LINE_REACH": eye_near.HALF_LINE_REACH,
    "HAS_PLACE": eye_near.HAS_PLACE,
    "KNOWN": mesh_colors.KNOWN,
    "LANES": LANES,
    "LARGEST_DEPTH": attenuation.LARGEST_DEPTH,
    "LEAST": motion_opacity.LEAST,
    "LEAST_MASS": sheets.LEAST_MASS,
    "EDGE": sheets.EDGE,
    "AMID": sheets.AMID,
    "CENTERED": sheets.CENTERED[0],
    "WHOLLY": sheets.CENTERED[1],
    "LISTED": np.uint32(LISTED),
    "MAP_ENTRIES": colormap.ENTRIES,
    "MASK_EDGE": mask.EDGE,
    "MASK_ONE": float(mask.ONE),
    "MASK_ZERO": float(mask.ZERO),
    "MASK_SURE": mask.SURE,
    "MOST_CLIPS": clip.MOST_CLIPS,
    "MOST_DOUBLINGS": tiling.MOST_DOUBLINGS,
    "NEAREST": motion.NEAREST,
    "NOWHERE": np.uint32(NOWHERE),
    "ONSET": attenuation.ONSET,
    "PAGE": PAGE,
    "PIXEL_MARGIN": screen_bounds.PIXEL_MARGIN,
    "RIM_GROWTH": attenuation.RIM_GROWTH,
    "RIM_START": attenuation.RIM_START,
    "ROWS": tiling.ROWS,
    "RUN_OCTAVES": run_lengths.OCTAVES,
    "SHORT": blur_table.SHORT,
    "TABLE_ROW": TABLE_ROW,
    "WEIGHTS": post.WEIGHTS,
}


def glsl(name: str) -> str:
    """The constant as a GLSL literal; KeyError for an unknown name."""
    value = CONSTANTS[name]
    return f"{value}u" if isinstance(value, np.uint32) else repr(value)
